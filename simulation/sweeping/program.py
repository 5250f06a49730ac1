"""The C of the batch simulator for one law: batch.c compiled with the names and sizes of the law,
and its types in NumPy."""

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files

import numpy as np

from ...codegen.derivation.grip import can_grip
from ...codegen.dynamics import DynamicsProgram, compile_dynamics
from ...codegen.files import dynamics_text, law_program, law_text, shared_files
from ...codegen.printing.scalar import DOUBLE, SCALARS
from ...codegen.printing.vectors_c import VectorText, dynamics_vectors, law_vectors, turns_function
from ...model.law import ControlLaw
from .. import noise
from ..controllers.odometry import has_arm
from ..controllers.runtime import declarations, knowing, load
from ..controllers.tracking import HEADER as PATH
from ..guidance import led
from ..sensing import angle_coordinates, pose_coordinates

SOURCES = ("batch.c", "batch.h", "lanes.h", "lanes.inc")
VECTORS: tuple[tuple[str, int, str], ...] = (
    ("plain", 2, ""),
    ("avx2", 4, "avx2"),
    ("avx512", 8, "avx512f,avx512dq"),
)  # name, lanes, instructions of x86-64


@dataclass(frozen=True)
class LoopParts:
    """What a loop has: sensors, and whether the pose seen is reckoned by them; a composite path, and the
    number of its segments if its speed has a profile; an approach; outputs with integral action, and with a
    disturbance observer, by name; a gyro that notices slip, and an accelerometer; its drives, one of DRIVES;
    and whether friction is earned.
    """

    sensed: bool = False
    reckoned: bool = True
    route: bool = False
    profile: int = 0
    approach: bool = False
    integrals: tuple[str, ...] = ()
    observers: tuple[str, ...] = ()
    notices: bool = False
    accelerates: bool = False
    drive: str = "torque"
    earns: bool = False


class Simulator:
    """The simulator of a law in a scalar of the controller's. `ffi` has its types, `lib` its functions;
    `steps`: whether vectors compute the law, too.
    """

    def __init__(self, law: ControlLaw, scalar: str, parts: LoopParts):
        """Raises BadInput as `pose_coordinates` does."""
        own, dynamics = files(__package__), compile_dynamics(law.system)
        vectors = vectors_of(law, dynamics, scalar, parts)
        law_h = _header(law, scalar, parts, vectors)
        texts = {name: (own / name).read_text(encoding="utf-8") for name in SOURCES} | noise.source()
        texts |= vectors.files() if vectors else {}
        self.steps = vectors is not None and vectors.steps
        self.ffi = knowing(declarations(PATH) + _declared(texts["batch.h"], law_h))
        plant = {
            **dynamics_text(dynamics, DOUBLE).files(),
            **dynamics_text(dynamics, SCALARS[scalar]).files(),
        }
        made = [
            {**shared_files(law.system, s), **law_text(law_program(law), s).files()}
            for s in (DOUBLE, SCALARS[scalar])
        ]
        self.lib = load(
            self.ffi, {**texts, "batch_law.h": law_h, **plant, **made[0], **made[1]}, optimized=True
        )

    def type(self, name: str) -> np.dtype:
        """Return the NumPy type of a struct of doubles."""
        return np.dtype(
            [(field, float, (part.type.length,)) if part.type.kind == "array" else (field, float)
             for field, part in self.ffi.typeof(name).fields]
        )  # fmt: skip


@lru_cache(maxsize=16)
def program(law: ControlLaw, scalar: str, parts: LoopParts) -> Simulator:
    """Return the simulator, compiled once per process."""
    return Simulator(law, scalar, parts)


@dataclass(frozen=True)
class Vectors:
    """What the loops of a law have in vectors: the dynamics, the test of a singular Phi, and where it
    `steps`, since nothing else belongs to the loop, the law. `driven`: entries of the state whose rates the
    drives determine.
    """

    dynamics: VectorText
    law: VectorText
    steps: bool
    driven: tuple[int, ...]

    def known(self) -> dict[str, object]:
        """Return the sizes, for batch_law.h."""
        reads = sorted({*self.dynamics.reads, *self.driven})
        return {
            **{"LANES": 1, "STEPS": int(self.steps), "READS": len(reads), "READ": _list(reads)},
            **{"PLANT_CONSTANTS": self.dynamics.count, "LAW_CONSTANTS": self.law.count},
        }

    def puts(self) -> list[str]:
        """Return the functions that copy constants of a robot to its lane."""
        kinds = (("plant", "BATCH_PLANT()", self.dynamics), ("law", "BATCH_JUDGE()", self.law))
        heads = [
            f"static inline void batch_put_{name}(const {kind} *one, double *constants, int width)"
            for name, kind, _ in kinds
        ]
        return [f"{head}\n{{\n{text.puts}\n}}" for head, (*_, text) in zip(heads, kinds, strict=True)]

    def files(self) -> dict[str, str]:
        """Return the sources of the vectors of each size, which have the same text, and what they include."""
        turns = turns_function(sorted({*self.dynamics.turns, *self.law.turns}))
        text = "\n\n".join([turns, self.dynamics.functions, self.law.functions]) + "\n"
        return {"batch_vectors.inc": text, **{f"lanes_{size[0]}.c": _of_size(*size) for size in VECTORS}}


def vectors_of(law: ControlLaw, dynamics: DynamicsProgram, scalar: str, parts: LoopParts) -> Vectors | None:
    """Return what the loops of a law have in vectors; None if vectors cannot compute the dynamics or Phi."""
    alone = replace(parts, reckoned=True) == LoopParts() and scalar == DOUBLE.real
    steps = alone and all(row.unit != "rad" for row in law.output.rows)
    plant, control = dynamics_vectors(dynamics), law_vectors(law_program(law), steps, knows_ground(law))
    if plant is None or control is None or law.system.dof != 2:
        return None
    first, last = len(law.system.mechanism.coordinates), len(law.system.state)
    return Vectors(plant, control, steps, tuple(range(first, last)) if parts.drive != "torque" else ())


def _of_size(name: str, width: int, instructions: str) -> str:
    """Return the source of the vectors of a size."""
    lines = [
        f"#define LANES_WIDTH {width}",
        f'#define LANES_NAME "{name}"',
        f"#define LANES_KIT lanes_{name}",
    ]
    lines.append('#include "lanes.inc"')
    if instructions:
        clang = (
            f'#pragma clang attribute push(__attribute__((target("{instructions}"))), apply_to = function)'
        )
        gcc = f'#pragma GCC target("{instructions}")'
        lines = ["#if defined(__x86_64__)", "#if defined(__clang__)", clang, "#else", gcc, "#endif", *lines]
        lines += [
            "#if defined(__clang__)",
            "#pragma clang attribute pop",
            "#endif",
            "#else",
            "typedef int nothing;",
            "#endif",
        ]
    return "\n".join([*lines, ""])


def _header(law: ControlLaw, scalar: str, parts: LoopParts, vectors: Vectors | None) -> str:
    """Return batch_law.h: names in the generated C, and sizes."""
    leads = led(law) if parts.approach else []
    mechanism, own = law.system.mechanism, SCALARS[scalar]
    degree, rows = law.linearization.relative_degree, law.output.rows
    names = [q.name for q in law.reference]
    entries = [names.index(row.name) for row in rows]
    acting, observed = (
        [k for k, row in enumerate(rows) if row.name in chosen]
        for chosen in (parts.integrals, parts.observers)
    )
    rate_of = [sum(d > 1 for d in degree[:k]) if degree[k] > 1 else -1 for k in observed]
    angles = [k for k, row in enumerate(rows) if row.unit == "rad" and not parts.route]
    suffix = f"##{own.suffix}" if own.suffix else ""
    known = {
        "REAL": own.real,
        "SEGMENT": own.name("noslip_segment"),
        "RUNTIME(name)": f"name{suffix}",
        "ROBOT(name)": f"{mechanism.name}##name{suffix}",
        "LAW(name)": f"{mechanism.name}_{law.name}##name{suffix}",
        "JUDGE_ROBOT(name)": f"{mechanism.name}##name",
        "JUDGE(name)": f"{mechanism.name}_{law.name}##name",
        "PLANT(name)": f"{mechanism.name}_dynamics##name",
        "COORDINATES": len(mechanism.coordinates),
        "DOF": law.system.dof,
        "STATE": len(law.system.state),
        "EXTENSION": len(law.extension),
        "PARAMETERS": len(law.parameters),
        "CONFIG": len(law.config),
        "GAINS": len(law.gains),
        "INPUTS": len(mechanism.inputs),
        "ANSWER": len(law.inputs),
        "GIVEN": len(mechanism.inputs) + (law.system.dof if parts.drive != "torque" else 0),
        "DRIVE": 0 if parts.drive == "torque" else 2 if law.kinematic else 1,
        "FEEDS": int(parts.drive == "velocity+torque"),
        "ROWS": len(rows),
        "REFERENCE": len(law.reference),
        "REFERENCE_OF_ROW": _list(entries),
        "ANGLES": len(angles),
        "ANGLE_ROWS": _list(angles),
        "INTEGRALS": len(acting),
        "INTEGRAL_ROWS": _list(acting),
        "OBSERVERS": len(observed),
        "OBSERVER_ROWS": _list(observed),
        "OBSERVER_RATES": _list(rate_of),
        "OBSERVER_GAINS": _list([sum(degree[:k]) for k in observed]),
        "RATES": int(any(d > 1 for d in degree)),
        "HIGHEST": _list([entry + d for entry, d in zip(entries, degree, strict=True)]),
        "SINGLE": int(bool(own.suffix)),
        "DAMPED": int(law.output.band is not None),
        "SENSED": int(parts.sensed),
        "RECKONED": int(parts.reckoned),
        "ROUTE": int(parts.route),
        "PROFILE": parts.profile,
        "NOTICES": int(parts.notices),
        "ACCELERATES": int(parts.accelerates),
        "SPEED": entries[law.speed_row] if law.speed_row is not None else -1,
        "APPROACHES": len(leads),
        "LED_ROWS": _list([each.position[0] if each.position else -1 for each in leads]),
        "LED_SPEEDS": _list([each.speed[0] if each.speed else -1 for each in leads]),
        "CONTACTS": len(mechanism.contacts) if knows_ground(law) else 0,
        "STANDING": len(mechanism.standing),
    }
    if parts.sensed or parts.route:
        known["POSE"] = _list(pose_coordinates(law.system))
        known["ARM"] = int(has_arm(law.system))
    if parts.sensed:
        known["WHEELS"] = _list(angle_coordinates(law.system))
    known |= vectors.known() if vectors else {"LANES": 0, "STEPS": 0}
    includes = [
        own.name(f"{mechanism.name}_{law.name}"),
        f"{mechanism.name}_{law.name}",
        f"{mechanism.name}_dynamics",
    ]
    includes += [own.name(f"{mechanism.name}_dynamics")] if parts.drive != "torque" else []
    lines = [f'#include "{name}.h"' for name in dict.fromkeys(includes)]
    lines += [*(f"#define BATCH_{k} {v}" for k, v in known.items()), *(vectors.puts() if vectors else [])]
    return "\n".join(["#ifndef BATCH_LAW_H", "#define BATCH_LAW_H", *lines, "#endif\n"])


def knows_ground(law: ControlLaw) -> bool:
    """Return whether the C of the law computes the forces on the ground; that of a kinematic law, or of one
    with a dynamic extension, does not.
    """
    return can_grip(law.system) and not law.extension and not law.kinematic


def _list(numbers: list[int]) -> str:
    return "{" + ", ".join(map(str, numbers)) + "}"


def _declared(header: str, law_h: str) -> str:
    """Return batch.h for cffi, with the macros of the law replaced by their values."""
    known = dict(re.findall(r"#define (BATCH_\w+) (-?\w+)$", law_h, re.MULTILINE))
    text = "\n".join(line for line in header.splitlines() if not line.startswith("#"))
    return re.sub(r"\bBATCH_[A-Z_]+\b", lambda name: known[name[0]], text)

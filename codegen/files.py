"""Every file of a robot's C, as text: the same models give the same bytes."""

import hashlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from ..model.law import ControlLaw
from ..model.reduction import ReducedSystem
from ..model.vehicle import steered_axle
from ..readers.kept import remembered
from ..readers.printing import as_json
from .adaptation.adaptation import adaptation_files
from .dynamics import DynamicsProgram, compile_dynamics
from .ekf.ekf import FilterC, FilterText
from .ekf.filter import FilterProgram, compile_filter
from .follower.follower import follower_files, is_followers
from .identity import banner, details, fingerprint
from .printing.dynamics_c import DynamicsC
from .printing.lanes_c import LanesC
from .printing.law_c import LawC
from .printing.robot_c import robot_header, robot_source
from .printing.scalar import SCALARS, Scalar
from .program import FOLLOW, Program, compile_law
from .telemetry.telemetry import telemetry_files
from .versions import TOOLS


@lru_cache(maxsize=64)
def law_program(law: ControlLaw) -> Program:
    """Return the law as a program, the same for both scalars; derived once, and cached between runs."""
    key = ("law", TOOLS, fingerprint(law.system, law), details(law))
    return remembered(key, lambda: compile_law(law), law, law.system)


def has_follower(law: ControlLaw) -> bool:
    """Return whether a follower is written for a law.

    That of a steered vehicle calls the law with the whole state; that of two driven wheels requires a law
    which reads position and heading relative to the path only.
    """
    return is_followers(law) and bool(steered_axle(law.system) or FOLLOW in law_program(law).entries)


@lru_cache(maxsize=16)
def dynamics_program(system: ReducedSystem) -> DynamicsProgram:
    """The robot's dynamics as a program, the same for both scalars; derived once, and cached between runs."""
    return remembered(("dynamics", TOOLS, fingerprint(system)), lambda: compile_dynamics(system), system)


@lru_cache(maxsize=16)
def filter_text(system: ReducedSystem, scalar: Scalar, scaled: tuple[str, ...] = ()) -> FilterText:
    """The C of the robot's filter with the scales that it estimates; written once, and cached between runs.
    Raises as `compile_filter`."""
    about = banner(fingerprint(system))
    key = ("filter", TOOLS, *about, scalar.real, scaled)
    return remembered(key, lambda: FilterC(filter_program(system, scaled), scalar, about).text())


@lru_cache(maxsize=16)
def filter_program(system: ReducedSystem, scaled: tuple[str, ...] = ()) -> FilterProgram:
    """The robot's filter as a program, the same for both scalars."""
    return compile_filter(system, scaled)


def robot_files(
    system: ReducedSystem,
    laws: Sequence[ControlLaw],
    scalars: Sequence[str] = tuple(SCALARS),
    dynamics: bool = True,
    lanes: bool = False,
    scaled: Sequence[str] | None = None,
    adapted: Sequence[str] = (),
) -> dict[str, str]:
    """File name -> text of the robot's headers and sources and a manifest that lists them with their costs.

    `dynamics` says whether the plant is among them; with it, the follower is where one of the laws has one.
    `lanes` says whether the batch laws are, in a folder of their own; `scaled`, of what the filter estimates
    the scale (None: no filter); `adapted`, the parameters that are learned, which requires the dynamics
    (empty: none).
    """
    files: dict[str, str] = {}
    manifest: dict[str, Any] = {
        "robot": system.mechanism.name,
        "tools": TOOLS,
        "model_sha256": fingerprint(system),
        "laws": {},
    }
    programs = [law_program(law) for law in laws]
    plant = dynamics_program(system) if dynamics else None
    for scalar in (SCALARS[name] for name in scalars):
        files.update(shared_files(system, scalar))
        for program in programs:
            text = law_text(program, scalar)
            files.update(text_files(text))
            files.update(
                text_files(LanesC(program, scalar, text.banner))
                if lanes and not program.law.kinematic
                else {}
            )
            manifest["laws"][program.law.name] = {
                "relative_degree": list(program.law.linearization.relative_degree),
                "model_sha256": fingerprint(system, program.law),
                "operations": {entry.name: text.operations(entry) for entry in text.entries},
            }
        if plant:
            of_plant = dynamics_text(plant, scalar)
            files.update(text_files(of_plant))
            for program in (program for program in programs if has_follower(program.law)):
                model = fingerprint(system, program.law)
                files.update(follower_files(program.law, scalar, banner(model)))
                files.update(telemetry_files(program.law, scalar, banner(model), model, files))
            if adapted:
                files.update(adaptation_files(system, adapted, scalar, banner(fingerprint(system))))
            manifest["dynamics"] = {
                "operations": {entry.name: of_plant.operations(entry) for entry in plant.entries}
            }
        if scaled is not None:
            of_filter = filter_text(system, scalar, tuple(scaled))
            files.update(of_filter.files)
            manifest["ekf"] = {"scales": list(scaled), "operations": of_filter.operations}
    manifest["files"] = digests(files)
    files["manifest.json"] = as_json(manifest) + "\n"
    return dict(sorted(files.items()))


def digests(files: Mapping[str, str]) -> dict[str, str]:
    """SHA-256 of each text by its file's name, sorted."""
    return {name: hashlib.sha256(text.encode()).hexdigest() for name, text in sorted(files.items())}


def shared_files(system: ReducedSystem, scalar: Scalar) -> dict[str, str]:
    """Header and source that all laws of a robot share."""
    own, about = scalar.name(system.mechanism.name), banner(fingerprint(system))
    return {f"{own}.h": robot_header(system, scalar, about), f"{own}.c": robot_source(system, scalar, about)}


def law_text(program: Program, scalar: Scalar) -> LawC:
    """The C of one law with its banner."""
    return LawC(program, scalar, banner(fingerprint(program.law.system, program.law)))


def text_files(text: LawC | DynamicsC) -> dict[str, str]:
    """File name -> text of a law or of dynamics; written once, and cached between runs."""
    own = details(text.law) if isinstance(text, LawC) else ""
    return remembered(("text", type(text).__name__, text.type, *text.banner, own), text.files)


def dynamics_text(program: DynamicsProgram, scalar: Scalar) -> DynamicsC:
    """The C of the robot's dynamics with its banner."""
    return DynamicsC(program, scalar, banner(fingerprint(program.system)))

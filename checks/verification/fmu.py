"""FMUs: made, compiled for this platform, loaded again and compared with the compiled law and dynamics."""

from __future__ import annotations

import io
import platform
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...codegen.dynamics import ENTRIES
from ...codegen.fmu.fmu import HEADER, fmu
from ...codegen.graph import Group
from ...model.algebra.integration import runge_kutta
from ...model.law import ControlLaw
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput, Mismatch
from ...readers.files import work_folder
from ...readers.kept import folder_of_results
from ...simulation.controllers.build import FLAGS, OPTIMIZED, built, compiler, with_runtime
from ...simulation.controllers.compiled import CompiledController, CompiledDynamics, DynamicsLibrary
from ...simulation.controllers.runtime import declarations, knowing
from .sampling import random_motions, random_plants

STATES, SEED = 20, 1992  # states at which a step is compared, and the seed of the random numbers
STEP = 1e-3  # s, of the comparison
CLOSE = 1e-12  # of the integrated state, relative to its largest change and value
MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib")}
ACCELERATION = next(entry for entry in ENTRIES if entry.takes is Group.INPUT)


def make_fmu(
    kind: str, system: ReducedSystem, law: ControlLaw | None, files: Mapping[str, str]
) -> tuple[str, bytes]:
    """Return the name of the model and the FMU, with a binary for this platform, after a comparison of its
    steps with the compiled C.

    `kind`: controller, plant (without a law) or loop. `files`: C of the robot in double, file name -> text.
    Raises Mismatch if a step differs, BadInput if there is no compiler or no name for this platform.
    """
    folder, suffix = _platform()
    identifier, texts = fmu(kind, system, law, with_runtime(files))
    sources = {Path(name).name: text for name, text in texts.items() if name.startswith("sources/")}
    compiled = [name for name in sources if name.endswith(".c")]
    product = f"{identifier}{suffix}"
    binary = built(
        [*compiler(), *FLAGS, "-shared", *OPTIMIZED, "-fvisibility=hidden", *compiled], sources, product
    )
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        contents = {name: text.encode() for name, text in texts.items()} | {
            f"binaries/{folder}/{product}": binary.read_bytes()
        }
        for name, content in contents.items():
            # Without a date: the same bytes again
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    with work_folder(folder_of_results()) as work:
        with zipfile.ZipFile(written) as archive:
            archive.extractall(work)
        if wrong := _differences(Instance(work), kind, system, law):
            raise Mismatch(f"{identifier}: {wrong}")
    return identifier, written.getvalue()


def _platform() -> tuple[str, str]:
    """Return the name of this platform in FMI 3.0, and the suffix of its libraries."""
    machine, system = MACHINES.get(platform.machine().lower()), SYSTEMS.get(sys.platform)
    if machine is None or system is None:
        raise BadInput(
            f"an FMU for {platform.machine()} {sys.platform} cannot be made; export it on x86-64 or ARM64, "
            "Linux or macOS"
        )
    return f"{machine}-{system[0]}", system[1]


class Instance:
    """An instance of the FMU in a folder, initialized by `start`;
    variables have the names of its description."""

    def __init__(self, folder: Path):
        description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        identifier = description.attrib["modelName"]
        variables = [each.attrib for each in description.findall("ModelVariables/*")]
        self.references = {each["name"]: int(each["valueReference"]) for each in variables}
        self._whole = {each["name"] for each in variables if "declaredType" in each}
        self._ffi = knowing(declarations(HEADER, folder / "sources"))
        where, suffix = _platform()
        self._lib: Any = self._ffi.dlopen(str(folder / "binaries" / where / f"{identifier}{suffix}"))
        self._self = self._ffi.NULL
        null, token = self._ffi.NULL, description.attrib["instantiationToken"].encode()
        self._self = self._lib.fmi3InstantiateCoSimulation(
            b"", token, null, 0, 0, 0, 0, null, 0, null, null, null
        )
        if not self._self:
            raise Mismatch(f"{identifier}: the FMU does not accept its own token")

    def start(self, values: Mapping[str, float]) -> bool:
        """Start again at time 0 with parameters and starting values; return whether they are accepted."""
        self._lib.fmi3Reset(self._self)
        self.set(values)
        self._lib.fmi3EnterInitializationMode(self._self, 0, 0.0, 0.0, 0, 0.0)
        return self._lib.fmi3ExitInitializationMode(self._self) == self._lib.fmi3OK

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables. Raises Mismatch if the FMU refuses one."""
        for name, value in values.items():
            kind, access = (
                ("fmi3Int64", "fmi3SetInt64") if name in self._whole else ("fmi3Float64", "fmi3SetFloat64")
            )
            buffer = self._ffi.new(f"{kind}[]", [value])
            if (
                getattr(self._lib, access)(self._self, [self.references[name]], 1, buffer, 1)
                != self._lib.fmi3OK
            ):
                raise Mismatch(f"{name} cannot be set to {value}")

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Return the values of variables that are numbers."""
        values = self._ffi.new("fmi3Float64[]", len(names))
        self._lib.fmi3GetFloat64(
            self._self, [self.references[name] for name in names], len(names), values, len(names)
        )
        return np.array(list(values))

    @property
    def status(self) -> int:
        """Return the variable `status`."""
        value = self._ffi.new("fmi3Int64[1]")
        self._lib.fmi3GetInt64(self._self, [self.references["status"]], 1, value, 1)
        return value[0]

    def step(self, time: float, duration: float) -> bool:
        """Do a communication step (s); return whether it could be computed."""
        none = self._ffi.NULL
        return (
            self._lib.fmi3DoStep(self._self, time, duration, 1, none, none, none, none)
            <= self._lib.fmi3Warning
        )

    def __del__(self) -> None:
        if self._self:
            self._lib.fmi3FreeInstance(self._self)


def _differences(instance: Instance, kind: str, system: ReducedSystem, law: ControlLaw | None) -> str:
    """Return the first difference between a step of the FMU and the compiled C at random states;
    empty if there is none."""
    state, inputs = (
        [f"state.{q.name}" for q in system.state],
        [f"tau.{q.name}" for q in system.mechanism.inputs],
    )
    dynamics = DynamicsLibrary(system, "double") if kind != "controller" else None
    for values, x, tau in _cases(system, law):
        if dynamics:
            values |= {"integration_step": STEP}
        if not instance.start(values) or not instance.step(0.0, STEP):
            return f"a step is refused at {values}"
        if law and not np.array_equal(instance.get(inputs), tau):
            return f"tau is {instance.get(inputs)}, of the compiled law {tau}, at {values}"
        if dynamics:
            params = [values[f"params.{q.name}"] for q in system.mechanism.parameters]
            right, reached = _reached(CompiledDynamics(dynamics, params), x, tau), instance.get(state)
            if not np.all(np.abs(reached - right) <= CLOSE * (np.abs(x) + np.abs(right - x).max() + 1)):
                return (
                    f"the state after {STEP} s is {reached}, from the compiled dynamics {right}, at {values}"
                )
    return ""


def _cases(
    system: ReducedSystem, law: ControlLaw | None
) -> Iterator[tuple[dict[str, float], np.ndarray, np.ndarray]]:
    """Yield values of the variables that can be set, state, and tau (of the compiled law if there is one)."""

    def named(
        group: str, quantities: Sequence[Any], numbers: Sequence[float] | np.ndarray
    ) -> dict[str, float]:
        return {f"{group}.{q.name}": float(value) for q, value in zip(quantities, numbers, strict=True)}

    mechanism = system.mechanism
    if law is None:
        for motion in random_motions(system, STATES, SEED):
            values = named("params", mechanism.parameters, motion.params) | named(
                "state", system.state, motion.state
            )
            yield values | named("tau", mechanism.inputs, motion.tau), motion.state, motion.tau
        return
    for plant in random_plants(law, STATES, SEED):
        fixed = [
            named(*group)
            for group in (("params", law.parameters, plant.params), ("config", law.config, plant.config))
        ]
        fixed.append(named("gains", law.gains, plant.gains))
        controller = CompiledController(law, plant.params, plant.config, plant.gains)
        for point in plant.points:
            status, tau = controller.step(point.state, point.reference)
            if status != "ok":
                continue
            x, xi = np.split(point.state, [len(system.state)])
            values = named("state", system.state, x) | named("extension", law.extension, xi)
            values |= named("reference", law.reference, point.reference)
            yield {**fixed[0], **fixed[1], **fixed[2], **values}, x, tau


def _reached(dynamics: CompiledDynamics, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the state after STEP seconds of constant tau, by the method of Runge and Kutta of order 4."""

    def rate(x: np.ndarray) -> np.ndarray:
        values = dynamics.entry(ACCELERATION, x, tau).values
        return (
            np.concatenate([values[name] for name in ACCELERATION.answers])
            if values
            else np.full(len(x), np.nan)
        )

    return runge_kutta([rate] * 4, x, STEP)

"""The generated filter of a robot as an object: init, ticks, measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ....codegen.ekf.ekf import NAME as FILTER_NAME
from ....codegen.files import filter_text, shared_files
from ....codegen.printing.scalar import SCALARS, Scalar
from ....model.errors import ModelError
from ....model.reduction import ReducedSystem
from ....readers.errors import check_status, naming
from ..controller import Numbers
from ..runtime import SOURCE, InC, declarations, knowing, load

KINDS = ("pose", "position", "heading", "range")  # as in the C


@dataclass(frozen=True, kw_only=True)
class FilterOptions:
    """What the filter is told, SI; as in ROBOT_ekf.h.

    `noise`: of each quasi-velocity's integral, the standard deviation after one unit of it (rad for wheels);
    errors grow as random walks. `gyro_noise` 0: no gyro. `start_sd`: standard deviations of the first pose
    (m, m, rad).
    """

    noise: Numbers
    start: Numbers = (0.0, 0.0, 0.0)
    start_sd: Numbers = (1e-3, 1e-3, 1e-3)
    gyro_noise: float = 0.0
    bias_sd: float = 0.0
    bias_walk: float = 0.0
    scale_sd: Mapping[str, float] = field(default_factory=dict)
    gate: float = 0.0
    tolerated: int = 0
    memory: int = 0  # ticks in the past that late measurements may refer to


def unpacked(factors: Numbers, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return U (n, n), unit upper triangular, and D (n,) of P = U diag(D) U',
    packed by columns as in noslip_factors.h."""
    packed, U, D = iter(factors), np.eye(n), np.zeros(n)
    for j in range(n):
        U[:j, j] = [next(packed) for _ in range(j)]
        D[j] = next(packed)
    return U, D


class RobotPart(InC):
    """A compiled part of a robot's C besides laws and dynamics, in one scalar: its filter,
    or what learns its parameters."""

    def __init__(self, system: ReducedSystem, scalar: Scalar, part: str, files: Mapping[str, str]):
        """`part`: ekf or adaptation; `files`: headers and sources of the robot that it needs,
        name -> text."""
        self.scalar, self.robot = scalar, system.mechanism.name
        with TemporaryDirectory() as folder:
            for name, content in files.items():
                Path(folder, name).write_text(content, encoding="utf-8")
            self.ffi = knowing(declarations(f"{scalar.name(f'{self.robot}_{part}')}.h", Path(folder)))
        self.lib = load(self.ffi, {**files, "library.c": SOURCE.format(header=f"noslip_{part}.h")})

    def new(self, kind: str, *initial) -> Any:
        """Return a new struct of the kind named as in the headers."""
        return self.ffi.new(f"{self.scalar.name(kind)} *", *initial)

    def of_robot(self, name: str) -> Any:
        """Return a function of the robot."""
        return getattr(self.lib, self.scalar.name(f"{self.robot}_{name}"))

    def function(self, name: str) -> Any:
        """Return a function of the runtime."""
        return getattr(self.lib, self.scalar.name(name))


@lru_cache(maxsize=16)
def filter_library(system: ReducedSystem, scalar: str, scaled: tuple[str, ...] = ()) -> RobotPart:
    """Return the compiled filter, loaded once per process. Raises BadInput if the robot has none."""
    in_c = SCALARS[scalar]
    with naming("", ModelError):
        return RobotPart(
            system,
            in_c,
            FILTER_NAME,
            {**shared_files(system, in_c), **filter_text(system, in_c, scaled).files},
        )


class Filter:
    """One filter, initialized. Raises BadInput if init returns an error. Poses: x, y (m), heading (rad,
    not wrapped)."""

    def __init__(
        self,
        system: ReducedSystem,
        parameters: Numbers,
        options: FilterOptions,
        scalar: str = "double",
        made_by: RobotPart | None = None,
    ):
        """`parameters` in the order of mechanism.parameters; `made_by`: the library,
        if it is not that of this host."""
        c = self.c = made_by or filter_library(system, scalar, tuple(options.scale_sd))
        self.self = c.new(f"{c.robot}_ekf")
        config = c.new(f"{c.robot}_ekf_config")
        for q, value in zip(system.mechanism.parameters, parameters, strict=True):
            setattr(config.params, q.in_c, float(value))
        for name in ("start", "start_sd"):
            place = getattr(config.filter, name)
            place.x, place.y, place.heading = map(float, getattr(options, name))
        for q, value in zip(system.quasi_velocities, options.noise, strict=True):
            setattr(config, f"noise_{q.in_c}", value)
        for scaled, value in options.scale_sd.items():
            setattr(config, f"scale_{scaled}_sd", value)
        for name in ("gyro_noise", "bias_sd", "bias_walk"):
            setattr(config, name, getattr(options, name))
        config.filter.gate, config.filter.tolerated = options.gate, options.tolerated
        if options.memory:
            self._past = c.ffi.new(f"{c.scalar.name('noslip_ekf_past')}[]", options.memory)
            config.filter.past, config.filter.capacity = self._past, options.memory
        self._pose = c.new("noslip_pose")
        self._covariance = c.ffi.new(f"{c.scalar.real}[9]")
        status = c.status(c.of_robot("ekf_init")(self.self, config))
        check_status(status, "the filter's init", "check noise and standard deviations, 1e-6 to 1e6")

    @property
    def pose(self) -> np.ndarray:
        """Estimated pose."""
        return self.state[:3]

    @property
    def state(self) -> np.ndarray:
        """Estimated states: the pose, the gyro's bias, the scales."""
        return np.array(list(self.self.filter.state)[: self.self.filter.states])

    @property
    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """U, unit upper triangular, and the diagonal of D."""
        return unpacked(self.self.filter.factors, self.self.filter.states)

    @property
    def covariance(self) -> np.ndarray:
        """P = U D U', of all states."""
        U, D = self.factors
        return (U * D) @ U.T

    @property
    def nis(self) -> float:
        """Normalized innovation squared of the last measurement."""
        return self.self.filter.nis

    def place(self, state: Numbers, factors: Numbers) -> None:
        """Set estimate and factors (packed, as in the C), which only a comparison does."""
        for member, values in ((self.self.filter.state, state), (self.self.filter.factors, factors)):
            for k, value in enumerate(values):
                member[k] = float(value)
        for k in range(3):
            self.self.filter.rounded[k] = 0

    def tick(self, turned: Numbers, dt: float, gyro: float | None = None, measured: Numbers = ()) -> str:
        """Move by one tick; return the name of the status."""
        real = self.c.scalar.real
        arrays = [
            self.c.ffi.new(f"{real}[]", [float(v) for v in values])
            for values in (turned, measured)
            if len(values)
        ]
        rate = self.c.ffi.NULL if gyro is None else self.c.ffi.new(f"{real} *", gyro)
        return self.c.status(self.c.of_robot("ekf_tick")(self.self, *arrays, rate, dt, self._pose))

    def correct(self, kind: str, **numbers: float) -> str:
        """Use a measurement, whose numbers are the fields of noslip_fix; return the name of the status."""
        fix = self.c.new("noslip_fix", {"kind": KINDS.index(kind), **numbers})
        return self.c.status(
            self.c.function("noslip_ekf_correct")(self.c.ffi.addressof(self.self, "filter"), fix)
        )

    def reset(self, pose: Numbers, sd: Numbers) -> str:
        """Restart with a pose; return the name of the status."""
        given = [self.c.new("noslip_pose", [float(v) for v in values]) for values in (pose, sd)]
        return self.c.status(
            self.c.function("noslip_ekf_reset")(self.c.ffi.addressof(self.self, "filter"), *given)
        )

    def unwind(self) -> str:
        """Subtract whole turns from the heading."""
        return self.c.status(self.c.function("noslip_ekf_unwind")(self.c.ffi.addressof(self.self, "filter")))

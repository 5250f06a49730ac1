"""The generated adaptation of a robot as an object: learns parameters that change from its motion and
inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ....codegen.adaptation.adaptation import NAME, adaptation_files
from ....codegen.files import dynamics_program, dynamics_text, shared_files, text_files
from ....codegen.identity import banner, fingerprint
from ....codegen.printing.scalar import SCALARS
from ....model.errors import ModelError
from ....model.reduction import ReducedSystem
from ....readers.errors import check_status, naming
from ..controller import Numbers
from .ekf import RobotPart, unpacked


@dataclass(frozen=True, kw_only=True)
class AdaptationOptions:
    """What the adaptation is told, as in noslip_adaptation.h, SI. `bounds`:
    least and most of each parameter that is learned."""

    bounds: Mapping[str, tuple[float, float]]
    noise: float
    sd: float = 0.3
    dead_zone: float = 0.0
    forgetting: float = 0.0
    window: float = 0.1
    rate: float = 0.1


@lru_cache(maxsize=16)
def adaptation_library(system: ReducedSystem, scalar: str, adapted: tuple[str, ...]) -> RobotPart:
    """Return the compiled adaptation, loaded once per process. Raises BadInput if these parameters cannot be
    learned."""
    in_c = SCALARS[scalar]
    with naming("", ModelError):
        files = adaptation_files(system, adapted, in_c, banner(fingerprint(system)))
    plant = text_files(dynamics_text(dynamics_program(system), in_c))
    return RobotPart(system, in_c, NAME, {**shared_files(system, in_c), **plant, **files})


class Adaptation:
    """One adaptation, initialized. Raises BadInput if init returns an error."""

    def __init__(
        self, system: ReducedSystem, parameters: Numbers, options: AdaptationOptions, scalar: str = "double"
    ):
        """`parameters` at first, in the order of mechanism.parameters."""
        c = self.c = adaptation_library(system, scalar, tuple(options.bounds))
        self._names = [q.in_c for q in system.mechanism.parameters]
        self.self = c.new(f"{c.robot}_adaptation")
        config = c.new(f"{c.robot}_adaptation_config")
        for name, value in zip(self._names, parameters, strict=True):
            setattr(config.params, name, float(value))
        for q in system.mechanism.parameters:
            if q.name in options.bounds:
                least, most = options.bounds[q.name]
                setattr(config, f"{q.in_c}_least", least)
                setattr(config, f"{q.in_c}_most", most)
        for name in vars(options).keys() - {"bounds"}:  # the others are named as in noslip_adaptation_options
            setattr(config.options, name, getattr(options, name))
        self._state, self._params = c.new(f"{c.robot}_state"), c.new(f"{c.robot}_params")
        self._members = [q.in_c for q in system.state]
        limits = (
            "each parameter must lie within its bounds, least below most; sd 1e-6 to 1, noise 1e-6 to "
            "1e6, rate positive"
        )
        check_status(
            c.status(c.of_robot("adaptation_init")(self.self, config)), "the adaptation's init", limits
        )

    @property
    def estimate(self) -> np.ndarray:
        """Estimates relative to their bounds, 0 to 1, in the order of `bounds`."""
        return np.array(list(self.self.core.estimate)[: self.self.core.count])

    @property
    def used(self) -> np.ndarray:
        """What is in use, alike."""
        return np.array(list(self.self.core.used)[: self.self.core.count])

    @property
    def covariance(self) -> np.ndarray:
        """P = U D U' of the relative estimates."""
        U, D = unpacked(self.self.core.factors, self.self.core.count)
        return (U * D) @ U.T

    def step(self, state: Numbers, tau: Numbers | None, dt: float) -> tuple[str, np.ndarray]:
        """Return status and the parameters to use, all of them,
        after dt (s) in which the inputs were tau; None: unknown."""
        for member, value in zip(self._members, state, strict=True):
            setattr(self._state, member, float(value))
        inputs = (
            self.c.ffi.NULL
            if tau is None
            else self.c.ffi.new(f"{self.c.scalar.real}[]", [float(v) for v in tau])
        )
        status = self.c.of_robot("adaptation_step")(self.self, self._state, inputs, dt, self._params)
        return self.c.status(status), np.array([getattr(self._params, name) for name in self._names])

"""Controllers with a common interface: CasADi's evaluation of the model, or the compiled C,
here or on an emulated processor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...readers.errors import BadInput, check_named
from . import SCALAR
from .controller import BACKENDS, ON_TARGET, Controller, Limits, Numbers, ParameterRefused
from .runtime import Runtime, runtime

if TYPE_CHECKING:
    from ...model.law import ControlLaw


def make_controller(
    backend: str,
    law: ControlLaw,
    params: Numbers,
    config: Numbers,
    gains: Numbers,
    limits: Limits | None = None,
) -> Controller:
    """Return a controller of `law`; params, config and gains in the order of law.parameters, law.config and
    law.gains.

    Raises BadInput for an unknown backend or `limits` that the law cannot have, ParameterRefused for an
    invalid number: the same in all backends.
    """
    check_named(backend, (*BACKENDS, *ON_TARGET), "unknown backend")
    check_parameters(law, params, config, gains)
    if limits is not None:
        limits.check(law)
    if backend == "casadi":
        from .symbolic import CasadiController

        return CasadiController(law, params, config, gains, limits)
    from .compiled import CompiledController

    if backend in ON_TARGET:
        from .pil import target_library

        return CompiledController(
            law, params, config, gains, limits=limits, made_by=target_library(law, backend)
        )
    return CompiledController(law, params, config, gains, SCALAR[backend], limits)


def check_parameters(law: ControlLaw, params: Numbers, config: Numbers, gains: Numbers) -> None:
    """Raise ParameterRefused if a value is not finite, has the wrong sign, or describes no valid path."""
    from ...model.errors import ModelError
    from .symbolic import condition_values

    groups = (
        ("parameter", law.parameters, params),
        ("output", law.config, config),
        ("gain", law.gains, gains),
    )
    try:
        for kind, quantities, values in groups:
            for quantity, value in zip(quantities, values, strict=True):
                quantity.check(value, kind)
    except ModelError as error:
        raise ParameterRefused(str(error)) from error
    for value, (_, meaning) in zip(condition_values(law, params, config), law.output.conditions, strict=True):
        if not value > 0:
            raise ParameterRefused(f"output {law.name}: {meaning}")


def runtime_of(backend: str, header: str, law: ControlLaw | None = None) -> tuple[Runtime, str]:
    """Return the C of a header as run by a backend, and its scalar: c in double, cf in float; m4f and rv32 in
    float on the processor that also runs `law`.

    Raises BadInput for another backend, and for m4f and rv32 without a law.
    """
    if backend in SCALAR:
        return runtime(header), SCALAR[backend]
    if backend in ON_TARGET and law is not None:
        from .pil import target_runtime

        return target_runtime(header, law, backend), "float"
    raise BadInput(
        f"unknown backend {backend!r}; known are {', '.join(BACKENDS)}, and with a law {', '.join(ON_TARGET)}"
    )

"""noslip: from the Lagrangian of a robot that rolls without slipping to the C of its controller.

The names below are the public interface for Python programs; docs/api.md describes them with an example:

    Mechanism -> reduce -> output_map -> linearize -> control_law -> generate, make_controller
    read_spec -> simulate;  analyse

Each is imported when it is first used, so that `import noslip` itself loads nothing else.
"""

# Type checkers take it as true; importing it from typing would take longer than all else here
TYPE_CHECKING = False
if TYPE_CHECKING:
    from .analysis.answers import analyse as analyse
    from .checks.verification.generate import generate as generate
    from .model.errors import ModelError as ModelError
    from .model.law import control_law as control_law
    from .model.linearization import linearize as linearize
    from .model.mechanism import Mechanism as Mechanism
    from .model.outputs import output_map as output_map
    from .model.reduction import reduce as reduce
    from .readers.errors import BadInput as BadInput
    from .readers.errors import Mismatch as Mismatch
    from .readers.robots import find_robot as find_robot
    from .simulation.closed_loop import simulate as simulate
    from .simulation.controllers.backends import make_controller as make_controller
    from .simulation.controllers.controller import Limits as Limits
    from .simulation.specification.spec import read_spec as read_spec

__version__ = "0.5.0"

_MODULES = {  # the module that defines each public name
    "BadInput": "readers.errors",
    "Limits": "simulation.controllers.controller",
    "Mechanism": "model.mechanism",
    "Mismatch": "readers.errors",
    "ModelError": "model.errors",
    "analyse": "analysis.answers",
    "control_law": "model.law",
    "find_robot": "readers.robots",
    "generate": "checks.verification.generate",
    "linearize": "model.linearization",
    "make_controller": "simulation.controllers.backends",
    "output_map": "model.outputs",
    "read_spec": "simulation.specification.spec",
    "reduce": "model.reduction",
    "simulate": "simulation.closed_loop",
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    """Import a public name when it is first used."""
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})

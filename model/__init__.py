"""The mathematical model, symbolic only: mechanism, reduction, output maps, linearization, control law.

Each step is one function with typed argument and result:

    Mechanism -> reduce -> ReducedSystem -> linearize(OutputMap) -> Linearization -> ControlLaw
"""

from .errors import ModelError
from .law import ControlLaw, control_law
from .linearization import Linearization, linearize
from .mechanism import Mechanism, Quantity
from .outputs import OutputMap, OutputRow
from .paths import config
from .reduction import ReducedSystem, reduce

__all__ = [
    "ControlLaw",
    "Linearization",
    "Mechanism",
    "ModelError",
    "OutputMap",
    "OutputRow",
    "Quantity",
    "ReducedSystem",
    "config",
    "control_law",
    "linearize",
    "reduce",
]

"""The mathematics, symbolic only: mechanism, reduction, output maps, linearization.

Each step is one function with a type on both ends:

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

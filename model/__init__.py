"""The mathematical model, symbolic only: mechanism, reduction, output maps, linearization, control law.

Each step is one function with typed argument and result:

    Mechanism -> reduce -> ReducedSystem -> linearize(OutputMap) -> Linearization -> ControlLaw
"""

import casadi

from .errors import ModelError
from .law import ControlLaw, control_law
from .linearization import Linearization, linearize
from .mechanism import Mechanism, Quantity
from .outputs import OutputMap, OutputRow
from .paths import config
from .reduction import ReducedSystem, reduce

# NumPy's functions of CasADi's values give what they gave before CasADi 3.8, without its warning.
if hasattr(casadi.GlobalOptions, "setNumpyMode"):
    casadi.GlobalOptions.setNumpyMode(-1)

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

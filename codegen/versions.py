"""The programs that determine the text of generated C."""

import casadi as ca

from .. import __version__
from ..readers.kept import version_of

TOOLS = f"noslip {__version__}, CasADi {ca.CasadiMeta.version()}, SymPy {version_of('sympy')}"

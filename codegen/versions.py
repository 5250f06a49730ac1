"""The programs that determine the text of generated C."""

from importlib.metadata import version

import casadi as ca

from .. import __version__

TOOLS = f"noslip {__version__}, CasADi {ca.CasadiMeta.version()}, SymPy {version('sympy')}"

"""The same laws as other tools write them. Each program computes tau from parameters, state and reference, with libm."""

import re
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import casadi as ca
import sympy
from noslip.model.algebra.expression import fold
from noslip.model.law import ControlLaw
from programs import ONCE, Program, arrays, flat
from sympy.codegen.ast import float32, real
from sympy.printing.c import C99CodePrinter

CAP = 60  # s that a tool may take for one law
GROUPS = ("params", "config", "gains", "state", "reference")


def casadi(law: ControlLaw, scalar: str, quantity: str) -> Program:
    """CasADi's own C, common subexpressions eliminated, exactly as it writes it."""
    arguments = [ca.vertcat(*[q.symbol for q in law.groups[group]]) for group in GROUPS]
    function = ca.Function("MEASURED", arguments, [ca.cse(ca.densify(law.tau))])
    generator = ca.CodeGenerator("law.c", {"casadi_real": scalar, "casadi_int": "int"})
    generator.add(function)
    declared = f"{ONCE} int MEASURED(const {scalar} **, {scalar} **, int *, {scalar} *, int);"
    call = f"const {scalar} *in[] = {{{', '.join(arrays(law))}}};\n        {scalar} *out[] = {{answer[i]}};\n"
    return flat(law, scalar, quantity, f"{declared}\n{generator.dump()}", f"{call}        MEASURED(in, out, 0, 0, 0);")


def casadi_single(law: ControlLaw, scalar: str, quantity: str) -> Program:
    """The same with sin, cos, sqrt and fabs of float replaced by hand."""
    made = casadi(law, scalar, quantity)
    return Program(made.law, made.quantity, re.sub(r"\b(sin|cos|sqrt|fabs)\(", r"\1f(", made.text))


def sympy_cse(law: ControlLaw, scalar: str, quantity: str) -> Program:
    """SymPy: cse over both torques, then the C99 printer."""
    symbols, tau = _translated(law, sympy)
    steps, results = sympy.cse(tau)
    printer = C99CodePrinter({"type_aliases": {real: float32}} if scalar == "float" else {})
    lines = [f"const {scalar} {name} = {printer.doprint(value)};" for name, value in steps]
    lines += [f"answer[{k}] = {printer.doprint(value)};" for k, value in enumerate(results)]
    return flat(law, scalar, quantity, f"#include <math.h>\n{_function(law, scalar, symbols, lines)}", _call(law))


def symforce(law: ControlLaw, scalar: str, quantity: str) -> Program:
    """SymForce's C++ for a function of scalars."""
    sf, codegen, Values = _symforce()
    symbols, tau = _translated(law, sf)
    names = [str(symbol) for symbol in symbols]
    inputs, outputs = Values(), Values()
    for name, symbol in zip(names, symbols, strict=True):
        inputs[name] = symbol
    for k, value in enumerate(tau):
        outputs[f"tau_{k}"] = value
    made = codegen.Codegen(inputs=inputs, outputs=outputs, name="law", config=codegen.CppConfig())
    with tempfile.TemporaryDirectory() as folder:
        (path,) = made.generate_function(output_dir=folder, skip_directory_nesting=True).generated_files
        header = Path(path).read_text()
    call = f"sym::Law<{scalar}>({', '.join(names)}, &answer[0], &answer[1]);"
    text = f'{header}\nextern "C" {_function(law, scalar, symbols, [call])}'
    return flat(law, scalar, quantity, text, _call(law), "c++")


def missing(tool: str) -> str:
    """Why a peer cannot be had; empty when it can."""
    if tool != "symforce":
        return ""
    try:
        _symforce()
    except ImportError as error:
        return f"{error.name or error} is not installed: pip install -r bench/requirements.txt"
    return ""


def capped(write: Callable[[], Program]) -> Program | None:
    """What `write` answers, or None when it takes longer than CAP seconds."""

    def stop(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(CAP)
    try:
        return write()
    except TimeoutError:
        return None
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _call(law: ControlLaw) -> str:
    return f"MEASURED({', '.join(arrays(law))}, answer[i]);"


def _symforce() -> tuple[ModuleType, ModuleType, type]:
    import symforce

    symforce.set_log_level("ERROR")  # its advice about epsilon: no expression here has one
    import symforce.symbolic as sf
    from symforce import codegen
    from symforce.values import Values

    return sf, codegen, Values


def _translated(law: ControlLaw, tool: ModuleType) -> tuple[list, list]:
    """The law's symbols and torques in another tool's expressions."""
    given = [q for group in GROUPS for q in law.groups[group]]
    symbols = [tool.Symbol(f"{group}_{q.name}") for group in GROUPS for q in law.groups[group]]

    def apply(code: int, arguments: tuple):
        return _OPERATION[code](tool, *arguments)

    whole = lambda value: tool.Integer(int(value)) if value == int(value) else tool.Float(value)  # noqa: E731
    entries = fold(law.tau, [q.symbol for q in given], lambda k: symbols[k], whole, apply)
    return symbols, list(entries)


def _function(law: ControlLaw, scalar: str, symbols: list, lines: list[str]) -> str:
    """A C function of the arrays that names their entries and runs the lines."""
    groups = [(group, k) for group in GROUPS for k in range(len(law.groups[group]))]
    named = [f"const {scalar} {symbol} = {group}[{k}];" for symbol, (group, k) in zip(symbols, groups, strict=True)]
    arguments = ", ".join([*(f"const {scalar} *{group}" for group in GROUPS), f"{scalar} *answer"])
    body = "\n    ".join([*named, *lines])
    return f"{ONCE} void MEASURED({arguments})\n{{\n    {body}\n}}"


_OPERATION = {
    ca.OP_ASSIGN: lambda t, a: a,
    ca.OP_ADD: lambda t, a, b: a + b,
    ca.OP_SUB: lambda t, a, b: a - b,
    ca.OP_MUL: lambda t, a, b: a * b,
    ca.OP_DIV: lambda t, a, b: a / b,
    ca.OP_NEG: lambda t, a: -a,
    ca.OP_SQ: lambda t, a: a**2,
    ca.OP_TWICE: lambda t, a: 2 * a,
    ca.OP_INV: lambda t, a: 1 / a,
    ca.OP_SQRT: lambda t, a: t.sqrt(a),
    ca.OP_SIN: lambda t, a: t.sin(a),
    ca.OP_COS: lambda t, a: t.cos(a),
    ca.OP_POW: lambda t, a, b: a**b,
    ca.OP_CONSTPOW: lambda t, a, b: a**b,
}

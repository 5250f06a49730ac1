"""Known functions of time in a SPEC, [given]: expressions in t, as CasADi has them,
with their derivatives."""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ...model.algebra.portable import portable
from ...model.mechanism import Mechanism
from ...readers.errors import BadInput
from ...readers.quantities import LARGEST, QUANTITY
from ...readers.reading import check_keys, number, reads, table

Given = tuple[tuple[str, str | float], ...]  # name -> expression in t or constant, hashable

FUNCTIONS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "sqrt": ca.sqrt,
}
OPERATIONS: dict[type[ast.AST], Callable[..., ca.SX]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
MOST_POWER = 16
LONGEST, DEEPEST = 1000, 50  # characters of an expression, and its nesting
CHECKED = 1001  # times of a run at which functions are found to be finite
USABLE = f"use t, numbers, pi, + - * /, whole powers ** up to {MOST_POWER}, {', '.join(FUNCTIONS)}"


OF_TIME = {
    "anyOf": [*number().schema()["anyOf"], {"type": "string", "examples": ["0.4 + 0.1*sin(2*pi*t/5)"]}],
    "description": f"a number, or an expression in t (s), in SI units: {USABLE}",
}


@reads({"type": "object", "additionalProperties": OF_TIME})
def functions_of_time(value: Any, where: str) -> dict[str, str | float]:
    """Read a table of numbers and texts of expressions in t by name. The robot checks the names and, of
    Measured numbers, the units.
    """
    return {name: _function_of_time(item, f"[given] {name}") for name, item in table(value, where).items()}


def _function_of_time(value: Any, where: str) -> str | float:
    if not isinstance(value, str) or re.fullmatch(QUANTITY, value):
        return number()(value, where)
    expression(value, ca.SX.sym("t"), where)
    return value


def expression(text: str | float, t: ca.SX, where: str) -> ca.SX:
    """Return the expression of a text, with `t` (s) in it. Raises BadInput for anything but USABLE."""
    shown = f"{where} = {text!r}" if len(str(text)) <= 60 else f"{where} = '{str(text)[:57]}...'"

    def made(node: ast.AST, depth: int = 0) -> ca.SX:
        if depth > DEEPEST:
            raise BadInput(f"{shown} is nested more than {DEEPEST} deep")
        match node:
            case ast.Constant(value=int() | float() as value) if (
                not isinstance(value, bool) and abs(value) <= LARGEST
            ):
                return ca.SX(float(value))
            case ast.Name(id="t"):
                return t
            case ast.Name(id="pi"):
                return ca.SX(math.pi)
            case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int(power))) if (
                0 <= power <= MOST_POWER
            ):
                return made(base, depth + 1) ** power
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](made(left, depth + 1), made(right, depth + 1))
            case ast.UnaryOp(op=op, operand=operand) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](made(operand, depth + 1))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
                return FUNCTIONS[name](made(argument, depth + 1))
        raise BadInput(f"{shown}: {ast.unparse(node)!r} is not understood; {USABLE}")

    if len(str(text)) > LONGEST:
        raise BadInput(f"{shown} has more than {LONGEST} characters")
    try:
        return made(ast.parse(str(text).strip(), mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BadInput(f"{shown} is not an expression in t; {USABLE}") from error


def accelerations(mechanism: Mechanism, given: Given, t: ca.SX) -> ca.SX:
    """Return the second derivatives of known functions at the places of their rates among the coordinates,
    zeros elsewhere."""
    names, made = [c.name for c in mechanism.coordinates], ca.SX.zeros(len(mechanism.coordinates))
    for name, text in given:
        made[names.index(f"{name}_rate")] = ca.jacobian(ca.jacobian(expression(text, t, name), t), t)
    return made


@lru_cache(maxsize=16)
def _at(given: Given) -> ca.Function:
    """Return the function from t (s) to the values, the rates and the second derivatives of known functions,
    a column each."""
    t = ca.SX.sym("t")
    columns = [ca.vertcat(*[expression(text, t, name) for name, text in given])]
    for _ in range(2):
        columns.append(ca.jacobian(columns[-1], t))
    return portable(ca.Function("given", [t], [ca.densify(ca.horzcat(*columns))]))


def at_start(mechanism: Mechanism, given: Given) -> dict[int, float]:
    """Return the values at t = 0 of the coordinates that are known functions or their rates,
    by their places."""
    names, found = [c.name for c in mechanism.coordinates], _at(given)(0.0).full() if given else []
    made: dict[int, float] = {}
    for (name, _), (value, rate, _) in zip(given, found, strict=True):
        made |= {names.index(name): float(value), names.index(f"{name}_rate"): float(rate)}
    return made


def known_functions(mechanism: Mechanism, given: Mapping[str, str | float], duration: float) -> Given:
    """Return the known functions of a SPEC, hashable. Raises BadInput for a name that the robot does not have
    as `given`, and for a function that is not finite during the run.
    """
    if given and not mechanism.givens:
        raise BadInput(
            f"[given]: {mechanism.name} has nothing that is given; a robot file declares it: "
            "robot.given(NAME, UNIT)"
        )
    check_keys(given, mechanism.givens, "[given]")
    made = tuple(given.items())
    for t in np.linspace(0.0, duration, CHECKED) if made else ():
        for (name, text), row in zip(made, _at(made)(t).full(), strict=True):
            if not np.abs(row).max() <= LARGEST:  # also where it is NaN
                raise BadInput(
                    f"[given] {name} = {text!r}: it or one of its first two derivatives is not finite at t = "
                    f"{t:g} s"
                )
    return made

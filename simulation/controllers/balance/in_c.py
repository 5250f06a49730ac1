"""State feedback as C: a header with the gains of an LQR for noslip_balance.h, compiled and compared."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ....codegen.printing.layout import WIDTH, aside, fill, guard_name
from ....codegen.printing.scalar import SCALARS, Scalar
from ....readers.errors import check_status
from ..runtime import InC, declarations, knowing, load
from .feedback import Balanced

HEADER = "noslip_balance.h"
STATES, SEED, FAR = 200, 0, 2.0  # of a comparison; largest deviation of its states, SI: some have fallen
ROUNDING = {"double": 1e-12, "float": 1e-5}  # relative to the largest input


def header(balanced: Balanced, about: str) -> str:
    """Return the text of ROBOT_lqr.h, for both scalars; `about` says how it was made, on one line."""
    name, system = f"{balanced.name}_lqr", balanced.steady.partial.system
    upper, guard = name.upper(), guard_name(f"{name}.h")
    states = ", ".join(f"{q.name} ({q.unit})" for q in system.state)
    inputs = ", ".join(f"{q.name} ({q.unit})" for q in system.mechanism.inputs)
    sizes = f"{upper}_STATES = {len(system.state)}, {upper}_INPUTS = {len(system.mechanism.inputs)}"
    lines = [
        f"/* {name}.h - {about} */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        f'#include "{HEADER}"',
        "",
        *aside(f"The state is {states}; the inputs are {inputs}.", WIDTH),
        f"enum {{ {sizes} }};",
        "",
        *[line for scalar in SCALARS.values() for line in _init(balanced, name, scalar)],
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _init(balanced: Balanced, name: str, scalar: Scalar) -> list[str]:
    """Return the function that initializes the feedback in one scalar."""
    tables: dict[str, Sequence[float] | np.ndarray] = {
        "K": balanced.K.ravel(),
        "rest": balanced.steady.tau,
        "limit": balanced.limits,
        "fallen": balanced.fallen,
    }
    place = balanced.steady.place or (0, 0, -1)
    own = scalar.name
    return [
        "/* Initializes; returns the status of noslip_balance_init. */",
        f"NOSLIP_NODISCARD static inline int {own(f'{name}_init')}({own('noslip_balance')} *self)",
        "{",
        *[line for table, values in tables.items() for line in _table(scalar, table, values)],
        f"    {own('noslip_balance_options')} options;",
        f"    options.states = {len(balanced.steady.names)};",
        f"    options.inputs = {len(balanced.K)};",
        *[f"    options.{table} = {table};" for table in tables],
        *[
            f"    options.{field} = {number};"
            for field, number in zip(("x", "y", "heading"), place, strict=True)
        ],
        f"    return {own('noslip_balance_init')}(self, &options);",
        "}",
        "",
    ]


def _table(scalar: Scalar, name: str, values: Sequence[float] | np.ndarray) -> list[str]:
    text = ", ".join(scalar.literal(float(value)) for value in values)
    return fill(f"static const {scalar.real} {name}[{len(values)}] = {{{text}}};", "    ")


DECLARED = """
int {make}({type} *self);
int {give}(const {type} *self, const {real} *state, const {real} *desired, {real} *tau);
"""
DEFINED = """#include "{name}.h"
{declared}
int {make}({type} *self)
{{
    return {init}(self);
}}

int {give}(const {type} *self, const {real} *state, const {real} *desired, {real} *tau)
{{
    return {step}(self, state, desired, tau);
}}
"""


def _words(balanced: Balanced, scalar: Scalar) -> dict[str, str]:
    """Return the names in DECLARED and DEFINED."""
    name = f"{balanced.name}_lqr"
    own = {word: scalar.name(f"{name}_{word}") for word in ("make", "give", "init")}
    runtime = {
        "type": scalar.name("noslip_balance"),
        "step": scalar.name("noslip_balance_step"),
        "real": scalar.real,
    }
    return {"name": name, **own, **runtime}


def declared(balanced: Balanced, scalar: Scalar) -> str:
    """Return the declarations of NAME_make and NAME_give, which call init and step of a feedback,
    in one scalar."""
    return DECLARED.format(**_words(balanced, scalar))


def callable_files(balanced: Balanced, scalars: Sequence[Scalar]) -> dict[str, str]:
    """Return the header of a feedback, and a source with these functions for each scalar, by file name."""
    name = f"{balanced.name}_lqr"
    sources = {
        f"{scalar.name(name)}.c": DEFINED.format(
            declared=declared(balanced, scalar), **_words(balanced, scalar)
        )
        for scalar in scalars
    }
    return {f"{name}.h": header(balanced, "compiled to be called"), **sources}


class BalanceInC(InC):
    """The header of a feedback, compiled in one scalar. Raises BadInput without a C compiler."""

    def __init__(self, balanced: Balanced, scalar: str = "double"):
        own = SCALARS[scalar]
        self.ffi = knowing(declarations(HEADER) + declared(balanced, own))
        self.lib = load(self.ffi, callable_files(balanced, [own]))
        make, self._give = (
            getattr(self.lib, own.name(f"{balanced.name}_lqr_{word}")) for word in ("make", "give")
        )
        self._self = self.ffi.new(f"{own.name('noslip_balance')} *")
        check_status(self.status(make(self._self)), f"{balanced.name}_lqr: init")
        sizes = len(balanced.steady.names), len(balanced.steady.names), len(balanced.K)
        self._arrays = [self.ffi.new(f"{own.real}[]", size) for size in sizes]

    @cached_property
    def _numbers(self) -> list[np.ndarray]:
        return [
            np.frombuffer(self.ffi.buffer(array), f"f{self.ffi.sizeof(array) // len(array)}")
            for array in self._arrays
        ]

    def step(self, state: np.ndarray, desired: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and inputs, N or N m."""
        for numbers, values in zip(self._numbers, (state, desired), strict=False):
            numbers[:] = values
        status = self.status(self._give(self._self, *self._arrays))
        return status, self._numbers[2].astype(float)


def differences(balanced: Balanced) -> dict[str, float]:
    """Return by scalar the largest difference between the C and `Balanced.step` at random states, relative to
    the largest input; infinite where a status differs.
    """
    random = np.random.default_rng(SEED)
    size = (STATES, len(balanced.steady.names))
    states, desired = (
        random.uniform(-FAR, FAR, size),
        random.uniform(-FAR, FAR, size) * (random.uniform(size=(STATES, 1)) < 0.5),
    )
    near = states * random.uniform(size=(STATES, 1)) ** 3 + desired
    expected = [balanced.step(x, x_d) for x, x_d in zip(near, desired, strict=True)]
    largest = max(float(np.abs(tau).max()) for _, tau in expected)
    found = {}
    for scalar in SCALARS:
        c = BalanceInC(balanced, scalar)
        pairs = [(c.step(x, x_d), other) for x, x_d, other in zip(near, desired, expected, strict=True)]
        same = all(one[0] == other[0] for one, other in pairs)
        found[scalar] = (
            max(float(np.abs(one[1] - other[1]).max()) for one, other in pairs) / largest if same else np.inf
        )
    return found

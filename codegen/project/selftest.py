"""A C program that calls laws on the target and compares the results with the model,
then their bits with those of the host."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model.law import ControlLaw
from ...readers.templates import render
from ..derivation.grip import can_grip
from ..files import law_program
from ..printing.law_c import FRICTION
from ..printing.scalar import Scalar
from ..program import FOLLOW, SLOPE
from ..targets import BOARDS

# Scalar, bits, hexadecimal digits
BITS = {"float": (np.float32, np.uint32, 8), "double": (np.float64, np.uint64, 16)}


def headers() -> dict[str, str]:
    """Return the headers of the programs that test firmware, those of firmware/selftest:
    file name -> text."""
    return {
        path.name: path.read_text(encoding="utf-8")
        for path in sorted((BOARDS.parent / "selftest").glob("*.h"))
    }


Numbers = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class ExpectedStep:
    """A call of the step of a law: state (with that of a dynamic extension), reference, expected status and
    tau, in SI units and in the order of the law's groups.

    `within` is the permitted error of each entry of tau.
    """

    state: Numbers
    reference: Numbers
    status: int
    tau: Numbers
    within: float


@dataclass(frozen=True)
class Golden:
    """A law with params, config, gains and limits (0: none), steps with the results of the model, and the
    `digest` of the bits that the C returned on the host."""

    law: ControlLaw
    params: Numbers
    config: Numbers
    gains: Numbers
    steps: Sequence[ExpectedStep]
    limits: Numbers
    digest: int


OFFSET_BASIS, PRIME = 2166136261, 16777619  # of the hash FNV-1a


def digest(answers: Iterable[tuple[int, Numbers]], scalar: Scalar) -> int:
    """Return a 32-bit digest of status and bits of tau of all steps, as the C of `selftest` computes it."""
    real, _, _ = BITS[scalar.real]
    found = OFFSET_BASIS
    for status, tau in answers:
        for word in (status & 0xFFFFFFFF, *np.array(tau, real).view("<u4").tolist()):
            found = (found ^ word) * PRIME & 0xFFFFFFFF
    return found


def slows(law: ControlLaw) -> bool:
    """Whether the step of the law can reduce the speed at a limit; the self-test then uses this mode,
    else each input is cut."""
    return SLOPE in law_program(law).entries


def digests(golden: Sequence[Golden], scalar: Scalar) -> list[str]:
    """Names of the functions in selftest.c that return a digest (uint32_t): the route,
    then each law's `follow` along it."""
    return [
        "route_digest",
        *(f"follow_{_name(g, scalar)}" for g in golden if FOLLOW in law_program(g.law).entries),
    ]


def selftest(golden: Sequence[Golden], scalar: Scalar, expected: Mapping[str, int] | None = None) -> str:
    """Text of selftest.c, valid in C99 and C++11.

    Its main prints a line for each part and returns the number of failed parts, at most 100: the steps of
    each law, then each of `digests`, whose values are compared with `expected` (0 where missing).
    """
    digested = [
        (name, _said(name), f"{(expected or {}).get(name, 0):08x}") for name in digests(golden, scalar)
    ]
    return render(
        __file__,
        "selftest.c",
        laws=[_law(each, scalar) for each in golden],
        digests=digested,
        own=scalar.name,
        real=scalar.real,
        suffix=scalar.suffix,
        prime=PRIME,
        offset_basis=OFFSET_BASIS,
    )


def _law(golden: Golden, scalar: Scalar) -> dict[str, object]:
    """Return the values of the template for a law; its constants and steps as C,
    without the outermost braces."""
    law = golden.law
    return {
        "name": _name(golden, scalar),
        "robot": law.system.mechanism.name,
        "prefix": f"{law.system.mechanism.name}_{law.name}",
        "about": law.output.about,
        "slows": slows(law),
        "follows": FOLLOW in law_program(law).entries,
        "state": len(law.system.state),
        "extension": len(law.extension),
        "reference": len(law.reference),
        "inputs": len(law.inputs),
        "params": _numbers(golden.params, scalar) or "0",
        "config": _numbers(golden.config, scalar) or "0",
        "gains": _numbers(golden.gains, scalar) or "0",
        "limits": _numbers(golden.limits, scalar),
        # A compiler of C++ warns of members that are left out.
        "friction": f", .friction = {{{', '.join('0' for _ in FRICTION.split())}}}"
        if can_grip(law.system)
        else "",
        "zeros": _numbers([0.0] * len(law.reference), scalar),
        "digest": f"{golden.digest:08x}",
        "rows": [
            f"{{{_groups(s, law, scalar)}, {{{_numbers(s.tau, scalar)}}}, {_numbers([s.within], scalar)}, "
            f"{s.status}}}"
            for s in golden.steps
        ],
        "states": [_numbers(s.state, scalar) for s in golden.steps if np.all(np.isfinite(s.state))],
    }


def _groups(step: ExpectedStep, law: ControlLaw, scalar: Scalar) -> str:
    """Return the bits of the state, of the states of the dynamic extension if there are any,
    and of the reference."""
    own = len(law.system.state)
    groups = [step.state[:own], *([step.state[own:]] if law.extension else []), step.reference]
    return ", ".join(f"{{{_bits(group, scalar)}}}" for group in groups)


def _numbers(values: Iterable[float], scalar: Scalar) -> str:
    return ", ".join(scalar.literal(float(value)) for value in values)


def _said(digest: str) -> str:
    """Return the printed name of a function of `digests`."""
    return "route" if digest == "route_digest" else f"{digest.removeprefix('follow_')}, follow"


def _name(golden: Golden, scalar: Scalar) -> str:
    return scalar.name(f"{golden.law.system.mechanism.name}_{golden.law.name}")


def _bits(values: Iterable[float], scalar: Scalar) -> str:
    """Return the bits of the numbers, rounded to the scalar, as C; 0 if there are none."""
    real, whole, digits = BITS[scalar.real]
    with np.errstate(over="ignore"):
        numbers = np.array(values, real).view(whole)
    suffix = "u" if scalar.real == "float" else "ull"
    return ", ".join(f"0x{int(n):0{digits}x}{suffix}" for n in numbers) or f"0{suffix}"

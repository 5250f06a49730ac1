"""A program in C that steps laws on the target and compares what they return with the model, then their bits with those here."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model.law import ControlLaw
from ..files import law_program
from ..printing.layout import comment
from ..printing.scalar import Scalar

BITS = {"float": (np.float32, np.uint32, 8), "double": (np.float64, np.uint64, 16)}  # scalar, bits, hexadecimal digits


Numbers = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Step:
    """One call of a law's step: state and reference in, status and inputs tau out; SI, in the order of the law's groups.

    Each entry of tau may be off by `within`.
    """

    state: Numbers
    reference: Numbers
    status: int
    tau: Numbers
    within: float


@dataclass(frozen=True)
class Golden:
    """A law made from params, config, gains and limits (0: none), steps of it with what the model says, and `digest` of the bits
    that the C returned."""

    law: ControlLaw
    params: Numbers
    config: Numbers
    gains: Numbers
    steps: Sequence[Step]
    limits: Numbers
    digest: int


OFFSET_BASIS, PRIME = 2166136261, 16777619  # of the hash FNV-1a


def digest(answers: Iterable[tuple[int, Numbers]], scalar: Scalar) -> int:
    """32 bits that stand for status and bits of tau, step by step; as the C of `selftest` makes them."""
    real, _, _ = BITS[scalar.real]
    found = OFFSET_BASIS
    for status, tau in answers:
        for word in (status & 0xFFFFFFFF, *np.array(tau, real).view("<u4").tolist()):
            found = (found ^ word) * PRIME & 0xFFFFFFFF
    return found


def slows(law: ControlLaw) -> bool:
    """Can the law's step give up speed at a limit? Then the self-test has it do so, else each input is cut."""
    return "slope" in _entries(law)


def digests(golden: Sequence[Golden], scalar: Scalar) -> list[str]:
    """Names of the functions in selftest.c that return a digest (uint32_t): the route, then each law's `follow` along it."""
    return ["route_digest", *(f"follow_{_name(g, scalar)}" for g in golden if "follow" in _entries(g.law))]


def selftest(golden: Sequence[Golden], scalar: Scalar, expected: Mapping[str, int] | None = None) -> str:
    """Text of selftest.c, valid in C99 and C++11.

    Its main returns how many parts failed, at most 100, after a line for each on the console: the steps of each law, then each
    of `digests`, whose values have to be the `expected` ones (0 where there is none).
    """
    expected = expected or {}
    names, digested = [_name(g, scalar) for g in golden], digests(golden, scalar)
    about = [
        "selftest.c - does this processor, with this compiler and these flags, compute what the model says, and the bits that",
        "were computed where this was written? Steps every law at some states, wrong ones among them. Compares status and inputs",
        "with the model's, found in extended precision and rounded: `within` is how far off tau may be. Then compares a digest",
        "(FNV-1a) of all their bits with that of the C where this was written, and leads a vehicle along a path (route.h).",
        "Compile it with the flags, and in the dialect, of the files that use the headers: what is inline there is tested here.",
        "Tells what a step costs, where something counts: see stopwatch.h.",
    ]
    return "\n".join(
        [
            comment(about),
            '#include "console.h"',
            '#include "stopwatch.h"',
            *(f'#include "{name}.h"' for name in names),
            "",
            f"#define REAL {scalar.real}",
            f"#define OF(name) name{'##' + scalar.suffix if scalar.suffix else ''}",
            '#include "route.h"',
            "",
            f"typedef {'uint32_t' if scalar.real == 'float' else 'uint64_t'} bits;",
            "",
            "#define REPEAT 1000u /* steps that are timed */",
            "",
            *_mix(scalar),
            "",
            *(_law(g, name, scalar) for g, name in zip(golden, names, strict=True)),
            *(_follow(g, name, scalar) for g, name in zip(golden, names, strict=True) if f"follow_{name}" in digested),
            _compare(),
            _main(names, {name: expected.get(name, 0) for name in digested}),
        ]
    )


def _law(golden: Golden, name: str, scalar: Scalar) -> str:
    law, own = golden.law, scalar.name
    robot = law.system.mechanism.name
    state, reference, inputs = len(law.state), len(law.reference), len(law.system.mechanism.inputs)
    rows = [
        f"        {{{{{_bits(s.state, scalar)}}}, {{{_bits(s.reference, scalar)}}}, {{{_numbers(s.tau, scalar)}}}, "
        f"{_numbers([s.within], scalar)}, {s.status}}},"
        for s in golden.steps
    ]
    init = own(f"{robot}_{law.name}_init")
    step = f"{own(f'{robot}_{law.name}_step')}(&law, &state.value, &reference.value, tau.value)"
    return "\n".join(
        [
            f"/* {law.output.about}. Answers 0 if all is right. */",
            f"static int test_{name}(void)",
            "{",
            *_structs(golden, scalar),
            "    static const struct {",
            f"        bits state[{state}], reference[{reference}];",
            f"        {scalar.real} tau[{inputs}], within;",
            "        int status;",
            "    } steps[] = {",
            *rows,
            "    };",
            "    const unsigned count = sizeof steps / sizeof steps[0];",
            "    union {",
            f"        bits given[{state}];",
            f"        {own(f'{robot}_state')} value;",
            "    } state;",
            "    union {",
            f"        bits given[{reference}];",
            f"        {own(f'{robot}_{law.name}_reference')} value;",
            "    } reference;",
            "    union {",
            f"        {scalar.real} value[{inputs}];",
            f"        bits made[{inputs}];",
            "    } tau;",
            f"    {name} law;",
            f"    uint32_t cost, digest = {OFFSET_BASIS}u;",
            "    unsigned k, i;",
            f"    int wrong = {init}(&law, &params, &config, &gains, &options) != NOSLIP_OK;",
            "",
            "    for (k = 0; k < count && !wrong; k++) {",
            f"        for (i = 0; i < {state}u; i++) {{",
            "            state.given[i] = steps[k].state[i];",
            "        }",
            f"        for (i = 0; i < {reference}u; i++) {{",
            "            reference.given[i] = steps[k].reference[i];",
            "        }",
            f"        const int status = {step};",
            "        wrong = status != steps[k].status;",
            "        digest = mixed(digest, (uint32_t)status);",
            f"        for (i = 0; i < {inputs}u; i++) {{",
            f"            const {scalar.real} off = tau.value[i] - steps[k].tau[i];",
            "            wrong = wrong || !(off <= steps[k].within && -off <= steps[k].within);",
            "            digest = mixed_bits(digest, tau.made[i]);",
            "        }",
            "    }",
            f'    say("{name}: ");',
            "    if (wrong) {",
            '        say("FAIL at step ");',
            "        say_number(k);",
            '        say(", which is not the model");',
            f"    }} else if (digest != 0x{golden.digest:08x}u) {{",
            "        wrong = 1;",
            '        say("FAIL, the model, but with other bits than where this was written");',
            "    } else {",
            '        say("pass, steps ");',
            "        say_number(count);",
            f"        for (i = 0; i < {state}u; i++) {{",
            "            state.given[i] = steps[0].state[i];",
            "        }",
            f"        for (i = 0; i < {reference}u; i++) {{",
            "            reference.given[i] = steps[0].reference[i];",
            "        }",
            f"        (void){init}(&law, &params, &config, &gains, NULL); /* no limits: it counts a step that is good */",
            "        cost = stopwatch_read();",
            "        for (k = 0; k < REPEAT; k++) {",
            f"            (void){step};",
            "        }",
            "        cost = stopwatch_since(cost);",
            "        if (cost > 0) {",
            '            say(", " STOPWATCH_COUNTS " of one ");',
            "            say_number(cost / REPEAT);",
            "        }",
            "    }",
            '    say("\\n");',
            "    return wrong;",
            "}",
            "",
        ]
    )


def _structs(golden: Golden, scalar: Scalar) -> list[str]:
    """What a law is made from, as constants in C."""
    law, own = golden.law, scalar.name
    robot = law.system.mechanism.name

    def literals(values: Iterable[float]) -> str:
        return ", ".join(scalar.literal(float(v)) for v in values)

    mode = "NOSLIP_SLOW" if slows(law) else "NOSLIP_CUT"
    rows = (
        (own(f"{robot}_params"), "params", literals(golden.params) or "0"),
        (own(f"{robot}_{law.name}_config"), "config", literals(golden.config) or "0"),
        (own(f"{robot}_{law.name}_gains"), "gains", literals(golden.gains) or "0"),
        (own(f"{robot}_options"), "options", f"{{{literals(golden.limits)}}}, NOSLIP_ZERO, {mode}"),
    )
    return [f"    static const {kind} {called} = {{{values}}};" for kind, called, values in rows]


def _follow(golden: Golden, name: str, scalar: Scalar) -> str:
    """The digest of what a law's `follow` returns along the route, at the vehicle's velocities of the golden steps."""
    law, own = golden.law, scalar.name
    robot, inputs = law.system.mechanism.name, len(law.system.mechanism.inputs)
    states = [s.state for s in golden.steps if np.all(np.isfinite(s.state))]
    count, zeros = len(states), ", ".join([scalar.literal(0.0)] * len(law.reference))
    state = ", ".join(f"given[tick % {count}u][{k}]" for k in range(len(law.state)))
    rows = [f"        {{{', '.join(scalar.literal(float(v)) for v in row)}}}," for row in states]
    return "\n".join(
        [
            f"static uint32_t follow_{name}(void)",
            "{",
            *_structs(golden, scalar),
            f"    static const {scalar.real} given[{count}][{len(law.state)}] = {{",
            *rows,
            "    };",
            f"    {own(f'{robot}_{law.name}_reference')} reference = {{{zeros}}};",
            f"    {name} law;",
            "    route on;",
            "    unsigned tick;",
            f"    uint32_t digest = (uint32_t){own(f'{robot}_{law.name}_init')}(&law, &params, &config, &gains, &options);",
            "    route_begin(&on);",
            "    for (tick = 0; tick < ROUTE_TICKS; tick++) {",
            f"        const {own(f'{robot}_state')} state = {{{state}}};",
            f"        {scalar.real} tau[{inputs}];",
            "        int status;",
            "        route_tick(&on, tick);",
            "        reference.speed = on.path.guide.speed;",
            f"        status = {own(f'{robot}_{law.name}_follow')}(&law, &on.path.guide.foot, &state, &reference, tau);",
            f"        digest = digest_word(digest_reals(digest, tau, {inputs}), (uint32_t)status);",
            "    }",
            "    return digest;",
            "}",
            "",
        ]
    )


def _compare() -> str:
    return "\n".join(
        [
            "/* Returns 0 if a digest is the expected one. */",
            "static int compare(const char *name, uint32_t digest, uint32_t expected)",
            "{",
            "    say(name);",
            '    say(digest == expected ? ": pass\\n" : ": FAIL\\n");',
            "    return digest != expected;",
            "}",
            "",
        ]
    )


def _main(names: Sequence[str], expected: Mapping[str, int]) -> str:
    return "\n".join(
        [
            "int main(void)",
            "{",
            "    int wrong = 0;",
            *(f"    wrong += test_{name}();" for name in names),
            *(f'    wrong += compare("{_said(name)}", {name}(), 0x{value:08x}u);' for name, value in expected.items()),
            '    say(wrong == 0 ? "selftest: pass\\n" : "selftest: FAIL\\n");',
            "    return wrong < 100 ? wrong : 100;",
            "}",
            "",
        ]
    )


def _mix(scalar: Scalar) -> list[str]:
    """The digest of a word, and of a scalar's bits."""
    parts = "digest, value" if scalar.real == "float" else "mixed(digest, (uint32_t)value), (uint32_t)(value >> 32)"
    return [
        "static uint32_t mixed(uint32_t digest, uint32_t word)",
        "{",
        f"    return (digest ^ word) * {PRIME}u;",
        "}",
        "",
        "static uint32_t mixed_bits(uint32_t digest, bits value)",
        "{",
        f"    return mixed({parts});",
        "}",
    ]


def _numbers(values: Iterable[float], scalar: Scalar) -> str:
    return ", ".join(scalar.literal(float(value)) for value in values)


def _said(digest: str) -> str:
    """What is printed for a function of `digests`."""
    return "route" if digest == "route_digest" else f"{digest.removeprefix('follow_')}, follow"


def _name(golden: Golden, scalar: Scalar) -> str:
    return scalar.name(f"{golden.law.system.mechanism.name}_{golden.law.name}")


def _entries(law: ControlLaw) -> set[str]:
    return {entry.name for entry in law_program(law).entries}


def _bits(values: Iterable[float], scalar: Scalar) -> str:
    """The numbers' bits in C, rounded to the scalar first; 0 where there are none."""
    real, whole, digits = BITS[scalar.real]
    with np.errstate(over="ignore"):
        numbers = np.array(values, real).view(whole)
    suffix = "u" if scalar.real == "float" else "ull"
    return ", ".join(f"0x{int(n):0{digits}x}{suffix}" for n in numbers) or f"0{suffix}"

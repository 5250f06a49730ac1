"""A program in C that steps laws and compares the bits of what they answer with golden ones: pass or fail, on the target."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.law import ControlLaw
from .layout import comment
from .scalar import Scalar

BITS = {"float": (np.float32, np.uint32, 8), "double": (np.float64, np.uint64, 16)}  # scalar, bits, hexadecimal digits


@dataclass(frozen=True)
class Step:
    """One call of a law's step: state and reference in, status and inputs tau out; SI, in the order of the law's groups."""

    state: Sequence[float]
    reference: Sequence[float]
    status: int
    tau: Sequence[float]


@dataclass(frozen=True)
class Golden:
    """A law made from params, config and gains, and steps of it with the answers that were right elsewhere."""

    law: ControlLaw
    params: Sequence[float]
    config: Sequence[float]
    gains: Sequence[float]
    steps: Sequence[Step]


def selftest(golden: Sequence[Golden], scalar: Scalar) -> str:
    """Text of selftest.c: main answers how many laws failed, at most 100, after a line for each on the console."""
    names = [scalar.name(f"{g.law.system.mechanism.name}_{g.law.name}") for g in golden]
    about = [
        "selftest.c - does this processor, with this compiler and these flags, compute the bits that were computed where this",
        "was written? Steps every law at some states, wrong ones among them, and compares status and inputs bit for bit.",
        "Then tells what a step costs, where something counts: see stopwatch.h.",
    ]
    return "\n".join(
        [
            comment(about),
            '#include "console.h"',
            '#include "stopwatch.h"',
            *(f'#include "{name}.h"' for name in names),
            "",
            f"typedef {'uint32_t' if scalar.real == 'float' else 'uint64_t'} bits;",
            "",
            "#define REPEAT 1000u /* steps that are timed */",
            "",
            *(_law(g, name, scalar) for g, name in zip(golden, names, strict=True)),
            _main(names),
        ]
    )


def _law(golden: Golden, name: str, scalar: Scalar) -> str:
    law, own = golden.law, scalar.name
    robot = law.system.mechanism.name
    state, reference, inputs = len(law.state), len(law.reference), len(law.system.mechanism.inputs)
    structs = [
        f"    static const {kind} {called} = {{{', '.join(scalar.literal(float(v)) for v in values) or '0'}}};"
        for kind, called, values in (
            (own(f"{robot}_params"), "params", golden.params),
            (own(f"{robot}_{law.name}_config"), "config", golden.config),
            (own(f"{robot}_{law.name}_gains"), "gains", golden.gains),
        )
    ]
    rows = [
        f"        {{{{{_bits(s.state, scalar)}}}, {{{_bits(s.reference, scalar)}}}, {{{_bits(s.tau, scalar)}}}, {s.status}}},"
        for s in golden.steps
    ]
    make = f"{own(f'{robot}_{law.name}_init')}(&law, &params, &config, &gains, NULL)"
    step = f"{own(f'{robot}_{law.name}_step')}(&law, &state.value, &reference.value, tau.value)"
    return "\n".join(
        [
            f"/* {law.output.about}. Answers 0 if all is right. */",
            f"static int test_{name}(void)",
            "{",
            *structs,
            "    static const struct {",
            f"        bits state[{state}], reference[{reference}], tau[{inputs}];",
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
            "    uint32_t cost;",
            "    unsigned k, i;",
            f"    int wrong = {make} != NOSLIP_OK;",
            "",
            "    for (k = 0; k < count && !wrong; k++) {",
            f"        for (i = 0; i < {state}u; i++) {{",
            "            state.given[i] = steps[k].state[i];",
            "        }",
            f"        for (i = 0; i < {reference}u; i++) {{",
            "            reference.given[i] = steps[k].reference[i];",
            "        }",
            f"        wrong = {step} != steps[k].status;",
            f"        for (i = 0; i < {inputs}u; i++) {{",
            "            wrong = wrong || tau.made[i] != steps[k].tau[i];",
            "        }",
            "    }",
            f'    say("{name}: ");',
            "    if (wrong) {",
            '        say("FAIL at step ");',
            "        say_number(k);",
            "    } else {",
            '        say("pass, steps ");',
            "        say_number(count);",
            f"        for (i = 0; i < {state}u; i++) {{",
            "            state.given[i] = steps[0].state[i];",
            "        }",
            f"        for (i = 0; i < {reference}u; i++) {{",
            "            reference.given[i] = steps[0].reference[i];",
            "        }",
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


def _main(names: Sequence[str]) -> str:
    return "\n".join(
        [
            "int main(void)",
            "{",
            "    int wrong = 0;",
            *(f"    wrong += test_{name}();" for name in names),
            '    say(wrong == 0 ? "selftest: pass\\n" : "selftest: FAIL\\n");',
            "    return wrong < 100 ? wrong : 100;",
            "}",
            "",
        ]
    )


def _bits(values: Sequence[float], scalar: Scalar) -> str:
    """The numbers' bits in C, rounded to the scalar first; 0 where there are none."""
    real, whole, digits = BITS[scalar.real]
    with np.errstate(over="ignore"):
        numbers = np.array(values, real).view(whole)
    suffix = "u" if scalar.real == "float" else "ull"
    return ", ".join(f"0x{int(n):0{digits}x}{suffix}" for n in numbers) or f"0{suffix}"

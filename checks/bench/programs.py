"""The programs to measure: for each implementation of a law,
a C file that calls one of its functions at all states."""

from collections.abc import Callable
from dataclasses import dataclass

from cases import COUNT, TOLERANCE
from noslip.codegen.printing.law_c import LawC
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.program import compile_law
from noslip.model.law import ControlLaw

ENTRY = {"tau": "step", "Phi": "decoupling", "Phidot": "decoupling_rate"}  # our C function of each quantity
HAND = {"type_i": "type_i", "type_iv_line": "line", "type_iv_circle": "circle", "type_iv_ellipse": "ellipse"}
ONCE = "__attribute__((noipa))"  # GCC: not inlined, cloned or analysed for its caller


@dataclass(frozen=True)
class MeasuredProgram:
    """A C (or C++) file with `measured`, the function to count, called only by `driver`."""

    law: str
    quantity: str
    text: str
    language: str = "c"

    @property
    def name(self) -> str:
        """Name from which those of functions and files are formed."""
        return f"{self.law}_{self.quantity}"

    @property
    def measured(self) -> str:
        """Name of the function that is counted."""
        return f"measured_{self.name}"

    @property
    def driver(self) -> str:
        """Name of its only caller."""
        return f"drive_{self.name}"


class Unguarded(LawC):
    """Return the law without guards."""

    def leave(self, condition: str, answer: str = "NOSLIP_SINGULAR") -> str:
        return "" if answer in ("NOSLIP_SINGULAR", "NOSLIP_RANGE") else super().leave(condition, answer)


def ours(
    law: ControlLaw, scalar: str, quantity: str, optimize: bool = True, kind: type[LawC] = Unguarded
) -> MeasuredProgram:
    """Return our law without guards: the body of the generated function."""
    text = kind(compile_law(law, optimize), SCALARS[scalar], ["for the bench, without guards"])
    core = SCALARS[scalar].name(f"{text.prefix}_{ENTRY[quantity]}") + "_law"
    types, arguments = _signature(text, quantity)
    return _program(
        law,
        scalar,
        quantity,
        [
            text.header(),
            f"static inline int {core}({types}) __attribute__((always_inline));",
            text.source(),
            f"{ONCE} void MEASURED({types})\n{{\n    (void){core}({arguments});\n}}",
        ],
        *_own_calls(text, quantity),
    )


def tested(law: ControlLaw, scalar: str, quantity: str) -> MeasuredProgram:
    """Return our law with the tests that it is not singular, and without other guards."""
    return ours(law, scalar, quantity, kind=LawC)


def guarded(law: ControlLaw, scalar: str, quantity: str) -> MeasuredProgram:
    """Return our public function, as users call it."""
    text = LawC(compile_law(law), SCALARS[scalar], ["for the bench"])
    public = SCALARS[scalar].name(f"{text.prefix}_{ENTRY[quantity]}")
    renamed = f"#define {public} MEASURED"
    types, _ = _signature(text, quantity, public=True)
    return _program(
        law,
        scalar,
        quantity,
        [renamed, text.header(), f"{ONCE} int MEASURED({types});", text.source()],
        *_own_calls(text, quantity),
    )


def unoptimized(law: ControlLaw, scalar: str, quantity: str) -> MeasuredProgram:
    """Return the reference law without optimizer passes and guards."""
    return ours(law, scalar, quantity, optimize=False)


def hand(law: ControlLaw, scalar: str, quantity: str) -> MeasuredProgram:
    """Return the hand-written law."""
    name, kind, robot = SCALARS[scalar].name, HAND[law.name], law.system.mechanism.name
    what = f"hand_{kind}" if quantity == "tau" else f"hand_{kind}_matrix"
    function = name(f"hand_{kind}_{'step' if quantity == 'tau' else quantity}")
    state = name(f"{robot}_state")
    reference = name(f"{robot}_{law.name}_reference")
    given = [(f"const {name(what)} *", "self"), (f"const {state} *", "state")]
    given += [(f"const {reference} *", "wanted")] if quantity == "tau" else []
    types = (
        ", ".join(f"{kind}{argument}" for kind, argument in given)
        + f", {scalar} answer[2]{'' if quantity == 'tau' else '[2]'}"
    )
    arguments = ", ".join([*(argument for _, argument in given), "answer"])
    casts = [f"(const {name(f'{robot}_params')} *){law.name}_params"]
    casts += [f"(const {name(f'{robot}_{law.name}_config')} *){law.name}_config"]
    casts += [f"(const {name(f'{robot}_{law.name}_gains')} *){law.name}_gains"] if quantity == "tau" else []
    call = f"MEASURED(&law, (const {state} *){law.name}_state[i]"
    call += (
        f", (const {reference} *){law.name}_reference[i], answer[i]);"
        if quantity == "tau"
        else f", ({scalar}(*)[2])answer[i]);"
    )
    return _program(
        law,
        scalar,
        quantity,
        ['#include "hand.h"', f"{ONCE} void MEASURED({types})\n{{\n    {function}({arguments});\n}}"],
        f"static {name(what)} law;",
        f"{name(what + '_init')}(&law, {', '.join(casts)});",
        call,
    )


def flat(
    law: ControlLaw, scalar: str, quantity: str, text: str, call: str, language: str = "c"
) -> MeasuredProgram:
    """Return another tool's function of plain arrays, without precomputed constants; `call` is C in terms of
    `arrays` and answer[i]."""
    return _program(law, scalar, quantity, [text], "", "", call, language)


def arrays(law: ControlLaw) -> list[str]:
    """Return the arguments of the law in the loop of the driver: params, config, gains, state, reference."""
    return [f"{law.name}_{group}" for group in ("params", "config", "gains")] + [
        f"{law.name}_{g}[i]" for g in ("state", "reference")
    ]


def _signature(text: LawC, quantity: str, public: bool = False) -> tuple[str, str]:
    entry = next(entry for entry in text.entries if entry.name == ENTRY[quantity])
    declared = text.parameters(entry, public=public)
    return ", ".join(declared.values()), ", ".join(declared)


def _own_calls(text: LawC, quantity: str) -> tuple[str, str, str]:
    """Return declaration, preparation and call of a generated law."""
    name, law = text.scalar.name, text.law.name
    given = [f"(const {name(f'{text.robot}_params')} *){law}_params"]
    given += [f"(const {name(f'{text.prefix}_{group}')} *){law}_{group}" for group in ("config", "gains")]
    call = f"(void)MEASURED(&law, (const {text.state_type} *){law}_state[i]"
    if quantity == "tau":
        call += f", (const {name(f'{text.prefix}_reference')} *){law}_reference[i], answer[i]);"
    else:
        call += f", ({text.scalar.real}(*)[2])answer[i]);"
    prepare = f"(void){name(f'{text.prefix}_init')}(&law, {', '.join(given)}, NULL);"
    return f"static {text.type} law;", prepare, call


def _program(
    law: ControlLaw,
    scalar: str,
    quantity: str,
    parts: list[str],
    declare: str,
    prepare: str,
    call: str,
    language: str = "c",
) -> MeasuredProgram:
    empty = MeasuredProgram(law.name, quantity, "")
    size = 2 if quantity == "tau" else 4
    text = f"""#define NOSLIP_QUICK
#define MEASURED {empty.measured}
{(chr(10) * 2).join(parts)}

#include "cases_{scalar}.h"

static {scalar} answer[{COUNT}][{size}];
{declare}

{ONCE} void {empty.driver}(void)
{{
    int i;
    for (i = 0; i < {COUNT}; i++) {{
        {call}
    }}
}}

int check_{empty.name}(void)
{{
    int i, k;
    {prepare}
    {empty.driver}();
    for (i = 0; i < {COUNT}; i++) {{
        for (k = 0; k < {size}; k++) {{
            const double wanted = {law.name}_{quantity}[i][k], error = answer[i][k] - wanted;
            const double most = {TOLERANCE[scalar]} * (1 + (wanted < 0 ? -wanted : wanted));
            if (!(error <= most && -error <= most)) {{
                return 1;
            }}
        }}
    }}
    return 0;
}}
"""
    if language == "c++":
        text = text.replace("int check_", 'extern "C" int check_').replace(
            f"{ONCE} void drive_", f'extern "C" {ONCE} void drive_'
        )
    return MeasuredProgram(law.name, quantity, text, language)


def main_text(programs: list[MeasuredProgram]) -> str:
    """Return a main that runs every program and returns the number of the first wrong one."""
    lines = [f"int check_{program.name}(void);" for program in programs]
    lines += ["int main(void)", "{"]
    lines += [
        f"    if (check_{program.name}()) return {number};" for number, program in enumerate(programs, 1)
    ]
    return "\n".join([*lines, "    return 0;", "}", ""])


Writer = Callable[[ControlLaw, str, str], MeasuredProgram]

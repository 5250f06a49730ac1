"""What goes with exported C: a Makefile, a page to read first, and a program that steps a law once."""

import json
from collections.abc import Mapping

from ...model.law import ControlLaw
from ..printing.scalar import SCALARS, Scalar


def example(generated: Mapping[str, str], law: ControlLaw) -> dict[str, str]:
    """Makefile, README.md and example.c for the files of one robot; the example steps `law`."""
    manifest = json.loads(generated["manifest.json"])
    robot, laws = manifest["robot"], list(manifest["laws"])
    suffix = "_f" if f"{robot}.h" not in generated else ""
    scalar = next(s for s in SCALARS.values() if s.suffix == suffix)
    return {
        "Makefile": _makefile(robot),
        "README.md": _readme(robot, laws, manifest["tools"]),
        "example.c": _example(law, scalar),
    }


def _makefile(robot: str) -> str:
    return f"""# make: builds lib{robot}.a and the example, and runs it. CC and CFLAGS are yours to set.
# Every dialect from C99 on gives the same bits; -ffast-math does not compile.
CC ?= cc
AR ?= ar
CFLAGS ?= -O2
CFLAGS += -std=c99 -ffp-contract=off -fno-math-errno -Wall -Wextra
OBJECTS := $(patsubst %.c,%.o,$(filter-out example.c,$(wildcard *.c)))

.PHONY: all clean
all: example
\t./example

lib{robot}.a: $(OBJECTS)
\t$(AR) rcs $@ $(OBJECTS)

example: example.c lib{robot}.a
\t$(CC) $(CFLAGS) -o $@ example.c lib{robot}.a

%.o: %.c $(wildcard *.h *.inc)
\t$(CC) $(CFLAGS) -c -o $@ $<

clean:
\trm -f *.o lib{robot}.a example
"""


def _readme(robot: str, laws: list[str], tools: str) -> str:
    listed = "\n".join(f"- `{robot}_{law}.h`" for law in laws)
    return f"""# {robot}: control laws in C

Made by {tools}. C99, no heap, no globals, no libm; the caller owns all memory. Add the `.c` files (without
`example.c`) to your project, or `make` here for `lib{robot}.a`. The headers are the documentation; start with one of

{listed}

Names that end in `_f` are the same in `float`. Every function answers a status (`noslip_status.h`): 0 good, 1 good
but cut to a limit, negative an error, and then the inputs are zero or held, as `options` say. Every dialect from C99 on
gives the same bits; `-ffast-math` does not compile. `example.c` makes a law and steps it once.
"""


def _example(law: ControlLaw, scalar: Scalar) -> str:
    robot = law.system.mechanism.name
    name, suffix = f"{robot}_{law.name}", scalar.suffix
    config = ", ".join(f".{q.in_c} = {scalar.literal(q.default or 0.25)}" for q in law.config) or "0"
    gains = ", ".join(f".{q.in_c} = {scalar.literal(q.default)}" for q in law.gains) or "0"
    state = ", ".join(f".{q.in_c} = {scalar.literal((k + 1) / 8)}" for k, q in enumerate(law.state))
    inputs = len(law.system.mechanism.inputs)
    printed = " ".join(["%g"] * inputs)
    values = ", ".join(f"(double)tau[{k}]" for k in range(inputs))
    names = ", ".join(f"{q.name} ({q.unit})" for q in law.system.mechanism.inputs)
    return f"""/* Makes one law, steps it once at some state, and prints the answer. The numbers are examples. */
#include <stdio.h>

#include "{name}{suffix}.h"

int main(void)
{{
    const {name}_config{suffix} config = {{{config}}};
    const {name}_gains{suffix} gains = {{{gains}}};
    const {robot}_state{suffix} state = {{{state}}}; /* yours: from sensors */
    const {name}_reference{suffix} reference = {{0}}; /* yours: what the outputs shall do */
    {robot}_params{suffix} params;
    {name}{suffix} law;
    {scalar.real} tau[{inputs}];
    int status = {robot}_default_params{suffix}(&params);

    if (status == NOSLIP_OK) {{
        status = {name}_init{suffix}(&law, &params, &config, &gains, NULL);
    }}
    if (status == NOSLIP_OK) {{
        status = {name}_step{suffix}(&law, &state, &reference, tau);
    }}
    if (status < 0) {{
        printf("{name}{suffix}: %s\\n", noslip_status_name(status));
        return 1;
    }}
    printf("{name}{suffix}: %s, {names}: {printed}\\n", noslip_status_name(status), {values});
    return 0;
}}
"""

"""Estimated cycles of each instruction of an image, from its disassembly, by a model of the processor.

All models have code and data in memory without wait states, and one instruction at a time: 1 cycle for an
instruction, and

- `alone`: other numbers for an instruction that depends on none before it;
- 1 less for a load or store of one register that follows another one where the two are `pipelined`;
- `waits` more if an instruction uses the result of the FPU's arithmetic immediately before it;
- `refill` more for a branch that is taken, since the pipeline is filled again.

CORTEX_M4 has the numbers of ARM's technical reference manual (DDI 0439: instruction summary, FPU): 14 for a
division or a root of floats, 12 for a division of integers (at most), 3 for a sum with a product; 2 for a
load or store, 1 + N for one of N registers; a refill takes 1 to 3. For the other two no such table is
published, and the numbers are assumed. CORTEX_M7: those of the M4, but two more where a result of the FPU is
used immediately, for its longer pipeline; that it can execute two instructions at once is left out, so that
it usually takes less. RV32: a pipeline of five stages, in order, with FPU: 2 for a load, 4 for a product of
integers, 34 for a division of integers, 20 and 25 for a division and a root of floats, 4 more where a result
of the FPU is used immediately.

An estimate, not a measurement: an instruction in an IT block counts the same if its condition is false,
integers are not computed while the FPU divides, and caches, flash and interrupts are left out.
"""

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

LINE = re.compile(r"^ *([0-9a-f]+):\t([a-z]\S*)(?:\t([^@;#\n]*))?", re.M)
SINGLE = re.compile("v?(ldr|str)(?!d)")
SEVERAL = re.compile("v?(ldm|stm|push|pop)|(ldr|str)d")


@dataclass(frozen=True)
class Model:
    """Cycles of a processor's instructions, see above. `arithmetic`: of the FPU; `reads_all`:
    those without a result first."""

    alone: tuple[tuple[str, int], ...]
    arithmetic: str
    reads_all: str
    pipelined: bool
    waits: int
    refill: int = 2


_ARM = (("vdiv|vsqrt", 14), ("[us]div", 12), ("vn?ml[as]|vfn?m[as]", 3), ("v?ldr|v?str", 2))
_FPU = "v(add|sub|n?mul|n?ml[as]|fn?m[as]|div|sqrt|cvt)"
_FPU_READS = "v(str|cmp|n?ml[as]|fn?m[as])"  # other instructions of the FPU write their first operand
CORTEX_M4 = Model(_ARM, _FPU, _FPU_READS, pipelined=True, waits=1)
CORTEX_M7 = Model(_ARM, _FPU, _FPU_READS, pipelined=True, waits=3)
RV32 = Model(
    (("fdiv", 20), ("fsqrt", 25), ("(div|rem)u?", 34), ("mul", 4), (r"l[bhw]u?\b|fl[wd]\b", 2)),
    r"f(add|sub|mul|n?madd|n?msub|div|sqrt|cvt)",
    r"s[bhw]\b|fs[wd]\b|b(eq|ne|lt|ge)",
    pipelined=False,
    waits=4,
)


def costs(listing: str, model: Model = CORTEX_M4) -> dict[int, int]:
    """Return address -> cycles of each instruction of a listing by objdump -d --no-show-raw-insn,
    after the one before it."""
    found: dict[int, int] = {}
    single, result = False, ""
    for address, name, written in LINE.findall(listing):
        operands = [operand.strip() for operand in written.split(",")]
        alone = next((cycles for names, cycles in model.alone if re.match(names, name)), 1)
        if SEVERAL.match(name):
            alone = 1 + (_registers(written) if "{" in written else 2)
        pipelined = model.pipelined and single and SINGLE.match(name) is not None
        used = result in operands[0 if re.match(model.reads_all, name) else 1 :]
        found[int(address, 16)] = alone - pipelined + used * model.waits
        single = SINGLE.match(name) is not None
        result = operands[0] if re.match(model.arithmetic, name) else "none"
    return found


def write_costs(image: Path, prefix: str, model: Model = CORTEX_M4) -> Path:
    """Write the costs of an image for the plugin: refill, then a line `address cycles` for each
    instruction."""
    dump = [f"{prefix}objdump", "-d", "--no-show-raw-insn", str(image)]
    listing = subprocess.run(
        dump, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True
    ).stdout
    file = image.with_suffix(".cycles")
    lines = [
        f"{model.refill}\n",
        *(f"{address:x} {cycles}\n" for address, cycles in costs(listing, model).items()),
    ]
    file.write_text("".join(lines), encoding="utf-8")
    return file


def _registers(written: str) -> int:
    """Return the number of registers of a list such as {r4, s16-s18}."""
    ends = [re.findall(r"\d+", part) for part in written[written.index("{") :].split(",")]
    return sum(int(end[1]) - int(end[0]) + 1 if len(end) == 2 else 1 for end in ends)

"""Estimated cycles of each instruction of a Cortex-M4F image, from its disassembly.

The numbers are those of ARM's technical reference manual of the Cortex-M4 (DDI 0439: instruction summary, FPU), with code and
data in memory without wait states:

- 1 for an instruction, 14 for a division or a root of floats, 12 for a division of integers (at most), 3 for a sum with a
  product;
- 2 for a load or store, 1 if it follows another one, since the two are pipelined; 1 + N for one of N registers;
- 1 more if an instruction uses the result of the FPU's arithmetic immediately before it;
- 2 more for a branch that is taken, since the pipeline is filled again (1 to 3 in the manual).

An estimate, not a measurement: an instruction in an IT block counts the same if its condition is false, and integers are not
computed while the FPU divides.
"""

import re
from pathlib import Path

from counting import run

LINE = re.compile(r"^ *([0-9a-f]+):\t([a-z]\S*)(?:\t([^@;\n]*))?", re.M)
ALONE = (  # mnemonics -> cycles of an instruction that depends on none before it, for those that do not take 1
    (re.compile("vdiv|vsqrt"), 14),
    (re.compile("[us]div"), 12),
    (re.compile("vn?ml[as]|vfn?m[as]"), 3),
    (re.compile("v?ldr|v?str"), 2),
)
SINGLE = re.compile("v?(ldr|str)(?!d)")
SEVERAL = re.compile("v?(ldm|stm|push|pop)|(ldr|str)d")
ARITHMETIC = re.compile("v(add|sub|n?mul|n?ml[as]|fn?m[as]|div|sqrt|cvt)")
READS_ALL = re.compile("v(str|cmp|n?ml[as]|fn?m[as])")  # other instructions of the FPU write their first operand
REFILL = 2


def costs(listing: str) -> dict[int, int]:
    """Return address -> cycles of each instruction of a listing by objdump -d --no-show-raw-insn, after the one before it."""
    found: dict[int, int] = {}
    single, made = False, ""
    for address, name, written in LINE.findall(listing):
        operands = [operand.strip() for operand in written.split(",")]
        alone = next((cycles for names, cycles in ALONE if names.match(name)), 1)
        if SEVERAL.match(name):
            alone = 1 + (_registers(written) if "{" in written else 2)
        pipelined = single and SINGLE.match(name) is not None
        waits = made in operands[0 if READS_ALL.match(name) else 1 :]
        found[int(address, 16)] = alone - pipelined + waits
        single = SINGLE.match(name) is not None
        made = operands[0] if ARITHMETIC.match(name) else "none"
    return found


def write_costs(image: Path, prefix: str) -> Path:
    """Write the costs of an image for the plugin: REFILL, then a line `address cycles` for each instruction."""
    listing = run([f"{prefix}objdump", "-d", "--no-show-raw-insn", str(image)], image.parent).stdout
    file = image.with_suffix(".cycles")
    file.write_text("".join([f"{REFILL}\n", *(f"{address:x} {cycles}\n" for address, cycles in costs(listing).items())]))
    return file


def _registers(written: str) -> int:
    """Return the number of registers of a list such as {r4, s16-s18}."""
    ends = [re.findall(r"\d+", part) for part in written[written.index("{") :].split(",")]
    return sum(int(end[1]) - int(end[0]) + 1 if len(end) == 2 else 1 for end in ends)

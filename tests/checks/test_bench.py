"""The bench's estimate of cycles on a Cortex-M4F, compared with counts by hand."""

import json
import sys
from pathlib import Path

import pytest
from PIL import Image

from ..tools import need

ROOT = Path(__file__).resolve().parents[2]
FUNCTION = {  # instruction -> its cycles, from the timing rules in checks/guarantees/cycles.py
    "vldr s0, [r1]": 2,
    "vldr s1, [r1, #4]": 1,  # pipelined with the one before
    "vmul.f32 s2, s0, s1": 1,  # what was loaded is there
    "vadd.f32 s3, s2, s0": 2,  # waits for s2
    "vsub.f32 s2, s3, s3": 2,  # waits once, however often it uses s3
    "vsqrt.f32 s3, s3": 14,
    "vneg.f32 s4, s3": 2,
    "vdiv.f32 s5, s4, s3": 14,  # what is negated is there at once
    "vstr s5, [r1]": 3,  # waits for s5
    "ldr r3, [r1, #4]": 1,
    "vpush {s16-s18}": 4,
    "vpop {s16-s18}": 4,
    "push {r4, r5, lr}": 4,
    "pop {r4, r5, lr}": 4,
    "udiv r3, r3, r0": 12,
}
LOOP = 3  # the function repeats all that so often
AROUND = {"subs r0, #1": 1, "bne 1b": 1}


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "checks/bench")
    yield
    for name in ("counting", "measure", "programs", "cases"):
        sys.modules.pop(name, None)


def test_cycles_of_a_listing(bench):
    """Every instruction of a listing takes the cycles that the rules give by hand."""
    from noslip.checks.guarantees.cycles import costs

    lines = [
        f"  {8 + 4 * k:x}:\t{text.replace(' ', chr(9), 1)}\t@ comment" for k, text in enumerate(FUNCTION)
    ]
    found = costs("00000008 <measured>:\n" + "\n".join(lines) + "\n  44:\t.word\t0x3f22f983\n")
    assert dict(zip(FUNCTION, found.values(), strict=True)) == FUNCTION


RISCV = {
    "flw fa5,0(a0)": 2,
    "fmul.s fa4,fa5,fa5": 1,
    "fadd.s fa3,fa4,fa5": 5,
    "fsw fa3,4(a0)": 5,
    "fdiv.s fa2,fa3,fa5": 20,
}
RISCV |= {"lw a5,0(a1)": 2, "mul a5,a5,a4": 4, "divu a5,a5,a4": 34, "addi a5,a5,1": 1, "bnez a5,8 <f>": 1}


def test_cycles_of_other_processors(bench):
    """A RISC-V core, by hand; a Cortex-M7, which waits two more for each result of its FPU."""
    from noslip.checks.guarantees.cycles import CORTEX_M7, RV32, costs

    lines = [f"8000{4 * k:04x}:\t{text.replace(' ', chr(9), 1)}" for k, text in enumerate(RISCV)]
    assert dict(zip(RISCV, costs("\n".join(lines), RV32).values(), strict=True)) == RISCV
    lines = [f"  {8 + 4 * k:x}:\t{text.replace(' ', chr(9), 1)}" for k, text in enumerate(FUNCTION)]
    m4, m7 = (costs("\n".join(lines), *model).values() for model in ((), (CORTEX_M7,)))
    assert [b - a for a, b in zip(m4, m7, strict=True)] == [0, 0, 0, 2, 2, 0, 2, 0, 2, *[0] * 6]


def test_a_target_without_its_tools_is_skipped(bench, tmp_path, monkeypatch):
    from measure import CortexM0Plus, CortexM4F, CortexM4FSmall

    monkeypatch.setenv("PATH", str(tmp_path))
    for target in (CortexM4F, CortexM4FSmall, CortexM0Plus):
        assert target(tmp_path).missing == "arm-none-eabi-gcc"


def test_cycles_of_a_trace(bench, tmp_path):
    """A loop that QEMU executes takes what its instructions take, and 2 more for each branch taken:
    call, loop, return."""
    from counting import count_calls, run, symbols_of
    from measure import CortexM4F
    from noslip.checks.guarantees.cycles import write_costs

    need("arm-none-eabi-gcc", "qemu-system-arm", "gcc")
    inner = "\\n".join([*FUNCTION, *AROUND])
    (tmp_path / "main.c").write_text(f"""
__attribute__((naked, noipa)) void measured(int n, float *x) {{ __asm__("1:\\n{inner}\\nbx lr"); }}
__attribute__((noipa)) int drive(float *x) {{ measured({LOOP}, x); return 0; }}
int main(void) {{ float x[2] = {{2, 3}}; return drive(x); }}
""")
    target, image = CortexM4F(tmp_path), tmp_path / "image"
    build = [
        "arm-none-eabi-gcc",
        "-O1",
        *target.flags,
        "main.c",
        *map(str, target.startup),
        *target.link,
        "-o",
        str(image),
    ]
    run(build, tmp_path)
    symbols = symbols_of(image, target.prefix)
    costs = write_costs(image, target.prefix)
    done, found = count_calls(target.machine, image, symbols, [("measured", "drive")], tmp_path, costs)
    instructions = LOOP * len(FUNCTION | AROUND) + 1
    refills = 2 * (1 + (LOOP - 1) + 1)
    cycles = LOOP * sum((FUNCTION | AROUND).values()) + 1 + refills
    assert done.returncode == 0 and found["measured"] == (1, instructions, instructions, instructions, cycles)


def test_the_table_is_of_the_run_of_its_picture():
    """docs/bench.png carries the numbers that it shows; `make bench` makes it,
    and the table is written from the same numbers."""
    described = json.loads(Image.open(ROOT / "docs" / "bench.png").text["Description"])
    laws = described["Cortex-M4F, float"].values()
    rows = {
        "noslip, + guards": [f"{law['instructions']:.0f} + {law['guards']:.0f}" for law in laws],
        "written by hand": [f"{law['hand']:.0f}" for law in laws],
        "CasADi, sin replaced by sinf": [f"{law['casadi_single']:.0f}" for law in laws],
        "*cycles:* noslip with its singular test, all guards": [
            f"{law['cycles']:.0f}, {law['cycles_guarded']:.0f}" for law in laws
        ],
        "written by hand, no test": [f"{law['cycles_hand']:.0f}" for law in laws],
    }
    expected = [f"| {' | '.join([name, *cells])} |" for name, cells in rows.items()]
    lines = (ROOT / "checks/bench/README.md").read_text().splitlines()
    assert [line for line in expected if line not in lines] == []

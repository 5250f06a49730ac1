"""The headers of runtime_c as C, every public function of each: warnings, libraries, precision,
and bits by compiler."""

import re
from itertools import product
from pathlib import Path

import pytest
from noslip.codegen.runtime import RUNTIME
from noslip.simulation.controllers.runtime import declarations
from noslip.tests.runtime_c.test_runtime import FLAGS, INCLUDE, STRICT, compilers, each_level, run
from noslip.tests.tools import COMPILERS, HOST_CC, need

# Cannot be parsed; no inline functions
APART = ("noslip_real.h", "noslip_path.h", "noslip_status.h", "noslip_version.h")
HEADERS = sorted(path.name for path in RUNTIME.glob("*.h") if path.name not in APART)
# Instructions of x86
DOUBLES = r"\t(v?(?:add|sub|mul|div|sqrt|ucomi|comi|cvt\w*|cmp\w*)(?:sd|pd)\w*|v?cvt(?:sd|pd)2\w+)\b"


# functions with copies of a covariance: 512 bytes in float on a Cortex-M4F (checks/guarantees/memory.py)
LARGE = ("noslip_ekf_", "noslip_adaptation_")


def everything(folder: Path, suffix: str = "", without: tuple[str, ...] = ()) -> str:
    """The path of a source that uses every function of the headers whose name ends so,
    but for those that begin as `without`."""
    names = {name for header in HEADERS for name in re.findall(r"\b(noslip_\w+)\s*\(", declarations(header))}
    assert len(names) > 40
    names = {name for name in names if not name.startswith(without)}
    used = ", ".join(
        f"(any){name}" for name in sorted(names - {"noslip_status_name"}) if name.endswith(suffix)
    )
    includes = "".join(
        f'#include "{header}"\n' for header in HEADERS if header.removesuffix(".h") + "_" not in without
    )
    source = folder / "everything.c"
    source.write_text(
        f"{includes}typedef void (*any)(void);\nextern const any all[];\nconst any all[] = {{{used}}};\n"
    )
    return str(source)


@compilers
@each_level
def test_no_warnings_and_no_library(cc, level, tmp_path):
    """Nothing undefined but functions of noslip's own C files, not even memcpy:
    no mathematics of a library."""
    checked = (cc, level) == ("gcc", "-O2")
    code = str(tmp_path / "everything.o")
    for without, stack in ((LARGE, 256), ((), 768)) if checked else (((), 0),):
        more = ["-fanalyzer", f"-Wstack-usage={stack}"] if stack else []
        source = everything(tmp_path, without=without)
        run([need(cc), *FLAGS, level, "-ffreestanding", *STRICT, *more, *INCLUDE, "-c", source, "-o", code])
    assert all(name.startswith("noslip_") for name in run(["nm", "-u", code]).split() if name != "U")


@compilers
@each_level
def test_the_float_side_has_no_double(cc, level, tmp_path):
    need("objdump")
    code = str(tmp_path / "everything.o")
    run([need(cc), *FLAGS, level, *INCLUDE, "-c", everything(tmp_path, "_f"), "-o", code])
    listing = run(["objdump", "-d", "--no-show-raw-insn", code])
    assert "ss " in listing
    assert not re.findall(DOUBLES, listing)


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("program", ["walk", "sums"])
def test_the_same_bits_on_every_compiler(program, scalar, tmp_path):
    """Poses of a random walk with corrections and encoders, and sums of errors,
    as compilers and levels have them."""
    source = tmp_path / f"{program}.c"
    source.write_text(
        {"walk": WALK, "sums": SUMS}[program]
        .replace("REAL", scalar)
        .replace("_X", "_f" * (scalar == "float"))
    )
    printed = {}
    for cc, level in product(COMPILERS, ("-O0", "-O2", "-O3")):
        executable = str(tmp_path / f"{program}{cc}{level}")
        run([cc, *FLAGS, level, *INCLUDE, str(source), "-o", executable])
        printed[cc, level] = run([executable])
    assert len(set(printed.values())) == 1 and len(set(printed[HOST_CC, "-O0"].split())) > 80


WALK = r"""
#include <stdio.h>
#include <string.h>
#include "noslip_odometry.h"

int main(void)
{
    noslip_odometry_options_X options = {{0.075F, 0.0625F}, {0.1F, -0.11F}, 0.3F, 0.5F};
    noslip_odometry_X self;
    noslip_encoder_X encoder[2];
    noslip_pose_X pose = {1, 2, 3};
    REAL angle[2];
    uint32_t seed = 1992, count[2] = {0, 0};
    int k, i;
    if (noslip_odometry_init_X(&self, &options, &pose) < 0 ||
        noslip_encoder_init_X(&encoder[0], 4096, 16) < 0 ||
        noslip_encoder_init_X(&encoder[1], -500, 32) < 0) {
        return 1;
    }
    for (k = 0; k < 3000; k++) {
        for (i = 0; i < 2; i++) {
            seed = seed * 1664525u + 1013904223u;
            count[i] += seed >> 22;
            noslip_encoder_read_X(&encoder[i], count[i], &angle[i]);
        }
        noslip_odometry_move_X(&self, angle, (REAL)(seed >> 20) / 65536, &pose);
        if (k % 70 == 69) {
            pose.x += 1;
            pose.heading -= (REAL)(seed >> 29);
            noslip_odometry_correct_X(&self, &pose, k % 3 > 0);
        }
        if (k % 500 == 499) {
            noslip_odometry_unwind_X(&self);
        }
        if (k % 30 == 29) {
            unsigned char bits[sizeof pose];
            size_t byte;
            memcpy(bits, &pose, sizeof pose);
            for (byte = 0; byte < sizeof pose; byte++) {
                printf("%02x%s", bits[byte], (byte + 1) % sizeof pose.x ? "" : " ");
            }
        }
    }
    return 0;
}
"""

SUMS = r"""
#include <stdio.h>
#include "noslip_integral.h"

int main(void)
{
    noslip_integral_X self;
    uint32_t seed = 1992;
    int k;
    if (noslip_integral_init_X(&self, 0.7F, 1.5F) < 0) {
        return 1;
    }
    for (k = 0; k < 3000; k++) {
        REAL add;
        seed = seed * 1664525u + 1013904223u;
        noslip_integral_step_X(&self, (REAL)(seed >> 8) / 3000000 - 2, (REAL)(seed >> 20) / 70000, k % 7 < 2,
                               &add);
        if (k % 30 == 29) {
            printf("%a\n", (double)add);
        }
    }
    return 0;
}
"""

"""The same bits from every compiler, at every level, on every target: one digest of all LABMATE laws over
seeded states.

`python tests/runtime_c/test_bits.py` prints the table: target, compiler and flags, states, digest in float,
in double, and of sine, cosine and root.
"""

import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import STANDARD
from noslip.simulation.controllers.targets import CONSOLE, HOST, TARGETS, required
from noslip.tests.tools import HOST_CC

ROOT = Path(__file__).resolve().parents[2]
GENERATED, DRIVERS = ROOT / "generated" / "labmate", ROOT / "tests" / "c"
DIGEST = [DRIVERS / "law_digest.c", *sorted((GENERATED / "lanes").glob("*.c"))]  # with the batch laws
SOURCES = [*DIGEST, *sorted(RUNTIME.glob("*.c")), *sorted(GENERATED.glob("*.c"))]
INCLUDE = [f"-I{folder}" for folder in (RUNTIME, GENERATED, DRIVERS)]
LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os")
LAWS = [
    header.stem for header in sorted(GENERATED.glob("labmate_type_*.h")) if not header.stem.endswith("_f")
]
FULL, FEW = 20_000, 1_000  # states: of builds for the host, of one for each other target; of the others
SLOW = 2_000  # states at most in double, where the processor has no FPU for it
TESTED = 1_000  # states at most, where this runs as a test
TIMEOUT = 120  # s, of any one tool

SOFT = ("cortex-m4f", "rv32imafc", "rv32imac")  # no FPU for doubles
NODE = """
const [file, ...states] = process.argv.slice(1);
const { exports } = new WebAssembly.Instance(new WebAssembly.Module(require("fs").readFileSync(file)));
const text = new Uint8Array(exports.memory.buffer, exports.law_digest(...states.map(Number)));
process.stdout.write(Buffer.from(text.subarray(0, text.indexOf(0))));
"""


@dataclass(frozen=True)
class Build:
    """One way to compile the laws, and how many states they are run at."""

    target: str
    compiler: str
    flags: str
    states: int = FEW

    def __str__(self) -> str:
        return f"{self.name} {self.compiler} {self.flags}"

    @property
    def name(self) -> str:
        """Of the target, the host's own."""
        return platform.machine() if self.target == HOST.name else self.target

    @property
    def doubles(self) -> int:
        """States in double."""
        return min(self.states, SLOW) if self.target in SOFT else self.states

    @property
    def missing(self) -> str:
        """What is not there; empty when it can be built and run."""
        wasm = ("wasm-ld", "node") if self.target == "wasm32" else ()
        absent = TARGETS[self.target].missing(self.compiler, *wasm)
        return f"{', '.join(absent)} not installed" if absent else ""

    @property
    def unsuited(self) -> str:
        """Which instructions of the flags this processor does not have; empty when it has all."""
        wanted = {flag[2:] for flag in self.flags.split() if flag in ("-mavx2", "-mfma")}
        absent = sorted(wanted - processor())
        return f"this processor has no {', '.join(absent)}" if absent else ""

    def digest(self, folder: Path, sources: Sequence[Path] = SOURCES, built: Sequence[str] = ()) -> list[str]:
        """Builds in an empty folder and runs; answers the words of law_digest's line. `built`:
        objects of the other sources."""
        target = TARGETS[self.target]
        for name, text in target.files().items():
            Path(folder, name).write_text(text, encoding="utf-8")
        given = [
            *STANDARD,
            *self.flags.split(),
            f"-DSTATES={self.states}u",
            f"-DDOUBLES={self.doubles}u",
            "-I.",
            *INCLUDE,
        ]
        run([*target.compile(self.compiler), *given, "-c", *map(str, sources)], folder)
        objects = [*(f"{source.stem}.o" for source in sources), *built]
        if self.target == "wasm32":
            link = ["-nostdlib", "-Wl,--no-entry", "-Wl,--export=law_digest"]
            command = ["node", "-e", NODE, "digest", str(self.states), str(self.doubles)]
        else:
            link = [str(DRIVERS / "law_digest_bare.c")] if target.bare else []
            command = target.run("digest", *CONSOLE)
            command += [] if target.bare else [str(self.states), str(self.doubles)]
        linker = target.compile(target.compiler or self.compiler)
        run([*linker, *given, *target.start, *objects, *link, *target.link(), "-o", "digest"], folder)
        return run(command, folder).split()


def same(found: Sequence[str], right: Sequence[str]) -> bool:
    """Are these the same bits? Doubles need not be where the target's own sums of them are wrong."""
    float_and_roots, sums = (0, 1, 4), found[5] == "1"
    return all(found[k] == right[k] for k in (range(5) if sums else float_and_roots)) and right[5] == "1"


def run(command: list[str], folder: Path) -> str:
    """Standard output of a command that must succeed."""
    result = subprocess.run(
        command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT
    )
    assert result.returncode == 0, (
        f"{command[0]} ended with {result.returncode}\n{result.stdout}{result.stderr}"
    )
    return result.stdout


@cache
def processor() -> set[str]:
    """The flags of this processor, where Linux tells them."""
    info = Path("/proc/cpuinfo")
    return set(info.read_text(encoding="utf-8").split()) if info.exists() else set()


REFERENCE = Build(HOST.name, HOST_CC, "-O2", FULL)


def builds() -> Iterator[Build]:
    """Every build, the one that the others are compared with first."""
    yield REFERENCE
    for compiler in ("gcc", "clang"):
        for level in LEVELS:
            build = Build(HOST.name, compiler, level, FULL)
            if build != REFERENCE:
                yield build
        yield Build(HOST.name, compiler, "-O3 -mavx2 -mfma", FULL)
        yield Build(HOST.name, compiler, "-O2 -DNOSLIP_SOFT", FULL)
    yield Build(HOST.name, "gcc", "-O3 -mfma -std=gnu11 -ffp-contract=fast", FULL)
    yield Build(HOST.name, "clang", "-O3 -mfma -std=gnu11 -ffp-contract=on", FULL)
    for name, target in TARGETS.items():
        if target.compiler and target.machine:
            levels = LEVELS if name == "cortex-m4f" else ("-O2",)
            yield from (
                Build(name, target.compiler, level, FULL if level == "-O2" else FEW) for level in levels
            )
            yield from (Build(name, "clang", level) for level in levels)
    yield from (Build("wasm32", "clang", level, FULL) for level in LEVELS)


def targeted() -> list[Build]:
    """Of each target but the host one build at all states: what `make firmware-test` runs."""
    return [
        build
        for build in builds()
        if build.target != HOST.name and build.flags == "-O2" and build.states == FULL
    ]


WORTH_A_TEST = (  # each time; `make firmware-test` and `make bits` have the others
    Build("cortex-m4f", "arm-none-eabi-gcc", "-Os", TESTED),
    Build("cortex-m4f", "clang", "-O2", TESTED),
    # At -O2 its sums of doubles take longest of all to compile
    Build("rv32imafc", "riscv64-unknown-elf-gcc", "-O0", TESTED),
    Build(HOST.name, "clang", "-O2", TESTED),
    Build(HOST.name, "clang", "-O0", TESTED),
    Build(HOST.name, "gcc", "-O0", TESTED),
    Build(HOST.name, "gcc", "-O2 -mavx2 -mfma", TESTED),
    Build("cortex-m4f", "arm-none-eabi-gcc", "-O2 -std=gnu11 -ffp-contract=fast", TESTED),
)


@pytest.fixture(scope="module")
def laws(built):
    """Objects of all but law_digest.c, of host and gcc -O2."""
    return built(HOST_CC, "-O2")


@pytest.fixture(scope="module")
def reference(laws, tmp_path_factory):
    """The digest of host and gcc -O2."""
    return replace(REFERENCE, states=TESTED).digest(tmp_path_factory.mktemp("reference"), DIGEST, laws)


@pytest.mark.parametrize("build", WORTH_A_TEST, ids=str)
def test_bits(build, reference, built, tmp_path):
    """Of the host and a plain level the laws are there already."""
    if build.missing and required():
        pytest.fail(build.missing)
    if build.missing or build.unsuited:
        pytest.skip(build.missing or build.unsuited)
    there = build.target == HOST.name and build.flags in LEVELS
    digest = (
        build.digest(tmp_path, DIGEST, built(build.compiler, build.flags))
        if there
        else build.digest(tmp_path)
    )
    assert same(digest, reference)


def test_every_law_is_compared():
    text = (DRIVERS / "law_digest.c").read_text()
    assert LAWS and all(re.search(rf"#define LAW {law}\n", text) and f"bits_{law}," in text for law in LAWS)
    assert all(f"bits_{law}_f," in text for law in LAWS)


def test_most_steps_are_good(reference):
    """What is compared is mostly answers; the rest are errors of all kinds. This host's sums are rounded
    right."""
    _, in_float, _, in_double, _, sums = reference
    for good in (int(in_float, 16), int(in_double, 16)):
        # And a vehicle on a path, its filter, what it learns, a course, a balancer, disturbances
        parts = len(LAWS) + 6
        assert 0.85 < good / (TESTED * parts) < 1
    assert sums == "1"


MAGNITUDES = """
#include <stdio.h>
#include "noslip_real.h"
int main(void)
{
    static const double x[] = {0.0, -0.0, 1.0, -1.0, 1.5, 1e-310, 1e-44, 3e38, 1e308, 1e999, -1e999,
        1e999 * 0.0};
    unsigned i, k;
    for (i = 0; i < sizeof x / sizeof *x; i++) {
        const float f = (float)x[i];
        printf("%d%d", noslip_is_finite(x[i]), noslip_is_finite_f(f));
        for (k = 0; k < sizeof x / sizeof *x; k++) {
            printf("%d%d", k == 1 || noslip_within(x[i], x[k]), /* not -0 */
                k == 1 || noslip_within_f(f, (float)x[k]));
        }
    }
    return 0;
}
"""


def test_magnitudes_are_compared_alike_as_integers(tmp_path):
    """Of numbers of all kinds, in both scalars: what a processor without an FPU answers is what this one
    does."""
    (tmp_path / "magnitudes.c").write_text(MAGNITUDES)
    answers = []
    for flags in ([], ["-DNOSLIP_SOFT"]):
        run([HOST_CC, *STANDARD, *flags, *INCLUDE, "magnitudes.c", "-o", "magnitudes"], tmp_path)
        answers.append(run(["./magnitudes"], tmp_path))
    assert answers[0] == answers[1] and {"0", "1"} == set(answers[0])


NO_LIMIT = """
#include <stdio.h>
#include "labmate_type_i@.h"
#include "noslip_adaptation.h"
#include "noslip_disturbance.h"
#include "noslip_integral.h"
#include "noslip_motor.h"
static labmate_state@ state; /* zero */
static labmate_type_i_reference@ reference;
int main(void)
{
    const REAL zero = ZERO, start = (REAL)0.5, limits[2] = {ZERO, ZERO}, two[2] = {2, 2};
    labmate_params@ params;
    noslip_adaptation_options@ options = {(REAL)0.5, 1, ZERO, 0, 1, 1};
    noslip_motor_settings@ good = {NOSLIP_MOTOR_DUTY, 1, 1, 1, 1, 0, 0, 1, 1, 1, 1}, bad[2];
    labmate_type_i_config@ config = {1};
    labmate_type_i_gains@ gains = {1, 1, 1, 1};
    labmate_options@ of_law = {0};
    labmate_type_i@ law;
    noslip_adaptation@ adaptation;
    noslip_disturbance@ disturbance;
    noslip_integral@ integral;
    noslip_motor@ motor;
    REAL tau[2];
    bad[0] = bad[1] = good;
    bad[0].current = bad[1].supply = zero;
    reference.x_l = 1000;
    of_law.limit[0] = of_law.limit[1] = zero;
    printf("%d ", labmate_default_params@(&params));
    printf("%d ", noslip_disturbance_init@(&disturbance, 1, zero));
    printf("%d ", noslip_disturbance_reset@(&disturbance, 5));
    printf("%d ", noslip_integral_init@(&integral, 2, zero));
    printf("%d ", noslip_integral_reset@(&integral, 5));
    printf("%d ", noslip_integral_update@(&integral, 3, zero, 1));
    printf("%d ", noslip_integral_reset@(&integral, 7));
    printf("%d ", labmate_type_i_init@(&law, &params, &config, &gains, &of_law));
    printf("%d ", labmate_type_i_step@(&law, &state, &reference, tau));
    printf("%d ", labmate_type_i_set_limits@(&law, two));
    printf("%d ", labmate_type_i_step@(&law, &state, &reference, tau) == NOSLIP_SATURATED);
    printf("%d ", labmate_type_i_set_limits@(&law, limits));
    printf("%d ", labmate_type_i_step@(&law, &state, &reference, tau));
    printf("%d ", noslip_adaptation_init@(&adaptation, &options, &start, 1, 1));
    printf("%d%d ", noslip_within@(0, adaptation.options.dead_zone),
        noslip_within@(1, adaptation.options.dead_zone));
    printf("%d ", noslip_motor_init@(&motor, &bad[0]) == NOSLIP_BAD_PARAMETER);
    printf("%d ", noslip_motor_init@(&motor, &bad[1]) == NOSLIP_BAD_PARAMETER);
    printf("%d ", noslip_motor_init@(&motor, &good));
    printf("%d", noslip_motor_set_supply@(&motor, zero) == NOSLIP_BAD_PARAMETER);
    return 0;
}
"""


@pytest.mark.parametrize("suffix", ["", "_f"])
@pytest.mark.parametrize("zero", ["0.0", "-0.0"])
def test_a_limit_of_minus_zero_is_one_of_zero(zero, suffix, tmp_path):
    """Where a public limit of 0 means none, -0 does; where it is refused,
    -0 is. With integers it would be above all numbers."""
    real = "float" if suffix else "double"
    text = NO_LIMIT.replace("@", suffix).replace("REAL", real).replace("ZERO", f"({real}){zero}")
    (tmp_path / "no_limit.c").write_text(text)
    used = [
        *sorted(RUNTIME.glob("*.c")),
        GENERATED / f"labmate{suffix}.c",
        GENERATED / f"labmate_type_i{suffix}.c",
    ]
    for flags in ([], ["-DNOSLIP_SOFT"]):
        run([HOST_CC, *STANDARD, *flags, *INCLUDE, "no_limit.c", *map(str, used), "-o", "no_limit"], tmp_path)
        assert run(["./no_limit"], tmp_path).split() == "0 0 0 0 0 0 0 0 0 0 1 0 0 0 10 1 1 0 1".split()


@pytest.mark.nightly
def test_digest_notices_fused_operations(reference, laws, tmp_path):
    """In one law, and in sine, cosine and root; in a copy without the pragma that forbids them."""
    build = Build(HOST.name, "gcc", "-O2 -mfma -std=gnu11 -ffp-contract=fast", TESTED)
    if build.missing or build.unsuited:
        pytest.skip(build.missing or build.unsuited)
    one = [source for source in SOURCES if source.stem in ("labmate_type_i", "labmate_type_i_f")]
    others = [code for code in laws if Path(code).stem not in [source.stem for source in one]]
    for path in RUNTIME.iterdir():  # found before those of INCLUDE
        Path(tmp_path, path.name).write_text(
            re.sub(r"#pragma GCC optimize.*\n", "", path.read_text()), encoding="utf-8"
        )
    fused, right = build.digest(tmp_path, [*DIGEST, *one], others), reference
    assert all(fused[k] != right[k] for k in (0, 2, 4)) and not same(fused, right)


def table(every: Sequence[Build], jobs: int = 2) -> tuple[int, int]:
    """Prints a line for every build as it ends. Answers how many differ, fail, or are missing though
    required, and how many are skipped."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:

        def digest(build: Build) -> list[str] | str:
            if build.missing or build.unsuited:
                return f"skipped: {build.missing or build.unsuited}"
            try:
                return build.digest(Path(tempfile.mkdtemp(dir=folder)))
            except (AssertionError, subprocess.TimeoutExpired) as error:
                return f"FAILED: {error}"

        counts = dict.fromkeys(n for build in every for n in (build.states, build.doubles))
        references = {n: pool.submit(digest, replace(REFERENCE, states=n)) for n in counts}

        def right(build: Build) -> list[str]:
            """What the reference answers; in double at other states than in float,
            where a target asks for that."""
            in_float, in_double = references[build.states].result(), references[build.doubles].result()
            return [*in_float[:2], *in_double[2:4], *in_float[4:]]

        wrong = skipped = 0
        print(
            f"{'target':11}{'compiler':24}{'flags':24}states; digests in float, in double, of sines and roots"
        )
        for build, answer in zip(every, pool.map(digest, every), strict=True):
            note = ""
            if isinstance(answer, str):
                wrong += answer.startswith("FAILED") or bool(build.missing and required())
                skipped += answer.startswith("skipped")
                text = answer
            else:
                known = right(build)
                if not same(answer, known):
                    wrong, note = wrong + 1, "  DIFFERS"
                elif answer[2:4] != known[2:4]:
                    note = "  (double not compared: this target's sums of doubles are not rounded right)"
                few = f" ({build.doubles} in double)" if build.doubles < build.states else ""
                text = f"{build.states} states{few}, digest {answer[0]} {answer[2]} {answer[4]}{note}"
            print(f"{build.name:11}{build.compiler:24}{build.flags:24}{text}", flush=True)
    return wrong, skipped


def main() -> int:
    """Every build; 1 if one is wrong."""
    every = list(builds())
    wrong, skipped = table(every)
    print(
        f"{wrong} wrong" if wrong else f"{len(every) - skipped} builds, one digest",
        f"{skipped} skipped",
        sep=", ",
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())

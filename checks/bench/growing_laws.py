"""Cost of Type I of a tractor with N trailers: instructions of a step with all guards, and bytes of its code.

Beside it, a loop written by hand, hand/trailers.inc, which has no guards: both give the same torques, up to rounding. The
bytes are those of the file of the law, float, for a Cortex-M4F.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

from measure import BENCH, COMMON, LANGUAGE, M4F, RUNTIME, _inclusive, run
from noslip.codegen.files import law_program, law_text, shared_files
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.program import Program
from noslip.model.law import control_law
from noslip.model.outputs import output_map
from noslip.model.reduction import reduce
from noslip.model.robots.tractor_trailer import tractor_trailer
from programs import ONCE

TRAILERS = (1, 2, 4, 8, 16, 32)
COUNT = 256
WITHIN = 1.15  # of the hand-written loop, with guards
TOLERANCE = {"double": 1e-9, "float": 2e-3}  # relative to 1000 N m + the torque; only rejects wrong programs
L = 0.7  # m


def law(trailers: int) -> Program:
    """Return Type I of the tractor with its trailers."""
    system = reduce(tractor_trailer(trailers))
    return law_program(control_law(system, output_map(system, "type_i")))


def measure(program: Program, scalar: str, folder: Path) -> tuple[float, float]:
    """Return the instructions of a step of ours and of the loop by hand. Raises RuntimeError if they differ."""
    folder.mkdir(parents=True, exist_ok=True)
    real = SCALARS[scalar]
    system, text = program.law.system, law_text(program, real)
    files = shared_files(system, real) | text.files()
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8")
    size, trailers = len(system.state), len(system.mechanism.coordinates) - 5
    robot, prefix = real.name, text.prefix
    params = robot(f"{system.mechanism.name}_params")
    (folder / "main.c").write_text(f"""#include "{text.type}.h"
#include "trailers.h"

static {scalar} states[{COUNT}][{size}], wanted[{COUNT}][6], ours[{COUNT}][2], hand[{COUNT}][2];

{ONCE} void by_us({text.type} *law, int i)
{{
    (void){text.function("step")}(law, (const {text.state_type} *)states[i],
        (const {robot(f"{prefix}_reference")} *)wanted[i], ours[i]);
}}

{ONCE} void by_hand(const {robot("hand_trailers_law")} *law, int i)
{{
    {robot("hand_trailers_step")}(law, states[i], wanted[i], hand[i]);
}}

int main(void)
{{
    const {scalar} gains[] = {{1, 2, 3, 4}};
    const {robot(f"{prefix}_config")} config = {{{real.literal(L)}}};
    {params} params;
    {text.type} law;
    {robot("hand_trailers_law")} loop;
    unsigned long long seed = 1992;
    int i, k;
    if ({robot(f"{system.mechanism.name}_default_params")}(&params) < 0 || {text.function("init")}(&law, &params, &config,
        (const {robot(f"{prefix}_gains")} *)gains, 0) < 0) {{
        return 1;
    }}
    {robot("hand_trailers_law_init")}(&loop, (const {scalar} *)&params, {real.literal(L)}, gains, {trailers});
    for (i = 0; i < {COUNT}; i++) {{
        for (k = 0; k < {size} + 6; k++) {{
            seed = seed * 6364136223846793005ull + 1442695040888963407ull;
            *(k < {size} ? &states[i][k] : &wanted[i][k - {size}]) = ({scalar})((double)(seed >> 40) / (1 << 23) - 1) * 3;
        }}
        by_us(&law, i);
        by_hand(&loop, i);
        for (k = 0; k < 2; k++) {{
            const double size = hand[i][k] < 0 ? -hand[i][k] : hand[i][k], most = {TOLERANCE[scalar]} * (1000 + size);
            const double error = ours[i][k] - hand[i][k];
            if (!(error <= most && -error <= most)) {{
                return 2;
            }}
        }}
    }}
    return 0;
}}
""")
    sources = [*sorted(name for name in files if name.endswith(".c")), *map(str, sorted(RUNTIME.glob("*.c")))]
    flags = [flag for flag in ["-O2", *COMMON, *LANGUAGE["c"]] if "callgraph" not in flag]
    run(["gcc", *flags, f"-I{RUNTIME}", f"-I{BENCH / 'hand'}", "-I.", "main.c", *sources, "-lm", "-o", "image"], folder)
    command = ["valgrind", "--tool=callgrind", "-q", "--callgrind-out-file=counts", "--compress-strings=no", "--compress-pos=no"]
    done = run([*command, "./image"], folder, check=False)
    if done.returncode:
        raise RuntimeError(f"{folder}: exit {done.returncode}: the two laws differ {done.stderr}")
    counts = _inclusive((folder / "counts").read_text(encoding="utf-8"))
    return counts["by_us"] / COUNT, counts["by_hand"] / COUNT


def code_bytes(folder: Path, source: str) -> dict[str, int]:
    """Return the bytes of the code of a file for a Cortex-M4F, by optimization."""
    sizes = {}
    for level in ("-O2", "-Os"):
        run(["arm-none-eabi-gcc", "-std=c99", level, *M4F, f"-I{RUNTIME}", "-I.", "-c", source, "-o", "law.o"], folder)
        sizes[level] = int(run(["arm-none-eabi-size", "law.o"], folder).stdout.splitlines()[1].split()[0])
    return sizes


def main() -> int:
    """Print the table; return 1 if a step costs more than it may."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trailers", nargs="*", type=int, default=TRAILERS, help="numbers of trailers")
    args = parser.parse_args()
    worst = 0.0
    for trailers in args.trailers:
        program = law(trailers)
        with tempfile.TemporaryDirectory() as work:
            for scalar in SCALARS:
                place = Path(work) / scalar
                ours, hand = measure(program, scalar, place)
                worst = max(worst, ours / hand)
                print(f"N = {trailers:2} {scalar:6}: {ours:7.0f} with guards, {hand:7.0f} by hand: {ours / hand:.3f}", flush=True)
            if shutil.which("arm-none-eabi-gcc"):
                sizes = code_bytes(Path(work) / "float", f"{law_text(program, SCALARS['float']).type}.c")
                print("       " + ", ".join(f"{level} {size} bytes" for level, size in sizes.items()), flush=True)
    return int(worst > WITHIN)


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except subprocess.CalledProcessError as error:
        raise SystemExit(error.stderr) from error

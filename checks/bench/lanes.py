"""The batch law compared with a loop over the step, on this processor:
time of the loop as a multiple of that of the batch."""

from pathlib import Path

from cases import COUNT
from counting import run
from measure import RUNTIME
from noslip.codegen.files import law_program
from noslip.codegen.printing.lanes_c import LanesC
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.targets import STANDARD
from noslip.model.law import ControlLaw

FLAGS = ("-O3", "-mavx2", "-fno-math-errno", "-D_POSIX_C_SOURCE=200809L", "-w")
ROUNDS, CALLS = 200, 20  # the shortest round counts
WANTED = {"double": 3.5, "float": 6.0}
MAIN = """
#include <stdio.h>
#include <string.h>
#include <time.h>
#include "{prefix}_steps{suffix}.h"
#include "cases_{real}.h"
static {real} state[{states}][{count}], reference[{references}][{count}], batch[2][{count}],
    single[{count}][2];
static int statuses[{count}];
static double now(void)
{{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}}
int main(void)
{{
    static {prefix}{suffix} law;
    double least[2] = {{1e9, 1e9}};
    int i, k, round, call;
    if ({prefix}_init{suffix}(&law, (void *){law}_params, (void *){law}_config, (void *){law}_gains, NULL)) {{
        return 1;
    }}
    for (i = 0; i < {count}; i++) {{
        for (k = 0; k < {states}; k++) state[k][i] = {law}_state[i][k];
        for (k = 0; k < {references}; k++) reference[k][i] = {law}_reference[i][k];
    }}
    for (round = 0; round < {rounds}; round++) {{
        double time[3];
        time[0] = now();
        for (call = 0; call < {calls}; call++)
            for (i = 0; i < {count}; i++)
                {prefix}_step{suffix}(&law, (void *){law}_state[i], (void *){law}_reference[i], single[i]);
        time[1] = now();
        for (call = 0; call < {calls}; call++)
            {prefix}_steps{suffix}(&law, {count}, state[0], reference[0], batch[0], statuses);
        time[2] = now();
        for (k = 0; k < 2; k++) {{
            least[k] = time[k + 1] - time[k] < least[k] ? time[k + 1] - time[k] : least[k];
        }}
    }}
    for (i = 0; i < {count}; i++)
        if (memcmp(&batch[0][i], &single[i][0], sizeof({real})) ||
            memcmp(&batch[1][i], &single[i][1], sizeof({real}))) return 2;
    printf("%.17g\\n", least[0] / least[1]);
    return 0;
}}
"""


def measure(laws: list[ControlLaw], shared: Path, work: Path) -> dict[str, dict[str, float]]:
    """Return law -> scalar -> ratio; nothing if this processor does not have the instructions. `shared`:
    laws and cases."""
    work.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, float]] = {}
    for law in laws:
        for name, scalar in SCALARS.items():
            lanes = LanesC(law_program(law), scalar, ["for the bench"])
            for file, text in lanes.files().items():
                (work / Path(file).name).write_text(text, encoding="utf-8")
            sizes = {
                "states": len(law.state),
                "references": len(law.reference),
                "count": COUNT,
                "rounds": ROUNDS,
                "calls": CALLS,
            }
            names = {"prefix": lanes.prefix, "suffix": scalar.suffix, "law": law.name, "real": name}
            (work / "main.c").write_text(MAIN.format(**sizes, **names), encoding="utf-8")
            given = (lanes.type, scalar.name(lanes.robot), f"cases_{law.name}_{name}")
            sources = [
                "main.c",
                f"{lanes.function('steps')}.c",
                RUNTIME / "noslip_status.c",
                *(shared / f"{file}.c" for file in given),
            ]
            includes = [f"-I{place}" for place in (".", RUNTIME, shared)]
            run(["gcc", *STANDARD, *FLAGS, *includes, *map(str, sources), "-o", "lanes"], work)
            done = run([str(work / "lanes")], work, check=False)
            if done.returncode:
                return {}
            found.setdefault(law.name, {})[name] = round(float(done.stdout), 2)
    return found


def table(result: dict[str, dict[str, float]]) -> str:
    """Return the ratios as text."""
    wanted = ", ".join(f"{scalar} {ratio:g}" for scalar, ratio in WANTED.items())
    lines = [f"batch law, AVX2, one core: a loop over step takes so many times as long (wanted: {wanted})"]
    lines += [
        f"  {law}: " + ", ".join(f"{scalar} {ratio:.2f}" for scalar, ratio in one.items())
        for law, one in result.items()
    ]
    return "\n".join(lines)

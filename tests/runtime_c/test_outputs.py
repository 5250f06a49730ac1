"""Outputs are written once, at the end: a task that reads them meanwhile sees no intermediate value."""

import shutil
import subprocess
from pathlib import Path

import noslip
import pytest
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import STANDARD
from noslip.tests.tools import HOST_CC, need

ROOT = Path(noslip.__file__).parent
DRIVERS = ROOT / "tests" / "c"
GENERATED = [f"labmate{name}_f.c" for name in ("", "_dynamics", "_type_iv_segment")]
FLAGS = [*STANDARD, "-Wall", "-Wextra", "-Werror", "-Wno-tsan"]
AS_THEY_COMPUTE = {"evaluate", "dynamics"}  # for looking, not for control: noslip_status.h says so
STEP = "        status = labmate_type_iv_segment_step_f_law(self, state, reference, made);\n"


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """A copy of the C, to be changed by nobody."""
    return copied(tmp_path_factory.mktemp("sources"))


def copied(folder: Path) -> Path:
    shutil.copytree(RUNTIME, folder, dirs_exist_ok=True)
    for path in (ROOT / "generated" / "labmate").glob("*_f.*"):
        shutil.copy(path, folder)
    return folder


def built(driver: str, sources: Path, folder: Path, level: str, link: list[str]) -> Path:
    """A driver and the C that it calls, with the sanitizer's calls in them."""
    files = [
        DRIVERS / driver,
        *(sources / name for name in (*GENERATED, "noslip_path_f.c", "noslip_status.c")),
    ]
    command = [
        need("gcc"),
        *FLAGS,
        level,
        "-fsanitize=thread",
        f"-I{sources}",
        f"-I{DRIVERS}",
        "-c",
        *map(str, files),
    ]
    subprocess.run(command, cwd=folder, check=True)
    objects = [str(path) for path in folder.glob("*.o")]
    subprocess.run(
        ["gcc", *FLAGS, f"-I{DRIVERS}", *objects, *link, "-lm", "-o", "program"], cwd=folder, check=True
    )
    return folder / "program"


def counted(sources: Path, folder: Path, level: str) -> dict[str, tuple[int, int]]:
    """Entry point -> calls that wrote a number more than once, and calls that were good."""
    program = built("outputs_calls.c", sources, folder, level, [str(DRIVERS / "outputs.c")])
    lines = subprocess.run([program], capture_output=True, text=True, check=True).stdout.splitlines()
    return {name: (int(twice), int(good)) for name, twice, good in map(str.split, lines)}


@pytest.mark.parametrize("level", ["-O0", "-O2"])
def test_every_number_is_written_once(level, sources, tmp_path):
    counts = counted(sources, tmp_path, level)
    assert len(counts) == 31 and {name for name, (twice, _) in counts.items() if twice} <= AS_THEY_COMPUTE, (
        counts
    )
    assert all(0 < good for _, good in counts.values()), counts


def test_an_intermediate_value_is_found(tmp_path):
    """The torque before it is cut, in the output."""
    sources = copied(tmp_path / "sources")
    source = sources / "labmate_type_iv_segment_f.c"
    text = source.read_text()
    assert STEP in text
    source.write_text(text.replace(STEP, f"{STEP}        tau[0] = made[0];\n"))
    counts = counted(sources, tmp_path, "-O0")
    assert counts["step"][0] > 100 and counts["follow"][0] == 0


def test_a_second_thread_sees_limited_inputs(sources, tmp_path):
    """And ThreadSanitizer no memory that two controllers share."""
    program = built("outputs_thread.c", sources, tmp_path, "-O1", ["-fsanitize=thread", "-pthread"])
    command = [*(["setarch", "-R"] if shutil.which("setarch") else []), str(program)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if "unexpected memory mapping" in process.stderr:
        pytest.skip("ThreadSanitizer does not run on this machine")
    assert process.returncode == 0 and process.stdout == "1 0\n", process.stdout + process.stderr


def test_an_output_may_lie_in_an_input(sources, tmp_path):
    """The torques in the state, the reference and the foot, and what feedback makes in what is demanded."""
    (tmp_path / "alias.c").write_text(r"""
#include <string.h>
#include "labmate_type_iv_segment_f.h"
int main(void)
{
    const labmate_type_iv_segment_config_f config = {0.25f, 0, 0, 0, 0.25f};
    const labmate_type_iv_segment_gains_f gains = {4, 4, 2};
    const labmate_options_f options = {.limit = {7, 2}, .on_limit = NOSLIP_SLOW};
    labmate_params_f params;
    labmate_type_iv_segment_f law, again;
    int k, wrong = labmate_default_params_f(&params);
    wrong += labmate_type_iv_segment_init_f(&law, &params, &config, &gains, &options);
    for (k = 0; k < 60; k++) {
        const float y = (float)(k - 30) * 0.2f;
        const labmate_state_f state = {0.1f, y, 0.3f, 1, 2, 3.0f, 2.5f};
        const noslip_foot_f foot = {y, 0.96f, 0.28f, 0.1f};
        const labmate_type_iv_segment_reference_f reference = {0, 0, 0, 1, 0};
        labmate_state_f in_state = state;
        noslip_foot_f in_foot = foot;
        labmate_type_iv_segment_reference_f in_reference = reference;
        float tau[2], v[2] = {1, y}, in_v[2] = {1, y};
        int status;
        again = law;
        status = labmate_type_iv_segment_step_f(&law, &state, &reference, tau);
        wrong += labmate_type_iv_segment_step_f(&again, &in_state, &reference, &in_state.x_c) != status;
        wrong += memcmp(tau, &in_state.x_c, sizeof tau) != 0;
        wrong += labmate_type_iv_segment_step_f(&again, &state, &in_reference, &in_reference.distance)
                 != status;
        wrong += memcmp(tau, &in_reference.distance, sizeof tau) != 0;
        status = labmate_type_iv_segment_follow_f(&law, &foot, &state, &reference, tau);
        wrong += labmate_type_iv_segment_follow_f(&again, &in_foot, &state, &reference, &in_foot.distance)
                 != status;
        wrong += memcmp(tau, &in_foot.distance, sizeof tau) != 0;
        status = labmate_type_iv_segment_feedback_f(&law, &state, v, tau);
        wrong += labmate_type_iv_segment_feedback_f(&again, &state, in_v, in_v) != status;
        wrong += memcmp(tau, in_v, sizeof tau) != 0;
    }
    return wrong;
}
""")
    files = [str(sources / name) for name in (*GENERATED, "noslip_status.c")]
    for level in ("-O0", "-O3"):
        subprocess.run(
            [HOST_CC, "-std=c99", level, f"-I{sources}", "alias.c", *files, "-o", "alias"],
            cwd=tmp_path,
            check=True,
        )
        assert subprocess.run([tmp_path / "alias"]).returncode == 0

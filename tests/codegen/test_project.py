"""Exported firmware projects: they build with no Python around, and their self-test finds a wrong bit."""

import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from noslip.checks.verification.project import FIRMWARE, STEPS, _golden, _limits
from noslip.cli.main import main
from noslip.codegen.printing.scalar import SCALARS
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.compiled import CompiledController
from noslip.simulation.controllers.controller import Limits
from noslip.tests.tools import HOST_CC, need, skip_without

LAWS = ("type_iv_circle", "type_i")
NUMBER = r"(-?\d+\.\d+(?:e[-+]?\d+)?)f"
# Of a good step, and how far off it may be
TAU = re.compile(rf"\{{{NUMBER}, {NUMBER}\}}, {NUMBER}, ([01])\}},")
DIGEST = re.compile(r"digest != 0x([0-9a-f]{8})u")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The folder of a target's project, and how its first `make` ended."""

    @cache
    def exported(target: str) -> tuple[Path, subprocess.CompletedProcess]:
        folder = tmp_path_factory.mktemp("export") / "robot"
        outputs = [word for law in LAWS for word in ("--output", law)]
        assert main(["export", "labmate", *outputs, "--firmware", target, "-o", str(folder)]) == 0
        # Measured, then cleaned
        assert not any(path.suffix in (".o", ".su", ".elf", ".a") for path in folder.rglob("*"))
        return folder, make(folder)

    return exported


@pytest.fixture(params=list(FIRMWARE))
def project(request, exported):
    """The folder of a target's project, and its name."""
    skip_without(FIRMWARE[request.param].missing("make"))
    return exported(request.param)[0], request.param


def make(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """`make` with nothing of this process's environment but the path to the tools."""
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin"}
    command = ["make", "-s", "-C", str(folder), *arguments]
    return subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, env=environment
    )


def test_builds_and_passes(project, exported):
    """Without a warning; each law says so, and what a step took where that is counted."""
    folder, name = project
    (_, everything), tried = exported(name), make(folder, "test")
    assert everything.returncode == tried.returncode == 0
    assert everything.stdout + everything.stderr == ""
    lines = tried.stdout.splitlines()
    assert lines[-2:] == ["route: pass", "selftest: pass"] and len(lines) == len(LAWS) + 2
    for line, law in zip(lines, LAWS, strict=False):
        assert line.startswith(f"labmate_{law}_f: pass, steps {STEPS + 1}")
        counted = re.search(r"instructions of one (\d+)", line)
        assert (counted is None) == (name == "generic")
        assert counted is None or 100 < int(counted[1]) < 300
        assert line in (folder / "README.md").read_text()


def changed(folder: Path, place: Path, pattern: re.Pattern, new) -> subprocess.CompletedProcess:
    """The self-test of a copy of the project, after a change of its source."""
    shutil.copytree(folder, place)
    source = place / "selftest" / "selftest.c"
    text, count = pattern.subn(new, source.read_text(), count=1)
    assert count == 1
    source.write_text(text)
    tried = make(place, "test")
    # make's own code for a recipe that failed
    assert tried.returncode == 2 and tried.stdout.endswith("selftest: FAIL\n")
    assert f"labmate_{LAWS[1]}_f: pass" in tried.stdout
    return tried


def too_far_off(row: re.Match) -> str:
    """A golden step whose first input is off by more than it may be."""
    return f"{{{float(row[1]) + 1.5 * float(row[3])!r}f, {row[2]}f}}, {row[3]}f, {row[4]}}},"


def test_finds_a_wrong_value(project, tmp_path):
    """A value that is off by more than it may be."""
    tried = changed(project[0], tmp_path / "copy", TAU, too_far_off)
    assert f"labmate_{LAWS[0]}_f: FAIL at step 1, which is not the model" in tried.stdout


def test_finds_a_wrong_bit(project, tmp_path):
    tried = changed(project[0], tmp_path / "copy", DIGEST, lambda m: f"digest != 0x{int(m[1], 16) ^ 1:08x}u")
    assert f"labmate_{LAWS[0]}_f: FAIL, the model, but with other bits" in tried.stdout


def test_golden_steps_include_an_error(project):
    text = (project[0] / "selftest" / "selftest.c").read_text()
    assert text.count("{0.0f, 0.0f}, 0.0f, -2},") == len(LAWS)  # NOSLIP_NONFINITE, and zeros


@pytest.mark.parametrize("scalar", SCALARS)
def test_golden_vectors_are_the_models(scalar, monkeypatch):
    """Whatever the C computes; only the digest is the C's."""
    law = law_of(find_robot("labmate"), "type_i")
    right = _golden(law, scalar)
    monkeypatch.setattr(CompiledController, "step", lambda *_: ("ok", np.ones(2)))
    again = _golden(law, scalar)
    assert again.digest != right.digest and len(right.steps) == STEPS + 1
    model = make_controller(
        "casadi", law, right.params, right.config, right.gains, Limits(tuple(right.limits))
    )
    for step, other in zip(right.steps[:-1], again.steps, strict=False):
        status, truth = model.step(np.array(step.state), np.array(step.reference))
        assert np.array_equal(step.tau, other.tau) and step.status == other.status == (
            "ok",
            "saturated",
        ).index(status)
        assert np.abs(step.tau - truth).max() <= 1e-12 * np.abs(truth).max()
        assert step.within <= (0.001 if scalar == "float" else 1e-9) * np.abs(truth).max()


@pytest.mark.nightly
@pytest.mark.parametrize("project", ["generic"], indirect=True)
def test_cpp_includes_it(project, tmp_path):
    need("g++")
    folder, _ = project
    headers = sorted(path.name for path in (folder / "noslip").glob("*.h"))
    robot = tmp_path / "robot.cpp"
    used = "labmate_params_f p; labmate_type_i_f law; (void)labmate_default_params_f(&p); "
    used += "return labmate_type_i_init_f(&law, &p, 0, 0, 0);"
    robot.write_text("".join(f'#include "{name}"\n' for name in headers) + f"int main() {{ {used} }}\n")
    command = [
        "g++",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{folder / 'noslip'}",
        str(robot),
        str(folder / "liblabmate.a"),
    ]
    subprocess.run([*command, "-o", str(tmp_path / "robot")], check=True)
    assert subprocess.run([tmp_path / "robot"]).returncode == 256 - 1  # NOSLIP_NULL: there is no config


def test_project_says_where_it_comes_from(project):
    folder, name = project
    manifest = json.loads((folder / "noslip" / "manifest.json").read_text())
    assert set(manifest["laws"]) == set(LAWS)
    assert all((folder / "noslip" / file).is_file() for file in manifest["files"])
    assert name in (folder / "README.md").read_text().splitlines()[0] or name == "generic"


def test_unknown_target(capsys):
    assert main(["export", "labmate", "--firmware", "z80", "-o", "nowhere"]) == 2
    said = capsys.readouterr().err
    assert "z80" in said and "cortex-m4f" in said and said.count("\n") == 1


def test_golden_steps_meet_limits(project):
    """Some are cut or slowed down, some are not."""
    text = (project[0] / "selftest" / "selftest.c").read_text()
    # Of type_iv_circle and of type_i
    assert text.count(".on_limit = NOSLIP_SLOW") == text.count(".on_limit = NOSLIP_CUT") == 1
    for law in text.split("static int test_")[1:]:
        statuses = [row[4] for row in TAU.finditer(law)]
        assert statuses.count("0") >= 3 and statuses.count("1") >= 3


def test_the_route_arrives(project, tmp_path):
    """The self-test's vehicle passes every piece, meets no error, and comes to the end of its path."""
    folder, _ = project
    (tmp_path / "route.c").write_text("""#include <stdio.h>
#define REAL float
#define OF(name) name##_f
#include "route.h"
int main(void)
{
    route self;
    unsigned tick, errors = 0, pieces = 0;
    route_begin(&self);
    for (tick = 0; tick < ROUTE_TICKS; tick++) {
        route_tick(&self, tick);
        errors += self.status < 0;
        pieces += (unsigned)self.path.guide.changed;
    }
    printf("%u %u %d %d\\n", errors, pieces, self.path.guide.arrived, route_digest() == self.digest);
    return 0;
}
""")
    sources = [
        str(tmp_path / "route.c"),
        *(str(folder / "noslip" / name) for name in ("noslip_path_f.c", "noslip_status.c")),
    ]
    include = [f"-I{folder / name}" for name in ("noslip", "selftest")]
    subprocess.run([HOST_CC, "-std=c99", *include, *sources, "-o", str(tmp_path / "route")], check=True)
    # 3 and the extension
    assert subprocess.run([tmp_path / "route"], capture_output=True, text=True).stdout == "0 4 1 1\n"


def cmake(*arguments: str | Path) -> None:
    subprocess.run(["cmake", *map(str, arguments)], check=True, capture_output=True, timeout=120)


@pytest.mark.nightly
def test_cmake_runs_the_selftest_where_it_belongs(project, tmp_path):
    """`ctest` runs an image in the emulator, and finds a wrong bit."""
    need("cmake")
    folder, name = project
    text = (folder / "CMakeLists.txt").read_text()
    cross = re.findall(r"-D\S+", text.splitlines()[0])
    build, copy = tmp_path / "build", tmp_path / "copy"
    shutil.copytree(folder, copy)
    cmake("-S", copy, "-B", build, *cross)
    cmake("--build", build)
    assert subprocess.run(["ctest"], cwd=build, stdin=subprocess.DEVNULL, capture_output=True).returncode == 0
    source = copy / "selftest" / "selftest.c"
    source.write_text(TAU.sub(too_far_off, source.read_text(), count=1))
    cmake("--build", build)
    done = subprocess.run(
        ["ctest", "-V"], cwd=build, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert done.returncode != 0 and "FAIL at step" in done.stdout


def test_cmake_leaves_the_users_flags_alone(project, tmp_path):
    """add_subdirectory in a project for this machine: the library is built for it too,
    and the application gets no option."""
    need("cmake")
    folder, _ = project
    (tmp_path / "CMakeLists.txt").write_text(
        f"cmake_minimum_required(VERSION 3.13)\nproject(yours C)\nadd_subdirectory({folder} labmate)\n"
        "add_executable(yours yours.c)\ntarget_link_libraries(yours labmate)\n"
    )
    main = "int main(void) { labmate_params_f p; return labmate_default_params_f(&p); }"
    (tmp_path / "yours.c").write_text(f'#include "labmate_type_i_f.h"\n{main}\n')
    cmake("-S", tmp_path, "-B", tmp_path / "build", "-DCMAKE_EXPORT_COMPILE_COMMANDS=1")
    cmake("--build", tmp_path / "build")
    assert subprocess.run([tmp_path / "build/yours"]).returncode == 0
    commands = json.loads((tmp_path / "build/compile_commands.json").read_text())
    own = next(entry["command"].split() for entry in commands if entry["file"].endswith("yours.c"))
    assert [word for word in own if word.startswith("-") and not word.startswith("-I")] == ["-o", "-c"]
    assert not any(entry["file"].endswith("selftest.c") for entry in commands)


@pytest.mark.parametrize("off", [1e-9, 1e-3])
def test_limits_of_the_selftest_are_beside_all_inputs(off):
    """Half of the inputs exceed them, where they differ; one that is always zero, or the same,
    has its limit above."""
    sizes = np.abs(np.random.default_rng(5).normal(size=(40, 3))) * [1.0, 0.0, 100.0]
    limits = _limits(np.hstack([sizes, np.full((40, 1), 7.0)]), off)
    assert (np.abs(sizes - limits[:3]) > off).all() and (limits > 0).all()
    assert [(sizes[:, k] > limits[k]).sum() for k in (0, 2)] == pytest.approx([20, 20], abs=2)
    assert limits[1] <= 10 * off and 7.0 + off < limits[3] < 15.0

"""Exported firmware projects: they build with no Python around, and their self-test finds a wrong bit."""

import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from noslip.harness.cli import main
from noslip.harness.project import FIRMWARE, STEPS
from noslip.harness.targets import required

LAWS = ("type_iv_circle", "type_i")
TAU = re.compile(r"(\{0x[0-9a-f]{7})([0-9a-f])(u, 0x[0-9a-f]{8}u\}, 0\},)")  # of a good step


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The folder of a target's project, and how its first `make` ended."""

    @cache
    def exported(target: str) -> tuple[Path, subprocess.CompletedProcess]:
        folder = tmp_path_factory.mktemp("export") / "robot"
        outputs = [word for law in LAWS for word in ("--output", law)]
        assert main(["export", "labmate", *outputs, "--firmware", target, "-o", str(folder)]) == 0
        assert not any(path.suffix in (".o", ".su", ".elf", ".a") for path in folder.rglob("*"))  # measured, then cleaned
        return folder, make(folder)

    return exported


@pytest.fixture(params=list(FIRMWARE))
def project(request, exported):
    """The folder of a target's project, and its name."""
    if absent := FIRMWARE[request.param].missing("make"):
        (pytest.fail if required() else pytest.skip)(f"{', '.join(absent)} not installed")
    return exported(request.param)[0], request.param


def make(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """`make` with nothing of this process's environment but the path to the tools."""
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin"}
    command = ["make", "-s", "-C", str(folder), *arguments]
    return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, env=environment)


def test_builds_and_passes(project, exported):
    """Without a warning; each law says so, and what a step took where that is counted."""
    folder, name = project
    (_, everything), tried = exported(name), make(folder, "test")
    assert everything.returncode == tried.returncode == 0
    assert everything.stdout + everything.stderr == ""
    lines = tried.stdout.splitlines()
    assert lines[-1] == "selftest: pass" and len(lines) == len(LAWS) + 1
    for line, law in zip(lines, LAWS, strict=False):
        assert line.startswith(f"labmate_{law}_f: pass, steps {STEPS + 1}")
        counted = re.search(r"instructions of one (\d+)", line)
        assert (counted is None) == (name == "generic")
        assert counted is None or 100 < int(counted[1]) < 300
        assert line in (folder / "README.md").read_text()


def test_finds_a_wrong_bit(project, tmp_path):
    folder, _ = project
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    source = copy / "selftest" / "selftest.c"
    source.write_text(TAU.sub(lambda m: f"{m[1]}{int(m[2], 16) ^ 1:x}{m[3]}", source.read_text(), count=1))
    tried = make(copy, "test")
    assert tried.returncode == 2 and "FAIL at step" in tried.stdout  # make's own code for a recipe that failed
    assert f"labmate_{LAWS[1]}_f: pass" in tried.stdout and tried.stdout.endswith("selftest: FAIL\n")


def test_golden_steps_include_an_error(project):
    text = (project[0] / "selftest" / "selftest.c").read_text()
    assert text.count("{0x00000000u, 0x00000000u}, -2},") == len(LAWS)  # NOSLIP_NONFINITE, and zeros


@pytest.mark.parametrize("project", ["generic"], indirect=True)
def test_cpp_includes_it(project, tmp_path):
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    folder, _ = project
    headers = sorted(path.name for path in (folder / "noslip").glob("*.h"))
    robot = tmp_path / "robot.cpp"
    used = "labmate_params_f p; labmate_type_i_f law; (void)labmate_default_params_f(&p); "
    used += "return labmate_type_i_init_f(&law, &p, 0, 0, 0);"
    robot.write_text("".join(f'#include "{name}"\n' for name in headers) + f"int main() {{ {used} }}\n")
    command = ["g++", "-Wall", "-Wextra", "-Werror", f"-I{folder / 'noslip'}", str(robot), str(folder / "liblabmate.a")]
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

"""What people get: the README's code, an exported folder, an installed wheel."""

import importlib.util
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
from pathlib import Path

import cffi
import noslip
import numpy as np
import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main
from noslip.codegen.printing.law_c import runtime_types
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import RUNTIME, runtime_files
from noslip.model.outputs import OUTPUTS
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.controllers.targets import TARGETS
from noslip.tests.cli import test_tutorial
from noslip.tests.tools import HOST_CC

ROOT = Path(noslip.__file__).parent
STRICT = (
    "-std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion "
    "-Wfloat-conversion -Wfloat-equal -Wshadow -Wundef -Wcast-qual -Wstrict-prototypes -Wvla -Werror"
).split()
SKIPPED = {".venv", "build", "__pycache__", ".git", ".pytest_cache", ".ruff_cache"}


def block(language: str, page: str = "README.md") -> str:
    """The one block of a page in this language that a comment says is tested here."""
    blocks = re.findall(
        rf"tests/cli/test_package.py -->\n```{language}\n(.*?)^```", (ROOT / page).read_text(), re.S | re.M
    )
    assert len(blocks) == 1
    return blocks[0]


def run(command: list[str], **options) -> str:
    """Standard output of a command that must succeed."""
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True, **options)
    assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"
    return result.stdout


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    """An exported folder of the circle law in float."""
    folder = tmp_path_factory.mktemp("export") / "new" / "noslip"
    assert (
        main(["export", "labmate", "--output", "type_iv_circle", "--scalar", "float", "-o", str(folder)]) == 0
    )
    return folder


# -- README --------------------------------------------------------------------------------------------------

BOARD = """
#include <stdio.h>
#include <stdlib.h>
static int ticks;
void wait_for_tick(void);
void read_state(labmate_state_f *state);
void set_torques(float right, float left);
void wait_for_tick(void) { if (ticks++ == 3) { exit(0); } }
void read_state(labmate_state_f *state)
{
    const labmate_state_f there = {.x_c = 30.3f, .y_c = 19.0f, .phi = 1.6f, .thetadot_r = 9.0f,
        .thetadot_l = 9.0f};
    *state = there;
    if (ticks == 2) { state->x_c /= (float)(ticks - 2); }
}
void set_torques(float right, float left) { printf("%.9g %.9g\\n", (double)right, (double)left); }
"""


@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_readme_firmware(cc, exported, tmp_path):
    """The loop compiles without a warning, links with an export and a board's functions,
    and answers sensible torques."""
    code = block("c")
    assert len(code.splitlines()) <= 45
    (tmp_path / "main.c").write_text(code)
    (tmp_path / "board.c").write_text('#include "labmate_type_iv_circle_f.h"\n' + BOARD)
    sources = [path for path in exported.glob("*.c") if path.name != "example.c"]
    program = tmp_path / "firmware"
    run([cc, *STRICT, f"-I{exported}", *sources, tmp_path / "main.c", tmp_path / "board.c", "-o", program])
    first, second, third = (list(map(float, line.split())) for line in run([program]).splitlines())
    assert first == third and second == [0.0, 0.0]  # the state was not finite
    assert all(0 < abs(torque) < 20 for torque in first)


TOWARDS_THE_CENTRE = """
#include <math.h>
#include <stdio.h>
#include "labmate_type_iv_circle_f.h"
int main(void)
{
    const labmate_type_iv_circle_config_f circle = {.L = 0.0f, .x_f = 20.0f, .y_f = 20.0f, .R = 10.0f};
    const labmate_type_iv_circle_gains_f gains = {.kp_distance = 1.0f, .kd_distance = 2.5f, .kv_speed = 2.0f};
    const labmate_type_iv_circle_reference_f reference = {.speed = 1.4f};
    labmate_params_f params;
    labmate_type_iv_circle_f law;
    int k;
    (void)labmate_default_params_f(&params);
    if (labmate_type_iv_circle_init_f(&law, &params, &circle, &gains, NULL) < 0) { return 1; }
    for (k = 0; k < 400; k++) {
        const double angle = k * 6.283185307179586 / 400, away = k % 3 ? 12 : 4, rate = k % 5 ? 0 : 3;
        const labmate_state_f state = {.x_c = (float)(20 + away * cos(angle)),
            .y_c = (float)(20 + away * sin(angle)),
            .phi = (float)(k % 2 ? angle : angle + 3.141592653589793), .thetadot_r = (float)rate,
                .thetadot_l = (float)rate};
        float tau[2] = {1.0f, 1.0f};
        const int status = labmate_type_iv_circle_step_f(&law, &state, &reference, tau);
        printf("%s %g %g\\n", noslip_status_name(status), (double)tau[0], (double)tau[1]);
    }
    return 0;
}
"""


def test_readme_nose_at_the_centre(exported, tmp_path):
    """As the README says: wherever the robot is, at rest or not, the law answers that it is singular,
    without torques."""
    (tmp_path / "main.c").write_text(TOWARDS_THE_CENTRE)
    sources = [exported / f"{name}.c" for name in ("labmate_type_iv_circle_f", "labmate_f", "noslip_status")]
    run([HOST_CC, "-std=c99", f"-I{exported}", *sources, tmp_path / "main.c", "-lm", "-o", tmp_path / "main"])
    assert run([tmp_path / "main"]).splitlines() == ["singular 0 0"] * 400


def test_readme_names_the_files_to_compile(tmp_path):
    """The command as printed, in a folder that has what it names."""
    (tmp_path / "main.c").write_text(block("c"))
    (tmp_path / "board.c").write_text('#include "labmate_type_iv_circle_f.h"\n' + BOARD)
    for name in ("generated", "runtime_c"):
        (tmp_path / name).symlink_to(ROOT / name)
    run(["sh", "-ec", block("sh")], cwd=tmp_path)
    assert len(run([tmp_path / "vehicle"]).splitlines()) == 3


def test_citation():
    """CITATION.cff and CITATION.bib have the package's version, one date,
    and the address that pyproject.toml may state."""
    cff, bibtex = ((ROOT / f"CITATION.{kind}").read_text() for kind in ("cff", "bib"))
    assert f"\nversion: {noslip.__version__}\n" in cff and f"  version = {{{noslip.__version__}}}\n" in bibtex
    assert re.findall(r"^date-released: (.*)", cff, re.M) == re.findall(r"date += \{(.*)\}", bibtex)
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"].get("urls", {}).get("Repository")
    assert (
        re.findall(r"^repository-code: (.*)", cff, re.M)
        == re.findall(r"url += \{(.*)\}", bibtex)
        == [stated] * bool(stated)
    )


ROLLING_BOARD = """
#include <stdio.h>
#include <stdlib.h>
#define PERIOD 0.01f
static float rate[2];
static int ticks;
void wait_for_tick(void);
void read_wheels(float turned[2]);
void set_torques(float right, float left);
void wait_for_tick(void) { if (ticks++ == TICKS) { exit(0); } }
void read_wheels(float turned[2]) { turned[0] = rate[0] * PERIOD; turned[1] = rate[1] * PERIOD; }
void set_torques(float right, float left)
{
    /* S'MS of the default parameters, without the bias: a robot that is not quite the model */
    const float same = 0.27f, other = 0.10f;
    const float determinant = same * same - other * other;
    rate[0] += PERIOD * (same * right - other * left) / determinant;
    rate[1] += PERIOD * (same * left - other * right) / determinant;
    if (ticks % PRINTED == 0) { printf("%.9g %.9g\\n", (double)rate[0], (double)rate[1]); }
}
"""


def drive(loop: str, cc: str, ticks: int, printed: int, folder: Path) -> list[list[float]]:
    """What a loop prints on a board that stops it: the wheels' rates, rad/s, once every `printed` ticks."""
    exported = folder / "segment"
    assert (
        main(["export", "labmate", "--output", "type_iv_segment", "--scalar", "float", "-o", str(exported)])
        == 0
    )
    (folder / "main.c").write_text(loop)
    (folder / "board.c").write_text(ROLLING_BOARD)
    sources = [path for path in exported.glob("*.c") if path.name != "example.c"]
    sources += [folder / "main.c", folder / "board.c"]
    program = folder / "firmware"
    flags = [f"-DTICKS={ticks}", f"-DPRINTED={printed}", f"-I{exported}"]
    run([cc, *STRICT, *flags, *sources, "-o", program])
    return [list(map(float, line.split())) for line in run([program]).splitlines()]


@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_path_firmware(cc, tmp_path):
    """The loop of docs/paths.md compiles without a warning and drives a vehicle to the end,
    where it stands."""
    rates = drive(block("c", "docs/paths.md"), cc, 2500, 100, tmp_path)
    speeds = [0.075 * (right + left) for right, left in rates]
    assert abs(max(speeds) - 1.4) < 0.1 and abs(speeds[-1]) < 1e-3
    assert 17 < sum(speeds) < 21  # m, one line a second: the path is 18.6 m long


@pytest.mark.parametrize("turn", [1, -1])
def test_laps_for_a_day(turn, tmp_path):
    """24 h of the loop on a circle of 3 m, 40 000 rad: the wheels turn as ever, nearly as the model's do."""
    loop = block("c", "docs/paths.md")
    circle = f"{{.heading = 0.0f, .curvature = {turn}.0f / 3.0f, .length = 18.849556f}}"
    loop, count = re.subn(r"(segments\[\] = \{).*?\n\};", rf"\1{circle}}};", loop, flags=re.S)
    loop = loop.replace("segments, 3,", "segments, 1,").replace(
        ".deceleration = 0.5f", ".deceleration = 0.5f, .closed = 1"
    )
    assert count == 1 and ".closed" in loop and "segments, 1," in loop
    per_minute, day = 6_000, 24 * 60
    rates = drive(loop, HOST_CC, day * per_minute, per_minute, tmp_path)
    assert len(rates) == day
    axle = math.sqrt(3**2 - 0.3**2)  # m: radius of its circle, P_l being 0.3 m ahead
    right, left = (1.4 * (1 + turn * side * 0.75 / axle) / 0.15 for side in (1, -1))
    assert np.abs(np.divide(rates[1], [right, left]) - 1).max() < 0.1
    assert np.abs(np.array(rates[1:]) - rates[1]).max() < 0.01


@pytest.fixture(scope="module")
def cart(tmp_path_factory) -> str:
    """The README's robot in a file: its name on the command line."""
    path = tmp_path_factory.mktemp("robot") / "cart.py"
    path.write_text(block("python"))
    return f"{path}:cart"


@pytest.mark.parametrize("outputs", [("type_i", "type_iv_circle"), tuple(OUTPUTS)], ids=["some", "all"])
@pytest.mark.parametrize(("scalar", "tolerance"), [("double", 1e-11), ("float", 1e-4)])
def test_readme_robot(scalar, tolerance, outputs, cart, tmp_path):
    """Its C, written by the command line and compiled strictly, against CasADi at random states."""
    named = [word for name in outputs for word in ("--output", name)]
    assert main(["generate", cart, *named, "-o", str(tmp_path), "--scalar", scalar]) == 0
    folder, suffix = tmp_path / "cart", "_f" if scalar == "float" else ""
    laws = json.loads((folder / "manifest.json").read_text())["laws"]
    assert set(laws) == set(outputs)
    library = tmp_path / "cart.so"
    sources = [*folder.glob("*.c"), RUNTIME / "noslip_status.c"]
    run([HOST_CC, *STRICT, "-fPIC", "-shared", f"-I{RUNTIME}", f"-I{folder}", *sources, "-o", library])
    ffi = cffi.FFI()
    ffi.cdef(runtime_types(SCALARS[scalar]))
    for path in sorted(folder.glob("*.h"), key=lambda path: len(path.name)):
        text = re.sub(r"^#if.*__cplusplus.*\n.*\n#endif", "", path.read_text(), flags=re.M)
        ffi.cdef(
            "\n".join(
                line
                for line in text.replace("NOSLIP_NODISCARD ", "").splitlines()
                if not line.startswith("#")
            )
        )
    lib = ffi.dlopen(str(library))

    def struct(name: str, values):
        return ffi.new(f"cart_{name}{suffix} *", [float(value) for value in values])

    for name in laws:
        law = law_of(find_robot(cart), name)
        for plant in random_plants(law, 40, seed=4):
            self, params = ffi.new(f"cart_{name}{suffix} *"), struct("params", plant.params)
            config, gains = struct(f"{name}_config", plant.config), struct(f"{name}_gains", plant.gains)
            assert getattr(lib, f"cart_{name}_init{suffix}")(self, params, config, gains, ffi.NULL) == 0
            for point in plant.points:
                tau = ffi.new(f"{scalar}[2]")
                structs = struct("state", point.state), struct(f"{name}_reference", point.reference)
                assert getattr(lib, f"cart_{name}_step{suffix}")(self, *structs, tau) == 0
                truth = point.truth.values["tau"]
                assert np.abs(np.array(list(tau)) - truth).max() <= tolerance * max(np.abs(truth).max(), 1)


def test_readme_names_what_is_there():
    """Commands, folders and files it mentions exist."""
    text = (ROOT / "README.md").read_text()
    for target in re.findall(r"\]\(([\w/.]+)\)|^\| `(\w+/)`", text, re.M):
        path = next(part for part in target if part)
        assert (ROOT / path).exists(), path
    for path in re.findall(r"(?:specs|tests/reference)/\w+\.\w+", text):
        assert (ROOT / path).exists(), path


# -- export --------------------------------------------------------------------------------------------------


DOUBLE, FLOAT = (
    ["--output", "type_i", "--scalar", "double"],
    ["--output", "type_iv_segment", "--scalar", "float"],
)


@pytest.mark.parametrize(
    ("cc", "selection"), [("gcc", []), ("gcc", DOUBLE), ("clang", DOUBLE), ("gcc", FLOAT), ("clang", FLOAT)]
)
def test_export_builds_as_it_is(cc, selection, tmp_path):
    """All of it by one compiler: test_runtime.py has the same sources by both."""
    folder = tmp_path / "c"
    assert main(["export", "labmate", *selection, "-o", str(folder)]) == 0
    shutil.move(folder, tmp_path / "moved elsewhere")
    folder = tmp_path / "moved elsewhere"
    out = run(["make", "-C", folder, f"CC={cc}", "-j2"], env={**os.environ, "CFLAGS": "-O1 -Werror"})
    assert re.search(r"^labmate_\w+: ok, tau_r \(N m\), tau_l \(N m\): -?[0-9]", out, re.M), out
    assert (folder / "liblabmate.a").exists()
    assert "up to date" in run(["make", "-C", folder, f"CC={cc}", "liblabmate.a"])
    run(["make", "-C", folder, "clean"])
    assert {path.suffix for path in folder.iterdir()} <= {".c", ".h", ".inc", ".md", ".json", ""}


def test_export_holds_what_was_asked_for(exported):
    names = {path.name for path in exported.iterdir()}
    runtime = runtime_files().keys() - {"noslip_path.c"}  # the twin in double
    assert names == runtime | {
        "labmate_f.c",
        "labmate_f.h",
        "labmate_type_iv_circle_f.c",
        "labmate_type_iv_circle_f.h",
        "manifest.json",
        "Makefile",
        "README.md",
        "example.c",
    }
    for name in names - {"manifest.json", "Makefile", "README.md", "example.c"}:
        original = runtime_files().get(name) or (ROOT / "generated" / "labmate" / name).read_text()
        assert (exported / name).read_text() == original
    assert oct(exported.stat().st_mode & 0o777) == oct(0o777 & ~umask()), (
        "readable by others as any new folder"
    )


def umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_export_into_an_empty_folder(tmp_path):
    (tmp_path / "c").mkdir()
    assert main(["export", "labmate", "--output", "type_ii", "-o", str(tmp_path / "c")]) == 0
    assert (
        sorted(path.name for path in tmp_path.iterdir()) == ["c"] and (tmp_path / "c" / "Makefile").exists()
    )


@pytest.mark.parametrize("place", ["full", "file", "file/inside", "loop"])
def test_export_refused(place, bad_input, tmp_path):
    """A folder with something in it, a file, below a file, a link that leads nowhere: nothing is touched."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    (tmp_path / "loop").symlink_to("loop")
    assert place.split("/")[0] in bad_input(
        ["export", "labmate", "--output", "type_ii", "-o", str(tmp_path / place)]
    )


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc here")
def test_export_where_nothing_can_be_written(bad_input):
    """/proc takes no files, whoever asks."""
    bad_input(["export", "labmate", "--output", "type_ii", "-o", "/proc/noslip/c"])


@pytest.mark.parametrize(
    "argv", [["labmates"], ["labmate", "--output", "type_v"], ["labmate", "--scalar", "half"]]
)
def test_export_of_what_does_not_exist(argv, bad_input, tmp_path):
    bad_input(["export", *argv, "-o", str(tmp_path / "new" / "c")])


def test_export_of_a_robot_in_a_file(cart, tmp_path):
    assert main(["export", cart, "--output", "type_i", "-o", str(tmp_path / "c")]) == 0
    assert "cart_type_i: " in run(["make", "-C", tmp_path / "c"])


# -- wheel ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built by way of the sdist from a copy of what git has, so that the folder stays as it is."""
    folder = tmp_path_factory.mktemp("wheel")
    source = shutil.copytree(
        ROOT,
        folder / "source",
        ignore=lambda _, names: [n for n in names if n in SKIPPED or n.endswith(".egg-info")],
    )
    here = importlib.util.find_spec("setuptools") and importlib.util.find_spec("wheel")
    flags = ["--no-isolation", "--skip-dependency-check"] if here else []
    run([sys.executable, "-m", "build", "--quiet", *flags, "--outdir", folder, source])
    (file,) = folder.glob("noslip-*.whl")
    return file


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """An environment with nothing but the wheel, and what it depends on made visible from here."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / "bin" / "python"
    places = run([python, "-c", "import site; print(site.getsitepackages()[0])"]).strip()
    run(
        [
            sys.executable,
            "-m",
            "pip",
            "--python",
            python,
            "install",
            "--no-deps",
            "--no-index",
            "--quiet",
            wheel,
        ]
    )
    # last on the path, and as plain folders: the .pth files there, such as that of an editable noslip, are
    # not read
    here = [path for path in sys.path if path.endswith("-packages")]
    Path(places, "visible.pth").write_text("\n".join(here) + "\n", encoding="utf-8")
    return folder / "env" / "bin"


def listed_packages() -> set[str]:
    """The packages that pyproject names."""
    return set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])


def files_of(package: str) -> list[Path]:
    """What a package's folder holds; at the top, where the repository's own files are too,
    only the code and py.typed."""
    kinds = ("*.py", "*.typed") if package == "noslip" else ("*.*",)
    return [path for kind in kinds for path in ROOT.joinpath(*package.split(".")[1:]).glob(kind)]


def test_wheel_holds_the_packages(wheel):
    listing = run([sys.executable, "-m", "zipfile", "-l", wheel])
    names = {line.split()[0] for line in listing.splitlines()[1:]}
    packages = listed_packages()
    for package in packages:
        for path in files_of(package):
            assert "/".join([*package.split("."), path.name]) in names, path
    assert not [
        name for name in names if not name.startswith(("noslip/", f"noslip-{noslip.__version__}.dist-info/"))
    ]
    inside = {name.rpartition("/")[0].replace("/", ".") for name in names if name.startswith("noslip/")}
    assert inside == packages  # no tests, generated C, benchmarks, pages
    assert any(name.endswith("LICENSE") for name in names)


def test_sdist_holds_what_git_has(wheel):
    (sdist,) = wheel.parent.glob("noslip-*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("no git here")
    assert not set(listed.stdout.splitlines()) - names


COMMANDS = """
import json, sys
from noslip.cli.main import main
for arguments in json.loads(sys.argv[1]):
    if main(arguments):
        sys.exit(f"{arguments} failed")
"""


def test_an_unpacked_wheel_exports(wheel, tmp_path):
    """With nothing of this folder, its templates among what it has. The nightly test installs it."""
    run([sys.executable, "-m", "zipfile", "-e", wheel, tmp_path / "unpacked"])
    env = {**os.environ, "PYTHONPATH": str(tmp_path / "unpacked")}
    code = (
        "import noslip, sys; from noslip.cli.main import main; print(noslip.__file__); "
        "sys.exit(main(sys.argv[1:]))"
    )
    out = run(
        [sys.executable, "-c", code, "export", "labmate", "--output", "type_i", "-o", "c"],
        cwd=tmp_path,
        env=env,
    )
    assert out.splitlines()[0] == str(tmp_path / "unpacked/noslip/__init__.py")
    for name in ("labmate.h", "labmate_type_i.c", "labmate_type_i_f.h"):
        assert (tmp_path / "c" / name).read_bytes() == (ROOT / "generated/labmate" / name).read_bytes()
    assert "labmate_type_i_step" in (tmp_path / "c/example.c").read_text()


@pytest.mark.nightly
def test_installed_wheel(installed, tmp_path):
    """generate, then in one process export, evaluate and check from an empty folder."""
    cases, env = tmp_path / "cases.json", {**os.environ, "NOSLIP_CACHE": str(tmp_path / "cache")}
    env.pop("PYTHONPATH", None)
    whole = json.loads((ROOT / "examples/specs" / "reference" / "labmate_paper.json").read_text())
    cases.write_text(json.dumps({**whole, "cases": whole["cases"][:4:3]}))  # Type I, and IV on a line
    empty = tmp_path / "empty"
    empty.mkdir()

    def noslip_command(*argv: str) -> str:
        return run([installed / "noslip", *argv], cwd=empty, env=env)

    where = run(
        [installed / "python", "-c", "import noslip; print(noslip.__file__)"], cwd=empty, env=env
    ).strip()
    assert Path(where).is_relative_to(installed.parent) and not Path(where).is_relative_to(ROOT)
    assert noslip_command("--version").strip() == f"noslip {noslip.__version__}"
    noslip_command("generate", "labmate", "--output", "type_i")
    for name in ("labmate.h", "labmate_type_i.c", "labmate_type_i_f.h"):
        assert (empty / "generated" / "labmate" / name).read_bytes() == (
            ROOT / "generated" / "labmate" / name
        ).read_bytes()
    commands = [
        ["export", "labmate", "--output", "type_iv_line", "--scalar", "double", "-o", "c"],
        ["evaluate", str(cases), "--backend", "c", "-o", "out.json"],
        ["check", str(cases)],  # on every backend of this host
    ]
    on_target = not TARGETS["cortex-m4f"].missing()
    if on_target:
        commands += [
            ["evaluate", str(cases), "--backend", backend, "-o", f"{backend}.json"]
            for backend in ("m4f", "cf")
        ]
    run([installed / "python", "-c", COMMANDS, json.dumps(commands)], cwd=empty, env=env)
    assert "labmate_type_iv_line: " in run(["make", "-C", empty / "c"])
    answers = json.loads((empty / "out.json").read_text())["cases"]
    assert [answer["status"] for answer in answers] == ["ok"] * 2
    truth = [float(x) for x in whole["cases"][0]["expect"]["tau"]]
    assert np.abs(np.array(answers[0]["tau"]) - truth).max() <= 1e-11 * np.abs(truth).max()
    if on_target:
        assert (empty / "m4f.json").read_bytes() == (empty / "cf.json").read_bytes()


def test_listed_packages_are_the_folders():
    """pyproject's list, and nothing with code left out of it."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    listed = listed_packages()
    of_no_python = {package for package in listed if all(path.suffix != ".py" for path in files_of(package))}
    assert of_no_python >= {
        "noslip.runtime_c",
        "noslip.examples.specs.figures",
        "noslip.firmware.boards",
        "noslip.firmware.pil",
    }
    folders = {path for path in ROOT.rglob("templates") if not SKIPPED & set(path.relative_to(ROOT).parts)}
    assert of_no_python >= {".".join(["noslip", *path.relative_to(ROOT).parts]) for path in folders}
    assert listed - of_no_python == {
        ".".join(["noslip", *path.parent.relative_to(ROOT).parts])
        for path in ROOT.rglob("__init__.py")
        if not SKIPPED & set(path.relative_to(ROOT).parts) and path.relative_to(ROOT).parts[0] != "tests"
    }
    for package in listed:
        kinds = {f"*{path.suffix}" for path in files_of(package)} - {"*.py"}
        assert kinds == set(tool["package-data"].get(package, ())), package


@pytest.mark.parametrize(
    ("scalar", "there", "not_there"), [("float", "_f.c", ".c"), ("double", ".c", "_f.c")]
)
def test_export_of_one_scalar_has_no_source_of_the_other(scalar, there, not_there, tmp_path):
    folder = tmp_path / "one"
    assert main(["export", "labmate", "--output", "type_i", "--scalar", scalar, "-o", str(folder)]) == 0
    assert (folder / f"noslip_path{there}").exists() and not (folder / f"noslip_path{not_there}").exists()


LONG = r"^noslip figures|--scheduler|--table|--worst"  # figures and large sweeps have tests of their own
# Files from elsewhere, and what is made of them
FROM_A_VEHICLE = r"\brun\.(dump|mcap|bag)|\bpoints\.csv|\bcourse\.json"


def printed_commands() -> list[tuple[str, str]]:
    """The commands of noslip that the pages print: page, command line;
    those of the tutorial are run by test_tutorial."""
    commands = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for text in re.findall(r"^```sh\n(.*?)^```", page.read_text(), re.S | re.M):
            lines = text.replace("\\\n", "").splitlines()
            commands += [
                (page.name, re.sub(r"\s+# .*", "", line)) for line in lines if line.startswith("noslip ")
            ]
    left_out = f"{LONG}|{FROM_A_VEHICLE}"
    return [
        (page, line) for page, line in commands if not re.search(left_out, line) and page != "your_robot.md"
    ]


@pytest.fixture(scope="module")
def outside(installed, tmp_path_factory) -> dict[str, str]:
    """Variables with which commands are those of the installed wheel, which compile each law once."""
    cache = tmp_path_factory.mktemp("compiled")
    own = {"NOSLIP_CACHE": str(cache), "PATH": f"{installed}:{os.environ['PATH']}"}
    return {name: value for name, value in {**os.environ, **own}.items() if name != "PYTHONPATH"}


@pytest.mark.nightly
def test_pages_that_are_run_as_printed_run_from_the_wheel(outside, tmp_path):
    """docs/outer_loop.py; and the tutorial, whose commands end in the errors it prints and in no others."""
    shutil.copy(ROOT / "docs" / "outer_loop.py", tmp_path)
    run(["python", "outer_loop.py"], cwd=tmp_path, env=outside)
    for kind, names in test_tutorial.FILES.items():
        for name, text in zip(names, test_tutorial.blocks(kind), strict=True):
            (tmp_path / name).write_text(text)
    calls = re.findall(r"^\$ (.*)\n(.*)", "\n".join(test_tutorial.blocks("console")), re.M)
    for command, printed in calls:
        code = 2 if printed.startswith("noslip: ") else 0
        run(["bash", "-c", f"{command}; [ $? = {code} ]"], cwd=tmp_path, env=outside)
    assert len(calls) > 5


def test_printed_commands_need_no_source_tree():
    """SPECs that come with noslip are printed by their names, which a wheel knows too."""
    commands = printed_commands()
    assert len(commands) > 40 and [line for _, line in commands if "specs/" in line] == []


@pytest.mark.nightly
@pytest.mark.parametrize("page", sorted({page for page, _ in printed_commands()}))
def test_printed_commands_work_from_the_wheel(page, outside, tmp_path):
    """In an empty folder, with the README's robot beside."""
    on_target = not TARGETS["cortex-m4f"].missing()
    (tmp_path / "cart.py").write_text(block("python"))
    if page == "firmware.md":  # goes on with the SPEC of another page
        run(["bash", "-c", "noslip new agv.toml"], cwd=tmp_path, env=outside)
    for line in (line for of, line in printed_commands() if of == page):
        if on_target or not re.search("m4f|replay", line):
            stops = " || [ $? = 1 ]" if "--sample" in line else ""  # as a sample of a sweep may
            run(["bash", "-c", line + stops], cwd=tmp_path, env=outside)

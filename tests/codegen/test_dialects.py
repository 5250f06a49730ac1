"""The same bits in every dialect: the exported self-test compiled as users do, in C from C99 on and in C++,
where compilers fuse products and sums by default, with processors that have such instructions."""

import itertools
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
from noslip.cli.main import main
from noslip.codegen.targets import flags
from noslip.tests.tools import need

LAWS = ("type_iv_segment", "type_iv_circle", "type_i")
PRAGMA = '#pragma GCC optimize("fp-contract=off", '
FUSED = re.compile(r"\s(vfn?m[\w.]+)\s")  # fused operations of Arm and x86 in a disassembly
ARM = {
    "m4": " ".join(flags("cortex-m4f")),
    "m7": " ".join(flags("cortex-m7")),
}
C = ("-std=gnu99", "-std=c99 -ffp-contract=fast", "-std=gnu11", "-std=c11", "-std=gnu17")
CPP = ("-std=c++11", "-std=c++17", "-std=gnu++17")
LEVELS = ("-O1", "-O2", "-O3", "-Os")


@dataclass(frozen=True)
class Dialect:
    """How a user compiles: the sources of the library, and the file that uses it, `own`."""

    compiler: str
    own: str
    library: str
    flags: str

    def __str__(self) -> str:
        return f"{self.compiler} {self.own}, library {self.library}, {self.flags}"

    @property
    def in_cpp(self) -> bool:
        return "++" in self.own


def dialects():
    """Every dialect at every level for both compilers; with link-time optimization where the two files
    differ."""
    for compiler, own, level in itertools.product(("gcc", "clang"), (*C, *CPP), LEVELS):
        if compiler == "clang" and "contract" in own:
            continue  # it overrides the pragma: noslip_real.h says so
        library = own if "++" not in own else "-std=gnu11"
        yield Dialect(compiler, own, library, f"{level} -mfma")
    for own, level in itertools.product(("-std=gnu11", "-std=c++17"), LEVELS):
        for library in ("-std=c99", "-std=gnu11", "-std=c++17"):
            yield Dialect("gcc", own, library, f"{level} -mfma -flto")
    yield Dialect("gcc", "-std=gnu11", "-std=gnu11", "-O3 -march=native")


EACH_TIME = (
    Dialect("gcc", "-std=gnu11", "-std=gnu11", "-O2 -mfma"),
    Dialect("gcc", "-std=c++17", "-std=gnu17", "-O3 -march=native"),
    Dialect("gcc", "-std=gnu11", "-std=c99", "-O2 -mfma -flto"),
    Dialect("clang", "-std=c++11", "-std=gnu99", "-O2 -mfma"),
)


def export(target: str, folder: Path) -> Path:
    outputs = [word for law in LAWS for word in ("--output", law)]
    assert main(["export", "labmate", *outputs, "--firmware", target, "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    """The project for any machine. Skips where this one cannot fuse: then nothing can differ."""
    need("make")
    if "fma" not in Path("/proc/cpuinfo").read_text(encoding="utf-8").split():
        pytest.skip("this processor has no fused operations")
    return export("generic", tmp_path_factory.mktemp("dialects") / "host")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    need("arm-none-eabi-gcc", "arm-none-eabi-g++", "qemu-system-arm", "make")
    return export("cortex-m4f", tmp_path_factory.mktemp("dialects") / "arm")


def tried(dialect: Dialect, project: Path, folder: Path) -> subprocess.CompletedProcess:
    """The self-test of a project, built in a folder and run."""
    need(dialect.compiler, {"gcc": "g++", "clang": "clang++"}[dialect.compiler])
    include = [f"-I{project / name}" for name in ("noslip", "selftest")]
    for kind, standard, sources in (
        ("library", dialect.library, sorted((project / "noslip").glob("*.c"))),
        ("own", dialect.own, [project / "selftest/selftest.c"]),
    ):
        place = folder / kind
        place.mkdir()
        language = ["-x", "c++"] if "++" in standard else []
        command = [
            dialect.compiler,
            *standard.split(),
            *dialect.flags.split(),
            "-Wall",
            "-Wextra",
            "-Werror",
            *include,
            *language,
        ]
        subprocess.run([*command, "-c", *map(str, sources)], cwd=place, check=True)
    objects = [str(path) for path in folder.rglob("*.o")]
    linker = (
        dialect.compiler.replace("gcc", "g++") if "++" in dialect.own + dialect.library else dialect.compiler
    )
    linker = "clang++" if linker == "clang" and dialect.in_cpp else linker
    subprocess.run([linker, *dialect.flags.split(), *objects, "-o", "selftest"], cwd=folder, check=True)
    return subprocess.run([folder / "selftest"], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("dialect", EACH_TIME, ids=str)
def test_selftest_passes(dialect, host, tmp_path):
    done = tried(dialect, host, tmp_path)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count(": pass") == len(LAWS) + 3  # the route, follow, and all


@pytest.mark.nightly
@pytest.mark.parametrize("dialect", sorted(set(dialects()) - set(EACH_TIME), key=str), ids=str)
def test_selftest_passes_everywhere(dialect, host, tmp_path):
    done = tried(dialect, host, tmp_path)
    assert done.returncode == 0, done.stdout


def without_pragma(project: Path, folder: Path) -> Path:
    shutil.copytree(project, folder)
    header = folder / "noslip/noslip_real.h"
    text = header.read_text()
    assert PRAGMA in text
    header.write_text(text.replace(PRAGMA, "#pragma GCC optimize("))
    return folder


@pytest.mark.nightly
@pytest.mark.parametrize(
    "own, library, told", [("-std=gnu11", "-std=c99", "route"), ("-std=c99", "-std=gnu11", "type_i_f")]
)
def test_selftest_finds_fused_operations(own, library, told, host, tmp_path):
    """Without the pragma: in the file that uses the library, where `route` is inline,
    and in the library's laws."""
    changed = without_pragma(host, tmp_path / "project")
    done = tried(Dialect("gcc", own, library, "-O2 -mfma"), changed, tmp_path)
    assert done.returncode != 0 and re.search(rf"{told}: FAIL", done.stdout), done.stdout


def fused(compiler: str, flags: str, source: Path, project: Path, folder: Path) -> list[str]:
    """The fused operations in a source as compiled for Arm."""
    made = folder / "made.o"
    include = [f"-I{project / name}" for name in ("noslip", "selftest", "board")]
    language = ["-x", "c++"] if "++" in flags else []
    command = [
        f"arm-none-eabi-{compiler}",
        *flags.split(),
        "-ffreestanding",
        *include,
        *language,
        "-c",
        str(source),
        "-o",
        str(made),
    ]
    subprocess.run(command, check=True)
    return FUSED.findall(
        subprocess.run(
            ["arm-none-eabi-objdump", "-d", made], capture_output=True, text=True, check=True
        ).stdout
    )


each_cpu = pytest.mark.parametrize("cpu", ARM)
each_level = pytest.mark.parametrize(
    "level", ["-O2", *(pytest.param(level, marks=pytest.mark.nightly) for level in ("-O1", "-O3", "-Os"))]
)


@pytest.mark.nightly
@pytest.mark.parametrize("standard", (*C, *CPP))
@each_cpu
@each_level
def test_no_fused_operation_on_arm(level, cpu, standard, arm, tmp_path):
    """In no source of the package, nor in one that uses it, which may be C++."""
    sources = [
        "selftest/selftest.c",
        *(["noslip/labmate_type_i_f.c", "noslip/noslip_path_f.c"] if standard in C else []),
    ]
    for source in sources:
        assert fused("gcc", f"{standard} {level} {ARM[cpu]}", arm / source, arm, tmp_path) == [], source


@each_cpu
@pytest.mark.parametrize(
    "level", ["-O2", *(pytest.param(level, marks=pytest.mark.nightly) for level in ("-O3", "-Os"))]
)
def test_there_are_some_without_the_pragma_on_arm(level, cpu, arm, tmp_path):
    """At -O1 gcc does not look for them."""
    changed = without_pragma(arm, tmp_path / "changed")
    for source in ("selftest/selftest.c", "noslip/labmate_type_i_f.c"):
        assert fused("gcc", f"-std=gnu11 {level} {ARM[cpu]}", changed / source, changed, tmp_path)


@pytest.mark.parametrize("flags", ["-std=gnu11 -O2", "-std=gnu17 -O3"])
def test_selftest_passes_on_arm(flags, arm, tmp_path):
    """In QEMU, the project's Makefile being given the flags."""
    copy = tmp_path / "project"
    shutil.copytree(arm, copy)
    command = ["make", "-s", "-C", str(copy), "test", f"CFLAGS={flags} -ffp-contract=fast"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and done.stdout.endswith("selftest: pass\n"), done.stdout + done.stderr


@pytest.mark.parametrize("language", ["c", "c++"])
def test_options_that_end_after_the_header(language, arm, tmp_path):
    """Where a user restores options behind the headers, what is inline there is not inlined into fused
    code."""
    names = ("angle", "integral", "odometry", "path", "reversing", "solve")
    text = (
        "#pragma GCC push_options\n"
        + "".join(f'#include "noslip_{name}.h"\n' for name in names)
        + "#pragma GCC pop_options\n"
    )
    text += """int use(noslip_odometry_f *odometry, noslip_path_f *path, const float *a,
        noslip_pose_f *pose, float *out);
int use(noslip_odometry_f *odometry, noslip_path_f *path, const float *a, noslip_pose_f *pose, float *out)
{
    int status = noslip_odometry_move_f(odometry, a, a[2], pose);
    status += noslip_path_step_f(path, pose->x, pose->y, odometry->direction, a[1]);
    status += noslip_nearest_angle_f(a[0], a[1], out + 1);
    noslip_sincos_f(a[2], out + 3, out + 4);
    out[5] = noslip_atan2_f(a[0], a[1]);
    return status + noslip_ldl_f(out, 3);
}
"""
    source = tmp_path / "use.c"
    source.write_text(text)
    standard = "-std=c++17" if language == "c++" else "-std=gnu11"
    assert fused("gcc", f"{standard} -O3 {ARM['m4']}", source, arm, tmp_path) == []

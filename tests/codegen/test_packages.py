"""Packages: those that can be built here are built in a fresh folder;
the others are compared with what their formats ask for."""

import io
import json
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from zipfile import ZipFile

import noslip.cli.export as export
import numpy as np
import pytest
from noslip import __version__
from noslip.cli.main import main
from noslip.codegen.packages.packages import PACKAGES
from noslip.codegen.runtime import runtime_files
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.controllers.backends import make_controller
from noslip.tests.tools import need

ROOT = Path(__file__).resolve().parents[2]
LAW, HEADER = "type_iv_circle", "labmate_type_iv_circle_f.h"
USES = f"""#include "{HEADER}"
int main(void)
{{
    labmate_params_f params;
    labmate_type_iv_circle_f law;
    (void)labmate_default_params_f(&params);
    return labmate_type_iv_circle_init_f(&law, &params, NULL, NULL, NULL) == NOSLIP_NULL ? 0 : 1;
}}
"""
USER = "cmake_minimum_required(VERSION 3.14)\nproject(yours C)\nset(CMAKE_EXPORT_COMPILE_COMMANDS ON)\n{}\n"
USER += "add_executable(yours yours.c)\ntarget_link_libraries(yours PRIVATE noslip::labmate)\n"


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The folder of a package."""

    @cache
    def exported(manager: str) -> Path:
        folder = tmp_path_factory.mktemp("package") / manager
        assert main(["export", "labmate", "--output", LAW, "--package", manager, "-o", str(folder)]) == 0
        return folder

    return exported


def run(*command, **options):
    return subprocess.run(
        [str(word) for word in command], check=True, capture_output=True, text=True, timeout=120, **options
    )


def cmake(source, build, *options):
    run("cmake", "-S", source, "-B", build, *options)
    run("cmake", "--build", build)


@pytest.fixture(scope="module")
def built(exported, tmp_path_factory):
    """A folder with the CMake package built in `build`, after its self-test passed,
    and installed in `prefix`."""
    need("cmake")
    folder = tmp_path_factory.mktemp("built")
    shutil.copytree(exported("cmake"), folder / "copy")
    cmake(folder / "copy", folder / "build", "-DNOSLIP_SELFTEST=ON")
    assert "100% tests passed" in run("ctest", cwd=folder / "build").stdout
    run("cmake", "--install", folder / "build", "--prefix", folder / "prefix")
    return folder


@pytest.fixture
def installed(built):
    """The prefix in which the CMake package is installed."""
    return built / "prefix"


@pytest.mark.nightly
def test_cmake_finds_a_wrong_bit(built):
    """The digest of the self-test is that of the C on this machine."""
    source = built / "copy" / "selftest" / "selftest.c"
    text, count = re.subn(
        r"digest != 0x([0-9a-f]{8})u", lambda m: f"digest != 0x{int(m[1], 16) ^ 1:08x}u", source.read_text()
    )
    assert count == 1
    source.write_text(text)
    run("cmake", "--build", built / "build")
    assert subprocess.run(["ctest"], cwd=built / "build", capture_output=True).returncode != 0


@pytest.mark.nightly
@pytest.mark.parametrize("way", ["find_package", "FetchContent"])
def test_cmake_in_a_users_project(way, exported, installed, tmp_path):
    """No flag comes with it, and no test."""
    declared = f"FetchContent_Declare(noslip_labmate SOURCE_DIR {exported('cmake')})"
    fetched = f"include(FetchContent)\n{declared}\nFetchContent_MakeAvailable(noslip_labmate)"
    find = f"find_package(noslip {__version__} REQUIRED COMPONENTS labmate)"
    (tmp_path / "CMakeLists.txt").write_text(USER.format(find if way == "find_package" else fetched))
    (tmp_path / "yours.c").write_text(USES)
    cmake(tmp_path, tmp_path / "build", f"-DCMAKE_PREFIX_PATH={installed}")
    run(tmp_path / "build" / "yours")
    commands = json.loads((tmp_path / "build" / "compile_commands.json").read_text())
    own = next(entry["command"].split() for entry in commands if entry["file"].endswith("yours.c"))
    includes = ("-I", "-isystem")
    assert [word for word in own if word.startswith("-") and not word.startswith(includes)] == ["-o", "-c"]
    assert not any("selftest" in entry["file"] for entry in commands)
    assert (
        subprocess.run(
            ["cmake", "--install", tmp_path / "build", "--prefix", tmp_path / "p"], capture_output=True
        ).returncode
        == 0
    )
    assert not (tmp_path / "p").exists()


def test_cmake_says_which_robot_is_missing(installed, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        USER.format("find_package(noslip REQUIRED COMPONENTS labmate car)")
    )
    (tmp_path / "yours.c").write_text(USES)
    done = subprocess.run(
        ["cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={installed}"],
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0 and "the robot car is not installed" in " ".join(done.stderr.split())


def test_pkg_config(installed, exported, tmp_path):
    """The file works where it is, also after the folder was moved; read by hand, since pkg-config may be
    missing. The library has the bits of the C where it was written.
    """
    shutil.copytree(installed, tmp_path / "moved")
    (file,) = (tmp_path / "moved").rglob("noslip-labmate.pc")
    values = {"pcfiledir": str(file.parent)}
    for name, text in re.findall(r"^(\w+)(?:=|: )(.*)$", file.read_text(), re.MULTILINE):
        values[name] = re.sub(r"\$\{(\w+)\}", lambda m: values[m[1]], text)
    assert values["Version"] == __version__
    (tmp_path / "yours.c").write_text(USES)
    run("cc", "yours.c", *values["Cflags"].split(), *values["Libs"].split(), "-o", "yours", cwd=tmp_path)
    run(tmp_path / "yours")
    source = exported("cmake") / "selftest" / "selftest.c"
    run("cc", source, *values["Cflags"].split(), *values["Libs"].split(), "-o", "selftest", cwd=tmp_path)
    assert "selftest: pass" in run(tmp_path / "selftest").stdout, "the library has other bits"


STUB = """#include <cstdio>
static unsigned long clock_of_stub;
static unsigned long micros() { return clock_of_stub += 5000; }
static struct {
    void begin(long) {}
    void print(char c) { std::printf("%c", c); }
    void print(const char *text) { std::printf("%s", text); }
    void print(double value, int digits) { std::printf("%.*f", digits, value); }
    void println(const char *text = "") { std::printf("%s\\n", text); }
} Serial;
"""


def test_arduino_sketch(exported, tmp_path):
    """Compiled as C++ with a stub of the core, linked with the C of src/, and run;
    the self-test finds the same bits."""
    need("g++")
    folder = exported("arduino")
    (tmp_path / "Arduino.h").write_text(STUB)
    (tmp_path / "main.cpp").write_text('#include "sketch.inc"\nint main() { setup(); loop(); loop(); }\n')
    (tmp_path / "sketch.inc").write_text((folder / "examples" / "Step" / "Step.ino").read_text())
    run("cc", "-c", "-O2", *sorted((folder / "src").glob("*.c")), cwd=tmp_path)
    strict = ["-std=c++17", "-Wall", "-Wextra", "-Wno-missing-field-initializers", "-Werror"]
    run(
        "g++",
        *strict,
        f"-I{folder / 'src'}",
        "-include",
        "Arduino.h",
        "main.cpp",
        *sorted(tmp_path.glob("*.o")),
        "-o",
        "x",
        cwd=tmp_path,
    )
    first, *steps = run(tmp_path / "x").stdout.splitlines()
    assert first == "ok" and len(steps) == 2
    status, *tau = steps[0].split()
    assert status in ("ok", "singular") and len(tau) == 2
    objects = sorted(tmp_path.glob("*.o"))
    source = folder / "selftest" / "selftest.c"
    run(
        "g++",
        "-std=gnu++17",
        f"-I{folder / 'src'}",
        "-x",
        "c++",
        source,
        "-x",
        "none",
        *objects,
        "-o",
        "t",
        cwd=tmp_path,
    )
    assert "selftest: pass" in run(tmp_path / "t").stdout


def test_arduino_headers_on_a_board(exported, tmp_path):
    need("arm-none-eabi-g++")
    sources = exported("arduino") / "src"
    (tmp_path / "x.cpp").write_text(
        "".join(f'#include "{path.name}"\n' for path in sorted(sources.glob("*.h")))
    )
    flags = [
        "-mcpu=cortex-m4",
        "-mthumb",
        "-mfpu=fpv4-sp-d16",
        "-mfloat-abi=hard",
        "-ffreestanding",
        "-std=gnu++17",
    ]
    run(
        "arm-none-eabi-g++",
        *flags,
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{sources}",
        "-c",
        "x.cpp",
        cwd=tmp_path,
    )


def test_arduino_properties(exported):
    """Arduino's specification of libraries, format 1.5."""
    folder = exported("arduino")
    lines = (folder / "library.properties").read_text().splitlines()
    values = dict(line.split("=", 1) for line in lines)
    needed = {
        "name",
        "version",
        "author",
        "maintainer",
        "sentence",
        "paragraph",
        "category",
        "url",
        "architectures",
    }
    assert needed <= set(values) and len(values) == len(lines)
    assert (
        re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_. -]{0,62}", values["name"]) and values["version"] == __version__
    )
    assert values["category"] == "Device Control" and values["architectures"] == "*"
    assert all((folder / "src" / header).is_file() for header in values["includes"].split(","))
    assert (folder / "examples" / "Step" / "Step.ino").is_file()


def test_platformio_description(exported):
    """PlatformIO's specification of library.json."""
    jsonschema = pytest.importorskip("jsonschema")
    folder = exported("platformio")
    found = json.loads((folder / "library.json").read_text())
    text, texts = {"type": "string", "minLength": 1}, {"type": "array", "items": {"type": "string"}}
    schema = {
        "type": "object",
        "required": ["name", "version", "description"],
        "additionalProperties": False,
        "properties": {
            "name": {"type": "string", "pattern": r'^[^:;/,@<>"\']{1,100}$'},
            "version": {"type": "string", "pattern": r"^\d+\.\d+\.\d+$"},
            "description": text | {"maxLength": 255},
            "keywords": texts | {"uniqueItems": True},
            "license": text,
            "frameworks": text,
            "platforms": text,
            "headers": texts,
            "examples": {"type": "array", "items": {"type": "object", "required": ["name", "base", "files"]}},
            "build": {
                "type": "object",
                "additionalProperties": False,
                "properties": {"srcDir": text, "includeDir": text, "flags": texts},
            },
        },
    }
    jsonschema.validate(found, schema)
    assert all((folder / found["build"]["includeDir"] / header).is_file() for header in found["headers"])
    for example in found["examples"]:
        assert all((folder / example["base"] / file).is_file() for file in example["files"])


def test_platformio_reads_it(exported):
    """PlatformIO's own parser and schema, where it is installed;
    the list of licenses would come from the network."""
    parser = pytest.importorskip("platformio.package.manifest.parser")
    schema = pytest.importorskip("platformio.package.manifest.schema")

    class Known(schema.ManifestSchema):
        @staticmethod
        def load_spdx_licenses(*_: object) -> dict:
            return {"licenses": [{"licenseId": "MIT"}]}

    found = parser.ManifestParserFactory.new_from_dir(str(exported("platformio"))).as_dict()
    assert Known().load_manifest(found)["version"] == __version__
    with pytest.raises(schema.ManifestValidationError):
        Known().load_manifest({**found, "version": "latest"})


def test_the_zip_has_the_same_bytes_everywhere(tmp_path):
    """`make dist` in two clones, umasks and time zones; it has the C of git, for users,
    and that builds in a fresh folder."""
    need("git"), need("make")
    zips = []
    for zone, umask in (("Asia/Tokyo", 0o022), ("America/New_York", 0o077)):
        clone = tmp_path / zone.replace("/", "_")
        run("git", "clone", "--quiet", ROOT, clone)
        env = {**os.environ, "TZ": zone}
        run("make", "-s", f"dist/noslip-c-{__version__}.zip", cwd=clone, env=env, umask=umask)
        zips.append((clone / f"dist/noslip-c-{__version__}.zip").read_bytes())
    assert zips[0] == zips[1]
    with ZipFile(io.BytesIO(zips[0])) as packed:
        packed.extractall(tmp_path / "fresh")
    folder = tmp_path / f"fresh/noslip-c-{__version__}"
    assert {each.name for each in folder.iterdir()} == {
        "LICENSE",
        "README.md",
        "docs",
        "generated",
        "runtime_c",
    }
    assert {path.name for path in (folder / "runtime_c").iterdir()} == runtime_files().keys()
    for file in [path.relative_to(folder) for path in folder.rglob("*.[ch]")]:
        text = runtime_files()[file.name] if file.parent.name == "runtime_c" else (clone / file).read_text()
        assert (folder / file).read_text() == text
    robot = folder / "generated/labmate"
    (tmp_path / "x.c").write_text(USES)
    sources = [
        robot / "labmate_f.c",
        robot / "labmate_type_iv_circle_f.c",
        folder / "runtime_c/noslip_status.c",
    ]
    program = [
        "cc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{folder / 'runtime_c'}",
        f"-I{robot}",
        tmp_path / "x.c",
    ]
    run(*program, *sources, "-o", tmp_path / "x")
    run(tmp_path / "x")


def test_from_python(tmp_path):
    """The program of docs/firmware.md, in a fresh folder: its torques are those of the model."""
    need("cc")
    page = (ROOT / "docs/firmware.md").read_text().split("## From Python")[1].split("\n## ")[0]
    shell, program = (re.search(rf"```{kind}\n(.*?)```", page, re.S) for kind in ("sh", "python"))
    assert shell and program
    (tmp_path / "noslip").symlink_to(Path(sys.executable).parent / "noslip")
    run(
        "sh",
        "-e",
        "-c",
        shell[1],
        cwd=tmp_path,
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
    )
    status, *tau = run(sys.executable, "-c", program[1], cwd=tmp_path).stdout.split()
    law = law_of(system_of(find_robot("labmate")), LAW)
    believed = law.system.mechanism.parameter_values({})
    model = make_controller(
        "casadi", law, np.array(believed), np.array([0.0, 20.0, 20.0, 10.0]), np.array([1.0, 2.5, 2.0])
    )
    expected = model.step(np.array([30.0, 15.0, 1.2, 0, 0, 0, 0]), np.array([0.0, 0.0, 0.0, 1.0, 0.0]))
    assert status == expected[0] == "ok" and list(map(float, tau)) == pytest.approx(expected[1], rel=1e-9)


# What the build systems of Zephyr and ESP-IDF define, as far as the packages use it.
ZEPHYR = """set(CONFIG_NOSLIP_LABMATE y)
add_library(zephyr_interface INTERFACE)
macro(zephyr_library_named name)
    set(ZEPHYR_CURRENT_LIBRARY ${name})
    add_library(${name} STATIC)
endmacro()
macro(zephyr_library_sources)
    target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endmacro()
macro(zephyr_library_compile_options)
    target_compile_options(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endmacro()
macro(zephyr_include_directories)
    target_include_directories(zephyr_interface INTERFACE ${ARGN})
    include_directories(${ARGN})
endmacro()
"""
ESP_IDF = """function(idf_component_register)
    cmake_parse_arguments(given "" "" "SRCS;INCLUDE_DIRS" ${ARGN})
    set(COMPONENT_LIB component PARENT_SCOPE)
    add_library(component STATIC ${given_SRCS})
    target_include_directories(component PUBLIC ${given_INCLUDE_DIRS})
endfunction()
"""


@pytest.mark.parametrize(
    "manager, stub, folder, libraries",
    [("zephyr", ZEPHYR, "zephyr", "zephyr_interface noslip_labmate"), ("esp-idf", ESP_IDF, ".", "component")],
    ids=["zephyr", "esp-idf"],
)
def test_builds_with_the_functions_of_its_system(manager, stub, folder, libraries, exported, tmp_path):
    need("cmake")
    text = "cmake_minimum_required(VERSION 3.14)\nproject(yours C)\n" + stub
    text += f"add_subdirectory({exported(manager) / folder} package)\nadd_executable(yours yours.c)\n"
    (tmp_path / "CMakeLists.txt").write_text(f"{text}target_link_libraries(yours {libraries})\n")
    (tmp_path / "yours.c").write_text(USES)
    cmake(tmp_path, tmp_path / "build")
    run(tmp_path / "build" / "yours")


def test_zephyr_module(exported):
    yaml = pytest.importorskip("yaml")
    folder = exported("zephyr")
    found = yaml.safe_load((folder / "zephyr" / "module.yml").read_text())
    assert found == {"name": "noslip_labmate", "build": {"cmake": "zephyr", "kconfig": "zephyr/Kconfig"}}
    assert (folder / found["build"]["cmake"] / "CMakeLists.txt").is_file()
    kconfig = (folder / found["build"]["kconfig"]).read_text().splitlines()
    assert "config NOSLIP_LABMATE" in kconfig
    assert all(
        re.match(r"(#|config \w+$|\t(bool \".*\"|imply \w+ if \w+|help)$|\t  \S)", line) for line in kconfig
    )
    assert all(
        f"CONFIG_{line.split()[1]}" in (folder / "README.md").read_text()
        for line in kconfig
        if line.startswith("config")
    )


def test_esp_idf_component(exported):
    yaml = pytest.importorskip("yaml")
    found = yaml.safe_load((exported("esp-idf") / "idf_component.yml").read_text())
    assert found["version"] == __version__ and found["dependencies"] == {"idf": ">=4.4"}
    assert set(found) <= {
        "version",
        "description",
        "license",
        "dependencies",
        "targets",
        "url",
        "tags",
        "files",
        "examples",
    }


@pytest.mark.parametrize("manager", PACKAGES)
def test_what_all_packages_have(manager, exported, tmp_path):
    """The C of the other exports, a self-test, a page with the manager's commands,
    an example that compiles."""
    folder = exported(manager)
    plain = tmp_path / "plain"
    assert main(["export", "labmate", "--output", LAW, "--scalar", "float", "-o", str(plain)]) == 0
    own = {"Makefile", "README.md", "example.c"}
    assert {path.name for path in (folder / "src").iterdir()} == {path.name for path in plain.iterdir()} - own
    assert all(path.read_bytes() == (plain / path.name).read_bytes() for path in (folder / "src").iterdir())
    assert (folder / "selftest/selftest.c").read_bytes() == (
        exported("arduino") / "selftest/selftest.c"
    ).read_bytes()
    page = (folder / "README.md").read_text()
    command = {
        "cmake": "cmake",
        "platformio": "pio",
        "arduino": "arduino-cli",
        "zephyr": "west",
        "esp-idf": "idf.py",
    }
    assert [name for name, word in command.items() if f"\n{word} " in page] == [manager]
    for loop in folder.rglob("loop.c"):
        run("cc", "-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{folder / 'src'}", "-fsyntax-only", loop)


def test_the_command_knows_all(capsys):
    assert export.PACKAGES == tuple(PACKAGES)
    assert main(["export", "labmate", "--package", "conan", "-o", "nowhere"]) == 2
    said = capsys.readouterr().err
    assert "conan" in said and "esp-idf" in said and said.count("\n") == 1

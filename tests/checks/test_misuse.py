"""The table of mistakes in docs/firmware.md: each is made, and what catches it is what the table says."""

import re
import subprocess
from collections.abc import Callable

import pytest
from noslip.checks.guarantees.vehicle import ROOT, STOP, Firmware, FirmwareLoop, SettingsRefused
from noslip.codegen.runtime import RUNTIME
from noslip.tests.tools import need

TICKS = 2600  # 26 s; the run without a mistake arrives in 22 s
COMPILER, INIT, RUNNING, NOTHING = "the compiler", "`init`", "the first seconds", "nothing"

PROGRAM = """
#include "labmate_type_iv_circle_f.h"
int start(labmate_type_iv_circle_f *law, const labmate_params_f *params,
    const labmate_type_iv_circle_config_f *place);
int start(labmate_type_iv_circle_f *law, const labmate_params_f *params,
    const labmate_type_iv_circle_config_f *place)
{
    const labmate_type_iv_circle_gains_f gains = {1.0f, 2.5f, 2.0f};
    const labmate_options_f options = {.limit = {20.0f, 20.0f}, .on_error = NOSLIP_ZERO};
    return labmate_type_iv_circle_init_f(law, params, place, &gains, &options);
}
"""
COMPILED = {  # a change of the program, or flags -> what gcc -Wextra says, for enums clang
    "`on_error = NOSLIP_SLOW`, an enum of another option": (
        ("NOSLIP_ZERO", "NOSLIP_SLOW"),
        (),
        "enum-conversion",
    ),
    "the status of `init` is ignored": (("return labmate", "(void)labmate"), (), "unused"),
    "`init` of double with structs of float": (
        ("circle_init_f(", "circle_init("),
        (),
        "labmate_type_iv_circle_init",
    ),
    "gains and options are exchanged": (
        ("&gains, &options", "&options, &gains"),
        (),
        "incompatible-pointer-types",
    ),
    "`-ffast-math`": (("", ""), ("-ffast-math",), "compile without -ffast-math"),
    "headers of another version": (
        ("", ""),
        ("-DNOSLIP_VERSION_H", "-DNOSLIP_VERSION_NUMBER=400"),
        "use the runtime of",
    ),
}


def swapped(counts) -> None:
    counts[0], counts[1] = counts[1], counts[0]


def both(name: str, *values: float) -> dict[str, float]:
    """A change of one member for both wheels."""
    return {name.format(wheel): value for wheel, value in enumerate(values * (3 - len(values)))}


# What catches it, how it is made: changes of the config, of the counts, of the commands
MADE: dict[str, tuple[str, dict]] = {
    "the period in milliseconds: 10": (INIT, {"config": {"period": 10.0}}),
    "a radius of a segment as its curvature": (INIT, {"segment": {"curvature": 2.5}}),
    "headings of segments in degrees": (INIT, {"segment": {"heading": 90.0}}),
    "the sign of d, P_c behind the axle": (INIT, {"config": {"params__d": -0.3}}),
    "a gain left out": (INIT, {"config": {"gains__kp_distance": 0.0}}),
    "no limit of torque and no motor": (
        INIT,
        {"config": {**both("motors__{}__mode", 0), **both("limits__limit__{}", 0.0)}},
    ),
    "the period 1000 times too short: 1e-5": (RUNNING, {"config": {"period": 1e-5}}),
    "counts per turn of the motor, without the gear": (
        RUNNING,
        {"config": both("counts_per_turn__{}", 2000.0, -2000.0)},
    ),
    "lines instead of edges: a quarter of the counts": (
        RUNNING,
        {"config": both("counts_per_turn__{}", 10000.0, -10000.0)},
    ),
    "32 bits for a counter of 16": (RUNNING, {"config": {"counter_bits": 32}}),
    "one encoder counts backwards": (RUNNING, {"config": {"counts_per_turn__0": -40000.0}}),
    "right and left motor exchanged": (RUNNING, {"commands": lambda a, b: (b, a)}),
    "one motor turns backwards": (RUNNING, {"commands": lambda a, b: (-a, b)}),
    "the wheel radius in centimetres": (RUNNING, {"config": {"params__r": 15.0}}),
    "both motors turn backwards": (NOTHING, {"commands": lambda a, b: (-a, -b)}),
    "right and left encoder exchanged, or both backwards": (NOTHING, {"counts": swapped}),
    "kp and kd exchanged": (NOTHING, {"config": {"gains__kp_distance": 2.5, "gains__kd_distance": 1.0}}),
    "the mass in grams": (NOTHING, {"config": {"params__m_c": 30000.0}}),
    "the track instead of half of it as b": (NOTHING, {"config": {"params__b": 1.5}}),
    "a speed in km/h": (NOTHING, {"config": {"path__speed": 3.6}}),
}


@pytest.fixture(scope="module")
def c(tmp_path_factory) -> Firmware:
    return Firmware(tmp_path_factory.mktemp("headers"))


def caught_by(
    c: Firmware,
    config: dict | None = None,
    segment: dict | None = None,
    counts: Callable = lambda counts: None,
    commands: Callable = lambda first, second: (first, second),
) -> str:
    """Drive the simulated vehicle with a mistake, and return what catches it."""
    try:
        loop = FirmwareLoop(c, **(config or {}))
        if segment:
            segments = c.ffi.new(
                "noslip_segment_f[]", [loop.settings.segments[k] for k in range(loop.settings.count)]
            )
            for name, value in segment.items():
                setattr(segments[2 if name == "heading" else 1], name, value)
            loop.settings.segments = segments
            c.vehicle(loop.settings)
    except SettingsRefused:
        return INIT
    for _ in range(TICKS):
        loop.tick(counts)
        c.lib.board_drive(commands(*loop.command))
        if loop.state == STOP:
            return RUNNING
    return NOTHING


def rows() -> dict[str, str]:
    """Mistake -> what catches it, from the page."""
    text = (ROOT / "docs/firmware.md").read_text()
    table = text[text.index("| mistake |") :].split("\n\n")[0]
    return {
        row[0].strip(): row[1].strip()
        for row in re.findall(r"^\| (.*?) \| (.*?) \|", table, re.MULTILINE)[1:]
    }


def test_page_has_every_mistake():
    made = {**dict.fromkeys(COMPILED, COMPILER), **{name: catch for name, (catch, _) in MADE.items()}}
    found = rows()
    assert len(found) >= 20 and {name: found.get(name) for name in made} == made
    # tests/runtime_c/test_runtime.py
    assert set(found) - set(made) == {"`init` is forgotten", "no options: NULL"}


@pytest.mark.parametrize(
    "name", [name for name in MADE if "the mass" not in name and "centimetres" not in name]
)
def test_mistake(c, name):
    catch, how = MADE[name]
    assert caught_by(c, **how) == catch


@pytest.mark.nightly
@pytest.mark.parametrize("name", MADE)
def test_every_mistake(c, name):
    catch, how = MADE[name]
    assert caught_by(c, **how) == catch


def test_without_a_mistake_nothing_is_caught(c):
    assert caught_by(c) == NOTHING


@pytest.mark.parametrize("name", ["", *COMPILED])
def test_compiler_sees(tmp_path, name):
    """As an error with -Werror; the program without a mistake compiles."""
    change, flags, said = COMPILED.get(name, (("", ""), (), ""))
    (tmp_path / "main.c").write_text('#include "labmate_type_iv_circle.h"\n' + PROGRAM.replace(*change))
    compiler = need("clang" if "enum" in said else "gcc")
    command = [compiler, "-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{RUNTIME}"]
    command += [f"-I{ROOT / 'generated/labmate'}", *flags, "-c", "main.c", "-o", "main.o"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode != 0) == bool(name) and said in done.stderr, done.stderr

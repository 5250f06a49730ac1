"""The C itself, generated and hand-written: warnings, what it links to, statuses,
bits on every compiler, random input."""

import math
import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import cffi
import noslip
import numpy as np
import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.codegen.runtime import RUNTIME, runtime_files
from noslip.codegen.targets import STANDARD
from noslip.model.outputs import OUTPUTS
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.controllers.runtime import declarations, runtime
from noslip.tests.tools import HOST_CC, need

ROOT = Path(noslip.__file__).parent
GENERATED, DRIVERS = ROOT / "generated" / "labmate", ROOT / "tests" / "c"
INCLUDE = [f"-I{folder}" for folder in (RUNTIME, GENERATED, DRIVERS)]
SOURCES = sorted(str(path) for folder in (RUNTIME, GENERATED) for path in folder.glob("*.c"))
FLOAT_SOURCES = [source for source in SOURCES if source.endswith("_f.c")]
FLAGS = list(STANDARD)
LEVELS = ("-O0", "-O2")
# as in the strict set for firmware
STRICT = (
    "-pedantic -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Wfloat-conversion "
    "-Wfloat-equal -Wshadow -Wundef -Wcast-qual -Wc++-compat -Wstrict-prototypes -Wmissing-prototypes -Wvla "
    "-Werror"
).split()
SCALARS = {"double": "", "float": "_f"}

compilers = pytest.mark.parametrize("cc", ["gcc", "clang"])
each_level = pytest.mark.parametrize("level", LEVELS)
each_law = pytest.mark.parametrize("law", list(OUTPUTS))
each_scalar = pytest.mark.parametrize("scalar", list(SCALARS))


def run(command: list[str], **options) -> str:
    """Standard output of a command that must succeed and say nothing on stderr."""
    result = subprocess.run(command, capture_output=True, text=True, **options)
    assert result.returncode == 0 and result.stderr == "", (
        f"{' '.join(command[:1] + command[-3:])}\n{result.stdout}{result.stderr}"
    )
    return result.stdout


def objects(cc: str, flags: list[str], folder: Path, sources: list[str] = SOURCES) -> list[str]:
    """Compile sources, two at a time; the objects' names."""
    need(cc)
    folder.mkdir(exist_ok=True)
    made = [str(folder / f"{Path(source).stem}.o") for source in sources]
    with ThreadPoolExecutor(2) as pool:
        command = [cc, *FLAGS, *flags, *INCLUDE, "-c"]
        list(pool.map(lambda pair: run([*command, pair[0], "-o", pair[1]]), zip(sources, made, strict=True)))
    return made


# -- headers and settings ------------------------------------------------------------------------------------


@compilers
@pytest.mark.parametrize(
    "header", sorted(path.name for folder in (RUNTIME, GENERATED) for path in folder.glob("*.h"))
)
def test_a_header_stands_alone(cc, header, tmp_path):
    """Included first, twice, and with nothing else."""
    source = tmp_path / "alone.c"
    source.write_text(
        f'#include "{header}"\n#include "{header}"\nint nothing(void);\nint nothing(void) {{ return 0; }}\n'
    )
    run([need(cc), *FLAGS, *STRICT, *INCLUDE, "-fsyntax-only", str(source)])


@pytest.mark.parametrize("cxx", ["g++", "clang++"])
@pytest.mark.parametrize("standard", ["c++11", "c++20"])
def test_headers_in_cpp(cxx, standard, tmp_path):
    """Every header in one C++ program, and it links with the C."""
    includes = "".join(f'#include "{path.name}"\n' for path in sorted(GENERATED.glob("*.h")))
    main = (
        "int main() { labmate_params p; return noslip_status_name(labmate_default_params(&p))[0] != 'o'; }\n"
    )
    (tmp_path / "main.cpp").write_text(includes + main)
    c = objects(
        HOST_CC, ["-O1"], tmp_path, [s for s in SOURCES if Path(s).name in ("labmate.c", "noslip_status.c")]
    )
    flags = [f"-std={standard}", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    run([need(cxx), *flags, *INCLUDE, str(tmp_path / "main.cpp"), *c, "-o", str(tmp_path / "main")])
    run([str(tmp_path / "main")])


FAST = [
    "-ffast-math",
    "-Ofast",
    "-ffinite-math-only",
    "-fassociative-math -fno-signed-zeros -fno-trapping-math",
]


@compilers
@pytest.mark.parametrize(
    "flag", [*FAST, "-freciprocal-math", "-fno-signed-zeros", "-funsafe-math-optimizations"]
)
def test_fast_math_is_refused(cc, flag):
    """clang has a macro for the whole and for finite-only; its other parts it does not tell."""
    command = [need(cc), "-std=c99", *flag.split(), *INCLUDE, "-fsyntax-only", str(GENERATED / "labmate.c")]
    if cc == "clang" and flag not in FAST[:3]:
        pytest.skip("clang does not tell by a macro")
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode != 0 and "noslip: compile without -ffast-math" in result.stderr


@pytest.mark.parametrize("flag", ["-mfpmath=387", "-fsingle-precision-constant"])
def test_other_arithmetic_is_refused(flag):
    command = [need("gcc"), "-std=c99", flag, *INCLUDE, "-fsyntax-only", str(GENERATED / "labmate.c")]
    probe = subprocess.run([*command[:3], "-E", "-x", "c", "/dev/null"], capture_output=True)
    if probe.returncode:
        pytest.skip(f"{flag} is not for this machine")
    assert subprocess.run(command, capture_output=True).returncode != 0


# -- what it links to ----------------------------------------------------------------------------------------


@compilers
@each_level
def test_needs_no_library(cc, level, built, tmp_path):
    """Undefined symbols are the package's own, but for what the follower copies;
    everything links into one bare program."""
    made = built(cc, level)
    copies = objects(
        cc, ["-O2", "-ffreestanding", "-fPIC"], tmp_path / "string", [str(ROOT / "firmware/boards/string.c")]
    )
    without = [code for code in made if "follower" not in code]
    assert not {"memcpy", "memset"} & {
        line.split()[-1] for line in run(["nm", "-u", *without]).splitlines() if line.split()
    }
    made = [*made, *copies]
    own = {
        line.split()[-1]
        for line in run(["nm", "--defined-only", *made]).splitlines()
        if len(line.split()) == 3
    }
    wanted = {line.split()[-1] for line in run(["nm", "-u", *made]).splitlines() if line.split()[:1] == ["U"]}
    assert wanted - {"_GLOBAL_OFFSET_TABLE_"} <= own
    run([cc, "-nostdlib", "-shared", "-Wl,-z,defs", *made, "-o", str(tmp_path / "all.so")])


@compilers
@each_level
def test_float_side_has_no_double(cc, level, built):
    need("objdump")
    made = [code for code in built(cc, level) if code.endswith("_f.o")]
    assert len(made) == len(FLOAT_SOURCES)
    for code in made:
        listing = run(["objdump", "-d", "--no-show-raw-insn", code])
        # SSE2 arithmetic and conversion on doubles ends in sd or pd; movement of bits (movapd, movsd) does
        # not count
        found = re.findall(
            r"\t(v?(?:add|sub|mul|div|sqrt|max|min|ucomi|comi|cvt\w*|cmp\w*|round)(?:sd|pd)\w*)\b", listing
        )
        found += re.findall(r"\t(v?cvt(?:sd|pd)2\w+)", listing)
        assert not found, (code, found)
        assert not re.search(r"\t(f(?:ld|add|mul|div|sqrt)\w*)\b", listing)


@compilers
def test_no_globals_that_change(cc, built):
    made = built(cc, "-O2")
    kinds = {
        line.split()[1]
        for line in run(["nm", "--defined-only", *made]).splitlines()
        if len(line.split()) == 3
    }
    assert kinds <= set("Ttr"), "data or bss"
    names = [
        line.split()[-1]
        for line in run(["nm", "-g", "--defined-only", *made]).splitlines()
        if len(line.split()) == 3
    ]
    assert len(names) == len(set(names)) and all(name.startswith(("labmate_", "noslip_")) for name in names)


# -- sine, cosine, square root, other functions --------------------------------------------------------------


@pytest.fixture(scope="module")
def trig_sweep(tmp_path_factory) -> str:
    program = str(tmp_path_factory.mktemp("trig") / "trig_sweep")
    run([HOST_CC, *FLAGS, "-O2", *INCLUDE, str(DRIVERS / "trig_sweep.c"), "-lm", "-o", program])
    return program


@pytest.mark.parametrize(
    "mode", ["float 101", "double 1000000 1992", "functions 4999 100000 1992", "sqrt 1000000 7"]
)
def test_trig_and_roots(trig_sweep, mode):
    """A sample; make trig-sweep tries every float."""
    result = subprocess.run([trig_sweep, *mode.split()], capture_output=True, text=True)
    assert result.returncode == 0, result.stdout


# -- warnings ------------------------------------------------------------------------------------------------


@compilers
@each_level
def test_no_warnings(cc, level, built):
    """What clang warns of does not depend on the level; test_bits.py sees to it that all levels give the same
    bits."""
    built(cc, level)


@pytest.mark.nightly
@pytest.mark.parametrize("more", ["-O1", "-O3", "-Os", "-O2 -fanalyzer"])
def test_no_warnings_from_the_flow_of_data(more, tmp_path):
    """gcc follows it differently at each level; the sources in double are the same text with other types."""
    objects(HOST_CC, [*more.split(), *STRICT], tmp_path, FLOAT_SOURCES)


# -- one program with everything, seen from here -------------------------------------------------------------


@pytest.fixture(scope="module")
def program(built, tmp_path_factory):
    """ffi and library of all laws in both scalars, declarations as the headers have them."""
    library = tmp_path_factory.mktemp("program") / "all.so"
    run([HOST_CC, "-shared", *built(HOST_CC, "-O2"), "-o", str(library)])
    ffi = cffi.FFI()
    ffi.cdef(declarations("noslip_grip.h"))
    laws = [path for path in GENERATED.glob("*.h") if not re.search("follower|telemetry|ekf", path.name)]
    for header in sorted(laws, key=lambda path: len(path.name)):
        text = re.sub(
            r'extern "C" \{|^\}$',
            "",
            re.sub(r"^#if.*__cplusplus.*\n.*\n#endif", "", header.read_text(), flags=re.M),
        )
        ffi.cdef(
            "\n".join(
                line
                for line in text.replace("NOSLIP_NODISCARD ", "").splitlines()
                if not line.startswith("#")
            )
        )
    return ffi, ffi.dlopen(str(library))


@cache
def plant(law: str):
    """Parameters and regular points of a law."""
    made = next(iter(random_plants(law_of(find_robot("labmate"), law), 20, seed=13)))
    assert len(made.points) > 3
    return made


class Robot:
    """One law in one scalar with regular arguments, each struct to be changed before a call."""

    def __init__(self, program, law: str, scalar: str):
        self.ffi, self.lib = program
        self.law, self.suffix, self.real = law_of(find_robot("labmate"), law), SCALARS[scalar], scalar
        self.prefix = f"labmate_{law}"
        made = plant(law)
        self.params = self.struct("labmate_params", made.params)
        self.config = self.struct(f"{self.prefix}_config", made.config)
        self.gains = self.struct(f"{self.prefix}_gains", made.gains)
        self.options = self.struct("labmate_options", [])
        self.state = self.struct("labmate_state", made.points[0].state)
        self.reference = self.struct(f"{self.prefix}_reference", made.points[0].reference)
        self.self = self.ffi.new(f"{self.prefix}{self.suffix} *")
        self.tau = self.ffi.new(f"{scalar}[2]", [7.0, 7.0])
        self.v = self.ffi.new(f"{scalar}[2]", [0.5, 0.25])
        self.all = self.ffi.new(f"{self.prefix}_evaluation{self.suffix} *")

    def struct(self, name: str, values):
        made = self.ffi.new(f"{name}{self.suffix} *")
        for (field, _), value in zip(self.ffi.typeof(made).item.fields, values, strict=False):
            setattr(made, field, float(value))
        return made

    def at(self, point) -> None:
        """Take state and reference of a point."""
        for struct, values in ((self.state, point.state), (self.reference, point.reference)):
            for name, value in zip(self.fields(struct), values, strict=True):
                setattr(struct, name, float(value))

    def fields(self, struct) -> list[str]:
        return [name for name, _ in self.ffi.typeof(struct).item.fields]

    def call(self, function: str, *arguments) -> str:
        status = getattr(self.lib, f"{self.prefix}_{function}{self.suffix}")(*arguments)
        return self.ffi.string(self.lib.noslip_status_name(status)).decode()

    def init(self) -> str:
        return self.call("init", self.self, self.params, self.config, self.gains, self.options)

    def step(self) -> tuple[str, list[float]]:
        self.tau[0] = self.tau[1] = math.nan
        return self.call("step", self.self, self.state, self.reference, self.tau), list(self.tau)

    def evaluate(self) -> tuple[str, list[float]]:
        self.ffi.buffer(self.all)[:] = b"\xff" * self.ffi.sizeof(self.all[0])
        status = self.call("evaluate", self.self, self.state, self.reference, self.all)
        kind = np.float32 if self.suffix else np.float64
        return status, np.frombuffer(self.ffi.buffer(self.all), kind).tolist()

    def answers(self) -> dict[str, tuple[str, list[float]]]:
        """Every entry point's status and values."""
        found = {"step": self.step(), "evaluate": self.evaluate()}
        for name, shape in (
            ("output", "[2]"),
            ("rate", "[2]"),
            ("decoupling", "[2][2]"),
            ("decoupling_rate", "[2][2]"),
        ):
            if hasattr(self.lib, f"{self.prefix}_{name}{self.suffix}"):
                count = 1 if name == "rate" and 1 in self.law.linearization.relative_degree else 2
                value = self.ffi.new(f"{self.real}{shape}")
                self.ffi.buffer(value)[:] = b"\xff" * self.ffi.sizeof(value)
                status = self.call(name, self.self, self.state, value)
                flat = [x for row in value for x in row] if "][" in shape else list(value)[:count]
                found[name] = status, flat
        self.tau[0] = self.tau[1] = math.nan
        found["feedback"] = self.call("feedback", self.self, self.state, self.v, self.tau), list(self.tau)
        return found


@pytest.fixture
def robot(program, law, scalar) -> Robot:
    made = Robot(program, law, scalar)
    assert made.init() == "ok"
    return made


def assert_answered(answers: dict, status: str, but: dict[str, str] | None = None) -> None:
    """All have the status, and zeros where it is an error; `but` names those with another."""
    for name, (found, values) in answers.items():
        assert found == (but or {}).get(name, status), name
        assert np.all(np.isfinite(values)) if found == "ok" else values == [0.0] * len(values), name


@each_scalar
@each_law
def test_good_answers(robot):
    for point in plant(robot.law.name).points:
        robot.at(point)
        answers = robot.answers()
        assert_answered(answers, "ok")
        assert answers["evaluate"][1][-2:] == answers["step"][1] or np.allclose(
            answers["evaluate"][1][-2:], answers["step"][1], rtol=1e-3 if robot.suffix else 1e-11
        )


@each_scalar
@each_law
def test_null_pointers(robot):
    null, kind = robot.ffi.NULL, robot.real
    good = [robot.self, robot.params, robot.config, robot.gains]
    for k in range(4):
        assert robot.init() == "ok"
        arguments = [null if i == k else argument for i, argument in enumerate(good)]
        assert robot.call("init", *arguments, robot.options) == "null"
        if k:  # init failed: the law is not ready, and its old constants are not used
            assert_answered(robot.answers(), "not_ready")
    assert robot.call("init", *good, null) == "ok"
    assert robot.call("reset", null) == "null"
    for function, given in (
        ("step", [robot.reference]),
        ("evaluate", [robot.reference]),
        ("feedback", [robot.v]),
        ("output", []),
        ("rate", []),
        ("decoupling", []),
        ("decoupling_rate", []),
    ):
        answer = (
            robot.all
            if function == "evaluate"
            else robot.ffi.new(f"{kind}[2][2]" if "decoup" in function else f"{kind}[2]")
        )
        arguments = [robot.self, robot.state, *given, answer]
        size = robot.ffi.sizeof(answer[0]) if function == "evaluate" else robot.ffi.sizeof(answer)
        if function == "rate" and 1 in robot.law.linearization.relative_degree:
            size //= 2
        for k in range(len(arguments)):
            robot.ffi.buffer(answer)[:] = b"\xff" * len(robot.ffi.buffer(answer))
            assert robot.call(function, *[null if i == k else a for i, a in enumerate(arguments)]) == "null"
            if k < len(arguments) - 1:
                assert bytes(robot.ffi.buffer(answer))[:size] == b"\0" * size, (function, k)
    for name in ("default_params", "check_params", "check_state"):
        assert getattr(robot.lib, f"labmate_{name}{robot.suffix}")(null) == -1


@each_scalar
@each_law
def test_not_finite(robot):
    """NaN and infinities in every part of the state, the reference and the demand."""
    for bad in (math.nan, math.inf, -math.inf):
        for struct, unaffected in (
            (robot.state, []),
            (robot.reference, ["output", "rate", "decoupling", "decoupling_rate", "feedback"]),
        ):
            for name in robot.fields(struct):
                good = getattr(struct, name)
                setattr(struct, name, bad)
                assert_answered(robot.answers(), "nonfinite", dict.fromkeys(unaffected, "ok"))
                setattr(struct, name, good)
        for k in range(2):
            robot.v[k] = bad
            assert robot.call("feedback", robot.self, robot.state, robot.v, robot.tau) == "nonfinite"
            assert list(robot.tau) == [0.0, 0.0]
            robot.v[k] = 0.5
    assert_answered(robot.answers(), "ok")


@each_scalar
@each_law
def test_refused_numbers(robot):
    """Every parameter, configuration value, gain and limit: not finite, or of the wrong sign."""
    groups = (
        (robot.params, robot.law.parameters),
        (robot.config, robot.law.config),
        (robot.gains, robot.law.gains),
    )
    for struct, quantities in groups:
        assert robot.fields(struct) == [q.name for q in quantities]
        for q in quantities:
            good = getattr(struct, q.name)
            wrong = {"positive": [0.0, -0.0, -1.0], "nonnegative": [-1.0, -1e-30], "any": []}[q.sign]
            for bad in [math.nan, math.inf, -math.inf, *wrong]:
                setattr(struct, q.name, bad)
                assert robot.init() == "bad_parameter", (q.name, bad)
                assert_answered(robot.answers(), "not_ready")
            setattr(struct, q.name, good)
            assert robot.init() == "ok"
    for k in range(2):
        for bad in (math.nan, math.inf, -math.inf, -1.0):
            robot.options.limit[k] = bad
            assert robot.init() == "bad_parameter"
            assert_answered(robot.answers(), "not_ready")
        robot.options.limit[k] = 0
    for bad in (-1, 2, 2**31 - 1):
        robot.options.on_error = bad
        assert robot.init() == "bad_parameter"
    robot.options.on_error = 0
    speeds = robot.law.linearization.relative_degree.count(1)
    for bad in (-1, 2, 2**31 - 1, *([] if speeds == 1 else [1])):
        robot.options.on_limit = bad
        assert robot.init() == "bad_parameter"
        assert_answered(robot.answers(), "not_ready")
    robot.options.on_limit = speeds
    assert robot.init() == "ok"


@each_scalar
@each_law
def test_tiny_and_huge_parameters(robot):
    """What overflows or vanishes on the way is refused by init or a status of the step,
    never an answer that is not finite."""
    huge = 1e38 if robot.suffix else 1e300
    for struct in (robot.params, robot.config, robot.gains):
        for name in robot.fields(struct):
            good = getattr(struct, name)
            for value in (huge, 1 / huge, 5e-324 if not robot.suffix else 1e-45):
                setattr(struct, name, value)
                ready = robot.init()
                assert ready in (
                    "ok",
                    "bad_parameter",
                    "singular",
                    *(["range"] if name == "direction" else []),
                )
                for status, values in robot.answers().values():
                    assert np.all(np.isfinite(values)), name
                    assert (
                        status == "not_ready"
                        if ready != "ok"
                        else status in ("ok", "nonfinite", "singular", "range")
                    )
            setattr(struct, name, good)


@each_scalar
@each_law
def test_huge_states(robot):
    huge = 1e38 if robot.suffix else 1e300
    for struct in (robot.state, robot.reference):
        for name in robot.fields(struct):
            good = getattr(struct, name)
            for value in (huge, -huge):
                setattr(struct, name, value)
                for status, values in robot.answers().values():
                    assert status in ("ok", "nonfinite", "singular", "range"), (name, status)
                    assert np.all(np.isfinite(values)) and (status == "ok" or not np.any(values))
            setattr(struct, name, good)
    for name in robot.fields(robot.state)[:2] + robot.fields(robot.state)[3:]:
        setattr(robot.state, name, huge)
    for status, values in robot.answers().values():
        assert status in ("ok", "nonfinite", "singular") and np.all(np.isfinite(values))


@each_scalar
@each_law
def test_angle_out_of_range(robot):
    largest = 8192.0 if robot.suffix else 2.0**20
    beyond = float(np.nextafter(np.float32(largest) if robot.suffix else largest, np.inf, dtype=None))
    for sign in (1, -1):
        robot.state.phi = sign * largest
        assert all(status in ("ok", "singular") for status, _ in robot.answers().values())
        for angle in (beyond, 2 * largest, 1e30):
            robot.state.phi = sign * angle
            assert_answered(robot.answers(), "range")
    robot.state.phi = 0.3
    robot.state.theta_r, robot.state.theta_l = 1e30, -1e30  # no sine is taken of these
    assert robot.step()[0] in ("ok", "singular")


SINGULAR = {  # l = 0 everywhere but in Types II and III; the heading normal to the path, or along y or x
    "type_i": {"config": {"L": "-d"}},
    "type_ii": {"state": {"phi": math.pi / 2}},
    "type_iii": {"state": {"phi": 0.0}},
    "type_iv_line": {"config": {"A": 1.0, "B": 0.0, "C": 0.0}, "state": {"phi": math.pi}},
    "type_iv_circle": {"config": {"x_f": 0.0, "y_f": 0.0}, "state": {"x_c": 9.0, "y_c": 0.0, "phi": 0.0}},
    "type_iv_ellipse": {
        "config": {"a": 4.0, "b": 2.0},
        "state": {"x_c": 0.0, "y_c": 3.0, "phi": -math.pi / 2},
    },
    "type_iv_segment": {"config": {"direction": 0.0, "curvature": 0.0}, "state": {"phi": math.pi / 2}},
}
INVERTING = ("step", "evaluate", "feedback")


def set_all(robot: Robot, changes: dict) -> None:
    for group, values in changes.items():
        for name, value in values.items():
            setattr(getattr(robot, group), name, -robot.params.d if value == "-d" else value)


@each_scalar
@each_law
def test_singular(robot):
    set_all(robot, SINGULAR[robot.law.name])
    if robot.init() == "ok":
        assert_answered(robot.answers(), "ok", dict.fromkeys(INVERTING, "singular"))
    else:
        assert robot.init() == "singular"
        assert_answered(robot.answers(), "not_ready")
    if "phi" in SINGULAR[robot.law.name].get("state", {}):
        robot.state.phi += 0.2
        assert_answered(robot.answers(), "ok")


@each_scalar
@each_law
def test_point_on_the_axle_is_singular(robot):
    """l = L + d = 0: Types I and IV have no inverse in any state."""
    if robot.law.name in ("type_ii", "type_iii"):
        pytest.skip("regular there")
    robot.config.L = -robot.params.d
    if robot.init() == "ok":
        assert all(robot.answers()[name][0] == "singular" for name in INVERTING)
    else:
        assert robot.init() == "singular"


@each_scalar
@pytest.mark.parametrize("law", ["type_iv_line"])
def test_no_line(robot):
    robot.config.A = robot.config.B = 0.0
    assert robot.init() == "bad_parameter"
    assert_answered(robot.answers(), "not_ready")


@each_scalar
@pytest.mark.parametrize("law", ["type_iv_circle", "type_iv_ellipse"])
def test_centre_of_the_path(robot):
    """P_l where the distance has no derivative: singular, no division by zero."""
    robot.config.L = robot.state.phi = robot.state.x_c = robot.state.y_c = 0.0
    if robot.law.name == "type_iv_circle":
        robot.config.x_f = robot.config.y_f = 0.0
    assert robot.init() == "ok"
    answers = robot.answers()
    assert all(status in ("ok", "singular") for status, _ in answers.values())
    assert all(
        answers[name][0] == "singular" for name in (*INVERTING, "rate", "decoupling", "decoupling_rate")
    )
    assert all(np.all(np.isfinite(values)) for _, values in answers.values())


@each_scalar
@each_law
def test_never_made(program, law, scalar):
    """Memory of any content that init has not seen answers not_ready and zeros."""
    robot = Robot(program, law, scalar)
    source = np.random.default_rng(8)
    size = robot.ffi.sizeof(robot.self[0])
    for content in (
        bytes(size),
        b"\xff" * size,
        b"\x01\0\0\0" * (size // 4),
        *(source.bytes(size) for _ in range(50)),
    ):
        robot.ffi.buffer(robot.self)[:size] = content.ljust(size, b"\0")
        robot.self.ready = 0 if robot.self.ready == 0x5EED1992 else robot.self.ready
        for on_error in (robot.self.on_error, 1):
            robot.self.on_error = on_error
            robot.self.held[0] = math.nan
            assert_answered(robot.answers(), "not_ready")


@each_scalar
@each_law
def test_limits(robot):
    _, free = robot.step()
    assert all(abs(value) > 1e-3 for value in free)
    for k in range(2):
        other = 1 - k
        robot.options.limit[k], robot.options.limit[other] = abs(free[k]) / 4, 0
        assert robot.init() == "ok"
        status, tau = robot.step()
        assert status == "saturated" and tau[other] == free[other]
        assert tau[k] == math.copysign(robot.options.limit[k], free[k])
    robot.options.limit[0], robot.options.limit[1] = abs(free[0]), abs(free[1])  # just not cut
    assert robot.init() == "ok"
    assert robot.step() == ("ok", free)
    assert robot.evaluate()[0] == "ok"  # the law itself, without limits
    robot.options.limit[0] = robot.options.limit[1] = abs(min(free, key=abs)) * 0.9
    assert robot.init() == "ok"
    assert robot.step() == ("saturated", [math.copysign(robot.options.limit[0], value) for value in free])


@each_scalar
@each_law
@pytest.mark.parametrize("hold", [0, 1])
def test_answer_on_an_error(robot, hold):
    robot.options.on_error = hold
    assert robot.init() == "ok"
    good = robot.state.x_c

    def failing() -> list[float]:
        robot.state.x_c = math.nan
        status, tau = robot.step()
        robot.state.x_c = good
        assert status == "nonfinite"
        return tau

    assert failing() == [0.0, 0.0]  # nothing to hold yet
    answers = []
    for point in plant(robot.law.name).points[:3]:
        robot.at(point)
        good = robot.state.x_c
        status, tau = robot.step()
        answers.append(tau)
        assert status == "ok" and failing() == (tau if hold else [0.0, 0.0]) == failing()
    assert answers[0] != answers[1] != answers[2]
    null = robot.call("step", robot.self, robot.ffi.NULL, robot.reference, robot.tau), list(robot.tau)
    assert null == ("null", answers[-1] if hold else [0.0, 0.0])
    assert robot.call("reset", robot.self) == "ok"
    assert failing() == [0.0, 0.0]
    assert robot.step() == ("ok", answers[-1])  # reset does not forget the law


@each_scalar
@each_law
def test_no_options_are_zeros(robot):
    """Null: no limits, zeros on an error, whatever the struct held before."""
    _, free = robot.step()
    robot.options.on_error, robot.options.limit[0], robot.options.limit[1] = 1, 1e-3, 1e-3
    assert robot.init() == "ok" and robot.step()[0] == "saturated"
    assert robot.call("init", robot.self, robot.params, robot.config, robot.gains, robot.ffi.NULL) == "ok"
    assert robot.step() == ("ok", free)
    robot.state.phi = math.nan
    assert robot.step() == ("nonfinite", [0.0, 0.0])


@each_scalar
@each_law
def test_held_is_what_was_cut(robot):
    _, free = robot.step()
    robot.options.limit[0], robot.options.on_error = abs(free[0]) / 2, 1
    assert robot.init() == "ok"
    _, cut = robot.step()
    robot.state.phi = math.nan
    assert robot.step() == ("nonfinite", cut)


@each_scalar
@each_law
def test_init_again_forgets_what_was_held(robot):
    robot.options.on_error = 1
    assert robot.init() == "ok" and robot.step()[0] == "ok"
    assert robot.init() == "ok"
    robot.state.phi = math.nan
    assert robot.step() == ("nonfinite", [0.0, 0.0])


def test_status_names(program):
    ffi, lib = program
    names = {status: ffi.string(lib.noslip_status_name(status)).decode() for status in range(-15, 9)}
    assert names[0] == "ok" and names[1] == "saturated" and names[-6] == "not_ready"
    assert len({names[status] for status in range(-14, 7)}) == 21
    assert all(names[status] == "unknown" for status in (-15, 7, 8))


@each_scalar
def test_default_parameters(program, scalar):
    robot = Robot(program, "type_i", scalar)
    assert getattr(robot.lib, f"labmate_default_params{robot.suffix}")(robot.params) == 0
    kind = np.float32 if robot.suffix else np.float64
    for q in robot.law.parameters:
        assert getattr(robot.params, q.name) == float(kind(q.default))
    assert getattr(robot.lib, f"labmate_check_params{robot.suffix}")(robot.params) == 0


def test_controllers_do_not_touch_each_other(program):
    """Every law in both scalars, two of each with different parameters, stepped in turn:
    the bits of each are those alone."""

    def controllers() -> list[Robot]:
        made = []
        for law in OUTPUTS:
            for scalar in SCALARS:
                for mass in (20.0, 55.0):
                    robot = Robot(program, law, scalar)
                    robot.params.m_c, robot.options.on_error = mass, 1
                    robot.options.limit[0] = 30.0
                    assert robot.init() == "ok"
                    made.append(robot)
        return made

    def one_step(robot: Robot, k: int):
        points = plant(robot.law.name).points
        robot.at(points[k % len(points)])
        if k % 5 == 4:
            robot.state.phi = math.inf
        return robot.step(), robot.evaluate()

    alone = [[one_step(robot, k) for k in range(20)] for robot in controllers()]
    together: list[list] = [[] for _ in alone]
    interleaved = controllers()
    for k in range(20):
        for robot, answers in zip(interleaved, together, strict=True):
            answers.append(one_step(robot, k))
    assert together == alone
    assert len({str(answers) for answers in alone}) == len(alone)


def test_users_get_the_c_that_is_written_by_hand(tmp_path):
    """Headers for users, with both scalars written out, are to a compiler those in which one text is included
    for each scalar; no macro of the scalar is left behind."""
    files = runtime_files()
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    headers = sorted(name for name in files if name.endswith(".h"))
    assert headers == sorted(path.name for path in RUNTIME.glob("*.h"))
    source = "".join(f'#include "{name}"\n' for name in headers)

    def preprocessed(folder: Path, kind: str) -> str:
        command = [need(HOST_CC), "-std=c99", "-E", kind, f"-I{folder}", "-x", "c", "-"]
        return subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout

    tokens = preprocessed(RUNTIME, "-P").split()
    assert tokens == preprocessed(tmp_path, "-P").split() and "noslip_nearest_angle_f" in "".join(tokens)
    macros = preprocessed(RUNTIME, "-dM").splitlines()
    assert sorted(macros) == sorted(preprocessed(tmp_path, "-dM").splitlines())
    assert not [
        text
        for text in (*macros, *map(files.get, headers))
        if re.search(r"\bNOSLIP_(?:REAL|NAME|MODULE)\b", text)
    ]


def test_each_public_name_is_in_a_header():
    """Each function that the runtime's library has stands in a header for users by its whole name,
    in double and in float."""
    text = "".join(text for name, text in runtime_files().items() if name.endswith(".h"))
    for header in ("angle", "disturbance", "integral", "odometry", "path", "reversing", "solve"):
        names = re.findall(r"\b(noslip_\w+)\(", declarations(f"noslip_{header}.h"))
        assert {name + "_f" for name in names} & set(names)
        for name in names:
            assert re.search(rf"\b{name}\(", text), name
            without = ("noslip_copy", "noslip_status", "noslip_version")  # a scalar
            assert name.endswith("_f") or name.startswith(without) or f"{name}_f(" in text, name


def test_version_is_that_of_the_package():
    """One source: __version__. The macros and the function agree with it."""
    made = runtime("noslip_version.h")
    text = (RUNTIME / "noslip_version.h").read_text()
    major, minor, patch = (int(part) for part in noslip.__version__.split(".")[:3])
    assert f'#define NOSLIP_VERSION "{noslip.__version__}"' in text
    assert f"#define NOSLIP_VERSION_NUMBER {10000 * major + 100 * minor + patch} " in text
    assert made.ffi.string(made.lib.noslip_version()).decode() == noslip.__version__


@compilers
@pytest.mark.parametrize("number", [None, 0, 100, 10000])
def test_generated_c_refuses_a_runtime_of_another_version(number, cc, tmp_path):
    """It compiles with the runtime of its own version (None) alone, and says what is wrong."""
    shutil.copytree(RUNTIME, tmp_path / "runtime")
    path = tmp_path / "runtime" / "noslip_version.h"
    if number is not None:
        path.write_text(re.sub(r"(NOSLIP_VERSION_NUMBER) \d+", rf"\1 {number + 1}", path.read_text()))
    for header in ("labmate.h", "labmate_type_i.h", "labmate_dynamics_f.h"):
        command = [
            cc,
            "-std=c99",
            *STRICT,
            f"-I{tmp_path / 'runtime'}",
            f"-I{GENERATED}",
            "-fsyntax-only",
            "-x",
            "c",
            "-",
        ]
        result = subprocess.run(command, input=f'#include "{header}"\n', capture_output=True, text=True)
        assert (result.returncode == 0) == (number is None), result.stderr
        expected = (f"{header} belongs to noslip", "labmate_f.h belongs to noslip")
        assert number is None or any(text in result.stderr for text in expected)


CHOICES = """
#include "labmate_type_iv_circle.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#define IS_INT(type) typedef char type##_is_an_int[sizeof(type) == sizeof(int) ? 1 : -1]
IS_INT(noslip_on_error);
IS_INT(noslip_on_limit);
IS_INT(noslip_on_reversing);
IS_INT(noslip_path_stop);
IS_INT(noslip_path_fault_kind);
IS_INT(noslip_path_stage);
IS_INT(noslip_correction);
void choose(labmate_options *options, noslip_path_options_f *path);
void choose(labmate_options *options, noslip_path_options_f *path)
{
    const noslip_on_error hold = NOSLIP_HOLD;
    options->on_error = NOSLIP_ZERO;
    options->on_error = hold;
    options->on_limit = NOSLIP_SLOW;
    path->reversing = NOSLIP_SWITCH;
    path->stop = NOSLIP_STOP_AXLE;
}
"""


@compilers
@pytest.mark.parametrize(
    "language",
    ["c -std=c99 -Wstrict-prototypes", "c -std=c99 -fshort-enums", "c++ -std=c++11", "c++ -std=c++17"],
)
def test_choices_have_types(language, cc, tmp_path):
    """The enums of public structs are types as wide as an int,
    and their values are assigned without a cast, in C and C++."""
    strict = [flag for flag in STRICT if flag not in ("-Wstrict-prototypes", "-Wmissing-prototypes")]
    command = [cc, *strict, "-x", *language.split(), f"-I{RUNTIME}", f"-I{GENERATED}", "-fsyntax-only", "-"]
    result = subprocess.run(command, input=CHOICES, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr

"""Names: what is refused where it is given, and that the C of every other name compiles beside all standard
headers."""

import re
import subprocess

import casadi as ca
import pytest
from noslip.codegen.files import robot_files
from noslip.codegen.program import ENTRIES
from noslip.codegen.runtime import runtime_files
from noslip.model import Mechanism, config, control_law
from noslip.model.errors import ModelError
from noslip.model.mechanism import quantity
from noslip.model.names import OF_LAW, OF_ROBOT, LawName, in_c, is_reserved, similar, without_offset
from noslip.model.outputs import OUTPUTS, output_map
from noslip.model.paths import PATHS
from noslip.model.reduction import reduce
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot
from noslip.simulation.controllers.build import compiler
from noslip.tests.tools import need

HEADERS = (
    "assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg "
    "stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype"
).split()
COMPILERS = {
    **{"gcc": ("gcc", "-std=c99"), "gcc gnu": ("gcc", "-std=gnu17"), "clang": ("clang", "-std=c99")},
    **{"arm": ("arm-none-eabi-gcc", "-std=gnu11"), "g++": ("g++", "-x", "c++", "-std=c++17")},
    **{"clang++": ("clang++", "-x", "c++", "-std=c++17")},
}
STRICT = "-Wall -Wextra -Werror -Wconversion -Wshadow -Wundef -ffp-contract=off -fno-math-errno".split()
ODD = (
    "state",
    "self",
    "tau",
    "params",
    "status",
    "reference",
    "gains",
    "limit",
    "held",
    "ready",
    "y1",
    "exp",
    "gamma",
    "index",
)


def every_header(cplusplus: bool = False) -> str:
    """Includes all that there are; C++ has neither complex.h of C nor atomics and threads of C."""
    names = [
        name
        for name in HEADERS
        if not (cplusplus and name in ("complex", "stdatomic", "tgmath", "threads", "stdnoreturn"))
    ]
    names = [name for name in names if name != "threads"]  # of newlib it does not compile
    return "".join(f"#if __has_include(<{name}.h>)\n#include <{name}.h>\n#endif\n" for name in names)


def robot(name: str = "odd", parameters=(), outputs=(("own", ("a", "b")),), settings=()) -> Mechanism:
    """A unicycle with parameters and outputs of these names."""
    mechanism = Mechanism(name, "a unicycle")
    x, y, heading = (
        mechanism.coordinate("x", "m"),
        mechanism.coordinate("y", "m"),
        mechanism.coordinate("heading", "rad"),
    )
    m, J = mechanism.parameter("m_own", 12.0, "kg"), mechanism.parameter("J_own", 0.8, "kg m^2")
    total = sum((mechanism.parameter(each, 1.0, "N") for each in parameters), start=ca.SX(0))
    forward = ca.cos(heading) * mechanism.rate(x) + ca.sin(heading) * mechanism.rate(y)
    mechanism.kinetic_energy(
        m * (mechanism.rate(x) ** 2 + mechanism.rate(y) ** 2) / 2 + J * mechanism.rate(heading) ** 2 / 2
    )
    mechanism.force(-total * forward, on=forward)
    mechanism.rolls("no side slip", ca.cos(heading) * mechanism.rate(y) - ca.sin(heading) * mechanism.rate(x))
    mechanism.input("push", "N", on=forward)
    mechanism.input("turn", "N m", on=mechanism.rate(heading))
    mechanism.quasi_velocity("v", "m/s", forward)
    mechanism.quasi_velocity("omega", "rad/s", mechanism.rate(heading))
    ahead = [config(each, 0.3, "m", "") for each in settings]
    L = sum((each.symbol for each in ahead), start=ca.SX(0.3))
    for output, (first, second) in outputs:
        rows = [(first, "m", x + L * ca.cos(heading)), (second, "m", y + L * ca.sin(heading))]
        mechanism.output(output, "", rows, ahead)
    return mechanism


def refused(line: str, tmp_path) -> str:
    """What is said of a line in a robot's file, after its place."""
    head = (
        "from noslip.model import Mechanism, config\n\ndef robot():\n    r = Mechanism('made')\n    x = "
        "r.coordinate('x', 'm')\n"
    )
    file = tmp_path / "robots.py"
    file.write_text(f"{head}    r.output('tip', '', [])\n    {line}\n    return r\n")
    with pytest.raises(BadInput) as error:
        find_robot(f"{file}:robot")
    text = str(error.value)
    assert text.startswith(f"{file}:7: ") and "\n" not in text
    return text


@pytest.mark.parametrize(
    "name",
    [
        "INT32_MAX",
        "FLT_MAX",
        "M_PI",
        "EOF",
        "errno",
        "while",
        "class",
        "NAN",
        "noslip_x",
        "NOSLIP_OK",
        "linux",
    ],
)
@pytest.mark.parametrize(
    "line",
    [
        "r.parameter({!r}, 1.0, 'kg')",
        "r.coordinate({!r}, 'm')",
        "r.input({!r}, 'N', on=r.rate(x))",
        "r.quasi_velocity({!r}, 'm/s', r.rate(x))",
        "r.output({!r}, '', [])",
        "r.output('o', '', [({!r}, 'm', x)])",
        "config({!r}, 1.0, 'm', '')",
        "Mechanism({!r})",
    ],
)
def test_reserved_names_are_refused(name, line, tmp_path):
    said = refused(line.format(name), tmp_path)
    assert f"name {name!r} cannot be used in C" in said and f"call it {similar(name)}, for instance" in said


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("Rad_größe", "Rad_grosse"),
        ("_x", "x"),
        ("a__b", "a_b"),
        ("2wd", "my_2wd"),
        ("φ", "my_name"),
        ("near", "my_near"),
    ],
)
def test_the_name_proposed_instead_is_free(name, other, tmp_path):
    assert f"call it {other}, for instance" in refused(f"r.parameter({name!r}, 1.0, 'kg')", tmp_path)
    assert quantity(other, "").name == other


@pytest.mark.parametrize("name", ["status", "y1", "y12"])
def test_no_two_columns_of_a_run_have_one_name(name, tmp_path):
    for line in (
        "r.coordinate({!r}, 'm')",
        "r.input({!r}, 'N', on=r.rate(x))",
        "r.quasi_velocity({!r}, 'm/s', r.rate(x))",
    ):
        said = refused(line.format(name), tmp_path)
        assert (
            f"'{name}' has a meaning already in the tables of runs; choose another, such as my_{name}" in said
        )
    assert quantity(name, "").name == name  # a parameter is no column


@pytest.mark.parametrize(
    ("name", "says"),
    [
        *[
            (name, "the robot itself")
            for name in (*OF_ROBOT, "f", "dynamics_f", "params_f", "dynamics_evaluation", "Dynamics")
        ],
        *[(f"tip_{part}", "output 'tip'") for part in OF_LAW if part],
        *[(name, "output 'tip'") for name in ("tip_f", "TIP", "tip_step_f", "Tip_F")],
        ("tip", "used twice"),
        ("type_v", "Types I to IV"),
    ],
)
def test_outputs_that_would_share_a_name_in_c(name, says, tmp_path):
    assert says in refused(f"r.output({name!r}, '', [])", tmp_path)


def test_either_order_is_refused():
    with pytest.raises(ModelError, match="output 'o_f' also defines ..._o_f in C"):
        robot(outputs=(("o_f", "ab"), ("o", "ab")))
    robot(outputs=(("tip", "ab"), ("tip_speed", "ab"), ("tip2", "ab")))


@pytest.mark.parametrize(
    "name", ["math", "Math", "stdio", "string", "errno", "time_f", "Arduino", "main", "windows"]
)
def test_a_robot_is_no_header(name):
    with pytest.raises(ModelError, match="cannot be"):
        Mechanism(name)


def test_all_names_of_the_c_are_known():
    """OF_ROBOT and OF_LAW have every name after a robot's and a law's that the C defines."""
    mechanism = robot(outputs=(("own", ("a", "b")),))
    mechanism.moves_in_plane(*ca.vertsplit(mechanism.q))
    system = reduce(mechanism)
    laws = [control_law(system, output_map(system, name)) for name in ("own", "type_iv_segment")]
    text = "\n".join(robot_files(system, laws, ("double",)).values())
    suffixes = set(re.findall(r"\bodd_(?:own|type_iv_segment)_?(\w*)", text)) | set(
        re.findall(r"\bodd_dynamics_?(\w*)", text)
    )
    assert {name.removesuffix("_H").lower() for name in suffixes} - {"h", "c"} <= set(OF_LAW)
    assert {entry.name for entry in ENTRIES} <= set(OF_LAW)
    others = set(re.findall(r"\bodd_(?!own|type_iv|dynamics)(\w+)", text))
    assert others <= set(OF_ROBOT)


@pytest.mark.parametrize("which_one", COMPILERS)
def test_macros_are_refused(which_one, tmp_path):
    """Every macro without arguments that a compiler has after all standard headers; one is renamed in C."""
    command = COMPILERS[which_one]
    need(command[0])
    file = tmp_path / "all.h"
    file.write_text(every_header("c++" in command))
    run = [*command, "-dM", "-E", *(() if "c++" in command else ("-x", "c")), str(file)]
    text = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    names = set(re.findall(r"^#define ([A-Za-z]\w*)(?:\s|$)", text, re.M))
    assert len(names) > 100
    assert sorted(name for name in names if not is_reserved(name) and in_c(name) == name) == []


def test_what_people_call_things_is_free():
    free = (
        "I J M_1 M_w TAU_MAX V_MAX E E_k sin x SS R EI SI_1 mass_f step X_Pos Wheel_Pos vTip xTarget port "
        "event"
    )
    for name in free.split():
        assert quantity(name, "").name == name
    with pytest.raises(ModelError):
        quantity("I_", "")


@pytest.mark.parametrize("which_one", ["gcc", "clang", "g++", "clang++"])
def test_c_of_odd_names_compiles_after_all_headers(which_one, tmp_path):
    """Names of members that are those of arguments, locals, functions, and a macro of complex.h."""
    command = COMPILERS[which_one]
    need(command[0])
    mechanism = robot(
        parameters=(*ODD[:7], "I", "limit"),
        outputs=(("own", ("I", "self")), ("sin", ("exp", "status"))),
        settings=ODD[2:9],
    )
    system = reduce(mechanism)
    files = robot_files(system, [control_law(system, output_map(system, name)) for name in ("own", "sin")])
    for name, text in {**runtime_files(), **files}.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "all.h").write_text(every_header("c++" in command))
    headers = "".join(f'#include "{name}"\n' for name in files if name.endswith(".h"))
    cpp = "c++" in command
    (tmp_path / "use.c").write_text(
        headers + "int use(odd_params *p);\nint use(odd_params *p)\n{\n    return p->I_ > 0;\n}\n"
    )
    sources = ["use.c"] if cpp else ["use.c", *[name for name in files if name.endswith(".c")]]
    run = [*command, *STRICT, "-include", "all.h", "-c", *sources]
    result = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[:2000]


# Macros of the headers of boards and systems that engineers have as names of parameters: without arguments,
# and with one.
BOARDS = (
    # Arduino: AVR
    "PI HALF_PI TWO_PI EULER HIGH LOW INPUT OUTPUT A0 A7 D1 B0 B1 B1010 SP SE T0 U2X0 F_CPU XL PD2 "
    "IRAM_ATTR BIT0 BIT31 OK TX RX SDA LED_BUILTIN GPIOA TIM1 PA0 PB12 DAC1 RCC ITM FPU "  # ESP32, STM32
    "K_FOREVER MSEC_PER_SEC KB "  # Zephyr
    "B9600 ECHO VMIN CR0 TAB0 CS8 ISIG MAXPATHLEN PAGE_SIZE "  # POSIX
    "IN OUT TRUE ERROR RELATIVE IGNORE DELETE STRICT X1 P1"  # Windows
).split()
# Those with small letters are refused.
REFUSED = (
    # Arduino: AVR
    "USART_TXEN_bm USART_PMODE_gp RTC_CNT_vect RTC_CNT_vect_num SPCR_struct Serial SerialUSB h_addr "
    "DMA1_Stream0 SAI1_Block_A PWR_CSR_EWUP_Pos PWR_CSR_EWUP_Msk SD_TypeDef Serial1 "  # STM32
    # ESP-IDF: FreeRTOS
    "pdTRUE portMAX_DELAY configTICK_RATE_HZ xTaskHandle vTaskDelay pxContainer INCLUDE_vTaskDelay "
    "ifr_name s6_addr s6_addr16 st_atime environ sa_handler si_value SYS_open ut_time "  # POSIX
    "near far small hyper interface cdecl pascal s_addr rad1 edt12 pshHelp"  # Windows
).split()
WITH_ARGUMENT = ("F", "min", "max", "abs", "round", "bit", "sq", "BIT", "MIN", "K_MSEC")


@pytest.mark.parametrize("language", ["c", "c++"])
def test_c_compiles_after_the_macros_of_boards(language, tmp_path):
    """Parameters and outputs of these names; the headers of the runtime do not use them either."""
    free = [name for name in (*BOARDS, *WITH_ARGUMENT) if not is_reserved(name)]
    assert len(free) > 50 and is_reserved("PI_") and in_c("PI") == "PI_"
    assert [name for name in REFUSED if not is_reserved(name)] == []
    mechanism = robot(parameters=free[8:], outputs=(("own", (free[0], free[1])),), settings=free[2:8])
    system = reduce(mechanism)
    files = robot_files(system, [control_law(system, output_map(system, "own"))])
    for name, text in {**runtime_files(), **files}.items():
        (tmp_path / name).write_text(text)
    macros = "".join(f"#define {name} ?\n" for name in BOARDS) + "".join(
        f"#define {name}(x) ?\n" for name in WITH_ARGUMENT
    )
    macros += "".join(f"#define {name} ?\n" for name in REFUSED)
    # That of lanes is for hosts only: it includes headers of their compiler.
    names = {path.name for path in tmp_path.glob("*.h")} - {"noslip_lanes.h"}
    headers = "".join(f'#include "{name}"\n' for name in sorted(names))
    (tmp_path / "use.c").write_text(f"{macros}{headers}")
    run = [*compiler(), "-x", language, "-Wall", "-Werror", "-ffp-contract=off", "-fsyntax-only", "use.c"]
    result = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[:2000]


# -- names of laws -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [False, True])
def test_names_of_laws_are_taken_apart_as_they_are_put_together(offset):
    """Every type and path, and names that are none of these."""
    names = [LawName(kind, offset=offset) for kind in ("I", "II", "III")] + [
        LawName("IV", path, offset) for path in PATHS
    ]
    assert [without_offset(str(name)) for name in names] == list(OUTPUTS)
    for name in names:
        assert LawName.parse(str(name)) == name and str(name).endswith("_offset") == offset
    for own in ("ball", "type_v", "type_I", "type_", "Type_i", "my_type_i", "_offset"):
        assert LawName.parse(own) is None

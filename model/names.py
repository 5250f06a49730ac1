"""Names that are valid in C, C++ and Python: reserved names,
and collisions between names generated for two outputs."""

import errno
import keyword
import re
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from .errors import ModelError

TYPE = "type_"  # prefix of the names of Types I to IV
OFFSET = "_offset"  # suffix of the name of a law whose P_l may lie beside the vehicle's axis
DAMPED = "_damped"  # suffix of the name of a law whose inverse is damped where Phi is nearly singular
EXTENDED = "_extended"  # suffix of the name of a law with a dynamic extension
# Suffix of the name of a law whose errors along a course decay with the way, not with time
ARCLENGTH = "_arclength"
KINEMATIC = "_kinematic"  # suffix of the name of a law that commands quasi-velocities
# Gains of integral action and of disturbance observers, beside those of the law
INTEGRAL, OBSERVER = "ki", "ko"
TYPES = ("I", "II", "III", "IV")
FLOAT = "_f"  # suffix of every name in float

KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int "
    "long register restrict return short signed sizeof static struct switch typedef union unsigned void "
    "volatile while alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class "
    "co_await co_return co_yield compl concept const_cast consteval constexpr constinit decltype delete "
    "dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr operator or "
    "or_eq private protected public reinterpret_cast requires static_assert static_cast template this "
    "thread_local throw true try typeid typename typeof typeof_unqual using virtual wchar_t xor xor_eq "
    "size_t ptrdiff_t".split()
)
# Macros without arguments of the standard headers (including POSIX) and of compilers with their extensions
# enabled.
MACROS = frozenset(name for name in vars(errno) if name.isupper()) | frozenset(
    "NULL NAN INFINITY HUGE HUGE_VAL HUGE_VALF HUGE_VALL MAXFLOAT DOMAIN SING OVERFLOW UNDERFLOW PLOSS TLOSS "
    "DECIMAL_DIG BUFSIZ EOF WEOF L_tmpnam L_ctermid P_tmpdir ONCE_FLAG_INIT BIG_ENDIAN LITTLE_ENDIAN "
    "PDP_ENDIAN BYTE_ORDER NSIG NGREG NFDBITS FD_SETSIZE PIPE_BUF MINSIGSTKSZ TSS_DTOR_ITERATIONS NZERO "
    "WNOHANG WUNTRACED WSTOPPED WEXITED WCONTINUED WNOWAIT EFTYPE EHWPOISON SNAN SNANF SNANL L_cuserid "
    "L_INCR L_SET L_XTND F_OK R_OK W_OK X_OK F_LOCK F_TEST F_TLOCK F_ULOCK WORD_BIT CLK_TCK STDIN_FILENO "
    "STDOUT_FILENO STDERR_FILENO HAVE_INITFINI_ARRAY fd_set physadr quad signgam strtodf tzname complex "
    "imaginary errno math_errhandling noreturn stdin stdout stderr linux unix i386 atomic_init sa_handler "
    "sa_sigaction sigev_notify_function sigev_notify_attributes si_addr si_addr_lsb si_arch si_band "
    "si_call_addr si_fd si_int si_lower si_overrun si_pid si_pkey si_ptr si_status si_stime si_syscall "
    "si_timerid si_uid si_upper si_utime si_value "
    # POSIX
    "basename d_fileno environ h_addr h_errno sched_priority st_atime st_ctime st_mtime ut_addr ut_name "
    "ut_time "
    # Windows.h
    "cdecl far hyper interface near pascal pshHelp small s_addr s_host s_imp s_impno s_lh s_net".split()
)
FAMILIES = re.compile(
    r"u?int(_fast|_least)?(8|16|32|64|max|ptr)_t"
    r"|(U?INT(_FAST|_LEAST)?(8|16|32|64|MAX|PTR)|S?CHAR|UCHAR|U?SHRT|U?INT|U?LONG|U?LLONG|U?LONG_LONG"
    r"|BOOL)_(MIN|MAX|BIT|WIDTH)"
    r"|(S?SIZE|PTRDIFF|WCHAR|WINT|SIG_ATOMIC|RAND|TMP|FOPEN|FILENAME|PATH|NAME|LINE|ARG|LINK|OPEN|STREAM"
    r"|SYMLOOP|IOV"
    r"|TZNAME|CHILD|[A-Z]+_NAME|COLL_WEIGHTS|DELAYTIMER|EXPR_NEST|NGROUPS|RE_DUP|RTSIG|SEM_VALUE"
    r"|MQ_PRIO|BC_[A-Z]+"
    r"|MB_[A-Z]+|XATTR_[A-Z]+|AIO_[A-Z_]+|TIMER|SEM_NSEMS|SYMLINK)_(MIN|MAX|WIDTH)"
    r"|MAX_(CANON|INPUT)"
    r"|(FLT|DBL|LDBL|DEC32|DEC64|DEC128)_[A-Z][A-Z0-9_]+"
    r"|(FE|FP|FPE|SA|SI|SS|LC|BUS|CLD|ILL|SEGV|TRAP|POLL|SEEK|TIME|TIMER|CLOCKS?|ATOMIC|MATH|EXIT"
    r"|PTHREAD|SCHED"
    r"|ADJ|MOD|STA|REG|NL|CLOSE_RANGE|RENAME)_[A-Z][A-Z0-9_]+"
    r"|SIG_?[A-Z][A-Z0-9_]*"
    r"|(PRI|SCN)[a-zX](FAST|LEAST)?(8|16|32|64|MAX|PTR)"
    r"|M_(E|(3|TWO)?PI|1_PI|2_|SQRT|LN|LOG|IVLN|INVLN)[A-Z0-9_]*(f(\d+x?)?|l)?"
    r"|(HUGE_VAL_|SNAN)F\d+X?"
    r"|atomic_\w+_explicit"
    r"|(chx|cmb|ctl|edt|frm|grp|ico|lst|psh|rad|rct|scr|stc)[0-9]+"  # dialogs of Windows.h
    r"|(if[acr]|s6)_[a-z]+\d*|SYS_[a-z]\w*"  # network interfaces and system calls of POSIX
    r"|(config|event|pd|port)[A-Z][A-Z0-9_]+|INCLUDE_\w+"  # FreeRTOS
    r"|pxContainer|[vx](List|Queue|Semaphore|Task|Time[Or])[A-Za-z]*"
    # STM32, AVR
    r"|[A-Z][A-Z0-9]+(_\w+)?_(Block_[AB]|Msk|Pos|Stream\d|TypeDef|bm|bp|gc|gm|gp|struct|vect|vect_num)"
    r"|Serial(\d|USB)?"  # Arduino
    r"|(?i:noslip)(_\w*)?"
)
# Names in upper case are those of macros, which boards and systems have by the thousand: PI, B0, A0, F_CPU.
# So a parameter PI is a member PI_ of the structs in C. A single letter keeps its name, but for the imaginary
# unit of complex.h.
UPPER_CASE = re.compile(r"I|[A-Z][A-Z0-9_]*[A-Z0-9]")
HEADERS = frozenset(
    "assert complex ctype errno fenv inttypes iso646 limits locale math setjmp signal stdalign stdarg "
    "stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string strings tgmath threads time uchar "
    "unistd wchar wctype console stopwatch selftest arduino board main pthread sched termios windows".split()
)
COLUMNS = re.compile(r"status|y\d+")  # status and outputs in the table of a run, beside the robot's own names
# suffixes of a robot's name, and of a law's name, in names of types, functions and files
OF_FOLLOWER = (
    *("", "_config", "_interval", "_steering"),
    *("_init", "_tick", "_tick_angles", "_update", "_correct", "_reset", "_twist"),
)
OF_ROBOT = (
    *("params", "state", "options", "default_params", "check_params", "check_state", "dynamics"),
    *(f"follower{after}" for after in OF_FOLLOWER),
    *(f"ekf{after}" for after in ("", "_config", "_init", "_tick", "_wheels", "_gyro")),
    *(f"adaptation{after}" for after in ("", "_config", "_init", "_step", "_residual", "_learn")),
)
OF_LAW = (
    *("", "config", "gains", "reference", "evaluation", "init", "reset", "set_limits", "update"),
    *("admit", "admit_both", "admit_foot"),
    *(
        name + after
        for name in (
            "output",
            "rate",
            "decoupling",
            "decoupling_rate",
            "feedback",
            "evaluate",
            "step",
            "slope",
            "follow",
        )
        for after in ("", "_law")
    ),
    *(f"{name}_near_law" for name in ("feedback", "evaluate", "step", "slope", "follow", "follow_slope")),
    *("follow_slope", "follow_slope_law", "ground", "ground_law", "ground_by_inputs", "ground_by_inputs_law"),
    *("null_inputs", "null_inputs_law", "wheels", "wheels_law"),
    *(
        "step_refused",
        "step_limited",
        "step_with_grip",
        "follow_refused",
        "follow_limited",
        "follow_with_grip",
    ),
    # Of the dynamics, which are named like a law
    *("acceleration", "acceleration_law", "reduced", "reduced_law"),
)


def is_reserved(name: str) -> bool:
    """Return whether the name is reserved in C, C++, their standard headers, the C runtime or Python."""
    taken = (
        keyword.iskeyword(name)
        or name in KEYWORDS
        or name in MACROS
        or UPPER_CASE.fullmatch(name[:-1] * (name[-1] == "_"))
    )
    return "__" in name or bool(taken or FAMILIES.fullmatch(name))


def similar(name: str) -> str:
    """Return a name that is not reserved and that a reader takes for this one."""
    letters = unicodedata.normalize("NFKD", name.replace("ß", "ss")).encode("ascii", "ignore").decode()
    plain = re.sub(r"\W|_+", "_", letters).strip("_")
    return plain if plain[:1].isalpha() and not is_reserved(plain) else f"my_{plain or 'name'}"


@dataclass(frozen=True)
class LawName:
    """The name of a law of Types I to IV: one of TYPES, the kind of path of IV, whether P_l may lie aside of
    the axis, whether its inverse is damped, whether it is on the axle, with a dynamic extension, whether the
    law is kinematic, and whether errors decay along the way.
    """

    type: str
    path: str = ""
    offset: bool = False
    damped: bool = False
    extended: bool = False
    kinematic: bool = False
    arclength: bool = False

    def __str__(self) -> str:
        path = f"_{self.path}" if self.path else ""
        after = (
            OFFSET * self.offset
            + DAMPED * self.damped
            + EXTENDED * self.extended
            + ARCLENGTH * self.arclength
        )
        after += KINEMATIC * self.kinematic
        return f"{TYPE}{self.type.lower()}{path}{after}"

    @classmethod
    def parse(cls, name: str) -> "LawName | None":
        """The parts of a name; None of an output of the robot's own."""
        dynamic = without_kinematic(name)
        in_time = without_arclength(dynamic)
        plain = without_extension(in_time)
        exact = without_damping(plain)
        number, _, path = without_offset(exact).removeprefix(TYPE).partition("_")
        law = cls(
            number.upper(),
            path,
            exact.endswith(OFFSET),
            exact != plain,
            plain != in_time,
            dynamic != name,
            in_time != dynamic,
        )
        return law if law.type in TYPES and str(law) == name else None


def without_offset(name: str) -> str:
    """The name of the law of the same outputs with P_l on the axis."""
    return name.removesuffix(OFFSET)


def without_damping(name: str) -> str:
    """The name of the law of the same outputs whose inverse is not damped."""
    return name.removesuffix(DAMPED)


def without_extension(name: str) -> str:
    """The name of the law of the same outputs without a dynamic extension."""
    return name.removesuffix(EXTENDED)


def without_arclength(name: str) -> str:
    """The name of the law of the same outputs whose errors decay with time."""
    return name.removesuffix(ARCLENGTH)


def without_kinematic(name: str) -> str:
    """The name of the law of the same outputs that gives the robot's inputs."""
    return name.removesuffix(KINEMATIC)


def in_c(name: str) -> str:
    """Return the name in C: one in upper case, which may be that of a macro, gets an underscore behind it."""
    return f"{name}_" if UPPER_CASE.fullmatch(name) else name


def refuse_robot(name: str) -> None:
    """Raise ModelError for a robot whose header would have the name of a header of the standard library, a
    board or a project, which differ by more than upper and lower case where file names do.
    """
    if name.removesuffix(FLOAT).lower() in HEADERS:
        another = f"choose another, such as my_{name}"
        raise ModelError(
            f"{name}: the name cannot be that of a robot: {name}.h is the name of another header; {another}"
        )


def refuse_column(name: str) -> None:
    """Raise ModelError for a coordinate, quasi-velocity or input with the name of another column in the
    tables of runs."""
    if COLUMNS.fullmatch(name):
        raise ModelError(
            f"the name {name!r} has a meaning already in the tables of runs; choose another, such as "
            f"my_{name}"
        )


def refuse_output(name: str, others: Iterable[str], where: str) -> None:
    """Raise ModelError for an output whose C would share a name with that of another output or of the
    robot."""
    if name.startswith(TYPE):
        raise ModelError(
            f"{where}: the name has a meaning already: {TYPE} begins the names of Types I to IV; choose "
            "another"
        )
    for ending, laws in (
        (DAMPED, "damped laws"),
        (EXTENDED, "laws with an extension"),
        (KINEMATIC, "kinematic laws"),
        (ARCLENGTH, "laws along the way"),
    ):
        if name.endswith(ending):
            raise ModelError(
                f"{where}: the name has a meaning already: {ending} ends those of {laws}; choose another"
            )
    defined = set(_law_names(name))
    robots = {
        FLOAT,
        *(f"_{own}{after}" for own in OF_ROBOT for after in ("", FLOAT)),
        *_law_names("dynamics"),
    }
    taken = {"the robot itself": robots} | {f"output {other!r}": set(_law_names(other)) for other in others}
    for other, names in taken.items():
        if defined & names:
            common = min(defined & names, key=lambda each: (len(each), each))
            raise ModelError(
                f"{where}: the name has a meaning already: {other} also defines ...{common} in C; choose "
                "another"
            )


def _law_names(law: str) -> Iterator[str]:
    """Yield the names in C of a law, without the robot's name; in lower case,
    because include guards are case-insensitive."""
    for part in OF_LAW:
        for after in ("", FLOAT):
            yield f"_{law}_{part}".rstrip("_").lower() + after

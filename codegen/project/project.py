"""A firmware project around exported C: Makefile, CMakeLists.txt, a page to read first, and the loop that calls the law."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.law import ControlLaw
from ..printing.layout import comment, table
from ..printing.scalar import Scalar
from ..targets import STANDARD


@dataclass(frozen=True)
class Board:
    """What a project is built for: `prefix` of the tools, flags of the processor, sources and options of an image, and what
    runs an image; all empty where the compiler's own machine is meant."""

    name: str
    prefix: str = ""
    flags: Sequence[str] = ()
    start: Sequence[str] = ()
    link: Sequence[str] = ()
    run: Sequence[str] = ()
    define: Sequence[str] = ()

    @property
    def bare(self) -> bool:
        """Is there nothing under the program?"""
        return bool(self.start)


def makefile(robot: str, board: Board) -> str:
    """The Makefile: the library, the loop's object, the self-test, its run, sizes."""
    flags = " ".join([*board.flags, *["-ffreestanding"] * board.bare, "-ffunction-sections -fdata-sections"])
    start = " ".join(f"board/{name}" for name in board.start if name.endswith(".c"))
    image = f"selftest.{'elf' if board.bare else 'run'}"
    run = " ".join([*board.run, image, "< /dev/null"]) if board.run else f"./{image}"
    link = " ".join(board.link) or "-Wl,--gc-sections"
    return f"""# make          the library lib{robot}.a, the loop's object, the self-test
# make test     runs the self-test{" in QEMU" if board.run else ""}; its exit code is the number of laws that failed
# make budget   bytes of code and data that loop.c needs, and of stack by function
# CC, CFLAGS and RUN are yours to set. Every dialect from C99 on gives the same bits; -ffast-math does not compile. The self-test
# tells whether your flags do: make clean test CFLAGS='...'
CROSS ?= {board.prefix}
ifeq ($(origin CC),default)
CC := $(CROSS){"gcc" if board.bare else "cc"}
endif
ifeq ($(origin AR),default)
AR := $(CROSS)ar
endif
CFLAGS ?= -O2
RUN ?= {run}
OWN := {flags} {" ".join(STANDARD)} \\
    -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Wfloat-conversion -Wshadow -Wundef -Wvla
OBJECTS := $(patsubst %.c,%.o,$(wildcard noslip/*.c))
START := {start}

.PHONY: all test budget clean
.DELETE_ON_ERROR:
all: lib{robot}.a loop.o {image}

lib{robot}.a: $(OBJECTS)
\t$(AR) rcs $@ $(OBJECTS)

{image}: selftest/selftest.c $(START) lib{robot}.a $(wildcard board/* selftest/*.h)
\t$(CC) $(OWN) $(CFLAGS) {" ".join([*board.define, "-Inoslip -Iboard -Iselftest"])} \\
\t    selftest/selftest.c $(START) lib{robot}.a {link} -o $@

%.o: %.c $(wildcard noslip/*.h noslip/*.inc)
\t$(CC) $(OWN) $(CFLAGS) -Inoslip -fstack-usage -c -o $@ $<

test: {image}
\t$(RUN)

budget: loop.o lib{robot}.a
\t@$(CC) $(OWN) -r -nostdlib -Wl,--gc-sections -Wl,-e,control_loop loop.o lib{robot}.a -o needed.o
\t@echo "what loop.c needs, itself included:"; $(CROSS)size needed.o; rm -f needed.o
\t@echo "stack, bytes, of each function by itself:"
\t@cat noslip/*.su loop.su | awk -F'[\\t:]' '{{print "  " $$5, $$4}}' | sort -rn | head -6

clean:
\trm -f noslip/*.o noslip/*.su loop.o loop.su lib{robot}.a {image}
"""


def cmake(robot: str, board: Board) -> str:
    """CMakeLists.txt: the library for any project, with that project's flags; by itself also the self-test and its run."""
    start = [f"board/{name}" for name in board.start if name.endswith(".c")]
    flags = " ".join([*board.flags, *["-ffreestanding"] * board.bare])
    link = " ".join([*board.flags, *board.link]).replace("board/", "${CMAKE_CURRENT_SOURCE_DIR}/board/")
    options = f"\n    target_compile_options({robot} PRIVATE {flags})" if flags else ""
    options += f"\n    target_compile_options(selftest PRIVATE {' '.join([flags, *board.define])})" if flags else ""
    options += f"\n    target_link_options(selftest PRIVATE {link})" if board.bare else ""
    run = " ".join([*board.run, "$<TARGET_FILE:selftest>"]) if board.run else "selftest"
    head = "# cmake -B build -DCMAKE_C_COMPILER=" + (
        f"{board.prefix}gcc -DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY -DCMAKE_SYSTEM_NAME=Generic" if board.bare else "gcc"
    )
    return f"""{head} && cmake --build build && (cd build && ctest)
# In a project of yours: add_subdirectory(this folder) and target_link_libraries(yours {robot}). The library is then compiled with
# the flags of your project, and adds nothing to them but the path to its headers.
cmake_minimum_required(VERSION 3.13)
project({robot} C)
file(GLOB NOSLIP CONFIGURE_DEPENDS ${{CMAKE_CURRENT_SOURCE_DIR}}/noslip/*.c)
add_library({robot} STATIC ${{NOSLIP}})
target_include_directories({robot} PUBLIC noslip)
target_compile_options({robot} PRIVATE -ffp-contract=off -fno-math-errno)
set_target_properties({robot} PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF)

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
    if(NOT CMAKE_BUILD_TYPE)
        set(CMAKE_BUILD_TYPE Release)
    endif()
    set(CMAKE_C_FLAGS_RELEASE "-O2")
    add_executable(selftest {" ".join(["selftest/selftest.c", *start])})
    target_include_directories(selftest PRIVATE board selftest)
    target_link_libraries(selftest PRIVATE {robot})
    set_target_properties(selftest PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF){options}
    enable_testing()
    add_test(NAME selftest COMMAND {run})
    set_tests_properties(selftest PROPERTIES TIMEOUT 60)
endif()
"""


def loop(law: ControlLaw, scalar: Scalar) -> str:
    """loop.c: one law called at a fixed rate; sensors, reference and motors are the user's."""
    own, mechanism = scalar.name, law.system.mechanism
    robot, name = mechanism.name, f"{mechanism.name}_{law.name}"
    inputs = len(mechanism.inputs)
    config = ", ".join(f".{q.in_c} = {scalar.literal(q.default or 0.25)}" for q in law.config) or "0"
    gains = ", ".join(f".{q.in_c} = {scalar.literal(q.default)}" for q in law.gains) or "0"
    zeros = ", ".join([scalar.literal(0.0)] * inputs)
    units = ", ".join(f"{q.name} in {q.unit}" for q in mechanism.inputs)
    yours = [
        ("extern void wait_for_tick(void);", "a timer"),
        (f"extern void read_state({own(robot + '_state')} *state);", "sensors, SI"),
        (f"extern void read_reference({own(name + '_reference')} *reference);", "what the outputs shall do"),
        (f"extern void set_inputs(const {scalar.real} tau[{inputs}]);", units),
    ]
    externs = "\n".join(table(yours, ""))
    about = [
        f"loop.c - {law.output.about}, called at a fixed rate. Yours: the four functions that are extern, and the numbers.",
        "",
        "control_loop answers where init refuses the numbers; else it goes on for ever. It needs no memory but its own stack.",
    ]
    return f"""{comment(about)}
#include "{own(name)}.h"

{externs}

int control_loop(void);

int control_loop(void)
{{
    static const {own(name + "_config")} config = {{{config}}}; /* examples: put in yours */
    static const {own(name + "_gains")} gains = {{{gains}}};
    static const {own(robot + "_options")} options = {{0}}; /* no limits; zeros on an error */
    static const {scalar.real} none[{inputs}] = {{{zeros}}};
    {own(name + "_reference")} reference;
    {own(robot + "_params")} params;
    {own(robot + "_state")} state;
    {own(name)} law;
    {scalar.real} tau[{inputs}];
    int status = {own(robot + "_default_params")}(&params); /* then put in what differs in yours */

    if (status == NOSLIP_OK) {{
        status = {own(name + "_init")}(&law, &params, &config, &gains, &options);
    }}
    while (status >= 0) {{
        wait_for_tick();
        read_state(&state);
        read_reference(&reference);
        status = {own(name + "_step")}(&law, &state, &reference, tau); /* on an error tau is zero: defined, never NaN */
        set_inputs(tau);
    }}
    set_inputs(none);
    return status; /* noslip_status_name(status) says what it was */
}}
"""


def readme(robot: str, laws: Sequence[str], board: Board, tools: str, costs: str) -> str:
    """README.md; `costs` is a block of text about memory and instructions."""
    listed = "\n".join(f"- `noslip/{robot}_{law}*.h`" for law in laws)
    where = f"for {board.name}, and run in QEMU ({board.run[0]})" if board.run else "for the machine it is built on"
    bare = (
        """
## On a board of yours

`board/` has the start-up code and the linker script of QEMU's machine. Take your vendor's instead (STM32Cube, Zephyr, Arduino
have them), add `noslip/*.c` to its sources and `noslip/` to its include path. No flag is needed for the same bits.
`selftest/selftest.c` runs there too: its words go out through `say` in `selftest/console.h`, which asks a debugger for
semihosting; put your serial port there. Without changes it then tells, on the chip itself, that all bits are right.
"""
        if board.bare
        else ""
    )
    return f"""# {robot}: control laws in C, {board.name}

Made by {tools}. C99: no heap, no writable globals, no libm, no recursion; the caller owns all memory. No Python is needed
from here on. The headers are the documentation; start with one of

{listed}

Names that end in `_f` are in `float`, others in `double`.

```sh
make          # lib{robot}.a, loop.o, the self-test
make test     # does it compute the right bits here? Built {where}
make budget   # bytes of code, data and stack
```

CMake: `add_subdirectory` of this folder, `target_link_libraries(yours {robot})`. C++: the headers have `extern "C"`.

- `noslip/`: the laws and what they stand on. Every function answers a status (`noslip_status.h`): 0 good, 1 good but cut to a
  limit, negative an error; then the inputs are zero or held, as `options` say, and never NaN.
- `loop.c`: the loop to begin with: sensors, reference and motors are yours.
- `selftest/`: golden vectors: steps with what the model says (computed in extended precision) and how far off the C may be,
  inputs beyond limits and errors among them; a vehicle led along a path; and digests of the bits that the C returned where this
  was written. Prints pass or FAIL for each law and for the route. Compile it with the flags of your own files.
- Bits: no product and sum is fused into one operation, in any dialect of C (from C99) or C++, also with `-flto`: a pragma in
  `noslip_real.h` sees to it, and holds until the end of each file that includes it. clang's `-ffp-contract=fast` overrides it.
{bare}
## What it costs

{costs}
Instructions are not cycles: flash wait states and the pipeline of your chip decide what they take.
"""

"""A firmware project around exported C: Makefile, CMakeLists.txt, a page to read first, and the loop that calls the law."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.law import ControlLaw
from ..printing.layout import table
from ..printing.scalar import Scalar
from ..targets import STANDARD
from ..templates import render


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

    @property
    def sources(self) -> list[str]:
        """The C files of an image beside the program's own."""
        return [f"board/{name}" for name in self.start if name.endswith(".c")]

    @property
    def own_flags(self) -> str:
        """The flags that every file needs."""
        return " ".join([*self.flags, *["-ffreestanding"] * self.bare])


def makefile(robot: str, board: Board) -> str:
    """The Makefile: the library, the loop's object, the self-test, its run, sizes."""
    return render(__file__, "project.mk", robot=robot, board=board, standard=STANDARD)


def cmake(robot: str, board: Board) -> str:
    """CMakeLists.txt: the library for any project, with that project's flags; by itself also the self-test and its run."""
    return render(__file__, "project.cmake", robot=robot, board=board)


def loop(law: ControlLaw, scalar: Scalar) -> str:
    """loop.c: one law called at a fixed rate; sensors, reference and motors are the user's."""
    own, inputs, robot = scalar.name, law.system.mechanism.inputs, law.system.mechanism.name
    name = f"{robot}_{law.name}"
    yours = [
        ("extern void wait_for_tick(void);", "a timer"),
        (f"extern void read_state({own(robot + '_state')} *state);", "sensors, SI"),
        (f"extern void read_reference({own(name + '_reference')} *reference);", "what the outputs shall do"),
        (f"extern void set_inputs(const {scalar.real} tau[{len(inputs)}]);", ", ".join(f"{q.name} in {q.unit}" for q in inputs)),
    ]
    return render(
        __file__,
        "loop.c",
        about=law.output.about,
        externs=table(yours, ""),
        robot=robot,
        law=name,
        own=own,
        real=scalar.real,
        inputs=len(inputs),
        zeros=", ".join([scalar.literal(0.0)] * len(inputs)),
        **initializers(law, scalar),
    )


def initializers(law: ControlLaw, scalar: Scalar) -> dict[str, str]:
    """What is between the braces of examples of config and gains."""
    config = ", ".join(f".{q.in_c} = {scalar.literal(q.default or 0.25)}" for q in law.config)
    gains = ", ".join(f".{q.in_c} = {scalar.literal(q.default)}" for q in law.gains)
    return {"config": config or "0", "gains": gains or "0"}


def readme(robot: str, laws: Sequence[str], board: Board, tools: str, costs: str) -> str:
    """README.md; `costs` is a block of text about memory and instructions."""
    return render(__file__, "project.md", robot=robot, laws=laws, board=board, tools=tools, costs=costs)

"""A firmware project around exported C: Makefile, CMakeLists.txt, README.md,
and the loop that calls the law."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.law import ControlLaw
from ...model.mechanism import Quantity
from ...readers.templates import render
from ..printing.layout import table
from ..printing.scalar import Scalar
from ..targets import SAME_BITS, STANDARD
from .vehicle import initializer


@dataclass(frozen=True)
class Board:
    """The target of a project: `prefix` of the tools, flags of the processor, sources and link options of an
    image, and the command that runs it; all empty for the machine of the compiler."""

    name: str
    prefix: str = ""
    flags: Sequence[str] = ()
    start: Sequence[str] = ()
    link: Sequence[str] = ()
    run: Sequence[str] = ()
    define: Sequence[str] = ()

    @property
    def bare(self) -> bool:
        """Whether the program runs without an operating system."""
        return bool(self.start)

    @property
    def sources(self) -> list[str]:
        """The C files of an image in addition to those of the program."""
        return [f"board/{name}" for name in self.start if name.endswith(".c")]

    @property
    def own_flags(self) -> str:
        """The compiler flags of every file."""
        return " ".join([*self.flags, *["-ffreestanding"] * self.bare])


def makefile(robot: str, board: Board, drives: bool) -> str:
    """Return the Makefile, which builds the library, the loop and the self-test, runs the self-test and
    prints sizes; it also `drives` the vehicle of a follower.
    """
    return render(__file__, "project.mk", robot=robot, board=board, standard=STANDARD, drives=drives)


def cmake(robot: str, board: Board) -> str:
    """Return CMakeLists.txt: the library with the flags of the including project;
    as the top-level project also the self-test."""
    return render(__file__, "project.cmake", robot=robot, board=board, flags=SAME_BITS)


def loop(law: ControlLaw, scalar: Scalar) -> str:
    """Return loop.c: a law called at a fixed rate; the user provides sensors, reference and motors."""
    own, inputs, robot = scalar.name, law.inputs, law.system.mechanism.name
    name, answer = f"{robot}_{law.name}", "command" if law.kinematic else "tau"
    yours = [
        ("extern void wait_for_tick(void);", "a timer"),
        (f"extern void read_state({own(robot + '_state')} *state);", "sensors, SI"),
        (f"extern void read_reference({own(name + '_reference')} *reference);", "what the outputs shall do"),
        (
            f"extern void set_inputs(const {scalar.real} {answer}[{len(inputs)}]);",
            ", ".join(f"{q.name} in {q.unit}" for q in inputs),
        ),
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
        answer=answer,
        extension=law.extension,
        period=scalar.literal(0.01),
        zeros=", ".join([scalar.literal(0.0)] * len(inputs)),
        **initializers(law, scalar),
    )


def follower_loop(law: ControlLaw, scalar: Scalar) -> str:
    """Return loop.c of a follower: counters to commands at a fixed rate; the user provides a timer,
    counters and drives."""
    wheels, robot = [q.name for q in law.system.quasi_velocities], law.system.mechanism.name
    return render(__file__, "follower.c", robot=robot, own=scalar.name, real=scalar.real, wheels=wheels)


def initializers(law: ControlLaw, scalar: Scalar) -> dict[str, str]:
    """Return the initializers of config and gains in examples."""
    config, gains = {q.in_c: starting_value(q) for q in law.config}, {q.in_c: q.default for q in law.gains}
    return {"config": initializer(config, scalar), "gains": initializer(gains, scalar)}


def starting_value(config: Quantity) -> float:
    """Return the value of a member of config in examples: its default,
    or a number that is seldom singular."""
    return config.default or 0.25


def readme(robot: str, laws: Sequence[str], board: Board, tools: str, costs: str, drives: bool) -> str:
    """Return README.md; `costs` is text on memory and instructions; `drives`: as for `makefile`."""
    return render(
        __file__, "project.md", robot=robot, laws=laws, board=board, tools=tools, costs=costs, drives=drives
    )

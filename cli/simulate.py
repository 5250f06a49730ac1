"""`noslip simulate`: simulates the closed loop of a SPEC and writes a table and plots."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..readers.errors import BadInput, naming
from ..readers.files import check_ending, check_targets, write_whole
from ..readers.progress import Progress
from .commands import PrintSchema, refuse_given, show

if TYPE_CHECKING:
    from ..simulation.run import Run
    from ..simulation.specification.spec import Spec

EXAMPLE = """example:
  noslip simulate line -o run.csv --plot run.png"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip simulate`."""
    parser = subparsers.add_parser(
        "simulate",
        help="simulate a closed loop of controller and robot",
        description="Simulate the closed loop described by SPEC.toml; RUN.csv gets one row per output time.",
        epilog=EXAMPLE,
    )
    parser.add_argument(
        "spec", metavar="SPEC.toml", help="robot, gains, output, reference, initial state, simulation"
    )
    parser.add_argument("-o", "--output", metavar="RUN.csv", required=True, help="output file")
    parser.add_argument("--plot", metavar="RUN.png", help="also write a plot of the run")
    parser.add_argument(
        "--animate",
        "--video",
        metavar="FILE",
        help="also write a film of the run from above: .html (a page with a bar for the time), .gif, or .mp4 "
        "with ffmpeg",
    )
    parser.add_argument(
        "--contact",
        metavar="FORCES.png",
        help="also plot the forces of the wheels and the limits of friction",
    )
    parser.add_argument(
        "--engine",
        choices=["mujoco"],
        help="simulate the robot on a floor in a physics engine, where wheels may slip (the extra `physics`)",
    )
    parser.add_argument(
        "--write-scene",
        metavar="ROBOT.xml",
        help="also write the robot on its floor as an MJCF, which MuJoCo opens and [scene] brings back",
    )
    parser.add_argument(
        "--record",
        metavar="RECORD",
        help="record all calls of the target and their results bit by bit (backends m4f, rv32), for noslip "
        "replay",
    )
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change an entry of the SPEC, for example initial.heading='90 deg' or output.type='\"I\"'; may "
        "be repeated",
    )
    parser.add_argument(
        "--sample",
        metavar="K",
        type=int,
        help="SPEC.toml is the OUT.parquet of a sweep: simulate its sample K",
    )
    parser.add_argument(
        "--trust",
        action="store_true",
        help="allow to execute the robot file named in OUT.parquet, which is Python code",
    )
    parser.add_argument(
        "--schema",
        action=PrintSchema,
        nargs=0,
        const=_schema,
        help="print the JSON Schema of SPEC.toml and exit",
    )
    parser.set_defaults(run=run)


def _schema() -> dict[str, Any]:
    from ..simulation.specification.spec import schema  # slow to import

    return schema()


def run(arguments: argparse.Namespace) -> int:
    """Run `noslip simulate`. Return 0, or 1 if the run stopped early. Raises BadInput,
    ModelError, OSError."""
    from ..model.errors import ModelError

    # Slow to import, as are models
    from ..simulation.closed_loop import as_json, simulate, summary, why_singular
    from ..simulation.specification.vary import change, read_varied

    outputs = (arguments.output, arguments.record, arguments.animate, arguments.write_scene)
    pictures = [name for name in (arguments.plot, arguments.contact) if name is not None]
    check_targets([name for name in outputs if name is not None], pictures, inputs=[arguments.spec])
    if arguments.engine:
        shows = (
            "shows the forces that rolling requires; with --engine, RUN.csv has slip and load of each contact"
        )
        refuse_given(arguments, ["contact"], shows)
    if arguments.animate:
        from ..simulation.film.film import check_film  # slow to import

        check_film(Path(arguments.animate).suffix)
    changes = dict(map(change, arguments.set))
    spec = read_varied(arguments.spec, changes) if arguments.sample is None else _sample(arguments)
    with naming(arguments.spec, (BadInput, ModelError)):
        scene = _scene(spec, Path(arguments.write_scene)) if arguments.write_scene else ""
        with Progress() as shown:

            def progress(t: float) -> None:
                shown(t, spec.simulation.duration, "s simulated")

            def simulated() -> "Run":
                # Those of a sweep, or that are recorded
                stages = arguments.sample is not None or arguments.record is not None
                return simulate(spec, progress=progress, engine=arguments.engine, stages=stages)

            completed, record = _recorded(spec, simulated) if arguments.record else (simulated(), "")
        drawn: dict[str, str | bytes] = {**_pictures(completed, arguments)}
        if arguments.animate:
            from ..simulation.film.film import film  # slow to import

            drawn[arguments.animate] = film(completed, Path(arguments.animate).suffix)
        if arguments.write_scene:
            drawn[arguments.write_scene] = scene
    written: dict[str, str | bytes] = {arguments.output: completed.csv()}
    written |= {arguments.record: record} if arguments.record else {}
    written |= drawn
    for file, content in written.items():
        write_whole(file, content)
    files = list(written)
    text, values = (
        lambda: f"{summary(completed)}\n  {', '.join(files)}",
        lambda: {**as_json(completed), "files": files},
    )
    show(arguments, text, values, arguments.output)
    for warning in () if arguments.json else completed.warnings:
        print(f"{arguments.spec}: warning: {warning}", file=sys.stderr)
    if completed.stopped:
        why = f": {why_singular(completed, arguments.engine)}" if completed.stopped == "singular" else ""
        print(
            f"{arguments.spec}: stopped at t = {completed.t[-1]:.9g} s: {completed.stopped}{why}",
            file=sys.stderr,
        )
        return 1
    return 0


def _scene(spec: "Spec", file: Path) -> str:
    """Return the MJCF of the robot of a SPEC on its floor. Raises BadInput for one in a scene already,
    and for another suffix."""
    from ..simulation.engine.written import scene_of
    from ..simulation.loop import make_loop
    from ..simulation.specification.floor import Floor
    from ..simulation.specification.spec import ContactSection

    check_ending(file, [".xml"], "an MJCF")
    if spec.scene:
        raise BadInput("--write-scene: the SPEC has [scene], which is in a file already")
    return scene_of(make_loop(spec).plant, spec.contact or ContactSection(), spec.floor or Floor())


def _sample(arguments: argparse.Namespace) -> "Spec":
    """Return the SPEC of one sample of a finished sweep. Raises BadInput if there is no such sample, or if it
    is to be changed.
    """
    from ..readers.robots import check_trust
    from ..simulation.specification.spec import spec_of
    from ..simulation.sweeping.store import sample_of
    from ..simulation.sweeping.study import sample_spec

    refuse_given(arguments, ["set"], "requires a SPEC: --sample repeats a sample unchanged")
    text, row, _ = sample_of(arguments.spec, arguments.sample)
    check_trust(spec_of(text, "[sweep]").robot, arguments.spec, arguments.trust)
    return sample_spec(text, row)


def _recorded(spec: "Spec", simulated: Callable[[], "Run"]) -> tuple["Run", str]:
    """Return the run and the record of the calls of its target. Raises BadInput for a backend without a
    target, and for [feedback], as a record names a law.
    """
    from ..codegen.loop.stages import check
    from ..simulation.controllers.pil import recorded
    from ..simulation.loop import make_loop
    from ..simulation.replay import record_text

    check(spec, "--record")
    law = make_loop(spec).law
    with recorded(law, spec.simulation.backend) as calls:
        completed = simulated()
    return completed, record_text(spec.robot, law, calls)


def _pictures(completed: "Run", arguments: argparse.Namespace) -> dict[str, bytes]:
    """Return the requested plots by file name."""
    if not (arguments.plot or arguments.contact):
        return {}
    from ..simulation.contact import draw_contact
    from ..simulation.drawing import encoded
    from ..simulation.plot import draw  # slow to import

    requested = ((draw, arguments.plot), (draw_contact, arguments.contact))
    return {file: encoded(plot(completed), Path(file).suffix[1:]) for plot, file in requested if file}

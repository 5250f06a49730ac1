"""`noslip simulate`: a closed loop from a file to a table and a picture."""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..readers.errors import BadInput
from ..readers.files import check_targets, write_whole

if TYPE_CHECKING:
    from ..simulation.run import Run
    from ..simulation.specification.spec import Spec

EXAMPLE = """example:
  noslip simulate specs/line.toml -o run.csv --plot run.png"""


class RunProgress:
    """The time reached, on one line of a terminal; nothing when stderr is none."""

    def __init__(self, duration: float):
        self._duration, self._shown, self._next = duration, False, time.monotonic() + 0.5

    def __call__(self, t: float) -> None:
        """Show t, at most five times a second."""
        if sys.stderr.isatty() and time.monotonic() >= self._next:
            self._next, self._shown = time.monotonic() + 0.2, True
            print(f"\rt = {t:.3f} of {self._duration:g} s", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Leave the line empty."""
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip simulate`."""
    parser = subparsers.add_parser(
        "simulate",
        help="run a closed loop of controller and robot",
        description="Run the closed loop that SPEC.toml describes: a row of RUN.csv for each output time.",
        epilog=EXAMPLE,
    )
    parser.add_argument("spec", metavar="SPEC.toml", help="robot, gains, output, reference, initial state, simulation")
    parser.add_argument("-o", "--output", metavar="RUN.csv", required=True, help="where the run goes")
    parser.add_argument("--plot", metavar="RUN.png", help="draw it too")
    parser.add_argument("--contact", metavar="FORCES.png", help="draw the wheels' forces against what friction can give")
    parser.add_argument(
        "--record",
        metavar="RECORD",
        help="write down, bit by bit, what the target was asked and answered (backends m4f, rv32), for noslip replay",
    )
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change an entry of the SPEC, for example initial.heading=0.5 or output.type='\"I\"'; may come several times",
    )
    parser.add_argument("--sample", metavar="K", type=int, help="SPEC.toml is OUT.parquet of noslip sweep: run its sample K")
    parser.add_argument("--trust", action="store_true", help="run the robot's file that OUT.parquet names, which is code")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """`noslip simulate`: 0, or 1 when the run stopped before its time. Raises BadInput, ModelError, OSError."""
    from ..model.errors import ModelError
    from ..simulation.closed_loop import simulate, summary  # slow to import, as are models
    from ..simulation.contact import grip
    from ..simulation.specification.vary import change, read_varied

    outputs, pictures = filter(None, (arguments.output, arguments.record)), filter(None, (arguments.plot, arguments.contact))
    check_targets(list(outputs), list(pictures), inputs=[arguments.spec])
    changes = dict(map(change, arguments.set))
    spec = read_varied(arguments.spec, changes) if arguments.sample is None else _sample(arguments, changes)
    progress = RunProgress(spec.simulation.duration)
    try:
        done, record = _recorded(spec, progress) if arguments.record else (simulate(spec, progress=progress), "")
        drawn = _pictures(done, arguments)
    except (BadInput, ModelError) as error:
        raise BadInput(f"{arguments.spec}: {error}") from error
    finally:
        progress.clear()
    written: dict[str, str | bytes] = {arguments.output: done.csv()}
    written |= {arguments.record: record} if arguments.record else {}
    written |= drawn
    for file, content in written.items():
        write_whole(file, content)
    files = ", ".join(written)
    print(f"{summary(done)}\n  {files}", file=sys.stderr if arguments.output == "-" else sys.stdout)
    held = grip(done)
    for warning in (*done.warnings, *([] if held.rolls else held.verdict().splitlines())):
        print(f"{arguments.spec}: warning: {warning}", file=sys.stderr)
    if done.stopped:
        print(f"{arguments.spec}: stopped at t = {done.t[-1]:.9g} s: {done.stopped}", file=sys.stderr)
        return 1
    return 0


def _sample(arguments: argparse.Namespace, changes: dict[str, Any]) -> "Spec":
    """The SPEC of one sample of a finished sweep. Raises BadInput for no such sample, or changes of it."""
    from ..readers.robots import check_trust
    from ..simulation.specification.spec import spec_of
    from ..sweeping.store import sample_of
    from ..sweeping.study import sample_spec

    if changes:
        raise BadInput("--sample runs a sample as it was; --set changes a SPEC")
    text, row, _ = sample_of(arguments.spec, arguments.sample)
    check_trust(spec_of(text, "[sweep]").robot, arguments.spec, arguments.trust)
    return sample_spec(text, row)


def _recorded(spec: "Spec", progress: RunProgress) -> tuple["Run", str]:
    """The run, and the record of what its target was asked. Raises BadInput for a backend without a target."""
    from ..controllers.controller import ON_TARGET
    from ..controllers.pil import recorded
    from ..simulation.closed_loop import simulate
    from ..simulation.loop import make_loop
    from ..simulation.replay import record_text

    backend = spec.simulation.backend
    if backend not in ON_TARGET:
        raise BadInput(f"--record: backend {backend!r} has no target; set [simulation] backend to {' or '.join(ON_TARGET)}")
    law = make_loop(spec).law
    with recorded(law, backend) as calls:
        done = simulate(spec, progress=progress)
    return done, record_text(spec.robot, law, calls)


def _pictures(done: "Run", arguments: argparse.Namespace) -> dict[str, bytes]:
    """What was asked for: file name -> content."""
    if not (arguments.plot or arguments.contact):
        return {}
    from ..simulation.contact import draw_contact
    from ..simulation.drawing import encoded
    from ..simulation.plot import draw  # slow to import

    wanted = ((draw, arguments.plot), (draw_contact, arguments.contact))
    return {file: encoded(made(done), Path(file).suffix[1:]) for made, file in wanted if file}

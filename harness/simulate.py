"""`noslip simulate`: a closed loop from a file to a table and a picture."""

import argparse
import sys
import time
from pathlib import Path

from .errors import BadInput
from .files import write_whole

EXAMPLE = """example:
  noslip simulate specs/line.toml -o run.csv --plot run.png"""


class Progress:
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
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("spec", metavar="SPEC.toml", help="robot, gains, output, reference, initial state, simulation")
    parser.add_argument("-o", "--output", metavar="RUN.csv", required=True, help="where the run goes")
    parser.add_argument("--plot", metavar="RUN.png", help="draw it too")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """`noslip simulate`: 0, or 1 when the run stopped before its time. Raises BadInput, ModelError, OSError."""
    from ..model.errors import ModelError
    from .closed_loop import simulate  # slow to import, as are models
    from .spec import read_spec

    _check_targets(arguments)
    spec = read_spec(arguments.spec)
    progress = Progress(spec.simulation.duration)
    try:
        done = simulate(spec, progress=progress)
    except (BadInput, ModelError) as error:
        raise BadInput(f"{arguments.spec}: {error}") from error
    finally:
        progress.clear()
    if arguments.plot:
        from .plot import picture  # slow to import

        drawn = picture(done, Path(arguments.plot).suffix[1:])
    write_whole(arguments.output, done.csv())
    if arguments.plot:
        write_whole(arguments.plot, drawn)
    files = ", ".join(filter(None, (arguments.output, arguments.plot)))
    print(f"{done.summary()}\n  {files}", file=sys.stderr if arguments.output == "-" else sys.stdout)
    if done.stopped:
        print(f"{arguments.spec}: stopped at t = {done.t[-1]:.9g} s: {done.stopped}", file=sys.stderr)
        return 1
    return 0


def _check_targets(arguments: argparse.Namespace) -> None:
    """Raise BadInput before a long run for what could only fail after it."""
    files = [Path(file) for file in (arguments.output, arguments.plot) if file and file != "-"]
    for file in files:
        if file.is_dir():
            raise BadInput(f"{file} is a folder; give a file in it")
        if not file.parent.is_dir():
            raise BadInput(f"{file}: there is no folder {file.parent}; make it first")
    if len(files) == 2 and files[0].resolve() == files[1].resolve():
        raise BadInput(f"{files[0]}: -o and --plot are the same file")
    if arguments.plot and Path(arguments.plot).suffix not in (".png", ".pdf", ".svg"):
        raise BadInput(f"{arguments.plot}: --plot draws .png, .pdf or .svg")

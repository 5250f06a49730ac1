"""The command line: `noslip COMMAND`. Exit 0 success, 1 a check failed, 2 bad input, 70 an error of noslip's own, 130 Ctrl-C."""

import argparse
import errno
import importlib
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress

from .. import __version__
from .errors import BadInput
from .files import children, remove, unfinished

COMMANDS = (
    "generate",
    "check",
    "evaluate",
    "simulate",
    "replay",
    "analyse",
    "plan",
    "outer-loop",
    "sweep",
    "figures",
    "export",
)  # each a module beside this one
BAD_INPUT, INTERNAL, INTERRUPTED, READER_GONE = 2, 70, 130, 141

ADVICE = {
    errno.ENOENT: "check the path",
    errno.ENOTDIR: "check the path",
    errno.EISDIR: "give a file, not a folder",
    errno.EACCES: "check its permissions",
    errno.EPERM: "check its permissions",
    errno.EROFS: "choose a place that can be written to",
    errno.ENOSPC: "free some space or choose another place",
}


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line."""

    def error(self, message: str) -> None:
        """Report a wrong command line and exit 2."""
        self.exit(BAD_INPUT, f"{self.prog}: {_one_line(message)}; see {self.prog} --help\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and answer its exit code; errors are one line on stderr, with NOSLIP_DEBUG set a traceback too."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy comes: matrices are small, threads would only wait
    if argv is None:
        signal.signal(signal.SIGINT, _interrupted)
        argv = sys.argv[1:]
    argv = list(argv)
    try:
        code = _run(argv)
        sys.stdout.flush()
        return code
    except SystemExit as stop:  # argparse, after --help or a wrong command line
        return stop.code or 0
    except KeyboardInterrupt:
        return _fail(INTERRUPTED, "interrupted")
    except BrokenPipeError:
        _close_stdout()
        return READER_GONE
    except Exception as error:
        return _report(error)


def _interrupted(*_) -> None:
    """End at once and leave nothing: an exception raised inside CasADi's or a compiler's callback could be lost."""
    remove(unfinished)
    for child in children:
        child.kill()
    _fail(INTERRUPTED, "interrupted")
    os._exit(INTERRUPTED)


def _run(argv: list[str]) -> int:
    parser = Parser(
        prog="noslip", description="From the Lagrangian of a robot that rolls without slipping to the C of its controller."
    )
    parser.add_argument("--version", action="version", version=f"noslip {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", title="commands (noslip COMMAND --help tells more)")
    # Only the command that runs is imported; help, and the message about an unknown command, need them all.
    for name in [argv[0]] if argv and argv[0] in COMMANDS else COMMANDS:
        importlib.import_module(f".{name.replace('-', '_')}", __package__).add_parser(subparsers)
    args = parser.parse_args(argv)
    if "run" not in args:
        parser.print_help()
        return 0
    return args.run(args)


def _report(error: Exception) -> int:
    """One line about an error, and the exit code for it."""
    from ..model.errors import ModelError

    if isinstance(error, BadInput | ModelError):
        return _fail(BAD_INPUT, str(error))
    if isinstance(error, OSError) and error.errno is not None:
        if error.filename is None:  # as when standard output is on a full disk
            _close_stdout()
        place = "cannot read or write" if error.filename is None else os.fsdecode(error.filename)
        advice = ADVICE.get(error.errno)
        return _fail(BAD_INPUT, f"{place}: {error.strerror}" + (f"; {advice}" if advice else ""))
    if "NOSLIP_DEBUG" in os.environ:
        traceback.print_exception(error)
    place = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {error} ({os.path.basename(place.filename)}:{place.lineno})"
    return _fail(INTERNAL, f"internal error, please report it: {what}; NOSLIP_DEBUG=1 shows where it comes from")


def _fail(code: int, message: str) -> int:
    with suppress(OSError):
        print(f"noslip: {_one_line(message)}", file=sys.stderr)
    return code


def _one_line(message: str) -> str:
    return " ".join(line.strip() for line in message.splitlines())


def _close_stdout() -> None:
    """Send what is still buffered nowhere, so that the interpreter does not fail on it once more when it ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

"""Runs a command line; an error becomes one line on stderr and an exit code."""

import argparse
import errno
import importlib
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, NoReturn

from .. import __version__
from ..readers.errors import BadInput, Contradiction, Mismatch, suggestion
from . import BAD_INPUT, COMMANDS, DIFFERS, INTERNAL, MODULES, READER_GONE

ADVICE = {
    errno.ENOENT: "check the path",
    errno.ENOTDIR: "check the path",
    errno.EISDIR: "give a file, not a folder",
    errno.EACCES: "check its permissions",
    errno.EPERM: "check its permissions",
    errno.EROFS: "choose a writable folder",
    errno.ENOSPC: "free some space or choose another folder",
}


FIRST = """noslip: no command is given. To begin:
  noslip robots                                            the shipped robots
  noslip simulate line -o run.csv --plot run.png           a closed loop with the generated C
  noslip generate labmate -o generated                     the C of every control law of a robot
  noslip --help                                            all commands"""


def refuse_given(args: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Raise BadInput for the first of these options, by its name in `args`,
    that is given where it does not apply: `why`."""
    for name in names:
        if (value := getattr(args, name)) is not None and value is not False and value != []:
            raise BadInput(f"--{name.replace('_', '-')} {why}")


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that reports errors in one line; the help of a command keeps its own line breaks.

    With `mixed` it takes options between positional arguments of which there may be none.
    """

    mixed = False

    def __init__(self, **settings: Any):
        super().__init__(**{"formatter_class": argparse.RawDescriptionHelpFormatter, **settings})
        # `--poles -1,-2`: a value; no option begins so
        self._negative_number_matcher = re.compile(r"-\.?[0-9]")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """See ArgumentParser, whose way of mixing calls this method for each of its two passes."""
        mixed, self.mixed = self.mixed, False
        try:
            return (self.parse_known_intermixed_args if mixed else super().parse_known_args)(args, namespace)
        finally:
            self.mixed = mixed

    @property
    def options(self) -> list[str]:
        """The long options."""
        return [option for option in self._option_string_actions if option.startswith("--")]

    def add_json(self) -> None:
        """Add --json, or to each way of a command, unless it is there."""
        ways = [action for action in self._actions if isinstance(action, argparse._SubParsersAction)]
        for way in ways:
            for parser in way.choices.values():
                parser.add_json()
        if not ways and "--json" not in self.options:
            self.add_argument("--json", action="store_true", help="print JSON")

    def error(self, message: str) -> NoReturn:
        """Report an invalid command line and exit with code 2."""
        self.exit(BAD_INPUT, f"{self.prog}: {_one_line(message)}; see {self.prog} --help\n")


class PrintSchema(argparse.Action):
    """An option that prints the JSON Schema of a command's input file, which `const` returns, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        """Print the schema and exit."""
        assert callable(self.const)
        from ..readers.printing import as_json  # imports NumPy

        print(as_json(self.const()))
        sys.stdout.flush()
        parser.exit()


def run(argv: list[str]) -> int:
    """Run a command line and return its exit code; errors are one line on stderr."""
    try:
        with warnings.catch_warnings():
            if not sys.warnoptions:
                # Of libraries, about numbers that are rejected or reported in the result anyway
                warnings.simplefilter("ignore")
            code = _run(argv)
        sys.stdout.flush()
        return code
    except SystemExit as stop:  # from argparse, after --help or an invalid command line
        return int(stop.code or 0)
    except BrokenPipeError:
        _close_stdout()
        return READER_GONE
    except Exception as error:
        return _report(error)


def add_columns(parser: argparse.ArgumentParser, example: str) -> None:
    """Add --columns, names of the columns of a table."""
    parser._negative_number_matcher = re.compile(r"-[.,\d]")  # "-,x,y" is no option
    parser.add_argument(
        "--columns",
        type=lambda text: [name.strip() or "-" for name in text.split(",")],
        default=[],
        metavar="NAMES",
        help="names of all columns in their order, instead of a header, - for one that is not used: "
        f"{example}",
    )


def rendered(args: argparse.Namespace, text: Callable[[], str], values: Callable[[], Any]) -> str:
    """Return the result of a command: with --json its values as JSON, SI, None for what is not finite;
    else the text."""
    if not args.json:
        return text()
    from ..readers.printing import as_json, plain  # imports NumPy

    return as_json(plain(values()))


def show(
    args: argparse.Namespace, text: Callable[[], str], values: Callable[[], Any], output: str | None = None
) -> None:
    """Print what `rendered` returns, to stderr if the `output` file of the command is standard output; an
    empty text is not printed.
    """
    if result := rendered(args, text, values):
        print(result, file=sys.stderr if output == "-" else sys.stdout)


def parser_of(names: Sequence[str]) -> tuple[Parser, "argparse._SubParsersAction[Parser]"]:
    """Return the parser of the command line with these commands, and its parsers of commands."""
    parser = Parser(
        prog="noslip",
        description="From the Lagrangian of a robot that rolls without slipping to the C code of its "
        "controller.",
        formatter_class=argparse.HelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"noslip {__version__}")
    commands = parser.add_subparsers(
        metavar="COMMAND", title="commands (noslip COMMAND --help shows the options of a command)"
    )
    for module in dict.fromkeys(MODULES[name] for name in names):
        importlib.import_module(f".{module}", __package__).add_parser(commands)
    for command in commands.choices.values():
        command.add_json()
    return parser, commands


def _run(argv: list[str]) -> int:
    if not argv:
        print(FIRST, file=sys.stderr)
        return BAD_INPUT
    first = argv[0]
    if first not in COMMANDS and not first.startswith("-"):
        raise BadInput(f"unknown command {first!r}{suggestion(first, COMMANDS)}")
    # Import only the module of the command that is run; the help needs all modules.
    parser, commands = parser_of([first] if first in COMMANDS else COMMANDS)
    args, unknown = parser.parse_known_args(argv)
    if unknown:
        own = commands.choices.get(first, parser)
        option = unknown[0].split("=")[0]
        own.error(
            "unrecognized argument "
            f"{option!r}{suggestion(option, own.options) if option.startswith('--') else ''}"
        )
    if "run" not in args:
        return _fail(BAD_INPUT, "no command is given; see noslip --help")
    return args.run(args)


def _report(error: Exception) -> int:
    """Print one line about an error and return its exit code."""
    from ..model.errors import ModelError

    if isinstance(error, BadInput | ModelError):
        return _fail(BAD_INPUT, str(error))
    if isinstance(error, Mismatch):
        for line in (
            *str(error).splitlines(),
            "nothing is written: the generated C differs from the model; please report this",
        ):
            _fail(DIFFERS, line)
        return DIFFERS
    if isinstance(error, Contradiction):
        return _fail(DIFFERS, f"{error}; nothing is printed, please report this")
    if isinstance(error, OSError) and error.errno is not None:
        if error.errno == errno.ENOENT and _is_nowhere():
            return _fail(BAD_INPUT, "the current folder no longer exists; change to one that does")
        if error.filename is None:  # as when standard output is on a full disk
            _close_stdout()
        place = "cannot read or write" if error.filename is None else os.fsdecode(error.filename)
        advice = ADVICE.get(error.errno)
        return _fail(BAD_INPUT, f"{place}: {error.strerror}" + (f"; {advice}" if advice else ""))
    if "NOSLIP_DEBUG" in os.environ:
        traceback.print_exception(error)
    last = traceback.extract_tb(error.__traceback__)[-1]
    problem = f"{type(error).__name__}: {error} ({os.path.basename(last.filename)}:{last.lineno})"
    return _fail(INTERNAL, f"internal error, please report it: {problem}; set NOSLIP_DEBUG=1 for a traceback")


def _fail(code: int, message: str) -> int:
    with suppress(OSError):
        coloured = sys.stderr.isatty() and "NO_COLOR" not in os.environ
        name = "\033[1;31mnoslip:\033[0m" if coloured else "noslip:"
        print(f"{name} {_one_line(message)}", file=sys.stderr)
    return code


def _is_nowhere() -> bool:
    """Return whether the current folder has been removed."""
    try:
        return not os.getcwd()
    except FileNotFoundError:
        return True


def _one_line(message: str) -> str:
    return " ".join(line.strip() for line in message.splitlines())


def _close_stdout() -> None:
    """Discard what is still buffered for stdout, so that the interpreter does not fail on it again at
    exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

"""`noslip completion`: prints a script that completes noslip's commands and options in a shell."""

import argparse

from . import COMMANDS
from .commands import parser_of, show

EXAMPLE = """examples:
  noslip completion bash > ~/.local/share/bash-completion/completions/noslip
  noslip completion zsh > ~/.zfunc/_noslip"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip completion`."""
    parser = subparsers.add_parser(
        "completion",
        help="print a completion script for a shell",
        description="Print a script with which a shell completes the commands and options of noslip.",
        epilog=EXAMPLE,
    )
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="the shell")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip completion`. Return 0."""
    import shtab

    parser, _ = parser_of(COMMANDS)
    script = shtab.complete(parser, args.shell)
    show(args, lambda: script, lambda: {"shell": args.shell, "script": script})
    return 0

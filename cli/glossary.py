"""`noslip glossary`: says what the words in answers mean."""

import argparse
import textwrap

from .commands import show

EXAMPLE = """examples:
  noslip glossary
  noslip glossary zero dynamics"""
WIDTH = 100


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip glossary`."""
    parser = subparsers.add_parser(
        "glossary",
        help="say what a word means, such as decoupling matrix",
        description="Say what a word of mechanics or control means that noslip's answers use. Without a "
        "word, list all entries.",
        epilog=EXAMPLE,
    )
    parser.add_argument("word", metavar="WORD", nargs="*", help="an entry, or words of its name")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run `noslip glossary`. Return 0. Raises BadInput if there is no such entry."""
    from ..readers.glossary import glossary, meanings

    if not arguments.word:
        show(arguments, lambda: "\n".join(glossary()), lambda: list(glossary()))
        return 0
    entries = meanings(" ".join(arguments.word))
    show(
        arguments,
        lambda: "\n\n".join(f"{name}\n{_indented(meaning)}" for name, meaning in entries.items()),
        lambda: entries,
    )
    return 0


def _indented(meaning: str) -> str:
    return "\n\n".join(
        textwrap.indent(textwrap.fill(paragraph, WIDTH - 2), "  ") for paragraph in meaning.split("\n\n")
    )

"""The glossary: the words of mechanics and control that answers use, from glossary.md."""

from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path

from .errors import BadInput

FILE = Path(__file__).with_name("glossary.md")


@lru_cache
def glossary() -> dict[str, str]:
    """Return the meaning of each word, in its order: plain text with one blank line between paragraphs."""
    _, *sections = FILE.read_text(encoding="utf-8").split("\n## ")
    return {
        word.strip(): meaning.strip()
        for word, _, meaning in (section.partition("\n") for section in sections)
    }


def symbols() -> dict[str, str]:
    """Return the meaning of each symbol of the method by its names, such as "Φ, Phi"."""
    lines = (line.removeprefix("- ") for line in glossary()["Symbols"].splitlines() if line.startswith("- "))
    return {names: meaning for names, _, meaning in (line.partition(": ") for line in lines)}


def meanings(word: str) -> dict[str, str]:
    """Return the entries whose names have all parts of `word`, such as "zero dynamics", "nonholonomic",
    "path-following", or the symbol `word`, such as "Phi". Raises BadInput if there is none.
    """
    if found := {names: meaning for names, meaning in symbols().items() if word in names.split(", ")}:
        return found
    parts = word.lower().replace("-", " ").split()
    entries = {
        name: meaning for name, meaning in glossary().items() if parts and _words(name).issuperset(parts)
    }
    if not entries:
        known = {each: each for each in glossary()} | {
            part: part for each in glossary() for part in _words(each)
        }
        near = get_close_matches(word.lower(), [name.lower() for name in known], 1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(glossary())}"
        raise BadInput(f"the glossary has no {word!r}{hint}")
    return entries


def _words(name: str) -> set[str]:
    return set(name.lower().replace(",", " ").replace("-", " ").split())

"""The exceptions that the command line reports: it exits with code 2 for bad input,
1 for a result that a check contradicts."""

import difflib
import json
import sys
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urlsplit


class BadInput(Exception):
    """User input that cannot be used. The message is one line: what is wrong, where, and what to do."""


@contextmanager
def naming(
    what: object, kinds: type[Exception] | tuple[type[Exception], ...] = BadInput, remedy: str = ""
) -> Iterator[None]:
    """Raise BadInput with `what` before the message of an error of these kinds, by default a BadInput, that
    is raised inside, and a `remedy` after it.
    """
    try:
        yield
    except kinds as error:
        said = (error.strerror if isinstance(error, OSError) else None) or " ".join(
            map(str.strip, str(error).splitlines())
        )
        raise BadInput(
            "; ".join(filter(None, (": ".join(filter(None, (str(what), said))), remedy)))
        ) from error


def check_status(status: str, what: str, remedy: str = "", fine: Container[str] = ("ok",)) -> None:
    """Raise BadInput, with a `remedy`, for the status of a call of the C, `what`,
    that is not among the `fine` ones."""
    if status not in fine:
        raise BadInput("; ".join(filter(None, (f"{what} returns {status!r}", remedy))))


class Mismatch(Exception):
    """The generated C differs from the model: a line for each law that differs. This is a defect of
    noslip."""


class Contradiction(Exception):
    """A run of a robot contradicts a verdict about it: a line that states both. This is a defect of
    noslip."""


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest of `names`, or all of them."""
    names = list(names)
    near = difflib.get_close_matches(name, names, 1)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(names) or 'none'}"


def check_named(name: str, names: Iterable[str], what: str) -> None:
    """Raise BadInput unless the name is one of `names`; `what` it is begins the message."""
    names = list(names)
    if name not in names:
        raise BadInput(f"{what} {name!r}{suggestion(name, names)}")


def library(name: str, what: str, extra: str) -> ModuleType:
    """Return a module that an extra of noslip installs. Raises BadInput that says `what` needs it,
    and how it is installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise BadInput(f"{what}; {installing(extra)}") from error


def installing(extra: str) -> str:
    """Return the command that installs an extra of noslip into this environment: `make setup` in that of a
    clone, for another one the clone or the wheel that it has, with the extra.
    """
    root = Path(__file__).resolve().parents[1]
    clone = (root / "Makefile").is_file()
    if clone and Path(sys.prefix).resolve() == (root / ".venv").resolve():
        return f"`make -C {root} setup` installs it"
    from importlib import metadata  # slow to import, and needed by few runs

    origin = metadata.distribution("noslip").read_text("direct_url.json")  # of what was installed from a file
    wheel = (
        unquote(urlsplit(json.loads(origin)["url"]).path)
        if origin
        else f"PATH/noslip-{metadata.version('noslip')}.whl"
    )
    pip = (
        f"{sys.executable} -m pip install"
        if find_spec("pip")
        else f"uv pip install --python {sys.executable}"
    )
    return f"`{pip} -e '{root}[{extra}]'` installs it" if clone else f"`{pip} '{wheel}[{extra}]'` installs it"

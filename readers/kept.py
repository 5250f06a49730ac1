"""Results cached between runs: compiled and derived laws, each under the digest of all that determines it.

The name of a file also contains the digest of its content, so that a damaged file is detected and computed
again.
"""

import hashlib
import io
import os
import pickle
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from .errors import BadInput
from .files import create, replacing

Result = TypeVar("Result")
DERIVES = ("model", "codegen")  # folders whose code determines a derived program


def remembered(
    key: tuple,
    make: Callable[[], Result],
    *shared: Any,
    rooms: tuple[str, ...] = DERIVES,
    lasts: Callable[[Result], bool] = lambda _: True,
) -> Result:
    """Return make(), or a copy of its result in an earlier run with the same `key` and the same code of
    noslip.

    `shared`: objects to which the result refers; a copy refers to them too. `rooms`: the folders of that
    code. `lasts`: whether a result is to be cached. Without a usable cache folder nothing is cached.
    """
    whole = ("remembered", digest_of_code(rooms), *key)
    with suppress(BadInput, OSError):
        if file := kept(whole, ".pickle"):
            return _Unpickler(io.BytesIO(file.read_bytes()), shared).load()
    result = make()
    if not lasts(result):
        return result
    data = io.BytesIO()
    _Pickler(data, shared).dump(result)
    with suppress(BadInput, OSError):
        keep(whole, ".pickle", data.getvalue())
    return result


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: tuple):
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._places = {id(one): place for place, one in enumerate(shared)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._places.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: tuple):
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: Any) -> Any:
        return self._shared[pid]


def digest_of_code(rooms: tuple[str, ...]) -> str:
    """Return the digest of all files in folders of noslip."""
    return digest(repr([_digest_of_room(room) for room in rooms]).encode())


@cache
def _digest_of_room(room: str) -> str:
    folder = Path(__file__).resolve().parent.parent / room
    paths = (Path(place, name) for place, _, names in os.walk(folder) for name in names)  # templates too
    files = sorted(path for path in paths if path.parent.name != "__pycache__")
    return digest(b"".join(file.read_bytes() for file in files))


@cache
def version_of(library: str) -> str:
    """Return the version of an installed library, from the name of the folder that describes it."""
    name = library.replace("-", "_")
    for place in sys.path:
        for folder in Path(place).glob(f"{name}-*.dist-info"):
            return folder.name.removeprefix(f"{name}-").removesuffix(".dist-info")
    from importlib.metadata import version  # slow to import

    return version(library)


def kept(key: tuple, suffix: str) -> Path | None:
    """Return the file for `key`, identified by its `repr`; None if there is none or it is damaged.

    Raises BadInput if the cache folder cannot be created or is not private to this user.
    """
    folder, own = folder_of_results(), f"{_digest_of(key)}-"
    for name in os.listdir(folder):  # quicker than glob, which reads all names too
        if name.startswith(own) and name.endswith(suffix):
            if _is_sound(folder / name):
                return folder / name
            (folder / name).unlink(missing_ok=True)  # damaged: it is computed again
    return None


def keep(key: tuple, suffix: str, data: bytes) -> Path:
    """Write the file for `key`, which `kept` finds. Raises BadInput as `kept` does."""
    target = folder_of_results() / f"{_digest_of(key)}-{digest(data)}{suffix}"
    with replacing(target) as new:
        create(new, data)
        new.chmod(0o700)
    return target


def _digest_of(key: tuple) -> str:
    return digest(repr(key).encode())


def _is_sound(path: Path) -> bool:
    """Whether the content of a file agrees with the digest in its name.

    Raises BadInput if it belongs to another user or others can write it, since it is executed with this
    user's rights.
    """
    with suppress(OSError):  # removed in the meantime, or unreadable
        check_private(path)
        return path.stem.rpartition("-")[2] == digest(path.read_bytes())
    return False


def digest(data: bytes) -> str:
    """Return the first half of SHA-256, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()[:32]


def folder_of_results() -> Path:
    """Return the folder for cached results: $NOSLIP_CACHE, else the user's cache folder."""
    base = os.environ.get("NOSLIP_CACHE")
    try:
        folder = Path(
            base or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "noslip"
        ).absolute()
    except RuntimeError as error:  # the user has no home folder
        raise BadInput(
            "there is no home folder for compiled laws; set NOSLIP_CACHE to a folder of your own"
        ) from error
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"cannot make the folder for compiled laws {folder}: {error.strerror}; set NOSLIP_CACHE"
        ) from error
    check_private(folder)
    return folder


def check_private(path: Path) -> None:
    """Raise BadInput if a folder or file with programs to execute belongs to another user,
    or others can write it."""
    status = path.stat()
    advice = "set NOSLIP_CACHE to a folder of your own"
    if status.st_uid != os.geteuid():
        raise BadInput(
            f"{path} belongs to another user, and noslip does not execute programs of others; {advice}"
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise BadInput(
            f"{path} can be written by others, and noslip does not execute programs of others; chmod go-w "
            f"it, or {advice}"
        )

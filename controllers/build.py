"""Compiles generated C, once per content: by the system's compiler into a shared library, or by another command."""

import hashlib
import os
import shlex
import shutil
import stat
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from ..codegen.targets import STANDARD
from ..readers.errors import BadInput
from ..readers.files import create, replacing, work_folder

RUNTIME = Path(__file__).resolve().parent.parent / "runtime_c"
FLAGS = (*STANDARD, "-fPIC", "-shared", "-Wall", "-Wextra")
QUICK, OPTIMIZED = ("-O0",), ("-O2",)  # appended; the bits are the same, QUICK compiles four times as fast


class DoesNotCompile(BadInput):
    """The compiler rejects the C."""


def runtime_files() -> dict[str, str]:
    """Return the hand-written C on which generated laws depend: file name -> text, without the .inc files of headers."""
    compiled = [path for path in sorted(RUNTIME.iterdir()) if path.suffix in (".h", ".c", ".inc")]
    made_from = {path for path in compiled if path.suffix == ".inc" and path.with_suffix(".h") in compiled}
    return {path.name: path.read_text() for path in compiled if path not in made_from}


def compiler() -> list[str]:
    """Return the compiler and its leading arguments: $CC, else cc, gcc or clang. Raises BadInput if there is none."""
    chosen = os.environ.get("CC")
    if chosen:
        try:
            return shlex.split(chosen)
        except ValueError as error:
            raise BadInput(f"CC = {chosen!r} cannot be read as a command: {error}") from error
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    raise BadInput("no C compiler found: install gcc or clang, or name one in CC")


def shared_library(files: Mapping[str, str], optimized: bool = False) -> Path:
    """Compile the .c files among `files` (name -> text) with the runtime files that they use; return the library, possibly
    cached.

    `optimized` is for functions that are called millions of times. Raises BadInput if there is no compiler, no place to write, or
    the compiler rejects the C.
    """
    everything = {**runtime_files(), **files}
    sources = [name for name in everything if name.endswith(".c") and (name in files or _called(name, files))]
    command = [*compiler(), *FLAGS, *(OPTIMIZED if optimized else QUICK), *sources]
    return built(command, everything, "law.so", "check CC and its flags")


def built(command: Sequence[str], files: Mapping[str, str], product: str, advice: str = "") -> Path:
    """Return the product of a command run in a folder with `files` (name -> text), possibly cached.

    The command begins with a compiler; the option that names the `product` is appended. Raises DoesNotCompile, with the advice,
    if the compiler rejects the C; BadInput if it does not run or there is no place to write.
    """
    whole = [*command, "-o", product]
    key, suffix = (whole, sorted(files.items())), Path(product).suffix
    if found := kept(key, suffix):
        return found
    with work_folder(_cache()) as folder:
        for name, text in files.items():
            (folder / name).write_text(text)
        result = subprocess.run(whole, cwd=folder, capture_output=True, text=True)
        if result.returncode or not (folder / product).exists():
            said = next((line for line in result.stderr.splitlines() if "error" in line), f"it did not write {product}")
            more = f"; {advice}" if advice else ""
            raise DoesNotCompile(f"the generated C does not compile with `{command[0]}`: {said}{more}")
        return keep(key, suffix, (folder / product).read_bytes())


def kept(key: tuple, suffix: str) -> Path | None:
    """Return the cached result for `key`, whose first item is a compiler's command; None if there is none, or it is damaged.

    Raises BadInput if that compiler does not run, and if the cache folder does not belong to this user.
    """
    for path in _cache().glob(f"{_digest_of(key)}-*{suffix}"):
        if _is_sound(path):
            return path
        path.unlink(missing_ok=True)  # damaged: it is built again
    return None


def keep(key: tuple, suffix: str, data: bytes) -> Path:
    """Store the result determined by `key` in the cache. Raises BadInput as `kept` does."""
    target = _cache() / f"{_digest_of(key)}-{_short_digest(data)}{suffix}"
    with replacing(target) as new:
        create(new, data)
        new.chmod(0o700)
    return target


def _digest_of(key: tuple) -> str:
    return _short_digest(repr((key, _version(key[0][0]))).encode())


def _is_sound(path: Path) -> bool:
    """Return whether a cached result has the digests of command and content that are in its name.

    Raises BadInput if it belongs to another user, or others may write it: it would run with this user's rights.
    """
    with suppress(OSError):  # removed in the meantime, or unreadable
        check_private(path)
        return path.stem.rpartition("-")[2] == _short_digest(path.read_bytes())
    return False


def _short_digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def _called(source: str, files: Mapping[str, str]) -> bool:
    """Return whether `files` use this file of the runtime. All use the status; the others are included by name."""
    header = source.removesuffix(".c").removesuffix("_f") + ".h"
    return source == "noslip_status.c" or any(f'#include "{header}"' in text for text in files.values())


@cache
def _version(name: str) -> str:
    """Return the version of the compiler, so that a new compiler builds again."""
    try:
        return subprocess.run([name, "--version"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise BadInput(f"the C compiler {name!r} does not run: {error}") from error


def _cache() -> Path:
    """Return the cache folder: $NOSLIP_CACHE, else the user's cache folder."""
    base = os.environ.get("NOSLIP_CACHE")
    try:
        folder = Path(base or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "noslip").absolute()
    except RuntimeError as error:  # this user has no home folder
        raise BadInput("there is no home folder for compiled laws; set NOSLIP_CACHE to a folder of your own") from error
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder for compiled laws {folder}: {error.strerror}; set NOSLIP_CACHE") from error
    check_private(folder)
    return folder


def check_private(path: Path) -> None:
    """Raise BadInput if a folder or file with executable code belongs to another user, or others may write it."""
    found = path.stat()
    advice = "set NOSLIP_CACHE to a folder of your own"
    if found.st_uid != os.geteuid():
        raise BadInput(f"{path} belongs to another user, and noslip does not execute programs of others; {advice}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise BadInput(
            f"{path} can be written by others, and noslip does not execute programs of others; chmod go-w it, or {advice}"
        )

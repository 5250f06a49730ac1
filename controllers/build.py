"""Compiles generated C, once per content: with the system's compiler into a shared library, or as told."""

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
QUICK, OPTIMIZED = ("-O0",), ("-O2",)  # after those; the bits are the same, QUICK compiles in a quarter of the time


class DoesNotCompile(BadInput):
    """A compiler refuses C that it is given."""


def runtime_files() -> dict[str, str]:
    """The hand-written C that generated laws stand on: file name -> text, without the texts that headers are made from."""
    compiled = [path for path in sorted(RUNTIME.iterdir()) if path.suffix in (".h", ".c", ".inc")]
    made_from = {path for path in compiled if path.suffix == ".inc" and path.with_suffix(".h") in compiled}
    return {path.name: path.read_text() for path in compiled if path not in made_from}


def compiler() -> list[str]:
    """The compiler and its leading arguments: $CC, else cc, gcc or clang. Raises BadInput when there is none."""
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
    """Compile the .c files among `files` (name -> text) with what they call of the runtime, or find an earlier result.

    `optimized`: for what is called millions of times. Raises BadInput when there is no compiler, no place to write, or the
    compiler refuses.
    """
    everything = {**runtime_files(), **files}
    sources = [name for name in everything if name.endswith(".c") and (name in files or _called(name, files))]
    command = [*compiler(), *FLAGS, *(OPTIMIZED if optimized else QUICK), *sources]
    return built(command, everything, "law.so", "check CC and its flags")


def built(command: Sequence[str], files: Mapping[str, str], product: str, advice: str = "") -> Path:
    """What a command makes of `files` (name -> text), all in the folder it runs in; or an earlier result.

    The command begins with a compiler; the last of its options, that it is to make `product`, is added here. Raises
    DoesNotCompile, with the advice, when the compiler refuses; BadInput when it does not run or there is no place to write.
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
            said = next((line for line in result.stderr.splitlines() if "error" in line), f"it made no {product}")
            more = f"; {advice}" if advice else ""
            raise DoesNotCompile(f"the generated C does not compile with `{command[0]}`: {said}{more}")
        return keep(key, suffix, (folder / product).read_bytes())


def kept(key: tuple, suffix: str) -> Path | None:
    """The result kept for `key`, whose first item is a compiler's command; None where there is none, or it is damaged.

    Raises BadInput when that compiler does not run, and when the folder of results is not this user's own.
    """
    for path in _cache().glob(f"{_digest_of(key)}-*{suffix}"):
        if _is_sound(path):
            return path
        path.unlink(missing_ok=True)  # damaged: it is made anew
    return None


def keep(key: tuple, suffix: str, data: bytes) -> Path:
    """Keep the result of what `key` determines, for `kept` to find. Raises BadInput as that does."""
    target = _cache() / f"{_digest_of(key)}-{_short_digest(data)}{suffix}"
    with replacing(target) as new:
        create(new, data)
        new.chmod(0o700)
    return target


def _digest_of(key: tuple) -> str:
    return _short_digest(repr((key, _version(key[0][0]))).encode())


def _is_sound(path: Path) -> bool:
    """Does a kept result hold what its name, the digest of its command and that of its content, says?

    Raises BadInput where it is another user's, or others may write it: it would run with this user's rights.
    """
    with suppress(OSError):  # removed meanwhile, or unreadable
        check_private(path)
        return path.stem.rpartition("-")[2] == _short_digest(path.read_bytes())
    return False


def _short_digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def _called(source: str, files: Mapping[str, str]) -> bool:
    """Is this file of the runtime one that `files` call? All use the status, the others are included by name."""
    header = source.removesuffix(".c").removesuffix("_f") + ".h"
    return source == "noslip_status.c" or any(f'#include "{header}"' in text for text in files.values())


@cache
def _version(name: str) -> str:
    """What the compiler says it is: a new compiler builds anew."""
    try:
        return subprocess.run([name, "--version"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise BadInput(f"the C compiler {name!r} does not run: {error}") from error


def _cache() -> Path:
    """Where results are kept: $NOSLIP_CACHE, else the user's cache folder."""
    base = os.environ.get("NOSLIP_CACHE")
    try:
        folder = Path(base or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "noslip").absolute()
    except RuntimeError as error:  # this user has no home
        raise BadInput("there is no home folder for compiled laws; set NOSLIP_CACHE to a folder of your own") from error
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder for compiled laws {folder}: {error.strerror}; set NOSLIP_CACHE") from error
    check_private(folder)
    return folder


def check_private(path: Path) -> None:
    """Raise BadInput where a folder or file whose programs are to run is another user's, or others may write it."""
    found = path.stat()
    advice = "set NOSLIP_CACHE to a folder of your own"
    if found.st_uid != os.geteuid():
        raise BadInput(f"{path} belongs to another user, whose programs noslip does not run; {advice}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise BadInput(f"{path} can be written by others, whose programs noslip does not run; chmod go-w it, or {advice}")

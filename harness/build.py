"""Compiles generated C, once per content: with the system's compiler into a shared library, or as told."""

import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from .errors import BadInput
from .files import unfinished

RUNTIME = Path(__file__).resolve().parent.parent / "runtime_c"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared", "-Wall", "-Wextra")


def runtime_files() -> dict[str, str]:
    """The hand-written C that generated laws stand on: file name -> text."""
    return {path.name: path.read_text() for path in sorted(RUNTIME.iterdir()) if path.suffix in (".h", ".c", ".inc")}


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


def shared_library(files: Mapping[str, str]) -> Path:
    """Compile the .c files among `files` (name -> text) with what they call of the runtime, or find an earlier result.

    Raises BadInput when there is no compiler, no place to write, or the compiler refuses.
    """
    everything = {**runtime_files(), **files}
    sources = [name for name in everything if name.endswith(".c") and (name in files or _called(name, files))]
    return built([*compiler(), *FLAGS, *sources], everything, "law.so", "check CC and its flags")


def built(command: Sequence[str], files: Mapping[str, str], product: str, advice: str = "") -> Path:
    """What a command makes of `files` (name -> text), all in the folder it runs in; or an earlier result.

    The command begins with a compiler; the last of its options, that it is to make `product`, is added here. Raises BadInput,
    with the advice, when the compiler refuses; when it does not run; when there is no place to write.
    """
    whole = [*command, "-o", product]
    key = hashlib.sha256(repr((whole, _version(command[0]), sorted(files.items()))).encode()).hexdigest()
    target = _cache() / f"{key[:32]}{Path(product).suffix}"
    if target.exists():
        return target
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        unfinished.add(Path(folder))
        for name, text in files.items():
            Path(folder, name).write_text(text)
        result = subprocess.run(whole, cwd=folder, capture_output=True, text=True)
        if result.returncode or not Path(folder, product).exists():
            said = next((line for line in result.stderr.splitlines() if "error" in line), f"it made no {product}")
            raise BadInput(f"the generated C does not compile with `{command[0]}`: {said}" + (f"; {advice}" if advice else ""))
        os.replace(Path(folder, product), target)
    return target


def _called(source: str, files: Mapping[str, str]) -> bool:
    """Is this file of the runtime one that `files` call? All use the status, the others are included by name."""
    header = source.removesuffix(".c").removesuffix("_f") + ".h"
    return source == "noslip_status.c" or any(f'#include "{header}"' in text for text in files.values())


def _version(name: str) -> str:
    """What the compiler says it is: a new compiler builds anew."""
    try:
        return subprocess.run([name, "--version"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise BadInput(f"the C compiler {name!r} does not run: {error}") from error


def _cache() -> Path:
    """Where results are kept: $NOSLIP_CACHE, else the user's cache folder."""
    base = os.environ.get("NOSLIP_CACHE") or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "noslip"
    folder = Path(base)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder for compiled laws {folder}: {error.strerror}; set NOSLIP_CACHE") from error
    return folder

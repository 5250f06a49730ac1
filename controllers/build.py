"""Compiles generated C, once per content: with the system's compiler into a shared library, or as told."""

import os
import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from ..codegen.targets import STANDARD
from ..readers.errors import BadInput
from ..readers.files import work_folder
from ..readers.kept import folder_of_results, keep, kept

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
    key, suffix = (*identity(whole), sorted(files.items())), Path(product).suffix
    if found := kept(key, suffix):
        return found
    with work_folder(folder_of_results()) as folder:
        for name, text in files.items():
            (folder / name).write_text(text)
        result = subprocess.run(whole, cwd=folder, capture_output=True, text=True)
        if result.returncode or not (folder / product).exists():
            said = next((line for line in result.stderr.splitlines() if "error" in line), f"it made no {product}")
            more = f"; {advice}" if advice else ""
            raise DoesNotCompile(f"the generated C does not compile with `{command[0]}`: {said}{more}")
        return keep(key, suffix, (folder / product).read_bytes())


def _called(source: str, files: Mapping[str, str]) -> bool:
    """Is this file of the runtime one that `files` call? All use the status, the others are included by name."""
    header = source.removesuffix(".c").removesuffix("_f") + ".h"
    return source == "noslip_status.c" or any(f'#include "{header}"' in text for text in files.values())


def identity(command: Sequence[str]) -> tuple:
    """A command that begins with a compiler, and that compiler's version. Raises BadInput where it does not run."""
    return list(command), _version(command[0])


@cache
def _version(name: str) -> str:
    try:
        return subprocess.run([name, "--version"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise BadInput(f"the C compiler {name!r} does not run: {error}") from error

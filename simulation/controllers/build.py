"""Compiles generated C, once per content: by the system's compiler into a shared library,
or by another command."""

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from ...codegen.runtime import runtime_files
from ...codegen.targets import STANDARD
from ...readers.errors import BadInput, naming
from ...readers.files import work_folder
from ...readers.kept import folder_of_results, keep, kept, remembered

FLAGS = (*STANDARD, "-fPIC", "-Wall", "-Wextra", "-Werror=implicit-function-declaration")
QUICK, OPTIMIZED = ("-O0",), ("-O2",)  # appended; the bits are the same, QUICK compiles four times as fast


class DoesNotCompile(BadInput):
    """The compiler rejects the C."""


def compiler() -> list[str]:
    """Return the compiler and its leading arguments: $CC, else cc,
    gcc or clang. Raises BadInput if there is none."""
    chosen = os.environ.get("CC")
    if chosen:
        with naming(f"CC = {chosen!r} cannot be read as a command", ValueError):
            return shlex.split(chosen)
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    raise BadInput("no C compiler found: install gcc or clang, or name one in CC")


def shared_library(files: Mapping[str, str], optimized: bool = False) -> Path:
    """Compile the .c files among `files` (name -> text) with the runtime files that they use; return the
    library, possibly cached.

    `optimized` is for functions that are called millions of times. Raises BadInput if there is no compiler,
    no place to write, or the compiler rejects the C.
    """
    everything = with_runtime(files)
    command = [*compiler(), *FLAGS, *(OPTIMIZED if optimized else QUICK)]
    key = "library", *identity(command), sorted(everything.items())
    if found := kept(key, ".so"):
        return found
    advice = "check CC and its flags"
    linked = [*compiler(), "-shared", *map(str, _objects(command, everything, advice))]
    return keep(key, ".so", _product(linked, {}, "law.so", advice))


def _objects(command: Sequence[str], files: Mapping[str, str], advice: str = "") -> list[Path]:
    """Return the object of each .c file among `files`, compiled by a command with the files that it includes;
    possibly cached: many laws have the same ones. Raises as `built`.
    """
    return [
        built([*command, "-c", name], _with_headers(files, name), f"{name}.o", advice)
        for name in files
        if name.endswith(".c")
    ]


def built(command: Sequence[str], files: Mapping[str, str], product: str, advice: str = "") -> Path:
    """Return the product of a command run in a folder with `files` (name -> text), possibly cached.

    The command begins with a compiler; the option that names the `product` is appended. Raises
    DoesNotCompile, with the advice, if the compiler rejects the C; BadInput if it does not run or there is no
    place to write.
    """
    key = (*identity([*command, "-o", product]), sorted(files.items()))
    suffix = Path(product).suffix
    return kept(key, suffix) or keep(key, suffix, _product(command, files, product, advice))


def _product(command: Sequence[str], files: Mapping[str, str], product: str, advice: str) -> bytes:
    with work_folder(folder_of_results()) as folder:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        result = subprocess.run(
            [*command, "-o", product], cwd=folder, capture_output=True, encoding="utf-8", errors="replace"
        )
        if result.returncode or not (folder / product).exists():
            said = next(
                (line for line in result.stderr.splitlines() if "error" in line),
                f"it did not write {product}",
            )
            more = f"; {advice}" if advice else ""
            raise DoesNotCompile(f"the generated C does not compile with `{command[0]}`: {said}{more}")
        return (folder / product).read_bytes()


def check_links(files: Mapping[str, str]) -> None:
    """Compile each .c file among `files` (path -> text) that was not compiled before, and link them all with
    what they use of the runtime.

    Raises DoesNotCompile for C that the compiler or the linker rejects, BadInput if there is no compiler.
    """
    flat = with_runtime(
        {Path(name).name: text for name, text in files.items() if name.endswith((".c", ".h"))}
    )
    if not any(re.search(r"^int main\(", text, re.M) for text in flat.values()):
        flat["main.c"] = "int main(void)\n{\n    return 0;\n}\n"
    command = [*compiler(), *FLAGS, *QUICK]
    objects = _objects(command, flat)
    key = "links", identity(command), sorted(path.name for path in objects)
    if kept(key, ".links"):
        return
    with work_folder(folder_of_results()) as folder:
        linked = subprocess.run(
            [*command, *map(str, objects), "-o", str(folder / "all")], capture_output=True, text=True
        )
    if linked.returncode:
        lines = [line for line in linked.stderr.splitlines() if "undefined" in line or "multiple" in line]
        raise DoesNotCompile(f"the generated C does not link: {lines[0] if lines else linked.stderr.strip()}")
    keep(key, ".links", b"")


def _with_headers(files: Mapping[str, str], name: str) -> dict[str, str]:
    """Return a file with those that it includes, directly or not."""
    found = {name: files[name]}
    waiting = [files[name]]
    while waiting:
        new = [
            header
            for header in re.findall(r'#include "(\S+)"', waiting.pop())
            if header in files and header not in found
        ]
        found |= {header: files[header] for header in new}
        waiting += [files[header] for header in new]
    return found


def with_runtime(files: Mapping[str, str]) -> dict[str, str]:
    """Return C files (name -> text) with the files of the runtime that they include, directly or not, and
    their sources; with the status in any case.
    """
    runtime, found = _runtime(), dict(files)
    texts = ['#include "noslip_status.h"', *files.values()]
    for text in texts:
        for header in re.findall(r'#include "(\S+)"', text):
            own = [
                name
                for name in runtime
                if name.endswith(".c") and name[:-2].removesuffix("_f") == header.removesuffix(".h")
            ]
            new = {name: runtime[name] for name in (header, *own) if name in runtime and name not in found}
            found |= new
            texts += new.values()
    return found


@cache
def _runtime() -> dict[str, str]:
    """Return `runtime_files`, which take long to write out: read once per process, and cached between
    runs."""
    return remembered(("runtime",), runtime_files, rooms=("runtime_c", "codegen"))


def identity(command: Sequence[str]) -> tuple:
    """Return a command that begins with a compiler, and the version of the compiler. Raises BadInput if it
    does not run."""
    return list(command), _version(command[0])


@cache
def _version(name: str) -> str:
    with naming(f"the C compiler {name!r} does not run", (OSError, subprocess.CalledProcessError)):
        return subprocess.run(
            [name, "--version"], capture_output=True, encoding="utf-8", errors="replace", check=True
        ).stdout

"""The hand-written C as a library that Python can call, with declarations extracted from the headers."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cffi

from ...codegen.printing.scalar import SCALARS
from ...codegen.runtime import RUNTIME
from ...readers.errors import BadInput, check_status, naming
from ...readers.kept import remembered
from .build import compiler, identity, shared_library

# The headers define everything static inline; here it is needed as functions of a library.
SOURCE = """#include <float.h>
#include <stddef.h>
#include <stdint.h>
#define static
#define inline
#define __attribute__(x)
#include "{header}"
"""
# What cffi cannot parse
ASIDE = ("-Dstatic=", "-Dinline=", "-D__attribute__(x)=", "-DNOSLIP_REAL_H", "-U__SSE2__")
ABSENT = ("float.h", "stddef.h", "stdint.h")
# The head of a function's body comes after its parameters
BODY, BRACE = re.compile(r"\)\s*\{"), re.compile(r"[{}]")
# of ABSENT and noslip_real.h
TYPES = (
    "size_t",
    "int32_t",
    "int64_t",
    "uint8_t",
    "uint16_t",
    "uint32_t",
    "uint64_t",
    "noslip_bits",
    "noslip_bits_f",
)


class InC:
    """Compiled C: `ffi` knows its types, `lib` its functions and constants."""

    ffi: cffi.FFI
    lib: Any

    def status(self, number: int) -> str:
        """Name of a status."""
        return self.ffi.string(self.lib.noslip_status_name(number)).decode()

    def number(self, status: str) -> int:
        """Return the status of a name."""
        return getattr(self.lib, "NOSLIP_GRIP_LIMITED" if status == "grip" else f"NOSLIP_{status.upper()}")


class Runtime(InC):
    """A header of runtime_c, compiled, in both scalars: `ffi` knows its types,
    `lib` its functions and constants."""

    def __init__(self, header: str):
        self.ffi = knowing(declarations(header))
        self.lib = load(self.ffi, {"library.c": SOURCE.format(header=header)})

    def new(self, kind: str, scalar: str, *initial):
        """Return a new struct of the kind named as in the header, for a scalar: double or float."""
        return self.ffi.new(f"{SCALARS[scalar].name(kind)} *", *initial)

    def array(self, scalar: str, values: Iterable[float]) -> Any:
        """Return the numbers as a C array of a scalar."""
        return self.ffi.new(f"{SCALARS[scalar].real}[]", [float(value) for value in values])

    def function(self, name: str, scalar: str):
        """Return a function named as in the header, for a scalar."""
        return getattr(self.lib, SCALARS[scalar].name(name))

    def call(self, purpose: str, name: str, scalar: str, *arguments) -> str:
        """Call a function and return the name of its status. Raises BadInput, with the purpose,
        if it is an error."""
        number = self.function(name, scalar)(*arguments)
        status = self.status(number)
        check_status(status, f"{purpose}: {name}", fine=[status] if number >= 0 else [])
        return status


@lru_cache
def runtime(header: str) -> Runtime:
    """Return a header's compiled C, loaded once per process. Raises BadInput as `shared_library` does."""
    return Runtime(header)


def load(ffi: cffi.FFI, files: Mapping[str, str], optimized: bool = False):
    """Return the library of C files (name -> text) compiled with the runtime;
    `optimized` as for `shared_library`."""
    path = shared_library(files, optimized)
    with naming(
        "cannot load the compiled law", OSError, "set NOSLIP_CACHE to a folder that allows executables"
    ):
        return ffi.dlopen(str(path))


def knowing(declared: str) -> cffi.FFI:
    """Return an FFI that knows declarations; they are parsed once, and cached between runs."""

    def parsed() -> str:
        from cffi.recompiler import make_py_source  # slow to import

        ffi = cffi.FFI()
        ffi.cdef(declared)
        ffi.set_source("declared", None)
        with TemporaryDirectory() as folder:
            path = Path(folder, "declared.py")
            make_py_source(ffi, "declared", str(path))
            return path.read_text(encoding="utf-8")

    names: dict[str, Any] = {}
    exec(remembered(("parsed", cffi.__version__, declared), parsed, rooms=()), names)
    return names["ffi"]


def declarations(header: str, *folders: Path) -> str:
    """Return types, constants and prototypes of a header of runtime_c, or of `folders`, and of those it
    includes, for cffi; cached between runs.

    Only these sources are read: the compiler's own headers are replaced by the names of their types.
    noslip_real.h is left out: it has nothing to call and cannot be parsed. Raises BadInput if the compiler
    cannot preprocess a header.
    """
    texts = [(path.name, path.read_bytes()) for folder in folders for path in sorted(folder.glob("*.[hi]*"))]
    key = "declarations", header, *identity(compiler()), texts
    return remembered(key, lambda: _declarations(header, folders), rooms=("runtime_c",))


def _declarations(header: str, folders: Iterable[Path]) -> str:
    from pycparser import CParser  # slow to import, as what follows
    from pycparser.c_generator import CGenerator

    with TemporaryDirectory() as empty:
        for name in ABSENT:
            Path(empty, name).touch()
        places = [f"-I{place}" for place in (empty, *folders, RUNTIME)]
        command = [*compiler(), "-std=c99", "-E", "-P", "-nostdinc", *ASIDE, *places, "-x", "c", "-"]
        result = subprocess.run(
            command, input=f'#include "{header}"\n', capture_output=True, encoding="utf-8", errors="replace"
        )
    if result.returncode:
        raise BadInput(f"`{' '.join(compiler())}` cannot preprocess {header}; check CC and its flags")
    known = "".join(f"typedef int {name};" for name in TYPES)
    declared = CParser().parse(known + _without_bodies(result.stdout)).ext
    return "".join(f"{CGenerator().visit(node)};\n" for node in declared[len(TYPES) :])


def _without_bodies(text: str) -> str:
    """Return preprocessed C with a semicolon for the body of each function,
    which takes most of the time to parse."""
    parts, end = [], 0
    while start := BODY.search(text, end):
        parts.append(text[end : start.start()] + ");")
        end, depth = start.end(), 1
        while depth:
            brace = BRACE.search(text, end)
            if brace is None:
                return text  # not what a compiler accepts: the parser says where
            depth += 1 if brace[0] == "{" else -1
            end = brace.end()
    return "".join(parts) + text[end:]

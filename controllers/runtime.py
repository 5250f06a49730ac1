"""The hand-written C as a library that Python can call, with declarations extracted from the headers."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import cffi

from ..codegen.printing.scalar import SCALARS
from ..readers.errors import BadInput
from .build import RUNTIME, compiler, shared_library

# The headers define everything static inline; here it is needed as functions of a library.
SOURCE = """#include <float.h>
#include <stddef.h>
#include <stdint.h>
#define static
#define inline
#define __attribute__(x)
#include "{header}"
"""
ASIDE = ("-Dstatic=", "-Dinline=", "-D__attribute__(x)=")  # words that cffi cannot parse


class InC:
    """Compiled C: `ffi` knows its types, `lib` its functions and constants."""

    ffi: cffi.FFI
    lib: Any

    def status(self, number: int) -> str:
        """Name of a status."""
        return self.ffi.string(self.lib.noslip_status_name(number)).decode()


class Runtime(InC):
    """A header of runtime_c, compiled, in both scalars: `ffi` knows its types, `lib` its functions and constants."""

    def __init__(self, header: str):
        self.ffi = cffi.FFI()
        self.ffi.cdef(declarations(header))
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


@lru_cache
def runtime(header: str) -> Runtime:
    """Return a header's compiled C, loaded once per process. Raises BadInput as `shared_library` does."""
    return Runtime(header)


def load(ffi: cffi.FFI, files: Mapping[str, str], optimized: bool = False):
    """Return the library of C files (name -> text) compiled with the runtime; `optimized` as for `shared_library`."""
    path = shared_library(files, optimized)
    try:
        return ffi.dlopen(str(path))
    except OSError as error:
        raise BadInput(f"cannot load the compiled law: {error}; set NOSLIP_CACHE to a folder that allows executables") from error


def declarations(header: str) -> str:
    """Return types, constants and prototypes of a header of runtime_c and of those it includes, for cffi.

    Raises BadInput if the compiler cannot preprocess it.
    """
    command = [*compiler(), "-std=c99", *ASIDE, f"-I{RUNTIME}", "-E", "-x", "c", "-"]
    result = subprocess.run(command, input=f'#include "{header}"\n', capture_output=True, text=True)
    if result.returncode:
        raise BadInput(f"`{' '.join(compiler())}` cannot preprocess {header}; check CC and its flags")
    return without_bodies("\n".join(_own_lines(result.stdout)))


def _own_lines(preprocessed: str) -> list[str]:
    """Return the lines that come from runtime_c, except those of noslip_real.h, which cffi cannot parse."""
    lines, own = [], False
    for line in preprocessed.splitlines():
        marker = re.match(r'#(?:line)? (?:\d+) "(.*?)"', line)
        if marker:
            own = marker[1].startswith(str(RUNTIME)) and not marker[1].endswith("noslip_real.h")
        elif own and not line.startswith("#"):
            lines.append(line)
    return lines


def without_bodies(text: str) -> str:
    """Return C with a semicolon in place of each function body: each outermost block after a closing parenthesis."""
    kept: list[str] = []
    depth, body = 0, False
    for piece in re.split(r"([{}])", text):
        if piece == "{" and depth == 0:
            body = "".join(kept).rstrip().endswith(")")
        depth += {"{": 1, "}": -1}.get(piece, 0)
        if not body:
            kept.append(piece)
        elif depth == 0:
            kept.append(";")
            body = False
    return "".join(kept)

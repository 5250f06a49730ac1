"""Normal random numbers from the C that sweeps use, so that `noslip simulate` repeats a sample with the same
bits."""

from functools import lru_cache
from importlib.resources import files
from typing import Any

import cffi
import numpy as np

from .controllers.runtime import SOURCE, knowing, load

HEADER = "noise.h"
DECLARED = """
void noise_words(const uint32_t counter[4], const uint32_t key[2], uint32_t words[4]);
double noise_log(double x);
void noise_normal(uint64_t seed, uint64_t draw, int count, double *normal);
"""


class Noise:
    """Draws of `width` independent numbers, mean 0, standard deviation 1; they depend on the seed and the
    number of the draw only.
    """

    def __init__(self, seed: int, width: int):
        self._seed, self._width, self._drawn = seed, width, 0

    def draw(self) -> np.ndarray:
        """Return the next draw, (width,)."""
        ffi, lib = library()
        made = np.empty(self._width)
        lib.noise_normal(self._seed % 2**64, self._drawn, self._width, ffi.cast("double *", made.ctypes.data))
        self._drawn += 1
        return made


@lru_cache
def library() -> tuple[cffi.FFI, Any]:
    """Return the compiled C: types and functions. Raises BadInput as `load` does."""
    ffi = knowing(DECLARED)
    return ffi, load(ffi, {"library.c": SOURCE.format(header=HEADER), **source()})


def source() -> dict[str, str]:
    """Return the C of the random numbers: file name -> text."""
    return {HEADER: (files(__package__) / HEADER).read_text(encoding="utf-8")}

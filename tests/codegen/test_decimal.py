"""firmware/selftest/decimal.h: a double as the text that Python writes with 17 digits."""

import math
import struct

import cffi
import numpy as np
from noslip.codegen.project.selftest import headers
from noslip.simulation.controllers.runtime import SOURCE, load

HEADER = "decimal.h"
EDGES = [
    0.1,
    1.0,
    -0.25,
    1e16,
    1e17,
    99999999999999984.0,
    9.9999999999999995e16,
    1e-4,
    1e-5,
    9.999999999999999e-5,
    1e22,
    1e23,
]
EDGES += [
    5e-324,
    2.2250738585072014e-308,
    1.7976931348623157e308,
    math.pi,
    1 / 3,
    2.0**53,
    2.0**-60,
    math.inf,
    -math.inf,
]


def test_it_is_what_python_writes():
    ffi = cffi.FFI()
    ffi.cdef("void decimal_write(char *to, double value);")
    lib = load(ffi, {"library.c": SOURCE.format(header=HEADER), HEADER: headers()[HEADER]})
    random, text = np.random.default_rng(17), ffi.new("char[]", 26)
    bits = [struct.unpack("<d", random.bytes(8))[0] for _ in range(3000)]
    # Ties among them
    sums = (random.integers(-(10**6), 10**6, 3000) / 2.0 ** random.integers(0, 24, 3000)).tolist()
    for value in [*EDGES, *bits, *sums, *random.normal(0, 3, 3000).tolist()]:
        lib.decimal_write(text, value)
        assert ffi.string(text).decode() == f"{value + 0.0:.17g}"
    for zero, shown in ((0.0, "0"), (-0.0, "0"), (math.nan, "nan"), (-math.nan, "nan")):
        lib.decimal_write(text, zero)
        assert ffi.string(text).decode() == shown

"""Designs: samples in the unit cube. Sample k is a pure function of the seed, k and the number of samples:
any part can be computed at any time, and nothing grows with their number.
"""

import warnings

import numpy as np
from scipy.stats import qmc

WORDS = 4  # 64-bit numbers per step of the counter
ROUNDS = 8
SOBOL_BITS = 30


def points(design: str, seed: int, samples: int, dimensions: int, first: int, count: int) -> np.ndarray:
    """Return samples first to first + count - 1 of `samples` in the open unit cube, (count, dimensions)."""
    if not dimensions:
        return np.empty((count, 0))
    if design == "sobol":
        return _sobol(seed, dimensions, first, count)
    if design == "latin":
        return _latin(seed, samples, dimensions, first, count)
    return _random(seed, dimensions, first, count)


def _random(seed: int, dimensions: int, first: int, count: int) -> np.ndarray:
    """Independent numbers by a counter: each sample has its own range of it."""
    steps = -(-dimensions // WORDS)
    words = np.random.Philox(key=seed).advance(first * steps).random_raw(count * steps * WORDS)
    return ((words >> np.uint64(12)) + 0.5).reshape(count, -1)[:, :dimensions] / 2.0**52


def _sobol(seed: int, dimensions: int, first: int, count: int) -> np.ndarray:
    """Sobol's sequence, scrambled."""
    sequence = qmc.Sobol(dimensions, bits=SOBOL_BITS, seed=np.random.default_rng(seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about powers of 2, see docs/sweep.md
        if first:
            sequence.fast_forward(first)
        return sequence.random(count) + 0.5 / 2.0**SOBOL_BITS


def _latin(seed: int, samples: int, dimensions: int, first: int, count: int) -> np.ndarray:
    """A Latin hypercube: in each dimension one sample in each of `samples` equal parts, anywhere in it."""
    k = np.arange(first, first + count, dtype=np.uint64)
    parts = [_shuffled(k, samples, 2**64 + seed * 65536 + column) for column in range(dimensions)]
    inside = (np.column_stack(parts) + _random(seed, dimensions, first, count)) / samples
    return np.minimum(inside, np.nextafter(1.0, 0.0))  # if it was rounded to 1


def _shuffled(k: np.ndarray, samples: int, key: int) -> np.ndarray:
    """Return the images of k under a permutation of 0 ... samples - 1 that the key determines.

    A Feistel network permutes the next larger power of 4; values outside are permuted again.
    """
    half = np.uint64(max(1, ((samples - 1).bit_length() + 1) // 2))
    mask = (np.uint64(1) << half) - np.uint64(1)
    keys = np.random.Philox(key=key).random_raw(ROUNDS)
    found, outside = k.copy(), np.ones(len(k), bool)
    while outside.any():
        left, right = found[outside] >> half, found[outside] & mask
        for round_key in keys:
            left, right = right, left ^ (_mixed(right ^ round_key) & mask)
        found[outside] = left << half | right
        outside = found >= samples
    return found


def _mixed(word: np.ndarray) -> np.ndarray:
    """Mix the bits of 64-bit words (the finalizer of MurmurHash3)."""
    for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):
        word = (word ^ word >> np.uint64(33)) * np.uint64(factor)
    return word ^ word >> np.uint64(33)

"""Random numbers of the radio: each is a function of its key and does not depend on anything else."""

from __future__ import annotations

import numpy as np

from cosim.kernel import kernel

__all__ = [
    "BACKOFF",
    "BURST",
    "DUPLICATE",
    "DUPLICATE_JITTER",
    "ERROR",
    "FADING",
    "IN_BURST",
    "JITTER",
    "LOSS",
    "SHADOW",
    "SLOT",
    "chance",
    "exponential",
    "normal",
]

LOSS, JITTER = 0, 1
BURST, IN_BURST, FADING, SHADOW, DUPLICATE, DUPLICATE_JITTER, SLOT, BACKOFF, ERROR = 16, 17, 18, 19, 21, 22, 23, 24, 64
"""The last part of a key: the purpose of a random number. SHADOW uses two keys, ERROR all that follow."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


@kernel
def _mix(x: np.uint64) -> np.uint64:
    """Returns the finaliser of splitmix64 (Steele, Lea, Flood 2014), a bijection that spreads every bit."""
    x = (x ^ (x >> np.uint64(30))) * _MIX1
    x = (x ^ (x >> np.uint64(27))) * _MIX2
    return x ^ (x >> np.uint64(31))


@kernel
def chance(seed: np.uint64, source: np.uint64, sink: np.uint64, number: int, which: int) -> float:
    """Returns a number in [0, 1) that depends only on its arguments."""
    x = _mix(seed + _GOLDEN)
    x = _mix(x ^ source)
    x = _mix((x + _GOLDEN) ^ sink)
    x = _mix((x + _GOLDEN) ^ np.uint64(number))
    x = _mix((x + _GOLDEN) ^ np.uint64(which))
    return float(np.float64(np.int64(x >> np.uint64(11))) * 2.0**-53)


@kernel
def exponential(seed: np.uint64, source: np.uint64, sink: np.uint64, number: int, which: int) -> float:
    """Returns an exponentially distributed number with mean 1."""
    return float(-np.log(1.0 - chance(seed, source, sink, number, which)))


@kernel
def normal(seed: np.uint64, source: np.uint64, sink: np.uint64, number: int, which: int) -> float:
    """Returns a standard normally distributed number (Box, Muller 1958); uses `which` and `which` + 1."""
    radius = np.sqrt(2.0 * exponential(seed, source, sink, number, which))
    return float(radius * np.cos(2.0 * np.pi * chance(seed, source, sink, number, which + 1)))

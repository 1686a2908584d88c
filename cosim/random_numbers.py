"""Random numbers by counter: a number depends only on key and counter, not on earlier calls.

Threefry-2x32 with 20 rounds, in integers that never overflow, so that interpreted and compiled kernels agree to the
bit.

Source: J. K. Salmon, M. A. Moraes, R. O. Dror and D. E. Shaw, Parallel random numbers: as easy as 1, 2, 3, SC11.
"""

from __future__ import annotations

import math

import numpy as np

from cosim.kernel import kernel

__all__ = ["normal_pair", "threefry"]

_MASK = 0xFFFFFFFF
_PARITY = 0x1BD11BDA
_ROUNDS = 20
_ROTATIONS = np.array((13, 15, 26, 6, 17, 29, 16, 24), dtype=np.int64)
_UNIT = 1.0 / 4294967296.0


@kernel
def threefry(key0: int, key1: int, counter0: int, counter1: int) -> tuple[int, int]:
    """Returns two random 32-bit words for a key and a counter of two 32-bit words each."""
    # Through int64, because integers from a record are signed 32-bit.
    a0, a1 = np.int64(key0) & _MASK, np.int64(key1) & _MASK
    a2 = _PARITY ^ a0 ^ a1
    x, y = (np.int64(counter0) + a0) & _MASK, (np.int64(counter1) + a1) & _MASK
    for i in range(_ROUNDS):
        turn = int(_ROTATIONS[i % 8])
        x = (x + y) & _MASK
        y = (((y << turn) & _MASK) | (y >> (32 - turn))) ^ x
        if i % 4 == 3:
            group = i // 4 + 1
            first = a0 if group % 3 == 0 else a1 if group % 3 == 1 else a2
            second = a1 if group % 3 == 0 else a2 if group % 3 == 1 else a0
            x = (x + first) & _MASK
            y = (y + second + group) & _MASK
    return int(x), int(y)


@kernel
def normal_pair(key0: int, key1: int, counter0: int, counter1: int) -> tuple[float, float]:
    """Returns two independent standard normal numbers (Box-Muller transform)."""
    x, y = threefry(key0, key1, counter0, counter1)
    radius = math.sqrt(-2.0 * math.log((x + 0.5) * _UNIT))
    angle = 2.0 * math.pi * (y + 0.5) * _UNIT
    return radius * math.cos(angle), radius * math.sin(angle)

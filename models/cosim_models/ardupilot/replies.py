"""The text of a reply to ArduPilot, written by a kernel: the time and the true motion as one line of JSON.

ArduPilot's parser searches for each name and reads the numbers that follow at once, so the text contains no spaces.

Source: ArduPilot, libraries/SITL/SIM_JSON and examples/JSON/readme.md.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel

__all__ = ["MOTION", "REPLY_SIZE", "put_number", "put_reply"]

MOTION = ("angular_velocity", "specific_force", "position", "attitude", "velocity")
"""The parts of the motion in the order of a reply."""
_SHAPE = (
    ('\n{"timestamp":', 1, ""),
    (',"imu":{"gyro":[', 3, "]"),
    (',"accel_body":[', 3, "]}"),
    (',"position":[', 3, "]"),
    (',"quaternion":[', 4, "]"),
    (',"velocity":[', 3, "]}\n"),
)
_STRETCH = 1.0 + 1e-8
"""ArduPilot adds the differences of timestamps in whole microseconds and truncates them: a step that rounding makes
slightly too short would lose a microsecond, and the clock 0.2 ms per second."""
_LEAST, _MOST = 16 - 309, 16 + 325
_LIMB = (1 << 31) - 1
_LOG = 1292913986
"""log10(2) times 2**32."""


def _texts() -> list[bytes]:
    """Returns the texts before each number of a reply, and the text behind the last."""
    texts, behind = [], ""
    for before, count, after in _SHAPE:
        texts += [(behind + before).encode(), *[b","] * (count - 1)]
        behind = after
    return [*texts, behind.encode()]


def _powers() -> NDArray[np.int64]:
    """Returns rows (upper 31 bits, lower 31 bits, e): 10**k is these 62 bits, rounded, times 2**e; k from _LEAST."""
    rows = []
    for k in range(_LEAST, _MOST + 1):
        power = Fraction(10) ** k
        e = power.numerator.bit_length() - power.denominator.bit_length() - 62
        if power / Fraction(2) ** e >= 1 << 62:
            e += 1
        bits = round(power / Fraction(2) ** e)
        rows.append((bits >> 31, bits & _LIMB, e))
    return np.array(rows, np.int64)


_POWERS = _powers()
_TEXT = np.frombuffer(b"".join(_texts()), np.uint8).copy()
_ENDS = np.cumsum([len(text) for text in _texts()])
_NAN = np.frombuffer(b"NaN", np.uint8).copy()
_INFINITY = np.frombuffer(b"Infinity", np.uint8).copy()
NUMBER_SIZE = 24
"""Longest number: a sign, 17 digits, a point, and an exponent of 5 characters."""
REPLY_SIZE = len(_TEXT) + NUMBER_SIZE * (len(_ENDS) - 1)
"""Longest reply in bytes."""


@kernel
def _copy(buffer: NDArray[np.uint8], p: int, text: NDArray[np.uint8], start: int, stop: int) -> int:
    for i in range(start, stop):
        buffer[p + i - start] = text[i]
    return p + stop - start


@kernel
def _significand(m: int, exponent: int) -> tuple[int, int]:
    """Returns 17 decimal digits n and an exponent d of m * 2**exponent: n * 10**(d - 16); m has 62 bits.

    The digits are wrong by less than 0.52 of the last place where their step is coarsest compared with that of a
    float (0.55 would do), so the float that is nearest to them is the one they stand for.
    """
    d = (exponent + 61) * _LOG >> 32
    while True:
        row = 16 - d - _LEAST
        high, low = _POWERS[row, 0], _POWERS[row, 1]
        a, b = m >> 31, m & _LIMB
        product = a * high + ((a * low + b * high + (b * low >> 31)) >> 31)
        shift = -(exponent + _POWERS[row, 2] + 62)
        n = (product + (1 << (shift - 1))) >> shift
        if n < 100_000_000_000_000_000:
            return int(n), int(d)
        d += 1


@kernel
def put_number(buffer: NDArray[np.uint8], p: int, x: float) -> int:
    """Writes a number at `p`, in digits from which the same float is read; returns the place behind it.

    Numbers are written as in 9.80665e0, without zeros at the end; infinity and NaN as JSON libraries write them.
    """
    if x != x:
        return _copy(buffer, p, _NAN, 0, _NAN.size)
    bits = int(np.float64(x).view(np.int64))
    if bits < 0:
        buffer[p] = 45  # "-"
        p += 1
        bits &= 0x7FFFFFFFFFFFFFFF
    exponent, m = bits >> 52, bits & 0xFFFFFFFFFFFFF
    if exponent == 0x7FF:
        return _copy(buffer, p, _INFINITY, 0, _INFINITY.size)
    if bits == 0:
        buffer[p] = 48  # "0"
        return p + 1
    if exponent == 0:
        exponent = 1
    else:
        m |= 0x10000000000000
    while m < 1 << 61:
        m <<= 1
        exponent -= 1
    n, d = _significand(m, exponent - 1075)
    digits = 17
    while n % 10 == 0:
        n //= 10
        digits -= 1
    for i in range(digits - 1, 0, -1):
        buffer[p + 1 + i] = 48 + n % 10
        n //= 10
    buffer[p] = 48 + n
    p += 1
    if digits > 1:
        buffer[p] = 46  # "."
        p += digits
    return _put_exponent(buffer, p, d)


@kernel
def _put_exponent(buffer: NDArray[np.uint8], p: int, d: int) -> int:
    if d == 0:
        return p
    buffer[p] = 101  # "e"
    p += 1
    if d < 0:
        buffer[p] = 45
        p += 1
        d = -d
    size = 1 if d < 10 else 2 if d < 100 else 3
    for i in range(size - 1, -1, -1):
        buffer[p + i] = 48 + d % 10
        d //= 10
    return p + size


@kernel
def put_reply(buffer: NDArray[np.uint8], t: float, record: NDArray[np.float64], places: NDArray[np.int64]) -> int:
    """Writes a reply into `buffer`, of REPLY_SIZE bytes or more; returns its length.

    Args:
        t: time in s, above 0.
        record: numbers, among them the motion.
        places: indices of 16 numbers in `record`, in the order of MOTION: angular velocity [rad/s] and specific force
            [m/s2], FRD; position [m], NED from home; unit quaternion w, x, y, z that rotates FRD into NED; velocity
            [m/s], NED.
    """
    p = _copy(buffer, 0, _TEXT, 0, _ENDS[0])
    p = put_number(buffer, p, t * _STRETCH)
    for i in range(places.size):
        p = _copy(buffer, p, _TEXT, _ENDS[i], _ENDS[i + 1])
        p = put_number(buffer, p, record[places[i]])
    return _copy(buffer, p, _TEXT, _ENDS[places.size], _TEXT.size)

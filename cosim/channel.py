"""The API of an own effect of the radio: a Python file that the `channel` of a system's network names.

It contains one function, which decides whether and when a packet arrives at one receiver:

    from cosim.channel import LOST, Packet, chance

    def channel(packet: Packet) -> float:
        return packet.delay if chance(packet, 0) < 0.9 else LOST

The function has no memory: its result depends on the packet only, so that a run repeats bit by bit, whatever the order
of packets, and resumes from any checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from cosim.kernel import kernel
from cosim.random_numbers import threefry

__all__ = ["LONGEST_DELAY", "LOST", "PACKET", "Packet", "chance", "normal"]

LOST = -1.0
"""The result of a channel for a packet that does not arrive."""

LONGEST_DELAY = 3600.0
"""A packet with a longer delay, in s, is lost."""

PACKET = np.dtype(
    [
        ("time", "f8"),
        ("delay", "f8"),
        ("distance", "f8"),
        ("sender", "f8", (3,)),
        ("receiver", "f8", (3,)),
        ("length", "i8"),
        ("message", "i8"),
        ("system", "i8"),
        ("number", "i8"),
        ("key", "u8", (3,)),  # seed, sender and receiver
    ]
)
"""The record that a channel receives; `Packet` describes its fields."""


class Packet(Protocol):
    """A packet on its way to one receiver.

    Attributes:
        time: when it was sent, s of the run.
        delay: by latency and jitter of the network, or by its trace, s.
        distance: between sender and receiver, m.
        sender, receiver: positions (north, east, down), m.
        length: bytes.
        message: id of the MAVLink message.
        system: id of the system that sent it.
        number: of this packet at its sender, from 0.
    """

    time: float
    delay: float
    distance: float
    sender: Sequence[float]
    receiver: Sequence[float]
    length: int
    message: int
    system: int
    number: int


@kernel
def _low(word: np.uint64) -> int:
    return int(np.int64(word & np.uint64(0xFFFFFFFF)))


@kernel
def _high(word: np.uint64) -> int:
    return int(np.int64(word >> np.uint64(32)))


@kernel
def _words(packet: Any, which: int) -> tuple[int, int]:
    """Returns two random 32-bit words for seed, sender, receiver and number of a packet, and a number `which`."""
    a, b = threefry(_low(packet.key[0]), _high(packet.key[0]), _low(packet.key[1]), _high(packet.key[1]))
    a, b = threefry(a, b, _low(packet.key[2]), _high(packet.key[2]))
    return threefry(a, b, packet.number, which)


@kernel
def chance(packet: Any, which: int) -> float:
    """Returns a random number in [0, 1) for a packet and its receiver; another `which` gives an independent one."""
    x, y = _words(packet, which)
    return float((x * 2097152.0 + float(y >> 11)) * 2.0**-53)


@kernel
def normal(packet: Any, which: int) -> float:
    """Returns a standard normal random number for a packet and its receiver (Box, Muller 1958), as `chance`."""
    x, y = _words(packet, which)
    radius = math.sqrt(-2.0 * math.log((x + 0.5) / 4294967296.0))
    return float(radius * math.cos(2.0 * math.pi * (y + 0.5) / 4294967296.0))

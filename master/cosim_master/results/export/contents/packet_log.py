"""Reads and writes .tlog files: 8-byte big-endian microseconds, and one MAVLink packet."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from cosim.packets import payload_length, payload_start, x25

__all__ = ["Packet", "packets_of", "renumbered"]

_SIGNED, _SIGNATURE = 1, 13


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet of a log.

    Attributes:
        stamp: us since 1970.
        data: the complete packet.
    """

    stamp: int
    data: bytes

    @property
    def is_v2(self) -> bool:
        return self.data[0] == 0xFD

    @property
    def address(self) -> tuple[int, int]:
        """System and component of the sender."""
        at = 5 if self.is_v2 else 3
        return self.data[at], self.data[at + 1]

    @property
    def message(self) -> int:
        return int.from_bytes(self.data[7:10], "little") if self.is_v2 else self.data[5]

    @property
    def payload(self) -> bytes:
        begin = 10 if self.is_v2 else 6
        return self.data[begin : begin + self.data[1]]


def packets_of(log: bytes) -> Iterator[Packet]:
    """Returns the packets of a log; an incomplete packet at the end (of a run that was killed) is left out."""
    at = 0
    while at + 17 <= len(log):
        (stamp,) = struct.unpack_from(">Q", log, at)
        at += 8
        length = log[at + 1] + (12 if log[at] == 0xFD else 8)
        if log[at] == 0xFD and log[at + 2] & _SIGNED:
            length += _SIGNATURE
        if at + length <= len(log):
            yield Packet(stamp, log[at : at + length])
        at += length


def renumbered(packet: bytes, sequence: int) -> bytes:
    """Returns a packet with another sequence number and its CRC. A signature, which would be wrong, is removed."""
    buffer = np.frombuffer(packet, np.uint8)
    end = int(payload_start(buffer, 0) + payload_length(buffer, 0))
    changed = bytearray(packet[:end])
    extra = _crc_extra(_crc(bytes(changed[1:])), int.from_bytes(packet[end : end + 2], "little"))
    if packet[0] == 0xFD:
        changed[2] &= ~_SIGNED
        changed[4] = sequence % 256
    else:
        changed[2] = sequence % 256
    return bytes(changed) + _step(_crc(bytes(changed[1:])), extra).to_bytes(2, "little")


def _crc(block: bytes) -> int:
    return int(x25(np.frombuffer(block, np.uint8), 0, len(block)))


@cache
def _table() -> tuple[int, ...]:
    """Returns the effect of the low byte of a CRC on the high one."""
    return tuple(_crc(bytes([low ^ 0xFF])) ^ 0xFF for low in range(256))


def _step(crc: int, byte: int) -> int:
    return crc >> 8 ^ _table()[(crc ^ byte) & 0xFF]


def _crc_extra(before: int, after: int) -> int:
    """Returns the CRC_EXTRA of a message by its CRC without and with it: packets of any dialect can be renumbered."""
    return _table().index(after ^ before >> 8) ^ before & 0xFF

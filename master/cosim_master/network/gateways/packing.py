"""MAVLink packets as bytes, in Python: for the few that the master itself sends or reads."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from cosim.dialect import CRC_EXTRA, MESSAGE_IDS

__all__ = ["Packet", "mavlink2", "opened"]

_MAVLINK2 = 0xFD


@dataclass(frozen=True, slots=True)
class Packet:
    """The parts of a packet: message id, sender, and payload with zeros up to 255 bytes."""

    message: int
    system: int
    component: int
    payload: bytes


def opened(packet: bytes) -> Packet:
    """Returns the parts of a complete packet of MAVLink 1 or 2."""
    if packet[0] == _MAVLINK2:
        number, sender, first = int.from_bytes(packet[7:10], "little"), packet[5:7], 10
    else:
        number, sender, first = packet[5], packet[3:5], 6
    return Packet(number, sender[0], sender[1], packet[first : first + packet[1]].ljust(255, b"\0"))


def mavlink2(sequence: int, system: int, component: int, number: int, payload: bytes) -> bytes:
    """Returns a packet (MAVLink 2).

    Args:
        sequence: number of the packet.
        system, component: ids of the sender.
        number: of the message.
        payload: its fields; zeros at the end are left out.
    """
    payload = payload[:1] + payload[1:].rstrip(b"\0")
    head = struct.pack("<7B", len(payload), 0, 0, sequence, system, component, number & 0xFF)
    body = head + (number >> 8).to_bytes(2, "little") + payload
    extra = int(CRC_EXTRA[number == MESSAGE_IDS][0])
    return b"\xfd" + body + _crc(body + bytes([extra])).to_bytes(2, "little")


def _row(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ 0x8408 if byte & 1 else byte >> 1
    return byte


_TABLE = tuple(_row(byte) for byte in range(256))


def _crc(data: bytes) -> int:
    """Returns MAVLink's checksum, CRC-16/MCRF4XX."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc

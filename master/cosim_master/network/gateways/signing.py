"""MAVLink 2 signing at a gateway: outgoing packets are signed, and incoming packets must be signed, with the same key.

Inside the simulated network packets are not signed; an accepted signature stays on its packet.

Source: the MAVLink guide, "Message Signing".
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from cosim.packets import packet_length, payload_length, payload_start, signed, version, x25

__all__ = ["REFUSALS", "Signing", "read_key"]

REFUSALS = ("unsigned", "bad signature", "replayed")
"""Reasons for dropping a packet."""

_EPOCH = 1_420_070_400
"""2015-01-01T00:00:00Z in seconds from 1970; timestamps count 10 us from there."""
_TICK = 1e-5
_OLDEST = 6_000_000
"""Largest age of the first packet of a stream relative to the newest packet of all streams: one minute."""


def read_key(path: Path) -> bytes:
    """Returns the secret key in a file: 32 bytes, or 64 hexadecimal digits.

    Raises:
        ValueError: the file contains neither.
        OSError: the file cannot be read.
    """
    content = path.read_bytes()
    if len(content) == 32:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != 32:
        raise ValueError(f"{path} holds no key: 32 bytes or 64 hexadecimal digits are valid")
    return key


class Signing:
    """The key and the timestamps of one gateway.

    Args:
        key: 32 bytes, shared with the program at the other end.
        clock: returns the seconds since 1970.
    """

    def __init__(self, key: bytes, clock: Callable[[], float] = time.time) -> None:
        self._key = key
        self._clock = clock
        self._newest = self._present()
        self._sent = 0
        self._streams: dict[bytes, int] = {}

    def _present(self) -> int:
        return int((self._clock() - _EPOCH) / _TICK)

    def refusal(self, packet: bytes) -> str:
        """Returns the reason, one of `REFUSALS`, to drop a complete packet; "" if it is genuine and new."""
        if not signed(np.frombuffer(packet, np.uint8), 0):
            return "unsigned"
        digest = hashlib.sha256(self._key + packet[:-6]).digest()[:6]
        if not hmac.compare_digest(digest, packet[-6:]):
            return "bad signature"
        timestamp = int.from_bytes(packet[-12:-6], "little")
        stream = packet[-13:-12] + packet[5:7]  # link, system, component
        if timestamp <= self._streams.get(stream, self._newest - _OLDEST):
            return "replayed"
        self._streams[stream] = timestamp
        self._newest = max(self._newest, timestamp)
        return ""

    def sign(self, packet: bytes) -> bytes:
        """Returns a packet as MAVLink 2, with our signature in place of an existing one."""
        buffer = np.frombuffer(packet, np.uint8)
        first = payload_start(buffer, 0)
        payload = packet[first : first + payload_length(buffer, 0)]
        address = packet[2:5] if version(buffer, 0) == 1 else packet[4:7]
        message = packet[5:6] + b"\0\0" if version(buffer, 0) == 1 else packet[7:10]
        body = bytes((len(payload), 1, 0)) + address + message + payload
        crc = _step(_crc(body), _crc_extra(packet[: packet_length(buffer, 0)], first + len(payload)))
        self._sent = max(self._sent + 1, self._present())
        unsealed = b"\xfd" + body + crc.to_bytes(2, "little") + b"\0" + self._sent.to_bytes(6, "little")
        return unsealed + hashlib.sha256(self._key + unsealed).digest()[:6]


def _crc(block: bytes) -> int:
    return int(x25(np.frombuffer(block, np.uint8), 0, len(block)))


@cache
def _table() -> tuple[int, ...]:
    """Returns the effect of the low byte of a CRC on the high one."""
    return tuple(_crc(bytes([low ^ 0xFF])) ^ 0xFF for low in range(256))


def _step(crc: int, byte: int) -> int:
    return crc >> 8 ^ _table()[(crc ^ byte) & 0xFF]


def _crc_extra(packet: bytes, crc_at: int) -> int:
    """Returns the CRC_EXTRA of a packet's message, derived from its CRC; messages of any dialect can thus be signed."""
    before = _crc(packet[1:crc_at])
    after = int.from_bytes(packet[crc_at : crc_at + 2], "little")
    return _table().index(after ^ before >> 8) ^ before & 0xFF

"""MAVLink packets as mavros_msgs/Mavlink, and back. Source: mavros_msgs/msg/Mavlink.msg and mavlink_convert.h."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["KIND", "fields_of", "packet_of"]

KIND = "mavros_msgs/msg/Mavlink"

_V1, _V2 = 0xFE, 0xFD
_FRAMING_OK = 1
_SIGNED, _SIGNATURE = 1, 13


def fields_of(packet: bytes) -> dict[str, Any]:
    """Returns the fields of the message for a complete packet, without its header.

    The payload is in words of 64 bits, little-endian; the last one is filled with zeros.
    """
    length, signed = packet[1], False
    if packet[0] == _V2:
        _, _, incompat, compat, seq, sysid, compid = packet[:7]
        msgid, begin = int.from_bytes(packet[7:10], "little"), 10
        signed = bool(incompat & _SIGNED)
    else:
        _, _, seq, sysid, compid, msgid = packet[:6]
        incompat, compat, begin = 0, 0, 6
    end = begin + length
    payload = packet[begin:end]
    payload += bytes(-len(payload) % 8)
    signature = packet[end + 2 : end + 2 + _SIGNATURE] if signed else b""
    return {
        "framing_status": _FRAMING_OK,
        "magic": packet[0],
        "len": length,
        "incompat_flags": incompat,
        "compat_flags": compat,
        "seq": seq,
        "sysid": sysid,
        "compid": compid,
        "msgid": msgid,
        "checksum": int.from_bytes(packet[end : end + 2], "little"),
        "payload64": np.frombuffer(payload, "<u8"),
        "signature": np.frombuffer(signature, np.uint8),
    }


def packet_of(message: Any) -> bytes:
    """Returns the packet in a message.

    Raises:
        ValueError: its fields do not make a packet.
    """
    payload = np.asarray(message.payload64, "<u8").tobytes()
    signature = np.asarray(message.signature, np.uint8).tobytes()
    if message.framing_status != _FRAMING_OK or message.magic not in (_V1, _V2):
        raise ValueError(f"framing_status {message.framing_status} with magic {message.magic} is no valid packet")
    if len(payload) < message.len:
        raise ValueError(f"payload64 has {len(payload)} bytes, fewer than len, {message.len}")
    ids = bytes((message.seq, message.sysid, message.compid))
    if message.magic == _V1:
        if message.msgid > 255:
            raise ValueError(f"message {message.msgid} has no packet of MAVLink 1")
        head, signature = bytes((_V1, message.len)) + ids + bytes((message.msgid,)), b""
    else:
        flags = bytes((message.incompat_flags, message.compat_flags))
        head = bytes((_V2, message.len)) + flags + ids + (message.msgid & 0xFFFFFF).to_bytes(3, "little")
        signed = bool(message.incompat_flags & _SIGNED)
        if len(signature) != (_SIGNATURE if signed else 0):
            raise ValueError(f"the signature has {len(signature)} bytes, not {_SIGNATURE if signed else 0}")
    return head + payload[: message.len] + int(message.checksum).to_bytes(2, "little") + signature

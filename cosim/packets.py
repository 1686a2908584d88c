"""MAVLink 1 and 2 packets in byte buffers: find, read, write and address them; base64 text for string ports.

A buffer is a one-dimensional uint8 array and the number of bytes in use; a packet is identified by the index of its
first byte. Every function is a kernel: it neither allocates memory nor raises exceptions, and the same source runs
interpreted and compiled. `cosim.messages` defines the fields of messages and builds payloads; this module wraps
payloads in packets.

Receiving::

    p = 0
    while True:
        start, p, status = find(buffer, p, n)
        if status in (NOTHING, TRUNCATED):
            break
        if status in (GOOD, SIGNED) and message_id(buffer, start) == GLOBAL_POSITION_INT:
            unpack(buffer, start, payload)

Sending: `n = pack(buffer, n, payload, ...)` appends one packet. Check the result for -1 before assigning it to n.

The module covers one format completely: its header, its checks, its numbers and the dialect depend on each other.

Not here: signatures are recognised but neither created nor verified (a receiver without a key accepts signed packets,
as ArduPilot and pymavlink do). Sequence counters belong to the sender, which passes them in.

Sources: the MAVLink guide, "Packet Serialization" and "Message Signing"; RFC 4648 section 4 (base64).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.dialect import CRC_EXTRA, FULL_LENGTH, MESSAGE_IDS, MINIMUM_LENGTH, TARGET_COMPONENT, TARGET_SYSTEM
from cosim.kernel import kernel

__all__ = [
    "BAD_CRC",
    "GOOD",
    "INCOMPATIBLE",
    "MAX_PACKET",
    "MAX_PAYLOAD",
    "NOTHING",
    "SIGNED",
    "TRUNCATED",
    "UNKNOWN",
    "Bytes",
    "clear",
    "component",
    "copy",
    "decode_base64",
    "definition",
    "encode_base64",
    "equal_text",
    "find",
    "get_f32",
    "get_f64",
    "get_i8",
    "get_i16",
    "get_i32",
    "get_i64",
    "get_u8",
    "get_u16",
    "get_u32",
    "get_u64",
    "has_crc",
    "message_id",
    "pack",
    "pack_defined",
    "packet_length",
    "payload_length",
    "payload_start",
    "put_f32",
    "put_f64",
    "put_i8",
    "put_i16",
    "put_i32",
    "put_i64",
    "put_text",
    "put_u8",
    "put_u16",
    "put_u32",
    "put_u64",
    "sequence",
    "signed",
    "system",
    "target",
    "unpack",
    "version",
    "x25",
]

Bytes = NDArray[np.uint8]
"""A one-dimensional array of bytes: a buffer of packets, or one payload."""

MAX_PAYLOAD = 255
"""Maximum payload length in bytes, and the size of every payload buffer."""
MAX_PACKET = 280
"""Maximum packet length in bytes: MAVLink 2 header, longest payload, CRC and signature."""

NOTHING = 0
"""Status of `find`: no packet begins in the rest of the buffer."""
GOOD = 1
"""Status of `find`: a complete packet with a correct CRC."""
SIGNED = 2
"""Status of `find`: a complete packet with a correct CRC and an unverified signature."""
UNKNOWN = 3
"""Status of `find`: a complete packet whose message is not in the dialect. Its CRC cannot be checked; routers forward
it."""
BAD_CRC = 4
"""Status of `find`: a packet of the length in its header, but with a wrong CRC; drop it."""
INCOMPATIBLE = 5
"""Status of `find`: MAVLink 2 with an incompatibility flag other than "signed"; the standard requires dropping it."""
TRUNCATED = 6
"""Status of `find`: a packet begins, but the buffer ends before the packet does."""

_MAGIC_V1 = 0xFE
_MAGIC_V2 = 0xFD
_HEADER_V1 = 6
_HEADER_V2 = 10
_CRC = 2
_SIGNATURE = 13
_FLAG_SIGNED = 0x01
_EQUALS = 61  # "="
_ONE, _TWO, _THREE, _FOUR = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(4)


def _x25_table() -> NDArray[np.uint16]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (0x8408 if value & 1 else 0)
        table.append(value)
    return np.array(table, np.uint16)


def _base64_values(alphabet: bytes) -> NDArray[np.int8]:
    values = np.full(256, -1, np.int8)
    for value, character in enumerate(alphabet):
        values[character] = value
    return values


def _rows_of_bytes() -> NDArray[np.int16]:
    """Returns the rows of the messages whose ids are at most 255; -1: no message has this id."""
    rows = np.full(256, -1, np.int16)
    for row, message in enumerate(MESSAGE_IDS):
        if message < rows.size:
            rows[message] = row
    return rows


def _with_zero_bytes(table: NDArray[np.uint16], number: int) -> NDArray[np.uint16]:
    """Returns the CRC of each byte that is followed by this number of zero bytes."""
    following = table
    for _ in range(number):
        following = (following >> 8) ^ table[following & 0xFF]
    return following.astype(np.uint16)


_X25 = _x25_table()
_X25_1, _X25_2, _X25_3 = (_with_zero_bytes(_X25, number) for number in (1, 2, 3))
_ALPHABET = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
_BASE64 = np.frombuffer(_ALPHABET, np.uint8).copy()
_BASE64_VALUES = _base64_values(_ALPHABET)
_ROWS_OF_BYTES = _rows_of_bytes()


# -- numbers in a payload, little-endian ----------------------------------------------------------------------------


@kernel
def get_u8(payload: Bytes, offset: int) -> int:
    """Returns the uint8 at `offset`."""
    # Through int64: numba types an operation on two unsigned operands as uint64, and uint64 with int64 as float64.
    return int(np.int64(payload[offset]))


@kernel
def get_u16(payload: Bytes, offset: int) -> int:
    """Returns the uint16 at `offset`."""
    return int(np.int64(payload[offset]) | np.int64(payload[offset + 1]) << 8)


@kernel
def get_u32(payload: Bytes, offset: int) -> int:
    """Returns the uint32 at `offset`."""
    return get_u16(payload, offset) | get_u16(payload, offset + 2) << 16


@kernel
def get_i8(payload: Bytes, offset: int) -> int:
    """Returns the int8 at `offset`."""
    value = get_u8(payload, offset)
    return value - ((value & 0x80) << 1)


@kernel
def get_i16(payload: Bytes, offset: int) -> int:
    """Returns the int16 at `offset`."""
    value = get_u16(payload, offset)
    return value - ((value & 0x8000) << 1)


@kernel
def get_i32(payload: Bytes, offset: int) -> int:
    """Returns the int32 at `offset`."""
    value = get_u32(payload, offset)
    return value - ((value & 0x80000000) << 1)


@kernel
def get_i64(payload: Bytes, offset: int) -> int:
    """Returns the int64 at `offset`."""
    return get_i32(payload, offset + 4) << 32 | get_u32(payload, offset)


@kernel
def get_u64(payload: Bytes, offset: int) -> int:
    """Returns the uint64 at `offset` as an int64: values of 2**63 and above are returned 2**64 lower."""
    return get_i64(payload, offset)


@kernel
def get_f32(payload: Bytes, offset: int) -> float:
    """Returns the float32 at `offset` as a float64."""
    return float(np.float64(np.int32(get_i32(payload, offset)).view(np.float32)))


@kernel
def get_f64(payload: Bytes, offset: int) -> float:
    """Returns the float64 at `offset`."""
    return float(np.int64(get_i64(payload, offset)).view(np.float64))


@kernel
def put_u8(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as a uint8; like every integer writer, it truncates higher bits."""
    payload[offset] = int(np.int64(value)) & 0xFF


@kernel
def put_u16(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as a uint16."""
    bits = int(np.int64(value))
    payload[offset] = bits & 0xFF
    payload[offset + 1] = bits >> 8 & 0xFF


@kernel
def put_u32(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as a uint32."""
    bits = int(np.int64(value))
    for i in range(4):
        payload[offset + i] = bits >> 8 * i & 0xFF


@kernel
def put_u64(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as a uint64; pass values of 2**63 and above 2**64 lower, as `get_u64` returns them."""
    bits = int(np.int64(value))
    for i in range(8):
        payload[offset + i] = bits >> 8 * i & 0xFF


@kernel
def put_i8(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as an int8."""
    put_u8(payload, offset, value)


@kernel
def put_i16(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as an int16."""
    put_u16(payload, offset, value)


@kernel
def put_i32(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as an int32."""
    put_u32(payload, offset, value)


@kernel
def put_i64(payload: Bytes, offset: int, value: int) -> None:
    """Writes `value` at `offset` as an int64."""
    put_u64(payload, offset, value)


@kernel
def put_f32(payload: Bytes, offset: int, value: float) -> None:
    """Writes `value` at `offset` as a float32, rounded to nearest."""
    put_u32(payload, offset, int(np.float32(value).view(np.int32)))


@kernel
def put_f64(payload: Bytes, offset: int, value: float) -> None:
    """Writes `value` at `offset` as a float64."""
    put_u64(payload, offset, int(np.float64(value).view(np.int64)))


@kernel
def put_text(payload: Bytes, offset: int, size: int, text: Bytes) -> None:
    """Fills the char[size] field at `offset` with `text`, truncated or padded with zeros, MAVLink's end of text."""
    for i in range(size):
        payload[offset + i] = text[i] if i < text.shape[0] else 0


@kernel
def equal_text(payload: Bytes, offset: int, size: int, text: Bytes) -> bool:
    """Returns whether the char[size] field at `offset` equals `text`; bytes after the first zero are ignored."""
    for i in range(size):
        wanted = get_u8(text, i) if i < text.shape[0] else 0
        if get_u8(payload, offset + i) != wanted:
            return False
        if wanted == 0:
            return True
    return text.shape[0] <= size or get_u8(text, size) == 0


@kernel
def copy(source: Bytes, start: int, stop: int, destination: Bytes, at: int) -> None:
    """Copies source[start:stop] to `destination` from index `at` on. No index may be negative."""
    begin, to = np.uintp(start), np.uintp(at)  # a possibly negative index lets bytes be copied one by one
    for i in range(np.uintp(max(stop - start, 0))):
        destination[to + np.uintp(i)] = source[begin + np.uintp(i)]


@kernel
def clear(payload: Bytes, start: int, stop: int) -> None:
    """Sets payload[start:stop] to zero."""
    for i in range(start, stop):
        payload[i] = 0


# -- the dialect ----------------------------------------------------------------------------------------------------


@kernel
def _row(message: int) -> int:
    """Returns the row of a message id in the dialect's tables; -1: it is not in the dialect. Most ids are bytes."""
    if 0 <= message < _ROWS_OF_BYTES.shape[0]:
        return int(np.int64(_ROWS_OF_BYTES[message]))
    low = 0
    high = MESSAGE_IDS.shape[0]
    while low < high:
        middle = (low + high) // 2
        if MESSAGE_IDS[middle] < message:
            low = middle + 1
        else:
            high = middle
    if low < MESSAGE_IDS.shape[0] and MESSAGE_IDS[low] == message:
        return low
    return -1


@kernel
def definition(message: int) -> tuple[int, int, int, int, int]:
    """Returns the definition of a message id in the ardupilotmega dialect.

    Returns:
        (CRC_EXTRA, length without extensions, full length, offset of target_system, offset of target_component). An
        offset is -1 if the message lacks that field; all five are -1 if the message is not in the dialect.
    """
    row = _row(message)
    if row < 0:
        return -1, -1, -1, -1, -1
    return (
        int(np.int64(CRC_EXTRA[row])),
        int(np.int64(MINIMUM_LENGTH[row])),
        int(np.int64(FULL_LENGTH[row])),
        int(np.int64(TARGET_SYSTEM[row])),
        int(np.int64(TARGET_COMPONENT[row])),
    )


# -- headers --------------------------------------------------------------------------------------------------------


@kernel
def version(buffer: Bytes, start: int) -> int:
    """Returns the MAVLink version of the packet at `start`: 1 or 2."""
    return 1 if buffer[start] == _MAGIC_V1 else 2


@kernel
def payload_length(buffer: Bytes, start: int) -> int:
    """Returns the number of payload bytes on the wire of the packet at `start`."""
    return get_u8(buffer, start + 1)


@kernel
def payload_start(buffer: Bytes, start: int) -> int:
    """Returns the index of the first payload byte of the packet at `start`."""
    return start + (_HEADER_V1 if buffer[start] == _MAGIC_V1 else _HEADER_V2)


@kernel
def signed(buffer: Bytes, start: int) -> bool:
    """Returns whether the packet at `start` carries a signature."""
    return buffer[start] != _MAGIC_V1 and get_u8(buffer, start + 2) & _FLAG_SIGNED != 0


@kernel
def sequence(buffer: Bytes, start: int) -> int:
    """Returns the sequence number (0 to 255) of the packet at `start`."""
    return get_u8(buffer, start + (2 if buffer[start] == _MAGIC_V1 else 4))


@kernel
def system(buffer: Bytes, start: int) -> int:
    """Returns the sender's system id of the packet at `start`."""
    return get_u8(buffer, start + (3 if buffer[start] == _MAGIC_V1 else 5))


@kernel
def component(buffer: Bytes, start: int) -> int:
    """Returns the sender's component id of the packet at `start`."""
    return get_u8(buffer, start + (4 if buffer[start] == _MAGIC_V1 else 6))


@kernel
def message_id(buffer: Bytes, start: int) -> int:
    """Returns the message id of the packet at `start`."""
    if buffer[start] == _MAGIC_V1:
        return get_u8(buffer, start + 5)
    return get_u16(buffer, start + 7) | get_u8(buffer, start + 9) << 16


@kernel
def packet_length(buffer: Bytes, start: int) -> int:
    """Returns the total length in bytes of the packet at `start`, from its first three bytes."""
    length = payload_length(buffer, start) + _CRC
    if buffer[start] == _MAGIC_V1:
        return length + _HEADER_V1
    if signed(buffer, start):
        length += _SIGNATURE
    return length + _HEADER_V2


@kernel
def target(buffer: Bytes, start: int) -> tuple[int, int]:
    """Returns the target address (system, component) of the packet at `start`; 0 means all.

    Target fields omitted by MAVLink 2's truncation or by MAVLink 1 are zero. Messages without target fields, and
    unknown messages, are addressed to all.
    """
    _, _, _, system_offset, component_offset = definition(message_id(buffer, start))
    length = payload_length(buffer, start)
    payload = payload_start(buffer, start)
    to_system = 0
    to_component = 0
    if 0 <= system_offset < length:
        to_system = get_u8(buffer, payload + system_offset)
    if 0 <= component_offset < length:
        to_component = get_u8(buffer, payload + component_offset)
    return to_system, to_component


# -- packets --------------------------------------------------------------------------------------------------------


@kernel
def _x25_step(crc: int, byte: int) -> int:
    return crc >> 8 ^ int(np.int64(_X25[(crc ^ byte) & 0xFF]))


@kernel
def x25(buffer: Bytes, start: int, stop: int) -> int:
    """Returns the CRC-16/MCRF4XX of buffer[start:stop], MAVLink's checksum, before CRC_EXTRA is added.

    Four bytes at a time: each table's row has to wait for the CRC of the bytes before, which takes longer than the sum.
    """
    crc = 0xFFFF
    at = np.uintp(start)  # a possibly negative index costs a comparison at each use
    for _ in range((stop - start) >> 2):
        crc ^= int(np.int64(buffer[at]) | np.int64(buffer[at + _ONE]) << 8)
        crc = int(
            np.int64(_X25_3[np.uintp(crc & 0xFF)])
            ^ np.int64(_X25_2[np.uintp(crc >> 8)])
            ^ np.int64(_X25_1[buffer[at + _TWO]])
            ^ np.int64(_X25[buffer[at + _THREE]])
        )
        at += _FOUR
    for i in range(np.int64(at), stop):
        crc = _x25_step(crc, get_u8(buffer, i))
    return crc


@kernel
def find(buffer: Bytes, p: int, n: int) -> tuple[int, int, int]:
    """Finds the first packet that begins at or after index `p` of buffer[:n].

    Bytes before it (start - p of them) are garbage. Continue the search at `stop`. An unusable packet is skipped as a
    whole, by the length in its header, not byte by byte. Its payload may contain magic bytes, and a search inside it
    mostly finds an "unknown message", which routers would forward and which may swallow the good packets that follow.
    pymavlink's robust parsing does the same, so our receivers and standard ones count the same packets.

    Args:
        buffer: the bytes; bytes at index n or above are not read.
        p: index at which the search begins.
        n: number of bytes in use.

    Returns:
        (start, stop, status): the packet is buffer[start:stop], and status is GOOD, SIGNED, UNKNOWN, BAD_CRC or
        INCOMPATIBLE. With TRUNCATED, stop is n: a stream keeps buffer[start:n] until more bytes arrive, a datagram
        drops them. With NOTHING, start and stop are n.
    """
    end = min(int(np.int64(n)), buffer.shape[0])
    start = int(np.int64(p))
    while start < end and buffer[start] != _MAGIC_V2 and buffer[start] != _MAGIC_V1:
        start += 1
    if start >= end:
        return end, end, NOTHING
    if end - start < 3:
        return start, end, TRUNCATED
    stop = start + packet_length(buffer, start)
    if stop > end:
        return start, end, TRUNCATED
    if buffer[start] == _MAGIC_V2 and get_u8(buffer, start + 2) & ~_FLAG_SIGNED != 0:
        return start, stop, INCOMPATIBLE
    row = _row(message_id(buffer, start))
    if row < 0:
        return start, stop, UNKNOWN
    if not has_crc(buffer, start, int(np.int64(CRC_EXTRA[row]))):
        return start, stop, BAD_CRC
    return start, stop, SIGNED if signed(buffer, start) else GOOD


@kernel
def has_crc(buffer: Bytes, start: int, crc_extra: int) -> bool:
    """Returns whether the complete packet at `start` has the correct CRC for a message with this CRC_EXTRA."""
    crc_at = payload_start(buffer, start) + payload_length(buffer, start)
    return _x25_step(x25(buffer, start + 1, crc_at), int(np.int64(crc_extra))) == get_u16(buffer, crc_at)


@kernel
def unpack(buffer: Bytes, start: int, payload: Bytes) -> int:
    """Copies the payload of the complete packet at `start` into `payload` and fills the rest of `payload` with zeros.

    The zeros stand for fields omitted by MAVLink 2's truncation or by MAVLink 1.

    Args:
        buffer: contains the packet.
        start: index of the packet's first byte.
        payload: uint8[255].

    Returns:
        The number of bytes copied.
    """
    length = payload_length(buffer, start)
    first = payload_start(buffer, start)
    copy(buffer, first, first + length, payload, 0)
    clear(payload, length, payload.shape[0])
    return length


@kernel
def pack(
    buffer: Bytes,
    n: int,
    payload: Bytes,
    message: int,
    sequence_number: int,
    system_id: int,
    component_id: int,
    mavlink_version: int,
) -> int:
    """Appends one unsigned packet to buffer[:n].

    Args:
        buffer: receives the packet at index n.
        n: number of bytes in use.
        payload: uint8[255], of which the message's full length is used. MAVLink 2 omits trailing zeros (but sends at
            least one byte), MAVLink 1 omits the extension fields.
        message: message id.
        sequence_number: the sender's packet counter; its low 8 bits are sent.
        system_id: sender's system id, 1 to 255.
        component_id: sender's component id.
        mavlink_version: 1 or 2.

    Returns:
        The new number of bytes in use. It is -1, with nothing written, if the packet does not fit, the message is not
        in the dialect, MAVLink 1 cannot carry its id, or a packet before it could not be written (`n` is -1). FMUs fail
        with -1 bytes in a `PacketOutput`.
    """
    # numba recompiles a kernel for every literal argument, such as a message id; only this thin wrapper is recompiled.
    return _pack(
        buffer,
        int(np.int64(n)),
        payload,
        int(np.int64(message)),
        int(np.int64(sequence_number)),
        int(np.int64(system_id)),
        int(np.int64(component_id)),
        int(np.int64(mavlink_version)),
    )


@kernel
def _pack(
    buffer: Bytes,
    n: int,
    payload: Bytes,
    message: int,
    sequence_number: int,
    system_id: int,
    component_id: int,
    mavlink_version: int,
) -> int:
    crc_extra, length, full_length, _, _ = definition(message)
    if crc_extra < 0:
        return -1
    return pack_defined(
        buffer,
        n,
        payload,
        message,
        crc_extra,
        length,
        full_length,
        sequence_number,
        system_id,
        component_id,
        mavlink_version,
    )


@kernel
def pack_defined(
    buffer: Bytes,
    n: int,
    payload: Bytes,
    message: int,
    crc_extra: int,
    length: int,
    full_length: int,
    sequence_number: int,
    system_id: int,
    component_id: int,
    mavlink_version: int,
) -> int:
    """`pack` for a message of another dialect, given its CRC_EXTRA and its lengths without and with extensions."""
    if mavlink_version == 1 and message > 0xFF:
        return -1
    first = n + _HEADER_V1
    if mavlink_version != 1:
        first = n + _HEADER_V2
        length = full_length
        while length > 1 and payload[length - 1] == 0:
            length -= 1
    stop = first + length + _CRC
    if n < 0 or stop > buffer.shape[0]:
        return -1
    buffer[n + 1] = length
    if mavlink_version == 1:
        buffer[n] = _MAGIC_V1
        buffer[n + 5] = message
    else:
        buffer[n] = _MAGIC_V2
        buffer[n + 2] = 0
        buffer[n + 3] = 0
        put_u16(buffer, n + 7, message)
        put_u8(buffer, n + 9, message >> 16)
    # In both versions, the sequence number and the sender's address are the three bytes before the message id.
    address = n + 2 if mavlink_version == 1 else n + 4
    put_u8(buffer, address, sequence_number)
    put_u8(buffer, address + 1, system_id)
    put_u8(buffer, address + 2, component_id)
    copy(payload, 0, length, buffer, first)
    crc = _x25_step(x25(buffer, n + 1, first + length), crc_extra)
    put_u16(buffer, first + length, crc)
    return stop


# -- base64 ---------------------------------------------------------------------------------------------------------


@kernel
def encode_base64(source: Bytes, n: int, text: Bytes) -> int:
    """Writes source[:n] to `text` as base64 (ASCII, padded, no line breaks).

    Returns:
        The length of the text, 4 * ceil(n / 3); -1 with nothing written if it does not fit.
    """
    count = int(np.int64(n))
    length = (count + 2) // 3 * 4
    if length > text.shape[0]:
        return -1
    at, to = np.uintp(0), np.uintp(0)
    for _ in range(count // 3):
        bits = int(np.int64(source[at]) << 16 | np.int64(source[at + _ONE]) << 8 | np.int64(source[at + _TWO]))
        text[to] = _BASE64[np.uintp(bits >> 18)]
        text[to + _ONE] = _BASE64[np.uintp(bits >> 12 & 0x3F)]
        text[to + _TWO] = _BASE64[np.uintp(bits >> 6 & 0x3F)]
        text[to + _THREE] = _BASE64[np.uintp(bits & 0x3F)]
        at += _THREE
        to += _FOUR
    rest = count % 3
    if rest > 0:
        bits = get_u8(source, count - rest) << 16
        if rest == 2:
            bits |= get_u8(source, count - 1) << 8
        text[length - 4] = _BASE64[bits >> 18]
        text[length - 3] = _BASE64[bits >> 12 & 0x3F]
        text[length - 2] = _BASE64[bits >> 6 & 0x3F] if rest == 2 else _EQUALS
        text[length - 1] = _EQUALS
    return length


@kernel
def decode_base64(text: Bytes, n: int, destination: Bytes) -> int:
    """Decodes the base64 text text[:n] into `destination`.

    Returns:
        The number of bytes. It is -1 if the text is malformed or the bytes do not fit; the contents of `destination`
        are then undefined. Text is malformed if it has a character outside the alphabet (including white space), a
        length that is not a multiple of 4, or "=" other than as the last one or two characters.
    """
    count = int(np.int64(n))
    if count % 4 != 0 or count > text.shape[0]:
        return -1
    if count == 0:
        return 0
    padding = 0
    if text[count - 1] == _EQUALS:
        padding = 2 if text[count - 2] == _EQUALS else 1
    length = count // 4 * 3 - padding
    if length > destination.shape[0]:
        return -1
    at, to = np.uintp(0), np.uintp(0)
    for _ in range((count >> 2) - 1):
        bits = int(
            np.int64(_BASE64_VALUES[text[at]]) << 18
            | np.int64(_BASE64_VALUES[text[at + _ONE]]) << 12
            | np.int64(_BASE64_VALUES[text[at + _TWO]]) << 6
            | np.int64(_BASE64_VALUES[text[at + _THREE]])
        )
        if bits < 0:
            return -1
        destination[to] = bits >> 16
        destination[to + _ONE] = bits >> 8 & 0xFF
        destination[to + _TWO] = bits & 0xFF
        at += _FOUR
        to += _THREE
    bits = 0
    for k in range(4):
        value = int(np.int64(_BASE64_VALUES[text[count - 4 + k]])) if k < 4 - padding else 0
        if value < 0:
            return -1
        bits = bits << 6 | value
    for k in range(3 - padding):
        destination[length - 3 + padding + k] = bits >> 16 - 8 * k & 0xFF
    return length

"""MAVLink's file transfer, read-only: the parameters as the file @PARAM/param.pck, as fetched by MAVProxy.

The file is packed as in ArduPilot: names share their common prefixes, and values have the width of their types. Its
length is fixed while it is open; values are read when a piece is sent. Directories can be listed; other files do not
exist, and writing is not possible. There is one session at a time, which belongs to the system that opened the file.
Kernels over the autopilot's record `m`.

Sources: the MAVLink guide, "File Transfer Protocol (FTP)"; ArduPilot, GCS_FTP and AP_Filesystem_Param; a recorded
transfer from ArduCopter 4.7-dev to MAVProxy.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    FILE_TRANSFER_PROTOCOL,
    FILE_TRANSFER_PROTOCOL_LENGTH,
    FILE_TRANSFER_PROTOCOL_PAYLOAD,
    MAV_PARAM_TYPE_INT8,
    MAV_PARAM_TYPE_INT16,
    MAV_PARAM_TYPE_INT32,
    MAV_PARAM_TYPE_REAL32,
)
from cosim.packets import clear, get_u8, get_u16, get_u32, put_f32, put_i8, put_i16, put_i32, put_u8, put_u16, put_u32
from cosim_models.autopilot.link.links import can_answer, send
from cosim_models.autopilot.link.statustext import DEBUG, FTP_UNSUPPORTED, say
from cosim_models.autopilot.mavlink.parameters import (
    PARAMETER_COUNT,
    PARAMETER_NAMES,
    PARAMETER_TYPES,
    parameter_type,
    parameter_value,
)

__all__ = ["answer_file_transfer", "continue_burst"]


# The protocol's header in the payload.
_SEQUENCE, _SESSION, _OPCODE, _SIZE, _REQUEST, _COMPLETE, _OFFSET, _DATA = (
    FILE_TRANSFER_PROTOCOL_PAYLOAD + i for i in (0, 2, 3, 4, 5, 6, 8, 12)
)
_MOST = 239  # bytes of data
_SYSTEM, _COMPONENT = 1, 2  # of the message
_TERMINATE, _RESET, _LIST, _OPEN, _READ, _BURST = 1, 2, 3, 4, 5, 15
_TRUNCATE, _CHECKSUM, _LISTS_WITH_TIMES = 12, 14, 16
_ACK, _NAK = 128, 129
_FAILED, _INVALID_SESSION, _END, _PROTECTED, _NOT_FOUND = 1, 4, 6, 9, 10
_SHARE = 0.005  # s between packets of a burst

_MAGIC = 0x671B
_POLYNOMIAL = 0xEDB88320  # of the CRC, reflected
_PACKED_TYPE = {MAV_PARAM_TYPE_INT8: 1, MAV_PARAM_TYPE_INT16: 2, MAV_PARAM_TYPE_INT32: 3, MAV_PARAM_TYPE_REAL32: 4}
_PACKED_SIZE = {MAV_PARAM_TYPE_INT8: 1, MAV_PARAM_TYPE_INT16: 2, MAV_PARAM_TYPE_INT32: 4, MAV_PARAM_TYPE_REAL32: 4}


def _packed() -> tuple[bytes, list[int]]:
    """Returns the file with zero values, and the offsets of the values."""
    data = bytearray(np.array((_MAGIC, PARAMETER_COUNT, PARAMETER_COUNT), dtype="<u2").tobytes())
    places = []
    before = ""
    for i, name in enumerate(PARAMETER_NAMES):
        shared = 0
        while shared < min(len(before), len(name) - 1, 15) and before[shared] == name[shared]:
            shared += 1
        kind = PARAMETER_TYPES[i]
        data += bytes((_PACKED_TYPE[kind], (len(name) - shared - 1) << 4 | shared)) + name[shared:].encode()
        places.append(len(data))
        data += bytes(_PACKED_SIZE[kind])
        before = name
    return bytes(data), places


def _bytes(data: bytes) -> np.ndarray[Any, np.dtype[np.uint8]]:
    return np.frombuffer(data, dtype=np.uint8).copy()


_CONTENT, _PLACES = _packed()
_FILE = _bytes(_CONTENT)
_LENGTH = len(_CONTENT)
_VALUE_AT = np.array(_PLACES, dtype=np.int64)
_WIDTH = np.array([_PACKED_SIZE[kind] for kind in PARAMETER_TYPES], dtype=np.int64)
_NAME = _bytes(b"@PARAM/param.pck")
_FOLDER = _bytes(b"@PARAM")
_ROOT_LISTING = _bytes(b"D@PARAM\0")
_LISTING = _bytes(b"Fparam.pck\t%d\0" % _LENGTH)
_QUERY, _SLASH = 63, 47  # ? /


# ---- the file ------------------------------------------------------------------------------------------------------


@kernel
def _put_piece(m: Any, at: int, count: int) -> None:
    """Copies bytes [at, at + count) of the file to the answer."""
    for i in range(count):
        put_u8(m.payload, _DATA + i, _FILE[at + i])
    for p in range(PARAMETER_COUNT):
        first, width = _VALUE_AT[p], _WIDTH[p]
        if first >= at + count or first + width <= at:
            continue
        value, kind = parameter_value(m, p), parameter_type(p)
        if kind == MAV_PARAM_TYPE_REAL32:
            put_f32(m.received, 0, value)
        elif kind == MAV_PARAM_TYPE_INT32:
            put_i32(m.received, 0, int(value))
        elif kind == MAV_PARAM_TYPE_INT16:
            put_i16(m.received, 0, int(value))
        else:
            put_i8(m.received, 0, int(value))
        for k in range(width):
            if at <= first + k < at + count:
                put_u8(m.payload, _DATA + first + k - at, get_u8(m.received, k))


@kernel
def _put_checksum(m: Any) -> None:
    """Answers the file's CRC-32 as ArduPilot computes it: reflected, of polynomial 0x04C11DB7, from 0, not inverted."""
    crc = 0
    for at in range(0, _LENGTH, _MOST):
        count = min(_MOST, _LENGTH - at)
        _put_piece(m, at, count)
        for i in range(count):
            crc ^= get_u8(m.payload, _DATA + i)
            put_u8(m.payload, _DATA + i, 0)
            for _ in range(8):
                crc = crc >> 1 ^ (_POLYNOMIAL if crc & 1 != 0 else 0)
    put_u8(m.payload, _SIZE, 4)
    put_u32(m.payload, _DATA, crc)


@kernel
def _begin(m: Any, system: int, component: int, sequence: int, session: int, request: int, offset: int) -> None:
    """Begins an answer: an acknowledgement without data."""
    clear(m.payload, 0, FILE_TRANSFER_PROTOCOL_LENGTH)
    put_u8(m.payload, _SYSTEM, system)
    put_u8(m.payload, _COMPONENT, component)
    put_u16(m.payload, _SEQUENCE, sequence % 65536)
    put_u8(m.payload, _SESSION, session)
    put_u8(m.payload, _OPCODE, _ACK)
    put_u8(m.payload, _REQUEST, request)
    put_u32(m.payload, _OFFSET, offset)


@kernel
def _refuse(m: Any, error: int) -> None:
    put_u8(m.payload, _OPCODE, _NAK)
    put_u8(m.payload, _SIZE, 1)
    put_u8(m.payload, _DATA, error)


@kernel
def _fill(m: Any, at: int, count: int) -> None:
    """Copies a piece of the file to the answer, or reports the end of the file."""
    count = min(count, _MOST, _LENGTH - at)
    if count <= 0:
        _refuse(m, _END)
        return
    put_u8(m.payload, _SIZE, count)
    _put_piece(m, at, count)


@kernel
def _names(m: Any, size: int, name: Any, query: bool) -> bool:
    """Returns whether the received path is `name`; with `query`, a suffix after a question mark is allowed."""
    n = name.shape[0]
    if size < n:
        return False
    for i in range(n):
        if get_u8(m.received, _DATA + i) != np.int64(name[i]):
            return False
    following = get_u8(m.received, _DATA + n) if size > n else 0
    return bool(following == 0 or (query and following == _QUERY))


@kernel
def _list(m: Any, size: int, offset: int) -> None:
    """Answers the listing of a folder: one entry, then the end."""
    inside = _names(m, size, _FOLDER, False)
    root = size == 0 or (get_u8(m.received, _DATA) == _SLASH and (size == 1 or get_u8(m.received, _DATA + 1) == 0))
    if not inside and not root:
        _refuse(m, _NOT_FOUND)
    elif offset > 0:
        _refuse(m, _END)
    else:
        listing = _LISTING if inside else _ROOT_LISTING
        put_u8(m.payload, _SIZE, listing.shape[0])
        for i in range(listing.shape[0]):
            put_u8(m.payload, _DATA + i, listing[i])


# ---- requests ------------------------------------------------------------------------------------------------------


@kernel
def answer_file_transfer(m: Any, system: int, component: int, t: float) -> bool:
    """Answers a FILE_TRANSFER_PROTOCOL request; if the answer does not fit, the client asks again.

    Returns whether the parameters have been opened, which ArduPilot follows with its banner.
    """
    opened = False
    if not can_answer(m):
        return opened
    sequence, session = get_u16(m.received, _SEQUENCE), get_u8(m.received, _SESSION)
    request, size, offset = get_u8(m.received, _OPCODE), get_u8(m.received, _SIZE), get_u32(m.received, _OFFSET)
    if request == 0 or request >= _ACK:
        return opened
    size = min(size, _MOST)
    known = m.file_open and session == m.file_session
    _begin(m, system, component, sequence + 1, session, request, offset)
    if request in (_TERMINATE, _RESET):
        m.file_open = False
        m.file_bursting = False
    elif request == _OPEN:
        if _names(m, size, _NAME, True):
            m.file_open = opened = True
            m.file_bursting = False
            m.file_session = session
            put_u8(m.payload, _SIZE, 4)
            put_u32(m.payload, _DATA, _LENGTH)
        else:
            _refuse(m, _NOT_FOUND)
    elif request == _CHECKSUM:
        if _names(m, size, _NAME, True):
            _put_checksum(m)
        else:
            _refuse(m, _NOT_FOUND)
    elif request == _LIST:
        _list(m, size, offset)
    elif request in (_READ, _BURST) and not known:
        _refuse(m, _INVALID_SESSION)
    elif request == _READ:
        _fill(m, offset, size)
    elif request == _BURST:
        m.file_bursting = True
        m.file_link = m.link
        m.transferring = True
        m.file_at = min(offset, _LENGTH)
        m.file_piece = max(size, 1)
        m.file_sequence = sequence + 1
        m.file_system = system
        m.file_component = component
        m.file_due = t
        return opened
    else:
        if request == _TRUNCATE or request >= _LISTS_WITH_TIMES:
            say(m, DEBUG, FTP_UNSUPPORTED, request)
        _refuse(m, _FAILED if request == _TRUNCATE or request >= _LISTS_WITH_TIMES else _PROTECTED)
    send(m, FILE_TRANSFER_PROTOCOL)
    return opened


@kernel
def continue_burst(m: Any, t: float) -> None:
    """Sends the next piece of a burst, one every 5 ms if there is room, and the end of the file."""
    if t < m.file_due - 1e-9 or not can_answer(m):
        return
    left = _LENGTH - m.file_at
    _begin(m, m.file_system, m.file_component, m.file_sequence, m.file_session, _BURST, m.file_at)
    _fill(m, m.file_at, m.file_piece)
    last = left <= m.file_piece
    put_u8(m.payload, _COMPLETE, 1 if last else 0)
    if send(m, FILE_TRANSFER_PROTOCOL):
        m.file_at += min(left, m.file_piece)
        m.file_sequence += 1
        m.file_due = t + _SHARE
        m.file_bursting = left > 0

"""MAVLink's parameter protocol for the small autopilots: list, read and set, by ArduPilot's names.

Every parameter with an upper-case name is listed. As in `Autopilot`, unknown names are not answered, a value that is
not allowed is not taken, and each PARAM_SET of a known name is answered with the resulting value. Kernels access the
record by offset, which `parameter_protocol` takes from the declaration.

Source: the MAVLink guide, "Parameter Protocol".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cosim import Variable
from cosim.fields import get_real, get_whole, set_real, set_whole
from cosim.kernel import kernel
from cosim.messages import (
    MAV_PARAM_TYPE_INT32,
    MAV_PARAM_TYPE_REAL32,
    PARAM_REQUEST_LIST,
    PARAM_REQUEST_READ,
    PARAM_REQUEST_READ_PARAM_ID,
    PARAM_SET,
    PARAM_SET_PARAM_ID,
    PARAM_VALUE,
    PARAM_VALUE_PARAM_ID,
    decode_param_request_read,
    decode_param_set,
    encode_param_value,
)
from cosim.model import record_layout
from cosim.packets import get_u8, put_u8
from cosim_models.autopilot.gcs.sending import can_answer, send

__all__ = ["parameter_protocol"]

_ID_LENGTH = 16
_CHANGED = 65535  # index of a value that is sent because it was set
_LARGEST = 1e6
_PARAM_VALUE = cast(int, np.int64(PARAM_VALUE))


class _Table(NamedTuple):
    """The parameters of a record in the order of the list, as arrays that kernels close over."""

    ids: NDArray[np.uint8]  # (parameters, _ID_LENGTH)
    offsets: NDArray[np.int64]  # in the record, bytes
    is_whole: NDArray[np.uint8]
    least: NDArray[np.float64]
    most: NDArray[np.float64]


def _table(variables: Sequence[Variable]) -> _Table:
    listed = sorted((v for v in variables if v.role == "parameter" and v.name.isupper()), key=lambda v: v.name)
    fields = record_layout(tuple(variables))[0].fields
    assert fields is not None
    ids = np.zeros((len(listed), _ID_LENGTH), dtype=np.uint8)
    for i, v in enumerate(listed):
        ids[i, : len(v.name)] = np.frombuffer(v.name.encode(), dtype=np.uint8)
    return _Table(
        ids=ids,
        offsets=np.array([fields[v.name][1] for v in listed], dtype=np.int64),
        is_whole=np.array([v.kind == "Integer" for v in listed], dtype=np.uint8),
        least=np.array([v.minimum or 0.0 for v in listed]),
        most=np.array([v.maximum or _LARGEST for v in listed]),
    )


def parameter_protocol(
    variables: Sequence[Variable],
) -> tuple[Callable[[Any, int], bool], Callable[[Any], None]]:
    """Returns two kernels for a record with these variables.

    The first, of (record, message id), handles a message of the protocol; it returns whether the message is one. The
    second, of the record, sends the next value of a list in progress.
    """
    ids, offsets, is_whole, least, most = _table(variables)
    count = len(ids)

    @kernel
    def find(m: Any, at: int) -> int:
        for i in range(count):
            same = True
            for k in range(_ID_LENGTH):
                byte = get_u8(m.received, at + k)
                if byte != np.int64(ids[i, k]):
                    same = False
                    break
                if byte == 0:
                    break
            if same:
                return i
        return -1

    @kernel
    def tell(m: Any, i: int, index: int) -> bool:
        whole = is_whole[i] != 0
        value = float(get_whole(m, offsets[i])) if whole else get_real(m, offsets[i])
        kind = MAV_PARAM_TYPE_INT32 if whole else MAV_PARAM_TYPE_REAL32
        encode_param_value(m.payload, value, kind, count, index)
        for k in range(_ID_LENGTH):
            put_u8(m.payload, PARAM_VALUE_PARAM_ID + k, ids[i, k])
        return send(m, _PARAM_VALUE)

    @kernel
    def change(m: Any, i: int, value: float) -> None:
        if not least[i] <= value <= most[i]:
            return
        if is_whole[i] != 0:
            set_whole(m, offsets[i], int(value))
        else:
            set_real(m, offsets[i], value)

    @kernel
    def hear(m: Any, message: int) -> bool:
        if message == PARAM_REQUEST_LIST:
            m.listed = 0
        elif message == PARAM_REQUEST_READ:
            _, _, index = decode_param_request_read(m.received)
            if index < 0:
                index = find(m, PARAM_REQUEST_READ_PARAM_ID)
            if 0 <= index < count and can_answer(m):
                tell(m, index, index)
        elif message == PARAM_SET:
            _, _, value, _ = decode_param_set(m.received)
            i = find(m, PARAM_SET_PARAM_ID)
            if i >= 0 and math.isfinite(value):
                change(m, i, value)
                tell(m, i, _CHANGED)
        else:
            return False
        return True

    @kernel
    def continue_list(m: Any) -> None:
        if m.listed >= 0 and can_answer(m) and tell(m, m.listed, m.listed):
            m.listed = m.listed + 1 if m.listed + 1 < count else -1

    return hear, continue_list

"""MAVLink's parameter protocol: lists, reads and sets the autopilot's parameters by ArduPilot's names.

Every listed parameter has an effect. ArduPilot's parameters for features missing in this autopilot are unknown here,
and like ArduCopter, it does not answer requests for unknown names. A new value takes effect in the next step. Values
outside the valid range are rejected, as ArduPilot rejects writes to read-only parameters, and so is wind that does not
reach the vehicle. Values are not kept after a run. Kernels over the autopilot's record `m`, which is accessed by
offset.

Sources: the MAVLink guide, "Parameter Protocol"; ArduPilot, GCS_Param; answers recorded from ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.fields import get_real, get_whole, set_real, set_whole
from cosim.kernel import kernel
from cosim.messages import (
    MAV_PARAM_TYPE_INT8,
    MAV_PARAM_TYPE_INT16,
    MAV_PARAM_TYPE_INT32,
    MAV_PARAM_TYPE_REAL32,
    PARAM_REQUEST_READ_PARAM_ID,
    PARAM_SET_PARAM_ID,
    PARAM_VALUE,
    PARAM_VALUE_PARAM_ID,
    STATUSTEXT,
    decode_param_request_read,
    decode_param_set,
    encode_param_value,
    encode_statustext,
    put_statustext_text,
)
from cosim.model import record_layout
from cosim.packets import get_u8, put_u8
from cosim_models.autopilot.commander.sensors import watch_sensors
from cosim_models.autopilot.link.links import can_answer, send, send_to_all
from cosim_models.autopilot.link.statustext import NO_NUMBER, WARNING, WIND_UNCONNECTED, say
from cosim_models.autopilot.record.parameter_types import INT8, INT16, INT32
from cosim_models.autopilot.record.variables import VARIABLES

__all__ = [
    "PARAMETER_COUNT",
    "PARAMETER_NAMES",
    "PARAMETER_TYPES",
    "list_parameters",
    "parameter_type",
    "parameter_value",
    "read_parameter",
    "send_list",
    "set_parameter",
    "tell_saved",
]

_ID_LENGTH = 16
_SHARE = 0.005  # s between values of a list
_CHANGED = 65535  # index of a value that is sent because it was set
_NEARLY = 0.01  # added to an integer's value before its fraction is truncated
_LARGEST = 1e6
_DENIED = np.frombuffer(b"Param write denied ()", dtype=np.uint8).copy()

_TABLE = sorted((v for v in VARIABLES if v.role == "parameter" and v.name.isupper()), key=lambda v: v.name)
PARAMETER_NAMES = tuple(v.name for v in _TABLE)
"""Names of all parameters, ordered by index."""
PARAMETER_COUNT = len(_TABLE)


def _type(name: str) -> int:
    if name in INT8:
        return MAV_PARAM_TYPE_INT8
    if name in INT16:
        return MAV_PARAM_TYPE_INT16
    return MAV_PARAM_TYPE_INT32 if name in INT32 else MAV_PARAM_TYPE_REAL32


def _ids() -> np.ndarray[Any, np.dtype[np.uint8]]:
    ids = np.zeros((PARAMETER_COUNT, _ID_LENGTH), dtype=np.uint8)
    for i, name in enumerate(PARAMETER_NAMES):
        assert len(name) <= _ID_LENGTH, name
        ids[i, : len(name)] = np.frombuffer(name.encode(), dtype=np.uint8)
    return ids


_FIELDS = record_layout(VARIABLES)[0].fields
assert _FIELDS is not None
_IDS = _ids()
_OFFSETS = np.array([_FIELDS[name][1] for name in PARAMETER_NAMES], dtype=np.int64)
_IS_WHOLE = np.array([v.kind == "Integer" for v in _TABLE], dtype=np.uint8)
PARAMETER_TYPES = tuple(int(_type(name)) for name in PARAMETER_NAMES)
"""The MAV_PARAM_TYPE of each parameter, in the same order."""
_TYPES = np.array(PARAMETER_TYPES, dtype=np.int64)
_IS_WIND = np.array([v.name.startswith("SIM_WIND_") for v in _TABLE], dtype=np.uint8)
_FAILING = tuple(f"SIM_{part}" for part in ("ACC", "BARO", "ENGINE", "GPS", "GYR", "MAG"))
_IS_SENSOR = np.array([v.name.startswith(_FAILING) for v in _TABLE], dtype=np.uint8)  # or a motor
_LEAST = np.array([1.0 if v.name == "SYSID_THISMAV" else v.minimum or 0.0 for v in _TABLE])
_SHARES = ("MOT_SPIN_ARM", "MOT_SPIN_MIN", "MOT_SPIN_MAX", "MOT_THST_EXPO", "MOT_THST_HOVER", "TKOFF_THR_MAX")
_MAXIMA = {"SYSID_MYGCS": 255.0, "SYSID_THISMAV": 255.0, **dict.fromkeys(_SHARES, 1.0)}
_SAVED = np.array(
    [
        PARAMETER_NAMES.index(name)
        for axis in ("RLL", "PIT", "YAW")
        for name in (
            *(f"ATC_RAT_{axis}_{gain}" for gain in ("P", "I", "D", "FF", "FLTT", "FLTE", "FLTD")),
            f"ATC_ANG_{axis}_P",
            f"ATC_ACCEL_{axis[0]}_MAX",
        )
    ],
    dtype=np.int64,
)
"""Parameters that a tune saves, by the bits of m.tune_unsent."""
_MOST = np.array([v.maximum or _MAXIMA.get(v.name, _LARGEST) for v in _TABLE])


@kernel
def _find(m: Any, at: int) -> int:
    """Returns the index of the parameter named at `at` in the received payload, or -1."""
    for i in range(PARAMETER_COUNT):
        same = True
        for k in range(_ID_LENGTH):
            byte = get_u8(m.received, at + k)
            if byte != np.int64(_IDS[i, k]):
                same = False
                break
            if byte == 0:
                break
        if same:
            return i
    return -1


@kernel
def parameter_type(i: int) -> int:
    """Returns the MAV_PARAM_TYPE of the parameter with index i."""
    return int(_TYPES[i])


@kernel
def parameter_value(m: Any, i: int) -> float:
    """Returns the value of the parameter with index i."""
    if _IS_WHOLE[i] != 0:
        return float(get_whole(m, _OFFSETS[i]))
    return get_real(m, _OFFSETS[i])


@kernel
def _fill(m: Any, i: int, index: int) -> None:
    """Fills PARAM_VALUE for parameter i, reported with index `index`."""
    encode_param_value(m.payload, parameter_value(m, i), _TYPES[i], PARAMETER_COUNT, index)
    for k in range(_ID_LENGTH):
        put_u8(m.payload, PARAM_VALUE_PARAM_ID + k, _IDS[i, k])


@kernel
def list_parameters(m: Any, t: float) -> None:
    """Handles PARAM_REQUEST_LIST: begins the list, or restarts it."""
    m.parameter_next[m.link] = 0
    m.parameter_due[m.link] = t
    m.transferring = True


@kernel
def send_list(m: Any, t: float) -> None:
    """Sends the next value of the list in progress, one every 5 ms if there is room."""
    link = m.link
    if t < m.parameter_due[link] - 1e-9 or not can_answer(m):
        return
    _fill(m, m.parameter_next[link], m.parameter_next[link])
    if send(m, PARAM_VALUE):
        m.parameter_next[link] += 1
        m.parameter_due[link] = t + _SHARE


@kernel
def read_parameter(m: Any) -> None:
    """Handles PARAM_REQUEST_READ, by index or by name."""
    _, _, index = decode_param_request_read(m.received)
    if index < 0:
        index = _find(m, PARAM_REQUEST_READ_PARAM_ID)
    if 0 <= index < PARAMETER_COUNT and can_answer(m):
        _fill(m, index, index)
        send(m, PARAM_VALUE)


@kernel
def _deny(m: Any, i: int) -> None:
    encode_statustext(m.payload, WARNING, 0, 0)
    last = _DENIED.shape[0] - 1
    for k in range(last):
        put_statustext_text(m.payload, k, _DENIED[k])
    for k in range(_ID_LENGTH):
        if _IDS[i, k] == 0:
            break
        put_statustext_text(m.payload, last, _IDS[i, k])
        last += 1
    put_statustext_text(m.payload, last, _DENIED[_DENIED.shape[0] - 1])
    send_to_all(m, STATUSTEXT)


@kernel
def set_parameter(m: Any, t: float) -> None:
    """Handles PARAM_SET: the resulting value is sent to all; unknown names, infinity and NaN are not answered.

    A motor fails at once, not when the sensors are watched next.
    """
    _, _, value, _ = decode_param_set(m.received)
    i = _find(m, PARAM_SET_PARAM_ID)
    if i < 0 or not math.isfinite(value):
        return
    if _TYPES[i] != MAV_PARAM_TYPE_REAL32:
        value = float(math.trunc(value + math.copysign(_NEARLY, value)))
    if _IS_WIND[i] != 0 and not m.adds_wind:
        _deny(m, i)
        say(m, WARNING, WIND_UNCONNECTED, NO_NUMBER)
    elif _LEAST[i] <= value <= _MOST[i]:
        if _IS_WHOLE[i] != 0:
            set_whole(m, _OFFSETS[i], int(value))
        else:
            set_real(m, _OFFSETS[i], value)
        if _IS_SENSOR[i] != 0:
            watch_sensors(m, t)
    else:
        _deny(m, i)
    _fill(m, i, _CHANGED)
    send_to_all(m, PARAM_VALUE)


@kernel
def tell_saved(m: Any) -> None:
    """Sends the next of the parameters that a tune has saved to all, as if it had been set."""
    for k in range(_SAVED.shape[0]):
        if (m.tune_unsent >> k) & 1 != 0:
            m.tune_unsent -= 1 << k
            _fill(m, _SAVED[k], _CHANGED)
            send_to_all(m, PARAM_VALUE)
            return

"""AVAILABLE_MODES: the modes that ArduPilot's firmwares tell, in their order, with numbers and names.

The messages are in MAVLink's development dialect, not in ArduPilot's; therefore, their ids and check values are here.
Kernels over the record `m` of an autopilot, of which they use m.modes_asked, m.mode_asked and m.mode_told.

Source: answers of ArduCopter, ArduRover and ArduPlane 4.7-dev, the last one also with motors that lift.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from cosim.kernel import kernel
from cosim.packets import Bytes, clear, put_u8, put_u32

__all__ = [
    "AVAILABLE_MODES",
    "AVAILABLE_MODES_MONITOR",
    "COPTER_MODES",
    "MODES_CRC",
    "MODES_LENGTH",
    "MONITOR_CRC",
    "MONITOR_LENGTH",
    "PLANE_MODES",
    "QUADPLANE_MODES",
    "ROVER_MODES",
    "ask_for_modes",
    "letter_of_mode",
    "next_mode",
    "put_mode",
    "row_of_mode",
]

AVAILABLE_MODES, AVAILABLE_MODES_MONITOR = (cast(int, np.int64(i)) for i in (435, 437))
MODES_CRC, MONITOR_CRC, MODES_LENGTH, MONITOR_LENGTH = 134, 30, 46, 1

_COPTER = (
    (27, "AUTO RTL"), (3, "AUTO"), (1, "ACRO"), (0, "STABILIZE"), (2, "ALT_HOLD"), (7, "CIRCLE"), (5, "LOITER"),
    (4, "GUIDED"), (9, "LAND"), (6, "RTL"), (11, "DRIFT"), (14, "FLIP"), (15, "AUTOTUNE"), (16, "POSHOLD"),
    (17, "BRAKE"), (18, "THROW"), (19, "AVOID_ADSB"), (20, "GUIDED_NOGPS"), (21, "SMARTRTL"), (22, "FLOWHOLD"),
    (23, "FOLLOW"), (24, "ZIGZAG"), (25, "SYSTEMID"), (28, "TURTLE"),
)  # fmt: skip
_ROVER = (
    (0, "MANU"), (1, "ACRO"), (3, "STER"), (4, "HOLD"), (5, "LOIT"), (6, "FOLL"), (7, "SMPL"), (9, "CIRC"),
    (10, "AUTO"), (11, "RTL"), (12, "SRTL"), (15, "GUID"), (16, "INIT"), (8, "DOCK"),
)  # fmt: skip
_PLANE = (
    (0, "MANUAL"), (1, "CIRCLE"), (2, "STABILIZE"), (3, "TRAINING"), (4, "ACRO"), (5, "FLY_BY_WIRE_A"),
    (6, "FLY_BY_WIRE_B"), (7, "CRUISE"), (8, "AUTOTUNE"), (10, "AUTO"), (11, "RTL"), (12, "LOITER"),
    (14, "AVOID_ADSB"), (15, "GUIDED"), (16, "INITIALISING"), (13, "TAKEOFF"), (24, "THERMAL"), (26, "AUTOLAND"),
)  # fmt: skip
_LIFTED = (
    (17, "QSTABILIZE"), (18, "QHOVER"), (19, "QLOITER"), (20, "QLAND"), (21, "QRTL"), (23, "QACRO"),
    (25, "Loiter to QLAND"), (22, "QAUTOTUNE"),
)  # fmt: skip
_ALL = (*_COPTER, *_ROVER, *_PLANE, *_LIFTED)
_FIRST = np.array((0, len(_COPTER), len(_COPTER) + len(_ROVER), len(_COPTER) + len(_ROVER)))
_COUNT = np.array((len(_COPTER), len(_ROVER), len(_PLANE), len(_PLANE) + len(_LIFTED)))
COPTER_MODES, ROVER_MODES, PLANE_MODES, QUADPLANE_MODES = range(4)
"""Firmwares."""
_NUMBERS = np.array([number for number, _ in _ALL], dtype=np.int64)
_NAMES = np.zeros((len(_ALL), 35), dtype=np.uint8)
for _i, (_, _name) in enumerate(_ALL):
    _NAMES[_i, : len(_name)] = np.frombuffer(_name.encode(), dtype=np.uint8)
_PLACE_OF_NUMBER, _PLACE_OF_COUNT, _PLACE_OF_INDEX, _PLACE_OF_NAME = 0, 8, 9, 11  # in the payload


@kernel
def ask_for_modes(m: Any, index: float) -> None:
    """Notes which mode is asked for, from 1; 0 for one after the other. ArduPilot takes the lowest byte."""
    m.modes_asked = True
    m.mode_asked = int(index) & 0xFF if -1e9 < index < 1e9 else 0
    m.mode_told = 0


@kernel
def next_mode(m: Any, firmware: int) -> int:
    """Returns the index of the mode to be told now, 0 if there is none."""
    if not m.modes_asked:
        return 0
    count = int(_COUNT[firmware])
    if m.mode_asked != 0:
        m.modes_asked = False
        return int(m.mode_asked) if m.mode_asked <= count else 0
    m.mode_told += 1
    m.modes_asked = m.mode_told < count
    return int(m.mode_told)


@kernel
def put_mode(payload: Bytes, firmware: int, index: int) -> None:
    """Fills a payload with AVAILABLE_MODES: the mode of an index, from 1."""
    clear(payload, 0, MODES_LENGTH)
    row = _FIRST[firmware] + index - 1
    put_u32(payload, _PLACE_OF_NUMBER, int(_NUMBERS[row]))
    put_u8(payload, _PLACE_OF_COUNT, int(_COUNT[firmware]))
    put_u8(payload, _PLACE_OF_INDEX, index)
    for i in range(_NAMES.shape[1]):
        put_u8(payload, _PLACE_OF_NAME + i, int(_NAMES[row, i]))


@kernel
def row_of_mode(firmware: int, number: int) -> int:
    """Returns the row of a mode in the table, -1: the firmware has no such mode."""
    first = int(_FIRST[firmware])
    for row in range(first, first + _COUNT[firmware]):
        if _NUMBERS[row] == number:
            return row
    return -1


@kernel
def letter_of_mode(row: int, i: int) -> int:
    """Returns a byte of the name of a mode, by its row; 0 behind the end."""
    return int(_NAMES[row, i]) if row >= 0 and i < _NAMES.shape[1] else 0

"""Switches of rover, plane and quadplane: the mode switch, and auxiliary functions by channels with an RCn_OPTION.

The functions are also those of DO_AUX_FUNCTION. Switches are read ten times a second while a channel is overridden: the
mode switch once it has been moved, or is asked for its mode by a function, others as `Autopilot` reads them. Kernels
over a record that has the variables of `gcs.record`, `switch_parameters` and `SWITCH_MEMORY`.

Differences from ArduPilot: without a pilot's first override there are no switches, where ArduPilot reads those of its
receiver at the boot. Functions of parts that are not on board are accepted and do nothing; of planes, a text says so.

Source: ArduPilot, RC_Channel (read_mode_switch, read_aux, do_aux_function).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from cosim import Memory, Parameter, Variable
from cosim.fields import get_whole
from cosim.kernel import kernel
from cosim.messages import (
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_SURFACE_BOAT,
)
from cosim.model import record_layout
from cosim_models.autopilot.commander.positions import LAST_POSITION, UNKNOWN, has_moved, new_mode_position
from cosim_models.autopilot.gcs.devices import set_relay
from cosim_models.autopilot.gcs.sticks import CHANNELS, overridden, pulse_of, receiver_pulse
from cosim_models.autopilot.gcs.words import COMPASS_ARMED, EKF_SOURCE, NO_EFFECT, NO_OPTION, SWITCHES, TOLD, say

__all__ = [
    "ARM_AIR_MODE",
    "HIGH",
    "SWITCH_MEMORY",
    "return_to_switch",
    "start_switches",
    "switch_parameters",
    "switches",
]

HIGH = cast(int, np.int64(2))
"""The position of a switch with the longest pulse."""
ARM_AIR_MODE = cast(int, np.int64(154))
"""Auxiliary function of ArduPlane that arms and disarms."""
_LOW, _MIDDLE = 0, 1
_PERIOD = 0.1  # s
_NEVER = 1e300
_RESET_MISSION, _STOP, _OVERRIDES, _CLEAR_MISSION = 24, 31, 46, 58
_DISARM, _SOURCE, _ARM_DISARM, _ARM_STOP, _CALIBRATE = 81, 90, 153, 165, 171
_RELAYS = np.array((28, 34, 35, 36, 66, 67), np.int64)
_IDLE = np.array(
    (0, 9, 11, 19, 27, 30, 40, 62, 65, 85, 100, 101, 102, 103, 104, 105, 110, 112, 113, 162, 163, 164, 172), np.int64
)
"""Functions of all firmwares, for camera, fence, gripper, mounts, sound, compass, GPS, generator, IMUs and logging."""
_SCRIPTS = 300, 315
_CAMERAS = 166, 169  # functions that fail without a camera

SWITCH_MEMORY = (
    Memory("switch_due"),  # s, when switches are read; _NEVER: not before a channel is overridden
    Memory("switch_position", dtype="i4", rare=True),  # of the mode switch, 1 to 6
    Memory("switch_seen", dtype="i4", rare=True),
    Memory("switch_since", rare=True),  # s
    Memory("switch_moved", dtype="?", rare=True),  # by an override, once
    Memory("aux_position", dtype="i4", shape=CHANNELS, rare=True),  # 1 low to 3 high
    Memory("aux_seen", dtype="i4", shape=CHANNELS, rare=True),
    Memory("aux_since", shape=CHANNELS, rare=True),  # s
    Memory("emergency_stop", dtype="?"),
)


def _whole(name: str, start: int, most: int, description: str) -> Variable:
    return Parameter(
        name, type=int, start=start, minimum=0, maximum=most, tunable=True, rare=True, description=description
    )


def switch_parameters(mode: str, modes: Sequence[int]) -> tuple[Variable, ...]:
    """Returns the parameters of the switches.

    Args:
        mode: the name of those of the mode switch: {mode}_CH, {mode}1 and so on.
        modes: start values of the latter.
    """
    return (
        _whole(f"{mode}_CH", 8, CHANNELS, "channel of the mode switch, 0: none"),
        *(_whole(f"{mode}{i + 1}", modes[i], 255, f"mode of position {i + 1}") for i in range(LAST_POSITION)),
        *(_whole(f"RC{i + 1}_OPTION", 0, 315, f"function of channel {i + 1}, 0: none") for i in range(CHANNELS)),
    )


@kernel
def start_switches(m: Any) -> None:
    """Takes the mode switch to be where the simulated receiver has it; required at the start."""
    m.switch_due = _NEVER
    m.switch_position, m.switch_seen = LAST_POSITION, LAST_POSITION


@kernel
def return_to_switch(m: Any, t: float) -> None:
    """Makes the mode that of the mode switch, 0.2 s later, as if it had been moved there; without an override, too."""
    m.switch_position, m.switch_seen = UNKNOWN, UNKNOWN
    m.switch_due = min(m.switch_due, t)


@kernel
def _change_mission(m: Any, function: int) -> None:
    """Begins the mission anew, or clears it unless it is being carried out."""
    runs = m.mission_active and not m.mission_done
    if function == _RESET_MISSION:
        m.mission_current = 1 if runs else 0
        m.item_since = -1.0
    elif not runs:
        m.mission_count, m.mission_current, m.uploading = 0, 0, False


@kernel
def _is_idle(function: int) -> bool:
    """Returns whether a function is known, and does nothing here."""
    for i in range(_IDLE.size):
        if _IDLE[i] == function:
            return True
    return _SCRIPTS[0] <= function <= _SCRIPTS[1]


@kernel
def _set(m: Any, function: int, at: int) -> bool:
    """Does what needs no kernel of the firmware; returns whether a function is one of these."""
    for i in range(_RELAYS.size):
        if _RELAYS[i] == function:
            set_relay(m, float(i), 1.0 if at == HIGH else 0.0)
            return True
    if function in (_RESET_MISSION, _CLEAR_MISSION):
        if at == HIGH:
            _change_mission(m, function)
    elif function == _OVERRIDES:
        if at != _MIDDLE:
            m.overrides_off = at == _LOW
    elif function == _STOP:
        if at != _MIDDLE:
            m.emergency_stop = at == HIGH
    elif function == _SOURCE:
        say(m, MAV_SEVERITY_INFO, EKF_SOURCE, at + 1)
    elif function == _CALIBRATE:
        if at == HIGH and m.armed:
            say(m, MAV_SEVERITY_NOTICE, COMPASS_ARMED, 0)
    elif _is_idle(function):
        surface = m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT)
        if 0 < function < _SCRIPTS[0] and at != _LOW and not surface:
            say(m, MAV_SEVERITY_INFO, NO_EFFECT, function)
    else:
        return False
    return True


def _functions(
    modes: Sequence[tuple[int, int]],
    at_middle: bool,
    enter: Callable[[Any, int, float], int],
    arm: Callable[[Any, bool, float], int],
    other: Callable[[Any, int, int, float], bool],
) -> Callable[[Any, float, float, float], int]:
    """Returns a kernel of (record, function, position, time [s]) that does what a switch does: its MAV_RESULT."""
    table = np.array(modes, dtype=np.int64)

    @kernel
    def arm_or_stop(m: Any, function: int, at: int, t: float) -> bool:
        if function == _ARM_STOP:
            m.emergency_stop = at == _LOW
        if function in (_ARM_DISARM, _ARM_STOP) and at == HIGH:
            if not m.armed:
                arm(m, False, t)
        elif (function == _ARM_DISARM and at == _LOW) or (function == _DISARM and at == HIGH):
            m.armed = False
        return function in (_DISARM, _ARM_DISARM, _ARM_STOP)

    @kernel
    def use(m: Any, function: float, position: float, t: float) -> int:
        if not 0.0 <= position <= 2.0:
            return MAV_RESULT_DENIED
        at = int(position)
        number = int(function) if 0.0 <= function <= 65535.0 else 65535
        for i in range(table.shape[0]):
            if table[i, 0] == number:
                if at == HIGH:
                    enter(m, int(table[i, 1]), t)
                elif m.mode == table[i, 1] and (at == _LOW or at_middle):
                    return_to_switch(m, t)
                return MAV_RESULT_ACCEPTED
        if _CAMERAS[0] <= number <= _CAMERAS[1]:
            return MAV_RESULT_FAILED
        if arm_or_stop(m, number, at, t) or other(m, number, at, t) or _set(m, number, at):
            return MAV_RESULT_ACCEPTED
        say(m, MAV_SEVERITY_INFO, NO_OPTION, number)
        return MAV_RESULT_FAILED

    return use


def switches(
    variables: Sequence[Variable],
    mode: str,
    modes: Sequence[tuple[int, int]],
    at_middle: bool,
    enter: Callable[[Any, int, float], int],
    arm: Callable[[Any, bool, float], int],
    other: Callable[[Any, int, int, float], bool],
) -> tuple[Callable[[Any, float, float, float], int], Callable[[Any, float], None]]:
    """Returns two kernels for a record with these variables.

    The first, of (record, function, position, time [s]), does what a switch does in a position (0 low to 2 high); it
    returns a MAV_RESULT. The second, of (record, time), reads the switches; it is required from m.switch_due on.

    Args:
        variables: of the record.
        mode: as for `switch_parameters`.
        modes: functions that change the mode, with its number.
        at_middle: whether the middle position, too, returns from such a mode to that of the mode switch.
        enter: kernel of (record, mode, time) that changes the mode.
        arm: kernel of (record, whether forced, time) that arms.
        other: kernel of (record, function, position, time) for the firmware's own; returns whether it knows it.
    """
    use = _functions(modes, at_middle, enter, arm, other)
    fields = record_layout(tuple(variables))[0].fields
    assert fields is not None
    channel_at = fields[f"{mode}_CH"][1]
    modes_at = np.array([fields[f"{mode}{i + 1}"][1] for i in range(LAST_POSITION)], dtype=np.int64)
    options_at = np.array([fields[f"RC{i + 1}_OPTION"][1] for i in range(CHANNELS)], dtype=np.int64)

    @kernel
    def watch_mode(m: Any, t: float) -> None:
        number = get_whole(m, channel_at)
        moved = overridden(m, number - 1, t) if number != 0 else False
        if number == 0 or not (m.switch_position == UNKNOWN or moved or m.switch_moved):
            return
        m.switch_moved = m.switch_moved or moved
        position = new_mode_position(m, pulse_of(m, number - 1, t), t)
        if position != UNKNOWN:
            enter(m, get_whole(m, modes_at[position - 1]), t)

    @kernel
    def watch_function(m: Any, i: int, option: int, t: float) -> None:
        arms = option in (_ARM_DISARM, ARM_AIR_MODE, _ARM_STOP)
        if not has_moved(m, i, pulse_of(m, i, t), receiver_pulse(m, i), arms, t):
            return
        position = int(m.aux_position[i])
        for k in range(TOLD.size):
            if TOLD[k] == option:
                say(m, MAV_SEVERITY_INFO, SWITCHES + 3 * k + position - 1, i + 1)
        use(m, float(option), float(position - 1), t)

    @kernel
    def watch(m: Any, t: float) -> None:
        m.switch_due = t + _PERIOD - 1e-9
        if m.sticks_ignored:
            return
        flies = False
        for i in range(CHANNELS):
            flies = flies or overridden(m, i, t)
        if flies:
            for i in range(CHANNELS):
                option = get_whole(m, options_at[i])
                if option != 0:
                    watch_function(m, i, option, t)
        elif not m.switch_moved and m.switch_position != UNKNOWN:
            m.switch_due = _NEVER
        watch_mode(m, t)

    return use, watch

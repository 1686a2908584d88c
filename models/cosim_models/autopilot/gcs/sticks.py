"""The pilot's sticks of rover, plane and quadplane: overrides received by MAVLink, and the deflections that they mean.

RC_CHANNELS_OVERRIDE and MANUAL_CONTROL from the ground station (SYSID_MYGCS) set channels for RC_OVERRIDE_TIME. Those
without an override have the pulses of ArduPilot's simulated receiver: centred sticks, a rover's throttle centred, that
of a plane closed. (In QHOVER and QLOITER it is centred in the air, where ArduPlane's would make the vehicle sink; in
QSTABILIZE and QACRO, too, while the radio counts as lost.)

Channels are those of the default RCMAP_*: 1 roll or steering, 2 pitch, 3 throttle, 4 yaw; 1000 to 2000 us, as RC1_MIN
and RC1_MAX are in ArduPilot's parameters for its simulator, with a dead zone of 30 us. Kernels over a record that has
`STICK_MEMORY` and, for `hear_sticks`, `STICK_PARAMETERS`.

Sources: ArduPilot, RC_Channel, GCS_Common (manual_override), GCS_MAVLink of Rover and Plane, AP_RCProtocol_UDP.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from cosim import Memory, Parameter
from cosim.kernel import kernel
from cosim.messages import (
    MANUAL_CONTROL,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_SURFACE_BOAT,
    RC_CHANNELS_OVERRIDE,
    RC_CHANNELS_OVERRIDE_CHAN1_RAW,
    decode_manual_control,
)
from cosim.packets import get_u16

__all__ = [
    "CHANNELS",
    "PITCH",
    "ROLL",
    "STICK_MEMORY",
    "STICK_PARAMETERS",
    "THROTTLE",
    "YAW",
    "deflection",
    "hear_sticks",
    "is_held",
    "opening",
    "overridden",
    "pulse_of",
    "receiver_pulse",
    "tilt",
]

ROLL, PITCH, THROTTLE, YAW = (cast(int, np.int64(i)) for i in range(4))
"""Channels, from 0. A rover is steered by the first."""
CHANNELS = 8
"""Number of channels."""
_LOW, _CENTRE, _HIGH, _DEAD = 1000.0, 1500.0, 2000.0, 30.0  # us
_CLOSED = 1000  # us, of a plane's throttle without an override
_SWITCHES = np.array([1800, 1000, 1000, 1800], np.int64)  # us, channels 5 to 8
_IGNORED, _NO_VALUE = 65535, 32767
_FOR_EVER = 1e300
_READ = 0.1  # s, within which switches are read after an override
_QSTABILIZE, _QHOVER, _QLOITER, _QACRO = 17, 18, 19, 23

STICK_PARAMETERS = (
    Parameter(
        "SYSID_MYGCS",
        type=int,
        start=255,
        minimum=1,
        maximum=255,
        tunable=True,
        description="system id of the ground station whose sticks are obeyed",
    ),
    Parameter(
        "RC_OVERRIDE_TIME",
        unit="s",
        start=3.0,
        minimum=-1.0,
        maximum=120.0,
        tunable=True,
        description="lifetime of an override; 0: overrides are ignored, -1: unlimited",
    ),
)
STICK_MEMORY = (
    Memory("sticks_known", dtype="?"),  # there have been overrides, which may have ended
    Memory("overrides_off", dtype="?", rare=True),  # by a switch
    Memory("sticks_ignored", dtype="?", rare=True),  # the radio counts as lost
    Memory("rc_override", dtype="i4", shape=CHANNELS, rare=True),  # us, 0: none
    Memory("rc_until", shape=CHANNELS, rare=True),  # s, when the override ends
)


@kernel
def _is_surface(m: Any) -> bool:
    return bool(m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT))


# ---- received overrides --------------------------------------------------------------------------------------------


@kernel
def _override(m: Any, i: int, pulse: int, t: float) -> None:
    """Overrides channel i with `pulse` [us]; 0 releases it."""
    m.sticks_known = True
    m.switch_due = min(m.switch_due, t + _READ)
    m.rc_override[i] = pulse
    m.rc_until[i] = _FOR_EVER if m.RC_OVERRIDE_TIME < 0.0 else t + m.RC_OVERRIDE_TIME


@kernel
def _axis(m: Any, i: int, value: int, offset: int, span: float, t: float) -> None:
    """Overrides channel i with an axis of MANUAL_CONTROL; INT16_MAX releases it."""
    if abs(value) == _NO_VALUE:
        _override(m, i, 0, t)
    else:
        pulse = _LOW + (_HIGH - _LOW) * (value + offset) / span
        _override(m, i, int(min(max(pulse, 0.0), 65535.0)), t)


@kernel
def hear_sticks(m: Any, message: int, sender: int, t: float) -> bool:
    """Handles RC_CHANNELS_OVERRIDE and MANUAL_CONTROL; returns whether `message` is one of them."""
    if message == RC_CHANNELS_OVERRIDE:
        if sender == m.SYSID_MYGCS:
            for i in range(CHANNELS):
                pulse = get_u16(m.received, RC_CHANNELS_OVERRIDE_CHAN1_RAW + 2 * i)
                if pulse != _IGNORED:
                    _override(m, i, pulse, t)
        return True
    if message != MANUAL_CONTROL:
        return False
    target, x, y, z, r, _, _, _, _, _, _, _, _, _, _, _ = decode_manual_control(m.received)
    if sender == m.SYSID_MYGCS and target == m.SYSID_THISMAV:
        _axis(m, ROLL, y, 1000, 2000.0, t)
        if _is_surface(m):
            _axis(m, THROTTLE, z, 1000, 2000.0, t)
        else:
            _axis(m, PITCH, -x, 1000, 2000.0, t)
            _axis(m, THROTTLE, z, 0, 1000.0, t)
            _axis(m, YAW, r, 1000, 2000.0, t)
    return True


# ---- channels and sticks -------------------------------------------------------------------------------------------


@kernel
def is_held(m: Any, i: int, t: float) -> bool:
    """Returns whether there is an override of channel i (from 0)."""
    return bool(m.rc_override[i] != 0 and t < m.rc_until[i] and not m.overrides_off)


@kernel
def overridden(m: Any, i: int, t: float) -> bool:
    """Returns whether channel i (from 0) is overridden: not while the radio counts as lost."""
    return bool(is_held(m, i, t) and not m.sticks_ignored)


@kernel
def receiver_pulse(m: Any, i: int) -> int:
    """Returns the pulse [us] that channel i (from 0) has without an override."""
    if i > YAW:
        return int(_SWITCHES[i - YAW - 1])
    halved = m.mode in (_QHOVER, _QLOITER) or (m.sticks_ignored and m.mode in (_QSTABILIZE, _QACRO))
    climbs = m.lifts and not m.on_ground and halved
    if i == THROTTLE and not _is_surface(m) and not climbs:
        return _CLOSED
    return int(_CENTRE)


@kernel
def pulse_of(m: Any, i: int, t: float) -> int:
    """Returns the pulse [us] of channel i (from 0)."""
    return int(m.rc_override[i]) if overridden(m, i, t) else receiver_pulse(m, i)


@kernel
def _within(pulse: float, dead: float) -> float:
    """Returns the deflection of a pulse [us] from the centre, -1 to 1; 0 within `dead` of it."""
    off = min(max(pulse, _LOW), _HIGH) - _CENTRE
    if abs(off) <= dead:
        return 0.0
    return (off - dead if off > 0.0 else off + dead) / (_HIGH - _CENTRE - dead)


@kernel
def deflection(m: Any, i: int, t: float) -> float:
    """Returns the deflection of a stick, -1 to 1; 0 in its dead zone. Up, right and clockwise are positive.

    The stick of pitch is positive when it is pulled, which raises the nose.
    """
    return _within(float(pulse_of(m, i, t)), _DEAD)


@kernel
def tilt(m: Any, i: int, t: float) -> float:
    """Returns the deflection of a stick, -1 to 1, without a dead zone."""
    return _within(float(pulse_of(m, i, t)), 0.0)


@kernel
def opening(m: Any, t: float) -> float:
    """Returns how far the throttle stick is open, 0 to 1."""
    pulse = min(max(float(pulse_of(m, THROTTLE, t)), _LOW), _HIGH)
    return max(pulse - _LOW - _DEAD, 0.0) / (_HIGH - _LOW - _DEAD)

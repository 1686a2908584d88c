"""The pilot's sticks: remote control overrides received by MAVLink, and the demands of the sticks.

RC_CHANNELS_OVERRIDE and MANUAL_CONTROL from the ground station (SYSID_MYGCS) set channels for RC_OVERRIDE_TIME.
Channels without an override have neutral inputs, as in a simulated ArduCopter: centred sticks, and a throttle that is
closed on the ground and in modes flown by throttle, and centred otherwise. SIM_RC_FAIL removes these inputs. Kernels
over the autopilot's record `m`; the modes use the sticks, and a lost radio is handled in `failsafes`.

Not here: simple modes, trims by ear.

Source: ArduPilot, RC_Channel, GCS_MAVLink and ArduCopter (radio, mode: get_pilot_desired_*).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.fields import get_real
from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim.messages import RC_CHANNELS_OVERRIDE_CHAN1_RAW, RC_CHANNELS_OVERRIDE_CHAN9_RAW, decode_manual_control
from cosim.model import record_layout
from cosim.packets import get_u16
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.record.modes import ACRO, DRIFT, STABILIZE
from cosim_models.autopilot.record.parameters import STICK_CHANNELS
from cosim_models.autopilot.record.variables import CHANNELS, VARIABLES

__all__ = [
    "NO_PULSES",
    "by_throttle",
    "channel",
    "curved",
    "deflection",
    "hands_on",
    "hear_manual_control",
    "hear_override",
    "pilot_climb_rate",
    "pilot_climbs",
    "pilot_heading_thrust",
    "pilot_lean",
    "pilot_throttle",
    "pilot_tilt",
    "override_active",
    "pilot_yaw_rate",
    "read_sticks",
    "receiver_pulse",
    "stick_throttle",
    "throttle_open",
    "throttle_zero",
]

NO_PULSES = 1
"""SIM_RC_FAIL: the receiver outputs no pulses."""

_IGNORE, _RELEASE = 65535, 65534
_NO_VALUE = 32767  # of MANUAL_CONTROL
_FOR_EVER = 1e300
_ZERO_TIME = 0.4  # s until a closed throttle counts as closed
_LEAN_MIN = math.radians(10.0)
_LEAN_MAX = math.radians(85.0)
_EXPO_SHARE = 0.375
_CLOSED, _FAILED_THROTTLE = 1000, 950  # us
_SWITCHES = np.array((1800, 1000, 1000, 1800), dtype=np.int64)  # channels 5 to 8, as ArduPilot's simulated receiver

_FIELDS = record_layout(VARIABLES)[0].fields
assert _FIELDS is not None
_RC = int(_FIELDS["RC1_MIN"][1])
_MIN, _TRIM, _MAX, _DZ, _REVERSED = range(5)
_CALIBRATION = 8 * (_REVERSED + 1)  # bytes
assert _FIELDS[f"RC{STICK_CHANNELS}_REVERSED"][1] == _RC + (STICK_CHANNELS - 1) * _CALIBRATION + 8 * _REVERSED


# ---- received overrides --------------------------------------------------------------------------------------------


@kernel
def _override(m: Any, i: int, pulse: int, t: float) -> None:
    """Overrides channel i (from 0) with `pulse` [us]; 0 releases it."""
    m.rc_override[i] = pulse
    m.rc_time[i] = t
    if pulse != 0 and m.RC_OVERRIDE_TIME != 0.0:
        m.rc_until = _FOR_EVER if m.RC_OVERRIDE_TIME < 0.0 else t + m.RC_OVERRIDE_TIME
        m.rc_known = True


@kernel
def hear_override(m: Any, sender: int, t: float) -> None:
    """Handles RC_CHANNELS_OVERRIDE."""
    if sender != m.SYSID_MYGCS:
        return
    for i in range(CHANNELS):
        if i < 8:
            pulse = get_u16(m.received, RC_CHANNELS_OVERRIDE_CHAN1_RAW + 2 * i)
            if pulse != _IGNORE:
                _override(m, i, pulse, t)
        else:
            pulse = get_u16(m.received, RC_CHANNELS_OVERRIDE_CHAN9_RAW + 2 * (i - 8))
            if pulse != 0 and pulse != _IGNORE:
                _override(m, i, 0 if pulse == _RELEASE else pulse, t)
    _heard_station(m, t)


@kernel
def _heard_station(m: Any, t: float) -> None:
    """Counts pilot input as a sign of life of the ground station."""
    m.station_heard = t
    m.station_known = True


@kernel
def _axis(m: Any, number: int, value: int, offset: int, scale: float, t: float) -> None:
    """Applies one axis of MANUAL_CONTROL to channel `number`, scaled to its pulses."""
    if not 1 <= number <= STICK_CHANNELS:
        return
    pulse = 0
    if value != _NO_VALUE and value != -_NO_VALUE:
        low, high = _calibration(m, number, _MIN), _calibration(m, number, _MAX)
        pulse = int(clip(low + (high - low) * (value + offset) / scale, 0.0, 65535.0))
    _override(m, number - 1, pulse, t)


@kernel
def hear_manual_control(m: Any, sender: int, t: float) -> None:
    """Handles MANUAL_CONTROL: x forward, y right, r clockwise, -1000 to 1000; z up, from 0 (closed) to 1000."""
    target, x, y, z, r, _, _, _, _, _, _, _, _, _, _, _ = decode_manual_control(m.received)
    if sender != m.SYSID_MYGCS or target != m.SYSID_THISMAV:
        return
    if z >= 0:
        _axis(m, m.RCMAP_ROLL, y, 1000, 2000.0, t)
        _axis(m, m.RCMAP_PITCH, -x, 1000, 2000.0, t)
        _axis(m, m.RCMAP_THROTTLE, z, 0, 1000.0, t)
        _axis(m, m.RCMAP_YAW, r, 1000, 2000.0, t)
    _heard_station(m, t)


# ---- channels and sticks -------------------------------------------------------------------------------------------


@kernel
def _calibration(m: Any, number: int, what: int) -> float:
    return get_real(m, _RC + _CALIBRATION * (number - 1) + 8 * what)


@kernel
def hands_on(m: Any, t: float) -> bool:
    """Returns whether the pilot controls the sticks, i.e. a channel is overridden."""
    return bool(m.rc_known and t < m.rc_until)


@kernel
def by_throttle(mode: int) -> bool:
    """Returns whether the throttle stick sets the throttle in a mode, and not a climb rate."""
    return mode in (STABILIZE, ACRO, DRIFT)


@kernel
def receiver_pulse(m: Any, number: int) -> int:
    """Returns the neutral pulse [us] of channel `number`, without an override."""
    if m.SIM_RC_FAIL == NO_PULSES:
        return 0
    if number == m.RCMAP_THROTTLE:
        if m.SIM_RC_FAIL == 2:
            return _FAILED_THROTTLE
        if m.on_ground or by_throttle(m.mode):
            return _CLOSED
        return int(0.5 * (_calibration(m, number, _MIN) + _calibration(m, number, _MAX)))
    if number == m.RCMAP_ROLL or number == m.RCMAP_PITCH or number == m.RCMAP_YAW or number <= 4:
        return int(_calibration(m, number, _TRIM))
    return int(_SWITCHES[number - 5]) if number <= STICK_CHANNELS else 0


@kernel
def override_active(m: Any, number: int, t: float) -> bool:
    """Returns whether channel `number` (from 1) is overridden."""
    held = m.RC_OVERRIDE_TIME < 0.0 or t - m.rc_time[number - 1] < m.RC_OVERRIDE_TIME
    return bool(m.rc_override[number - 1] != 0 and held)


@kernel
def channel(m: Any, number: int, t: float) -> int:
    """Returns the pulse [us] of channel `number` (from 1); 0 without a signal."""
    return int(m.rc_override[number - 1]) if override_active(m, number, t) else receiver_pulse(m, number)


@kernel
def deflection(m: Any, number: int, t: float) -> float:
    """Returns the deflection of the stick on channel `number` from its centre, -1 to 1, 0 in the dead zone."""
    pulse = float(channel(m, number, t))
    if pulse == 0.0:
        return 0.0
    centre, zone = _calibration(m, number, _TRIM), _calibration(m, number, _DZ)
    share = 0.0
    if pulse > centre + zone:
        room = _calibration(m, number, _MAX) - centre - zone
        share = (pulse - centre - zone) / room if room > 0.0 else 0.0
    elif pulse < centre - zone:
        room = centre - zone - _calibration(m, number, _MIN)
        share = (pulse - centre + zone) / room if room > 0.0 else 0.0
    if _calibration(m, number, _REVERSED) > 0.0:
        share = -share
    return clip(share, -1.0, 1.0)


@kernel
def _above_least(m: Any, number: int, pulse: float) -> float:
    """Scales a pulse to 0 (end of the dead zone above the minimum) to 1000 (maximum pulse)."""
    low, high = _calibration(m, number, _MIN), _calibration(m, number, _MAX)
    pulse = clip(pulse, low, high)
    if _calibration(m, number, _REVERSED) > 0.0:
        pulse = low + high - pulse
    bottom = low + _calibration(m, number, _DZ)
    return 1000.0 * (pulse - bottom) / (high - bottom) if pulse > bottom and high > bottom else 0.0


@kernel
def _throttle(m: Any, t: float) -> float:
    """Returns the throttle stick position, 0 to 1000."""
    pulse = channel(m, m.RCMAP_THROTTLE, t)
    return _above_least(m, m.RCMAP_THROTTLE, float(pulse)) if pulse != 0 else 0.0


@kernel
def _middle(m: Any) -> float:
    """Returns the centre position of the throttle stick, 1 to 999."""
    number = m.RCMAP_THROTTLE
    return clip(
        _above_least(m, number, 0.5 * (_calibration(m, number, _MIN) + _calibration(m, number, _MAX))), 1.0, 999.0
    )


@kernel
def throttle_open(m: Any, t: float) -> bool:
    """Returns whether the pilot holds the throttle stick above its lower stop."""
    return hands_on(m, t) and _throttle(m, t) > 0.0


@kernel
def throttle_zero(m: Any, t: float) -> bool:
    """Returns whether the throttle has been closed for _ZERO_TIME."""
    return not m.rc_known or t - m.throttle_open_at >= _ZERO_TIME


@kernel
def read_sticks(m: Any, t: float) -> None:
    """Records the stick demands for autonomous modes; required in every step.

    It records whether the throttle is open, which allows an armed vehicle to fly autonomously, and the demands of the
    other sticks.

    Whether the throttle is open, and with it that an armed vehicle may fly by itself; what the other sticks ask for.
    """
    m.pilot_flies = _flies(m, t)
    m.pilot_turn = pilot_yaw_rate(m, t)
    m.pilot_stick[0], m.pilot_stick[1] = 0.0, 0.0
    if m.pilot_flies:
        m.pilot_stick[0] = -deflection(m, m.RCMAP_PITCH, t)
        m.pilot_stick[1] = deflection(m, m.RCMAP_ROLL, t)
    if throttle_open(m, t):
        m.throttle_open_at = t
    if not m.armed:
        return
    if not throttle_zero(m, t):
        m.auto_armed = True
    elif (m.mode == STABILIZE or m.mode == ACRO) and not m.radio_lost:
        m.auto_armed = False


# ---- demands of the sticks -----------------------------------------------------------------------------------------


@kernel
def _flies(m: Any, t: float) -> bool:
    return hands_on(m, t) and not m.radio_lost


@kernel
def pilot_climb_rate(m: Any, t: float) -> float:
    """Returns the climb rate [m/s] demanded by the throttle stick; 0 without pilot input."""
    if not _flies(m, t):
        return 0.0
    stick, middle = _throttle(m, t), _middle(m)
    zone = clip(m.THR_DZ, 0.0, 400.0)
    down = m.PILOT_SPEED_DN if m.PILOT_SPEED_DN > 0.0 else m.PILOT_SPEED_UP
    if stick > middle + zone:
        return float(0.01 * m.PILOT_SPEED_UP * (stick - middle - zone) / (1000.0 - middle - zone))
    if stick < middle - zone:
        return float(0.01 * down * (stick - middle + zone) / (middle - zone))
    return 0.0


@kernel
def pilot_climbs(m: Any, t: float) -> bool:
    """Returns whether the pilot holds the throttle stick at or above its centre."""
    return _flies(m, t) and _throttle(m, t) >= _middle(m) - clip(m.THR_DZ, 0.0, 400.0)


@kernel
def pilot_throttle(m: Any, t: float) -> float:
    """Returns the throttle (0 to 1) demanded by the stick; the centred stick gives the hover throttle."""
    return stick_throttle(m, m.throttle_hover, t)


@kernel
def stick_throttle(m: Any, middle_throttle: float, t: float) -> float:
    """Returns the throttle (0 to 1) demanded by the stick, which is `middle_throttle` at its centre."""
    if not hands_on(m, t):
        return 0.0
    stick, middle = _throttle(m, t), _middle(m)
    share = 0.5 * stick / middle if stick < middle else 0.5 + 0.5 * (stick - middle) / (1000.0 - middle)
    expo = clip((0.5 - middle_throttle) / _EXPO_SHARE, -0.5, 1.0)
    return share * (1.0 - expo) + expo * share * share * share


@kernel
def pilot_yaw_rate(m: Any, t: float) -> float:
    """Returns the yaw rate [rad/s] demanded by the yaw stick."""
    if not _flies(m, t):
        return 0.0
    return math.radians(m.PILOT_Y_RATE) * curved(deflection(m, m.RCMAP_YAW, t), m.PILOT_Y_EXPO)


@kernel
def curved(stick: float, expo: float) -> float:
    """Returns a deflection (-1 to 1) softened about the centre: 0 linear, towards 1 softer; 0.95 and above: linear."""
    return (1.0 - expo) * stick / (1.0 - expo * abs(stick)) if expo < 0.95 else stick


@kernel
def pilot_lean(m: Any, lean_max: float, lean_limit: float, t: float) -> tuple[float, float]:
    """Returns the roll and pitch [rad] demanded by the sticks; see `pilot_heading_thrust`."""
    forward, right = pilot_heading_thrust(m, lean_max, lean_limit, t)
    pitch = -math.atan(forward)
    return math.atan(math.cos(pitch) * right), pitch


@kernel
def pilot_heading_thrust(m: Any, lean_max: float, lean_limit: float, t: float) -> tuple[float, float]:
    """Returns the forward and right thrust demanded by the roll and pitch sticks, relative to the upward thrust.

    A full stick means a lean of `lean_max`; both sticks together lean at most `lean_limit`, at least 10 degrees [rad].
    """
    if not _flies(m, t):
        return 0.0, 0.0
    most = min(lean_max, _LEAN_MAX)
    forward = -math.tan(most * deflection(m, m.RCMAP_PITCH, t))
    right = math.tan(most * deflection(m, m.RCMAP_ROLL, t))
    longest = math.tan(clip(lean_limit, min(_LEAN_MIN, most), most))
    length = math.sqrt(forward * forward + right * right)
    if length > longest:
        forward *= longest / length
        right *= longest / length
    return forward, right


@kernel
def pilot_tilt(m: Any, lean_max: float, lean_limit: float, t: float) -> tuple[float, float]:
    """Returns `pilot_heading_thrust` as north and east, using the heading of the attitude target."""
    forward, right = pilot_heading_thrust(m, lean_max, lean_limit, t)
    q = m.attitude_target
    heading = yaw_from_quaternion((q[0], q[1], q[2], q[3]))
    c, s = math.cos(heading), math.sin(heading)
    return forward * c - right * s, forward * s + right * c

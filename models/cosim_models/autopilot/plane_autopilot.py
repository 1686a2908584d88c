"""The plane autopilot FMU: ArduPlane's modes and MAVLink behaviour for fixed wings.

A fixed wing cannot stop: to hold a place is to circle it, with WP_LOITER_RAD. GUIDED circles its target, LOITER the
place where the mode was entered, RTL home; AUTO flies missions; TAKEOFF climbs straight ahead to TKOFF_ALT and then
circles. Positions come by DO_REPOSITION and MISSION_ITEM with current 2. As in ArduPlane, the message
SET_POSITION_TARGET_GLOBAL_INT changes the height alone, the take-off command is FAILED (it is for VTOL), and landing is
UNSUPPORTED.

Height and speed are controlled together: the throttle follows the sum of the errors of climb and acceleration (total
energy), the pitch their difference (balance of energy). The course follows the vector field around the circle, which
leads straight to its centre from afar. Bank and pitch have proportional loops with rate damping.

Differences from ArduPlane: these loops instead of TECS and L1, no airspeed sensor and no estimate of the wind (airspeed
is taken as the speed over ground), no landing, no pilot, no fail-safes, no fences. Speeds and the radius of circles are
made for the Aerosonde.

Sources: A. A. Lambregts, Vertical flight path and speed control autopilot design using total energy principles, AIAA
83-2239; R. W. Beard, T. W. McLain, Small Unmanned Aircraft, Princeton 2012, chapter 10 (orbits); ArduPilot,
ArduPlane/mode*.cpp and ArduPlane/GCS_MAVLink_Plane.cpp.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, ClassVar

from cosim import Memory, Model
from cosim.frames import euler_from_quaternion, wrap_pi
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_MISSION_START,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MAV_TYPE_FIXED_WING,
    SET_POSITION_TARGET_GLOBAL_INT,
    decode_set_position_target_global_int,
)
from cosim.vehicle import Airframe
from cosim_models.autopilot.gcs.commands import firmware, receiver
from cosim_models.autopilot.gcs.missions import COMMAND, continue_upload, item_place, mission_protocol, tell_reached
from cosim_models.autopilot.gcs.parameters import parameter_protocol
from cosim_models.autopilot.gcs.record import MISSION, angle, pilot_variables, real
from cosim_models.autopilot.gcs.streams import ready, start_streams, stream
from cosim_models.autopilot.gcs.targets import go_to, hold_here, is_place, locate

__all__ = ["PlaneAutopilot"]


class PlaneMode(IntEnum):
    """Modes, by ArduPlane's numbers."""

    MANUAL = 0
    CIRCLE = 1
    AUTO = 10
    RTL = 11
    LOITER = 12
    TAKEOFF = 13
    GUIDED = 15


_MANUAL, _CIRCLE, _AUTO, _RTL, _LOITER, _TAKEOFF, _GUIDED = (int(mode) for mode in PlaneMode)
_GRAVITY = 9.80665
_ONLY_HEIGHT, _NO_HEIGHT = 0x0003, 0x0004  # POSITION_TARGET_TYPEMASK: no latitude and longitude; no height
_FLYING_HEIGHT, _FLYING_SPEED = 1.0, 5.0  # m above home and m/s: beyond them it is in the air
_ROTATION = 0.7  # share of AIRSPEED_CRUISE at which it raises its nose
_FLOWN = (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_UNLIM, MAV_CMD_NAV_RETURN_TO_LAUNCH, MAV_CMD_NAV_TAKEOFF)
_NO_AIRFRAME, _BAD_SYSID, _BAD_GAIN = 1, 2, 3

VARIABLES = pilot_variables(
    (Airframe.plane,),
    PlaneMode.MANUAL,
    (
        real("AIRSPEED_CRUISE", "m/s", 22.0, "speed of flight", 1.0),
        real("AIRSPEED_MIN", "m/s", 18.0, "least speed that may be asked for", 1.0),
        real("AIRSPEED_MAX", "m/s", 35.0, "greatest speed that may be asked for", 1.0),
        real("WP_LOITER_RAD", "m", 80.0, "radius of circles, clockwise", 20.0),
        real("WP_RADIUS", "m", 90.0, "distance at which a waypoint is reached", 1.0),
        angle("ROLL_LIMIT_DEG", 45.0, "greatest bank"),
        angle("PTCH_LIM_MAX_DEG", 20.0, "greatest pitch"),
        angle("PTCH_LIM_MIN_DEG", 25.0, "greatest pitch, nose down; ArduPlane has it negative"),
        real("TRIM_THROTTLE", "%", 40.0, "throttle of level flight"),
        real("THR_MAX", "%", 75.0, "greatest throttle", 1.0),
        real("TECS_CLMB_MAX", "m/s", 5.0, "greatest rate of climb", 0.1),
        real("TECS_SINK_MAX", "m/s", 5.0, "greatest rate of descent", 0.1),
        real("TKOFF_ALT", "m", 50.0, "height above home at which mode TAKEOFF ends", 1.0),
        real("TKOFF_THR_MAX", "%", 40.0, "throttle of the take-off", 1.0),
        angle("TKOFF_LVL_PITCH", 15.0, "pitch of the take-off"),
        real("RTL_ALTITUDE", "m", 100.0, "height above home of the return", 0.0),
    ),
    (
        *MISSION,
        Memory("throttle_trim"),  # integral of the total energy
        Memory("pitch_trim"),  # rad, integral of the energy balance
        Memory("elevator_trim"),
        Memory("speed_before"),  # m/s
        Memory("acceleration"),  # m/s2, filtered
        Memory("runway"),  # rad, course of the take-off
        Memory("rotated", dtype="?"),
    ),
)
_hear_parameter, _continue_list = parameter_protocol(VARIABLES)
_hear_mission = mission_protocol(_FLOWN)


# ---- modes and commands --------------------------------------------------------------------------------------------


@kernel
def _change_mode(m: Any, mode: int, t: float) -> int:
    if mode not in (_MANUAL, _CIRCLE, _AUTO, _RTL, _LOITER, _TAKEOFF, _GUIDED):
        return MAV_RESULT_FAILED
    if mode == m.mode:
        return MAV_RESULT_ACCEPTED
    if mode != _MANUAL and not ready(m, t):
        return MAV_RESULT_FAILED
    if mode == _AUTO:
        if m.mission_count <= 1:
            return MAV_RESULT_FAILED
        if m.mission_current == 0 or m.mission_done:
            m.mission_current = 1
        m.mission_done = False
    m.mode = mode
    m.autonomous = mode != _MANUAL
    m.taking_off = False
    hold_here(m)
    if mode == _TAKEOFF:
        _launch(m, m.home[2] - m.TKOFF_ALT)
    elif mode == _RTL:
        go_to(m, m.home[0], m.home[1], m.home[2] - m.RTL_ALTITUDE)
    return MAV_RESULT_ACCEPTED


@kernel
def _launch(m: Any, down: float) -> None:
    """Begins the take-off along the present heading, up to a down coordinate."""
    go_to(m, m.position[0], m.position[1], down)
    m.taking_off = True
    m.runway = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))[2]


@kernel
def _arm(m: Any, forced: bool, t: float) -> int:
    if not (ready(m, t) or forced):
        return MAV_RESULT_FAILED
    m.armed = True
    m.armed_at = t
    for i in range(3):
        m.home[i] = m.position[i]
    if m.mode == _TAKEOFF:
        _launch(m, m.home[2] - m.TKOFF_ALT)
    return MAV_RESULT_ACCEPTED


@kernel
def _command(m: Any, command: int, p1: float, p2: float, p7: float, t: float) -> int:  # noqa: ARG001
    if command == MAV_CMD_MISSION_START:
        return _change_mode(m, _AUTO, t)
    if command == MAV_CMD_NAV_TAKEOFF:
        return MAV_RESULT_FAILED
    if command == MAV_CMD_DO_CHANGE_SPEED:
        if p1 != 0.0:
            return MAV_RESULT_DENIED
        if not m.AIRSPEED_MIN <= p2 <= m.AIRSPEED_MAX:
            return MAV_RESULT_DENIED
        m.cruise = p2
        return MAV_RESULT_ACCEPTED
    return MAV_RESULT_UNSUPPORTED


@kernel
def _hear(m: Any, message: int, t: float) -> None:  # noqa: ARG001
    """Takes the height of SET_POSITION_TARGET_GLOBAL_INT; everything else is ignored."""
    if message != SET_POSITION_TARGET_GLOBAL_INT:
        return
    _, _, _, frame, mask, _, _, alt, _, _, _, _, _, _, _, _ = decode_set_position_target_global_int(m.received)
    only_height = (mask & _ONLY_HEIGHT) == _ONLY_HEIGHT and (mask & _NO_HEIGHT) == 0
    if only_height and is_place(frame, 0, 0, alt):
        m.guided_position[2] = locate(m, frame, 0, 0, alt)[2]


@kernel
def _other(m: Any, message: int, sender: int, part: int, t: float) -> None:
    if not _hear_parameter(m, message):
        _hear_mission(m, message, sender, part, t)


_receive = receiver(firmware(_GUIDED, _RTL, _change_mode, _arm, _command, _hear, _other))


# ---- flight --------------------------------------------------------------------------------------------------------


@kernel
def _clip(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)


@kernel
def _servos(m: Any, bank: float, pitch: float, throttle: float, h: float) -> None:
    """Commands the deflections for a bank and a pitch [rad], and the throttle."""
    roll, nose, _ = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    p, q, r = float(m.angular_velocity[0]), float(m.angular_velocity[1]), float(m.angular_velocity[2])
    speed = max(math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2), 5.0)
    turn = _GRAVITY * math.tan(_clip(roll, -1.0, 1.0)) / speed  # rad/s of a level turn
    aileron = 1.0 * wrap_pi(bank - roll) - 0.15 * p
    m.elevator_trim = _clip(m.elevator_trim + 0.8 * (pitch - nose) * h, -1.0, 1.0)
    elevator = m.elevator_trim + 2.0 * (pitch - nose) - 0.35 * (q - turn * math.sin(roll))
    rudder = 0.3 * (turn * math.cos(roll) - r)
    m.motor[0] = 0.5 + 0.5 * _clip(aileron, -1.0, 1.0)
    m.motor[1] = 0.5 + 0.5 * _clip(elevator, -1.0, 1.0)
    m.motor[2] = _clip(throttle, 0.0, 1.0)
    m.motor[3] = 0.5 + 0.5 * _clip(rudder, -1.0, 1.0)


@kernel
def _energy(m: Any, climb: float, wanted: float, h: float) -> tuple[float, float]:
    """Returns pitch [rad] and throttle for a rate of climb and a speed [m/s]."""
    speed = max(math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2), 5.0)
    m.acceleration += _clip(h / 0.5, 0.0, 1.0) * ((speed - m.speed_before) / h - m.acceleration)
    m.speed_before = speed
    path = -m.velocity[2] / speed
    path_error = climb / speed - path
    gain_error = _clip(0.5 * (wanted - speed), -2.0, 2.0) / _GRAVITY - m.acceleration / _GRAVITY
    total, balance = path_error + gain_error, path_error - gain_error
    top = 0.01 * m.THR_MAX
    throttle = 0.01 * m.TRIM_THROTTLE + m.throttle_trim + 0.5 * total
    if 0.0 < throttle < top or (throttle >= top) != (total > 0.0):
        m.throttle_trim += 0.15 * total * h
    m.pitch_trim = _clip(m.pitch_trim + 0.3 * balance * h, -0.2, 0.3)
    pitch = climb / speed + m.pitch_trim + 0.4 * balance
    least, most = -math.radians(m.PTCH_LIM_MIN_DEG), math.radians(m.PTCH_LIM_MAX_DEG)
    return _clip(pitch, least, most), _clip(throttle, 0.0, top)


@kernel
def _bank_for(m: Any, course: float, turning: float) -> float:
    """Returns the bank [rad] that turns to a course, beside the rate of turn of a circle [rad/s]."""
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    error = wrap_pi(course - math.atan2(m.velocity[1], m.velocity[0]))
    most = math.radians(m.ROLL_LIMIT_DEG)
    return _clip(math.atan(speed / _GRAVITY * (0.7 * error + turning)), -most, most)


@kernel
def _circle(m: Any, n: float, e: float) -> float:
    """Returns the bank [rad] that leads onto the circle around a place, clockwise, and along it."""
    radius = float(m.WP_LOITER_RAD)
    dn, de = m.position[0] - n, m.position[1] - e
    distance = math.sqrt(dn * dn + de * de)
    miss = (distance - radius) / radius
    course = math.atan2(de, dn) + 0.5 * math.pi + math.atan(2.0 * miss)
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    return _bank_for(m, course, speed / radius / (1.0 + 4.0 * miss * miss))


@kernel
def _fly(m: Any, bank: float, down: float, h: float) -> None:
    """Flies with a bank towards a down coordinate."""
    climb = _clip(0.3 * (m.position[2] - down), -m.TECS_SINK_MAX, m.TECS_CLMB_MAX)
    pitch, throttle = _energy(m, climb, m.cruise if m.cruise > 0.0 else m.AIRSPEED_CRUISE, h)
    _servos(m, bank, pitch, throttle, h)


@kernel
def _take_off(m: Any, h: float) -> None:
    """Accelerates along the runway, rotates and climbs straight ahead up to the target's height."""
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    m.rotated = m.rotated or speed > _ROTATION * m.AIRSPEED_CRUISE
    bank = _bank_for(m, m.runway, 0.0) if m.rotated else 0.0
    pitch = math.radians(m.TKOFF_LVL_PITCH) if m.rotated else 0.0
    _servos(m, _clip(bank, -0.3, 0.3), pitch, 0.01 * m.TKOFF_THR_MAX, h)
    if m.position[2] <= m.guided_position[2] + 0.5 * m.TECS_CLMB_MAX:
        m.taking_off = False
        m.speed_before = speed
        m.acceleration = 0.0


@kernel
def _carry_out(m: Any, h: float) -> None:
    """Carries the mission out; at its end, it circles the last place."""
    row = m.mission_current
    if m.mission_done or row >= m.mission_count:
        m.mission_done = True
        _fly(m, _circle(m, m.guided_position[0], m.guided_position[1]), m.guided_position[2], h)
        return
    command = int(m.mission[row, COMMAND])
    if command == MAV_CMD_NAV_TAKEOFF:
        _, _, d = item_place(m, row)
        if m.on_ground and not m.taking_off:
            _launch(m, d)
        if m.taking_off:
            _take_off(m, h)
        if not m.taking_off:
            tell_reached(m, row)
            m.mission_current += 1
        return
    n, e, d = m.home[0], m.home[1], m.home[2] - m.RTL_ALTITUDE
    if command != MAV_CMD_NAV_RETURN_TO_LAUNCH:
        n, e, d = item_place(m, row)
    go_to(m, n, e, d)
    if command != MAV_CMD_NAV_WAYPOINT:
        _fly(m, _circle(m, n, e), d, h)
        return
    dn, de = n - m.position[0], e - m.position[1]
    _fly(m, _bank_for(m, math.atan2(de, dn), 0.0), d, h)
    if dn * dn + de * de < m.WP_RADIUS * m.WP_RADIUS:
        tell_reached(m, row)
        m.mission_current += 1


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def _rest(m: Any) -> None:
    m.motor[0], m.motor[1], m.motor[2], m.motor[3] = 0.5, 0.5, 0.0, 0.5


@kernel
def start(m: Any) -> int:
    """Starts disarmed on the ground, in MANUAL."""
    if m.airframe != Airframe.plane:
        return _NO_AIRFRAME
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.AIRSPEED_CRUISE, m.WP_LOITER_RAD) <= 0.0:
        return _BAD_GAIN
    m.kind = MAV_TYPE_FIXED_WING
    m.on_ground = True
    m.mission_count = 1
    m.item_since = -1.0
    for i in range(3):
        m.home[i] = m.position[i]
    _rest(m)
    start_streams(m)
    hold_here(m)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """Makes one step: inputs at t, commands for t + h."""
    m.mavlink_tx_len = 0
    if m.mavlink_rx_len > 0:
        _receive(m, t)
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    if not m.armed:
        for i in range(3):
            m.home[i] = m.position[i]
        m.rotated, m.elevator_trim = False, 0.0
    m.on_ground = m.home[2] - m.position[2] < _FLYING_HEIGHT and speed < _FLYING_SPEED
    if not m.armed or m.mode == _MANUAL:
        _rest(m)
    elif m.taking_off and m.mode != _AUTO:
        _take_off(m, h)
    elif m.mode == _AUTO:
        _carry_out(m, h)
    elif m.on_ground:
        _rest(m)
    else:
        _fly(m, _circle(m, m.guided_position[0], m.guided_position[1]), m.guided_position[2], h)
    for i in range(3):
        m.target[i] = m.guided_position[i]
        m.desired_position[i] = m.guided_position[i]
        m.desired_velocity[i] = m.velocity[i]
    if m.uploading:
        continue_upload(m, t)
    if m.listed >= 0:
        _continue_list(m)
    stream(m, t)
    return 0


class PlaneAutopilot(Model):
    """Autopilot of fixed wings with ArduPlane's modes and MAVLink behaviour."""

    step_size = 0.0125
    variables = VARIABLES
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_AIRFRAME: "it flies vehicles of the airframe plane; others need another autopilot",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _BAD_GAIN: "AIRSPEED_CRUISE and WP_LOITER_RAD must be positive",
    }

"""Reception of targets: SET_POSITION_TARGET_*, SET_ATTITUDE_TARGET, DO_REPOSITION, mission items with current 2 or 3.

Targets count in GUIDED only and are not answered, except DO_REPOSITION and mission items. A target beyond an enabled
fence is refused, as ArduCopter refuses it. A point whose height is above the terrain is flown to along the terrain;
elsewhere, such heights become heights above the terrain at the place. Kernels over the autopilot's record `m`.

Sources: MAVLink common.xml; ArduPilot, GCS_MAVLink_Copter and ArduCopter mode_guided.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import local_from_geodetic, radians_from_deg_e7, yaw_from_quaternion
from cosim.kernel import kernel
from cosim.messages import (
    ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE,
    ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE,
    ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE,
    ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE,
    ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE,
    MAV_DO_REPOSITION_FLAGS_CHANGE_MODE,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    POSITION_TARGET_TYPEMASK_FORCE_SET,
    POSITION_TARGET_TYPEMASK_YAW_IGNORE,
    POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
    decode_set_attitude_target,
    decode_set_position_target_global_int,
    decode_set_position_target_local_ned,
    get_set_attitude_target_q,
)
from cosim_models.autopilot.commander.mode_requests import change_mode
from cosim_models.autopilot.control.shaping import clip, wrap_pi
from cosim_models.autopilot.flight.angles import guide_angle, level_out
from cosim_models.autopilot.flight.guided import (
    guide_acceleration,
    guide_position,
    guide_position_velocity,
    guide_stop,
    guide_velocity,
)
from cosim_models.autopilot.flight.yaw import turn_at, turn_by, turn_from
from cosim_models.autopilot.link.statustext import FRAME_UNKNOWN, INFO, say
from cosim_models.autopilot.mission.fences import permits
from cosim_models.autopilot.mission.terrain import terrain_above_origin
from cosim_models.autopilot.record.modes import GUIDED, GUIDED_NOGPS, POSITION

__all__ = [
    "altitude_reference",
    "hear_attitude_target",
    "hear_global_target",
    "hear_guided_item",
    "hear_local_target",
    "is_place",
    "locate",
    "reposition",
]

# Sums of POSITION_TARGET_TYPEMASK_X_IGNORE and the like.
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION = 0x007, 0x038, 0x1C0
_ABSOLUTE, _RELATIVE, _TERRAIN = 0, 1, 2
_FASTEST = 1000.0  # m/s; greater velocities are not taken for velocities
_UNIT = 1e-3  # greatest difference of the length of a unit quaternion from one
_NO_RATES = (
    ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    + ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
    + ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
)
_THRUST_AS_THRUST = 8  # GUID_OPTIONS


@kernel
def altitude_reference(m: Any, frame: int) -> int:
    """Returns the reference of altitudes in a MAV_FRAME: sea, home or terrain; -1, with a text, if not supported."""
    if frame == 0 or frame == 5:
        return _ABSOLUTE
    if frame == 3 or frame == 6:
        return _RELATIVE
    if frame == 10 or frame == 11:
        return _TERRAIN
    say(m, INFO, FRAME_UNKNOWN, frame)
    return -1


@kernel
def locate(m: Any, lat: int, lon: int, altitude: float, reference: int) -> tuple[float, float, float]:
    """Returns north, east and up of a position in degE7 and m."""
    n, e, d = local_from_geodetic(
        radians_from_deg_e7(lat), radians_from_deg_e7(lon), altitude, m.origin_latitude, m.origin_longitude, 0.0
    )
    if reference == _ABSOLUTE:
        return n, e, -d - m.origin_altitude
    if reference == _TERRAIN:
        return n, e, terrain_above_origin(m, n, e) - d
    return n, e, m.home_neu[2] - d


@kernel
def is_place(lat: int, lon: int) -> bool:
    """Returns whether latitude and longitude [degE7] are on the globe."""
    return abs(lat) <= 900000000 and abs(lon) <= 1800000000


@kernel
def reposition(m: Any, frame: int, flags: float, lat: int, lon: int, altitude: float, t: float) -> int:
    """Handles DO_REPOSITION; returns a MAV_RESULT."""
    change = 0.0 <= flags < 16777216.0 and (int(flags) & MAV_DO_REPOSITION_FLAGS_CHANGE_MODE) != 0
    if m.mode != GUIDED and not change:
        return MAV_RESULT_DENIED
    reference = altitude_reference(m, frame)
    if reference < 0 or not is_place(lat, lon) or (lat == 0 and lon == 0) or not math.isfinite(altitude):
        return MAV_RESULT_DENIED
    n, e, u = locate(m, lat, lon, altitude, reference)
    if not permits(m, n, e, u - m.home_neu[2]):
        return MAV_RESULT_FAILED
    if m.mode != GUIDED and change_mode(m, GUIDED, t) != MAV_RESULT_ACCEPTED:
        return MAV_RESULT_FAILED
    above = reference == _TERRAIN
    if not guide_position(m, n, e, altitude if above else u, above, t):
        return MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED


@kernel
def _set_nose(m: Any, mask: int, yaw: float, yaw_rate: float, relative: bool) -> None:
    """Selects the heading that a target demands; without one, the default of `guide_*` remains."""
    with_rate = (mask & POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE) == 0 and math.isfinite(yaw_rate)
    if (mask & POSITION_TARGET_TYPEMASK_YAW_IGNORE) == 0 and math.isfinite(yaw):
        if relative:
            turn_by(m, yaw, 0.0, 0.0, True)
        else:
            turn_from(m, wrap_pi(yaw), yaw_rate if with_rate else 0.0)
    elif with_rate:
        turn_at(m, yaw_rate)


@kernel
def _guide(
    m: Any,
    mask: int,
    n: float,
    e: float,
    u: float,
    above: bool,
    vn: float,
    ve: float,
    vu: float,
    an: float,
    ae: float,
    au: float,
    yaw: float,
    yaw_rate: float,
    relative: bool,
    t: float,
) -> None:
    """Applies a target of SET_POSITION_TARGET_*, in local axes; unsupported combinations stop the vehicle.

    `above`: the height is one above the terrain.
    """
    position = (mask & _NO_POSITION) == 0
    velocity = (mask & _NO_VELOCITY) == 0
    acceleration = (mask & _NO_ACCELERATION) == 0
    total = 0.0
    if position:
        total += n + e + u
    if velocity:
        total += vn + ve + vu
    if acceleration:
        total += an + ae + au
    if not math.isfinite(total) or (acceleration and (mask & POSITION_TARGET_TYPEMASK_FORCE_SET) != 0):
        guide_stop(m, t)
        return
    if velocity and max(abs(vn), abs(ve), abs(vu)) > _FASTEST:
        guide_stop(m, t)
        return
    if position and velocity and above:  # as in ArduCopter
        guide_stop(m, t)
        return
    up = u + terrain_above_origin(m, n, e) if above else u
    if position and (velocity or not acceleration) and not permits(m, n, e, up - m.home_neu[2]):
        return
    if not acceleration:
        an, ae, au = 0.0, 0.0, 0.0
    if position and velocity:
        guide_position_velocity(m, t)
        m.guided_position_neu[0], m.guided_position_neu[1], m.guided_position_neu[2] = n, e, u
    elif velocity:
        guide_velocity(m, vn, ve, vu, t)
    elif acceleration and not position:
        guide_acceleration(m, an, ae, au, t)
    elif position and not acceleration:
        if not guide_position(m, n, e, u, above, t):
            return
    else:
        guide_stop(m, t)
        return
    if velocity:
        m.guided_velocity_neu[0], m.guided_velocity_neu[1], m.guided_velocity_neu[2] = vn, ve, vu
        m.guided_acceleration_neu[0], m.guided_acceleration_neu[1], m.guided_acceleration_neu[2] = an, ae, au
    _set_nose(m, mask, yaw, yaw_rate, relative)


@kernel
def hear_local_target(m: Any, t: float) -> None:
    """Handles SET_POSITION_TARGET_LOCAL_NED."""
    _, _, _, frame, mask, x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate = decode_set_position_target_local_ned(
        m.received
    )
    if m.mode != GUIDED:
        return
    if not (frame == 1 or 7 <= frame <= 9):
        guide_stop(m, t)
        return
    body = frame >= 8
    if body:
        heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
        c, s = math.cos(heading), math.sin(heading)
        x, y = x * c - y * s, x * s + y * c
        vx, vy = vx * c - vy * s, vx * s + vy * c
        ax, ay = ax * c - ay * s, ax * s + ay * c
    up = -z
    if frame != 1:
        x, y, up = x + m.position_neu[0], y + m.position_neu[1], up + m.position_neu[2]
    _guide(m, mask, x, y, up, False, vx, vy, -vz, ax, ay, -az, yaw, yaw_rate, body, t)


@kernel
def hear_global_target(m: Any, t: float) -> None:
    """Handles SET_POSITION_TARGET_GLOBAL_INT."""
    _, _, _, frame, mask, lat, lon, alt, vx, vy, vz, ax, ay, az, yaw, yaw_rate = decode_set_position_target_global_int(
        m.received
    )
    if m.mode != GUIDED:
        return
    n, e, u, above = 0.0, 0.0, 0.0, False
    if (mask & _NO_POSITION) == 0:
        reference = altitude_reference(m, frame)
        if reference < 0 or not is_place(lat, lon):
            guide_stop(m, t)
            return
        n, e, u = locate(m, lat, lon, alt, reference)
        above = reference == _TERRAIN
        u = alt if above else u
    _guide(m, mask, n, e, u, above, vx, vy, -vz, ax, ay, -az, yaw, yaw_rate, False, t)


@kernel
def hear_guided_item(m: Any, current: int, frame: int, lat: float, lon: float, z: float, t: float) -> bool:
    """Handles MISSION_ITEM with current 2, a GUIDED target, or 3, a height; positions in 1e-7 degrees.

    Returns whether it is accepted.
    """
    reference = altitude_reference(m, frame)
    if m.mode != GUIDED or reference < 0 or not math.isfinite(z):
        return False
    if current == 3:
        n, e = m.desired_position_neu[0], m.desired_position_neu[1]
        if m.submode == POSITION:
            n, e = m.guided_position_neu[0], m.guided_position_neu[1]
        u = z + m.home_neu[2]
        if reference == _TERRAIN:
            u = z + terrain_above_origin(m, n, e)
        elif reference == _ABSOLUTE:
            u = z - m.origin_altitude
    else:
        if not (abs(lat) <= 9e8 and abs(lon) <= 1.8e9):
            return False
        n, e, u = locate(m, int(lat), int(lon), z, reference)
    if not permits(m, n, e, u - m.home_neu[2]):
        return False
    above = reference == _TERRAIN
    return guide_position(m, n, e, z if above else u, above, t)


# ---- attitudes -----------------------------------------------------------------------------------------------------


@kernel
def _climb_or_throttle(m: Any, thrust: float) -> float:
    """Returns the throttle, or the climb rate [m/s]: none at 0.5, to WPNAV_SPEED_UP at 1 and WPNAV_SPEED_DN at 0."""
    if (m.GUID_OPTIONS & _THRUST_AS_THRUST) != 0:
        return clip(thrust, -1.0, 1.0)
    share = 2.0 * (clip(thrust, 0.0, 1.0) - 0.5)
    return float(share * 0.01 * (m.WPNAV_SPEED_UP if share > 0.0 else m.WPNAV_SPEED_DN))


@kernel
def hear_attitude_target(m: Any, t: float) -> None:
    """Handles SET_ATTITUDE_TARGET; one without throttle, or with a part of the rates only, stops the vehicle."""
    _, _, _, mask, roll_rate, pitch_rate, yaw_rate, thrust = decode_set_attitude_target(m.received)
    if m.mode != GUIDED and m.mode != GUIDED_NOGPS:
        return
    free = (mask & ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE) != 0
    without_rates = mask & _NO_RATES
    length = 1.0
    if not free:
        length = 0.0
        for i in range(4):
            length += get_set_attitude_target_q(m.received, i) ** 2
        length = math.sqrt(length)
    known = math.isfinite(thrust) and (without_rates != 0 or math.isfinite(roll_rate + pitch_rate + yaw_rate))
    if (
        (mask & ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE) != 0
        or not abs(length - 1.0) <= _UNIT
        or (without_rates != 0 and without_rates != _NO_RATES)
        or not known
    ):
        if m.mode == GUIDED:
            guide_stop(m, t)
        else:
            level_out(m)
        return
    guide_angle(m, (m.GUID_OPTIONS & _THRUST_AS_THRUST) != 0, t)
    m.angle_free = free
    if not free:
        for i in range(4):
            m.angle_q[i] = get_set_attitude_target_q(m.received, i) / length
    with_rates = without_rates == 0
    m.angle_rates[0] = roll_rate if with_rates else 0.0
    m.angle_rates[1] = pitch_rate if with_rates else 0.0
    m.angle_rates[2] = yaw_rate if with_rates else 0.0
    m.angle_climb = _climb_or_throttle(m, thrust)

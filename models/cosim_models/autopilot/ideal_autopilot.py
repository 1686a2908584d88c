"""The ideal autopilot FMU: ArduCopter's modes and MAVLink behaviour for a point mass.

There is no attitude, no mixer and no throttle: the autopilot commands accelerations, which the vehicle takes on at
once. Within its limits, its answer to a position target is a linear system of second order, with the natural frequency
sqrt(PSC_POSXY_P PSC_VELXY_P); farther away, ArduPilot's square-root controller limits speed and deceleration.

Differences from `Autopilot`: one link, twelve kinds of telemetry, no AUTO (there are no missions), no pilot, no
fail-safes, no fences. Mode changes that `Autopilot` would accept and this one cannot fly are refused (FAILED).

Source: ArduPilot, AC_PosControl (gains, defaults), ModeGuided, ModeLand, ModeRTL.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, ClassVar

from cosim import Memory, Model
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_TAKEOFF,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MAV_TYPE_QUADROTOR,
    SET_POSITION_TARGET_LOCAL_NED,
)
from cosim.vehicle import POINT_MASS_ACCELERATION, Airframe
from cosim_models.autopilot.gcs.commands import firmware, receiver
from cosim_models.autopilot.gcs.parameters import parameter_protocol
from cosim_models.autopilot.gcs.record import (
    ACCELERATION,
    HOLD,
    POSITION,
    POSITION_VELOCITY,
    VELOCITY,
    pilot_variables,
    real,
)
from cosim_models.autopilot.gcs.sending import can_answer
from cosim_models.autopilot.gcs.streams import ready, start_streams, stream
from cosim_models.autopilot.gcs.targets import global_target, go_to, hold_here, home_here, local_target
from cosim_models.autopilot.guidance import GUIDANCE, acceleration_to, approach, climb_to

__all__ = ["IdealAutopilot"]


class CopterMode(IntEnum):
    """Modes, by ArduCopter's numbers."""

    STABILIZE = 0
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9


_STABILIZE, _GUIDED, _LOITER, _RTL, _LAND = (int(mode) for mode in CopterMode)
_ARMING_DELAY = 2.0  # s between arming and the motors, as in ArduCopter
_GUIDED_TIMEOUT = 3.0  # s, GUID_TIMEOUT
_LAND_LOW = 10.0  # m, LAND_ALT_LOW
_REACHED = 0.1  # m below the end of the take-off
_ARRIVED = 2.0  # m, horizontally, WPNAV_RADIUS
_LANDED_SPEED, _LANDED_TIME = 0.05, 1.0  # m/s and s: slower than commanded for so long is landed
_NO_AIRFRAME, _BAD_SYSID, _BAD_GAIN = 1, 2, 3

VARIABLES = pilot_variables(
    (Airframe.point_mass,),
    CopterMode.STABILIZE,
    (
        *GUIDANCE,
        real("LAND_SPEED", "cm/s", 50.0, "of the descent below 10 m"),
        real("RTL_ALT", "cm", 1500.0, "height above home of the return, if it is not higher already"),
    ),
    (
        Memory("still_since"),  # s: since when a descent does not move the vehicle; -1: it does
        Memory("returned", dtype="?"),  # RTL is above home
    ),
)
_hear_parameter, _continue_list = parameter_protocol(VARIABLES)


# ---- modes and commands --------------------------------------------------------------------------------------------


@kernel
def _change_mode(m: Any, mode: int, t: float) -> int:
    if mode not in (_STABILIZE, _GUIDED, _LOITER, _RTL, _LAND):
        return MAV_RESULT_FAILED
    if mode == m.mode:
        return MAV_RESULT_ACCEPTED
    if m.armed and mode != _STABILIZE and mode != _LAND and not ready(m, t):
        return MAV_RESULT_FAILED
    m.mode = mode
    m.autonomous = mode != _STABILIZE
    m.returned = False
    m.still_since = -1.0
    hold_here(m)
    return MAV_RESULT_ACCEPTED


@kernel
def _arm(m: Any, forced: bool, t: float) -> int:
    if m.mode == _LAND or m.mode == _RTL or not (ready(m, t) or forced):
        return MAV_RESULT_FAILED
    m.armed = True
    m.armed_at = t
    home_here(m)
    return MAV_RESULT_ACCEPTED


@kernel
def _command(m: Any, command: int, p1: float, p2: float, p7: float, t: float) -> int:
    if command == MAV_CMD_NAV_TAKEOFF:
        if not (m.mode == _GUIDED and m.armed and m.on_ground and p7 > 0.0) or m.taking_off:
            return MAV_RESULT_FAILED
        go_to(m, m.position[0], m.position[1], m.home[2] - p7)
        m.taking_off = True
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_NAV_LAND:
        return _change_mode(m, _LAND, t)
    if command == MAV_CMD_DO_CHANGE_SPEED:
        if not p2 > 0.0 or not math.isfinite(p2):
            return MAV_RESULT_FAILED
        if p1 <= 1.0:
            m.cruise = p2
        elif p1 == 2.0:
            m.WPNAV_SPEED_UP = 100.0 * p2
        else:
            m.WPNAV_SPEED_DN = 100.0 * p2
        return MAV_RESULT_ACCEPTED
    return MAV_RESULT_UNSUPPORTED


@kernel
def _hear(m: Any, message: int, t: float) -> None:
    """Handles targets, which are ignored on the ground, as ArduCopter ignores them."""
    if m.on_ground:
        return
    if message == SET_POSITION_TARGET_LOCAL_NED:
        local_target(m, t)
    else:
        global_target(m, t)


@kernel
def _other(m: Any, message: int, sender: int, part: int, t: float) -> None:  # noqa: ARG001
    _hear_parameter(m, message)


_receive = receiver(firmware(_GUIDED, _RTL, _change_mode, _arm, _command, _hear, _other))


# ---- guidance ------------------------------------------------------------------------------------------------------


@kernel
def _descend(m: Any, t: float) -> None:
    """Lands where it is, and disarms on the ground."""
    height = m.home[2] - m.position[2]
    m.desired_velocity[2] = 0.01 * (m.LAND_SPEED if height < _LAND_LOW else m.WPNAV_SPEED_DN)
    if m.velocity[2] > _LANDED_SPEED:
        m.still_since = -1.0
    elif m.still_since < 0.0:
        m.still_since = t
    elif t - m.still_since >= _LANDED_TIME:
        m.on_ground = True
        m.armed = False


@kernel
def _return(m: Any, t: float) -> None:
    """Climbs, flies home and lands."""
    if m.returned:
        approach(m, m.home[0], m.home[1])
        _descend(m, t)
        return
    height = min(m.home[2] - 0.01 * m.RTL_ALT, m.guided_position[2])
    climb_to(m, height)
    if m.position[2] < height + 0.5:
        approach(m, m.home[0], m.home[1])
        n, e = m.home[0] - m.position[0], m.home[1] - m.position[1]
        m.returned = n * n + e * e < _ARRIVED * _ARRIVED
        m.still_since = -1.0


@kernel
def _guide(m: Any, t: float) -> None:
    """Follows the target of GUIDED, and ends the take-off."""
    kind = m.guided_kind
    if (kind in (VELOCITY, ACCELERATION)) and t - m.guided_time > _GUIDED_TIMEOUT:
        hold_here(m)
        kind = m.guided_kind
    if kind in (VELOCITY, POSITION_VELOCITY):
        for i in range(3):
            m.desired_velocity[i] = m.guided_velocity[i]
    elif kind == ACCELERATION:
        for i in range(3):
            m.desired_velocity[i] = m.velocity[i]
    if kind in (POSITION, POSITION_VELOCITY, HOLD):
        approach(m, m.guided_position[0], m.guided_position[1])
        climb_to(m, m.guided_position[2])
    if m.taking_off and m.position[2] <= m.guided_position[2] + _REACHED:
        m.taking_off = False


@kernel
def _accelerate(m: Any, i: int, command: float) -> None:
    m.motor[i] = 0.5 + 0.5 * min(max(command / POINT_MASS_ACCELERATION, -1.0), 1.0)


@kernel
def _act(m: Any) -> None:
    """Commands the acceleration that leads to the desired velocity, within the limits."""
    given = m.mode == _GUIDED and (m.guided_kind == ACCELERATION or m.guided_kind == VELOCITY)
    north, east, down = acceleration_to(m, m.guided_acceleration, given)
    _accelerate(m, 0, north)
    _accelerate(m, 1, east)
    _accelerate(m, 2, down)
    m.motor[3] = 1.0


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Starts disarmed on the ground, in STABILIZE."""
    if m.airframe != Airframe.point_mass:
        return _NO_AIRFRAME
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.PSC_POSXY_P, m.PSC_POSZ_P, m.WPNAV_ACCEL, m.WPNAV_ACCEL_Z) <= 0.0:
        return _BAD_GAIN
    m.kind = MAV_TYPE_QUADROTOR
    m.on_ground = True
    home_here(m)
    start_streams(m)
    hold_here(m)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Makes one step: inputs at t, commands for t + h."""
    m.mavlink_tx_len = 0
    if m.mavlink_rx_len > 0:
        _receive(m, t)
    if not m.armed:
        home_here(m)
    for i in range(3):
        m.desired_velocity[i] = 0.0
    flies = m.armed and t - m.armed_at >= _ARMING_DELAY - 1e-9 and not (m.on_ground and not m.taking_off)
    if flies:
        m.on_ground = False
        if m.mode == _GUIDED:
            _guide(m, t)
        elif m.mode == _RTL:
            _return(m, t)
        elif m.mode == _LAND:
            _descend(m, t)
        else:
            approach(m, m.guided_position[0], m.guided_position[1])
            climb_to(m, m.guided_position[2])
    if flies and m.armed:
        _act(m)
    else:
        for i in range(4):
            m.motor[i] = 0.0
        if m.armed and m.on_ground and (m.mode == _LAND or m.mode == _RTL):
            m.armed = False
    placed = m.guided_kind != VELOCITY and m.guided_kind != ACCELERATION
    for i in range(3):
        m.target[i] = m.guided_position[i] if placed else m.position[i]
        m.desired_position[i] = m.target[i]
    if m.listed >= 0 and can_answer(m):
        _continue_list(m)
    stream(m, t)
    return 0


class IdealAutopilot(Model):
    """Autopilot of a point mass with ArduCopter's modes and MAVLink behaviour."""

    step_size = 0.0125
    variables = VARIABLES
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_AIRFRAME: "it flies vehicles of the airframe point_mass; others need another autopilot",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _BAD_GAIN: "PSC_POSXY_P, PSC_POSZ_P, WPNAV_ACCEL and WPNAV_ACCEL_Z must be positive",
    }

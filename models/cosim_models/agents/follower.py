"""Following another vehicle as ArduCopter's mode FOLLOW does, with the gains of AP_Follow.

The desired velocity is the leader's velocity plus `FOLL_POS_P` times the vector to the drone's place, which is
`FOLL_OFS` away from the leader in north, east, down or turned with the leader's course (`FOLL_OFS_TYPE`). As in
ArduPilot, the speed is limited to the speed from which the drone can stop at its place with half of the acceleration
(the square root controller). A drone therefore lags behind its place by the distance at which this limit equals the
leader's speed v: v / P up to a / P, beyond v^2 / 2 a + a / 2 P^2.

Heights follow the same law. A leader that is farther away than FOLL_DIST_MAX, or not heard, is not followed: the drone
stays. The course is the direction of the leader's velocity, whereas ArduPilot uses the leader's heading. FOLL_OFS 0, 0,
0 selects the offset at the beginning.

Source: ArduPilot, ArduCopter/mode_follow.cpp, libraries/AP_Follow and AC_Avoid::get_max_speed.
"""

from __future__ import annotations

from enum import IntEnum
from math import sqrt
from typing import Any

from cosim import Memory, Model, Output, Parameter
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables
from cosim_models.agents.parts.guard import sqrt_controller

__all__ = ["Follower", "OffsetType", "follow"]


class OffsetType(IntEnum):
    """The axes of FOLL_OFS."""

    north_east_down = 0
    relative = 1
    """to the course of the leader: forward, right, down"""


_RELATIVE = int(OffsetType.relative)
_SLOW = 0.5  # m/s; at lower speeds, the leader's last course applies


@kernel
def _offset(m: Any, k: int) -> tuple[float, float, float]:
    """Returns the offset of the drone's place from the leader: north, east, down [m]."""
    if m.FOLL_OFS_X == 0.0 and m.FOLL_OFS_Y == 0.0 and m.FOLL_OFS_Z == 0.0:
        if not m.met:
            m.met = True
            for i in range(3):
                m.first_offset[i] = m.position[i] - m.near_position[k, i]
        return m.first_offset[0], m.first_offset[1], m.first_offset[2]
    if m.FOLL_OFS_TYPE != _RELATIVE:
        return m.FOLL_OFS_X, m.FOLL_OFS_Y, m.FOLL_OFS_Z
    speed = sqrt(m.near_velocity[k, 0] * m.near_velocity[k, 0] + m.near_velocity[k, 1] * m.near_velocity[k, 1])
    if speed > _SLOW:
        m.course[0], m.course[1] = m.near_velocity[k, 0] / speed, m.near_velocity[k, 1] / speed
    north, east = m.course[0], m.course[1]
    return m.FOLL_OFS_X * north - m.FOLL_OFS_Y * east, m.FOLL_OFS_X * east + m.FOLL_OFS_Y * north, m.FOLL_OFS_Z


@kernel
def follow(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the velocity: the leader's velocity plus P times the vector to the drone's place."""
    m.place_error = -1.0
    for k in range(m.neighbours):
        if m.near_id[k] != m.FOLL_SYSID or m.near_distance[k] > m.FOLL_DIST_MAX:
            continue
        north, east, down = _offset(m, k)
        north += m.near_position[k, 0] - m.position[0]
        east += m.near_position[k, 1] - m.position[1]
        down += m.near_position[k, 2] - m.position[2]
        v_n, v_e = m.near_velocity[k, 0] + m.FOLL_POS_P * north, m.near_velocity[k, 1] + m.FOLL_POS_P * east
        v_d = m.near_velocity[k, 2] + m.FOLL_POS_P * down
        most = sqrt_controller(sqrt(north * north + east * east), m.approach_p, m.braking)
        speed = sqrt(v_n * v_n + v_e * v_e)
        if speed > most:
            v_n, v_e = v_n * most / speed, v_e * most / speed
        most = sqrt_controller(abs(down), m.approach_p, m.braking_vertical)
        m.setpoint_velocity[0], m.setpoint_velocity[1] = v_n, v_e
        m.setpoint_velocity[2] = min(max(v_d, -most), most)
        m.place_error = sqrt(north * north + east * east + down * down)
    return VELOCITY


class Follower(Model):
    """Follows another vehicle, as ArduCopter's mode FOLLOW does."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(neighbours=4),
        Parameter("FOLL_SYSID", type=int, start=1, minimum=1, maximum=255, description="system id of the leader"),
        Parameter("FOLL_OFS_TYPE", type=OffsetType, start=OffsetType.north_east_down, description="axes of FOLL_OFS"),
        Parameter("FOLL_OFS_X", unit="m", start=0.0, description="north or forward; all 0: as it begins"),
        Parameter("FOLL_OFS_Y", unit="m", start=0.0, description="east or right"),
        Parameter("FOLL_OFS_Z", unit="m", start=0.0, description="down"),
        Parameter("FOLL_DIST_MAX", unit="m", start=100.0, minimum=0.0, description="at which it no longer follows"),
        Parameter("FOLL_POS_P", unit="1/s", start=0.1, minimum=0.0, description="velocity per way to its place"),
        Parameter(
            "approach_p", unit="1/s", start=1.0, minimum=1e-3, description="ArduCopter's PSC_POSXY_P, PSC_POSZ_P"
        ),
        Parameter("braking", unit="m/s2", start=1.25, minimum=1e-3, description="half of WPNAV_ACCEL"),
        Parameter("braking_vertical", unit="m/s2", start=0.5, minimum=1e-3, description="half of WPNAV_ACCEL_Z"),
        Output("place_error", unit="m", start=-1.0, description="distance to its place; -1: it follows nobody"),
        Memory("course", shape=2),  # of the leader, a unit vector
        Memory("first_offset", shape=3),  # m
        Memory("met", dtype="?"),
    )
    kernels = agent_kernels(follow)
    errors = ERRORS

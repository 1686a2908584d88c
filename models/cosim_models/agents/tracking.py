"""Tracking of a moving target: the drones circle it clockwise, evenly distributed, as it moves.

The target is any vehicle that is heard; when it is not, it is assumed to move on for `memory` seconds. With the
distance r from the target and the radius R of the circle, the velocity relative to it is that of the vector field of
the source, for a speed s:

    inwards  s (r^2 - R^2) / (r^2 + R^2)        clockwise  s 2 r R / (r^2 + R^2)

so r approaches R from everywhere, without overshooting: s t = r0 - r + R [ln((r + R) / (r - R))] from r0 to r. On the
circle, a drone with the angles g and b to the next drone ahead and behind turns at speed / R + phase_gain (g - b) / 2.
With N drones, the angles become equal at the rate phase_gain (1 - cos(2 pi / N)), the slowest of a ring. A vehicle
whose velocity lags by `response` would fly outside of the circle: the centripetal acceleration during that time is
added.

Source: E. W. Frew, D. A. Lawrence, S. Morris, Coordinated standoff tracking of moving targets using Lyapunov guidance
vector fields, J. Guidance, Control and Dynamics 31 (2008); equal angles: consensus on a ring (Ren and Beard 2008).
"""

from __future__ import annotations

from math import atan2, pi, sqrt
from typing import Any

from cosim import Memory, Model, Output, Parameter
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables

__all__ = ["TargetTracking", "track"]

_ON_THE_GROUND = 1.0  # m above the own home: lower neighbours do not circle


@kernel
def _see_target(m: Any, t: float, h: float) -> bool:
    """Updates where the target is; returns whether that is known."""
    for i in range(2):
        m.target_position[i] += h * m.target_velocity[i]
    for k in range(m.neighbours):
        if m.near_id[k] == m.target:
            m.seen, m.seen_at = True, t - m.near_age[k]
            for i in range(2):
                m.target_position[i], m.target_velocity[i] = m.near_position[k, i], m.near_velocity[k, i]
    return bool(m.seen and t - m.seen_at <= m.memory)


@kernel
def _angles(m: Any, own: float) -> tuple[float, float]:
    """Returns the angles to the next drone on the circle ahead and behind; both 2 pi if there is no other."""
    ahead, behind = 2.0 * pi, 2.0 * pi
    for k in range(m.neighbours):
        n, e = m.near_position[k, 0] - m.target_position[0], m.near_position[k, 1] - m.target_position[1]
        r = sqrt(n * n + e * e)
        flies = m.near_position[k, 2] < m.home[2] - _ON_THE_GROUND
        if m.near_id[k] != m.target and flies and 0.5 * m.circle < r < 2.0 * m.circle:
            angle = (atan2(e, n) - own) % (2.0 * pi)
            ahead, behind = min(ahead, angle), min(behind, 2.0 * pi - angle)
    return ahead, behind


@kernel
def track(m: Any, t: float, h: float) -> int:
    """Sets the velocity: that of the target, plus the vector field around it."""
    m.circle_error = -1.0
    if not _see_target(m, t, h):
        return VELOCITY
    n, e = m.position[0] - m.target_position[0], m.position[1] - m.target_position[1]
    r = sqrt(n * n + e * e)
    if r < 1e-3:
        n, e, r = 1e-3, 0.0, 1e-3
    m.ahead, m.behind = _angles(m, atan2(e, n))
    turn = m.speed / m.circle + 0.5 * m.phase_gain * (m.ahead - m.behind)
    speed = min(max(m.circle * turn, 0.5 * m.speed), 1.5 * m.speed)
    squares = r * r + m.circle * m.circle
    clockwise = speed * 2.0 * r * m.circle / squares
    out = speed * (m.circle * m.circle - r * r) / squares - m.response * clockwise * clockwise / r
    m.setpoint_velocity[0] = m.target_velocity[0] + (out * n - clockwise * e) / r
    m.setpoint_velocity[1] = m.target_velocity[1] + (out * e + clockwise * n) / r
    m.circle_error = abs(r - m.circle)
    return VELOCITY


class TargetTracking(Model):
    """Circles a moving target with others, at equal angles."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(neighbours=100),
        Parameter("target", type=int, start=1, minimum=1, maximum=255, description="system id of the target"),
        Parameter("circle", unit="m", start=15.0, minimum=0.1, description="radius of the circle around it"),
        Parameter("speed", unit="m/s", start=3.0, minimum=0.0, description="on the circle, relative to it"),
        Parameter("phase_gain", unit="1/s", start=0.1, minimum=0.0, description="turning rate per angle"),
        Parameter("response", unit="s", start=0.5, minimum=0.0, description="time constant of the vehicle's velocity"),
        Parameter("memory", unit="s", start=10.0, minimum=0.0, description="for which a target that is lost moves on"),
        Output("circle_error", unit="m", start=-1.0, description="distance from the circle; -1: no target"),
        Output("ahead", unit="rad", start=0.0, description="angle to the next drone ahead; 2 pi: no other"),
        Output("behind", unit="rad", start=0.0, description="angle to the next drone behind; 2 pi: no other"),
        Memory("target_position", shape=2),  # m, north and east
        Memory("target_velocity", shape=2),  # m/s
        Memory("seen", dtype="?"),
        Memory("seen_at"),  # s
    )
    kernels = agent_kernels(track)
    errors = ERRORS

"""The guidance of a point mass: velocities that lead to a position, and accelerations that lead to a velocity.

Kernels over a record with `GUIDANCE`, position, velocity and `desired_velocity` (NED, m and m/s), and `cruise` [m/s]
(0: WPNAV_SPEED holds). Within the limits, the answer to a position is that of a linear system of second order, with the
natural frequency sqrt(PSC_POSXY_P PSC_VELXY_P); farther away, ArduPilot's square-root controller limits speed and
deceleration.

Source: ArduPilot, AC_PosControl (gains, defaults).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Variable
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import real

__all__ = ["GUIDANCE", "acceleration_to", "approach", "climb_to", "square_root_speed"]

_BRAKING = 0.5
"""Share of WPNAV_ACCEL with which it slows down: ArduCopter's speeds and overshoots, which its jerk limit causes."""

GUIDANCE: tuple[Variable, ...] = (
    real("PSC_POSXY_P", "1/s", 1.0, "horizontal speed over position error", 1e-3),
    real("PSC_POSZ_P", "1/s", 1.0, "vertical speed over position error", 1e-3),
    real("PSC_VELXY_P", "1/s", 2.0, "horizontal acceleration over velocity error", 1e-3),
    real("PSC_VELZ_P", "1/s", 5.0, "vertical acceleration over velocity error", 1e-3),
    real("WPNAV_SPEED", "cm/s", 1000.0, "greatest horizontal speed"),
    real("WPNAV_SPEED_UP", "cm/s", 250.0, "greatest speed of climb"),
    real("WPNAV_SPEED_DN", "cm/s", 150.0, "greatest speed of descent"),
    real("WPNAV_ACCEL", "cm/s2", 250.0, "greatest horizontal acceleration", 1.0),
    real("WPNAV_ACCEL_Z", "cm/s2", 100.0, "greatest vertical acceleration", 1.0),
)
"""Parameters, by ArduPilot's names."""


@kernel
def square_root_speed(error: float, gain: float, deceleration: float) -> float:
    """Returns the speed [m/s] with which to approach a target `error` [m] away: ArduPilot's sqrt_controller."""
    linear = deceleration / (gain * gain)
    if error <= linear:
        return gain * error
    return math.sqrt(2.0 * deceleration * (error - 0.5 * linear))


@kernel
def approach(m: Any, n: float, e: float) -> None:
    """Demands a horizontal velocity towards a position."""
    dn, de = n - m.position[0], e - m.position[1]
    distance = math.sqrt(dn * dn + de * de)
    if distance > 0.0:
        most = m.cruise if m.cruise > 0.0 else 0.01 * m.WPNAV_SPEED
        speed = min(square_root_speed(distance, m.PSC_POSXY_P, _BRAKING * 0.01 * m.WPNAV_ACCEL), most) / distance
        m.desired_velocity[0] += speed * dn
        m.desired_velocity[1] += speed * de


@kernel
def climb_to(m: Any, d: float) -> None:
    """Demands a vertical velocity towards a down coordinate."""
    error = d - m.position[2]
    speed = square_root_speed(abs(error), m.PSC_POSZ_P, 0.01 * m.WPNAV_ACCEL_Z)
    m.desired_velocity[2] += (
        min(speed, 0.01 * m.WPNAV_SPEED_DN) if error > 0.0 else -min(speed, 0.01 * m.WPNAV_SPEED_UP)
    )


@kernel
def acceleration_to(m: Any, ahead: Any, given: bool) -> tuple[float, float, float]:
    """Returns the acceleration [m/s2], NED, that leads to the desired velocity, within the limits.

    Args:
        m: the record.
        ahead: acceleration [m/s2], NED, that is added to it.
        given: whether `ahead` is valid.
    """
    an = m.PSC_VELXY_P * (m.desired_velocity[0] - m.velocity[0]) + (ahead[0] if given else 0.0)
    ae = m.PSC_VELXY_P * (m.desired_velocity[1] - m.velocity[1]) + (ahead[1] if given else 0.0)
    ad = m.PSC_VELZ_P * (m.desired_velocity[2] - m.velocity[2]) + (ahead[2] if given else 0.0)
    size, most = math.sqrt(an * an + ae * ae), 0.01 * m.WPNAV_ACCEL
    if size > most:
        an *= most / size
        ae *= most / size
    most = 0.01 * m.WPNAV_ACCEL_Z
    return an, ae, min(max(ad, -most), most)

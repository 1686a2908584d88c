"""ACRO: the sticks set angular velocities of the body and the throttle.

ACRO_TRAINER 1 turns the vehicle level when the sticks are released, 2 (the default) also keeps it within ANGLE_MAX.
Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter 4.7-dev: mode_acro.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import euler_from_quaternion, roll_pitch_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import follow_rates, forget_torques, relax_attitude
from cosim_models.autopilot.control.motors import GROUND_IDLE, THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import set_throttle
from cosim_models.autopilot.control.shaping import clip, sqrt_controller, wrap_pi
from cosim_models.autopilot.flight.sticks import curved, deflection, hands_on, stick_throttle, throttle_zero

__all__ = ["run_acro"]

_LEVELLING_MAX = math.radians(30.0)  # lean that counts at most for levelling
_OVERSHOOT = math.radians(10.0)  # beyond ANGLE_MAX at which the full rate is countered
_OFF, _LIMITED = 0, 2  # ACRO_TRAINER
_CDEG = math.radians(0.01)


@kernel
def _back_within(m: Any, angle: float, accel_max: float, dt: float) -> float:
    """Returns the rate [rad/s] that brings an angle [rad] back within ANGLE_MAX; `accel_max` is in cdeg/s2."""
    most = _CDEG * m.ANGLE_MAX
    beyond = angle - most if angle > most else angle + most if angle < -most else 0.0
    return sqrt_controller(-beyond, math.radians(m.ACRO_RP_RATE) / _OVERSHOOT, accel_max * _CDEG, dt)


@kernel
def _level(m: Any, roll: float, pitch: float, yaw: float, dt: float) -> None:
    """Adds the trainer's angular velocities to m.angle_rates; roll, pitch and yaw are the sticks, -1 to 1."""
    q = m.attitude_target
    phi, theta = roll_pitch_from_quaternion((q[0], q[1], q[2], q[3]))
    phi_rate = -clip(wrap_pi(phi), -_LEVELLING_MAX, _LEVELLING_MAX) * m.ACRO_BAL_ROLL
    theta_rate = -clip(wrap_pi(theta), -_LEVELLING_MAX, _LEVELLING_MAX) * m.ACRO_BAL_PITCH
    limited = m.ACRO_TRAINER == _LIMITED
    if limited:
        phi_rate += _back_within(m, phi, m.ATC_ACCEL_R_MAX, dt)
        theta_rate += _back_within(m, theta, m.ATC_ACCEL_P_MAX, dt)
    x, y, z = phi_rate, math.cos(phi) * theta_rate, -math.sin(phi) * theta_rate
    rates = m.angle_rates
    if limited:
        rates[0] += x
        rates[1] += y
        rates[2] += z
        return
    share = clip(1.0 - max(max(abs(roll), abs(pitch)), abs(yaw)), 0.0, 1.0)
    b = m.q
    share *= math.cos(euler_from_quaternion((b[0], b[1], b[2], b[3]))[1])
    for i in range(3):
        extra = (x if i == 0 else y if i == 1 else z) * share
        most = abs(abs(rates[i]) - abs(extra))  # does not reverse the pilot's rate
        rates[i] = clip(rates[i] + extra, -most, most)


@kernel
def _demand_rates(m: Any, t: float, dt: float) -> None:
    """Sets m.angle_rates [rad/s] by the sticks and the trainer."""
    roll, pitch, yaw = 0.0, 0.0, 0.0
    if hands_on(m, t) and not m.radio_lost:
        roll = deflection(m, m.RCMAP_ROLL, t)
        pitch = deflection(m, m.RCMAP_PITCH, t)
        yaw = deflection(m, m.RCMAP_YAW, t)
    length = math.sqrt(roll * roll + pitch * pitch)
    if length > 1.0:
        roll /= length
        pitch /= length
    fastest = math.radians(m.ACRO_RP_RATE)
    m.angle_rates[0] = fastest * curved(roll, m.ACRO_RP_EXPO)
    m.angle_rates[1] = fastest * curved(pitch, m.ACRO_RP_EXPO)
    m.angle_rates[2] = math.radians(m.ACRO_Y_RATE) * curved(yaw, m.ACRO_Y_EXPO)
    if m.ACRO_TRAINER != _OFF:
        _level(m, roll, pitch, yaw, dt)


@kernel
def run_acro(m: Any, t: float, dt: float) -> None:
    """Performs one step of ACRO."""
    m.spool_wanted = GROUND_IDLE if throttle_zero(m, t) else THROTTLE_UNLIMITED
    throttle = stick_throttle(m, m.ACRO_THR_MID if m.ACRO_THR_MID > 0.0 else m.throttle_hover, t)
    if m.spool_state <= GROUND_IDLE:
        relax_attitude(m)
        forget_torques(m, m.spool_state == GROUND_IDLE, dt)
        throttle = 0.0
    elif m.spool_state == THROTTLE_UNLIMITED and not m.limit_throttle_lower:
        m.on_ground = False
    _demand_rates(m, t, dt)
    follow_rates(m, m.angle_rates, dt)
    set_throttle(m, throttle, False, m.PILOT_THR_FILT, dt)

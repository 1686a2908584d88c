"""Motor control of the autopilot: spool states, throttle filter, hover throttle, mixing, output.

Kernels over the autopilot's record `m`. Inputs are torques and throttle as fractions of full range; the output
`m.motor` is (pwm - 1000) / 1000.

A motor that has to give most, over half a second, may have failed. When the vehicle sinks in spite of that
(`boost_thrust`), the others are no longer held back for its sake, until the demands are met again: on six motors and
more altogether, on four only by its share of the yaw.

Source: ArduPilot, AP_MotorsMulticopter (output_logic, update_throttle_hover), AP_MotorsMatrix (check_for_failed_motor)
and AC_AttitudeControl_Multi (update_throttle_rpy_mix).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.mixer import (
    LIMIT_ROLL_PITCH,
    LIMIT_THROTTLE_LOWER,
    LIMIT_THROTTLE_UPPER,
    LIMIT_YAW,
    mix,
    mix_without,
    thrust_to_command,
)
from cosim_models.autopilot.control.shaping import clip, lowpass_alpha

__all__ = [
    "GROUND_IDLE",
    "SHUT_DOWN",
    "SPOOLING_DOWN",
    "SPOOLING_UP",
    "THROTTLE_UNLIMITED",
    "air_density_ratio",
    "boost_thrust",
    "learn_hover_throttle",
    "mix_towards",
    "run_motors",
    "update_lift",
]

SHUT_DOWN, GROUND_IDLE, SPOOLING_UP, THROTTLE_UNLIMITED, SPOOLING_DOWN = 0, 1, 2, 3, 4
"""Spool states of the motors; the first two and THROTTLE_UNLIMITED can be requested."""

_THRUST_TIME = 0.5  # s, of the mean of each motor's thrust
_UNBALANCED, _BALANCED = 1.5, 1.25  # greatest thrust over the mean
_REDUNDANT = 6  # motors
_NEARLY_FULL = 0.9
_HOVER_TIME = 10.0  # s, time constant of learning the hover throttle
_HOVER_MIN, _HOVER_MAX = 0.125, 0.6875


@kernel
def air_density_ratio(altitude: float) -> float:
    """Returns the air density at `altitude` [m AMSL] relative to sea level, in ArduPilot's range of the standard
    atmosphere.
    """
    return clip((1.0 - 2.25577e-5 * clip(altitude, -1000.0, 11000.0)) ** 4.25588, 0.5, 1.25)


@kernel
def update_lift(m: Any, dt: float) -> None:
    """Updates m.lift, by which commands are divided: that of the air, and of the battery's voltage by MOT_BAT_VOLT_MAX.

    Called at steps of dt; the voltage is that at rest, filtered at 0.5 Hz.
    """
    most, least = m.MOT_BAT_VOLT_MAX, m.MOT_BAT_VOLT_MIN
    if most <= 0.0 or least >= most or m.battery_voltage < 0.25 * least:
        m.voltage_share = 1.0
        m.lift = m.air_density
        return
    voltage = m.battery_voltage
    if m.SIM_BATT_CAP_AH > 0.0:
        voltage += m.battery_resistance * m.battery_current
    share = clip(voltage, max(least, 0.6 * most), most) / most
    m.voltage_share += lowpass_alpha(dt, 0.5) * (share - m.voltage_share)
    m.lift = m.air_density * m.voltage_share * (1.0 - m.MOT_THST_EXPO + m.MOT_THST_EXPO * m.voltage_share)


@kernel
def _spool(m: Any, dt: float) -> None:
    """Advances the spool state towards `m.spool_wanted`."""
    step = dt / max(m.MOT_SPOOL_TIME, 0.05)
    step_down = dt / max(m.MOT_SPOOL_TIM_DN, 0.05) if m.MOT_SPOOL_TIM_DN > 0.0 else step
    wanted = m.spool_wanted if m.armed and not m.arming_delay else SHUT_DOWN
    if wanted == SHUT_DOWN and (not m.armed or m.arming_delay):
        m.spool_state = SHUT_DOWN
    if m.spool_state == SHUT_DOWN:
        m.spin_up = 0.0
        m.thrust_max = 0.0
        if wanted != SHUT_DOWN:
            m.spool_state = GROUND_IDLE
    elif m.spool_state == GROUND_IDLE:
        m.thrust_max = 0.0
        if wanted == SHUT_DOWN:
            m.spin_up = max(m.spin_up - step_down, 0.0)
            if m.spin_up == 0.0:
                m.spool_state = SHUT_DOWN
        elif wanted == THROTTLE_UNLIMITED:
            m.spin_up += step
            if m.spin_up >= 1.0:
                m.spin_up = 1.0
                m.spool_state = SPOOLING_UP
        else:
            idle = m.MOT_SPIN_ARM / m.MOT_SPIN_MIN if m.MOT_SPIN_MIN > 0.0 else 0.0
            m.spin_up += clip(idle - m.spin_up, -step_down, step)
    elif m.spool_state == SPOOLING_UP:
        m.spin_up = 1.0
        if wanted != THROTTLE_UNLIMITED:
            m.spool_state = SPOOLING_DOWN
        else:
            m.thrust_max += step
            if m.thrust_max >= min(m.throttle_filtered, 1.0):
                m.thrust_max = 1.0
                m.spool_state = THROTTLE_UNLIMITED
    elif m.spool_state == THROTTLE_UNLIMITED:
        m.spin_up = 1.0
        m.thrust_max = 1.0
        if wanted != THROTTLE_UNLIMITED:
            m.spool_state = SPOOLING_DOWN
    elif wanted == THROTTLE_UNLIMITED:
        m.spool_state = SPOOLING_UP
    else:
        m.spin_up = 1.0
        m.thrust_max -= step_down
        if m.thrust_max <= 0.0:
            m.thrust_max = 0.0
            m.spool_state = GROUND_IDLE


@kernel
def _filter_throttle(m: Any, dt: float) -> None:
    if not m.armed:
        m.throttle_filtered = 0.0
        return
    m.throttle_filtered += lowpass_alpha(dt, m.throttle_cutoff) * (m.throttle_command - m.throttle_filtered)
    m.throttle_filtered = clip(m.throttle_filtered, 0.0, 1.0)


@kernel
def _slewed(m: Any, last: float, wanted: float, dt: float) -> float:
    """Returns the next command from `last` towards `wanted`; MOT_SLEW_*_TIME is the time for the full range."""
    room = m.MOT_SPIN_MAX - m.MOT_SPIN_MIN
    if m.MOT_SLEW_UP_TIME > 0.0:
        wanted = min(wanted, last + room * dt / m.MOT_SLEW_UP_TIME)
    if m.MOT_SLEW_DN_TIME > 0.0:
        wanted = max(wanted, last - room * dt / m.MOT_SLEW_DN_TIME)
    return wanted


@kernel
def boost_thrust(m: Any) -> int:
    """Leaves the motor that gives most out of the limits of the others; returns its number, from 0."""
    m.boosted = m.boosting = True
    m.lost_motor = 0
    for i in range(m.motor_count):
        if m.thrust_mean[i] > m.thrust_mean[m.lost_motor]:
            m.lost_motor = i
    return int(m.lost_motor)


@kernel
def _balance(m: Any, average: float) -> None:
    """Updates whether the motors are balanced, and ends the boost when that is not needed for the `average` thrust."""
    most = total = 0.0
    for i in range(m.motor_count):
        most = max(most, m.thrust_mean[i])
        total += m.thrust_mean[i]
    ratio = most * m.motor_count / total if total > 0.1 else 1.0
    if ratio >= _UNBALANCED and m.motor_count >= _REDUNDANT:
        m.unbalanced = True
    elif ratio <= _BALANCED:
        m.unbalanced = False
    if m.boosting:
        m.boosted = m.boosted and (m.unbalanced or most >= _NEARLY_FULL or m.thrust_max / m.lift <= average)
        m.boosting = m.boosted or m.boost_share > 0.0


@kernel
def _mix_boosted(m: Any, gain: float, dt: float) -> tuple[int, float]:
    """Mixes while the lost motor is left out, or on its way back."""
    step = dt / max(m.MOT_SPOOL_TIME, 0.05)
    if m.spool_state == SHUT_DOWN or m.spool_state == GROUND_IDLE:
        m.boosted = False
        m.boost_share = 0.0
    elif m.spool_state == SPOOLING_UP:
        m.boosted = False
    up = m.spool_state == THROTTLE_UNLIMITED and m.boosted and m.unbalanced
    m.boost_share = clip(m.boost_share + (step if up else -step), 0.0, 1.0)
    return mix_without(
        m.factors,
        m.motor_count,
        m.lost_motor if m.boosted else -1,
        m.boost_share,
        m.torque[0] * gain,
        m.torque[1] * gain,
        m.torque[2] * gain,
        m.throttle_filtered * gain,
        m.throttle_average_max * gain,
        m.thrust_max * gain,
        0.001 * m.MOT_YAW_HEADROOM,
        m.thrust,
    )


@kernel
def run_motors(m: Any, dt: float) -> None:
    """Computes m.motor from m.torque and the throttle command, and records saturation."""
    _filter_throttle(m, dt)
    _spool(m, dt)
    gain = 1.0 / m.lift
    if m.boosting:
        limits, average = _mix_boosted(m, gain, dt)
    else:
        limits, average = mix(
            m.factors,
            m.motor_count,
            m.torque[0] * gain,
            m.torque[1] * gain,
            m.torque[2] * gain,
            m.throttle_filtered * gain,
            m.throttle_average_max * gain,
            m.thrust_max,
            0.001 * m.MOT_YAW_HEADROOM,
            m.thrust,
        )
    share = dt / (dt + _THRUST_TIME)
    for i in range(m.motor_count):
        m.thrust_mean[i] += share * (m.thrust[i] - m.thrust_mean[i])
    if m.boosting or m.motor_count >= _REDUNDANT:
        _balance(m, average)
    m.throttle_out = average / gain
    if m.spool_state == SHUT_DOWN or m.spool_state == GROUND_IDLE:
        limits = LIMIT_ROLL_PITCH | LIMIT_YAW | LIMIT_THROTTLE_LOWER | LIMIT_THROTTLE_UPPER
        idle = m.spin_up * m.MOT_SPIN_MIN if m.spool_state == GROUND_IDLE else 0.0
        for i in range(m.motor_count):
            m.motor[i] = idle
    else:
        for i in range(m.motor_count):
            m.motor[i] = _slewed(
                m, m.motor[i], thrust_to_command(m.thrust[i], m.MOT_THST_EXPO, m.MOT_SPIN_MIN, m.MOT_SPIN_MAX), dt
            )
    m.limit_roll_pitch = (limits & LIMIT_ROLL_PITCH) != 0
    m.limit_yaw = (limits & LIMIT_YAW) != 0
    m.limit_throttle_lower = (limits & LIMIT_THROTTLE_LOWER) != 0
    m.limit_throttle_upper = (limits & LIMIT_THROTTLE_UPPER) != 0


@kernel
def mix_towards(m: Any, wanted: float, dt: float) -> None:
    """Moves the share of throttle that may rise to keep attitude (ATC_THR_MIX_*): up fast, down slowly."""
    if m.throttle_mix < wanted:
        m.throttle_mix += min(2.0 * dt, wanted - m.throttle_mix)
    elif m.throttle_mix > wanted:
        m.throttle_mix -= min(0.5 * dt, m.throttle_mix - wanted)
        given = max(m.throttle_out, m.throttle_filtered)
        if given < m.throttle_hover:
            used = (given - m.throttle_filtered) / (m.throttle_hover - m.throttle_filtered)
        else:
            used = given / m.throttle_hover
        m.throttle_mix = min(m.throttle_mix, max(used, wanted))
    m.throttle_mix = clip(m.throttle_mix, 0.1, 5.0)


@kernel
def learn_hover_throttle(m: Any, dt: float) -> None:
    """Adapts the hover throttle to the throttle in level hover (MOT_HOVER_LEARN)."""
    if m.MOT_HOVER_LEARN < 1 or not m.armed or m.on_ground or m.spool_state != THROTTLE_UNLIMITED:
        return
    if abs(m.desired_velocity_neu[2]) > 1e-3 or abs(m.velocity_neu[2]) > 0.6 or m.throttle_filtered <= 0.0:
        return
    if m.q[1] * m.q[1] + m.q[2] * m.q[2] > math.sin(math.radians(2.5)) ** 2:
        return
    change = dt / (dt + _HOVER_TIME) * (m.throttle_filtered - m.throttle_hover)
    m.throttle_hover = clip(m.throttle_hover + change, _HOVER_MIN, _HOVER_MAX)

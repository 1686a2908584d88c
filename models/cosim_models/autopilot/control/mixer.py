"""The motor mixer, from thrust and torques to motor commands, as in ArduCopter's AP_MotorsMatrix.

It contains the normalised factors per motor, the priorities on saturation (throttle yields first to keep roll and
pitch, yaw yields before both), and the inverse of the propellers' thrust curve. All quantities are fractions of full
range; there are no dynamics. With a motor that seems to have failed, `mix_without` lets the others use the whole range,
whatever would be demanded of that one.

Source: ArduPilot, AP_MotorsMatrix (setup_motors, output_armed_stabilizing) and AP_Motors_Thrust_Linearization.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import clip

__all__ = [
    "LIMIT_ROLL_PITCH",
    "LIMIT_THROTTLE_LOWER",
    "LIMIT_THROTTLE_UPPER",
    "LIMIT_YAW",
    "mix",
    "mix_without",
    "motor_factors",
    "thrust_to_command",
]

LIMIT_ROLL_PITCH, LIMIT_YAW, LIMIT_THROTTLE_LOWER, LIMIT_THROTTLE_UPPER = 1, 2, 4, 8
"""Bits that report which demands `mix` could not satisfy."""

_YAW_WITHOUT = 0.5  # yaw that is always available without a motor

_CW, _CCW = -1.0, 1.0  # rotation of the propeller seen from above; a counter-clockwise one yaws the body right

# Angle from the front, clockwise, in degrees, and rotation of each motor, in ArduPilot's order.
_QUAD_PLUS = np.array([(90.0, _CCW), (-90.0, _CCW), (0.0, _CW), (180.0, _CW)])
_QUAD_X = np.array([(45.0, _CCW), (-135.0, _CCW), (-45.0, _CW), (135.0, _CW)])
_HEXA_X = np.array([(90.0, _CW), (-90.0, _CCW), (-30.0, _CW), (150.0, _CCW), (30.0, _CCW), (-150.0, _CW)])
_OCTA_X = np.array(
    [
        (22.5, _CW),
        (-157.5, _CW),
        (67.5, _CCW),
        (157.5, _CCW),
        (-22.5, _CCW),
        (-112.5, _CCW),
        (-67.5, _CW),
        (112.5, _CW),
    ]
)
# Y6B: each arm has a clockwise motor above and a counter-clockwise one below.
_Y6 = np.array([(60.0, _CW), (60.0, _CCW), (180.0, _CW), (180.0, _CCW), (-60.0, _CW), (-60.0, _CCW)])


@kernel
def motor_factors(airframe: int, factors: Any) -> int:
    """Fills `factors` (float64[8, 3]: roll, pitch, yaw of each motor) for an `Airframe`.

    The largest factor of each axis is 0.5.

    Returns:
        The number of motors; 0 if the airframe has no mixer.
    """
    if airframe == 1:
        layout = _QUAD_X
    elif airframe == 2:
        layout = _HEXA_X
    elif airframe == 3:
        layout = _OCTA_X
    elif airframe == 4:
        layout = _Y6
    elif airframe == 9:
        layout = _QUAD_PLUS
    else:
        return 0
    count = layout.shape[0]
    for i in range(count):
        angle = math.radians(layout[i, 0])
        factors[i, 0] = -math.sin(angle)
        factors[i, 1] = math.cos(angle)
        factors[i, 2] = layout[i, 1]
    for axis in range(3):
        largest = 0.0
        for i in range(count):
            largest = max(largest, abs(factors[i, axis]))
        for i in range(count):
            factors[i, axis] = 0.5 * factors[i, axis] / largest
    return int(count)


@kernel
def _yaw_room(factors: Any, count: int, yaw: float, throttle: float, thrust: Any) -> float:
    """Returns the yaw that every motor can add to its roll and pitch at a given throttle."""
    room = 1.0
    for i in range(count):
        factor = factors[i, 2]
        if factor != 0.0:
            level = throttle + thrust[i]
            free = 1.0 - level if yaw * factor > 0.0 else level
            room = min(room, max(free, 0.0) / abs(factor))
    return room


@kernel
def _fitted(low: float, high: float, throttle: float, average_max: float, limits: int) -> tuple[int, float, float]:
    """Returns limits, the scale of all torques, and the average thrust; `low` and `high` are the least and greatest of
    the motors' torques.
    """
    scale = 1.0
    if high - low > 1.0:
        scale = 1.0 / (high - low)
    if average_max + low < 0.0:
        scale = min(scale, -average_max / low)
    low *= scale
    high *= scale
    extra = throttle + low  # above the least average thrust at which no motor needs negative thrust
    if scale < 1.0:
        limits |= LIMIT_ROLL_PITCH | LIMIT_YAW
        if extra > 0.0:
            limits |= LIMIT_THROTTLE_UPPER
        extra = 0.0
    elif extra < 0.0:
        extra = 0.0
    elif extra > 1.0 - (high - low):
        extra = 1.0 - (high - low)
        limits |= LIMIT_THROTTLE_UPPER
    return limits, scale, extra - low


@kernel
def mix(
    factors: Any,
    count: int,
    roll: float,
    pitch: float,
    yaw: float,
    throttle: float,
    throttle_average_max: float,
    throttle_max: float,
    yaw_headroom: float,
    thrust: Any,
) -> tuple[int, float]:
    """Distributes throttle and torques to the motors.

    Args:
        factors: float64[8, 3] of `motor_factors`.
        count: number of motors.
        roll: demanded torque, -1 to 1 (right side down positive).
        pitch: demanded torque, nose up positive.
        yaw: demanded torque, nose right positive.
        throttle: demanded average thrust, 0 to 1.
        throttle_average_max: limit to which the average may rise to keep attitude control.
        throttle_max: upper limit of the average (while spooling up).
        yaw_headroom: yaw that is always available, at the cost of throttle (MOT_YAW_HEADROOM / 1000).
        thrust: float64[8], receives the thrust of each motor, 0 to 1.

    Returns:
        The LIMIT_ bits of unsatisfied demands, and the resulting average thrust.
    """
    limits = 0
    if throttle <= 0.0:
        throttle = 0.0
        limits |= LIMIT_THROTTLE_LOWER
    if throttle >= throttle_max:
        throttle = throttle_max
        limits |= LIMIT_THROTTLE_UPPER
    average_max = clip(throttle_average_max, throttle, throttle_max)
    for i in range(count):
        thrust[i] = roll * factors[i, 0] + pitch * factors[i, 1]
    allowed = max(_yaw_room(factors, count, yaw, min(0.5, average_max), thrust), yaw_headroom)
    if abs(yaw) > allowed:
        yaw = clip(yaw, -allowed, allowed)
        limits |= LIMIT_YAW
    low = 1.0
    high = -1.0
    for i in range(count):
        thrust[i] += yaw * factors[i, 2]
        low = min(low, thrust[i])
        high = max(high, thrust[i])
    limits, scale, average = _fitted(low, high, throttle, average_max, limits)
    for i in range(count):
        thrust[i] = clip(average + scale * thrust[i], 0.0, 1.0)
    return limits, average


@kernel
def _room(factor: float, yaw: float, level: float) -> float:
    """Returns the yaw that a motor of yaw factor `factor` can add at a thrust of `level`."""
    free = 1.0 - level if yaw * factor > 0.0 else level
    return max(free, 0.0) / abs(factor)


@kernel
def _room_without(
    factors: Any, count: int, lost: int, share: float, yaw: float, throttle: float, least: float, thrust: Any
) -> float:
    """Returns the yaw that every motor but the lost one can add, at least `least`; the lost one counts by 1 - share."""
    room = 1.0
    for i in range(count):
        if factors[i, 2] != 0.0 and i != lost:
            room = min(room, _room(factors[i, 2], yaw, throttle + thrust[i]))
    room = max(room, least)
    if lost >= 0 and factors[lost, 2] != 0.0:
        with_lost = min(room, _room(factors[lost, 2], yaw, throttle + thrust[lost]))
        room = share * room + (1.0 - share) * with_lost
    return room


@kernel
def mix_without(
    factors: Any,
    count: int,
    lost: int,
    share: float,
    roll: float,
    pitch: float,
    yaw: float,
    throttle: float,
    throttle_average_max: float,
    throttle_max: float,
    yaw_headroom: float,
    thrust: Any,
) -> tuple[int, float]:
    """Distributes throttle and torques as `mix`, while one motor seems to have failed.

    Args:
        lost: that motor, from 0, whose thrust may exceed 1; negative: none.
        share: by how much it is left out, 0 to 1. The limits of throttle and yaw move with it to 1 and to 0.5.

    The others, and the returned values, are those of `mix`.
    """
    limits = 0
    throttle_max = share + (1.0 - share) * throttle_max
    if throttle <= 0.0:
        throttle = 0.0
        limits |= LIMIT_THROTTLE_LOWER
    if throttle >= throttle_max:
        throttle = throttle_max
        limits |= LIMIT_THROTTLE_UPPER
    average_max = clip(throttle_average_max, throttle, throttle_max)
    for i in range(count):
        thrust[i] = roll * factors[i, 0] + pitch * factors[i, 1]
    least = share * _YAW_WITHOUT + (1.0 - share) * yaw_headroom
    allowed = _room_without(factors, count, lost, share, yaw, min(0.5, average_max), least, thrust)
    if abs(yaw) > allowed:
        yaw = clip(yaw, -allowed, allowed)
        limits |= LIMIT_YAW
    low = 1.0
    high = -1.0
    for i in range(count):
        thrust[i] += yaw * factors[i, 2]
        low = min(low, thrust[i])
        if i != lost:
            high = max(high, thrust[i])
    if lost >= 0 and thrust[lost] > high:
        high = share * high + (1.0 - share) * thrust[lost]
    limits, scale, average = _fitted(low, high, throttle, average_max, limits)
    for i in range(count):
        thrust[i] = average + scale * thrust[i]
    return limits, average


@kernel
def thrust_to_command(thrust: float, expo: float, spin_min: float, spin_max: float) -> float:
    """Returns the motor command (0 to 1 of the PWM range) for a fraction of full thrust.

    Inverts thrust = (1 - expo) c + expo c^2, where c is the command between `spin_min` and `spin_max` (MOT_THST_EXPO,
    MOT_SPIN_MIN, MOT_SPIN_MAX). A full battery is assumed.
    """
    linear = 1.0 - clip(expo, -1.0, 1.0)
    root = linear + math.sqrt(max(linear * linear + 4.0 * (1.0 - linear) * thrust, 0.0))
    c = 2.0 * thrust / root if root > 0.0 else 0.0
    return spin_min + (spin_max - spin_min) * clip(c, 0.0, 1.0)

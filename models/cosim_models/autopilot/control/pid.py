"""ArduPilot's PID with filters on target, error and derivative; its state is an array.

State (float64[5]): filtered TARGET and ERROR, filtered DERIVATIVE, INTEGRAL, RUNNING. If RUNNING is 0, the next update
takes target and error unfiltered, so that filters do not start from an old value. Signals have no fixed unit.

Source: ArduPilot, AC_PID and AC_PID_2D.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import clip, limit_length

__all__ = [
    "DERIVATIVE",
    "ERROR",
    "INTEGRAL",
    "PID_STATE",
    "PLANE_STATE",
    "RUNNING",
    "TARGET",
    "pid",
    "pid_plane",
]

TARGET, ERROR, DERIVATIVE, INTEGRAL, RUNNING = 0, 1, 2, 3, 4
PID_STATE = 5
PLANE_STATE = 7
"""Length of the state of `pid_plane`: error, derivative and integral, each north and east, then running."""


@kernel
def pid(
    s: Any,
    target: float,
    measurement: float,
    kp: float,
    ki: float,
    kd: float,
    integral_max: float,
    target_alpha: float,
    error_alpha: float,
    derivative_alpha: float,
    dt: float,
    saturated: bool,
    kff: float,
    pd_max: float,
) -> float:
    """Performs one step of the controller; returns P + I + D and `kff` times the target.

    The `*_alpha` arguments are weights of new samples (`lowpass_alpha`). While `saturated`, the integral can only
    shrink. P + D is limited to `pd_max` if that is positive.
    """
    if s[RUNNING] == 0.0:
        s[RUNNING] = 1.0
        s[TARGET] = target
        s[ERROR] = target - measurement
        s[DERIVATIVE] = 0.0
    else:
        last = s[ERROR]
        s[TARGET] += target_alpha * (target - s[TARGET])
        s[ERROR] += error_alpha * ((s[TARGET] - measurement) - s[ERROR])
        s[DERIVATIVE] += derivative_alpha * ((s[ERROR] - last) / dt - s[DERIVATIVE])
    if ki == 0.0:
        s[INTEGRAL] = 0.0
    elif not saturated or s[INTEGRAL] * s[ERROR] < 0.0:
        s[INTEGRAL] = clip(s[INTEGRAL] + s[ERROR] * ki * dt, -integral_max, integral_max)
    result = s[ERROR] * kp + s[INTEGRAL] + s[DERIVATIVE] * kd
    if pd_max > 0.0:
        result = s[INTEGRAL] + clip(s[ERROR] * kp + s[DERIVATIVE] * kd, -pd_max, pd_max)
    if kff != 0.0:
        result += kff * s[TARGET]
    return float(result)


@kernel
def pid_plane(
    s: Any,
    target_n: float,
    target_e: float,
    n: float,
    e: float,
    kp: float,
    ki: float,
    kd: float,
    integral_max: float,
    error_alpha: float,
    derivative_alpha: float,
    dt: float,
    limit_n: float,
    limit_e: float,
    kff: float,
) -> tuple[float, float]:
    """Runs `pid` in the horizontal plane; the integral does not grow in the saturated direction (limit_n, limit_e)."""
    error_n = target_n - n
    error_e = target_e - e
    if s[6] == 0.0:
        s[6] = 1.0
        s[0] = error_n
        s[1] = error_e
        s[2] = 0.0
        s[3] = 0.0
    else:
        last_n = s[0]
        last_e = s[1]
        s[0] += error_alpha * (error_n - s[0])
        s[1] += error_alpha * (error_e - s[1])
        s[2] += derivative_alpha * ((s[0] - last_n) / dt - s[2])
        s[3] += derivative_alpha * ((s[1] - last_e) / dt - s[3])
    before = (s[4] * s[4] + s[5] * s[5]) ** 0.5
    gain_n = s[0] * ki * dt
    gain_e = s[1] * ki * dt
    longest = integral_max
    if gain_n * limit_n + gain_e * limit_e > 0.0:
        longest = min(before, integral_max)
    s[4], s[5] = limit_length(s[4] + gain_n, s[5] + gain_e, longest)
    result_n = s[0] * kp + s[4] + s[2] * kd
    result_e = s[1] * kp + s[5] + s[3] * kd
    if kff != 0.0:
        result_n += kff * target_n
        result_e += kff * target_e
    return float(result_n), float(result_e)

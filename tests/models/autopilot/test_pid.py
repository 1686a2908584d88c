"""PID controllers against sequences computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cosim_models.autopilot.control.pid import (
    DERIVATIVE,
    ERROR,
    INTEGRAL,
    PID_STATE,
    PLANE_STATE,
    TARGET,
    pid,
    pid_plane,
)


def step(s: np.ndarray, target: float, measurement: float, saturated: bool = False, **changed: float) -> float:
    v = {"kp": 2.0, "ki": 10.0, "kd": 0.5, "imax": 3.0, "ta": 1.0, "ea": 1.0, "da": 1.0, "kff": 0.0, "pdmx": 0.0}
    v |= changed
    gains = (v["kp"], v["ki"], v["kd"], v["imax"], v["ta"], v["ea"], v["da"])
    return pid(s, target, measurement, *gains, 0.1, saturated, v["kff"], v["pdmx"])


def test_by_hand() -> None:
    s = np.zeros(PID_STATE)
    # error 1: P 2, I 10*1*0.1 = 1, no derivative in the first step
    assert step(s, 1.0, 0.0) == pytest.approx(3.0)
    # error 0.5: P 1, I 1 + 0.5 = 1.5, D 0.5 * (0.5 - 1)/0.1 = -2.5
    assert step(s, 1.0, 0.5) == pytest.approx(0.0)
    # error -0.25: P -0.5, I 1.5 - 0.25, D 0.5 * -7.5
    assert step(s, 1.0, 1.25) == pytest.approx(-0.5 + 1.25 - 3.75)


def test_filters_of_target_error_and_derivative() -> None:
    s = np.zeros(PID_STATE)
    step(s, 1.0, 0.0, ki=0.0)
    step(s, 2.0, 0.0, ki=0.0, ta=0.5, ea=0.5, da=0.5)
    assert s[TARGET] == pytest.approx(1.5)
    assert s[ERROR] == pytest.approx(1.25)
    assert s[DERIVATIVE] == pytest.approx(0.5 * 2.5)


def test_the_integral_is_limited_and_only_shrinks_when_saturated() -> None:
    s = np.zeros(PID_STATE)
    for _ in range(10):
        step(s, 1.0, 0.0)
    assert s[INTEGRAL] == 3.0
    s[INTEGRAL] = 1.0
    step(s, 1.0, 0.0, saturated=True)
    assert s[INTEGRAL] == 1.0
    step(s, -1.0, 0.0, saturated=True)
    assert s[INTEGRAL] == pytest.approx(0.0)
    step(s, -1.0, 0.0, ki=0.0)
    assert s[INTEGRAL] == 0.0


def plane(s: np.ndarray, target: tuple[float, float], limit: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    return pid_plane(s, *target, 0.0, 0.0, 2.0, 10.0, 0.5, 3.0, 1.0, 1.0, 0.1, *limit, 0.0)


def test_the_plane_is_two_lines_while_nothing_is_limited() -> None:
    s, n, e = np.zeros(PLANE_STATE), np.zeros(PID_STATE), np.zeros(PID_STATE)
    for target in ((1.0, 0.0), (0.5, -0.2), (-0.25, 0.3)):
        assert plane(s, target) == pytest.approx((step(n, target[0], 0.0), step(e, target[1], 0.0)))


def test_the_integral_in_the_plane_turns_but_does_not_grow_into_saturation() -> None:
    s = np.zeros(PLANE_STATE)
    plane(s, (1.0, 0.0))
    assert s[4:6] == pytest.approx((1.0, 0.0))
    plane(s, (1.0, 1.0), limit=(5.0, 0.0))
    assert np.hypot(*s[4:6]) == pytest.approx(1.0)
    assert s[5] > 0.3
    for _ in range(20):
        plane(s, (1.0, 1.0))
    assert np.hypot(*s[4:6]) == pytest.approx(3.0)


def test_feed_forward_and_the_limit_of_p_and_d() -> None:
    s = np.zeros(PID_STATE)
    # P 2, I 1; the filtered target is the target in the first step
    assert step(s, 1.0, 0.0, kff=0.25) == pytest.approx(3.25)
    # P 1, I 1.5, D -2.5: P + D is -1.5, limited to -0.5
    assert step(s, 1.0, 0.5, pdmx=0.5) == pytest.approx(1.0)
    # P -0.5, D -3.75: not limited to 9
    assert step(s, 1.0, 1.25, pdmx=9.0) == pytest.approx(-0.5 + 1.25 - 3.75)


def test_feed_forward_in_the_plane() -> None:
    def once(kff: float) -> tuple[float, float]:
        s = np.zeros(PLANE_STATE)
        return pid_plane(s, 3.0, -1.0, 1.0, 1.0, 2.0, 0.0, 0.0, 5.0, 1.0, 1.0, 0.1, 0.0, 0.0, kff)

    assert once(0.0) == pytest.approx((4.0, -4.0))
    assert once(0.5) == pytest.approx((5.5, -4.5))

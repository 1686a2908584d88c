"""The filter of the estimate: its covariance, its gains and its delay, beside matrices and ArduCopter's own log."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.commander.estimate import filter as lanes

G = 9.80665
H = lanes.FRAME


def hovering(**values: Any) -> Any:
    """Returns the record of a vehicle that hovers level, without errors."""
    m: Any = Autopilot.record()
    m.q[0] = 1.0
    for key, value in {"EK3_IMU_MASK": 1, "INS_USE": 1, "INS_USE2": 1, "gps_heard": True, **values}.items():
        m[key] = value
    lanes.begin_filters(m, 0.0)
    return m


def after(m: Any, seconds: float) -> None:
    for _ in range(round(seconds / H)):
        lanes.run_filters(m, 1, H)


def spread(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Transition and noise of a period: place, velocity, accelerometer; with tilt and gyro in between where n is 5."""
    f, q = np.eye(n), np.zeros((n, n))
    f[0, 1], f[1, n - 1] = H, -H
    q[1, 1], q[n - 1, n - 1] = (0.35 * H) ** 2, (0.02 * H) ** 2
    if n == 5:
        f[1, 2], f[2, 3] = G * H, -H
        q[2, 2], q[3, 3] = (0.015 * H) ** 2, (0.001 * H) ** 2
    return f, q


@pytest.mark.parametrize(("name", "n"), [("lane_up", 3), ("lane_side", 5)])
def test_covariances_are_those_of_a_kalman_filter(name: str, n: int) -> None:
    """Five seconds with matrices: velocities of GPS 5 times a second, heights and the compass 10 times."""
    m = hovering()
    p: NDArray[np.float64] = np.array(m[name][0], dtype=np.float64).reshape(n, n).copy()
    f, q = spread(n)
    for k in range(1, 401):
        p = f @ p @ f.T + q
        rows = [(1, 0.25 if n == 3 else 0.09)] if k % 16 == 1 else []
        rows += [(0, 0.25)] if k % 16 == 1 and n == 5 else []
        rows += [(0, 16.0)] if k % 8 == 0 and n == 3 else []
        for row, variance in rows:
            p = p - np.outer(p[:, row], p[row]) / (p[row, row] + variance)
        if k % 8 == 4 and n == 5:  # the compass: a tilt without that which the accelerometer balances
            h = np.array([0.0, 0.0, 1.0, 0.0, -p[2, 4] / p[4, 4]])
            p = p - np.outer(p @ h, h @ p) / (h @ p @ h + (0.05 / 0.528) ** 2)
    after(m, 5.0)
    np.testing.assert_allclose(np.array(m[name][0]).reshape(n, n), p, rtol=1e-9, atol=1e-15)


def test_variances_in_hover_are_those_of_the_real_filter() -> None:
    """ArduCopter 4.7-dev after a minute in hover, the log's XKV1 and XKV2, between the least and the greatest.

    Its tilt is half of a quaternion, its errors of sensors are per period of 12.5 ms.
    """
    m = hovering()
    low, high = np.full(10, np.inf), np.zeros(10)
    for _ in range(160):
        after(m, 0.0125)
        seen = np.concatenate(
            [np.diag(np.reshape(m["lane_side"][0], (5, 5))), np.diag(np.reshape(m["lane_up"][0], (3, 3)))]
        )
        low[:8], high[:8] = np.minimum(low[:8], seen), np.maximum(high[:8], seen)
    for i, (least, most) in enumerate(
        [(0.0259, 0.028), (0.00836, 0.0091), (4.0e-5, 4.1e-5), (3.8e-11 / H**2, 3.8e-11 / H**2)]
    ):
        assert low[i] == pytest.approx(least, rel=0.15) and high[i] == pytest.approx(most, rel=0.15)
    assert high[5] == pytest.approx(0.26, rel=0.05) and high[6] == pytest.approx(0.0097, rel=0.05)


def test_an_accelerometer_that_errs_is_seen_as_in_the_real_log() -> None:
    """2 m/s2 down in both: the test ratio of the velocity at each fix, from ArduCopter's log (XKF4.SV), in hover."""
    m = hovering(SIM_ACC1_BIAS_Z=2.0, SIM_ACC2_BIAS_Z=2.0)
    m.frame_count = 12  # the first fix that the error reaches comes 0.25 s after it
    seen = []
    for _ in range(200):
        before = float(m.lane_ratio[0, 0])
        after(m, H)
        if m.lane_ratio[0, 0] != before:
            seen.append(lanes.ratio(m, 0, 0))
    real = [0.1, 0.23, 0.37, 0.5, 0.63, 0.75, 0.86, 0.97, 1.07]
    np.testing.assert_allclose(seen[: len(real)], real, atol=0.05)


def test_the_outputs_err_at_once_and_the_filter_after_its_delay() -> None:
    """Without measurements, the velocity is b t, and that of the filter b (t - 0.1125 s)."""
    m = hovering(SIM_ACC1_BIAS_X=1.0, gps_heard=False)
    after(m, 0.1125)
    assert m.lane_past[0, 3] == 0.0 and m.lane_now[0, 3] == pytest.approx(0.1125)
    after(m, 0.1)
    assert m.lane_past[0, 3] == pytest.approx(0.1) and m.lane_now[0, 3] == pytest.approx(0.2125)
    assert m.lane_now[0, 0] == pytest.approx(0.5 * 0.2125**2, abs=1e-6)


def test_a_tilt_becomes_an_acceleration_of_the_weight() -> None:
    """A gyro that errs by w: the tilt is w t, the velocity g w t^2 / 2, and of second order g (w t)^2 / 2 down."""
    m = hovering(SIM_GYR1_BIAS_X=0.1, gps_heard=False)
    after(m, 1.0)
    assert m.lane_now[0, 7] == pytest.approx(0.1, rel=0.02)  # the compass corrects a little
    assert m.lane_now[0, 4] == pytest.approx(0.5 * G * 0.1, rel=0.04)
    assert m.lane_now[0, 5] == pytest.approx(G * 0.01 / 6.0, rel=0.05)


def test_a_place_that_is_rejected_for_ten_seconds_is_believed() -> None:
    m = hovering()
    m.told_error[0], m.desired_position_neu[0] = 30.0, 1.0
    after(m, 9.9)
    assert m.lane_now[0, 0] == 0.0 and lanes.ratio(m, 0, 1) > 1.0
    after(m, 0.4)
    assert m.lane_now[0, 0] == pytest.approx(30.0, abs=0.01)
    assert m.desired_position_neu[0] == pytest.approx(31.0, abs=0.01)


def test_height_and_climb_rate_that_err_together_show_a_bad_accelerometer() -> None:
    """Three sigma of a barometer of 4 m that hovers: 12 m. For 10 s, the climb rate is that of GPS."""
    m = hovering(SIM_ACC1_BIAS_Z=2.0)
    while not m.lane_bad[0] and m.frame_count < 800:
        height = float(m.lane_past[0, 2])
        after(m, H)
    begin = m.frame_count * H
    assert height == pytest.approx(12.0 + 0.3 * 7.0, abs=1.5) and 4.0 < begin < 5.2
    after(m, 9.5)
    assert m.lane_bad[0] and abs(float(m.lane_past[0, 5])) < 0.5
    after(m, 0.7)
    assert not m.lane_bad[0]


def test_the_derivative_of_the_height_follows_a_ramp_of_it() -> None:
    """The complementary filter of third order has no error for a height that changes evenly."""
    m = hovering()
    m.gps_heard = False
    for k in range(400):
        m.told_error[2] = 0.0
        m.lane_now[0, 2] = 0.5 * k * H
        lanes.run_filters(m, 1, H)
        m.lane_now[0, 2] = 0.5 * k * H
    assert float(m.lane_rate[0, 1]) == pytest.approx(0.5, abs=0.05)
    assert math.isfinite(float(m.lane_rate[0, 2]))

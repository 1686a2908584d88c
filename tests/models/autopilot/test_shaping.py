"""Kinematic shaping against closed forms, its own limits, and the desired paths recorded from ArduCopter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_models.autopilot.control.shaping import (
    advance_limited,
    advance_limited_ne,
    clip,
    inverse_sqrt_controller,
    kinematic_limit,
    limit_cornering,
    limit_length,
    lowpass_alpha,
    shape_position,
    shape_position_ne,
    shape_velocity,
    shape_velocity_ne,
    sqrt_controller,
    wrap_pi,
)
from tests.models.copter import recording

H = 0.0025
reals = st.floats(-50.0, 50.0)
gains = st.floats(0.2, 8.0)


def test_the_sqrt_controller_is_linear_then_a_square_root_without_a_kink() -> None:
    p, a = 2.0, 5.0
    linear = a / p**2
    assert sqrt_controller(0.5 * linear, p, a, 0.0) == pytest.approx(0.5 * linear * p)
    assert sqrt_controller(linear, p, a, 0.0) == pytest.approx(math.sqrt(2.0 * a * 0.5 * linear))
    e = 1e-6
    left = (sqrt_controller(linear, p, a, 0.0) - sqrt_controller(linear - e, p, a, 0.0)) / e
    right = (sqrt_controller(linear + e, p, a, 0.0) - sqrt_controller(linear, p, a, 0.0)) / e
    assert left == pytest.approx(right, rel=1e-4)
    # along the square root the rate v(x) brakes with a: v dv/dx = a
    v = sqrt_controller(7.0, p, a, 0.0)
    assert v * (sqrt_controller(7.0 + e, p, a, 0.0) - v) / e == pytest.approx(a, rel=1e-4)


def test_the_sqrt_controller_without_limit_or_without_gain() -> None:
    assert sqrt_controller(3.0, 2.0, 0.0, 0.0) == 6.0
    assert sqrt_controller(-8.0, 0.0, 1.0, 0.0) == -4.0
    assert sqrt_controller(0.0, 0.0, 1.0, 0.0) == 0.0


@settings(deadline=None)
@given(reals, gains, gains)
def test_the_sqrt_controller_is_odd_and_its_inverse_undoes_it(error: float, p: float, a: float) -> None:
    rate = sqrt_controller(error, p, a, 0.0)
    assert rate == -sqrt_controller(-error, p, a, 0.0)
    assert inverse_sqrt_controller(rate, p, a) == pytest.approx(error, rel=1e-9, abs=1e-9)


@settings(deadline=None)
@given(reals, gains, gains, st.floats(1e-4, 1.0))
def test_the_sqrt_controller_never_steps_over_the_error(error: float, p: float, a: float, dt: float) -> None:
    assert abs(sqrt_controller(error, p, a, dt)) * dt <= abs(error) * (1.0 + 1e-12)


def test_the_inverse_in_its_corner_cases() -> None:
    assert inverse_sqrt_controller(3.0, 1.5, 0.0) == 2.0
    assert inverse_sqrt_controller(3.0, 0.0, 0.0) == 0.0
    assert inverse_sqrt_controller(-4.0, 0.0, 2.0) == -4.0


@settings(deadline=None)
@given(st.floats(-1e4, 1e4))
def test_wrap_pi(angle: float) -> None:
    wrapped = wrap_pi(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)


def test_low_pass_weight() -> None:
    assert lowpass_alpha(0.01, 0.0) == 1.0
    assert lowpass_alpha(0.01, 1.0 / (2.0 * math.pi)) == pytest.approx(0.01 / 1.01)


@settings(deadline=None)
@given(reals, reals, st.floats(0.1, 20.0))
def test_limit_length_keeps_the_direction(x: float, y: float, longest: float) -> None:
    lx, ly = limit_length(x, y, longest)
    assert math.hypot(lx, ly) <= longest * (1.0 + 1e-12)
    assert lx * y == pytest.approx(ly * x, abs=1e-9)
    if math.hypot(x, y) <= longest:
        assert (lx, ly) == (x, y)


@settings(deadline=None)
@given(reals, reals, reals, reals, st.floats(0.1, 20.0))
def test_cornering_keeps_the_limit_and_what_goes_across(
    vn: float, ve: float, an: float, ae: float, most: float
) -> None:
    ln, le = limit_cornering(vn, ve, an, ae, most)
    assert math.hypot(ln, le) <= most * (1.0 + 1e-9)
    speed = math.hypot(vn, ve)
    if speed > 1e-3:
        across, across_given = (an * ve - ae * vn) / speed, (ln * ve - le * vn) / speed
        assert abs(across_given) == pytest.approx(min(abs(across), most), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("direction", "expected"),
    [((1, 0, 0), 10.0), ((0, 0, 1), 2.5), ((0, 0, -1), 1.5), ((0.6, 0, 0.8), 3.125), ((0, 0, 0), 0.0)],
)
def test_kinematic_limit(direction: tuple[float, float, float], expected: float) -> None:
    assert kinematic_limit(*(float(x) for x in direction), 10.0, 2.5, 1.5) == pytest.approx(expected)


def test_kinematic_limit_of_a_direction_that_is_not_allowed() -> None:
    assert kinematic_limit(1.0, 0.0, 0.0, 0.0, 2.5, 1.5) == 0.0


class Line:
    """A point on a line that follows the shaper."""

    def __init__(self, p: float = 0.0, v: float = 0.0) -> None:
        self.rows = [(p, v, 0.0)]

    def go(
        self, target: float, duration: float, v_max: float = 10.0, a_max: float = 2.5, jerk: float = 5.0
    ) -> np.ndarray:
        for _ in range(round(duration / H)):
            p, v, a = self.rows[-1]
            p, v = advance_limited(p, v, a, H, 0.0, 0.0, 0.0)
            a = shape_position(target, 0.0, 0.0, p, v, a, -v_max, v_max, -a_max, a_max, jerk, H, False)
            self.rows.append((p, v, a))
        return np.array(self.rows)


@settings(deadline=None, max_examples=40)
@given(st.floats(-80.0, 80.0), st.floats(-4.0, 4.0), st.floats(1.0, 8.0))
def test_the_position_shaper_keeps_its_limits_and_arrives(target: float, start_speed: float, v_max: float) -> None:
    path = Line(0.0, start_speed).go(target, (abs(target) + 8.0) / v_max + 15.0, v_max)
    p, v, a = path.T
    assert np.abs(a).max() <= 2.5 + 1e-9
    assert np.abs(np.diff(a)).max() <= 5.0 * H + 1e-9
    assert np.abs(v).max() <= max(v_max, abs(start_speed) + 0.5 * 5.0) * 1.02
    assert p[-1] == pytest.approx(target, abs=0.02)
    assert abs(v[-1]) < 0.02


def test_the_position_shaper_takes_little_more_time_than_the_fastest_way() -> None:
    """Bang-bang with unlimited jerk needs 2 sqrt(d / a); ours brakes with half the acceleration."""
    path = Line().go(40.0, 20.0)
    reached = np.argmax(path[:, 0] > 36.0) * H
    assert 0.8 * 2.0 * math.sqrt(40.0 / 2.5) < reached < 1.2 * math.sqrt(40.0 * (1 / 2.5 + 1 / 1.25) * 2.0)


@settings(deadline=None, max_examples=40)
@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_the_shaper_in_the_plane_keeps_its_limits_and_arrives(n: float, e: float, vn: float, ve: float) -> None:
    pn, pe, an, ae = 0.0, 0.0, 0.0, 0.0
    for _ in range(round(20.0 / H)):
        pn, pe, vn, ve = advance_limited_ne(pn, pe, vn, ve, an, ae, H, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        last = an, ae
        an, ae = shape_position_ne(n, e, 0.0, 0.0, 0.0, 0.0, pn, pe, vn, ve, an, ae, 10.0, 2.5, 5.0, H, False)
        assert math.hypot(an - last[0], ae - last[1]) <= 5.0 * H + 1e-9
        assert math.hypot(an, ae) <= 2.5 + 1e-9
    assert (pn, pe) == (pytest.approx(n, abs=0.05), pytest.approx(e, abs=0.05))


def test_the_plane_along_one_axis_is_the_line() -> None:
    line = Line().go(17.0, 8.0)
    pn, pe, vn, ve, an, ae = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for p, v, a in line[1:]:
        pn, pe, vn, ve = advance_limited_ne(pn, pe, vn, ve, an, ae, H, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        an, ae = shape_position_ne(0.0, 17.0, 0.0, 0.0, 0.0, 0.0, pn, pe, vn, ve, an, ae, 10.0, 2.5, 5.0, H, False)
        assert (pn, pe, ve, ae) == pytest.approx((0.0, p, v, a), abs=1e-9)


def test_velocity_shaping_ramps_with_the_jerk() -> None:
    a, v = 0.0, 0.0
    for k in range(round(0.4 / H)):
        a = shape_velocity(10.0, 0.0, v, a, -2.0, 2.5, 5.0, H, False)
        v += a * H
        assert a == pytest.approx(5.0 * (k + 1) * H)
    for _ in range(round(10.0 / H)):
        a = shape_velocity(10.0, 0.0, v, a, -2.0, 2.5, 5.0, H, False)
        v += a * H
    assert v == pytest.approx(10.0, abs=1e-3)


def test_feed_forward_may_exceed_the_limit_unless_the_total_is_limited() -> None:
    assert shape_velocity(100.0, 3.0, 0.0, 5.4, -2.5, 2.5, 1e3, H, False) == pytest.approx(5.5)
    assert shape_velocity(100.0, 3.0, 0.0, 2.4, -2.5, 2.5, 1e3, H, True) == pytest.approx(2.5)
    an, ae = shape_velocity_ne(100.0, 0.0, 3.0, 0.0, 0.0, 0.0, 2.4, 0.0, 2.5, 1e3, H, True)
    assert (an, ae) == pytest.approx((2.5, 0.0))
    a = shape_position(100.0, 9.0, 0.0, 0.0, 0.0, 0.0, -5.0, 5.0, -1e3, 1e3, 1e9, H, True)
    assert a * H <= 5.0 + 1e-9
    an, ae = shape_position_ne(9.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 1e3, 1e9, H, True)
    assert an * H <= 5.0 + 1e-9


@pytest.mark.parametrize("distance", [5, 8, 10, 20])
def test_the_desired_path_is_the_recorded_one(distance: int) -> None:
    """ArduCopter logged its shaped path at 10 Hz, and the command up to 10 ms late; it began at rest up to 2 mm/s."""
    first_line, real = recording(f"json_north_{distance}m")
    line = Line(real["des_n"][0]).go(first_line["target"][0], 9.0)
    time = np.arange(len(line)) * H
    flown = real["t"] < 8.9
    late = np.arange(5) * H
    apart = [np.abs(np.interp(real["t"] - x, time, line[:, 0]) - real["des_n"])[flown].max() for x in late]
    assert min(apart) < 0.01
    fastest = ((real["des_n"][5:] - real["des_n"][:-5]) / (real["t"][5:] - real["t"][:-5])).max()
    assert line[:, 1].max() == pytest.approx(fastest, abs=0.03)


@settings(deadline=None)
@given(reals, reals, st.sampled_from([-1.0, 0.0, 1.0]), reals, reals)
def test_motion_into_saturation_does_not_enlarge_errors(v: float, a: float, limit: float, ep: float, ev: float) -> None:
    p1, v1 = advance_limited(0.0, v, a, H, limit, ep, ev)
    if limit == 0.0:
        assert (p1, v1) == (v * H + 0.5 * a * H * H, v + a * H)
    if ep * limit > 0.0:
        assert p1 * limit <= 0.0
    if ev * limit > 0.0 and v * limit >= 0.0:
        assert (v1 - v) * limit <= 0.0
    n1 = advance_limited_ne(0.0, 0.0, v, 0.0, a, 0.0, H, limit, 0.0, ep, 0.0, ev, 0.0)
    if ep * limit > 0.0:
        assert n1[0] * limit <= 0.0


def test_clip() -> None:
    assert [clip(x, -1.0, 2.0) for x in (-5.0, 0.5, 7.0)] == [-1.0, 0.5, 2.0]

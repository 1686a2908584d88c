"""Target tracking: the radius follows the closed form, angles become equal; with loss, and when drones come and go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim_models.agents.tracking import TargetTracking, track
from tests.models.agents.point_masses import Array, PointMasses

R, SPEED = 15.0, 3.0


class Chase(PointMasses):
    """Number 0 is the target, which drives straight on; the others track it."""

    def __init__(self, starts: Any, velocity: tuple[float, float] = (0.0, 0.0), **more: Any) -> None:
        given = {"speed_limit": 20.0, "circle": R, "speed": SPEED, "response": more.get("lag", 0.0), **more}
        super().__init__(TargetTracking, track, np.array([(0.0, 0.0), *starts]), **given)
        self.target_velocity = np.array(velocity)
        self.m.position[0, 2] = 0.0

    def turn(self) -> None:
        place = self.plane[0]
        self.m.velocity[0, :2] = self.target_velocity
        super().turn()
        self.m.position[0, :2] = place + float(self.m.period[0]) * self.target_velocity
        self.m.velocity[0, :2] = self.target_velocity

    def polar(self) -> tuple[Array, Array]:
        """Distance from the target [m] and direction [rad] of those that track it and live."""
        n, e = (self.plane[1:] - self.plane[0])[self.alive[1:]].T
        return np.hypot(n, e), np.arctan2(e, n)

    def gaps(self) -> Array:
        """Angles from each drone to the next [rad]."""
        angles = np.sort(self.polar()[1])
        return np.asarray(np.diff(np.append(angles, angles[0] + 2.0 * np.pi)))


def circle(angles: Array, radius: float = R) -> Array:
    return radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)


@pytest.mark.parametrize("start", [60.0, 2.0])
def test_the_distance_from_the_circle_falls_as_the_closed_form(start: float) -> None:
    """s t = r0 - r + R [ln |(r + R) / (r - R)|] from r0 to r; steps of 5 ms."""
    chase = Chase([(start, 0.0)], period=0.005)

    def way(r: float) -> float:
        return float(-r + R * np.log(abs((r + R) / (r - R))))

    radii = []
    for _ in range(1200):
        chase.turn()
        radii.append(chase.polar()[0][0])
    beyond = np.abs(np.array(radii) - R)
    assert (np.diff(beyond) < 0.0).all()
    for k in (199, 599, 1199):
        sign = 1.0 if start > R else -1.0
        assert sign * (way(radii[k]) - way(start)) == pytest.approx(sign * SPEED * 0.005 * (k + 1), rel=2e-3)


@pytest.mark.parametrize(("loss", "rel"), [(0.0, 0.03), (0.2, 0.12)])
def test_angles_become_equal_at_the_rate_of_the_ring(loss: float, rel: float) -> None:
    """In the slowest mode the gaps' deviations shrink as exp(-gain (1 - cos(2 pi / N)) t); loss makes that slower."""
    n, gain = 6, 0.2
    numbers = 2.0 * np.pi * np.arange(n) / n
    chase = Chase(circle(numbers + 0.05 * np.sin(numbers)), phase_gain=gain, period=0.05, loss=loss)
    first = np.ptp(chase.gaps())
    chase.run(10.0)
    rate = np.log(np.ptp(chase.gaps()) / first) / 10.0
    assert rate == pytest.approx(-gain * (1.0 - np.cos(2.0 * np.pi / n)), rel=rel)
    assert chase.polar()[0] == pytest.approx(np.full(n, R), abs=0.3)


def test_on_the_circle_they_fly_clockwise_at_the_speed() -> None:
    chase = Chase(circle(np.array([0.0, np.pi])), period=0.01)
    before = chase.polar()[1][0]
    chase.run(2.0)
    assert np.unwrap([before, chase.polar()[1][0]]) == pytest.approx([before, before + 2.0 * SPEED / R], abs=5e-3)


def test_a_hundred_circle_a_target_that_drives() -> None:
    """From a corner, 212 m away, the closed form above leaves 5.85 m after 60 s and 0.2 m after 120 s; the target's
    drive, the lag and lost packets add to the latter.
    """
    starts = np.random.default_rng(6).uniform(-150.0, 150.0, (100, 2))
    chase = Chase(starts, (1.5, 1.0), loss=0.2, lag=0.3, circle=100.0, speed=6.0, phase_gain=1.0, period=0.4)
    chase.run(60.0)
    assert chase.polar()[0] == pytest.approx(np.full(100, 100.0), abs=5.85)
    first = np.ptp(chase.gaps())
    chase.run(60.0)
    assert chase.polar()[0] == pytest.approx(np.full(100, 100.0), abs=2.0)
    assert np.ptp(chase.gaps()) < 0.8 * first


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_gaps_close_when_one_fails_and_open_for_one_that_joins_or_returns(loss: float) -> None:
    starts = np.random.default_rng(1).uniform(-40.0, 40.0, (5, 2))
    chase = Chase(starts, (1.0, 0.5), loss=loss, lag=0.3, phase_gain=0.3)
    for fails, back in ((5, None), (2, 5), (None, 2)):
        for one, alive in ((fails, False), (back, True)):
            if one is not None:
                chase.alive[one] = alive
        chase.run(90.0)
        count = int(chase.alive[1:].sum())
        assert chase.gaps() == pytest.approx(np.full(count, 2.0 * np.pi / count), abs=0.1)
        assert chase.polar()[0] == pytest.approx(np.full(count, R), abs=1.0)


def test_a_target_that_is_lost_is_followed_for_a_while_and_then_waited_for() -> None:
    chase = Chase([(R, 0.0)], (1.0, 0.0), memory=8.0)
    chase.run(20.0)
    heard = chase.graph.copy()
    chase.connect(np.zeros((2, 2), dtype=bool))
    chase.run(7.0)
    assert chase.polar()[0][0] == pytest.approx(R, abs=0.5)
    chase.run(3.0)
    assert chase.m.circle_error[1] == -1.0
    stands = chase.plane[1]
    chase.run(5.0)
    assert (chase.plane[1] == stands).all()
    chase.connect(heard)
    chase.run(30.0)
    assert chase.m.circle_error[1] < 0.5


def test_one_above_the_target_flies_out_and_those_on_the_ground_do_not_count() -> None:
    chase = Chase([(0.0, 0.0), (R, 0.0)])
    chase.m.position[2, 2], chase.m.altitude[2] = 0.0, 0.0  # has landed on the circle
    chase.run(30.0)
    assert chase.m.ahead[1] == chase.m.behind[1] == pytest.approx(2.0 * np.pi)
    assert chase.polar()[0][0] == pytest.approx(R, abs=0.5)

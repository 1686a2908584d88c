"""Ways of rovers and boats beside ArduRover 4.7.0-dev on the same bodies: times, speeds and places, as seen there."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_small_autopilots import SET_MODE, WAYPOINT, started, upload
from tests.models.copter import ACCEPTED
from tests.models.pair import Pair

AUTO, RTL = 10, 11
SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED
SIMULATED = {"WP_SPEED": 5.0, "WP_RADIUS": 3.0, "CRUISE_THROTTLE": 30.0, "ATC_SPEED_P": 0.1}
"""Parameters of ArduPilot for its simulated rover."""


class Sample(NamedTuple):
    """One of the drive, times from the command on."""

    time: float
    place: tuple[float, float]
    speed: float


def watch(p: Pair, duration: float) -> list[Sample]:
    begin, found = p.time, []
    while p.time < begin + duration - 1e-6:
        p.until(p.time + 0.1)
        n, e = p.place[:2]
        found.append(Sample(p.time - begin, (n, e), math.hypot(p.v["velocity"][0], p.v["velocity"][1])))
    return found


def reached(p: Pair) -> list[int]:
    return [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"]


@cache
def _driven(name: str) -> tuple[list[Sample], list[Sample], list[Sample], list[tuple[int, float]]]:
    """22 m north and 30 m across in GUIDED, and a mission of two waypoints, with times at which they are reached."""
    p = started(name, pilot=SIMULATED)
    p.until(p.time + 1.0)
    assert p.reposition(22.0, 0.0, 0.0) == ACCEPTED
    north = watch(p, 22.0)
    assert p.reposition(22.0, 30.0, 0.0) == ACCEPTED
    across = watch(p, 25.0)
    assert reached(p) == [0, 0]
    items = [(WAYPOINT, 42.0, east, 0.0, (0.0, 0.0)) for east in (30.0, 60.0)]
    assert upload(p, items) == mavlink.MAV_MISSION_ACCEPTED
    p.heard.clear()
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    begin, mission, times = p.time, [], []
    for _ in range(300):
        mission += [one._replace(time=p.time - begin) for one in watch(p, 0.1)]
        times += [(seq, p.time - begin) for seq in reached(p)[len(times) :]]
    return north, across, mission, times


def first(drive: list[Sample], to: tuple[float, float], distance: float) -> float:
    return next(one.time for one in drive if math.dist(one.place, to) < distance)


def stopped(drive: list[Sample]) -> float:
    return max(one.time for one in drive if one.speed > 0.1)


@pytest.mark.parametrize(
    ("name", "half", "near", "halt", "fastest", "rest"),
    [("rover", 5.5, 8.7, 11.1, 3.96, 0.47), ("boat", 5.4, 8.7, 12.2, 3.62, 0.63)],
)
def test_a_place_ahead(name: str, half: float, near: float, halt: float, fastest: float, rest: float) -> None:
    north, _, _, _ = _driven(name)
    assert first(north, (22.0, 0.0), 11.0) == pytest.approx(half, abs=0.15)
    assert first(north, (22.0, 0.0), 2.0) == pytest.approx(near, abs=0.15)
    assert stopped(north) == pytest.approx(halt, rel=0.05)
    assert max(one.speed for one in north) == pytest.approx(fastest, rel=0.05)
    assert math.dist(north[-1].place, (22.0, 0.0)) == pytest.approx(rest, abs=0.45)


@pytest.mark.parametrize(
    ("name", "half", "near", "halt", "fastest", "aside"),
    [("rover", 6.3, 10.6, 12.8, 4.77, 23.79), ("boat", 6.3, 10.6, 14.0, 4.37, 22.74)],
)
def test_a_place_across(name: str, half: float, near: float, halt: float, fastest: float, aside: float) -> None:
    _, across, _, _ = _driven(name)
    assert next(one.time for one in across if one.place[1] > 15.0) == pytest.approx(half, abs=0.15)
    assert first(across, (22.0, 30.0), 2.0) == pytest.approx(near, abs=0.15)
    assert stopped(across) == pytest.approx(halt, rel=0.05)
    assert max(one.speed for one in across) == pytest.approx(fastest, rel=0.05)
    assert max(one.place[0] for one in across) == pytest.approx(aside, abs=0.6)


@pytest.mark.parametrize(
    ("name", "times", "fastest", "corner", "speed"),
    [("rover", (10.4, 21.0), 5.30, 2.46, 2.40), ("boat", (9.8, 21.0), 4.99, 2.56, 2.70)],
)
def test_a_mission(name: str, times: tuple[float, float], fastest: float, corner: float, speed: float) -> None:
    """It passes the first waypoint at `speed` and the distance `corner`."""
    _, _, mission, found = _driven(name)
    assert [seq for seq, _ in found] == [1, 2]
    assert [time for _, time in found] == pytest.approx(times, rel=0.05)
    assert max(one.speed for one in mission) == pytest.approx(fastest, rel=0.05)
    assert min(math.dist(one.place, (42.0, 30.0)) for one in mission) == pytest.approx(corner, rel=0.05)
    passing = next(one for one in mission if one.time > found[0][1] - 0.05)
    assert passing.speed == pytest.approx(speed, rel=0.05)
    assert math.dist(mission[-1].place, (42.0, 60.0)) < 0.6


def test_targets_may_come_ten_times_a_second() -> None:
    """Places after 1 to 10 s of a way of 19.6 m whose target is sent again and again, as ArduRover drove it."""
    p = started("rover", pilot=SIMULATED)
    places = []
    for _ in range(10):
        for _ in range(10):
            p.go(19.6, 0.0, 0.0)
            p.until(p.time + 0.1)
        places.append(p.place[0])
    assert places == pytest.approx([0.06, 0.73, 2.61, 5.64, 9.34, 12.73, 15.43, 17.5, 18.97, 19.77], abs=0.35)


def test_a_place_may_be_given_again_after_a_velocity() -> None:
    p = started("rover")
    assert p.reposition(8.0, 0.0, 0.0) == ACCEPTED
    p.until(p.time + 10.0)
    assert p.place[0] == pytest.approx(8.0, abs=0.5)
    p.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDC7, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0))
    p.until(p.time + 9.0)
    assert p.place[0] > 13.0
    assert p.reposition(8.0, 0.0, 0.0) == ACCEPTED
    p.until(p.time + 20.0)
    assert math.dist(p.place[:2], (8.0, 0.0)) < 1.3
    assert reached(p) == [0, 0]


def test_another_item_begins_its_leg_where_the_rover_can_stop() -> None:
    """A mission of which another item becomes current while the next leg is planned already."""
    p = started("rover")
    items = [(WAYPOINT, n, e, 0.0, (0.0, 0.0)) for n, e in ((20.0, 0.0), (20.0, 20.0), (40.0, 0.0))]
    assert upload(p, items) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    while reached(p) != [1]:
        p.one_step()
        assert p.time < 30.0
    assert p.ask(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 3.0) == ACCEPTED
    drive = watch(p, 20.0)
    assert reached(p) == [1, 3]
    assert max(one.place[1] for one in drive) < 4.0
    assert math.dist(drive[-1].place, (40.0, 0.0)) < 1.0


def test_a_home_right_behind_is_reached_by_turning_about() -> None:
    p = started("rover")
    assert p.reposition(30.0, 0.0, 0.0) == ACCEPTED
    p.until(p.time + 16.0)
    assert p.place[1] == 0.0
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    drive = watch(p, 25.0)
    assert max(one.place[0] for one in drive) < 33.0
    assert math.dist(drive[-1].place, (0.0, 0.0)) < 1.0


@pytest.mark.parametrize("speed", [2.0, 7.0])
def test_a_speed_may_change_on_a_leg(speed: float) -> None:
    """The leg is planned anew from where it is, and the vehicle stops at its end."""
    p = started("rover", pilot={"WP_SPEED": 4.0})
    assert upload(p, [(WAYPOINT, 150.0, 0.0, 0.0, (0.0, 0.0))]) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    before = watch(p, 9.0)
    assert before[-1].speed == pytest.approx(4.0, rel=0.03)
    assert p.ask(SPEED, 1.0, speed) == ACCEPTED
    after = watch(p, 12.0)
    assert after[-1].speed == pytest.approx(speed, rel=0.05)
    steps = [abs(b.speed - a.speed) for a, b in zip(before + after, (before + after)[1:], strict=False)]
    assert max(steps) < 0.15  # ATC_ACCEL_MAX
    last = watch(p, 75.0)
    assert math.dist(last[-1].place, (150.0, 0.0)) < 0.6
    assert last[-1].speed < 0.1


def test_acceleration_and_jerk_of_legs() -> None:
    times = []
    limits: tuple[dict[str, float], ...] = ({}, {"WP_ACCEL": 0.5}, {"WP_JERK": 0.3})
    for one in limits:
        p = started("rover", pilot=one)
        assert upload(p, [(WAYPOINT, 40.0, 0.0, 0.0, (0.0, 0.0))]) == mavlink.MAV_MISSION_ACCEPTED
        assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
        times.append(first(watch(p, 35.0), (40.0, 0.0), 2.0))
    assert times[1] > times[0] + 2.0
    assert times[2] > times[0] + 1.0

"""Missions of planes beside ArduPlane 4.7.0-dev on the same body: its texts, times and touch-down, as heard from it."""

from __future__ import annotations

import math
import re
from functools import cache

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_plane_autoland import worded
from tests.models.autopilot.test_plane_landing import AUTO, LAND, LAND_START, TAKEOFF, item, with_mission
from tests.models.autopilot.test_plane_pilot import high
from tests.models.autopilot.test_rover_failsafes import INFO, texts
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, WAYPOINT, made, started, upload
from tests.models.autopilot.test_small_switches import flying
from tests.models.copter import preset
from tests.models.pair import ACCEPTED, degrees_of

VTOL_LAND = mavlink.MAV_CMD_NAV_VTOL_LAND
SIMULATED = {
    "AIRSPEED_CRUISE": 22.0,
    "AIRSPEED_MIN": 10.0,
    "AIRSPEED_MAX": 30.0,
    "TRIM_THROTTLE": 50.0,
    "THR_MAX": 100.0,
    "TKOFF_THR_MAX": 100.0,
    "PTCH_LIM_MIN_DEG": -20.0,
    "PTCH_LIM_MAX_DEG": 25.0,
    "ROLL_LIMIT_DEG": 65.0,
    "LAND_FLARE_SEC": 3.0,
    "WP_RADIUS": 50.0,
    "RTL_AUTOLAND": 3,
}
"""Parameters of ArduPilot for its simulated plane."""
HEARD = [
    (0.0, "Throttle armed"),
    (0.0, "Armed AUTO, xaccel = -0.0 m/s/s, waiting 0.2 sec"),
    (0.2, "Triggered AUTO. GPS speed = 0.0"),
    (1.9, "Holding course # at #m/s (#)"),
    (1.9, "Autoland direction= #"),
    (10.4, "Takeoff level-off starting at 11m"),
    (12.5, "Takeoff complete at 49.79m"),
    (12.5, "Mission: 2 WP"),
    (25.1, "Reached waypoint #2 dist 51m"),
    (25.1, "Mission: 3 WP"),
    (42.5, "Reached waypoint #3 dist 52m"),
    (42.5, "Mission: 4 LandStart"),
    (42.5, "Mission: 5 WP"),
    (99.6, "Reached waypoint #5 dist 53m"),
    (99.6, "Mission: 6 WP"),
    (120.4, "Reached waypoint #6 dist 35m"),
    (120.4, "Mission: 7 Land"),
    (120.4, "Landing approach start at 59.9m"),
    (126.6, "Landing glide slope 6.3 degrees"),
    (150.3, "Flare 5.2m sink=1.78 speed=16.4 dist=87.4"),
    (190.5, "Throttle disarmed"),
    (190.5, "Auto disarmed"),
]
"""Times [s] from the arming on, and texts."""


@cache
def _mission() -> tuple[list[tuple[float, str]], list[int], tuple[float, ...]]:
    """Texts with times, items that were reached, and place [m], speed and sink [m/s] of the touch-down."""
    p = made("plane", values=preset("ardupilot_plane"), pilot=SIMULATED)
    p.until(2.5)
    items = [
        item(TAKEOFF, 0.0, 0.0, 50.0),
        item(WAYPOINT, 500.0, 0.0, 60.0),
        item(WAYPOINT, 500.0, 400.0, 60.0),
        item(LAND_START, -800.0, 400.0),
        item(WAYPOINT, -800.0, 400.0, 60.0),
        item(WAYPOINT, -600.0, 0.0, 60.0),
        item(LAND),
    ]
    assert upload(p, items) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    p.until(p.time + 0.1)
    assert [text for _, text in texts(p)] == ["Flight plan received", "Mission: 1 Takeoff"]
    begun = p.time
    assert p.ask(ARM, 1) == ACCEPTED
    said: list[tuple[float, str]] = []
    reached: list[int] = []
    touched: tuple[float, ...] = ()
    sink = 0.0
    while p.m.armed or p.time < begun + 1.0:
        reached += [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"]
        said += [(p.time - begun, text) for _, text in texts(p)]
        if not touched and p.time > begun + 60.0 and p.place[2] > -0.05:
            touched = (p.place[0], p.place[1], math.hypot(*p.v.velocity[:2]), sink)
        sink = float(p.v.velocity[2])
        p.one_step()
        assert p.time < begun + 250.0
    p.until(p.time + 0.1)
    return said + [(p.time - begun, text) for _, text in texts(p)], reached, touched


def test_its_texts_are_those_of_arduplane_in_order_and_nearly_in_time() -> None:
    said, reached, _ = _mission()
    plain = [re.sub(r"(Holding course|Autoland direction=) .*", lambda m: worded(m[0]), text) for _, text in said]
    assert [worded(text) for text in plain][: len(HEARD)] == [worded(text) for _, text in HEARD]
    assert worded(plain[-1]) == "Distance from LAND point=#m" and len(plain) == len(HEARD) + 1
    for (time, _), text, (expected, other) in zip(said, plain, HEARD, strict=False):
        assert time == pytest.approx(expected, rel=0.05, abs=0.8), text
        numbers, others = ([float(one) for one in re.findall(r"\d+\.?\d*", words)] for words in (text, other))
        assert numbers == pytest.approx(others, rel=0.05, abs=4.0), (text, other)
    assert reached == [1, 2, 4, 5, 6]  # the DO_LAND_START instead of the waypoint before it


def test_it_touches_down_as_arduplane_does() -> None:
    said, _, (north, east, speed, sink) = _mission()
    assert north == pytest.approx(-19.1, abs=4.0)
    assert east == pytest.approx(-0.1, abs=0.5)
    assert speed == pytest.approx(6.6, abs=0.6)
    assert sink == pytest.approx(0.74, abs=0.4)
    assert float(said[-1][1].split("=")[1][:-1]) == pytest.approx(22.5, abs=7.0)


def test_take_offs_are_as_high_as_those_of_arduplane() -> None:
    p = made("plane", values=preset("ardupilot_plane"), pilot=SIMULATED)
    p.until(2.5)
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    begun = p.time
    assert p.ask(ARM, 1) == ACCEPTED
    at: dict[float, float] = {}
    while p.time < begun + 40.0:
        p.one_step()
        for height in (10.0, 45.0):
            if -p.place[2] > height:
                at.setdefault(height, p.time - begun)
    assert at[10.0] == pytest.approx(4.8, rel=0.05)  # 0.3 s after the arming it was looked at first
    assert at[45.0] == pytest.approx(10.8, rel=0.05)
    assert math.dist(p.place[:2], (200.0, 0.0)) < 100.0  # TKOFF_DIST


@pytest.mark.parametrize(
    ("height", "text"),
    [(100.0, "Above TKOFF alt - loitering"), (150.0, "Climbing to TKOFF alt then loitering")],
)
def test_a_take_off_in_the_air_climbs_if_it_has_to(height: float, text: str) -> None:
    p = high(15)
    p.m.TKOFF_ALT = height if height > 100.0 else 50.0
    texts(p)
    n, e, d = p.place
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    assert texts(p) == [(INFO, text)]
    ahead = math.dist(p.m.guided_position[:2], (n, e))
    assert ahead == pytest.approx(200.0 if height > 100.0 else 0.0, abs=1.0)
    assert p.m.guided_position[2] == pytest.approx(-150.0 if height > 100.0 else d, abs=1.0)


def test_a_leg_that_leads_straight_on_is_over_when_its_waypoint_is_passed() -> None:
    places = [(700.0, 0.0), (1400.0, 0.0), (2100.0, 0.0), (2100.0, 900.0)]
    p = with_mission([item(WAYPOINT, n, e, 100.0) for n, e in places])
    p.until(p.time + 130.0)
    found = [worded(text) for _, text in texts(p) if "waypoint" in text]
    assert found[1:3] == ["Passed waypoint ## dist #m", "Reached waypoint ## dist #m"]


def test_a_new_mission_begins_at_its_first_item_and_auto_goes_on() -> None:
    p = with_mission([item(WAYPOINT, 3000.0, 0.0, 100.0), item(WAYPOINT, 3000.0, 900.0, 100.0)])
    p.until(p.time + 3.0)
    assert upload(p, [item(WAYPOINT, -2000.0, 0.0, 100.0)]) == mavlink.MAV_MISSION_ACCEPTED
    p.until(p.time + 0.2)
    assert (p.m.mode, p.m.mission_current) == (AUTO, 1)
    assert texts(p)[-1] == (INFO, "Mission: 1 WP")


def test_rovers_tell_their_items_too() -> None:
    p = started("rover")
    p.send(mavlink.MAVLink_mission_count_message(1, 1, 3))
    p.until(p.time + 0.1)
    for number in range(3):
        lat, lon = degrees_of(10.0 * number, 0.0)
        p.send(mavlink.MAVLink_mission_item_int_message(1, 1, number, 6, WAYPOINT, 0, 1, number, 0, 0, 0, lat, lon, 0))
        p.until(p.time + 0.1)
    assert texts(p)[-1] == (INFO, "Flight plan received")
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    p.until(p.time + 30.0)
    assert [text for _, text in texts(p)] == [
        "Mission: 1 WP",
        "Reached waypoint #1. Loiter for 1 seconds",
        "Mission: 2 WP",
        "Reached waypoint #2. Loiter for 2 seconds",
        "Mission Complete",
    ]


def test_quadplanes_land_as_arduplane_after_an_approach() -> None:
    """Heard from ArduPlane: "VTOL approach d=299.6" in a mission, "VTOL airbrake v=20.0 d=139 sd=140" in QRTL."""
    p = flying("quadplane", AIRSPEED_CRUISE=25.0, AIRSPEED_MIN=13.0, AIRSPEED_MAX=35.0, Q_TRANS_DECEL=2.0)
    items = [item(WAYPOINT, 0.0, 400.0, 40.0), item(WAYPOINT, -100.0, 300.0, 40.0), item(VTOL_LAND, 0.0, 0.0)]
    assert upload(p, items) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    p.until(p.time + 70.0)
    found = [text for _, text in texts(p) if text.startswith("VTOL")]
    assert [worded(text) for text in found[:2]] == ["VTOL approach d=#", "VTOL airbrake v=# d=# sd=# h=#"]
    speed, distance, stop, _ = (float(one) for one in re.findall(r"=(\d+\.?\d*)", found[1]))
    assert speed == pytest.approx(20.0, abs=1.0)
    assert distance == pytest.approx(139.0, abs=10.0) and stop == pytest.approx(140.0, abs=10.0)


def test_a_vertical_take_off_is_as_high_as_that_of_arduplane() -> None:
    p = made("quadplane")
    p.until(2.5)
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p.until(p.time + 0.5)
    begun = p.time
    assert p.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20.0) == ACCEPTED
    at: dict[float, float] = {}
    while p.time < begun + 12.0:
        p.one_step()
        for height in (10.0, 19.0):
            if -p.place[2] > height:
                at.setdefault(height, p.time - begun)
    assert (at[10.0], at[19.0]) == pytest.approx((5.2, 8.8), rel=0.05)

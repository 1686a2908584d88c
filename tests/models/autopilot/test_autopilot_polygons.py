"""Fences of polygons and circles: uploaded and read back by the mission protocol, kept in flight."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.mission.fences import fence_is_whole, keep_fence_item, place_fence, within_polygons
from tests.models.copter import GUIDED, ONLY_VELOCITY, RTL, Copter

FENCE = 1
INCLUSION = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
EXCLUSION = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE_IN = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
CIRCLE_OUT = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
RETURN = mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT
WAYPOINT, TAKEOFF = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_TAKEOFF
LAT, LON = -35.363262, 149.165237
DEG_PER_M = 1e-7 / 0.011131884502145034
Item = tuple[int, float, float, float]  # command, param 1, north and east of the origin [m]


def degrees(north: float, east: float) -> tuple[int, int]:
    return round((LAT + north * DEG_PER_M) * 1e7), round((LON + east * DEG_PER_M / math.cos(math.radians(LAT))) * 1e7)


def square(command: int, side: float, north: float = 0.0, east: float = 0.0) -> list[Item]:
    half = 0.5 * side
    corners = ((-half, -half), (-half, half), (half, half), (half, -half))
    return [(command, 4.0, north + n, east + e) for n, e in corners]


def upload(copter: Copter, items: list[Item], kind: int = FENCE, whole: bool = True) -> int:
    """Send the items as they are asked for; the result of the MISSION_ACK."""
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for _ in range(len(items) + 3):
        copter.run(0.0075)
        asked = [m for m in copter.messages("MISSION_REQUEST") if m.mission_type == kind]
        acks = copter.messages("MISSION_ACK")
        copter.heard.clear()
        if acks:
            assert acks[-1].mission_type == kind
            return int(acks[-1].type)
        for request in asked[-1:]:
            command, p1, north, east = items[request.seq]
            lat, lon = degrees(north, east)
            head = (1, 1, request.seq, 0, command, 0, 1, p1, 0, 0, 0)
            if whole:
                copter.send(mavlink.MAVLink_mission_item_int_message(*head, lat, lon, 0, kind))
            else:
                copter.send(mavlink.MAVLink_mission_item_message(*head, lat * 1e-7, lon * 1e-7, 0, kind))
    raise AssertionError("no answer")


@pytest.fixture
def copter() -> Copter:
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_TYPE": 4})
    copter.run(0.5)
    return copter


def test_a_fence_is_read_back_as_it_was_sent(copter: Copter) -> None:
    items = [*square(INCLUSION, 40.0), *square(EXCLUSION, 4.0, 10.0), (CIRCLE_OUT, 2.5, -9.0, 1.0), (RETURN, 0.0, 0, 0)]
    assert upload(copter, items) == 0
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_request_list_message(1, 1, FENCE))
    for i in range(len(items)):
        copter.send(mavlink.MAVLink_mission_request_int_message(1, 1, i, FENCE))
    copter.run(0.1)
    (count,) = copter.messages("MISSION_COUNT")
    assert (count.count, count.mission_type) == (len(items), FENCE)
    told = copter.messages("MISSION_ITEM_INT")
    assert [(m.command, m.param1, m.x, m.y) for m in told] == [(c, p, *degrees(n, e)) for c, p, n, e in items]
    assert {(m.frame, m.mission_type) for m in told} == {(0, FENCE)}
    copter.send(mavlink.MAVLink_mission_request_message(1, 1, 1, FENCE))
    copter.run(0.01)
    (item,) = copter.messages("MISSION_ITEM")
    assert item.x == pytest.approx(degrees(-20.0, 20.0)[0] * 1e-7, abs=1e-5)


def test_missions_and_fences_do_not_disturb_each_other(copter: Copter) -> None:
    mission = [(WAYPOINT, 0.0, 0.0, 0.0), (TAKEOFF, 0.0, 0.0, 0.0), (WAYPOINT, 0.0, 5.0, 5.0)]
    assert upload(copter, mission, kind=0) == 0
    assert upload(copter, square(INCLUSION, 40.0), whole=False) == 0
    assert (copter.m["mission_count"], copter.m["fence_count"]) == (3, 4)
    copter.send(mavlink.MAVLink_mission_clear_all_message(1, 1, FENCE))
    copter.run(0.01)
    assert (copter.m["mission_count"], copter.m["fence_count"]) == (3, 0)
    upload(copter, square(INCLUSION, 40.0))
    copter.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 255))
    copter.run(0.01)
    assert copter.messages("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_UNSUPPORTED  # as ArduCopter: kind by kind
    assert (copter.m["mission_count"], copter.m["fence_count"]) == (3, 4)
    copter.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    copter.run(0.01)
    assert (copter.m["mission_count"], copter.m["fence_count"]) == (0, 4)


@pytest.mark.parametrize(
    ("items", "result"),
    [
        (square(INCLUSION, 9.0)[:3], 1),  # a vertex is missing
        ([*square(INCLUSION, 9.0)[:2], *square(EXCLUSION, 9.0)[:2]], 1),
        ([(INCLUSION, 2.0, 0.0, 0.0)], 6),
        ([(CIRCLE_IN, 0.0, 0.0, 0.0)], 6),
        ([(WAYPOINT, 0.0, 0.0, 0.0)], 3),
        (square(INCLUSION, 9.0) * 18, 4),  # no space
    ],
)
def test_fences_that_cannot_be(copter: Copter, items: list[Item], result: int) -> None:
    assert upload(copter, items) == result
    assert copter.m["fence_count"] == 0


def test_other_kinds_of_items_are_unsupported(copter: Copter) -> None:
    assert upload(copter, [(mavlink.MAV_CMD_NAV_RALLY_POINT, 0.0, 0.0, 0.0)], kind=3) == 3


@pytest.mark.parametrize(
    ("items", "way"),
    [
        (square(INCLUSION, 20.0), (5.0, 0.0)),
        (square(EXCLUSION, 6.0, 12.0), (5.0, 0.0)),
        ([(CIRCLE_IN, 10.0, 0.0, 0.0)], (0.0, 5.0)),
        ([(CIRCLE_OUT, 4.0, 0.0, 12.0)], (0.0, 5.0)),
    ],
)
def test_crossing_a_fence_returns(items: list[Item], way: tuple[float, float]) -> None:
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_TYPE": 4, "AVOID_ENABLE": 0}).in_the_air(5.0, 10.0)
    assert upload(copter, items) == 0
    copter.run(1.0)
    assert copter.m["mode"] == GUIDED
    copter.heard.clear()
    began = copter.time
    while copter.m["mode"] == GUIDED:
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=way[0], vy=way[1])
        copter.run(0.25)
        assert copter.time < began + 8.0
    assert copter.m["mode"] == RTL
    assert max(abs(x) for x in copter.v["position"][:2]) == pytest.approx(10.0, abs=1.5)
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_FENCE_STATUS)
    copter.run(0.01)
    assert (4, "Polygon fence breached") in [(m.severity, m.text) for m in copter.messages("STATUSTEXT")]
    (status,) = copter.messages("FENCE_STATUS")
    assert (status.breach_status, status.breach_count, status.breach_type) == (1, 1, 3)
    assert status.breach_time == pytest.approx(copter.time * 1000.0, abs=400)


def test_a_fence_is_switched_by_command() -> None:
    copter = Copter(autopilot={"FENCE_TYPE": 4}).in_the_air(5.0, 10.0)
    upload(copter, square(INCLUSION, 4.0))
    assert copter.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_FENCE_STATUS) == [
        ("ACK", mavlink.MAV_CMD_REQUEST_MESSAGE, 0)
    ]
    assert copter.messages("FENCE_STATUS") == []  # not watched: nothing to say
    copter.go(10.0, 0.0, -5.0)
    copter.run(4.0)
    assert copter.m["mode"] == GUIDED
    assert copter.ask(mavlink.MAV_CMD_DO_FENCE_ENABLE, 2) == [("ACK", mavlink.MAV_CMD_DO_FENCE_ENABLE, 0)]
    assert copter.ask(mavlink.MAV_CMD_DO_FENCE_ENABLE, math.nan) == [("ACK", mavlink.MAV_CMD_DO_FENCE_ENABLE, 4)]
    copter.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1)
    copter.run(0.3)
    assert copter.m["mode"] == RTL


coordinate = st.integers(-50_000, 50_000).map(lambda x: x / 1000.0)


@settings(max_examples=100, deadline=None)
@given(
    corners=st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=8, unique=True),
    point=st.tuples(coordinate, coordinate),
    exclusion=st.booleans(),
)
def test_within_a_polygon_is_what_matplotlib_says(
    corners: list[tuple[float, float]], point: tuple[float, float], exclusion: bool
) -> None:
    north, east = (sum(c[i] for c in corners) / len(corners) for i in range(2))
    corners = sorted(corners, key=lambda c: math.atan2(c[1] - east, c[0] - north))  # so that no sides cross
    sides = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    assume(abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in sides)) > 1.0)
    m: Any = Autopilot.record()
    for i, corner in enumerate(corners):
        lat, lon = degrees(*corner)
        keep_fence_item(m, i, EXCLUSION if exclusion else INCLUSION, float(len(corners)), float(lat), float(lon))
    assert fence_is_whole(m, len(corners))
    place_fence(m, len(corners))
    polygon = Polygon([*corners, corners[0]], closed=True)
    near, far = polygon.contains_point(point, radius=0.03), polygon.contains_point(point, radius=-0.03)
    if near == far:  # not on the line, as far as rounding to 1e-7 degrees goes
        assert within_polygons(m, *point) == (bool(near) != exclusion)


@pytest.mark.parametrize(
    ("items", "way", "stop"),
    [
        (square(INCLUSION, 40.0), (4.0, 0.0), (18.0, 0.0)),
        (square(INCLUSION, 40.0), (3.0, 4.0), (18.0, 18.0)),  # slides along the edge into the corner
        (square(EXCLUSION, 10.0, north=20.0), (4.0, 0.0), (13.0, 0.0)),
        ([(CIRCLE_IN, 20.0, 0.0, 0.0)], (0.0, -4.0), (0.0, -18.0)),
        ([(CIRCLE_OUT, 5.0, 0.0, 20.0)], (0.0, 4.0), None),  # slides round it
    ],
)
def test_velocities_end_at_the_margin_of_an_uploaded_fence(
    items: list[Item], way: tuple[float, float], stop: tuple[float, float] | None
) -> None:
    """The vehicle lags behind the velocity, so that it comes to rest up to 0.7 m nearer."""
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_TYPE": 4}).in_the_air(5.0, 10.0)
    assert upload(copter, items) == 0
    for _ in range(150):
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=way[0], vy=way[1])
        copter.run(0.1)
    assert copter.m["mode"] == GUIDED
    n, e, _ = copter.v["position"]
    if stop is None:
        assert math.hypot(n, e - 20.0) == pytest.approx(7.0, abs=0.7)
    else:
        assert (n, e) == pytest.approx(stop, abs=0.7)
    assert not copter.m["fence_breach"]


def test_away_from_an_edge_the_velocity_is_free() -> None:
    """South of the exclusion, a velocity along its edge, 3 m away, is not changed."""
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_TYPE": 4}).in_the_air(5.0, 10.0)
    assert upload(copter, square(EXCLUSION, 30.0, north=18.1)) == 0
    for _ in range(12):
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vy=3.0)
        copter.run(0.25)
    assert copter.v["velocity"][:2] == pytest.approx((0.0, 3.0), abs=0.15)

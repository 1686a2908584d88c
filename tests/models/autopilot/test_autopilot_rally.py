"""Rally points: uploaded, downloaded, refused, cleared, and which of them RTL flies to."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.mission.rally import RALLY_CAPACITY, best_return
from tests.models.autopilot.test_autopilot_missions import LAT, LON, METRE, replies
from tests.models.copter import ACCEPTED, RTL, Copter

RALLY = mavlink.MAV_MISSION_TYPE_RALLY
POINT = mavlink.MAV_CMD_NAV_RALLY_POINT
EAST = METRE / 0.8155  # 1e-7 degrees of longitude per metre at 35.363 degrees south


def point(sequence: int, north: float, east: float = 0.0, z: float = 0.0, frame: int = 3, command: int = POINT) -> Any:
    place = (LAT + round(north * METRE), LON + round(east * EAST), z)
    return mavlink.MAVLink_mission_item_int_message(1, 1, sequence, frame, command, 0, 0, 0, 0, 0, 0, *place, RALLY)


def upload(copter: Copter, *points: Any) -> list[Any]:
    answer = replies(copter, mavlink.MAVLink_mission_count_message(1, 1, len(points), RALLY))
    for i, one in enumerate(points):
        assert [(m.get_type(), m.seq, m.mission_type) for m in answer] == [("MISSION_REQUEST", i, RALLY)]
        answer = replies(copter, one)
        if answer[0].get_type() == "MISSION_ACK":
            break
    return [(m.get_type(), m.type, m.mission_type) for m in answer]


@pytest.fixture
def copter() -> Copter:
    copter = Copter(autopilot={"RALLY_INCL_HOME": 0, "RALLY_LIMIT_KM": 0.0})
    copter.run(2.1)
    copter.heard.clear()
    return copter


def test_points_come_back_as_they_went(copter: Copter) -> None:
    points = [point(0, 100.0, 20.0, 30.7), point(1, -50.0, 0.0, 600.0, frame=0), point(2, 1.0, z=-5.9, frame=6)]
    assert upload(copter, *points) == [("MISSION_ACK", 0, RALLY)]
    (count,) = replies(copter, mavlink.MAVLink_mission_request_list_message(1, 1, RALLY))
    assert (count.count, count.mission_type) == (3, RALLY)
    for one, frame, z in zip(points, (3, 0, 3), (30.0, 600.0, -5.0), strict=True):  # whole metres are kept
        (back,) = replies(copter, mavlink.MAVLink_mission_request_int_message(1, 1, one.seq, RALLY))
        assert (back.command, back.frame, back.x, back.y, back.z) == (POINT, frame, one.x, one.y, z)
        assert (back.seq, back.mission_type, back.current, back.autocontinue) == (one.seq, RALLY, 0, 0)
        back, *_ = replies(copter, mavlink.MAVLink_mission_request_message(1, 1, one.seq, RALLY))
        assert (back.get_type(), back.x) == ("MISSION_ITEM", pytest.approx(one.x * 1e-7, rel=1e-6))
    count, wrong = replies(copter, mavlink.MAVLink_mission_request_int_message(1, 1, 3, RALLY))
    assert (count.get_type(), count.count) == ("MISSION_COUNT", 3)
    assert (wrong.get_type(), wrong.type, wrong.mission_type) == ("MISSION_ACK", 13, RALLY)


def test_points_are_cleared_alone(copter: Copter) -> None:
    """By their own kind, or by an empty list; of "all kinds" (255) ArduCopter knows nothing."""
    upload(copter, point(0, 10.0))
    for kind, result in ((0, mavlink.MAV_MISSION_ACCEPTED), (255, mavlink.MAV_MISSION_UNSUPPORTED)):
        (ack,) = replies(copter, mavlink.MAVLink_mission_clear_all_message(1, 1, kind))
        assert (ack.type, copter.m["rally_count"]) == (result, 1)
    (ack,) = replies(copter, mavlink.MAVLink_mission_clear_all_message(1, 1, RALLY))
    assert (ack.type, copter.m["rally_count"]) == (mavlink.MAV_MISSION_ACCEPTED, 0)
    upload(copter, point(0, 10.0))
    assert upload(copter) == [("MISSION_ACK", 0, RALLY)]
    assert copter.m["rally_count"] == 0


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        (point(0, 1.0, command=mavlink.MAV_CMD_NAV_WAYPOINT), 3),
        (point(0, 1.0, frame=10), 2),
        (point(0, 1.0, z=40000.0), 12),
        (point(0, 1.0, z=float("nan")), 12),
        (mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, POINT, 0, 0, 0, 0, 0, 0, 900000001, 0, 1.0, RALLY), 10),
        (mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, POINT, 0, 0, 0, 0, 0, 0, 0, 1800000001, 1.0, RALLY), 11),
        (point(1, 1.0), 13),
    ],
)
def test_what_is_no_rally_point_is_refused(copter: Copter, bad: Any, result: int) -> None:
    assert upload(copter, bad) == [("MISSION_ACK", result, RALLY)]
    assert copter.m["rally_count"] == 0


def test_more_points_than_there_is_room_for_are_refused(copter: Copter) -> None:
    count = mavlink.MAVLink_mission_count_message(1, 1, RALLY_CAPACITY + 1, RALLY)
    assert [(m.get_type(), m.type) for m in replies(copter, count)] == [("MISSION_ACK", 4)]


# ---- which one -----------------------------------------------------------------------------------------------------


def goal(copter: Copter, at: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float, float]:
    """Where RTL goes from a place north and east of home, and its height above home."""
    copter.m["position_neu"][:2] = at
    return tuple(float(x) for x in best_return(copter.m))  # type: ignore[return-value]


def near(north: float, east: float = 0.0, height: float = 0.0) -> Any:
    return pytest.approx((north, east, height), abs=0.02)


def test_the_nearest_point_wins(copter: Copter) -> None:
    assert goal(copter) == near(0.0)
    upload(copter, point(0, 100.0, z=20.0), point(1, -50.0, 30.0, z=600.0, frame=0))
    assert goal(copter) == near(-50.0, 30.0, 600.0 - 584.0)
    assert goal(copter, (90.0, 0.0)) == near(100.0, height=20.0)


def test_home_counts_as_a_point_by_default(copter: Copter) -> None:
    copter.m["RALLY_INCL_HOME"] = 1
    upload(copter, point(0, 100.0))
    assert goal(copter, (49.0, 0.0)) == near(0.0)
    assert goal(copter, (51.0, 0.0)) == near(100.0)


def test_points_beyond_the_limit_do_not_count(copter: Copter) -> None:
    copter.m["RALLY_LIMIT_KM"] = 0.3
    upload(copter, point(0, 299.0))
    assert goal(copter) == near(299.0)
    assert goal(copter, (-2.0, 0.0)) == near(0.0)


def test_points_outside_of_the_fences_do_not_count(copter: Copter) -> None:
    upload(copter, point(0, 100.0, z=20.0), point(1, 10.0, z=110.0), point(2, 200.0), point(3, 60.0, z=-20.0))
    assert goal(copter) == near(10.0, height=110.0)
    copter.m["FENCE_ENABLE"], copter.m["FENCE_TYPE"] = 1, 15
    assert goal(copter) == near(100.0, height=20.0)  # 110 m is above, 200 m outside, -20 m below
    copter.m["FENCE_TYPE"] = 8
    assert goal(copter) == near(10.0, height=110.0)
    copter.m["FENCE_RADIUS"], copter.m["FENCE_TYPE"] = 50.0, 15
    assert goal(copter) == near(0.0)


def test_a_point_that_is_no_place_does_not_count(copter: Copter) -> None:
    upload(copter, mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, POINT, 0, 0, 0, 0, 0, 0, 0, 0, 5.0, RALLY))
    assert goal(copter) == near(0.0)


def test_rtl_lands_at_the_point_and_climbs_to_its_height() -> None:
    copter = Copter(autopilot={"RALLY_INCL_HOME": 0, "RTL_ALT": 800.0, "RTL_CONE_SLOPE": 0.0})
    copter.in_the_air(5.0, 10.0)
    upload(copter, point(0, 12.0, -9.0, z=11.0))
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    flight = copter.run(60.0)
    assert -flight[:, 3].min() == pytest.approx(11.0, abs=0.3)
    assert copter.v["position"] == pytest.approx((12.0, -9.0, 0.0), abs=0.4)
    assert not copter.m["armed"]

"""Missions: uploaded, downloaded, refused and flown; MISSION_ITEM as a guided target."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.mission.missions import MISSION_CAPACITY
from tests.models.copter import ACCEPTED, FAILED, GUIDED, Copter, H

LAT, LON = -353632620, 1491652370
METRE = 1.0 / 0.011131884502145034
"""1e-7 degrees of latitude."""
AUTO = mavlink.COPTER_MODE_AUTO


def item(
    sequence: int,
    command: int,
    *values: float,
    north: float = 0.0,
    east: float = 0.0,
    z: float = 0.0,
    frame: int = 3,
) -> Any:
    """MISSION_ITEM_INT at a place north and east of home; without north no place."""
    p = [*values, *[0.0] * (4 - len(values))]
    along = METRE / math.cos(math.radians(1e-7 * LAT))
    place = (LAT + round(north * METRE), LON + round(east * along)) if north else (0, 0)
    return mavlink.MAVLink_mission_item_int_message(1, 1, sequence, frame, command, 0, 1, *p, *place, z, 0)


def replies(copter: Copter, *messages: Any) -> list[Any]:
    """What is said within two steps, but for HEARTBEATs."""
    copter.heard.clear()
    copter.send(*messages)
    copter.run(2 * H)
    found = [m for _, m in copter.heard if m.get_type() != "HEARTBEAT"]
    copter.heard.clear()
    return found


def upload(copter: Copter, *items: Any) -> list[Any]:
    """Upload as ground stations do; what the last item was answered with."""
    answer = replies(copter, mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
    for i, one in enumerate(items):
        assert [(m.get_type(), m.seq) for m in answer] == [("MISSION_REQUEST", i)]
        assert (answer[0].target_system, answer[0].target_component) == (255, 190)
        answer = replies(copter, one)
        if answer[0].get_type() == "MISSION_ACK":
            break
    return answer


@pytest.fixture
def copter() -> Copter:
    copter = Copter()
    copter.run(2.1)
    copter.heard.clear()
    return copter


HOME = item(0, mavlink.MAV_CMD_NAV_WAYPOINT)
FLIGHT = (
    HOME,
    item(1, mavlink.MAV_CMD_NAV_TAKEOFF, z=5.0),
    item(2, mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0),
    item(3, mavlink.MAV_CMD_NAV_WAYPOINT, north=10.0, z=6.0),
    item(4, mavlink.MAV_CMD_NAV_WAYPOINT, 1.0, north=20.0, z=6.0),
    item(5, mavlink.MAV_CMD_NAV_DELAY, 1.0),
    item(6, mavlink.MAV_CMD_NAV_LAND, north=20.0),
)


def test_a_mission_comes_back_as_it_went(copter: Copter) -> None:
    ack, text = upload(copter, *FLIGHT)
    assert (ack.get_type(), ack.type, ack.target_system) == ("MISSION_ACK", 0, 255)
    assert text.text == "Flight plan received"
    (count,) = replies(copter, mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert count.count == len(FLIGHT)
    for i, one in enumerate(FLIGHT[1:], 1):
        (back,) = replies(copter, mavlink.MAVLink_mission_request_int_message(1, 1, i, 0))
        for name in ("seq", "frame", "command", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z"):
            assert getattr(back, name) == getattr(one, name)
        back, *_ = replies(copter, mavlink.MAVLink_mission_request_message(1, 1, i, 0))
        assert (back.get_type(), back.x) == ("MISSION_ITEM", pytest.approx(one.x * 1e-7, rel=1e-6))
    (home,) = replies(copter, mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0))
    assert (home.x, home.y, home.command) == (LAT, LON, 16)
    total, wrong = replies(copter, mavlink.MAVLink_mission_request_int_message(1, 1, len(FLIGHT), 0))
    assert (total.get_type(), total.count) == ("MISSION_COUNT", len(FLIGHT))
    assert (wrong.get_type(), wrong.type) == ("MISSION_ACK", 13)


def test_floats_are_taken_too(copter: Copter) -> None:
    one = mavlink.MAVLink_mission_item_message(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, -35.25, 149.25, 7.0, 0)
    assert upload(copter, HOME, one)[0].type == 0
    (back,) = replies(copter, mavlink.MAVLink_mission_request_int_message(1, 1, 1, 0))
    assert (back.x, back.y, back.z) == (-352500000, 1492500000, 7.0)


def test_without_a_mission_there_is_home_from_when_it_is_known(copter: Copter) -> None:
    """As in ArduCopter: home is an item when it is set, thus also when the vehicle is armed after the clearing."""
    (count,) = replies(copter, mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert count.count == 1
    upload(copter, *FLIGHT)
    (ack,) = replies(copter, mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert ack.type == 0
    (count,) = replies(copter, mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert count.count == 0
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0][2] == 0
    counts = [
        m
        for m in replies(copter, mavlink.MAVLink_mission_request_list_message(1, 1, 0))
        if m.get_type() == "MISSION_COUNT"
    ]
    assert [m.count for m in counts] == [1]


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        (item(1, mavlink.MAV_CMD_NAV_PAYLOAD_PLACE, north=1.0), 3),
        (item(1, mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT, 0.0, 0.0, 0.0, float("nan"), north=1.0), 9),
        (item(1, mavlink.MAV_CMD_NAV_WAYPOINT, north=1.0, frame=8), 2),
        (item(1, mavlink.MAV_CMD_NAV_WAYPOINT, float("nan"), north=1.0), 6),
        (mavlink.MAVLink_mission_item_int_message(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, 900000001, 0, 1.0, 0), 10),
        (item(2, mavlink.MAV_CMD_NAV_WAYPOINT, north=1.0), 13),
    ],
)
def test_items_that_cannot_be_flown_are_refused(copter: Copter, bad: Any, result: int) -> None:
    assert [m.type for m in upload(copter, HOME, bad)] == [result]


def test_counts_that_cannot_be_held_are_refused(copter: Copter) -> None:
    (ack,) = replies(copter, mavlink.MAVLink_mission_count_message(1, 1, MISSION_CAPACITY + 1, 0))
    assert ack.type == 4
    (ack,) = replies(copter, mavlink.MAVLink_mission_count_message(1, 1, 3, 3))
    assert ack.type == 3


def test_who_comes_while_another_uploads_is_denied(copter: Copter) -> None:
    replies(copter, mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    other = mavlink.MAVLink(None, srcSystem=254, srcComponent=190)
    copter.station, mine = other, copter.station
    for one in (
        mavlink.MAVLink_mission_count_message(1, 1, 1, 0),
        item(0, mavlink.MAV_CMD_NAV_WAYPOINT, north=1.0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
    ):
        (ack,) = replies(copter, one)
        assert (ack.get_type(), ack.type, ack.target_system) == ("MISSION_ACK", 14, 254)
    copter.station = mine
    assert [m.seq for m in replies(copter, HOME)] == [1]
    assert replies(copter, item(1, mavlink.MAV_CMD_NAV_WAYPOINT, north=5.0, z=5.0))[0].type == 0
    copter.station = other
    assert [m.count for m in replies(copter, mavlink.MAVLink_mission_request_list_message(1, 1, 0))] == [2]


def test_lost_items_are_asked_for_again_and_given_up(copter: Copter) -> None:
    replies(copter, mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    copter.run(9.0)
    requests = [t for t, m in copter.heard if m.get_type() == "MISSION_REQUEST"]
    assert np.diff(requests) == pytest.approx(1.0)
    assert len(requests) == 7
    assert [m.type for m in copter.messages("MISSION_ACK")] == [15]


def test_auto_needs_a_mission_that_begins_with_a_takeoff(copter: Copter) -> None:
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO) == [
        ("ACK", mavlink.MAV_CMD_DO_SET_MODE, FAILED),
        ("TEXT", 4, "Mode change to AUTO failed: init failed"),
    ]
    upload(copter, HOME, item(1, mavlink.MAV_CMD_NAV_WAYPOINT, north=5.0, z=5.0))
    assert copter.ask(mavlink.MAV_CMD_MISSION_START) == [
        ("ACK", mavlink.MAV_CMD_MISSION_START, FAILED),
        ("TEXT", 4, "Auto: Missing Takeoff Cmd"),
    ]


def test_a_mission_is_flown(copter: Copter) -> None:
    upload(copter, *FLIGHT)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert copter.ask(mavlink.MAV_CMD_MISSION_START)[0] == ("ACK", mavlink.MAV_CMD_MISSION_START, ACCEPTED)
    copter.heard.clear()
    flight = copter.run(48.0)
    assert [m.text for m in copter.messages("STATUSTEXT")] == [
        "Mission: 2 ChangeSpeed",
        "Mission: 3 WP",
        "Reached command #3",
        "Mission: 4 WP",
        "Reached command #4",
        "Mission: 5 Delay",
        "Mission: 6 Land",
        "Disarming motors",
    ]
    assert [m.seq for m in copter.messages("MISSION_ITEM_REACHED")] == [1, 2, 3, 4, 5, 6]
    assert flight[:, 4].max() < 4.2
    assert -flight[:, 3].min() == pytest.approx(6.0, abs=0.2)
    assert copter.v["position"][0] == pytest.approx(20.0, abs=0.3)
    assert not copter.m["armed"]
    assert copter.m["mode"] == AUTO


def test_a_takeoff_below_the_vehicle_is_done_at_once(copter: Copter) -> None:
    """As in ArduCopter, which never descends for a take-off."""
    copter.in_the_air(15.0, 16.0)
    upload(
        copter,
        HOME,
        item(1, mavlink.MAV_CMD_NAV_TAKEOFF, z=5.0),
        item(2, mavlink.MAV_CMD_NAV_WAYPOINT, north=8.0, z=15.0),
    )
    copter.answers()
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    flight = copter.run(3.0)
    assert "Mission: 2 WP" in [m.text for m in copter.messages("STATUSTEXT")]
    assert -flight[:, 3].max() > 14.8


def test_a_landing_begins_with_a_leg_at_the_present_height_in_whole_centimetres(copter: Copter) -> None:
    """As in ArduCopter, whose Location has no parts of a centimetre; without a place, there is no such leg."""
    copter.in_the_air(5.0, 10.0)
    upload(copter, HOME, item(1, mavlink.MAV_CMD_NAV_TAKEOFF, z=1.0), item(2, mavlink.MAV_CMD_NAV_LAND, north=1.0))
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    while copter.m["auto_command"] != mavlink.MAV_CMD_NAV_LAND:
        copter.tick()
    sea = 100.0 * (copter.m["origin_altitude"] + copter.m["guided_position_neu"][2])
    assert sea == pytest.approx(round(sea), abs=1e-6)
    assert 0.0 <= copter.m["position_neu"][2] - copter.m["guided_position_neu"][2] < 0.01 + 1e-9
    begun = copter.time
    while not copter.m["auto_landing"]:
        copter.tick()
    assert 2.0 < copter.time - begun < 6.0  # a metre north
    copter = Copter().in_the_air(5.0, 10.0)
    upload(copter, HOME, item(1, mavlink.MAV_CMD_NAV_TAKEOFF, z=1.0), item(2, mavlink.MAV_CMD_NAV_LAND))
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    while copter.m["auto_command"] != mavlink.MAV_CMD_NAV_LAND:
        copter.tick()
    assert copter.m["auto_landing"]


def test_a_takeoff_climbs_at_least_a_metre(copter: Copter) -> None:
    upload(copter, HOME, item(1, mavlink.MAV_CMD_NAV_TAKEOFF, z=0.2), item(2, mavlink.MAV_CMD_NAV_LOITER_UNLIM))
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.ask(mavlink.MAV_CMD_MISSION_START)
    assert -copter.run(9.0)[-1, 3] == pytest.approx(1.0, abs=0.15)


def test_a_jump_is_taken_as_often_as_it_says() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.heard.clear()
    upload(
        copter,
        HOME,
        item(1, mavlink.MAV_CMD_NAV_WAYPOINT, north=6.0, z=5.0),
        item(2, mavlink.MAV_CMD_NAV_WAYPOINT, north=12.0, z=5.0),
        item(3, mavlink.MAV_CMD_DO_JUMP, 1, 2),
    )
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    copter.run(30.0)
    reached = [m.seq for m in copter.messages("MISSION_ITEM_REACHED")]
    assert reached == [1, 2, 1, 2, 1, 2]
    assert copter.m["mission_complete"]
    assert copter.v["position"][0] == pytest.approx(12.0, abs=2.5)


def test_the_current_item_can_be_set() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    upload(
        copter,
        HOME,
        item(1, mavlink.MAV_CMD_NAV_WAYPOINT, north=50.0, z=5.0),
        item(2, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
    )
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    current, *_ = replies(copter, mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert (current.get_type(), current.seq, current.total) == ("MISSION_CURRENT", 2, 2)
    assert replies(copter, mavlink.MAVLink_mission_set_current_message(1, 1, 9)) == []
    copter.run(40.0)
    assert not copter.m["armed"]


@pytest.mark.parametrize("whole", [True, False])
def test_items_are_guided_targets(whole: bool) -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    lat = LAT + round(8.0 * METRE)
    if whole:
        one = mavlink.MAVLink_mission_item_int_message(0, 0, 0, 6, 16, 2, 0, 0, 0, 0, 0, lat, LON, 7.0, 0)
    else:
        one = mavlink.MAVLink_mission_item_message(0, 0, 0, 3, 16, 2, 0, 0, 0, 0, 0, lat * 1e-7, LON * 1e-7, 7.0, 0)
    (ack,) = replies(copter, one)
    assert (ack.get_type(), ack.type, ack.target_system, ack.target_component) == ("MISSION_ACK", 0, 255, 190)
    copter.run(8.0)
    assert copter.v["position"] == pytest.approx((8.0, 0.0, -7.0), abs=0.1 if whole else 1.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 5)
    (ack,) = replies(copter, one)
    assert ack.type == 1


@pytest.mark.parametrize(("restart", "current"), [(0, 2), (1, 1)])
def test_a_mission_goes_on_or_begins_again(copter: Copter, restart: int, current: int) -> None:
    copter.m["MIS_RESTART"] = restart
    upload(copter, *FLIGHT)
    copter.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    copter.run(0.01)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    assert copter.m["mission_current"] == current


def test_auto_can_be_armed_in_and_begin_at_once(copter: Copter) -> None:
    upload(copter, *FLIGHT)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        FAILED,
    )
    copter.m["AUTO_OPTIONS"] = 3
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )
    copter.run(6.0)
    assert copter.v["position"][2] < -1.0

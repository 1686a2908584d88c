"""AUTO: rounds, what is done beside the flight, jumps and the nose, as ArduCopter does them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_autopilot_missions import AUTO, HOME, item, upload
from tests.models.autopilot.test_autopilot_sticks import heading
from tests.models.copter import ACCEPTED, FAILED, Copter

TURNS, WAIT = mavlink.MAV_CMD_NAV_LOITER_TURNS, mavlink.MAV_CMD_CONDITION_DELAY
YAW, JUMP, SPEED = mavlink.MAV_CMD_CONDITION_YAW, mavlink.MAV_CMD_DO_JUMP, mavlink.MAV_CMD_DO_CHANGE_SPEED


def flying(*items: Any, **autopilot: float) -> Copter:
    """In AUTO from 6 m over home."""
    copter = Copter(autopilot=autopilot).in_the_air(6.0, 10.0)
    upload(copter, HOME, *items)
    copter.heard.clear()
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    return copter


def texts(copter: Copter) -> list[str]:
    return [m.text for m in copter.messages("STATUSTEXT")]


def reached(copter: Copter) -> list[int]:
    return [m.seq for m in copter.messages("MISSION_ITEM_REACHED")]


# ---- LOITER_TURNS --------------------------------------------------------------------------------------------------


def angles(flight: np.ndarray[Any, Any], north: float, east: float) -> tuple[np.ndarray[Any, Any], float]:
    """Distance from a centre, and the angle flown about it, clockwise."""
    n, e = flight[:, 1] - north, flight[:, 2] - east
    return np.hypot(n, e), float(np.diff(np.unwrap(np.arctan2(e, n))).sum())


@pytest.mark.parametrize(("radius", "sign"), [(8.9, 1.0), (-8.0, -1.0)])
def test_rounds_are_flown_about_the_place(radius: float, sign: float) -> None:
    """Radii are whole metres; a negative one goes round counter-clockwise. 20 deg/s: 18 s a round."""
    copter = flying(item(1, TURNS, 2.0, 0.0, radius, north=20.0, z=9.0), item(2, 16, north=20.0, z=9.0))
    copter.run(12.0)
    assert texts(copter) == ["Mission: starting circle 1/2"]
    flight = copter.run(24.0)
    distance, angle = angles(flight, 20.0, 0.0)
    assert angle == pytest.approx(sign * math.radians(20.0) * 24.0, rel=0.03)
    # the vehicle follows a point that leads nothing: its circle is the narrower
    assert distance.max() < 8.1
    assert distance.min() > 7.0
    assert -flight[:, 3] == pytest.approx(9.0, abs=0.3)
    to_centre = math.degrees(math.atan2(-flight[-1, 2], 20.0 - flight[-1, 1]))
    assert abs((heading(copter) - to_centre + 180.0) % 360.0 - 180.0) < 15.0
    copter.run(19.0)
    assert reached(copter) == [1, 2]
    assert texts(copter)[1:] == [
        "Mission: starting circle 2/2",
        "Mission: starting circle 3/2",
        "Mission: 2 WP",
        "Reached command #2",
    ]


def test_a_part_of_a_round_with_the_radius_of_circle() -> None:
    copter = flying(item(1, TURNS, 0.5, north=0.01, z=6.0), CIRCLE_RADIUS=600.0, CIRCLE_RATE=-30.0)
    copter.run(3.0)
    before = copter.m["circle_total"]
    copter.run(3.0)
    assert copter.m["circle_radius"] == 6.0
    fastest = math.sqrt(0.5 * 2.5 * 6.0) / 6.0  # rad/s, that half of WPNAV_ACCEL allows
    gone = copter.m["circle_total"] - before
    assert gone == pytest.approx(3.0 * fastest, rel=1e-6)  # clockwise, whatever the sign of CIRCLE_RATE
    copter.run(4.0)
    assert copter.m["circle_total"] == pytest.approx(math.pi, abs=0.01)
    assert reached(copter) == [1]


def test_large_radii_are_kept_in_steps_of_ten_metres() -> None:
    copter = flying(item(1, TURNS, 1.0, 0.0, 318.0, north=500.0, z=6.0))
    copter.run(0.1)
    assert copter.m["circle_radius"] == 310.0
    assert copter.m["guided_position_neu"][0] == pytest.approx(500.0 - 310.0, abs=0.1)


def test_the_way_from_within_a_circle_to_its_edge_keeps_the_heading() -> None:
    copter = flying(item(1, TURNS, 1.0, 0.0, 20.0, north=-8.0, z=6.0))
    before = heading(copter)
    flight = copter.run(3.0)
    assert flight[-1, 1] > 2.0  # away from the centre
    assert heading(copter) == pytest.approx(before, abs=2.0)


# ---- beside the flight ---------------------------------------------------------------------------------------------


def test_the_height_is_reached_while_it_loiters() -> None:
    """LOITER_TO_ALT is over within 5 cm of the height; the rest of the climb is above the place, not on the way."""
    to_height = mavlink.MAV_CMD_NAV_LOITER_TO_ALT
    copter = flying(item(1, to_height, north=6.0, z=16.0), item(2, mavlink.MAV_CMD_NAV_WAYPOINT, north=30.0, z=16.0))
    while not reached(copter):
        copter.run(0.01)
        assert copter.time < 60.0
    n, e, d = copter.v["position"]
    assert -d == pytest.approx(16.0, abs=0.06)
    assert math.hypot(n - 6.0, e) < 2.1
    assert copter.time > 12.1 + 4.0  # no faster than 2.5 m/s
    copter.run(20.0)
    assert reached(copter) == [1, 2]
    assert copter.v["position"] == pytest.approx([30.0, 0.0, -16.0], abs=0.6)  # it passes the last place
    low = flying(item(1, mavlink.MAV_CMD_NAV_WAYPOINT, north=3.0, z=6.0), item(2, to_height, north=6.0, z=3.0))
    low.run(25.0)
    assert reached(low) == [1, 2]
    assert "Mission: 2 LoitAltitude" in texts(low)
    assert low.v["position"][2] == pytest.approx(-3.0, abs=0.15)


def test_a_delay_and_what_follows_it_run_beside_the_flight() -> None:
    """Item 2 to 4 are begun when item 1 has been reached, and done on the way to item 5."""
    copter = flying(
        item(1, 16, north=3.0, z=6.0),
        item(2, WAIT, 3.0),
        item(3, SPEED, 1, 2.0),
        item(4, YAW, 90.0),
        item(5, 16, north=80.0, z=6.0),
    )
    flight = copter.run(14.0)
    begun = next(t for t, m in copter.heard if m.get_type() == "STATUSTEXT" and m.text == "Mission: 5 WP")
    changed = next(t for t, m in copter.heard if m.get_type() == "STATUSTEXT" and m.text == "Mission: 3 ChangeSpeed")
    assert changed - begun == pytest.approx(3.0, abs=0.02)
    assert reached(copter) == [1, 2, 3, 4]
    assert flight[:, 4].max() > 5.0
    assert flight[-1, 4] == pytest.approx(2.0, abs=0.1)
    assert heading(copter) == pytest.approx(90.0, abs=2.0)


def test_what_is_not_done_when_the_next_is_reached_is_forgotten() -> None:
    copter = flying(
        item(1, 16, north=3.0, z=6.0),
        item(2, WAIT, 60.0),
        item(3, SPEED, 1, 1.0),
        item(4, 16, north=8.0, z=6.0),
        item(5, SPEED, 1, 3.0),
        item(6, 16, north=90.0, z=6.0),
    )
    flight = copter.run(14.0)
    assert reached(copter) == [1, 4, 5]
    assert flight[-1, 4] == pytest.approx(3.0, abs=0.1)


def test_speeds_up_and_down_are_the_missions_until_auto_is_entered_anew() -> None:
    items = (item(1, SPEED, 2, 1.0), item(2, SPEED, 3, 0.5), item(3, 16, north=0.01, z=20.0), item(4, 16, z=2.0))
    copter = flying(*items)
    flight = copter.run(60.0)
    down = flight[:, 6]
    assert np.median(down[down < -0.5]) == pytest.approx(-1.0, abs=0.02)
    assert np.median(down[down > 0.25]) == pytest.approx(0.5, abs=0.02)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    assert copter.m["speed_up"] == 2.5
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    assert list(copter.m["auto_speed"]) == [0.0, 1.0, 0.0]  # the first item is done again, the second comes next
    copter.run(0.02)
    assert list(copter.m["auto_speed"]) == [0.0, 1.0, 0.5]


def test_a_command_changes_the_speed_of_a_mission_too() -> None:
    copter = flying(item(1, 16, north=30.0, z=6.0), item(2, 16, north=80.0, z=6.0))
    assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 2.0, -1)[0] == (
        "ACK",
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        ACCEPTED,
    )
    flight = copter.run(20.0)
    assert flight[:, 4].max() < 2.2


# ---- jumps ---------------------------------------------------------------------------------------------------------


def test_a_jump_to_nowhere_ends_the_mission() -> None:
    copter = flying(item(1, 16, north=4.0, z=6.0), item(2, JUMP, 9, 1), item(3, 16, north=50.0, z=6.0))
    copter.run(8.0)
    assert reached(copter) == [1]
    assert copter.m["mission_complete"]


def test_a_jump_to_itself_ends_the_mission() -> None:
    copter = flying(item(1, 16, north=4.0, z=6.0), item(2, JUMP, 2, -1), item(3, 16, north=50.0, z=6.0))
    copter.run(8.0)
    assert reached(copter) == [1]
    assert copter.m["mission_complete"]


def test_jumps_are_counted_anew_when_the_mission_begins_again() -> None:
    copter = flying(item(1, 16, north=8.0, z=6.0), item(2, 16, north=16.0, z=6.0), item(3, JUMP, 1, 1))
    for _ in range(2):
        copter.heard.clear()
        copter.run(22.0)
        assert reached(copter) == [1, 2, 1, 2]
        copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
        copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)


# ---- the nose ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "seconds", "turned"),
    [
        ((90.0, 30.0, 0.0, 0.0), 4.5, 90.0),
        ((90.0, 30.0, -1.0, 0.0), 11.0, -270.0),
        ((270.0, 30.0, 1.0, 0.0), 11.0, 270.0),
        ((60.0, 15.0, -1.0, 1.0), 6.0, -60.0),
        ((60.0, 0.0, 1.0, 1.0), 3.0, 60.0),
    ],
)
def test_condition_yaw_turns_by_its_rate_and_direction(
    parameters: tuple[float, ...], seconds: float, turned: float
) -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    start = heading(copter)
    assert copter.ask(mavlink.MAV_CMD_CONDITION_YAW, *parameters)[0] == ("ACK", mavlink.MAV_CMD_CONDITION_YAW, ACCEPTED)
    angle, last, fastest = 0.0, start, 0.0
    for _ in range(round(seconds / 0.1)):
        copter.run(0.1)
        angle, last = angle + (heading(copter) - last + 180.0) % 360.0 - 180.0, heading(copter)
        fastest = max(fastest, abs(math.degrees(copter.m["rate_target"][2])))
    assert angle == pytest.approx(turned, abs=2.0)
    assert fastest == pytest.approx(parameters[1] or 60.0, rel=0.1)


@pytest.mark.parametrize("parameters", [(361.0, 0.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (10.0, 0.0, 0.0, 2.0)])
def test_condition_yaw_that_means_nothing_fails(parameters: tuple[float, ...]) -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    assert copter.ask(mavlink.MAV_CMD_CONDITION_YAW, *parameters)[0] == ("ACK", mavlink.MAV_CMD_CONDITION_YAW, FAILED)


def test_a_heading_that_was_asked_for_outlasts_waypoints_that_do_not_turn_the_nose() -> None:
    copter = flying(
        item(1, YAW, 90.0),
        item(2, 16, north=5.0, z=6.0),
        item(3, 16, north=10.0, z=6.0),
        WP_YAW_BEHAVIOR=0,
    )
    copter.run(12.0)
    assert heading(copter) == pytest.approx(90.0, abs=2.0)

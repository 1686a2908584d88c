"""Plans with commands beside navigation: regions of interest, outputs, tags, and devices that are not on board."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_autopilot_commands import angles, at, result, texts
from tests.models.copter import ACCEPTED, GUIDED, RECORDED_AUTOPILOT, Copter

Item = tuple[int, tuple[float, ...], float, float, float]
"""Command, parameters 1 to 4, north and east of the origin, height."""
HOME: Item = (16, (), 0.0, 0.0, 584.0)
TAKEOFF: Item = (22, (), 0.0, 0.0, 10.0)


def way(north: float, east: float = 0.0, *p: float) -> Item:
    return (16, p, north, east, 10.0)


def do(command: int, *p: float) -> Item:
    return (command, p, math.nan, 0.0, 0.0)


def upload(copter: Copter, *items: Item) -> int:
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
    for sequence, (command, p, north, east, z) in enumerate(items):
        copter.run(0.01)
        lat, lon = at(north, east) if math.isfinite(north) else (0, 0)
        values = [*p, *[0.0] * (4 - len(p))]
        copter.send(mavlink.MAVLink_mission_item_int_message(1, 1, sequence, 3, command, 0, 1, *values, lat, lon, z, 0))
    copter.run(0.01)
    (ack,) = copter.messages("MISSION_ACK")
    return int(ack.type)


def begin(*items: Item) -> Copter:
    """A mission that has been started."""
    copter = Copter(autopilot=RECORDED_AUTOPILOT)
    copter.run(2.1)
    assert upload(copter, HOME, TAKEOFF, *items) == 0
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert result(copter.ask(mavlink.MAV_CMD_MISSION_START)) == ACCEPTED
    copter.heard.clear()
    return copter


def test_a_survey_with_a_camera_flies() -> None:
    """As QGroundControl plans one: DO_SET_CAM_TRIGG_DIST about its legs, here without a camera on board."""
    copter = begin(do(206, 5), way(15.0), do(206, 0), do(203), do(2000), do(1000), do(205), way(15.0, 15.0), do(189))
    copter.run(40.0)
    assert copter.v["position"][:2] == pytest.approx([15.0, 15.0], abs=1.5)
    words = [text for _, text in texts(copter.answers())]
    told = [text for text in words if text.startswith("Mission:") and text != "Mission: 1 Takeoff"]
    assert told == [
        "Mission: 2 SetCamTrigDst",
        "Mission: 3 WP",
        "Mission: 4 SetCamTrigDst",
        "Mission: 9 WP",
        "Mission: 5 DigiCamCtrl",
        "Mission: 6 ImageStartCapture",
        "Mission: 7 PitchYaw",
        "Mission: 8 MountControl",
        "Mission: 10 LandStart",
    ]


def test_a_region_of_interest_lasts_over_waypoints_until_it_ends() -> None:
    copter = begin((195, (), 20.0, 30.0, 0.0), way(20.0), way(20.0, 0.0, 6.0), do(197), way(60.0))
    while copter.m["mission_current"] < 4 and copter.time < 60.0:
        copter.tick()
    copter.run(3.0)
    n, e = copter.v["position"][:2]
    assert angles(copter)[2] == pytest.approx(math.degrees(math.atan2(30.0 - e, 20.0 - n)), abs=5.0)
    copter.run(14.0)
    assert angles(copter)[2] == pytest.approx(0.0, abs=6.0)


def test_servo_relay_fence_and_home_are_set_on_the_way() -> None:
    copter = begin(
        do(183, 9, 1600), do(181, 0, 1), do(207, 1), do(184, 10, 1900, 1, 0.5), (179, (), 5.0, 0.0, 2.0), way(20.0)
    )
    copter.run(16.0)
    assert (int(copter.m["servo"][8]), bool(copter.m["relay_on"]), int(copter.m["FENCE_ENABLE"])) == (1600, True, 1)
    assert int(copter.m["servo"][9]) == 1500  # back at its centre
    assert copter.m["home_neu"] == pytest.approx([5.0, 0.0, 2.0], abs=0.05)


def test_jumps_to_tags() -> None:
    copter = begin(do(600, 7), way(10.0), way(0.0), do(601, 7, 1), way(20.0))
    copter.run(70.0)
    reached = [text for _, text in texts(copter.answers()) if text.startswith("Reached")]
    assert reached == [f"Reached command #{i}" for i in (3, 4, 3, 4, 6)]
    copter = begin(way(10.0), do(601, 8, 1), way(20.0))
    copter.run(30.0)
    assert copter.m["mission_complete"]  # a tag that does not exist ends the mission
    assert copter.v["position"][0] == pytest.approx(10.0, abs=1.5)


def test_a_condition_on_the_distance_waits() -> None:
    copter = begin(do(114, 10), do(183, 9, 1700), way(40.0))
    while copter.m["servo"][8] == 0 and copter.time < 60.0:
        copter.tick()
    assert copter.v["position"][0] == pytest.approx(30.0, abs=0.3)


@pytest.mark.parametrize(
    ("item", "expected"),
    [
        (do(201), 0),
        (do(208, 1), 0),
        (do(211, 1), 0),
        (do(222), 0),
        (do(42600), 0),
        ((23, (), 1.0, 0.0, 5.0), 3),
        (do(42702), 3),
        ((201, (), 10.0, 0.0, math.nan), 12),
        (do(183, math.nan), 6),
    ],
)
def test_items_that_are_kept(item: Item, expected: int) -> None:
    copter = Copter()
    copter.run(2.1)
    assert upload(copter, HOME, item) == expected

"""Landings in missions of planes by ArduPlane's sources: final, flare, texts, landing sequences, what is refused."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_plane_autoland import land, of_ardupilot, worded
from tests.models.autopilot.test_plane_failsafes import LOST, long, said, short, with_values
from tests.models.autopilot.test_plane_pilot import high
from tests.models.autopilot.test_rover_battery import CRITICAL, told
from tests.models.autopilot.test_rover_failsafes import INFO, WARNING, texts
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, WAYPOINT, made, upload
from tests.models.autopilot.test_small_switches import flying
from tests.models.pair import ACCEPTED, FAILED, Pair, degrees_of

MANUAL, FBWA, AUTO, RTL, GUIDED = 0, 5, 10, 11, 15
TAKEOFF, LAND, LAND_START = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_DO_LAND_START
VTOL_TAKEOFF = mavlink.MAV_CMD_NAV_VTOL_TAKEOFF
NOTICE = mavlink.MAV_SEVERITY_NOTICE
NO_PLACE = (0.0, 0.0)
SEQUENCE = (INFO, "Landing sequence start")
REACHED, PASSED = "Reached waypoint ## dist #m", "Passed waypoint ## dist #m"
"""The second one where the way leads straight on."""
WAY = [REACHED, "Mission: # WP"]
NO_SEQUENCE = (WARNING, "Unable to start landing sequence")
WORDS = [
    "Mission: # Land",
    "Landing approach start at #m",
    "Landing glide slope # degrees",
    "Flare #m sink=# speed=# dist=#",
    "Throttle disarmed",
    "Auto disarmed",
    "Distance from LAND point=#m",
]
Item = tuple[int, float, float, float, tuple[float, float]]


def item(command: int, north: float = 0.0, east: float = 0.0, height: float = 0.0) -> Item:
    return command, north, east, height, NO_PLACE


def landing(heading: float = 0.0, length: float = 600.0, height: float = 60.0) -> list[Item]:
    """A mission that lands at home, with the final that its waypoint begins."""
    c, s = math.cos(math.radians(heading)), math.sin(math.radians(heading))
    return [
        item(WAYPOINT, -1.8 * length * c, -1.8 * length * s, height),
        item(WAYPOINT, -length * c, -length * s, height),
        item(LAND),
    ]


def with_mission(items: list[Item], mode: int = AUTO) -> Pair:
    """A plane at 100 m with a mission, in a mode."""
    p = high(GUIDED)
    assert upload(p, items) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    texts(p)
    return p


def until_it_lands(p: Pair) -> None:
    while p.m.landing_stage < 2:
        p.one_step()
        assert p.time < 400.0


# ---- the landing ---------------------------------------------------------------------------------------------------


def test_a_mission_lands_on_the_slope_from_the_item_before() -> None:
    p = with_mission(landing())
    found = land(p, within=250.0)
    assert [worded(text) for text in found.said] == [*WAY, PASSED, *WORDS]
    assert found.said[3] == "Mission: 3 Land"
    height = float(found.said[4].split()[-1].rstrip("m"))
    assert height == pytest.approx(60.0, abs=4.0)
    slope = float(found.said[5].split()[-2])
    assert slope == pytest.approx(6.1, abs=0.15)  # 60 - 4.4 m high over 600 - 79 m, at 22 m/s
    assert found.astray < 5.0
    for ahead, above in found.heights:
        if -500.0 < ahead < -110.0:
            assert above == pytest.approx(4.4 + math.tan(math.radians(slope)) * (-ahead - 79.0), abs=2.0)
    assert found.touched < 1.8
    assert -50.0 < found.heights[-1][0] < 20.0
    assert found.stopped == pytest.approx(3.0 + 20.0, abs=0.15)  # s until it counts as standing, LAND_DISARMDELAY
    distance = float(found.said[-1].split("=")[1].rstrip("m"))
    assert distance == pytest.approx(math.hypot(*p.place[:2]), abs=0.01)
    assert (p.m.mode, p.m.mission_current) == (AUTO, 3)
    assert p.m.motor[2] == 0.0


def test_the_landing_point_may_be_elsewhere_and_the_delay_another_one() -> None:
    p = with_mission([item(WAYPOINT, 300.0, 900.0, 50.0), item(LAND, 300.0, 300.0, 0.0)])
    p.m.LAND_DISARMDELAY = 4.0
    found = land(p, -90.0, (300.0, 300.0, 0.0), within=250.0)
    assert [worded(text) for text in found.said] == [REACHED, *WORDS]
    assert found.astray < 5.0
    assert -50.0 < found.heights[-1][0] < 20.0 and found.touched < 1.8
    assert found.stopped == pytest.approx(3.0 + 4.0, abs=0.15)


def test_the_plane_of_ardupilot_flies_a_mission_from_take_off_to_landing() -> None:
    p = of_ardupilot()
    around = [
        item(WAYPOINT, 400.0, 300.0, 50.0),
        item(WAYPOINT, -500.0, 300.0, 50.0),
        item(WAYPOINT, -450.0, 0.0, 45.0),
    ]
    assert upload(p, [item(TAKEOFF, 0.0, 0.0, 40.0), *around, item(LAND)]) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    texts(p)
    found = land(p, within=250.0)
    assert [worded(text) for text in found.said] == [
        "Armed AUTO, xaccel = # m/s/s, waiting # sec",
        "Triggered AUTO. GPS speed = #",
        "Holding course # at #m/s (#)",
        "Autoland direction= #",
        "Takeoff level-off starting at #m",
        "Takeoff complete at #m",
        "Mission: # WP",
        *WAY,
        *WAY,
        REACHED,
        *WORDS,
    ]
    assert found.astray < 5.0 and found.touched < 1.2
    assert -60.0 < found.heights[-1][0] < 20.0
    # it would go on with the landing
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: In landing sequence")]
    assert p.ask(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED


def test_without_an_item_before_the_final_begins_where_it_is() -> None:
    p = with_mission([item(LAND, 800.0, 0.0, 0.0)], GUIDED)
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    n, e, d = p.place
    p.until(p.time + 0.1)
    assert texts(p) == [(INFO, "Mission: 1 Land"), (INFO, f"Landing approach start at {-d:.1f}m")]
    assert p.m.line[:2].tolist() == pytest.approx([n, e], abs=4.0)
    assert p.m.final.tolist() == pytest.approx([math.hypot(800.0 - n, e), -d], abs=4.0)
    assert p.m.lands_on_wheels


# ---- landing sequences ---------------------------------------------------------------------------------------------


def sequences() -> list[Item]:
    """A waypoint far away, a landing 1,500 m in the east, and one at home."""
    far, home = [item(WAYPOINT, 0.0, 2100.0, 60.0), item(LAND, 0.0, 1500.0)], landing()
    return [item(WAYPOINT, 3000.0, 0.0, 100.0), item(LAND_START, 0.0, 2100.0), *far, item(LAND_START, -500.0), *home]


@pytest.mark.parametrize(("east", "row"), [(0.0, 5), (1500.0, 2)])
@pytest.mark.parametrize("mode", [AUTO, GUIDED])
def test_a_command_begins_the_nearest_landing_sequence(mode: int, east: float, row: int) -> None:
    p = with_mission(sequences(), mode)
    p.v.position[1] += east
    p.until(p.time + 0.1)
    p.heard.clear()
    assert p.ask(LAND_START) == ACCEPTED
    p.until(p.time + 0.1)
    items = [(INFO, f"Mission: {row} LandStart"), (INFO, f"Mission: {row + 1} WP")]
    assert texts(p) == [*items, SEQUENCE, *(items if mode == GUIDED else [])]
    assert (p.m.mode, p.m.mission_current) == (AUTO, row + 1)


def test_a_sequence_without_a_place_has_that_of_its_next_item() -> None:
    items = sequences()
    p = high(GUIDED)
    p.heard.clear()
    p.send(mavlink.MAVLink_mission_count_message(1, 1, len(items) + 1))
    p.until(p.time + 0.1)
    for number, (command, n, e, z, _) in enumerate([(WAYPOINT, 0.0, 0.0, 0.0, NO_PLACE), *items]):
        lat, lon = (0, 0) if command == LAND_START else degrees_of(n, e)
        p.send(mavlink.MAVLink_mission_item_int_message(1, 1, number, 6, command, 0, 1, 0, 0, 0, 0, lat, lon, z))
        p.until(p.time + 0.1)
    assert p.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    texts(p)
    assert p.ask(LAND_START) == ACCEPTED
    assert p.m.mission_current == 5 + 1


def test_a_mission_without_a_sequence_refuses_it() -> None:
    p = with_mission(landing(), GUIDED)
    assert p.ask(LAND_START) == FAILED
    assert texts(p) == [NO_SEQUENCE]
    assert p.m.mode == GUIDED


def test_a_sequence_lands() -> None:
    p = with_mission(sequences())
    assert p.ask(LAND_START) == ACCEPTED
    found = land(p, within=250.0)
    begun = ["Mission: # LandStart", "Mission: # WP", "Landing sequence start"]
    assert [worded(text) for text in found.said] == [*begun, *WAY, PASSED, *WORDS]
    assert found.astray < 5.0 and -50.0 < found.heights[-1][0] < 20.0


@pytest.mark.parametrize(("choice", "begins"), [(0, False), (1, True), (2, True), (3, False)])
def test_returns_go_on_with_a_sequence_if_they_may(choice: int, begins: bool) -> None:
    p = with_mission(sequences(), GUIDED)
    p.m.RTL_AUTOLAND, p.m.RTL_ALTITUDE = choice, 80.0
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    p.until(p.time + 0.3)
    assert (p.m.mode == AUTO) == (choice == 2)
    p.until(p.time + 40.0)
    assert p.m.mode == (AUTO if begins else RTL)
    items = [(INFO, "Mission: 5 LandStart"), (INFO, "Mission: 6 WP")]
    assert texts(p)[:5] == [*items, SEQUENCE, *items] * begins  # as by ArduPlane, before and in AUTO


def test_a_return_looks_once_for_a_sequence() -> None:
    p = with_mission(landing(), GUIDED)
    p.m.RTL_AUTOLAND = 2
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    assert said(p, 3.0) == [NO_SEQUENCE]
    assert p.m.mode == RTL


# ---- fail-safes ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("action", [2, 4, 6])
def test_a_low_battery_begins_a_sequence(action: int) -> None:
    p = with_mission(sequences(), GUIDED)
    with_values(p, BATT_FS_LOW_ACT=action, BATT_FS_CRT_ACT=1, BATT_LOW_MAH=100.0, BATT_CRT_MAH=50.0)
    p.m.battery_used = 3201.0
    items = [(INFO, "Mission: 5 LandStart"), (INFO, "Mission: 6 WP")]
    found = told(p)[1:]
    p.until(p.time + 0.1)
    assert found + texts(p) == [*items, SEQUENCE, *items]
    assert (p.m.mode, p.m.mission_current) == (AUTO, 6)
    p.m.battery_used = 3251.0
    assert [text.split(" 1 ")[0] for _, text in told(p)] == ["Battery"]  # RTL does not end a sequence
    assert p.m.mode == AUTO


def test_a_lost_radio_does_not_end_a_sequence() -> None:
    p = with_mission(sequences())
    assert p.ask(LAND_START) == ACCEPTED
    with_values(p, FS_SHORT_ACTN=1, FS_LONG_ACTN=1, FS_LONG_TIMEOUT=2.0, fail=2)
    assert said(p, 4.0) == [LOST, short(AUTO, False), long(AUTO)]
    assert p.m.mode == AUTO
    p = with_mission(landing())
    until_it_lands(p)
    with_values(p, FS_SHORT_ACTN=1, FS_LONG_ACTN=1, FS_LONG_TIMEOUT=2.0, fail=2)
    assert [text for text in said(p, 4.0) if "anding" not in text[1]] == [LOST]  # on the final nothing acts
    assert p.m.mode == AUTO
    p = with_mission(sequences())  # but on the way to the first waypoint it does
    with_values(p, FS_SHORT_ACTN=1, FS_LONG_ACTN=1, FS_LONG_TIMEOUT=30.0, fail=2)
    assert said(p, 2.0) == [LOST, short(1)]


# ---- another mode during the landing -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("items", "text", "row"),
    [
        (landing(), (NOTICE, "Restarted landing sequence at waypoint 2"), 2),
        ([item(LAND_START), *landing()], (NOTICE, "Restarted landing via DO_LAND_START: 1"), 1),
        ([item(LAND, 900.0)], (WARNING, "Unable to restart landing sequence"), 1),
    ],
)
def test_another_mode_takes_the_mission_back(items: list[Item], text: tuple[int, str], row: int) -> None:
    p = with_mission(items)
    until_it_lands(p)
    p.until(p.time + 12.0)  # away from the waypoint
    texts(p)
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    assert texts(p) == [text]
    assert p.m.mission_current == row
    p.until(p.time + 0.2)
    assert not p.m.lands_on_wheels
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    p.until(p.time + 0.2)
    again = [said for _, said in texts(p) if said.startswith("Landing approach")]
    assert len(again) == (len(items) == 1)


# ---- uploads and arming --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "lat", "p1", "z", "result"),
    [
        (6, -353632620, 0.0, 0.0, mavlink.MAV_MISSION_ACCEPTED),
        (3, -353632620, 0.0, 0.0, mavlink.MAV_MISSION_ACCEPTED),
        (0, -353632620, 40.0, 584.0, mavlink.MAV_MISSION_ACCEPTED),
        (1, -353632620, 0.0, 0.0, mavlink.MAV_MISSION_INVALID),
        (6, -950000000, 0.0, 0.0, mavlink.MAV_MISSION_INVALID),
        (6, -353632620, math.nan, 0.0, mavlink.MAV_MISSION_INVALID),
        (6, -353632620, 0.0, math.inf, mavlink.MAV_MISSION_INVALID),
    ],
)
def test_uploads_of_a_landing(frame: int, lat: int, p1: float, z: float, result: int) -> None:
    p = made("plane")
    p.until(2.5)
    p.send(mavlink.MAVLink_mission_count_message(1, 1, 2))
    p.until(2.6)
    p.send(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, WAYPOINT, 0, 1, 0, 0, 0, 0, lat, 1491652370, z))
    p.until(2.7)
    p.send(mavlink.MAVLink_mission_item_int_message(1, 1, 1, frame, LAND, 0, 1, p1, 0, 0, 0, lat, 1491652370, z))
    p.until(2.8)
    assert p.last("MISSION_ACK").type == result


@pytest.mark.parametrize("name", ["plane", "quadplane"])
def test_a_sequence_needs_a_return_that_lands(name: str) -> None:
    p = made(name)
    p.until(2.5)
    assert upload(p, [item(LAND_START), item(WAYPOINT, -600.0, 0.0, 60.0), item(LAND)]) == 0
    texts(p)
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: DO_LAND_START set and RTL_AUTOLAND disabled")]
    assert p.ask(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == ACCEPTED
    assert texts(p) == [(CRITICAL, "PreArm: DO_LAND_START set and RTL_AUTOLAND disable")]  # 50 bytes
    p.m.RTL_AUTOLAND = 3
    assert p.ask(ARM, 1) == ACCEPTED


# ---- quadplanes ----------------------------------------------------------------------------------------------------


def test_quadplanes_land_vertically() -> None:
    p = flying("quadplane")
    items = [item(WAYPOINT, 2000.0, 0.0, 40.0), item(LAND_START), item(LAND, 30.0, 20.0)]
    assert upload(p, items) == mavlink.MAV_MISSION_ACCEPTED
    texts(p)
    assert p.ask(LAND_START) == ACCEPTED
    assert (p.m.mode, texts(p)[:3]) == (AUTO, [(INFO, "Mission: 2 LandStart"), (INFO, "Mission: 3 Land"), SEQUENCE])
    end = p.time + 90.0
    while p.m.armed:
        p.until(p.time + 0.5)
        assert p.time < end
    assert p.place[:2] == pytest.approx([30.0, 20.0], abs=1.5)
    assert "Land final started" in [text for _, text in texts(p)]

"""Flight along the terrain: missions, GUIDED and RTL, by a grid or a rangefinder, and without terrain."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import deg_e7, geodetic_from_local
from cosim_models.autopilot.mission.terrain import TERRAIN_POINTS
from tests.models.copter import ACCEPTED, DENIED, FAILED, GUIDED, RECORDED_AUTOPILOT, RTL, Copter, preset

SPACING, FIRST = 20.0, -60.0
NORTH = FIRST + SPACING * np.arange(TERRAIN_POINTS)
TERRAIN, RELATIVE = 10, 6
AUTO, LOITER, POSHOLD = mavlink.COPTER_MODE_AUTO, mavlink.COPTER_MODE_LOITER, mavlink.COPTER_MODE_POSHOLD
RECORDED = Path(__file__).parents[2] / "data" / "arducopter" / "terrain" / "guided_mission_rtl.csv.gz"
Profile = NDArray[np.float64]


def ridge(top: float = 8.0) -> Profile:
    """Heights at NORTH: nothing up to 0, `top` at 40 m and 60 m, nothing from 100 m on."""
    return np.interp(NORTH, [0.0, 40.0, 60.0, 100.0], [0.0, top, top, 0.0])


def below(profile: Profile, north: Any) -> Any:
    return np.interp(north, NORTH, profile)


def above(profile: Profile, **parameters: Any) -> Copter:
    """A copter on terrain that rises and falls to the north."""
    copter = Copter(autopilot={"terrain_spacing": SPACING, **parameters})
    copter.m["terrain_origin"][:] = FIRST, -150.0
    copter.m["terrain"][:] = np.repeat(profile, TERRAIN_POINTS)
    return copter


def at(north: float, east: float) -> tuple[int, int]:
    lat, lon, _ = geodetic_from_local(north, east, 0.0, math.radians(-35.363262), math.radians(149.165237), 0.0)
    return deg_e7(lat), deg_e7(lon)


def reposition(copter: Copter, north: float, east: float, height: float, frame: int = TERRAIN) -> int:
    """Sends DO_REPOSITION; its MAV_RESULT."""
    lat, lon = at(north, east)
    number = mavlink.MAV_CMD_DO_REPOSITION
    copter.answers()
    copter.send(
        mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, -1.0, 1.0, 0.0, math.nan, lat, lon, height)
    )
    copter.run(0.01)
    return int(next(result for kind, command, result in copter.answers() if kind == "ACK" and command == number))


def upload(copter: Copter, *items: tuple[float, float, int, int, float]) -> None:
    """North, east, command, frame and height of each."""
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, len(items) + 1, 0))
    copter.run(0.1)
    for i, (north, east, command, frame, z) in enumerate([(0.0, 0.0, 16, 0, 584.0), *items]):
        lat, lon = at(north, east)
        item = mavlink.MAVLink_mission_item_int_message(1, 1, i, frame, command, 0, 1, 0.0, 0, 0, 0, lat, lon, z, 0)
        copter.send(item)
        copter.run(0.1)
    assert copter.messages("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_ACCEPTED


def set_parameter(copter: Copter, name: str, value: float) -> None:
    copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    copter.run(0.01)


def texts(copter: Copter) -> list[str]:
    return [message.text for message in copter.messages("STATUSTEXT")]


def clearances(rows: NDArray[np.float64], profile: Profile, least: float = 5.0, most: float = 95.0) -> Any:
    """Heights above the terrain [m] between two norths."""
    north = rows[:, 1]
    rows = rows[(north > least) & (north < most)]
    assert len(rows) > 100
    return -rows[:, 3] - below(profile, rows[:, 1])


def test_a_flight_of_arducopter_over_the_same_terrain() -> None:
    """GUIDED, a mission and RTL of the real program, which got these heights as TERRAIN_DATA."""
    head, *table = gzip.decompress(RECORDED.read_bytes()).decode().splitlines()
    values = json.loads(head[2:])
    recorded = np.array([[float(x) for x in line.split(",")] for line in table[1:]])
    copter = Copter(
        autopilot={**RECORDED_AUTOPILOT, "RTL_ALT_TYPE": 1, "terrain_spacing": values["spacing"]},
        vehicle=preset("ardupilot_json"),
    )
    copter.m["terrain_origin"][:] = values["first"], -60.0
    copter.m["terrain"][:] = np.repeat(values["heights"], TERRAIN_POINTS)
    copter.in_the_air(10.0)
    for part in ("guided", "mission", "rtl"):
        flown = values[part]
        if part == "guided":
            assert reposition(copter, 90.0, 0.0, 12.0) == ACCEPTED
        elif part == "mission":
            assert reposition(copter, 0.0, 0.0, 10.0, RELATIVE) == ACCEPTED
            copter.run(20.0)
            upload(copter, (100.0, 0.0, 16, 10, 12.0), (100.0, 40.0, 16, 10, 12.0))
            assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)[0][2] == ACCEPTED
        else:
            assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)[0][2] == ACCEPTED
        rows = copter.run(flown["duration"])
        t = rows[:, 0] - rows[0, 0]
        real = recorded[(recorded[:, 0] >= flown["begin"]) & (recorded[:, 0] < flown["begin"] + flown["duration"])]
        there = real[:, 0] - flown["begin"]
        off = np.interp(there, t, rows[:, 3]) - real[:, 3]
        assert np.sqrt((off**2).mean()) < 0.07, part


@pytest.mark.parametrize("margin", [10.0, 0.0])
def test_missions_follow_the_terrain_on_the_way(margin: float) -> None:
    """A straight line between the places would pass the ridge in 3 m instead of 11 m."""
    profile = ridge()
    copter = above(profile, WPNAV_TER_MARGIN=margin, WPNAV_SPEED=500.0)
    copter.run(2.1)
    upload(
        copter, (0.0, 0.0, 22, 3, 11.0), (100.0, 0.0, 16, 10, 11.0), (20.0, 0.0, 16, 11, 7.0), (0.0, 0.0, 21, 3, 0.0)
    )
    for number, *values in ((176, 1, GUIDED), (400, 1), (300,)):
        assert copter.ask(number, *values)[0][2] == ACCEPTED
    copter.run(8.0)
    there = copter.run(31.0)
    assert "Reached command #2" in texts(copter)
    there = there[: int(np.argmax(there[:, 1]))]
    assert clearances(there, profile, most=85.0) == pytest.approx(11.0, abs=1.5)
    assert -there[-1, 3] == pytest.approx(11.0, abs=0.8)
    back = copter.run(22.0)
    assert "Reached command #3" in texts(copter)
    assert clearances(back, profile, 25.0).min() > 6.0
    target = copter.messages("POSITION_TARGET_GLOBAL_INT")
    assert all(m.alt == pytest.approx(584.0 + 11.0, abs=0.1) for m in target if m.lat_int == at(100.0, 0.0)[0])
    for _ in range(120):
        copter.run(0.5)
        if not copter.m["armed"]:
            break
    assert not copter.m["armed"]


def test_targets_in_guided_follow_the_terrain_on_the_way() -> None:
    profile = ridge()
    copter = above(profile, WPNAV_SPEED=600.0).in_the_air(10.0)
    assert reposition(copter, 100.0, 0.0, 10.0) == ACCEPTED
    rows = copter.run(24.0)
    assert clearances(rows, profile) == pytest.approx(10.0, abs=1.5)
    assert rows[-1, 1:4] == pytest.approx([100.0, 0.0, -10.0], abs=0.2)
    # Above home again: a straight line, which rises to 14 m.
    assert reposition(copter, 0.0, 0.0, 20.0, RELATIVE) == ACCEPTED
    rows = copter.run(26.0)
    along = rows[(rows[:, 1] > 10.0) & (rows[:, 1] < 90.0)]
    assert np.abs(-along[:, 3] - np.interp(along[:, 1], [0.0, 100.0], [20.0, 10.0])).max() < 2.5
    assert rows[-1, 1:4] == pytest.approx([0.0, 0.0, -20.0], abs=0.2)


def test_positions_with_velocities_are_not_flown_above_terrain() -> None:
    """ArduCopter stops; nor with a place outside of a fence."""
    copter = above(ridge()).in_the_air(10.0)
    lat, lon = at(50.0, 0.0)
    copter.send(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, 11, 0xDC0, lat, lon, 9.0, 3, 0, 0, 0, 0, 0, 0, 0
        )
    )
    rows = copter.run(3.0)
    assert np.abs(rows[:, 1:3]).max() < 0.2
    set_parameter(copter, "FENCE_TYPE", 1)
    set_parameter(copter, "FENCE_ALT_MAX", 20.0)
    set_parameter(copter, "FENCE_ENABLE", 1)
    assert reposition(copter, 50.0, 0.0, 14.0) == FAILED  # 22 m above home
    assert reposition(copter, 100.0, 0.0, 14.0) == ACCEPTED


@pytest.mark.parametrize(("kind", "height"), [(0, 15.0), (1, 15.0)])
def test_rtl_flies_above_home_or_above_the_terrain(kind: int, height: float) -> None:
    profile = ridge(-12.0)  # a valley
    copter = above(profile, RTL_ALT_TYPE=kind, RTL_CONE_SLOPE=0.0, RTL_SPEED=300.0).in_the_air(10.0)
    assert reposition(copter, 100.0, 0.0, 10.0, RELATIVE) == ACCEPTED
    copter.run(22.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)[0][2] == ACCEPTED
    rows = copter.run(52.0)
    middle = rows[(rows[:, 1] > 45.0) & (rows[:, 1] < 55.0)]
    expected = height + (below(profile, 50.0) if kind == 1 else 0.0)
    assert -middle[:, 3] == pytest.approx(expected, abs=1.2)
    assert rows[-1, 1] == pytest.approx(0.0, abs=1.0)
    for _ in range(120):
        copter.run(0.5)
        if not copter.m["armed"]:
            break
    assert copter.v["position"] == pytest.approx([0.0, 0.0, 0.0], abs=0.5)


def test_a_cliff_stops_the_flight_until_the_height_is_right() -> None:
    """WPNAV_TER_MARGIN: the way is nearly stopped when the height errs by it; without, the vehicle passes far below."""
    profile = np.where(NORTH > 50.0, 40.0, 0.0)  # 40 m in 20 m
    errors = {}
    for margin in (4.0, 0.0):
        copter = above(profile, WPNAV_TER_MARGIN=margin, WPNAV_SPEED=300.0).in_the_air(12.0)
        assert reposition(copter, 100.0, 0.0, 12.0) == ACCEPTED
        rows = copter.run(70.0)
        errors[margin] = 12.0 - clearances(rows, profile).min()
        assert rows[-1, 1:4] == pytest.approx([100.0, 0.0, -52.0], abs=1.0)
    assert errors[4.0] < 7.0 < 15.0 < errors[0.0]


def test_the_grid_is_moved_to_the_place_of_arming_by_a_limit() -> None:
    for most, moved in ((30.0, -7.0), (5.0, -5.0)):
        profile = ridge() + 7.0
        copter = above(profile, TERRAIN_OFS_MAX=most).in_the_air(10.0)
        copter.send(mavlink.MAVLink_terrain_check_message(*at(50.0, 0.0)))
        copter.run(0.01)
        assert copter.messages("TERRAIN_REPORT")[-1].terrain_height == pytest.approx(584.0 + 15.0 + moved, abs=0.01)
        assert reposition(copter, 0.0, 20.0, 9.0) == ACCEPTED
        copter.run(10.0)
        assert -copter.v["position"][2] == pytest.approx(9.0 + 7.0 + moved, abs=0.2)


def test_landings_slow_down_above_the_terrain() -> None:
    """LAND_ALT_LOW counts from the ground below: on a terrace 12 m high, at 22 m above home."""
    profile = np.where(NORTH > 50.0, 12.0, 0.0)
    copter = above(profile).in_the_air(30.0, 22.0)
    assert reposition(copter, 100.0, 0.0, 30.0, RELATIVE) == ACCEPTED
    copter.run(22.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mavlink.COPTER_MODE_LAND)[0][2] == ACCEPTED
    rows = copter.run(24.0)
    slow = rows[(rows[:, 6] < 0.6) & (rows[:, 6] > 0.4) & (rows[:, 3] > -23.0)]
    assert -slow[0, 3] == pytest.approx(22.0, abs=0.7)


# ---- rangefinder ---------------------------------------------------------------------------------------------------


def test_a_rangefinder_follows_the_terrain_without_a_database() -> None:
    """With the lag of its filter: SURFTRAK_TC times the climb rate."""
    profile = ridge()
    ranging = {"RNGFND1_TYPE": 100, "RNGFND1_MAX": 40.0, "TERRAIN_ENABLE": 0, "SURFTRAK_TC": 0.5}
    copter = above(profile, WPNAV_SPEED=500.0, **ranging).in_the_air(10.0)
    assert reposition(copter, 100.0, 0.0, 10.0) == ACCEPTED
    rows = copter.run(28.0)
    assert clearances(rows, profile) == pytest.approx(10.0, abs=1.8)
    assert clearances(rows, profile).max() - clearances(rows, profile).min() > 0.6  # there is a lag
    assert rows[-1, 1:4] == pytest.approx([100.0, 0.0, -10.0], abs=0.3)
    blind = above(profile, WPNAV_RFND_USE=0, **ranging).in_the_air(10.0)
    assert reposition(blind, 100.0, 0.0, 10.0) == FAILED


def test_missions_out_of_the_rangefinders_range_return() -> None:
    """A ravine beyond RNGFND1_MAX: stale after 1 s, fail-safe after 5 s more, RTL above home."""
    profile = np.where((NORTH > 10.0) & (NORTH < 190.0), -30.0, 0.0)
    ranging = {"RNGFND1_TYPE": 100, "RNGFND1_MAX": 18.0, "RTL_ALT_TYPE": 1, "RTL_ALT": 1500.0, "RTL_CONE_SLOPE": 0.0}
    copter = above(profile, **ranging)
    copter.run(2.1)
    upload(copter, (0.0, 0.0, 22, 3, 10.0), (200.0, 0.0, 16, 10, 10.0))
    for number, *values in ((176, 1, GUIDED), (400, 1), (300,)):
        assert copter.ask(number, *values)[0][2] == ACCEPTED
    lost_at = 0.0
    while copter.m["mode"] == AUTO and copter.time < 60.0:
        copter.run(0.05)
        if lost_at == 0.0 and not copter.m["range_trusted"] and copter.v["position"][0] > 2.0:
            lost_at = copter.time
    assert copter.m["mode"] == RTL
    assert copter.time - lost_at == pytest.approx(5.0, abs=0.3)
    said = texts(copter)
    assert said[-1] == "Failsafe: Terrain data missing"
    copter.run(25.0)
    assert copter.v["position"][:2] == pytest.approx([0.0, 0.0], abs=1.0)


# ---- without terrain -----------------------------------------------------------------------------------------------


def test_without_terrain_nothing_above_it_is_flown() -> None:
    copter = above(ridge(), TERRAIN_ENABLE=0)
    copter.run(2.1)
    upload(copter, (0.0, 0.0, 22, 3, 10.0), (100.0, 0.0, 16, 10, 11.0))
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)[0][2] == ACCEPTED
    arming = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert copter.ask(arming, 1) == [("ACK", arming, FAILED), ("TEXT", 2, "Arm: terrain disabled")]
    set_parameter(copter, "TERRAIN_ENABLE", 1)
    assert copter.ask(arming, 1)[0][2] == ACCEPTED
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)[0][2] == ACCEPTED
    copter.run(12.0)
    set_parameter(copter, "TERRAIN_ENABLE", 0)
    assert reposition(copter, 50.0, 0.0, 10.0) == FAILED
    rows = copter.run(2.0)
    assert np.abs(rows[:, 1:3]).max() < 0.2
    assert copter.m["mode"] == GUIDED
    # The mission's waypoint cannot be flown to: at once.
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)[0][2] == ACCEPTED
    copter.run(5.0)
    assert "Failsafe: Terrain data missing" in texts(copter)
    assert copter.m["mode"] == RTL


def test_rtl_above_terrain_needs_it() -> None:
    copter = above(ridge(), RTL_ALT_TYPE=1, TERRAIN_ENABLE=0)
    copter.run(2.1)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)[0][2] == ACCEPTED
    arming = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    refused = copter.ask(arming, 1)
    assert refused[0] == ("ACK", arming, FAILED)
    assert "".join(text for kind, _, text in refused if kind == "TEXT") == (
        "Arm: RTL_ALT_TYPE is above-terrain but no terrain data"
    )
    ranging = above(ridge(), RTL_ALT_TYPE=1, RNGFND1_TYPE=100)
    ranging.run(2.1)
    assert ranging.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)[0][2] == ACCEPTED
    refused = ranging.ask(arming, 1)
    assert "".join(text for kind, _, text in refused if kind == "TEXT") == (
        "Arm: RTL_ALT_TYPE is above-terrain but RTL_ALT (in cm) above RNGFND_MAX (in metres)"
    )
    assert DENIED != FAILED and refused[0][2] == FAILED


def test_terrain_that_is_lost_on_the_way_home() -> None:
    profile = ridge(-12.0)
    copter = above(profile, RTL_ALT_TYPE=1, RTL_CONE_SLOPE=0.0, RTL_SPEED=400.0).in_the_air(10.0)
    assert reposition(copter, 100.0, 0.0, 10.0, RELATIVE) == ACCEPTED
    copter.run(22.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)[0][2] == ACCEPTED
    copter.run(10.0)
    set_parameter(copter, "TERRAIN_ENABLE", 0)
    copter.heard.clear()
    copter.run(4.9)
    assert texts(copter) == []
    copter.run(0.4)
    assert texts(copter) == ["Failsafe: Terrain data missing", "Restarting RTL - Terrain data missing"]
    copter.run(40.0)
    assert copter.m["mode"] == RTL and not copter.m["terrain_failsafe"]
    assert copter.v["position"][:2] == pytest.approx([0.0, 0.0], abs=1.0)
    early = above(profile, RTL_ALT_TYPE=1).in_the_air(10.0)
    set_parameter(early, "TERRAIN_ENABLE", 0)
    assert ("TEXT", 2, "RTL: no terrain data, using alt-above-home") in early.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)


# ---- splines, take-offs and landings -------------------------------------------------------------------------------


def test_splines_follow_the_terrain_too() -> None:
    profile = ridge()
    copter = above(profile, WPNAV_SPEED=400.0).in_the_air(10.0)
    upload(copter, (60.0, 15.0, 82, 10, 10.0), (100.0, 0.0, 82, 10, 10.0), (100.0, -30.0, 16, RELATIVE, 10.0))
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)[0][2] == ACCEPTED
    rows = copter.run(45.0)
    assert clearances(rows, profile) == pytest.approx(10.0, abs=1.5)
    assert rows[:, 2].max() > 10.0
    assert "Reached command #3" in texts(copter)
    assert rows[-1, 1:4] == pytest.approx([100.0, -30.0, -10.0], abs=0.5)


def test_takeoff_and_landing_of_a_mission_are_above_the_terrain() -> None:
    """Take-off on a terrace of 6 m that the grid has at home; the way to the landing keeps the height above ground."""
    profile = np.where(NORTH < 30.0, 6.0, 0.0)
    copter = above(profile, TERRAIN_OFS_MAX=0.0, WPNAV_SPEED=300.0)
    copter.run(2.1)
    upload(copter, (0.0, 0.0, 22, 10, 9.0), (0.0, 0.0, 16, 10, 9.0), (100.0, 0.0, 21, 10, 0.0))
    for number, *values in ((176, 1, GUIDED), (400, 1), (300,)):
        assert copter.ask(number, *values)[0][2] == ACCEPTED
    rows = copter.run(16.0)
    assert -rows[-1, 3] == pytest.approx(15.0, abs=0.4)
    rows = copter.run(24.0)
    there = rows[rows[:, 1] > 70.0]
    assert -there[:, 3] == pytest.approx(9.0, abs=0.8)
    copter.run(32.0)
    assert copter.v["position"] == pytest.approx([100.0, 0.0, 0.0], abs=1.0)


def test_heights_above_home_are_taken_where_the_rangefinder_sees_nothing() -> None:
    ranging = {"RNGFND1_TYPE": 100, "RNGFND1_MAX": 20.0, "RTL_ALT_TYPE": 1, "RTL_ALT": 1500.0}
    copter = above(ridge(0.0), **ranging).in_the_air(19.0)
    assert copter.m["range_trusted"]
    assert ranged(copter) == pytest.approx(-copter.v["position"][2], abs=0.3)  # filtered
    assert reposition(copter, 0.0, 0.0, 30.0, RELATIVE) == ACCEPTED
    copter.run(14.0)
    assert not copter.m["range_trusted"]
    assert ("TEXT", 2, "RTL: rangefinder unhealthy, using alt-above-home") in copter.ask(
        mavlink.MAV_CMD_DO_SET_MODE, 1, RTL
    )
    copter.run(1.0)
    upload(copter, (60.0, 0.0, 21, 10, 0.0))
    answers = copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    assert answers[0][2] == ACCEPTED
    assert ("TEXT", 2, "Land: no terrain data, using alt-above-home") in answers
    rows = copter.run(8.0)
    assert -rows[-1, 3] == pytest.approx(30.0, abs=1.5)


def ranged(copter: Copter) -> float:
    """Height above ground by the rangefinder."""
    return float(copter.m["range_filtered"] - copter.m["range_from"] + copter.m["position_neu"][2])


def test_the_rangefinder_believes_a_jump_at_the_third_measurement() -> None:
    """Of 5 m: three measurements take 0.15 s; one of 1 m is believed at once."""
    copter = above(ridge(0.0), RNGFND1_TYPE=100, RNGFND1_MAX=40.0).in_the_air(10.0)
    place = copter.m["terrain"]
    before = float(copter.m["range_height"])
    place[:] += 5.0  # the ground rises
    changes = []
    for _ in range(40):
        copter.run(0.005)
        changes.append(float(copter.m["range_height"]) - before)
    first = next(i for i, change in enumerate(changes) if change < -2.0)
    assert 0.1 <= 0.005 * first <= 0.16
    place[:] += 1.0
    copter.run(0.06)
    assert float(copter.m["range_height"]) - before == pytest.approx(-6.0, abs=0.1)


# ---- a pilot's modes follow the surface ------------------------------------------------------------------------------


def flown_by_sticks(copter: Copter, seconds: float, pitch: int = 1300) -> NDArray[np.float64]:
    """Holds a pitch stick, and the others centred."""
    rows = []
    for _ in range(round(2.0 * seconds)):
        message = mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, pitch, 1500, 1500, 0, 0, 0, 0)
        copter.send(message)
        rows.append(copter.run(0.5))
    return np.concatenate(rows)


@pytest.mark.parametrize("mode", [LOITER, POSHOLD])
def test_a_pilots_modes_follow_the_surface(mode: int) -> None:
    """Up a slope of 0.2 at about 4.3 m/s, with the lags of SURFTRAK_TC and of the position's gain of 1/s."""
    copter = above(ridge(), RNGFND1_TYPE=100, RNGFND1_MAX=40.0).in_the_air(10.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)[0][2] == ACCEPTED
    rows = flown_by_sticks(copter, 13.0)
    slope = 0.2 * rows[-2000:-1500, 4].mean()
    clear = clearances(rows, ridge(), 25.0, 38.0)
    assert clear.mean() == pytest.approx(10.0 - 2.0 * slope, abs=0.25)
    back = flown_by_sticks(copter, 8.0, 1500)
    assert -back[-1, 3] - below(ridge(), back[-1, 1]) == pytest.approx(10.0, abs=0.15)


@pytest.mark.parametrize("parameters", [{"SURFTRAK_MODE": 0}, {"SURFTRAK_MODE": 2}, {"RNGFND1_TYPE": 0}])
def test_surfaces_are_not_followed_without_mode_or_sensor(parameters: dict[str, float]) -> None:
    copter = above(ridge(), **{"RNGFND1_TYPE": 100, "RNGFND1_MAX": 40.0} | parameters).in_the_air(10.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)[0][2] == ACCEPTED
    rows = flown_by_sticks(copter, 10.0)
    assert rows[-1, 1] > 25.0
    assert -rows[:, 3] == pytest.approx(10.0, abs=0.1)


def test_a_surface_out_of_range_is_not_followed_until_it_is_seen_again() -> None:
    """Over a ravine, the height stays; the height above the ground behind it is that at which it is seen again."""
    ravine = np.interp(NORTH, [0.0, 20.0, 60.0, 80.0], [0.0, -20.0, -20.0, 0.0])
    copter = above(ravine, RNGFND1_TYPE=100, RNGFND1_MAX=12.0).in_the_air(10.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)[0][2] == ACCEPTED
    rows = flown_by_sticks(copter, 22.0)
    deep = rows[(rows[:, 1] > 20.0) & (rows[:, 1] < 60.0)]
    assert np.ptp(deep[:, 3]) < 0.2  # it follows to 12 m and then goes straight on
    assert copter.m["terrain_on"] and rows[-1, 1] > 80.0
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    assert not copter.m["terrain_on"]


def test_the_mode_changes_without_a_step_in_height() -> None:
    copter = above(ridge(), RNGFND1_TYPE=100, RNGFND1_MAX=40.0, RTL_ALT=0.0).in_the_air(10.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)[0][2] == ACCEPTED
    rows = flown_by_sticks(copter, 11.0)
    height = -rows[-1, 3]
    assert height > 14.0
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)[0][2] == ACCEPTED
    back = copter.run(4.0)
    assert -back[:, 3] == pytest.approx(height, abs=0.6)


def test_turns_above_the_terrain_rise_and_fall_with_it() -> None:
    profile = np.interp(NORTH, [0.0, 80.0], [0.0, 12.0])
    copter = above(profile, CIRCLE_RATE=15.0, WPNAV_SPEED=500.0)
    copter.run(2.1)
    upload(copter, (0.0, 0.0, 22, 3, 12.0), (40.0, 0.0, 16, 10, 12.0), (40.0, 0.0, 18, 10, 12.0))
    copter.m["mission"][3][2], copter.m["mission"][3][4] = 1.0, 20.0  # turns and radius
    for number, *values in ((176, 1, GUIDED), (400, 1), (300,)):
        assert copter.ask(number, *values)[0][2] == ACCEPTED
    rows = copter.run(75.0)
    begun = next(t for t, m in copter.heard if m.get_type() == "STATUSTEXT" and "starting circle 1/1" in m.text)
    assert texts(copter)[-1] == "Mission: starting circle 2/1"
    rows = rows[(rows[:, 0] > begun + 8.0) & (rows[:, 0] < begun + 24.0)]
    assert np.hypot(rows[:, 1] - 40.0, rows[:, 2]) == pytest.approx(19.0, abs=1.5)
    assert np.ptp(rows[:, 3]) > 4.0  # the terrain differs by 6 m
    assert -rows[:, 3] - below(profile, rows[:, 1]) == pytest.approx(12.0, abs=1.0)


def test_the_rangefinder_is_told() -> None:
    """As ArduCopter tells its simulated one, whose type is unknown and which looks down (25)."""
    copter = above(ridge(0.0), RNGFND1_TYPE=100, RNGFND1_MAX=40.0).in_the_air(10.0)
    copter.heard.clear()
    for number in (132, 173, 1):
        copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number)
        copter.run(0.01)
    (told,) = copter.messages("DISTANCE_SENSOR")
    assert (told.min_distance, told.max_distance, told.type, told.id, told.orientation) == (20, 4000, 4, 0, 25)
    assert told.current_distance == pytest.approx(1000, abs=10)
    assert copter.messages("RANGEFINDER")[0].distance == pytest.approx(10.0, abs=0.1)
    status = copter.messages("SYS_STATUS")[0]
    laser = mavlink.MAV_SYS_STATUS_SENSOR_LASER_POSITION
    assert status.onboard_control_sensors_present & status.onboard_control_sensors_health & laser
    copter.send(mavlink.MAVLink_request_data_stream_message(1, 1, 12, 4, 1))
    copter.heard.clear()
    copter.run(2.0)
    assert len(copter.messages("DISTANCE_SENSOR")) == len(copter.messages("RANGEFINDER")) == 7
    blind = Copter()
    blind.run(2.1)
    for number in (132, 173):
        blind.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number)
        blind.run(0.01)
    assert [m.result for m in blind.messages("COMMAND_ACK")] == [ACCEPTED, ACCEPTED]
    assert not blind.messages("DISTANCE_SENSOR") and not blind.messages("RANGEFINDER")

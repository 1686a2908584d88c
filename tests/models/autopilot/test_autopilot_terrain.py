"""Terrain: heights of targets and mission items above it, and reports, and an area in which GPS is jammed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.interpolate import RegularGridInterpolator

from cosim.frames import deg_e7, geodetic_from_local
from cosim.verdict import Role
from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.mission.terrain import TERRAIN_POINTS
from tests.models.copter import ACCEPTED, LAND, Copter

SPACING, FIRST = 20.0, (-150.0, -140.0)
TERRAIN = 10


def rough() -> NDArray[np.float64]:
    return np.random.default_rng(3).uniform(-3.0, 6.0, (TERRAIN_POINTS, TERRAIN_POINTS))


def above(heights: NDArray[np.float64]) -> Copter:
    copter = Copter()
    copter.m["terrain_spacing"] = SPACING
    copter.m["terrain_origin"][:] = FIRST
    copter.m["terrain"][:] = heights.ravel()
    return copter


def at(north: float, east: float) -> tuple[int, int]:
    """Latitude and longitude [degE7] of a place about the autopilot's default origin."""
    lat, lon, _ = geodetic_from_local(north, east, 0.0, math.radians(-35.363262), math.radians(149.165237), 0.0)
    return deg_e7(lat), deg_e7(lon)


def height(heights: NDArray[np.float64], north: float, east: float) -> float:
    axes = tuple(first + SPACING * np.arange(TERRAIN_POINTS) for first in FIRST)
    place = [np.clip(x, axis[0], axis[-1]) for x, axis in zip((north, east), axes, strict=True)]
    return float(RegularGridInterpolator(axes, heights)([place])[0])


def report(copter: Copter, place: tuple[int, int]) -> Any:
    copter.heard.clear()
    copter.send(mavlink.MAVLink_terrain_check_message(*place))
    copter.run(0.01)
    return copter.messages("TERRAIN_REPORT")[-1]


def test_reports_are_interpolated_as_by_scipy() -> None:
    heights = rough()
    copter = above(heights)
    copter.run(0.1)
    for north, east in ((0.0, 0.0), (-149.0, 13.3), (77.7, -139.0), (150.0, 160.0), (400.0, -900.0)):
        told = report(copter, at(north, east))
        assert told.terrain_height == pytest.approx(584.0 + height(heights, north, east), abs=0.01)
        assert told.current_height == pytest.approx(-height(heights, 0.0, 0.0), abs=0.12)
        assert told.spacing == SPACING
    plane = Copter()
    plane.run(0.1)
    told = report(plane, at(70.0, 9.0))
    assert (told.terrain_height, told.spacing) == (584.0, 100)


def test_targets_in_guided_are_above_the_terrain_at_their_place() -> None:
    """The grid is moved to the place of arming."""
    heights = rough()
    copter = above(heights).in_the_air(10.0)
    lat, lon = at(30.0, 0.0)
    number = mavlink.MAV_CMD_DO_REPOSITION
    copter.answers()
    copter.send(
        mavlink.MAVLink_command_int_message(1, 1, TERRAIN, number, 0, 0, -1.0, 1.0, 0.0, math.nan, lat, lon, 12.0)
    )
    copter.run(0.01)
    assert copter.answers()[0] == ("ACK", number, ACCEPTED)
    assert -copter.m["target"][2] == pytest.approx(
        12.0 + height(heights, 30.0, 0.0) - height(heights, 0.0, 0.0), abs=0.01
    )
    lat, lon = at(-20.0, 15.0)
    zeros = (0.0,) * 8
    copter.send(mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 11, 0xDF8, lat, lon, 9.0, *zeros))
    copter.run(12.0)
    there = height(heights, -20.0, 15.0) - height(heights, 0.0, 0.0)
    assert -copter.v["position"][2] == pytest.approx(9.0 + there, abs=0.2)


def test_missions_fly_to_heights_above_the_terrain() -> None:
    """Items in frames 10 and 11; the same items above a plane are heights above the local origin."""
    for heights in (rough(), np.zeros((TERRAIN_POINTS, TERRAIN_POINTS))):
        copter = above(heights)
        copter.run(2.1)
        places = ((0.0, 0.0, 22, 3, 10.0), (25.0, 0.0, 16, 10, 14.0), (25.0, 18.0, 16, 11, 8.0))
        copter.send(mavlink.MAVLink_mission_count_message(1, 1, len(places) + 1, 0))
        copter.run(0.1)
        for i, (north, east, command, frame, z) in enumerate([(0.0, 0.0, 16, 0, 584.0), *places]):
            lat, lon = at(north, east)
            item = mavlink.MAVLink_mission_item_int_message(1, 1, i, frame, command, 0, 1, 4.0, 0, 0, 0, lat, lon, z, 0)
            copter.send(item)
            copter.run(0.1)
        assert copter.messages("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_ACCEPTED
        assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)[0][2] == ACCEPTED
        assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0][2] == ACCEPTED
        assert copter.ask(mavlink.MAV_CMD_MISSION_START)[0][2] == ACCEPTED
        for north, east, _, _, z in places[1:]:
            for _ in range(400):
                copter.run(0.1)
                if any(f"Reached command #{2 if east == 0.0 else 3}" in m.text for m in copter.messages("STATUSTEXT")):
                    break
            assert copter.v["position"][0] == pytest.approx(north, abs=0.5)
            there = height(heights, north, east) - height(heights, 0.0, 0.0)
            assert -copter.v["position"][2] == pytest.approx(z + there, abs=0.1)


def test_the_jammed_area_is_declared() -> None:
    """For `<jamming gps="true">` of a network."""
    declared = {v.verdict: v.name for v in Autopilot.variables if v.name.startswith("gps_jamming_")}
    assert declared == {
        Role.JAMMED_RADIUS: "gps_jamming_radius",
        Role.JAMMED_NORTH: "gps_jamming_north",
        Role.JAMMED_EAST: "gps_jamming_east",
        Role.JAMMED_FROM: "gps_jamming_start",
        Role.JAMMED_UNTIL: "gps_jamming_stop",
    }


def test_gps_is_jammed_within_the_area_and_its_time() -> None:
    area = {"gps_jamming_north": 20.0, "gps_jamming_radius": 8.0, "gps_jamming_start": 5.0, "gps_jamming_stop": 60.0}
    copter = Copter(autopilot=area).in_the_air(8.0, 12.0)
    copter.heard.clear()
    copter.go(10.0, 0.0, -8.0)
    copter.run(6.0)
    assert not copter.m["gps_jammed"] and copter.messages("STATUSTEXT") == []
    copter.go(20.0, 0.0, -8.0)
    while not copter.m["gps_jammed"] and copter.time < 40.0:
        copter.run(0.1)
    assert copter.v["position"][0] == pytest.approx(12.0, abs=0.5)
    copter.run(7.5)
    texts = [m.text for m in copter.messages("STATUSTEXT")]
    assert "GPS Glitch or Compass error" in texts and "EKF Failsafe: changed to LAND Mode" in texts
    assert copter.m["mode"] == LAND
    copter.run(60.1 - copter.time)
    assert not copter.m["gps_jammed"]
    early = Copter(autopilot={**area, "gps_jamming_north": 0.0})
    early.run(4.9)
    assert not early.m["gps_jammed"]
    early.run(0.3)
    assert early.m["gps_jammed"]

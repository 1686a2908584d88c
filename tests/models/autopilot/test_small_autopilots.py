"""What the small autopilots answer, each as its firmware, and how their vehicles move."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model
from cosim_models.autopilot.ideal_autopilot import IdealAutopilot
from cosim_models.autopilot.plane_autopilot import PlaneAutopilot
from cosim_models.autopilot.quadplane_autopilot import QuadplaneAutopilot
from cosim_models.autopilot.rover_autopilot import RoverAutopilot
from cosim_models.vehicles.boat import Boat
from cosim_models.vehicles.fixed_wing import FixedWing
from cosim_models.vehicles.point_mass import PointMass
from cosim_models.vehicles.quadplane import Quadplane
from cosim_models.vehicles.rover import Rover
from tests.models.pair import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Pair, degrees_of
from tests.models.shipped_kernels import kernels

SET_MODE, ARM, SPEED = (
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
)
TAKEOFF, LAND, RTL = (
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
)
INTERVAL, REQUEST = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE
WAYPOINT = mavlink.MAV_CMD_NAV_WAYPOINT
POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
HOVER = 10.0
UNKNOWN_COMMAND = 9999


@dataclass
class Kind:
    """A vehicle, its autopilot, and what its firmware says."""

    vehicle: type[Model]
    autopilot: type[Model]
    type: int
    guided: int
    rtl: int
    first: int
    takeoff: int
    land: int
    unknown_modes: tuple[int, ...] = field(default=(99,))


KINDS = {
    "point mass": Kind(PointMass, IdealAutopilot, 2, 4, 6, 0, ACCEPTED, ACCEPTED, (99, 3, 16)),
    "rover": Kind(Rover, RoverAutopilot, 10, 15, 11, 0, UNSUPPORTED, UNSUPPORTED, (99, 8, 6)),
    "boat": Kind(Boat, RoverAutopilot, 11, 15, 11, 0, UNSUPPORTED, UNSUPPORTED, (99, 8, 6)),
    "plane": Kind(FixedWing, PlaneAutopilot, 1, 15, 11, 0, FAILED, UNSUPPORTED, (99, 9, 24)),
    "quadplane": Kind(Quadplane, QuadplaneAutopilot, 20, 15, 11, 0, ACCEPTED, UNSUPPORTED, (99, 9, 24, 22)),
}


def made(name: str, **more: Any) -> Pair:
    return Pair(KINDS[name].vehicle, KINDS[name].autopilot, **more)


def started(name: str, **more: Any) -> Pair:
    """Armed in GUIDED."""
    p = made(name, **more)
    p.until(2.5)
    assert p.ask(SET_MODE, 1, KINDS[name].guided) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    return p


def flying(**more: Any) -> Pair:
    """A point mass at 10 m."""
    p = started("point mass", **more)
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, HOVER) == ACCEPTED
    p.until(18.0)
    return p


# ---- conversation --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_it_speaks_as_its_firmware(name: str) -> None:
    kind, p = KINDS[name], made(name, pilot={"SYSID_THISMAV": 1})
    p.until(1.2)
    (first, second) = [m for m in p.heard if m.get_type() == "HEARTBEAT"]
    assert {m.get_type() for m in p.heard} == {"HEARTBEAT"}  # a new link gets nothing else
    assert (first.type, first.autopilot, first.custom_mode) == (kind.type, 3, kind.first)
    assert first.base_mode & 1 and not first.base_mode & 128
    assert second.system_status == mavlink.MAV_STATE_STANDBY
    assert p.ask(ARM, 1) == FAILED  # no position yet
    p.until(2.5)
    for mode in kind.unknown_modes:
        assert p.ask(SET_MODE, 1, mode) == FAILED
    assert p.ask(SET_MODE, 0, kind.guided) == DENIED
    assert p.ask(SET_MODE, 1, kind.guided) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p.one_step()
    assert (p.last("HEARTBEAT").custom_mode, p.last("HEARTBEAT").base_mode & 136) == (kind.guided, 136)
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, HOVER) == kind.takeoff
    assert p.ask(UNKNOWN_COMMAND) == UNSUPPORTED
    assert p.ask(LAND) == kind.land
    assert p.ask(RTL) == ACCEPTED
    assert p.m.mode == kind.rtl


def home_told(p: Pair, until: float) -> list[float]:
    """Times at which HOME_POSITION and GPS_GLOBAL_ORIGIN come, to a tenth of a second."""
    times = []
    while p.time < until:
        p.heard.clear()
        p.one_step()
        kinds = [m.get_type() for m in p.heard]
        assert kinds.count("HOME_POSITION") == kinds.count("GPS_GLOBAL_ORIGIN")
        times += [round(p.time, 1)] * kinds.count("HOME_POSITION")
    return times


@pytest.mark.parametrize(
    ("name", "times"), [("rover", []), ("plane", [2.0, 8.0, 14.0, 20.0]), ("quadplane", [2.0, 8.0])]
)
def test_planes_repeat_their_home_until_they_are_armed_or_it_is_set(name: str, times: list[float]) -> None:
    p = made(name)
    assert home_told(p, times[-1] + 1.0 if times else 10.0) == times
    assert p.ask(ARM, 1) == ACCEPTED
    assert home_told(p, p.time + 8.0) == []
    p = made(name)
    p.until(3.0)
    assert p.ask(mavlink.MAV_CMD_DO_SET_HOME, 1) == ACCEPTED
    assert home_told(p, 10.0) == []


@pytest.mark.parametrize("name", ["point mass", "rover"])
def test_streams_come_at_the_rate_that_was_asked_for(name: str) -> None:
    p = made(name, values={"position_start[1]": 30.0, "position_start[2]": -20.0})
    p.until(2.5)
    assert p.ask(INTERVAL, POSITION, 2e5) == ACCEPTED
    assert p.ask(INTERVAL, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 1e6) == ACCEPTED
    assert p.ask(INTERVAL, 11000, 1e6) == DENIED
    assert p.ask(INTERVAL, POSITION, -2.0) == DENIED
    p.heard.clear()
    p.until(12.55)
    counts = {k: sum(m.get_type() == k for m in p.heard) for k in ("GLOBAL_POSITION_INT", "EKF_STATUS_REPORT")}
    assert counts == {"GLOBAL_POSITION_INT": 50, "EKF_STATUS_REPORT": 10}
    place = p.last("GLOBAL_POSITION_INT")
    assert (place.lat, place.lon) == pytest.approx(degrees_of(30.0, -20.0), abs=2)
    assert (place.alt, place.relative_alt, place.hdg) == (584000, 0, 0)
    assert p.last("EKF_STATUS_REPORT").flags == 831
    p.heard.clear()
    p.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    p.until(14.5)
    assert {m.get_type() for m in p.heard} >= {"ATTITUDE", "VFR_HUD", "SYS_STATUS", "GPS_RAW_INT", "LOCAL_POSITION_NED"}
    assert p.last("GPS_RAW_INT").fix_type == 6
    assert p.ask(INTERVAL, POSITION, -1) == ACCEPTED
    p.heard.clear()
    p.until(15.5)
    assert not [m for m in p.heard if m.get_type() == "GLOBAL_POSITION_INT"]


def test_messages_on_request() -> None:
    p = made("plane")
    assert p.ask(mavlink.MAV_CMD_GET_HOME_POSITION) == FAILED  # home is not known yet
    p.until(2.5)
    for message, kind in (
        (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION"),
        (mavlink.MAVLINK_MSG_ID_HOME_POSITION, "HOME_POSITION"),
        (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, "EXTENDED_SYS_STATE"),
    ):
        assert p.ask(REQUEST, message) == ACCEPTED
        assert p.heard[-2].get_type() == kind
    assert p.ask(REQUEST, 30000) == FAILED
    assert p.ask(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) == ACCEPTED
    p.send(mavlink.MAVLink_timesync_message(0, 12345))
    p.one_step()
    assert p.last("TIMESYNC").ts1 == 12345


@pytest.mark.parametrize(
    ("name", "known", "denied"), [("rover", "CRUISE_SPEED", 0.0), ("point mass", "PSC_POSXY_P", -1.0)]
)
def test_parameters(name: str, known: str, denied: float) -> None:
    p = made(name)
    p.send(mavlink.MAVLink_param_request_list_message(1, 1))
    p.until(1.0)
    told = [m for m in p.heard if m.get_type() == "PARAM_VALUE"]
    names = sorted(v.name for v in p_variables(name) if v.role == "parameter" and v.name.isupper())
    assert [m.param_id for m in told] == names
    assert [m.param_index for m in told] == list(range(told[0].param_count))
    p.send(mavlink.MAVLink_param_set_message(1, 1, known.encode(), 3.5, 9))
    p.one_step()
    assert (p.m[known], p.last("PARAM_VALUE").param_value) == (3.5, 3.5)
    p.send(mavlink.MAVLink_param_set_message(1, 1, known.encode(), denied, 9))
    p.one_step()
    assert (p.m[known], p.last("PARAM_VALUE").param_value) == (3.5, 3.5)
    p.heard.clear()
    p.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, 9))
    p.send(mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_THISMAV", -1))
    p.one_step()
    assert [m.param_id for m in p.heard if m.get_type() == "PARAM_VALUE"] == ["SYSID_THISMAV"]


def p_variables(name: str) -> Any:
    return KINDS[name].autopilot.variables


@pytest.mark.parametrize("name", KINDS)
def test_a_vehicle_of_another_kind_is_an_error(name: str) -> None:
    autopilot = KINDS[name].autopilot
    m = autopilot.record()
    m.attitude[0] = 1.0
    m.airframe = 1  # quad_x
    assert kernels(autopilot)[0](m) == 1


# ---- the point mass ------------------------------------------------------------------------------------------------


def test_its_answer_is_that_of_a_linear_system_of_second_order() -> None:
    """PSC_POSXY_P 1, PSC_VELXY_P 2: poles -1 +- i; x = 1 - exp(-t) (cos t + sin t), one step later."""
    p = flying()
    p.go(1.0, 0.0, HOVER)
    p.one_step()
    track = []
    for _ in range(480):
        p.one_step()
        track.append(p.place[0])
    t = 0.0125 * np.arange(1, 481)
    assert np.abs(np.array(track) - (1.0 - np.exp(-t) * (np.cos(t) + np.sin(t)))).max() < 0.02


@pytest.mark.parametrize(
    ("distance", "t50", "t90", "speed", "overshoot"),
    [(5.0, 1.82, 2.80, 2.58, 0.27), (10.0, 2.40, 3.74, 3.80, 0.43), (20.0, 3.24, 5.08, 5.51, 0.61)],
)
def test_it_moves_nearly_as_arducopter_moved(
    distance: float, t50: float, t90: float, speed: float, overshoot: float
) -> None:
    """Oracle: recorded steps of ArduCopter; it needs 0.3 s less, since it need not lean first."""
    p = flying()
    p.go(distance, 0.0, HOVER)
    begin, passed, fastest, farthest = p.time, {}, 0.0, 0.0
    while p.time < begin + 12.0:
        p.one_step()
        fastest, farthest = max(fastest, float(p.v.velocity[0])), max(farthest, p.place[0])
        for part in (0.5, 0.9):
            if p.place[0] >= part * distance:
                passed.setdefault(part, p.time - begin)
    assert passed[0.5] == pytest.approx(t50 - 0.28, abs=0.05)
    assert passed[0.9] == pytest.approx(t90 - 0.2, abs=0.08)
    assert fastest == pytest.approx(speed, rel=0.06)
    assert 0.0 < farthest - distance < overshoot
    assert p.place == pytest.approx([distance, 0.0, -HOVER], abs=0.01)


def test_it_follows_velocities_for_three_seconds_and_lands() -> None:
    p = flying()
    p.move(0.0, 2.0, 0.0)
    p.until(20.9)
    assert p.v.velocity[1] == pytest.approx(2.0, abs=0.02)
    p.until(26.0)
    assert abs(p.v.velocity[1]) < 0.05
    assert p.ask(SET_MODE, 1, 9) == ACCEPTED
    p.until(50.0)
    assert (bool(p.m.armed), bool(p.v.on_ground), p.place[2]) == (False, True, 0.0)


def test_it_returns_home_at_15_m() -> None:
    p = flying()
    p.go(40.0, 0.0, HOVER)
    p.until(30.0)
    assert p.ask(RTL) == ACCEPTED
    highest = 0.0
    while p.time < 90.0 and p.m.armed:
        p.one_step()
        highest = max(highest, -p.place[2])
    assert not p.m.armed
    assert highest == pytest.approx(15.0, abs=0.6)
    assert p.place == pytest.approx([0.0, 0.0, 0.0], abs=0.1)


# ---- rover and boat ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rover", "boat"])
def test_it_drives_to_positions_and_stops_there(name: str) -> None:
    p = started(name)
    for n, e in ((0.0, 12.0), (20.0, 20.0), (17.0, 20.0)):
        p.go(n, e, HOVER)
        p.until(p.time + 15.0)
        assert math.dist(p.place[:2], (n, e)) < 2.0
        assert abs(p.v.speed) < 0.3
        assert p.place[2] == 0.0


def test_it_does_not_drive_faster_than_it_should_and_follows_velocities() -> None:
    p = started("rover")
    assert p.ask(SPEED, 1, 3.0) == FAILED  # it stands
    p.go(60.0, 0.0, 0.0)
    assert p.ask(SPEED, 1, 3.0) == ACCEPTED
    assert p.ask(SPEED, 2, 3.0) == DENIED
    p.until(14.0)
    assert p.v.speed == pytest.approx(3.0, abs=0.1)
    p.move(0.0, 1.5, 0.0)
    p.until(16.9)
    assert p.v.velocity[:2].tolist() == pytest.approx([0.0, 1.5], abs=0.25)
    p.until(25.0)
    assert p.v.speed == pytest.approx(0.0, abs=0.01)


def test_a_boat_holds_its_place_in_a_current() -> None:
    p = started("boat", values={"current[1]": 0.4})
    p.go(0.0, 15.0, 0.0)
    p.until(20.0)
    away = []
    while p.time < 40.0:
        p.one_step()
        away.append(math.dist(p.place[:2], (0.0, 15.0)))
    assert max(away) < 4.0


def upload(p: Pair, items: list[tuple[int, float, float, float, tuple[float, float]]]) -> int:
    """Uploads a mission of (command, north, east, height, first two parameters); returns the MAV_MISSION_RESULT."""
    p.heard.clear()
    p.send(mavlink.MAVLink_mission_count_message(1, 1, len(items) + 1))
    for _ in range(40):
        p.one_step()
        for m in p.heard:
            if m.get_type() == "MISSION_REQUEST":  # as ArduPilot asks
                command, n, e, z, (p1, p2) = [(WAYPOINT, 0.0, 0.0, 0.0, (0.0, 0.0)), *items][m.seq]
                lat, lon = degrees_of(n, e)
                p.send(
                    mavlink.MAVLink_mission_item_int_message(1, 1, m.seq, 6, command, 0, 1, p1, p2, 0, 0, lat, lon, z)
                )
            if m.get_type() == "MISSION_ACK":
                return int(m.type)
        p.heard.clear()
    raise AssertionError("the upload does not end")


def test_it_drives_a_mission_and_holds_at_its_end() -> None:
    p = started("rover")
    assert p.ask(SET_MODE, 1, 10) == FAILED  # no mission
    assert upload(p, [(LAND, 0.0, 0.0, 0.0, (0.0, 0.0))]) == mavlink.MAV_MISSION_UNSUPPORTED
    mission = [
        (SPEED, 0, 0, 0, (1.0, 4.0)),
        (WAYPOINT, 20.0, 0.0, 0.0, (3.0, 0.0)),
        (WAYPOINT, 20.0, 20.0, 0.0, (0.0, 0.0)),
    ]
    assert upload(p, mission) == mavlink.MAV_MISSION_ACCEPTED
    p.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    p.one_step()
    assert p.last("MISSION_COUNT").count == 4
    assert p.ask(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
    p.heard.clear()
    p.until(40.0)
    assert [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1, 2, 3]
    assert math.dist(p.place[:2], (20.0, 20.0)) < 2.0
    assert p.m.mode == 10
    assert p.ask(RTL) == ACCEPTED
    p.until(60.0)
    assert math.dist(p.place[:2], (0.0, 0.0)) < 2.0


def test_hold_and_disarming_stop_it() -> None:
    p = started("rover")
    p.go(50.0, 0.0, 0.0)
    p.until(8.0)
    assert p.ask(SET_MODE, 1, 4) == ACCEPTED
    p.until(18.0)  # it coasts, with a time constant of 2 s
    assert p.v.speed == pytest.approx(0.0, abs=0.05)
    assert p.ask(ARM, 0) == ACCEPTED
    p.one_step()
    assert p.m.motor[:2].tolist() == [0.5, 0.5]


# ---- the plane -----------------------------------------------------------------------------------------------------


def aloft() -> Pair:
    """A plane that has taken off and circles 20 m east of home at 40 m."""
    p = started("plane")
    p.until(4.0)
    assert p.v.on_ground and p.v.velocity[0] == pytest.approx(0.0, abs=1e-3)  # in GUIDED it waits on the ground
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    while -p.place[2] < 38.0:
        p.one_step()
        assert p.time < 25.0
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    assert p.reposition(0.0, 20.0, 40.0) == ACCEPTED
    p.until(60.0)
    return p


def test_it_takes_off_and_holds_a_place_by_circling_it() -> None:
    p = aloft()
    away, heights, speeds = [], [], []
    for _ in range(2400):
        p.one_step()
        away.append(math.dist(p.place[:2], (0.0, 20.0)))
        heights.append(-p.place[2])
        speeds.append(float(np.linalg.norm(p.v.velocity)))
    assert (min(away), max(away)) == pytest.approx((80.0, 80.0), abs=3.0)
    assert (min(heights), max(heights)) == pytest.approx((40.0, 40.0), abs=1.0)
    assert (min(speeds), max(speeds)) == pytest.approx((22.0, 22.0), abs=0.5)
    p.send(mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, 0xFFB, 0, 0, 55.0, *(0.0,) * 8))
    p.go(500.0, 500.0, 10.0)  # SET_POSITION_TARGET_LOCAL_NED is ignored
    p.until(p.time + 30.0)
    assert -p.place[2] == pytest.approx(55.0, abs=1.0)
    assert math.dist(p.place[:2], (0.0, 20.0)) == pytest.approx(80.0, abs=3.0)
    assert p.ask(SPEED, 0, 26.0) == ACCEPTED
    assert p.ask(SPEED, 0, 60.0) == DENIED
    p.until(p.time + 25.0)
    assert float(np.linalg.norm(p.v.velocity)) == pytest.approx(26.0, abs=0.5)
    assert p.ask(RTL) == ACCEPTED
    p.until(p.time + 50.0)
    assert math.dist(p.place[:2], (0.0, 0.0)) == pytest.approx(80.0, abs=5.0)
    assert -p.place[2] == pytest.approx(100.0, abs=2.0)


def test_it_flies_a_mission_from_the_ground() -> None:
    p = started("plane")
    mission = [(22, 0, 0, 30.0, (0, 0)), (16, 300.0, 200.0, 40.0, (0, 0)), (17, 0.0, 300.0, 40.0, (0, 0))]
    assert upload(p, mission) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    p.heard.clear()
    p.until(90.0)
    assert [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1, 2]
    assert math.dist(p.place[:2], (0.0, 300.0)) == pytest.approx(80.0, abs=5.0)
    assert -p.place[2] == pytest.approx(40.0, abs=1.5)

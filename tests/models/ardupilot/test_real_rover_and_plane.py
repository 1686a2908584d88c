"""The user's ArduRover and ArduPlane, where ARDUPILOT_SITL names a program beside them, with our bodies."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model
from cosim_models.vehicles.boat import Boat
from cosim_models.vehicles.fixed_wing import FixedWing
from cosim_models.vehicles.quadplane import Quadplane
from cosim_models.vehicles.rover import Rover
from tests.models.copter import ACCEPTED, preset
from tests.models.real_copter import READY, RealCopter

PROGRAM = Path(os.environ.get("ARDUPILOT_SITL", ""))
pytestmark = [
    pytest.mark.alone,
    pytest.mark.slow,
    pytest.mark.skipif(
        not all((PROGRAM.parent / name).is_file() for name in ("ardurover", "arduplane")),
        reason="there is no ardurover and arduplane beside ARDUPILOT_SITL",
    ),
]
AUTO, ROVER_GUIDED = mavlink.ROVER_MODE_AUTO, mavlink.ROVER_MODE_GUIDED
TAKEOFF, PLANE_GUIDED, QRTL = mavlink.PLANE_MODE_TAKEOFF, mavlink.PLANE_MODE_GUIDED, mavlink.PLANE_MODE_QRTL
LATITUDE, LONGITUDE = -35.363262, 149.165237


@pytest.fixture
def real(tmp_path: Path) -> Iterator[Callable[..., RealCopter]]:
    made: list[RealCopter] = []

    def make(model: type[Model], **vehicle: Any) -> RealCopter:
        made.append(RealCopter(tmp_path / "run", vehicle, instance=214, model=model))
        made[-1].run(READY)
        return made[-1]

    yield make
    for one in made:
        assert (one.m["lost"], one.m["restarts"]) == (0, 0)
        one.close()


def accepted(one: RealCopter, command: int, *parameters: float) -> None:
    answers = one.ask(command, *parameters)
    assert ("ACK", command, ACCEPTED) in answers, answers


def begin(one: RealCopter, mode: int) -> None:
    accepted(one, mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
    for _ in range(120):  # its logging starts by the wall clock: "Arm: Logging not started"
        one.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        one.run(1.2)
        if one.m["armed"]:
            break
        time.sleep(0.25)
    assert one.m["armed"]


def latitude(north: float) -> int:
    return round((LATITUDE + math.degrees(north / 6378100.0)) * 1e7)


def longitude(east: float) -> int:
    return round((LONGITUDE + math.degrees(east / 6378100.0 / math.cos(math.radians(LATITUDE)))) * 1e7)


def reposition(one: RealCopter, north: float, east: float, height: float) -> None:
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    place = (latitude(north), longitude(east), height)
    one.answers()
    one.send(mavlink.MAVLink_command_int_message(1, 1, frame, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, 0, *place))
    one.run(0.2)
    assert ("ACK", mavlink.MAV_CMD_DO_REPOSITION, ACCEPTED) in one.answers()


def upload(one: RealCopter, *items: tuple[int, float, float, float]) -> None:
    """Uploads items (command, north, east, height above home) behind one for home, on request."""
    rows = [(mavlink.MAV_CMD_NAV_WAYPOINT, 0.0, 0.0, 0.0), *items]
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    one.heard.clear()
    one.send(mavlink.MAVLink_mission_count_message(1, 1, len(rows), 0))
    for _ in range(100):
        one.run(0.05)
        asked = [m for _, m in one.heard if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT")]
        done = one.messages("MISSION_ACK")
        one.heard.clear()
        if done:
            assert done[-1].type == mavlink.MAV_MISSION_ACCEPTED
            return
        if asked:
            k = asked[-1].seq
            command, north, east, height = rows[k]
            place = (latitude(north), longitude(east), height)
            one.send(mavlink.MAVLink_mission_item_int_message(1, 1, k, frame, command, 0, 1, 0, 0, 0, 0, *place, 0))
    raise AssertionError("the mission was not taken")


def angles(one: RealCopter) -> tuple[float, float]:
    """Roll and pitch [deg]."""
    w, x, y, z = one.v["attitude"]
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return math.degrees(roll), math.degrees(math.asin(2 * (w * y - z * x)))


@pytest.mark.parametrize(("model", "drift"), [(Rover, 0.6), (Boat, 2.5)])
def test_ardurover_drives_our_rover_and_boat(real: Callable[..., RealCopter], model: type[Model], drift: float) -> None:
    """To a place in GUIDED, then along a mission. A boat may drift by LOIT_RADIUS, 2 m, before it steers again."""
    one = real(model)
    assert one.m["motor"][:2].tolist() == [0.5, 0.5]  # it stands
    assert {(m.type, m.autopilot) for m in one.messages("HEARTBEAT")} == {(11 if model is Boat else 10, 3)}
    begin(one, ROVER_GUIDED)
    one.go(20.0, 10.0, 0.0)
    flown = one.run(20.0)
    assert np.hypot(*(flown[-1, 1:3] - (20.0, 10.0))) < drift
    assert np.abs(flown[:, 3]).max() == 0.0
    upload(one, (mavlink.MAV_CMD_NAV_WAYPOINT, 40.0, 10.0, 0.0), (mavlink.MAV_CMD_NAV_WAYPOINT, 40.0, -10.0, 0.0))
    accepted(one, mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    one.heard.clear()
    flown = one.run(25.0)
    reached = [m.seq for m in one.messages("MISSION_ITEM_REACHED")]
    assert reached == [1, 2]
    for place in ((40.0, 10.0), (40.0, -10.0)):
        assert np.hypot(*(flown[:, 1:3] - place).T).min() < 3.0  # WP_RADIUS


@pytest.mark.parametrize("name", ["ardupilot_plane", ""])
def test_arduplane_flies_our_fixed_wing(real: Callable[..., RealCopter], name: str) -> None:
    """TAKEOFF, then circles of 80 m about a place in GUIDED: ArduPilot's own plane and the Aerosonde."""
    one = real(FixedWing, **(preset(name) if name else {}))
    assert one.m["motor"][:4].tolist() == pytest.approx([0.5, 0.5, 0.0, 0.5], abs=0.005)
    begin(one, TAKEOFF)
    flown = one.run(55.0)
    assert flown[-1, 3] == pytest.approx(-50.0, abs=3.0)
    reposition(one, 400.0, 0.0, 80.0)
    one.run(40.0)
    flown = one.run(30.0)
    radius = np.hypot(*(flown[:, 1:3] - (400.0, 0.0)).T)
    assert radius.min() > 80.0 and radius.max() < 105.0
    assert np.abs(flown[:, 3] + 80.0).max() < 2.0
    assert np.linalg.norm(flown[:, 4:7], axis=1).mean() == pytest.approx(22.0, abs=1.5)  # AIRSPEED_CRUISE


def test_arduplane_flies_a_mission_with_our_fixed_wing(real: Callable[..., RealCopter]) -> None:
    one = real(FixedWing, **preset("ardupilot_plane"))
    way = mavlink.MAV_CMD_NAV_WAYPOINT
    upload(one, (mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 40.0), (way, 500.0, 0.0, 60.0), (way, 500.0, 400.0, 60.0))
    begin(one, mavlink.PLANE_MODE_AUTO)
    flown = one.run(75.0)
    assert [m.seq for m in one.messages("MISSION_ITEM_REACHED")] == [1, 2, 3]
    for place in ((500.0, 0.0), (500.0, 400.0)):
        assert np.hypot(*(flown[:, 1:3] - place).T).min() < 60.0  # WP_RADIUS is 50 m


def test_arduplane_flies_our_quadplane(real: Callable[..., RealCopter]) -> None:
    """Straight up, over to the wing, and back and down by QRTL."""
    one = real(Quadplane, **preset("ardupilot_quadplane"))
    begin(one, PLANE_GUIDED)
    accepted(one, mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20.0)
    one.run(14.0)
    for _ in range(20):
        one.run(0.25)
        assert max(map(abs, angles(one))) < 3.0
    assert one.v["position"].tolist() == pytest.approx([0.0, 0.0, -20.0], abs=0.5)
    reposition(one, 300.0, 0.0, 40.0)
    one.heard.clear()
    one.run(25.0)
    assert "Transition done" in [m.text for m in one.messages("STATUSTEXT")]
    assert np.linalg.norm(one.v["velocity"]) > 18.0
    assert one.m["motor"][4:8].tolist() == [0.0] * 4
    accepted(one, mavlink.MAV_CMD_DO_SET_MODE, 1, QRTL)
    for _ in range(30):
        one.run(3.0)
        if not one.m["armed"]:
            break
    assert not one.m["armed"]
    assert one.v["position"].tolist() == pytest.approx([0.0, 0.0, 0.0], abs=1.5)

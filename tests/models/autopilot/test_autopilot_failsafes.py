"""What the autopilot does by itself: ground station lost, fences crossed; and the modes that fail-safes may choose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_autopilot_commands import at
from tests.models.copter import ACCEPTED, FAILED, GUIDED, LAND, ONLY_VELOCITY, RTL, Copter, H

ALT_HOLD, BRAKE = (mavlink.COPTER_MODE_ALT_HOLD, mavlink.COPTER_MODE_BRAKE)
SMART_RTL = mavlink.COPTER_MODE_SMART_RTL
STATION = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)


def texts(copter: Copter) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in copter.messages("STATUSTEXT")]


@pytest.mark.parametrize(("enable", "mode"), [(1, RTL), (3, SMART_RTL), (5, LAND), (7, BRAKE), (0, GUIDED)])
def test_a_lost_ground_station(enable: int, mode: int) -> None:
    copter = Copter(autopilot={"FS_GCS_ENABLE": enable, "FS_GCS_TIMEOUT": 2.0}).in_the_air(5.0, 10.0)
    copter.run(1.0)
    assert copter.m["mode"] == GUIDED  # never heard: not lost
    for _ in range(3):
        copter.send(STATION)
        copter.run(1.0)
    copter.heard.clear()
    copter.run(0.9)
    assert copter.m["mode"] == GUIDED
    copter.run(0.3)
    assert copter.m["mode"] == mode
    assert texts(copter) == ([(4, "GCS Failsafe")] if enable else [])
    copter.run(1.0)
    assert copter.messages("HEARTBEAT")[-1].system_status == (5 if enable else 4)
    copter.heard.clear()
    copter.send(STATION)
    copter.run(0.2)
    assert texts(copter) == ([(4, "GCS Failsafe Cleared")] if enable else [])
    assert copter.m["mode"] == mode


def test_other_stations_do_not_count() -> None:
    copter = Copter(autopilot={"FS_GCS_ENABLE": 1, "FS_GCS_TIMEOUT": 1.0, "SYSID_MYGCS": 250}).in_the_air(5.0, 10.0)
    copter.send(STATION)
    copter.run(3.0)
    assert copter.m["mode"] == GUIDED


def test_on_the_ground_it_disarms() -> None:
    copter = Copter(autopilot={"FS_GCS_ENABLE": 1, "FS_GCS_TIMEOUT": 1.0})
    copter.run(2.1)
    copter.send(STATION)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.run(1.3)
    assert not copter.m["armed"]


@pytest.mark.parametrize(
    ("fence", "way", "text"),
    [
        ({"FENCE_RADIUS": 10.0}, (4.0, 0.0, 0.0), "Circle fence breached"),
        ({"FENCE_ALT_MAX": 8.0}, (0.0, 0.0, -2.0), "Max Alt fence breached"),
        ({"FENCE_TYPE": 8, "FENCE_ALT_MIN": 3.0}, (0.0, 0.0, 1.0), "Min Alt fence breached"),
    ],
)
@pytest.mark.parametrize(
    ("action", "mode"), [(1, RTL), (2, LAND), (3, SMART_RTL), (4, BRAKE), (5, SMART_RTL), (0, GUIDED)]
)
def test_fences(fence: dict[str, Any], way: tuple[float, float, float], text: str, action: int, mode: int) -> None:
    values = {"FENCE_ENABLE": 1, "FENCE_ACTION": action, "AVOID_ENABLE": 0, **fence}
    copter = Copter(autopilot=values).in_the_air(5.0, 10.0)
    copter.heard.clear()
    vx, vy, vz = way  # a velocity, since positions beyond a fence are refused
    for _ in range(4):
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=vx, vy=vy, vz=vz)
        copter.run(2.0)
    assert (4, text) in texts(copter)
    assert ((6, "Manual recovery started") in texts(copter)) == (action != 0)
    assert copter.m["mode"] == mode


def test_a_breach_is_found_25_times_a_second_and_acted_on_a_period_later() -> None:
    """As ArduCopter's two threads do it: between one and two periods pass."""
    values = {"FENCE_ENABLE": 1, "FENCE_ACTION": 4, "AVOID_ENABLE": 0, "FENCE_RADIUS": 10.0}
    delays = []
    for early in range(0, 16, 5):  # steps by which the flight begins earlier: other phases of the period
        copter = Copter(autopilot=values).in_the_air(5.0, 10.0)
        copter.run((16 - early) * H)
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
        copter.run(2.4)
        while copter.v["position"][0] <= 10.0:
            copter.tick()
        crossed = copter.time
        while copter.m["mode"] == GUIDED:
            copter.tick()
        delays.append(copter.time - crossed)
    assert min(delays) >= 0.04 - 2 * H and max(delays) <= 0.08 + 2 * H
    assert max(delays) - min(delays) > 0.01


def test_a_breach_is_forgotten_when_fences_are_switched_off() -> None:
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "AVOID_ENABLE": 0, "FENCE_RADIUS": 10.0}).in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
    copter.run(2.4)
    while copter.m["fence_new"] == 0:
        copter.tick()
    copter.m["FENCE_ENABLE"] = 0
    copter.run(1.0)
    assert (copter.m["mode"], copter.m["fence_new"], copter.m["fence_breach"]) == (GUIDED, 0, 0)


@pytest.mark.parametrize(("action", "mode"), [(3, RTL), (5, LAND)])
def test_without_a_path_a_breach_returns_or_lands(action: int, mode: int) -> None:
    values = {"FENCE_ENABLE": 1, "FENCE_ACTION": action, "AVOID_ENABLE": 0, "FENCE_RADIUS": 10.0, "SRTL_POINTS": 0}
    copter = Copter(autopilot=values).in_the_air(5.0, 10.0)
    for _ in range(4):
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
        copter.run(1.5)
    assert copter.m["mode"] == mode


def test_a_breach_is_told_again_twenty_metres_further_and_ends() -> None:
    """Reported only; ten seconds after a change of mode, the fence is looked at again."""
    values = {"FENCE_ENABLE": 1, "FENCE_ACTION": 0, "AVOID_ENABLE": 0, "FENCE_RADIUS": 10.0}
    copter = Copter(autopilot=values).in_the_air(5.0, 10.0)
    copter.heard.clear()
    told: list[float] = []
    for _ in range(110):
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=6.0)
        before = len(texts(copter))
        copter.run(0.1)
        if len(texts(copter)) > before:
            told.append(float(copter.v["position"][0]))
    assert [text for _, text in texts(copter)] == ["Circle fence breached"] * len(told)
    assert told[:2] == [pytest.approx(10.0, abs=0.7), pytest.approx(30.3, abs=0.9)]
    copter.heard.clear()
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)
    changed = copter.time
    copter.run(24.0)
    times = {m.text: t for t, m in copter.heard if m.get_type() == "STATUSTEXT"}
    assert times["Fence breach cleared"] - changed > 9.9
    assert copter.m["fence_breach"] == 0


def test_fences_that_are_off_or_of_another_type_do_nothing() -> None:
    for values in ({"FENCE_ENABLE": 0}, {"FENCE_ENABLE": 1, "FENCE_TYPE": 1}):
        copter = Copter(autopilot={"FENCE_RADIUS": 3.0, **values}).in_the_air(5.0, 10.0)
        copter.go(6.0, 0.0, -5.0)
        copter.run(5.0)
        assert copter.m["mode"] == GUIDED


def test_brake_stops() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
    copter.run(2.5)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, BRAKE) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    copter.run(8.0)
    hold = copter.run(5.0)
    assert np.ptp(hold[:, 1]) < 0.1
    assert np.ptp(hold[:, 3]) < 0.1
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, BRAKE)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ("ACK", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        ("TEXT", 2, "Arm: BRAKE mode not armable"),
    ]


def test_alt_hold_keeps_height_and_lets_go_of_place() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
    copter.run(2.5)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, ALT_HOLD) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    copter.run(1.0)
    drift = copter.run(4.0)
    assert np.ptp(drift[:, 3]) < 0.2
    assert drift[-1, 1] - drift[0, 1] > 2.0


@pytest.mark.parametrize(
    ("fence", "way", "stop"),
    [
        ({"FENCE_RADIUS": 30.0}, (5.0, 0.0, 0.0), (28.0, 0.0, -5.0)),
        ({"FENCE_RADIUS": 30.0}, (3.0, 4.0, 0.0), (16.8, 22.4, -5.0)),
        ({"FENCE_ALT_MAX": 20.0}, (0.0, 0.0, -2.0), (0.0, 0.0, -18.0)),
        ({"FENCE_TYPE": 8, "FENCE_ALT_MIN": 1.0}, (0.0, 0.0, 1.0), (0.0, 0.0, -3.0)),
        ({"FENCE_RADIUS": 30.0, "FENCE_MARGIN": 10.0}, (5.0, 0.0, 0.0), (20.0, 0.0, -5.0)),
    ],
)
def test_velocities_end_at_the_margin_of_a_fence(
    fence: dict[str, float], way: tuple[float, float, float], stop: tuple[float, float, float]
) -> None:
    """ArduCopter stopped 27.7 m from home with a radius of 30 m, and at 7 m over a minimum of 5 m."""
    copter = Copter(autopilot={"FENCE_ENABLE": 1, **fence}).in_the_air(5.0, 10.0)
    vx, vy, vz = way
    for _ in range(200):
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=vx, vy=vy, vz=vz)
        copter.run(0.1)
    assert copter.m["mode"] == GUIDED
    assert copter.v["position"] == pytest.approx(stop, abs=0.6)


def test_loiter_stops_before_a_fence() -> None:
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_RADIUS": 20.0}).in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 5)
    farthest = 0.0
    for _ in range(20):
        copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 1300, 1500, 1500, 0, 0, 0, 0))
        farthest = max(farthest, float(copter.run(1.0)[:, 1].max()))
    assert copter.m["mode"] == 5
    assert 16.0 < farthest < 20.0


@pytest.mark.parametrize("kind", [2, 4])
def test_outside_of_a_fence_nothing_arms(kind: int) -> None:
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_TYPE": kind, "FENCE_RADIUS": 5.0})
    copter.run(2.1)
    lat, lon = at(50.0, 0.0)
    if kind == 2:
        copter.send(mavlink.MAVLink_command_int_message(1, 1, 0, 179, 0, 0, 0, 0, 0, 0, lat, lon, 584.0))
    else:
        copter.send(mavlink.MAVLink_mission_count_message(1, 1, 1, 1))
        copter.run(0.01)
        copter.send(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 0, 5003, 0, 1, 5, 0, 0, 0, lat, lon, 0, 1))
    copter.run(0.02)
    name = "Circle" if kind == 2 else "Polygon"
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ("ACK", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        ("TEXT", 2, f"Arm: Vehicle breaching {name} fence"),
    ]

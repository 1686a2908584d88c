"""Fail-safes of rovers by ArduRover's sources: causes, FS_ACTION, texts, and the crash check.

A real ArduRover 4.7-dev (90700977) whose station fell silent said "Radio Failsafe" 6.6 s after its last HEARTBEAT, and
"GCS Failsafe Cleared" when it was there again: its check of the radio, which runs first, acts for all causes.
"""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_small_autopilots import SET_MODE, WAYPOINT, started, upload
from tests.models.pair import ACCEPTED, Pair

MANUAL, HOLD, LOITER, AUTO, RTL, SMART_RTL, GUIDED = 0, 4, 5, 10, 11, 12, 15
WARNING, INFO, EMERGENCY = mavlink.MAV_SEVERITY_WARNING, mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_EMERGENCY


def texts(p: Pair) -> list[tuple[int, str]]:
    found = [(m.severity, m.text) for m in p.heard if m.get_type() == "STATUSTEXT"]
    p.heard.clear()
    return found


def with_station(p: Pair, seconds: float, system: int = 255) -> None:
    """A HEARTBEAT each second."""
    station = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    for _ in range(round(seconds)):
        p.waiting += mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(station)
        p.until(p.time + 1.0)


def on_its_way(action: int, **more: float) -> Pair:
    p = started("rover", pilot={"FS_ACTION": action, **more})
    p.go(60.0, 0.0, 0.0)
    p.until(p.time + 2.0)
    p.heard.clear()
    return p


@pytest.mark.parametrize(
    ("action", "mode"), [(0, GUIDED), (1, RTL), (2, HOLD), (3, SMART_RTL), (4, SMART_RTL), (6, LOITER)]
)
def test_a_lost_station_is_acted_upon_after_both_times(action: int, mode: int) -> None:
    p = on_its_way(action, FS_GCS_ENABLE=1)
    with_station(p, 3.0)
    last = p.time - 1.0
    while not (said := texts(p)):
        p.one_step()
        assert p.time < 30.0
    assert said == [(WARNING, "Radio Failsafe")]
    assert p.time - last == pytest.approx(5.0 + 1.5, abs=0.25)  # FS_GCS_TIMEOUT and FS_TIMEOUT
    assert p.m.mode == mode
    with_station(p, 1.0)
    assert texts(p) == [(INFO, "GCS Failsafe Cleared")]
    assert p.m.mode == mode


def test_a_failsafe_may_disarm_it() -> None:
    p = on_its_way(5, FS_GCS_ENABLE=1, FS_THR_ENABLE=0)
    with_station(p, 1.0)
    p.until(p.time + 7.0)
    assert not p.m.armed
    assert texts(p) == [(WARNING, "GCS Failsafe"), (INFO, "Throttle disarmed")]


def test_without_a_path_it_holds_or_returns() -> None:
    for action, mode in ((3, RTL), (4, HOLD)):
        p = on_its_way(action, FS_GCS_ENABLE=1, FS_THR_ENABLE=0, SRTL_POINTS=0)
        with_station(p, 1.0)
        p.until(p.time + 7.0)
        assert p.m.mode == mode
        assert texts(p) == [(WARNING, "GCS Failsafe"), (WARNING, "Flight mode change failed")]


def test_a_station_that_was_never_there_another_one_and_none_asked_for() -> None:
    for enabled, system in ((1, 0), (1, 254), (0, 255)):
        p = on_its_way(2, FS_GCS_ENABLE=enabled)
        if system:
            with_station(p, 2.0, system)
        p.until(p.time + 9.0)
        assert p.m.mode == GUIDED and texts(p) == []


def test_in_hold_only_by_option_and_in_rtl_never() -> None:
    for options, mode, acts in ((0, HOLD, False), (1, HOLD, True), (1, RTL, False)):
        p = on_its_way(1, FS_GCS_ENABLE=1, FS_THR_ENABLE=0, FS_OPTIONS=options)
        with_station(p, 1.0)
        assert p.ask(SET_MODE, 1, mode) == ACCEPTED
        p.until(p.time + 9.0)
        assert p.m.mode == (RTL if acts else mode)
        assert ((WARNING, "GCS Failsafe") in texts(p)) == acts


@pytest.mark.parametrize(("enabled", "radio", "mode"), [(1, 0, HOLD), (2, 0, AUTO), (2, 1, HOLD), (1, 2, AUTO)])
def test_a_mission_goes_on_if_it_may(enabled: int, radio: int, mode: int) -> None:
    """By the parameter of the check that acts."""
    p = started("rover", pilot={"FS_GCS_ENABLE": enabled, "FS_THR_ENABLE": radio})
    assert upload(p, [(WAYPOINT, 90.0, 0.0, 0.0, (0.0, 0.0))]) == 0
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    with_station(p, 1.0)
    texts(p)
    p.until(p.time + 7.0)
    said = [(WARNING, "Radio Failsafe" if radio else "GCS Failsafe")]
    assert texts(p) == (said if mode == HOLD else [*said, (WARNING, "Failsafe - Continuing Auto Mode")])
    assert p.m.mode == mode


def sticks(p: Pair, throttle: int, seconds: float) -> None:
    for _ in range(round(2 * seconds)):
        p.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 0, throttle, 0, 0, 0, 0, 0))
        p.until(p.time + 0.5)


def test_a_throttle_pulse_below_its_value_is_a_lost_radio() -> None:
    p = on_its_way(2)
    sticks(p, 1000, 3.0)
    assert texts(p) == []
    sticks(p, 905, 2.0)
    said = texts(p)
    assert said[0] == (WARNING, "Radio Failsafe") and p.m.mode == HOLD
    p = on_its_way(2, FS_THR_ENABLE=0)
    sticks(p, 905, 3.0)
    assert texts(p) == [] and p.m.mode == GUIDED


def test_a_receiver_without_pulses_is_a_lost_radio() -> None:
    p = on_its_way(1)
    p.m.SIM_RC_FAIL = 1
    began = p.time
    while not (said := texts(p)):
        p.one_step()
        assert p.time < began + 5.0
    assert said == [(WARNING, "Radio Failsafe")]
    assert p.time - began == pytest.approx(0.5 + 1.5, abs=0.3)
    assert p.m.mode == RTL
    p.m.SIM_RC_FAIL = 0
    p.until(p.time + 0.5)
    assert texts(p) == [(INFO, "Radio Failsafe Cleared")]


@pytest.mark.parametrize(("check", "mode", "armed"), [(0, GUIDED, True), (1, HOLD, True), (2, HOLD, False)])
def test_a_vehicle_that_is_stuck_has_crashed(check: int, mode: int, armed: bool) -> None:
    p = on_its_way(2, FS_CRASH_CHECK=check)
    place = p.place
    began = p.time
    while p.time < began + 3.0 and p.m.mode == GUIDED:
        p.v.position[:] = place
        p.v.velocity[:] = 0.0
        p.v.angular_velocity[:] = 0.0
        p.one_step()
    assert (p.m.mode, bool(p.m.armed)) == (mode, armed)
    said = [text for text in texts(p) if text[0] == EMERGENCY]
    assert said == ([(EMERGENCY, "Crash: Going to HOLD")] if check else [])
    if check:
        assert p.time - began == pytest.approx(2.0, abs=0.3)


def test_a_lean_is_a_crash_if_it_may_be_none() -> None:
    p = on_its_way(2, FS_CRASH_CHECK=1, CRASH_ANGLE=30.0)
    half = math.radians(20.0)
    for _ in range(12):
        p.v.attitude[:] = math.cos(half), math.sin(half), 0.0, 0.0
        p.one_step()
    assert p.m.mode == HOLD
    assert (EMERGENCY, "Crash: Going to HOLD") in texts(p)

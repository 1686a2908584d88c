"""Switches of rover, plane and quadplane, as RC_Channel and the sources of ArduRover and ArduPlane say."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_rover_failsafes import texts
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, WAYPOINT, made, started, upload
from tests.models.pair import ACCEPTED, ALTITUDE, DENIED, FAILED, Pair, degrees_of

LOW, MIDDLE, HIGH = 1000, 1500, 1900
INFO, NOTICE, CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_NOTICE, mavlink.MAV_SEVERITY_CRITICAL
AUX = mavlink.MAV_CMD_DO_AUX_FUNCTION
SAVE, RESET, RELAY, STOP, OVERRIDES, CLEAR, GPS = 7, 24, 28, 31, 46, 58, 65
DISARM, SOURCE, SWITCH_RESET, ARM_DISARM, ARM_STOP, CALIBRATE = 81, 90, 96, 153, 165, 171
LEARN, ARM_AIR_MODE = 50, 154


def switch(p: Pair, pulse: int, number: int = 7, seconds: float = 0.5, **sticks: int) -> list[str]:
    """Holds a switch and the centred sticks of a rover, or those given; returns the texts."""
    texts(p)
    pulses = [sticks.get("roll", 1500), 1500, sticks.get("throttle", 1500), 1500, 0, 0, 0, 0]
    pulses[number - 1] = pulse
    p.hold(seconds, pulses, seconds)
    return [text for _, text in texts(p)]


def flying(kind: str, **pilot: float) -> Pair:
    """In GUIDED: a rover on its way, a plane on its circle, a quadplane that hovers."""
    if kind == "rover":
        p = started("rover", pilot=pilot)
        p.go(60.0, 0.0, 0.0)
        p.until(p.time + 2.0)
        return p
    p = made(kind, pilot=pilot)
    p.until(2.5)
    if kind == "plane":
        assert p.ask(SET_MODE, 1, 13) == ACCEPTED and p.ask(ARM, 1) == ACCEPTED
        p.until(25.0)
        assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    else:
        assert p.ask(SET_MODE, 1, 15) == ACCEPTED and p.ask(ARM, 1) == ACCEPTED
        assert p.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20.0) == ACCEPTED
        p.until(20.0)
    return p


# ---- modes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "function", "mode", "middle_returns"),
    [
        *(("rover", function, mode, False) for function, mode in ((4, 11), (42, 12), (51, 0), (52, 1), (53, 3))),
        *(("rover", function, mode, False) for function, mode in ((54, 4), (56, 5), (59, 7), (72, 9))),
        *(("quadplane", function, mode, True) for function, mode in ((4, 11), (108, 21), (170, 17), (56, 12))),
    ],
)
def test_a_switch_changes_the_mode_and_returns_to_that_of_the_mode_switch(
    kind: str, function: int, mode: int, middle_returns: bool
) -> None:
    home = 4 if kind == "rover" else 15
    p = flying(kind, RC7_OPTION=function, **{"MODE6" if kind == "rover" else "FLTMODE6": home})
    assert switch(p, LOW) == [] and p.m.mode == 15
    assert switch(p, HIGH, seconds=0.15) == [] and p.m.mode == 15  # it has to last for 0.2 s
    switch(p, HIGH, seconds=0.3)
    assert p.m.mode == mode
    switch(p, MIDDLE, seconds=0.8)
    assert p.m.mode == (home if middle_returns else mode)  # ArduRover returns at low alone
    switch(p, LOW, seconds=0.8)
    assert p.m.mode == home


@pytest.mark.parametrize(
    ("function", "mode"), [(51, 0), (52, 4), (72, 1), (77, 13), (92, 5), (98, 3), (150, 7), (16, 11)]
)
def test_a_plane_has_modes_of_its_own(function: int, mode: int) -> None:
    """AUTO without a mission is RTL."""
    p = made("plane")
    p.until(2.5)
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    assert p.ask(AUX, function, 2) == ACCEPTED
    assert p.m.mode == mode


def test_modes_that_are_not_entered_say_why() -> None:
    p = started("rover")
    for function, said in ((16, ["No Mission. Can't set AUTO.", "Flight mode change failed"]), (57, None)):
        texts(p)
        assert p.ask(AUX, function, 2) == ACCEPTED
        assert [text for _, text in texts(p)] == (said or ["Flight mode change failed"])
        assert p.m.mode == 15
    p = made("plane")
    p.until(2.5)
    texts(p)
    assert p.ask(AUX, 108, 2) == ACCEPTED
    assert [text for _, text in texts(p)] == ["Q_ENABLE 0"]


@pytest.mark.parametrize(("kind", "name"), [("rover", "MODE"), ("plane", "FLTMODE")])
def test_the_mode_switch_has_six_positions(kind: str, name: str) -> None:
    p = made(
        kind, pilot={f"{name}{i + 1}": mode for i, mode in enumerate((0, 11, 15, 12 if kind == "plane" else 5, 1, 4))}
    )
    p.until(2.5)
    modes = [int(p.m[f"{name}{i}"]) for i in range(1, 7)]
    for pulse, mode in zip((1230, 1231, 1490, 1620, 1621, 1750), modes, strict=True):
        switch(p, pulse, number=8, seconds=0.4)
        assert p.m.mode == mode, pulse
    p.until(p.time + 4.0)  # the override lapses after 3 s: 1800 us again
    assert p.m.mode == modes[5]
    switch(p, 1000, number=8, seconds=0.15)
    assert p.m.mode == modes[5]
    p.m[f"{name}_CH"] = 5
    switch(p, 1000, number=8)
    assert p.m.mode == modes[5]
    switch(p, 1000, number=5)
    assert p.m.mode == modes[0]


def test_a_plane_may_be_asked_for_the_mode_of_its_switch() -> None:
    p = made("plane", pilot={"FLTMODE6": 5})
    p.until(2.5)
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    assert p.ask(AUX, SWITCH_RESET, 0) == ACCEPTED
    p.until(p.time + 0.15)
    assert p.m.mode == 15
    p.until(p.time + 0.3)
    assert p.m.mode == 5


# ---- missions ------------------------------------------------------------------------------------------------------


def test_a_rover_saves_waypoints() -> None:
    p = started("rover", pilot={"RC7_OPTION": SAVE})
    assert p.ask(SET_MODE, 1, 0) == ACCEPTED
    switch(p, LOW)
    places = []
    for _ in range(2):
        assert switch(p, HIGH, seconds=0.4) == ["RC7: SaveWaypoint HIGH"]
        places.append(p.place)
        assert switch(p, LOW, seconds=3.0, throttle=1900) == ["RC7: SaveWaypoint LOW"]
        assert p.ask(SET_MODE, 1, 5) == ACCEPTED
        p.until(p.time + 15.0)
    assert p.m.mission_count == 3 and places[1][0] > 10.0
    for row, place in enumerate(places, 1):
        p.send(mavlink.MAVLink_mission_request_int_message(1, 1, row, 0))
        p.until(p.time + 0.1)
        item = p.last("MISSION_ITEM_INT")
        assert (item.command, item.frame, item.z) == (WAYPOINT, 0, pytest.approx(ALTITUDE, abs=0.01))
        assert (item.x, item.y) == pytest.approx(degrees_of(*place[:2]), abs=20)
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    assert switch(p, HIGH, seconds=0.4)[0] == "RC7: SaveWaypoint HIGH"
    assert p.m.mission_count == 3  # not in AUTO
    assert p.ask(SET_MODE, 1, 4) == ACCEPTED
    assert p.ask(ARM, 0) == ACCEPTED
    switch(p, LOW)
    p.hold(0.4, (1500, 0, 1500, 0, 0, 0, HIGH), 0.4)
    said = texts(p)
    assert said[1] == (NOTICE, "SaveWP: Mission cleared!")
    assert said[2][1].startswith("Set HOME to -35.36") and said[2][1].endswith(" at 584.00m")
    assert p.m.mission_count == 0


@pytest.mark.parametrize("kind", ["rover", "plane"])
def test_a_mission_begins_anew_and_is_cleared_unless_it_is_carried_out(kind: str) -> None:
    p = flying(kind)
    items = [(WAYPOINT, 300.0, 0.0, 60.0, (0.0, 0.0)), (WAYPOINT, 600.0, 0.0, 60.0, (0.0, 0.0))]
    assert upload(p, items) == 0
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    assert p.ask(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == ACCEPTED
    p.until(p.time + 0.1)
    assert p.ask(AUX, RESET, 1) == ACCEPTED and p.m.mission_current == 2
    assert p.ask(AUX, RESET, 2) == ACCEPTED and p.m.mission_current == 1
    assert p.ask(AUX, CLEAR, 2) == ACCEPTED and p.m.mission_count == 3
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    assert p.ask(AUX, RESET, 2) == ACCEPTED and p.m.mission_current == 0
    assert p.ask(AUX, CLEAR, 2) == ACCEPTED and p.m.mission_count == 0


# ---- arming and stopping -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["rover", "plane", "quadplane"])
def test_the_first_position_of_a_switch_that_arms_does_not_act_where_the_receiver_has_none(kind: str) -> None:
    p = made(kind, pilot={"RC7_OPTION": ARM_DISARM})  # without a pilot, channel 7 is low
    p.until(2.5)
    for pulse, armed in ((LOW, False), (HIGH, True), (MIDDLE, True), (LOW, False)):
        switch(p, pulse, throttle=1500 if kind == "rover" else 1000)
        assert p.m.armed == armed, pulse
    p = made(kind, pilot={"RC7_OPTION": DISARM})
    p.until(2.5)
    assert p.ask(ARM, 1) == ACCEPTED
    switch(p, HIGH, throttle=1500 if kind == "rover" else 1000)
    assert not p.m.armed


def test_arming_with_air_mode_is_known_to_planes_alone() -> None:
    p = made("plane", pilot={"RC7_OPTION": ARM_AIR_MODE})
    p.until(2.5)
    for pulse, armed in ((HIGH, True), (MIDDLE, True), (LOW, False)):
        switch(p, pulse, throttle=1000)
        assert p.m.armed == armed, pulse
    p = made("rover")
    p.until(2.5)
    assert p.ask(AUX, ARM_AIR_MODE, 2) == FAILED


def test_a_plane_is_disarmed_in_the_air() -> None:
    p = flying("plane")
    assert p.ask(ARM, 0) == FAILED
    assert p.ask(AUX, ARM_DISARM, 0) == ACCEPTED
    p.one_step()
    assert not p.m.armed and p.m.motor[2] == 0.0


@pytest.mark.parametrize("kind", ["rover", "plane", "quadplane"])
def test_an_emergency_stop_keeps_it_armed_and_forbids_arming(kind: str) -> None:
    p = flying(kind, RC7_OPTION=STOP)
    idle = [0.5] if kind == "rover" else [0.0] if kind == "plane" else [0.0] * 5
    motors = slice(1, 2) if kind == "rover" else slice(2, 3) if kind == "plane" else [2, 4, 5, 6, 7]
    pulses = {"throttle": 1500 if kind == "rover" else 1000}
    assert switch(p, LOW, **pulses) == []
    assert p.m.motor[motors].tolist() != idle
    assert switch(p, HIGH, **pulses) == ["RC7: MotorEStop HIGH"]
    assert p.m.armed and p.m.motor[motors].tolist() == idle
    assert switch(p, MIDDLE, **pulses) == ["RC7: MotorEStop MIDDLE"]
    assert p.m.motor[motors].tolist() == idle
    assert switch(p, LOW, **pulses) == ["RC7: MotorEStop LOW"]
    assert p.m.motor[motors].tolist() != idle
    p = made(kind)
    p.until(2.5)
    assert p.ask(AUX, STOP, 2) == ACCEPTED
    texts(p)
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: Motors Emergency Stopped")]
    assert p.ask(ARM, 1, 21196) == ACCEPTED


def test_a_switch_that_arms_and_stops() -> None:
    p = made("rover")
    p.until(2.5)
    for position, armed, stopped in ((0, False, True), (2, True, False), (0, True, True), (1, True, False)):
        assert p.ask(AUX, ARM_STOP, position) == ACCEPTED
        assert (bool(p.m.armed), bool(p.m.emergency_stop)) == (armed, stopped), position


# ---- others --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["rover", "plane"])
def test_relays_sources_and_functions_without_a_part_on_board(kind: str) -> None:
    p = started(kind, pilot={"RC6_OPTION": RELAY})
    assert switch(p, HIGH, number=6) == ["RC6: Relay1 HIGH"] and p.m.relay_on
    assert switch(p, MIDDLE, number=6) == ["RC6: Relay1 MIDDLE"] and not p.m.relay_on
    for function, position, result, said in (
        (SOURCE, 1, ACCEPTED, [(INFO, "Using EKF Source Set 2")]),
        (CALIBRATE, 2, ACCEPTED, [(NOTICE, "Disarm to allow compass calibration")]),
        (9, 2, ACCEPTED, [] if kind == "rover" else [(INFO, "Function 9 does nothing on this vehicle")]),
        (9, 0, ACCEPTED, []),
        (66, 2, ACCEPTED, []),
        (305, 0, ACCEPTED, []),
        (166, 2, FAILED, []),
        (41, 2, FAILED, [(INFO, "Invalid channel option (41)")]),
        (600, 2, FAILED, [(INFO, "Invalid channel option (600)")]),
        (9, 3, DENIED, []),
        (9, -1, DENIED, []),
    ):
        texts(p)
        assert p.ask(AUX, function, position) == result, function
        assert texts(p) == said
    assert p.ask(AUX, SAVE, 0) == (ACCEPTED if kind == "rover" else FAILED)


def test_a_rover_learns_its_cruise_speed() -> None:
    p = made("rover")
    p.until(2.5)
    texts(p)
    assert p.ask(AUX, LEARN, 2) == ACCEPTED
    assert texts(p) == [(CRITICAL, "Cruise Learning NOT started")]
    assert p.ask(ARM, 1) == ACCEPTED
    texts(p)
    assert p.ask(AUX, LEARN, 2) == ACCEPTED
    p.until(p.time + 3.0)
    assert texts(p) == [(CRITICAL, "Cruise Learning started"), (CRITICAL, "Cruise Learning failed")]
    p.hold(8.0, (1500, 0, 1718), 0.5)  # 188 of 470 us: 40 %
    texts(p)
    assert p.ask(AUX, LEARN, 2) == ACCEPTED
    began = p.time
    while p.m.learns:
        p.hold(0.0125, (1500, 0, 1718), 0.0125)
    assert p.time - began == pytest.approx(2.0, abs=0.15)
    speed = math.hypot(*p.v.velocity[:2])
    assert p.m.CRUISE_THROTTLE in (39.0, 40.0)
    assert pytest.approx(speed, rel=0.02) == p.m.CRUISE_SPEED and speed > 6.0
    thr = int(p.m.CRUISE_THROTTLE)
    assert texts(p)[-1] == (CRITICAL, f"Cruise Learned: Thr:{thr} Speed:{p.m.CRUISE_SPEED:.1f}")


def test_overrides_may_be_forbidden() -> None:
    p = started("rover")
    assert p.ask(SET_MODE, 1, 0) == ACCEPTED
    p.hold(1.0, (1500, 0, 1800), 0.5)
    assert p.m.motor[1] > 0.7
    assert p.ask(AUX, OVERRIDES, 0) == ACCEPTED
    p.hold(2.0, (1500, 0, 1800), 0.5)
    assert p.m.motor[1] == 0.5
    assert p.ask(AUX, OVERRIDES, 2) == ACCEPTED
    p.hold(1.0, (1500, 0, 1800), 0.5)
    assert p.m.motor[1] > 0.7


def test_a_switch_silences_the_gps_of_a_rover() -> None:
    p = flying("rover")
    assert p.ask(AUX, GPS, 2) == ACCEPTED
    began = p.time
    while p.m.mode == 15:
        p.one_step()
        assert p.time < began + 10.0
    assert p.time - began == pytest.approx(8.0, abs=0.2) and p.m.mode == 4
    assert p.ask(AUX, GPS, 0) == ACCEPTED
    p.until(p.time + 1.2)
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED


def test_switches_are_read_while_a_channel_is_overridden_and_start_anew_after_a_reboot() -> None:
    p = made("rover", pilot={"RC5_OPTION": 4})  # 1800 us of the simulated receiver: middle
    p.until(4.0)
    assert p.m.mode == 0 and p.m.switch_due > 1e200
    switch(p, HIGH, number=5)
    assert p.m.mode == 11 and p.m.switch_due < 1e200
    p.until(p.time + 4.0)
    assert p.m.switch_due > 1e200
    assert p.ask(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
    p.until(p.time + 5.0)
    assert p.m.mode == 0
    switch(p, HIGH, number=5)
    assert p.m.mode == 11

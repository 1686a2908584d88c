"""Channels with an RCn_OPTION: switches of the remote control, as RC_Channel and ArduCopter's sources say."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, FAILED, GUIDED, RTL, Copter

LOITER, LAND, BRAKE, AUTO, STABILIZE = 5, 9, 17, 3, 0
LOW, MIDDLE, HIGH = 1000, 1500, 1900
SAVE, FENCE, RESET, RELAY, ESTOP, CLEAR, SURFACE, DISARM, ARM_DISARM, ARM_ESTOP = (
    7,
    11,
    24,
    28,
    31,
    58,
    75,
    81,
    153,
    165,
)


def switch(copter: Copter, pulse: int, number: int = 7, throttle: int = 1500, seconds: float = 0.5) -> list[str]:
    """Holds a switch; returns the texts."""
    copter.heard.clear()
    pulses = [1500, 1500, throttle, 1500, 0, 0, 0, 0]
    pulses[number - 1] = pulse
    copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pulses))
    copter.run(seconds)
    return [m.text for m in copter.messages("STATUSTEXT")]


def flying(option: int, **more: Any) -> Copter:
    copter = Copter(autopilot={"RC7_OPTION": option, **more}).in_the_air(10.0)
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    copter.run(0.1)
    return copter


@pytest.mark.parametrize(("option", "mode"), [(4, RTL), (18, LAND), (33, BRAKE), (55, GUIDED), (42, 21)])
def test_a_switch_changes_the_mode_and_returns_to_that_of_the_mode_switch(option: int, mode: int) -> None:
    copter = flying(option)
    assert switch(copter, LOW) == []
    assert copter.m["mode"] == LOITER
    assert switch(copter, HIGH, seconds=0.15) == []
    assert copter.m["mode"] == LOITER  # it has to last for 0.2 s
    switch(copter, HIGH, seconds=0.3)
    assert copter.m["mode"] == mode
    switch(copter, MIDDLE, seconds=1.0)
    assert copter.m["mode"] == STABILIZE  # FLTMODE6, by channel 5 at 1800 us


def test_fence_and_relay_are_told() -> None:
    copter = flying(FENCE)
    assert switch(copter, LOW) == []  # as without a pilot
    assert switch(copter, HIGH) == ["RC7: Fence HIGH"]
    assert copter.m["FENCE_ENABLE"] == 1
    assert switch(copter, MIDDLE) == ["RC7: Fence MIDDLE"]
    assert copter.m["FENCE_ENABLE"] == 0
    copter = Copter(autopilot={"RC12_OPTION": RELAY}).in_the_air(5.0)
    pulses = [1500] * 4 + [0] * 7 + [HIGH]
    copter.heard.clear()
    copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pulses, *[0] * 6))
    copter.run(0.5)
    assert [m.text for m in copter.messages("STATUSTEXT")] == ["RC12: Relay1 HIGH"]
    assert copter.m["relay_on"]


def test_without_a_function_or_a_pilot_nothing_happens() -> None:
    copter = flying(0)
    assert switch(copter, HIGH) == []
    copter = Copter(autopilot={"RC5_OPTION": 4}).in_the_air(5.0)  # 1800 us of the simulated receiver
    copter.run(2.0)
    assert copter.m["mode"] == GUIDED


def test_the_first_position_of_a_switch_that_arms_does_not_act() -> None:
    copter = Copter(autopilot={"RC7_OPTION": ARM_DISARM})
    copter.run(2.5)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    for pulse, armed in ((LOW, False), (HIGH, True), (MIDDLE, True), (LOW, False)):
        switch(copter, pulse, throttle=1000)
        assert copter.m["armed"] == armed, pulse
    copter = Copter(autopilot={"RC9_OPTION": ARM_DISARM})
    copter.run(2.5)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    for pulse, armed in ((HIGH, False), (LOW, False), (HIGH, True)):  # channel 9 has no position without a pilot
        pulses = [1500, 1500, 1000, 1500, 0, 0, 0, 0, pulse]
        copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pulses, *[0] * 9))
        copter.run(0.5)
        assert copter.m["armed"] == armed, pulse
    copter = flying(DISARM)
    switch(copter, HIGH)
    assert not copter.m["armed"]


def test_an_emergency_stop_keeps_it_armed_for_half_of_disarm_delay() -> None:
    copter = flying(ESTOP)
    assert switch(copter, HIGH) == ["RC7: MotorEStop HIGH"]
    assert copter.m["armed"] and not copter.m["motor"].any()
    switch(copter, LOW)
    assert copter.m["motor"].any()
    copter = flying(ESTOP)
    switch(copter, HIGH, seconds=3.0)
    assert copter.m["armed"]
    switch(copter, HIGH, seconds=2.5)
    assert not copter.m["armed"]  # 5 s after the stop
    arming = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert copter.ask(arming, 1) == [("ACK", arming, FAILED), ("TEXT", 2, "Arm: Motors Emergency Stopped")]
    copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, ESTOP, 0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    assert copter.ask(arming, 1)[0] == ("ACK", arming, ACCEPTED)


def test_a_switch_that_arms_and_stops() -> None:
    copter = Copter(autopilot={"RC7_OPTION": ARM_ESTOP})
    copter.run(2.5)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    switch(copter, LOW, throttle=1000)
    switch(copter, MIDDLE, throttle=1000)
    assert not copter.m["armed"] and not copter.m["emergency_stop"]
    switch(copter, HIGH, throttle=1000)
    assert copter.m["armed"]
    switch(copter, HIGH, throttle=1000, seconds=2.5)
    assert copter.m["motor"].any()
    switch(copter, LOW, throttle=1000)
    assert not copter.m["motor"].any()


def mission(copter: Copter) -> list[tuple[int, int, float]]:
    """Command, frame and height of each item."""
    copter.heard.clear()
    found = []
    for number in range(1, int(copter.m["mission_count"])):
        copter.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, 0))
        copter.run(0.05)
        item = copter.messages("MISSION_ITEM_INT")[-1]
        found.append((item.command, item.frame, round(item.z)))
        if item.command != 22:
            assert (item.x, item.y) == pytest.approx((-353632620, 1491652370), abs=30)
    return found


def test_a_mission_is_saved_reset_and_cleared_by_switches() -> None:
    copter = flying(SAVE)
    switch(copter, LOW)
    assert switch(copter, HIGH) == ["RC7: SaveWaypoint HIGH"]
    assert mission(copter) == [(22, 3, 10), (16, 3, 10)]
    switch(copter, LOW)
    switch(copter, HIGH, throttle=1000, seconds=0.4)
    assert mission(copter)[2][0] == 21  # a closed throttle makes it a landing
    copter.m["mission_current"] = 2
    copter.m["RC7_OPTION"] = RESET
    switch(copter, LOW)
    switch(copter, HIGH)
    assert copter.m["mission_current"] == 0
    copter.m["RC7_OPTION"] = CLEAR
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    switch(copter, LOW)
    switch(copter, HIGH)
    assert copter.m["mission_count"] == 4  # it is flown
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    switch(copter, LOW)
    assert switch(copter, HIGH) == ["RC7: ClearWaypoint HIGH"]
    assert copter.m["mission_count"] == 0
    grounded = Copter(autopilot={"RC7_OPTION": SAVE})
    grounded.run(2.5)
    switch(grounded, LOW)
    switch(grounded, HIGH)
    assert grounded.m["mission_count"] <= 1  # disarmed


def test_surface_tracking_needs_a_sensor_in_its_direction() -> None:
    copter = flying(SURFACE)
    assert switch(copter, MIDDLE) == ["RC7: SurfaceTracking MIDDLE"]
    told = ["RC7: SurfaceTracking LOW", "SurfaceTracking: no downward rangefinder"]
    assert switch(copter, LOW) == told
    assert switch(copter, HIGH) == ["RC7: SurfaceTracking HIGH", "SurfaceTracking: no upward rangefinder"]
    copter = flying(SURFACE, RNGFND1_TYPE=100)
    assert switch(copter, MIDDLE) == ["RC7: SurfaceTracking MIDDLE"]
    assert copter.m["SURFTRAK_MODE"] == 0
    switch(copter, LOW)
    assert copter.m["SURFTRAK_MODE"] == 1

"""Flying by hand: overrides of the remote control, sticks, switches, CIRCLE, and what a lost radio does."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, FAILED, GUIDED, LAND, LOITER, RTL, STABILIZE, Copter
from tests.models.pilot import IGNORE, RELEASE, flown, hold, lean, override, texts

ALT_HOLD, CIRCLE, BRAKE = (mavlink.COPTER_MODE_ALT_HOLD, mavlink.COPTER_MODE_CIRCLE, mavlink.COPTER_MODE_BRAKE)


def channels(copter: Copter) -> Any:
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    copter.tick()
    (message,) = copter.messages("RC_CHANNELS")
    return message


def pulses(message: Any, count: int = 8) -> list[int]:
    return [getattr(message, f"chan{i}_raw") for i in range(1, count + 1)]


# ---- channels ------------------------------------------------------------------------------------------------------


def test_a_receiver_whose_sticks_nobody_holds() -> None:
    copter = Copter()
    copter.run(0.1)
    message = channels(copter)
    assert message.chancount == 8
    assert pulses(message, 9) == [1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800, 0]  # as ArduPilot's simulation
    assert message.rssi == 255
    copter = Copter(autopilot={"SIM_RC_FAIL": 1, "FS_THR_ENABLE": 0})
    copter.run(0.1)
    assert channels(copter).chancount == 0


def test_overrides_are_ignored_released_and_lapse() -> None:
    copter = Copter(autopilot={"RC_OVERRIDE_TIME": 1.0})
    copter.run(0.1)
    override(copter, 1600, 1700, IGNORE, 1400, more=(1111, 0))
    assert pulses(channels(copter), 10) == [1600, 1700, 1000, 1400, 1800, 1000, 1000, 1800, 1111, 0]
    override(copter, 0, IGNORE, more=(RELEASE,))
    assert pulses(channels(copter), 9)[:2] == [1500, 1700]
    assert channels(copter).chan9_raw == 0
    copter.run(0.9)
    assert channels(copter).chan2_raw == 1700
    copter.run(0.2)
    assert channels(copter).chan2_raw == 1500


@pytest.mark.parametrize(("time", "pulse"), [(-1.0, 1700), (0.0, 1500)])
def test_overrides_that_hold_for_ever_or_not_at_all(time: float, pulse: int) -> None:
    copter = Copter(autopilot={"RC_OVERRIDE_TIME": time})
    override(copter, 1700)
    copter.run(20.0)
    assert channels(copter).chan1_raw == pulse


def test_only_the_ground_station_flies() -> None:
    copter = Copter(autopilot={"SYSID_MYGCS": 250})
    copter.run(0.1)
    override(copter, 1700)
    copter.send(mavlink.MAVLink_manual_control_message(1, 500, 0, 500, 0, 0))
    assert channels(copter).chan1_raw == 1500


def test_manual_control_moves_the_four_sticks() -> None:
    copter = Copter()
    copter.run(0.1)
    copter.send(mavlink.MAVLink_manual_control_message(1, 400, -200, 750, 1000, 0))
    assert pulses(channels(copter), 4) == [1400, 1300, 1750, 2000]
    copter.send(mavlink.MAVLink_manual_control_message(1, 0, 0, -1, 0, 0))  # ArduCopter has no negative thrust
    copter.send(mavlink.MAVLink_manual_control_message(2, 0, 0, 0, 0, 0))  # another vehicle's
    assert pulses(channels(copter), 4) == [1400, 1300, 1750, 2000]
    copter.send(mavlink.MAVLink_manual_control_message(1, 32767, 100, 750, 0, 0))  # x is not controlled
    assert pulses(channels(copter), 4) == [1550, 1500, 1750, 1500]


# ---- modes ---------------------------------------------------------------------------------------------------------


def test_stabilize_from_the_ground_up() -> None:
    copter = Copter(autopilot={"MOT_THST_HOVER": 0.53})  # of this vehicle: the throttle with the stick in its middle
    copter.run(2.1)
    override(copter, 1500, 1500, 1000, 1500)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )
    hold(copter, 3.0, 1500, 1500, 1000, 1500)
    assert copter.m["on_ground"]
    hold(copter, 1.5, 1500, 1500, 1650, 1500)
    up = hold(copter, 3.0, 1500, 1500, 1540, 1500)
    assert not copter.m["on_ground"]
    assert -up[-1, 3] > 2.0
    assert np.abs(up[:, 1:3]).max() < 0.2
    hold(copter, 1.0, 1750, 1500, 1540, 1500)  # half way right of the dead zone: tan of half of ANGLE_MAX
    most = (1750 - 1520) / 480 * 30.0
    assert lean(copter)[0] == pytest.approx(most, abs=0.7)
    assert lean(copter)[1] == pytest.approx(0.0, abs=0.7)
    hold(copter, 1.0, 1500, 1250, 1540, 1500)
    assert lean(copter)[1] == pytest.approx(-most, abs=0.7)


def test_alt_hold_takes_off_climbs_and_lands_by_the_throttle() -> None:
    copter = Copter()
    copter.run(2.1)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, ALT_HOLD) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    override(copter, 1500, 1500, 1000, 1500)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )
    hold(copter, 3.0, 1500, 1500, 1500, 1500)
    assert copter.m["on_ground"]
    up = hold(copter, 6.0, 1500, 1500, 2000, 1500)
    assert -up[-1, 6] == pytest.approx(2.5, abs=0.1)  # PILOT_SPEED_UP
    level = hold(copter, 6.0, 1500, 1500, 1500, 1500)
    assert np.ptp(level[-800:, 3]) < 0.15
    half = hold(copter, 3.0, 1500, 1500, 1300, 1500)
    # throttle stick from the dead zone of 30 us up, 1000 at the top; THR_DZ of 100 about the middle
    stick, middle = (1300 - 1030) / 0.97, (1500 - 1030) / 0.97
    assert half[-1, 6] == pytest.approx(2.5 * (middle - 100 - stick) / (middle - 100), abs=0.1)
    hold(copter, 20.0, 1500, 1500, 1000, 1500)
    assert copter.m["on_ground"]
    hold(copter, 11.0, 1500, 1500, 1000, 1500)
    assert not copter.m["armed"]


def test_a_takeoff_that_climbs_by_itself() -> None:
    copter = Copter(autopilot={"PILOT_TKOFF_ALT": 300.0})
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    override(copter, 1500, 1500, 1500, 1500)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )
    hold(copter, 3.0, 1500, 1500, 1500, 1500)
    hold(copter, 1.5, 1500, 1500, 1700, 1500)
    assert not copter.m["on_ground"]
    rest = hold(copter, 10.0, 1500, 1500, 1500, 1500)
    assert -rest[-1, 3] == pytest.approx(3.0, abs=0.25)


def test_the_yaw_stick_turns_at_pilot_y_rate() -> None:
    copter = flown(ALT_HOLD)
    hold(copter, 2.0, 1500, 1500, 1500, 1750)
    wanted = (1750 - 1520) / 480 * 202.5
    assert math.degrees(copter.m["rate_target"][2]) == pytest.approx(wanted, rel=1e-3)
    assert math.degrees(copter.v["angular_velocity"][2]) == pytest.approx(wanted, rel=0.1)
    slow = flown(ALT_HOLD, PILOT_Y_EXPO=0.5, PILOT_Y_RATE=100.0)
    hold(slow, 2.0, 1500, 1500, 1500, 1760)
    assert math.degrees(slow.m["rate_target"][2]) == pytest.approx(100.0 * 0.5 * 0.5 / 0.75, rel=1e-3)


def test_loiter_accelerates_by_stick_brakes_and_holds() -> None:
    copter = flown(LOITER)
    hold(copter, 1.0, 1500, 1500, 1500, 1500)
    path = hold(copter, 12.0, 1500, 1100, 1500, 1500)
    # drag balances the stick: 12.5 m/s times the share of the lean's tangent
    share = math.tan(math.radians(20.0 * 380 / 480)) / math.tan(math.radians(20.0))
    assert path[-1, 4] == pytest.approx(12.5 * share, rel=0.06)
    assert np.abs(path[:, 2]).max() < 0.3
    assert np.ptp(path[:, 3]) < 0.4
    hold(copter, 10.0, 1500, 1500, 1500, 1500)
    rest = hold(copter, 5.0, 1500, 1500, 1500, 1500)
    assert np.ptp(rest[:, 1]) < 0.1
    assert np.linalg.norm(rest[-1, 4:7]) < 0.05


def test_loit_speed_acts() -> None:
    copter = flown(LOITER, LOIT_SPEED=300.0, LOIT_ANG_MAX=10.0)
    path = hold(copter, 8.0, 2000, 1500, 1500, 1500)
    assert path[-1, 5] == pytest.approx(3.0, rel=0.06)
    assert max(abs(x) for x in lean(copter)) < 12.0


def test_loiter_takes_off_and_lands_by_the_throttle() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    override(copter, 1500, 1500, 1000, 1500)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )
    hold(copter, 3.0, 1500, 1500, 1500, 1500)
    hold(copter, 5.0, 1500, 1500, 1800, 1500)
    assert copter.v["position"][2] < -3.0
    copter.run(5.0)  # hands off: the height is kept
    assert abs(copter.v["velocity"][2]) < 0.1
    hold(copter, 12.0, 1500, 1500, 1100, 1500)
    assert copter.m["on_ground"]


def test_circle_is_flown_round_its_centre() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, CIRCLE) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    copter.run(10.0)
    path = copter.run(18.0)
    radius = np.hypot(path[:, 1] - 10.0, path[:, 2])
    # ArduCopter's position controller leads nothing: the circle flown is narrower than the one wanted
    assert radius.mean() == pytest.approx(10.0, abs=1.5)
    assert np.ptp(radius) < 0.5
    angle = np.unwrap(np.arctan2(path[:, 2], path[:, 1] - 10.0))
    assert math.degrees((angle[-1] - angle[0]) / (path[-1, 0] - path[0, 0])) == pytest.approx(20.0, abs=0.3)
    assert np.ptp(path[:, 3]) < 0.2
    w, x, y, z = copter.v["attitude"]
    nose = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    inwards = math.degrees(math.atan2(-copter.v["position"][1], 10.0 - copter.v["position"][0]))
    assert (nose - inwards + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=15.0)
    assert copter.messages("HEARTBEAT")[-1].base_mode & 8


def test_circle_backwards_small_and_changed_by_the_sticks() -> None:
    copter = Copter(autopilot={"CIRCLE_RADIUS": 300.0, "CIRCLE_RATE": -30.0}).in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, CIRCLE)
    path = copter.run(12.0)
    angle = np.unwrap(np.arctan2(path[-2400:, 2], path[-2400:, 1] - 3.0))
    assert angle[-1] < angle[0]
    hold(copter, 2.0, 1500, 1700, 1500, 1500)
    assert copter.m["circle_radius"] == pytest.approx(3.0 + 2.0 * 10.0 * 180 / 480, rel=0.05)
    climbed = hold(copter, 3.0, 1500, 1500, 1800, 1500)
    assert -climbed[-1, 6] > 1.0


def test_circle_needs_a_position_and_cannot_be_armed_in() -> None:
    copter = Copter(autopilot={"estimate_ready_time": 30.0})
    copter.run(20.0)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    refused = [
        ("ACK", mavlink.MAV_CMD_DO_SET_MODE, FAILED),
        ("TEXT", 4, "Mode change to CIRCLE failed: requires position"),
    ]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, CIRCLE) == refused
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, CIRCLE)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ("ACK", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        ("TEXT", 2, "Arm: CIRCLE mode not armable"),
    ]


# ---- arming and switches -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mode", "pulse"), [(STABILIZE, 1100), (ALT_HOLD, 1700)])
def test_open_throttle_does_not_arm(mode: int, pulse: int) -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
    override(copter, 1500, 1500, pulse, 1500)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ("ACK", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        ("TEXT", 2, "Arm: Throttle too high"),
    ]


def test_open_throttle_does_not_switch_to_stabilize_on_the_ground() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    override(copter, 1500, 1500, 1700, 1500)
    copter.run(0.1)
    for mode, name in ((mavlink.COPTER_MODE_DRIFT, "DRIFT"), (STABILIZE, "STABILIZE")):  # disarmed: not checked
        assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)[0][2] == ACCEPTED
        copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
        copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        refused = [
            ("ACK", mavlink.MAV_CMD_DO_SET_MODE, FAILED),
            ("TEXT", 4, f"Mode change to {name} failed: throttle too high"),
        ]
        assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode) == refused
        copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)


def test_the_yaw_stick_arms_and_disarms() -> None:
    copter = Copter()
    copter.run(2.1)
    hold(copter, 1.5, 1500, 1500, 1000, 2000)
    assert not copter.m["armed"]
    hold(copter, 1.0, 1500, 1500, 1000, 2000)
    assert copter.m["armed"]
    hold(copter, 0.5, 1500, 1500, 1000, 1500)
    hold(copter, 2.5, 1500, 1500, 1000, 1000)
    assert not copter.m["armed"]
    copter = Copter(autopilot={"ARMING_RUDDER": 0})
    copter.run(2.1)
    hold(copter, 3.0, 1500, 1500, 1000, 2000)
    assert not copter.m["armed"]


def test_the_mode_switch() -> None:
    copter = flown(LOITER, FLTMODE2=ALT_HOLD, FLTMODE4=LAND)
    hold(copter, 0.5, 1500, 1500, 1500, 1500, 1300)
    assert copter.m["mode"] == ALT_HOLD
    hold(copter, 0.5, 1500, 1500, 1500, 1500, 1550)
    assert copter.m["mode"] == LAND
    hold(copter, 0.5, 1500, 1500, 1500, 1500, 1700)
    assert copter.m["mode"] == LOITER
    hold(copter, 0.5, 1500, 1500, 1500, 1500, 0)  # released: 1800 us of the simulated receiver, FLTMODE6
    assert copter.m["mode"] == STABILIZE


def test_an_override_of_the_mode_switch_that_lapses() -> None:
    """Only one that has moved the switch counts."""
    copter = flown(LOITER, FLTMODE4=ALT_HOLD)
    hold(copter, 1.0, 1500, 1500, 1500, 1500)
    copter.run(5.0)
    assert copter.m["mode"] == LOITER
    hold(copter, 0.5, 1500, 1500, 1500, 1500, 1550)
    copter.run(2.0)
    assert copter.m["mode"] == ALT_HOLD
    copter.run(1.6)  # RC_OVERRIDE_TIME is 3 s
    assert copter.m["mode"] == STABILIZE


# ---- the radio is lost ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("enable", "mode"), [(1, RTL), (3, LAND), (7, BRAKE), (0, LOITER)])
def test_a_throttle_below_its_least_is_a_lost_radio(enable: int, mode: int) -> None:
    copter = flown(LOITER, FS_THR_ENABLE=enable)
    hold(copter, 1.0, 1500, 1500, 1500, 1500)
    copter.heard.clear()
    hold(copter, 0.5, 1500, 1500, 960, 1500)
    assert copter.m["mode"] == mode
    assert texts(copter) == ([(4, "Radio Failsafe")] if enable else [])
    copter.run(1.0)
    if enable:
        assert copter.messages("HEARTBEAT")[-1].system_status == 5
    copter.heard.clear()
    hold(copter, 0.5, 1500, 1500, 1500, 1500)
    assert texts(copter) == ([(4, "Radio Failsafe Cleared")] if enable else [])
    assert copter.m["mode"] == mode


def test_without_pulses_the_radio_is_lost_when_overrides_lapse() -> None:
    copter = flown(LOITER, SIM_RC_FAIL=1, RC_OVERRIDE_TIME=2.0, RC_FS_TIMEOUT=1.5)
    hold(copter, 2.0, 1500, 1500, 1500, 1500)
    copter.run(2.8)
    assert copter.m["mode"] == LOITER
    copter.run(0.5)
    assert copter.m["mode"] == RTL


@pytest.mark.parametrize(
    ("options", "mode", "text"),
    [
        (4, GUIDED, "Radio Failsafe - Continuing Guided Mode"),
        (8, LAND, "Radio Failsafe - Continuing Landing"),
        (16, GUIDED, "Radio Failsafe"),
    ],
)
def test_what_goes_on_without_radio(options: int, mode: int, text: str) -> None:
    copter = Copter(autopilot={"FS_OPTIONS": options}).in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
    override(copter, 1500, 1500, 900, 1500)
    copter.run(0.3)
    assert texts(copter) == [(4, text)]
    assert copter.m["mode"] == (mode if "Continuing" in text else RTL)


@pytest.mark.parametrize(
    ("options", "mode", "text", "then"),
    [
        (16, LOITER, "GCS Failsafe - Continuing Pilot Control", LOITER),
        (0, LOITER, "GCS Failsafe", RTL),
        (8, LAND, "GCS Failsafe - Continuing Landing", LAND),
    ],
)
def test_what_goes_on_without_ground_station(options: int, mode: int, text: str, then: int) -> None:
    copter = Copter(autopilot={"FS_GCS_ENABLE": 1, "FS_GCS_TIMEOUT": 1.0, "FS_OPTIONS": options}).in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
    copter.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    copter.heard.clear()
    copter.run(1.5)
    assert texts(copter) == [(4, text)]
    assert copter.m["mode"] == then


def test_flying_by_hand_is_a_sign_of_life_of_the_ground_station() -> None:
    copter = flown(LOITER, FS_GCS_ENABLE=1, FS_GCS_TIMEOUT=1.0, FS_OPTIONS=0)
    hold(copter, 3.0, 1500, 1500, 1500, 1500)
    assert copter.m["mode"] == LOITER
    copter.run(1.5)
    assert copter.m["mode"] == RTL


def test_on_the_ground_a_lost_radio_disarms() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    override(copter, 1500, 1500, 900, 1500)
    copter.run(0.3)
    assert not copter.m["armed"]
    assert (4, "Radio Failsafe - Disarming") in texts(copter)

"""Battery and lost position of rovers by ArduRover's sources: alarms, their actions and texts, what arming needs."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_rover_failsafes import (
    AUTO,
    GUIDED,
    HOLD,
    LOITER,
    MANUAL,
    RTL,
    SMART_RTL,
    WARNING,
    on_its_way,
    texts,
)
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, made, started
from tests.models.pair import ACCEPTED, FAILED, Pair

CRITICAL = mavlink.MAV_SEVERITY_CRITICAL
STEERING = 3
REQUEST, RESET = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_BATTERY_RESET


def told(p: Pair, patience: float = 15.0) -> list[tuple[int, str]]:
    """Drives on until it says something."""
    end = p.time + patience
    while not (said := texts(p)):
        p.one_step()
        assert p.time < end, "it says nothing"
    return said


def requested(p: Pair, message: int) -> mavlink.MAVLink_message:
    assert p.ask(REQUEST, message) == ACCEPTED
    return next(m for m in reversed(p.heard) if m.get_msgId() == message)


# ---- battery -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("action", "mode"), [(0, GUIDED), (1, RTL), (2, HOLD), (3, SMART_RTL), (4, SMART_RTL), (6, LOITER)]
)
def test_a_low_voltage_acts_after_its_timer(action: int, mode: int) -> None:
    p = on_its_way(0, BATT_FS_LOW_ACT=action)
    began = p.time
    p.m.SIM_BATT_VOLTAGE = 9.0
    severity, text = told(p)[0]
    assert severity == WARNING
    assert text.startswith("Battery 1 is low 8.") and text.endswith(" mAh")
    assert p.time - began == pytest.approx(10.0, abs=0.25)  # BATT_LOW_TIMER
    assert p.m.mode == mode and p.m.armed
    p.until(p.time + 12.0)
    assert not any("Battery" in text for _, text in texts(p))  # once


def test_the_last_action_disarms() -> None:
    p = on_its_way(0, BATT_FS_CRT_ACT=5, BATT_CRT_VOLT=9.5, BATT_LOW_TIMER=2.0)
    p.m.SIM_BATT_VOLTAGE = 9.0
    said = told(p)
    assert said[0][1].startswith("Battery 1 is critical 8.")
    assert not p.m.armed
    assert said[1:] == [(6, "Throttle disarmed")]


def test_without_a_path_it_returns_or_holds() -> None:
    for action, mode in ((3, RTL), (4, HOLD)):
        p = on_its_way(0, BATT_FS_LOW_ACT=action, SRTL_POINTS=0, BATT_LOW_TIMER=1.0)
        p.m.SIM_BATT_VOLTAGE = 9.0
        said = told(p)
        assert p.m.mode == mode
        assert said[1:] == [(WARNING, "Flight mode change failed")]


def test_full_throttle_takes_50_amperes_and_0_7_volts() -> None:
    p = started("rover", pilot={"FS_ACTION": 0})
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED
    p.hold(3.0, (1500, 0, 2000), 0.5)
    assert p.m.motor[1] == 1.0
    used = float(p.m.battery_used)
    p.hold(3.6, (1500, 0, 2000), 0.4)
    assert float(p.m.battery_used) - used == pytest.approx(50.0, abs=1.5)  # 50 A for 3.6 s: 50 mAh
    status = requested(p, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert (status.voltage_battery, status.current_battery) == (11900, 5000)
    left = 100.0 * (1.0 - float(p.m.battery_used) / 3300.0)
    battery = requested(p, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
    assert (battery.voltages[0], battery.battery_remaining) == (11900, int(left))
    assert battery.current_consumed == pytest.approx(float(p.m.battery_used), abs=0.6)
    assert battery.charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_OK


def test_first_low_then_critical_by_charge_and_the_more_urgent_action_counts() -> None:
    """HOLD is more urgent than RTL: an RTL that comes second does not act."""
    for low, critical, modes in ((1, 2, (RTL, HOLD)), (2, 1, (HOLD, HOLD)), (6, 1, (LOITER, RTL)), (1, 6, (RTL, RTL))):
        p = on_its_way(0, BATT_FS_LOW_ACT=low, BATT_FS_CRT_ACT=critical, BATT_LOW_MAH=100.0, BATT_CRT_MAH=50.0)
        p.m.battery_used = 3201.0
        assert told(p)[0][1].startswith("Battery 1 is low 1") and p.m.mode == modes[0]
        p.m.battery_used = 3251.0
        assert told(p)[0][1].endswith("V used 3251 mAh") and p.m.mode == modes[1]
        battery = requested(p, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
        assert battery.charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL
        assert not requested(p, mavlink.MAVLINK_MSG_ID_SYS_STATUS).onboard_control_sensors_health & 0x2000000


def test_a_reset_takes_the_alarm_back() -> None:
    p = on_its_way(0, BATT_LOW_MAH=100.0)
    p.m.battery_used = 3201.0
    told(p)
    assert p.ask(RESET, 1, 101) == FAILED
    assert p.ask(RESET, 2, 100) == FAILED  # there is no second battery
    assert p.ask(RESET, 1, 100) == ACCEPTED
    assert (p.m.battery_alarm, p.m.battery_used) == (0, 0.0)
    p.m.battery_used = 3201.0
    assert told(p)[0][1].startswith("Battery 1 is low")


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"BATT_ARM_VOLT": 12.7}, "below minimum arming voltage"),
        ({"BATT_ARM_MAH": 3301.0}, "below minimum arming capacity"),
        ({"SIM_BATT_VOLTAGE": 10.4}, "low voltage failsafe"),
        ({"BATT_LOW_MAH": 3301.0}, "low capacity failsafe"),
        ({"BATT_LOW_VOLT": 0.0, "BATT_CRT_VOLT": 12.7}, "critical voltage failsafe"),
        ({"BATT_CRT_MAH": 3301.0}, "critical capacity failsafe"),
        ({"BATT_LOW_MAH": 10.0, "BATT_CRT_MAH": 20.0}, "capacity failsafe critical >= low"),
        ({"BATT_LOW_VOLT": 9.0, "BATT_CRT_VOLT": 9.5}, "voltage failsafe critical >= low"),
    ],
)
def test_what_arming_needs(values: dict[str, float], text: str) -> None:
    p = made("rover", pilot=values)
    p.until(2.5)
    p.heard.clear()
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, f"Arm: Battery 1 {text}")]
    assert p.ask(ARM, 1, 21196) == ACCEPTED


def test_no_arming_after_a_failsafe_until_the_battery_is_charged() -> None:
    p = on_its_way(0, BATT_FS_LOW_ACT=5, BATT_LOW_TIMER=1.0)
    p.m.SIM_BATT_VOLTAGE = 9.0
    told(p)
    p.until(p.time + 1.0)
    assert not p.m.armed
    p.heard.clear()
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: Battery 1 low voltage failsafe")]
    p.m.SIM_BATT_VOLTAGE = 12.6
    p.until(p.time + 0.2)
    assert p.ask(ARM, 1) == ACCEPTED


# ---- position ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("action", "mode", "said"),
    [
        (0, GUIDED, ["EKF variance"]),
        (1, HOLD, ["EKF variance", "EKF failsafe"]),
        (2, GUIDED, ["EKF variance", "EKF failsafe"]),
    ],
)
def test_a_lost_gps_is_a_lost_position(action: int, mode: int, said: list[str]) -> None:
    p = on_its_way(2, FS_EKF_ACTION=action)
    began = p.time
    p.m.SIM_GPS1_ENABLE = 0
    assert told(p) == [(CRITICAL, text) for text in said]
    assert p.time - began == pytest.approx(7.0 + 1.0, abs=0.15)
    assert p.m.mode == mode
    assert requested(p, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags == 167
    assert requested(p, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type == 0
    texts(p)
    for wanted in (AUTO, RTL, STEERING):
        assert p.ask(SET_MODE, 1, wanted) == FAILED
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED
    texts(p)
    p.m.SIM_GPS1_ENABLE = 1
    began = p.time
    assert told(p) == [(CRITICAL, "EKF failsafe cleared")]
    assert p.time - began == pytest.approx(1.0, abs=0.15)
    assert p.m.mode == MANUAL
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    assert requested(p, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags == 831


@pytest.mark.parametrize(("seconds", "result"), [(3.5, ACCEPTED), (4.5, FAILED)])
def test_a_silent_gps_forbids_arming_as_soon_as_it_has_no_fix(seconds: float, result: int) -> None:
    """With a bad battery, too, both are told."""
    p = made("rover")
    p.until(2.5)
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    p.m.SIM_GPS1_ENABLE = 0
    p.until(p.time + seconds)
    texts(p)
    assert p.ask(ARM, 1) == result
    if result == FAILED:
        assert texts(p) == [(CRITICAL, "Arm: GPS 1: Bad fix")]
        p.m.BATT_ARM_VOLT = 13.0
        assert p.ask(ARM, 1) == FAILED
        said = ["Arm: GPS 1: Bad fix", "Arm: Battery 1 below minimum arming voltage"]
        assert texts(p) == [(CRITICAL, text) for text in said]
        assert p.ask(ARM, 1, 21196) == ACCEPTED


def test_returning_modes_are_not_armable() -> None:
    p = made("rover")
    p.until(2.5)
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    texts(p)
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: Mode not armable")]


def test_without_a_monitor_there_is_no_battery() -> None:
    p = started("rover", pilot={"BATT_MONITOR": 0, "SIM_BATT_VOLTAGE": 5.0})
    p.until(p.time + 12.0)
    assert not any("Battery" in text for _, text in texts(p))
    assert requested(p, mavlink.MAVLINK_MSG_ID_SYS_STATUS).voltage_battery == 65535
    assert requested(p, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS).battery_remaining == -1
    assert p.ask(RESET, 1, 100) == ACCEPTED  # as without a battery


def test_modes_that_need_no_position_go_on_and_disarming_ends_the_failsafe() -> None:
    p = on_its_way(0)
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED
    texts(p)
    p.m.SIM_GPS1_ENABLE = 0
    assert told(p) == [(CRITICAL, "EKF variance")]
    assert p.m.mode == MANUAL
    assert p.ask(ARM, 0) == ACCEPTED
    p.until(p.time + 0.2)
    assert texts(p) == [(6, "Throttle disarmed"), (CRITICAL, "EKF failsafe cleared")]
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: GPS 1: Bad fix")]
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p = on_its_way(0, FS_EKF_THRESH=0.0)
    p.m.SIM_GPS1_ENABLE = 0
    p.until(p.time + 10.0)
    assert texts(p) == [] and p.m.mode == GUIDED

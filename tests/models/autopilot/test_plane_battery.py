"""The battery of planes and quadplanes by ArduPlane's sources: alarms, their actions and texts, what arming needs."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_plane_pilot import high
from tests.models.autopilot.test_rover_battery import CRITICAL, RESET, requested, told
from tests.models.autopilot.test_rover_failsafes import INFO, WARNING, texts
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, made
from tests.models.autopilot.test_small_switches import flying
from tests.models.pair import ACCEPTED, FAILED, Pair

AUTO, RTL, GUIDED, QLAND, QRTL, LOITER_ALT_QLAND = 10, 11, 15, 20, 21, 25
SYS_STATUS, BATTERY_STATUS = mavlink.MAVLINK_MSG_ID_SYS_STATUS, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS
NO_LANDING = (WARNING, "Unable to start landing sequence")
TERMINATION = (INFO, "AFS not enabled, can't terminate the vehicle")
PARACHUTE = (CRITICAL, "Parachute: Released")
CHANGE_FAILED = (WARNING, "Flight mode change failed")


def in_the_air(kind: str, **values: float) -> Pair:
    """In GUIDED, with values given now."""
    p = high(GUIDED) if kind == "plane" else flying(kind)
    for name, value in values.items():
        p.m[name] = value
    texts(p)
    return p


@pytest.mark.parametrize(
    ("kind", "action", "mode", "more"),
    [
        ("plane", 0, GUIDED, []),
        ("plane", 1, RTL, []),
        ("plane", 2, RTL, [NO_LANDING]),
        ("plane", 3, GUIDED, [TERMINATION]),
        ("plane", 4, RTL, [NO_LANDING]),
        ("plane", 5, GUIDED, [PARACHUTE]),
        ("plane", 6, RTL, [NO_LANDING]),
        ("plane", 7, 26, []),
        ("quadplane", 1, RTL, []),
        ("quadplane", 2, RTL, [NO_LANDING]),
        ("quadplane", 4, QLAND, []),
        ("quadplane", 6, LOITER_ALT_QLAND, []),
    ],
)
def test_a_low_charge_acts_once(kind: str, action: int, mode: int, more: list[tuple[int, str]]) -> None:
    p = in_the_air(kind, BATT_FS_LOW_ACT=action, BATT_LOW_MAH=100.0, battery_used=3201.0)
    said = told(p)
    assert said[0][0] == WARNING and said[0][1].startswith("Battery 1 is low 12.")
    assert said[0][1].endswith((" 3201 mAh", " 3202 mAh"))
    assert [text for text in said[1:] if not text[1].startswith("Transition started")] == more
    assert p.m.mode == mode and p.m.armed
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    p.until(p.time + 3.0)
    assert p.m.mode == GUIDED
    assert not any("Battery" in text or "landing" in text for _, text in texts(p))


def test_a_low_voltage_acts_after_its_timer_and_is_critical_for_the_ground_station() -> None:
    p = in_the_air("plane", BATT_FS_LOW_ACT=1)
    began = p.time
    p.m.SIM_BATT_VOLTAGE = 10.4
    assert told(p)[0][1].startswith("Battery 1 is low 10.")
    assert p.time - began == pytest.approx(10.0, abs=0.25)  # BATT_LOW_TIMER
    assert p.m.mode == RTL
    p.until(p.time + 1.1)
    assert p.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
    assert not requested(p, SYS_STATUS).onboard_control_sensors_health & 0x2000000
    assert requested(p, BATTERY_STATUS).charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_LOW


@pytest.mark.parametrize(
    ("low", "critical", "modes"),
    [
        (1, 4, (RTL, QLAND)),
        (4, 1, (QLAND, QLAND)),
        (6, 1, (LOITER_ALT_QLAND,) * 2),
        (1, 6, (RTL, RTL)),
        (1, 1, (RTL, RTL)),
    ],
)
def test_of_a_second_alarm_a_less_urgent_action_does_not_act(low: int, critical: int, modes: tuple[int, int]) -> None:
    """QLAND is more urgent than RTL, and LOITER_ALT_QLAND less than all; RTL never ends a landing."""
    p = in_the_air("quadplane", BATT_FS_LOW_ACT=low, BATT_FS_CRT_ACT=critical, BATT_LOW_MAH=100.0, BATT_CRT_MAH=50.0)
    for used, word, mode in ((3201.0, "low", modes[0]), (3251.0, "critical", modes[1])):
        p.m.battery_used = used
        assert told(p)[0][1].startswith(f"Battery 1 is {word} 1")
        assert p.m.mode == mode
    assert requested(p, BATTERY_STATUS).charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL


def test_an_alarm_does_not_end_a_vertical_landing() -> None:
    for mode in (QLAND, QRTL):
        p = in_the_air("quadplane", BATT_FS_LOW_ACT=1, BATT_LOW_MAH=100.0)
        assert p.ask(SET_MODE, 1, mode) == ACCEPTED
        texts(p)
        p.m.battery_used = 3201.0
        assert any("is low" in text for _, text in told(p))
        assert p.m.mode == mode


def test_full_throttle_takes_50_amperes_and_0_7_volts() -> None:
    p = high(0)  # MANUAL
    p.hold(0.5, (1500, 1500, 2000, 1500), 0.25)
    used = float(p.m.battery_used)
    p.hold(3.6, (1500, 1500, 2000, 1500), 0.4)
    assert float(p.m.battery_used) - used == pytest.approx(50.0, abs=1.5)  # 50 A for 3.6 s: 50 mAh
    status = requested(p, SYS_STATUS)
    assert (status.voltage_battery, status.current_battery) == (11900, 5000)
    assert status.onboard_control_sensors_health & 0x2000000
    battery = requested(p, BATTERY_STATUS)
    assert (battery.voltages[0], battery.charge_state) == (11900, mavlink.MAV_BATTERY_CHARGE_STATE_OK)
    left = 100.0 * (1.0 - float(p.m.battery_used) / 3300.0)
    assert (battery.battery_remaining, status.battery_remaining) == (int(left), int(left))


def test_the_rotors_of_a_quadplane_drain_it_while_its_propeller_stands() -> None:
    p = in_the_air("quadplane")
    assert p.m.motor[2] == 0.0
    load = float(p.m.motor[4:8].mean())
    assert 0.3 < load < 0.9
    assert requested(p, SYS_STATUS).current_battery == pytest.approx(5000.0 * load, abs=100.0)
    assert requested(p, BATTERY_STATUS).voltages[0] == pytest.approx(12600.0 - 700.0 * load, abs=14.0)
    p.m.BATT_MONITOR = 0
    p.until(p.time + 0.2)
    p.heard.clear()
    assert p.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, BATTERY_STATUS) == ACCEPTED
    assert not any(m.get_msgId() == BATTERY_STATUS for m in p.heard)
    assert requested(p, SYS_STATUS).voltage_battery == 65535


@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_a_reset_takes_the_alarm_back(kind: str) -> None:
    p = in_the_air(kind, BATT_LOW_MAH=100.0, battery_used=3201.0)
    told(p)
    assert p.ask(RESET, 1, 101) == FAILED
    assert p.ask(RESET, 2, 100) == FAILED  # there is no second battery
    assert p.ask(RESET, 1, 100) == ACCEPTED
    assert (p.m.battery_alarm, p.m.battery_used) == (0, 0.0)
    p.until(p.time + 1.1)
    assert p.last("HEARTBEAT").system_status == mavlink.MAV_STATE_ACTIVE
    texts(p)
    p.m.battery_used = 3201.0
    assert told(p)[0][1].startswith("Battery 1 is low")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"BATT_ARM_VOLT": 12.7}, ["Battery 1 below minimum arming voltage"]),
        ({"BATT_ARM_MAH": 3301.0}, ["Battery 1 below minimum arming capacity"]),
        ({"SIM_BATT_VOLTAGE": 10.4}, ["Battery 1 low voltage failsafe"]),
        ({"BATT_LOW_MAH": 3301.0}, ["Battery 1 low capacity failsafe"]),
        ({"BATT_LOW_VOLT": 0.0, "BATT_CRT_VOLT": 12.7}, ["Battery 1 critical voltage failsafe"]),
        ({"BATT_CRT_MAH": 3301.0}, ["Battery 1 critical capacity failsafe"]),
        ({"BATT_LOW_MAH": 10.0, "BATT_CRT_MAH": 20.0}, ["Battery 1 capacity failsafe critical >= low"]),
        ({"BATT_LOW_VOLT": 9.0, "BATT_CRT_VOLT": 9.5}, ["Battery 1 voltage failsafe critical >= low"]),
        ({"FS_LONG_TIMEOUT": 1.0}, ["FS_LONG_TIMEOUT < FS_SHORT_TIMEOUT"]),
        (
            {"FS_LONG_TIMEOUT": 1.0, "BATT_ARM_VOLT": 12.7},
            ["Battery 1 below minimum arming voltage", "FS_LONG_TIMEOUT < FS_SHORT_TIMEOUT"],
        ),
        ({"FS_LONG_TIMEOUT": 1.0, "FS_SHORT_ACTN": 3}, []),
        ({"ROLL_LIMIT_DEG": 2.5}, ["ROLL_LIMIT_DEG too small (2.5)"]),
        (
            {"PTCH_LIM_MAX_DEG": 2.0, "PTCH_LIM_MIN_DEG": -1.0},
            ["PTCH_LIM_MAX_DEG too small (2.0)", "PTCH_LIM_MIN_DEG too large (-1.0)"],
        ),
        ({"AIRSPEED_MIN": 4.0}, ["AIRSPEED_MIN too low (4 < 5)"]),
        ({"BATT_MONITOR": 0, "SIM_BATT_VOLTAGE": 10.4}, []),
    ],
)
@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_what_arming_needs(kind: str, values: dict[str, float], said: list[str]) -> None:
    p = made(kind, pilot=values)
    p.until(2.5)
    texts(p)
    assert p.ask(ARM, 1) == (FAILED if said else ACCEPTED)
    assert [text for text in texts(p) if text[0] == CRITICAL] == [(CRITICAL, f"Arm: {text}") for text in said]
    assert p.ask(ARM, 1, 21196) == ACCEPTED


@pytest.mark.parametrize("lean", [9.0, 81.0])
def test_a_quadplane_has_to_lean(lean: float) -> None:
    p = made("quadplane", pilot={"Q_ANGLE_MAX": lean})
    p.until(2.5)
    texts(p)
    assert p.ask(ARM, 1) == FAILED
    assert texts(p) == [(CRITICAL, "Arm: Check Q_ANGLE_MAX")]
    assert p.ask(ARM, 1, 21196) == ACCEPTED


def test_landing_modes_are_not_armable() -> None:
    for mode, name in ((QLAND, "QLAND"), (QRTL, "QRTL")):
        p = made("quadplane")
        p.until(2.5)
        assert p.ask(SET_MODE, 1, mode) == ACCEPTED
        texts(p)
        assert p.ask(ARM, 1) == FAILED
        assert texts(p) == [(CRITICAL, f"Arm: {name} mode not armable")]

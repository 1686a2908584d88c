"""The battery: what it gives, what is told of it, and what happens when it runs low."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, FAILED, GUIDED, LAND, RTL, Copter

BRAKE, SMART_RTL = mavlink.COPTER_MODE_BRAKE, mavlink.COPTER_MODE_SMART_RTL


def texts(copter: Copter) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in copter.messages("STATUSTEXT")]


def battery(copter: Copter) -> tuple[Any, Any]:
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    copter.tick()
    (status,), (system,) = copter.messages("BATTERY_STATUS"), copter.messages("SYS_STATUS")
    return status, system


def test_on_the_ground_nothing_is_used() -> None:
    copter = Copter()
    copter.run(10.0)
    status, system = battery(copter)
    assert (status.current_consumed, status.energy_consumed, status.battery_remaining) == (0, 0, 100)
    assert (system.voltage_battery, system.current_battery, system.battery_remaining) == (12600, 0, 100)


def test_a_minute_of_hovering_takes_its_share() -> None:
    values = {"hover_current": 18.0, "BATT_CAPACITY": 1000.0, "MOT_THST_HOVER": 0.53}  # as this vehicle hovers
    copter = Copter(autopilot=values).in_the_air(5.0, 20.0)
    before, _ = battery(copter)
    copter.run(60.0)
    status, system = battery(copter)
    assert status.current_battery == pytest.approx(1800, rel=0.02)
    assert status.current_consumed - before.current_consumed == pytest.approx(300, abs=6)  # 18 A for 60 s
    assert (status.energy_consumed - before.energy_consumed) * 100 == pytest.approx(18.0 * 12.6 * 60.0, rel=0.02)
    assert system.battery_remaining == status.battery_remaining == 100 - -(-status.current_consumed // 10)
    assert status.voltages[0] == 12600  # without a capacity the voltage stays, as ArduPilot's does


def test_a_battery_of_a_capacity_runs_empty() -> None:
    values = {"hover_current": 20.0, "SIM_BATT_CAP_AH": 0.5, "battery_resistance": 0.03}
    copter = Copter(autopilot=values).in_the_air(5.0, 15.0)
    copter.run(45.0 - (copter.m["battery_used"] - 250.0) / 1e9)
    used = float(copter.m["battery_used"]) / 500.0
    # the curve of a cell, linear between the tenths of charge
    table = {0.4: 3.79, 0.5: 3.82, 0.6: 3.87, 0.7: 3.92, 0.8: 3.98, 0.2: 3.74, 0.3: 3.77}
    low = int((1.0 - used) * 10) / 10
    cell = table[low] + ((1.0 - used) - low) * 10 * (table[round(low + 0.1, 1)] - table[low])
    current = float(copter.m["battery_current"])
    assert float(copter.m["battery_voltage"]) == pytest.approx(3 * cell - 0.03 * current, abs=0.01)
    assert 3 * cell < 11.8


@pytest.mark.parametrize(
    ("action", "mode"), [(0, GUIDED), (1, LAND), (2, RTL), (3, SMART_RTL), (4, SMART_RTL), (7, BRAKE)]
)
def test_a_low_voltage_that_lasts(action: int, mode: int) -> None:
    values = {"BATT_LOW_VOLT": 10.5, "BATT_LOW_TIMER": 3.0, "BATT_FS_LOW_ACT": action}
    copter = Copter(autopilot=values).in_the_air(5.0, 12.0)
    copter.heard.clear()
    copter.m["SIM_BATT_VOLTAGE"] = 10.4
    copter.run(2.8)
    assert texts(copter) == []
    copter.run(0.6)
    used = round(float(copter.m["battery_used"]))
    (low, failsafe) = texts(copter)
    assert low[0] == failsafe[0] == 4
    assert failsafe[1] == "Battery Failsafe"
    assert low[1].startswith("Battery 1 is low 10.40V used ")
    assert low[1].endswith(" mAh")
    assert abs(int(low[1].split()[-2]) - used) <= 4
    assert copter.m["mode"] == mode
    status, system = battery(copter)
    assert status.charge_state == 2
    assert not system.onboard_control_sensors_health & 0x2000000
    copter.run(1.1)
    assert copter.messages("HEARTBEAT")[-1].system_status == 5
    copter.heard.clear()
    copter.run(5.0)
    assert texts(copter) == []  # once


def test_a_short_dip_does_not_count() -> None:
    copter = Copter(autopilot={"BATT_LOW_TIMER": 3.0, "BATT_FS_LOW_ACT": 1}).in_the_air(5.0, 10.0)
    copter.heard.clear()
    for _ in range(3):
        copter.m["SIM_BATT_VOLTAGE"] = 10.4
        copter.run(2.5)
        copter.m["SIM_BATT_VOLTAGE"] = 12.0
        copter.run(0.5)
    assert texts(copter) == []


def test_first_low_then_critical_by_charge() -> None:
    values = {"BATT_CAPACITY": 200.0, "BATT_LOW_MAH": 120.0, "BATT_CRT_MAH": 60.0, "BATT_FS_CRT_ACT": 1}
    copter = Copter(autopilot={**values, "hover_current": 20.0}).in_the_air(5.0, 10.0)
    copter.run(35.0)
    said = [text for _, text in texts(copter) if "attery" in text]
    assert [text.split(" used")[0] for text in said] == [
        "Battery 1 is low 12.60V",
        "Battery Failsafe",
        "Battery 1 is critical 12.60V",
        "Battery Failsafe",
    ]
    assert copter.m["mode"] == LAND
    assert battery(copter)[0].charge_state == 3


def test_a_landing_goes_on_and_the_ground_disarms() -> None:
    values = {"BATT_LOW_TIMER": 1.0, "BATT_FS_LOW_ACT": 2, "FS_OPTIONS": 8}
    copter = Copter(autopilot=values).in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LAND)
    copter.m["SIM_BATT_VOLTAGE"] = 10.4
    copter.run(1.5)
    assert texts(copter)[-1] == (4, "Battery Failsafe - Continuing Landing")
    assert copter.m["mode"] == LAND
    copter = Copter(autopilot=values)
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.m["SIM_BATT_VOLTAGE"] = 10.4
    copter.run(1.5)
    assert (4, "Battery Failsafe - Disarming") in texts(copter)
    assert not copter.m["armed"]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"BATT_ARM_VOLT": 12.7}, "Arm: Battery 1 below minimum arming voltage"),
        ({"BATT_ARM_MAH": 3301.0}, "Arm: Battery 1 below minimum arming capacity"),
    ],
)
def test_what_arming_needs(values: dict[str, float], text: str) -> None:
    copter = Copter(autopilot=values)
    copter.run(2.1)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ("ACK", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        ("TEXT", 2, text),
    ]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 2989)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )


@pytest.mark.parametrize(
    ("action", "mode", "told"),
    [
        (3, RTL, ["SmartRTL Unavailable, Trying RTL Mode"]),
        (4, LAND, ["SmartRTL Unavailable, Using Land Mode"]),
        (6, RTL, ["Unable to start landing sequence", "Trying RTL Mode"]),
    ],
)
def test_actions_that_are_not_possible(action: int, mode: int, told: list[str]) -> None:
    """Without a path to return along, and without a landing sequence."""
    values = {"BATT_LOW_TIMER": 1.0, "BATT_FS_LOW_ACT": action, "SRTL_POINTS": 0}
    copter = Copter(autopilot=values).in_the_air(5.0, 12.0)
    copter.heard.clear()
    copter.m["SIM_BATT_VOLTAGE"] = 10.0
    copter.run(1.5)
    assert copter.m["mode"] == mode
    assert [text for _, text in texts(copter)][2:] == told


def test_a_landing_that_a_failsafe_begins_waits_four_seconds() -> None:
    copter = Copter(autopilot={"BATT_LOW_TIMER": 1.0, "BATT_FS_LOW_ACT": 1}).in_the_air(5.0, 12.0)
    copter.m["SIM_BATT_VOLTAGE"] = 10.0
    copter.run(1.3)
    assert copter.m["mode"] == LAND
    flight = copter.run(3.5)
    assert abs(flight[-1, 3] - flight[0, 3]) < 0.1
    flight = copter.run(3.0)
    assert flight[-1, 6] == pytest.approx(0.5, abs=0.1)


def test_commands_rise_when_the_voltage_falls() -> None:
    """By ArduCopter's LiftMax: 0.9744 at 12.6 of 12.8 V, as its log has it; MOT_BAT_VOLT_MIN bounds it."""
    hover = float(Copter().in_the_air(5.0, 15.0).m["throttle_in"])
    copter = Copter(autopilot={"MOT_BAT_VOLT_MAX": 12.8, "MOT_BAT_VOLT_MIN": 9.6}).in_the_air(5.0, 15.0)
    assert float(copter.m["throttle_in"]) == pytest.approx(0.9744 * hover, rel=2e-3)
    copter.m["SIM_BATT_VOLTAGE"] = 9.0
    copter.run(12.0)
    assert float(copter.m["throttle_in"]) == pytest.approx(0.75 * (0.35 + 0.65 * 0.75) * hover, rel=5e-3)
    assert float(copter.v["position"][2]) == pytest.approx(-5.0, abs=0.05)
    copter.m["SIM_BATT_VOLTAGE"] = 2.0  # below a quarter of the least: not measured
    copter.run(12.0)
    assert float(copter.m["throttle_in"]) == pytest.approx(hover, rel=5e-3)

"""A battery that empties ends the flight of its drone, and the verdict says so."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.scenarios.flights import copy_of, fly


def with_power(text: str) -> str:
    """Puts a power system between autopilot and vehicle of a drone, and connects its voltage and current."""

    def connectors(name: str, kind: str, unit: str = "", count: int = 8) -> str:
        names = [f"{name}[{i}]" for i in range(1, count + 1)] if count > 1 else [name]
        return "".join(f'<ssd:Connector name="{one}" kind="{kind}"><ssc:Real{unit}/></ssd:Connector>' for one in names)

    def connections(*ends: str, count: int = 8) -> str:
        found = ""
        for i in range(1, count + 1):
            a, b, c, d = (one + (f"[{i}]" if count > 1 and k % 2 else "") for k, one in enumerate(ends))
            found += f'<ssd:Connection startElement="{a}" startConnector="{b}" endElement="{c}" endConnector="{d}"/>'
        return found

    speed, volt, ampere = ' unit="rad/s"', ' unit="V"', ' unit="A"'
    power = (
        '<ssd:Component name="power" type="application/x-fmu-sharedlibrary" source="../../../fmus/PowerSystem.fmu">'
        f"<ssd:Connectors>{connectors('command', 'input')}{connectors('rotor_speed', 'input', speed)}"
        f"{connectors('motor', 'output')}{connectors('voltage', 'output', volt, 1)}"
        f"{connectors('current', 'output', ampere, 1)}</ssd:Connectors></ssd:Component>"
    )
    supply = connectors("supply_voltage", "input", volt, 1) + connectors("supply_current", "input", ampere, 1)
    old = r'\s*<ssd:Connection startElement="autopilot" startConnector="motor\[\d\]"[^>]*/>'
    text, count = re.subn(old, "", text)
    assert count == 8
    new = (
        connections("autopilot", "motor", "power", "command")
        + connections("power", "motor", "vehicle", "motor")
        + connections("vehicle", "rotor_speed", "power", "rotor_speed")
        + connections("power", "voltage", "autopilot", "supply_voltage", count=1)
        + connections("power", "current", "autopilot", "supply_current", count=1)
    )
    text = text.replace("</ssd:Connections>", new + "</ssd:Connections>", 1)
    text = text.replace("</ssd:Elements>", power + "</ssd:Elements>", 1)
    first, vehicle, rest = text.partition('source="../../../fmus/Quadrotor.fmu">')
    rest = rest.replace("<ssd:Connectors>", "<ssd:Connectors>" + connectors("rotor_speed", "output", speed), 1)
    text = first + vehicle + rest
    first, autopilot, rest = text.partition('source="../../../fmus/Autopilot.fmu">')
    rest = rest.replace("<ssd:Connectors>", "<ssd:Connectors>" + supply, 1)
    units = (
        '<ssc:Unit name="V"><ssc:BaseUnit kg="1" m="2" s="-3" A="-1"/></ssc:Unit>'
        '<ssc:Unit name="A"><ssc:BaseUnit A="1"/></ssc:Unit>'
    )
    return (first + autopilot + rest).replace("</ssd:Units>", units + "</ssd:Units>", 1)


@pytest.fixture(scope="module")
def powered(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = copy_of("line5", tmp_path_factory.mktemp("powered"), fmus)
    drone = folder / "drone.ssd"
    drone.write_text(with_power(drone.read_text(encoding="utf-8")), encoding="utf-8")
    return folder


def test_an_empty_battery_ends_the_flight(powered: Path, tmp_path: Path) -> None:
    """Drone 3 has charge for some seconds: cut off, it falls; the others have enough and fly on."""
    flight = fly(powered, tmp_path / "out", until=25.0, overrides={"drone3.power.capacity": "0.05"})
    charge, height = flight["drone3.power.charge"], flight.up(3)
    empty = int((charge == 0.0).argmax())
    assert charge[empty] == 0.0 and height[:empty].max() > 2.0
    assert height[-1] < 0.5 and not flight["drone3.vehicle.rotor_speed[1]"][-1] > 1.0
    assert flight["drone3.power.voltage"][-1] == 0.0
    assert flight.up(2)[-1] == pytest.approx(10.0, abs=0.2)
    assert flight["drone2.power.charge"][-1] > 0.9
    found = [one.text for one in flight.result.verdict.findings if "drone3.power" in one.who]
    assert any("its battery is empty" in text for text in found), flight.result.verdict.findings


def test_the_batterys_failsafe_lands_a_drone(powered: Path, tmp_path: Path) -> None:
    """The voltage under load is below BATT_LOW_VOLT for BATT_LOW_TIMER: the autopilot lands before motors stop."""
    values = {"power.charge_start": "0.12", "power.capacity": "1", "autopilot.BATT_LOW_VOLT": "10.9"}
    values |= {"autopilot.BATT_LOW_TIMER": "1", "autopilot.BATT_FS_LOW_ACT": "1"}
    overrides = {f"drone3.{name}": value for name, value in values.items()}
    flight = fly(powered, tmp_path / "out", until=25.0, overrides=overrides)
    assert (flight["drone3.autopilot.mode"] == 9).any()  # LAND
    assert flight["drone3.power.charge"][-1] > 0.0
    assert flight.up(3).max() > 0.5 and flight.up(3)[-1] < flight.up(3).max()

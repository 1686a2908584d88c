"""Values on their way between FMUs of others: Booleans become numbers, start values the unit of a connector."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.fmus.linear import signals

NOTE = "connections join a Boolean to a number: true is 1, false 0; the first: "


def test_a_boolean_drives_a_real_and_an_integer(foreigners: Any, tmp_path: Path) -> None:
    """As the valve of a water tank: `on` is true after every odd step."""
    foreigners.fmu()
    parts = foreigners.component("ctrl", step=0.25) + foreigners.component("tank", step=0.25)
    result = simulate(
        foreigners.ssd(parts, "ctrl/on tank/u", "ctrl/on tank/i", stop=2.0), RunOptions(out=tmp_path / "out")
    )
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert list(got["ctrl.on"]) == [False, True] * 4 + [False]
    assert list(got["tank.x"]) == [0.0, 0.0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1.0]
    assert list(got["tank.j"]) == [0, 0, 1, 0, 1, 0, 1, 0, 1]
    assert next(note for note in result.notes if NOTE in note).startswith(f"2 {NOTE}")


@pytest.mark.parametrize("master", ['algorithm="gauss-seidel"', '><connection to="tank.u" delay="0.25" start="1"/'])
def test_under_other_masters(foreigners: Any, tmp_path: Path, master: str) -> None:
    foreigners.fmu()
    parts = foreigners.component("ctrl", step=0.25) + foreigners.component("tank", step=0.25)
    head, _, inner = master.partition(">")
    element = f'<master xmlns="https://uav-cosim.org/ns/1" {head}>{inner + ">" if inner else ""}</master>'
    annotation = f'<ssc:Annotation type="org.uav-cosim.master">{element}</ssc:Annotation>'
    system = foreigners.ssd(parts, "ctrl/on tank/u", stop=1.0, annotations=annotation)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert list(signals(tmp_path / "out")["tank.x"]) == [0.0, 0.25, 0.25, 0.5, 0.5]


def test_through_a_connector_of_the_system(foreigners: Any, tmp_path: Path) -> None:
    """A Boolean parameter of the system drives a Real input; scaled by a transformation of the connection inside."""
    foreigners.fmu()
    shop = foreigners.workshop
    scaled = "<ssc:LinearTransformation factor='3' offset='1'/>"
    inner = shop.system(
        foreigners.component("tank", step=0.25),
        shop.connection("valve", "tank/u", scaled),
        name="plant",
        connectors="valve:input:Boolean",
    )
    parts = foreigners.component("ctrl", step=0.25) + inner
    result = simulate(foreigners.ssd(parts, "ctrl/on plant/valve"), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert list(signals(tmp_path / "out")["plant.tank.x"]) == [0.0, 0.25, 1.25, 1.5, 2.5]
    started = shop.bindings({"plant.valve": True})
    system = shop.ssd("b.ssd", shop.system(inner, bindings=started), '<ssd:DefaultExperiment stopTime="1"/>')
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    assert list(signals(tmp_path / "out")["plant.tank.x"]) == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("wire", "text"),
    [
        ("a/y b/i", "a.y is Real and b.i is Integer"),
        ("a/y b/b", "a.y is Real and b.b is Boolean"),
        ("a/n b/b", "a.n is Integer and b.b is Boolean"),
    ],
)
def test_conversions_that_lose_values_are_refused(foreigners: Any, wire: str, text: str) -> None:
    foreigners.fmu()
    system = foreigners.ssd(foreigners.component("a", step=1) + foreigners.component("b", step=1), wire)
    with pytest.raises(SystemDescriptionError, match=f"{text}; types must be equal"):
        simulate(system)


@pytest.mark.parametrize(("own", "connector", "expected"), [(None, "m", 3000.0), ("cm", "", 300000.0), (None, "", 3.0)])
def test_a_start_value_has_the_unit_of_the_connector_where_the_fmu_has_none(
    foreigners: Any, own: str | None, connector: str, expected: float
) -> None:
    """3 km into a connector of m, as a connection from km would give it."""
    foreigners.fmu(unit=own)
    shop = foreigners.workshop
    kind = f":Real:{connector}" if connector else ""
    component = shop.component("a", "foreign.fmu", f"p:parameter{kind} y:output", shop.bindings({"p": 3.0}, unit="km"))
    experiment = f'{shop.units("m", "km", "cm")}<ssd:DefaultExperiment stopTime="1"/>'
    text = shop.ssd("u.ssd", shop.system(component), experiment)
    content = text.read_text().replace("</ssv:ParameterSet>", UNITS + "</ssv:ParameterSet>")
    text.write_text(content)
    with read_system(text) as structure:
        (instance,) = check(structure).instances
    assert instance.start_values["p"] == expected


UNITS = '<ssv:Units><ssc:Unit name="km"><ssc:BaseUnit m="1" factor="1000"/></ssc:Unit></ssv:Units>'

"""The annotation org.uav-cosim.monitors: settings, problems with their lines, and what a run makes of them."""

from __future__ import annotations

from typing import Any

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.preparation.prepare import Prepared, prepare
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.annotation import NAMESPACE
from cosim_master.verdict.monitors.declared import (
    Age,
    Convergence,
    Fence,
    FormulaMonitor,
    Limit,
    Order,
    Separation,
    Signal,
    monitored,
)
from tests.master.system.settings.test_network import PACKETS
from tests.master.verdict.test_verdict import verdict_tool


@pytest.fixture
def prepared(workshop: Any, variable: Any) -> Any:
    """Prepares three drones, each a vehicle and an agent, with these monitors."""
    vectors = [variable(f"position[{i}]", "output", unit="m") for i in (1, 2, 3)]
    vectors += [variable(f"velocity[{i}]", "output") for i in (1, 2, 3)]
    vectors += [variable(f"attitude[{i}]", "output") for i in (1, 2, 3, 4)]
    workshop.fmu("vehicle.fmu", *vectors, step="0.01", extra=verdict_tool('<Position variable="position"/>'))
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu("agent.fmu", *ports, variable("target", "output", unit="m"), step="0.01", extra=PACKETS)

    def run(content: str, attributes: str = "", more: str = "") -> Prepared:
        inner = workshop.component("vehicle", "vehicle.fmu") + workshop.component("agent", "agent.fmu")
        drones = "".join(workshop.system(inner, name=f"drone{i}") for i in (1, 2, 3))
        monitors = f'<monitors xmlns="{NAMESPACE}" {attributes}>{content}</monitors>'
        annotations = workshop.annotation("org.uav-cosim.monitors", monitors)
        annotations = annotations.replace("</ssd:Annotations>", f"{more}</ssd:Annotations>")
        path = workshop.ssd("s.ssd", workshop.system(drones, after=annotations))
        end = '<ssd:DefaultExperiment stopTime="10"/></ssd:SystemStr'
        path.write_text(path.read_text().replace("</ssd:SystemStr", end))
        with read_system(path) as structure:
            return prepare(check(structure))

    return run


def position(n: int) -> Signal:
    name = f"drone{n}.vehicle"
    return Signal(name, tuple((name, f"position[{i}]") for i in (1, 2, 3)), "m")


def test_settings(prepared: Any) -> None:
    found = prepared(
        '<order vehicles="drone1 drone3.vehicle" axis="3 4 0" least="1" name="line" severity="warning"/>'
        '<separation least="2" end="true" start="1" stop="9"/>'
        '<limit signals="drone*.agent.target" most="5"/>'
        '<limit signals="drone2.vehicle.attitude" quantity="tilt" least="0.1" most="0.6"/>'
        '<fence polygon="0 0 0 9 9 9" floor="1" vehicles="drone2"/>'
        '<fence radius="5" north="1" east="2" ceiling="30"/>'
        '<convergence signals="drone3.agent.target drone1.agent.target" goal="50 10" amplitude="40" time="15"/>'
        '<age from="drone1" to="drone*" most="2"/>'
        '<formula text="time > 1 -> v &lt; 2 and x > 0"><signal name="v" of="*.velocity" quantity="magnitude"/>'
        '<signal name="x" of="drone1.vehicle.position[1]"/></formula>'
    ).monitors
    line, far, target, tilt, shape, circle, envelope, age, formula = found.every
    assert line == Order(
        "line", "order", "warning", vehicles=(position(1), position(3)), axis=(0.6, 0.8, 0.0), least=1.0
    )
    everybody = tuple(map(position, (1, 2, 3)))
    assert far == Separation("separation", "separation", "failure", True, 1.0, 9.0, everybody, 2.0)
    targets = [Signal(f"drone{i}.agent.target", ((f"drone{i}.agent", "target"),), "m") for i in (1, 2, 3)]
    assert target == Limit("limit", "limit", signals=tuple(targets), most=5.0)
    elements = tuple(("drone2.vehicle", f"attitude[{i}]") for i in (1, 2, 3, 4))
    leaning = Signal("drone2.vehicle.attitude", elements, "rad", "tilt")
    assert tilt == Limit("limit 2", "limit", signals=(leaning,), least=0.1, most=0.6)
    assert shape == Fence("fence", "fence", vehicles=(position(2),), polygon=((0, 0), (0, 9), (9, 9)), floor=1.0)
    assert circle == Fence("fence 2", "fence", vehicles=everybody, centre=(1.0, 2.0), radius=5.0, ceiling=30.0)
    assert envelope == Convergence(
        "convergence", "convergence", start=0.0, signals=(targets[2], targets[0]), goals=(50.0, 10.0), amplitude=40.0,
        time=15.0,
    )  # fmt: skip
    assert age == Age("age", "age", pairs=((0, 1), (0, 2)), nodes=("drone1", "drone2", "drone3"), most=2.0)
    assert isinstance(formula, FormulaMonitor)
    assert [text for text, _ in formula.formula.conjuncts] == ["time > 1 -> v < 2 and x > 0"]
    assert [(name, [one.name for one in of]) for name, of in formula.signals.items()] == [
        ("v", [f"drone{i}.vehicle.velocity" for i in (1, 2, 3)]),
        ("x", ["drone1.vehicle.position[1]"]),
    ]
    assert found.interval is None and len(monitored(found)) == 9 + 3 + 4 + 9
    assert prepared('<separation least="1"/>', 'interval="0.5"').monitors.interval == 0.5


def test_a_system_without_monitors_has_none(prepared: Any) -> None:
    with pytest.raises(
        SystemDescriptionError, match=r"s.ssd:\d+: <monitors> has no monitors: valid are order, separat"
    ):
        prepared("")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ('<ordr/>', "<ordr> is unknown here: valid are order, separation, limit, fence, convergence, age, formula"),
        ('<order vehicels="*"/>', "attribute vehicels: valid are axis, end, least, name, severity, start"),
        ('<order vehicels="*"/>', 'stop, vehicles; did you mean vehicles?'),
        ('<order vehicles="dron1"/>', 'vehicles: "dron1" matches no FMU with a position; did you mean "drone*"?'),
        ('<order vehicles="drone1"/>', "it needs at least 2 vehicles and has 1 (drone1.vehicle)"),
        ('<order axis="0 0 0"/>', 'axis="0 0 0" must be three numbers, a vector in NED, not all zero'),
        ('<order severity="error"/>', 'severity="error": valid are failure, warning'),
        ('<order end="yes"/>', 'end="yes": valid are false, true'),
        ('<order start="5" stop="4"/>', 'stop="4" is before start="5"'),
        ('<order start="soon"/>', 'start="soon" must be a number from -1e+09 to 1e+09'),
        ("<separation/>", "it needs the attribute least"),
        ('<separation least="-1"/>', 'least="-1" must be a number from 0 to 1e+09'),
        ('<limit signals="drone*.agent.target"/>', "it needs the attribute least or most"),
        ('<limit most="1"/>', "it needs the attribute signals"),
        ('<limit signals="drone1.agent.tarjet" most="1"/>', 'signals: "drone1.agent.tarjet" matches no output or local '
         'variable; did you mean "drone*.agent.target"?'),
        ('<limit signals="drone1.agent.target" quantity="magnitude" most="1"/>', "no array of reals; valid: "),
        ('<limit signals="*.velocity" quantity="tilt" most="1"/>', "velocity has 3 elements: the tilt is"),
        ('<limit signals="*.target" quantity="norm" most="1"/>', 'quantity="norm": valid are value, magnitude, tilt'),
        ('<limit signals="*.target" least="2" most="1"/>', 'least="2" is greater than most="1"'),
        ('<limit signals="*.attitude" quantity="tilt" most="30"/>', 'most="30" is more than any tilt, which is in rad '
         "and at most pi; 30 degrees are 0.5236"),
        ("<fence/>", "it needs a polygon, a radius, a floor or a ceiling"),
        ('<fence polygon="0 0 1 1"/>', "polygon has 4 numbers: it needs north and east of at least three corners"),
        ('<fence polygon="0 0 1 1 a"/>', 'polygon="0 0 1 1 a" must be numbers, separated by spaces'),
        ('<fence polygon="0 0 1 1 0 1" radius="2"/>', "a fence is a polygon or a circle: leave out"),
        ('<fence north="2" ceiling="3"/>', "north and east are the centre of a circle: it needs a radius"),
        ('<fence floor="3" ceiling="2"/>', 'floor="3" is above ceiling="2"'),
        ('<convergence signals="*.target" goal="1 2" amplitude="1" time="1"/>', "goal has 2 numbers: it needs one"),
        ('<convergence signals="*.target" goal="1" amplitude="1" time="0"/>', 'time="0" must be a number from'),
        ('<convergence signals="*.target" goal="1" time="1"/>', "it needs the attribute amplitude"),
        ('<age from="done1" most="1"/>', 'from: "done1" matches no node of the network; did you mean "drone*"?'),
        ('<age from="drone1" to="drone1" most="1"/>', "no node of `from` reaches another node of `to`"),
        ("<age/>", "it needs the attribute most"),
        ('<formula text="x > "><signal name="x" of="*.target"/></formula>', "the end of the formula: a signal"),
        ('<formula text="x > 1"><signal name="y" of="*.target"/></formula>',
         'the formula uses "x", and no <signal> has this name; valid: "time", "y"'),
        ('<formula text="time > 1"><signal name="y" of="*.target"/></formula>', '<signal name="y"> is not used'),
        ('<formula text="x > 1"><signal name="time" of="*.target"/></formula>', 'name="time" must be a word'),
        ('<formula text="x > y"><signal name="x" of="*.target"/><signal name="y" of="*e[1] drone1.*[2]"/></formula>',
         "its signals must be equally many, or one: x matches 3, y matches 6"),
        ('<formula text="once[0.001,0.002] time > 1"/>', "once[0.001,0.002] contains no communication point: they"),
        ('<order name="a"/><separation name="a" least="1"/>', '2 monitors have the name "a": give each'),
        ('<order><x/></order>', "<x> is unknown here: valid are no elements"),
    ],
)  # fmt: skip
def test_problems(prepared: Any, content: str, problem: str) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        prepared(content)
    assert problem in str(caught.value)
    assert all(one.where.path.endswith("s.ssd") and one.where.line for one in caught.value.problems)


def test_all_problems_are_reported_at_once(prepared: Any) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        prepared('<separation/>\n<fence/>\n<limit signals="x" most="1"/>', 'interval="0.015"')
    lines = [one.where.line for one in caught.value.problems]
    assert len(lines) == 4 and len({*lines}) == 3  # the first monitor is on the line of <monitors>
    assert 'interval="0.015" is not a multiple of the base step, 0.01 s' in str(caught.value)


def test_links_of_a_listed_topology(prepared: Any) -> None:
    network = (
        '<ssc:Annotation type="org.uav-cosim.network">'
        f'<network xmlns="{NAMESPACE}" topology="listed"><link from="drone1" to="drone2"/></network></ssc:Annotation>'
    )
    (age,) = prepared('<age from="*" to="*" most="1"/>', more=network).monitors.every
    assert age.pairs == ((0, 1),)
    with pytest.raises(SystemDescriptionError, match="drone3 cannot hear drone1: the network has no <link>"):
        prepared('<age from="drone1" to="drone3" most="1"/>', more=network)


def test_monitors_that_judge_nothing_are_noted(prepared: Any) -> None:
    content = '<separation least="1" start="11"/><formula text="eventually[0,8] time > 2" start="3"/>'
    content += '<formula text="eventually[0,8] time > 2" start="2"/>'
    assert prepared(content).notes[-2:] == (
        "monitor separation judges nothing: it starts at 11 s, and the run stops at 10 s",
        "monitor formula judges nothing: it starts at 3 s and looks 8 s ahead, and the run stops at 10 s",
    )


@pytest.mark.parametrize(
    ("monitor", "interval", "every"),
    [
        ('<limit signals="*.target" most="5" start="1" stop="4"/>', 'interval="5"', 5.0),
        ('<fence radius="5" start="5.5" stop="9.5"/>', 'interval="5"', 5.0),
        ('<convergence signals="*.target" goal="5" amplitude="4" time="1" start="11.001" stop="11.009"/>', "", 0.0),
        ('<limit signals="*.target" most="5" start="1.001" stop="1.009"/>', "", 0.01),
        ('<formula text="time > 2" start="3" stop="3"/>', 'interval="0.07"', 0.07),
    ],
)
def test_monitors_between_whose_times_no_instant_lies_are_noted(
    prepared: Any, monitor: str, interval: str, every: float
) -> None:
    (note,) = [one for one in prepared(monitor, interval).notes if "judges nothing" in str(one)]
    text = f"no instant lies between its start and stop; they come every {every:g} s from 0 s on"
    assert note.endswith(text if every else "it starts at 11.001 s, and the run stops at 10 s")


def test_monitors_that_judge_one_instant_are_not_noted(prepared: Any) -> None:
    content = '<limit signals="*.target" most="5" start="5" stop="5"/><limit signals="*.target" most="5" stop="0"/>'
    content += '<limit signals="*.target" most="5" start="4.5"/><separation least="1" start="1" stop="2"/>'
    content += '<formula text="time > 2" start="10" stop="10"/>'
    assert not [one for one in prepared(content, 'interval="5"').notes if "judges nothing" in str(one)]

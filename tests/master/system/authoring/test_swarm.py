"""Swarms built in Python: they are SSP and nothing else, read back as they were meant, and fly."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim.build import build, load_models
from cosim_master import RunOptions, Swarm, check, read_system, signals, simulate
from cosim_master.diagnostics.errors import SystemDescriptionError, WriteFailed
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.system.authoring.swarm.scenario import _ways, scenario_of
from cosim_master.system.authoring.text.difference import difference
from cosim_master.system.settings.network import network_of
from cosim_master.system.structure import Component, System
from cosim_master.verdict.monitors.declared import Fence

pytestmark = pytest.mark.usefixtures("fmus")


def test_ten_lines_that_fly(tmp_path: Path) -> None:
    swarm = Swarm("three", stop_time=60.0)
    swarm.add("west", position=(0.0, 0.0), stays=True)
    swarm.add("middle", position=(0.0, 10.0), vehicle="Hexarotor")
    swarm.add("east", position=(0.0, 40.0), stays=True)
    swarm.connect("west", "middle")
    swarm.connect("middle", "east")
    assert swarm.save(tmp_path / "three") == tmp_path / "three"
    result = simulate(swarm, RunOptions(out=tmp_path / "out", record=["*.vehicle.position*"]))
    assert result.outcome == "done"
    assert result.verdict is not None and result.verdict.good
    table = signals(tmp_path / "out")
    last = {name: table[f"{name}.vehicle.position[2]"][-1].as_py() for name in ("west", "middle", "east")}
    assert last == pytest.approx({"west": 0.0, "middle": 20.0, "east": 40.0}, abs=0.3)
    assert sorted(file.name for file in (tmp_path / "three").iterdir()) == [
        "SystemStructure.ssd",
        "drone-Hexarotor.ssd",
        "drone.ssd",
        "drones.ssv",
    ]


def same(wanted: System, found: System) -> None:
    """Both say the same, and so do the systems inside of their components."""
    assert difference(wanted, found, "the system") is None
    for one, other in zip(wanted.elements, found.elements, strict=True):
        assert isinstance(one, Component) and isinstance(other, Component)
        assert one.source is not None and other.source is not None
        if one.content is None or other.content is None:
            assert one.content is other.content and one.source.resolve() == other.source.resolve()
        else:
            assert one.source.name == other.source.name
            same(one.content, other.content)


_NAMES = st.from_regex(r"[A-Za-zäß_][A-Za-z0-9_ &<-]{0,7}", fullmatch=True)
_LENGTH = st.floats(-1e6, 1e6, allow_nan=False)
_VALUES = st.fixed_dictionaries(
    {},
    optional={
        "agent.altitude": st.floats(0.0, 1e4),
        "agent.trigger": st.sampled_from(["period", "arrival", 1]),
        "agent.position_rate": st.integers(1, 50),
        "vehicle.inertia": st.tuples(*[st.floats(1e-3, 1.0)] * 3),
        "vehicle.wind": st.tuples(*[st.floats(-9.0, 9.0)] * 3),
    },
)
_DRONES = st.tuples(
    _NAMES,
    st.one_of(st.just(()), st.tuples(_LENGTH, _LENGTH), st.tuples(_LENGTH, _LENGTH, _LENGTH)),
    st.booleans(),
    _VALUES,
    st.sampled_from([{}, {"vehicle": "Hexarotor"}, {"vehicle": "Quadrotor"}]),
    st.none() | st.integers(1, 255),
)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(_DRONES, min_size=1, max_size=5, unique_by=lambda one: one[0]), st.data())
def test_what_is_saved_reads_back_equal(tmp_path: Path, drones: list[Any], data: st.DataObject) -> None:
    network = data.draw(st.sampled_from([None, {"loss": 0.25}, {"topology": "broadcast", "range": 300}]))
    swarm = Swarm(data.draw(_NAMES), network=network, stop_time=data.draw(st.none() | st.floats(1.0, 1e4)))
    for name, position, stays, values, parts, number in drones:
        swarm.add(name, position=position, stays=stays, values=values, system_id=number, **parts)
    names = data.draw(st.permutations(swarm.members))
    for one, other in list(itertools.pairwise(names))[: data.draw(st.integers(0, 4))]:
        swarm.connect(one, other)
    if len(names) > 1 and data.draw(st.booleans()):
        swarm.connect(f"{names[0]}.vehicle.velocity", f"{names[1]}.vehicle.wind")
    folder = tmp_path / str(len([*tmp_path.iterdir()]))
    swarm.save(folder)
    with read_system(swarm) as structure:
        assert not structure.problems
        same(swarm.system, structure.system)
        assert structure.name == swarm.name


def test_neighbours_ids_and_places_are_set_where_the_fmus_declare_them(tmp_path: Path) -> None:
    swarm = Swarm("pair")
    assert swarm.add(position=(1.0, 2.0), stays=True) == "drone1"
    assert swarm.add(position=(1.0, 9.0, -0.5), system_id=77) == "drone2"
    assert swarm.add(position=(1.0, 12.0)) == "drone3"
    swarm.connect("drone1", "drone2")
    with read_system(swarm.save(tmp_path / "pair")) as structure:
        checked = check(structure)
        network = network_of(checked)
    starts = {one.name: one.start_values for one in checked.instances}
    assert [starts[f"drone{n}.vehicle"].get("position_start[3]") for n in (1, 2)] == [None, -0.5]
    agents = [starts[f"drone{n}.agent"] for n in (1, 2, 3)]
    assert [(a["sysid"], a["left_sysid"], a["right_sysid"], a["stubborn"]) for a in agents] == [
        (1, 0, 77, True),
        (77, 1, 0, False),
        (3, 0, 0, False),
    ]
    assert starts["drone2.autopilot"]["SYSID_THISMAV"] == 77
    assert network.topology == "listed" and network.links == {("drone1", "drone2"), ("drone2", "drone1")}
    assert (network.latency, network.seed) == (0.02, 1)


def test_ports_of_members_are_connected_element_by_element(tmp_path: Path) -> None:
    """Out of one drone's system and into another's; and to an FMU of the root."""
    swarm = Swarm("wired", network={"topology": "broadcast"})
    swarm.add("a", position=(0.0, 0.0))
    swarm.add("b", position=(0.0, 9.0))
    swarm.add("probe", fmu="Hexarotor", position=(50.0, 0.0), values={"mass": 2.0})
    swarm.connect("b.vehicle.wind", "a.vehicle.velocity")
    swarm.connect("a.vehicle.velocity", "probe.wind")
    with read_system(swarm.save(tmp_path / "wired")) as structure:
        checked = check(structure)
    links = {(link.source, link.target) for link in checked.links}
    for i in (1, 2, 3):
        assert (("a.vehicle", f"velocity[{i}]"), ("b.vehicle", f"wind[{i}]")) in links
        assert (("a.vehicle", f"velocity[{i}]"), ("probe", f"wind[{i}]")) in links
    (probe,) = [one for one in checked.instances if one.name == "probe"]
    assert probe.start_values["mass"] == 2.0 and probe.start_values["position_start[1]"] == 50.0
    assert sorted(file.name for file in (tmp_path / "wired").glob("*.ssd")) == [
        "SystemStructure.ssd",
        "drone-2.ssd",
        "drone.ssd",
    ]


def test_a_swarm_is_the_pattern_of_another(tmp_path: Path) -> None:
    """What all drones have in common is kept, also what tells them apart by their ids; the rest is told."""
    first = Swarm("first", like="line5-estimated", network={"loss": 0.125}, stop_time=33.0)
    for n in (1, 2, 3):
        own = {"vehicle.mass": 1.0 + n * n, "vehicle.linear_drag": 0.5 * n}
        first.add(position=(0.0, 9.0 * n), values={"agent.altitude": 20.0, **own})
    assert first.notes == ()
    first.connect("drone1", "drone2")
    first.connect("drone2", "drone3")
    first.save(tmp_path / "first")
    second = Swarm("second", like=tmp_path / "first")
    for n in range(5):
        second.add(f"d{n}", position=(0.0, 9.0 * n))
    second.connect("d0", "d1")
    assert second.notes == (
        f"{tmp_path / 'first'}: its drones differ in vehicle.mass: the new ones have what their FMUs start with",
        f"{tmp_path / 'first'}: vehicle.linear_drag goes on rising by 0.5 from drone to drone",
    )
    with read_system(second.save(tmp_path / "second")) as structure:
        assert structure.stop_time == 33.0
        checked = check(structure)
        network = network_of(checked)
    starts = {one.name: one.start_values for one in checked.instances}
    assert [starts[f"d{n}.agent"]["altitude"] for n in range(5)] == [20.0] * 5
    assert [starts[f"d{n}.estimator"]["identity"] for n in range(5)] == [1, 2, 3, 4, 5]
    assert "mass" not in starts["d0.vehicle"]
    assert [starts[f"d{n}.vehicle"]["linear_drag"] for n in range(5)] == [0.5, 1.0, 1.5, 2.0, 2.5]
    assert network.loss == 0.125 and network.links == {("d0", "d1"), ("d1", "d0")}
    links = {(link.source, link.target) for link in checked.links}
    assert (("d4.estimator", "position[1]"), ("d4.autopilot", "position[1]")) in links


def test_monitors_are_written_and_read_back(tmp_path: Path) -> None:
    swarm = Swarm("three", stop_time=20.0)
    for n in range(3):
        swarm.add(position=(0.0, 20.0 * n))
    swarm.monitor("separation", least=2, end=True)
    swarm.monitor("fence", polygon=((-5, -5), (-5, 50.5), (5, 50)), vehicles=["drone1", "drone2"])
    swarm.monitor("limit", signals=["drone1.agent.target", "drone2.agent.target"], most=float("1e3"))
    swarm.monitor("age", from_="drone1", to="drone2", most=1.5, severity="warning")
    swarm.monitor(
        "formula",
        text="x > 0 -> v < 5",
        signals={"x": "*.agent.target", "v": {"of": "*.vehicle.velocity", "quantity": "magnitude"}},
    )
    swarm.save(tmp_path / "three")
    with read_system(tmp_path / "three") as structure:
        same(swarm.system, structure.system)
        monitors = prepare(check(structure)).monitors.every
    assert [(one.name, one.ends, one.severity) for one in monitors] == [
        ("separation", True, "failure"),
        ("fence", False, "failure"),
        ("limit", False, "failure"),
        ("age", False, "warning"),
        ("formula", False, "failure"),
    ]
    assert isinstance(monitors[1], Fence) and monitors[1].polygon == ((-5.0, -5.0), (-5.0, 50.5), (5.0, 50.0))
    again = Swarm("again", like=tmp_path / "three", stop_time=20.0)
    again.add(position=(0.0, 0.0))
    again.add(position=(0.0, 20.0))
    again.monitor("order", least=1)
    again.save(tmp_path / "again")
    with read_system(tmp_path / "again") as structure:
        kinds = [one.kind for one in prepare(check(structure)).monitors.every]
    assert kinds == ["separation", "fence", "limit", "age", "formula", "order"]
    again.monitor("ordr")
    again.save(tmp_path / "wrong")
    with pytest.raises(SystemDescriptionError, match="<ordr> is unknown here: valid are order"):
        simulate(again)


def test_a_part_more_is_wired_by_the_names_of_its_ports(tmp_path: Path) -> None:
    swarm = Swarm("more", network={"topology": "broadcast"})
    swarm.add("a", shadow="Hexarotor")
    with read_system(swarm.save(tmp_path / "more")) as structure:
        links = {(link.source, link.target) for link in check(structure).links}
    assert {(("a.autopilot", f"motor[{i}]"), ("a.shadow", f"motor[{i}]")) for i in range(1, 9)} < links
    told = (("a.shadow", "adds_wind"), ("a.autopilot", "adds_wind"))  # line5 does not connect these
    assert {link for link in links if link[0][0] == "a.shadow"} == {told}


def refused(swarm: Swarm, *what: Any, **more: Any) -> str:
    verb, *arguments = what
    with pytest.raises(SystemDescriptionError) as caught:
        getattr(swarm, verb)(*arguments, **more)
    return str(caught.value)


def test_mistakes_are_named(tmp_path: Path) -> None:
    swarm = Swarm("wrong")
    assert refused(swarm, "__fspath__") == "wrong: is not saved as it is: call save(FOLDER) first"
    assert refused(swarm, "save", tmp_path / "new") == "wrong: has no drones: add() them"
    swarm.add("a", position=(0.0, 0.0), stays=True)
    assert refused(swarm, "add", "a") == "a: is in this swarm already: give each drone a name of its own"
    assert refused(swarm, "add", "a.b") == "a.b: is not a name of a component: names have no dots"
    assert "give (north, east) or (north, east, down) in m" in refused(swarm, "add", "b", position=(1.0,))
    assert 'did you mean "Quadrotor"?' in refused(swarm, "add", "b", vehicle="Quadrotr")
    assert refused(swarm, "add", "b", fmu="Hexarotor", agent="x") == "b: is one FMU: it has no parts (agent)"
    wrong = refused(swarm, "add", "b", fmu="Estimator", position=(0.0, 0.0))
    assert wrong == "b: has a position: Estimator.fmu must declare one StartPosition (docs/verdict.md)"
    assert "cannot be told to stay: Hexarotor.fmu must declare a Formation" in refused(
        swarm, "add", "b", fmu="Hexarotor", stays=True
    )
    swarm.add("b", position=(0.0, 5.0))
    swarm.add("c", position=(0.0, 9.0))
    swarm.connect("a", "b")
    assert refused(swarm, "connect", "a", "c") == "a: has an eastern neighbour already: b"
    assert refused(swarm, "connect", "b", "a") == "b, a: are one drone, or connected already"
    assert refused(swarm, "connect", "a", "d") == 'd: there is no d in this swarm; valid: "a", "b", "c"'
    assert "connect two drones, or two ports" in refused(swarm, "connect", "a", "b.vehicle.wind")
    assert "its parts are" in refused(swarm, "connect", "a.wind", "b.vehicle.wind")
    wrong = refused(swarm, "connect", "a.vehicle.positio", "b.vehicle.wind")
    assert wrong == 'a.vehicle.positio: there is no input or output positio; did you mean "position"?'
    wrong = refused(swarm, "connect", "a.vehicle.position", "b.vehicle.velocity")
    assert "are output and output with 3 and 3 elements" in wrong
    swarm.connect("a.vehicle.position", "b.vehicle.wind")
    assert "vehicle_wind[1]: is driven already" in refused(swarm, "connect", "c.vehicle.velocity", "b.vehicle.wind")
    wrong = refused(swarm, "save", tmp_path / "units")
    assert f"{tmp_path / 'units' / 'SystemStructure.ssd'}:" in wrong and 'unit "m" (m) cannot be converted' in wrong
    assert [*tmp_path.iterdir()] == []
    (tmp_path / "there").mkdir()
    assert refused(swarm, "save", tmp_path / "there") == f"{tmp_path / 'there'}: exists already"
    swarm, place = Swarm("pair", like="rendezvous"), tmp_path / "file" / "pair"
    swarm.add(position=(0.0, 0.0))
    place.parent.write_text("")
    with pytest.raises(WriteFailed, match=f"^{place}: cannot be written: Not a directory$"):
        swarm.save(place)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"agent.altitud": 1.0}, 'agent.altitud: LineAgent.fmu has no altitud; did you mean "altitude"?'),
        ({"pilot.x": 1.0}, "pilot.x: there is no part 'pilot'; did you mean \"autopilot\"?"),
        ({"altitude": 1.0}, "altitude: write PART.altitude"),
        ({"agent.altitude": "high"}, "agent.altitude: valid: a number"),
        ({"agent.stale_policy": "shout"}, "agent.stale_policy: its enumeration has no such item; valid:"),
        ({"vehicle.inertia": 0.1}, "vehicle.inertia: has 3 elements: give as many values, not 0.1"),
        ({"agent.stubborn": True}, "a.agent.stubborn: is set by position, system_id, stays or connect()"),
        ({"autopilot.SYSID_THISMAV": 4}, "a.autopilot.SYSID_THISMAV: is set by position, system_id"),
    ],
)
def test_values_that_do_not_fit(values: dict[str, Any], message: str) -> None:
    assert refused(Swarm(), "add", "a", values=values).startswith(message)


def test_a_change_must_be_saved_before_it_is_flown(tmp_path: Path) -> None:
    swarm = Swarm("changed", network={"topology": "broadcast"})
    swarm.add()
    swarm.save(tmp_path / "one")
    swarm.add()
    with pytest.raises(SystemDescriptionError, match="is not saved as it is"):
        simulate(swarm)


def test_systems_that_are_no_patterns(tmp_path: Path, workshop: Any, variable: Any) -> None:
    workshop.fmu("f.fmu", variable("y", "output"))
    single = workshop.ssd("s.ssd", workshop.system(workshop.component("alone", "f.fmu")))
    with pytest.raises(SystemDescriptionError, match="has no drones, systems made of FMUs, so that"):
        scenario_of(single)
    swarm = Swarm("mixed", network={"topology": "broadcast"})
    swarm.add()
    swarm.add("field", fmu="Hexarotor")
    swarm.save(tmp_path / "mixed")
    with pytest.raises(
        SystemDescriptionError, match=r"has parts beside its drones \(field\) that are not connected as"
    ):
        Swarm(like=tmp_path / "mixed")
    wired = Swarm("wired", network={"topology": "broadcast"})
    wired.add()
    wired.add()
    wired.connect("drone1.vehicle.velocity", "drone2.vehicle.wind")
    wired.save(tmp_path / "wired")
    with pytest.raises(SystemDescriptionError, match='"drone1" is not the pattern of a drone'):
        Swarm(like=tmp_path / "wired")


def test_a_listed_topology_needs_links(tmp_path: Path) -> None:
    swarm = Swarm("deaf", network={"topology": "listed"})
    swarm.add()
    assert "no two drones are connected: connect() them" in refused(swarm, "save", tmp_path / "deaf")


@pytest.mark.parametrize(
    ("links", "drones", "expected"),
    [
        ("ab bc cd", 5, "ab bc cd de"),  # a chain
        ("ab bc cd da", 5, "ab bc cd de ea"),  # a ring
        ("ab bc cd de ea", 3, "ab bc ca"),
        ("ab ac bc bd cd", 5, "ab ac bc bd cd ce de"),  # the next two
        ("ab ac ad", 5, None),  # a star: the drones are not alike
        ("ab", 5, None),  # with four drones, of which two have no link
    ],
)
def test_links_that_are_alike_for_all_drones_go_on(links: str, drones: int, expected: str | None) -> None:
    few = "abcd" if "e" not in links else "abcde"
    ways = _ways([{"between": " ".join(link)} for link in links.split()], few)
    if expected is None:
        assert ways is None
        return
    assert ways is not None
    found = {frozenset("abcde"[i] for i in pair) for pair in ways.between(drones)}
    assert found == {frozenset(pair) for pair in expected.split()}


def test_links_that_describe_or_go_one_way_are_left_out(tmp_path: Path) -> None:
    assert _ways([{"between": "a b", "loss": "0.5"}], "ab") is None
    assert _ways([{"from": "a", "to": "b"}], "ab") is None
    assert _ways([], "ab") is None


def test_a_ring_of_any_size_meets(tmp_path: Path) -> None:
    """The system `rendezvous`: heights that rise, and links of a ring."""
    swarm = Swarm("meeting", like="rendezvous")
    for n in range(7):
        swarm.add(position=(10.0 * n, 3.0 * n * n))
    assert any("agent.altitude goes on rising by 2" in note for note in swarm.notes)
    with read_system(swarm.save(tmp_path / "meeting")) as structure:
        checked = check(structure)
        network = network_of(checked)
    starts = {one.name: one.start_values for one in checked.instances}
    assert [starts[f"drone{n}.agent"]["altitude"] for n in range(1, 8)] == [10.0 + 2.0 * n for n in range(7)]
    ring = {(f"drone{n}", f"drone{n % 7 + 1}") for n in range(1, 8)}
    assert network.links == ring | {(b, a) for a, b in ring}


def test_numbers_and_arrays_of_numpy_are_taken(tmp_path: Path) -> None:
    true: Any = np.True_
    swarm = Swarm(
        "numbers",
        stop_time=np.float32(4.0),  # type: ignore[arg-type]
        network={"seed": np.int64(3), "relays": ["drone1", "drone2"], "hops": 4, "topology": "broadcast"},
    )
    values = {"agent.altitude": np.float64(12.0), "vehicle.wind": np.array([1.0, 2.0, 3.0])}
    swarm.add(position=np.array([0.0, 5.0]), stays=true, values=values)
    swarm.add(position=(0, 20), system_id=np.int64(9), values={"agent.altitude": np.array(7.5)})  # type: ignore[arg-type]
    swarm.environment("Airspace", values={"mean_wind": np.array((4.0, 0, 0)), "downwash": true})
    square = np.array([(-9, -9), (-9, 50), (9, 50), (9, -9)])
    swarm.monitor("fence", polygon=square, ceiling=np.float64(15.0), end=true, vehicles=["drone1", "drone2"])
    with read_system(swarm.save(tmp_path / "numbers")) as structure:
        checked = check(structure)
        prepared = prepare(checked)
    starts = {one.name: one.start_values for one in checked.instances}
    assert starts["drone1.agent"]["altitude"] == 12.0
    assert [starts["drone1.vehicle"][f"wind[{n}]"] for n in (1, 2, 3)] == [1.0, 2.0, 3.0]
    assert starts["drone1.vehicle"]["position_start[2]"] == 5.0
    assert swarm._members["drone1"].stays is True
    assert starts["drone2.agent"]["sysid"] == 9
    assert starts["drone2.agent"]["altitude"] == 7.5
    assert [starts["environment"][f"mean_wind[{n}]"] for n in (1, 2, 3)] == [4.0, 0.0, 0.0]
    assert starts["environment"]["downwash"] is True
    assert prepared.network.seed == 3
    text = (tmp_path / "numbers" / "SystemStructure.ssd").read_text(encoding="utf-8")
    assert 'relays="drone1 drone2"' in text and 'end="true"' in text
    assert 'polygon="-9 -9 -9 50 9 50 9 -9"' in text


def test_sequences_are_attributes_of_the_network(tmp_path: Path) -> None:
    swarm = Swarm("axis", network={"topology": "nearest", "axis": (0, 1.5, 0), "seed": 2})
    swarm.add(position=(0.0, 0.0), stays=True)
    swarm.save(tmp_path / "axis")
    assert 'axis="0 1.5 0"' in (tmp_path / "axis" / "SystemStructure.ssd").read_text(encoding="utf-8")
    assert Swarm("flag", network={"rayleigh": True})._network["rayleigh"] == "true"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"position": 30.0}, "drone1: is placed at 30.0: give (north, east) or (north, east, down) in m"),
        ({"position": "30"}, "drone1: is placed at '30': give (north, east) or (north, east, down) in m"),
        (
            {"position": (0.0, float("nan"))},
            "drone1: is placed at (0.0, nan): give (north, east) or (north, east, down) in m",
        ),
        ({"system_id": "7"}, "drone1: has the system id '7': give a whole number from 1 to 255"),
        ({"system_id": 1.5}, "drone1: has the system id 1.5: give a whole number from 1 to 255"),
        ({"vehicle": 5}, "5: is neither a file nor the name of a model, but int; give one of these"),
        (
            {"values": {"vehicle.wind": np.array([1.0, 2.0])}},
            "vehicle.wind: has 3 elements: give as many values, not array([1., 2.])",
        ),
        ({"values": {"agent.altitude": np.True_}}, "agent.altitude: valid: a number"),
        ({"values": {"agent.altitude": None}}, "agent.altitude: valid: a number"),
    ],
)
def test_wrong_kinds_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        Swarm("wrong").add(**wrong)
    assert str(caught.value) == message


def test_wrong_kinds_of_attributes_are_refused() -> None:
    with pytest.raises(SystemDescriptionError, match=r"loss: is None; give a number, a text, or a sequence of these"):
        Swarm("wrong", network={"loss": None})
    with pytest.raises(SystemDescriptionError, match=r"separation: least: is \{\}; give a number"):
        Swarm("wrong").monitor("separation", least={})
    stop_time: Any = []
    with pytest.raises(SystemDescriptionError, match=r"stop_time: is \[\]; give a number in s"):
        Swarm("wrong", stop_time=stop_time)


@pytest.mark.parametrize(("typo", "part"), [("agnt", "agent"), ("vehcle", "vehicle"), ("Vehicle", "vehicle")])
def test_a_part_whose_name_is_close_to_that_of_another_is_a_slip(typo: str, part: str) -> None:
    given: dict[str, Any] = {typo: "Hexarotor"}
    text = f'drone1: has no part {typo}; did you mean "{part}"? If it is to be a new part, give it another name'
    with pytest.raises(SystemDescriptionError) as caught:
        Swarm("slip").add(position=(0.0, 0.0), **given)
    assert str(caught.value) == text


def test_a_new_part_has_any_other_name_or_a_number() -> None:
    swarm = Swarm("parts")
    swarm.add(follower="LineAgent")
    swarm.add(agent2="LineAgent")
    parts = [[*one.parts] for one in swarm._members.values()]
    assert parts == [["agent", "autopilot", "vehicle", new] for new in ("follower", "agent2")]


def test_parts_of_one_drone_are_connected_inside_its_description(tmp_path: Path) -> None:
    """Instead of what the template connects; drones with equal connections share a description."""
    swarm = Swarm("sensing", network={"topology": "broadcast"})
    for name in ("a", "b", "c"):
        swarm.add(name, shadow="Hexarotor")
    for name in ("a", "b"):
        swarm.connect(f"{name}.vehicle.velocity", f"{name}.shadow.wind")
        swarm.connect(f"{name}.autopilot.position", f"{name}.shadow.position")
    with read_system(swarm.save(tmp_path / "sensing")) as structure:
        same(swarm.system, structure.system)
        checked = check(structure)
    assert sorted(one.name for one in (tmp_path / "sensing").glob("*.ssd")) == [
        *("SystemStructure.ssd", "drone-2.ssd", "drone.ssd"),
    ]
    assert not checked.unmatched
    sources = {link.target: link.source for link in checked.links}
    for i in (1, 2, 3):
        for name in ("a", "b"):
            assert sources[f"{name}.shadow", f"wind[{i}]"] == (f"{name}.vehicle", f"velocity[{i}]")
            assert sources[f"{name}.autopilot", f"position[{i}]"] == (f"{name}.shadow", f"position[{i}]")
        assert ("c.shadow", f"wind[{i}]") not in sources
        assert sources["c.autopilot", f"position[{i}]"] == ("c.vehicle", f"position[{i}]")


def test_mistakes_inside_a_drone_are_named() -> None:
    swarm = Swarm("inside", network={"topology": "broadcast"})
    swarm.add("a", shadow="Hexarotor")
    swarm.add("b")
    wrong = refused(swarm, "connect", "a.vehicle.velocity", "a.shadow.position")
    text = "are output and output with 3 and 3 elements: connect an output with an input"
    assert wrong == f"a.vehicle.velocity[1], a.shadow.position[1]: {text}"
    wrong = refused(swarm, "connect", "a.shadow.wind", "a.autopilot.motor")
    text = "are output and input with 8 and 3 elements: connect ports with equal numbers of elements"
    assert wrong == f"a.autopilot.motor[1], a.shadow.wind[1]: {text}"
    wrong = refused(swarm, "connect", "a.vehicle.velocity", "a.vehicle.wind")
    assert wrong == "a.vehicle: is one FMU: connect it with another"
    swarm.connect("a.vehicle.velocity", "a.shadow.wind")
    driven = "is driven already: an input has one connection"
    assert refused(swarm, "connect", "a.vehicle.velocity", "a.shadow.wind") == f"a.shadow.wind[1]: {driven}"
    assert refused(swarm, "connect", "b.vehicle.velocity", "a.shadow.wind") == f"a.shadow_wind[1]: {driven}"
    swarm.connect("b.vehicle.velocity", "a.vehicle.wind")
    assert refused(swarm, "connect", "a.shadow.velocity", "a.vehicle.wind") == f"a.vehicle.wind[1]: {driven}"


def test_an_own_environment_as_printed_leaves_room_for_more_drones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """docs/environment.md: what it has for more drones than there are is meant to stay open; the drones are lifted."""
    page = (Path(__file__).parents[4] / "docs" / "environment.md").read_text(encoding="utf-8")
    section = page.split("## Your own environment\n")[1].split("\n## ")[0]
    (model_file, text), (_, program) = re.findall(r"^```python(?: file=(\S+))?\n(.*?)^```$", section, re.M | re.S)
    monkeypatch.chdir(tmp_path)
    Path(model_file).write_text(text, encoding="utf-8")
    (model,) = load_models(model_file)
    build(model, tmp_path / "fmus")
    exec(compile(program, "environment.md", "exec"), {})
    result = simulate("lifted", RunOptions(out=tmp_path / "out", record=("environment.*",), strict=True, until=5.0))
    assert result.verdict is not None and [one.text for one in result.verdict.findings] == []
    winds = signals(tmp_path / "out").to_pydict()
    outside = 2.0 * math.exp(-4.0)  # 10 m beside the centre, twice its extent
    down = [winds[f"environment.wind[{3 * n}]"][-1] for n in range(1, 17)]
    assert down[:3] == pytest.approx([-outside, -2.0, -outside], rel=0.05) and down[3:] == [0.0] * 13


def test_attributes_of_network_and_monitors_are_checked_before_a_run(tmp_path: Path) -> None:
    """Not by `save`, which knows SSP and FMUs alone."""
    swarm = Swarm("slips", network={"los": 0.1})
    swarm.add(position=(0.0, 0.0), stays=True)
    swarm.monitor("separaton", least=2.0)
    folder = swarm.save(tmp_path / "slips")
    with read_system(folder) as structure, pytest.raises(SystemDescriptionError) as caught:
        prepare(check(structure))
    said = str(caught.value)
    assert "attribute los: valid are" in said and "<separaton> is unknown here" in said

"""Satellite navigation in a jammed area: parameters of the FMUs that declare such an area, from the annotation."""

from __future__ import annotations

from typing import Any

import pytest

from cosim_master.cli.views.explanation import explain
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.preparation.prepare import Prepared, prepare
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.system.settings.test_network import PACKETS, TYPE, network
from tests.master.verdict.test_verdict import verdict_tool

DECLARED = (
    '<JammedRadius variable="r"/><JammedNorth variable="n"/><JammedEast variable="e"/>'
    '<JammedFrom variable="begin"/><JammedUntil variable="end"/>'
)
NAMES = ("r", "n", "e", "begin", "end")


@pytest.fixture
def prepared(workshop: Any, variable: Any) -> Any:
    """Prepares two drones of a vehicle, an agent and a receiver whose area has other names than the shipped one."""
    position = [variable(f"position[{i}]", "output", unit="m") for i in (1, 2, 3)]
    workshop.fmu("vehicle.fmu", *position, step="0.01", extra=verdict_tool('<Position variable="position"/>'))
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu("agent.fmu", *ports, step="0.01", extra=PACKETS)
    own = [variable(name, "parameter", unit="s" if len(name) > 1 else "m") for name in NAMES]
    workshop.fmu("receiver.fmu", *own, step="0.01", extra=verdict_tool(DECLARED))

    def run(inner: str, receiver: bool = True, values: str = "") -> Prepared:
        parts = workshop.component("vehicle", "vehicle.fmu") + workshop.component("agent", "agent.fmu")
        if receiver:
            parts += workshop.component("gps", "receiver.fmu", bindings=values)
        drones = "".join(workshop.system(parts, name=f"drone{i}") for i in (1, 2))
        path = workshop.ssd("s.ssd", workshop.system(drones, after=workshop.annotation(TYPE, network("", inner))))
        text = path.read_text().replace("</ssd:SystemStr", '<ssd:DefaultExperiment stopTime="1"/></ssd:SystemStr')
        path.write_text(text)
        return prepare(check(read_system(path)))

    return run


def values(ready: Prepared, name: str) -> list[Any]:
    (found,) = (one for one in ready.checked.instances if one.name == name)
    return [found.effective_values()[name] for name in NAMES]


def problems(run: Any, *arguments: Any, **options: Any) -> list[str]:
    with pytest.raises(SystemDescriptionError) as caught:
        run(*arguments, **options)
    return [str(problem) for problem in caught.value.problems]


def test_one_element_jams_radio_and_gps(prepared: Any) -> None:
    """The radio's area stays the same with and without it."""
    ready = prepared('<jamming north="5" east="-7" radius="20" start="3" stop="9" gps="true"/><jamming radius="1"/>')
    for drone in ("drone1", "drone2"):
        assert values(ready, f"{drone}.gps") == [20.0, 5.0, -7.0, 3.0, 9.0]
    (made,) = ready.checked.assignments["drone2.gps", "e"]
    assert (made.value, made.text) == (-7.0, '-7 of <jamming gps="true">')
    assert any("start value 20.0 m, set by" in line for line in explain(ready.checked, "drone1.gps.r"))
    both = [(one.north, one.east, one.radius, one.start, one.stop) for one in ready.network.jamming]
    assert both[0] == (5.0, -7.0, 20.0, 3.0, 9.0)
    plain = prepared('<jamming north="5" east="-7" radius="20" start="3" stop="9"/><jamming radius="1"/>')
    assert [(one.north, one.east, one.radius, one.start, one.stop) for one in plain.network.jamming] == both
    assert values(plain, "drone1.gps") == [0.0] * 5
    endless = prepared('<jamming radius="20" gps="true"/>')
    assert values(endless, "drone1.gps")[4] == 1e9


def test_what_cannot_be_jammed_is_an_error(prepared: Any, workshop: Any) -> None:
    twice = '<jamming radius="20" gps="true"/><jamming radius="2" gps="true"/>'
    assert any('2 elements <jamming> have gps="true"' in text for text in problems(prepared, twice))
    one = '<jamming radius="20" gps="true"/>'
    (text,) = problems(prepared, one, receiver=False)
    assert "no FMU has satellite navigation that can be jammed; leave gps out" in text
    (text,) = problems(prepared, '<jamming radius="20" gps="yes"/>')
    assert "gps" in text and "yes" in text
    found = problems(prepared, one, values=workshop.bindings({"n": 4.0}))
    assert [text.partition(": ")[2] for text in found] == [
        f'drone{i}.gps.n is set by <jamming gps="true"> and by the system itself; keep one of them' for i in (1, 2)
    ]

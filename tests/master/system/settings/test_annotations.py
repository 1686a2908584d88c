"""docs/annotations.md against the readers: every element and attribute, the defaults, and the examples."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.preparation.prepare import Prepared, prepare
from cosim_master.system.flatten.check import ANNOTATION_TYPES, check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.annotation import NAMESPACE
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.recording import Recording
from cosim_master.verdict.watching.limits import Limits
from tests.master.system.settings.test_network import PACKETS
from tests.master.verdict.test_verdict import verdict_tool

TEXT = (Path(__file__).parents[4] / "docs" / "annotations.md").read_text(encoding="utf-8")
ELEMENTS = {
    "network": "<network {}/>",
    "link": '<network><link from="drone1" to="*" {}/></network>',
    "outage": '<network><outage node="drone1" {}/></network>',
    "partition": '<network><partition nodes="drone1" {}/></network>',
    "jamming": '<network><jamming radius="1" {}/></network>',
    "box": '<network sensitivity="-90"><box length="1" width="1" height="1" loss="1" {}/></network>',
    "cylinder": '<network sensitivity="-90"><cylinder radius="1" height="1" loss="1" {}/></network>',
    "recording": "<recording {}/>",
    "stepping": '<stepping stepSize="0.01" {}/>',
    "solver": '<solver name="rk4" {}/>',
    "isolation": '<isolation process="file" {}/>',
    "master": "<master {}/>",
    "verdict": "<verdict {}/>",
    "monitors": "<monitors {}/>",
    "order": "<monitors><order {}/></monitors>",
    "separation": "<monitors><separation {}/></monitors>",
    "limit": "<monitors><limit {}/></monitors>",
    "fence": "<monitors><fence {}/></monitors>",
    "convergence": "<monitors><convergence {}/></monitors>",
    "age": "<monitors><age {}/></monitors>",
    "formula": "<monitors><formula {}/></monitors>",
    "signal": "<monitors><formula><signal {}/></formula></monitors>",
    "constraint": '<master algorithm="var-step"><constraint type="fmumaxstepsize" {}/></master>',
    "port": '<master algorithm="var-step"><constraint type="boundeddifference"><port {}/></constraint></master>',
    "connection": '<master><connection to="drone1.agent.u" {}/></master>',
}


def tables() -> dict[str, dict[str, str]]:
    """Default by attribute, by element."""
    found: dict[str, dict[str, str]] = {}
    for part in re.split(r"^### `<", TEXT, flags=re.M)[1:]:
        rows = [line.strip("|").split("|") for line in part.splitlines() if line.startswith("| `")]
        found[part.partition(">")[0]] = {row[0].strip(" `"): row[2].strip(" `") for row in rows}
    return found


@pytest.fixture
def prepared(workshop: Any, variable: Any) -> Any:
    """Prepares three drones with the given annotation: a vehicle with motor and position, and an agent."""
    position = [variable(f"position[{i}]", "output", unit="m") for i in (1, 2, 3)]
    workshop.fmu(
        "vehicle.fmu", *position, variable("motor[1]"), variable("y", "output"), step="0.0125",
        extra=verdict_tool('<Position variable="position"/>'),
    )  # fmt: skip
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu(
        "agent.fmu", *ports, variable("u"), variable("target", "output"), variable("z", "output"), step="0.0125",
        extra=PACKETS,
    )  # fmt: skip

    def run(content: str) -> Prepared:
        tag = re.match(r"<(\w+)", content)
        assert tag is not None
        content = content.replace(tag[0], f'{tag[0]} xmlns="{NAMESPACE}"', 1) if "xmlns" not in content else content
        inner = workshop.component("vehicle", "vehicle.fmu", "motor[1]:input y:output")
        inner += workshop.component("agent", "agent.fmu", "u:input z:output")
        wires = workshop.connection("vehicle/y", "agent/u") + workshop.connection("agent/z", "vehicle/motor[1]")
        drones = "".join(workshop.system(inner, wires, name=f"drone{i}") for i in (1, 2, 3))
        annotation = workshop.annotation(f"org.uav-cosim.{tag[1]}", content)
        path = workshop.ssd("s.ssd", workshop.system(drones, after=annotation))
        path.write_text(
            path.read_text().replace("</ssd:SystemStr", '<ssd:DefaultExperiment stopTime="1"/></ssd:SystemStr')
        )
        return prepare(check(read_system(path)))

    return run


def test_every_annotation_has_its_section() -> None:
    assert {
        f"org.uav-cosim.{name}"
        for name in re.findall(
            r"^## (network|recording|stepping|solver|isolation|master|verdict|monitors)$", TEXT, re.M
        )
    } == {*ANNOTATION_TYPES}
    assert set(re.findall(r"`(org\.uav-cosim\.\w+)`", TEXT)) == set(ANNOTATION_TYPES)
    assert tables().keys() == ELEMENTS.keys()


@pytest.mark.parametrize("element", ELEMENTS)
def test_attributes_are_those_that_are_read(prepared: Any, element: str) -> None:
    """An unknown attribute is refused with the list of those that the reader knows."""
    with pytest.raises(SystemDescriptionError) as caught:
        prepared(ELEMENTS[element].format('unheardOf="1"'))
    (text,) = (str(problem) for problem in caught.value.problems if "unheardOf" in str(problem))
    valid = set(re.findall(r"\w+", text.partition("valid")[2])) - {"are"}
    assert valid == tables()[element].keys()


def test_defaults() -> None:
    network = Network()
    for name, default in tables()["network"].items():
        field = re.sub("[A-Z]", lambda capital: f"_{capital[0].lower()}", name)
        value: Any = getattr(network, field, "")  # others are files and paths
        value = str(value).lower() if isinstance(value, bool) else value
        shown = {math.inf: "INF", -math.inf: "-INF", None: "", (): ""}.get(value, value)
        assert (
            name in ("position", "dialect", "trace", "channel")
            or (f"{shown:g}" if isinstance(shown, float) else str(shown)) == default
        )
    assert tables()["recording"]["packets"] == str(Recording().packets).lower()
    settings = MasterSettings()
    master = tables()["master"]
    assert (master["algorithm"], int(master["iterations"].partition(";")[0])) == (
        settings.algorithm,
        settings.iterations,
    )
    assert float(master["tolerance"].partition(";")[0]) == settings.tolerance
    assert float(master["relaxation"]) == settings.relaxation
    assert {name: float(value) for name, value in tables()["verdict"].items()} == asdict(Limits())


def test_examples_are_valid(prepared: Any) -> None:
    examples = [
        content.strip() for content in re.findall(r"```xml\n(.*?)```", TEXT, re.S) if not content.startswith("<ssd:")
    ]
    assert len(examples) == 14
    for content in examples:
        prepared(content)
    (inside,) = re.findall(r"<ssc:Annotation .*?>\n(.*?)</ssc:Annotation>", TEXT, re.S)
    assert prepared(inside.strip()).network.topology == "nearest"
    lossy = prepared(examples[0]).network
    assert [(c.source, c.target, c.loss, c.latency) for c in lossy.channels] == [
        ("drone3", "*", 0.3, None),
        ("drone1", "drone2", None, 0.2),
        ("drone2", "drone1", None, 0.2),
    ]

"""Validation against the official schemas: what only they know, on which line, and for which version."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.ssp import schema
from cosim_master.system.reading.ssp.schema import schema_folder, validate

SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"


@pytest.mark.parametrize("version", [1, 2])
def test_the_schemas_are_installed_and_complete(version: int) -> None:
    names = {path.name for path in schema_folder(version).glob("SystemStructure*.xsd")}
    for kind in ("Description", "Common", "ParameterValues", "ParameterMapping", "SignalDictionary"):
        assert f"SystemStructure{kind}.xsd" in names


def test_loading_them_opens_no_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    schema._schema.cache_clear()
    root = etree.fromstring(f'<ParameterSet xmlns="{SSV}" version="1.0" name="x"><Parameters/></ParameterSet>')
    assert validate(root, 1, "x.ssv", []) == []


def test_every_version_has_its_own_schema() -> None:
    text = f'<ParameterSet xmlns="{SSV}" version="2.0" name="x"><Parameters><Parameter name="a">'
    root = etree.fromstring(text + '\n<Int8 value="1"/></Parameter></Parameters></ParameterSet>')
    assert validate(root, 2, "x.ssv", []) == []
    found = [problem.message for problem in validate(root, 1, "x.ssv", [])]
    assert any("Int8" in message for message in found)


def test_what_is_known_on_a_line_is_not_said_twice() -> None:
    root = etree.fromstring(
        f'<ParameterSet xmlns="{SSV}" version="1.0">\n<Parameters><oops/></Parameters>\n</ParameterSet>'
    )
    assert [problem.where for problem in validate(root, 1, "x", [])] == [Where("x", 1), Where("x", 2)]
    (left,) = validate(root, 1, "x", [Problem(Where("x", 1), "no name"), Problem(Where("y", 2), "elsewhere")])
    assert left.where == Where("x", 2) and "oops" in left.message and "http" not in left.message


@pytest.mark.parametrize(
    ("after", "message"),
    [
        ('<ssd:ElementGeometry x1="0" y1="0" x2="wide" y2="1"/>', "'wide' is not a valid value"),
        ('<ssd:ElementGeometry x1="0" y1="0" x2="1" y2="1" colour="red"/>', "'colour' is not allowed"),
    ],
)
def test_only_the_schema_knows(workshop: Any, after: str, message: str) -> None:
    workshop.fmu("unit.fmu")
    path = workshop.ssd("s.ssd", workshop.system(workshop.component("a", "unit.fmu", after=after)))
    (problem,) = read_system(path).problems
    assert message in problem.message and problem.where.line == 6


def test_external_and_inline_sets_are_validated(workshop: Any) -> None:
    workshop.fmu("unit.fmu")
    text = workshop.parameter_set({"a.p": 1.0}).replace('name="set"', 'name="set" generationDateAndTime="yesterday"')
    Path(workshop.root / "p.ssv").write_text(text)
    inline = workshop.bindings({"a.p": 1.0}).replace('name="set"', 'name="set" generationDateAndTime="today"')
    bindings = inline.replace(
        "<ssd:ParameterBindings>", '<ssd:ParameterBindings><ssd:ParameterBinding source="p.ssv"/>'
    )
    path = workshop.ssd("s.ssd", workshop.system(workshop.component("a", "unit.fmu"), bindings=bindings))
    found = [str(problem) for problem in read_system(path).problems]
    assert len(found) == 2
    assert any("p.ssv:1: against the schema" in text and "'yesterday' is not a valid value" in text for text in found)
    assert any("s.ssd:4: against the schema" in text and "'today' is not a valid value" in text for text in found)

"""Reading SSP files: what is read, and that everything else is reported with file and line.

Oracles: FMPy's reader for the structure of SSP 1.0, and the official XML schemas that FMPy ships for what is legal.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy.ssp
import pytest
from fmpy.ssp import ssd as fmpy_ssd
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.files import archive
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import SSD_TYPE, SSP_TYPE, read_system
from cosim_master.system.structure import Component, LinearTransformation, System, SystemStructure

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"

COMPLETE = """<?xml version="1.0" encoding="UTF-8"?>
<a:SystemStructureDescription xmlns:a="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:c="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="a b"
    version="1.0" name="complete" author="me" generationTool="by hand" id="top" description="everything">
  <a:System name="root">
    <a:Connectors>
      <a:Connector name="wind" kind="input"><c:Real unit="km/h"/><a:ConnectorGeometry x="0" y="0.5"/></a:Connector>
      <a:Connector name="mode" kind="output"><c:Enumeration name="Mode"/></a:Connector>
    </a:Connectors>
    <a:ElementGeometry x1="0" y1="0" x2="1" y2="1"/>
    <a:ParameterBindings>
      <a:ParameterBinding source="values/set%201.ssv" prefix="plant."/>
      <a:ParameterBinding>
        <a:ParameterValues>
          <ParameterSet version="1.0" name="inline">
            <Parameters>
              <Parameter name="plant.mass"><Real value="1.5" unit="kg"/></Parameter>
              <Parameter name="plant.count"><Integer value="-3"/></Parameter>
              <Parameter name="plant.on"><Boolean value="true"/></Parameter>
              <Parameter name="plant.text"><String value=" a b "/></Parameter>
              <Parameter name="plant.mode"><Enumeration value="fast" name="Mode"/></Parameter>
            </Parameters>
            <Units><c:Unit name="kg"><c:BaseUnit kg="1"/></c:Unit></Units>
          </ParameterSet>
        </a:ParameterValues>
      </a:ParameterBinding>
    </a:ParameterBindings>
    <a:Elements>
      <a:Component name="plant" source="plant.fmu" implementation="CoSimulation">
        <a:Connectors>
          <a:Connector name="u" kind="input"/>
          <a:Connector name="y" kind="output"><c:Real/></a:Connector>
          <a:Connector name="flag" kind="parameter"><c:Boolean/></a:Connector>
          <a:Connector name="label" kind="calculatedParameter"><c:String/></a:Connector>
          <a:Connector name="packets" kind="output"><c:Binary mime-type="application/x-mavlink"/></a:Connector>
        </a:Connectors>
        <a:Annotations><c:Annotation type="org.example"><note xmlns="urn:x">hi</note></c:Annotation></a:Annotations>
      </a:Component>
      <a:System name="inner">
        <a:Elements>
          <a:Component name="part" source="part.fmu" type="application/x-fmu-sharedlibrary"/>
        </a:Elements>
      </a:System>
    </a:Elements>
    <a:Connections>
      <a:Connection startConnector="wind" endElement="plant" endConnector="u" suppressUnitConversion="true">
        <c:LinearTransformation offset="100"/>
        <a:ConnectionGeometry pointsX="1 2" pointsY="1 2"/>
      </a:Connection>
      <a:Connection startElement="plant" startConnector="y" endConnector="mode"/>
    </a:Connections>
    <a:SystemGeometry x1="0" y1="0" x2="1" y2="1"/>
    <a:GraphicalElements><a:Note x1="0" y1="0" x2="1" y2="1" text="t"/></a:GraphicalElements>
  </a:System>
  <a:Enumerations>
    <c:Enumeration name="Mode"><c:Item name="slow" value="1"/><c:Item name="fast" value="2"/></c:Enumeration>
  </a:Enumerations>
  <a:Units>
    <c:Unit name="km/h"><c:BaseUnit m="1" s="-1" factor="0.2777777777777778"/></c:Unit>
  </a:Units>
  <a:DefaultExperiment startTime="1" stopTime="2.5e1"/>
  <a:Annotations><c:Annotation type="org.example.top"/></a:Annotations>
</a:SystemStructureDescription>
"""


@pytest.fixture
def complete(tmp_path: Path) -> Callable[..., SystemStructure]:
    """Reads the document above, after a textual replacement."""

    def read(old: str = "", new: str = "") -> SystemStructure:
        assert old in COMPLETE
        (tmp_path / "values").mkdir(exist_ok=True)
        (tmp_path / "values/set 1.ssv").write_text(
            '<s:ParameterSet xmlns:s="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
            'name="external">\n<s:Parameters><s:Parameter name="mass"><s:Real value="2"/></s:Parameter></s:Parameters>'
            "</s:ParameterSet>"
        )
        for name in ("plant.fmu", "part.fmu"):
            (tmp_path / name).write_bytes(b"not opened here")
        (tmp_path / "SystemStructure.ssd").write_text(COMPLETE.replace(old, new, 1) if old else COMPLETE)
        return read_system(tmp_path)

    return read


def line_of(text: str) -> int:
    return COMPLETE[: COMPLETE.index(text)].count("\n") + 1


def problems_of(read: Callable[[], SystemStructure]) -> tuple[Problem, ...]:
    """The problems of a structure, whether it is readable at all or not."""
    try:
        with read() as structure:
            return structure.problems
    except SystemDescriptionError as error:
        return error.problems


class TestWhatIsRead:
    def test_the_complete_document_has_no_problems(self, complete: Callable[..., SystemStructure]) -> None:
        assert complete().problems == ()

    def test_the_head(self, complete: Callable[..., SystemStructure]) -> None:
        structure = complete()
        assert (structure.name, structure.version) == ("complete", "1.0")
        assert (structure.start_time, structure.stop_time) == (1.0, 25.0)
        assert structure.enumerations["Mode"].items == {"slow": 1, "fast": 2}
        base = structure.units["km/h"].base
        assert base is not None
        assert (base.exponents, base.factor, base.offset) == ((0, 1, -1, 0, 0, 0, 0, 0), 0.2777777777777778, 0.0)
        assert [item.type for item in structure.annotations] == ["org.example.top"]

    def test_components_and_connectors(self, complete: Callable[..., SystemStructure], tmp_path: Path) -> None:
        plant, inner = complete().system.elements
        assert isinstance(plant, Component) and isinstance(inner, System)
        assert plant.source == tmp_path / "plant.fmu"
        assert plant.where.line == line_of('<a:Component name="plant"')
        assert [(c.name, c.kind, c.type) for c in plant.connectors] == [
            ("u", "input", None),
            ("y", "output", "Real"),
            ("flag", "parameter", "Boolean"),
            ("label", "calculatedParameter", "String"),
            ("packets", "output", "Binary"),
        ]
        assert plant.annotations[0].element[0].text == "hi"
        assert [element.name for element in inner.elements] == ["part"]

    def test_system_connectors_resolve_unit_and_enumeration(self, complete: Callable[..., SystemStructure]) -> None:
        wind, mode = complete().system.connectors
        assert wind.unit is not None and wind.unit.name == "km/h" and wind.unit.base is not None
        assert (mode.enumeration, mode.items) == ("Mode", {"slow": 1, "fast": 2})

    def test_connections(self, complete: Callable[..., SystemStructure]) -> None:
        first, second = complete().system.connections
        assert (first.start_element, first.start_connector) == (None, "wind")
        assert (first.end_element, first.end_connector) == ("plant", "u")
        assert first.suppress_unit_conversion and isinstance(first.transformation, LinearTransformation)
        assert (first.transformation.factor, first.transformation.offset) == (1.0, 100.0)
        assert not second.suppress_unit_conversion and second.transformation is None
        assert first.where.line == line_of('<a:Connection startConnector="wind"')

    def test_parameter_bindings(self, complete: Callable[..., SystemStructure], tmp_path: Path) -> None:
        external, inline = complete().system.parameter_bindings
        assert external.prefix == "plant."
        assert [(p.name, p.type, p.value) for p in external.parameters] == [("mass", "Real", 2.0)]
        assert str(external.parameters[0].where) == f"{tmp_path}/values/set 1.ssv:2"
        assert [(p.name, p.type, p.value) for p in inline.parameters] == [
            ("plant.mass", "Real", 1.5),
            ("plant.count", "Integer", -3),
            ("plant.on", "Boolean", True),
            ("plant.text", "String", " a b "),
            ("plant.mode", "Enumeration", "fast"),
        ]
        unit = inline.parameters[0].unit
        assert unit is not None and unit.base is not None and unit.base.exponents[0] == 1

    def test_an_absent_experiment_is_none(self, complete: Callable[..., SystemStructure]) -> None:
        structure = complete('<a:DefaultExperiment startTime="1" stopTime="2.5e1"/>', "")
        assert (structure.start_time, structure.stop_time, structure.problems) == (None, None, ())

    def test_as_fmpy_reads_it(self, complete: Callable[..., SystemStructure], tmp_path: Path, workshop: Any) -> None:
        structure = complete()
        members = {path.relative_to(tmp_path).as_posix(): path for path in tmp_path.rglob("*") if path.is_file()} | {
            "values/set%201.ssv": tmp_path / "values/set 1.ssv"
        }  # FMPy takes the URI for a member's name
        theirs = fmpy_ssd.read_ssd(workshop.ssp("complete.ssp", members))

        def ours(system: System) -> Any:
            return {
                "name": system.name,
                "connectors": [(c.name, c.kind) for c in system.connectors],
                "connections": [
                    (c.start_element, c.start_connector, c.end_element, c.end_connector) for c in system.connections
                ],
                "elements": [
                    ours(element)
                    if isinstance(element, System)
                    else (element.name, [(c.name, c.kind) for c in element.connectors])
                    for element in system.elements
                ],
                "parameters": [[(p.name, p.type) for p in binding.parameters] for binding in system.parameter_bindings],
            }

        def as_read_by_fmpy(system: Any) -> Any:
            return {
                "name": system.name,
                "connectors": [(c.name, c.kind) for c in system.connectors],
                "connections": [
                    (c.startElement, c.startConnector, c.endElement, c.endConnector) for c in system.connections
                ],
                "elements": [
                    as_read_by_fmpy(element)
                    if isinstance(element, fmpy_ssd.System)
                    else (element.name, [(c.name, c.kind) for c in element.connectors])
                    for element in system.elements
                ],
                "parameters": [
                    [(p.name, p.type) for values in binding.parameterValues for p in values.parameters]
                    for binding in system.parameterBindings
                ],
            }

        assert ours(structure.system) == as_read_by_fmpy(theirs.system)


WRONG = [
    # (old, new, what the message says)
    ('version="1.0" name="complete"', 'version="3.0" name="complete"', 'version "3.0" of SSP is not supported'),
    ('version="1.0" name="complete"', 'version="1.0"', 'needs the attribute "name"'),
    ('name="complete" author', 'name="complete" autor', 'no attribute "autor"; did you mean "author"?'),
    ("<a:GraphicalElements>", '<a:Grafics x="1"/><a:GraphicalElements>', "<System> holds no <Grafics>"),
    ('<a:System name="inner">', '<a:System name="inner">stray', 'unexpected text "stray"'),
    ('<a:System name="inner">', '<a:System name="plant">', '"plant" is already in <Elements> of "root", at'),
    ('<a:System name="inner">', '<a:System name="">', 'attribute "name" of <System> is empty'),
    ('name="part" source="part.fmu"', 'name="part"', '<Component> needs the attribute "source"'),
    ('source="part.fmu" type="application/x-fmu-sharedlibrary"', 'source="gone.fmu"', 'does not exist: no file "'),
    ('type="application/x-fmu-sharedlibrary"', 'type="text/x-modelica"', '(Modelica) is not supported; valid: "app'),
    ('implementation="CoSimulation"', 'implementation="Cosimulation"', '"implementation" of <Component> is "Cosim'),
    ('source="part.fmu"', 'source="part.fmu" path="x"', '<Component> has no attribute "path"'),
    ('source="part.fmu"', 'source=""', "is empty"),
    ('source="part.fmu"', 'source="#inner"', "selects a part of its target"),
    ('source="part.fmu"', 'source="file:///x.fmu"', "is an absolute URI"),
    ('source="part.fmu"', 'source="/x.fmu"', "is an absolute URI"),
    ('source="part.fmu"', 'source="https://x/part.fmu"', "is an absolute URI"),
    ('source="part.fmu"', 'source="a\\part.fmu"', "is not a relative path"),
    ('source="part.fmu"', 'source="part.fmu?x"', "is not a relative path"),
    ('source="part.fmu"', 'source="part%00.fmu"', "is not a relative path"),
    ('source="part.fmu"', 'source="part%ff.fmu"', "is not a URI reference"),
    ('source="part.fmu"', 'source="//[x"', "is not a URI reference"),
    ('source="part.fmu" type="application/x-fmu-sharedlibrary"', 'source="SystemStructure.ssd"', "say type="),
    ('name="u" kind="input"', 'name="u"', '<Connector> needs the attribute "kind"'),
    ('name="u" kind="input"', 'name="u" kind="inputs"', 'attribute "kind" of <Connector> is "inputs"'),
    ('name="u" kind="input"', 'name="u" kind="structuralParameter"', '"structuralParameter" is of SSP 2.0'),
    ('name="u" kind="input"', 'name="y" kind="input"', '"y" is already in <Connectors> of "plant"'),
    ("<c:Boolean/>", "<c:Float64/>", "<Float64> in <Connector> is of SSP 2.0"),
    ("<c:Boolean/>", "<c:Boolean/><c:Real/>", "<Connector> holds <Boolean> and <Real>; only one of them is allowed"),
    ("<c:Boolean/>", "<c:Boolean/><c:Dimension size='3'/>", "<Dimension> in <Connector> is of SSP 2.0"),
    ("<c:Boolean/>", "<a:Boolean/>", 'it must be in "http://ssp-standard.org/SSP1/SystemStructureCommon"'),
    ('<c:Enumeration name="Mode"/>', "<c:Enumeration/>", '<Enumeration> needs the attribute "name"'),
    ('<c:LinearTransformation offset="100"/>', '<c:LinearTransformation offset="1OO"/>', "it must be a number"),
    ('<c:LinearTransformation offset="100"/>', '<c:LinearTransformation offset="INF"/>', "must be finite"),
    ('<c:LinearTransformation offset="100"/>', "<c:BooleanMappingTransformation/>", "needs a <MapEntry>"),
    ('<c:LinearTransformation offset="100"/>', "<c:IntegerMappingTransformation/>", "needs a <MapEntry>"),
    ('<c:LinearTransformation offset="100"/>', "<c:EnumerationMappingTransformation/>", "needs a <MapEntry>"),
    ('suppressUnitConversion="true"', 'suppressUnitConversion="yes"', 'it must be "true" or "false"'),
    ('suppressUnitConversion="true"', 'startIndices="1"', '"startIndices" of <Connection> is of SSP 2'),
    ('startConnector="wind"', 'startConnector=""', 'attribute "startConnector" of <Connection> is empty'),
    ("    <a:Elements>\n", "<a:Connections/><a:Elements>\n", "<Elements> in <System> comes too late; order"),
    ('source="values/set%201.ssv"', 'source="values/gone.ssv"', "does not exist"),
    ('source="values/set%201.ssv"', 'source="plant.fmu"', "not well-formed XML"),
    ('source="values/set%201.ssv"', 'source="SystemStructure.ssd"', "it must be <{http://ssp-standard.org/SSP1/Syst"),
    ('source="values/set%201.ssv"', 'type="text/csv" source="values/set%201.ssv"', 'attribute "type" of <Paramet'),
    ('source="values/set%201.ssv"', 'sourceBase="component" source="x.ssv"', "there is no component"),
    ('source="values/set%201.ssv"', "", "has neither a source and <ParameterValues>"),
    ("<a:ParameterBinding>", '<a:ParameterBinding source="values/set%201.ssv">', "has both a source and"),
    ("<a:ParameterValues>", "<a:ParameterMapping/><a:ParameterValues>", "<ParameterValues> in <Par"),
    ('<Integer value="-3"/>', '<Integer value="3.0"/>', "it must be an integer of 32 bits"),
    ('<Integer value="-3"/>', '<Integer value="2147483648"/>', "it must be an integer of 32 bits"),
    ('<Integer value="-3"/>', "<Int32 value='3'/>", "<Int32> in <Parameter> is of SSP 2.0"),
    ('<Integer value="-3"/>', '<Binary value="0g"/>', "it must be bytes in hexadecimal (xs:hexBinary)"),
    ('<Integer value="-3"/>', "", 'parameter "plant.count" has no value'),
    ('<Boolean value="true"/>', '<Boolean value="True"/>', 'it must be "true" or "false"'),
    ('<ParameterSet version="1.0"', '<ParameterSet version="9"', 'version "9" of SSP'),
    ("<c:BaseUnit kg", "<c:BaseUnit mol='x' kg", "it must be an integer of 32 bits"),
    ('<c:BaseUnit kg="1"/>', "", "<Unit> needs a <BaseUnit>"),
    ('factor="0.2777777777777778"', 'factor="0"', "factor must be finite and not 0"),
    ('<c:Unit name="km/h">', '<c:Unit name="km/h"><c:BaseUnit/></c:Unit><c:Unit name="km/h">', "already defined"),
    ('<c:Item name="fast" value="2"/>', '<c:Item name="slow" value="2"/>', 'item "slow" of enumeration "Mode" is al'),
    ('<c:Item name="fast" value="2"/>', '<c:Item name="fast"/>', '<Item> needs the attribute "value"'),
    ("  </a:Enumerations>", "<c:Enumeration name='Mode'><c:Item name='x' value='1'/></c:Enumeration></a:Enumerations>",
     'enumeration "Mode" is already defined'),
    ('stopTime="2.5e1"', 'stopTime="1"', "stopTime 1 s is not after startTime 1 s"),
    ('stopTime="2.5e1"', 'stopTime="INF"', "must be a finite time"),
    ('stopTime="2.5e1"', 'stepSize="1"', '<DefaultExperiment> has no attribute "stepSize"'),
    ('<c:Annotation type="org.example.top"/>', "<c:Annotation/>", '<Annotation> needs the attribute "type"'),
    ("<a:SystemGeometry", "<a:SignalDictionaries/><a:SystemGeometry", "needs a <SignalDictionary>"),
    ('<a:System name="inner">', "<a:SignalDictionaryReference/><a:System name='inner'>", 'needs the attribute "dic'),
    ("  <a:Units>", "<a:Enumerations/><a:Units>", "<SystemStructureDescription> may hold only one <Enumerations>"),
    ("  <a:Units>", "<c:MetaData/><a:Units>", "<MetaData> in <SystemStructureDescription> is of SSP 2.0"),
]  # fmt: skip


class TestWhatIsWrong:
    @pytest.mark.parametrize(("old", "new", "message"), WRONG, ids=[f"{new[:40]}" for _, new, _ in WRONG])
    def test_one_thing(self, complete: Callable[..., SystemStructure], old: str, new: str, message: str) -> None:
        problems = problems_of(lambda: complete(old, new))
        matching = [problem for problem in problems if message in problem.message]
        assert matching, f"none of these says {message!r}:\n" + "\n".join(map(str, problems))
        if "set%201.ssv" not in old:
            start = line_of(old)
            assert any(start - 3 <= (p.where.line or 0) <= start + new.count("\n") + 3 for p in matching)

    def test_all_of_it_at_once(self, complete: Callable[..., SystemStructure], tmp_path: Path) -> None:
        structure = complete('name="u" kind="input"', 'name="u" kind="wrong" color="red"')
        text = (tmp_path / "SystemStructure.ssd").read_text()
        (tmp_path / "SystemStructure.ssd").write_text(text.replace('source="part.fmu"', 'source="gone.fmu"'))
        assert len(structure.problems) == 2
        assert len(read_system(tmp_path).problems) == 3

    def test_malformed_xml_has_its_line(self, tmp_path: Path) -> None:
        path = tmp_path / "a.ssd"
        path.write_text("<a>\n<b>\n</a>")
        with pytest.raises(SystemDescriptionError, match=rf"^{re.escape(str(path))}:3: not well-formed XML: "):
            read_system(path)

    def test_document_types_are_refused(self, tmp_path: Path) -> None:
        path = tmp_path / "a.ssd"
        path.write_text('<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<a>&x;</a>')
        with pytest.raises(SystemDescriptionError, match="DOCTYPE"):
            read_system(path)

    @pytest.mark.parametrize("text", ["", " ", "<a", "\0", "<?xml version='1.0' encoding='nope'?><a/>"])
    def test_no_document_at_all(self, tmp_path: Path, text: str) -> None:
        (tmp_path / "a.ssd").write_text(text)
        with pytest.raises(SystemDescriptionError, match="not well-formed XML"):
            read_system(tmp_path / "a.ssd")

    def test_another_document(self, tmp_path: Path) -> None:
        (tmp_path / "a.ssd").write_text("<html/>")
        with pytest.raises(SystemDescriptionError, match=r"the root element is <html>; it must be <\{http"):
            read_system(tmp_path / "a.ssd")

    def test_a_namespace_counts_and_a_prefix_does_not(self, tmp_path: Path) -> None:
        (tmp_path / "a.ssd").write_text(
            '<ssd:SystemStructureDescription xmlns:ssd="urn:other" version="1.0" name="x"/>'
        )
        with pytest.raises(SystemDescriptionError, match=r"it must be <\{http://ssp-standard"):
            read_system(tmp_path / "a.ssd")

    def test_an_empty_list_of_elements(self, complete: Callable[..., SystemStructure], workshop: Any) -> None:
        structure = read_system(workshop.ssd("a.ssd", workshop.system("\n")))
        (problem,) = structure.problems
        assert (
            problem.message == "<Elements> is empty; it needs a <Component> or <SignalDictionaryReference> or <System>"
        )

    def test_a_document_without_a_system(self, workshop: Any) -> None:
        (problem,) = read_system(workshop.ssd("a.ssd", "")).problems
        assert problem.message == "<SystemStructureDescription> needs a <System>"

    def test_a_document_that_is_too_large(self, workshop: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("cosim_master.system.reading.ssp.references._MAX_DOCUMENT_BYTES", 100)
        with pytest.raises(SystemDescriptionError, match=r"a\.ssd: is larger than 100 bytes"):
            read_system(workshop.ssd("a.ssd", workshop.system()))

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(SystemDescriptionError, match=r"no such file or folder; give an \.ssd, an \.ssp"):
            read_system(tmp_path / "gone.ssd")
        with pytest.raises(SystemDescriptionError, match=r"SystemStructure\.ssd: no such file"):
            read_system(tmp_path)
        (tmp_path / "x.txt").write_text("")
        with pytest.raises(SystemDescriptionError, match=r"is neither an \.ssd"):
            read_system(tmp_path / "x.txt")


class TestNesting:
    def drone(self, workshop: Any, path: str = "drone.ssd", source: str = "unit.fmu") -> Path:
        workshop.fmu("unit.fmu", '<ScalarVariable name="y" valueReference="0"><Real/></ScalarVariable>')
        system = workshop.system(workshop.component("vehicle", source), name="drone")
        made: Path = workshop.ssd(path, system, '<ssd:DefaultExperiment stopTime="7"/>')
        return made

    def test_one_ssd_for_many_components(self, workshop: Any) -> None:
        self.drone(workshop, "parts/drone.ssd", "../unit.fmu")
        components = "".join(
            workshop.component(f"drone{i}", "parts/drone.ssd", type="application/x-ssp-definition") for i in range(3)
        )
        structure = read_system(workshop.ssd("SystemStructure.ssd", workshop.system(components)))
        assert structure.problems == () and structure.stop_time is None
        contents = [element.content for element in structure.system.elements if isinstance(element, Component)]
        assert contents[0] is contents[1] is contents[2]
        (vehicle,) = contents[0].elements
        assert vehicle.source == workshop.root / "unit.fmu"

    def test_an_ssp_inside_an_ssp(self, workshop: Any) -> None:
        inner = workshop.ssp(
            "inner.ssp",
            {
                "SystemStructure.ssd": self.drone(workshop, source="resources/unit.fmu"),
                "resources/unit.fmu": workshop.root / "unit.fmu",
            },
        )
        component = workshop.component("drone", "resources/inner.ssp", type="application/x-ssp-package")
        outer = workshop.ssd("outer.ssd", workshop.system(component))
        path = workshop.ssp("outer.ssp", {"SystemStructure.ssd": outer, "resources/inner.ssp": inner})
        with read_system(path) as structure:
            assert structure.problems == ()
            (drone,) = structure.system.elements
            assert isinstance(drone, Component) and drone.content is not None
            (vehicle,) = drone.content.elements
            assert isinstance(vehicle, Component) and vehicle.source is not None and vehicle.source.is_file()
            assert str(vehicle.where).startswith(f"{path}/resources/inner.ssp/SystemStructure.ssd:")
            folders = [archive.directory for archive in structure.archives]
            assert len(folders) == 2 and all(folder.is_dir() for folder in folders)
        assert not any(folder.exists() for folder in folders)

    def test_unpacked_files_go_with_the_last_reference(self, workshop: Any) -> None:
        path = workshop.ssp("a.ssp", {"SystemStructure.ssd": workshop.ssd("a.ssd", workshop.system())})
        structure = read_system(path)
        folder = structure.archives[0].directory
        assert folder.is_dir()
        del structure
        assert not folder.exists()

    def test_variants_are_left_out_with_a_note(self, workshop: Any) -> None:
        ssd = workshop.ssd("a.ssd", workshop.system())
        with read_system(workshop.ssp("a.ssp", {"SystemStructure.ssd": ssd, "B.ssd": b"", "C.ssd": b""})) as structure:
            assert structure.notes == (
                f"{workshop.root}/a.ssp: variants B.ssd, C.ssd are left out; SystemStructure.ssd is used",
            )

    def test_an_ssp_without_its_document(self, workshop: Any) -> None:
        with pytest.raises(SystemDescriptionError, match=r"a\.ssp/SystemStructure\.ssd: no such file"):
            read_system(workshop.ssp("a.ssp", {"other.ssd": b""}))

    def test_nothing_leads_out_of_an_ssp(self, workshop: Any) -> None:
        self.drone(workshop)
        inside = workshop.system(
            workshop.component("a", "resources/../unit.fmu") + workshop.component("b", "../unit.fmu")
        )
        ssd = workshop.ssd("a.ssd", inside)
        path = workshop.ssp("a.ssp", {"SystemStructure.ssd": ssd, "unit.fmu": workshop.root / "unit.fmu"})
        with read_system(path) as structure:
            (problem,) = structure.problems
            assert problem.message == 'source "../unit.fmu" leads out of the .ssp archive'

    def test_what_contains_itself(self, workshop: Any) -> None:
        other = workshop.component("again", "a.ssd", type="application/x-ssp-definition")
        workshop.ssd("b.ssd", workshop.system(other))
        first = workshop.component("b", "b.ssd", type="application/x-ssp-definition")
        structure = read_system(workshop.ssd("a.ssd", workshop.system(first)))
        (problem,) = structure.problems
        assert problem.where.path.endswith("b.ssd") and problem.message.endswith('a.ssd" contains itself')

    def test_problems_of_a_shared_file_are_told_once(self, workshop: Any) -> None:
        self.drone(workshop, source="gone.fmu")
        components = "".join(
            workshop.component(f"drone{i}", "drone.ssd", type="application/x-ssp-definition") for i in range(5)
        )
        structure = read_system(workshop.ssd("SystemStructure.ssd", workshop.system(components)))
        assert len(structure.problems) == 1

    def test_a_broken_file_inside(self, workshop: Any) -> None:
        (workshop.root / "drone.ssd").write_text("<oops")
        (workshop.root / "drone.ssp").write_text("oops")
        components = workshop.component("a", "drone.ssd", type="application/x-ssp-definition")
        components += workshop.component("b", "drone.ssp", type="application/x-ssp-package")
        structure = read_system(workshop.ssd("SystemStructure.ssd", workshop.system(components)))
        assert [Path(problem.where.path).name for problem in structure.problems] == ["drone.ssd", "drone.ssp"]

    def test_annotations_around_a_nested_system_stay_with_it(self, workshop: Any) -> None:
        inner = workshop.ssd("drone.ssd", workshop.system(), workshop.annotation("org.example.inner", ""))
        component = workshop.component("drone", inner.name, type="application/x-ssp-definition")
        (drone,) = read_system(workshop.ssd("a.ssd", workshop.system(component))).system.elements
        assert isinstance(drone, Component) and drone.content is not None
        assert [item.type for item in drone.content.annotations] == ["org.example.inner"]


SCHEMA = etree.XMLSchema(file=str(Path(fmpy.ssp.__file__).parent / "schema/SystemStructureDescription.xsd"))
VALUES = st.sampled_from(["", "1", "x", "true", "input", "output", "Real", "1.0", "any", "-1e3", " 2 ", "NaN", "SSD"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("mutants")
    (made / "values").mkdir()
    for name in ("plant.fmu", "part.fmu", "values/set 1.ssv"):
        (made / name).write_bytes(b"")
    return made


def geometry(element: etree._Element) -> bool:
    names = ("Geometry", "GraphicalElements", "Note", "Annotation")
    return any(part in str(item.tag) for item in (element, *element.iterancestors()) for part in names)


class TestAgainstTheOfficialSchema:
    def test_the_complete_document_is_valid(self) -> None:
        SCHEMA.assertValid(etree.fromstring(COMPLETE.encode()))

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(data=st.data())
    def test_what_the_schema_refuses_is_a_problem(self, folder: Path, data: st.DataObject) -> None:
        """Mutate the tree of the valid document; where the XSD objects, so do we (except inside drawings)."""
        root = etree.fromstring(COMPLETE.encode())
        elements = [element for element in root.iter("*") if not geometry(element)]
        element = elements[data.draw(st.integers(1, len(elements) - 1))]
        parent = element.getparent()
        assert parent is not None
        change = data.draw(st.sampled_from(["drop", "twice", "last", "rename", "attribute", "value", "new", "text"]))
        names = sorted(map(str, element.attrib))
        if change == "drop":
            parent.remove(element)
        elif change == "twice":
            parent.append(copy.deepcopy(element))
        elif change == "last":
            parent.append(element)
        elif change == "rename":
            element.tag = f"{{{etree.QName(element).namespace}}}{data.draw(st.sampled_from(['System', 'Unit', 'X']))}"
        elif change == "attribute" and names:
            del element.attrib[data.draw(st.sampled_from(names))]
        elif change == "value" and names:
            element.set(data.draw(st.sampled_from(names)), data.draw(VALUES))
        elif change == "new":
            element.set(data.draw(st.sampled_from(["name", "kind", "unit", "colour", "type"])), data.draw(VALUES))
        else:
            element.text = "stray"
        (folder / "mutant.ssd").write_bytes(etree.tostring(root))
        found = problems_of(lambda: read_system(folder / "mutant.ssd"))
        # The empty set 1.ssv is always a problem here, so that nothing but the document itself is judged.
        own = [problem for problem in found if "set 1.ssv" not in problem.where.path]
        if not SCHEMA.validate(root):
            assert own, f"{change}: {SCHEMA.error_log.last_error}"


SCRAPS = st.sampled_from([b"<", b"</", b">", b'"', b"&x;", b"&#0;", b"INF", b"\xff"])


class TestNothingElseIsRaised:
    @settings(max_examples=200, deadline=None)
    @given(data=st.data())
    def test_on_mutated_text(self, folder: Path, data: st.DataObject) -> None:
        text = bytearray(COMPLETE.encode())
        for _ in range(data.draw(st.integers(1, 5))):
            at = data.draw(st.integers(0, len(text)))
            length = data.draw(st.integers(0, 12))
            text[at : at + length] = data.draw(
                st.one_of(
                    st.binary(max_size=6), st.sampled_from([b"<", b"</", b">", b'"', b"&x;", b"&#0;", b"INF", b"\xff"])
                )
            )
        (folder / "text.ssd").write_bytes(text)
        for problem in problems_of(lambda: read_system(folder / "text.ssd")):
            assert problem.where.path and problem.message

    def test_on_deep_nesting(self, tmp_path: Path) -> None:
        depth = 5000
        opened = f'<a:Elements xmlns:a="{SSD[1:-1]}"><a:System name="x">'
        (tmp_path / "deep.ssd").write_text(opened * depth + "</a:System></a:Elements>" * depth)
        with pytest.raises(SystemDescriptionError, match="not well-formed XML"):
            read_system(tmp_path / "deep.ssd")


class TestBombs:
    def test_references_that_multiply(self, workshop: Any) -> None:
        """Thirty lines that stand for 10^12 components."""
        systems = workshop.system(name="s0").replace("<ssd:System ", '<ssd:System id="s0" ')
        for i in range(1, 13):
            parts = "".join(workshop.component(f"c{k}", f"#s{i - 1}", type=SSD_TYPE) for k in range(10))
            systems += workshop.system(parts, name=f"s{i}").replace("<ssd:System ", f'<ssd:System id="s{i}" ')
        with pytest.raises(SystemDescriptionError, match=r"has \d+ parts; at most 400000 are possible"):
            check(read_system(workshop.ssd("s.ssd", workshop.system(systems))))

    def test_references_that_nest(self, workshop: Any) -> None:
        systems = workshop.system(name="s0").replace("<ssd:System ", '<ssd:System id="s0" ')
        for i in range(1, 400):
            part = workshop.component("c", f"#s{i - 1}", type=SSD_TYPE)
            systems += workshop.system(part, name=f"s{i}").replace("<ssd:System ", f'<ssd:System id="s{i}" ')
        with pytest.raises(SystemDescriptionError, match="nested more than"):
            check(read_system(workshop.ssd("s.ssd", workshop.system(systems))))

    def test_files_that_nest(self, workshop: Any) -> None:
        for i in range(300):
            part = workshop.component("c", f"f{i + 1}.ssd", type=SSD_TYPE)
            workshop.ssd(f"f{i}.ssd", workshop.system(part if i < 299 else ""))
        (problem,) = read_system(workshop.root / "f0.ssd").problems
        assert problem.message == "systems are nested more than 60 deep"

    def test_archives_that_unpack_to_much_together(self, workshop: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(archive, "MAX_BYTES", 22_000)
        parts = {}
        for i in range(5):
            root = workshop.ssd("inner.ssd", workshop.system())
            parts[f"resources/p{i}.ssp"] = workshop.ssp("p.ssp", {"SystemStructure.ssd": root, "fill": bytes(3000)})
            parts[f"resources/p{i}.ssp"] = parts[f"resources/p{i}.ssp"].read_bytes()
        used = "".join(workshop.component(f"c{i}", f"resources/p{i}.ssp", type=SSP_TYPE) for i in range(5))
        outer = workshop.ssp("all.ssp", {"SystemStructure.ssd": workshop.ssd("o.ssd", workshop.system(used)), **parts})
        found = [str(problem) for problem in read_system(outer).problems]
        assert found and all("unpacks to more than" in text for text in found)


class TestWhatIsIgnored:
    def test_annotations_everywhere_are_noted_once(self, workshop: Any) -> None:
        workshop.fmu("unit.fmu")
        note = workshop.annotation("com.example", "<x/>")
        text = workshop.parameter_set({"a.p": 1.0}).replace("</ssv:ParameterSet>", f"{note}</ssv:ParameterSet>")
        (workshop.root / "p.ssv").write_text(text.replace("ssd:Annotations", "ssv:Annotations"))
        binding = f'<ssd:ParameterBindings><ssd:ParameterBinding source="p.ssv">{note}</ssd:ParameterBinding>'
        system = workshop.system(workshop.component("a", "unit.fmu"), bindings=binding + "</ssd:ParameterBindings>")
        experiment = f"<ssd:DefaultExperiment>{note}</ssd:DefaultExperiment>"
        structure = read_system(workshop.ssd("s.ssd", system, experiment))
        assert structure.problems == ()
        found = [one.removeprefix(f"{workshop.root}/") for one in structure.notes if "is ignored" in one]
        assert found == [
            's.ssd:4: annotation "com.example" is ignored',
            's.ssd:10: annotation "com.example" is ignored',
            'p.ssv:2: annotation "com.example" is ignored',
        ]

    def test_ours_in_the_wrong_place(self, workshop: Any) -> None:
        note = workshop.annotation("org.uav-cosim.stepping", "<x/>")
        experiment = f"<ssd:DefaultExperiment>{note}</ssd:DefaultExperiment>"
        (problem,) = read_system(workshop.ssd("s.ssd", workshop.system(), experiment)).problems
        assert problem.message.endswith("belongs to a system or component, not to a DefaultExperiment")

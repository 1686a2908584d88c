"""Saving a changed system: what changes is written so that it reads back, everything else stays byte for byte."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from cosim_master.diagnostics.errors import SystemDescriptionError, Where
from cosim_master.files.xml_edit import Document, Node, applied
from cosim_master.fmi.description.units import BaseUnit, Unit
from cosim_master.system.authoring.save import save
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.structure import (
    Annotation,
    Component,
    Connection,
    Connector,
    LinearTransformation,
    MappingTransformation,
    Parameter,
    ParameterBinding,
    System,
)

NEW = Where("")
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
TEXT = """<?xml version='1.0' encoding="ISO-8859-1"?>
<!-- a système, by hand -->
<s:SystemStructureDescription xmlns:s="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:c="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="drones">
  <s:System   name="root">
    <s:ParameterBindings>
      <s:ParameterBinding source="values.ssv"/>
      <s:ParameterBinding><s:ParameterValues>
        <v:ParameterSet xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="x">
          <v:Parameters>
            <v:Parameter name="a.p"><v:Real   value="2.5" /></v:Parameter> <!-- metres -->
            <v:Parameter name="b.n"><v:Integer value='7'/></v:Parameter>
          </v:Parameters>
        </v:ParameterSet>
      </s:ParameterValues></s:ParameterBinding>
    </s:ParameterBindings>
    <s:Elements>
      <s:Component name="a" source="unit.fmu" description='left &amp; right'>
        <s:Connectors>
          <s:Connector name="y" kind="output"><c:Real unit="m"/><s:ConnectorGeometry x="1" y="0.5"/></s:Connector>
        </s:Connectors>
        <s:ElementGeometry x1="0" y1="0" x2="1" y2="1"/>
        <s:Annotations><c:Annotation type="com.example"><k:k xmlns:k="urn:k"/></c:Annotation></s:Annotations>
      </s:Component>
      <!-- the other one -->
      <s:Component name="b" source="unit.fmu"/>
    </s:Elements>
    <s:GraphicalElements><s:Note x1="0" y1="0" x2="1" y2="1" text="h\u00e9"/></s:GraphicalElements>
  </s:System>
  <s:DefaultExperiment stopTime="1"/>
</s:SystemStructureDescription>
"""
VALUES = """<v:ParameterSet xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0"
    name="y">
  <v:Parameters>
    <v:Parameter name="b.p"><v:Real value="1"/></v:Parameter> <!-- stays -->
  </v:Parameters>
</v:ParameterSet>
"""


@pytest.fixture
def folder(workshop: Any, variable: Any) -> Path:
    workshop.fmu(
        "system/unit.fmu",
        variable("u", unit="m"),
        variable("n", kind="Integer"),
        variable("p", "parameter", unit="m", start="0.25"),
        variable("y", "output", unit="m"),
        variable("m", "output", kind="Integer"),
        step="0.5",
    )
    made: Path = workshop.root / "system"
    (made / "SystemStructure.ssd").write_bytes(TEXT.encode("latin-1"))
    (made / "values.ssv").write_text(VALUES)
    return made


def saved(folder: Path, change: Callable[[System], System], out: Path | None = None) -> list[str]:
    """Save a change; returns the lines that went and came, without their indent."""
    before = (folder / "SystemStructure.ssd").read_bytes()
    with read_system(folder) as structure:
        target = save(structure, change(structure.system), out)
    after = (target / "SystemStructure.ssd").read_bytes()
    lines = difflib.unified_diff(
        before.decode("latin-1").splitlines(), after.decode("latin-1").splitlines(), n=0, lineterm=""
    )
    return [line[0] + line[1:].strip() for line in lines if line[0] in "+-" and not line.startswith(("+++", "---"))]


def element(system: System, which: str, **changes: Any) -> System:
    return replace(system, elements=tuple(replace(e, **changes) if e.name == which else e for e in system.elements))


def connectors_and_wire(system: System) -> System:
    system = element(system, "b", connectors=(Connector("u", "input", NEW), Connector("n", "input", NEW, "Integer")))
    table = LinearTransformation(2.0, 0.5, NEW)
    return replace(system, connections=(Connection("a", "y", "b", "u", NEW, transformation=table),))


def test_nothing_changed_nothing_written(folder: Path) -> None:
    times = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert saved(folder, lambda system: system) == []
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == times


def test_a_connection_with_connectors_and_its_lists(folder: Path) -> None:
    assert saved(folder, connectors_and_wire) == [
        '-<s:Component name="b" source="unit.fmu"/>',
        '+<s:Component name="b" source="unit.fmu">',
        "+<s:Connectors>",
        '+<s:Connector name="u" kind="input"/>',
        '+<s:Connector name="n" kind="input">',
        "+<c:Integer/>",
        "+</s:Connector>",
        "+</s:Connectors>",
        "+</s:Component>",
        "+<s:Connections>",
        '+<s:Connection startElement="a" startConnector="y" endElement="b" endConnector="u">',
        '+<c:LinearTransformation factor="2.0" offset="0.5"/>',
        "+</s:Connection>",
        "+</s:Connections>",
    ]
    (link,) = check(read_system(folder)).links
    assert (link.source, link.target, link.factor, link.offset) == (("a", "y"), ("b", "u"), 2.0, 0.5)


def test_one_connection_changes_and_another_goes(folder: Path) -> None:
    def two(system: System) -> System:
        system = connectors_and_wire(system)
        a = Connector("m", "output", NEW)
        system = element(system, "a", connectors=(*system.elements[0].connectors, a))
        return replace(system, connections=(*system.connections, Connection("a", "m", "b", "n", NEW)))

    saved(folder, two)
    table = MappingTransformation("Integer", ((1, 2), (2, -3)), NEW)
    assert saved(
        folder, lambda s: replace(s, connections=(s.connections[0], replace(s.connections[1], transformation=table)))
    ) == [
        '-<s:Connection startElement="a" startConnector="m" endElement="b" endConnector="n"/>',
        '+<s:Connection startElement="a" startConnector="m" endElement="b" endConnector="n">',
        "+<c:IntegerMappingTransformation>",
        '+<c:MapEntry source="1" target="2"/>',
        '+<c:MapEntry source="2" target="-3"/>',
        "+</c:IntegerMappingTransformation>",
        "+</s:Connection>",
    ]
    changed = saved(
        folder, lambda s: replace(s, connections=(replace(s.connections[1], suppress_unit_conversion=True),))
    )
    assert changed == [
        '-<s:Connection startElement="a" startConnector="y" endElement="b" endConnector="u">',
        '-<c:LinearTransformation factor="2.0" offset="0.5"/>',
        "-</s:Connection>",
        '-<s:Connection startElement="a" startConnector="m" endElement="b" endConnector="n">',
        '+<s:Connection startElement="a" startConnector="m" endElement="b" endConnector="n" '
        'suppressUnitConversion="true">',
    ]


def test_the_last_one_goes_with_its_list(folder: Path) -> None:
    before = (folder / "SystemStructure.ssd").read_bytes()
    saved(folder, lambda s: replace(connectors_and_wire(s), elements=s.elements, connections=()))
    assert (folder / "SystemStructure.ssd").read_bytes() == before
    saved(folder, lambda s: element(s, "b", connectors=(Connector("u", "input", NEW),)))
    assert saved(folder, lambda s: element(s, "b", connectors=())) == [
        "-<s:Connectors>",
        '-<s:Connector name="u" kind="input"/>',
        "-</s:Connectors>",
    ]


def test_values_of_parameters_inline_and_in_a_file(folder: Path) -> None:
    def change(system: System) -> System:
        external, inline = system.parameter_bindings
        first, second = inline.parameters
        more = Parameter("a.n", "Integer", 3, NEW)
        inline = replace(inline, parameters=(replace(first, value=1e-3), second, more))
        external = replace(external, parameters=(replace(external.parameters[0], value=4.0),), prefix="")
        return replace(system, parameter_bindings=(external, inline))

    assert saved(folder, change) == [
        '-<v:Parameter name="a.p"><v:Real   value="2.5" /></v:Parameter> <!-- metres -->',
        '+<v:Parameter name="a.p"><v:Real value="0.001"/></v:Parameter> <!-- metres -->',
        '+<v:Parameter name="a.n">',
        '+<v:Integer value="3"/>',
        "+</v:Parameter>",
    ]
    assert (folder / "values.ssv").read_text() == VALUES.replace('<v:Real value="1"/>', '<v:Real value="4.0"/>')


def test_a_new_binding_with_a_unit_defines_it(folder: Path) -> None:
    inch = Unit("in", BaseUnit((0, 1, 0, 0, 0, 0, 0, 0), 0.0254))
    binding = ParameterBinding((Parameter("a.p", "Real", 10.0, NEW, inch),), "", NEW)
    saved(folder, lambda s: replace(s, parameter_bindings=(*s.parameter_bindings, binding)))
    values = check(read_system(folder)).instances[0].start_values
    assert values["p"] == pytest.approx(0.254)


def test_a_component_comes_and_another_goes(folder: Path) -> None:
    def change(system: System) -> System:
        ports = (Connector("y", "output", NEW, "Real", Unit("m")),)
        new = Component("c & d", "application/x-fmu-sharedlibrary", folder / "unit.fmu", "any", ports, (), (), NEW)
        return replace(system, elements=(system.elements[0], new), parameter_bindings=())

    lines = saved(folder, change)
    assert '-<s:Component name="b" source="unit.fmu"/>' in lines
    assert '+<s:Component name="c &amp; d" source="unit.fmu">' in lines and '+<c:Real unit="m"/>' in lines
    assert [instance.name for instance in check(read_system(folder)).instances] == ["a", "c & d"]
    assert "<!-- the other one -->" in (folder / "SystemStructure.ssd").read_text("latin-1")


def test_a_new_system_inside(folder: Path) -> None:
    inner = Component("x", "application/x-fmu-sharedlibrary", folder / "unit.fmu", "CoSimulation", (), (), (), NEW)
    ports, wire = (Connector("in", "input", NEW),), Connection(None, "in", "x", "u", NEW)
    inner = replace(inner, connectors=(Connector("u", "input", NEW),))
    part = System("part", ports, (), (inner,), (wire,), (), folder / "SystemStructure.ssd", NEW)
    saved(folder, lambda s: replace(s, elements=(*s.elements, part)))
    assert [instance.name for instance in check(read_system(folder)).instances] == ["a", "b", "part.x"]
    assert saved(folder, lambda s: element(s, "part", name="part", connections=()))[0].startswith("-<s:Connections>")


def test_annotations(folder: Path) -> None:
    text = f'<ssc:Annotation xmlns:ssc="{SSC}" type="org.uav-cosim.stepping">'
    text += '<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="0.25"/></ssc:Annotation>'
    new = Annotation("org.uav-cosim.stepping", etree.fromstring(text), NEW)
    saved(folder, lambda s: element(s, "a", annotations=(*s.elements[0].annotations, new)))
    saved(folder, lambda s: element(s, "b", annotations=(new,)))
    assert [one.step_size for one in check(read_system(folder)).instances] == [0.25, 0.25]
    saved(folder, lambda s: element(s, "a", annotations=s.elements[0].annotations[:1]))
    assert [one.step_size for one in check(read_system(folder)).instances] == [0.5, 0.25]


def test_sources_that_lead_out_are_rebased(folder: Path, tmp_path: Path) -> None:
    (folder / "unit.fmu").rename(folder.parent / "unit.fmu")
    file = folder / "SystemStructure.ssd"
    file.write_bytes(file.read_bytes().replace(b'"unit.fmu"', b'"../unit.fmu"'))
    target = tmp_path / "far/away/copy"
    saved(folder, connectors_and_wire, target)
    assert b'source="../../../unit.fmu"' in (target / "SystemStructure.ssd").read_bytes()
    assert len(check(read_system(target)).links) == 1


def test_elsewhere(folder: Path, workshop: Any, tmp_path: Path) -> None:
    before = (folder / "SystemStructure.ssd").read_bytes()
    assert saved(folder, connectors_and_wire, tmp_path / "copy") != []
    assert (folder / "SystemStructure.ssd").read_bytes() == before
    packed = workshop.ssp("s.ssp", {path.name: path for path in folder.iterdir()})
    content = packed.read_bytes()
    with read_system(packed) as structure:
        assert save(structure, connectors_and_wire(structure.system), tmp_path / "new.ssp") == tmp_path / "new.ssp"
        assert packed.read_bytes() == content
        save(structure, connectors_and_wire(structure.system))
    for path in (packed, tmp_path / "new.ssp"):
        with read_system(path) as structure:
            assert len(check(structure).links) == 1
    with read_system(folder / "SystemStructure.ssd") as structure:
        save(structure, connectors_and_wire(structure.system), folder / "other.ssd")
        with pytest.raises(ValueError, match="in its own folder only"):
            save(structure, structure.system, tmp_path / "other.ssd")
        with pytest.raises(ValueError, match="exists already"):
            save(structure, structure.system, folder / "other.ssd")
    assert len(check(read_system(folder / "other.ssd")).links) == 1


def test_a_shipped_system_is_not_changed_in_place(fmus: Path, tmp_path: Path) -> None:
    """What differs in the next run of line5 would be found by nobody."""
    assert fmus.is_dir()
    with read_system("line5") as structure:
        with pytest.raises(ValueError, match=r"line5 is shipped, and is not changed in place; give a path for the new"):
            save(structure, structure.system)
        save(structure, structure.system, tmp_path / "line5")
    with read_system(tmp_path / "line5") as structure:
        assert save(structure, structure.system) == tmp_path / "line5"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: replace(s, connections=(Connection("a", "yy", "b", "u", NEW),)), 'no connector "yy"'),
        (lambda s: element(s, "b", name="a"), '"a" is already in <Elements>'),
        (lambda s: replace(s, parameter_bindings=s.parameter_bindings[::-1]), "cannot be saved as it is: "),
        (
            lambda s: element(s, "a", connectors=(Connector("y", "input", NEW, "Real"),)),
            'connector "y" is input, but unit.fmu has it as output',
        ),
        (lambda s: element(s, "a", source=Path("/gone.fmu")), 'gone.fmu" does not exist: no file "/gone.fmu"'),
    ],
)
def test_what_cannot_be_saved_leaves_everything_as_it_was(
    folder: Path, change: Callable[[System], System], message: str
) -> None:
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with read_system(folder) as structure, pytest.raises(SystemDescriptionError, match=message):
        save(structure, change(structure.system))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_system_with_problems(folder: Path) -> None:
    file = folder / "SystemStructure.ssd"
    file.write_bytes(TEXT.replace('name="b"', 'name="b" oops="1"').encode("latin-1"))
    with read_system(folder) as structure, pytest.raises(SystemDescriptionError, match='no attribute "oops"'):
        save(structure, structure.system)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_there_and_back_is_the_same_system(folder: Path, data: st.DataObject) -> None:
    """Any parameters and connectors that are written are read; taking them away again leaves the text as it was."""
    file = folder / "SystemStructure.ssd"
    file.write_bytes(TEXT.encode("latin-1"))
    reals = st.floats(allow_nan=False, allow_infinity=False)
    values = data.draw(
        st.dictionaries(st.sampled_from(["a.u", "a.p", "b.u", "x.y", "<&>'\"", "\u00e9\n"]), reals, min_size=1)
    )
    binding = ParameterBinding(tuple(Parameter(name, "Real", v, NEW) for name, v in values.items()), "", NEW)
    names = data.draw(st.lists(st.sampled_from(["u", "n", "p", "m"]), unique=True))
    kinds = {"u": "input", "n": "input", "p": "parameter", "m": "output"}
    ports = tuple(Connector(name, kinds[name], NEW) for name in names)  # type: ignore[arg-type]
    with read_system(folder) as structure:
        first = structure.system
        more = replace(first, parameter_bindings=(*first.parameter_bindings, binding))
        save(structure, element(more, "a", connectors=(*first.elements[0].connectors, *ports)))
    with read_system(folder) as structure:
        written = structure.system
        assert {p.name: p.value for p in written.parameter_bindings[2].parameters} == values
        assert [c.name for c in written.elements[0].connectors] == ["y", *names]
        less = replace(written, parameter_bindings=written.parameter_bindings[:2])
        save(structure, element(less, "a", connectors=written.elements[0].connectors[:1]))
    assert file.read_bytes() == TEXT.encode("latin-1")


CORPUS = sorted(Path(__file__).parents[3].glob("data/ssp/*/**/*.ss[dvmb]"))


def test_positions_of_every_element_of_the_corpus() -> None:
    """The bytes of an element are the element; an attribute that is set, set again and removed leaves no trace."""
    assert len(CORPUS) > 100
    for path in CORPUS:
        document = Document(path.read_bytes())
        nodes, expected = [document.root], list(etree.fromstring(document.data).iter(tag=etree.Element))
        for node, element in zip(_in_order(nodes[0]), expected, strict=True):
            assert node.tag == element.tag
            spaces = "".join(f' xmlns{":" * bool(p)}{p}="{uri}"' for p, uri in node.scope.items()).encode()
            part = document.data[node.start : node.end]
            name = re.match(rb"<[^\s/>]+", part)
            assert name is not None
            declared = [p for p in node.scope if f"xmlns{':' * bool(p)}{p}=".encode() in part[: node.head - node.start]]
            if not declared:
                part = name.group() + spaces + part[name.end() :]
                again = etree.fromstring(part)
                assert etree.tostring(again, method="c14n", exclusive=True) == _exclusive(element)
        last = nodes[0]
        text = applied(document.data, document.attribute(last, "description", 'a "b" <c>\n'))
        assert etree.fromstring(text).get("description") == 'a "b" <c>\n'
        more = Document(text)
        assert applied(text, more.attribute(more.root, "description", None)) == document.data


def _in_order(node: Node) -> list[Node]:
    return [node, *(item for child in node.children for item in _in_order(child))]


def _exclusive(element: etree._Element) -> bytes:
    return etree.tostring(element, method="c14n", exclusive=True, with_tail=False)


def test_another_instance_of_a_system_of_the_same_file(folder: Path) -> None:
    file = folder / "SystemStructure.ssd"
    inner = (
        '<s:System name="part" id="part"><s:Elements><s:Component name="x" source="unit.fmu"/></s:Elements></s:System>'
    )
    file.write_bytes(file.read_bytes().replace(b"</s:Elements>", inner.encode() + b"</s:Elements>"))

    def change(system: System) -> System:
        content, document = system.elements[2], system.document
        assert isinstance(content, System)
        kind = "application/x-ssp-definition"
        more = Component("more", kind, document, "any", (), (), (), NEW, content, "part")
        return replace(system, elements=(*system.elements, more))

    written = '+<s:Component name="more" type="application/x-ssp-definition" source="#part"/>'
    assert any(line.startswith(written) for line in saved(folder, change))
    assert [one.name for one in check(read_system(folder)).instances] == ["a", "b", "more.x", "part.x"]


def test_what_is_inside_of_another_file_is_changed_there(folder: Path, workshop: Any) -> None:
    part = workshop.ssd("system/part.ssd", workshop.system(workshop.component("x", "unit.fmu"), name="inside"))
    use = '<s:Component name="part" source="part.ssd" type="application/x-ssp-definition"/>'
    file = folder / "SystemStructure.ssd"
    file.write_bytes(file.read_bytes().replace(b"</s:Elements>", use.encode() + b"</s:Elements>"))
    before = file.read_bytes(), part.read_bytes()
    with read_system(folder) as structure:
        content = structure.system.elements[2].content  # type: ignore[union-attr]
        assert content is not None
        with pytest.raises(SystemDescriptionError, match='"part" is defined in a file of its own: change it there'):
            save(structure, element(structure.system, "part", content=replace(content, elements=())))
    assert before == (file.read_bytes(), part.read_bytes())

"""Drawings of systems: everything is there, where the file puts it or in the direction of the data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.system.authoring.draw import graph
from cosim_master.system.reading.read import read_system

SVG = "{http://www.w3.org/2000/svg}"


class Drawing:
    def __init__(self, path: Path) -> None:
        with read_system(path) as structure:
            self.root = etree.fromstring(graph(structure))

    def box(self, name: str) -> tuple[float, float, float, float]:
        """x, y, width and height of the box with a title."""
        for group in self.root.iter(f"{SVG}g"):
            title = group.find(f"{SVG}text[@class='title']")
            if title is not None and title.text == name:
                rect = group.find(f"{SVG}rect")
                return tuple(float(rect.get(n)) for n in ("x", "y", "width", "height"))  # type: ignore[return-value]
        raise AssertionError(name)

    def titles(self, tag: str) -> list[str]:
        return [element.findtext(f"{SVG}title") or "" for element in self.root.iter(f"{SVG}{tag}")]

    def ends(self, wire: str) -> list[tuple[float, float]]:
        """The points of the path of a connection."""
        for path in self.root.iter(f"{SVG}path"):
            if path.findtext(f"{SVG}title") == wire:
                words = path.get("d").replace("M", " ").replace("L", " ").replace("C", " ").split()
                return [tuple(map(float, word.split(","))) for word in words if "," in word]  # type: ignore[misc]
        raise AssertionError(wire)


def inside(inner: tuple[float, ...], outer: tuple[float, ...]) -> bool:
    return (
        outer[0] <= inner[0]
        and outer[1] <= inner[1]
        and inner[0] + inner[2] <= outer[0] + outer[2] + 0.2
        and inner[1] + inner[3] <= outer[1] + outer[3] + 0.2
    )


def apart(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return (
        one[0] + one[2] <= other[0]
        or other[0] + other[2] <= one[0]
        or one[1] + one[3] <= other[1]
        or other[1] + other[3] <= one[1]
    )


@pytest.fixture
def nested(workshop: Any, variable: Any) -> Path:
    workshop.fmu("unit.fmu", variable("u"), variable("y", "output"))
    part = workshop.component("part [1] & more", "unit.fmu", "u:input:Real:m y:output")
    inner = workshop.system(
        part,
        '<ssd:Connection startConnector="in" endElement="part [1] &amp; more" endConnector="u"/>'
        '<ssd:Connection startElement="part [1] &amp; more" startConnector="y" endConnector="out"/>',
        name="inner",
        connectors="in:input out:output",
    )
    parts = workshop.component("source", "unit.fmu", "y:output") + inner
    parts += workshop.component("sink", "unit.fmu", "u:input y:output")
    connections = workshop.connection("source/y", "inner/in") + workshop.connection("sink/u", "inner/out")
    path: Path = workshop.ssd("nested.ssd", workshop.system(parts, connections) + workshop.units("m"))
    return path


def test_everything_is_there(nested: Path) -> None:
    drawing = Drawing(nested)
    boxes = {name: drawing.box(name) for name in ("root", "source", "inner", "sink", "part [1] & more")}
    for name in ("source", "inner", "sink"):
        assert inside(boxes[name], boxes["root"])
    assert inside(boxes["part [1] & more"], boxes["inner"])
    assert apart(boxes["source"], boxes["inner"]) and apart(boxes["inner"], boxes["sink"])
    assert boxes["source"][0] < boxes["inner"][0] < boxes["sink"][0]  # against the order of start and end
    assert sorted(drawing.titles("circle")) == sorted(
        ["y: output", "in: input", "out: output", "u: input Real [m]", "y: output", "u: input", "y: output"]
    )
    assert sorted(drawing.titles("path")) == [
        *("in - part [1] & more.u", "part [1] & more.y - out", "sink.u - inner.out", "source.y - inner.in"),
    ]
    start, *_, end = drawing.ends("source.y - inner.in")
    x, y, width, height = boxes["source"]
    assert start[0] == pytest.approx(x + width, abs=0.2) and y < start[1] < y + height
    assert end[0] == pytest.approx(boxes["inner"][0], abs=0.2)


def test_a_loop_goes_back_below(workshop: Any, variable: Any) -> None:
    workshop.fmu("unit.fmu", variable("u"), variable("y", "output"))
    parts = "".join(workshop.component(name, "unit.fmu", "u:input y:output") for name in "abc")
    wires = [workshop.connection(f"{a}/y", f"{b}/u") for a, b in ("ab", "bc", "ca")]
    drawing = Drawing(workshop.ssd("loop.ssd", workshop.system(parts, "".join(wires))))
    a, b, c = (drawing.box(name) for name in "abc")
    assert a[0] < b[0] < c[0]
    path = next(p for p in drawing.root.iter(f"{SVG}path") if p.findtext(f"{SVG}title") == "c.y - a.u")
    lowest = float(path.get("d").split("V")[1].split()[0])
    assert lowest > max(box[1] + box[3] for box in (a, b, c))


def test_the_geometry_of_the_file(workshop: Any, variable: Any) -> None:
    """y points upwards there; places of connectors are relative to their element."""
    workshop.fmu("unit.fmu", variable("u"), variable("y", "output"))

    def part(name: str, *corners: float) -> str:
        x1, y1, x2, y2 = corners
        made: str = workshop.component(name, "unit.fmu", "u:input y:output").replace(
            "</ssd:Connectors>", f'</ssd:Connectors><ssd:ElementGeometry x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"/>'
        )
        return made.replace(
            '<ssd:Connector name="y" kind="output"></ssd:Connector>',
            '<ssd:Connector name="y" kind="output">\n<ssd:ConnectorGeometry x="0.5" y="0"/></ssd:Connector>',
        )

    wire = workshop.connection("low/y", "high/u", '<ssd:ConnectionGeometry pointsX="10 70" pointsY="-5 -5"/>')
    parts = part("low", 0, 0, 20, 10) + part("high", 40, 100, 80, 120)
    drawing = Drawing(workshop.ssd("placed.ssd", workshop.system(parts, wire)))
    low, high = drawing.box("low"), drawing.box("high")
    scale = low[2] / 20
    assert (low[3], high[2], high[3]) == pytest.approx((10 * scale, 40 * scale, 20 * scale), abs=0.3)
    assert high[0] - low[0] == pytest.approx(40 * scale, abs=0.3)
    assert low[1] - high[1] == pytest.approx(110 * scale, abs=0.3)  # from one upper edge to the other
    points = drawing.ends("low.y - high.u")
    assert points[0] == pytest.approx((low[0] + low[2] / 2, low[1] + low[3]), abs=0.3)
    assert points[1] == pytest.approx((low[0] + 10 * scale, low[1] + 15 * scale), abs=0.3)
    assert len(points) == 4


def test_a_multimodel(stricts: Any) -> None:
    stricts.fmu()
    content = {"fmus": {"{A}": "strict.fmu"}, "connections": {"{A}.one.y": ["{A}.two.u", "{A}.three.u"]}}
    file = stricts.workshop.root / "mm.json"
    file.write_text(json.dumps(content))
    drawing = Drawing(file)
    one, two, three = (drawing.box(f"{{A}}.{name}") for name in ("one", "two", "three"))
    assert one[0] < two[0] == three[0] and apart(two, three)


def test_large_systems_do_not_recurse(workshop: Any, variable: Any) -> None:
    workshop.fmu("unit.fmu", variable("u"), variable("y", "output"))
    n = 1500
    parts = "".join(workshop.component(f"c{i}", "unit.fmu", "u:input y:output") for i in range(n))
    wires = "".join(workshop.connection(f"c{i}/y", f"c{i + 1}/u") for i in range(n - 1))
    drawing = Drawing(workshop.ssd("long.ssd", workshop.system(parts, wires)))
    assert len(drawing.titles("path")) == n - 1


def test_the_command(nested: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["graph", str(nested), "-o", str(tmp_path / "new" / "n.svg")])
    assert done.exit_code == 0, done.output
    assert etree.parse(str(tmp_path / "new" / "n.svg")).getroot().tag == f"{SVG}svg"
    broken = nested.with_name("broken.ssd")
    broken.write_text(nested.read_text().replace('source="unit.fmu"', 'source="none.fmu"', 1))
    done = CliRunner().invoke(app, ["graph", str(broken), "-o", str(tmp_path / "b.svg")])
    assert done.exit_code == 2 and not (tmp_path / "b.svg").exists()
    with read_system(broken) as structure, pytest.raises(SystemDescriptionError):
        graph(structure)


def test_no_other_file_gets_svg(nested: Path, tmp_path: Path) -> None:
    file = tmp_path / "n.png"
    done = CliRunner().invoke(app, ["graph", str(nested), "-o", str(file)])
    assert (done.exit_code, file.exists()) == (2, False)
    assert "graph writes SVG; give the file a name that ends in .svg" in " ".join(done.stderr.split())


def test_arrays_are_one_connector_and_one_wire(workshop: Any, variable: Any) -> None:
    workshop.fmu(
        "unit.fmu", *(variable(f"u[{i}]") for i in (1, 2, 3)), *(variable(f"y[{i}]", "output") for i in (1, 2, 3))
    )
    ports = "u[1]:input u[2]:input u[3]:input y[1]:output y[2]:output y[3]:output"
    parts = "".join(workshop.component(name, "unit.fmu", ports) for name in "ab")
    wires = "".join(workshop.connection(f"a/y[{i}]", f"b/u[{i}]") for i in (1, 2, 3))
    drawing = Drawing(workshop.ssd("arrays.ssd", workshop.system(parts, wires)))
    assert sorted(drawing.titles("circle")) == sorted(["u[1..3]: input", "y[1..3]: output"] * 2)
    assert drawing.titles("path") == ["a.y[1..3] - b.u[1..3]"]
    words = [text.text for text in drawing.root.iter(f"{SVG}text") if text.get("class") == "what"]
    assert words == ["unit.fmu", "unit.fmu"]


def test_an_array_with_a_gap_stays_as_it_is(workshop: Any, variable: Any) -> None:
    workshop.fmu("unit.fmu", variable("u[1]"), variable("u[3]"))
    part = workshop.component("a", "unit.fmu", "u[1]:input u[3]:input")
    assert sorted(Drawing(workshop.ssd("gap.ssd", workshop.system(part, ""))).titles("circle")) == [
        "u[1]: input",
        "u[3]: input",
    ]


def test_equal_parts_are_drawn_once_with_their_number(workshop: Any, variable: Any) -> None:
    workshop.fmu("unit.fmu", variable("u"), variable("y", "output"))
    parts = "".join(workshop.component(f"d{i}", "unit.fmu", "u:input y:output") for i in range(1, 1001))
    parts += workshop.component("odd", "unit.fmu", "u:input") + workshop.component("sink", "unit.fmu", "u:input")
    parts += workshop.component("source", "unit.fmu", "y:output")
    drawing = Drawing(workshop.ssd("many.ssd", workshop.system(parts, workshop.connection("source/y", "sink/u"))))
    assert drawing.box("d1, d2, ..., d1000 (x 1000)") and drawing.box("odd") and drawing.box("sink")
    assert len(drawing.titles("circle")) == 5
    assert float(drawing.root.get("height")) < 600


def test_the_radio_counts_its_links(workshop: Any, variable: Any) -> None:
    workshop.fmu("unit.fmu", variable("u"), variable("y", "output"))
    parts = "".join(workshop.component(f"d{i}", "unit.fmu", "u:input y:output") for i in range(1, 4))
    links = '<link between="d1 d2"/><link between="d2 d3" loss="0.1"/>'
    radio = f'<network xmlns="https://uav-cosim.org/ns/1" topology="listed" range="300">{links}</network>'
    annotation = workshop.annotation("org.uav-cosim.network", radio)
    drawing = Drawing(workshop.ssd("listed.ssd", workshop.system(parts, after=annotation)))
    texts = [text.text or "" for text in drawing.root.iter(f"{SVG}text")]
    assert "radio: topology listed, range 300 m, 2 links" in texts


def test_the_radio_is_below_the_system(tmp_path: Path) -> None:
    system = Path(__file__).parents[4] / "master" / "systems" / "line5"
    drawing = Drawing(system)
    (radio,) = (one for one in drawing.root.iter(f"{SVG}rect") if one.get("class") == "radio")
    texts = [text.text or "" for text in drawing.root.iter(f"{SVG}text")]
    (said,) = (text for text in texts if text.startswith("radio: "))
    assert "topology nearest" in said and "latency 0.02 s, seed 1" in said and "link" not in said
    box = drawing.box("line5")
    assert float(radio.get("y")) > box[1] + box[3]
    assert "drone1, drone2, ..., drone5 (x 5)" in texts and "Quadrotor.fmu" in texts

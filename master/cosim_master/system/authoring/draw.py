"""Draws a system as SVG: components and nested systems with their connectors, and the connections between them.

If the file contains geometry (SSP 2.0, section 5.4.2.3 and following: ElementGeometry, ConnectorGeometry,
ConnectionGeometry), it is used. Otherwise elements are arranged in columns in the direction of the data, and equal
elements without wires are drawn once, with their number. Arrays are one connector. Only the system's files are read,
without a comparison with FMUs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.files.xml import line_of
from cosim_master.system.authoring.swarm.scenario import NETWORK
from cosim_master.system.authoring.text.condense import bundled, collapsed
from cosim_master.system.structure import Component, Connection, Connector, Element, System, SystemStructure

__all__ = ["graph"]

_SVG = "http://www.w3.org/2000/svg"
_SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
_LETTER, _LINE, _TITLE = 6.6, 16.0, 24.0
"""Width of a letter, height of a connector and of a title, in pixels of the drawing."""
_GAP_X, _GAP_Y, _MARGIN = 90.0, 40.0, 40.0
_RADIO = 70.0
"""Height of the radio, with the distance to the system above it."""
_COLOURS = {"input": "#1f77b4", "output": "#d62728", "parameter": "#7f7f7f", "calculatedParameter": "#9467bd"}
_STYLE = (
    "text{font:11px sans-serif;fill:#222}.title{font-weight:bold}.system{fill:#f7f7f2;stroke:#888}"
    ".what{fill:#666;font-style:italic}.component{fill:#fff;stroke:#333}"
    ".radio{fill:#e8f0f8;stroke:#0072b2}.wire{fill:none;stroke:#557;stroke-width:1.2}"
    ".air{fill:none;stroke:#0072b2;stroke-dasharray:4 3}"
)
_UNITS = {"latency": "s", "jitter": "s", "range": "m"}
"""Of settings of the radio that nearly every system has."""
_Point: TypeAlias = tuple[float, float]


@dataclass(slots=True)
class _Port:
    connector: Connector
    x: float = 0.0
    y: float = 0.0

    @property
    def on_left(self) -> bool:
        return self.connector.kind in ("input", "parameter", "structuralParameter", "inout")


@dataclass(slots=True)
class _Box:
    """An element; x and y are the coordinates of its upper left corner in the surrounding box."""

    name: str
    what: str
    ports: dict[str, _Port]
    children: dict[str, _Box] = field(default_factory=dict)
    wires: list[tuple[Connection, list[_Point]]] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0
    height: float = 0.0


def graph(structure: SystemStructure) -> bytes:
    """Returns the drawing of a system, an SVG document.

    Raises:
        SystemDescriptionError: the system's files have problems.
    """
    if structure.problems:
        raise SystemDescriptionError(structure.problems)
    system = bundled(structure.system)
    box = _of_system(system, system.name, system.connectors, _Geometry())
    radio = _radio(structure.system)
    width = max(box.width, _LETTER * len(radio) + 20.0) + 2 * _MARGIN
    height = box.height + 2 * _MARGIN + (_RADIO if radio else 0.0)
    size = {"width": f"{width:.0f}", "height": f"{height:.0f}", "viewBox": f"0 0 {width:.0f} {height:.0f}"}
    nsmap: Any = {None: _SVG}
    root = etree.Element(f"{{{_SVG}}}svg", size, nsmap=nsmap)
    _add(root, "title").text = structure.name
    _add(root, "style").text = _STYLE
    _draw(root, box, _MARGIN, _MARGIN)
    if radio:
        _draw_radio(root, radio, box)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)


def _radio(system: System) -> str:
    """Returns the settings of the radio as text; empty if the file has none."""
    for one in system.annotations:
        if one.type == NETWORK:
            element = next((child for child in one.element if isinstance(child.tag, str)), None)
            given = [] if element is None else [_setting(element, name) for name in map(str, element.attrib)]
            links = 0 if element is None else sum(1 for _ in element.iterchildren("{*}link"))
            given += [f"{links} link{'s' if links > 1 else ''}"] if links else []
            return ": ".join(["radio", ", ".join(given)]) if given else "radio"
    return ""


def _setting(element: etree._Element, name: str) -> str:
    return " ".join(filter(None, (name, element.get(name), _UNITS.get(name))))


def _draw_radio(root: etree._Element, text: str, box: _Box) -> None:
    """Draws the radio below the system, connected by a dashed line."""
    y = _MARGIN + box.height + _RADIO - 34.0
    _add(root, "path", class_="air", d=f"M{_MARGIN + box.width / 2:.1f},{_MARGIN + box.height:.1f} V{y:.1f}")
    wide = max(box.width, _LETTER * len(text) + 20.0)
    _add(root, "rect", class_="radio", x=_MARGIN, y=y, width=wide, height=34.0, rx=6.0)
    _add(root, "text", x=_MARGIN + 10.0, y=y + 21.0).text = text


# ---- contents --------------------------------------------------------------------------------------------------------


class _Geometry:
    """The elements of .ssd documents by line, tag and name, to look up their geometry."""

    def __init__(self) -> None:
        self._documents: dict[Path, dict[tuple[int | None, str], etree._Element]] = {}

    def of(self, document: Path, where: Where, tag: str, child: str) -> etree._Element | None:
        """Returns the geometry `child` of the element `tag` at a place, or None."""
        if document.suffix.lower() != ".ssd":
            return None
        if document not in self._documents:
            try:
                root = etree.parse(str(document), etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
            except (OSError, etree.XMLSyntaxError) as error:
                raise SystemDescriptionError([Problem(Where(str(document)), f"cannot be read: {error}")]) from None
            self._documents[document] = {
                (line_of(element), etree.QName(element).localname): element for element in root.iter(etree.Element)
            }
        element = self._documents[document].get((where.line, tag))
        return None if element is None else element.find(f"{_SSD}{child}")


def _of_system(system: System, name: str, connectors: Sequence[Connector], geometry: _Geometry) -> _Box:
    boxes = _placed(system, geometry)
    if boxes is None:
        system = collapsed(system)
    inside = {c.name: c for c in (*system.connectors, *connectors)}
    box = _Box(name, "system", {c.name: _Port(c) for c in inside.values()})
    for element in system.elements:
        box.children[element.name] = _of_element(element, geometry)
    if boxes is None:
        _in_columns(system, box)
    else:
        _by_geometry(system, box, boxes, geometry)
    _size(box, inner=(box.width, box.height))
    for element in system.elements:
        child = box.children[element.name]
        child.y += _TITLE
        _ports(child, element.connectors, system, geometry)
    _ports(box, tuple(inside.values()), None, geometry)
    return box


def _of_element(element: Element, geometry: _Geometry) -> _Box:
    if isinstance(element, System):
        return _of_system(element, element.name, element.connectors, geometry)
    if isinstance(element, Component) and element.content is not None:
        return _of_system(element.content, element.name, element.connectors, geometry)
    what = element.source.name if isinstance(element, Component) and element.source is not None else "component"
    box = _Box(element.name, what, {c.name: _Port(c) for c in element.connectors})
    _size(box, inner=(0.0, 0.0))
    return box


def _size(box: _Box, inner: tuple[float, float]) -> None:
    """Sets a size that suffices for title, connectors and contents."""
    left = [p.connector.name for p in box.ports.values() if p.on_left]
    right = [p.connector.name for p in box.ports.values() if not p.on_left]
    names = _LETTER * (max(map(len, left), default=0) + max(map(len, right), default=0)) + 30.0
    beside = names if inner == (0.0, 0.0) else inner[0] + names + 2 * _MARGIN
    box.width = max(beside, _LETTER * len(box.name) + 20.0, 90.0)
    box.width = max(box.width, _LETTER * len(box.what) + 20.0)
    top = _head(box)
    rows = max(len(left), len(right)) * _LINE + top + 8.0
    box.height = max(rows, inner[1] + _TITLE + _MARGIN, 44.0)
    if inner != (0.0, 0.0):
        shift = _LETTER * max(map(len, left), default=0) + 15.0 + _MARGIN
        for child in box.children.values():
            child.x += shift
        box.wires = [(wire, [(x + shift, y + _TITLE) for x, y in points]) for wire, points in box.wires]


def _head(box: _Box) -> float:
    """Returns the height of the title, below which connectors begin; a component also has the name of its file."""
    return _TITLE if box.what == "system" else _TITLE + 14.0


def _ports(box: _Box, connectors: Sequence[Connector], system: System | None, geometry: _Geometry) -> None:
    """Returns the places of connectors in their box: inputs left, outputs right, or as in the file."""
    for on_left in (True, False):
        side = [port for port in box.ports.values() if port.on_left == on_left]
        for i, port in enumerate(side):
            port.x = 0.0 if on_left else box.width
            port.y = _head(box) + (i + 0.5) * (box.height - _head(box)) / len(side)
    if system is None:
        return
    for connector in connectors:
        found = geometry.of(system.document, connector.where, "Connector", "ConnectorGeometry")
        place = None if found is None else _numbers(found, "x", "y")
        if place is not None and connector.name in box.ports:
            box.ports[connector.name].x = place[0] * box.width
            box.ports[connector.name].y = (1.0 - place[1]) * box.height  # in SSP y points upwards


# ---- layout ----------------------------------------------------------------------------------------------------------


def _placed(system: System, geometry: _Geometry) -> Mapping[str, Sequence[float]] | None:
    """Returns x1, y1, x2, y2 of every element as in the file; None unless the file has all of them."""
    boxes: dict[str, Sequence[float]] = {}
    for element in system.elements:
        tag = type(element).__name__
        found = geometry.of(system.document, element.where, tag, "ElementGeometry")
        numbers = None if found is None else _numbers(found, "x1", "y1", "x2", "y2")
        if numbers is None or numbers[0] == numbers[2] or numbers[1] == numbers[3]:
            return None
        boxes[element.name] = numbers
    return boxes or None


def _numbers(element: etree._Element, *names: str) -> tuple[float, ...] | None:
    try:
        return tuple(float(element.get(name, "")) for name in names)
    except ValueError:
        return None


def _by_geometry(system: System, box: _Box, boxes: Mapping[str, Sequence[float]], geometry: _Geometry) -> None:
    """Places elements in the file's proportions, at the least scale at which all contents fit into their elements."""
    scale = 0.0
    for name, (x1, y1, x2, y2) in boxes.items():
        child = box.children[name]
        scale = max(scale, child.width / abs(x2 - x1), child.height / abs(y2 - y1))
    left = min(min(b[0], b[2]) for b in boxes.values())
    top = max(max(b[1], b[3]) for b in boxes.values())
    for name, (x1, y1, x2, y2) in boxes.items():
        child = box.children[name]
        child.x, child.y = (min(x1, x2) - left) * scale, (top - max(y1, y2)) * scale
        child.width, child.height = abs(x2 - x1) * scale, abs(y2 - y1) * scale
    box.width = max(child.x + child.width for child in box.children.values())
    box.height = max(child.y + child.height for child in box.children.values())
    for connection in system.connections:
        found = geometry.of(system.document, connection.where, "Connection", "ConnectionGeometry")
        points: list[_Point] = []
        if found is not None:
            try:
                xs, ys = ([float(v) for v in found.get(name, "").split()] for name in ("pointsX", "pointsY"))
                points = [((x - left) * scale, (top - y) * scale) for x, y in zip(xs, ys, strict=True)]
            except ValueError:
                points = []
        box.wires.append((connection, points))


def _in_columns(system: System, box: _Box) -> None:
    """Places elements in columns by the longest path from a source; connections that close a loop lead backwards."""
    after: dict[str, list[str]] = {name: [] for name in box.children}
    for connection in system.connections:
        source, target = _direction(box, connection)
        if source in after and target in after and source != target:
            after[source].append(target)
        box.wires.append((connection, []))
    column = _columns(after)
    x = 0.0
    for number in sorted(set(column.values())):
        members = [box.children[name] for name in box.children if column[name] == number]
        y = 0.0
        for child in members:
            child.x, child.y = x, y
            y += child.height + _GAP_Y
        box.height = max(box.height, y - _GAP_Y)
        x += max(child.width for child in members) + _GAP_X
    box.width = max(x - _GAP_X, 0.0)


def _columns(after: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Returns the longest distances from a source, without the edges that close a loop (depth first)."""
    state: dict[str, int] = {}
    order: list[str] = []
    kept: dict[str, list[str]] = {name: [] for name in after}
    for root in after:
        if root in state:
            continue
        state[root] = 1
        path = [(root, iter(after[root]))]
        while path:
            name, following = path[-1]
            for target in following:
                if state.get(target) != 1:
                    kept[name].append(target)
                if target not in state:
                    state[target] = 1
                    path.append((target, iter(after[target])))
                    break
            else:
                state[name] = 2
                order.append(name)
                path.pop()
    column = dict.fromkeys(after, 0)
    for name in reversed(order):
        for target in kept[name]:
            column[target] = max(column[target], column[name] + 1)
    return column


def _direction(box: _Box, connection: Connection) -> tuple[str | None, str | None]:
    """Returns the direction of a connection, by the kinds of its connectors."""
    start, end = connection.start_element, connection.end_element
    port = box.children[start].ports.get(connection.start_connector) if start in box.children else None
    if port is not None and port.on_left:
        return end, start
    return start, end


# ---- drawing ---------------------------------------------------------------------------------------------------------


def _add(parent: etree._Element, tag: str, **attributes: str | float) -> etree._Element:
    given = {n.rstrip("_"): f"{v:.1f}" if isinstance(v, float) else v for n, v in attributes.items()}
    return etree.SubElement(parent, f"{{{_SVG}}}{tag}", given)


def _draw(parent: etree._Element, box: _Box, x: float, y: float) -> None:
    group = _add(parent, "g", class_="element")
    kind = "system" if box.what == "system" else "component"
    _add(group, "rect", class_=kind, x=x, y=y, width=box.width, height=box.height, rx=4.0)
    title = _add(group, "text", class_="title", x=x + 8.0, y=y + 16.0)
    title.text = box.name
    if kind == "component":
        _add(group, "text", class_="what", x=x + 8.0, y=y + 30.0).text = box.what
    _add(group, "title").text = f"{box.name}: {box.what}"
    for child in box.children.values():
        _draw(group, child, x + child.x, y + child.y)
    for connection, points in box.wires:
        _wire(group, box, connection, [(x + px, y + py) for px, py in points], (x, y))
    for port in box.ports.values():
        _port(group, port, x + port.x, y + port.y)


def _port(group: etree._Element, port: _Port, x: float, y: float) -> None:
    connector = port.connector
    colour = _COLOURS.get(connector.kind, "#2ca02c")
    dot = _add(group, "circle", cx=x, cy=y, r=3.5, fill=colour)
    unit = f" [{connector.unit.name}]" if connector.unit is not None else ""
    _add(dot, "title").text = f"{connector.name}: {connector.kind} {connector.type or ''}{unit}".rstrip()
    anchor, shift = ("start", 7.0) if port.on_left else ("end", -7.0)
    text = _add(group, "text", x=x + shift, y=y + 4.0)
    text.set("text-anchor", anchor)
    text.text = connector.name


def _wire(group: etree._Element, box: _Box, connection: Connection, points: Sequence[_Point], origin: _Point) -> None:
    ends = [
        _place(box, connection.start_element, connection.start_connector, origin),
        _place(box, connection.end_element, connection.end_connector, origin),
    ]
    if ends[0] is None or ends[1] is None:
        return
    if points:
        path = "M" + " L".join(f"{x:.1f},{y:.1f}" for x, y in [ends[0], *points, ends[1]])
    else:
        path = _curve(box, connection, ends[0], ends[1], origin[1])
    wire = _add(group, "path", class_="wire", d=path)
    names = [".".join(filter(None, end)) for end in _ends(connection)]
    _add(wire, "title").text = f"{names[0]} - {names[1]}"


def _curve(box: _Box, connection: Connection, start: _Point, end: _Point, top: float) -> str:
    """Returns a path from an output rightwards to an input; it passes below the boxes if it leads backwards."""
    first, last = box.children.get(connection.start_element or ""), box.children.get(connection.end_element or "")
    if first is not None and first.ports[connection.start_connector].on_left:
        start, end, first, last = end, start, last, first
    (x1, y1), (x2, y2) = start, end
    if first is not None and last is not None and x2 < x1:
        lane = 3.0 * (list(last.ports).index(_at(connection, last)) % 8)
        below = top + max(child.y + child.height for child in (first, last)) + 6.0 + lane
        out, into = x1 + 12.0 + lane, x2 - 12.0 - lane
        return f"M{x1:.1f},{y1:.1f} H{out:.1f} V{below:.1f} H{into:.1f} V{y2:.1f} H{x2:.1f}"
    bend = max(30.0, abs(x2 - x1) / 2)
    return f"M{x1:.1f},{y1:.1f} C{x1 + bend:.1f},{y1:.1f} {x2 - bend:.1f},{y2:.1f} {x2:.1f},{y2:.1f}"


def _at(connection: Connection, box: _Box) -> str:
    """Returns the connector at the end of a connection that belongs to `box`."""
    return connection.end_connector if connection.end_element == box.name else connection.start_connector


def _ends(connection: Connection) -> tuple[tuple[str | None, str], tuple[str | None, str]]:
    return (
        (connection.start_element, connection.start_connector),
        (connection.end_element, connection.end_connector),
    )


def _place(box: _Box, element: str | None, connector: str, origin: _Point) -> _Point | None:
    owner = box if element is None else box.children.get(element)
    if owner is None or connector not in owner.ports:
        return None
    port = owner.ports[connector]
    inside = (0.0, 0.0) if element is None else (owner.x, owner.y)
    return origin[0] + inside[0] + port.x, origin[1] + inside[1] + port.y

"""A system with fewer parts to draw: arrays are one connector, equal parts without wires are one part with a number."""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from dataclasses import replace

from cosim_master.system.structure import Component, Connection, Connector, Element, System

__all__ = ["bundled", "collapsed"]

_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
_EQUAL = 3
"""Least number of equal parts that are drawn as one."""


def bundled(system: System, known: dict[int, System] | None = None) -> System:
    """Returns a system in which the scalar connectors x[1], x[2], ... of an element are one, x[1..n], with one wire.

    Nested systems and the systems inside components are bundled too.

    Args:
        system: the system.
        known: systems inside components that have been bundled, by the id of the original, which several uses share.
    """
    known = {} if known is None else known
    names: dict[str | None, dict[str, str]] = {None: _renamed(system.connectors)}
    names |= {element.name: _renamed(element.connectors) for element in system.elements}
    connections: dict[tuple[str | None, str, str | None, str], Connection] = {}
    for one in system.connections:
        start = names.get(one.start_element, {}).get(one.start_connector, one.start_connector)
        end = names.get(one.end_element, {}).get(one.end_connector, one.end_connector)
        key = one.start_element, start, one.end_element, end
        connections.setdefault(key, replace(one, start_connector=start, end_connector=end))
    return replace(
        system,
        connectors=_kept(system.connectors, names[None]),
        elements=tuple(_bundled(element, names[element.name], known) for element in system.elements),
        connections=tuple(connections.values()),
    )


def _bundled(element: Element, names: dict[str, str], known: dict[int, System]) -> Element:
    kept = _kept(element.connectors, names)
    if isinstance(element, System):
        return replace(bundled(element, known), connectors=kept)
    if isinstance(element, Component) and element.content is not None:
        if id(element.content) not in known:
            known[id(element.content)] = bundled(element.content, known)
        return replace(element, connectors=kept, content=known[id(element.content)])
    return replace(element, connectors=kept)


def _renamed(connectors: Sequence[Connector]) -> dict[str, str]:
    """Returns the names of bundles, by the names of their elements; an array must begin at 1 and have no gaps."""
    arrays: dict[tuple[str, str], list[int]] = {}
    for one in connectors:
        if found := _ELEMENT.fullmatch(one.name):
            arrays.setdefault((found[1], one.kind), []).append(int(found[2]))
    return {
        f"{base}[{i}]": f"{base}[1..{len(numbers)}]"
        for (base, _), numbers in arrays.items()
        if len(numbers) > 1 and sorted(numbers) == list(range(1, len(numbers) + 1))
        for i in numbers
    }


def _kept(connectors: Sequence[Connector], names: dict[str, str]) -> tuple[Connector, ...]:
    kept: dict[str, Connector] = {}
    for one in connectors:
        name = names.get(one.name, one.name)
        kept.setdefault(name, replace(one, name=name))
    return tuple(kept.values())


def collapsed(system: System) -> System:
    """Returns a system in which equal elements without connections to others are one, named with their number."""
    wired = {name for one in system.connections for name in (one.start_element, one.end_element)}
    alike: dict[Hashable, list[Element]] = {}
    for element in system.elements:
        alike.setdefault(element.name if element.name in wired else ("alike", _shape(element)), []).append(element)
    elements = []
    for members in alike.values():
        if len(members) < _EQUAL:
            elements += members
        else:
            title = f"{members[0].name}, {members[1].name}, ..., {members[-1].name} (x {len(members)})"
            elements.append(replace(members[0], name=title))
    return replace(system, elements=tuple(elements))


def _shape(element: Element) -> Hashable:
    """Returns what is drawn of an element, without its own name."""
    connectors = tuple((one.name, one.kind, one.type) for one in element.connectors)
    if isinstance(element, Component) and element.content is not None:
        return "component", id(element.content), connectors  # all uses of a file share it
    if isinstance(element, System):
        inner = tuple((one.name, _shape(one)) for one in element.elements)
        wires = tuple((w.start_element, w.start_connector, w.end_element, w.end_connector) for w in element.connections)
        return "system", inner, wires, connectors
    return "element", element.source if isinstance(element, Component) else element.dictionary, connectors

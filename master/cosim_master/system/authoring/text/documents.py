"""Writes documents of SSP from descriptions: an .ssd from a `System`, an .ssv from its parameters.

`save` changes existing documents; this module writes new ones. Sources become relative to the folder of the document.
Types and units of connectors are written unchanged, with the enumerations and units that they refer to, for engines
that require them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from lxml import etree

from cosim_master.files.xml_edit import tag_text
from cosim_master.fmi.description.units import BASE_UNITS
from cosim_master.system.authoring.text.ssp_text import (
    Scope,
    binding_text,
    connection_text,
    connector_text,
    listed,
    parameter_text,
)
from cosim_master.system.reading.ssp.grammar import SSC, SSD, SSV
from cosim_master.system.structure import Component, Connector, Element, Parameter, System

__all__ = ["parameter_document", "system_document"]

_SCOPE: Scope = {"ssd": SSD[1:-1], "ssc": SSC[1:-1]}
_SSV_SCOPE: Scope = {"ssv": SSV[1:-1]}
_DECLARATION = "<?xml version='1.0' encoding='UTF-8'?>\n"


def system_document(
    system: System, folder: Path, *, parameters: str = "", times: Mapping[str, str] | None = None
) -> bytes:
    """Returns the .ssd of a system whose components have files of their own.

    Args:
        folder: the future folder of the document; sources are written relative to it.
        parameters: source of a parameter set that is bound to the system, in addition to its own bindings.
        times: attributes of the DefaultExperiment.
    """
    root = {**_declared(_SCOPE), "name": system.name, "version": "1.0"}
    connectors = list(_connectors(system))
    children = [_system_text(system, folder.resolve(), parameters)]
    children += [text for text in (_enumerations(connectors), _units(connectors)) if text]
    if times is not None:
        children.append(tag_text(_SCOPE, SSD + "DefaultExperiment", times))
    return _document(tag_text(_SCOPE, SSD + "SystemStructureDescription", root, children))


def parameter_document(name: str, parameters: Iterable[Parameter]) -> bytes:
    """Returns an .ssv document."""
    texts = [parameter_text(_SSV_SCOPE, one) for one in parameters]
    root = {**_declared(_SSV_SCOPE), "name": name, "version": "1.0"}
    listed = tag_text(_SSV_SCOPE, SSV + "Parameters", {}, texts)
    return _document(tag_text(_SSV_SCOPE, SSV + "ParameterSet", root, [listed]))


def _document(text: str) -> bytes:
    return f"{_DECLARATION}{text}\n".encode("ascii", "xmlcharrefreplace")


def _declared(scope: Scope) -> dict[str, str | None]:
    return {f"xmlns:{prefix}": uri for prefix, uri in scope.items()}


def _connectors(system: System) -> Iterator[Connector]:
    yield from system.connectors
    for element in system.elements:
        yield from _connectors(element) if isinstance(element, System) else element.connectors


def _system_text(system: System, folder: Path, parameters: str = "") -> str:
    children = listed(_SCOPE, "Connectors", [connector_text(_SCOPE, one) for one in system.connectors])
    bindings = [tag_text(_SCOPE, SSD + "ParameterBinding", {"source": parameters})] if parameters else []
    bindings += [binding_text(_SCOPE, one) for one in system.parameter_bindings]
    children += listed(_SCOPE, "ParameterBindings", bindings)
    children += listed(_SCOPE, "Elements", [_element_text(one, folder) for one in system.elements])
    children += listed(_SCOPE, "Connections", [connection_text(_SCOPE, one) for one in system.connections])
    children += _annotations(system)
    return tag_text(_SCOPE, SSD + "System", {"name": system.name}, children)


def _element_text(item: Element, folder: Path) -> str:
    if isinstance(item, System):
        return _system_text(item, folder)
    attributes: dict[str, str | None] = {"name": item.name}
    if isinstance(item, Component):
        assert item.source is not None
        attributes["type"] = item.type
        attributes["source"] = quote(Path(os.path.relpath(item.source, folder)).as_posix())
        attributes["implementation"] = None if item.implementation == "any" else item.implementation
    children = listed(_SCOPE, "Connectors", [connector_text(_SCOPE, one) for one in item.connectors])
    children += listed(_SCOPE, "ParameterBindings", [binding_text(_SCOPE, one) for one in item.parameter_bindings])
    children += _annotations(item)
    return tag_text(_SCOPE, SSD + type(item).__name__, attributes, children)


def _annotations(item: Element) -> list[str]:
    return listed(_SCOPE, "Annotations", [_annotation_text(one.element) for one in item.annotations])


def _annotation_text(annotation: etree._Element) -> str:
    """Returns an annotation unchanged; namespaces that the document declares are not declared again."""
    copy = etree.fromstring(etree.tostring(annotation, with_tail=False), etree.XMLParser(remove_blank_text=True))
    etree.indent(copy)
    text = etree.tostring(copy, encoding="ascii").decode("ascii")
    for prefix, uri in _SCOPE.items():
        text = text.replace(f' xmlns:{prefix}="{uri}"', "")
    return text


def _enumerations(connectors: Iterable[Connector]) -> str:
    found = {one.enumeration: one.items for one in connectors if one.type == "Enumeration" and one.enumeration}
    made = []
    for name, items in found.items():
        texts = [
            tag_text(_SCOPE, SSC + "Item", {"name": item, "value": str(value)}) for item, value in (items or {}).items()
        ]
        made.append(tag_text(_SCOPE, SSC + "Enumeration", {"name": name}, texts))
    return tag_text(_SCOPE, SSD + "Enumerations", {}, made) if made else ""


def _units(connectors: Sequence[Connector]) -> str:
    found = {one.unit.name: one.unit.base for one in connectors if one.unit is not None}
    made = []
    for name, base in sorted(found.items()):
        texts = []
        if base is not None:
            powers = {one: str(n) for one, n in zip(BASE_UNITS, base.exponents, strict=True) if n}
            numbers = {"factor": repr(base.factor), "offset": repr(base.offset)}
            texts.append(tag_text(_SCOPE, SSC + "BaseUnit", {**powers, **numbers}))
        made.append(tag_text(_SCOPE, SSC + "Unit", {"name": name}, texts))
    return tag_text(_SCOPE, SSD + "Units", {}, made) if made else ""

"""Writes a multi-model as an SSP folder: SystemStructure.ssd, and the FMUs in resources/.

Only what a multi-model can say is written (FMUs, connections, parameters, step size, start and stop time). To change an
SSP that exists, keeping everything in it, is another matter; see `edit`.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from urllib.parse import quote

from lxml import etree

from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.multimodel import read_multimodel
from cosim_master.system import Component, Parameter, SystemStructure

__all__ = ["convert"]

_NAMESPACES = {
    kind: f"http://ssp-standard.org/SSP1/SystemStructure{name}"
    for kind, name in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
}


def convert(multimodel: str | Path, folder: Path) -> Path:
    """Write a multi-model as a folder with a SystemStructure.ssd.

    Args:
        multimodel: the .json file.
        folder: where to; must not exist.

    Returns:
        The folder.

    Raises:
        SystemDescriptionError: the multi-model is wrong, or the folder exists or cannot be written.
    """
    with read_multimodel(multimodel) as structure:
        if structure.problems:
            raise SystemDescriptionError(structure.problems)
        if folder.exists():
            raise SystemDescriptionError([Problem(Where(str(folder)), "exists already; give a folder that does not")])
        try:
            (folder / "resources").mkdir(parents=True)
            sources = _copied(structure, folder)
            document = _document(structure, sources)
            document.write(folder / "SystemStructure.ssd", xml_declaration=True, encoding="UTF-8", pretty_print=True)
        except OSError as error:
            raise SystemDescriptionError([Problem(Where(str(folder)), f"cannot be written: {error}")]) from None
    return folder


def _copied(structure: SystemStructure, folder: Path) -> dict[Path, str]:
    """Copies of the FMUs: the file of each -> its path in the folder. Files of one name get a number."""
    copied: dict[Path, str] = {}
    taken: set[str] = set()
    for component in structure.system.elements:
        assert isinstance(component, Component) and component.source is not None
        source = component.source.resolve()
        if source in copied:
            continue
        name, n = source.name, 1
        while name.lower() in taken:
            n += 1
            name = f"{source.stem}_{n}{source.suffix}"
        taken.add(name.lower())
        shutil.copyfile(source, folder / "resources" / name)
        copied[source] = f"resources/{quote(name)}"
    return copied


def _tag(kind: str, name: str) -> str:
    return f"{{{_NAMESPACES[kind]}}}{name}"


def _document(structure: SystemStructure, sources: dict[Path, str]) -> etree._ElementTree:
    attributes = {"version": "1.0", "name": structure.name}
    root = etree.Element(_tag("ssd", "SystemStructureDescription"), attributes, nsmap=_NAMESPACES)
    system = etree.SubElement(root, _tag("ssd", "System"), {"name": structure.system.name})
    elements = etree.SubElement(system, _tag("ssd", "Elements"))
    for component in structure.system.elements:
        assert isinstance(component, Component) and component.source is not None
        _component(elements, component, sources[component.source.resolve()])
    connections = etree.SubElement(system, _tag("ssd", "Connections"))
    for connection in structure.system.connections:
        ends = {
            "startElement": connection.start_element or "",
            "startConnector": connection.start_connector,
            "endElement": connection.end_element or "",
            "endConnector": connection.end_connector,
        }
        etree.SubElement(connections, _tag("ssd", "Connection"), ends)
    if not len(connections):
        system.remove(connections)
    if structure.system.annotations:
        annotations = etree.SubElement(system, _tag("ssd", "Annotations"))
        annotations.extend(annotation.element for annotation in structure.system.annotations)
    if structure.start_time is not None or structure.stop_time is not None:
        times = {"startTime": structure.start_time, "stopTime": structure.stop_time}
        given = {name: repr(value) for name, value in times.items() if value is not None}
        etree.SubElement(root, _tag("ssd", "DefaultExperiment"), given)
    return etree.ElementTree(root)


def _component(parent: etree._Element, component: Component, source: str) -> None:
    made = etree.SubElement(
        parent, _tag("ssd", "Component"), {"name": component.name, "type": component.type, "source": source}
    )
    if component.connectors:
        connectors = etree.SubElement(made, _tag("ssd", "Connectors"))
        for connector in component.connectors:
            etree.SubElement(connectors, _tag("ssd", "Connector"), {"name": connector.name, "kind": connector.kind})
    for binding in component.parameter_bindings:
        bindings = etree.SubElement(made, _tag("ssd", "ParameterBindings"))
        values = etree.SubElement(
            etree.SubElement(bindings, _tag("ssd", "ParameterBinding")), _tag("ssd", "ParameterValues")
        )
        head = {"version": "1.0", "name": component.name}
        parameters = etree.SubElement(
            etree.SubElement(values, _tag("ssv", "ParameterSet"), head), _tag("ssv", "Parameters")
        )
        for parameter in binding.parameters:
            typed = etree.SubElement(parameters, _tag("ssv", "Parameter"), {"name": parameter.name})
            etree.SubElement(typed, _tag("ssv", parameter.type), {"value": _text(parameter)})


def _text(parameter: Parameter) -> str:
    value = parameter.value
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)

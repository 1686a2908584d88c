"""Parts of a system as the XML text of an .ssd, for `save`. See `ssd` and `ssv` for their meaning in the standard."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from cosim_master.files.xml_edit import tag_text
from cosim_master.fmi.description.units import BASE_UNITS, Unit
from cosim_master.system.reading.ssp.grammar import SSC, SSD, SSV
from cosim_master.system.structure import (
    Connection,
    Connector,
    LinearTransformation,
    Parameter,
    ParameterBinding,
    Transformation,
)

__all__ = [
    "Scope",
    "binding_text",
    "connection_attributes",
    "connection_text",
    "connector_text",
    "listed",
    "parameter_text",
    "transformation_text",
    "type_text",
    "value_text",
]

Scope: TypeAlias = Mapping[str, str]
"""Namespaces by prefix at the future place of the text."""


def listed(scope: Scope, plural: str, texts: list[str]) -> list[str]:
    return [tag_text(scope, SSD + plural, {}, texts)] if texts else []


def type_text(scope: Scope, item: Connector) -> str | None:
    if item.type is None:
        return None
    attributes: dict[str, str | None] = {"unit": None if item.unit is None else item.unit.name}
    if item.type == "Enumeration":
        attributes["name"] = item.enumeration
    elif item.type == "Binary":
        attributes["mime-type"] = item.mime_type
    return tag_text(scope, SSC + item.type, attributes)


def connector_text(scope: Scope, item: Connector) -> str:
    kind = type_text(scope, item)
    sizes = [
        tag_text(
            scope, SSC + "Dimension", {"size": None if d.size is None else str(d.size), "sizeConnector": d.connector}
        )
        for d in item.dimensions
    ]
    children = ([] if kind is None else [kind]) + sizes
    return tag_text(scope, SSD + "Connector", {"name": item.name, "kind": item.kind}, children)


def connection_attributes(item: Connection) -> dict[str, str | None]:
    return {
        "startElement": item.start_element,
        "startConnector": item.start_connector,
        "startIndices": " ".join(map(str, item.start_indices)) or None,
        "endElement": item.end_element,
        "endConnector": item.end_connector,
        "endIndices": " ".join(map(str, item.end_indices)) or None,
        "suppressUnitConversion": "true" if item.suppress_unit_conversion else None,
    }


def connection_text(scope: Scope, item: Connection) -> str:
    inner = transformation_text(scope, item.transformation)
    return tag_text(scope, SSD + "Connection", connection_attributes(item), [] if inner is None else [inner])


def transformation_text(scope: Scope, item: Transformation | None) -> str | None:
    if item is None:
        return None
    if isinstance(item, LinearTransformation):
        factor = None if item.factor == 1.0 else _plain(item.factor)
        offset = None if item.offset == 0.0 else _plain(item.offset)
        return tag_text(scope, SSC + "LinearTransformation", {"factor": factor, "offset": offset})
    entries = [
        tag_text(scope, SSC + "MapEntry", {"source": _plain(source), "target": _plain(target)})
        for source, target in item.entries
    ]
    return tag_text(scope, f"{SSC}{item.type}MappingTransformation", {}, entries)


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value).replace("inf", "INF").replace("nan", "NaN")
    return str(value)


def binding_text(scope: Scope, item: ParameterBinding) -> str:
    if "" not in scope and SSV[1:-1] not in scope.values():
        inner: Scope = {**scope, "": SSV[1:-1]}
    else:
        inner = scope
    parameters = [parameter_text(inner, one) for one in item.parameters]
    units = {one.unit.name: one.unit for one in item.parameters if one.unit is not None and one.unit.base is not None}
    children = [tag_text(inner, SSV + "Parameters", {}, parameters)]
    if units:
        children.append(tag_text(inner, SSV + "Units", {}, [_unit_text(inner, unit) for unit in units.values()]))
    shape = any(one.shape for one in item.parameters)
    made = tag_text(scope, SSV + "ParameterSet", {"version": "2.0" if shape else "1.0", "name": "values"}, children)
    values = tag_text(scope, SSD + "ParameterValues", {}, [made])
    return tag_text(scope, SSD + "ParameterBinding", {"prefix": item.prefix or None}, [values])


def _unit_text(scope: Scope, unit: Unit) -> str:
    assert unit.base is not None
    powers = {name: str(power) for name, power in zip(BASE_UNITS, unit.base.exponents, strict=True) if power}
    numbers = {"factor": (unit.base.factor, 1.0), "offset": (unit.base.offset, 0.0)}
    more = {name: _plain(value) for name, (value, default) in numbers.items() if value != default}
    return tag_text(scope, SSC + "Unit", {"name": unit.name}, [tag_text(scope, SSC + "BaseUnit", {**powers, **more})])


def value_text(scope: Scope, item: Parameter) -> str:
    unit = None if item.unit is None else item.unit.name
    if item.shape and item.type in ("String", "Enumeration", "Binary"):
        values = [tag_text(scope, SSV + "Value", {"value": _plain(one)}) for one in item.elements]
        return tag_text(scope, SSV + item.type, {}, values)
    text = " ".join(_plain(one) for one in item.elements) if item.shape else _plain(item.value)
    return tag_text(scope, SSV + item.type, {"value": text, "unit": unit})


def parameter_text(scope: Scope, item: Parameter) -> str:
    sizes = [tag_text(scope, SSC + "Dimension", {"size": str(size)}) for size in item.shape]
    return tag_text(scope, SSV + "Parameter", {"name": item.name}, [value_text(scope, item), *sizes])

"""modelDescription.xml of a model (FMI 2.0.5, co-simulation), generated from its declaration."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator
from contextlib import suppress
from enum import IntEnum
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from cosim.build.faults import place
from cosim.build.units import BASE, base_unit
from cosim.build.verdicts import verdicts
from cosim.model import FlatVariable, Model, Variable, flat_variables
from cosim.verdict import ANNOTATION as VERDICT

__all__ = ["PACKET_TOOL", "as_text", "complete", "model_description", "type_definitions", "unit_definitions"]

PACKET_TOOL = "uav-cosim"
"""Tool name of our vendor annotation for String variables that carry MAVLink packets."""


def _other_types(model: type[Model]) -> Iterator[str]:
    """Yields what a model declares as something else than it must be."""
    step, variables = model.step_size, model.variables
    if isinstance(step, bool) or not isinstance(step, int | float) or not math.isfinite(step):
        yield f"step_size is {step!r}; give a number of seconds"
    if not isinstance(variables, tuple):
        yield f"variables is a {type(variables).__name__}; give a tuple: variables = (Input(...), Output(...))"
        return
    for one in variables:
        for name in ("unit", "description"):
            value = getattr(one, name)
            if value is not None and not isinstance(value, str):
                yield f"{name} of {one.name} is {value!r}; give a text"
            elif value is not None and (wrong := _NOT_IN_XML.search(value)):
                yield f"{name} of {one.name} has the character {wrong[0]!r}, which XML cannot contain"


_NOT_IN_XML = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def _place_of(model: type[Model]) -> str:
    with suppress(OSError, TypeError):  # a class that no file defines has no line
        return f"{place(inspect.getfile(model), inspect.getsourcelines(model)[1])}: "
    return ""


def complete(model: type[Model]) -> str:
    """Returns the first line of a model's docstring.

    Raises:
        ValueError: the model lacks what every model declares, or declares it as something else.
    """
    if wrong := next(_other_types(model), None):
        raise ValueError(f"{_place_of(model)}{model.__name__}: {wrong}")
    summary = next(iter((model.__doc__ or "").strip().splitlines()), "")
    needs = {"a docstring": summary, "a step_size > 0": model.step_size > 0.0, "variables": model.variables}
    if lacking := [what for what, has in needs.items() if not has]:
        text = f"{_place_of(model)}{model.__name__}: a model needs a docstring, a step_size > 0 and variables"
        raise ValueError(f"{text}; this one has no {' and no '.join(one.removeprefix('a ') for one in lacking)}")
    if model.kernels is None and model.do_step is Model.do_step:
        raise ValueError(f"{_place_of(model)}{model.__name__}: it has neither kernels nor a do_step")
    return summary


def degrees_of(model: type[Model]) -> list[str]:
    """Returns each start value in rad that is more than a full turn and can only be degrees, with file and line."""
    angles = ((one.name, one.start) for one in flat_variables(model.variables) if one.variable.unit == "rad")
    return [
        f"{_place_of(model)}{model.__name__}.{name} is {float(start):g} rad, more than a full turn; "
        f"did you mean {math.radians(float(start)):.6g} (= {float(start):g} degrees)?"
        for name, start in angles
        if 2.0 * math.pi < abs(float(start)) <= 360.0
    ]


def model_description(model: type[Model], guid: str, *, compiled: bool) -> Element:
    """Returns the complete document.

    Raises:
        ValueError: a unit is unknown, or the model has no docstring, step size or variables.
    """
    summary = complete(model)
    flat = flat_variables(model.variables)
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model.__name__,
        guid=guid,
        description=summary,
        generationTool="uav-cosim",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
    keeps_state = str(model.kernels is not None).lower()
    SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.__name__,
        needsExecutionTool=str(not compiled).lower(),
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate=keeps_state,
        canSerializeFMUstate=keeps_state,
        canNotUseMemoryManagementFunctions="true",
    )
    unit_definitions(root, model.variables)
    type_definitions(root, model.variables)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="why a call failed")
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(model.step_size))
    packets = [v for v in model.variables if v.kind == "Packets"]
    judged = verdicts(model.variables)
    if packets or judged is not None:
        vendor = SubElement(root, "VendorAnnotations")
    if packets:
        ports = SubElement(SubElement(vendor, "Tool", name=PACKET_TOOL), "PacketPorts")  # the schema allows one element
        for v in packets:
            mime = "application/x-mavlink;version=2"
            SubElement(ports, "PacketPort", variable=v.name, mimeType=mime, maxSize=str(v.capacity))
    if judged is not None:
        SubElement(vendor, "Tool", name=VERDICT).append(judged)
    variables = SubElement(root, "ModelVariables")
    for reference, one in enumerate(flat):
        variables.append(_scalar_variable(one, reference))
    _model_structure(root, flat)
    return root


def as_text(root: Element) -> str:
    """Returns the document as UTF-8 text with an XML declaration."""
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def unit_definitions(root: Element, variables: tuple[Variable, ...]) -> None:
    """Adds UnitDefinitions, which are the same in FMI 2 and 3.

    Raises:
        ValueError: a unit is unknown.
    """
    units = sorted({v.unit for v in variables if v.unit not in (None, "1")} - {None})
    if not units:
        return
    definitions = SubElement(root, "UnitDefinitions")
    for name in units:
        assert name is not None
        try:
            base = base_unit(name)
        except ValueError as error:
            one = next(v.name for v in variables if v.unit == name)
            raise ValueError(f"{root.get('modelName')}: variable {one}: {error}") from None
        attributes = {symbol: str(e) for symbol, e in zip(BASE, base.exponents, strict=True) if e}
        if base.factor != 1.0:
            attributes["factor"] = repr(base.factor)
        if base.offset:
            attributes["offset"] = repr(base.offset)
        SubElement(SubElement(definitions, "Unit", name=name), "BaseUnit", attributes)


def type_definitions(root: Element, variables: tuple[Variable, ...], *, fmi: int = 2) -> None:
    """Adds TypeDefinitions with the enumerations of `variables`."""
    enumerations: dict[str, type[IntEnum]] = {v.enumeration.__name__: v.enumeration for v in variables if v.enumeration}
    if not enumerations:
        return
    definitions = SubElement(root, "TypeDefinitions")
    for name, enumeration in sorted(enumerations.items()):
        if fmi == 3:
            items = SubElement(definitions, "EnumerationType", name=name)
        else:
            items = SubElement(SubElement(definitions, "SimpleType", name=name), "Enumeration")
        for item in enumeration:
            SubElement(items, "Item", name=item.name, value=str(int(item)))


def _scalar_variable(one: FlatVariable, reference: int) -> Element:
    v = one.variable
    attributes = {"name": one.name, "valueReference": str(reference)}
    if v.description:
        attributes["description"] = v.description
    continuous = v.kind == "Real"
    if v.role == "parameter":
        attributes |= {"causality": "parameter", "variability": "tunable" if v.tunable else "fixed", "initial": "exact"}
    elif v.role in ("input", "packet input"):
        attributes |= {"causality": "input", "variability": "continuous" if continuous else "discrete"}
    else:
        attributes["causality"] = "local" if v.role == "state" else "output"
        attributes |= {"variability": "continuous" if continuous else "discrete", "initial": "calculated"}
    element = Element("ScalarVariable", attributes)
    typed: dict[str, str] = {}
    if v.enumeration:
        typed["declaredType"] = v.enumeration.__name__
    if v.kind == "Real" and v.unit not in (None, "1"):
        typed["unit"] = str(v.unit)
    for key, limit in (("min", v.minimum), ("max", v.maximum)):
        if limit is not None:
            typed[key] = repr(float(limit)) if v.kind == "Real" else str(int(limit))
    if v.role in ("parameter", "input", "packet input"):
        typed["start"] = _start(one)
    SubElement(element, "String" if v.kind == "Packets" else v.kind, typed)
    return element


def _start(one: FlatVariable) -> str:
    match one.variable.kind:
        case "Real":
            return repr(float(one.start))
        case "Boolean":
            return str(bool(one.start)).lower()
        case "Integer" | "Enumeration":
            return str(int(one.start))
        case _:
            return str(one.start)


def _model_structure(root: Element, flat: tuple[FlatVariable, ...]) -> None:
    """Adds ModelStructure: outputs depend on their declared inputs, initially also on every parameter."""
    structure = SubElement(root, "ModelStructure")
    indices: dict[str, list[int]] = {}
    for index, one in enumerate(flat, start=1):
        indices.setdefault(one.variable.name, []).append(index)
    parameters = [i for i, one in enumerate(flat, start=1) if one.variable.role == "parameter"]
    outputs = [(i, one) for i, one in enumerate(flat, start=1) if one.variable.role in ("output", "packet output")]
    if not outputs:
        return
    for tag, always in (("Outputs", []), ("InitialUnknowns", parameters)):
        group = SubElement(structure, tag)
        dependencies: dict[str, str] = {}  # of the elements of each variable, which are the same
        for index, one in outputs:
            variable = one.variable
            if variable.name not in dependencies:
                known = sorted({*always, *(i for name in variable.depends for i in indices[name])})
                dependencies[variable.name] = " ".join(map(str, known))
            SubElement(group, "Unknown", index=str(index), dependencies=dependencies[variable.name])

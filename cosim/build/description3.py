"""modelDescription.xml and terminalsAndIcons.xml of a model (FMI 3.0.2, co-simulation).

Both are generated from the declaration. Arrays remain arrays, packets are Binary. A variable's value reference is its
index in the declaration; the independent variable, time, follows the last one.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from cosim.build.description import complete, type_definitions, unit_definitions
from cosim.build.verdicts import verdicts
from cosim.model import Model, Variable
from cosim.vehicle import MOTION_INPUTS, VEHICLE_INPUTS
from cosim.verdict import ANNOTATION as VERDICT

__all__ = ["PACKET_MIME_TYPE", "TIME", "exported", "model_description3", "terminals"]

PACKET_MIME_TYPE = "application/x-mavlink;version=2"
TIME = "time"
_TYPES = {"Real": "Float64", "Integer": "Int32", "Packets": "Binary"}
_VEHICLE = ("motor", *(v.name for v in MOTION_INPUTS))


def exported(model: type[Model]) -> tuple[Variable, ...]:
    """Returns the variables of a model that FMI exposes, in the order of their value references.

    Raises:
        ValueError: a variable is named "time", the name of the independent variable.
    """
    variables = tuple(v for v in model.variables if v.kind != "Memory")
    if any(v.name == TIME for v in variables):
        raise ValueError(f"{model.__name__}.{TIME}: in FMI 3 this is the independent variable; choose another name")
    return variables


def model_description3(model: type[Model], token: str) -> Element:
    """Returns the complete document.

    Raises:
        ValueError: a unit is unknown, a name is reserved, or the model has no docstring, step size or variables.
    """
    summary = complete(model)
    variables = exported(model)
    root = Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=model.__name__,
        instantiationToken=token,
        description=summary,
        generationTool="uav-cosim",
        variableNamingConvention="structured",
    )
    SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.__name__,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="true",
    )
    unit_definitions(root, model.variables)
    type_definitions(root, model.variables, fmi=3)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="why a call failed")
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(model.step_size))
    described = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        described.append(_variable(variable, reference))
    time = {"name": TIME, "valueReference": str(len(variables)), "causality": "independent"}
    SubElement(described, "Float64", time | {"variability": "continuous", "description": "simulation time, s"})
    _model_structure(root, variables)
    judged = verdicts(model.variables)
    if judged is not None:
        SubElement(SubElement(root, "Annotations"), "Annotation", type=VERDICT).append(judged)
    return root


def _variable(v: Variable, reference: int) -> Element:
    attributes = {"name": v.name, "valueReference": str(reference)}
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
    if v.enumeration:
        attributes["declaredType"] = v.enumeration.__name__
    if v.kind == "Real" and v.unit not in (None, "1"):
        attributes["unit"] = str(v.unit)
    for key, limit in (("min", v.minimum), ("max", v.maximum)):
        if limit is not None:
            attributes[key] = repr(float(limit)) if v.kind == "Real" else str(int(limit))
    settable = v.role in ("parameter", "input", "packet input")
    if v.kind == "Packets":
        attributes |= {"mimeType": PACKET_MIME_TYPE, "maxSize": str(v.capacity)}
    elif settable:
        attributes["start"] = _start(v)
    element = Element(_TYPES.get(v.kind, v.kind), attributes)
    for size in v.shape:
        SubElement(element, "Dimension", start=str(size))
    if v.kind == "Packets" and settable:
        SubElement(element, "Start", value="")
    return element


def _start(v: Variable) -> str:
    count = v.shape[0] if v.shape else 1
    values = v.start if isinstance(v.start, tuple) else (v.start,) * count
    match v.kind:
        case "Real":
            return " ".join(repr(float(x)) for x in values)
        case "Boolean":
            return " ".join(str(bool(x)).lower() for x in values)
        case _:
            return " ".join(str(int(x)) for x in values)


def _model_structure(root: Element, variables: tuple[Variable, ...]) -> None:
    """Adds ModelStructure: outputs depend on their declared inputs, initially also on every parameter."""
    structure = SubElement(root, "ModelStructure")
    number = {v.name: i for i, v in enumerate(variables)}
    parameters = [i for i, v in enumerate(variables) if v.role == "parameter"]
    for tag, always in (("Output", []), ("InitialUnknown", parameters)):
        for reference, v in enumerate(variables):
            if v.role in ("output", "packet output"):
                known = sorted({*always, *(number[name] for name in v.depends)})
                unknown = {"valueReference": str(reference), "dependencies": " ".join(map(str, known))}
                SubElement(structure, tag, unknown)


def terminals(model: type[Model]) -> Element | None:
    """Returns terminalsAndIcons.xml with vehicle, autopilot, wind and packet terminals; None if there are none.

    Vehicle and autopilot have a terminal "vehicle" with the same members, outputs on one side and inputs on the other,
    so that the matching rule "plug" connects them. A pair of packet ports NAME_rx and NAME_tx is the terminal NAME.
    """
    ports = {v.name: v for v in exported(model) if v.role not in ("parameter", "state")}
    groups = []
    if all(name in ports for name in _VEHICLE):
        groups.append(("vehicle", "plug", "org.uav-cosim.vehicle", _VEHICLE))
    wind = next(v.name for v in VEHICLE_INPUTS if v.name == "wind")
    if wind in ports:
        groups.append(("environment", "plug", "org.uav-cosim.environment", (wind,)))
    links: dict[str, list[str]] = {}
    for v in ports.values():
        if v.kind == "Packets":
            link = v.name.removesuffix("_rx").removesuffix("_tx")
            whole = {f"{link}_rx", f"{link}_tx"} <= ports.keys()
            links.setdefault(link if whole else "mavlink", []).append(v.name)
    groups += [(link, "none", "org.uav-cosim.mavlink", tuple(names)) for link, names in links.items()]
    if not groups:
        return None
    root = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    listed = SubElement(root, "Terminals")
    for name, rule, kind, members in groups:
        terminal = SubElement(listed, "Terminal", name=name, matchingRule=rule, terminalKind=kind)
        for member in members:
            attributes = {"variableName": member, "memberName": member, "variableKind": "signal"}
            SubElement(terminal, "TerminalMemberVariable", attributes)
    return root

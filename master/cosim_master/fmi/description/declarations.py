"""The meanings that an FMU declares in its vendor annotation `org.uav-cosim.verdict`: see `cosim.build.verdicts`.

An FMU without the annotation declares no meanings. An error in it is only a note, since an FMU can run without them.
The manifest of a run contains, as JSON, the meanings that figures need.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from lxml import etree

from cosim.verdict import (
    ANNOTATION,
    Bound,
    Condition,
    Formation,
    Logged,
    Neighbour,
    Reason,
    Role,
    Rotors,
    Values,
    Verdict,
    references,
)
from cosim_master.fmi.description.variables import Variable

__all__ = ["elements_of", "read_verdicts", "verdicts_as_json", "verdicts_of_json"]

_PLACES = (
    f"VendorAnnotations/Tool[@name='{ANNOTATION}']/Verdicts",
    f"Annotations/Annotation[@type='{ANNOTATION}']/Verdicts",
)
_TYPES: Mapping[object, tuple[str, tuple[str, ...], int]] = {
    Condition: ("output", ("Enumeration", "Integer", "Boolean"), 1),
    Reason: ("output", ("Enumeration", "Integer"), 1),
    Bound: ("output", ("Real", "Integer"), 1),
    Formation: ("output", ("Real",), 1),
    Role.POSITION: ("output", ("Real",), 3),
    Role.ATTITUDE: ("output", ("Real",), 4),
    Role.VELOCITY: ("output", ("Real",), 3),
    Role.ANGULAR_VELOCITY: ("output", ("Real",), 3),
    Role.ON_GROUND: ("output", ("Boolean",), 1),
    Role.ARMED: ("output", ("Boolean",), 1),
    Role.DESIRED_POSITION: ("output", ("Real",), 3),
    Role.START_POSITION: ("parameter", ("Real",), 3),
    Role.ORIGIN_LATITUDE: ("parameter", ("Real",), 1),
    Role.ORIGIN_LONGITUDE: ("parameter", ("Real",), 1),
    Role.ORIGIN_ALTITUDE: ("parameter", ("Real",), 1),
    Role.JAMMED_RADIUS: ("parameter", ("Real",), 1),
    Role.JAMMED_NORTH: ("parameter", ("Real",), 1),
    Role.JAMMED_EAST: ("parameter", ("Real",), 1),
    Role.JAMMED_FROM: ("parameter", ("Real",), 1),
    Role.JAMMED_UNTIL: ("parameter", ("Real",), 1),
    Role.SYSTEM_ID: ("parameter", ("Integer",), 1),
}
"""Causality, types and number of elements of variables that may have a verdict, except for ports, Rotors, Logged
and Values."""
_ROLES = {role.value: role for role in Role}


def elements_of(name: str, variables: Mapping[str, Variable]) -> tuple[str, ...]:
    """Returns the variable of a name, or the elements of the array of that name; empty if neither exists."""
    if name in variables:
        return (name,)
    found: list[str] = []
    while (element := f"{name}[{len(found) + 1}]") in variables:
        found.append(element)
    return tuple(found)


def read_verdicts(root: etree._Element, variables: Mapping[str, Variable], notes: list[str]) -> dict[str, Verdict]:
    """Returns verdicts by the name of their variable or array; `notes` receives the invalid ones."""
    found: dict[str, Verdict] = {}
    for element in _annotated(root):
        name = element.get("variable", "")
        try:
            found[name] = _checked(name, _read(element), variables)
        except ValueError as error:
            notes.append(f'its verdict <{etree.QName(element).localname}> of "{name}" is ignored: {error}')
    return found


def _annotated(root: etree._Element) -> Iterator[etree._Element]:
    for place in _PLACES:
        for verdicts in root.iterfind(place):
            yield from (element for element in verdicts if isinstance(element.tag, str))


def _read(element: etree._Element) -> Verdict:
    tag = etree.QName(element).localname
    if tag in _ROLES:
        return _ROLES[tag]
    if tag == "Condition":
        values: dict[str, Any] = {what: _values(element, what) for what in ("failed", "working", "commanding")}
        return Condition(**values, by=element.get("by", ""), reason=element.get("reason", ""))
    if tag == "Reason":
        return Reason(tuple((int(text.get("value", "")), text.text or "") for text in element.iterfind("Text")))
    if tag == "Bound":
        least, most = _number(element.get("least", "-inf")), element.get("most", "inf")
        if isinstance(least, str):
            raise ValueError(f'least="{least}" must be a number')
        return Bound(_number(most), least, element.get("of", ""), (element.text or "").strip())
    if tag == "Values":
        return Values(_values(element, "values"))
    if tag == "Formation":
        others = {what: element.get(what, "") for what in ("step", "stays", "begin", "period")}
        return Formation(neighbours=tuple(map(_neighbour, element.iterfind("Neighbour"))), **others)
    if tag == "Rotors":
        return Rotors(**{field.name: element.get(field.name, "") for field in fields(Rotors)})
    if tag == "Logged":
        return Logged(tuple((one.get("of", ""), one.get("variable", "")) for one in element.iterfind("Value")))
    known = ("Condition", "Reason", "Bound", "Values", "Formation", "Rotors", "Logged", *_ROLES)
    raise ValueError(f"there are {', '.join(known)}")


def _neighbour(element: etree._Element) -> Neighbour:
    if not element.get("id") or not element.get("gain"):
        raise ValueError("<Neighbour> needs the attributes id, a parameter, and gain, a parameter or a number")
    return Neighbour(element.get("id", ""), _number(element.get("gain", "")))


def _values(element: etree._Element, what: str) -> tuple[int, ...]:
    return tuple(int(value) for value in element.get(what, "").split())


def _number(text: str) -> float | str:
    """Returns a number, or the name of a variable unchanged."""
    try:
        value = float(text)
    except ValueError:
        return text
    if math.isnan(value):
        raise ValueError("a number must not be NaN")
    return value


def _checked(name: str, verdict: Verdict, variables: Mapping[str, Variable]) -> Verdict:
    """Returns the verdict.

    Raises:
        ValueError: the verdict does not apply to this variable, or names a variable that does not exist.
    """
    elements = [variables[element] for element in elements_of(name, variables)]
    if not elements:
        raise ValueError("there is no such variable")
    if verdict in (Role.OPTIONAL, Role.TELEMETRY, Role.SERIAL):
        _check_port(verdict, elements[0])
        return verdict
    if isinstance(verdict, Rotors):
        _check_rotors(verdict, elements, variables)
        return verdict
    if isinstance(verdict, Logged):
        for place, other in verdict.variables:
            if not place or not elements_of(other, variables):
                raise ValueError(
                    f'<Value of="{place}"> needs a place in the log, and a variable: there is no "{other}"'
                )
        return verdict
    if isinstance(verdict, Values):
        if len(elements) != 1 or elements[0].causality not in ("input", "output") or elements[0].type != "Enumeration":
            raise ValueError("it must be an input or output of type Enumeration")
        return verdict
    causality, types, size = _TYPES[verdict if isinstance(verdict, Role) else type(verdict)]
    first = elements[0]
    if len(elements) != size or first.causality != causality or first.type not in types or first.wide:
        raise ValueError(f"it must be of causality {causality} and type {' or '.join(types)}, with {size} elements")
    if isinstance(verdict, Formation) and not verdict.step:
        raise ValueError("it needs the attribute step, an output")
    for other, of, kinds in references(verdict):
        if other not in variables or variables[other].causality != of:
            raise ValueError(f'there is no {of} "{other}"')
        if variables[other].type not in kinds:
            raise ValueError(f'{of} "{other}" is of type {variables[other].type}, it must be {" or ".join(kinds)}')
    return verdict


def _check_port(verdict: Verdict, variable: Variable) -> None:
    """Raises ValueError if a role of inputs, or one of packet ports, does not apply to the variable."""
    if verdict is Role.OPTIONAL and variable.causality not in ("input", "output"):
        raise ValueError(f"it is of causality {variable.causality}, only inputs and outputs are optional")
    if verdict is not Role.OPTIONAL and variable.packet_capacity is None:
        raise ValueError(f"it is of type {variable.type} and not a packet port")


def _check_rotors(verdict: Rotors, speeds: Sequence[Variable], variables: Mapping[str, Variable]) -> None:
    """Raises ValueError if the variables are not speeds of rotors, or properties of the rotors are not declared."""
    if any(one.causality != "output" or one.type != "Real" for one in speeds):
        raise ValueError("it must be of causality output and type Real")
    sizes = {verdict.count: ("Integer", 1), **{name: ("Real", len(speeds)) for name in verdict.arrays}}
    for name, (kind, size) in sizes.items():
        found = [variables[element] for element in elements_of(name, variables)]
        if len(found) != size or any("arameter" not in one.causality or one.type != kind for one in found):
            raise ValueError(f'there is no parameter "{name}" of type {kind} with {size} elements')


def verdicts_as_json(verdicts: Mapping[str, Verdict]) -> dict[str, dict[str, Any]]:
    """Returns roles, formations, rotors and places in logs by the name of their variable, for `verdicts_of_json`."""
    found: dict[str, dict[str, Any]] = {}
    for name, verdict in verdicts.items():
        if isinstance(verdict, Role):
            found[name] = {"is": verdict.value}
        elif isinstance(verdict, Formation):
            found[name] = {"is": "Formation", **asdict(verdict)}
        elif isinstance(verdict, Rotors):
            found[name] = {"is": "Rotors", **asdict(verdict)}
        elif isinstance(verdict, Logged):
            found[name] = {"is": "Logged", "variables": dict(verdict.variables)}
    return found


def _plain(told: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns a mapping to texts and numbers. Raises TypeError."""
    for name, value in told.items():
        if not isinstance(value, str | int | float):
            raise TypeError(f"{name} is {value!r}, not a text or a number")
    return told


def verdicts_of_json(told: Mapping[str, Mapping[str, Any]]) -> dict[str, Verdict]:
    """Returns the verdicts written by `verdicts_as_json`, except conditions, reasons and bounds.

    Raises:
        KeyError, TypeError, ValueError: the JSON data have another format.
    """
    found: dict[str, Verdict] = {}
    for name, one in told.items():
        told_of = dict(one)
        what = told_of.pop("is")
        if what == "Formation":
            neighbours = tuple(Neighbour(**_plain(neighbour)) for neighbour in told_of.pop("neighbours"))
            found[name] = Formation(neighbours=neighbours, **_plain(told_of))
        elif what == "Rotors":
            found[name] = Rotors(**_plain(told_of))
        elif what == "Logged":
            found[name] = Logged(tuple(_plain(told_of["variables"]).items()))
        elif what in _ROLES:
            found[name] = _ROLES[what]
    return found

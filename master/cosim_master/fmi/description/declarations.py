"""The verdicts that an FMU declares in its vendor annotation `org.uav-cosim.verdict`: see `cosim.build.verdicts`.

An FMU without the annotation declares none. A mistake in it is a note, and no more: no run depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from lxml import etree

from cosim.verdict import ANNOTATION, Bound, Condition, Reason, Role, Verdict
from cosim_master.fmi.description.variables import Variable

__all__ = ["elements_of", "read_verdicts"]

_PLACES = (
    f"VendorAnnotations/Tool[@name='{ANNOTATION}']/Verdicts",
    f"Annotations/Annotation[@type='{ANNOTATION}']/Verdicts",
)
_TYPES: Mapping[object, tuple[str, tuple[str, ...], int]] = {
    Condition: ("output", ("Enumeration", "Integer", "Boolean"), 1),
    Reason: ("output", ("Enumeration", "Integer"), 1),
    Bound: ("output", ("Real", "Integer"), 1),
    Role.POSITION: ("output", ("Real",), 3),
    Role.ON_GROUND: ("output", ("Boolean",), 1),
    Role.ARMED: ("output", ("Boolean",), 1),
    Role.DESIRED_POSITION: ("output", ("Real",), 3),
    Role.SYSTEM_ID: ("parameter", ("Integer",), 1),
}
"""Causality, types and number of elements of what may have a verdict; an input may be optional whatever it is."""
_ROLES = {role.value: role for role in Role}


def elements_of(name: str, variables: Mapping[str, Variable]) -> tuple[str, ...]:
    """The variable of a name, or the elements of the array of that name; empty if there is neither."""
    if name in variables:
        return (name,)
    found: list[str] = []
    while (element := f"{name}[{len(found) + 1}]") in variables:
        found.append(element)
    return tuple(found)


def read_verdicts(root: etree._Element, variables: Mapping[str, Variable], notes: list[str]) -> dict[str, Verdict]:
    """Verdicts by the name of their variable or array; what cannot be understood goes into `notes`."""
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
    raise ValueError(f"there are {', '.join(('Condition', 'Reason', 'Bound', *_ROLES))}")


def _values(element: etree._Element, what: str) -> tuple[int, ...]:
    return tuple(int(value) for value in element.get(what, "").split())


def _number(text: str) -> float | str:
    """A number, or the name of a variable as it is."""
    try:
        value = float(text)
    except ValueError:
        return text
    if math.isnan(value):
        raise ValueError("a bound must not be NaN")
    return value


def _checked(name: str, verdict: Verdict, variables: Mapping[str, Variable]) -> Verdict:
    """The verdict.

    Raises:
        ValueError: it is not for this variable, or names one that there is not.
    """
    elements = [variables[element] for element in elements_of(name, variables)]
    if not elements:
        raise ValueError("there is no such variable")
    if verdict is Role.OPTIONAL:
        if elements[0].causality != "input":
            raise ValueError(f"it is of causality {elements[0].causality}, only inputs are optional")
        return verdict
    causality, types, size = _TYPES[verdict if isinstance(verdict, Role) else type(verdict)]
    first = elements[0]
    if len(elements) != size or first.causality != causality or first.type not in types or first.wide:
        raise ValueError(f"it must be of causality {causality} and type {' or '.join(types)}, with {size} elements")
    others: list[tuple[str, str]] = []
    if isinstance(verdict, Condition):
        others = [(verdict.by, "parameter"), (verdict.reason, "output")]
    elif isinstance(verdict, Bound):
        others = [(verdict.of, "parameter"), (verdict.most if isinstance(verdict.most, str) else "", "parameter")]
    for other, of in others:
        if other and (other not in variables or variables[other].causality != of):
            raise ValueError(f'there is no {of} "{other}"')
    return verdict

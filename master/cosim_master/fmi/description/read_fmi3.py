"""Converts modelDescription.xml of FMI 3.0 for Co-Simulation, as parsed by FMPy, to the types of `variables`.

Arrays become one variable per element. Features that the master does not support are problems or notes, never ignored
silently.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from itertools import product
from typing import Any

from lxml import etree

from cosim_master.diagnostics.limitations import CLOCKED_PACKETS, INTERMEDIATE_UPDATE, LARGE_VARIABLE, NO_MAX_SIZE
from cosim_master.fmi.description.units import BASE_UNITS, BaseUnit, Unit
from cosim_master.fmi.description.variables import Clock, Start, Variable

__all__ = ["FMI3_TYPES", "PACKET_MIME_TYPE", "Reading3", "dependencies3", "element_names"]

PACKET_MIME_TYPE = "application/x-mavlink"
FMI3_TYPES = {
    "Float32": "Real",
    "Float64": "Real",
    **{f"{sign}Int{width}": "Integer" for sign in ("", "U") for width in (8, 16, 32, 64)},
    "Boolean": "Boolean",
    "String": "String",
    "Enumeration": "Enumeration",
    "Binary": "Binary",
}
"""Types of FMI 3, and the types of the master for them."""
_MOST_DIGITS = 400
"""Largest size of a number that is kept exactly: more takes minutes and gigabytes."""
_MAX_ELEMENTS = 1 << 20
_PERIODIC = ("constant", "fixed", "tunable")
_CLOCKS = (*_PERIODIC, "changing", "countdown", "triggered")
_SECONDS = Unit("s", BaseUnit(tuple(int(name == "s") for name in BASE_UNITS), 1.0, 0.0))


def element_names(name: str, shape: Sequence[int]) -> Iterator[str]:
    """Returns the names of the elements of an array, in row-major order: a[1], a[2]; m[1,1], m[1,2], m[2,1], ..."""
    for indices in product(*(range(1, size + 1) for size in shape)):
        yield f"{name}[{','.join(map(str, indices))}]"


class Reading3:
    """The variables of one FMI 3 description.

    Args:
        model: FMPy's ModelDescription.
        units: by name.
        elements: the XML element of every variable, by name, for data that FMPy does not store.
        problem: called with fatal problems.
        sizes: values of structural parameters in place of the FMU's own.
    """

    def __init__(
        self,
        model: Any,
        units: Mapping[str, Unit],
        elements: Mapping[str, etree._Element],
        problem: Callable[[str], None],
        sizes: Mapping[str, int],
    ) -> None:
        self.variables: dict[str, Variable] = {}
        self.shapes: dict[str, tuple[int, ...]] = {}
        self.notes: list[str] = []
        self._units, self._elements, self._problem = units, elements, problem
        structural: dict[int, tuple[str, int | None]] = {}
        self._may_be_empty: set[str] = set()
        for v in model.modelVariables:
            # A structural parameter that is not an integer cannot be the size of an array.
            if v.causality == "structuralParameter" and FMI3_TYPES.get(v.type) == "Integer":
                own = str(v.start).strip()
                structural[int(v.valueReference)] = (v.name, sizes.get(v.name, int(own) if own.isdecimal() else None))
                if self._attributes(v).get("min") == "0" and own != "0":
                    self._may_be_empty.add(v.name)
        self._resized = {*sizes}
        for read in model.modelVariables:
            if not read.name:
                problem(f"a variable of type {read.type} is without a name")
            elif read.type == "Clock":
                self._add_clock(read)
            elif read.type not in FMI3_TYPES:
                problem(f'variable "{read.name}" is of type {read.type}; valid: {", ".join(FMI3_TYPES)}')
            else:
                self._add(read, structural)
        asking = [v.name for v in model.modelVariables if v.name and v.causality == "input" and self._intermediate(v)]
        if asking and getattr(model.coSimulation, "providesIntermediateUpdate", False):
            more = f" and {len(asking) - 3} more" if len(asking) > 3 else ""
            self.notes.append(INTERMEDIATE_UPDATE.text(", ".join(f'"{name}"' for name in asking[:3]) + more))

    def _add(self, read: Any, structural: Mapping[int, tuple[str, int | None]]) -> None:
        shape, resized = [], False
        for dimension in read.dimensions or ():
            size, name = dimension.start, ""
            if size is None:
                reference = -1 if dimension.valueReference is None else int(dimension.valueReference)
                name, size = structural.get(reference, ("", None))
                if size is None:
                    self._problem(f'a dimension of "{read.name}" has neither a size nor a structural parameter')
                    return
                resized |= name in self._resized
            if int(size) < (0 if name in self._may_be_empty else 1):
                reason = f', since "{name}" does not say min="0"' if name in self._resized else ""
                self._problem(f'a dimension of "{read.name}" has the size {size}; it must be positive{reason}')
                return
            shape.append(int(size))
        if math.prod(shape) > _MAX_ELEMENTS:
            self._problem(LARGE_VARIABLE.text(read.name, math.prod(shape), _MAX_ELEMENTS))
            return
        names = list(element_names(read.name, shape)) if shape else [read.name]
        if shape:
            self.shapes[read.name] = tuple(shape)
        starts = self._starts(read, len(names), is_array=bool(shape), resized=resized)
        for i, name in enumerate(names):
            if name in self.variables:
                self._problem(f'variable "{name}" is declared twice')
            self.variables[name] = self._variable(read, name, i if shape else None, starts[i])

    def _add_clock(self, read: Any) -> None:
        given = self._attributes(read)
        kind, causality = given.get("intervalVariability", ""), read.causality or "local"
        if kind not in _CLOCKS:
            self._problem(f'Clock "{read.name}": intervalVariability "{kind}"; valid: {", ".join(_CLOCKS)}')
            return
        if kind != "triggered" and causality != "input":
            self._problem(f'Clock "{read.name}" is {kind} and {causality}; only inputs can be time-based')
        numbers: dict[str, Fraction | None] = {}
        for name in ("intervalDecimal", "shiftDecimal", "intervalCounter", "shiftCounter", "resolution"):
            try:
                numbers[name] = _exact(given[name]) if name in given else None
            except ValueError:
                self._problem(f'Clock "{read.name}": {name} "{given[name]}" is not a number')
                return
        interval, shift = numbers["intervalDecimal"], numbers["shiftDecimal"]
        fraction = given.get("supportsFraction") in ("true", "1")
        if numbers["intervalCounter"] is not None and numbers["resolution"]:
            interval = numbers["intervalCounter"] / numbers["resolution"]
            shift = (numbers["shiftCounter"] or Fraction(0)) / numbers["resolution"]
        if kind not in _PERIODIC:
            interval = shift = None
        elif interval is None and kind == "constant":
            self._problem(f'Clock "{read.name}" is constant: it needs the attribute intervalDecimal')
        if (interval is not None and interval <= 0) or (shift or 0) < 0:
            self._problem(f'Clock "{read.name}": its interval must be positive, its shift must not be negative')
        if read.name in self.variables:
            self._problem(f'variable "{read.name}" is declared twice')
        self.variables[read.name] = Variable(
            name=read.name,
            value_reference=read.valueReference,
            type="Clock",
            causality=causality,
            variability="discrete",
            initial=None,
            unit=_SECONDS,
            minimum=1e-9,
            description=read.description or "",
            fmi_type="Clock",
            clock=Clock(kind, interval, shift or Fraction(0), fraction),
            clocks=_clocks(read),
        )

    def _intermediate(self, read: Any) -> bool:
        return self._attributes(read).get("intermediateUpdate") in ("true", "1")

    def _item(self, read: Any, item: Any) -> int:
        """Returns the value of an item of an Enumeration; an invalid one is a problem."""
        try:
            return int(item.value)
        except (TypeError, ValueError):
            given = "none" if item.value is None else f'"{item.value}"'
            self._problem(f'item "{item.name}" of the Enumeration "{read.name}" needs an integer value; it has {given}')
            return 0

    def _attributes(self, read: Any) -> Mapping[str, str]:
        """Returns the attributes of a variable's element; they override those of its declared type."""
        element = self._elements.get(read.name)
        if element is None:
            return {}
        own = {str(key): str(value) for key, value in element.attrib.items()}
        types = element.getroottree().getroot().find("TypeDefinitions")
        for declared in () if types is None else types:
            if declared.get("name") == own.get("declaredType") and "declaredType" in own:
                return {**{str(key): str(value) for key, value in declared.attrib.items()}, **own}
        return own

    def _variable(self, read: Any, name: str, element: int | None, start: Start | None) -> Variable:
        declared = read.declaredType
        element_of = self._elements.get(read.name)
        given: Mapping[str, str] = {} if element_of is None else {str(k): str(x) for k, x in element_of.attrib.items()}
        unit_name = read.unit or (declared.unit if declared is not None else None)
        unit = self._units.get(unit_name, Unit(unit_name)) if unit_name else None
        relative = given.get("relativeQuantity")
        if relative in ("true", "1") or (relative is None and declared is not None and declared.relativeQuantity):
            unit = None if unit is None else unit.relative()
        mime_type = given.get("mimeType", "application/octet-stream") if read.type == "Binary" else None
        capacity = None
        if (
            mime_type is not None
            and mime_type.partition(";")[0].strip().lower() == PACKET_MIME_TYPE
            and element is None
        ):
            size = given.get("maxSize", "")
            if size.isdigit() and 0 < int(size) < 2**31:
                capacity = int(size)
                if read.clocks:
                    capacity = None
                    self.notes.append(CLOCKED_PACKETS.text(name))
            else:
                self.notes.append(NO_MAX_SIZE.text(name))
        bounds, limits = [], self._attributes(read)
        for bound in ("min", "max"):
            text = limits.get(bound)  # FMPy does not read those of unsigned integers
            bounds.append(None if text is None else self._number(read, bound, text))
        items = None
        if read.type == "Enumeration" and declared is not None:
            items = {item.name: self._item(read, item) for item in declared.items}
        causality = read.causality or "local"
        return Variable(
            name=name,
            value_reference=read.valueReference,
            type=FMI3_TYPES[read.type],
            causality=causality,
            variability=read.variability or ("continuous" if FMI3_TYPES[read.type] == "Real" else "discrete"),
            initial=None if causality in ("input", "independent") else read.initial,
            unit=unit,
            start=start,
            minimum=bounds[0],
            maximum=bounds[1],
            items=items,
            packet_capacity=capacity,
            description=read.description or "",
            fmi_type="Int64" if read.type == "Enumeration" else read.type,
            element=element,
            mime_type=mime_type,
            clocks=_clocks(read),
        )

    def _number(self, read: Any, attribute: str, text: str) -> float | None:
        try:
            return float(text) if FMI3_TYPES[read.type] == "Real" else int(text)
        except ValueError:
            self._problem(f'{attribute} "{text}" of "{read.name}" is not a number')
            return None

    def _starts(self, read: Any, count: int, *, is_array: bool, resized: bool) -> list[Start | None]:
        """Returns one start value per element; a single value applies to all elements (FMI 3.0.2, section 2.4.7.6).

        Dependencies of an array whose size has changed are no longer valid.
        """
        if read.start is None:
            return [None] * count
        kind = FMI3_TYPES[read.type]
        if kind in ("String", "Binary"):
            element = self._elements.get(read.name)
            given = [] if element is None else [start.get("value", "") for start in element.iterfind("Start")]
        else:
            given = str(read.start).split()
        if (len(given) == 1 and is_array) or not count:
            given = list(given) * count
        if len(given) != count and resized:
            self.notes.append(f'the start values of "{read.name}" are for another size: they are not used')
            return [None] * count
        if len(given) != count:
            self._problem(f'"{read.name}" has {count} elements and {len(given)} start values')
            return [None] * count
        return [self._start(read, kind, text) for text in given]

    def _start(self, read: Any, kind: str, text: Any) -> Start | None:
        try:
            if kind == "Real":
                number = float(text)
                if math.isnan(number):
                    raise ValueError
                return number
            if kind == "Boolean":
                return {"true": True, "1": True, "false": False, "0": False}[text]
            if kind == "Binary":
                return bytes.fromhex(text).hex()
            return str(text) if kind == "String" else int(text)
        except (ValueError, KeyError):
            self._problem(f'start "{text}" of "{read.name}" is not of type {read.type}')
            return None


def _clocks(read: Any) -> tuple[str, ...]:
    return tuple(clock.name for clock in read.clocks or ())


def dependencies3(unknowns: Sequence[Any], shapes: Mapping[str, tuple[int, ...]]) -> dict[str, tuple[str, ...] | None]:
    """Returns the dependencies of each element of an unknown: all elements of the named arrays; None means all."""

    def names(name: str) -> list[str]:
        return list(element_names(name, shapes[name])) if name in shapes else [name]

    found: dict[str, tuple[str, ...] | None] = {}
    for unknown in unknowns:
        known = None
        if unknown.dependencies is not None:
            known = tuple(n for v in unknown.dependencies if v.type != "Clock" for n in names(v.name))
        if unknown.variable.type != "Clock":
            found |= dict.fromkeys(names(unknown.variable.name), known)
    return found


def _exact(text: str) -> Fraction:
    """Returns a decimal number exactly.

    Raises:
        ValueError: it is not a number, or has far more digits than a double can hold.
    """
    try:
        number = Decimal(text.strip())
    except InvalidOperation:
        raise ValueError(text) from None
    if not number.is_finite() or abs(number.adjusted()) > _MOST_DIGITS or len(text) > _MOST_DIGITS:
        raise ValueError(text)
    return Fraction(number)

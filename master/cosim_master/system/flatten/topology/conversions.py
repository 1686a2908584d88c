"""Conversions of a value between two connectors: compatible types, and mapping transformations.

Pure functions over descriptions (SSP 2.0, sections 4.5.1 and 4.5.2); units are in `units`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cosim_master.diagnostics.errors import Problem
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.system.structure import MappingTransformation

__all__ = ["MappedEnd", "compatible", "listed", "mapping_entries", "mime_types_differ"]

_WHOLE = ("Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64")
"""Integral types. An Enumeration may be connected wherever an Integer may."""


def compatible(source: str | None, target: str | None) -> bool:
    """Returns whether a value of type `source` may be passed to `target`: equal, widening without loss, or unknown.

    A Boolean is converted to numbers, with true as 1; SSP leaves such conversions to the implementation (SSP 2.0,
    5.3.2.1).
    """
    if source is None or target is None or source == target:
        return True
    if source == "Boolean":
        return target in INTEGER_RANGES or target in ("Real", "Float32")
    source = "Integer" if source == "Enumeration" else source
    target = "Integer" if target == "Enumeration" else target
    if source in INTEGER_RANGES and target in INTEGER_RANGES:
        (low, high), (lowest, highest) = INTEGER_RANGES[source], INTEGER_RANGES[target]
        return lowest <= low and high <= highest
    bits = {"Real": 53, "Float32": 24}
    if target in bits and source in INTEGER_RANGES:
        return INTEGER_RANGES[source][1] < 1 << bits[target]
    return (source, target) == ("Float32", "Real")


def mime_types_differ(source: str | None, target: str | None) -> bool:
    """Returns whether two MIME types name different formats; unspecific ones are compatible with all."""

    def plain(text: str) -> tuple[str, ...]:
        main, *rest = text.lower().split(";")
        return (main.strip(), *sorted(part.replace(" ", "").replace('"', "") for part in rest))

    if source is None or target is None:
        return False
    unknown = ("", "application/octet-stream")
    a, b = plain(source), plain(target)
    return a[0] not in unknown and b[0] not in unknown and a != b


def listed(items: Mapping[str, int]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in items.items())


@dataclass(frozen=True, slots=True)
class MappedEnd:
    """One end of a mapping transformation: its name in messages, and its type and enumeration items if known."""

    name: str
    type: str | None
    items: Mapping[str, int] | None


def mapping_entries(
    table: MappingTransformation, source: MappedEnd, target: MappedEnd, problems: list[Problem]
) -> dict[int, int]:
    """Returns the entries of a mapping transformation as numbers; `problems` receives its errors.

    Returns:
        Source value -> target value; complete only without problems.
    """

    def problem(text: str) -> None:
        problems.append(Problem(table.where, text))

    wanted = {"Boolean": ("Boolean",), "Integer": _WHOLE, "Enumeration": ("Enumeration",)}[table.type]
    for end in (source, target):
        if end.type is not None and end.type not in wanted:
            needed = "Integers or Enumerations" if table.type == "Integer" else f"{table.type}s"
            problem(f"<{table.type}MappingTransformation> is for {needed}, but {end.name} is {end.type}")
            return {}
    given, taken = source.items or {}, target.items or {}
    entries: dict[int, int] = {}
    for key, value in table.entries:
        if table.type == "Enumeration":
            lost = [(str(name), items) for name, items in ((key, given), (value, taken)) if name not in items]
            for name, items in lost:
                problem(f'"{name}" is not an item of the enumeration; {near(name, items)}')
            if not lost:
                entries[given[str(key)]] = taken[str(value)]
            continue
        if table.type == "Integer" and given and key not in given.values():
            problem(f"{key} is not a value of the enumeration of {source.name}; valid: {listed(given)}")
        low, high = INTEGER_RANGES.get(target.type or "", (-(2**63), 2**64 - 1))
        if not low <= int(value) <= high:
            problem(f"the target {value} does not fit into {target.name}; valid: {low} to {high}")
        entries[int(key)] = int(value)
    results = {entries.get(number, number) for number in given.values()} if given else set(entries.values())
    for value in sorted(results - set(taken.values())) if taken else ():
        problem(f"{value} is not a value of the enumeration of {target.name}; valid: {listed(taken)}")
    return entries

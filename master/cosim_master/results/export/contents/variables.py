"""The recorded columns by instance and variable: the elements of an array belong together."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

__all__ = ["Recorded", "recorded_variables"]

_ELEMENT = re.compile(r"(.*)\[(\d+)\]")


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recorded variable.

    Attributes:
        fields: its columns: one, or those of the elements of an array.
        is_array: whether it is an array; an array may have one element.
    """

    fields: tuple[pa.Field, ...]
    is_array: bool

    @property
    def columns(self) -> list[str]:
        return [field.name for field in self.fields]

    @property
    def type(self) -> pa.DataType:
        return self.fields[0].type

    @property
    def unit(self) -> str:
        return self._told(b"unit")

    @property
    def description(self) -> str:
        return self._told(b"description")

    def _told(self, key: bytes) -> str:
        return str((self.fields[0].metadata or {}).get(key, b"").decode())


def recorded_variables(schema: pa.Schema) -> Mapping[str, Mapping[str, Recorded]]:
    """Returns the recorded variables without the time: by instance, then by name, both in the order of the recording.

    A column without an instance is its own instance.
    """
    grouped: dict[str, dict[str, list[pa.Field]]] = {}
    arrays: set[tuple[str, str]] = set()
    for field in schema:
        if field.name == "time":
            continue
        instance, _, variable = field.name.rpartition(".")
        instance = instance or variable
        if element := _ELEMENT.fullmatch(variable):
            variable = element[1]
            arrays.add((instance, variable))
        grouped.setdefault(instance, {}).setdefault(variable, []).append(field)
    return {
        instance: {name: Recorded(tuple(fields), (instance, name) in arrays) for name, fields in variables.items()}
        for instance, variables in grouped.items()
    }

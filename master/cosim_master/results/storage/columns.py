"""The columns of recorded signals, and the places of their values in the loop's blocks."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cosim_master.results.storage.arrays import array_of, texts, values_of
from cosim_master.stepping.observation import Rows
from cosim_master.system.flatten.flat import CheckedSystem

if TYPE_CHECKING:  # recordings are read without the stepping loop, whose compiler takes half a second to import
    from cosim_master.fmi.description.variables import Variable
    from cosim_master.stepping.layout import Layout

__all__ = ["Columns", "columns_of"]

_ARROW = {"Real": pa.float64(), "Integer": pa.int32(), "Boolean": pa.bool_(), "String": pa.string()}
_WIDE = {"UInt32": pa.uint32(), "Int64": pa.int64(), "UInt64": pa.uint64()}


@dataclass(frozen=True)
class Columns:
    """The columns of a recording.

    Attributes:
        schema: column `time`, then one for each signal, with unit and description.
        places: the index of each signal among the values of its kind.
    """

    schema: pa.Schema
    places: tuple[int, ...]

    def count(self, *types: pa.DataType) -> int:
        """Returns the number of signals that have one of these types."""
        return sum(self._numbers[one] for one in types)

    @cached_property
    def _types(self) -> tuple[pa.DataType, ...]:
        """The types of the signals; a hundred thousand columns have a few."""
        known: dict[pa.DataType, pa.DataType] = {}
        return tuple(known.setdefault(one, one) for one in self.schema.types[1:])

    @cached_property
    def _numbers(self) -> Counter[pa.DataType]:
        return Counter(self._types)

    @property
    def widths(self) -> tuple[int, int, int]:
        """The numbers of reals, integers (two for each of 64 bits) and texts in a row."""
        wide = self.count(*_WIDE.values())
        return self.count(pa.float64()), self.count(pa.int32(), pa.bool_()) + 2 * wide, self.count(pa.string())

    def table(
        self,
        time: NDArray[np.float64],
        reals: NDArray[np.float64],
        integers: NDArray[np.int32],
        rows: Sequence[Sequence[str]],
    ) -> pa.Table:
        """Returns recorded rows as a table, which shares the memory of contiguous columns.

        Args:
            time: (n,) s.
            reals, integers: (number of values, n), otherwise as in `Rows`.
            rows: the texts of n rows; without texts, it may be empty.
        """
        arrays = [array_of(time, pa.float64())]
        real, whole = _rows_as_arrays(reals, pa.float64()), _rows_as_arrays(integers, pa.int32())
        for type, place in zip(self._types, self.places, strict=True):
            if type == pa.float64():
                arrays.append(real(place))
            elif type == pa.int32():
                arrays.append(whole(place))
            elif type == pa.string():
                arrays.append(texts([row[place] for row in rows]))
            elif type == pa.bool_():
                arrays.append(array_of(integers[place], type))
            else:
                halves = np.ascontiguousarray(integers[place : place + 2].T)
                values = halves.view(np.uint64 if pa.types.is_uint64(type) else np.int64)[:, 0]
                arrays.append(array_of(values.astype(type.to_pandas_dtype()), type))
        return pa.Table.from_arrays(arrays, schema=self.schema)

    def rows(self, table: pa.Table) -> Rows:
        """Returns the rows of a table of these columns in the form of the loop."""
        rows, (reals, integers, texts) = table.num_rows, self.widths
        real, integer = np.zeros((rows, reals)), np.zeros((rows, integers), np.int32)
        text: list[list[str]] = [[""] * texts for _ in range(rows)]
        for n, (field, place) in enumerate(zip(list(self.schema)[1:], self.places, strict=True), 1):
            column = table.column(n)
            if pa.types.is_string(field.type):
                for row, value in zip(text, column.to_pylist(), strict=True):
                    row[place] = value
            elif pa.types.is_floating(field.type):
                real[:, place] = values_of(column)
            elif field.type in _WIDE.values():
                wide = np.uint64 if pa.types.is_uint64(field.type) else np.int64
                integer[:, place : place + 2] = values_of(column).astype(wide).reshape(-1, 1).view(np.int32)
            else:
                integer[:, place] = values_of(column)
        return Rows(values_of(table.column(0)), real, integer, text)


def _rows_as_arrays(values: NDArray[Any], type: pa.DataType) -> Callable[[int], pa.Array]:
    """Returns a function for the rows of a matrix as arrays, which share its memory if rows are contiguous."""
    if values.ndim != 2 or not values.size or values.strides[1] != values.itemsize:
        return lambda row: array_of(values[row], type)
    step, n = values.strides[0] // values.itemsize, values.shape[1]
    size = (len(values) - 1) * values.strides[0] + n * values.itemsize
    memory = pa.foreign_buffer(values.ctypes.data, size, base=values)
    whole = pa.Array.from_buffers(type, size // values.itemsize, [None, memory])
    return lambda row: whole.slice(row * step, n)


def columns_of(checked: CheckedSystem, layout: Layout) -> Columns:
    """Returns the columns of a run, in the order of instances and their variables."""
    signals: list[tuple[str, str, int, Variable]] = []
    integers = sum(1 + v.wide for _, v in layout.signals["Integer"])
    for kind, variables in layout.signals.items():
        place = integers if kind == "Boolean" else 0
        for name, v in variables:
            signals.append((name, kind, place, v))
            place += 1 + v.wide
    signals += [(name, "String", i, v) for i, (name, _, v) in enumerate(layout.string_signals)]
    numbers = {one.name: i for i, one in enumerate(checked.instances)}
    files = {id(one.fmu): one.fmu for one in checked.instances}
    ranks = {key: {name: i for i, name in enumerate(fmu.variables)} for key, fmu in files.items()}

    def order(signal: tuple[str, str, int, Variable]) -> tuple[int, int]:
        name, _, _, v = signal
        number = numbers[name.removesuffix(f".{v.name}")]
        return number, ranks[id(checked.instances[number].fmu)][v.name]

    forms: dict[tuple[int, str], tuple[pa.DataType, pa.KeyValueMetadata]] = {}
    fields, places = [pa.field("time", pa.float64(), metadata={"unit": "s"})], []
    for name, kind, place, v in sorted(signals, key=order):
        if (form := forms.get((id(v), kind))) is None:
            form = forms[id(v), kind] = _form_of(v, kind)
        fields.append(pa.field(name, form[0], metadata=form[1]))
        places.append(place)
    return Columns(pa.schema(fields), tuple(places))


def _form_of(variable: Variable, kind: str) -> tuple[pa.DataType, pa.KeyValueMetadata]:
    """Returns the type of a column, and its metadata."""
    metadata = {"unit": variable.unit.name if variable.unit else "", "description": variable.description}
    if variable.items:
        metadata["items"] = json.dumps(dict(variable.items))
    return _WIDE[variable.fmi_type] if variable.wide else _ARROW[kind], pa.KeyValueMetadata(metadata)

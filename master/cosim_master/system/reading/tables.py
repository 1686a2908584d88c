"""Components that are CSV or Parquet files: tables over time, described as an FMU with the columns as outputs.

    "time","v","n"           the first column is time in s, ascending; two rows at one time are a jump
    0,1.5,0
    0.5,2,1

Types are those of the component's connectors. A Real is linear between rows, unless the type of the component requires
that it is held ("text/csv; interpolation=hold"); Integers and Booleans are held. `fmi.slaves.table` implements the
instance.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.interpolation import Column, Table
from cosim_master.fmi.description.variables import Capabilities, FmuDescription, Variable
from cosim_master.system.structure import Component, Connector

__all__ = ["TABLE", "describe_table"]

TABLE = "table"
"""`FmuDescription.library` of a table."""
_TYPES = ("Real", "Integer", "Boolean")
_BOOLEANS = {"true": True, "false": False, "1": True, "0": False}
_SHOWN = 20
_ABLE = Capabilities(canHandleVariableCommunicationStepSize=True, canGetAndSetFMUstate=True, canSerializeFMUstate=True)


def describe_table(path: Path, components: Sequence[Component]) -> FmuDescription:
    """Reads a table of values over time.

    Args:
        path: .csv text or Parquet, according to the type of the components.
        components: the components with this source; their connectors declare the types of the columns.

    Raises:
        SystemDescriptionError: the file is invalid, or components contradict each other; all problems are reported at
            once.
    """
    return _Reading(path, components).description()


class _Reading:
    def __init__(self, path: Path, components: Sequence[Component]) -> None:
        self._path, self._components = path, components
        self._problems: list[Problem] = []
        self._wanted: dict[str, Connector] = {}
        self._refused: set[str] = set()

    def _problem(self, line: int | None, message: str) -> None:
        self._problems.append(Problem(Where(str(self._path), line), message))

    def _raise(self) -> None:
        if self._problems:
            shown = self._problems[:_SHOWN]
            if (more := len(self._problems) - _SHOWN) > 0:
                shown.append(Problem(Where(str(self._path)), f"and {more} more problems"))
            raise SystemDescriptionError(shown)

    def description(self) -> FmuDescription:
        kind, held = self._agreed()
        self._take_connectors()
        self._raise()
        try:
            content = self._path.read_bytes()
        except OSError as error:
            self._problem(None, f"cannot be read: {error.strerror}")
            self._raise()
        times, cells = self._csv(content) if kind == "text/csv" else self._parquet()
        self._raise()
        columns = {name: self._column(name, values, held=held) for name, values in cells.items()}
        variables = {name: self._variable(name, i) for i, name in enumerate(columns)}
        outputs: dict[str, tuple[str, ...] | None] = dict.fromkeys(columns, ())
        return FmuDescription(
            path=self._path.resolve(),
            digest=hashlib.sha256(content).hexdigest(),
            fmi_version="2.0",
            model_name=self._path.stem,
            model_identifier=TABLE,
            guid="",
            description=f"the columns of {self._path.name}",
            library=TABLE,
            variables=variables,
            units={},
            step_size=None,
            capabilities=_ABLE,
            outputs=outputs,
            initial_unknowns=outputs,
            generation_tool="uav-cosim",
            table=Table(times, columns),
        )

    def _agreed(self) -> tuple[str, bool]:
        """Returns the MIME type of all components, and whether values are held."""
        first = self._components[0]
        for other in self._components[1:]:
            if other.type != first.type:
                text = f'type "{other.type}": {first.name} uses the same file as "{first.type}"; say the same'
                self._problems.append(Problem(other.where, text))
        kind, _, parameter = (part.strip() for part in first.type.partition(";"))
        return kind, parameter == "interpolation=hold"

    def _take_connectors(self) -> None:
        for component in self._components:
            for one in component.connectors:
                kind = one.type or "Real"
                if one.kind not in ("output", "unspecified"):
                    text = f'connector "{one.name}" is {one.kind}: columns of a file can only be output'
                    self._problems.append(Problem(one.where, text))
                elif kind not in _TYPES or one.dimensions:
                    what = f"an array of {kind}" if one.dimensions else kind
                    text = f'connector "{one.name}" is {what}: columns of a file can be {", ".join(_TYPES)}'
                    self._problems.append(Problem(one.where, text))
                elif (other := self._wanted.setdefault(one.name, one)).type != one.type:
                    text = f'connector "{one.name}" is {kind}, but {other.type or "Real"} at {other.where}'
                    self._problems.append(Problem(one.where, text))

    def _variable(self, name: str, reference: int) -> Variable:
        kind = self._wanted[name].type or "Real"
        return Variable(
            name,
            reference,
            kind,
            "output",
            "continuous" if kind == "Real" else "discrete",
            "calculated",
            unit=self._wanted[name].unit,
        )

    def _column(self, name: str, values: Sequence[Any], *, held: bool) -> Column:
        kind = self._wanted[name].type or "Real"
        return Column(np.array(values, dtype=np.float64 if kind == "Real" else np.int32), held or kind != "Real")

    def _known(self, names: Sequence[str]) -> None:
        """Reports connectors without a column, and columns with the same name."""
        for name, connector in self._wanted.items():
            if name not in names[1:]:
                text = f'{self._path.name} has no column "{name}"; {near(name, names[1:])}'
                self._problems.append(Problem(connector.where, text))
            elif names.count(name) > 1:
                self._problem(1, f'column "{name}" is there twice')

    def _value(self, line: int, name: str, text: str) -> float | int:
        """Returns the value of a cell; 0 after a problem."""
        kind = self._wanted[name].type or "Real"
        text = text.strip()
        number = _number(text)
        if kind == "Boolean" and text.lower() in _BOOLEANS:
            return int(_BOOLEANS[text.lower()])
        if kind == "Boolean" and number in (0.0, 1.0):
            return int(number == 1.0)
        if kind == "Integer" and number is not None and number == int(number) and abs(number) < 2**31:
            return int(number)
        if kind == "Real" and number is not None:
            return number
        valid = {"Real": "a finite number", "Integer": "an integer of 32 bits", "Boolean": "true, false, 1 or 0"}[kind]
        self._problem(line, f'column "{name}" has "{text[:60]}"; valid: {valid}')
        return 0

    def _time(self, line: int, text: str, before: Sequence[float]) -> float:
        time = _number(text)
        if time is None:
            self._problem(line, f'column "time" has "{text[:60]}"; valid: a finite number of seconds')
            return before[-1] if before else 0.0
        if before and time < before[-1]:
            self._problem(line, f"time {time:g} s lies before that of the row above, {before[-1]:g} s")
        return time

    def _csv(self, content: bytes) -> tuple[Any, dict[str, list[float | int]]]:
        try:
            reader = csv.reader(content.decode("utf-8-sig").splitlines(), skipinitialspace=True)
            lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
        except (UnicodeDecodeError, csv.Error) as error:
            self._problem(None, f"cannot be read: {error}")
            self._raise()
        if len(lines) < 2:
            self._problem(None, 'needs a row of names ("time", then columns) and one row of values at least')
            self._raise()
        names = [name.strip() for name in lines[0][1]]
        if names[0] != "time":
            self._problem(lines[0][0], f'its first column is "{names[0]}"; it must be "time"')
        self._known(names)
        self._raise()
        places = {name: names.index(name) for name in self._wanted}
        times: list[float] = []
        cells: dict[str, list[float | int]] = {name: [] for name in places}
        for line, row in lines[1:]:
            if len(row) != len(names):
                self._problem(line, f"has {len(row)} cells; the row of names has {len(names)}")
                continue
            times.append(self._time(line, row[0], times))
            for name, place in places.items():
                cells[name].append(self._value(line, name, row[place]))
        return np.array(times), cells

    def _parquet(self) -> tuple[Any, dict[str, list[float | int]]]:
        try:
            names = list(pq.read_schema(self._path).names)
            if names[:1] != ["time"]:
                self._problem(None, f'its first column is "{names[0] if names else ""}"; it must be "time"')
            self._known(names)
            self._raise()
            table = pq.read_table(self._path, columns=["time", *self._wanted])
        except (pa.ArrowInvalid, OSError) as error:
            self._problem(None, f"is not a Parquet file: {str(error).splitlines()[0]}")
            self._raise()
        if not table.num_rows:
            self._problem(None, "needs one row of values at least")
            self._raise()
        times: list[float] = []
        for number, value in enumerate(table["time"].to_pylist(), start=1):
            times.append(self._time(number, str(value), times))
        return np.array(times), {name: self._cells(name, table[name].to_pylist()) for name in self._wanted}

    def _cells(self, name: str, values: Iterable[Any]) -> list[float | int]:
        return [self._value(number, name, str(value)) for number, value in enumerate(values, start=1)]


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None

"""Inputs from a file: the columns of a CSV file set open inputs of a system at communication points.

    "time","u","on"          names in quotes or without, as FMPy writes and reads them
    0,1.5,0                  an array of FMI 3 has all elements in one cell, separated by spaces
    0.5,2,1                  two rows of one time are a jump

A continuous Real is interpolated linearly, other values are held. Before the first row and after the last row, the
values of these rows apply. At a jump, the values of its last row apply from that time on, except for a jump in the very
first row, which applies only after that time; both rules are those of FMPy. Values are set at the start of a step.
"""

from __future__ import annotations

import csv
import hashlib
import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import near
from cosim_master.files.xml import plain_number
from cosim_master.fmi.description.interpolation import interpolated
from cosim_master.fmi.description.read import Start, Variable
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["Agenda", "Stimuli", "read_stimuli"]

_SHOWN = 20


@dataclass(frozen=True, slots=True)
class _Column:
    instance: int
    variable: Variable
    values: Any

    @property
    def held(self) -> bool:
        return self.variable.type != "Real" or self.variable.variability == "discrete"


class Stimuli:
    """Values of open inputs, read from a file.

    Attributes:
        digest: SHA-256 of the file.
        notes: inputs that have no column.
    """

    def __init__(self, path: Path, rows: Any, columns: Sequence[_Column], digest: str, notes: Sequence[str]) -> None:
        self.path, self.digest, self.notes = path, digest, tuple(notes)
        self._rows, self._columns = rows, columns
        self._due: dict[int, list[tuple[int, int]]] = {}
        self._sampled: list[Any] = []
        self._steps = np.zeros(0, dtype=np.int64)

    def identity(self) -> dict[str, str]:
        """The identity of the file, for the manifest of a run."""
        return {"path": str(self.path), "sha256": self.digest}

    def initialize(self, checked: CheckedSystem, start: float) -> CheckedSystem:
        """Returns the system with the start values of the first communication point."""
        instances = list(checked.instances)
        at = np.array([start])
        for column in self._columns:
            value = interpolated(self._rows, column.values, at, held=column.held, before=column.held)[0]
            old = instances[column.instance]
            given = {**old.start_values, column.variable.name: _plain(value)}
            instances[column.instance] = replace(old, start_values=given)
        return replace(checked, instances=tuple(instances))

    def sample(self, clock: TimeGrid) -> None:
        """Computes the values at all communication points of a run, and notes if the file has only one of each."""
        first, last, begin, end = *map(float, self._rows[[0, -1]]), clock.time(0), clock.time(clock.steps)
        if first >= end or (len(self._rows) > 1 and last <= begin):
            lie = f"starts at {first:g} s, and the run stops at {end:g} s" if first >= end else f"ends at {last:g} s"
            row = "first" if first >= end else "last"
            self.notes += (f"{self.path} {lie}: the values of its {row} row hold all the time",)
        dues = []
        for column in self._columns:
            steps = np.arange(0, clock.steps, clock.periods[column.instance], dtype=np.int64)
            times = (clock.start + steps * clock.base) / (1e9 * clock.per_ns)
            values = interpolated(self._rows, column.values, times, held=column.held)
            changed = np.ones(len(values), dtype=bool)
            changed[1:] = values[1:] != values[:-1]
            self._sampled.append((steps[changed], values[changed]))
            dues.append(steps[changed])
        self._steps = np.unique(np.concatenate(dues)) if dues else self._steps

    def next(self, k: int) -> int | None:
        """Returns the first base step from `k` on at which a value is set."""
        i = int(np.searchsorted(self._steps, k))
        return int(self._steps[i]) if i < len(self._steps) else None

    def at(self, k: int) -> list[Change]:
        """Returns the values that are set at base step `k`."""
        found = []
        for column, (steps, values) in zip(self._columns, self._sampled, strict=True):
            i = int(np.searchsorted(steps, k))
            if i < len(steps) and steps[i] == k:
                found.append(Change(k, column.instance, column.variable, _plain(values[i])))
        return found

    def before(self, k: int) -> list[Change]:
        """Returns the last values that were set before base step `k`."""
        found = []
        for column, (steps, values) in zip(self._columns, self._sampled, strict=True):
            if (i := int(np.searchsorted(steps, k))) > 0:
                found.append(Change(int(steps[i - 1]), column.instance, column.variable, _plain(values[i - 1])))
        return found


class Agenda:
    """The values to be set during a run, in the order of time; stimuli come before changes of the same time.

    Args:
        changes: the changes, in the order of time.
        stimuli: the stimuli, already sampled.
        first: the first base step of the run.

    Attributes:
        requested: the changes that `request` has added.
    """

    def __init__(self, changes: Sequence[Change], stimuli: Stimuli | None, first: int = 0) -> None:
        self.requested: list[Change] = []
        self._changes = deque(changes)
        self._stimuli = stimuli
        self._stimulus = None if stimuli is None else stimuli.next(first)

    @property
    def next(self) -> float:
        """Returns the next base step at which a value is set; infinity if none exists."""
        change = self._changes[0].k if self._changes else math.inf
        return change if self._stimulus is None else min(change, self._stimulus)

    def before(self, k: int) -> list[Change]:
        """Returns the last values of the stimuli that were set before base step `k`."""
        return [] if self._stimuli is None else self._stimuli.before(k)

    def request(self, change: Change, k: int, clock: TimeGrid) -> float | None:
        """Adds a change before the next step of its instance, after those of the same time.

        Args:
            change: its base step does not matter.
            k: base steps made so far.
            clock: the periods of the instances.

        Returns:
            The time of that step, s; None if the run ends before.
        """
        period = clock.periods[change.instance]
        due = replace(change, k=-(-k // period) * period)
        if due.k >= clock.steps:
            return None
        self._changes.insert(bisect_right(self._changes, due.k, key=lambda one: one.k), due)
        self.requested.append(due)
        return clock.time(due.k)

    def take(self, k: int) -> list[Change]:
        """Removes and returns the values to be set at base step `k`."""
        found: list[Change] = []
        if self._stimuli is not None and self._stimulus == k:
            found += self._stimuli.at(k)
            self._stimulus = self._stimuli.next(k + 1)
        while self._changes and self._changes[0].k == k:
            found.append(self._changes.popleft())
        return found


def read_stimuli(path: Path, checked: CheckedSystem, taken: Sequence[str] = ()) -> Stimuli:
    """Reads a file of inputs.

    Args:
        path: a CSV file.
        checked: the system; the columns are its open inputs. If it has a single instance, its name may be omitted.
        taken: inputs that are already set by other means.

    Raises:
        SystemDescriptionError: the file is invalid; all problems are reported at once.
    """
    return _Reading(path, checked, taken).stimuli()


class _Reading:
    def __init__(self, path: Path, checked: CheckedSystem, taken: Sequence[str]) -> None:
        self._path, self._checked, self._taken = path, checked, {*taken}
        self._problems: list[Problem] = []
        self._inputs = self._open_inputs()

    def _problem(self, line: int | None, message: str) -> None:
        self._problems.append(Problem(Where(str(self._path), line), message))

    def _raise(self) -> None:
        if self._problems:
            shown = self._problems[:_SHOWN]
            if (more := len(self._problems) - _SHOWN) > 0:
                shown.append(Problem(Where(str(self._path)), f"and {more} more problems"))
            raise SystemDescriptionError(shown)

    def _open_inputs(self) -> dict[str, list[tuple[int, Variable]]]:
        """Returns unconnected inputs by the names that columns may have; for arrays, all elements."""
        driven = {link.target for link in self._checked.links}
        found: dict[str, list[tuple[int, Variable]]] = {}
        for i, instance in enumerate(self._checked.instances):
            variables = instance.fmu.variables
            inputs = {
                v.name: [(i, v)]
                for v in variables.values()
                if v.causality == "input" and v.clock is None and not v.clocks and v.packet_capacity is None
            }
            for name, shape in instance.fmu.shapes.items():
                elements = [inputs[one] for one in _elements(name, shape) if one in inputs]
                if len(elements) == math.prod(shape):
                    inputs[name] = [one for element in elements for one in element]
            for name, ends in inputs.items():
                if not any((instance.name, v.name) in driven for _, v in ends):
                    found[f"{instance.name}.{name}"] = ends
        return found

    def stimuli(self) -> Stimuli:
        try:
            content = self._path.read_bytes()
            text = content.decode("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            words = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
            self._problem(None, f"cannot be read: {words}")
            self._raise()
        reader = csv.reader(text.splitlines(), skipinitialspace=True)
        lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
        if len(lines) < 2:
            self._problem(None, 'needs a row of names ("time", then inputs) and one row of values at least')
            self._raise()
        ends = self._header(*lines[0])
        self._raise()
        rows, cells = self._rows(lines[1:], ends)
        self._raise()
        columns = [
            _Column(i, v, _array(v, values))
            for (i, v), values in zip([end for column in ends for end in column], cells, strict=True)
        ]
        used = {(column.instance, column.variable.name) for column in columns}
        every = {(i, v.name) for ends in self._inputs.values() for i, v in ends}
        missing = [f"{self._checked.instances[i].name}.{name}" for i, name in sorted(every - used)]
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        some = ", ".join(missing[:5]) + more
        notes = [f"{self._path} has no column for {some}: start values hold"] if missing else []
        return Stimuli(self._path, rows, columns, hashlib.sha256(content).hexdigest(), notes)

    def _header(self, line: int, names: Sequence[str]) -> list[list[tuple[int, Variable]]]:
        names = [name.strip() for name in names]
        if names == ["time"]:
            self._problem(line, "it has only the column time, and so sets nothing; add a column for each input")
        if names[0] != "time":
            self._problem(line, f'its first column is "{names[0]}"; it must be "time"')
        head = f"{self._checked.instances[0].name}." if len(self._checked.instances) == 1 else ""
        ends: list[list[tuple[int, Variable]]] = []
        seen: set[tuple[int, str]] = set()
        for name in names[1:]:
            full = name if name in self._inputs else head + name
            if full not in self._inputs:
                known = [known.removeprefix(head) for known in self._inputs]
                self._problem(line, f'column "{name}" is not an open input; {near(name, known)}')
                continue
            if full in self._taken:
                self._problem(line, f'column "{name}": the input is set by --set too; leave out one of them')
            if any((i, v.name) in seen for i, v in self._inputs[full]):
                self._problem(line, f'column "{name}" is there twice')
            seen |= {(i, v.name) for i, v in self._inputs[full]}
            ends.append(self._inputs[full])
        return ends

    def _rows(
        self, lines: Sequence[tuple[int, list[str]]], ends: Sequence[Sequence[tuple[int, Variable]]]
    ) -> tuple[Any, list[list[Start]]]:
        times: list[float] = []
        cells: list[list[Start]] = [[] for column in ends for _ in column]
        for line, row in lines:
            if len(row) != len(ends) + 1:
                self._problem(line, f"has {len(row)} cells; the row of names has {len(ends) + 1}")
                continue
            time = _number(row[0])
            if time is None:
                self._problem(line, f'time "{row[0]}" is not a number')
                continue
            if times and time < times[-1]:
                self._problem(line, f"time {time:g} s lies before that of the row above, {times[-1]:g} s")
            times.append(time)
            place = 0
            for text, column in zip(row[1:], ends, strict=True):
                parts = text.split() if len(column) > 1 else [text]
                if len(parts) != len(column):
                    name = column[0][1].name.partition("[")[0]
                    self._problem(line, f'"{name}" has {len(column)} elements, here are {len(parts)}')
                    parts = []
                for (_, variable), part in zip(column, parts, strict=False):
                    self._value(line, variable, part, cells[place])
                    place += 1
        return np.array(times), cells

    def _value(self, line: int, variable: Variable, text: str, into: list[Start]) -> None:
        try:
            if variable.type in ("Integer", "Enumeration", "Boolean") and (number := _number(text)) is not None:
                text = str(int(number)) if number == int(number) else text  # FMPy writes and reads 1 as 1.0
            if variable.type == "Real" and _number(text) is None:
                raise ValueError("valid: a finite number")
            value = variable.parsed(text)
            into.append(value)
        except ValueError as error:
            self._problem(line, f'{variable.name} = "{text}": {error}')


def _number(text: str) -> float | None:
    try:
        number = plain_number(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _elements(name: str, shape: Sequence[int]) -> list[str]:
    return [f"{name}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(*shape)]


def _array(variable: Variable, values: Sequence[Start]) -> Any:
    if variable.type == "Real":
        return np.array(values, dtype=np.float64)
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def _plain(value: Any) -> Start:
    convert: Callable[[Any], Any] = float if isinstance(value, np.floating) else lambda x: x
    plain: Start = convert(value)
    return plain

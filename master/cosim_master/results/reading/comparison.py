"""Compares two runs signal by signal: recorded numbers within tolerances, packets by outcome, and their inputs.

Either run may be a CSV file in the format of FMPy and `export`. Values are compared at common times; a coarser
recording of the same run is equal to a finer one. Two runs are equal if they have the same signals with equal values,
begin and end at the same times, and have the same numbers of packets per outcome. Other contents of the manifests
(parameters, settings, versions) explain differences, but do not affect the result.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import matching, near_pattern
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.storage.arrays import values_of

__all__ = ["Comparison", "SignalComparison", "compare"]

_Values: TypeAlias = np.ndarray[Any, Any]
_BATCH = 64
"""Signals read at once."""
_CAUSES = (
    "outcome",
    "start_time",
    "base_step",
    "changes",
    "master",
    "seed",
    "settings",
    "settings_before",
    "network",
    "recording",
    "versions",
)
"""Entries of a manifest for the inputs of a run, in addition to its instances."""


@dataclass(frozen=True, slots=True)
class SignalComparison:
    """The difference of one signal between two runs.

    Attributes:
        differing: number of common times at which the values are not equal within the tolerances.
        absolute: largest difference, in the signal's unit; NaN for text, infinite where one of the two is NaN.
        relative: `absolute` divided by the signal's largest absolute value.
        time: time of the largest difference, s; None without a difference.
        first: first time at which the values differ by more than the tolerances, s; None if they never do.
        units: of both runs, if they differ; empty otherwise.
    """

    name: str
    differing: int
    absolute: float
    relative: float
    time: float | None
    first: float | None
    units: tuple[str, ...] = ()

    @property
    def equal(self) -> bool:
        """True if the signal is equal in both runs, within the tolerances."""
        return self.differing == 0 and not self.units


@dataclass(frozen=True, slots=True)
class Comparison:
    """The result of `compare`.

    Attributes:
        signals: the signals of both runs, the worst first.
        only: names of the signals that only the first run has, and of those that only the second run has.
        common: number of common times.
        times: number of times of each run.
        spans: first and last time of each run, s.
        packets: by outcome, the numbers in both runs if they differ; None: not counted.
        causes: by path in the manifest, the values of both runs if they differ.
        notes: parts that could not be compared.
    """

    signals: tuple[SignalComparison, ...]
    only: tuple[tuple[str, ...], tuple[str, ...]]
    common: int
    times: tuple[int, int]
    spans: tuple[tuple[float, float], tuple[float, float]]
    packets: Mapping[str, tuple[int | None, int | None]]
    causes: Mapping[str, tuple[Any, Any]]
    notes: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """True if the runs are equal within the tolerances."""
        alike = all(signal.equal for signal in self.signals) and not any(self.only)
        return alike and not self.packets and self.same_span

    @property
    def same_span(self) -> bool:
        """True if the recordings begin and end at the same times."""
        return _keys(self.spans[0]) == _keys(self.spans[1])


class _Recording:
    """The signals of a run folder or of a CSV file. Close it after use."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_csv = path.is_file()
        self._table: Any = None
        self._file: Any = None
        try:
            if self.is_csv:
                self._table = self._read_csv()
                schema = self._table.schema
            else:
                self._file = open_signals(path)
                schema = self._file.schema_arrow
        except pa.ArrowException as error:
            raise _refusal(path, f"not a CSV file of signals: {error}") from None
        except SystemDescriptionError:
            raise
        except CosimError as error:  # of a journal
            raise _refusal(path, str(error)) from None
        if "time" not in schema.names:
            raise _refusal(path, 'has no column "time", as results of FMPy and of this program begin with')
        if twice := [name for name, times in Counter(schema.names).items() if times > 1]:
            raise _refusal(path, f'has more than one column "{twice[0]}"')
        self.fields = {field.name: field for field in schema if field.name != "time"}
        times = self.read(["time"])["time"]
        if not len(times):
            raise _refusal(path, "holds no recorded instant")
        self.time = _as_times(path, times)

    def _read_csv(self, texts: Iterable[str] = ()) -> Any:
        options = pa_csv.ConvertOptions(column_types=dict.fromkeys(texts, pa.string()))
        return pa_csv.read_csv(
            self.path, parse_options=pa_csv.ParseOptions(newlines_in_values=True), convert_options=options
        )

    def take_as_text(self, other: _Recording) -> None:
        """Reads signals as text if they are text in the other run: a CSV file does not tell the type of "01"."""
        texts = [name for name in self.fields if name in other.fields and other.is_text(name)]
        if self.is_csv and texts and not other.is_csv:
            self._table = self._read_csv(texts)
            self.fields |= {name: self._table.schema.field(name) for name in texts}

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def read(self, names: Sequence[str]) -> dict[str, _Values]:
        try:
            table = self._table.select(names) if self._file is None else self._file.read(columns=list(names))
            return {name: values_of(table.column(name)) for name in names}
        except (pa.ArrowException, OSError) as error:
            raise _refusal(self.path, f"its signals are damaged: {error}") from None

    def unit(self, name: str) -> str | None:
        """Returns the unit of a signal; None if the file cannot contain units."""
        return None if self.is_csv else (self.fields[name].metadata or {}).get(b"unit", b"").decode()

    def is_text(self, name: str) -> bool:
        kind = self.fields[name].type
        return bool(pa.types.is_string(kind) or pa.types.is_null(kind))

    def manifest(self) -> Mapping[str, Any] | None:
        """Returns the manifest; None for a CSV file."""
        if self.is_csv:
            return None
        try:
            found: Mapping[str, Any] = json.loads((self.path / "manifest.json").read_text(encoding="utf-8"))
            _causes(found)
            if not isinstance(packets := found.get("packets", {}), dict):
                raise TypeError(f"its packets are {packets!r}")
        except (OSError, ValueError, TypeError, AttributeError) as error:
            raise _refusal(self.path, f"not the folder of a complete run: {error}") from None
        return found


def _as_times(path: Path, values: _Values) -> _Values:
    try:
        times: _Values = values.astype(np.float64)
    except (ValueError, TypeError):
        times = np.array([np.nan])
    if not np.isfinite(times).all():
        raise _refusal(path, 'its column "time" has values that are not finite numbers')
    return times


def _refusal(path: Path, message: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(path)), message)])


def compare(
    first: Path, second: Path, *, atol: float = 0.0, rtol: float = 0.0, signals: Sequence[str] = ()
) -> Comparison:
    """Compares two runs.

    Two floating-point numbers a and b agree if `abs(a - b) <= atol + rtol * max(abs(a), abs(b))`, and NaN agrees
    with NaN; other values agree if they are equal.

    Args:
        first, second: folder of a run, or CSV file whose first column is `time` in s.
        atol: absolute tolerance, in each signal's own unit.
        rtol: relative tolerance.
        signals: patterns of the signals to compare; all if empty.

    Raises:
        SystemDescriptionError: an argument is neither, the runs have no common time, or a pattern matches no signal.
    """
    one = _Recording(first)
    try:
        other = _Recording(second)
        try:
            one.take_as_text(other)
            other.take_as_text(one)
            return _compared(one, other, atol, rtol, signals)
        finally:
            other.close()
    finally:
        one.close()


def _compared(one: _Recording, other: _Recording, atol: float, rtol: float, patterns: Sequence[str]) -> Comparison:
    names = _chosen([*one.fields, *(name for name in other.fields if name not in one.fields)], patterns)
    rows = _common_times(one, other)
    notes = []
    texts = {name for name in names if one.is_csv != other.is_csv and _is_text_only(name, one, other)}
    if texts:
        notes.append(f"{len(texts)} signals are text, which the CSV file does not have: not compared")
    both = [name for name in names if name in one.fields and name in other.fields and name not in texts]
    compared: list[SignalComparison] = []
    time = one.time[rows[0]]
    for at in range(0, len(both), _BATCH):
        batch = both[at : at + _BATCH]
        values = one.read(batch), other.read(batch)
        for name in batch:
            found = _compare_values(name, time, values[0][name][rows[0]], values[1][name][rows[1]], atol, rtol)
            units = one.unit(name), other.unit(name)
            if units[0] is not None and units[1] is not None and units[0] != units[1]:
                found = SignalComparison(*_fields(found), units=(units[0], units[1]))
            compared.append(found)
    compared.sort(key=_badness)
    manifests = one.manifest(), other.manifest()
    packets: dict[str, tuple[int | None, int | None]] = {}
    causes: dict[str, tuple[Any, Any]] = {}
    if manifests[0] is None or manifests[1] is None:
        notes.append("a CSV file tells of no packets, parameters and versions: not compared")
    else:
        packets = _differing(manifests[0].get("packets", {}), manifests[1].get("packets", {}))
        causes = _differing(_causes(manifests[0]), _causes(manifests[1]))
    return Comparison(
        signals=tuple(compared),
        only=_only(names, one, other, texts),
        common=len(rows[0]),
        times=(len(one.time), len(other.time)),
        spans=((float(one.time[0]), float(one.time[-1])), (float(other.time[0]), float(other.time[-1]))),
        packets=packets,
        causes=causes,
        notes=tuple(notes),
    )


def _only(
    names: Sequence[str], one: _Recording, other: _Recording, texts: set[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    alone = [name for name in names if name not in texts]
    return (
        tuple(name for name in alone if name not in other.fields),
        tuple(name for name in alone if name not in one.fields),
    )


def _is_text_only(name: str, one: _Recording, other: _Recording) -> bool:
    """Returns whether a signal is text in one run and missing in the CSV file beside it."""
    run, file = (other, one) if one.is_csv else (one, other)
    return name in run.fields and name not in file.fields and run.is_text(name)


def _fields(one: SignalComparison) -> tuple[str, int, float, float, float | None, float | None]:
    return one.name, one.differing, one.absolute, one.relative, one.time, one.first


def _badness(one: SignalComparison) -> tuple[bool, float, str]:
    """Returns a sort key: unequal signals first, by their relative difference; texts after numbers."""
    return one.equal, -(0.0 if math.isnan(one.relative) else one.relative), one.name


def _chosen(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    if not patterns:
        return list(names)
    chosen: set[str] = set()
    problems = []
    for pattern in patterns:
        found = matching(pattern, names)
        if not found:
            text = f"{pattern} matches no signal of either run; {near_pattern(pattern, names)}"
            problems.append(Problem(Where("--signals"), text))
        chosen.update(found)
    if problems:
        raise SystemDescriptionError(problems)
    return [name for name in names if name in chosen]


def _keys(times: Sequence[float] | _Values) -> list[int]:
    """Returns times in whole nanoseconds: 0.3 in one file may be 3 * 0.1 in another."""
    return [int(key) for key in np.rint(np.asarray(times, dtype=np.float64) * 1e9)]


def _common_times(one: _Recording, other: _Recording) -> tuple[_Values, _Values]:
    """Returns the rows of both runs at their common times.

    Several rows at one time, those of an event, are counted from the last one; the first ones of the run that has more
    are left out.
    """
    places = [_places(_keys(recording.time)) for recording in (one, other)]
    common = sorted(places[0].keys() & places[1].keys(), key=lambda place: (place[0], -place[1]))
    if not common:
        spans = [f"{r.path}: {r.time[0]:g} to {r.time[-1]:g} s in {len(r.time)} rows" for r in (one, other)]
        raise _refusal(other.path, f"has no time in common with {one.path}; {'; '.join(spans)}")
    rows = [np.array([found[place] for place in common], dtype=np.int64) for found in places]
    return rows[0], rows[1]


def _places(keys: Sequence[int]) -> dict[tuple[int, int], int]:
    """Returns the row of each time and number of rows behind it at that time."""
    found: dict[tuple[int, int], int] = {}
    before, behind = None, 0
    for row in range(len(keys) - 1, -1, -1):
        behind = behind + 1 if keys[row] == before else 0
        before = keys[row]
        found[before, behind] = row
    return found


def _compare_values(name: str, time: _Values, a: _Values, b: _Values, atol: float, rtol: float) -> SignalComparison:
    if a.dtype == object or b.dtype == object:
        differs = np.array([str(x) != str(y) for x, y in zip(a, b, strict=True)], dtype=bool)
        first = float(time[int(np.argmax(differs))]) if differs.any() else None
        absolute = math.nan if differs.any() else 0.0
        return SignalComparison(name, int(differs.sum()), absolute, absolute, first, first)
    floating = a.dtype.kind == "f" or b.dtype.kind == "f"
    exact = None if floating else a == b  # 64-bit integers differ that are one floating-point number
    a, b = a.astype(np.float64), b.astype(np.float64)
    same = (a == b) | (np.isnan(a) & np.isnan(b)) if exact is None else exact
    with np.errstate(invalid="ignore", over="ignore"):
        apart = np.where(same, 0.0, np.abs(a - b) if floating else np.maximum(np.abs(a - b), 1.0))
        apart[np.isnan(apart)] = np.inf
        size = np.maximum(np.abs(a), np.abs(b))
        allowed = atol + rtol * np.where(np.isfinite(size), size, 0.0) if floating else 0.0
    differs = ~same & (apart > allowed)
    worst = int(np.argmax(apart))
    finite = size[np.isfinite(size)]
    whole = float(finite.max()) if finite.size else 0.0
    absolute = float(apart[worst])
    relative = 0.0 if absolute == 0.0 else absolute / whole if whole else math.inf
    return SignalComparison(
        name,
        int(differs.sum()),
        absolute,
        relative,
        float(time[worst]) if absolute else None,
        float(time[int(np.argmax(differs))]) if differs.any() else None,
    )


def _causes(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the inputs of a run by path. FMUs are identified by their contents, not by their files."""
    fmus = manifest.get("fmus", {})
    flat: dict[str, Any] = {}

    def put(path: str, value: Any) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                put(f"{path}.{name}" if path else name, inner)
        else:
            flat[path] = value

    for name in _CAUSES:
        put(name, manifest.get(name))
    for name, instance in manifest.get("instances", {}).items():
        put(f"{name}.fmu", fmus.get(instance.get("fmu"), {}).get("sha256"))
        put(f"{name}.step", instance.get("step"))
        put(name, instance.get("parameters", {}))
    return flat


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    names = [*one, *(name for name in other if name not in one)]
    return {name: (one.get(name), other.get(name)) for name in names if one.get(name) != other.get(name)}

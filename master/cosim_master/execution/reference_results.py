"""Compares an FMU with reference results: those that it contains (FMI-LS-REF), or a CSV file.

FMI-LS-REF, a draft of a layered standard, stores CSV files in extra/org.fmi-standard.fmi-ls-ref of an FMU: the file
with the role "result" holds the results of its default experiment, the one with the role "input" its inputs.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.files import archive, temporary
from cosim_master.files.xml import parse

__all__ = ["Difference", "Verdict", "against_reference"]

_FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
_LIMIT = 256 << 20


@dataclass(frozen=True, slots=True)
class Difference:
    """The largest difference of a variable from its reference, its time (s), and the allowed difference."""

    name: str
    largest: float
    time: float
    allowed: float

    @property
    def agrees(self) -> bool:
        return self.largest <= self.allowed


@dataclass(frozen=True, slots=True)
class Verdict:
    """A comparison with a reference.

    Attributes:
        source: the description of the reference.
        rows: number of common times.
        differences: the differences of the compared variables, the largest first.
        left_out: columns that cannot be compared, since they are not outputs.
    """

    source: str
    rows: int
    differences: tuple[Difference, ...]
    left_out: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        return all(one.agrees for one in self.differences)


def against_reference(
    path: Path,
    reference: Path | None,
    *,
    tolerance: float,
    until: float | None = None,
    step: float | None = None,
    overrides: Mapping[str, str] | None = None,
) -> Verdict:
    """Runs an FMU and compares it with a reference at their common times.

    Args:
        path: the FMU.
        reference: a CSV file in the format of FMPy; None uses the reference that the FMU contains.
        tolerance: allowed difference, as a fraction of the largest absolute value of a column.
        until, step, overrides: options of the run.

    Raises:
        SystemDescriptionError: the reference is missing, or has no column that can be compared.
        CosimError: the run failed.
    """
    folder = temporary.made()
    try:
        inputs = None
        source = str(reference)
        if reference is None:
            reference, inputs, source = _own(path, folder)
        times, columns = _read(reference, source)
        result = simulate(
            path,
            RunOptions(
                out=folder / "out", until=until, step=step, overrides=overrides or {}, record=["*"], inputs=inputs
            ),
        )
        if result.outcome == "failed":
            raise CosimError(str(result.error))
        table = pq.read_table(folder / "out" / "signals.parquet")
        (instance,) = json.loads((folder / "out" / "manifest.json").read_text(encoding="utf-8"))["instances"]
        return _compared(source, times, columns, table, instance, tolerance)
    finally:
        temporary.remove(folder)


def _own(path: Path, folder: Path) -> tuple[Path, Path | None, str]:
    """Returns the unpacked files that an FMU contains: results, inputs if any, and their description."""
    shown = f"{path}/{_FOLDER}"
    manifest = archive.read_member(path, f"{_FOLDER}/fmi-ls-manifest.xml", str(path), limit=_LIMIT)
    related = [] if manifest is None else [*parse(manifest, f"{shown}/fmi-ls-manifest.xml").iterfind("Related")]
    found: dict[str, Path] = {}
    for one in related:
        role, name = one.get("role", ""), one.get("source", "")
        if role in ("result", "input") and role not in found:
            data = archive.read_member(path, f"{_FOLDER}/{name}", str(path), limit=_LIMIT)
            if data is None:
                text = f'names "{name}" as {role}, which is not in the FMU'
                raise SystemDescriptionError([Problem(Where(f"{shown}/fmi-ls-manifest.xml"), text)])
            found[role] = folder / f"{role}.csv"
            found[role].write_bytes(data)
    if "result" not in found:
        text = f"brings no reference results ({_FOLDER}); give some with --reference FILE.csv"
        raise SystemDescriptionError([Problem(Where(str(path)), text)])
    return found["result"], found.get("input"), f"the results that {path.name} brings along"


def _read(path: Path, shown: str) -> tuple[Any, dict[str, Any]]:
    """Returns times and columns of numbers of a CSV file; an array of FMI 3 has one column per element."""

    def wrong(line: int | None, text: str) -> SystemDescriptionError:
        return SystemDescriptionError([Problem(Where(shown, line), text)])

    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise wrong(None, f"cannot be read: {error}") from None
    rows = [(i + 1, row) for i, row in enumerate(csv.reader(lines, skipinitialspace=True)) if row]
    names = [name.strip() for name in rows[0][1]] if rows else []
    if len(rows) < 2 or names[0] != "time":
        raise wrong(1, 'needs a row of names, "time" first, and rows of numbers')
    columns: dict[str, list[float]] = {}
    times: list[float] = []
    for line, row in rows[1:]:
        if len(row) != len(names):
            raise wrong(line, f"has {len(row)} cells; the row of names has {len(names)}")
        for name, cell in zip(names, row, strict=True):
            parts = cell.split()
            for i, part in enumerate(parts):
                try:
                    value = {"True": 1.0, "true": 1.0, "False": 0.0, "false": 0.0}.get(part)
                    value = float(part) if value is None else value
                except ValueError:
                    value = math.nan
                key = name if len(parts) == 1 else f"{name}[{i + 1}]"
                (times if name == "time" else columns.setdefault(key, [])).append(value)
    return np.array(times), {name: np.array(values) for name, values in columns.items()}


def _compared(
    source: str, times: Any, columns: Mapping[str, Any], table: Any, instance: str, tolerance: float
) -> Verdict:
    ours = np.array(table["time"].to_pylist())
    places = np.clip(np.searchsorted(ours, times - 1e-9), 0, len(ours) - 1)
    common = np.abs(ours[places] - times) <= 1e-9 * np.maximum(1.0, np.abs(times))
    if not common.any():
        raise SystemDescriptionError([Problem(Where(source), "has no time in common with the run; try another --step")])
    signals = [name for name in table.column_names if name != "time"]
    by_name = {name: name for name in signals} | {name.removeprefix(f"{instance}."): name for name in signals}
    differences, left_out = [], []
    for name, expected in columns.items():
        if name not in by_name or len(expected) != len(times) or np.isnan(expected).all():
            left_out.append(name)
            continue
        got = np.array(table[by_name[name]].to_pylist(), dtype=float)[places]
        apart = np.where(common, np.abs(got - expected), 0.0)
        # Of two rows at one time (before and after an event), the closer one counts.
        for i in np.flatnonzero(np.diff(times) == 0.0):
            apart[i] = apart[i + 1] = min(apart[i], apart[i + 1])
        worst = int(np.argmax(apart))
        allowed = tolerance * max(float(np.nanmax(np.abs(expected))), 1e-9)
        differences.append(Difference(name, float(apart[worst]), float(times[worst]), allowed))
    if not differences:
        names = ", ".join(left_out[:5])
        raise SystemDescriptionError(
            [Problem(Where(source), f"nothing to compare: {names} are not outputs of the FMU")]
        )
    differences.sort(key=lambda one: one.largest / one.allowed if one.allowed else one.largest, reverse=True)
    return Verdict(source, int(common.sum()), tuple(differences), tuple(left_out))

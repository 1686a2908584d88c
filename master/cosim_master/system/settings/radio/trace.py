"""The trace file of a radio: the recorded fates of packets on some links, as CSV.

    time,from,to,delivered,delay
    0.0,drone1,drone2,1,0.021
    0.5,drone1,drone2,0,
    0.0,drone2,drone1,0.9,0.03

The first line names the five columns, in any order. `time` [s] is that of the run, `from` and `to` are nodes,
`delivered` is 1, 0, or the probability of delivery, and `delay` [s] may be empty if it is 0. A row holds from its time
until that of the next row of its link; the first row of a link also holds before it, and the last one to the end.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.diagnostics.names import near

__all__ = ["Trace", "read_trace"]

_COLUMNS = ("time", "from", "to", "delivered", "delay")
_TOLD = 10
"""Problems of one file that are reported; the others are counted."""


@dataclass(frozen=True, slots=True)
class Trace:
    """The rows (time, sender, receiver, probability of delivery, delay) of a trace file; times in s.

    Attributes:
        file: its path as written.
        sha256: the digest of its contents.
    """

    file: str
    sha256: str
    rows: tuple[tuple[float, str, str, float, float], ...] = field(repr=False)


def read_trace(path: Path, written: str, nodes: Collection[str], problems: list[Problem]) -> Trace | None:
    """Reads a trace file; adds its problems, with their lines, to `problems`.

    Args:
        written: the path as written in the system.
        nodes: names of the radio nodes.

    Raises:
        OSError: the file cannot be read.
    """
    data = path.read_bytes()
    found: list[Problem] = []
    rows = tuple(_rows(data.decode("utf-8-sig", "replace"), str(path), nodes, found))
    if not rows and not found:
        found.append(Problem(Where(str(path)), f"no rows follow the line {','.join(_COLUMNS)}"))
    problems += found[:_TOLD]
    if len(found) > _TOLD:
        problems.append(Problem(Where(str(path)), f"and {len(found) - _TOLD} more problems of this kind"))
    return None if found else Trace(written, hashlib.sha256(data).hexdigest(), rows)


def _rows(
    text: str, path: str, nodes: Collection[str], problems: list[Problem]
) -> Iterator[tuple[float, str, str, float, float]]:
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    names = [name.strip() for name in reader.fieldnames or ()]
    if sorted(names) != sorted(_COLUMNS):
        head = f"its columns are {','.join(names)}" if names else "it is empty"
        problems.append(Problem(Where(path, 1), f"{head}; valid are {','.join(_COLUMNS)}, in any order"))
        return
    reader.fieldnames = names
    lines: dict[tuple[str, str, float], int] = {}
    for row in reader:
        where = Where(path, reader.line_num)
        if None in row or None in row.values():
            problems.append(Problem(where, f"a row has {len(_COLUMNS)} values: {','.join(names)}"))
            continue
        ends = row["from"].strip(), row["to"].strip()
        wrong = list(_wrong_ends(ends, nodes))
        time = _number(row, "time", 0.0, 9e9, wrong)
        delivered = _number(row, "delivered", 0.0, 1.0, wrong)
        delay = 0.0 if not row["delay"].strip() and not delivered else _number(row, "delay", 0.0, 3600.0, wrong)
        if not wrong and (first := lines.setdefault((*ends, time), reader.line_num)) != reader.line_num:
            wrong.append(f"{time:.9g} s from {ends[0]} to {ends[1]} is also in line {first}; keep one of them")
        problems += [Problem(where, one) for one in wrong]
        if not wrong:
            yield (time, *ends, delivered, delay)


def _wrong_ends(ends: tuple[str, str], nodes: Collection[str]) -> Iterator[str]:
    for column, name in zip(("from", "to"), ends, strict=True):
        if name not in nodes:
            yield f'{column}="{name}": there is no such radio node; {near(name, nodes)}'
    if ends[0] == ends[1] and ends[0] in nodes:
        yield f'from "{ends[0]}" to itself; name two nodes'


def _number(row: Mapping[str, str], column: str, low: float, high: float, wrong: list[str]) -> float:
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        wrong.append(f'{column}="{row[column].strip()}" must be a number from {low:g} to {high:g}')
        return low
    return value

"""Tables of MasterSim: CSV files with units in the names of their columns, converted to ours.

    Time [h]<tab>T_lab [C]<tab>RH [%]      tab-separated, or comma-separated with quotation marks
    0<tab>20<tab>46

Times are converted to s; of several rows with one time the last one counts. Units of values are not converted.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.files.xml import double

__all__ = ["Columns", "read_columns"]


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns of a table: their names, without the time, and rows of time [s] and values."""

    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]

    def write(self, path: Path) -> None:
        """Writes them as a component of type text/csv is read."""
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *self.names])
            writer.writerows([*map(repr, row)] for row in self.rows)


def read_columns(path: Path, seconds: Mapping[str, Fraction | int], problems: list[Problem]) -> Columns | None:
    """Returns the columns of a file; None after a problem, which is added to `problems`.

    Args:
        path: the file.
        seconds: the length of each unit of time.
        problems: gets the problems of the file.
    """
    before = len(problems)

    def problem(line: int | None, message: str) -> None:
        problems.append(Problem(Where(str(path), line), message))

    try:
        lines = path.read_bytes().decode("utf-8-sig").splitlines()
    except OSError as error:
        problem(None, f"cannot be read: {error.strerror}")
        return None
    except UnicodeDecodeError:
        problem(None, "cannot be read: it is not UTF-8")
        return None
    tabs = [line.count("\t") for line in lines[:2]]
    separator = "\t" if len(tabs) == 2 and tabs[0] == tabs[1] > 0 else ","
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    read = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(cell.strip() for cell in row)]
    if len(read) < 2 or len(read[0][1]) < 2:
        problem(None, 'needs a row of names ("Time [s]", then columns) and one row of values at least')
        return None
    heads = [_named(cell) for cell in read[0][1]]
    unit = heads[0][1] or "s"
    names = tuple(name for name, _ in heads[1:])
    if unit not in seconds:
        problem(read[0][0], f'its times are in "{unit}"; valid: {", ".join(seconds)}')
        return None
    if len(set(names)) < len(names):
        problem(read[0][0], "two columns have the same name")
    rows: list[tuple[float, ...]] = []
    for line, cells in read[1:]:
        numbers = [double(cell) for cell in cells]
        wrong = [cell for cell, number in zip(cells, numbers, strict=True) if number is None or abs(number) > 1e300]
        if len(cells) != len(heads):
            problem(line, f"has {len(cells)} cells; the row of names has {len(heads)}")
        elif wrong or any(number != number for number in numbers):
            problem(line, f'"{(wrong or ["NaN"])[0][:60]}" is not a finite number')
        else:
            first = float(Fraction(cells[0]) * seconds[unit]) if numbers[0] else 0.0  # "1e-999999999" takes hours
            row = (first, *(number or 0.0 for number in numbers[1:]))
            if rows and row[0] < rows[-1][0]:
                problem(line, f"time {row[0]:g} s lies before that of the row above, {rows[-1][0]:g} s")
            if rows and row[0] == rows[-1][0]:
                rows.pop()
            rows.append(row)
    return None if len(problems) > before else Columns(names, tuple(rows))


def _named(cell: str) -> tuple[str, str]:
    """Returns name and unit of a column, from "name [unit]"."""
    name, _, rest = cell.rpartition("[") if cell.endswith("]") else (cell, "", "")
    return name.strip(), rest.removesuffix("]").strip()

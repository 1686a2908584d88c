"""Layouts of start positions by name, and positions from a file. All in m, NED from the local origin."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.files.xml import plain_number

__all__ = ["LAYOUTS", "Pose", "laid_out", "poses_of_file"]


@dataclass(frozen=True, slots=True)
class Pose:
    """The start position of one drone, NED [m]; `name` may be empty."""

    north: float
    east: float
    down: float = 0.0
    name: str = ""


def laid_out(layout: str, drones: int, spacing: float, seed: int = 1) -> tuple[Pose, ...]:
    """Returns the start positions of `drones` drones in a layout, with neighbours `spacing` m apart.

    Args:
        layout: one of `LAYOUTS`.
        seed: seed of the layout "random", in which drones are at least `spacing` apart.
    """
    return tuple(Pose(north, east) for north, east in LAYOUTS[layout](drones, spacing, seed))


def _line(drones: int, spacing: float, _: int) -> list[tuple[float, float]]:
    """Returns positions from the origin to the east."""
    return [(0.0, spacing * i) for i in range(drones)]


def _grid(drones: int, spacing: float, _: int) -> list[tuple[float, float]]:
    """Returns positions in rows of a square, from the origin to east and north."""
    side = math.isqrt(drones - 1) + 1
    return [(spacing * (i // side), spacing * (i % side)) for i in range(drones)]


def _ring(drones: int, spacing: float, _: int) -> list[tuple[float, float]]:
    """Returns positions on a circle around the origin, clockwise from the north."""
    if drones == 1:
        return [(0.0, 0.0)]
    radius = spacing / (2.0 * math.sin(math.pi / drones))
    angles = [2.0 * math.pi * i / drones for i in range(drones)]
    return [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]


def _v(drones: int, spacing: float, _: int) -> list[tuple[float, float]]:
    """Returns positions in a V that points north: the first at the origin, the others to its south-west and south-east.

    The wings are at a right angle.
    """
    step = spacing * math.sqrt(0.5)
    ranks = [(i + 1) // 2 for i in range(drones)]
    return [(-step * rank, step * rank * (-1 if i % 2 else 1) if i else 0.0) for i, rank in enumerate(ranks)]


def _random(drones: int, spacing: float, seed: int) -> list[tuple[float, float]]:
    """Returns random positions in a square around the origin with 4 spacing^2 per drone, all at least `spacing` apart.

    Drone k takes the first of its random positions that is far enough from the previous drones. Discs of radius
    `spacing` around these cover at most pi/4 of the square, so each try succeeds with a probability of more than 0.2.
    """
    half = spacing * math.sqrt(drones)
    found = np.empty((drones, 2))
    for k in range(drones):
        generator = np.random.Generator(np.random.Philox(key=[seed, k]))
        while True:
            candidate = generator.uniform(-half, half, 2)
            if np.all(np.sum((found[:k] - candidate) ** 2, axis=1) >= spacing**2):
                break
        found[k] = candidate
    return [(float(north), float(east)) for north, east in found]


LAYOUTS: Mapping[str, Callable[[int, float, int], Sequence[tuple[float, float]]]] = {
    "line": _line,
    "grid": _grid,
    "ring": _ring,
    "v": _v,
    "random": _random,
}
"""Functions by name of a layout that return positions (north, east) for a number of drones and a spacing; the seed is
for "random".
"""


def poses_of_file(file: Path) -> tuple[Pose, ...]:
    """Returns the rows of a CSV file with the columns north, east and, optionally, down and name.

    Raises:
        SystemDescriptionError: the file cannot be read, or has another format; all problems are reported at once.
    """
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise SystemDescriptionError([Problem(Where(str(file)), f"cannot be read: {reason}")]) from None
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    columns = [name.strip() for name in reader.fieldnames or []]
    reader.fieldnames = columns
    valid = ("north", "east", "down", "name")
    if not {"north", "east"} <= {*columns} <= {*valid}:
        message = (
            f"its columns are {', '.join(columns) or 'none'}; they must be north and east (m), and may be down, name"
        )
        raise SystemDescriptionError([Problem(Where(str(file), 1), message)])
    if twice := [name for name in columns if columns.count(name) > 1]:
        raise SystemDescriptionError([Problem(Where(str(file), 1), f'column "{twice[0]}" is there twice')])
    problems: list[Problem] = []
    poses: list[Pose] = []
    named: dict[str, int] = {}
    for row in reader:
        where = Where(str(file), reader.line_num)
        try:
            if None in row or None in row.values():
                raise ValueError(f"has not {len(columns)} values, one for each of {', '.join(columns)}")
            north, east, down = (_metres(name, row.get(name, "0")) for name in valid[:3])
            name = row.get("name", "").strip()
            if name and (line := named.setdefault(name, reader.line_num)) != reader.line_num:
                raise ValueError(f'name="{name}" is that of line {line}, too; give each drone a name of its own')
            poses.append(Pose(north, east, down, name))
        except ValueError as error:
            problems.append(Problem(where, str(error)))
    if not poses and not problems:
        problems.append(Problem(Where(str(file)), "has no rows: give one for each drone"))
    if problems:
        raise SystemDescriptionError(problems)
    return tuple(poses)


def _metres(name: str, text: str) -> float:
    try:
        value = plain_number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f'{name}="{text}" must be a number in m')
    return value

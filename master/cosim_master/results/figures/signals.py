"""Figures of any recorded signal over time: a panel for each pattern, a line for each signal, quantiles of many."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import matching, near
from cosim_master.results.figures.style import DASHES, NAMED, WIDTH, colour_bar, colours, draw_lines, draw_quantiles
from cosim_master.results.reading.flight import Array
from cosim_master.results.reading.recorded_signals import Signals, open_signals
from cosim_master.results.storage.arrays import values_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Panel", "draw_signals", "read_panels"]

_ROWS = 5000
"""Instants kept: far more than a figure can resolve."""
_LINES = 200
"""With more signals, their quantiles are drawn instead of lines."""


@dataclass(frozen=True, slots=True)
class Panel:
    """The signals that match a pattern.

    Attributes:
        pattern: as the user wrote it.
        names: of the signals.
        unit: their unit; empty if they have none, or different ones.
        items: values of an enumeration, by name.
        time: (n,) s.
        values: (n, number of signals).
    """

    pattern: str
    names: tuple[str, ...]
    unit: str
    items: dict[str, int]
    time: Array
    values: Array


def read_panels(run: Path, patterns: Sequence[str]) -> list[Panel]:
    """Reads the signals that match patterns ("drone*.vehicle.position[3]"), a panel for each pattern.

    Raises:
        SystemDescriptionError: a pattern matches no signal of numbers.
        CosimError: the run recorded no instant.
    """
    with open_signals(run) as signals:
        fields = {one.name: one for one in signals.schema_arrow if one.name != "time"}
        time = values_of(signals.read(columns=["time"]).column(0))
        if not len(time):
            raise CosimError(f"{run / 'signals.parquet'}: nothing to draw: the run recorded no instant")
        rows = np.unique(np.linspace(0, len(time) - 1, min(len(time), _ROWS)).round().astype(np.int64))
        return [_panel(run, pattern, fields, signals, time, rows) for pattern in patterns]


def _panel(run: Path, pattern: str, fields: dict[str, pa.Field], signals: Signals, time: Array, rows: Any) -> Panel:
    found = matching(pattern, fields)
    names = [name for name in found if not pa.types.is_string(fields[name].type)]
    if not names:
        if found:
            text = f"{found[0]} is text, which has no curve; `uav-cosim view` shows it"
        else:
            text = f"{run} has no such signal; {near(pattern, fields)}"
        raise SystemDescriptionError([Problem(Where(f"--signal {pattern}"), text)])
    values = np.empty((len(rows), len(names)))
    for begin in range(0, len(names), 256):
        some = names[begin : begin + 256]
        table = signals.read(columns=some)
        for i, name in enumerate(some):
            values[:, begin + i] = values_of(table.column(name))[rows]
    units = {(fields[name].metadata or {}).get(b"unit", b"").decode() for name in names}
    items = {(fields[name].metadata or {}).get(b"items", b"{}").decode() for name in names}
    return Panel(
        pattern,
        tuple(names),
        units.pop() if len(units) == 1 else "",
        json.loads(items.pop()) if len(items) == 1 else {},
        time[rows],
        values,
    )


def draw_signals(panels: Sequence[Panel]) -> Figure:
    """Draws panels above each other with a common time."""
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 0.6 + 1.9 * len(panels)), layout="constrained")
    for axes, panel in zip(figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0], panels, strict=True):
        _draw(figure, axes, panel)
        axes.set_xlim(float(panel.time[0]), max(float(panel.time[-1]), float(panel.time[0]) + 1e-9))
    figure.axes[len(panels) - 1].set_xlabel("time (s)")
    return figure


def _draw(figure: Figure, axes: Axes, panel: Panel) -> None:
    n, whole = len(panel.names), bool(panel.items)
    axes.set_title(panel.pattern, fontsize=8.0, loc="left")
    if panel.unit and panel.unit != "1":
        axes.set_ylabel(panel.unit)
    if n > _LINES:
        draw_quantiles(axes, panel.time, panel.values)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title=f"{n} signals")
    elif n > NAMED:
        drawn = draw_lines(axes, np.repeat(panel.time[:, None], n, axis=1), panel.values)
        colour_bar(figure, drawn, axes, "number of the signal")
    else:
        for i, (name, colour) in enumerate(zip(panel.names, colours(n), strict=True)):
            axes.plot(
                panel.time,
                panel.values[:, i],
                color=colour,
                linestyle=DASHES[i % len(DASHES)] if n <= 7 else "-",
                drawstyle="steps-post" if whole else "default",
                label=_differing(name, panel.names),
            )
        if n > 1:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 if n <= 10 else 2)
    if panel.items:
        used = {name: value for name, value in panel.items.items() if (panel.values == value).any()}
        axes.set_yticks(list(used.values()), list(used))


def _differing(name: str, names: Sequence[str]) -> str:
    """Returns a name without the parts that all names have in common."""
    parts = [one.split(".") for one in names]
    begin = end = 0
    while all(len(one) > begin + 1 and one[begin] == parts[0][begin] for one in parts):
        begin += 1
    while all(len(one) > begin + end + 1 and one[-1 - end] == parts[0][-1 - end] for one in parts):
        end += 1
    own = name.split(".")
    return ".".join(own[begin : len(own) - end])

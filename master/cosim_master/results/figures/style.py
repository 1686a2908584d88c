"""The style of all figures: sizes, colours for colour-blind readers, names without overlaps, and very many lines.

Up to `NAMED` lines have names. More than that are drawn as quantiles over time, or as thin lines whose colours a colour
bar explains: names would cover the picture.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master.results.reading.flight import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "DASHES",
    "NAMED",
    "STYLE",
    "WIDTH",
    "around",
    "colour_bar",
    "colours",
    "draw_lines",
    "draw_quantiles",
    "label_ends",
    "plain",
    "short",
    "some",
    "together",
]

NAMED = 20
"""Largest number of lines with names."""
WIDTH = 7.0
"""Inches: two columns of a journal."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")
"""Okabe and Ito's colours, in an order that also alternates in grey."""
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
STYLE = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "pdf.fonttype": 42,
    "savefig.dpi": 200,
    "svg.hashsalt": "uav-cosim",
}
_INSTANTS = 700
"""Instants of each of very many lines: more than a figure has pixels."""
_MOST_LINES = 200
"""Thin lines in one picture; of more, evenly chosen ones are drawn."""
_LONGEST = 28
"""Characters of a name; a longer one would leave no room for the picture."""
_MAP = "cividis"
"""Perceptually uniform, also in grey and for colour-blind readers."""
_SHARES = ((0, 100, "0.88", "least to greatest"), (5, 95, "0.75", "5 to 95 %"), (25, 75, "0.58", "25 to 75 %"))


def colours(n: int) -> list[Any]:
    """Returns n colours: distinct ones for a few lines, a scale for many."""
    from matplotlib import colormaps

    return list(COLOURS[:n]) if n <= len(COLOURS) else list(colormaps[_MAP](np.linspace(0.0, 0.9, n)))


def draw_quantiles(axes: Axes, time: Array, values: Array, *, median: bool = True) -> None:
    """Draws median, middle half, 90 % and extremes of many curves over time; the legend has their names.

    Args:
        time: (n,)
        values: (n, number of curves); NaN for missing values.
        median: draw the median, too; otherwise all is lighter, for other lines on it.
    """
    rows = some(len(time))
    known = values[rows]
    kept = np.isfinite(known).any(axis=1)
    rows, known = rows[kept], known[kept]
    if not len(rows):
        return
    for low, high, grey, label in _SHARES:
        least, most = np.nanpercentile(known, (low, high), axis=1)
        shade = grey if median else str(0.5 + 0.5 * float(grey))  # lines on it remain visible
        axes.fill_between(time[rows], least, most, color=shade, linewidth=0.0, label=label)
    if median:
        axes.plot(time[rows], np.nanmedian(known, axis=1), color="black", label="median")


def draw_lines(axes: Axes, x: Array, y: Array, *, linewidth: float = 0.6, most: int = _MOST_LINES) -> Any:
    """Draws many thin lines whose colours are their numbers, from 1; returns what a colour bar needs.

    Args:
        x, y: (n, number of lines).
        most: of more lines, so many evenly chosen ones are drawn.
    """
    from matplotlib.collections import LineCollection

    rows, chosen = some(len(y)), some(y.shape[1], most)
    points = np.stack([x[rows][:, chosen].T, y[rows][:, chosen].T], axis=2)
    lines = LineCollection(list(points), cmap=_MAP, linewidths=linewidth, rasterized=True)
    lines.set_array(chosen + 1.0)
    lines.set_clim(1, y.shape[1])
    axes.add_collection(lines, autolim=True)
    axes.autoscale_view()
    return lines


def some(n: int, most: int = _INSTANTS) -> Any:
    """Returns at most so many evenly chosen numbers below n, with the first and the last."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def around(middle: float, size: float) -> tuple[float, float]:
    """Returns the bounds of an axis."""
    return middle - 0.5 * size, middle + 0.5 * size


def colour_bar(figure: Figure, drawn: Any, axes: Any, label: str) -> None:
    """Draws the scale of colours to the right of axes."""
    bar = figure.colorbar(drawn, ax=axes, label=label, pad=0.015, aspect=40, fraction=0.05)
    bar.outline.set_linewidth(0.5)
    bar.ax.tick_params(width=0.5)


def label_ends(axes: Axes, ends: Sequence[tuple[float, str, Any]], inches: float) -> None:
    """Writes names to the right of the lines' ends, without overlaps.

    `inches` is the approximate height of the axes.
    """
    if not ends:
        return
    ends = sorted(ends, key=lambda end: end[0])
    low, high = axes.get_ylim()
    gap = 9.0 / 72.0 / inches * (high - low)
    places = [y for y, _, _ in ends]
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + gap)
    places[-1] = min(places[-1], high)
    for i in range(len(places) - 1, 0, -1):
        places[i - 1] = min(places[i - 1], places[i] - gap)
    for (_, name, colour), place in zip(ends, places, strict=True):
        where = ("axes fraction", "data")
        axes.annotate(name, (1.0, place), (4.0, 0.0), where, "offset points", color=colour, va="center")


def plain(text: str) -> str:
    """Returns a text that is drawn as it is: no mathematics between dollars, only printable characters, not long."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    if len(shown) > _LONGEST:
        shown = f"{shown[: _LONGEST // 2]}...{shown[-_LONGEST // 2 + 3 :]}"
    return shown.replace("$", r"\$")


def short(name: str) -> str:
    """Returns the number at the end of a name, or the name."""
    number = re.search(r"\d+$", name)
    return number[0] if number else name


def together(places: Mapping[str, Array], near: Array) -> list[tuple[str, Array]]:
    """Returns names with places; those within `near` of the previous one are joined above the highest one."""
    groups: list[tuple[list[str], list[Array]]] = []
    for name, place in places.items():
        for names, members in groups:
            if (np.abs(place - members[-1]) < near).all():
                names.append(name)
                members.append(place)
                break
        else:
            groups.append(([name], [place]))
    return [(", ".join(names), max(members, key=lambda place: float(place[-1]))) for names, members in groups]

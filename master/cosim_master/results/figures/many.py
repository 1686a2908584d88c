"""Figures of the motion of very many drones, whose names would cover the picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master.results.figures.steps import moments, time_axis
from cosim_master.results.figures.style import (
    COLOURS,
    WIDTH,
    around,
    colour_bar,
    draw_lines,
    draw_quantiles,
    label_ends,
    some,
)
from cosim_master.results.reading.flight import Array, Drone, Flight

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LONG", "draw_folded_map", "draw_on_line", "draw_places", "draw_scattered"]

LONG = 100
"""Most drones on a line that a figure shows beside each other; a longer line is folded, or drawn by numbers."""
_PIECE, _PIECES = 150, 8
"""Drones in each piece of a folded line, and most pieces."""
_PANEL = 1.95
"""Width of one of three panels, inches."""
_STILL = 0.25
"""Of the distances between drones: a swarm that moves less is shown by its movements, not by its places."""
_SOME, _LINES = 25, 80
"""Lines on quantiles, which more would cover, and lines beside them, which more would merge."""


# ---- positions over time ---------------------------------------------------------------------------------------------


def draw_on_line(flight: Flight, label: str) -> Figure:
    """Draws the eastern positions of drones on a line, a thin line for each of some, and how much they change.

    Of more than `LONG` drones, those that change most have names.
    """
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 5.4), layout="constrained")
    all_axes = list(figure.subplots(2, 1, sharex=True))
    flown = {drone.name: drone.position[:, 1] for drone in flight.drones if drone.position is not None}
    shown = flown or {drone.name: drone.target for drone in flight.drones if drone.target is not None}
    values = np.stack([*shown.values()], axis=1)
    colour_bar(figure, _thin_lines(all_axes[0], flight, values, label), all_axes, "number of the drone")
    # most of the picture is the distances between the drones
    begin = flight.row(min(flight.steps.values(), default=float(flight.time[0])))
    known = np.where(np.isfinite(values), values, np.nan)
    draw_quantiles(all_axes[-1], flight.time, known - known[begin])
    all_axes[-1].set_ylabel("change since step 1 (m)" if flight.steps else "change (m)")
    figure.legend(*all_axes[-1].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    time_axis(all_axes, flight)
    if len(shown) > LONG and np.isfinite(known).all():
        _name_extremes(all_axes[-1], flight.time, known - known[begin], [*shown], inches=2.0)
    return figure


def draw_places(flight: Flight) -> Figure:
    """Draws places, heights and ways from the start as shares of the drones.

    A swarm that moves little, compared with the distances in it, is shown by its movements, with the names of the
    drones that differ most; otherwise places of some drones are thin lines.
    """
    from matplotlib.figure import Figure

    names = [drone.name for drone in flight.drones if drone.position is not None]
    places = np.stack([drone.position for drone in flight.drones if drone.position is not None], axis=1)
    moved = places - places[0]
    still = np.abs(moved[:, :, :2]).max() < _STILL * np.ptp(places[0, :, :2], axis=0).max()
    figure = Figure((WIDTH, 6.4), layout="constrained")
    all_axes = list(figure.subplots(4, 1, sharex=True))
    for axes, name, i in zip(all_axes, ("north", "east"), (0, 1), strict=False):
        draw_quantiles(axes, flight.time, (moved if still else places)[:, :, i], median=still)
        if still:
            axes.set_ylabel(f"moved {name} (m)")
        else:
            drawn = _thin_lines(axes, flight, places[:, :, i], f"{name} (m)", _SOME)
    if not still:
        colour_bar(figure, drawn, all_axes[:2], "number of the drone")
    way = np.hypot(moved[:, :, 0], moved[:, :, 1])
    for axes, label, values in (
        (all_axes[2], "height (m)", -places[:, :, 2]),
        (all_axes[3], "from the start (m)", way),
    ):
        draw_quantiles(axes, flight.time, values)
        axes.set_ylabel(label)
    all_axes[3].set_ylim(bottom=0.0, top=max(1.0, all_axes[3].get_ylim()[1]))
    legend = all_axes[3].get_legend_handles_labels()
    if still:
        for axes, values in zip(all_axes, (moved[:, :, 0], moved[:, :, 1], -places[:, :, 2], way), strict=True):
            low, high = axes.get_ylim()
            if high - low < 1.0 and axes is not all_axes[3]:  # smaller differences mean nothing
                axes.set_ylim(around(0.5 * (low + high), 1.0))
            _name_extremes(axes, flight.time, values, names, inches=1.2)
    figure.legend(*legend, loc="outside lower center", ncols=4)
    time_axis(all_axes, flight, whole=True)
    figure.align_ylabels(all_axes)
    return figure


def _thin_lines(axes: Axes, flight: Flight, values: Array, label: str, most: int = _LINES) -> Any:
    axes.set_ylabel(label)
    time = np.repeat(flight.time[:, None], values.shape[1], axis=1)
    return draw_lines(axes, time, values, linewidth=0.5 if most > _SOME else 0.9, most=most)


def _name_extremes(axes: Axes, time: Array, values: Array, names: Sequence[str], inches: float) -> None:
    """Draws and names the curves that are farthest above and below the median at any time, if that can be seen."""
    rows = some(len(time))
    apart = values[rows] - np.nanmedian(values[rows], axis=1, keepdims=True)
    low, high = axes.get_ylim()
    ends = []
    for extreme, colour in ((np.nanmax(apart, axis=0), COLOURS[1]), (-np.nanmin(apart, axis=0), COLOURS[0])):
        i = int(np.nanargmax(extreme))
        if extreme[i] > 0.08 * (high - low):
            axes.plot(time[rows], values[rows, i], color=colour, linewidth=0.9, label=names[i])
            ends.append((float(values[-1, i]), names[i], colour))
    label_ends(axes, ends, inches)


# ---- from above, and in space ----------------------------------------------------------------------------------------


def draw_folded_map(flown: Sequence[tuple[Drone, Array]], reach: float | None) -> Figure:
    """Draws a long line of drones from above, in pieces below each other; a colour says how far a drone has moved.

    Args:
        flown: drones with their positions.
        reach: range of the radio in m, marked around a drone in the middle; None if it is unlimited.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    places = np.stack([position[:, :2] for _, position in flown], axis=1)
    along = int(np.argmax(np.ptp(places, axis=(0, 1))))
    axis, other = ("north", "east")[along], ("north", "east")[1 - along]
    first, last, across = places[0, :, along], places[-1, :, along], places[:, :, 1 - along]
    low, high = float(places[:, :, along].min()), float(places[:, :, along].max())
    pieces = min(_PIECES, -(-len(flown) // _PIECE))
    length = (high - low) / pieces
    figure = Figure((WIDTH, 0.9 + 0.62 * pieces), layout="constrained")
    all_axes = list(figure.subplots(pieces, 1, sharey=True, squeeze=False)[:, 0])
    moved = last - first
    most = max(0.1, float(np.abs(moved).max()))
    marks = [
        Line2D([], [], color="0.6", marker="|", markersize=9.0, linestyle="", label="start"),
        Line2D([], [], color="0.3", marker="o", markersize=4.0, linestyle="", label="end"),
    ]
    middle = int(np.argmin(np.abs(last - 0.5 * (low + high))))
    for k, axes in enumerate(all_axes):
        begin = low + k * length
        axes.axhline(float(np.median(across)), color="0.85", linewidth=0.6, zorder=0)
        here = np.abs(last - begin - 0.5 * length) < length  # and a little beside it
        axes.plot(first[here], across[0, here], "|", color="0.6", markersize=9.0, markeredgewidth=0.6, rasterized=True)
        spots = {"s": 9.0, "edgecolors": "0.25", "linewidths": 0.25, "zorder": 3, "rasterized": True}
        drawn = axes.scatter(last[here], across[-1, here], c=moved[here], cmap="PuOr", vmin=-most, vmax=most, **spots)
        for edge in () if reach is None else (last[middle] - reach, last[middle] + reach):
            axes.axvline(edge, color="0.3", linestyle=":", linewidth=1.0)
        axes.set_xlim(begin - 0.012 * length, begin + 1.012 * length)
    all_axes[0].set_ylim(around(float(np.median(across)), max(2.0, 1.3 * float(np.ptp(across)))))
    if reach is not None and reach < 0.5 * (high - low):
        label = f"radio range of {flown[middle][0].name}, {reach:g} m"
        marks.append(Line2D([], [], color="0.3", linestyle=":", label=label))
    colour_bar(figure, drawn, all_axes, f"moved {axis} (m)")
    figure.supylabel(f"{other} (m)", fontsize=8.0)
    said = f"{axis} (m), in {pieces} pieces; the scale of {other} is %s times as large"
    all_axes[-1].set_xlabel(said % "1000")
    figure.legend(handles=marks, loc="outside upper right", ncols=3)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.execute(figure)
    figure.set_layout_engine("none")
    box, (bottom, top) = all_axes[0].get_window_extent(), all_axes[0].get_ylim()
    larger = box.height / (top - bottom) / (box.width / (1.024 * length))
    all_axes[-1].set_xlabel(said % f"{larger:.2g}")
    return figure


def draw_scattered(flight: Flight, flown: Sequence[tuple[Drone, Array]]) -> Figure:
    """Draws very many drones as points at the end of three steps: from above, or a line of drones from its side."""
    from matplotlib.figure import Figure

    places = np.stack([position for _, position in flown], axis=1)
    north, east, height = places[:, :, 0], places[:, :, 1], -places[:, :, 2]
    size = np.array([np.ptp(east), np.ptp(north)])
    wide, line = size[0] >= 3.0 * size[1], size[1] < 0.02 * size[0]
    if line and len(flown) > LONG:
        return _draw_profiles(flight, [drone.name for drone, _ in flown], east, height)
    up, colour = (height, np.broadcast_to(np.arange(1, len(flown) + 1), height.shape)) if line else (north, height)
    tall = (
        (3.4 if line else 4.6) if wide else float(np.clip(0.75 + _PANEL * (size[1] + 1.0) / (size[0] + 1.0), 1.6, 3.6))
    )
    figure = Figure((WIDTH, tall), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True) if wide else figure.subplots(1, 3, sharey=True)
    when = moments(flight)
    rows = [flight.row(time) for _, time in when]
    low, high = float(colour[rows].min()), float(colour[rows].max())
    if high - low < 1.0:  # smaller differences mean nothing
        low = min(low, 0.0)
        high = max(high, low + 1.0)
    for axes, (title, _), row in zip(panels, when, rows, strict=True):
        spots = {"s": min(20.0, 150.0 / np.sqrt(len(flown))), "linewidths": 0.0, "rasterized": True}
        drawn = axes.scatter(
            east[row], up[row], c=colour[row], cmap="cividis" if line else "viridis", vmin=low, vmax=high, **spots
        )
        axes.set_title(title, fontsize=8.0)
        axes.set(xlim=around(0.5 * (east.min() + east.max()), 1.08 * size[0] + 1.0))
        if line:
            axes.set_ylim(min(0.0, float(up.min())) - 1.0, 1.15 * max(1.0, float(up.max())))
        else:
            axes.set_ylim(around(0.5 * (north.min() + north.max()), 1.08 * size[1] + 1.0))
        if not wide:
            axes.set_aspect("equal")
    for axes in panels if wide else panels[:1]:
        axes.set_ylabel("height (m)" if line else "north (m)")
    for axes in panels[-1:] if wide else panels:
        axes.set_xlabel("east (m)")
    colour_bar(figure, drawn, panels, "number of the drone" if line else "height (m)")
    return figure


def _draw_profiles(flight: Flight, names: Sequence[str], east: Array, height: Array) -> Figure:
    """Draws a long line of drones at the end of three steps: how far each is from its place, and its height.

    The place is the fixed point of the law, where agents declare one; otherwise, where the drone was at the first of
    the three steps.
    """
    from matplotlib.figure import Figure

    when = moments(flight)
    rows = [flight.row(time) for _, time in when]
    point = flight.law[0] if flight.law is not None and flight.steps else {}
    place = np.array([point.get(name, np.nan) for name in names]) if point else east[rows[0]]
    figure = Figure((WIDTH, 3.6), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey="row", height_ratios=(2.0, 1.0))
    numbers = np.arange(1, len(names) + 1)
    spots = {"s": 3.0, "linewidths": 0.0, "rasterized": True}
    for (upper, lower), (title, _), row in zip(grid.T, when, rows, strict=True):
        upper.axhline(0.0, color="0.4", linewidth=0.7)
        upper.scatter(numbers, east[row] - place, color=COLOURS[0], **spots)
        lower.scatter(numbers, height[row], color=COLOURS[2], **spots)
        upper.set_title(title, fontsize=8.0)
        lower.set_xlabel("number of the drone")
    grid[0, 0].set_ylabel("east of even spacing (m)" if point else "moved east (m)")
    grid[1, 0].set_ylabel("height (m)")
    grid[1, 0].set_ylim(min(0.0, float(height[rows].min())) - 0.5, 1.15 * max(1.0, float(height[rows].max())))
    low, high = grid[0, 0].get_ylim()
    if high - low < 1.0:  # smaller differences mean nothing
        grid[0, 0].set_ylim(around(0.5 * (low + high), 1.0))
    figure.align_ylabels(grid[:, 0])
    return figure

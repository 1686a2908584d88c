"""Figures of the motion of all drones: over time, in space, from above, and the errors of their law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master.results.figures.many import LONG, draw_folded_map, draw_on_line, draw_places, draw_scattered
from cosim_master.results.figures.steps import moments, time_axis
from cosim_master.results.figures.style import (
    DASHES,
    NAMED,
    WIDTH,
    around,
    colour_bar,
    colours,
    draw_lines,
    draw_quantiles,
    label_ends,
    short,
    together,
)
from cosim_master.results.reading.flight import Array, Flight

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_altitude", "draw_errors", "draw_map", "draw_positions", "draw_snapshots"]


def draw_positions(flight: Flight) -> Figure:
    """Draws desired and actual positions over time: east if agents exist, otherwise north, east and height."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    on_line = any(drone.target is not None for drone in flight.drones)
    quantities = [("position east (m)", 1, 1.0)]
    if len(flight.drones) > NAMED:
        return draw_on_line(flight, quantities[0][0]) if on_line else draw_places(flight)
    if not on_line:
        quantities = [("north (m)", 0, 1.0), ("east (m)", 1, 1.0), ("height (m)", 2, -1.0)]
    figure = Figure((WIDTH, 3.6 if on_line else 5.4), layout="constrained")
    all_axes = list(figure.subplots(len(quantities), 1, sharex=True, squeeze=False)[:, 0])
    for axes, (label, i, sign) in zip(all_axes, quantities, strict=True):
        ends = []
        for drone, colour in zip(flight.drones, colours(len(flight.drones)), strict=True):
            if drone.target is not None:
                axes.plot(flight.time, drone.target, "-", color=colour, linewidth=0.8, label=f"{drone.name} desired")
                end = drone.target[-1]
            if drone.position is not None:
                actual, dashes = sign * drone.position[:, i], "--" if on_line else "-"
                axes.plot(flight.time, actual, dashes, color=colour, linewidth=1.3, label=f"{drone.name} actual")
                end = actual[-1]
            ends.append((float(end), drone.name, colour))
        axes.set_ylabel(label)
        label_ends(axes, ends, inches=0.75 * figure.get_figheight() / len(all_axes))
    time_axis(all_axes, flight, whole=not on_line)
    if on_line:
        lines = [Line2D([], [], color="0.2", linestyle=dashes) for dashes in ("-", "--")]
        figure.legend(lines, ["desired", "actual"], loc="outside upper right", ncols=2)
    return figure


def draw_map(flight: Flight, reach: float | None = None) -> Figure | None:
    """Draws the paths of all drones from above, with their starts and ends; returns None without positions.

    Args:
        flight: the recording.
        reach: range of the radio in m, drawn around a drone in the middle; None if it is unlimited.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle

    flown = [(drone, drone.position) for drone in flight.drones if drone.position is not None]
    if not flown:
        return None
    north, east = (np.stack([position[:, i] for _, position in flown], axis=1) for i in (0, 1))
    size = np.array([np.ptp(east), np.ptp(north)])
    slim = size.min() < 0.15 * size.max()
    if slim and len(flown) > LONG:
        return draw_folded_map(flown, reach)
    height = 2.4 if slim and size[0] >= size[1] else 5.4
    figure = Figure((WIDTH, height), layout="constrained")
    axes = figure.subplots()
    marks = [
        Line2D([], [], color="0.3", marker="o", markersize=4.5, markerfacecolor="white", linestyle="", label="start"),
        Line2D([], [], color="0.3", marker="o", markersize=4.5, linestyle="", label="end"),
    ]
    if len(flown) > NAMED:
        drawn = draw_lines(axes, east, north, linewidth=0.7)
        colour_bar(figure, drawn, axes, "number of the drone")
        spot = 60.0 / np.sqrt(len(flown)) if slim else min(36.0, 12_000.0 / len(flown))  # pt^2: side by side
        axes.scatter(east[0], north[0], s=spot, facecolors="white", edgecolors="0.6", linewidths=0.4, rasterized=True)
        numbers = np.arange(1, len(flown) + 1)
        axes.scatter(east[-1], north[-1], s=spot, c=numbers, cmap="cividis", linewidths=0.0, zorder=3, rasterized=True)
    else:
        for k, ((drone, _), colour) in enumerate(zip(flown, colours(len(flown)), strict=True)):
            axes.plot(east[:, k], north[:, k], color=colour, label=drone.name)
            axes.plot(east[0, k], north[0, k], "o", color=colour, markersize=5.0, markerfacecolor="white")
            axes.plot(east[-1, k], north[-1, k], "o", color=colour, markersize=5.0)
    if reach is not None:
        middle = np.array([np.median(east[-1]), np.median(north[-1])])
        k = int(np.argmin((east[-1] - middle[0]) ** 2 + (north[-1] - middle[1]) ** 2))
        axes.add_patch(Circle((east[-1, k], north[-1, k]), reach, fill=False, edgecolor="0.5", linestyle=":"))
        marks.append(
            Line2D([], [], color="0.5", linestyle=":", label=f"radio range of {flown[k][0].name}, {reach:g} m")
        )
    axes.set(xlabel="east (m)", ylabel="north (m)")
    axes.autoscale_view()
    axes.margins(0.06)
    _room(axes, size, slim=slim)
    if len(flown) <= NAMED:
        ends = zip(flown, east[-1], north[-1], colours(len(flown)), strict=True)
        _name_ends(figure, axes, [(drone.name, e, n, colour) for (drone, _), e, n, colour in ends])
    figure.legend(handles=marks, loc="outside upper right", ncols=3)
    return figure


def _room(axes: Axes, size: Array, *, slim: bool) -> None:
    """Makes scales equal, unless the swarm is on a line: then the other axis shows some metres."""
    if not slim:
        axes.set_aspect("equal", adjustable="datalim")
        return
    least = max(0.1 * float(size.max()), 2.0)
    for bounds, change in ((axes.get_ylim(), axes.set_ylim), (axes.get_xlim(), axes.set_xlim)):
        if bounds[1] - bounds[0] < least:
            change(around(0.5 * (bounds[0] + bounds[1]), least))


def _name_ends(figure: Figure, axes: Axes, ends: Sequence[tuple[str, float, float, Any]]) -> None:
    """Writes names beside points, in their colours; of several places, the first without overlaps."""
    figure.draw_without_rendering()  # sets the scales
    taken: list[tuple[float, float, float, float]] = []
    points = {name: axes.transData.transform((x, y)) * 72.0 / figure.dpi for name, x, y, _ in ends}
    width = 72.0 * figure.get_figwidth()
    taken += [(x - 3.0, y - 3.0, x + 3.0, y + 3.0) for x, y in points.values()]
    for name, (x, y) in points.items():
        wide, high = 4.3 * len(name), 8.0
        choices = (
            (5.0, 3.0), (5.0, -11.0), (-5.0 - wide, 3.0), (-5.0 - wide, -11.0), (-0.5 * wide, 6.0),
            (-0.5 * wide, -15.0),            (-0.5 * wide, 16.0), (-0.5 * wide, -25.0), (9.0, 16.0), (9.0, -25.0),
        )  # fmt: skip
        boxes = [(x + dx, y + dy, x + dx + wide, y + dy + high) for dx, dy in choices]
        free = [i for i, box in enumerate(boxes) if box[2] < width and not any(_overlap(box, other) for other in taken)]
        if not free:
            continue  # no name is better than two on top of each other
        taken.append(boxes[free[0]])
        place, colour = next(((e, n), colour) for known, e, n, colour in ends if known == name)
        style = {"textcoords": "offset points", "fontsize": 7.5, "annotation_clip": False, "color": colour}
        axes.annotate(name, place, choices[free[0]], **style)


def _overlap(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def draw_snapshots(flight: Flight) -> Figure | None:
    """Draws all drones in space (not to scale) at the end of three steps; returns None without positions."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    flown = [
        (d, d.position, c)
        for d, c in zip(flight.drones, colours(len(flight.drones)), strict=True)
        if d.position is not None
    ]
    if not flown:
        return None
    if len(flown) > NAMED:
        return draw_scattered(flight, [(drone, position) for drone, position, _ in flown])
    space = np.concatenate([position for _, position, _ in flown])[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
    low, high = space.min(axis=0), space.max(axis=0)
    low[2] = min(low[2], 0.0)
    size = np.maximum(high - low, max(0.12 * (high - low).max(), 1.0)) * (1.0, 1.0, 1.25)
    middle = 0.5 * (low + high)
    figure = Figure((WIDTH, 2.5))
    figure.subplots_adjust(left=0.01, right=0.95, bottom=0.04, top=0.9, wspace=0.14)
    for panel, (title, time) in enumerate(moments(flight), start=1):
        axes: Any = figure.add_subplot(1, 3, panel, projection="3d")
        row = flight.row(time)
        for drone, position, colour in flown:
            north, east, down = position[row]
            axes.plot([east, east], [north, north], [low[2], -down], color="0.6", linewidth=0.7)
            axes.plot([east], [north], [-down], "o", color=colour, markersize=4.5, label=drone.name)
            if drone.target is not None and np.isfinite(drone.target[row]):
                ring = {"markerfacecolor": "none", "markeredgecolor": colour, "markersize": 7.0, "markeredgewidth": 0.7}
                axes.plot([drone.target[row]], [north], [-down], "o", label=f"{drone.name} desired", **ring)
        if len(flown) <= NAMED:
            places = {short(drone.name): position[row, [1, 0, 2]] * (1.0, 1.0, -1.0) for drone, position, _ in flown}
            for names, place in together(places, size * (0.05, 0.05, 0.2)):
                axes.text(place[0], place[1], place[2] + 0.07 * size[2], names, ha="center", va="bottom")
        axes.set(xlim=around(middle[0], size[0]), ylim=around(middle[1], size[1]), zlim=(low[2], low[2] + size[2]))
        axes.set_title(title, fontsize=8.0, y=0.98)
        for axis, label, pad in (
            (axes.xaxis, "east (m)", -5),
            (axes.yaxis, "north (m)", -5),
            (axes.zaxis, "height (m)", -7),
        ):
            axis.set_label_text(label)
            axis.labelpad = pad
            axis.set_major_locator(MaxNLocator(4 if axis is axes.xaxis else 3))
        low_north, high_north = axes.get_ylim()
        north_ticks = [y for y in MaxNLocator(3).tick_values(low_north, high_north) if low_north <= y <= high_north]
        axes.set_yticks(north_ticks[1:])  # the first would touch the last of the eastern axis
        axes.patch.set_visible(False)
        axes.tick_params(pad=-3, labelsize=7)
        axes.set_box_aspect((1.5, 0.9, 0.9), zoom=0.98)
        axes.set_proj_type("ortho")  # equal scales on all axes
        axes.view_init(elev=22, azim=-62)
    if flight.steps:
        marks = [Line2D([], [], color="0.2", marker="o", linestyle="", markersize=4.5, label="actual")]
        marks += [Line2D([], [], color="0.2", marker="o", linestyle="", markersize=7.0, mfc="none", label="desired")]
        figure.legend(handles=marks, loc="upper right", ncols=2, handletextpad=0.1)
    return figure


def draw_errors(flight: Flight) -> Figure | None:
    """Draws the distance of mobile drones to the law's fixed point, and its bound; None without a law or a step."""
    from matplotlib.figure import Figure

    if flight.law is None or not flight.steps:
        return None
    point, rate = flight.law
    begin = flight.row(min(flight.steps.values()))
    figure = Figure((WIDTH, 3.4), layout="constrained")
    axes = figure.subplots()
    start: list[float] = []
    errors: list[Array] = []
    many = len(point) > NAMED
    for drone, colour in zip(flight.drones, colours(len(flight.drones)), strict=True):
        if drone.name in point and drone.position is not None:
            error = np.abs(drone.position[begin:, 1] - point[drone.name])
            # Symmetrically placed drones have equal errors: a thin line is visible on a thick one.
            errors.append(error)
            dashes, width = DASHES[len(start) % 5], 1.1 if start else 1.8
            start.append(float(error[0]))
            if many:
                continue
            axes.semilogy(flight.time[begin:], error, linestyle=dashes, linewidth=width, color=colour, label=drone.name)
    if len(start) < len(point):
        return None
    if many:
        draw_quantiles(axes, flight.time[begin:], np.stack(errors, axis=1))
        axes.set_yscale("log")
    if rate < 1.0:
        norm = float(np.linalg.norm(start))
        steps = np.array(sorted(flight.steps))
        done = np.maximum(steps - steps[0] - 1, 0)
        times = [flight.steps[k] for k in steps]
        digits = max(4, int(np.ceil(1.0 - np.log10(1.0 - rate))))
        label = rf"bound of the law, {norm:.1f} m $\times$ {rate:.{digits}f}$^k$"
        axes.semilogy(times, norm * rate**done, ":", color="0.4", marker=".", markersize=3, label=label)
    axes.set_ylabel("distance to even spacing (m)")
    least = 0.5 * float(np.nanmin(np.percentile(errors, 5, axis=0))) if many else 0.0  # below it, noise of a few
    axes.set_ylim(bottom=max(0.01, least, axes.get_ylim()[0]))
    axes.yaxis.set_major_formatter("{x:g}")
    time_axis([axes], flight)
    figure.legend(loc="outside upper center", ncols=3 if many else 4, columnspacing=1.2)
    return figure


def draw_altitude(flight: Flight) -> Figure | None:
    """Draws heights over time and the smallest distance between any two drones; returns None without positions."""
    from matplotlib.figure import Figure

    flown = [
        (d, d.position, c)
        for d, c in zip(flight.drones, colours(len(flight.drones)), strict=True)
        if d.position is not None
    ]
    if not flown:
        return None
    figure = Figure((WIDTH, 4.0 if len(flown) > 1 else 2.4), layout="constrained")
    all_axes = list(figure.subplots(2 if len(flown) > 1 else 1, 1, sharex=True, squeeze=False)[:, 0])
    if len(flown) > NAMED:
        draw_quantiles(all_axes[0], flight.time, np.stack([-position[:, 2] for _, position, _ in flown], axis=1))
    for i, (drone, position, colour) in enumerate(flown if len(flown) <= NAMED else ()):
        height = -position[:, 2]
        width = 1.0 + 3.0 * (len(flown) - 1 - i) / max(len(flown) - 1, 1)  # equal curves remain visible on each other
        all_axes[0].plot(flight.time, height, linestyle=DASHES[i % 5], linewidth=width, color=colour, label=drone.name)
    all_axes[0].set_ylabel("height (m)")
    if len(flown) > 1:
        nearest = _separation([position for _, position, _ in flown])
        all_axes[1].plot(flight.time, nearest, color="black")
        all_axes[1].set_ylabel("smallest distance (m)")
        all_axes[1].set_ylim(0.0, 1.08 * max(float(np.nanmax(nearest)), 0.1))
    time_axis(all_axes, flight, whole=True)
    figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=6)
    return figure


def _separation(positions: Sequence[Array]) -> Array:
    """Returns the smallest distance [m] between any two drones at every instant."""
    everyone = np.stack(positions)
    # Sorted along the axis of the widest spread, the nearest drone is only a few places away: the search stops when no
    # drone farther away in this order can be nearer.
    axis = int(np.argmax(np.ptp(everyone, axis=0).max(axis=0)))
    everyone = np.take_along_axis(everyone, np.argsort(everyone[:, :, axis], axis=0)[:, :, None], axis=0)
    least = np.full(everyone.shape[1], np.inf)
    for apart in range(1, len(positions)):
        between = everyone[apart:] - everyone[:-apart]
        if (between[:, :, axis].min(axis=0) >= least).all():
            break
        np.minimum(least, np.sqrt(np.square(between).sum(axis=2)).min(axis=0), out=least)
    return least

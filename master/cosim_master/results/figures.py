"""Figures of a run, for papers: positions over time, positions at steps, convergence, and altitudes.

    positions   desired and actual position of every drone over time, the steps of the algorithm marked
    snapshots   where all drones are in space when three of the steps begin
    errors      distance of every mobile drone to the law's fixed point, even spacing, and the law's bound
    altitude    heights over time, and the smallest distance between any two drones

Without agents, a run has no steps: positions then have three axes, and snapshots are taken at start, middle and end.
Each figure contains the digest of its data as "Source"; a new run in the same folder removes the figure. The same run
gives the same bytes: fonts and style are Matplotlib's defaults, whatever its configuration.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.flight import Array, Flight, read_flight
from cosim_master.results.run_folder import stamp

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_altitude", "draw_errors", "draw_positions", "draw_snapshots", "figures"]

SNAPSHOTS = (1, 9, 17)
"""Steps whose starts are shown in space, if the run reached them; otherwise its first, middle and last step."""

_NAMED = 20  # with more drones, names would cover the picture
_WIDTH = 7.0  # inches: two columns of a journal
# Okabe and Ito's colours, which remain distinct for colour-blind readers, in an order that also alternates in grey.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")
_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
_STYLE = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "savefig.dpi": 200,
    "svg.hashsalt": "uav-cosim",
}


def figures(run: Path, folder: Path | None = None) -> list[Path]:
    """Draws all figures that the recording of a run allows, each as PNG and SVG.

    Args:
        run: folder of the run.
        folder: the folder to write to, created if necessary. None: the folder of the run.

    Returns:
        The files written.

    Raises:
        CosimError: the run is not complete, there is nothing to draw, or a file cannot be written.
    """
    from matplotlib import style

    folder = folder or run
    flight = read_flight(run)
    drawn_of = stamp(run)
    drawers: dict[str, Callable[[Flight], Figure | None]] = {
        "positions": draw_positions,
        "snapshots": draw_snapshots,
        "errors": draw_errors,
        "altitude": draw_altitude,
    }
    files = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, draw in drawers.items():
            with style.context(["default", _STYLE]):
                figure = draw(flight)
                if figure is None:
                    continue
                for suffix, metadata in ((".png", {"Source": drawn_of}), (".svg", {"Source": drawn_of, "Date": None})):
                    files.append(folder / f"{name}{suffix}")
                    figure.savefig(files[-1], metadata=metadata)
    except OSError as error:
        raise CosimError(f"{folder}: figures cannot be written: {error.strerror or error}") from error
    return files


def draw_positions(flight: Flight) -> Figure:
    """Draws desired and actual positions over time: east if agents exist, otherwise north, east and height."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    on_line = any(drone.target is not None for drone in flight.drones)
    quantities = [("position east (m)", 1, 1.0)]
    if not on_line:
        quantities = [("north (m)", 0, 1.0), ("east (m)", 1, 1.0), ("height (m)", 2, -1.0)]
    figure = Figure((_WIDTH, 3.6 if on_line else 5.4), layout="constrained")
    all_axes = list(figure.subplots(len(quantities), 1, sharex=True, squeeze=False)[:, 0])
    for axes, (label, i, sign) in zip(all_axes, quantities, strict=True):
        ends = []
        for drone, colour in zip(flight.drones, _colours(flight), strict=True):
            if drone.target is not None:
                axes.plot(flight.time, drone.target, "-", color=colour, linewidth=0.8, label=f"{drone.name} desired")
                end = drone.target[-1]
            if drone.position is not None:
                actual, dashes = sign * drone.position[:, i], "--" if on_line else "-"
                axes.plot(flight.time, actual, dashes, color=colour, linewidth=1.3, label=f"{drone.name} actual")
                end = actual[-1]
            ends.append((float(end), drone.name, colour))
        axes.set_ylabel(label)
        _label_ends(axes, ends, inches=0.75 * figure.get_figheight() / len(all_axes))
    _time_axis(all_axes, flight, whole=not on_line)
    if on_line:
        lines = [Line2D([], [], color="0.2", linestyle=dashes) for dashes in ("-", "--")]
        figure.legend(lines, ["desired", "actual"], loc="outside upper right", ncols=2)
    return figure


def draw_snapshots(flight: Flight) -> Figure | None:
    """Draws all drones in space (not to scale) at the start of three steps; returns None without positions."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    flown = [(d, d.position, c) for d, c in zip(flight.drones, _colours(flight), strict=True) if d.position is not None]
    if not flown:
        return None
    space = np.concatenate([position for _, position, _ in flown])[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
    low, high = space.min(axis=0), space.max(axis=0)
    low[2] = min(low[2], 0.0)
    size = np.maximum(high - low, max(0.12 * (high - low).max(), 1.0)) * (1.0, 1.0, 1.25)
    middle = 0.5 * (low + high)
    figure = Figure((_WIDTH, 2.5))
    figure.subplots_adjust(left=0.01, right=0.95, bottom=0.04, top=0.9, wspace=0.14)
    for panel, (title, time) in enumerate(_moments(flight), start=1):
        axes: Any = figure.add_subplot(1, 3, panel, projection="3d")
        row = flight.row(time)
        for drone, position, colour in flown:
            north, east, down = position[row]
            axes.plot([east, east], [north, north], [low[2], -down], color="0.6", linewidth=0.7)
            axes.plot([east], [north], [-down], "o", color=colour, markersize=4.5, label=drone.name)
            if drone.target is not None and np.isfinite(drone.target[row]):
                ring = {"markerfacecolor": "none", "markeredgecolor": colour, "markersize": 7.0, "markeredgewidth": 0.7}
                axes.plot([drone.target[row]], [north], [-down], "o", label=f"{drone.name} desired", **ring)
        if len(flown) <= _NAMED:
            places = {_short(drone.name): position[row, [1, 0, 2]] * (1.0, 1.0, -1.0) for drone, position, _ in flown}
            for names, place in _together(places, size * (0.05, 0.05, 0.2)):
                axes.text(place[0], place[1], place[2] + 0.07 * size[2], names, ha="center", va="bottom")
        axes.set(xlim=_around(middle[0], size[0]), ylim=_around(middle[1], size[1]), zlim=(low[2], low[2] + size[2]))
        axes.set_title(title, fontsize=8.0, y=0.98)
        for axis, label, pad in (
            (axes.xaxis, "east (m)", -5),
            (axes.yaxis, "north (m)", -5),
            (axes.zaxis, "height (m)", -7),
        ):
            axis.set_label_text(label)
            axis.labelpad = pad
            axis.set_major_locator(MaxNLocator(4 if axis is axes.xaxis else 3))
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
    figure = Figure((_WIDTH, 3.4), layout="constrained")
    axes = figure.subplots()
    start: list[float] = []
    for drone, colour in zip(flight.drones, _colours(flight), strict=True):
        if drone.name in point and drone.position is not None:
            error = np.abs(drone.position[begin:, 1] - point[drone.name])
            # Symmetrically placed drones have equal errors: a thin line is visible on a thick one.
            dashes, width = _DASHES[len(start) % 5], 1.1 if start else 1.8
            axes.semilogy(flight.time[begin:], error, linestyle=dashes, linewidth=width, color=colour, label=drone.name)
            start.append(float(error[0]))
    if len(start) < len(point):
        return None
    if rate < 1.0:
        norm = float(np.linalg.norm(start))
        steps = np.array(sorted(flight.steps))
        done = np.maximum(steps - steps[0] - 1, 0)
        times = [flight.steps[k] for k in steps]
        label = rf"bound of the law, {norm:.1f} m $\times$ {rate:.4f}$^k$"
        axes.semilogy(times, norm * rate**done, ":", color="0.4", marker=".", markersize=3, label=label)
    axes.set_ylabel("distance to even spacing (m)")
    axes.set_ylim(bottom=max(0.01, axes.get_ylim()[0]))
    axes.yaxis.set_major_formatter("{x:g}")
    _time_axis([axes], flight)
    lines = [line for line in axes.get_lines() if len(point) <= _NAMED or line.get_label() not in point]
    figure.legend(handles=lines, loc="outside upper center", ncols=4)
    return figure


def draw_altitude(flight: Flight) -> Figure | None:
    """Draws heights over time and the smallest distance between any two drones; returns None without positions."""
    from matplotlib.figure import Figure

    flown = [(d, d.position, c) for d, c in zip(flight.drones, _colours(flight), strict=True) if d.position is not None]
    if not flown:
        return None
    figure = Figure((_WIDTH, 4.0 if len(flown) > 1 else 2.4), layout="constrained")
    all_axes = list(figure.subplots(2 if len(flown) > 1 else 1, 1, sharex=True, squeeze=False)[:, 0])
    for i, (drone, position, colour) in enumerate(flown):
        height = -position[:, 2]
        all_axes[0].plot(flight.time, height, linestyle=_DASHES[i % 5], color=colour, label=drone.name)
    all_axes[0].set_ylabel("height (m)")
    if len(flown) > 1:
        all_axes[1].plot(flight.time, _separation([position for _, position, _ in flown]), color="black")
        all_axes[1].set_ylabel("smallest distance (m)")
        all_axes[1].set_ylim(bottom=0.0)
    _time_axis(all_axes, flight, whole=True)
    if len(flown) <= _NAMED:
        figure.legend(loc="outside upper center", ncols=6)
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


def _moments(flight: Flight) -> list[tuple[str, float]]:
    """Returns the title and the time of the three snapshots."""
    if not flight.steps:
        first, last = float(flight.time[0]), float(flight.time[-1])
        return [(f"t = {t:.1f} s", t) for t in (first, 0.5 * (first + last), last)]
    numbers = sorted(flight.steps)
    chosen = (
        SNAPSHOTS if set(SNAPSHOTS) <= set(numbers) else (numbers[0], numbers[(len(numbers) - 1) // 2], numbers[-1])
    )
    ends = {k: _end_of_step(flight, k) for k in chosen}
    return [(f"step #{k}, t = {ends[k]:.1f} s", ends[k]) for k in chosen]


def _end_of_step(flight: Flight, k: int) -> float:
    """Returns the last instant of a step, when drones have reached its targets and the next step has not begun."""
    if k + 1 not in flight.steps:
        return float(flight.time[-1])
    return float(flight.time[max(0, int(np.searchsorted(flight.time, flight.steps[k + 1])) - 1)])


def _time_axis(all_axes: Sequence[Axes], flight: Flight, *, whole: bool = False) -> None:
    """Draws time in s below, and steps above; begins shortly before the first step unless the whole run is shown."""
    first, last = float(flight.time[0]), float(flight.time[-1])
    if flight.steps and not whole:
        begin = min(flight.steps.values())
        first = max(first, begin - 0.02 * (last - begin))
    all_axes[-1].set_xlabel("time (s)")
    if last > first:
        all_axes[-1].set_xlim(first, last)
    if flight.steps:
        numbers = sorted(flight.steps)
        every = 1
        while len(numbers) > 20 * every:
            every *= 2
        shown = [k for k in numbers if (k - 1) % every == 0]
        top = all_axes[0].secondary_xaxis("top")
        top.set_xticks([flight.steps[k] for k in shown], [str(k) for k in shown])
        top.set_xlabel("step")


def _label_ends(axes: Axes, ends: Sequence[tuple[float, str, Any]], inches: float) -> None:
    """Writes names to the right of the lines' ends, without overlaps; of very many names, only some are written.

    `inches` is the approximate height of the axes.
    """
    if not ends:
        return
    ends = sorted(ends, key=lambda end: end[0])
    ends = ends[:: -(-len(ends) // _NAMED)]
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


def _colours(flight: Flight) -> list[Any]:
    """Returns one colour per drone; for many drones, a colour scale that is perceptually uniform, also in grey."""
    from matplotlib import colormaps

    n = len(flight.drones)
    return list(_COLOURS[:n]) if n <= len(_COLOURS) else list(colormaps["cividis"](np.linspace(0.0, 0.9, n)))


def _short(name: str) -> str:
    number = re.search(r"\d+$", name)
    return number[0] if number else name


def _together(places: Mapping[str, Array], near: Array) -> list[tuple[str, Array]]:
    """Returns names with places (3,); those within `near` (3,) of the previous one are joined above the highest one."""
    groups: list[tuple[list[str], list[Array]]] = []
    for name, place in places.items():
        for names, members in groups:
            if (np.abs(place - members[-1]) < near).all():
                names.append(name)
                members.append(place)
                break
        else:
            groups.append(([name], [place]))
    return [(", ".join(names), max(members, key=lambda place: float(place[2]))) for names, members in groups]


def _around(middle: float, size: float) -> tuple[float, float]:
    return middle - 0.5 * size, middle + 0.5 * size

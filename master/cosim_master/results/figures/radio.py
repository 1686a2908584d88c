"""Figures of the radio: packets and losses of each link as a matrix, and a histogram of delays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master.results.figures.style import COLOURS, NAMED, WIDTH, short
from cosim_master.results.reading.links import Array, Links

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_latency", "draw_links"]

_CELLS = 250
"""Rows of a matrix of very many nodes: several nodes share one."""
_WRITTEN = 12
"""Largest number of nodes whose cells contain numbers."""


def draw_links(links: Links) -> Figure | None:
    """Draws packets sent on each link, and the share of them that was lost; returns None without packets by radio."""
    from matplotlib.figure import Figure

    if not len(links.sent):
        return None
    n = len(links.nodes)
    group = -(-n // _CELLS)
    sent = _matrix(links, links.sent, group)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = 100.0 * _matrix(links, links.lost, group) / sent
    figure = Figure((WIDTH, 3.4), layout="constrained")
    panels = zip(figure.subplots(1, 2, sharey=True), (np.where(sent > 0, sent, np.nan), share), strict=True)
    for axes, values in panels:
        first = values is not share
        image = axes.imshow(
            values,
            cmap="cividis" if first else "magma_r",
            vmin=0.0,
            vmax=None if first else max(1.0, float(np.nanmax(share))),
            interpolation="nearest",
            extent=(0.5, n + 0.5, n + 0.5, 0.5),
        )
        axes.set(xlabel="receiver", title="packets" if first else "lost (%)")
        axes.title.set_fontsize(8.0)
        axes.grid(False)
        _ticks(axes, links.nodes)
        bar = figure.colorbar(image, ax=axes, pad=0.02, fraction=0.05)
        bar.outline.set_linewidth(0.5)
        if n <= _WRITTEN:
            _numbers(axes, values, image)
    figure.axes[0].set_ylabel("sender")
    if group > 1:
        figure.supxlabel(f"one cell: {group} x {group} nodes", fontsize=7.0)
    return figure


def _matrix(links: Links, values: Array, group: int) -> Array:
    size = -(-len(links.nodes) // group)
    flat = np.bincount((links.source // group) * size + links.target // group, weights=values, minlength=size * size)
    return flat.reshape(size, size)


def _ticks(axes: Any, nodes: tuple[str, ...]) -> None:
    """Names the rows and columns of a few nodes, and numbers those of many."""
    if len(nodes) <= NAMED:
        numbers = range(1, len(nodes) + 1)
        axes.set_yticks(numbers, nodes)
        axes.set_xticks(numbers, [short(name) for name in nodes])
    else:
        from matplotlib.ticker import MaxNLocator

        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(6, integer=True))


def _numbers(axes: Any, values: Array, image: Any) -> None:
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            shade = sum(image.cmap(image.norm(value))[:3]) / 3.0
            text, colour = f"{value:.3g}" if value < 1000 else f"{value:.0f}", "black" if shade > 0.5 else "white"
            axes.text(column + 1, row + 1, text, ha="center", va="center", color=colour, fontsize=6.5)


def draw_latency(links: Links) -> Figure | None:
    """Draws how many packets took how long by radio; returns None if none arrived."""
    from matplotlib.figure import Figure

    if not len(links.delays):
        return None
    delays = 1e3 * links.delays
    figure = Figure((WIDTH, 2.6), layout="constrained")
    axes = figure.subplots()
    low, high = float(delays.min()), float(delays.max())
    same = high - low < 1e-6
    if same:
        low, high = low - 0.5, high + 0.5
    axes.hist(delays, bins=np.linspace(low, high, 60).tolist(), color=COLOURS[0], linewidth=0.0)
    marks = [(float(np.mean(delays)), "-", "all packets" if same else "mean")]
    if not same:
        marks += [(float(np.percentile(delays, q)), dashes, f"{q} %") for q, dashes in ((95, "--"), (99, ":"))]
    for value, dashes, label in marks:
        axes.axvline(value, color="black", linestyle=dashes, linewidth=0.9, label=f"{label}: {value:.4g} ms")
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.7)
    axes.set(xlabel="delay (ms)", ylabel=f"packets, of {len(delays)}")
    figure.legend(loc="outside upper right", ncols=3)
    return figure

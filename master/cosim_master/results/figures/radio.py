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
_BAND = 12
"""Largest difference of numbers of nodes in a band: the links of very many nodes that hear only their neighbours."""
_WRITTEN = 12
"""Largest number of nodes whose cells contain numbers."""


def draw_links(links: Links) -> Figure | None:
    """Draws packets sent on each link, and the share of them that was lost; returns None without packets by radio.

    Columns are receivers; if very many nodes hear only nodes with similar numbers, columns are the differences.
    """
    from matplotlib.figure import Figure

    if not len(links.sent):
        return None
    n = len(links.nodes)
    group = -(-n // _CELLS)
    widest = int(np.abs(links.target - links.source).max())
    band = group > 1 and widest <= _BAND
    sent = _matrix(links, links.sent, group, widest if band else None)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = 100.0 * _matrix(links, links.lost, group, widest if band else None) / sent
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
            extent=(*((-widest - 0.5, widest + 0.5) if band else (0.5, n + 0.5)), n + 0.5, 0.5),
            aspect="auto" if band else "equal",
        )
        axes.set(xlabel="receiver - sender" if band else "receiver", title="packets" if first else "lost (%)")
        axes.title.set_fontsize(8.0)
        axes.grid(False)
        axes.set_facecolor("0.92")  # of pairs without a link: a share of 0 is nearly white
        _ticks(axes, links.nodes)
        bar = figure.colorbar(image, ax=axes, pad=0.02, fraction=0.05)
        bar.outline.set_linewidth(0.5)
        if n <= _WRITTEN:
            _numbers(axes, values, image)
    figure.axes[0].set_ylabel("sender")
    if group > 1:
        figure.supxlabel(f"one cell: {group} {'senders' if band else f'x {group} nodes'}", fontsize=7.0)
    return figure


def _matrix(links: Links, values: Array, group: int, widest: int | None) -> Array:
    """Returns sums by groups of senders and of receivers; `widest`: by differences, receiver - sender, instead."""
    rows = -(-len(links.nodes) // group)
    columns = rows if widest is None else 2 * widest + 1
    column = links.target // group if widest is None else links.target - links.source + widest
    flat = np.bincount((links.source // group) * columns + column, weights=values, minlength=rows * columns)
    return flat.reshape(rows, columns)


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
    """Draws how many packets took how long by radio, and how many took longer; returns None if none arrived."""
    from matplotlib.figure import Figure

    if not len(links.delays):
        return None
    delays = 1e3 * np.sort(links.delays)
    figure = Figure((WIDTH, 2.6), layout="constrained")
    axes = figure.subplots()
    low, high = float(delays[0]), float(delays[-1])
    if high - low < 1e-6:
        return _draw_equal(figure, axes, low, len(delays))
    axes.hist(delays, bins=np.linspace(low, high, 60).tolist(), color=COLOURS[0], linewidth=0.0)
    marks = [(float(np.mean(delays)), "-", "mean")]
    marks += [(float(np.percentile(delays, q)), dashes, f"{q} %") for q, dashes in ((95, "--"), (99, ":"))]
    for value, dashes, label in marks:
        axes.axvline(value, color="black", linestyle=dashes, linewidth=0.9, label=f"{label}: {value:.4g} ms")
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.7)
    axes.set(xlabel="delay (ms)", ylabel=f"packets, of {len(delays):,}")
    share = axes.twinx()
    places = np.unique(np.linspace(0, len(delays) - 1, min(len(delays), 500)).round().astype(np.int64))
    share.plot(delays[places], 100.0 * (places + 1) / len(delays), color=COLOURS[1], label="arrived by then")
    share.set(ylim=(0.0, 103.0), ylabel="arrived by then (%)")
    share.grid(False)
    figure.legend(loc="outside upper right", ncols=4)
    return figure


def _draw_equal(figure: Figure, axes: Any, delay: float, packets: int) -> Figure:
    """Draws delays [ms] that are all the same: a bar, on a scale that begins with 0."""
    axes.bar([delay], [packets], width=0.02 * max(delay, 1.0), color=COLOURS[0])
    axes.set(xlim=(0.0, 1.5 * max(delay, 1.0)), ylim=(0.0, 1.12 * packets), xlabel="delay (ms)", ylabel="packets")
    axes.yaxis.set_major_formatter("{x:,.0f}")
    text = f"all {packets:,} packets: {delay:.4g} ms"
    axes.annotate(text, (delay, packets), (-6.0, -2.0), textcoords="offset points", ha="right", va="top")
    return figure

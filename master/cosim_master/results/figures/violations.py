"""Marks of violated monitors in figures over time: a coloured span for each violation, the monitors in the legend."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Marks", "mark_violations", "marks_of"]

_COLOURS = ("#d55e00", "#cc79a7", "#e69f00", "#009e73", "#56b4e9")
_MOST = 500
"""Spans that are drawn of one monitor; more are not visible."""


@dataclass(frozen=True, slots=True)
class Marks:
    """The violations of one monitor: its name, their number, and begin and end of each [s]; end None: until the end."""

    name: str
    count: int
    spans: tuple[tuple[float, float | None], ...]


def marks_of(manifest: Mapping[str, Any]) -> tuple[Marks, ...]:
    """Returns the monitors in a manifest, in the order of their declaration; none if the system declares none."""
    monitors = (manifest.get("verdict") or {}).get("monitors") or ()
    return tuple(
        Marks(one["name"], one["count"], tuple((v["begin"], v["end"]) for v in one["violations"][:_MOST]))
        for one in monitors
    )


def mark_violations(figure: Figure, monitors: tuple[Marks, ...]) -> None:
    """Marks violations in all axes of a figure that share an axis of time, and adds the monitors to its legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    below = [axes for axes in figure.axes if axes.get_xlabel() == "time (s)"]
    over_time = [
        axes
        for axes in figure.axes
        if axes in below or any(axes.get_shared_x_axes().joined(axes, one) for one in below)
    ]
    if not over_time or not monitors:
        return
    handles: list[Any] = []
    violated = 0
    for one in monitors:
        if not one.count:
            handles.append(Line2D([], [], linestyle="", label=f"{one.name} kept"))
            continue
        colour = _COLOURS[violated % len(_COLOURS)]
        violated += 1
        times = "" if one.count == 1 else f" {one.count} times"
        handles.append(Patch(facecolor=colour, alpha=0.35, edgecolor=colour, label=f"{one.name} violated{times}"))
        for axes in over_time:
            last = axes.get_xlim()[1]
            for begin, end in one.spans:
                axes.axvspan(begin, last if end is None else end, color=colour, alpha=0.35, linewidth=0.8, zorder=0.5)
    figure.legend(handles=handles, loc="outside lower left", ncols=4, title="monitors", alignment="left")

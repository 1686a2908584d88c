"""The figures of a report on a campaign: each metric over each factor, and over pairs of factors."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master.campaigns.report.analysis import Finished, levels
from cosim_master.campaigns.study.factors import Factor
from cosim_master.results.figures.style import COLOURS, STYLE, WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["curves", "heat_maps"]

_MOST = 12
"""Figures of one kind; a metric with many factors would fill the page."""


def curves(campaign: Finished, metric: str) -> Iterator[tuple[str, Figure]]:
    """Yields a figure for each factor: the mean of the runs with the band from their 5 % to their 95 % quantile.

    A factor that varies continuously has a point for each run.
    """
    varied = [one for one in campaign.study.factors if len(levels(campaign, one)) > 1]
    for factor in varied[:_MOST]:
        with _figure() as (figure, axes):
            values, found = np.array(campaign.columns[factor.label]), campaign.numbers(metric)
            known = np.isfinite(found)
            if factor.continuous:
                axes.plot(values[known].astype(float), found[known], ".", color=COLOURS[0], markersize=3.0)
            else:
                _band(axes, campaign, factor, metric)
            axes.set_xlabel(factor.label)
            axes.set_ylabel(metric)
            yield f"{metric} over {factor.label}", figure


def _band(axes: Any, campaign: Finished, factor: Factor, metric: str) -> None:
    values, found = np.array(campaign.columns[factor.label]), campaign.numbers(metric)
    given = levels(campaign, factor)
    places = np.array(given, dtype=np.float64) if factor.numeric else np.arange(len(given), dtype=np.float64)
    groups = [found[(values == one) & np.isfinite(found)] for one in given]
    kept = [n for n, group in enumerate(groups) if len(group)]
    mean = [float(groups[n].mean()) for n in kept]
    low, high = ([float(np.quantile(groups[n], share)) for n in kept] for share in (0.05, 0.95))
    axes.fill_between(places[kept], low, high, color=COLOURS[0], alpha=0.2, linewidth=0.0)
    axes.plot(places[kept], mean, "o-", color=COLOURS[0], markersize=3.0)
    if not factor.numeric:
        axes.set_xticks(places, [str(one) for one in given])


def heat_maps(campaign: Finished, metric: str) -> Iterator[tuple[str, Figure]]:
    """Yields a figure for each pair of factors with listed values: the mean of the runs with each pair of values."""
    listed = [one for one in campaign.study.factors if not one.continuous and len(levels(campaign, one)) > 1]
    found = campaign.numbers(metric)
    for x, y in [*combinations(listed, 2)][:_MOST]:
        columns, rows = levels(campaign, x), levels(campaign, y)
        of_x, of_y = np.array(campaign.columns[x.label]), np.array(campaign.columns[y.label])
        means = np.full((len(rows), len(columns)), np.nan)
        for i, row in enumerate(rows):
            for j, column in enumerate(columns):
                here = found[(of_x == column) & (of_y == row) & np.isfinite(found)]
                means[i, j] = here.mean() if len(here) else np.nan
        with _figure() as (figure, axes):
            drawn = axes.imshow(means, origin="lower", aspect="auto", cmap="viridis")
            figure.colorbar(drawn, ax=axes, label=metric)
            axes.set_xticks(
                range(len(columns)), [_short(one) for one in columns], rotation=45 if len(columns) > 6 else 0
            )
            axes.set_yticks(range(len(rows)), [_short(one) for one in rows])
            axes.set_xlabel(x.label)
            axes.set_ylabel(y.label)
            axes.grid(visible=False)
            yield f"{metric} over {x.label} and {y.label}", figure


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


class _figure:
    """A figure with one picture, in the style of all figures."""

    def __enter__(self) -> tuple[Figure, Any]:
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        self._style = rc_context(STYLE)  # type: ignore[arg-type]
        self._style.__enter__()
        figure = Figure(figsize=(0.75 * WIDTH, 0.45 * WIDTH), layout="constrained")
        return figure, figure.add_subplot()

    def __exit__(self, *given: Any) -> None:
        self._style.__exit__(*given)

"""The numbers of a report on a campaign: means by factor, sensitivities, outliers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim_master.campaigns.dataset.folder import read_runs, read_study
from cosim_master.campaigns.study.designs import MORRIS_LEVELS, problem, shares
from cosim_master.campaigns.study.factors import Factor
from cosim_master.campaigns.study.study import Planned, Study

__all__ = ["Array", "Finished", "Sensitivity", "elementary", "indices", "influence", "outliers", "read_campaign"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
_FEW = 5
"""Runs that are shown as outliers of a metric."""
_FAR = 3.5
"""Modified z-score from which a run is an outlier (Iglewicz and Hoaglin, 1993)."""
_ROUNDING = 1e-12
"""Share of their magnitude below which the differences of numbers are those of rounding."""


@dataclass(frozen=True, slots=True)
class Finished:
    """A campaign with its rows so far.

    Attributes:
        folder, study: of the campaign.
        begin: the time at which its runs begin, s.
        columns: each column of the dataset, in the order of the runs; NaN for missing numbers.
        planned: all runs of the study, those without a row, too; empty for a search, whose rows name the points.
    """

    folder: Path
    study: Study
    begin: float
    columns: Mapping[str, Any]
    planned: Sequence[Planned]

    @property
    def count(self) -> int:
        return len(self.columns["run"])

    def numbers(self, name: str) -> Array:
        """Returns a column of numbers, (runs,)."""
        return np.array(self.columns[name], dtype=np.float64)

    def by_point(self, name: str) -> tuple[Array, Array]:
        """Returns the points that have runs with a value of a metric, and the mean of these values over the seeds."""
        values, points = self.numbers(name), np.array(self.columns["point"])
        known = np.isfinite(values)
        found, of = np.unique(points[known], return_inverse=True)
        return found, np.bincount(of, values[known]) / np.bincount(of) if len(found) else np.zeros(0)

    def planned_run(self, row: int) -> Planned:
        """Returns the run of a row, with the values of the factors as texts."""
        number = int(self.columns["run"][row])
        if self.planned:
            return self.planned[number]
        texts = {one.label: _text(self.columns[one.label][row]) for one in self.study.factors}
        return Planned(number, number, texts, int(self.columns["seed"][row]))


def _text(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def read_campaign(folder: Path) -> Finished:
    """Reads a campaign, whether it is complete or not.

    Raises:
        CosimError: the folder holds no campaign, or its dataset is damaged.
    """
    study, _, begin = read_study(folder)
    return Finished(folder, study, begin, read_runs(folder).to_pydict(), study.runs())


# ---- sensitivity ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Sensitivities of one metric.

    Attributes:
        head: names of the numbers.
        rows: numbers of each factor, in the order of the study.
        note: the method, and the part of the runs that it could use.
    """

    head: tuple[str, ...]
    rows: Sequence[Sequence[float]]
    note: str


def influence(campaign: Finished, metric: str) -> Sensitivity:
    """Returns the influence of each factor on a metric, for any design.

    The first number is Spearman's rank correlation with the factor (NaN for texts); the second the share of the
    variance of the points that the means over the values of the factor explain (its main effect, eta squared; NaN if
    the factor varies continuously).
    """
    from scipy.stats import spearmanr

    points, means = campaign.by_point(metric)
    first = {int(point): row for row, point in reversed([*enumerate(campaign.columns["point"])])}
    rows = []
    for one in campaign.study.factors:
        values = [campaign.columns[one.label][first[int(point)]] for point in points]
        varied = len(set(values)) > 1 and _differ(means)
        rank = float(spearmanr(values, means).statistic) if varied and one.numeric else np.nan
        rows.append((rank, _main_effect(values, means) if varied and not one.continuous else np.nan))
    note = f"{len(points)} points with a value; means over seeds."
    return Sensitivity(("rank correlation", "share of the variance"), rows, note)


def _differ(values: Array) -> bool:
    """Returns whether numbers differ by more than rounding."""
    return bool(len(values) and np.ptp(values) > _ROUNDING * np.abs(values).max())


def _main_effect(values: Sequence[Any], means: Array) -> float:
    _, of = np.unique([str(value) for value in values], return_inverse=True)
    groups = np.bincount(of, means) / np.bincount(of)
    return float(np.sum((groups[of] - means.mean()) ** 2) / np.sum((means - means.mean()) ** 2))


def elementary(campaign: Finished, metric: str) -> Sensitivity | None:
    """Returns Morris' elementary effects of a design `morris`; None without a complete trajectory."""
    from SALib.analyze import morris

    study = campaign.study
    whole, kept, of = _blocks(campaign, metric, len(study.factors) + 1)
    if not len(whole):
        return None
    found = morris.analyze(
        problem(study.factors), shares(study.design, study.factors)[kept], whole, num_levels=MORRIS_LEVELS, seed=1
    )
    rows = [*zip(*(map(float, found[name]) for name in ("mu", "mu_star", "sigma")), strict=True)]
    used = f"{len(whole) // of} of {study.design.size} trajectories"
    note = f"Elementary effects over the range of each factor, from {used}."
    return Sensitivity(("mean", "mean of absolute values", "standard deviation"), rows, note)


def indices(campaign: Finished, metric: str) -> Sensitivity | None:
    """Returns Sobol indices of a design `indices`; None without two complete base points, or without variance."""
    from SALib.analyze import sobol

    study = campaign.study
    whole, _, of = _blocks(campaign, metric, len(study.factors) + 2)
    if len(whole) < 2 * of or not _differ(whole):
        return None
    found = sobol.analyze(problem(study.factors), whole, calc_second_order=False, seed=1)
    rows = [*zip(*(map(float, found[name]) for name in ("S1", "S1_conf", "ST", "ST_conf")), strict=True)]
    note = f"Sobol indices with 95 % confidence, from {len(whole) // of} of {study.design.size} base points."
    return Sensitivity(("first order", "+/-", "total", "+/-"), rows, note)


def _blocks(campaign: Finished, metric: str, size: int) -> tuple[Array, Array, int]:
    """Returns the values of all points that belong together and are complete, the numbers of the points, and `size`.

    A missing value would spoil all sensitivities, so its trajectory or base point is left out.
    """
    points, means = campaign.by_point(metric)
    values = np.full(len(campaign.planned) // max(1, len(campaign.study.seeds)), np.nan)
    values[points] = means
    complete = np.isfinite(values.reshape(-1, size)).all(axis=1)
    kept = np.flatnonzero(np.repeat(complete, size))
    return values[kept], kept.astype(np.int64), size


# ---- outliers ------------------------------------------------------------------------------------------------------


def outliers(campaign: Finished, metric: str) -> list[tuple[int, float]]:
    """Returns the rows of a metric that are far from others, with their modified z-scores, the farthest first.

    A run is compared with the other seeds of its point, or with all runs if there are fewer than five seeds.
    """
    values, points = campaign.numbers(metric), np.array(campaign.columns["point"])
    groups = [np.flatnonzero(points == point) for point in np.unique(points)]
    if len(campaign.study.seeds) < _FEW:
        groups = [np.arange(len(values))]
    found = []
    for group in groups:
        rows = group[np.isfinite(values[group])]
        if len(rows) < _FEW:
            continue
        away = values[rows] - np.median(values[rows])
        spread = float(np.median(np.abs(away)))
        if spread > _ROUNDING * np.abs(values[rows]).max():
            scores = 0.6745 * away / spread
            found += [(int(row), float(score)) for row, score in zip(rows, scores, strict=True) if abs(score) > _FAR]
    return sorted(found, key=lambda one: -abs(one[1]))[:_FEW]


def levels(campaign: Finished, factor: Factor) -> list[Any]:
    """Returns the values of a factor among the runs, in order."""
    return sorted({*campaign.columns[factor.label]})

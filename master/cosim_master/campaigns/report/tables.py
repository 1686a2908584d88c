"""The tables of a report on a campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from cosim_master.campaigns.report.analysis import Finished, elementary, indices, influence, outliers
from cosim_master.campaigns.running.options import commands
from cosim_master.campaigns.study.study import Study
from cosim_master.report.contents import Table

__all__ = ["best", "failures", "far", "findings", "metrics", "sensitivity", "summary"]

_MOST = 50
"""Failures that are listed."""


def summary(campaign: Finished) -> Table:
    """Returns what was varied, and how the runs ended."""
    study = campaign.study
    outcomes = Counter(campaign.columns["outcome"])
    rows = [
        ("system", study.system),
        ("runs", f"{campaign.count} of {study.count}"),
        ("outcomes", ", ".join(f"{n} {outcome}" for outcome, n in sorted(outcomes.items())) or "none"),
        ("without failures and warnings", str(sum(bool(one) for one in campaign.columns["good"]))),
        ("design", _design(study)),
        ("seeds", f"{len(study.seeds)}" if study.seeds else "that of the system"),
        ("until", f"{study.until:g} s" if study.until is not None else "the system's stop time"),
    ]
    for one in study.factors:
        values = f"{one.low:g} to {one.high:g}" if one.continuous else ", ".join(one.values[:20])
        rows.append((f"factor {one.label}", values + (" ..." if len(one.values) > 20 else "")))
    rows += [(f"set {name}", text) for name, text in study.overrides.items()]
    return Table("Study", (), rows)


def _design(study: Study) -> str:
    """Returns how the points were chosen: by a design, as `--sample` names it, or by a search."""
    if (search := study.search) is not None:
        return f"search for the {'least' if search.minimise else 'greatest'} {search.metric}, {search.trials} points"
    return f"{study.design.kind}:{study.design.size}" if study.design.size else study.design.kind


def best(campaign: Finished) -> Table:
    """Returns the best points of a search, with the command that repeats their first run; empty if it was none."""
    search = campaign.study.search
    labels = [one.label for one in campaign.study.factors]
    rows = []
    if search is not None:
        points, means = campaign.by_point(search.metric)
        for n in np.argsort(means if search.minimise else -means, kind="stable")[:10]:
            row = campaign.columns["point"].index(int(points[n]))
            values = [str(campaign.columns[label][row]) for label in labels]
            rows.append((str(points[n]), f"{means[n]:.6g}", *values, _repeated(campaign, row)))
    head = ("point", "mean" if search is None else search.metric, *labels, "its first run is repeated by")
    return Table("Best points", head, rows)


_STATISTICS: tuple[Callable[[Any], Any], ...] = (np.mean, np.std, np.min, np.median, np.max)


def metrics(campaign: Finished) -> Table:
    """Returns the distribution of each metric."""
    rows = []
    for one in campaign.study.metrics:
        values = campaign.numbers(one.name)
        known = values[np.isfinite(values)]
        numbers = [float(f(known)) for f in _STATISTICS] if len(known) else []
        cells = [f"{number:.6g}" for number in numbers] or [""] * 5
        rows.append((one.name, str(len(known)), str(len(values) - len(known)), *cells))
    head = ("metric", "runs", "without value", "mean", "standard deviation", "least", "median", "greatest")
    return Table("Metrics", head, rows)


def sensitivity(campaign: Finished) -> Iterator[Table]:
    """Yields a table for each metric: how it depends on each factor."""
    labels = [one.label for one in campaign.study.factors]
    by_design = {"morris": elementary, "indices": indices}.get(campaign.study.design.kind)
    for metric in campaign.study.metrics:
        found = [influence(campaign, metric.name)] if len(labels) else []
        if by_design is not None and (more := by_design(campaign, metric.name)) is not None:
            found.insert(0, more)
        for one in found:
            rows = [
                (label, *("" if not np.isfinite(value) else f"{value:.4g}" for value in row))
                for label, row in zip(labels, one.rows, strict=True)
            ]
            yield Table(f"Sensitivity of {metric.name}", ("factor", *one.head), rows, one.note)


def far(campaign: Finished) -> Iterator[Table]:
    """Yields a table for each metric: the runs that are far from the others, with the commands that repeat them."""
    for metric in campaign.study.metrics:
        values = campaign.numbers(metric.name)
        rows = [
            (str(campaign.columns["run"][row]), f"{values[row]:.6g}", f"{score:.1f}", _repeated(campaign, row))
            for row, score in outliers(campaign, metric.name)
        ]
        if rows:
            note = "Modified z-scores beyond 3.5, among the seeds of a point, or among all runs if there are few seeds."
            yield Table(f"Outliers of {metric.name}", ("run", metric.name, "score", "repeated by"), rows, note)


def failures(campaign: Finished) -> Table:
    """Returns the runs that have no result, with their reasons."""
    outcomes = campaign.columns["outcome"]
    bad = [row for row, outcome in enumerate(outcomes) if outcome in ("failed", "refused", "crashed")]
    rows = [
        (str(campaign.columns["run"][row]), outcomes[row], campaign.columns["reason"][row], _repeated(campaign, row))
        for row in bad[:_MOST]
    ]
    note = f"{_MOST} of {len(bad)} runs." if len(bad) > _MOST else ""
    return Table("Failed runs", ("run", "outcome", "reason", "repeated by"), rows, note)


def findings(campaign: Finished) -> Table:
    """Returns the kinds of findings of the verdicts, with the number of runs that have them and one of these."""
    counts: Counter[str] = Counter()
    first: dict[str, int] = {}
    for row, text in enumerate(campaign.columns["findings"]):
        for kind in {part.partition(":")[0] for part in (text or "").split("; ") if part}:
            counts[kind] += 1
            first.setdefault(kind, row)
    rows = [(kind, str(n), _repeated(campaign, first[kind])) for kind, n in counts.most_common(20)]
    return Table("Findings of the verdict", ("finding", "runs", "the first is repeated by"), rows)


def _repeated(campaign: Finished, row: int) -> str:
    return "\n".join(commands(campaign.study, campaign.planned_run(row), campaign.begin))

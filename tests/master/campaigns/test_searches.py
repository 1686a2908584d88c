"""Searches: Optuna's points depend on the study alone, and go on after an interruption."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cosim_master.campaigns.dataset.folder import Folder
from cosim_master.campaigns.metrics.metric import Metric
from cosim_master.campaigns.report.page import write_campaign_report
from cosim_master.campaigns.search import batches
from cosim_master.campaigns.study.designs import Design
from cosim_master.campaigns.study.factors import Factor
from cosim_master.campaigns.study.study import Planned, Search, Study
from cosim_master.diagnostics.errors import SystemDescriptionError

STUDY = Study(
    system="line5",
    factors=(Factor("f.a", low=-4.0, high=6.0), Factor.parsed("f.b=x,y,z")),
    seeds=(1, 2),
    metrics=(Metric.parsed("y=packets_lost"),),
    search=Search("y", trials=60),
)
SEARCH = STUDY.search or Search("y")


def valley(run: Planned) -> float | None:
    """The least mean over the seeds is 0.5 at f.a = 1, f.b = y; some runs have no value."""
    a = float(run.values["f.a"])
    if a > 5.0:
        return None
    return (a - 1.0) ** 2 + (3.0 if run.values["f.b"] != "y" else 0.0) + float(run.seed == 2)


def test_a_search_finds_the_least_value_and_is_always_the_same() -> None:
    runs = [run for batch in batches(STUDY, SEARCH, valley) for run in batch]
    assert [run.run for run in runs] == [*range(120)] and STUDY.count == 120
    assert [(run.point, run.seed) for run in runs[:4]] == [(0, 1), (0, 2), (1, 1), (1, 2)]
    known = [run for run in runs if valley(run) is not None]
    best = min(known, key=lambda run: valley(run) or 0.0)
    assert best.values["f.b"] == "y"
    assert float(best.values["f.a"]) == pytest.approx(1.0, abs=0.3)
    late = [float(run.values["f.a"]) for run in runs[80:]]
    assert sum(abs(a - 1.0) < 2.0 for a in late) > len(late) / 2  # it looks where it is worth while
    assert runs == [run for batch in batches(STUDY, SEARCH, valley) for run in batch]
    other = replace(STUDY, design=Design(seed=2))
    assert runs != [run for batch in batches(other, SEARCH, valley) for run in batch]


def test_a_search_looks_for_the_greatest_value() -> None:
    search = replace(SEARCH, minimise=False)
    runs = [run for batch in batches(STUDY, search, valley) for run in batch]
    best = max((run for run in runs if valley(run) is not None), key=lambda run: valley(run) or 0.0)
    assert best.values["f.b"] != "y"
    assert valley(best) == pytest.approx(25.0 + 3.0 + 1.0, rel=0.2)


def test_the_report_of_a_search_names_its_best_points(tmp_path: Path) -> None:
    with Folder(tmp_path, STUDY, {}) as folder:
        for batch in batches(STUDY, SEARCH, lambda run: folder.sought(run.run)):
            for run in batch:
                values = {"f.a": float(run.values["f.a"]), "f.b": run.values["f.b"]}
                row = {"run": run.run, "point": run.point, "seed": run.seed, **values, "outcome": "done", "reason": ""}
                folder.add({**row, "good": True, "y": valley(run)})
    with Folder(tmp_path, STUDY, {}) as folder:  # as after an interruption: all batches are asked for and told again
        again = [run for batch in batches(STUDY, SEARCH, lambda run: folder.sought(run.run)) for run in batch]
        assert folder.done == {run.run for run in again}
    assert again == [run for batch in batches(STUDY, SEARCH, valley) for run in batch]
    text = write_campaign_report(tmp_path).read_text(encoding="utf-8")
    assert "120 of 120 runs" in text and "<h2>Best points</h2>" in text
    assert "search for the least y, 60 points" in text and ">grid<" not in text
    best = min((run for run in again if valley(run) is not None), key=lambda run: valley(run) or 0.0)
    assert f"--set f.a={best.values['f.a']} --set f.b=y --seed 1" in text


def test_a_wrong_search_is_refused() -> None:
    assert Search.parsed("max settling_time", 30) == Search("settling_time", minimise=False, trials=30)
    for text in ("settling_time", "least y", "min", "min "):
        with pytest.raises(SystemDescriptionError, match="write min METRIC or max METRIC"):
            Search.parsed(text, 10)
    with pytest.raises(SystemDescriptionError, match="there is no metric of this name; valid: y"):
        replace(STUDY, search=Search("z"))
    with pytest.raises(SystemDescriptionError, match="chooses the points itself"):
        replace(STUDY, design=Design("lhs", 5))
    with pytest.raises(SystemDescriptionError, match="it needs factors"):
        replace(STUDY, factors=())
    assert Study.of_json(STUDY.as_json()).as_json() == STUDY.as_json()

"""Reports on campaigns: sensitivities of functions that are known, outliers, and the commands that repeat runs."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim_master.campaigns.dataset.folder import Folder
from cosim_master.campaigns.metrics.metric import Metric
from cosim_master.campaigns.report.analysis import elementary, indices, influence, outliers, read_campaign
from cosim_master.campaigns.report.drawing import curves, heat_maps
from cosim_master.campaigns.report.page import write_campaign_report
from cosim_master.campaigns.report.tables import failures
from cosim_master.campaigns.study.designs import Design
from cosim_master.campaigns.study.factors import Factor
from cosim_master.campaigns.study.study import Study
from cosim_master.cli import app
from cosim_master.diagnostics.errors import CosimError

Y = (Metric.parsed("y=packets_lost"),)


def made(
    folder: Path, study: Study, value: Callable[[Mapping[str, float], int], float | None], begin: float = 0.0
) -> Path:
    """A campaign whose metric is a function of the factors and the seed; None: that run failed."""
    with Folder(folder, study, {}, begin=begin) as written:
        for run in study.runs():
            numbers = {label: float(text) for label, text in run.values.items()}
            y = value(numbers, run.seed or 0)
            outcome, reason = ("done", "") if y is not None else ("failed", "<b>no</b> & nothing")
            row = {"run": run.run, "point": run.point, "seed": run.seed or 1, **numbers, "outcome": outcome}
            findings = "contact: drone1.vehicle" if run.run == 2 else ""
            written.add({**row, "reason": reason, "good": y is not None, "y": y, "findings": findings})
    return folder


@pytest.mark.parametrize(("begin", "every"), [(0.0, "10"), (1.0, "9")])
def test_commands_count_checkpoints_from_the_beginning_of_a_run(tmp_path: Path, begin: float, every: str) -> None:
    study = Study(system="line5", factors=(Factor.parsed("network.loss@10=0.5"),), metrics=Y)
    table = failures(read_campaign(made(tmp_path / "study", study, lambda *_: None, begin)))
    assert [row[3] for row in table.rows] == [
        f"uav-cosim run line5 --checkpoint-every {every} -o run-0-begin\n"
        "uav-cosim run line5 --from run-0-begin@10 --set network.loss=0.5 -o run-0"
    ]


def ishigami(x: Mapping[str, float], _: int) -> float:
    a, b, c = x.values()
    return float(np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a))


def test_sobol_indices_are_those_of_ishigamis_function(tmp_path: Path) -> None:
    """First order 0.3139, 0.4424, 0; total 0.5576, 0.4424, 0.2437 (Ishigami and Homma, 1990)."""
    factors = tuple(Factor(name, low=-np.pi, high=np.pi) for name in ("f.a", "f.b", "f.c"))
    study = Study(system="line5", factors=factors, design=Design("indices", 1024), metrics=Y)
    found = indices(read_campaign(made(tmp_path / "whole", study, ishigami)), "y")
    assert found is not None
    first, _, total, _ = zip(*found.rows, strict=True)
    assert first == pytest.approx((0.3139, 0.4424, 0.0), abs=0.05)
    assert total == pytest.approx((0.5576, 0.4424, 0.2437), abs=0.05)

    def with_failures(x: Mapping[str, float], seed: int) -> float | None:
        return None if x["f.a"] > 3.13 else ishigami(x, seed)

    partly = indices(read_campaign(made(tmp_path / "partly", study, with_failures)), "y")
    assert partly is not None
    assert "from 1024 of 1024" in found.note and "of 1024 base points" in partly.note
    assert partly.note != found.note
    assert [row[2] for row in partly.rows] == pytest.approx((0.5576, 0.4424, 0.2437), abs=0.08)


def test_elementary_effects_of_a_linear_function_are_its_slopes(tmp_path: Path) -> None:
    study = Study(system="line5", factors=(Factor("f.a", low=0, high=2), Factor("f.b", low=5, high=6)),
                  design=Design("morris", 20), metrics=Y)  # fmt: skip

    def value(x: Mapping[str, float], _: int) -> float:
        return 3.0 * x["f.a"] - x["f.b"]

    found = elementary(read_campaign(made(tmp_path, study, value)), "y")
    assert found is not None
    np.testing.assert_allclose(found.rows, [(6.0, 6.0, 0.0), (-1.0, 1.0, 0.0)], atol=1e-9)


def test_main_effects_of_a_sum_are_the_shares_of_its_variance(tmp_path: Path) -> None:
    study = Study(system="line5", factors=(Factor.parsed("f.a=0,1,2"), Factor.parsed("f.b=0,3")), seeds=(1, 2),
                  metrics=Y)  # fmt: skip
    campaign = read_campaign(made(tmp_path, study, lambda x, seed: x["f.a"] - x["f.b"] + 0.1 * (seed - 1.5)))
    (rank_a, share_a), (rank_b, share_b) = influence(campaign, "y").rows
    assert (share_a, share_b) == pytest.approx(((2 / 3) / (2 / 3 + 9 / 4), (9 / 4) / (2 / 3 + 9 / 4)))
    assert rank_a > 0.0 > rank_b


def test_a_run_far_from_the_other_seeds_of_its_point_is_an_outlier(tmp_path: Path) -> None:
    study = Study(system="line5", factors=(Factor.parsed("f.a=1,100"),), seeds=tuple(range(1, 12)), metrics=Y)
    campaign = read_campaign(
        made(tmp_path, study, lambda x, seed: x["f.a"] + 0.1 * seed + 50.0 * (seed == 7 and x["f.a"] == 1))
    )
    ((row, score),) = outliers(campaign, "y")
    assert (campaign.columns["seed"][row], campaign.columns["f.a"][row]) == (7, 1.0)
    assert score == pytest.approx(0.6745 * (51.7 - 1.6) / 0.3)


def test_differences_of_rounding_are_neither_effects_nor_outliers(tmp_path: Path) -> None:
    factors = (Factor("f.a", low=0, high=1), Factor("f.b", low=0, high=1))
    study = Study(system="line5", factors=factors, design=Design("indices", 8), metrics=Y)
    campaign = read_campaign(made(tmp_path, study, lambda x, _: 30.0 + 1e-14 * x["f.a"] + 1e-13 * (x["f.b"] > 0.9)))
    assert len({*campaign.columns["y"]}) > 1
    assert indices(campaign, "y") is None
    assert np.isnan(influence(campaign, "y").rows).all()
    assert outliers(campaign, "y") == []


def test_figures_show_means(tmp_path: Path) -> None:
    study = Study(system="line5", factors=(Factor.parsed("f.a=0,1,2"), Factor.parsed("f.b=0,3")), seeds=(1, 2),
                  metrics=Y)  # fmt: skip
    campaign = read_campaign(made(tmp_path, study, lambda x, seed: x["f.a"] + 10 * x["f.b"] + seed))
    (name, figure), _ = curves(campaign, "y")
    assert name == "y over f.a"
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), [16.5, 17.5, 18.5])
    ((name, figure),) = heat_maps(campaign, "y")
    assert name == "y over f.a and f.b"
    np.testing.assert_allclose(figure.axes[0].images[0].get_array(), [[1.5, 2.5, 3.5], [31.5, 32.5, 33.5]])


def test_the_page_is_one_file_with_the_commands_that_repeat_runs(tmp_path: Path) -> None:
    study = Study(system="line5", factors=(Factor.parsed("f.a=0,1"),), seeds=(1, 2, 3), metrics=Y, until=60.0)
    folder = made(tmp_path / "out", study, lambda x, seed: None if (x["f.a"], seed) == (1, 2) else x["f.a"] + seed)
    shown = CliRunner().invoke(app, ["report", str(folder)])
    assert (shown.exit_code, shown.stdout.strip()) == (0, str(folder / "report.html"))
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "6 of 6 runs, 1 failed" in text
    assert html.escape("<b>no</b> & nothing") in text and "<b>no</b>" not in text
    assert "uav-cosim run line5 --set f.a=1 --seed 2 --until 60 -o run-4" in text
    assert "uav-cosim run line5 --set f.a=0 --seed 3 --until 60 -o run-2" in text  # the first with a contact
    assert "default-src &#x27;none&#x27;" in text or "default-src 'none'" in text
    assert "<script" not in text
    assert text.count("<figure>") == 1


def test_a_campaign_without_runs_has_a_report_and_a_damaged_one_has_none(tmp_path: Path) -> None:
    with Folder(tmp_path / "out", Study(system="line5", factors=(Factor.parsed("f.a=0,1"),), metrics=Y), {}):
        pass
    assert "No run has ended yet" in write_campaign_report(tmp_path / "out").read_text(encoding="utf-8")
    (tmp_path / "out" / "study.json").write_text("{}", encoding="utf-8")
    with pytest.raises(CosimError, match="not the study of a campaign"):
        write_campaign_report(tmp_path / "out")
    shown = CliRunner().invoke(app, ["report", str(tmp_path / "out"), str(tmp_path)])
    assert (shown.exit_code, "campaigns are not compared" in shown.stderr) == (2, True)

"""A run that is judged while it goes on: the same findings in time, and the same verdict at the end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.verdict import judging
from cosim_master.verdict.findings import Judgement

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"


def test_the_verdict_is_the_same_and_findings_come_early(
    fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With every report of progress a judgement: looks are evaluated in other groups than without."""
    monkeypatch.setattr(judging, "_INTERVAL", 0.0)
    told: list[Judgement] = []
    overrides = {"drone2.vehicle.position_start[2]": "0.3", "drone4.vehicle.mass": "30", "drone*.vehicle.wind[1]": "6"}
    options = {"until": 40.0, "overrides": overrides}
    simulate(LINE5, RunOptions(out=tmp_path / "judged", pace=40.0, **options), listener=Listener(judged=told.append))
    simulate(LINE5, RunOptions(out=tmp_path / "plain", **options))
    one, other = (json.loads((tmp_path / name / "manifest.json").read_text()) for name in ("judged", "plain"))
    assert one["verdict"] == other["verdict"]
    kinds = {finding["kind"] for finding in other["verdict"]["findings"]}
    assert {"contact", "never flew"} <= kinds
    assert len(told) > 1 and told[0].end < 20.0
    assert all(finding.time is not None for judgement in told for finding in judgement.findings)
    first = next(one for one in told if any(finding.kind == "never flew" for finding in one.findings))
    assert first.end < 39.0 and all(finding.kind != "never flew" for finding in told[0].findings)
    for name in ("signals.parquet", "packets.parquet"):
        assert (tmp_path / "judged" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()

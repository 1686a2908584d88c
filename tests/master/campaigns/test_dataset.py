"""The dataset of a campaign, whenever its process is killed."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.campaigns.dataset.folder import Folder, read_runs
from cosim_master.campaigns.dataset.table import digest_of
from cosim_master.campaigns.metrics.metric import Metric
from cosim_master.campaigns.study.factors import Factor
from cosim_master.campaigns.study.study import Study
from cosim_master.diagnostics.errors import CosimError, SystemDescriptionError

STUDY = Study(
    system="line5",
    factors=(Factor.parsed("a.b=0.1:0.3:3"), Factor.parsed("network.topology=line,nearest")),
    metrics=(Metric.parsed("packets_lost"),),
)
INPUTS = {"system": "1", "FMUs": "2"}


def row(run: int, **given: Any) -> dict[str, Any]:
    values = {"a.b": 0.1 * run, "network.topology": "line", "packets_lost": 1.0 / (run + 1)}
    return {"run": run, "point": run, "seed": 1, **values, "outcome": "done", "reason": "", "good": True, **given}


def test_rows_are_read_while_they_are_written_and_in_the_order_of_runs(tmp_path: Path) -> None:
    with Folder(tmp_path / "out", STUDY, INPUTS) as folder:
        for run in (3, 0):
            folder.add(row(run))
        assert read_runs(tmp_path / "out").column("run").to_pylist() == [0, 3]  # from the journal
        folder.write_part()
        folder.add(row(1), b"signals of run 1")
        assert read_runs(tmp_path / "out").column("run").to_pylist() == [0, 1, 3]
    assert [file.name for file in sorted((tmp_path / "out" / "runs").iterdir())] == [
        "part-000001.parquet", "part-000002.parquet",
    ]  # fmt: skip
    whole = pq.read_table(tmp_path / "out" / "runs")  # as any other program reads it
    assert sorted(whole.column("run").to_pylist()) == [0, 1, 3]
    assert whole.schema.field("a.b").type == "double"
    assert whole.schema.field("network.topology").type == "string"
    assert json.loads(whole.schema.metadata[b"uav-cosim.study"]) == STUDY.as_json()
    assert (tmp_path / "out" / "signals" / "run=1" / "signals.parquet").read_bytes() == b"signals of run 1"


def test_a_row_that_was_cut_short_was_not_written(tmp_path: Path) -> None:
    with Folder(tmp_path, STUDY, INPUTS) as folder:
        folder.add(row(0))
        folder.write_part()
    (tmp_path / "journal.jsonl").write_text(f"{json.dumps(row(1))}\n{json.dumps(row(2))[:-9]}", encoding="utf-8")
    with Folder(tmp_path, STUDY, INPUTS) as folder:
        assert folder.done == {0, 1}
        folder.add(row(2))
    assert read_runs(tmp_path).to_pylist()[1:] == [{**row(n), "failures": None, "warnings": None, "findings": None,
                                                    "simulated_s": None} for n in (1, 2)]  # fmt: skip


def test_a_kill_between_part_and_journal_doubles_no_row(tmp_path: Path) -> None:
    with Folder(tmp_path, STUDY, INPUTS) as folder:
        for run in range(3):
            folder.add(row(run))
        lines = (tmp_path / "journal.jsonl").read_bytes()
    digest = digest_of(read_runs(tmp_path))
    (tmp_path / "journal.jsonl").write_bytes(lines)
    assert digest_of(read_runs(tmp_path)) == digest
    with Folder(tmp_path, STUDY, INPUTS) as folder:
        assert folder.done == {0, 1, 2}
        folder.add(row(1, packets_lost=9.0))  # a run that ended twice: the first row stays
        assert folder.table().num_rows == 3
    assert digest_of(read_runs(tmp_path)) == digest


def test_digests_compare_values_whatever_their_order_and_parts(tmp_path: Path) -> None:
    for name, order in (("one", (0, 1, 2, 3)), ("other", (2, 3, 1, 0)), ("third", (0, 1, 2, 3))):
        with Folder(tmp_path / name, STUDY, INPUTS) as folder:
            for run in order:
                folder.add(row(run, **({"packets_lost": 0.25 + 1e-16} if (name, run) == ("third", 2) else {})))
                if name == "other":
                    folder.write_part()
    digests = {name: digest_of(read_runs(tmp_path / name)) for name in ("one", "other", "third")}
    assert digests["one"] == digests["other"] != digests["third"]


def test_a_campaign_of_another_study_is_not_overwritten(tmp_path: Path) -> None:
    with Folder(tmp_path, STUDY, INPUTS) as folder:
        folder.add(row(0))
        with pytest.raises(SystemDescriptionError, match="holds a campaign that goes on"):
            Folder(tmp_path, STUDY, INPUTS)
    with pytest.raises(SystemDescriptionError, match=r"another study \(FMUs\); give another folder, or --force"):
        Folder(tmp_path, STUDY, {**INPUTS, "FMUs": "3"})
    other = Study(system="line5", factors=STUDY.factors[:1], metrics=STUDY.metrics)
    with pytest.raises(SystemDescriptionError, match=r"another study \(factors\)"):
        Folder(tmp_path, other, INPUTS)
    assert read_runs(tmp_path).num_rows == 1
    with Folder(tmp_path, other, INPUTS, force=True) as folder:
        assert folder.done == set()
    assert read_runs(tmp_path).num_rows == 0


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    for name in ("manifest.json", "runs"):
        folder = tmp_path / name.partition(".")[0]
        folder.mkdir()
        (folder / name).mkdir()
        (folder / name / "mine.txt").write_text("mine")
        for force in (False, True):
            with pytest.raises(SystemDescriptionError, match="holds something else than a campaign"):
                Folder(folder, STUDY, INPUTS, force=force)
        assert (folder / name / "mine.txt").read_text() == "mine"
    with pytest.raises(CosimError, match=r"not the folder of a campaign: it has no study\.json"):
        read_runs(tmp_path)


def test_a_damaged_part_is_named(tmp_path: Path) -> None:
    with Folder(tmp_path, STUDY, INPUTS) as folder:
        folder.add(row(0))
    part = tmp_path / "runs" / "part-000001.parquet"
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(CosimError, match=r"part-000001.parquet: this part of the dataset is damaged .*remove it"):
        read_runs(tmp_path)


@pytest.mark.parametrize("name", ["write_text", "write_bytes"])
def test_a_full_disk_at_the_start_of_a_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    def full(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, name, full)
    with pytest.raises(CosimError, match="the campaign cannot be written: No space left on device"):
        Folder(tmp_path, STUDY, INPUTS)


def test_a_full_disk_at_the_end_of_a_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows stay in the journal."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pq, "write_table", full)
    with (
        pytest.raises(CosimError, match="the campaign cannot be written: No space left on device"),
        Folder(tmp_path, STUDY, INPUTS) as folder,
    ):
        folder.add(row(0))
    assert read_runs(tmp_path).num_rows == 1

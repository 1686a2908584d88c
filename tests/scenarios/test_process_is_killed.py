"""Whatever ends the process, what was recorded until then can be read, and `repair` completes it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.reading.read import packets, signals
from cosim_master.results.repair import repair
from cosim_master.results.storage.journal import goes_on
from cosim_master.stepping.observation import Seen, View
from tests.scenarios.flights import SYSTEMS, copy_of
from tests.scenarios.test_radio_is_bad import with_radio

RECORDED = ("signals.parquet", "packets.parquet", "packets.tlog", *(f"packets/drone{n}.tlog" for n in range(1, 6)))


@pytest.fixture(scope="module")
def line5(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Packets are lost, and in flight at every moment."""
    workshop = tmp_path_factory.mktemp("killed")
    return copy_of("line5", workshop, fmus, lambda text: with_radio(text, 'loss="0.3" latency="0.05" jitter="0.2"'))


class PowerCut:
    """An observer that ends the run in the middle of everything."""

    def __init__(self, view: View) -> None:
        self.every = view.steps(3.0)

    def initialised(self, seen: Seen) -> None: ...

    def stepped(self, seen: Seen) -> None:
        raise RuntimeError(f"power cut at {seen.time:g} s")

    def closed(self) -> None: ...


def test_what_is_repaired_is_what_the_run_would_have_left(
    line5: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Byte for byte, with row groups that end where those of the run would, beside a run that ended there."""
    monkeypatch.setattr("cosim_master.stepping.plan._BLOCK_BYTES", 200_000)
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_BYTES", 150_000)
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_ROWS", 1)
    monkeypatch.setattr("cosim_master.results.recording.packet_log._GROUP", 100)
    cut, ended = tmp_path / "cut", tmp_path / "ended"
    with pytest.raises(RuntimeError, match="power cut at 3 s"):
        simulate(line5, RunOptions(out=cut, until=9.0), observers=[PowerCut])
    assert simulate(line5, RunOptions(out=ended, until=3.0)).outcome == "done"
    assert not goes_on(cut)
    assert not (cut / "signals.parquet").exists()
    assert signals(cut).equals(pq.read_table(ended / "signals.parquet"))
    assert packets(cut).equals(pq.read_table(ended / "packets.parquet"))
    assert repair(cut)["outcome"] == "killed"
    for name in RECORDED:
        assert (cut / name).read_bytes() == (ended / name).read_bytes(), name
    assert pq.ParquetFile(cut / "signals.parquet").num_row_groups > 2
    assert pq.ParquetFile(cut / "packets.parquet").num_row_groups > 2
    assert not (cut / "unfinished").exists()
    manifest = json.loads((cut / "manifest.json").read_text())
    assert manifest["fingerprint"] != json.loads((ended / "manifest.json").read_text())["fingerprint"]  # of 9 s


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_six_random_instants(fmus: Path, tmp_path: Path) -> None:
    """In a process of its own, since it forks. How much is lost at most is measured there, and no test's business."""
    assert fmus.is_dir()
    file = tmp_path / "killed.json"
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.kill", "--times", "6", "--seed", "5", "--json", str(file)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert file.is_file(), done.stderr
    found = json.loads(file.read_text())
    assert found["killed"] == 6
    assert found["wrong"] == []
    assert SYSTEMS.is_dir()

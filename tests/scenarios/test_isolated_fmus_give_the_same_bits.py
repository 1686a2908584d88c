"""Every FMU of the project, alone and in the shipped systems: the same bytes in the process of the run and isolated.

`benchmarks/same_bits.py` compares longer runs of all systems, and files that are not part of this project.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.slaves.isolated import Isolation, Scope
from cosim_master.system import shipped

SYSTEMS: dict[str, dict[str, Any]] = {
    "line5": {"until": 4.0, "overrides": {"network.loss": "0.3", "network.jitter": "0.02"}},
    "line5-estimated": {"until": 2.0},
    "windy": {"until": 2.0},
    "guarded": {"until": 4.0},
}
"""Two builds of FMI, packets, an environment, batteries, an estimator and agents of the kit."""


def recorded(path: Path, out: Path, scope: Scope, **options: Any) -> dict[str, bytes]:
    """The files of a run, except its manifest, by name."""
    result = simulate(path, RunOptions(out=out, isolation=Isolation(scope), **options))
    assert result.outcome == "done", result.error
    found = {str(file.relative_to(out)): file.read_bytes() for file in out.rglob("*") if file.is_file()}
    assert "signals.parquet" in found
    del found["manifest.json"]
    return found


def test_every_fmu_alone(fmus: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Without inputs, for half a second; all outputs are compared. ArduPilot's needs a program that is not here."""
    caplog.set_level(logging.ERROR)
    files = sorted(file for file in fmus.glob("*.fmu") if file.stem != "ArduPilotSITL")
    assert len(files) > 25
    for file in files:
        here = recorded(file, tmp_path / f"{file.stem}-here", "none", until=0.5)
        there = recorded(file, tmp_path / f"{file.stem}-there", "all", until=0.5)
        assert here == there, file.name
        assert pq.read_metadata(tmp_path / f"{file.stem}-there" / "signals.parquet").num_rows > 1


@pytest.mark.parametrize("name", SYSTEMS)
def test_shipped_systems(fmus: Path, tmp_path: Path, name: str) -> None:
    system = shipped.find(name)
    assert system is not None
    here = recorded(Path(system), tmp_path / "here", "none", **SYSTEMS[name])
    there = recorded(Path(system), tmp_path / "there", "all", **SYSTEMS[name])
    assert here == there
    assert "packets.parquet" in here

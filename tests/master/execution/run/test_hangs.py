"""The thread that watches for FMUs that do not return; what it says of them is in results/test_journal.py."""

from __future__ import annotations

import select
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.run.faults import hangs
from cosim_master.execution.simulate import simulate


def test_it_ends_with_the_run_and_not_a_tick_later(
    probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its tick of a quarter of a second, each short run would take a quarter of a second."""
    woken = []

    def watched(reading: Any, writing: Any, errors: Any, seconds: float) -> Any:
        ready = select.select(reading, writing, errors, seconds)
        woken.append(bool(ready[0]))
        return ready

    monkeypatch.setattr(hangs, "select", SimpleNamespace(select=watched))
    monkeypatch.setattr(hangs, "_TICK", 600.0)
    probes.fmu()
    assert simulate(probes.ssd(probes.component("a")), RunOptions(out=tmp_path / "out")).outcome == "done"
    assert all(woken)  # none has waited for its tick

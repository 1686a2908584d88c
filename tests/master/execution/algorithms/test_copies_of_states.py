"""Copies of states are made by wall-clock time: neither values nor the bytes of files show when."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.execution.algorithms import fixed_step
from cosim_master.execution.execution import Execution
from cosim_master.execution.options import RunOptions
from cosim_master.execution.run.snapshot import Snapshot
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.network.radio.build import grown
from cosim_master.network.radio.tables import ROLES, Radio
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.observation import Rows, Seen
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid
from tests.conftest import ROOT

pytestmark = pytest.mark.usefixtures("own_cache")

TABLES = ("signals.parquet", "packets.parquet")


def digests(out: Path) -> dict[str, str]:
    return {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in TABLES if (out / name).exists()}


def test_a_swarm_with_copies_at_any_time_has_the_same_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A swarm of FMUs that may discard steps, as far as the master knows: no copies, one, and one at every call."""
    system = ROOT / "master" / "systems" / "line5"
    found = []
    opened = Library.__init__

    def foreign(self: Library, *args: Any, **options: Any) -> None:
        opened(self, *args, **options)
        self.own = False

    for seconds in (None, 1e9, -1.0):
        if seconds is not None:
            monkeypatch.setattr(Library, "__init__", foreign)
            monkeypatch.setattr(fixed_step, "_SNAPSHOT_EVERY", seconds)
        out = tmp_path / str(seconds)
        assert simulate(system, RunOptions(out=out, until=20.0)).outcome == "done"
        found.append(digests(out))
    assert len(found[0]) == len(TABLES)
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("seconds", [1e9, -1.0])
def test_discarded_steps_end_no_row_group(
    stricts: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    monkeypatch.setattr(fixed_step, "_SNAPSHOT_EVERY", seconds)
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=0.5, longest=0.25, s="x") + stricts.component("b")
    system = stricts.ssd(parts, "a/y b/u", "a/r b/s", "a/c b/b", "b/r a/s", stop=4.0)
    result = simulate(system, RunOptions(out=tmp_path / "out", at=[(1.5, "a.p", "3")]))
    assert (result.outcome, stricts.complaints) == ("done", [])
    file = pq.ParquetFile(tmp_path / "out" / "signals.parquet")
    assert file.num_row_groups == 1
    assert file.read(columns=["time"]).column(0).to_pylist() == [0.5 * i for i in range(9)]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "done"


def test_rows_that_were_handed_over_are_not_taken_back(stricts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A checkpoint and a full block hand them over; a step discarded after it goes back to a copy made after it."""
    monkeypatch.setattr(fixed_step, "_SNAPSHOT_EVERY", 1e9)
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=1.5, longest=0.25, u=1.0) + stricts.component("b")
    with read_system(stricts.ssd(parts, "a/y b/u")) as structure:
        checked = check(structure)
        clock, network = time_grid(checked), network_of(checked, None)
        seen: list[float] = []

        class Observer:
            every = 0

            def initialised(self, seen: Seen) -> None: ...
            def stepped(self, seen: Seen) -> None: ...
            def closed(self) -> None: ...
            def rows(self, rows: Rows, *, complete: bool) -> None:
                if complete:
                    seen.extend(rows.time.tolist())

        with Execution(checked, clock, make_layout(checked, network), network) as execution:
            execution.blocks.attach([Observer()], [])
            execution.advance(2)
            execution.blocks.rows()
            execution.advance(4)
            execution.blocks.complete()
    assert seen == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert stricts.complaints == []


def test_packets_are_taken_back(fmus: Path) -> None:
    """Also those for which the radio has grown since; otherwise, it keeps its tables."""
    with read_system(ROOT / "master" / "systems" / "line5-points") as structure:
        checked = check(structure)
        clock, network = time_grid(checked), network_of(checked, None)
        with Execution(checked, clock, make_layout(checked, network), network) as execution:
            execution.advance(100)
            copy = Snapshot(execution.state)
            copy.save()
            radio = execution.state.radio
            wanted = [array.copy() for array in radio]
            execution.advance(300)
            assert changed(radio, wanted) >= {"counters", "endpoints"}
            copy.restore()
            assert execution.state.radio is radio
            assert not changed(radio, wanted) & CHANGING
            execution.state.radio = grown(radio, 100)
            copy.restore()
            assert not changed(execution.state.radio, wanted) & CHANGING
            radio.counters[:] = 7  # the copy is not the radio
            execution.state.radio.counters[:] = 7
            copy.restore()
            assert not changed(execution.state.radio, wanted) & CHANGING
            copy.close()


CHANGING = {name for name, role in ROLES.items() if role in ("state", "passing")}


def changed(radio: Radio, wanted: list[Any]) -> set[str]:
    """Names of the arrays that differ."""
    return {
        name for name, one, other in zip(radio._fields, radio, wanted, strict=True) if not np.array_equal(one, other)
    }

"""Groups of a swarm step ahead of each other, on several threads, and every file stays the same to the byte."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.run import opening
from cosim_master.execution.simulate import simulate
from cosim_master.stepping import grouping
from cosim_master.stepping.kernels.tables import WINDOW
from cosim_master.system.authoring.swarm.new import fleet_of, new_system

DRONES = 12


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Of each run: the number of groups, of one drone each, and the base steps of a window."""
    seen: list[tuple[int, int]] = []
    grouped = grouping.grouped

    def noted(*arguments: Any) -> Any:
        plan, radio = grouped(*arguments)
        seen.append((int(plan.groups.size), int(plan.counters[WINDOW])))
        return plan, radio

    monkeypatch.setattr(opening, "grouped", noted)
    monkeypatch.setattr(grouping, "LARGEST", 3)
    return seen


def together(monkeypatch: pytest.MonkeyPatch, *, groups: bool) -> None:
    monkeypatch.setattr(grouping, "LEAST", 2 if groups else 10**9)


def files(folder: Path) -> dict[str, bytes]:
    found = {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    del found["manifest.json"]  # it has times of the wall clock
    return found


@pytest.fixture(scope="module")
def points(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    fleet = {"vehicle": fleet_of("PointMass"), "autopilot": fleet_of("IdealAutopilot")}
    return new_system("line", DRONES, tmp_path_factory.mktemp("points") / "line", fmus=fmus, fleet=fleet, until=8.0)


@pytest.fixture(scope="module")
def line(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return new_system("line", DRONES, tmp_path_factory.mktemp("line") / "line", fmus=fmus, until=5.0)


RADIOS: Mapping[str, Mapping[str, str]] = {
    "line": {},
    "all": {"network.topology": "broadcast"},
    "bad": {"network.loss": "0.3", "network.jitter": "0.1", "network.duplicates": "0.2", "network.range": "25"},
    "slow": {"network.topology": "broadcast", "network.latency": "0.13", "recording.interval": "0.05"},
}


@pytest.mark.parametrize("radio", RADIOS)
def test_groups_and_threads_change_no_byte(
    radio: str, points: Path, tmp_path: Path, windows: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The memory for packets in flight grows during the run, while a second thread has the smaller one."""
    found = []
    for groups, threads in ((False, 1), (True, 1), (True, 2)):
        together(monkeypatch, groups=groups)
        out = tmp_path / f"{groups}-{threads}"
        assert simulate(points, RunOptions(out=out, threads=threads, overrides=RADIOS[radio])).outcome == "done"
        found.append(files(out))
    window = 12 if radio == "slow" else 3
    assert windows == [(0, 0), (DRONES, window), (DRONES, window)]
    assert found[0] == found[1] == found[2]
    assert {"signals.parquet", "packets.parquet", "packets/drone1.tlog"} <= found[0].keys()


def test_checkpoints_are_the_same(
    line: Path, tmp_path: Path, windows: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that goes on from a checkpoint between two windows of 9 base steps of 2.5 ms has the same future."""
    together(monkeypatch, groups=False)
    simulate(line, RunOptions(out=tmp_path / "whole", checkpoint_every=2.1))
    together(monkeypatch, groups=True)
    simulate(line, RunOptions(out=tmp_path / "half", checkpoint_every=2.1, threads=2))
    simulate(
        line, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'half'}@2.1", checkpoint_every=2.1, threads=2)
    )
    assert windows == [(0, 0), (DRONES, 9), (DRONES, 9)]
    whole, rest = files(tmp_path / "whole"), files(tmp_path / "rest")
    assert {name: rest.get(name) for name in whole if not name.startswith("checkpoints")} == {
        name: content for name, content in whole.items() if not name.startswith("checkpoints")
    }


def test_a_failure_is_told_as_without_groups(
    line: Path, tmp_path: Path, windows: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two vehicles fail in the same base step, in two groups, while the others go on to the end of their window."""
    storm = [(2.0, f"drone{n}.vehicle.wind[1]", "1e250") for n in (3, 7)]  # it acts once their motors turn, at 4.1575 s
    found, errors = [], []
    for groups in (False, True):
        together(monkeypatch, groups=groups)
        result = simulate(line, RunOptions(out=tmp_path / str(groups), at=storm, threads=2))
        errors.append((result.outcome, str(result.error)))
        found.append(files(tmp_path / str(groups)))
    assert windows == [(0, 0), (DRONES, 9)]
    assert errors[0] == errors[1]
    assert errors[0][0] == "failed"
    assert re.findall(r"^(\S+): fmi2DoStep failed at t = 4.1575 s", errors[0][1], re.M) == [
        "drone3.vehicle",
        "drone7.vehicle",
    ]
    assert found[0] == found[1]

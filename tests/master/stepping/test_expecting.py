"""Large swarms: the next instance's memory is prefetched, one FMU after the other steps; neither changes a bit."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim_master import RunOptions, simulate
from cosim_master.execution.execution import Execution
from cosim_master.execution.run.opening import Setup
from cosim_master.stepping import plan
from cosim_master.stepping.kernels.tables import EXPECTING
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.profiling import Profiler
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"
FILES = ("signals.parquet", "packets.parquet", "packets.tlog")


def recorded(folder: Path, threads: int, *, profile: bool = False) -> dict[str, bytes]:
    result = simulate(LINE5, RunOptions(out=folder, until=3.0, threads=threads, profile=profile))
    assert result.outcome == "done"
    return {name: (folder / name).read_bytes() for name in FILES}


def test_prefetching_changes_no_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without = recorded(tmp_path / "without", 1)
    monkeypatch.setattr(plan, "_WORTH_EXPECTING", 1)
    assert recorded(tmp_path / "one", 1) == without
    assert recorded(tmp_path / "two", 2) == without
    assert recorded(tmp_path / "profiled", 1, profile=True) == without


@pytest.mark.parametrize(("least", "profiler", "expected"), [(1, False, 15), (16, False, 0), (1, True, 0)])
def test_only_many_instances_are_expected(
    least: int, profiler: bool, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan, "_WORTH_EXPECTING", least)
    with read_system(LINE5) as structure:
        checked = check(structure)
        clock, network = time_grid(checked, 1.0), network_of(checked)
        setup = Setup(profiler=Profiler() if profiler else None)
        with Execution(checked, clock, make_layout(checked, network), network, setup) as execution:
            instances = execution.plan.instances
            assert (instances["expect"] != 0).sum() == expected
            assert bool(execution.plan.counters[EXPECTING]) == (least == 1)


def test_instances_of_one_fmu_step_together() -> None:
    """The system has agent, autopilot and vehicle of one drone after the other."""
    with read_system(LINE5) as structure:
        checked = check(structure)
        clock, network = time_grid(checked, 1.0), network_of(checked)
        with Execution(checked, clock, make_layout(checked, network), network, Setup()) as execution:
            names = [checked.instances[i].name for i in execution.plan.free]
    models = ["agent", "autopilot", "vehicle"]
    assert sorted(names) == sorted(f"drone{i}.{model}" for i in range(1, 6) for model in models)
    for group in (names[:5], names[5:10], names[10:]):
        (model,) = {name.split(".")[1] for name in group}
        assert group == [f"drone{i}.{model}" for i in range(1, 6)]

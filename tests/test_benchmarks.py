"""The benchmarks run, at sizes of no meaning; that all contenders compute the same they check themselves."""

from __future__ import annotations

import importlib
import json
import math
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cosim_master.campaigns.study.factors import Factor

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def benchmark(name: str, folder: Path, *words: str) -> dict[str, Any]:
    """Run a benchmark as a program, but in this process, which has imported most of it; returns what it writes as JSON.

    Processes that benchmarks start are started all the same.
    """
    file = folder / f"{name}.json"
    program = str(BENCHMARKS / f"{name}.py")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [program, *words, "--json", str(file)])
        patch.syspath_prepend(str(BENCHMARKS))
        patch.chdir(folder)  # some go elsewhere
        runpy.run_path(program, run_name="__main__")
    sys.modules.pop("relay", None)  # a process loads the file of a model once
    result: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    assert result["benchmark"] == name
    assert result["machine"]["cores"] >= 1
    return result


@pytest.mark.slow
def test_overhead_compares_masters_that_compute_the_same(tmp_path: Path) -> None:
    words = ("--instances", "1", "3", "--rounds", "2", "--scale", "0.002", "--masters", "FMPy")
    rows = benchmark("overhead", tmp_path, *words)["rows"]
    assert [(row["fmu"], row["instances"]) for row in rows] == [
        (fmu, n) for fmu in ("Relay", "Quadrotor") for n in (1, 3)
    ]
    for row in rows:
        assert set(row["us_per_fmu_step"]) == {"C", "uav-cosim", "FMPy"}
        assert all(value > 0.0 for value in row["us_per_fmu_step"].values())


@pytest.mark.slow
def test_overhead_of_fmi_3_is_compared_with_a_program_that_computes_the_same(tmp_path: Path) -> None:
    words = ("--instances", "2", "--rounds", "2", "--scale", "0.002", "--fmi", "3")
    rows = benchmark("overhead", tmp_path, *words)["rows"]
    assert [(row["fmu"], row["instances"]) for row in rows] == [("Relay.fmi3", 2), ("Quadrotor.fmi3", 2)]
    assert all(set(row["us_per_fmu_step"]) == {"C", "uav-cosim"} for row in rows)


def test_the_model_of_parts_has_its_limits(tmp_path: Path) -> None:
    """With free messages, nothing is lost; with a slow network, a window lasts as long as its messages at least."""
    free = ["--message-us", "0", "--window-us", "0", "--network-us", "0", "--gbit", "1e9", "--noise", "0"]
    free += ["--packets", "0", "--recorded", "0", "--windows", "500", "--drones", "1600", "--hosts", "1", "4", "16"]
    for row in benchmark("partitions", tmp_path, *free)["rows"]:
        assert row["efficiency"] == pytest.approx(1.0, rel=0.01) == row["waited_for"]
    slow = ["--network-us", "50000", "--drones", "100", "--hosts", "4", "--windows", "200"]
    for row in benchmark("partitions", tmp_path, *slow)["rows"]:
        assert row["real_time_factor"] < 0.01 * 2 / 0.05


@pytest.mark.slow
def test_a_campaign_is_measured_beside_a_loop(
    tmp_path: Path, fmus: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the 50 points of the study, six are enough to be counted."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    campaigns = importlib.import_module("campaigns")
    factors = [Factor.parsed(f"network.loss={values}") for values in (campaigns.EPSILON, campaigns.LOSS)]
    assert math.prod(len(one.values) for one in factors) == campaigns.POINTS == 50
    monkeypatch.setattr(campaigns, "EPSILON", "0.1:0.55:3")
    monkeypatch.setattr(campaigns, "LOSS", "0,0.3")
    monkeypatch.setattr(campaigns, "POINTS", 6)
    document, file = tmp_path / "scale.md", tmp_path / "campaigns.json"
    document.write_text("# Scale\n\nOther figures.\n", encoding="utf-8")
    words = ["--seeds", "1", "--loop", "1", "--workers", "1", "--until", "2", "--docs", str(document)]
    campaigns.main([*words, "--json", str(file)])
    found = json.loads(file.read_text(encoding="utf-8"))
    assert (found["benchmark"], found["loop"]["runs"], found["campaign"]["runs"]) == ("campaigns", 1, 6)
    assert all(found[name]["processor_s_per_run"] > 0.0 for name in ("loop", "campaign"))
    text = document.read_text(encoding="utf-8")
    assert text.startswith("# Scale\n\nOther figures.\n")
    assert "| 6 |" in text
    assert "sweep" in capsys.readouterr().out


@pytest.mark.slow
def test_isolated_fmus_compute_the_same(tmp_path: Path) -> None:
    rows = benchmark("isolation", tmp_path, "--instances", "3", "--rounds", "1", "--scale", "0.01")["rows"]
    assert [(row["fmu"], row["instances"]) for row in rows] == [("Relay", 3), ("Quadrotor", 3)]
    assert all(
        set(row["us_per_fmu_step"]) == {"none", "foreign", "foreign, in turn", "instance", "instance, in turn"}
        for row in rows
    )


@pytest.mark.slow
def test_swarm_flies_and_accounts_for_every_phase(tmp_path: Path, fmus: Path) -> None:
    words = ("--drones", "3", "--seconds", "2", "--fmus", str(fmus))
    (row,) = benchmark("swarm", tmp_path, *words)["rows"]
    assert set(row["phases_us"]) == {"exchange", "packets", "Quadrotor", "Autopilot", "LineAgent"}
    assert all(value > 0.0 for value in row["phases_us"].values())
    assert row["packets"]["delivered"] > 0
    assert row["written_bytes"] > 0
    assert row["start_up_s"] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["points", "whole"])
def test_a_swarm_of_point_masses_has_the_step_it_is_given(tmp_path: Path, fmus: Path, scenario: str) -> None:
    words = ("--scenario", scenario, "--drones", "3", "--seconds", "1", "--fmus", str(fmus))
    for step, expected in ((("--step", "0.05"), 0.05), ((), 0.0125)):
        (row,) = benchmark("swarm", tmp_path, *words, *step)["rows"]
        assert row["base_step"] == expected
        assert row["packets"]["sent"] > 0


@pytest.mark.slow
def test_packets_are_the_same_for_pymavlink(tmp_path: Path, fmus: Path) -> None:
    rows = benchmark("packets", tmp_path, "--rounds", "1", "--scale", "0.01", "--fmus", str(fmus))["rows"]
    assert [row["operation"] for row in rows] == ["encode", "find", "decode", "route"]


@pytest.mark.slow
def test_engines_ours_is_right_in_every_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And docs/engines.md has these rows."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    engines = importlib.import_module("engines")
    lines = (BENCHMARKS.parent / "docs" / "engines.md").read_text(encoding="utf-8").splitlines()
    documented = [[cell.strip() for cell in line.split("|")[1:5]] for line in lines if line.startswith("| ")]
    fmu = engines.build_fmu(tmp_path)
    assert len(engines.cases()) >= 17
    for i, case in enumerate(engines.cases()):
        path = tmp_path / f"case{i}.ssp"
        engines.write(case, fmu, path)
        assert engines.ours(str(path)) == pytest.approx(case.expected, rel=1e-9), case.name
        assert [case.name, case.section, f"{case.expected:g}", f"**{case.expected:g}**"] in documented


@pytest.mark.slow
def test_the_live_page_is_served_and_its_processor_time_is_measured(tmp_path: Path, fmus: Path) -> None:
    pytest.importorskip("websockets", reason="the extra `live` is not installed")
    (row,) = benchmark("view", tmp_path, "line5@20", "--seconds", "20")["rows"]
    assert row["run"] == "line5@20" and row["frames"] > 0.0 and row["rate"] > 0.0
    assert row["observer"] > 0.0 and row["server"] > 0.0 and row["run_cpu"] > 0.0


def test_instructions_steps_what_it_counts() -> None:
    # Without valgrind, which is not at hand everywhere.
    command = [sys.executable, str(BENCHMARKS / "instructions.py"), "--child", "line5", "--from", "1", "--steps", "10"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def partitions(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("partitions")


WINDOW, SECONDS, DRONES, PACKETS = 4, 4 / 400, 1000, 6.0


def costs(partitions: Any, latency: float, recorded: float = 0.0) -> Any:
    return partitions.Costs(1.2e-6, 25e-6, 6e-7, 3e-4, latency, 1e8, 0.0, PACKETS, recorded)


def parts_of_a_window(of: Any, topology: str, hosts: int) -> tuple[float, float]:
    """Seconds in which a host steps and replays, and in which its message is under way; all hosts hear all others."""
    own = DRONES / hosts
    sent = own * PACKETS * SECONDS
    crossing = 2 * PACKETS * SECONDS if topology == "line" else sent
    size = {"line": 128 * crossing, "all": 128 * crossing + 24 * own * WINDOW, "near": 152 * crossing + 384}[topology]
    busy = own * of.step * WINDOW + of.window + (sent + (hosts - 1) * crossing) * of.packet
    return busy + 2 * (hosts - 1) * of.message, (hosts - 1) * size / of.rate + of.latency


@pytest.mark.parametrize(("topology", "hosts"), [("line", 2), ("near", 2), ("all", 2), ("all", 4)])
@pytest.mark.parametrize("hidden", [True, False])
@pytest.mark.parametrize("latency", [0.0, 2e-3, 2e-2])
def test_the_model_of_parts_has_its_closed_form(
    partitions: Any, topology: str, hosts: int, hidden: bool, latency: float
) -> None:
    """Without noise, a window takes the greatest mean of a cycle: of a host alone, or of two that wait for each other,
    for the same window, or, if messages are hidden, for the one before.
    """
    of = costs(partitions, latency)
    busy, under_way = parts_of_a_window(of, topology, hosts)
    period = max(busy, (busy + under_way) / 2) if hidden else busy + under_way
    given = {"window": WINDOW, "neighbours": 6, "windows": 1000}
    found = partitions.speed(DRONES, hosts, topology, of, hidden=hidden, **given)
    assert found == pytest.approx(SECONDS / period, rel=4e-3)


@pytest.mark.parametrize("latency", [0.0, 2e-2])
def test_the_model_of_parts_counts_the_rows_that_part_0_takes(partitions: Any, latency: float) -> None:
    of = costs(partitions, latency, recorded=24_000.0)
    busy, under_way = parts_of_a_window(of, "all", 2)
    rows = DRONES / 2 * 24_000.0 * SECONDS * (1 / of.rate + 0.5e-9)
    period = max(busy + rows, busy + under_way + rows / 2)
    found = partitions.speed(DRONES, 2, "all", of, window=WINDOW, hidden=False, neighbours=6, windows=1000)
    assert found == pytest.approx(SECONDS / period, rel=4e-3)


@pytest.mark.slow
def test_speeds_of_parts_are_measured(
    tmp_path: Path, fmus: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mpi4py")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    parts = importlib.import_module("parts")
    libraries = dict([*parts.launchers([]).items()][:1])
    monkeypatch.setattr(parts, "launchers", lambda _: libraries)
    document, file = tmp_path / "scale.md", tmp_path / "parts.json"
    document.write_text("# Scale\n\nOther figures.\n", encoding="utf-8")
    words = ["--parts", "1", "2", "--drones", "3", "--points", "--seconds", "0.2", "--docs", str(document)]
    parts.main([*words, "--json", str(file)])
    found = json.loads(file.read_text(encoding="utf-8"))
    assert [(one["drones"], one["vehicle"], one["parts"]) for one in found["swarms"]] == [
        (3, "Quadrotor", 1),
        (3, "Quadrotor", 2),
    ]
    assert all(one["processor_s"] > 0.0 < one["real_time_factor"] for one in found["swarms"])
    assert [(one["library"], one["parts"]) for one in found["windows"]] == [(*libraries, 2)]
    text = document.read_text(encoding="utf-8")
    assert text.startswith("# Scale\n\nOther figures.\n")
    assert "| 3 | Quadrotor | 2 |" in text
    assert f"| {next(iter(libraries))} | " in text
    assert "3 Quadrotor in 2" in capsys.readouterr().out


def test_a_run_that_fails_ends_the_benchmark_with_its_message(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    parts = importlib.import_module("parts")
    with pytest.raises(SystemExit, match=r"(?s)run .*missing.ssd.*: exit code 2\n.*error: "):
        parts.flown(tmp_path / "missing.ssd", 1, 1.0, tmp_path / "out")

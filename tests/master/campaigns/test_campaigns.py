"""Campaigns: what runs give, and that nothing is lost or made twice when processes are killed."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim_master.campaigns.campaign import sweep
from cosim_master.campaigns.dataset.folder import Folder, read_runs, read_study
from cosim_master.campaigns.dataset.table import digest_of, schema_of, sorted_table
from cosim_master.campaigns.metrics.metric import Metric
from cosim_master.campaigns.running.options import commands
from cosim_master.campaigns.running.place import Disagreement, look_at
from cosim_master.campaigns.running.prefix import groups, make_prefix
from cosim_master.campaigns.running.task import perform
from cosim_master.campaigns.study.factors import Factor
from cosim_master.campaigns.study.study import Study
from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.reading.flight import read_flight
from cosim_master.results.reading.read import signals
from cosim_master.system.authoring.swarm.swarm import Swarm
from tests.master.cli.test_command_line import is_as_documented
from tests.master.processes import children
from tests.scenarios.flights import copy_of

COMMAND = Path(sys.executable).with_name("uav-cosim")
LIMIT = 600.0
"""Seconds for whatever a test waits for."""


def metrics(*texts: str) -> tuple[Metric, ...]:
    return tuple(map(Metric.parsed, texts))


def rows_of(study: Study) -> list[dict[str, Any]]:
    """The rows of all runs, made here one after the other, each from its start."""
    runs = study.runs()
    place = look_at(study, runs[0])
    return [dict(perform(study, place, run).row) for run in runs]


def wait(what: Callable[[], bool], process: subprocess.Popen[Any] | None = None) -> None:
    end = time.monotonic() + LIMIT
    while not what():
        assert time.monotonic() < end
        assert process is None or process.poll() is None, "it has ended before"
        time.sleep(0.05)


# ---- one run -------------------------------------------------------------------------------------------------------


def test_a_run_of_a_campaign_is_the_run_of_the_command(fmus: Path, tmp_path: Path) -> None:
    """Metrics and kept signals are those of a recording that `run` makes with the options of the command."""
    study = Study(
        system="line5",
        factors=(Factor.parsed("drone*.agent.epsilon=0.3,0.55"), Factor.parsed("network.loss=0.2")),
        seeds=(7,),
        metrics=metrics("error_to_law", "nearest_approach", "packets_lost", "top=max(-1 * drone*.vehicle.position[3])",
                        "step=last(drone3.agent.step)", "armed=mean(drone1.autopilot.armed)"),
        keep=("drone2.vehicle.position*",),
        until=40.0,
    )  # fmt: skip
    run = study.runs()[1]
    ended = perform(study, look_at(study, run), run)
    overrides = {"drone*.agent.epsilon": "0.55", "network.loss": "0.2"}
    result = simulate("line5", RunOptions(overrides=overrides, seed=7, until=40.0, out=tmp_path))
    recorded, flight = signals(tmp_path), read_flight(tmp_path)
    assert flight.law is not None
    ends = [abs(one.position[-1, 1] - flight.law[0][one.name]) for one in flight.drones if one.mobile]
    height = max(-recorded[f"drone{n}.vehicle.position[3]"].to_numpy().min() for n in range(1, 6))
    assert result.verdict is not None
    assert ended.row == {
        "run": 1, "point": 1, "seed": 7, "drone*.agent.epsilon": 0.55, "network.loss": 0.2, "outcome": "done",
        "reason": "", "good": result.verdict.good, "failures": 0,
        "warnings": sum(one.severity == "warning" for one in result.verdict.findings),
        "findings": ended.row["findings"], "simulated_s": 40.0, "error_to_law": max(ends),
        "nearest_approach": result.verdict.nearest["distance"], "packets_lost": float(result.packets["lost"]),
        "top": height, "step": float(recorded["drone3.agent.step"][-1].as_py()),
        "armed": float(np.mean(recorded["drone1.autopilot.armed"].to_numpy(zero_copy_only=False))),
    }  # fmt: skip
    assert ended.row["packets_lost"] > 0.0
    kept = pq.read_table(_file(tmp_path / "kept.parquet", ended.signals))
    assert kept.column_names == ["time", *(f"drone2.vehicle.position[{i}]" for i in (1, 2, 3))]
    assert all(kept[name].equals(recorded[name]) for name in kept.column_names)


def test_the_recorded_instants_are_there_without_any_signal(fmus: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("def end(run):\n    return run.time[-1]\n\n\nend.signals = []\n")
    study = Study(system="line5", metrics=metrics("integral(time)", f"{file}:end"), until=2.0)
    (run,) = study.runs()
    row = perform(study, look_at(study, run), run).row
    assert (row["reason"], row["integral(time)"], row["end"]) == ("", pytest.approx(2.0), 2.0)


def _file(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_runs_with_a_common_beginning_are_the_same_as_from_their_start(fmus: Path) -> None:
    """Two factors at different times, and changes before and after: rows and signals to the last bit."""
    study = Study(
        system="line5",
        factors=(Factor.parsed("drone3.vehicle.wind[2]@12=0,5"), Factor.parsed("drone2.vehicle.wind[1]@14=0,3")),
        metrics=metrics("max(drone*.vehicle.position[2])", "nearest_approach", "packets_lost", "last(time)"),
        keep=("*.vehicle.position*", "*.autopilot.armed"),
        overrides={"network.loss": "0.2"},
        at=((5.0, "drone1.vehicle.wind[1]", "2"), (13.0, "drone1.vehicle.wind[1]", "0")),
        until=16.0,
    )
    runs = study.runs()
    place = look_at(study, runs[0])
    ((shared, group),) = groups(study, runs)
    assert (shared, len(group)) == (True, 4)
    prefix = make_prefix(study, place, group[0])
    assert not isinstance(prefix, str)
    digests = set()
    for run in group:
        branch, whole = perform(study, place, run, prefix), perform(study, place, run)
        assert branch.row == whole.row
        assert branch.signals == whole.signals
        digests.add(branch.signals)
    assert len(digests) == 4


def test_a_common_beginning_of_a_run_that_starts_later_than_0(fmus: Path, tmp_path: Path) -> None:
    system = copy_of("line5", tmp_path, fmus, lambda text: text.replace('startTime="0"', 'startTime="1"'))
    study = Study(system=str(system), factors=(Factor.parsed("drone3.vehicle.wind[2]@2=0,5"),), until=3.0,
                  metrics=metrics("last(drone3.vehicle.velocity[2])", "min(time)"))  # fmt: skip
    runs = study.runs()
    place = look_at(study, runs[0])
    prefix = make_prefix(study, place, runs[0])
    assert not isinstance(prefix, str)
    for run in runs:
        row = perform(study, place, run, prefix).row
        assert row == perform(study, place, run).row
        assert (row["outcome"], row["simulated_s"], row["min(time)"]) == ("done", 2.0, 1.0)


@pytest.mark.parametrize("begin", [0, 1])
def test_a_setting_of_the_radio_changes_at_a_checkpoint_as_its_commands_do(
    fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begin: int
) -> None:
    monkeypatch.chdir(tmp_path)
    system = copy_of("line5", tmp_path, fmus, lambda text: text.replace('startTime="0"', f'startTime="{begin}"'))
    study = Study(system=str(system), factors=(Factor.parsed("network.loss@10=0.5"),), metrics=metrics("packets_lost"),
                  until=15.0)  # fmt: skip
    (run,) = study.runs()
    place = look_at(study, run)
    prefix = make_prefix(study, place, run)
    row = perform(study, place, run, prefix).row
    for command in commands(study, run, place.begin):
        done = CliRunner().invoke(app, shlex.split(command)[1:])
        assert done.exit_code == 0, done.stderr
    manifest = json.loads((tmp_path / "run-0" / "manifest.json").read_text(encoding="utf-8"))
    assert row["packets_lost"] == manifest["packets"]["lost"] > 0
    assert row["simulated_s"] == 15.0 - begin


def test_a_run_that_fails_is_a_row_with_its_reason(fmus: Path) -> None:
    study = Study(
        system="line5",
        factors=(Factor.parsed("drone3.vehicle.mass=1.5,-1"), Factor.parsed("drone3.vehicle.wind[1]@2=0,nan")),
        metrics=metrics("packets_lost"),
        until=4.0,
    )
    good, failed, *refused = rows_of(replace(study, factors=study.factors))
    assert (good["outcome"], good["reason"]) == ("done", "")
    assert failed["outcome"] in ("failed", "refused")
    assert "drone3.vehicle" in failed["reason"]
    assert [row["outcome"] for row in refused] == ["refused"] * 2
    assert all("drone3.vehicle.mass" in row["reason"] for row in refused)
    table = sorted_table([good, failed, *refused], schema_of(study))
    assert table.column("packets_lost").to_pylist()[2:] == [None, None]


def test_the_command_says_why_the_first_run_failed(fmus: Path, tmp_path: Path) -> None:
    """All runs have been made before, so no worker is needed."""
    study = Study(system="line5", factors=(Factor.parsed("network.loss=0,5,6"),), metrics=metrics("packets_lost"))
    study = replace(study, until=1.0)
    with Folder(tmp_path / "out", study, look_at(study, study.runs()[0]).inputs) as folder:
        for row in rows_of(study):
            folder.add(row)
    done = CliRunner().invoke(app, ["sweep", str(tmp_path / "out")])
    assert (done.exit_code, done.stdout.splitlines()[0][:36]) == (1, "3 of 3 runs (1 done, 2 refused): 0 i")
    said = "error: 2 of 3 runs failed; run 1: "
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("error: "))
    assert line.startswith(said) and "network.loss=5" in line and line.endswith("`reason` has all reasons"), line


def test_a_worker_with_other_files_is_refused(fmus: Path) -> None:
    study = Study(system="line5", metrics=metrics("packets_lost"), until=1.0)
    (run,) = study.runs()
    place = look_at(study, run)
    with pytest.raises(Disagreement, match="has another version, system or FMUs than the client"):
        perform(study, replace(place, identity="0" * 16), run)


def test_an_fmu_that_is_built_anew_during_a_campaign_is_named(fmus: Path, tmp_path: Path) -> None:
    """The digest of an FMU is that of its file: another build of a model is another FMU."""
    swarm = Swarm("one", stop_time=1.0, network={"topology": "broadcast"})
    own = tmp_path / "Own.fmu"
    shutil.copyfile(fmus / "Quadrotor.fmu", own)
    swarm.add("lone", vehicle=own)
    study = Study(system=str(swarm.save(tmp_path / "one")), metrics=metrics("packets_lost"))
    (run,) = study.runs()
    place = look_at(study, run)
    assert perform(study, place, run).row["outcome"] == "done"
    shutil.copyfile(fmus / "Hexarotor.fmu", own)
    with pytest.raises(Disagreement) as caught:
        perform(study, place, run)
    text = (
        r"worker \S+: has another \S+Own\.fmu \(lone\.vehicle\) than the client had when it began: if the file has "
        r"been built anew since, begin the campaign again; otherwise, share the folders"
    )
    assert re.fullmatch(text, str(caught.value))


@pytest.mark.parametrize(
    ("study", "says"),
    [
        (
            Study(system="line5", factors=(Factor.parsed("drone*.agent.epsion=1,2"),)),
            '^--vary: .*did you mean "drone.*epsilon"',
        ),
        (Study(system="line5", metrics=metrics("max(drone9.vehicle.position[2])")), "there is no signal"),
        (Study(system="line5", factors=(Factor.parsed("drone1.vehicle.wind[1]@90=1,2"),)), "from 0 to 84.9975 s"),
        (Study(system="line5", factors=(Factor.parsed("network.loss@90=0,1"),)), "not between 0 and 85 s"),
        (Study(system="line5", factors=(Factor.parsed("network.loss@1.001=0,1"),)), "not a multiple of the base step"),
        (Study(system="lin5"), "lin5"),
        (
            Study(system="line5", keep=("drone*.vehicle.positio[1]",)),
            r'^--keep .*positio\[1\]: matches no signal; did you mean "drone\*\.vehicle\.position\[1\]"',
        ),
    ],
)
def test_a_study_that_does_not_fit_its_system_is_refused_before_anything_is_written(
    study: Study, says: str, fmus: Path, tmp_path: Path
) -> None:
    with pytest.raises(SystemDescriptionError, match=says):
        sweep(study, tmp_path / "out")
    assert not (tmp_path / "out").exists()


# ---- many runs -----------------------------------------------------------------------------------------------------


def descendants(pid: int) -> list[int]:
    found = [int(child) for child in children(pid)]
    return [one for child in found for one in (child, *descendants(child))]


def workers_of(pid: int) -> list[int]:
    """The processes of workers: the children of the processes that watch them."""
    names = {
        one: Path(f"/proc/{one}/cmdline").read_bytes() for one in descendants(pid) if Path(f"/proc/{one}").exists()
    }
    spawned = [one for one, name in names.items() if b"spawn_main" in name]
    return [one for one in spawned if not any(int(child) in spawned for child in children(one))]


def lines(folder: Path) -> int:
    """The rows so far, which are read again when a file has changed: whoever waits asks twenty times a second."""
    try:
        files = [folder / "journal.jsonl", *sorted((folder / "runs").iterdir())]
        return _rows(folder, tuple((file.name, (found := file.stat()).st_size, found.st_mtime_ns) for file in files))
    except Exception:
        return 0


@lru_cache(maxsize=1)
def _rows(folder: Path, files: tuple[tuple[str, int, int], ...]) -> int:
    return int(read_runs(folder).num_rows)


@pytest.mark.slow
def test_killed_three_times_and_interrupted_it_ends_with_the_same_dataset(fmus: Path, tmp_path: Path) -> None:
    """The scheduler is killed, then the whole command; Ctrl-C reaches all processes of a terminal; at last, a worker is
    killed. Nothing that has ended is made again."""
    out = tmp_path / "out"
    words = ["sweep", "line5", "--vary", "drone*.agent.epsilon=0.1:0.6:3", "--vary", "network.loss=0,0.2", "--seeds",
             "4", "--metric", "error_to_law", "--metric", "packets_lost", "--metric",
             "max(drone*.vehicle.position[2])", "--keep", "drone3.vehicle.position[2]", "--until", "14", "-o",
             str(out), "--json"]  # fmt: skip
    again = ["sweep", str(out), "--json", "--workers", "1"]
    dask = [sys.executable, "-m", "dask"]
    file = tmp_path / "scheduler.json"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file], **quiet
    )
    worker = None
    try:
        wait(file.is_file, scheduler)
        options = ["--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard", "--no-nanny"]
        worker = subprocess.Popen([*dask, "worker", "--scheduler-file", file, *options], **quiet)
        first = subprocess.Popen([COMMAND, *words, "--scheduler", file], stdout=subprocess.PIPE, text=True)
        wait(lambda: lines(out) >= 3, first)
        scheduler.kill()
        told = json.loads(first.communicate(timeout=LIMIT)[0])
    finally:
        for process in (scheduler, worker):
            if process is not None:
                process.kill()
                process.wait()
    assert first.returncode == 1
    assert "the connection to the scheduler is lost" in told["errors"][0]["message"]
    after_first = read_runs(out).to_pylist()
    assert 3 <= len(after_first) < 24

    second = subprocess.Popen([COMMAND, *words, "--workers", "1"], **quiet)
    wait(lambda: lines(out) >= len(after_first) + 3, second)
    orphans = workers_of(second.pid)
    second.kill()
    second.wait()
    wait(lambda: not any(Path(f"/proc/{one}").exists() for one in orphans))
    after_second = read_runs(out).to_pylist()
    assert len(after_second) < 24

    third = subprocess.Popen(
        [COMMAND, *again], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait(lambda: lines(out) >= len(after_second) + 2, third)
    os.killpg(third.pid, signal.SIGINT)
    written, errors = third.communicate(timeout=LIMIT)
    assert third.returncode == 130, errors
    assert "Traceback" not in errors
    told = json.loads(written)
    after_third = read_runs(out).to_pylist()
    assert (told["interrupted"], told["complete"], told["before"]) == (True, False, len(after_second))
    assert 2 <= told["made"] == len(after_third) - len(after_second)
    assert len(after_third) < 24

    fourth = subprocess.Popen([COMMAND, *again], stdout=subprocess.PIPE, text=True)
    wait(lambda: lines(out) >= len(after_third) + 3, fourth)
    os.kill(workers_of(fourth.pid)[0], signal.SIGKILL)
    told = json.loads(fourth.communicate(timeout=LIMIT)[0])
    assert fourth.returncode == 0
    assert is_as_documented("sweep", told)
    assert (told["before"], told["made"]) == (len(after_third), 24 - len(after_third))

    table = read_runs(out)
    assert pq.read_table(out / "runs").num_rows == 24  # no part has a run that another has
    by_run = {row["run"]: row for row in table.to_pylist()}
    assert all(by_run[row["run"]] == row for row in [*after_first, *after_second, *after_third])
    study, _, _ = read_study(out)
    alone = rows_of(study)
    assert digest_of(table) == digest_of(sorted_table(alone, schema_of(study)))
    kept = pq.read_table(out / "signals", partitioning="hive")
    assert sorted({*kept.column("run").to_pylist()}) == [*range(24)]


@pytest.mark.parametrize("moment", [0.0, 0.2])
def test_interrupted_while_its_workers_start(fmus: Path, tmp_path: Path, moment: float) -> None:
    """Ctrl-C reaches them, too, before they have read a line of this project."""
    words = ["sweep", "line5", "--vary", "network.loss=0:0.5:9", "--until", "20", "--workers", "1", "-o", "out"]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([COMMAND, *words, "--json"], cwd=tmp_path, start_new_session=True, **pipes) as process:
        wait(lambda: bool(workers_of(process.pid)), process)
        time.sleep(moment)
        os.killpg(process.pid, signal.SIGINT)
        written, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    told = json.loads(written)
    assert (told["interrupted"], told["complete"]) == (True, False)


CRASHES = """
import os, signal

def deadly(run):
    if abs(run["drone1.vehicle.position[1]"][0] - 3.0) < 1e-9:
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0

deadly.signals = "drone1.vehicle.position[1]"
"""
PROGRAM = """
import json
from cosim_master import Factor, Metric, Study, sweep

study = Study(system="line5", factors=(Factor.parsed("drone1.vehicle.position_start[1]=0,1,2,3,4,5"),),
              metrics=(Metric.parsed("mine.py:deadly"),), until=1.0)
print("begins")
seen = []
campaign = sweep(study, "out", workers=1, progress=seen.append)
print(campaign.table().column("outcome").to_pylist())
print(campaign.table().column("reason")[3])
print(campaign.bad, campaign.complete, campaign.interrupted, seen[-1].made, seen[-1].bad, seen[-1].left)
print(__file__.endswith("program.py"))
"""


@pytest.mark.slow
def test_a_run_that_kills_its_worker_is_a_row_and_no_worker_executes_the_program(fmus: Path, tmp_path: Path) -> None:
    """It has no `if __name__ == "__main__"`: as a main module of a worker, it would begin a campaign there."""
    (tmp_path / "mine.py").write_text(CRASHES, encoding="utf-8")
    (tmp_path / "program.py").write_text(PROGRAM, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=LIMIT
    )
    assert done.returncode == 0, done.stderr
    begins, outcomes, reason, *rest = done.stdout.splitlines()
    assert begins == "begins"
    assert outcomes == "['done', 'done', 'done', 'crashed', 'done', 'done']"
    assert "the process of the worker ended" in reason
    assert rest == ["1 True False 6 1 0.0", "True"]

"""A run that was interrupted goes on as if it had not been; and one that was not is tried again another way."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim.build import build, load_models
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.observation import Progress
from tests.scenarios.flights import SYSTEMS, copy_of, fly
from tests.scenarios.test_radio_is_bad import with_radio

UNTIL, EVERY = 3.0, 0.75
RECORDED = ("signals.parquet", "packets.parquet", "packets.tlog", "packets/drone1.tlog", "packets/drone3.tlog")


@pytest.fixture(scope="module")
def line5(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a radio that needs its random numbers, and on which packets are in flight at every moment."""
    workshop = tmp_path_factory.mktemp("resumed")
    return copy_of("line5", workshop, fmus, lambda text: with_radio(text, 'loss="0.3" latency="0.05" jitter="0.2"'))


@pytest.mark.slow
@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(interrupted=st.floats(EVERY, UNTIL - 0.1), seed=st.integers(0, 2**53), threads=st.sampled_from([1, 2]))
def test_interrupted_and_resumed_is_the_same_to_the_last_byte(
    interrupted: float, seed: int, threads: int, line5: Path, tmp_path: Path
) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.time >= interrupted:
            raise KeyboardInterrupt

    whole, half, rest = (tmp_path / name for name in ("whole", "half", "rest"))
    simulate(line5, RunOptions(out=whole, until=UNTIL, seed=seed, checkpoint_every=EVERY, threads=threads))
    stopped = simulate(
        line5,
        RunOptions(out=half, until=UNTIL, seed=seed, checkpoint_every=EVERY, threads=threads),
        listener=Listener(progress=interrupt),
    )
    assert stopped.outcome in ("interrupted", "done")  # done if the last piece was a long one
    last = max((float(folder.name) for folder in (half / "checkpoints").iterdir()), default=0.0)
    assert last >= EVERY
    resumed = simulate(
        line5, RunOptions(out=rest, origin=f"{half}@{last:g}", checkpoint_every=EVERY, threads=3 - threads)
    )
    assert resumed.outcome == "done"
    assert resumed.packets["sent"] > 0
    for name in RECORDED:
        assert (rest / name).read_bytes() == (whole / name).read_bytes(), name
    shutil.rmtree(tmp_path)


@pytest.mark.slow
def test_from_28_s_on_drone_3_has_weak_motors(fmus: Path, tmp_path: Path) -> None:
    """Up to then the branch is the run itself; afterwards drone 3 sinks to the ground, the others fly on."""
    assert fmus.is_dir()
    run = fly(SYSTEMS / "line5", tmp_path / "run", until=60.0, checkpoint_every=28.0)
    branch = fly(
        SYSTEMS / "line5",
        tmp_path / "branch",
        origin=f"{tmp_path / 'run'}@28",
        overrides={"drone3.autopilot.MOT_SPIN_MAX": "0.4"},
    )
    before = int(np.searchsorted(run["time"], 28.0, side="right"))
    for name in run.signals:
        np.testing.assert_array_equal(branch[name][:before], run[name][:before], err_msg=name)
    assert run.up(3)[-1] == pytest.approx(10.0, abs=0.1)
    assert branch.up(3)[-1] == pytest.approx(0.0, abs=0.3)
    for drone in (1, 2, 4, 5):
        assert branch.up(drone)[-1] == pytest.approx(10.0, abs=0.1)


def _by_radio(row: Mapping[str, Any]) -> bool:
    return row["outcome"] in ("radio", "lost: channel")


def test_from_4_s_on_the_radio_is_dead(line5: Path, tmp_path: Path) -> None:
    """Settings of the radio hold from the checkpoint on: what was sent before has the fate it had, in flight or not."""
    simulate(line5, RunOptions(out=tmp_path / "run", until=6.0, checkpoint_every=4.0))
    origin = f"{tmp_path / 'run'}@4"
    branch = simulate(line5, RunOptions(out=tmp_path / "branch", origin=origin, overrides={"network.loss": "1"}))
    assert branch.outcome == "done"
    by_radio = {
        name: [row for row in pq.read_table(tmp_path / name / "packets.parquet").to_pylist() if _by_radio(row)]
        for name in ("run", "branch")
    }
    early = {name: [row for row in rows if row["sent"] <= 4.0] for name, rows in by_radio.items()}
    assert early["run"] == early["branch"] != []
    assert {row["outcome"] for row in by_radio["branch"] if row["sent"] > 4.0} == {"lost: channel"}
    with pytest.raises(SystemDescriptionError, match="the seed of the radio must be what it was"):
        simulate(line5, RunOptions(out=tmp_path / "other", origin=origin, overrides={"network.seed": "99"}))


def test_what_keeps_a_run_from_going_on_is_said(line5: Path, tmp_path: Path) -> None:
    simulate(line5, RunOptions(out=tmp_path / "run", until=2.0, checkpoint_every=1.0, seed=7))
    origin = f"{tmp_path / 'run'}@1"

    def refused(**options: object) -> str:
        with pytest.raises(SystemDescriptionError) as caught:
            simulate(line5, RunOptions(**{"out": tmp_path / "on", "origin": origin, **options}))  # type: ignore[arg-type]
        return str(caught.value)

    assert "run has no checkpoint at 1.5 s; there are: 1" in refused(origin=f"{tmp_path / 'run'}@1.5")
    assert "write RUN@TIME" in refused(origin="run")
    assert "the seed of the radio must be what it was (7), now it is 8" in refused(seed=8)
    assert "the stop time must be what it was (2 s), now it is 3 s" in refused(until=3.0)
    assert "give another folder" in refused(out=tmp_path / "run")
    assert "signals.parquet has other columns" in refused(record=("*.position*",))
    with pytest.raises(SystemDescriptionError, match=r"documents must be what they were$"):
        simulate(SYSTEMS / "line5", RunOptions(out=tmp_path / "on", origin=origin))
    assert "every 0.0001 s is not a multiple of the base step 0.0025 s; try 0.0025" in refused(checkpoint_every=0.0001)
    assert "every 1.001 s is not a multiple of the base step 0.0025 s; try 1" in refused(checkpoint_every=1.001)
    (tmp_path / "run" / "checkpoints" / "1" / "state.npz").write_bytes(b"PK")
    assert "1 is damaged: state.npz has not the digest that checkpoint.json contains" in refused()


def test_a_branch_is_repeated_with_what_led_to_its_checkpoint(line5: Path, tmp_path: Path) -> None:
    """And says which changes of the run that it goes on from are not made."""
    gusts: list[tuple[float, str, str]] = [
        (0.5, "drone3.vehicle.wind[2]", "5"),
        (0.75, "drone*.vehicle.wind[1]", "0.2"),
        (1.5, "drone3.vehicle.wind[2]", "0"),
    ]
    out = {name: tmp_path / name for name in ("first", "branch", "replayed", "whole")}

    def signals(name: str) -> Any:
        return pq.read_table(out[name] / "signals.parquet")

    simulate(line5, RunOptions(until=3.0, at=gusts, checkpoint_every=1.0, out=out["first"]))
    origin = f"{out['first']}@1"
    branch = simulate(line5, RunOptions(until=3.0, origin=origin, out=out["branch"]))
    made = json.loads((out["branch"] / "manifest.json").read_text())["changes"]
    assert made[0] == {"time": 0.5, "variable": "drone3.vehicle.wind[2]", "value": 5.0}
    assert [(one["time"], one["value"]) for one in made[1:]] == 5 * [(0.75, 0.2)]
    text = f"{out['first']} also had changes after 1 s, which are not made here; --replay {out['first']} makes them: "
    assert [one for one in map(str, branch.notes) if "changes" in one] == [f"{text}drone3.vehicle.wind[2] at 1.5 s"]
    simulate(line5, RunOptions(until=3.0, replay=out["branch"], out=out["replayed"]))
    assert signals("replayed").equals(signals("branch")) and not signals("branch").equals(signals("first"))
    whole = simulate(line5, RunOptions(until=3.0, replay=out["first"], origin=origin, out=out["whole"]))
    assert not [one for one in map(str, whole.notes) if "changes" in one]
    assert signals("whole").equals(signals("first"))


def test_a_run_that_ends_before_its_first_checkpoint_says_so(line5: Path, tmp_path: Path) -> None:
    def notes(until: float, every: float, **others: Any) -> list[str]:
        out = tmp_path / f"{until} {every}"
        result = simulate(line5, RunOptions(out=out, until=until, checkpoint_every=every, **others))
        assert any("no checkpoint" in one for one in result.notes) != any(out.glob("checkpoints/*/checkpoint.json"))
        return [one for one in map(str, result.notes) if "no checkpoint" in one]

    text = "no checkpoint is written: the run ends at 1 s, and would have them every {} s before its end"
    assert notes(1.0, 1.5) == [text.format("1.5")]
    assert notes(1.0, 1.0) == [text.format("1")]
    assert notes(1.0, 0.5) == []
    origin = f"{tmp_path / '1.0 0.5'}@0.5"
    assert notes(1.0, 0.4, origin=origin) == []  # at 0.8 s
    assert notes(1.0, 0.6, origin=origin) == []  # at 0.6 s
    assert notes(1.0, 2.0, origin=origin) == [text.format("2")]


def test_changes_before_a_checkpoint_are_those_that_led_to_it(line5: Path, tmp_path: Path) -> None:
    """Others would be left out, and the run would seem to have been made with them."""
    gust = [(0.5, "drone3.vehicle.wind[2]", "5")]
    first = simulate(line5, RunOptions(until=2.0, at=gust, checkpoint_every=1.0, out=tmp_path / "first"))
    origin = f"{tmp_path / 'first'}@1"
    second = simulate(
        line5, RunOptions(until=2.0, at=gust, origin=origin, checkpoint_every=0.5, out=tmp_path / "second")
    )
    third = simulate(line5, RunOptions(until=2.0, at=gust, origin=f"{tmp_path / 'second'}@1.5", out=tmp_path / "third"))
    simulate(line5, RunOptions(until=2.0, origin=origin, out=tmp_path / "fourth"))
    assert (first.outcome, second.outcome, third.outcome) == ("done", "done", "done")
    for name in ("second", "third", "fourth"):
        assert same(tmp_path / "first", tmp_path / name)
    for time, value in ((0.5, "6"), (0.25, "5")):
        with pytest.raises(SystemDescriptionError) as refused:
            simulate(line5, RunOptions(until=2.0, at=[(time, "drone3.vehicle.wind[2]", value)], origin=origin))
        assert str(refused.value) == (
            f"--at {time} drone3.vehicle.wind[2]={value}.0: it is before the checkpoint at 1 s, and has not led to it; "
            "give a later time, or an earlier checkpoint"
        )


def same(one: Path, other: Path) -> bool:
    """Whether the values are the same; how they are grouped depends on the checkpoints."""
    return all(pq.read_table(one / name).equals(pq.read_table(other / name)) for name in RECORDED[:2])


FAILS = '''
from cosim import Input, Model, Output, kernel


@kernel
def start(m):
    return 0


@kernel
def advance(m, t, h):
    m.y = m.s
    return 7 if t > 3.4 else 0


class Fails(Model):
    """Fails at 3.5 s."""

    step_size = 0.5
    variables = (Input("s", start=1.0), Input("n", type=int), Input("b", type=bool), Input("w", start=4.0), Output("y"))
    kernels = (start, advance)
    errors = {7: "it is over"}
'''


def test_a_resumed_run_that_fails_tells_the_inputs_that_were_set_before(tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text(FAILS)
    (model,) = load_models(str(tmp_path / "fails.py"))
    file = build(model, tmp_path).file
    (tmp_path / "in.csv").write_text("time,w\n0,1\n1,1\n1,8\n4,8\n")
    inputs: dict[str, Any] = {"inputs": tmp_path / "in.csv"}
    at = [(0.5, "Fails.s", "-2.5"), (1.0, "Fails.n", "3"), (3.0, "Fails.b", "true")]
    whole = simulate(file, RunOptions(out=tmp_path / "one", until=5.0, checkpoint_every=2.0, at=at, **inputs))
    said = "Fails: fmi2DoStep failed at t = 3.5 s: fmi2Error; its inputs: s = -2.5, n = 3, b = 1, w = 8"
    assert str(whole.error).splitlines()[0] == said
    rest = RunOptions(out=tmp_path / "two", origin=f"{tmp_path / 'one'}@2", at=at[2:], **inputs)
    assert str(simulate(file, rest).error) == str(whole.error)

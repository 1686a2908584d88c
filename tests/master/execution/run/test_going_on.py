"""Runs that go on from a checkpoint: with every master, with FMUs in Event Mode, and after they were killed."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.repair import repair
from cosim_master.results.storage.checkpoint_folder import sealed
from cosim_master.stepping.observation import Progress
from tests.master.fmus.clocked import clocked
from tests.master.fmus.linear import BALL_PORTS, ball
from tests.master.fmus.strict3 import ABLE

DELAYED = '<connection to="a.u" delay="0.03" start="1"/></master>'
NEARNESS = (
    '<constraint type="boundeddifference" abstol="0.05" reltol="1"><port name="a.y"/></constraint>'
    '<constraint type="zerocrossing"><port name="a.y"/><port name="b.y"/></constraint></master>'
)
MASTERS = {
    "delay and extrapolation": 'extrapolation="1">' + DELAYED,
    "gauss-seidel": 'algorithm="gauss-seidel">' + DELAYED,
    "quasi-newton": 'algorithm="quasi-newton"/>',
    "var-step": 'algorithm="var-step" maximumStep="0.1">' + NEARNESS,
    "richardson": 'algorithm="richardson" tolerance="1e-2"/>',
}


def oscillators(linears: Any, master: str, *, stop: float = 4.0) -> Path:
    linears.fmu()
    parts = linears.component("a", x0=1.0, gain=0.6, w2=4.0, step=0.01)
    parts += linears.component("b", x0=-0.5, v0=1.0, gain=0.6, w2=9.0, step=0.01)
    return Path(linears.ssd(parts, "b/y a/u", "a/y b/u", master=master, stop=stop, interval=0.05))


def resumed_as_if_never_stopped(system: Path, tmp_path: Path, **options: Any) -> None:
    """Interrupt a run behind its second checkpoint, and compare what comes of it with an uninterrupted one."""

    def interrupt(progress: Progress) -> None:
        if len(list((tmp_path / "half" / "checkpoints").glob("*/checkpoint.json"))) >= 2:
            raise KeyboardInterrupt

    assert simulate(system, RunOptions(out=tmp_path / "whole", checkpoint_every=0.5, **options)).outcome == "done"
    simulate(
        system,
        RunOptions(out=tmp_path / "half", checkpoint_every=0.5, **options),
        listener=Listener(progress=interrupt),
    )
    result = simulate(system, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'half'}@1", checkpoint_every=0.5))
    assert result.outcome == "done", result.error
    assert same(tmp_path / "whole", tmp_path / "rest")


def same(one: Path, other: Path) -> bool:
    """Whether two runs recorded the same to the last bit; where row groups end is another matter with foreign FMUs."""
    whole, rest = (pq.read_table(folder / "signals.parquet") for folder in (one, other))
    return bool(whole.equals(rest)) and len(whole) > 10


@pytest.mark.parametrize("master", list(MASTERS))
def test_every_master_goes_on_bit_for_bit(linears: Any, tmp_path: Path, master: str) -> None:
    resumed_as_if_never_stopped(oscillators(linears, MASTERS[master]), tmp_path)


@pytest.mark.parametrize("announced", [0, 1])
def test_event_mode_goes_on_bit_for_bit(
    linears: Any, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, announced: int
) -> None:
    """The next impact is no part of the FMU's state: the ball has announced it before."""
    workshop = linears.workshop
    ball(workshop, tmp_path_factory.getbasetemp())
    inner = '<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="0.1"/>'
    after = workshop.annotation("org.uav-cosim.stepping", inner)
    parts = workshop.component("ball", "ball.fmu", BALL_PORTS, workshop.bindings({"announced": announced}), after)
    resumed_as_if_never_stopped(linears.ssd(parts, stop=2.4), tmp_path)
    assert pq.read_table(tmp_path / "rest" / "signals.parquet")["ball.bounces"].to_pylist()[-1] > 5


def test_clocks_go_on_bit_for_bit(stricts3: Any, tmp_path: Path) -> None:
    """When a tunable Clock ticks next, and how often it has since it was tuned, is known to the master alone."""
    flags = f'{ABLE} canSerializeFMUState="true" hasEventMode="true"'
    clocked(stricts3, "a.fmu", "constant", "tunable", "countdown", period=0.3, shift=0.1, flags=flags)
    system = stricts3.ssd(stricts3.component("a", "a.fmu", delay=0.17), stop=6.0)
    resumed_as_if_never_stopped(system, tmp_path, at=[(0.5, "a.tunable", "0.7")])
    assert stricts3.complaints == []
    got = pq.read_table(tmp_path / "rest" / "signals.parquet")
    assert got["a.ticks_tunable"].to_pylist()[-1] > 3


def killed(system: Path, out: Path, after: str) -> None:
    """Run the command in a process of its own, and kill it when a checkpoint is there."""
    command = "from cosim_master.cli import main; main()"
    arguments = ["run", str(system), "-o", str(out), "--checkpoint-every", "0.5", "--pace", "2"]
    process = subprocess.Popen(
        [sys.executable, "-c", command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        ends = time.monotonic() + 300.0
        while not (out / "checkpoints" / after / "checkpoint.json").is_file():
            assert process.poll() is None, process.communicate()[0].decode()
            assert time.monotonic() < ends
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert process.returncode == -signal.SIGKILL


@pytest.mark.slow
def test_a_run_that_was_killed_goes_on(linears: Any, tmp_path: Path) -> None:
    """Nothing could be completed: its Parquet files have no footers."""
    system = oscillators(linears, "")
    assert simulate(system, RunOptions(out=tmp_path / "whole", checkpoint_every=0.5)).outcome == "done"
    killed(system, tmp_path / "killed", "1.5")
    assert json.loads((tmp_path / "killed" / "manifest.json").read_text())["outcome"] == "running"
    assert not (tmp_path / "killed" / "signals.parquet").exists()
    result = simulate(
        system, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'killed'}@1.5", checkpoint_every=0.5)
    )
    assert result.outcome == "done", result.error
    assert same(tmp_path / "whole", tmp_path / "rest")
    # and once more, from a run that has itself gone on
    (tmp_path / "rest" / "signals.parquet").write_bytes(b"PAR1 and no more")
    again = simulate(
        system, RunOptions(out=tmp_path / "again", origin=f"{tmp_path / 'rest'}@2.5", checkpoint_every=0.5)
    )
    assert again.outcome == "done", again.error
    assert same(tmp_path / "whole", tmp_path / "again")
    # it may be repaired before that
    shutil.copytree(tmp_path / "killed", tmp_path / "repaired")
    assert repair(tmp_path / "repaired")["outcome"] == "killed"
    shutil.rmtree(tmp_path / "repaired" / "checkpoints" / "1")
    origin = f"{tmp_path / 'repaired'}@1.5"
    third = simulate(system, RunOptions(out=tmp_path / "third", origin=origin, checkpoint_every=0.5))
    assert third.outcome == "done", third.error
    assert same(tmp_path / "whole", tmp_path / "third")
    # a checkpoint in between that is lost, is said
    shutil.rmtree(tmp_path / "killed" / "checkpoints" / "1")
    with pytest.raises(SystemDescriptionError, match=r"of \d+ row groups of signals.parquet there are \d+"):
        simulate(system, RunOptions(out=tmp_path / "never", origin=f"{tmp_path / 'killed'}@1.5"))


def test_segments_belong_to_checkpoints_only(linears: Any, tmp_path: Path) -> None:
    """Each holds what was recorded since the one before; none is left over, and none written without checkpoints."""
    system = oscillators(linears, "")
    simulate(system, RunOptions(out=tmp_path / "out", checkpoint_every=1.5))
    found = sorted(str(file.relative_to(tmp_path / "out")) for file in tmp_path.glob("out/checkpoints/**/*.parquet"))
    assert found == ["checkpoints/1.5/signals.parquet", "checkpoints/3/signals.parquet"]
    rows = pq.read_table(tmp_path / "out" / found[1])["time"].to_pylist()
    assert (rows[0], rows[-1]) == (1.55, 3.0)
    simulate(system, RunOptions(out=tmp_path / "out"))
    assert not list(tmp_path.glob("out/checkpoints/**/*.parquet"))


def shorter(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return array[:-1] if array.ndim else array


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("next_events", shorter),
        ("pending", lambda array: np.array(["text"] * array.size)),
        ("pending", lambda array: np.zeros((array.size, 1), np.int64)),
        ("states", shorter),
        ("state_sizes", lambda array: array.astype(np.float64)),
        ("blocks", lambda array: np.array([2**62, 1])),
        ("radio.endpoints", lambda _: np.array(["text"])),
        ("radio.data", shorter),
        ("radio.counters", shorter),
        ("real_out", shorter),
        ("real_out", lambda array: array.astype(np.int64)),
    ],
)
def test_an_array_of_another_kind_is_refused(
    linears: Any, tmp_path: Path, name: str, damage: Callable[[Any], Any]
) -> None:
    """Also if the digest of the file is the right one: nothing but the arrays of this run reaches the compiled loop."""
    system = oscillators(linears, MASTERS["gauss-seidel"], stop=1.0)
    simulate(system, RunOptions(out=tmp_path / "run", checkpoint_every=0.5))
    own = tmp_path / "run" / "checkpoints" / "0.5"
    with np.load(own / "state.npz") as file:
        arrays = {key: file[key] for key in file.files}
    arrays[name] = damage(arrays[name])
    np.savez(own / "state.npz", **arrays)
    content = json.loads((own / "checkpoint.json").read_text())
    del content["digest"], content["files"]
    (own / "checkpoint.json").unlink()
    (own / "checkpoint.json").write_text(json.dumps(sealed(own, content)))
    with pytest.raises(SystemDescriptionError, match="the checkpoint is damaged: "):
        simulate(system, RunOptions(origin=f"{tmp_path / 'run'}@0.5", out=tmp_path / "rest"))


def test_an_archive_that_does_not_unpack_is_refused(linears: Any, tmp_path: Path) -> None:
    system = oscillators(linears, MASTERS["gauss-seidel"], stop=1.0)
    simulate(system, RunOptions(out=tmp_path / "run", checkpoint_every=0.5))
    own = tmp_path / "run" / "checkpoints" / "0.5"
    data = bytearray((own / "state.npz").read_bytes())
    with zipfile.ZipFile(own / "state.npz") as archive:
        info = archive.infolist()[0]
    begin = info.header_offset + 30 + len(info.filename)
    begin += int.from_bytes(data[info.header_offset + 28 : info.header_offset + 30], "little")
    data[begin : begin + info.compress_size] = b"\xff" * info.compress_size
    (own / "state.npz").write_bytes(data)
    content = json.loads((own / "checkpoint.json").read_text())
    del content["digest"], content["files"]
    (own / "checkpoint.json").unlink()
    (own / "checkpoint.json").write_text(json.dumps(sealed(own, content)))
    with pytest.raises(SystemDescriptionError, match=r"the checkpoint is damaged: .*decompressing"):
        simulate(system, RunOptions(origin=f"{tmp_path / 'run'}@0.5", out=tmp_path / "rest"))

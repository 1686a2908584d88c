"""The recording of a run that goes on or was killed: read at any moment, cut anywhere, and completed by `repair`."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.cli.views.overview import overview
from cosim_master.diagnostics.errors import CosimError, SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.reading.read import packets, signals
from cosim_master.results.repair import repair
from cosim_master.results.storage.journal import goes_on, groups_of, read_journal
from cosim_master.results.storage.manifest_file import UNWRITTEN
from cosim_master.results.storage.parquet import packets_schema
from cosim_master.results.storage.run_folder import RunFolder
from cosim_master.stepping.observation import Seen, View
from tests.master import processes
from tests.master.cli.test_command_line import is_as_documented
from tests.master.fmus.probe import slave
from tests.master.full_disk import room_of

ROOT = Path(__file__).parents[3]


class Broken(Exception):
    """What ends the runs of these tests."""


def broken_off(system: Path, out: Path, at: float = 1.0) -> Path:
    """Leaves a run as a process leaves it that was killed at a time, but for what is lost then."""

    class Breaking:
        def __init__(self, view: View) -> None:
            self.every = view.steps(at)

        def initialised(self, seen: Seen) -> None: ...
        def stepped(self, seen: Seen) -> None:
            raise Broken

        def closed(self) -> None: ...

    with pytest.raises(Broken):
        simulate(system, RunOptions(out=out), observers=[Breaking])
    return out


@pytest.fixture
def killed(probes: Any, tmp_path: Path) -> Path:
    """Two instances with a signal of each type, of which 3 of 5 rows have been recorded."""
    probes.fmu()
    parts = probes.component("a", u=1.0, p=2.0, n=41, s="hü") + probes.component("b", b=True)
    return broken_off(probes.ssd(parts, "a/y b/u"), tmp_path / "out")


ROWS = {
    "time": [0.0, 0.5, 1.0],
    "a.y": [3.0] * 3,
    "a.m": [42] * 3,
    "a.c": [True] * 3,
    "a.r": ["hü!"] * 3,
    "a.f": [1] * 3,
    "b.y": [3.25] * 3,
    "b.m": [1] * 3,
    "b.c": [False] * 3,
    "b.r": ["!"] * 3,
    "b.f": [1] * 3,
}


def test_signals_of_all_types_are_read_before_and_after_the_repair(killed: Path) -> None:
    before = signals(killed)
    assert before.to_pydict() == ROWS
    assert before.schema.field("a.y").metadata == {b"unit": b"m", b"description": b""}
    assert json.loads(before.schema.field("a.f").metadata[b"items"]) == {"low": 1, "high": 5}
    assert signals(killed, ["time", "b.y"]).to_pydict() == {name: ROWS[name] for name in ("time", "b.y")}
    repair(killed)
    after = pq.read_table(killed / "signals.parquet")
    assert after.equals(before, check_metadata=True)


def test_integers_of_64_bits(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    system = stricts3.ssd(stricts3.component("a"), stop=2.0)
    assert simulate(system, RunOptions(out=tmp_path / "whole")).outcome == "done"
    whole = pq.read_table(tmp_path / "whole" / "signals.parquet")
    assert {"uint32", "int64", "uint64"} <= {str(field.type) for field in whole.schema}
    cut = signals(broken_off(system, tmp_path / "cut"))
    assert 0 < cut.num_rows < whole.num_rows
    assert cut.equals(whole.slice(0, cut.num_rows), check_metadata=True)


def test_plain_pyarrow_reads_it(killed: Path) -> None:
    """As docs/reliability.md says."""
    text = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    recipe = text.split("```python\n")[1].split("```")[0]
    space: dict[str, Any] = {}
    exec(recipe.replace("out/line5", str(killed)).replace("drone1.vehicle.position[1]", "b.y"), space)
    assert space["time"].to_pylist() == [0.0, 0.5, 1.0]
    assert space["values"].to_pylist() == [3.25] * 3


def test_the_verbs_read_it(killed: Path) -> None:
    def run(*arguments: str) -> Any:
        done = CliRunner().invoke(app, [*arguments])
        assert done.exit_code in (0, 1), done.output
        return done.stdout

    document = json.loads(run("info", str(killed), "--json"))
    assert (document["outcome"], document["rows"], len(document["signals"])) == ("running", 3, 11)
    assert document["error"] == "the process was killed; `uav-cosim repair` completes the recording"
    assert run("export", str(killed), "-o", "-").splitlines()[1].startswith("0.0,3.0,42,1,")
    compared = json.loads(run("compare", str(killed), str(killed), "--json"))
    assert (compared["equal"], compared["times"]["common"]) == (True, 3)
    repaired = json.loads(run("repair", str(killed), "--json"))
    assert is_as_documented("repair", repaired), repaired
    assert (repaired["outcome"], repaired["simulated_s"]) == ("killed", 1.0)
    assert "killed, 1 s simulated" in run("repair", str(killed))


def test_cut_anywhere_the_rows_before_are_read(probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row group of 16 rows and one of 5; of the last batch only a part, or zeros behind it."""
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_BYTES", 1)
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_ROWS", 1)
    probes.fmu(step=0.1)
    out = broken_off(probes.ssd(probes.component("a", u=1.0), stop=9.0), tmp_path / "out", 2.0)
    journal = out / "unfinished" / "signals.arrows"
    content = journal.read_bytes()
    whole = read_journal(journal)
    assert [group.num_rows for group in groups_of(journal)] == [16, 5]
    read = []
    for end in range(0, len(content), 8):
        journal.write_bytes(content[:end])
        try:
            table = read_journal(journal)
        except CosimError as error:
            assert "nothing was recorded before the process was ended" in str(error)
            assert read == []  # only as long as not even the columns are there
            continue
        assert table.equals(whole.slice(0, table.num_rows))
        read.append(table.num_rows)
    assert sorted(read) == read
    assert set(read) == {0, 16, 21}  # all where only the mark behind them is cut
    journal.write_bytes(content + bytes(4096))
    assert read_journal(journal).equals(whole)


# ---- who may write there ---------------------------------------------------------------------------------------------


def test_a_run_that_goes_on_is_left_alone(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    system, out = probes.ssd(probes.component("a")), tmp_path / "out"
    seen = []

    class Meddling:
        def __init__(self, view: View) -> None:
            self.every = view.steps(1.0)

        def initialised(self, seen: Seen) -> None: ...
        def closed(self) -> None: ...
        def stepped(self, _: Seen) -> None:
            assert goes_on(out)
            for meddle in (lambda: simulate(system, RunOptions(out=out)), lambda: repair(out), choose):
                with pytest.raises(SystemDescriptionError) as caught:
                    meddle()
                seen.append(str(caught.value).removeprefix(f"{out}: "))

    def choose() -> None:
        RunFolder(out, force=True).choose({"seed": "1"})

    assert simulate(system, RunOptions(out=out), observers=[Meddling]).outcome == "done"
    assert seen[:3] == [
        "another run is being recorded there; give another folder",
        "the run goes on; end it with Ctrl-C or SIGTERM",
        "holds a run that goes on; give another folder",
    ]
    assert not goes_on(out)
    assert signals(out)["time"].to_pylist() == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_the_same_run_does_not_replace_one_that_was_killed(killed: Path) -> None:
    """Its checkpoints and rows may be all that there is."""
    inputs = json.loads((killed / "manifest.json").read_text())["fingerprint"]
    with pytest.raises(SystemDescriptionError) as caught:
        RunFolder(killed).choose(inputs)
    text = "holds a run whose process was killed, which `uav-cosim repair` completes; "
    assert str(caught.value) == f"{killed}: {text}give another folder, or --force to overwrite it"
    assert RunFolder(killed, numbered=True).choose(inputs) == killed.with_name("out-2")
    assert RunFolder(killed, force=True).choose(inputs) == killed
    repair(killed)
    assert RunFolder(killed).choose(inputs) == killed


# ---- repair ----------------------------------------------------------------------------------------------------------


def test_what_is_complete_stays_as_it_is(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    out = tmp_path / "out"
    simulate(probes.ssd(probes.component("a")), RunOptions(out=out))
    before = {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in out.rglob("*") if file.is_file()}
    assert repair(out)["outcome"] == "done"
    assert {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in out.rglob("*") if file.is_file()} == before


@pytest.mark.parametrize("left", [b"PAR1", None])
def test_files_that_have_been_damaged_since_are_not_called_complete(
    probes: Any, tmp_path: Path, left: bytes | None
) -> None:
    probes.fmu()
    out = tmp_path / "out"
    simulate(probes.ssd(probes.component("a")), RunOptions(out=out))
    (out / "signals.parquet").unlink()
    if left is not None:
        (out / "signals.parquet").write_bytes(left)
    with pytest.raises(SystemDescriptionError, match=r"nothing is left to complete .*signals\.parquet"):
        repair(out)


def journal_of_packets(folder: Path, names: list[str], outcome: pa.Array) -> Path:
    """A journal of packets with these columns and these texts in the last one."""
    columns = [pa.array([0] * len(outcome), field.type) for field in packets_schema() if field.type != pa.string()]
    texts = iter([pa.array(["x"] * len(outcome))] * 2 + [outcome])
    arrays = [next(texts) if field.type == pa.string() else columns.pop(0) for field in packets_schema()]
    folder.mkdir(parents=True)
    batch = pa.RecordBatch.from_arrays(arrays, names=names)
    with pa.OSFile(str(folder / "packets.arrows"), "wb") as file, pa.ipc.new_stream(file, batch.schema) as stream:
        stream.write(batch)
    return folder / "packets.arrows"


NAMES = packets_schema().names


@pytest.mark.parametrize(
    ("names", "offsets", "characters", "told"),
    [
        (NAMES, [0, 1 << 30, 9], b"delivered", "the rows of the journal are damaged: In column 9: "),  # read beyond it
        (NAMES, [0, 9, 4], b"delivered", "the rows of the journal are damaged: In column 9: "),
        (NAMES, [0, 4, 9], b"lost\xe7ived", "the rows of the journal are damaged: In column 9: Invalid: Invalid UTF8"),
        (
            [*NAMES[:-1], "outcxme"],
            [0, 4, 9],
            b"lost    d",
            "the columns of the journal are damaged: there is no column",
        ),
    ],
)
def test_a_journal_that_is_damaged_is_refused(
    tmp_path: Path, names: list[str], offsets: list[int], characters: bytes, told: str
) -> None:
    buffers = [None, pa.py_buffer(np.array(offsets, np.int32).tobytes()), pa.py_buffer(characters)]
    file = journal_of_packets(tmp_path / "unfinished", names, pa.Array.from_buffers(pa.string(), 2, buffers))
    for read in (lambda: read_journal(file), lambda: packets(tmp_path)):
        with pytest.raises(SystemDescriptionError) as caught:
            read()
        assert str(caught.value).startswith(f"{file}: {told}")


def test_the_columns_of_a_journal_have_places(killed: Path) -> None:
    file = killed / "unfinished" / "signals.arrows"
    assert read_journal(file).num_columns > 2
    file.write_bytes(file.read_bytes().replace(b"[0, ", b"[   ", 1))
    with pytest.raises(SystemDescriptionError, match=r"signals\.arrows: the columns of the journal are damaged: "):
        read_journal(file)


def test_a_repair_that_is_killed_is_repeated(killed: Path) -> None:
    """Wherever it was: signals are complete already, or a part of them is there."""
    again = shutil.copytree(killed, killed.with_name("again"))
    repair(killed)
    shutil.copy(killed / "signals.parquet", again / "signals.parquet")
    (again / "unfinished" / "packets.parquet").write_bytes(b"PAR1")
    assert signals(again).to_pydict() == ROWS
    assert repair(again)["outcome"] == "killed"
    assert signals(again).to_pydict() == ROWS
    assert not (again / "unfinished").exists()


@pytest.mark.parametrize(
    ("manifest", "message"),
    [
        (None, "not the folder of a run: it has no manifest.json"),
        ("[1]", "manifest.json is not the manifest of a run: "),
        ('{"outcome": "running"', "manifest.json is not the manifest of a run: "),
        ('{"outcome": "running", "simulated_s": "long"}', "manifest.json is not the manifest of a run: "),
    ],
)
def test_what_is_no_run_is_not_repaired(tmp_path: Path, manifest: str | None, message: str) -> None:
    if manifest is not None:
        (tmp_path / "manifest.json").write_text(manifest)
    with pytest.raises(SystemDescriptionError) as caught:
        repair(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path}: {message}")


def test_logs_end_with_a_complete_packet(killed: Path) -> None:
    """MAVLink 1 of 3 bytes, MAVLink 2 of 5, and a signed one of 0; then a part of one, whose length is known or not."""
    stamp = bytes(8)
    one, two, signed = bytes([0xFE, 3, *[0] * 9]), bytes([0xFD, 5, *[0] * 15]), bytes([0xFD, 0, 1, *[0] * 22])
    whole = b"".join(stamp + packet for packet in (one, two, signed))
    (killed / "packets").mkdir()
    for name, tail in (("a", b""), ("b", stamp), ("c", stamp + two[:-1]), ("d", (stamp + signed)[:-1]), ("e", b"1")):
        (killed / "packets" / f"{name}.tlog").write_bytes(whole + tail)
    strange = whole + stamp + b"what is this? not MAVLink"
    (killed / "packets.tlog").write_bytes(strange)
    repair(killed)
    assert [file.read_bytes() for file in sorted((killed / "packets").iterdir())] == [whole] * 5
    assert (killed / "packets.tlog").read_bytes() == strange


# ---- disks that are full ---------------------------------------------------------------------------------------------

COMMAND = [sys.executable, "-c", "from cosim_master.cli import main; main()", "run", "--isolate", "none"]


def test_a_limit_of_file_sizes(probes: Any, tmp_path: Path) -> None:
    """The journal, which is not compressed, reaches the limit first; the run ends, and its files are completed."""
    probes.fmu(step=0.001)
    system, out = probes.ssd(probes.component("a", u=1.0), stop=1e6), tmp_path / "out"
    assert simulate(system, RunOptions(until=0.01)).outcome == "done"  # everything is compiled
    with room_of(30_000):
        result = simulate(system, RunOptions(out=out, pace=1e5))
    assert result.outcome == "failed"
    text = f"{out}/unfinished/signals.arrows: cannot be written: File too large; "
    assert str(result.error) == text + "what was recorded until then stays readable"
    manifest = json.loads((out / "manifest.json").read_text())
    times = pq.read_table(out / "signals.parquet")["time"].to_pylist()
    assert (manifest["outcome"], manifest["simulated_s"]) == ("failed", times[-1])
    assert times == [k / 1000 for k in range(len(times))] and len(times) > 100
    assert not (out / "unfinished").exists()


class Full:
    """A Parquet writer on a disk that is full after so many tables."""

    def __init__(self, writer: Any, room: int, *, footer: bool) -> None:
        self._writer, self._room, self._footer = writer, room, footer

    def write_table(self, table: pa.Table) -> None:
        self._room -= 1
        if self._room < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._writer.write_table(table)

    def close(self) -> None:
        self._writer.close()
        if not self._footer:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(("room", "footer"), [(0, True), (2, True), (99, False)])
def test_a_disk_that_is_full(
    probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int, *, footer: bool
) -> None:
    """In the first row group, in the third, or only when the file is completed: every row is there.

    Other threads write a row group while the run goes on, so it ends at the earliest after the next block of rows.
    """
    from cosim_master.results.recording import recording
    from cosim_master.results.storage.parquet import signals_writer

    monkeypatch.setattr("cosim_master.stepping.plan._BLOCK_BYTES", 1)
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_BYTES", 1)
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_ROWS", 1)
    probes.fmu(step=0.01)
    system, out = probes.ssd(probes.component("a", u=1.0), stop=1.0), tmp_path / "out"
    with monkeypatch.context() as full:
        full.setattr(recording, "signals_writer", lambda *of: Full(signals_writer(*of), room, footer=footer))
        result = simulate(system, RunOptions(out=out))
    assert result.outcome == "failed"
    text = f"{out}/unfinished/signals.parquet: cannot be written: No space left on device; "
    assert str(result.error) == text + "what was recorded until then stays readable"
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["error"]) == ("failed", str(result.error))
    times = signals(out)["time"].to_pylist()
    assert times == [k / 100 for k in range(len(times))] and times[-1] == manifest["simulated_s"]
    assert {0: 16, 2: 48, 99: 101}[room] <= len(times) <= 101
    repaired = repair(out)  # there is room again
    assert (repaired["outcome"], repaired["error"]) == ("failed", str(result.error))
    assert pq.read_table(out / "signals.parquet")["time"].to_pylist() == times


def test_no_room_for_the_manifest(probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The one of the beginning is there: it is given the outcome in place."""
    from cosim_master.results.recording import recording

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    probes.fmu()
    monkeypatch.setattr(recording, "write_manifest", full)
    result = simulate(probes.ssd(probes.component("a")), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    assert "manifest.json: cannot be written: No space left on device" in str(result.error)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["simulated_s"], manifest["error"]) == ("failed", 2.0, None)
    assert overview(tmp_path / "out")["error"] == UNWRITTEN
    (tmp_path / "out" / "unfinished").mkdir()  # as if there had been no room for the signals either
    assert overview(tmp_path / "out")["error"] == f"{UNWRITTEN}; `uav-cosim repair` completes them"
    monkeypatch.undo()
    assert repair(tmp_path / "out")["error"] == UNWRITTEN
    assert signals(tmp_path / "out")["time"].to_pylist() == [0.0, 0.5, 1.0, 1.5, 2.0]


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_signals_end_a_run_as_ctrl_c_does(probes: Any, tmp_path: Path, name: str) -> None:
    """The first observer's look sends it; afterwards whoever handled it before handles it again."""
    number = signal.Signals[name]
    outside = signal.signal(number, signal.SIG_DFL)  # which `nohup make test` ignores

    class Sending:
        def __init__(self, view: View) -> None:
            self.every = view.steps(1.0)

        def initialised(self, seen: Seen) -> None: ...
        def closed(self) -> None: ...
        def stepped(self, _: Seen) -> None:
            os.kill(os.getpid(), number)

    probes.fmu()
    try:
        result = simulate(
            probes.ssd(probes.component("a"), stop=1e6), RunOptions(out=tmp_path / "out"), observers=[Sending]
        )
        after = signal.getsignal(number)
    finally:
        signal.signal(number, outside)
    assert (result.outcome, result.error, after) == ("interrupted", None, signal.SIG_DFL)
    times = signals(tmp_path / "out")["time"].to_pylist()
    assert times == [k / 2 for k in range(len(times))]
    assert times[-1] == result.simulated_s >= 1.0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["simulated_s"]) == ("interrupted", times[-1])
    assert probes.calls[-2:] == ["a: terminate", "a: free"]


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_signal_that_is_ignored_stays_ignored(probes: Any, tmp_path: Path) -> None:
    """As by nohup."""
    probes.fmu()
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        result = simulate(
            probes.ssd(probes.component("a")),
            RunOptions(out=tmp_path / "out"),
            listener=Listener(progress=lambda _: os.kill(os.getpid(), signal.SIGHUP)),
        )
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert result.outcome == "done"


@pytest.mark.skipif(sys.platform != "linux", reason="sysv_signal of glibc")
def test_an_fmu_that_hangs_is_ended_by_the_second_signal(probes: Any, tmp_path: Path) -> None:
    """A thread names it, and completes the recording."""
    probes.fmu(step=0.01)
    system = probes.ssd(probes.component("a", mode=16, when=1.2), stop=9.0)
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}
    running = subprocess.Popen(
        [*COMMAND, str(system), "-o", "out", "--pace", "1", "--step-timeout", "0.5"],
        cwd=tmp_path,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    log = tmp_path / "calls.txt"
    while running.poll() is None and not (log.exists() and "step 1.2 " in log.read_text()):
        time.sleep(0.05)
    assert running.stderr is not None
    said = "a: fmi2DoStep failed at t = 1.2 s: probe.fmu has not returned; this step takes "
    assert any(line.startswith(f"note: {said}") for line in running.stderr)  # reads until it is said
    for _ in range(2):
        time.sleep(0.5)
        processes.signalled(running, signal.SIGTERM)
    _, errors = running.communicate(timeout=300)
    assert running.returncode == -signal.SIGTERM
    assert f"error: {said}" in errors
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["outcome"] == "failed" and manifest["error"].startswith(said)
    assert signals(tmp_path / "out")["time"].to_pylist() == [k / 100 for k in range(121)]


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_signal_to_the_process_and_its_group_ends_a_run_as_ctrl_c_does(probes: Any, tmp_path: Path) -> None:
    """timeout(1) sends it to both, one after the other."""
    probes.fmu(step=0.01)
    system = probes.ssd(probes.component("a"), stop=1e6)
    command = [*COMMAND, str(system), "-o", "out", "--pace", "1"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as running:
        log = tmp_path / "calls.txt"
        while running.poll() is None and not (log.exists() and "step 1 " in log.read_text()):
            time.sleep(0.05)
        for send in (os.kill, os.killpg):
            send(running.pid, signal.SIGTERM)
        said, errors = running.communicate(timeout=300)
    assert running.returncode == 130, errors
    assert said.startswith("interrupted: ")
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "interrupted"


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_signal_while_an_interrupted_command_ends_changes_nothing(probes: Any, tmp_path: Path) -> None:
    probes.fmu(step=0.01)
    system = probes.ssd(probes.component("a"), stop=1e6)
    program = "import atexit, os, signal\nfrom cosim_master.cli import main\n"
    program += "atexit.register(os.kill, os.getpid(), signal.SIGTERM)\nmain()\n"
    command = [sys.executable, "-c", program, "run", "--isolate", "none", str(system), "-o", "out", "--pace", "1"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True) as running:
        log = tmp_path / "calls.txt"
        while running.poll() is None and not (log.exists() and "step 1 " in log.read_text()):
            time.sleep(0.05)
        running.send_signal(signal.SIGTERM)
        _, errors = running.communicate(timeout=300)
    assert running.returncode == 130, errors


@pytest.mark.skipif(sys.platform != "linux", reason="processes of FMUs")
def test_an_isolated_fmu_that_hangs_is_ended_by_the_second_signal(probes: Any, tmp_path: Path) -> None:
    """The run fails as if its process had crashed: nothing is lost, and the exit code is that of a failure."""
    probes.fmu(step=0.01)
    system = probes.ssd(probes.component("a", mode=16, when=1.2), stop=9.0)
    command = [*COMMAND[:-2], "--step-timeout", "0", str(system), "-o", "out", "--pace", "10"]
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}
    running = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    manifest = tmp_path / "out" / "manifest.json"

    # The process of the FMU is in sleep(), where the probe hangs.
    while running.poll() is None and not any(map(processes.sleeps, processes.children(running.pid))):
        time.sleep(0.05)
    for _ in range(2):
        time.sleep(0.5)
        processes.signalled(running, signal.SIGTERM)
    _, errors = running.communicate(timeout=300)
    assert running.returncode == 1, errors
    assert "error: a: fmi2DoStep failed at t = 1.2 s: its process was ended by signal 9 (SIGKILL)" in errors
    assert json.loads(manifest.read_text())["outcome"] == "failed"
    assert signals(tmp_path / "out")["time"].to_pylist() == [k / 100 for k in range(121)]


def test_an_fmu_that_ends_the_process(tmp_path: Path, probes: Any) -> None:
    """With code 0, as if all were well: the manifest says that it is not, and the rows before are there."""
    source = """
    import os, time
    from pathlib import Path
    from cosim_master.results.storage.journal import read_journal
    from pythonfmu import Fmi2Causality, Fmi2Slave, Real

    class Ending(Fmi2Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.y = 0.0
            self.register_variable(Real("y", causality=Fmi2Causality.output))

        def do_step(self, t, h):
            if t == 2.0:
                time.sleep(0.6)  # longer than the run keeps rows to itself
            if t == 3.0:
                for _ in range(12_000):
                    if read_journal(Path("out/unfinished/signals.arrows")).num_rows >= 6:
                        break
                    time.sleep(0.01)
                os._exit(0)
            return True
    """
    slave(tmp_path, "ending_slave.py", textwrap.dedent(source))
    system = probes.ssd(probes.workshop.component("a", "Ending.fmu", "y:output", after=probes.step(0.5)), stop=9.0)
    done = subprocess.run([*COMMAND, str(system), "-o", "out", "--pace", "100"], cwd=tmp_path, check=False)
    assert done.returncode == 0
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "running"
    assert signals(tmp_path / "out")["time"].to_pylist()[:6] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
    assert repair(tmp_path / "out")["outcome"] == "killed"

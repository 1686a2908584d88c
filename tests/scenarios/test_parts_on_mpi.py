"""Runs in parts by Open MPI, with parts that are killed, stopped or interrupted: what is said, and what is kept."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.partitions.cut import read_assignment
from cosim_master.execution.partitions.mpi import _SIZES, launched_by
from tests.master.terminal import COMMAND
from tests.scenarios.flights import SYSTEMS, fly
from tests.scenarios.swarm import running as listening
from tests.scenarios.test_pymavlink_flies import PACE, Client
from tests.scenarios.test_run_in_parts import same

pytest.importorskip("mpi4py")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (Path(sys.executable).parent / "mpirun").exists(), reason="no mpirun is installed here"),
]

LIMIT = 600.0
"""Seconds for anything; a busy machine compiles for minutes."""


class Parts:
    """A running `uav-cosim run --partitions`."""

    def __init__(self, process: subprocess.Popen[str], out: Path) -> None:
        self.process, self.out = process, out

    def rank(self, number: int) -> int:
        """The process id of a part, once it runs."""
        end = time.monotonic() + LIMIT
        wanted = f"OMPI_COMM_WORLD_RANK={number}".encode()
        while time.monotonic() < end and self.process.poll() is None:
            for folder in Path("/proc").glob("[0-9]*"):
                try:
                    environment = (folder / "environ").read_bytes().split(b"\0")
                except OSError:
                    continue
                if wanted in environment and f"PARTS_OF_TEST={self.out}".encode() in environment:
                    return int(folder.name)
            time.sleep(0.1)
        raise AssertionError(self.process.communicate())

    def flies(self, seconds: float = 0.5) -> None:
        """Waits until so many seconds are simulated and recorded."""
        end = time.monotonic() + LIMIT
        while time.monotonic() < end and self.process.poll() is None:
            try:
                if json.loads((self.out / "manifest.json").read_text())["simulated_s"] >= seconds:
                    return
            except (OSError, ValueError, KeyError):
                pass
            time.sleep(0.1)
        raise AssertionError(self.process.communicate())

    def end(self) -> tuple[int, str, dict[str, Any]]:
        """The exit code, the error output and the manifest, when it has ended."""
        _, error = self.process.communicate(timeout=LIMIT)
        return self.process.returncode, error, json.loads((self.out / "manifest.json").read_text())


@contextmanager
def running(
    out: Path, *options: str, parts: int = 3, system: str = "line5", temporary: Path | None = None
) -> Iterator[Parts]:
    hup = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL); "  # tests may be run under nohup
    command = [sys.executable, "-c", f"{hup}from cosim_master.cli import main; main()", "run", str(SYSTEMS / system)]
    command += ["-o", str(out), "--partitions", str(parts), *options]
    environment = {**os.environ, "PARTS_OF_TEST": str(out)}
    if temporary is not None:
        environment["TMPDIR"] = str(temporary)
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    found = Parts(process, out)
    try:
        yield found
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            try:
                process.communicate(timeout=60)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


def complete(out: Path, manifest: dict[str, Any]) -> None:
    """Everything that the manifest says is simulated is recorded, and the files are complete."""
    rows = pq.read_table(out / "signals.parquet")["time"].to_pylist()
    assert rows[0] == 0.0
    assert manifest["simulated_s"] - 0.0125 < rows[-1] <= manifest["simulated_s"]
    assert len(rows) == round(rows[-1] / 0.0125) + 1
    assert max(pq.read_table(out / "packets.parquet")["sent"].to_pylist()) <= manifest["simulated_s"]
    assert not (out / "unfinished").exists()


@pytest.fixture(scope="module")
def whole(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 4 s of line5 in one process: messages of all kinds are sent, and motors are armed."""
    return fly(SYSTEMS / "line5", tmp_path_factory.mktemp("whole") / "out", until=4.0).folder


def test_the_same_bits(whole: Path, tmp_path: Path) -> None:
    with running(tmp_path / "parts", "--until", "4", parts=2) as parts:
        code, error, manifest = parts.end()
    assert code == 0, error
    same(whole, tmp_path / "parts")
    assert [one["part"] for one in manifest["parts"]] == [0, 1]
    assert all(one["host"] == os.uname().nodename for one in manifest["parts"])


def test_killed_runs_with_the_same_process_id_have_left_files(fmus: Path, tmp_path: Path) -> None:
    """As in containers, whose process ids begin anew: Open MPI does not start where it finds its own file."""
    temporary = tmp_path / "temporary"
    last = int(subprocess.run(["sh", "-c", "echo $$"], capture_output=True, text=True, check=True).stdout)
    temporary.mkdir()
    (tmp_path / "file").write_text("left\n")
    for number in range(last, last + 3000):
        (folder := temporary / f"ompi.{number}").mkdir(mode=0o700)
        os.link(tmp_path / "file", folder / f"pmix.{os.uname().nodename}.tool.{number}")  # in a tenth of a file's time
    stale = sorted(temporary.iterdir())
    with running(tmp_path / "parts", "--until", "0.1", parts=2, temporary=temporary) as parts:
        code, error, _ = parts.end()
    assert code == 0, error
    assert sorted(temporary.glob("ompi.*")) == stale
    assert not list(temporary.glob("uav-cosim-*"))


def test_processes_that_srun_has_started(fmus: Path, tmp_path: Path) -> None:
    """srun with PMIx, as far as a process can see it: the variables of SLURM instead of those of mpirun."""
    python = [sys.executable, "-c", "from cosim_master.cli import main; main()"]
    hidden = [option for name in os.environ | {"OMPI_COMM_WORLD_SIZE": ""} if name in _SIZES for option in ("-u", name)]
    command = ["env", *hidden, "SLURM_STEP_NUM_TASKS=2", *python, "run", str(SYSTEMS / "line5"), "--until", "0.5"]
    launcher = [str(Path(sys.executable).with_name("mpirun")), "-n", "2", "--host", "localhost:2", "--bind-to", "none"]
    environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    environment["TMPDIR"] = str(tmp_path)
    started = [*launcher, *command, "-o", str(tmp_path / "out")]
    done = subprocess.run(started, capture_output=True, text=True, env=environment, check=False, timeout=LIMIT)
    assert done.returncode == 0, done.stderr
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert [one["part"] for one in manifest["parts"]] == [0, 1]


MPICH = Path("/usr/lib/x86_64-linux-gnu/libmpich.so.12")
"""The library of Debian's package mpich."""


@pytest.mark.skipif(not (MPICH.exists() and shutil.which("mpiexec.mpich")), reason="no mpich is installed here")
def test_mpich_gives_the_same_bits(whole: Path, tmp_path: Path) -> None:
    """mpi4py looks for MPICH's library by the name libmpi.so.12, which Debian's does not have."""
    (tmp_path / "lib").mkdir()
    library = tmp_path / "lib" / "libmpi.so.12"
    library.symlink_to(MPICH)
    environment = {**os.environ, "MPI4PY_LIBMPI": str(library), "LD_LIBRARY_PATH": str(library.parent)}
    python = [sys.executable, "-c", "from cosim_master.cli import main; main()"]
    command = ["mpiexec.mpich", "-n", "2", *python, "run", str(SYSTEMS / "line5"), "--until", "4"]
    command += ["-o", str(tmp_path / "parts")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=LIMIT)
    assert done.returncode == 0, done.stderr
    same(whole, tmp_path / "parts")
    manifest = json.loads((tmp_path / "parts" / "manifest.json").read_text())
    assert [one["part"] for one in manifest["parts"]] == [0, 1]


def test_a_library_that_is_not_the_launchers_is_refused(tmp_path: Path) -> None:
    """As with `srun --mpi=pmi2` and Open MPI: each process would run the whole system, alone."""
    python = [sys.executable, "-c", "from cosim_master.cli import main; main()"]
    hidden = [option for name in _SIZES for option in ("-u", name)]
    command = ["env", *hidden, "PMI_SIZE=2", *python, "run", str(SYSTEMS / "line5"), "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT)
    assert done.returncode == 2
    assert "the launcher has started 2 processes, but Open MPI v5" in done.stderr
    assert "sees one: it is not the launcher's MPI library; name that one by MPI4PY_LIBMPI" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("environment", "processes"),
    [
        ({}, 1),
        ({"OMPI_COMM_WORLD_SIZE": "4"}, 4),
        ({"PMI_SIZE": "8", "PMI_RANK": "3"}, 8),
        ({"PMIX_RANK": "0", "SLURM_STEP_NUM_TASKS": "16"}, 16),
        ({"SLURM_STEP_NUM_TASKS": "16", "SLURM_PROCID": "1"}, 1),
    ],
    ids=["none", "Open MPI", "MPICH, or srun --mpi=pmi2", "srun --mpi=pmix", "srun --mpi=none"],
)
def test_launchers_are_recognised(environment: dict[str, str], processes: int) -> None:
    assert launched_by(environment) == processes


@pytest.mark.alone
@pytest.mark.parametrize(("rank", "of"), [(1, 2), (2, 3)])
def test_a_part_is_killed(fmus: Path, tmp_path: Path, rank: int, of: int) -> None:
    """With two parts, mpirun says that all is well if part 0 ends after it."""
    with running(tmp_path / "out", "--pace", "1", parts=of, system="line5-points") as parts:
        parts.flies()
        os.kill(parts.rank(rank), signal.SIGKILL)
        code, error, manifest = parts.end()
    assert code == 1
    assert f"part {rank}: its process has ended; what was recorded until then is complete" in error
    assert manifest["outcome"] == "failed"
    complete(tmp_path / "out", manifest)


@pytest.mark.alone
@pytest.mark.parametrize(("who", "of"), [("part 0", 2), ("part 0", 3), ("mpirun", 2)])
def test_nothing_is_left_to_say_how_it_ended(fmus: Path, tmp_path: Path, who: str, of: int) -> None:
    out = tmp_path / "out"
    with running(out, "--pace", "1", parts=of, system="line5-points") as parts:
        parts.flies()
        first, last = parts.rank(0), parts.rank(of - 1)
        launcher = int(Path(f"/proc/{parts.process.pid}/task/{parts.process.pid}/children").read_text())
        os.kill(first if who == "part 0" else launcher, signal.SIGKILL)
        code, error, manifest = parts.end()
    assert code == 1
    ended = "with exit code [0-9]+" if who == "part 0" else "by signal 9"
    text = rf"error: part 0 has ended without a result \(mpirun {ended}\); if it has recorded, try uav-cosim repair RUN"
    assert re.search(text, error), error
    assert ("MPI_ABORT was invoked on rank" in error) == (who == "part 0"), error  # the others do not wait in MPI's end
    assert manifest["outcome"] == "running"
    end = time.monotonic() + LIMIT
    while any(Path(f"/proc/{one}").exists() for one in (first, last)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{last}").exists()
    assert CliRunner().invoke(app, ["repair", str(out)]).exit_code == 0


@pytest.mark.alone
def test_a_part_is_stopped(fmus: Path, tmp_path: Path) -> None:
    with running(tmp_path / "out", "--pace", "1", "--partition-timeout", "8") as parts:
        parts.flies()
        stopped = parts.rank(2)  # part 0 waits for part 1, which waits for this one
        os.kill(stopped, signal.SIGSTOP)
        code, error, manifest = parts.end()
    assert code == 1
    assert "part 2: no message for 8 s: it hangs, or is stopped or unreachable; a slow machine needs" in error
    assert "a longer --partition-timeout; what was recorded until then is complete" in error
    assert manifest["outcome"] == "failed"
    complete(tmp_path / "out", manifest)
    end = time.monotonic() + LIMIT
    while Path(f"/proc/{stopped}").exists() and time.monotonic() < end:
        time.sleep(0.1)
    assert not Path(f"/proc/{stopped}").exists()  # nothing of the run is left


@pytest.mark.alone
def test_a_part_that_is_slow_is_waited_for(whole: Path, tmp_path: Path) -> None:
    """It is stopped for two seconds, which is less than the time-out: the run goes on, with the same bits."""
    with running(tmp_path / "parts", "--pace", "1", "--until", "4", parts=2) as parts:
        parts.flies()
        stopped = parts.rank(1)
        os.kill(stopped, signal.SIGSTOP)
        time.sleep(2.0)
        os.kill(stopped, signal.SIGCONT)
        code, error, manifest = parts.end()
    assert (code, manifest["outcome"]) == (0, "done"), error
    same(whole, tmp_path / "parts")


WAITING = """
from cosim_master.execution.partitions.mpi import MpiTransport
from cosim_master.execution.partitions.transport import PartLost
for patient in (False, True):
    try:
        MpiTransport(0.02).receive(0, patient=patient)
    except PartLost as error:
        print(error.why)
"""


def test_messages_of_time_outs_name_the_limit() -> None:
    """A part that waits for itself, in vain."""
    hidden = [option for name in _SIZES for option in ("-u", name)]
    command = ["env", *hidden, sys.executable, "-c", WAITING]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT)
    said = "it hangs, or is stopped or unreachable; a slow machine needs a longer --partition-timeout"
    assert done.stdout.splitlines() == [
        f"no message for 0.06 s: {said}",
        f"no message for 0.6 s, 30 times --partition-timeout, as it starts or ends: {said}",
    ], done.stderr


OTHER_VERSION = """
import os
from cosim_master.execution.partitions import starting
of = starting.version
if os.environ["OMPI_COMM_WORLD_RANK"] == "1":
    starting.version = lambda name: "0.0.9" if name == "uav-cosim" else of(name)
from cosim_master.cli import main
main()
"""


def test_a_part_of_another_version_is_refused(fmus: Path, tmp_path: Path) -> None:
    launcher = [str(Path(sys.executable).with_name("mpirun")), "-n", "2", "--host", "localhost:2", "--bind-to", "none"]
    environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    environment["TMPDIR"] = str(tmp_path)
    command = [*launcher, sys.executable, "-c", OTHER_VERSION, "run", str(SYSTEMS / "line5"), "--until", "2"]
    command += ["-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=LIMIT)
    assert done.returncode == 2
    assert done.stderr.count("error:") == 1, done.stderr
    said = f"part 1 ({os.uname().nodename}): it has uav-cosim 0.0.9, part 0 has "
    assert said in done.stderr.replace("\n", " ")
    assert "install the same version everywhere" in done.stderr.replace("\n", " ")
    assert not (tmp_path / "out" / "manifest.json").exists()


@pytest.mark.alone
@pytest.mark.parametrize(("number", "of"), [(signal.SIGINT, 3), (signal.SIGHUP, 2)])
def test_it_is_interrupted(fmus: Path, tmp_path: Path, number: signal.Signals, of: int) -> None:
    with running(tmp_path / "out", "--pace", "1", parts=of) as parts:
        parts.flies()
        parts.process.send_signal(number)
        code, error, manifest = parts.end()
    assert code == 130, error
    assert manifest["outcome"] == "interrupted"
    complete(tmp_path / "out", manifest)


def test_it_is_interrupted_before_it_runs(fmus: Path, tmp_path: Path) -> None:
    """The launcher has begun; no part takes Ctrl-C yet."""
    with running(tmp_path / "out") as parts:
        while not (children := Path(f"/proc/{parts.process.pid}/task/{parts.process.pid}/children").read_text()):
            time.sleep(0.01)
        parts.process.send_signal(signal.SIGINT)
        _, error = parts.process.communicate(timeout=LIMIT)
        assert (parts.process.returncode, error.splitlines()[-1]) == (130, "error: interrupted")
        end = time.monotonic() + LIMIT
        while Path(f"/proc/{children.split()[0]}").exists() and time.monotonic() < end:
            time.sleep(0.05)
        assert not Path(f"/proc/{children.split()[0]}").exists()  # nothing of the run is left
    assert not (tmp_path / "out" / "manifest.json").exists()


PRESSING = """
import os, signal, sys, time

def press(event, arguments):
    global press
    if event != "import" or arguments[0] != "cosim_master.execution.preparation.isolating" or press is None:
        return
    if os.environ.get("OMPI_COMM_WORLD_RANK") == "0":
        press = None
        launcher = int(open(f"/proc/{os.getppid()}/stat").read().rsplit(")", 1)[1].split()[1])
        os.kill(launcher, signal.SIGINT)
        time.sleep(2.0)  # the launcher passes it on, twice in a second

sys.addaudithook(press)
"""


@pytest.mark.alone
def test_it_is_interrupted_when_all_parts_are_there_and_none_has_told_of_itself(fmus: Path, tmp_path: Path) -> None:
    """Part 0 tells the others, which wait for it: they do not miss it after a minute, and abort."""
    (tmp_path / "sitecustomize.py").write_text(PRESSING)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [COMMAND, "run", str(SYSTEMS / "line5"), "--partitions", "2", "-o", str(tmp_path / "out")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LIMIT)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (130, "error: interrupted")
    assert "MPI_ABORT" not in done.stdout + done.stderr
    assert not (tmp_path / "out" / "manifest.json").exists()


def test_too_many_parts_are_refused_before_one_starts(
    fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cosim_master.cli.terminal.launching.start_parts", lambda *_: pytest.fail("they were started"))
    done = CliRunner().invoke(app, ["run", str(SYSTEMS / "line5"), "--partitions", "999"])
    assert done.exit_code == 2
    assert "--partitions: 999 parts of 5 units (drone1, drone2, drone3, drone4 and 1 more); give fewer" in done.stderr


@pytest.mark.parametrize(("cores", "told"), [(2, True), (3, False)])
def test_more_parts_than_processors_are_started_with_a_note(
    cores: int, told: bool, fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cosim_master.cli.terminal.launching.os.cpu_count", lambda: cores)
    monkeypatch.setattr("cosim_master.cli.terminal.launching.start_parts", lambda parts, _: 40 + parts)
    done = CliRunner().invoke(app, ["run", str(SYSTEMS / "line5"), "--partitions", "3"])
    assert done.exit_code == 43
    assert ("3 parts take turns at 2 processors, which is slower than 2 parts or one" in done.stderr) == told


@pytest.mark.alone
def test_it_is_started_twice(fmus: Path, tmp_path: Path) -> None:
    with running(tmp_path / "out", "--pace", "1", parts=2) as parts:
        parts.flies()
        with running(tmp_path / "out", parts=2) as second:
            _, error = second.process.communicate(timeout=LIMIT)
        assert second.process.returncode == 2
        assert "holds a run that goes on; give another folder" in error


def test_a_client_flies_a_vehicle_of_another_part(fmus: Path, tmp_path: Path) -> None:
    """The port of drone 5 is open in part 0; commands and telemetry cross to part 1."""
    with listening(tmp_path / "out", "--partitions", "2", "--ports", "tcp:0", pace=PACE) as swarm:
        client = Client(f"tcp:127.0.0.1:{swarm.port('@drone5')}", 5)
        client.take_off(1.0)
        client.link.close()
        manifest = swarm.stop()
    assert "drone5" in manifest["parts"][1]["units"]
    assert manifest["gateways"]["@drone5"]["received"] >= 4


def test_a_wrong_system_is_reported_once(fmus: Path, tmp_path: Path) -> None:
    with running(tmp_path / "out", "--set", "drone9.vehicle.mass=1") as parts:
        _, error = parts.process.communicate(timeout=LIMIT)
    assert parts.process.returncode == 2
    assert error.count("error:") == 1, error


@pytest.mark.parametrize(
    ("options", "code", "error"),
    [
        (("--gcs", "tcp:{port}"), 2, "--gcs: tcp:127.0.0.1:{port} cannot be opened: Address already in use"),
        (("-o", "{file}"), 2, "{file}: cannot hold the results of a run: File exists"),
        (("--dataflash",), 1, "{out}: no autopilot recorded its inner values; "),
        (("--partition-file", "{file}.json"), 2, "{file}.json: cannot be read: No such file or directory"),
        (("--partition-file", "{file}"), 2, "--partition-file: part 0 needs a process on nowhere; there are "),
    ],
    ids=["an address in use", "a file in the place of the folder", "after the run", "no assignment", "no such host"],
)
def test_what_part_0_alone_finds_is_told_once(
    fmus: Path, tmp_path: Path, options: tuple[str, ...], code: int, error: str
) -> None:
    """The other parts end with it, and do not end it before it has spoken."""
    units = [{"units": ["drone1", "drone2"], "host": "nowhere"}, {"units": ["drone*"]}]
    (tmp_path / "file").write_text(json.dumps({"parts": units}))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        names = {"port": taken.getsockname()[1], "file": tmp_path / "file", "out": tmp_path / "out"}
        given = [one.format_map(names) for one in options]
        with running(tmp_path / "out", "--until", "0.1", *given, parts=2, system="line5-points") as parts:
            _, said = parts.process.communicate(timeout=LIMIT)
    assert (parts.process.returncode, said.count("error: ")) == (code, 1), said
    assert f"error: {error.format_map(names)}" in said and "MPI_ABORT" not in said


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"parts": [{"units": ["a"]}, {"units": ["b"], "host": None}]}, "host is null, not the name of a machine"),
        ({"parts": [{"units": ["a"]}, {"units": ["b"]}], "x": 1}, "x is not known; there are parts only"),
    ],
)
def test_assignments_that_are_not_understood_are_refused(tmp_path: Path, content: Any, problem: str) -> None:
    (tmp_path / "parts.json").write_text(json.dumps(content))
    with pytest.raises(SystemDescriptionError, match=re.escape(f"is not a list of parts ({problem}); write ")):
        read_assignment(tmp_path / "parts.json", 2)


def test_another_number_than_the_launcher_has_started(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from cosim_master.cli import main; main()", "run", "x.ssd", "--partitions", "2"]
    environment = {**os.environ, "OMPI_COMM_WORLD_SIZE": "3"}
    found = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=tmp_path)
    assert found.returncode == 2
    assert "--partitions 2: the launcher has started 3 processes; give no number, or 3" in found.stderr

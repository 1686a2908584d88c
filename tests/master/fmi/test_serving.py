"""FMUs on other machines: the same values as in this process, one round trip for a step, and every way to lose them.

The other machine is this one: a server of this process, or of another one, behind a relay that counts and cuts.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
import select
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.algorithms import fixed_step
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.isolating import chosen_isolation, isolation_for
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.isolation import remote
from cosim_master.fmi.isolation.child import TOKEN
from cosim_master.fmi.isolation.remote import Address
from cosim_master.fmi.serving import Server
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master import processes
from tests.master.cli.test_command_line import is_as_documented
from tests.master.conftest import Workshop
from tests.master.fmi.test_isolation import ABLE, FAULTS, LIMITS, PATIENT, Faulties, _folder, leftovers
from tests.master.fmus.clocked import clocked
from tests.master.fmus.linear import BALL_PORTS, ball
from tests.master.terminal import COMMAND

SECRET = "correct horse battery staple"
Run = Callable[..., RunResult]


def _shut(*connections: socket.socket) -> None:
    for one in connections:
        with suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)


class Relay:
    """Forwards connections to a server, and counts how often a master sends something after it has received something.

    Attributes:
        port: where masters connect.
        turns: of all connections so far.
        sent: bytes of masters so far.
        act: called with the number of turns before a master's data is passed on; False: it is not, nor any other.
    """

    def __init__(self, port: int) -> None:
        self._server = port
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.turns = self.sent = 0
        self.act: Callable[[int], bool] = lambda _: True
        self._open: list[socket.socket] = []
        self._forwarding: list[threading.Thread] = []
        self._counting = threading.Lock()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                master, _ = self._listening.accept()
            except OSError:
                return
            server = socket.create_connection(("127.0.0.1", self._server))
            self._open += [master, server]
            forwarding = threading.Thread(target=self._forward, args=(master, server), daemon=True)
            self._forwarding.append(forwarding)
            forwarding.start()

    def _forward(self, master: socket.socket, server: socket.socket) -> None:
        answered = True
        with suppress(OSError, ValueError):  # ValueError: a socket that `close` has closed meanwhile
            while True:
                ready, _, _ = select.select([master, server], [], [])
                for one in ready:
                    data = one.recv(1 << 20)
                    if not data:
                        _shut(master, server)
                        return
                    if one is master:
                        with self._counting:
                            self.turns += answered
                            self.sent += len(data)
                            going_on = self.act(self.turns)
                        answered = False
                        if not going_on:
                            return
                        server.sendall(data)
                    else:
                        answered = True
                        master.sendall(data)

    def finish(self) -> None:
        """Waits until everything that masters which have ended have sent is counted: they do not wait for an answer."""
        for one in self._forwarding:
            one.join(600)
            assert not one.is_alive()

    def cut(self) -> None:
        """Ends all connections."""
        _shut(*self._open)

    def close(self) -> None:
        self.cut()
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for one in self._open:
            one.close()


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: list[str]) -> Iterator[Server]:
    (tmp_path / "kept").mkdir()
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("cosim_master.fmi.serving.private_cache", lambda: tmp_path / "kept")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    before = leftovers()
    with Server("127.0.0.1", 0, SECRET, told=told.append) as made:
        threading.Thread(target=made.serve, daemon=True).start()
        yield made
    until = time.monotonic() + 60.0  # threads of connections that have just ended close them
    while leftovers() - before and time.monotonic() < until:
        time.sleep(0.05)
    assert leftovers() - before == set()  # processes, descriptors, temporary folders of both sides


@pytest.fixture
def relay(server: Server) -> Iterator[Relay]:
    made = Relay(server.port)
    yield made
    made.close()


@pytest.fixture
def faulties(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory) -> Faulties:
    return Faulties(workshop, _folder(tmp_path_factory))


def hosted(port: int, *patterns: str, token: str = SECRET, **how: Any) -> Isolation:
    places = {pattern: Address("127.0.0.1", port) for pattern in patterns or ("*",)}
    return Isolation("foreign", **{"limits": PATIENT, **how}, hosts=places, token=token)


@pytest.fixture
def run(faulties: Faulties, tmp_path: Path, relay: Relay) -> Run:
    made: dict[str, Path] = {}  # once: other archives would have other digests

    def runs(fault: str, isolation: Isolation | None = None, out: str = "out", **how: Any) -> RunResult:
        system = made[fault] if fault in made else made.setdefault(fault, faulties.system(fault, **how))
        return simulate(system, RunOptions(out=tmp_path / out, isolation=isolation or hosted(relay.port)))

    return runs


def table(tmp_path: Path, name: str = "out") -> Any:
    """What was recorded, read at once: pyarrow may close a file later than it returns."""
    return pq.read_table(io.BytesIO((tmp_path / name / "signals.parquet").read_bytes()))


def rows(folder: Path) -> list[float]:
    return list(table(folder.parent, folder.name)["time"].to_pylist())


# ---- the same values -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("same_file", [False, True])
def test_the_same_bits_from_one_server(run: Run, tmp_path: Path, told: list[str], same_file: bool) -> None:
    """Two FMU files have two processes there; two instances of one file share one."""
    assert run("none none 0", Isolation("none"), "here", same_file=same_file).outcome == "done"
    result = run("none none 0", same_file=same_file)
    assert result.outcome == "done", result.error
    assert table(tmp_path).equals(table(tmp_path, "here"))
    assert table(tmp_path)["bad.s"].to_pylist()[-1] == "4 steps"
    assert sum(text.endswith("begins") for text in told) == (1 if same_file else 2)


def test_one_here_and_one_there(run: Run, relay: Relay, tmp_path: Path, told: list[str]) -> None:
    assert run("none none 0", Isolation("none"), "here").outcome == "done"
    assert run("none none 0", hosted(relay.port, "go?d")).outcome == "done"
    assert table(tmp_path).equals(table(tmp_path, "here"))
    assert [text.partition(": ")[2] for text in told] == ["good.fmu begins", "good.fmu ends"]


def test_events_of_fmi_3(server: Server, linears: Any, tmp_path: Path, tmp_path_factory: Any) -> None:
    """The ball announces some of its events and returns early for others."""
    ball(linears.workshop, tmp_path_factory.getbasetemp())
    system = linears.ssd(linears.workshop.component("ball", "ball.fmu", BALL_PORTS), stop=2.0)
    for name, isolation in (("here", Isolation("none")), ("out", hosted(server.port))):
        result = simulate(system, RunOptions(out=tmp_path / name, isolation=isolation, step=0.01))
        assert result.outcome == "done", result.error
    assert table(tmp_path).equals(table(tmp_path, "here"))


def test_clocks_strings_and_binaries(server: Server, stricts3: Any, tmp_path: Path) -> None:
    clocked(stricts3, "a.fmu", "constant", "countdown", "fire", period=0.25)
    clocked(stricts3, "b.fmu", "go", "fire")
    ports = "text_out:output bytes_out:output ticks_fire:output"
    parts = stricts3.component("a", "a.fmu", ports=f"{ports} fire:output", rule=1, text_in="here")
    parts += stricts3.component("b", "b.fmu", ports=f"{ports} go:input text_in:input bytes_in:input")
    system = stricts3.ssd(parts, "a/fire b/go", "a/text_out b/text_in", "a/bytes_out b/bytes_in", stop=1.0)
    for name, isolation in (("here", Isolation("none")), ("out", hosted(server.port))):
        result = simulate(system, RunOptions(out=tmp_path / name, isolation=isolation))
        assert result.outcome == "done", result.error
    assert table(tmp_path).equals(table(tmp_path, "here"))
    assert table(tmp_path)["b.text_out"].to_pylist() == ["here"] * 3


def test_checkpoints(server: Server, faulties: Faulties, tmp_path: Path) -> None:
    """States are serialised there; a run goes on from them on another machine or here."""
    system, there = faulties.system("none none 0", same_file=True), hosted(server.port)
    whole = tmp_path / "whole"
    assert simulate(system, RunOptions(out=whole, checkpoint_every=1.0, isolation=there)).outcome == "done"
    for isolation in (there, Isolation("none")):
        result = simulate(system, RunOptions(out=tmp_path / "out", origin=f"{whole}@1", isolation=isolation))
        assert result.outcome == "done", result.error
        assert table(tmp_path).equals(table(tmp_path, "whole"))


def test_a_step_of_all_instances_is_one_round_trip(relay: Relay, faulties: Faulties, tmp_path: Path) -> None:
    """However many instances a process has, inputs and outputs included: eight more steps are eight more turns."""
    system = faulties.system("none none 0", same_file=True)
    turns = []
    for until in (0.5, 2.0, 6.0):  # the first one sends the file
        before = relay.turns
        result = simulate(system, RunOptions(out=tmp_path / "out", until=until, isolation=hosted(relay.port)))
        assert result.outcome == "done", result.error
        turns.append(relay.turns - before)
    assert rows(tmp_path / "out")[-1] == 6.0
    assert turns[2] - turns[1] == 8


# ---- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", ["segv", "exit3", "memory", "hang"])
def test_a_step_that_does_not_return(run: Run, relay: Relay, tmp_path: Path, told: list[str], fault: str) -> None:
    limits = LIMITS if fault == "hang" else PATIENT
    result = run(f"{fault} fmi2DoStep 3", hosted(relay.port, limits=limits))
    text = str(result.error)
    assert (result.outcome, result.simulated_s) == ("failed", 1.0)
    assert text.startswith("bad: fmi2DoStep failed at t = 1 s: ")
    assert re.search(FAULTS[fault] + "; its inputs: u = 1", text), text
    assert "a step of 0.5 s from t = 1 s" in text
    assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["error"] == text
    assert any(re.search(f"bad.fmu ends: {FAULTS[fault]}", one) for one in told), told


def test_errors_of_functions(run: Run) -> None:
    """A status that is an error is that of the function, also if it travels with the step."""
    assert str(run("error fmi2SetReal 5").error).startswith("bad: fmi2SetReal failed at t = 1 s: fmi2Error")
    assert str(run("error fmi2EnterInitializationMode 1").error).startswith("bad: fmi2EnterInitializationMode failed")
    assert str(run("segv fmi2Instantiate 1").error).startswith("bad: fmi2Instantiate failed: its process was ended by")


def test_a_long_step_is_no_lost_connection(run: Run, relay: Relay, monkeypatch: pytest.MonkeyPatch) -> None:
    """While a process is busy, the server says so: the time limit ends it, which is longer than that for silence."""
    monkeypatch.setattr(remote, "SILENCE", 4.0)
    result = run("sleep fmi2DoStep 3", hosted(relay.port, limits=replace(LIMITS, seconds=5.0)))
    assert "it did not return within 5 s, and its process was killed" in str(result.error)


def cut_at(relay: Relay, turn: int, *, silent: bool = False) -> None:
    def act(turns: int) -> bool:
        if turns < turn:
            return True
        if not silent:
            relay.cut()
        return False

    relay.act = act


@pytest.mark.parametrize("silent", [False, True])
def test_a_connection_that_is_lost(
    run: Run, relay: Relay, server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, silent: bool
) -> None:
    """It is closed, or nothing is heard any more: the recording is complete up to the step before."""
    assert run("none none 0").outcome == "done"  # which sends the file
    before = relay.turns
    assert run("none none 0").outcome == "done"
    cut_at(relay, 2 * relay.turns - before - 7, silent=silent)  # the last step; to end takes each three turns
    monkeypatch.setattr(remote, "SILENCE", 5.0)
    result = run("none none 0")
    text = str(result.error)
    assert result.outcome == "failed"
    lost = r"nothing was heard of \S+ for 5 s" if silent else r"\S+ has closed it"
    match = re.search(
        rf"(bad|good): fmi2DoStep failed at t = (\S+) s: the connection to its process was lost: {lost}", text
    )
    assert match, text
    assert result.simulated_s == float(match[2]) == rows(tmp_path / "out")[-1]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["error"]) == ("failed", text)


def test_signals_do_not_prolong_the_silence(run: Run, relay: Relay, monkeypatch: pytest.MonkeyPatch) -> None:
    """A timer of the user's program interrupts the wait for an answer again and again."""
    came = []
    before = signal.signal(signal.SIGALRM, lambda *_: came.append(1))

    def act(turns: int) -> bool:
        if turns > 20:
            signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)
        return turns <= 20

    relay.act = act
    monkeypatch.setattr(remote, "SILENCE", 2.0)
    try:
        result = run("none none 0")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert result.outcome == "failed"
    assert re.search(r"nothing was heard of \S+ for 2 s", str(result.error)), result.error
    assert came


def test_restarts(run: Run, relay: Relay, tmp_path: Path) -> None:
    """A process that dies there is replaced by a new one there, and the recording is the same."""
    assert run("none none 0", out="here").outcome == "done"
    before, others, killed = relay.turns, set(processes.children(os.getpid())), []

    def act(turns: int) -> bool:
        if turns == 2 * before - 9 and not killed:
            killed.extend(pid for pid in processes.children(os.getpid()) if pid not in others)
            for pid in killed:
                os.kill(int(pid), signal.SIGKILL)
        return True

    relay.act = act
    result = run("none none 0", hosted(relay.port, limits=replace(PATIENT, restarts=2)))
    assert result.outcome == "done" and killed, result.error
    assert any("signal 9 (SIGKILL); it was started anew (1 of 2)" in text for text in result.notes), result.notes
    assert table(tmp_path).equals(table(tmp_path, "here"))


# ---- connections that do not come about ------------------------------------------------------------------------------


def test_a_wrong_token(run: Run, relay: Relay, told: list[str], tmp_path: Path) -> None:
    result = run("none none 0", hosted(relay.port, token="another"))
    assert result.outcome == "failed"
    assert f"127.0.0.1:{relay.port}: the token is not that of this server; set {TOKEN}" in str(result.error)
    assert "the token is not that of this server" in told[0] and SECRET not in told[0]
    assert list((tmp_path / "kept").iterdir()) == []  # no file was taken


def test_nobody_listens(run: Run) -> None:
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    text = str(run("none none 0", hosted(port)).error)
    assert f"127.0.0.1:{port}: nobody listens there; run `uav-cosim serve --port {port}` on that machine" in text


def answered(data: bytes) -> tuple[int, threading.Thread]:
    """The port of a server that sends these bytes to the first who connects."""
    listening = socket.create_server(("127.0.0.1", 0))

    def answer() -> None:
        connection, _ = listening.accept()
        with listening, connection, suppress(OSError):  # the other side may be gone before each of these
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(1000):
                pass

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    return listening.getsockname()[1], thread


def message(**content: Any) -> bytes:
    data = json.dumps(content).encode()
    return len(data).to_bytes(4, "big") + data


OTHERS = {
    "another version": (
        message(protocol="0123 little", version="9.9", nonce="0"),
        r"it runs uav-cosim 9\.9 with another protocol than uav-cosim \S+ here; install the same version on both",
    ),
    "a web server": (b"HTTP/1.1 400 Bad Request\r\n\r\n", "it does not speak the protocol of uav-cosim serve"),
    "no text": (b"\x00\x00\x00\x02[]", "it does not speak the protocol of uav-cosim serve"),
    "one that closes": (b"\x00", "the connection failed: it has closed the connection"),
    "one without the token": (
        message(protocol=remote.protocol(), version="1", nonce="0") + message(proof="0" * 64),
        "it does not know the token",
    ),
}


@pytest.mark.parametrize("other", OTHERS)
def test_another_server(run: Run, other: str) -> None:
    data, text = OTHERS[other]
    port, thread = answered(data)
    result = run("none none 0", hosted(port))
    thread.join()
    assert re.search(f"127.0.0.1:{port}: {text}", str(result.error)), result.error


def test_strangers_do_not_disturb_a_server(run: Run, server: Server, told: list[str]) -> None:
    for data in (b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 100, message(nonce=1, proof=[2]), message(), b""):
        with socket.create_connection(("127.0.0.1", server.port)) as stranger, suppress(OSError):
            stranger.sendall(data)
            stranger.shutdown(socket.SHUT_WR)
            while stranger.recv(1000):  # the server may have closed it before
                pass
    assert run("none none 0").outcome == "done"


def test_an_fmu_that_cannot_be_loaded_there(run: Run, faulties: Faulties, relay: Relay, tmp_path: Path) -> None:
    """The server's own words reach the user: here, that the archive does not have the binary which it says it has."""
    system = faulties.system("none none 0")
    broken = tmp_path / "unlinked.c"
    broken.write_text('#include "faulty.c"\nvoid nowhere(void);\nEXPORT void unlinked(void) { nowhere(); }\n')
    faulties.fmu("bad.fmu", "none none 0", ABLE, broken)
    text = str(simulate(system, RunOptions(isolation=hosted(relay.port))).error)
    assert f"127.0.0.1:{relay.port}: " in text and "nowhere" in text


# ---- files -----------------------------------------------------------------------------------------------------------


def test_a_file_is_sent_once(
    run: Run, relay: Relay, tmp_path: Path, faulties: Faulties, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By its digest; one that was changed there is sent again."""
    # Copies of states, which the wall clock begins, are messages, too.
    monkeypatch.setattr(fixed_step, "_SNAPSHOT_EVERY", math.inf)
    sizes = []
    for damage in (False, False, True):
        before = relay.sent
        if damage:
            for file in (tmp_path / "kept" / "hosted").iterdir():
                content = bytearray(file.read_bytes())
                content[len(content) // 2] ^= 1
                file.write_bytes(content)
        assert run("none fmi2DoStep 0").outcome == "done"  # so that the files differ
        relay.finish()
        sizes.append(relay.sent - before)
    files = [faulties.workshop.root / name for name in ("bad.fmu", "good.fmu")]
    assert sizes[0] - sizes[1] == sizes[2] - sizes[1] == sum(file.stat().st_size for file in files)
    kept = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in (tmp_path / "kept/hosted").iterdir()}
    assert len(kept) == 2 and all(name == f"{digest}.fmu" for name, digest in kept.items())


# ---- options ---------------------------------------------------------------------------------------------------------


def test_options(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(TOKEN, SECRET)
    chosen = chosen_isolation(None, None, None, None, ["a=host:1", "b*=[::1]:65535"])
    assert chosen is not None
    assert chosen.hosts == {"a": Address("host", 1), "b*": Address("::1", 65535)}
    assert [str(one) for one in chosen.hosts.values()] == ["host:1", "[::1]:65535"]
    assert SECRET not in repr(chosen)
    for text in ("a", "a=", "a=host", "a=:1", "a=host:0", "a=host:65536", "a=host:x"):
        with pytest.raises(SystemDescriptionError, match="is not INSTANCE=MACHINE:PORT"):
            chosen_isolation(None, None, None, None, [text])
    monkeypatch.delenv(TOKEN)
    with pytest.raises(SystemDescriptionError, match=f"--host: the environment variable {TOKEN} is not set"):
        chosen_isolation(None, None, None, None, ["a=host:1"])


def test_patterns_select_instances(faulties: Faulties) -> None:
    checked = check(read_system(faulties.system("none none 0")))
    one, two = Address("one", 1), Address("two", 2)
    isolation = Isolation("none", hosts={"bad": one, "*": two}, token=SECRET)
    assert isolation_for(isolation, checked).hosts == {"bad": one, "good": two}
    with pytest.raises(SystemDescriptionError, match=r'--host: "bda" is no instance; did you mean "bad"\?'):
        isolation_for(replace(isolation, hosts={"bda": one}), checked)


def test_tables_do_not_run_elsewhere(workshop: Workshop, tmp_path: Path) -> None:
    (workshop.root / "t.csv").write_text("time,y\n0,1\n1,2\n")
    parts = workshop.component("t", "t.csv", "y:output", type="text/csv")
    system = check(read_system(workshop.ssd("t.ssd", workshop.system(parts))))
    with pytest.raises(SystemDescriptionError, match="t cannot run on host:1: tables and FMUs of FMI 1"):
        isolation_for(Isolation(hosts={"t": Address("host", 1)}, token=SECRET), system)


def test_a_server_needs_a_token_and_a_free_port(server: Server) -> None:
    with pytest.raises(ValueError, match="a server of FMUs needs a token"):
        Server("127.0.0.1", 0, "")
    call = CliRunner(env={TOKEN: "short"}).invoke(app, ["serve"])
    assert (call.exit_code, call.stderr.split(";")[0]) == (2, f"error: the token in {TOKEN} has 5 characters")
    call = CliRunner(env={TOKEN: SECRET}).invoke(app, ["serve", "--port", str(server.port)])
    assert call.exit_code == 2
    assert f"127.0.0.1:{server.port} cannot be used: Address already in use" in call.stderr


@pytest.mark.parametrize("token", [None, SECRET])
@pytest.mark.parametrize("as_json", [False, True])
def test_the_commands(faulties: Faulties, tmp_path: Path, token: str | None, as_json: bool) -> None:
    """A server in a process of its own, and masters with its token, with another one, and after its end."""
    system = faulties.system("none none 0")
    environment = {name: value for name, value in os.environ.items() if name != TOKEN}
    command = [COMMAND, "serve", "--port", "0", *(["--json"] if as_json else [])]
    given, pipes = {TOKEN: token} if token else {}, {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, env={**environment, **given}, text=True, **pipes) as process:
        assert process.stdout is not None and process.stderr is not None
        shown = token
        if as_json:
            document = json.loads("".join(iter(process.stdout.readline, "}\n")) + "}")
            assert is_as_documented("serve", document)
            shown = document["token"]
            assert token is None or shown == token
        elif token is None:
            shown = process.stderr.readline().strip().removeprefix(f"export {TOKEN}=")
        where = re.search(r"127\.0\.0\.1:(\d+)", process.stderr.readline())
        assert where and shown and (token or len(shown) == 32)
        assert not as_json or (document["bind"], document["port"]) == ("127.0.0.1", int(where[1]))
        arguments = ["run", str(system), "-o", str(tmp_path / "out"), "--force", "--host", f"*={where[0]}"]
        done = CliRunner(env={TOKEN: shown}).invoke(app, arguments)
        assert done.exit_code == 0, done.output
        assert rows(tmp_path / "out")[-1] == 2.0
        refused = CliRunner(env={TOKEN: shown + "x"}).invoke(app, arguments)
        assert refused.exit_code == 1
        assert "the token is not that of this server" in refused.stderr
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
        assert "bad.fmu begins" in process.stderr.read()
    lost = CliRunner(env={TOKEN: shown}).invoke(app, arguments)
    assert lost.exit_code == 1 and "nobody listens there" in lost.stderr
    without = CliRunner(env={TOKEN: ""}).invoke(app, arguments)
    assert without.exit_code == 2 and f"the environment variable {TOKEN} is not set" in without.stderr


def test_fmus_do_not_see_the_token(faulties: Faulties, monkeypatch: pytest.MonkeyPatch, server: Server) -> None:
    """Neither those of a server nor isolated ones: the environment of their process does not have it."""
    monkeypatch.setenv(TOKEN, SECRET)
    seen: list[dict[str, str]] = []
    started = subprocess.Popen

    def watched(*arguments: Any, **how: Any) -> Any:
        seen.append(how["env"])
        return started(*arguments, **how)

    monkeypatch.setattr("cosim_master.fmi.isolation.child.subprocess.Popen", watched)
    system = faulties.system("none none 0")
    for isolation in (Isolation("foreign", PATIENT), hosted(server.port)):
        assert simulate(system, RunOptions(isolation=isolation)).outcome == "done"
    assert len(seen) == 4 and not any(TOKEN in one for one in seen) and all("PATH" in one for one in seen)

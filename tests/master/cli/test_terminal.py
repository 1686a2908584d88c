"""The command at a real terminal: what is on the screen while it works and when it has ended."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numba
import pytest

from cosim_master.cli.terminal import progress
from cosim_master.cli.terminal.progress import Activity, compiling
from tests.master.results.test_figures import consensus_run
from tests.master.terminal import COMMAND, PATIENCE, Terminal, forking_at_terminals

pytestmark = pytest.mark.usefixtures("own_cache")
BAR = r"\d+\.\d/3\.0 s  \d+\.\d x real time  (\d+:\d\d|-:--) left  0 packets$"
WIDTHS = pytest.mark.parametrize("columns", [80, 200])


@pytest.fixture(scope="module")
def at_terminal() -> Iterator[Callable[..., Terminal]]:
    """`Terminal`, with forks."""
    with forking_at_terminals() as made:
        yield made


@pytest.fixture
def system(probes: Any) -> Path:
    """Two probes for 3 s."""
    probes.fmu()
    set_by_the_system = {"n": 1, "b": True, "s": "", "e": 1}
    a, b = probes.component("a", u=1.0, **set_by_the_system), probes.component("b", **set_by_the_system)
    made: Path = probes.ssd(a + b, "a/y b/u", stop=3.0)
    return made


@WIDTHS
def test_run_shows_a_bar_and_leaves_its_result(
    at_terminal: Callable[..., Terminal], system: Path, tmp_path: Path, columns: int
) -> None:
    with at_terminal("run", "s.ssd", "--pace", "3", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    bars = terminal.ever(BAR)
    assert len(bars) > 1, terminal.screens[-5:]
    assert all(len(bar) <= columns and bar[0] in "━╸╺ " for bar in bars)
    assert terminal.ever(r"checking s\.ssd")
    (done,) = (n for n, line in enumerate(terminal.lines) if line.startswith("done: "))
    assert re.fullmatch(r"done: 3 s simulated in \d+\.\d\d s \(\d+\.\d times real time\)", terminal.lines[done])
    assert terminal.lines[done + 1] == "packets: 0 sent, 0 delivered, 0 lost"
    assert terminal.lines[-1] == "results: out/s"  # after a line about the pace if the machine is busy
    assert not [line for line in terminal.lines if re.search(BAR, line)], "the bar stays"
    assert b"Traceback" not in terminal.bytes
    assert not terminal.cursor_hidden


def test_a_dumb_terminal_gets_plain_lines(at_terminal: Callable[..., Terminal], system: Path, tmp_path: Path) -> None:
    with at_terminal("run", "s.ssd", "--set", "c.p=1", folder=tmp_path, environment={"TERM": "dumb"}) as terminal:
        assert terminal.finish() == 2
    with at_terminal("run", "s.ssd", folder=tmp_path, environment={"TERM": "dumb"}) as terminal:
        assert terminal.finish() == 0
    assert b"\x1b" not in terminal.bytes
    assert terminal.lines[-1] == "results: out/s"


def test_no_color_keeps_the_bar_and_nothing_else(
    at_terminal: Callable[..., Terminal], system: Path, tmp_path: Path
) -> None:
    quiet = {"NO_COLOR": "1", "FORCE_COLOR": "1"}
    with at_terminal("run", "s.ssd", "--pace", "3", folder=tmp_path, environment=quiet) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(BAR)
    assert not terminal.coloured
    with at_terminal("check", "nowhere.ssd", folder=tmp_path) as terminal:
        assert terminal.finish() == 2
    assert b"\x1b[1;31merror:\x1b[0m nowhere.ssd: no such file" in terminal.bytes


def test_into_a_pipe_nothing_is_drawn(system: Path, tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")}

    def call(*arguments: str, **more: str) -> subprocess.CompletedProcess[bytes]:
        return subprocess.run([COMMAND, *arguments], cwd=tmp_path, env=environment | more, capture_output=True)

    done = call("run", "s.ssd")
    assert done.returncode == 0
    assert b"\x1b" not in done.stdout + done.stderr and b"\r" not in done.stdout + done.stderr
    assert done.stdout.decode().splitlines()[-1] == "results: out/s"
    # Colours may be forced into a pipe; a bar may not.
    forced = call("run", "s.ssd", "--pace", "3", "--set", "a.nothing=1", FORCE_COLOR="1")
    assert forced.returncode == 2 and b"\x1b[1;31merror:\x1b[0m --set: " in forced.stderr
    forced = call("run", "s.ssd", "--pace", "3", FORCE_COLOR="1")
    assert forced.returncode == 0 and b"real time  " not in forced.stderr


def test_quiet_says_nothing_and_draws_nothing(
    at_terminal: Callable[..., Terminal], system: Path, tmp_path: Path
) -> None:
    for arguments in (("-q", "run", "s.ssd"), ("run", "s.ssd", "-q")):
        with at_terminal(*arguments, "--pace", "3", folder=tmp_path) as terminal:
            assert terminal.finish() == 0
        assert terminal.bytes == b""


def test_ctrl_c_ends_a_run_with_its_results(at_terminal: Callable[..., Terminal], probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    probes.ssd(probes.component("a", u=1.0), stop=1e6)
    with Terminal("run", "s.ssd", "--pace", "3", folder=tmp_path) as terminal:
        terminal.wait_for(lambda lines: any("x real time" in line and not line.startswith(" ") for line in lines))
        terminal.press(b"\x03")
        assert terminal.finish() == 130
    assert terminal.lines[-3].startswith("interrupted: ")
    assert not [line for line in terminal.lines if "x real time  " in line], (
        "the bar stays: ^C was too much for its line"
    )
    assert terminal.lines[-1] == "results: out/s"
    assert not terminal.cursor_hidden
    assert json.loads((tmp_path / "out" / "s" / "manifest.json").read_text())["outcome"] == "interrupted"


def test_ctrl_c_while_the_command_is_imported(tmp_path: Path) -> None:
    """A library that it imports presses it, and waits."""
    slow = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(600)\n"
    (tmp_path / "lxml.py").write_text(slow)
    environment = {"PYTHONPATH": str(tmp_path)}
    with Terminal("check", "nowhere", folder=tmp_path, environment=environment) as terminal:
        assert terminal.finish() == 130
    assert [line for line in terminal.lines if line != "^C"] == ["error: interrupted"]


def test_ctrl_c_before_a_verb_begins(tmp_path: Path) -> None:
    """While options are read, which takes a twentieth of a second."""
    program = """
import os, signal
from typer.core import TyperGroup
TyperGroup.resolve_command = lambda *_: os.kill(os.getpid(), signal.SIGINT)
from cosim_master.cli import main
main()
"""
    command = [sys.executable, "-c", program, "check", "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted\n")


@WIDTHS
def test_check(at_terminal: Callable[..., Terminal], system: Path, tmp_path: Path, columns: int) -> None:
    with at_terminal("check", "s.ssd", "--init", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"checking s\.ssd +\d:\d\d")
    said = "2 instances initializeds.ssd: 2 instances, 1 connection, 0 radio nodes, 6 steps of 0.5 s: no problems"
    assert terminal.text.endswith(said)
    assert not terminal.cursor_hidden


@WIDTHS
def test_plot(at_terminal: Callable[..., Terminal], tmp_path: Path, columns: int) -> None:
    consensus_run(tmp_path / "run", last_step=1)
    words = ("plot", "run", "--signal", "drone1.agent.step")
    with at_terminal(*words, folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"plotting run +\d:\d\d")
    assert terminal.lines == ["run/signals.png", "run/signals.svg"]
    assert not terminal.cursor_hidden


@WIDTHS
def test_swap(at_terminal: Callable[..., Terminal], system: Path, probes: Any, tmp_path: Path, columns: int) -> None:
    probes.fmu("other.fmu", guid="other")
    with at_terminal("swap", "s.ssd", "b", "other.fmu", "-o", "new.ssd", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"checking s\.ssd +\d:\d\d")
    assert terminal.lines == ["new.ssd: b is now other.fmu"]


@WIDTHS
def test_pack_and_compare(at_terminal: Callable[..., Terminal], system: Path, tmp_path: Path, columns: int) -> None:
    with at_terminal("pack", "s.ssd", "-o", "s.ssp", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"packing s\.ssd +\d:\d\d")
    assert re.fullmatch(r"s\.ssp: 2 files, \d\.\d MB; uav-cosim run s\.ssp", terminal.text)
    for folder in ("one", "two"):
        consensus_run(tmp_path / folder, last_step=1)
    with at_terminal("compare", "one", "two", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"comparing one and two +\d:\d\d")
    assert terminal.lines[-1].startswith("equal: ")
    assert not terminal.cursor_hidden


@WIDTHS
def test_new(at_terminal: Callable[..., Terminal], fmus: Path, tmp_path: Path, columns: int) -> None:
    made = ("new", "line", "--drones", "3", "-o", "swarm")
    with at_terminal(*made, "--fmus", str(fmus), folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"writing swarm +\d:\d\d")
    assert terminal.text.startswith("note: drones start 10 m apart, ")
    assert terminal.lines[-1] == "swarm: line of 3 drones; uav-cosim run swarm"
    with at_terminal(*made[:-1], "other", "--fmus", "nowhere", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 2
    assert terminal.lines[0].startswith("error: nowhere/")
    assert b"Traceback" not in terminal.bytes


MODEL = '''
from cosim import Model, Output

class TerminalBuilt(Model):
    """Steps."""
    step_size = 0.5
    variables = (Output("y", unit="1"),)

    def do_step(self, t, h):
        return True
'''


@WIDTHS
def test_build(at_terminal: Callable[..., Terminal], tmp_path: Path, columns: int) -> None:
    (tmp_path / "terminal_built.py").write_text(MODEL)
    with at_terminal("build", "terminal_built.py", folder=tmp_path, columns=columns) as terminal:
        assert terminal.finish() == 0
    assert terminal.ever(r"building TerminalBuilt +\d:\d\d")
    assert terminal.lines == ["fmus/TerminalBuilt.fmu: interpreted"]


@pytest.mark.parametrize("kind", ["dumb", "no colour", "pipe"])
def test_every_verb_without_a_terminal_that_can_draw(
    at_terminal: Callable[..., Terminal], system: Path, probes: Any, fmus: Path, tmp_path: Path, kind: str
) -> None:
    probes.fmu("other.fmu", guid="other")
    (tmp_path / "terminal_built.py").write_text(MODEL)
    for name in ("one", "two"):
        consensus_run(tmp_path / name, last_step=1)
    said = {
        ("check", "s.ssd"): "s.ssd: 2 instances, 1 connection, 0 radio nodes, 6 steps of 0.5 s: no problems",
        ("plot", "one", "--signal", "drone1.agent.step", "--format", "svg"): "one/signals.svg",
        ("swap", "s.ssd", "b", "other.fmu", "-o", "new.ssd"): "new.ssd: b is now other.fmu",
        ("pack", "s.ssd", "-o", "s.ssp"): "uav-cosim run s.ssp",
        ("compare", "one", "two"): "equal: ",
        ("new", "line", "--drones", "3", "--fmus", str(fmus), "-o", "swarm"): "uav-cosim run swarm",
        ("build", "terminal_built.py"): "fmus/TerminalBuilt.fmu: interpreted",
        ("info", "s.ssd"): "connections",
    }
    environments = {"dumb": {"TERM": "dumb"}, "no colour": {"NO_COLOR": "1", "FORCE_COLOR": "1"}}
    for words, last in said.items():
        if kind == "pipe" and words[0] in ("plot", "compare", "info"):
            continue  # each is a process of its own there
        if kind == "pipe":
            done = subprocess.run([COMMAND, *words], cwd=tmp_path, capture_output=True)
            code, shown, written = done.returncode, done.stdout.decode(), done.stdout + done.stderr
        else:
            with at_terminal(*words, folder=tmp_path, environment=environments[kind], columns=200) as terminal:
                code, shown, written = terminal.finish(), "\n".join(terminal.lines), terminal.bytes
            assert not terminal.coloured and not terminal.cursor_hidden
        assert code == 0, (words, written)
        assert last in shown, (words, shown)
        assert b"Traceback" not in written
        if kind != "no colour":
            assert b"\x1b" not in written, (words, written)


@pytest.mark.parametrize(
    "words",
    [["plot", "run"], ["report", "run"], ["compare", "run", "run"], ["view", "run"], ["repair", "run"]],
    ids=lambda words: words[0],
)
def test_ctrl_c_in_the_middle(at_terminal: Callable[..., Terminal], tmp_path: Path, words: list[str]) -> None:
    """Of a file that has no end: nobody writes to it."""
    consensus_run(tmp_path / "run", last_step=1)
    endless = tmp_path / "run" / "manifest.json"
    endless.unlink()
    os.mkfifo(endless)
    with at_terminal(*words, folder=tmp_path) as terminal:
        writer = _opened_for_reading(endless)
        terminal.press(b"\x03")
        assert terminal.finish() == 130
        os.close(writer)
    assert terminal.lines[-1] == "error: interrupted"
    assert b"Traceback" not in terminal.bytes
    assert not terminal.cursor_hidden


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_build_that_is_asked_to_end_leaves_no_process(tmp_path: Path, number: signal.Signals) -> None:
    """Its processes hold the pipe, so that reading from it ends with the last of them."""
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "COLUMNS": "200"}
    words = [COMMAND, "build", "Hexarotor", "Quadrotor"]
    before = signal.signal(number, signal.SIG_DFL)  # under nohup, tests inherit that SIGHUP is ignored
    try:
        building = subprocess.Popen(words, stderr=subprocess.PIPE, cwd=tmp_path, env=cold, text=True)
    finally:
        signal.signal(number, before)
    with building:
        assert building.stderr is not None
        assert building.stderr.readline() == "building Hexarotor, Quadrotor ...\n"
        building.send_signal(number)
        assert building.communicate(timeout=PATIENCE)[1] == "error: interrupted\n"
    assert building.returncode == 130
    assert not list((tmp_path / "fmus").glob("*"))


def _opened_for_reading(fifo: Path) -> int:
    """A writer of a pipe with a name, as soon as it has a reader."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            return os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:
            time.sleep(0.02)
    raise TimeoutError(fifo)


def test_ctrl_c_ends_a_build(at_terminal: Callable[..., Terminal], tmp_path: Path) -> None:
    """The processes that build end with the command; none of them says a word."""
    cold = {"XDG_CACHE_HOME": str(tmp_path / "cache")}  # kept object code would let it end too soon
    with at_terminal("build", "Hexarotor", "Quadrotor", folder=tmp_path, columns=200, environment=cold) as terminal:
        terminal.wait_for(lambda lines: any(re.search(r"building Hexarotor, Quadrotor 0:0[1-9]", s) for s in lines))
        terminal.press(b"\x03")
        assert terminal.finish() == 130
    assert [line for line in terminal.lines if line != "^C"] == ["error: interrupted"]
    assert not list((tmp_path / "fmus").glob("*"))


class Said(Activity):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.stages: list[tuple[str, bool]] = []

    def stage(self, text: str, *, long: bool = False) -> None:
        self.stages.append((text, long))


def test_compiling_the_loop_is_said_and_loading_it_is_not() -> None:
    import_module("cosim.lowering")  # it tells when numba compiles

    def function(module: str) -> Any:
        namespace: dict[str, Any] = {"__name__": module}
        exec("def step(x):\n    return x + 1\n", namespace)
        return numba.njit(namespace["step"])

    said = Said()
    loop, other = function("cosim_master.stepping.kernels.macro_step"), function("somebody")
    small = function("cosim_master.network.radio.logs")
    with compiling(said):
        assert loop(1) == 2
        assert other(1) == 2
        assert small(1) == 2
        assert loop(2) == 3
    assert function("cosim_master.stepping.kernels.macro_step")(1) == 2, "outside of the block"
    assert said.stages == [
        ("compiling the stepping loop (once, about 30 s)", True),
        ("compiling somebody.step (once)", False),
        ("compiling cosim_master.network.radio.logs.step (once)", False),
    ]


def test_a_stage_that_takes_long_is_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(progress, "LONG", 0.0)
    with progress.activity() as doing:
        doing.stage("loading 15 FMU instances")
        assert doing._timer is not None  # type: ignore[attr-defined]
        doing._timer.join()  # type: ignore[attr-defined]
        doing.stage("compiling", long=True)
        doing.stage("compiling", long=True)
        doing.starting()
    assert capsys.readouterr().err == "loading 15 FMU instances ...\ncompiling ...\n"
    monkeypatch.setattr(progress, "LONG", 1000.0)
    with progress.activity() as doing:
        doing.stage("checking")
    assert capsys.readouterr().err == ""

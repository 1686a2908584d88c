"""Whole runs of real FMUs: the calls they get from start to end, how runs fail, and what is left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution import pacing
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.outcome.result import Overruns, RunResult
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.gateways import Gateways
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import Progress
from cosim_master.system.settings.time_grid import TimeGrid
from tests.master.fmus.probe import model, slave
from tests.master.forks import Forks

pytestmark = pytest.mark.usefixtures("own_cache")

HERE = ("--isolate", "none")
"""FMUs in the process of the run."""


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def failed(system: Path, **options: Any) -> str:
    result = simulate(system, RunOptions(**options))
    assert result.outcome == "failed"
    return str(result.error)


# ---- the legal order of calls -----------------------------------------------------------------


def test_every_call_of_a_run(probes: Any) -> None:
    """FMI 2.0.5, section 4.2.4, for two probes. Every start value is set, inputs in initialization mode only."""
    probes.fmu()
    components = probes.component("a", p=1.5, u=3.0) + probes.component("b", mode=0)
    result = simulate(probes.ssd(components, "a/y b/u", stop=0.5))
    assert result.outcome == "done"
    calls = probes.calls
    assert calls == [
        *("a: instantiate probe", "b: instantiate probe"),
        *("a: setup 0 to 0.5", "a: set p = 1.5", "a: set w = 0", "a: set x = 0"),
        *("b: setup 0 to 0.5", "b: set p = 0.25", "b: set w = 0", "b: set x = 0"),
        *("a: enter", "a: set u = 3", "a: set n = 0", "a: set e = 1", "a: set b = false", 'a: set s = ""'),
        *("b: enter", "b: set u = 0", "b: set n = 0", "b: set e = 1", "b: set b = false", 'b: set s = ""'),
        *("a: get y", "b: set u = 4.5", "a: exit", "b: exit"),
        *("a: get p", "b: get x"),  # the values that the system sets
        *("a: get y", "a: get m", "a: get f", "a: get c", "b: get y", "b: get m", "b: get f", "b: get c"),
        *("a: get r", "b: get r"),
        *("a: step 0 + 0.5", "a: get y", "a: get m", "a: get f", "a: get c"),
        *("b: set u = 4.5", "b: step 0 + 0.5", "b: get y", "b: get m", "b: get f", "b: get c"),
        *("a: get r", "b: get r"),
        *("a: terminate", "b: terminate", "a: free", "b: free"),
    ]


def test_memory_is_asked_for_by_the_number_of_instances(probes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    @contextmanager
    def asking(size: int) -> Iterator[None]:
        asked.append(size)
        yield

    monkeypatch.setattr("cosim_master.execution.simulate.large_pages", asking)
    probes.fmu()
    for names in ("a", "abc"):
        assert simulate(probes.ssd("".join(map(probes.component, names)), stop=0.5)).outcome == "done"
    assert asked == [100_000, 300_000]


def test_a_chain_of_feed_throughs_is_settled_at_the_start(probes: Any, tmp_path: Path) -> None:
    """Listed against its direction."""
    probes.fmu()
    components = "".join(probes.component(name) for name in "dcb") + probes.component("a", p=1.0, u=1.0)
    wires = ("c/y d/u", "b/y c/u", "a/y b/u")
    assert simulate(probes.ssd(components, *wires, stop=0.5), RunOptions(out=tmp_path / "out")).outcome == "done"
    first = {name: values[0] for name, values in signals(tmp_path / "out").items() if name.endswith(".y")}
    assert first == {"a.y": 2.0, "b.y": 2.25, "c.y": 2.5, "d.y": 2.75}


def test_values_of_every_type_travel(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    components = probes.component("a", u=1.0, n=41, b=True, s="hü") + probes.component("b")
    level = '<ssv:Parameter name="e"><ssv:Integer value="5"/></ssv:Parameter>\n'
    components = components.replace('<ssv:Parameter name="u">', level + '<ssv:Parameter name="u">')
    wires = ("a/y b/u", "a/m b/n", "a/c b/b", "a/r b/s", "a/f b/e")
    assert simulate(probes.ssd(components, *wires, stop=1.0), RunOptions(out=tmp_path / "out")).outcome == "done"
    got = signals(tmp_path / "out")
    assert {name: values for name, values in got.items() if name.startswith("b.")} == {
        "b.y": [1.5] * 3,
        "b.m": [43] * 3,
        "b.c": [True] * 3,
        "b.r": ["hü!!"] * 3,
        "b.f": [5] * 3,
    }


def test_strings_keep_to_the_rates_of_their_instances(tmp_path: Path, probes: Any) -> None:
    """A slow source is seen at the end of its step, not before, as a number is; a slow target takes at the start."""
    clock = """
    from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real, String

    class Clock(Fmi2Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.text, self.heard, self.number, self.input = "0", "-", 0.0, 0.0
            out, discrete = Fmi2Causality.output, Fmi2Variability.discrete
            self.register_variable(String("text", causality=out, variability=discrete))
            self.register_variable(String("heard", causality=Fmi2Causality.input, variability=discrete))
            self.register_variable(String("echo", causality=out, variability=discrete, getter=lambda: self.heard))
            self.register_variable(Real("number", causality=out))
            self.register_variable(Real("input", causality=Fmi2Causality.input))
            self.register_variable(Real("same", causality=out, getter=lambda: self.input))

        def do_step(self, t, h):
            self.number = t + h
            self.text = f"{t + h:g}"
            return True
    """
    slave(tmp_path, "clock_slave.py", textwrap.dedent(clock))
    ports = "text:output heard:input number:output input:input echo:output same:output"
    rates = {"fast": 1.0, "slow": 3.0}
    parts = "".join(probes.workshop.component(n, "Clock.fmu", ports, after=probes.step(h)) for n, h in rates.items())
    pairs = (("fast", "slow"), ("slow", "fast"))
    wires = [f"{a}/{x} {b}/{y}" for a, b in pairs for x, y in (("text", "heard"), ("number", "input"))]
    result = simulate(probes.ssd(parts, *wires, stop=7.0), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert got["slow.text"] == ["0", "0", "0", "3", "3", "3", "6", "7"]
    assert got["fast.text"] == ["0", "1", "2", "3", "4", "5", "6", "7"]
    for name in ("fast", "slow"):
        assert [float(text) for text in got[f"{name}.text"]] == got[f"{name}.number"]
        assert [float(text) for text in got[f"{name}.echo"][1:]] == got[f"{name}.same"][1:]


def test_more_rows_of_strings_than_a_block_holds(probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim_master.stepping.plan._BLOCK_BYTES", 1)  # sixteen rows, the least
    probes.fmu(step=0.01)
    system = probes.ssd(probes.component("a", s="x"), stop=0.4)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    got = signals(tmp_path / "out")
    assert got["time"] == [k / 100 for k in range(41)]
    assert got["a.r"] == ["x!"] * 41


def test_notes_progress_and_result(probes: Any) -> None:
    probes.fmu()
    started: list[Prepared] = []
    progress: list[Progress] = []
    system = probes.ssd(probes.component("a"), stop=2.0)
    result = simulate(
        system, RunOptions(until=3.0), listener=Listener(prepared=started.append, progress=progress.append)
    )
    (ready,) = started
    assert (ready.clock.base, ready.clock.steps, ready.every) == (500_000_000, 6, 1)
    assert (progress[-1].time, progress[-1].start, progress[-1].stop) == (3.0, 0.0, 3.0)
    assert [p.time for p in progress] == sorted(p.time for p in progress)
    assert (result.outcome, result.error, result.simulated_s) == ("done", None, 3.0)
    assert result.real_time_factor == result.simulated_s / result.wall_s
    assert result.notes == ready.notes


# ---- failures ---------------------------------------------------------------------------------

TAIL = ["b: step 1 + 0.5", "b: get y", "b: get m", "b: get f", "b: get c"]


@pytest.mark.parametrize(
    ("mode", "word", "ending"),
    [
        (
            2,
            "fmi2Discard: it could not step from 1 s to 1.5 s; canGetAndSetFMUstate of a is false, "
            "canGetAndSetFMUstate of b is false",
            ["a: terminate", "b: terminate", "a: free", "b: free"],
        ),
        (3, "fmi2Error", ["b: terminate", "a: free", "b: free"]),
        (4, "fmi2Fatal", ["b: terminate", "b: free"]),
    ],
)
def test_a_step_that_fails(probes: Any, tmp_path: Path, mode: int, word: str, ending: list[str]) -> None:
    """The other finishes its step; what has failed is not terminated; what was recorded until then is there."""
    probes.fmu()
    probes.fmu("other.fmu")
    system = probes.ssd(probes.component("a", mode=mode, when=1.0) + probes.component("b", "other.fmu"))
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    lines = str(result.error).splitlines()
    inputs = "" if mode == 2 else "; its inputs: u = 0, n = 0, b = 0"
    assert lines[0] == f"a: fmi2DoStep failed at t = 1 s: {word}{inputs}"
    assert lines[1:] == ["    tired (39 times)", "    it is over"]
    assert probes.calls[-len(TAIL + ending) :] == TAIL + ending
    assert (result.outcome, result.simulated_s) == ("failed", 1.0)
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["error"]) == ("failed", str(result.error))


def test_two_failures_in_one_step_are_both_reported(probes: Any) -> None:
    probes.fmu()
    probes.fmu("other.fmu")
    parts = probes.component("a", mode=3, when=1.0) + probes.component("b", "other.fmu", mode=4, when=1.0)
    system = probes.ssd(parts)
    message = failed(system)
    assert "a: fmi2DoStep failed at t = 1 s: fmi2Error" in message
    assert "b: fmi2DoStep failed at t = 1 s: fmi2Fatal" in message
    assert probes.calls[-1] == "a: free"


NAN = 'where that is meant, allow it: --set master.nan=allow, or nan="allow" of <master>'
NAN_AT_THE_START = f"a: fmi2GetReal failed at t = 0 s: y is not a number; {NAN}"
NAN_IN_A_STEP = f"a: fmi2GetReal failed at t = 0.5 s: y is not a number; {NAN}; its inputs: u = 0.25, n = 1, b = 1"


@pytest.mark.parametrize(
    ("mode", "when", "told"),
    [
        (3, 1.0, "a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = 0.25, n = 1, b = 1"),
        (5, 1.0, NAN_IN_A_STEP),
        (5, 0.0, NAN_AT_THE_START),
    ],
)
def test_a_failure_tells_the_inputs(probes: Any, mode: int, when: float, told: str) -> None:
    probes.fmu()
    probes.fmu("other.fmu")
    parts = probes.component("a", mode=mode, when=when) + probes.component("b", "other.fmu")
    message = failed(probes.ssd(parts, "b/y a/u", "b/m a/n", "b/c a/b"))
    assert message.splitlines()[0] == told


@pytest.mark.parametrize(
    ("mode", "when", "at", "told"),
    [
        (3, 1.0, 0.5, "a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = -2.5, n = 3, b = 1"),
        (3, 1.0, 1.5, "a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = 1.5, n = 0, b = 1"),
        (
            5,
            1.0,
            0.5,
            f"a: fmi2GetReal failed at t = 0.5 s: y is not a number; {NAN}; its inputs: u = -2.5, n = 3, b = 1",
        ),
        (5, 0.0, 0.5, f"a: fmi2GetReal failed at t = 0 s: y is not a number; {NAN}; its inputs: u = 1.5, n = 0, b = 1"),
    ],
)
def test_a_failure_tells_unconnected_inputs(probes: Any, mode: int, when: float, at: float, told: str) -> None:
    """As the system, a change during the run, or else the FMU has set them."""
    probes.fmu()
    system = probes.ssd(probes.component("a", mode=mode, when=when, u=1.5, b=True))
    message = failed(system, at=[(at, "a.u", "-2.5"), (at, "a.n", "3")])
    assert message.splitlines()[0] == told


def test_a_failure_tells_connected_and_unconnected_inputs(probes: Any) -> None:
    probes.fmu()
    probes.fmu("other.fmu")
    parts = probes.component("a", mode=3, when=1.0, n=7) + probes.component("b", "other.fmu")
    message = failed(probes.ssd(parts, "b/y a/u"), at=[(0.5, "a.b", "true")])
    assert message.splitlines()[0] == "a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = 0.25, n = 7, b = 1"


def test_a_warning_is_no_failure(probes: Any) -> None:
    probes.fmu()
    assert simulate(probes.ssd(probes.component("a", mode=1))).outcome == "done"


@pytest.mark.parametrize(("when", "rows"), [(0.0, None), (1.0, [0.0, 0.5])])
def test_an_output_that_is_no_number(probes: Any, tmp_path: Path, when: float, rows: list[float] | None) -> None:
    probes.fmu()
    message = failed(probes.ssd(probes.component("a", mode=5, when=when)), out=tmp_path / "out")
    t = 0 if rows is None else rows[-1]
    assert message.startswith(f"a: fmi2GetReal failed at t = {t:g} s: y is not a number; where that is meant, ")
    assert probes.calls[-2:] == ["a: terminate", "a: free"]
    if rows is None:
        assert not (tmp_path / "out" / "manifest.json").exists()
    else:
        assert signals(tmp_path / "out")["time"] == rows


def test_a_string_that_cannot_be_got(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    message = failed(probes.ssd(probes.component("a", mode=13, when=1.0)), out=tmp_path / "out")
    assert message == "a: fmi2GetString failed at t = 1 s: fmi2Error"
    assert probes.calls[-1] == "a: free"
    assert signals(tmp_path / "out")["a.r"] == ["!", "!"]


def test_a_failure_while_initializing_frees_everything(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    system = probes.ssd(probes.component("a") + probes.component("b", mode=10) + probes.component("c"))
    assert failed(system, out=tmp_path / "out") == (
        "b: fmi2ExitInitializationMode failed at t = 0 s: fmi2Error\n    no way out"
    )
    assert probes.calls[-6:] == ["a: exit", "b: exit", "a: terminate", "a: free", "b: free", "c: free"]


def test_a_failure_to_terminate(probes: Any, tmp_path: Path) -> None:
    """Results are complete by then."""
    probes.fmu()
    system = probes.ssd(probes.component("a", mode=12) + probes.component("b"))
    assert failed(system, out=tmp_path / "out").startswith("a: fmi2Terminate failed at t = 2 s: fmi2Error")
    assert probes.calls[-4:] == ["a: terminate", "b: terminate", "a: free", "b: free"]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "failed"
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_an_fmu_that_aborts_when_freed(probes: Any, tmp_path: Path) -> None:
    """The process is gone then, but its results are on disk."""
    probes.fmu()
    system = probes.ssd(probes.component("a", mode=11))
    command = [
        sys.executable,
        "-c",
        "from cosim_master.cli import main; main()",
        "run",
        str(system),
        "-o",
        "out",
        *HERE,
    ]
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "error: a: fmi2FreeInstance failed at t = 2 s: " in done.stderr
    assert "crashed (SIGABRT)" in done.stderr
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "done"


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(("mode", "number"), [(14, signal.SIGABRT), (15, signal.SIGSEGV)])
def test_an_fmu_that_crashes_in_a_step(
    probes: Any, tmp_path: Path, forks: Forks, mode: int, number: signal.Signals
) -> None:
    """It takes the process with it; who it was is said, and the rows up to there and the manifest are on disk."""
    probes.fmu()
    probes.fmu("other.fmu", guid="other")
    parts = probes.component("a") + probes.component("b", "other.fmu", mode=mode, when=1.0)
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}
    done = forks.run(["run", str(probes.ssd(parts)), "-o", "out", *HERE], tmp_path, environment)
    assert done.returncode == 1
    text = f"b: fmi2DoStep failed at t = 1 s: other.fmu crashed ({number.name}) and takes the process with it"
    assert f"error: {text}" in done.stderr
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["error"], manifest["simulated_s"]) == ("failed", text, 1.0)


# ---- Ctrl-C -----------------------------------------------------------------------------------


def test_ctrl_c_ends_a_run_after_a_complete_step(probes: Any, tmp_path: Path) -> None:
    """The probe raises the signal itself, in its step at 0.5 s."""
    probes.fmu()
    before = signal.getsignal(signal.SIGINT)
    system = probes.ssd(probes.component("a", mode=6, when=0.5), stop=1e6)
    result = simulate(system, RunOptions(out=tmp_path / "out", pace=1e5))
    assert (result.outcome, result.error) == ("interrupted", None)
    assert signal.getsignal(signal.SIGINT) is before
    times = signals(tmp_path / "out")["time"]
    assert times == [k / 2 for k in range(len(times))]
    assert times[-1] == result.simulated_s >= 1.0
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "interrupted"
    assert probes.calls[-2:] == ["a: terminate", "a: free"]


def test_ctrl_c_from_a_terminal(probes: Any, tmp_path: Path) -> None:
    """A signal from outside, at whatever moment: the recording is complete up to a step, the exit code is 130."""
    probes.fmu(step=0.001)
    system = probes.ssd(probes.component("a"), stop=1e6)
    command = [
        sys.executable,
        "-c",
        "from cosim_master.cli import main; main()",
        "run",
        str(system),
        "-o",
        "out",
        *HERE,
    ]
    running = subprocess.Popen([*command, "--pace", "1"], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    log = tmp_path / "calls.txt"
    while running.poll() is None and not (log.exists() and "step 0.05 " in log.read_text()):
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=300)
    assert running.returncode == 130, errors
    assert "Traceback" not in errors
    times = signals(tmp_path / "out")["time"]
    assert times == [k / 1000 for k in range(len(times))] and len(times) > 50
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["simulated_s"]) == ("interrupted", times[-1])
    assert probes.calls[-2:] == ["a: terminate", "a: free"]


def test_ctrl_c_does_not_strike_the_python_code_of_an_fmu(tmp_path: Path, probes: Any) -> None:
    source = """
    import os, signal
    from pythonfmu import Fmi2Causality, Fmi2Slave, Real

    class Pressed(Fmi2Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.y = 0.0
            self.register_variable(Real("y", causality=Fmi2Causality.output))

        def do_step(self, t, h):
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(1000):
                self.y += 1.0
            return True
    """
    slave(tmp_path, "pressed_slave.py", textwrap.dedent(source))
    system = probes.ssd(probes.workshop.component("a", "Pressed.fmu", "y:output", after=probes.step(0.5)), stop=1e6)
    handled = signal.getsignal(signal.SIGINT)
    second = simulate(system, listener=Listener(progress=lambda _: os.kill(os.getpid(), signal.SIGINT)))
    assert second.outcome == "interrupted"  # a second one interrupts whatever is going on
    assert signal.getsignal(signal.SIGINT) is handled
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "interrupted"
    assert signals(tmp_path / "out")["a.y"] == [0.0, 1000.0]


# ---- failures of Python and compiled models ---------------------------------------------------

KERNEL = """
from cosim import Model, Output, Parameter, kernel

@kernel
def start(m):
    m.y = 1.0
    return 0

@kernel
def advance(m, t, h):
    m.y += h
    if t >= m.when:
        return 7
    return 0

class {name}(Model):
    \"\"\"Fails with a code of its own.\"\"\"
    step_size = 0.5
    variables = (Output("y", unit="1"), Parameter("when", unit="s", start=1.0))
    kernels = (start, advance)
    errors = {{7: "the quaternion has no length"}}
"""


@pytest.mark.parametrize("interpreted", [False, True], ids=["compiled", "interpreted"])
def test_the_error_code_of_a_kernel(tmp_path: Path, probes: Any, interpreted: bool) -> None:
    name = "CodeInterpreted" if interpreted else "CodeCompiled"
    model(tmp_path, f"{name.lower()}.py", KERNEL.format(name=name), interpreted=interpreted)
    system = probes.ssd(probes.workshop.component("a", f"{name}.fmu", "y:output"))
    message = failed(system, out=tmp_path / "out")
    assert message.startswith("a: fmi2DoStep failed at t = 1 s: fmi2" + ("Fatal" if interpreted else "Error"))
    assert "the quaternion has no length" in message
    assert signals(tmp_path / "out")["a.y"] == [1.0, 1.5, 2.0]


RAISING = """
from cosim import Model, Output

class Raising(Model):
    \"\"\"Raises.\"\"\"
    step_size = 0.5
    variables = (Output("y", unit="1"),)

    def do_step(self, t, h):
        return self.deeper(t)

    def deeper(self, t):
        if t >= 1.0:
            raise ZeroDivisionError("no such quotient")
        return True
"""


def test_the_traceback_of_a_python_model(tmp_path: Path, probes: Any) -> None:
    model(tmp_path, "raising_model.py", RAISING)
    message = failed(probes.ssd(probes.workshop.component("a", "Raising.fmu", "y:output")))
    assert message.startswith("a: fmi2DoStep failed at t = 1 s: fmi2Fatal\n")
    assert "ZeroDivisionError: no such quotient" in message
    assert "raising_model.py" in message and "in deeper" in message


FORGETFUL = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class Forgetful(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        self.y = t
"""


def test_a_python_slave_that_forgets_to_return_true(tmp_path: Path, probes: Any) -> None:
    slave(tmp_path, "forgetful_slave.py", FORGETFUL)
    system = probes.ssd(probes.workshop.component("a", "Forgetful.fmu", "y:output"))
    message = failed(system, step=0.5)
    assert message.splitlines()[0] == (
        "a: fmi2DoStep failed at t = 0 s: fmi2Discard: it requested the end of the run in its first step "
        "(a Python FMU says this when do_step forgets to return True)"
    )


LOGGING = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real
from pythonfmu.enums import Fmi2Status

class Logging(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        self.log("so far, so good", Fmi2Status.error)
        raise KeyError("no such gain")
"""


def test_the_exception_of_a_python_slave_that_has_logged(tmp_path: Path, probes: Any) -> None:
    """pythonfmu's wrapper logs while the exception is pending, which the logger must neither lose nor fail with."""
    slave(tmp_path, "logging_slave.py", LOGGING)
    message = failed(probes.ssd(probes.workshop.component("a", "Logging.fmu", "y:output")), step=0.5)
    first, *said = message.splitlines()
    assert first == "a: fmi2DoStep failed at t = 0 s: fmi2Fatal"
    assert said[0] == "    so far, so good"
    if sys.version_info >= (3, 13):  # before, the wrapper has lost the exception by then
        assert said == ["    so far, so good", "    KeyError: 'no such gain'"]


# ---- what can be settled before anything is loaded --------------------------------------------


def problems(call: Any) -> list[str]:
    with pytest.raises(SystemDescriptionError) as caught:
        call()
    return [problem.message for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"until": 1.3}, "a run of 1.3 s is not a multiple of the base step 0.5 s; try --until 1.5"),
        ({"until": 0.0}, "stop time 0 s is not after start time 0 s"),
        ({"until": float("nan")}, "start and stop time must be whole nanoseconds"),
        ({"until": float("inf")}, "start and stop time must be whole nanoseconds"),
        ({"until": 1e-300}, "stop time 1e-300 s is less than a nanosecond after start time 0 s"),
        ({"until": 1e10}, "a run from 0 s to 1e+10 s: time is counted in ns, up to 4.6e9 s (146 years)"),
        ({"until": 1e300}, "a run from 0 s to 1e+300 s: time is counted in ns, up to 4.6e9 s (146 years)"),
        ({"step": 1e300}, "a run of 2 s is not a multiple of the base step 1e+300 s; try --until 1e+300"),
        (
            {"step": 1e-300},
            "step size 1e-300 s: to count the time of this run exactly takes more than 62 bits; try 1e-09",
        ),
        ({"until": 1e-10}, "start and stop time must be whole nanoseconds"),
        ({"overrides": {"a.q": "1"}}, 'there is no variable "a.q"'),
        ({"record": ["a"]}, '"a" matches no output or local variable; try "a.*", which matches '),
        ({"record": ["a.p"]}, '"a.p" matches no output or local variable: its causality is parameter'),
        ({"record": ["*.nothing"]}, '"*.nothing" matches no output or local variable; '),
    ],
)
def test_options_that_do_not_fit(probes: Any, options: dict[str, Any], message: str) -> None:
    probes.fmu()
    (found,) = problems(lambda: simulate(probes.ssd(probes.component("a")), RunOptions(**options)))
    assert found.startswith(message)
    assert probes.calls == []


def test_connectors_of_systems_are_told_from_signals(probes: Any) -> None:
    probes.fmu()
    work = probes.workshop
    inner = work.system(probes.component("a"), work.connection("a/y", "out"), name="box", connectors="out:output:Real")
    root = work.system(inner, work.connection("box/out", "told"), connectors="told:output:Real")
    system = work.ssd("nested.ssd", root, '<ssd:DefaultExperiment startTime="0" stopTime="1"/>')
    for name in ("told", "box.out"):
        (found,) = problems(lambda name=name: simulate(system, RunOptions(record=[name])))  # type: ignore[misc]
        assert found == (
            f'"{name}" matches no output or local variable: it is a connector of a system, whose value is that of '
            "box.a.y; record this"
        )


@pytest.mark.parametrize("step", [float("nan"), -0.5])
def test_a_step_that_is_none(probes: Any, step: float) -> None:
    probes.fmu(step=None)
    (found,) = problems(lambda: simulate(probes.ssd(probes.component("a")), RunOptions(step=step)))
    assert found == f"a: step size {step} s; it must be a positive number of seconds"


def test_results_need_a_folder(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    (tmp_path / "file").write_text("")
    system = probes.ssd(probes.component("a"))
    assert problems(lambda: simulate(system, RunOptions(out=tmp_path / "file")))[0].startswith(
        "cannot hold the results of a run: "
    )
    assert problems(lambda: simulate(system, RunOptions(out=tmp_path / "file" / "out")))[0].startswith("cannot hold")
    assert probes.calls == []


def recording(probes: Any, attributes: str, inner: str = "") -> Path:
    text = f'<recording xmlns="https://uav-cosim.org/ns/1" {attributes}>{inner}</recording>'
    annotation = probes.workshop.annotation("org.uav-cosim.recording", text)
    made: Path = probes.ssd(probes.component("a"), after=annotation)
    return made


@pytest.mark.parametrize(
    ("attributes", "inner", "message"),
    [
        (
            'interval="0.7"',
            "",
            "recording interval 0.7 s is not a multiple of the base step 0.5 s; try --set recording.interval=0.5",
        ),
        (
            'interval="0.1"',
            "",
            "recording interval 0.1 s is not a multiple of the base step 0.5 s; try --set recording.interval=0.5",
        ),
        ('interval="often"', "", 'interval="often" must be a number from 0 to 1e+06'),
        ('packets="yes"', "", 'packets="yes": valid are true, false'),
        ('every="3"', "", "attribute every: valid are interval, packets, signals"),
        ("", "<more/>", "<more> is unknown here: valid are no elements"),
    ],
)
def test_recording_annotations_that_are_wrong(probes: Any, attributes: str, inner: str, message: str) -> None:
    probes.fmu()
    system = recording(probes, attributes, inner)
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system)
    (problem,) = caught.value.problems
    assert problem.message == message
    lines = system.read_text().splitlines()
    assert problem.where.line is not None
    if "interval" not in attributes or "often" in attributes:
        assert "<recording" in lines[problem.where.line - 1]


def test_all_problems_of_clock_recording_and_network_come_together(probes: Any) -> None:
    probes.fmu()
    system = recording(probes, 'interval="often"')
    assert len(problems(lambda: simulate(system, RunOptions(until=1.3)))) == 2


# ---- pace -------------------------------------------------------------------------------------


def twice(request: Callable[[Control], None]) -> Callable[[Control], None]:
    return lambda control: (request(control), request(control))[0]


class Waiting(Control):
    """Requests that come while the run waits: each after so many waits."""

    def __init__(self, clock: Clock, pace: float | None, requests: Mapping[int, Callable[[Control], None]]) -> None:
        super().__init__(pace)
        self.clock, self.requests, self.waits = clock, requests, 0
        self.requests.get(0, lambda _: None)(self)

    def wait(self, seconds: float) -> None:
        self.clock.sleep(seconds)
        self.waits += 1
        self.requests.get(self.waits, lambda _: None)(self)


class Clock:
    """A time module whose time passes by sleeping and by stepping only."""

    def __init__(self, cost: float) -> None:
        self.now = 100.0
        self.slept: list[float] = []
        self.kept: list[float] = []
        self.cost = cost

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0.0
        self.slept.append(seconds)
        self.now += seconds


def paced(
    monkeypatch: pytest.MonkeyPatch,
    cost: float,
    pace: float | None,
    requests: Mapping[int, Callable[[Control], None]] | None = None,
    periods: tuple[int, ...] = (1,),
) -> tuple[Clock, RunResult, list[int]]:
    """Ten seconds of an execution with base step 10 ms, each of which costs `cost` s."""
    clock = Clock(cost)
    monkeypatch.setattr(pacing, "time", clock)
    reached: list[int] = []

    class Execution:
        over = False
        k = 0

        @property
        def time(self) -> float:
            return self.k / 100

        def advance(self, k: int) -> None:
            k = min(k, 1000)
            clock.now += (k - self.k) * clock.cost
            self.k = k
            reached.append(k)

        def progressed(self, progress: Progress) -> None:
            assert progress.wall == clock.now - 100.0
            if progress.kept:
                clock.kept.append(clock.now)

        def packet_counts(self) -> dict[str, int]:
            return {"sent": 0}

    ready: Any = SimpleNamespace(clock=TimeGrid(0, 10_000_000, 1000, periods), notes=())
    execution: Any = Execution()
    control = Waiting(clock, pace, requests or {})
    return clock, pacing.run(execution, ready, Gateways([], lambda _: None), execution, control=control), reached


@pytest.mark.parametrize("pace", [0.5, 1.0, 4.0])
def test_a_pace_is_held_by_sleeping(monkeypatch: pytest.MonkeyPatch, pace: float) -> None:
    clock, result, reached = paced(monkeypatch, 0.001, pace)
    assert reached[-1] == 1000
    assert result.wall_s == pytest.approx(10.0 / pace, abs=0.03)
    assert sum(clock.slept) == pytest.approx(10.0 / pace - 1.0, abs=0.03)
    assert max(clock.slept) <= 0.05  # never deaf to Ctrl-C for long
    assert result.overruns == Overruns(0, 0.0)


@pytest.mark.parametrize(("periods", "points"), [((1,), [1, 2, 3]), ((4, 6), [4, 6, 8]), ((5, 10), [5, 10, 15])])
def test_a_paused_run_makes_single_steps(
    monkeypatch: pytest.MonkeyPatch, periods: tuple[int, ...], points: list[int]
) -> None:
    """From one communication point to the next; then it goes on at its pace, as if it had begun there."""
    requests = {0: Control.pause, 3: Control.step, 6: twice(Control.step), 9: Control.resume}
    _, result, reached = paced(monkeypatch, 0.001, 1.0, requests, periods)
    assert reached[:3] == points
    assert reached[-1] == 1000 and len(reached) > 300
    assert result.wall_s == pytest.approx(9 * 0.05 + 10.0 - points[-1] / 100, abs=0.1)
    assert result.overruns == Overruns(0, 0.0)


def test_the_speed_changes_while_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a tenth of real time to four times of it. Only a pace that was given is missed, not a speed set later."""
    requests = {100: lambda control: control.set_speed(4.0)}
    clock, result, _ = paced(monkeypatch, 0.001, 0.1, requests)
    slow = sum(clock.slept[:100])
    assert 3.0 < slow <= 5.0
    assert result.wall_s == pytest.approx(slow + (10.0 - slow / 10) / 4.0, abs=0.2)
    _, result, _ = paced(monkeypatch, 0.02, 0.1, {20: lambda control: control.set_speed(4.0)})
    assert result.wall_s > 15.0  # it cannot go so fast
    assert result.overruns == Overruns(0, 0.0)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_is_positive(factor: float) -> None:
    control = Control(2.0)
    with pytest.raises(ValueError, match=r"speed (0\.0|-1\.0|nan|inf): give a positive factor of real time"):
        control.set_speed(factor)
    assert control.factor == 2.0
    control.set_speed(None)
    assert control.factor is None


def test_a_pace_that_cannot_be_held_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, result, _ = paced(monkeypatch, 0.02, 1.0)
    assert clock.slept == []
    assert result.wall_s == pytest.approx(20.0)
    assert result.overruns.count > 100
    assert result.overruns.worst_s == pytest.approx(10.0, abs=0.05)


def test_without_a_pace_nothing_sleeps_and_python_looks_in_about_twenty_times_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, result, reached = paced(monkeypatch, 0.001, None)
    assert clock.slept == []
    assert result.wall_s == pytest.approx(1.0)
    assert 15 <= len(reached) <= 40


@pytest.mark.parametrize(
    ("cost", "pace"), [(0.001, None), (0.02, None), (0.3, None), (0.001, 0.05), (0.02, 1.0), (0.002, 1e5)]
)
def test_what_is_recorded_is_kept_twice_a_second(
    monkeypatch: pytest.MonkeyPatch, cost: float, pace: float | None
) -> None:
    """Whether it steps fast, slowly, or waits: half a second, and at most a step or the slice in which it ends."""
    clock, _, _ = paced(monkeypatch, cost, pace)
    gaps = np.diff([100.0, *clock.kept, clock.now])
    assert len(clock.kept) >= 1
    assert max(gaps) <= 0.5 + max(cost, 0.06)
    assert min(gaps[:-1]) >= 0.5

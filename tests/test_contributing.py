"""The six worked examples of CONTRIBUTING.md: each is put into a copy of the sources, built and run there."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.swap import swap
from tests.master.conftest import Workshop, variable
from tests.master.execution.algorithms.test_convergence import GAIN, MATRIX, START, W1, W2
from tests.master.fmus.linear import Linears, exact, signals
from tests.master.system.settings.test_network import PACKETS, network
from tests.scenarios.flights import copy_of

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
EXAMPLES = {
    title: re.findall(r"^```(python|diff)\n(.*?)^```$", section, re.M | re.S)
    for title, section in (
        part.split("\n", 1) for part in re.split(r"^### ", TEXT.partition("## Where do I add")[2], flags=re.M)[1:]
    )
    if "```" in section
}
RADIO, ALGORITHM, RECORDING, VEHICLE, LAW, COMMAND = EXAMPLES


def put_into(tree: Path, title: str) -> None:
    """Writes the files of an example and makes its changes: each finds its unchanged lines exactly once."""
    for kind, block in EXAMPLES[title]:
        first, body = block.split("\n", 1)
        if kind == "python":
            file = tree / first.removeprefix("# ")
            assert not file.exists()
            file.write_text(body, encoding="utf-8")
            continue
        file = tree / first.removeprefix("--- ")
        text = file.read_text(encoding="utf-8")
        for change in body.split("@@\n"):
            lines = change.splitlines(keepends=True)
            old = "".join(line[1:] for line in lines if line[0] in " -")
            assert text.count(old) == 1, f"{first}: {old!r} occurs {text.count(old)} times"
            text = text.replace(old, "".join(line[1:] for line in lines if line[0] in " +"))
        file.write_text(text, encoding="utf-8")


def copied(folder: Path) -> Path:
    """A copy of the sources."""
    for name in ("cosim", "models", "master"):
        unfinished = shutil.ignore_patterns("*.pyc.*")  # others may just be importing it
        shutil.copytree(ROOT / name, folder / name, ignore=unfinished, copy_function=_copy)
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def _copy(source: str, target: str) -> None:
    """Copies a source with its time; its bytecode, which Python replaces and never changes, is a link."""
    if source.endswith(".pyc"):
        Path(target).symlink_to(source)
    else:
        shutil.copy2(source, target)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    return copied(tmp_path / "tree")


def run(tree: Path, code: str, *arguments: object, interpreted: bool = False) -> str:
    """Runs a program with the packages of the tree; returns its output."""
    paths = [tree, tree / "models", tree / "master", ROOT]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    if interpreted:
        environment["NUMBA_DISABLE_JIT"] = "1"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], env=environment, cwd=tree, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_there_is_one_example_for_each_of_six() -> None:
    assert [*EXAMPLES] == [
        "A radio effect",
        "A master algorithm",
        "A recording format",
        "A vehicle",
        "A cooperative law",
        "A MAVLink command of the autopilot",
    ]


@pytest.mark.parametrize("title", EXAMPLES)
def test_an_example_is_short(title: str) -> None:
    """At most two files and one registration (a line or two in a third); the layer in pyproject.toml is apart."""
    files, lines = set(), 0
    for kind, block in EXAMPLES[title]:
        first, body = block.split("\n", 1)
        if first != "--- pyproject.toml":
            files.add(first)
            lines += sum(kind == "python" or line[0] == "+" for line in body.splitlines())
    assert len(files) <= 3
    assert lines < 40


def test_all_examples_keep_the_rules_of_the_house(tree: Path) -> None:
    for title in EXAMPLES:
        put_into(tree, title)
    tools = Path(sys.executable).parent
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(str(tree / one) for one in ("", "models", "master"))}
    for command in (["ruff", "check", "."], ["ruff", "format", "--check", "."], ["lint-imports", "--no-cache"]):
        done = subprocess.run(
            [tools / command[0], *command[1:]], cwd=tree, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr


# ---- radio ---------------------------------------------------------------------------------------------------------

FADING = """
from tests.master.network.test_radio import Air, packet
for distance in (50.0, 100.0, 200.0):
    air = Air({"a": ["a"], "b": ["b"]}, fading=100.0, seed=7)
    air.at("b", 0.0, distance, 0.0)
    for number in range(1000):
        air.send(0, "a", packet(1, number % 256))
    outcomes = air.outcomes()
    assert sum(outcomes.values()) == 1000, outcomes
    print(outcomes["lost: channel"] / 1000)
"""


def test_a_radio_effect(tree: Path) -> None:
    """Oracle: of a Rayleigh channel with path loss of the second power, 1 - exp(-(d / fading)^2) is lost."""
    put_into(tree, RADIO)
    lost = [float(line) for line in run(tree, FADING, interpreted=True).split()]
    assert lost == pytest.approx([1.0 - math.exp(-((d / 100.0) ** 2)) for d in (50.0, 100.0, 200.0)], abs=0.04)


READ_NETWORK = """
import sys
from cosim_master import SystemDescriptionError, check, read_system
from cosim_master.system.settings.network import network_of
for path in sys.argv[1:]:
    try:
        with read_system(path) as structure:
            print(network_of(check(structure)).fading)
    except SystemDescriptionError as error:
        print(*str(error).split())
"""


def test_the_attribute_of_a_radio_effect(tree: Path, agents: Callable[[str], Path]) -> None:
    put_into(tree, RADIO)
    files = [agents(attributes) for attributes in ('latency="0.1"', 'fading="80"', 'fading="-1"')]
    without, fading, negative = run(tree, READ_NETWORK, *files).splitlines()
    assert without == "inf"
    assert "there are no Real outputs vehicle.position[1] to [3] below node a" in fading
    assert 'fading="-1" must be a number from 0 to inf' in negative


@pytest.fixture
def agents(tmp_path: Path) -> Callable[[str], Path]:
    """Writes systems of two radio nodes without positions, with these attributes of <network>."""
    workshop = Workshop(tmp_path)
    ports = [variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String")]
    workshop.fmu("agent.fmu", *ports, step="0.01", extra=PACKETS)
    inner = workshop.component("a", "agent.fmu") + workshop.component("b", "agent.fmu")

    def write(attributes: str) -> Path:
        annotation = workshop.annotation("org.uav-cosim.network", network(attributes))
        return Path(workshop.ssd(f"{hash(attributes)}.ssd", workshop.system(inner, after=annotation)))

    return write


# ---- algorithm and recording ---------------------------------------------------------------------------------------

RUN_ALL = """
import sys
from pathlib import Path
from cosim_master import RunOptions, simulate
for system, out in zip(sys.argv[1::2], sys.argv[2::2]):
    result = simulate(system, RunOptions(out=Path(out)))
    assert result.outcome == "done", result.error
"""


def oscillators(folder: Path, step: float, master: str) -> Path:
    """Two coupled oscillators, each of which solves its own equation exactly; a row every 0.01 s."""
    folder.mkdir()
    linears = Linears(Workshop(folder), folder)
    linears.fmu()
    parts = linears.component("a", x0=START[0], v0=START[1], w2=W1, gain=GAIN, step=step)
    parts += linears.component("b", x0=START[2], v0=START[3], w2=W2, gain=GAIN, step=step)
    return linears.ssd(parts, "b/y a/u", "a/y b/u", master=master, stop=2.0, interval=0.01)


def test_a_master_algorithm(tree: Path, tmp_path: Path) -> None:
    """Against the closed form: of order 2, where Gauss-Seidel is of order 1."""
    put_into(tree, ALGORITHM)
    steps = [0.005 / 2**n for n in range(4)]
    folders = [tmp_path / f"{n}" for n in range(4)]
    systems = [
        oscillators(folder, step, 'algorithm="alternating" order="a b"/>')
        for folder, step in zip(folders, steps, strict=True)
    ]
    run(tree, RUN_ALL, *(one for system in systems for one in (system, system.parent / "out")))
    errors = []
    for system in systems:
        got = signals(system.parent / "out")
        wanted = exact(MATRIX, START, got["time"])
        errors.append(max(abs(got["a.y"] - wanted[:, 0]).max(), abs(got["b.y"] - wanted[:, 2]).max()))
    assert [math.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2.0] * 3, abs=0.1), errors


RECORD = """
import sys
from pathlib import Path
from cosim_master import RunOptions, simulate
from cosim_master.results.recording.csv_recorder import CsvRecorder
file = Path(sys.argv[3])
options = RunOptions(out=Path(sys.argv[2]))
result = simulate(sys.argv[1], options, observers=[lambda view: CsvRecorder(view, file, 0.02)])
assert result.outcome == "done", result.error
"""


def test_a_recording_format(tree: Path, tmp_path: Path) -> None:
    """Every second row of signals.parquet, to the bit."""
    put_into(tree, RECORDING)
    system, file = oscillators(tmp_path / "system", 0.005, ""), tmp_path / "rows.csv"
    run(tree, RECORD, system, tmp_path / "out", file)
    table, written = pq.read_table(tmp_path / "out" / "signals.parquet"), pc.read_csv(file)
    assert written.column_names == table.column_names
    assert written.num_rows == 101
    assert written.to_pydict() == table.take(list(range(0, 201, 2))).to_pydict()


# ---- vehicle and law -----------------------------------------------------------------------------------------------

BUILD = """
import sys
from pathlib import Path
from cosim.build import build, models_of_package
(model,) = (one for one in models_of_package("cosim_models") if one.__name__ == sys.argv[1])
print(build(model, Path(sys.argv[2])).file)
"""


def test_a_vehicle(tree: Path, tmp_path: Path) -> None:
    """At 0.9 of its motors' speed it climbs, and feels nothing but its thrust: 0.9^2 of 2.25 times its weight."""
    put_into(tree, VEHICLE)
    fmu = Path(run(tree, BUILD, "Crazyflie", tmp_path).strip())
    commands = {f"motor[{i}]": "0.9" for i in range(1, 5)}
    result = simulate(fmu, RunOptions(out=tmp_path / "out", until=1.0, overrides=commands))
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    (force,) = (got[name][-1] for name in got if name.endswith("specific_force[3]"))
    (down,) = (got[name][-1] for name in got if name.endswith(".position[3]"))
    assert force == pytest.approx(-2.25 * 0.9**2 * 9.80665, rel=1e-9)
    assert down < -2.0


def test_a_cooperative_law(tree: Path, fmus: Path, tmp_path: Path) -> None:
    """The line of five closes up to 15 m behind the first drone."""
    put_into(tree, LAW)
    fmu = Path(run(tree, BUILD, "PlatoonAgent", tmp_path).strip())
    system = copy_of("line5", tmp_path, fmus)
    swap(system, "drone*.agent", fmu)
    result = simulate(
        system, RunOptions(out=tmp_path / "out", until=60.0, overrides={"drone5.agent.stubborn": "false"})
    )
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    east = [got[f"drone{i}.vehicle.position[2]"][-1] for i in range(1, 6)]
    assert east == pytest.approx([0.0, 15.0, 30.0, 45.0, 60.0], abs=1.0)


# ---- command -------------------------------------------------------------------------------------------------------

TERMINATE = """
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from tests.models.copter import Copter
copter = Copter()
copter.tick()
copter.m["armed"], copter.m["on_ground"] = True, False
for param1 in (0.5, 1.0):
    answer = copter.ask(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, param1)[0]
    print(answer, bool(copter.m["armed"]), bool(copter.m["on_ground"]))
"""


def test_a_command_of_the_autopilot(tree: Path) -> None:
    """MAV_RESULT is FAILED (4) and nothing happens; then ACCEPTED (0), and it is disarmed in the air."""
    put_into(tree, COMMAND)
    assert run(tree, TERMINATE, interpreted=True).splitlines() == [
        "('ACK', 185, 4) True False",
        "('ACK', 185, 0) False True",
    ]

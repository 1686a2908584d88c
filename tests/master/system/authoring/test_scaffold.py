"""Starting points of models and channels: short, documented, and they work by the commands that they contain."""

from __future__ import annotations

import itertools
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master import signals
from cosim_master.diagnostics.errors import SystemDescriptionError, WriteFailed
from cosim_master.system import shipped
from cosim_master.system.authoring.scaffold import commands_of, new_model
from tests.master.forks import Forks
from tests.master.full_disk import room_of

MODELS = {"agent": ("my_law.py", "MyLaw"), "model": ("my_vehicle.py", "MyVehicle")}
NAMES = MODELS | {"channel": ("my_channel.py", "my_channel")}


def test_there_is_one_for_an_agent_a_vehicle_and_a_channel() -> None:
    assert shipped.templates().keys() == NAMES.keys()


@pytest.mark.parametrize("kind", NAMES)
def test_a_starting_point_is_short_and_named_by_its_file(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file, name = NAMES[kind]
    assert new_model(kind, Path("own") / file) == name
    text = (tmp_path / "own" / file).read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    assert "$" not in text and ("\ndef channel(" in text or f"\nclass {name}(Model):\n" in text)
    done = subprocess.run(
        [
            Path(sys.executable).parent / "ruff",
            "check",
            "--isolated",
            "--select",
            "E,F,W,B,UP",
            "--line-length",
            "120",
            tmp_path / "own" / file,
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
@pytest.mark.usefixtures("fmus")
@pytest.mark.parametrize("kind", MODELS)
def test_its_own_commands_build_and_fly_it(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forks: Forks
) -> None:
    monkeypatch.chdir(tmp_path)
    new_model(kind, Path(NAMES[kind][0]))
    build, swap, run = commands_of(Path(NAMES[kind][0]))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = forks.shell("\n".join((build, swap, f"{run} --strict")), tmp_path, {**os.environ, "PATH": path})
    assert done.returncode == 0, f"{done.args}\n{done.stdout}\n{done.stderr}"
    table = signals(tmp_path / "out" / "flight")
    last = {n: [table[f"drone{n}.vehicle.position[{i}]"][-1].as_py() for i in (1, 2)] for n in range(1, 6)}
    if kind == "agent":
        sides = [math.dist(last[a], last[b]) for a, b in itertools.pairwise([1, 2, 3, 4, 5, 1])]
        assert sides == pytest.approx([30.0] * 5, abs=1.0)
    else:
        assert [east for _, east in last.values()] == pytest.approx([0.0, 25.0, 50.0, 75.0, 100.0], abs=1.0)


@pytest.mark.usefixtures("fmus")
def test_a_channel_changes_a_run_by_its_own_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forks: Forks
) -> None:
    """In line5, neighbours are 10 to 50 m apart: each link loses (1 - exp(-(d / 60 m)^2))^3 of its packets."""
    monkeypatch.chdir(tmp_path)
    new_model("channel", Path("my_channel.py"))
    (run,) = commands_of(Path("my_channel.py"))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = forks.shell(f"{run} --until 40", tmp_path, {**os.environ, "PATH": path})
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    table = signals(tmp_path / "out" / "flight")
    times = np.array(table["time"])
    places = {n: np.array([np.array(table[f"drone{n}.vehicle.position[{i}]"]) for i in (1, 2, 3)]) for n in range(1, 6)}
    sent = pq.read_table(tmp_path / "out" / "flight" / "packets.parquet").to_pylist()
    by_radio = [one for one in sent if one["outcome"] in ("radio", "lost: own channel")]
    expected = variance = 0.0
    for one in by_radio:
        a, b = (int(one[end][5]) for end in ("source", "target"))
        at = min(int(np.searchsorted(times, one["sent"])), len(times) - 1)
        p = math.exp(-((np.linalg.norm(places[a][:, at] - places[b][:, at]) / 60.0) ** 2))
        expected += (1.0 - p) ** 3
        variance += (1.0 - p) ** 3 * (1.0 - (1.0 - p) ** 3)
    lost = sum(one["outcome"] != "radio" for one in by_radio)
    assert lost > 50 and abs(lost - expected) < 5.0 * math.sqrt(variance)
    late = {round(one["arrival"] - one["sent"] - 0.02, 6) for one in by_radio if one["outcome"] == "radio"}
    assert late == {0.0, 0.05, 0.1}


def test_requests_that_are_refused(tmp_path: Path) -> None:
    def refused(kind: str, file: Path) -> str:
        with pytest.raises(SystemDescriptionError) as caught:
            new_model(kind, file)
        return str(caught.value)

    assert refused("law", tmp_path / "a.py") == "law: is not a kind of file; valid: agent, channel, model"
    for name in ("law.txt", "my-law.py", "class.py"):
        assert "is not the name of a Python module: give one such as my_law.py" in refused("agent", tmp_path / name)
    assert "become C identifiers and must be ASCII" in refused("agent", tmp_path / "höhe.py")
    (tmp_path / "there.py").touch()
    assert refused("agent", tmp_path / "there.py") == f"{tmp_path / 'there.py'}: exists already"
    with pytest.raises(WriteFailed, match=r"law\.py: cannot be written: "):
        new_model("agent", tmp_path / "there.py" / "law.py")


def test_a_full_disk_leaves_no_part_of_a_file(tmp_path: Path) -> None:
    """The next attempt would say that it exists already."""
    message = r"law\.py: cannot be written: File too large"
    with room_of(100), pytest.raises(WriteFailed, match=message):
        new_model("agent", tmp_path / "law.py")
    assert not (tmp_path / "law.py").exists()

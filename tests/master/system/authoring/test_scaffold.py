"""Starting points of models: short, documented, and they build and fly by the commands that they contain."""

from __future__ import annotations

import itertools
import math
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cosim_master import signals
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.system import shipped
from cosim_master.system.authoring.scaffold import commands_of, new_model

NAMES = {"agent": ("my_law.py", "MyLaw"), "model": ("my_vehicle.py", "MyVehicle")}


def test_there_is_one_for_an_agent_and_one_for_a_vehicle() -> None:
    assert shipped.templates().keys() == NAMES.keys()


@pytest.mark.parametrize("kind", NAMES)
def test_a_starting_point_is_short_and_named_by_its_file(kind: str, tmp_path: Path) -> None:
    file, name = NAMES[kind]
    assert new_model(kind, tmp_path / "own" / file) == name
    text = (tmp_path / "own" / file).read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    assert f"\nclass {name}(Model):\n" in text and "$" not in text
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
@pytest.mark.parametrize("kind", NAMES)
def test_its_own_commands_build_and_fly_it(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    new_model(kind, Path(NAMES[kind][0]))
    build, swap, run = commands_of(Path(NAMES[kind][0]))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for command in (build, swap, f"{run} --strict"):
        done = subprocess.run(shlex.split(command), env={**os.environ, "PATH": path}, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    table = signals(tmp_path / "out" / "flight")
    last = {n: [table[f"drone{n}.vehicle.position[{i}]"][-1].as_py() for i in (1, 2)] for n in range(1, 6)}
    if kind == "agent":
        sides = [math.dist(last[a], last[b]) for a, b in itertools.pairwise([1, 2, 3, 4, 5, 1])]
        assert sides == pytest.approx([30.0] * 5, abs=1.0)
    else:
        assert [east for _, east in last.values()] == pytest.approx([0.0, 25.0, 50.0, 75.0, 100.0], abs=1.0)


def test_requests_that_are_refused(tmp_path: Path) -> None:
    def refused(kind: str, file: Path) -> str:
        with pytest.raises(SystemDescriptionError) as caught:
            new_model(kind, file)
        return str(caught.value)

    assert refused("channel", tmp_path / "a.py") == "channel: is not a kind of model; valid: agent, model"
    for name in ("law.txt", "my-law.py", "class.py"):
        assert "is not the name of a Python module: give one such as my_law.py" in refused("agent", tmp_path / name)
    (tmp_path / "there.py").touch()
    assert refused("agent", tmp_path / "there.py") == f"{tmp_path / 'there.py'}: exists already"
    assert "cannot be written: " in refused("agent", tmp_path / "there.py" / "law.py")

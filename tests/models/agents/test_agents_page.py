"""docs/agents.md: its law is built and flown by the commands as printed; its tables are those of the code."""

from __future__ import annotations

import inspect
import os
import re
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest

from cosim.build import build, load_models, models_of_package
from cosim.build.sources import sources_of
from cosim_master.system.authoring.swap import swap
from cosim_master.system.shipped import templates
from cosim_models.agents.kit import agent_variables
from cosim_models.agents.line_agent import LineAgent
from tests.master.forks import Forks
from tests.scenarios.flights import SYSTEMS, fly

PAGE = (Path(__file__).parents[3] / "docs" / "agents.md").read_text(encoding="utf-8")
COMMON = {v.name for v in agent_variables()}


def blocks(kind: str) -> list[tuple[str, str]]:
    """(file, content) of the code blocks of one language."""
    return re.findall(rf"^```{kind}(?: file=(\S+))?\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def table(title: str) -> dict[str, str]:
    """First and second column of the table below a title, code marks left out."""
    text = PAGE.split(f"# {title}\n", 1)[1].split("\n#", 1)[0]
    rows = re.findall(r"^\| (`.+?) \| (.+?) \|", text, re.MULTILINE)
    return {name.replace("`", ""): value for name, value in rows}


@pytest.mark.slow
def test_the_law_flies_as_printed(fmus: Path, tmp_path: Path, forks: Forks) -> None:
    file, content = blocks("python")[0]
    (tmp_path / file).write_text(content)
    ((_, commands),) = blocks("sh")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = forks.shell(commands, tmp_path, {**os.environ, "PATH": path})
    assert done.returncode == 0, done.stderr
    signals = parquet.read_table(tmp_path / "out" / "circle" / "signals.parquet")
    places = np.array([[signals[f"drone{i}.vehicle.position[{k}]"].to_numpy() for k in (1, 2)] for i in range(1, 6)])
    ways = np.roll(places, -1, axis=0) - places
    assert np.hypot(*ways[:, :, -1].T) == pytest.approx(np.full(5, 35.0), abs=1.0)
    centred = places - places.mean(axis=0)
    bearings = np.unwrap(np.arctan2(centred[:, 1], centred[:, 0]), axis=1)
    seconds = int(np.searchsorted(signals["time"].to_numpy(), 50.0))
    assert (bearings[:, -1] - bearings[:, seconds] > np.radians(30.0)).all()  # clockwise


@pytest.mark.slow
def test_own_messages_reach_the_neighbours_as_printed(fmus: Path, tmp_path: Path) -> None:
    """On the ring of `rendezvous`, whose parameter file sets the gain to 0.1: the values follow its Laplacian."""
    file, content = blocks("python")[1]
    (tmp_path / file).write_text(content)
    (model,) = load_models(str(tmp_path / file))
    build(model, tmp_path)
    system = swap(SYSTEMS / "rendezvous", "drone*.agent", tmp_path / "Agreement.fmu", tmp_path / "system")
    first = np.array([1.0, 2.0, 3.0, 4.0, 40.0])
    overrides = {f"drone{n}.agent.first": f"{value}" for n, value in enumerate(first.tolist(), 1)}
    flight = fly(system, tmp_path / "out", overrides={**overrides, "drone*.agent.altitude": "2"}, until=22.5)
    values = np.array([flight[f"drone{n}.agent.value"] for n in range(1, 6)])
    ring = 2.0 * np.eye(5) - np.roll(np.eye(5), 1, axis=0) - np.roll(np.eye(5), -1, axis=0)
    for step in range(12):
        row = int(np.argmin(np.abs(flight["time"] - (20.1 + 0.2 * step))))
        expected = np.linalg.matrix_power(np.eye(5) - 0.1 * ring, step) @ first
        assert values[:, row] == pytest.approx(expected, abs=1e-4)  # single precision, step by step


def test_the_kit_is_among_the_sources_of_a_law_outside_of_the_package(tmp_path: Path) -> None:
    """An FMU of the law is up to date only as long as the kit is the same, and an interpreted one brings it along."""
    _, content = blocks("python")[0]
    file = tmp_path / "pursuit_sources.py"
    file.write_text(content)
    (model,) = load_models(str(file))
    names = sources_of(model).files.keys()
    assert {"pursuit_sources", "cosim_models", "cosim_models.agents.kit", "cosim.packets"} <= names
    assert not any(name.partition(".")[0] in ("numpy", "math", "numba") for name in names)


def test_the_law_has_as_many_lines_as_are_promised() -> None:
    _, content = blocks("python")[0]
    law = content.split("@kernel\n")[1].split("class ")[0].strip().splitlines()
    assert len(law) <= 20


def test_every_parameter_of_the_kit_is_in_the_table() -> None:
    names = {name.replace("[]", "") for name in table("Parameters of every agent")}
    names |= {f"origin_{axis}" for axis in ("latitude", "longitude", "altitude")}
    names = {name for name in names if ", " not in name}
    assert names == {v.name for v in agent_variables() if v.role == "parameter"}


def test_every_law_has_its_parameters_in_a_table() -> None:
    laws = [model for model in models_of_package("cosim_models") if {v.name for v in model.variables} >= COMMON]
    assert len(laws) >= 5
    for model in laws:
        own = {v.name for v in model.variables if v.role == "parameter"} - COMMON
        names = {name.strip() for row in table(model.__name__) for name in row.replace("[]", "").split(",")}
        assert names == own, model.__name__


def test_the_lines_of_laws_and_starting_points_are_counted() -> None:
    rows = re.findall(r"^\| `(.+?)` \| (\d+) \| ?(\d*) \|$", PAGE.split("### Lines of code\n")[1], re.MULTILINE)
    counted = []
    for model in models_of_package("cosim_models"):
        if model is not LineAgent and not {v.name for v in model.variables} >= COMMON:
            continue
        text = Path(inspect.getfile(model)).read_text(encoding="utf-8")
        kernels = "@kernel\n" + text.split("\n@kernel\n", 1)[1].split(f"\nclass {model.__name__}(")[0]
        lines = sum(1 for line in kernels.splitlines() if line.strip())
        counted.append((model.__name__, str(len(text.splitlines())), str(lines)))
    for kind, file in templates().items():
        lines = len(file.read_text(encoding="utf-8").splitlines())
        assert lines < 60
        counted.append((f"new {kind}", str(lines), ""))
    assert sorted(rows) == sorted(counted)


def test_the_tests_of_the_laws_exist_and_every_law_has_them() -> None:
    laws = {
        model.__name__ for model in models_of_package("cosim_models") if {v.name for v in model.variables} >= COMMON
    }
    rows = re.findall(
        r"^\| `?(\w+)`? \| .*?`(test_\w+)` \| (.+)$", PAGE.split("### Tests of the laws\n")[1], re.MULTILINE
    )
    assert {name for name, _, _ in rows} == laws | {"LineAgent", "guard"}
    for name, file, cells in rows:
        text = (Path(__file__).parent / f"{file}.py").read_text(encoding="utf-8")
        named = re.findall(r"`(test_\w+)`", cells)
        assert 2 <= len(named) <= 3, name
        for test in named:
            assert f"\ndef {test}(" in text, (name, test)
        assert '"loss"' in text or "loss=0.2" in text

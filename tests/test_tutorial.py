"""docs/tutorial.md and docs/tutorial.ipynb: their files are written, built and flown exactly as printed."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.master.forks import Forks

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "tutorial.md").read_text(encoding="utf-8")
NOTEBOOK: dict[str, Any] = json.loads((DOCS / "tutorial.ipynb").read_text(encoding="utf-8"))
BLOCK = re.compile(r"^```(\w+)(?: ([^\n]+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
DURATION = re.compile(r"in [\d.]+ s \([\d.]+ times real time\)")


def cells() -> list[str]:
    return ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def law() -> str:
    ((text,),) = [[text] for _, name, text in BLOCK.findall(PAGE) if name == "file=orbit.py"]
    return str(text)


@pytest.fixture(scope="module")
def workshop(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that the tutorial begins in; the notebook goes on in it, so that the law is built once."""
    assert fmus.is_dir()
    return tmp_path_factory.mktemp("tutorial")


def follow(page: str, folder: Path, forks: Forks) -> str:
    """Does what a page says. Lines below a block are among those that its commands print, except durations.

    Returns what the last block printed.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    printed = ""
    for kind, name, text in BLOCK.findall(page):
        if kind == "python":
            (folder / name.removeprefix("file=")).write_text(text, encoding="utf-8")
        elif kind == "sh" and name != "clone":
            done = forks.shell(text, folder, {**os.environ, "PATH": path})
            assert done.returncode == 0, done.stderr
            printed = DURATION.sub("", done.stdout)
        elif kind == "text":
            lines = printed.splitlines()
            assert [line for line in DURATION.sub("", text).splitlines() if line not in lines] == []
    return printed


@pytest.mark.slow
@pytest.mark.parametrize("page", ["first-flight", "own-vehicle", "own-swarm"])
def test_the_other_tutorials(page: str, fmus: Path, tmp_path: Path, forks: Forks) -> None:
    assert fmus.is_dir()
    follow((DOCS / f"{page}.md").read_text(encoding="utf-8"), tmp_path, forks)


@pytest.mark.slow
def test_every_block_prints_what_the_tutorial_shows(workshop: Path, forks: Forks) -> None:
    printed = follow(PAGE, workshop, forks)
    distances = [float(number) for number in re.findall(r"([\d.]+) m at 60 s", printed)]
    assert distances == pytest.approx([8.0] * 6, abs=0.2)


@pytest.mark.slow
def test_the_notebook_runs_cell_by_cell(
    workshop: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workshop)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(cells(), 1):
        exec(compile(cell, f"cell {number} of tutorial.ipynb", "exec"), names)
    assert {name: round(float(distance)) for name, distance in names["final"].items()} == {
        "plain": 20,
        "lossy": 20,
        "guarded": 8,
    }
    assert "plain: done, 0 findings" in capsys.readouterr().out
    assert (workshop / "orbit.png").stat().st_size > 10_000


def test_the_notebook_has_the_law_of_the_tutorial_and_no_outputs() -> None:
    assert f"'''{law()}'''" in cells()[1]
    assert all(cell["outputs"] == [] for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code")
    assert (NOTEBOOK["nbformat"], NOTEBOOK["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in NOTEBOOK["cells"]]
    assert len(set(ids)) == len(ids)


def test_the_law_of_the_tutorial_has_at_most_twenty_lines() -> None:
    body = law().split("@kernel\n")[1].split("class ")[0].strip().splitlines()
    assert len(body) <= 20

"""docs/models.md: its model, its system and its commands work as printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet

from tests.master.forks import Forks

PAGE = (Path(__file__).parents[2] / "docs" / "models.md").read_text(encoding="utf-8")


def blocks(kind: str) -> list[tuple[str, str]]:
    """(file, content) of the code blocks of one language."""
    return re.findall(rf"^```{kind}(?: file=(\S+))?\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_page_works_as_printed(tmp_path: Path, forks: Forks) -> None:
    for file, content in blocks("python") + blocks("xml"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(content)
    ((_, commands),) = blocks("sh")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = forks.shell(commands, tmp_path, {**os.environ, "PATH": path})
    assert done.returncode == 0, done.stderr
    table = parquet.read_table(tmp_path / "out" / "signals.parquet")
    expected = [0.0, *(3.0 * n / 4 for n in (1, 2, 3, 4, 4, 4, 4, 4, 4, 4))]  # four places, one filled a step
    assert np.allclose(table["one.average"].to_numpy(), expected)


def test_the_faults_that_the_page_shows_are_told(tmp_path: Path) -> None:
    ((file, content),) = blocks("python")
    content = content.replace("m.travelled +=", "m.travel +=").replace(
        "m.position[:] = m.speed", "m.position = m.counts"
    )
    content = content.replace('Memory("next"', 'Memory("counts", dtype="i4", shape=3),\n        Memory("next"')
    (tmp_path / file).write_text(content)
    command = [str(Path(sys.executable).with_name("uav-cosim")), "build", file]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    ((_, shown),) = blocks("text")
    assert done.returncode == 2
    assert [line.removeprefix("error: ") for line in done.stderr.splitlines() if "Gauge:" in line] == [
        line.removeprefix("error: ") for line in shown.splitlines()
    ]

"""Flights of the systems we ship: run once, look often."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate

SYSTEMS = Path(__file__).parents[2] / "master" / "systems"
OF_FIVE = ("drone*", "environment.*[?]", "environment.*[1?]")
"""The signals of `windy` that are of its five drones: its airspace has places for hundreds."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A finished run: how it ended, its folder and its signals."""

    result: RunResult
    folder: Path
    signals: dict[str, NDArray[Any]]

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.signals[name]

    def row_of_step(self, step: int, agent: str = "drone3.agent") -> int:
        """The first row in which the agent is at an algorithm step."""
        return int(np.argmax(self.signals[f"{agent}.step"] == step))

    def end_of_step(self, step: int, agent: str = "drone3.agent") -> int:
        """The last row of an algorithm step: by then the drone has come to where the step sent it."""
        return self.row_of_step(step + 1, agent) - 1

    def east(self, drone: int) -> NDArray[Any]:
        return self.signals[f"drone{drone}.vehicle.position[2]"]

    def up(self, drone: int) -> NDArray[Any]:
        return -self.signals[f"drone{drone}.vehicle.position[3]"]


def copy_of(system: str, workshop: Path, fmus: Path, change: Callable[[str], str] = lambda text: text) -> Path:
    """A copy of a shipped system below `workshop`, its root SSD changed; it finds its FMUs as the original does."""
    shutil.copytree(SYSTEMS, workshop / "master" / "systems")
    if not (workshop / "fmus").exists():
        (workshop / "fmus").symlink_to(fmus.resolve())
    folder = workshop / "master" / "systems" / system
    document = folder / "SystemStructure.ssd"
    text = document.read_text(encoding="utf-8")
    changed = change(text)
    document.write_text(changed, encoding="utf-8")
    return folder


def fly(system: Path, out: Path, **options: Any) -> Flight:
    """Run a system to its end; it must succeed."""
    result = simulate(system, RunOptions(out=out, **options))
    assert result.error is None, result.error
    assert result.outcome == "done"
    table = pq.read_table(out / "signals.parquet")
    return Flight(result, out, {name: table[name].to_numpy() for name in table.column_names})


@cache
def plain_line() -> Flight:
    """The flight of `line5` as it is, once in a process; the FMUs must have been built."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return fly(SYSTEMS / "line5", Path(folder.name) / "line5")

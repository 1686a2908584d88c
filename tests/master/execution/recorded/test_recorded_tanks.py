"""The water tanks of the INTO-CPS tutorials, as published: the recorded runs are those of Maestro's loop, to the bit.

They are not part of this project. Clone github.com/INTO-CPS-Association/example-single_watertank and
example-three_tank_watertank with their history, and name the folder of both in the environment variable WATER_TANKS.

Maestro adds its steps up; here, times are exact. The FMUs of 20-sim integrate by steps of their own until the given
time, so that rounding decides whether they make one step more. The loop, written here with FMPy's calls, gives the
recordings with added times and our values with exact times.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import fmpy
import pyarrow.parquet as pq
import pytest
from fmpy.fmi2 import FMU2Slave

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate

FOLDER = Path(os.environ.get("WATER_TANKS", "."))
RUNS = (
    "example-single_watertank/Multi-models/mm/co-sim-51/R_4-28-2017_11-51-48_AM",
    "example-single_watertank/Multi-models/mm/co-sim-51/R_2017_06_07-11_46_06_536",
    "example-single_watertank/Multi-models/mm/co-sim-51/R_2017_06_07-11_57_25_748",
    "example-three_tank_watertank/Multi-models/Non-3D/Experiment1/R_2017_06_08-10_58_06_939",
)
THEN = {
    "R_2017_06_07-11_57_25_748": ("d317c6d", "watertankController-Standalone.fmu"),
}
"""Runs with another FMU than the newest commit has under this name (which is older): the commit that has it."""
pytestmark = [
    pytest.mark.usefixtures("own_cache"),
    pytest.mark.skipif("WATER_TANKS" not in os.environ, reason="WATER_TANKS names no folder with the tutorials"),
]


class Loop:
    """The instances of a multi-model, and Jacobi's exchange between them."""

    def __init__(self, model: Mapping[str, Any], fmus: Path, folder: Path) -> None:
        self.connections = [(source, end) for source, ends in model["connections"].items() for end in ends]
        self.slaves: dict[str, FMU2Slave] = {}
        self.variables: dict[str, Any] = {}
        for key, file in model["fmus"].items():
            self._instantiate(key, fmus / Path(file).name, folder / key.strip("{}"))
        for end, value in model.get("parameters", {}).items():
            self.put(end, value)
        for slave in self.slaves.values():
            slave.enterInitializationMode()
        for end, value in model.get("parameters", {}).items():  # FMUs of 20-sim forget those before
            self.put(end, value)
        self.exchange()
        for slave in self.slaves.values():
            slave.exitInitializationMode()

    def _instantiate(self, key: str, file: Path, folder: Path) -> None:
        description = fmpy.read_model_description(str(file), validate=False)
        unpacked = Path(fmpy.extract(str(file), str(folder)))
        identifier = description.coSimulation.modelIdentifier
        (library,) = (unpacked / "binaries/linux64").glob("*.so")
        library.rename(library.with_name(f"{identifier}.so"))
        ends = [end for pair in self.connections for end in pair if end.startswith(f"{key}.")]
        for name in dict.fromkeys(end.rsplit(".", 1)[0] for end in ends):
            slave = FMU2Slave(
                guid=description.guid, modelIdentifier=identifier, unzipDirectory=str(unpacked), instanceName=name
            )
            slave.instantiate()
            slave.setupExperiment(startTime=0.0, stopTime=1e4)
            self.slaves[name] = slave
            self.variables |= {f"{name}.{one.name}": one for one in description.modelVariables}

    def _call(self, what: str, end: str) -> tuple[Callable[..., Any], list[int]]:
        variable = self.variables[end]
        return getattr(self.slaves[end.rsplit(".", 1)[0]], what + variable.type), [variable.valueReference]

    def get(self, end: str) -> float:
        call, reference = self._call("get", end)
        return float(call(reference)[0])

    def put(self, end: str, value: float) -> None:
        call, reference = self._call("set", end)
        call(reference, [float(value) if self.variables[end].type == "Real" else int(value)])

    def exchange(self) -> None:
        values = {source: self.get(source) for source, _ in self.connections}
        for source, end in self.connections:
            self.put(end, values[source])

    def rows(self, names: list[str], count: int, step: float, *, added: bool) -> Iterator[list[float]]:
        time = 0.0
        for k in range(count):
            yield [self.get(name) for name in names]
            self.exchange()
            for slave in self.slaves.values():
                slave.doStep(time, step)
            time = time + step if added else (k + 1) / round(1 / step)


@pytest.mark.parametrize("run", RUNS)
def test_maestros_loop_with_added_times_is_the_recording_and_with_exact_times_ours(run: str, tmp_path: Path) -> None:
    original = FOLDER / run.partition("/")[0]
    project = Path(shutil.copytree(original, tmp_path / "project", ignore=shutil.ignore_patterns(".git")))
    if (name := Path(run).name) in THEN:
        commit, file = THEN[name]
        command = ["git", "-C", str(original), "show", f"{commit}:FMUs/{file}"]
        (project / "FMUs" / file).write_bytes(subprocess.run(command, check=True, capture_output=True).stdout)
    model, how = (json.loads((FOLDER / run / name).read_text()) for name in ("mm.json", "coe.json"))
    head, *cells = [
        [cell.strip() for cell in row]
        for row in csv.reader((FOLDER / run / "outputs.csv").read_text().splitlines())
        if row
    ]
    names = [name for name in head if name not in ("time", "step-size")]
    words = {"true": 1.0, "false": 0.0}
    recorded = [[float(words.get(row[head.index(n)], row[head.index(n)])) for n in names] for row in cells]
    step = how["algorithm"]["size"]
    found = {}
    for added in (True, False):
        loop = Loop(model, project / "FMUs", tmp_path / str(added))
        found[added] = list(loop.rows(names, len(recorded), step, added=added))
    assert found[True] == recorded
    assert found[False] != recorded
    result = simulate(project / run.partition("/")[2] / "mm.json", RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    count = min(len(recorded), len(got["time"]))
    assert count >= 300
    assert [[float(got[name][k]) for name in names] for k in range(count)] == found[False][:count]

"""Each FMU of ours alone in FMPy, libcosim, Ecos and OMSimulator: the trajectory that our master records.

OMSimulator is not in the package index: OMSIMULATOR names its executable (version 2.1 or 3.0), as for
benchmarks/engines.py.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest
from fmpy.fmi2 import FMU2Slave

from cosim.verdict import Role
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import FmuDescription, describe
from tests.master.conftest import NAMESPACES

STEPS = 50
APART = ("ArduPilotSITL", "LargeAirspace")
"""Not run: it needs ArduPilot's program; it has 28,000 outputs, and the bits of Airspace."""
STEPPER = Path(__file__).with_name("other_engines.py")
LONE = '<network xmlns="https://uav-cosim.org/ns/1" topology="listed"/>'


@dataclass(frozen=True)
class Flight:
    """An FMU of ours, its Real outputs, and their values after each step, as our master records them."""

    file: Path
    step: float
    outputs: list[str]
    values: np.ndarray


def real_outputs(fmu: FmuDescription) -> list[str]:
    """Without optional ones, which are recorded only where they are connected."""
    optional = {name for name, verdict in fmu.verdicts.items() if verdict is Role.OPTIONAL}
    outputs = [v for v in fmu.variables.values() if v.causality == "output" and v.type == "Real"]
    return [v.name for v in outputs if v.name.partition("[")[0] not in optional]


@pytest.fixture(scope="module")
def flights(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Flight]:
    """All FMUs of FMI 2, in one run in which none hears another."""
    folder = tmp_path_factory.mktemp("flights")
    names = [file.stem for file in sorted(fmus.glob("*.fmu")) if ".fmi3" not in file.name]
    names = [name for name in names if name not in APART]
    assert len(names) > 20
    for name in names:
        shutil.copy(fmus / f"{name}.fmu", folder)
    parts = "".join(f'<ssd:Component name="{name}" source="{name}.fmu"/>' for name in names)
    text = (
        f"<ssd:SystemStructureDescription {NAMESPACES} version='1.0' name='all'><ssd:System name='all'><ssd:Elements>"
        f"{parts}</ssd:Elements><ssd:Annotations><ssc:Annotation type='org.uav-cosim.network'>{LONE}</ssc:Annotation>"
        "</ssd:Annotations></ssd:System></ssd:SystemStructureDescription>"
    )
    (folder / "all.ssd").write_text(text)
    described = {name: describe(folder / f"{name}.fmu") for name in names}
    steps = {name: float(fmu.step_size or 0.0) for name, fmu in described.items()}
    result = simulate(folder / "all.ssd", RunOptions(until=STEPS * max(steps.values()), out=folder / "out"))
    assert result.outcome == "done", result.error
    table = pq.read_table(folder / "out" / "signals.parquet")
    times = table["time"].to_numpy()
    made = {}
    for name, fmu in described.items():
        rows = [int(np.argmin(abs(times - (k + 1) * steps[name]))) for k in range(STEPS)]
        assert abs(times[rows] - steps[name] * np.arange(1, STEPS + 1)).max() < 1e-9
        outputs = real_outputs(fmu)
        values = np.array([table[f"{name}.{one}"].to_numpy()[rows] for one in outputs]).T
        assert values.shape == (STEPS, len(outputs)) and np.isfinite(values).all()
        made[name] = Flight(fmu.path, steps[name], outputs, values)
    return made


@cache
def known_to_fmpy(file: Path) -> Any:
    """The description of an FMU as FMPy reads it."""
    return fmpy.read_model_description(str(file), validate=False)


def by_fmpy(flight: Flight) -> np.ndarray:
    step = flight.step
    found = fmpy.simulate_fmu(
        str(flight.file),
        stop_time=STEPS * step,
        step_size=step,
        output_interval=step,
        output=flight.outputs,
        fmi_type="CoSimulation",
        validate=False,
        model_description=known_to_fmpy(flight.file),
    )
    return np.array([found[name][1:] for name in flight.outputs]).T


def by_package(tool: str, flights: dict[str, Flight], folder: Path) -> dict[str, np.ndarray]:
    """All FMUs one after the other in one process of an engine."""
    tasks = [[name, str(one.file), one.step, STEPS, one.outputs] for name, one in flights.items()]
    (folder / "tasks.json").write_text(json.dumps(tasks))
    command = [sys.executable, str(STEPPER), tool, str(folder / "tasks.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    found: dict[str, list[list[float]]] = {}
    for line in done.stdout.splitlines():
        if line.startswith("ROW "):
            _, name, *row = line.split()
            found.setdefault(name, []).append([float(number) for number in row])
    return {name: np.array(rows) for name, rows in found.items()}


def by_omsimulator(flight: Flight, folder: Path) -> np.ndarray:
    """Its rows, without the first one; it may end with a step of 1e-13 s and a row more."""
    step, result = flight.step, folder / f"{flight.file.stem}.csv"
    options = [f"--resultFile={result}", f"--stopTime={STEPS * step}", f"--stepSize={step}", "--mode=cs"]
    command = [os.environ["OMSIMULATOR"], *options, f"--tempDir={folder}", str(flight.file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert result.exists(), done.stdout + done.stderr
    rows = list(csv.reader(result.read_text().splitlines()))
    heads = [f".{head}" for head in rows[0]]  # version 2 begins them with the name of the model
    at = [next(i for i, head in enumerate(heads) if head.endswith(f".{name}")) for name in flight.outputs]
    found = {round(float(row[0]) / step): [float(row[i]) for i in at] for row in rows[1:]}
    return np.array([found[k] for k in range(1, STEPS + 1)])


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["FMPy", "libcosimpy", "ecospy", "OMSimulator"])
def test_every_build_of_fmi_2_gives_our_trajectory(engine: str, flights: dict[str, Flight], tmp_path: Path) -> None:
    if engine == "OMSimulator" and "OMSIMULATOR" not in os.environ:
        pytest.skip("OMSIMULATOR names no executable")
    if engine in ("libcosimpy", "ecospy") and (sys.platform != "linux" or platform.machine() != "x86_64"):
        pytest.skip(f"{engine} has no wheel for this platform")
    if engine == "FMPy":
        found = {name: by_fmpy(flight) for name, flight in flights.items()}
    elif engine == "OMSimulator":
        flights = {name: flight for name, flight in flights.items() if name != "Airspace"}  # five minutes, the same
        found = {name: by_omsimulator(flight, tmp_path) for name, flight in flights.items()}
    else:
        found = by_package(engine, flights, tmp_path)
    for name, flight in flights.items():
        # libcosim's steps are differences of its times, which rounding makes a little longer or shorter than ours
        np.testing.assert_allclose(found[name], flight.values, rtol=1e-9, atol=1e-12, err_msg=name)


def with_a_last_step(flight: Flight, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """The outputs before and after a last step of 1e-13 s, by FMPy."""
    description = known_to_fmpy(flight.file)
    of = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(flight.file), str(folder / flight.file.stem)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    outputs = [of[name] for name in flight.outputs]
    time = 0.0
    for _ in range(STEPS):
        slave.doStep(time, flight.step)
        time += flight.step
    before = np.array(slave.getReal(outputs))
    slave.doStep(time, 1e-13)
    after = np.array(slave.getReal(outputs))
    slave.terminate()
    slave.freeInstance()
    return before, after


def test_a_last_step_of_no_length_changes_nothing(flights: dict[str, Flight], tmp_path: Path) -> None:
    """OMSimulator adds its steps up and makes one of about 1e-13 s at the end, where they fall short."""
    for name, flight in flights.items():
        before, after = with_a_last_step(flight, tmp_path)
        # An estimate and its noise may have moved by what a sample brings, never by one over the root of the step.
        atol = 0.05 if name == "Estimator" else 1e-9
        np.testing.assert_allclose(after, before, rtol=1e-6, atol=atol, err_msg=name)

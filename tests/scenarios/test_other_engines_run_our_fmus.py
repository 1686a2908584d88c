"""Each FMU of ours alone in FMPy, libcosim, Ecos and OMSimulator: the trajectory that our master records.

OMSimulator is not in the package index: OMSIMULATOR names its executable (version 2.1 or 3.0), as for
benchmarks/engines.py.
"""

from __future__ import annotations

import csv
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest
from fmpy.fmi2 import FMU2Slave

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import FmuDescription, describe

STEPS = 50
FMUS = ["Autopilot", "Estimator", "Hexarotor", "LineAgent", "Quadrotor"]
STEPPER = Path(__file__).with_name("other_engines.py")
every_fmu = pytest.mark.parametrize("name", FMUS)


def outputs_of(fmu: FmuDescription) -> list[str]:
    return [v.name for v in fmu.variables.values() if v.causality == "output" and v.type == "Real"]


def ours(file: Path, out: Path) -> tuple[FmuDescription, np.ndarray]:
    """What our master records of all Real outputs, a row after each step."""
    fmu = describe(file)
    assert fmu.step_size is not None
    result = simulate(file, RunOptions(until=STEPS * fmu.step_size, out=out))
    assert result.outcome == "done", result.error
    table = pq.read_table(out / "signals.parquet").to_pydict()
    return fmu, np.array([table[f"{fmu.model_name}.{name}"][1:] for name in outputs_of(fmu)]).T


def by_fmpy(file: Path, fmu: FmuDescription, _folder: Path) -> np.ndarray:
    names, step = outputs_of(fmu), fmu.step_size
    found = fmpy.simulate_fmu(
        str(file), stop_time=STEPS * step, step_size=step, output_interval=step, output=names, fmi_type="CoSimulation"
    )
    return np.array([found[name][1:] for name in names]).T


def by_package(tool: str, file: Path, fmu: FmuDescription) -> np.ndarray:
    command = [sys.executable, str(STEPPER), tool, str(file), repr(fmu.step_size), str(STEPS), *outputs_of(fmu)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = [line.removeprefix("ROW ") for line in done.stdout.splitlines() if line.startswith("ROW ")]
    return np.array([[float(number) for number in row.split()] for row in rows])


def by_omsimulator(file: Path, fmu: FmuDescription, folder: Path) -> np.ndarray:
    """Its rows, without the first one; it may end with a step of 1e-13 s and a row more."""
    step, result = fmu.step_size, folder / "result.csv"
    assert step is not None
    options = [f"--resultFile={result}", f"--stopTime={STEPS * step}", f"--stepSize={step}", "--mode=cs"]
    command = [os.environ["OMSIMULATOR"], *options, f"--tempDir={folder}", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert result.exists(), done.stdout + done.stderr
    rows = list(csv.reader(result.read_text().splitlines()))
    heads = [f".{head}" for head in rows[0]]  # version 2 begins them with the name of the model
    at = [next(i for i, head in enumerate(heads) if head.endswith(f".{name}")) for name in outputs_of(fmu)]
    found = {round(float(row[0]) / step): [float(row[i]) for i in at] for row in rows[1:]}
    return np.array([found[k] for k in range(1, STEPS + 1)])


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["FMPy", "libcosimpy", "ecospy", "OMSimulator"])
@every_fmu
def test_it_gives_our_trajectory(engine: str, name: str, fmus: Path, tmp_path: Path) -> None:
    if engine == "OMSimulator" and "OMSIMULATOR" not in os.environ:
        pytest.skip("OMSIMULATOR names no executable")
    if engine in ("libcosimpy", "ecospy") and (sys.platform != "linux" or platform.machine() != "x86_64"):
        pytest.skip(f"{engine} has no wheel for this platform")
    file = Path(shutil.copy(fmus / f"{name}.fmu", tmp_path))
    fmu, expected = ours(file, tmp_path / "out")
    by = {"FMPy": by_fmpy, "OMSimulator": by_omsimulator}
    found = by[engine](file, fmu, tmp_path) if engine in by else by_package(engine, file, fmu)
    assert expected.shape == (STEPS, len(outputs_of(fmu))) and np.isfinite(expected).all()
    # libcosim's steps are differences of its times, which rounding makes a little longer or shorter than ours
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@every_fmu
def test_a_last_step_of_no_length_changes_nothing(name: str, fmus: Path, tmp_path: Path) -> None:
    """OMSimulator adds its steps up and makes one of about 1e-13 s at the end, where they fall short."""
    file = fmus / f"{name}.fmu"
    description = fmpy.read_model_description(str(file))
    fmu, step = describe(file), float(description.defaultExperiment.stepSize)
    reference = [description.modelVariables[i].valueReference for i in range(len(description.modelVariables))]
    of = {v.name: r for v, r in zip(description.modelVariables, reference, strict=True)}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(file), str(tmp_path / "fmu")),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    outputs = [of[name] for name in outputs_of(fmu)]
    time = 0.0
    for _ in range(STEPS):
        slave.doStep(time, step)
        time += step
    before = np.array(slave.getReal(outputs))
    slave.doStep(time, 1e-13)
    after = np.array(slave.getReal(outputs))
    # An estimate and its noise may have moved by what a sample brings, never by one over the root of the step.
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=0.05 if name == "Estimator" else 1e-9)
    slave.terminate()
    slave.freeInstance()

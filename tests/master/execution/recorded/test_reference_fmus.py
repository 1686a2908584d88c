"""The Modelica Association's Reference FMUs for FMI 2.0, as FMPy runs them, sample by sample.

They are not part of this project. Build them (cmake -DFMI_VERSION=2) from github.com/modelica/Reference-FMUs, and name
the folder with the .fmu files in the environment variable REFERENCE_FMUS; several folders as in PATH.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import FmuDescription, describe

VARIABLE = "REFERENCE_FMUS"


def available() -> list[Path]:
    folders = [Path(folder) for folder in os.environ.get(VARIABLE, "").split(os.pathsep) if folder]
    found = []
    for file in sorted(file for folder in folders for file in folder.rglob("*.fmu")):
        try:
            fmu = describe(file)
        except SystemDescriptionError:
            continue  # Model Exchange only
        if fmu.fmi_version == "2.0":
            found.append(file)
    return found


FILES = available()
pytestmark = pytest.mark.skipif(not FILES, reason=f"no FMI 2.0 Reference FMUs: {VARIABLE} names no folder with them")


def component(workshop: Any, fmu: FmuDescription, name: str) -> str:
    """A component with connectors for all inputs and outputs, of a copy of the FMU."""
    (workshop.root / fmu.path.name).write_bytes(fmu.path.read_bytes())
    made = "".join(
        f"<ssd:Connector name={quoteattr(v.name)} kind={quoteattr(v.causality)}/>"
        for v in fmu.variables.values()
        if v.causality in ("input", "output")
    )
    head = f'<ssd:Component name="{name}" source="{fmu.path.name}">'
    return f"{head}<ssd:Connectors>{made}</ssd:Connectors></ssd:Component>"


def ours(workshop: Any, parts: str, wires: str, stop: float, step: float, out: Path) -> dict[str, Any]:
    experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop!r}"/>'
    inner = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{step!r}"/>'
    stepping = workshop.annotation("org.uav-cosim.stepping", inner)
    system = workshop.system(parts, wires, after=stepping)
    result = simulate(workshop.ssd("reference.ssd", system, experiment), RunOptions(out=out))
    assert result.outcome in ("done", "terminated"), result.error
    columns: dict[str, Any] = pq.read_table(out / "signals.parquet").to_pydict()
    return columns


@pytest.mark.parametrize("divide", [1, 4])
@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_a_reference_fmu_as_fmpy_runs_it(workshop: Any, tmp_path: Path, file: Path, divide: int) -> None:
    fmu = describe(file)
    model = fmpy.read_model_description(str(file), validate=False)
    step = (fmu.step_size or 0.1) / divide
    stop = step * round(float(model.defaultExperiment.stopTime or 1.0) / step)
    columns = ours(workshop, component(workshop, fmu, "one"), "", stop, step, tmp_path / "out")
    outputs = [v.name for v in fmu.variables.values() if v.causality == "output"]
    numbers = [name for name in outputs if fmu.variables[name].type != "String"]
    expected = fmpy.simulate_fmu(
        str(file), validate=False, fmi_type="CoSimulation", stop_time=stop, step_size=step, output_interval=step,
        output=numbers, relative_tolerance=None,
    )  # fmt: skip
    if file.stem == "Stair":  # wants to end at 9 s; FMPy adds a row for that
        assert columns["time"][-1] == pytest.approx(9.0) and expected["time"][-1] == pytest.approx(9.0)
        expected = expected[: len(columns["time"])]
    else:
        assert len(columns["time"]) == round(stop / step) + 1
    assert len(columns["time"]) == len(expected["time"])
    np.testing.assert_allclose(columns["time"], expected["time"], rtol=0, atol=1e-12)
    for name in numbers:
        np.testing.assert_array_equal(np.array(columns[f"one.{name}"], dtype=expected[name].dtype), expected[name])


def test_a_chain_of_feedthroughs(workshop: Any, tmp_path: Path) -> None:
    """Pure Jacobi: what goes in at one communication point has gone through n of them n steps later."""
    files = {file.stem: file for file in FILES}
    if not {"Feedthrough", "Dahlquist"} <= set(files):
        pytest.skip(f"Feedthrough.fmu and Dahlquist.fmu are not in {VARIABLE}")
    source, through = describe(files["Dahlquist"]), describe(files["Feedthrough"])
    parts = component(workshop, source, "source") + "".join(component(workshop, through, f"f{i}") for i in range(4))
    wires = workshop.connection("source/x", "f0/Float64_continuous_input")
    for i in range(3):
        wires += workshop.connection(f"f{i}/Float64_continuous_output", f"f{i + 1}/Float64_continuous_input")
    columns = ours(workshop, parts, wires, 4.0, 0.125, tmp_path / "out")
    x = columns["source.x"]
    for i in range(4):
        chained = columns[f"f{i}.Float64_continuous_output"]
        assert chained[0] == x[0]  # settled while initializing
        assert chained[i + 1 :] == x[: len(x) - i - 1]

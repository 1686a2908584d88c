"""The Modelica Association's Reference FMUs for FMI 3.0, as FMPy runs them, sample by sample, events included.

They are not part of this project. Build them (cmake -DFMI_VERSION=3) from github.com/modelica/Reference-FMUs, and name
the folder with the .fmu files in the environment variable REFERENCE_FMUS; several folders as in PATH.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe

VARIABLE = "REFERENCE_FMUS"


def available() -> list[Path]:
    folders = [Path(folder) for folder in os.environ.get(VARIABLE, "").split(os.pathsep) if folder]
    found = []
    for file in sorted(file for folder in folders for file in folder.rglob("*.fmu")):
        try:
            fmu = describe(file)
        except SystemDescriptionError:
            continue  # Model Exchange or Scheduled Execution only
        if fmu.fmi_version.startswith("3."):
            found.append(file)
    return found


FILES = available()
pytestmark = [
    pytest.mark.skipif(not FILES, reason=f"no FMI 3.0 Reference FMUs: {VARIABLE} names no folder with them"),
    pytest.mark.usefixtures("own_cache"),
]


def expected_text(value: Any) -> str:
    return value.hex() if isinstance(value, bytes) else str(value)


@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_a_reference_fmu_as_fmpy_runs_it(workshop: Any, tmp_path: Path, file: Path) -> None:
    """Event Mode and early return wherever the FMU has them; FMPy's additional rows at events are left out."""
    fmu = describe(file)
    (workshop.root / file.name).write_bytes(file.read_bytes())
    model = fmpy.read_model_description(str(file), validate=False)
    step = fmu.step_size or 0.1
    stop = step * min(round(float(model.defaultExperiment.stopTime or 1.0) / step), 1000)
    inner = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{step!r}"/>'
    stepping = workshop.annotation("org.uav-cosim.stepping", inner)
    system = workshop.system(workshop.component("one", file.name), after=stepping)
    result = simulate(workshop.ssd("reference.ssd", system), RunOptions(out=tmp_path / "out", until=stop))
    assert result.outcome in ("done", "terminated"), result.error
    columns: dict[str, Any] = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    events = fmu.capabilities.hasEventMode and file.stem != "Roberts"  # which declares it and refuses it
    outputs = [v.name for v in model.modelVariables if v.causality == "output" and v.type not in ("String", "Binary")]
    theirs = fmpy.simulate_fmu(
        str(file), validate=False, fmi_type="CoSimulation", start_time=0.0, stop_time=stop, output_interval=step,
        use_event_mode=events, early_return_allowed=events, output=outputs, relative_tolerance=None,
    )  # fmt: skip
    # At an event FMPy has rows before and after it: the last one of a time is what there is after the event.
    times = theirs["time"]
    at = [int(np.flatnonzero(np.abs(times - t) < 1e-9)[-1]) for t in columns["time"]]
    assert len(at) >= (46 if file.stem == "Stair" else round(stop / step)) - 1
    for name in outputs:
        wanted = theirs[name][at]
        names = (
            [f"one.{name}"]
            if wanted.ndim == 1
            else [f"one.{name}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(*wanted.shape[1:])]
        )
        for column, values in zip(names, wanted.reshape(len(at), -1).T, strict=True):
            tolerance = 1e-6 if file.stem == "Roberts" else 0.0  # stiff: where FMPy's sums of steps round otherwise
            np.testing.assert_allclose(
                np.array(columns[column], dtype=float), values.astype(float), tolerance, tolerance
            )

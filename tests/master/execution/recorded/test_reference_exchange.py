"""The Modelica Association's Reference FMUs for Model Exchange, integrated by us and by FMPy's CVODE.

They are not part of this project: name a folder with their .fmu files of FMI 2.0 and 3.0 in the environment variable
REFERENCE_FMUS, several folders as in PATH.
"""

from __future__ import annotations

import os
from pathlib import Path

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe

VARIABLE = "REFERENCE_FMUS"
TOLERANCE = {"Roberts": 1e-4}
RELATIVE = {"Roberts": 1e-6}
"""Tolerances of the solvers, where FMPy takes too many steps with 1e-10."""


def available() -> list[Path]:
    folders = [Path(folder) for folder in os.environ.get(VARIABLE, "").split(os.pathsep) if folder]
    found = []
    for file in sorted(file for folder in folders for file in folder.rglob("*.fmu")):
        try:
            describe(file, implementation="ModelExchange")
        except SystemDescriptionError:
            continue
        found.append(file)
    return found


FILES = available()
pytestmark = pytest.mark.skipif(not FILES, reason=f"no Reference FMUs: {VARIABLE} names no folder with them")


@pytest.mark.parametrize("file", FILES, ids=[f"{file.parent.name}-{file.stem}" for file in FILES])
def test_a_reference_fmu_is_integrated_as_by_fmpy(tmp_path: Path, file: Path) -> None:
    fmu = describe(file, implementation="ModelExchange")
    start, stop = fmu.start_time or 0.0, fmu.stop_time or 1.0
    step = fmu.step_size or stop / 500
    stop = start + step * round((stop - start) / step)
    result = simulate(file, RunOptions(out=tmp_path / "out", until=stop, step=step, solver="cvode:1e-10"))
    assert result.outcome in ("done", "terminated"), result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    outputs = [v.name for v in fmu.variables.values() if v.causality == "output" and v.element is None]
    numbers = [n for n in outputs if fmu.variables[n].type in ("Real", "Integer", "Boolean")]
    expected = fmpy.simulate_fmu(
        str(file), validate=False, fmi_type="ModelExchange", stop_time=stop, output_interval=step,
        relative_tolerance=RELATIVE.get(file.stem, 1e-10), record_events=False, output=numbers,
    )  # fmt: skip
    rows = min(len(got["time"]), len(expected["time"]))
    assert rows >= (stop - (fmu.start_time or 0.0)) / step * 0.85
    np.testing.assert_allclose(got["time"][:rows], expected["time"][:rows], rtol=0, atol=1e-9)
    for name in numbers:
        mine = np.array(got[f"{fmu.model_name}.{name}"][:rows], dtype=float)
        other = np.array(expected[name][:rows], dtype=float)
        np.testing.assert_allclose(mine, other, rtol=0, atol=TOLERANCE.get(file.stem, 1e-5), err_msg=name)

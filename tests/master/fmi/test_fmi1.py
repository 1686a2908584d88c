"""Co-simulation FMUs of FMI 1.0: against FMPy and libcosim, alone and in systems."""

from __future__ import annotations

import json
import subprocess
import sys
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

MASTERS = Path(__file__).parents[2] / "scenarios" / "other_engines.py"


def columns(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def test_the_description(dynamics: Any) -> None:
    fmu = describe(dynamics.fmu("DRIVE", 1))
    assert (fmu.fmi_version, fmu.guid, fmu.model_identifier) == ("1.0", "dynamic", "Dynamic")
    assert fmu.capabilities.canHandleVariableCommunicationStepSize and not fmu.capabilities.canGetAndSetFMUstate
    kinds = {name: (v.causality, v.variability) for name, v in fmu.variables.items()}
    assert kinds["u"] == ("input", "continuous") and kinds["gain"] == ("parameter", "fixed")
    assert fmu.outputs["y"] is None and fmu.variables["gain"].settable and not fmu.variables["y"].settable


def test_as_fmpy_runs_it(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("DRIVE", 1, stop=2.0)
    (tmp_path / "in.csv").write_text("time,u,on,m\n0,0,0,0\n0.5,3,1,0\n1,-1,0,7\n1.5,2,1,7\n")
    result = simulate(
        file, RunOptions(out=tmp_path / "out", step=0.1, inputs=tmp_path / "in.csv", overrides={"gain": "1.5"})
    )
    assert result.outcome == "done", result.error
    got = columns(tmp_path / "out")
    expected = fmpy.simulate_fmu(
        str(file), validate=False, stop_time=2.0, output_interval=0.1, input=fmpy.read_csv(tmp_path / "in.csv"),
        start_values={"gain": 1.5}, output=["x", "y", "latched"],
    )  # fmt: skip
    for name in ("x", "y", "latched"):
        np.testing.assert_allclose(got[f"Drive.{name}"], expected[name], rtol=1e-12, atol=1e-12)
    assert got["Drive.t"] == ["a!"] * 21


def test_as_libcosim_runs_it(dynamics: Any) -> None:
    pytest.importorskip("libcosimpy")
    file = dynamics.fmu("VANDERPOL", 1, stop=1.0)
    tasks = file.with_suffix(".json")
    tasks.write_text(json.dumps([["one", str(file), 0.1, 10, ["x", "y"]]]))
    done = subprocess.run([sys.executable, str(MASTERS), "libcosimpy", str(tasks)], capture_output=True, text=True)
    rows = [[float(x) for x in line.split()[2:]] for line in done.stdout.splitlines() if line.startswith("ROW")]
    assert len(rows) == 10, done.stderr
    simulate(file, RunOptions(out=file.parent / "out", step=0.1))
    got = columns(file.parent / "out")
    mine = np.array([got["Vanderpol.x"][1:], got["Vanderpol.y"][1:]]).T
    np.testing.assert_allclose(mine, rows, rtol=1e-14)


def test_in_a_system_with_fmi_2_and_3(dynamics: Any, workshop: Any, tmp_path: Path) -> None:
    """Reals, Integers, Booleans and Strings cross in both directions."""
    dynamics.fmu("DRIVE", 1, name="a.fmu", stop=1.0)
    dynamics.fmu("DRIVE", 2, "CS", name="b.fmu")
    dynamics.fmu("DRIVE", 3, "CS", name="c.fmu")
    ports = "u:input on:input m:input s:input x:output y:output latched:output t:output"
    parts = "".join(workshop.component(name, f"{name}.fmu", ports) for name in "abc")
    wires = ""
    for start, end in ("ab", "bc", "ca"):
        wires += workshop.connection(f"{start}/x", f"{end}/u") + workshop.connection(f"{start}/latched", f"{end}/m")
        wires += "" if start == "c" else workshop.connection(f"{start}/t", f"{end}/s")
    stepping = '<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="0.1"/>'
    file = workshop.ssd(
        "s.ssd", workshop.system(parts, wires, after=workshop.annotation("org.uav-cosim.stepping", stepping))
    )
    options: dict[str, Any] = {"until": 0.5, "overrides": {"a.gain": "2"}, "at": [(0.1, "a.on", "true")]}
    result = simulate(file, RunOptions(out=tmp_path / "mixed", **options))
    assert result.outcome == "done", result.error
    mixed = columns(tmp_path / "mixed")
    dynamics.fmu("DRIVE", 2, "CS", name="a.fmu")
    simulate(file, RunOptions(out=tmp_path / "same", **options))
    same = columns(tmp_path / "same")
    for name in ("a.x", "b.x", "c.x", "a.latched", "b.latched", "c.latched"):
        assert mixed[name] == pytest.approx(same[name], abs=1e-12), name
    assert mixed["a.latched"][-1] >= 100 and mixed["c.t"][-1] == "a!!!"


def test_discarded_steps_name_functions_of_fmi_1(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("STAIR", 1, stop=12.0)
    result = simulate(file, RunOptions(out=tmp_path / "out", step=1.0))
    assert result.outcome == "failed"
    assert "fmiDoStep failed at t = 9 s" in str(result.error)


def test_what_is_refused(dynamics: Any, tmp_path: Path) -> None:
    import zipfile

    file = dynamics.fmu("DAHLQUIST", 1, stop=1.0)
    with zipfile.ZipFile(file) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    text = members["modelDescription.xml"].decode()
    for old, new, message in (
        ('modelIdentifier="Dynamic"', "", "needs the attribute modelIdentifier"),
        ("Implementation>", "Vendor>", "of FMI 1.0 only co-simulation is supported"),
    ):
        with zipfile.ZipFile(tmp_path / "b.fmu", "w") as archive:
            for name, content in {**members, "modelDescription.xml": text.replace(old, new).encode()}.items():
                archive.writestr(name, content)
        with pytest.raises(SystemDescriptionError, match=message):
            describe(tmp_path / "b.fmu")
    with zipfile.ZipFile(tmp_path / "c.fmu", "w") as archive:
        for name, content in {**members, "modelDescription.xml": text.replace('"dynamic"', '"wrong"').encode()}.items():
            archive.writestr(name, content)
    result = simulate(tmp_path / "c.fmu", RunOptions(step=0.5))
    assert "fmiInstantiateSlave failed: it returned NULL" in str(result.error)
    assert "wrong GUID" in str(result.error)

"""Settings of the master that a run overrides: `--set master.ATTRIBUTE=VALUE`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate

pytestmark = pytest.mark.usefixtures("own_cache")


def test_nan_is_allowed_for_an_fmu_alone(foreigners: Any, tmp_path: Path) -> None:
    """Nobody can annotate an FMU."""
    fmu, out = foreigners.fmu(step=0.25), tmp_path / "out"
    refused = simulate(fmu, RunOptions(out=out, until=1.0, overrides={"silent": "0.5"}))
    assert (refused.outcome, "allow it: --set master.nan=allow" in str(refused.error)) == ("failed", True)
    result = simulate(fmu, RunOptions(out=out, until=1.0, overrides={"silent": "0.5", "master.nan": "allow"}))
    assert result.outcome == "done", result.error
    (name,) = [one for one in pq.read_schema(out / "signals.parquet").names if one.endswith(".y")]
    found = pq.read_table(out / "signals.parquet")[name].to_pylist()
    assert [math.isnan(y) for y in found] == [False, False, True, True, True]
    assert json.loads((out / "manifest.json").read_text())["settings"] == {"master": {"nan": "allow"}}


@pytest.mark.parametrize("written", ["", 'algorithm="jacobi" nan="refuse"/>'])
def test_an_overridden_algorithm_gives_the_bits_of_a_written_one(linears: Any, tmp_path: Path, written: str) -> None:
    def table(name: str, master: str, overrides: dict[str, str]) -> Any:
        linears.fmu()
        parts = linears.component("b", gain=-0.5, rate=3.0, x0=1.0, step=0.1)
        parts += linears.component("a", gain=1.0, rate=-1.0, step=0.1)
        system = linears.ssd(parts, "b/y a/u", "a/y b/u", master=master)
        result = simulate(system, RunOptions(out=tmp_path / name, overrides=overrides))
        assert result.outcome == "done", result.error
        return pq.read_table(tmp_path / name / "signals.parquet")

    overrides = {"master.algorithm": "gauss-seidel", "master.order": "a b"}
    expected = table("written", 'algorithm="gauss-seidel" order="a b"/>', {})
    assert table("overridden", written, overrides).equals(expected)
    assert not table("jacobi", written, {}).equals(expected)


def test_a_run_goes_on_with_another_master_of_the_same_kind(linears: Any, tmp_path: Path) -> None:
    linears.fmu()
    parts = linears.component("b", gain=-0.5, rate=3.0, x0=1.0, step=0.1)
    system = linears.ssd(parts + linears.component("a", gain=1.0, rate=-1.0, step=0.1), "b/y a/u", "a/y b/u")
    whole, origin = tmp_path / "whole", f"{tmp_path / 'whole'}@0.5"
    simulate(system, RunOptions(out=whole, checkpoint_every=0.5))
    algorithm = {"master.algorithm": "richardson"}
    with pytest.raises(SystemDescriptionError, match="its master has steps of another kind"):
        simulate(system, RunOptions(out=tmp_path / "other", origin=origin, overrides=algorithm))
    algorithm = {"master.algorithm": "gauss-seidel"}
    result = simulate(system, RunOptions(out=tmp_path / "seidel", origin=origin, overrides=algorithm))
    assert result.outcome == "done", result.error
    jacobi, seidel = (pq.read_table(tmp_path / name / "signals.parquet").to_pydict() for name in ("whole", "seidel"))
    assert jacobi["b.y"][:6] == seidel["b.y"][:6] and jacobi["b.y"][7:] != seidel["b.y"][7:]


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("nan", "yes", r"--set: master\.nan=yes: valid are refuse, allow"),
        ("nam", "allow", r'--set: there is no setting "master\.nam"; did you mean "master\.nan"\?'),
        ("tolerance", "1e-3", r'--set: tolerance is for algorithm=".*", this is "jacobi"'),
    ],
)
def test_settings_that_cannot_be(linears: Any, name: str, value: str, text: str) -> None:
    linears.fmu()
    with pytest.raises(SystemDescriptionError, match=text):
        simulate(linears.ssd(linears.component("a", step=0.1)), RunOptions(overrides={f"master.{name}": value}))

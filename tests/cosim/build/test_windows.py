"""FMUs for Windows, which are linked without the startup code of the C library (cosim/build/native/windows.h)."""

from __future__ import annotations

import math
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim.build import build, load_models
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import RUNNER
from cosim_master.fmi.slaves.isolated import Isolation

WINE = shutil.which("wine64") or shutil.which("wine")
ONE = """acos acosh asin asinh atan atanh ceil cos cosh degrees erf erfc exp expm1 fabs floor log log10 log1p radians
sin sinh sqrt tan tanh trunc"""
TWO = "atan2 copysign hypot pow"
ARGUMENT = 0.625
"""All functions have a value there but acosh, which takes its inverse."""

MODEL = """
import math

from cosim import Input, Memory, Model, Output, kernel


@kernel
def start(m):
    return 0


@kernel
def advance(m, t, h):
    x = m.u
{body}
    for i in range(64):
        m.copied[i] = m.table[i]
    m.table[:] = m.copied
    s, c = math.sin(x), math.cos(x)
    m.both = s * c
    m.v[int(m.place)] = 1.0
    return 0


class Functions(Model):
    \"\"\"Each function of math.\"\"\"

    step_size = 0.1
    variables = (Input("u", start={argument}), Input("place", start=0.0), Output("y", shape={count}), Output("both"),
                 Output("v", shape=3), Memory("table", shape=64), Memory("copied", shape=64))
    kernels = start, advance
"""


def calls() -> list[str]:
    one = [f"math.{name}({'1.0 / x' if name == 'acosh' else 'x'})" for name in ONE.split()]
    return [*one, *(f"math.{name}(x, 0.3)" for name in TWO.split()), "x % 0.3", "x ** 3.7", "float(round(x))"]


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU with a checked binary of Windows alone."""
    folder = tmp_path_factory.mktemp("functions")
    body = "\n".join(f"    m.y[{n}] = {call}" for n, call in enumerate(calls()))
    text = MODEL.format(body=body, argument=ARGUMENT, count=len(calls()))
    (folder / "functions.py").write_text(text, encoding="utf-8")
    (model,) = load_models(str(folder / "functions.py"))
    return build(model, folder, targets=("windows-x86_64",)).file


def test_it_needs_nothing_but_the_system(fmu: Path) -> None:
    """The names of the libraries that it loads are texts in it."""
    with zipfile.ZipFile(fmu) as archive:
        (name,) = (one for one in archive.namelist() if one.startswith("binaries/"))
        content = archive.read(name)
    assert name == "binaries/win64/Functions.dll"
    needed = {word for word in content.split(b"\0") if word.endswith(b".dll")} - {b"Functions.dll"}
    assert needed == {f"api-ms-win-crt-{part}-l1-1-0.dll".encode() for part in ("heap", "math", "stdio", "string")}


@pytest.mark.skipif(WINE is None, reason="Wine is not installed")
def test_functions_have_their_values_and_errors_their_text(
    fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(RUNNER, str(WINE))
    monkeypatch.setenv("WINEPREFIX", str(tmp_path / "prefix"))
    monkeypatch.setenv("WINEDEBUG", "-all")
    options = RunOptions(out=tmp_path / "out", until=0.2, isolation=Isolation("foreign"))
    assert simulate(fmu, options).outcome == "done"
    last = pq.read_table(tmp_path / "out" / "signals.parquet").to_pylist()[-1]
    found = [next(value for key, value in last.items() if key.endswith(f"y[{n + 1}]")) for n in range(len(calls()))]
    wanted = [eval(call, {"math": math, "x": ARGUMENT, "round": round, "float": float}) for call in calls()]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)
    outside = RunOptions(out=tmp_path / "out2", until=0.2, isolation=Isolation("foreign"), at=[(0.1, "place", "7")])
    text = str(simulate(fmu, outside).error)
    assert "index 7 of m.v[3]" in text and "functions.py:" in text

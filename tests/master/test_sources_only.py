"""FMUs without a binary for this platform are compiled from their sources, and kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim.kernel import cache_folder
from cosim_master.errors import SystemDescriptionError
from cosim_master.fmu import describe
from cosim_master.simulation import simulate
from tests.master.dynamics import SOURCE

pytestmark = pytest.mark.usefixtures("own_cache")
BUILD = """<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="Dynamic">
<SourceFileSet language="C99"><SourceFile name="dynamic.c"/>
<PreprocessorDefinition name="MODEL" value="{}"/><PreprocessorDefinition name="FMI" value="3"/></SourceFileSet>
</BuildConfiguration></fmiBuildDescription>"""


def build(dynamics: Any, fmi: int, text: str, name: str = "s.fmu") -> Path:
    extra = {"sources/dynamic.c": text}
    if fmi == 3:
        extra["sources/buildDescription.xml"] = BUILD.format(1)
    file: Path = dynamics.fmu(
        "DAHLQUIST", fmi, "CS", name=name, stop=1.0, step=0.25, sources=True, binary=False, extra=extra
    )
    return file


@pytest.mark.parametrize("fmi", [2, 3])
def test_sources_are_compiled_once(dynamics: Any, tmp_path: Path, fmi: int) -> None:
    defined = "#define MODEL 1\n#define FMI 2\n" if fmi == 2 else ""
    file = build(dynamics, fmi, f"/* {tmp_path} */\n{defined}{SOURCE.read_text()}")
    note = "it has no binary for this platform: its sources are compiled"
    assert note in describe(file).notes
    result = simulate(file, out=tmp_path / "out")
    assert result.outcome == "done", result.error
    assert any(note in text for text in result.notes)
    binary = dynamics.fmu("DAHLQUIST", fmi, "CS", stop=1.0, step=0.25, name="b.fmu")
    simulate(binary, out=tmp_path / "binary")
    mine, other = (pq.read_table(tmp_path / name / "signals.parquet")["Dahlquist.x"] for name in ("out", "binary"))
    np.testing.assert_allclose(mine.to_numpy(), other.to_numpy(), rtol=1e-14)
    (kept,) = (cache_folder() / "sources").glob(f"{describe(file).digest[:24]}-*.so")
    before = kept.stat().st_mtime_ns
    simulate(file, out=tmp_path / "again")
    assert kept.stat().st_mtime_ns == before


def test_what_the_compiler_says(dynamics: Any, tmp_path: Path) -> None:
    result = simulate(build(dynamics, 2, f"/* {tmp_path} */ int x = ;\n"), out=tmp_path / "out")
    assert result.outcome == "failed"
    assert "Dahlquist: compiling its sources failed: ./dynamic.c: the compiler refused" in str(result.error)
    assert "expected expression" in str(result.error)


def test_neither_binary_nor_sources(dynamics: Any) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, "CS", binary=False)
    with pytest.raises(SystemDescriptionError, match="has no library for this platform"):
        describe(file)

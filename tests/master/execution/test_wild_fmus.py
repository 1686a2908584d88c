"""What FMUs do that are not made for tests. Each is handled, or refused by name."""

from __future__ import annotations

import logging
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe, platform
from cosim_master.fmi.slaves.isolated import Isolation
from tests.master.conftest import SUFFIX, variable
from tests.master.fmus.probe import compiled

pytestmark = pytest.mark.usefixtures("own_cache")


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def changed(fmu: Path, change: Callable[[str, bytes], tuple[str, bytes] | None]) -> Path:
    """The FMU with its members changed: (name, data) to another, or None to leave it out."""
    with zipfile.ZipFile(fmu) as archive:
        members = [change(name, archive.read(name)) for name in archive.namelist()]
    with zipfile.ZipFile(fmu, "w") as archive:
        for member in members:
            if member is not None:
                archive.writestr(*member)
    return fmu


def without(fmu: Path, tmp_path: Path, *functions: str) -> Path:
    """The strict FMU without some functions: their names in its symbol table are others."""

    def rename(name: str, data: bytes) -> tuple[str, bytes]:
        for function in functions:
            if name.startswith("binaries/"):
                assert function.encode() + b"\0" in data
                data = data.replace(function.encode() + b"\0", b"xxx" + function[3:].encode() + b"\0")
        return name, data

    return changed(fmu, rename)


# ---- state in globals -------------------------------------------------------------------------


def test_instances_of_an_fmu_that_keeps_everything_in_globals(
    probes: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """fmi2Instantiate returns the same handle each time; every instance gets a copy of the binary."""
    probes.fmu(guid="global")
    parts = "".join(probes.component(name, p=value) for name, value in (("a", 1.0), ("b", 20.0), ("c", 300.0)))
    with caplog.at_level(logging.WARNING):
        result = simulate(probes.ssd(parts, "a/y b/u", "b/y c/u", stop=2.0), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert (got["a.y"], got["b.y"], got["c.y"]) == ([1.0] * 5, [21.0] * 5, [321.0] * 5)
    notes = [record.getMessage() for record in caplog.records]
    assert notes == ["note: probe.fmu keeps everything in globals: each of its instances gets a copy of it"]


def test_many_files_with_one_guid(probes: Any, tmp_path: Path) -> None:
    """Also of one size and one content but for a parameter: nothing is kept by GUID or by content."""
    for name in "abc":
        probes.fmu(f"{name}.fmu", guid="global")
    parts = "".join(probes.component(name, f"{name}.fmu", p=float(i)) for i, name in enumerate("abc"))
    assert simulate(probes.ssd(parts, stop=1.0), RunOptions(out=tmp_path / "out")).outcome == "done"
    got = signals(tmp_path / "out")
    assert [got[f"{name}.y"][-1] for name in "abc"] == [0.0, 1.0, 2.0]


def test_one_that_says_it_is_good_for_one_instance(probes: Any) -> None:
    probes.fmu(flags='canBeInstantiatedOnlyOncePerProcess="true"')
    system = probes.ssd(probes.component("a") + probes.component("b"))
    with pytest.raises(SystemDescriptionError, match="can be instantiated only once per process"):
        simulate(system)
    assert simulate(system, RunOptions(isolation=Isolation("foreign"))).outcome == "done"
    assert simulate(probes.ssd(probes.component("a"))).outcome == "done"


# ---- what binaries lack -----------------------------------------------------------------------


def test_start_values_that_the_binary_ignores_are_set(stricts: Any, tmp_path: Path) -> None:
    """The strict FMU has no start values of its own, only NaN; the description has."""
    stricts.fmu()
    assert simulate(stricts.ssd(stricts.component("a")), RunOptions(out=tmp_path / "out")).outcome == "done"
    assert stricts.complaints == []
    assert signals(tmp_path / "out")["a.y"] == [0.0] * 5


def test_a_library_with_another_name(stricts: Any, tmp_path: Path) -> None:
    """Old INTO-CPS exports name it after the .fmu file."""

    def rename(name: str, data: bytes) -> tuple[str, bytes]:
        return name.replace("Unit", "Water Tank"), data

    fmu = changed(stricts.fmu(), rename)
    assert any("its library is binaries/" in note for note in describe(fmu).notes)
    assert simulate(stricts.ssd(stricts.component("a"))).outcome == "done"


def test_optional_functions_that_are_missing(stricts: Any, tmp_path: Path) -> None:
    """It says it can restore its state, and cannot: a run that needs no more than the rest goes on as ever."""
    without(stricts.fmu(), tmp_path, "fmi2GetFMUstate", "fmi2SetFMUstate", "fmi2FreeFMUstate", "fmi2GetBooleanStatus")
    assert simulate(stricts.ssd(stricts.component("a"))).outcome == "done"
    result = simulate(stricts.ssd(stricts.component("a", mode=2, longest=0.1)))
    assert str(result.error) == (
        "a: fmi2DoStep failed at t = 0 s: fmi2Discard: it could not step from 0 s to 0.5 s, only to 0.1 s; "
        "canGetAndSetFMUstate of a is false"
    )
    assert stricts.complaints == []


def test_a_missing_function_that_is_needed_is_named(stricts: Any, tmp_path: Path) -> None:
    without(stricts.fmu(), tmp_path, "fmi2SetupExperiment")
    result = simulate(stricts.ssd(stricts.component("a")))
    assert result.outcome == "failed"
    assert "fmi2SetupExperiment failed: the binary of " in str(result.error)


def test_without_terminate(stricts: Any, tmp_path: Path) -> None:
    without(stricts.fmu(), tmp_path, "fmi2Terminate")
    assert simulate(stricts.ssd(stricts.component("a")), RunOptions(out=tmp_path / "out")).outcome == "done"


def test_without_free_instance(stricts: Any, tmp_path: Path) -> None:
    """It is needed, and missed when all is over: the recording is complete, and other FMUs are freed."""
    without(stricts.fmu("other.fmu"), tmp_path, "fmi2FreeInstance")
    stricts.fmu()
    parts = stricts.component("a", "other.fmu") + stricts.component("b")
    result = simulate(stricts.ssd(parts), RunOptions(out=tmp_path / "out"))
    assert (result.outcome, result.simulated_s, stricts.complaints) == ("failed", 2.0, [])
    assert "fmi2FreeInstance failed: the binary of " in str(result.error)
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert stricts.calls[-1] == "b: fmi2FreeInstance"


# ---- names and descriptions -------------------------------------------------------------------


def test_dots_brackets_and_spaces_in_names(workshop: Any, stricts: Any, tmp_path: Path) -> None:
    made = [
        variable("control.in[1]", start="1").replace("'@'", '"0"'),
        variable("gains[2].k p", "parameter", start="1", variability="tunable").replace("'@'", '"1"'),
        variable("der(state.x)", "output").replace("'@'", '"2"'),
        variable("when", "parameter", start="0").replace("'@'", '"3"'),
        variable("longest", "parameter", start="0").replace("'@'", '"4"'),
    ]
    text = workshop.description(made, step=0.5)
    library = compiled(Path(__file__).parents[1] / "fmus" / "strict.c", stricts._folder)
    with zipfile.ZipFile(tmp_path / "my model.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)

    def part(name: str, **values: Any) -> str:
        inner = (
            '<ssd:Connectors><ssd:Connector name="control.in[1]" kind="input"/>'
            '<ssd:Connector name="der(state.x)" kind="output"/></ssd:Connectors>'
        )
        bindings = workshop.bindings(values) if values else ""
        return f'<ssd:Component name="{name}" source="my%20model.fmu">{inner}{bindings}</ssd:Component>'

    parts = part("drone no. 1", **{"gains[2].k p": 2.0}) + part("drone no. 2")
    wire = (
        '<ssd:Connection startElement="drone no. 1" startConnector="der(state.x)" '
        'endElement="drone no. 2" endConnector="control.in[1]"/>'
    )
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="1.5"/>'
    system = workshop.ssd("s.ssd", workshop.system(parts, wire), experiment)
    options: dict[str, Any] = {
        "overrides": {"drone no. 2.gains[2].k p": "3"},
        "at": [(1.0, "drone no. 2.gains[2].k p", "5")],
        "record": ["drone no. *.der(state.x)"],
    }
    result = simulate(system, RunOptions(out=tmp_path / "out", **options))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    got = signals(tmp_path / "out")
    assert got["drone no. 1.der(state.x)"] == [0.0, 1.0, 2.0, 3.0]
    assert got["drone no. 2.der(state.x)"] == [0.0, 0.0, 1.5, 1.5 + 0.5 * 5 * 2.0]


@pytest.mark.parametrize("structure", ["<ModelStructure/>", "<ModelStructure><Outputs/></ModelStructure>"])
def test_an_incomplete_model_structure(stricts: Any, tmp_path: Path, structure: str) -> None:
    """It runs, with a note, and a loop through it is no obstacle."""

    def cut(name: str, data: bytes) -> tuple[str, bytes]:
        if name != "modelDescription.xml":
            return name, data
        head, _, rest = data.partition(b"<ModelStructure>")
        return name, head + structure.encode() + rest.partition(b"</ModelStructure>")[2]

    changed(stricts.fmu(), cut)
    parts = stricts.component("a", u=1.0) + stricts.component("b")
    result = simulate(stricts.ssd(parts, "a/y b/u", "b/y a/u"), RunOptions(out=tmp_path / "out"))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    assert any("has no InitialUnknowns" in note for note in result.notes)
    assert any("a loop of connections runs through it" in note for note in result.notes)


def test_an_fmu_that_needs_what_is_not_there_says_so(stricts: Any) -> None:
    """A binary that the dynamic linker refuses."""

    def spoil(name: str, data: bytes) -> tuple[str, bytes]:
        return name, b"\x7fELF nothing" if name.startswith("binaries/") else data

    fmu = changed(stricts.fmu(), spoil)
    result = simulate(stricts.ssd(stricts.component("a")))
    assert result.outcome == "failed"
    assert f"loading {fmu}" in str(result.error)

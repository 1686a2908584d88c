"""Structural parameters of FMI 3.0: set in Configuration Mode, and arrays have the sizes they say (pitfall 33).

The FMU looks at every call (sized.c): each get and set must have as many values as its arrays have elements.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.cli.views.explanation import explain
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe, platform
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.conftest import SUFFIX
from tests.master.fmus.probe import compiled

pytestmark = pytest.mark.usefixtures("own_cache")

DESCRIPTION = (
    '<fmiModelDescription fmiVersion="3.0" modelName="Sized" instantiationToken="sized">'
    '<CoSimulation modelIdentifier="Unit"/><DefaultExperiment stepSize="0.5"/><ModelVariables>'
    '<UInt64 name="n" valueReference="0" causality="structuralParameter" variability="fixed" start="2" max="16"/>'
    '<UInt64 name="m" valueReference="1" causality="structuralParameter" variability="tunable" start="1"/>'
    '<Float64 name="u" valueReference="2" causality="input" start="0"><Dimension valueReference="0"/></Float64>'
    '<Float64 name="y" valueReference="3" causality="output"><Dimension valueReference="0"/></Float64>'
    '<Int32 name="p" valueReference="4" causality="parameter" variability="fixed" start="1 1">'
    '<Dimension valueReference="0"/><Dimension valueReference="1"/></Int32>'
    '<Int32 name="sums" valueReference="5" causality="output" variability="discrete"><Dimension valueReference="0"/>'
    '</Int32><String name="s" valueReference="6" causality="input"><Dimension valueReference="0"/><Start value="-"/>'
    '</String><String name="t" valueReference="7" causality="output"><Dimension valueReference="0"/></String>'
    '<Boolean name="doubled" valueReference="8" causality="structuralParameter" variability="fixed" start="false"/>'
    '</ModelVariables><ModelStructure><Output valueReference="3" dependencies="2"/>'
    '<Output valueReference="5" dependencies=""/><Output valueReference="7" dependencies="6"/>'
    '<InitialUnknown valueReference="3" dependencies="2"/><InitialUnknown valueReference="5" dependencies=""/>'
    '<InitialUnknown valueReference="7" dependencies="6"/></ModelStructure></fmiModelDescription>'
)


@pytest.fixture
def sized(stricts3: Any) -> Path:
    path: Path = stricts3.workshop.root / "sized.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        library = compiled(Path(__file__).parents[2] / "fmus" / "sized.c", stricts3.folder)
        archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", library)
    return path


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def ran(stricts3: Any, system: Path, out: Path, **options: Any) -> dict[str, list[Any]]:
    result = simulate(system, RunOptions(out=out, **options))
    assert stricts3.complaints == []
    assert result.outcome == "done", result.error
    return signals(out)


def test_arrays_have_the_sizes_that_the_system_sets(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """Two instances of one FMU with different sizes, connections, parameters and recording of all elements."""
    own = {f"u[{i}]": float(i) for i in (1, 2, 3)} | {f"p[{i},{j}]": 10 * i + j for i in (1, 2, 3) for j in (1, 2)}
    texts = {f"s[{i}]": "abc"[i - 1] for i in (1, 2, 3)}
    ports = "u:input y:output s:input t:output"
    parts = stricts3.component("a", "sized.fmu", ports=ports, n=3, m=2, **own, **texts)
    parts += stricts3.component("b", "sized.fmu", ports=ports, n=3)
    parts += stricts3.component("c", "sized.fmu", ports="u[1]:input u[2]:input y:output")
    system = stricts3.ssd(parts, "a/y b/u", "a/t b/s", "b/y[3] c/u[2]", stop=1.5)
    got = ran(stricts3, system, tmp_path / "out")
    assert [got[f"a.y[{i}]"][-1] for i in (1, 2, 3)] == [2.0, 4.0, 6.0]
    assert [got[f"a.sums[{i}]"][-1] for i in (1, 2, 3)] == [23, 43, 63]
    assert [got[f"b.y[{i}]"][-1] for i in (1, 2, 3)] == [4.0, 8.0, 12.0]
    assert [got[f"b.t[{i}]"][-1] for i in (1, 2, 3)] == ["a", "b", "c"]
    assert [got[f"c.y[{i}]"][-1] for i in (1, 2)] == [0.0, 24.0]
    assert not {"a.y[4]", "c.y[3]"} & {*got}


def test_sizes_from_a_system_and_from_the_command_line(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """By a binding of the system around it, and --set; what is written for other sizes is found wrong by name."""
    workshop = stricts3.workshop
    bindings = workshop.bindings({"a.n": 3, "a.u[3]": 5.0})
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>'
    component = workshop.component("a", "sized.fmu", "y:output")
    system = workshop.ssd("s.ssd", workshop.system(component, bindings=bindings), experiment)
    got = ran(stricts3, system, tmp_path / "one")
    assert got["a.y[3]"] == [10.0] * 3
    got = ran(stricts3, system, tmp_path / "two", overrides={"a.n": "5", "a.u[5]": "7"})
    assert [got[f"a.y[{i}]"][0] for i in (3, 4, 5)] == [10.0, 0.0, 14.0]
    with read_system(system) as structure:
        notes = check(structure, {"a.n": "2"}).notes
    assert any('parameter "a.u[3]" matches nothing' in note for note in notes)


def test_a_structural_parameter_that_sizes_nothing(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """It may be of any type, and is set in Configuration Mode all the same."""
    parts = stricts3.component("a", "sized.fmu", n=3, doubled=True, **{"u[3]": 5.0})
    parts += stricts3.component("b", "sized.fmu", doubled=True, **{"u[2]": 5.0})
    got = ran(stricts3, stricts3.ssd(parts, stop=0.5), tmp_path / "out")
    assert got["a.y[3]"] == got["b.y[2]"] == [20.0] * 2


def test_start_values_for_another_size_are_not_used(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """One start value is for all elements, whatever their number; a list of them is for the FMU's own sizes."""
    own = describe(sized)
    assert [own.variables[f"p[{i},1]"].start for i in (1, 2)] == [1, 1]
    fmu = describe(sized, {"n": 3})
    assert fmu.shapes == {"u": (3,), "y": (3,), "p": (3, 1), "sums": (3,), "s": (3,), "t": (3,)}
    assert fmu.variables["u[3]"].start == 0.0
    assert fmu.variables["p[1,1]"].start is None
    assert 'the start values of "p" are for another size: they are not used' in fmu.notes
    system = stricts3.ssd(stricts3.component("a", "sized.fmu", n=3), stop=0.5)
    assert ran(stricts3, system, tmp_path / "out")["a.sums[1]"] == [0, 0]


def changed(sized: Path, name: str, *pairs: tuple[str, str]) -> Path:
    """The FMU with another description, beside it."""
    text = DESCRIPTION
    for old, new in pairs:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = sized.with_name(name)
    with zipfile.ZipFile(sized) as archive, zipfile.ZipFile(path, "w") as other:
        for member in archive.namelist():
            other.writestr(member, text if member == "modelDescription.xml" else archive.read(member))
    return path


def test_arrays_without_elements(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """min="0" allows it (FMI 3.0.2, 2.4.7); such arrays are connected, and nobody sets or gets them."""
    empty = changed(sized, "empty.fmu", ('start="2" max="16"', 'min="0" start="2" max="16"'))
    fmu = describe(empty, {"n": 0})
    assert fmu.shapes == {"u": (0,), "y": (0,), "p": (0, 1), "sums": (0,), "s": (0,), "t": (0,)}
    assert not {name for name in fmu.variables if "[" in name}
    ports = "u:input y:output s:input t:output"
    parts = stricts3.component("empty1", "empty.fmu", ports=ports, n=0)
    parts += stricts3.component("empty2", "empty.fmu", ports=ports, n=0)
    parts += stricts3.component("c", "empty.fmu", **{"u[2]": 4.0})
    system = stricts3.ssd(parts, "empty1/y empty2/u", "empty2/t empty1/s", stop=1.0)
    got = ran(stricts3, system, tmp_path / "out")
    assert {name.split(".")[0] for name in got} == {"time", "c"}
    assert got["c.y[2]"] == [8.0] * 3


def test_a_matrix_without_columns(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """p[n][m] has no elements, the sums over its rows are 0."""
    changed(sized, "flat.fmu", ('variability="tunable" start="1"', 'variability="tunable" min="0" start="1"'))
    system = stricts3.ssd(stricts3.component("a", "flat.fmu", ports="sums:output", m=0, **{"u[1]": 1.0}), stop=0.5)
    got = ran(stricts3, system, tmp_path / "out")
    assert got["a.sums[1]"] == got["a.sums[2]"] == [0, 0]
    assert got["a.y[1]"] == [2.0, 2.0]


def test_a_size_of_the_fmu_itself_is_positive(sized: Path) -> None:
    """Only a system may make it 0; the start of what sizes arrays must not be (FMI 3.0.2, 2.4.7)."""
    path = changed(sized, "none.fmu", ('start="2" max="16"', 'min="0" start="0" max="16"'))
    with pytest.raises(SystemDescriptionError) as caught:
        describe(path)
    assert 'a dimension of "u" has the size 0; it must be positive' in str(caught.value)


def refused(system: Path, **options: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system, RunOptions(**options))
    return str(caught.value)


@pytest.mark.parametrize(("value", "message"), [
    (0, "a: with n = 0, a dimension of \"u\" has the size 0; it must be positive, since \"n\" does not say min"),
    (17, "outside of its range; valid: -inf to 16"),
    (-1, "does not fit into UInt64"),
])  # fmt: skip
def test_sizes_that_cannot_be(stricts3: Any, sized: Path, value: int, message: str) -> None:
    assert message in refused(stricts3.ssd(stricts3.component("a", "sized.fmu", n=value)))


def test_arrays_that_are_too_large(stricts3: Any, sized: Path) -> None:
    error = refused(stricts3.ssd(stricts3.component("a", "sized.fmu", m=2_000_000)))
    assert "a: with m = 2000000, " in error and "elements; at most 1048576 are possible" in error


def test_connections_of_other_sizes(stricts3: Any, sized: Path) -> None:
    parts = stricts3.component("a", "sized.fmu", ports="y:output", n=3)
    parts += stricts3.component("b", "sized.fmu", ports="u:input")
    assert "cannot connect 3 elements with 2 elements" in refused(stricts3.ssd(parts, "a/y b/u"))


def test_an_empty_instantiation_token(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """FMI 3.0.2 gives it no least length; the FMUs of FMI-LS-BUS have empty ones. It is passed on as it is."""
    with zipfile.ZipFile(sized) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["modelDescription.xml"] = DESCRIPTION.replace('Token="sized"', 'Token=""').encode()
    with zipfile.ZipFile(sized, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    assert any('its instantiationToken is ""' in note for note in describe(sized).notes)
    got = ran(stricts3, stricts3.ssd(stricts3.component("a", "sized.fmu", **{"u[1]": 3.0}), stop=0.5), tmp_path / "out")
    assert got["a.y[1]"] == [6.0, 6.0]


def test_an_array_of_one_element_and_a_scalar(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    """The connector u[1] is a scalar, y an array of one element; in either direction."""
    parts = stricts3.component("a", "sized.fmu", ports="u:input y:output", n=1, **{"u[1]": 3.0})
    parts += stricts3.component("b", "sized.fmu", ports="u[1]:input y[1]:output", n=1)
    parts += stricts3.component("c", "sized.fmu", ports="u:input y:output", n=1)
    got = ran(stricts3, stricts3.ssd(parts, "a/y b/u[1]", "b/y[1] c/u", stop=1.5), tmp_path / "out")
    assert (got["b.y[1]"][-1], got["c.y[1]"][-1]) == (12.0, 24.0)


def test_sizes_are_not_changed_during_a_run(stricts3: Any, sized: Path) -> None:
    """Reconfiguration Mode is not used: columns, connections and buffers would change with it."""
    system = stricts3.ssd(stricts3.component("a", "sized.fmu"))
    error = refused(system, at=[(1.0, "a.m", "3")])
    assert "it is a structural parameter, which sizes arrays: it can be set before the run only" in error


def constants(stricts3: Any, sized: Path, value: int, kind: str = "UInt64") -> Path:
    """The same FMU with a constant c."""
    start = "" if kind == "String" else f'start="{str(bool(value)).lower() if kind == "Boolean" else value}"'
    inner = f'<Start value="{value}"/>' if kind == "String" else ""
    variable = f'<{kind} name="c" valueReference="9" causality="local" variability="constant" {start}>{inner}</{kind}>'
    with zipfile.ZipFile(sized) as archive:
        library = archive.read(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}")
    path: Path = stricts3.workshop.root / "constant.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION.replace("<ModelVariables>", f"<ModelVariables>{variable}"))
        archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", library)
    return path


def driven(stricts3: Any, **values: Any) -> Path:
    """The constant of a says n of b, through the structural parameter of a system, whose array has that size."""
    workshop = stricts3.workshop
    bindings = workshop.bindings(values) if values else ""
    inner = workshop.component("b", "sized.fmu", "n:structuralParameter u:input y:output", bindings)
    wires = workshop.connection("k", "b/n") + workshop.connection("in", "b/u")
    made = workshop.system(inner, wires, name="s", connectors="k:structuralParameter in:input:Real")
    made = made.replace("<ssc:Real/></ssd:C", '<ssc:Real/><ssc:Dimension sizeConnector="k"/></ssd:C')
    parts = workshop.component("a", "constant.fmu", "c:constant y:output", workshop.bindings({"n": 3, "u[3]": 4.0}))
    wires = workshop.connection("a/c", "s/k") + workshop.connection("a/y", "s/in")
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>'
    path: Path = workshop.ssd("s.ssd", workshop.system(parts + made, wires), experiment, version="2.0")
    return path


def test_a_constant_says_a_size(stricts3: Any, sized: Path, tmp_path: Path) -> None:
    constants(stricts3, sized, 3)
    system = driven(stricts3, n=7)
    got = ran(stricts3, system, tmp_path / "out")
    assert [got[f"s.b.y[{i}]"][-1] for i in (1, 2, 3)] == [0.0, 0.0, 16.0]
    assert "s.b.y[4]" not in got
    with read_system(system) as structure:
        lines = explain(check(structure), "s.b.n")
    assert any('c = 3, bound to "a"' in line for line in lines)
    assert any(line.startswith("  overridden: 7, set by ") for line in lines)


@pytest.mark.parametrize(("mapping", "y"), [("", 10.0), ("false true", 20.0)])
def test_a_constant_of_another_type(stricts3: Any, sized: Path, tmp_path: Path, mapping: str, y: float) -> None:
    """A Boolean, as it is and mapped on its way."""
    constants(stricts3, sized, 0, "Boolean")
    workshop, inner = stricts3.workshop, ""
    if mapping:
        source, target = mapping.split()
        entry = f'<ssc:MapEntry source="{source}" target="{target}"/>'
        inner = f"<ssc:BooleanMappingTransformation>{entry}</ssc:BooleanMappingTransformation>"
    parts = workshop.component("a", "constant.fmu", "c:constant")
    ports = "doubled:structuralParameter y:output"
    parts += workshop.component("b", "sized.fmu", ports, workshop.bindings({"u[2]": 5.0}))
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="0.5"/>'
    wires = workshop.connection("a/c", "b/doubled", inner)
    system = workshop.ssd("s.ssd", workshop.system(parts, wires), experiment, version="2.0")
    assert ran(stricts3, system, tmp_path / "out")["b.y[2]"] == [y] * 2


@pytest.mark.parametrize(("value", "kind", "message"), [
    (17, "UInt64", 's.ssd:30: "c" is set to 17, which is outside of its range; valid: -inf to 16'),
    (3, "String", "s.ssd:30: s.k is String and b.n is UInt64; types must be equal"),
])  # fmt: skip
def test_constants_that_say_no_size(stricts3: Any, sized: Path, value: int, kind: str, message: str) -> None:
    constants(stricts3, sized, value, kind)
    assert message in refused(driven(stricts3))


@pytest.mark.parametrize("size", ["", ' size="2"'])
def test_values_have_sizes_of_their_own(workshop: Any, variable: Any, size: str) -> None:
    """SSP 2.0.1, 4.5.3: a sizeConnector is an error in parameter sets, also where there is no size."""
    workshop.fmu("a.fmu", variable("p", "parameter"))
    text = (
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="2.0" '
        'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="v"><ssv:Parameters>'
        f'<ssv:Parameter name="a.p"><ssv:Real value="1 2"/><ssc:Dimension{size} sizeConnector="n"/></ssv:Parameter>'
        "</ssv:Parameters></ssv:ParameterSet>"
    )
    (workshop.root / "v.ssv").write_text(text)
    bindings = '<ssd:ParameterBindings><ssd:ParameterBinding source="v.ssv"/></ssd:ParameterBindings>'
    system = workshop.ssd("s.ssd", workshop.system(workshop.component("a", "a.fmu"), bindings=bindings))
    with read_system(system) as structure, pytest.raises(SystemDescriptionError) as caught:
        check(structure)
    assert any("has a sizeConnector, which is for connectors only" in str(one) for one in caught.value.problems)

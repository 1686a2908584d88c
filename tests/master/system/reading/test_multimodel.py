"""INTO-CPS multi-models: what is read from them, what is refused, and the numbers of Maestro's fixed-step Jacobi."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import Finding, SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.convert import convert
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.others.into_cps import read_multimodel
from cosim_master.system.reading.read import read_system
from tests.master.fuzz import multimodel_fuzz

A, B = "{A}.one", "{A}.two"


def model(**changes: Any) -> dict[str, Any]:
    """y = integral of p * u: one -> two -> three, and back to one."""
    made = {
        "fmus": {"{A}": "strict.fmu", "{B}": "other.fmu"},
        "connections": {f"{A}.y": [f"{B}.u", "{B}.x.u"], f"{B}.y": [f"{A}.u"], f"{A}.r": [f"{B}.s"]},
        "parameters": {f"{A}.p": 2, f"{B}.p": 0.5, f"{A}.when": 100, "{B}.x.p": 1e-3, f"{A}.s": "x", f"{A}.b": True},
        "algorithm": {"type": "fixed-step", "size": 0.25},
        "startTime": 0,
        "endTime": 3.0,
        "livestream": {},
    }
    return {**made, **changes}


@pytest.fixture
def place(stricts: Any) -> Path:
    stricts.fmu(step=0.5)
    stricts.fmu("other.fmu", step=0.5)
    root: Path = stricts.workshop.root
    return root


def written(place: Path, content: Any, name: str = "mm.json") -> Path:
    file = place / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(content, indent=1))
    return file


def maestro(steps: int, h: float) -> list[dict[str, float]]:
    """The same system by hand: get all outputs, set all inputs, step all. Inputs start at 0, outputs too."""
    y, p = {A: 0.0, B: 0.0, "{B}.x": 0.0}, {A: 2.0, B: 0.5, "{B}.x": 1e-3}
    source = {A: B, B: A, "{B}.x": A}
    rows = [dict(y)]
    for _ in range(steps):
        u = {name: y[source[name]] for name in y}
        y = {name: y[name] + h * p[name] * u[name] for name in y}
        rows.append(dict(y))
    return rows


def test_the_numbers_are_those_of_jacobi_by_hand(place: Path, stricts: Any, tmp_path: Path) -> None:
    """u starts at 1 in one instance only: the loop carries it on."""
    content = model()
    content["connections"].pop(f"{B}.y")
    content["parameters"][f"{A}.u"] = 1.0
    result = simulate(written(place, content), RunOptions(out=tmp_path / "out"))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    ya, yb, yx = 0.0, 0.0, 0.0
    for k, t in enumerate(got["time"]):
        assert t == k * 0.25
        assert (got[f"{A}.y"][k], got[f"{B}.y"][k], got["{B}.x.y"][k]) == (ya, yb, yx)
        ya, yb, yx = ya + 0.25 * 2.0 * 1.0, yb + 0.25 * 0.5 * ya, yx + 0.25 * 1e-3 * ya
    assert len(got["time"]) == 13 and yb > 0.0
    assert got[f"{B}.r"][-1] == "x!!"


def test_a_closed_loop(place: Path, stricts: Any, tmp_path: Path) -> None:
    result = simulate(written(place, model()), RunOptions(out=tmp_path / "out"))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    for k, row in enumerate(maestro(12, 0.25)):
        assert {name: got[f"{name}.y"][k] for name in row} == row


def test_what_was_assumed_is_told(place: Path) -> None:
    content = model()
    content["fmus"]["{C}"] = "other.fmu"
    with read_system(written(place, content)) as structure:
        notes = "\n".join(structure.notes)
    assert 'ignored, since it changes no values: "livestream"' in notes
    assert "{C} has no instance" in notes


def test_a_project_of_the_application(place: Path, tmp_path: Path) -> None:
    """FMUs in the project's folder FMUs; the run's configuration names the multi-model by its path in the project."""
    project = tmp_path / "project"
    (project / "FMUs").mkdir(parents=True)
    for name in ("strict.fmu", "other.fmu"):
        (project / "FMUs" / name).write_bytes((place / name).read_bytes())
    how = {key: model()[key] for key in ("algorithm", "startTime", "endTime")}
    what = {key: value for key, value in model().items() if key not in how}
    mm = written(project / "Multi-models" / "m", what)
    coe = written(mm.parent / "run", {**how, "multimodel_path": "Multi-models/m/mm.json"}, "coe.json")
    for path in (coe, mm):
        checked = check(read_system(path))
        assert (checked.stop_time, {one.step_size for one in checked.instances}) == (3.0, {0.25})
        assert {one.fmu.path.parent.name for one in checked.instances} == {"FMUs"}
    assert any("how to run it is taken from" in note for note in checked.notes)
    written(mm.parent / "another", {**how, "endTime": 7.0}, "coe.json")
    checked = check(read_system(mm))  # two to choose from: none is
    assert (checked.stop_time, {one.step_size for one in checked.instances}) == (None, {0.5})


@pytest.mark.parametrize(
    ("change", "line", "message"),
    [
        ({"algorithm": {"type": "ecco"}}, '"algorithm"', 'its type is "ecco"; valid: "fixed-step", "var-step"'),
        ({"algorithm": "fixed"}, '"algorithm"', 'algorithm: its type is null; valid: "fixed-step"'),
        ({"algorithm": {"type": "fixed-step", "size": 0}}, '"algorithm"', "fixed-step needs a positive size"),
        ({"endTime": "soon"}, '"endTime"', 'endTime: "soon" is not a finite number'),
        ({"startTime": 10**400}, '"startTime"', "startTime: 1000"),
        ({"stabilisation": "yes"}, '"stabilisation"', 'stabilisation: "yes" is not true or false'),
        ({"stabilization": True, "absoluteTolerance": 0}, '"absoluteTolerance"', "one must be positive, none negative"),
        ({"fixedPointIteration": 0}, '"fixedPointIteration"', "must be a positive whole number"),
        ({"end_time": 4.0}, '"end_time"', '"end_time" is given a second time, in another spelling'),
        ({"endTimes": 4.0}, '"endTimes"', 'there is no key "endTimes"; did you mean "endTime"?'),
        ({"Model-Swaps": {"a": 1}}, '"Model-Swaps"', "modelSwaps: model swap is not supported"),
        ({"modelSwaps": {"a": 1}}, '"modelSwaps"', "modelSwaps: model swap is not supported"),
        ({"fmus": []}, '"fmus"', "fmus: must be an object, not []"),
        ({"connections": 3}, '"connections"', "connections: must be an object, not 3"),
        ({"fmus": {"A": "strict.fmu"}, "connections": {}, "parameters": {}}, '"A"', 'the key of an FMU is written'),
        ({"fmus": {"{A}": 5}, "connections": {}, "parameters": {}}, '"{A}"', "{A}: 5 is not the path of an FMU"),
        ({"fmus": {"{A}": "no.fmu"}, "connections": {}, "parameters": {}}, '"{A}"', '{A}: there is no file "no.fmu"'),
        ({"parameters": {"{A}.one": 1}}, '"{A}.one"', '"{A}.one": variables are written "{key}.instance.variable"'),
        ({"parameters": {"{C}.one.p": 1}}, '"{C}.one.p"', '"{C}.one.p": there is no FMU {C}; '),
        ({"parameters": {"{A}.one.p": None}}, '"{A}.one.p"', "{A}.one.p: null is not a value"),
        ({"parameters": {"{A}.one.p": [1]}}, '"{A}.one.p"', "{A}.one.p: [1] is not a value"),
        ({"connections": {"{A}.one.y": "{A}.two.u"}}, '"{A}.one.y"', "must be connected to a list of inputs"),
        ({"connections": {"{A}.one.y": ["{A}.two"]}}, '"{A}.two"', '"{A}.two": variables are written'),
        ({"connections": {"{A}.one.y": [4]}}, None, "4: variables are written"),
        ({"connections": {"{A}.one.y": ["{A}.two.u"], "{A}.two.u": ["{A}.one.u"]}}, '"{A}.two.u"', "{A}.two.u is at"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(place: Path, change: Any, line: str | None, message: str) -> None:
    file = written(place, model(**change))
    with pytest.raises(SystemDescriptionError) as caught:
        check(read_system(file))
    problems = [p for p in caught.value.problems if message in p.message]
    assert problems, caught.value
    if line is not None:
        assert problems[0].where.line is not None
        assert line in file.read_text().splitlines()[problems[0].where.line - 1]


def test_all_problems_come_at_once(place: Path) -> None:
    file = written(place, model(algorithm={"type": "ecco"}, endTime=[], parameters={"x": 1}, connections={"y": []}))
    with pytest.raises(SystemDescriptionError) as caught:
        check(read_system(file))
    assert len(caught.value.problems) == 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not JSON: Expecting value"),
        ('{"fmus": {', "is not JSON: "),
        ("[]", "its root must be an object"),
        ("{}", 'is not a multi-model: it needs "fmus"'),
        ('{"fmus": {"{A}": NaN}}', "NaN is not a JSON number"),
        ("[" * 100_000, "is not JSON"),
        ('{"fmus": ' + "9" * 5000 + "}", "is not JSON that can be read"),
        ('{"multimodel_path": "nowhere.json"}', 'there is no file "nowhere.json"'),
        (r'{"multimodel_path": "\ud800"}', r'there is no file "\ud800"'),
        (r'{"multimodel_path": "\u0000"}', r'there is no file "\u0000"'),
    ],
)
def test_what_is_no_multimodel(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mm.json"
    file.write_text(text)
    with pytest.raises(SystemDescriptionError) as caught:
        read_system(file)
    assert message in str(caught.value)


def test_a_key_given_twice(place: Path) -> None:
    file = place / "mm.json"
    text = json.dumps(model(parameters={"{A}.one.p": 1, "{A}.one.q": 2}), indent=1)
    file.write_text(text.replace("{A}.one.q", "{A}.one.p"))
    with pytest.raises(SystemDescriptionError, match="is given twice in one object"):
        check(read_system(file))


def test_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "mm.json").write_bytes(b'{"fmus": "\xff"}')
    with pytest.raises(SystemDescriptionError, match="it is not UTF-8"):
        read_system(tmp_path / "mm.json")


@pytest.mark.parametrize("key", ["stabilisation", "stabilization", "stabalizationEnabled", "stabilizationEnabled"])
def test_stabilisation_is_the_fixed_point_of_every_step(place: Path, stricts: Any, tmp_path: Path, key: str) -> None:
    """With inputs at the end of the step: y1' = y1 + h p1 y2', y2' = y2 + h p2 y1', solved by hand."""
    content = model(**{key: True, "global_absolute_tolerance": 0.0, "global_relative_tolerance": 1e-12})
    content["connections"] = {f"{A}.y": [f"{B}.u"], f"{B}.y": [f"{A}.u"]}
    content["parameters"] = {f"{A}.p": 2, f"{B}.p": 0.5, f"{A}.u": 1.0}
    if key == "stabilisation":
        content["end_time"] = content.pop("endTime")
    result = simulate(written(place, content), RunOptions(out=tmp_path / "out"))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    assert any("with stabilisation every loop is iterated to 1e-12" in note for note in result.notes)
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    y1, y2, a, b = 0.0, 0.0, 0.25 * 2.0, 0.25 * 0.5
    assert len(got["time"]) == 13
    for k in range(13):
        assert (got[f"{A}.y"][k], got[f"{B}.y"][k]) == pytest.approx((y1, y2), rel=1e-10, abs=1e-10)
        y1, y2 = (y1 + a * y2) / (1 - a * b), (y2 + b * y1) / (1 - a * b)


def test_unknown_keys_are_findings(place: Path) -> None:
    with read_system(written(place, model(foo=3, graphs=[]))) as structure:
        (finding,) = [note for note in structure.notes if isinstance(note, Finding)]
        assert '"foo" is not a key of a multi-model: it is ignored' in finding
        assert any('"livestream", "graphs"' in note for note in structure.notes)


def test_stabilisation_of_a_configuration_beside_is_read(place: Path) -> None:
    how = {key: model()[key] for key in ("algorithm", "startTime", "endTime")}
    what = {key: value for key, value in model().items() if key not in how}
    mm = written(place, what)
    written(place, {**how, "stabalizationEnabled": True, "multimodel_path": "mm.json"}, "coe.json")
    with read_system(mm) as structure:
        assert [one.type for one in structure.system.annotations] == ["org.uav-cosim.stepping", "org.uav-cosim.master"]


def test_paths_of_windows_and_paths_that_are_no_longer_right(place: Path) -> None:
    how = {key: model()[key] for key in ("algorithm", "startTime", "endTime")}
    what = {key: value for key, value in model().items() if key not in how}
    mm = written(place / "Multi-models" / "m", what, "m.mm.json")
    coe = written(mm.parent / "run", {**how, "multimodel_path": "Multi-models\\m\\m.mm.json"}, "coe.json")
    with read_system(coe) as structure:
        assert structure.document == mm and not structure.problems
        assert not [note for note in structure.notes if "is taken" in str(note)]
    written(mm.parent / "run", {**how, "multimodel_path": "Multi-models/old/old.mm.json"}, "coe.json")
    with read_system(coe) as structure:
        assert structure.document == mm and not structure.problems
        assert any(f'no file "Multi-models/old/old.mm.json"; {mm} is taken' in note for note in structure.notes)
    written(mm.parent, what, "other.mm.json")
    with pytest.raises(SystemDescriptionError, match="there is no file"):
        read_system(coe)


# ---- conversion -------------------------------------------------------------------------------


def test_the_converted_system_gives_the_same(place: Path, tmp_path: Path) -> None:
    content = model()
    (place / "sub dir").mkdir()
    content["fmus"]["{B}"] = "sub dir/strict.fmu"
    (place / "sub dir" / "strict.fmu").write_bytes((place / "other.fmu").read_bytes())
    mm = written(place, content)
    folder = convert(mm, tmp_path / "converted").file.parent
    assert sorted(file.name for file in (folder / "resources").iterdir()) == ["strict.fmu", "strict_2.fmu"]
    assert simulate(mm, RunOptions(out=tmp_path / "one")).outcome == "done"
    assert simulate(folder, RunOptions(out=tmp_path / "two")).outcome == "done"
    one, two = (pq.read_table(tmp_path / name / "signals.parquet") for name in ("one", "two"))
    assert one.equals(two)
    with pytest.raises(SystemDescriptionError, match="exists already"):
        convert(mm, tmp_path / "converted")


def test_the_commands(place: Path, tmp_path: Path) -> None:
    mm = written(place, model())
    for arguments in (["check", str(mm)], ["info", str(mm)], ["convert", str(mm), "-o", str(tmp_path / "c")]):
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, done.output
    assert CliRunner().invoke(app, ["run", str(tmp_path / "c"), "-o", str(tmp_path / "out")]).exit_code == 0
    done = CliRunner().invoke(app, ["convert", str(written(place, {"fmus": 3}, "bad.json")), "-o", str(tmp_path / "d")])
    assert done.exit_code == 2 and "fmus: must be an object" in done.output
    assert not (tmp_path / "d").exists()


# ---- fuzz -------------------------------------------------------------------------------------

WORDS = ["fmus", "connections", "parameters", "algorithm", "size", "type", "fixed-step", "endTime", "{A}", "{A}.one.y"]
WORDS += ["{A}.two.u", "{A}.one.p", "strict.fmu", "multimodel_path", "mm.json", "", ".", "{", "\ud800", "\0", "..", "/"]
TEXTS = st.sampled_from(WORDS) | st.text(max_size=8)
SIMPLE = st.none() | st.booleans() | st.integers() | st.floats() | TEXTS
FLAT = SIMPLE | st.lists(SIMPLE, max_size=3) | st.dictionaries(TEXTS, SIMPLE, max_size=4)
VALUES: st.SearchStrategy[Any] = SIMPLE | st.lists(FLAT, max_size=3) | st.dictionaries(TEXTS, FLAT, max_size=4)


def read_and_checked(file: Path) -> None:
    """Our own error, or a system."""
    try:
        with read_multimodel(file) as structure:
            check(structure)
    except SystemDescriptionError as error:
        str(error).encode()


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=VALUES | st.dictionaries(st.sampled_from(WORDS[:8]), VALUES, max_size=5))
def test_any_json(place: Path, content: Any) -> None:
    file = place / "any.json"
    file.write_text(json.dumps(content))
    read_and_checked(file)


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_multimodels_with_something_changed(place: Path, data: st.DataObject) -> None:
    content = copy.deepcopy(model())
    for _ in range(data.draw(st.integers(1, 3))):
        at: Any = content
        while isinstance(at, dict | list) and at and data.draw(st.booleans()):
            at = at[data.draw(st.sampled_from(sorted(at) if isinstance(at, dict) else range(len(at))))]
        if isinstance(at, dict):
            at[data.draw(TEXTS)] = data.draw(VALUES)
        elif isinstance(at, list):
            at.append(data.draw(VALUES))
    text = json.dumps(content)
    cut = data.draw(st.integers(0, len(text))) if data.draw(st.booleans()) else len(text)
    file = place / "changed.json"
    file.write_text(text[:cut] + data.draw(st.sampled_from(["", "", "}", "]", '"', "\x00"])) + text[cut:])
    read_and_checked(file)


def test_a_slice_of_the_fuzzing() -> None:
    counts, _, findings = multimodel_fuzz.fuzz(400, seed=2)
    assert [finding for finding in findings if not finding.text.startswith("took ")] == []
    assert counts["accepted"] > 10 and counts["refused"] > 100

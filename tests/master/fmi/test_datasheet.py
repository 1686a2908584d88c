"""What `info` and `check` say of any FMU, and FMUs against reference results."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from cosim_master.cli import _joined, app
from cosim_master.cli.views.inspection import fmu_tables
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.reference_results import against_reference
from cosim_master.fmi.description.datasheet import datasheet, findings
from cosim_master.fmi.description.read import describe, platform

LS = "extra/org.fmi-standard.fmi-ls-ref"
MANIFEST = (
    '<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" '
    'fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0">{}</fmiReferences>'
)
RESULT = '<Related type="text/csv" source="out.csv" role="result"/>'
INPUT = '<Related type="text/csv" source="in.csv" role="input"/>'


def command(*words: str) -> Any:
    return CliRunner().invoke(app, _joined(list(words)))


def test_an_archive_with_another_document_is_no_fmu(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "page.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<html/>")
    done = command("info", str(tmp_path / "page.fmu"))
    told = f"{tmp_path}/page.fmu/modelDescription.xml:1: the root element is <html>; it must be <fmiModelDescription>"
    assert (done.exit_code, done.stdout, done.stderr.splitlines()[-1]) == (2, "", f"error: {told}")


def test_any_fmu_is_shown(dynamics: Any) -> None:
    file = dynamics.fmu("BALL", 3, "ME CS", stop=2.0, tolerance=1e-5, extra={f"{LS}/fmi-ls-manifest.xml": MANIFEST})
    sheet = datasheet(file)
    assert list(sheet["interfaces"]) == ["CoSimulation", "ModelExchange"]
    assert "canGetAndSetFMUState" in sheet["interfaces"]["ModelExchange"]
    assert sheet["layered_standards"] == [{"name": "org.fmi-standard.fmi-ls-ref", "version": "1.0", "description": ""}]
    assert sheet["default_experiment"] == {"stopTime": "2.0", "tolerance": "1e-05"}
    assert sheet["variables_by_causality"]["output"] == ["h", "v", "bounces"] and sheet["refused"] == []
    assert any("ModelExchange" in str(line) for line in fmu_tables(file, every=False))


def test_an_fmu_that_cannot_be_run_here_is_shown_too(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("BALL", 2, binary=False, extra={"binaries/elsewhere/Dynamic.so": ""})
    assert datasheet(file)["platforms"] == ["elsewhere"]
    lines = [line for line in fmu_tables(file) if isinstance(line, str)]
    assert any(line.startswith("cannot be run here: has no library for this platform") for line in lines)
    done = command("info", str(file))
    assert done.exit_code == 0 and "ModelExchange: canGetAndSetFMUstate, canSerializeFMUstate" in done.output


def test_everything_that_is_wrong_with_an_fmu(workshop: Any, variable: Any) -> None:
    """What FMPy finds, with its lines, and limits that it does not look at."""
    file = workshop.fmu(
        "a.fmu",
        variable("u", start="3", min="0", max="2"),
        variable("v", unit="furlong"),
        variable("w", min="2", max="1", start="2"),
        variable("1x"),
    )
    texts = [str(problem) for problem in findings(file)]
    assert any(f'{file}/modelDescription.xml:6: start 3 of "u" is not between its min and max' == t for t in texts)
    assert any('min 2 of "w" is larger than max 1' in text for text in texts)
    assert any('"furlong"' in text and "modelDescription.xml:" in text for text in texts)
    assert any('"1x"' in text for text in texts) or not any("1x" in str(p) for p in validate_fmu(str(file)))
    done = command("check", str(file))
    assert done.exit_code == 2 and "is not between its min and max" in done.output


@pytest.mark.parametrize("good", [True, False])
def test_an_alias_has_no_entry_of_its_own(workshop: Any, good: bool) -> None:
    """FMPy expects one for each name (FMI 3.0.2, 2.4.7.5); an entry that is missing is still found."""
    last = '<InitialUnknown valueReference="6"/>' if good else ""
    file = workshop.pack(
        "Al.fmu",
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" modelName="Al" '
        'instantiationToken="al"><CoSimulation modelIdentifier="Al"/><ModelVariables>'
        '<Float64 name="time" valueReference="1" causality="independent" variability="continuous"/>'
        '<Float64 name="s" valueReference="5" causality="output"><Alias name="same"/><Alias name="too"/></Float64>'
        '<Float64 name="r" valueReference="6" causality="output"/></ModelVariables><ModelStructure>'
        f'<Output valueReference="5"/><Output valueReference="6"/><InitialUnknown valueReference="5"/>{last}'
        "</ModelStructure></fmiModelDescription>",
    )
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr(f"binaries/{platform(3)}/Al.so", b"")
    assert "Expected {r, s, same, too}" in str(validate_fmu(file)).replace("{ ", "{").replace(" }", "}")
    found = [one.message for one in findings(file) if "expected set" in one.message]
    noted = [note for note in describe(file).notes if "expected set" in note]
    assert (found == [], noted == []) == (good, good)


def test_a_good_fmu_is_checked_and_prepared(dynamics: Any) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, stop=1.0, step=0.5)
    assert findings(file) == []
    done = command("check", str(file))
    assert done.exit_code == 0 and "2 steps of 0.5 s: no problems" in done.output


def test_missing_files_of_an_fmu(dynamics: Any) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, sources=True, extra={"binaries/win64/Other.dll": ""})
    texts = [problem.message for problem in findings(file)]
    assert "its sources/dynamic.c, which <ModelExchange> lists, is not there" in texts
    assert "binaries/win64 has no library with the modelIdentifier Dynamic of <ModelExchange>" in texts


def reference(dynamics: Any, name: str, shift: float = 0.0) -> tuple[Path, str]:
    """A decay with reference results by FMPy, whose last value is wrong by `shift`."""
    plain = dynamics.fmu("DAHLQUIST", 2, "CS", stop=1.0, step=0.25, name="plain.fmu")
    rows = fmpy.simulate_fmu(str(plain), stop_time=1.0, output_interval=0.25, output=["x"])
    text = "time,x\n" + "".join(
        f"{t},{x + (shift if t == 1.0 else 0)}\n" for t, x in zip(rows["time"], rows["x"], strict=True)
    )
    members = {f"{LS}/fmi-ls-manifest.xml": MANIFEST.format(RESULT), f"{LS}/out.csv": text}
    return dynamics.fmu("DAHLQUIST", 2, "CS", stop=1.0, step=0.25, name=name, extra=members), text


def test_an_fmu_agrees_with_the_results_it_brings_along(dynamics: Any) -> None:
    file, _ = reference(dynamics, "good.fmu")
    verdict = against_reference(file, None, tolerance=1e-12)
    assert verdict.agrees and verdict.rows == 5 and [one.name for one in verdict.differences] == ["x"]
    done = command("check", str(file), "--reference")
    assert done.exit_code == 0 and "x: agrees" in done.output and "5 rows of the results that good.fmu" in done.output


def test_a_difference_is_exit_code_1(dynamics: Any, tmp_path: Path) -> None:
    file, text = reference(dynamics, "bad.fmu", shift=0.01)
    done = command("check", str(file), "--reference")
    assert done.exit_code == 1 and "x: DIFFERS, by 0.01 at t = 1 s, allowed 0.001" in done.output
    (tmp_path / "r.csv").write_text(text)
    done = command("check", str(file), "--reference", str(tmp_path / "r.csv"), "--tolerance", "0.02")
    assert done.exit_code == 0
    done = command("check", str(file), "--reference", str(tmp_path / "r.csv"), "--tolerance", "0")
    assert done.exit_code == 1 and "x: DIFFERS, by 0.01 at t = 1 s, allowed 0" in done.output
    done = command("check", str(file), "--reference", str(tmp_path / "r.csv"), "--tolerance", "inf")
    assert done.exit_code == 2 and "--tolerance inf: give a finite number" in done.output


def test_references_with_inputs(dynamics: Any) -> None:
    files = {
        f"{LS}/fmi-ls-manifest.xml": MANIFEST.format(RESULT + INPUT),
        f"{LS}/in.csv": "time,u\n0,2\n",
        f"{LS}/out.csv": "time,x,y,s\n0,0,2,a\n0.5,1,3,a\n1,2,4,a\n",
    }
    file = dynamics.fmu("DRIVE", 3, "CS", stop=1.0, step=0.5, extra=files)
    verdict = against_reference(file, None, tolerance=1e-9)
    assert verdict.agrees and {one.name for one in verdict.differences} == {"x", "y"} and verdict.left_out == ("s",)


def test_references_that_cannot_be_used(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, "CS", stop=1.0, step=0.5)
    wrong = {
        "t,x\n0,1\n": 'r.csv:1: needs a row of names, "time" first',
        "time,x\n0,1,2\n": "r.csv:2: has 3 cells; the row of names has 2",
        "time,q\n0,1\n": "r.csv: nothing to compare: q are not outputs of the FMU",
        "time,x\n0.3,1\n": "r.csv: has no time in common with the run",
    }
    for text, message in wrong.items():
        (tmp_path / "r.csv").write_text(text)
        with pytest.raises(SystemDescriptionError) as caught:
            against_reference(file, tmp_path / "r.csv", tolerance=1e-3)
        assert message in str(caught.value)
    with pytest.raises(SystemDescriptionError, match="brings no reference results"):
        against_reference(file, None, tolerance=1e-3)
    lost = dynamics.fmu("DAHLQUIST", 2, name="l.fmu", extra={f"{LS}/fmi-ls-manifest.xml": MANIFEST.format(RESULT)})
    with pytest.raises(SystemDescriptionError, match='names "out\\.csv" as result'):
        against_reference(lost, None, tolerance=1e-3)
    assert command("check", str(tmp_path), "--reference").exit_code == 2

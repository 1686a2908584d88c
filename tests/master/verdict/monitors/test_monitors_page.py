"""docs/monitors.md: its annotation and its program work as printed; its tables are those of the code."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from cosim_master.execution.preparation.prepare import prepare
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.verdict.monitors.declared import ANNOTATION, monitors_of
from cosim_master.verdict.monitors.formula import FUNCTIONS, Window, parse
from cosim_master.verdict.monitors.violations import MOST
from tests.scenarios.flights import copy_of

TEXT = (Path(__file__).parents[4] / "docs" / "monitors.md").read_text(encoding="utf-8")


def test_the_annotation_is_valid_in_line5(fmus: Path, tmp_path: Path) -> None:
    (annotation,) = re.findall(r"```xml\n(.*?)```", TEXT, re.S)
    assert ANNOTATION in annotation
    end = "</ssd:Annotations>\n  </ssd:System>"
    system = copy_of("line5", tmp_path, fmus, lambda text: text.replace(end, annotation + end))
    with read_system(system) as structure:
        ready = prepare(check(structure))
    names = [one.name for one in ready.monitors.every]
    assert names == ["order", "separation", "speed", "tilt", "fence", "convergence", "age", "ringing"]
    assert monitors_of(ready.checked, ready.network, ready.clock) == ready.monitors


@pytest.mark.slow
def test_the_program_prints_what_is_printed(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    (printed,) = re.findall(r"It prints\n\n```\n(.*?)```", TEXT, re.S)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(program, "monitors.md", "exec"), {})
    assert said.getvalue() == printed


def test_tables_name_all_operators_and_functions() -> None:
    rows = re.findall(r"^\| `(?:p )?(\w+)\[a,b\] \w`", TEXT, re.M)
    assert set(rows) == set(get_args(get_type_hints(Window)["operator"]))
    assert all(f"`{name}" in TEXT for name in FUNCTIONS)
    assert f"at most {MOST} of a monitor" in TEXT
    formula = parse("always[0,5] x > 1 -> y > 1")
    assert formula.conjuncts[0][1] == parse("(always[0,5] x > 1) -> y > 1").conjuncts[0][1]

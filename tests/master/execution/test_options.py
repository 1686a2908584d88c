"""RunOptions: what they take, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master.execution.options import RunOptions


def test_paths_are_taken_as_text() -> None:
    given: dict[str, Any] = dict.fromkeys(("out", "inputs", "replay", "assignment"), "out/there")
    options = RunOptions(**given)
    assert {options.out, options.inputs, options.replay, options.assignment} == {Path("out/there")}


def test_values_are_taken_as_numbers() -> None:
    values: dict[str, Any] = {"a.x": 2, "a.y": 0.5, "a.z": np.float64(0.1), "a.b": True, "a.t": "text"}
    written = {"a.x": "2", "a.y": "0.5", "a.z": "0.1", "a.b": "true", "a.t": "text"}
    assert RunOptions(overrides=values).overrides == written
    changes: Any = [(1, name, value) for name, value in values.items()]
    assert RunOptions(at=changes).at == tuple((1.0, name, text) for name, text in written.items())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"record": "a.*"}, "record is one text; give a sequence of texts: record=('a.*',)"),
        ({"gcs": "udpin:14550"}, "gcs is one text; give a sequence of texts: gcs=('udpin:14550',)"),
        ({"at": (1, "a.x", 2)}, "at contains 1; give a sequence of (time in s, name, value)"),
        ({"at": ["1 a.x=2"]}, "at contains '1 a.x=2'; give a sequence of (time in s, name, value)"),
        ({"at": [(1, "a.x=2")]}, "at contains (1, 'a.x=2'); give a sequence of (time in s, name, value)"),
    ],
)
def test_what_is_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(TypeError) as caught:
        RunOptions(**wrong)
    assert str(caught.value) == message

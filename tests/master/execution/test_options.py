"""RunOptions: what they take, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
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


def test_numbers_and_arrays_of_numpy_are_taken() -> None:
    given: dict[str, Any] = {"seed": np.int64(3), "threads": np.uint8(2), "until": np.float32(0.5), "step": np.array(2)}
    options = RunOptions(**given, record=np.array(["a.*", "b.*"]))  # type: ignore[arg-type]
    taken = {name: getattr(options, name) for name in given}
    assert taken == {"seed": 3, "threads": 2, "until": 0.5, "step": 2}
    assert {name: type(value) for name, value in taken.items()} == dict(zip(given, (int, int, float, int), strict=True))
    assert options.record == ("a.*", "b.*")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"seed": -1}, "seed: is -1; give a whole number from 0 to 9007199254740992"),
        ({"seed": 2**53 + 1}, "seed: is 9007199254740993; give a whole number from 0 to 9007199254740992"),
        ({"seed": 1.5}, "seed: is 1.5; give a whole number from 0 to 9007199254740992"),
        ({"seed": "7"}, "seed: is '7'; give a whole number from 0 to 9007199254740992"),
        ({"seed": True}, "seed: is True; give a whole number from 0 to 9007199254740992"),
        ({"threads": 1.0}, "threads: is 1.0; give a whole number of 0 or more"),
        ({"until": "3"}, "until: is '3'; give a number"),
        ({"step": True}, "step: is True; give a number"),
        ({"pace": "1"}, "pace: is '1'; give a number"),
        (
            {"overrides": ["network.loss=0.2"]},
            """overrides: is ['network.loss=0.2'], not a mapping; give values by name: {"network.loss": 0.1}""",
        ),
    ],
)
def test_wrong_kinds_are_refused_as_in_a_description(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        RunOptions(**wrong)
    assert str(caught.value) == message

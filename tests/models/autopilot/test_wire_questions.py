"""The questions of `benchmarks.wire`: which of our answers are not ArduCopter's, and that the comparison finds them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import wire
from benchmarks.wire import Answer, ask_ours, ask_real, compare, differs, expected, fly
from benchmarks.wire_questions import FAILED, OK, QUESTIONS, Question, long
from tests.models.copter import Copter

OURS_DIFFER: set[str] = set()
"""Questions to which ours gives another answer than ArduCopter (docs/arducopter.md)."""


def test_the_answers_are_arducopters_except_a_known_few() -> None:
    assert len(QUESTIONS) == len({question.name for question in QUESTIONS}) == 284
    answers = ask_ours(QUESTIONS)
    theirs = {question.name: expected(question) for question in QUESTIONS}
    found = {question.name: (one, other) for question, one, other in compare(QUESTIONS, answers, theirs)}
    assert set(found) == OURS_DIFFER, {name: found[name] for name in set(found) - OURS_DIFFER}


def test_the_real_one_is_asked_alike_and_started_again_after_a_change_of_state() -> None:
    names = (
        "SET_SERVO",
        "SET_RELAY 5",
        "LAND",
        "PAUSE",
        "MAG_CAL start",
        "CALIBRATION none",
        "REQUEST_MESSAGE 31 ATTITUDE_QUATERNION",
    )
    some = [question for question in QUESTIONS if question.name in names]
    started = 0

    def begin() -> Copter:
        nonlocal started
        started += 1
        copter = Copter()
        copter.run(3.0)
        return copter

    assert compare(some, ask_ours(some), ask_real(some, begin)) == []
    assert started == 2  # in the air and on the ground: after LAND, GUIDED is set again


@pytest.mark.parametrize(
    ("other", "expected_to_differ"),
    [
        (Answer(OK, ("word",), ("WIND",)), False),
        (Answer(FAILED, ("word",), ("WIND",)), True),
        (Answer(None, ("word",), ("WIND",)), True),
        (Answer(OK, (), ("WIND",)), True),
        (Answer(OK, ("word",), ()), True),
    ],
)
def test_each_part_of_an_answer_counts(other: Answer, expected_to_differ: bool) -> None:
    question = Question("question", "air", long(1), OK, ("word",), ("WIND",))
    assert differs(question, expected(question), other) == expected_to_differ
    varying = Question("question", "air", long(1), OK, None, None)
    assert differs(varying, expected(question), other) == (other.result != OK)


def test_a_copter_that_does_not_fly_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="command 400 was refused"):
        fly(Copter(autopilot={"BATT_ARM_VOLT": 20.0, "estimate_ready_time": 0.0}))


def test_the_command_prints_what_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARDUPILOT_SITL", raising=False)
    wrong = Question("BANNER wrongly", "air", long(42428), FAILED)
    some = (*(question for question in QUESTIONS if question.name == "PAUSE"), wrong)
    monkeypatch.setattr(wire, "QUESTIONS", some)
    wire.main(["--json", str(tmp_path / "wire.json")])
    assert "1 of 2 answers equal those of the table" in capsys.readouterr().out
    found = json.loads((tmp_path / "wire.json").read_text())
    assert (found["questions"], found["differ"]) == (2, ["BANNER wrongly"])

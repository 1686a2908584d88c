"""Asks the autopilot what a ground station asks, and prints which answers are not ArduCopter's.

Each question is asked in the same state. With ArduCopter, which ARDUPILOT_SITL names, both are asked and compared;
without it, ours is compared with the answers of `benchmarks.wire_questions`.

    python -m benchmarks.wire [--json FILE]
    ARDUPILOT_SITL=... python -m benchmarks.wire
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.report import machine, show, write
from benchmarks.wire_questions import AIR, QUESTIONS, Question
from tests.models.copter import GUIDED, STABILIZE, Copter, preset
from tests.models.real_copter import READY, RealCopter

LISTEN = 0.3
"""Time [s] in which answers are collected."""
WAITS = 5
"""How often this time may pass: a simulated ArduCopter answers later on a busy machine."""
BESIDE = {"COMMAND_ACK", "STATUSTEXT", "HEARTBEAT", "TIMESYNC", "PARAM_VALUE", "UNKNOWN_437"}
"""Types of messages that come unasked, or are compared otherwise; 437, AVAILABLE_MODES_MONITOR, comes every 5 s after
the first request for modes.
"""


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of the acknowledgement (None: there was none), words of texts, types of other messages."""

    result: int | None
    texts: tuple[str, ...]
    reply: tuple[str, ...]


def heard(copter: Copter, question: Question) -> Answer:
    """Sends a question; returns what comes back, and waits longer if the answer of the table is not complete yet."""
    expected = set(question.reply or ())
    copter.heard.clear()
    copter.send(question.message)
    for _ in range(WAITS):
        copter.run(LISTEN)
        results = [message.result for message in copter.messages("COMMAND_ACK")]
        kinds = [message.get_type() for _, message in copter.heard]
        if (results or question.result is None) and expected <= set(kinds):
            break
    texts = tuple(text for message in copter.messages("STATUSTEXT") if not (text := message.text).startswith("PreArm"))
    reply = tuple(dict.fromkeys(kind for kind in kinds if kind not in BESIDE - expected))
    return Answer(results[0] if results else None, texts, reply)


def fly(copter: Copter) -> None:
    """Takes off to 10 m in GUIDED."""
    for command in ((176, 1, GUIDED), (400, 1), (22, 0, 0, 0, 0, 0, 0, 10.0)):
        copter.answers()
        copter.command(*command)
        result = None
        for _ in range(WAITS):
            copter.run(LISTEN)
            result = next((found for kind, _, found in copter.answers() if kind == "ACK"), result)
            if result is not None:
                break
        if result != 0:
            raise RuntimeError(f"command {command[0]} was refused or not answered: {result}")
    copter.run(20.0)


def restore(record: Any, content: bytes) -> None:
    """Gives a record of a model its former content."""
    former = np.frombuffer(content, dtype=record.dtype)[0]
    for name in record.dtype.names:
        record[name] = former[name]


def ask_ours(questions: Sequence[Question]) -> dict[str, Answer]:
    """Asks `Autopilot`; returns its answers by the names of the questions. Each finds the same state."""
    answers: dict[str, Answer] = {}
    for state in dict.fromkeys(question.state for question in questions):
        copter = Copter()
        copter.run(3.0)
        if state == AIR:
            fly(copter)
        records, step = (copter.v, copter.m), copter.step
        kept = [record.tobytes() for record in records]
        for question in questions:
            if question.state == state:
                copter.step = step
                for record, content in zip(records, kept, strict=True):
                    restore(record, content)
                answers[question.name] = heard(copter, question)
    return answers


def ask_real(questions: Sequence[Question], begin: Callable[[], Copter]) -> dict[str, Answer]:
    """Asks ArduCopter, which `begin` starts; it is started again where a question has changed its state for good."""
    answers: dict[str, Answer] = {}
    for state in dict.fromkeys(question.state for question in questions):
        copter: Copter | None = None
        for question in questions:
            if question.state != state:
                continue
            if copter is None:
                copter = begin()
                if state == AIR:
                    fly(copter)
            answers[question.name] = heard(copter, question)
            if not returned(copter, state):
                close(copter)
                copter = None
        if copter is not None:
            close(copter)
    return answers


def returned(copter: Copter, state: str) -> bool:
    """Returns whether a copter is in the state of the questions: silent, in its mode, armed or not.

    Streams that a question has begun are switched off, its uploads are waited for, and its mode is set back.
    """
    mode, armed = (GUIDED, True) if state == AIR else (STABILIZE, False)
    for _ in range(2 * WAITS):
        copter.heard.clear()
        copter.run(1.5)  # a HEARTBEAT, and streams of 1 Hz
        beat = copter.messages("HEARTBEAT")[-1]
        others = {message.get_msgId() for _, message in copter.heard if message.get_type() not in BESIDE}
        if bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) != armed:
            return False
        for number in others:
            copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, -1)
        if beat.custom_mode != mode:
            copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
        elif not others:
            return True
    return False


def close(copter: Copter) -> None:
    """Ends ArduCopter."""
    if isinstance(copter, RealCopter):
        copter.close()


def real_copter(folder: Path) -> Callable[[], Copter]:
    """Returns a function that starts ArduCopter and waits for its position estimate."""
    count = 0

    def begin() -> Copter:
        nonlocal count
        count += 1
        copter = RealCopter(folder / str(count), preset("ardupilot_json"))
        copter.run(READY)
        return copter

    return begin


def expected(question: Question) -> Answer:
    """The answer in the table."""
    return Answer(question.result, question.texts or (), question.reply or ())


def differs(question: Question, one: Answer, other: Answer) -> bool:
    """Returns whether two answers differ in what does not vary."""
    return (
        one.result != other.result
        or (question.texts is not None and one.texts != other.texts)
        or (question.reply is not None and set(one.reply) != set(other.reply))
    )


def told(answer: Answer) -> str:
    """An answer in a cell of the table."""
    parts = ["-" if answer.result is None else str(answer.result), *answer.texts, *answer.reply]
    return "; ".join(parts)


def compare(
    questions: Sequence[Question], ours: dict[str, Answer], theirs: dict[str, Answer]
) -> list[tuple[Question, Answer, Answer]]:
    """Returns the questions whose answers differ, with ours and theirs."""
    return [
        (question, ours[question.name], theirs[question.name])
        for question in questions
        if differs(question, ours[question.name], theirs[question.name])
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    ours = ask_ours(QUESTIONS)
    theirs = {question.name: expected(question) for question in QUESTIONS}
    whose = "the table"
    if os.environ.get("ARDUPILOT_SITL"):
        whose = "ArduCopter"
        with tempfile.TemporaryDirectory(prefix="uav-cosim-wire-") as folder:
            theirs = ask_real(QUESTIONS, real_copter(Path(folder)))
    found = compare(QUESTIONS, ours, theirs)
    rows = [[question.name, told(one), told(other)] for question, one, other in found]
    host = machine("pymavlink")
    note = f"{len(QUESTIONS) - len(found)} of {len(QUESTIONS)} answers equal those of {whose}"
    show("On the wire", host, ["question", "ours", whose], rows, note)
    write(
        options.json,
        host,
        {
            "benchmark": "wire",
            "questions": len(QUESTIONS),
            "than": whose,
            "differ": [question.name for question, _, _ in found],
            "answers": {name: [told(ours[name]), told(theirs[name])] for name in ours},
        },
    )


if __name__ == "__main__":
    main()

"""The probes of a simulated ArduCopter that were recorded: ours gives the same results and texts, in the same modes."""

from __future__ import annotations

import math
import re
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import RECORDINGS, Copter

PROBE = re.compile(r"(LONG|INT) (\d+) (?:frame=(\d+) )?\[(.*?)\](?: ts=(\d+) tc=(\d+))? \| (.*?) *-> (.*)")
STATE = re.compile(r"mode=(\d+) armed=(\d)")
ESTIMATOR = ("EKF3", "AHRS: EKF3")
"""Begin of texts on the progress of an estimator that ours does not have."""


def expected(answers: str) -> tuple[list[tuple[int, int]], list[tuple[int, str]]]:
    """ACKs (command, result) and texts (severity, words) of a recorded line."""
    acks = [(int(c), int(r)) for c, r in re.findall(r"ACK cmd=(\d+) result=(\d+)", answers)]
    texts = [(int(s), words.strip()) for s, words in re.findall(r"TEXT\[(\d)\] ([^;]*)", answers)]
    return acks, [(s, words) for s, words in texts if not words.startswith(ESTIMATOR)]


def send(copter: Copter, kind: str, number: int, frame: str | None, values: list[float]) -> None:
    if kind == "LONG":
        copter.command(number, *values)
        return
    p1, p2, p3, p4, x, y, z = values
    copter.send(
        mavlink.MAVLink_command_int_message(1, 1, int(frame or 0), number, 0, 0, p1, p2, p3, p4, int(x), int(y), z)
    )


def heard(copter: Copter) -> tuple[list[tuple[int, int]], list[tuple[int, str]]]:
    answers: list[Any] = copter.answers()
    acks = [(command, result) for what, command, result in answers if what == "ACK"]
    return acks, [(severity, words) for what, severity, words in answers if what == "TEXT"]


def test_the_recorded_probes_are_answered_as_arducopter_answered_them() -> None:
    copter = Copter()
    copter.run(0.1)
    probes = 0
    for line in (RECORDINGS / "command_answers.txt").read_text().splitlines():
        if "PREARM ok" in line:
            copter.run(1.3 - copter.time)
        elif "EKF ok" in line:
            copter.run(2.1 - copter.time)
        if probe := PROBE.match(line):
            kind, number, frame, parameters, _, _, what, answers = probe.groups()
            wanted = expected(answers)
            copter.answers()
            send(copter, kind, int(number), frame, [float(x) for x in parameters.split(",")])
            # Where the recording waited until it was disarmed for idling, so do we.
            waits = (6, "Disarming motors") in wanted[1] and int(number) != 400
            copter.run(11.0 if waits else 0.05)
            assert heard(copter) == wanted, what
            probes += 1
        if state := STATE.search(line):
            assert (int(copter.m["mode"]), int(copter.m["armed"])) == tuple(map(int, state.groups())), line
    assert probes == 16
    assert math.isfinite(copter.time)

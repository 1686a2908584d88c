"""Asks the autopilots of rover, fixed wing and quadplane what a ground station asks, and ArduRover and ArduPlane, too.

ARDUPILOT_SITL names a program beside which `ardurover` and `arduplane` lie. The questions are those of
`benchmarks.wire`; "air" means armed in GUIDED: a rover that stands, a plane that circles, a quadplane that hovers.
Words count as equal whatever measured number with a decimal point they tell ("Transition started airspeed 0.4"). Our
quadplane has ArduPlane's Q_GUIDED_MODE 0, and no battery monitor. Before each question, the firmware is listened to
until it is silent.

    ARDUPILOT_SITL=... python -m benchmarks.wire_others [rover|plane|quadplane ...] [--json FILE]
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.report import machine, show, write
from benchmarks.wire import BESIDE, Answer, differs, heard, restore, told
from benchmarks.wire_questions import AIR, GROUND, QUESTIONS, Question, long
from cosim import Model
from cosim_models.autopilot.plane_autopilot import PlaneAutopilot
from cosim_models.autopilot.quadplane_autopilot import QuadplaneAutopilot
from cosim_models.autopilot.rover_autopilot import RoverAutopilot
from cosim_models.vehicles.fixed_wing import FixedWing
from cosim_models.vehicles.quadplane import Quadplane
from cosim_models.vehicles.rover import Rover
from tests.models.copter import preset
from tests.models.pair import Pair
from tests.models.real_copter import READY, RealCopter

TAKEOFF = (22, 0, 0, 0, 0, 0, 0, 20.0)
SILENCE = mavlink.MAVLink_request_data_stream_message(1, 1, 0, 0, 0)
"""ArduRover and ArduPlane stream at 1 Hz before they are asked."""
HOME = {"HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
"""Messages that ArduPlane repeats every 6 s, unasked, while it is disarmed."""
LASTING = {"FIXED_MAG_CAL_YAW", "MAG_CAL start", "MAG_CAL cancel"}
"""Questions after which a firmware does not arm until it is booted again."""
PATIENCE = 12
"""Times of 1.2 s in which a firmware has to become silent: it waits for the items of an upload for 8 s."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A vehicle, our autopilot of it, and how it gets into the state "air".

    Attributes:
        body: parameters of the vehicle beside ArduPilot's program.
        pilot: parameters of our autopilot.
        begin: commands and, after each, the time to wait [s].
        guided: mode in the air.
    """

    vehicle: type[Model]
    autopilot: type[Model]
    firmware: str
    body: dict[str, Any]
    begin: tuple[tuple[tuple[float, ...], float], ...]
    pilot: dict[str, Any] = field(default_factory=dict)


KINDS = {
    "rover": Kind(Rover, RoverAutopilot, "ArduRover", {}, (((176, 1, 15), 0.5), ((400, 1), 3.0))),
    "plane": Kind(
        FixedWing,
        PlaneAutopilot,
        "ArduPlane",
        preset("ardupilot_plane"),
        (((176, 1, 13), 0.5), ((400, 1), 40.0), ((176, 1, 15), 20.0)),
    ),
    "quadplane": Kind(
        Quadplane,
        QuadplaneAutopilot,
        "ArduPlane",
        preset("ardupilot_quadplane"),
        (((176, 1, 15), 0.5), ((400, 1), 0.5), (TAKEOFF, 20.0)),
        {"Q_GUIDED_MODE": 0, "BATT_MONITOR": 0},
    ),
}


class Ours(Pair):
    """A `Pair` with the interface by which `benchmarks.wire` asks."""

    def run(self, duration: float) -> None:
        self.until(self.time + duration)

    def messages(self, name: str) -> list[Any]:
        return [message for message in self.heard if message.get_type() == name]

    def answer(self, question: Question) -> Answer:
        class Asked:
            """`heard` wants times beside messages."""

            send, run, messages = self.send, self.run, self.messages

            @property
            def heard(asked: Any) -> Any:
                return _Timed(self.heard)

        return heard(Asked(), question)  # type: ignore[arg-type]


class _Timed:
    """Messages as pairs with a time."""

    def __init__(self, messages: list[Any]) -> None:
        self.clear = messages.clear
        self._messages = messages

    def __iter__(self) -> Any:
        return ((0.0, message) for message in self._messages)


def asked(question: Question, answer: Answer) -> Answer:
    """The answer without messages that come unasked on the ground."""
    unasked = HOME - set(question.reply or ()) if question.state == GROUND else set()
    return Answer(answer.result, answer.texts, tuple(name for name in answer.reply if name not in unasked))


def ask_ours(kind: Kind) -> dict[str, Answer]:
    """Asks our autopilot on the default vehicle; each question finds the same state."""
    answers: dict[str, Answer] = {}
    for state in dict.fromkeys(question.state for question in QUESTIONS):
        pair = Ours(kind.vehicle, kind.autopilot, pilot=kind.pilot)
        pair.run(3.0)
        if state == AIR:
            for command, wait in kind.begin:
                if pair.ask(int(command[0]), *command[1:]) != 0:
                    raise RuntimeError(f"command {command[0]:g} was refused by {kind.autopilot.__name__}")
                pair.run(wait)
        records, step = (pair.v, pair.m), pair.step
        kept = [record.tobytes() for record in records]
        for question in QUESTIONS:
            if question.state == state:
                pair.step = step
                for record, content in zip(records, kept, strict=True):
                    restore(record, content)
                answers[question.name] = asked(question, pair.answer(question))
    return answers


def begun(kind: Kind, folder: Path, state: str) -> RealCopter:
    """Starts the firmware and brings it into a state.

    Raises:
        RuntimeError: it refuses a command.
    """
    one = RealCopter(folder, kind.body, model=kind.vehicle, instance=216)
    one.run(READY)
    one.send(SILENCE)
    for command, wait in kind.begin if state == AIR else ():
        answers: list[Any] = []
        for _ in range(60):  # its logging starts by the wall clock: "Arm: Logging not started"
            answers += one.ask(int(command[0]), *command[1:])
            if ("ACK", int(command[0]), 0) in answers:
                break
            one.run(1.0)
            answers += one.answers()
            time.sleep(0.25)
        else:
            one.close()
            raise RuntimeError(f"command {command[0]:g} was refused by {kind.firmware}: {answers}")
        one.run(wait)
    return one


def ask_real(kind: Kind, folder: Path) -> dict[str, Answer]:
    """Asks the firmware, which is started again where a question has changed its state or stopped it."""
    answers: dict[str, Answer] = {}
    for state in dict.fromkeys(question.state for question in QUESTIONS):
        one: RealCopter | None = None
        for number, question in enumerate(QUESTIONS):
            if question.state != state:
                continue
            if one is None:
                one = begun(kind, folder / f"{state}{number}", state)
                before = state_of(one)
            try:
                answer = heard(one, question)
                answers[question.name] = asked(question, answer)
                if question.name.startswith("SET_MESSAGE_INTERVAL"):
                    one.send(*(long(511, number, -1) for number in (30, 31, 33, 83, 105, 100, 132)))
                same = question.name not in LASTING and state_of(one) == before
                same = same and not any(text.startswith("Transition") for text in answer.texts)
            except (TimeoutError, RuntimeError) as error:
                answers[question.name] = Answer(None, (f"stopped: {str(error)[:60]}",), ())
                same = False
            if not same:
                one.close()
                one = None
        if one is not None:
            one.close()
    return answers


def state_of(one: RealCopter) -> tuple[int, bool]:
    """Mode and whether it is armed, by the next HEARTBEAT, when the firmware is silent again."""
    for _ in range(PATIENCE):
        one.heard.clear()
        one.run(1.2)
        if {message.get_type() for _, message in one.heard} <= BESIDE | HOME:
            break
    beat = one.messages("HEARTBEAT")[-1]
    return int(beat.custom_mode), bool(beat.base_mode & 128)


def unmeasured(answer: Answer) -> Answer:
    """The answer without the measured numbers in its words."""
    return Answer(answer.result, tuple(re.sub(r"-?\d+\.\d+", "#", text) for text in answer.texts), answer.reply)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    host, differ = machine("pymavlink"), {}
    for name in options.kinds or KINDS:
        kind = KINDS[name]
        ours = ask_ours(kind)
        with tempfile.TemporaryDirectory(prefix="uav-cosim-wire-") as folder:
            theirs = ask_real(kind, Path(folder))
        found = [one for one in QUESTIONS if differs(one, unmeasured(ours[one.name]), unmeasured(theirs[one.name]))]
        rows = [[one.name, told(ours[one.name]), told(theirs[one.name])] for one in found]
        note = f"{len(QUESTIONS) - len(found)} of {len(QUESTIONS)} answers equal those of {kind.firmware}"
        show(f"On the wire: {name}", host, ["question", "ours", kind.firmware], rows, note)
        differ[name] = [row[0] for row in rows]
    write(options.json, host, {"benchmark": "wire_others", "questions": len(QUESTIONS), "differ": differ})


if __name__ == "__main__":
    main()

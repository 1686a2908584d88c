"""The user's ArduCopter, where ARDUPILOT_SITL names one: it says and does what our stand-in and autopilot do."""

from __future__ import annotations

import os
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.ardupilot.json_interface import Servos
from tests.models.autopilot.test_command_answers import PROBE, STATE, expected, heard, send
from tests.models.copter import ACCEPTED, GUIDED, RECORDED_AUTOPILOT, RECORDINGS, Copter, preset
from tests.models.real_copter import READY, RealCopter

pytestmark = [
    pytest.mark.alone,
    pytest.mark.slow,
    pytest.mark.skipif("ARDUPILOT_SITL" not in os.environ, reason="ARDUPILOT_SITL names no arducopter"),
]
WAITS = "PreArm: Need Position Estimate"
"""It says this once in 30 s, whatever is asked."""


@pytest.fixture
def real(tmp_path: Path) -> Iterator[Callable[..., RealCopter]]:
    made: list[RealCopter] = []

    def make(**options: Any) -> RealCopter:
        number = len(made)
        made.append(RealCopter(tmp_path / str(number), preset("ardupilot_json"), instance=210 + number, **options))
        return made[-1]

    yield make
    for copter in made:
        copter.close()


def version(copter: Copter) -> tuple[int, int]:
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    copter.run(0.2)
    number = copter.messages("AUTOPILOT_VERSION")[-1].flight_sw_version
    return number >> 24, number >> 16 & 0xFF


def rates(copter: Copter, duration: float) -> dict[str, float]:
    """How often [Hz] messages come."""
    copter.heard.clear()
    copter.run(duration)
    counts = Counter(message.get_type() for _, message in copter.heard)
    return {name: count / duration for name, count in counts.items()}


def fly(copter: RealCopter) -> NDArray[np.float64]:
    """Ready, up to 10 m, and 8 m north."""
    rows = [copter.run(READY)]
    for command in (
        (mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1),
        (mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0),
    ):
        assert ("ACK", command[0], ACCEPTED) in copter.ask(*command)
    rows.append(copter.run(14.0))
    copter.go(8.0, 0.0, -10.0)
    rows.append(copter.run(8.0))
    return np.concatenate(rows)


def test_a_flight_is_repeated(real: Callable[..., RealCopter]) -> None:
    """Often to the last bit, but not always (docs/arducopter.md)."""
    one, other = real(), real()
    flown = fly(one)
    assert flown[-1, 1:3] == pytest.approx([8.0, 0.0], abs=0.25)
    assert flown[-1, 3] == pytest.approx(-10.0, abs=0.6)  # 4.5 takes itself to be 0.45 m higher than it is
    assert np.abs(flown[:40000, 1:4]).max() < 0.01  # it stands until it is armed
    assert np.abs(fly(other) - flown)[:, 1:4].max() < 0.1
    for copter in (one, other):
        assert (copter.m["lost"], copter.m["restarts"]) == (0, 0)


def test_its_first_words_are_those_of_the_stand_in(
    real: Callable[..., RealCopter], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Servo packets of 16 and 32 channels, its clock, its first heartbeats."""
    came: list[Servos] = []
    for options, channels in (({}, 16), ({"SERVO_32_ENABLE": 1}, 32)):
        copter = real(parameters=options)
        heard_of = copter.slave._link._is_new

        def note(servos: Servos, peer: Any, known: Any = heard_of) -> Any:
            came.append(servos)
            return known(servos, peer)

        monkeypatch.setattr(copter.slave._link, "_is_new", note)
        copter.run(3.2)
        assert {len(servos.pwm) for servos in came} == {channels}
        numbers = dict.fromkeys(s.frame_count for s in came)  # again is what it says when it has waited
        assert [n for n in numbers if n] == list(range(1, 3201))
        assert tuple(came[100].pwm) == (1000,) * channels
        assert tuple(came[-1].pwm) == (1000, 1000, 1000, 1000, *[0] * (channels - 4))
        beats = [(round(t, 1), m.base_mode, m.custom_mode) for t, m in copter.heard if m.get_type() == "HEARTBEAT"]
        assert beats[0] in ((1.0, 89, 0), (1.0, 81, 0))  # 4.7 and 4.5
        assert beats[-1] == (3.0, 81, 0)
        assert copter.answers() == []
        came.clear()


def test_its_clock_is_the_masters(real: Callable[..., RealCopter]) -> None:
    copter = real()
    copter.run(20.0)
    copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 100_000)
    copter.heard.clear()
    copter.run(20.0)
    last, message = [(t, m) for t, m in copter.heard if m.get_type() == "ATTITUDE"][-1]
    assert last - 0.012 <= message.time_boot_ms / 1000 <= last + 0.002  # its serial port waits up to 10 ms


def test_it_reboots_and_the_flight_goes_on(real: Callable[..., RealCopter]) -> None:
    copter = real()
    copter.run(5.0)
    assert ("ACK", mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, ACCEPTED) in copter.ask(
        mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1
    )
    copter.heard.clear()
    copter.run(5.0)
    assert copter.m["restarts"] == 1
    assert [m.base_mode for m in copter.messages("HEARTBEAT")][-1] == 81
    assert copter.m["clock"] == pytest.approx(copter.time)


def test_it_is_attached_to_and_started_anew(real: Callable[..., RealCopter], tmp_path: Path) -> None:
    """An ArduCopter of somebody else's, by TCP; killed and started again, it is found again."""
    command = [os.environ["ARDUPILOT_SITL"], "-I215", "--model", "JSON:127.0.0.1", "--sysid", "9"]
    command += ["--home", "-35.363262,149.165237,584,0", "--speedup", "100"]

    def started() -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    process = started()
    try:
        copter = RealCopter(tmp_path / "attached", preset("ardupilot_json"), instance=215, attach=True)
        copter.run(3.0)
        assert {m.get_srcSystem() for m in copter.messages("HEARTBEAT")} == {9}
        process.kill()
        process.wait()
        process = started()
        copter.heard.clear()
        copter.run(3.0)
        assert copter.m["restarts"] == 1
        assert {m.get_srcSystem() for m in copter.messages("HEARTBEAT")} == {9}
        copter.close()
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()


def test_it_answers_the_recorded_probes_as_recorded(real: Callable[..., RealCopter]) -> None:
    copter = real()
    copter.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    copter.run(3.0)
    if version(copter) < (4, 7):
        pytest.skip("the probes are those of 4.7")
    copter.run(4.0 - copter.time)
    for line in (RECORDINGS / "command_answers.txt").read_text().splitlines():
        if "PREARM ok" in line:
            copter.run(25.0 - copter.time)
        elif "EKF ok" in line:
            copter.run(READY - copter.time)
        if probe := PROBE.match(line):
            kind, number, frame, parameters, _, _, what, answers = probe.groups()
            acks, texts = expected(answers)
            copter.answers()
            send(copter, kind, int(number), frame, [float(x) for x in parameters.split(",")])
            copter.run(11.0 if (6, "Disarming motors") in texts and int(number) != 400 else 0.15)
            found = heard(copter)
            assert found[0] == acks, what
            # Which checks of its estimator fail at once after the start hangs on the moment.
            assert {t for t in found[1] if t[1] != WAITS} <= {t for t in texts if t[1] != WAITS}, what
        if state := STATE.search(line):
            copter.run(1.1)  # of the next heartbeat
            assert (int(copter.m["mode"]), int(copter.m["armed"])) == tuple(map(int, state.groups())), line


def test_its_parameters_streams_and_messages_are_ours(real: Callable[..., RealCopter]) -> None:
    """What ours has, it has: names, values and types of parameters; which messages come when asked, and how often."""
    theirs, ours = real(), Copter(vehicle=preset("ardupilot_json"), autopilot=RECORDED_AUTOPILOT)
    found: list[dict[str, Any]] = []
    for copter in (theirs, ours):
        copter.run(READY)
        quiet = rates(copter, 5.0)
        copter.heard.clear()
        copter.send(mavlink.MAVLink_param_request_list_message(1, 1))
        copter.run(9.0)
        parameters = {m.param_id: (m.param_value, m.param_type) for m in copter.messages("PARAM_VALUE")}
        copter.send(mavlink.MAVLink_request_data_stream_message(0, 0, 0, 4, 1))
        copter.run(1.0)
        streams = rates(copter, 5.0)
        copter.send(mavlink.MAVLink_request_data_stream_message(0, 0, 0, 0, 0))
        copter.run(1.0)
        for message, interval in ((30, 20_000), (33, 250_000), (193, 1_000_000)):
            copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, interval)
        found.append({"quiet": quiet, "parameters": parameters, "streams": streams, "asked": rates(copter, 10.0)})
    real_, own = found
    own["parameters"]["PSC_VELXY_D"] = (0.25 if version(theirs) >= (4, 7) else 0.5, 9)
    other = ("SR0_", "SR1_", "SR2_", "SYSID_", "RNGFND1_M")  # named otherwise in 4.7; not listed without a rangefinder
    for name, (value, kind) in own["parameters"].items():
        if name in real_["parameters"] or not name.startswith(other):
            assert real_["parameters"][name] == (pytest.approx(value, rel=1e-6), kind), name
    assert own["quiet"] == {"HEARTBEAT": 1.0}
    assert set(real_["quiet"]) - {"TIMESYNC", "PARAM_VALUE"} == {"HEARTBEAT"}
    # Second sensors, terrain and wind, which ours sends from the start, and the real one when it has them.
    beyond = {"SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE2", "TERRAIN_REPORT", "TERRAIN_REQUEST", "WIND"}
    beyond |= {"TIMESYNC", "PARAM_VALUE", "STATUSTEXT"}
    for state in ("streams", "asked"):
        theirs_, ours_ = ({k: v for k, v in one[state].items() if k not in beyond} for one in (real_, own))
        assert theirs_ == pytest.approx(ours_, abs=0.21), state

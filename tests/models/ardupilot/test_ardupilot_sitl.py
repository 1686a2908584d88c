"""ArduPilotSITL against a stand-in that speaks ArduPilot's JSON interface: formats, lock step, MAVLink, failures."""

from __future__ import annotations

import base64
import json
import math
import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.ardupilot.firmware import FRAMES, Firmware, put_commands
from cosim_models.ardupilot.json_interface import Link, Servos, decode_servos
from cosim_models.ardupilot.replies import REPLY_SIZE, put_number, put_reply
from cosim_models.ardupilot.sitl import ArduPilotSITL, _packets

STAND_IN = Path(__file__).parents[1] / "sitl_stand_in.py"
pytestmark = pytest.mark.alone

INSTANCE = 240
"""So that its ports are above those of anything that runs here."""

# ---- formats ---------------------------------------------------------------------------------------------------------


def test_servo_packets_of_both_sizes() -> None:
    """The first one is that of a real ArduCopter 4.7."""
    found = decode_servos(bytes.fromhex("1a48b00400000000" + 16 * "e803"))
    assert found is not None
    assert (found.rate, found.frame_count, tuple(found.pwm)) == (1200, 0, (1000,) * 16)
    found = decode_servos(struct.pack("<HHI16H", 18458, 1200, 7, *range(1000, 1016)))
    assert found is not None
    assert (found.rate, found.frame_count, tuple(found.pwm)) == (1200, 7, tuple(range(1000, 1016)))
    found = decode_servos(struct.pack("<HHI32H", 29569, 801, 2**32 - 1, *range(32)))
    assert found is not None
    assert (found.rate, found.frame_count, tuple(found.pwm)) == (801, 2**32 - 1, tuple(range(32)))


@given(st.binary(max_size=100))
def test_anything_else_is_no_servo_packet(datagram: bytes) -> None:
    sizes = {18458: 40, 29569: 72}
    if len(datagram) < 2 or sizes.get(int.from_bytes(datagram[:2], "little")) != len(datagram):
        assert decode_servos(datagram) is None


def as_text(x: float) -> str:
    buffer = np.zeros(32, np.uint8)
    return buffer[: put_number(buffer, 0, x)].tobytes().decode()


@given(st.floats())
def test_a_number_is_read_as_the_float_that_was_written(x: float) -> None:
    found = json.loads(as_text(x))
    assert found == x or (math.isnan(found) and math.isnan(x))
    assert len(as_text(x)) <= 24


def test_numbers_where_digits_and_bits_are_closest() -> None:
    """Every power of two and of ten, and the floats beside them."""
    powers = [2.0**e for e in range(-1074, 1024)] + [float(f"1e{e}") for e in range(-323, 309)]
    for x in powers:
        for y in (x, math.nextafter(x, 0.0), math.nextafter(x, math.inf)):
            assert float(as_text(y)) == y


def test_numbers_as_text() -> None:
    expected = {
        0.0: "0",
        1.0: "1",
        -0.5: "-5e-1",
        100.0: "1e2",
        1234.5: "1.2345e3",
        -(2.0**-1074): "-4.9406564584124654e-324",
    }
    assert {x: as_text(x) for x in expected} == expected
    assert [as_text(x) for x in (math.inf, -math.inf, math.nan)] == ["Infinity", "-Infinity", "NaN"]


numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)


def reply_of(t: float, motion: Sequence[float]) -> bytes:
    """The motion in the order of MOTION, among other numbers of a record."""
    buffer, record = np.zeros(REPLY_SIZE, np.uint8), np.full(20, math.nan)
    record[3:19] = motion
    return buffer[: put_reply(buffer, t, record, np.arange(3, 19))].tobytes()


@given(st.floats(0, 1e6), st.lists(numbers, min_size=16, max_size=16))
def test_a_reply_is_a_line_of_json_without_spaces(t: float, x: list[float]) -> None:
    reply = reply_of(t, x)
    assert reply[:1] == reply[-1:] == b"\n"
    assert b" " not in reply
    assert json.loads(reply) == {
        "timestamp": t * (1.0 + 1e-8),
        "imu": {"gyro": x[:3], "accel_body": x[3:6]},
        "position": x[6:9],
        "quaternion": x[9:13],
        "velocity": x[13:],
    }


AT_REST = [0.0] * 5 + [-9.80665, 0.0, 0.0, 0.0, 1.0] + [0.0] * 6


def test_a_reply_as_flown_with_a_real_arducopter() -> None:
    assert reply_of(0.001, AT_REST) == (
        b'\n{"timestamp":1.00000001e-3,"imu":{"gyro":[0,0,0],"accel_body":[0,0,-9.8066499999999994]},"position":[0,0,0],'
        b'"quaternion":[1,0,0,0],"velocity":[0,0,0]}\n'
    )


def test_the_longest_reply_fits() -> None:
    assert len(reply_of(1.2345678901234567e-300, [-1.2345678901234567e-300] * 16)) < REPLY_SIZE


@pytest.mark.parametrize("step", [0.001, 0.00125])
@pytest.mark.parametrize("begin", [0.0, 3600.0])
def test_arducopters_clock_loses_nothing(step: float, begin: float) -> None:
    """It is a count of microseconds, to which each difference is added and cut off."""
    clock, last = 0, begin * (1.0 + 1e-8)
    for k in range(1, 20001):
        reply = reply_of(begin + k * step, AT_REST)
        timestamp = json.loads(reply)["timestamp"]
        clock = int(clock + (timestamp - last) * 1e6)
        last = timestamp
    assert clock == round(20000 * step * 1e6)


def test_serial_bytes_are_cut_behind_the_last_whole_packet_and_text_is_left_out() -> None:
    link = mavlink.MAVLink(None, srcSystem=1)
    packet = bytes(link.heartbeat_encode(2, 3, 0, 0, 3).pack(link))
    assert _packets(b"", 100) == (b"", 0)
    assert _packets(packet + packet[:-1], 4096) == (packet, len(packet))
    assert _packets(3 * packet, 2 * len(packet) + 1) == (2 * packet, 2 * len(packet))
    hello = b"\n\nInit ArduCopter V4.7.0-dev\n\nFree RAM: 131072\n"
    assert _packets(hello, 4096) == (b"", len(hello))
    assert _packets(hello + packet + hello + packet[:5], 4096) == (packet, 2 * len(hello) + len(packet))
    assert _packets(hello + packet, 10) == (b"", 0)
    assert _packets(b"xx\xfd\x09", 4096) == (b"", 2)


# ---- lock step, by hand ----------------------------------------------------------------------------------------------


class Autopilot:
    """ArduPilot's end, moved by the test."""

    def __init__(self, port: int) -> None:
        self.to = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(30)
        self.socket.bind(("127.0.0.1", 0))

    def send(self, frame: int, pwm: int = 1000) -> None:
        self.socket.sendto(struct.pack("<HHI16H", 18458, 1200, frame, *[pwm] * 16), self.to)

    def received(self) -> bytes:
        return self.socket.recv(65536)

    def nothing_received(self) -> bool:
        self.socket.setblocking(False)
        try:
            self.socket.recv(65536)
        except BlockingIOError:
            return True
        finally:
            self.socket.settimeout(30)
        return False


@pytest.fixture
def pair() -> Iterator[tuple[Link, Autopilot]]:
    link = Link(0)
    autopilot = Autopilot(link._socket.getsockname()[1])
    yield link, autopilot
    link.close()
    autopilot.socket.close()


def alive() -> None:
    pass


def exchange(link: Link, reply: bytes, seconds: float, alive: Callable[[], None]) -> Servos:
    link.reply(reply)
    return link.next(seconds, alive)


def test_nothing_is_answered_before_the_step(pair: tuple[Link, Autopilot]) -> None:
    link, autopilot = pair
    autopilot.send(0, 1100)
    assert link.next(30.0, alive).pwm[0] == 1100
    assert autopilot.nothing_received()
    autopilot.send(1, 1200)
    assert exchange(link, b"one", 30.0, alive).pwm[0] == 1200
    assert autopilot.received() == b"one"
    assert autopilot.nothing_received()


def test_what_is_repeated_while_a_reply_is_withheld_gets_no_second_one(pair: tuple[Link, Autopilot]) -> None:
    link, autopilot = pair
    autopilot.send(0)
    link.next(30.0, alive)
    for frame in (0, 0, 1):
        autopilot.send(frame, 1000 + frame)
    assert exchange(link, b"one", 30.0, alive).pwm[0] == 1001
    assert autopilot.received() == b"one"
    assert autopilot.nothing_received()
    assert (link.repeated, link.lost, link.restarts) == (2, 0, 0)


def test_what_was_repeated_before_a_late_look_gets_no_second_reply(pair: tuple[Link, Autopilot]) -> None:
    """The master may let time pass between the reply and the question for what it brings."""
    link, autopilot = pair
    for _ in range(3):
        autopilot.send(0)
    link.next(30.0, alive)
    link.reply(b"one")
    time.sleep(0.6)
    autopilot.send(1, 1001)
    assert link.next(30.0, alive).pwm[0] == 1001
    assert autopilot.received() == b"one"
    assert autopilot.nothing_received()
    assert link.repeated == 2


def test_what_is_repeated_long_after_a_reply_gets_it_again(pair: tuple[Link, Autopilot]) -> None:
    link, autopilot = pair
    autopilot.send(0)
    link.next(30.0, alive)
    began = time.monotonic()
    again = iter([0.7, math.inf])
    at = next(again)

    def repeat() -> None:
        nonlocal at
        if time.monotonic() > began + at:
            at = next(again)
            autopilot.send(0)
        elif at == math.inf and autopilot.received() == autopilot.received() == b"one":
            autopilot.send(1, 1300)

    assert exchange(link, b"one", 60.0, repeat).pwm[0] == 1300
    assert link.repeated == 1


def test_lost_packets_and_restarts_are_counted(pair: tuple[Link, Autopilot]) -> None:
    link, autopilot = pair
    for frame in (5, 8, 0, 1):
        autopilot.send(frame)
    assert link.next(30.0, alive).frame_count == 5
    assert [exchange(link, b"x", 30.0, alive).frame_count for _ in range(3)] == [8, 0, 1]
    assert (link.repeated, link.lost, link.restarts) == (0, 2, 1)
    autopilot.socket.sendto(b"no servo packet", autopilot.to)
    autopilot.send(2)
    assert exchange(link, b"x", 30.0, alive).frame_count == 2


def test_waiting_ends(pair: tuple[Link, Autopilot]) -> None:
    link, autopilot = pair
    with pytest.raises(TimeoutError, match=r"ArduPilot has sent no servo outputs for 0\.1 s"):
        link.next(0.1, alive)
    autopilot.send(0)
    link.next(30.0, alive)

    def dead() -> None:
        raise RuntimeError("dead")

    with pytest.raises(RuntimeError, match="dead"):
        exchange(link, b"x", 60.0, dead)


# ---- the FMU ---------------------------------------------------------------------------------------------------------


class Flight:
    """A slave and what its stand-in has written down."""

    def __init__(self, folder: Path, **values: Any) -> None:
        self.folder = folder
        self.slave: Any = ArduPilotSITL(instance_name="autopilot")
        self.references = {v.name: v.value_reference for v in self.slave.vars.values()}
        self.set(instance=INSTANCE, folder=str(folder / "run"), start_timeout=60.0, step_timeout=30.0)
        self.set(**values)

    def set(self, **values: Any) -> None:
        setters = {bool: "boolean", int: "integer", float: "real", str: "string"}
        for name, value in values.items():
            getattr(self.slave, f"set_{setters[type(value)]}")([self.references[name]], [value])

    def begin(self) -> None:
        self.slave.setup_experiment(0.0, None, None)
        self.slave.enter_initialization_mode()
        self.slave.exit_initialization_mode()

    def step(self, k: int, height: float = 0.0, north: float = 0.0, packets: bytes = b"", h: float = 0.001) -> None:
        for i, x in enumerate((north, 0.0, -height)):
            self.slave.set_real([self.references[f"position[{i + 1}]"]], [x])
        self.slave.set_string([self.references["mavlink_rx"]], [base64.b64encode(packets).decode()])
        assert self.slave.do_step(k * h, h)
        self.slave.get_real([])  # a master asks for outputs, and so waits for ArduPilot

    def packets(self) -> list[Any]:
        (text,) = self.slave.get_string([self.references["mavlink_tx"]])
        return mavlink.MAVLink(None).parse_buffer(base64.b64decode(text)) or []

    def log(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.folder / f"{INSTANCE}.jsonl").read_text().splitlines()]


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Makes slaves whose executable is the stand-in, which behaves as it is told."""
    made: list[Flight] = []
    program = tmp_path / "arducopter"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {STAND_IN} "$@"\n')
    program.chmod(0o755)

    def make(how: dict[str, Any] | None = None, **values: Any) -> Flight:
        monkeypatch.setenv("ARDUPILOT_SITL", str(program))
        monkeypatch.setenv("STAND_IN", json.dumps({"log": str(tmp_path), **(how or {})}))
        made.append(Flight(tmp_path, **values))
        return made[-1]

    yield make
    for one in made:
        one.slave.terminate()


def test_it_is_started_with_what_it_needs(flight: Any, tmp_path: Path) -> None:
    (tmp_path / "more.parm").write_text("SCHED_LOOP_RATE 400\n")
    one = flight(SYSID_THISMAV=7, airframe=2, defaults=str(tmp_path / "more.parm"), speedup=50.0)
    one.begin()
    given = one.log()[0]
    assert given["I"] == INSTANCE
    assert given["sysid"] == 7
    assert given["model"] == "JSON:127.0.0.1"
    assert given["home"] == "-35.363262,149.165237,584,0"
    assert given["speedup"] == "50"
    assert (given["serial1"], given["serial2"]) == ("none", "none")
    first, second = given["defaults"].split(",")
    assert first == str(tmp_path / "more.parm")
    assert Path(second).read_text() == "FRAME_CLASS 2\nFRAME_TYPE 1\n"


def commands_of(firmware: Firmware, pulses: Sequence[int]) -> list[float]:
    motor = np.full(8, math.nan)
    put_commands(motor, np.array(pulses, np.uint16), *firmware.outputs())
    return motor.tolist()


def test_servo_outputs_mean_what_the_firmware_says() -> None:
    """Rover: steering 1, throttle 3; Plane: aileron 1, elevator 2, throttle 3, rudder 4; what is off is at rest."""
    pulses = (2000, 1250, 1750, 1100, 1300, 1400, 1500, 1600, *8 * (0,))
    assert commands_of(FRAMES[Airframe.hexa_x].firmware, pulses) == [1.0, 0.25, 0.75, 0.1, 0.3, 0.4, 0.5, 0.6]
    assert commands_of(FRAMES[Airframe.rover].firmware, pulses) == [1.0, 0.75, *6 * [0.0]]
    assert commands_of(FRAMES[Airframe.plane].firmware, pulses) == [1.0, 0.25, 0.75, 0.1, *4 * [0.0]]
    assert commands_of(FRAMES[Airframe.quadplane].firmware, pulses) == [1.0, 0.25, 0.75, 0.1, 0.3, 0.4, 0.5, 0.6]
    off = 16 * (0,)
    assert commands_of(FRAMES[Airframe.boat].firmware, off) == [0.5, 0.5, *6 * [0.0]]
    assert commands_of(FRAMES[Airframe.plane].firmware, off) == [0.5, 0.5, 0.0, 0.5, *4 * [0.0]]
    assert commands_of(FRAMES[Airframe.quad_x].firmware, (900, 2100)) == [0.0, 1.0, *6 * [0.0]]


@pytest.mark.parametrize(
    ("airframe", "program", "parameters"),
    [
        (Airframe.rover, "ardurover", "FRAME_CLASS 1\n"),
        (Airframe.boat, "ardurover", "FRAME_CLASS 2\n"),
        (Airframe.plane, "arduplane", ""),
        (Airframe.quadplane, "arduplane", "Q_ENABLE 1\nQ_FRAME_CLASS 1\nQ_FRAME_TYPE 1\n"),
    ],
)
def test_the_firmware_beside_arducopter_is_started(
    flight: Any, tmp_path: Path, airframe: Airframe, program: str, parameters: str
) -> None:
    one = flight()
    one.slave.m.airframe = airframe
    with pytest.raises(RuntimeError, match=rf"arducopter is ArduCopter, but .*there is no .*/{program}; set"):
        one.begin()
    (tmp_path / program).write_text((tmp_path / "arducopter").read_text())
    (tmp_path / program).chmod(0o755)
    another = flight()
    another.slave.m.airframe = airframe
    another.begin()
    given = another.log()[0]
    assert Path(given["defaults"].split(",")[-1]).read_text() == parameters
    assert another.slave._program.command[0] == str(tmp_path / program)
    for k in range(3):
        another.step(k, height=50.0)
    surface = airframe in (Airframe.rover, Airframe.boat)
    expected = [0.5, 0.0] if surface else [0.5, 0.0, 0.0, 0.0]  # channel 1: 10 us for each metre, the others low
    assert list(another.slave.m.motor[: len(expected)]) == pytest.approx(expected)


@pytest.mark.parametrize("channels", [16, 32])
def test_it_steps_with_the_master_and_flies_what_it_is_told(flight: Any, channels: int) -> None:
    one = flight({"channels": channels})
    one.begin()
    for k in range(50):
        one.step(k, height=0.5 * k, north=0.1 * k)
        assert one.slave.m.motor[0] == pytest.approx(5 * k / 1000)  # 10 us for each metre
        assert one.slave.m.motor[1] == pytest.approx(round(k) / 1000)
        assert list(one.slave.m.motor[2:]) == [0.0] * 6  # channels that are 0 too
        assert one.slave.m.clock == pytest.approx((k + 1) * 0.001)
    taken = one.log()[1:]
    assert [line["timestamp"] for line in taken] == pytest.approx([(k + 1) * 0.001 for k in range(50)])
    assert [line["frame"] for line in taken] == list(range(50))
    assert taken[-1]["position"] == [pytest.approx(4.9), 0.0, -24.5]
    assert taken[-1]["accel_body"] == [0.0, 0.0, -9.80665]
    assert taken[-1]["quaternion"] == [1.0, 0.0, 0.0, 0.0]
    assert (one.slave.m.lost, one.slave.m.restarts) == (0, 0)  # repeated it is where this computer is slow


def test_it_outlives_repeated_and_lost_packets_and_a_restart(flight: Any) -> None:
    one = flight({"repeat": 7, "skip": 10, "drop": 13, "restart": 31})
    one.begin()
    for k in range(60):
        one.step(k, height=float(k))
        assert one.slave.m.motor[0] == pytest.approx(10 * k / 1000)
    assert one.slave.m.restarts == 1
    assert one.slave.m.lost == 5  # 10, 20 and 30 before the restart at 31, 10 and 20 behind it
    assert one.slave._link.repeated > 0
    times = [line["timestamp"] for line in one.log()[1:]]
    assert times == pytest.approx([(k + 1) * 0.001 for k in range(60)])


def test_packets_pass_its_serial_port_both_ways_and_say_how_it_is(flight: Any) -> None:
    one = flight(SYSID_THISMAV=3)
    one.begin()
    found = []
    me = mavlink.MAVLink(None, srcSystem=255)
    k = 0
    end = time.monotonic() + 120
    while not found and time.monotonic() < end:
        one.step(k)
        k, found = k + 1, one.packets()
    assert {(m.get_type(), m.get_srcSystem()) for m in found} == {("HEARTBEAT", 3)}
    assert (bool(one.slave.m.armed), one.slave.m.mode, bool(one.slave.m.on_ground)) == (False, 4, True)
    one.step(
        k, packets=me.command_long_encode(3, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0).pack(me)
    )
    answers = [m.get_type() for m in one.packets()]
    while not one.slave.m.armed and time.monotonic() < end:
        k += 1
        one.step(k)
        answers += [m.get_type() for m in one.packets()]
    assert "COMMAND_ACK" in answers
    assert (bool(one.slave.m.armed), bool(one.slave.m.on_ground)) == (True, False)


def test_it_attaches_to_one_that_runs_and_to_the_one_that_takes_its_place(flight: Any, tmp_path: Path) -> None:
    one = flight(attach=True)
    command = [sys.executable, str(STAND_IN), f"-I{INSTANCE}", "--serial0", "tcp:0:wait", "--sysid", "9"]
    environment = {**os.environ, "STAND_IN": json.dumps({"log": str(tmp_path)})}
    k = 0
    for restarts in range(2):
        with subprocess.Popen(command, env=environment) as process:
            try:
                if restarts == 0:
                    one.begin()
                found: list[Any] = []
                while not found and k < 5000:
                    one.step(k, height=3.0)
                    k, found = k + 1, one.packets()
                assert found[0].get_srcSystem() == 9
                assert one.slave.m.motor[0] == pytest.approx(0.03)
                assert one.slave.m.restarts == restarts
                if restarts:
                    one.slave.terminate()
                    assert process.poll() is None  # it is not ours
            finally:
                process.kill()


@pytest.mark.parametrize("folder", [None, ""])
def test_it_ends_when_the_run_does(flight: Any, folder: str | None, tmp_path: Path) -> None:
    """And leaves nothing, unless it was told where to run."""
    one = flight()
    if folder is not None:
        one.set(folder=folder)
    one.begin()
    process = Path(f"/proc/{one.slave._program.pid}")
    ran_in = (process / "cwd").readlink()
    assert (ran_in / "frame.parm").is_file()
    assert (ran_in == tmp_path / "run") == (folder is None)
    one.slave.terminate()
    assert not process.exists()
    one.slave.terminate()
    assert ran_in.exists() == (folder is None)


def test_without_an_executable_the_error_says_how_to_get_one(flight: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    one = flight()
    monkeypatch.delenv("ARDUPILOT_SITL")
    with pytest.raises(RuntimeError, match=r"there is no ArduPilot to start: .*ARDUPILOT_SITL.*ardupilot\.org"):
        one.begin()
    another = flight(executable="/no/such/program")
    with pytest.raises(RuntimeError, match=r"/no/such/program is not an executable program; there is no ArduPilot"):
        another.begin()


@pytest.mark.parametrize(
    "how, values, expected",
    [
        ({"die": 0}, {}, r"ArduPilot exited with code 3; its last output: .*it is over"),
        ({"mute": True}, {"start_timeout": 0.5}, r"ArduPilot has sent no servo outputs for 0\.5 s"),
        ({}, {"attach": True, "start_timeout": 0.2}, r"no ArduPilot at tcp:127\.0\.0\.1:8160 within 0\.2 s"),
        ({}, {"defaults": "/no/such.parm"}, r"defaults: no such file: /no/such\.parm"),
        (
            {},
            {"airframe": 0},
            r"airframe 0: ArduPilot has frames for quad_x, hexa_x, octa_x, y6, .*, rover, boat, plane, quadplane",
        ),
    ],
)
def test_what_can_go_wrong_at_the_start(flight: Any, how: dict[str, Any], values: Any, expected: str) -> None:
    airframe = values.pop("airframe", None)
    one = flight(how, **values)
    if airframe is not None:
        one.slave.m.airframe = airframe
    with pytest.raises((RuntimeError, TimeoutError, ValueError), match=expected):
        one.begin()


@pytest.mark.parametrize(
    "how, expected",
    [
        ({"die": 5}, r"ArduPilot exited with code 3"),
        ({"silent": 5}, r"ArduPilot has sent no servo outputs for 2 s"),
    ],
)
def test_what_can_go_wrong_in_flight(flight: Any, how: dict[str, Any], expected: str) -> None:
    one = flight(how, step_timeout=2.0)
    one.begin()
    with pytest.raises((RuntimeError, TimeoutError), match=expected):
        for k in range(10):
            one.step(k)
    assert math.isclose(one.slave.m.clock, 0.005)  # what was asked of it


def test_the_port_of_one_to_attach_to_must_be_free(flight: Any) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 9002 + 10 * INSTANCE))
        with pytest.raises(RuntimeError, match=r"UDP port 11402 of instance 240 cannot be opened: Address already in"):
            flight(attach=True).begin()


def test_started_ones_of_one_number_do_not_mind_each_other(flight: Any) -> None:
    ones = [flight() for _ in range(2)]
    for one in ones:
        one.begin()
    for k in range(20):
        for height, one in enumerate(ones):
            one.step(k, height=height)
            assert one.slave.m.motor[0] == pytest.approx(height / 100)


def test_values_are_read_and_set_as_of_any_model(flight: Any) -> None:
    """By places that are kept for each list of references: the values and errors are those of `Model`."""
    one = flight()
    one.begin()
    for k in range(3):
        one.step(k, height=3.0)
    slave, refs = one.slave, one.references
    reals = [refs["motor[1]"], refs["clock"], refs["position[3]"]]
    integers, booleans = [refs["lost"], refs["airframe"]], [refs["on_ground"], refs["attach"]]
    for _ in range(2):
        assert (
            slave.get_real(reals) == Model.get_real(slave, reals) == [pytest.approx(0.03), pytest.approx(0.003), -3.0]
        )
        assert slave.get_integer(integers) == Model.get_integer(slave, integers) == [0, 1]
        assert slave.get_boolean(booleans) == Model.get_boolean(slave, booleans) == [True, False]
        slave.set_real([refs["position[1]"], refs["position[2]"]], [1.5, -2.5])
        slave.set_integer([refs["airframe"]], [1])
        assert slave.m.position.tolist() == [1.5, -2.5, -3.0]
        for values in ([math.nan, 0.0], [1.0]):
            with pytest.raises(ValueError):
                slave.set_real([refs["position[1]"], refs["position[2]"]], values)
        slave.set_real([refs["position[1]"]], [math.inf])
        assert slave.m.position[0] == math.inf
        for name in ("motor[1]", "speedup"):
            with pytest.raises(ValueError, match=name.partition("[")[0]):
                slave.set_real([refs[name]], [1.0])
        with pytest.raises(ValueError, match="airframe = 99"):
            slave.set_integer([refs["airframe"]], [99])
        with pytest.raises(ValueError, match="mavlink_tx"):
            slave.set_string([refs["mavlink_tx"]], [""])
        for get in (slave.get_integer, slave.get_boolean, slave.get_string):
            with pytest.raises(TypeError):
                get([refs["clock"]])
        with pytest.raises(TypeError):
            slave.get_real([refs["lost"]])
        slave.set_string([refs["mavlink_rx"]], [base64.b64encode(b"abc").decode()])
        assert slave.get_string([refs["mavlink_rx"]]) == ["YWJj"]
        slave.set_string([refs["mavlink_rx"]], [""])
        assert (slave.m.mavlink_rx_len, slave.get_string([refs["mavlink_rx"]])) == (0, [""])

"""An agent of the kit driven by packets that pymavlink makes, and what it sends read by pymavlink."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model, Output, Parameter, kernel
from cosim.build import CannotCompile, build, load_models
from cosim.messages import NAMED_VALUE_FLOAT, decode_named_value_float, encode_named_value_float
from cosim.packets import message_id, pack, system, unpack
from cosim_models.agents.kit import (
    ACCELERATION,
    ERRORS,
    POSITION,
    STEP_SIZE,
    VELOCITY,
    Task,
    Trouble,
    agent_kernels,
    agent_variables,
    decision,
    next_number,
    send,
)
from cosim_models.agents.parts.assembly import SHORT_PERIOD
from cosim_models.agents.parts.script import AgentState, Failure

LATITUDE, LONGITUDE, ALTITUDE = -35.363262, 149.165237, 584.0
METRES_PER_DEGREE = 0.011131884502145034e7
"""ArduPilot's LOCATION_SCALING_FACTOR."""
GUIDED, LAND = (mavlink.COPTER_MODE_GUIDED, mavlink.COPTER_MODE_LAND)
CAPACITY = 4


@kernel
def law(m: Any, t: float, h: float) -> int:
    """Returns what the parameter says; velocity 3-4-0, acceleration t, position 7 m north of where it is."""
    m.setpoint_velocity[0], m.setpoint_velocity[1] = m.speed * 0.6, m.speed * 0.8
    m.setpoint_acceleration[0], m.setpoint_acceleration[1] = 1.0, h
    m.setpoint_position[0] += 7.0
    return m.returns


class Agent4(Model):
    """An agent of the kit with a table for four."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(neighbours=CAPACITY),
        Parameter("returns", type=int, start=VELOCITY),
        Parameter("speed", unit="m/s", start=2.0),
    )
    kernels = agent_kernels(law)
    errors = ERRORS | {7: "seven"}


START, ADVANCE = Agent4.kernels


class Node:
    """A drone that talks: of the agent's own system or another one."""

    def __init__(self, system: int) -> None:
        self.link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)

    def __call__(self, message: Any) -> bytes:
        packet = bytes(message.pack(self.link))
        self.link.seq = (self.link.seq + 1) & 0xFF
        return packet

    def heartbeat(self, *, armed: bool = False, mode: int = 0, kind: int = 2) -> bytes:
        return self(mavlink.MAVLink_heartbeat_message(kind, 3, 1 | (128 if armed else 0), mode, 3, 3))

    def position(
        self, north: float, east: float, up: float = 10.0, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> bytes:
        lat = LATITUDE + north / METRES_PER_DEGREE
        lon = LONGITUDE + east / (METRES_PER_DEGREE * math.cos(math.radians(0.5 * (lat + LATITUDE))))
        speed = [round(100.0 * v) for v in velocity]
        return self(
            mavlink.MAVLink_global_position_int_message(
                0, round(lat * 1e7), round(lon * 1e7), round(1e3 * (ALTITUDE + up)), round(1e3 * up), *speed, 0
            )
        )

    def ack(self, command: int, result: int = 0) -> bytes:
        return self(mavlink.MAVLink_command_ack_message(command, result, 0, 0, 1, 191))

    def estimate(self) -> bytes:
        return self(mavlink.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0, 0)) + self(
            mavlink.MAVLink_gps_raw_int_message(0, 6, 0, 0, 0, 0, 0, 0, 0, 10)
        )


class Agent:
    """An agent's record on its own clock, and the autopilot that it talks to."""

    def __init__(self, **parameters: Any) -> None:
        self.m = Agent4.record()
        for name, value in {"first_step_time": 0.5, **parameters}.items():
            self.m[name] = value
        assert START(self.m) == 0
        self.k = 0
        self.pilot = Node(1)
        self.parser = mavlink.MAVLink(None)

    @property
    def t(self) -> float:
        return self.k * STEP_SIZE

    def step(self, *packets: bytes, code: int = 0) -> list[Any]:
        """One step with these packets; what it sends, heartbeats left out."""
        data = b"".join(packets)
        self.m.mavlink_rx[: len(data)] = np.frombuffer(data, dtype=np.uint8)
        self.m.mavlink_rx_len = len(data)
        assert ADVANCE(self.m, self.t, STEP_SIZE) == code
        self.k += 1
        messages = self.parser.parse_buffer(self.m.mavlink_tx[: self.m.mavlink_tx_len].tobytes()) or []
        return [message for message in messages if message.get_type() != "HEARTBEAT"]

    def airborne(self, north: float = 0.0, east: float = 0.0, up: float = 10.0) -> list[str]:
        """Play its autopilot until it hovers; the commands in the order in which they came."""
        asked: list[str] = []
        pilot = self.pilot
        packets = [pilot.heartbeat()]
        for _ in range(40):
            sent = self.step(*packets)
            packets = []
            for message in sent:
                assert message.target_system == 1 and message.target_component == 1
                packets.append(pilot.ack(message.command))
                asked.append(mavlink.enums["MAV_CMD"][message.command].name.removeprefix("MAV_CMD_"))
                mode = GUIDED if "DO_SET_MODE" in asked else 0
                packets.append(pilot.heartbeat(armed="COMPONENT_ARM_DISARM" in asked, mode=mode))
            taken_off = "NAV_TAKEOFF" in asked or self.m.altitude == 0.0
            packets += [pilot.estimate(), pilot.position(north, east, up if taken_off else 0.0)]
            if self.m.state == Task.ready:
                return asked
        raise AssertionError(Task(self.m.state))

    def until_set_point(self, *packets: bytes) -> Any:
        """The next set-point; its own position goes on being heard."""
        for _ in range(100):
            sent = self.step(self.pilot.position(0.0, 0.0), *packets)
            packets = ()
            if sent:
                (message,) = sent
                return message
        raise AssertionError("no set-point")


def local(message: Any) -> tuple[float, float, float]:
    """North, east, up of a set-point's place."""
    lat, lon = 1e-7 * message.lat_int, 1e-7 * message.lon_int
    north = (lat - LATITUDE) * METRES_PER_DEGREE
    east = (lon - LONGITUDE) * METRES_PER_DEGREE * math.cos(math.radians(LATITUDE))
    return north, east, message.alt - ALTITUDE


def test_states_and_failures_have_the_numbers_of_the_script() -> None:
    names = {"formation": "flying"}
    assert {names.get(one.name, one.name): int(one) for one in AgentState}.items() <= {
        one.name: int(one) for one in Task
    }.items()
    assert {one.name: int(one) for one in Failure}.items() <= {one.name: int(one) for one in Trouble}.items()


def test_it_takes_off_and_calls_its_law_at_multiples_of_the_period() -> None:
    agent = Agent(first_step_time=1.1)
    assert agent.airborne() == [*["SET_MESSAGE_INTERVAL"] * 3, "DO_SET_MODE", "COMPONENT_ARM_DISARM", "NAV_TAKEOFF"]
    times = []
    while agent.t < 2.3:
        if agent.step(agent.pilot.position(0.0, 0.0)):
            times.append(agent.t - STEP_SIZE)
    assert times == pytest.approx([1.2, 1.4, 1.6, 1.8, 2.0, 2.2])
    assert agent.m.step == 6
    assert agent.m.state == Task.flying


@pytest.mark.parametrize(
    ("returns", "ignored"),
    [
        (POSITION, 0b110111111000),
        (VELOCITY, 0b110111000111),
        (POSITION + VELOCITY, 0b110111000000),
        (VELOCITY + ACCELERATION, 0b110000000111),
        (POSITION + VELOCITY + ACCELERATION, 0b110000000000),
    ],
)
def test_set_points_are_what_the_law_gives(returns: int, ignored: int) -> None:
    agent = Agent(returns=returns)
    agent.airborne()
    message = agent.until_set_point()
    assert message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"
    assert message.coordinate_frame == mavlink.MAV_FRAME_GLOBAL_INT
    assert (message.target_system, message.target_component) == (1, 1)
    assert message.type_mask == ignored
    assert local(message) == pytest.approx((7.0, 0.0, 10.0), abs=0.02)
    assert (message.vx, message.vy, message.vz) == pytest.approx((1.2, 1.6, 0.0), abs=1e-6)
    assert (message.afx, message.afy, message.afz) == pytest.approx((1.0, 0.2, 0.0), abs=1e-6)


def test_velocities_are_limited_and_climb_back_to_the_altitude() -> None:
    agent = Agent(speed=20.0, speed_limit=3.0)
    agent.airborne()
    for _ in range(100):
        if sent := agent.step(agent.pilot.position(0.0, 0.0, up=9.0)):
            break
    assert (sent[0].vx, sent[0].vy) == pytest.approx((1.8, 2.4))
    assert sent[0].vz == pytest.approx(-0.5)  # up: half of the missing metre per second


def test_a_law_without_news_sends_nothing_and_its_errors_are_the_models() -> None:
    agent = Agent(returns=0)
    agent.airborne()
    for _ in range(100):
        assert agent.step(agent.pilot.position(0.0, 0.0)) == []
    assert agent.m.step > 0
    for returns, code in ((8, 4), (-7, 7)):
        agent = Agent(returns=returns)
        agent.airborne()
        while (agent.k % 16) or agent.t < 0.6:
            agent.step(agent.pilot.position(0.0, 0.0))
        agent.step(agent.pilot.position(0.0, 0.0), code=code)


def test_neighbours_stand_in_the_order_of_their_ids_where_they_fly_to() -> None:
    agent = Agent()
    agent.airborne()
    late = Node(9).position(-5.0, 2.0, 12.0, velocity=(1.0, -2.0, 0.5))
    agent.until_set_point(late, Node(3).position(30.0, 40.0), Node(1).position(0.0, 0.0))
    m = agent.m
    assert m.neighbours == 2
    assert list(m.near_id[:2]) == [3, 9]
    age = m.near_age[1]
    assert 0.2 < age < 0.6
    assert m.near_position[0] == pytest.approx((30.0, 40.0, -10.0), abs=0.02)
    assert m.near_position[1] == pytest.approx((-5.0 + age, 2.0 - 2.0 * age, -12.0 + 0.5 * age), abs=0.02)
    assert m.near_velocity[1] == pytest.approx((1.0, -2.0, 0.5))
    assert m.near_distance[0] == pytest.approx(50.0, abs=0.05)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({}, [2, 3, 4, 5]),
        ({"nearest": 2}, [2, 4]),
        ({"radius": 25.0}, [2, 4]),
        ({"radius": 25.0, "nearest": 1}, [4]),
        ({"neighbour_ids": (5, 0, 3, 0)}, [3, 5]),
        ({"neighbour_ids": (5, 6, 3, 0), "nearest": 1}, [3]),
        ({"airborne_height": -1.0}, [2, 3, 4, 6]),
    ],
)
def test_neighbours_are_who_the_parameters_say(parameters: dict[str, Any], expected: list[int]) -> None:
    """6 is the nearest, but stands on the ground: it takes no row from one that flies, and there are four rows."""
    agent = Agent(**parameters)
    agent.airborne()
    heard = {2: 20.0, 3: 30.0, 4: 10.0, 5: 40.0}
    packets = [Node(one).position(0.0, east) for one, east in heard.items()]
    agent.until_set_point(*packets, Node(6).position(0.0, 5.0, 0.0))
    assert list(agent.m.near_id[: agent.m.neighbours]) == expected


def test_one_that_lands_is_no_neighbour() -> None:
    agent = Agent()
    agent.airborne()
    for up, number in ((10.0, 1), (2.0, 1), (0.5, 0), (10.0, 1)):
        agent.until_set_point(Node(2).position(0.0, 10.0, up))
        assert agent.m.neighbours == number


def test_a_full_table_keeps_the_nearest_and_forgets_who_is_silent() -> None:
    agent = Agent()
    agent.airborne()
    packets = [Node(one).position(0.0, 10.0 * one) for one in (9, 8, 7, 6, 5, 2, 3)]
    agent.until_set_point(*packets)
    assert list(agent.m.near_id[: agent.m.neighbours]) == [2, 3, 5, 6]
    while agent.t < 2.0:
        agent.until_set_point(Node(9).position(0.0, 90.0), Node(2).position(0.0, 20.0))
    assert list(agent.m.near_id[: agent.m.neighbours]) == [2, 9]


def test_one_that_does_not_know_where_it_is_is_no_neighbour() -> None:
    agent = Agent()
    agent.airborne()
    lost = Node(2)(mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 10000, 0, 0, 0, 0))
    agent.until_set_point(lost)
    assert agent.m.neighbours == 0


def test_it_stays_on_the_ground_until_its_time() -> None:
    agent = Agent(takeoff_time=1.0)
    while agent.t < 1.0 - 1e-9:
        assert agent.step(agent.pilot.heartbeat()) == []
    assert agent.airborne()[-1] == "NAV_TAKEOFF"


def test_it_lands_at_its_time() -> None:
    agent = Agent(land_time=1.0)
    agent.airborne()
    while agent.m.state != Task.landing:
        agent.step(agent.pilot.position(0.0, 0.0))
    assert agent.t - STEP_SIZE == pytest.approx(1.0)
    (message,) = agent.step()
    assert (message.command, message.param1, message.param2) == (mavlink.MAV_CMD_DO_SET_MODE, 1.0, LAND)
    agent.step(agent.pilot.ack(message.command), agent.pilot.heartbeat(armed=True, mode=LAND))
    assert agent.m.state == Task.landing
    agent.step(agent.pilot.heartbeat(mode=LAND))
    assert agent.m.state == Task.landed
    agent.step(agent.pilot.heartbeat(mode=0))
    assert (agent.m.state, agent.m.failure) == (Task.landed, Trouble.none)


def test_one_that_does_not_land_has_failed() -> None:
    agent = Agent(land_time=1.0, timeout=2.0)
    agent.airborne()
    while agent.t < 3.5:
        agent.step(agent.pilot.position(0.0, 0.0), agent.pilot.heartbeat(armed=True, mode=GUIDED))
    assert (agent.m.state, agent.m.failure) == (Task.failed, Trouble.not_landed)


@pytest.mark.parametrize(
    ("armed", "mode", "why"), [(False, GUIDED, Trouble.disarmed), (True, LAND, Trouble.left_guided)]
)
def test_it_gives_up_when_its_drone_is_taken_from_it(armed: bool, mode: int, why: Trouble) -> None:
    agent = Agent()
    agent.airborne()
    agent.until_set_point()
    agent.step(agent.pilot.heartbeat(armed=armed, mode=mode))
    assert (agent.m.state, agent.m.failure) == (Task.failed, why)
    while agent.t < 2.0:
        assert agent.step(agent.pilot.position(0.0, 0.0)) == []


def test_without_an_own_position_the_law_rests() -> None:
    agent = Agent()
    agent.airborne()
    agent.until_set_point()
    step = agent.m.step
    while agent.t < 3.0:
        agent.step()
    assert agent.m.step <= step + 5
    agent.until_set_point()


def test_a_vehicle_that_does_not_climb_is_not_told_to_take_off() -> None:
    agent = Agent(altitude=0.0)
    rover = agent.pilot
    rover.heartbeat = lambda *, armed=False, mode=0: Node.heartbeat(  # type: ignore[method-assign]
        rover, armed=armed, mode=15 if mode else 0, kind=mavlink.MAV_TYPE_GROUND_ROVER
    )
    assert agent.airborne(up=0.0) == [*["SET_MESSAGE_INTERVAL"] * 3, "DO_SET_MODE", "COMPONENT_ARM_DISARM"]


@pytest.mark.parametrize(
    ("parameters", "code"),
    [({"sysid": 0}, 1), ({"period": 0.0}, 2), ({"position_rate": 0.0}, 2), ({"timeout": 0.0}, 2), ({"period": 3.0}, 3)],
)
def test_parameters_that_make_no_sense(parameters: dict[str, Any], code: int) -> None:
    m = Agent4.record()
    for name, value in parameters.items():
        m[name] = value
    assert START(m) == code
    assert code in ERRORS


def test_a_period_below_the_step_is_an_error() -> None:
    """Its law is called once in a step, and would be told that less time has passed."""
    agent = Agent(period=STEP_SIZE)
    agent.step()
    agent = Agent(period=0.9 * STEP_SIZE)
    agent.step(code=SHORT_PERIOD)
    assert ERRORS[SHORT_PERIOD].startswith("period is less than the step")


@kernel
def one(m: Any, t: float, h: float) -> int:
    return 1


@kernel
def two(m: Any, t: float, h: float) -> int:
    return 2


def test_two_laws_over_one_record_do_not_share_machine_code() -> None:
    """Code of kernels is kept in files by place and arguments, which are the same for both."""
    m = Agent4.record()
    assert [decision(law)(m, 0.0) for law in (one, two)] == [1, 2]


def test_a_quadplane_takes_off_as_a_copter_and_moves_and_lands_as_arduplane_has_it() -> None:
    """Commands in GUIDED (15) of ArduPlane; a velocity is the place of 2 s later; QLAND (20) at the end."""
    agent, pilot = Agent(land_time=3.0, speed=3.0, returns=VELOCITY), Node(1)
    vtol = mavlink.MAV_TYPE_VTOL_QUADROTOR
    state: dict[str, Any] = {"armed": False, "mode": 0, "up": 0.0}
    asked: list[Any] = []
    packets = [pilot.heartbeat(kind=vtol)]
    while agent.t < 3.5:
        sent = agent.step(*packets)
        asked += sent
        packets = []
        for one in sent:
            assert one.get_type() in ("COMMAND_LONG", "COMMAND_INT")
            packets.append(pilot.ack(one.command))
            if one.command == mavlink.MAV_CMD_DO_SET_MODE:
                state["mode"] = int(one.param2)
            state["armed"] = state["armed"] or one.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM
            if one.command == mavlink.MAV_CMD_NAV_TAKEOFF:
                state["up"] = 10.0
        packets += [pilot.heartbeat(armed=state["armed"], mode=state["mode"], kind=vtol), pilot.estimate()]
        packets.append(pilot.position(0.0, 0.0, state["up"]))
    modes = [int(one.param2) for one in asked if one.command == mavlink.MAV_CMD_DO_SET_MODE]
    assert modes[0] == 15 and set(modes[1:]) == {20}
    assert [one.param7 for one in asked if one.command == mavlink.MAV_CMD_NAV_TAKEOFF] == [10.0]
    moves = [one for one in asked if one.command == mavlink.MAV_CMD_DO_REPOSITION]
    assert len(moves) > 5
    north = (1e-7 * moves[0].x - LATITUDE) * METRES_PER_DEGREE
    east = (1e-7 * moves[0].y - LONGITUDE) * METRES_PER_DEGREE * math.cos(math.radians(LATITUDE))
    assert (north, east) == pytest.approx((7.0 + 2.0 * 1.8, 2.0 * 2.4), abs=0.05)  # 7 m are those of the law


# ---- own messages ------------------------------------------------------------------------------------------------


@kernel
def hear_value(m: Any, begin: int, t: float) -> None:
    """Counts all packets, and keeps sender and value of the last NAMED_VALUE_FLOAT."""
    m.packets += 1
    if message_id(m.mavlink_rx, begin) == NAMED_VALUE_FLOAT:
        unpack(m.mavlink_rx, begin, m.payload)
        m.value, m.sender, m.at = decode_named_value_float(m.payload)[1], system(m.mavlink_rx, begin), t


@kernel
def tell_values(m: Any, t: float, h: float) -> int:
    """Sends as many values as the parameter says, the last with a number of its own."""
    for i in range(m.many):
        encode_named_value_float(m.payload, int(1000.0 * t), float(i))
        send(m, NAMED_VALUE_FLOAT)
    encode_named_value_float(m.payload, int(1000.0 * t), 99.0)
    m.mavlink_tx_len = pack(
        m.mavlink_tx, m.mavlink_tx_len, m.payload, NAMED_VALUE_FLOAT, next_number(m), m.sysid, 191, 2
    )
    return VELOCITY


class Teller(Model):
    """An agent of the kit with own messages."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(neighbours=CAPACITY, message_bytes=100),
        Parameter("many", type=int, start=2),
        *(Output(name, type=int, start=0) for name in ("packets", "sender")),
        *(Output(name, start=0.0) for name in ("value", "at")),
    )
    kernels = agent_kernels(tell_values, hear_value)
    errors = ERRORS


def test_own_messages_are_sent_by_the_law_and_heard_at_all_times() -> None:
    start, advance = Teller.kernels
    m = Teller.record()
    assert start(m) == 0
    pilot, other, parser = Node(1), Node(7), mavlink.MAVLink(None)
    value = other(mavlink.MAVLink_named_value_float_message(0, b"x", 2.5))
    unknown = bytearray(value)
    unknown[7:10] = (42101).to_bytes(3, "little")  # an id of nobody, its checksum wrong for whoever knows it
    data = pilot.heartbeat() + value + other.position(1.0, 2.0) + bytes(unknown)
    broken = bytearray(value)
    broken[-1] ^= 1
    data += bytes(broken)
    m.mavlink_rx[: len(data)] = np.frombuffer(data, dtype=np.uint8)
    m.mavlink_rx_len = len(data)
    assert advance(m, 0.25, STEP_SIZE) == 0
    assert (m.packets, m.value, m.sender, m.at) == (4, 2.5, 7, 0.25)
    assert m.heard and m.heard_id[0] == 7  # the kit has its own part of them
    m.state, m.position_heard, m.mavlink_rx_len, m.first_step_time = Task.flying, 0.25, 0, 0.3
    m.armed = m.guided = True
    assert advance(m, 0.4, STEP_SIZE) == 0
    sent = parser.parse_buffer(m.mavlink_tx[: m.mavlink_tx_len].tobytes()) or []
    kinds = [one.get_type() for one in sent]
    assert kinds == ["NAMED_VALUE_FLOAT"] * 3 + ["SET_POSITION_TARGET_GLOBAL_INT"]
    assert [one.value for one in sent[:3]] == [0.0, 1.0, 99.0]
    assert {(one.get_srcSystem(), one.get_srcComponent()) for one in sent} == {(1, 191)}
    assert np.diff([one.get_seq() for one in sent]).tolist() == [1, 1, 1]
    (port,) = [one for one in Teller.variables if one.name == "mavlink_tx"]
    assert port.capacity == 356


# ---- wrong laws ----------------------------------------------------------------------------------------------------

MODULE = """\
from cosim import Model, kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, agent_kernels, agent_variables


@kernel
def law(m, t, h):
    {body}


class Lawless(Model):
    \"\"\"Follows a wrong law.\"\"\"

    step_size = STEP_SIZE
    variables = agent_variables(neighbours=2)
    kernels = agent_kernels(law)
    errors = ERRORS
"""


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("m.step = 1", "law returns nothing; it is to return an int: end it with return and its value"),
        ("return 1.5", "law returns a float; it is to return an int"),
        ("print(t)\n    return 2", "a kernel has no print()"),
        ("return True", "law returns a bool, True; it is to return an int"),
    ],
)
def test_a_wrong_law_is_blamed_instead_of_the_kit(body: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "lawless.py"
    file.write_text(MODULE.format(body=body))
    (model,) = load_models(str(file))
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    del sys.modules["lawless"]
    assert str(failed.value) == f"Lawless: {file}:7: {message}"


KITS = {
    "agents.kit": ("agent_variables(neighbours=2)", "agent_kernels"),
    "drones.kit": ("drone_variables(neighbours=2)", "drone_kernels"),
    "agents.line": ("LineAgent.variables", "line_kernels"),
}


@pytest.mark.parametrize("kit", KITS)
def test_a_law_that_returns_a_bool_is_refused_in_every_kit(kit: str, tmp_path: Path) -> None:
    variables, kernels = KITS[kit]
    text = MODULE.replace("{body}", "return t > 1.0").replace("agent_variables(neighbours=2)", variables)
    imported = f"from cosim_models.{kit} import *; from cosim_models.agents.line_agent import LineAgent; "
    text = text.replace("agent_kernels(law)", f"{kernels}(law)").replace(
        "from cosim_models", f"{imported}from cosim_models"
    )
    file = tmp_path / "lawless.py"
    file.write_text(text)
    (model,) = load_models(str(file))
    with pytest.raises(ValueError) as failed:
        build(model, tmp_path, interpreted=True)
    del sys.modules["lawless"]
    assert str(failed.value) == f"Lawless: {file}:7: law returns a bool, t > 1.0; it is to return an int"

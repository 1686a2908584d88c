"""LineAgent driven by packets that pymavlink makes, and what it sends read by pymavlink."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.agents.line import StalePolicy, Trigger
from cosim_models.agents.line_agent import LineAgent
from cosim_models.agents.parts.script import AgentState, Failure
from tests.models.shipped_kernels import kernels, part

H = 0.0125
LATITUDE, LONGITUDE = -35.363262, 149.165237
METRES_PER_DEGREE = 0.011131884502145034e7
"""ArduPilot's LOCATION_SCALING_FACTOR."""
STUBBORN, GUIDED, LAND = (0, mavlink.COPTER_MODE_GUIDED, mavlink.COPTER_MODE_LAND)
ACCEPTED, DENIED, FAILED = (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED)


def longitude_of(place: float) -> int:
    """degE7 of a position [m] on the line, by ArduPilot's flat Earth."""
    return round((LONGITUDE + place / (METRES_PER_DEGREE * math.cos(math.radians(LATITUDE)))) * 1e7)


def place_of(longitude: int) -> float:
    return (longitude * 1e-7 - LONGITUDE) * METRES_PER_DEGREE * math.cos(math.radians(LATITUDE))


class Sender:
    """A MAVLink node that makes packets."""

    def __init__(self, system: int, component: int = 1, version: int = 2) -> None:
        self.link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.version = version

    def __call__(self, message: Any) -> bytes:
        packet = bytes(message.pack(self.link, force_mavlink1=self.version == 1))
        self.link.seq = (self.link.seq + 1) & 0xFF
        return packet

    def heartbeat(self, *, armed: bool = False, mode: int = 0, autopilot: int = 3) -> bytes:
        base = 1 | (128 if armed else 0)
        return self(mavlink.MAVLink_heartbeat_message(2, autopilot, base, mode, 3, 3))

    def position(self, place: float, height: float = 0.0, latitude: float = LATITUDE) -> bytes:
        return self(
            mavlink.MAVLink_global_position_int_message(
                0, round(latitude * 1e7), longitude_of(place), 584000, round(1000 * height), 0, 0, 0, 0
            )
        )

    def ack(self, command: int, result: int, system: int = 1, component: int = 191) -> bytes:
        return self(mavlink.MAVLink_command_ack_message(command, result, 0, 0, system, component))

    def estimate(self, flags: int = 831) -> bytes:
        return self(mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0))

    def gps(self, fix: int = 6) -> bytes:
        return self(mavlink.MAVLink_gps_raw_int_message(0, fix, 0, 0, 0, 0, 0, 0, 0, 10))


class Agent:
    """An agent's record, stepped on its own clock; `sent` keeps (time, message) of all it sends."""

    def __init__(self, **parameters: Any) -> None:
        self.m = LineAgent.record()
        self.m.sysid = 1
        for name, value in parameters.items():
            self.m[name] = value
        self.start, self.advance = kernels(LineAgent)
        self._rx, self._rx_len, self._tx, self._tx_len = (
            part(self.m, f"mavlink_{name}") for name in ("rx", "rx_len", "tx", "tx_len")
        )
        assert self.start(self.m) == 0
        self.k = 0
        self.sent: list[tuple[float, Any]] = []
        self.parser = mavlink.MAVLink(None)

    @property
    def t(self) -> float:
        return self.k * H

    def step(self, *packets: bytes) -> list[Any]:
        """One step with these packets; what it sends."""
        data = b"".join(packets)
        if data:
            self._rx[: len(data)] = np.frombuffer(data, dtype=np.uint8)
        self._rx_len[0] = len(data)
        assert self.advance(self.m, self.t, H) == 0
        out = self._tx[: self._tx_len[0]].tobytes() if self._tx_len[0] else b""
        messages = (self.parser.parse_buffer(out) if out else None) or []
        assert all(m.get_type() != "BAD_DATA" for m in messages)
        assert sum(len(m.get_msgbuf()) for m in messages) == len(out)
        self.sent += [(self.t, m) for m in messages]
        self.k += 1
        return messages

    def until(self, time: float, packets: Callable[[], Iterable[bytes]] = lambda: ()) -> list[Any]:
        messages = []
        while self.t < time - 1e-9:
            messages += self.step(*packets())
        return messages

    def all(self, kind: str) -> list[Any]:
        return [m for _, m in self.sent if m.get_type() == kind]


def commands(messages: list[Any]) -> list[int]:
    return [m.command for m in messages if m.get_type() == "COMMAND_LONG"]


def armable(agent: Agent, place: float = 20.0, height: float = 0.0, pilot: Sender | None = None) -> Sender:
    """Bring an agent to the state `mode`."""
    pilot = pilot or Sender(1)
    agent.step(pilot.heartbeat())
    for _ in range(3):
        agent.step()
        agent.step(pilot.ack(511, ACCEPTED))
    assert agent.m.state == AgentState.estimate
    agent.step(pilot.position(place, height), pilot.estimate(), pilot.gps())
    assert agent.m.state == AgentState.mode
    return pilot


def flying(place: float = 20.0, **parameters: Any) -> tuple[Agent, Sender]:
    """An agent whose drone hovers at 10 m: state `ready` at t < 1 s, first step at 2 s."""
    agent = Agent(**{"first_step_time": 2.0, "left_sysid": 2, "right_sysid": 3, **parameters})
    pilot = armable(agent, place)
    agent.step(pilot.heartbeat(mode=GUIDED))
    agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    agent.step(pilot.position(place, 9.6))
    assert agent.m.state == AgentState.ready
    return agent, pilot


# ---- preparing ---------------------------------------------------------------------------------------------------


def test_its_own_heartbeat() -> None:
    agent = Agent(sysid=7)
    agent.until(3.0)
    beats = [(t, m) for t, m in agent.sent if m.get_type() == "HEARTBEAT"]
    assert [t for t, _ in beats] == pytest.approx([0.0, 1.0, 2.0])
    for _, m in beats:
        assert (m.type, m.autopilot) == (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
        assert (m.get_srcSystem(), m.get_srcComponent()) == (7, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    assert [m.get_seq() for _, m in beats] == [0, 1, 2]


def test_the_script_in_order() -> None:
    agent = Agent(altitude=12.0, position_rate=5.0)
    pilot = Sender(1)
    assert commands(agent.step()) == []
    assert agent.m.state == AgentState.waiting
    agent.step(pilot.heartbeat())
    assert agent.m.state == AgentState.streams

    expected = [(33, 200000.0), (193, 1e6), (24, 1e6)]
    for message, interval in expected:
        (request,) = agent.step()
        assert request.get_type() == "COMMAND_LONG"
        assert (request.target_system, request.target_component, request.command) == (1, 1, 511)
        assert (request.param1, request.param2) == (message, interval)
        assert request.confirmation == 0
        agent.step(pilot.ack(511, ACCEPTED))
    assert agent.m.state == AgentState.estimate

    agent.step(pilot.position(20.0))
    agent.step(pilot.gps())
    assert agent.m.state == AgentState.estimate
    agent.step(pilot.estimate())
    assert agent.m.state == AgentState.mode
    assert agent.m.position == pytest.approx(20.0, abs=0.01)

    (request,) = agent.step()
    assert (request.command, request.param1, request.param2) == (176, 1, GUIDED)
    agent.step(pilot.ack(176, ACCEPTED))
    assert agent.m.state == AgentState.mode  # accepted is not yet done
    agent.step(pilot.heartbeat(mode=GUIDED))
    assert agent.m.state == AgentState.arming

    (request,) = agent.step()
    assert (request.command, request.param1, request.param2) == (400, 1, 0)
    agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    assert agent.m.state == AgentState.takeoff

    (request,) = agent.step()
    assert (request.command, request.param7) == (22, 12.0)
    agent.step(pilot.ack(22, ACCEPTED))
    agent.step(pilot.position(20.0, 11.39))
    assert agent.m.state == AgentState.takeoff
    agent.step(pilot.position(20.0, 11.4))
    assert agent.m.state == AgentState.ready
    assert agent.m.step == 0
    assert agent.all("SET_POSITION_TARGET_GLOBAL_INT") == []
    assert commands([m for _, m in agent.sent]) == [511, 511, 511, 176, 400, 22]
    sequence = [m.get_seq() for _, m in agent.sent]
    assert sequence == list(range(len(sequence)))


@pytest.mark.parametrize("version", [1, 2])
def test_it_understands_both_mavlink_versions(version: int) -> None:
    agent = Agent()
    armable(agent, pilot=Sender(1, version=version))


def test_commands_are_repeated_every_second_until_answered() -> None:
    agent = Agent()
    pilot = Sender(1)
    agent.step(pilot.heartbeat())
    agent.until(3.2)
    requests = [(t, m) for t, m in agent.sent if m.get_type() == "COMMAND_LONG"]
    assert [t for t, _ in requests] == pytest.approx([0.0125, 1.0125, 2.0125, 3.0125])
    assert [m.confirmation for _, m in requests] == [0, 1, 2, 3]
    assert {m.param1 for _, m in requests} == {33}
    agent.step(pilot.ack(511, DENIED))
    assert agent.m.refusal == DENIED
    assert agent.m.state == AgentState.streams
    assert commands(agent.until(4.1)) == [511]  # a refusal does not end the repetition: it may be too early
    agent.step(pilot.ack(511, ACCEPTED))
    (request,) = agent.step()
    assert request.param1 == 193


def test_a_lost_acknowledgement_of_the_takeoff_does_no_harm() -> None:
    agent = Agent()
    pilot = armable(agent)
    agent.step(pilot.heartbeat(mode=GUIDED))
    agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    agent.until(2.5, lambda: [pilot.position(20.0, 3.0), pilot.ack(22, FAILED)])  # it climbs, and refuses to again
    assert agent.m.state == AgentState.takeoff
    assert commands([m for _, m in agent.sent]).count(22) == 3
    agent.step(pilot.position(20.0, 9.5))
    assert agent.m.state == AgentState.ready


def test_a_takeoff_once_accepted_is_not_repeated() -> None:
    agent = Agent()
    pilot = armable(agent)
    agent.step(pilot.heartbeat(mode=GUIDED))
    agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    agent.step()
    agent.step(pilot.ack(22, ACCEPTED))
    agent.until(5.0)
    assert commands([m for _, m in agent.sent]).count(22) == 1


@pytest.mark.parametrize(
    ("flags", "fix", "ready"),
    [(831, 6, True), (512, 3, True), (16, 2, True), (831, 1, False), (167, 6, False), (0, 6, False), (1024, 6, False)],
)
def test_the_estimate_it_waits_for(flags: int, fix: int, ready: bool) -> None:
    """As DroneKit's is_armable: a fix, and a (predicted) absolute horizontal position not in constant-position mode."""
    agent = Agent()
    pilot = Sender(1)
    agent.step(pilot.heartbeat())
    for _ in range(3):
        agent.step()
        agent.step(pilot.ack(511, ACCEPTED))
    agent.step(pilot.position(0.0), pilot.estimate(flags), pilot.gps(fix))
    assert (agent.m.state == AgentState.mode) == ready


@pytest.mark.parametrize(
    ("reach", "failure"),
    [
        (AgentState.waiting, Failure.no_heartbeat),
        (AgentState.streams, Failure.no_streams),
        (AgentState.estimate, Failure.no_position_estimate),
        (AgentState.mode, Failure.not_guided),
        (AgentState.arming, Failure.not_armed),
        (AgentState.takeoff, Failure.not_at_altitude),
    ],
)
def test_every_waiting_state_has_a_timeout(reach: AgentState, failure: Failure) -> None:
    agent = Agent(timeout=5.0)
    pilot = Sender(1)
    if reach >= AgentState.streams:
        agent.step(pilot.heartbeat())
    if reach >= AgentState.estimate:
        for _ in range(3):
            agent.step()
            agent.step(pilot.ack(511, ACCEPTED))
    if reach >= AgentState.mode:
        agent.step(pilot.position(0.0), pilot.estimate(), pilot.gps())
    if reach >= AgentState.arming:
        agent.step(pilot.heartbeat(mode=GUIDED))
    if reach >= AgentState.takeoff:
        agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    assert agent.m.state == reach
    since = max(float(agent.m.state_since), 0.0)  # the first state begins with the first step
    agent.until(since + 5.0)
    assert agent.m.state == reach
    agent.step()
    assert agent.m.state == AgentState.failed
    assert agent.m.failure == failure
    before = len(commands([m for _, m in agent.sent]))
    agent.until(since + 8.0, lambda: [pilot.heartbeat(mode=GUIDED, armed=True), pilot.position(0.0, 10.0)])
    assert agent.m.state == AgentState.failed
    assert len(commands([m for _, m in agent.sent])) == before
    assert len(agent.all("HEARTBEAT")) >= 8  # it still lives


def test_timeouts_count_from_the_first_step_of_the_run() -> None:
    agent = Agent(timeout=5.0)
    agent.k = 8000  # a run that begins at 100 s
    agent.until(104.9)
    assert agent.m.state == AgentState.waiting
    agent.until(105.1)
    assert agent.m.failure == Failure.no_heartbeat


def test_ready_has_no_timeout() -> None:
    agent, pilot = flying(timeout=5.0, first_step_time=20.0)
    agent.until(19.9, lambda: [pilot.position(20.0, 10.0)])
    assert agent.m.state == AgentState.ready


@pytest.mark.parametrize(
    ("beat", "failure"),
    [({"mode": LAND, "armed": True}, Failure.left_guided), ({"mode": GUIDED}, Failure.disarmed)],
)
def test_it_gives_way_to_a_pilot(beat: dict[str, Any], failure: Failure) -> None:
    agent, pilot = flying()
    agent.until(2.1, lambda: [pilot.position(20.0, 10.0)])
    assert agent.m.state == AgentState.formation
    agent.step(pilot.heartbeat(**beat))
    assert agent.m.state == AgentState.failed
    assert agent.m.failure == failure
    targets = len(agent.all("SET_POSITION_TARGET_GLOBAL_INT"))
    agent.until(10.0, lambda: [pilot.position(20.0, 10.0)])
    assert len(agent.all("SET_POSITION_TARGET_GLOBAL_INT")) == targets
    assert agent.m.step == 1


def test_disarming_during_the_takeoff_is_a_failure() -> None:
    agent = Agent()
    pilot = armable(agent)
    agent.step(pilot.heartbeat(mode=GUIDED))
    agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    agent.step(pilot.heartbeat(mode=GUIDED))
    assert agent.m.failure == Failure.disarmed


# ---- whose packets count -----------------------------------------------------------------------------------------


def test_other_systems_components_and_answers_to_others_are_ignored() -> None:
    agent = Agent()
    other, camera, pilot = Sender(9), Sender(1, component=100), Sender(1)
    agent.step(other.heartbeat(), camera.heartbeat(), pilot.heartbeat(autopilot=8))
    assert agent.m.state == AgentState.waiting
    agent.step(pilot.heartbeat())
    agent.step()
    agent.step(other.ack(511, ACCEPTED), pilot.ack(511, ACCEPTED, system=255), pilot.ack(511, ACCEPTED, component=190))
    agent.step(pilot.ack(400, ACCEPTED))
    assert agent.m.streams == 0
    agent.step(pilot.ack(511, ACCEPTED, system=0, component=0))
    assert agent.m.streams == 1
    agent.step(other.position(55.0), camera.position(55.0))
    assert agent.m.position == 0.0
    assert (agent.m.left_age, agent.m.right_age) == (-1.0, -1.0)


def test_damaged_packets_are_ignored() -> None:
    agent = Agent()
    good = Sender(1).heartbeat()
    for i in range(len(good)):
        damaged = bytearray(good)
        damaged[i] ^= 0x10
        agent.step(bytes(damaged))
        assert agent.m.state == AgentState.waiting
    agent.step(good[:-1])
    assert agent.m.state == AgentState.waiting
    agent.step(b"\x00noise" + good)
    assert agent.m.state == AgentState.streams


@given(st.binary(max_size=600))
@settings(max_examples=100, deadline=None)
def test_noise_changes_nothing(noise: bytes) -> None:
    agent = Agent(left_sysid=2, right_sysid=3)
    agent.step(noise)
    assert agent.m.state == AgentState.waiting
    assert (agent.m.left_age, agent.m.right_age) == (-1.0, -1.0)


def test_a_position_of_zero_is_none() -> None:
    """ArduPilot's autopilots send zeros until they know where they are."""
    nowhere = mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0)
    agent, _ = flying()
    agent.step(Sender(2)(nowhere), Sender(1)(nowhere))
    assert agent.m.left_age == -1.0
    assert agent.m.position == pytest.approx(20.0, abs=0.01)


def test_the_neighbours_ages() -> None:
    agent, _ = flying()
    left = Sender(2)
    agent.step(left.position(3.0))
    assert agent.m.left_age == 0.0
    heard = agent.t - H
    agent.until(heard + 1.5)
    assert agent.m.left_age == pytest.approx(1.5 - H)
    assert agent.m.right_age == -1.0


def test_one_neighbour_on_both_sides() -> None:
    agent, pilot = flying(left_sysid=2, right_sysid=2)
    news = Sender(2)
    agent.until(6.0, lambda: [pilot.position(20.0, 10.0), news.position(50.0)])
    assert agent.m.target == pytest.approx(20.0 + 2.0 * 30.0 / 3.0, abs=0.02)


# ---- stepping ----------------------------------------------------------------------------------------------------


def test_the_first_steps() -> None:
    agent, pilot = flying(place=20.0)
    left, right = Sender(2), Sender(3)

    def news() -> list[bytes]:
        return [pilot.position(20.3, 10.0, LATITUDE + 1e-5), left.position(10.0), right.position(50.0)]

    agent.until(2.0, news)
    assert (agent.m.step, agent.m.state) == (0, AgentState.ready)
    target = agent.step(*news())[-1]
    assert (agent.m.step, agent.m.state) == (1, AgentState.formation)
    assert agent.m.target == pytest.approx(20.0, abs=0.01)
    assert (target.target_system, target.target_component) == (1, 1)
    assert target.coordinate_frame == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    assert target.type_mask == 0x0DF8
    assert target.lat_int == round(LATITUDE * 1e7)  # of the start, not where the wind has pushed it
    assert place_of(target.lon_int) == pytest.approx(20.0, abs=0.01)
    assert target.alt == 10.0
    assert target.time_boot_ms == 2000

    agent.until(2.0 + 3.1875, news)
    assert agent.m.step == 1
    (target,) = agent.step(*news())
    assert agent.m.step == 2
    expected = 20.3 + ((10.0 - 20.3) + (50.0 - 20.3)) / 3.0  # the measured position counts, not the last target
    assert agent.m.target == pytest.approx(expected, abs=0.01)
    assert place_of(target.lon_int) == pytest.approx(expected, abs=0.01)
    assert agent.m.position == pytest.approx(20.3, abs=0.01)
    agent.until(60.0, news)
    times = [t for t, m in agent.sent if m.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"]
    assert times == pytest.approx([2.0 + 3.1875 * k for k in range(len(times))], abs=1e-9)
    assert agent.m.step == len(times) == 1 + math.floor(58.0 / 3.1875)


def test_the_line_is_measured_in_ardupilots_metres() -> None:
    """With the mean radius of the Earth 100 m would read 99.889 m."""
    agent, pilot = flying()
    for place in (-50.0, 0.0, 37.5, 100.0):
        agent.step(pilot.position(place, 10.0, LATITUDE + 2e-5))
        assert agent.m.position == pytest.approx(place, abs=0.006)


def test_a_stubborn_agent_stays_at_its_start() -> None:
    agent, pilot = flying(place=100.0, stubborn=True, right_sysid=0)
    left = Sender(2)
    agent.until(20.0, lambda: [pilot.position(101.0, 10.0), left.position(10.0)])
    targets = agent.all("SET_POSITION_TARGET_GLOBAL_INT")
    assert agent.m.step == len(targets) == 6
    assert {m.lon_int for m in targets} == {longitude_of(100.0)}


def test_a_late_agent_joins_at_the_next_common_step() -> None:
    agent = Agent(first_step_time=1.0, left_sysid=2, right_sysid=3)
    agent.until(5.0)
    pilot = armable(agent)
    agent.step(pilot.heartbeat(mode=GUIDED))
    agent.step(pilot.heartbeat(mode=GUIDED, armed=True))
    agent.step(pilot.position(20.0, 10.0))
    assert agent.m.state == AgentState.ready
    others = [Sender(2), Sender(3)]

    def news() -> list[bytes]:
        return [pilot.position(20.0, 10.0), others[0].position(10.0), others[1].position(50.0)]

    agent.until(1.0 + 2 * 3.1875, news)
    assert agent.m.step == 0
    agent.step(*news())
    assert agent.m.step == 3
    assert agent.m.target == pytest.approx(20.0, abs=0.01)
    agent.until(1.0 + 3 * 3.1875 + H, news)
    assert agent.m.step == 4
    assert agent.m.target == pytest.approx(20.0 + 20.0 / 3.0, abs=0.02)


def test_one_missing_neighbour_by_parameter() -> None:
    agent, pilot = flying(left_sysid=0)
    right = Sender(3)
    agent.until(5.5, lambda: [pilot.position(20.0, 10.0), right.position(50.0)])
    assert agent.m.step == 2
    assert agent.m.target == pytest.approx(30.0, abs=0.02)


@pytest.mark.parametrize(
    ("policy", "left_lost", "right_lost", "target"),
    [
        (StalePolicy.hold, True, False, 20.0 + 20.0 / 3.0),  # the last position counts
        (StalePolicy.hold, True, True, 20.0),  # cut off: it stays
        (StalePolicy.drop, True, False, 20.0 + 30.0 / 3.0),
        (StalePolicy.drop, False, True, 20.0 - 10.0 / 3.0),
        (StalePolicy.drop, True, True, 20.0),
        (StalePolicy.freeze, True, False, 20.0),
        (StalePolicy.freeze, False, False, 20.0 + 20.0 / 3.0),
    ],
)
def test_stale_neighbours(policy: StalePolicy, left_lost: bool, right_lost: bool, target: float) -> None:
    agent, pilot = flying(stale_policy=policy)
    left, right = Sender(2), Sender(3)
    agent.step(left.position(10.0), right.position(50.0))

    def news() -> list[bytes]:
        packets = [pilot.position(20.0, 10.0)]
        packets += [] if left_lost else [left.position(10.0)]
        return packets + ([] if right_lost else [right.position(50.0)])

    agent.until(5.5, news)
    assert agent.m.step == 2
    assert agent.m.target == pytest.approx(target, abs=0.02)


@pytest.mark.parametrize(("policy", "target"), [(StalePolicy.hold, 20.0), (StalePolicy.drop, 30.0)])
def test_a_neighbour_never_heard(policy: StalePolicy, target: float) -> None:
    agent, pilot = flying(stale_policy=policy)
    right = Sender(3)
    agent.until(5.5, lambda: [pilot.position(20.0, 10.0), right.position(50.0)])
    assert agent.m.step == 2
    assert agent.m.target == pytest.approx(target, abs=0.02)


def test_without_its_own_position_it_stays() -> None:
    agent, pilot = flying()
    left, right = Sender(2), Sender(3)
    agent.until(2.5, lambda: [pilot.position(20.0, 10.0)])
    agent.until(5.5, lambda: [left.position(10.0), right.position(50.0)])
    assert agent.m.step == 2
    assert agent.m.target == pytest.approx(20.0, abs=0.01)


def test_the_arrival_trigger() -> None:
    agent, pilot = flying(trigger=Trigger.arrival, arrival_radius=1.0, period=5.0)
    left, right = Sender(2), Sender(3)
    others = [left.position(10.0), right.position(50.0)]
    agent.until(2.0 + H)
    assert agent.m.step == 1
    agent.step(pilot.position(20.0, 10.0))
    assert agent.m.step == 1  # arrived, but no news of the neighbours
    agent.step(others[0])
    agent.step(others[1])
    assert agent.m.step == 2
    began = agent.t - H
    assert agent.m.target == pytest.approx(20.0 + 20.0 / 3.0, abs=0.02)
    agent.until(began + 3.0, lambda: [pilot.position(24.0, 10.0), *others])
    assert agent.m.step == 2
    agent.step(pilot.position(25.8, 10.0), *others)
    assert agent.m.step == 3
    began = agent.t - H
    agent.until(began + 5.0, lambda: [pilot.position(0.0, 10.0), *others])
    assert agent.m.step == 3
    agent.step()
    assert agent.m.step == 4  # never arrived: the timeout


@pytest.mark.parametrize(
    ("parameters", "code"),
    [
        ({"sysid": 0}, 1),
        ({"sysid": 256}, 1),
        ({"left_sysid": 1}, 2),
        ({"right_sysid": 256}, 2),
        ({"left_sysid": -1}, 2),
        ({"period": 0.0}, 3),
        ({"position_rate": 0.0}, 3),
        ({"altitude": math.nan}, 3),
        ({"timeout": 0.0}, 3),
    ],
)
def test_impossible_parameters_are_errors(parameters: dict[str, Any], code: int) -> None:
    m = LineAgent.record()
    for name, value in parameters.items():
        m[name] = value
    assert kernels(LineAgent)[0](m) == code
    assert code in LineAgent.errors


def test_the_send_buffer_holds_what_one_step_can_send() -> None:
    """A heartbeat, and a command or a position target: one of each at most."""
    agent, pilot = flying(first_step_time=2.0)
    left, right = Sender(2), Sender(3)
    most = 0
    while agent.t < 30.0:
        agent.step(pilot.position(20.0, 10.0), left.position(10.0), right.position(50.0))
        most = max(most, int(agent.m.mavlink_tx_len))
    assert 21 < most <= 21 + 65 < agent.m.mavlink_tx.size


# ---- five agents -------------------------------------------------------------------------------------------------


class PointMass:
    """An ideal autopilot and vehicle: does what it is told at once, moves at 8 m/s, and says where it is at 4 Hz."""

    def __init__(self, system: int, place: float) -> None:
        self.send = Sender(system)
        self.parser = mavlink.MAVLink(None)
        self.place = self.target = place
        self.height = self.climb_to = 0.0
        self.armed, self.mode = False, 0
        self.streams: set[int] = set()

    def step(self, t: float, k: int, packets: bytes) -> bytes:
        out = b""
        for message in (self.parser.parse_buffer(packets) if packets else None) or []:
            if message.get_type() == "COMMAND_LONG" and message.target_system == self.send.link.srcSystem:
                self.obey(message)
                out += self.send.ack(message.command, ACCEPTED, message.get_srcSystem())
            elif message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
                self.target = place_of(message.lon_int)
                assert message.lat_int == round(LATITUDE * 1e7)
        self.place += min(max(self.target - self.place, -8.0 * H), 8.0 * H)
        self.height += min(max(self.climb_to - self.height, -2.5 * H), 2.5 * H)
        if k % 40 == 0:
            out += self.send.heartbeat(armed=self.armed, mode=self.mode)
        if k % 20 == 0 and 33 in self.streams:
            out += self.send.position(self.place, self.height)
        if k % 80 == 0 and {24, 193} <= self.streams:
            out += self.send.estimate(831 if t > 2.0 else 167) + self.send.gps()
        return out

    def obey(self, message: Any) -> None:
        if message.command == 511:
            self.streams.add(int(message.param1))
        elif message.command == 176:
            self.mode = int(message.param2)
        elif message.command == 400:
            self.armed = True
        elif message.command == 22:
            self.climb_to = message.param7


PLACES = (0.0, 10.0, 20.0, 50.0, 100.0)


def formation(
    seconds: float,
    *,
    lost: Callable[[int, int, int], bool] = lambda sender, receiver, k: False,
    delay: int = 1,
    **parameters: Any,
) -> tuple[list[Agent], list[PointMass], dict[int, list[float]]]:
    """Five agents and vehicles exchange packets each step; also returns {step: places at its end}.

    What a vehicle says reaches its own agent in the next step and the neighbours' after `delay` steps, unless `lost`.
    """
    n = len(PLACES)
    ends = (0, n - 1)
    agents = [
        Agent(sysid=i + 1, left_sysid=i, right_sysid=(i + 2) % (n + 1), stubborn=i in ends, first_step_time=15.0)
        for i in range(n)
    ]
    for agent in agents:
        for name, value in parameters.items():
            agent.m[name] = value
    vehicles = [PointMass(i + 1, place) for i, place in enumerate(PLACES)]
    said: list[list[bytes]] = [[b""] * n for _ in range(delay)]
    snapshots: dict[int, list[float]] = {}
    for k in range(round(seconds / H)):
        told = []
        for i, agent in enumerate(agents):
            radio = [said[0][j] for j in (i - 1, i + 1) if 0 <= j < n and said[0][j] and not lost(j, i, k)]
            told.append(b"".join(bytes(m.get_msgbuf()) for m in agent.step(said[-1][i], *radio)))
        steps = {int(a.m.step) for a in agents}
        if len(steps) == 1:
            snapshots[steps.pop()] = [v.place for v in vehicles]
        said = [*said[1:], [v.step(k * H, k, told[i]) for i, v in enumerate(vehicles)]]
    return agents, vehicles, snapshots


@pytest.mark.parametrize("epsilon", [0.25, 1.0 / 3.0, 0.5])
def test_five_agents_step_as_the_law_says(epsilon: float) -> None:
    """The vehicles arrive within each period, so step k + 1 is row k of the law, but for the quantum of longitude."""
    agents, vehicles, snapshots = formation(15.0 + 17 * 3.1875, epsilon=epsilon)
    x = np.array(PLACES)
    for k in range(17):
        assert np.allclose(snapshots[k + 1], x, atol=0.05), k
        x[1:-1] += epsilon * (x[:-2] - 2.0 * x[1:-1] + x[2:])
    assert all(a.m.state == AgentState.formation for a in agents)
    assert abs(vehicles[0].place) < 0.01 and abs(vehicles[4].place - 100.0) < 0.01
    if epsilon == 1.0 / 3.0:
        assert np.allclose(snapshots[9][1:4], [21.4, 44.9, 71.4], atol=0.06)
        assert np.allclose(snapshots[17][1:4], [24.36, 49.10, 74.36], atol=0.05)


def test_loss_and_latency_hardly_matter() -> None:
    """20 % loss and 0.2 s latency; each packet's fate is drawn from its sender, receiver and time."""

    def lost(sender: int, receiver: int, k: int) -> bool:
        return bool(np.random.default_rng([sender, receiver, k]).random() < 0.2)

    _, _, snapshots = formation(15.0 + 17 * 3.1875, lost=lost, delay=16)
    assert np.allclose(snapshots[17][1:4], [24.36, 49.10, 74.36], atol=0.3)


def test_a_drone_cut_off_becomes_a_third_fixed_node() -> None:
    """Drone 3 loses its radio during step 4, once it has arrived; it stays, and the others settle between.

    The cut comes more than `stale_time` before step 5: what it does not know to be old it still uses.
    """
    since = round((15.0 + 3.6 * 3.1875) / H)
    agents, vehicles, snapshots = formation(
        15.0 + 40 * 3.1875, lost=lambda sender, receiver, k: k > since and 2 in (sender, receiver)
    )
    middle = snapshots[4][2]
    assert 20.0 < middle < 45.0
    expected = [0.0, middle / 2.0, middle, (middle + 100.0) / 2.0, 100.0]
    assert np.allclose([v.place for v in vehicles], expected, atol=0.06)
    assert agents[1].m.right_age > 60.0
    assert agents[1].m.left_age < 0.3


# ---- compiled and interpreted ------------------------------------------------------------------------------------


def history() -> tuple[np.ndarray, np.ndarray]:
    """Outputs and sent bytes of every step from the first heartbeat to the fourth step."""
    rows, packets = [], []
    agent, pilot = flying(place=20.0)
    left, right = Sender(2), Sender(3)
    for k in range(1000):
        news = [pilot.position(20.0 + 0.01 * k, 10.0)] if k % 20 == 0 else []
        news += [left.position(10.0 + 0.02 * k), b"\xfd\x00"] if k % 23 == 0 else []
        news += [right.position(50.0)] if k % 31 == 0 else []
        agent.step(*news)
        m = agent.m
        rows.append([m.state, m.failure, m.step, m.target, m.position, m.left_age, m.right_age, m.mavlink_tx_len])
        packets.append(m.mavlink_tx[:100].copy())
    return np.array(rows, dtype=float), np.array(packets)


def test_interpreted_kernels_give_the_same_numbers(tmp_path: Path) -> None:
    path = tmp_path / "interpreted.npz"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run([sys.executable, __file__, str(path)], check=True, env=environment)
    interpreted = np.load(path)
    rows, packets = history()
    assert np.allclose(interpreted["rows"], rows, rtol=1e-12, atol=1e-12)
    assert np.array_equal(interpreted["packets"], packets)
    assert rows[-1, 2] == 4


if __name__ == "__main__":
    recorded = history()
    np.savez(sys.argv[1], rows=recorded[0], packets=recorded[1])


# ---- the guard ---------------------------------------------------------------------------------------------------

GUARD = {"guard_separation": 6.0, "guard_p": 0.5, "stale_time": 3.0, "period": 10.0, "first_step_time": 1.0}
FENCE = {"fence_corners": 4, "fence_north": (9.0, 9.0, -9.0, -9.0), "fence_east": (-50.0, 22.0, 22.0, -50.0)}


def guarded(others: dict[int, float], height: float = 10.0, **parameters: Any) -> list[Any]:
    """The set-points of an agent at 20 m between neighbours at 0 and 100 m, whom it hears, and the others too."""
    wide = {name: np.array((*v, 0, 0, 0, 0)) if isinstance(v, tuple) else v for name, v in parameters.items()}
    agent, pilot = flying(left_sysid=200, right_sysid=201, epsilon=0.5, **GUARD | wide)
    nodes = {sysid: Sender(sysid) for sysid in (200, 201, *others)}
    agent.until(0.9)
    heard = [pilot.position(20.0, 10.0), nodes[200].position(0.0, 10.0), nodes[201].position(100.0, 10.0)]
    agent.step(*heard, *[nodes[sysid].position(place, height) for sysid, place in others.items()])
    agent.until(1.85)
    agent.step(pilot.position(20.0, 10.0))
    agent.until(2.5)
    assert agent.m.step == 1
    return [m for t, m in agent.sent if m.get_type() == "SET_POSITION_TARGET_GLOBAL_INT" and t > 1.05]


def test_with_a_guard_it_sends_the_velocity_towards_its_target_five_times_a_second() -> None:
    agent, pilot = flying(epsilon=0.5, **GUARD | {"first_step_time": 1.0, "period": 1.0, "guard_separation": 1.0})
    nodes = [Sender(2), Sender(3)]
    agent.until(1.9)
    agent.step(pilot.position(20.0, 9.0), nodes[0].position(0.0, 10.0), nodes[1].position(46.0, 10.0))
    agent.until(3.0)
    sent = [(t, m) for t, m in agent.sent if m.get_type() == "SET_POSITION_TARGET_GLOBAL_INT" and t > 1.99]
    assert [t for t, _ in sent] == pytest.approx([2.0, 2.2, 2.4, 2.6, 2.8])
    assert agent.m.target == pytest.approx(23.0, abs=0.02)
    for _, m in sent:
        assert m.type_mask == 0x0DC7
        assert (m.vx, m.vy, m.vz) == pytest.approx((0.0, 1.5, -0.5), abs=0.02)


@pytest.mark.parametrize(
    ("others", "parameters", "speed"),
    [
        ({}, {}, 0.0),
        ({9: 27.0}, {}, 0.0),
        ({9: 25.0}, {}, -0.25),
        ({9: 15.0, 8: 100.0}, {}, 0.25),
        ({9: 24.0, 8: 16.0}, {}, 0.0),
        ({}, FENCE, 0.0),
        ({}, FENCE | {"fence_east": (-50.0, 19.0, 19.0, -50.0)}, -0.5),
    ],
)
def test_the_guard_keeps_from_whoever_is_heard_and_within_the_fence(
    others: dict[int, float], parameters: dict[str, Any], speed: float
) -> None:
    """Half of the missing distance times guard_p; it wants to stay where it is, since its first step is the start."""
    sent = guarded(others, **parameters)
    assert len(sent) == 7
    assert all(m.vy == pytest.approx(speed, abs=0.02) for m in sent)


def test_whoever_flies_far_above_is_not_kept_from() -> None:
    agent, pilot = flying(**GUARD)
    other = Sender(9)
    agent.until(0.9)
    high = other(
        mavlink.MAVLink_global_position_int_message(
            0, round(LATITUDE * 1e7), longitude_of(20.5), 590100, 16100, 0, 0, 0, 0
        )
    )
    agent.step(pilot.position(20.0, 10.0), high)
    agent.until(1.5)
    velocities = [m.vy for m in agent.all("SET_POSITION_TARGET_GLOBAL_INT") if m.type_mask == 0x0DC7]
    assert velocities and velocities == pytest.approx([0.0] * len(velocities), abs=0.02)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"fence_corners": 2}, 5),
        ({"fence_corners": 4}, 5),
        ({"guard_separation": 1.0, "guard_p": 5.1}, 6),
        ({"guard_separation": 1.0, "guard_period": 0.0}, 6),
        ({"guard_period": 0.0}, 0),
    ],
)
def test_a_guard_that_cannot_be(given: dict[str, Any], code: int) -> None:
    m = LineAgent.record()
    for name, value in given.items():
        m[name] = value
    start, _ = kernels(LineAgent)
    assert start(m) == code
    assert code in LineAgent.errors or code == 0

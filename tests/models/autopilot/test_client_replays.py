"""Recorded conversations of real ground stations with ArduCopter, replayed in simulated time.

Each recording holds what the client sent and how ArduCopter answered: DroneKit 2.9.2, MAVProxy 1.8.75, MAVSDK 3.17 and
4.1, connecting, waiting until ready, GUIDED, arming, take-off to 10 m, 20 m east, landing. The client's packets are
delivered at their recorded times; the answers must be the recorded ones, in order, and the flight must take place.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import Copter, H

CLIENTS = Path(__file__).parents[2] / "data" / "clients"
ANSWERS = ("COMMAND_ACK", "MISSION_ACK")


def conversation(name: str, system: int) -> tuple[list[tuple[float, bytes]], list[Any]]:
    """What the client sent when [s], and what the vehicle answered."""
    data, at = (CLIENTS / f"{name}.tlog").read_bytes(), 0
    parser = mavlink.MAVLink(None)
    sent: list[tuple[float, bytes]] = []
    answers: list[Any] = []
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        length = 12 + data[at + 9] if data[at + 8] == 0xFD else 8 + data[at + 9]
        packet = data[at + 8 : at + 8 + length]
        at += 8 + length
        (message,) = parser.parse_buffer(packet)
        if (message.get_srcSystem(), message.get_srcComponent()) == (system, 1):
            answers.append(message)
        else:
            sent.append((stamp * 1e-6, packet))
    return sent, answers


def told(messages: list[Any]) -> list[tuple[int, int]]:
    """Answers by command (-1 for a mission's) and result."""
    return [
        (m.command, m.result) if m.get_type() == "COMMAND_ACK" else (-1, m.type)
        for m in messages
        if m.get_type() in ANSWERS
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "system", "boot"),
    [("dronekit", 1, 0.75), ("mavproxy", 1, 1.29), ("mavsdk-3.17", 1, 1.01), ("mavsdk-4.1", 2, 1.01)],
)
def test_a_recorded_client_is_answered_as_arducopter_answered_it(name: str, system: int, boot: float) -> None:
    """`boot`: the vehicle's clock [s] when the recording begins."""
    sent, answers = conversation(name, system)
    copter = Copter(autopilot={"estimate_ready_time": 41.5}, system=system)
    highest, farthest = 0.0, 0.0
    for at, packet in sent:
        flight = copter.run(max(round((at + boot - copter.time) / H), 0) * H)
        if len(flight):
            highest, farthest = max(highest, -flight[:, 3].min()), max(farthest, np.abs(flight[:, 2]).max())
        copter.waiting += packet
    flight = copter.run(30.0)
    heard = [m for _, m in copter.heard]
    assert told(heard) == told(answers)
    for kind in ("AUTOPILOT_VERSION", "HOME_POSITION"):
        if any(m.get_type() == kind for m in answers):
            assert any(m.get_type() == kind for m in heard), kind
    version = {m.get_type(): m for m in heard}.get("AUTOPILOT_VERSION")
    if version is not None:
        real = {m.get_type(): m for m in answers}["AUTOPILOT_VERSION"]
        assert version.flight_sw_version == real.flight_sw_version
        assert version.capabilities & ~real.capabilities == 0
    assert highest == pytest.approx(10.0, abs=0.6)
    assert farthest > 15.0
    assert not copter.m["armed"]
    assert abs(copter.v["position"][2]) < 0.1

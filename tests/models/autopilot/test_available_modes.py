"""AVAILABLE_MODES as ArduCopter, ArduRover and ArduPlane tell it, decoded by pymavlink's development dialect."""

from __future__ import annotations

import json
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.dialects.v20 import development

from tests.models.autopilot.test_small_autopilots import started
from tests.models.copter import ACCEPTED, DENIED, FAILED, RECORDINGS, Copter, Decoder

TOLD: dict[str, list[list[Any]]] = json.loads((RECORDINGS / "modes.json").read_text())
MODES, CURRENT, MONITOR = (
    development.MAVLINK_MSG_ID_AVAILABLE_MODES,
    development.MAVLINK_MSG_ID_CURRENT_MODE,
    development.MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR,
)
REQUEST, INTERVAL = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL


def decoded(data: bytes) -> list[Any]:
    """Strictly: CRC_EXTRA and lengths are those of the dialect."""
    return list(development.MAVLink(None).parse_buffer(data) or [])


def modes(data: bytes) -> list[list[Any]]:
    found = [m for m in decoded(data) if m.get_type() == "AVAILABLE_MODES"]
    assert all((m.standard_mode, m.properties) == (0, 0) for m in found)
    return [[m.number_modes, m.mode_index, m.custom_mode, m.mode_name] for m in found]


class Ear(Decoder):
    """Keeps the bytes that it decodes."""

    def __init__(self) -> None:
        super().__init__()
        self.sent = bytearray()

    def __call__(self, data: bytes) -> list[Any]:
        self.sent += data
        return super().__call__(data)


def monitors(data: bytes) -> list[int]:
    return [m.seq for m in decoded(data) if m.get_type() == "AVAILABLE_MODES_MONITOR"]


def test_the_copters_modes() -> None:
    copter = Copter()
    copter.run(1.0)
    found = []
    for index in range(1, 25):
        copter.sent.clear()
        assert copter.ask(REQUEST, MODES, index)[0][2] == ACCEPTED
        found += modes(bytes(copter.sent))
    assert found == TOLD["copter"]
    for index, first in ((25, []), (-1, []), (256, TOLD["copter"][:1]), (257, TOLD["copter"][:1])):
        copter.sent.clear()
        assert copter.ask(REQUEST, MODES, index)[0][2] == ACCEPTED
        assert modes(bytes(copter.sent)) == first


def test_all_modes_of_the_copter_come_at_the_interval_of_the_message() -> None:
    copter = Copter()
    copter.run(1.0)
    assert copter.ask(REQUEST, MODES, 0)[0][2] == ACCEPTED
    copter.run(2.0)
    assert modes(bytes(copter.sent)) == TOLD["copter"][:1]
    assert copter.ask(INTERVAL, MODES, 100_000)[0][2] == ACCEPTED
    copter.run(3.0)
    assert modes(bytes(copter.sent)) == TOLD["copter"]


def test_the_monitor_comes_every_five_seconds_after_a_request() -> None:
    copter = Copter()
    copter.run(6.0)
    assert monitors(bytes(copter.sent)) == []
    assert copter.ask(REQUEST, MONITOR)[0][2] == ACCEPTED
    assert monitors(bytes(copter.sent)) == [0]
    assert copter.ask(REQUEST, MODES, 1)[0][2] == ACCEPTED
    copter.run(10.1)
    assert monitors(bytes(copter.sent)) == [0, 0, 0]
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, MONITOR)
    copter.run(0.01)
    assert copter.messages("MESSAGE_INTERVAL")[0].interval_us == 5_000_000


def test_the_current_mode_is_unknown() -> None:
    copter = Copter()
    copter.run(1.0)
    assert copter.ask(REQUEST, CURRENT) == [("ACK", REQUEST, FAILED)]
    assert copter.ask(INTERVAL, CURRENT, 1e5)[0] == ("ACK", INTERVAL, DENIED)


@pytest.mark.parametrize("kind", ["rover", "plane", "quadplane"])
def test_modes_of_rover_and_planes(kind: str) -> None:
    p = started(kind)
    p._decode = ear = Ear()
    sent = ear.sent
    assert p.ask(REQUEST, MODES, 3) == ACCEPTED
    assert modes(bytes(sent)) == [TOLD[kind][2]]
    sent.clear()
    assert p.ask(REQUEST, MODES, 99) == ACCEPTED
    assert modes(bytes(sent)) == []
    assert p.ask(REQUEST, MODES, 0) == ACCEPTED
    p.until(p.time + 0.55)
    assert 5 <= len(modes(bytes(sent))) <= 7
    p.until(p.time + 6.0)
    assert modes(bytes(sent)) == TOLD[kind]
    assert monitors(bytes(sent)) == [0]
    assert p.ask(REQUEST, CURRENT) == FAILED

"""The autopilot's links: streams, answers, sequence and MAVLink version are those of one link, what all must know goes
out by every link. ArduPilot's rule: a channel is where a packet came in."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.link.statustext import NO_SUCH_MODE, WARNING, say, send_texts
from tests.models.copter import ACCEPTED, GUIDED, LINES, Copter

ALL = ("mavlink", *LINES)
ATTITUDE, LOCAL_POSITION = mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED


def heard(copter: Copter, line: str) -> list[Any]:
    return [message for _, message in copter.heard] if line == "mavlink" else copter.heard_at[line]


def forget(copter: Copter) -> None:
    copter.heard.clear()
    for messages in copter.heard_at.values():
        messages.clear()


def counts(copter: Copter, line: str) -> Counter[str]:
    return Counter(message.get_type() for message in heard(copter, line))


def command(number: int, *parameters: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *parameters, *[0.0] * (7 - len(parameters)))


def stream(rate: int, start: int = 1) -> Any:
    return mavlink.MAVLink_request_data_stream_message(1, 1, 0, rate, start)


@pytest.fixture
def copter() -> Copter:
    copter = Copter()
    copter.run(2.5)
    forget(copter)
    return copter


@pytest.mark.parametrize("asked", ALL)
def test_a_rate_is_that_of_the_link_by_which_it_was_asked_for(copter: Copter, asked: str) -> None:
    copter.send(stream(50), line=asked)
    copter.run(2.0)
    assert counts(copter, asked)["ATTITUDE"] == pytest.approx(100, abs=1)
    for other in set(ALL) - {asked}:
        assert counts(copter, other) == {"HEARTBEAT": 2}


def test_every_link_has_its_own_rates_at_the_same_time(copter: Copter) -> None:
    copter.send(stream(50), line="serial")
    copter.send(stream(4), line="telemetry")
    copter.send(command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION, 1e5), line="mavlink")
    copter.run(0.1)
    forget(copter)
    copter.run(2.0)
    assert counts(copter, "serial")["ATTITUDE"] == pytest.approx(100, abs=1)
    assert counts(copter, "telemetry")["ATTITUDE"] == pytest.approx(8, abs=1)
    on_board = counts(copter, "mavlink")
    assert (on_board["ATTITUDE"], on_board["LOCAL_POSITION_NED"]) == (0, pytest.approx(20, abs=1))


def test_stopping_all_streams_of_one_link_leaves_the_others(copter: Copter) -> None:
    copter.send(command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION, 1e5), line="mavlink")
    copter.send(stream(10), line="telemetry")
    copter.run(0.5)
    copter.send(stream(0, start=0), line="telemetry")
    copter.run(0.1)
    forget(copter)
    copter.run(2.0)
    assert counts(copter, "telemetry") == {"HEARTBEAT": 2}
    assert counts(copter, "mavlink")["LOCAL_POSITION_NED"] == pytest.approx(20, abs=1)


def test_an_interval_is_told_as_it_is_on_the_link_that_asks(copter: Copter) -> None:
    copter.send(command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE, 2e4), line="serial")
    copter.run(0.1)
    forget(copter)
    for line in ALL:
        copter.send(command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, ATTITUDE), line=line)
    copter.tick()
    told = {line: [m.interval_us for m in heard(copter, line) if m.get_type() == "MESSAGE_INTERVAL"] for line in ALL}
    assert told == {"mavlink": [-1], "telemetry": [-1], "serial": [20000]}


def test_every_link_has_rates_of_its_own_parameters() -> None:
    copter = Copter(autopilot={"SR0_EXTRA1": 20, "SR1_EXTRA1": 10, "SR2_EXTRA1": 5, "SR1_POSITION": 4})
    copter.run(2.5)
    forget(copter)
    copter.run(2.0)
    assert [counts(copter, line)["ATTITUDE"] for line in ALL] == [10, 20, 40]
    assert [counts(copter, line)["GLOBAL_POSITION_INT"] for line in ALL] == [0, 8, 0]


@pytest.mark.parametrize("asked", ALL)
def test_answers_go_where_the_question_came_from(copter: Copter, asked: str) -> None:
    copter.send(
        command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1),
        mavlink.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
        mavlink.MAVLink_timesync_message(0, 7),
        line=asked,
    )
    copter.run(0.1)
    found = counts(copter, asked)
    assert found == {"COMMAND_ACK": 1, "AUTOPILOT_VERSION": 1, "PARAM_VALUE": 1, "MISSION_COUNT": 1, "TIMESYNC": 1}
    assert all(not heard(copter, other) for other in set(ALL) - {asked})


def test_lists_of_parameters_and_files_go_by_one_link_each(copter: Copter) -> None:
    copter.send(mavlink.MAVLink_param_request_list_message(1, 1), line="serial")
    copter.run(0.5)
    copter.send(mavlink.MAVLink_param_request_list_message(1, 1), line="telemetry")
    copter.run(0.5)
    assert counts(copter, "serial")["PARAM_VALUE"] == pytest.approx(200, abs=2)
    assert counts(copter, "telemetry")["PARAM_VALUE"] == pytest.approx(100, abs=2)
    indices = [m.param_index for m in heard(copter, "telemetry") if m.get_type() == "PARAM_VALUE"]
    assert indices == list(range(len(indices)))
    assert counts(copter, "mavlink")["PARAM_VALUE"] == 0


def test_what_all_must_know_goes_out_by_every_link(copter: Copter) -> None:
    copter.send(mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 2000.0, 9), line="serial")
    copter.send(
        command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED),
        command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1),
        line="telemetry",
    )
    copter.run(0.1)
    for line in ALL:
        found = counts(copter, line)
        assert found["PARAM_VALUE"] == 1, line
        assert found["HEARTBEAT"] >= 1
        assert found["HOME_POSITION"] == 1
        assert [m.text for m in heard(copter, line) if m.get_type() == "STATUSTEXT"] == ["Arming motors"]
    acks = {line: [m.result for m in heard(copter, line) if m.get_type() == "COMMAND_ACK"] for line in ALL}
    assert acks == {"mavlink": [], "telemetry": [ACCEPTED, ACCEPTED], "serial": []}


def test_a_link_that_is_full_gets_its_texts_later_and_the_others_at_once(copter: Copter) -> None:
    m = copter.m
    before = m["serial_tx"].shape[0] - 5
    for number in (1, 2):
        m["serial_tx_len"], m["telemetry_tx_len"] = before, 0
        say(m, WARNING, NO_SUCH_MODE, number)
        send_texts(m)
        assert m["serial_tx_len"] == before
        assert b"No such mode %d" % number in m["telemetry_tx"][: m["telemetry_tx_len"]].tobytes()
    m["serial_tx_len"] = m["telemetry_tx_len"] = 0
    send_texts(m)
    late = m["serial_tx"][: m["serial_tx_len"]].tobytes()
    assert 0 < late.find(b"No such mode 1") < late.find(b"No such mode 2")
    assert m["telemetry_tx_len"] == 0
    assert m["text_count"] == 0


def test_every_link_has_its_own_sequence_and_version(copter: Copter) -> None:
    copter.send(stream(10), version=1, line="telemetry")
    copter.send(stream(10), line="serial")
    copter.run(3.0)
    for line, magic in (("mavlink", 0xFD), ("telemetry", 0xFE), ("serial", 0xFD)):
        packets = heard(copter, line)
        assert {m.get_msgbuf()[0] for m in packets} == {magic}, line
        assert (np.diff([m.get_seq() for m in packets]) % 256 == 1).all(), line
    assert len(heard(copter, "telemetry")) > 300 > len(heard(copter, "mavlink"))


def test_a_mission_is_asked_for_by_the_link_that_offers_it(copter: Copter) -> None:
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0), line="serial")
    copter.run(2.2)
    assert counts(copter, "serial")["MISSION_REQUEST"] == 3
    assert counts(copter, "mavlink")["MISSION_REQUEST"] == counts(copter, "telemetry")["MISSION_REQUEST"] == 0
    copter.run(8.0)
    assert [m.type for m in heard(copter, "serial") if m.get_type() == "MISSION_ACK"] == [15]


def test_a_ground_station_is_heard_by_any_link(copter: Copter) -> None:
    copter.send(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 1.0, 9), line="serial")
    copter.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), line="telemetry")
    copter.run(0.5)
    assert copter.m["station_known"]
    assert not copter.m["station_lost"]
    copter.run(5.2)
    assert copter.m["station_lost"]
    copter.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), line="serial")
    copter.run(0.2)
    assert not copter.m["station_lost"]

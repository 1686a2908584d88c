"""Requests for logs through a gateway: which are answered, and with which packets; pymavlink is the oracle."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.diagnostics.errors import CosimError
from cosim_master.network.gateways.logs import LogRequests

LOG = bytes(range(256)) * 20  # 5,120 bytes: 56 pieces of 90 and one of 80
STATION = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def beat(system: int, armed: bool, component: int = 1, version: int = 2) -> bytes:
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    message = mavlink.MAVLink_heartbeat_message(2, 3, 81 + 128 * armed, 0, 3, 3)
    return bytes(message.pack(link, force_mavlink1=version == 1))


def asked(message: Any, version: int = 2) -> bytes:
    return bytes(message.pack(STATION, force_mavlink1=version == 1))


def listed(to: int = 3, component: int = 1) -> bytes:
    return asked(mavlink.MAVLink_log_request_list_message(to, component, 0, 0xFFFF))


def data(offset: int, count: int, number: int = 1, to: int = 3) -> bytes:
    return asked(mavlink.MAVLink_log_request_data_message(to, 1, number, offset, count))


@pytest.fixture
def thread() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as one:
        yield one


@pytest.fixture
def requests(thread: ThreadPoolExecutor) -> LogRequests:
    """Requests to system 3, which has a log and has been heard armed and disarmed, and to 4, which has none."""

    def write(system: int) -> tuple[bytes, int]:
        if system != 3:
            raise CosimError("no log")
        return LOG, 1735689600

    made = LogRequests(write, thread)
    made.hear([beat(3, True), beat(4, True), beat(3, False), beat(4, False, version=1)])
    return made


def answers(requests: LogRequests, thread: ThreadPoolExecutor, *packets: bytes) -> list[Any]:
    """All messages that follow, read by pymavlink; none of the packets is for the network."""
    assert requests.take(packets) == []
    thread.submit(lambda: None).result()  # the log is written
    found: list[Any] = []
    while due := requests.answers():
        found += mavlink.MAVLink(None).parse_buffer(b"".join(due)) or []
    return found


def test_a_log_is_listed_and_downloaded(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    (entry,) = answers(requests, thread, listed())
    assert (entry.get_srcSystem(), entry.get_srcComponent()) == (3, 1)
    assert (entry.id, entry.num_logs, entry.last_log_num) == (1, 1, 1)
    assert (entry.size, entry.time_utc) == (len(LOG), 1735689600)
    pieces = answers(requests, thread, data(0, 0xFFFFFFFF))
    assert [piece.ofs for piece in pieces] == list(range(0, len(LOG), 90))
    assert b"".join(bytes(piece.data[: piece.count]) for piece in pieces) == LOG
    assert [piece.count for piece in pieces] == [90] * 56 + [80]
    sequences = [entry.get_seq(), *(piece.get_seq() for piece in pieces)]
    assert sequences == list(range(1, len(pieces) + 2))


def test_a_gap_is_filled_and_what_is_beyond_the_end_is_empty(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    answers(requests, thread, listed())
    found = answers(requests, thread, data(95, 100))
    assert [(piece.ofs, piece.count) for piece in found] == [(95, 90), (185, 10)]
    assert bytes(found[1].data[:10]) == LOG[185:195]
    (end,) = answers(requests, thread, data(len(LOG) + 5, 90))
    assert (end.ofs, end.count) == (len(LOG), 0)


def test_at_most_forty_pieces_are_sent_at_once_until_the_end_is_asked_for(
    requests: LogRequests, thread: ThreadPoolExecutor
) -> None:
    answers(requests, thread, listed())
    assert requests.take([data(0, len(LOG))]) == []
    assert len(requests.answers()) == 40
    assert answers(requests, thread, asked(mavlink.MAVLink_log_request_end_message(3, 1))) == []


@pytest.mark.parametrize("ask", [data(0, 90, number=2), data(0, 90, number=0)])
def test_other_logs_do_not_exist(requests: LogRequests, thread: ThreadPoolExecutor, ask: bytes) -> None:
    answers(requests, thread, listed())
    assert answers(requests, thread, ask) == []


def test_without_a_list_there_is_nothing_to_download(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    assert answers(requests, thread, data(0, 90)) == []


def test_an_autopilot_without_a_log_lists_none(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    (entry,) = answers(requests, thread, listed(4))
    assert (entry.get_srcSystem(), entry.id, entry.num_logs, entry.size) == (4, 0, 0, 0)


def test_without_a_flight_there_is_no_log(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    """As in ArduPilot, whose log begins at arming."""
    fresh = LogRequests(lambda _: (LOG, 0), thread)
    fresh.hear([beat(3, False)])
    (entry,) = answers(fresh, thread, listed())
    assert (entry.id, entry.num_logs) == (0, 0)
    assert answers(fresh, thread, data(0, 90)) == []


def test_an_erased_log_is_gone_until_the_next_flight(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    answers(requests, thread, listed())
    assert answers(requests, thread, asked(mavlink.MAVLink_log_erase_message(3, 1))) == []
    assert answers(requests, thread, data(0, 90)) == []
    (entry,) = answers(requests, thread, listed())
    assert (entry.id, entry.num_logs) == (0, 0)
    requests.hear([beat(3, True), beat(3, False)])
    (entry,) = answers(requests, thread, listed())
    assert (entry.id, entry.num_logs) == (1, 1)


def test_a_log_is_of_the_latest_list(thread: ThreadPoolExecutor) -> None:
    """A second list while one is written is the same; a later one is a longer log."""
    written: list[int] = []

    def write(system: int) -> tuple[bytes, int]:
        written.append(system)
        return b"x" * (100 * len(written)), 0

    requests = LogRequests(write, thread)
    requests.hear([beat(3, True), beat(3, False)])
    assert [entry.size for entry in answers(requests, thread, listed(), listed())] == [100]
    assert [entry.size for entry in answers(requests, thread, listed())] == [200]
    assert written == [3, 3]


@pytest.mark.parametrize(
    ("make", "packet"),
    [
        (lambda: beat(3, True), listed()),  # armed: the autopilot refuses it
        (lambda: beat(3, True), data(0, 90)),
        (lambda: beat(3, False), listed(5)),  # never heard
        (lambda: beat(3, False), listed(3, 190)),  # another component's
        (lambda: beat(3, False), asked(mavlink.MAVLink_param_request_list_message(3, 1))),
        (lambda: beat(3, True, component=154), listed(5)),
    ],
)
def test_all_else_goes_on_to_the_network(requests: LogRequests, make: Callable[[], bytes], packet: bytes) -> None:
    requests.hear([make()])
    assert requests.take([packet]) == [packet]
    assert requests.answers() == []


def test_arming_interrupts_a_download_and_a_gimbals_heartbeat_does_not(
    requests: LogRequests, thread: ThreadPoolExecutor
) -> None:
    answers(requests, thread, listed())
    requests.take([data(0, 4000)])
    requests.hear([beat(3, True, component=154)])
    assert len(requests.answers()) == 40
    requests.hear([beat(3, True)])
    assert requests.answers() == []


def test_requests_of_mavlink_1_are_read_too(requests: LogRequests, thread: ThreadPoolExecutor) -> None:
    (entry,) = answers(requests, thread, asked(mavlink.MAVLink_log_request_list_message(3, 1, 0, 9), version=1))
    assert entry.size == len(LOG)

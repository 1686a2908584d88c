"""The parameter file by MAVLink's file transfer, as a recorded MAVProxy asked ArduCopter for it."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.mavftp import MAVFTP

from cosim_models.autopilot.mavlink.parameters import PARAMETER_COUNT, PARAMETER_NAMES
from tests.models.copter import Copter

TERMINATE, RESET, LIST, OPEN, READ, WRITE, REMOVE, CRC, BURST = 1, 2, 3, 4, 5, 7, 8, 14, 15
ACK, NAK = 128, 129
FAILED, INVALID_SESSION, END, PROTECTED, NOT_FOUND = 1, 4, 6, 9, 10
NAME = b"@PARAM/param.pck"


class Answer:
    """The payload of an answer, taken apart."""

    def __init__(self, message: Any) -> None:
        assert (message.target_system, message.target_component) == (255, 190)
        payload = bytes(message.payload)
        self.sequence, self.session, self.opcode, size, self.request, self.complete, _, self.offset = struct.unpack(
            "<HBBBBBBI", payload[:12]
        )
        self.data = payload[12 : 12 + size]


def ask(
    copter: Copter,
    sequence: int,
    opcode: int,
    data: bytes = b"",
    offset: int = 0,
    size: int | None = None,
    session: int = 9,
) -> None:
    head = struct.pack("<HBBBBBBI", sequence, session, opcode, len(data) if size is None else size, 0, 0, 0, offset)
    payload = list((head + data).ljust(251, b"\0"))
    copter.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))


def answers(copter: Copter, duration: float = 0.01) -> list[Answer]:
    copter.heard.clear()
    copter.run(duration)
    return [Answer(m) for m in copter.messages("FILE_TRANSFER_PROTOCOL")]


@pytest.fixture
def copter() -> Copter:
    copter = Copter()
    copter.run(0.1)
    return copter


def opened(copter: Copter, name: bytes = NAME) -> int:
    ask(copter, 0, OPEN, name)
    (answer,) = answers(copter)
    assert (answer.opcode, answer.request, answer.sequence, answer.session) == (ACK, OPEN, 1, 9)
    return int.from_bytes(answer.data, "little")


def test_a_burst_brings_all_parameters(copter: Copter) -> None:
    """As recorded: open, one burst of pieces of 239 bytes, the end told by a NAK, terminate."""
    length = opened(copter, NAME + b"?withdefaults=1")
    ask(copter, 1, BURST, size=239)
    found = answers(copter, length / 239 * 0.005 + 0.05)
    *pieces, end = found
    assert [piece.offset for piece in pieces] == list(range(0, length, 239))
    assert [a.sequence for a in found] == list(range(2, 2 + len(found)))
    assert [a.complete for a in found] == [0] * (len(pieces) - 1) + [1, 1]
    assert (end.opcode, end.request, end.data, end.offset) == (NAK, BURST, bytes([END]), length)
    content = b"".join(piece.data for piece in pieces)
    assert len(content) == length
    packed = MAVFTP.ftp_param_decode(content)
    assert packed is not None
    values = {name.decode(): value for name, value, _ in packed.params}
    assert list(values) == list(PARAMETER_NAMES)
    for name, value in values.items():
        assert value == pytest.approx(float(copter.m[name]), rel=1e-6), name
    ask(copter, 2, TERMINATE)
    (done,) = answers(copter)
    assert (done.opcode, done.request, done.data) == (ACK, TERMINATE, b"")


def test_pieces_may_be_read_from_anywhere_and_cut_values(copter: Copter) -> None:
    length = opened(copter)
    ask(copter, 1, BURST, size=239)
    whole = b"".join(a.data for a in answers(copter, length / 239 * 0.005 + 0.05) if a.opcode == ACK)
    parts = b""
    sequence = 50
    while len(parts) < length:
        ask(copter, sequence, READ, offset=len(parts), size=37)
        (answer,) = answers(copter)
        assert answer.sequence == sequence + 1
        parts += answer.data
        sequence += 2
    assert parts == whole
    ask(copter, sequence, READ, offset=length, size=10)
    (answer,) = answers(copter)
    assert (answer.opcode, answer.data) == (NAK, bytes([END]))


def test_a_burst_in_the_middle_is_a_gap_filled(copter: Copter) -> None:
    length = opened(copter)
    ask(copter, 7, BURST, offset=478, size=100)
    found = answers(copter, length / 100 * 0.005 + 0.05)
    assert [a.offset for a in found[:3]] == [478, 578, 678]
    assert found[-1].opcode == NAK


def test_values_are_those_of_the_moment(copter: Copter) -> None:
    opened(copter)
    copter.m["RTL_ALT"] = 4321.0
    copter.m["FS_GCS_ENABLE"] = 5
    ask(copter, 1, BURST, size=239)
    content = b"".join(a.data for a in answers(copter, 0.3) if a.opcode == ACK)
    values = {name.decode(): value for name, value, _ in MAVFTP.ftp_param_decode(content).params}
    assert (values["RTL_ALT"], values["FS_GCS_ENABLE"]) == (4321, 5)
    assert len(values) == PARAMETER_COUNT


@pytest.mark.parametrize(
    ("opcode", "data", "error"),
    [
        (OPEN, b"@PARAM/other.pck", NOT_FOUND),
        (OPEN, b"@PARAM/param.pckx", NOT_FOUND),
        (OPEN, b"", NOT_FOUND),
        (READ, b"", INVALID_SESSION),
        (BURST, b"", INVALID_SESSION),
        (LIST, b"@SYS", NOT_FOUND),
        (WRITE, b"x", PROTECTED),
        (REMOVE, NAME, PROTECTED),
        (CRC, b"@PARAM/other.pck", NOT_FOUND),
        (12, NAME, FAILED),
        (16, b"@PARAM", FAILED),
        (99, b"", FAILED),
    ],
)
def test_what_is_refused(copter: Copter, opcode: int, data: bytes, error: int) -> None:
    ask(copter, 3, opcode, data, size=max(len(data), 1))
    (answer,) = answers(copter)
    assert (answer.opcode, answer.request, answer.data, answer.sequence) == (NAK, opcode, bytes([error]), 4)


def test_the_banner_follows_the_opening_of_the_parameters(copter: Copter) -> None:
    copter.answers()
    ask(copter, 0, OPEN, NAME)
    copter.run(0.1)
    assert next(text for kind, _, text in copter.answers() if kind == "TEXT").startswith("ArduCopter V4.7")
    ask(copter, 0, OPEN, b"@PARAM/other.pck")
    copter.run(0.1)
    assert copter.answers() == []


def test_an_unknown_request_is_named(copter: Copter) -> None:
    copter.answers()
    ask(copter, 3, 16, b"@PARAM")
    copter.run(0.1)
    assert ("TEXT", 7, "Unsupported FTP: 16") in copter.answers()


def test_the_checksum_is_that_of_the_content(copter: Copter) -> None:
    """zlib's CRC-32 begins with all bits set and inverts the result; its argument undoes both."""
    length = opened(copter)
    ask(copter, 1, BURST, size=239)
    content = b"".join(a.data for a in answers(copter, length / 239 * 0.005 + 0.05) if a.opcode == ACK)
    assert len(content) == length
    ask(copter, 2, CRC, NAME)
    (answer,) = answers(copter)
    assert answer.opcode == ACK
    assert answer.data == struct.pack("<I", zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF)


def test_another_session_has_nothing_open(copter: Copter) -> None:
    opened(copter)
    ask(copter, 1, READ, size=10, session=8)
    assert answers(copter)[0].data == bytes([INVALID_SESSION])
    ask(copter, 2, RESET)
    assert answers(copter)[0].opcode == ACK
    ask(copter, 3, READ, size=10)
    assert answers(copter)[0].data == bytes([INVALID_SESSION])


def test_directories_are_listed(copter: Copter) -> None:
    length = opened(copter)
    for folder, entries in ((b"/", [b"D@PARAM"]), (b"@PARAM", [b"Fparam.pck\t%d" % length])):
        ask(copter, 1, LIST, folder)
        (answer,) = answers(copter)
        assert answer.data.rstrip(b"\0").split(b"\0") == entries
        ask(copter, 3, LIST, folder, offset=1)
        (answer,) = answers(copter)
        assert (answer.opcode, answer.data) == (NAK, bytes([END]))


def test_answers_are_not_answered(copter: Copter) -> None:
    for opcode in (0, ACK, NAK):
        ask(copter, 1, opcode)
    assert answers(copter) == []

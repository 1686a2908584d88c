"""cosim.packets against pymavlink, struct, base64 and the CRC catalogue; compiled and bounds-checked."""

from __future__ import annotations

import base64
import binascii
import hashlib
import importlib
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as v10
from pymavlink.dialects.v20 import ardupilotmega as v20
from pymavlink.generator.mavcrc import x25crc

from cosim import frames, messages, packets
from cosim.kernel import kernel
from cosim.packets import BAD_CRC, GOOD, INCOMPATIBLE, NOTHING, SIGNED, TRUNCATED, UNKNOWN

MAGIC = (0xFD, 0xFE)
NO_MAGIC = st.binary(max_size=30).map(lambda data: bytes(b for b in data if b not in MAGIC))
KNOWN = sorted(v20.mavlink_map)
RUN = settings(deadline=None, derandomize=True)  # compiling takes its time


def array(data: bytes) -> packets.Bytes:
    return np.frombuffer(data, np.uint8).copy()


def reference(
    message: int, payload: bytes, version: int = 2, *, seq: int = 0, sender: tuple[int, int] = (1, 1), flags: int = 0
) -> bytes:
    """A packet made by the standard's words, with pymavlink's CRC; the payload is taken as it is."""
    if version == 1:
        head = struct.pack("<BBBBBB", 0xFE, len(payload), seq, *sender, message)
    else:
        low, high = message & 0xFFFF, message >> 16
        head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), flags, 0, seq, *sender, low, high)
    extra = v20.mavlink_map[message].crc_extra if message in v20.mavlink_map else 77
    crc = x25crc(bytearray(head[1:] + payload + bytes([extra]))).crc
    return head + payload + struct.pack("<H", crc) + bytes(range(13)) * (flags & 1)


def walk(data: bytes, n: int | None = None) -> list[tuple[int, int, int]]:
    buffer = array(data)
    end = len(data) if n is None else n
    found = []
    p = 0
    while True:
        start, p, status = packets.find(buffer, p, end)
        if status == NOTHING:
            return found
        found.append((start, p, status))
        if status == TRUNCATED:
            return found


def lone(data: bytes) -> int:
    """Status of a buffer that is one packet."""
    (start, stop, status), *rest = walk(data)
    assert (start, stop, rest) == (0, len(data), [])
    return status


# -- the checksum and the dialect -----------------------------------------------------------------------------------


def test_x25_has_the_catalogue_check_value() -> None:
    assert packets.x25(array(b"123456789"), 0, 9) == 0x6F91  # CRC-16/MCRF4XX
    assert packets.x25(array(b"x123456789y"), 1, 10) == 0x6F91
    assert packets.x25(array(b"abc"), 2, 2) == 0xFFFF


@RUN
@given(st.binary(max_size=300))
def test_x25_is_pymavlinks(data: bytes) -> None:
    assert packets.x25(array(data), 0, len(data)) == x25crc(bytearray(data)).crc


def test_definition_of_every_message() -> None:
    assert len(KNOWN) > 250
    for message, description in v20.mavlink_map.items():
        crc_extra, minimum, full, _, _ = packets.definition(message)
        assert (crc_extra, full) == (description.crc_extra, description.unpacker.size), description.msgname
        assert 0 < minimum <= full or (minimum, full) == (0, 0)
    for message, description in v10.mavlink_map.items():
        assert packets.definition(message)[1] == description.unpacker.size, description.msgname


@pytest.mark.parametrize("message", [-1, 3, 12, 255, 400, 65535, 70000, 0xFFFFFF])
def test_definition_of_no_message(message: int) -> None:
    assert message not in v20.mavlink_map
    assert packets.definition(message) == (-1, -1, -1, -1, -1)


@pytest.mark.parametrize("version", [1, 2])
def test_target_of_every_message(version: int) -> None:
    random = np.random.default_rng(1)
    with_target = 0
    for message, description in v20.mavlink_map.items():
        if version == 1 and message > 255:
            continue
        payload = random.integers(1, 256, description.unpacker.size, np.uint8).tobytes()
        length = len(payload) if version == 2 else packets.definition(message)[1]
        data = reference(message, payload[:length], version)
        decoded = v20.MAVLink(None).decode(bytearray(data))
        expected = getattr(decoded, "target_system", 0), getattr(decoded, "target_component", 0)
        assert packets.target(array(data), 0) == expected, description.msgname
        with_target += expected != (0, 0)
    assert with_target > 50


def test_target_fields_that_are_not_on_the_wire_are_zero() -> None:
    command_ack = struct.pack("<HBBiBB", 400, 0, 0, 0, 7, 8)
    assert packets.target(array(reference(77, command_ack)), 0) == (7, 8)
    assert packets.target(array(reference(77, command_ack[:9])), 0) == (7, 0)
    assert packets.target(array(reference(77, command_ack[:8])), 0) == (0, 0)
    assert packets.target(array(reference(77, command_ack[:3], version=1)), 0) == (0, 0)
    assert packets.target(array(reference(0xABCDEF, b"123456789")), 0) == (0, 0)


# -- headers and walking --------------------------------------------------------------------------------------------

SENDER = st.tuples(st.integers(0, 255), st.integers(0, 255))
PAYLOAD = st.binary(min_size=1, max_size=255)
GOOD_PACKET = st.one_of(
    st.builds(reference, st.sampled_from(KNOWN), PAYLOAD, seq=st.integers(0, 255), sender=SENDER),
    st.builds(reference, st.sampled_from([m for m in KNOWN if m < 256]), PAYLOAD, st.just(1), sender=SENDER),
)
SIGNED_PACKET = st.builds(reference, st.sampled_from(KNOWN), PAYLOAD, sender=SENDER, flags=st.just(1))
UNKNOWN_PACKET = st.builds(reference, st.integers(70000, 0xFFFFFF), PAYLOAD, flags=st.integers(0, 1))
INCOMPATIBLE_PACKET = st.builds(reference, st.sampled_from(KNOWN), PAYLOAD, flags=st.integers(2, 255))
BAD_PACKET = st.tuples(GOOD_PACKET, st.integers(1, 255)).map(lambda x: x[0][:-1] + bytes([x[0][-1] ^ x[1]]))
NOISE = st.lists(st.one_of(st.integers(0, 255), st.sampled_from(MAGIC), st.integers(0, 5)), max_size=40).map(bytes)


@RUN
@given(st.sampled_from(KNOWN), PAYLOAD, st.integers(0, 255), SENDER, st.sampled_from([1, 2]), st.integers(0, 5))
def test_header(message: int, payload: bytes, seq: int, sender: tuple[int, int], version: int, start: int) -> None:
    message = message if version == 2 else message & 0x7F
    data = reference(message, payload, version, seq=seq, sender=sender)
    buffer = array(bytes(start) + data)
    assert packets.version(buffer, start) == version
    assert packets.message_id(buffer, start) == message
    assert packets.payload_length(buffer, start) == len(payload)
    assert packets.packet_length(buffer, start) == len(data)
    assert packets.sequence(buffer, start) == seq
    assert (packets.system(buffer, start), packets.component(buffer, start)) == sender
    assert not packets.signed(buffer, start)
    first = packets.payload_start(buffer, start)
    assert buffer[first : first + len(payload)].tobytes() == payload


@RUN
@given(st.lists(st.tuples(NO_MAGIC, st.one_of(GOOD_PACKET, SIGNED_PACKET)), max_size=6), NO_MAGIC)
def test_packets_between_garbage_are_all_found(parts: list[tuple[bytes, bytes]], tail: bytes) -> None:
    data = b"".join(garbage + packet for garbage, packet in parts) + tail
    found = walk(data)
    assert [data[start:stop] for start, stop, _ in found] == [packet for _, packet in parts]
    assert {status for _, _, status in found} <= {GOOD, SIGNED}
    stops = [0, *(stop for _, stop, _ in found)]
    garbage = [start - stop for stop, (start, _, _) in zip(stops, found, strict=False)]
    assert garbage == [len(garbage_) for garbage_, _ in parts]


@pytest.mark.parametrize(
    ("strategy", "status"),
    [
        (GOOD_PACKET, GOOD),
        (SIGNED_PACKET, SIGNED),
        (UNKNOWN_PACKET, UNKNOWN),
        (INCOMPATIBLE_PACKET, INCOMPATIBLE),
        (BAD_PACKET, BAD_CRC),
    ],
)
def test_status(strategy: st.SearchStrategy[bytes], status: int) -> None:
    @RUN
    @given(strategy)
    def check(data: bytes) -> None:
        assert lone(data) == status
        assert packets.signed(array(data), 0) == (data[0] == 0xFD and data[2] & 1 == 1)

    check()


def test_any_damaged_bit_behind_the_length_is_noticed() -> None:
    for version in (1, 2):
        data = reference(30, bytes(range(1, 29)), version, seq=3)
        for bit in range(16, 8 * len(data)):
            damaged = bytearray(data)
            damaged[bit // 8] ^= 1 << bit % 8
            assert walk(bytes(damaged))[0][2] in (BAD_CRC, UNKNOWN, INCOMPATIBLE, TRUNCATED), (version, bit)


def test_a_damaged_signed_packet_is_noticed_and_its_signature_is_not_checked() -> None:
    mav = v20.MAVLink(None, srcSystem=9)
    mav.signing.secret_key = bytes(32)
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = 1
    data = v20.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3).pack(mav)
    assert len(data) == 10 + 9 + 2 + 13
    assert lone(data) == SIGNED
    assert lone(data[:-1] + bytes([data[-1] ^ 1])) == SIGNED
    assert lone(data[:12] + bytes([data[12] ^ 1]) + data[13:]) == BAD_CRC


@RUN
@given(st.one_of(GOOD_PACKET, SIGNED_PACKET, BAD_PACKET, UNKNOWN_PACKET, INCOMPATIBLE_PACKET), NO_MAGIC, st.data())
def test_a_packet_that_is_not_complete_is_truncated(packet: bytes, garbage: bytes, data: st.DataObject) -> None:
    cut = data.draw(st.integers(1, len(packet) - 1))
    assert walk(garbage + packet[:cut]) == [(len(garbage), len(garbage) + cut, TRUNCATED)]
    assert walk(garbage + packet, len(garbage) + cut) == [(len(garbage), len(garbage) + cut, TRUNCATED)]


def test_nothing_to_find() -> None:
    assert packets.find(array(b""), 0, 0) == (0, 0, NOTHING)
    assert packets.find(array(b"\xfd" * 9), 0, 0) == (0, 0, NOTHING)
    assert packets.find(array(b"abc"), 0, 3) == (3, 3, NOTHING)
    assert packets.find(array(b"abc"), 3, 3) == (3, 3, NOTHING)
    assert packets.find(array(b"abc"), 7, 3) == (3, 3, NOTHING)
    assert packets.find(array(b"abc"), 0, 99) == (3, 3, NOTHING)
    assert packets.find(array(b"a\xfd"), 0, 99) == (1, 2, TRUNCATED)


STREAM = st.lists(
    st.one_of(GOOD_PACKET, SIGNED_PACKET, UNKNOWN_PACKET, INCOMPATIBLE_PACKET, BAD_PACKET, NOISE), max_size=8
).map(b"".join)


@settings(RUN, max_examples=300)
@given(STREAM)
def test_any_stream_is_cut_as_pymavlink_cuts_it(data: bytes) -> None:
    mav = v20.MAVLink(None)
    mav.robust_parsing = True
    theirs = []
    at = 0
    for message in mav.parse_buffer(data) or []:
        chunk = bytes(message.get_msgbuf())
        bad = message.get_type() == "BAD_DATA"
        if chunk[0] in MAGIC:
            unknown = message.get_type().startswith("UNKNOWN")
            theirs.append((at, at + len(chunk), "bad" if bad else "unknown" if unknown else "good"))
        at += len(chunk)
    kinds = {GOOD: "good", SIGNED: "good", UNKNOWN: "unknown", BAD_CRC: "bad", INCOMPATIBLE: "bad"}
    ours = walk(data)
    assert [(start, stop, kinds[status]) for start, stop, status in ours if status != TRUNCATED] == theirs
    waiting = bytes(mav.buf[mav.buf_index :])
    assert waiting == b"".join(data[start:stop] for start, stop, status in ours if status == TRUNCATED)


@RUN
@given(STREAM, st.binary(max_size=300), st.integers(0, 400))
def test_bytes_behind_the_end_are_never_looked_at(data: bytes, behind: bytes, n: int) -> None:
    n = min(n, len(data))
    assert walk(data[:n]) == walk(data[:n] + behind, n)


# -- payloads -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [1, 2])
def test_unpack_and_pack_every_message(version: int) -> None:
    random = np.random.default_rng(version)
    payload, buffer = np.zeros(255, np.uint8), np.zeros(700, np.uint8)
    for message in KNOWN:
        if version == 1 and message > 255:
            continue
        _, minimum, full, _, _ = packets.definition(message)
        for zeros in (0, 1, full // 2, full - 1, full):
            content = random.integers(1, 256, full - zeros, np.uint8).tobytes() + bytes(zeros)
            on_wire = content[:minimum] if version == 1 else (content.rstrip(b"\0") or content[:1])
            data = reference(message, on_wire, version, seq=200, sender=(250, 190))
            payload[:] = 0xA5
            assert packets.unpack(array(b"noise" + data), 5, payload) == len(on_wire)
            assert payload.tobytes() == on_wire + bytes(255 - len(on_wire))
            buffer[:] = 0x5A
            n = packets.pack(buffer, 3, array(content + bytes(255 - full)), message, 200, 250, 190, version)
            assert buffer[:n].tobytes() == b"ZZZ" + data, message
            assert (buffer[n:] == 0x5A).all()
            assert lone(data) == GOOD


@pytest.mark.parametrize("number", [0, 1, 255, 256, 257, 511, 65536 + 7, 2**31 - 1])
def test_sequence_numbers_wrap(number: int) -> None:
    buffer, payload = np.zeros(300, np.uint8), np.zeros(255, np.uint8)
    for version in (1, 2):
        n = packets.pack(buffer, 0, payload, 0, number, 1, 1, version)
        assert packets.find(buffer, 0, n) == (0, n, GOOD)
        assert packets.sequence(buffer, 0) == number % 256


def test_pack_appends_until_the_buffer_is_full() -> None:
    payload = array(bytes(range(1, 256)))
    for version, length in ((1, 6 + 28 + 2), (2, 10 + 28 + 2)):
        buffer = np.full(3 * length, 7, np.uint8)
        n = 0
        for k in range(3):
            n = packets.pack(buffer, n, payload, 30, k, 1, 1, version)
            assert n == (k + 1) * length
        full = buffer.copy()
        for room in range(length):
            assert packets.pack(buffer, 3 * length - room, payload, 30, 3, 1, 1, version) == -1
        assert packets.pack(buffer, -1, payload, 30, 4, 1, 1, version) == -1  # behind one that was too much
        assert (buffer == full).all()
        assert [packets.sequence(buffer, start) for start, _, _ in walk(buffer.tobytes())] == [0, 1, 2]


@pytest.mark.parametrize(("message", "version"), [(3, 2), (0xFFFFFF, 2), (-1, 2), (3, 1), (11030, 1), (256, 1)])
def test_pack_refuses_what_has_no_definition_or_no_header(message: int, version: int) -> None:
    buffer = np.full(300, 7, np.uint8)
    assert packets.pack(buffer, 10, np.zeros(255, np.uint8), message, 0, 1, 1, version) == -1
    assert (buffer == 7).all()


INTEGERS = {"u8": "<B", "i8": "<b", "u16": "<H", "i16": "<h", "u32": "<I", "i32": "<i", "u64": "<Q", "i64": "<q"}


@pytest.mark.parametrize("kind", INTEGERS)
def test_integers(kind: str) -> None:
    put, get, form = getattr(packets, f"put_{kind}"), getattr(packets, f"get_{kind}"), INTEGERS[kind]
    size = struct.calcsize(form)

    @RUN
    @given(st.integers(-(2**63), 2**63 - 1), st.integers(0, 4))
    def check(value: int, offset: int) -> None:
        payload = np.full(16, 0x33, np.uint8)
        put(payload, offset, value)
        raw = value.to_bytes(8, "little", signed=True)[:size]
        assert payload.tobytes() == b"3" * offset + raw + b"3" * (16 - offset - size)
        expected = struct.unpack(form, raw)[0]
        if kind == "u64" and expected >= 2**63:
            expected -= 2**64
        assert get(payload, offset) == expected
        assert type(get(payload, offset)) is int

    check()


@pytest.mark.parametrize(("kind", "form"), [("f32", "<f"), ("f64", "<d")])
def test_floats(kind: str, form: str) -> None:
    put, get, width = getattr(packets, f"put_{kind}"), getattr(packets, f"get_{kind}"), 8 * struct.calcsize(form)

    @RUN
    @given(st.floats(width=32 if width == 32 else 64), st.integers(0, 4))
    def check(value: float, offset: int) -> None:
        payload = np.full(16, 0x33, np.uint8)
        put(payload, offset, value)
        raw = struct.pack(form, value)
        stored = payload[offset : offset + width // 8].tobytes()
        read = get(payload, offset)
        if value == value:
            assert stored == raw
            assert read == value and type(read) is float
        else:
            assert np.isnan(struct.unpack(form, stored)[0]) and np.isnan(read)

    check()


@RUN
@given(st.floats(-1e38, 1e38))
def test_f32_rounds_to_nearest(value: float) -> None:
    payload = np.zeros(4, np.uint8)
    packets.put_f32(payload, 0, value)
    assert payload.tobytes() == struct.pack("<f", value)


TEXT = st.binary(max_size=12)


@RUN
@given(TEXT, TEXT, st.integers(0, 10))
def test_text(text: bytes, other: bytes, size: int) -> None:
    payload = np.full(20, 0xEE, np.uint8)
    packets.put_text(payload, 3, size, array(text))
    assert payload.tobytes() == b"\xee" * 3 + text[:size].ljust(size, b"\0") + b"\xee" * (17 - size)
    for candidate in (text, text[:size], other, text + b"\0"):
        same = text[:size].split(b"\0")[0] == candidate.split(b"\0")[0]
        assert packets.equal_text(payload, 3, size, array(candidate)) == same, candidate


def test_clear() -> None:
    payload = np.full(6, 9, np.uint8)
    packets.clear(payload, 2, 4)
    assert payload.tolist() == [9, 9, 0, 0, 9, 9]


# -- base64 ---------------------------------------------------------------------------------------------------------


@RUN
@given(st.binary(max_size=300))
def test_base64_both_ways(data: bytes) -> None:
    expected = base64.b64encode(data)
    text, back = np.full(500, 1, np.uint8), np.full(400, 2, np.uint8)
    n = packets.encode_base64(array(data + b"??"), len(data), text)
    assert text[:n].tobytes() == expected and (text[n:] == 1).all()
    assert packets.decode_base64(text, n, back) == len(data)
    assert back[: len(data)].tobytes() == data and (back[len(data) :] == 2).all()
    exact = np.zeros(len(expected), np.uint8)
    assert packets.encode_base64(array(data), len(data), exact) == len(expected)
    assert packets.decode_base64(exact, len(expected), np.zeros(len(data), np.uint8)) == len(data)


ALMOST_BASE64 = st.one_of(
    st.text("ABab09+/=", max_size=13),
    st.text("ABab09+/= \n-_", max_size=9),
    st.binary(max_size=9).map(lambda data: base64.b64encode(data).decode()),
)


@settings(RUN, max_examples=400)
@given(ALMOST_BASE64)
def test_base64_accepts_what_python_accepts_strictly(text: str) -> None:
    try:
        expected = binascii.a2b_base64(text, strict_mode=True)
    except binascii.Error:
        expected = None
    if len(text) % 4:
        assert expected is None
    back = np.zeros(20, np.uint8)
    n = packets.decode_base64(array(text.encode()), len(text), back)
    assert (None if n < 0 else back[:n].tobytes()) == expected


@pytest.mark.parametrize(
    "text",
    ["A", "AA", "AAA", "AAAAA", "A===", "====", "AA=A", "=AAA", "AA==AAAA", "AAA\n", "AA A", "AA-_", "AAA\0", "AAAÿ"],
)
def test_base64_refuses(text: str) -> None:
    data = text.encode("latin-1")
    assert packets.decode_base64(array(data), len(data), np.zeros(20, np.uint8)) == -1


def test_base64_refuses_what_does_not_fit() -> None:
    text = np.full(8, 1, np.uint8)
    assert packets.encode_base64(array(b"1234567"), 7, text) == -1
    assert (text == 1).all()
    assert packets.decode_base64(array(b"MTIzNA=="), 8, np.zeros(3, np.uint8)) == -1
    assert packets.decode_base64(array(b"MTIzNA=="), 8, np.zeros(4, np.uint8)) == 4
    assert packets.decode_base64(array(b"MTIz"), 8, np.zeros(9, np.uint8)) == -1


# -- the three ways to run ------------------------------------------------------------------------------------------

RECORD = np.dtype(
    [
        *[("rx", "u1", (600,)), ("rx_len", "i4"), ("tx", "u1", (600,)), ("tx_len", "i4")],
        *[("payload", "u1", (255,)), ("text", "u1", (900,)), ("text_len", "i4")],
    ]
)


@kernel
def forward(m: Any, own_system: int) -> int:
    """What models do: read every packet of a record, send those for others on with a new header."""
    m.tx_len = 0
    p = 0
    forwarded = 0
    while True:
        start, p, status = packets.find(m.rx, p, m.rx_len)
        if status in (NOTHING, TRUNCATED):
            return forwarded
        to_system, _ = packets.target(m.rx, start)
        if status == GOOD and to_system != own_system:
            packets.unpack(m.rx, start, m.payload)
            message = packets.message_id(m.rx, start)
            n = packets.pack(m.tx, m.tx_len, m.payload, message, forwarded, own_system, 1, 2)
            if n >= 0:
                m.tx_len = n
                forwarded += 1


def test_kernels_on_the_buffers_of_a_record() -> None:
    for_us = reference(76, bytes(28) + bytes([144, 1, 5, 1, 0]))
    for_other = reference(76, bytes(28) + bytes([144, 1, 6, 1]), 1, seq=9)
    for_all = reference(0, b"\x04\0\0\0\x02\x03Q\x03\x03", seq=80)
    stream = for_us + for_other + b"garbage" + for_all + for_other[:-1] + b"!"
    m = np.zeros(1, RECORD).view(np.recarray)[0]
    m.rx[: len(stream)] = array(stream)
    m.rx_len = len(stream)
    assert forward(m, 5) == 2
    expected = reference(76, bytes(28) + bytes([144, 1, 6, 1]), seq=0, sender=(5, 1))
    expected += reference(0, b"\x04\0\0\0\x02\x03Q\x03\x03", seq=1, sender=(5, 1))
    assert m.tx[: m.tx_len].tobytes() == expected


def digest() -> str:
    """A digest of what the kernels make of much random input."""
    random = np.random.default_rng(20240229)
    payload, back, text = np.zeros(255, np.uint8), np.zeros(900, np.uint8), np.zeros(1200, np.uint8)
    results = hashlib.sha256()
    for k in range(60):
        buffer = random.integers(0, 256, 900, np.uint8)
        buffer[random.integers(0, 900, 12)] = 0xFD - k % 2
        n = 0
        for _ in range(6):
            payload[:] = random.integers(0, 256, 255, np.uint8) * (random.random(255) < 0.6)
            message = KNOWN[int(random.integers(len(KNOWN)))]
            n = packets.pack(buffer, n + int(random.integers(0, 3)), payload, message, k, k, 255 - k, 1 + k % 2)
            n = max(n, 0)
        for start, stop, status in walk(buffer.tobytes()):
            values = [start, stop, status]
            if status != TRUNCATED:
                values += [*packets.target(buffer, start), packets.unpack(buffer, start, payload)]
                results.update(payload.tobytes())
                for kind in ("u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64"):
                    values.append(getattr(packets, f"get_{kind}")(payload, k))
                floats = [packets.get_f32(payload, k), packets.get_f64(payload, k)]
                values += [value if value == value else "nan" for value in floats]
            results.update(repr(values).encode())
        n = packets.encode_base64(buffer, 800 + k, text)
        values = [n, packets.decode_base64(text, n, back), packets.x25(buffer, k, 900)]
        text[k] = 33
        values.append(packets.decode_base64(text, n, back))
        results.update(repr(values).encode() + text.tobytes() + back.tobytes())
    return results.hexdigest()


def in_another_process(tmp_path: Path, **environment: str) -> str:
    """Run this file's tests, with the first 30 examples of each, then digest(), in a process with the variables."""
    script = (
        "import importlib.util, sys, pytest\n"
        "class Fewer:\n"
        "    def pytest_collection(self):\n"
        "        import hypothesis\n"
        "        hypothesis.settings.register_profile('fewer', max_examples=30)\n"
        "        hypothesis.settings.load_profile('fewer')\n"
        "options = ['-q', '-p', 'no:cacheprovider', '-k', 'not process and not ahead']\n"
        "code = pytest.main([sys.argv[1], *options], [Fewer()])\n"
        "spec = importlib.util.spec_from_file_location('again', sys.argv[1])\n"
        "again = importlib.util.module_from_spec(spec); spec.loader.exec_module(again)\n"
        "print('digest', again.digest())\n"
        "sys.exit(code)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, __file__],
        env={**os.environ, **environment, "XDG_CACHE_HOME": str(tmp_path)},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout.split()[-1]


@pytest.mark.slow
def test_no_index_is_out_of_bounds_in_a_process_that_checks(tmp_path: Path) -> None:
    # A cache of its own: numba's does not know that compiled kernels differ by this setting. LLVM need not optimise
    # what checks indices.
    assert in_another_process(tmp_path, NUMBA_BOUNDSCHECK="1", NUMBA_OPT="0") == digest()


def test_every_kernel_is_compiled() -> None:
    numba = pytest.importorskip("numba")
    if numba.config.DISABLE_JIT:
        pytest.skip("NUMBA_DISABLE_JIT is set")
    digest()
    module = importlib.import_module("cosim.packets")
    kernels = [name for name in packets.__all__ if name.islower() and callable(getattr(module, name))]
    assert len(kernels) > 35
    for name in kernels:
        assert hasattr(getattr(module, name), "nopython_signatures"), name


@kernel
def live(m: Any) -> int:
    """One step of a model that uses a bit of everything."""
    n = packets.decode_base64(m.text, m.text_len, m.rx)
    m.rx_len = max(n, 0)
    count = forward(m, 5)
    lat, lon = 0.0, 0.0
    if packets.unpack(m.rx, 0, m.payload) > 0:
        position = messages.decode_global_position_int(m.payload)
        lat, lon = frames.radians_from_deg_e7(position[1]), frames.radians_from_deg_e7(position[2])
    q = frames.quaternion_from_euler(0.1, 0.2, 0.3)
    roll, pitch, yaw = frames.euler_from_quaternion(frames.normalize(frames.multiply(q, q)))
    north, east, down = frames.local_from_geodetic(lat, lon, 1.0, 0.8, 0.1, 2.0)
    place = frames.geodetic_from_local(north, east, down, 0.8, 0.1, 2.0)
    away = frames.haversine(lat, lon, place[0], place[1], frames.EARTH_RADIUS_MEAN)
    east = frames.deg_e7(frames.longitude_at(lat, lon, away, frames.EARTH_RADIUS_MEAN))
    speed = frames.rotate_inverse(q, frames.rotate(q, (1.0, 2.0, 3.0)))
    messages.encode_attitude(m.payload, east, roll, pitch, yaw, speed[0], speed[1], speed[2])
    n = packets.pack(m.tx, m.tx_len, m.payload, messages.ATTITUDE, count, 5, 1, 2)
    messages.encode_statustext(m.payload, 6, 0, 0)
    packets.put_text(m.payload, messages.STATUSTEXT_TEXT, 50, m.text)
    if packets.equal_text(m.payload, messages.STATUSTEXT_TEXT, 50, m.text):
        n = packets.pack(m.tx, n, m.payload, messages.STATUSTEXT, count, 5, 1, 1)
    m.text_len = packets.encode_base64(m.tx, max(n, 0), m.text)
    return count


def test_kernels_compiled_ahead_of_time_need_no_python() -> None:
    """Nothing raises or allocates: once LLVM sees the whole program, no symbol of Python or of numba is left."""
    numba = pytest.importorskip("numba")
    if numba.config.DISABLE_JIT:
        pytest.skip("NUMBA_DISABLE_JIT is set")
    llvm = importlib.import_module("llvmlite.binding")

    @numba.cfunc(numba.types.int64(numba.types.CPointer(numba.from_dtype(RECORD))))
    def entry(p: Any) -> int:
        return live(numba.carray(p, 1)[0])

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(opt=3)
    module = llvm.parse_assembly(str(entry.inspect_llvm()))
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name != entry.native_name:
            symbol.linkage = "internal"
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    builder.getModulePassManager().run(module, builder)
    needed = {f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")}
    assert needed <= {"sin", "cos", "asin", "atan2", "floor", "sqrt"}, needed

"""cosim.messages against pymavlink's own classes, for every message; and against its generator."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as v10
from pymavlink.dialects.v20 import ardupilotmega as v20

from cosim import messages, packets
from cosim.build import messages as generator
from cosim.kernel import PLAIN

PACKAGE = Path(messages.__file__).parent
DIALECT = generator.read_dialect()
CHOSEN = [DIALECT[name] for name in generator.MESSAGES]
# Kernels as plain Python, which take longer, are shown the first of them only, in a process of their own.
EXAMPLES = 8 if PLAIN else 25
# Values at which widths, signs and truncation change.
EDGES = (0, 1, 2, 127, 128, 254, 255, 256, 32767, 32768, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**63 - 1)


def draw(field: generator.Field, random: np.random.Generator) -> Any:
    """A value for one element of `field`: an edge, any bit pattern, or zero."""
    kind = {"float": "f32", "double": "f64", "char": "u8"}.get(field.type, field.type[0] + field.type.strip("uint_"))
    choice = random.random()
    if kind.startswith("f"):
        value = float(random.normal()) * 10.0 ** float(random.integers(-30, 30))
        value = [0.0, -0.0, float("inf"), float("nan"), value, value, value, value][int(choice * 8)]
        return float(np.float32(value)) if kind == "f32" else value
    bits = int(kind[1:])
    raw = EDGES[int(random.integers(len(EDGES)))] if choice < 0.4 else int.from_bytes(random.bytes(8), "little")
    raw = 0 if choice > 0.85 else raw % 2**bits
    return raw - 2**bits if kind.startswith("i") and raw >= 2 ** (bits - 1) else raw


def draw_all(message: generator.Message, random: np.random.Generator) -> dict[str, Any]:
    """Values by field name; lists for arrays, bytes without inner zeros for text."""
    values: dict[str, Any] = {}
    for field in message.fields:
        if field.type == "char" and field.count:
            values[field.name] = random.integers(1, 128, int(random.integers(0, field.count + 1)), np.uint8).tobytes()
        elif field.count:
            values[field.name] = [draw(field, random) for _ in range(field.count)]
        else:
            values[field.name] = draw(field, random)
    return values


def signed64(value: Any) -> Any:
    """How a kernel carries `value`: a uint64 of 2**63 and more is 2**64 lower."""
    return value - 2**64 if isinstance(value, int) and value >= 2**63 else value


def encode(message: generator.Message, values: dict[str, Any], payload: packets.Bytes) -> None:
    name = message.name.lower()
    scalars = [signed64(values[field.name]) for field in message.fields if not field.count]
    assert getattr(messages, f"encode_{name}")(payload, *scalars) == message.full_length
    for field in message.fields:
        if field.count:
            for i, value in enumerate(values[field.name]):
                getattr(messages, f"put_{name}_{field.name}")(payload, i, signed64(value))


def decode(message: generator.Message, payload: packets.Bytes) -> dict[str, Any]:
    name = message.name.lower()
    scalars = [field.name for field in message.fields if not field.count]
    values: dict[str, Any] = {}
    if scalars:
        result = getattr(messages, f"decode_{name}")(payload)
        values = dict(zip(scalars, result if len(scalars) > 1 else (result,), strict=True))
    for field in message.fields:
        if field.count:
            get = getattr(messages, f"get_{name}_{field.name}")
            values[field.name] = [get(payload, i) for i in range(field.count)]
    return values


def same(message: generator.Message, ours: dict[str, Any], theirs: dict[str, Any], *, version: int) -> None:
    for field in message.fields:
        expected = theirs[field.name]
        if field.type == "char" and field.count:
            expected = list(expected.ljust(field.count, b"\0"))
        if version == 1 and field.extension:
            expected = [0] * field.count if field.count else 0
        for mine, its in zip(*([x if isinstance(x, list) else [x] for x in (ours[field.name], expected)]), strict=True):
            its = signed64(its)
            assert mine == its or (mine != mine and its != its), (message.name, field.name, mine, its)


def theirs(message: generator.Message, values: dict[str, Any], version: int, seq: int) -> bytes:
    """The packet that pymavlink makes of the values; its MAVLink 1 dialect has no extension fields."""
    dialect = v10 if version == 1 else v20
    mav = dialect.MAVLink(None, srcSystem=7, srcComponent=190)
    mav.seq = seq
    fields = {f.name: values[f.name] for f in message.fields if version == 2 or not f.extension}
    data = dialect.mavlink_map[message.id](**fields).pack(mav)
    assert isinstance(data, bytes)
    return data


@pytest.mark.parametrize("message", CHOSEN, ids=lambda message: message.name)
def test_both_ways_against_pymavlink(message: generator.Message) -> None:
    payload, buffer = np.zeros(255, np.uint8), np.zeros(600, np.uint8)
    versions = [1, 2] if message.id < 256 else [2]

    @settings(deadline=None, derandomize=True, max_examples=EXAMPLES)
    @given(st.integers(0, 2**32), st.sampled_from(versions), st.integers(0, 255))
    @example(0, versions[0], 255)
    @example(0, 2, 255)
    def check(seed: int, version: int, seq: int) -> None:
        values = draw_all(message, np.random.default_rng(seed))
        expected = theirs(message, values, version, seq)
        payload[:] = 0xA5
        encode(message, values, payload)
        n = packets.pack(buffer, 0, payload, message.id, seq, 7, 190, version)
        ours = buffer[:n].tobytes()
        if not any("nan" in repr(value) for value in values.values()):
            assert ours == expected
        for data in (ours, expected):
            received = np.frombuffer(data, np.uint8).copy()
            assert packets.find(received, 0, len(data)) == (0, len(data), packets.GOOD)
            packets.unpack(received, 0, payload)
            same(message, decode(message, payload), values, version=version)
        parsed = (v10 if version == 1 else v20).MAVLink(None).decode(bytearray(ours))
        assert parsed.get_type() == message.name
        assert (parsed.get_seq(), parsed.get_srcSystem(), parsed.get_srcComponent()) == (seq, 7, 190)

    check()


@pytest.mark.parametrize("message", CHOSEN, ids=lambda message: message.name)
def test_encode_leaves_nothing_of_the_message_before(message: generator.Message) -> None:
    payload = np.full(255, 0xA5, np.uint8)
    scalars = [0.0 if field.type in ("float", "double") else 0 for field in message.fields if not field.count]
    getattr(messages, f"encode_{message.name.lower()}")(payload, *scalars)
    assert not payload[: message.full_length].any()
    assert (payload[message.full_length :] == 0xA5).all()


def test_constants_are_pymavlinks() -> None:
    for message in CHOSEN:
        description = v20.mavlink_map[message.id]
        assert getattr(messages, message.name) == description.id
        assert getattr(messages, f"{message.name}_LENGTH") == description.unpacker.size
        assert description.fieldnames == [field.name for field in message.fields]
        for field in message.fields:
            assert getattr(messages, f"{message.name}_{field.name.upper()}") == field.offset
    for name in generator.ENUMS:
        entries = [entry.name for entry in v20.enums[name].values() if not entry.name.endswith("_ENUM_END")]
        assert entries
        for entry in entries:
            assert getattr(messages, entry) == getattr(v20, entry), entry


def test_the_list_in_use_is_there() -> None:
    ids = {0: 50, 1: 124, 11: 89, 24: 24, 30: 39, 32: 185, 33: 104, 66: 148, 73: 38, 75: 158, 76: 152, 77: 143, 84: 143}
    ids |= {86: 5, 148: 178, 193: 71, 242: 104, 244: 95, 245: 130, 253: 83}  # published id -> CRC_EXTRA
    chosen = {message.id: message.crc_extra for message in CHOSEN}
    assert {message: chosen.get(message) for message in ids} == ids
    assert len({message.id for message in CHOSEN}) == len(generator.MESSAGES)


def test_the_committed_files_are_what_the_generator_writes() -> None:
    for file, source in (("dialect.py", generator.dialect_source()), ("messages.py", generator.messages_source())):
        assert (PACKAGE / file).read_text(encoding="utf-8") == source, "run python -m cosim.build.messages"


def test_generated_files_are_formatted() -> None:
    files = [str(PACKAGE / name) for name in ("dialect.py", "messages.py")]
    for command in (["format", "--diff"], ["check", "--select", "E,F,W,I"]):
        done = subprocess.run([sys.executable, "-m", "ruff", *command, *files], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


def test_an_unknown_message_or_enumeration_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generator, "MESSAGES", ("HEARTBEAT", "NO_SUCH"))
    monkeypatch.setattr(generator, "ENUMS", ("NO_ENUM",))
    with pytest.raises(ValueError, match="not in ardupilotmega: NO_SUCH, NO_ENUM"):
        generator.messages_source()


def test_constants_with_one_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generator, "MESSAGES", ("HEARTBEAT", "HEARTBEAT"))
    with pytest.raises(ValueError, match="constants defined twice: HEARTBEAT, HEARTBEAT_AUTOPILOT"):
        generator.messages_source()


def test_definitions_that_disagree_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generator, "_base_fields", lambda path: {"SENSOR_OFFSETS": ["other"]})
    with pytest.raises(ValueError, match=r"ardupilotmega: HEARTBEAT has fields .*'autopilot'.* but base fields None"):
        generator.read_dialect.__wrapped__()  # what it read before is kept


def digest() -> str:
    """A digest of the bytes and values of every message with much random content."""
    random = np.random.default_rng(7)
    payload, results = np.zeros(255, np.uint8), hashlib.sha256()
    for message in CHOSEN:
        for _ in range(6):
            values = draw_all(message, random)
            encode(message, values, payload)
            results.update(repr(decode(message, payload)).encode())
            results.update(payload[: message.full_length].tobytes())
    return results.hexdigest()


def test_every_kernel_is_compiled() -> None:
    numba = pytest.importorskip("numba")
    if numba.config.DISABLE_JIT:
        pytest.skip("NUMBA_DISABLE_JIT is set")
    digest()
    for message in CHOSEN:
        name = message.name.lower()
        arrays = [f.name for f in message.fields if f.count]
        access = [f"{kind}_{name}_{field}" for field in arrays for kind in ("put", "get")]
        decodes = [f"decode_{name}"] if len(arrays) < len(message.fields) else []  # there are scalar fields
        for kernel in [f"encode_{name}", *decodes, *access]:
            compiled = getattr(messages, kernel).nopython_signatures
            assert compiled, kernel

"""Dialects of one's own: XML read as pymavlink's generator reads it, errors, modules whose packets pymavlink reads."""

from __future__ import annotations

import importlib.util
import io
import struct
import sys
import tokenize
from collections.abc import Iterator
from keyword import iskeyword
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.generator import mavgen, mavparse

from cosim.build.dialects import _read, module_source, read_xml
from cosim.build.messages import Message, read_dialect
from cosim.packets import UNKNOWN, find, unpack

XML = """<?xml version="1.0"?>
<mavlink>
  <include>common.xml</include>
  <messages>
    <message id="42101" name="SWARM_BID">
      <description>A bid for a task.</description>
      <field type="uint8_t" name="target_system">whom it is for</field>
      <field type="uint8_t" name="target_component">which part of it</field>
      <field type="float" name="price" units="s">how long it would take</field>
      <field type="uint16_t[3]" name="tasks">numbers of tasks</field>
      <field type="uint32_t" name="time_boot_ms" units="ms">when</field>
      <field type="char[8]" name="label">text</field>
      <extensions/>
      <field type="double" name="certainty">added later</field>
    </message>
    <message id="42100" name="SWARM_HELLO">
      <field type="uint8_t_mavlink_version" name="version">of the swarm's protocol</field>
    </message>
  </messages>
</mavlink>
"""


@pytest.fixture
def xml(tmp_path: Path) -> Path:
    (tmp_path / "swarm.xml").write_text(XML)
    return tmp_path / "swarm.xml"


def test_the_whole_built_in_dialect_reads_as_pymavlink_has_it() -> None:
    path = Path(str(ardupilotmega.__file__)).with_suffix(".xml")
    found: dict[str, Message] = {}
    problems: list[str] = []
    _read(path, found, set(), set(), problems)
    known = read_dialect()
    assert {name: m for name, m in found.items() if name in known} == known
    assert not problems
    assert read_xml(path) == {name: m for name, m in found.items() if name not in known}


def test_messages_of_a_file(xml: Path) -> None:
    hello, bid = read_xml(xml).values()
    assert (hello.name, hello.id, hello.full_length) == ("SWARM_HELLO", 42100, 1)
    assert (bid.name, bid.id, bid.full_length) == ("SWARM_BID", 42101, 32)
    assert [(f.name, f.offset, f.count, f.extension) for f in bid.fields] == [
        ("target_system", 14, 0, False),
        ("target_component", 15, 0, False),
        ("price", 0, 0, False),
        ("tasks", 8, 3, False),
        ("time_boot_ms", 4, 0, False),
        ("label", 16, 8, False),
        ("certainty", 24, 0, True),
    ]
    parsed = mavparse.MAVXML(str(xml), "2.0")
    assert {m.name: m.crc_extra for m in parsed.message} == {"SWARM_HELLO": hello.crc_extra, "SWARM_BID": bid.crc_extra}


def test_a_file_may_include_another(xml: Path, tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text(
        '<mavlink><include>swarm.xml</include><messages><message id="53000" name="MORE">'
        '<field type="float" name="x"/></message></messages></mavlink>'
    )
    assert list(read_xml(tmp_path / "more.xml")) == ["SWARM_HELLO", "SWARM_BID", "MORE"]


FIELD = '<field type="float" name="x"/>'


@pytest.mark.parametrize(
    "content, expected",
    [
        ("<mavlink>", "no element found"),
        ("<swarm/>", "the root of a dialect is <mavlink>, not <swarm>"),
        (
            "<mavlink><include>other.xml</include></mavlink>",
            "includes other.xml, which does not exist and is not built in",
        ),
        (f'<message id="0" name="X">{FIELD}</message>', "X has id 0, which is HEARTBEAT's"),
        (f'<message id="60000" name="HEARTBEAT">{FIELD}</message>', "HEARTBEAT is in ardupilotmega, with id 0"),
        (
            f'<message id="60000" name="X">{FIELD}</message><message id="60000" name="Y">{FIELD}</message>',
            "Y has id 60000",
        ),
        (
            f'<message id="60000" name="X">{FIELD}</message><message id="60001" name="X">{FIELD}</message>',
            "a second message X",
        ),
        (
            f'<message id="16777216" name="X">{FIELD}</message>',
            'message name="X" id="16777216": a name and an id from 0',
        ),
        (
            f'<message id="60000" name="not a name">{FIELD}</message>',
            'message name="not a name" id="60000": a name and',
        ),
        ('<message id="60000" name="X"><field type="int" name="x"/></message>', 'X has a field name="x" type="int"'),
        ('<message id="60000" name="X"><field type="float" name="lambda"/></message>', 'X has a field name="lambda"'),
        ('<message id="60000" name="None"><field type="float" name="x"/></message>', 'message name="None" id="60000"'),
        (
            '<message id="60000" name="X"><field type="float" name="x" units="ms]&#10;import os"/></message>',
            "X.x has units='ms]\\nimport os': printable text is valid",
        ),
        ('<message id="60000" name="X"></message>', "X has 0 fields of 0 bytes: 1 to 255, of different names"),
        ('<message id="60000" name="X"><field type="double[32]" name="x"/></message>', "X has 1 fields of 256 bytes"),
        (f'<message id="60000" name="X">{FIELD}{FIELD}</message>', "X has 2 fields of 8 bytes: 1 to 255, of different"),
    ],
)
def test_what_a_dialect_may_not_be(content: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    if content.startswith("<message "):
        content = f"<mavlink><messages>{content}</messages></mavlink>"
    path.write_text(content)
    with pytest.raises(ValueError) as caught:
        read_xml(path)
    assert expected in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.fixture
def modules(xml: Path, tmp_path: Path) -> Iterator[tuple[ModuleType, Any]]:
    """Ours and pymavlink's, generated from the same file."""
    (tmp_path / "swarm_messages.py").write_text(module_source(read_xml(xml), "swarm.xml"))
    alone = tmp_path / "alone" / "swarm.xml"
    alone.parent.mkdir()
    alone.write_text(XML.replace("<include>common.xml</include>", ""))
    options = mavgen.Opts(str(tmp_path / "oracle"), wire_protocol="2.0", language="Python3", validate=False)
    assert mavgen.mavgen(options, [str(alone)])
    loaded = []
    for name in ("swarm_messages", "oracle"):
        spec = importlib.util.spec_from_file_location(name, tmp_path / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
        loaded.append(module)
    yield loaded[0], loaded[1]
    for name in ("swarm_messages", "oracle"):
        del sys.modules[name]


def test_packets_of_a_generated_module_are_those_of_pymavlink(modules: tuple[ModuleType, Any]) -> None:
    ours: Any
    ours, oracle = modules
    payload, buffer = np.zeros(255, np.uint8), np.zeros(300, np.uint8)
    assert ours.encode_swarm_bid(payload, 7, 1, 1.5, 123456, 0.25) == ours.SWARM_BID_LENGTH == 32
    for i, task in enumerate((5, 600, 7)):
        ours.put_swarm_bid_tasks(payload, i, task)
    for i, character in enumerate(b"hello"):
        ours.put_swarm_bid_label(payload, i, character)
    n = ours.pack_swarm_bid(buffer, 0, payload, 9, 3, 191)
    packet = buffer[:n].tobytes()
    link = oracle.MAVLink(None, srcSystem=3, srcComponent=191)
    link.seq = 9
    message = oracle.MAVLink_swarm_bid_message(7, 1, 1.5, [5, 600, 7], 123456, b"hello", 0.25)
    assert packet == bytes(message.pack(link))
    assert link.parse_buffer(packet)[0].to_dict()["tasks"] == [5, 600, 7]
    assert find(buffer, 0, n) == (0, n, UNKNOWN)
    assert ours.is_swarm_bid(buffer, 0)
    assert not ours.is_swarm_hello(buffer, 0)
    unpack(buffer, 0, payload)
    assert ours.decode_swarm_bid(payload) == (7, 1, 1.5, 123456, 0.25)
    buffer[12] ^= 1
    assert not ours.is_swarm_bid(buffer, 0)
    assert ours.pack_swarm_bid(buffer[:20], 0, payload, 9, 3, 191) == -1


def dialect(path: Path, **messages: list[str]) -> Path:
    """Writes messages with these fields, all uint16_t."""
    written = [
        f'<message id="{43000 + i}" name="{name}">'
        + "".join(f'<field type="uint16_t" name="{field}"/>' for field in fields)
        + "</message>"
        for i, (name, fields) in enumerate(messages.items())
    ]
    path.write_text(f"<mavlink><messages>{''.join(written)}</messages></mavlink>")
    return path


def test_fields_may_have_every_name_that_a_generated_module_uses(xml: Path, tmp_path: Path) -> None:
    module = module_source(read_xml(xml), "swarm.xml")
    tokens = tokenize.generate_tokens(io.StringIO(module).readline)
    names = {token.string for token in tokens if token.type == tokenize.NAME and not iskeyword(token.string)}
    names = {name for name in names if not name.upper().startswith(("SWARM_", "ENCODE_", "DECODE_"))}
    names |= {"length", "zero_", "zero__", "put_f64", "USED", "USED_LENGTH", "_USED_LENGTH", "USED_ZERO"}
    assert names > {"payload", "zero", "np", "clear", "put_u8", "int", "kernel", "Bytes", "i", "value", "system"}
    messages = {f"USED{i or ''}": sorted(names)[i::2] for i in range(2)}  # a message has 255 bytes at most
    path = tmp_path / "used_names.py"
    path.write_text(module_source(read_xml(dialect(tmp_path / "used.xml", **messages)), "used.xml"))
    spec = importlib.util.spec_from_file_location("used_names", path)
    assert spec is not None and spec.loader is not None
    used: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(used)
    for message, fields in messages.items():
        payload, lower = np.zeros(255, np.uint8), message.lower()
        values = range(300, 300 + len(fields))
        encode, decode = (getattr(used, f"{how}_{lower}").py_func for how in ("encode", "decode"))
        assert encode(payload, *values) == getattr(used, f"{message}_LENGTH") == 2 * len(fields)
        assert payload.tobytes() == struct.pack(f"<{len(fields)}H", *values).ljust(255, b"\0")
        assert decode(payload) == tuple(values)
        assert getattr(used, f"encode_{lower}")(payload, *values[::-1]) == 2 * len(fields)
        assert getattr(used, f"decode_{lower}")(payload) == tuple(values[::-1])


@pytest.mark.parametrize(
    ("messages", "twice"),
    [
        ({"X": ["y"], "X_Y": ["z"]}, "X_Y is the name of two things"),
        ({"X": ["y", "Y"]}, "X_Y is the name"),
        ({"np": ["y"]}, "np is the name"),
        ({"put_u16": ["y"]}, "put_u16 is the name"),
        ({"int": ["y"]}, "int is the name"),
        ({"payload": ["y"]}, "payload is the name"),
        ({"X": ["y"], "x": ["y"]}, "decode_x, encode_x, is_x, pack_x are names of two things"),
    ],
)
def test_two_names_of_a_generated_module_that_are_the_same(
    messages: dict[str, list[str]], twice: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError) as caught:
        module_source(read_xml(dialect(tmp_path / "twice.xml", **messages)), "twice.xml")
    assert str(caught.value).startswith(f"twice.xml: {twice}")
    assert str(caught.value).endswith(" in the module; rename a message or field")

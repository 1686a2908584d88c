"""Custom MAVLink dialects: reads messages from an XML file for routers, and generates a Python module for models.

An XML file may include others. Included files that are part of the built-in ardupilotmega dialect need not exist.
Enumerations are ignored. Source: the MAVLink guide, "Define XML Elements" and "Packet Serialization" (order, CRC).
"""

from __future__ import annotations

import ast
import builtins
import re
from collections import Counter
from collections.abc import Mapping
from keyword import iskeyword
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from cosim.build.messages import Field, Message, message_lines, module_head, read_dialect, type_size
from cosim.packets import x25

__all__ = ["module_source", "read_xml"]

_FIELD_TYPE = re.compile(r"(?P<type>\w+?)(?:_mavlink_version)?(?:\[(?P<count>\d+)\])?")
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_LONGEST = 255


def read_xml(path: Path) -> dict[str, Message]:
    """Returns the messages of an XML file and its includes that ardupilotmega does not contain, by name and by id.

    Raises:
        ValueError: the file is not a valid dialect; one line per error, with file and message.
        OSError: a file cannot be read.
    """
    problems: list[str] = []
    found: dict[str, Message] = {}
    known = read_dialect()
    _read(path, found, set(), set(known), problems)
    taken = {message.id: message for message in known.values()}
    new: dict[str, Message] = {}
    for message in sorted(found.values(), key=lambda one: one.id):
        other = taken.get(message.id)
        if message.name in known and message == known[message.name]:
            continue
        if other is not None:
            problems.append(f"{path}: {message.name} has id {message.id}, which is {other.name}'s")
        elif message.name in known:
            problems.append(f"{path}: {message.name} is in ardupilotmega, with id {known[message.name].id}")
        taken[message.id] = message
        new[message.name] = message
    if problems:
        raise ValueError("\n".join(problems))
    return new


def _read(path: Path, found: dict[str, Message], done: set[Path], known: set[str], problems: list[str]) -> None:
    if path.resolve() in done:
        return
    done.add(path.resolve())
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        problems.append(f"{path}: {error}")
        return
    if root.tag != "mavlink":
        problems.append(f"{path}: the root of a dialect is <mavlink>, not <{root.tag}>")
        return
    for include in root.findall("include"):
        other = path.parent / str(include.text).strip()
        if other.is_file():
            _read(other, found, done, known, problems)
        elif other.name not in _BUILT_IN:
            problems.append(f"{path}: includes {other.name}, which does not exist and is not built in")
    for element in root.iterfind("messages/message"):
        message = _message(element, path, problems)
        if message is not None and message.name in found:
            problems.append(f"{path}: a second message {message.name}")
        elif message is not None:
            found[message.name] = message


_BUILT_IN = frozenset(
    f"{name}.xml"
    for name in (
        "ardupilotmega",
        "common",
        "standard",
        "minimal",
        "uAvionix",
        "icarous",
        "loweheiser",
        "cubepilot",
        "csAirLink",
    )
)
"""Files that make up ardupilotmega.xml."""


def _message(element: ElementTree.Element, path: Path, problems: list[str]) -> Message | None:
    name, number = element.get("name", ""), element.get("id", "")
    if _NAME.fullmatch(name) is None or iskeyword(name) or not number.isdigit() or not 0 <= int(number) < 2**24:
        text = f'{path}: message name="{name}" id="{number}": a name and an id from 0 to 16777215 are valid'
        problems.append(text)
        return None
    declared: list[tuple[str, str, int, str, bool]] = []
    extension = False
    for child in element:
        if child.tag == "extensions":
            extension = True
        elif child.tag == "field":
            kind = _FIELD_TYPE.fullmatch(child.get("type", ""))
            size = type_size(kind["type"]) if kind is not None else 0
            label = child.get("name", "")
            if kind is None or size == 0 or _NAME.fullmatch(label) is None or iskeyword(label):
                problems.append(f'{path}: {name} has a field name="{label}" type="{child.get("type", "")}"')
                continue
            if not child.get("units", "").isprintable():  # a line break would end the comment that they become
                problems.append(f"{path}: {name}.{label} has units={child.get('units')!r}: printable text is valid")
                continue
            declared.append((label, kind["type"], int(kind["count"] or 0), child.get("units", ""), extension))
    fields = _placed(declared)
    length = sum(field.size for field in fields)
    if not fields or length > _LONGEST or len({field.name for field in fields}) < len(fields):
        problems.append(
            f"{path}: {name} has {len(fields)} fields of {length} bytes: 1 to {_LONGEST}, of different names"
        )
        return None
    return Message(name=name, id=int(number), crc_extra=_crc_extra(name, fields), fields=fields)


def _placed(declared: list[tuple[str, str, int, str, bool]]) -> tuple[Field, ...]:
    """Returns fields in declared order with wire offsets: longest types first on the wire, extensions last."""
    wire = sorted((one for one in declared if not one[4]), key=lambda one: -type_size(one[1]))
    wire += [one for one in declared if one[4]]
    offsets: dict[int, int] = {}
    at = 0
    for one in wire:
        offsets[id(one)] = at
        at += type_size(one[1]) * max(one[2], 1)
    return tuple(
        Field(name=name, type=kind, count=count, offset=offsets[id(one)], unit=unit, extension=extension)
        for one in declared
        for name, kind, count, unit, extension in [one]
    )


def _crc_extra(name: str, fields: tuple[Field, ...]) -> int:
    """Returns CRC_EXTRA: a checksum byte over the names, types and order of a message's base fields."""
    text = f"{name} ".encode()
    for field in sorted((f for f in fields if not f.extension), key=lambda f: f.offset):
        text += f"{field.type} {field.name} ".encode()
        if field.count:
            text += bytes([field.count])
    crc = int(x25(np.frombuffer(text, np.uint8), 0, len(text)))
    return (crc & 0xFF) ^ (crc >> 8)


def module_source(messages: Mapping[str, Message], origin: str) -> str:
    """Returns the source of a module with kernels for messages, as in `cosim.messages`, and for their packets.

    Args:
        messages: the result of `read_xml`.
        origin: name of the XML file, for the module's docstring.

    Raises:
        ValueError: two names of the module are the same, or one is used by its kernels.
    """
    body = "\n".join(
        line for message in messages.values() for line in (*message_lines(message), *_packet_lines(message))
    )
    module = module_head(
        (
            f'"""Messages of {origin} as kernels over payloads, as in `cosim.messages`. Generated: do not edit.',
            "",
            "`is_x(buffer, start)` says whether the packet at `start` is a message X with the right CRC, where",
            "`cosim.packets.find` says UNKNOWN. `pack_x(buffer, n, payload, sequence, system, component)` appends one",
            "in MAVLink 2, as `cosim.packets.pack` does, and returns the bytes in use or -1.",
            '"""',
        ),
        body,
        ("has_crc", "message_id", "pack_defined"),
    )
    _require_different_names(module, origin)
    return module


_USED_TO_PACK = frozenset(("buffer", "start", "n", "payload", "sequence", "system", "component", "definition"))
"""Arguments and variables of the kernels that handle packets: they would hide a message of the name."""


def _require_different_names(module: str, origin: str) -> None:
    names = [*_USED_TO_PACK, *dir(builtins)]
    for node in ast.parse(module).body:
        if isinstance(node, ast.ImportFrom | ast.Import):
            names += [alias.asname or alias.name for alias in node.names]
        elif isinstance(node, ast.FunctionDef):
            names.append(node.name)
        elif isinstance(node, ast.Assign):
            names.append(ast.unparse(node.targets[0]))
    if twice := sorted(name for name, number in Counter(names).items() if number > 1):
        text = "is the name of two things in the module" if len(twice) == 1 else "are names of two things in the module"
        raise ValueError(f"{origin}: {', '.join(twice)} {text}; rename a message or field")


def _packet_lines(message: Message) -> list[str]:
    lower = message.name.lower()
    base = sum(field.size for field in message.fields if not field.extension)
    return [
        "",
        "",
        "@kernel",
        f"def is_{lower}(buffer: Bytes, start: int) -> bool:",
        f'    """Whether the complete packet at `start` is a {message.name} with the right CRC."""',
        f"    return message_id(buffer, start) == {message.name} and has_crc(buffer, start, {message.crc_extra})",
        "",
        "",
        "@kernel",
        f"def pack_{lower}(buffer: Bytes, n: int, payload: Bytes, sequence: int, system: int, component: int) -> int:",
        f'    """Append a {message.name} to buffer[:n]; -1 if it does not fit."""',
        f"    definition = ({message.name}, {message.crc_extra}, {base}, {message.full_length})",
        "    return pack_defined(buffer, n, payload, *definition, sequence, system, component, 2)",
    ]

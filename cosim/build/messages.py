"""Generator of `cosim/dialect.py` and `cosim/messages.py` from pymavlink's ardupilotmega dialect.

Run `python -m cosim.build.messages` after changing this file or pymavlink's version, and commit the result; a test
compares both files with the generator's output. pymavlink is needed only for generation: its Python classes give types,
order and CRC_EXTRA, and the XML files give the position of the extension fields.
"""

from __future__ import annotations

import builtins
import importlib
import keyword
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

__all__ = [
    "DIALECT",
    "ENUMS",
    "MESSAGES",
    "Field",
    "Message",
    "dialect_source",
    "message_lines",
    "messages_source",
    "module_head",
    "read_dialect",
    "type_size",
]

DIALECT = "ardupilotmega"

MESSAGES = (
    # state of a vehicle and its autopilot
    *("HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME", "EXTENDED_SYS_STATE", "AUTOPILOT_VERSION", "POWER_STATUS"),
    *("BATTERY_STATUS", "MEMINFO", "EKF_STATUS_REPORT", "VIBRATION", "STATUSTEXT", "RADIO_STATUS", "FENCE_STATUS"),
    *("GPS_RAW_INT", "GPS_GLOBAL_ORIGIN", "SET_GPS_GLOBAL_ORIGIN", "HOME_POSITION", "SET_HOME_POSITION", "WIND"),
    *("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "VFR_HUD"),
    *("NAV_CONTROLLER_OUTPUT", "SIMSTATE", "SIM_STATE", "AHRS", "AHRS2", "HIGH_LATENCY2", "TERRAIN_REPORT"),
    *("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU", "SCALED_PRESSURE", "SCALED_PRESSURE2"),
    *("DISTANCE_SENSOR", "TERRAIN_CHECK", "HWSTATUS", "FLIGHT_INFORMATION", "RELAY_STATUS", "ESC_TELEMETRY_1_TO_4"),
    *("AUTOPILOT_STATE_FOR_GIMBAL_DEVICE", "LOG_REQUEST_LIST", "LOG_ENTRY", "LOG_REQUEST_DATA", "LOG_DATA"),
    *("LOG_ERASE", "LOG_REQUEST_END", "RANGEFINDER"),
    *("SERVO_OUTPUT_RAW", "RC_CHANNELS", "RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"),
    # commands, targets and their answers
    *("COMMAND_LONG", "COMMAND_INT", "COMMAND_ACK", "SET_MODE", "PING", "TIMESYNC"),
    *("REQUEST_DATA_STREAM", "MESSAGE_INTERVAL", "SET_ATTITUDE_TARGET", "ATTITUDE_TARGET"),
    *("SET_POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_LOCAL_NED"),
    *("SET_POSITION_TARGET_GLOBAL_INT", "POSITION_TARGET_GLOBAL_INT", "FOLLOW_TARGET", "ADSB_VEHICLE"),
    # parameters and missions
    *("PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_VALUE", "PARAM_SET", "FILE_TRANSFER_PROTOCOL"),
    *("MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_SET_CURRENT"),
    *("MISSION_CURRENT", "MISSION_REQUEST_LIST", "MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_ITEM_REACHED"),
    *("MISSION_ACK", "MISSION_REQUEST_PARTIAL_LIST", "MISSION_WRITE_PARTIAL_LIST"),
    *("FENCE_FETCH_POINT", "RALLY_FETCH_POINT"),
    # payloads defined by users
    *("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT", "DEBUG_VECT", "DEBUG", "V2_EXTENSION", "TUNNEL"),
)
"""Messages exchanged by autopilots, agents and ground stations; these get encode and decode kernels."""

ENUMS = (
    *("MAV_TYPE", "MAV_AUTOPILOT", "MAV_COMPONENT", "MAV_STATE", "MAV_MODE_FLAG", "MAV_LANDED_STATE", "MAV_SEVERITY"),
    *("COPTER_MODE", "ROVER_MODE", "PLANE_MODE", "MAV_CMD", "MAV_RESULT", "MAV_FRAME", "MAV_DATA_STREAM"),
    *("MAV_SYS_STATUS_SENSOR", "MAV_PROTOCOL_CAPABILITY", "EKF_STATUS_FLAGS", "GPS_FIX_TYPE"),
    *("POSITION_TARGET_TYPEMASK", "ATTITUDE_TARGET_TYPEMASK", "MAV_PARAM_TYPE", "MAV_MISSION_RESULT"),
    *("MAV_MISSION_TYPE", "MAV_DO_REPOSITION_FLAGS"),
)
"""Enumerations whose entries become integer constants."""

_WIDTH = 120
# numba recompiles a kernel for every literal argument, here every offset: 20 times the compile time.
_NOT_LITERAL = "    zero = int(np.int64(0))"
# MAVLink type -> (suffix of the readers and writers, bytes, Python type)
_TYPES = {
    "char": ("u8", 1, "int"),
    "uint8_t": ("u8", 1, "int"),
    "uint16_t": ("u16", 2, "int"),
    "uint32_t": ("u32", 4, "int"),
    "uint64_t": ("u64", 8, "int"),
    "int8_t": ("i8", 1, "int"),
    "int16_t": ("i16", 2, "int"),
    "int32_t": ("i32", 4, "int"),
    "int64_t": ("i64", 8, "int"),
    "float": ("f32", 4, "float"),
    "double": ("f64", 8, "float"),
}
_KINDS = ("f32", "f64", "i8", "i16", "i32", "i64", "u8", "u16", "u32", "u64")
_USED_TO_ENCODE = frozenset({"payload", "zero", "np", "clear", *(f"put_{kind}" for kind in _KINDS)})
"""Names in an encode kernel, besides builtins and the constants of its message."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message.

    Attributes:
        name: MAVLink's name.
        type: MAVLink's type of one element.
        count: number of elements of an array, 0 for a scalar.
        offset: offset of its first byte in the payload.
        unit: MAVLink's unit, "" if none.
        extension: whether MAVLink 1 omits it.
    """

    name: str
    type: str
    count: int
    offset: int
    unit: str
    extension: bool

    @property
    def size(self) -> int:
        """Size in bytes in the payload."""
        return _TYPES[self.type][1] * max(self.count, 1)


@dataclass(frozen=True, slots=True)
class Message:
    """One message of the dialect, its fields in declared order (extensions last)."""

    name: str
    id: int
    crc_extra: int
    fields: tuple[Field, ...]

    @property
    def full_length(self) -> int:
        """Payload length in bytes with extensions."""
        return sum(field.size for field in self.fields)

    @property
    def minimum_length(self) -> int:
        """Payload length in bytes without extensions, the length in MAVLink 1."""
        return sum(field.size for field in self.fields if not field.extension)

    def argument(self, field: Field) -> str:
        """Returns the name of a field as an argument of the encode kernel: with a "_" if that uses the name itself."""
        if field.name.lstrip("_").startswith(f"{self.name}_"):
            return f"_{field.name}"  # constants of the message begin so
        stem = field.name.rstrip("_")  # of `zero_` too, which would otherwise become the argument of `zero`
        own = stem in _USED_TO_ENCODE or keyword.iskeyword(stem) or hasattr(builtins, stem)
        return f"{field.name}_" if own else field.name

    def constant(self, field: Field) -> str:
        """Returns the name of the constant that is the offset of a field; X_LENGTH is the length of the message."""
        own = "_" if field.name.upper().rstrip("_") == "LENGTH" else ""
        return f"{self.name}_{field.name.upper()}{own}"

    def offset(self, name: str) -> int:
        """Returns the offset of the field `name`, or -1 if the message lacks it."""
        return next((field.offset for field in self.fields if field.name == name), -1)


@cache
def read_dialect() -> dict[str, Message]:
    """Returns all messages of pymavlink's ardupilotmega dialect by name, ordered by id.

    Raises:
        ValueError: pymavlink's classes and the XML shipped with them disagree.
    """
    module = importlib.import_module(f"pymavlink.dialects.v20.{DIALECT}")
    base_counts = _base_fields(Path(str(module.__file__)).with_suffix(".xml"))
    classes = sorted(module.mavlink_map.values(), key=lambda description: int(description.id))
    return {str(description.msgname): _read_message(description, base_counts) for description in classes}


def _base_fields(path: Path) -> dict[str, list[str]]:
    """Returns the names of the non-extension fields of every message in the XML file and its includes."""
    root = ElementTree.parse(path).getroot()
    found: dict[str, list[str]] = {}
    for include in root.findall("include"):
        found |= _base_fields(path.parent / str(include.text).strip())
    for message in root.iterfind("messages/message"):
        names = []
        for child in message:
            if child.tag == "extensions":
                break
            if child.tag == "field":
                names.append(child.attrib["name"])
        found[message.attrib["name"]] = names
    return found


def _read_message(description: Any, base_fields: dict[str, list[str]]) -> Message:
    name = str(description.msgname)
    base = base_fields.get(name)
    if base is None or base != description.fieldnames[: len(base)]:
        raise ValueError(f"{DIALECT}: {name} has fields {description.fieldnames} but base fields {base} in the XML")
    # Lengths and array lengths are in wire order, names and types in declared order; `orders` maps between them.
    offsets: dict[str, tuple[int, int]] = {}
    at = 0
    for position, wire_name in enumerate(description.ordered_fieldnames):
        index = description.fieldnames.index(wire_name)
        count = int(description.array_lengths[position])
        offsets[wire_name] = (at, count)
        at += _TYPES[description.fieldtypes[index]][1] * max(count, 1)
    if at != description.unpacker.size:
        raise ValueError(f"{DIALECT}: {name} has fields of {at} bytes in all, not {description.unpacker.size}")
    fields = tuple(
        Field(
            name=field,
            type=type_,
            count=offsets[field][1],
            offset=offsets[field][0],
            unit=description.fieldunits_by_name.get(field, ""),
            extension=index >= len(base),
        )
        for index, (field, type_) in enumerate(zip(description.fieldnames, description.fieldtypes, strict=True))
    )
    return Message(name=name, id=int(description.id), crc_extra=int(description.crc_extra), fields=fields)


def dialect_source() -> str:
    """Returns the text of `cosim/dialect.py`."""
    rows = [
        f"    ({m.id}, {m.crc_extra}, {m.minimum_length}, {m.full_length}, "
        f"{m.offset('target_system')}, {m.offset('target_component')}),  # {m.name}"
        for m in read_dialect().values()
    ]
    return _join(
        f'"""Data for checking and routing messages of MAVLink\'s {DIALECT} dialect. Generated: do not edit.',
        "",
        "`python -m cosim.build.messages` writes this file from pymavlink's definitions. Kernels see the arrays,",
        "sorted by message id, as constants; `cosim.packets.definition` looks a message up.",
        '"""',
        "",
        "from __future__ import annotations",
        "",
        "import numpy as np",
        "",
        "__all__ = [",
        *(f'    "{name}",' for name in sorted(_COLUMNS)),
        "]",
        "",
        "_ROWS = (",
        "    # id, CRC_EXTRA, length without extensions, full length, offsets of target_system and target_component",
        *rows,
        ")",
        "",
        *(
            f"{name} = np.array([row[{index}] for row in _ROWS], np.{dtype})"
            for index, (name, dtype) in enumerate(_COLUMNS.items())
        ),
    )


_COLUMNS = {
    "MESSAGE_IDS": "int32",
    "CRC_EXTRA": "uint8",
    "MINIMUM_LENGTH": "int16",
    "FULL_LENGTH": "int16",
    "TARGET_SYSTEM": "int16",
    "TARGET_COMPONENT": "int16",
}


def messages_source() -> str:
    """Returns the text of `cosim/messages.py`.

    Raises:
        ValueError: a requested message or enumeration is not in the dialect, or two constants have the same name.
    """
    dialect = read_dialect()
    enums = importlib.import_module(f"pymavlink.dialects.v20.{DIALECT}").enums
    unknown = [name for name in MESSAGES if name not in dialect] + [name for name in ENUMS if name not in enums]
    if unknown:
        raise ValueError(f"not in {DIALECT}: {', '.join(unknown)}")
    messages = sorted((dialect[name] for name in MESSAGES), key=lambda message: message.id)
    body = _join(*(line for message in messages for line in message_lines(message)), *_enum_lines(enums))
    _require_unique(body)
    return module_head(_MESSAGES_DOC, body, ())


def module_head(doc: Sequence[str], body: str, also: Sequence[str]) -> str:
    """Returns the head of a module of message kernels: docstring, imports of the names used by `body`, and `body`."""
    access = [name for name in sorted([*_access_names(), *also], key=_as_sorted) if f"{name}(" in body]
    return _join(
        *doc,
        "",
        "from __future__ import annotations",
        "",
        "import numpy as np",
        "",
        "from cosim.kernel import kernel",
        "from cosim.packets import (",
        "    Bytes,",
        *(f"    {name}," for name in access),
        ")",
        body.rstrip("\n"),
    )


def _as_sorted(name: str) -> tuple[str, int, str]:
    """Sort key that follows ruff: get_f32 before get_i8, get_i8 before get_i16."""
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or 0), name


def type_size(name: str) -> int:
    """Returns the size in bytes of one element of a MAVLink type, 0 for an unknown type."""
    return _TYPES[name][1] if name in _TYPES else 0


_MESSAGES_DOC = (
    f'"""Messages of MAVLink\'s {DIALECT} dialect as kernels over payloads. Generated: do not edit.',
    "",
    "`python -m cosim.build.messages` writes this file from pymavlink's definitions, by message id. For a message X:",
    "",
    "- `X` is its id, `X_LENGTH` its full length in bytes, `X_<FIELD>` the offset of a field in the payload;",
    "- `encode_x(payload, ...)` fills the payload from all scalar fields in declared order, extensions last, sets",
    "  its arrays to zero and returns X_LENGTH; then `cosim.packets.pack` makes a packet of it;",
    "- `decode_x(payload)`, after `cosim.packets.unpack`, returns all scalar fields in that order (a lone one as is);",
    "- `put_x_<field>(payload, i, value)` and `get_x_<field>(payload, i)` access element i, from 0, of an array",
    "  field; for text see also `cosim.packets.put_text` and `equal_text`.",
    "",
    "A payload is a uint8[255] array. Units are MAVLink's, in brackets after the type of each field, not SI. Integers",
    "are cut to the field's width; uint64 is carried in an int64. The entries of enumerations follow at the end.",
    "Offsets are added to a `zero` that is not a literal, because numba recompiles a kernel for every literal.",
    "Packets, CRC and the rest of the dialect: `cosim.packets`.",
    '"""',
)


def _access_names() -> list[str]:
    return ["clear", *(f"{access}_{kind}" for access in ("get", "put") for kind in _KINDS)]


def message_lines(message: Message) -> list[str]:
    """Returns the lines for a message: its constants, encode and decode kernels, and accessors of its arrays."""
    name = message.name
    lines = [
        "",
        f"# -- {name} {'-' * (_WIDTH - 7 - len(name))}",
        "",
        f"{name} = {message.id}",
        f"{name}_LENGTH = {message.full_length}",
    ]
    for field in message.fields:
        array = f"[{field.count}]" if field.count else ""
        unit = f" [{field.unit.strip('[]')}]" if field.unit else ""
        extension = ", extension" if field.extension else ""
        lines.append(f"{message.constant(field)} = {field.offset}  # {field.type}{array}{unit}{extension}")
    scalars = [field for field in message.fields if not field.count]
    lines += _encode_lines(message, scalars) + _decode_lines(message, scalars)
    for field in message.fields:
        if field.count:
            lines += _element_lines(message, field)
    return [*lines, ""]


def _encode_lines(message: Message, scalars: Sequence[Field]) -> list[str]:
    arguments = [f"{message.argument(field)}: {_TYPES[field.type][2]}" for field in scalars]
    lines = ["", "", "@kernel"]
    lines += _wrapped(f"def encode_{message.name.lower()}(", ["payload: Bytes", *arguments], ") -> int:")
    lines.append(f'    """Fills `payload` with {_article(message.name)}; returns {message.name}_LENGTH."""')
    lines.append(_NOT_LITERAL)
    for field in message.fields:
        offset = f"zero + {message.constant(field)}"
        if field.count:
            lines += _wrapped("clear(", ["payload", offset, f"{offset} + {field.size}"], ")", indent="    ")
        else:
            put = f"put_{_TYPES[field.type][0]}("
            lines += _wrapped(put, ["payload", offset, message.argument(field)], ")", indent="    ")
    return [*lines, f"    return {message.name}_LENGTH"]


def _decode_lines(message: Message, scalars: Sequence[Field]) -> list[str]:
    if not scalars:
        return []
    types = [_TYPES[field.type][2] for field in scalars]
    values = [f"get_{_TYPES[field.type][0]}(payload, zero + {message.constant(field)})" for field in scalars]
    lines = ["", "", "@kernel"]
    start = f"def decode_{message.name.lower()}(payload: Bytes) -> "
    if len(scalars) == 1:
        lines.append(f"{start}{types[0]}:")
    elif len(start) + len(f"tuple[{', '.join(types)}]:") <= _WIDTH:
        lines.append(f"{start}tuple[{', '.join(types)}]:")
    else:
        lines += [
            f"def decode_{message.name.lower()}(",
            "    payload: Bytes,",
            *_wrapped(") -> tuple[", types, "]:"),
        ]
    lines.append(
        f'    """Returns the scalar fields of {_article(message.name)}: {", ".join(f.name for f in scalars)}."""'
    )
    if len(lines[-1]) > _WIDTH:
        names = _filled([f.name for f in scalars], "    ")
        lines[-1:] = [f'    """Returns the scalar fields of {_article(message.name)}.', "", *names, '    """']
    lines.append(_NOT_LITERAL)
    if len(scalars) == 1:
        return [*lines, f"    return {values[0]}"]
    return lines + _wrapped("return (", values, ")", indent="    ", explode=True)


def _element_lines(message: Message, field: Field) -> list[str]:
    kind, size, type_ = _TYPES[field.type]
    access = f"{message.name.lower()}_{field.name}"
    offset = f"{message.constant(field)} + i" if size == 1 else f"{message.constant(field)} + {size} * i"
    return [
        *("", "", "@kernel"),
        f"def put_{access}(payload: Bytes, i: int, value: {type_}) -> None:",
        f'    """Sets element i (0 to {field.count - 1}) of `{field.name}`."""',
        f"    put_{kind}(payload, {offset}, value)",
        *("", "", "@kernel"),
        f"def get_{access}(payload: Bytes, i: int) -> {type_}:",
        f'    """Returns element i (0 to {field.count - 1}) of `{field.name}`."""',
        f"    return get_{kind}(payload, {offset})",
    ]


def _enum_lines(enums: dict[str, dict[int, Any]]) -> list[str]:
    lines = ["", f"# -- enumerations {'-' * (_WIDTH - 19)}"]
    for name in ENUMS:
        lines += ["", f"# {name}"]
        for value, entry in sorted(enums[name].items()):
            if not entry.name.endswith("_ENUM_END"):
                lines.append(f"{entry.name} = {value}")
    return lines


def _require_unique(source: str) -> None:
    names = [line.split(" = ")[0] for line in source.splitlines() if " = " in line and not line.startswith((" ", "#"))]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"constants defined twice: {', '.join(twice)}")


def _article(name: str) -> str:
    # "an" before a name that is pronounced with a vowel: an ATTITUDE, an EKF_..., an RC_..., an SYS_....
    return f"an {name}" if name[0] in "AEIO" or name.startswith("RC_") else f"a {name}"


def _wrapped(start: str, items: Sequence[str], end: str, *, indent: str = "", explode: bool = False) -> list[str]:
    """Breaks `start` items `end` into lines as the formatter does: one, three, or one per item."""
    line = indent + start + ", ".join(items) + end
    if not explode and len(line) <= _WIDTH:
        return [line]
    inner = f"{indent}    {', '.join(items)}"
    if not explode and len(inner) <= _WIDTH:
        return [indent + start, inner, indent + end]
    return [indent + start, *(f"{indent}    {item}," for item in items), indent + end]


def _filled(words: Iterable[str], indent: str) -> list[str]:
    lines = [indent]
    for word in words:
        if len(lines[-1]) + len(word) + 2 > _WIDTH:
            lines.append(indent)
        lines[-1] += f"{word}, "
    lines = [line.rstrip() for line in lines]
    return [*lines[:-1], lines[-1].rstrip(",") + "."]


def _join(*lines: str) -> str:
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    package = Path(__file__).resolve().parent.parent
    (package / "dialect.py").write_text(dialect_source(), encoding="utf-8")
    (package / "messages.py").write_text(messages_source(), encoding="utf-8")

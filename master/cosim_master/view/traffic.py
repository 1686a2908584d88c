"""The packets of a run for the page: flights to draw, statistics of links, and a log of the messages.

Statistics count all packets. The number of packets drawn and logged is limited: the log keeps all messages of rare
kinds, and every n-th message of other kinds.
"""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.messages import STATUSTEXT, STATUSTEXT_TEXT
from cosim_master.results.reading.links import nodes_of
from cosim_master.results.reading.message_names import message_names
from cosim_master.results.reading.read import packets
from cosim_master.results.reading.roles import Part
from cosim_master.results.recording.packet_log import EPOCH
from cosim_master.results.storage.arrays import values_of
from cosim_master.view.block import Array, Block, steps_between

__all__ = ["SAME", "packet_at", "said", "sends", "traffic", "vehicle_of_nodes"]

_DRAWN = 250_000
_LOGGED = 20_000
_LINKS = 2_000
_NOBODY = 65535
SAME = ("sent", "source", "sequence", "message", "system", "component")
"""Columns that identify packets: rows of one packet, for several nodes, have equal values there."""
_IDENTITY = ("system", "component", "sequence", "message")
"""Of these, those that a relay leaves as they are."""


def traffic(run: Path, parts: Sequence[Part], block: Block, start: float, quantum: float) -> dict[str, Any]:
    """Returns the packets of a run for the page; empty lists if they were not recorded.

    Args:
        run: folder of the run.
        parts: the drones, in the order of the page.
        block: the block to which numbers are added.
        start, quantum: origin and resolution of the page's times, s.
    """
    told: dict[str, Any] = {"messages": [], "sources": [], "vehicleOf": [], "spoken": [], "links": [], "longest": 0.0}
    if not (run / "packets.parquet").is_file():
        return told
    table = packets(run)
    if table.num_rows == 0:
        return told
    columns = {name: values_of(table[name]) for name in ("sent", "arrival", "sequence", "system", "component")}
    codes: dict[str, list[Any]] = {}
    for name in ("source", "target", "outcome", "message"):
        coded = table[name].combine_chunks().dictionary_encode()
        codes[name] = coded.dictionary.to_pylist()
        columns[name] = values_of(coded.indices)
    names = message_names()
    nodes = nodes_of(codes["source"], codes["target"])
    by_node = vehicle_of_nodes(codes["target"], parts)
    told["messages"] = [names.get(number, f"message {number}") for number in codes["message"]]
    told["spoken"] = [number == STATUSTEXT for number in codes["message"]]
    told["sources"] = codes["source"]
    told["vehicleOf"] = [by_node.get(nodes[source], -1) for source in codes["source"]]
    radio = np.array([outcome == "radio" for outcome in codes["outcome"]])[columns["outcome"]]
    lost = np.array([outcome.startswith("lost") for outcome in codes["outcome"]])[columns["outcome"]]
    begins, number = sends(columns)
    _flights(told, columns, codes, radio, lost, number, by_node, block, (start, quantum))
    told["links"] = _links(columns, codes, nodes, radio, lost, by_node)
    told["log"] = _log(run, columns, codes, radio, lost, begins, number, block, (start, quantum))
    return told


def vehicle_of_nodes(nodes: Sequence[str], parts: Sequence[Part]) -> dict[str, int]:
    """Returns the vehicle of each node: the only vehicle in the node, or the one with the node's name."""
    carried: dict[str, list[int]] = defaultdict(list)
    for i, part in enumerate(parts):
        at = part.vehicle
        while at:
            carried[at].append(i)
            at = at.rpartition(".")[0]
    found = {node: carried[node][0] for node in nodes if len(carried.get(node, ())) == 1}
    return found | {part.name: i for i, part in enumerate(parts) if part.name in nodes}


def sends(columns: Mapping[str, Array] | Array) -> tuple[Array, Array]:
    """Returns the first row of each packet, in the order of sending, and the packet of each row.

    Rows of one packet follow each other, unless nodes hear it at different times: on a medium on which it may collide.
    """
    n = len(columns["sent"])
    new = np.zeros(n, bool)
    new[:1] = True
    for name in SAME:
        new[1:] |= columns[name][1:] != columns[name][:-1]
    runs = np.flatnonzero(new)
    keys = [columns[name][runs] for name in SAME]
    order = np.lexsort((runs, *reversed(keys)))
    other = np.zeros(len(runs), bool)
    other[:1] = True
    for key in keys:
        other[1:] |= key[order][1:] != key[order][:-1]
    first = runs[order][other]
    by_time = np.lexsort((first, columns["sent"][first]))
    place = np.empty(len(first), np.int64)
    place[by_time] = np.arange(len(first))
    of_run = np.empty(len(runs), np.int64)
    of_run[order] = place[np.cumsum(other) - 1]
    return first[by_time], np.repeat(of_run, np.diff(np.append(runs, n)))


def _ticks(times: Array, clock: tuple[float, float]) -> Array:
    start, quantum = clock
    return np.rint((times - start) / quantum).astype(np.int64)


def _flights(
    told: dict[str, Any],
    columns: Mapping[str, Array],
    codes: Mapping[str, Sequence[Any]],
    radio: Array,
    lost: Array,
    number: Array,
    by_node: Mapping[str, int],
    block: Block,
    clock: tuple[float, float],
) -> None:
    """Adds the packets sent by radio, including lost ones; if they are too many, only those of every n-th send."""
    on_air = radio | lost
    every = max(1, -(-int(on_air.sum()) // _DRAWN))
    rows = np.flatnonzero(on_air & (number % every == 0))
    rows = rows[np.argsort(columns["sent"][rows], kind="stable")]
    sent = columns["sent"][rows]
    delay = np.nan_to_num(columns["arrival"][rows] - sent)
    of_target = np.array([by_node.get(node, _NOBODY) for node in codes["target"]])
    of_source = np.array([_NOBODY if i < 0 else i for i in told["vehicleOf"]])
    told["every"] = every
    told["longest"] = float(delay.max(initial=0.0))
    told["flights"] = {
        "sent": block.add(steps_between(_ticks(sent, clock)), "u4"),
        "delay": block.add(np.rint(delay / clock[1]), "u4"),
        "from": block.add(of_source[columns["source"][rows]], "u2"),
        "to": block.add(of_target[columns["target"][rows]], "u2"),
        "message": block.add(columns["message"][rows], "u2"),
        "lost": block.add(lost[rows], "u1"),
    }


def _links(
    columns: Mapping[str, Array],
    codes: Mapping[str, Sequence[Any]],
    nodes: Mapping[str, str],
    radio: Array,
    lost: Array,
    by_node: Mapping[str, int],
) -> list[dict[str, Any]]:
    """Returns the statistics of each link, the worst first; if there are very many links, one entry for each sender."""
    senders = list(dict.fromkeys(nodes.values()))
    of_source = np.array([senders.index(nodes[source]) for source in codes["source"]])
    rows = np.flatnonzero(radio | lost)
    source, target = of_source[columns["source"][rows]], columns["target"][rows]
    keys, link = np.unique(source.astype(np.int64) * (len(codes["target"]) + 1) + target, return_inverse=True)
    merged = len(keys) > _LINKS
    if merged:
        keys, link = np.unique(source.astype(np.int64) * (len(codes["target"]) + 1), return_inverse=True)
    seconds = float(columns["sent"].max() - columns["sent"].min())
    count = np.bincount(link)
    gone = np.bincount(link, weights=lost[rows])
    delay = np.bincount(link, weights=np.where(radio[rows], columns["arrival"][rows] - columns["sent"][rows], 0.0))
    causes: list[Counter[str]] = [Counter() for _ in keys]
    for row in np.flatnonzero(lost[rows]):
        causes[link[row]][codes["outcome"][columns["outcome"][rows[row]]]] += 1
    found = []
    for i, key in enumerate(keys):
        sender, node = divmod(int(key), len(codes["target"]) + 1)
        arrived = int(count[i] - gone[i])
        found.append(
            {
                "from": senders[sender],
                "to": "all" if merged else codes["target"][node] or "nobody",
                "sent": int(count[i]),
                "lost": int(gone[i]),
                "causes": dict(causes[i]),
                "delay": delay[i] / arrived if arrived else None,
                "rate": count[i] / seconds if seconds > 0 else None,
                "vehicle": by_node.get(senders[sender], -1),
            }
        )
    return sorted(found, key=lambda one: -one["lost"] / one["sent"])


def _log(
    run: Path,
    columns: Mapping[str, Array],
    codes: Mapping[str, Sequence[Any]],
    radio: Array,
    lost: Array,
    begins: Array,
    number: Array,
    block: Block,
    clock: tuple[float, float],
) -> dict[str, Any]:
    """Returns the packets sent, in the order of time, with their contents."""
    chosen = _chosen(columns["message"][begins], [number == STATUSTEXT for number in codes["message"]])
    rows = begins[chosen]
    relays = np.array([name.endswith(".relay") for name in codes["source"]])[columns["source"][rows]]
    payloads = _payloads(run / "packets.tlog", columns, codes["message"], rows, relays)
    texts = [
        said(codes["message"][columns["message"][row]], payload) for row, payload in zip(rows, payloads, strict=True)
    ]
    heard, gone = (np.bincount(number[of], minlength=len(begins))[chosen] for of in (radio, lost))
    return {
        "of": len(begins),
        "time": block.add(steps_between(_ticks(columns["sent"][rows], clock)), "u4"),
        "source": block.add(columns["source"][rows], "u2"),
        "message": block.add(columns["message"][rows], "u2"),
        "heard": block.add(np.minimum(heard, 65535), "u2"),
        "lost": block.add(np.minimum(gone, 65535), "u2"),
        "texts": texts,
    }


def _chosen(messages: Array, spoken: Sequence[bool]) -> Array:
    """Returns the packets for the log, kind by kind, texts and rare kinds first, up to the limit."""
    kinds, counts = np.unique(messages, return_counts=True)
    order = sorted(zip(counts, kinds, strict=True), key=lambda one: (not spoken[one[1]], one[0]))
    kept, room = [], _LOGGED
    for left, (count, kind) in zip(range(len(order), 0, -1), order, strict=True):
        every = max(1, -(-int(count) // max(1, room // left)))
        of_kind = np.flatnonzero(messages == kind)[::every]
        kept.append(of_kind)
        room = max(0, room - len(of_kind))
    return np.sort(np.concatenate(kept))


def _payloads(
    file: Path, columns: Mapping[str, Array], messages: Sequence[int], rows: Array, relays: Array
) -> list[bytes]:
    """Returns the payloads of some packets, from the log of all packets sent; empty for those that are not there.

    A packet that a relay sends on is not there: it has the payload of the last one before with its sender and number.
    """
    found = [b""] * len(rows)
    if not file.is_file():
        return found
    at_once: dict[tuple[int, ...], list[int]] = defaultdict(list)
    sent_on: dict[tuple[int, ...], list[tuple[int, int]]] = defaultdict(list)
    sent = np.rint(columns["sent"] * 1e9).astype(np.int64) // 1000
    for place, row in enumerate(rows):
        values = (columns[name][row] for name in _IDENTITY[:3])
        identity = (*map(int, values), messages[columns["message"][row]])
        if relays[place]:
            sent_on[identity].append((int(sent[row]), place))
        else:
            at_once[int(sent[row]), *identity].append(place)
    data = file.read_bytes()
    at = 0
    while at + 17 <= len(data):
        time = struct.unpack_from(">Q", data, at)[0] - EPOCH
        identity, payload, at = packet_at(data, at + 8)
        for place in at_once.get((time, *identity), ()):
            found[place] = payload
        for when, place in sent_on.get(identity, ()):
            if time < when:
                found[place] = payload
    return found


def packet_at(data: bytes, at: int) -> tuple[tuple[int, int, int, int], bytes, int]:
    """Returns (system, component, sequence, message) and the payload of the packet at an offset, and its end."""
    length = data[at + 1]
    if data[at] == 0xFD:
        number = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
        begin, signature = at + 10, 13 if data[at + 2] & 1 else 0
        key = (data[at + 5], data[at + 6], data[at + 4], number)
    else:
        begin, signature = at + 6, 0
        key = (data[at + 3], data[at + 4], data[at + 2], data[at + 5])
    return key, data[begin : begin + length], begin + length + 2 + signature


def said(number: int, payload: bytes) -> str:
    """Returns the text of a STATUSTEXT, or the fields of another message if pymavlink is installed.

    Nothing is said of a packet whose payload is not known.
    """
    if not payload:
        return ""
    if number == STATUSTEXT:
        return payload[STATUSTEXT_TEXT : STATUSTEXT_TEXT + 50].split(b"\0")[0].decode("utf-8", "replace")
    try:
        from pymavlink.dialects.v20 import ardupilotmega
    except ImportError:
        return ""
    kind = ardupilotmega.mavlink_map.get(number)
    if kind is None:
        return f"{len(payload)} bytes"
    size = kind.unpacker.size
    values = kind.unpacker.unpack(payload[:size].ljust(size, b"\0"))
    in_order = dict(zip(kind.ordered_fieldnames, _fields(values, kind), strict=True))
    return ", ".join(f"{name} {_short(in_order[name])}" for name in kind.fieldnames)


def _fields(values: Sequence[Any], kind: Any) -> list[Any]:
    """Returns the fields of a message in wire order; an array is one value."""
    found: list[Any] = []
    at = 0
    for length in kind.array_lengths:
        many = length > 0 and not isinstance(values[at], bytes)
        found.append(list(values[at : at + length]) if many else values[at])
        at += length if many else 1
    return found


def _short(value: Any) -> str:
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode("utf-8", "replace")
    if isinstance(value, float):
        return f"{value:.6g}"
    return "[" + " ".join(map(_short, value)) + "]" if isinstance(value, list) else str(value)

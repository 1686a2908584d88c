"""The packets of a run for its live page: flights to draw, messages by name, and statistics of links.

Statistics count all packets since the run began. Flights and messages are collected only while a page is open, and of
each report of progress (up to fifty times a second) only so many that neither the run nor the page has to wait:

    flights     250, evenly chosen; a page that draws slowly also receives at most 250 for each frame
    messages    100 per second, rare kinds first, and up to 20 texts in any case; the newest 500 wait for pages
    links       the 300 with the largest share of losses, once a second; one entry per sender if the system has so many
                nodes that there could be more than 100,000 links
"""

from __future__ import annotations

import struct
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.messages import STATUSTEXT
from cosim_master.network.radio.tables import BY_RADIO, MALFORMED, OUTCOMES
from cosim_master.results.reading.message_names import message_names
from cosim_master.results.reading.roles import Part
from cosim_master.stepping.observation import Packets
from cosim_master.system.settings.network import Network
from cosim_master.view.block import Array
from cosim_master.view.traffic import SAME, packet_at, said, sends, vehicle_of_nodes

__all__ = ["LiveTraffic"]

_FLIGHTS = 250
_BATCHES = 64
_MESSAGES, _RATE = 20, 100.0
_WAITING = 500
_KNOWN = 20_000
"""Packets that may still be heard by other nodes: far more than are on the air or wait for it."""
_LINKS = 300
_CELLS = 100_000
_NOBODY = 65535
_LOST = np.array([outcome.startswith("lost") for outcome in OUTCOMES])
_ON_AIR = _LOST | (np.arange(len(OUTCOMES)) == BY_RADIO)


class LiveTraffic:
    """Counts the packets of a run, and keeps some of the newest for its pages.

    The thread of the run calls `packets`, that of the server everything else.

    Args:
        network: nodes and gateways of the run.
        parts: the drones, in the order of the page.

    Attributes:
        watched: whether a page is open.
        counts, wall: numbers of packets by radio, and wall-clock time [s], of the last progress report.
    """

    def __init__(self, network: Network, parts: Sequence[Part]) -> None:
        gateways = [gateway.name for gateway in network.gateways]
        self._nodes = [*(node.name for node in network.nodes), *gateways]
        self._endpoints = [name for name, _ in network.senders()]
        self._node_of = np.array([n for _, n in network.senders()], np.int64)
        vehicles = vehicle_of_nodes(self._nodes, parts)
        self._vehicle = np.array([*(vehicles.get(name, _NOBODY) for name in self._nodes), _NOBODY], np.int64)
        self._node_of_vehicle = {parts[vehicle].name: node for node, vehicle in vehicles.items()}
        self._systems = np.zeros(len(self._endpoints), np.int64)
        self._width = len(self._nodes) + 1  # the last column: to nobody
        self._by_sender = self._width * self._width > _CELLS
        cells = len(self._nodes) * (1 if self._by_sender else self._width)
        self._of_link = np.zeros((max(1, cells), len(OUTCOMES)), np.int64)
        self._delay = np.zeros(max(1, cells))
        self._first, self._last = np.inf, -np.inf
        self._sends, self._kinds = 0, Counter[int]()
        # Nodes hear a packet at different times where it may collide or is sent on: its rows are in several reports.
        self._apart = network.medium in ("aloha", "csma") or bool(network.relays)
        self._known: dict[tuple[int, ...], None] = {}
        self._flights: deque[tuple[int, Array]] = deque(maxlen=_BATCHES)
        self._messages: deque[tuple[int, tuple[Any, ...]]] = deque(maxlen=_WAITING)
        self._numbers = [0, 0]  # of the newest batch of flights, and of the newest message
        self._seen = (0, 0)  # events and bytes of the present chunk that were counted already
        message_names()  # whose import takes a fifth of a second, which the run would notice later
        self.watched = False
        self.counts: dict[str, int] = {}
        self.wall = 0.0
        self._room, self._logged_at = float(_MESSAGES), 0.0

    # -- in the thread of the run

    def packets(self, packets: Packets, *, complete: bool) -> None:
        """Takes a chunk, which begins with those already seen unless the one before was complete."""
        events, log = packets.events[self._seen[0] :], packets.log[self._seen[1] :]
        self._seen = (0, 0) if complete else (packets.events.size, packets.log.size)
        if not events.size:
            return
        on_air = _ON_AIR[events["outcome"]]
        known = events["outcome"] != MALFORMED
        self._systems[events["source"][known]] = events["system"][known]
        begins, number = sends(events)
        is_new = self._first_heard(events[begins])
        self._sends += int(is_new.sum())
        self._count(events[on_air])
        if self.watched:
            self._fly(events[on_air])
            if is_new.any():
                self._log(events, begins, number, np.flatnonzero(is_new), log)

    def _first_heard(self, packets: Array) -> Array:
        """Returns which packets, one row of each, were in no report before."""
        if not self._apart:
            return np.ones(len(packets), bool)
        keys = list(zip(*(packets[name].tolist() for name in SAME), strict=True))
        is_new = np.array([key not in self._known for key in keys])
        self._known |= dict.fromkeys(keys)
        for key in list(self._known)[: max(0, len(self._known) - _KNOWN)]:
            del self._known[key]
        return is_new

    def _count(self, events: Array) -> None:
        if not events.size:
            return
        cell = self._node_of[events["source"]]
        if not self._by_sender:
            cell = cell * self._width + events["target"]
        np.add.at(self._of_link, (cell, events["outcome"]), 1)
        arrived = events["outcome"] == BY_RADIO
        np.add.at(self._delay, cell[arrived], (events["arrival"] - events["sent"])[arrived] / 1e9)
        self._first = min(self._first, float(events["sent"].min()) / 1e9)
        self._last = max(self._last, float(events["sent"].max()) / 1e9)

    def _fly(self, events: Array) -> None:
        of: Any = self._vehicle
        source, target = of[self._node_of[events["source"]]], of[events["target"]]
        rows = np.flatnonzero((source != _NOBODY) & (target != _NOBODY) & (source != target))
        rows = _some(rows, _FLIGHTS)
        if not rows.size:
            return
        sent, lost = events["sent"][rows], _LOST[events["outcome"][rows]]
        delay = np.where(lost, 0, events["arrival"][rows] - sent)
        batch = np.stack([sent / 1e9, delay / 1e9, source[rows], target[rows], lost], axis=1)
        self._numbers[0] += 1
        self._flights.append((self._numbers[0], batch[np.argsort(batch[:, 0], kind="stable")]))

    def _log(self, events: Array, begins: Array, number: Array, new: Array, log: Array) -> None:
        self._room = min(float(_MESSAGES), self._room + _RATE * (self.wall - self._logged_at))
        self._logged_at = self.wall
        message = events["message"][begins[new]]
        self._kinds.update(message.tolist())
        count = np.array([self._kinds[number] for number in message.tolist()])
        texts = min(int((message == STATUSTEXT).sum()), _MESSAGES)  # which do not wait for others
        kept = new[np.lexsort((count, message != STATUSTEXT))[: max(texts, int(self._room))]]
        self._room -= len(kept)
        outcome = events["outcome"]
        heard, lost = (np.bincount(number[of], minlength=len(begins)) for of in (outcome == BY_RADIO, _LOST[outcome]))
        waiting = {tuple(int(events[name][begins[i]]) for name in _KEY): i for i in kept}
        payloads = _payloads(log.tobytes(), {*waiting})
        for key, i in sorted(waiting.items()):
            of_packet = int(heard[i]), int(lost[i])
            entry = (key[0] / 1e9, int(events["source"][begins[i]]), key[4], *of_packet, payloads.get(key, b""))
            self._numbers[1] += 1
            self._messages.append((self._numbers[1], entry))

    # -- in the thread of the server

    @property
    def newest(self) -> tuple[int, int]:
        """The numbers of the newest batch of flights and of the newest message."""
        return self._numbers[0], self._numbers[1]

    def node_of(self, drone: str) -> str:
        """Returns the node that carries a drone of the page; empty if there is none."""
        return self._node_of_vehicle.get(drone, "")

    def systems(self) -> dict[str, int]:
        """Returns the system id of the last packet of each endpoint that has sent any."""
        found = zip(self._endpoints, self._systems.tolist(), strict=True)
        return {endpoint: system for endpoint, system in found if system}

    @property
    def sends(self) -> int:
        """The number of packets sent since the run began."""
        return self._sends

    def flights(self, after: int, last: int) -> bytes:
        """Returns flights of the batches after `after` up to `last` by time: NaN, then five numbers each.

        The numbers (float64, little-endian) are: time sent [s], delay [s], vehicles (65535: none) that sends and
        receives, and 1 if the packet is lost.
        """
        batches = [batch for number, batch in list(self._flights) if after < number <= last]
        if not batches:
            return b""
        every = np.concatenate(batches)
        some = every[_some(np.arange(len(every)), _FLIGHTS)]
        return np.append(np.nan, some[np.argsort(some[:, 0], kind="stable")]).astype("<f8").tobytes()

    def messages(self, after: int, last: int) -> list[list[Any]]:
        """Returns the messages after number `after` up to `last`.

        Each is a list: time [s], sender, its vehicle (-1: none), name, number of nodes that hear it, number of nodes to
        which it is lost, contents as text, whether it is a STATUSTEXT.
        """
        names = message_names()
        return [
            [
                time,
                self._endpoints[source],
                _or_nobody(self._vehicle[self._node_of[source]]),
                names.get(number, f"message {number}"),
                heard,
                lost,
                said(number, payload),
                number == STATUSTEXT,
            ]
            for one, (time, source, number, heard, lost, payload) in list(self._messages)
            if after < one <= last
        ]

    def links(self) -> dict[str, Any]:
        """Returns the statistics of links, those with the largest share of losses first, as JSON."""
        of_link, delay = self._of_link.copy(), self._delay.copy()
        count, lost = of_link.sum(axis=1), of_link[:, _LOST].sum(axis=1)
        cells = np.flatnonzero(count)
        worst = cells[np.lexsort((cells, -lost[cells] / count[cells]))]
        seconds = self._last - self._first
        rows = []
        for cell in worst[:_LINKS]:
            sender, node = (cell, -1) if self._by_sender else divmod(cell, self._width)
            arrived = int(count[cell] - lost[cell])
            causes = {OUTCOMES[i]: int(of_link[cell, i]) for i in np.flatnonzero(_LOST & (of_link[cell] > 0))}
            to = "all" if self._by_sender else "nobody" if node == len(self._nodes) else self._nodes[node]
            rows.append(
                {
                    "from": self._nodes[sender],
                    "to": to,
                    "sent": int(count[cell]),
                    "lost": int(lost[cell]),
                    "causes": causes,
                    "delay": float(delay[cell]) / arrived if arrived else None,
                    "rate": int(count[cell]) / seconds if seconds > 0 else None,
                    "vehicle": _or_nobody(self._vehicle[sender]),
                }
            )
        packets = {name: self.counts.get(name, 0) for name in ("sent", "delivered", "lost")}
        return {"of": len(worst), "links": rows, "packets": packets, "sends": self._sends}


_KEY = ("sent", "system", "component", "sequence", "message")


def _or_nobody(vehicle: int) -> int:
    return -1 if vehicle == _NOBODY else int(vehicle)


def _some(rows: Array, most: int) -> Array:
    """Returns at most so many rows, evenly chosen."""
    if len(rows) <= most:
        return rows
    return rows[np.arange(most) * len(rows) // most]


def _payloads(log: bytes, wanted: set[tuple[int, ...]]) -> dict[tuple[int, ...], bytes]:
    """Returns the payloads of packets sent, from the log of a run (`Packets.log`), by the values of `_KEY`."""
    found: dict[tuple[int, ...], bytes] = {}
    at = 0
    while at < len(log) and len(found) < len(wanted):
        ticks, entry, length = struct.unpack_from("<qii", log, at)
        if entry & 1 and length >= (12 if log[at + 16] == 0xFD else 8):
            key, payload, _ = packet_at(log, at + 16)
            if (ticks, *key) in wanted:
                found[ticks, *key] = payload
        at += 16 + length
    return found

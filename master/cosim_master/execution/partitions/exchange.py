"""The packets and values that a part of a run gives to the others and takes from them at the end of a window.

exchange.outgoing()          the packets of a window and the frames of values, for each part
exchange.kept_from(part)     the packets that a part does not get because it cannot hear them, should it be wrong
exchange.take(given)         routes the packets of all parts to the own nodes, and fills delayed connections

Where the radio depends on positions, each packet carries that of its sender; only a topology of nearest nodes needs
those of other nodes, too: see `nearest`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.kernel import table
from cosim.packets import MAX_PACKET
from cosim_master.execution.partitions.cut import Cut, uses_positions
from cosim_master.execution.partitions.hearing import FAR, NEAR, Promises, carries_positions, out_of_reach, reach_of
from cosim_master.execution.partitions.nearest import Crowd, concerned, counts_nearest
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.state import RunState
from cosim_master.network.radio.build import grown
from cosim_master.network.radio.replay import replay
from cosim_master.network.radio.tables import FREE_PLACES, POST, POSTED
from cosim_master.network.radio.topology import copies
from cosim_master.stepping.kernels.exchange import feed
from cosim_master.stepping.kernels.frames import USED
from cosim_master.stepping.kernels.tables import BASE, PER_NS, START

__all__ = ["Exchange", "Given"]

_NOWHERE = np.zeros((0, 0, 3))
_AT_ONCE = 1 << 16
"""Places in flight that are made ready for the packets replayed together."""


@dataclass(frozen=True, slots=True)
class Given:
    """What one part gives to another at the end of a window.

    Attributes:
        packets, data: POST and the bytes of the packets, as many columns as the longest has.
        places: the position of the sender of each packet, m; no columns if packets do not carry it.
        steps, reals, ints: the frames: base steps, and the values that the part passes on.
        nodes, at: nodes whose positions the frames contain for another part, and these, (frames, nodes, 3) m.
        crowd: where its nodes are during the next two windows, see `hearing`; None: anywhere.
        broken: in this window its nodes were not in such boxes, so that it needs the packets that are kept from it.
    """

    packets: Any  # a table, as in `Plan`
    data: np.ndarray[Any, Any]
    places: np.ndarray[Any, Any]
    steps: np.ndarray[Any, Any]
    reals: np.ndarray[Any, Any]
    ints: np.ndarray[Any, Any]
    nodes: np.ndarray[Any, Any]
    at: np.ndarray[Any, Any]
    crowd: Crowd | None = None
    broken: bool = False

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the bytes of the arrays: their types are known, and most of them are empty."""
        crowd = () if self.crowd is None else (self.crowd.boxes, self.crowd.group)
        arrays = (*(getattr(self, name) for name in _TYPES), *crowd)
        return _given, ([(one.tobytes(), one.shape) for one in arrays], self.broken)

    def chosen(self, which: np.ndarray[Any, Any]) -> Given:
        """Returns the same with some of its packets."""
        if not which.size:
            return self
        return replace(self, packets=self.packets[which], data=self.data[which], places=self.places[which])

    def with_packets(self, more: Given) -> Given:
        """Returns the same with the packets of another one, too, and with its positions."""
        width = max(self.data.shape[1], more.data.shape[1])
        data = [np.pad(one.data, ((0, 0), (0, width - one.data.shape[1]))) for one in (self, more)]
        packets, places = ([getattr(self, n), getattr(more, n)] for n in ("packets", "places"))
        joined = np.concatenate(packets), np.concatenate(data), np.concatenate(places)
        return replace(self, packets=joined[0], data=joined[1], places=joined[2], nodes=more.nodes, at=more.at)


_TYPES: dict[str, Any] = {
    "packets": POST,
    "data": np.uint8,
    "places": np.float64,
    "steps": np.int64,
    "reals": np.float64,
    "ints": np.int32,
    "nodes": np.int64,
    "at": np.float64,
}
"""The arrays of `Given` with the types of their elements."""


def _given(parts: Sequence[tuple[bytes, tuple[int, ...]]], broken: bool) -> Given:
    """Returns what `Given.__reduce__` has taken apart; its arrays are read only."""
    types = (*_TYPES.values(), np.float64, np.int8)
    arrays: list[np.ndarray[Any, Any]] = [
        np.ndarray(shape, kind, data) for (data, shape), kind in zip(parts, types, strict=False)
    ]
    packets, data, places, steps, reals, ints, nodes, at, *crowd = arrays
    return Given(packets, data, places, steps, reals, ints, nodes, at, Crowd(*crowd) if crowd else None, broken)


@dataclass(frozen=True, slots=True)
class _Window:
    """A window whose packets have been given and not been taken yet.

    Attributes:
        own: the part's own packets, all of them.
        beyond: (packets, parts) which of them are kept from which part, because it cannot hear them.
        crowds: where the nodes of each part had promised to be; None if nobody had.
    """

    own: Given
    beyond: np.ndarray[Any, Any]
    crowds: list[Crowd] | None


@dataclass(frozen=True, slots=True)
class _Delayed:
    """A delayed value that another part passes on: its row in `Plan.delays`, and its place in the frames."""

    row: int
    kind: int
    column: int


class Exchange:
    """The packets and values of one part.

    Args:
        part: its number.
        first: the base step at which the run begins: not 0 if it is resumed from a checkpoint.
    """

    def __init__(self, state: RunState, blocks: Blocks, cut: Cut, part: int, first: int = 0) -> None:
        self._state, self._blocks, self._part, self._cut = state, blocks, part, cut
        radio, network = state.radio, state.network
        self._heard = np.array(radio.endpoints["heard"])
        self._told = self._heard.copy()  # the systems of which all parts know that endpoints of this one speak for them
        of_node = [*cut.of_node, *(part for _ in network.gateways)]  # each part has its own side of a gateway
        owner = np.array([of_node[n] for n in radio.endpoints["node"]], dtype=np.int64)
        self._own = owner == part
        self._of_node = np.array(cut.of_node, dtype=np.int64)
        self._hears = self._hearing_parts()
        self._positions = np.full(max(3 * len(network.nodes), 3), FAR)
        self._nodes = [self._nodes_with_positions(p) for p in range(cut.parts)]
        self._carries, self._reach = carries_positions(network), reach_of(network)
        self._nearest = counts_nearest(network)
        self._promises = Promises(NEAR if self._nearest else self._reach, cut.window)
        self._crowds: list[Crowd | None] = [None] * cut.parts
        self._open: deque[_Window] = deque()
        self._delayed: dict[int, list[_Delayed]] = {}
        self._last: dict[int, tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]] = {}
        self._reached: dict[int, int] = {}
        self._replace_delays()
        if first:
            self._go_on(first)

    def _nodes_with_positions(self, part: int) -> np.ndarray[Any, Any]:
        """Returns the nodes of a part whose positions begin its frames."""
        network = self._state.network
        some = enumerate(self._cut.of_node) if uses_positions(network) else ()
        return np.array([n for n, one in some if one == part and network.nodes[n].position], dtype=np.int64)

    def _hearing_parts(self) -> np.ndarray[Any, Any]:
        """Returns, for each endpoint, the parts with a node that may hear it: (endpoints, parts)."""
        radio, settings = self._state.radio, self._state.radio.settings[0]
        listed = self._state.network.topology == "listed" and settings["medium"] == 0
        parts = self._of_node
        found = np.full((radio.endpoints.size, self._cut.parts), not listed)
        if listed:
            for e, n in enumerate(radio.endpoints["node"]):
                hearers = radio.links[radio.nodes[n]["listed"] : radio.nodes[n]["unlisted"]]
                found[e, parts[hearers]] = True
        return found

    def _replace_delays(self) -> None:
        """Lets the loop only read the lines of delayed values that other parts pass on."""
        layout, plan = self._state.layout, self._state.plan
        places = {p: self._passed_on(p) for p in range(self._cut.parts)}
        for row, kind, source, owner, target in self._cut.crossing(layout):
            if target == self._part:
                self._delayed.setdefault(owner, []).append(_Delayed(row, kind, _column(places[owner], kind, source)))
                plan.delays[row]["source"] = -1

    def _passed_on(self, owner: int) -> tuple[list[int], list[int]]:
        """Returns the places of the values that a part gives to this one; of its own, all."""
        reals, ints = self._cut.passed_on(owner, self._state.layout, self._state.network)
        hidden = 3 * len(self._nodes[owner]) if owner != self._part else 0
        return reals[hidden:], ints

    def _go_on(self, k: int) -> None:
        """Takes the values of all parts at a checkpoint as their latest frames."""
        plan = self._state.plan
        feed(plan, k, plan.feeds[:0])  # values that connections convert
        for owner, nodes in enumerate(self._nodes):
            reals, _ = self._cut.passed_on(owner, self._state.layout, self._state.network)
            self._positions.reshape(-1, 3)[nodes] = plan.real_out[np.array(reals[: 3 * len(nodes)], int)].reshape(-1, 3)
        for owner in range(self._cut.parts):
            reals, ints = self._passed_on(owner)
            self._last[owner], self._reached[owner] = (plan.real_out[_row(reals)], plan.int_out[_row(ints)]), k

    # ---- giving ------------------------------------------------------------------------------------------------------

    def needs(self, part: int, broken: Sequence[int]) -> bool:
        """Returns whether a part needs the packets of the oldest open window that were kept from it.

        Args:
            broken: the parts whose nodes were not where they had promised: who is near depends on the nodes of all.
        """
        return part in broken or (self._nearest and bool(broken))

    def outgoing(self) -> list[Given]:
        """Returns what the part gives to each part, including itself, and empties its outbox and frames."""
        own = self._own_window()
        crowds = [one for one in self._crowds if one is not None]
        known = crowds if len(crowds) == self._cut.parts else None
        near = concerned(self._state.network, known, self._part) if self._nearest and known is not None else None
        beyond = self._not_near(own, near.heard) if near is not None else self._out_of_reach(own)
        self._open.append(_Window(own, beyond, known))
        radio_only, news = own.packets["number"] >= 0, self._news(own.packets)
        shared = replace(own, reals=own.reals[:, 3 * len(self._nodes[self._part]) :])
        given = []
        for part in range(self._cut.parts):
            kept = radio_only & self._hears[own.packets["endpoint"], part]
            if beyond.shape[1]:
                kept &= ~beyond[:, part]
            heads = ~kept & news
            if part == self._part:
                given.append(own)
            else:
                one = shared.chosen(kept | heads)  # the same object for all parts if there are no packets
                one.packets["number"][heads[kept | heads]] = -1
                given.append(self._with_positions(one, own, None if near is None else near.seen[:, part]))
        return given

    def _with_positions(self, given: Given, own: Given, seen: np.ndarray[Any, Any] | None = None) -> Given:
        """Returns what is given with the positions of the own nodes in some boxes; None: of all."""
        nodes, crowd = self._nodes[self._part], self._crowds[self._part]
        if self._carries or not nodes.size:
            return given
        at = own.reals[:, : 3 * len(nodes)].reshape(len(own.reals), len(nodes), 3)
        which = np.ones(len(nodes), dtype=bool) if seen is None or crowd is None else seen[crowd.group]
        return replace(given, nodes=nodes[which], at=at[:, which])

    def _not_near(self, own: Given, heard: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Returns the packets of whose senders no node of another part is near: (packets, parts)."""
        crowd, nodes = self._crowds[self._part], self._nodes[self._part]
        assert crowd is not None
        senders = self._state.radio.endpoints["node"][own.packets["endpoint"]]
        return np.asarray(~heard[crowd.group[np.searchsorted(nodes, senders)]])

    def _own_window(self) -> Given:
        """Returns everything that the part has sent in this window."""
        radio, frames = self._state.radio, self._state.frames
        n, used = int(radio.counters[POSTED]), int(frames.counters[USED])
        packets = np.array(radio.outbox[:n])
        width = int(packets["length"].max()) if n else 0
        data = np.array(radio.posted[:n, :width])
        steps, reals, ints = (np.array(one[:used]) for one in (frames.steps, frames.reals, frames.ints))
        radio.counters[POSTED], frames.counters[USED] = 0, 0
        own = Given(packets, data, np.zeros((n, 0)), steps, reals, ints, self._nodes[self._part][:0], _NOWHERE)
        if self._carries and n:
            own = replace(own, places=self._places_of_senders(own))
        if self._reach == np.inf and not self._nearest:
            return own
        known, at = self._known(own)
        if not len(at):
            return own
        broken = self._promises.broken(at[-len(steps) :] if len(steps) else at[-1:])
        return replace(own, crowd=self._promises.make(known, at), broken=broken)

    def _known(self, own: Given) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Returns base steps, and the own nodes' positions then: those of a window, and the last ones before it."""
        nodes, steps, reals = len(self._nodes[self._part]), own.steps, own.reals
        before = self._open[-1].own if self._open and len(self._open[-1].own.steps) else None
        if before is not None:
            steps, reals = np.append(before.steps[-1:], steps), np.concatenate([before.reals[-1:], reals])
        elif (last := self._last.get(self._part)) is not None:
            steps, reals = np.append(self._reached[self._part], steps), np.concatenate([last[0], reals])
        return steps, reals[:, : 3 * nodes].reshape(len(steps), nodes, 3)

    def _places_of_senders(self, own: Given) -> np.ndarray[Any, Any]:
        """Returns the position of each packet's sender when it was sent, m."""
        nodes = self._nodes[self._part]
        known, at = self._known(own)
        if not len(at):
            return np.full((len(own.packets), 3), np.nan)
        rows = np.maximum(np.searchsorted(self._times(known), own.packets["time"], side="right") - 1, 0)
        senders = self._state.radio.endpoints["node"][own.packets["endpoint"]]
        return np.asarray(at[rows, np.searchsorted(nodes, senders)])

    def _out_of_reach(self, own: Given) -> np.ndarray[Any, Any]:
        """Returns the packets that other parts cannot hear: (packets, parts), without columns if none is kept."""
        if self._reach == np.inf or not len(own.packets):
            return np.zeros((len(own.packets), 0), dtype=bool)
        beyond = np.zeros((len(own.packets), self._cut.parts), dtype=bool)
        for part, crowd in enumerate(self._crowds):
            if part != self._part and crowd is not None:
                beyond[:, part] = out_of_reach(self._reach, own.places, crowd.boxes)
        return beyond

    def _news(self, packets: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Returns which packets are sent by another system than their endpoint's packet before."""
        news = np.zeros(len(packets), dtype=bool)
        for i, (e, system) in enumerate(zip(packets["endpoint"], packets["system"], strict=True)):
            news[i] = self._told[e] != system
            self._told[e] = system
        return news

    def kept_from(self, part: int) -> Given:
        """Returns the packets of the oldest open window that were kept from a part because it could not hear them."""
        own, beyond = self._open[0].own, self._open[0].beyond
        which = np.zeros(len(own.packets), dtype=bool)
        if beyond.shape[1]:
            which = beyond[:, part] & (own.packets["number"] >= 0) & self._hears[own.packets["endpoint"], part]
            beyond[:, part] = False
        missing = replace(own, steps=own.steps[:0], reals=own.reals[:0], ints=own.ints[:0], crowd=None).chosen(which)
        return self._with_positions(missing, own)

    # ---- taking ------------------------------------------------------------------------------------------------------

    def take(self, given: Sequence[Given]) -> None:
        """Takes what all parts have given for the oldest open window, in the order of parts."""
        window = self._open.popleft()
        beyond = window.beyond[:, :0] if self._nearest else window.beyond
        self._place_hidden(window.crowds)
        for owner, one in enumerate(given):
            self._fill(owner, one)
            self._crowds[owner] = one.crowd
        if not any(len(one.packets) for one in given):
            return
        packets = np.concatenate([one.packets for one in given])
        data = np.zeros((len(packets), MAX_PACKET), dtype=np.uint8)
        away = np.zeros((len(packets), beyond.shape[1]), dtype=np.uint8)
        places = np.zeros((len(packets), 3))
        first = 0
        for owner, one in enumerate(given):
            span = slice(first, first + len(one.packets))
            data[span, : one.data.shape[1]] = one.data
            if one.places.shape[1]:
                places[span] = one.places
            if owner == self._part:
                away[span] = beyond
            first += len(one.packets)
        order = np.lexsort((packets["turn"], packets["endpoint"], packets["time"]))
        packets, data, away, places = table(packets[order]), data[order], away[order], places[order]
        state = self._state
        now = np.array(state.radio.endpoints["heard"])
        state.radio.endpoints["heard"] = self._heard
        ends = np.flatnonzero(np.diff(packets["time"])) + 1
        for begin, end in zip([0, *ends], [*ends, len(packets)], strict=True):
            if end > begin:
                self._place(given, int(packets["time"][begin]))
                if self._carries:
                    senders = state.radio.endpoints["node"][packets["endpoint"][begin:end]]
                    self._positions.reshape(-1, 3)[senders] = places[begin:end]
                self._replay(packets, data, away, int(begin), int(end))
        self._heard = np.array(state.radio.endpoints["heard"])
        state.radio.endpoints["heard"][self._own] = now[self._own]

    def _replay(
        self,
        packets: np.ndarray[Any, Any],
        data: np.ndarray[Any, Any],
        away: np.ndarray[Any, Any],
        begin: int,
        end: int,
    ) -> None:
        state = self._state
        each = int(copies(state.radio))
        many = max(1, _AT_ONCE // each)
        for first in range(begin, end, many):
            last = min(end, first + many)
            need = (last - first) * each
            if need > state.radio.counters[FREE_PLACES]:
                state.radio = grown(state.radio, need)
            self._blocks.make_room(need, 0)
            replay(state.radio, self._positions, packets, data, self._of_node, away, first, last)

    def _place_hidden(self, crowds: Sequence[Crowd] | None) -> None:
        """Sets the positions of the nodes elsewhere to the middle of their boxes; frames replace those that matter."""
        if not self._nearest or crowds is None:
            return
        for owner, (nodes, crowd) in enumerate(zip(self._nodes, crowds, strict=True)):
            if owner != self._part and np.isfinite(crowd.boxes).all():
                self._positions.reshape(-1, 3)[nodes] = crowd.middles

    def _place(self, given: Sequence[Given], time: int) -> None:
        """Sets the positions of nodes to those at a time, ns; if packets carry them, of the own ones only."""
        positions = self._positions.reshape(-1, 3)
        if self._carries:
            positions[:] = FAR
        for owner, one in enumerate(given):
            nodes = self._nodes[owner] if owner == self._part else one.nodes
            if not nodes.size:
                continue
            row = int(np.searchsorted(self._times(one.steps), time, side="right")) - 1
            if owner != self._part and row >= 0:
                positions[nodes] = one.at[row]
            elif owner == self._part:
                values = one.reals[row] if row >= 0 else self._last[owner][0][0]  # a part that has failed has no frames
                positions[nodes] = values[: 3 * nodes.size].reshape(-1, 3)

    def _times(self, steps: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        counters = self._state.plan.counters
        ticks, per_ns = counters[START] + steps * counters[BASE], counters[PER_NS]
        return np.asarray((ticks + per_ns // 2) // per_ns)

    def _fill(self, owner: int, given: Given) -> None:
        """Writes the values of a window into the lines of delayed connections from another part."""
        plan = self._state.plan
        if not len(given.steps):
            return
        before = self._last.get(owner)
        self._last[owner] = (np.array(given.reals[-1:]), np.array(given.ints[-1:]))
        k, self._reached[owner] = self._reached.get(owner, 0), int(given.steps[-1])
        if before is None:  # the frame of the start
            return
        for one in self._delayed.get(owner, ()):
            row = plan.delays[one.row]
            values = np.concatenate([before[one.kind], given.reals if one.kind == 0 else given.ints])[:, one.column]
            steps = np.concatenate([[k], given.steps])
            for step in range(k, int(given.steps[-1])):
                value = float(values[int(np.searchsorted(steps, step, side="right")) - 1])
                if one.kind == 0:
                    value = float(row["factor"]) * value + float(row["offset"])
                plan.delay_line[int(row["first"]) + step % int(row["length"])] = value


def _column(places: tuple[list[int], list[int]], kind: int, source: int) -> int:
    """Returns the column of a delayed value in the frames; positions, which may be the same value, come before it."""
    own = places[kind]
    return len(own) - 1 - own[::-1].index(source)


def _row(places: Sequence[int]) -> np.ndarray[Any, Any]:
    return np.array([places], dtype=np.int64)

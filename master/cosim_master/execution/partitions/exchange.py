"""The packets and values that a part of a run gives to the others and takes from them at the end of a window.

given = outgoing(...)        the packets of the window and the frames of values, for one other part
replay.take(windows)         routes the packets of all parts to the own nodes, and fills delayed connections
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.kernel import table
from cosim.packets import MAX_PACKET
from cosim_master.execution.partitions.cut import Cut, uses_positions
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

_AT_ONCE = 1 << 16
"""Places in flight that are made ready for the packets replayed together."""


@dataclass(frozen=True, slots=True)
class Given:
    """What one part gives to another at the end of a window.

    Attributes:
        packets, data: POST and the bytes of the packets, as many columns as the longest has.
        steps, reals, ints: the frames: base steps, and the values that the part passes on.
    """

    packets: np.ndarray[Any, Any]
    data: np.ndarray[Any, Any]
    steps: np.ndarray[Any, Any]
    reals: np.ndarray[Any, Any]
    ints: np.ndarray[Any, Any]


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
        of_node = [*cut.of_node, *(part for _ in network.gateways)]  # each part has its own side of a gateway
        owner = np.array([of_node[n] for n in radio.endpoints["node"]], dtype=np.int64)
        self._own = owner == part
        self._hears = self._hearing_parts()
        self._positions = np.zeros(max(3 * len(network.nodes), 1))
        self._nodes = [
            np.array([n for n, one in enumerate(cut.of_node) if one == p and network.nodes[n].position], dtype=np.int64)
            if uses_positions(network)
            else np.zeros(0, dtype=np.int64)
            for p in range(cut.parts)
        ]
        self._delayed: dict[int, list[_Delayed]] = {}
        self._last: dict[int, tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]] = {}
        self._reached: dict[int, int] = {}
        self._replace_delays()
        if first:
            self._go_on(first)

    def _hearing_parts(self) -> np.ndarray[Any, Any]:
        """Returns, for each endpoint, the parts with a node that may hear it: (endpoints, parts)."""
        radio, settings = self._state.radio, self._state.radio.settings[0]
        listed = self._state.network.topology == "listed" and settings["medium"] == 0
        parts = np.array(self._cut.of_node, dtype=np.int64)
        found = np.full((radio.endpoints.size, self._cut.parts), not listed)
        if listed:
            for e, n in enumerate(radio.endpoints["node"]):
                hearers = radio.links[radio.nodes[n]["listed"] : radio.nodes[n]["unlisted"]]
                found[e, parts[hearers]] = True
        return found

    def _replace_delays(self) -> None:
        """Lets the loop only read the lines of delayed values that other parts pass on."""
        layout, network, plan = self._state.layout, self._state.network, self._state.plan
        places = {p: self._cut.passed_on(p, layout, network) for p in range(self._cut.parts)}
        for row, kind, source, owner, target in self._cut.crossing(layout):
            if target == self._part:
                self._delayed.setdefault(owner, []).append(_Delayed(row, kind, _column(places[owner], kind, source)))
                plan.delays[row]["source"] = -1

    def _go_on(self, k: int) -> None:
        """Takes the values of all parts at a checkpoint as their latest frames."""
        plan = self._state.plan
        feed(plan, k, plan.feeds[:0])  # values that connections convert
        for owner in range(self._cut.parts):
            reals, ints = self._cut.passed_on(owner, self._state.layout, self._state.network)
            self._last[owner], self._reached[owner] = (plan.real_out[_row(reals)], plan.int_out[_row(ints)]), k

    # ---- giving ------------------------------------------------------------------------------------------------------

    def outgoing(self) -> list[Given]:
        """Returns what the part gives to each part, including itself, and empties its outbox and frames."""
        radio, frames = self._state.radio, self._state.frames
        assert frames is not None
        n, used = int(radio.counters[POSTED]), int(frames.counters[USED])
        packets = np.array(radio.outbox[:n])
        width = int(packets["length"].max()) if n else 0
        data = np.array(radio.posted[:n, :width])
        steps, reals, ints = (np.array(one[:used]) for one in (frames.steps, frames.reals, frames.ints))
        radio.counters[POSTED], frames.counters[USED] = 0, 0
        given = []
        for part in range(self._cut.parts):
            if n and not self._hears[:, part].all() and part != self._part:
                kept = self._hears[packets["endpoint"], part]
                heads = ~kept & self._news(packets)
                chosen = kept | heads
                some = np.array(packets[chosen])
                some["number"][heads[chosen]] = -1
                given.append(Given(some, data[chosen], steps, reals, ints))
            else:
                given.append(Given(packets, data, steps, reals, ints))
        return given

    def _news(self, packets: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Returns which packets are sent by another system than their endpoint's packet before."""
        heard = {int(e): int(self._heard[e]) for e in set(packets["endpoint"])}
        news = np.zeros(len(packets), dtype=bool)
        for i, (e, system) in enumerate(zip(packets["endpoint"], packets["system"], strict=True)):
            news[i] = heard[int(e)] != system
            heard[int(e)] = int(system)
        return news

    # ---- taking ------------------------------------------------------------------------------------------------------

    def take(self, given: Sequence[Given]) -> None:
        """Takes what all parts have given for one window, in the order of parts."""
        for owner, one in enumerate(given):
            self._fill(owner, one)
        total = [one.packets for one in given]
        packets = np.concatenate(total) if total else np.zeros(0, dtype=POST)
        data = np.zeros((len(packets), MAX_PACKET), dtype=np.uint8)
        first = 0
        for one in given:
            data[first : first + len(one.packets), : one.data.shape[1]] = one.data
            first += len(one.packets)
        order = np.lexsort((packets["turn"], packets["endpoint"], packets["time"]))
        packets, data = table(packets[order]), data[order]
        state = self._state
        now = np.array(state.radio.endpoints["heard"])
        state.radio.endpoints["heard"] = self._heard
        ends = np.flatnonzero(np.diff(packets["time"])) + 1
        for begin, end in zip([0, *ends], [*ends, len(packets)], strict=True):
            if end > begin:
                self._place(given, int(packets["time"][begin]))
                self._replay(packets, data, int(begin), int(end))
        self._heard = np.array(state.radio.endpoints["heard"])
        state.radio.endpoints["heard"][self._own] = now[self._own]

    def _replay(self, packets: np.ndarray[Any, Any], data: np.ndarray[Any, Any], begin: int, end: int) -> None:
        state = self._state
        each = int(copies(state.radio))
        many = max(1, _AT_ONCE // each)
        for first in range(begin, end, many):
            last = min(end, first + many)
            need = (last - first) * each
            if need > state.radio.counters[FREE_PLACES]:
                state.radio = grown(state.radio, need)
            self._blocks.make_room(need, 0)
            replay(state.radio, self._positions, packets, data, first, last)

    def _place(self, given: Sequence[Given], time: int) -> None:
        """Sets the positions of all nodes to those at a time, ns."""
        for owner, (nodes, one) in enumerate(zip(self._nodes, given, strict=True)):
            if nodes.size:
                row = int(np.searchsorted(self._times(one.steps), time, side="right")) - 1
                values = one.reals[row] if row >= 0 else self._last[owner][0][0]  # a part that has failed has no frames
                at = values[: 3 * nodes.size].reshape(-1, 3)
                for axis in range(3):
                    self._positions[3 * nodes + axis] = at[:, axis]

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

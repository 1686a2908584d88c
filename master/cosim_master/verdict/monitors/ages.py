"""The age of the last packet that a node heard from another, from the events of the radio.

The radio reports the arrival of a packet when it is sent. A packet is heard at its arrival; before the first one, the
age counts from the start of the monitor. Violations begin and end at the times of packets, between the instants that
other monitors see.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from cosim_master.network.radio.tables import BY_RADIO, DUPLICATE, ON_BOARD
from cosim_master.verdict.monitors.declared import Age
from cosim_master.verdict.monitors.rules import NEAR, Samples
from cosim_master.verdict.monitors.violations import Violations

__all__ = ["AgeRule"]

Array: TypeAlias = np.ndarray[Any, Any]

_HEARD = np.array([ON_BOARD, BY_RADIO, DUPLICATE])


class AgeRule:
    """The ages of all pairs of nodes that a monitor names.

    Args:
        nodes: for each endpoint of the network, the number of its node.
        begin: the start of the run, s.
    """

    def __init__(self, monitor: Age, nodes: Array, begin: float) -> None:
        self.monitor, self.violations = monitor, Violations()
        self._nodes = nodes
        count = len(monitor.nodes)
        self._number = np.full((count + 1, count + 1), -1, np.int64)  # the last row and column: gateways
        for n, (sender, receiver) in enumerate(monitor.pairs):
            self._number[sender, receiver] = n
        self._last = np.full(len(monitor.pairs), max(begin, monitor.start))
        self._arrivals, self._pairs = np.zeros(0), np.zeros(0, np.int64)  # not heard yet

    def packets(self, events: Array) -> None:
        """Adds events of the radio (`network.radio.tables.EVENT`)."""
        heard = events[np.isin(events["outcome"], _HEARD) & (events["arrival"] >= 0)]
        if not len(heard):
            return
        count = len(self.monitor.nodes)
        senders = self._nodes[heard["source"]]
        receivers = np.minimum(heard["target"], count)
        pairs = self._number[np.minimum(senders, count), receivers]
        some = pairs >= 0
        self._arrivals = np.concatenate([self._arrivals, heard["arrival"][some] / 1e9])
        self._pairs = np.concatenate([self._pairs, pairs[some]])

    def look(self, samples: Samples) -> None:
        """Evaluates the ages up to the last instant."""
        now = min(float(samples.times[-1]), self.monitor.stop)
        arrived = self._arrivals <= now + NEAR
        if arrived.any():
            order = np.lexsort((self._pairs[arrived], self._arrivals[arrived]))
            self._hear(self._arrivals[arrived][order], self._pairs[arrived][order])
            self._arrivals, self._pairs = self._arrivals[~arrived], self._pairs[~arrived]
        for pair in map(int, np.flatnonzero(now - self._last > self.monitor.most + NEAR)):
            self._extend(pair, now)
        if float(samples.times[-1]) > self.monitor.stop + NEAR:
            self.violations.close(self.monitor.stop, range(len(self.monitor.pairs)))

    def _hear(self, times: Array, pairs: Array) -> None:
        """Notes packets in the order of their arrival."""
        most = self.monitor.most
        while len(pairs):
            _, firsts = np.unique(pairs, return_index=True)
            at, of = times[firsts], pairs[firsts]
            late = at - self._last[of] > most + NEAR
            for pair, time in zip(map(int, of[late]), map(float, at[late]), strict=True):
                self._extend(pair, time)
                self.violations.end(pair, time)
            self._last[of] = np.maximum(self._last[of], at)
            rest = np.ones(len(pairs), bool)
            rest[firsts] = False
            times, pairs = times[rest], pairs[rest]

    def _extend(self, pair: int, now: float) -> None:
        """Begins the violation of a pair, or lets it go on until `now`."""
        last = float(self._last[pair])
        self.violations.extend(pair, last + self.monitor.most, now - last, now - last, now)

    def who(self, subject: int) -> tuple[str, ...]:
        sender, receiver = self.monitor.pairs[subject]
        return self.monitor.nodes[receiver], self.monitor.nodes[sender]

    def told(self, subject: int, worst: float) -> str:
        receiver, sender = self.who(subject)
        return f"{receiver} heard nothing from {sender} for {worst:.4g} s, more than {self.monitor.most:g} s"

    def memory(self) -> Any:
        return [self._last.tolist(), self._arrivals.tolist(), self._pairs.tolist()]

    def recall(self, memory: Any) -> None:
        self._last, self._arrivals = np.array(memory[0]), np.array(memory[1])
        self._pairs = np.array(memory[2], np.int64)

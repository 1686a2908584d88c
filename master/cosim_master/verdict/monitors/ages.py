"""The age of the newest packet that a node has heard from another, from the events of the radio.

The radio reports the arrival of a packet when it is sent. A packet is heard at its arrival; its age counts from the
time at which its origin sent it, whether relays have carried it or not. Before the first one, the age counts from the
start of the monitor. Violations begin and end between the instants that other monitors see.

Source: S. Kaul, R. Yates, M. Gruteser, Real-time status: How often should one update?, IEEE INFOCOM 2012 (age of
information).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from cosim_master.network.radio.tables import BY_RADIO, DUPLICATE, ON_BOARD
from cosim_master.verdict.monitors.declared import NEAR, Age
from cosim_master.verdict.monitors.rules import Samples
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
        self._arrivals, self._born, self._pairs = np.zeros(0), np.zeros(0), np.zeros(0, np.int64)  # not heard yet

    def packets(self, events: Array) -> None:
        """Adds events of the radio (`network.radio.tables.EVENT`)."""
        heard = events[np.isin(events["outcome"], _HEARD) & (events["arrival"] >= 0)]
        if not len(heard):
            return
        count = len(self.monitor.nodes)
        senders = self._nodes[heard["origin"]]
        receivers = np.minimum(heard["target"], count)
        pairs = self._number[np.minimum(senders, count), receivers]
        some = pairs >= 0
        self._arrivals = np.concatenate([self._arrivals, heard["arrival"][some] / 1e9])
        self._born = np.concatenate([self._born, heard["born"][some] / 1e9])
        self._pairs = np.concatenate([self._pairs, pairs[some]])

    def look(self, samples: Samples) -> None:
        """Evaluates the ages up to the last instant."""
        now = min(float(samples.times[-1]), self.monitor.stop)
        arrived = self._arrivals <= now + NEAR
        if arrived.any():
            order = np.lexsort((self._pairs[arrived], self._arrivals[arrived]))
            self._hear(*(one[arrived][order] for one in (self._arrivals, self._born, self._pairs)))
            self._arrivals, self._born = self._arrivals[~arrived], self._born[~arrived]
            self._pairs = self._pairs[~arrived]
        for pair in map(int, np.flatnonzero(now - self._last > self.monitor.most + NEAR)):
            self._extend(pair, now)
        if float(samples.times[-1]) > self.monitor.stop + NEAR:
            self.violations.close(self.monitor.stop, range(len(self.monitor.pairs)))

    def _hear(self, times: Array, born: Array, pairs: Array) -> None:
        """Notes packets in the order of their arrival."""
        most = self.monitor.most
        while len(pairs):
            _, firsts = np.unique(pairs, return_index=True)
            at, of = times[firsts], pairs[firsts]
            newest = np.maximum(self._last[of], born[firsts])
            late = at - self._last[of] > most + NEAR
            fresh = at - newest <= most + NEAR
            for pair, time, ends in zip(map(int, of[late]), map(float, at[late]), fresh[late], strict=True):
                self._extend(pair, time)
                if ends:
                    self.violations.end(pair, time)
            self._last[of] = newest
            rest = np.ones(len(pairs), bool)
            rest[firsts] = False
            times, born, pairs = times[rest], born[rest], pairs[rest]

    def _extend(self, pair: int, now: float) -> None:
        """Begins the violation of a pair, or lets it go on until `now`."""
        last = float(self._last[pair])
        self.violations.extend(pair, last + self.monitor.most, now - last, now - last, now)

    def who(self, subject: int) -> tuple[str, ...]:
        sender, receiver = self.monitor.pairs[subject]
        return self.monitor.nodes[receiver], self.monitor.nodes[sender]

    def told(self, subject: int, worst: float) -> str:
        receiver, sender = self.who(subject)
        return f"{receiver} heard nothing newer than {worst:.4g} s from {sender}; the limit is {self.monitor.most:g} s"

    def memory(self) -> Any:
        return [one.tolist() for one in (self._last, self._arrivals, self._born, self._pairs)]

    def recall(self, memory: Any) -> None:
        self._last, self._arrivals, self._born = (np.array(one, float) for one in memory[:3])
        self._pairs = np.array(memory[3], np.int64)

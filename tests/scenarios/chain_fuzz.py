"""Mutated packets through router, autopilot and agent in one run, as many as wanted.

    python -m tests.scenarios.chain_fuzz --packets 1000000 --seed 1

Blocks of packets that pymavlink built and chance damaged are sent by a node on the air, or come in by a gateway. The
router takes them, an autopilot and an agent get what it delivers and step, and what they say goes through the router
too. pymavlink reads every block: exactly what it finds good may be sent on, the rest is counted to the byte, nothing
but whole good packets is delivered or said, and a step in which nothing was delivered leaves what a step without
packets leaves. Whatever goes wrong raises AssertionError with the block.
"""

from __future__ import annotations

import argparse
from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.fuzz import KINDS, twin, without_input
from benchmarks.fuzz import Fuzz as Maker
from benchmarks.fuzz import deliver as step_with
from cosim_master.network.gateways.gateways import Parser
from cosim_master.network.radio.build import grown, make_radio
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import admit, send
from cosim_master.network.radio.tables import MALFORMED, USED_EVENTS, USED_LOG, Radio
from cosim_master.system.settings.network import Gateway, Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_models.agents.line_agent import LineAgent
from cosim_models.autopilot.autopilot import Autopilot
from tests.master.fmus.scripted import variable
from tests.master.fuzz.packet_fuzz import good as good_packets
from tests.master.fuzz.packet_fuzz import sent as packets_sent
from tests.models.shipped_kernels import kernels

LINK, AUTOPILOT, AGENT, JAMMER, GATEWAY = 0, 0, 1, 2, 3
MODELS = (Autopilot, LineAgent)
BATCH = 24
POOL = 5000
SYSTEM = 1


class Chain:
    """A drone's autopilot and agent, a node that jams, a ground station, and the router between them."""

    def __init__(self, seed: int) -> None:
        self.maker = Maker(seed)
        self._pool = [self.maker.whole() for _ in range(POOL)]
        self.seed = seed
        ends = [
            Endpoint(
                model.__name__,
                variable("mavlink_rx", "input", "String", 8, capacity=_capacity(model, "mavlink_rx")),
                variable("mavlink_tx", "output", "String", 9, capacity=_capacity(model, "mavlink_tx")),
            )
            for model in MODELS
        ]
        jammer = Endpoint("jammer", ends[0].rx, ends[0].tx)
        places: Any = SimpleNamespace(ports={"Real": SimpleNamespace(index={})})
        nodes = (Node("drone", tuple(ends)), Node("jammer", (jammer,)))
        network = Network(nodes=nodes, gateways=(Gateway("@gcs"),))
        self.radio: Radio = grown(make_radio(network, places.ports["Real"].index, keep=True), 4096)
        self.instances: list[tuple[Any, bytearray, Any]] = []
        for model in MODELS:
            memory, m = twin(bytearray(model.record().tobytes()), model)
            m["sysid" if model is LineAgent else "SYSID_THISMAV"] = SYSTEM
            start, _ = kernels(model)
            assert start(m) == 0
            self.instances.append((model, memory, m))
        self.steps = 0
        self.counts = Counter[str]()
        self._buffer = np.zeros(1 << 16, np.uint8)

    def block(self) -> None:
        """One block of packets in, one step of both models."""
        rng = self.maker.rng
        kinds = rng.choice(KINDS[1:3] if rng.random() < 0.4 else KINDS, BATCH)
        chosen = rng.integers(0, POOL, BATCH)
        pieces = [self.maker.mutated(self._pool[i], str(kind)) for i, kind in zip(chosen, kinds, strict=True)]
        data = b"".join(pieces)
        expected = _packets(data)
        self.counts.update({"packets": len(pieces), "good": len(expected)})
        r, where = self.radio, f"seed {self.seed}, step {self.steps}: {data.hex()}"
        r.counters[[USED_EVENTS, USED_LOG]] = 0
        now = int(self.steps * 2_500_000)
        if rng.random() < 0.5:
            self._on_the_air(now, data, expected, where)
        else:
            self._by_the_gateway(now, data, expected, where)
        for e, (model, memory, m) in enumerate(self.instances):
            self._step(now, e, model, memory, m, where)
        for e in (JAMMER, GATEWAY):
            while deliver(r, now, e, self._buffer):
                pass
        self.steps += 1

    def _on_the_air(self, now: int, data: bytes, expected: list[bytes], where: str) -> None:
        r = self.radio
        before = int(r.counters[MALFORMED])
        send(r, np.zeros(0), now, JAMMER, np.frombuffer(data, np.uint8).copy(), len(data))
        events = r.events[: r.counters[USED_EVENTS]]
        bad = events["outcome"] == MALFORMED
        assert packets_sent(r) == expected, where
        assert int(events["length"][bad].sum()) == len(data) - sum(map(len, expected)), where
        assert int(r.counters[MALFORMED]) - before == int(bad.sum()), where
        self.counts["malformed"] += int(bad.sum())

    def _by_the_gateway(self, now: int, data: bytes, expected: list[bytes], where: str) -> None:
        parser = Parser(stream=False)
        found = parser.feed(data)
        assert found == expected, where
        self.counts["refused"] += parser.malformed
        if found:
            joined = b"".join(found)
            admit(self.radio, np.zeros(0), now, LINK, np.frombuffer(joined, np.uint8), len(joined))

    def _step(self, now: int, e: int, model: Any, memory: bytearray, m: Any, where: str) -> None:
        r, t = self.radio, 3.0 + now * 1e-9
        arrived = deliver(r, now, e, self._buffer)
        data = self._buffer[:arrived].tobytes()
        found = _packets(data)
        assert sum(map(len, found)) == arrived, where
        self.counts["delivered"] += len(found)
        _, advance = kernels(model)
        if not found:
            copied, other = twin(memory, model)
            assert step_with(model, other, b"", t, advance) == 0, where
        assert step_with(model, m, data, t, advance) == 0, where
        if not found:
            assert without_input(memory, m) == without_input(copied, other), where
            self.counts["compared"] += 1
        if "motor" in m.dtype.names:
            assert ((m["motor"] >= 0.0) & (m["motor"] <= 1.0)).all(), where
        said = m["mavlink_tx"][: int(m["mavlink_tx_len"])].copy()
        if said.size:
            packets = _packets(said.tobytes())
            assert sum(map(len, packets)) == said.size, where
            before = int(r.counters[MALFORMED])
            send(r, np.zeros(0), now, e, said, said.size)
            assert int(r.counters[MALFORMED]) == before, where
            self.counts["said"] += len(packets)


def _capacity(model: Any, port: str) -> int:
    return int(next(v.capacity for v in model.variables if v.name == port))


def _packets(data: bytes) -> list[bytes]:
    return good_packets(data) if data else []


def main() -> None:
    """Fuzz until so many packets have gone through."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--packets", type=int, default=100_000)
    arguments.add_argument("--seed", type=int, default=1)
    options = arguments.parse_args()
    chain = Chain(options.seed)
    while chain.counts["packets"] < options.packets:
        chain.block()
    print(", ".join(f"{name} {count}" for name, count in chain.counts.items()))


if __name__ == "__main__":
    main()

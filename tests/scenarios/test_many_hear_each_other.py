"""Hundreds of nodes that all hear each other: memory is reserved port by port, and no packet is forgotten."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.kernels.macro_step import _TOGETHER
from cosim_master.system.authoring.swarm.new import fleet_of, new_system

N = 280


@pytest.mark.usefixtures("fmus")
def test_every_packet_reaches_every_other_node_once(tmp_path: Path) -> None:
    fleet = {"vehicle": fleet_of("PointMass"), "autopilot": fleet_of("IdealAutopilot")}
    system = new_system("line", N, tmp_path / "points", fleet=fleet, until=0.2)
    outputs = []
    for threads in (1, 2):
        radio, record = {"network.topology": "broadcast"}, ("drone1.vehicle.*",)
        run = RunOptions(out=tmp_path / str(threads), threads=threads, overrides=radio, record=record)
        assert simulate(system, run).outcome == "done"
        outputs.append((tmp_path / str(threads) / "packets.parquet").read_bytes())
    assert outputs[0] == outputs[1]
    table = pq.read_table(tmp_path / "1" / "packets.parquet").to_pydict()
    heard: dict[tuple[object, ...], list[str]] = defaultdict(list)
    length: dict[tuple[object, ...], int] = {}
    columns = (table[name] for name in ("sent", "source", "message", "sequence", "target", "length", "outcome"))
    for *key, target, size, outcome in zip(*columns, strict=True):
        if outcome == "radio":
            packet = tuple(key)
            heard[packet].append(target)
            length[packet] = size
    assert len(heard) >= 2 * N
    assert all(len(nodes) == len({*nodes}) == N - 1 for nodes in heard.values())
    # Some steps sent so much that, by the bound of `places_needed`, all ports together need more than `_TOGETHER`.
    by_port = Counter[tuple[object, object]]()
    for (sent, source, *_), size in length.items():
        by_port[sent, source] += size
    by_step = Counter[object]()
    for (sent, _), size in by_port.items():
        by_step[sent] += (size // 8 + 2) * 2 * (N + 1)
    assert max(by_step.values()) > _TOGETHER

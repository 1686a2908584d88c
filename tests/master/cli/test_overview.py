"""`info RUN`: a run on one screen, with five drones as with a thousand."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from cosim_master.cli.views.overview import overview, overview_tables, signal_table
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.reading.message_names import message_names

VERDICT = {
    "good": False,
    "nearest": {"who": ["drone1.vehicle", "drone2.vehicle"], "distance": 0.4321, "time": 31.5},
    "findings": [
        {
            "kind": "agent failed",
            "severity": "failure",
            "who": ["drone3.agent"],
            "time": 25.0,
            "text": "drone3.agent: not armed",
        },
        {
            "kind": "open input",
            "severity": "warning",
            "who": ["drone1.vehicle.wind"],
            "time": None,
            "text": "drone1.vehicle.wind: open",
        },
        {"kind": "open input", "severity": "note", "who": ["drone2.vehicle.wind"], "time": None, "text": "unheard"},
    ],
}
GOOD = {"good": True, "from": 2.0, "to": 10.0, "nearest": None, "findings": VERDICT["findings"][2:]}
COLUMNS = ("sent", "arrival", "source", "target", "message", "system", "component", "sequence", "length", "outcome")


def written(folder: Path, packets: Sequence[tuple[Any, ...]], **manifest: Any) -> Path:
    """A run of 10 s: rows of (sent, source, target, message, sequence, outcome), and what its manifest says."""
    folder.mkdir()
    rows = [
        (t, t, source, target, m, 1, 1, sequence, 20, outcome) for t, source, target, m, sequence, outcome in packets
    ]
    columns = dict(zip(COLUMNS, map(list, zip(*rows, strict=True)), strict=True)) if rows else {}
    if columns:
        pq.write_table(pa.table(columns), folder / "packets.parquet")
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"}), pa.field("a.y", pa.int32())]
    signals = pa.Table.from_arrays(
        [pa.array([0.0, 5.0, 10.0]), pa.array([1, 2, 3], pa.int32())], schema=pa.schema(fields)
    )
    pq.write_table(signals, folder / "signals.parquet")
    counts = {"sent": 4, "delivered": 3, "lost": 1, "lost: channel": 1, "lost: range": 0, "on board": 2}
    whole = {
        "system": {"name": "line"},
        "outcome": "done",
        "error": None,
        "simulated_s": 10.0,
        "wall_s": 0.5,
        "real_time_factor": 20.0,
        "start_time": 0.0,
        "seed": 7,
        "instances": {"drone1.agent": {"fmu": "x/Agent.fmu"}, "drone2.agent": {"fmu": "x/Agent.fmu"}},
        "network": {"topology": "nearest", "latency": 0.02, "jitter": 0.0, "loss": 0.1, "range": "INF"},
        "packets": counts,
        "gateways": {},
        "notes": [],
    }
    (folder / "manifest.json").write_text(json.dumps(whole | manifest))
    return folder


def shown(tables: Any) -> list[str]:
    file = io.StringIO()
    console = Console(file=file, width=80, highlight=False)
    for table in tables:
        console.print(table, markup=False) if isinstance(table, str) else console.print(table)
    return [line.rstrip() for line in file.getvalue().splitlines()]


PACKETS = [
    # Node 1 sends a position twice, each time to two nodes by radio and on board; of node 2's one packet is lost.
    (1.0, "drone1.agent", "drone2", 33, 0, "radio"),
    (1.0, "drone1.agent", "drone3", 33, 0, "radio"),
    (1.0, "drone1.agent", "drone1", 33, 0, "on board"),
    (2.0, "drone1.agent", "drone2", 33, 1, "radio"),
    (2.0, "drone1.agent", "drone3", 33, 1, "radio"),
    (2.0, "drone1.agent", "drone1", 33, 1, "on board"),
    (2.0, "drone2.agent", "drone1", 33, 0, "lost: channel"),
    (3.0, "drone2.agent", "drone10", 42100, 1, "radio"),
]


def test_the_document(tmp_path: Path) -> None:
    document = overview(written(tmp_path / "run", PACKETS, verdict=VERDICT))
    assert document["nodes"] == ["drone1", "drone2", "drone3", "drone10"]
    assert document["messages"] == [
        {
            "id": 33,
            "name": "GLOBAL_POSITION_INT",
            "senders": 2,
            "sent": 3,
            "rate": 0.15,
            "radio": 4,
            "lost": 1,
            "on_board": 2,
        },
        {
            "id": 42100,
            "name": "message 42100",
            "senders": 1,
            "sent": 1,
            "rate": 0.1,
            "radio": 1,
            "lost": 0,
            "on_board": 0,
        },
    ]
    assert document["verdict"] == VERDICT
    assert (document["rows"], document["instances"], document["fmus"]) == (3, 2, ["Agent.fmu"])
    assert document["signals"] == [
        {"name": "time", "type": "double", "unit": "s"},
        {"name": "a.y", "type": "int32", "unit": ""},
    ]


def test_messages_have_names_without_pymavlink(monkeypatch: pytest.MonkeyPatch) -> None:
    with_it = message_names()
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    without = message_names.__wrapped__()
    assert without[0] == "HEARTBEAT" and without[33] == "GLOBAL_POSITION_INT" and len(without) > 50
    assert without.items() <= with_it.items()


def test_for_people(tmp_path: Path) -> None:
    gateways = {"@gcs": {"address": "udpout:127.0.0.1:14550", "out": 12, "in": 0}}
    run = written(
        tmp_path / "run", PACKETS, verdict=VERDICT, gateways=gateways, outcome="failed", error="a: failed\n  b"
    )
    assert shown(overview_tables(overview(run))) == [
        "line: failed, 10 s simulated in 0.50 s (20.0 times real time), seed 7",
        "error: a: failed",
        "  b",
        "failure at 25 s: drone3.agent: not armed",
        "warning: drone1.vehicle.wind: open",
        "nearest approach: 0.43 m, drone1.vehicle and drone2.vehicle at 31.5 s",
        "instances: 2 of 1 FMUs (Agent.fmu)",
        "nodes: 4 (drone1, drone2, drone3, drone10)",
        "radio: nearest, latency 0.02 s, jitter 0 s, loss 0.1, range unlimited",
        "packets: 4 sent by radio, 3 delivered, 1 lost (channel 1), 2 on board",
        "links: 4, most losses from drone2 to drone1: 1 of 1 lost (channel 1)",
        "message              senders  1/s each  by radio  lost  on board",
        "GLOBAL_POSITION_INT        2      0.15         4     1         2",
        "message 42100              1       0.1         1     0         0",
        "gateway @gcs (udpout:127.0.0.1:14550): 12 out",
        "recorded: 3 rows of 1 signal (--signals lists them)",
    ]
    assert shown(signal_table(overview(run))) == [
        "3 rows of time and 1 signal:",
        "signal  type    unit",
        "time    double  s",
        "a.y     int32",
    ]


def test_a_long_error_is_shortened(tmp_path: Path) -> None:
    run = written(tmp_path / "run", PACKETS, verdict=GOOD, outcome="failed", error="\n".join("abcdef"))
    lines = shown(overview_tables(overview(run)))
    assert lines[1:6] == ["error: a", "b", "c", "d", "and 2 more lines (manifest.json has all)"]
    assert not any(line.startswith("verdict") for line in lines)


def test_a_good_run_says_so(tmp_path: Path) -> None:
    run = written(tmp_path / "run", PACKETS, verdict=GOOD)
    assert "verdict: no failures or warnings from 2 to 10 s; 1 note (manifest.json has them)" in shown(
        overview_tables(overview(run))
    )


@pytest.mark.parametrize("drones", [5, 1000])
def test_it_fits_on_a_screen(tmp_path: Path, drones: int) -> None:
    names = [f"drone{i + 1}" for i in range(drones)]
    packets = [(1.0, f"{n}.agent", n, kind, k, "radio") for n in names for k, kind in enumerate(range(12))]
    packets.append((2.0, "drone2.agent", "drone1", 0, 12, "lost: range"))
    finding = {"kind": "agent failed", "severity": "failure", "who": names, "time": 1.0, "text": "not armed"}
    verdict = VERDICT | {"findings": [finding] * drones}
    gateways = {f"@{name}": {"address": "tcp:127.0.0.1:5760", "in": 1} for name in names}
    instances = {f"{name}.agent": {"fmu": "Agent.fmu"} for name in names}
    run = written(tmp_path / "run", packets, verdict=verdict, gateways=gateways, instances=instances)
    lines = shown(overview_tables(overview(run)))
    assert len(lines) <= 23, lines
    assert f"nodes: {drones} ({'drone1, drone2, ..., drone1000' if drones > 6 else ', '.join(names)})" in lines
    assert f"and {drones - 3} more failures and warnings (manifest.json has all)" in lines
    assert "and 6 more kinds of messages (--json lists them)" in lines
    assert f"and {drones - 2} more gateways" in lines


def test_a_run_without_a_radio(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    out = tmp_path / "out"
    simulate(probes.ssd(probes.component("a")), RunOptions(out=out, seed=7))
    lines = shown(overview_tables(overview(out)))
    assert lines[0].startswith("test: done, 2 s simulated in ") and lines[0].endswith("times real time), seed 7")
    assert lines[-3:] == [
        "instances: 1 of 1 FMUs (probe.fmu)",
        "packets: 0 sent by radio, 0 delivered, 0 lost, 0 on board",
        "recorded: 5 rows of 5 signals (--signals lists them)",
    ]

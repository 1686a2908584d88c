"""Recordings for the page, written by hand: a few vehicles, their packets, and names that want to be markup."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pymavlink.dialects.v20 import ardupilotmega

from cosim_master.results.recording.packet_log import EPOCH

EVIL = "</script><script>window.hacked=1</script><img src=x onerror=window.hacked=1>\"'&\x01\u2028"
"""A name that breaks out of whatever is not careful."""
OUTCOMES = ("on board", "radio", "lost: channel", "lost: range")


def write_run(
    run: Path,
    columns: Mapping[str, tuple[Any, str]],
    *,
    items: Mapping[str, Mapping[str, int]] | None = None,
    **manifest: Any,
) -> Path:
    """A run folder: columns as (values, unit) beside `time`, which is one of them, and what its manifest says."""
    fields, arrays = [], []
    for name, (values, unit) in columns.items():
        array = pa.array(values)
        metadata = {"unit": unit, "description": f"what {name} is"}
        if items and name in items:
            metadata["items"] = json.dumps(items[name])
        if pa.types.is_int64(array.type):
            array = array.cast(pa.int32())
        fields.append(pa.field(name, array.type, metadata=metadata))
        arrays.append(array)
    run.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), run / "signals.parquet")
    whole = {"outcome": "done", "system": {"name": run.name, "path": "x"}, "instances": {}, "fmus": {}, **manifest}
    (run / "manifest.json").write_text(json.dumps(whole), encoding="utf-8")
    return run


def write_packets(run: Path, packets: Sequence[tuple[float, float, str, str, Any, str]]) -> None:
    """packets.parquet and packets.tlog: rows of (sent, arrival, source, target, message of pymavlink, outcome).

    Neighbouring rows with one message object are one packet for several nodes.
    """
    link = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    rows, log = [], b""
    last: Any = None
    for sent, arrival, source, target, message, outcome in packets:
        if message is not last:
            link.seq = (link.seq + 1) % 256
            log += struct.pack(">Q", EPOCH + round(sent * 1e6)) + message.pack(link)
            last = message
        rows.append((sent, arrival, source, target, message.get_msgId(), 1, 1, message.get_seq(), 20, outcome))
    names = ("sent", "arrival", "source", "target", "message", "system", "component", "sequence", "length", "outcome")
    columns = {name: list(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)}
    columns["arrival"] = [arrival if arrival >= 0 else None for arrival in columns["arrival"]]
    pq.write_table(pa.table(columns), run / "packets.parquet")
    (run / "packets.tlog").write_bytes(log)


def flying(names: Sequence[str], time: np.ndarray[Any, Any]) -> dict[str, tuple[Any, str]]:
    """Columns of vehicles on a row 10 m apart that climb by 1 m/s and fly north by 2 m/s."""
    columns: dict[str, tuple[Any, str]] = {"time": (time, "s")}
    for i, name in enumerate(names):
        for axis, values in enumerate((2.0 * time, 10.0 * i + 0 * time, -1.0 * time)):
            columns[f"{name}.vehicle.position[{axis + 1}]"] = (values, "m")
    return columns


def evil_run(run: Path) -> Path:
    """Two vehicles, signals, messages, nodes and findings whose names want to be markup."""
    time = np.arange(0, 5.0, 0.05)
    evil = EVIL.replace(".", "")
    columns = flying([evil, "plain"], time)
    columns[f"{evil}.agent.{evil}"] = (np.where(time > 2, 1, 0).astype(np.int32), evil)
    columns[f"{evil}.agent.words"] = (["a" if t < 2 else evil for t in time], "")
    write_run(
        run,
        columns,
        items={f"{evil}.agent.{evil}": {evil: 1, "no": 0}},
        system={"name": evil, "path": evil},
        error=evil,
        notes=[evil],
        network={"topology": evil, "latency": 0.1, "jitter": 0.0, "loss": 0.0, "range": 15.0},
        packets={"sent": 3, "delivered": 2, "lost": 1},
        verdict={
            "failures": 1,
            "warnings": 0,
            "notes": 0,
            "nearest": {"who": [evil, "plain"], "distance": 1.0, "time": 2.0},
            "findings": [{"kind": evil, "severity": "failure", "who": [f"{evil}.vehicle"], "time": 2.0, "text": evil}],
        },
    )
    text = ardupilotmega.MAVLink_statustext_message(4, b"</script><script>window.hacked=1//")
    beat = ardupilotmega.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)
    write_packets(
        run,
        [
            (1.0, 1.1, f"{evil}.agent", "plain", text, "radio"),
            (2.0, 2.1, "plain.agent", evil, beat, "radio"),
            (2.0, -1.0, "plain.agent", "plain", beat, "lost: range"),
        ],
    )
    return run

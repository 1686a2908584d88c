"""Exports MAVLink logs of nodes in which tools count lost packets correctly (`mavloss`, MAVExplorer).

Tools compare the sequence numbers of consecutive packets of a sender. A sender numbers all its packets, but a node
hears only those for it, so its recorded log (`packets/NODE.tlog`) seems to have losses where nothing was lost. This
export numbers the packets of each sender in each log anew: each packet heard has the next number, and each packet that
was lost on its way to this node leaves a gap. Times and payloads are those of the recording.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import pyarrow.compute as pc

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.contents.packet_log import packets_of, renumbered
from cosim_master.results.export.options import Options
from cosim_master.results.reading.read import packets
from cosim_master.results.recording.packet_log import EPOCH, file_name

__all__ = ["export"]


def export(run: Path, file: Path, options: Options) -> list[str]:  # noqa: ARG001
    """Writes NODE.tlog for each node to the folder `file`; returns notes.

    Raises:
        CosimError: the run has no record of packets.
    """
    logs = sorted((run / "packets").glob("*.tlog"))
    if not logs:
        raise CosimError(f"{run}: no packets were recorded (there is no packets/NODE.tlog)")
    lost = _lost(run)
    file.mkdir(parents=True, exist_ok=True)
    for log in logs:
        (file / log.name).write_bytes(_numbered(log.read_bytes(), lost.get(log.name, {})))
    return []


def _lost(run: Path) -> dict[str, dict[tuple[int, int], list[int]]]:
    """Returns the times [us] of packets lost on their way, by the log of the node and the address of the sender."""
    table = packets(run).select(["sent", "target", "system", "component", "outcome"])
    found: dict[str, dict[tuple[int, int], list[int]]] = defaultdict(lambda: defaultdict(list))
    for one in table.filter(pc.starts_with(table["outcome"], "lost")).to_pylist():
        address = one["system"], one["component"]
        found[f"{file_name(one['target'])}.tlog"][address].append(EPOCH + round(one["sent"] * 1e9) // 1000)
    return found


def _numbered(log: bytes, lost: Mapping[tuple[int, int], list[int]]) -> bytes:
    numbers: dict[tuple[int, int], int] = {}
    waiting = {address: sorted(times) for address, times in lost.items()}
    counted = dict.fromkeys(waiting, 0)
    written = bytearray()
    for packet in packets_of(log):
        gone = 0
        if times := waiting.get(packet.address):
            before = max(bisect_right(times, packet.stamp), counted[packet.address])  # a log is not quite in order
            gone, counted[packet.address] = before - counted[packet.address], before
        numbers[packet.address] = numbers.get(packet.address, -1) + 1 + gone
        written += struct.pack(">Q", packet.stamp) + renumbered(packet.data, numbers[packet.address])
    return bytes(written)

"""The packet log: an observer that writes packets.parquet with its journal, and the .tlog files.

A .tlog is a sequence of 8-byte big-endian microseconds and one packet. Its clock begins at `EPOCH`, since tools
read it as a date.
"""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.network.radio.tables import EVENT, OUTCOMES
from cosim_master.results.recording.table_file import TableFile
from cosim_master.results.storage.parquet import packets_schema
from cosim_master.stepping.observation import Packets, Seen
from cosim_master.system.settings.network import Network

__all__ = ["EPOCH", "PacketLog", "file_name", "log_names"]

EPOCH = 1_735_689_600_000_000
"""Microseconds from 1970 to 2025-01-01T00:00:00Z, the origin of the clock of .tlog files."""


def log_names(network: Network) -> list[str]:
    """Returns the paths of the .tlog files: that of each node, and at the end that of all packets sent.

    Quiet gateways, which are the last ones, have none.
    """
    loud = len(_node_names(network)) - sum(gateway.quiet for gateway in network.gateways)
    return [*(f"packets/{file_name(name)}.tlog" for name in _node_names(network)[:loud]), "packets.tlog"]


class PacketLog:
    """Writes packets to the journal and the logs as soon as it receives them, complete chunks as row groups.

    Args:
        logs: the open files of `log_names`, in this order.
    """

    every = 0

    def __init__(self, file: TableFile, network: Network, logs: Sequence[Any]) -> None:
        self._nodes = _node_names(network)
        self._endpoints = [name for name, _ in network.senders()]
        self._file, self._logs, self._names = file, logs, log_names(network)
        self._schema = packets_schema()
        self._in_journal = self._in_logs = 0

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...

    def packets(self, packets: Packets, *, complete: bool) -> None:
        """Writes packets.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        file, events, log = self._file, packets.events.size, packets.log.size
        if events > self._in_journal and not file.faults.journal:
            with file.faults.noted(file.journal_file):
                file.journal.packets(self._table(packets.events[self._in_journal :]))
            self._in_journal = events
        if log > self._in_logs:
            with file.faults.noted(Path(self._logs[-1].name)):
                block = packets.log[self._in_logs :].tobytes()
                self._in_logs = log
                self._write_logs(block)
                for one in self._logs:
                    one.flush()
        if complete and not file.faults.files:
            if events:
                file.write(self._table(packets.events))
            self._in_journal = self._in_logs = 0

    def _table(self, events: np.ndarray[Any, Any]) -> pa.Table:
        arrival = events["arrival"] / 1e9
        names = np.array([*self._nodes, ""], dtype=object)
        columns: dict[str, Any] = {
            "sent": events["sent"] / 1e9,
            "arrival": pa.array(arrival, mask=events["arrival"] < 0),
            "source": np.array(self._endpoints, dtype=object)[events["source"]],
            "target": names[events["target"]],
            "outcome": np.array(OUTCOMES, dtype=object)[events["outcome"]],
        }
        columns |= {name: events[name] for name in EVENT.names or () if name not in (*columns, "arrival")}
        arrays = [
            column if isinstance(column := columns[f.name], pa.Array) else pa.array(column, type=f.type)
            for f in self._schema
        ]
        return pa.Table.from_arrays(arrays, schema=self._schema)

    def _write_logs(self, block: bytes) -> None:
        position = 0
        while position < len(block):
            ticks, entry, length = struct.unpack_from("<qii", block, position)
            node, sent = entry >> 1, entry & 1
            stamped = struct.pack(">Q", EPOCH + ticks // 1000) + block[position + 16 : position + 16 + length]
            if node < len(self._logs) - 1:
                self._logs[node].write(stamped)
            if sent:
                self._logs[-1].write(stamped)
            position += 16 + length

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table)
        self._file.journal.packets(table)
        self._file.journal.end_group("packets")

    def take_over_logs(self, run: Path, lengths: Mapping[str, int]) -> None:
        """Copies the beginnings of the logs of an earlier recording. Raises OSError and KeyError."""
        for name, log in zip(self._names, self._logs, strict=True):
            with (run / name).open("rb") as old:
                log.write(old.read(lengths[name]))

    def lengths(self) -> dict[str, int]:
        """Returns the length of each log, in bytes, after writing all buffered packets."""
        for log in self._logs:
            log.flush()
        return {name: log.tell() for name, log in zip(self._names, self._logs, strict=True)}

    def closed(self) -> None:
        """Completes the files.

        Raises:
            RecordingFailed: they cannot be completed; the journal remains.
        """
        self._file.close()
        if not self._file.faults.files:
            with self._file.faults.noted(Path(self._logs[-1].name)):
                for log in self._logs:
                    log.close()


def _node_names(network: Network) -> list[str]:
    return [node.name for node in network.nodes] + [gateway.name for gateway in network.gateways]


def file_name(node: str) -> str:
    """Returns a node's name as a file name: characters not allowed there are percent-encoded, as in a URI.

    Of a name that is too long for a file, the beginning remains, with a digest of the whole.
    """
    name = re.sub(r'[%/\\:*?"<>|\x00-\x1f]|^\.+', lambda found: "".join(f"%{ord(c):02X}" for c in found[0]), node)
    content = name.encode("utf-8", "replace")
    if len(content) <= _LONGEST_NAME:
        return name
    return f"{content[:_KEPT_OF_NAME].decode('utf-8', 'ignore')}~{hashlib.sha256(content).hexdigest()[:16]}"


_LONGEST_NAME, _KEPT_OF_NAME = 200, 150
"""Bytes; file systems allow 255 with the suffix."""

"""The packet log: an observer that writes packets.parquet with its journal, and the .tlog files.

A .tlog is a sequence of 8-byte big-endian microseconds and one packet. Its clock begins at `EPOCH`, since tools
read it as a date.
"""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import RecordingFailed
from cosim_master.network.radio.tables import OUTCOMES
from cosim_master.results.recording.table_file import TableFile
from cosim_master.results.storage.arrays import array_of, text_of, texts
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


_GROUP = 1 << 16
"""Packets of a row group, except where a checkpoint ends it."""


class PacketLog:
    """Writes packets to the journal and the logs as soon as it receives them, and collects them for the file.

    Args:
        logs: the open files of `log_names`, in this order.
    """

    every = 0

    def __init__(self, file: TableFile, network: Network, logs: Sequence[Any]) -> None:
        nodes = _node_names(network)
        self._names = {
            "source": texts([name for name, _ in network.senders()]),
            "target": texts([*nodes, ""]),
            "outcome": texts(OUTCOMES),
        }
        self._last = len(nodes)  # the target of packets without one
        self._file, self._logs, self._files = file, logs, log_names(network)
        self._schema = packets_schema()
        self._seen = self._in_logs = 0  # events and bytes of the chunk that are written
        self._group: list[pa.Table] = []
        self._used = 0

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...

    def packets(self, packets: Packets, *, complete: bool) -> None:
        """Writes packets.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        file, events, log = self._file, packets.events.size, packets.log.size
        while self._seen < events and not (file.faults.journal and file.faults.files):
            end = events if file.faults.files else min(events, self._seen + _GROUP - self._used)
            part = self._table(packets.events[self._seen : end])
            if not file.faults.journal:
                with file.faults.noted(file.journal_file):
                    file.journal.packets(part)
            self._seen = end
            if not file.faults.files:
                self._group.append(part)
                self._used += part.num_rows
                if self._used == _GROUP:
                    self.end_group()
        if log > self._in_logs:
            with file.faults.noted(Path(self._logs[-1].name)):
                block = packets.log[self._in_logs :]
                self._in_logs = log
                self._write_logs(block)
        if complete:
            self._seen = self._in_logs = 0

    def end_group(self) -> None:
        """Writes the packets collected as a row group.

        Raises:
            RecordingFailed: a file cannot be written. If it is the journal, the row group may be written again.
        """
        if self._used and not self._file.faults.files:
            self._file.write(pa.concat_tables(self._group).combine_chunks())
        self._group.clear()
        self._used = 0

    def _table(self, events: np.ndarray[Any, Any]) -> pa.Table:
        arrival = events["arrival"]
        arrays = {
            "sent": array_of(events["sent"] / 1e9, pa.float64()),
            "arrival": array_of(arrival / 1e9, pa.float64(), valid=arrival >= 0),
            "source": text_of(events["source"], self._names["source"]),
            "target": text_of(np.where(events["target"] < 0, self._last, events["target"]), self._names["target"]),
            "outcome": text_of(events["outcome"], self._names["outcome"]),
        }
        columns = [arrays.get(one.name) or array_of(events[one.name], one.type) for one in self._schema]
        return pa.Table.from_arrays(columns, schema=self._schema)

    def _write_logs(self, block: np.ndarray[Any, Any]) -> None:
        """Writes the entries of a block (`Packets.log`) to the logs of their nodes, and those sent to the last one."""
        begin = np.array(_entries(block.data), np.int64)
        heads = block[begin[:, None] + np.arange(16)]
        ticks, entry, length = (heads[:, at].copy().view(kind)[:, 0] for at, kind in _HEAD)
        stamps = (EPOCH + ticks // 1000).astype(">u8").view(np.uint8).reshape(-1, 8)
        node = np.minimum(entry >> 1, len(self._logs) - 1)  # quiet gateways have no log
        order = np.argsort(node, kind="stable")
        ends = np.searchsorted(node[order], np.arange(len(self._logs)))
        for log, first, last in zip(self._logs, ends, ends[1:], strict=False):
            if last > first:
                _write(log, block, begin, length, stamps, order[first:last])
        sent = np.flatnonzero(entry & 1)
        if sent.size:
            _write(self._logs[-1], block, begin, length, stamps, sent)

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table)
        self._file.journal.packets(table)
        self._file.journal.end_group("packets")

    def take_over_logs(self, run: Path, lengths: Mapping[str, int]) -> None:
        """Copies the beginnings of the logs of an earlier recording. Raises OSError and KeyError."""
        for name, log in zip(self._files, self._logs, strict=True):
            with (run / name).open("rb") as old:
                log.write(old.read(lengths[name]))

    def lengths(self) -> dict[str, int]:
        """Returns the length of each log, in bytes, after writing all buffered packets."""
        for log in self._logs:
            log.flush()
        return {name: log.tell() for name, log in zip(self._files, self._logs, strict=True)}

    def closed(self) -> None:
        """Completes the files.

        Raises:
            RecordingFailed: they cannot be completed; the journal remains.
        """
        with suppress(RecordingFailed):  # of the journal alone: the file can do without the end of a group in it
            self.end_group()
        self.end_group()
        self._file.close()
        if not self._file.faults.files:
            with self._file.faults.noted(Path(self._logs[-1].name)):
                for log in self._logs:
                    log.close()


def _entries(block: memoryview) -> list[int]:
    """Returns the positions of the entries of a block of the log."""
    at, found, read = 0, [], struct.Struct("<i").unpack_from
    while at < len(block):
        found.append(at)
        at += 16 + read(block, at + 12)[0]
    return found


def _write(
    log: Any,
    block: np.ndarray[Any, Any],
    begin: NDArray[np.int64],
    length: NDArray[np.int32],
    stamps: NDArray[np.uint8],
    chosen: NDArray[np.int64],
) -> None:
    """Writes the stamps and packets of the entries chosen, in this order, without a call for each."""
    size = 8 + length[chosen]
    place = np.concatenate(([0], np.cumsum(size)))
    source = np.repeat(begin[chosen] + 8 - place[:-1], size) + np.arange(place[-1])  # 16 bytes before it, 8 here
    content = block[source]
    content[place[:-1, None] + np.arange(8)] = stamps[chosen]
    log.write(content.data)
    log.flush()


_HEAD = (slice(0, 8), "<i8"), (slice(8, 12), "<i4"), (slice(12, 16), "<i4")
"""Places and types of time, node and length at the beginning of an entry."""


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

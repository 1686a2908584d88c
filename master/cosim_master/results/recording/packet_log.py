"""The packet log: an observer that writes packets.parquet with its journal, and the .tlog files.

A .tlog is a sequence of 8-byte big-endian microseconds and one packet. Its clock begins at `EPOCH`, since tools
read it as a date.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

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
        self._ends = np.zeros(len(logs), np.int64)
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
            group = list(self._group)
            self._file.write(self._used, lambda: pa.concat_tables(group).combine_chunks())
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
        from cosim_master.network.radio.logs import divide  # a kernel: others import this module for a name

        divide(block, EPOCH, self._ends, content := np.empty(2 * block.size, np.uint8))
        begin = 0
        for log, end in zip(self._logs, self._ends.tolist(), strict=True):
            if end > begin:
                log.write(content[begin:end].data)
                log.flush()
            begin = end

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table.num_rows, lambda: table)
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

"""The packet log: an observer that writes packets.parquet with its journal, and the .tlog files.

A .tlog is a sequence of 8-byte big-endian microseconds and one packet. Its clock begins at `EPOCH`, since tools
read it as a date.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.network.radio.tables import OUTCOMES
from cosim_master.results.recording.behind import Behind
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
_COPIED = 8 << 20
"""Bytes of the log that are copied, so that the run goes on while they are written; it waits for longer blocks."""


class PacketLog:
    """Writes packets to the journal and the logs as soon as it receives them, and collects them for the file.

    Args:
        file: the file of packets.
        logs: the open files of `log_names`, in this order.
        behind: the thread that writes the journal, and the logs.
    """

    every = 0

    def __init__(self, file: TableFile, network: Network, logs: Sequence[Any], behind: Behind) -> None:
        nodes = _node_names(network)
        self._names = {
            "source": texts([name for name, _ in network.senders()]),
            "target": texts([*nodes, ""]),
            "outcome": texts(OUTCOMES),
        }
        self._last = len(nodes)  # the target of packets without one
        self._file, self._logs, self._files, self._behind = file, logs, log_names(network), behind
        self._ends, self._broken = np.zeros(len(logs), np.int64), False
        self._schema = packets_schema()
        self._seen = self._in_logs = 0  # events and bytes of the chunk that are taken
        self._group: list[pa.Table] = []
        self._used = 0

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...

    def packets(self, packets: Packets, *, complete: bool) -> None:
        """Writes packets.

        Raises:
            RecordingFailed: a file cannot be written; these packets or earlier ones are missing in it.
        """
        faults, events, log = self._file.faults, packets.events.size, packets.log.size
        while self._seen < events and not (faults.journal and faults.files):
            end = min(events, self._seen + _GROUP - self._used)
            self._behind.call(partial(self._write, packets.events[self._seen : end].copy()))
            self._used += end - self._seen
            self._seen = end
            if self._used == _GROUP:
                self.end_group()
        if log > self._in_logs:
            block = packets.log[self._in_logs :]
            self._in_logs = log
            if block.size <= _COPIED:
                block = block.copy()
                block.flags.writeable = False  # as the run's own, so that the kernel is compiled for one type
                self._behind.call(partial(self._write_logs, block))
            else:
                self._behind.call(partial(self._write_logs, block))
                self._behind.wait()
        faults.check()
        if complete:
            self._seen = self._in_logs = 0

    def _write(self, events: np.ndarray[Any, Any]) -> None:
        """Appends packets to the journal and the row group."""
        part = self._table(events)
        if not self._file.faults.journal:
            with self._file.in_journal() as journal:
                journal.packets(part)
        self._group.append(part)

    def end_group(self) -> None:
        """Writes the packets so far as a row group."""
        if self._used:
            self._behind.call(partial(self._end_group, self._used))
        self._used = 0

    def _end_group(self, rows: int) -> None:
        group, self._group = self._group, []
        self._file.end_group(rows, lambda: pa.concat_tables(group).combine_chunks())

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

        if self._broken:
            return  # a log that goes on after a gap would be read as one without
        self._broken = True
        divide(block, EPOCH, self._ends, content := np.empty(2 * block.size, np.uint8))
        begin = 0
        with self._file.faults.noted(Path(self._logs[-1].name)):
            for log, end in zip(self._logs, self._ends.tolist(), strict=True):
                if end > begin:
                    log.write(content[begin:end].data)
                    log.flush()
                begin = end
            self._broken = False

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table.num_rows, lambda: table)
        self._file.behind.wait()
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
        """Begins to complete the files."""
        self.end_group()
        self._behind.call(self._file.close)
        self._behind.call(self._close_logs)

    def _close_logs(self) -> None:
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

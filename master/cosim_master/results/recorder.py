"""The files of a run: signals, packets, and a manifest of its inputs and outcome.

    OUT/manifest.json     the system, the options and the outcome; during the run, its progress
    OUT/signals.parquet   column `time` [s], then `component.variable`; units and descriptions in the field metadata
    OUT/packets.parquet   every packet on its way to every node: sent, arrival, addresses, outcome
    OUT/packets.tlog      all packets sent, in the order of time, as ground stations replay them
    OUT/packets/NODE.tlog packets that a node sent and received by radio, or a gateway by its link
    OUT/unfinished/       during the run, in place of the Parquet files: see `journal`

A .tlog is a sequence of 8-byte big-endian microseconds and one packet. Its clock begins at `EPOCH`, since tools
read it as a date.

The recorder never changes the values that it records. `keep` makes all values recorded so far readable, even if the
process is killed. It does not empty the loop's blocks, so the finished files do not depend on it. The values recorded
between two checkpoints are also written to separate files (segments), which belong to the checkpoints.
"""

from __future__ import annotations

import errno
import re
import shutil
import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import Problem, RecordingFailed, SystemDescriptionError, Where
from cosim_master.network.radio.tables import EVENT, OUTCOMES, USED_EVENTS, USED_LOG, Radio
from cosim_master.results.checkpoint_folder import Checkpoint, Position, segments
from cosim_master.results.columns import Block, columns_of
from cosim_master.results.journal import FOLDER, Journal, goes_on
from cosim_master.results.manifest_file import NAME, RunningManifest, write_manifest
from cosim_master.results.parquet import ROW_GROUP, packets_schema, packets_writer, signals_writer
from cosim_master.results.run_folder import clear
from cosim_master.stepping.kernels.tables import PER_NS, ROWS, Plan
from cosim_master.stepping.layout import Layout
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network

__all__ = ["EPOCH", "Recorder"]

_CHANGING = ("outcome", "simulated_s", "wall_s", "real_time_factor", "packets")
"""Keys of the manifest that change during the run."""
EPOCH = 1_735_689_600_000_000
"""Microseconds from 1970 to 2025-01-01T00:00:00Z, the origin of the clock of .tlog files."""


class Recorder:
    """Writes the files of one run.

    Call `rows` and `packets` whenever the loop returns, `keep` about once a second, `finish` at the end.

    Args:
        keep: record packet events and logs.
        manifest: the manifest during the run, with the outcome "running".
        checkpoint: the new recording begins with the recording up to this checkpoint.
        in_segments: write segments for checkpoints.

    Raises:
        SystemDescriptionError: the folder cannot be written to, or another process records there.
    """

    def __init__(
        self,
        folder: Path,
        checked: CheckedSystem,
        layout: Layout,
        network: Network,
        *,
        keep: bool,
        manifest: Mapping[str, Any],
        checkpoint: Checkpoint | None = None,
        in_segments: bool = False,
    ) -> None:
        self.folder = folder
        self._in_segments = in_segments
        self._open_segments: dict[str, Any] = {}
        self._columns = columns_of(checked, layout)
        self._texts = layout.string_signals
        self._text_rows: list[list[str]] = []
        self._keep = keep and bool(network.nodes)
        gateways = [gateway.name for gateway in network.gateways]
        self._nodes = [node.name for node in network.nodes] + gateways
        self._endpoints = [e.name for node in network.nodes for e in node.endpoints] + gateways
        self._event_schema = packets_schema()
        self._events: Any = None
        self._tlogs: dict[int, Any] = {}
        self._groups = {"signals": 0, "packets": 0}
        self._in_journal = {"rows": 0, "events": 0, "log": 0}
        self._journal_fails = self._files_fail = False
        self._opened = ExitStack()
        if goes_on(folder):
            raise _refusal(folder, "another run is being recorded there; give another folder")
        try:
            self._open(manifest)
        except OSError as error:
            self._close_all()
            shutil.rmtree(folder / FOLDER, ignore_errors=True)
            many = "; raise the limit of open files (ulimit -n)" if error.errno in (errno.EMFILE, errno.ENFILE) else ""
            raise _refusal(folder, f"cannot hold the results of a run: {error.strerror or error}{many}") from None
        if checkpoint is not None:
            self._take_over(checkpoint)

    def _open(self, manifest: Mapping[str, Any]) -> None:
        folder = self.folder
        folder.mkdir(parents=True, exist_ok=True)
        clear(folder)  # an old manifest would call incomplete results complete
        journal = Journal(folder, self._columns, self._event_schema if self._keep else None)
        self._journal = self._opened.enter_context(closing(journal))
        self._signals = self._opened.enter_context(
            closing(signals_writer(self._unfinished("signals"), self._columns.schema))
        )
        if self._keep:
            (folder / "packets").mkdir(exist_ok=True)
            self._events = self._opened.enter_context(closing(packets_writer(self._unfinished("packets"))))
            logs = [f"packets/{_file_name(name)}.tlog" for name in self._nodes]
            for n, name in (*enumerate(logs), (-1, "packets.tlog")):
                self._tlogs[n] = self._opened.enter_context((folder / name).open("wb"))
        self._manifest = self._opened.enter_context(closing(RunningManifest(folder, manifest, *_CHANGING)))

    def _unfinished(self, what: str) -> Path:
        return self.folder / FOLDER / f"{what}.parquet"

    def position(self) -> Position:
        """Returns the position of the recording, after writing all buffered values."""
        for file in self._tlogs.values():
            file.flush()
        tlogs = {str(Path(file.name).relative_to(self.folder)): file.tell() for file in self._tlogs.values()}
        return Position(self._groups["signals"], self._groups["packets"], tlogs)

    def _write(self, what: str, writer: Any, table: pa.Table) -> None:
        writer.write_table(table)
        if self._in_segments:
            if what not in self._open_segments:
                (self.folder / "checkpoints").mkdir(exist_ok=True)
                self._open_segments[what] = pq.ParquetWriter(self._segment(what), table.schema, compression="zstd")
            self._open_segments[what].write_table(table)
        self._groups[what] += -(-table.num_rows // ROW_GROUP) or 1

    def _segment(self, what: str) -> Path:
        return self.folder / "checkpoints" / f"{what}.parquet"

    def segments(self) -> list[Path]:
        """Returns the complete segments since the last call; the caller then owns them."""
        for writer in self._open_segments.values():
            writer.close()
        done = [self._segment(what) for what in self._open_segments]
        self._open_segments.clear()
        return done

    def _take_over(self, checkpoint: Checkpoint) -> None:
        """Copies the recording of a checkpoint's run up to the checkpoint: the same row groups, the same bytes."""
        sources = (
            ("signals", self._signals, self._columns.schema, checkpoint.position.signals),
            *((("packets", self._events, self._event_schema, checkpoint.position.packets),) if self._keep else ()),
        )
        try:
            for name, writer, schema, groups in sources:
                before = self._groups[name]
                for file in _readable(checkpoint, f"{name}.parquet"):
                    with pq.ParquetFile(file) as old:
                        if not old.schema_arrow.equals(schema, check_metadata=False):
                            raise ValueError(f"{name}.parquet has other columns than this run records")
                        for group in range(min(old.num_row_groups, groups - self._groups[name])):
                            table = old.read_row_group(group).cast(schema)
                            self._write(name, writer, table)
                            self._into_journal(name, table)
                if (found := self._groups[name] - before) != groups:
                    raise ValueError(f"of {groups} row groups of {name}.parquet there are {found}")
            for file in self._tlogs.values():
                name = str(Path(file.name).relative_to(self.folder))
                with (checkpoint.run / name).open("rb") as old_log:
                    file.write(old_log.read((checkpoint.position.tlogs or {})[name]))
        except (OSError, ValueError, KeyError) as error:
            self.abandon()
            text = f"its recording up to {checkpoint.time:.9g} s cannot be taken over: {error}"
            raise SystemDescriptionError([Problem(Where(str(checkpoint.run)), text)]) from None

    def _into_journal(self, what: str, table: pa.Table) -> None:
        """Appends a row group that was copied."""
        if what == "signals":
            self._journal.rows(self._columns.block(table))
        else:
            self._journal.packets(table)
        self._journal.end_group(what)

    def texts(self, values: list[str]) -> None:
        """Adds the values of all recorded String variables for the row just recorded."""
        self._text_rows.append(values)

    def unwritten_texts(self) -> list[list[str]]:
        """Returns the rows given to `texts` since rows were last written."""
        return list(self._text_rows)

    def take_back(self) -> None:
        """Discards the rows given to `texts` since rows were last written, because the run has gone back in time."""
        self._text_rows.clear()

    # ---- rows and packets --------------------------------------------------------------------------------------------

    def rows(self, plan: Plan) -> None:
        """Writes the rows of the loop's block and empties it."""
        n = self._complete_rows(plan)
        if n == 0:
            return
        self._keep_rows(plan, n)
        with self._writing("signals.parquet"):
            self._write("signals", self._signals, self._columns.table(self._block(plan, 0, n)))
        self._text_rows.clear()
        plan.clock[ROWS] = self._in_journal["rows"] = 0
        self._end_group("signals")

    def packets(self, radio: Radio) -> None:
        """Writes packet events and logs and empties their blocks."""
        events = int(radio.counters[USED_EVENTS]) if self._keep else 0
        self._keep_packets(radio)
        if events:
            with self._writing("packets.parquet"):
                self._write("packets", self._events, self._event_table(radio.events[:events]))
        radio.counters[[USED_EVENTS, USED_LOG]] = 0
        self._in_journal["events"] = self._in_journal["log"] = 0
        if events:
            self._end_group("packets")

    def keep(self, plan: Plan, radio: Radio, progress: Mapping[str, Any]) -> None:
        """Makes all values recorded so far readable, even if the process is killed; does not empty the blocks.

        Call it only if none of these values can still be taken back.

        Args:
            progress: the progress of the run, by key of the manifest.
        """
        self._keep_rows(plan, self._complete_rows(plan))
        self._keep_packets(radio)
        with self._writing("manifest.json"):
            self._manifest.update(progress)

    def _complete_rows(self, plan: Plan) -> int:
        n = int(plan.clock[ROWS])
        return min(n, len(self._text_rows)) if self._texts else n  # after an interruption, the last may lack strings

    def _block(self, plan: Plan, first: int, last: int) -> Block:
        rows = slice(first, last)
        time = plan.ticks[rows] / (1e9 * plan.clock[PER_NS])
        return Block(time, plan.real_block[rows], plan.int_block[rows], self._text_rows[rows])

    def _keep_rows(self, plan: Plan, n: int) -> None:
        first = self._in_journal["rows"]
        if n > first and not self._journal_fails:
            with self._writing("signals.arrows"):
                self._journal.rows(self._block(plan, first, n))
            self._in_journal["rows"] = n

    def _keep_packets(self, radio: Radio) -> None:
        if not self._keep:
            return
        events, log = int(radio.counters[USED_EVENTS]), int(radio.counters[USED_LOG])
        first = self._in_journal["events"]
        if events > first and not self._journal_fails:
            with self._writing("packets.arrows"):
                self._journal.packets(self._event_table(radio.events[first:events]))
            self._in_journal["events"] = events
        first = self._in_journal["log"]
        if log > first:
            with self._writing("packets.tlog"):
                self._in_journal["log"] = log
                self._write_tlogs(radio.log[first:log].tobytes())
                for file in self._tlogs.values():
                    file.flush()

    def _end_group(self, what: str) -> None:
        if not self._journal_fails:
            with self._writing(f"{what}.arrows"):
                self._journal.end_group(what)

    @contextmanager
    def _writing(self, name: str) -> Iterator[None]:
        """Raises RecordingFailed if a file cannot be written, and prevents further attempts."""
        try:
            yield
        except OSError as error:
            if name.endswith(".arrows"):
                self._journal_fails = True
            elif name != NAME:
                self._files_fail = True
            folder = self.folder if name.endswith((".tlog", ".json")) else self.folder / FOLDER
            raise RecordingFailed(str(folder / name), error.strerror or str(error)) from None

    def _event_table(self, events: np.ndarray[Any, Any]) -> pa.Table:
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
            for f in self._event_schema
        ]
        return pa.Table.from_arrays(arrays, schema=self._event_schema)

    def _write_tlogs(self, block: bytes) -> None:
        position = 0
        while position < len(block):
            ticks, entry, length = struct.unpack_from("<qii", block, position)
            node, sent = entry >> 1, entry & 1
            stamped = struct.pack(">Q", EPOCH + ticks // 1000) + block[position + 16 : position + 16 + length]
            if node < len(self._nodes):
                self._tlogs[node].write(stamped)
            if sent:
                self._tlogs[-1].write(stamped)
            position += 16 + length

    # ---- the end -----------------------------------------------------------------------------------------------------

    def finish(self, plan: Plan, radio: Radio) -> None:
        """Completes all files but the manifest.

        Raises:
            RecordingFailed: a file cannot be completed; the journal remains, with all values that could be written.
        """
        with suppress(RecordingFailed):  # values that the journal cannot store may still fit into the files
            self._keep_rows(plan, self._complete_rows(plan))
            self._keep_packets(radio)
        if self._files_fail:
            raise RecordingFailed(str(self.folder), "its files cannot be completed")
        self.rows(plan)
        self.packets(radio)
        self._complete()

    def _complete(self) -> None:
        with self._writing("signals.parquet"):
            for segment in self.segments():
                segment.unlink()
            self._signals.close()
        with self._writing("packets.parquet"):
            if self._events is not None:
                self._events.close()
        with self._writing("packets.tlog"):
            for file in self._tlogs.values():
                file.close()
        with self._writing("signals.parquet"):
            for file in sorted((self.folder / FOLDER).glob("*.parquet")):
                file.replace(self.folder / file.name)

    def write_manifest(self, manifest: Mapping[str, Any]) -> None:
        """Replaces the manifest, once all other files are complete, or are known to remain incomplete.

        Raises:
            RecordingFailed: the disk has no space for it; the existing manifest then has the outcome.
        """
        try:
            write_manifest(self.folder, manifest)
        except OSError as error:
            with suppress(OSError, ValueError):
                self._manifest.update({name: manifest[name] for name in _CHANGING} | {"outcome": "failed"})
            if not self._files_fail:
                self._remove_journal()
            raise RecordingFailed(str(self.folder / NAME), error.strerror or str(error)) from None
        finally:
            self._close_all()
        if not self._files_fail:
            self._remove_journal()

    def break_off(self, plan: Plan, radio: Radio, progress: Mapping[str, Any]) -> None:
        """Closes the incomplete files; all values recorded are in the journal."""
        with suppress(RecordingFailed):
            self.keep(plan, radio, progress)
        self._close_all()

    def abandon(self) -> None:
        """Ends the recording of a run that has not begun: it has no manifest."""
        with suppress(RecordingFailed):
            self._complete()
        self._remove_journal()
        (self.folder / NAME).unlink(missing_ok=True)

    def _remove_journal(self) -> None:
        self._close_all()
        shutil.rmtree(self.folder / FOLDER, ignore_errors=True)

    def _close_all(self) -> None:
        with suppress(OSError):
            self._opened.close()


def _refusal(folder: Path, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(folder)), text)])


def _readable(checkpoint: Checkpoint, name: str) -> list[Path]:
    """Returns the file of that name of a run, or the segments of its checkpoints if it was killed before."""
    whole = checkpoint.run / name
    try:
        pq.ParquetFile(whole).close()
    except (OSError, ValueError):
        return segments(checkpoint, name)
    return [whole]


def _file_name(node: str) -> str:
    """Returns a node's name as a file name: characters not allowed there are percent-encoded, as in a URI."""
    return re.sub(r'[%/\\:*?"<>|\x00-\x1f]|^\.+', lambda found: "".join(f"%{ord(c):02X}" for c in found[0]), node)

"""The files of a run: signals, packets, and a manifest of its inputs and outcome.

    OUT/manifest.json     what was run, with what, and how it ended
    OUT/signals.parquet   column `time` [s], then `component.variable`; units and descriptions in the field metadata
    OUT/packets.parquet   every packet on its way to every node: sent, arrival, addresses, outcome
    OUT/packets.tlog      all packets sent, in the order of time, as ground stations replay them
    OUT/packets/NODE.tlog what one node sent and received over the radio, or a gateway by its link

A .tlog is a sequence of 8-byte big-endian microseconds and one packet. Its clock begins at `EPOCH`, since tools
read it as a date.

The recorder reads; it never touches what it observes. Files are complete up to the last flush at any time but for
Parquet's footer, which `close` writes. For a run that may be killed before that, what is recorded between two
checkpoints is written to files of its own as well (segments), which are complete at each of them.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.network.radio.tables import EVENT, OUTCOMES, USED_EVENTS, USED_LOG, Radio
from cosim_master.results.checkpoint_folder import Checkpoint, Position, segments
from cosim_master.results.run_folder import clear
from cosim_master.stepping.kernels.tables import PER_NS, ROWS, Plan
from cosim_master.stepping.layout import KINDS, Layout
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network

__all__ = ["EPOCH", "Recorder"]

EPOCH = 1_735_689_600_000_000
"""Microseconds from 1970 to 2025-01-01T00:00:00Z, where the clock of .tlog files begins."""

_ROW_GROUP = 1024 * 1024
"""Rows; pyarrow divides longer tables."""
_ARROW = {"Real": pa.float64(), "Integer": pa.int32(), "Boolean": pa.bool_(), "String": pa.string()}
_WIDE = {"UInt32": pa.uint32(), "Int64": pa.int64(), "UInt64": pa.uint64()}


class Recorder:
    """Writes the files of one run. Call `rows` and `packets` whenever the loop returns, `close` at the end."""

    def __init__(
        self,
        folder: Path,
        checked: CheckedSystem,
        layout: Layout,
        network: Network,
        *,
        keep: bool,
        checkpoint: Checkpoint | None = None,
        in_segments: bool = False,
    ) -> None:
        self.folder = folder
        self._in_segments = in_segments
        self._open_segments: dict[str, Any] = {}
        folder.mkdir(parents=True, exist_ok=True)
        clear(folder)  # an old manifest would call the results complete while they are not
        self._texts = layout.string_signals
        self._text_rows: list[list[str]] = []
        self._columns = self._in_order(checked, layout)
        fields = [pa.field("time", pa.float64(), metadata={"unit": "s"})]
        for name, kind, _, variable in self._columns:
            metadata = {"unit": variable.unit.name if variable.unit else "", "description": variable.description}
            if variable.items:
                metadata["items"] = json.dumps(dict(variable.items))
            arrow = _WIDE[variable.fmi_type] if variable.wide else _ARROW[kind]
            fields.append(pa.field(name, arrow, metadata=metadata))
        self._schema = pa.schema(fields)
        # Floating-point time series hardly repeat, so dictionaries only cost; splitting bytes compresses them better.
        floats = [f.name for f in self._schema if pa.types.is_floating(f.type)]
        self._signals = pq.ParquetWriter(
            folder / "signals.parquet",
            self._schema,
            compression="zstd",
            use_dictionary=False,
            column_encoding=dict.fromkeys(floats, "BYTE_STREAM_SPLIT"),
        )
        self._keep = keep and bool(network.nodes)
        gateways = [gateway.name for gateway in network.gateways]
        self._nodes = [node.name for node in network.nodes] + gateways
        self._endpoints = [e.name for node in network.nodes for e in node.endpoints] + gateways
        self._events: Any = None
        self._tlogs: dict[int, Any] = {}
        if self._keep:
            (folder / "packets").mkdir(exist_ok=True)
            self._event_schema = _event_schema()
            self._events = pq.ParquetWriter(folder / "packets.parquet", self._event_schema, compression="zstd")
            for n, name in enumerate(self._nodes):
                self._tlogs[n] = (folder / "packets" / f"{_file_name(name)}.tlog").open("wb")
            self._tlogs[-1] = (folder / "packets.tlog").open("wb")
        self._groups = {"signals": 0, "packets": 0}
        if checkpoint is not None:
            self._take_over(checkpoint)

    def position(self) -> Position:
        """Returns the position of the recording, after writing everything out."""
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
        self._groups[what] += -(-table.num_rows // _ROW_GROUP) or 1

    def _segment(self, what: str) -> Path:
        return self.folder / "checkpoints" / f"{what}.parquet"

    def segments(self) -> list[Path]:
        """The segments since this was last called, complete; they are the caller's now."""
        for writer in self._open_segments.values():
            writer.close()
        done = [self._segment(what) for what in self._open_segments]
        self._open_segments.clear()
        return done

    def _take_over(self, checkpoint: Checkpoint) -> None:
        """Copies the recording of a checkpoint's run up to the checkpoint: the same row groups, the same bytes."""
        sources = (
            ("signals", self._signals, self._schema, checkpoint.position.signals),
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
                            self._write(name, writer, old.read_row_group(group).cast(schema))
                if (found := self._groups[name] - before) != groups:
                    raise ValueError(f"of {groups} row groups of {name}.parquet there are {found}")
            for file in self._tlogs.values():
                name = str(Path(file.name).relative_to(self.folder))
                with (checkpoint.run / name).open("rb") as old_log:
                    file.write(old_log.read((checkpoint.position.tlogs or {})[name]))
        except (OSError, ValueError, KeyError) as error:
            self.close_files()
            text = f"its recording up to {checkpoint.time:.9g} s cannot be taken over: {error}"
            raise SystemDescriptionError([Problem(Where(str(checkpoint.run)), text)]) from None

    @staticmethod
    def _in_order(checked: CheckedSystem, layout: Layout) -> list[tuple[str, str, int, Any]]:
        """Columns in the order of instances and their variables: (name, kind, column of the block, variable)."""
        known = {}
        for kind in KINDS:
            column = 0
            for name, v in layout.signals[kind]:
                known[name] = (kind, column, v)
                column += 1 + v.wide
        known |= {name: ("String", i, v) for i, (name, _, v) in enumerate(layout.string_signals)}
        columns = []
        for instance in checked.instances:
            for variable in instance.fmu.variables:
                name = f"{instance.name}.{variable}"
                if name in known:
                    columns.append((name, *known[name]))
        return columns

    def texts(self, values: list[str]) -> None:
        """The values of all recorded String variables for the row just recorded."""
        self._text_rows.append(values)

    def unwritten_texts(self) -> list[list[str]]:
        """Returns the rows given to `texts` since rows were last written."""
        return list(self._text_rows)

    def take_back(self) -> None:
        """Discards the rows given to `texts` since rows were last written: the run has gone back to that time."""
        self._text_rows.clear()

    def rows(self, plan: Plan) -> None:
        """Writes the rows of the loop's block and empties it."""
        n = int(plan.clock[ROWS])
        if self._texts:
            n = min(n, len(self._text_rows))  # interrupted in between, the last row has no strings yet
        if n == 0:
            return
        integers = sum(1 + v.wide for _, kind, _, v in self._columns if kind == "Integer")
        booleans = plan.int_block[:, integers:]
        blocks: dict[str, Any] = {"Real": plan.real_block, "Integer": plan.int_block, "Boolean": booleans}
        arrays = [pa.array(plan.ticks[:n] / (1e9 * plan.clock[PER_NS]))]
        for _, kind, column, variable in self._columns:
            if kind == "String":
                arrays.append(pa.array([row[column] for row in self._text_rows[:n]], type=pa.string()))
            elif variable.wide:
                halves = np.ascontiguousarray(plan.int_block[:n, column : column + 2])
                values = halves.view(np.uint64 if variable.fmi_type == "UInt64" else np.int64)[:, 0]
                arrays.append(pa.array(values).cast(_WIDE[variable.fmi_type]))
            else:
                values = blocks[kind][:n, column]
                arrays.append(pa.array(values.astype(bool) if kind == "Boolean" else values))
        self._write("signals", self._signals, pa.Table.from_arrays(arrays, schema=self._schema))
        self._text_rows.clear()
        plan.clock[ROWS] = 0

    def packets(self, radio: Radio) -> None:
        """Writes packet events and logs and empties their blocks."""
        events, used = radio.counters[USED_EVENTS], radio.counters[USED_LOG]
        if self._keep and events:
            self._write_events(radio.events[:events])
        if self._keep and used:
            self._write_tlogs(radio.log[:used].tobytes())
        radio.counters[[USED_EVENTS, USED_LOG]] = 0

    def _write_events(self, events: np.ndarray[Any, Any]) -> None:
        arrival = events["arrival"] / 1e9
        names = np.array([*self._nodes, ""], dtype=object)
        columns: dict[str, Any] = {
            "sent": events["sent"] / 1e9,
            "arrival": pa.array(arrival, mask=events["arrival"] < 0),
            "source": np.array(self._endpoints, dtype=object)[events["source"]],
            "target": names[events["target"]],
            **{name: events[name] for name in EVENT.names or () if name in _PLAIN},
            "outcome": np.array(OUTCOMES, dtype=object)[events["outcome"]],
        }
        arrays = [
            column if isinstance(column := columns[f.name], pa.Array) else pa.array(column, type=f.type)
            for f in self._event_schema
        ]
        self._write("packets", self._events, pa.Table.from_arrays(arrays, schema=self._event_schema))

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

    def close(self, manifest: Mapping[str, Any]) -> None:
        """Finishes all files. The manifest comes last: where it is, the rest is complete."""
        self.close_files()
        self.write_manifest(manifest)

    def write_manifest(self, manifest: Mapping[str, Any]) -> None:
        """Writes the manifest, in place of an earlier one."""
        text = json.dumps(manifest, indent=1, ensure_ascii=False, allow_nan=False)
        (self.folder / "manifest.json").write_text(text + "\n", encoding="utf-8")

    def close_files(self) -> None:
        """All but the manifest: for a run that never began."""
        for segment in self.segments():
            segment.unlink()
        self._signals.close()
        if self._events is not None:
            self._events.close()
        for file in self._tlogs.values():
            file.close()


def _readable(checkpoint: Checkpoint, name: str) -> list[Path]:
    """The file of that name of a run, or the segments of its checkpoints if it was killed before it was complete."""
    whole = checkpoint.run / name
    try:
        pq.ParquetFile(whole).close()
    except (OSError, ValueError):
        return segments(checkpoint, name)
    return [whole]


def _file_name(node: str) -> str:
    """Returns a node's name as a file name: characters that are not allowed there are percent-encoded, as in a URI."""
    return re.sub(r'[%/\\:*?"<>|\x00-\x1f]|^\.+', lambda found: "".join(f"%{ord(c):02X}" for c in found[0]), node)


_PLAIN = ("message", "system", "component", "sequence", "length")


def _event_schema() -> pa.Schema:
    seconds = {"unit": "s"}
    return pa.schema(
        [
            pa.field("sent", pa.float64(), metadata=seconds),
            pa.field("arrival", pa.float64(), metadata=seconds),
            pa.field("source", pa.string(), metadata={"description": "instance that sent it"}),
            pa.field("target", pa.string(), metadata={"description": "node it was for"}),
            *(pa.field(name, pa.int32()) for name in _PLAIN),
            pa.field("outcome", pa.string()),
        ]
    )

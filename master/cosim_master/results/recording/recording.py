"""The files of a run: signals, packets, and a manifest of its inputs and outcome.

    OUT/manifest.json     the system, the options and the outcome; during the run, its progress
    OUT/signals.parquet   column `time` [s], then `component.variable`; units and descriptions in the field metadata
    OUT/packets.parquet   every packet on its way to every node: sent, arrival, addresses, outcome
    OUT/packets.tlog      all packets sent, in the order of time, as ground stations replay them
    OUT/packets/NODE.tlog packets that a node sent and received by radio, or a gateway by its link
    OUT/unfinished/       during the run, in place of the Parquet files: see `journal`

The files are written by observers of the run (`signals`, `packet_log`, and the manifest's own). Chunks that are not
complete are appended to the journal, so that all values recorded so far remain readable even if the process is killed.
The finished files consist of complete chunks, so they do not depend on the journal. The values recorded between two
checkpoints are also written to separate files (segments), which belong to the checkpoints.
"""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import CosimError, Problem, RecordingFailed, SystemDescriptionError, Where
from cosim_master.results.reading.links import Links, in_manifest, read_links
from cosim_master.results.recording.behind import Behind
from cosim_master.results.recording.packet_log import PacketLog, log_names
from cosim_master.results.recording.signals import SignalRecorder
from cosim_master.results.recording.table_file import Faults, TableFile
from cosim_master.results.storage.checkpoint_folder import Checkpoint, Position, segments
from cosim_master.results.storage.columns import columns_of
from cosim_master.results.storage.journal import FOLDER, Journal, goes_on, journal_of
from cosim_master.results.storage.manifest_file import NAME, RunningManifest, write_manifest
from cosim_master.results.storage.parquet import packets_schema, packets_writer, signals_writer
from cosim_master.results.storage.run_folder import clear
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import Observer, Progress, Seen
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network

__all__ = ["Recording", "check_columns"]

_CHANGING = ("outcome", "simulated_s", "wall_s", "real_time_factor", "packets")
"""Keys of the manifest that change during the run."""
_AHEAD = 64
"""Calls that wait for the thread of the journal; signals and packets have smaller limits of their own."""


class _Advancing:
    """The observer that writes the progress of the run to its manifest."""

    every = 0

    def __init__(self, manifest: RunningManifest, file: Path, faults: Faults, behind: Behind) -> None:
        self._manifest, self._file, self._faults, self._behind = manifest, file, faults, behind

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...

    def progressed(self, progress: Progress) -> None:
        """Writes the progress when all values up to it are in the journal.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        if not progress.kept:
            return
        simulated, wall = progress.time - progress.start, progress.wall
        now = {"simulated_s": simulated, "packets": dict(progress.counts)}
        now |= {"wall_s": wall, "real_time_factor": simulated / wall if wall > 0 else 0.0}
        self._behind.call(partial(self._update, now))
        self._faults.check()

    def _update(self, now: Mapping[str, Any]) -> None:
        with self._faults.noted(self._file):
            self._manifest.update(now)


class Recording:
    """The folder of one run while it is recorded.

    As a context, it closes all files at its end. Unless `finish` was called before, it leaves the folder as a killed
    process would, without losing any values.

    Args:
        packets: record packet events and logs.
        manifest: the manifest during the run, with the outcome "running".
        checkpoint: the new recording begins with the recording up to this checkpoint.
        in_segments: write segments for checkpoints.

    Attributes:
        observers: the observers of the run that write the files.

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
        packets: bool,
        manifest: Mapping[str, Any],
        checkpoint: Checkpoint | None = None,
        in_segments: bool = False,
    ) -> None:
        self.folder = folder
        self._in_segments = in_segments
        self._columns = columns_of(checked, layout)
        self._faults, self._behind = Faults(), Behind("journal of a run", _AHEAD)
        self._files: dict[str, TableFile] = {}
        self._log: PacketLog | None = None
        self._links: Links | None = None
        self._opened = ExitStack()
        if goes_on(folder):
            raise _refusal(folder, "another run is being recorded there; give another folder")
        try:
            self._open(manifest, network if packets and network.nodes else None)
        except OSError as error:
            self._close()
            shutil.rmtree(folder / FOLDER, ignore_errors=True)
            many = "; raise the limit of open files (ulimit -n)" if error.errno in (errno.EMFILE, errno.ENFILE) else ""
            raise _refusal(folder, f"cannot hold the results of a run: {error.strerror or error}{many}") from None
        self.observers: list[Observer] = [self._signals, *([] if self._log is None else [self._log]), self._advancing]
        if checkpoint is not None:
            self._take_over(checkpoint)

    def _open(self, manifest: Mapping[str, Any], network: Network | None) -> None:
        folder = self.folder
        folder.mkdir(parents=True, exist_ok=True)
        clear(folder)  # an old manifest would call incomplete results complete
        journal = Journal(folder, self._columns, packets_schema() if network is not None else None)
        self._opened.enter_context(closing(journal))
        writer = signals_writer(folder / FOLDER / "signals.parquet", self._columns.schema)
        self._signals = SignalRecorder(self._table_file("signals", writer, journal), self._columns, self._behind)
        if network is not None:
            (folder / "packets").mkdir(exist_ok=True)
            file = self._table_file("packets", packets_writer(folder / FOLDER / "packets.parquet"), journal)
            logs = [self._opened.enter_context((folder / name).open("wb")) for name in log_names(network)]
            self._log = PacketLog(file, network, logs, self._behind)
        self._manifest = self._opened.enter_context(closing(RunningManifest(folder, manifest, *_CHANGING)))
        self._advancing = _Advancing(self._manifest, folder / NAME, self._faults, self._behind)
        self._opened.callback(self._behind.stop)  # before all others: it writes to the files

    def _table_file(self, what: str, writer: Any, journal: Journal) -> TableFile:
        self._opened.enter_context(closing(writer))
        file = TableFile(self.folder, what, writer, journal, self._faults, in_segments=self._in_segments)
        self._opened.callback(file.behind.stop)
        self._files[what] = file
        return file

    # ---- checkpoints -------------------------------------------------------------------------------------------------

    def position(self) -> Position:
        """Returns the position of the recording, after writing all values so far.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        self._signals.end_group()
        if self._log is not None:
            self._log.end_group()
        self._written()
        groups = {what: file.groups for what, file in self._files.items()}
        return Position(**groups, tlogs={} if self._log is None else self._log.lengths())

    def segments(self) -> list[Path]:
        """Returns the complete segments since the last call; the caller then owns them.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        self._written()
        found = [segment for file in self._files.values() for segment in file.segment()]
        self._faults.check()
        return found

    def _written(self) -> None:
        """Waits for all that the threads have to write. Raises RecordingFailed."""
        self._behind.wait()
        for file in self._files.values():
            file.behind.wait()
        self._faults.check()

    def _take_over(self, checkpoint: Checkpoint) -> None:
        """Copies the recording of a checkpoint's run up to the checkpoint: the same row groups, the same bytes."""
        position = checkpoint.position
        try:
            self._copy(checkpoint, self._signals, "signals", self._columns.schema, position.signals)
            if self._log is not None:
                self._copy(checkpoint, self._log, "packets", packets_schema(), position.packets)
                self._log.take_over_logs(checkpoint.run, position.tlogs or {})
            self._written()
        except (OSError, ValueError, KeyError, RecordingFailed) as error:
            self._close()
            clear(self.folder)
            raise _cannot_take_over(checkpoint, str(error)) from None

    def _copy(
        self, checkpoint: Checkpoint, into: SignalRecorder | PacketLog, name: str, schema: Any, groups: int
    ) -> None:
        file = self._files[name]
        for source in _readable(checkpoint, f"{name}.parquet"):
            with pq.ParquetFile(source) as old:
                for group in range(min(old.num_row_groups, groups - file.groups)):
                    into.take_over(old.read_row_group(group).cast(schema))
        if file.groups != groups:
            raise ValueError(f"of {groups} row groups of {name}.parquet there are {file.groups}")

    # ---- the end -----------------------------------------------------------------------------------------------------

    def finish(self, manifest: Callable[[RecordingFailed | None], Mapping[str, Any]]) -> RecordingFailed | None:
        """Completes the folder of a run whose observers are closed, and writes its manifest.

        Args:
            manifest: returns the manifest; its argument is the reason why the recording cannot be completed.

        Returns:
            The reason why the recording is incomplete; None if it is complete.
        """
        failure = None
        try:
            self._complete()
        except RecordingFailed as error:
            failure = error
        try:
            self.write_manifest(manifest(failure))
        except RecordingFailed as error:
            failure = failure or error
        return failure

    def _complete(self) -> None:
        with suppress(RecordingFailed):  # of the journal alone: the files can do without it
            self._written()
        if self._faults.failure is None:
            with self._faults.noted(self.folder / "signals.parquet"):
                for file in sorted((self.folder / FOLDER).glob("*.parquet")):
                    file.replace(self.folder / file.name)
        if self._faults.failure is not None:
            raise self._faults.failure
        self.links()

    def links(self) -> Links | None:
        """Returns the links by radio, once the observers are closed; None: packets are not recorded, or incomplete.

        Until the files are complete, the journal has the packets.
        """
        if self._log is not None and self._links is None:
            self._behind.wait()
            if not self._faults.journal or journal_of(self.folder, "packets") is None:
                with suppress(CosimError):  # a failed run may have recorded less than a file
                    self._links = read_links(self.folder)
        return self._links

    def write_manifest(self, manifest: Mapping[str, Any]) -> None:
        """Replaces the manifest, once all other files are complete, or are known to remain incomplete.

        The recording adds `links`, the statistics of the links by radio.

        Raises:
            RecordingFailed: the disk has no space for it; the existing manifest then has the outcome.
        """
        links = None if self._links is None else in_manifest(self._links)
        try:
            write_manifest(self.folder, {**manifest, "links": links})
        except OSError as error:
            with suppress(OSError, ValueError):
                self._manifest.update({name: manifest[name] for name in _CHANGING} | {"outcome": "failed"})
            raise RecordingFailed(str(self.folder / NAME), error.strerror or str(error)) from None
        finally:
            self._close()
            if not self._faults.files:
                shutil.rmtree(self.folder / FOLDER, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def _close(self) -> None:
        with suppress(OSError):
            self._opened.close()


def check_columns(checkpoint: Checkpoint, checked: CheckedSystem, layout: Layout) -> None:
    """Checks that the run of a checkpoint recorded the signals that this run records.

    Raises:
        SystemDescriptionError: it recorded others.
    """
    schema = columns_of(checked, layout).schema
    try:
        same = all(
            pq.read_schema(source).equals(schema, check_metadata=False)
            for source in _readable(checkpoint, "signals.parquet")
        )
    except (OSError, ValueError) as error:
        raise _cannot_take_over(checkpoint, str(error)) from None
    if not same:
        raise _cannot_take_over(checkpoint, "signals.parquet has other columns than this run records")


def _cannot_take_over(checkpoint: Checkpoint, why: str) -> SystemDescriptionError:
    text = f"its recording up to {checkpoint.time:.9g} s cannot be taken over: {why}"
    return SystemDescriptionError([Problem(Where(str(checkpoint.run)), text)])


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

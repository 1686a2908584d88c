"""Completes the recording of a run whose process was killed, or whose disk was full.

    signals.parquet, packets.parquet   from the journal, with the row groups that the run would have written
    *.tlog                             without the packet that was being written
    manifest.json                      outcome "killed", the progress of the run, the last counts of packets, the links

Except for the manifest, the files are equal byte for byte to those of a run that ends at this time.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import CosimError, Problem, RecordingFailed, SystemDescriptionError, Where
from cosim_master.results.reading.links import statistics
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.storage.journal import FOLDER, goes_on, groups_of, schema_of
from cosim_master.results.storage.last_call import last_call
from cosim_master.results.storage.manifest_file import NAME, UNWRITTEN, no_run, write_manifest
from cosim_master.results.storage.parquet import packets_writer, signals_writer

__all__ = ["repair"]

_STAMP = 8
_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
_SIGNED, _SIGNATURE = 1, 13


def repair(run: Path) -> dict[str, Any]:
    """Completes the files of a run; complete files are not changed.

    Returns:
        The manifest.

    Raises:
        SystemDescriptionError: the folder contains no run, a run in progress, one that never recorded anything, or a
            complete one whose files have been damaged since.
        RecordingFailed: the files cannot be written; nothing is lost.
    """
    if goes_on(run):
        raise _refusal(run, "the run goes on; end it with Ctrl-C or SIGTERM")
    manifest = _manifest(run)
    if manifest["outcome"] != "running" and not (run / FOLDER).is_dir():
        try:
            open_signals(run).close()
        except CosimError as error:
            raise _refusal(run, f"nothing is left to complete its recording from: {error}") from None
        return manifest
    try:
        for what in ("signals", "packets"):
            _complete(run, what)
        for log in (run / "packets.tlog", *sorted(run.glob("packets/*.tlog"))):
            if log.is_file():
                _cut(log)
        if manifest["outcome"] == "running":
            manifest["outcome"] = "killed"
            manifest["error"] = f"the process was killed after {manifest['simulated_s']:.9g} s of simulated time"
            if (call := last_call(run)) is not None:
                manifest["error"] += f"; the last call of an FMU in it was {call}"
        elif manifest["outcome"] == "failed" and manifest["error"] is None:
            manifest["error"] = UNWRITTEN
        manifest["links"] = statistics(run) if (run / "packets.parquet").is_file() else None
        write_manifest(run, manifest)
    except OSError as error:
        raise RecordingFailed(error.filename or str(run), error.strerror or str(error)) from None
    shutil.rmtree(run / FOLDER, ignore_errors=True)
    return manifest


def _manifest(run: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads((run / NAME).read_text(encoding="utf-8"))
        if not isinstance(found["outcome"], str) or not math.isfinite(found["simulated_s"]):
            raise ValueError("it does not say how far the run came")
    except FileNotFoundError:
        raise _refusal(run, no_run(run, NAME)) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _refusal(run, f"{NAME} is not the manifest of a run: {error!r}") from None
    return found


def _complete(run: Path, what: str) -> None:
    file, journal = run / f"{what}.parquet", run / FOLDER / f"{what}.arrows"
    if file.is_file() or not journal.is_file():
        return
    try:
        schema = schema_of(journal)
    except CosimError as error:
        raise _refusal(run, str(error)) from None
    part = run / FOLDER / f"{what}.parquet"
    with signals_writer(part, schema) if what == "signals" else packets_writer(part) as writer:
        for group in groups_of(journal):
            writer.write_table(group)
    part.replace(file)


def _cut(log: Path) -> None:
    """Removes an incomplete packet from the end of a .tlog."""
    content = log.read_bytes()
    end = max(_ends(content), default=0)
    if end < len(content):
        with log.open("r+b") as file:
            file.truncate(end)


def _ends(content: bytes) -> Iterator[int]:
    """Returns the end of each complete packet of a .tlog."""
    at = 0
    while len(content) - at >= _STAMP + 3:
        magic, length, flags = content[at + _STAMP : at + _STAMP + 3]
        if magic not in (_MAVLINK_1, _MAVLINK_2):
            yield len(content)  # not a packet, so its end is unknown
            return
        if magic == _MAVLINK_2:
            size = length + 12 + (_SIGNATURE if flags & _SIGNED else 0)
        else:
            size = length + 8
        at += _STAMP + size
        if at > len(content):
            return
        yield at


def _refusal(run: Path, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(run)), text)])

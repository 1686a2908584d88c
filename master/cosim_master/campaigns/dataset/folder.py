"""The folder of a campaign. The client of the cluster is its only writer.

    OUT/study.json               the study, and the digests of its system and FMUs
    OUT/journal.jsonl            rows of runs that have ended since the last part: one line each
    OUT/runs/part-000001.parquet rows, a hundred or more in each part: together the dataset
    OUT/signals/run=12/signals.parquet  signals kept of run 12
    OUT/summary.json             how the campaign ended
    OUT/lock                     locked while a campaign writes

A row is a line of the journal before anything else happens, so no run that has ended is run again, even if the process
is killed. A part is written under another name and renamed. If the process is killed between that and the removal of
the lines, a row is in both; readers take each run once.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.campaigns.dataset.table import schema_of, sorted_table
from cosim_master.campaigns.refusal import refusal
from cosim_master.campaigns.study.study import Study
from cosim_master.diagnostics.errors import CosimError

try:
    import fcntl
except ImportError:  # not POSIX: nothing keeps two campaigns apart there
    fcntl = None  # type: ignore[assignment]

__all__ = ["Folder", "is_campaign", "read_runs", "read_study"]

_ROWS, _SECONDS = 500, 15.0
"""Rows, and wall-clock seconds, after which the rows of the journal become a part."""


def is_campaign(folder: Path) -> bool:
    """Returns whether a folder holds a campaign."""
    return (folder / "study.json").is_file()


def read_study(folder: Path) -> tuple[Study, dict[str, Any], float]:
    """Returns the study of a campaign, the digests of its inputs by name, and the time at which its runs begin, s.

    Campaigns of earlier versions do not say when their runs begin; 0 is returned for them.

    Raises:
        SystemDescriptionError: the folder holds no campaign, or its study is damaged.
    """
    file = folder / "study.json"
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        return Study.of_json(told["study"]), dict(told["inputs"]), float(told.get("begin", 0.0))
    except (FileNotFoundError, NotADirectoryError):
        raise refusal(str(folder), "not the folder of a campaign: it has no study.json") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise refusal(str(file), f"not the study of a campaign: {error!r}") from None


def read_runs(folder: Path | str) -> pa.Table:
    """Returns the runs of a campaign that have ended so far, one row for each, in the order of their numbers.

    Args:
        folder: that of the campaign, whether it is complete, in progress or was killed.

    Raises:
        SystemDescriptionError: the folder holds no campaign.
        CosimError: a part is damaged.
    """
    study, _, _ = read_study(Path(folder))
    return _read(Path(folder), schema_of(study))


def _read(folder: Path, schema: pa.Schema) -> pa.Table:
    rows: list[Mapping[str, Any]] = []
    for part in sorted((folder / "runs").glob("part-*.parquet")):
        try:
            with pq.ParquetFile(part) as found:  # `read_table` would import pandas, where it is installed
                rows += found.read().cast(schema).to_pylist()
        except (pa.ArrowException, OSError, ValueError) as error:
            text = "remove it, and repeat the campaign, which then makes its runs again"
            raise CosimError(f"{part}: this part of the dataset is damaged ({error}); {text}") from None
    return sorted_table([*rows, *_journalled(folder / "journal.jsonl")], schema)


def _journalled(file: Path) -> list[Mapping[str, Any]]:
    """Returns the rows of a journal; a last line that was cut short is left out."""
    try:
        lines = file.read_bytes().split(b"\n")
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in lines[:-1]]


class Folder:
    """The folder of a campaign that writes to it.

    Args:
        path: the folder; it is made if necessary.
        study: the study.
        inputs: digests of its system and FMUs, by name.
        begin: the time at which its runs begin, s.
        force: remove a campaign of other inputs.

    Attributes:
        done: the numbers of the runs that have ended, in this campaign or before.

    Raises:
        SystemDescriptionError: the folder holds something else, or a campaign that goes on.
        CosimError: it cannot be written.
    """

    def __init__(
        self, path: Path, study: Study, inputs: Mapping[str, str], *, begin: float = 0.0, force: bool = False
    ) -> None:
        self.path, self.study, self.schema, self._begin = path, study, schema_of(study), begin
        if not is_campaign(path) and any((path / name).exists() for name in ("manifest.json", "runs", "signals")):
            raise refusal(str(path), "holds something else than a campaign; give another folder")
        try:
            (path / "runs").mkdir(parents=True, exist_ok=True)
            self._lock = (path / "lock").open("wb")
        except OSError as error:
            raise refusal(str(path), f"cannot hold a campaign: {error.strerror}; give another folder") from None
        self._locked()
        try:
            self._agree(study, dict(inputs), force=force)
            rows = _read(path, self.schema).to_pylist()
            self._parts = max((int(one.stem[5:]) for one in (path / "runs").glob("part-*.parquet")), default=0)
            journal = path / "journal.jsonl"
            self._rows: list[Mapping[str, Any]] = _journalled(journal)
            with self._writing():
                self._journal = self._rewritten(journal)
        except BaseException:
            self._lock.close()
            raise
        self.done = {int(row["run"]) for row in rows}
        self.outcomes = {int(row["run"]): str(row["outcome"]) for row in rows}
        self._sought = {} if study.search is None else {int(row["run"]): row[study.search.metric] for row in rows}
        self._since = time.monotonic()

    def _locked(self) -> None:
        if fcntl is None:
            return
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise refusal(str(self.path), "holds a campaign that goes on; wait, or give another folder") from None

    def _agree(self, study: Study, inputs: dict[str, str], *, force: bool) -> None:
        """Compares the study with that of the folder, and writes it if there is none."""
        file = self.path / "study.json"
        if file.is_file() and not force:
            other, held, _ = read_study(self.path)
            names = [name for name in dict.fromkeys([*inputs, *held]) if inputs.get(name) != held.get(name)]
            if other.digest() != study.digest():
                mine, its = study.as_json(), other.as_json()
                names = [*names, *(name for name in mine if name != "system" and mine[name] != its[name])]
            if names:
                text = f"holds a campaign of another study ({', '.join(names)})"
                raise refusal(str(self.path), f"{text}; give another folder, or --force to remove it")
            return
        shutil.rmtree(self.path / "runs")
        shutil.rmtree(self.path / "signals", ignore_errors=True)
        for name in ("journal.jsonl", "summary.json", "search.log"):
            (self.path / name).unlink(missing_ok=True)
        with self._writing():
            (self.path / "runs").mkdir()
        self.write_json("study.json", {"study": study.as_json(), "inputs": inputs, "begin": self._begin})

    def _rewritten(self, file: Path) -> IO[bytes]:
        """Opens the journal with its complete rows only."""
        part = file.with_suffix(".part")
        part.write_bytes(b"".join(_line(row) for row in self._rows))
        part.replace(file)
        return file.open("ab", buffering=0)

    def add(self, row: Mapping[str, Any], signals: bytes = b"") -> None:
        """Adds a run that has ended, unless it has a row already.

        Args:
            signals: a Parquet file with the signals that are kept; empty if there are none.

        Raises:
            CosimError: the row cannot be written.
        """
        number = int(row["run"])
        if number in self.done:
            return
        with self._writing():
            if signals:
                folder = self.path / "signals" / f"run={number}"
                folder.mkdir(parents=True, exist_ok=True)
                part = folder / ".signals.parquet"
                part.write_bytes(signals)
                part.replace(folder / "signals.parquet")
            self._journal.write(_line(row))
            self._rows.append(row)
            self.done.add(number)
            self.outcomes[number] = str(row["outcome"])
            if self.study.search is not None:
                self._sought[number] = row.get(self.study.search.metric)
            if len(self._rows) >= _ROWS or time.monotonic() - self._since >= _SECONDS:
                self.write_part()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise CosimError(f"{self.path}: the campaign cannot be written: {error.strerror or error}") from None

    def write_part(self) -> None:
        """Makes the rows of the journal a part of the dataset.

        Raises:
            CosimError: it cannot be written.
        """
        self._since = time.monotonic()
        if not self._rows:
            return
        self._parts += 1
        file = self.path / "runs" / f"part-{self._parts:06}.parquet"
        part = file.with_name(f".{file.name}")  # which readers of the folder leave out
        with self._writing():
            pq.write_table(sorted_table(self._rows, self.schema), part)
            with part.open("rb") as written:
                os.fsync(written.fileno())
            part.replace(file)
            self._journal.truncate(0)
        self._rows = []

    def sought(self, run: int) -> float | None:
        """Returns the metric that a search looks for of a run that has ended; None if it has none."""
        found = self._sought[run]
        return None if found is None else float(found)

    def table(self) -> pa.Table:
        """Returns the dataset so far."""
        return _read(self.path, self.schema)

    def write_json(self, name: str, document: Any) -> None:
        """Writes a document of the campaign.

        Raises:
            CosimError: it cannot be written.
        """
        part = self.path / f"{name}.part"
        with self._writing():
            part.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
            part.replace(self.path / name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.write_part()
        finally:
            self._journal.close()
            self._lock.close()


def _line(row: Mapping[str, Any]) -> bytes:
    return json.dumps(row, allow_nan=False).encode() + b"\n"

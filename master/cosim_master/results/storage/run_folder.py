"""The folder of a run's results: its choice for a new run, and the removal of an earlier run.

A run may replace an earlier run of the same inputs, since it records the same values. Results of other inputs are
overwritten only on request. The manifest contains the fingerprint of the inputs (see `fingerprint`).
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.results.storage.journal import FOLDER, goes_on, journal_of
from cosim_master.results.storage.manifest_file import CAMPAIGN

__all__ = ["RunFolder", "clear", "differences", "held_fingerprint", "is_figure", "stamp"]

_RESULTS = ("manifest.json", "signals.parquet", "packets.parquet", "packets.tlog", "packets/*.tlog")
_DRAWN = (".png", ".svg", ".pdf", ".html")
_STAMP = "uav-cosim, signals.parquet sha256 "
_HEAD = 65536
"""Number of bytes at the start (PDF: at the end) of a figure that contain its stamp."""


@dataclass(frozen=True, slots=True)
class RunFolder:
    """The choice of a folder for the results of a run.

    Attributes:
        path: the folder.
        numbered: use path-2, path-3, ... if it contains a run of other inputs, instead of refusing.
        force: overwrite any run.
    """

    path: Path
    numbered: bool = False
    force: bool = False

    def choose(self, fingerprint: Mapping[str, str], *, repeatable: bool = True) -> Path:
        """Returns the folder for a run with this fingerprint.

        Args:
            fingerprint: digests of the inputs of the run, by their names.
            repeatable: whether a run of the same inputs records the same values; False with real programs.

        Raises:
            SystemDescriptionError: the folder contains results that this run would not record again, or a campaign.
        """
        for path in self._candidates():
            try:
                is_campaign = (path / CAMPAIGN).is_file()
            except OSError as error:  # its name is too long, for example
                text = f"cannot hold the results of a run: {error.strerror}"
                raise SystemDescriptionError([Problem(Where(str(path)), text)]) from None
            if is_campaign:
                if self.numbered:
                    continue
                raise SystemDescriptionError([Problem(Where(str(path)), "holds a campaign; give another folder")])
            recorded = goes_on(path)
            held = None if self.force else held_fingerprint(path)
            same = repeatable and held == dict(fingerprint) and not (path / FOLDER).is_dir()
            if not recorded and (held is None or same):
                return path
            if not self.numbered:
                fix = "give another folder" + ("" if recorded else ", or --force to overwrite it")
                text = "holds a run that goes on" if recorded else _described(path, held or {}, fingerprint)
                raise SystemDescriptionError([Problem(Where(str(path)), f"{text}; {fix}")])
        raise AssertionError("there are infinitely many candidates")

    def _candidates(self) -> Iterator[Path]:
        yield self.path
        if self.numbered:
            yield from (self.path.with_name(f"{self.path.name}-{n}") for n in count(2))


def held_fingerprint(folder: Path) -> dict[str, str] | None:
    """Returns the fingerprint of the run in a folder: empty if it is not known, None if the folder contains no run."""
    if not any((folder / name).exists() for name in ("manifest.json", "signals.parquet", "checkpoints", FOLDER)):
        return None
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        return {str(name): str(digest) for name, digest in manifest["fingerprint"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def differences(held: Mapping[str, str], fingerprint: Mapping[str, str]) -> list[str]:
    """Returns the inputs that differ between two fingerprints."""
    return [name for name in dict.fromkeys([*fingerprint, *held]) if held.get(name) != fingerprint.get(name)]


def _described(folder: Path, held: Mapping[str, str], fingerprint: Mapping[str, str]) -> str:
    if (folder / FOLDER).is_dir():
        return "holds a run whose process was killed, which `uav-cosim repair` completes"
    if not held:
        return "holds the results of a run whose inputs are not known (it was cut short, or is of an older version)"
    other = differences(held, fingerprint)
    if not other:
        return "holds the results of a run with packets from outside, of programs or a person"
    return f"holds the results of a run with other inputs ({', '.join(other)})"


def clear(folder: Path) -> None:
    """Removes an earlier run: its results, its checkpoints, and its figures, which are identified by their stamp."""
    for pattern in _RESULTS:
        for file in folder.glob(pattern):
            file.unlink()
    for name in ("checkpoints", FOLDER):
        shutil.rmtree(folder / name, ignore_errors=True)
    for file in folder.iterdir():
        if is_figure(file):
            file.unlink()


def stamp(run: Path) -> str:
    """Returns the stamp of a figure: the SHA-256 of the signals that it shows."""
    digest = hashlib.sha256()
    with (journal_of(run, "signals") or run / "signals.parquet").open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return f"{_STAMP}{digest.hexdigest()}"


def is_figure(file: Path) -> bool:
    """Returns whether a file was made from a run by `uav-cosim plot` or `view`; such files have a stamp."""
    if file.suffix not in _DRAWN or not file.is_file():
        return False
    with file.open("rb") as opened:
        if file.suffix == ".pdf":  # which has it at the end
            opened.seek(max(0, file.stat().st_size - _HEAD))
        return _STAMP.encode() in opened.read(_HEAD)

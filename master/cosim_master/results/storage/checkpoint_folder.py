"""Checkpoints in the folder of a run: their list, the identity of their system, and their part of the recording.

    RUN/checkpoints/T/checkpoint.json   system, FMUs and time; the part of RUN's recording that belongs to it; digests
                                        of its own contents and of the other files
    RUN/checkpoints/T/signals.parquet   rows recorded since the checkpoint before (packets.parquet: its packets):
                                        the run's own files cannot be read if it was killed

`checkpoint` writes and restores the state in the same folder.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where

__all__ = ["FORMAT", "Checkpoint", "Identity", "Position", "find", "sealed", "segments"]

FORMAT = 6
"""The version of the files; another one is refused."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The properties that must be equal to resume a run: digests of the FMUs by instance, and the time grid.

    A file of inputs is also identified by its digest.
    """

    system: str
    fmus: Mapping[str, str]
    start: int
    base: int
    steps: int
    every: int
    seed: int
    input: str = ""
    per_ns: int = 1


@dataclass(frozen=True, slots=True)
class Position:
    """The part of the recording before a checkpoint: row groups of the Parquet files, bytes of each .tlog."""

    signals: int = 0
    packets: int = 0
    tlogs: Mapping[str, int] | None = None


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A checkpoint in a run folder: its place, its base step and its contents."""

    folder: Path
    run: Path
    k: int
    time: float
    identity: Identity
    position: Position
    overrides: Mapping[str, str]
    record: tuple[str, ...]
    texts: Mapping[str, str]
    events: Any
    verdict: Mapping[str, Any]
    changes: tuple[tuple[int, str, str], ...]
    """Of variables before it: the base step, the name, and the value as Python writes it."""

    def check(self, identity: Identity) -> None:
        """Checks that this is a checkpoint of the same system.

        Raises:
            SystemDescriptionError: the system differs; all differences are reported.
        """
        problems = []
        if self.identity.system != identity.system:
            problems.append(Problem(Where(str(self.folder)), "the system's documents must be what they were"))
        if self.identity.input != identity.input:
            problems.append(Problem(Where(str(self.folder)), "the file of --input must be what it was"))
        words = {"start": "the start time", "base": "the base step", "steps": "the stop time"}
        words |= {"every": "the recording interval", "seed": "the seed of the radio", "per_ns": "the tick of time"}
        for name, what in words.items():
            if getattr(self.identity, name) != getattr(identity, name):
                text = f"{what} must be what it was ({_told(self.identity, name)}), now it is {_told(identity, name)}"
                problems.append(Problem(Where(str(self.folder)), text))
        fmus = self.identity.fmus, identity.fmus
        for name in sorted({*fmus[0], *fmus[1]}):
            if fmus[0].get(name) != fmus[1].get(name):
                problems.append(Problem(Where(str(self.folder)), f"{name} is another FMU than it was"))
        if problems:
            raise SystemDescriptionError(problems)


def _told(identity: Identity, name: str) -> str:
    """Returns a property as users write it: times in s."""
    if name == "seed":
        return str(identity.seed)
    ticks = {
        "start": identity.start,
        "base": identity.base,
        "steps": identity.start + identity.steps * identity.base,
        "every": identity.every * identity.base,
        "per_ns": 1,
    }
    return f"{ticks[name] / (1e9 * identity.per_ns):.9g} s"


def find(wanted: str) -> Checkpoint:
    """Returns the checkpoint RUN@TIME, given as a folder with results and a time in s.

    Raises:
        SystemDescriptionError: the checkpoint does not exist or cannot be read; the error names the existing ones.
    """
    where = Where(f"--from {wanted}")

    def wrong(text: str) -> SystemDescriptionError:
        return SystemDescriptionError([Problem(where, text)])

    run, at, text = wanted.rpartition("@")
    try:
        time = float(text)
    except ValueError:
        time = float("nan")
    if not at or not run or time != time:
        raise wrong("write RUN@TIME, the folder of a run and a time in s")
    if not Path(run).is_dir():
        raise wrong(f"there is no folder {run}; write RUN@TIME, the folder of a run and a time in s")
    folder = Path(run) / "checkpoints"
    times = sorted(float(f.parent.name) for f in folder.glob("*/checkpoint.json"))
    if time not in times:
        there = ", ".join(f"{t:.9g}" for t in times) or "none (run with --checkpoint-every S to have some)"
        raise wrong(f"{run} has no checkpoint at {time:.9g} s; there are: {there}")
    own = folder / f"{time:.9g}"
    try:
        content = json.loads((own / "checkpoint.json").read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise wrong(f"{own} was written in format {content['format']!r}, this is {FORMAT}")
        _check_seal(own, content)
        return Checkpoint(
            own,
            Path(run),
            int(content["k"]),
            float(content["time"]),
            Identity(**content["identity"]),
            Position(**content["position"]),
            content["overrides"],
            tuple(content["record"]),
            content["texts"],
            content["events"],
            content["verdict"],
            tuple((int(k), str(name), str(value)) for k, name, value in content["changes"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise wrong(f"{own} is damaged: {error}") from None


def sealed(folder: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the content of a checkpoint.json with the digests of the files in its folder, and of itself."""
    files = {file.name: _digest(file.read_bytes()) for file in sorted(folder.iterdir())}
    whole = {**content, "files": files}
    return {**whole, "digest": _digest(json.dumps(whole, sort_keys=True).encode())}


def _check_seal(folder: Path, content: Mapping[str, Any]) -> None:
    rest = {name: value for name, value in content.items() if name != "digest"}
    if content["digest"] != _digest(json.dumps(rest, sort_keys=True).encode()):
        raise ValueError("checkpoint.json has not the digest that it contains")
    for name, digest in content["files"].items():
        if Path(name).name != name or _digest((folder / name).read_bytes()) != digest:
            raise ValueError(f"{name} has not the digest that checkpoint.json contains")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def segments(checkpoint: Checkpoint, name: str) -> list[Path]:
    """Returns the files of a run's checkpoints with its recording up to this checkpoint, in the order of time."""
    folders = [file.parent for file in checkpoint.folder.parent.glob("*/checkpoint.json")]
    before = sorted((float(folder.name), folder) for folder in folders if float(folder.name) <= checkpoint.time)
    return [folder / name for _, folder in before if (folder / name).is_file()]

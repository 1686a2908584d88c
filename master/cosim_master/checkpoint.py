"""Checkpoints of a run, in files: all that its future depends on, and how far its recording had come.

    RUN/checkpoints/T/state.npz         FMU states (serialised), values, packets in flight and their counters
    RUN/checkpoints/T/checkpoint.json   of which system, which FMUs, when; how much of RUN's recording belongs to it
    RUN/checkpoints/T/signals.parquet   what has been recorded since the checkpoint before (packets.parquet, too):
                                        RUN's own files cannot be read if it was killed

A run that goes on from a checkpoint makes the same FMU instances anew, puts their states back, takes over the
recording up to there, and then has the same future, bit for bit.

Nothing is written for sockets: a system with gateways cannot be taken back to an earlier time.
"""

from __future__ import annotations

import ctypes
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmi3 import Instance3
from cosim_master.living import Living
from cosim_master.radio import Radio
from cosim_master.tables import PHASE, K, Plan

__all__ = ["Checkpoint", "Identity", "Position", "cannot_be_serialised", "find", "restore", "save", "segments"]

_VALUES = ("real_in", "real_out", "int_in", "int_out", "text", "tx", "kept")
_PORT_FIELDS = ("filled", "sent", "rx_size")
_INSTANCE_FIELDS = ("length", "h")
_SLOPE_FIELDS = ("before", "at", "known")
"""What of the tables is no address and changes in a run."""
_RADIO = ("endpoints", "places", "data", "order", "along", "counters")
_FLAGS = ("canGetAndSetFMUstate", "canSerializeFMUstate")
_FORMAT = 3


@dataclass(frozen=True, slots=True)
class Identity:
    """What must be the same for a run to go on: of FMUs their digests by instance, of time ticks and base steps.

    A file of inputs is known by its digest, too.
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
    """How much of the recording lies before a checkpoint: row groups of the Parquet files, bytes of each .tlog."""

    signals: int = 0
    packets: int = 0
    tlogs: Mapping[str, int] | None = None


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A checkpoint that was found: where, at which base step, and what it was made with."""

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

    def check(self, identity: Identity) -> None:
        """Whether this is a checkpoint of the very system that is to go on.

        Raises:
            SystemDescriptionError: all that differs.
        """
        problems = []
        mine, other = asdict(self.identity), asdict(identity)
        fmus = mine.pop("fmus"), other.pop("fmus")
        words = {"system": "the system's documents", "start": "the start time", "base": "the base step"}
        words |= {
            "steps": "the stop time",
            "every": "the recording interval",
            "seed": "the seed of the radio",
            "input": "the file of --input",
            "per_ns": "the tick of time",
        }
        for name in mine:
            if mine[name] != other[name]:
                text = f"{words[name]} must be what it was ({mine[name]}), now it is {other[name]}"
                problems.append(Problem(Where(str(self.folder)), text))
        for name in sorted({*fmus[0], *fmus[1]}):
            if fmus[0].get(name) != fmus[1].get(name):
                problems.append(Problem(Where(str(self.folder)), f"{name} is another FMU than it was"))
        if problems:
            raise SystemDescriptionError(problems)


def cannot_be_serialised(living: Sequence[Living]) -> str:
    """Which instances keep a system from having checkpoints, and why; empty if none does."""
    lacking = []
    for one in living:
        flags = [flag for flag in _FLAGS if not getattr(one.fmu.capabilities, flag)]
        if flags:
            lacking.append(f"{flags[0]} of {one.name} is false{one.fmu.remedy(flags[0])}")
    return ", ".join(lacking[:3]) + (f", and {len(lacking) - 3} more" if len(lacking) > 3 else "")


# ---- writing ------------------------------------------------------------------------------------------------------


def save(
    folder: Path,
    *,
    time: float,
    k: int,
    plan: Plan,
    radio: Radio,
    living: Sequence[Living],
    texts: Mapping[tuple[int, str], str],
    events: Any,
    position: Position,
    segments: Sequence[Path],
    about: Mapping[str, Any],
) -> Path:
    """Write a checkpoint into `folder`; returns its own folder. Rows and packets must have been written out.

    Args:
        events: `Events.as_json`.
        segments: files with what was recorded since the last checkpoint; they become part of this one.

    Raises:
        FmuError: an FMU cannot save its state after all.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {name: getattr(plan, name) for name in _VALUES}
    arrays |= {f"ports.{name}": plan.ports[name] for name in _PORT_FIELDS}
    arrays |= {f"instances.{name}": plan.instances[name] for name in _INSTANCE_FIELDS}
    arrays |= {f"slopes.{name}": plan.slopes[name] for name in _SLOPE_FIELDS}
    arrays |= {f"radio.{name}": getattr(radio, name) for name in _RADIO}
    three = [one if isinstance(one, Instance3) else None for one in living]
    arrays["next_events"] = np.array([np.inf if one is None else one.next_event for one in three])
    arrays["pending"] = np.array([0 if one is None else one.pending for one in three], dtype=np.int64)
    sizes, states = [], []
    for one in living:
        state = ctypes.c_void_p()
        one.save_state(state)
        try:
            states.append(one.serialise(state))
        finally:
            one.free_state(state)
        sizes.append(len(states[-1]))
    arrays["state_sizes"] = np.array(sizes, dtype=np.int64)
    arrays["states"] = np.frombuffer(b"".join(states), dtype=np.uint8)
    arrays["blocks"] = np.array([radio.events.size, radio.log.size], dtype=np.int64)
    own = folder / f"{time:.9g}"
    part = own.with_name(own.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.rmtree(own, ignore_errors=True)
    part.mkdir(parents=True)
    with (part / "state.npz").open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    content = {
        "format": _FORMAT,
        "time": time,
        "k": k,
        "phase": int(plan.clock[PHASE]),
        **about,
        "events": events,
        "texts": {f"{living[i].name}.{name}": text for (i, name), text in texts.items()},
        "position": asdict(position),
    }
    (part / "checkpoint.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
    for segment in segments:
        segment.rename(part / segment.name)
    part.rename(own)
    return own


# ---- reading ------------------------------------------------------------------------------------------------------


def find(wanted: str) -> Checkpoint:
    """The checkpoint RUN@TIME, of a folder with results and a time in s.

    Raises:
        SystemDescriptionError: there is none, or it cannot be read; says which there are.
    """
    where = Where(f"--from {wanted}")

    def wrong(text: str) -> SystemDescriptionError:
        return SystemDescriptionError([Problem(where, text)])

    run, at, text = wanted.rpartition("@")
    try:
        time = float(text)
    except ValueError:
        time = float("nan")
    if not at or time != time:
        raise wrong("write RUN@TIME, the folder of a run and a time in s")
    folder = Path(run) / "checkpoints"
    times = sorted(float(f.parent.name) for f in folder.glob("*/checkpoint.json"))
    if time not in times:
        there = ", ".join(f"{t:.9g}" for t in times) or "none (run with --checkpoint-every S to have some)"
        raise wrong(f"{run} has no checkpoint at {time:.9g} s; there are: {there}")
    own = folder / f"{time:.9g}"
    try:
        content = json.loads((own / "checkpoint.json").read_text(encoding="utf-8"))
        if content["format"] != _FORMAT:
            raise wrong(f"{own} was written in format {content['format']}, this is {_FORMAT}")
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
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise wrong(f"{own} is damaged: {error}") from None


def segments(checkpoint: Checkpoint, name: str) -> list[Path]:
    """The files of a run's checkpoints that hold its recording up to this one, in the order of time."""
    folders = [file.parent for file in checkpoint.folder.parent.glob("*/checkpoint.json")]
    before = sorted((float(folder.name), folder) for folder in folders if float(folder.name) <= checkpoint.time)
    return [folder / name for _, folder in before if (folder / name).is_file()]


def restore(
    checkpoint: Checkpoint, plan: Plan, radio: Radio, living: Sequence[Living], texts: dict[tuple[int, str], str]
) -> Radio:
    """Put everything back as it was; returns the radio.

    Raises:
        SystemDescriptionError: the files are damaged.
        FmuError: an FMU does not take its state back.
    """
    try:
        with np.load(checkpoint.folder / "state.npz") as file:
            arrays = {name: file[name] for name in file.files}
        for name in _VALUES:
            getattr(plan, name)[...] = arrays[name]
        for table, prefix, fields in (
            (plan.ports, "ports", _PORT_FIELDS),
            (plan.instances, "instances", _INSTANCE_FIELDS),
            (plan.slopes, "slopes", _SLOPE_FIELDS),
        ):
            for name in fields:
                table[name] = arrays[f"{prefix}.{name}"]
        ends = np.cumsum(arrays["state_sizes"])
        states = [
            arrays["states"][end - size : end].tobytes() for end, size in zip(ends, arrays["state_sizes"], strict=True)
        ]
        events, log = (int(size) for size in arrays["blocks"])
        radio = radio._replace(
            **{name: arrays[f"radio.{name}"] for name in _RADIO},
            events=np.zeros(events, dtype=radio.events.dtype),
            log=np.zeros(log, dtype=np.uint8),
        )
        content = json.loads((checkpoint.folder / "checkpoint.json").read_text(encoding="utf-8"))
        plan.clock[K], plan.clock[PHASE] = checkpoint.k, content["phase"]
        if len(states) != len(living):
            raise ValueError(f"{len(states)} states of {len(living)} instances")
    except (OSError, ValueError, KeyError, EOFError) as error:
        text = f"the checkpoint is damaged: {error}"
        raise SystemDescriptionError([Problem(Where(str(checkpoint.folder)), text)]) from None
    for one, bytes_, next_event, pending in zip(living, states, arrays["next_events"], arrays["pending"], strict=True):
        one.time = checkpoint.time
        if isinstance(one, Instance3):
            one.next_event, one.pending = float(next_event), int(pending)
        state = one.deserialise(bytes_)
        try:
            one.restore_state(state)
        finally:
            one.free_state(state)
    for i, name in texts:
        texts[i, name] = checkpoint.texts[f"{living[i].name}.{name}"]
    return radio

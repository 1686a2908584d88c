"""Checkpoints of a run in files: all data that its future depends on, and the position of its recording.

    RUN/checkpoints/T/state.npz         FMU states (serialised), values, packets in flight and their counters
    RUN/checkpoints/T/checkpoint.json   and the other files there: see `checkpoint_folder`

A run that is resumed from a checkpoint creates new instances of the same FMUs, restores their states, and copies the
recording up to the checkpoint. It then has the same future, bit for bit.

Sockets are not saved: a system with gateways cannot be set back to an earlier time.
"""

from __future__ import annotations

import ctypes
import json
import shutil
import zlib
from ast import literal_eval
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import CHECKPOINT
from cosim_master.execution.run.state import RunState, changing
from cosim_master.fmi.description.read import Start
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.network.radio.tables import ROLES as RADIO_ROLES
from cosim_master.network.roles import STATE
from cosim_master.results.storage.checkpoint_folder import FORMAT, Checkpoint, Position, sealed
from cosim_master.stepping.kernels.tables import PHASE, ROLES, K

__all__ = ["Saved", "cannot_be_serialised", "captured", "refuse_checkpoints", "restore", "save"]

_UNREADABLE = (BadZipFile, zlib.error)
_GROWING = ("radio.places", "radio.data", "radio.relayed")
"""The arrays of the radio that have a row for each packet in flight; the last one is empty without relays."""
_FLAGS = ("canGetAndSetFMUstate", "canSerializeFMUstate")


def cannot_be_serialised(slaves: Sequence[Slave]) -> str:
    """Returns the instances that prevent checkpoints, and the reasons; empty if none exist."""
    lacking = []
    for one in slaves:
        flags = [flag for flag in _FLAGS if not getattr(one.fmu.capabilities, flag)]
        if flags:
            lacking.append(f"{flags[0]} of {one.name} is false{one.fmu.remedy(flags[0])}")
    return ", ".join(lacking[:3]) + (f", and {len(lacking) - 3} more" if len(lacking) > 3 else "")


def refuse_checkpoints(state: RunState) -> None:
    """Raises SystemDescriptionError, with the reason, if this run cannot have checkpoints."""
    reason = "what has passed a gateway cannot be taken back" if state.network.gateways else ""
    if reason := reason or cannot_be_serialised(state.slaves):
        raise SystemDescriptionError([Problem(state.checked.structure.where, CHECKPOINT.text(reason))])


@dataclass(frozen=True, slots=True)
class Saved:
    """All data that the future of a run depends on, copied at a communication point.

    Attributes:
        time: of the communication point, s.
        phase: of the macro step.
        arrays: of the plan, of the radio ("radio.counters"), and by instance, see `captured`.
        states: of the FMUs, serialised.
        texts: Strings that are not packets, by ``instance.variable``.
        events: of Event Mode, as plain data.
    """

    time: float
    phase: int
    arrays: Mapping[str, np.ndarray[Any, Any]]
    states: Sequence[bytes]
    texts: Mapping[str, str]
    events: Any


def captured(state: RunState) -> Saved:
    """Returns a copy of the state of a run. Rows and packets must already be written out.

    Raises:
        FmuError: an FMU fails to save its state.
    """
    plan, radio, slaves = state.plan, state.radio, state.slaves
    arrays = {name: array.copy() for name, array in changing(plan, ROLES, (STATE,)).items()}
    arrays |= {f"radio.{name}": array.copy() for name, array in changing(radio, RADIO_ROLES, (STATE,)).items()}
    arrays["next_events"] = np.array([one.next_event for one in slaves])
    arrays["pending"] = np.array([one.pending for one in slaves], dtype=np.int64)
    states = []
    for one in slaves:
        fmu_state = ctypes.c_void_p()
        one.save_state(fmu_state)
        try:
            states.append(one.serialise(fmu_state))
        finally:
            one.free_state(fmu_state)
    arrays["blocks"] = np.array([radio.events.size, radio.log.size], dtype=np.int64)
    texts = {f"{slaves[i].name}.{name}": text for (i, name), text in state.texts.outputs.items()}
    return Saved(state.time, int(plan.counters[PHASE]), arrays, states, texts, state.event_mode.events.as_json())


def save(
    folder: Path,
    saved: Saved,
    k: int,
    *,
    position: Position,
    segments: Sequence[Path],
    about: Mapping[str, Any],
) -> Path:
    """Writes a checkpoint into `folder`; returns its subfolder.

    Args:
        k: the base step reached, in the system's own grid.
        segments: files with the recording since the last checkpoint; they become part of this one.
    """
    arrays = dict(saved.arrays)
    arrays["state_sizes"] = np.array([len(one) for one in saved.states], dtype=np.int64)
    arrays["states"] = np.frombuffer(b"".join(saved.states), dtype=np.uint8)
    own = folder / f"{saved.time:.9g}"
    part = own.with_name(own.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.rmtree(own, ignore_errors=True)
    part.mkdir(parents=True)
    with (part / "state.npz").open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    content = {
        "format": FORMAT,
        "time": saved.time,
        "k": k,
        "phase": saved.phase,
        **about,
        "events": saved.events,
        "texts": saved.texts,
        "position": asdict(position),
    }
    for segment in segments:
        segment.rename(part / segment.name)
    (part / "checkpoint.json").write_text(json.dumps(sealed(part, content), indent=1), encoding="utf-8")
    part.rename(own)
    return own


def _verify(arrays: Mapping[str, np.ndarray[Any, Any]], state: RunState) -> None:
    """Raises ValueError or KeyError if the arrays of a checkpoint do not have the types and sizes of this run's."""
    n = len(state.slaves)
    expected = dict(changing(state.plan, ROLES, (STATE,)))
    expected |= {"next_events": np.zeros(n), "pending": np.zeros(n, np.int64), "state_sizes": np.zeros(n, np.int64)}
    expected |= {"states": np.zeros(0, np.uint8), "blocks": np.zeros(2, np.int64)}
    radio = changing(state.radio, RADIO_ROLES, (STATE,))
    expected |= {f"radio.{name}": array for name, array in radio.items()}
    for name, array in expected.items():
        found, shape = arrays[name], array.shape
        if name == "states":
            shape = (int(arrays["state_sizes"].sum()),)
        if name in _GROWING and array.size > 0:
            shape = arrays["radio.places"].shape[:1] + shape[1:]
        if found.dtype.descr != array.dtype.descr or found.shape != shape:
            raise ValueError(f"{name} in state.npz is {found.dtype.descr} of {found.shape}, not of {shape}")


def restore(checkpoint: Checkpoint, state: RunState) -> None:
    """Restores the state of the run.

    Raises:
        SystemDescriptionError: the files are damaged, or the master of this run needs other data on steps.
        FmuError: an FMU fails to restore its state.
    """
    plan, radio, slaves = state.plan, state.radio, state.slaves
    try:
        with np.load(checkpoint.folder / "state.npz") as file:
            arrays = {name: file[name] for name in file.files}
        if arrays["step_sizes"].shape != plan.step_sizes.shape:
            text = "its master has steps of another kind (fixed or variable); go on with the master of the earlier run"
            raise SystemDescriptionError([Problem(Where(str(checkpoint.folder)), text)])
        _verify(arrays, state)
        for name, array in changing(plan, ROLES, (STATE,)).items():
            array[...] = arrays[name]
        ends = np.cumsum(arrays["state_sizes"])
        states = [
            arrays["states"][end - size : end].tobytes() for end, size in zip(ends, arrays["state_sizes"], strict=True)
        ]
        events, log = (int(size) for size in arrays["blocks"])
        state.radio = radio._replace(
            **{name: arrays[f"radio.{name}"] for name in changing(radio, RADIO_ROLES, (STATE,))},
            events=np.zeros(events, dtype=radio.events.dtype),
            log=np.zeros(log, dtype=np.uint8),
        )
        content = json.loads((checkpoint.folder / "checkpoint.json").read_text(encoding="utf-8"))
        plan.counters[K], plan.counters[PHASE] = checkpoint.k, content["phase"]
        if len(states) != len(slaves):
            raise ValueError(f"{len(states)} states of {len(slaves)} instances")
    except (OSError, ValueError, KeyError, TypeError, IndexError, EOFError, MemoryError, *_UNREADABLE) as error:
        text = f"the checkpoint is damaged: {error}"
        raise SystemDescriptionError([Problem(Where(str(checkpoint.folder)), text)]) from None
    for one, bytes_, next_event, pending in zip(slaves, states, arrays["next_events"], arrays["pending"], strict=True):
        one.time = checkpoint.time
        one.next_event, one.pending = float(next_event), int(pending)
        fmu_state = one.deserialise(bytes_)
        try:
            one.restore_state(fmu_state)
        finally:
            one.free_state(fmu_state)
    for slave, variable, value in _changed(checkpoint, slaves):
        slave.changed[variable] = value
    for i, name in state.texts.outputs:
        state.texts.outputs[i, name] = checkpoint.texts[f"{slaves[i].name}.{name}"]
    state.event_mode.events.from_json(checkpoint.events)


def _changed(checkpoint: Checkpoint, slaves: Sequence[Slave]) -> Iterator[tuple[Slave, str, Start]]:
    """Yields the changes that led to a checkpoint: instance, variable, and value."""
    by_name = {slave.name: slave for slave in slaves}
    for _, whole, text in checkpoint.changes:
        levels = whole.split(".")
        for n in range(1, len(levels)):
            slave, name = by_name.get(".".join(levels[:n])), ".".join(levels[n:])
            if slave is not None and name in slave.fmu.variables:
                try:
                    yield slave, name, literal_eval(text)
                except (ValueError, SyntaxError):  # a String, inf or nan
                    yield slave, name, text

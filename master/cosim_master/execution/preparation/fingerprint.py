"""Digests of the inputs of a run: runs with equal digests record the same bits.

They do not include the number of threads, the pace, profiles and checkpoints, which do not change the recording.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache
from importlib.metadata import version
from itertools import chain
from pathlib import Path

from cosim_master.fmi.description.read import FmuDescription
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["digest_of_changes", "fingerprint_of", "with_packets"]


def fingerprint_of(
    checked: CheckedSystem,
    clock: TimeGrid,
    network: Network,
    master: MasterSettings,
    *,
    system: str,
    changes: Sequence[Change] = (),
    stimuli: str = "",
    recording: Sequence[object] = (),
    gateways: Sequence[str] = (),
    checkpoint: Checkpoint | None = None,
) -> dict[str, str]:
    """Returns the digest of each kind of input, by its name for users ("seed", "start values").

    Args:
        checked, clock, network, master: those of the run; `network` without gateways.
        system: the digest of the system's documents.
        changes: the values set during the run.
        stimuli: the digest of the file of inputs.
        recording: the signals recorded, and the interval.
        gateways: addresses of real programs.
        checkpoint: the checkpoint to resume from.
    """
    structural = ((instance.name, sorted(instance.start_values.items())) for instance in checked.instances)
    links = ((link.source, link.target, link.factor, link.offset, link.mapping) for link in checked.links)
    delays = sorted((target, delay.ns, delay.start) for target, delay in master.delays.items())
    nodes = (
        (node.name, [endpoint.name for endpoint in node.endpoints], [(i, v.name) for i, v in node.position])
        for node in network.nodes
    )
    return {
        "version": _digest([_version()]),
        "system": _digest(chain([system], links)),
        "FMUs": _digest((instance.name, instance.fmu.digest) for instance in checked.instances),
        "start values": _digest_of_texts(chain(_effective_values(checked), map(repr, structural))),
        "time": _digest([clock.start, clock.base, clock.steps, clock.periods]),
        "master": _digest([*_fields(master, {"delays", "where", "notes"}), delays]),
        "radio": _digest([*_fields(network, {"nodes", "gateways", "seed", "notes"}), *nodes]),
        "seed": _digest([network.seed]),
        "recording": _digest(recording),
        "changes": digest_of_changes(checked, changes),
        "input file": _digest([stimuli]),
        "real programs": _digest(gateways),
        "checkpoint": _digest([] if checkpoint is None else map(_of_file, _files(checkpoint.folder))),
    }


def digest_of_changes(checked: CheckedSystem, changes: Sequence[Change]) -> str:
    """Returns the digest of the values set during a run."""
    names = [instance.name for instance in checked.instances]
    return _digest((change.k, names[change.instance], change.variable.name, change.value) for change in changes)


def with_packets(fingerprint: Mapping[str, str], entered: Sequence[tuple[int, bytes]]) -> dict[str, str]:
    """Returns the fingerprint of the same run with packets of its mailbox, as (k, packet)."""
    if not entered:
        return dict(fingerprint)
    return {**fingerprint, "real programs": _digest([fingerprint["real programs"], *entered])}


def _files(checkpoint: Path) -> list[Path]:
    return [checkpoint / "checkpoint.json", checkpoint / "state.npz"]


def _of_file(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _fields(settings: MasterSettings | Network, without: Collection[str]) -> list[object]:
    """Returns the names and values of all other fields; sets are sorted."""
    values = ((field.name, getattr(settings, field.name)) for field in fields(settings) if field.name not in without)
    return [(name, sorted(value) if isinstance(value, frozenset) else value) for name, value in values]


def _effective_values(checked: CheckedSystem) -> Iterator[str]:
    """Yields the repr of each instance's name and sorted effective values.

    A thousand drones have a quarter of a million values, of which few differ from those of their FMU: the texts of the
    others are made once.
    """
    known: dict[int, tuple[FmuDescription, dict[str, str]]] = {}
    for instance in checked.instances:
        fmu = instance.fmu
        if id(fmu) not in known:
            known[id(fmu)] = fmu, {name: repr((name, fmu.defaults[name])) for name in sorted(fmu.defaults)}
        defaults = known[id(fmu)][1]
        texts = defaults | {name: repr((name, value)) for name, value in instance.given_values().items()}
        if len(texts) > len(defaults):  # some have no default: they come after all others
            texts = dict(sorted(texts.items()))
        yield f"({instance.name!r}, [{', '.join(texts.values())}])"


@cache
def _version() -> str:
    """Returns the version of this project, which is read from a file."""
    return version("uav-cosim")


def _digest(parts: Iterable[object]) -> str:
    """Returns the digest of plain values, by their repr."""
    return _digest_of_texts(map(repr, parts))


def _digest_of_texts(texts: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for text in texts:
        digest.update(text.encode())
        digest.update(b"\n")
    return digest.hexdigest()[:16]

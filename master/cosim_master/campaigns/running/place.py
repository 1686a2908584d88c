"""The system of a study, found and checked before any run; and its digests, in which all processes must agree."""

from __future__ import annotations

import hashlib
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

from cosim_master.campaigns.metrics.built_in import players_of
from cosim_master.campaigns.refusal import refusal
from cosim_master.campaigns.study.study import Planned, Study
from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import matching, near_pattern
from cosim_master.execution.outcome.manifest import digest_of_system
from cosim_master.execution.preparation.fingerprint import fingerprint_of
from cosim_master.execution.preparation.prepare import Prepared, prepare
from cosim_master.fmi.description.read import FmuDescription
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance
from cosim_master.system.reading.overrides import SETTINGS
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.single_fmu import as_model_exchange, full_names

__all__ = ["Disagreement", "Place", "agree", "here", "is_setting", "look_at"]


@dataclass(frozen=True, slots=True)
class Place:
    """A checked study.

    Attributes:
        inputs: digests of everything that its runs have in common, by name.
        identity: that of the system, see `agree`.
        fmus: digests of its FMUs, each by the name of the first component that has it.
        seed: the seed of the system.
        begin: the time at which its runs begin, s.
        record: patterns of the signals to be recorded: those that metrics need, and those that are kept.
        measured: whether any signal is needed at all, or the recorded instants.
    """

    inputs: Mapping[str, str]
    identity: str
    fmus: Mapping[str, str]
    seed: int
    begin: float
    record: tuple[str, ...]
    measured: bool


def look_at(study: Study, run: Planned) -> Place:
    """Reads and checks the system of a study with the values of one run.

    Raises:
        SystemDescriptionError: the system or a value is wrong, a metric needs a signal that does not exist, or no
            signal matches a pattern of those that are kept.
    """
    start, later = study.split(run.values)
    with read_system(study.system, study.variant) as read:
        structure = read if study.solver is None else as_model_exchange(read)
        try:
            checked = check(structure, full_names(structure, start))
        except SystemDescriptionError as error:
            raise _of_factors(error, study) from None
        named = [(when, name, text) for when, values in later.items() for name, text in values.items()]
        set_later = [*study.at, *(one for one in named if not is_setting(one[1]))]
        at = [(when, *one) for when, name, text in set_later for one in full_names(structure, {name: text}).items()]
        ready = prepare(checked, until=study.until, step=study.step, seed=run.seed, at=at)
        system = digest_of_system(checked)
        found = fingerprint_of(checked, ready.clock, ready.network, ready.master, system=system)
        _refuse_times(study, ready)
        record = tuple(dict.fromkeys([*_needed(study, checked), *_kept(study, checked)]))
        first = next((f"{one.name}.{name}" for one in checked.instances for name in _signals(one.fmu, "output")), "")
        return Place(
            {name: digest for name, digest in found.items() if name not in ("seed", "changes")},
            _identity(checked),
            {one.name: one.fmu.digest for one in _first_users(checked)},
            ready.network.seed,
            ready.clock.time(0),
            record or ((first,) if first else ()),
            bool(record) or any(one.timed for one in study.metrics),
        )


def is_setting(name: str) -> bool:
    """Returns whether a name of `--set` is that of a setting of radio, recording or master."""
    return name.partition(".")[0] in SETTINGS


class Disagreement(CosimError):
    """A worker has another system than the client."""


def agree(place: Place, ready: Prepared) -> None:
    """Raises Disagreement if this process does not see the system of the client."""
    if _identity(ready.checked) == place.identity:
        return
    text = "has another version, system or FMUs than the client; install the same version, and share the folders"
    for one in ready.checked.instances:
        if place.fmus.get(one.name, one.fmu.digest) != one.fmu.digest:
            text = f"has another {one.fmu.path} ({one.name}) than the client had when it began: if the file has been"
            text += " built anew since, begin the campaign again; otherwise, share the folders"
            break
    raise Disagreement(f"worker {here()}: {text}")


def here() -> str:
    """Returns the machine and the process id of this process."""
    return f"{platform.node()}:{os.getpid()}"


def _identity(checked: CheckedSystem) -> str:
    """Returns the digest of a system's documents, its FMUs, and the version of this project."""
    digest = hashlib.sha256(f"{version('uav-cosim')} {digest_of_system(checked)}".encode())
    for one in checked.instances:
        digest.update(f"{one.name} {one.fmu.digest}\n".encode())
    return digest.hexdigest()[:16]


def _first_users(checked: CheckedSystem) -> list[ComponentInstance]:
    """Returns the first component of each FMU."""
    return [*{one.fmu.path: one for one in reversed(checked.instances)}.values()]


def _of_factors(error: SystemDescriptionError, study: Study) -> SystemDescriptionError:
    """Returns the error with each problem of a factor under the option that the factor was written for."""
    names = [one.name for one in study.factors]
    own = [one.where.path == "--set" and any(name in one.message for name in names) for one in error.problems]
    found = zip(error.problems, own, strict=True)
    return SystemDescriptionError([Problem(Where("--vary"), one.message) if mine else one for one, mine in found])


def _refuse_times(study: Study, ready: Prepared) -> None:
    clock = ready.clock
    begin, end = clock.time(0), clock.time(clock.steps)
    for one in study.factors:
        if one.time is not None and not begin < one.time < end:
            raise refusal(f"factor {one.label}", f"its time is not between {begin:g} and {end:g} s; give another")
        if one.time is not None and is_setting(one.name):  # which changes at a checkpoint
            steps = (one.time - begin) / clock.seconds(1)
            if not math.isclose(steps, round(steps), rel_tol=1e-9):
                text = f"its time is not a multiple of the base step {clock.seconds(1):.9g} s; give another"
                raise refusal(f"factor {one.label}", text)


def _needed(study: Study, checked: CheckedSystem) -> Sequence[str]:
    """Returns the signals that the metrics of a study need."""
    players, units = players_of(checked), _units(checked)
    outputs = {f"{one.name}.{name}" for one in checked.instances for name in _signals(one.fmu, "output")}
    return [name for metric in study.metrics for name in metric.signals(players, units, outputs)]


def _kept(study: Study, checked: CheckedSystem) -> Sequence[str]:
    """Returns the patterns of the signals that a study keeps; each matches a signal."""
    units = _units(checked)
    for pattern in study.keep:
        if not matching(pattern, units):
            raise refusal(f"--keep {pattern}", f"matches no signal; {near_pattern(pattern, units)}")
    return study.keep


def _units(checked: CheckedSystem) -> dict[str, str]:
    """Returns the units of all signals that can be kept, by name."""
    return {
        f"{one.name}.{name}": unit
        for one in checked.instances
        for name, unit in _signals(one.fmu, "output", "local").items()
    }


def _signals(fmu: FmuDescription, *causalities: str) -> dict[str, str]:
    """Returns the numeric variables of an FMU that can be recorded, with their units."""
    return {
        name: one.unit.name if one.unit is not None else ""
        for name, one in fmu.variables.items()
        if one.causality in causalities and one.type in ("Real", "Integer", "Boolean", "Enumeration")
    }

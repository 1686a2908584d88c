"""Initializes a checked system, in the order of calls of FMI 2.0.5, section 4.2.4, and FMI 3.0.2, section 4.2.

    instantiate(checked, libraries, slaves)     creates the instances, one after the other
    initialize(checked, slaves, start, stop)    experiment, start values, initialization mode with its exchange
    answers(checked, slaves)                    the current values of the parameters in the FMUs
    try_out(checked, start, stop)               the first two, then frees the instances

Every start value is set, including those of the FMU's own description, which some FMUs ignore. All values except inputs
are set between fmi2SetupExperiment and initialization mode; inputs are set in initialization mode. FMUs of 20-sim
initialize their parameters in fmi2SetupExperiment, so values set earlier would be lost. FMI 2.0.5 allows both orders.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import FmuError
from cosim_master.execution.events.super_dense import EndedByEvent, Events
from cosim_master.execution.startup.loops import settle
from cosim_master.fmi.description.read import FmuDescription, Start, Variable
from cosim_master.fmi.slaves.elsewhere import Elsewhere
from cosim_master.fmi.slaves.fmi2 import Batch, set_kind
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.fmi.slaves.libraries import Libraries, check_sources
from cosim_master.fmi.slaves.making import instantiate as make
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.system.flatten.clock_groups import lockstep
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance, FlatConnection

__all__ = ["SettledLoop", "answers", "initialize", "instantiate", "try_out"]

_KINDS = ("Real", "Integer", "Boolean", "String", "Binary")


@dataclass(frozen=True, slots=True)
class SettledLoop:
    """Outputs that depend on each other at initialization, and the number of exchanges until they converged."""

    outputs: tuple[str, ...]
    rounds: int


def instantiate(
    checked: CheckedSystem, libraries: Libraries, slaves: list[Slave], elsewhere: Collection[int] = ()
) -> None:
    """Appends an instance to `slaves` for each instance of the system; those `elsewhere` (numbers) are not loaded.

    Raises:
        FmuError: an FMU refused; the caller must free the instances in `slaves`.
    """
    tied = {i for members in lockstep(checked) for i in members}
    for i, instance in enumerate(checked.instances):
        if i in elsewhere:
            slaves.append(Elsewhere(instance.name, instance.fmu))
            continue
        # After an early return, an instance is behind those whose Clocks drive it, or ahead of those whose Clocks it
        # drives.
        make_one = partial(make, fmu=instance.fmu, early_return=i not in tied, solver=instance.solver)
        slaves.append(libraries.instantiate(instance.fmu, instance.name, make_one))


def initialize(
    checked: CheckedSystem, slaves: Sequence[Slave], start: float, stop: float, events: Events | None = None
) -> tuple[SettledLoop, ...]:
    """Initializes all instances.

    Args:
        slaves: the instances, in the order of `checked.instances`.
        start, stop: start and stop time of the run, s.
        events: the events of `slaves`; None creates them.

    Returns:
        The loops of connections that had to be solved.

    Raises:
        FmuError: an FMU refused.
        LoopError: outputs depend on each other, and no consistent values were found.
    """
    values, batches = _Starts(), _Batches()
    for one, instance in zip(slaves, checked.instances, strict=True):
        if sizes := instance.structural_values():
            one.configure([instance.fmu.variables[n] for n in sizes], list(sizes.values()))
        one.setup_experiment(start, stop)
        values.set(one, instance, inputs=False)
    for one, instance in zip(slaves, checked.instances, strict=True):
        one.enter_initialization_mode()
        if one.initializes_anew:
            starts = instance.effective_values()
            exact = (v for n in starts if (v := instance.fmu.variables[n]).initial == "exact")
            _set_all(one, _by_kind(v for v in exact if v.causality != "input"), starts)
        values.set(one, instance, inputs=True)
    loops = _exchange(checked, {one.name: one for one in slaves}, batches)
    events = events or Events(checked, slaves, round(start * 1e9))
    events.begin()
    for one in slaves:
        one.exit_initialization_mode()
    _first_events(events, slaves, round(start * 1e9))
    return loops


def answers(checked: CheckedSystem, slaves: Sequence[Slave]) -> tuple[dict[str, ChainMap[str, Start]], tuple[str, ...]]:
    """Returns the parameters of all instances, by instance and name, as read from the FMUs after initialization.

    FMUs compiled by this project are not read: a parameter is a field of the instance's record that only fmi2SetXXX
    writes (a test compares the parameters of every FMU that we ship), and a thousand drones have a quarter of a million
    of them. Binaries and parameters that keep the FMU's own start values are not read either: some FMUs refuse to be
    asked, and fail from then on. In these cases, the values set are returned.

    Returns:
        The values, those of the instance over those of its FMU, and a note for each value that differs from the one
        set.

    Raises:
        FmuError: an FMU has failed fatally (fmi2Fatal); a refused value is only a note.
    """
    found: dict[str, ChainMap[str, Start]] = {}
    defaults: dict[int, dict[str, Start]] = {}
    notes = []
    for one, instance in zip(slaves, checked.instances, strict=True):
        fmu = instance.fmu
        if id(fmu) not in defaults:
            defaults[id(fmu)] = _parameters(fmu, fmu.defaults)
        starts = _parameters(fmu, instance.given_values())
        found[instance.name] = values = ChainMap(starts, defaults[id(fmu)])
        if one.library.own:
            continue
        given = [fmu.variables[n] for n in values if n in starts]
        answered: dict[str, Start] = {}
        for some in _by_kind(v for v in given if v.type != "Binary" and not v.clocks):
            try:
                answered |= zip((v.name for v in some), one.get(some), strict=True)
            except FmuError as error:
                if error.status.endswith("Fatal"):
                    raise
                said = f"{error.function} does not say them ({error.status})"
                notes.append(f"parameters of {instance.name}: the values that were set; {said}")
        for v in given:
            if v.name in answered and not _same(answered[v.name], starts[v.name], v.fmi_type):
                text = f"set to {starts[v.name]!r}, but after initialization its FMU answers {answered[v.name]!r}"
                notes.append(f"parameter {instance.name}.{v.name}: {text}")
        values.update(answered)
    return found, tuple(notes)


def _parameters(fmu: FmuDescription, values: Mapping[str, Start]) -> dict[str, Start]:
    return {name: value for name, value in values.items() if fmu.variables[name].causality == "parameter"}


def _same(answer: Start, value: Start, fmi_type: str | None) -> bool:
    if fmi_type == "Float32" and not isinstance(value, str):
        value = float(np.float32(value))
    return answer == value or (answer != answer and value != value)


def _first_events(events: Events, slaves: Sequence[Slave], start: int) -> None:
    """Handles the events at the start: instances with Event Mode are in it after initialization, then in Step Mode."""
    if not events.numbers:
        return
    try:
        events.settle(start, events.numbers, reached=range(len(slaves)))
    except EndedByEvent as end:
        text = "it requested the end of the run before its first step (terminateSimulation)"
        raise FmuError(slaves[end.number].name, "fmi3UpdateDiscreteStates", text, end.time) from None


def try_out(
    checked: CheckedSystem, start: float, stop: float, isolation: Isolation | None = None
) -> tuple[SettledLoop, ...]:
    """Initializes a system and frees it again, as a run does before its first step.

    Args:
        start, stop: start and stop time of the run, s.
        isolation: selects the FMUs that run in processes of their own; None: none does.

    Raises:
        SystemDescriptionError, FmuError, LoopError: as a run would.
    """
    here = [i for i in checked.instances if isolation is None or not isolation.isolates(i.fmu, i.name)]
    check_sources({i.fmu.path: i.fmu for i in here}.values())
    slaves: list[Slave] = []
    with Libraries(isolation) as libraries:
        try:
            instantiate(checked, libraries, slaves)
            loops = initialize(checked, slaves, start, stop)
            for one in slaves:
                one.terminate()
        finally:
            for one in slaves:
                one.free()
    return loops


def _exchange(checked: CheckedSystem, slaves: Mapping[str, Slave], batches: _Batches) -> tuple[SettledLoop, ...]:
    """Exchanges values stage by stage: gets all sources of a stage at once, then sets its targets."""
    loops = []
    exchange = _Exchange(slaves, batches)
    for stage in checked.init_order:
        links = [checked.links[i] for i in stage.links]
        ends = list(dict.fromkeys(link.source for link in links))
        got = exchange.get(ends)
        if not stage.loop:
            exchange.set(links, got)
            continue
        names = tuple(".".join(end) for end in ends)
        rounds = settle(partial(exchange.go_round, links, ends), [got[end] for end in ends], names)
        loops.append(SettledLoop(names, rounds))
    return tuple(loops)


class _Exchange:
    """Carries values over links, from instance to instance; one call per instance and type."""

    def __init__(self, slaves: Mapping[str, Slave], batches: _Batches) -> None:
        self._slaves, self._batches = slaves, batches
        self._terms: dict[tuple[str, str], dict[int, Any]] = {}
        """Known values of the terms of sums, by input and number."""

    def get(self, ends: Sequence[tuple[str, str]]) -> dict[tuple[str, str], Any]:
        """Returns the values of outputs, by instance and variable."""
        wanted: dict[str, list[str]] = {}
        for name, variable in ends:
            wanted.setdefault(name, []).append(variable)
        got: dict[tuple[str, str], Any] = {}
        for name, variables in wanted.items():
            one = self._slaves[name]
            for batch in self._batches.of(one.fmu, variables):
                got |= zip(((name, n) for n in batch.names), one.get(batch), strict=True)
        return got

    def set(self, links: Sequence[FlatConnection], got: Mapping[tuple[str, str], Any]) -> None:
        """Sets the targets of links from the values of their sources."""
        targets: dict[str, dict[str, Any]] = {}
        for link in links:
            value = link.converted(got[link.source])
            if link.term is not None:
                known = self._terms.setdefault(link.target, {})
                known[link.term] = value
                value = sum(known[n] for n in sorted(known))
            targets.setdefault(link.target[0], {})[link.target[1]] = value
        for name, new in targets.items():
            one = self._slaves[name]
            _set_all(one, self._batches.of(one.fmu, new), new)

    def go_round(
        self, links: Sequence[FlatConnection], ends: Sequence[tuple[str, str]], values: list[Any]
    ) -> list[Any]:
        """Sets the targets of links from `values` of their sources; returns the sources' new values."""
        self.set(links, dict(zip(ends, values, strict=True)))
        got = self.get(ends)
        return [got[end] for end in ends]


def _by_kind(variables: Iterable[Variable]) -> list[Batch]:
    """Returns the variables of each type that one call sets or gets; Clocks are not among them."""
    found: dict[str, list[Variable]] = {kind: [] for kind in _KINDS}
    for v in variables:
        if v.type != "Clock":
            found[set_kind(v)].append(v)
    return [Batch(some) for some in found.values() if some]


def _set_all(one: Slave, batches: Iterable[Batch], values: Mapping[str, Any]) -> None:
    for batch in batches:
        one.set(batch, [*map(values.__getitem__, batch.names)])


class _Batches:
    """The batches of an FMU's variables, found once for all of its instances of which the same ones are set or got."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, tuple[str, ...]], list[Batch]] = {}

    def of(self, fmu: FmuDescription, names: Iterable[str]) -> list[Batch]:
        key = id(fmu), tuple(names)
        if key not in self._known:
            self._known[key] = _by_kind(fmu.variables[n] for n in key[1])
        return self._known[key]


class _Starts:
    """Start values, of which most are those of the FMU: its instances share the batches, and differ in a few values."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, tuple[str, ...], bool], list[tuple[Batch, list[Any], dict[str, int]]]] = {}

    def set(self, one: Slave, instance: ComponentInstance, *, inputs: bool) -> None:
        """Sets the effective values of inputs, or those of all other variables; one call per type."""
        fmu, given = instance.fmu, instance.given_values()
        key = id(fmu), tuple(name for name in given if name not in fmu.defaults), inputs
        if key not in self._known:
            variables = (fmu.variables[name] for name in (*fmu.defaults, *key[1]))
            batches = _by_kind(v for v in variables if (v.causality == "input") == inputs)
            self._known[key] = [
                (batch, [fmu.defaults.get(n) for n in batch.names], {n: i for i, n in enumerate(batch.names)})
                for batch in batches
            ]
        for batch, defaults, places in self._known[key]:
            values = defaults.copy()
            for name, value in given.items():
                if (place := places.get(name)) is not None:
                    values[place] = value
            one.set(batch, values)

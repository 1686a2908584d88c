"""The layout of a run's values: outputs fetched, sources of inputs, and signals recorded.

It needs descriptions only; `plan` then makes the arrays and calls for instances.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from cosim.verdict import Role
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import divided, matching, near_pattern
from cosim_master.fmi.calls import KINDS, call_of
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.fmi.slaves.fmi2 import set_kind
from cosim_master.stepping.kernels.tables import COPY, SIGN
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance, FlatConnection
from cosim_master.system.settings.master import Delay, MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.recording import RECORDING

__all__ = ["Delayed", "Layout", "Ports", "halves_of", "make_layout", "shows_error"]

_Variables = Sequence[tuple[str, Variable, str]]
"""Name, variable, and its kind."""
_TEXTS = ("String", "Binary")
_NONE: frozenset[str] = frozenset()


@dataclass(slots=True)
class Ports:
    """Inputs and outputs of one FMI type, instance by instance."""

    first_in: list[int] = field(default_factory=lambda: [0])
    inputs: list[Variable] = field(default_factory=list)
    source: list[int] = field(default_factory=list)
    factor: list[float] = field(default_factory=list)
    offset: list[float] = field(default_factory=list)
    first_out: list[int] = field(default_factory=lambda: [0])
    outputs: list[tuple[int, Variable]] = field(default_factory=list)
    index: dict[tuple[str, str], int] = field(default_factory=dict)
    recorded: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of all values of the loop."""

    instances: tuple[ComponentInstance, ...]
    ports: Mapping[str, Ports]
    int_to_real: tuple[tuple[int, int], ...]
    value_maps: tuple[tuple[int, int, int, int], ...]
    """Rows of `Plan.value_maps`."""
    signals: Mapping[str, tuple[tuple[str, Variable], ...]]
    """Recorded signals (name, variable) per kind, in the order of instances; `wide` ones have two columns."""
    constants: tuple[tuple[float, ...], tuple[int, ...]]
    """Reals and integers after all outputs: values of unconnected elements of partly connected arrays; source -1 of an
    input is the first of them.
    """
    strings: tuple[FlatConnection, ...]
    string_signals: tuple[tuple[str, ComponentInstance, Variable], ...]
    delays: tuple[Delayed, ...] = ()
    links: tuple[FlatConnection, ...] = ()
    """Links of numbers."""


TERM = -1
"""Replaces a delay: a further term of a sum."""


@dataclass(frozen=True, slots=True)
class Delayed:
    """A delayed connection, or a term of a sum (ns is then 0 or TERM).

    It has its source, an output of a kind, its place in `Layout.constants`, and the conversion.
    """

    kind: int
    source: int
    link: FlatConnection
    constant: int
    ns: int
    start: float


def make_layout(
    checked: CheckedSystem,
    network: Network,
    record: Sequence[str] = (),
    master: MasterSettings | None = None,
    observed: Collection[tuple[str, str]] = (),
) -> Layout:
    """Assigns places to all values.

    Args:
        record: patterns (see `diagnostics.names`) of outputs and local variables ``instance.variable`` to record; if
            empty, all outputs are recorded, except for unconnected ones that are declared optional.
        master: the master algorithm; None is Jacobi without delays.
        observed: outputs and parameters (instance, variable) that observers need, recorded or not.

    Raises:
        SystemDescriptionError: a pattern matches nothing.
    """
    master = master or MasterSettings()
    ports = {kind: Ports() for kind in KINDS}
    fmus = {instance.name: instance.fmu for instance in checked.instances}
    files = {id(fmu): fmu for fmu in fmus.values()}
    links = [link for link in checked.links if not link.initial_only]
    kinds = [set_kind(fmus[link.target[0]].variables[link.target[1]]) for link in links]
    numeric = [link for link, kind in zip(links, kinds, strict=True) if kind in KINDS]
    chosen = _chosen(checked, files, record)
    needed = _by_instance(chain((link.source for link in numeric), observed, _needed(checked, network, master)))
    fetched = _Fetched(files)
    signals: dict[str, list[tuple[str, Variable]]] = {kind: [] for kind in KINDS}
    for i, instance in enumerate(checked.instances):
        own = chosen.get(instance.name, _NONE)
        for name, variable, kind in fetched.of(instance.fmu, own.union(needed.get(instance.name, _NONE))):
            outputs, place = ports[kind].outputs, len(ports[kind].outputs)
            ports[kind].index[instance.name, name] = place
            outputs += [(i, variable)] * (1 + variable.wide)
            if name in own:
                ports[kind].recorded += range(place, len(outputs))
                signals[kind].append((f"{instance.name}.{name}", variable))
        for kind in KINDS:
            ports[kind].first_out.append(len(ports[kind].outputs))
    inputs = _Inputs(numeric, ports, master)
    for instance in checked.instances:
        inputs.fill(instance, fetched)
    strings = tuple(link for link, kind in zip(links, kinds, strict=True) if kind in _TEXTS)
    of_text = {key: [(n, v) for n, v in fmu.variables.items() if v.type in _TEXTS] for key, fmu in files.items()}
    texts = tuple(
        (f"{instance.name}.{name}", instance, v)
        for instance in checked.instances
        for name, v in of_text[id(instance.fmu)]
        if name in chosen.get(instance.name, _NONE)
    )
    return Layout(
        checked.instances,
        ports,
        inputs.int_to_real,
        tuple(inputs.value_maps),
        {kind: tuple(found) for kind, found in signals.items()},
        (tuple(inputs.constants[0]), tuple(inputs.constants[1])),
        strings,
        texts,
        tuple(inputs.delayed),
        tuple(numeric),
    )


def _needed(checked: CheckedSystem, network: Network, master: MasterSettings) -> set[tuple[str, str]]:
    """Returns the outputs that the radio and the master algorithm need."""
    needed = {(instance, v.name) for node in network.nodes for instance, v in node.position}
    needed |= {port for one in master.constraints for port in one.ports}
    if master.shows_error:
        needed |= {(i.name, v.name) for i in checked.instances for v in i.fmu.variables.values() if shows_error(v)}
    return needed


def shows_error(variable: Variable) -> bool:
    """Returns whether a variable shows the error of a step."""
    return (variable.causality, variable.type, variable.variability) == ("output", "Real", "continuous")


def _by_type(fmu: FmuDescription) -> _Variables:
    """Returns the numbers of an FMU, grouped by FMI 3 type: one call gets or sets all variables of a type.

    Variables that never change come last: the loop gets them once. Variables that belong to Clocks come last of their
    type: the loop stores their values, but does not set and get them.
    """
    numbers = [(name, v, kind) for name, v in fmu.variables.items() if (kind := set_kind(v)) in KINDS]
    return sorted(numbers, key=lambda item: (item[1].settled, call_of(item[1])))


def _array(v: Variable) -> tuple[str, int] | None:
    """Returns a grouping key for the elements of one array; aliases of it count as other arrays."""
    return None if v.element is None else (v.name.rpartition("[")[0], v.value_reference)


def _by_instance(ports: Iterable[tuple[str, str]]) -> dict[str, set[str]]:
    """Returns the names of variables by instance."""
    found: dict[str, set[str]] = {}
    for instance, name in ports:
        found.setdefault(instance, set()).add(name)
    return found


class _Fetched:
    """The variables that the loop sets or gets; found once for instances of an FMU with the same ones.

    Args:
        fmus: by id.
    """

    def __init__(self, fmus: Mapping[int, FmuDescription]) -> None:
        self._in_order = {key: _by_type(fmu) for key, fmu in fmus.items()}
        self._found: dict[tuple[int, frozenset[str]], _Variables] = {}

    def of(self, fmu: FmuDescription, wanted: Iterable[str]) -> _Variables:
        """Returns the numbers of an FMU that are in `wanted`, and all elements of an array with one of them."""
        key = (id(fmu), frozenset(wanted))
        if key not in self._found:
            self._found[key] = self._search(*key)
        return self._found[key]

    def _search(self, fmu: int, wanted: frozenset[str]) -> _Variables:
        in_order = self._in_order[fmu]
        found = [one for one in in_order if one[0] in wanted]
        arrays = {_array(v) for _, v, _ in found} - {None}
        if not arrays:
            return found
        return [one for one in in_order if one[0] in wanted or _array(one[1]) in arrays]


def _chosen(
    checked: CheckedSystem, fmus: Mapping[int, FmuDescription], record: Sequence[str]
) -> dict[str, frozenset[str]]:
    """Returns the names of the variables to be recorded, by instance."""
    causalities = ("output", "local") if record else ("output",)
    candidates = {
        key: [
            name
            for name, v in fmu.variables.items()
            if v.causality in causalities and v.packet_capacity is None and v.clock is None
        ]
        for key, fmu in fmus.items()
    }
    if not record:
        return _without_unused(checked, fmus, candidates)
    chosen: dict[str, frozenset[str]] = {}
    problems = []
    for pattern in record:
        # Matched with each FMU's variables once: a thousand drones have a hundred thousand candidates.
        rests = {key: divided(pattern, names) for key, names in candidates.items()}
        matches = False
        for instance in checked.instances:
            for head, names in rests[id(instance.fmu)]:
                if head(f"{instance.name}."):
                    chosen[instance.name] = chosen.get(instance.name, _NONE).union(names)
                    matches = True
        if not matches and (any(candidates.values()) or pattern != "*"):
            known = {f"{one.name}.{name}": None for one in checked.instances for name in candidates[id(one.fmu)]}
            text = f'"{pattern}" matches no output or local variable{_instead(checked, pattern, known)}'
            problems.append(Problem(_place(checked, record), text))
    if problems:
        raise SystemDescriptionError(problems)
    return chosen


def _place(checked: CheckedSystem, record: Sequence[str]) -> Where:
    """Returns where the patterns of the signals to record are written: an option, a setting or the annotation."""
    if checked.settings.get("recording", {}).get("signals", "").split() == [*record]:
        return Where("--set recording.signals")
    for one in checked.annotations:
        if one.annotation.type == RECORDING and any(
            element.get("signals", "").split() == [*record] for element in one.annotation.element
        ):
            return one.annotation.where
    return Where("--record")


def _instead(checked: CheckedSystem, pattern: str, candidates: Collection[str]) -> str:
    """Returns what a user may have meant by a pattern that matches nothing."""
    for one in checked.aliases:
        if one.name == pattern:
            return f": it is a connector of a system, whose value is that of {'.'.join(one.source)}; record this"
    if not candidates:
        return ": the system has none"
    for instance in checked.instances:
        if pattern.startswith(f"{instance.name}."):
            variable = instance.fmu.variables.get(pattern[len(instance.name) + 1 :])
            if variable is not None:
                return f": its causality is {variable.causality}"
    if pattern and (inside := matching(f"{pattern}.*", candidates)):
        return f'; try "{pattern}.*", which matches {len(inside)}'
    return f"; {near_pattern(pattern, candidates)}"


def _without_unused(
    checked: CheckedSystem, fmus: Mapping[int, FmuDescription], outputs: Mapping[int, Sequence[str]]
) -> dict[str, frozenset[str]]:
    """Returns the outputs of each instance without those that are declared optional and drive nothing.

    Args:
        outputs: of each FMU.
    """
    every = {key: frozenset(names) for key, names in outputs.items()}
    optional = {
        key: frozenset(n for n in names if fmus[key].verdicts.get(n.partition("[")[0]) is Role.OPTIONAL)
        for key, names in every.items()
    }
    used = _by_instance(link.source for link in checked.links if not link.initial_only)
    return {
        one.name: every[id(one.fmu)] - (optional[id(one.fmu)] - used.get(one.name, _NONE)) for one in checked.instances
    }


class _Inputs:
    """Fills in the sources of all inputs.

    Integers and booleans with a mapping transformation get places after all outputs of `int_out`. Integer and boolean
    sources of real inputs get places (`int_to_real`) after the real outputs.

    Attributes:
        value_maps: rows of `Plan.value_maps`.
        delayed: delayed connections, and terms of sums.
        constants: see `Layout.constants`.
    """

    def __init__(self, links: Sequence[FlatConnection], ports: Mapping[str, Ports], master: MasterSettings) -> None:
        self._ports, self._delays = ports, master.delays
        self._reals, self._integers, self._booleans = (len(ports[kind].outputs) for kind in KINDS)
        self._links: dict[str, dict[str, FlatConnection]] = {}
        self._terms: dict[tuple[str, str], list[FlatConnection]] = {}
        for one in links:
            self._links.setdefault(one.target[0], {}).setdefault(one.target[1], one)
            if one.term is not None:
                self._terms.setdefault(one.target, []).append(one)
        self._int_to_real: dict[int, int] = {}
        self._places: dict[tuple[int, object], int] = {}
        self.value_maps: list[tuple[int, int, int, int]] = []
        self.delayed: list[Delayed] = []
        self.constants: tuple[list[float], list[int]] = ([], [])

    @property
    def int_to_real(self) -> tuple[tuple[int, int], ...]:
        """Returns the rows (from, to) of `Plan.int_to_real`."""
        return tuple(self._int_to_real.items())

    def fill(self, instance: ComponentInstance, fetched: _Fetched) -> None:
        """Adds the connected inputs of an instance, in the order in which they are set, to the ports."""
        own = self._links.get(instance.name, {})
        starts = None
        for name, target, kind in fetched.of(instance.fmu, own):
            link, factor, offset = own.get(name), 1.0, 0.0
            if link is None:
                starts = instance.effective_values() if starts is None else starts
                value = starts.get(name, 0)
                sources = self._hold(kind, halves_of(int(value)) if target.wide else [value])
            elif link.target in self._terms:
                sources = self._sum(self._terms[link.target], target)
            elif (delay := self._delays.get(link.target)) is not None:
                sources = self._delay(link, target, delay)
            else:
                sources, factor, offset = self._sources_of(link, target), link.factor, link.offset
            ports = self._ports[kind]
            for source in sources:
                ports.inputs.append(target)
                ports.source.append(source)
                ports.factor.append(factor)
                ports.offset.append(offset)
        for kind in KINDS:
            self._ports[kind].first_in.append(len(self._ports[kind].inputs))

    def _hold(self, kind: str, values: Sequence[Any]) -> list[int]:
        """Adds constants; returns their places as sources."""
        constants: list[Any] = self.constants[0] if kind == "Real" else self.constants[1]
        first = len(constants)
        constants.extend(values)
        return [-1 - place for place in range(first, len(constants))]

    def _sum(self, terms: Sequence[FlatConnection], target: Variable) -> list[int]:
        sources = self._hold("Real", [0.0])
        for term in terms:
            ns = 0 if term is terms[0] else TERM
            self.delayed.append(Delayed(0, self._sources_of(term, target)[0], term, -1 - sources[0], ns, 0.0))
        return sources

    def _delay(self, link: FlatConnection, target: Variable, delay: Delay) -> list[int]:
        kind = set_kind(target)
        begins: list[Any] = halves_of(int(delay.start)) if target.wide else [delay.start]
        sources = self._hold(kind, begins)
        for source, place, begin in zip(self._sources_of(link, target), sources, begins, strict=True):
            self.delayed.append(Delayed(KINDS.index(kind), source, link, -1 - place, delay.ns, begin))
        return sources

    def _sources_of(self, link: FlatConnection, target: Variable) -> list[int]:
        """Returns the place of the value of an input; two places for an integer of 64 bits."""
        source_kind, at = next((k, at) for k in KINDS if (at := self._ports[k].index.get(link.source)) is not None)
        wide = self._ports[source_kind].outputs[at][1].wide
        at += self._integers if source_kind == "Boolean" else 0
        if link.mapping:
            rows = [(at, COPY, 0), (at + 1, COPY, 1)] if wide else [(at, COPY, 0)]
            rows += [(-1 - at if wide else at, _signed(key), _signed(value)) for key, value in link.mapping]
            at = self._place_of((at, link.mapping), rows)
        if set_kind(target) == "Real":
            if source_kind == "Real":
                return [at]
            return [self._int_to_real.setdefault(-1 - at if wide else at, self._reals + len(self._int_to_real))]
        first = self._integers if set_kind(target) == "Boolean" else 0
        if not target.wide:
            return [at - first]
        return [at - first, at + 1 - first if wide else self._place_of((at, SIGN), [(at, SIGN, 0)]) - first]

    def _place_of(self, key: tuple[int, object], rows: Sequence[tuple[int, int, int]]) -> int:
        """Returns the place, or the first of two, that `rows` (source, key, value) fill; equal for equal keys."""
        if key not in self._places:
            place = self._places[key] = self._integers + self._booleans + len({row[1] for row in self.value_maps})
            self.value_maps += [
                (source, place + (value if which == COPY and source >= 0 else 0), which, value)
                for source, which, value in rows
            ]
        return self._places[key]


def _signed(value: int) -> int:
    """Returns the int64 with the same bits as a value."""
    return value - 2**64 if value >= 2**63 else value


def halves_of(value: int) -> list[int]:
    """Returns the two integers of the plan that represent a 64-bit value."""
    return [int(half) for half in np.array([_signed(value)], np.int64).view(np.int32)]

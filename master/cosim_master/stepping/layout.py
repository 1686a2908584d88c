"""Which outputs are fetched, which inputs are fed from where, and what is recorded: places of all values.

Needs descriptions only; `plan` makes arrays and calls of it for living instances.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import matching
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.fmi.slaves.fmi2 import set_kind
from cosim_master.stepping.kernels.tables import COPY, SIGN
from cosim_master.system.flatten.flat import CheckedSystem, Instance, Link
from cosim_master.system.settings.master import Coupling
from cosim_master.system.settings.network import Network

__all__ = ["KINDS", "Delayed", "Layout", "Ports", "call_of", "halves_of", "layout", "shows_error"]

KINDS = ("Real", "Integer", "Boolean")
_InOrder = Sequence[tuple[str, Variable]]


@dataclass(slots=True)
class Ports:
    """Inputs and outputs of one FMI type, instance by instance."""

    first_in: list[int] = field(default_factory=lambda: [0])
    in_reference: list[int] = field(default_factory=list)
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
    """Where every value of the loop lives."""

    instances: tuple[Instance, ...]
    ports: Mapping[str, Ports]
    mirrors: tuple[tuple[int, int], ...]
    mapped: tuple[tuple[int, int, int, int], ...]
    """Rows of `Plan.mapped`."""
    signals: Mapping[str, tuple[tuple[str, Variable], ...]]
    """Per kind what is recorded (name, variable), sorted as the instances are; `wide` ones have two columns."""
    constants: tuple[tuple[float, ...], tuple[int, ...]]
    """Reals and integers, behind all outputs: values of the elements of an array that nothing is connected to, while
    others are; source -1 of an input is the first of them."""
    strings: tuple[Link, ...]
    string_signals: tuple[tuple[str, Instance, Variable], ...]
    delays: tuple[Delayed, ...] = ()
    links: tuple[Link, ...] = ()
    """All of numbers."""


TERM = -1
"""In place of a delay: a further term of a sum."""


@dataclass(frozen=True, slots=True)
class Delayed:
    """A delayed connection, or (ns is 0, then TERM) a term of a sum.

    From which output of a kind to which of `Layout.constants`, and how.
    """

    kind: int
    source: int
    link: Link
    constant: int
    ns: int
    start: float


def layout(
    checked: CheckedSystem,
    network: Network,
    record: Sequence[str] = (),
    coupling: Coupling | None = None,
    observed: Collection[tuple[str, str]] = (),
) -> Layout:
    """Assign places to all values.

    Args:
        record: patterns (see `diagnostics.names`) of ``instance.variable`` to record; outputs and local variables
            can be. Nothing given: all outputs.
        coupling: delays of connections; None has none.
        observed: outputs (instance, variable) that observers want to see, recorded or not.

    Raises:
        SystemDescriptionError: a pattern matches nothing.
    """
    delayed: list[Delayed] = []
    ports = {kind: Ports() for kind in KINDS}
    fmus = {instance.name: instance.fmu for instance in checked.instances}
    in_order = {id(fmu): _by_type(fmu) for fmu in fmus.values()}
    links = [link for link in checked.links if not link.initial_only]
    kinds = [set_kind(fmus[link.target[0]].variables[link.target[1]]) for link in links]
    numeric = [link for link, kind in zip(links, kinds, strict=True) if kind in KINDS]
    needed = {link.source for link in numeric}
    needed |= set(observed)
    needed |= {(instance, v.name) for node in network.nodes for instance, v in node.position}
    if coupling is not None:
        needed |= {port for one in coupling.constraints for port in one.ports}
    if coupling is not None and coupling.shows_error:
        needed |= {(i.name, v.name) for i in checked.instances for v in i.fmu.variables.values() if shows_error(v)}
    chosen = _chosen(checked, record)
    wanted = needed | chosen
    for i, instance in enumerate(checked.instances):
        for name, variable in _fetched(instance, wanted, in_order[id(instance.fmu)]):
            kind = set_kind(variable)
            if kind in KINDS:
                ports[kind].index[instance.name, name] = len(ports[kind].outputs)
                ports[kind].outputs += [(i, variable)] * (1 + variable.wide)
        for kind in KINDS:
            ports[kind].first_out.append(len(ports[kind].outputs))
    mirrors, mapped, constants = _inputs(checked, numeric, ports, coupling or Coupling(), delayed, in_order)
    signals: dict[str, tuple[tuple[str, Variable], ...]] = {}
    for kind in KINDS:
        columns = []
        for key, index in ports[kind].index.items():
            if key in chosen:
                variable = ports[kind].outputs[index][1]
                ports[kind].recorded += [index, index + 1] if variable.wide else [index]
                columns.append((f"{key[0]}.{key[1]}", variable))
        signals[kind] = tuple(columns)
    strings = tuple(link for link, kind in zip(links, kinds, strict=True) if kind in ("String", "Binary"))
    texts = tuple(
        (f"{instance.name}.{name}", instance, v)
        for instance in checked.instances
        for name, v in instance.fmu.variables.items()
        if v.type in ("String", "Binary") and (instance.name, name) in chosen
    )
    return Layout(
        checked.instances, ports, mirrors, mapped, signals, constants, strings, texts, tuple(delayed), tuple(numeric)
    )


def shows_error(variable: Variable) -> bool:
    """Whether the error of a step is seen in it."""
    return (variable.causality, variable.type, variable.variability) == ("output", "Real", "continuous")


def _by_type(fmu: FmuDescription) -> _InOrder:
    """The variables of an FMU, those of one FMI 3 type together: they are got and set in one call.

    Variables that belong to Clocks come after the others: the loop has their values, but does not set and get them.
    """
    return sorted(fmu.variables.items(), key=lambda item: call_of(item[1]))


def call_of(v: Variable) -> tuple[str, bool, bool]:
    """What the variables of an instance that are set or got in one call have in common."""
    return v.fmi_type, v.wide, bool(v.clocks)


def _array(v: Variable) -> tuple[str, int] | None:
    """What the elements of one array have in common; aliases of it are other arrays."""
    return None if v.element is None else (v.name.rpartition("[")[0], v.value_reference)


def _fetched(instance: Instance, wanted: Container[tuple[str, str]], in_order: _InOrder) -> _InOrder:
    """The variables of an instance that are in `wanted`, and all elements of an array of which one is.

    Args:
        in_order: what `_by_type` gives of its FMU; sorted once per FMU, for there are thousands of instances.
    """
    found = [(name, v) for name, v in in_order if (instance.name, name) in wanted]
    arrays = {_array(v) for _, v in found} - {None}
    if not arrays:
        return found
    return [(name, v) for name, v in in_order if (instance.name, name) in wanted or _array(v) in arrays]


def _chosen(checked: CheckedSystem, record: Sequence[str]) -> set[tuple[str, str]]:
    causalities = ("output", "local") if record else ("output",)
    candidates = {
        f"{instance.name}.{name}": (instance.name, name)
        for instance in checked.instances
        for name, v in instance.fmu.variables.items()
        if v.causality in causalities and v.packet_capacity is None and v.clock is None
    }
    if not record:
        return set(candidates.values())
    chosen: set[tuple[str, str]] = set()
    problems = []
    for pattern in record:
        found = matching(pattern, candidates)
        if not found and (candidates or pattern != "*"):
            some = f" (such as {', '.join(list(candidates)[:3])})" if candidates else ": the system has none"
            problems.append(Problem(Where("--record"), f"{pattern} matches no output or local variable{some}"))
        chosen |= {candidates[name] for name in found}
    if problems:
        raise SystemDescriptionError(problems)
    return chosen


def _inputs(
    checked: CheckedSystem,
    links: Sequence[Link],
    ports: Mapping[str, Ports],
    coupling: Coupling,
    delayed: list[Delayed],
    in_order: Mapping[int, _InOrder],
) -> tuple[
    tuple[tuple[int, int], ...], tuple[tuple[int, int, int, int], ...], tuple[tuple[float, ...], tuple[int, ...]]
]:
    """Fill in what feeds every input.

    Integers and booleans that are mapped on the way get a place behind all outputs of `int_out`, integer and boolean
    sources of real inputs get a mirror among the reals; returns the rows (from, to) of the mirrors, those of
    `Plan.mapped`, and `Layout.constants`.
    """
    by_instance: dict[str, dict[str, Link]] = {}
    terms: dict[tuple[str, str], list[Link]] = {}
    for one in links:
        by_instance.setdefault(one.target[0], {}).setdefault(one.target[1], one)
        if one.term is not None:
            terms.setdefault(one.target, []).append(one)
    mirrors: dict[int, int] = {}
    reals, integers, booleans = (len(ports[kind].outputs) for kind in KINDS)
    places: dict[tuple[int, object], int] = {}
    mapped: list[tuple[int, int, int, int]] = []
    constants: tuple[list[float], list[int]] = ([], [])

    def place_of(key: tuple[int, object], rows: Sequence[tuple[int, int, int]]) -> int:
        """The place behind all outputs that `rows` (source, key, value) fill, or two; the same for the same key."""
        if key not in places:
            places[key] = integers + booleans + len({row[1] for row in mapped})
            mapped.extend(
                (source, places[key] + (value if which == COPY and source >= 0 else 0), which, value)
                for source, which, value in rows
            )
        return places[key]

    def sources_of(link: Link, target: Variable) -> list[int]:
        """Where the value of an input comes from; two places for an integer of 64 bits."""
        source_kind = next(k for k in KINDS if link.source in ports[k].index)
        at = ports[source_kind].index[link.source]
        wide = ports[source_kind].outputs[at][1].wide
        at += integers if source_kind == "Boolean" else 0
        if link.mapping:
            rows = [(at, COPY, 0), (at + 1, COPY, 1)] if wide else [(at, COPY, 0)]
            rows += [(-1 - at if wide else at, _signed(key), _signed(value)) for key, value in link.mapping]
            at = place_of((at, link.mapping), rows)
        if set_kind(target) == "Real":
            if source_kind == "Real":
                return [at]
            return [mirrors.setdefault(-1 - at if wide else at, reals + len(mirrors))]
        first = integers if set_kind(target) == "Boolean" else 0
        if not target.wide:
            return [at - first]
        return [at - first, at + 1 - first if wide else place_of((at, SIGN), [(at, SIGN, 0)]) - first]

    for instance in checked.instances:
        own = by_instance.get(instance.name, {})
        starts = instance.effective_values() if own else {}
        driven = {(instance.name, name) for name in own}
        for name, target in _fetched(instance, driven, in_order[id(instance.fmu)]):
            kind = set_kind(target)
            if (link := own.get(name)) is not None:
                sources, factor, offset = sources_of(link, target), link.factor, link.offset
                if (summed := terms.get(link.target)) is not None:
                    n = len(constants[0])
                    for term in summed:
                        ns = 0 if term is summed[0] else TERM
                        delayed.append(Delayed(0, sources_of(term, target)[0], term, n, ns, 0.0))
                    sources, factor, offset = [-1 - n], 1.0, 0.0
                    constants[0].append(0.0)
                elif (delay := coupling.delays.get(link.target)) is not None:
                    held = constants[0] if kind == "Real" else constants[1]
                    begins: list[Any] = halves_of(int(delay.start)) if target.wide else [delay.start]
                    for n, (source, begin) in enumerate(zip(sources, begins, strict=True), start=len(held)):
                        delayed.append(Delayed(KINDS.index(kind), source, link, n, delay.ns, begin))
                    sources, factor, offset = [-1 - len(held) - i for i in range(len(begins))], 1.0, 0.0
                    held.extend(begins)
            else:
                held = constants[0] if kind == "Real" else constants[1]
                halves = [starts.get(name, 0)] if not target.wide else halves_of(int(starts.get(name, 0)))
                sources, factor, offset = [-1 - len(held) - i for i in range(len(halves))], 1.0, 0.0
                held.extend(halves)  # type: ignore[arg-type]
            for source in sources:
                ports[kind].in_reference.append(target.value_reference)
                ports[kind].inputs.append(target)
                ports[kind].source.append(source)
                ports[kind].factor.append(factor)
                ports[kind].offset.append(offset)
        for kind in KINDS:
            ports[kind].first_in.append(len(ports[kind].in_reference))
    return tuple(mirrors.items()), tuple(mapped), (tuple(constants[0]), tuple(constants[1]))


def _signed(value: int) -> int:
    """The int64 with the bits of a value."""
    return value - 2**64 if value >= 2**63 else value


def halves_of(value: int) -> list[int]:
    """The two integers of the plan that a value of 64 bits is."""
    return [int(half) for half in np.array([_signed(value)], np.int64).view(np.int32)]

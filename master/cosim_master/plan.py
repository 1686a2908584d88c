"""From a checked system to flat arrays: what the stepping loop needs, as indices and buffers.

`layout` decides which outputs are fetched, which inputs are fed from where, and what is recorded; it needs
descriptions only. `make_plan` adds the handles and addresses of living instances.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim_master import radio as radio_kernels
from cosim_master.calls import table
from cosim_master.check import CheckedSystem, Instance, Link
from cosim_master.clocks import lockstep
from cosim_master.coupling import Coupling
from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmi2 import set_kind
from cosim_master.fmi3 import Instance3
from cosim_master.fmu import Variable
from cosim_master.limitations import BASE_STEP, NANOSECONDS, OVERRUN, TIED_STEPS, WHOLE_TIMES
from cosim_master.living import Living
from cosim_master.network import Network
from cosim_master.radio import (
    COUNTERS,
    DEFINITION,
    ENDPOINT,
    EVENT,
    FREE_PLACE,
    FREE_PLACES,
    GATEWAY,
    NODE,
    PLACE,
    SETTINGS,
    SLOT,
    Radio,
)
from cosim_master.stepping import (
    ANSWERS,
    BY_PYTHON,
    CALL,
    COPY,
    DELAY,
    FEED,
    FUNCTIONS,
    GET_STRING,
    IN_ORDER,
    INSTANCE,
    JACOBI,
    PORTS,
    SEND,
    SET_STRING,
    SIGN,
    SLOPE,
    WIRE,
    Plan,
)
from cosim_master.typed_calls import PACKED, TYPED, WIDE_WIDTHS, WIDTHS

if TYPE_CHECKING:
    from cosim.build.messages import Message

__all__ = [
    "GATEWAY_BYTES",
    "KINDS",
    "Layout",
    "Timing",
    "grown",
    "halves_of",
    "layout",
    "make_plan",
    "make_radio",
    "shows_error",
    "timing",
]

KINDS = ("Real", "Integer", "Boolean")
_NANO = 1_000_000_000
_BLOCK_BYTES = 8 << 20
GATEWAY_BYTES = 1 << 16
"""What can be taken out of a gateway at a time."""


@dataclass(frozen=True, slots=True)
class Timing:
    """The clock of a run in ns: start, base step, number of base steps, and each instance's period in base steps."""

    start: int
    base: int
    steps: int
    periods: tuple[int, ...]
    notes: tuple[str, ...] = ()


def _ticks(seconds: float) -> int | None:
    """Nanoseconds of a time in s, None if it is not a whole number of them."""
    if not math.isfinite(seconds):
        return None
    ticks = round(seconds * _NANO)
    return ticks if math.isclose(ticks, seconds * _NANO, rel_tol=1e-12, abs_tol=1e-4) else None


def timing(checked: CheckedSystem, until: float | None = None, step: float | None = None) -> Timing:
    """Choose the clock.

    Args:
        until: stop time in s; the system's DefaultExperiment where None.
        step: step size in s of instances for which neither system nor FMU names one.

    Raises:
        SystemDescriptionError: no stop time, no step size, times that are no multiples of a nanosecond, or a run
            whose end an FMU with a fixed step size would overrun.
    """
    problems: list[Problem] = []
    where = checked.structure.where
    stop = until if until is not None else checked.stop_time
    start_ticks = _ticks(checked.start_time)
    stop_ticks = None if stop is None else _ticks(stop)
    if stop is None:
        problems.append(Problem(where, "no stop time: give one with --until, or a DefaultExperiment in the system"))
    elif stop <= checked.start_time:
        problems.append(Problem(where, f"stop time {stop:g} s does not lie behind start time {checked.start_time:g} s"))
    if start_ticks is None or (stop is not None and stop_ticks is None):
        problems.append(Problem(where, WHOLE_TIMES.text()))
    sizes: list[int] = []
    for instance in checked.instances:
        size = instance.step_size if instance.step_size is not None else step
        ticks = None if size is None else _ticks(size)
        if size is None:
            text = f"{instance.name}: no step size: neither the system nor the FMU names one; give one with --step"
            problems.append(Problem(instance.where, text))
        elif ticks is None or ticks <= 0:
            problems.append(Problem(instance.where, NANOSECONDS.text(instance.name, size)))
        else:
            sizes.append(ticks)
    if not checked.instances:
        problems.append(Problem(where, "the system has no components"))
    if problems:
        raise SystemDescriptionError(problems)
    assert start_ticks is not None and stop_ticks is not None
    base = math.gcd(*sizes)
    total = stop_ticks - start_ticks
    if total % base:
        nearest = (total // base + 1) * base / _NANO + checked.start_time
        text = BASE_STEP.text(f"{total / _NANO:g}", f"{base / _NANO:g}", f"{nearest:g}")
        raise SystemDescriptionError([Problem(where, text)])
    steps = total // base
    for instance, size in zip(checked.instances, sizes, strict=True):
        if total % size and not instance.fmu.capabilities.canHandleVariableCommunicationStepSize:
            text = OVERRUN.text(instance.name, f"{size / _NANO:g}", f"{total / _NANO:g}")
            problems.append(Problem(instance.where, text))
    problems += _unlike(checked, sizes)
    if problems:
        raise SystemDescriptionError(problems)
    notes = () if base == min(sizes) else (f"the base step is {base / _NANO:g} s, that of no instance",)
    return Timing(start_ticks, base, steps, tuple(size // base for size in sizes), notes)


def _unlike(checked: CheckedSystem, sizes: Sequence[int]) -> list[Problem]:
    """Instances that are tied together by Clocks and have different step sizes."""
    problems = []
    for members in lockstep(checked):
        steps = {sizes[i] for i in members}
        if len(steps) > 1:
            shown = ", ".join(f"{checked.instances[i].name} by {sizes[i] / _NANO:g} s" for i in members)
            problems.append(Problem(checked.instances[members[0]].where, TIED_STEPS.text(shown)))
    return problems


@dataclass(slots=True)
class _Ports:
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
    ports: Mapping[str, _Ports]
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


@dataclass(frozen=True, slots=True)
class Delayed:
    """A delayed connection: from which output of a kind to which of `Layout.constants`, and how."""

    kind: int
    source: int
    link: Link
    constant: int
    ns: int
    start: float


def layout(
    checked: CheckedSystem, network: Network, record: Sequence[str] = (), coupling: Coupling | None = None
) -> Layout:
    """Assign places to all values.

    Args:
        record: patterns (fnmatch) of ``instance.variable`` to record; outputs and local variables can be. Nothing
            given: all outputs.
        coupling: delays of connections; None has none.

    Raises:
        SystemDescriptionError: a pattern matches nothing.
    """
    delayed: list[Delayed] = []
    ports = {kind: _Ports() for kind in KINDS}
    kinds = {
        (instance.name, name): set_kind(v)
        for instance in checked.instances
        for name, v in instance.fmu.variables.items()
    }
    links = [link for link in checked.links if not link.initial_only]
    numeric = [link for link in links if kinds[link.target] in KINDS]
    needed = {link.source for link in numeric}
    needed |= {(instance, v.name) for node in network.nodes for instance, v in node.position}
    if coupling is not None and coupling.variable:
        needed |= {(i.name, v.name) for i in checked.instances for v in i.fmu.variables.values() if shows_error(v)}
    chosen = _chosen(checked, record)
    for i, instance in enumerate(checked.instances):
        for name, variable in _fetched(instance, needed | chosen):
            kind = set_kind(variable)
            if kind in KINDS:
                ports[kind].index[instance.name, name] = len(ports[kind].outputs)
                ports[kind].outputs += [(i, variable)] * (1 + variable.wide)
        for kind in KINDS:
            ports[kind].first_out.append(len(ports[kind].outputs))
    mirrors, mapped, constants = _inputs(checked, numeric, ports, coupling or Coupling(), delayed)
    signals: dict[str, tuple[tuple[str, Variable], ...]] = {}
    for kind in KINDS:
        columns = []
        for key, index in ports[kind].index.items():
            if key in chosen:
                variable = ports[kind].outputs[index][1]
                ports[kind].recorded += [index, index + 1] if variable.wide else [index]
                columns.append((f"{key[0]}.{key[1]}", variable))
        signals[kind] = tuple(columns)
    strings = tuple(link for link in links if kinds[link.target] in ("String", "Binary"))
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


def _by_type(instance: Instance) -> list[tuple[str, Variable]]:
    """The variables of an instance, those of one FMI 3 type together: they are got and set in one call.

    Variables that belong to Clocks come after the others: the loop has their values, but does not set and get them.
    """
    return sorted(instance.fmu.variables.items(), key=lambda item: _call_of(item[1]))


def _call_of(v: Variable) -> tuple[str, bool, bool]:
    """What the variables of an instance that are set or got in one call have in common."""
    return v.fmi_type, v.wide, bool(v.clocks)


def _array(v: Variable) -> tuple[str, int] | None:
    """What the elements of one array have in common; aliases of it are other arrays."""
    return None if v.element is None else (v.name.rpartition("[")[0], v.value_reference)


def _fetched(instance: Instance, wanted: set[tuple[str, str]]) -> list[tuple[str, Variable]]:
    """The variables of an instance that are in `wanted`, and all elements of an array of which one is."""
    variables = instance.fmu.variables
    arrays = {_array(v) for name, v in variables.items() if (instance.name, name) in wanted} - {None}
    return [
        (name, v)
        for name, v in _by_type(instance)
        if (instance.name, name) in wanted or (arrays and _array(v) in arrays)
    ]


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
        # [1] is an index in a variable's name, not a set of characters
        matching = fnmatch.filter(candidates, pattern.replace("[", "[[]"))
        if not matching:
            some = ", ".join(list(candidates)[:3])
            problems.append(
                Problem(Where("--record"), f"{pattern} matches no output or local variable (such as {some})")
            )
        chosen |= {candidates[name] for name in matching}
    if problems:
        raise SystemDescriptionError(problems)
    return chosen


def _inputs(
    checked: CheckedSystem,
    links: Sequence[Link],
    ports: Mapping[str, _Ports],
    coupling: Coupling,
    delayed: list[Delayed],
) -> tuple[
    tuple[tuple[int, int], ...], tuple[tuple[int, int, int, int], ...], tuple[tuple[float, ...], tuple[int, ...]]
]:
    """Fill in what feeds every input.

    Integers and booleans that are mapped on the way get a place behind all outputs of `int_out`, integer sources of
    real inputs get a mirror among the reals; returns the rows (from, to) of the mirrors, those of `Plan.mapped`, and
    `Layout.constants`.
    """
    by_instance: dict[str, dict[str, Link]] = {}
    for one in links:
        by_instance.setdefault(one.target[0], {})[one.target[1]] = one
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
        source = ports[source_kind].index[link.source]
        wide = ports[source_kind].outputs[source][1].wide
        first = integers if source_kind == "Boolean" else 0
        if link.mapping:
            at = first + source
            rows = [(at, COPY, 0), (at + 1, COPY, 1)] if wide else [(at, COPY, 0)]
            rows += [(-1 - at if wide else at, _signed(key), _signed(value)) for key, value in link.mapping]
            source = place_of((at, link.mapping), rows) - first
        if set_kind(target) == "Real" and source_kind == "Integer":
            source = mirrors.setdefault(-1 - source if wide else source, reals + len(mirrors))
        if not target.wide:
            return [source]
        return [source, source + 1 if wide else place_of((first + source, SIGN), [(first + source, SIGN, 0)]) - first]

    for instance in checked.instances:
        own = by_instance.get(instance.name, {})
        starts = instance.effective_values() if own else {}
        for name, target in _fetched(instance, {(instance.name, name) for name in own}):
            kind = set_kind(target)
            if (link := own.get(name)) is not None:
                sources, factor, offset = sources_of(link, target), link.factor, link.offset
                if (delay := coupling.delays.get(link.target)) is not None:
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


def make_plan(
    places: Layout,
    clock: Timing,
    network: Network,
    living: Sequence[Living],
    every: int,
    *,
    free: Sequence[int] = (),
    threads: int = 1,
    coupling: Coupling | None = None,
) -> Plan:
    """The plan of a run over living instances, in the order of `places.instances`.

    Args:
        every: rows every so many base steps.
        free: numbers of the instances that any thread may step.
        threads: how many will step them, the main one included.
        coupling: the master; None is Jacobi.
    """
    kinds = [places.ports[kind] for kind in KINDS]
    real = kinds[0]
    reals_in, reals_out = len(real.in_reference), len(real.outputs)
    int_recorded = [
        i + (len(kinds[1].outputs) if n else 0) for n, ports in enumerate(kinds[1:]) for i in ports.recorded
    ]
    rows = max(16, min(_BLOCK_BYTES // (8 * len(real.recorded) + 4 * len(int_recorded) + 8), 65536))
    integers = sum(len(ports.outputs) for ports in kinds[1:])
    own = (reals_out + len(places.mirrors), integers + len({row[1] for row in places.mapped}))
    sources = [
        i + (len(kinds[1].outputs) if n == 2 else 0) if i >= 0 else own[min(n, 1)] - 1 - i
        for n, ports in enumerate(kinds)
        for i in ports.source
    ]
    wires = np.zeros(reals_in, dtype=WIRE)
    wires["factor"], wires["offset"] = real.factor, real.offset
    feeds = _feeds(places, wires)
    ports, text, capacity = _packet_ports(places, network)
    block = 0 if threads == 1 else max(1, min(32, len(free) // (4 * threads)))
    values = _Values(
        in_reference=np.array([x for p in kinds for x in p.in_reference], dtype=np.uint32),
        real_in=np.zeros(reals_in),
        int_in=np.zeros(sum(len(p.in_reference) for p in kinds[1:]), dtype=np.int32),
        out_reference=np.array([v.value_reference for p in kinds for _, v in p.outputs], dtype=np.uint32),
        real_out=np.concatenate([np.zeros(own[0]), places.constants[0]]),
        int_out=np.concatenate([np.zeros(own[1], np.int32), np.array(places.constants[1], np.int32)]),
    )
    delays, kept = _delay_table(places, clock, own, len(kinds[1].outputs))
    native = _Native(len(living), kinds)
    eventful = sum(isinstance(one, Instance3) and one.event_mode for one in living)
    instances = _instance_table(clock, network, living, native)
    sequence = coupling.sequence if coupling is not None else ()
    order = BY_PYTHON if coupling and coupling.loops else IN_ORDER if sequence else JACOBI
    slopes = _slope_table(places, coupling, kept.size)
    kept = np.concatenate([kept, np.zeros(slopes.size + int(coupling is not None and coupling.variable))])
    return Plan(
        instances=table(instances),
        calls=table(_calls(instances, feeds, values, ports, living, kinds, native, slopes, kept)),
        feeds=table(feeds),
        runs=table(_runs(feeds, clock.periods)),
        sources=np.array(sources, dtype=np.uint32),
        wires=table(wires),
        in_reference=values.in_reference,
        real_in=values.real_in,
        int_in=values.int_in,
        out_reference=values.out_reference,
        real_out=values.real_out,
        int_out=values.int_out,
        mirrors=np.array(places.mirrors, dtype=np.int64).reshape(-1, 2),
        mapped=np.array(places.mapped, dtype=np.int64).reshape(-1, 4),
        ports=table(ports),
        text=text,
        scratch=np.zeros((threads, text.shape[1]), dtype=np.uint8),
        tx=np.zeros((ports.size, capacity), dtype=np.uint8),
        real_recorded=np.array(real.recorded, dtype=np.int64),
        int_recorded=np.array(int_recorded, dtype=np.int64),
        real_block=np.zeros((rows, len(real.recorded))),
        int_block=np.zeros((rows, len(int_recorded)), dtype=np.int32),
        ticks=np.zeros(rows, dtype=np.int64),
        clock=np.array(
            [
                -1,
                SEND,
                0,
                0,
                clock.start,
                clock.base,
                clock.steps,
                every,
                reals_in,
                reals_out,
                block,
                eventful,
                order,
                1,
                int(not (coupling and coupling.variable)),
            ]
        ),
        delays=table(delays),
        slopes=table(slopes),
        kept=kept,
        confined=np.array(sequence or sorted(set(range(len(living))) - set(free)), dtype=np.int64),
        free=np.array(sorted(free), dtype=np.int64),
        shared=np.zeros(40, dtype=np.int64),
        native=native.memory,
    )


def _delay_table(
    places: Layout, clock: Timing, own: tuple[int, int], integers: int
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """The DELAY table, and the values that are on their way at the start.

    Args:
        own: where constants begin, of reals and of integers.
        integers: how many integer outputs come before the booleans.
    """
    table = np.zeros(len(places.delays), dtype=DELAY)
    kept: list[float] = []
    for row, one in zip(table, places.delays, strict=True):
        whole = min(one.kind, 1)
        row["whole"], row["source"] = whole, one.source + (integers if one.kind == 2 else 0)
        row["place"] = own[whole] + one.constant
        row["factor"], row["offset"] = one.link.factor, one.link.offset
        row["first"], row["length"] = len(kept), one.ns // clock.base
        kept += [float(one.start)] * int(row["length"])
    return table, np.array(kept)


def _slope_table(places: Layout, coupling: Coupling | None, first: int) -> np.ndarray[Any, Any]:
    """The SLOPE table; derivatives are in `Plan.kept` from `first` on."""
    real, wanted = places.ports["Real"], coupling.extrapolated if coupling is not None else frozenset()
    found = [
        (j, i)
        for i, instance in enumerate(places.instances)
        for j in range(real.first_in[i], real.first_in[i + 1])
        if wanted and (instance.name, real.inputs[j].name) in wanted
    ]
    table = np.zeros(len(found), dtype=SLOPE)
    for n, (row, (j, i)) in enumerate(zip(table, found, strict=True)):
        row["input"], row["instance"], row["place"] = j, i, first + n
    return table


class _Native:
    """Memory that FMI 3 calls point to, handed out piece by piece."""

    def __init__(self, instances: int, kinds: Sequence[_Ports]) -> None:
        values = sum(len(ports.inputs) + len(ports.outputs) for ports in kinds)
        calls = values + 2 * instances
        self.memory = np.zeros(ANSWERS * (instances + 1) + 32 * values + TYPED.itemsize * calls + 256, dtype=np.uint8)
        self._used = -self.memory.ctypes.data % 16
        self._known: dict[tuple[int, ...], int] = {}

    def take(self, size: int) -> int:
        """The address of `size` bytes, a multiple of 8."""
        first = self._used
        self._used += -(-size // 8) * 8
        assert self._used <= self.memory.size
        return int(self.memory.ctypes.data) + first

    def put(self, numbers: Sequence[int]) -> int:
        """The address of value references; instances of one FMU have the same."""
        if (known := self._known.get(tuple(numbers))) is not None:
            return known
        address = self._known[tuple(numbers)] = self.take(4 * len(numbers))
        first = address - self.memory.ctypes.data
        self.memory[first : first + 4 * len(numbers)] = np.array(numbers, np.uint32).view(np.uint8)
        return address

    def typed(self, **fields: int) -> int:
        """The address of a TYPED record."""
        address = self.take(TYPED.itemsize)
        first = address - self.memory.ctypes.data
        self.memory[first : first + TYPED.itemsize].view(TYPED)[0] = tuple(fields[name] for name in TYPED.names or ())
        return address


def _instance_table(clock: Timing, network: Network, living: Sequence[Living], native: _Native) -> np.ndarray[Any, Any]:
    table = np.zeros(len(living), dtype=INSTANCE)
    table["handle"] = [one.handle for one in living]
    table["do_step"] = [one.library.address(f"fmi{_version(one)}DoStep") for one in living]
    table["answers"] = [native.take(ANSWERS) if _version(one) == 3 else 0 for one in living]
    for row, one in zip(table, living, strict=True):
        if isinstance(one, Instance3):
            one.use_answers(int(row["answers"]))
    libraries = {id(one.library): i for i, one in enumerate(living)}
    table["library"] = [libraries[id(one.library)] for one in living]
    table["period"] = table["length"] = clock.periods
    table["h"] = [period * clock.base / 1e9 for period in clock.periods]
    endpoint = {e.instance: i for i, e in enumerate(e for node in network.nodes for e in node.endpoints)}
    table["endpoint"] = [endpoint.get(one.name, -1) for one in living]
    return table


def _feeds(places: Layout, wires: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The FEED table, instance by instance."""
    table = np.zeros(len(places.instances), dtype=FEED)
    table["instance"] = np.arange(len(table))
    inputs = outputs = 0
    for kind, name in enumerate(KINDS):
        ports = places.ports[name]
        table["first_in"][:, kind] = np.add(ports.first_in[:-1], inputs)
        table["last_in"][:, kind] = np.add(ports.first_in[1:], inputs)
        table["first_out"][:, kind] = np.add(ports.first_out[:-1], outputs)
        table["last_out"][:, kind] = np.add(ports.first_out[1:], outputs)
        inputs += len(ports.in_reference)
        outputs += len(ports.outputs)
    changed = np.concatenate([[0], np.cumsum((wires["factor"] != 1.0) | (wires["offset"] != 0.0))])
    table["plain"] = changed[table["first_in"][:, 0]] == changed[table["last_in"][:, 0]]
    return table


def _runs(feeds: np.ndarray[Any, Any], periods: Sequence[int]) -> np.ndarray[Any, Any]:
    """Feeds of neighbouring instances with one period as one: their inputs lie behind each other."""
    begins = np.ones(len(feeds), dtype=bool)
    begins[1:] = (np.diff(periods) != 0) | (np.diff(feeds["plain"].astype(np.int64)) != 0)
    runs = feeds[begins]
    ends = np.append(np.flatnonzero(begins)[1:], len(feeds)) - 1
    runs["last_in"], runs["last_out"] = feeds["last_in"][ends], feeds["last_out"][ends]
    return runs


@dataclass(frozen=True, slots=True)
class _Values:
    """Where values and their references live: see `Plan`."""

    in_reference: np.ndarray[Any, Any]
    real_in: np.ndarray[Any, Any]
    int_in: np.ndarray[Any, Any]
    out_reference: np.ndarray[Any, Any]
    real_out: np.ndarray[Any, Any]
    int_out: np.ndarray[Any, Any]


def _version(one: Living) -> int:
    return int(one.fmu.fmi_version[0])


def _calls(
    instances: np.ndarray[Any, Any],
    feeds: np.ndarray[Any, Any],
    values: _Values,
    ports: np.ndarray[Any, Any],
    living: Sequence[Living],
    kinds: Sequence[_Ports],
    native: _Native,
    slopes: np.ndarray[Any, Any],
    kept: np.ndarray[Any, Any],
) -> np.ndarray[Any, Any]:
    """The CALL table; notes in `instances` which calls are whose."""
    rows: list[tuple[int, ...]] = []
    reals = (len(kinds[0].inputs), len(kinds[0].outputs))
    sides = (
        ("Set", "in", values.in_reference.ctypes.data, values.real_in.ctypes.data, values.int_in.ctypes.data, reals[0]),
        (
            "Get",
            "out",
            values.out_reference.ctypes.data,
            values.real_out.ctypes.data,
            values.int_out.ctypes.data,
            reals[1],
        ),
    )
    variables = {"in": [v for p in kinds for v in p.inputs], "out": [v for p in kinds for _, v in p.outputs]}
    for i, one in enumerate(living):
        row = instances[i]
        for verb, side, references, real_values, int_values, n_reals in sides:
            row["first_set" if verb == "Set" else "first_get"] = len(rows)
            if verb == "Set":
                rows += _packet_call(verb, one, ports, int(row["endpoint"]), native)
                row["first_set_value"] = len(rows)
            for kind, name in enumerate(KINDS):
                first, last = int(feeds[i][f"first_{side}"][kind]), int(feeds[i][f"last_{side}"][kind])
                if last > first:
                    at = real_values + 8 * first if kind == 0 else int_values + 4 * (first - n_reals)
                    if _version(one) == 3:
                        rows += _typed(verb, one, variables[side][first:last], at, 8 if kind == 0 else 4, native)
                        continue
                    address = one.library.address(f"fmi2{verb}{name}")
                    number = (1 if verb == "Set" else 6) + kind
                    rows.append((address, one.handle, references + 4 * first, at, last - first, number, 0))
            if verb == "Get":
                rows += _packet_call(verb, one, ports, int(row["endpoint"]), native)
            elif (own := slopes[slopes["instance"] == i]).size:
                rows.append(_slope_call(one, own, values.in_reference, kept, native))
        row["last_get"] = len(rows)
    return np.array(rows, dtype=CALL)


def _slope_call(
    one: Living,
    slopes: np.ndarray[Any, Any],
    references: np.ndarray[Any, Any],
    kept: np.ndarray[Any, Any],
    native: _Native,
) -> tuple[int, ...]:
    """fmi2SetRealInputDerivatives: as FMI 3 calls it has five arguments; the last two are orders and derivatives."""
    name = "fmi2SetRealInputDerivatives"
    derivatives = kept.ctypes.data + kept.itemsize * int(slopes["place"][0])
    typed = native.typed(values=native.put([1] * slopes.size), n_values=derivatives, sizes=0, plain=0, sets=1)
    numbers = native.put([int(references[j]) for j in slopes["input"]])
    address, n, width = one.library.address(name), slopes.size, WIDTHS["Float64"]
    return (address, one.handle, numbers, typed, n, FUNCTIONS.index(name), width)


def _packet_call(
    verb: str, one: Living, ports: np.ndarray[Any, Any], endpoint: int, native: _Native
) -> list[tuple[int, ...]]:
    """The call that sets or gets the packets of an instance, if it has such a port."""
    has, reference, text, size = (
        ("has_rx", "rx", "text", "rx_size") if verb == "Set" else ("has_tx", "tx", "got", "got_size")
    )
    if endpoint < 0 or not ports[endpoint][has]:
        return []
    fields = PORTS.fields
    assert fields is not None
    row = ports.ctypes.data + PORTS.itemsize * int(endpoint)
    places = [row + fields[name][1] for name in (reference, text, size)]
    number = SET_STRING if verb == "Set" else GET_STRING
    if _version(one) == 3:
        address, number = one.library.address(f"fmi3{verb}Binary"), FUNCTIONS.index(f"fmi3{verb}Binary")
        typed = native.typed(values=places[1], n_values=1, sizes=places[2], plain=0, sets=int(verb == "Set"))
        return [(address, one.handle, places[0], typed, 1, number, WIDTHS["Binary"])]
    return [(one.library.address(f"fmi2{verb}String"), one.handle, places[0], places[1], 1, number, 0)]


def _typed(
    verb: str, one: Living, variables: Sequence[Variable], plain: int, size: int, native: _Native
) -> list[tuple[int, ...]]:
    """FMI 3 calls for variables whose values lie at `plain`, `size` bytes each: one for each type."""
    rows: list[tuple[int, ...]] = []
    first = 0
    while first < len(variables):
        fmi_type, wide, clocked = key = _call_of(variables[first])
        last = first
        references: list[int] = []
        while last < len(variables) and _call_of(variables[last]) == key:
            if not variables[last].element:  # a scalar, or where an array begins
                references.append(variables[last].value_reference)
            last += 1 + wide
        if clocked:
            first = last
            continue
        n, at = (last - first) // (1 + wide), plain + size * first
        buffer = at if fmi_type in ("Float64", "Int32") else native.take(8 * n)
        address, number = one.library.address(f"fmi3{verb}{fmi_type}"), FUNCTIONS.index(f"fmi3{verb}{fmi_type}")
        if buffer == at and n < 1 << 16:
            packed = len(references) | n << 16
            rows.append((address, one.handle, native.put(references), at, packed, number, PACKED))
            first = last
            continue
        typed = native.typed(values=buffer, n_values=n, sizes=0, plain=at, sets=int(verb == "Set"))
        width = (WIDE_WIDTHS if wide else WIDTHS)[fmi_type]
        rows.append((address, one.handle, native.put(references), typed, len(references), number, width))
        first = last
    return rows


def _packet_ports(places: Layout, network: Network) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], int]:
    """The PORTS table, the texts it points to, and the largest capacity."""
    endpoints = [endpoint for node in network.nodes for endpoint in node.endpoints]
    number = {instance.name: i for i, instance in enumerate(places.instances)}
    capacity = max([v.packet_capacity or 0 for e in endpoints for v in (e.rx, e.tx) if v is not None], default=1)
    text = np.zeros((max(len(endpoints), 1), 4 * -(-capacity // 3) + 4), dtype=np.uint8)
    table = np.zeros(len(endpoints), dtype=PORTS)
    table["instance"] = [number[e.instance] for e in endpoints]
    table["has_rx"] = [e.rx is not None for e in endpoints]
    table["has_tx"] = [e.tx is not None for e in endpoints]
    table["rx"] = [e.rx.value_reference if e.rx else 0 for e in endpoints]
    table["tx"] = [e.tx.value_reference if e.tx else 0 for e in endpoints]
    of_fmi3 = {i.name for i in places.instances if i.fmu.fmi_version.startswith("3.")}
    table["binary"] = [e.instance in of_fmi3 for e in endpoints]
    table["text"] = text.ctypes.data + text.shape[1] * np.arange(len(endpoints), dtype=np.uint64)
    return table, text, capacity


def _hash(name: str) -> int:
    """FNV-1a, 64 bit: the identity of a node or an endpoint, for the random numbers of its links."""
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def _topology(network: Network) -> int:
    if network.topology == "nearest":
        return radio_kernels.NEAREST if network.axis is None else radio_kernels.NEAREST_ON_AXIS
    return radio_kernels.LISTED if network.topology == "listed" else radio_kernels.BROADCAST


def _nanoseconds(seconds: float) -> int:
    return 2**62 if seconds > 9e9 else round(seconds * _NANO)


def _gateways(network: Network) -> np.ndarray[Any, Any]:
    """The GATEWAY table; their endpoints are the last ones."""
    instances = [e.instance for node in network.nodes for e in node.endpoints]
    table = np.zeros(len(network.gateways), dtype=GATEWAY)
    for g, gateway in enumerate(network.gateways):
        table[g]["endpoint"] = len(instances) + g
        table[g]["wired"] = -1 if gateway.wired is None else instances.index(gateway.wired)
        table[g]["latency"], table[g]["jitter"] = _nanoseconds(gateway.latency), _nanoseconds(gateway.jitter)
        table[g]["loss"] = gateway.loss
    return table


def _definition(message: Message) -> tuple[int, int, int]:
    return message.id, message.crc_extra, next((f.offset for f in message.fields if f.name == "target_system"), -1)


def make_radio(network: Network, places: Layout, *, keep: bool) -> Radio:
    """The radio's memory. `keep`: write packet events and logs."""
    nodes = network.nodes
    names = {node.name: n for n, node in enumerate(nodes)}
    settings = np.zeros(1, dtype=SETTINGS)
    settings["topology"] = _topology(network)
    settings["per_side"] = min(network.neighbours, max(len(nodes) - 1, 1))
    settings["axis"] = network.axis or (0.0, 0.0, 0.0)
    settings["latency"], settings["jitter"] = _nanoseconds(network.latency), _nanoseconds(network.jitter)
    settings["loss"], settings["range"] = network.loss, network.range
    settings["seed"], settings["keep"] = network.seed, keep
    hearers: list[list[int]] = [[] for _ in nodes]
    for a, b in sorted((names[a], names[b]) for a, b in network.links):
        hearers[a].append(b)
    listed = np.cumsum([0, *(len(row) for row in hearers)])
    members = np.cumsum([0, *(len(node.endpoints) for node in nodes)])
    reals = places.ports["Real"].index
    node_table = np.zeros(len(nodes) + len(network.gateways), dtype=NODE)
    for n, node in enumerate(nodes):
        place = [reals[instance, variable.name] for instance, variable in node.position] or [-1, -1, -1]
        node_table[n] = (place, _hash(node.name), members[n], members[n + 1], listed[n], listed[n + 1])
    endpoints = np.zeros(int(members[-1]) + len(network.gateways), dtype=ENDPOINT)
    for i, (n, e) in enumerate((n, e) for n, node in enumerate(nodes) for e in node.endpoints):
        endpoints[i] = (n, _hash(e.instance), 0, e.rx.packet_capacity if e.rx else 0, 0, -1, -1)
    for g, gateway in enumerate(network.gateways):
        behind = int(members[-1]) + g
        node_table[len(nodes) + g] = ([-1, -1, -1], _hash(gateway.name), behind, behind + 1, 0, 0)
        endpoints[behind] = (len(nodes) + g, _hash(gateway.name), 0, GATEWAY_BYTES, 0, -1, -1)
    outages = [(names[n], _nanoseconds(a), _nanoseconds(b)) for n, a, b in network.outages]
    empty = Radio(
        settings=table(settings),
        endpoints=table(endpoints),
        nodes=table(node_table),
        links=np.array([b for row in hearers for b in row], dtype=np.int64),
        outages=np.array(outages, dtype=np.int64).reshape(-1, 3),
        places=table(np.zeros(0, dtype=PLACE)),
        data=np.zeros((0, SLOT), dtype=np.uint8),
        order=np.arange(len(nodes), dtype=np.int64),
        along=np.zeros(len(nodes)),
        hearers=np.zeros(len(nodes) + 1, dtype=np.int64),
        counters=np.zeros(COUNTERS, dtype=np.int64),
        events=table(np.zeros(4096, dtype=EVENT)),
        log=np.zeros(1 << 20, dtype=np.uint8),
        gateways=table(_gateways(network)),
        dialect=table(np.array([_definition(message) for message in network.dialect], dtype=DEFINITION)),
    )
    empty.counters[FREE_PLACE] = -1
    return grown(empty, 256)


def grown(radio: Radio, need: int) -> Radio:
    """The same radio with at least `need` more free places in flight."""
    old = radio.places.size
    new = max(2 * old, old + need)
    places = np.zeros(new, dtype=PLACE)
    places[:old] = radio.places
    places["following"][old:] = np.arange(old + 1, new + 1)
    places["following"][-1] = radio.counters[FREE_PLACE]
    data = np.zeros((new, SLOT), dtype=np.uint8)
    data[:old] = radio.data
    radio.counters[FREE_PLACE] = old
    radio.counters[FREE_PLACES] += new - old
    return radio._replace(places=table(places), data=data)

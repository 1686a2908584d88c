"""The plan of a run: flat arrays for the stepping loop, made from layout and instances."""

from __future__ import annotations

import mmap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.kernel import table
from cosim_master.fmi.calls import CALL, KINDS, CallMemory, Calls, PacketPlaces, Row
from cosim_master.fmi.description.variables import Variable
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.kernels.tables import (
    AHEAD,
    ANSWERS,
    BASE,
    BLOCK,
    BY_PYTHON,
    DELAY,
    EVENTFUL,
    EVERY,
    EXPECTING,
    FEED,
    FINAL,
    FINER,
    GROUP,
    IN_ORDER,
    INBOX,
    INSTANCE,
    JACOBI,
    LAST,
    NAN_ALLOWED,
    ORDER,
    PER_NS,
    PHASE,
    PLACES,
    PORTS,
    REALS_IN,
    REALS_OUT,
    SEND,
    SLOPE,
    START,
    WIRE,
    K,
    Plan,
)
from cosim_master.stepping.layout import TERM, Layout, Ports
from cosim_master.stepping.whole import enter_whole_steps, memory_of_whole_steps
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["make_plan", "page_of", "rows_of_block", "runs_of"]

_BLOCK_BYTES = 1 << 20
"""Of values; a block should remain in the processor's cache until it is handed over."""
_COUNTERS, _SHARED_AT = 21, 512
"""Number of counters, and the place of `Plan.shared` in the page that begins with them, bytes."""
_BOUNDS = ("first_set", "first_set_value", "last_set", "first_get", "last_get")
"""The columns of INSTANCE with numbers of calls."""
_WORTH_EXPECTING = 256
"""Least number of free instances whose memory is prefetched; fewer stay in the cache of a core."""


def make_plan(
    layout: Layout,
    clock: TimeGrid,
    network: Network,
    slaves: Sequence[Slave],
    every: int,
    *,
    free: Sequence[int] = (),
    threads: int = 1,
    master: MasterSettings | None = None,
    grid: bool = False,
) -> Plan:
    """Returns the plan of a run over instances, in the order of `layout.instances`.

    Args:
        every: base steps between two rows.
        free: numbers of the instances that any thread may step.
        threads: number of threads that step instances, including the main one.
        master: the master algorithm; None is Jacobi.
        grid: rows and exchange at every base step, even if no step of an instance ends there.
    """
    master = master or MasterSettings()
    kinds = [layout.ports[kind] for kind in KINDS]
    real, recorded = kinds[0], _recorded_integers(kinds)
    rows = rows_of_block(layout)
    wires = np.zeros(len(real.inputs), dtype=WIRE)
    wires["factor"], wires["offset"] = real.factor, real.offset
    feeds = _feeds(layout, wires)
    n_values = sum(len(one.inputs) + len(one.outputs) for one in kinds)
    further = ANSWERS * (len(slaves) + 1) + memory_of_whole_steps(len(free), n_values)
    memory = CallMemory(n_values + 2 * len(slaves), n_values, further)
    calls = [one.calls(memory) for one in slaves]
    ports, rx, capacity = _packet_ports(layout, network, calls)
    constants = _first_constants(layout, kinds)
    values = _values(layout, kinds, constants)
    delays, delay_line = _delay_table(layout, clock, constants, len(kinds[1].outputs))
    slopes = _slope_table(layout, master)
    derivatives = np.zeros(slopes.size)
    instances = _instance_table(clock, network, slaves, memory, free)
    # Large blocks, if each thread gets many: the first instances of a block are not prefetched.
    block = 0 if threads == 1 else max(1, min(32, len(free) // (4 * threads)), min(96, len(free) // (32 * threads)))
    rows_of_calls = _calls(instances, feeds, values, ports, calls, kinds, slopes, derivatives)
    enter_whole_steps(instances, ports, rows_of_calls, slaves, free, memory)
    confined = [*(master.sequence or sorted(set(range(len(slaves))) - set(free)))]
    page = mmap.mmap(-1, mmap.PAGESIZE)
    return Plan(
        instances=table(instances),
        calls=table(np.array(rows_of_calls, dtype=CALL)),
        feeds=table(feeds),
        input_runs=table(runs_of(feeds, clock.periods)),
        sources=_sources(kinds, constants),
        wires=table(wires),
        real_in=values.real_in,
        int_in=values.int_in,
        real_out=values.real_out,
        int_out=values.int_out,
        int_to_real=np.array(layout.int_to_real, dtype=np.int64).reshape(-1, 2),
        value_maps=np.array(layout.value_maps, dtype=np.int64).reshape(-1, 4),
        ports=table(ports),
        rx=rx,
        received=np.zeros((threads, capacity), dtype=np.uint8),
        tx=np.zeros((ports.size, capacity), dtype=np.uint8),
        encoded=np.zeros((threads, rx.shape[1]), dtype=np.uint8),
        real_recorded=np.array(real.recorded, dtype=np.int64),
        int_recorded=np.array(recorded, dtype=np.int64),
        real_block=np.zeros((rows, len(real.recorded))),
        int_block=np.zeros((rows, len(recorded)), dtype=np.int32),
        ticks=np.zeros(rows, dtype=np.int64),
        counters=_counters(page, clock, master, slaves, real, instances, every=every, block=block),
        grids=np.array([] if grid else clock.grids, dtype=np.int64),
        delays=table(delays),
        slopes=table(slopes),
        derivatives=derivatives,
        delay_line=delay_line,
        step_sizes=np.zeros(master.memory),
        confined=np.array(confined, dtype=np.int64),
        free=_by_library(instances, free),
        ahead=table(_ahead_table(slaves, confined)),
        groups=table(np.zeros(0, dtype=GROUP)),
        members=np.zeros(0, dtype=np.int64),
        inboxes=table(np.zeros(0, dtype=INBOX)),
        positions=np.zeros((0, 3), dtype=np.int64),
        past=np.zeros((0, 0)),
        shared=np.ndarray(PLACES + 8, np.int64, page, _SHARED_AT),
        native=memory.memory,
    )


def rows_of_block(layout: Layout) -> int:
    """Returns the number of rows of a full block."""
    kinds = [layout.ports[kind] for kind in KINDS]
    return max(16, min(_BLOCK_BYTES // (8 * len(kinds[0].recorded) + 4 * len(_recorded_integers(kinds)) + 8), 65536))


def page_of(plan: Plan) -> mmap.mmap:
    """Returns the memory page of `Plan.counters` and `Plan.shared`, which is used for nothing else."""
    page = plan.counters.base
    assert isinstance(page, mmap.mmap)
    return page


def _counters(
    page: mmap.mmap,
    clock: TimeGrid,
    master: MasterSettings,
    slaves: Sequence[Slave],
    real: Ports,
    instances: np.ndarray[Any, Any],
    *,
    every: int,
    block: int,
) -> np.ndarray[Any, Any]:
    """Returns `Plan.counters` at the start of a run."""
    counters = np.ndarray(_COUNTERS, np.int64, page)
    counters[K], counters[PHASE], counters[FINER] = -1, SEND, 1
    counters[START], counters[BASE], counters[LAST] = clock.start, clock.base, clock.steps
    counters[PER_NS], counters[EVERY], counters[BLOCK] = clock.per_ns, every, block
    counters[REALS_IN], counters[REALS_OUT] = len(real.inputs), len(real.outputs)
    counters[EVENTFUL] = sum(one.event_mode for one in slaves)
    counters[ORDER] = BY_PYTHON if master.in_python else IN_ORDER if master.sequence else JACOBI
    counters[FINAL], counters[NAN_ALLOWED] = not master.variable, master.nan
    counters[EXPECTING] = bool(instances["expect"].any())
    return counters


def _ahead_table(slaves: Sequence[Slave], confined: Sequence[int]) -> np.ndarray[Any, Any]:
    """Returns `Plan.ahead`: the instances whose steps can begin before the others step, unless there are no others.

    Those in Event Mode are left out, because their steps may end at an event that they have announced.
    """
    found = []
    for i in confined if len(slaves) > 1 else ():
        one = slaves[i]
        if one.library.isolated and not one.event_mode and (functions := one.library.ahead(one.step_address())):
            found.append((i, *functions))
    return np.array(found, dtype=AHEAD)


def _recorded_integers(kinds: Sequence[Ports]) -> list[int]:
    """Returns the indices of recorded integers and booleans in `Plan.int_out`."""
    integers, booleans = kinds[1:]
    return [*integers.recorded, *(len(integers.outputs) + i for i in booleans.recorded)]


def _first_constants(layout: Layout, kinds: Sequence[Ports]) -> tuple[int, int]:
    """Returns the index of the first of `Layout.constants` in `Plan.real_out` and in `Plan.int_out`."""
    reals, integers, booleans = (len(ports.outputs) for ports in kinds)
    return reals + len(layout.int_to_real), integers + booleans + len({row[1] for row in layout.value_maps})


def _sources(kinds: Sequence[Ports], constants: tuple[int, int]) -> np.ndarray[Any, Any]:
    """Returns, for each input, the index of its source in `Plan.real_out` or `Plan.int_out`."""
    sources = []
    for kind, ports in enumerate(kinds):
        first, constant = len(kinds[1].outputs) if kind == 2 else 0, constants[min(kind, 1)]
        sources += [first + i if i >= 0 else constant - 1 - i for i in ports.source]
    return np.array(sources, dtype=np.uint32)


def _values(layout: Layout, kinds: Sequence[Ports], constants: tuple[int, int]) -> _Values:
    """Returns the arrays of values, zero except for constants."""
    return _Values(
        real_in=np.zeros(len(kinds[0].inputs)),
        int_in=np.zeros(sum(len(p.inputs) for p in kinds[1:]), dtype=np.int32),
        real_out=np.concatenate([np.zeros(constants[0]), layout.constants[0]]),
        int_out=np.concatenate([np.zeros(constants[1], np.int32), np.array(layout.constants[1], np.int32)]),
    )


def _by_library(instances: np.ndarray[Any, Any], free: Sequence[int]) -> np.ndarray[Any, Any]:
    """Returns the numbers `free` in the order in which they step: those of one FMU together, else as in the system.

    A core's instruction cache holds the code of a vehicle's or an autopilot's step, not of both. The order does not
    change results: all inputs are set before the first instance steps, and packets are sent after the last one.
    """
    numbers = np.array(sorted(free), dtype=np.int64)
    return numbers[np.argsort(instances["library"][numbers], kind="stable")]


def _delay_table(
    layout: Layout, clock: TimeGrid, constants: tuple[int, int], integers: int
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Returns the DELAY table, and the values in the delay lines at the start.

    Args:
        constants: index of the first constant, of reals and of integers.
        integers: number of integer outputs, which come before the booleans.
    """
    table = np.zeros(len(layout.delays), dtype=DELAY)
    delay_line: list[float] = []
    for row, one in zip(table, layout.delays, strict=True):
        whole = min(one.kind, 1)
        row["whole"], row["source"] = whole, one.source + (integers if one.kind == 2 else 0)
        row["place"] = constants[whole] + one.constant
        row["factor"], row["offset"] = one.link.factor, one.link.offset
        steps = -1 if one.ns == TERM else round(one.ns * clock.per_ns / clock.base)
        row["first"], row["length"] = len(delay_line), steps
        delay_line += [float(one.start)] * max(steps, 0)
    return table, np.array(delay_line)


def _slope_table(layout: Layout, master: MasterSettings) -> np.ndarray[Any, Any]:
    """Returns the SLOPE table."""
    real, wanted = layout.ports["Real"], master.extrapolated
    found = [
        (j, i)
        for i, instance in enumerate(layout.instances if wanted else ())
        for j in range(real.first_in[i], real.first_in[i + 1])
        if (instance.name, real.inputs[j].name) in wanted
    ]
    table = np.zeros(len(found), dtype=SLOPE)
    for row, (j, i) in zip(table, found, strict=True):
        row["input"], row["instance"] = j, i
    return table


def _instance_table(
    clock: TimeGrid, network: Network, slaves: Sequence[Slave], memory: CallMemory, free: Sequence[int]
) -> np.ndarray[Any, Any]:
    table = np.zeros(len(slaves), dtype=INSTANCE)
    table["handle"] = [one.handle for one in slaves]
    table["do_step"] = [one.step_address() for one in slaves]
    if len(free) >= _WORTH_EXPECTING:
        table["expect"][free] = [slaves[i].library.address_if("uav_cosim_expect") for i in free]
    table["answers"] = [memory.take(ANSWERS) if one.has_answers else 0 for one in slaves]
    for row, one in zip(table, slaves, strict=True):
        one.use_answers(int(row["answers"]))
    libraries = {id(one.library): i for i, one in enumerate(slaves)}
    table["library"] = [libraries[id(one.library)] for one in slaves]
    table["period"] = table["length"] = clock.periods
    table["h"] = [clock.seconds(period) for period in clock.periods]
    endpoint: dict[str, int] = {}
    for i, e in enumerate(e for node in network.nodes for e in node.endpoints):
        endpoint.setdefault(e.instance, i)
    table["endpoint"] = [endpoint.get(one.name, -1) for one in slaves]
    return table


def _feeds(layout: Layout, wires: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Returns the FEED table, instance by instance."""
    feeds = np.zeros(len(layout.instances), dtype=FEED)
    table: Any = feeds  # mypy takes seconds for fields of fields
    table["instance"] = np.arange(len(table))
    inputs = outputs = 0
    for kind, name in enumerate(KINDS):
        ports = layout.ports[name]
        table["first_in"][:, kind] = np.add(ports.first_in[:-1], inputs)
        table["last_in"][:, kind] = np.add(ports.first_in[1:], inputs)
        table["first_out"][:, kind] = np.add(ports.first_out[:-1], outputs)
        table["last_out"][:, kind] = np.add(ports.first_out[1:], outputs)
        inputs += len(ports.inputs)
        outputs += len(ports.outputs)
    changed = np.concatenate([[0], np.cumsum((wires["factor"] != 1.0) | (wires["offset"] != 0.0))])
    table["plain"] = changed[table["first_in"][:, 0]] == changed[table["last_in"][:, 0]]
    return feeds


def runs_of(
    feeds: np.ndarray[Any, Any],
    periods: Sequence[int],
    firsts: Sequence[int] | np.ndarray[Any, Any] = (),
    here: np.ndarray[Any, Any] | None = None,
) -> np.ndarray[Any, Any]:
    """Returns the feeds of the instances that have inputs, joined where these are adjacent and of one period.

    Args:
        firsts: instances that are not joined with those before.
        here: whether each instance is fed; None: all.
    """
    table: Any = feeds
    fed = (table["last_in"] > table["first_in"]).any(axis=1)
    kept = np.flatnonzero(fed if here is None else fed & here)
    runs: Any = table[kept]
    if not kept.size:
        return np.asarray(runs)
    plain, period = runs["plain"].astype(np.int64), np.asarray(periods)[kept]
    group = np.searchsorted(np.asarray(firsts, dtype=np.int64), kept, side="right")
    begins = np.ones(kept.size, dtype=bool)
    begins[1:] = (np.diff(period) != 0) | (np.diff(plain) != 0) | (np.diff(group) != 0)
    begins[1:] |= (runs["first_in"][1:] != runs["last_in"][:-1]).any(axis=1)
    ends = np.append(np.flatnonzero(begins)[1:], kept.size) - 1
    joined, last = runs[begins], runs[ends]
    joined["last_in"], joined["last_out"] = last["last_in"], last["last_out"]
    return np.asarray(joined)


@dataclass(frozen=True, slots=True)
class _Values:
    """The arrays of values of a `Plan`."""

    real_in: np.ndarray[Any, Any]
    int_in: np.ndarray[Any, Any]
    real_out: np.ndarray[Any, Any]
    int_out: np.ndarray[Any, Any]


class _Side:
    """The inputs or the outputs of all instances, and where their values are."""

    def __init__(self, verb: str, variables: Sequence[Variable], reals: Any, integers: Any) -> None:
        self.reals = reals.size
        self._verb, self._variables = verb, variables
        self._settled = [one.settled for one in variables]
        self._real_values, self._int_values = reals.ctypes.data, integers.ctypes.data

    def first_settled(self, first: Sequence[int], last: Sequence[int]) -> list[int]:
        """Returns the first variable of each kind that never changes; they are behind those that may."""
        return [
            begin + sum(not settled for settled in self._settled[begin:end])
            for begin, end in zip(first, last, strict=True)
        ]

    def calls(self, calls: Calls, first: Sequence[int], last: Sequence[int]) -> list[Row]:
        """Returns the calls that set or get the variables `first` to `last` - 1 of each kind."""
        rows: list[Row] = []
        for kind, (name, begin, end) in enumerate(zip(KINDS, first, last, strict=True)):
            if end > begin:
                at = self._real_values + 8 * begin if kind == 0 else self._int_values + 4 * (begin - self.reals)
                rows += calls.values(self._verb, name, self._variables[begin:end], at)
        return rows


def _calls(
    instances: np.ndarray[Any, Any],
    feeds: np.ndarray[Any, Any],
    values: _Values,
    ports: np.ndarray[Any, Any],
    calls: Sequence[Calls],
    kinds: Sequence[Ports],
    slopes: np.ndarray[Any, Any],
    derivatives: np.ndarray[Any, Any],
) -> list[Row]:
    """Returns the rows of the CALL table, and stores in `instances` the calls that belong to each instance."""
    rows: list[Row] = []
    inputs = _Side("Set", [one for p in kinds for one in p.inputs], values.real_in, values.int_in)
    outputs = _Side("Get", [one for p in kinds for _, one in p.outputs], values.real_out, values.int_out)
    outputs.reals = len(kinds[0].outputs)  # real_out also holds values that are no outputs
    packets = _Packets(ports)
    sloped: dict[int, list[int]] = {}
    for n, i in enumerate(slopes["instance"].tolist()):
        sloped.setdefault(i, []).append(n)
    first_endpoint, further = instances["endpoint"].tolist(), ports["further"].tolist()
    first_in, last_in, first_out, last_out = (
        feeds[name].tolist() for name in ("first_in", "last_in", "first_out", "last_out")
    )
    bounds: dict[str, list[int]] = {name: [] for name in _BOUNDS}
    first_set, first_set_value, last_set, first_get, last_get = bounds.values()
    for i, one in enumerate(calls):
        endpoint = first_endpoint[i]
        last_endpoint = endpoint + 1 + further[endpoint] if endpoint >= 0 else -1
        first_set.append(len(rows))
        for e in range(endpoint, last_endpoint):
            rows += packets.calls("Set", one, e)
        first_set_value.append(len(rows))
        rows += inputs.calls(one, first_in[i], last_in[i])
        if own := sloped.get(i):
            extrapolated = [kinds[0].inputs[j] for j in slopes["input"][own]]
            rows.append(one.input_derivatives(extrapolated, derivatives[own[0] :].ctypes.data))
        last_set.append(len(rows))
        changing = outputs.first_settled(first_out[i], last_out[i])
        rows += outputs.calls(one, changing, last_out[i])
        first_get.append(len(rows))
        rows += outputs.calls(one, first_out[i], changing)
        rows += packets.calls("Get", one, endpoint)
        last_get.append(len(rows))
        for e in range(endpoint + 1, last_endpoint):
            ports[e]["get"] = len(rows)
            rows += packets.calls("Get", one, e)
    for name, numbers in bounds.items():
        instances[name] = numbers
    return rows


class _Packets:
    """The calls for the packets of endpoints.

    Args:
        ports: the PORTS table.
    """

    def __init__(self, ports: np.ndarray[Any, Any]) -> None:
        fields = PORTS.fields
        assert fields is not None
        self._first = ports.ctypes.data
        self._has = {"Set": ports["has_rx"].tolist(), "Get": ports["has_tx"].tolist()}
        names = {"Set": ("rx", "given", "given_size"), "Get": ("tx", "got", "got_size")}
        self._places = {verb: [int(fields[name][1]) for name in of] for verb, of in names.items()}

    def calls(self, verb: str, calls: Calls, endpoint: int) -> list[Row]:
        """Returns the call that sets or gets the packets of an endpoint, if it has such a port."""
        if endpoint < 0 or not self._has[verb][endpoint]:
            return []
        row = self._first + PORTS.itemsize * endpoint
        return [calls.packets(verb, PacketPlaces(*(row + place for place in self._places[verb])))]


def _packet_ports(
    layout: Layout, network: Network, calls: Sequence[Calls]
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], int]:
    """Returns the PORTS table, `Plan.rx` that it points to, and the largest capacity."""
    endpoints = [endpoint for node in network.nodes for endpoint in node.endpoints]
    number = {instance.name: i for i, instance in enumerate(layout.instances)}
    capacity = max([v.packet_capacity or 0 for e in endpoints for v in (e.rx, e.tx) if v is not None], default=1)
    rx = np.zeros((max(len(endpoints), 1), 4 * -(-capacity // 3) + 4), dtype=np.uint8)
    table = np.zeros(len(endpoints), dtype=PORTS)
    table["instance"] = [number[e.instance] for e in endpoints]
    table["has_rx"] = [e.rx is not None for e in endpoints]
    table["has_tx"] = [e.tx is not None for e in endpoints]
    table["rx"] = [e.rx.value_reference if e.rx else 0 for e in endpoints]
    table["tx"] = [e.tx.value_reference if e.tx else 0 for e in endpoints]
    table["binary"] = [calls[number[e.instance]].binary for e in endpoints]
    own = Counter(e.instance for e in endpoints)
    for e, endpoint in enumerate(endpoints):
        if e == 0 or endpoints[e - 1].instance != endpoint.instance:
            table[e]["further"] = own[endpoint.instance] - 1
    table["given"] = rx.ctypes.data + rx.shape[1] * np.arange(len(endpoints), dtype=np.uint64)
    return table, rx, capacity

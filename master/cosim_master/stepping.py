"""The macro step: Python that numba compiles, over a plan of flat arrays, calling FMI functions by address.

    t_k = t0 + k*h, k an integer
    DELIVER   packets that have arrived by t_k         -> mavlink_rx of receivers that are due
    STEP      exchange: outputs(t_k) -> inputs, all read before any is written (Jacobi)
              step every instance that is due: t_k -> t_k + n*h
              collect outputs of the instances whose step ends at t_k + h
    SEND      their mavlink_tx -> router -> channel -> in flight
    RECORD    a row of values at t_k + h, when due; k := k + 1

`run` returns to Python only where Python is needed, and goes on from the phase in which it left. If an instance
fails, the others of the macro step still finish; `failed` then names every failure and k stays where it was.

What a value means is not known here: only handles, addresses, references and indices.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim.packets import decode_base64, encode_base64
from cosim_master.calls import atomic_add, atomic_load, byte_at, do_step2, exchange_if, get_or_set, rest
from cosim_master.radio import (
    FREE_PLACES,
    IN_FLIGHT,
    NEAREST_ON_AXIS,
    SLOT,
    USED_EVENTS,
    USED_LOG,
    Radio,
    arrived,
    copies,
    deliver,
    send,
    sort_along,
)

__all__ = [
    "BLOCK_FULL",
    "DONE",
    "FAILED",
    "FUNCTIONS",
    "INSTANCE",
    "NEED_LOG",
    "NEED_PLACES",
    "PORTS",
    "QUIT",
    "WIRE",
    "Plan",
    "collect_all",
    "places_needed",
    "run",
    "sent_bytes",
    "work",
]

DONE, FAILED, NEED_PLACES, NEED_LOG, BLOCK_FULL = 0, 1, 2, 3, 4
"""Why `run` returned."""

DELIVER, STEP, SEND = 0, 1, 2
"""Phases of a macro step, in `Plan.clock[PHASE]`."""

FUNCTIONS = (
    "",
    "fmi2SetReal",
    "fmi2SetInteger",
    "fmi2SetBoolean",
    "fmi2SetString",
    "fmi2DoStep",
    "fmi2GetReal",
    "fmi2GetInteger",
    "fmi2GetBoolean",
    "fmi2GetString",
)
"""What `failed[0]` of an instance counts through."""
SET_STRING, DO_STEP, GET_STRING = 4, 5, 9
NOT_A_NUMBER, TOO_LONG, NOT_BASE64 = -1, -2, -3
"""In place of a status: an output is NaN (failed[2] is its index); packets that cannot be read."""


INSTANCE = np.dtype(
    [
        ("handle", "u8"),
        ("do_step", "u8"),
        ("setter", "u8", (3,)),  # by kind
        ("getter", "u8", (3,)),
        ("period", "i8"),  # base steps per step of the instance
        ("length", "i8"),  # base steps of its present step: the period, less at the end of the run
        ("endpoint", "i8"),  # -1 without packet ports
        ("first_in", "i8", (3,)),
        ("last_in", "i8", (3,)),
        ("first_out", "i8", (3,)),
        ("last_out", "i8", (3,)),
        ("failed", "i8", (3,)),  # function (0: has not failed), status, detail
    ]
)
WIRE = np.dtype([("source", "i8"), ("factor", "f8"), ("offset", "f8")])
"""input = factor * output[source] + offset; integers and booleans have factor 1 and offset 0."""
PORTS = np.dtype(
    [
        ("instance", "i8"),
        ("set_string", "u8"),
        ("get_string", "u8"),
        ("has_rx", "i8"),
        ("has_tx", "i8"),
        ("text", "u8"),  # address of the C string for mavlink_rx
        ("got", "u8"),  # what fmi2GetString returned
        ("filled", "i8"),  # 2: packets to set, 1: to be set to "" once, 0: nothing to do
        ("sent", "i8"),  # bytes in `tx`
        ("rx", "u4"),  # value references
        ("tx", "u4"),
    ],
    align=True,
)
"""The packet ports of one endpoint."""
TEXT, GOT, RX, TX = (PORTS.fields[name][1] for name in ("text", "got", "rx", "tx"))  # type: ignore[index]
PORTS_SIZE = PORTS.itemsize

K, PHASE, ROWS, FAILURES, START, BASE, LAST, EVERY, REALS_IN, REALS_OUT, BLOCK = range(11)
"""Places in `Plan.clock`. START and BASE in ns; REALS_IN, REALS_OUT: how many of the inputs and outputs are real;
BLOCK: how many instances a thread takes at a time, 0 without threads."""

TICKET, LIMIT, COMPLETED, QUIT, FAULTS = 0, 8, 16, 24, 32
"""Places in `Plan.shared`, a cache line apart: the next block, the end of this step's blocks, blocks completed, a
flag that ends the workers, failures. Blocks are counted through from the first step on, so that a thread that comes
late can never take one of an earlier step, and nobody waits for a thread that has nothing to do."""


class Plan(NamedTuple):
    """Everything the loop touches but the radio, in few arrays: numba's time to compile grows with their number.

    Inputs and outputs of all instances are numbered through, reals first, then integers (with enumerations), then
    booleans. Values of reals are in `real_in` and `real_out`, of the others in `int_in` and `int_out`.
    """

    instances: NDArray[Any]  # INSTANCE
    wires: NDArray[Any]  # WIRE, of each input; its source counts within real_out or int_out
    in_reference: NDArray[np.uint32]
    real_in: NDArray[np.float64]
    int_in: NDArray[np.int32]
    out_reference: NDArray[np.uint32]
    real_out: NDArray[np.float64]
    int_out: NDArray[np.int32]
    mirrors: NDArray[np.int64]  # rows (int_out, real_out): integer outputs that real inputs take
    ports: NDArray[Any]  # PORTS, of each endpoint
    text: NDArray[np.uint8]  # (endpoints, longest text)
    scratch: NDArray[np.uint8]  # (threads, longest text)
    tx: NDArray[np.uint8]  # (endpoints, largest capacity)
    real_recorded: NDArray[np.int64]
    int_recorded: NDArray[np.int64]
    real_block: NDArray[np.float64]  # (rows, recorded reals)
    int_block: NDArray[np.int32]
    ticks: NDArray[np.int64]  # time of each row of the block, ns
    clock: NDArray[np.int64]
    confined: NDArray[np.int64]  # instances that only the main thread steps
    free: NDArray[np.int64]  # instances that any thread may step
    shared: NDArray[np.int64]


@kernel
def _fail(instances: NDArray[Any], i: int, function: int, status: int, detail: int) -> None:
    m = instances[i]
    if m.failed[0] == 0:
        m.failed[0] = function
        m.failed[1] = status
        m.failed[2] = detail


@kernel
def _gather(p: Plan, i: int) -> None:
    """Inputs of instance `i` from the outputs they are connected to: the whole data flow is here."""
    m = p.instances[i]
    for j in range(m.first_in[0], m.last_in[0]):
        w = p.wires[j]
        p.real_in[j] = w.factor * p.real_out[w.source] + w.offset
    reals = p.clock[REALS_IN]
    for kind in range(1, 3):
        for j in range(m.first_in[kind], m.last_in[kind]):
            p.int_in[j - reals] = p.int_out[p.wires[j].source]


@kernel
def _set(p: Plan, i: int) -> None:
    m = p.instances[i]
    for kind in range(3):
        first = m.first_in[kind]
        n = m.last_in[kind] - first
        if n > 0:
            at = p.real_in.ctypes.data + 8 * first
            if kind > 0:
                at = p.int_in.ctypes.data + 4 * (first - p.clock[REALS_IN])
            references = np.uintp(p.in_reference.ctypes.data + 4 * first)
            status = get_or_set(m.setter[kind], m.handle, references, np.uintp(n), np.uintp(at))
            if status > 1:
                _fail(p.instances, i, 1 + kind, status, 0)


@kernel
def _collect(p: Plan, i: int, thread: int) -> None:
    """Outputs of instance `i` at the end of its step."""
    m = p.instances[i]
    for kind in range(3):
        first = m.first_out[kind]
        n = m.last_out[kind] - first
        if n > 0:
            at = p.real_out.ctypes.data + 8 * first
            if kind > 0:
                at = p.int_out.ctypes.data + 4 * (first - p.clock[REALS_OUT])
            references = np.uintp(p.out_reference.ctypes.data + 4 * first)
            status = get_or_set(m.getter[kind], m.handle, references, np.uintp(n), np.uintp(at))
            if status > 1:
                _fail(p.instances, i, 6 + kind, status, 0)
    for j in range(m.first_out[0], m.last_out[0]):
        if p.real_out[j] != p.real_out[j]:
            _fail(p.instances, i, 6, NOT_A_NUMBER, j)
            break
    if m.endpoint >= 0 and p.ports[m.endpoint].has_tx != 0:
        status = _collect_packets(p.ports, m.endpoint, m.handle, p.scratch[thread], p.tx)
        if status != 0:
            _fail(p.instances, i, GET_STRING, status, 0)


@kernel
def _collect_packets(
    ports: NDArray[Any], e: int, handle: int, scratch: NDArray[np.uint8], tx: NDArray[np.uint8]
) -> int:
    """Packets that an instance has sent, from base64 into its row of `tx`; 0 or what is wrong."""
    port = ports[e]
    port.sent = 0
    row = ports.ctypes.data + PORTS_SIZE * e
    status = get_or_set(port.get_string, handle, np.uintp(row + TX), np.uintp(1), np.uintp(row + GOT))
    if status > 1:
        return int(status)
    address = port.got
    if address == np.uintp(0):
        return 0
    n = 0
    character = byte_at(address)
    while character != 0:
        if n == scratch.size:
            return TOO_LONG
        scratch[n] = character
        n += 1
        character = byte_at(np.uintp(address + np.uintp(n)))
    if n == 0:
        return 0
    length = decode_base64(scratch, n, tx[e])
    if length < 0:
        return NOT_BASE64
    port.sent = length
    return 0


@kernel
def _step(p: Plan, i: int, k: int, thread: int) -> None:
    """Set inputs and packets of instance `i`, step it, and collect if its step ends with this base step."""
    m = p.instances[i]
    if m.endpoint >= 0 and p.ports[m.endpoint].filled > 0:
        row = p.ports.ctypes.data + PORTS_SIZE * m.endpoint
        set_string = p.ports[m.endpoint].set_string
        status = get_or_set(set_string, m.handle, np.uintp(row + RX), np.uintp(1), np.uintp(row + TEXT))
        if status > 1:
            _fail(p.instances, i, SET_STRING, status, 0)
    _set(p, i)
    if m.failed[0] != 0:
        return
    m.length = min(m.period, p.clock[LAST] - k)
    t = (p.clock[START] + k * p.clock[BASE]) / 1e9
    status = do_step2(m.do_step, m.handle, t, m.length * p.clock[BASE] / 1e9)
    if status > 1:
        _fail(p.instances, i, DO_STEP, status, 0)
    elif m.length == 1:
        _collect(p, i, thread)


@kernel
def _deliver_all(p: Plan, r: Radio, k: int) -> None:
    """What has arrived for instances that are due, as base64 text."""
    t = p.clock[START] + k * p.clock[BASE]
    for e in range(p.ports.size):
        port = p.ports[e]
        if port.has_rx == 0 or k % p.instances[port.instance].period != 0:
            continue
        if not arrived(r, t, e):
            port.filled = 1 if port.filled == 2 else 0
            p.text[e, 0] = 0
            continue
        n = deliver(r, t, e, p.tx[e])
        p.text[e, encode_base64(p.tx[e], n, p.text[e])] = 0
        port.filled = 2


@kernel
def _step_one(p: Plan, i: int, k: int, thread: int) -> int:
    """Instance `i` in base step k: it begins a step, or ends one, or neither. Returns 1 if it failed."""
    m = p.instances[i]
    if k % m.period == 0:
        _step(p, i, k, thread)
    if m.length > 1 and (k // m.period) * m.period + m.length == k + 1 and m.failed[0] == 0:
        _collect(p, i, thread)
    return 1 if m.failed[0] != 0 else 0


@kernel
def _take_blocks(p: Plan, thread: int) -> int:
    """Step blocks of instances until none of this step is left; returns how many."""
    at = p.shared.ctypes.data
    size = p.clock[BLOCK]
    per_step = (p.free.size + size - 1) // size
    taken = 0
    while True:
        ticket = atomic_load(np.uintp(at + 8 * TICKET))
        if ticket >= atomic_load(np.uintp(at + 8 * LIMIT)):
            return taken
        if not exchange_if(np.uintp(at + 8 * TICKET), ticket, ticket + 1):
            continue
        k = p.clock[K]
        first = ticket % per_step * size
        faults = 0
        for j in range(first, min(first + size, p.free.size)):
            faults += _step_one(p, p.free[j], k, thread)
        if faults > 0:
            atomic_add(np.uintp(at + 8 * FAULTS), faults)
        atomic_add(np.uintp(at + 8 * COMPLETED), 1)
        taken += 1


@kernel
def work(p: Plan, thread: int) -> int:
    """What a thread besides the main one does until QUIT is set; returns the number of blocks it has stepped."""
    at = p.shared.ctypes.data
    spins = 0
    total = 0
    while atomic_load(np.uintp(at + 8 * QUIT)) == 0:
        taken = _take_blocks(p, thread)
        total += taken
        spins = 0 if taken > 0 else spins + 1
        rest(spins)
    return total


@kernel
def _exchange_and_step(p: Plan, k: int) -> None:
    for j in range(p.mirrors.shape[0]):
        p.real_out[p.mirrors[j, 1]] = p.int_out[p.mirrors[j, 0]]
    for i in range(p.instances.size):
        if k % p.instances[i].period == 0:
            _gather(p, i)
    size = p.clock[BLOCK]
    at = p.shared.ctypes.data
    if size > 0:
        atomic_add(np.uintp(at + 8 * LIMIT), (p.free.size + size - 1) // size)
    for j in range(p.confined.size):
        p.clock[FAILURES] += _step_one(p, p.confined[j], k, 0)
    if size == 0:
        for j in range(p.free.size):
            p.clock[FAILURES] += _step_one(p, p.free[j], k, 0)
        return
    _take_blocks(p, 0)
    spins = 0
    while atomic_load(np.uintp(at + 8 * COMPLETED)) < atomic_load(np.uintp(at + 8 * LIMIT)):
        spins += 1
        rest(min(spins, 10000))
    p.clock[FAILURES] += atomic_load(np.uintp(at + 8 * FAULTS))


@kernel
def sent_bytes(p: Plan) -> int:
    """Bytes of packets collected and not yet routed."""
    total = 0
    for e in range(p.ports.size):
        total += p.ports[e].sent
    return total


@kernel
def places_needed(p: Plan, r: Radio) -> int:
    """At least as many places in flight, and events, as routing what was collected can take."""
    packets = 0
    for e in range(p.ports.size):
        if p.ports[e].sent > 0:
            packets += p.ports[e].sent // 8 + 2
    return packets * copies(r)


@kernel
def _send_all(p: Plan, r: Radio, k: int) -> int:
    """DONE, or what has to grow before anything can be sent."""
    total = sent_bytes(p)
    if total == 0:
        return DONE
    need = places_needed(p, r)
    if need > r.counters[FREE_PLACES]:
        return NEED_PLACES
    events, used = r.counters[USED_EVENTS] + need, r.counters[USED_LOG] + 3 * total
    if r.settings[0].keep != 0 and (events > r.events.size or used > r.log.size):
        return NEED_LOG
    if r.settings[0].topology == NEAREST_ON_AXIS:
        sort_along(r, p.real_out)
    t = p.clock[START] + (k + 1) * p.clock[BASE]
    for e in range(p.ports.size):
        if p.ports[e].sent > 0:
            send(r, p.real_out, t, e, p.tx[e], p.ports[e].sent)
            p.ports[e].sent = 0
    return DONE


@kernel
def _record(p: Plan, k: int) -> None:
    """Add a row at time t_k to the block."""
    row = p.clock[ROWS]
    p.ticks[row] = p.clock[START] + k * p.clock[BASE]
    for j in range(p.real_recorded.size):
        p.real_block[row, j] = p.real_out[p.real_recorded[j]]
    for j in range(p.int_recorded.size):
        p.int_block[row, j] = p.int_out[p.int_recorded[j]]
    p.clock[ROWS] = row + 1


@kernel
def collect_all(p: Plan) -> None:
    """Outputs of every instance, after initialization."""
    for i in range(p.instances.size):
        _collect(p, i, 0)
        if p.instances[i].failed[0] != 0:
            p.clock[FAILURES] += 1


@kernel
def run(p: Plan, r: Radio, k_stop: int) -> int:
    """Macro steps until k = `k_stop`, or until Python is needed; returns why."""
    clock = p.clock
    while True:
        k = clock[K]
        if clock[PHASE] == DELIVER:
            if k >= k_stop:
                return DONE
            in_flight = r.counters[IN_FLIGHT]
            if (
                r.settings[0].keep != 0
                and in_flight > 0
                and r.counters[USED_LOG] + in_flight * (SLOT + 16) > r.log.size
            ):
                return NEED_LOG
            _deliver_all(p, r, k)
            clock[PHASE] = STEP
        if clock[PHASE] == STEP:
            _exchange_and_step(p, k)
            if clock[FAILURES] > 0:
                return FAILED
            clock[PHASE] = SEND
        if clock[PHASE] == SEND:
            reason = _send_all(p, r, k)
            if reason != DONE:
                return reason
        k += 1
        clock[K] = k
        clock[PHASE] = DELIVER
        if k % clock[EVERY] == 0 or k == clock[LAST]:
            _record(p, k)
            if clock[ROWS] == p.ticks.size:
                return BLOCK_FULL

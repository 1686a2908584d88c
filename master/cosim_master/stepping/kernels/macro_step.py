"""The macro step: Python that numba compiles, over a plan of flat arrays, calling FMI functions by address.

    t_k = t0 + k*h, k an integer; t0 and h whole ticks, of which a whole number makes a nanosecond
    DELIVER   packets that have arrived by t_k         -> mavlink_rx of receivers that are due
    STEP      exchange: outputs(t_k) -> inputs, all read before any is written (Jacobi)
              step every instance that is due: t_k -> t_k + n*h
              collect outputs of the instances whose step ends at t_k + h
    SEND      their mavlink_tx -> router -> channel -> in flight
    RECORD    a row of values at t_k + h, when due; k := k + 1

With Gauss-Seidel, instances step one after the other, and each takes its inputs from what the others have by then.
Delayed connections and extrapolated inputs remember earlier values (`Plan.kept`).

Base steps in which no instance begins or ends a step are passed over (`Plan.grids`).

`run` returns to Python only where Python is needed, and goes on from the phase in which it left. If an instance
fails, the others of the macro step still finish; `failed` then names every failure and k stays where it was.

What a value means is not known here: only handles, addresses, references and indices.

Kernels that run in every step get the arrays they need, not the plan: to pass all of it takes longer than an FMI call.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim.packets import MAX_PACKET, decode_base64, encode_base64
from cosim_master.network.radio.router import (
    FREE_PLACES,
    IN_FLIGHT,
    NEAREST_ON_AXIS,
    USED_EVENTS,
    USED_LOG,
    Radio,
    arrived,
    copies,
    deliver,
    send,
    sort_along,
)
from cosim_master.stepping.kernels.fmi3_types import PACKED, call3
from cosim_master.stepping.kernels.fmi_calls import (
    atomic_add,
    atomic_load,
    byte_at,
    do_step2,
    do_step3,
    exchange_if,
    get_or_set,
    get_or_set3,
    load_f8,
    load_i4,
    load_u1,
    rest,
    store_i1,
)
from cosim_master.stepping.kernels.tables import (
    BASE,
    BEGIN,
    BLOCK,
    BLOCK_FULL,
    BY_PYTHON,
    COMPLETED,
    COPY,
    DELIVER,
    DO_STEP,
    DONE,
    EARLY,
    END,
    ENDED,
    EVENTFUL,
    EVENTS_DUE,
    EVERY,
    FAILED,
    FAILURES,
    FATAL,
    FAULTS,
    FINAL,
    FINER,
    GET_REAL,
    GET_STRING,
    IN_ORDER,
    JACOBI,
    LAST,
    LEFT,
    LIMIT,
    NAN_ALLOWED,
    NEED_LOG,
    NEED_PLACES,
    NO_EVENT,
    NOT_A_NUMBER,
    NOT_BASE64,
    NOT_CALLED,
    ORDER,
    PER_NS,
    PHASE,
    QUIT,
    ROWS,
    SEND,
    SIGN,
    START,
    STEP,
    STEPS_DUE,
    TICKET,
    TOO_LONG,
    K,
    Plan,
)

__all__ = [
    "collect_again",
    "collect_all",
    "end_here",
    "next_point",
    "places_needed",
    "record",
    "run",
    "sent_bytes",
    "step_each",
    "step_together",
    "work",
]

inlined = functools.partial(kernel, inline=True)


@kernel
def _fail(instances: NDArray[Any], i: int, function: int, status: int, detail: int) -> None:
    m = instances[i]
    if m.failed[0] == 0:
        m.failed[0] = function
        m.failed[1] = status
        m.failed[2] = detail


@inlined
def _time(clock: NDArray[np.int64], k: int) -> int:
    """Communication point t_k, ns: what lies between two is rounded."""
    ticks, per_ns = clock[START] + k * clock[BASE], clock[PER_NS]
    return int(ticks if per_ns == 1 else (ticks + per_ns // 2) // per_ns)


@kernel
def _is_point(grids: NDArray[np.int64], k: int, finer: int) -> bool:
    """Whether the step of an instance ends at base step k."""
    ending = 0
    for j in range(grids.size):
        ending += k % (grids[j] * finer) == 0
    return bool(ending > 0)


@kernel
def _following(grids: NDArray[np.int64], clock: NDArray[np.int64], k: int, stop: int) -> int:
    """The first base step from k on, at most `stop`, in which an instance begins or ends a step or a row is due."""
    found = stop if k >= clock[LAST] else min(stop, clock[LAST] - 1)
    for j in range(grids.size):
        begins = -(-k // grids[j]) * grids[j]
        ends = -(-(k + 1) // grids[j]) * grids[j] - 1
        found = min(found, begins, ends)
    if clock[EVERY] > 1:
        found = min(found, -(-k // clock[EVERY]) * clock[EVERY])
    return int(max(found, k))


@kernel
def next_point(p: Plan, stop: int) -> int:
    """The base step behind the present one at which there is something to do, at most `stop`."""
    k = p.clock[K] + 1
    if p.grids.size > 0 and p.delays.size == 0 and p.clock[FINER] == 1:
        return int(_following(p.grids, p.clock, k, stop))
    return int(k)


@inlined
def _exchange(
    instances: NDArray[Any],
    feeds: NDArray[Any],
    sources: NDArray[np.uint32],
    wires: NDArray[Any],
    mirrors: NDArray[np.int64],
    mapped: NDArray[np.int64],
    real_out: NDArray[np.float64],
    int_out: NDArray[np.int32],
    real_in: NDArray[np.float64],
    int_in: NDArray[np.int32],
    k: int,
) -> None:
    """Inputs of the instances of `feeds` that are due from the outputs they are connected to: all data flows here."""
    reals = np.uintp(real_in.size)
    for j in range(mapped.shape[0]):
        source, place, key = mapped[j, 0], mapped[j, 1], mapped[j, 2]
        if source < 0:
            low, high = np.int64(int_out[-1 - source]) & 0xFFFFFFFF, np.int64(int_out[-source])
            if high * 4294967296 + low == key:
                wide = mapped[j, 3]
                low = wide & 0xFFFFFFFF
                int_out[place] = low - 4294967296 if low > 2147483647 else low
                int_out[place + 1] = wide >> 32
            continue
        value = int_out[source]
        if key == COPY:
            int_out[place] = value
        elif key == SIGN:
            int_out[place] = -1 if value < 0 else 0
        elif key == value:
            int_out[place] = mapped[j, 3]
    for j in range(mirrors.shape[0]):
        source = mirrors[j, 0]
        if source < 0:
            real_out[mirrors[j, 1]] = np.int64(int_out[-1 - source]) & 0xFFFFFFFF
        else:
            real_out[mirrors[j, 1]] = int_out[source]
    for i in range(feeds.size):
        feed = feeds[i]
        period = instances[np.uintp(feed.instance)].period
        if period > 1 and k % period != 0:
            continue
        if feed.plain != 0:
            for j in range(np.uintp(feed.first_in[0]), np.uintp(feed.last_in[0])):
                real_in[j] = real_out[sources[j]]
        else:
            for j in range(np.uintp(feed.first_in[0]), np.uintp(feed.last_in[0])):
                real_in[j] = wires[j].factor * real_out[sources[j]] + wires[j].offset
        for kind in range(1, 3):
            for j in range(np.uintp(feed.first_in[kind]), np.uintp(feed.last_in[kind])):
                int_in[j - reals] = int_out[sources[j]]


@inlined
def _call(instances: NDArray[Any], calls: NDArray[Any], i: int, first: int, last: int) -> bool:
    """Make calls of instance `i`, until one fails; returns whether none did."""
    for c in range(np.uintp(first), np.uintp(last)):
        call = calls[c]
        if call.width == 0:
            status = get_or_set(call.function, call.handle, call.references, np.uintp(call.n), call.values)
        elif call.width == PACKED:
            n, n_values = np.uintp(call.n & np.uint32(0xFFFF)), np.uintp(call.n >> np.uint32(16))
            status = get_or_set3(call.function, call.handle, call.references, n, call.values, n_values)
        else:
            status = call3(call)
        if status > 1 or status < 0:
            _fail(instances, i, call.number, status, 0)
            return False
    return True


@kernel
def _blame(
    instances: NDArray[Any], feeds: NDArray[Any], real_out: NDArray[np.float64], clock: NDArray[np.int64]
) -> int:
    """Fail every instance with an output that is NaN, unless that is allowed; returns how many.

    The first loop is all there is to do as long as there is none, and takes several outputs at a time.
    """
    if clock[NAN_ALLOWED] != 0:
        return 0
    found = 0
    for j in range(real_out.size):
        found += real_out[j] != real_out[j]
    if found == 0:
        return 0
    blamed = 0
    for i in range(instances.size):
        m = instances[i]
        for j in range(np.uintp(feeds[i].first_out[0]), np.uintp(feeds[i].last_out[0])):
            if real_out[j] != real_out[j] and m.failed[0] == 0:
                _fail(instances, i, GET_REAL, NOT_A_NUMBER, int(j))
                blamed += 1
    return blamed


@kernel
def _collect_packets(
    instances: NDArray[Any],
    calls: NDArray[Any],
    ports: NDArray[Any],
    i: int,
    scratch: NDArray[np.uint8],
    tx: NDArray[np.uint8],
) -> None:
    """Packets that instance `i` has sent by all its endpoints; those of the first have been got."""
    first = instances[i].endpoint
    _collect(instances, ports, i, first, scratch, tx)
    for e in range(first + 1, first + 1 + np.int64(ports[first].further)):
        if _call(instances, calls, i, ports[e].get, ports[e].get + np.uint32(1)):
            _collect(instances, ports, i, e, scratch, tx)


@kernel
def _collect(
    instances: NDArray[Any], ports: NDArray[Any], i: int, e: int, scratch: NDArray[np.uint8], tx: NDArray[np.uint8]
) -> None:
    """Packets of endpoint `e` of instance `i`, from base64 into its row of `tx`; until they are read none."""
    port = ports[e]
    port.sent = 0
    if port.has_tx == 0 or port.got == np.uintp(0):
        return
    n = 0
    if port.binary != 0:
        if port.got_size > np.uintp(tx.shape[1]):
            _fail(instances, i, GET_STRING, TOO_LONG, 0)
            return
        for j in range(np.int64(port.got_size)):
            tx[e, j] = byte_at(np.uintp(port.got + np.uintp(j)))
        port.sent = np.int64(port.got_size)
        return
    character = byte_at(port.got)
    while character != 0 and n < scratch.size:
        scratch[n] = character
        n += 1
        character = byte_at(np.uintp(port.got + np.uintp(n)))
    if n == 0:
        return
    length = TOO_LONG if character != 0 else decode_base64(scratch, n, tx[e])
    if length == TOO_LONG:
        _fail(instances, i, GET_STRING, TOO_LONG, 0)
    elif length < 0:
        _fail(instances, i, GET_STRING, NOT_BASE64, 0)
    else:
        port.sent = length


@kernel
def _corrupted(instances: NDArray[Any], library: int) -> bool:
    """Whether an instance of this FMU has answered fmi2Fatal: no other may be called any more."""
    for i in range(instances.size):
        m = instances[i]
        if m.library == library and m.failed[0] != 0 and m.failed[1] == FATAL:
            return True
    return False


@kernel
def _do_step3(m: Any, t: float, h: float, final: int, near: float) -> Any:
    """fmi3DoStep: a status, ENDED or EARLY; LEFT for a step with an event in it, `near` s before its end or earlier."""
    has_events = load_u1(np.uintp(m.answers + np.uintp(24))) != 0
    if not has_events:
        status = do_step3(m.do_step, m.handle, t, h, final, m.answers)
        # Where it has got to may lie a little before t + h all the same: that is its affair (FMI 3.0.2, section 4.2.1).
        if status > 1 or load_i4(m.answers) & NO_EVENT == 0:
            return status
        return ENDED if load_u1(np.uintp(m.answers + np.uintp(1))) != 0 else EARLY
    slack = max(1e-9 * max(h, abs(t) * 1e-3), near)
    following = load_f8(np.uintp(m.answers + np.uintp(16)))
    if following < t + h - slack:
        store_i1(np.uintp(m.answers + np.uintp(25)), BEGIN)
        return LEFT
    status = do_step3(m.do_step, m.handle, t, h, final, m.answers)
    if status > 1:
        return status
    if load_u1(np.uintp(m.answers + np.uintp(1))) != 0:
        return ENDED
    early = load_u1(np.uintp(m.answers + np.uintp(2))) != 0
    if early or load_u1(m.answers) != 0 or following <= t + h + slack:
        store_i1(np.uintp(m.answers + np.uintp(25)), END)
        return LEFT
    return status


@inlined
def _step_some(
    instances: NDArray[Any],
    calls: NDArray[Any],
    ports: NDArray[Any],
    scratch: NDArray[np.uint8],
    tx: NDArray[np.uint8],
    clock: NDArray[np.int64],
    chosen: NDArray[np.int64],
) -> int:
    """The present base step of the instances `chosen`: each begins a step, or ends one, or both, or neither.

    Returns how many have failed.
    """
    k, base = clock[K], clock[BASE]
    left = clock[LAST] - k
    final = clock[FINAL]
    per_second = 1e9 * clock[PER_NS]
    t = (clock[START] + k * base) / per_second
    failed = 0
    for chosen_one in chosen:
        i: Any = np.uintp(chosen_one)  # an index that can be negative costs a comparison each time it is used
        m = instances[i]
        well, later = True, False
        since = 0 if m.period == 1 else k % m.period
        if failed > 0 and _corrupted(instances, m.library):
            _fail(instances, i, DO_STEP, NOT_CALLED, 0)
            well = False
        elif since == 0:
            packets = m.endpoint >= 0 and ports[m.endpoint].filled > 0
            well = _call(instances, calls, i, m.first_set if packets else m.first_set_value, m.first_get)
            if well:
                if m.length != min(m.period, left):
                    m.length = min(m.period, left)
                    m.h = m.length * base / per_second
                if m.answers == np.uintp(0):
                    status = do_step2(m.do_step, m.handle, t, m.h, final)
                else:
                    # Events have whole nanoseconds.
                    status = _do_step3(m, t, m.h, final, 0.0 if clock[PER_NS] == 1 else 6e-10)
                later = status == LEFT
                if not later and (status > 1 or status < 0):
                    _fail(instances, i, DO_STEP, status, 0)
                    well = False
        if since + 1 == m.length and well and not later:
            well = _call(instances, calls, i, m.first_get, m.last_get)
            if m.endpoint >= 0 and well:
                _collect_packets(instances, calls, ports, i, scratch, tx)
                well = m.failed[0] == 0
        if not well:
            failed += 1
    return failed


@kernel
def _feed(p: Plan, k: int, feeds: NDArray[Any]) -> None:
    """`_exchange` for some instances; what all of them share is done for none, too."""
    _exchange(
        p.instances, feeds, p.sources, p.wires, p.mirrors, p.mapped, p.real_out, p.int_out, p.real_in, p.int_in, k
    )


@kernel
def _step_chosen(p: Plan, chosen: NDArray[np.int64]) -> int:
    return _step_some(p.instances, p.calls, p.ports, p.scratch[0], p.tx, p.clock, chosen)


@kernel
def _delay(p: Plan, k: int) -> None:
    """Outputs of now into delayed connections, and earlier ones out of them."""
    if k % p.clock[FINER] != 0:
        return
    _feed(p, k, p.feeds[:0])
    step = k // p.clock[FINER]
    for j in range(p.delays.size):
        d = p.delays[j]
        value = d.factor * p.real_out[d.source] + d.offset if d.whole == 0 else float(p.int_out[d.source])
        if d.length > 0:
            at = d.first + step % d.length
            new, value = value, p.kept[at]
            p.kept[at] = new
        elif d.length < 0:
            value += p.real_out[d.place]
        if d.whole == 0:
            p.real_out[d.place] = value
        else:
            p.int_out[d.place] = np.int32(value)


@kernel
def _extrapolate(p: Plan, k: int, first: int, last: int) -> None:
    """Derivatives of the extrapolated inputs of the instances first to last - 1, if they begin a step."""
    t = p.clock[START] + k * p.clock[BASE]
    for j in range(p.slopes.size):
        s = p.slopes[j]
        if s.instance < first or s.instance >= last or k % p.instances[s.instance].period != 0:
            continue
        value = p.real_in[s.input]
        p.kept[s.place] = (
            (value - s.before) / ((t - s.at) / (1e9 * p.clock[PER_NS])) if s.known != 0 and t > s.at else 0.0
        )
        s.before = value
        s.at = t
        s.known = 1


@kernel
def _step_in_order(p: Plan, k: int, chosen: NDArray[np.int64]) -> int:
    """Gauss-Seidel: exchange and step, one instance after the other; returns how many have failed."""
    failed = 0
    for j in range(chosen.size):
        i = chosen[j]
        if failed > 0 and _corrupted(p.instances, p.instances[i].library):
            _fail(p.instances, i, DO_STEP, NOT_CALLED, 0)
            failed += 1
            continue
        # Inlined: to pass the plan on takes longer than a step.
        _exchange(
            p.instances,
            p.feeds[i : i + 1],
            p.sources,
            p.wires,
            p.mirrors,
            p.mapped,
            p.real_out,
            p.int_out,
            p.real_in,
            p.int_in,
            k,
        )
        if p.slopes.size > 0:
            _extrapolate(p, k, i, i + 1)
        failed += _step_some(p.instances, p.calls, p.ports, p.scratch[0], p.tx, p.clock, chosen[j : j + 1])
    return failed


@kernel
def step_each(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Exchange and step the instances `chosen`, one after the other."""
    p.clock[FAILURES] += _step_in_order(p, p.clock[K], chosen)
    p.clock[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.clock)


@kernel
def step_together(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Exchange for all instances `chosen`, then step them."""
    for i in chosen:
        _feed(p, p.clock[K], p.feeds[i : i + 1])
    p.clock[FAILURES] += _step_chosen(p, chosen)
    p.clock[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.clock)


@kernel
def _deliver_all(p: Plan, r: Radio, k: int) -> None:
    """What has arrived for instances that are due, as base64 text."""
    instances, ports, text, endpoints, places = p.instances, p.ports, p.text, r.endpoints, r.places
    t = _time(p.clock, k)
    for e in range(ports.size):
        port = ports[e]
        period = instances[port.instance].period
        if port.has_rx == 0 or (period > 1 and k % period != 0):
            continue
        if arrived(endpoints, places, t, e):
            n = deliver(r, t, e, p.tx[e])
            if port.binary != 0:
                for j in range(n):
                    text[e, j] = p.tx[e, j]
                port.rx_size = n
            else:
                text[e, encode_base64(p.tx[e], n, text[e])] = 0
            port.filled = 2
        elif port.filled > 0:
            port.filled -= 1
            port.rx_size = 0
            text[e, 0] = 0
        first = instances[port.instance].endpoint
        if first != e and port.filled > 0:
            ports[first].filled = max(ports[first].filled, 1)  # all are set together


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
        first = ticket % per_step * size
        faults = _step_some(
            p.instances, p.calls, p.ports, p.scratch[thread], p.tx, p.clock, p.free[first : first + size]
        )
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
def _hand_out(p: Plan) -> None:
    """Let other threads begin with the free instances."""
    size = p.clock[BLOCK]
    atomic_add(np.uintp(p.shared.ctypes.data + 8 * LIMIT), (p.free.size + size - 1) // size)


@kernel
def _join_in(p: Plan) -> int:
    """Step free instances together with the other threads until all are done; returns how many have failed."""
    at = p.shared.ctypes.data
    _take_blocks(p, 0)
    spins = 0
    while atomic_load(np.uintp(at + 8 * COMPLETED)) < atomic_load(np.uintp(at + 8 * LIMIT)):
        spins += 1
        rest(min(spins, 10000))
    return int(atomic_load(np.uintp(at + 8 * FAULTS)))


@kernel
def sent_bytes(p: Plan) -> int:
    """Bytes of packets collected and not yet routed."""
    ports = p.ports
    total = 0
    for e in range(ports.size):
        total += ports[e].sent
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
    t = _time(p.clock, k + 1)
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
    real_block, real_out, real_recorded = p.real_block[row], p.real_out, p.real_recorded
    for j in range(real_recorded.size):
        real_block[j] = real_out[real_recorded[j]]
    int_block, int_out, int_recorded = p.int_block[row], p.int_out, p.int_recorded
    for j in range(int_recorded.size):
        int_block[j] = int_out[int_recorded[j]]
    p.clock[ROWS] = row + 1


@kernel
def record(p: Plan) -> None:
    """A row of the present time."""
    _record(p, p.clock[K])


@kernel
def collect_all(p: Plan) -> None:
    """Outputs of every instance, after initialization."""
    for i in range(p.instances.size):
        m = p.instances[i]
        if p.clock[FAILURES] > 0 and _corrupted(p.instances, m.library):
            continue
        _call(p.instances, p.calls, i, m.first_get, m.last_get)
        if m.endpoint >= 0 and m.failed[0] == 0:
            _collect_packets(p.instances, p.calls, p.ports, i, p.scratch[0], p.tx)
        if m.failed[0] != 0:
            p.clock[FAILURES] += 1
    p.clock[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.clock)


@kernel
def end_here(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Complete a macro step that is the last one, since the instances `chosen` want to end with it: a row for it."""
    clock = p.clock
    for i in chosen:
        p.instances[i].failed[0] = 0
        _call(p.instances, p.calls, i, p.instances[i].first_get, p.instances[i].last_get)
    clock[FAILURES] = 0
    clock[K] += 1
    clock[PHASE] = DELIVER
    _record(p, clock[K])


@kernel
def _any_pending(instances: NDArray[Any]) -> bool:
    pending = 0
    for i in range(instances.size):
        if instances[i].answers != np.uintp(0):
            pending += load_u1(np.uintp(instances[i].answers + np.uintp(25)))
    return bool(pending > 0)


@kernel
def collect_again(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Outputs of the instances `chosen`, at the end of their steps, after their events."""
    for i in chosen:
        m = p.instances[i]
        _call(p.instances, p.calls, i, m.first_get, m.last_get)
        if m.endpoint >= 0 and m.failed[0] == 0:
            _collect_packets(p.instances, p.calls, p.ports, i, p.scratch[0], p.tx)
        if m.failed[0] != 0:
            p.clock[FAILURES] += 1
    p.clock[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.clock)


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
                and r.counters[USED_LOG] + in_flight * (MAX_PACKET + 16) > r.log.size
            ):
                return NEED_LOG
            if p.ports.size > 0:
                _deliver_all(p, r, k)
            clock[PHASE] = STEP
        if clock[PHASE] == STEP:
            if p.delays.size > 0:
                _delay(p, k)
            if clock[ORDER] == BY_PYTHON:
                return STEPS_DUE
            if clock[ORDER] == JACOBI:
                _exchange(
                    p.instances,
                    p.runs,
                    p.sources,
                    p.wires,
                    p.mirrors,
                    p.mapped,
                    p.real_out,
                    p.int_out,
                    p.real_in,
                    p.int_in,
                    k,
                )
                if p.slopes.size > 0:
                    _extrapolate(p, k, 0, p.instances.size)
            if clock[BLOCK] > 0:
                _hand_out(p)
            if clock[ORDER] == IN_ORDER:
                clock[FAILURES] += _step_in_order(p, k, p.confined)
            elif p.confined.size > 0:
                clock[FAILURES] += _step_some(p.instances, p.calls, p.ports, p.scratch[0], p.tx, clock, p.confined)
            if clock[BLOCK] > 0:
                clock[FAILURES] += _join_in(p)
            elif p.free.size > 0:
                clock[FAILURES] += _step_some(p.instances, p.calls, p.ports, p.scratch[0], p.tx, clock, p.free)
            clock[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.clock)
            if clock[FAILURES] > 0:
                return FAILED
            clock[PHASE] = SEND
            if clock[EVENTFUL] > 0 and _any_pending(p.instances):
                return EVENTS_DUE
        if clock[PHASE] == SEND:
            reason = _send_all(p, r, k) if p.ports.size > 0 else DONE
            if reason != DONE:
                return reason
        k += 1
        if p.grids.size > 0 and p.delays.size == 0 and clock[FINER] == 1:
            k = _following(p.grids, clock, k, max(k, k_stop))
        clock[K] = k
        clock[PHASE] = DELIVER
        if (
            k % clock[EVERY] == 0
            and (p.grids.size == 0 or clock[EVERY] > clock[FINER] or _is_point(p.grids, k, clock[FINER]))
        ) or k == clock[LAST]:
            _record(p, k)
            if clock[ROWS] == p.ticks.size:
                return BLOCK_FULL

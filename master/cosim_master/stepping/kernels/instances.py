"""Steps of instances: inputs, doStep, outputs and failures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim.packets import decode_base64, encode_base64
from cosim_master.fmi.calls import PACKED
from cosim_master.stepping.kernels.exchange import exchange, extrapolate, feed, inlined
from cosim_master.stepping.kernels.fmi3_types import call3
from cosim_master.stepping.kernels.fmi_calls import (
    byte_at,
    do_step2,
    do_step3,
    expect,
    get_or_set,
    get_or_set3,
    load_f8,
    load_i4,
    load_i8,
    load_u1,
    note,
    step_whole,
    store_i1,
)
from cosim_master.stepping.kernels.tables import (
    BASE,
    BEGIN,
    DO_STEP,
    EARLY,
    END,
    ENDED,
    EXPECTING,
    FAILURES,
    FATAL,
    FINAL,
    FROM,
    GET_REAL,
    GET_STRING,
    LAST,
    LEFT,
    NAN_ALLOWED,
    NO_EVENT,
    NOT_A_NUMBER,
    NOT_BASE64,
    NOT_BEGUN,
    NOT_CALLED,
    NOT_READ,
    PER_NS,
    RUNNING,
    START,
    TOO_LONG,
    WINDOW,
    K,
    Plan,
)

__all__ = [
    "any_pending",
    "begin_ahead",
    "_blame",
    "_call",
    "step_in_order",
    "step_chosen",
    "step_free",
    "step_some",
    "blame_some",
    "collect_again",
    "collect_all",
    "running",
    "step_each",
    "step_together",
]


@kernel
def fail(instances: NDArray[Any], i: int, function: int, status: int, detail: int) -> None:
    m = instances[i]
    if m.failed[0] == 0:
        m.failed[0] = function
        m.failed[1] = status
        m.failed[2] = detail


@inlined
def running(p: Plan) -> Any:
    """Returns the address where the main thread says which FMI function it calls: see RUNNING."""
    return np.uintp(p.shared.ctypes.data + 8 * RUNNING)


@inlined
def _call(instances: NDArray[Any], calls: NDArray[Any], i: int, first: int, last: int, at: Any) -> bool:
    """Makes calls of instance `i` until one fails; returns whether all succeeded; `at`: of `running`, or False."""
    for c in range(np.uintp(first), np.uintp(last)):
        call = calls[c]
        note(at, call)
        if call.width == 0:
            status = get_or_set(call.function, call.handle, call.references, np.uintp(call.n), call.values)
        elif call.width == PACKED:
            n, n_values = np.uintp(call.n & np.uint32(0xFFFF)), np.uintp(call.n >> np.uint32(16))
            status = get_or_set3(call.function, call.handle, call.references, n, call.values, n_values)
        else:
            status = call3(call)
        if status > 1 or status < 0:
            fail(instances, i, call.number, status, 0)
            return False
    return True


@kernel
def _blame(
    instances: NDArray[Any], feeds: NDArray[Any], real_out: NDArray[np.float64], counters: NDArray[np.int64]
) -> int:
    """Marks every instance with a NaN output as failed, unless NaN is allowed; returns the number of these."""
    return int(blame_some(instances, feeds, real_out, counters, 0, instances.size, 0, real_out.size))


@kernel
def blame_some(
    instances: NDArray[Any],
    feeds: NDArray[Any],
    real_out: NDArray[np.float64],
    counters: NDArray[np.int64],
    first: int,
    last: int,
    first_real: int,
    last_real: int,
) -> int:
    """Marks those of the instances first to last - 1 that have a NaN output, which is among the given real outputs.

    Without any NaN, only the first loop runs, which tests several outputs at a time.
    """
    if counters[NAN_ALLOWED] != 0:
        return 0
    found = 0
    for j in range(np.uintp(first_real), np.uintp(last_real)):
        found += real_out[j] != real_out[j]
    if found == 0:
        return 0
    blamed = 0
    for i in range(first, last):
        m = instances[i]
        for j in range(np.uintp(feeds[i].first_out[0]), np.uintp(feeds[i].last_out[0])):
            if real_out[j] != real_out[j] and m.failed[0] == 0:
                fail(instances, i, GET_REAL, NOT_A_NUMBER, int(j))
                blamed += 1
    return blamed


@kernel
def _collect_packets(
    instances: NDArray[Any],
    calls: NDArray[Any],
    ports: NDArray[Any],
    i: int,
    encoded: NDArray[np.uint8],
    tx: NDArray[np.uint8],
    at: Any,
) -> None:
    """Collects the packets sent by all endpoints of instance `i`; those of the first endpoint are already fetched."""
    first = instances[i].endpoint
    collect(instances, ports, i, first, encoded, tx)
    for e in range(first + 1, first + 1 + np.int64(ports[first].further)):
        if _call(instances, calls, i, ports[e].get, ports[e].get + np.uint32(1), at):
            collect(instances, ports, i, e, encoded, tx)


@inlined
def _take_packets(port: Any, e: int, tx: NDArray[np.uint8]) -> bool:
    """Copies the bytes that an instance has sent in a step in one call; returns whether they fit."""
    port.sent = 0
    if port.has_tx != 0 and port.got_size != np.uintp(0):
        if port.got_size > np.uintp(tx.shape[1]):
            return False
        for j in range(np.int64(port.got_size)):
            tx[e, j] = byte_at(np.uintp(port.got + np.uintp(j)))
        port.sent = np.int64(port.got_size)
    return True


@kernel
def collect(
    instances: NDArray[Any], ports: NDArray[Any], i: int, e: int, encoded: NDArray[np.uint8], tx: NDArray[np.uint8]
) -> None:
    """Decodes packets of endpoint `e` of instance `i` from base64 into its row of `tx`, which is empty until then."""
    port = ports[e]
    port.sent = 0
    if port.has_tx == 0 or port.got == np.uintp(0):
        return
    n = 0
    if port.binary != 0:
        if port.got_size > np.uintp(tx.shape[1]):
            fail(instances, i, GET_STRING, TOO_LONG, 0)
            return
        for j in range(np.int64(port.got_size)):
            tx[e, j] = byte_at(np.uintp(port.got + np.uintp(j)))
        port.sent = np.int64(port.got_size)
        return
    character = byte_at(port.got)
    while character != 0 and n < encoded.size:
        encoded[n] = character
        n += 1
        character = byte_at(np.uintp(port.got + np.uintp(n)))
    if n == 0:
        return
    length = TOO_LONG if character != 0 else decode_base64(encoded, n, tx[e])
    if length == TOO_LONG:
        fail(instances, i, GET_STRING, TOO_LONG, 0)
    elif length < 0:
        fail(instances, i, GET_STRING, NOT_BASE64, 0)
    else:
        port.sent = length


@kernel
def _corrupted(instances: NDArray[Any], library: int) -> bool:
    """Returns whether an instance of this FMU has answered fmi2Fatal; then no other instance may be called."""
    for i in range(instances.size):
        m = instances[i]
        if m.library == library and m.failed[0] != 0 and m.failed[1] == FATAL:
            return True
    return False


@kernel
def _do_step3(m: Any, t: float, h: float, final: int, near: float) -> Any:
    """Calls fmi3DoStep; returns a status, ENDED, EARLY, or LEFT for a step with an event (`near`: at its end)."""
    has_events = load_u1(np.uintp(m.answers + np.uintp(24))) != 0
    if not has_events:
        status = do_step3(m.do_step, m.handle, t, h, final, m.answers)
        # The time reached may still be slightly less than t + h, which the standard leaves to the FMU (FMI 3.0.2,
        # section 4.2.1).
        if status > 1 or load_i4(m.answers) & NO_EVENT == 0:
            return status
        return ENDED if load_u1(np.uintp(m.answers + np.uintp(1))) != 0 else EARLY
    slack = max(1e-9 * max(h, abs(t) * 1e-3), near)
    following = load_f8(np.uintp(m.answers + np.uintp(16)))
    changes_by_event = load_u1(np.uintp(m.answers + np.uintp(26))) != 0
    if changes_by_event or following < t + h - slack:
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


@kernel
def begin_ahead(
    instances: NDArray[Any],
    calls: NDArray[Any],
    ports: NDArray[Any],
    counters: NDArray[np.int64],
    ahead: NDArray[Any],
    at: Any,
) -> None:
    """Begins the steps of isolated instances, which their processes then make while others step; see proxy.c.

    `step_some` makes the same calls again: they have no effect, and its call of doStep waits for the end of the step.
    """
    k, base = counters[K], counters[BASE]
    left = counters[LAST] - k
    per_second = 1e9 * counters[PER_NS]
    t = (counters[START] + k * base) / per_second
    for one in ahead:
        i: Any = np.uintp(one.instance)
        m = instances[i]
        if one.begin == np.uintp(0) or (m.period != 1 and k % m.period != 0):
            continue
        packets = m.endpoint >= 0 and ports[m.endpoint].filled > 0
        if not _call(instances, calls, i, m.first_set if packets else m.first_set_value, m.last_set, at):
            continue
        h = min(m.period, left) * base / per_second
        if m.answers == np.uintp(0):
            do_step2(one.begin, m.handle, t, h, counters[FINAL])
        else:
            do_step3(one.begin, m.handle, t, h, counters[FINAL], m.answers)
    for one in ahead:
        if one.begin != np.uintp(0):
            do_step2(one.post, instances[np.uintp(one.instance)].handle, t, 0.0, 0)


_AHEAD = 2
"""How far ahead memory is fetched: that of one instance takes about as long to come as another one's step."""


@inlined
def _expect(instances: NDArray[Any], i: Any, k: int, begins: bool) -> None:
    """Prefetches the memory of instance `i`, if it has a function for that and needs its memory for the first time.

    `begins`: whether the group's window begins; what steps in each of its base steps is near from then on.
    """
    m = instances[i]
    if m.expect == np.uintp(0):
        return
    if m.period == 1:
        if not begins:
            return
    else:
        since = k % m.period
        if since != 0 and since + 1 != m.period:
            return
    expect(m.expect, m.handle)


@inlined
def _step_whole(whole: Any, t: float, h: float, packets: int) -> int:
    """Makes a step in one call, whose arguments are in the WHOLE row at an address; returns what it answers."""
    return int(step_whole(np.uintp(load_i8(whole)), np.uintp(whole + np.uintp(8)), t, h, packets))


@inlined
def step_some(
    instances: NDArray[Any],
    calls: NDArray[Any],
    ports: NDArray[Any],
    encoded: NDArray[np.uint8],
    rx: NDArray[np.uint8],
    tx: NDArray[np.uint8],
    counters: NDArray[np.int64],
    k: int,
    chosen: NDArray[np.int64],
    at: Any,
) -> int:
    """Makes base step `k` of the instances `chosen`: each begins a step, ends one, does both, or does neither.

    Returns the number of failed instances.
    """
    base = counters[BASE]
    left = counters[LAST] - k
    final = counters[FINAL]
    per_second = 1e9 * counters[PER_NS]
    t = (counters[START] + k * base) / per_second
    failed = 0
    expecting = chosen.size - _AHEAD if counters[EXPECTING] != 0 else 0
    begins = counters[WINDOW] == 0 or k == counters[FROM]
    if expecting > 0 and begins:
        for n in range(_AHEAD):
            _expect(instances, np.uintp(chosen[n]), k, begins)
    for n in range(np.uintp(chosen.size)):
        i: Any = np.uintp(chosen[n])  # a possibly negative index costs a comparison at each use
        m = instances[i]
        if np.int64(n) < expecting:
            _expect(instances, np.uintp(chosen[n + np.uintp(_AHEAD)]), k, begins)
        well, later, read = True, False, False
        since = 0 if m.period == 1 else np.int64(np.uintp(k) % np.uintp(m.period))
        if failed > 0 and _corrupted(instances, m.library):
            fail(instances, i, DO_STEP, NOT_CALLED, 0)
            well = False
        elif since == 0:
            if m.length != min(m.period, left):
                m.length = min(m.period, left)
                m.h = m.length * base / per_second
            packets = m.endpoint >= 0 and ports[m.endpoint].filled > 0
            status = NOT_BEGUN
            if m.whole != np.uintp(0) and m.length == 1:
                note(at, m)
                status = _step_whole(m.whole, t, m.h, 1 if packets else 0)
                read = status != NOT_READ
                status = 0 if status == NOT_READ else status
            if status == NOT_BEGUN:
                read = False
                given = np.uintp(0)
                if packets and ports[m.endpoint].raw != 0:  # text of them for the calls of FMI
                    given = ports[m.endpoint].given
                    size = int(np.int64(ports[m.endpoint].given_size))
                    encoded[encode_base64(rx[m.endpoint], size, encoded)] = 0
                    ports[m.endpoint].given = np.uintp(encoded.ctypes.data)
                well = _call(instances, calls, i, m.first_set if packets else m.first_set_value, m.last_set, at)
                if given != np.uintp(0):
                    ports[m.endpoint].given = given
                if well:
                    note(at, m)
                    if m.answers == np.uintp(0):
                        status = do_step2(m.do_step, m.handle, t, m.h, final)
                    else:
                        # Times of events are whole nanoseconds.
                        status = _do_step3(m, t, m.h, final, 0.0 if counters[PER_NS] == 1 else 6e-10)
            later = status == LEFT
            if well and not later and (status > 1 or status < 0):
                fail(instances, i, DO_STEP, status, 0)
                well = False
        if since + 1 == m.length and well and not later:
            well = read or _call(instances, calls, i, m.first_get, m.last_get, at)
            if m.endpoint >= 0 and well:
                if read:
                    if not _take_packets(ports[m.endpoint], m.endpoint, tx):
                        fail(instances, i, GET_STRING, TOO_LONG, 0)
                else:
                    _collect_packets(instances, calls, ports, i, encoded, tx, at)
                well = m.failed[0] == 0
        if not well:
            failed += 1
    return failed


@kernel
def step_free(
    instances: NDArray[Any],
    calls: NDArray[Any],
    ports: NDArray[Any],
    encoded: NDArray[np.uint8],
    rx: NDArray[np.uint8],
    tx: NDArray[np.uint8],
    counters: NDArray[np.int64],
    k: int,
    chosen: NDArray[np.int64],
) -> int:
    """Makes base step `k` of instances that any thread may step; returns the number of failed ones."""
    return step_some(instances, calls, ports, encoded, rx, tx, counters, k, chosen, False)


@kernel
def step_chosen(p: Plan, chosen: NDArray[np.int64]) -> int:
    """Makes the current base step of instances that the main thread must step; returns the number of failed ones."""
    at = running(p)
    return step_some(p.instances, p.calls, p.ports, p.encoded[0], p.rx, p.tx, p.counters, p.counters[K], chosen, at)


@kernel
def step_in_order(p: Plan, k: int, chosen: NDArray[np.int64]) -> int:
    """Steps by Gauss-Seidel: exchange and step, one instance after the other; returns the number of failures."""
    failed = 0
    at = running(p)
    for j in range(chosen.size):
        i = chosen[j]
        if failed > 0 and _corrupted(p.instances, p.instances[i].library):
            fail(p.instances, i, DO_STEP, NOT_CALLED, 0)
            failed += 1
            continue
        # Inlined, because passing the plan takes longer than a step.
        exchange(
            p.instances,
            p.feeds[i : i + 1],
            p.sources,
            p.wires,
            p.int_to_real,
            p.value_maps,
            p.real_out,
            p.int_out,
            p.real_in,
            p.int_in,
            k,
        )
        if p.slopes.size > 0:
            extrapolate(p, k, i, i + 1)
        failed += step_some(
            p.instances, p.calls, p.ports, p.encoded[0], p.rx, p.tx, p.counters, k, chosen[j : j + 1], at
        )
    return failed


@entry
def step_each(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Exchanges and steps the instances `chosen`, one after the other."""
    p.counters[FAILURES] += step_in_order(p, p.counters[K], chosen)
    p.counters[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.counters)


@entry
def step_together(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Exchanges for all instances `chosen`, then steps them."""
    for i in chosen:
        feed(p, p.counters[K], p.feeds[i : i + 1])
    p.counters[FAILURES] += step_chosen(p, chosen)
    p.counters[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.counters)


@entry
def collect_all(p: Plan) -> None:
    """Collects the outputs of every instance after initialization, and the values that never change after it."""
    at = running(p)
    for i in range(p.instances.size):
        m = p.instances[i]
        if p.counters[FAILURES] > 0 and _corrupted(p.instances, m.library):
            continue
        _call(p.instances, p.calls, i, m.last_set, m.last_get, at)
        if m.endpoint >= 0 and m.failed[0] == 0:
            _collect_packets(p.instances, p.calls, p.ports, i, p.encoded[0], p.tx, at)
        if m.failed[0] != 0:
            p.counters[FAILURES] += 1
    p.counters[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.counters)


@kernel
def any_pending(instances: NDArray[Any]) -> bool:
    pending = 0
    for i in range(instances.size):
        if instances[i].answers != np.uintp(0):
            pending += load_u1(np.uintp(instances[i].answers + np.uintp(25)))
    return bool(pending > 0)


@entry
def collect_again(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Collects the outputs of the instances `chosen` at the end of their steps, after their events."""
    at = running(p)
    for i in chosen:
        m = p.instances[i]
        _call(p.instances, p.calls, i, m.first_get, m.last_get, at)
        if m.endpoint >= 0 and m.failed[0] == 0:
            _collect_packets(p.instances, p.calls, p.ports, i, p.encoded[0], p.tx, at)
        if m.failed[0] != 0:
            p.counters[FAILURES] += 1
    p.counters[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.counters)

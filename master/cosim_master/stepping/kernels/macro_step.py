"""The macro step: Python that numba compiles, over a plan of flat arrays, calling FMI functions by address.

    t_k = t0 + k*h, k an integer; t0 and h whole ticks, of which a whole number makes a nanosecond
    DELIVER   packets that have arrived by t_k         -> mavlink_rx of receivers that are due
              (before that, those that have left the medium or reached a relay by t_k -> channel -> in flight)
    STEP      exchange: outputs(t_k) -> inputs, all read before any is written (Jacobi)
              step every instance that is due: t_k -> t_k + n*h; isolated ones begin before the others
              collect outputs of the instances whose step ends at t_k + h
    SEND      their mavlink_tx -> router -> channel -> in flight
    RECORD    a row of values at t_k + h, when due; k := k + 1

In large swarms, groups of instances make STEP for several base steps each, before DELIVER and SEND of the first of
them: see `windows`. All else is done in the order above.

With Gauss-Seidel, instances step one after the other, and each takes its inputs from the latest outputs.
Delayed connections (`Plan.delay_line`) and extrapolated inputs (`Plan.slopes`) store earlier values.

Base steps in which no instance begins or ends a step are skipped (`Plan.grids`).

`run` returns to Python only if Python is needed, and resumes at the phase in which it returned. If an instance fails,
the others still finish the macro step; `failed` then names every failure, and k is unchanged.

This module does not interpret values: it handles only handles, addresses, references and indices.

Kernels that run in every step receive the arrays that they need instead of the plan: passing all of it takes longer
than an FMI call.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim.packets import MAX_PACKET, encode_base64
from cosim_master.network.radio.air import serve_medium
from cosim_master.network.radio.prefetching import expect_bytes
from cosim_master.network.radio.queues import arrived, deliver
from cosim_master.network.radio.router import send
from cosim_master.network.radio.tables import (
    AIRBORNE,
    FREE_PLACES,
    IN_FLIGHT,
    NEAREST_ON_AXIS,
    POSTED,
    USED_EVENTS,
    USED_LOG,
    WAITING,
    Radio,
)
from cosim_master.network.radio.topology import copies, sort_along
from cosim_master.stepping.kernels.exchange import delay, exchange, extrapolate, point_in_time
from cosim_master.stepping.kernels.frames import DUE, Frames, keep_frame
from cosim_master.stepping.kernels.instances import (
    _blame,
    _call,
    any_pending,
    begin_ahead,
    running,
    step_free,
    step_in_order,
    step_some,
)
from cosim_master.stepping.kernels.tables import (
    BASE,
    BLOCK,
    BLOCK_FULL,
    BY_PYTHON,
    DELIVER,
    DONE,
    EVENTFUL,
    EVENTS_DUE,
    EVERY,
    FAILED,
    FAILURES,
    FINER,
    FROM,
    IN_ORDER,
    JACOBI,
    LAST,
    NEED_LOG,
    NEED_OUTBOX,
    NEED_PLACES,
    ORDER,
    PHASE,
    PLACES,
    ROWS,
    RUNNING,
    SEND,
    START,
    STEP,
    STEPS_DUE,
    UNTIL,
    K,
    Plan,
)
from cosim_master.stepping.kernels.threads import hand_out, join_in, make_window
from cosim_master.stepping.kernels.windows import account, failed_at, note_positions, put_back, window

__all__ = ["end_here", "next_point", "outbox_needed", "places_needed", "record", "run", "sent_bytes"]


_AHEAD, _NEAR = 4, 128
"""How many ports ahead packets are asked for, and their first bytes, of which most have no more."""


_TOGETHER = 1 << 18
"""Places that are reserved for the packets of all ports together; a thousand nodes that hear each other need more."""


@kernel
def _is_point(grids: NDArray[np.int64], k: int, finer: int) -> bool:
    """Returns whether the step of an instance ends at base step k."""
    ending = 0
    for j in range(grids.size):
        ending += k % (grids[j] * finer) == 0
    return bool(ending > 0)


@kernel
def _following(grids: NDArray[np.int64], counters: NDArray[np.int64], k: int, stop: int) -> int:
    """Returns the first base step in k to `stop` in which an instance begins or ends a step or a row is due."""
    found = stop if k >= counters[LAST] else min(stop, counters[LAST] - 1)
    for j in range(grids.size):
        begins = -(-k // grids[j]) * grids[j]
        ends = -(-(k + 1) // grids[j]) * grids[j] - 1
        found = min(found, begins, ends)
    if counters[EVERY] > 1:
        found = min(found, -(-k // counters[EVERY]) * counters[EVERY])
    return int(max(found, k))


@entry
def next_point(p: Plan, stop: int) -> int:
    """Returns the next base step after the current one at which an action is due, at most `stop`."""
    k = p.counters[K] + 1
    if p.grids.size > 0 and p.delays.size == 0 and p.counters[FINER] == 1:
        return int(_following(p.grids, p.counters, k, stop))
    return int(k)


@kernel
def _deliver_all(p: Plan, r: Radio, k: int) -> None:
    """Delivers packets that have arrived to instances that are due, as base64 text or as bytes (PORTS)."""
    instances, ports, rx, endpoints, places = p.instances, p.ports, p.rx, r.endpoints, r.places
    t = point_in_time(p.counters, k)
    for e in range(ports.size):
        port = ports[e]
        if port.has_rx == 0:
            continue
        due = arrived(endpoints, places, t, e)
        if not due and port.filled == 0:
            continue
        period = instances[port.instance].period
        if period > 1 and k % period != 0:
            continue
        if due:
            as_bytes = port.binary != 0 or port.raw != 0
            n = deliver(r, t, e, rx[e] if as_bytes else p.received[0])
            if as_bytes:
                port.given_size = n
            else:
                rx[e, encode_base64(p.received[0], n, rx[e])] = 0
            port.filled = 2
        elif port.filled > 0:
            port.filled -= 1
            port.given_size = 0
            rx[e, 0] = 0
        first = instances[port.instance].endpoint
        if first != e and port.filled > 0:
            ports[first].filled = max(ports[first].filled, 1)  # all are set together


@entry
def sent_bytes(p: Plan) -> int:
    """Returns the number of bytes of packets that are collected and not yet routed."""
    ports = p.ports
    total = 0
    for e in range(ports.size):
        total += ports[e].sent
    return total


@kernel
def _at_most(sent: int) -> int:
    """Returns an upper bound of the packets, and of the pieces of garbage, in this number of bytes."""
    return sent // 8 + 2 if sent > 0 else 0


@kernel
def _collected(p: Plan, each: int) -> tuple[int, bool]:
    """Returns an upper bound of the packets that are routed together, and whether these are those of all ports.

    `each`: places that a packet needs. Above `_TOGETHER` places, packets are routed port by port.
    """
    packets, most = 0, 0
    for e in range(p.ports.size):
        packets += _at_most(p.ports[e].sent)
        most = max(most, _at_most(p.ports[e].sent))
    together = packets * each <= _TOGETHER
    return packets if together else most, together


@entry
def places_needed(p: Plan, r: Radio) -> int:
    """Returns an upper bound of the places in flight, and of the events, needed to route the collected packets."""
    each = copies(r)
    packets, _ = _collected(p, each)
    return _room(r, packets, each)


@kernel
def _room(r: Radio, packets: int, each: int) -> int:
    """Returns the places for packets that are sent now, and for those that wait; those in the air go one by one."""
    waiting = r.counters[WAITING]
    if r.trip.size > 0:
        waiting += 1 - r.counters[AIRBORNE]
    return int((packets + waiting) * each)


@entry
def outbox_needed(p: Plan) -> int:
    """Returns an upper bound of the packets that are collected and not yet routed."""
    packets = 0
    for e in range(p.ports.size):
        packets += _at_most(p.ports[e].sent)
    return packets


@kernel
def _send_all(p: Plan, r: Radio, k: int) -> int:
    """Sends all collected packets; returns DONE, or the reason for which arrays must grow first."""
    total = sent_bytes(p)
    if total == 0:
        return DONE
    if r.outbox.size > 0 and r.counters[POSTED] + outbox_needed(p) > r.outbox.size:
        return NEED_OUTBOX
    each = copies(r)
    packets, together = _collected(p, each)
    need = _room(r, packets, each)
    if need > r.counters[FREE_PLACES]:
        return NEED_PLACES
    events, used = r.counters[USED_EVENTS] + need, r.counters[USED_LOG] + 3 * total
    if r.settings[0].keep != 0 and (events > r.events.size or used > r.log.size):
        return NEED_LOG
    reals = p.real_out
    if p.groups.size > 0:
        if k < p.counters[FROM]:  # what instances send at the start
            note_positions(p, 0, 0, p.positions.shape[0])
        reals = p.past[max(k - p.counters[FROM], 0)]
    if r.settings[0].topology == NEAREST_ON_AXIS and r.outbox.size == 0:
        sort_along(r, reals)
    t = point_in_time(p.counters, k + 1)
    for e in range(p.ports.size):
        if e + _AHEAD < p.ports.size and p.ports[e + _AHEAD].sent > 0:
            expect_bytes(np.uintp(p.tx.ctypes.data + (e + _AHEAD) * p.tx.shape[1]), _NEAR)
        if p.ports[e].sent > 0:
            if not together and need > r.counters[FREE_PLACES]:
                return NEED_PLACES
            if not together and r.settings[0].keep != 0 and r.counters[USED_EVENTS] + need > r.events.size:
                return NEED_LOG
            send(r, reals, t, e, p.tx[e], p.ports[e].sent)
            p.ports[e].sent = 0
    return DONE


@kernel
def _serve_medium(p: Plan, r: Radio, k: int) -> int:
    """Routes packets that have left the medium or reached a relay; returns DONE, or why an array must grow first."""
    if r.settings[0].topology == NEAREST_ON_AXIS:
        sort_along(r, p.real_out)
    while True:
        need = places_needed(p, r)
        if need > r.counters[FREE_PLACES]:
            return NEED_PLACES
        if r.settings[0].keep != 0 and r.counters[USED_EVENTS] + need > r.events.size:
            return NEED_LOG
        if serve_medium(r, p.real_out, point_in_time(p.counters, k)):
            return DONE


@kernel
def _complete_row(p: Plan, k: int) -> None:
    """Adds the row at time t_k, whose values are written."""
    row = p.counters[ROWS]
    p.ticks[row] = p.counters[START] + k * p.counters[BASE]
    p.counters[ROWS] = row + 1


@kernel
def _record(p: Plan, k: int) -> None:
    """Adds a row at time t_k to the block."""
    row = p.counters[ROWS]
    real_block, real_out, real_recorded = p.real_block[row], p.real_out, p.real_recorded
    for j in range(real_recorded.size):
        real_block[j] = real_out[real_recorded[j]]
    int_block, int_out, int_recorded = p.int_block[row], p.int_out, p.int_recorded
    for j in range(int_recorded.size):
        int_block[j] = int_out[int_recorded[j]]
    _complete_row(p, k)


@entry
def record(p: Plan) -> None:
    """Adds a row at the current time."""
    _record(p, p.counters[K])


@entry
def end_here(p: Plan, chosen: NDArray[np.int64]) -> None:
    """Completes the last macro step, with which the instances `chosen` end the run, and adds a row for its end."""
    counters = p.counters
    at = running(p)
    for i in chosen:
        p.instances[i].failed[0] = 0
        _call(p.instances, p.calls, i, p.instances[i].first_get, p.instances[i].last_get, at)
    counters[FAILURES] = 0
    counters[K] += 1
    counters[PHASE] = DELIVER
    _record(p, counters[K])


@entry
def run(p: Plan, r: Radio, f: Frames, k_stop: int) -> int:
    """Makes macro steps until k = `k_stop`, or until Python is needed; returns the reason.

    A part of a run adds a frame of the values at each communication point, when nothing changes them any more.
    """
    counters = p.counters
    p.shared[PLACES] = r.places.ctypes.data
    while True:
        k = counters[K]
        if counters[PHASE] == DELIVER:
            if f.counters[DUE] == k:
                keep_frame(p, f)
            if k >= k_stop:
                return DONE
            if r.counters[WAITING] > 0:
                reason = _serve_medium(p, r, k)
                if reason != DONE:
                    return reason
            if p.groups.size > 0 and k >= counters[UNTIL]:
                make_window(p, r, k, window(p, k, k_stop))
            in_flight = r.counters[IN_FLIGHT]  # after the medium and relays have made copies
            if (
                r.settings[0].keep != 0
                and in_flight > 0
                and r.counters[USED_LOG] + in_flight * (MAX_PACKET + 16) > r.log.size
            ):
                return NEED_LOG
            if p.groups.size > 0:
                account(p, r, k)
            elif p.ports.size > 0:
                _deliver_all(p, r, k)
            counters[PHASE] = STEP
        if counters[PHASE] == STEP and p.groups.size > 0:
            counters[FAILURES] += failed_at(p, k)
            if counters[FAILURES] > 0:
                return FAILED
            counters[PHASE] = SEND
        if counters[PHASE] == STEP:
            if p.delays.size > 0:
                delay(p, k)
            if counters[ORDER] == BY_PYTHON:
                return STEPS_DUE
            if counters[ORDER] == JACOBI:
                exchange(
                    p.instances,
                    p.input_runs,
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
                    extrapolate(p, k, 0, p.instances.size)
                if p.ahead.size > 0:
                    begin_ahead(p.instances, p.calls, p.ports, counters, p.ahead, running(p))
            if counters[BLOCK] > 0:
                hand_out(p)
            if counters[ORDER] == IN_ORDER:
                counters[FAILURES] += step_in_order(p, k, p.confined)
            elif p.confined.size > 0:
                counters[FAILURES] += step_some(
                    p.instances, p.calls, p.ports, p.encoded[0], p.rx, p.tx, counters, k, p.confined, running(p)
                )
            p.shared[RUNNING] = 0
            if counters[BLOCK] > 0:
                counters[FAILURES] += join_in(p, r)
            elif p.free.size > 0:
                counters[FAILURES] += step_free(
                    p.instances, p.calls, p.ports, p.encoded[0], p.rx, p.tx, counters, k, p.free
                )
            counters[FAILURES] += _blame(p.instances, p.feeds, p.real_out, p.counters)
            if counters[FAILURES] > 0:
                return FAILED
            counters[PHASE] = SEND
            if counters[EVENTFUL] > 0 and any_pending(p.instances):
                return EVENTS_DUE
        if counters[PHASE] == SEND:
            if p.groups.size > 0:
                put_back(p, k)
            reason = _send_all(p, r, k) if p.ports.size > 0 else DONE
            if reason != DONE:
                return reason
        k += 1
        if p.grids.size > 0 and p.delays.size == 0 and counters[FINER] == 1:
            k = _following(p.grids, counters, k, max(k, k_stop))
        counters[K] = k
        counters[PHASE] = DELIVER
        if f.steps.size > 0:
            f.counters[DUE] = k
        if (
            k % counters[EVERY] == 0
            and (p.grids.size == 0 or counters[EVERY] > counters[FINER] or _is_point(p.grids, k, counters[FINER]))
        ) or k == counters[LAST]:
            if p.groups.size > 0 and k > counters[FROM]:
                _complete_row(p, k)
            else:
                _record(p, k)
            if counters[ROWS] == p.ticks.size:
                return BLOCK_FULL

"""Windows: groups of instances make several base steps each on its own, before the packets between them are routed.

A swarm's memory does not fit a core's cache: when all instances make a base step before the next one begins, each comes
from afar every time. But nothing that one group (`Plan.groups`: instances joined by connections or by a node of the
radio) sends arrives at another one before the radio's latency is over. So a thread takes a group, and makes the base
steps of a whole window with it while its memory is near:

    step_group   for each base step: packets that arrive -> exchange -> step -> packets on board; values of the row
    run          then again for each base step of the window, in order: DELIVER and SEND for all groups, as without them

The loop routes all packets as if the groups had not been ahead: in the same order, with the same positions (`past`),
and also on board. What a group receives in the meantime comes from a look ahead (`Plan.inboxes`): packets that are
already in flight to it, and those that its own endpoints send on board. So results and recordings are the same to the
bit.

Bytes that a group sends wait in memory of their own (SENT), since their number has no useful bound.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.deferred import InModule
from cosim.kernel import kernel
from cosim.packets import BAD_CRC, INCOMPATIBLE, NOTHING, TRUNCATED, encode_base64, system
from cosim_master.network.radio.prefetching import expect_bytes, expect_place
from cosim_master.network.radio.queues import arrived, take_delivered
from cosim_master.network.radio.router import goes_on_board, next_packet
from cosim_master.network.radio.tables import SWARM, Radio
from cosim_master.stepping.kernels.exchange import feed, point_in_time
from cosim_master.stepping.kernels.fmi_calls import load_i8, store_i8
from cosim_master.stepping.kernels.instances import blame_some, step_free
from cosim_master.stepping.kernels.tables import EVERY, FAULTS, FROM, LAST, ROWS, UNTIL, WINDOW, Plan

__all__ = ["account", "failed_at", "note_positions", "put_back", "step_group", "window"]


def _intrinsics() -> Any:
    from cosim_master.stepping.kernels import intrinsics

    return intrinsics


_malloc: Any = InModule(_intrinsics, "malloc")
_free: Any = InModule(_intrinsics, "free")
_memcpy: Any = InModule(_intrinsics, "memcpy")

_FOLLOWING, _WHEN, _ENDPOINT, _LENGTH, _BYTES = 0, 8, 16, 24, 32
"""Offsets in a record of packets that wait: the address of the following record, 0 for none; base step (of SENT) or
time, ns (on board); endpoint; length; bytes.
"""


_AHEAD, _NEAR = 8, 128
"""How many endpoints ahead packets are asked for, and their first bytes, of which most have no more."""


@kernel
def _keep(when: int, e: int, address: Any, length: int) -> Any:
    """Returns the address of a new record with these bytes; no memory ends the process, as elsewhere."""
    at: Any = _malloc(np.uintp(_BYTES + length))
    store_i8(np.uintp(at + np.uintp(_FOLLOWING)), 0)
    store_i8(np.uintp(at + np.uintp(_WHEN)), when)
    store_i8(np.uintp(at + np.uintp(_ENDPOINT)), e)
    store_i8(np.uintp(at + np.uintp(_LENGTH)), length)
    _memcpy(np.uintp(at + np.uintp(_BYTES)), np.uintp(address), np.uintp(length))
    return np.uintp(at)


@kernel
def _row_at(rows: NDArray[np.uint8], i: int) -> Any:
    """Returns the address of row i."""
    return np.uintp(np.uintp(rows.ctypes.data) + np.uintp(i * rows.shape[1]))


@kernel
def _word(record: Any, offset: int) -> int:
    return int(load_i8(np.uintp(record + np.uintp(offset))))


@kernel
def _pop(record: Any) -> Any:
    """Frees a record; returns the address of the following one."""
    following = np.uintp(load_i8(np.uintp(record + np.uintp(_FOLLOWING))))
    _free(np.uintp(record))
    return following


@kernel
def _row_is_due(p: Plan, k: int) -> bool:
    """Returns whether a row is recorded at base step k, where all base steps are communication points."""
    return bool(k % p.counters[EVERY] == 0 or k == p.counters[LAST])


@kernel
def window(p: Plan, k: int, k_stop: int) -> int:
    """Returns the end of the window from base step k: at most `k_stop`, and before its rows exceed the block."""
    counters = p.counters
    end = min(k + counters[WINDOW], k_stop)
    room = p.ticks.size - counters[ROWS]
    for j in range(k + 1, end + 1):
        if _row_is_due(p, j):
            if room == 0:
                return int(max(j - 1, k + 1))
            room -= 1
    return int(end)


# ---- a group on its own ----------------------------------------------------------------------------------------------


@kernel
def _look_ahead(p: Plan, r: Radio, group: Any) -> None:
    """Begins a window: nothing that is in flight to the group has been received."""
    for e in range(group.first_port, group.last_port):
        inbox, endpoint = p.inboxes[e], r.endpoints[e]
        inbox.heard, inbox.next = endpoint.heard, endpoint.first
        inbox.first = inbox.last = np.uintp(0)
        expect_place(r, endpoint.first)


@kernel
def _take(r: Radio, inbox: Any, t: int, capacity: int, into: Any) -> int:
    """Copies packets that have reached an endpoint by time t [ns] to an address; returns the bytes. See `deliver`."""
    n = 0
    while True:
        near = inbox.first != np.uintp(0) and _word(inbox.first, _WHEN) <= t
        far = inbox.next >= 0 and r.places[inbox.next].arrival <= t
        if near and far:  # what was in flight before the window comes first
            near = _word(inbox.first, _WHEN) < r.places[inbox.next].arrival
        if near:
            length = _word(inbox.first, _LENGTH)
            if n + length > capacity:
                return n
            _memcpy(np.uintp(into + np.uintp(n)), np.uintp(inbox.first + np.uintp(_BYTES)), np.uintp(length))
            inbox.first = _pop(inbox.first)
            if inbox.first == np.uintp(0):
                inbox.last = np.uintp(0)
        elif far:
            place = inbox.next
            length = r.places[place].length
            if n + length > capacity:
                return n
            _memcpy(np.uintp(into + np.uintp(n)), _row_at(r.data, place), np.uintp(length))
            inbox.next = r.places[place].following
            expect_place(r, inbox.next)
        else:
            return n
        n += length


@kernel
def _receive(p: Plan, r: Radio, thread: int, group: Any, k: int) -> None:
    """Gives packets that have arrived by t_k to instances that are due, as `macro_step` does for all groups."""
    t = point_in_time(p.counters, k)
    for e in range(group.first_port, group.last_port):
        port = p.ports[e]
        if port.has_rx == 0:
            continue
        inbox = p.inboxes[e]
        due = (inbox.first != np.uintp(0) and _word(inbox.first, _WHEN) <= t) or (
            inbox.next >= 0 and r.places[inbox.next].arrival <= t
        )
        if not due and port.filled == 0:
            continue
        period = p.instances[port.instance].period
        if period > 1 and k % period != 0:
            continue
        if due:
            capacity = r.endpoints[e].capacity
            if port.binary != 0 or port.raw != 0:
                port.given_size = _take(r, inbox, t, capacity, _row_at(p.rx, e))
            else:
                received = p.received[thread]
                n = _take(r, inbox, t, capacity, _row_at(p.received, thread))
                p.rx[e, encode_base64(received, n, p.rx[e])] = 0
            port.filled = 2
        elif port.filled > 0:
            port.filled -= 1
            port.given_size = 0
            p.rx[e, 0] = 0
        first = p.instances[port.instance].endpoint
        if first != e and port.filled > 0:
            p.ports[first].filled = max(p.ports[first].filled, 1)  # all are set together


@kernel
def _send_on_board(p: Plan, r: Radio, group: Any, k: int) -> None:
    """Keeps the bytes that the group has sent, and puts their packets into the inboxes of the endpoints on board."""
    t = point_in_time(p.counters, k + 1)
    for e in range(group.first_port, group.last_port):
        n = p.ports[e].sent
        if n == 0:
            continue
        p.ports[e].sent = 0
        bytes_, at = p.tx[e], _row_at(p.tx, e)
        record = _keep(k, e, at, n)
        if group.first_sent == np.uintp(0):
            group.first_sent = record
        else:
            store_i8(np.uintp(group.last_sent + np.uintp(_FOLLOWING)), np.int64(record))
        group.last_sent = record
        node = r.nodes[r.endpoints[e].node]
        common = r.endpoints[e].reach <= SWARM
        place = 0
        while place < n:
            start, stop, status, to_system = next_packet(r, bytes_, place, n)
            if status in (NOTHING, TRUNCATED):
                break
            place = stop
            if status in (BAD_CRC, INCOMPATIBLE):
                continue
            p.inboxes[e].heard = system(bytes_, start)
            if not common:
                continue
            for other in range(node.first, node.last):
                if other != e and goes_on_board(r, other, p.inboxes[other].heard, to_system):
                    record = _keep(t, other, np.uintp(at + np.uintp(start)), stop - start)
                    inbox = p.inboxes[other]
                    if inbox.first == np.uintp(0):
                        inbox.first = record
                    else:
                        store_i8(np.uintp(inbox.last + np.uintp(_FOLLOWING)), np.int64(record))
                    inbox.last = record


@kernel
def _write_row(p: Plan, group: Any, k: int) -> None:
    """Writes the group's values of the row at base step k, which `run` completes."""
    every = p.counters[EVERY]
    row = p.counters[ROWS] + k // every - p.counters[FROM] // every - (1 if k % every == 0 else 0)
    real_block, int_block = p.real_block[row], p.int_block[row]
    for j in range(group.first_recorded[0], group.last_recorded[0]):
        real_block[j] = p.real_out[p.real_recorded[j]]
    for kind in range(1, 3):
        for j in range(group.first_recorded[kind], group.last_recorded[kind]):
            int_block[j] = p.int_out[p.int_recorded[j]]


@kernel
def note_positions(p: Plan, row: int, first: int, last: int) -> None:
    """Notes where the nodes first to last - 1 are now in a row of `Plan.past`."""
    past = p.past[row]
    for n in range(first, last):
        for i in range(3):
            if p.positions[n, i] >= 0:
                past[3 * n + i] = p.real_out[p.positions[n, i]]


@kernel
def step_group(p: Plan, r: Radio, thread: int, g: int) -> int:
    """Makes all base steps of the window with group `g`, or those up to a failure; returns the number of failures."""
    group, counters = p.groups[g], p.counters
    members = p.members[group.first_member : group.last_member]
    runs = p.input_runs[group.first_run : group.last_run]
    _look_ahead(p, r, group)
    failures = 0
    for k in range(counters[FROM], counters[UNTIL]):
        _receive(p, r, thread, group, k)
        feed(p, k, runs)
        failures = step_free(p.instances, p.calls, p.ports, p.encoded[thread], p.rx, p.tx, counters, k, members)
        failures += blame_some(
            p.instances,
            p.feeds,
            p.real_out,
            counters,
            group.first_instance,
            group.last_instance,
            group.first_real,
            group.last_real,
        )
        if failures > 0:
            group.failed, group.failures = k, failures
            break
        _send_on_board(p, r, group, k)
        if _row_is_due(p, k + 1):
            _write_row(p, group, k + 1)
        note_positions(p, k - counters[FROM], group.first_node, group.last_node)
    for e in range(group.first_port, group.last_port):  # the loop routes these once more, and keeps them in flight
        while p.inboxes[e].first != np.uintp(0):
            p.inboxes[e].first = _pop(p.inboxes[e].first)
    return int(failures)


# ---- all groups, base step by base step ------------------------------------------------------------------------------


@kernel
def account(p: Plan, r: Radio, k: int) -> None:
    """Takes what groups have received at base step k out of the queues, and logs it, as their delivery does."""
    instances, ports, endpoints, places = p.instances, p.ports, r.endpoints, r.places
    t = point_in_time(p.counters, k)
    for e in range(ports.size):
        if e + _AHEAD < ports.size:
            expect_place(r, endpoints[e + _AHEAD].first)
        if ports[e].has_rx != 0 and arrived(endpoints, places, t, e):
            period = instances[ports[e].instance].period
            if period == 1 or k % period == 0:
                take_delivered(r, t, e)


@kernel
def failed_at(p: Plan, k: int) -> int:
    """Returns the number of instances that have failed in base step k; those that failed later count as not reached."""
    if p.shared[FAULTS] == 0:
        return 0
    found = 0
    for group in p.groups:
        if group.failed == k:
            found += group.failures
    if found == 0:
        return 0
    for group in p.groups:
        if group.failed > k:
            for i in range(group.first_instance, group.last_instance):
                p.instances[i].failed[0] = 0
    _forget(p)
    return int(found)


@kernel
def put_back(p: Plan, k: int) -> None:
    """Puts the bytes that groups have sent in base step k to their ports, for `send`."""
    for g in range(p.groups.size):
        group = p.groups[g]
        if g + 1 < p.groups.size:
            expect_bytes(p.groups[g + 1].first_sent, _NEAR)
        while group.first_sent != np.uintp(0) and _word(group.first_sent, _WHEN) == k:
            expect_bytes(np.uintp(_word(group.first_sent, _FOLLOWING)), _NEAR)
            e, n = _word(group.first_sent, _ENDPOINT), _word(group.first_sent, _LENGTH)
            _memcpy(_row_at(p.tx, e), np.uintp(group.first_sent + np.uintp(_BYTES)), np.uintp(n))
            p.ports[e].sent = n
            group.first_sent = _pop(group.first_sent)


@kernel
def _forget(p: Plan) -> None:
    """Frees what groups have sent and the loop has not routed."""
    for group in p.groups:
        while group.first_sent != np.uintp(0):
            group.first_sent = _pop(group.first_sent)

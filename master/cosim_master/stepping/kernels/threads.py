"""Instances stepped by several threads: blocks of them, or groups, handed out, taken and joined."""

from __future__ import annotations

import numpy as np

from cosim.entry import entry
from cosim.kernel import kernel
from cosim_master.network.radio.tables import Radio
from cosim_master.stepping.kernels.fmi_calls import atomic_add, atomic_load, exchange_if, rest
from cosim_master.stepping.kernels.instances import step_free
from cosim_master.stepping.kernels.tables import (
    BLOCK,
    COMPLETED,
    FAULTS,
    FROM,
    LIMIT,
    PLACES,
    QUIT,
    TICKET,
    UNTIL,
    K,
    Plan,
)
from cosim_master.stepping.kernels.windows import step_group

__all__ = ["hand_out", "join_in", "make_window", "work"]


@kernel
def _per_step(p: Plan) -> int:
    """Returns the number of blocks of a base step, or of groups of a window."""
    if p.groups.size > 0:
        return int(p.groups.size)
    size = p.counters[BLOCK]
    return int((p.free.size + size - 1) // size)


@kernel
def take_blocks(p: Plan, r: Radio, thread: int) -> int:
    """Steps blocks of instances, or groups, until none of this step are left; returns their number.

    The loop notes its radio before it hands out anything, so a thread with another one never takes a group.
    """
    at = p.shared.ctypes.data
    size = p.counters[BLOCK]
    per_step = _per_step(p)
    taken = 0
    while True:
        ticket = atomic_load(np.uintp(at + 8 * TICKET))
        if ticket >= atomic_load(np.uintp(at + 8 * LIMIT)):
            return taken
        if atomic_load(np.uintp(at + 8 * PLACES)) != np.int64(r.places.ctypes.data):
            return taken
        if not exchange_if(np.uintp(at + 8 * TICKET), ticket, ticket + 1):
            continue
        first = ticket % per_step * size
        if p.groups.size > 0:
            faults = step_group(p, r, thread, ticket % per_step)
        else:
            chosen = p.free[first : first + size]
            faults = step_free(
                p.instances, p.calls, p.ports, p.encoded[thread], p.rx, p.tx, p.counters, p.counters[K], chosen
            )
        if faults > 0:
            atomic_add(np.uintp(at + 8 * FAULTS), faults)
        atomic_add(np.uintp(at + 8 * COMPLETED), 1)
        taken += 1


@entry
def work(p: Plan, r: Radio, thread: int) -> int:
    """Steps blocks of instances, or groups, in a further thread; returns their number.

    It ends when QUIT is set, or when the loop has another radio than `r`.
    """
    at, places = p.shared.ctypes.data, np.int64(r.places.ctypes.data)
    spins = 0
    total = 0
    while atomic_load(np.uintp(at + 8 * QUIT)) == 0 and atomic_load(np.uintp(at + 8 * PLACES)) == places:
        taken = take_blocks(p, r, thread)
        total += taken
        spins = 0 if taken > 0 else spins + 1
        rest(spins)
    return total


@kernel
def hand_out(p: Plan) -> None:
    """Makes the free instances, or the groups, available to other threads."""
    atomic_add(np.uintp(p.shared.ctypes.data + 8 * LIMIT), _per_step(p))


@kernel
def join_in(p: Plan, r: Radio) -> int:
    """Steps free instances together with the other threads until all are done; returns the number of failures."""
    at = p.shared.ctypes.data
    take_blocks(p, r, 0)
    spins = 0
    while atomic_load(np.uintp(at + 8 * COMPLETED)) < atomic_load(np.uintp(at + 8 * LIMIT)):
        spins += 1
        rest(min(spins, 10000))
    return int(atomic_load(np.uintp(at + 8 * FAULTS)))


@kernel
def make_window(p: Plan, r: Radio, k: int, end: int) -> None:
    """Makes the base steps k to end - 1 with all groups, each on its own."""
    p.counters[FROM], p.counters[UNTIL] = k, end
    hand_out(p)
    join_in(p, r)

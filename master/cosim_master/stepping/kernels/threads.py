"""Instances stepped by several threads: blocks handed out, taken and joined."""

from __future__ import annotations

import numpy as np

from cosim.kernel import kernel
from cosim_master.stepping.kernels.fmi_calls import atomic_add, atomic_load, exchange_if, rest
from cosim_master.stepping.kernels.instances import step_some
from cosim_master.stepping.kernels.tables import BLOCK, COMPLETED, FAULTS, LIMIT, QUIT, TICKET, Plan

__all__ = ["hand_out", "join_in", "work"]


@kernel
def take_blocks(p: Plan, thread: int) -> int:
    """Steps blocks of instances until none of this step are left; returns the number of blocks."""
    at = p.shared.ctypes.data
    size = p.counters[BLOCK]
    per_step = (p.free.size + size - 1) // size
    taken = 0
    while True:
        ticket = atomic_load(np.uintp(at + 8 * TICKET))
        if ticket >= atomic_load(np.uintp(at + 8 * LIMIT)):
            return taken
        if not exchange_if(np.uintp(at + 8 * TICKET), ticket, ticket + 1):
            continue
        first = ticket % per_step * size
        faults = step_some(
            p.instances,
            p.calls,
            p.ports,
            p.encoded[thread],
            p.tx,
            p.counters,
            p.free[first : first + size],
            False,
        )
        if faults > 0:
            atomic_add(np.uintp(at + 8 * FAULTS), faults)
        atomic_add(np.uintp(at + 8 * COMPLETED), 1)
        taken += 1


@kernel
def work(p: Plan, thread: int) -> int:
    """Steps blocks of instances in a further thread until QUIT is set; returns the number of blocks."""
    at = p.shared.ctypes.data
    spins = 0
    total = 0
    while atomic_load(np.uintp(at + 8 * QUIT)) == 0:
        taken = take_blocks(p, thread)
        total += taken
        spins = 0 if taken > 0 else spins + 1
        rest(spins)
    return total


@kernel
def hand_out(p: Plan) -> None:
    """Makes the free instances available to other threads."""
    size = p.counters[BLOCK]
    atomic_add(np.uintp(p.shared.ctypes.data + 8 * LIMIT), (p.free.size + size - 1) // size)


@kernel
def join_in(p: Plan) -> int:
    """Steps free instances together with the other threads until all are done; returns the number of failures."""
    at = p.shared.ctypes.data
    take_blocks(p, 0)
    spins = 0
    while atomic_load(np.uintp(at + 8 * COMPLETED)) < atomic_load(np.uintp(at + 8 * LIMIT)):
        spins += 1
        rest(min(spins, 10000))
    return int(atomic_load(np.uintp(at + 8 * FAULTS)))

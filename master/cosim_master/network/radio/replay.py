"""Packets between the parts of a run: each part routes the packets of all parts to its own nodes.

In a part of a run, `send` puts packets into an outbox instead of sending them by radio. The parts exchange their
outboxes, and each routes the packets of all of them in the order in which a run in one process sends them: by time,
endpoint, and place in the output. Random numbers depend on sender, receiver and number only, so the outcomes are the
same; each part records those of its own nodes. If all nodes of another part are out of reach of a packet, its sender's
part keeps it, and records their losses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim_master.network.radio.air import transmit
from cosim_master.network.radio.queues import record_event
from cosim_master.network.radio.tables import NEAREST_ON_AXIS, NO_ROUTE, TURN, Radio
from cosim_master.network.radio.topology import sort_along

__all__ = ["replay"]


@kernel
def _part_nodes(r: Radio, of_node: NDArray[np.int64], beyond: NDArray[np.uint8], i: int) -> bool:
    """Marks the nodes elsewhere that packet i cannot reach; returns whether there are any."""
    found = False
    for n in range(of_node.size):
        if r.nodes[n].elsewhere != 0:
            away = beyond[i, of_node[n]] != 0
            r.nodes[n].elsewhere = 2 if away else 1
            found = found or away
    return found


@entry
def replay(
    r: Radio,
    positions: NDArray[np.float64],
    packets: NDArray[Any],
    data: NDArray[np.uint8],
    of_node: NDArray[np.int64],
    beyond: NDArray[np.uint8],
    first: int,
    last: int,
) -> None:
    """Routes packets first to last - 1, all sent at one time.

    Args:
        positions: of all nodes at that time, three numbers for each, m.
        packets: POST, in the order of sending.
        data: (packets, MAX_PACKET) their bytes.
        of_node: the part of each node.
        beyond: (packets, parts) 1: all nodes of that other part are out of reach, and get no packet; or no columns.
    """
    if r.settings[0].topology == NEAREST_ON_AXIS:
        sort_along(r, positions)
    marked = False
    for i in range(first, last):
        row = packets[i]
        e = row.endpoint
        r.endpoints[e].heard = row.system
        if row.number < 0:
            continue
        r.counters[TURN] = row.turn
        to_system, t = row.addressee, row.time
        if beyond.shape[1] > 0 and (marked or r.nodes[r.endpoints[e].node].elsewhere == 0):
            marked = _part_nodes(r, of_node, beyond, i)
        taken = transmit(r, positions, t, t, e, row.number, -1, to_system, data[i], 0, row.length) or row.taken != 0
        if not taken and to_system != 0 and r.nodes[r.endpoints[e].node].elsewhere == 0:
            r.counters[TURN] += 1
            record_event(r, t, -1, e, -1, data[i], 0, row.length, NO_ROUTE)
    if marked:
        for n in range(of_node.size):
            r.nodes[n].elsewhere = min(r.nodes[n].elsewhere, 1)

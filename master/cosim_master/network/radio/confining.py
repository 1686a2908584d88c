"""The radio of a part of a run: it knows all nodes, and delivers to its own only."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from cosim.entry import forget_tables
from cosim.kernel import table
from cosim.packets import MAX_PACKET
from cosim_master.network.radio.tables import POST, Radio

__all__ = ["confined_radio", "roomier"]

_PACKETS = 256


def confined_radio(radio: Radio, elsewhere: Collection[int]) -> Radio:
    """Returns the radio of a part, in which the nodes `elsewhere` (numbers) belong to other parts.

    Positions of nodes are then in an array of their own: three numbers for each node.
    """
    radio.nodes["elsewhere"][list(elsewhere)] = 1
    for n in range(radio.along.size):
        if radio.nodes[n]["place"][0] >= 0:
            radio.nodes["place"][n] = (3 * n, 3 * n + 1, 3 * n + 2)
    return roomier(radio, _PACKETS)


def roomier(radio: Radio, packets: int) -> Radio:
    """Returns the same radio with room for this many more packets in the outbox, and twice what it has."""
    size = 2 * radio.outbox.size + packets
    outbox, posted = np.zeros(size, dtype=POST), np.zeros((size, MAX_PACKET), dtype=np.uint8)
    outbox[: radio.outbox.size], posted[: radio.outbox.size] = radio.outbox, radio.posted
    forget_tables()  # the memory of this radio can be released
    return radio._replace(outbox=table(outbox), posted=posted)

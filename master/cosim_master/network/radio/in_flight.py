"""The packets in flight to some endpoints, taken out of a radio and put into another, as parts of a run need it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import table
from cosim.packets import MAX_PACKET
from cosim_master.network.radio.tables import FREE_PLACE, FREE_PLACES, IN_FLIGHT, PLACE, Radio

__all__ = ["Flying", "flying", "with_flying"]


@dataclass(frozen=True, slots=True)
class Flying:
    """Packets in flight, queue by queue: the endpoint of each, its PLACE, and its bytes (packets, MAX_PACKET)."""

    endpoints: NDArray[np.int64]
    places: NDArray[Any]
    data: NDArray[np.uint8]

    @staticmethod
    def joined(several: Collection[Flying]) -> Flying:
        """Returns the packets of several radios, which must be to different endpoints."""
        return Flying(
            np.concatenate([one.endpoints for one in several]),
            np.concatenate([one.places for one in several]),
            np.concatenate([one.data for one in several]),
        )


def flying(radio: Radio, endpoints: Collection[int]) -> Flying:
    """Returns copies of the packets in flight to these endpoints, in the order in which they arrive."""
    found, owners = [], []
    for e in endpoints:
        place = int(radio.endpoints[e]["first"])
        while place >= 0:
            found.append(place)
            owners.append(e)
            place = int(radio.places[place]["following"])
    return Flying(np.array(owners, dtype=np.int64), np.array(radio.places[found]), np.array(radio.data[found]))


def with_flying(radio: Radio, packets: Flying) -> Radio:
    """Returns the radio with these packets in flight, and no others."""
    n = len(packets.endpoints)
    size = max(radio.places.size, 2 * n)
    places, data = np.zeros(size, dtype=PLACE), np.zeros((size, MAX_PACKET), dtype=np.uint8)
    places[:n], data[:n] = packets.places, packets.data
    last = np.append(np.diff(packets.endpoints) != 0, True)[:n]
    places["following"][:n] = np.where(last, -1, np.arange(1, n + 1))
    places["following"][n:] = np.arange(n + 1, size + 1)
    ends = np.flatnonzero(last)
    radio.endpoints["first"] = radio.endpoints["last"] = -1
    radio.endpoints["first"][packets.endpoints[ends]] = np.append(0, ends[:-1] + 1)[: len(ends)]
    radio.endpoints["last"][packets.endpoints[ends]] = ends
    if n < size:
        places["following"][-1] = -1
    radio.counters[[FREE_PLACE, FREE_PLACES, IN_FLIGHT]] = (n if n < size else -1, size - n, n)
    return radio._replace(places=table(places), data=data)

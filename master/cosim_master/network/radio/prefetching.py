"""Prefetching: memory of packets is asked for before it is needed.

Packets of a large swarm lie far apart, in the order in which places became free, and a processor waits for each. Among
5,000 points, routing a packet took two to three times as long as among 300; this is a tenth of a whole step of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.deferred import InModule
from cosim.kernel import PLAIN, kernel
from cosim_master.network.radio.tables import Radio

__all__ = ["expect_bytes", "expect_place"]

_LINE = 64
_USED = 40
"""Bytes of a PLACE that every packet uses."""


def _intrinsics() -> Any:
    from cosim_master.network.radio import intrinsics

    return intrinsics


def _plain_prefetch(_address: int) -> None:
    """Does nothing: prefetching changes no result."""


prefetch: Any = _plain_prefetch if PLAIN else InModule(_intrinsics, "prefetch")


@kernel
def expect_bytes(address: Any, length: int) -> None:
    """Asks for memory at an address; 0: for none."""
    if address == np.uintp(0):  # a processor looks in vain for a page that does not exist, each time
        return
    for offset in range(0, length, _LINE):
        prefetch(np.uintp(np.uintp(address) + np.uintp(offset)))


@kernel
def expect_place(r: Radio, place: int) -> None:
    """Asks for a place and the first bytes of its packet; -1: for none."""
    if place < 0:
        return
    at = np.uintp(r.places.ctypes.data) + np.uintp(place * r.places.itemsize)
    prefetch(np.uintp(at))
    prefetch(np.uintp(at + np.uintp(_USED - 1)))
    at = np.uintp(r.data.ctypes.data) + np.uintp(place * r.data.shape[1])
    prefetch(np.uintp(at))
    prefetch(np.uintp(at + np.uintp(_LINE)))

"""Loops over one operation on MAVLink packets each, for `benchmarks/packets.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim.messages import GLOBAL_POSITION_INT, decode_global_position_int, encode_global_position_int
from cosim.packets import GOOD, find, pack, unpack
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import send
from cosim_master.network.radio.tables import Radio

__all__ = ["BATCH", "decode_all", "encode_all", "find_all", "route_all"]

BATCH = 100
"""Packets in a buffer."""


@kernel
def encode_all(buffer: NDArray[np.uint8], payload: NDArray[np.uint8], repeat: int) -> int:
    n = 0
    for _ in range(repeat):
        n = 0
        for i in range(BATCH):
            encode_global_position_int(payload, 12345 + i, 473566100, 85496900, 488000, 12500, 150, -220, 10, 9000)
            n = pack(buffer, n, payload, GLOBAL_POSITION_INT, i, 1, 1, 2)
    return n


@kernel
def find_all(buffer: NDArray[np.uint8], n: int, repeat: int) -> int:
    good = 0
    for _ in range(repeat):
        p = 0
        while p < n:
            _, p, status = find(buffer, p, n)
            if status == GOOD:
                good += 1
    return good


@kernel
def decode_all(buffer: NDArray[np.uint8], n: int, payload: NDArray[np.uint8], repeat: int) -> int:
    total = 0
    for _ in range(repeat):
        p = 0
        while p < n:
            start, p, status = find(buffer, p, n)
            if status == GOOD:
                unpack(buffer, start, payload)
                values = decode_global_position_int(payload)
                total += values[0] + values[1] + values[8]
    return total


@kernel
def route_all(
    r: Radio,
    reals: NDArray[np.float64],
    packets: NDArray[np.uint8],
    length: int,
    senders: NDArray[np.int64],
    sink: NDArray[np.uint8],
    repeat: int,
) -> int:
    """Every sender sends a packet, everybody takes what has arrived."""
    received = 0
    for k in range(repeat):
        for i in range(senders.size):
            send(r, reals, 1_000_000 * k, senders[i], packets[i], length)
        for e in range(r.endpoints.size):
            received += deliver(r, 1_000_000 * k, e, sink)
    return received

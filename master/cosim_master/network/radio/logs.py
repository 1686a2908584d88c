"""The log block of the radio, divided into the logs of its nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim_master.network.radio.queues import LOG_HEAD

__all__ = ["STAMP", "divide"]

STAMP = 8
"""Bytes before a packet in a log: microseconds, big-endian."""


@entry
def divide(block: NDArray[np.uint8], epoch: int, ends: NDArray[np.int64], content: NDArray[np.uint8]) -> None:
    """Copies the entries of a log block, in their order, to the logs of their nodes, and those sent to the last log.

    Entries of nodes without a log, which have the largest numbers, are left out, except from the last log.

    Args:
        block: complete entries, as `log_packet` writes them.
        epoch: microseconds that are added to their time.
        ends: (number of logs,); here, the end of each log in `content` is written.
        content: here, the logs are written one after the other; twice as large as the block.
    """
    last = ends.size - 1
    ends[:] = 0
    at = 0
    while at < block.size:
        node, size = _integer(block, at + 8) >> 1, _integer(block, at + 12) + STAMP
        if node < last:
            ends[node] += size
        at += LOG_HEAD - STAMP + size
    begin = 0
    for i in range(last + 1):
        size = ends[i]
        ends[i] = begin
        begin += size
    at = 0
    while at < block.size:
        entry, size = _integer(block, at + 8), _integer(block, at + 12) + STAMP
        time = _integer(block, at) + (_integer(block, at + 4) << 32)
        stamp = epoch + time // 1000
        packet = at + LOG_HEAD
        if entry >> 1 < last:
            ends[entry >> 1] = _copy(block, packet, size - STAMP, stamp, content, ends[entry >> 1])
        if entry & 1:
            ends[last] = _copy(block, packet, size - STAMP, stamp, content, ends[last])
        at = packet + size - STAMP


@kernel
def _integer(block: NDArray[np.uint8], at: int) -> int:
    """Returns four bytes, little-endian, without sign."""
    value = 0
    for i in range(4):
        value |= int(block[at + i]) << 8 * i
    return value


@kernel
def _copy(block: NDArray[np.uint8], packet: int, length: int, stamp: int, content: NDArray[np.uint8], at: int) -> int:
    """Writes a stamp and a packet; returns the end."""
    for i in range(STAMP):
        content[at + i] = (stamp >> 8 * (STAMP - 1 - i)) & 0xFF
    for i in range(length):
        content[at + STAMP + i] = block[packet + i]
    return at + STAMP + length

"""The log block of the radio is divided into the logs of its nodes."""

from __future__ import annotations

import struct

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.network.radio.logs import divide

NODES = 3
PACKETS = st.tuples(
    st.integers(0, 2**62),  # ns
    st.integers(0, NODES + 1),  # the last two have no log
    st.booleans(),
    st.binary(max_size=280),
)


@given(st.lists(PACKETS, max_size=30), st.sampled_from([0, 1_735_689_600_000_000]))
def test_each_log_has_its_packets_in_their_order(packets: list[tuple[int, int, bool, bytes]], epoch: int) -> None:
    block = b"".join(struct.pack("<qii", t, 2 * node + sent, len(one)) + one for t, node, sent, one in packets)
    logs = [b""] * (NODES + 1)
    for t, node, sent, one in packets:
        entry = struct.pack(">Q", epoch + t // 1000) + one
        if node < NODES:
            logs[node] += entry
        if sent:
            logs[-1] += entry
    given_block = np.frombuffer(block, np.uint8)  # not writable, as that of an observer
    ends, content = np.full(NODES + 1, -1, np.int64), np.full(2 * len(block), 7, np.uint8)
    divide(given_block, epoch, ends, content)
    assert ends.tolist() == np.cumsum([len(log) for log in logs]).tolist()
    assert content[: ends[-1]].tobytes() == b"".join(logs)
    assert (content[ends[-1] :] == 7).all()

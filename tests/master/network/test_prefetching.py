"""Memory of packets is asked for ahead: nothing is changed by it, whether or not there is such memory."""

from __future__ import annotations

import numpy as np

from cosim.kernel import kernel
from cosim_master.network.radio.prefetching import expect_bytes, expect_place
from cosim_master.network.radio.tables import Radio
from tests.master.network.test_radio import Air


@kernel
def _ask(r: Radio, address: int, place: int) -> None:
    expect_bytes(np.uintp(address), 300)
    expect_place(r, place)


def test_a_place_and_memory_that_do_not_exist_are_no_fault() -> None:
    air = Air({"a": ["a.autopilot"], "b": ["b.autopilot"]})
    before = [np.array(array) for array in air.radio]
    for address, place in ((0, -1), (1, 0), (air.radio.data.ctypes.data, 1 << 30), (1 << 46, air.radio.places.size)):
        _ask(air.radio, address, place)
    for array, was in zip(air.radio, before, strict=True):
        assert array.tobytes() == was.tobytes()

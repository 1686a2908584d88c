"""A slice of the packet fuzz; `python -m tests.master.fuzz.packet_fuzz` does as many as wanted."""

from __future__ import annotations

import pytest

from tests.master.fuzz.packet_fuzz import Fuzz, good


@pytest.mark.parametrize("seed", [1, 2])
def test_mutated_packets_are_sorted_as_pymavlink_sorts_them(seed: int) -> None:
    fuzz = Fuzz(seed)
    while fuzz.packets < 4000:
        fuzz.block()
    assert 0.2 < fuzz.taken / fuzz.packets < 0.8
    assert min(fuzz.maker.mutations.values()) > 200


def test_packets_without_mutations_are_all_good() -> None:
    maker = Fuzz(3).maker
    packets = [maker.packet() for _ in range(300)]
    assert good(b"".join(packets)) == packets

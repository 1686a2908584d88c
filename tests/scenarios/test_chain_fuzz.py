"""A slice of the fuzz of router, autopilot and agent in one run; `python -m tests.scenarios.chain_fuzz` does more."""

from __future__ import annotations

import pytest

from tests.scenarios.chain_fuzz import Chain


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_packets_change_nothing_and_are_counted(seed: int) -> None:
    chain = Chain(seed)
    while chain.counts["packets"] < 3000:
        chain.block()
    assert chain.counts["good"] > 150
    for what in ("malformed", "refused", "delivered", "compared", "said"):
        assert chain.counts[what] > 50, what

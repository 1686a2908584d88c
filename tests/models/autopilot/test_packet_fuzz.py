"""A slice of the fuzzing that `python -m benchmarks.fuzz` does with a million packets."""

from __future__ import annotations

from benchmarks.fuzz import run
from tests.models.shipped_kernels import kernels


def test_mutated_packets_break_nothing() -> None:
    counts = run(4000, seed=7, kernels=kernels)
    assert counts["packets"] == 4000
    assert counts["good"] > 150
    assert counts["compared"] > 100
    assert counts["said"] > 50

"""A share of the fuzzing of files; `python -m tests.master.fuzz.file_fuzz` runs all of it."""

from __future__ import annotations

from tests.master.fuzz.file_fuzz import fuzz


def test_a_share_of_the_fuzzing() -> None:
    counts, _, findings = fuzz(200, seed=2, kinds=("description", "fmu", "dialect", "key"))
    assert findings == []
    assert counts["description: accepted"] > 10 and counts["description: refused"] > 10
    assert counts["fmu: refused"] > 10 and counts["dialect: accepted"] > 10

"""What a checkpoint says of a run that is another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.results.storage.checkpoint_folder import Checkpoint, Identity, Position, find

MINE = Identity("digest", {"a": "1"}, start=0, base=2_500_000, steps=12_000, every=5, seed=7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"system": "another"}, "the system's documents must be what they were"),
        ({"input": "another"}, "the file of --input must be what it was"),
        ({"fmus": {"a": "2"}}, "a is another FMU than it was"),
        ({"start": 10**9, "steps": 11_600}, "the start time must be what it was (0 s), now it is 1 s"),
        ({"steps": 8_000}, "the stop time must be what it was (30 s), now it is 20 s"),
        ({"every": 40}, "the recording interval must be what it was (0.0125 s), now it is 0.1 s"),
        ({"seed": 8}, "the seed of the radio must be what it was (7), now it is 8"),
        ({"per_ns": 3}, "the tick of time must be what it was (1e-09 s), now it is 3.33333333e-10 s"),
    ],
)
def test_a_run_that_is_another(change: dict[str, Any], said: str) -> None:
    one = Checkpoint(Path("run/checkpoints/28"), Path("run"), 11_200, 28.0, MINE, Position(), {}, (), {}, None, {}, ())
    one.check(MINE)
    with pytest.raises(SystemDescriptionError) as caught:
        one.check(replace(MINE, **change))
    assert str(caught.value).splitlines()[0] == f"run/checkpoints/28: {said}"


def test_a_run_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError, match=rf"there is no folder {tmp_path}/run; write RUN@TIME"):
        find(f"{tmp_path / 'run'}@5")
    (tmp_path / "run").mkdir()
    with pytest.raises(SystemDescriptionError, match=r"run has no checkpoint at 5 s; there are: none \(run with"):
        find(f"{tmp_path / 'run'}@5")

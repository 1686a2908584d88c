"""Flights on ArduCopter's own physics: ours within 10 % of the recorded ones (`python -m benchmarks.fidelity`)."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.fidelity import compare, fly, read
from tests.models.copter import RECORDINGS


@pytest.mark.slow
@pytest.mark.parametrize("name", ["x_north_5m", "x_north_20m", "x_east_3mps_10m", "x_east_noyaw_10m", "x_up_3m"])
def test_moves_on_its_own_physics(name: str) -> None:
    flight = read(RECORDINGS / f"{name}.csv.gz")
    found = compare(flight, fly(flight, {}))
    for figure in ("t50", "t90", "vmax"):
        theirs, ours = found[figure]
        assert ours == pytest.approx(theirs, rel=0.1), figure
    assert found["rms"][1] < 0.25
    assert found["end"][1] < 0.1


@pytest.mark.slow
def test_a_takeoff_on_its_own_physics() -> None:
    flight = read(RECORDINGS / "x_takeoff_10m.csv.gz")
    found = compare(flight, fly(flight, {}))
    for figure in ("to 5 m", "to 9 m"):
        theirs, ours = found[figure]
        assert ours == pytest.approx(theirs, abs=0.2), figure


@pytest.mark.parametrize(
    ("content", "word"),
    [("", "JSON"), ("t,n\n", "JSON"), ('# {"target": [1, 2, 3]}\nt,n,e,d\n0,0,0,0\n', "vn")],
)
def test_files_that_are_no_flights(tmp_path: Path, content: str, word: str) -> None:
    file = tmp_path / "flight.csv"
    file.write_text(content)
    with pytest.raises(ValueError, match=word):
        read(file)

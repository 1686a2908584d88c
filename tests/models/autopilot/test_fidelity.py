"""Flights on ArduCopter's own physics: ours within 10 % of the recorded ones (`python -m benchmarks.fidelity`)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import ladder, record
from benchmarks.fidelity import compare, fly, read
from benchmarks.record import Move, parse
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["json_30_0_0", "json_-30_0_0_at_5", "json_0_-10_4_at_2", "json_5_5_-4", "json_0_0_5"])
def test_moves_that_nothing_was_adjusted_to(name: str) -> None:
    """Long, diagonal, up and down, and with DO_CHANGE_SPEED; recorded with `benchmarks.record`."""
    flight = read(RECORDINGS / f"{name}.csv.gz")
    found = compare(flight, fly(flight, {}))
    for figure in ("t50", "t90", "vmax"):
        theirs, ours = found[figure]
        assert ours == pytest.approx(theirs, rel=0.03), figure
    assert found["rms"][1] < 0.12
    assert found["end"][1] < 0.02


@pytest.mark.slow
def test_the_ladder(tmp_path: Path) -> None:
    """Each rung down is farther from ArduCopter; the moves of the table in docs/fidelity.md."""
    names = ("json_30_0_0", "json_north_5m", "x_north_20m")
    ladder.main([*(str(RECORDINGS / f"{name}.csv.gz") for name in names), "--json", str(tmp_path / "ladder.json")])
    written = json.loads((tmp_path / "ladder.json").read_text())
    assert written["benchmark"] == "ladder"
    rows = {(row["move"], row["rung"]): row for row in written["rows"]}
    assert list(rows) == [(name, rung) for name in names for rung in ladder.RUNGS]
    for name in names:
        rms = [rows[name, rung]["rms_arducopter"] for rung in ladder.RUNGS]
        assert rms[0] == 0.0 and rms == sorted(rms)
        assert rows[name, "6-DoF"]["rms_drone"] == 0.0
        assert rows[name, "6-DoF"]["rms_arducopter"] < 0.12
        assert rows[name, "linear"]["rms_drone"] < 0.5
        assert 0.15 < rows[name, "point mass"]["rms_drone"] < 1.0
        early = rows[name, "6-DoF"]["t50"] - rows[name, "point mass"]["t50"]
        assert early == pytest.approx(0.27, abs=0.08)  # it need not lean first


def test_the_distance_of_two_paths() -> None:
    times = np.array([0.0, 1.0, 2.0])
    still, gone = np.zeros((3, 3)), np.column_stack([times, np.zeros(3), np.zeros(3)])
    assert ladder.gap((times, gone), (times, still), times) == pytest.approx(((5.0 / 3.0) ** 0.5, 2.0))
    assert ladder.gap((times, gone), (times, still), np.array([0.5])) == pytest.approx((0.5, 0.5))


def test_take_offs_are_no_moves(capsys: pytest.CaptureFixture[str]) -> None:
    ladder.main([str(RECORDINGS / "x_takeoff_10m.csv.gz")])
    assert "x_takeoff" not in capsys.readouterr().out


def test_what_is_recorded_is_what_is_read(tmp_path: Path) -> None:
    time = np.arange(0.0, 0.2, 0.02)
    rows = np.column_stack([time + 70.0, *(i + time for i in range(6)), *np.tile([[0.0], [0.0], [0.0], [1.0]], 10)])
    desired = np.column_stack([time + 70.0, time, 2 * time, 3 * time])
    head = {"target": [1.0, 2.0, -10.0], "sent": 69.99, "speed": 4.0}
    file = tmp_path / f"{parse('1,0,-2.5@4').name}.csv"
    record.write(file, head, rows, desired)
    flight = read(file)
    assert (flight.name, flight.speed, flight.body) == ("json_1_0_-2.5_at_4", 4.0, "json")
    assert flight.target == pytest.approx([1.0, 2.0, -10.0])
    for i, name in enumerate(("t", "n", "e", "d", "vn", "ve", "vd")):
        assert flight.real[name] == pytest.approx(time + max(0, i - 1), abs=1e-5)
    assert np.abs(flight.real["yaw"]) == pytest.approx(180.0)
    assert flight.real["des_d"] == pytest.approx(3 * time, abs=1e-5)


def test_moves_are_three_numbers_and_perhaps_a_speed() -> None:
    assert parse("7,0,0") == Move(7.0, 0.0, 0.0)
    assert parse("-6,8,-3@2.5") == Move(-6.0, 8.0, -3.0, 2.5)
    for wrong in ("7", "7,0", "7,0,0,0", "a,b,c", "1,2,3@fast"):
        with pytest.raises(ValueError):
            parse(wrong)


@pytest.mark.parametrize(
    ("content", "word"),
    [("", "JSON"), ("t,n\n", "JSON"), ('# {"target": [1, 2, 3]}\nt,n,e,d\n0,0,0,0\n', "vn")],
)
def test_files_that_are_no_flights(tmp_path: Path, content: str, word: str) -> None:
    file = tmp_path / "flight.csv"
    file.write_text(content)
    with pytest.raises(ValueError, match=word):
        read(file)

"""Flights on ArduCopter's own physics: ours within 10 % of the recorded ones (`python -m benchmarks.fidelity`)."""

from __future__ import annotations

import gzip
import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from benchmarks import fidelity, ladder, record, repeats
from benchmarks.fidelity import compare, fly
from benchmarks.flights import Flight, body_of, kind_of, read
from benchmarks.record import parse
from tests.models.copter import GUIDED, LAND, RECORDED_AUTOPILOT, RECORDINGS, Copter, preset

FAITHFUL = {
    "x_north_5m": 0.05,
    "x_north_20m": 0.05,
    "x_land": 0.03,
    "x_rtl": 0.1,
    "x_takeoff": 0.1,
    "x_velocity_10mps": 0.06,
    "x_attitude": 0.08,
    "x_acceleration": 0.05,
    "x_mission_square": 0.1,
    "x_mission_in_the_air": 0.1,
    "x_rtl_8mps": 0.1,
    "x_fence_rtl": 0.1,
    "json_land": 0.03,
    "json_rtl": 0.05,
    "json_rtl_8mps": 0.05,
    "json_mission_square": 0.05,
    "json_mission_in_the_air": 0.05,
    "json_battery_low": 0.05,
    "json_takeoff_idling": 0.05,
    "json_velocity_3mps": 0.03,
    "json_brake_8mps": 0.05,
    "json_fence_avoided": 0.05,
    "json_fence_brake": 0.1,
    "json_mission_line": 0.05,
    "json_mission_spline": 0.05,
    "x_mission_spline_in_the_air": 0.1,
}
"""Flights, and the rms [m] of the distance from ArduCopter that a change of ours must not exceed."""


@cache
def recorded_as(name: str) -> Flight:
    """One of the recorded flights, read once."""
    return read(RECORDINGS / f"{name}.csv.gz")


@pytest.mark.slow
@pytest.mark.parametrize("name", FAITHFUL)
def test_flights_beside_the_real_one(name: str) -> None:
    flight = recorded_as(name)
    found = compare(flight, fly(flight, {}))
    assert found["rms"][1] < FAITHFUL[name]
    for figure in ("t50", "t90", "s50", "s90", "to 5 m", "vmax"):
        if figure in found:
            theirs, ours = found[figure]
            assert ours == pytest.approx(theirs, rel=0.05, abs=0.15), figure


@pytest.mark.slow
@pytest.mark.parametrize("name", ["json_30_0_0", "json_-30_0_0_at_5", "json_0_-10_4_at_2", "json_5_5_-4", "json_0_0_5"])
def test_moves_that_nothing_was_adjusted_to(name: str) -> None:
    """Long, diagonal, up and down, and with DO_CHANGE_SPEED; recorded with `benchmarks.record`."""
    flight = recorded_as(name)
    found = compare(flight, fly(flight, {}))
    for figure in ("t50", "t90", "vmax"):
        theirs, ours = found[figure]
        assert ours == pytest.approx(theirs, rel=0.03), figure
    assert found["rms"][1] < 0.03
    assert found["end"][1] == pytest.approx(found["end"][0], abs=0.03)
    true = compare(flight, fly(flight, {}, true=True), true=True)
    assert true["rms"][1] < 0.12
    assert true["end"][1] < 0.02


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
    ladder.main([str(RECORDINGS / "x_takeoff.csv.gz")])
    assert "x_takeoff" not in capsys.readouterr().out


def test_what_is_recorded_is_what_is_read(tmp_path: Path) -> None:
    time = np.arange(0.0, 0.4, 0.04)
    rows = np.column_stack([time, *(i + time for i in range(6)), 180.0 - time, *((i + 1) * time for i in range(12))])
    name, head = parse("1,0,-2.5@4")
    file = tmp_path / f"json_{name}.csv.gz"
    record.write(file, head, rows)
    flight = read(file)
    assert (flight.name, flight.speed, flight.body, flight.kind) == ("json_1_0_-2.5_at_4", 4.0, "json", "move")
    assert flight.target == pytest.approx([1.0, 0.0, -12.5])
    for i, column in enumerate(("t", "n", "e", "d", "vn", "ve", "vd", "yaw", "des_n", "des_e", "des_d")):
        assert flight.real[column] == pytest.approx(rows[:, i], abs=5e-4)
    assert flight.errors == pytest.approx(rows[:, 11:], abs=5e-4)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """From degrees."""
    x, y, z, w = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_quat()
    return w, x, y, z


def test_what_was_flown_is_taken_from_the_motion_or_from_the_log(tmp_path: Path) -> None:
    """A log of two seconds: the truth at 25 Hz from the command on, by either way."""
    log = object.__new__(record.Log)
    times = np.arange(10.0, 12.0, 0.01)
    desired = [(t, 2.0 * t) for t in times]
    log.rows = {
        "SIM2": [(t, t, -t, 0.5 * t, 1.0, -1.0, 0.5) for t in times],
        "SIM": [
            (t, 0.0, 0.0, (yaw := (359.0 + 10.0 * (t - 10.0)) % 360.0), 0.0, 0.0, 0.0, *quaternion(0.0, 0.0, yaw))
            for t in times
        ],
        "XKQ": [(t, 0, *quaternion(0.5, -0.5, 1.0 + 10.0 * (t - 10.0))) for t in times[::10]],
        "XKF1": [(t, 0, 0.0, 0.0, 0.0, 1.1, -1.0, 0.4, 0.0, t + 0.2, 0.3 - t, 0.5 * t) for t in times[::10]],
        **{kind: [(at, 0.0, value) for at, value in desired] for kind in ("PSCN", "PSCE", "PSCD")},
    }
    rows = record.flown(log, None, 10.5, 1.0, 0.2)
    assert rows[:6, 0] == pytest.approx([-0.2, -0.16, -0.12, -0.08, -0.04, 0.0])
    rows = rows[5:]
    for row in rows:
        assert row[11:] == pytest.approx([0.2, 0.3, 0.0, 0.1, 0.0, -0.1, 0.5, -0.5, 2.0], abs=1e-9)
    assert len(rows) == 25
    assert rows[:, 1] == pytest.approx(10.5 + rows[:, 0])
    assert rows[-1, 4:7] == pytest.approx([1.0, -1.0, 0.5])
    assert rows[0, 7] == pytest.approx(364.0)
    assert rows[:, 10] == pytest.approx(2.0 * (10.5 + rows[:, 0]))
    turned = [math.cos(math.radians(15.0)), 0.0, 0.0, math.sin(math.radians(15.0))]
    truth = np.array([[t, t, 0.0, 0.0, 1.0, 0.0, 0.0, *turned] for t in times])
    rows = record.flown(log, truth, 10.5, 1.0)
    assert rows[:, 1] == pytest.approx(10.5 + rows[:, 0])
    assert rows[:, 7] == pytest.approx(30.0)


def test_rows_before_the_command(tmp_path: Path) -> None:
    """They are errors only: the flight begins with its command, and ours errs by them before it."""
    time = np.arange(-4.0, 6.01, 0.04)
    shift = np.where(time < -1.0, 0.5, 0.0)
    zeros = np.zeros_like(time)
    table = np.column_stack([time, *[zeros] * 10, shift, *[zeros] * 8])
    head = {"type": 4, "vel": [0.0, 0.0, 0.0], "start": [0.0, 0.0, -10.0], "home": [0.25, -0.5, 0.125]}
    record.write(tmp_path / "json_held.csv.gz", head, table)
    flight = read(tmp_path / "json_held.csv.gz")
    assert flight.real["t"][0] == 0.0
    assert len(flight.real["t"]) == 151
    assert flight.before is not None
    assert flight.before.shape == (100, 10)
    assert flight.before[:, 0] == pytest.approx(np.arange(-4.0, -0.01, 0.04), abs=1e-9)
    rows = fly(flight, {})
    assert 0.1 < rows[0, 1] < 0.45  # since it senses itself 0.5 m behind its place, for 1 s
    assert rows[0, 4] > 0.1
    assert np.abs(rows[-1, 4:7]).max() < 0.02


def test_where_home_was() -> None:
    log = object.__new__(record.Log)
    log.rows = {
        "ORGN": [
            (40.0, 0, -35.363262, 149.165237, 584.0),
            (40.0, 1, -35.363262, 149.165237, 584.0),
            (46.0, 0, -35.363262, 149.165237, 584.0),
            (46.0, 1, -35.3632621, 149.1652371, 583.98),
        ]
    }
    assert log.home() == pytest.approx([-0.011132, 0.009078, -0.02], abs=1e-6)


def test_which_flights_err() -> None:
    low, weak, rtl = (recorded_as(f"x_{name}") for name in ("battery_low", "weak_motor", "rtl"))
    assert fidelity.errs(low, False) and fidelity.errs(rtl, False)
    assert not fidelity.errs(weak, False)
    assert not fidelity.errs(rtl, True)


def test_a_take_off_has_figures_up_to_nine_tenths_of_its_height() -> None:
    """Whether it reaches its very height is noise."""
    time = np.array([0.0, 1.0, 2.0, 3.0])
    position = np.column_stack([np.zeros(4), np.zeros(4), [0.0, -0.5, -4.0, -5.01]])
    found = fidelity.upwards(time, position, 5.0)
    assert list(found) == ["to 0.05 m", "to 0.5 m", "highest", "vmax"]
    assert found["to 0.5 m"] == 1.0
    assert list(fidelity.upwards(time, position, 10.0))[:4] == ["to 0.05 m", "to 0.5 m", "to 5 m", "to 9 m"]


def test_how_long_a_velocity_was_flown_before() -> None:
    log = object.__new__(record.Log)
    log.rows = {"GUIP": [(20.0, 4), (50.0, 2), (60.0, 4), (60.1, 4), (67.9, 4)]}
    assert log.hurried(68.0) == 60.0


def test_ours_errs_as_the_estimate_did(tmp_path: Path) -> None:
    """It holds the place that it senses: its true place is off by the error, by as much the other way."""
    time = np.arange(0.0, 12.01, 0.04)
    drift = 0.1 * np.clip(time - 2.0, 0.0, 5.0)
    hurry = np.where((time > 2.0) & (time < 7.0), 0.1, 0.0)
    zeros = np.zeros_like(time)
    table = np.column_stack([time, *[zeros] * 10, 3.0 + drift, zeros, -drift, hurry, zeros, -hurry, *[zeros] * 3])
    record.write(tmp_path / "json_held.csv.gz", {"type": 4, "vel": [0.0, 0.0, 0.0], "start": [0.0, 0.0, -10.0]}, table)
    flight = read(tmp_path / "json_held.csv.gz")
    rows = fly(flight, {})
    assert rows[-1, 1:4] - rows[0, 1:4] == pytest.approx([-0.5, 0.0, 0.5], abs=0.02)
    true = fly(flight, {}, true=True)
    assert true[-1, 1:4] == pytest.approx(true[0, 1:4], abs=0.01)


def test_when_a_command_was_taken() -> None:
    log = object.__new__(record.Log)
    command = (0, 0, 0, 0, 0)
    log.rows = {
        "GUIP": [(50.0, 2), (60.0, 4), (65.0, 4)],
        "GUIA": [(70.0, 0)],
        "MODE": [(40.0, 4, 4), (80.0, 6, 6), (81.0, 3, 3)],
        "PARM": [(30.0, "SIM_WIND_SPD", 0.0), (90.0, "SIM_WIND_SPD", 8.0)],
        "MAVC": [(41.0, *command, 400), (42.5, *command, 22), (43.0, *command, 300)],
    }
    for head, sent, expected in (
        ({"type": 4, "vel": [1, 0, 0]}, 60.1, 60.0),
        ({"target": [1, 0, -10]}, 49.0, 50.0),
        ({"type": 6, "attitude": [0, 0, 0]}, 69.0, 70.0),
        ({"mode": 6}, 79.0, 80.0),
        ({"mission": [], "start": [0, 0, -10]}, 79.0, 81.0),
        ({"mission": []}, 42.9, 43.0),
        ({"set": {"SIM_WIND_SPD": 8}}, 89.0, 90.0),
        ({}, 42.0, 42.5),
    ):
        assert log.taken(head, sent) == expected
    assert log.taken({"type": 4, "vel": [1, 0, 0]}, 60.0, last=True) == 65.0
    assert log.armed() == 41.0
    with pytest.raises(ValueError, match="no mode after 82 s"):
        log.taken({"mode": 6}, 82.0)


def test_a_folder_with_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="0 logs instead of one"):
        record.Log(tmp_path)


def test_moves_are_three_numbers_and_perhaps_a_speed() -> None:
    assert parse("7,0,0") == ("7_0_0", {"target": [7.0, 0.0, -10.0], "start": [0.0, 0.0, -10.0]})
    assert parse("-6,8,-3@2.5")[1]["speed"] == 2.5
    assert parse('rtl={"mode": 6}') == ("rtl", {"mode": 6})
    for wrong in ("7", "7,0", "7,0,0,0", "a,b,c", "1,2,3@fast", "rtl=6,"):
        with pytest.raises(ValueError):
            parse(wrong)


def test_every_flight_of_the_list_is_of_a_known_kind() -> None:
    flights = json.loads((RECORDINGS / "flights.json").read_text())
    kinds = {kind_of(head) for head in flights.values()}
    assert kinds == {"take-off", "move", "set-point", "mode", "mission", "failure"}
    for path in RECORDINGS.glob("*.csv.gz"):
        assert recorded_as(path.name.removesuffix(".csv.gz")).kind in kinds


@pytest.mark.parametrize(
    ("content", "word"),
    [("", "JSON"), ("t,n\n", "JSON"), ('# {"target": [1, 2, 3]}\nt,n,e,d\n0,0,0,0\n', "vn")],
)
def test_files_that_are_no_flights(tmp_path: Path, content: str, word: str) -> None:
    file = tmp_path / "flight.csv"
    file.write_text(content)
    with pytest.raises(ValueError, match=word):
        read(file)


def recorded(path: Path, head: dict[str, Any], rows: np.ndarray[Any, Any]) -> Path:
    """A flight of ours as a file of a recorded one, at 50 Hz."""
    rows = rows[::8]
    t = rows[:, :1] - rows[0, 0]
    table = np.hstack([t, rows[:, 1:7], np.zeros_like(t), rows[:, 7:10]])
    names = "t,n,e,d,vn,ve,vd,yaw,des_n,des_e,des_d"
    np.savetxt(path, table, delimiter=",", header=f"# {json.dumps(head)}\n{names}", comments="")
    return path


def in_the_air() -> Copter:
    """As `fly` begins, on the external body."""
    copter = Copter(vehicle=preset("ardupilot_json"), autopilot=RECORDED_AUTOPILOT, direct=True)
    copter.run(3.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.run(1.8625)
    copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)
    copter.run(25.0)
    return copter


def flown(kind: str) -> tuple[dict[str, Any], np.ndarray[Any, Any]]:
    """The first line and the flight of a kind of command."""
    copter, rows = in_the_air(), []
    if kind == "land":
        copter.go(4.0, 0.0, -10.0)
        copter.run(25.0)
        copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, LAND)
        return {"mode": LAND, "start": [4.0, 0.0, -10.0]}, copter.run(30.0)
    heads: dict[str, dict[str, Any]] = {
        "velocity": {"type": 4, "vel": [3.0, 1.0, 0.0], "lasts": 3.9},
        "acceleration": {"type": 5, "accel": [0.5, 0.0, 0.0]},
        "attitude": {"type": 6, "attitude": [0.0, -5.0, 0.0], "climb": 1.0},
    }
    for i in range(80):
        if kind == "velocity" and i < 40:
            copter.go(0.0, 0.0, 0.0, 0xDC7, vx=3.0, vy=1.0)
        elif kind == "acceleration":
            copter.go(0.0, 0.0, 0.0, 0xC3F, afx=0.5)
        elif kind == "attitude":
            q = [math.cos(math.radians(2.5)), 0.0, -math.sin(math.radians(2.5)), 0.0]
            copter.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, q, 0, 0, 0, 0.7))
        rows.append(copter.run(0.1))
    return heads[kind], np.concatenate(rows)


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "attitude", "land"])
def test_every_command_of_a_recorded_flight_is_flown(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Flights of ours, commanded here, in place of ArduCopter's; then one that is a fifth longer."""
    head, rows = flown(kind)
    path = recorded(tmp_path / f"json_{kind}.csv", head, rows)
    flight = read(path)
    found = compare(flight, fly(flight, {}))
    assert found["rms"][1] < 0.03
    fidelity.main([str(path)])
    *table, again, last = capsys.readouterr().out.splitlines()
    count = len(table) - 2  # without heading and "farthest"
    assert again == f"within what ArduCopter repeats: {count} of {count} rows, rms of 1 flights"
    assert last == f"{count} of {count} rows ok; rms of 1 of 1 flights ok"
    rows = rows.copy()
    rows[:, 1:4] = rows[0, 1:4] + 1.2 * (rows[:, 1:4] - rows[0, 1:4])
    flight = read(recorded(tmp_path / f"json_{kind}_longer.csv", head, rows))
    found = compare(flight, fly(flight, {}))
    assert fidelity.verdict(flight, "rms", *found["rms"]) == "differs"
    assert fidelity.verdict(flight, "farthest away", *found["farthest away"]) == "differs"


def test_verdicts() -> None:
    flight = recorded_as("json_0_0_5")
    for theirs, mine, expected in (
        (10.0, 10.5, "ok"),
        (10.0, 10.6, "differs"),
        (0.5, 0.59, "ok"),
        (math.nan, 1.0, "missing"),
        (math.nan, math.nan, "ok"),
    ):
        assert fidelity.verdict(flight, "t50", theirs, mine) == expected
    assert fidelity.verdict(flight, "farthest", 0.0, 9.0) == ""


def test_what_arducopter_repeats() -> None:
    spread = {"rms": [0.2, 0.35, 0.1], "figures": {"t50": [10.0, 11.0, 10.4], "at rest": [None, 5.0], "t90": [None]}}
    for name, mine, expected in (
        ("t50", 9.6, True),  # 5 % below the least
        ("t50", 9.4, False),
        ("t50", 11.5, True),
        ("t50", 11.6, False),
        ("t50", math.nan, False),
        ("at rest", math.nan, True),
        ("at rest", 5.2, True),
        ("t90", 5.2, False),
        ("rms", 0.35, True),
        ("rms", 0.36, False),
        ("farthest", 0.1, False),
    ):
        assert fidelity.repeats(name, mine, spread) is expected, (name, mine)
    assert not fidelity.repeats("rms", 0.01, None)


def test_how_far_recordings_are_from_each_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two that move at 1.0 and 1.1 m/s, from elsewhere: half of a gap that grows to 1 m has an rms of 1/sqrt(3) m."""
    time = np.arange(0.0, 10.01, 0.04)
    zeros = np.zeros_like(time)
    for i, speed in enumerate((1.0, 1.1)):
        table = np.column_stack([time, 5.0 * i + speed * time, zeros, zeros, zeros + speed, *[zeros] * 15])
        record.write(tmp_path / f"json_{i}.csv.gz", {"mode": 17}, table)
    flights = [read(tmp_path / f"json_{i}.csv.gz") for i in range(2)]
    found = repeats.spread([*flights, flights[0]])
    assert found["rms"] == pytest.approx([3.0**-0.5, 0.0, 3.0**-0.5], abs=2e-3)
    assert found["figures"]["vmax"] == [1.0, 1.1, 1.0]
    assert found["figures"]["farthest away"] == [10.0, 11.0, 10.0]


def test_recordings_of_the_same_flights_are_gathered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder that holds the project's own recording adds none; one that was flown otherwise does.

    Three of the project's recordings, of which two were flown once only.
    """
    names = ("json_0_0_5", "x_up_3m", "x_land")
    (own := tmp_path / "own").mkdir()
    for name in names:
        (own / f"{name}.csv.gz").symlink_to(RECORDINGS / f"{name}.csv.gz")
    monkeypatch.setattr(repeats, "RECORDINGS", own)
    first = RECORDINGS / "x_up_3m.csv.gz"
    lines = gzip.decompress(first.read_bytes()).decode().splitlines()
    for name, shift in (("same", 0.0), ("other", 0.02)):
        rows = np.array([[float(x) for x in line.split(",")] for line in lines[2:]])
        rows[:, 1] += shift * np.clip(rows[:, 0], 0.0, 1.0)
        (tmp_path / name).mkdir()
        record.write(tmp_path / name / first.name, json.loads(lines[0][2:]), rows)
    out = tmp_path / "repeats.json"
    out.write_text('{"another": {"rms": [1.5], "figures": {"t50": [1.0, 2.0]}}}')
    repeats.main([str(tmp_path / "same"), str(tmp_path / "other"), "--out", str(out)])
    written = json.loads(out.read_text())
    assert list(written) == ["another", "x_up_3m"]
    assert written["another"]["rms"] == [1.5]
    assert written["x_up_3m"]["rms"] == [pytest.approx(0.02, abs=2e-3)]
    assert len(written["x_up_3m"]["figures"]["t50"]) == 2
    assert written["x_up_3m"]["ours"] == [pytest.approx(0.01, abs=0.01), pytest.approx(0.02, abs=0.015)]
    assert "x_up_3m" in (said := capsys.readouterr().out)
    assert "2 recordings" in said and "within 0.1 m of 2" in said


def test_a_flight_that_was_chosen_by_ours_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    fidelity.main([str(RECORDINGS / f"{name}.csv.gz") for name in ("json_mission_in_the_air", "x_up_3m")])
    said = capsys.readouterr().out.splitlines()
    assert said[-2] == "1 of these flights: of several recordings that differ, the one nearest to ours (repeats.json)"
    assert said[-1].endswith("rms of 2 of 2 flights ok")
    fidelity.main([str(RECORDINGS / "x_up_3m.csv.gz")])
    assert "nearest" not in capsys.readouterr().out


def test_the_nearest_of_several_recordings_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three that end 0.4, 0.0 and 0.2 m farther than ArduCopter's, the second becomes the first."""
    lines = gzip.decompress((RECORDINGS / "x_up_3m.csv.gz").read_bytes()).decode().splitlines()
    folders = [tmp_path / name for name in ("kept", "one", "two")]
    for folder, farther in zip(folders, (0.4, 0.0, 0.2), strict=True):
        rows = np.array([[float(x) for x in line.split(",")] for line in lines[2:]])
        rows[:, 1] += farther * np.clip(rows[:, 0], 0.0, 1.0)
        folder.mkdir()
        record.write(folder / "x_up_3m.csv.gz", json.loads(lines[0][2:]), rows)
    wanted = (folders[1] / "x_up_3m.csv.gz").read_bytes()
    monkeypatch.setattr(repeats, "RECORDINGS", folders[0])
    out = tmp_path / "repeats.json"
    repeats.main([*map(str, folders[1:]), "--nearest", "--out", str(out)])
    assert (folders[0] / "x_up_3m.csv.gz").read_bytes() == wanted
    found = json.loads(out.read_text())["x_up_3m"]
    assert found["ours"] == sorted(found["ours"]) and found["ours"][0] < 0.05 < 0.15 < found["ours"][1]
    assert found["rms"] == [pytest.approx(farther, abs=0.02) for farther in (0.2, 0.4, 0.2)]


def test_a_flight_that_arducopter_does_not_repeat_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A flight of ours, a fifth longer: it differs, unless ArduCopter is known to differ from itself by as much."""
    head, rows = flown("attitude")
    rows[:, 1:4] = rows[0, 1:4] + 1.2 * (rows[:, 1:4] - rows[0, 1:4])
    path = recorded(tmp_path / "json_longer.csv", head, rows)
    fidelity.main([str(path)])
    *_, again, last = capsys.readouterr().out.splitlines()
    count = int(last.split(" of ")[1].split()[0])
    strict = int(last.split()[0])
    assert strict < count
    assert last == f"{strict} of {count} rows ok; rms of 0 of 1 flights ok"
    assert again == f"within what ArduCopter repeats: {strict} of {count} rows, rms of 0 flights"
    figures = {name: [value, 0.7 * value] for name, value in fidelity.figures_of(read(path)).items()}
    (tmp_path / "known.json").write_text(json.dumps({"json_longer": {"rms": [9.0], "figures": figures}}))
    monkeypatch.setattr(fidelity, "REPEATS", tmp_path / "known.json")
    fidelity.main([str(path)])
    *table, again, last = capsys.readouterr().out.splitlines()
    assert last == f"{strict} of {count} rows ok; rms of 0 of 1 flights ok"
    assert again == f"within what ArduCopter repeats: {count} of {count} rows, rms of 1 flights"
    assert sum(line.endswith(" repeats") for line in table) == count - strict


def test_what_is_known_of_repetitions() -> None:
    """Eight flights were recorded nine times: ours is as near to one of them as is asked, not so to all."""
    known = json.loads(fidelity.REPEATS.read_text())
    for name, found in known.items():
        flight = recorded_as(name)
        first = fidelity.figures_of(flight)
        assert set(found["figures"]) == set(first)
        for figure, values in found["figures"].items():
            assert values[0] == (None if math.isnan(first[figure]) else pytest.approx(first[figure], abs=1e-3)), figure
            assert len(found["rms"]) == len(values) * (len(values) - 1) // 2
    nine = {name for name, found in known.items() if len(found["figures"].get("s50", [])) == 9}
    assert nine == {name for name, found in known.items() if found.get("nearest")}
    near = {
        kind: [rms <= fidelity.RMS[body_of(name)] for name in nine for rms in known[name][kind]]
        for kind in ("ours", "rms")
    }
    assert np.mean(near["ours"]) > np.mean(near["rms"])  # whichever is drawn, ours is no farther than ArduCopter's next
    json_ = {"json_battery_low", "json_mission_in_the_air", "json_mission_square", "json_rtl", "json_rtl_8mps"}
    assert nine == json_ | {"x_fence_rtl", "x_mission_in_the_air", "x_rtl_8mps"}
    for name in nine:
        assert max(known[name]["rms"]) > 0.4
        assert known[name]["ours"] == sorted(known[name]["ours"])
        assert known[name]["ours"][0] <= fidelity.RMS[body_of(name)]
    assert max(known["x_rtl_8mps"]["rms"]) == pytest.approx(1.649, abs=0.001)


@pytest.mark.parametrize("head", [{"type": 9}, {"type": 4}, {"type": 6, "vel": [1, 0, 0]}])
def test_commands_that_are_not_known_are_refused(head: dict[str, Any], tmp_path: Path) -> None:
    path = recorded(tmp_path / "json_x.csv", head, np.zeros((16, 10)))
    with pytest.raises(ValueError, match="there are 2"):
        read(path)

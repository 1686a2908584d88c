"""DataFlash logs, read back by pymavlink's DFReader: values equal to the recording."""

from __future__ import annotations

import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pymavlink.DFReader import DFReader_binary
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from cosim_master import RunOptions, simulate
from cosim_master.cli import app
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export import dataflash
from cosim_master.results.export.contents.dataflash_log import MESSAGES, Log
from cosim_master.results.export.contents.spoken import Spoken
from cosim_master.results.export.formats import FORMATS, export_run
from cosim_master.results.export.options import Options
from cosim_master.results.recording.packet_log import EPOCH
from tests.master.results.export.test_formats import EAST, START

(DATAFLASH,) = (one for one in FORMATS if one.name == "dataflash")
NAME = "drone3.autopilot"


@pytest.fixture(scope="module")
def logged(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """line5 with estimators in the air: folder of the run, and of its logs."""
    folder = tmp_path_factory.mktemp("logged")
    overrides = {"recording.interval": "0.05", "drone*.autopilot.SIM_BATT_CAP_AH": "3.3"}
    options = RunOptions(until=14.0, overrides=overrides, out=folder / "run", record=["*"])
    assert simulate("line5-estimated", options).error is None
    assert export_run(folder / "run", DATAFLASH, folder / "logs", Options()) == []
    return folder / "run", folder / "logs"


@pytest.fixture(scope="module")
def read(logged: tuple[Path, Path]) -> dict[str, list[Any]]:
    reader = DFReader_binary(str(logged[1] / "drone3.bin"))
    found: dict[str, list[Any]] = defaultdict(list)
    while (message := reader.recv_msg()) is not None:
        found[message.get_type()].append(message)
    found["mav_type"] = [reader.mav_type]
    reader.close()
    return found


@pytest.fixture(scope="module")
def signals(logged: tuple[Path, Path]) -> dict[str, np.ndarray[Any, Any]]:
    """Recorded columns of drone 3 from the first step on, arrays together."""
    table = pq.read_table(logged[0] / "signals.parquet")
    found: dict[str, Any] = defaultdict(list)
    for name in table.column_names:
        if name.startswith("drone3."):
            found[name.removeprefix("drone3.").partition("[")[0]].append(table[name].to_numpy().astype(float))
    columns = {name: np.squeeze(np.stack(of, axis=1)) for name, of in found.items()}
    begun = np.abs(columns["autopilot.q"]).sum(axis=1) > 0.5
    return {"time": table["time"].to_numpy()[begun]} | {name: of[begun] for name, of in columns.items()}


def column(messages: list[Any], name: str) -> np.ndarray[Any, Any]:
    return np.array([getattr(one, name) for one in messages])


def test_each_drone_has_a_log_with_all_messages(logged: tuple[Path, Path], read: dict[str, list[Any]]) -> None:
    assert sorted(one.name for one in logged[1].iterdir()) == [f"drone{i}.bin" for i in range(1, 6)]
    assert set(MESSAGES) - set(read) == {"ERR", "ATUN", "ATDE"}  # nothing fails or is tuned
    assert read["mav_type"] == [2]  # a quadrotor, by the first MSG
    definitions = {one.Name: one for one in read["FMT"]}
    assert set(definitions) == set(MESSAGES)
    for name, one in MESSAGES.items():
        assert (definitions[name].Format, definitions[name].Columns) == (one.format, one.labels)
    units = {chr(one.Id): one.Label for one in read["UNIT"]}
    factors = {chr(one.Id): one.Mult for one in read["MULT"]}
    for one in read["FMTU"]:
        assert set(one.UnitIds) <= set(units) and set(one.MultIds) <= set(factors)
    assert read["ATT"][0].fmt.units[1:3] == ["deg", "deg"]
    assert read["RATE"][0].fmt.units[1] == "deg/s"


def test_attitudes_and_rates(read: dict[str, list[Any]], signals: dict[str, np.ndarray[Any, Any]]) -> None:
    att, rate = read["ATT"], read["RATE"]
    assert column(att, "TimeUS").tolist() == np.rint(signals["time"] * 1e6).astype(int).tolist()
    for prefix, name in (("", "q"), ("Des", "attitude_target")):
        turned = Rotation.from_quat(signals[f"autopilot.{name}"][:, [1, 2, 3, 0]]).as_euler("ZYX", degrees=True)
        for i, axis in enumerate(("Yaw", "Pitch", "Roll")):
            off = (column(att, prefix + axis) - turned[:, i] + 180.0) % 360.0 - 180.0
            assert np.abs(off).max() < 1e-4
    for i, axis in enumerate("RPY"):
        assert column(rate, f"{axis}Des") == pytest.approx(np.degrees(signals["autopilot.rate_wanted"][:, i]), rel=1e-6)
        assert column(rate, axis) == pytest.approx(np.degrees(signals["autopilot.gyro"][:, i]), rel=1e-6)
        np.testing.assert_array_equal(
            column(rate, f"{axis}Out"), signals["autopilot.torque"][:, i].astype(np.float32).astype(float)
        )
    assert np.abs(column(rate, "P")).max() > 1.0  # it moves


def test_position_control(read: dict[str, list[Any]], signals: dict[str, np.ndarray[Any, Any]]) -> None:
    for i, axis in enumerate("NED"):
        rows, sign = read[f"PSC{axis}"], -1.0 if axis == "D" else 1.0
        for label, values in {
            "TP": signals["autopilot.desired_position"][:, i],
            "P": sign * signals["autopilot.position_neu"][:, i],
            "DV": signals["autopilot.desired_velocity"][:, i],
            "TV": sign * signals["autopilot.target_velocity_neu"][:, i],
            "V": sign * signals["autopilot.velocity_neu"][:, i],
            "DA": sign * signals["autopilot.desired_acceleration_neu"][:, i],
            "TA": sign * signals["autopilot.target_acceleration_neu"][:, i],
            "A": sign * signals["autopilot.acceleration_neu"][:, i],
        }.items():
            np.testing.assert_array_equal(column(rows, label + axis), values.astype(np.float32).astype(float))
    ctun = read["CTUN"]
    assert column(ctun, "ThH") == pytest.approx(signals["autopilot.throttle_hover"], rel=1e-6)
    assert column(ctun, "CRt") == pytest.approx(100.0 * signals["autopilot.velocity_neu"][:, 2], abs=0.51)
    assert np.isnan(column(ctun, "SAlt")).all()


def test_places_on_earth_and_time(read: dict[str, list[Any]], signals: dict[str, np.ndarray[Any, Any]]) -> None:
    pos, gps = read["POS"], read["GPS"]
    east = signals["autopilot.position_neu"][:, 1]
    scale = (EAST - 149.165237) / 100.0  # degrees per metre
    assert column(pos, "Lng") == pytest.approx(149.165237 + scale * east, abs=1.1e-7)
    up = signals["autopilot.position_neu"][:, 2]
    assert column(pos, "RelOriginAlt") == pytest.approx(up, abs=1e-5)
    assert column(pos, "Alt") == pytest.approx(584.0 + up, abs=1e-3)
    assert len(gps) == pytest.approx(14 * 5, abs=1)
    for one in gps:
        assert one._timestamp == pytest.approx(START + one.TimeUS * 1e-6, abs=2e-3)  # by week and ms of GPS
    assert [(one.Type, one.Alt) for one in read["ORGN"]] == [(0, 584.0), (1, pytest.approx(584.0, abs=1.0))]


def test_sensors_and_estimate(read: dict[str, list[Any]], signals: dict[str, np.ndarray[Any, Any]]) -> None:
    imu, estimate = read["IMU"], read["XKF1"]
    turned = Rotation.from_quat(signals["autopilot.q"][:, [1, 2, 3, 0]])
    felt = turned.inv().apply(signals["autopilot.acceleration_neu"] * (1, 1, -1) - (0, 0, 9.80665))
    for i, axis in enumerate("XYZ"):
        assert column(imu, f"Acc{axis}") == pytest.approx(felt[:, i], abs=1e-5)
    n = len(signals["time"])
    for i, axis in enumerate("NED"):
        place = signals["estimator.position"][:, i]
        assert column(estimate, f"P{axis}")[-n:] == pytest.approx(place, rel=1e-6, abs=1e-6)
        bias = np.degrees(signals["estimator.gyro_offset_frd"][:, i])
        assert column(estimate, f"G{'XYZ'[i]}")[-n:] == pytest.approx(bias, abs=0.0051)
    assert np.abs(column(estimate, "GX")).max() > 0.0


def test_state(read: dict[str, list[Any]], signals: dict[str, np.ndarray[Any, Any]]) -> None:
    assert read["MSG"][0].Message.startswith("ArduCopter")
    assert "Arming motors" in [one.Message for one in read["MSG"]]
    modes, times = signals["autopilot.mode"], signals["time"]
    rows = [0, *(np.flatnonzero(np.diff(modes)) + 1)]
    assert [(one.ModeNum, one.TimeUS) for one in read["MODE"]] == [(modes[i], round(times[i] * 1e6)) for i in rows]
    assert [one.Id for one in read["EV"]] == [10, 28]
    armed = times[np.flatnonzero(signals["autopilot.armed"])[0]]
    assert read["EV"][0].TimeUS == round(armed * 1e6)
    for i in range(4):
        pulses = 1000.0 + 1000.0 * signals["autopilot.motor"][:, i]
        assert column(read["RCOU"], f"C{i + 1}") == pytest.approx(pulses, abs=0.51)
    assert (column(read["RCOU"], "C5") == 0).all()
    parameters = {one.Name: one.Value for one in read["PARM"]}
    assert (parameters["WPNAV_SPEED"], parameters["SYSID_THISMAV"]) == (1000.0, 3.0)
    bat = read["BAT"]
    assert bat[-1].Volt == pytest.approx(signals["autopilot.battery_voltage"][-1], rel=1e-6)
    assert bat[-1].VoltR > bat[-1].Volt
    assert bat[-1].CurrTot == pytest.approx(signals["autopilot.battery_used"][-1], rel=1e-6)
    assert 0 < bat[-1].RemPct < 100


def test_events_of_a_tune_are_those_of_its_texts(
    logged: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = [Spoken(EPOCH * 1000 + t * 10**9, 6, "drone3", text) for t, text in ((9, "AutoTune: Started"), (11, "x"))]
    monkeypatch.setattr(dataflash, "spoken", lambda _: said)
    export_run(logged[0], DATAFLASH, tmp_path, Options())
    events = {}
    for drone in (2, 3):
        reader = DFReader_binary(str(tmp_path / f"drone{drone}.bin"))
        events[drone] = []
        while (message := reader.recv_match(type="EV")) is not None:
            events[drone].append((message.TimeUS, message.Id))
        reader.close()
    assert [event for _, event in events[2]] == [10, 28]
    assert (9_000_000, 30) in events[3] and len(events[3]) == 3


def test_twitches_of_a_tune(logged: tuple[Path, Path], tmp_path: Path) -> None:
    """Written into a copy of the recording: two twitches, of a rate of roll and of the angle of yaw."""
    run = tmp_path / "run"
    shutil.copytree(logged[0], run)
    table = pq.read_table(run / "signals.parquet")
    names, rows = table.column_names, len(table)
    tuned, tuning = np.zeros((rows, 10)), np.zeros((rows, 3))
    tuned[100:150] = 1, 0, 2, 1.0, 0.5, 0.9, 0.11, 0.003, 4.5, 20.0
    tuned[150:] = 2, 3, 4, 0.2, 0.1, 0.21, 0.5, 0.01, 6.0, 2.0
    tuning[90:100] = 1, 0.1, 0.2
    for name, values in (("tuned", tuned), ("tuning", tuning)):
        for i in range(values.shape[1]):
            at = names.index(f"drone3.autopilot.{name}[{i + 1}]")
            table = table.set_column(at, table.schema.field(at), [values[:, i]])
    pq.write_table(table, run / "signals.parquet")
    export_run(run, DATAFLASH, tmp_path / "logs", Options())
    reader = DFReader_binary(str(tmp_path / "logs" / "drone3.bin"))
    found = defaultdict(list)
    while (message := reader.recv_match(type=["ATUN", "ATDE"])) is not None:
        found[message.get_type()].append(message)
    reader.close()
    first, second = found["ATUN"]
    assert (first.Axis, first.TuneStep, second.Axis, second.TuneStep) == (0, 2, 3, 5)  # ArduCopter's ANGLE_P_UP is 5
    degrees = 180.0 / np.pi
    assert (first.Targ, first.Min, first.Max) == pytest.approx((degrees, 0.5 * degrees, 0.9 * degrees), rel=1e-6)
    assert pytest.approx((0.11, 0.003, 4.5)) == (first.RP, first.RD, first.SP)
    assert second.ddt == pytest.approx(200.0 * degrees)
    assert len(found["ATDE"]) == 10
    assert (found["ATDE"][0].Angle, found["ATDE"][0].Rate) == pytest.approx((0.1 * degrees, 0.2 * degrees), rel=1e-6)


def test_failures_become_errors() -> None:
    log = Log()
    log.add("ERR", np.array([2.5, 1.0]), 6, np.array([1, 2]))
    written = b"".join(log.write())
    record = MESSAGES["ERR"].record
    last = np.frombuffer(written[-2 * record.itemsize :], record)
    assert last[["TimeUS", "Subsys", "ECode"]].tolist() == [(1_000_000, 6, 2), (2_500_000, 6, 1)]


def test_a_run_without_inner_values_is_refused(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(CosimError, match="run with --dataflash"):
        export_run(flown, DATAFLASH, tmp_path / "logs", Options())
    assert not (tmp_path / "logs").exists()


def test_run_writes_logs_into_its_folder(fmus: Path, tmp_path: Path) -> None:
    command = ["run", "line5", "--until", "3", "--dataflash", "-o", str(tmp_path / "run")]
    for _ in range(2):  # the second run replaces the first
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, result.output
    reader = DFReader_binary(str(tmp_path / "run" / "dataflash" / "drone5.bin"))
    assert reader.recv_match(type="RATE") is not None
    reader.close()
    assert "drone5.autopilot.rate_wanted[1]" in pq.read_schema(tmp_path / "run" / "signals.parquet").names


def test_a_run_whose_signals_are_chosen_has_no_logs(fmus: Path, tmp_path: Path) -> None:
    chosen = ["--record", "*.position*", "-o", str(tmp_path / "run")]
    result = CliRunner().invoke(app, ["run", "line5", "--until", "1", "--dataflash", *chosen])
    assert result.exit_code == 1
    assert "no autopilot recorded its inner values" in result.output

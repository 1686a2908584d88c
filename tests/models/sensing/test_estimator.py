"""Sensors with noise and the estimator: flights on estimates stay within bounds and repeat bit for bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.random_numbers import normal_pair, threefry
from cosim_models.sensing.estimator import Estimator
from tests.models.copter import MOTION, Copter, H, set_values
from tests.models.shipped_kernels import kernels, part

PERFECT = {
    f"{sensor}_{what}": 0.0
    for sensor, what in (
        *(("gyro", "noise"), ("gyro", "bias"), ("accel", "noise"), ("accel", "bias"), ("gps", "position_noise")),
        *(("gps", "velocity_noise"), ("gps", "drift"), ("barometer", "noise"), ("barometer", "drift")),
        ("magnetometer", "noise"),
    )
}


class Estimated(Copter):
    """A flight whose autopilot knows the motion by an `Estimator` only; `estimates`: its parameters."""

    def __init__(self, estimates: dict[str, Any], **options: Any) -> None:
        self.estimates = estimates
        self.errors: list[tuple[float, float, float]] = []
        super().__init__(**options)

    def _connect(self) -> None:
        if not hasattr(self, "e"):
            self.e = Estimator.record()
            set_values(self.e, self.estimates)
            self._both_errors = [part(self.e, f"{name}_error") for name in ("position", "attitude")]
            self._truth = [(self.e[f"true_{name}"], self.v[name]) for name in MOTION]
            self._pairs = [(self.m[name], self.e[name]) for name in MOTION]
            self.e["true_airframe"] = self.v["airframe"]
            self._take_truth()
            assert kernels(Estimator)[0](self.e) == 0
        super()._connect()
        self._take_truth()

    def _take_truth(self) -> None:
        for to, of in self._truth:
            to[:] = of

    def tick(self) -> None:
        super().tick()  # the estimator has its inputs from the begin of this step
        assert kernels(Estimator)[1](self.e, (self.step - 1) * H, H) == 0
        self.errors.append((self.time, *(float(error[0]) for error in self._both_errors)))

    def worst(self, since: float = 0.0) -> tuple[float, float]:
        """Greatest error of place [m] and attitude [deg] since a time."""
        table = np.array([(p, a) for t, p, a in self.errors if t >= since])
        return float(table[:, 0].max()), math.degrees(table[:, 1].max())


# ---- random numbers ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "counter", "words"),
    [
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ],
)
def test_threefry_gives_the_published_numbers(key: tuple[int, int], counter: tuple[int, int], words: Any) -> None:
    assert threefry(*key, *counter) == words


def test_normal_numbers_are_normal() -> None:
    pairs = np.array([normal_pair(1, 2, i, 3) for i in range(20000)])
    x = pairs.ravel()
    assert abs(x.mean()) < 0.02
    assert x.std() == pytest.approx(1.0, abs=0.02)
    assert (x**4).mean() == pytest.approx(3.0, abs=0.15)
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.03
    assert abs(np.corrcoef(x[:-1], x[1:])[0, 1]) < 0.03
    other = np.array([normal_pair(1, 3, i, 3) for i in range(20000)]).ravel()
    assert abs(np.corrcoef(x, other)[0, 1]) < 0.03


# ---- the estimator -------------------------------------------------------------------------------------------------


def test_perfect_sensors_give_the_true_motion() -> None:
    copter = Estimated(PERFECT).in_the_air(5.0, 12.0)
    copter.go(20.0, 10.0, -8.0)
    copter.run(10.0)
    place, attitude = copter.worst()
    assert place < 0.03
    assert attitude < 0.3


def test_the_truth_is_handed_on_when_asked_for() -> None:
    plain, through = Copter().in_the_air(5.0, 10.0), Estimated({"use_truth": True}).in_the_air(5.0, 10.0)
    for copter in (plain, through):
        copter.go(10.0, 0.0, -5.0)
    a, b = plain.run(8.0), through.run(8.0)
    assert np.linalg.norm(a[:, 1:4] - b[:, 1:4], axis=1).max() < 0.05  # 2.5 ms later
    assert through.worst() == (0.0, 0.0)


@pytest.mark.parametrize("identity", [1, 2, 3])
def test_a_flight_on_estimates_stays_within_bounds(identity: int) -> None:
    """Bounds: 2 m of place and 3 degrees of attitude; the vehicle within 2.5 m of where it is sent."""
    copter = Estimated({"identity": identity}).in_the_air(10.0, 14.0)
    copter.go(20.0, -10.0, -10.0)
    copter.run(12.0)
    hold = copter.run(40.0)
    place, attitude = copter.worst()
    assert 0.05 < place < 2.0
    assert attitude < 3.0
    assert np.linalg.norm(hold[:, 1:4] - (20.0, -10.0, -10.0), axis=1).max() < 2.5
    assert np.linalg.norm(hold[:, 4:7], axis=1).max() < 0.8
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 9)
    copter.run(40.0)
    assert not copter.m["armed"]


def test_runs_repeat_bit_for_bit_and_vehicles_differ() -> None:
    def path(**values: int) -> bytes:
        copter = Estimated(values)
        copter.run(3.0)
        return bytes(copter.e.tobytes())

    assert path(seed=5, identity=2) == path(seed=5, identity=2)
    assert len({path(), path(seed=2), path(identity=2)}) == 3


def test_a_gyro_offset_is_learnt() -> None:
    """A gyro that is off by 0.01 rad/s about each axis would tilt the estimate by 0.6 degrees a second."""
    copter = Estimated({**PERFECT, "gyro_bias": 0.01})
    copter.run(60.0)
    learnt, true = copter.e["gyro_offset_frd"], copter.e["bias"][0]
    assert np.abs(true).max() > 2e-3
    assert learnt == pytest.approx(true, abs=3e-4)
    assert copter.worst(50.0)[1] < 0.5


def test_an_accelerometer_offset_is_learnt() -> None:
    copter = Estimated({**PERFECT, "accel_bias": 0.2})
    copter.run(60.0)
    assert abs(copter.e["bias"][1][2]) > 0.02
    assert float(copter.e["accel_offset"]) == pytest.approx(copter.e["bias"][1][2], abs=0.02)
    assert float(copter.e["position_error"]) < 0.1


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"gps_rate": 0.0}, 2),
        ({"gps_lag": 2.0}, 2),
        ({"true_attitude[1]": 0.0}, 1),
        ({"true_velocity[2]": math.nan}, 1),
    ],
)
def test_what_cannot_be(values: dict[str, float], code: int) -> None:
    record = Estimator.record()
    set_values(record, values)
    assert kernels(Estimator)[0](record) == code
    assert code in Estimator.errors


def test_sensors_have_the_spread_they_declare() -> None:
    record: Any = Estimator.record()
    set_values(record, {"gps_lag": 0.0})
    start, advance = kernels(Estimator)
    assert start(record) == 0
    gyro = np.empty((8000, 3))
    fixes = []
    for k in range(8000):
        assert advance(record, k * H, H) == 0
        gyro[k] = record.gyro_frd
        fixes.append(record.fixes[(int(record.fix_next) - 1) % 8, 0:3].copy())
    white = gyro - np.array(record.bias[0])
    assert white.std() == pytest.approx(1.7e-4 / math.sqrt(H), rel=0.03)
    assert abs(white.mean()) < 1e-4
    assert np.diff(np.unique(np.array(fixes), axis=0), axis=0).shape[0] == 99  # 5 Hz for 20 s


def test_a_step_of_no_length_makes_no_noise() -> None:
    """OMSimulator ends a run with a step of about 1e-13 s: the IMU holds its last sample; the next one is as ever."""
    start, advance = kernels(Estimator)
    one = Estimator.record()
    one["true_attitude"][0] = 1.0
    assert start(one) == 0
    for k in range(4):
        assert advance(one, k * H, H) == 0
    before = one.copy()
    assert advance(one, 4 * H, 1e-13) == 0
    for name in ("gyro_frd", "force_frd"):
        assert np.array_equal(one[name], before[name])
    for name in ("position", "velocity", "attitude", "angular_velocity"):
        assert np.allclose(one[name], before[name], rtol=0.0, atol=0.05), name
    first = Estimator.record()
    first["true_attitude"][0] = 1.0
    assert start(first) == 0 and advance(first, 0.0, 1e-13) == 0
    assert float(np.abs(first["gyro_frd"]).max()) < 0.3 and np.all(np.isfinite(first["position"]))


# ---- sensors that fail ---------------------------------------------------------------------------------------------


def at_rest(seconds: float, **values: Any) -> tuple[Any, np.ndarray]:
    """A level vehicle at rest with perfect sensors that fail as `values` say; the record and, for each step,
    estimated position [m, NED], attitude error [rad] and the number of GPS fixes so far.
    """
    record = Estimator.record()
    set_values(record, PERFECT | values)
    start, advance = kernels(Estimator)
    assert start(record) == 0
    place, (error, fix) = part(record, "position"), (part(record, name) for name in ("attitude_error", "fix_next"))
    rows, fixes, last = [], 0, int(fix[0])
    for k in range(round(seconds / H)):
        assert advance(record, k * H, H) == 0
        fixes, last = fixes + (int(fix[0]) != last), int(fix[0])
        rows.append((*place, float(error[0]), fixes))
    return record, np.array(rows)


def test_a_silent_gps_gives_no_fixes() -> None:
    _, rows = at_rest(6.0, **{"gps_outage[1]": 2.0, "gps_outage[2]": 4.0})  # one each 0.2 s
    assert [rows[round(t / H) - 1, 4] for t in (1.9, 2.1, 3.9, 4.1, 6.0)] == [10, 10, 10, 11, 20]


def test_a_failed_accelerometer_is_integrated_twice_while_gps_is_silent() -> None:
    _, rows = at_rest(5.0, **{"gps_outage[2]": 99.0, "failure_time": 2.0, "accel_failure[1]": 0.1})
    assert np.abs(rows[: round(2.0 / H), 0]).max() < 1e-12
    assert rows[-1, 0] == pytest.approx(0.5 * 0.1 * 3.0**2, rel=1e-6)
    assert rows[-1, 3] < 1e-9


def test_a_failed_gyro_turns_the_estimate_while_gps_and_magnetometer_are_silent() -> None:
    away = {"gps_outage[2]": 99.0, "magnetometer_outage[2]": 99.0}
    _, rows = at_rest(5.0, **away, **{"failure_time": 2.0, "gyro_failure[1]": 0.02})
    assert rows[-1, 3] == pytest.approx(0.02 * (3.0 - H), rel=1e-6)  # the error at the beginning of the last step


def test_a_heading_without_a_magnetometer_drifts_until_the_sensor_is_back() -> None:
    silent = {"magnetometer_outage[1]": 2.0, "magnetometer_outage[2]": 6.0}
    drifting, rows = at_rest(30.0, **silent, **{"failure_time": 2.0, "gyro_failure[3]": 0.01})
    assert rows[round(6.0 / H) - 1, 3] == pytest.approx(0.04, rel=2e-3)
    assert rows[-1, 3] < 1e-3
    assert float(drifting["gyro_offset_frd"][2]) == pytest.approx(0.01, rel=0.02)  # learnt from the field


@pytest.mark.parametrize(
    ("failure", "axis", "place"),
    [({"gps_failure[1]": 10.0}, 0, 10.0), ({"gps_failure[2]": -4.0}, 1, -4.0), ({"barometer_failure": 5.0}, 2, -5.0)],
)
def test_the_estimate_follows_a_sensor_that_is_wrong(failure: dict[str, float], axis: int, place: float) -> None:
    _, rows = at_rest(40.0, failure_time=2.0, **failure)
    assert np.abs(rows[: round(2.0 / H), :3]).max() < 1e-9
    assert rows[-1, axis] == pytest.approx(place, rel=0.01)


def test_a_drone_whose_gps_is_away_for_ten_seconds_keeps_its_place_within_its_sensors_errors() -> None:
    """With the noise of the default sensors; the estimate drifts, and the fixes bring it back."""
    copter = Estimated({"identity": 1, "gps_outage[1]": 30.0, "gps_outage[2]": 40.0}).in_the_air(10.0, 14.0)
    copter.run(40.0 - copter.time)
    drifted = copter.worst(38.0)[0]
    copter.run(40.0)
    assert 0.5 < drifted < 15.0
    assert copter.worst(70.0)[0] < 2.0

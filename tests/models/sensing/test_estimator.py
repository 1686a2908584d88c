"""Sensors with noise and the estimator: flights on estimates stay within bounds and repeat bit for bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.sensing.estimator import Estimator
from cosim_models.sensing.random_numbers import normal_pair, threefry
from tests.models.copter import MOTION, Copter, H, set_values

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
            self._truth = [(self.e[f"true_{name}"], self.v[name]) for name in MOTION]
            self._pairs = [(self.m[name], self.e[name]) for name in MOTION]
            self.e["true_airframe"] = self.v["airframe"]
            self._take_truth()
            assert Estimator.kernels is not None
            assert Estimator.kernels[0](self.e) == 0
        super()._connect()
        self._take_truth()

    def _take_truth(self) -> None:
        for to, of in self._truth:
            to[:] = of

    def tick(self) -> None:
        super().tick()  # the estimator has its inputs from the begin of this step
        assert Estimator.kernels is not None
        assert Estimator.kernels[1](self.e, (self.step - 1) * H, H) == 0
        self.errors.append((self.time, float(self.e["position_error"]), float(self.e["attitude_error"])))

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
    learnt, true = copter.e["gyro_offset"], copter.e["bias"][0]
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
    assert Estimator.kernels is not None
    assert Estimator.kernels[0](record) == code
    assert code in Estimator.errors


def test_sensors_have_the_spread_they_declare() -> None:
    record: Any = Estimator.record()
    set_values(record, {"gps_lag": 0.0})
    assert Estimator.kernels is not None
    start, advance = Estimator.kernels
    assert start(record) == 0
    gyro = np.empty((8000, 3))
    fixes = []
    for k in range(8000):
        assert advance(record, k * H, H) == 0
        gyro[k] = record.gyro
        fixes.append(record.fixes[(int(record.fix_next) - 1) % 8, 0:3].copy())
    white = gyro - np.array(record.bias[0])
    assert white.std() == pytest.approx(1.7e-4 / math.sqrt(H), rel=0.03)
    assert abs(white.mean()) < 1e-4
    assert np.diff(np.unique(np.array(fixes), axis=0), axis=0).shape[0] == 99  # 5 Hz for 20 s


def test_a_step_of_no_length_makes_no_noise() -> None:
    """OMSimulator ends a run with a step of about 1e-13 s: the IMU holds its last sample; the next one is as ever."""
    assert Estimator.kernels is not None
    start, advance = Estimator.kernels
    one = Estimator.record()
    one["true_attitude"][0] = 1.0
    assert start(one) == 0
    for k in range(4):
        assert advance(one, k * H, H) == 0
    before = one.copy()
    assert advance(one, 4 * H, 1e-13) == 0
    for name in ("gyro", "force"):
        assert np.array_equal(one[name], before[name])
    for name in ("position", "velocity", "attitude", "angular_velocity"):
        assert np.allclose(one[name], before[name], rtol=0.0, atol=0.05), name
    first = Estimator.record()
    first["true_attitude"][0] = 1.0
    assert start(first) == 0 and advance(first, 0.0, 1e-13) == 0
    assert float(np.abs(first["gyro"]).max()) < 0.3 and np.all(np.isfinite(first["position"]))

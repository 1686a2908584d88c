"""Errors of accelerometer and gyro to the side: what the estimate makes of them, beside flights of ArduCopter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.integrate import solve_ivp

from benchmarks.flights import read
from cosim.frames import euler_from_quaternion
from tests.models.copter import GUIDED, RECORDINGS, Copter, preset


def put(copter: Copter, **values: float) -> None:
    for name, value in values.items():
        copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32))
    copter.tick()


def hovering() -> Copter:
    one = {"EK3_IMU_MASK": 1}  # no other lane to change to
    copter = Copter(vehicle=preset("ardupilot_sitl_quad"), autopilot=one, direct=True).in_the_air(20.0, 22.0)
    copter.heard.clear()
    return copter


def angles(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Roll, pitch and yaw [deg]."""
    return np.degrees(euler_from_quaternion((q[0], q[1], q[2], q[3])))


def flown(seconds: float, **values: float) -> tuple[Copter, NDArray[np.float64]]:
    """The copter, and rows of time, true place from where it was, estimated and true angles [deg], at 10 Hz."""
    copter = hovering()
    place, begin = copter.v["position"].copy(), copter.time
    put(copter, **values)
    rows = []
    for _ in range(round(seconds * 10)):
        copter.run(0.1)
        m, v = copter.m, copter.v
        rows.append([copter.time - begin, *(v["position"] - place), *angles(m["q"]), *angles(v["attitude"])])
    return copter, np.array(rows)


def texts(copter: Copter) -> list[str]:
    return [m.text for m in copter.messages("STATUSTEXT")]


def beside(copter: Copter, rows: NDArray[np.float64], name: str, last: float) -> None:
    """Compares ours with a recorded flight of ArduCopter each half a second until `last` [s].

    Places to 0.15 m, heights to 0.2 m, errors of the attitude to half a degree.
    """
    real = read(RECORDINGS / f"{name}.csv.gz").real
    for row in rows[4::5]:
        if row[0] > last:
            return
        for i, axis in enumerate("ned"):
            there = float(np.interp(row[0], real["t"], real[axis] - real[axis][0]))
            assert row[1 + i] == pytest.approx(there, abs=0.2 if axis == "d" else 0.15), (row[0], axis)
        for i, angle in enumerate(("roll", "pitch")):
            there = float(np.interp(row[0], real["t"], real[f"err_{angle}"] - real[f"err_{angle}"][0]))
            assert row[4 + i] - row[7 + i] == pytest.approx(there, abs=0.5), (row[0], angle)


def test_an_accelerometer_that_errs_forwards_moves_it_back_as_the_real_one() -> None:
    """ArduCopter, 1 m/s2: 2.16 m back after 4 s, forwards again from 9.5 s on; the pitch errs by 6.8 degrees."""
    copter, rows = flown(24.0, SIM_ACC1_BIAS_X=1.0)
    beside(copter, rows, "x_accelerometer_side", 9.0)
    furthest = int(np.argmin(rows[:, 1]))
    assert rows[furthest, 0] == pytest.approx(4.0, abs=0.2)
    wrong = rows[:, 5] - rows[:, 8]
    assert wrong.max() == pytest.approx(6.8, abs=0.5)
    assert wrong[-1] == pytest.approx(math.degrees(math.asin(1.0 / 9.80665)), abs=1.5)  # where the weight balances it
    assert np.abs(rows[:, 2]).max() < 0.05
    assert texts(copter) == [] and copter.m["mode"] == GUIDED


def test_a_gyro_that_errs_moves_it_aside_as_the_real_one() -> None:
    """ArduCopter, roll 0.05 rad/s, until it changes the lane after 4.05 s: 2.4 m west, its roll errs by 8.9 degrees.

    Where all its sensors erred alike: 4.6 m west after 9 s, 2.3 m after 20 s, learned by then.
    """
    copter, rows = flown(4.2, SIM_GYR1_BIAS_X=0.05)
    beside(copter, rows, "x_gyro_slow", 4.0)
    copter, rows = flown(24.0, SIM_GYR1_BIAS_X=0.05)
    furthest = int(np.argmin(rows[:, 2]))
    assert rows[furthest, 2] == pytest.approx(-4.6, rel=0.1)
    assert rows[furthest, 0] == pytest.approx(9.0, abs=1.0)
    assert rows[199, 2] == pytest.approx(-2.26, abs=0.3)
    assert float(copter.m["lane_learned"][0, 0]) == pytest.approx(0.04, abs=0.006)
    assert texts(copter) == [] and copter.m["mode"] == GUIDED


def test_a_gyro_that_errs_about_yaw_turns_it_until_the_compass_holds() -> None:
    """The heading's error y and the learned correction s: y' = b + s - 0.2 y, s' = -0.01 y."""
    _, rows = flown(16.0, SIM_GYR1_BIAS_Z=0.05)
    oracle = solve_ivp(
        lambda _, x: (0.05 + x[1] - 0.2 * x[0], -0.01 * x[0]), (0.0, 16.0), (0.0, 0.0), dense_output=True
    )
    for row in rows[9::15]:
        assert math.radians(row[6] - row[9]) == pytest.approx(float(oracle.sol(row[0])[0]), abs=0.01)
    assert rows[:, 9].min() == pytest.approx(-11.2, abs=0.5)  # ArduCopter: -16.4
    assert np.abs(rows[:, 1:3]).max() < 0.05


def test_the_tilt_follows_the_body_where_the_nose_points_east() -> None:
    """The same error forwards moves a copter with its nose to the east to the west."""
    vehicle = {**preset("ardupilot_sitl_quad"), "yaw_start": math.pi / 2}
    copter = Copter(vehicle=vehicle, direct=True).in_the_air(20.0, 22.0)
    place = copter.v["position"].copy()
    put(copter, SIM_ACC1_BIAS_X=1.0)
    copter.run(4.0)
    moved = copter.v["position"] - place
    assert moved[1] == pytest.approx(-2.16, rel=0.05)
    assert abs(moved[0]) < 0.1
    copter = hovering()
    place = copter.v["position"].copy()
    put(copter, SIM_ACC1_BIAS_Y=-1.0)
    copter.run(4.0)
    assert copter.v["position"][1] - place[1] == pytest.approx(2.16, rel=0.05)


def test_a_great_error_is_told_and_the_estimate_is_reset() -> None:
    """ArduCopter, 3 m/s2: the text after 2.54 s, the reset after 3.24 s, 9 m away."""
    copter = hovering()
    begin, place = copter.time, copter.v["position"].copy()
    put(copter, SIM_ACC1_BIAS_X=3.0)
    copter.run(2.0)
    assert texts(copter) == []
    while copter.m["velocity_ratio"] >= 1.0 and copter.time < begin + 10.0:
        copter.run(0.1)
    assert copter.time - begin == pytest.approx(3.24, abs=0.3)
    told = {m.text: t - begin for t, m in copter.heard if m.get_type() == "STATUSTEXT"}
    assert told["GPS Glitch or Compass error"] == pytest.approx(2.54, abs=0.3)
    assert np.abs(copter.m["lane_now"][0, 3:5]).max() < 0.7
    assert -11.0 < copter.v["position"][0] - place[0] < -4.0


def test_without_gps_nothing_corrects_the_estimate() -> None:
    copter = hovering()
    put(copter, SIM_DRIFT_SPEED=0.0)
    put(copter, SIM_GPS1_ENABLE=0, SIM_ACC1_BIAS_X=0.2)
    copter.run(5.0)
    assert float(copter.m["lane_now"][0, 3]) == pytest.approx(0.2 * 5.0, abs=0.05)
    assert np.abs(copter.m["lane_now"][0, 6:8]).max() < 1e-9
    assert float(copter.m["estimate_error"][0]) == pytest.approx(0.5 * 0.2 * 25.0, abs=0.15)


def test_noise_of_the_gyro_shakes_it_and_repeats() -> None:
    """Leans by about 0.2 degrees with 20 deg/s, as ArduCopter's."""
    flights = []
    for _ in range(2):
        _, rows = flown(8.0, SIM_GYR1_RND=20.0)
        flights.append(rows)
    np.testing.assert_array_equal(flights[0], flights[1])
    assert 0.1 < np.abs(flights[0][:, 7:9]).max() < 0.6


def test_errors_that_are_set_back_are_forgotten() -> None:
    copter = hovering()
    put(copter, SIM_ACC1_BIAS_X=0.5, SIM_GYR1_BIAS_Y=0.01)
    copter.run(2.0)
    assert copter.m["sim_on"] and copter.m["estimate_errs"]
    put(copter, SIM_ACC1_BIAS_X=0.0, SIM_GYR1_BIAS_Y=0.0)
    for _ in range(40):
        copter.run(10.0)
        if not copter.m["sim_on"]:
            break
    assert not copter.m["sim_on"]
    assert np.linalg.norm(copter.v["position"] - (0.0, 0.0, -20.0)) < 0.3

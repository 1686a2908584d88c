"""Two inertial sensors: the estimate changes to the lane of the better one, as flights of ArduCopter show it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.flights import read
from tests.models.copter import GUIDED, RECORDED_AUTOPILOT, RECORDINGS, Copter, preset

SWITCH, CHANGED = "EKF3 lane switch {}", "EKF primary changed:{}"


def hovering(**autopilot: float) -> Copter:
    copter = Copter(vehicle=preset("ardupilot_sitl_quad"), autopilot={**RECORDED_AUTOPILOT, **autopilot}, direct=True)
    copter.in_the_air(20.0, 20.0)
    copter.go(0.0, 0.0, -20.0)
    copter.run(10.0)
    copter.heard.clear()
    return copter


def put(copter: Copter, **values: float) -> None:
    for name, value in values.items():
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))


def told(copter: Copter) -> dict[str, float]:
    """When the last of each text came [s]."""
    return {m.text: t for t, m in copter.heard if m.get_type() == "STATUSTEXT"}


@pytest.mark.parametrize(
    ("name", "when", "axis"),
    [("x_lane_down", 1.252, 2), ("x_lane_forward", 0.850, 0), ("x_lane_gyro", 1.667, 1), ("x_gyro_slow", 4.05, 1)],
)
def test_it_changes_the_lane_as_the_real_one_did(name: str, when: float, axis: int) -> None:
    """`when` is from the texts in ArduCopter's log. Farthest away within a twentieth, and back at the end."""
    flight = read(RECORDINGS / f"{name}.csv.gz")
    copter = hovering()
    copter.run((flight.head["fix"] - copter.time) % 0.2)  # as long after a fix of GPS
    begin = copter.time
    put(copter, **flight.head["set"])
    rows = copter.run(float(flight.real["t"][-1]))
    texts = told(copter)
    assert texts[SWITCH.format(1)] - begin == pytest.approx(when, abs=0.04)
    assert texts[CHANGED.format(1)] == texts[SWITCH.format(1)] and len(texts) == 2
    real = np.column_stack([flight.real[part] - flight.real[part][0] for part in "ned"])
    ours = rows[:, 1:4] - rows[0, 1:4]
    farthest = np.argmax(np.abs(real[:, axis]))
    most = ours[np.argmax(np.abs(ours[:, axis])), axis]
    assert most == pytest.approx(real[farthest, axis], rel=0.05)
    assert np.linalg.norm(ours[-1]) < 0.1 and np.linalg.norm(real[-1]) < 0.1
    assert (copter.m["mode"], copter.m["lane"], copter.m["ekf_failed"]) == (GUIDED, 1, False)


@pytest.mark.parametrize(
    ("autopilot", "values"),
    [
        ({}, {"SIM_ACC1_BIAS_X": 3.0, "SIM_ACC2_BIAS_X": 3.0}),  # both err alike
        ({}, {"SIM_ACC2_BIAS_X": 3.0}),  # the one that does not fly
        ({"EK3_IMU_MASK": 1}, {"SIM_ACC1_BIAS_X": 3.0}),
        ({"INS_USE2": 0}, {"SIM_ACC1_BIAS_X": 3.0}),  # both lanes have the first sensor
        ({"EK3_OPTIONS": 2}, {"SIM_ACC1_BIAS_X": 3.0}),
        ({}, {"SIM_ACC1_BIAS_X": 1.0}),  # its velocity errs by less than 1.9 m/s
    ],
)
def test_it_stays_in_its_lane(autopilot: dict[str, float], values: dict[str, float]) -> None:
    copter = hovering(**autopilot)
    put(copter, **values)
    copter.run(5.0)
    assert not any(text.startswith(("EKF3 lane", "EKF primary")) for text in told(copter))
    assert copter.m["lane"] == 0


@pytest.mark.parametrize("autopilot", [{"EK3_IMU_MASK": 2}, {"INS_USE": 0}])
def test_a_sensor_that_is_not_used_does_not_matter(autopilot: dict[str, float]) -> None:
    copter = hovering(**autopilot)
    place = copter.v["position"].copy()
    put(copter, SIM_ACC1_BIAS_X=3.0, SIM_GYR1_BIAS_Y=0.1)
    copter.run(5.0)
    assert np.linalg.norm(copter.v["position"] - place) < 0.02
    assert told(copter) == {}


def test_it_changes_back_when_the_other_one_errs_and_disarmed_to_the_first() -> None:
    copter = hovering()
    put(copter, SIM_ACC1_BIAS_X=3.0)
    copter.run(8.0)
    assert copter.m["lane"] == 1
    put(copter, SIM_ACC1_BIAS_X=0.0)
    copter.run(30.0)
    copter.heard.clear()
    put(copter, SIM_ACC2_BIAS_X=3.0)
    copter.run(4.0)
    assert SWITCH.format(0) in told(copter) and copter.m["lane"] == 0
    put(copter, EK3_PRIMARY=1)
    copter.run(1.0)
    assert copter.m["lane"] == 0  # it is armed
    copter.heard.clear()
    put(copter, SIM_ACC2_BIAS_X=0.0)
    copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)
    copter.run(0.5)
    assert CHANGED.format(1) in told(copter) and SWITCH.format(1) not in told(copter)
    assert copter.m["lane"] == 1


def test_lanes_are_changed_by_hand() -> None:
    """EK3_OPTIONS 2: in flight, by EK3_PRIMARY."""
    copter = hovering(EK3_OPTIONS=2)
    put(copter, SIM_ACC1_BIAS_X=3.0)
    copter.run(2.0)
    assert copter.m["lane"] == 0
    put(copter, EK3_PRIMARY=1)
    copter.run(0.3)
    assert SWITCH.format(1) in told(copter) and copter.m["lane"] == 1


def test_an_estimate_without_errors_is_the_same_with_one_lane_and_two() -> None:
    flights: list[Any] = []
    for mask in (1, 3):
        copter = Copter(autopilot={"EK3_IMU_MASK": mask}).in_the_air(4.0, 6.0)
        flights.append(copter.run(1.0))
    np.testing.assert_array_equal(flights[0], flights[1])

"""The mixer against ArduPilot's published motor tables, its priorities, and the thrust curve."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.vehicle import Airframe
from cosim_models.autopilot.control.mixer import (
    LIMIT_ROLL_PITCH,
    LIMIT_THROTTLE_LOWER,
    LIMIT_THROTTLE_UPPER,
    LIMIT_YAW,
    mix,
    mix_without,
    motor_factors,
    thrust_to_command,
)

S = 0.25  # half of sin 30 degrees over sin 90
# Motors 1 to n: roll, pitch, yaw; normalised to 0.5. From the motor order diagrams of ArduPilot's documentation.
TABLES = {
    Airframe.quad_x: [(-0.5, 0.5, 0.5), (0.5, -0.5, 0.5), (0.5, 0.5, -0.5), (-0.5, -0.5, -0.5)],
    Airframe.hexa_x: [
        (-0.5, 0.0, -0.5),
        (0.5, 0.0, 0.5),
        (S, 0.5, -0.5),
        (-S, -0.5, 0.5),
        (-S, 0.5, 0.5),
        (S, -0.5, -0.5),
    ],
    Airframe.quad_plus: [(-0.5, 0.0, 0.5), (0.5, 0.0, 0.5), (0.0, 0.5, -0.5), (0.0, -0.5, -0.5)],
    Airframe.y6: [
        (-0.5, 0.25, -0.5),
        (-0.5, 0.25, 0.5),
        (0.0, -0.5, -0.5),
        (0.0, -0.5, 0.5),
        (0.5, 0.25, -0.5),
        (0.5, 0.25, 0.5),
    ],
}
MULTIROTORS = (Airframe.quad_x, Airframe.hexa_x, Airframe.octa_x, Airframe.y6, Airframe.quad_plus)
torques = st.floats(-1.5, 1.5)
throttles = st.floats(0.0, 1.0)


def factors(airframe: int) -> tuple[int, np.ndarray]:
    table = np.zeros((8, 3))
    return motor_factors(int(airframe), table), table


@pytest.mark.parametrize("airframe", TABLES)
def test_factors_are_ardupilots(airframe: Airframe) -> None:
    count, table = factors(airframe)
    assert count == len(TABLES[airframe])
    assert table[:count] == pytest.approx(np.array(TABLES[airframe]), abs=1e-12)
    assert (table[count:] == 0.0).all()


def test_octa_x_factors() -> None:
    count, table = factors(Airframe.octa_x)
    assert count == 8
    angles = np.radians([22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5])
    assert table[:, 0] == pytest.approx(-0.5 * np.sin(angles) / math.sin(math.radians(67.5)))
    assert table[:, 1] == pytest.approx(0.5 * np.cos(angles) / math.cos(math.radians(22.5)))
    assert table[:, 2].tolist() == [-0.5, -0.5, 0.5, 0.5, 0.5, 0.5, -0.5, -0.5]


@pytest.mark.parametrize("airframe", MULTIROTORS)
def test_torques_do_not_mix(airframe: Airframe) -> None:
    count, table = factors(airframe)
    assert table[:count].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    gram = table[:count].T @ table[:count]
    assert gram - np.diag(np.diag(gram)) == pytest.approx(np.zeros((3, 3)), abs=1e-12)


@pytest.mark.parametrize(
    "airframe", [0, 77, Airframe.point_mass, Airframe.rover, Airframe.boat, Airframe.plane, Airframe.quadplane]
)
def test_what_is_no_multirotor_has_no_motors(airframe: int) -> None:
    assert factors(airframe)[0] == 0


def mixed(
    roll: float, pitch: float, yaw: float, throttle: float, average: float = 1.0, most: float = 1.0
) -> tuple[int, float, np.ndarray]:
    count, table = factors(Airframe.quad_x)
    thrust = np.zeros(8)
    limits, given = mix(table, count, roll, pitch, yaw, throttle, average, most, 0.2, thrust)
    return limits, given, thrust[:4]


def test_without_saturation_everything_is_given() -> None:
    limits, average, thrust = mixed(0.1, -0.2, 0.05, 0.5)
    assert limits == 0
    assert average == pytest.approx(0.5)
    expected = 0.5 + np.array(TABLES[Airframe.quad_x]) @ (0.1, -0.2, 0.05)
    assert thrust == pytest.approx(expected)


def test_throttle_gives_way_to_roll_up_to_the_average_allowed() -> None:
    limits, average, thrust = mixed(0.6, 0.0, 0.0, 0.1, average=0.5)
    assert average == pytest.approx(0.3)
    assert thrust[1] - thrust[0] == pytest.approx(0.6)
    assert limits == 0
    limits, average, thrust = mixed(0.6, 0.0, 0.0, 0.1, average=0.2)
    assert thrust[1] - thrust[0] == pytest.approx(0.4)
    assert average == pytest.approx(0.2)
    assert limits & LIMIT_ROLL_PITCH
    assert not limits & LIMIT_THROTTLE_LOWER


def test_full_throttle_is_lowered_for_roll() -> None:
    limits, average, thrust = mixed(0.4, 0.0, 0.0, 1.0)
    assert average == pytest.approx(0.8)
    assert thrust.max() == pytest.approx(1.0)
    assert thrust[1] - thrust[0] == pytest.approx(0.4)
    assert limits == LIMIT_THROTTLE_UPPER


def test_yaw_gives_way_to_roll_but_not_below_its_headroom() -> None:
    limits, _, thrust = mixed(0.5, 0.0, 1.0, 0.5)
    assert limits == LIMIT_YAW
    assert (thrust[0] + thrust[1]) - (thrust[2] + thrust[3]) == pytest.approx(2.0 * 0.5)
    limits, _, thrust = mixed(1.0, 0.0, 1.0, 0.5)  # no room at all: the headroom of 0.2 is taken from both
    assert limits & (LIMIT_YAW | LIMIT_ROLL_PITCH) == LIMIT_YAW | LIMIT_ROLL_PITCH
    given_yaw = (thrust[0] + thrust[1] - thrust[2] - thrust[3]) / 2.0
    assert given_yaw == pytest.approx(0.2 / 1.2)
    assert thrust.min() == pytest.approx(0.0, abs=1e-12)
    assert thrust.max() == pytest.approx(1.0)


def test_throttle_is_limited_while_spooling_up() -> None:
    limits, average, _ = mixed(0.0, 0.0, 0.0, 0.6, most=0.25)
    assert average == pytest.approx(0.25)
    assert limits == LIMIT_THROTTLE_UPPER
    assert mixed(0.0, 0.0, 0.0, 0.0)[0] == LIMIT_THROTTLE_LOWER


@settings(deadline=None)
@given(st.sampled_from(MULTIROTORS), torques, torques, torques, throttles, throttles)
def test_thrust_stays_within_zero_and_one(
    airframe: Airframe, roll: float, pitch: float, yaw: float, throttle: float, average_max: float
) -> None:
    count, table = factors(airframe)
    thrust = np.zeros(8)
    limits, average = mix(table, count, roll, pitch, yaw, throttle, average_max, 1.0, 0.2, thrust)
    used = thrust[:count]
    assert used.min() >= 0.0 and used.max() <= 1.0
    assert used.mean() == pytest.approx(average, abs=1e-9)
    if not limits & LIMIT_ROLL_PITCH:
        given_torque = (used - average) @ table[:count] / (table[:count] ** 2).sum(axis=0)
        assert given_torque[:2] == pytest.approx((roll, pitch), abs=1e-9)


@settings(deadline=None)
@given(st.floats(-0.9, 1.0), throttles)
def test_the_thrust_curve_is_inverted(expo: float, thrust: float) -> None:
    command = thrust_to_command(thrust, expo, 0.15, 0.95)
    c = (command - 0.15) / 0.8
    assert (1.0 - expo) * c + expo * c * c == pytest.approx(thrust, abs=1e-9)


def test_the_thrust_curve_of_a_hover() -> None:
    """Hover at 0.39 of full thrust is 1590 us (recorded flights)."""
    assert 1000 + 1000 * thrust_to_command(0.39, 0.65, 0.15, 0.95) == pytest.approx(1590.5, abs=1.0)
    assert thrust_to_command(0.3, 0.0, 0.0, 1.0) == pytest.approx(0.3)


# ---- a motor that is left out ----------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(torques, torques, torques, throttles, throttles, st.floats(0.0, 0.5))
def test_nothing_left_out_is_the_mixer(
    roll: float, pitch: float, yaw: float, throttle: float, average: float, headroom: float
) -> None:
    for airframe in MULTIROTORS:
        count, table = factors(airframe)
        plain, other = np.zeros(8), np.zeros(8)
        demands = (roll, pitch, yaw, throttle, average, 1.0, headroom)
        wanted = mix(table, count, *demands, plain)
        assert mix_without(table, count, -1, 0.0, *demands, other) == wanted
        assert np.clip(other, 0.0, 1.0).tolist() == plain.tolist()


@settings(max_examples=100, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.2, 0.2), throttles, st.integers(0, 5))
def test_the_others_give_what_is_demanded_in_spite_of_the_lost_one(
    roll: float, pitch: float, yaw: float, throttle: float, lost: int
) -> None:
    """A hexarotor: where torques fit, the average is the demanded one within the limits of all but the lost motor."""
    count, table = factors(Airframe.hexa_x)
    thrust = np.zeros(8)
    limits, average = mix_without(table, count, lost, 1.0, roll, pitch, yaw, throttle, 1.0, 1.0, 0.0, thrust)
    if limits & (LIMIT_ROLL_PITCH | LIMIT_YAW):
        return
    shares = table[:count] @ np.array([roll, pitch, yaw])
    others = np.delete(shares, lost)
    most = 1.0 - others.max()
    assert average == pytest.approx(min(max(throttle, -shares.min()), most), abs=1e-12)
    assert thrust[:count] == pytest.approx(average + shares, abs=1e-12)
    assert np.delete(thrust[:count], lost).max() <= 1.0 + 1e-12
    assert (thrust[:count] >= -1e-12).all()
    assert bool(limits & LIMIT_THROTTLE_UPPER) == (throttle >= 1.0 or throttle > most)


def test_a_lost_motor_holds_the_others_back_less_and_less() -> None:
    """Motor 1 of a hexarotor is to give 0.4 beyond the average, the next 0.2: the average rises from 0.6 to 0.8."""
    count, table = factors(Airframe.hexa_x)
    averages = []
    for share in (0.0, 0.5, 1.0):
        thrust = np.zeros(8)
        limits, average = mix_without(table, count, 0, share, -0.8, 0.0, 0.0, 0.9, 1.0, 1.0, 0.2, thrust)
        averages.append(average)
        assert limits == LIMIT_THROTTLE_UPPER
    assert averages == pytest.approx([0.6, 0.7, 0.8])
    assert thrust[0] == pytest.approx(1.2)


def test_yaw_without_a_motor_has_half_of_the_range() -> None:
    """At full demand of roll there is no room for yaw but the headroom: 0.2, and 0.5 without the motor."""
    count, table = factors(Airframe.hexa_x)
    for share, room in ((0.0, 0.2), (1.0, 0.5)):
        thrust = np.zeros(8)
        limits, _ = mix_without(table, count, -1, share, -1.0, 0.0, -1.0, 0.5, 0.5, 1.0, 0.2, thrust)
        assert limits & LIMIT_YAW
        turned = table[:count, 2] @ thrust[:count]
        rolled = table[:count, 0] @ thrust[:count]
        assert turned / (table[:count, 2] @ table[:count, 2]) == pytest.approx(
            room * rolled / (table[:count, 0] @ table[:count, 0]), abs=1e-9
        )

"""ACRO, FLIP and THROW: rates of the sticks, the trainer, one whole turn, and a vehicle thrown from the hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, FAILED, GUIDED, LOITER, STABILIZE, Copter, H
from tests.models.pilot import flown, hold, lean, override, texts

ACRO, ALT_HOLD, FLIP, THROW = 1, 2, 14, 18
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE


def turned(copter: Copter, duration: float, axis: int) -> float:
    """Fly on; returns the angle [deg] turned about an axis of the body."""
    angle = 0.0
    for _ in range(round(duration / H)):
        copter.tick()
        angle += copter.v["angular_velocity"][axis] * H
    return math.degrees(angle)


def target_roll(copter: Copter) -> float:
    w, x, y, z = copter.m["attitude_target"]
    return math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))


# ---- ACRO ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("expo", "rate"), [(0.3, 0.7 * 0.5 / (1.0 - 0.3 * 0.5) * 360.0), (0.0, 180.0)])
def test_acro_sticks_set_rates(expo: float, rate: float) -> None:
    """Half a stick: (1 - expo) x / (1 - expo x) of ACRO_RP_RATE; without a trainer, the lean stays."""
    copter = flown(ACRO, 40.0, ACRO_TRAINER=0, ACRO_RP_EXPO=expo, RC1_DZ=0.0, RC4_DZ=0.0)
    override(copter, 1750, 1500, 1500, 1500)
    turned(copter, 1.0, 0)
    assert math.degrees(copter.m["rate_target"][0]) == pytest.approx(rate, rel=1e-6)
    assert turned(copter, 0.1, 0) == pytest.approx(0.1 * rate, rel=0.05)
    override(copter, 1500, 1500, 1500, 1500)
    copter.run(0.3)
    tilt = target_roll(copter)
    copter.run(0.3)
    assert target_roll(copter) == pytest.approx(tilt, abs=0.1)
    override(copter, 1500, 1500, 1500, 2000)
    copter.run(1.0)
    assert math.degrees(copter.m["rate_target"][2]) == pytest.approx(202.5)


def test_the_trainer_limits_the_lean_and_levels() -> None:
    """ACRO_TRAINER 2: beyond ANGLE_MAX (30 deg), a square root of the angle undoes the stick's rate; levelling: 1/s.

    The root belongs to 1100 deg/s2 (ATC_ACCEL_R_MAX), its linear part to a gain of ACRO_RP_RATE per 10 deg.
    """
    copter = flown(ACRO, 90.0)
    hold(copter, 2.5, 2000, 1500, 1500, 1500)
    expected = 30.0 + (360.0 - 30.0) ** 2 / (2.0 * 1100.0) + 0.5 * 1100.0 / 36.0**2
    assert target_roll(copter) == pytest.approx(expected, abs=1.0)
    override(copter, 1500, 1500, 1500, 1500)
    copter.run(1.5)
    begin = target_roll(copter)
    assert begin < 30.0
    copter.run(1.0)
    assert target_roll(copter) == pytest.approx(begin * math.exp(-1.0), rel=0.05)


def test_acro_needs_a_throttle_and_levels_only_without_sticks_with_trainer_1() -> None:
    copter = flown(ACRO, 30.0, ACRO_TRAINER=1)
    override(copter, 2000, 1500, 1500, 1500)
    copter.run(0.5)
    assert abs(lean(copter)[0]) > 90.0  # nothing keeps it within ANGLE_MAX
    copter = Copter()
    copter.run(2.1)
    assert copter.ask(SET_MODE, 1, ACRO) == [("ACK", SET_MODE, ACCEPTED)]
    override(copter, 1500, 1500, 1200, 1500)
    copter.run(0.1)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[1] == ("TEXT", 2, "Arm: Throttle too high")


# ---- FLIP ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("roll", "pitch", "axis", "sign"), [(1500, 1500, 0, 1), (1400, 1500, 0, -1), (1500, 1600, 1, 1)]
)
def test_a_flip_is_one_turn_and_the_mode_comes_back(roll: int, pitch: int, axis: int, sign: int) -> None:
    copter = flown(ALT_HOLD, 30.0)
    override(copter, roll, pitch, 1500, 1500)
    copter.tick()
    assert copter.ask(SET_MODE, 1, FLIP) == [("ACK", SET_MODE, ACCEPTED)]
    override(copter, 1500, 1500, 1500, 1500)
    angle = turned(copter, 0.5, axis)
    assert copter.m["mode"] == FLIP
    assert abs(math.degrees(copter.m["rate_target"][axis])) == pytest.approx(400.0, rel=0.01)
    while copter.m["mode"] == FLIP:
        angle += turned(copter, 10 * H, axis)
    assert copter.m["mode"] == ALT_HOLD
    assert copter.time < 26.0
    angle += turned(copter, 1.5, axis)
    assert angle == pytest.approx(sign * 360.0, abs=12.0)
    override(copter, 1500, 1500, 1500, 1500)
    flight = hold(copter, 4.0, 1500, 1500, 1500, 1500)
    assert -flight[:, 3].max() > 0.5
    assert abs(flight[-1, 6]) < 0.3


def test_a_flip_is_refused_or_given_up() -> None:
    refused = [("ACK", SET_MODE, FAILED), ("TEXT", 4, "Mode change to FLIP failed: init failed")]
    copter = flown(GUIDED)
    assert copter.ask(SET_MODE, 1, FLIP) == refused  # only from ACRO, STABILIZE and ALT_HOLD
    copter.ask(SET_MODE, 1, ALT_HOLD)
    override(copter, 1990, 1500, 1500, 1500)
    copter.tick()
    assert copter.ask(SET_MODE, 1, FLIP) == refused  # the roll stick is too far
    override(copter, 1500, 1500, 1500, 1500)
    copter.tick()
    assert copter.ask(SET_MODE, 1, FLIP) == [("ACK", SET_MODE, ACCEPTED)]
    override(copter, 1500, 1010, 1500, 1500)
    copter.tick()
    copter.tick()
    assert copter.m["mode"] == ALT_HOLD
    ground = Copter()
    ground.run(2.1)
    assert ground.ask(SET_MODE, 1, FLIP) == refused


# ---- THROW ---------------------------------------------------------------------------------------------------------


def waiting(**autopilot: Any) -> Copter:
    """Armed in THROW on the ground."""
    copter = Copter(autopilot=autopilot)
    copter.run(2.1)
    assert copter.ask(SET_MODE, 1, THROW) == [("ACK", SET_MODE, ACCEPTED)]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0][2] == ACCEPTED
    copter.run(11.0)  # longer than DISARM_DELAY
    assert copter.m["armed"]
    assert not copter.m["motor"].any()
    return copter


def thrown(copter: Copter, up: float, spin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray[Any, Any]:
    """Leave the hand 1.5 m above the ground."""
    copter.heard.clear()
    copter.v["position"][2] -= 1.5
    copter.v["velocity"][:] = (2.0, 0.0, -up)
    copter.v["angular_velocity"][:] = spin
    return copter.run(12.0)


def test_a_throw_ends_in_a_hover() -> None:
    copter = waiting(THROW_NEXTMODE=LOITER)
    assert texts(copter) == []
    flight = thrown(copter, 9.0, (3.0, 1.0, 0.0))
    assert texts(copter) == [
        (6, "throw detected - spooling motors"),
        (6, "throttle is unlimited - uprighting"),
        (6, "uprighted - controlling height"),
        (0, "Potential Thrust Loss (2)"),  # full throttle against the fall
        (6, "height achieved - controlling position"),
    ]
    assert copter.m["mode"] == LOITER
    assert np.abs(flight[-400:, 4:7]).max() < 0.3
    assert abs(lean(copter)[0]) < 5.0
    assert -flight[-1, 3] > 1.5


def test_motors_start_when_half_a_second_of_free_fall_has_taken_2_5_m_per_s() -> None:
    """Free fall loses 2.5 m/s in 0.255 s; the climb must not have ended before it begins."""
    copter = waiting()
    copter.v["position"][2] -= 1.5
    copter.v["velocity"][:] = (0.0, 0.0, -6.0)
    begin = copter.time
    while not copter.m["motor"].any():
        copter.tick()
        assert copter.time < begin + 1.0
    filtered = 0.06  # s, INS_ACCEL_FILTER until free fall is seen
    assert 2.5 / 9.80665 <= copter.time - begin < 2.5 / 9.80665 + filtered
    assert copter.m["mode"] == THROW


def test_what_is_no_throw() -> None:
    copter = waiting(THROW_ALT_MIN=5.0)
    copter.v["position"][2] -= 1.5
    copter.v["velocity"][:] = (0.0, 0.0, -6.0)
    copter.run(0.9)
    assert not copter.m["motor"].any()  # below THROW_ALT_MIN
    copter = waiting()
    copter.v["position"][2] -= 3.0
    copter.v["velocity"][:] = (0.0, 0.0, 1.0)
    copter.run(0.5)
    assert not copter.m["motor"].any()  # dropped, and THROW_TYPE is 0
    flying = flown(GUIDED)
    refused = [("ACK", SET_MODE, FAILED), ("TEXT", 4, "Mode change to THROW failed: init failed")]
    assert flying.ask(SET_MODE, 1, THROW) == refused
    assert flying.ask(SET_MODE, 1, STABILIZE)[0][2] == ACCEPTED

"""The pilot's sticks while the vehicle flies by itself: the nose in GUIDED, CIRCLE, AUTO and RTL, the landing place in
LAND, RTL and AUTO, as ArduCopter lets them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_autopilot_missions import AUTO, HOME, item, upload
from tests.models.autopilot.test_autopilot_pilot import BRAKE, CIRCLE, hold, override
from tests.models.copter import ACCEPTED, GUIDED, LAND, RTL, Copter

YAW_RIGHT = (1500, 1500, 1500, 1600)
FORWARD, RIGHT, DIAGONAL = (1500, 1000, 1500, 1500), (2000, 1500, 1500, 1500), (2000, 1000, 1500, 1500)
CENTRED = (1500, 1500, 1500, 1500)
RATE = 202.5 * 80 / 480
"""deg/s of YAW_RIGHT: 100 us, of which 20 are dead zone."""


def heading(copter: Copter) -> float:
    w, x, y, z = copter.v["attitude"]
    return math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def turned(copter: Copter, duration: float, *sticks: int) -> float:
    """How far the nose has turned [deg], the short way, while sticks are held."""
    before = heading(copter)
    hold(copter, duration, *sticks)
    return (heading(copter) - before + 180.0) % 360.0 - 180.0


@pytest.fixture
def copter() -> Copter:
    return Copter().in_the_air(6.0, 10.0)


def test_the_yaw_stick_turns_the_nose_in_guided_until_the_next_target(copter: Copter) -> None:
    assert turned(copter, 2.0, *YAW_RIGHT) == pytest.approx(2.0 * RATE, abs=4.0)
    copter.go(0.0, -15.0, -6.0)
    hold(copter, 5.0, *CENTRED)
    assert heading(copter) == pytest.approx(-90.0, abs=5.0)  # along the path again
    turned(copter, 1.0, *YAW_RIGHT)
    hold(copter, 3.0, *CENTRED)
    assert heading(copter) == pytest.approx(-90.0 + RATE, abs=8.0)
    assert abs(turned(copter, 4.0, *CENTRED)) < 1.0
    assert copter.v["position"][1] == pytest.approx(-15.0, abs=1.0)


@pytest.mark.parametrize(
    ("mode", "option"), [(GUIDED, "GUID_OPTIONS"), (RTL, "RTL_OPTIONS"), (AUTO, "AUTO_OPTIONS"), (BRAKE, "")]
)
def test_an_option_ignores_the_yaw_stick_and_brake_always_does(mode: int, option: str) -> None:
    copter = Copter(autopilot={option: 4} if option else {}).in_the_air(6.0, 10.0)
    upload(copter, HOME, item(1, 17, north=0.01, z=6.0))
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    turned(copter, 1.0, *CENTRED)
    assert abs(turned(copter, 1.5, *YAW_RIGHT)) < 3.0
    if option:
        copter.m[option] = 0
        assert turned(copter, 1.5, *YAW_RIGHT) > 30.0


def test_the_nose_is_held_when_the_radio_is_lost(copter: Copter) -> None:
    copter.m["FS_THR_ENABLE"], copter.m["FS_OPTIONS"] = 1, 4
    hold(copter, 1.0, *YAW_RIGHT)
    for _ in range(2):
        override(copter, 1500, 1500, 940, 1600)
        copter.run(0.5)
    assert copter.m["radio_lost"]
    hold(copter, 3.0, 1500, 1500, 940, 1600)
    assert abs(turned(copter, 2.0, 1500, 1500, 940, 1600)) < 1.0
    assert copter.m["mode"] == GUIDED


def test_the_yaw_stick_takes_the_nose_off_the_centre_of_a_circle(copter: Copter) -> None:
    copter.m["CIRCLE_RADIUS"] = 500.0
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, CIRCLE)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    assert turned(copter, 5.0, *CENTRED) > 40.0
    turned(copter, 1.0, *YAW_RIGHT)
    hold(copter, 3.0, *CENTRED)
    assert abs(turned(copter, 3.0, *CENTRED)) < 2.0


# ---- the landing place ---------------------------------------------------------------------------------------------


def moved(copter: Copter, sticks: tuple[int, ...], duration: float = 4.0) -> np.ndarray[Any, Any]:
    """Mean velocity north and east [m/s] of the last second with sticks held."""
    return hold(copter, duration, *sticks)[-400:, 4:6].mean(axis=0)


@pytest.mark.parametrize(
    ("sticks", "expected"),
    [(FORWARD, (1.25, 0.0)), (RIGHT, (0.0, 1.25)), (DIAGONAL, (1.25 / math.sqrt(2), 1.25 / math.sqrt(2)))],
)
def test_roll_and_pitch_stick_move_the_landing_place(
    copter: Copter, sticks: tuple[int, ...], expected: tuple[float, float]
) -> None:
    """Full sticks: half of WPNAV_ACCEL, as a speed."""
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LAND)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    assert moved(copter, sticks) == pytest.approx(expected, abs=0.08)
    assert np.hypot(*moved(copter, CENTRED)) < 0.15


def test_the_landing_place_moves_with_the_heading(copter: Copter) -> None:
    copter.command(mavlink.MAV_CMD_CONDITION_YAW, 90.0, 0.0, 0.0, 0.0)
    copter.run(4.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LAND)
    assert moved(copter, FORWARD) == pytest.approx((0.0, 1.25), abs=0.1)


@pytest.mark.parametrize("reposition", [0, 1])
def test_rtl_and_auto_land_where_the_pilot_wants_them_if_they_may(reposition: int) -> None:
    for mode in (RTL, AUTO):
        copter = Copter(autopilot={"RTL_LOIT_TIME": 100.0, "LAND_REPOSITION": reposition}).in_the_air(6.0, 10.0)
        upload(copter, HOME, item(1, 21))
        assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
        hold(copter, 5.0, *CENTRED)
        velocity = moved(copter, FORWARD, 3.0)
        assert velocity == pytest.approx((1.25 * reposition, 0.0), abs=0.1), mode
        assert turned(copter, 1.5, *YAW_RIGHT) > 30.0
        hold(copter, 20.0, *CENTRED)
        assert not copter.m["armed"], mode
        assert (copter.v["position"][0] > 2.0) == bool(reposition)


def test_rtl_that_stays_in_the_air_can_be_moved_there() -> None:
    copter = Copter(autopilot={"RTL_LOIT_TIME": 100.0, "RTL_ALT_FINAL": 400.0, "RTL_OPTIONS": 4})
    copter.in_the_air(6.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)
    hold(copter, 5.0, *CENTRED)
    assert moved(copter, RIGHT, 3.0) == pytest.approx((0.0, 1.25), abs=0.1)
    assert turned(copter, 1.5, *YAW_RIGHT) > 30.0  # free again, since the place is
    hold(copter, 6.0, *CENTRED)
    assert copter.v["position"][2] == pytest.approx(-4.0, abs=0.1)
    assert copter.m["armed"]


def test_rtl_without_radio_lands_even_if_it_should_stay() -> None:
    copter = Copter(autopilot={"RTL_LOIT_TIME": 100.0, "RTL_ALT_FINAL": 400.0}).in_the_air(6.0, 10.0)
    hold(copter, 0.5, *CENTRED)
    copter.m["SIM_RC_FAIL"] = 1
    copter.run(40.0)
    assert copter.m["radio_lost"]
    assert not copter.m["armed"]


def test_guided_can_be_armed_by_the_sticks_if_it_may() -> None:
    for option in (0, 1):
        copter = Copter(autopilot={"GUID_OPTIONS": option})
        copter.run(2.1)
        copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
        hold(copter, 3.0, 1500, 1500, 1000, 2000)
        assert bool(copter.m["armed"]) == bool(option)

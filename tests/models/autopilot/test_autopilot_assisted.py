"""DRIFT, POSHOLD and ZIGZAG, and the stops of BRAKE and LOITER as recorded from ArduCopter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, LOITER, ONLY_VELOCITY, RECORDED_AUTOPILOT, Copter, preset
from tests.models.pilot import flown, hold, lean, override, texts

DRIFT, POSHOLD, BRAKE, ZIGZAG = 11, 16, 17, 24
SET_MODE, AUX = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_AUX_FUNCTION


# ---- DRIFT ---------------------------------------------------------------------------------------------------------


def test_drift_turns_by_roll_leans_by_pitch_and_brakes() -> None:
    """Roll turns at ACRO_Y_RATE (202.5) / 45 times the lean, less with speed; released, the vehicle stops."""
    copter = flown(DRIFT, 30.0)
    override(copter, 2000, 1500, 1500, 1500)
    copter.run(1.0)
    forward = math.hypot(*copter.v["velocity"][:2])
    assert math.degrees(copter.m["rate_target"][2]) == pytest.approx(30.0 / 45.0 * 202.5, rel=0.02 + forward / 50.0)
    hold(copter, 3.0, 1500, 1300, 1500, 1500)
    assert lean(copter)[1] < -8.0
    speed = math.hypot(*copter.v["velocity"][:2])
    assert speed > 2.0
    hold(copter, 6.0, 1500, 1500, 1500, 1500)
    assert math.hypot(*copter.v["velocity"][:2]) < 0.4
    hover = float(copter.m["throttle_hover"])
    share = min(max(1.2 - abs(hover - 0.5) / 0.24, 0.0), 1.0)
    assert share > 0.0
    copter.tick()
    damped = hover + share * 0.18 * float(copter.v["velocity"][2])  # falling: more throttle
    assert copter.m["throttle_in"] == pytest.approx(damped, abs=0.002)


# ---- POSHOLD -------------------------------------------------------------------------------------------------------


def test_poshold_leans_brakes_and_holds() -> None:
    copter = flown(POSHOLD)
    hold(copter, 4.0, 1500, 1500, 1500, 1500)  # entered in the air: flown by the pilot, then braking
    hold(copter, 2.0, 1500, 1250, 1500, 1500)
    pitch = lean(copter)[1]
    assert pitch == pytest.approx(-30.0 * (250 - 20) / (500 - 20), abs=2.0)  # less the dead zone
    assert math.hypot(*copter.v["velocity"][:2]) > 2.5
    override(copter, 1500, 1500, 1500, 1500)
    braking = hold(copter, 6.0, 1500, 1500, 1500, 1500)
    assert lean(copter)[1] < 10.0
    assert math.hypot(*copter.v["velocity"][:2]) < 0.3
    copter.run(0.5)
    held = hold(copter, 4.0, 1500, 1500, 1500, 1500)
    assert np.ptp(held[:, 1]) < 0.4
    assert np.ptp(held[:, 2]) < 0.2
    assert braking[-1, 3] == pytest.approx(-5.0, abs=0.5)


def test_the_brake_of_poshold_follows_its_law() -> None:
    """-(15 rate + 95) / 100 v (1 + 5 / (v + 0.6)) degrees, by at most PHLD_BRAKE_RATE."""
    copter = flown(POSHOLD, PHLD_BRAKE_RATE=30.0)
    hold(copter, 4.0, 1500, 1500, 1500, 1500)
    hold(copter, 1.0, 1500, 1250, 1500, 1500)
    override(copter, 1500, 1500, 1500, 1500)
    seen = 0
    for _ in range(1200):
        copter.tick()
        before = float(copter.m["hold_brake"][1])
        speed = -float(copter.m["velocity_neu"][0])  # the nose is north
        wanted = -math.radians(5.45) * speed * (1.0 + 5.0 / (abs(speed) + 0.6))
        copter.tick()
        if copter.m["hold_stage"][1] == 1:
            step = math.radians(30.0) * 0.0025
            seen += 1
            reached = max(before - step, min(before + step, wanted))
            assert copter.m["hold_brake"][1] == pytest.approx(min(reached, math.radians(30.0)), abs=0.02 * step + 2e-3)
    assert seen > 100


def test_poshold_learns_the_wind() -> None:
    """Held at rest, the lean balances the wind; it is added to the pilot's."""
    copter = flown(POSHOLD)
    copter.v["wind"][:] = (5.0, 0.0, 0.0)
    hold(copter, 14.0, 1500, 1500, 1500, 1500)
    demanded = float(copter.m["target_acceleration_neu"][0])
    assert demanded < -0.1
    assert copter.m["hold_wind"][0] == pytest.approx(demanded, rel=0.2)
    hold(copter, 1.0, 1700, 1500, 1500, 1500)
    expected = -math.atan(copter.m["hold_wind"][0] / 9.80665)
    assert copter.m["hold_wind_lean"][1] == pytest.approx(expected, rel=0.1)


# ---- ZIGZAG --------------------------------------------------------------------------------------------------------


def at(copter: Copter) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array(copter.v["position"][:2])


def test_zigzag_flies_to_the_lines_of_a_and_b() -> None:
    """To the line through B perpendicular to A-B: along A-B from the present place, by the projection on it."""
    copter = flown(ZIGZAG)
    hold(copter, 3.0, 1500, 1500, 1500, 1500)
    copter.heard.clear()
    assert copter.ask(AUX, 61, 0)[0] == ("ACK", AUX, ACCEPTED)
    a = np.array(copter.m["zigzag_places"][0])
    hold(copter, 3.0, 1500, 1300, 1500, 1500)
    hold(copter, 5.0, 1500, 1500, 1500, 1500)
    assert copter.ask(AUX, 61, 2)[1] == ("TEXT", 6, "ZIGZAG: point B stored")
    b = np.array(copter.m["zigzag_places"][1])
    assert np.linalg.norm(b - a) > 2.0
    hold(copter, 3.0, 1700, 1500, 1500, 1500)
    hold(copter, 5.0, 1500, 1500, 1500, 1500)
    here = np.array(copter.m["desired_position_neu"][:2])
    assert copter.ask(AUX, 61, 0)[1] == ("TEXT", 6, "ZIGZAG: moving to A")
    hold(copter, 8.0, 1500, 1500, 1500, 1500)
    along = (b - a) / np.linalg.norm(b - a)
    expected = here + along * float(np.dot(a - here, along))
    assert at(copter) == pytest.approx(expected, abs=0.4)
    assert (6, "ZIGZAG: manual control") in texts(copter)
    copter.ask(AUX, 61, 2)
    copter.run(0.5)
    assert copter.ask(AUX, 61, 1)[1] == ("TEXT", 6, "ZIGZAG: manual control")  # in the middle: the pilot again
    assert not copter.m["zigzag_moving"]


# ---- stops ---------------------------------------------------------------------------------------------------------


def fast() -> Copter:
    """North at 9.2 m/s, 20 m high, on the body of the recorded flights."""
    copter = Copter(vehicle=preset("ardupilot_sitl_quad"), autopilot=RECORDED_AUTOPILOT).in_the_air(10.0, 14.0)
    for _ in range(6):
        copter.go(10.0, 0.0, 0.0, mask=ONLY_VELOCITY, vx=9.2)
        copter.run(2.0)
    assert copter.v["velocity"][0] == pytest.approx(9.2, abs=0.2)
    return copter


@pytest.mark.parametrize(("mode", "distance"), [(BRAKE, 18.8), (LOITER, 14.7)])
def test_stops_as_recorded(mode: int, distance: float) -> None:
    """ArduCopter 4.7-dev from 9.2 m/s: BRAKE 18.8 m, LOITER 14.7 m."""
    copter = fast()
    speed, begin = float(copter.v["velocity"][0]), float(copter.v["position"][0])
    assert copter.ask(SET_MODE, 1, mode)[0] == ("ACK", SET_MODE, ACCEPTED)
    flight = copter.run(9.0)
    assert abs(flight[-1, 4]) < 0.15
    assert flight[:, 1].max() - begin == pytest.approx(distance * speed / 9.2, rel=0.05)

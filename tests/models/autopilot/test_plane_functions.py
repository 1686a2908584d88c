"""Auxiliary functions that ArduPlane alone has: what acts, and that nothing else is accepted in silence."""

from __future__ import annotations

import math

import pytest

from tests.models.autopilot.test_plane_failsafes import CIRCLE, FBWA, MANUAL, QACRO, QHOVER, QSTABILIZE, hovering
from tests.models.autopilot.test_plane_pilot import angles, course_rate, high, speed, sticks
from tests.models.autopilot.test_rover_failsafes import INFO, texts
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, made
from tests.models.autopilot.test_small_switches import AUX
from tests.models.pair import ACCEPTED, FAILED, Pair

INVERTED, ASSIST, AIR_MODE, EMERGENCY_LANDING, ARM_IN_AIR_MODE = 43, 82, 84, 157, 154
GUIDED = 15
OWN = (22, 64, 86, 87, 88, 89, 91, 95, 106, 155, 160, 173, 176, 180, 208, 209, 210)
SHARED = (9, 11, 19, 27, 30, 40, 62, 85, 100, 101, 102, 103, 104, 105, 110, 112, 113, 162, 163, 164, 172)
GRAVITY = 9.80665


def asked(p: Pair, function: int, position: int) -> list[tuple[int, str]]:
    texts(p)
    assert p.ask(AUX, function, position) == ACCEPTED
    return texts(p)


# ---- no effect -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_what_is_not_on_board_is_told(kind: str) -> None:
    p = made(kind)
    p.until(2.5)
    for function in (*OWN, *((ASSIST, AIR_MODE) if kind == "plane" else ())):
        for position in range(3):
            assert asked(p, function, position) == [(INFO, f"Function {function} does nothing on this vehicle")]
    for function in SHARED:  # at low, they ask for nothing
        for position, told in ((0, False), (1, True), (2, True)):
            text = [(INFO, f"Function {function} does nothing on this vehicle")] if told else []
            assert asked(p, function, position) == text


def test_a_switch_tells_it_too() -> None:
    p = made("plane", pilot={"RC7_OPTION": 88})
    p.until(2.5)
    p.hold(0.5, (1500, 1500, 1000, 1500, 0, 0, 1000), 0.25)
    texts(p)
    p.hold(0.5, (1500, 1500, 1000, 1500, 0, 0, 1900), 0.25)
    assert texts(p) == [(INFO, "Function 88 does nothing on this vehicle")]


# ---- a plane -------------------------------------------------------------------------------------------------------


def test_a_quadplane_flies_inverted_on_its_wing_and_upright_on_its_rotors() -> None:
    p = hovering(QHOVER)
    assert asked(p, INVERTED, 2) == []
    p.until(p.time + 3.0)
    assert abs(angles(p)[0]) < 3.0  # it hovers
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    sticks(p, 25.0, throttle=1900)
    assert abs(angles(p)[0]) == pytest.approx(180.0, abs=3.0)
    assert p.m.motor[4:].max() == 0.0
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED
    sticks(p, 0.1, 1600, 1520, 1700)
    assert p.m.motor[:2].tolist() == pytest.approx([0.6, 0.52])
    p.v.position[2] = -150.0
    assert p.ask(SET_MODE, 1, QHOVER) == ACCEPTED
    p.until(p.time + 8.0)
    assert abs(angles(p)[0]) < 10.0 and p.m.motor[4:].min() > 0.1


def test_inverted_flight_banks_and_turns_as_the_sticks_say() -> None:
    p = high(FBWA)
    assert asked(p, INVERTED, 2) == []
    sticks(p, 8.0, throttle=1700)
    roll, pitch, _ = angles(p)
    assert abs(roll) == pytest.approx(180.0, abs=2.0)
    assert pitch == pytest.approx(0.0, abs=2.0)
    sticks(p, 6.0, roll=1650, throttle=1700)
    roll, _, _ = angles(p)
    bank = (roll % 360.0) - 180.0
    assert bank == pytest.approx(0.3 * 45.0, abs=2.0)
    rate = course_rate(p, 2.0, roll=1650, throttle=1700)
    assert rate > 0.0  # to the right, as upright
    assert rate == pytest.approx(GRAVITY * math.tan(math.radians(bank)) / speed(p), rel=0.35)
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED  # which is never inverted
    sticks(p, 0.1, 1600, 1520, 1700)
    assert p.m.motor[:2].tolist() == pytest.approx([0.6, 0.52])
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    assert asked(p, INVERTED, 0) == []
    sticks(p, 8.0, throttle=1500)
    assert abs(angles(p)[0]) < 3.0


def test_inverted_flight_keeps_its_height_and_circle() -> None:
    p = high(GUIDED)
    height = -p.place[2]
    assert asked(p, INVERTED, 2) == []
    p.until(p.time + 40.0)
    roll, _, _ = angles(p)
    assert abs((roll % 360.0) - 180.0) < 60.0
    assert -p.place[2] == pytest.approx(height, abs=5.0)
    north, east = (float(x) for x in p.m.guided_position[:2])
    assert math.hypot(p.place[0] - north, p.place[1] - east) == pytest.approx(80.0, abs=15.0)


# ---- a quadplane ---------------------------------------------------------------------------------------------------


def on_the_wing() -> Pair:
    p = hovering(CIRCLE)
    while p.m.lift > 0.0 or p.m.vtol:
        p.one_step()
        assert p.time < 60.0
    p.until(p.time + 3.0)
    return p


def test_the_rotors_help_may_be_forced() -> None:
    p = on_the_wing()
    assert p.m.motor[4:8].max() == 0.0
    said = asked(p, ASSIST, 2)
    assert said[0] == (INFO, "QAssist: Force enabled")
    assert said[1][1].startswith("Transition started airspeed 1")
    p.until(p.time + 5.0)
    assert p.m.motor[4:8].min() > 0.1 and p.m.motor[2] > 0.0
    assert speed(p) == pytest.approx(16.0, abs=2.5)
    height = -p.place[2]
    p.until(p.time + 15.0)
    assert p.m.motor[4:8].min() > 0.1
    assert -p.place[2] == pytest.approx(height, abs=2.0)
    assert asked(p, ASSIST, 1)[0] == (INFO, "QAssist: Enabled")
    p.until(p.time + 8.0)
    assert p.m.motor[4:8].max() == 0.0
    assert texts(p)[-1] == (INFO, "Transition done")


@pytest.mark.parametrize(("position", "helps"), [(0, False), (1, True)])
def test_the_rotors_help_may_be_forbidden(position: int, helps: bool) -> None:
    p = on_the_wing()
    assert asked(p, ASSIST, position) == [(INFO, "QAssist: Enabled" if position else "QAssist: Disabled")]
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    p.m.AIRSPEED_MIN = 40.0  # far too slow
    p.until(p.time + 1.0)
    assert (p.m.motor[4:8].max() > 0.0) == helps


@pytest.mark.parametrize("mode", [QSTABILIZE, QACRO])
def test_air_mode_keeps_the_attitude_with_the_throttle_closed(mode: int) -> None:
    p = hovering(mode)
    sticks(p, 0.1, throttle=1000)
    assert p.m.motor[4:8].max() == 0.0
    p = hovering(mode)
    assert asked(p, AIR_MODE, 2) == []
    sticks(p, 0.1, roll=1700, throttle=1000)
    assert p.m.motor[5] > p.m.motor[4] > 0.0  # it rolls to the right, with the least thrust
    assert p.m.lift == 0.0
    assert asked(p, AIR_MODE, 1) == []
    sticks(p, 0.1, throttle=1000)
    assert p.m.motor[4:8].max() > 0.0
    assert asked(p, AIR_MODE, 0) == []
    sticks(p, 0.1, throttle=1000)
    assert p.m.motor[4:8].max() == 0.0


def test_arming_may_begin_air_mode() -> None:
    for by_switch in (True, False):
        p = made("quadplane")
        p.until(2.5)
        assert p.ask(SET_MODE, 1, QHOVER) == ACCEPTED
        assert p.ask(*((AUX, ARM_IN_AIR_MODE, 2) if by_switch else (ARM, 1))) == ACCEPTED
        p.hold(4.0, (1500, 1500, 1900, 1500), 0.25)
        assert -p.place[2] > 2.0
        assert p.ask(SET_MODE, 1, QSTABILIZE) == ACCEPTED
        sticks(p, 0.1, throttle=1000)
        assert (p.m.motor[4:8].max() > 0.0) == by_switch


def test_functions_that_act_say_nothing_and_unknown_ones_are_refused() -> None:
    p = made("plane")
    p.until(2.5)
    assert asked(p, EMERGENCY_LANDING, 2) == [] and p.m.emergency_landing
    assert p.ask(AUX, 211, 2) == FAILED
    assert texts(p) == [(INFO, "Invalid channel option (211)")]

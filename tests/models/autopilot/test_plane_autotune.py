"""AUTOTUNE of planes, and the gains of bank and pitch that it changes."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_plane_failsafes import LOST, short
from tests.models.autopilot.test_plane_pilot import angles, high, speed, sticks
from tests.models.autopilot.test_quadplane_autopilot import hovering
from tests.models.autopilot.test_rover_failsafes import INFO, texts
from tests.models.autopilot.test_small_autopilots import SET_MODE
from tests.models.autopilot.test_small_switches import AUX
from tests.models.pair import ACCEPTED, Pair

CIRCLE, FBWA, AUTOTUNE, RTL, TAKEOFF = 1, 5, 8, 11, 13
ERROR = mavlink.MAV_SEVERITY_ERROR
ENABLE = mavlink.MAV_CMD_DO_AUTOTUNE_ENABLE
BEGINS = [(INFO, "Started autotune"), (INFO, "Autotuning roll pitch yaw")]
GAINS = ("FF", "P", "I", "D", "IMAX")
SHAPES = ("RLL2SRV_TCONST", "RLL2SRV_RMAX", "PTCH2SRV_TCONST", "PTCH2SRV_RMAX_UP", "PTCH2SRV_RMAX_DN")


def gains(p: Pair) -> list[float]:
    names = [f"{axis}_RATE_{gain}" for axis in ("RLL", "PTCH") for gain in GAINS]
    return [float(p.m[name]) for name in (*names, *SHAPES)]


def manoeuvre(p: Pair, throttle: int) -> None:
    """Both sticks far and back, one after the other; the height is given back."""
    for roll in (2000, 1000, 1500):
        sticks(p, 1.6, roll=roll, throttle=throttle)
    for pitch in (1900, 1100, 1500):
        sticks(p, 1.3, pitch=pitch, throttle=throttle)
    p.v.position[2] = -400.0


def tuned(p: Pair, throttle: int) -> list[tuple[int, str]]:
    """Manoeuvres until both axes are finished; what was said."""
    said: list[tuple[int, str]] = []
    for _ in range(25):
        manoeuvre(p, throttle)
        said += texts(p)
        if len([text for _, text in said if "Finished" in text]) == 2:
            return said
    raise AssertionError(said)


def rise(p: Pair) -> tuple[float, float]:
    """Time [s] in which 63 % of a bank of 30 degrees are reached, and the greatest bank in 3 s."""
    sticks(p, 8.0, throttle=1500)
    begin, reached, most = p.time, math.inf, 0.0
    while p.time < begin + 3.0:
        sticks(p, 0.05, roll=1835, throttle=1500)
        bank = angles(p)[0]
        most = max(most, bank)
        if bank > 0.632 * 30.0:
            reached = min(reached, p.time - begin)
    return reached, most


# ---- gains ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tau", "expected"), [(0.5, 0.5), (1.2, 1.25)])
def test_a_bank_is_reached_in_its_time_constant(tau: float, expected: float) -> None:
    p = high(FBWA)
    p.m.RLL2SRV_TCONST, p.m.RLL_RATE_FF, p.m.RLL_RATE_P, p.m.RLL_RATE_I = tau, 0.26, 0.6, 0.2
    assert rise(p)[0] == pytest.approx(expected, abs=0.15)


def test_the_greatest_rates_are_those_of_the_parameters() -> None:
    p = high(FBWA)
    p.m.RLL2SRV_RMAX, p.m.PTCH2SRV_RMAX_UP = 20.0, 6.0
    p.m.RLL_RATE_P, p.m.RLL_RATE_I, p.m.RLL_RATE_FF = 0.6, 0.2, 0.3
    sticks(p, 4.0, throttle=1500)
    sticks(p, 0.5, roll=2000, throttle=1500)
    before = angles(p)[0]
    sticks(p, 1.0, roll=2000, throttle=1500)
    assert angles(p)[0] - before == pytest.approx(20.0, abs=3.5)
    sticks(p, 4.0, throttle=1500)
    climbs = []
    for rate in (6.0, 0.0):
        p.m.PTCH2SRV_RMAX_UP = rate
        sticks(p, 6.0, throttle=1500)
        before = angles(p)[1]
        sticks(p, 1.0, pitch=2000, throttle=1500)
        climbs.append(angles(p)[1] - before)
    assert climbs[0] == pytest.approx(6.0, abs=3.0) and climbs[1] > 12.0


def test_the_integral_holds_a_bank_against_the_rudder() -> None:
    misses = []
    for gain in (0.0, 0.3):
        p = high(FBWA)
        p.m.RLL_RATE_I = gain
        sticks(p, 8.0, yaw=1800, throttle=1500)
        misses.append(abs(angles(p)[0]))
    assert misses[0] > 3.0 and misses[1] < 1.5


def test_too_much_d_shakes_the_ailerons() -> None:
    swings = []
    for gain in (0.0, 0.005, 0.08):
        p = high(FBWA)
        p.m.RLL_RATE_D = gain
        sticks(p, 2.0, roll=1700, throttle=1500)
        moved = 0.0
        for _ in range(80):
            before = float(p.m.motor[0])
            p.one_step()
            moved += abs(float(p.m.motor[0]) - before)
        swings.append(moved)
    assert swings[0] < 0.1 and swings[1] < 0.2 < 2.0 < swings[2]


# ---- the mode ------------------------------------------------------------------------------------------------------


def test_it_flies_as_fbwa_and_says_that_it_begins_and_ends() -> None:
    p = high(FBWA)
    texts(p)
    assert p.ask(SET_MODE, 1, AUTOTUNE) == ACCEPTED
    assert texts(p) == BEGINS
    sticks(p, 5.0, roll=1700, pitch=1600, throttle=1600)
    assert angles(p)[0] == pytest.approx(0.4 * 45.0, abs=0.5)
    sticks(p, 8.0, roll=1700, pitch=1600, throttle=1600)
    assert angles(p)[1] == pytest.approx(0.2 * 20.0, abs=0.7)
    assert (p.last("HEARTBEAT").custom_mode, p.last("HEARTBEAT").base_mode & 64) == (8, 64)
    assert p.ask(SET_MODE, 1, CIRCLE) == ACCEPTED
    assert texts(p) == [(INFO, "Stopped autotune")]


def test_it_finds_gains_with_which_a_bank_takes_its_time_constant() -> None:
    p = high(FBWA)
    p.v.position[2] = -400.0
    sticks(p, 8.0, throttle=1450)
    before = gains(p)
    texts(p)
    assert p.ask(SET_MODE, 1, AUTOTUNE) == ACCEPTED
    assert texts(p) == BEGINS
    said = tuned(p, 1450)
    assert {severity for severity, _ in said} == {ERROR}
    for axis in ("Roll", "Pitch"):
        (*found, last) = [text for _, text in said if text.startswith(axis)]
        assert last == f"{axis}: Finished"
        assert any(text.startswith(f"{axis}D: 0.") for text in found)
        assert any(text.startswith(f"{axis}P: ") for text in found)
    after = gains(p)
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    assert texts(p) == [(INFO, "Stopped autotune")]
    assert gains(p) == after != before
    # AUTOTUNE_LEVEL 6: 0.5 s and 75 degrees per second, half as long again for the pitch
    assert [float(p.m[name]) for name in SHAPES] == pytest.approx([0.5, 75.0, 0.75, 75.0, 75.0])
    assert pytest.approx(min(p.m.RLL_RATE_P, p.m.RLL_RATE_FF)) == p.m.RLL_RATE_I
    assert pytest.approx(max(0.75 * p.m.PTCH_RATE_P, p.m.PTCH_RATE_FF)) == p.m.PTCH_RATE_I
    roll_d = [text for _, text in said if text.startswith("RollD")][-1]
    assert float(roll_d.split()[1]) == pytest.approx(p.m.RLL_RATE_D, abs=5e-5)
    # of an Aerosonde at this speed: the deflection that holds a rate of roll against the damping
    steady = -p.v.roll_p / (p.v.roll_aileron * p.v.deflection_max) * 0.5 * p.v.wing_span / speed(p) / (4.0 / math.pi)
    assert pytest.approx(steady, rel=0.35) == p.m.RLL_RATE_FF
    time, most = rise(p)
    assert time == pytest.approx(0.5, abs=0.1) and most < 31.0


def test_a_quadplane_is_tuned_on_its_wing() -> None:
    p = hovering()
    assert p.ask(SET_MODE, 1, TAKEOFF) == ACCEPTED
    p.until(70.0)
    p.v.position[2] = -400.0
    assert p.ask(SET_MODE, 1, AUTOTUNE) == ACCEPTED
    texts(p)
    tuned(p, 1750)
    assert p.m.motor[4:].max() == 0.0
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    assert p.m.RLL_RATE_P > 0.3 and p.m.PTCH_RATE_P > 0.3


def test_gains_that_are_not_found_are_forgotten() -> None:
    p = high(AUTOTUNE)
    began = gains(p)
    for _ in range(4):
        manoeuvre(p, 1450)
    changed = gains(p)
    assert changed[0] < began[0] and changed[1] < 0.6 * began[1]  # P is halved when the feed-forward is known
    fresh = gains(high(FBWA))
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    assert gains(p) == fresh


@pytest.mark.parametrize(
    ("axes", "text", "moved"),
    [(1, "Autotuning roll ", (True, False)), (6, "Autotuning pitch yaw", (False, True)), (4, "Autotuning yaw", ())],
)
def test_axes_are_those_of_the_parameter(axes: int, text: str, moved: tuple[bool, ...]) -> None:
    p = high(FBWA)
    p.m.AUTOTUNE_AXES = axes
    before = gains(p)
    texts(p)
    assert p.ask(SET_MODE, 1, AUTOTUNE) == ACCEPTED
    assert texts(p) == [(INFO, "Started autotune"), (INFO, text)]
    for _ in range(3):
        manoeuvre(p, 1450)
    after = gains(p)
    changed = [any(a != b for a, b in zip(after[i : i + 4], before[i : i + 4], strict=True)) for i in (0, 5)]
    assert changed == (list(moved) or [False, False])
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    p.m.AUTOTUNE_AXES = 0
    texts(p)
    assert p.ask(SET_MODE, 1, AUTOTUNE) == ACCEPTED
    assert texts(p) == [(INFO, "No axis selected for tuning!")]
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    assert texts(p) == []


@pytest.mark.parametrize(("level", "tau", "rate"), [(1, 0.575, 55.0), (8, 0.425, 95.0), (0, 0.5, 75.0)])
def test_levels_are_approached_in_steps(level: int, tau: float, rate: float) -> None:
    """At most 15 % of the time constant and 20 degrees per second, from 75, at once."""
    p = high(FBWA)
    p.m.AUTOTUNE_LEVEL = level
    p.m.RLL2SRV_RMAX = 75.0
    assert p.ask(SET_MODE, 1, AUTOTUNE) == ACCEPTED
    assert pytest.approx((tau, rate)) == (p.m.RLL2SRV_TCONST, p.m.RLL2SRV_RMAX)


def switched(p: Pair, on: bool) -> Any:
    return p.ask(AUX, 107, 2.0 if on else 0.0)


def commanded(p: Pair, on: bool) -> Any:
    return p.ask(ENABLE, 1.0 if on else 0.0)


@pytest.mark.parametrize("enable", [switched, commanded])
def test_it_also_tunes_modes_that_fly_by_themselves(enable: Any) -> None:
    p = high(CIRCLE)
    texts(p)
    assert enable(p, True) == ACCEPTED
    assert texts(p) == BEGINS
    assert p.m.mode == CIRCLE and p.m.tuning == 3
    assert enable(p, False) == ACCEPTED
    assert texts(p) == [(INFO, "Stopped autotune")]
    assert enable(p, False) == ACCEPTED
    assert texts(p) == [] and p.m.tuning == 0
    assert enable(p, True) == ACCEPTED
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    assert p.m.tuning == 0


def test_a_lost_radio_ends_it() -> None:
    p = high(AUTOTUNE)
    p.m.SIM_RC_FAIL = 1
    texts(p)
    p.until(p.time + 4.0)
    assert texts(p) == [LOST, (INFO, "Stopped autotune"), short(CIRCLE)]
    assert p.m.mode == CIRCLE

"""AUTOLAND of planes, by ArduPlane's sources: when it begins, its circle, final and flare, and its texts."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import pytest

from tests.models.autopilot.test_plane_failsafes import BACK, LOST, NAMES, long, said, short, with_values
from tests.models.autopilot.test_plane_pilot import high
from tests.models.autopilot.test_rover_failsafes import INFO, WARNING, texts
from tests.models.autopilot.test_small_autopilots import ARM, KINDS, SET_MODE, made
from tests.models.copter import preset
from tests.models.pair import ACCEPTED, FAILED, Pair

MANUAL, CIRCLE, FBWA, CRUISE, RTL, TAKEOFF, GUIDED, AUTOLAND = 0, 1, 5, 7, 11, 13, 15, 26
NAMES[AUTOLAND] = "AUTOLAND"
CHANGE_FAILED = (WARNING, "Flight mode change failed")
NO_DIRECTION = (WARNING, "Takeoff initial direction not set")


def worded(text: str) -> str:
    return re.sub(r"-?\d+(\.\d+)?", "#", text)


@dataclass
class Landing:
    """What happened until the plane was disarmed."""

    said: list[str] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)  # on the final: along it and above, from its point
    astray: float = 0.0  # m, from the line, on the final
    banked: list[float] = field(default_factory=list)  # of the circle: signs of the rates of turn
    touched: float = math.nan  # m/s, downwards
    stopped: float = math.nan  # s, on the ground and slower than 1.5 m/s


def land(
    p: Pair, heading: float = 0.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0), within: float = math.inf
) -> Landing:
    """Flies until it is disarmed.

    Args:
        heading: of the final, degrees.
        at: the landing point.
        within: m before it, in which the distance from the line counts.
    """
    c, s = math.cos(math.radians(heading)), math.sin(math.radians(heading))
    found = Landing()
    end = p.time + 400.0
    while p.m.armed:
        p.one_step()
        assert p.time < end
        found.said += [text for _, text in texts(p)]
        n, e, d = (float(one) - other for one, other in zip(p.place, at, strict=True))
        ahead, right = n * c + e * s, e * c - n * s
        if "Loiter to alt complete" not in found.said and p.m.landing_stage < 3:
            found.banked.append(float(p.v.angular_velocity[2]))
        elif not math.isfinite(found.touched):
            found.heights.append((ahead, -d))
            if ahead > -within:
                found.astray = max(found.astray, abs(right))
            if d > -0.05:
                found.touched = float(p.v.velocity[2])
        if p.m.on_ground and math.hypot(*p.v.velocity[:2]) < 1.5 and not math.isfinite(found.stopped):
            found.stopped = p.time
    found.stopped = p.time - found.stopped
    p.until(p.time + 0.2)
    found.said += [text for _, text in texts(p)]
    return found


def of_ardupilot() -> Pair:
    """The plane of ArduPilot's simulation, on the ground."""
    pilot = {"AIRSPEED_CRUISE": 16.0, "AIRSPEED_MIN": 12.0, "AIRSPEED_MAX": 20.0, "THR_MAX": 100.0}
    kind = KINDS["plane"]
    p = Pair(kind.vehicle, kind.autopilot, preset("ardupilot_plane"), pilot | {"TKOFF_THR_MAX": 100.0})
    p.until(2.5)
    return p


WORDS = [
    "Loiter to alt complete",
    "Landing approach start at #m",
    "Landing glide slope # degrees",
    "Flare #m sink=# speed=# dist=#",
    "Throttle disarmed",
    "Auto disarmed",
    "Distance from LAND point=#m",
]


@pytest.mark.parametrize("side", [80.0, -80.0])
def test_it_lands_at_home_in_the_direction_of_its_take_off(side: float) -> None:
    p = high(GUIDED)
    assert p.reposition(-200.0, side, 80.0) == ACCEPTED
    p.until(p.time + 30.0)
    texts(p)
    assert p.ask(SET_MODE, 1, AUTOLAND) == ACCEPTED
    assert p.m.landing_circle.tolist()[:2] == pytest.approx([-400.0, math.copysign(80.0, p.place[1])], abs=0.5)
    right = p.m.landing_circle[2] > 0.0
    assert right == (p.place[1] > 0.0)
    found = land(p)
    assert [worded(text) for text in found.said] == WORDS
    turns = found.banked[-800:]  # the last 10 s of the circle
    assert (sum(turns) > 0.0) == right
    assert found.astray < 8.0
    slope = math.tan(math.radians(8.7))
    for ahead, height in found.heights:
        if -300.0 < ahead < -90.0:  # through 6 m, 72 m before home
            assert height == pytest.approx(6.0 + slope * (-ahead - 72.0), abs=3.0)
    assert found.touched < 1.8
    assert -40.0 < found.heights[-1][0] < 60.0
    assert found.stopped == pytest.approx(3.0 + 20.0, abs=0.15)  # s until it counts as standing, LAND_DISARMDELAY
    distance = float(found.said[-1].split("=")[1].rstrip("m"))
    assert distance == pytest.approx(math.hypot(*p.place[:2]), abs=0.01)


def test_another_direction_and_another_final() -> None:
    p = high(GUIDED)
    p.m.direction = math.radians(90.0)
    for name, value in {"AUTOLAND_WP_ALT": 40.0, "AUTOLAND_WP_DIST": 600.0, "LAND_DISARMDELAY": 5.0}.items():
        p.m[name] = value
    assert p.ask(SET_MODE, 1, AUTOLAND) == ACCEPTED
    found = land(p, 90.0)
    assert found.said[1] in [f"Landing approach start at {height}m" for height in (39.9, 40.0, 40.1)]
    assert found.astray < 8.0 and found.touched < 1.8
    assert found.stopped == pytest.approx(3.0 + 5.0, abs=0.15)


def test_the_plane_of_ardupilot_lands() -> None:
    p = of_ardupilot()
    assert p.ask(SET_MODE, 1, TAKEOFF) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p.until(40.0)
    assert p.ask(SET_MODE, 1, AUTOLAND) == ACCEPTED
    texts(p)
    found = land(p)
    assert [worded(text) for text in found.said] == WORDS
    assert found.touched < 1.2 and found.astray < 9.0  # its circle is 8 m wider than the one whose tangent is the final


# ---- its beginning -------------------------------------------------------------------------------------------------


def took_off(mode: int = TAKEOFF, **values: float) -> Pair:
    p = made("plane", pilot=values)
    p.until(2.5)
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    texts(p)
    assert p.ask(ARM, 1) == ACCEPTED
    return p


@pytest.mark.parametrize(
    ("values", "direction"),
    [
        ({}, "Autoland direction= 0"),
        ({"AUTOLAND_DIR_OFF": -30.0}, "Autoland direction= 330"),
        ({"AUTOLAND_OPTIONS": 1, "AUTOLAND_DIR_OFF": -30.0}, "Autoland direction= 0"),
    ],
)
def test_the_direction_is_that_of_the_take_off(values: dict[str, float], direction: str) -> None:
    p = took_off(**values)
    at_once = "AUTOLAND_OPTIONS" in values
    assert texts(p) == [(INFO, direction)] * at_once + [(INFO, "Throttle armed")]
    p.until(7.0)
    assert texts(p) == [
        (INFO, "Armed AUTO, xaccel = 0.0 m/s/s, waiting 0.2 sec"),
        (INFO, "Triggered AUTO. GPS speed = 0.0"),
        (INFO, "Takeoff to 50m for 200.0m heading 0.0 deg"),
        *[(INFO, direction)] * (not at_once),
    ]
    assert p.ask(ARM, 0, 21196) == ACCEPTED
    p.until(p.time + 0.2)
    assert not p.m.direction_known


def test_it_is_refused_on_the_ground_and_without_a_direction() -> None:
    p = took_off(MANUAL)
    texts(p)
    assert p.ask(SET_MODE, 1, AUTOLAND) == FAILED
    assert texts(p) == [(WARNING, "Must already be flying!"), CHANGE_FAILED]
    p = high(GUIDED)
    p.m.direction_known = False
    p.until(p.time + 1.0)
    assert texts(p) == []  # the course of GUIDED does not count
    assert p.ask(SET_MODE, 1, AUTOLAND) == FAILED
    assert texts(p) == [NO_DIRECTION, CHANGE_FAILED]
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    p.until(p.time + 0.2)
    assert [worded(text) for _, text in texts(p)] == ["Autoland direction= #"]
    assert p.ask(SET_MODE, 1, AUTOLAND) == ACCEPTED


# ---- fail-safes ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("known", "other", "refusal"), [(True, AUTOLAND, []), (False, RTL, [NO_DIRECTION, CHANGE_FAILED])]
)
def test_a_long_loss_of_the_radio_may_lead_to_it(known: bool, other: int, refusal: list[tuple[int, str]]) -> None:
    p = high(GUIDED)
    p.m.direction_known = known
    assert p.ask(SET_MODE, 1, CRUISE) == ACCEPTED
    with_values(p, FS_LONG_ACTN=5, fail=1)
    assert said(p, 7.0) == [LOST, short(CIRCLE), *refusal, long(other)]
    assert p.m.mode == other


def test_it_goes_on_without_a_radio_and_with_a_low_battery() -> None:
    p = high(GUIDED)
    assert p.ask(SET_MODE, 1, AUTOLAND) == ACCEPTED
    with_values(p, FS_SHORT_ACTN=0, BATT_FS_LOW_ACT=1, BATT_LOW_MAH=100.0, battery_used=3201.0, fail=2)
    found = said(p, 6.0)
    assert [text for text in found if "Battery" not in text[1]] == [LOST, short(AUTOLAND, False), long(AUTOLAND)]
    assert p.m.mode == AUTOLAND
    p.m.SIM_RC_FAIL = 0
    assert said(p, 1.0) == [BACK, (WARNING, "RC Long Failsafe Cleared")]
    while p.m.landing_stage < 2:
        p.one_step()
    with_values(p, FS_SHORT_ACTN=1, FS_LONG_ACTN=1, FS_LONG_TIMEOUT=2.0, fail=2)
    assert [text for text in said(p, 4.0) if "anding" not in text[1]] == [LOST]  # on the final nothing acts
    assert p.m.mode == AUTOLAND


# ---- other modes that are refused ----------------------------------------------------------------------------------


def test_nothing_soars() -> None:
    p = high(GUIDED)
    texts(p)
    assert p.ask(SET_MODE, 1, 24) == FAILED
    assert texts(p) == [CHANGE_FAILED]
    assert p.m.mode == GUIDED

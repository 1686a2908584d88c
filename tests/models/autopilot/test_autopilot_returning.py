"""SMART_RTL along the flown path, and AUTO_RTL by the landing sequence of the mission."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.flight.returning.breadcrumbs import clean_path, forget_path, keep_point, record_path
from tests.models.autopilot.test_autopilot_missions import AUTO, HOME, item, upload
from tests.models.copter import ACCEPTED, FAILED, LAND, Copter
from tests.models.pilot import texts

SMART_RTL, AUTO_RTL = 21, 27
SET_MODE, LAND_START = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_LAND_START
REFUSED = ("ACK", SET_MODE, FAILED)


def path_of(record: Any) -> np.ndarray[Any, Any]:
    return np.array(record["crumbs"][: int(record["crumb_count"])])


def distance_to(path: np.ndarray[Any, Any], points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Distances of points from a polyline."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(path):
        share = np.clip(((points - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)[:, None]
        best = np.minimum(best, np.linalg.norm(points - (a + share * (b - a)), axis=1))
    return best


# ---- the path ------------------------------------------------------------------------------------------------------


def recorded(points: np.ndarray[Any, Any], **parameters: float) -> Any:
    """A record in which the vehicle has been at `points` (n, 3), a third of a second after each other."""
    m = Autopilot.record()
    for name, value in parameters.items():
        m[name] = value
    m["position_neu"][:] = points[0]
    forget_path(m, 0.0, True)
    for i, point in enumerate(points[1:], 1):
        m["position_neu"][:] = point
        if m["crumbs_on"]:
            record_path(m, True, i / 3.0 + 0.001)
    return m


def simplified(points: np.ndarray[Any, Any], epsilon: float) -> np.ndarray[Any, Any]:
    """Ramer, Douglas and Peucker's algorithm, independently."""
    if len(points) < 3:
        return points
    off = distance_to(points[[0, -1]], points[1:-1])
    if off.max() <= epsilon:
        return points[[0, -1]]
    at = int(off.argmax()) + 1
    return np.concatenate([simplified(points[: at + 1], epsilon)[:-1], simplified(points[at:], epsilon)])


def test_a_path_is_simplified_as_by_ramer_douglas_and_peucker() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(45)
    points = np.stack([3.0 * t, 10.0 * np.sin(0.15 * t) + rng.normal(0.0, 0.3, 45), 10.0 + 0.1 * t], axis=1)
    m = recorded(points)
    assert len(path_of(m)) == 45  # farther apart than SRTL_ACCURACY, fewer than 50
    clean_path(m)
    expected = simplified(points, 1.0)
    assert 4 < len(expected) < 30
    assert path_of(m) == pytest.approx(expected, abs=1e-12)


def test_points_are_apart_and_fifty_new_ones_begin_a_simplification() -> None:
    line = np.stack([0.5 * np.arange(240), np.zeros(240), np.full(240, 10.0)], axis=1)
    m = recorded(line[:160])
    gaps = np.linalg.norm(np.diff(path_of(m), axis=0), axis=1)
    assert gaps == pytest.approx(2.0)
    assert len(gaps) == 39
    m = recorded(line)
    assert len(path_of(m)) == 2 + (60 - 50)  # a straight line: its ends, and those since
    clean_path(m)
    assert path_of(m) == pytest.approx(line[[0, 196, 236]])  # it goes on where it ended before


def test_loops_are_left_out() -> None:
    """A square about the way out: the path from its crossing on is left out, up to the crossing."""
    corners = np.array([[0, 0], [40, 0], [40, 20], [20, 20], [20, -20.0]])
    points = np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in pairwise(corners)])
    points = np.column_stack([points, np.full(len(points), 12.0)])
    m = recorded(points)
    clean_path(m)
    assert path_of(m) == pytest.approx(np.array([[0, 0, 12.0], [20, 0, 12.0], points[-1]]), abs=1e-9)


def test_a_path_that_is_too_long_is_given_up() -> None:
    rng = np.random.default_rng(5)
    spiral = np.cumsum(rng.normal((0.0, 0.0, 6.0), 4.0, (120, 3)), axis=0)  # nothing to simplify, no loops
    m = recorded(spiral, SRTL_POINTS=30)
    assert m["crumb_count"] <= 30
    assert not m["crumbs_on"]
    assert m["text_count"] == 1
    assert not keep_point(m, 1e4, 0.0, 0.0)
    lost = recorded(spiral[:3])
    record_path(lost, False, 17.0)
    assert not lost["crumbs_on"]
    assert not recorded(spiral[:3], SRTL_POINTS=0)["crumbs_on"]


# ---- SMART_RTL -----------------------------------------------------------------------------------------------------


def test_smart_rtl_returns_along_the_path_and_lands() -> None:
    copter = Copter(autopilot={"WPNAV_SPEED": 800.0}).in_the_air(6.0, 10.0)
    copter.go(25.0, 0.0, -6.0)
    out = [copter.run(9.0)]
    copter.go(25.0, 25.0, -9.0)
    out.append(copter.run(9.0))
    flown = np.concatenate(out)[::40, 1:4] * (1.0, 1.0, -1.0)
    copter.heard.clear()
    assert copter.ask(SET_MODE, 1, SMART_RTL)[0] == ("ACK", SET_MODE, ACCEPTED)
    flight = copter.run(22.0)
    back = flight[:, 1:4] * (1.0, 1.0, -1.0)
    low = back[:, 2] > 5.0
    near = distance_to(np.concatenate([[[0.0, 0.0, 6.0]], flown, [[25.0, 25.0, 9.0]]]), back[low])
    assert near.max() < 2.5
    assert distance_to(np.array([[0.0, 0.0, 6.0], [25.0, 25.0, 9.0]]), back).max() > 10.0  # no short cut
    assert np.hypot(*back[-1, :2]) < 1.0
    copter.run(22.0)
    assert not copter.m["armed"]
    assert np.hypot(*copter.v["position"][:2]) < 1.0


def test_smart_rtl_gives_its_point_back_and_needs_a_path() -> None:
    copter = Copter(autopilot={"RTL_ALT_FINAL": 400.0}).in_the_air(6.0, 10.0)
    copter.go(30.0, 0.0, -6.0)
    copter.run(10.0)
    copter.ask(SET_MODE, 1, SMART_RTL)
    copter.run(1.5)
    taken, count = np.array(copter.m["crumb_place"]), int(copter.m["crumb_count"])
    assert copter.ask(SET_MODE, 1, 4)[0][2] == ACCEPTED
    assert path_of(copter.m)[count] == pytest.approx(taken)
    assert copter.ask(SET_MODE, 1, SMART_RTL)[0][2] == ACCEPTED
    copter.run(26.0)
    assert copter.v["position"] == pytest.approx([0.0, 0.0, -4.0], abs=0.5)  # RTL_ALT_FINAL
    off = Copter(autopilot={"SRTL_POINTS": 0}).in_the_air(6.0, 10.0)
    assert off.ask(SET_MODE, 1, SMART_RTL) == [REFUSED, ("TEXT", 4, "Mode change to SMART_RTL failed: init failed")]
    ground = Copter()
    ground.run(2.1)
    assert ground.ask(SET_MODE, 1, SMART_RTL)[0][2] == ACCEPTED
    answer = ground.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert answer[1] == ("TEXT", 2, "Arm: SMART_RTL mode not armable")


# ---- AUTO_RTL ------------------------------------------------------------------------------------------------------


def mode_told(copter: Copter) -> int:
    return int(copter.messages("HEARTBEAT")[-1].custom_mode)


def test_auto_rtl_flies_the_nearest_landing_sequence() -> None:
    copter = Copter().in_the_air(6.0, 10.0)
    plan = (
        HOME,
        item(1, 16, north=10.0, z=6.0),
        item(2, LAND_START, north=60.0, z=6.0),
        item(3, 16, north=60.0, z=6.0),
        item(4, LAND_START),
        item(5, 16, north=8.0, east=8.0, z=6.0),
        item(6, mavlink.MAV_CMD_NAV_LAND, north=8.0, east=8.0),
    )
    upload(copter, *plan)
    copter.heard.clear()
    assert copter.ask(SET_MODE, 1, AUTO_RTL)[0] == ("ACK", SET_MODE, ACCEPTED)
    copter.run(1.1)
    assert copter.m["mission_current"] == 5
    assert mode_told(copter) == AUTO_RTL
    assert copter.m["mode"] == AUTO
    copter.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1)
    copter.run(1.1)
    assert mode_told(copter) == AUTO  # no longer in a landing sequence
    assert copter.ask(LAND_START)[0] == ("ACK", LAND_START, ACCEPTED)
    copter.run(1.1)
    assert mode_told(copter) == AUTO_RTL
    copter.run(30.0)
    assert not copter.m["armed"]
    assert np.hypot(copter.v["position"][0] - 8.0, copter.v["position"][1] - 8.0) < 1.0


def test_auto_rtl_needs_a_landing_sequence() -> None:
    copter = Copter().in_the_air(6.0, 10.0)
    upload(copter, HOME, item(1, 16, north=10.0, z=6.0))
    copter.heard.clear()
    assert copter.ask(SET_MODE, 1, AUTO_RTL) == [
        REFUSED,
        ("TEXT", 4, "Unable to start landing sequence"),
        ("TEXT", 4, "Mode change to AUTO RTL failed: No return path or "),
        ("TEXT", 4, "landing sequence found"),
    ]
    assert copter.m["mode"] == 4
    copter.ask(SET_MODE, 1, LAND)
    assert texts(copter) == []


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (15, ["Mode change to AUTOTUNE failed: init failed"]),
        (22, ["Mode change to FLOWHOLD failed: init failed"]),
        (23, ["Set FOLL_ENABLE = 1", "Mode change to FOLLOW failed: init failed"]),
        (25, ["No axis selected, SID_AXIS = 0", "Mode change to SYSTEMID failed: init failed"]),
        (26, ["No such mode 26"]),
        (28, ["Mode change to TURTLE failed: init failed"]),
    ],
)
def test_other_modes_are_refused_with_arducopters_words(number: int, words: list[str]) -> None:
    copter = Copter()
    copter.run(2.1)
    assert copter.ask(SET_MODE, 1, number) == [REFUSED, *(("TEXT", 4, text) for text in words)]

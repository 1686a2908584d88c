"""The quadplane: vertical take-offs and landings, hovering at places, and the wing over longer distances."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import euler_from_quaternion, quaternion_from_euler
from cosim_models.autopilot.quadplane_autopilot import QuadplaneAutopilot
from cosim_models.autopilot.wing.returning import approach_height
from cosim_models.vehicles.quadplane import Quadplane
from tests.models.autopilot.test_small_autopilots import ARM, REQUEST, SET_MODE, SPEED, TAKEOFF, WAYPOINT, upload
from tests.models.copter import preset
from tests.models.pair import ACCEPTED, DENIED, FAILED, Pair

GUIDED, AUTO, QHOVER, QLOITER, QLAND, QRTL = 15, 10, 18, 19, 20, 21
TRANSITION, VTOL_TAKEOFF, VTOL_LAND = (
    mavlink.MAV_CMD_DO_VTOL_TRANSITION,
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF,
    mavlink.MAV_CMD_NAV_VTOL_LAND,
)


def started(**more: Any) -> Pair:
    """Armed in GUIDED."""
    p = Pair(Quadplane, QuadplaneAutopilot, **more)
    p.until(2.5)
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == FAILED
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == FAILED  # not armed
    assert p.ask(ARM, 1) == ACCEPTED
    return p


def hovering(**more: Any) -> Pair:
    p = started(**more)
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == ACCEPTED
    p.until(16.0)
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == FAILED  # it flies
    return p


def farthest(p: Pair, seconds: float) -> tuple[float, float, float, float]:
    """Lowest and highest height, greatest speed, and least of the lifting motors' greatest command meanwhile."""
    end, found = p.time + seconds, (math.inf, 0.0, 0.0, math.inf)
    while p.time < end:
        p.one_step()
        up, fast = -p.place[2], math.hypot(*p.v.velocity[:2])
        found = min(found[0], up), max(found[1], up), max(found[2], fast), min(found[3], float(p.v.motor[4:].max()))
    return found


def state(p: Pair) -> int:
    """MAV_VTOL_STATE of EXTENDED_SYS_STATE."""
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE) == ACCEPTED
    return int(p.last("EXTENDED_SYS_STATE").vtol_state)


def test_it_takes_off_vertically_and_moves_on_its_rotors_to_a_place_near_by() -> None:
    p = hovering()
    assert p.place == pytest.approx([0.0, 0.0, -10.0], abs=0.3)
    assert p.reposition(0.0, 20.0, 10.0) == ACCEPTED
    lowest, highest, fastest, least = farthest(p, 16.0)
    assert p.place == pytest.approx([0.0, 20.0, -10.0], abs=0.15)
    assert lowest > 9.0 and highest < 11.0 and fastest < 5.5 and least > 0.15
    assert p.ask(SET_MODE, 1, QLAND) == ACCEPTED
    while p.m.armed:
        p.one_step()
        assert p.time < 60.0
    assert p.place == pytest.approx([0.0, 20.0, 0.0], abs=0.3)
    assert not p.m.motor[4:].any()


def test_it_holds_its_place_in_wind() -> None:
    p = hovering(wind=(-4.0, 1.0, 0.0))
    assert p.ask(SET_MODE, 1, QLOITER) == ACCEPTED
    p.until(26.0)
    place = p.place
    p.until(36.0)
    assert math.dist(p.place, place) < 0.3
    assert p.ask(SET_MODE, 1, QHOVER) == ACCEPTED  # keeps its height, and lets itself be blown away
    p.until(44.0)
    assert math.dist(p.place[:2], place[:2]) > 2.0
    assert -p.place[2] == pytest.approx(10.0, abs=0.5)


def test_it_flies_to_a_distant_place_on_its_wing_hovers_there_and_returns() -> None:
    p = hovering()
    assert state(p) == mavlink.MAV_VTOL_STATE_MC
    assert p.reposition(300.0, -80.0, 25.0) == ACCEPTED
    p.until(18.0)
    assert state(p) == mavlink.MAV_VTOL_STATE_TRANSITION_TO_FW
    p.until(27.0)
    assert state(p) == mavlink.MAV_VTOL_STATE_FW
    _, highest, fastest, least = farthest(p, 41.0)
    assert state(p) == mavlink.MAV_VTOL_STATE_MC
    assert least == 0.0  # the wing carries it alone
    assert 12.0 < fastest < 17.0 and highest < 30.0
    assert p.place == pytest.approx([300.0, -80.0, -25.0], abs=0.3)
    assert p.ask(SET_MODE, 1, QRTL) == ACCEPTED
    while p.m.armed:
        p.one_step()
        assert p.time < 180.0
    assert p.place == pytest.approx([0.0, 0.0, 0.0], abs=0.3)


def test_it_flies_a_mission_that_begins_and_ends_vertically() -> None:
    p = started()
    assert p.ask(TRANSITION, 3) == FAILED  # only in AUTO
    mission = [
        (VTOL_TAKEOFF, 0.0, 0.0, 15.0, (0.0, 0.0)),
        (WAYPOINT, 250.0, 0.0, 25.0, (0.0, 0.0)),
        (VTOL_LAND, 120.0, 60.0, 0.0, (0.0, 0.0)),
    ]
    assert upload(p, mission) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    assert p.ask(TRANSITION, 7) == FAILED
    p.heard.clear()
    while p.m.armed:
        p.one_step()
        assert p.time < 160.0
    assert [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1, 2]
    assert p.place == pytest.approx([120.0, 60.0, 0.0], abs=0.5)


def test_in_auto_it_flies_on_its_rotors_if_it_is_told_so() -> None:
    p = hovering()
    assert upload(p, [(WAYPOINT, 95.0, 0.0, 10.0, (0.0, 0.0)), (WAYPOINT, 95.0, 250.0, 10.0, (0.0, 0.0))]) == 0
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    assert p.ask(TRANSITION, 3) == ACCEPTED
    p.heard.clear()
    _, _, fastest, least = farthest(p, 28.0)
    assert [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1]
    assert fastest < 5.5 and least > 0.15
    assert p.ask(TRANSITION, 4) == ACCEPTED
    assert farthest(p, 14.0)[3] == 0.0


def test_without_guided_mode_it_circles_its_target_as_a_fixed_wing_does() -> None:
    p = hovering(pilot={"Q_GUIDED_MODE": 0, "Q_MAV_TYPE": 0})
    assert p.last("HEARTBEAT").type == mavlink.MAV_TYPE_FIXED_WING
    assert p.reposition(100.0, 0.0, 30.0) == ACCEPTED
    p.until(70.0)
    for _ in range(10):
        p.until(p.time + 1.0)
        assert 80.0 < math.dist(p.place[:2], (100.0, 0.0)) < 97.0  # ArduPlane's plane: 97
        assert -p.place[2] == pytest.approx(30.0, abs=1.5)
    assert p.ask(SPEED, 0, 18.0) == ACCEPTED
    assert p.ask(SPEED, 0, 9.0) == DENIED


def test_it_takes_off_on_its_wheels_in_mode_takeoff() -> None:
    p = started()
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    assert farthest(p, 16.0)[3] == 0.0
    assert -p.place[2] > 20.0


# ---- what it tells, and motors that are tested: as a simulated ArduPlane 4.7-dev was heard to do ---------------------


def texts(p: Pair) -> list[str]:
    """Texts since the last call, with their figures replaced by #."""
    found = [re.sub(r"-?\d+(\.\d+)?", "#", m.text) for m in p.heard if m.get_type() == "STATUSTEXT"]
    p.heard.clear()
    return found


def test_it_tells_why_it_does_not_take_off() -> None:
    p = Pair(Quadplane, QuadplaneAutopilot)
    p.until(2.5)
    said = []
    for mode, arms in ((0, False), (GUIDED, False), (GUIDED, True)):
        assert p.ask(SET_MODE, 1, mode) == ACCEPTED
        if arms:
            assert p.ask(ARM, 1) == ACCEPTED
            assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == ACCEPTED
            assert "VTOL Position# d=#" in texts(p)
        assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == FAILED
        said += texts(p)
    assert said == ["User Takeoff only in GUIDED mode", "Must be armed for takeoff", "Already flying - no takeoff"]


@pytest.mark.parametrize(
    ("east", "values", "height"),
    [
        (0.0, {}, 10.0),  # Q_RTL_ALT_MIN
        (0.0, {"Q_RTL_ALT_MIN": 2.0}, 6.0),  # Q_LAND_FINAL_ALT
        (0.0, {"Q_RTL_ALT_MIN": 90.0}, 15.0),  # Q_RTL_ALT
        (60.0, {"Q_RTL_ALT": 30.0}, 15.0),  # half of 1.5 times WP_LOITER_RAD: half of the height
        (60.0, {"Q_RTL_ALT": 30.0, "Q_RTL_ALT_MIN": 20.0}, 20.0),
    ],
)
def test_it_climbs_before_it_returns(east: float, values: dict[str, float], height: float) -> None:
    p = started(pilot=values)
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 4.0) == ACCEPTED
    p.until(12.0)
    if east:
        assert p.reposition(0.0, east, 4.0) == ACCEPTED
        p.until(40.0)
    place = p.place
    assert p.ask(SET_MODE, 1, QRTL) == ACCEPTED
    p.heard.clear()
    while not any(m.get_type() == "STATUSTEXT" for m in p.heard):
        p.one_step()
        assert p.time < 60.0
        assert math.dist(p.place[:2], place[:2]) < 0.5
    assert -p.place[2] == pytest.approx(height, abs=0.1)
    radius = f"VTOL position1 d={east:.1f} r=120.0"
    said = [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
    assert figures(said[0])[0] == pytest.approx(east, abs=0.5) and said[0].split(" d=")[0] == radius.split(" d=")[0]
    while p.m.armed:
        p.one_step()
        assert -p.place[2] < height + 1.5  # it returns at this height
    assert p.place == pytest.approx([0.0, 0.0, 0.0], abs=0.3)


def test_it_returns_on_the_wing_at_rtl_altitude_and_sinks_to_that_of_qrtl() -> None:
    p = hovering(pilot={"RTL_ALTITUDE": 60.0})
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED  # TAKEOFF: straight on, to TKOFF_ALT 50 m
    p.until(65.0)
    assert p.reposition(900.0, 0.0, 50.0, 1.0) == ACCEPTED
    while math.dist(p.place[:2], (900.0, 0.0)) > 250.0 and p.place[0] < 900.0:
        p.one_step()
        assert p.time < 150.0
    assert p.m.motor[4:].max() == 0.0
    assert p.ask(SET_MODE, 1, QRTL) == ACCEPTED
    highest = 0.0
    while p.m.motor[4:].max() == 0.0:
        p.one_step()
        highest = max(highest, -p.place[2])
        assert p.time < 300.0
    assert highest == pytest.approx(60.0, abs=2.0)
    assert math.hypot(*p.place[:2]) < 200.0
    assert 15.0 < -p.place[2] < 35.0
    # 45 m at 0.6 TECS_SINK_MAX take 15 s: 240 m at AIRSPEED_CRUISE, up to 160 m from home
    for distance, above in ((100.0, 0.0), (160.0, 0.0), (280.0, 22.5), (400.0, 45.0), (900.0, 45.0)):
        assert approach_height(p.m, distance) == pytest.approx(above)
    while p.m.armed:
        p.one_step()
    assert p.place == pytest.approx([0.0, 0.0, 0.0], abs=0.3)


def test_it_is_disarmed_6_2_s_after_it_touches_down() -> None:
    p = hovering()
    assert p.ask(SET_MODE, 1, QLAND) == ACCEPTED
    touched = math.inf
    while p.m.armed:
        p.one_step()
        if p.place[2] > -0.02 and touched == math.inf:
            touched = p.time
        assert p.time < 60.0
    assert p.time - touched == pytest.approx(6.2, abs=0.3)


def test_it_tells_how_far_its_return_is() -> None:
    p = hovering(pilot={"Q_RTL_ALT_MIN": 8.0})  # it is high enough
    p.heard.clear()
    assert p.ask(SET_MODE, 1, QRTL) == ACCEPTED
    p.one_step()
    first = [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
    assert first[0] == "VTOL position1 d=0.0 r=120.0"  # 1.5 times WP_LOITER_RAD
    above = "VTOL position# started v=# d=# h=#"
    assert texts(p) == ["VTOL position# d=# r=#", "VTOL Position# d=#", above, "Land descend started"]
    while p.m.armed:
        p.one_step()
        assert p.time < 60.0
    p.one_step()
    assert texts(p) == ["Land final started", "Land complete", "Throttle disarmed"]


def figures(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"=(-?[\d.]+)", text)]


def test_its_rotors_brake_for_a_second_at_least_before_they_take_over() -> None:
    p = hovering()
    assert p.reposition(400.0, 0.0, 20.0) == ACCEPTED
    told: list[tuple[float, str]] = []
    p.heard.clear()
    while not any("position2" in text for _, text in told):
        told += [(p.time, m.text) for m in p.heard if m.get_type() == "STATUSTEXT"]
        p.heard.clear()
        p.one_step()
        if p.m.braking:
            assert not p.m.vtol and p.m.motor[4:].min() >= 0.15  # Q_M_SPIN_MIN
            assert state(p) == mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC
        assert p.time < 80.0
    (braking, first), (over, second) = [one for one in told if "airbrake" in one[1] or "dc=" in one[1]]
    speed, distance, stop, height = figures(first)
    assert stop == pytest.approx(0.5 * speed * speed + 2.0 * speed, abs=1.5)  # Q_TRANS_DECEL 1
    assert distance == pytest.approx(stop, abs=1.0) and height == pytest.approx(20.0, abs=2.0)
    speed, distance, height, wanted = figures(second)
    assert wanted == pytest.approx(min(math.sqrt(2.0 * distance), 16.0), abs=0.1)  # AIRSPEED_CRUISE
    assert speed > max(1.2 * wanted, wanted + 2.0) - 0.1 or speed < 10.0  # AIRSPEED_MIN - 2
    assert over - braking > 1.0 and height == pytest.approx(20.0, abs=2.0)


@pytest.mark.parametrize(("lean", "over"), [(7.0, False), (25.0, True)])
def test_its_rotors_take_over_when_a_gust_turns_it_by_ten_degrees(lean: float, over: bool) -> None:
    p = hovering()
    assert p.reposition(400.0, 0.0, 20.0) == ACCEPTED
    while not p.m.braking:
        p.one_step()
        assert p.time < 60.0
    began = p.time
    while p.time < began + 2.0:
        p.one_step()
        pitch = euler_from_quaternion(tuple(map(float, p.v.attitude)))[1]
        assert p.time < began + 1.0 or abs(math.degrees(pitch - p.m.wanted_pitch)) < 6.0  # the rotors hold it, too
    assert p.m.braking
    p.v.attitude = quaternion_from_euler(math.radians(lean), pitch, 0.0)
    p.until(p.time + 0.1)
    assert bool(p.m.vtol) == over and bool(p.m.braking) != over


def test_it_tells_how_far_a_place_on_the_wing_is() -> None:
    p = hovering()
    p.heard.clear()
    assert p.reposition(300.0, 0.0, 20.0) == ACCEPTED
    p.one_step()
    assert [m.text for m in p.heard if m.get_type() == "STATUSTEXT"] == [
        "VTOL approach d=300.0",
        "Transition started airspeed 0.0",
    ]
    texts(p)
    p.until(70.0)
    brakes, takes_over = "VTOL airbrake v=# d=# sd=# h=#", "VTOL position# v=# d=# h=# dc=#"
    assert texts(p)[2:] == [brakes, takes_over, "VTOL position# started v=# d=# h=#"]


def test_a_launch_in_the_air_waits_for_its_propeller() -> None:
    p = hovering()
    p.heard.clear()
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    began = p.time
    p.until(began + 0.15)
    assert p.m.motor[2] == 0.0
    assert texts(p) == ["Transition started airspeed #", "Armed AUTO, xaccel = # m/s/s, waiting # sec"]
    lowest = farthest(p, 12.0)[0]
    assert lowest > 9.0  # the rotors carry it until the wing does
    assert texts(p)[:2] == ["Triggered AUTO. GPS speed = #", "Climbing to TKOFF alt then loitering"]
    p.until(began + 40.0)
    assert -p.place[2] == pytest.approx(50.0, abs=4.0)


def test_a_launch_on_the_ground_tells_its_course() -> None:
    p = started()
    assert p.ask(ARM, 0) == ACCEPTED
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p.heard.clear()
    p.until(p.time + 5.0)
    said = [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
    assert said[-1] == "Takeoff to 50m for 200.0m heading 0.0 deg"
    assert said[-2].startswith("Triggered AUTO. GPS speed = 0.")


def test_after_a_refused_mode_it_circles_if_guided_is_that_of_a_plane() -> None:
    for mode, guided, then in ((26, 0, "Transition started airspeed #"), (26, 1, None), (24, 0, "Transition")):
        p = hovering(pilot={"Q_GUIDED_MODE": guided})
        p.heard.clear()
        assert p.ask(SET_MODE, 1, mode) == FAILED
        p.one_step()
        reached = [m.seq for m in p.heard if m.get_type() == "MISSION_ITEM_REACHED"]
        said = texts(p)
        assert ("autoland not available" in said) == (mode == 26)
        assert any(text.startswith(then) for text in said) if then else not any("Trans" in text for text in said)
        assert reached == ([0] if guided == 0 else [])
    p = hovering(pilot={"Q_GUIDED_MODE": 0})
    p.until(p.time + 1.0)
    assert p.m.vtol
    texts(p)
    assert p.reposition(0.0, 0.0, 10.0) == ACCEPTED  # the place at which it hovers
    p.one_step()
    assert texts(p) == ["Transition started airspeed #"] and not p.m.vtol
    p = Pair(Quadplane, QuadplaneAutopilot)
    p.until(2.5)
    assert p.ask(SET_MODE, 1, 26) == FAILED
    assert texts(p) == ["Must already be flying!", "Flight mode change failed"]


def test_it_tells_the_attitude_of_its_rotors() -> None:
    p = hovering()
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET) == ACCEPTED
    target = p.last("ATTITUDE_TARGET")
    assert target.q[0] == pytest.approx(1.0, abs=0.01)
    assert target.thrust == pytest.approx(0.39, abs=0.05)  # Q_M_THST_HOVER
    assert p.ask(SET_MODE, 1, 0) == ACCEPTED
    p.one_step()
    p.heard.clear()
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET) == ACCEPTED
    assert not [m for m in p.heard if m.get_type() == "ATTITUDE_TARGET"]  # the rotors rest


def test_motors_are_tested_one_after_the_other_clockwise() -> None:
    p = Pair(Quadplane, QuadplaneAutopilot)
    p.until(1.0)
    test = mavlink.MAV_CMD_DO_MOTOR_TEST
    assert p.ask(test, 1, 0, 30, 1.0, 4) == ACCEPTED
    turned = []
    for _ in range(6):
        p.until(p.time + 0.75)
        turned.append(p.m.motor[4:].round(3).tolist())
        p.until(p.time + 0.75)
    # front right, rear right, rear left, front left; in ArduPilot's order of an X: 1, 4, 2, 3
    order = [[0.3, 0, 0, 0], [0, 0, 0, 0.3], [0, 0.3, 0, 0], [0, 0, 0.3, 0]]
    assert turned == [*order, [0] * 4, [0] * 4]
    assert p.ask(test, 2, 1, 1250, 1.0) == ACCEPTED
    p.one_step()
    assert p.m.motor[7] == pytest.approx(0.25)
    for first, kind, throttle in ((9, 0, 30), (1, 0, 101), (1, 1, 2300), (1, 3, 30), (math.nan, 0, 30)):
        assert p.ask(test, first, kind, throttle, 1.0) == ACCEPTED  # and nothing turns
        p.one_step()
        assert not p.m.motor[4:].any()
    assert p.ask(test, 1, 0, 30, 1.0) == ACCEPTED
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    p.until(2.5)
    assert p.ask(ARM, 1) == ACCEPTED
    p.until(p.time + 0.1)
    assert not p.m.motor[4:].any()
    p.heard.clear()
    assert p.ask(test, 1, 0, 30, 1.0) == FAILED
    assert texts(p)[-1] == "Must be disarmed for motor test"


def test_it_descends_the_slower_the_lower_and_rests_for_a_while_before_it_disarms() -> None:
    """A real ArduPlane 4.7-dev on the same body: sinking at heights, and the time from touch-down to the end."""
    p = started(values=preset("ardupilot_quadplane"))
    assert p.ask(TAKEOFF, 0, 0, 0, 0, 0, 0, 16.0) == ACCEPTED
    p.until(25.0)
    assert p.ask(SET_MODE, 1, QLAND) == ACCEPTED
    for height, sinks in ((10.3, 1.33), (9.1, 1.11), (8.1, 0.94), (7.2, 0.79), (6.5, 0.65), (3.0, 0.51)):
        while -p.place[2] > height:
            p.one_step()
        assert p.v.velocity[2] == pytest.approx(sinks, abs=0.15)
    while -p.place[2] > 0.05:
        p.one_step()
    touched = p.time
    while p.m.armed:
        p.one_step()
    assert p.time - touched == pytest.approx(6.3, abs=1.5)
    assert texts(p)[-2:] == ["Land complete", "Throttle disarmed"]

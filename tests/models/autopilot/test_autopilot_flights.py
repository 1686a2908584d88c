"""Closed loop: recorded flights of ArduCopter, and the modes, on our vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import euler_from_quaternion, geodetic_from_local
from cosim.vehicle import Airframe
from cosim_models.autopilot.record.modes import ACCELERATION
from cosim_models.vehicles.hexarotor import Hexarotor
from tests.models.copter import (
    ACCEPTED,
    GUIDED,
    LAND,
    LOITER,
    ONLY_ACCELERATION,
    ONLY_VELOCITY,
    RECORDED_AUTOPILOT,
    RTL,
    STABILIZE,
    Copter,
    H,
    preset,
    recording,
)

POSITION_AND_VELOCITY = 0xDC0


def first(time: np.ndarray, condition: np.ndarray) -> float:
    assert condition.any()
    return float(time[np.argmax(condition)])


@pytest.fixture(scope="module")
def recorded_body() -> Copter:
    """On the body of the recorded flights, in GUIDED on the ground, 1.8675 s after arming as in the recording."""
    copter = Copter(autopilot=RECORDED_AUTOPILOT, vehicle=preset("ardupilot_json"))
    copter.run(3.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
        "ACK",
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        ACCEPTED,
    )
    copter.run(1.8675 - 2 * H)
    return copter


def test_takeoff_follows_the_recorded_one(recorded_body: Copter) -> None:
    _, real = recording("json_takeoff_10m")
    recorded_body.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)
    flight = recorded_body.run(18.0)
    time, up = flight[:, 0] - flight[0, 0] + H, -flight[:, 3]
    for height in (0.05, 0.5, 5.0, 9.0):
        assert first(time, up >= height) == pytest.approx(first(real["t"], -real["d"] >= height), abs=0.2)
    assert -flight[:, 6].min() == pytest.approx(-real["vd"].min(), rel=0.05)
    assert up.max() < 10.1
    assert up[-1] == pytest.approx(10.0, abs=0.05)
    assert np.abs(flight[:, 1:3]).max() < 0.01


@pytest.mark.parametrize("distance", [5, 8, 10, 20])
def test_moves_follow_the_recorded_ones(recorded_body: Copter, distance: int) -> None:
    """ArduCopter's flights: times and speed within 5 %, 0.25 m rms, 0.1 m in the end.

    Its estimate lags, so that it overshoots by 0.05 to 0.1 m more than ours, which senses its true motion here.
    """
    if recorded_body.time < 20.0:
        recorded_body.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)
        recorded_body.run(18.0)
    first_line, real = recording(f"json_north_{distance}m")
    begin = float(recorded_body.v["position"][0])
    target = float(recorded_body.m["desired_position"][0]) + first_line["target"][0] - real["des_n"][0]
    recorded_body.go(target, 0.0, -9.98)
    flight = recorded_body.run(14.0)
    time, north = flight[:, 0] - flight[0, 0] + H, flight[:, 1] - begin
    way, way_flown = first_line["target"][0] - real["n"][0], target - begin
    true = real["n"] - real["n"][0]
    for share in (0.1, 0.5, 0.9):
        assert first(time, north >= share * way_flown) == pytest.approx(first(real["t"], true >= share * way), rel=0.05)
    assert flight[:, 4].max() == pytest.approx(real["vn"].max(), rel=0.05)
    assert np.sqrt(np.mean((np.interp(real["t"], time, north) - true)[real["t"] < 14.0] ** 2)) < 0.25
    assert abs(north[-1] - way_flown) < 0.1
    assert north.max() - way_flown == pytest.approx(true.max() - way - 0.07, abs=0.06)
    assert np.abs(-flight[:, 3] - 9.98).max() < 0.15


def test_the_default_vehicle_holds_ten_metres_and_learns_its_hover_throttle() -> None:
    """The PX4 Iris has another thrust curve than MOT_THST_EXPO says: MOT_HOVER_LEARN makes up for that."""
    copter = Copter().in_the_air()
    assert copter.m["MOT_THST_HOVER"] == 0.35
    flight = copter.run(30.0)
    assert np.abs(flight[:, 3] + 10.0).max() < 0.05
    assert copter.m["throttle_hover"] == pytest.approx(float(copter.m["throttle_filtered"]), rel=0.02)
    assert copter.m["motor"][:4] == pytest.approx(0.705, abs=0.005)


@pytest.mark.parametrize("airframe", [Airframe.quad_x, Airframe.hexa_x])
def test_a_move_east_turns_the_nose_there(airframe: Airframe) -> None:
    """The Firefly's small propellers turn it so slowly that ArduCopter's yaw gains need tuning, as on a real one."""
    hexa = Copter(Hexarotor, autopilot={"ATC_RAT_YAW_P": 1.0, "ATC_RAT_YAW_I": 0.1, "ATC_ANG_YAW_P": 1.5})
    copter = hexa if airframe == Airframe.hexa_x else Copter()
    copter.in_the_air()
    copter.go(0.0, 10.0, -12.0)
    flight = copter.run(12.0)
    assert np.abs(flight[-1, 1:4] - (0.0, 10.0, -12.0)).max() < 0.1
    assert np.abs(flight[:, 1]).max() < 0.3
    assert flight[:, 2].max() < 11.0
    yaw = euler_from_quaternion(tuple(float(x) for x in copter.v["attitude"]))[2]
    assert yaw == pytest.approx(math.pi / 2, abs=0.1)


def test_the_nose_keeps_its_heading_when_told() -> None:
    copter = Copter(autopilot={"WP_YAW_BEHAVIOR": 0}).in_the_air(5.0, 10.0)
    copter.go(0.0, 10.0, -5.0)
    copter.run(8.0)
    assert copter.v["position"][1] == pytest.approx(10.0, abs=0.3)
    assert abs(euler_from_quaternion(tuple(float(x) for x in copter.v["attitude"]))[2]) < 0.02


def test_speed_is_limited_as_asked() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, -5.0)
    copter.tick()
    assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0) == [("ACK", mavlink.MAV_CMD_DO_CHANGE_SPEED, ACCEPTED)]
    copter.go(40.0, 0.0, -5.0)
    flight = copter.run(10.0)
    assert 2.9 < flight[:, 4].max() < 3.15


def test_a_velocity_target_ends_after_the_timeout() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=2.0, vy=-1.0, vz=-0.5)
    flight = copter.run(2.9)
    assert flight[-1, 4:7] == pytest.approx((2.0, -1.0, -0.5), abs=0.12)
    flight = copter.run(6.0)
    assert np.linalg.norm(flight[-1, 4:7]) < 0.1


def test_a_body_velocity_follows_the_nose() -> None:
    copter = Copter(vehicle={"yaw_start": math.pi / 2}).in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, frame=8, vx=2.0)
    flight = copter.run(2.9)
    assert flight[-1, 4:6] == pytest.approx((0.0, 2.0), abs=0.15)


def test_offsets_count_from_the_vehicle() -> None:
    copter = Copter(vehicle={"yaw_start": math.pi / 2}).in_the_air(5.0, 10.0)
    copter.go(3.0, 0.0, -1.0, frame=9)
    copter.run(8.0)
    assert copter.v["position"] == pytest.approx((0.0, 3.0, -6.0), abs=0.15)
    copter.go(3.0, 0.0, 0.0, frame=7)
    copter.run(8.0)
    assert copter.v["position"] == pytest.approx((3.0, 3.0, -6.0), abs=0.2)


def test_a_moving_point_is_followed_without_lag() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    begin = copter.time
    for _ in range(80):
        t = copter.time - begin
        copter.go(1.0 * t, 0.0, -5.0, POSITION_AND_VELOCITY, vx=1.0)
        flight = copter.run(0.1)
    assert flight[-1, 1] == pytest.approx(copter.time - begin, abs=0.15)
    assert flight[-1, 4] == pytest.approx(1.0, abs=0.05)


def test_an_acceleration_target_accelerates_then_stops() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_ACCELERATION, afx=0.5)
    flight = copter.run(2.9)
    assert flight[-1, 4] == pytest.approx(0.5 * 2.9, abs=0.2)
    assert np.linalg.norm(copter.run(6.0)[-1, 4:7]) < 0.15


@pytest.mark.parametrize("frame", [0, 3, 5, 6])
def test_global_targets_in_every_frame(frame: int) -> None:
    copter = Copter(vehicle={"position_start[1]": 3.0}).in_the_air(5.0, 10.0)
    lat, lon, _ = geodetic_from_local(8.0, -4.0, 0.0, math.radians(-35.363262), math.radians(149.165237), 0.0)
    height = 7.0 if frame in (3, 6) else 591.0
    copter.send(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, frame, 0xDF8, round(math.degrees(lat) * 1e7), round(math.degrees(lon) * 1e7), height, *[0.0] * 8
        )
    )
    copter.run(10.0)
    assert copter.v["position"] == pytest.approx((8.0, -4.0, -7.0), abs=0.1)


def test_land_descends_fast_then_slowly_and_disarms() -> None:
    copter = Copter().in_the_air(14.0, 16.0)
    assert copter.ask(mavlink.MAV_CMD_NAV_LAND) == [("ACK", mavlink.MAV_CMD_NAV_LAND, ACCEPTED)]
    flight = copter.run(32.0)
    up, sink = -flight[:, 3], flight[:, 6]
    assert sink[(up > 12.0) & (up < 13.0)].max() > 0.8
    assert sink[(up > 2.0) & (up < 8.0)] == pytest.approx(0.5, abs=0.06)
    assert sink.max() < 1.15 * 1.5
    assert not copter.m["armed"]
    assert copter.m["on_ground"]
    assert (copter.m["motor"] == 0.0).all()
    assert np.linalg.norm(copter.v["position"]) < 0.05
    assert ("TEXT", 6, "Disarming motors") in copter.answers()


def test_rtl_climbs_returns_waits_and_lands() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(30.0, 20.0, -8.0)
    copter.run(12.0)
    assert copter.ask(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [("ACK", mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, ACCEPTED)]
    flight = copter.run(60.0)
    assert -flight[:, 3].min() == pytest.approx(15.0, abs=0.15)
    away = np.hypot(flight[:, 1], flight[:, 2])
    high = -flight[:, 3] < 14.0
    assert away[high & (flight[:, 0] < flight[0, 0] + 3.0)].min() > 35.0  # straight up first
    assert not copter.m["armed"]
    assert np.hypot(*copter.v["position"][:2]) < 0.1
    assert copter.m["mode"] == RTL


@pytest.mark.parametrize(
    ("away", "parameters", "height"),
    [
        (1.0, {}, 5.0),  # never lower than it is
        (2.5, {}, 7.5),  # RTL_CONE_SLOPE times the distance
        (1.0, {"RTL_CLIMB_MIN": 150.0}, 6.5),
        (4.0, {"RTL_ALT": 900.0}, 9.0),
        (4.0, {"FENCE_ENABLE": 1, "FENCE_ALT_MAX": 9.0}, 7.0),  # 2 m below the fence
    ],
)
def test_rtl_near_home_needs_not_climb_to_fifteen_metres(
    away: float, parameters: dict[str, float], height: float
) -> None:
    copter = Copter(autopilot=parameters).in_the_air(5.0, 10.0)
    copter.go(away, 0.0, -5.0)
    copter.run(15.0)
    copter.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    assert -copter.run(12.0)[:, 3].min() == pytest.approx(height, abs=0.15)


def test_rtl_in_fast_flight_climbs_where_it_comes_to_rest() -> None:
    """4 m/s: half of v2/a, and what the gain of PSC_POSXY_P adds below a/p = 2.5 m/s (the square-root controller)."""
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
    copter.run(2.5)
    at, speed = copter.v["position"][0], copter.v["velocity"][0]
    copter.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    copter.run(0.0025)
    rest = copter.m["guided_position_neu"][0]
    assert rest - at == pytest.approx(speed**2 / 5.0 + 1.25, abs=0.03)
    flight = copter.run(12.0)
    high = -flight[:, 3] > 7.0
    assert flight[high, 1][:400] == pytest.approx(rest, abs=0.8)


@pytest.mark.parametrize(("behaviour", "turned"), [(1, True), (2, False)])
def test_rtl_points_as_at_arming_before_it_lands_if_it_looks_along_its_way(behaviour: int, turned: bool) -> None:
    copter = Copter(autopilot={"WP_YAW_BEHAVIOR": behaviour, "RTL_LOIT_TIME": 500.0}).in_the_air(5.0, 10.0)
    copter.go(0.0, 12.0, -5.0)
    copter.run(8.0)
    assert abs(copter.v["attitude"][3]) > 0.6  # looks east
    copter.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    copter.run(55.0)
    assert not copter.m["armed"]
    assert (abs(copter.v["attitude"][3]) < 0.05) == turned  # north


def test_loiter_brakes_and_holds() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=4.0)
    copter.run(2.5)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    copter.run(6.0)
    hold = copter.run(10.0)
    assert np.ptp(hold[:, 1]) < 0.15
    assert np.ptp(hold[:, 3]) < 0.1
    assert copter.m["mode"] == LOITER


def test_stabilize_in_the_air_is_zero_throttle() -> None:
    """As ArduCopter without a radio, whose throttle stick is down."""
    copter = Copter().in_the_air(10.0)
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, STABILIZE)
    copter.run(1.0)
    assert copter.m["motor"][:4] == pytest.approx(0.1)
    assert copter.v["velocity"][2] > 4.0


def test_motors_wait_for_two_seconds_after_arming_then_idle_then_stop_after_ten() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    armed = copter.time - 2 * H
    copter.run(1.99)
    assert (copter.m["motor"] == 0.0).all()
    copter.run(1.0)
    assert copter.m["motor"][:4] == pytest.approx(0.1)
    while copter.m["armed"]:
        copter.tick()
        assert copter.time - armed < 12.0
    assert copter.time - armed == pytest.approx(10.0, abs=0.02)
    assert ("TEXT", 6, "Disarming motors") in copter.answers()


def test_targets_on_the_ground_do_not_lift_it_off() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.go(5.0, 0.0, -10.0)
    copter.run(5.0)
    assert np.linalg.norm(copter.v["position"]) < 0.02


def test_mode_changes_in_flight_do_not_jerk() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    for mode in (LOITER, GUIDED, LAND, GUIDED, RTL, GUIDED):
        copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
        flight = copter.run(0.5)
        assert np.abs(flight[:, 4:6]).max() < 0.1
        assert np.abs(flight[:, 6]).max() < 0.8


def test_after_accelerations_it_stops_without_beginning_anew() -> None:
    """When no more come, the velocity is shaped to zero; the position that lags behind is not given up."""
    copter = Copter().in_the_air(5.0, 10.0)
    for _ in range(30):
        copter.go(0.0, 0.0, 0.0, ONLY_ACCELERATION, afx=1.0)
        copter.run(0.1)
    given = copter.time - 0.1
    desired = []
    while copter.time < given + 4.0:
        copter.tick()
        desired.append((copter.time, *copter.m["desired_position_neu"][:1], *copter.m["desired_velocity_neu"][:1]))
    times, places, speeds = np.array(desired).T
    late = times > given + 3.01
    assert speeds[late][0] == pytest.approx(6.0, abs=0.2)  # 1 m/s2 for six seconds
    assert np.abs(np.diff(places) - 0.5 * H * (speeds[1:] + speeds[:-1])).max() < 1e-3
    copter.run(6.0)
    assert np.abs(copter.v["velocity"]).max() < 0.1
    assert copter.m["submode"] == ACCELERATION

"""Sensors and motors that fail by SIM_* parameters, set by a ground station in flight, and their fail-safes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import euler_from_quaternion
from tests.models.copter import FAILED, GUIDED, LAND, LOITER, RECORDED_AUTOPILOT, Copter, preset

ALT_HOLD = mavlink.COPTER_MODE_ALT_HOLD
DEGREE = 6378100.0 * math.pi / 180.0
"""Metres of a degree of latitude on ArduPilot's sphere."""
GLITCH = 32768
"""EKF_GPS_GLITCHING."""


def put(copter: Copter, name: str, value: float) -> None:
    """PARAM_SET, as a ground station sends it."""
    copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32))
    copter.run(0.01)
    assert copter.m[name] == pytest.approx(value, rel=1e-6)


def told(copter: Copter) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in copter.messages("STATUSTEXT")]


def status(copter: Copter, number: int, name: str) -> mavlink.MAVLink_message:
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number)
    copter.run(0.01)
    return copter.messages(name)[-1]


def ekf(copter: Copter) -> mavlink.MAVLink_message:
    return status(copter, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, "EKF_STATUS_REPORT")


def gps(copter: Copter) -> mavlink.MAVLink_message:
    return status(copter, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, "GPS_RAW_INT")


def hovering(**autopilot: float) -> Copter:
    copter = Copter(autopilot={"EK3_IMU_MASK": 1, **autopilot}).in_the_air(8.0, 12.0)  # no other lane to change to
    copter.heard.clear()
    return copter


# ---- GPS ------------------------------------------------------------------------------------------------------------


def test_without_gps_the_position_is_lost_and_the_vehicle_lands_where_the_wind_takes_it() -> None:
    copter = hovering()
    copter.v["wind"][1] = 4.0
    copter.run(6.0)
    put(copter, "SIM_GPS1_ENABLE", 0)
    assert (gps(copter).fix_type, gps(copter).satellites_visible) == (0, 0)
    assert status(copter, mavlink.MAVLINK_MSG_ID_SYS_STATUS, "SYS_STATUS").onboard_control_sensors_health & 32 == 0
    copter.heard.clear()
    copter.run(7.5)
    assert (copter.m["mode"], told(copter)) == (GUIDED, [])  # 7 s without GPS, and a second of checks
    copter.run(1.0)
    assert copter.m["mode"] == LAND
    assert told(copter) == [(2, "EKF variance"), (2, "EKF Failsafe: changed to LAND Mode")]
    assert ekf(copter).flags == 167
    flight = copter.run(3.5)
    assert np.ptp(flight[:, 3]) < 0.25  # the pause before the descent
    copter.run(1.0)
    assert copter.messages("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL
    copter.run(31.0)
    assert not copter.m["armed"]
    assert copter.v["position"][1] > 8.0  # drifts


@pytest.mark.parametrize(("drift", "away"), [(0.05, 5.15), (0.0, 0.0)])
def test_gyros_drift_without_gps(drift: float, away: float) -> None:
    """SIM_DRIFT_SPEED: ArduCopter 4.7-dev on its own physics landed 5.06 to 5.17 m away in six recordings of 32 s.

    Its estimated roll and pitch erred by 0.18 and 0.25 degrees then, by 0.09 and 0.10 before.
    """
    copter = Copter(
        autopilot={**RECORDED_AUTOPILOT, "SIM_DRIFT_SPEED": drift}, vehicle=preset("ardupilot_sitl_quad"), direct=True
    ).in_the_air(10.0, 20.0)
    put(copter, "SIM_GPS1_ENABLE", 0)
    copter.run(17.0)
    w, x, y, z = (float(part) for part in copter.v["attitude"])
    true = euler_from_quaternion((w, x, y, z))
    w, x, y, z = (float(part) for part in copter.m["q"])
    told = euler_from_quaternion((w, x, y, z))
    for i in range(2):
        assert math.degrees(told[i] - true[i]) == pytest.approx(0.2 if drift else 0.0, abs=0.07)
    copter.run(20.0)
    assert not copter.m["armed"]
    assert math.hypot(*copter.v["position"][:2]) == pytest.approx(away, rel=0.25, abs=0.02)


def test_a_failsafe_that_changes_nothing_is_told() -> None:
    """FS_EKF_ACTION 0 in GUIDED, as in LAND and modes without a position."""
    copter = hovering(FS_EKF_ACTION=0)
    put(copter, "SIM_GPS1_ENABLE", 0)
    copter.run(9.0)
    assert copter.m["mode"] == GUIDED
    assert told(copter) == [(2, "EKF variance"), (2, "EKF Failsafe")]
    copter.heard.clear()
    put(copter, "SIM_GPS1_ENABLE", 1)
    copter.run(1.5)
    assert told(copter) == [(2, "EKF Failsafe Cleared")]
    assert copter.m["mode"] == GUIDED


def test_gps_that_returns_clears_the_failsafe() -> None:
    copter = hovering()
    put(copter, "SIM_GPS1_ENABLE", 0)
    copter.run(9.0)
    answer = copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    assert answer[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, FAILED)
    assert ("TEXT", 4, "Mode change to LOITER failed: requires position") in answer
    copter.heard.clear()
    put(copter, "SIM_GPS1_ENABLE", 1)
    copter.run(1.5)
    assert told(copter) == [(2, "EKF Failsafe Cleared")]
    assert ekf(copter).flags == 831
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)[0][2] == 0
    copter.run(100.0)  # until what has been learned of the drift of its gyros is forgotten
    assert not copter.m["sim_on"]


def test_aiding_that_stops_and_begins_again_is_told() -> None:
    """Of each lane, as by ArduCopter 4.7-dev (90700977): after 15 s without GPS, and at once when that is back."""
    copter = hovering(EK3_IMU_MASK=3)
    put(copter, "SIM_GPS1_ENABLE", 0)
    copter.run(14.8)
    assert told(copter) == [(2, "EKF variance"), (2, "EKF Failsafe: changed to LAND Mode")]
    copter.heard.clear()
    copter.run(4.2)
    assert told(copter) == [(4, "EKF3 IMU0 stopped aiding"), (4, "EKF3 IMU1 stopped aiding")]
    copter.heard.clear()
    put(copter, "SIM_GPS1_ENABLE", 1)
    copter.run(0.2)
    assert told(copter) == [(6, "EKF3 IMU0 is using GPS"), (6, "EKF3 IMU1 is using GPS")]
    copter.heard.clear()
    copter.run(1.5)
    assert told(copter) == [(2, "EKF Failsafe Cleared")]


def test_a_landing_without_a_position_stays_so_when_gps_returns() -> None:
    """ArduCopter 4.7-dev (90700977) in SIM_WIND_SPD 4, on the same body: GPS was back 1.5 s after it began to land.

    Its fail-safe ended 1.3 s later, but it was level within 0.3 degrees after a second, drifted with up to 2.10 m/s,
    and was 38 m away after 22 s.
    """
    copter = Copter(autopilot={**RECORDED_AUTOPILOT}, vehicle=preset("ardupilot_sitl_quad"), direct=True)
    copter.in_the_air(20.0, 20.0)

    def fly(seconds: int) -> np.ndarray:
        rows = []
        for _ in range(10 * seconds):
            copter.v["wind"][0] = 4.0 * math.sqrt(max(-copter.v["position"][2], 0.0) / 60.0)  # SIM_WIND_T_ALT
            rows.append(copter.run(0.1))
        return np.concatenate(rows)

    fly(15)
    put(copter, "SIM_GPS1_ENABLE", 0)
    fly(9)
    place = float(fly(1)[-1, 1])
    assert copter.m["mode"] == LAND
    w, x, y, z = (float(part) for part in copter.v["attitude"])
    assert math.degrees(euler_from_quaternion((w, x, y, z))[1]) == pytest.approx(0.0, abs=0.3)
    copter.heard.clear()
    put(copter, "SIM_GPS1_ENABLE", 1)
    flight = fly(22)
    assert told(copter) == [(2, "EKF Failsafe Cleared")]
    assert flight[:, 4].max() == pytest.approx(2.10, rel=0.1)
    assert flight[-1, 1] - place == pytest.approx(38.0, rel=0.1)
    assert copter.m["mode"] == LAND


@pytest.mark.parametrize(("action", "mode"), [(0, GUIDED), (2, ALT_HOLD), (3, LAND)])
def test_the_action_for_a_lost_estimate(action: int, mode: int) -> None:
    copter = hovering(FS_EKF_ACTION=action)
    put(copter, "SIM_GPS1_ENABLE", 0)
    copter.run(8.5)
    assert copter.m["mode"] == mode
    assert (2, "EKF variance") in told(copter)


def test_a_mode_without_position_goes_on_unless_it_always_lands() -> None:
    for action, mode in ((1, ALT_HOLD), (3, LAND)):
        copter = hovering(FS_EKF_ACTION=action)
        copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, ALT_HOLD)
        put(copter, "SIM_GPS1_ENABLE", 0)
        copter.run(9.0)
        assert copter.m["mode"] == mode


def test_a_small_glitch_moves_the_vehicle() -> None:
    """2 m north within the gate: the estimate believes it, and the vehicle flies 2 m south."""
    copter = hovering()
    put(copter, "SIM_GPS1_GLTCH_X", 2.0 / DEGREE)
    copter.run(12.0)
    assert copter.v["position"][0] == pytest.approx(-2.0, abs=0.15)
    assert copter.m["position_neu"][0] == pytest.approx(0.0, abs=0.1)
    assert told(copter) == []
    assert gps(copter).lat == pytest.approx(-353632620, abs=12)  # which is what GPS says


def test_a_large_glitch_is_rejected_then_believed() -> None:
    copter = hovering()
    copter.go(0.0, 0.0, -8.0)
    put(copter, "SIM_GPS1_GLTCH_Y", 20.0 / (DEGREE * math.cos(math.radians(35.363262))))
    copter.run(1.5)
    assert told(copter) == [(2, "GPS Glitch or Compass error")]
    report = ekf(copter)
    assert (report.flags, report.pos_horiz_variance) == (
        831 + GLITCH,
        pytest.approx(20.0 / 5.0 / math.sqrt(2.0 * 0.28), rel=0.05),
    )  # 5 sigma
    flight = copter.run(8.0)
    assert np.abs(flight[:, 2]).max() < 0.2
    copter.run(0.7)
    assert copter.m["position_neu"][1] == pytest.approx(20.0, abs=0.3)  # the estimate has jumped
    assert copter.v["position"][1] == pytest.approx(0.0, abs=0.3)  # not the vehicle, which then flies back
    copter.run(12.0)
    assert copter.v["position"][1] == pytest.approx(-20.0, abs=0.5)
    assert (2, "Glitch cleared") in told(copter)
    assert copter.m["mode"] == GUIDED


def test_jammed_gps_lands_without_a_position() -> None:
    """Recorded flights landed after 4.8 to 6.7 s; that GPS errs was told from 0.9 s before to 0.3 s after that."""
    copter = hovering()
    put(copter, "SIM_GPS1_JAM", 1)
    begin = copter.time
    copter.run(0.9)
    assert told(copter) == [] and ekf(copter).velocity_variance < 1.0
    copter.heard.clear()
    while copter.m["mode"] != LAND and copter.time < begin + 10.0:
        copter.run(0.1)
    assert 2.0 < copter.time - begin < 7.3
    copter.run(1.0)
    said = told(copter)
    assert said.index((2, "EKF variance")) + 1 == said.index((2, "EKF Failsafe: changed to LAND Mode"))
    assert (2, "GPS Glitch or Compass error") in said
    copter.heard.clear()
    put(copter, "SIM_GPS1_JAM", 0)
    copter.run(25.0)  # its claims of little accuracy are forgotten, too
    assert {(2, "EKF Failsafe Cleared"), (2, "Glitch cleared")} <= set(told(copter))
    assert copter.m["mode"] == LAND


def test_what_a_jammed_gps_tells() -> None:
    """As ArduPilot's simulator in four recordings of 34 s.

    70 to 73 % of its answers had a fix, 23 to 26 % a speed above 10 m/s, of 484 to 532 m/s at most; its place jumped
    between 28 and 32 % of them, by 197 m to north or south at most. In the first second, it has three satellites.
    """
    copter = Copter()
    copter.run(3.0)
    copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 200_000)
    put(copter, "SIM_GPS1_JAM", 1)
    copter.run(0.25)
    copter.heard.clear()
    copter.run(0.7)
    assert {(m.fix_type, m.satellites_visible) for m in copter.messages("GPS_RAW_INT")} == {(1, 3)}
    copter.run(5.3)
    copter.heard.clear()
    copter.run(136.0)
    rows = np.array([(m.fix_type, m.satellites_visible, m.lat, m.lon, m.vel) for m in copter.messages("GPS_RAW_INT")])
    fixed, fast = rows[:, 0] == 6, rows[:, 4] > 1000
    assert 0.66 < fixed.mean() < 0.78
    assert set(rows[~fixed, 0]) == {1} and set(rows[~fixed, 1]) == {3}
    assert (rows[fixed, 1].min(), rows[fixed, 1].max()) == (4, 16)
    assert 0.20 < fast.mean() < 0.30
    assert 45_000 < rows[:, 4].max() <= 56_600
    jumps = np.diff(rows[:, 2:4], axis=0) * 1e-7 * DEGREE
    moved = jumps[:, 0] != 0.0
    assert 0.26 < moved.mean() < 0.34
    assert 190.0 < np.abs(jumps[moved, 0]).max() <= 200.5
    put(copter, "SIM_GPS1_JAM", 0)
    copter.run(0.5)
    told = gps(copter)
    assert (told.fix_type, told.satellites_visible, told.vel) == (6, 10, 0)
    assert told.lat == pytest.approx(-353632620, abs=2)


# ---- barometer ------------------------------------------------------------------------------------------------------


def test_a_barometer_that_drifts_moves_the_height() -> None:
    """The drift counts from the start, so that 0.05 m/s at 20 s is 1 m at once; the vehicle sinks as it drifts."""
    copter = hovering()
    copter.run(20.0 - copter.time)
    up = -float(copter.v["position"][2])
    put(copter, "SIM_BARO_DRIFT", 0.05)
    copter.run(30.0)
    offset = 0.05 * copter.time
    assert copter.m["estimate_error"][2] == pytest.approx(offset, abs=0.3)
    assert -copter.v["position"][2] == pytest.approx(up - offset, abs=0.35)


def test_a_barometer_that_jumps_is_rejected_for_ten_seconds() -> None:
    copter = hovering()
    put(copter, "SIM_BARO_GLITCH", -25.0)
    copter.run(9.0)
    assert copter.m["estimate_error"][2] == pytest.approx(0.0, abs=0.1)
    assert ekf(copter).pos_vert_variance == pytest.approx(25.0 / 5.0 / math.sqrt(16.0 + 0.3), rel=0.05)
    copter.run(1.5)
    assert copter.m["estimate_error"][2] == pytest.approx(-25.0, abs=0.1)
    copter.run(25.0)
    assert -copter.v["position"][2] == pytest.approx(33.0, abs=0.5)


# ---- compass --------------------------------------------------------------------------------------------------------


def test_offsets_of_the_compass_turn_the_heading() -> None:
    """Level and facing north, 100 mGauss to the right of (230, 51): the angle of the horizontal field turns."""
    copter = hovering()
    put(copter, "SIM_MAG1_OFS_Y", 113.0)
    copter.run(25.0)
    wrong = math.atan2(51.0, 230.0) - math.atan2(151.0, 230.0)
    w, _, _, z = (float(x) for x in copter.v["attitude"])
    turned = 2.0 * math.atan2(z, w)
    # the autopilot keeps its heading: the vehicle turns by as much to the other side, and the field in its axes too
    assert copter.m["yaw_error"] == pytest.approx(-turned, abs=0.02)
    assert abs(turned) == pytest.approx(abs(wrong), rel=0.25) and turned * wrong < 0.0
    put(copter, "SIM_MAG1_OFS_Y", 13.0)
    copter.run(45.0)
    assert not copter.m["sim_on"]
    assert 2.0 * math.atan2(copter.v["attitude"][3], copter.v["attitude"][0]) == pytest.approx(0.0, abs=0.01)


# ---- motors ---------------------------------------------------------------------------------------------------------


def test_a_motor_that_stops_ends_in_a_crash_that_is_noticed() -> None:
    copter = hovering()
    put(copter, "SIM_ENGINE_FAIL", 1)
    copter.run(0.5)
    assert copter.m["motor"][0] == 0.0
    copter.run(12.0)
    (crash,) = [text for severity, text in told(copter) if text.startswith("Crash: ")]
    assert crash.startswith("Crash: Disarming: AngErr=") and ">30, Accel=" in crash and crash.endswith("<3.0")
    assert 30 < int(crash.split("AngErr=")[1].split(">")[0]) <= 180
    assert float(crash.split("Accel=")[1].split("<")[0]) < 3.0
    assert not copter.m["armed"]


def test_a_crash_is_not_looked_for_when_it_is_off() -> None:
    copter = hovering(FS_CRASH_CHECK=0)
    put(copter, "SIM_ENGINE_FAIL", 1)
    copter.run(10.0)
    assert not [text for _, text in told(copter) if text.startswith("Crash")]


def test_all_motors_with_half_their_thrust_are_told() -> None:
    copter = hovering()
    put(copter, "SIM_ENGINE_MUL", 0.6)
    put(copter, "SIM_ENGINE_FAIL", 15)
    copter.run(4.0)
    texts = [text for severity, text in told(copter) if severity == 0]
    assert texts and texts[0].startswith("Potential Thrust Loss (") and texts[0][23] in "1234"


def test_a_parameter_that_is_set_back_leaves_no_trace() -> None:
    """The same flight to the bit with and without a motor that failed on the ground before it."""
    flights = []
    for fails in (False, True):
        copter = Copter()
        copter.run(1.0)
        if fails:
            put(copter, "SIM_ENGINE_FAIL", 1)
            copter.run(0.5)
            put(copter, "SIM_ENGINE_FAIL", 0)
            copter.run(0.48)
        else:
            copter.run(1.0)
        assert copter.time == pytest.approx(2.0)
        copter.in_the_air(4.0, 8.0)
        flights.append(copter.run(1.0))
    np.testing.assert_array_equal(flights[0], flights[1])


# ---- accelerometer --------------------------------------------------------------------------------------------------


def test_an_error_of_the_accelerometer_makes_it_climb_as_the_real_one_did() -> None:
    """The flight x_accelerometer_bias: 0.86 m in 1 s, 3.15 m in 2 s, compensation after 2.89 s, LAND after 3.69 s."""
    copter = hovering()
    begin = copter.time + 0.01
    put(copter, "SIM_ACC1_BIAS_Z", 2.0)
    copter.run(0.99)
    assert -copter.v["position"][2] == pytest.approx(8.0 + 0.86, abs=0.3)
    copter.run(1.0)
    assert -copter.v["position"][2] == pytest.approx(8.0 + 3.15, abs=0.6)
    assert told(copter) == []
    copter.run(2.0)
    texts = {m.text: t - begin for t, m in copter.heard if m.get_type() == "STATUSTEXT"}
    assert texts["Vibration compensation ON"] == pytest.approx(2.89, abs=0.25)
    assert texts["EKF variance"] == pytest.approx(3.69, abs=0.3)
    assert copter.m["mode"] == LAND and copter.m["vibration_failsafe"]
    put(copter, "SIM_ACC1_BIAS_Z", 0.0)
    copter.heard.clear()
    copter.run(30.0)
    assert (2, "Vibration compensation OFF") in told(copter)
    assert not copter.m["vibration_failsafe"]


@pytest.mark.parametrize(("bias", "enabled"), [(-2.0, 1), (2.0, 0)])
def test_the_accelerometer_is_trusted_if_it_errs_upwards_or_by_parameter(bias: float, enabled: int) -> None:
    copter = Copter(autopilot={"EK3_IMU_MASK": 1, "FS_VIBE_ENABLE": enabled}).in_the_air(40.0, 25.0)
    copter.heard.clear()
    put(copter, "SIM_ACC1_BIAS_Z", bias)
    copter.run(4.0)
    assert "Vibration compensation ON" not in [text for _, text in told(copter)]
    assert (2, "EKF variance") in told(copter)


def test_vibration_passes_the_filter_of_the_accelerometer() -> None:
    """At the corner of a filter of second order, 1/sqrt(2) of it is left, and 1/sqrt(17) at twice the frequency."""
    for frequency, left in ((20.0, math.sqrt(0.5)), (40.0, 1.0 / math.sqrt(17.0))):
        copter = hovering()
        put(copter, "SIM_ACC1_RND", 2.0)
        put(copter, "SIM_VIB_FREQ_X", frequency)
        copter.run(0.5)
        seen = []
        for _ in range(200):
            copter.tick()
            seen.append(float(copter.m["acceleration_neu"][0]))
        assert np.ptp(seen) == pytest.approx(2 * 2.0 * left, rel=0.1)
    put(copter, "SIM_ACC1_RND", 0.0)
    copter.run(0.5)
    assert not copter.m["sim_on"]

"""Checks before planes and quadplanes are armed, by ArduPlane's sources: when arming is refused, and how it is told."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_rover_battery import CRITICAL, requested
from tests.models.autopilot.test_rover_failsafes import INFO, texts
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, WAYPOINT, made, upload
from tests.models.pair import ACCEPTED, FAILED, Pair

RUN_CHECKS, SYS_STATUS = mavlink.MAV_CMD_RUN_PREARM_CHECKS, mavlink.MAVLINK_MSG_ID_SYS_STATUS
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
PREARM_BIT = 0x10000000
FORCE = 21196
MANUAL, AUTO, RTL, GUIDED, QHOVER, QLAND, LOITER = 0, 10, 11, 15, 18, 20, 12
TAKEOFF, VTOL_TAKEOFF, VTOL_LAND = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF, 85
AHRS, HOME = "AHRS: not using configured AHRS type", "AHRS: waiting for home"
BAD_FIX, ROLL = "GPS 1: Bad fix", "ROLL_LIMIT_DEG too small (2.5)"


def failing(p: Pair, prefix: str) -> list[str]:
    """What the texts of failed checks say since the last look."""
    said = texts(p)
    assert all(severity == CRITICAL for severity, text in said if "rm: " in text)
    return [text.removeprefix(prefix) for _, text in said if text.startswith(prefix)]


def asked(p: Pair) -> list[str]:
    texts(p)
    assert p.ask(RUN_CHECKS) == ACCEPTED
    return failing(p, "PreArm: ")


def passes(p: Pair) -> bool:
    return bool(requested(p, SYS_STATUS).onboard_control_sensors_health & PREARM_BIT)


@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_how_a_boot_is_told(kind: str) -> None:
    """The stages of a boot of 41.5 s, whose GPS is there after 9.8 s and whose home after 19.8 s."""
    p = made(kind, pilot={"estimate_ready_time": 41.5})
    for time, said in ((5.0, [AHRS, BAD_FIX]), (15.0, [AHRS, HOME]), (29.0, [AHRS]), (42.0, [])):
        p.until(time)
        texts(p)
        assert p.ask(ARM, 1) == (FAILED if said else ACCEPTED)
        assert failing(p, "Arm: ") == said
        if said:
            assert asked(p) == said
            assert not passes(p)
    assert passes(p)


def test_failing_checks_are_told_every_30_s_while_it_is_disarmed() -> None:
    p = made("plane", pilot={"ROLL_LIMIT_DEG": 2.5})
    told_at: list[float] = []
    while p.time < 65.0:
        p.one_step()
        if failing(p, "PreArm: ") == [ROLL]:
            told_at.append(p.time)
    assert told_at == pytest.approx([31.0, 62.0], abs=0.1)  # looks once a second, later than 30 s after the last
    assert not passes(p)
    assert p.ask(ARM, 1, FORCE) == ACCEPTED
    p.until(p.time + 20.0)
    assert failing(p, "PreArm: ") == []
    assert passes(p)  # as it is armed
    assert p.ask(RUN_CHECKS) == REJECTED
    assert p.ask(ARM, 0) == ACCEPTED
    p.until(91.0)
    assert failing(p, "PreArm: ") == []
    p.until(94.0)
    assert failing(p, "PreArm: ") == [ROLL]  # 30 s go on while it is armed


def test_a_check_of_all_firmwares_is_told_at_once() -> None:
    p = made("plane")
    p.until(6.0)
    assert passes(p)
    p.m.BATT_ARM_VOLT = 12.7
    p.until(7.2)
    assert not passes(p)
    p.until(8.2)
    assert failing(p, "PreArm: ") == ["Battery 1 below minimum arming voltage"]
    p.until(30.0)
    assert failing(p, "PreArm: ") == []
    p = made("plane")
    p.until(6.0)
    p.m.ROLL_LIMIT_DEG = 2.5
    p.until(20.0)
    assert failing(p, "PreArm: ") == []  # ArduPlane's own
    assert not passes(p)


@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_all_failing_checks_are_told_in_order(kind: str) -> None:
    values = {"BATT_ARM_VOLT": 12.7, "PTCH_LIM_MAX_DEG": 2.0, "ROLL_LIMIT_DEG": 2.5, "FS_LONG_TIMEOUT": 1.0}
    lifted = {"Q_M_SPIN_MIN": 0.35, "Q_ANGLE_MAX": 81.0} if kind == "quadplane" else {}
    p = made(kind, pilot=values | lifted)
    p.until(2.5)
    assert p.ask(SET_MODE, 1, RTL) == ACCEPTED
    p.m.emergency_stop = True
    rotors = ["Motors: Q_M_SPIN_MIN too high 0.35 > 0.3", "Check Q_ANGLE_MAX"] if lifted else []
    said = [
        "Battery 1 below minimum arming voltage",
        "Motors Emergency Stopped",
        "FS_LONG_TIMEOUT < FS_SHORT_TIMEOUT",
        ROLL,
        "PTCH_LIM_MAX_DEG too small (2.0)",
        *rotors,
        "RTL mode not armable",
    ]
    assert asked(p) == said
    assert p.ask(ARM, 1) == FAILED
    assert failing(p, "Arm: ") == said
    assert p.ask(ARM, 1, FORCE) == ACCEPTED
    assert (INFO, "Throttle armed") in texts(p)


def test_a_radio_that_was_never_there_is_told_even_if_arming_is_forced() -> None:
    p = made("plane", pilot={"SIM_RC_FAIL": 1})
    p.until(2.5)
    assert asked(p) == ["Waiting for RC"]
    assert p.ask(ARM, 1, FORCE) == FAILED
    assert failing(p, "Arm: ") == ["Waiting for RC"]


def with_mission(*items: tuple[int, float], mode: int = AUTO, **values: float) -> Pair:
    """A quadplane with a mission of commands and places, m north, in a mode."""
    p = made("quadplane", pilot=values)
    p.until(2.5)
    assert upload(p, [(command, north, 0.0, 30.0, (0.0, 0.0)) for command, north in items]) == 0
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    return p


def test_missions_of_quadplanes() -> None:
    """It stops from 16 m/s within 128 m, of which it needs three quarters."""
    short = "VTOL land too short, min 96m"
    assert asked(with_mission((VTOL_TAKEOFF, 0.0), (WAYPOINT, 300.0), (VTOL_LAND, 390.0))) == [short]
    assert asked(with_mission((VTOL_TAKEOFF, 0.0), (WAYPOINT, 300.0), (VTOL_LAND, 400.0))) == []
    assert asked(with_mission((VTOL_TAKEOFF, 0.0), (VTOL_LAND, 1.0))) == []
    assert asked(with_mission((WAYPOINT, 300.0), (VTOL_LAND, 390.0), mode=QHOVER, Q_TRANS_DECEL=2.0)) == []
    assert asked(with_mission((WAYPOINT, 300.0))) == ["AUTO missing takeoff waypoint"]
    assert asked(with_mission((WAYPOINT, 300.0), mode=LOITER)) == []
    p = with_mission((TAKEOFF, 0.0), (WAYPOINT, 300.0))
    assert asked(p) == []
    p.m.mission_count = 1
    assert asked(p) == ["Mode requires mission", "AUTO missing takeoff waypoint"]


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        (MANUAL, ["MANUAL not Q mode"]),
        (LOITER, ["LOITER not Q mode"]),
        (25, ["Loiter to QLAND not Q mode"]),
        (AUTO, ["AUTO not in VTOL takeoff"]),
        (GUIDED, []),
        (QHOVER, []),
        (QLAND, ["QLAND mode not armable"]),
        (RTL, ["RTL mode not armable"]),
    ],
)
def test_a_quadplane_may_be_armed_in_modes_on_the_rotors_alone(mode: int, said: list[str]) -> None:
    assert asked(with_mission((WAYPOINT, 300.0), mode=mode, Q_OPTIONS=1 << 18)) == said
    assert asked(with_mission((TAKEOFF, 0.0), mode=AUTO, Q_OPTIONS=1 << 18)) == []


@pytest.mark.parametrize("by_switch", [False, True])
@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_a_silent_gps_forbids_arming(kind: str, by_switch: bool) -> None:
    """It has no fix after 4 s, and the position is lost after 7 s."""
    p = made(kind)
    p.until(3.0)
    if by_switch:
        assert p.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 65, 2) == ACCEPTED
    else:
        p.m.SIM_GPS1_ENABLE = 0
    for seconds, said, fix in ((3.5, [], 6), (3.0, [BAD_FIX], 0), (3.0, [AHRS, BAD_FIX], 0)):
        p.until(p.time + seconds)
        assert asked(p) == said
        assert requested(p, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type == fix
    assert requested(p, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags == 167  # a constant position
    assert p.ask(ARM, 1) == FAILED
    assert failing(p, "Arm: ") == [AHRS, BAD_FIX]
    p.m.SIM_GPS1_ENABLE = 1
    assert p.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 65, 0) == ACCEPTED
    p.until(p.time + 0.3)
    assert asked(p) == []
    assert requested(p, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags == 831
    assert p.ask(ARM, 1) == ACCEPTED

"""Fail-safes of planes and quadplanes by ArduPlane's sources: what a lost radio or station leads to, and its texts."""

from __future__ import annotations

from functools import cache

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_plane_pilot import angles, high
from tests.models.autopilot.test_rover_battery import CRITICAL
from tests.models.autopilot.test_rover_failsafes import INFO, WARNING, texts, with_station
from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, WAYPOINT, made, upload
from tests.models.autopilot.test_small_switches import AUX, flying
from tests.models.pair import ACCEPTED, FAILED, Pair

MANUAL, CIRCLE, FBWA, FBWB, CRUISE, AUTO, RTL, LOITER, TAKEOFF, GUIDED = 0, 1, 5, 6, 7, 10, 11, 12, 13, 15
QSTABILIZE, QHOVER, QLOITER, QLAND, QRTL, QACRO = 17, 18, 19, 20, 21, 23
EMERGENCY_LANDING = 157
LOST, BACK = (WARNING, "Throttle failsafe on"), (WARNING, "Throttle failsafe off")
NAMES = {MANUAL: "MANUAL", CIRCLE: "CIRCLE", FBWA: "FLY_BY_WIRE_A", FBWB: "FLY_BY_WIRE_B", AUTO: "AUTO", RTL: "RTL"}
NAMES |= {LOITER: "LOITER", TAKEOFF: "TAKEOFF", GUIDED: "GUIDED", QLAND: "QLAND", QRTL: "QRTL", CRUISE: "CRUISE"}


def short(mode: int, changed: bool = True) -> tuple[int, str]:
    return WARNING, f"RC Short Failsafe: switched to {NAMES[mode]}" if changed else "RC Short Failsafe On"


def long(mode: int, cause: str = "RC Long") -> tuple[int, str]:
    return WARNING, f"{cause} Failsafe On: {NAMES[mode]}"


@cache
def _hovering() -> Pair:
    return flying("quadplane")


def hovering(mode: int) -> Pair:
    """A quadplane that hovers at 20 m, in a mode."""
    p = made("quadplane")
    p.go_on_from(_hovering())
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    return p


def with_values(p: Pair, fail: int = 0, **values: float) -> Pair:
    """The pair with values of parameters; its receiver fails from now on, its station has been heard until now."""
    for name, value in values.items():
        p.m[name] = value
    p.m.station_heard = p.time
    p.until(p.time + 0.3)
    texts(p)
    p.m.SIM_RC_FAIL = fail
    return p


def when_told(p: Pair, patience: float = 12.0) -> list[tuple[float, tuple[int, str]]]:
    """All texts with their times [s] since now."""
    began, found = p.time, []
    while p.time < began + patience:
        p.one_step()
        found += [(p.time - began, text) for text in texts(p)]
    return found


def said(p: Pair, patience: float = 12.0) -> list[tuple[int, str]]:
    return [text for _, text in when_told(p, patience)]


# ---- radio, short --------------------------------------------------------------------------------------------------


def test_a_silent_receiver_is_lost_after_its_times_and_the_mode_comes_back() -> None:
    p = with_values(high(CRUISE), FS_LONG_TIMEOUT=30.0, fail=1)
    events = when_told(p, 5.0)
    assert [text for _, text in events] == [LOST, short(CIRCLE)]
    assert [time for time, _ in events] == pytest.approx([1.0 + 0.2] * 2, abs=0.15)  # at once
    assert p.m.mode == CIRCLE
    p.until(p.time + 1.1)
    assert p.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
    p.m.SIM_RC_FAIL = 0
    assert said(p, 2.0) == [
        BACK,
        (WARNING, "Short Failsafe Cleared"),
        (INFO, "Flight mode CRUISE restored"),
    ]
    assert p.m.mode == CRUISE
    p.until(p.time + 1.1)
    assert p.last("HEARTBEAT").system_status == mavlink.MAV_STATE_ACTIVE


def test_a_mode_that_was_chosen_meanwhile_stays() -> None:
    p = with_values(high(CRUISE), FS_LONG_TIMEOUT=30.0, fail=1)
    assert said(p, 3.0) == [LOST, short(CIRCLE)]
    assert p.ask(SET_MODE, 1, LOITER) == ACCEPTED
    p.m.SIM_RC_FAIL = 0
    assert said(p, 2.0) == [BACK, (WARNING, "Short Failsafe Cleared")]
    assert p.m.mode == LOITER


@pytest.mark.parametrize(
    ("mode", "action", "other"),
    [
        (MANUAL, 0, CIRCLE),
        (FBWA, 1, CIRCLE),
        (CRUISE, 2, FBWA),
        (FBWB, 2, FBWA),
        (MANUAL, 4, FBWB),
        (FBWA, 2, FBWA),
        (GUIDED, 0, GUIDED),
        (LOITER, 0, LOITER),
        (GUIDED, 1, CIRCLE),
        (LOITER, 2, FBWA),
        (AUTO, 0, AUTO),
        (AUTO, 4, FBWB),
        (RTL, 1, RTL),
        (CIRCLE, 2, CIRCLE),
    ],
)
def test_what_a_short_loss_leads_to(mode: int, action: int, other: int) -> None:
    p = high(GUIDED)
    if mode == AUTO:
        assert upload(p, [(WAYPOINT, 2000.0, 0.0, 100.0, (0.0, 0.0))]) == 0
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    with_values(p, FS_SHORT_ACTN=action, FS_LONG_TIMEOUT=30.0, fail=2)
    assert said(p, 3.0) == [LOST, short(other, mode != other)]
    assert p.m.mode == other
    p.m.SIM_RC_FAIL = 0
    restored = [(INFO, f"Flight mode {NAMES[mode]} restored")] if mode != other else []
    if mode == AUTO != other:
        restored.insert(0, (INFO, "Mission: 1 WP"))
    assert said(p, 2.0) == [BACK, (WARNING, "Short Failsafe Cleared"), *restored]
    assert p.m.mode == mode


def test_the_short_one_may_be_off() -> None:
    p = with_values(high(CRUISE), FS_SHORT_ACTN=3, fail=2)
    events = when_told(p, 8.0)
    assert [text for _, text in events] == [LOST, long(RTL)]
    assert [time for time, _ in events] == pytest.approx([0.2, 5.0], abs=0.15)
    assert p.m.mode == RTL


@pytest.mark.parametrize(("short_action", "at"), [(0, 0.2 + 3.0), (3, 3.0)])
@pytest.mark.parametrize("timeout", [0.5, 2.5])
def test_times_of_a_lost_radio(short_action: int, at: float, timeout: float) -> None:
    """The short one follows at once, whatever FS_SHORT_TIMEOUT, and the long one counts from it."""
    p = with_values(high(CRUISE), FS_SHORT_ACTN=short_action, FS_SHORT_TIMEOUT=timeout, FS_LONG_TIMEOUT=3.0, fail=2)
    events = when_told(p, 5.0)
    first = [(0.2, LOST), (0.2, short(CIRCLE))] if short_action == 0 else [(0.2, LOST)]
    assert [text for _, text in events] == [*(text for _, text in first), long(RTL)]
    assert [time for time, _ in events] == pytest.approx([*(time for time, _ in first), at], abs=0.15)


def test_an_emergency_landing_glides() -> None:
    p = high(CRUISE)
    assert p.ask(AUX, EMERGENCY_LANDING, 2) == ACCEPTED
    with_values(p, FS_SHORT_ACTN=4, FS_LONG_ACTN=1, fail=1)
    assert said(p, 8.0) == [LOST, short(FBWA), long(FBWA)]
    p = high(CIRCLE)
    assert p.ask(AUX, EMERGENCY_LANDING, 2) == ACCEPTED
    assert p.ask(AUX, EMERGENCY_LANDING, 0) == ACCEPTED
    with_values(p, fail=1)
    assert said(p, 8.0) == [LOST, short(CIRCLE, False), long(RTL)]


# ---- radio, long ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "action", "other"),
    [
        (CRUISE, 0, RTL),
        (CRUISE, 1, RTL),
        (CRUISE, 2, FBWA),
        (LOITER, 0, RTL),
        (GUIDED, 0, GUIDED),
        (GUIDED, 1, RTL),
        (GUIDED, 2, FBWA),
        (GUIDED, 4, AUTO),
        (AUTO, 0, AUTO),
        (AUTO, 1, RTL),
        (RTL, 1, RTL),
        (RTL, 4, AUTO),
    ],
)
def test_what_a_long_loss_leads_to(mode: int, action: int, other: int) -> None:
    p = high(GUIDED)
    assert upload(p, [(WAYPOINT, 2000.0, 0.0, 100.0, (0.0, 0.0))]) == 0
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    with_values(p, FS_LONG_ACTN=action, FS_SHORT_ACTN=0, fail=1)
    events = when_told(p, 7.0)
    middle = CIRCLE if mode == CRUISE else mode
    item = [(INFO, "Mission: 1 WP")] if other == AUTO != mode else []
    assert [text for _, text in events] == [LOST, short(middle, middle != mode), *item, long(other)]
    assert events[-1][0] == pytest.approx(1.2 + 5.0, abs=0.15)  # FS_LONG_TIMEOUT after the short one
    assert p.m.mode == other
    p.m.SIM_RC_FAIL = 0
    assert said(p, 2.0) == [BACK, (WARNING, "RC Long Failsafe Cleared")]
    assert p.m.mode == other  # it does not come back


def test_a_parachute_is_told_as_released_where_there_is_none() -> None:
    p = with_values(high(CRUISE), FS_LONG_ACTN=3, fail=1)
    assert said(p, 7.0) == [LOST, short(CIRCLE), (CRITICAL, "Parachute: Released"), long(CIRCLE)]
    assert p.m.mode == CIRCLE


@pytest.mark.parametrize(("action", "then"), [(0, RTL), (2, FBWA)])
def test_a_take_off_is_finished_first_unless_it_glides(action: int, then: int) -> None:
    p = made("plane", pilot={"TKOFF_ALT": 60.0, "FS_LONG_ACTN": action, "FS_LONG_TIMEOUT": 2.0})
    p.until(2.5)
    assert p.ask(SET_MODE, 1, TAKEOFF) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p.until(5.0)
    texts(p)
    p.m.SIM_RC_FAIL = 2
    assert said(p, 3.0) == [LOST, short(TAKEOFF, False), long(TAKEOFF if then == RTL else then)]
    assert p.m.taking_off == (then == RTL)
    if then == RTL:
        assert said(p, 20.0) == [(INFO, "Takeoff level-off starting at 10m"), long(RTL)]
        assert -p.place[2] > 50.0
    assert p.m.mode == then


# ---- sticks --------------------------------------------------------------------------------------------------------


def held(p: Pair, throttle: int, seconds: float, roll: int = 1700) -> list[tuple[int, str]]:
    p.hold(seconds, (roll, 1500, throttle, 1500), 0.25)
    return texts(p)


@pytest.mark.parametrize(("enabled", "expected"), [(0, []), (1, [LOST, short(CIRCLE)]), (2, [])])
def test_a_throttle_pulse_not_above_its_value_is_a_lost_radio(enabled: int, expected: list[tuple[int, str]]) -> None:
    p = with_values(high(FBWA), THR_FAILSAFE=enabled, FS_LONG_TIMEOUT=30.0)
    assert held(p, 951, 2.0) == []
    assert p.m.motor[0] != 0.5
    assert held(p, 950, 2.0) == expected
    assert held(p, 950, 4.0) == []
    banked = abs(angles(p)[0])
    if enabled == 0:
        assert banked > 7.0  # the stick still counts
    if enabled == 2:  # it does not, and nothing else happens
        assert banked < 4.0 and p.m.motor[3] == pytest.approx(0.5, abs=0.05) and p.m.mode == FBWA
    assert held(p, 1300, 1.0)[:1] == ([BACK] if enabled == 1 else [])
    assert p.m.mode == FBWA


def test_a_long_loss_clears_the_overrides_and_a_switch_is_not_read_meanwhile() -> None:
    p = with_values(high(FBWA), FLTMODE6=MANUAL, FLTMODE1=FBWB)
    pulses = [1700, 1500, 940, 1500, 0, 0, 0, 1000]
    p.hold(4.0, pulses, 0.25)
    assert texts(p) == [LOST, short(CIRCLE)]  # not FBWB
    p.m.RC_OVERRIDE_TIME = -1.0
    p.hold(0.25, pulses, 0.25)  # for ever
    assert said(p, 3.0) == [long(RTL), BACK, (WARNING, "RC Long Failsafe Cleared")]
    assert p.m.rc_override.tolist() == [0] * 8


def test_a_mode_switch_stays_where_it_is_while_the_radio_is_lost() -> None:
    p = with_values(high(FBWA), FLTMODE6=MANUAL, FLTMODE1=FBWB, FS_LONG_TIMEOUT=30.0)
    p.hold(1.0, [1700, 1500, 1400, 1500, 0, 0, 0, 1000], 0.25)
    assert p.m.mode == FBWB
    p.hold(4.0, [1700, 1500, 940, 1500, 0, 0, 0, 1000], 0.25)
    assert p.m.mode == CIRCLE  # neither FBWB again nor MANUAL, as that of the receiver would be
    p.hold(1.0, [1700, 1500, 1400, 1500, 0, 0, 0, 1000], 0.25)
    assert p.m.mode == FBWB
    assert [text for _, text in texts(p)][-1] == "Flight mode FLY_BY_WIRE_B restored"


def test_the_rotors_keep_a_half_open_throttle_while_the_radio_is_lost() -> None:
    p = with_values(hovering(QSTABILIZE), FS_SHORT_ACTN=3, FS_LONG_TIMEOUT=30.0)
    p.hold(1.5, [1500, 1500, 940, 1500], 0.25)
    assert texts(p) == [LOST]
    assert p.m.mode == QSTABILIZE and p.m.lift == pytest.approx(float(p.m.Q_M_THST_HOVER), abs=0.02)


@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_without_a_radio_from_the_start_it_is_not_armed(kind: str) -> None:
    p = made(kind, pilot={"SIM_RC_FAIL": 1})
    p.until(6.0)
    assert texts(p) == []
    for forced in (0, 21196):
        assert p.ask(ARM, 1, forced) == FAILED
        assert texts(p) == [(CRITICAL, "Arm: Waiting for RC")]
    p.m.THR_FAILSAFE = 0
    assert p.ask(ARM, 1) == ACCEPTED


def test_with_a_radio_that_is_lost_it_is_not_armed() -> None:
    p = made("plane")
    p.until(3.0)
    p.m.SIM_RC_FAIL = 1
    assert said(p, 2.0) == [LOST, short(CIRCLE)]
    assert p.ask(ARM, 1) == FAILED
    assert texts(p)[0] == (CRITICAL, "Arm: Radio failsafe on")
    p.m.SIM_RC_FAIL = 0
    assert said(p, 1.0)[0] == BACK
    assert p.ask(ARM, 1) == ACCEPTED


def test_overrides_stand_in_for_a_silent_receiver() -> None:
    p = with_values(high(FBWA), RC_OVERRIDE_TIME=1.0, FS_LONG_TIMEOUT=30.0)
    assert held(p, 1400, 0.5) == []
    p.m.SIM_RC_FAIL = 1
    assert held(p, 1400, 5.0) == []
    assert said(p, 5.0) == [LOST, short(CIRCLE)]


def test_nothing_fails_with_the_simulated_receiver() -> None:
    for pair in (high(FBWA), hovering(QHOVER)):
        m = pair.m
        assert (m.FS_SHORT_ACTN, m.FS_SHORT_TIMEOUT, m.FS_LONG_ACTN, m.FS_LONG_TIMEOUT) == (0, 1.5, 0, 5.0)
        assert (m.THR_FAILSAFE, m.THR_FS_VALUE, m.FS_GCS_ENABL) == (1, 950, 0)  # ArduPlane's
        assert said(pair, 8.0) == []


# ---- ground station ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("enabled", "mode", "action", "other"),
    [
        (1, CRUISE, 0, RTL),
        (2, CRUISE, 2, FBWA),
        (1, GUIDED, 0, GUIDED),
        (1, GUIDED, 1, RTL),
        (3, AUTO, 1, RTL),
    ],
)
def test_a_lost_station_is_a_long_loss(enabled: int, mode: int, action: int, other: int) -> None:
    p = high(GUIDED)
    assert upload(p, [(WAYPOINT, 2000.0, 0.0, 100.0, (0.0, 0.0))]) == 0
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    with_values(p, FS_GCS_ENABL=enabled, FS_LONG_ACTN=action)
    with_station(p, 2.0)
    last = p.time - 1.0
    events = when_told(p, 6.0)
    assert [text for _, text in events] == [long(other, "GCS")]
    assert events[0][0] + 1.0 == pytest.approx(5.0, abs=0.15)  # FS_LONG_TIMEOUT from the last HEARTBEAT
    assert p.m.mode == other and last > 0.0
    with_station(p, 1.0)
    assert texts(p) == [(WARNING, "GCS Failsafe Off")]
    assert p.m.mode == other


@pytest.mark.parametrize("system", [0, 254])
def test_a_station_counts_as_heard_at_the_boot_and_another_one_does_not(system: int) -> None:
    p = high(CRUISE)
    assert p.m.station_known and p.m.station_heard == 0.0
    if system:
        with_station(p, 1.0, system)
    texts(p)
    p.m.FS_GCS_ENABL = 1
    assert said(p, 1.0) == [long(RTL, "GCS")]
    assert p.m.mode == RTL


@pytest.mark.parametrize("enabled", [0, 3])
def test_a_lost_station_is_nothing_where_it_is_not_asked_for_or_not_in_auto(enabled: int) -> None:
    p = with_values(high(CRUISE), FS_GCS_ENABL=enabled)
    with_station(p, 2.0)
    assert said(p, 8.0) == []
    assert p.m.mode == CRUISE


def reported(p: Pair, seconds: float, strength: int) -> None:
    """A ground station and a radio speak once a second."""
    radio = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    for _ in range(int(seconds)):
        p.waiting += mavlink.MAVLink_radio_status_message(180, strength, 100, 40, 40, 0, 0).pack(radio)
        with_station(p, 1.0)


@pytest.mark.parametrize("enabled", [1, 2])
def test_a_radio_that_reports_no_other_end_is_a_lost_station(enabled: int) -> None:
    p = with_values(high(CRUISE), FS_GCS_ENABL=enabled, FS_LONG_TIMEOUT=4.0)
    reported(p, 8.0, 0)
    assert texts(p) == []  # it has never reported one
    reported(p, 3.0, 170)
    reported(p, 2.0, 0)
    assert texts(p) == []
    reported(p, 2.0, 0)
    found = texts(p)
    assert found[:2] == ([long(RTL, "GCS"), (WARNING, "GCS Failsafe Off")] if enabled == 2 else [])
    assert p.m.mode == (RTL if enabled == 2 else CRUISE)


def test_sticks_are_a_sign_of_life() -> None:
    p = with_values(high(FBWA), FS_GCS_ENABL=1)
    assert held(p, 1400, 8.0) == []
    assert said(p, 7.0) == [long(RTL, "GCS")]


# ---- on the rotors -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [QSTABILIZE, QHOVER, QLOITER, QACRO])
def test_modes_on_the_rotors_land(mode: int) -> None:
    p = with_values(hovering(mode), FS_SHORT_ACTN=2, FS_LONG_TIMEOUT=30.0, fail=2)
    assert said(p, 2.0) == [LOST, short(QLAND)]
    assert p.m.mode == QLAND


@pytest.mark.parametrize(
    ("options", "other"), [(0, QLAND), (1 << 5, QRTL), (1 << 20, RTL), (1 << 5 | 1 << 20, RTL), (1 << 4, QLAND)]
)
@pytest.mark.parametrize("cause", ["RC", "GCS"])
def test_options_choose_among_landing_and_returns(cause: str, options: int, other: int) -> None:
    p = with_values(hovering(QLOITER), Q_OPTIONS=options, FS_GCS_ENABL=1 if cause == "GCS" else 0, FS_LONG_ACTN=2)
    if cause == "GCS":
        with_station(p, 1.0)
    else:
        p.m.SIM_RC_FAIL = 2
    expected = [long(other, "GCS")] if cause == "GCS" else [LOST, short(other)]
    assert [text for text in said(p, 4.5) if text[0] == WARNING] == expected
    assert p.m.mode == other


def test_a_mission_that_takes_off_vertically_lands_and_one_that_lands_goes_on() -> None:
    p = made("quadplane", pilot={"FS_LONG_ACTN": 1, "FS_SHORT_ACTN": 1})
    p.until(2.5)
    take_off, land = mavlink.MAV_CMD_NAV_VTOL_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_LAND
    items = [(take_off, 0.0, 0.0, 40.0, (0.0, 0.0)), (land, 20.0, 0.0, 0.0, (0.0, 0.0))]
    assert upload(p, items) == 0
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    p.until(8.0)
    assert p.m.taking_off and -p.place[2] > 5.0
    with_values(p, FS_GCS_ENABL=1)
    with_station(p, 1.0)
    assert long(QLAND, "GCS") in said(p, 5.0)
    assert p.m.mode == QLAND
    p = made("quadplane", pilot={"FS_LONG_ACTN": 1, "FS_SHORT_ACTN": 1})
    p.until(2.5)
    assert upload(p, items) == 0
    assert p.ask(SET_MODE, 1, AUTO) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    while p.m.mission_current < 2:
        p.one_step()
        assert p.time < 60.0
    texts(p)
    p.m.SIM_RC_FAIL = 2
    found = [text for text in said(p, 6.0) if text[0] == WARNING]
    assert found == [LOST, short(AUTO, False), long(AUTO)]
    assert p.m.mode == AUTO

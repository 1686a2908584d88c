"""Fail-safes of planes and quadplanes: a lost radio, a lost ground station, and a low battery.

Ten times a second. The radio is lost when the receiver gives no pulses for a second, or the throttle's are not above
THR_FS_VALUE, and 0.2 s have passed since then; meanwhile the sticks count as centred and the throttle as closed, and
switches are not read. FS_SHORT_ACTN follows at once, and the mode returns when the radio does; FS_LONG_ACTN follows
FS_LONG_TIMEOUT later (with FS_SHORT_ACTN 3, as long after the last good pulse), and after as long a silence of the
ground station, or, with FS_GCS_ENABL 2, of the radio's reports that the ground station's hears it (RADIO_STATUS with a
remrssi). Modes on the rotors change to QLAND, QRTL or RTL (Q_OPTIONS) instead. Kernels over a record with
`FAILSAFE_PARAMETERS` and `FAILSAFE_MEMORY` beside the variables of `gcs.record` and `wing.functions`.

There is no parachute; as by an ArduPlane without one, it is told as released. As in the ArduPlane of the recorded
answers, FS_SHORT_TIMEOUT does not delay anything: it is how recently the ground station has to be heard for its
fail-safe to end.

Source: ArduPilot, ArduPlane/events.cpp, radio.cpp (control_failsafe), system.cpp (check_long_failsafe), Plane.h
(urgency of the battery's actions), mode_takeoff.cpp; SITL (SIM_RC_FAIL, the throttle that drains the battery).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_SEVERITY_CRITICAL, MAV_SEVERITY_INFO, MAV_SEVERITY_WARNING
from cosim_models.autopilot.gcs.battery import (
    BATTERY_MEMORY,
    alarming,
    battery_parameters,
    drain,
)
from cosim_models.autopilot.gcs.contact import CONTACT_MEMORY, is_unreported, station_is_lost
from cosim_models.autopilot.gcs.positioning import GPS_MEMORY, GPS_PARAMETERS, watch_gps
from cosim_models.autopilot.gcs.record import real, whole
from cosim_models.autopilot.gcs.sticks import THROTTLE, is_held, receiver_pulse
from cosim_models.autopilot.gcs.words import (
    AFS_OFF,
    GCS_BACK,
    GCS_MODE,
    LONG_CLEARED,
    LONG_MODE,
    PARACHUTE,
    RESTORED,
    SHORT_CLEARED,
    SHORT_MODE,
    SHORT_ON,
    THROTTLE_BACK,
    THROTTLE_LOST,
    say,
    say_mode,
)
from cosim_models.autopilot.wing.sequence import jump_to_landing

__all__ = ["FAILSAFE_MEMORY", "FAILSAFE_PARAMETERS", "drain_battery", "failsafes"]

_PERIOD = 0.1  # s
_NONE, _SHORT, _LONG, _GCS = range(4)  # m.failsafe_state
_NO_PULSES, _LOW_THROTTLE = 1, 2  # SIM_RC_FAIL
_LOW_PULSE, _CLOSED = 950, 1000  # us
_NO_RADIO, _COUNT = 1.0, 2  # s without pulses, and checks, after which the radio is lost
_ON = 1  # THR_FAILSAFE
_GUESS, _SHORT_FBWA, _SHORT_OFF, _SHORT_FBWB = 0, 2, 3, 4  # FS_SHORT_ACTN
_GO_ON, _GLIDE, _PARACHUTE, _TO_AUTO, _TO_AUTOLAND = 0, 2, 3, 4, 5  # FS_LONG_ACTN
_ALWAYS, _REPORTED, _IN_AUTO = (1, 2), 2, 3  # FS_GCS_ENABL
_CIRCLE, _FBWA, _FBWB, _AUTO, _RTL, _LOITER, _TAKEOFF, _AVOID_ADSB, _GUIDED = 1, 5, 6, 10, 11, 12, 13, 14, 15
_QLAND, _LOITER_ALT_QLAND, _AUTOLAND = 20, 25, 26
_BY_STICKS = (0, 2, 3, 4, 5, 6, 7, 8)  # MANUAL, STABILIZE, TRAINING, ACRO, FBWA, FBWB, CRUISE, AUTOTUNE
_TO_RTL, _LAND, _TERMINATE, _TO_QLAND, _RELEASE, _LOITER_TO_QLAND, _LAND_OR_RTL = range(1, 8)  # of the battery
_URGENCY = (_TERMINATE, _RELEASE, _TO_QLAND, _LAND, _TO_RTL, 0)
_PROPELLER, _FIRST_ROTOR, _LAST_ROTOR = 2, 4, 7  # elements of `motor`

FAILSAFE_PARAMETERS = (
    whole(
        "FS_SHORT_ACTN",
        0,
        "short loss of radio: 0 CIRCLE, AUTO, GUIDED, LOITER go on; 1 CIRCLE, 2 FBWA, 3 none, 4 FBWB",
    ),
    real("FS_SHORT_TIMEOUT", "s", 1.5, "the fail-safe of the ground station ends when it was heard within this time"),
    whole("FS_LONG_ACTN", 0, "long loss: 0 RTL, AUTO and GUIDED go on; 1 RTL, 2 FBWA, 3 parachute, 4 AUTO, 5 AUTOLAND"),
    real("FS_LONG_TIMEOUT", "s", 5.0, "time from FS_SHORT_ACTN on after which FS_LONG_ACTN follows"),
    whole(
        "FS_GCS_ENABL",
        0,
        "1, 2: a lost ground station is a fail-safe; 2: one that its radio does not report, too; 3: in AUTO alone",
    ),
    whole(
        "THR_FAILSAFE",
        _ON,
        "1: a lost radio is a fail-safe; 2: it centres the sticks alone; 0: the throttle is no sign",
    ),
    whole("THR_FS_VALUE", 950, "greatest throttle pulse that means a lost radio, us"),
    whole("SIM_RC_FAIL", 0, "1: the simulated receiver gives no pulses; 2: sticks centred, throttle 950 us"),
    *GPS_PARAMETERS,
    *battery_parameters(
        "0 none, 1 RTL, 2 landing, 3 termination, 4 QLAND, 5 parachute, 6 LOITER_ALT_QLAND, 7 AUTOLAND"
    ),
)
FAILSAFE_MEMORY = (
    Memory("failsafe_due"),  # s
    Memory("failsafe_state", dtype="i4", rare=True),
    Memory("mode_before", dtype="i4", rare=True),  # of the short fail-safe
    Memory("mode_by_radio", dtype="?", rare=True),  # the mode is that of a fail-safe of the radio
    Memory("long_pending", dtype="?", rare=True),  # it waits for the end of a take-off
    Memory("lands_on_wheels", dtype="?", rare=True),  # it is on the final of a landing on wheels
    Memory("short_since", rare=True),  # s, of the short fail-safe
    Memory("radio_count", dtype="i4", rare=True),  # checks in a row without a radio
    Memory("radio_lost", dtype="?", rare=True),
    Memory("radio_known", dtype="?", rare=True),  # it has been heard
    *CONTACT_MEMORY,
    *GPS_MEMORY,
    *BATTERY_MEMORY,
)


@kernel
def drain_battery(m: Any, t: float) -> None:
    """Drains the battery for the propeller, or, if it stands, for the mean of the lifting rotors that turn."""
    load, turning = float(m.motor[_PROPELLER]), 0
    if load == 0.0:
        for i in range(_FIRST_ROTOR, _LAST_ROTOR + 1):
            if m.motor[i] > 0.0:
                load += m.motor[i]
                turning += 1
        load = load / turning if turning > 0 else 0.0
    drain(m, load, t)


@kernel
def _cannot_fail(m: Any) -> bool:
    """Returns whether nothing can be a cause: there has been no stick, and all else is off."""
    causes = m.FS_GCS_ENABL | m.SIM_RC_FAIL | m.failsafe_state | m.radio_count
    return bool(causes == 0 and not m.sticks_known and m.THR_FS_VALUE < _CLOSED)


@kernel
def _watch_radio(m: Any, t: float) -> None:
    """Looks for a radio, and ignores its sticks while it is not there."""
    held = is_held(m, THROTTLE, t)
    pulse = m.rc_override[THROTTLE] if held else receiver_pulse(m, THROTTLE)
    if not held and m.SIM_RC_FAIL == _LOW_THROTTLE:
        pulse = _LOW_PULSE
    low = m.THR_FAILSAFE != 0 and pulse <= m.THR_FS_VALUE
    heard = held or m.SIM_RC_FAIL != _NO_PULSES
    m.radio_known = m.radio_known or heard
    if heard and not low:
        m.radio_heard = t
    m.sticks_ignored = low or t - m.radio_heard > _NO_RADIO
    if not (m.armed or m.radio_known):
        return
    m.radio_count = min(m.radio_count + 1, _COUNT) if m.sticks_ignored else 0
    if m.radio_count == _COUNT and not m.radio_lost and m.THR_FAILSAFE == _ON:
        m.radio_lost = True
        say(m, MAV_SEVERITY_WARNING, THROTTLE_LOST, 0)
    elif m.radio_count == 0 and m.radio_lost:
        m.radio_lost = False
        say(m, MAV_SEVERITY_WARNING, THROTTLE_BACK, 0)


@kernel
def _short_mode(m: Any, landing: bool, lifted: int) -> int:
    """Returns the mode that a short loss of the radio leads to, that of now: none."""
    action = m.FS_SHORT_ACTN
    if m.mode in _BY_STICKS:
        if m.emergency_landing:
            return _FBWA
    elif m.mode in (_AUTO, _AVOID_ADSB, _GUIDED, _LOITER, _AUTOLAND):
        if landing or action == _GUESS:
            return int(m.mode)
    else:
        return lifted if lifted >= 0 else int(m.mode)
    return _FBWA if action == _SHORT_FBWA else _FBWB if action == _SHORT_FBWB else _CIRCLE


def _long_events(
    enter: Callable[[Any, int, float], int], lands: Callable[[Any], bool], lifted: Callable[[Any], int]
) -> Callable[[Any, int, float], None]:
    """Returns a kernel of (record, cause, time [s]) for a long loss; the arguments are those of `failsafes`."""

    @kernel
    def act(m: Any, t: float) -> None:
        if m.FS_LONG_ACTN == _PARACHUTE:
            say(m, MAV_SEVERITY_CRITICAL, PARACHUTE, 0)
        elif m.FS_LONG_ACTN == _GLIDE:
            enter(m, _FBWA, t)
        elif m.FS_LONG_ACTN == _TO_AUTO:
            enter(m, _AUTO, t)
        elif m.FS_LONG_ACTN != _TO_AUTOLAND or enter(m, _AUTOLAND, t) != MAV_RESULT_ACCEPTED:
            enter(m, _RTL, t)

    @kernel
    def lose(m: Any, cause: int, t: float) -> None:
        for i in range(m.rc_override.shape[0]):
            m.rc_override[i] = 0
        m.failsafe_state = cause
        m.long_pending = False
        rotors = lifted(m)
        if m.mode in _BY_STICKS or m.mode in (_CIRCLE, _LOITER, _TAKEOFF):
            stays = m.FS_LONG_ACTN not in (_GLIDE, _PARACHUTE)
            if m.mode == _TAKEOFF and m.taking_off and stays:
                m.long_pending = True
            elif m.emergency_landing:
                enter(m, _FBWA, t)
            else:
                act(m, t)
        elif m.mode == _AUTO and lands(m):
            pass
        elif rotors >= 0:
            enter(m, rotors, t)
        elif m.mode in (_AUTO, _AVOID_ADSB, _GUIDED):
            if m.FS_LONG_ACTN != _GO_ON:
                act(m, t)
        elif m.mode == _RTL and m.FS_LONG_ACTN in (_TO_AUTO, _TO_AUTOLAND):
            enter(m, _AUTO if m.FS_LONG_ACTN == _TO_AUTO else _AUTOLAND, t)
        say_mode(m, MAV_SEVERITY_WARNING, GCS_MODE if cause == _GCS else LONG_MODE, m.mode)

    return lose


def _battery_events(
    enter: Callable[[Any, int, float], int], lands: Callable[[Any], bool]
) -> Callable[[Any, int, float], None]:
    """Returns a kernel of (record, action, time [s]) for an alarm; the arguments are those of `failsafes`."""

    @kernel
    def act(m: Any, action: int, t: float) -> None:
        if action == _TERMINATE:
            say(m, MAV_SEVERITY_INFO, AFS_OFF, 0)
            return
        if action == _RELEASE:
            say(m, MAV_SEVERITY_CRITICAL, PARACHUTE, 0)
            return
        if m.lifts and action in (_TO_QLAND, _LOITER_TO_QLAND):
            enter(m, _QLAND if action == _TO_QLAND else _LOITER_ALT_QLAND, t)
            return
        if not _TO_RTL <= action <= _LAND_OR_RTL or m.mode in (_QLAND, _LOITER_ALT_QLAND, _AUTOLAND):
            return
        if m.mode == _AUTO and lands(m):
            return
        if action != _TO_RTL and action != _LAND_OR_RTL and jump_to_landing(m):
            enter(m, _AUTO, t)
            return
        if not lands(m) and (action != _LAND_OR_RTL or enter(m, _AUTOLAND, t) != MAV_RESULT_ACCEPTED):
            enter(m, _RTL, t)

    return act


def failsafes(
    enter: Callable[[Any, int, float], int],
    lands: Callable[[Any], bool],
    lifted: Callable[[Any], int],
    more: Callable[[Any, float], None],
) -> Callable[[Any, float], None]:
    """Returns a kernel of (record, time [s]) that runs the fail-safes; it is required from m.failsafe_due on.

    Args:
        enter: kernel of (record, mode, time) that changes the mode, which takes m.mode_by_radio back; returns a
            MAV_RESULT.
        lands: kernel of (record): whether it is on its way to a landing of its mission, or to one of QRTL.
        lifted: kernel of (record): the mode that a loss leads to in this mode on the rotors; -1: it is not on them.
        more: kernel of (record, time) that is called in each look.
    """
    lose = _long_events(enter, lands, lifted)
    act_on_battery = _battery_events(enter, lands)
    new_action = alarming(_URGENCY)

    @kernel
    def watch_short(m: Any, t: float) -> None:
        off = m.FS_SHORT_ACTN == _SHORT_OFF
        if m.radio_lost and not off and m.failsafe_state == _NONE and not m.lands_on_wheels:
            m.failsafe_state = _SHORT
            m.short_since = t
            m.mode_before = m.mode
            mode = _short_mode(m, lands(m), -1 if m.mode == _AUTO else lifted(m))
            if mode != m.mode and enter(m, mode, t) == MAV_RESULT_ACCEPTED:
                m.mode_by_radio = True
            text = SHORT_MODE if m.mode != m.mode_before else SHORT_ON
            say_mode(m, MAV_SEVERITY_WARNING, text, m.mode)
        elif m.failsafe_state == _SHORT and (off or not m.radio_lost):
            m.failsafe_state = _NONE
            say(m, MAV_SEVERITY_WARNING, SHORT_CLEARED, 0)
            if m.mode_by_radio:
                enter(m, m.mode_before, t)
                say_mode(m, MAV_SEVERITY_INFO, RESTORED, m.mode)

    @kernel
    def watch_long(m: Any, t: float) -> None:
        if m.failsafe_state < _LONG and not m.lands_on_wheels:
            watched = m.FS_GCS_ENABL in _ALWAYS or (m.FS_GCS_ENABL == _IN_AUTO and m.mode == _AUTO)
            since = m.short_since if m.failsafe_state == _SHORT else m.radio_heard
            if m.radio_lost and t - since > m.FS_LONG_TIMEOUT:
                lose(m, _LONG, t)
            elif (watched and station_is_lost(m, m.FS_LONG_TIMEOUT, t)) or (
                m.FS_GCS_ENABL == _REPORTED and is_unreported(m, m.FS_LONG_TIMEOUT, t)
            ):
                lose(m, _GCS, t)
            return
        patience = m.FS_LONG_TIMEOUT if m.FS_SHORT_ACTN == _SHORT_OFF else m.FS_SHORT_TIMEOUT
        if m.failsafe_state == _LONG and not m.radio_lost:
            say(m, MAV_SEVERITY_WARNING, LONG_CLEARED, 0)
            m.failsafe_state = _NONE
        elif m.failsafe_state == _GCS and not station_is_lost(m, patience, t):
            say(m, MAV_SEVERITY_WARNING, GCS_BACK, 0)
            m.failsafe_state = _NONE
        elif m.long_pending and not m.taking_off:
            lose(m, m.failsafe_state, t)

    @kernel
    def watch(m: Any, t: float) -> None:
        m.failsafe_due = t + _PERIOD - 1e-9
        more(m, t)
        if m.SIM_GPS1_ENABLE == 0 or m.gps_off or m.gps_lost_at >= 0.0:
            watch_gps(m, t)
        drain_battery(m, t)
        action = new_action(m, t)
        if action != 0:
            act_on_battery(m, action, t)
        if _cannot_fail(m):
            m.radio_heard, m.radio_known = t, True
        else:
            _watch_radio(m, t)
            watch_short(m, t)
            watch_long(m, t)
        m.critical = m.failsafe_state != _NONE or m.battery_alarm != 0

    return watch

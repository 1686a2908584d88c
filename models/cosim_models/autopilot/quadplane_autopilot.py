"""The quadplane autopilot FMU: ArduPlane's modes and MAVLink behaviour for fixed wings with lifting rotors.

It takes off and lands vertically, hovers at places, and flies on its wing over longer distances. In GUIDED with
Q_GUIDED_MODE 1, a new target farther away than WP_LOITER_RAD is flown to on the wing, a nearer one on the rotors, and
the vehicle hovers at it; with 0, it circles its target as a fixed wing. NAV_TAKEOFF in GUIDED, and the missions' take-
offs, are vertical; VTOL_LAND, LAND, QLAND and QRTL land vertically, as does LOITER_ALT_QLAND after a descent on the
wing. A pilot flies QSTABILIZE, QHOVER, QLOITER and QACRO (`wing.lifted`); without one, QHOVER keeps level, QLOITER its
place. STABILIZE, FBWA, FBWB, CRUISE and AUTOTUNE get onto the wing with its own throttle; in MANUAL, TRAINING and ACRO
the rotors stop. All other modes and answers are those of `PlaneAutopilot`. `wing.transition` describes the ways between
rotors and wing.

Differences from ArduPlane: those of `PlaneAutopilot`; Q_GUIDED_MODE and Q_MAV_TYPE are 0 there; no assistance by angle,
no weathervaning but that by the fin, no tilting rotors, no landing on wheels (bit 2 of Q_OPTIONS).

Source: ArduPilot, ArduPlane/quadplane.cpp (modes, do_user_takeoff, is_vtol_takeoff, transitions), mode_guided.cpp.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, ClassVar

from cosim import Memory, Model
from cosim.kernel import kernel
from cosim.messages import (
    HEARTBEAT,
    MAV_CMD_BATTERY_RESET,
    MAV_CMD_DO_AUTOTUNE_ENABLE,
    MAV_CMD_DO_AUX_FUNCTION,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_LAND_START,
    MAV_CMD_DO_SET_MISSION_CURRENT,
    MAV_CMD_DO_VTOL_TRANSITION,
    MAV_CMD_MISSION_START,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_VTOL_LAND,
    MAV_CMD_NAV_VTOL_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_CMD_RUN_PREARM_CHECKS,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_SEVERITY_WARNING,
    MAV_TYPE_FIXED_WING,
    MAV_TYPE_VTOL_QUADROTOR,
    RADIO_STATUS,
)
from cosim.vehicle import Airframe
from cosim_models.autopilot.gcs.battery import reset_battery
from cosim_models.autopilot.gcs.commands import firmware, receiver, repeat_home, told
from cosim_models.autopilot.gcs.contact import note_report, note_station
from cosim_models.autopilot.gcs.devices import continue_motor_test
from cosim_models.autopilot.gcs.items import begin_items, complete_item, tell_item
from cosim_models.autopilot.gcs.missions import (
    COMMAND,
    continue_upload,
    item_place,
    mission_protocol,
    set_current,
    tell_reached,
)
from cosim_models.autopilot.gcs.parameters import parameter_protocol
from cosim_models.autopilot.gcs.positioning import start_gps
from cosim_models.autopilot.gcs.rebooting import rebooting
from cosim_models.autopilot.gcs.record import HOLD, MISSION, POSITION, pilot_variables, whole
from cosim_models.autopilot.gcs.sticks import STICK_PARAMETERS, hear_sticks
from cosim_models.autopilot.gcs.streams import heading, ready, start_streams, stream
from cosim_models.autopilot.gcs.switches import start_switches, switch_parameters, switches
from cosim_models.autopilot.gcs.targets import go_to, height_target, hold_here, home_here
from cosim_models.autopilot.gcs.words import (
    FLYING,
    LANDED,
    MISSION_COMPLETE,
    NEAR,
    NO_AUTOLAND,
    NO_TUNING,
    NOT_ARMED,
    NOT_FLYING,
    TAKEOFF_GUIDED,
    TRANSITION_AUTO,
    say,
    say_figures,
)
from cosim_models.autopilot.wing.arming import ARMING_MEMORY, checking, lifted_checks, lifted_missions
from cosim_models.autopilot.wing.attitude import rest
from cosim_models.autopilot.wing.autotune import enable_tuning, end_tuning, start_tuning
from cosim_models.autopilot.wing.circling import is_on_circle, leave_circle
from cosim_models.autopilot.wing.failsafes import FAILSAFE_MEMORY, FAILSAFE_PARAMETERS, drain_battery, failsafes
from cosim_models.autopilot.wing.flight import (
    WING_MEMORY,
    bank_for,
    change_speed,
    cruise_speed,
    launch,
    take_off,
    wing_parameters,
)
from cosim_models.autopilot.wing.functions import FUNCTION_MEMORY, MODE_FUNCTIONS, SWITCHED_MODES, own_functions
from cosim_models.autopilot.wing.hover import HOVER_MEMORY, HOVER_PARAMETERS, hover, no_lift, sink
from cosim_models.autopilot.wing.legs import LEG_MEMORY, begin_leg, ends_leg
from cosim_models.autopilot.wing.lifted import LIFT_MEMORY, LIFT_PARAMETERS, begin_lifted, by_rotors, lifts_off
from cosim_models.autopilot.wing.piloted import (
    PILOT_MEMORY,
    PILOT_PARAMETERS,
    begin_pilot,
    by_hand,
    circling_bank,
    demand,
    mix_sticks,
    roll_stick,
)
from cosim_models.autopilot.wing.progress import (
    PROGRESS_MEMORY,
    begin_launch,
    tell_descent,
    tell_launch,
)
from cosim_models.autopilot.wing.returning import (
    RETURN_MEMORY,
    RETURN_PARAMETERS,
    approach_height,
    begin_return,
    climb_before_return,
)
from cosim_models.autopilot.wing.sequence import (
    SEQUENCE_MEMORY,
    SEQUENCE_PARAMETERS,
    in_landing_sequence,
    jump_to_landing,
    seeks_landing,
)
from cosim_models.autopilot.wing.transition import (
    SLOW,
    THERE,
    TRANSITION_MEMORY,
    TRANSITION_PARAMETERS,
    distance_to,
    forget_target,
    go_round,
    note_target,
    on_wing,
    on_wing_alone,
    speed_of,
    travel,
    vtol_state,
)
from cosim_models.autopilot.wing.wind import WIND_MEMORY, estimate_wind

__all__ = ["QuadplaneAutopilot"]


class QuadplaneMode(IntEnum):
    """Modes, by ArduPlane's numbers."""

    MANUAL = 0
    CIRCLE = 1
    STABILIZE = 2
    TRAINING = 3
    ACRO = 4
    FBWA = 5
    FBWB = 6
    CRUISE = 7
    AUTOTUNE = 8
    AUTO = 10
    RTL = 11
    LOITER = 12
    TAKEOFF = 13
    AVOID_ADSB = 14
    GUIDED = 15
    QSTABILIZE = 17
    QHOVER = 18
    QLOITER = 19
    QLAND = 20
    QRTL = 21
    QACRO = 23
    LOITER_ALT_QLAND = 25


_MANUAL, _CIRCLE, _STABILIZE, _TRAINING, _ACRO, _FBWA, _FBWB, _CRUISE = map(int, list(QuadplaneMode)[:8])
_AUTO, _RTL, _LOITER, _TAKEOFF, _AVOID_ADSB, _GUIDED = map(int, list(QuadplaneMode)[9:15])
_QSTABILIZE, _QHOVER, _QLOITER, _QLAND, _QRTL, _QACRO, _LOITER_ALT_QLAND = map(int, list(QuadplaneMode)[15:])
_KNOWN = tuple(map(int, QuadplaneMode))
_AUTOTUNE = int(QuadplaneMode.AUTOTUNE)
_BY_HAND = (_MANUAL, _STABILIZE, _TRAINING, _ACRO, _FBWA, _AUTOTUNE)
_PILOTED = (*_BY_HAND, _FBWB, _CRUISE, _QSTABILIZE, _QACRO)
_BY_ROTORS = (_QSTABILIZE, _QHOVER, _QLOITER, _QACRO)
_UNASSISTED = (_MANUAL, _TRAINING, _ACRO)  # the rotors stop
_FREE = (*_BY_HAND, _QSTABILIZE, _QACRO)  # need no position
_FLYING_HEIGHT, _FLYING_SPEED = 0.5, 5.0  # m above home and m/s: beyond one of them it is in the air
_SPOOL = 0.7  # s from a take-off to the climb
_CLIMBED = 0.5  # m below the end of a vertical take-off
_LANDED_SPEED, _LANDED_TIME = (
    0.1,
    6.2,
)  # m/s and s: slower than commanded for so long is landed; ArduPlane: its throttle
# is at its lower limit about 1.2 s after the touch-down, and 5 s later it has landed
_STATE_MC, _STATE_FW = 3, 4
_OPTION_QRTL, _OPTION_RTL = 1 << 5, 1 << 20  # Q_OPTIONS
_MODES = (*range(9), *range(10, 27))  # of ArduPlane
_QAUTOTUNE, _AUTOLAND = 22, 26
_FLOWN = (
    MAV_CMD_NAV_WAYPOINT,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_VTOL_TAKEOFF,
    MAV_CMD_NAV_VTOL_LAND,
    MAV_CMD_NAV_LAND,
    MAV_CMD_DO_LAND_START,
)
_NO_AIRFRAME, _BAD_SYSID, _BAD_GAIN = 1, 2, 3

VARIABLES = pilot_variables(
    (Airframe.quadplane,),
    QuadplaneMode.MANUAL,
    (
        *wing_parameters(
            AIRSPEED_CRUISE=16.0,
            AIRSPEED_MIN=12.0,
            AIRSPEED_MAX=20.0,
            TRIM_THROTTLE=70.0,
            THR_MAX=100.0,
            TKOFF_THR_MAX=100.0,
        ),
        *PILOT_PARAMETERS,
        *STICK_PARAMETERS,
        *HOVER_PARAMETERS,
        *LIFT_PARAMETERS,
        *TRANSITION_PARAMETERS,
        *SEQUENCE_PARAMETERS,
        *FAILSAFE_PARAMETERS,
        *switch_parameters("FLTMODE", SWITCHED_MODES),
        whole("Q_GUIDED_MODE", 1, "1: hovers at the targets of GUIDED; 0: circles them"),
        whole(
            "Q_OPTIONS",
            0,
            "fail-safes on the rotors: bit 5 QRTL, bit 20 RTL, none of them QLAND; bit 18: armed in Q modes, AUTO and "
            "GUIDED alone; others are ignored",
        ),
        whole("Q_MAV_TYPE", MAV_TYPE_VTOL_QUADROTOR, "MAV_TYPE in the heartbeat; 0: fixed wing"),
        *RETURN_PARAMETERS,
    ),
    (
        *MISSION,
        *WING_MEMORY,
        *PILOT_MEMORY,
        *HOVER_MEMORY,
        *LIFT_MEMORY,
        *TRANSITION_MEMORY,
        *PROGRESS_MEMORY,
        *LEG_MEMORY,
        *RETURN_MEMORY,
        *SEQUENCE_MEMORY,
        *FAILSAFE_MEMORY,
        *ARMING_MEMORY,
        *FUNCTION_MEMORY,
        *WIND_MEMORY,
        Memory("rises_at", rare=True),  # s, when the rotors of a take-off climb
        Memory("circle_told", dtype="?", rare=True),  # that the circle of GUIDED is reached
        Memory("vtol_mode", dtype="?"),  # of waypoints, by DO_VTOL_TRANSITION
        Memory("still_since"),  # s: since when a descent does not move it; -1: it does
        Memory("descending", dtype="?"),
    ),
)
_hear_parameter, _continue_list = parameter_protocol(VARIABLES)
_hear_mission = mission_protocol(_FLOWN)


# ---- modes and commands --------------------------------------------------------------------------------------------


@kernel
def _change_mode(m: Any, mode: int, t: float) -> int:
    if mode not in _KNOWN:
        if mode == _QAUTOTUNE:
            say(m, MAV_SEVERITY_WARNING, NO_TUNING, 0)
        if mode == _AUTOLAND:
            say(m, MAV_SEVERITY_WARNING, NOT_FLYING if m.on_ground else NO_AUTOLAND, 0)
        if mode in _MODES and m.mode == _GUIDED and m.Q_GUIDED_MODE == 0:
            m.guided_kind = POSITION  # after a vertical take-off in GUIDED, it circles now
            forget_target(m)
        return MAV_RESULT_FAILED
    if mode == m.mode:
        return MAV_RESULT_ACCEPTED
    if mode not in _FREE and not ready(m, t):
        return MAV_RESULT_FAILED
    if mode == _LOITER_ALT_QLAND and (m.mode in _BY_ROTORS or m.mode in (_QLAND, _QRTL)):
        mode = _QLAND
    n, e = m.guided_position[0], m.guided_position[1]
    there = is_on_circle(m, n, e) or distance_to(m, n, e) < m.WP_LOITER_RAD  # it may hover
    if mode == _AVOID_ADSB and m.mode == _GUIDED and there and not m.on_ground:
        tell_reached(m, 0)
    if mode == _AUTO:
        if m.mission_current == 0 or m.mission_done:
            m.mission_current = 1
        m.mission_done = False
        if m.mission_count <= 1:
            say(m, MAV_SEVERITY_INFO, MISSION_COMPLETE, 0)
            mode = _RTL
    m.mode = mode
    m.mode_by_radio, m.landing_sought = False, False
    m.autonomous = mode not in _PILOTED
    m.mission_active = mode == _AUTO
    if mode == _AUTO:
        begin_items(m)
    m.taking_off = False
    m.item_since = -1.0
    m.vtol_mode, m.descending, m.circle_told, m.braking = False, False, False, False
    m.arrival_speed, m.turns_to_place = 0.0, False
    hold_here(m)
    note_target(m)
    begin_pilot(m)
    begin_lifted(m)
    if mode == _AUTOTUNE:
        start_tuning(m)
    elif m.tuning_told:
        end_tuning(m)
    if mode == _TAKEOFF:
        launch(m, m.home[2] - m.TKOFF_ALT)
        begin_launch(m, False)
    elif mode == _RTL:
        go_to(m, m.home[0], m.home[1], m.home[2] - m.RTL_ALTITUDE)
    elif mode == _LOITER_ALT_QLAND:
        go_to(m, m.position[0], m.position[1], m.home[2] - m.Q_RTL_ALT)
    elif mode == _QRTL:
        begin_return(m)
    return MAV_RESULT_ACCEPTED


_enter = told(_change_mode, _MODES)
_permits_arming, _ask_checks, _watch_checks = checking(lifted_checks, lifted_missions)


@kernel
def _arm(m: Any, forced: bool, t: float) -> int:
    if not _permits_arming(m, forced, t):
        return MAV_RESULT_FAILED
    m.armed = True
    m.armed_at = t
    m.armed_in_air_mode = False
    m.vtol = m.mode != _TAKEOFF
    home_here(m)
    if m.mode == _TAKEOFF:
        launch(m, m.home[2] - m.TKOFF_ALT)
        begin_launch(m, False)
    return MAV_RESULT_ACCEPTED


_use_switch, _watch_switches = switches(VARIABLES, "FLTMODE", MODE_FUNCTIONS, True, _enter, _arm, own_functions(_arm))


@kernel
def _rise(m: Any, down: float, t: float) -> None:
    """Begins a vertical take-off, up to a down coordinate."""
    m.rises_at = t + _SPOOL if m.on_ground else t
    go_to(m, m.position[0], m.position[1], down)
    note_target(m)
    m.guided_kind = HOLD
    m.taking_off = True
    m.vtol = True


@kernel
def _command(m: Any, command: int, p1: float, p2: float, p7: float, t: float) -> int:
    if command == MAV_CMD_MISSION_START:
        return _enter(m, _AUTO, t) if p1 == 0.0 and p2 == 0.0 else MAV_RESULT_DENIED
    if command == MAV_CMD_NAV_LOITER_UNLIM:
        return _enter(m, _LOITER, t)
    if command == MAV_CMD_DO_AUX_FUNCTION:
        return int(_use_switch(m, p1, p2, t))
    if command == MAV_CMD_RUN_PREARM_CHECKS:
        return int(_ask_checks(m, t))
    if command == MAV_CMD_BATTERY_RESET:
        return MAV_RESULT_ACCEPTED if reset_battery(m, p1, p2, t) else MAV_RESULT_FAILED
    if command == MAV_CMD_NAV_TAKEOFF:
        flies = not m.on_ground or m.taking_off
        if m.mode != _GUIDED or not m.armed or flies:
            refusal = TAKEOFF_GUIDED if m.mode != _GUIDED else FLYING if m.armed else NOT_ARMED
            say(m, MAV_SEVERITY_INFO, refusal, 0)
            return MAV_RESULT_FAILED
        if not p7 > 0.0:
            return MAV_RESULT_FAILED
        _rise(m, m.position[2] - p7, t)
        say_figures(m, MAV_SEVERITY_INFO, NEAR, (0.0, 0.0, 0.0, 0.0))
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_DO_VTOL_TRANSITION:
        if m.mode != _AUTO:
            say(m, MAV_SEVERITY_NOTICE, TRANSITION_AUTO, 0)
            return MAV_RESULT_FAILED
        if p1 not in (float(_STATE_MC), float(_STATE_FW)):
            return MAV_RESULT_FAILED
        m.vtol_mode = p1 == float(_STATE_MC)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_DO_SET_MISSION_CURRENT:
        return MAV_RESULT_ACCEPTED if set_current(m, p1) else MAV_RESULT_FAILED
    if command == MAV_CMD_DO_LAND_START:
        lands = jump_to_landing(m) and _enter(m, _AUTO, t) == MAV_RESULT_ACCEPTED
        return MAV_RESULT_ACCEPTED if lands else MAV_RESULT_FAILED
    if command == MAV_CMD_DO_AUTOTUNE_ENABLE:
        return enable_tuning(m, p1)
    if command == MAV_CMD_DO_CHANGE_SPEED:
        return change_speed(m, p1, p2)
    return MAV_RESULT_UNSUPPORTED


@kernel
def _other(m: Any, message: int, sender: int, part: int, t: float) -> None:
    if message == HEARTBEAT or hear_sticks(m, message, sender, t):
        note_station(m, sender, t)
    elif message == RADIO_STATUS:
        note_report(m, t)
    elif not _hear_parameter(m, message):
        _hear_mission(m, message, sender, part, t)


_receive = receiver(firmware(_GUIDED, _RTL, _enter, _arm, _command, height_target, _other))


# ---- flight --------------------------------------------------------------------------------------------------------


@kernel
def _rest(m: Any) -> None:
    rest(m)
    no_lift(m)


@kernel
def _land(m: Any, n: float, e: float, t: float, h: float) -> None:
    """Descends at a place, and disarms on the ground."""
    m.vtol = True
    if m.mode != _QLAND:
        tell_descent(m)
    sink(m, n, e, h)
    if abs(m.velocity[2]) > _LANDED_SPEED:
        m.still_since = -1.0
    elif m.still_since < 0.0:
        m.still_since = t
    elif t - m.still_since >= _LANDED_TIME and m.descending:
        m.armed = False
        say(m, MAV_SEVERITY_INFO, LANDED, 0)
    if not m.descending:
        m.descending, m.still_since = True, -1.0


@kernel
def _vertical(m: Any, t: float, h: float) -> None:
    """Climbs to the height of the target when the rotors run, and ends the take-off there."""
    if t < m.rises_at:
        _rest(m)
        return
    hover(m, m.guided_position[0], m.guided_position[1], m.guided_position[2], h)
    if m.position[2] <= m.guided_position[2] + _CLIMBED:
        m.taking_off = False


@kernel
def _carry_out(m: Any, t: float, h: float) -> None:
    """Carries the mission out; at its end, it returns."""
    tell_item(m)
    row = m.mission_current
    if m.uploading:
        if m.on_ground:
            _rest(m)
        else:
            go_round(m, m.guided_position[0], m.guided_position[1], m.guided_position[2], t, h)
        return
    if m.mission_done or row >= m.mission_count:
        say(m, MAV_SEVERITY_INFO, MISSION_COMPLETE, 0)
        _change_mode(m, _RTL, t)
        m.mission_done = True
        go_round(m, m.guided_position[0], m.guided_position[1], m.guided_position[2], t, h)
        return
    command = int(m.mission[row, COMMAND])
    if command in (MAV_CMD_NAV_TAKEOFF, MAV_CMD_NAV_VTOL_TAKEOFF):
        _, _, d = item_place(m, row)
        if m.on_ground and not m.taking_off:
            _rise(m, d, t)
        if m.taking_off:
            _vertical(m, t, h)
        if not m.taking_off:
            complete_item(m)
        return
    if command == MAV_CMD_DO_LAND_START:
        complete_item(m)
        return
    n, e, d = m.home[0], m.home[1], m.home[2] - m.RTL_ALTITUDE
    if command != MAV_CMD_NAV_RETURN_TO_LAUNCH:
        n, e, d = item_place(m, row)
    if command in (MAV_CMD_NAV_VTOL_LAND, MAV_CMD_NAV_LAND):
        _land_at(m, n, e, t, h)
        return
    go_to(m, n, e, d)
    if command != MAV_CMD_NAV_WAYPOINT:
        go_round(m, n, e, d, t, h)
        return
    if m.item_since < 0.0:
        begin_leg(m, row, n, e, t)
    if m.vtol_mode:
        m.vtol = True
        hover(m, n, e, d, h)
        reached = distance_to(m, n, e) < THERE and speed_of(m) < SLOW
    else:
        course = math.atan2(e - m.position[1], n - m.position[0])
        on_wing(m, bank_for(m, course), d, cruise_speed(m), t, h)
        reached = ends_leg(m, row, n, e)
    if reached:
        complete_item(m)


@kernel
def _land_at(m: Any, n: float, e: float, t: float, h: float) -> None:
    """Flies to a place at the height at which it is now, and lands there."""
    if m.item_since < 0.0:
        m.item_since = t
        go_to(m, n, e, min(m.position[2], m.home[2] - m.Q_RTL_ALT))
        forget_target(m)
    if m.descending or travel(m, n, e, m.guided_position[2], t, h):
        _land(m, n, e, t, h)


@kernel
def _guide(m: Any, t: float, h: float) -> None:
    """Flies in GUIDED."""
    n, e, d = m.guided_position[0], m.guided_position[1], m.guided_position[2]
    if m.taking_off:
        _vertical(m, t, h)
    elif m.Q_GUIDED_MODE != 0:
        travel(m, n, e, d, t, h)
    elif m.vtol and m.guided_kind == HOLD:
        hover(m, n, e, d, h)  # after a vertical take-off
    else:
        if n != m.seen[0] or e != m.seen[1]:
            note_target(m)
            m.circle_told = False
        go_round(m, n, e, d, t, h)
        if not m.circle_told and is_on_circle(m, n, e):
            m.circle_told = True
            tell_reached(m, 0)


@kernel
def _launch(m: Any, t: float, h: float) -> None:
    """Takes off on the wing; in the air, with the help of the rotors."""
    if m.launched_high:
        m.asked_bank = 0.0
        on_wing(m, 0.0, m.guided_position[2], cruise_speed(m), t, h)
        m.taking_off = m.position[2] > m.guided_position[2] + _CLIMBED
    else:
        m.vtol, m.fast_since = False, 0.0
        take_off(m, h)
    m.motor[2] = min(m.motor[2], tell_launch(m, t))


@kernel
def _pilot(m: Any, t: float, h: float) -> None:
    """Flies as a pilot says on the wing, or gets there with the autopilot's throttle."""
    leave_circle(m)
    bank, down, wanted = 0.0, m.guided_position[2], cruise_speed(m)
    if m.mode == _CIRCLE:
        bank = circling_bank(m)
    elif m.mode == _FBWB or m.mode == _CRUISE:
        bank, down, wanted = demand(m, t, h)
    elif m.mode in _UNASSISTED or m.on_ground or on_wing_alone(m, t):
        if m.on_ground:
            m.vtol, m.fast_since = False, 0.0
        no_lift(m)
        by_hand(m, t, h)
        return
    elif m.mode in (_FBWA, _AUTOTUNE):
        bank = roll_stick(m, t)
    on_wing(m, bank, down, wanted, t, h)


@kernel
def _act(m: Any, t: float, h: float) -> None:
    """Flies in the mode that it has."""
    n, e, d = m.guided_position[0], m.guided_position[1], m.guided_position[2]
    if m.mode == _GUIDED:
        _guide(m, t, h)
    elif m.mode == _AUTO:
        _carry_out(m, t, h)
    elif m.mode == _TAKEOFF and m.taking_off:
        _launch(m, t, h)
    elif m.mode in _BY_ROTORS:
        by_rotors(m, t, h)
    elif m.mode == _QLAND:
        _land(m, n, e, t, h)
    elif m.mode == _QRTL:
        if m.return_climbs:
            climb_before_return(m, h)
        elif m.descending or travel(m, n, e, d if m.vtol else d - approach_height(m, distance_to(m, n, e)), t, h):
            _land(m, n, e, t, h)
    elif m.mode < _AUTO:
        _pilot(m, t, h)
    else:
        go_round(m, n, e, d, t, h)
        low = m.position[2] >= d - _CLIMBED and is_on_circle(m, n, e)
        if m.mode == _LOITER_ALT_QLAND and low:
            _change_mode(m, _QLAND, t)


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Starts disarmed on the ground, in MANUAL."""
    if m.airframe != Airframe.quadplane:
        return _NO_AIRFRAME
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.AIRSPEED_MIN, m.WP_LOITER_RAD, m.Q_P_POSXY_P, m.Q_P_POSZ_P, m.Q_TRANS_DECEL, m.Q_M_THST_EXPO) <= 0.0:
        return _BAD_GAIN
    m.kind = m.Q_MAV_TYPE if m.Q_MAV_TYPE != 0 else MAV_TYPE_FIXED_WING
    m.on_ground = True
    m.mission_count = max(m.mission_count, 1)  # a reboot keeps it
    m.item_since = -1.0
    m.fast_since = -1.0
    m.still_since = -1.0
    m.vtol, m.vtol_state = True, _STATE_MC
    home_here(m)
    _rest(m)
    m.lifts = True
    drain_battery(m, 0.0)
    start_gps(m)
    m.station_known = True  # as at the boot of ArduPlane
    start_switches(m)
    start_streams(m)
    hold_here(m)
    return 0


@kernel
def _lands(m: Any) -> bool:
    """Returns whether it is on its way to a vertical landing."""
    return bool(m.mode == _QRTL or (m.mode == _AUTO and in_landing_sequence(m)))


@kernel
def _lifted_mode(m: Any) -> int:
    """Returns the mode to which a fail-safe changes in this mode on the rotors, -1: it is on the wing."""
    if m.mode == _AUTO:
        return _QLAND if m.taking_off else -1
    if m.mode not in _BY_ROTORS:
        return -1
    return _RTL if m.Q_OPTIONS & _OPTION_RTL != 0 else _QRTL if m.Q_OPTIONS & _OPTION_QRTL != 0 else _QLAND


@kernel
def _watch_more(m: Any, t: float) -> None:
    """Begins the landing of a return."""
    if m.mode == _RTL and m.RTL_AUTOLAND != 0:
        there = is_on_circle(m, m.home[0], m.home[1])
        if seeks_landing(m, there and not m.on_ground):
            _enter(m, _AUTO, t)


_reboot = rebooting(VARIABLES, start)
_watch_failsafes = failsafes(_enter, _lands, _lifted_mode, _watch_more)


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """Makes one step: inputs at t, commands for t + h."""
    m.mavlink_tx_len = 0
    t -= m.booted_at
    if m.rebooting:
        error, t, silent = _reboot(m, t)
        if silent:
            return error
    if m.mavlink_rx_len > 0:
        _receive(m, t)
    if t >= m.failsafe_due:
        _watch_failsafes(m, t)
    if t >= m.switch_due:
        _watch_switches(m, t)
    if not m.armed:
        home_here(m)
        if t >= m.home_due:
            repeat_home(m, t)
        if t >= m.checks_due:
            _watch_checks(m, t)
        m.rotated, m.held_heading = False, heading(m)
        m.aileron_trim, m.elevator_trim = 0.0, 0.0
    m.on_ground = not m.armed or (m.ground_down - m.position[2] < _FLYING_HEIGHT and speed_of(m) < _FLYING_SPEED)
    for i in range(3):
        m.desired_velocity[i] = m.velocity[i]
    if m.armed and m.on_ground and m.mode == _QRTL and not m.descending:
        m.armed = False
    launches = m.taking_off or m.descending or m.mode in (_AUTO, _QLAND)
    if not m.armed or (m.on_ground and not launches and not lifts_off(m, t)):
        _rest(m)
    else:
        if t >= m.wind_next and not m.vtol:
            estimate_wind(m, t)
        if m.sticks_known:
            mix_sticks(m, t)
        if m.inverted_asked:
            m.inverted = on_wing_alone(m, t) and not (m.braking or m.taking_off or m.on_ground)
        _act(m, t, h)
    if m.emergency_stop:
        m.motor[2] = 0.0
        no_lift(m)
    if not m.armed:
        _rest(m)
        m.descending, m.taking_off = False, False
    if m.test_motor > 0:
        continue_motor_test(m, t)
    m.vtol_state = vtol_state(m, t)
    for i in range(3):
        m.target[i] = m.guided_position[i]
        m.desired_position[i] = m.guided_position[i]
    if m.uploading:
        continue_upload(m, t)
    if m.listed >= 0:
        _continue_list(m)
    stream(m, t)
    return 0


class QuadplaneAutopilot(Model):
    """Autopilot of fixed wings with lifting rotors, with ArduPlane's modes and MAVLink behaviour."""

    step_size = 0.005
    variables = VARIABLES
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_AIRFRAME: "it flies vehicles of the airframe quadplane; others need another autopilot",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _BAD_GAIN: "AIRSPEED_MIN, WP_LOITER_RAD, Q_P_POS*_P, Q_TRANS_DECEL and Q_M_THST_EXPO must be positive",
    }

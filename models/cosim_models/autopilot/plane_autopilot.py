"""The plane autopilot FMU: ArduPlane's modes and MAVLink behaviour for fixed wings.

A fixed wing cannot stop: to hold a place is to circle it, with WP_LOITER_RAD. GUIDED circles its target, LOITER and
AVOID_ADSB the place where the mode was entered, LOITER_ALT_QLAND the same 15 m above home (it cannot QLAND), RTL home;
AUTO flies missions, also landings (`wing.autoland`, `wing.sequence`); TAKEOFF climbs straight ahead to TKOFF_ALT and
then circles; AUTOLAND lands at home. A pilot flies MANUAL, STABILIZE, TRAINING, ACRO, FBWA, FBWB, CRUISE and AUTOTUNE
(`wing.piloted`), by RC_CHANNELS_OVERRIDE and MANUAL_CONTROL; without them, the sticks are centred and the throttle is
closed. Positions come by DO_REPOSITION and MISSION_ITEM with current 2. As in ArduPlane, the message
SET_POSITION_TARGET_GLOBAL_INT changes the height alone, the take-off command is FAILED (it is for VTOL), and the
command to land is UNSUPPORTED.

Differences from ArduPlane: these loops instead of TECS and L1, no airspeed sensor (airspeed is taken as the speed over
ground; the wind is estimated for the message WIND alone), no fences. Speeds and the radius of circles are made for the
Aerosonde.

The control of bank, height, speed and course is in `wing.flight`, fail-safes are in `wing.failsafes`. Sources of the
modes and answers: ArduPilot, ArduPlane/mode*.cpp and ArduPlane/GCS_MAVLink_Plane.cpp.
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
    MAV_CMD_NAV_WAYPOINT,
    MAV_CMD_RUN_PREARM_CHECKS,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_TYPE_FIXED_WING,
    RADIO_STATUS,
)
from cosim.vehicle import Airframe
from cosim_models.autopilot.gcs.battery import reset_battery
from cosim_models.autopilot.gcs.commands import firmware, receiver, repeat_home, told
from cosim_models.autopilot.gcs.contact import note_report, note_station
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
from cosim_models.autopilot.gcs.record import MISSION, pilot_variables
from cosim_models.autopilot.gcs.sticks import STICK_PARAMETERS, hear_sticks
from cosim_models.autopilot.gcs.streams import ready, start_streams, stream
from cosim_models.autopilot.gcs.switches import start_switches, switch_parameters, switches
from cosim_models.autopilot.gcs.targets import go_to, height_target, hold_here, home_here
from cosim_models.autopilot.gcs.words import (
    ABOVE_TAKEOFF,
    CLIMBING,
    MISSION_COMPLETE,
    NO_Q_MODES,
    NO_VTOL,
    TAKEOFF_COMPLETE,
    say,
    say_figures,
)
from cosim_models.autopilot.wing.arming import ARMING_MEMORY, checking, landing_checks, landing_missions
from cosim_models.autopilot.wing.attitude import rest
from cosim_models.autopilot.wing.autoland import (
    AUTOLAND_MEMORY,
    AUTOLAND_PARAMETERS,
    begin_autoland,
    land_in_mission,
    land_on_wheels,
    note_arming,
    watch_autoland,
)
from cosim_models.autopilot.wing.autotune import enable_tuning, end_tuning, start_tuning
from cosim_models.autopilot.wing.circling import is_on_circle, leave_circle
from cosim_models.autopilot.wing.failsafes import FAILSAFE_MEMORY, FAILSAFE_PARAMETERS, drain_battery, failsafes
from cosim_models.autopilot.wing.flight import (
    WING_MEMORY,
    bank_for,
    change_speed,
    circle,
    cruise_speed,
    fly,
    launch,
    take_off,
    wing_parameters,
)
from cosim_models.autopilot.wing.functions import FUNCTION_MEMORY, MODE_FUNCTIONS, SWITCHED_MODES, own_functions
from cosim_models.autopilot.wing.legs import LEG_MEMORY, begin_leg, ends_leg
from cosim_models.autopilot.wing.piloted import (
    PILOT_MEMORY,
    PILOT_PARAMETERS,
    begin_pilot,
    by_hand,
    circling_bank,
    demand,
    mix_sticks,
)
from cosim_models.autopilot.wing.progress import LAUNCH_MEMORY, LEVEL_OFF, begin_launch, tell_launch
from cosim_models.autopilot.wing.sequence import (
    SEQUENCE_MEMORY,
    SEQUENCE_PARAMETERS,
    in_landing_sequence,
    jump_to_landing,
    restart_landing,
    seeks_landing,
)
from cosim_models.autopilot.wing.wind import WIND_MEMORY, estimate_wind

__all__ = ["PlaneAutopilot"]


class PlaneMode(IntEnum):
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
    LOITER_ALT_QLAND = 25
    AUTOLAND = 26


_MANUAL, _CIRCLE, _STABILIZE, _TRAINING, _ACRO, _FBWA, _FBWB, _CRUISE = map(int, list(PlaneMode)[:8])
_AUTO, _RTL, _LOITER, _TAKEOFF, _AVOID_ADSB, _GUIDED, _LOITER_ALT_QLAND, _AUTOLAND = map(int, list(PlaneMode)[9:])
_AUTOTUNE = int(PlaneMode.AUTOTUNE)
_BY_HAND = (_MANUAL, _STABILIZE, _TRAINING, _ACRO, _FBWA, _AUTOTUNE)
_KNOWN = tuple(map(int, PlaneMode))
_LOITER_ALT = 15.0  # m above home, Q_RTL_ALT without rotors
_FLYING_HEIGHT, _FLYING_SPEED = 1.0, 5.0  # m above home and m/s: beyond them it is in the air
_MODES = (*range(9), *range(10, 27))  # of ArduPlane
_FLOWN = (
    MAV_CMD_NAV_WAYPOINT,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_DO_LAND_START,
)
_NO_AIRFRAME, _BAD_SYSID, _BAD_GAIN = 1, 2, 3

VARIABLES = pilot_variables(
    (Airframe.plane,),
    PlaneMode.MANUAL,
    (
        *wing_parameters(),
        *PILOT_PARAMETERS,
        *STICK_PARAMETERS,
        *AUTOLAND_PARAMETERS,
        *SEQUENCE_PARAMETERS,
        *FAILSAFE_PARAMETERS,
        *switch_parameters("FLTMODE", SWITCHED_MODES),
    ),
    (
        *MISSION,
        *WING_MEMORY,
        *PILOT_MEMORY,
        *AUTOLAND_MEMORY,
        *LAUNCH_MEMORY,
        *LEG_MEMORY,
        *SEQUENCE_MEMORY,
        *FAILSAFE_MEMORY,
        *ARMING_MEMORY,
        *FUNCTION_MEMORY,
        *WIND_MEMORY,
        Memory("told_low", dtype="?", rare=True),
    ),
)
_hear_parameter, _continue_list = parameter_protocol(VARIABLES)
_hear_mission = mission_protocol(_FLOWN)


# ---- modes and commands --------------------------------------------------------------------------------------------


@kernel
def _is_there(m: Any) -> bool:
    """Returns whether it is on the circle around its target."""
    return not m.on_ground and is_on_circle(m, m.guided_position[0], m.guided_position[1])


@kernel
def _change_mode(m: Any, mode: int, t: float) -> int:
    if mode not in _KNOWN:
        return MAV_RESULT_FAILED
    if mode == m.mode:
        return MAV_RESULT_ACCEPTED
    if mode not in _BY_HAND and not ready(m, t):
        return MAV_RESULT_FAILED
    if mode == _AUTOLAND and not begin_autoland(m):
        return MAV_RESULT_FAILED
    if mode == _AUTO:
        if m.mission_current == 0 or m.mission_done:
            m.mission_current = 1
        m.mission_done = False
        if m.mission_count <= 1:
            say(m, MAV_SEVERITY_INFO, MISSION_COMPLETE, 0)
            mode = _RTL
    if mode == _AVOID_ADSB and m.mode == _GUIDED and _is_there(m):
        tell_reached(m, 0)
    if m.mode == _AUTO:
        restart_landing(m)
    m.mode = mode
    m.mode_by_radio, m.landing_sought = False, False
    m.item_since = -1.0
    m.autonomous = mode not in _BY_HAND and mode != _FBWB and mode != _CRUISE
    m.mission_active = mode == _AUTO
    if mode == _AUTO:
        begin_items(m)
    m.taking_off = False
    if mode != _AUTOLAND:
        hold_here(m)
    begin_pilot(m)
    if mode == _AUTOTUNE:
        start_tuning(m)
    elif m.tuning_told:
        end_tuning(m)
    if mode == _TAKEOFF:
        above = m.home[2] - m.position[2] >= m.TKOFF_ALT
        if not m.on_ground:
            say(m, MAV_SEVERITY_INFO, ABOVE_TAKEOFF if above else CLIMBING, 0)
        if not above:
            launch(m, m.home[2] - m.TKOFF_ALT)
            begin_launch(m, not m.on_ground)
    elif mode == _RTL:
        go_to(m, m.home[0], m.home[1], m.home[2] - m.RTL_ALTITUDE)
    elif mode == _LOITER_ALT_QLAND:
        go_to(m, m.position[0], m.position[1], m.home[2] - _LOITER_ALT)
        m.told_low = False
    return MAV_RESULT_ACCEPTED


_enter = told(_change_mode, _MODES)
_permits_arming, _ask_checks, _watch_checks = checking(landing_checks, landing_missions)


@kernel
def _arm(m: Any, forced: bool, t: float) -> int:
    if not _permits_arming(m, forced, t):
        return MAV_RESULT_FAILED
    m.armed = True
    m.armed_at = t
    home_here(m)
    m.item_since = -1.0
    note_arming(m)
    if m.mode == _TAKEOFF:
        launch(m, m.home[2] - m.TKOFF_ALT)
        begin_launch(m, False)
    return MAV_RESULT_ACCEPTED


_use_switch, _watch_switches = switches(VARIABLES, "FLTMODE", MODE_FUNCTIONS, True, _enter, _arm, own_functions(_arm))


@kernel
def _command(m: Any, command: int, p1: float, p2: float, p7: float, t: float) -> int:  # noqa: ARG001
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
    if command == MAV_CMD_DO_VTOL_TRANSITION:
        say(m, MAV_SEVERITY_NOTICE, NO_VTOL, 0)
        return MAV_RESULT_FAILED
    if command == MAV_CMD_NAV_TAKEOFF:
        return MAV_RESULT_FAILED
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
def _stay(m: Any, h: float) -> None:
    """Circles its target; on the ground, it stands."""
    if m.on_ground:
        rest(m)
    else:
        fly(m, circle(m, m.guided_position[0], m.guided_position[1]), m.guided_position[2], cruise_speed(m), h)


@kernel
def _launch(m: Any, t: float, h: float) -> None:
    """Takes off along the runway."""
    take_off(m, h)
    m.motor[2] = min(m.motor[2], tell_launch(m, t))


@kernel
def _take_off_in_mission(m: Any, row: int, t: float, h: float) -> None:
    """Carries NAV_TAKEOFF out, which ends at its height, or when it has levelled off for long enough."""
    _, _, d = item_place(m, row)
    if m.item_since < 0.0:
        m.item_since = t
        launch(m, d)
        begin_launch(m, not m.on_ground)
    if m.taking_off:
        _launch(m, t, h)
    else:
        fly(m, bank_for(m, m.runway), d, cruise_speed(m), h)
    if m.position[2] <= d or (m.levels_since >= 0.0 and t - m.levels_since > LEVEL_OFF):
        m.taking_off = False
        say_figures(m, MAV_SEVERITY_INFO, TAKEOFF_COMPLETE, (m.home[2] - m.position[2], 0.0, 0.0, 0.0))
        complete_item(m)


@kernel
def _carry_out(m: Any, t: float, h: float) -> None:
    """Carries the mission out; at its end, it returns."""
    tell_item(m)
    row = m.mission_current
    if m.uploading:
        _stay(m, h)
        return
    if m.mission_done or row >= m.mission_count:
        say(m, MAV_SEVERITY_INFO, MISSION_COMPLETE, 0)
        _change_mode(m, _RTL, t)
        m.mission_done = True
        fly(m, circle(m, m.guided_position[0], m.guided_position[1]), m.guided_position[2], cruise_speed(m), h)
        return
    command = int(m.mission[row, COMMAND])
    if command == MAV_CMD_NAV_TAKEOFF:
        _take_off_in_mission(m, row, t, h)
        return
    if command == MAV_CMD_NAV_LAND:
        land_in_mission(m, row, t, h)
        return
    if command == MAV_CMD_DO_LAND_START:
        complete_item(m)
        return
    n, e, d = m.home[0], m.home[1], m.home[2] - m.RTL_ALTITUDE
    if command != MAV_CMD_NAV_RETURN_TO_LAUNCH:
        n, e, d = item_place(m, row)
    go_to(m, n, e, d)
    if command != MAV_CMD_NAV_WAYPOINT:
        fly(m, circle(m, n, e), d, cruise_speed(m), h)
        return
    if m.item_since < 0.0:
        begin_leg(m, row, n, e, t)
    dn, de = n - m.position[0], e - m.position[1]
    fly(m, bank_for(m, math.atan2(de, dn)), d, cruise_speed(m), h)
    if ends_leg(m, row, n, e):
        complete_item(m)


@kernel
def _pilot(m: Any, t: float, h: float) -> None:
    """Flies as the pilot says, and CIRCLE."""
    leave_circle(m)
    if m.mode in _BY_HAND:
        by_hand(m, t, h)
    elif m.on_ground:
        rest(m)
    elif m.mode == _CIRCLE:
        fly(m, circling_bank(m), m.guided_position[2], cruise_speed(m), h)
    else:
        bank, down, wanted = demand(m, t, h)
        fly(m, bank, down, wanted, h)


@kernel
def _act(m: Any, t: float, h: float) -> None:
    """Flies in the mode that it has."""
    if m.mode < _AUTO:
        _pilot(m, t, h)
    elif m.mode == _AUTO:
        _carry_out(m, t, h)
    elif m.taking_off:
        _launch(m, t, h)
    else:
        _stay(m, h)


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Starts disarmed on the ground, in MANUAL."""
    if m.airframe != Airframe.plane:
        return _NO_AIRFRAME
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.AIRSPEED_CRUISE, m.WP_LOITER_RAD) <= 0.0:
        return _BAD_GAIN
    m.kind = MAV_TYPE_FIXED_WING
    m.on_ground = True
    m.mission_count = max(m.mission_count, 1)  # a reboot keeps it
    m.item_since = -1.0
    home_here(m)
    rest(m)
    drain_battery(m, 0.0)
    start_gps(m)
    m.station_known = True  # as at the boot of ArduPlane
    start_switches(m)
    start_streams(m)
    hold_here(m)
    return 0


@kernel
def _lands(m: Any) -> bool:
    """Returns whether it carries out the landing sequence of its mission."""
    return bool(m.mode == _AUTO and in_landing_sequence(m))


@kernel
def _lifted_mode(m: Any) -> int:  # noqa: ARG001
    return -1


@kernel
def _watch_more(m: Any, t: float) -> None:
    """Watches landings, begins that of a return, and tells once that LOITER_ALT_QLAND is low."""
    watch_autoland(m, t)
    if m.mode == _RTL and m.RTL_AUTOLAND != 0 and seeks_landing(m, _is_there(m)):
        _enter(m, _AUTO, t)
    low = m.mode == _LOITER_ALT_QLAND and m.armed and not m.on_ground and not m.told_low
    if low and m.position[2] >= m.guided_position[2] - 1.0:
        m.told_low = True
        say(m, MAV_SEVERITY_INFO, NO_Q_MODES, 0)


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
        m.rotated, m.aileron_trim, m.elevator_trim = False, 0.0, 0.0
        rest(m)
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    m.on_ground = m.ground_down - m.position[2] < _FLYING_HEIGHT and speed < _FLYING_SPEED
    if m.armed:
        if not m.on_ground and t >= m.wind_next:
            estimate_wind(m, t)
        if m.sticks_known:
            mix_sticks(m, t)
        if m.mode == _AUTOLAND and not m.on_ground:
            land_on_wheels(m, h)
        else:
            _act(m, t, h)
        if m.emergency_stop:
            m.motor[2] = 0.0
    for i in range(3):
        m.target[i] = m.guided_position[i]
        m.desired_position[i] = m.guided_position[i]
        m.desired_velocity[i] = m.velocity[i]
    if m.uploading:
        continue_upload(m, t)
    if m.listed >= 0:
        _continue_list(m)
    stream(m, t)
    return 0


class PlaneAutopilot(Model):
    """Autopilot of fixed wings with ArduPlane's modes and MAVLink behaviour."""

    step_size = 0.0125
    variables = VARIABLES
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_AIRFRAME: "it flies vehicles of the airframe plane; others need another autopilot",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _BAD_GAIN: "AIRSPEED_CRUISE and WP_LOITER_RAD must be positive",
    }

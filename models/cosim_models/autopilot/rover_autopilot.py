"""The rover autopilot FMU: ArduRover's modes, steering, speed control and MAVLink behaviour, for rovers and boats.

In GUIDED it follows positions and velocities, in AUTO missions, in RTL it drives home, in SMART_RTL the way that it
came. HOLD commands nothing; LOITER stays within LOIT_RADIUS, as do boats wherever a rover stops; CIRCLE drives around
the place where it was entered. A pilot drives in MANUAL, ACRO, STEERING and SIMPLE, by RC_CHANNELS_OVERRIDE and
MANUAL_CONTROL; without them, its sticks are centred. It cannot climb: heights are ignored, take-off and landing are
refused as ArduRover refuses them (UNSUPPORTED).

Speed and steering are in `surface.driving`, the modes of a pilot in `surface.piloted`, fail-safes in
`surface.failsafes`, the ways to places in `surface.legs`.

Differences from ArduRover: no pivot turns, no fences, no estimator. CRUISE_SPEED and CRUISE_THROTTLE are those of the
simulated vehicles, whose speed at a quarter of the throttle is 5 m/s, and WP_SPEED 0 means CRUISE_SPEED. As in
ArduRover, a target nearer than WP_RADIUS (2 m) that hardly moves counts as reached, so small steps of a law are lost.

Sources: ArduPilot, Rover/mode*.cpp, Rover/GCS_MAVLink_Rover.cpp.
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
    MAV_CMD_DO_AUX_FUNCTION,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_SET_MISSION_CURRENT,
    MAV_CMD_MISSION_START,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_WAYPOINT,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MAV_SEVERITY_CRITICAL,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_SURFACE_BOAT,
    SET_POSITION_TARGET_LOCAL_NED,
)
from cosim.vehicle import Airframe
from cosim_models.autopilot.gcs.battery import battery_permits_arming, reset_battery
from cosim_models.autopilot.gcs.commands import firmware, receiver, told
from cosim_models.autopilot.gcs.contact import note_station
from cosim_models.autopilot.gcs.items import begin_items, complete_item, tell_item
from cosim_models.autopilot.gcs.missions import (
    COMMAND,
    P1,
    P2,
    append_waypoint,
    continue_upload,
    item_place,
    mission_protocol,
    set_current,
    tell_reached,
)
from cosim_models.autopilot.gcs.parameters import parameter_protocol
from cosim_models.autopilot.gcs.positioning import start_gps
from cosim_models.autopilot.gcs.rebooting import rebooting
from cosim_models.autopilot.gcs.record import (
    ACCELERATION,
    HOLD,
    MISSION,
    POSITION,
    VELOCITY,
    pilot_variables,
)
from cosim_models.autopilot.gcs.sticks import STICK_PARAMETERS, hear_sticks
from cosim_models.autopilot.gcs.streams import ready, start_streams, stream
from cosim_models.autopilot.gcs.switches import HIGH, start_switches, switch_parameters, switches
from cosim_models.autopilot.gcs.targets import global_target, go_to, hold_here, home_here, local_target, say_home
from cosim_models.autopilot.gcs.words import (
    ARM_GPS,
    ARM_MODE,
    ARM_STOPPED,
    DESTINATION,
    MISSION_DONE,
    NO_DOCK,
    NO_MISSION,
    REACHED,
    REACHED_WAITS,
    SAVED_NONE,
    say,
    say_figures,
)
from cosim_models.autopilot.surface.circling import CIRCLE_MEMORY, CIRCLE_PARAMETERS, begin_circle, circle
from cosim_models.autopilot.surface.driving import DRIVE_MEMORY, DRIVE_PARAMETERS, STANDING, cruise, drive, stop
from cosim_models.autopilot.surface.failsafes import (
    FAILSAFE_MEMORY,
    FAILSAFE_PARAMETERS,
    drain_battery,
    failsafes,
)
from cosim_models.autopilot.surface.learning import LEARN_MEMORY, begin_learning, learn
from cosim_models.autopilot.surface.legs import (
    LEG_MEMORY,
    LEG_PARAMETERS,
    approach,
    drive_legs,
    is_new,
    set_leg,
    start_legs,
)
from cosim_models.autopilot.surface.motor_test import continue_test, testing
from cosim_models.autopilot.surface.piloted import (
    PILOT_MEMORY,
    PILOT_PARAMETERS,
    acro,
    coast,
    loiter,
    manual,
    note_heading,
    simple,
    stay,
    steering,
)
from cosim_models.autopilot.surface.track import (
    TRACK_MEMORY,
    TRACK_PARAMETERS,
    begin_track,
    go_back,
    record_track,
    retrace,
)

__all__ = ["RoverAutopilot"]


class RoverMode(IntEnum):
    """Modes, by ArduRover's numbers."""

    MANUAL = 0
    ACRO = 1
    STEERING = 3
    HOLD = 4
    LOITER = 5
    SIMPLE = 7
    CIRCLE = 9
    AUTO = 10
    RTL = 11
    SMART_RTL = 12
    GUIDED = 15


_MANUAL, _ACRO, _STEERING, _HOLD, _LOITER, _SIMPLE, _CIRCLE, _AUTO, _RTL, _SMART_RTL, _GUIDED = map(int, RoverMode)
_KNOWN = tuple(map(int, RoverMode))
_FOLLOW, _DOCK = 6, 8  # not entered
_PILOTED = (_ACRO, _STEERING, _SIMPLE)
_FREE = (_MANUAL, _ACRO, _STEERING, _HOLD)  # need no position
_MODES = (0, 1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15, 16)  # of ArduRover
_TIMEOUT = 3.0  # s after which a velocity is no longer followed
_FLOWN = (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_UNLIM, MAV_CMD_NAV_RETURN_TO_LAUNCH, MAV_CMD_DO_CHANGE_SPEED)
_MODE_FUNCTIONS = (
    (4, _RTL),
    (16, _AUTO),
    (42, _SMART_RTL),
    (51, _MANUAL),
    (52, _ACRO),
    (53, _STEERING),
    (54, _HOLD),
    (55, _GUIDED),
    (56, _LOITER),
    (57, _FOLLOW),
    (59, _SIMPLE),
    (72, _CIRCLE),
)
_SAVE_WAYPOINT, _LEARN, _GPS = 7, 50, 65
_IDLE_FUNCTIONS = (63, 74, 97, 155, 201, 202, 207, 211)  # for sails, walking robots and the trim of the steering
_NO_AIRFRAME, _BAD_SYSID, _BAD_GAIN = 1, 2, 3

VARIABLES = pilot_variables(
    (Airframe.rover, Airframe.boat),
    RoverMode.MANUAL,
    (
        *DRIVE_PARAMETERS,
        *LEG_PARAMETERS,
        *PILOT_PARAMETERS,
        *CIRCLE_PARAMETERS,
        *TRACK_PARAMETERS,
        *STICK_PARAMETERS,
        *FAILSAFE_PARAMETERS,
        *switch_parameters("MODE", (_MANUAL,) * 6),
    ),
    (
        *MISSION,
        *DRIVE_MEMORY,
        *LEG_MEMORY,
        *PILOT_MEMORY,
        *CIRCLE_MEMORY,
        *TRACK_MEMORY,
        *FAILSAFE_MEMORY,
        *LEARN_MEMORY,
        Memory("watch_next"),  # s, when the path or the fail-safes are due
        Memory("drifted", dtype="?", rare=True),  # that a boat is on its way back to its place
        Memory("told_home", dtype="?", rare=True),  # that it has arrived there
    ),
)
_hear_parameter, _continue_list = parameter_protocol(VARIABLES)
_hear_mission = mission_protocol(_FLOWN)


# ---- modes and commands --------------------------------------------------------------------------------------------


@kernel
def _change_mode(m: Any, mode: int, t: float) -> int:
    if mode not in _KNOWN:
        if mode == _DOCK:
            say(m, MAV_SEVERITY_NOTICE, NO_DOCK, 0)
        return MAV_RESULT_FAILED
    if mode == m.mode:
        return MAV_RESULT_ACCEPTED
    if mode not in (_MANUAL, _HOLD) and (not ready(m, t) or (m.armed and (m.position_lost or m.ekf_failed))):
        return MAV_RESULT_FAILED
    if mode == _SMART_RTL and not go_back(m):
        return MAV_RESULT_FAILED
    if mode == _AUTO:
        if m.mission_count <= 1:
            say(m, MAV_SEVERITY_NOTICE, NO_MISSION, 0)
            return MAV_RESULT_FAILED
        if m.mission_current == 0 or m.mission_done:
            m.mission_current = 1
        m.mission_done = False
        m.item_since = -1.0
    m.mode = mode
    m.autonomous = mode not in (_MANUAL, _HOLD) and mode not in _PILOTED
    m.mission_active = mode == _AUTO
    if mode == _AUTO:
        begin_items(m)
    m.told_home = False
    if mode == _SMART_RTL:
        return MAV_RESULT_ACCEPTED
    hold_here(m)
    start_legs(m)
    m.arrived = True
    if mode == _RTL:
        set_leg(m, m.home[0], m.home[1], (m.home[0], m.home[1]), False)
        go_to(m, m.home[0], m.home[1], m.home[2])
        dn, de = m.home[0] - m.position[0], m.home[1] - m.position[1]
        m.told_home = dn * dn + de * de < m.WP_RADIUS * m.WP_RADIUS
        m.arrived = False
    elif mode == _LOITER:
        stay(m)
    elif mode == _SIMPLE:
        note_heading(m)
    elif mode == _CIRCLE:
        begin_circle(m)
    return MAV_RESULT_ACCEPTED


_enter = told(_change_mode, _MODES)


@kernel
def _arm(m: Any, forced: bool, t: float) -> int:
    if not (ready(m, t) or forced):
        return MAV_RESULT_FAILED
    if m.mode in (_RTL, _SMART_RTL):
        say(m, MAV_SEVERITY_CRITICAL, ARM_MODE, 0)
        return MAV_RESULT_FAILED
    if m.emergency_stop and not forced:
        say(m, MAV_SEVERITY_CRITICAL, ARM_STOPPED, 0)
        return MAV_RESULT_FAILED
    blind = m.gps_silent and m.mode not in _FREE
    if blind and not forced:
        say(m, MAV_SEVERITY_CRITICAL, ARM_GPS, 1)
    if not forced and (not battery_permits_arming(m) or blind):
        return MAV_RESULT_FAILED
    m.armed = True
    m.armed_at = t
    home_here(m)
    begin_track(m, t)
    return MAV_RESULT_ACCEPTED


@kernel
def _use_own(m: Any, function: int, at: int, t: float) -> bool:
    """Does what a switch with a function of ArduRover alone does; returns whether it is one."""
    if function == _SAVE_WAYPOINT:
        if at == HIGH and m.mode != _AUTO:
            if m.armed:
                append_waypoint(m)
            else:
                m.mission_count, m.mission_current, m.uploading = 0, 0, False
                say(m, MAV_SEVERITY_NOTICE, SAVED_NONE, 0)
                m.home_set = False
                home_here(m)
                say_home(m)
    elif function == _GPS:
        m.gps_off = at == HIGH
    elif function == _LEARN:
        if at == HIGH:
            begin_learning(m, t)
    else:
        return function in _IDLE_FUNCTIONS
    return True


_use_switch, _watch_switches = switches(VARIABLES, "MODE", _MODE_FUNCTIONS, False, _enter, _arm, _use_own)


@kernel
def _command(m: Any, command: int, p1: float, p2: float, p7: float, t: float) -> int:  # noqa: ARG001
    if command == MAV_CMD_MISSION_START:
        return _enter(m, _AUTO, t) if p1 == 0.0 and p2 == 0.0 else MAV_RESULT_DENIED
    if command == MAV_CMD_DO_SET_MISSION_CURRENT:
        return MAV_RESULT_ACCEPTED if set_current(m, p1) else MAV_RESULT_FAILED
    if command == MAV_CMD_DO_AUX_FUNCTION:
        return int(_use_switch(m, p1, p2, t))
    if command == MAV_CMD_BATTERY_RESET:
        return MAV_RESULT_ACCEPTED if reset_battery(m, p1, p2, t) else MAV_RESULT_FAILED
    if command == MAV_CMD_DO_CHANGE_SPEED:
        if p1 not in (0.0, 1.0):  # speeds of climb and descent
            return MAV_RESULT_DENIED
        driving = m.mode == _AUTO or m.mode == _RTL or (m.mode == _GUIDED and m.guided_kind == POSITION)
        if not driving or not p2 > 0.0 or not math.isfinite(p2):
            return MAV_RESULT_FAILED
        m.cruise = p2
        return MAV_RESULT_ACCEPTED
    return MAV_RESULT_UNSUPPORTED


@kernel
def _hear(m: Any, message: int, t: float) -> None:
    if message == SET_POSITION_TARGET_LOCAL_NED:
        local_target(m, t)
    else:
        global_target(m, t)
    m.arrived = m.guided_kind == HOLD


@kernel
def _other(m: Any, message: int, sender: int, part: int, t: float) -> None:
    if message == HEARTBEAT or hear_sticks(m, message, sender, t):
        note_station(m, sender, t)
    elif not _hear_parameter(m, message):
        _hear_mission(m, message, sender, part, t)


_receive = receiver(firmware(_GUIDED, _RTL, _enter, _arm, _command, _hear, _other, testing(_arm)))


# ---- driving -------------------------------------------------------------------------------------------------------


@kernel
def _rest(m: Any, h: float) -> None:
    """Stops; boats come back to their place when they have drifted away."""
    if m.kind != MAV_TYPE_SURFACE_BOAT:
        stop(m, h)
        return
    dn, de = m.guided_position[0] - m.position[0], m.guided_position[1] - m.position[1]
    distance = math.sqrt(dn * dn + de * de)
    if distance > m.LOIT_RADIUS:
        m.drifted = True
    elif distance < 0.5 * m.LOIT_RADIUS:
        m.drifted = False
    if m.drifted:
        drive(m, min(cruise(m), math.sqrt(2.0 * m.ATC_ACCEL_MAX * distance)), math.atan2(de, dn), h)
    else:
        stop(m, h)


@kernel
def _arrive(m: Any) -> None:
    m.arrived = True
    m.drifted = False


@kernel
def _drive_legs(m: Any, h: float) -> None:
    """Drives along the leg, and rests at its end."""
    if m.arrived:
        _rest(m, h)
    elif drive_legs(m, h):
        _arrive(m)


@kernel
def _guide(m: Any, t: float, h: float) -> None:
    """Follows the target of GUIDED; accelerations alone are not followed."""
    if m.guided_kind == ACCELERATION or (m.guided_kind == VELOCITY and t - m.guided_time > _TIMEOUT):
        hold_here(m)
        m.arrived = True
    if m.guided_kind == VELOCITY:
        m.arrived = False
        vn, ve = m.guided_velocity[0], m.guided_velocity[1]
        speed = math.sqrt(vn * vn + ve * ve)
        if speed < STANDING:
            stop(m, h)
        else:
            drive(m, speed, math.atan2(ve, vn), h)
        return
    n, e = m.guided_position[0], m.guided_position[1]
    if is_new(m, n, e) and m.guided_kind != HOLD:
        m.arrived = False
    if m.arrived:
        _rest(m, h)
    elif approach(m, n, e, h):
        _arrive(m)
        tell_reached(m, 0)


@kernel
def _behind(m: Any, row: int) -> int:
    """Returns the row of the waypoint to which the vehicle goes on without a stop, or 0."""
    if int(m.mission[row, COMMAND]) != MAV_CMD_NAV_WAYPOINT or m.mission[row, P1] > 0.0:
        return 0
    for after in range(row + 1, m.mission_count):
        command = int(m.mission[after, COMMAND])
        if command in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_UNLIM):
            return after
        if command != MAV_CMD_DO_CHANGE_SPEED:
            break
    return 0


@kernel
def _begin_item(m: Any, row: int, n: float, e: float) -> None:
    """Begins the leg to a place of the mission."""
    go_to(m, n, e, m.position[2])
    m.arrived = False
    m.item_since = -1.0
    after = _behind(m, row)
    if after > 0:
        to_n, to_e, _ = item_place(m, after)
        set_leg(m, n, e, (to_n, to_e), True)
    else:
        set_leg(m, n, e, (n, e), False)


@kernel
def _carry_out(m: Any, t: float, h: float) -> None:
    """Carries the mission out; at its end, the vehicle holds its place."""
    tell_item(m)
    if m.uploading:
        _drive_legs(m, h)
        return
    row = m.mission_current
    if m.mission_done or row >= m.mission_count:
        if not m.mission_done:
            say(m, MAV_SEVERITY_NOTICE, MISSION_DONE, 0)
        m.mission_done = True
        _drive_legs(m, h)
        return
    command = int(m.mission[row, COMMAND])
    if command == MAV_CMD_DO_CHANGE_SPEED:
        if m.mission[row, P2] > 0.0:
            m.cruise = m.mission[row, P2]
        complete_item(m)
        return
    n, e = m.home[0], m.home[1]
    if command != MAV_CMD_NAV_RETURN_TO_LAUNCH:
        n, e, _ = item_place(m, row)
    if m.guided_position[0] != n or m.guided_position[1] != e:
        _begin_item(m, row, n, e)
    if m.arrived and m.kind != MAV_TYPE_SURFACE_BOAT:
        drive_legs(m, h)  # a rover goes on to the place
    else:
        _drive_legs(m, h)
    if m.arrived and m.item_since < 0.0:
        m.item_since = t
        if command != MAV_CMD_NAV_LOITER_UNLIM:
            wait = float(m.mission[row, P1])
            text = REACHED_WAITS if wait >= 1.0 else REACHED
            say_figures(m, MAV_SEVERITY_INFO, text, (float(row), float(math.floor(wait)), 0.0, 0.0))
    if m.item_since >= 0.0 and command != MAV_CMD_NAV_LOITER_UNLIM and t - m.item_since >= m.mission[row, P1]:
        complete_item(m)


@kernel
def _pilot(m: Any, t: float, h: float) -> None:
    """Drives as the pilot says, and in the modes that need no target."""
    if m.mode == _MANUAL:
        manual(m, t, h)
    elif m.mode == _HOLD:
        coast(m, h)
    elif m.mode == _ACRO:
        acro(m, t, h)
    elif m.mode == _STEERING:
        steering(m, t, h)
    elif m.mode == _SIMPLE:
        simple(m, t, h)
    elif m.mode == _LOITER:
        loiter(m, h)
    else:
        circle(m, h)


@kernel
def _act(m: Any, t: float, h: float) -> None:
    """Drives in the mode that it has."""
    if m.mode == _GUIDED:
        _guide(m, t, h)
    elif m.mode == _AUTO:
        _carry_out(m, t, h)
    elif m.mode == _RTL or (m.mode == _SMART_RTL and retrace(m, h)):
        _drive_legs(m, h)
        if m.arrived and not m.told_home:
            m.told_home = True
            say(m, MAV_SEVERITY_INFO, DESTINATION, 0)
    elif m.mode != _SMART_RTL:
        _pilot(m, t, h)


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Starts disarmed in MANUAL."""
    if m.airframe != Airframe.rover and m.airframe != Airframe.boat:
        return _NO_AIRFRAME
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.CRUISE_SPEED, m.ATC_ACCEL_MAX, m.TURN_RADIUS) <= 0.0:
        return _BAD_GAIN
    m.kind = MAV_TYPE_SURFACE_BOAT if m.airframe == Airframe.boat else MAV_TYPE_GROUND_ROVER
    m.on_ground = True
    m.mission_count = max(m.mission_count, 1)  # a reboot keeps it
    m.item_since = -1.0
    home_here(m)
    m.motor[0], m.motor[1] = 0.5, 0.5
    start_gps(m)
    drain_battery(m, 0.0)
    start_switches(m)
    start_streams(m)
    hold_here(m)
    m.arrived = True
    return 0


_reboot = rebooting(VARIABLES, start)
_watch_failsafes = failsafes(_HOLD, _RTL, _SMART_RTL, _LOITER, _AUTO, _FREE, _enter)


@kernel
def _watch(m: Any, t: float) -> None:
    """Records the path, runs the fail-safes and reads the switches when they are due."""
    if m.armed and t >= m.crumb_next and m.mode != _SMART_RTL:
        record_track(m, t)
    if t >= m.failsafe_due:
        _watch_failsafes(m, t)
        if m.learns:
            learn(m, t)
    if t >= m.switch_due:
        _watch_switches(m, t)
    due = min(m.failsafe_due, m.switch_due)
    m.watch_next = min(m.crumb_next, due) if m.armed else due


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
    if t >= m.watch_next:
        _watch(m, t)
    m.desired_velocity[0], m.desired_velocity[1] = 0.0, 0.0
    m.leg_idle += h
    if not m.armed:
        home_here(m)
        m.motor[0], m.motor[1] = 0.5, 0.5
        m.demand, m.integral = 0.0, 0.0
        m.test_motor = 0
    elif m.test_motor > 0:
        continue_test(m, t)
    else:
        _act(m, t, h)
        if m.emergency_stop:
            m.motor[1] = 0.5
            m.demand, m.integral = 0.0, 0.0
    n, e, d = m.position[0], m.position[1], m.position[2]
    if m.guided_kind != VELOCITY:
        n, e = m.guided_position[0], m.guided_position[1]
    m.target[0], m.target[1], m.target[2] = n, e, d
    m.desired_position[0], m.desired_position[1], m.desired_position[2] = n, e, d
    if m.uploading:
        continue_upload(m, t)
    if m.listed >= 0:
        _continue_list(m)
    stream(m, t)
    return 0


class RoverAutopilot(Model):
    """Autopilot of rovers and boats with ArduRover's modes and MAVLink behaviour."""

    step_size = 0.0125
    variables = VARIABLES
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_AIRFRAME: "it drives vehicles of the airframes rover and boat; others need another autopilot",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _BAD_GAIN: "CRUISE_SPEED, ATC_ACCEL_MAX and TURN_RADIUS must be positive",
    }

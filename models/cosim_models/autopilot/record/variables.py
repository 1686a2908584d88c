"""Declarations of `Autopilot`: its ports, its parameters (`parameters`) and the memory of its record.

This module contains no computation.
"""

from __future__ import annotations

from cosim import Input, Memory, Output, PacketInput, PacketOutput, State
from cosim.vehicle import MAX_MOTORS, Airframe, inputs_for
from cosim.verdict import Logged, Role
from cosim_models.autopilot.control.pid import PID_STATE, PLANE_STATE
from cosim_models.autopilot.control.scurve import LEG
from cosim_models.autopilot.control.spline import SPLINE
from cosim_models.autopilot.link.links import LINKS
from cosim_models.autopilot.mission.fences import FENCE_CAPACITY, FENCE_ITEM
from cosim_models.autopilot.mission.missions import ITEM, MISSION_CAPACITY
from cosim_models.autopilot.mission.rally import RALLY_CAPACITY, RALLY_ITEM
from cosim_models.autopilot.record.modes import Mode
from cosim_models.autopilot.record.parameters import CRUMBS, PARAMETERS
from cosim_models.autopilot.record.streams import STREAM_COUNT
from cosim_models.autopilot.record.tuning import TUNING_MEMORY

__all__ = ["CHANNELS", "SERVOS", "VARIABLES"]

CHANNELS = 16
"""Channels of the remote control."""

SERVOS = 32
"""Servo outputs, those of the motors first."""

MEMORY = (
    # sensed motion: north, east, up (NEU; the inputs are NED), and FRD
    State("position_neu", shape=3, unit="m", description="sensed position, north, east, up"),
    State("velocity_neu", shape=3, unit="m/s", description="sensed velocity, north, east, up"),
    State("acceleration_neu", shape=3, unit="m/s2", description="sensed acceleration, without gravity"),
    State("gyro", shape=3, unit="rad/s", description="filtered angular velocity, FRD"),
    State("q", shape=4, unit="1", description="sensed attitude, body to NED"),
    Memory("filter_dt"),
    Memory("gyro_filter", shape=3),
    Memory("accel_filter", shape=3),
    Memory("gyro_delay", shape=(3, 2)),
    Memory("accel_delay", shape=(3, 2)),
    # attitude control
    State("attitude_target", shape=4, unit="1", description="demanded attitude, body to NED"),
    Memory("rate_target", shape=3),  # of the target attitude, in its own axes
    State("rate_wanted", shape=3, unit="rad/s", description="demanded angular velocity of the body, FRD"),
    Memory("rate_pid", shape=(3, PID_STATE)),
    State("torque", shape=3, unit="1", description="demanded torques, -1 to 1, FRD"),
    Memory("thrust_error"),  # angle of the thrust from the target's
    # position control: north, east, up
    Memory("speed_max"),
    Memory("speed_up"),
    Memory("speed_down"),
    Memory("accel_max"),
    Memory("accel_up"),
    Memory("jerk_max"),
    Memory("jerk_up"),
    Memory("desired_position_neu", shape=3),
    Memory("desired_velocity_neu", shape=3),
    State("desired_acceleration_neu", shape=3, unit="m/s2", description="acceleration on the shaped path"),
    Memory("position_error_neu", shape=3),
    State("target_velocity_neu", shape=3, unit="m/s", description="demanded velocity, north, east, up"),
    State("target_acceleration_neu", shape=3, unit="m/s2", description="demanded acceleration"),
    Memory("velocity_pid", shape=PLANE_STATE),
    Memory("climb_pid", shape=PID_STATE),
    Memory("accel_pid", shape=PID_STATE),
    Memory("limit_neu", shape=3),  # direction of actuator saturation
    Memory("path_heading"),
    Memory("path_turn_rate"),
    Memory("lean_max"),  # maximum lean that keeps height
    # motors
    State("motor_count", type=int, description="motors that the mixer drives"),
    Memory("factors", shape=(MAX_MOTORS, 3)),
    Memory("thrust", shape=MAX_MOTORS),
    Memory("thrust_mean", shape=MAX_MOTORS),  # over half a second
    Memory("boosting", dtype="?"),  # a motor is left out of the limits of the others, or on its way back
    Memory("lift"),  # of a command: air density relative to sea level, and voltage
    Memory("spool_state", dtype="i4"),
    Memory("spool_wanted", dtype="i4"),
    Memory("spin_up"),
    Memory("thrust_max"),
    State("throttle_in", unit="1", description="demanded throttle, 0 to 1"),
    State("throttle_command", unit="1", description="demanded throttle with the boost for the lean angle"),
    Memory("throttle_cutoff"),
    Memory("throttle_filtered"),
    Memory("throttle_average_max"),
    State("throttle_out", unit="1", description="throttle after the mixer, 0 to 1"),
    State("throttle_hover", unit="1", description="throttle in hover, as learned"),
    Memory("throttle_mix"),
    Memory("limit_roll_pitch", dtype="?"),
    Memory("limit_yaw", dtype="?"),
    Memory("limit_throttle_lower", dtype="?"),
    Memory("limit_throttle_upper", dtype="?"),
    # modes
    State("home_neu", shape=3, unit="m", description="home, north, east, up from the local origin"),
    Memory("home_locked", dtype="?", rare=True),  # set by a command, not by arming
    Memory("armed_at"),
    Memory("armed_heading", rare=True),
    Memory("flown_since", rare=True),  # begin of the flight
    Memory("flights", dtype="i4", rare=True),
    Memory("wind_ne", shape=2, rare=True),  # m/s, as told
    Memory("idle_since"),
    Memory("booted_at"),  # of the run; all other times count from it
    Memory("rebooting", dtype="?"),  # a reboot is due, or its silence
    Memory("restart_at", rare=True),  # -1: the restart has been
    Memory("modes_asked", dtype="?", rare=True),  # AVAILABLE_MODES
    Memory("mode_asked", dtype="i4", rare=True),  # index, 0: one after the other
    Memory("mode_told", dtype="i4", rare=True),
    Memory("tells_elevation", dtype="?", rare=True),
    Memory("arming_delay", dtype="?"),
    Memory("auto_armed", dtype="?"),
    Memory("touched", dtype="?"),
    Memory("land_time"),
    Memory("land_acceleration_neu", shape=3),
    Memory("submode", dtype="i4"),
    Memory("guided_position_neu", shape=3),
    Memory("guided_velocity_neu", shape=3),
    Memory("guided_acceleration_neu", shape=3),
    Memory("guided_time"),
    Memory("paused", dtype="?"),
    # terrain
    Memory("above_terrain", dtype="?"),  # the height of guided_position_neu is above it
    Memory("terrain_on", dtype="?"),  # terrain_shift is in use
    Memory("terrain_shift", shape=3, rare=True),  # of the path: height, speed, acceleration
    Memory("terrain_target", rare=True),  # height to which it moves
    Memory("terrain_reference", rare=True),  # of the grid above the local origin
    Memory("terrain_referred", dtype="?", rare=True),
    Memory("terrain_missing", dtype="?", rare=True),  # a destination cannot be flown to
    Memory("avoid_velocity", shape=3, rare=True),  # to which fences reduced the last one
    Memory("avoiding", rare=True),  # s for which it counts
    Memory("terrain_gap", rare=True),  # s for which the height has been unknown, and known again
    Memory("terrain_good", rare=True),
    State("terrain_failsafe", type=bool, description="whether the fail-safe of missing terrain is on"),
    Memory("ranging", dtype="?"),  # there is a rangefinder
    Memory("ground_reference", rare=True),  # height of the ground at the start, of the grid's zero with a grid
    Memory("range_due", rare=True),
    Memory("range_count", dtype="i4", rare=True),  # good measurements in a row
    Memory("range_good_at", rare=True),
    Memory("range_height", rare=True),  # last measurement that did not jump
    Memory("range_jumps", dtype="i4", rare=True),
    Memory("range_filtered", rare=True),
    Memory("range_from", rare=True),  # height of the vehicle at the last measurement
    Memory("range_terrain", rare=True),  # filtered height of the terrain above the local origin
    Memory("range_trusted", dtype="?", rare=True),
    Memory("range_cleared", dtype="i4", rare=True),  # jumps that were believed
    Memory("surface_cleared", dtype="i4", rare=True),  # the same, when the surface was last followed
    Memory("surface_gap", rare=True),  # s for which the surface has not been seen
    Memory("circle_up", rare=True),  # height of the circle's centre above the terrain
    Memory("circle_above", dtype="?", rare=True),  # it is above the terrain
    Memory("angle_q", shape=4, rare=True),  # attitude demanded by SET_ATTITUDE_TARGET
    Memory("angle_free", dtype="?", rare=True),  # it demands only angular velocities
    Memory("angle_rates", shape=3, rare=True),
    Memory("angle_climb", rare=True),  # climb rate, or throttle
    Memory("angle_thrust", dtype="?", rare=True),
    Memory("takeoff_from"),
    Memory("takeoff_to"),
    Memory("takeoff_done", dtype="?"),
    Memory("yaw_mode", dtype="i4"),
    Memory("yaw_fixed"),
    Memory("yaw_rate"),
    Memory("yaw_left", rare=True),  # remaining angle to turn to yaw_fixed, and the rate
    Memory("yaw_slew", rare=True),
    Memory("region", shape=2, rare=True),  # north and east of the region of interest
    Memory("loiter_brake"),
    Memory("loiter_since"),
    Memory("legs", shape=(3, LEG), rare=True),  # last, this and next
    Memory("leg_origin", shape=3, rare=True),
    Memory("leg_next", shape=3, rare=True),  # destination of the next
    Memory("leg_target", shape=(3, 3), rare=True),  # position, velocity, acceleration
    Memory("leg_rate", rare=True),  # rate of time along them
    Memory("leg_speed", rare=True),  # limit of speed, shaped while the flight pauses
    Memory("leg_speed_full", rare=True),
    Memory("leg_accel", rare=True),
    Memory("legs_active", dtype="?", rare=True),
    Memory("leg_reached", dtype="?", rare=True),
    Memory("leg_fast", dtype="?", rare=True),  # the destination is only passed
    Memory("splines", shape=(2, SPLINE), rare=True),  # this leg and the next, where they are curved
    Memory("spline_ends", shape=(2, 2, 3), rare=True),  # directions at their beginning and end, while they are planned
    Memory("leg_curved", dtype="?", rare=True),
    Memory("next_curved", dtype="?", rare=True),
    Memory("rtl_stage", dtype="i4"),
    Memory("return_since", rare=True),  # waiting above the place of return
    Memory("auto_rtl", dtype="?"),  # AUTO flies the landing sequence as AUTO_RTL
    Memory("flip_from", dtype="i4", rare=True),  # mode that continues
    Memory("flip_stage", dtype="i4", rare=True),
    Memory("flip_since", rare=True),
    Memory("flip_turn", dtype="i4", shape=2, rare=True),  # direction about roll and pitch
    Memory("flip_angles", shape=3, rare=True),  # roll, pitch and heading to return to
    Memory("throw_stage", dtype="i4", rare=True),
    Memory("throw_done", dtype="?", rare=True),
    Memory("throw_since", rare=True),  # possible throw, and the climb rate then
    Memory("throw_climb", rare=True),
    Memory("drift_brake", rare=True),
    Memory("drift_stick", rare=True),
    Memory("hold_stage", dtype="i4", shape=2, rare=True),  # POSHOLD: roll, pitch
    Memory("hold_lean", shape=2, rare=True),
    Memory("hold_pilot", shape=2, rare=True),
    Memory("hold_last", shape=2, rare=True),
    Memory("hold_since", shape=2, rare=True),
    Memory("hold_brake", shape=2, rare=True),
    Memory("hold_brake_most", shape=2, rare=True),
    Memory("hold_brake_since", shape=2, rare=True),
    Memory("hold_brake_falls", dtype="u1", shape=2, rare=True),
    Memory("hold_settling_since", rare=True),
    Memory("hold_wind", shape=2, rare=True),  # acceleration against it, north and east
    Memory("hold_wind_lean", shape=2, rare=True),
    Memory("hold_wind_since", rare=True),
    Memory("zigzag_moving", dtype="?", rare=True),
    Memory("zigzag_stored", dtype="u1", shape=2, rare=True),
    Memory("zigzag_places", shape=(2, 2), rare=True),
    Memory("crumbs", shape=(CRUMBS, 3), rare=True),
    Memory("crumb_count", dtype="i4", rare=True),
    Memory("crumbs_on", dtype="?", rare=True),
    Memory("crumbs_begun", dtype="?", rare=True),
    Memory("crumbs_simple", dtype="i4", rare=True),  # points that have been simplified, and searched for loops
    Memory("crumbs_checked", dtype="i4", rare=True),
    Memory("crumb_kept", dtype="u1", shape=CRUMBS, rare=True),
    Memory("crumb_todo", dtype="i4", shape=(CRUMBS, 2), rare=True),
    Memory("crumb_middle", shape=3, rare=True),
    Memory("crumb_stored", rare=True),
    Memory("crumb_known", rare=True),
    Memory("crumb_next", rare=True),
    Memory("crumb_taken", dtype="?", rare=True),
    Memory("crumb_place", shape=3, rare=True),
    Memory("rtl_place", shape=2, rare=True),
    *TUNING_MEMORY,
    # link
    Memory("payload", dtype="u1", shape=255),
    Memory("received", dtype="u1", shape=255),
    Memory("link", dtype="i4"),  # link being served
    Memory("sequence", dtype="i4", shape=LINKS, rare=True),
    Memory("text_queue", dtype="i8", shape=(12, 6), rare=True),  # severity, text, number, second, bits of links, third
    Memory("text_count", dtype="i4"),
    Memory("ack_room", dtype="i4"),  # bytes reserved for acknowledgements of received commands
    Memory("link_version", dtype="i4", shape=LINKS, rare=True),
    Memory("component_known", dtype="u1", shape=256, rare=True),  # 1: heard from this component of the own system
    Memory("deprecation_told", dtype="?", rare=True),
    Memory("log_told", dtype="?", rare=True),
    Memory("levelled_at", rare=True),
    Memory("parachute_on", dtype="?", rare=True),
    Memory("interval", shape=(LINKS, STREAM_COUNT), rare=True),
    Memory("due", shape=(LINKS, STREAM_COUNT), rare=True),
    Memory("next_due", shape=LINKS, rare=True),
    Memory("soonest_due"),  # earliest due time of all links
    Memory("transferring", dtype="?"),  # a list or a file is being sent, or items are being received
    Memory("told_armed", dtype="?"),
    Memory("told_mode", dtype="i4"),
    Memory("told_home", dtype="?"),
    Memory("parameter_next", dtype="i4", shape=LINKS, rare=True),  # next index of the list being sent
    Memory("parameter_due", shape=LINKS, rare=True),
    # pilot
    Memory("rc_known", dtype="?"),  # an override has been received
    Memory("rc_until"),  # when the last override expires
    Memory("throttle_open_at"),  # when the throttle stick was last open
    Memory("pilot_flies", dtype="?", rare=True),  # demands of the sticks in autonomous modes
    Memory("pilot_turn", rare=True),
    Memory("pilot_stick", shape=2, rare=True),  # forward and right, -1 to 1
    Memory("pilot_takeoff", dtype="?"),
    State("radio_lost", type=bool, description="whether the radio fail-safe is on"),
    Memory("radio_heard", rare=True),
    Memory("rc_override", dtype="i4", shape=CHANNELS, rare=True),  # us, 0: none
    Memory("rc_time", shape=CHANNELS, rare=True),
    Memory("switch_position", dtype="i4", rare=True),  # of the mode switch, 1 to 6
    Memory("switch_seen", dtype="i4", rare=True),
    Memory("switch_since", rare=True),
    Memory("switch_moved", dtype="?", rare=True),  # by an override, once
    Memory("rudder_count", dtype="i4", rare=True),
    Memory("loiter_tilt", shape=2, rare=True),  # roll and pitch as they will follow the sticks
    Memory("loiter_tilt_rate", shape=2, rare=True),
    Memory("emergency_stop", dtype="?", rare=True),  # no motor turns
    Memory("stopped_for", rare=True),  # s, armed
    Memory("aux_position", dtype="i4", shape=CHANNELS, rare=True),  # of switches with a function: 1 low to 3 high
    Memory("aux_seen", dtype="i4", shape=CHANNELS, rare=True),
    Memory("aux_since", shape=CHANNELS, rare=True),  # s
    Memory("circle_centre", shape=2, rare=True),
    Memory("circle_radius", rare=True),
    Memory("circle_rate", rare=True),
    Memory("circle_asked", shape=2, rare=True),  # CIRCLE_RADIUS and CIRCLE_RATE as last read
    Memory("circle_angle", rare=True),
    Memory("circle_turning", rare=True),
    Memory("circle_total", rare=True),  # angle flown
    Memory("circle_told", dtype="i4", rare=True),  # turns reported
    Memory("file_bursting", dtype="?", rare=True),
    Memory("file_link", dtype="i4", rare=True),
    Memory("file_open", dtype="?", rare=True),
    Memory("file_session", dtype="i4", rare=True),
    Memory("file_sequence", dtype="i4", rare=True),
    Memory("file_at", dtype="i4", rare=True),
    Memory("file_piece", dtype="i4", rare=True),
    Memory("file_system", dtype="i4", rare=True),
    Memory("file_component", dtype="i4", rare=True),
    Memory("file_due", rare=True),
    # outputs
    Memory("outputs_busy", dtype="?"),  # a repetition or a motor test is in progress
    Memory("servo", dtype="i4", shape=SERVOS, rare=True),  # us
    Memory("relay_on", dtype="?", rare=True),
    Memory("repeat_kind", dtype="i4", rare=True),
    Memory("repeat_number", dtype="i4", rare=True),
    Memory("repeat_pulse", dtype="i4", rare=True),
    Memory("repeat_left", dtype="i4", rare=True),
    Memory("repeat_every", rare=True),
    Memory("repeat_at", rare=True),
    Memory("test_motor", dtype="i4", rare=True),  # in the order of the test, from 1; 0: no test
    Memory("test_kind", dtype="i4", rare=True),
    Memory("test_throttle", rare=True),
    Memory("test_time", rare=True),
    Memory("test_count", dtype="i4", rare=True),
    Memory("test_since", rare=True),
    # fail-safes
    Memory("next_watch"),
    Memory("station_heard", rare=True),
    Memory("station_known", dtype="?", rare=True),
    State("station_lost", type=bool, description="whether the ground station fail-safe is on"),
    State("battery_voltage", unit="V", description="voltage of the battery"),
    State("battery_current", unit="A", description="current of the battery"),
    State("battery_used", unit="1", description="used charge in mAh"),
    State("battery_energy", unit="J", description="used energy"),
    Memory("air_density", rare=True),  # relative to sea level
    Memory("voltage_share", rare=True),  # of MOT_BAT_VOLT_MAX, filtered
    Memory("battery_since", shape=2, rare=True),  # start of low and critical voltage; -1: not low
    State("battery_alarm", type=int, description="battery alarm: 1 low, 2 critical"),
    State("fence_breach", type=int, description="breached fences, bits of FENCE_TYPE"),
    Memory("fence_low_armed", dtype="?", rare=True),
    Memory("fence_backup", shape=3, rare=True),  # beyond maximum height, circle, minimum height: another breach
    Memory("next_fence", rare=True),  # time at which fences are looked at next
    Memory("fence_new", dtype="i4", rare=True),  # breaches that the next look at the fences acts on
    Memory("fence_recovery", rare=True),  # time until which breaches are not looked at; 0: they are
    Memory("land_pause"),  # s until LAND descends
    Memory("land_blind", dtype="?"),  # LAND without a position
    # failing sensors
    Memory("sim_on", dtype="?"),
    Memory("gps_jammed", dtype="?", rare=True),
    Memory("jammed_at", rare=True),  # -1: never
    Memory("jam_changed", shape=5, rare=True),  # when what it tells changed (see `jamming`)
    Memory("jam_place", shape=2, rare=True),  # that it tells, north and east
    Memory("gps_claim", shape=2, rare=True),  # errors of velocity and place that GPS claims
    Memory("gps_doubt", shape=2, rare=True),  # that of the velocity smoothed, and its peak
    Memory("gps_doubtful", dtype="?", rare=True),
    Memory("gps_noise", rare=True),  # factor of these, by the number of satellites
    Memory("gps_satellites", dtype="i4", rare=True),
    Memory("gps_taken_at", rare=True),  # time of the last fix
    Memory("gps_good_at", rare=True),  # time of the last one that claimed to be good
    Memory("estimate_errs", dtype="?", rare=True),  # the filters of the estimate run
    Memory("gyro_delays", shape=(3, 2), rare=True),  # of the low-pass of its noise
    Memory("lane", dtype="i4", rare=True),  # that flies, from 0
    Memory("imu", dtype="i4", rare=True),  # its inertial sensor, from 0
    Memory("lane_since", shape=2, rare=True),  # when each lane was changed to
    Memory("reset_asked", dtype="?", rare=True),  # the same is near
    Memory("lane_asked", dtype="?", rare=True),  # the fail-safe of the estimate is about to begin
    Memory("lane_now", shape=(2, 8), rare=True),  # errors by which each flies: of place, velocity, tilt (see `filter`)
    Memory("lane_past", shape=(2, 8), rare=True),  # those of its filter
    Memory("lane_learned", shape=(2, 6), rare=True),  # errors of gyro and accelerometer, FRD
    Memory("lane_up", shape=(2, 9), rare=True),  # covariances
    Memory("lane_side", shape=(2, 25), rare=True),
    Memory("lane_line", shape=(2, 144), rare=True),  # delay lines
    Memory("lane_held", shape=(2, 2), rare=True),  # place that is held without GPS, north and east
    Memory("lane_rate", shape=(2, 3), rare=True),  # errors of the height's derivative: see `filter`
    Memory("lane_dip", shape=(2, 2), rare=True),  # tilt that the filter takes for one of the magnetic field
    Memory("lane_sums", shape=(2, 6), rare=True),
    Memory("lane_smooth", shape=(2, 3), rare=True),  # acceleration, m/s2
    Memory("lane_turned", shape=(2, 3), rare=True),  # covariances of velocity north, east, and heading with the heading
    Memory("lane_ratio", shape=(2, 3), rare=True),  # squared innovations over their gates: velocity, place, height
    Memory("lane_time", shape=(2, 5), rare=True),  # when measurements passed, and of the accelerometer's checks
    Memory("lane_bad", shape=2, dtype="u1", rare=True),  # the accelerometer is
    Memory("lane_place", shape=16, rare=True),
    Memory("lane_column", shape=5, rare=True),
    Memory("frame_count", dtype="i4", rare=True),
    Memory("frame_left", rare=True),  # s since the last period of the filters
    Memory("told_error", shape=3, rare=True),  # of GPS and barometer, north, east, down
    Memory("told_speed", shape=3, rare=True),  # error of the velocity of GPS
    Memory("gps_heard", dtype="?", rare=True),
    Memory("gyro_draws", dtype="i4", rare=True),
    Memory("gyro_drift", rare=True),  # rad/s, that has not been learned
    Memory("wind_speed", rare=True),  # that SIM_WIND_* ask for, after SIM_WIND_TC, m/s
    Memory("wind_from", rare=True),  # deg
    Memory("wind_rise", rare=True),  # deg
    Memory("wind_turbulence", shape=2, rare=True),  # horizontal and down, m/s
    Memory("wind_draws", dtype="i4", rare=True),
    Memory("wind_told", dtype="?", rare=True),
    Memory("position_lost", dtype="?"),
    Memory("estimate_error", shape=3, rare=True),  # north, east, up
    Memory("yaw_error", rare=True),
    Memory("yaw_error_rate", rare=True),
    Memory("gps_lost_at", rare=True),  # -1: never
    Memory("unaided", dtype="?", rare=True),  # nothing holds the tilt of the estimate
    Memory("gps_rejected_at", rare=True),
    Memory("gps_rejected", dtype="?", rare=True),
    State("glitching", type=bool, description="whether GPS is rejected"),
    Memory("glitch_seen_at", rare=True),
    Memory("position_ratio", rare=True),  # innovation over its gate
    Memory("velocity_ratio", rare=True),
    Memory("height_ratio", rare=True),
    Memory("smooth_position_ratio", rare=True),
    Memory("smooth_velocity_ratio", rare=True),
    Memory("ekf_count", dtype="i4", rare=True),
    State("ekf_failed", type=bool, description="whether the fail-safe of the estimate is on"),
    Memory("ekf_warned_at", rare=True),
    Memory("vibration_phase", rare=True),  # s since it began
    Memory("vibrates_since", rare=True),
    Memory("vibrated_at", rare=True),
    State("vibration_failsafe", type=bool, description="whether the height is controlled without the accelerometer"),
    Memory("crash_since", rare=True),
    Memory("crash_seen", rare=True),  # time of the last step that looked like it
    Memory("thrust_loss_since", rare=True),
    Memory("thrust_loss_seen", rare=True),  # time of the last step that looked like it
    Memory("lost_motor", dtype="i4", rare=True),
    Memory("boosted", dtype="?"),  # the lost motor is left out of the limits of the others
    Memory("boost_share", rare=True),  # by how much it is left out, 0 to 1
    Memory("unbalanced", dtype="?", rare=True),  # one motor gives much more than the mean
    Memory("yaw_integral", rare=True),  # mean of the integral of the yaw rate's controller
    Memory("yaw_warned_at", rare=True),
    # mission
    Memory("mission_count", dtype="i4"),  # number of items, including home
    Memory("mission_current", dtype="i4"),
    Memory("mission_complete", dtype="?"),
    Memory("mission_changed", dtype="?"),  # the current item must be started
    Memory("auto_command", dtype="i4"),  # MAV_CMD being flown
    Memory("auto_stage", dtype="i4", rare=True),
    Memory("auto_since", rare=True),
    Memory("auto_speed", shape=3, rare=True),  # along, up, down, as requested by the mission, 0: WPNAV_SPEED
    Memory("auto_do", dtype="i4", rare=True),  # row of the command beside navigation, 0: none
    Memory("auto_doing", dtype="?", rare=True),  # that command is not complete
    Memory("auto_do_since", rare=True),
    Memory("auto_landing", dtype="?"),
    Memory("fence", shape=(FENCE_CAPACITY, FENCE_ITEM)),
    Memory("fence_count", dtype="i4", rare=True),
    Memory("breach_count", dtype="i4", rare=True),
    Memory("breach_time", rare=True),
    Memory("rally", shape=(RALLY_CAPACITY, RALLY_ITEM), rare=True),
    Memory("rally_count", dtype="i4", rare=True),
    Memory("mission_replaced", dtype="?", rare=True),  # items have been uploaded since the last step of AUTO
    Memory("upload_kind", dtype="i4", rare=True),
    Memory("uploading", dtype="?", rare=True),
    Memory("upload_link", dtype="i4", rare=True),
    Memory("upload_count", dtype="i4", rare=True),
    Memory("upload_next", dtype="i4", rare=True),
    Memory("upload_system", dtype="i4", rare=True),
    Memory("upload_component", dtype="i4", rare=True),
    Memory("upload_heard", rare=True),
    Memory("upload_asked", rare=True),
    Memory("mission", shape=(MISSION_CAPACITY, ITEM)),
)

LOGGED = Logged(
    (
        ("ATT", "q"),
        ("ATT.Des", "attitude_target"),
        ("RATE.Des", "rate_wanted"),
        ("RATE", "gyro"),
        ("RATE.Out", "torque"),
        ("RATE.AOut", "throttle_out"),
        ("PSC.DP", "desired_position"),
        ("PSC.P", "position_neu"),
        ("PSC.DV", "desired_velocity"),
        ("PSC.TV", "target_velocity_neu"),
        ("PSC.V", "velocity_neu"),
        ("PSC.DA", "desired_acceleration_neu"),
        ("PSC.TA", "target_acceleration_neu"),
        ("PSC.A", "acceleration_neu"),
        ("CTUN.ThI", "throttle_in"),
        ("CTUN.ABst", "throttle_command"),
        ("CTUN.ThH", "throttle_hover"),
        ("ORGN.1", "home_neu"),
        ("MODE", "mode"),
        ("EV.10", "armed"),
        ("EV.18", "on_ground"),
        ("ERR.5", "radio_lost"),
        ("ERR.6", "battery_alarm"),
        ("ERR.8", "station_lost"),
        ("ERR.9", "fence_breach"),
        ("ERR.11", "glitching"),
        ("ERR.17", "ekf_failed"),
        ("RCOU", "motor"),
        ("RCOU.n", "motor_count"),
        ("ATUN", "tuned"),
        ("ATDE", "tuning"),
        ("BAT.Volt", "battery_voltage"),
        ("BAT.Curr", "battery_current"),
        ("BAT.CurrTot", "battery_used"),
        ("BAT.EnrgTot", "battery_energy"),
        ("BAT.Res", "battery_resistance"),
        ("BAT.cell", "SIM_BATT_CAP_AH"),
        ("BAT.full", "BATT_CAPACITY"),
    )
)
"""Inner values in the places of a DataFlash log."""

VARIABLES = (
    *inputs_for(Airframe.quad_x, Airframe.hexa_x, Airframe.octa_x, Airframe.y6, Airframe.quad_plus),
    Input(
        "supply_voltage",
        unit="V",
        start=-1.0,
        verdict=Role.OPTIONAL,
        description="measured voltage of the battery; negative: the autopilot simulates a battery itself",
    ),
    Input("supply_current", unit="A", verdict=Role.OPTIONAL, description="measured current of the battery"),
    Input(
        "adds_wind",
        type=bool,
        start=False,
        verdict=Role.OPTIONAL,
        description="true: the vehicle takes the wind `added_wind`; false refuses SIM_WIND_*",
    ),
    PacketInput("mavlink_rx", capacity=2048, description="packets received on board and from the swarm's radio"),
    PacketInput(
        "telemetry_rx",
        capacity=2048,
        verdict=Role.TELEMETRY,
        description="packets received from ground stations by radio",
    ),
    PacketInput("serial_rx", capacity=2048, verdict=Role.SERIAL, description="packets received by a cable"),
    *PARAMETERS,
    Output("motor", shape=MAX_MOTORS, unit="1", start=0.0, description="commands, (pwm - 1000) / 1000"),
    Output("armed", type=bool, start=False, verdict=Role.ARMED, description="whether the motors may turn"),
    Output("mode", type=Mode, start=Mode.STABILIZE, verdict=LOGGED, description="flight mode, by ArduCopter's number"),
    Output("on_ground", type=bool, start=True, description="landed, according to the land detector"),
    Output(
        "target", shape=3, unit="m", start=0.0, description="position of the destination, NED from the local origin"
    ),
    Output(
        "desired_position",
        shape=3,
        unit="m",
        start=0.0,
        verdict=Role.DESIRED_POSITION,
        description="position on the shaped path, NED",
    ),
    Output("desired_velocity", shape=3, unit="m/s", start=0.0, description="velocity on the shaped path, NED"),
    Output(
        "added_wind",
        shape=3,
        unit="m/s",
        start=0.0,
        verdict=Role.OPTIONAL,
        description="wind that SIM_WIND_* ask for, NED",
    ),
    PacketOutput("mavlink_tx", capacity=4096, description="packets sent on board and by the swarm's radio"),
    PacketOutput(
        "telemetry_tx", capacity=4096, verdict=Role.TELEMETRY, description="packets sent to ground stations by radio"
    ),
    PacketOutput("serial_tx", capacity=4096, verdict=Role.SERIAL, description="packets sent by a cable"),
    *MEMORY,
)
"""All variables of an Autopilot."""

"""The autopilot FMU: ArduCopter's control cascade, modes and MAVLink manners over the ports of any multirotor.

It reads the vehicle's true state (a perfect estimate), and picks its mixer from the vehicle's airframe while
initialising. Parameters that ArduCopter has too carry its names, units and defaults.
"""

from __future__ import annotations

from math import radians
from typing import Any

from cosim import Memory, Model, Output, PacketInput, PacketOutput, Parameter, State, kernel
from cosim.vehicle import MAX_MOTORS, MOTION_INPUTS

from cosim_models.copter_mavlink import answer, report
from cosim_models.copter_modes import CopterMode, fly
from cosim_models.copter_mixer import choose_mixer

__all__ = ["Autopilot"]


@kernel
def start(m: Any) -> int:
    """On the ground in STABILIZE, disarmed, HEARTBEAT once a second; all drones' heartbeats spread over the second."""
    m.mode = 0
    m.on_ground = True
    m.hover = m.MOT_THST_HOVER
    m.peer_version = 2
    m.stream_interval[0] = 1.0
    m.stream_due[0] = (m.SYSID_THISMAV % 16) / 16.0
    for i in range(3):
        m.home[i] = m.position[i]
        m.target[i] = m.position[i]
        m.desired_position[i] = m.position[i]
    return choose_mixer(m)


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """Packets in, control, packets out."""
    m.mavlink_tx_len = 0
    if m.mavlink_rx_len > 0:
        answer(m, t)
    fly(m, t, h)
    report(m, t + h)
    return 0


class Autopilot(Model):
    """Flies a multirotor as ArduCopter does: GUIDED, LOITER, RTL, LAND over MAVLink."""

    step_size = 0.0025
    variables = (
        *MOTION_INPUTS,
        PacketInput("mavlink_rx", capacity=1024, description="from on board and by radio"),
        Parameter("SYSID_THISMAV", type=int, start=1, minimum=1, maximum=255, description="MAVLink system id"),
        Parameter("origin_latitude", unit="rad", start=radians(-35.363262), description="of the local origin"),
        Parameter("origin_longitude", unit="rad", start=radians(149.165237), description="of the local origin"),
        Parameter("origin_altitude", unit="m", start=584.0, description="of the local origin above mean sea level"),
        Parameter("estimate_ready_time", unit="s", start=2.0, description="when the position estimate is good; ArduCopter needs 41 s"),
        Parameter("PSC_POSXY_P", unit="1/s", start=1.0, description="horizontal position to velocity"),
        Parameter("PSC_VELXY_P", unit="1/s", start=2.0, description="horizontal velocity to acceleration"),
        Parameter("PSC_VELXY_I", unit="1/s2", start=1.0, description="integral of the same"),
        Parameter("PSC_VELXY_D", unit="1", start=0.5, description="derivative of the same"),
        Parameter("PSC_VELXY_IMAX", unit="cm/s2", start=1000.0, description="largest integral"),
        Parameter("PSC_VELXY_FLTE", unit="Hz", start=5.0, description="filter of the velocity error"),
        Parameter("PSC_VELXY_FLTD", unit="Hz", start=5.0, description="filter of its derivative"),
        Parameter("PSC_POSZ_P", unit="1/s", start=1.0, description="height to climb rate"),
        Parameter("PSC_VELZ_P", unit="1/s", start=5.0, description="climb rate to acceleration"),
        Parameter("PSC_ACCZ_P", start=0.5, description="acceleration to throttle, per mille per cm/s2"),
        Parameter("PSC_ACCZ_I", start=1.0, description="integral of the same"),
        Parameter("PSC_ACCZ_IMAX", start=800.0, description="largest integral, per mille"),
        Parameter("PSC_ACCZ_FLTE", unit="Hz", start=20.0, description="filter of the acceleration error"),
        Parameter("PSC_JERK_XY", unit="m/s3", start=5.0, description="jerk limit of the desired path"),
        Parameter("PSC_JERK_Z", unit="m/s3", start=5.0, description="jerk limit of the desired climb"),
        Parameter("ANGLE_MAX", unit="cdeg", start=3000.0, description="largest lean"),
        Parameter("WPNAV_SPEED", unit="cm/s", start=1000.0, description="horizontal speed"),
        Parameter("WPNAV_SPEED_UP", unit="cm/s", start=250.0, description="climb rate"),
        Parameter("WPNAV_SPEED_DN", unit="cm/s", start=150.0, description="sink rate"),
        Parameter("WPNAV_ACCEL", unit="cm/s2", start=250.0, description="horizontal acceleration"),
        Parameter("WPNAV_ACCEL_Z", unit="cm/s2", start=100.0, description="vertical acceleration"),
        Parameter("WP_YAW_BEHAVIOR", type=int, start=2, description="0: keep, 1: face the target, 2: except in RTL"),
        Parameter("GUID_TIMEOUT", unit="s", start=3.0, description="after which a velocity target is dropped"),
        Parameter("LAND_SPEED", unit="cm/s", start=50.0, description="sink rate below 10 m"),
        Parameter("RTL_ALT", unit="cm", start=1500.0, description="height of the return flight"),
        Parameter("DISARM_DELAY", unit="s", start=10.0, description="on the ground until motors are disarmed; 0: never"),
        Parameter("ARMING_DELAY", unit="s", start=2.0, description="from arming until motors run"),
        Parameter("ATC_ANG_RLL_P", unit="1/s", start=4.5, description="roll angle to rate"),
        Parameter("ATC_ANG_PIT_P", unit="1/s", start=4.5, description="pitch angle to rate"),
        Parameter("ATC_ANG_YAW_P", unit="1/s", start=4.5, description="yaw angle to rate"),
        Parameter("ATC_ACCEL_R_MAX", unit="cdeg/s2", start=110000.0, description="roll acceleration"),
        Parameter("ATC_ACCEL_P_MAX", unit="cdeg/s2", start=110000.0, description="pitch acceleration"),
        Parameter("ATC_ACCEL_Y_MAX", unit="cdeg/s2", start=27000.0, description="yaw acceleration"),
        Parameter("ATC_INPUT_TC", unit="s", start=0.15, description="time constant of the attitude target"),
        Parameter("ATC_RAT_RLL_P", unit="s", start=0.135, description="roll rate to torque share"),
        Parameter("ATC_RAT_RLL_I", unit="1", start=0.135, description="integral of the same"),
        Parameter("ATC_RAT_RLL_D", unit="s2", start=0.0036, description="derivative of the same"),
        Parameter("ATC_RAT_PIT_P", unit="s", start=0.135, description="pitch rate to torque share"),
        Parameter("ATC_RAT_PIT_I", unit="1", start=0.135, description="integral of the same"),
        Parameter("ATC_RAT_PIT_D", unit="s2", start=0.0036, description="derivative of the same"),
        Parameter("ATC_RAT_YAW_P", unit="s", start=0.18, description="yaw rate to torque share"),
        Parameter("ATC_RAT_YAW_I", unit="1", start=0.018, description="integral of the same"),
        Parameter("ATC_RAT_YAW_D", unit="s2", start=0.0, description="derivative of the same"),
        Parameter("ATC_RAT_YAW_FLTE", unit="Hz", start=2.5, description="filter of the yaw rate error"),
        Parameter("MOT_THST_HOVER", start=0.35, minimum=0.125, maximum=0.6875, description="throttle that hovers, to begin with"),
        Parameter("MOT_HOVER_LEARN", type=int, start=2, description="0: no, otherwise the hover throttle is learnt"),
        Parameter("MOT_THST_EXPO", start=0.65, description="curve of thrust over command: 0 linear, 1 square"),
        Parameter("MOT_SPIN_ARM", start=0.10, description="command of idling motors"),
        Parameter("MOT_SPIN_MIN", start=0.15, description="command of least thrust"),
        Parameter("MOT_SPIN_MAX", start=0.95, description="command of full thrust"),
        Parameter("MOT_SPOOL_TIME", unit="s", start=0.5, description="from idling to flying"),
        Output("motor", shape=MAX_MOTORS, unit="1", description="actuator commands, 0 (stopped) to 1 (full)"),
        PacketOutput("mavlink_tx", capacity=4096, description="telemetry and answers"),
        Output("mode", type=CopterMode, start=CopterMode.STABILIZE, description="flight mode"),
        Output("armed", type=bool, description="motors may run"),
        Output("on_ground", type=bool, start=True, description="landed, as the land detector sees it"),
        Output("target", shape=3, unit="m", description="position it flies to, NED from the local origin"),
        Output("desired_position", shape=3, unit="m", description="of the shaped path, NED"),
        Output("desired_velocity", shape=3, unit="m/s", description="of the shaped path, NED"),
        State("throttle", description="share of full thrust before tilt compensation"),
        State("hover", description="hover throttle, as learnt so far"),
        Memory("desired_acceleration", shape=3),
        Memory("target_velocity", shape=3),
        Memory("target_acceleration", shape=3),
        Memory("target_time"),
        Memory("guided", dtype="i4"),
        Memory("rtl_state", dtype="i4"),
        Memory("home", shape=3),
        Memory("home_set", dtype="?"),
        Memory("yaw_fixed", dtype="?"),
        Memory("wanted_yaw"),
        Memory("yaw_target"),
        Memory("lean_n"),
        Memory("lean_e"),
        Memory("lean_limited", dtype="?"),
        Memory("velocity_error", shape=3),
        Memory("velocity_d", shape=3),
        Memory("velocity_i", shape=3),
        Memory("acceleration_error"),
        Memory("throttle_i"),
        Memory("throttle_upper", dtype="?"),
        Memory("throttle_lower", dtype="?"),
        Memory("attitude_target", shape=4),
        Memory("rate_target", shape=3),
        Memory("rate_filtered", shape=3),
        Memory("rate_error", shape=3),
        Memory("rate_d", shape=3),
        Memory("rate_i", shape=3),
        Memory("yaw_error"),
        Memory("motors", dtype="i4"),
        Memory("factor", shape=(8, 3)),
        Memory("thrust", shape=8),
        Memory("mixer_limited", dtype="i4", shape=3),
        Memory("armed_for"),
        Memory("idle"),
        Memory("opened"),
        Memory("idle_for"),
        Memory("landed_for"),
        Memory("said_disarming", dtype="?"),
        Memory("payload", dtype="u1", shape=255),
        Memory("received", dtype="u1", shape=255),
        Memory("sequence", dtype="i4"),
        Memory("peer_version", dtype="i4"),
        Memory("told_mode", dtype="i4"),
        Memory("told_armed", dtype="?"),
        Memory("stream_interval", shape=9),
        Memory("stream_due", shape=9),
    )
    kernels = (start, advance)
    errors = {1: "the airframe is none that this autopilot has a mixer for (quad_x, hexa_x, octa_x)"}  # noqa: RUF012

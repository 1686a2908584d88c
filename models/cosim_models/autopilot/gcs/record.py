"""Ports, parameters and memory that the small autopilots share; no computation.

They have the ports of `Autopilot`, except those of ground stations and cables: they have one link, on board and by
radio. Positions and velocities are NED, as the inputs are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import cast

import numpy as np

from cosim import Memory, Output, PacketInput, PacketOutput, Parameter, Variable
from cosim.vehicle import MAX_MOTORS, Airframe, inputs_for
from cosim.verdict import Role
from cosim_models.autopilot.gcs.rebooting import REBOOT_MEMORY
from cosim_models.autopilot.gcs.rows import ROWS
from cosim_models.autopilot.gcs.sticks import STICK_MEMORY
from cosim_models.autopilot.gcs.switches import SWITCH_MEMORY

__all__ = [
    "ACCELERATION",
    "HOLD",
    "MAX_MISSION",
    "MISSION",
    "POSITION",
    "POSITION_VELOCITY",
    "VELOCITY",
    "angle",
    "pilot_variables",
    "real",
    "whole",
]

HOLD, POSITION, VELOCITY, ACCELERATION, POSITION_VELOCITY = (cast(int, np.int64(i)) for i in range(5))
"""What GUIDED follows, `guided_kind`."""
MAX_MISSION = 32
_ITEM = 9  # command, frame, four parameters, latitude and longitude in degE7, height


def real(name: str, unit: str, start: float, description: str, minimum: float = 0.0) -> Variable:
    """Declares a parameter with ArduPilot's name."""
    return Parameter(name, unit=unit, start=start, minimum=minimum, tunable=True, description=description)


def angle(name: str, start: float, description: str) -> Variable:
    """Declares a parameter in degrees, as ArduPilot has them."""
    return Parameter(name, unit="deg", start=start, minimum=0.0, maximum=180.0, tunable=True, description=description)


def whole(name: str, start: int, description: str) -> Variable:
    """Declares an Integer parameter with ArduPilot's name."""
    return Parameter(name, type=int, start=start, minimum=0, tunable=True, description=description)


def pilot_variables(
    airframes: Sequence[Airframe], mode: IntEnum, parameters: Sequence[Variable], memory: Sequence[Variable] = ()
) -> tuple[Variable, ...]:
    """Returns the variables of an autopilot.

    Args:
        airframes: kinds of vehicles that it flies; the first one is the start value of the input.
        mode: the mode in which it starts.
        parameters: its own, by ArduPilot's names.
        memory: its own.
    """
    return (
        *inputs_for(*airframes),
        PacketInput("mavlink_rx", capacity=2048, description="packets received on board and by radio"),
        Parameter(
            "SYSID_THISMAV",
            type=int,
            start=1,
            minimum=1,
            maximum=255,
            verdict=Role.SYSTEM_ID,
            description="MAVLink system id",
        ),
        *parameters,
        Parameter("estimate_ready_time", unit="s", start=2.0, minimum=0.0, description="from when on it can be armed"),
        Parameter("origin_latitude", unit="rad", start=math.radians(-35.363262), description="of the local origin"),
        Parameter("origin_longitude", unit="rad", start=math.radians(149.165237), description="of the local origin"),
        Parameter("origin_altitude", unit="m", start=584.0, description="of the local origin above mean sea level"),
        Output("motor", shape=MAX_MOTORS, unit="1", start=0.0, description="commands, see cosim.vehicle.Airframe"),
        Output("armed", type=bool, start=False, verdict=Role.ARMED, description="whether the motors may turn"),
        Output("mode", type=type(mode), start=mode, description="mode, by the number of ArduPilot's firmware"),
        Output("on_ground", type=bool, start=True, description="it takes itself to be on the ground"),
        Output("target", shape=3, unit="m", start=0.0, description="destination, NED from the local origin"),
        Output("desired_position", shape=3, unit="m", start=0.0, description="as target, which has no path before it"),
        Output("desired_velocity", shape=3, unit="m/s", start=0.0, description="velocity that it demands, NED"),
        PacketOutput("mavlink_tx", capacity=1024, description="packets sent on board and by radio"),
        *_MEMORY,
        *memory,
    )


_MEMORY = (
    Memory("home", shape=3),  # m, NED: place of arming, or that of DO_SET_HOME
    Memory("home_set", dtype="?"),  # by DO_SET_HOME
    Memory("ground_down"),  # m, where it was armed
    Memory("armed_at"),  # s
    Memory("guided_kind", dtype="i4"),
    Memory("guided_position", shape=3),  # m, NED
    Memory("guided_velocity", shape=3),  # m/s, NED
    Memory("guided_acceleration", shape=3),  # m/s2, NED
    Memory("guided_time"),  # s, of the last velocity or acceleration
    Memory("cruise"),  # m/s, of DO_CHANGE_SPEED; 0: as the parameter says
    Memory("taking_off", dtype="?"),
    Memory("autonomous", dtype="?"),  # the mode is not flown by a pilot
    Memory("kind", dtype="i4"),  # MAV_TYPE
    Memory("vtol_state", dtype="i4"),  # MAV_VTOL_STATE
    Memory("lifts", dtype="?"),  # it has motors that lift beside its wings
    Memory("mission_count", dtype="i4"),  # with home, item 0
    Memory("mission_current", dtype="i4"),
    Memory("mission_done", dtype="?"),
    Memory("mission_active", dtype="?"),  # the mode is AUTO
    Memory("next_due"),  # s, of the earliest stream
    Memory("told_armed", dtype="?"),
    Memory("told_mode", dtype="i4"),
    Memory("sequence", dtype="i4"),
    Memory("version", dtype="i4"),  # of MAVLink, as last received
    Memory("listed", dtype="i4"),  # next parameter of the list in progress; -1: none
    Memory("interval", shape=ROWS, rare=True),  # s, 0: not sent
    Memory("due", shape=ROWS, rare=True),  # s
    Memory("servo", dtype="i4", shape=32, rare=True),  # us, of outputs without a function; 0: off
    Memory("relay_on", dtype="?", rare=True),
    Memory("repeat_left", dtype="i4", rare=True),  # changes of DO_REPEAT_SERVO or DO_REPEAT_RELAY
    Memory("repeat_number", dtype="i4", rare=True),  # output, from 1; 0: the relay
    Memory("repeat_pulse", dtype="i4", rare=True),  # us
    Memory("repeat_every", rare=True),  # s
    Memory("repeat_at", rare=True),  # s
    Memory("modes_asked", dtype="?", rare=True),  # AVAILABLE_MODES
    Memory("mode_asked", dtype="i4", rare=True),  # index, 0: one after the other
    Memory("mode_told", dtype="i4", rare=True),
    Memory("logs_told", dtype="?", rare=True),
    Memory("attitude_asked", shape=4, rare=True),  # rad: roll, pitch, heading of the rotors; their thrust, 0: they rest
    Memory("test_motor", dtype="i4", rare=True),  # place of the motor that a test turns, from 1; 0: none
    Memory("test_command", rare=True),  # 0 to 1; of rovers the parameter of the command
    Memory("test_kind", dtype="i4", rare=True),  # MOTOR_TEST_THROTTLE_TYPE, of rovers
    Memory("test_time", rare=True),  # s, of each motor
    Memory("test_count", dtype="i4", rare=True),
    Memory("test_since", rare=True),  # s
    Memory("battery_voltage", rare=True),  # V, 0: nothing measures it
    Memory("battery_current", rare=True),  # A
    Memory("battery_used", rare=True),  # mAh
    Memory("battery_left", rare=True),  # %
    Memory("battery_alarm", dtype="i4", rare=True),
    Memory("critical", dtype="?", rare=True),  # a fail-safe of a plane is there
    Memory("checks_told", dtype="i4", rare=True),  # how failed checks are told, by `words`
    Memory("checks_passed", dtype="?", rare=True),  # those of a plane before arming
    Memory("gps_silent", dtype="?", rare=True),
    Memory("position_lost", dtype="?", rare=True),
    *STICK_MEMORY,
    *SWITCH_MEMORY,
    *REBOOT_MEMORY,
    Memory("wind_estimate", shape=3, rare=True),  # m/s, NED
    Memory("component_known", dtype="u1", shape=256, rare=True),  # 1: heard from this component of the own system
    Memory("payload", dtype="u1", shape=255, rare=True),
    Memory("received", dtype="u1", shape=255, rare=True),
)

MISSION: tuple[Variable, ...] = (
    Memory("item_since"),  # s, arrival at the current item; -1: not there
    Memory("item_told", dtype="i4"),  # that it has begun; 0: none
    Memory("item_reached", dtype="i4", rare=True),  # and is to be told; 0: none
    Memory("uploading", dtype="?"),
    Memory("upload_count", dtype="i4", rare=True),
    Memory("upload_next", dtype="i4", rare=True),
    Memory("upload_system", dtype="i4", rare=True),
    Memory("upload_component", dtype="i4", rare=True),
    Memory("upload_heard", rare=True),
    Memory("upload_asked", rare=True),
    Memory("mission", shape=(MAX_MISSION, _ITEM), rare=True),
)
"""Memory of an autopilot that flies missions."""

"""The octorotor FMU. The physics is in `multirotor`; the default parameters are those of ArduPilot's own simulation.

Source: libraries/SITL/SIM_Frame.h, SIM_Frame.cpp and SIM_Motor.cpp, frame "octa": mass, arm, greatest thrust and drag
of the default frame, distributed over eight rotors. The numbers and their differences from that simulation are those of
`presets/ardupilot_sitl_quad.ssv`: 3 kg, arms of 0.35 m, hover at 0.39 of 75.4 N, estimated moments of inertia. Motors
are numbered and turn as in ArduPilot's octa X.
"""

from __future__ import annotations

from math import cos, radians, sin

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.vehicles.dynamics.rotor import MotorCurve
from cosim_models.vehicles.multirotor import ERRORS, KERNELS, STEP_SIZE, multirotor_variables, started

__all__ = ["Octorotor"]

_ARM, _ROTORS = 0.35, 8
_ANGLES = (22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5)  # degrees, clockwise from the front


class Octorotor(Model):
    """Octorotor X: rigid body, eight rotors with lag, drag, wind and ground (default: ArduPilot's simulated octa)."""

    step_size = STEP_SIZE
    variables = started(
        multirotor_variables(
            airframe=Airframe.octa_x,
            mass=3.0,
            inertia=(0.02297, 0.02297, 0.0459),
            rotor_x=[_ARM * cos(radians(angle)) for angle in _ANGLES],
            rotor_y=[_ARM * sin(radians(angle)) for angle in _ANGLES],
            rotor_z=(0.0,) * _ROTORS,
            rotor_direction=(-1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0),
            speed_min=0.0,
            speed_max=1000.0,
            thrust_constant=75.4357e-6 / _ROTORS,
            moment_constant=0.0096,
            time_constant_up=0.003,
            time_constant_down=0.003,
            axial_speed_limit=0.0,
            rotor_drag=4.0 * 0.0002898 / _ROTORS,
            rolling_moment=0.0,
        ),
        Airframe.octa_x,
        motor_curve=MotorCurve.thrust,
        command_min=0.15,
        command_max=0.95,
        quadratic_drag=0.1008,
        rotational_damping=(0.001336, 0.001336, 0.00267),
    )
    kernels = KERNELS
    errors = ERRORS

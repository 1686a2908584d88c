"""The hexarotor FMU. Its physics is in `multirotor`; its default numbers are those of the AscTec Firefly.

Source: rotors_description/urdf/firefly.xacro of RotorS (ethz-asl): 1.5 kg body and six rotors of 0.005 kg, arms of
0.215 m every 60 degrees with the hubs 0.037 m above the centre of mass, and the propulsion constants of its six
rotors. The rotors' masses are added to the body's moments of inertia as points. RotorS writes speeds to the motors
directly, so the command is made linear in speed from standstill. Differences: motors are numbered and turn as
ArduPilot's hexa X has them (RotorS's all turn the other way), and the rotor drag coefficient is that of RotorS's
Iris, because the 0.0176 of the file would hold it back with 57 N at 1 m/s.
"""

from __future__ import annotations

from math import sqrt

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.vehicles.multirotor import ERRORS, KERNELS, STEP_SIZE, multirotor_variables

__all__ = ["Hexarotor"]

_ARM = 0.215
_X = _ARM * sqrt(0.75)
_Y = _ARM * 0.5


class Hexarotor(Model):
    """Hexarotor X: rigid body, six rotors with lag, drag, wind and ground (default: AscTec Firefly)."""

    step_size = STEP_SIZE
    variables = multirotor_variables(
        airframe=Airframe.hexa_x,
        mass=1.53,
        inertia=(0.03549, 0.04663, 0.09909),
        rotor_x=(0.0, 0.0, _X, -_X, _X, -_X),
        rotor_y=(_ARM, -_ARM, -_Y, _Y, _Y, -_Y),
        rotor_z=(-0.037, -0.037, -0.037, -0.037, -0.037, -0.037),
        rotor_direction=(-1.0, 1.0, -1.0, 1.0, 1.0, -1.0),
        speed_min=0.0,
        speed_max=838.0,
        thrust_constant=8.54858e-6,
        moment_constant=0.016,
        time_constant_up=0.025,
        time_constant_down=0.025,
        axial_speed_limit=0.0,
        rotor_drag=8.06428e-5,
        rolling_moment=1e-6,
    )
    kernels = KERNELS
    errors = ERRORS

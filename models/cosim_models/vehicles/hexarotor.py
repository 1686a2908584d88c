"""The hexarotor FMU. The physics is in `multirotor`; the default parameters are those of the AscTec Firefly.

Source: rotors_description/urdf/firefly.xacro of RotorS (ethz-asl): 1.5 kg body and six rotors of 0.005 kg, arms of
0.215 m every 60 degrees with the hubs 0.037 m above the centre of mass, and the propulsion constants of its six rotors.
The rotors are added to the body's moments of inertia as point masses. RotorS sends speeds directly to the motors, so
the command is linear in speed, from standstill. Differences: motors are numbered and turn as in ArduPilot's hexa X
(RotorS's all turn the other way), and the rotor drag coefficient is that of RotorS's Iris, because the file's 0.0176
would cause a drag of 57 N at 1 m/s.
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

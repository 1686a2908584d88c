"""The quadrotor FMU. The physics is in `multirotor`; the default parameters are those of PX4's simulated 3DR Iris.

Source: models/iris/iris.sdf.jinja of PX4-SITL_gazebo-classic. The links of that model are combined into one body: 1.5
kg base, 0.015 kg IMU, 0.01 kg GPS and four rotors of 0.005 kg give 1.545 kg; the moments of inertia are the sum of the
base's, the rotors' own and those of their arms. The feet are our addition: the original model stands on a box.
"""

from __future__ import annotations

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.vehicles.multirotor import ERRORS, KERNELS, STEP_SIZE, multirotor_variables

__all__ = ["Quadrotor"]


class Quadrotor(Model):
    """Quadrotor X: rigid body, four rotors with lag, drag, wind and ground (default: PX4 Iris)."""

    step_size = STEP_SIZE
    variables = multirotor_variables(
        airframe=Airframe.quad_x,
        mass=1.545,
        inertia=(0.03002, 0.03057, 0.05754),
        rotor_x=(0.13, -0.13, 0.13, -0.13),
        rotor_y=(0.22, -0.20, -0.22, 0.20),
        rotor_z=(-0.023, -0.023, -0.023, -0.023),
        rotor_direction=(1.0, 1.0, -1.0, -1.0),
        speed_min=100.0,
        speed_max=1100.0,
        thrust_constant=5.84e-6,
        moment_constant=0.06,
        time_constant_up=0.0125,
        time_constant_down=0.025,
        axial_speed_limit=25.0,
        rotor_drag=1.75e-4,
        rolling_moment=1e-6,
    )
    kernels = KERNELS
    errors = ERRORS

"""Quadrotor and Hexarotor against closed forms, invariants and a second model in rotation matrices."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim import Model
from cosim.frames import quaternion_from_euler
from cosim.vehicle import VEHICLE_INPUTS, VEHICLE_OUTPUTS, Airframe
from cosim_models.autopilot.control.mixer import motor_factors
from cosim_models.vehicles.dynamics.rotor import MotorCurve
from cosim_models.vehicles.hexarotor import Hexarotor
from cosim_models.vehicles.multirotor import multirotor_variables
from cosim_models.vehicles.octorotor import Octorotor
from cosim_models.vehicles.quadrotor import Quadrotor
from cosim_models.vehicles.y6 import Y6
from tests.models.shipped_kernels import kernels, part

G = 9.80665
H = 0.0025
VEHICLES = [Quadrotor, Hexarotor]


def vehicle(model: type[Model] = Quadrotor, down: float = -1000.0, **parameters: Any) -> Any:
    """A started record, `-down` metres above the ground, with some parameters changed."""
    m = model.record()
    m.position_start[2] = down
    for name, value in parameters.items():
        m[name] = value
    assert kernels(model)[0](m) == 0
    return m


def run(m: Any, seconds: float, h: float = H, model: type[Model] = Quadrotor) -> Any:
    steps = round(seconds / h)
    for k in range(steps):
        assert kernels(model)[1](m, k * h, h) == 0
    return m


def without_air(**more: Any) -> dict[str, Any]:
    """Parameters that switch every force of the air off but static thrust."""
    return {"axial_speed_limit": 0.0, "rotor_drag": 0.0, "rolling_moment": 0.0, **more}


def matrix(q: Any) -> np.ndarray:
    """Rotation matrix of a quaternion by Rodrigues' formula, not by the formula of the model."""
    w, v = float(q[0]), np.asarray(q[1:], dtype=float)
    angle = 2.0 * math.atan2(float(np.linalg.norm(v)), w)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = v / np.linalg.norm(v)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def hover_speed(m: Any) -> float:
    return math.sqrt(float(m.mass) * G / (int(m.rotor_count) * float(m.thrust_constant)))


def hovering(model: type[Model] = Quadrotor, **parameters: Any) -> Any:
    """In the air, rotors at hover speed and commanded to stay there."""
    m = vehicle(model, **parameters)
    speed = hover_speed(m)
    n = int(m.rotor_count)
    m.rotor_speed[:n] = speed
    m.motor[:n] = (speed - m.speed_min) / (m.speed_max - m.speed_min)
    return m


# ---- translation -------------------------------------------------------------------------------------------------


def test_free_fall() -> None:
    m = run(vehicle(), 4.0)
    assert m.position[2] == pytest.approx(-1000.0 + 0.5 * G * 16.0, abs=1e-9)
    assert m.velocity[2] == pytest.approx(4.0 * G, abs=1e-10)
    assert np.array_equal(m.specific_force, np.zeros(3))
    assert not m.on_ground


def test_the_iris_hovers_at_805_radians_per_second() -> None:
    m = hovering()
    assert hover_speed(m) == pytest.approx(805.0, abs=0.5)
    assert m.motor[0] == pytest.approx(0.705, abs=5e-4)
    run(m, 10.0)
    assert np.allclose(m.position, [0.0, 0.0, -1000.0], atol=1e-9)
    assert np.allclose(m.specific_force, [0.0, 0.0, -G], atol=1e-9)
    assert m.attitude[0] == pytest.approx(1.0, abs=1e-4)  # its arms are not symmetric: it pitches, very slowly


@pytest.mark.parametrize("model", VEHICLES)
def test_thrust_over_weight(model: type[Model]) -> None:
    m = vehicle(model)
    ratio = (float(m.speed_max) / hover_speed(m)) ** 2
    assert ratio == pytest.approx({Quadrotor: 1.87, Hexarotor: 2.40}[model], abs=0.01)


def test_terminal_speed_with_linear_drag() -> None:
    m = vehicle(linear_drag=0.8)
    speed = m.mass * G / 0.8
    time_constant = m.mass / 0.8
    run(m, 3.0)
    assert m.velocity[2] == pytest.approx(speed * (1.0 - math.exp(-3.0 / time_constant)), rel=1e-9)


def test_terminal_speed_with_quadratic_drag() -> None:
    m = vehicle(quadratic_drag=0.05)
    speed = math.sqrt(m.mass * G / 0.05)
    run(m, 1.5)
    assert m.velocity[2] == pytest.approx(speed * math.tanh(G * 1.5 / speed), rel=1e-9)
    run(m, 15.0)
    assert m.velocity[2] == pytest.approx(speed, rel=1e-6)


def test_terminal_speed_with_drag_by_axis() -> None:
    """Rolled by 45 degrees, each of two axes has half of the squared speed, and its force is at 45 degrees."""
    m = vehicle(quadratic_drag=0.05, drag_by_axis=True)
    m.attitude[:] = (math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0, 0.0)
    speed = math.sqrt(math.sqrt(2.0) * m.mass * G / 0.05)
    run(m, 1.5)
    assert m.velocity[2] == pytest.approx(speed * math.tanh(G * 1.5 / speed), rel=1e-9)
    assert m.velocity[:2] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_rotor_drag_along_the_axis_with_drag_by_axis() -> None:
    """m dv/dt = -k v, k being rotor_drag times the sum of the rotor speeds: the climb decays."""
    m = hovering(rotor_drag=2e-4, drag_by_axis=True, axial_speed_limit=0.0, rolling_moment=0.0)
    k = 2e-4 * float(np.sum(m.rotor_speed[: int(m.rotor_count)]))
    m.velocity[2] = -4.0
    run(m, 1.0)
    assert m.velocity[2] == pytest.approx(-4.0 * math.exp(-k / m.mass), rel=1e-7)
    m = hovering(rotor_drag=2e-4, axial_speed_limit=0.0, rolling_moment=0.0)
    m.velocity[2] = -4.0
    run(m, 1.0)
    assert m.velocity[2] == pytest.approx(-4.0, rel=1e-9)


def test_a_climb_loses_the_thrust_of_the_inflow_and_a_descent_none() -> None:
    """m dv/dt = -k v^2 with k of all rotors together, climbing: 1/v grows with k t/m; a descent does not change."""
    k, still = (
        0.06,
        {"rotor_drag": 0.0, "axial_speed_limit": 0.0, "rolling_moment": 0.0, "rotor_x": 0.0, "rotor_y": 0.0},
    )
    for begin, end in ((-4.0, -1.0 / (0.25 + k / 1.5)), (4.0, 4.0)):
        m = hovering(inflow_loss=k / 4.0, drag_by_axis=True, mass=1.5, **still)
        m.velocity[2] = begin
        run(m, 1.0)
        assert m.velocity[2] == pytest.approx(end, rel=1e-7)


def test_the_inflow_turns_a_vehicle_that_rolls_in_a_climb() -> None:
    """The rotor that rises faster loses more: 2 loss v p y each, times y a moment against the roll p."""
    still = {"rotor_drag": 0.0, "axial_speed_limit": 0.0, "rolling_moment": 0.0, "rotational_damping": 0.0}
    m = hovering(inflow_loss=0.015, drag_by_axis=True, **still)
    m.rotor_x[:4], m.rotor_y[:4] = (0.2, -0.2, 0.2, -0.2), (0.2, -0.2, -0.2, 0.2)
    m.velocity[2], m.angular_velocity[0] = -5.0, 0.1
    run(m, 0.0025)
    fall = 4.0 * 2.0 * 0.015 * 5.0 * 0.1 * 0.2**2 / float(m.inertia[0])
    assert (0.1 - m.angular_velocity[0]) / 0.0025 == pytest.approx(fall, rel=0.05)


def test_thrust_falls_linearly_with_axial_speed() -> None:
    """m dv/dt = m g (1 - (1 - |v| / 25)) has the solution v0 exp(g t / 25): climbing, the hover thrust is short."""
    m = hovering(rotor_drag=0.0, rolling_moment=0.0, rotor_x=0.0, rotor_y=0.0)
    m.velocity[2] = -4.0
    run(m, 2.0)
    assert m.velocity[2] == pytest.approx(-4.0 * math.exp(-G * 2.0 / 25.0), rel=1e-8)
    m.velocity[2] = -30.0
    run(m, H)
    assert m.specific_force[2] == 0.0


def test_only_the_velocity_in_the_air_matters() -> None:
    wind = np.array([4.0, -7.0, 1.5])
    still = hovering(linear_drag=0.3, quadratic_drag=0.02)
    blown = hovering(linear_drag=0.3, quadratic_drag=0.02, wind=wind)
    still.velocity[:] = (3.0, 2.0, -1.0)
    blown.velocity[:] = still.velocity + wind
    run(still, 2.0)
    run(blown, 2.0)
    assert np.allclose(blown.velocity - wind, still.velocity, atol=1e-10)
    assert np.allclose(blown.position - 2.0 * wind, still.position, atol=1e-9)
    assert np.allclose(blown.attitude, still.attitude, atol=1e-12)


# ---- rotation ----------------------------------------------------------------------------------------------------


def test_torque_free_symmetric_top() -> None:
    """The rates turn about the body's axis, the body turns about its angular momentum: both in closed form."""
    a, c = 0.03, 0.0575
    m = vehicle(inertia=(a, a, c))
    rates = np.array([1.0, 0.5, 3.0])
    m.angular_velocity[:] = rates
    seconds = 5.0
    run(m, seconds)
    nutation = (c - a) / a * rates[2] * seconds
    turned = np.array(
        [
            rates[0] * math.cos(nutation) - rates[1] * math.sin(nutation),
            rates[0] * math.sin(nutation) + rates[1] * math.cos(nutation),
            rates[2],
        ]
    )
    assert np.allclose(m.angular_velocity, turned, atol=1e-7)
    momentum = np.array([a, a, c]) * rates
    angle = float(np.linalg.norm(momentum)) / a * seconds
    axis = momentum / np.linalg.norm(momentum)
    precession = matrix([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
    spin = -nutation
    expected = precession @ matrix([math.cos(spin / 2), 0.0, 0.0, math.sin(spin / 2)])
    assert np.allclose(matrix(m.attitude), expected, atol=1e-7)


def test_torque_free_asymmetric_top_keeps_energy_and_angular_momentum() -> None:
    inertia = np.array([0.02, 0.03, 0.05])
    m = vehicle(inertia=inertia)
    m.angular_velocity[:] = (0.01, 6.0, 0.02)  # about the middle axis: unstable, it tumbles
    energy = float(inertia @ m.angular_velocity**2)
    momentum = inertia * m.angular_velocity
    tumbled = 0.0
    for _ in range(50):
        run(m, 0.1)
        tumbled = min(tumbled, float(m.angular_velocity[1]))
        assert float(inertia @ m.angular_velocity**2) == pytest.approx(energy, rel=1e-7)
        assert np.allclose(matrix(m.attitude) @ (inertia * m.angular_velocity), momentum, atol=1e-8)
        assert float(np.linalg.norm(m.attitude)) == pytest.approx(1.0, abs=1e-14)
    assert tumbled < -5.0


def test_spinning_up_rotors_conserves_angular_momentum() -> None:
    """Without air the body must turn against its rotors so that the sum stays zero, and their axis precesses."""
    m = vehicle(thrust_constant=0.0, rotor_inertia=2e-4, substep=H / 8, **without_air())
    m.motor[:4] = (0.9, 0.5, 0.2, 0.0)
    inertia = np.array(m.inertia)
    m.angular_velocity[:] = (0.4, -0.3, 0.1)
    before = inertia * m.angular_velocity
    for _ in range(20):
        run(m, 0.05)
        rotors = -2e-4 * float(m.rotor_direction @ m.rotor_speed)
        total = matrix(m.attitude) @ (inertia * m.angular_velocity + [0.0, 0.0, rotors])
        assert np.allclose(total, before, atol=1e-8)
    assert m.angular_velocity[2] > 1.0


def test_rotational_damping() -> None:
    m = vehicle(rotational_damping=(0.02, 0.03, 0.04))
    m.angular_velocity[2] = 2.0
    run(m, 1.0)
    assert m.angular_velocity[2] == pytest.approx(2.0 * math.exp(-0.04 / m.inertia[2]), rel=1e-9)


QUAD_X = ((45, 1), (-135, 1), (-45, -1), (135, -1))
HEXA_X = ((90, -1), (-90, 1), (-30, -1), (150, 1), (30, 1), (-150, -1))
"""ArduPilot's motors: angle from the nose, clockwise [deg], and +1 for counter-clockwise rotors (AP_MotorsMatrix)."""


@pytest.mark.parametrize(("model", "table"), [(Quadrotor, QUAD_X), (Hexarotor, HEXA_X)])
def test_each_motor_turns_the_body_as_ardupilot_expects(model: type[Model], table: tuple[tuple[int, int], ...]) -> None:
    for i, (angle, yaw) in enumerate(table):
        m = hovering(model)
        assert int(m.rotor_count) == len(table)
        m.motor[i] += 0.05
        run(m, 0.02, model=model)
        roll, pitch = -math.sin(math.radians(angle)), math.cos(math.radians(angle))
        assert m.angular_velocity[0] * roll > 0.0
        assert m.angular_velocity[1] * pitch > 0.0 or abs(pitch) < 1e-9
        assert m.angular_velocity[2] * yaw > 0.0
        assert m.velocity[2] < 0.0


def test_counter_clockwise_rotors_turn_the_nose_clockwise() -> None:
    m = hovering()
    m.motor[:4] += np.array([0.02, 0.02, -0.02, -0.02])
    run(m, 0.5)
    heading = math.atan2(matrix(m.attitude)[1, 0], matrix(m.attitude)[0, 0])
    assert 0.05 < heading < math.pi


def test_hexarotor_arms_are_60_degrees_apart() -> None:
    m = Hexarotor.record()
    angles = np.sort(np.degrees(np.arctan2(m.rotor_y[:6], m.rotor_x[:6])))
    assert np.allclose(np.diff(angles), 60.0)
    assert np.allclose(np.hypot(m.rotor_x[:6], m.rotor_y[:6]), 0.215)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2.0, -2.5])
def test_initial_heading(heading: float) -> None:
    """Clockwise from north: at 90 degrees the nose points east."""
    m = vehicle(yaw_start=heading)
    assert np.allclose(matrix(m.attitude)[:, 0], [math.cos(heading), math.sin(heading), 0.0], atol=1e-12)
    assert np.allclose(matrix(m.attitude)[:, 2], [0.0, 0.0, 1.0], atol=1e-12)


def test_airframes() -> None:
    assert vehicle(Quadrotor).airframe == Airframe.quad_x
    assert vehicle(Hexarotor).airframe == Airframe.hexa_x
    assert vehicle(Octorotor).airframe == Airframe.octa_x
    assert vehicle(Y6).airframe == Airframe.y6


@pytest.mark.parametrize("model", [Octorotor, Y6])
def test_the_mixer_turns_octorotor_and_y6_where_it_should(model: type[Model]) -> None:
    """A torque about each axis, as the autopilot's mixer distributes it, turns the vehicle about that axis alone."""
    table = np.zeros((8, 3))
    count = motor_factors(int(vehicle(model).airframe), table)
    for axis in range(3):
        m = vehicle(model)
        assert m.rotor_count == count
        m.motor[:count] = 0.6 + 0.01 * table[:count, axis]  # a little: thrust is the square of a rotor's speed
        run(m, 0.05)
        turn = [float(x) for x in m.angular_velocity]
        assert turn[axis] > 5e-4
        assert [turn[i] for i in range(3) if i != axis] == pytest.approx([0.0, 0.0], abs=0.01 * turn[axis] + 1e-6)


def test_y6_has_the_arms_of_the_hexarotor() -> None:
    m = vehicle(Y6)
    assert np.allclose(np.hypot(m.rotor_x[:6], m.rotor_y[:6]), 0.215)
    assert np.allclose(m.rotor_x[0:6:2], m.rotor_x[1:6:2]) and np.allclose(m.rotor_y[0:6:2], m.rotor_y[1:6:2])
    assert m.inertia.tolist() == vehicle(Hexarotor).inertia.tolist()


def test_the_octorotor_hovers_at_39_percent_of_its_thrust() -> None:
    m = vehicle(Octorotor)
    assert 8.0 * m.thrust_constant * m.speed_max**2 * 0.39 == pytest.approx(3.0 * 9.80665, rel=1e-4)


# ---- rotors ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [1e-4, 1e-3, 0.0025, 0.03, 0.25, 1.0])
def test_the_lag_is_exact_for_any_step(h: float) -> None:
    m = vehicle()
    m.motor[:4] = 0.5
    run(m, 1.0 if h == 1.0 else math.ceil(0.03 / h) * h, h=h)
    up = 1.0 if h == 1.0 else math.ceil(0.03 / h) * h
    reached = 600.0 * (1.0 - math.exp(-up / 0.0125))
    assert m.rotor_speed[0] == pytest.approx(reached, rel=1e-12)
    m.motor[:4] = 0.0
    run(m, h, h=h)
    assert m.rotor_speed[0] == pytest.approx(reached * math.exp(-h / 0.025), rel=1e-12)


@pytest.mark.parametrize("h", [1e-4, 0.0025, 0.25])
def test_the_thrust_curve_lags_thrust(h: float) -> None:
    m = vehicle(
        motor_curve=MotorCurve.thrust,
        command_min=0.15,
        command_max=0.95,
        thrust_expo=0.65,
        time_constant_up=0.03,
        time_constant_down=0.03,
    )
    m.motor[:4] = 0.55
    run(m, math.ceil(0.06 / h) * h, h=h)
    seconds = math.ceil(0.06 / h) * h
    thrust = m.thrust_constant * m.rotor_speed[0] ** 2
    greatest = m.thrust_constant * m.speed_max**2
    part = 0.35 * 0.5 + 0.65 * 0.25
    assert thrust == pytest.approx(greatest * part * (1.0 - math.exp(-seconds / 0.03)), rel=1e-12)
    m.motor[:4] = 1.0
    run(m, 2.0)
    assert m.rotor_speed[0] == pytest.approx(m.speed_max, rel=1e-12)


@pytest.mark.parametrize("curve", list(MotorCurve))
def test_no_lag_when_the_time_constant_is_zero(curve: MotorCurve) -> None:
    m = vehicle(motor_curve=curve, time_constant_up=0.0, time_constant_down=0.0, rotor_inertia=1e-5)
    m.motor[:4] = 1.0
    run(m, H)
    assert np.allclose(m.rotor_speed[:4], m.speed_max)
    m.motor[:4] = 0.0
    run(m, H)
    assert np.array_equal(m.rotor_speed, np.zeros(8))


@given(command=st.floats(-1.0, 2.0))
@settings(max_examples=50, deadline=None)
def test_steady_speed_follows_the_command(command: float) -> None:
    m = vehicle()
    m.motor[:4] = command
    run(m, 1.0, h=0.5)
    expected = 0.0 if command <= 0.0 else 100.0 + 1000.0 * min(command, 1.0)
    assert np.allclose(m.rotor_speed[:4], expected, rtol=1e-12)
    assert np.array_equal(m.rotor_speed[4:], np.zeros(4))


# ---- integration -------------------------------------------------------------------------------------------------


def manoeuvre(substep: float, seconds: float = 0.8) -> np.ndarray:
    """A smooth flight with every force on; constant commands, so that the rotors' lag is smooth too."""
    m = hovering(linear_drag=0.2, quadratic_drag=0.03, rotor_inertia=5e-5, rotational_damping=0.01, substep=substep)
    m.wind[:] = (3.0, -2.0, 0.5)
    m.velocity[:] = (2.0, 1.0, -3.0)
    m.angular_velocity[:] = (2.0, -1.5, 3.0)
    m.motor[:4] += np.array([0.03, -0.02, 0.01, -0.01])
    run(m, seconds, h=0.04)
    return np.concatenate([m.position, m.velocity, m.attitude, m.angular_velocity])


def test_kuttas_method_is_of_order_three() -> None:
    reference = manoeuvre(0.04 / 512)
    errors = [float(np.linalg.norm(manoeuvre(0.04 / n) - reference)) for n in (8, 16, 32)]
    orders = [math.log2(errors[i] / errors[i + 1]) for i in range(2)]
    assert all(2.9 < order < 3.1 for order in orders), orders
    assert errors[1] < 1e-7  # with sub-steps of 2.5 ms, in m, m/s and rad/s together


def test_the_communication_step_is_split_into_equal_substeps() -> None:
    whole, parts = hovering(), hovering()
    for m in (whole, parts):
        m.motor[:4] += np.array([0.03, -0.02, 0.01, -0.01])
    run(whole, 0.4, h=0.004)  # two sub-steps of 2 ms
    run(parts, 0.4, h=0.002)
    assert np.array_equal(whole.position, parts.position)
    assert np.array_equal(whole.attitude, parts.attitude)
    almost = hovering()
    assert kernels(Quadrotor)[1](almost, 0.0, H * (1.0 + 1e-9)) == 0
    assert almost.decay_step == pytest.approx(H, rel=1e-8)  # one sub-step, not two


def reference_derivative(m: Any, speeds: np.ndarray, slew: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The second model: vectors, cross products and a rotation matrix as state, written from the sources' formulas."""
    velocity, rotation, rates = y[3:6], y[6:15].reshape(3, 3), y[15:18]
    air = rotation.T @ (velocity - m.wind)
    force = -(m.linear_drag + m.quadratic_drag * np.linalg.norm(air)) * air
    torque = -np.array(m.rotational_damping) * rates
    down = np.array([0.0, 0.0, 1.0])
    n = int(m.rotor_count)
    hubs = np.stack([m.rotor_x[:n], m.rotor_y[:n], m.rotor_z[:n]], axis=1)
    v = air + np.cross(rates, hubs)
    across = v - np.outer(v @ down, down)
    thrusts = m.thrust_constant * speeds**2
    pushes = -thrusts * np.maximum(0.0, 1.0 - np.abs(v @ down) / m.axial_speed_limit)
    f = np.outer(pushes, down) - (speeds * m.rotor_drag)[:, None] * across
    force = force + f.sum(axis=0)
    turning = m.rotor_direction[:n]
    torque = torque + np.cross(hubs, f).sum(axis=0) + turning @ (m.moment_constant * thrusts) * down
    torque = torque - (turning * speeds * m.rolling_moment) @ across
    torque = torque + turning @ (m.rotor_inertia * slew) * down
    spin = -(turning @ (m.rotor_inertia * speeds)) * down
    inertia = np.diag(m.inertia)
    p, q, r = rates
    skew = np.array([[0.0, -r, q], [r, 0.0, -p], [-q, p, 0.0]])
    turn = np.linalg.solve(inertia, torque - np.cross(rates, inertia @ rates + spin))
    fall = rotation @ force / m.mass + np.array([0.0, 0.0, G])
    return np.concatenate([velocity, fall, (rotation @ skew).ravel(), turn])


@pytest.mark.parametrize("model", VEHICLES)
def test_against_a_second_model_in_rotation_matrices(model: type[Model]) -> None:
    m = hovering(
        model,
        linear_drag=0.2,
        quadratic_drag=0.03,
        rotor_inertia=5e-5,
        rotational_damping=0.01,
        axial_speed_limit=25.0,
        substep=0.0005,
    )
    m.wind[:] = (3.0, -2.0, 0.5)
    m.velocity[:] = (2.0, 1.0, -3.0)
    m.angular_velocity[:] = (1.0, -1.5, 2.0)
    n = int(m.rotor_count)
    m.motor[:n] += 0.02 * np.cos(np.arange(n))
    begin = np.array(m.rotor_speed[:n])
    target = m.speed_min + m.motor[:n] * (m.speed_max - m.speed_min)
    lag = np.where(target > begin, m.time_constant_up, m.time_constant_down)
    y = np.concatenate([m.position, m.velocity, np.eye(3).ravel(), m.angular_velocity])
    h, seconds = 0.001, 0.5

    def derivative(t: float, state: np.ndarray) -> np.ndarray:
        speeds = target + (begin - target) * np.exp(-t / lag)
        return reference_derivative(m, speeds, (target - speeds) / lag, state)

    parameters_only = m.copy()
    run(m, seconds, model=model)
    m, ours = parameters_only, m
    for k in range(round(seconds / h)):
        t = k * h
        k1 = derivative(t, y)
        k2 = derivative(t + h / 2, y + h / 2 * k1)
        k3 = derivative(t + h / 2, y + h / 2 * k2)
        k4 = derivative(t + h, y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    assert np.allclose(ours.position, y[0:3], atol=1e-9)
    assert np.allclose(ours.velocity, y[3:6], atol=1e-8)
    assert np.allclose(matrix(ours.attitude), y[6:15].reshape(3, 3), atol=1e-9)
    assert np.allclose(ours.angular_velocity, y[15:18], atol=1e-8)
    specific = y[6:15].reshape(3, 3).T @ (derivative(seconds, y)[3:6] - [0.0, 0.0, G])
    assert np.allclose(ours.specific_force, specific, atol=1e-8)


# ---- ground ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", VEHICLES)
def test_on_the_ground_it_stays_where_it_is(model: type[Model]) -> None:
    m = vehicle(model, down=0.0, yaw_start=0.7)
    assert m.on_ground
    assert np.allclose(m.specific_force, [0.0, 0.0, -G], atol=1e-12)
    attitude = np.array(m.attitude)
    run(m, 60.0, model=model)
    assert m.on_ground
    assert np.allclose(m.position, 0.0, atol=1e-12)
    assert np.allclose(m.velocity, 0.0, atol=1e-12)
    assert np.allclose(m.attitude, attitude, atol=1e-12)
    assert np.allclose(m.specific_force, [0.0, 0.0, -G], atol=1e-12)


def test_ground_at_another_height() -> None:
    m = vehicle(down=5.0, ground_height=5.0)
    run(m, 1.0)
    assert m.position[2] == pytest.approx(5.0, abs=1e-12)
    assert m.on_ground


def test_a_side_wind_does_not_make_it_creep() -> None:
    m = vehicle(down=0.0, linear_drag=0.25, wind=(10.0, 6.0, 0.0))
    run(m, 2.0)
    settled = np.array(m.position)
    assert 0.0 < settled[0] < 0.005
    run(m, 30.0)
    assert np.allclose(m.position, settled, atol=1e-12)
    assert float(np.linalg.norm(m.specific_force)) == pytest.approx(G, abs=1e-9)  # it leans a little


def test_a_strong_wind_moves_it() -> None:
    m = vehicle(down=0.0, linear_drag=0.25, wind=(60.0, 0.0, 0.0), foot_height=0.01)
    run(m, 2.0)
    assert m.position[0] > 1.0


def test_sliding_stops_after_coulombs_distance() -> None:
    m = vehicle(down=0.0, foot_height=0.01, foot_radius=0.5)  # flat: it must not tip
    m.velocity[0] = 2.0
    run(m, 3.0)
    assert m.position[0] == pytest.approx(4.0 / (2.0 * 0.6 * G), rel=0.05)
    assert np.allclose(m.velocity, 0.0, atol=1e-9)
    assert np.allclose(m.position[1:], 0.0, atol=1e-6)


@pytest.mark.parametrize("model", VEHICLES)
@pytest.mark.parametrize(("height", "tilt"), [(0.3, 0.0), (2.0, 0.3), (20.0, 0.5), (3.0, 1.5), (3.0, 3.0)])
def test_dropped_it_comes_to_rest(model: type[Model], height: float, tilt: float) -> None:
    m = vehicle(model, down=-height)
    m.attitude[:] = (math.cos(tilt / 2), 0.8 * math.sin(tilt / 2), 0.6 * math.sin(tilt / 2), 0.0)
    run(m, 15.0, model=model)
    before = np.array(m.position)
    run(m, 1.0, model=model)
    assert np.allclose(m.position, before, atol=1e-9)
    assert np.allclose(m.velocity, 0.0, atol=1e-9)
    assert np.allclose(m.angular_velocity, 0.0, atol=1e-9)
    assert float(np.linalg.norm(m.specific_force)) == pytest.approx(G, abs=1e-6)
    assert m.on_ground
    assert abs(m.position[2]) < 0.15


def test_a_vehicle_that_stands_still_remains_as_it_is_until_something_acts_on_it() -> None:
    """Beside one that is integrated in every step. What stands still has up to 1e-9 m/s and 1e-9 rad/s left."""
    rests, moves = (vehicle(down=-0.0, linear_drag=0.2) for _ in range(2))
    acting = [tuple(part(m, name) for name in ("motor", "wind", "force")) for m in (rests, moves)]
    rests_of_moves = part(moves, "rests")
    passed = [np.empty(9000, m.dtype) for m in (rests, moves)]
    still = []
    for k in range(9000):
        for motor, wind, force in acting:
            motor[:4] = (0.72, 0.71, 0.72, 0.715) if 7200 <= k < 7400 else 0.0
            wind[0] = 8.0 if 800 <= k < 2400 else 0.0
            force[1] = 1.0 if 4000 <= k < 5600 else 0.0
        rests_of_moves[:] = False
        before = rests.tobytes()
        for m, rows in zip((rests, moves), passed, strict=True):
            assert kernels(Quadrotor)[1](m, k * H, H) == 0
            rows[k] = m
        still.append(rests.tobytes() == before)
    for name in ("position", "velocity", "attitude", "angular_velocity", "specific_force"):
        one, other = (rows[name] for rows in passed)
        most = 1e-6 if name == "specific_force" else 2e-9
        assert np.allclose(one, other, rtol=0.0, atol=most), (name, np.argwhere(np.abs(one - other) > most)[:1])
    assert np.array_equal(*(rows["on_ground"] for rows in passed))
    assert still[0]
    for change in (800, 2400, 4000, 5600, 7200):
        assert still[change - 1], change
        assert not any(still[change : change + 100]), change
    assert not any(still[7200:7500])  # it flies and falls
    assert all(still[8500:])


@pytest.mark.parametrize("model", VEHICLES)
def test_rotors_that_turn_or_are_to_turn_never_rest(model: type[Model]) -> None:
    m = vehicle(model, down=0.0)
    n = int(m.rotor_count)
    run(m, 1.0, model=model)
    m.motor[n - 1] = 1e-3
    run(m, H, model=model)
    assert m.rotor_speed[n - 1] > 0.0
    m.motor[n - 1] = 0.0
    before = float(m.rotor_speed[n - 1])
    run(m, H, model=model)
    assert m.rotor_speed[n - 1] < before


def test_take_off_leaves_the_ground() -> None:
    m = vehicle(down=0.0)
    m.motor[:4] = 0.65
    run(m, 1.0)
    assert m.on_ground
    assert -0.005 < m.position[2] < 0.0
    m.motor[:4] = 0.75
    run(m, 1.0)
    assert not m.on_ground
    assert m.position[2] < -0.3
    assert np.allclose(m.position[:2], 0.0, atol=0.01)


# ---- errors, ports, repetition -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("mass", 0.0, 1),
        ("mass", math.nan, 1),
        ("inertia", (0.0, 1.0, 1.0), 1),
        ("rotor_count", 0, 2),
        ("rotor_count", 9, 2),
        ("substep", 0.0, 3),
        ("ground_deflection", 0.0, 3),
        ("command_max", 0.0, 4),
        ("position_start", (0.0, 0.0, 0.1), 5),
    ],
)
def test_impossible_parameters_are_errors(name: str, value: Any, code: int) -> None:
    m = Quadrotor.record()
    m[name] = value
    assert kernels(Quadrotor)[0](m) == code
    assert code in Quadrotor.errors


def test_the_thrust_curve_needs_a_greatest_thrust() -> None:
    m = Quadrotor.record()
    m.motor_curve = MotorCurve.thrust
    m.thrust_constant = 0.0
    assert kernels(Quadrotor)[0](m) == 7


@pytest.mark.parametrize("curve", list(MotorCurve))
@pytest.mark.parametrize(("name", "value"), [("motor", math.nan), ("wind", math.nan), ("wind", math.inf)])
def test_an_input_that_is_no_number_is_an_error(curve: MotorCurve, name: str, value: float) -> None:
    m = vehicle(motor_curve=curve)
    m[name][0] = value
    assert kernels(Quadrotor)[1](m, 0.0, H) == 6


def test_start_may_be_repeated() -> None:
    m = vehicle(down=-3.0, yaw_start=1.0)
    once = m.tobytes()
    assert kernels(Quadrotor)[0](m) == 0
    assert m.tobytes() == once


def test_the_vehicles_can_replace_each_other() -> None:
    def ports(model: type[Model]) -> list[tuple[Any, ...]]:
        return [(v.name, v.role, v.kind, v.shape, v.unit) for v in model.variables]

    assert ports(Quadrotor) == ports(Hexarotor)
    names = [v.name for v in Quadrotor.variables]
    assert all(v.name in names for v in (*VEHICLE_INPUTS, *VEHICLE_OUTPUTS))


# ---- compiled and interpreted ------------------------------------------------------------------------------------


def histories() -> np.ndarray:
    """Every branch of the kernels, step by step: take-off, flight in wind with both motor curves, crash."""
    rows = []
    for model, curve in ((Quadrotor, MotorCurve.speed), (Hexarotor, MotorCurve.thrust)):
        m = vehicle(model, down=-0.02, motor_curve=curve, rotor_inertia=5e-5, linear_drag=0.1, quadratic_drag=0.02)
        m.wind[:] = (2.0, 1.0, 0.3)
        n = int(m.rotor_count)
        for k in range(60):
            m.motor[:n] = 0.9 + 0.1 * np.cos(np.arange(n) + 0.3 * k) if k < 40 else 0.0
            h = 0.0025 if k % 3 else 0.006
            run(m, h, h=h, model=model)
            rows.append(np.concatenate([m.position, m.velocity, m.attitude, m.angular_velocity, m.specific_force]))
    return np.array(rows)


def test_interpreted_kernels_give_the_same_numbers(tmp_path: Path) -> None:
    path = tmp_path / "interpreted.npy"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run([sys.executable, __file__, str(path)], check=True, env=environment)
    interpreted, compiled = np.load(path), histories()
    assert np.allclose(interpreted, compiled, rtol=1e-12, atol=1e-12)
    assert float(np.abs(compiled[:, 7:10]).max()) > 1e-3


if __name__ == "__main__":
    np.save(sys.argv[1], histories())


@pytest.mark.parametrize("start", [-0.0, -3.0])
@pytest.mark.parametrize("inertia", [0.0, 2e-5])
def test_accelerations_kept_from_the_step_before_change_no_bit(start: float, inertia: float) -> None:
    """Beside a vehicle that always forgets them: take-off, wind and force that come and go, fall to the ground."""
    keeps, forgets = (vehicle(down=start, rotor_inertia=inertia, linear_drag=0.1) for _ in range(2))
    for k in range(600):
        for m in (keeps, forgets):
            m.motor[:4] = (0.72, 0.71, 0.72, 0.715) if k < 200 else 0.2
            m.wind[0] = 3.0 if 50 <= k < 60 else math.sin(0.1 * k) if 300 <= k < 400 else 0.0
            m.added_wind[1] = -2.0 if 70 <= k < 80 else 0.0
            m.force[1] = 1.5 if 100 <= k < 120 else 0.0
            m.thrust_factor = 1.02 if 150 <= k < 160 else 1.0
        forgets.motion_before[:] = math.nan
        for m in (keeps, forgets):
            assert kernels(Quadrotor)[1](m, k * H, H) == 0
        assert keeps.tobytes() == forgets.tobytes(), k
    assert start == -3.0 or keeps.on_ground


# ---- the body of ArduPilot's simulation ------------------------------------------------------------------------------


def test_moments_grow_with_the_command() -> None:
    """Two rotors turn the body one way with command 0.8, two the other way with 0.4: k (sum of c T), c of its range."""
    m = vehicle(
        motor_curve=MotorCurve.thrust, thrust_expo=0.65, command_min=0.0, command_max=1.0, drag_by_axis=True,
        moment_by_command=True, time_constant_up=0.0, time_constant_down=0.0, **without_air(),
    )  # fmt: skip
    most = float(m.thrust_constant) * float(m.speed_max) ** 2
    commands = (0.8, 0.8, 0.4, 0.4)
    m.motor[:4] = commands
    m.rotor_speed[:4] = [float(m.speed_max) * math.sqrt(0.35 * c + 0.65 * c * c) for c in commands]
    run(m, 0.0025)
    torque = sum(
        turning * float(m.moment_constant) * c * most * (0.35 * c + 0.65 * c * c)
        for turning, c in zip(m.rotor_direction[:4], commands, strict=True)
    )
    assert m.angular_velocity[2] == pytest.approx(torque / m.inertia[2] * 0.0025, rel=1e-3)


def test_the_ground_that_holds_lets_go_at_1_2_mps() -> None:
    """With thrust over weight 1.5, the climb rate is 1.2 m/s after 1.2 / (g / 2) s; there is no way until then."""
    m = hovering(down=0.0, held_by_ground=True, **without_air())
    speed = hover_speed(m) * math.sqrt(1.5)
    m.rotor_speed[:4] = speed
    m.motor[:4] = (speed - m.speed_min) / (m.speed_max - m.speed_min)
    leaves = 1.2 / (0.5 * G)
    for k in range(1, 200):
        run(m, 0.0025)
        if 0.0025 * k < leaves - 1e-6:
            assert (m.position[2], m.on_ground) == (0.0, True)
            assert m.velocity[2] == pytest.approx(-0.5 * G * 0.0025 * k, rel=1e-6)
            assert m.specific_force[2] == pytest.approx(-1.5 * G, rel=1e-9)
    flown = 200 * 0.0025 - 0.0025 - leaves
    assert not m.on_ground
    assert -m.position[2] == pytest.approx(1.2 * flown + 0.25 * G * flown * flown, abs=0.005)


def test_the_ground_that_holds_puts_a_vehicle_upright() -> None:
    m = vehicle(down=-0.5, held_by_ground=True)
    m.attitude[:] = quaternion_from_euler(0.5, -0.3, 1.0)
    m.velocity[:] = (1.0, -2.0, 0.0)
    run(m, 1.0)
    assert m.on_ground
    assert m.position[2] == 0.0 and (m.velocity == 0.0).all() and (m.angular_velocity == 0.0).all()
    assert m.attitude == pytest.approx(quaternion_from_euler(0.0, 0.0, 1.0), abs=1e-9)
    assert m.specific_force == pytest.approx([0.0, 0.0, -G], abs=1e-12)


@pytest.mark.parametrize(
    ("rotors", "told"),
    [
        ({"rotor_x": (0.1, -0.1, 0.1)}, "rotor_x has 3 elements, rotor_y 4; give one for each rotor to both"),
        ({"rotor_z": (0.0,)}, "rotor_x has 4 elements, rotor_z 1; give"),
        ({"rotor_direction": (1.0,) * 5}, "rotor_x has 4 elements, rotor_direction 5; give"),
        (
            dict.fromkeys(("rotor_x", "rotor_y", "rotor_z", "rotor_direction"), (0.1,) * 9),
            "rotor_x has 9 elements; a multirotor has 1 to 8 rotors",
        ),
        (
            dict.fromkeys(("rotor_x", "rotor_y", "rotor_z", "rotor_direction"), ()),
            "rotor_x has 0 elements; a multirotor has 1 to 8 rotors",
        ),
    ],
)
def test_rotors_whose_numbers_do_not_agree(rotors: dict[str, tuple[float, ...]], told: str) -> None:
    four = (0.1, -0.1, 0.1, -0.1)
    numbers = dict.fromkeys(("speed_min", "speed_max", "thrust_constant", "moment_constant", "time_constant_up"), 1.0)
    numbers |= dict.fromkeys(("time_constant_down", "axial_speed_limit", "rotor_drag", "rolling_moment"), 1.0)
    given: dict[str, Any] = {"rotor_x": four, "rotor_y": four, "rotor_z": four, "rotor_direction": four, **rotors}
    with pytest.raises(ValueError, match=told):
        multirotor_variables(airframe=Airframe.quad_x, mass=1.0, inertia=(0.1, 0.1, 0.2), **numbers, **given)

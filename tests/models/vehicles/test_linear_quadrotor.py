"""The linear quadrotor against scipy's solution of the source's equations in the source's coordinates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from cosim.vehicle import Airframe
from cosim_models.autopilot.control.mixer import motor_factors
from cosim_models.vehicles.linear_quadrotor import LinearQuadrotor
from tests.models.copter import preset, set_values
from tests.models.shipped_kernels import kernels

G = 9.80665
H = 0.0025
AUTHORS = ("authors_line", "authors_voronoi")
MOTORS = (2, 1, 3, 0)
"""Elements of `motor` that turn w1 (front), w2 (left), w3 (rear) and w4 (right) of quadcopter.mo."""


def quadrotor(down: float = -1000.0, **values: Any) -> Any:
    m = LinearQuadrotor.record()
    set_values(m, {"position_start[3]": down, **values})
    assert kernels(LinearQuadrotor)[0](m) == 0
    return m


def run(m: Any, seconds: float, h: float = H) -> Any:
    for k in range(round(seconds / h)):
        assert kernels(LinearQuadrotor)[1](m, k * h, h) == 0
    return m


def command(m: Any, w: tuple[float, ...]) -> None:
    """Turns rotors 1 to 4 of the source at hover plus `w` [rad/s]."""
    for i, deviation in zip(MOTORS, w, strict=True):
        m.motor[i] = (m.hover_speed + deviation - m.speed_min) / (m.speed_max - m.speed_min)


def source(m: Any, psi: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The matrices of quadcopter.mo: x, y, z, phi, theta, psi, then their rates; inputs w1 to w4."""
    a, b = np.zeros((12, 12)), np.zeros((12, 4))
    a[:6, 6:] = np.eye(6)
    g, mass, kf, km, arm = (float(x) for x in (m.gravity, m.mass, m.thrust_constant, m.moment_constant, m.arm))
    a[6, 3:5] = g * math.sin(psi), g * math.cos(psi)
    a[7, 3:5] = -g * math.cos(psi), g * math.sin(psi)
    b[8] = m.lift_factor * math.sqrt(kf * g / mass)
    slope = math.sqrt(mass * g * kf)
    b[9] = np.array((0, 1, 0, -1)) * arm * slope / m.inertia[0]
    b[10] = np.array((-1, 0, 1, 0)) * arm * slope / m.inertia[1]
    b[11] = np.array((1, -1, 1, -1)) * km * slope / m.inertia[2]
    return a, b


def solved(m: Any, psi: float, w: tuple[float, ...], state: NDArray[np.float64], time: float) -> NDArray[np.float64]:
    """The state after `time` under constant inputs, by the exponential of the extended matrix."""
    a, b = source(m, psi)
    extended = np.zeros((13, 13))
    extended[:12, :12], extended[:12, 12] = a, b @ np.array(w)
    return np.asarray((expm(extended * time) @ np.append(state, 1.0))[:12])


def state_of(m: Any) -> NDArray[np.float64]:
    """The state of the source: x ahead, y left, z up, and angles about them."""
    turn = np.array((1.0, -1.0, -1.0))
    return np.concatenate([x * turn for x in (m.position, m.angle, m.velocity, m.rate)])


@pytest.mark.parametrize("name", ["", *AUTHORS])
@pytest.mark.parametrize("h", [H, 0.05, 0.4])
@pytest.mark.parametrize("heading", [0.0, 0.7, -2.4])
def test_it_moves_as_quadcopter_mo(name: str, h: float, heading: float) -> None:
    """Yaw is at rest: without it, quadcopter.mo's constant heading is the current one; exact for any step."""
    m = quadrotor(yaw_start=heading, **(preset(name) if name else {}))
    unit = 1e-3 * m.hover_speed
    before, elapsed = state_of(m), 0.0
    for w in ((unit, -3 * unit, 2 * unit, 6 * unit), (-unit, unit, unit, -unit)):  # w1 - w2 + w3 - w4 = 0
        assert w[0] - w[1] + w[2] - w[3] == pytest.approx(0.0, abs=1e-12)
        command(m, w)
        run(m, 0.8, h)
        before = solved(m, -heading, w, before, 0.8)
        elapsed += 0.8
        found = state_of(m)
        assert found == pytest.approx(before, rel=1e-9, abs=1e-9)
    assert abs(found[:3] - (0.0, 0.0, 1000.0)).min() > 1e-4  # it has moved along every axis


def test_it_yaws_as_quadcopter_mo() -> None:
    m = quadrotor()
    command(m, (2.0, -2.0, 2.0, -2.0))
    run(m, 0.5)
    rate = float(0.06 * math.sqrt(1.545 * G * 5.84e-6) / 0.05754 * -8.0)  # to the left
    assert m.angular_velocity[2] == pytest.approx(rate * 0.5, rel=1e-12)
    heading = 2.0 * math.atan2(m.attitude[3], m.attitude[0])
    assert heading == pytest.approx(rate * 0.125, rel=1e-12)
    assert m.position.tolist() == pytest.approx([0.0, 0.0, -1000.0], abs=1e-9)


@pytest.mark.parametrize(
    ("name", "roll", "pitch", "yaw", "lift", "hover"),
    [
        ("authors_voronoi", 0.3927, 0.2977, 0.01587, 0.1731, 56.68),  # C_phi, C_theta, C_psi, C_z of their controller
        ("authors_line", 939.6, 939.6, 3132.1, 6.264, 1.566),
    ],
)
def test_the_authors_numbers(name: str, roll: float, pitch: float, yaw: float, lift: float, hover: float) -> None:
    m = quadrotor(**preset(name))
    assert m.hover_speed == pytest.approx(hover, rel=1e-3)
    step = 1e-3 * hover

    def rates(w: tuple[float, ...]) -> tuple[float, float, float, float]:
        m = quadrotor(**preset(name))
        command(m, w)
        run(m, H)
        p, q, r = (float(x) / H / step for x in m.angular_velocity)
        return p, -q, -r, -float(m.velocity[2]) / H / step

    assert rates((0.0, step, 0.0, 0.0)) == pytest.approx((roll, 0.0, -yaw, lift), rel=1e-3, abs=1e-9 * roll)
    assert rates((0.0, 0.0, step, 0.0)) == pytest.approx((0.0, pitch, yaw, lift), rel=1e-3, abs=1e-9 * roll)


def test_a_preset_sets_every_number_of_the_source() -> None:
    flat = {"mass", "arm", "thrust_constant", "moment_constant", "lift_factor", "gravity", "speed_min", "speed_max"}
    for name in AUTHORS:
        assert set(preset(name)) == flat | {f"inertia[{i}]" for i in (1, 2, 3)}


def test_it_linearises_the_quadrotor() -> None:
    """A little more speed of all rotors lifts it as it lifts PX4's Iris: 2 dw / w g."""
    m = quadrotor()
    assert m.airframe == Airframe.quad_plus
    command(m, (1.0,) * 4)
    run(m, H)
    assert -m.velocity[2] / H == pytest.approx(2.0 * G / math.sqrt(1.545 * G / (4.0 * 5.84e-6)), rel=1e-9)
    assert -m.specific_force[2] == pytest.approx(G - m.velocity[2] / H, rel=1e-9)


def test_the_mixer_turns_it_where_it_should() -> None:
    table = np.zeros((8, 3))
    assert motor_factors(int(Airframe.quad_plus), table) == 4
    for axis in range(3):
        m = quadrotor()
        command(m, (0.0,) * 4)
        m.motor[:4] += 0.01 * table[:4, axis]
        run(m, 0.05)
        turn = [float(x) for x in m.angular_velocity]
        assert turn[axis] > 5e-4
        assert [turn[i] for i in range(3) if i != axis] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_an_accelerometer_measures_the_motion() -> None:
    """Leaning at constant height, the specific force in NED is the acceleration less gravity."""
    m = quadrotor(yaw_start=1.0)
    command(m, (-0.5, 0.5, 0.5, -0.5))
    run(m, 0.3)
    speed = m.velocity.copy()
    run(m, 1e-4, 1e-4)
    w, v = float(m.attitude[0]), m.attitude[1:]
    f = np.asarray(m.specific_force)
    ned = f + 2.0 * w * np.cross(v, f) + 2.0 * np.cross(v, np.cross(v, f))
    assert abs(speed[:2]).min() > 1e-3
    assert ned == pytest.approx((m.velocity - speed) / 1e-4 - (0.0, 0.0, G), abs=1e-3)


def test_it_stands_takes_off_and_lands_upright() -> None:
    m = quadrotor(0.0, yaw_start=0.4)
    m.motor[:4] = (0.1, 0.5, 0.3, 0.2)  # not enough: the ground holds it, level
    run(m, 0.5)
    assert m.on_ground and m.position.tolist() == [0.0, 0.0, 0.0]
    assert m.attitude.tolist() == pytest.approx([math.cos(0.2), 0.0, 0.0, math.sin(0.2)], abs=1e-12)
    assert m.specific_force.tolist() == pytest.approx([0.0, 0.0, -G])
    command(m, (10.0,) * 4)
    run(m, 1.0)
    assert not m.on_ground and m.position[2] < -0.1
    m.motor[:4] = 0.0
    run(m, 3.0)
    assert m.on_ground and m.position[2] == 0.0 and not m.velocity.any() and not m.rate.any()


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"mass": 0.0}, 1),
        ({"inertia[2]": -1.0}, 1),
        ({"thrust_constant": 0.0}, 2),
        ({"gravity": -9.81}, 2),
        ({"position_start[3]": 0.5}, 3),
        ({"speed_max": 800.0}, 4),
    ],
)
def test_parameters_that_make_no_quadrotor_are_refused(values: dict[str, float], code: int) -> None:
    m = LinearQuadrotor.record()
    set_values(m, values)
    assert kernels(LinearQuadrotor)[0](m) == code
    assert code in LinearQuadrotor.errors


def test_what_is_not_finite_is_refused() -> None:
    m = quadrotor()
    m.velocity[0] = math.nan
    assert kernels(LinearQuadrotor)[1](m, 0.0, H) == 5

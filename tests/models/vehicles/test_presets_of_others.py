"""Presets of vehicles that are no multirotors: about existing parameters, with the figures of their sources."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from lxml import etree
from scipy.optimize import brentq

from cosim import Model
from cosim.model import flat_variables
from cosim_models.vehicles.boat import Boat
from cosim_models.vehicles.fixed_wing import FixedWing
from cosim_models.vehicles.linear_quadrotor import LinearQuadrotor
from cosim_models.vehicles.point_mass import PointMass
from cosim_models.vehicles.quadplane import Quadplane
from cosim_models.vehicles.rover import Rover, Steering
from tests.models.copter import PRESETS, set_values
from tests.models.shipped_kernels import kernels

G = 9.80665
MODELS: dict[str, type[Model]] = {
    "ardupilot_plane": FixedWing,
    "ardupilot_quadplane": Quadplane,
    "ardupilot_rover_skid": Rover,
    "authors_line": LinearQuadrotor,
    "authors_voronoi": LinearQuadrotor,
    "crazyflie_point": PointMass,
    "px4_iris_point": PointMass,
    "px4_standard_vtol": Quadplane,
    "vrx_wamv": Boat,
}


def values(name: str) -> dict[str, Any]:
    root = etree.fromstring((PRESETS / f"{name}.ssv").read_bytes())
    assert root.get("name") == name
    found: dict[str, Any] = {}
    for one in root[0]:
        text, kind = one[0].get("value"), etree.QName(one[0]).localname
        assert one.get("name") not in found
        found[one.get("name")] = int(Steering[text]) if kind == "Enumeration" else float(text)
    return found


def with_preset(name: str, **others: Any) -> Any:
    m = MODELS[name].record()
    set_values(m, values(name) | others)
    assert kernels(MODELS[name])[0](m) == 0
    return m


def test_these_are_all_presets() -> None:
    others = {file.stem for file in PRESETS.glob("*.ssv") if b"rotor_count" not in file.read_bytes()}
    assert others == set(MODELS)


@pytest.mark.parametrize("name", MODELS)
def test_a_preset_is_about_parameters_of_its_vehicle_and_says_its_source(name: str) -> None:
    known = {f.name for f in flat_variables(MODELS[name].variables) if f.variable.role == "parameter"}
    assert set(values(name)) <= known
    comment = (PRESETS / f"{name}.ssv").read_text(encoding="utf-8").partition("<!--")[2].partition("-->")[0]
    assert len(comment) > 200 and "SI." in comment


@pytest.mark.parametrize("name", ["vrx_wamv", "ardupilot_plane", "px4_standard_vtol"])
def test_it_sets_every_number_of_the_body(name: str) -> None:
    """What it leaves alone is the place, the surroundings and the integration, not the vehicle."""
    known = {f.name for f in flat_variables(MODELS[name].variables) if f.variable.role == "parameter"}
    left = {one.partition("[")[0] for one in known - set(values(name))}
    places = {"position_start", "yaw_start", "speed_start", "ground_height", "current", "windage"}
    assert left <= places | {"deflection_max", "substep"}


@pytest.mark.parametrize(
    "servos", [(0.5, 0.5, 0.0, 0.5), (0.6, 0.5, 0.0, 0.5), (0.5, 0.4, 0.0, 0.5), (0.5, 0.5, 0.0, 0.7)]
)
def test_arduplanes_quadplane_turns_as_its_source(servos: tuple[float, ...]) -> None:
    """The air gives the angular acceleration of the plane, 1 kg m2, the rotors that of a copter of SIM_Frame."""
    turns = []
    for name in ("ardupilot_plane", "ardupilot_quadplane"):
        flying = {"position_start[3]": -100.0, "speed_start": 20.0, "substep": 1e-6}
        m = with_preset(name, **flying)
        m.motor[:4] = servos
        assert kernels(MODELS[name])[1](m, 0.0, 1e-6) == 0
        turns.append(m.angular_velocity * 1e6)
    assert turns[1].tolist() == pytest.approx(turns[0].tolist(), rel=1e-4, abs=1e-4)
    m = with_preset("ardupilot_quadplane", **{"position_start[3]": -100.0})
    m.motor[:8] = (0.5, 0.5, 0.0, 0.5, 0.6, 0.5, 0.6, 0.5)  # both in front
    for k in range(100):
        assert kernels(Quadplane)[1](m, 1e-3 * k, 1e-3) == 0
    thrust = [1.88589e-05 * float(speed) ** 2 for speed in m.rotor_speed]
    torque = 0.35 * math.sqrt(0.5) * (thrust[0] + thrust[2] - thrust[1] - thrust[3])
    before = float(m.angular_velocity[1])
    assert kernels(Quadplane)[1](m, 0.1, 1e-5) == 0
    inertia = 0.5 * 3.0 * (0.35 / 2.0) ** 2 / 2.0  # half of the mass on the ring, about a diameter
    assert (m.angular_velocity[1] - before) / 1e-5 == pytest.approx(
        torque / inertia, rel=0.05
    )  # less what the air damps


def test_the_wamv_reaches_the_speed_and_the_turn_of_its_source() -> None:
    """Thrust of 4707 N against 100 u + 150 u^2; one engine alone turns it about 2.78 m."""
    m = with_preset("vrx_wamv")
    thrust = (51.3 + 72.4 * 7.71667) * 7.71667
    m.motor[:2] = (0.5, 1.0)
    for k in range(4000):
        assert kernels(Boat)[1](m, 0.0125 * k, 0.0125) == 0
    top = brentq(lambda u: 100.0 * u + 150.0 * u * u - thrust, 0.0, 20.0)
    assert m.speed == pytest.approx(top, abs=1e-3)
    ahead = brentq(lambda u: 100.0 * u + 150.0 * u * u - thrust / 2.0, 0.0, 20.0)
    turn = brentq(lambda r: 800.0 * r + 800.0 * r * r - 1.027135 * thrust / 2.0, 0.0, 20.0)
    assert values("vrx_wamv")["turning_radius"] == pytest.approx(ahead / turn, abs=1e-4)


def of_the_source(v: Any, w: Any, aileron: float, elevator: float, rudder: float) -> tuple[Any, Any]:
    """Force [N] and angular acceleration [rad/s2] by getForce and getTorque of SIM_Plane.cpp below the stall, FRD."""
    s, b, c, speed = 0.45, 1.88, 0.24, float(np.linalg.norm(v))
    alpha, beta, (p, q, r) = math.atan2(v[2], v[0]), math.atan2(v[1], v[0]), w
    lift = 0.56 + 6.9 * alpha
    drag = 0.1 + lift * lift / (math.pi * 0.9 * b * b / s)
    push = 0.5 * 1.225 * speed * speed * s
    ca, sa = math.cos(alpha), math.sin(alpha)
    force = push * np.array([-drag * ca + lift * sa, -0.98 * beta - 0.2 * rudder, -drag * sa - lift * ca])
    pb, rb, qc = b * p / (2.0 * speed), b * r / (2.0 * speed), c * q / (2.0 * speed)
    torque = push * np.array(
        [
            b * (-0.12 * beta - 1.0 * pb + 0.14 * rb + 0.25 * aileron - 0.037 * rudder),
            c * (0.045 - 0.7 * alpha - 20.0 * qc + 1.0 * elevator),
            b * (0.25 * beta + 0.022 * pb - 1.0 * rb + 0.1 * rudder),
        ]
    )
    return force, torque + np.cross((-0.15, 0.0, -0.05), force)


@pytest.mark.parametrize("alpha", [0.0, 2.0, 5.0])
@pytest.mark.parametrize(
    ("beta", "rates", "servos"),
    [
        (0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (3.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (0.0, (0.3, 0.1, -0.2), (0.0, 0.0, 0.0)),
        (0.0, (0.0, 0.0, 0.0), (0.2, 0.1, -0.3)),
    ],
)
def test_forces_and_moments_of_the_plane_are_those_of_its_source(
    alpha: float, beta: float, rates: Any, servos: Any
) -> None:
    """Forces exactly; moments but for the second order of the angles in the moment of the centre of lift."""
    a, b = math.radians(alpha), math.radians(beta)
    v = 16.0 * np.array([math.cos(a) * math.cos(b), math.sin(b), math.sin(a) * math.cos(b)])
    force, turning = of_the_source(v, rates, *servos)
    m = with_preset("ardupilot_plane", **{"position_start[3]": -500.0}, propeller_area=0.0)
    m.velocity[:], m.angular_velocity[:] = v, rates
    m.motor[:4] = (0.5 + 0.5 * servos[0], 0.5 + 0.5 * servos[1], 0.0, 0.5 + 0.5 * servos[2])
    h = 1e-6
    assert kernels(FixedWing)[1](m, 0.0, h) == 0
    np.testing.assert_allclose(np.array(m.specific_force) * 2.0, force, atol=0.02)
    turned = (np.array(m.angular_velocity) - rates) / h
    np.testing.assert_allclose(turned, turning, atol=0.02 * np.abs(force).max() * 0.15 + 0.1)


def test_the_thrust_of_the_plane_at_20_m_s_is_its_weight_over_1_2() -> None:
    given = values("ardupilot_plane")
    thrust = 0.5 * 1.225 * given["propeller_area"] * (given["motor_speed"] ** 2 - 400.0)
    assert thrust == pytest.approx(2.0 * G / 1.2, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "mass", "drag"),
    [
        ("px4_iris_point", 1.545, 4.0 * 1.75e-4 * math.sqrt(1.545 * G / (4.0 * 5.84e-6))),
        ("crazyflie_point", 0.027, 9.1785e-7 * 4.0 * math.sqrt(0.027 * G / (4.0 * 3.16e-10)) * math.pi / 30.0),
    ],
)
def test_point_masses_take_on_the_wind_as_the_drag_of_their_rotors_at_hover_says(
    name: str, mass: float, drag: float
) -> None:
    m = with_preset(name, **{"position_start[3]": -50.0})
    m.motor[:4] = (0.5, 0.5, 0.5, 1.0)
    m.wind[:] = (5.0, 0.0, 0.0)
    assert kernels(PointMass)[1](m, 0.0, 2.0) == 0
    assert m.velocity[0] == pytest.approx(5.0 * (1.0 - math.exp(-2.0 * drag / mass)), rel=1e-4)


def surfaces(v: Any, w: Any, aileron: float, elevator: float) -> tuple[Any, Any]:
    """Force [N] and torque [N m], FRD, of the surfaces of standard_vtol.sdf, by Gazebo's LiftDragPlugin.

    Each has a place, an area, an angle of no lift, lift by deflection, and a direction of lift; lift and drag are in
    the plane of that and of the way ahead.
    """
    up, right = np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0])
    force, torque = np.zeros(3), np.zeros(3)
    for place, area, zero, deflected, upward in (
        ((-0.05, -0.3, -0.05), 0.5, 0.05984281113, aileron, up),
        ((-0.05, 0.3, -0.05), 0.5, 0.05984281113, -aileron, up),
        ((-0.5, 0.0, 0.0), 0.01, -0.2, 12.0 * elevator, up),
        ((-0.5, 0.0, -0.05), 0.02, 0.0, 0.0, right),
    ):
        air = v + np.cross(w, place)
        ahead, across = air[0], air @ upward
        alpha = zero + math.atan2(-across, ahead)
        push = 0.5 * 1.2041 * (ahead * ahead + across * across) * area
        forward = np.array([1.0, 0.0, 0.0])
        way = (ahead * forward + across * upward) / math.hypot(ahead, across)
        lifted = (ahead * upward - across * forward) / math.hypot(ahead, across)
        one = push * ((4.752798721 * alpha + deflected) * lifted - abs(0.6417112299 * alpha) * way)
        force += one
        torque += np.cross(place, one)
    return force, torque


@pytest.mark.parametrize(
    ("alpha", "beta", "rates", "servos"),
    [
        (0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0)),
        (1.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0)),
        (0.0, 2.0, (0.0, 0.0, 0.0), (0.0, 0.0)),
        (0.0, 0.0, (0.2, 0.0, 0.0), (0.0, 0.0)),
        (0.0, 0.0, (0.0, 0.2, 0.0), (0.0, 0.0)),
        (0.0, 0.0, (0.0, 0.0, 0.2), (0.0, 0.0)),
        (0.0, 0.0, (0.0, 0.0, 0.0), (0.2, 0.0)),
        (0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.05)),
    ],
)
def test_the_standard_vtol_feels_the_surfaces_of_its_source(alpha: float, beta: float, rates: Any, servos: Any) -> None:
    """By angle, rate and deflection, within 6 % and the second order, and 1 N of drag, which is not linear here."""
    a, b = math.radians(alpha), math.radians(beta)
    v = 15.0 * np.array([math.cos(a) * math.cos(b), math.sin(b), math.sin(a) * math.cos(b)])
    aileron, elevator = servos[0] * 0.53, -servos[1] * 0.53  # 1 is a roll to the right, and a nose that rises
    force, torque = surfaces(v, np.array(rates), aileron, elevator)
    m = with_preset("px4_standard_vtol", **{"position_start[3]": -500.0}, propeller_area=0.0)
    m.velocity[:], m.angular_velocity[:] = v, rates
    m.motor[:4] = (0.5 + 0.5 * servos[0], 0.5 + 0.5 * servos[1], 0.0, 0.5)
    h = 1e-6
    assert kernels(Quadplane)[1](m, 0.0, h) == 0
    assert (np.abs(np.array(m.specific_force) * 5.04 - force) <= 0.06 * np.abs(force) + (1.0, 0.4, 0.4)).all()
    turned = (np.array(m.angular_velocity) - rates) / h * (0.477708, 0.341667, 0.811042)
    turned += np.cross(rates, np.array((0.477708, 0.341667, 0.811042)) * rates)
    np.testing.assert_allclose(turned, torque, rtol=0.06, atol=0.08)

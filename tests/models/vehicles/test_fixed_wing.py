"""The fixed wing: mechanics against invariants, forces against the numbers of the source."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cosim.frames import rotate
from cosim.vehicle import Airframe
from cosim_models.vehicles.fixed_wing import FixedWing
from tests.models.copter import set_values
from tests.models.shipped_kernels import kernels

G = 9.80665
FLYING = {"position_start[3]": -500.0}


def plane(**values: Any) -> Any:
    m = FixedWing.record()
    set_values(m, values)
    assert kernels(FixedWing)[0](m) == 0
    m.motor[:4] = (0.5, 0.5, 0.0, 0.5)
    return m


def run(m: Any, time: float, h: float = 0.0125) -> Any:
    for k in range(round(time / h)):
        assert kernels(FixedWing)[1](m, k * h, h) == 0
    return m


def momentum(m: Any) -> list[float]:
    """Angular momentum, NED, with the product of inertia."""
    p, q, r = (float(x) for x in m.angular_velocity)
    h = (0.8244 * p - 0.1204 * r, 1.135 * q, 1.759 * r - 0.1204 * p)
    return list(rotate(tuple(float(x) for x in m.attitude), h))


def test_without_air_it_falls_and_keeps_its_angular_momentum() -> None:
    m = plane(air_density=0.0, speed_start=20.0, **FLYING)
    m.angular_velocity[:] = (2.0, 1.0, -1.5)
    before = momentum(m)
    run(m, 4.0)
    assert momentum(m) == pytest.approx(before, abs=1e-5)
    assert m.velocity.tolist() == pytest.approx([20.0, 0.0, 4.0 * G], abs=1e-9)
    assert m.position.tolist() == pytest.approx([80.0, 0.0, -500.0 + 8.0 * G], abs=1e-9)


def test_its_propeller_pulls_as_in_the_source() -> None:
    """0.5 rho S_prop (k_motor^2 throttle^2 - V^2); at 60 % and rest 296 N, less rolling friction of 0.02 m g."""
    m = plane()
    m.motor[2] = 0.6
    before = float(m.velocity[0])
    run(m, 0.00625 * 2, 0.0125)
    thrust = 0.5 * 1.2682 * 0.2027 * (80.0 * 0.6) ** 2
    assert (m.velocity[0] - before) / 0.0125 == pytest.approx(thrust / 13.5 - 0.02 * G, rel=0.02)


@pytest.mark.parametrize("alpha", [0.0, 4.0, 10.0])
def test_lift_and_drag_are_those_of_the_source(alpha: float) -> None:
    """At 25 m/s: C_L = 0.28 + 3.45 alpha, C_D = 0.0437 + C_L^2 / (pi e A), and a propeller that brakes."""
    angle = math.radians(alpha)
    m = plane(**FLYING)
    m.velocity[:] = (25.0 * math.cos(angle), 0.0, 25.0 * math.sin(angle))  # level nose, sinking
    m.motor[1] = 0.5
    assert kernels(FixedWing)[1](m, 0.0, 1e-6) == 0
    lift = 0.28 + 3.45 * angle
    drag = 0.0437 + lift * lift / (math.pi * 0.9 * 2.8956**2 / 0.55)
    area = 0.5 * 1.2682 * 25.0**2 * 0.55
    brake = 0.5 * 1.2682 * 0.2027 * (25.0 * math.cos(angle)) ** 2
    expected = (
        (-brake - area * drag * math.cos(angle) + area * lift * math.sin(angle)) / 13.5,
        0.0,
        (-area * drag * math.sin(angle) - area * lift * math.cos(angle)) / 13.5,
    )
    assert m.specific_force.tolist() == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("element", "axis", "sign"), [(0, 0, 1), (1, 1, 1), (3, 2, 1)], ids=["aileron", "elevator", "rudder"]
)
def test_servos_turn_it_right_and_up(element: int, axis: int, sign: int) -> None:
    m = plane(speed_start=25.0, **FLYING)
    rest = plane(speed_start=25.0, **FLYING)
    m.motor[element] = 0.6
    run(m, 0.05)
    run(rest, 0.05)
    assert sign * (m.angular_velocity[axis] - rest.angular_velocity[axis]) > 0.01


def test_wind_is_felt_as_airspeed() -> None:
    m, calm = plane(speed_start=15.0, **FLYING), plane(speed_start=25.0, **FLYING)
    m.wind[:] = (-10.0, 0.0, 0.0)
    run(m, 1.0)
    run(calm, 1.0)
    assert np.allclose(m.velocity - calm.velocity, (-10.0, 0.0, 0.0), atol=1e-9)
    assert np.allclose(m.attitude, calm.attitude, atol=1e-12)


def test_it_is_integrated_with_the_fourth_order() -> None:
    def end(substep: float) -> Any:
        m = plane(speed_start=25.0, substep=substep, **FLYING)
        m.motor[:4] = (0.55, 0.55, 0.3, 0.52)
        return run(m, 2.0, 0.05).position.copy()

    exact = end(0.0015625)
    errors = [np.abs(end(substep) - exact).max() for substep in (0.05, 0.025)]
    assert math.log2(errors[0] / errors[1]) > 3.5


def test_it_stands_on_its_wheels() -> None:
    m = run(plane(), 5.0)
    assert (m.airframe, m.on_ground) == (Airframe.plane, True)
    assert np.abs(m.position).max() < 1e-6
    assert m.specific_force.tolist() == pytest.approx([0.0, 0.0, -G], abs=1e-6)


@pytest.mark.parametrize(
    ("values", "code"),
    [({"mass": 0.0}, 1), ({"position_start[3]": 1.0}, 2), ({"motor[3]": math.nan}, 3), ({"inertia_xz": 2.0}, 4)],
)
def test_errors(values: dict[str, Any], code: int) -> None:
    m = FixedWing.record()
    set_values(m, values)
    start, advance = kernels(FixedWing)
    result = start(m)
    assert (result or advance(m, 0.0, 0.0125)) == code

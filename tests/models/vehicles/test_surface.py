"""Rover and boat against the closed forms of their sources."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.vehicles.boat import Boat
from cosim_models.vehicles.rover import Rover, Steering
from tests.models.copter import set_values
from tests.models.shipped_kernels import kernels


def vehicle(model: type[Model], turn: float, throttle: float, **values: Any) -> Any:
    m = model.record()
    set_values(m, values)
    assert kernels(model)[0](m) == 0
    m.motor[:2] = (0.5 + 0.5 * turn, 0.5 + 0.5 * throttle)
    return m


def run(model: type[Model], m: Any, time: float, h: float = 0.0125) -> Any:
    for k in range(round(time / h)):
        assert kernels(model)[1](m, k * h, h) == 0
    return m


@pytest.mark.parametrize("h", [0.0025, 0.0125, 0.5])
def test_a_rover_approaches_its_speed_with_the_time_constant_of_the_source(h: float) -> None:
    """20 m/s at full throttle, 10 m/s2 at rest: v = 20 (1 - exp(-t / 2))."""
    m = run(Rover, vehicle(Rover, 0.0, 0.5), 3.0, h)
    assert (m.airframe, m.on_ground) == (Airframe.rover, True)
    assert m.speed == pytest.approx(10.0 * (1.0 - math.exp(-1.5)), abs=1e-12)
    assert m.position.tolist() == pytest.approx([10.0 * (3.0 - 2.0 * (1.0 - math.exp(-1.5))), 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(("model", "steering"), [(Rover, 1.0), (Rover, -0.4), (Boat, 1.0), (Boat, 0.3)])
def test_the_radius_of_a_turn_does_not_depend_on_the_speed(model: type[Model], steering: float) -> None:
    """SIM_Rover: radius 0.9 m at full steering, 0.9 sin(35) / sin(35 u) else, clockwise to the right."""
    m = vehicle(model, steering, 0.1)
    radius = 0.9 * math.sin(math.radians(35.0)) / math.sin(math.radians(35.0 * steering))
    places = [run(model, m, 0.25).position[:2].copy() for _ in range(12)]
    assert np.hypot(*(np.array(places) - (0.0, radius)).T) == pytest.approx(np.full(12, abs(radius)), abs=1e-9)
    assert m.angular_velocity[2] == pytest.approx(m.speed / radius, rel=0.02)


def test_a_skid_steered_rover_turns_on_the_spot() -> None:
    m = run(Rover, vehicle(Rover, 0.5, 0.0, steering=int(Steering.skid)), 1.0)
    assert m.angular_velocity[2] == pytest.approx(math.radians(70.0), abs=1e-12)
    assert m.position.tolist() == [0.0, 0.0, 0.0]
    assert 2.0 * math.atan2(m.attitude[3], m.attitude[0]) == pytest.approx(math.radians(70.0), abs=1e-12)


def test_a_boat_approaches_the_speed_at_which_drag_and_thrust_balance() -> None:
    """2 kg, 50 N, 0.5 N s2/m2: v = 10 tanh(2.5 t)."""
    m = vehicle(Boat, 0.0, 1.0)
    assert run(Boat, m, 0.4).speed == pytest.approx(10.0 * math.tanh(1.0), abs=2e-3)
    assert run(Boat, m, 2.0).speed == pytest.approx(10.0, abs=1e-3)
    m.motor[1] = 0.0
    assert run(Boat, m, 5.0).speed == pytest.approx(-10.0, abs=1e-3)


@pytest.mark.parametrize("shortest", [1e-13, 1e-16])
@pytest.mark.parametrize("model", [Rover, Boat])
def test_a_step_of_no_length_keeps_forces_and_rates(model: type[Model], shortest: float) -> None:
    """Of a pushed vehicle in a turn; a difference of speeds over such a step would be rounding."""
    m = run(model, vehicle(model, 0.7, 0.8, force=[30.0, -20.0, 0.0]), 1.0)
    before = [np.array(m.specific_force), np.array(m.angular_velocity), np.array(m.velocity)]
    assert abs(before[0][0]) > 0.01 and abs(before[0][1]) > 0.1 and abs(before[1][2]) > 0.01
    after = run(model, m, shortest, h=shortest)
    for old, name in zip(before, ("specific_force", "angular_velocity", "velocity"), strict=True):
        np.testing.assert_allclose(np.array(getattr(after, name)), old, rtol=0, atol=1e-9)


def test_a_current_takes_a_boat_along() -> None:
    m = run(Boat, vehicle(Boat, 0.0, 0.0, **{"current[2]": 0.5}), 8.0)
    assert m.position.tolist() == pytest.approx([0.0, 4.0, 0.0], abs=1e-9)
    assert m.velocity.tolist() == pytest.approx([0.0, 0.5, 0.0])


@pytest.mark.parametrize(
    ("model", "values", "code"),
    [
        (Rover, {"speed_max": 0.0}, 1),
        (Rover, {"motor[2]": math.nan}, 2),
        (Boat, {"mass": 0.0}, 1),
        (Boat, {"current[1]": math.inf}, 2),
    ],
)
def test_errors(model: type[Model], values: dict[str, Any], code: int) -> None:
    m = model.record()
    set_values(m, values)
    start, advance = kernels(model)
    result = start(m)
    assert (result or advance(m, 0.0, 0.0125)) == code

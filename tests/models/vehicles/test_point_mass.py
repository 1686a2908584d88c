"""The point mass against the closed forms of its motion."""

from __future__ import annotations

import math
from typing import Any

import pytest

from cosim.vehicle import Airframe
from cosim_models.vehicles.point_mass import PointMass
from tests.models.copter import set_values
from tests.models.shipped_kernels import kernels

G = 9.80665


def point(**values: Any) -> Any:
    m = PointMass.record()
    set_values(m, values)
    assert kernels(PointMass)[0](m) == 0
    return m


def run(m: Any, time: float, h: float = 0.0125) -> Any:
    for k in range(round(time / h)):
        assert kernels(PointMass)[1](m, k * h, h) == 0
    return m


@pytest.mark.parametrize("h", [0.0025, 0.0125, 0.5])
def test_it_accelerates_as_commanded_whatever_the_step(h: float) -> None:
    m = point(**{"position_start[3]": -50.0})
    assert m.airframe == Airframe.point_mass
    m.motor[:4] = (0.55, 0.5, 0.475, 1.0)  # 2 m/s2 north, 1 m/s2 up
    run(m, 3.0, h)
    assert m.position.tolist() == pytest.approx([9.0, 0.0, -54.5], abs=1e-9)
    assert m.velocity.tolist() == pytest.approx([6.0, 0.0, -3.0], abs=1e-9)
    assert m.specific_force.tolist() == pytest.approx([2.0, 0.0, -1.0 - G], abs=1e-9)


@pytest.mark.parametrize("shortest", [1e-13, 1e-16])
def test_a_step_of_no_length_keeps_forces(shortest: float) -> None:
    """Also where it is pushed in the air; a difference of velocities over such a step would be rounding."""
    m = point(**{"position_start[3]": -50.0})
    m.motor[:4], m.force[:] = (0.8, 0.3, 0.4, 1.0), (1.0, 2.0, -3.0)
    run(m, 1.0)
    before = list(m.specific_force)
    assert min(abs(one) for one in before) > 0.1
    assert list(run(m, shortest, h=shortest).specific_force) == before


def test_it_falls_without_lift_and_stands_on_the_ground() -> None:
    m = point(**{"position_start[3]": -10.0})
    run(m, 1.0)
    assert m.position[2] == pytest.approx(-10.0 + 0.5 * G, abs=1e-9)
    run(m, 1.0)
    assert (m.position[2], m.on_ground) == (0.0, True)
    assert m.velocity.tolist() == [0.0, 0.0, 0.0]
    m.motor[:4] = (0.9, 0.9, 0.6, 1.0)  # pushed down, it does not slide
    run(m, 1.0)
    assert m.position.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("h", [0.0125, 1.0])
def test_wind_takes_it_along_with_a_time_constant(h: float) -> None:
    m = point(drag_time=2.0, **{"position_start[3]": -50.0})
    m.motor[:4] = (0.5, 0.5, 0.5, 1.0)
    m.wind[:] = (0.0, 6.0, 0.0)
    run(m, 4.0, h)
    assert m.velocity[1] == pytest.approx(6.0 * (1.0 - math.exp(-2.0)), abs=1e-12)
    assert m.position[1] == pytest.approx(6.0 * (4.0 - 2.0 * (1.0 - math.exp(-2.0))), abs=1e-12)


def test_it_keeps_its_heading_and_feels_forces_in_body_axes() -> None:
    m = point(yaw_start=math.pi / 2.0, **{"position_start[3]": -5.0})
    m.motor[:4] = (0.5, 0.6, 0.5, 1.0)  # 4 m/s2 east is ahead
    run(m, 0.0125)
    assert m.specific_force.tolist() == pytest.approx([4.0, 0.0, -G], abs=1e-9)


@pytest.mark.parametrize(
    ("values", "code"), [({"drag_time": -1.0}, 1), ({"position_start[3]": 1.0}, 2), ({"motor[1]": math.nan}, 3)]
)
def test_errors(values: dict[str, Any], code: int) -> None:
    m = PointMass.record()
    set_values(m, values)
    start, advance = kernels(PointMass)
    m.motor[3] = 1.0
    result = start(m)
    assert (result or advance(m, 0.0, 0.0125)) == code

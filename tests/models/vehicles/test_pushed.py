"""Forces and wind on rovers, boats and the linear quadrotor, against closed forms; without them nothing changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cosim import Model
from cosim_models.vehicles.boat import Boat
from cosim_models.vehicles.linear_quadrotor import LinearQuadrotor
from cosim_models.vehicles.rover import Rover
from tests.models.copter import set_values
from tests.models.shipped_kernels import kernels

G = 9.80665


def vehicle(model: type[Model], **values: Any) -> Any:
    m = model.record()
    set_values(m, values)
    assert kernels(model)[0](m) == 0
    if model is not LinearQuadrotor:
        m.motor[:2] = 0.5
    return m


def run(model: type[Model], m: Any, time: float, h: float = 0.0125) -> Any:
    for k in range(round(time / h)):
        assert kernels(model)[1](m, k * h, h) == 0
    return m


# ---- rover ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [0.0025, 0.0125, 0.5])
def test_a_force_along_a_rover_works_against_the_lag_of_its_drive(h: float) -> None:
    """2 kg, 20 m/s, 10 m/s2, lag 2 s: v = 6 N / 2 kg 2 s (1 - exp(-t / 2 s)), whatever its heading."""
    m = vehicle(Rover, yaw_start=0.6)
    m.force[:2] = (6.0 * math.cos(0.6), 6.0 * math.sin(0.6))
    run(Rover, m, 3.0, h)
    assert m.speed == pytest.approx(6.0 * (1.0 - math.exp(-1.5)), abs=1e-12)
    distance = 6.0 * (3.0 - 2.0 * (1.0 - math.exp(-1.5)))
    assert m.position[:2].tolist() == pytest.approx([distance * math.cos(0.6), distance * math.sin(0.6)], abs=1e-9)


@pytest.mark.parametrize("h", [0.0025, 0.0125, 0.3])
def test_a_force_across_a_rover_moves_it_only_beyond_the_friction_of_its_wheels(h: float) -> None:
    """Grip 0.8 of 2 kg: 15.69 N hold. 25.69 N for 1.2 s accelerate by 5 m/s2; then friction stops it by 0.8 g."""
    grip = 0.8 * G
    m = vehicle(Rover)
    m.force[1] = 2.0 * grip * 0.999
    run(Rover, m, 0.6, h)
    assert m.position.tolist() == [0.0, 0.0, 0.0] and m.slip == 0.0
    m.force[1] = 2.0 * (grip + 5.0)
    run(Rover, m, 1.2, h)
    assert m.position[1] == pytest.approx(0.5 * 5.0 * 1.2**2, abs=1e-12)
    assert m.velocity.tolist() == pytest.approx([0.0, 6.0, 0.0], abs=1e-12)
    assert m.specific_force[1] == pytest.approx(5.0, abs=1e-9)
    m.force[1] = 0.0
    run(Rover, m, 1.2, h)
    assert m.position[1] == pytest.approx(3.6 + 36.0 / (2.0 * grip), abs=1e-12)
    assert m.velocity.tolist() == [0.0, 0.0, 0.0] and m.slip == 0.0


def test_a_force_that_turns_round_stops_the_slide_and_reverses_it_within_a_step() -> None:
    """Slip 1 m/s, pull -20 m/s2, grip 5: down by 25 m/s2 to rest in 0.04 s, then back by 15."""
    m = vehicle(Rover, grip=5.0 / G)
    m.slip, m.force[1] = 1.0, -40.0
    run(Rover, m, 0.1, 0.1)
    assert m.slip == pytest.approx(-15.0 * 0.06, abs=1e-12)
    assert m.position[1] == pytest.approx(0.5 * 0.04 - 0.5 * 15.0 * 0.06**2, abs=1e-12)


# ---- boat ----------------------------------------------------------------------------------------------------------


def test_a_boat_is_pushed_aside_until_the_resistance_to_sway_balances() -> None:
    """2 kg, 20 N, 5 N s2/m2: s = 2 tanh(5 t); ahead, 50 N of force are as 50 N of thrust: 10 tanh(2.5 t)."""
    m = vehicle(Boat, yaw_start=math.pi / 2.0)
    m.force[0] = -20.0  # to the right of a boat that heads east is south
    assert run(Boat, m, 0.2, 0.0025).slip == pytest.approx(2.0 * math.tanh(1.0), abs=2e-4)
    run(Boat, m, 3.0)
    assert m.velocity.tolist() == pytest.approx([-2.0, 0.0, 0.0], abs=1e-9)
    assert m.specific_force[1] == pytest.approx(0.0, abs=1e-9)
    m = vehicle(Boat)
    m.force[0] = 50.0
    assert run(Boat, m, 0.4).speed == pytest.approx(10.0 * math.tanh(1.0), abs=2e-3)


def test_wind_drives_a_boat_until_air_and_water_balance() -> None:
    """windage (w - s)^2 = sway_drag s^2 across: s = w / (1 + sqrt(sway_drag / windage)); along with hull_drag."""
    m = vehicle(Boat, windage=0.2)
    m.wind[:] = (0.0, 12.0, 0.0)
    run(Boat, m, 60.0)
    assert m.velocity.tolist() == pytest.approx([0.0, 12.0 / (1.0 + 5.0), 0.0], abs=1e-3)
    m = vehicle(Boat, windage=0.125)
    m.wind[:] = (-9.0, 0.0, 0.0)
    run(Boat, m, 60.0)
    assert m.velocity.tolist() == pytest.approx([-3.0, 0.0, 0.0], abs=1e-3)


def test_resistances_linear_in_speed() -> None:
    """WAM-V: 100 u + 150 u^2 = thrust ahead, 100 s + 100 s^2 = force across."""
    values = {"mass": 211.0, "hull_drag": 150.0, "linear_drag": 100.0, "sway_drag": 100.0, "sway_linear_drag": 100.0}
    m = vehicle(Boat, thrust_max=2500.0, **values)
    m.motor[1] = 1.0
    m.force[1] = 600.0
    run(Boat, m, 60.0)
    assert m.speed == pytest.approx((-100.0 + math.sqrt(1e4 + 4.0 * 150.0 * 2500.0)) / 300.0, abs=1e-6)
    assert m.slip == pytest.approx(2.0, abs=1e-6)


# ---- linear quadrotor ----------------------------------------------------------------------------------------------


def hovering(**values: Any) -> Any:
    m = vehicle(LinearQuadrotor, **{"position_start[3]": -50.0, **values})
    m.motor[:4] = (m.hover_speed - 100.0) / 1000.0
    return m


@pytest.mark.parametrize("h", [0.0025, 0.0125, 0.5])
def test_a_force_accelerates_the_linear_quadrotor(h: float) -> None:
    m = hovering(mass=1.5)
    m.force[:] = (3.0, -1.5, -0.75)
    run(LinearQuadrotor, m, 2.0, h)
    assert m.velocity.tolist() == pytest.approx([4.0, -2.0, -1.0], abs=1e-9)
    assert m.position.tolist() == pytest.approx([4.0, -2.0, -51.0], abs=1e-9)
    assert m.specific_force.tolist() == pytest.approx([2.0, -1.0, -0.5 - G], abs=1e-9)


def test_ground_effect_lifts_the_linear_quadrotor_by_its_weight() -> None:
    """At hover the thrust is the weight: 5 % more of it accelerate by 0.05 g."""
    m = hovering()
    m.thrust_factor = 1.05
    run(LinearQuadrotor, m, 1.0)
    assert m.velocity[2] == pytest.approx(-0.05 * G, abs=1e-9)


@pytest.mark.parametrize("h", [0.0025, 0.02, 0.1])
def test_wind_and_turning_rotors_move_the_linear_quadrotor_as_an_integrator_of_high_order_says(h: float) -> None:
    """Linear drag 0.6 N s/m, wind, a force and rotors that pitch and roll it: scipy's DOP853 to 1e-9."""
    m = hovering(linear_drag=0.6, yaw_start=0.4)
    m.wind[:] = (4.0, -3.0, 0.5)
    m.force[:] = (0.4, 0.2, -0.3)
    m.motor[:4] += (0.0001, -0.0002, -0.0004, 0.0003)
    slope = math.sqrt(1.545 * G * 5.84e-6)
    w = [100.0 + 1000.0 * float(one) - float(m.hover_speed) for one in m.motor[:4]]
    rolling = 0.247 * slope / 0.03002 * (w[1] - w[0])
    pitching = 0.247 * slope / 0.03057 * (w[2] - w[3])
    lift = slope / 1.545 * sum(w)

    def rates(t: float, x: Any) -> list[float]:
        roll, pitch = 0.5 * rolling * t * t, 0.5 * pitching * t * t
        c, s = math.cos(0.4), math.sin(0.4)
        north, east = G * (-c * pitch - s * roll), G * (c * roll - s * pitch)
        pull = (north + 0.4 / 1.545, east + 0.2 / 1.545, -lift - 0.3 / 1.545)
        drag = [0.6 / 1.545 * (one - v) for one, v in zip((4.0, -3.0, 0.5), x[3:], strict=True)]
        return [*x[3:], *(a + b for a, b in zip(pull, drag, strict=True))]

    yawing = 0.06 * slope / 0.05754 * (w[0] + w[1] - w[2] - w[3])
    assert abs(yawing) < 1e-9  # the heading stays
    run(LinearQuadrotor, m, 1.0, h)
    exact = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0, -50.0, 0.0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose([*m.position, *m.velocity], exact.y[:, -1], atol=1e-9)
    final = rates(1.0, exact.y[:, -1])[3:]
    f = np.linalg.norm(np.array(final) - (0.0, 0.0, G))
    assert np.linalg.norm(m.specific_force) == pytest.approx(f, abs=1e-9)


# ---- off -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", [Rover, Boat, LinearQuadrotor])
def test_wind_alone_changes_nothing_where_its_parameter_is_zero(model: type[Model]) -> None:
    def end(wind: float) -> bytes:
        m = vehicle(model, **({"position_start[3]": -50.0} if model is LinearQuadrotor else {}))
        m.motor[:4] = (0.7, 0.71, 0.72, 0.69)
        m.wind[:] = wind
        run(model, m, 1.0)
        return b"".join(np.array(m[name]).tobytes() for name in ("position", "velocity", "attitude", "specific_force"))

    assert end(0.0) == end(8.0)

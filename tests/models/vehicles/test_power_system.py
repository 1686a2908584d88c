"""The power system against closed forms of its differential equation, and failures at their exact step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cosim_models.vehicles.dynamics.battery import loaded_voltage, rest_voltage, rotor_power
from cosim_models.vehicles.power_system import PowerSystem

H = 0.0025


def system(**parameters: Any) -> Any:
    m = PowerSystem.record()
    m.command[:4], m.rotor_speed[:4] = 0.7, 800.0
    for name, value in parameters.items():
        m[name] = value
    assert PowerSystem.kernels is not None
    assert PowerSystem.kernels[0](m) == 0
    return m


def run(m: Any, seconds: float, h: float = H, begin: float = 0.0) -> Any:
    assert PowerSystem.kernels is not None
    for k in range(round(seconds / h)):
        assert PowerSystem.kernels[1](m, begin + k * h, h) == 0
    return m


POWER = 5.0 + 4.0 * (5.84e-6 * 800.0**2) ** 1.5 / math.sqrt(2.0 * 1.225 * math.pi * 0.127**2) / 0.5
"""That of four rotors at 800 rad/s, by momentum theory at an efficiency of a half, and of the electronics."""


def test_a_hovering_iris_takes_167_watts() -> None:
    speed = math.sqrt(1.545 * 9.80665 / 4.0 / 5.84e-6)
    power = 4.0 * rotor_power(speed, 5.84e-6, 0.127, 0.5)
    assert power == pytest.approx(2.0 * 15.1513 * 5.5237, rel=1e-3)  # twice thrust times induced velocity
    assert 5.1 * 11.1 / power * 60.0 == pytest.approx(20.3, abs=0.2)  # minutes for all of its energy


def test_the_curve_at_rest_and_under_load() -> None:
    assert [rest_voltage(q) for q in (-1.0, 0.0, 0.05, 0.15, 0.95, 1.0)] == pytest.approx(
        [3.0, 3.0, 3.45, 3.71, 4.13, 4.2], abs=1e-12
    )
    v = loaded_voltage(12.6, 0.02, 160.0)
    assert v * (12.6 - v) / 0.02 == pytest.approx(160.0, rel=1e-12)
    assert v > 6.3
    assert loaded_voltage(12.6, 0.02, 2000.0) == 6.3  # more than it can give
    assert loaded_voltage(12.6, 0.0, 160.0) == 12.6


def test_without_resistance_the_discharge_is_that_of_the_closed_form() -> None:
    """dq/dt = -P / (C E(q)), E = a + b q on a piece of the curve: a q + b q^2 / 2 falls by P t / C."""
    m = system(resistance=0.0, charge_start=0.29, capacity=0.5)
    run(m, 8.0)
    b = 3.0 * (3.77 - 3.74) / 0.1
    a = 3.0 * 3.74 - 0.2 * b
    left = a * 0.29 + 0.5 * b * 0.29**2 - POWER * 8.0 / (3600.0 * 0.5)
    exact = (-a + math.sqrt(a * a + 2.0 * b * left)) / b
    assert 0.2 < exact < 0.23
    assert float(m.charge) == pytest.approx(exact, abs=1e-9)


def test_with_resistance_it_is_that_of_a_runge_kutta_method() -> None:
    m = system(resistance=0.05, capacity=0.5)

    def rate(q: float) -> float:
        rest = 3.0 * float(np.interp(q, CHARGE, VOLTS))
        current = (rest - math.sqrt(rest * rest - 4.0 * 0.05 * POWER)) / (2.0 * 0.05)
        return -current / (3600.0 * 0.5)

    exact, h = 1.0, 0.02
    for _ in range(3000):
        one = rate(exact)
        two = rate(exact + 0.5 * h * one)
        three = rate(exact + 0.5 * h * two)
        exact += h / 6.0 * (one + 2.0 * two + 2.0 * three + rate(exact + h * three))
    run(m, 60.0)
    assert 0.3 < exact < 0.7
    assert float(m.charge) == pytest.approx(exact, abs=1e-7)
    assert m.voltage * m.current == pytest.approx(POWER, rel=1e-5)


CHARGE = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
VOLTS = (3.0, 3.45, 3.68, 3.74, 3.77, 3.79, 3.82, 3.87, 3.92, 3.98, 4.06, 4.2)


def test_sag_weakens_the_motors_and_an_empty_battery_stops_them() -> None:
    m = run(system(charge_start=0.5, resistance=0.03), H)
    assert m.motor[0] == pytest.approx(0.7 * float(m.voltage) / 12.6, rel=1e-12)
    assert 0.55 < m.motor[0] < 0.7 * 3.82 / 4.2
    m = run(system(charge_start=0.001, capacity=0.1), 2.5)
    assert (m.charge, m.voltage, m.current, m.motor[0]) == (0.0, 0.0, 0.0, 0.0)
    m = run(system(capacity=0.0), 1.0)
    assert (m.charge, m.motor[0], m.motor[4]) == (1.0, 0.7, 0.0)


def test_motors_fail_at_their_exact_step() -> None:
    """What is given out at the end of a step holds in the vehicle's next one, which begins at the time of failure."""
    m = system(capacity=0.0)
    m.motor_failure[1], m.motor_failure_time[1] = 1.0, 3.0
    m.motor_failure[2], m.motor_failure_time[2] = 0.25, 0.0
    run(m, 3.0 - H)
    assert list(m.motor[:4]) == [0.7, 0.7, 0.7 * 0.75, 0.7]
    run(m, H, begin=3.0 - H)
    assert list(m.motor[:4]) == [0.7, 0.0, 0.7 * 0.75, 0.7]


def test_bad_inputs_are_refused() -> None:
    assert PowerSystem.kernels is not None
    m = system()
    m.rotor_speed[2] = math.nan
    assert PowerSystem.kernels[1](m, 0.0, H) == 2
    assert PowerSystem.errors[2] == "a motor command or a rotor speed is not a finite number"

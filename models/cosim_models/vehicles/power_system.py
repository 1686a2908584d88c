"""The power system FMU: a battery that empties and sags, and motors that fail at set times.

It is connected between an autopilot and a multirotor: motor commands go through it, one step late (2.5 ms). A command
is the duty cycle of a speed controller, so a motor's speed is the command times the voltage; the vehicle's parameters
are those of a full battery at rest. The commands are therefore scaled by the voltage over that of a full battery. An
empty battery is cut off: the commands are zero. A failed motor loses a share of its command.

The charge is integrated by the midpoint rule over the current of the rotors' power (`battery`).
"""

from __future__ import annotations

from math import isfinite
from typing import Any, ClassVar

from cosim import Input, Model, Output, Parameter
from cosim.kernel import kernel
from cosim.vehicle import MAX_MOTORS
from cosim.verdict import Bound
from cosim_models.vehicles.dynamics.battery import FULL_CELL, loaded_voltage, rest_voltage, rotor_power

__all__ = ["PowerSystem"]

_SPEEDS = ("rotor_speed",)
_DIRECT = ("command", "rotor_speed")
_SLACK = 1e-9  # s
_EMPTY = 1e-6  # share of the capacity below which the battery is cut off


@kernel
def _power(m: Any) -> float:
    """Returns the power that rotors and electronics take [W]."""
    power = float(m.electronics_power)
    for i in range(MAX_MOTORS):
        power += rotor_power(float(m.rotor_speed[i]), m.thrust_constant, m.rotor_radius, m.efficiency)
    return power


@kernel
def _charge_rate(m: Any, charge: float, power: float) -> float:
    """Returns the rate of change of the charge [1/s], and sets voltage and current."""
    rest = m.cells * rest_voltage(charge)
    m.voltage = loaded_voltage(rest, m.resistance, power)
    m.current = power / m.voltage if 4.0 * m.resistance * power < rest * rest else 0.5 * rest / m.resistance
    return float(-m.current / (3600.0 * m.capacity))


@kernel
def _publish(m: Any, t: float) -> None:
    """Writes the commands that reach the motors at `t` [s]."""
    scale = m.voltage / (m.cells * FULL_CELL) if m.capacity > 0.0 else 1.0
    for i in range(MAX_MOTORS):
        command = m.command[i] * scale
        if m.motor_failure[i] > 0.0 and t >= m.motor_failure_time[i] - _SLACK:
            command *= 1.0 - m.motor_failure[i]
        m.motor[i] = command


@kernel
def _discharge(m: Any, h: float) -> None:
    """Empties the battery for `h` seconds under the rotors' present power."""
    if m.charge <= _EMPTY:
        m.charge, m.voltage, m.current = 0.0, 0.0, 0.0
        return
    power = _power(m)
    middle = m.charge + 0.5 * h * _charge_rate(m, m.charge, power)
    m.charge = max(m.charge + h * _charge_rate(m, middle, power), 0.0)


@kernel
def start(m: Any) -> int:
    """Begins with the charge of `charge_start`."""
    if m.capacity > 0.0 and not (m.cells >= 1 and m.rotor_radius > 0.0 and m.efficiency > 0.0):
        return 1
    m.charge = m.charge_start
    m.voltage, m.current = m.cells * FULL_CELL, 0.0
    if m.capacity > 0.0:
        _discharge(m, 0.0)
    _publish(m, 0.0)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """Makes one step of `h` seconds: the commands at `t` reach the motors at `t + h`."""
    total = 0.0
    for i in range(MAX_MOTORS):
        total += m.command[i] + m.rotor_speed[i]
    if not isfinite(total):
        return 2
    if m.capacity > 0.0:
        _discharge(m, h)
    _publish(m, t + h)
    return 0


class PowerSystem(Model):
    """Battery with sag, and motors that fail at set times, between an autopilot and a multirotor (default: 3DR Iris).

    The Iris has a battery of 3 cells and 5.1 Ah, and propellers of 10 inches.
    """

    step_size = 0.0025
    variables = (
        Input("command", shape=MAX_MOTORS, unit="1", description="motor commands of the autopilot, 0 to 1"),
        Input("rotor_speed", shape=MAX_MOTORS, unit="rad/s", description="speed of each rotor"),
        Parameter("capacity", unit="Ah", start=5.1, minimum=0.0, description="of the battery; 0: it never empties"),
        Parameter("cells", type=int, start=3, minimum=1, maximum=100, description="lithium-polymer cells in series"),
        Parameter("resistance", unit="V/A", start=0.02, minimum=0.0, description="internal resistance of the battery"),
        Parameter("charge_start", unit="1", start=1.0, minimum=0.0, maximum=1.0, description="initial charge"),
        Parameter("electronics_power", unit="W", start=5.0, minimum=0.0, description="power of everything but motors"),
        Parameter("efficiency", unit="1", start=0.5, minimum=1e-3, description="ideal power over electric power"),
        Parameter("thrust_constant", unit="N.s2/rad2", start=5.84e-6, minimum=0.0, description="that of the vehicle"),
        Parameter("rotor_radius", unit="m", start=0.127, minimum=1e-3, description="radius of each rotor"),
        Parameter(
            "motor_failure",
            shape=MAX_MOTORS,
            unit="1",
            start=0.0,
            minimum=0.0,
            maximum=1.0,
            description="share of its command that each motor loses; 0: it does not fail, 1: it stops",
        ),
        Parameter("motor_failure_time", shape=MAX_MOTORS, unit="s", start=0.0, description="time of each failure"),
        Output("motor", shape=MAX_MOTORS, unit="1", start=0.0, depends=_DIRECT, description="that reach the motors"),
        Output("voltage", unit="V", start=0.0, depends=_SPEEDS, description="of the battery under load; 0: cut off"),
        Output("current", unit="A", start=0.0, depends=_SPEEDS, description="of the battery"),
        Output(
            "charge",
            unit="1",
            start=1.0,
            verdict=Bound(least=_EMPTY, of="capacity", text="its battery is empty"),
            description="remaining charge over the capacity",
        ),
    )
    kernels = (start, advance)
    errors: ClassVar = {
        1: "cells, rotor_radius and efficiency must be positive",
        2: "a motor command or a rotor speed is not a finite number",
    }

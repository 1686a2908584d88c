"""The quadplane: a wing as `FixedWing` has it, a flat plate beyond the stall, and rotors by closed forms."""

from __future__ import annotations

import math
from typing import Any

import pytest
from lxml import etree

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.vehicles.fixed_wing import FixedWing
from cosim_models.vehicles.quadplane import Quadplane
from tests.models.copter import PRESETS, set_values
from tests.models.shipped_kernels import kernels

G, TOP = 9.80665, 18.8589  # N, greatest thrust of a rotor
SIDE = 0.35 * math.sqrt(0.5)


def preset(name: str) -> dict[str, float]:
    root = etree.fromstring((PRESETS / f"{name}.ssv").read_bytes())
    return {one.get("name"): float(one[0].get("value")) for one in root[0] if one[0].tag.endswith("Real")}


def made(model: type[Model] = Quadplane, **values: Any) -> Any:
    m = model.record()
    set_values(m, {"position_start[3]": -500.0, **values})
    assert kernels(model)[0](m) == 0
    m.motor[:4] = (0.5, 0.5, 0.0, 0.5)
    return m


def advanced(m: Any, h: float = 1e-6, model: type[Model] = Quadplane) -> Any:
    assert kernels(model)[1](m, 0.0, h) == 0
    return m


def command(thrust: float) -> float:
    """For a share of the greatest thrust, by the curve of the preset: 0.35 c + 0.65 c^2 from 0.15 to 0.95."""
    return 0.15 + 0.8 * (-0.35 + math.sqrt(0.35**2 + 4.0 * 0.65 * thrust)) / (2.0 * 0.65)


def test_its_numbers_are_those_of_arduplanes_simulation() -> None:
    m = made()
    wing, rotors = preset("ardupilot_plane"), preset("ardupilot_sitl_quad")
    assert m.mass == rotors["mass"] == 1.5 * wing["mass"]
    for name in wing.keys() - {"mass", "inertia[1]", "inertia[2]", "inertia[3]"}:
        assert m[name] == wing[name], name
    assert m.inertia.tolist() == [wing[f"inertia[{i}]"] for i in (1, 2, 3)]
    for name in ("command_min", "command_max", "speed_max", "thrust_expo", "thrust_constant"):
        assert m[name] == rotors[name], name
    hover = (command(m.mass * G / (4.0 * m.thrust_constant * m.speed_max**2)) - 0.15) / 0.8
    assert m.moment_constant == pytest.approx(hover * rotors["moment_constant"], rel=0.01)  # its moment in hover
    assert (m.rotor_time_constant, rotors["time_constant_up"]) == (0.003, 0.0)  # the slew limit, which is none in hover
    for axis in ("rotor_x", "rotor_y", "rotor_direction"):
        assert m[axis].tolist() == pytest.approx([rotors[f"{axis}[{i}]"] for i in (1, 2, 3, 4)], abs=1e-6)
    assert m.airframe == Airframe.quadplane


@pytest.mark.parametrize("alpha", [-3.0, 0.0, 8.0])
def test_before_the_stall_it_is_a_fixed_wing(alpha: float) -> None:
    angle = math.radians(alpha)
    wing = {**preset("ardupilot_plane"), "mass": 3.0}
    one, other = made(), made(FixedWing, **wing)
    for m in (one, other):
        m.velocity[:] = (15.0 * math.cos(angle), 1.0, 15.0 * math.sin(angle))
        m.angular_velocity[:] = (0.1, -0.2, 0.05)
        m.motor[:4] = (0.6, 0.45, 0.7, 0.4)
    advanced(one)
    advanced(other, model=FixedWing)
    assert one.specific_force.tolist() == pytest.approx(other.specific_force.tolist(), rel=1e-6)
    assert one.angular_velocity.tolist() == pytest.approx(other.angular_velocity.tolist(), rel=1e-9)


def test_sinking_flat_it_is_a_flat_plate() -> None:
    """C_N = 2 sin^2 alpha = 2 at 90 degrees, in the middle of the chord, beside the drag of the body."""
    m = made()
    m.velocity[:] = (0.0, 0.0, 4.0)
    advanced(m)
    area = 0.5 * 1.225 * 4.0**2 * 0.45
    assert m.specific_force[2] == pytest.approx(-area * 2.1 / 3.0, rel=1e-5)
    arm = 0.24 * (0.25 + 5.127994 / 6.9)
    assert m.angular_velocity[1] == pytest.approx(-1e-6 * area * 2.0 * arm, rel=1e-4)


def test_its_rotors_lift_and_turn_it() -> None:
    """Shares of the greatest thrust: their sum lifts; their differences, at 0.35 m, roll, pitch and yaw it."""
    m = made()
    for share in ((0.39, 0.39, 0.39, 0.39), (0.5, 0.2, 0.3, 0.1)):
        m.motor[4:] = [command(one) for one in share]
        advanced(m, 0.1)  # 30 times the lag
        m.velocity[:], m.angular_velocity[:], m.attitude[:] = 0.0, 0.0, (1.0, 0.0, 0.0, 0.0)
        advanced(m)
        a, b, c, d = (TOP * one for one in share)  # front right, rear left, front left, rear right
        assert m.specific_force[2] == pytest.approx(-(a + b + c + d) / 3.0, rel=1e-4)
        turned = (SIDE * (b + c - a - d), SIDE * (a + c - b - d), 0.0096 * (a + b - c - d))
        assert m.angular_velocity.tolist() == pytest.approx([1e-6 * one for one in turned], rel=1e-3, abs=1e-12)
    assert pytest.approx(3.0 * G, rel=1e-3) == 4.0 * 0.39 * TOP


def test_the_ground_lifts_it_and_rotors_need_a_thrust() -> None:
    m = made()
    m.motor[4:], m.thrust_factor = command(0.39), 1.1
    advanced(m, 0.1)
    m.velocity[:] = 0.0
    advanced(m)
    assert m.specific_force[2] == pytest.approx(-1.1 * G, rel=1e-3)
    m = Quadplane.record()
    m.thrust_constant = 0.0
    assert kernels(Quadplane)[0](m) == 5 and "thrust_constant" in Quadplane.errors[5]

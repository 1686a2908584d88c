"""The presets of multirotors: complete, about existing parameters, and with the hover figures of their sources."""

from __future__ import annotations

import math
from importlib import resources
from typing import Any

import pytest
from lxml import etree

from cosim import Model
from cosim.model import flat_variables
from cosim_models.vehicles.dynamics.rotor import MotorCurve
from cosim_models.vehicles.hexarotor import Hexarotor
from cosim_models.vehicles.octorotor import Octorotor
from cosim_models.vehicles.quadrotor import Quadrotor
from cosim_models.vehicles.y6 import Y6
from tests.models.shipped_kernels import kernels

G = 9.80665
PRESETS = {
    file.name.removesuffix(".ssv"): file
    for file in (resources.files("cosim_models.vehicles") / "presets").iterdir()
    if file.name.endswith(".ssv") and b"rotor_count" in file.read_bytes()
}
"""Those of multirotors; test_presets_of_others has the others."""
MODELS: dict[str, type[Model]] = {"ardupilot_sitl_hexa": Hexarotor, "ardupilot_sitl_y6": Y6, "mrs_naki_octa": Octorotor}
"""The model of a preset that is none of `Quadrotor`."""
NOT_OF_THE_VEHICLE = ("position_start", "yaw_start", "ground_", "foot_", "substep")
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"


def values(name: str) -> dict[str, Any]:
    """Parameter name to value, as a strict reader of SSP 1.0 parameter values would give it."""
    root = etree.fromstring(PRESETS[name].read_bytes())
    assert root.tag == f"{SSV}ParameterSet"
    assert root.get("version") == "1.0"
    assert root.get("name") == name
    (parameters,) = root
    found: dict[str, Any] = {}
    for parameter in parameters:
        (value,) = parameter
        key, text = parameter.get("name"), value.get("value")
        assert key not in found
        types = {
            f"{SSV}Real": float,
            f"{SSV}Integer": int,
            f"{SSV}Boolean": {"false": False, "true": True}.__getitem__,
            f"{SSV}Enumeration": lambda t: MotorCurve[t],
        }
        found[key] = types[value.tag](text)
    return found


def model_of(name: str) -> type[Model]:
    return MODELS.get(name, Quadrotor)


def with_preset(name: str) -> Any:
    m = model_of(name).record()
    for key, value in values(name).items():
        array, _, index = key.partition("[")
        if index:
            m[array][int(index[:-1]) - 1] = value
        else:
            m[key] = value
    assert kernels(model_of(name))[0](m) == 0
    return m


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_sets_every_parameter_of_the_vehicle(name: str) -> None:
    given = values(name)
    known = {f.name: f.variable for f in flat_variables(model_of(name).variables) if f.variable.role == "parameter"}
    assert set(given) <= set(known)
    kinds = {float: "Real", int: "Integer", bool: "Boolean", MotorCurve: "Enumeration"}
    assert all(kinds[type(value)] == known[key].kind for key, value in given.items())
    spare = {f"rotor_{axis}[{i}]" for axis in ("x", "y", "z", "direction") for i in range(given["rotor_count"] + 1, 9)}
    wanted = {key for key in known if not key.startswith(NOT_OF_THE_VEHICLE)} - spare
    assert set(given) == wanted


@pytest.mark.parametrize("name", MODELS)
def test_arms_and_turns_are_those_of_the_model(name: str) -> None:
    """The rotors of the preset stand in the directions of the model's, on arms of one length, and turn alike."""
    ours, default = with_preset(name), model_of(name).record()
    arm = {"mrs_naki_octa": 0.4}.get(name, 0.35)
    for i in range(ours.rotor_count):
        assert math.hypot(ours.rotor_x[i], ours.rotor_y[i]) == pytest.approx(arm, abs=1e-6)
        angles = [math.atan2(one.rotor_y[i], one.rotor_x[i]) for one in (ours, default)]
        assert math.cos(angles[0] - angles[1]) == pytest.approx(1.0)
    assert ours.rotor_direction.tolist() == default.rotor_direction.tolist()


def test_the_px4_iris_is_the_default() -> None:
    defaults = {f.name: f.start for f in flat_variables(Quadrotor.variables)}
    assert all(defaults[key] == value for key, value in values("px4_iris").items())


@pytest.mark.parametrize(
    ("name", "hover", "thrust_over_weight"),
    [
        ("px4_iris", 805.0, 1.87),
        ("rotors_iris", 660.0, 1.61),
        ("ardupilot_gazebo_iris", 445.0, 3.55),
        ("crazyflie", math.sqrt(0.027 * G / (4.0 * 3.16e-10)) * math.pi / 30.0, 2.25),
        ("ardupilot_sitl_quad", 1000.0 * math.sqrt(0.39), 1.0 / 0.39),
        ("ardupilot_json", 1000.0 * math.sqrt(0.39), 1.0 / 0.39),
        ("ardupilot_sitl_hexa", 1000.0 * math.sqrt(0.39), 1.0 / 0.39),
        ("ardupilot_sitl_y6", 1000.0 * math.sqrt(0.39), 1.0 / 0.39),
        # 7.5 kg on eight propellers of 5.7658e-7 N / rpm^2 with at most 6376 rpm
        ("mrs_naki_octa", 3993.2 * math.pi / 30.0, (6376.0 / 3993.2) ** 2),
    ],
)
def test_hover(name: str, hover: float, thrust_over_weight: float) -> None:
    m = with_preset(name)
    speed = math.sqrt(m.mass * G / (m.rotor_count * m.thrust_constant))
    assert speed == pytest.approx(hover, abs=0.6)
    assert (m.speed_max / speed) ** 2 == pytest.approx(thrust_over_weight, abs=0.01)


@pytest.mark.parametrize("name", PRESETS)
def test_it_flies(name: str) -> None:
    """Full command lifts it with the acceleration of its thrust over weight, until drag matters."""
    m = with_preset(name)
    m.motor[: m.rotor_count] = 1.0
    for k in range(80):
        assert kernels(model_of(name))[1](m, 0.0025 * k, 0.0025) == 0
    thrust = m.rotor_count * m.thrust_constant * m.speed_max**2 / m.mass
    loss = 1.0 - abs(m.velocity[2]) / m.axial_speed_limit if m.axial_speed_limit else 1.0
    drag = m.rotor_count * m.rotor_drag * m.speed_max * abs(m.velocity[2]) / m.mass if m.drag_by_axis else 0.0
    assert -m.specific_force[2] == pytest.approx(thrust * loss - drag, rel=0.03)
    assert not m.on_ground


def test_sitl_quad_has_the_drag_of_its_source_at_45_degrees() -> None:
    """Level flight at the reference speed, nose down by 45 degrees, with thrust m g sqrt(2).

    SIM_Frame.cpp chooses the drag area so that momentum drag and drag along the motion balance the lean, and then
    applies it to each axis of the body by the speed along it: 1 - sqrt(1/2) of the drag are missing. SIM_Motor.cpp
    applies momentum drag along the rotors' axis, too, for which the choice does not account, and subtracts the square
    of the inflow's speed from that of the outflow.
    """
    m = with_preset("ardupilot_sitl_quad")
    m.attitude[:] = (math.cos(math.pi / 8), 0.0, -math.sin(math.pi / 8), 0.0)
    m.velocity[0] = 15.08
    m.position[2] = -500.0
    speed = math.sqrt(m.mass * G * math.sqrt(2.0) / (4.0 * m.thrust_constant))
    m.rotor_speed[:4] = speed
    part = (speed / m.speed_max) ** 2
    command = (-0.35 + math.sqrt(0.35**2 + 4.0 * 0.65 * part)) / 1.3
    m.motor[:4] = 0.15 + 0.8 * command
    assert kernels(Quadrotor)[1](m, 0.0, 0.001) == 0
    half, density = math.sqrt(0.5), 1.225 * (1.0 - 2.25577e-5 * 593.0) ** 4.2559
    momentum_drag = half * 0.2 * 15.08 * half * math.sqrt(m.mass * G / half * density * 0.385)
    missing = ((m.mass * G - momentum_drag) * (1.0 - half) - momentum_drag) / m.mass
    hover_outflow = 2.0 * 29.3 * 12.09 / (m.mass * G)  # m/s, by current and voltage in hover
    lost = (15.08 * half / hover_outflow) ** 2 * half  # share of the thrust
    momentum_drags = 2.0 * momentum_drag * (math.sqrt(1.0 - lost) - 1.0) / m.mass  # by what is left, along both axes
    assert (m.velocity[0] - 15.08) / 0.001 == pytest.approx(missing - lost * G - momentum_drags, abs=0.01 * G)


def test_the_json_body_hovers_at_the_recorded_command() -> None:
    """ArduCopter's recorded flights on this body end in hover at 1590.7 us on all motors."""
    m = with_preset("ardupilot_json")
    m.position[2] = -100.0
    m.motor[:4] = 0.5907
    for k in range(400):
        assert kernels(Quadrotor)[1](m, 0.0025 * k, 0.0025) == 0
    thrust = 4.0 * m.thrust_constant * m.rotor_speed[0] ** 2
    assert thrust == pytest.approx(m.mass * G, rel=1e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_it_stands_and_survives_a_fall(name: str) -> None:
    start, advance = kernels(model_of(name))
    m = with_preset(name)
    for k in range(2000):
        assert advance(m, 0.0025 * k, 0.0025) == 0
    assert abs(m.position).max() < 1e-12
    m.position_start[2] = -3.0
    assert start(m) == 0
    m.angular_velocity[:] = (1.0, 2.0, 0.5)
    for k in range(6000):
        assert advance(m, 0.0025 * k, 0.0025) == 0
    assert abs(m.velocity).max() < 1e-9
    assert abs(m.angular_velocity).max() < 1e-9
    assert m.on_ground

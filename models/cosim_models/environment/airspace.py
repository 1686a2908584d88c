"""The airspace FMU: wind for all vehicles, and the effects of vehicles, ground and obstacles on each of them.

It sees position and velocity of every vehicle and gives each of them the velocity of the air (`wind`), a force and a
factor of its thrust, by the inputs of these names that vehicles have. Mass, rotor area and size of a vehicle are those
of its airframe. Everything is off by default and is switched on
by parameters:

    mean_wind                                   constant wind (tunable)
    gust, gust_time, ...                        a discrete gust (`gust`)
    turbulence_wind, turbulence_height, seed    Dryden turbulence (`turbulence`), renewed 50 times a second
    downwash                                    the air below hovering vehicles moves down (`rotors`)
    ground_effect                               more thrust close to the ground, to roofs and to terrain (`rotors`)
    contact                                     vehicles, obstacles and terrain push (`contact`)

The time for a step is linear in the number of vehicles (`grid`). Not here: the wind's profile over height, and its
change behind obstacles.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import Any, ClassVar

from cosim import Input, Memory, Model, Output, Parameter, Variable
from cosim.kernel import kernel
from cosim.vehicle import Airframe
from cosim.verdict import Role
from cosim_models.environment.contact import (
    BOXES,
    CYLINDERS,
    TERRAIN,
    kind_of,
    obstacle_forces,
    pair_force,
    surface_below,
)
from cosim_models.environment.grid import fill, first_in, next_in
from cosim_models.environment.gust import gust_share
from cosim_models.environment.rotors import GRAVITY, ground_effect, wake_velocity, wake_width
from cosim_models.environment.turbulence import WAVES, raise_field, turbulence_at

__all__ = ["CAPACITY", "LARGE", "Airspace", "LargeAirspace"]

CAPACITY, LARGE = 256, 4096
"""Vehicles that one `Airspace` and one `LargeAirspace` can have."""

_ERRORS = {1: "a position or a velocity is not a finite number"}
_OPEN = Role.OPTIONAL  # those beyond `count`
KINDS = len(Airframe)
_SLACK = 1e-9  # s
_RENEWAL = 0.02  # s between two values of the turbulence
_REACH = 3.0  # widths of a wake, beyond which its velocity is less than a hundredth of that on its axis


@kernel
def _weight(m: Any, i: int) -> float:
    return float(m.mass[kind_of(m, i)] * GRAVITY)


@kernel
def _rotor_area(m: Any, i: int) -> float:
    return float(m.rotor_area[kind_of(m, i)])


@kernel
def _blow(m: Any, t: float) -> None:
    """Sets the wind at each vehicle without the wakes of others, at `t` [s]."""
    is_gusty = m.gust[0] != 0.0 or m.gust[1] != 0.0 or m.gust[2] != 0.0
    is_new = m.turbulence_wind > 0.0 and t >= m.renewal - _SLACK
    if is_new:
        m.renewal = t + _RENEWAL
    for i in range(m.count):
        n, e, d = float(m.position[3 * i]), float(m.position[3 * i + 1]), float(m.position[3 * i + 2])
        if is_new:
            one = turbulence_at(m, n - m.drift[0], e - m.drift[1], d - m.drift[2])
            m.turbulent[i, 0], m.turbulent[i, 1], m.turbulent[i, 2] = one[0], one[1], one[2]
        share = gust_share(m, t, n * m.axis[0] + e * m.axis[1]) if is_gusty else 0.0
        for j in range(3):
            m.wind[3 * i + j] = m.mean_wind[j] + share * m.gust[j] + m.turbulent[i, j]


@kernel
def _meet(m: Any, i: int) -> None:
    """Adds the effects of the vehicles near vehicle `i` to its wind and force."""
    fn = fe = fd = down = 0.0
    for a in range(-1, 2):
        for b in range(-1, 2):
            north, east = int(m.cell_north[i]) + a, int(m.cell_east[i]) + b
            j = first_in(m, north, east)
            while j >= 0:
                if j != i:
                    if m.contact:
                        f = pair_force(m, i, j)
                        fn, fe, fd = fn + f[0], fe + f[1], fd + f[2]
                    depth = m.position[3 * i + 2] - m.position[3 * j + 2]
                    if m.downwash and 0.0 < depth <= m.wake_depth:
                        x = m.position[3 * i] - m.position[3 * j]
                        y = m.position[3 * i + 1] - m.position[3 * j + 1]
                        down += wake_velocity(depth, sqrt(x * x + y * y), _weight(m, j), _rotor_area(m, j))
                j = next_in(m, j, north, east)
    m.force[3 * i] += fn
    m.force[3 * i + 1] += fe
    m.force[3 * i + 2] += fd
    m.wind[3 * i + 2] += down


@kernel
def _lift(m: Any, i: int) -> float:
    """Returns the thrust factor of vehicle `i`."""
    vn, ve = m.velocity[3 * i] - m.wind[3 * i], m.velocity[3 * i + 1] - m.wind[3 * i + 1]
    height = m.ground_height - m.position[3 * i + 2] - surface_below(m, i)
    return ground_effect(height, sqrt(vn * vn + ve * ve), _weight(m, i), _rotor_area(m, i))


@kernel
def _publish(m: Any, t: float) -> None:
    """Computes all outputs for `t` [s] from the positions known by then."""
    _blow(m, t)
    if m.contact or m.downwash:
        fill(m, m.cell)
    for i in range(m.count):
        m.force[3 * i] = m.force[3 * i + 1] = m.force[3 * i + 2] = 0.0
        if m.contact:
            f = obstacle_forces(m, i)
            m.force[3 * i], m.force[3 * i + 1], m.force[3 * i + 2] = f[0], f[1], f[2]
        if m.contact or m.downwash:
            _meet(m, i)
        m.thrust_factor[i] = _lift(m, i) if m.ground_effect else 1.0


@kernel
def _are_finite(m: Any) -> bool:
    total = 0.0
    for i in range(3 * m.count):
        total += m.position[i] + m.velocity[i]
    return bool(isfinite(total))


@kernel
def start(m: Any) -> int:
    """Draws the turbulence, and chooses cells that are as wide as the effects of vehicles reach.

    Until the first step, there is the mean wind and nothing else: outputs that depend on thousands of inputs during
    initialization would have millions of dependencies in the model description.
    """
    m.cell = 0.1
    for i in range(KINDS):
        m.cell = max(m.cell, 2.0 * m.radius[i])
        if m.downwash and m.rotor_area[i] > 0.0:
            m.cell = max(m.cell, _REACH * wake_width(m.wake_depth, m.rotor_area[i]))
    raise_field(m)
    for i in range(m.count):
        for j in range(3):
            m.wind[3 * i + j] = m.mean_wind[j]
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """Makes one step of `h` seconds."""
    if not _are_finite(m):
        return 1
    for j in range(3):
        m.drift[j] += m.mean_wind[j] * h
    _publish(m, t + h)
    return 0


def _number(name: str, unit: str, start: float, description: str, minimum: float | None = 0.0) -> Variable:
    return Parameter(name, unit=unit, start=start, minimum=minimum, description=description)


def _each(name: str, unit: str, start: float, count: int, description: str) -> Variable:
    return Parameter(name, shape=count, unit=unit, start=start, description=description)


def _by_kind(name: str, unit: str, least: float, description: str, **start: float) -> Variable:
    """Declares a parameter with an element for each airframe; `start` by name of the airframe."""
    values = tuple(start[one.name] for one in Airframe)
    text = f"{description}, by airframe: {', '.join(one.name for one in Airframe)}"
    return Parameter(name, shape=len(Airframe), unit=unit, start=values, minimum=least, description=text)


_KINDS = (
    _by_kind(
        "mass", "kg", 1e-3, "of a vehicle",
        quad_x=1.545, hexa_x=1.544, octa_x=3.0, y6=1.544, point_mass=1.5, rover=2.0, boat=2.0, plane=13.5,
        quad_plus=1.545, quadplane=3.0,
    ),
    _by_kind(
        "rotor_area", "m2", 0.0, "area of all rotor discs of a vehicle; 0: none",
        quad_x=0.2027, hexa_x=0.1946, octa_x=0.4054, y6=0.0973, point_mass=0.2027, rover=0.0, boat=0.0, plane=0.0,
        quad_plus=0.2027, quadplane=0.385,
    ),
    _by_kind(
        "radius", "m", 0.0, "of the sphere that a vehicle is to others",
        quad_x=0.35, hexa_x=0.35, octa_x=0.5, y6=0.35, point_mass=0.35, rover=0.3, boat=0.3, plane=1.4,
        quad_plus=0.35, quadplane=1.0,
    ),
)  # fmt: skip
_WIND = (
    Parameter("mean_wind", shape=3, unit="m/s", start=0.0, tunable=True, description="velocity of the air, NED"),
    Parameter("gust", shape=3, unit="m/s", start=0.0, description="velocity that a gust adds, NED"),
    _number("gust_time", "s", 0.0, "time at which the gust's front is at the origin"),
    _number("gust_length", "m", 20.0, "distance over which the gust rises to its full strength", 1e-3),
    _number("gust_speed", "m/s", 10.0, "speed at which the front travels in the direction of the mean wind", 1e-3),
    _number("gust_hold", "s", 1e9, "time at full strength, after which the gust ends as it began"),
    _number("turbulence_wind", "m/s", 0.0, "mean wind at 20 ft that sets the strength of the turbulence; 0: none"),
    _number("turbulence_height", "m", 10.0, "height above ground that sets strength and scales of the turbulence"),
    Parameter("seed", type=int, start=1, description="seed of the turbulence"),
)
_EFFECTS = (
    Parameter("downwash", type=bool, start=False, description="vehicles blow down on those below"),
    _number("wake_depth", "m", 10.0, "depth to which wakes are felt", 1e-3),
    Parameter("ground_effect", type=bool, start=False, description="thrust grows close to the ground"),
    Parameter("contact", type=bool, start=False, description="vehicles, obstacles and terrain push"),
    _number("contact_time", "s", 0.1, "duration of a contact without damping", 1e-3),
    _number("contact_damping", "1", 0.5, "damping ratio of a contact"),
    _number("contact_friction", "1", 0.3, "Coulomb friction coefficient"),
)
_OBSTACLES = (
    Parameter("boxes", type=int, start=0, minimum=0, maximum=BOXES, description="number of boxes"),
    _each("box_north", "m", 0.0, BOXES, "centre of each box"),
    _each("box_east", "m", 0.0, BOXES, "centre of each box"),
    _each("box_length", "m", 1.0, BOXES, "extent to the north"),
    _each("box_width", "m", 1.0, BOXES, "extent to the east"),
    _each("box_height", "m", 1.0, BOXES, "height above the ground"),
    Parameter("cylinders", type=int, start=0, minimum=0, maximum=CYLINDERS, description="number of upright cylinders"),
    _each("cylinder_north", "m", 0.0, CYLINDERS, "axis of each cylinder"),
    _each("cylinder_east", "m", 0.0, CYLINDERS, "axis of each cylinder"),
    _each("cylinder_radius", "m", 1.0, CYLINDERS, "radius"),
    _each("cylinder_height", "m", 1.0, CYLINDERS, "height above the ground"),
    _number("ground_height", "m", 0.0, "down coordinate of the ground", None),
    _number("terrain_spacing", "m", 0.0, "distance of the points of the terrain's grid; 0: no terrain"),
    _each("terrain_origin", "m", 0.0, 2, "place of the grid's first point, north and east"),
    _each(
        "terrain",
        "m",
        0.0,
        TERRAIN * TERRAIN,
        f"heights above the ground: {TERRAIN} points to the east, then the next row to the north",
    ),
)


def _variables(capacity: int) -> tuple[Variable, ...]:
    """Returns the variables of an airspace for up to `capacity` vehicles."""
    return (
        Input("position", shape=3 * capacity, unit="m", verdict=_OPEN, description="three elements each, NED"),
        Input("velocity", shape=3 * capacity, unit="m/s", verdict=_OPEN, description="three elements each, NED"),
        Input("airframe", type=Airframe, shape=capacity, verdict=_OPEN, description="of each vehicle"),
        Parameter("count", type=int, start=1, minimum=1, maximum=capacity, description="number of vehicles"),
        *_KINDS,
        *_WIND,
        *_EFFECTS,
        *_OBSTACLES,
        Output("wind", shape=3 * capacity, unit="m/s", start=0.0, description="velocity of the air at each, NED"),
        Output("force", shape=3 * capacity, unit="N", start=0.0, description="on each vehicle, NED"),
        Output("thrust_factor", shape=capacity, unit="1", start=1.0, description="thrust of each over that far away"),
        Memory("head", dtype="i4", shape=max(2 * capacity, 2048)),
        Memory("next", dtype="i4", shape=capacity),
        Memory("cell_north", dtype="i4", shape=capacity),
        Memory("cell_east", dtype="i4", shape=capacity),
        Memory("cell"),  # m
        Memory("turbulent", shape=(capacity, 3)),  # m/s, NED
        Memory("renewal"),  # s
        Memory("drift", shape=3),  # displacement of the air since the start, m, NED
        Memory("axis", shape=2),  # direction of the mean wind at the start, north and east
        Memory("amplitude", shape=3),  # m/s
        Memory("waves", shape=(3, WAVES, 3)),  # rad/m, NED
        Memory("phase", shape=(3, WAVES)),  # rad
    )


class Airspace(Model):
    """Wind, gusts, turbulence, downwash, ground effect, contact and obstacles for up to 256 vehicles."""

    step_size = 0.005
    variables = _variables(CAPACITY)
    kernels = (start, advance)
    errors: ClassVar = _ERRORS


class LargeAirspace(Model):
    """An airspace for up to 4096 vehicles."""

    step_size = Airspace.step_size
    variables = _variables(LARGE)
    kernels = (start, advance)
    errors: ClassVar = _ERRORS

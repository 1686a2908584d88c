"""Meaning of a model's variables, declared with the model, so that a master needs no knowledge of model names.

    Output("state", type=Task, verdict=Condition(failed=(Task.failed,), working=(Task.formation,), reason="failure"))
    Output("failure", type=Failure, verdict=Reason(((Failure.not_armed, "its autopilot does not arm"),)))
    Output("age", unit="s", verdict=Bound(most="stale_time", text="its neighbour is not heard"))
    Output("position", shape=3, unit="m", verdict=Role.POSITION)
    Output("target", unit="m", verdict=Formation(step="step", neighbours=(Neighbour("left", "gain"),)))
    Output("mode", type=Mode, verdict=Logged((("MODE", "mode"), ("ATT", "q"))))

The declarations are written to the vendor annotation `org.uav-cosim.verdict` of the model description (`cosim.build`).
A master reads them to judge and draw the behaviour of a swarm, to write systems, and to find the ports of gateways.
They do not affect the computation of a model.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Any, Protocol, TypeAlias

__all__ = [
    "ANNOTATION",
    "Bound",
    "Condition",
    "Formation",
    "Logged",
    "Neighbour",
    "Reason",
    "Role",
    "Rotors",
    "Values",
    "Verdict",
    "complaints",
    "references",
]

ANNOTATION = "org.uav-cosim.verdict"
"""Name of the vendor annotation: the name of FMI 2's Tool, the type of FMI 3's Annotation."""


@dataclass(frozen=True, slots=True)
class Condition:
    """An output that reports the activity of its instance. Each field holds values of the output, or names a variable.

    Attributes:
        failed: values that mean that the instance has given up.
        working: values that mean that the instance performs its task. Bounds of the same instance apply while the
            output has one of these values.
        commanding: values with which the instance commands the connected vehicle to be in the air.
        by: a Real parameter: the time in s by which the instance is expected to be working.
        reason: the output, declared as `Reason`, that gives the reason for failure.
    """

    failed: tuple[int, ...]
    working: tuple[int, ...] = ()
    commanding: tuple[int, ...] = ()
    by: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Reason:
    """An output that gives the reason why its instance failed. `texts`: values and their descriptions for people."""

    texts: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Bound:
    """A scalar output that stays within `least` and `most` in normal operation.

    Attributes:
        most: a number, or the name of a parameter that holds the upper bound.
        least: a number.
        of: a parameter; the bound applies only if its value is not 0.
        text: explanation for people if the output is out of bounds.
    """

    most: float | str = inf
    least: float = -inf
    of: str = ""
    text: str = ""


@dataclass(frozen=True, slots=True)
class Values:
    """An input that accepts only these values, or an output that has no other ones, of an enumeration.

    From both, a master sees before anything runs which autopilot fits a vehicle.
    """

    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A term of a linear law: `gain` times the difference between a neighbour's value and the agent's own value.

    Attributes:
        id: an Integer parameter, the MAVLink system id of the neighbour; 0 means that there is no neighbour and no
        term.
        gain: a number, or the name of a Real parameter that holds it [1].
    """

    id: str
    gain: float | str


@dataclass(frozen=True, slots=True)
class Formation:
    """A Real output of an agent: its desired position on a line that runs east from the local origin [m].

    In each step, the agent changes the value by the sum of its neighbours' terms. The terms determine the positions at
    which a line settles, and the rate of convergence.

    Attributes:
        step: an Integer output, the number of the current step; 0 before the first step.
        stays: a Boolean parameter; if true, the agent keeps its initial position.
        neighbours: the terms of the law, from west to east; empty if the agent follows a different law.
        begin: a Real parameter, the start time of step 1 [s].
        period: a Real parameter, the maximum duration of a step [s].
    """

    step: str
    stays: str = ""
    neighbours: tuple[Neighbour, ...] = ()
    begin: str = ""
    period: str = ""


@dataclass(frozen=True, slots=True)
class Rotors:
    """An output of Reals: the speed of each rotor [rad/s], by which a vehicle is drawn. Each field names a parameter.

    Attributes:
        count: Integer: rotors in use, the first ones of the arrays.
        forward, right, down: Reals, one for each rotor: positions of the hubs, FRD from the centre of mass [m].
        direction: Reals, one for each rotor: +1 turns counter-clockwise seen from above, -1 clockwise.
    """

    count: str
    forward: str
    right: str
    down: str
    direction: str

    @property
    def arrays(self) -> tuple[str, str, str, str]:
        return (self.forward, self.right, self.down, self.direction)


@dataclass(frozen=True, slots=True)
class Logged:
    """An output of an instance whose inner values a DataFlash log shows.

    Attributes:
        variables: pairs of a place in such a log and the variable that it shows, e.g. ("ATT.Des", "attitude_target").
            `cosim_master.results.export.dataflash` lists the places, with units and numbers of elements.
    """

    variables: tuple[tuple[str, str], ...]


class Role(Enum):
    """Role of a variable for a master. The value is the name of the element in the annotation."""

    POSITION = "Position"
    """Output of 3 Reals: position of a body, NED from the local origin [m]."""
    ATTITUDE = "Attitude"
    """Output of 4 Reals: unit quaternion w, x, y, z that rotates FRD of a body into NED."""
    VELOCITY = "Velocity"
    """Output of 3 Reals: velocity of a body over ground, NED [m/s]."""
    ANGULAR_VELOCITY = "AngularVelocity"
    """Output of 3 Reals: angular velocity of a body, FRD [rad/s]."""
    ON_GROUND = "OnGround"
    """Boolean output of a body: true while the body stands on the ground."""
    ARMED = "Armed"
    """Boolean output: true while the motors may turn."""
    DESIRED_POSITION = "DesiredPosition"
    """Output of 3 Reals: commanded position of the connected vehicle at this time, NED from the local origin [m]."""
    START_POSITION = "StartPosition"
    """Parameter of 3 Reals: initial position of a body, NED from the local origin [m]."""
    ORIGIN_LATITUDE = "OriginLatitude"
    """Real parameter: geodetic latitude of the local origin [rad]."""
    ORIGIN_LONGITUDE = "OriginLongitude"
    """Real parameter: geodetic longitude of the local origin [rad]."""
    ORIGIN_ALTITUDE = "OriginAltitude"
    """Real parameter: altitude of the local origin above mean sea level [m]."""
    JAMMED_RADIUS = "JammedRadius"
    """Real parameter: radius of an area in which the instance's satellite navigation is jammed [m]; 0: none."""
    JAMMED_NORTH = "JammedNorth"
    """Real parameter: north of that area's centre from the local origin [m]."""
    JAMMED_EAST = "JammedEast"
    """Real parameter: east of that area's centre [m]."""
    JAMMED_FROM = "JammedFrom"
    """Real parameter: beginning of the jamming [s]."""
    JAMMED_UNTIL = "JammedUntil"
    """Real parameter: end of the jamming [s]."""
    SYSTEM_ID = "SystemId"
    """Integer parameter: the MAVLink system id of the instance."""
    TELEMETRY = "Telemetry"
    """Packet port that connects to ground stations by radio, and to nothing else."""
    SERIAL = "Serial"
    """Packet port that connects to the program at the other end of a cable, and to nothing else."""
    OPTIONAL = "Optional"
    """Input that may stay unconnected, because its start value is meaningful; or output that has a meaning only where
    it is connected: elsewhere, it is recorded only on request."""


Verdict: TypeAlias = Condition | Reason | Bound | Formation | Rotors | Logged | Values | Role


class Declared(Protocol):
    """The attributes of a declared variable that this module reads."""

    @property
    def name(self) -> str: ...
    @property
    def role(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def verdict(self) -> Verdict | None: ...


_WHOLE = ("Enumeration", "Integer", "Boolean")
_VECTOR, _SCALAR = (3,), ()
_PLACES: Mapping[object, tuple[str, tuple[str, ...], tuple[int, ...]]] = {
    Condition: ("output", _WHOLE, _SCALAR),
    Reason: ("output", ("Enumeration", "Integer"), _SCALAR),
    Bound: ("output", ("Real", "Integer"), _SCALAR),
    Formation: ("output", ("Real",), _SCALAR),
    Role.POSITION: ("output", ("Real",), _VECTOR),
    Role.ATTITUDE: ("output", ("Real",), (4,)),
    Role.VELOCITY: ("output", ("Real",), _VECTOR),
    Role.ANGULAR_VELOCITY: ("output", ("Real",), _VECTOR),
    Role.ON_GROUND: ("output", ("Boolean",), _SCALAR),
    Role.ARMED: ("output", ("Boolean",), _SCALAR),
    Role.DESIRED_POSITION: ("output", ("Real",), _VECTOR),
    Role.START_POSITION: ("parameter", ("Real",), _VECTOR),
    Role.ORIGIN_LATITUDE: ("parameter", ("Real",), _SCALAR),
    Role.ORIGIN_LONGITUDE: ("parameter", ("Real",), _SCALAR),
    Role.ORIGIN_ALTITUDE: ("parameter", ("Real",), _SCALAR),
    Role.JAMMED_RADIUS: ("parameter", ("Real",), _SCALAR),
    Role.JAMMED_NORTH: ("parameter", ("Real",), _SCALAR),
    Role.JAMMED_EAST: ("parameter", ("Real",), _SCALAR),
    Role.JAMMED_FROM: ("parameter", ("Real",), _SCALAR),
    Role.JAMMED_UNTIL: ("parameter", ("Real",), _SCALAR),
    Role.SYSTEM_ID: ("parameter", ("Integer",), _SCALAR),
}
"""Role, kinds and shape of the variables that may have a verdict, except for ports, Rotors, Logged and Values."""


def complaints(variables: Iterable[Declared]) -> list[str]:
    """Returns the errors in the verdicts of a declaration, one sentence each."""
    known = {v.name: v for v in variables}
    found: list[str] = []
    for v in known.values():
        verdict: Any = v.verdict
        if verdict is None:
            continue
        if verdict in (Role.OPTIONAL, Role.TELEMETRY, Role.SERIAL):
            found += _complaint_of_port(v, verdict)
            continue
        if isinstance(verdict, Rotors):
            found += _complaints_of_rotors(v, verdict, known)
            continue
        if isinstance(verdict, Logged):
            missing = [name for _, name in verdict.variables if name not in known]
            found += [f"{v.name}: verdict Logged is for an output"] if v.role != "output" else []
            found += [f"{v.name}: its verdict refers to {name}, but there is no such variable" for name in missing]
            continue
        if isinstance(verdict, Values):
            if v.role not in ("input", "output") or v.kind != "Enumeration" or v.shape:
                found.append(f"{v.name}: verdict Values is for a scalar input or output of kind Enumeration")
            continue
        role, kinds, shape = _PLACES[verdict if isinstance(verdict, Role) else type(verdict)]
        if v.role != role or v.kind not in kinds or v.shape != shape:
            what = verdict.name if isinstance(verdict, Role) else type(verdict).__name__
            size = f" of {shape[0]}" if shape else ""
            found.append(f"{v.name}: verdict {what} is for an {role}{size} of kind {' or '.join(kinds)}")
        for name, _, kinds in references(verdict):
            if name not in known or known[name].kind not in kinds or known[name].shape:
                text = f"there is no scalar {name} of kind {' or '.join(kinds)}"
                found.append(f"{v.name}: its verdict refers to {name}, but {text}")
    return found


def _complaint_of_port(v: Declared, role: Role) -> list[str]:
    """Returns the errors of a role for inputs, or for packet ports of either direction."""
    if role is Role.OPTIONAL and v.role not in ("input", "output"):
        return [f"{v.name}: only an input or output can be OPTIONAL, this is of role {v.role}"]
    if role is not Role.OPTIONAL and v.kind != "Packets":
        return [f"{v.name}: only a packet port can be {role.name}, this is of kind {v.kind}"]
    return []


def _complaints_of_rotors(v: Declared, verdict: Rotors, known: Mapping[str, Declared]) -> list[str]:
    """Returns the errors in the verdict of an array of rotor speeds, one sentence for each."""
    if v.role != "output" or v.kind != "Real" or len(v.shape) != 1:
        return [f"{v.name}: verdict Rotors is for an output of kind Real, an array with an element for each rotor"]
    shapes = {verdict.count: ("Integer", ()), **dict.fromkeys(verdict.arrays, ("Real", v.shape))}
    return [
        f"{v.name}: its verdict refers to {name}, but there is no parameter {name} of kind {kind} and shape {shape}"
        for name, (kind, shape) in shapes.items()
        if name not in known or (known[name].role, known[name].kind, known[name].shape) != ("parameter", kind, shape)
    ]


def references(verdict: Verdict) -> list[tuple[str, str, tuple[str, ...]]]:
    """Returns the variables that a verdict names: name, role ("output" or "parameter"), and the kinds it may have."""
    real, integer = ("Real",), ("Integer",)
    found: list[tuple[float | str, str, tuple[str, ...]]] = []
    if isinstance(verdict, Condition):
        found = [(verdict.by, "parameter", real), (verdict.reason, "output", ("Enumeration", "Integer"))]
    elif isinstance(verdict, Bound):
        found = [(verdict.of, "parameter", ("Real", *_WHOLE)), (verdict.most, "parameter", ("Real", "Integer"))]
    elif isinstance(verdict, Formation):
        found = [(verdict.step, "output", integer), (verdict.stays, "parameter", ("Boolean",))]
        found += [(verdict.begin, "parameter", real), (verdict.period, "parameter", real)]
        for neighbour in verdict.neighbours:
            found += [(neighbour.id, "parameter", integer), (neighbour.gain, "parameter", real)]
    return [(name, role, kinds) for name, role, kinds in found if isinstance(name, str) and name]

"""The meaning of a model's variables, declared with the model, so that a master knows no model by its names.

    Output("state", type=Task, verdict=Condition(failed=(Task.failed,), working=(Task.formation,), reason="failure"))
    Output("failure", type=Failure, verdict=Reason(((Failure.not_armed, "its autopilot does not arm"),)))
    Output("age", unit="s", verdict=Bound(most="stale_time", text="its neighbour is not heard"))
    Output("position", shape=3, unit="m", verdict=Role.POSITION)
    Output("target", unit="m", verdict=Formation(step="step", neighbours=(Neighbour("left", "gain"),)))

The declarations go into the vendor annotation `org.uav-cosim.verdict` of the model description (`cosim.build`). A
master reads them there: to judge how a swarm does, to draw it, to write systems, and to find the ports of gateways.
Nothing here changes what a model computes.
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
    "Neighbour",
    "Reason",
    "Role",
    "Verdict",
    "complaints",
    "references",
]

ANNOTATION = "org.uav-cosim.verdict"
"""The name of the vendor annotation: of FMI 2's Tool, and type of FMI 3's Annotation."""


@dataclass(frozen=True, slots=True)
class Condition:
    """An output that says what its instance does. Each field holds values of the output, or names a variable.

    Attributes:
        failed: values that mean that it has given up.
        working: values that mean that it does what it is for. Bounds of the same instance hold while it is in one of
            them.
        commanding: values in which it wants the vehicle beside it in the air.
        by: a Real parameter, the time in s by which it is to be working.
        reason: the output that says why it has given up; that one is declared as `Reason`.
    """

    failed: tuple[int, ...]
    working: tuple[int, ...] = ()
    commanding: tuple[int, ...] = ()
    by: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Reason:
    """An output that says why its instance has given up. `texts`: values and their texts for people."""

    texts: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Bound:
    """A scalar output that stays within `least` and `most` as long as all is well.

    Attributes:
        most: a number, or the name of a parameter that holds it.
        least: a number.
        of: a parameter; the bound holds only where it is not 0.
        text: what it means if the output is outside, for people.
    """

    most: float | str = inf
    least: float = -inf
    of: str = ""
    text: str = ""


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A term of a linear law: `gain` times the difference between a neighbour's value and the own one.

    Attributes:
        id: an Integer parameter, the MAVLink system id of the neighbour; 0: there is none, and no term.
        gain: a number, or the name of a Real parameter that holds it [1].
    """

    id: str
    gain: float | str


@dataclass(frozen=True, slots=True)
class Formation:
    """A Real output of an agent: its desired position on a line that runs east from the local origin [m].

    In each step the agent changes it by the sum of the terms of its neighbours. From this follow the positions at
    which a line settles, and how fast.

    Attributes:
        step: an Integer output, the number of the present step; 0 before the first.
        stays: a Boolean parameter; an agent in which it is true keeps the position where it starts.
        neighbours: the terms of the law, from west to east; none: the agent follows a law of its own.
        begin: a Real parameter, the time at which step 1 begins [s].
        period: a Real parameter, the time that a step takes at most [s].
    """

    step: str
    stays: str = ""
    neighbours: tuple[Neighbour, ...] = ()
    begin: str = ""
    period: str = ""


class Role(Enum):
    """What a variable is to a master. The value is the name of its element in the annotation."""

    POSITION = "Position"
    """Output of 3 Reals: where a body is, NED from the local origin [m]."""
    ON_GROUND = "OnGround"
    """Boolean output of a body: whether it stands on the ground."""
    ARMED = "Armed"
    """Boolean output: whether the motors may turn."""
    DESIRED_POSITION = "DesiredPosition"
    """Output of 3 Reals: where the vehicle beside it is to be at this moment, NED from the local origin [m]."""
    START_POSITION = "StartPosition"
    """Parameter of 3 Reals: where a body is at the start, NED from the local origin [m]."""
    SYSTEM_ID = "SystemId"
    """Integer parameter: its MAVLink system id."""
    TELEMETRY = "Telemetry"
    """Packet port that leads to ground stations on the air, and nowhere else."""
    SERIAL = "Serial"
    """Packet port that leads to the program at the other end of a cable, and nowhere else."""
    OPTIONAL = "Optional"
    """Input that may stay open: its start value is a sensible one."""


Verdict: TypeAlias = Condition | Reason | Bound | Formation | Role


class Declared(Protocol):
    """What is looked at of a declared variable."""

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
    Role.ON_GROUND: ("output", ("Boolean",), _SCALAR),
    Role.ARMED: ("output", ("Boolean",), _SCALAR),
    Role.DESIRED_POSITION: ("output", ("Real",), _VECTOR),
    Role.START_POSITION: ("parameter", ("Real",), _VECTOR),
    Role.SYSTEM_ID: ("parameter", ("Integer",), _SCALAR),
}
"""Role, kinds and shape of the variables that may have a verdict, but for those of `_complaint_of_port`."""


def complaints(variables: Iterable[Declared]) -> list[str]:
    """What is wrong with the verdicts of a declaration, one sentence for each."""
    known = {v.name: v for v in variables}
    found: list[str] = []
    for v in known.values():
        verdict: Any = v.verdict
        if verdict is None:
            continue
        if verdict in (Role.OPTIONAL, Role.TELEMETRY, Role.SERIAL):
            found += _complaint_of_port(v, verdict)
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
    """What is wrong with a role that inputs, or packet ports of either direction, may have."""
    if role is Role.OPTIONAL and v.role != "input":
        return [f"{v.name}: only an input can be OPTIONAL, this is of role {v.role}"]
    if role is not Role.OPTIONAL and v.kind != "Packets":
        return [f"{v.name}: only a packet port can be {role.name}, this is of kind {v.kind}"]
    return []


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

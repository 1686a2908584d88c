"""What a variable says about how its instance does, declared with the model, so that a master knows no model by name.

    Output("state", type=Task, verdict=Condition(failed=(Task.failed,), working=(Task.formation,), reason="failure"))
    Output("failure", type=Failure, verdict=Reason(((Failure.not_armed, "its autopilot does not arm"),)))
    Output("age", unit="s", verdict=Bound(most="stale_time", text="its neighbour is not heard"))
    Output("position", shape=3, unit="m", verdict=Role.POSITION)

The declarations go into the vendor annotation `org.uav-cosim.verdict` of the model description (`cosim.build`), and a
master reads them there. Nothing here changes what a model computes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Any, Protocol, TypeAlias

__all__ = ["ANNOTATION", "Bound", "Condition", "Reason", "Role", "Verdict", "complaints"]

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


class Role(Enum):
    """What a variable is to those who judge a swarm. The value is the name of its element in the annotation."""

    POSITION = "Position"
    """Output of 3 Reals: where a body is, NED from the local origin [m]."""
    ON_GROUND = "OnGround"
    """Boolean output of a body: whether it stands on the ground."""
    ARMED = "Armed"
    """Boolean output: whether the motors may turn."""
    DESIRED_POSITION = "DesiredPosition"
    """Output of 3 Reals: where the vehicle beside it is to be at this moment, NED from the local origin [m]."""
    SYSTEM_ID = "SystemId"
    """Integer parameter: its MAVLink system id."""
    OPTIONAL = "Optional"
    """Input that may stay open: its start value is a sensible one."""


Verdict: TypeAlias = Condition | Reason | Bound | Role


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
    Role.POSITION: ("output", ("Real",), _VECTOR),
    Role.ON_GROUND: ("output", ("Boolean",), _SCALAR),
    Role.ARMED: ("output", ("Boolean",), _SCALAR),
    Role.DESIRED_POSITION: ("output", ("Real",), _VECTOR),
    Role.SYSTEM_ID: ("parameter", ("Integer",), _SCALAR),
}
"""Role, kinds and shape of the variables that may have a verdict; an input of any kind may be OPTIONAL."""


def complaints(variables: Iterable[Declared]) -> list[str]:
    """What is wrong with the verdicts of a declaration, one sentence for each."""
    known = {v.name: v for v in variables}
    found: list[str] = []
    for v in known.values():
        verdict: Any = v.verdict
        if verdict is None:
            continue
        if verdict is Role.OPTIONAL:
            if v.role != "input":
                found.append(f"{v.name}: only an input can be OPTIONAL, this is of role {v.role}")
            continue
        role, kinds, shape = _PLACES[verdict if isinstance(verdict, Role) else type(verdict)]
        if v.role != role or v.kind not in kinds or v.shape != shape:
            what = verdict.name if isinstance(verdict, Role) else type(verdict).__name__
            size = f" of {shape[0]}" if shape else ""
            found.append(f"{v.name}: verdict {what} is for an {role}{size} of kind {' or '.join(kinds)}")
        for name, kinds in _references(verdict):
            if name not in known or known[name].kind not in kinds or known[name].shape:
                text = f"there is no scalar {name} of kind {' or '.join(kinds)}"
                found.append(f"{v.name}: its verdict refers to {name}, but {text}")
    return found


def _references(verdict: Verdict) -> list[tuple[str, tuple[str, ...]]]:
    """The variables that a verdict names, and of which kind they have to be."""
    found: list[tuple[str, tuple[str, ...]]] = []
    if isinstance(verdict, Condition):
        found = [(verdict.by, ("Real",)), (verdict.reason, ("Enumeration", "Integer"))]
    elif isinstance(verdict, Bound):
        found = [(verdict.of, ("Real", *_WHOLE))]
        found += [(verdict.most, ("Real", "Integer"))] if isinstance(verdict.most, str) else []
    return [(name, kinds) for name, kinds in found if name]

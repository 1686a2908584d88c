"""Constraints that determine the sizes of steps, as in Maestro: the children of a `master` with var-step.

    <master algorithm="var-step" minimumStep="1e-6" maximumStep="1">
      <constraint name="full" type="zerocrossing" order="1" abstol="0.01">
        <port name="tank.level"/>
        <port name="controller.maxlevel"/>
      </constraint>
    </master>

`type`: "zerocrossing", "boundeddifference", "samplingrate" or "fmumaxstepsize". The other attributes are named as in
Maestro; docs/masters.md describes each constraint. This module only reads settings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.read import Variable
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.annotation import Attributes

__all__ = ["Constraint", "constraints_of", "memory_of"]

ZEROCROSSING, DIFFERENCE, SAMPLING, LIMIT = "zerocrossing", "boundeddifference", "samplingrate", "fmumaxstepsize"
TYPES = (ZEROCROSSING, DIFFERENCE, SAMPLING, LIMIT)
_FOR = {
    "order": (ZEROCROSSING,),
    "abstol": (ZEROCROSSING, DIFFERENCE),
    "reltol": (DIFFERENCE,),
    "safety": (ZEROCROSSING, DIFFERENCE),
    "skipDiscrete": (DIFFERENCE,),
    "base": (SAMPLING,),
    "rate": (SAMPLING,),
    "startTime": (SAMPLING,),
}
"""The types of constraints to which an attribute applies."""
_FINEST, _COARSEST = -9, 6
"""Exponents of ten of the unit of sampling, in s."""


@dataclass(frozen=True, slots=True)
class Constraint:
    """One constraint.

    Attributes:
        name: its name in messages.
        type: one of `TYPES`.
        ports: instance and variable of each port; a zero crossing of two ports is that of their difference.
        order: order of the extrapolation to a zero crossing.
        abstol, reltol: tolerances.
        safety: larger values make steps shorter.
        skip_discrete: whether a step cut short by a sampling instant has less influence on the next one.
        first, interval: sampling instants, ns.
    """

    name: str
    type: str
    ports: tuple[tuple[str, str], ...] = ()
    order: int = 2
    abstol: float = 1e-3
    reltol: float = 1e-2
    safety: float = 0.0
    skip_discrete: bool = True
    first: int = 0
    interval: int = 1


def memory_of(constraints: Sequence[Constraint]) -> int:
    """Returns the number of values that step sizes with these constraints store: see `algorithms.constraints`."""
    return 4 + sum(1 + 7 * len(one.ports) for one in constraints)


def constraints_of(checked: CheckedSystem, children: Sequence[Attributes]) -> tuple[Constraint, ...]:
    """Reads the constraints of a master; problems are added to those of its readers."""
    ports = {
        f"{instance.name}.{name}": ((instance.name, name), variable)
        for instance in checked.instances
        for name, variable in (instance.fmu.variables.items() if children else ())
    }
    found: dict[str, Constraint] = {}
    for child in children:
        one = _constraint(child, ports)
        if one.name in found:
            child.problem(f'a second constraint "{one.name}"')
        found[one.name] = one
    return tuple(found.values())


def _constraint(child: Attributes, ports: Mapping[str, tuple[tuple[str, str], Variable]]) -> Constraint:
    type = child.choice("type", "", TYPES)
    name = child.text("name", "") or type
    base = child.integer("base", 0, _FINEST, _COARSEST)
    unit = 10 ** (9 + base)
    constraint = Constraint(
        name,
        type,
        _ports(child, name, type, ports),
        child.integer("order", 2, 1, 2),
        child.number("abstol", 1e-3, 0.0, 1e300),
        child.number("reltol", 1e-2, 0.0, 1e300),
        child.number("safety", 0.0, 0.0, 1e300),
        child.choice("skipDiscrete", "true", ("true", "false")) == "true",
        unit * child.integer("startTime", 0, 0, 10**9),
        unit * child.integer("rate", 1, 1, 10**9),
    )
    for attribute, types in _FOR.items():
        if type and type not in types and child.text(attribute, ""):
            child.problem(f'constraint "{name}": {attribute} is for {" and ".join(types)}, this is {type}')
    if type == SAMPLING and not child.text("rate", ""):
        child.problem(f'constraint "{name}": needs a rate, in units of 10^base s')
    child.finish()
    return constraint


def _ports(
    child: Attributes, name: str, type: str, known: Mapping[str, tuple[tuple[str, str], Variable]]
) -> tuple[tuple[str, str], ...]:
    found = []
    inner = child.children("port")["port"]
    for port in inner:
        text = port.text("name", "")
        port.finish()
        target, variable = known.get(text, (None, None))
        if target is None or variable is None:
            port.problem(f'constraint "{name}": there is no variable "{text}"; {near(text, known)}')
        elif reason := _unfit(variable, type):
            port.problem(f'constraint "{name}": port "{text}" {reason}')
        else:
            found.append(target)
    count = len(inner)
    if type == ZEROCROSSING and count not in (1, 2):
        child.problem(f'constraint "{name}": a zero crossing has one port or two, here are {count}')
    elif type == DIFFERENCE and count < 1:
        child.problem(f'constraint "{name}": needs a port')
    elif type in (SAMPLING, LIMIT) and count:
        child.problem(f'constraint "{name}": {type} has no ports')
    return tuple(found)


def _unfit(variable: Variable, type: str) -> str:
    """Returns the reason why a variable cannot be a port; empty if it can."""
    kinds = ("Real",) if type == ZEROCROSSING else ("Real", "Integer")
    if variable.type not in kinds:
        return f"is a {variable.type}; valid: {' or '.join(kinds)}"
    if variable.wide:
        return "is an integer of 64 bits; valid: one of 32 bits at most"
    if variable.clocks or variable.clock is not None:
        return "belongs to a Clock; valid: a variable that always has a value"
    return ""

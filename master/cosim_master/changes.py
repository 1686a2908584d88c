"""Values that a run changes while it is going on: tunable parameters, and inputs that nothing is connected to.

Between two steps FMI 2 allows no others to be set (FMI 2.0.5, section 4.2.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cosim_master.check import CheckedSystem
from cosim_master.document import near
from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmu import Start, Variable
from cosim_master.limitations import CHANGE, CLOCKED_CHANGE, STRUCTURAL_CHANGE
from cosim_master.timing import Timing

__all__ = ["Change", "changes"]

_WHERE = Where("--at")


@dataclass(frozen=True, slots=True)
class Change:
    """Before the step that begins at base step `k`, `variable` of instance number `instance` gets `value`."""

    k: int
    instance: int
    variable: Variable
    value: Start


def changes(checked: CheckedSystem, clock: Timing, wanted: Sequence[tuple[float, str, str]]) -> tuple[Change, ...]:
    """Check changes and put them into the order of time; of two at one time the later one in `wanted` wins.

    Args:
        wanted: time in s, hierarchical name of a variable, its new value as text (of an enumeration the item's name).

    Raises:
        SystemDescriptionError: all that is wrong with them.
    """
    if not wanted:
        return ()
    problems: list[Problem] = []
    found: list[Change] = []
    variables = {
        f"{instance.name}.{name}": (i, variable)
        for i, instance in enumerate(checked.instances)
        for name, variable in instance.fmu.variables.items()
    }
    driven = {".".join(link.target) for link in checked.links}
    for time, name, text in wanted:
        k = _base_step(clock, time)
        try:
            if name not in variables:
                raise ValueError(f"there is no such variable; {near(name, variables)}")
            number, variable = variables[name]
            _check_changeable(variable, driven=name in driven)
            period = clock.periods[number]
            if k is None or k % period:
                raise ValueError(_expected(clock, period, checked.instances[number].name))
            found.append(Change(k, number, variable, variable.parsed(text)))
        except ValueError as error:
            problems.append(Problem(_WHERE, f"{time:g} {name}={text}: {error}"))
    if problems:
        raise SystemDescriptionError(problems)
    return tuple(sorted(found, key=lambda change: change.k))


def _base_step(clock: Timing, time: float) -> int | None:
    """The base step that begins at `time`, None if none does."""
    ticks = time * 1e9 - clock.start
    if not abs(ticks) < 2**62:
        return None
    k = round(ticks / clock.base)
    return k if 0 <= k < clock.steps and abs(k * clock.base - ticks) < 0.5 else None


def _expected(clock: Timing, period: int, name: str) -> str:
    start, step = clock.start / 1e9, period * clock.base / 1e9
    last = start + (clock.steps - 1) // period * step
    return CHANGE.text(name, f"{step:g}", f"{start:g}", f"{last:g}")


def _check_changeable(variable: Variable, *, driven: bool) -> None:
    if driven:
        raise ValueError("it is connected, and gets its value from there")
    if variable.packet_capacity is not None:
        raise ValueError("it carries packets")
    if variable.clocks:
        raise ValueError(CLOCKED_CHANGE.text(variable.clocks[0]))
    if variable.clock is not None and (variable.clock.kind != "tunable" or not variable.settable):
        raise ValueError(f"it is a {variable.clock.kind} Clock; only the interval of tunable ones can be changed")
    if variable.causality == "structuralParameter":
        raise ValueError(STRUCTURAL_CHANGE.text())
    tunable = variable.causality == "parameter" and variable.variability == "tunable"
    if not tunable and variable.causality != "input":
        what = f"{variable.causality}, {variable.variability}"
        raise ValueError(f"it is {what}; only tunable parameters and inputs can be changed during a run")

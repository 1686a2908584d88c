"""Values that change during a run: tunable parameters, and unconnected inputs.

FMI 2 does not allow setting other variables between two steps (FMI 2.0.5, section 4.2.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import CHANGE, CLOCKED_CHANGE, STRUCTURAL_CHANGE
from cosim_master.diagnostics.names import is_pattern, matching, near, near_pattern
from cosim_master.fmi.description.read import Start, Variable
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.overrides import SETTINGS
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["Change", "Changeable", "FromSet", "changes", "told"]


class FromSet(str):
    """A value as text that `--set` gives to a run which is resumed from a checkpoint."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Change:
    """Before the step that begins at base step `k`, `variable` of instance number `instance` is set to `value`."""

    k: int
    instance: int
    variable: Variable
    value: Start


def told(checked: CheckedSystem, change: Change) -> tuple[int, str, str]:
    """Returns the base step of a change, the name of its variable, and its value as Python writes it."""
    name = f"{checked.instances[change.instance].name}.{change.variable.name}"
    return change.k, name, str(change.value) if isinstance(change.value, str) else repr(change.value)


class Changeable:
    """The variables of a system, and which of them can be changed during a run."""

    def __init__(self, checked: CheckedSystem) -> None:
        self._variables = {
            f"{instance.name}.{name}": (i, variable)
            for i, instance in enumerate(checked.instances)
            for name, variable in instance.fmu.variables.items()
        }
        self._driven = {".".join(link.target) for link in checked.links}

    def all(self) -> dict[str, tuple[int, Variable]]:
        """Returns the number of the instance and the variable, by name, of all that can be changed."""
        return {name: found for name, found in self._variables.items() if not self._refusal(name)}

    def matching(self, name: str) -> list[tuple[int, Variable]]:
        """Returns the variables that match a name or pattern, all of which can be changed.

        Raises:
            ValueError: no variable matches, or one of them cannot be changed.
        """
        variables = self._variables
        if name in variables:
            if refusal := self._refusal(name):
                raise ValueError(refusal)
            return [variables[name]]
        if not is_pattern(name):
            if name.partition(".")[0] in SETTINGS:
                raise ValueError(
                    "settings of radio, recording and master cannot change during a run; give them by --set"
                )
            raise ValueError(f"there is no such variable; {near(name, variables)}")
        found = matching(name, variables)
        if not found:
            raise ValueError(f"it matches no variable; {near_pattern(name, variables)}")
        for one in found:
            if refusal := self._refusal(one):
                raise ValueError(f"it matches {len(found)} variables, one of them {one}: {refusal}")
        return [variables[one] for one in found]

    def _refusal(self, name: str) -> str:
        """Returns the reason why a variable cannot be changed; empty if it can."""
        variable = self._variables[name][1]
        if name in self._driven:
            return "it is connected, and gets its value from there"
        if variable.packet_capacity is not None:
            return "it carries packets"
        if variable.clocks:
            return CLOCKED_CHANGE.text(variable.clocks[0])
        if variable.clock is not None and (variable.clock.kind != "tunable" or not variable.settable):
            return f"it is a {variable.clock.kind} Clock; only the interval of tunable ones can be changed"
        if variable.causality == "structuralParameter":
            return STRUCTURAL_CHANGE.text()
        tunable = variable.causality == "parameter" and variable.variability == "tunable"
        if not tunable and variable.causality != "input":
            what = f"{variable.variability} {variable.causality}"
            return f"it is a {what}; only tunable parameters and inputs can be changed during a run"
        return ""


def changes(checked: CheckedSystem, clock: TimeGrid, wanted: Sequence[tuple[float, str, str]]) -> tuple[Change, ...]:
    """Checks changes and sorts them by time; of two at the same time, the later one in `wanted` takes precedence.

    Args:
        wanted: time in s, hierarchical name or pattern of variables, their new value as text (for an enumeration, the
            name of an item).

    Raises:
        SystemDescriptionError: the changes are invalid; all problems are reported at once.
    """
    if not wanted:
        return ()
    problems: list[Problem] = []
    found: list[Change] = []
    changeable = Changeable(checked)
    for time, name, text in wanted:
        k = clock.step_at(time)
        try:
            for number, variable in changeable.matching(name):
                period = clock.periods[number]
                if k is None or k == clock.steps or k % period:
                    raise ValueError(_expected(clock, period, checked.instances[number].name))
                found.append(Change(k, number, variable, variable.parsed(text)))
        except ValueError as error:
            given = f"{name}={text}"
            option = f"--set {given}" if isinstance(text, FromSet) else f"--at {time:g} {given}"
            problems.append(Problem(Where(option), str(error)))
    if problems:
        raise SystemDescriptionError(problems)
    return tuple(sorted(found, key=lambda change: change.k))


def _expected(clock: TimeGrid, period: int, name: str) -> str:
    start, step = clock.time(0), clock.seconds(period)
    last = start + (clock.steps - 1) // period * step
    return CHANGE.text(name, f"{step:g}", f"{start:g}", f"{last:g}")

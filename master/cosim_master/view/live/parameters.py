"""The values that the reader of a live page can change: tunable parameters, and inputs that nothing drives.

They are those that `run --at` can change, and are set in the same way. A page asks for those that match some words, and
receives the first of them only: a thousand drones have some hundred thousand.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

from cosim_master.fmi.description.read import Start
from cosim_master.stepping.control import Control
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change, Changeable
from cosim_master.system.settings.master import MasterSettings

__all__ = ["Parameters", "unchangeable"]

_LISTED = 40
_CHANGES = 100


def unchangeable(master: MasterSettings) -> str:
    """Returns the reason why a run with this master cannot be changed from its page; empty if it can."""
    if master.variable:
        return f'algorithm="{master.algorithm}" chooses its communication points; give changes by --at'
    return ""


class Parameters:
    """Finds and sets values of a run.

    Args:
        checked: the system.
        control: receives the values to be set.
        refusal: the reason why the values of this run cannot be changed; empty if they can.
    """

    def __init__(self, checked: CheckedSystem, control: Control, refusal: str = "") -> None:
        self._checked, self._control, self._refusal = checked, control, refusal
        self._set: dict[tuple[int, str], Start] = {}

    @cached_property
    def _changeable(self) -> Changeable:
        return Changeable(self._checked)  # which takes a while for a thousand drones, and is not always needed

    @cached_property
    def _names(self) -> list[tuple[str, str]]:
        """Names of the variables, and texts to search in; parameters of autopilots, which are many, at the end."""
        found = [(name, f"{name} {v.description or ''}".lower()) for name, (_, v) in self._changeable.all().items()]
        return sorted(found, key=lambda one: one[0].rpartition(".")[2].isupper())

    def find(self, text: str) -> dict[str, Any]:
        """Returns the first variables whose names and descriptions contain all words of a text, as JSON."""
        if self._refusal:
            return {"text": text, "of": 0, "list": [], "refusal": self._refusal}
        words = text.lower().split()
        names = [name for name, within in self._names if all(word in within for word in words)]
        return {"text": text, "of": len(names), "list": [self._told(name) for name in names[:_LISTED]], "refusal": ""}

    def _told(self, name: str) -> dict[str, Any]:
        ((number, variable),) = self._changeable.matching(name)
        start = self._checked.instances[number].effective_values().get(variable.name, variable.start)
        value = self._set.get((number, variable.name), start)
        items = variable.items or {}
        return {
            "name": name,
            "type": variable.type,
            "unit": "" if variable.unit is None else variable.unit.name,
            "description": variable.description or "",
            "least": _in_json(variable.minimum),
            "most": _in_json(variable.maximum),
            "items": [*items],
            "start": _in_json(start),
            "value": next((item for item, n in items.items() if n == value), _in_json(value)),
        }

    def set(self, name: str, text: str) -> str:
        """Requests a value of a variable; returns the reason why it cannot be set, or an empty text."""
        if self._refusal:
            return self._refusal
        try:
            for number, variable in self._changeable.matching(name):
                change = Change(0, number, variable, variable.parsed(text))
                self._control.change(change)
                self._set[number, variable.name] = change.value
        except ValueError as error:
            return f"{name}={text}: {error}"
        return ""

    def changes(self) -> list[list[Any]]:
        """Returns the newest values set: time [s; None: the run ends before], name, value as `--at` takes it."""
        return [
            [time, f"{self._checked.instances[one.instance].name}.{one.variable.name}", _text(one.value)]
            for time, one in self._control.made[-_CHANGES:]
        ]


def _in_json(value: Start | None) -> Start | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: Start) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)

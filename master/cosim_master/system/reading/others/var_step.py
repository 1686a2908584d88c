"""The algorithm var-step of a multi-model: step sizes chosen by constraints, converted to the annotation of our master.

    "algorithm": {"type": "var-step", "size": [1e-6, 1], "initsize": 0.1,
                  "constraints": {"full": {"type": "zerocrossing", "ports": ["{t}.tank.level"], "abstol": 0.01}}}

Types of values and unknown keys are checked here. The reader of the annotation makes all other checks; it has the line
of the constraint.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lxml import etree

from cosim_master.diagnostics.errors import Where
from cosim_master.system.reading.others.json_values import finite, shown, speakable
from cosim_master.system.structure import Annotation, annotation

__all__ = ["MASTER", "VarStep"]

MASTER = "org.uav-cosim.master"
_ALGORITHM = ("type", "size", "initsize", "constraints")
_CONSTRAINTS = {
    "zerocrossing": ("ports", "order", "abstol", "safety"),
    "boundeddifference": ("ports", "abstol", "reltol", "safety", "skipDiscrete"),
    "samplingrate": ("base", "rate", "startTime"),
    "fmumaxstepsize": (),
}
"""Keys of constraints, by their type."""
_FINEST = 1e-9
_Note = Callable[[str, str], None]


@dataclass(frozen=True, slots=True)
class _Constraint:
    settings: Mapping[str, str]
    ports: Sequence[str]
    where: Where


class VarStep:
    """The variable step size of a multi-model.

    Args:
        algorithm: the object.
        where: returns the line of a key.
        problem: called with a key and its problem.

    Attributes:
        first: the first step, s.
        notes: settings that are not used literally.
    """

    def __init__(self, algorithm: Mapping[str, Any], where: Callable[[str], Where], problem: _Note) -> None:
        self._where, self._problem = where, problem
        self.notes: list[str] = []
        self._unknown(algorithm, _ALGORITHM, "algorithm")
        size, first, given = (algorithm.get(key) for key in _ALGORITHM[1:])
        if not isinstance(size, list) or len(size) != 2 or not all(map(_positive, size)):
            problem("size", "algorithm: var-step needs size: [shortest, longest], two positive sizes in s")
            size = [_FINEST, 1.0]
        self.first = float(first) if first is not None and _positive(first) else 0.0
        if not self.first:
            problem("initsize", "algorithm: var-step needs initsize, the first step, a positive size in s")
        if not isinstance(given, dict | None):
            problem("constraints", f"constraints: must be an object, not {shown(given)}")
            given = {}
        self._shortest, self._longest = sorted(map(float, size))
        if self._shortest < _FINEST:
            self.notes.append(f"{where('size')}: no step is shorter than 1 ns; size says {self._shortest:g} s")
        read = [self._constraint(name, value) for name, value in (given or {}).items()]
        self._constraints = [one for one in read if one is not None]

    def _constraint(self, name: str, value: Any) -> _Constraint | None:
        kind = value.get("type") if isinstance(value, dict) else None
        of = f"constraint {shown(name)}"
        if not isinstance(kind, str) or kind not in _CONSTRAINTS or not speakable(name):
            self._problem(name, f"{of}: its type is {shown(kind)}; valid: {', '.join(_CONSTRAINTS)}")
            return None
        self._unknown(value, ("type", *_CONSTRAINTS[kind]), of)
        ports = value.get("ports", [])
        if not isinstance(ports, list) or not all(isinstance(one, str) and speakable(one) for one in ports):
            self._problem(name, f"{of}: ports must be a list of variables, not {shown(ports)}")
            return None
        settings = {"name": name, "type": kind}
        for key in _CONSTRAINTS[kind]:
            setting = value.get(key)
            if key == "ports" or setting is None:
                continue
            if key == "skipDiscrete" and not isinstance(setting, bool):
                self._problem(name, f"{of}: {key}: {shown(setting)} is not true or false")
            elif key != "skipDiscrete" and not _number(setting):
                self._problem(name, f"{of}: {key}: {shown(setting)} is not a finite number")
            else:
                settings[key] = json.dumps(setting)
        return _Constraint(settings, ports, self._where(name))

    def _unknown(self, given: Mapping[str, Any], known: Sequence[str], of: str) -> None:
        for key in given:
            if key not in known:
                self._problem(key, f"{of}: there is no key {shown(key)}; valid: {', '.join(known)}")

    def annotation(self) -> Annotation:
        """Returns the annotation of a master, in which each constraint has its line in the multi-model."""
        steps = {
            "minimumStep": repr(max(self._shortest, _FINEST)),
            "maximumStep": repr(max(self._longest, _FINEST)),
        }
        made = annotation(MASTER, "master", {"algorithm": "var-step", **steps}, self._where("algorithm"))
        master = made.element[0]
        namespace = f"{{{etree.QName(master).namespace}}}"
        _place(master, made.where)
        for one in self._constraints:
            element = etree.SubElement(master, f"{namespace}constraint", dict(one.settings))
            _place(element, one.where)
            for port in one.ports:
                _place(etree.SubElement(element, f"{namespace}port", {"name": port}), one.where)
        return made


def _place(element: etree._Element, where: Where) -> None:
    """Sets the line of an element in its file, for problems."""
    element.sourceline = where.line or 0  # type: ignore[assignment]


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and finite(value)


def _positive(value: Any) -> bool:
    return _number(value) and value > 0

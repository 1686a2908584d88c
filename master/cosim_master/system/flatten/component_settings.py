"""Step sizes, solvers and processes that a system sets for its components, by our or OMSimulator's annotations."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Iterator

from lxml import etree

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.files.xml import line_of
from cosim_master.fmi.description.read import RUNNER, runner
from cosim_master.fmi.slaves.solvers import NAMES as SOLVERS
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.system.flatten.flat import PROCESSES
from cosim_master.system.flatten.topology.components import Part
from cosim_master.system.reading.others.omsimulator import OMSIMULATOR, Named
from cosim_master.system.reading.others.omsimulator import settings as settings_of_omsimulator
from cosim_master.system.structure import Annotation, Component, System, SystemStructure

__all__ = ["ISOLATION", "SOLVER", "STEPPING", "ComponentSettings"]

STEPPING = "org.uav-cosim.stepping"
SOLVER = "org.uav-cosim.solver"
ISOLATION = "org.uav-cosim.isolation"
_NAMESPACE = "https://uav-cosim.org/ns/1"
_RUNNERS = ("wine", "wine64")
"""Commands that a system may name without the permission of its user."""


class ComponentSettings:
    """Reads the annotations of one system; adds to its problems and notes."""

    def __init__(self, structure: SystemStructure, problems: list[Problem], notes: list[str]) -> None:
        self._structure, self._problems, self._notes = structure, problems, notes

    def step_size(self, part: Part) -> float | None:
        """Returns the communication step that the system sets for an FMU: our annotation's, or else OMSimulator's."""
        annotation = self._nearest(part, STEPPING)
        if annotation is not None:
            return self._stepping(annotation)
        if (solver := self.named_by_omsimulator(part)) is not None and not solver.solver and solver.step is not None:
            return solver.step
        annotation = self._nearest(part, OMSIMULATOR, lambda one: settings_of_omsimulator(one).step is not None)
        if annotation is not None:
            return settings_of_omsimulator(annotation).step
        return None

    def named_by_omsimulator(self, part: Part) -> Named | None:
        """Returns the solver that OMSimulator's annotation of a component names, as defined in a surrounding system."""
        own = (one for one in part.element.annotations if one.type == OMSIMULATOR)
        names = [settings_of_omsimulator(one).uses for one in own]
        if not names or (name := names[0]) is None:
            return None
        annotation = self._nearest(part, OMSIMULATOR, lambda one: name in settings_of_omsimulator(one).named)
        return None if annotation is None else settings_of_omsimulator(annotation).named[name]

    def solver(self, part: Part) -> Choice | None:
        """Returns the solver that the system sets for an FMU for Model Exchange."""
        annotation = self._nearest(part, SOLVER)
        if annotation is None:
            if (named := self.named_by_omsimulator(part)) is not None and named.solver is not None:
                return Choice(named.solver, step=named.step, tolerance=named.tolerance)
            annotation = self._nearest(part, OMSIMULATOR, lambda one: settings_of_omsimulator(one).solver is not None)
            found = None if annotation is None else settings_of_omsimulator(annotation)
            if found is None or found.solver is None:
                return None
            return Choice(found.solver, step=found.solver_step, tolerance=found.tolerance)
        children = list(annotation.element)
        if len(children) != 1 or children[0].tag != f"{{{_NAMESPACE}}}solver":
            text = f'annotation {SOLVER} needs one element: <solver xmlns="{_NAMESPACE}" name="cvode"/>'
            self._problems.append(Problem(annotation.where, text))
            return None
        element, where = children[0], Where(annotation.where.path, line_of(children[0]))
        try:
            if unknown := sorted({*map(str, element.attrib)} - {"name", "step", "tolerance", "restart"}):
                valid = '"name", "step", "tolerance", "restart"'
                raise ValueError(f'<solver> has no attribute "{unknown[0]}"; valid: {valid}')
            numbers = {name: _positive(name, element.get(name)) for name in ("step", "tolerance")}
            if (name := element.get("name", "cvode")) not in SOLVERS:
                raise ValueError(f'there is no solver "{name}"; valid: {", ".join(SOLVERS)}')
            if (restart := element.get("restart", "false")) not in ("true", "false"):
                raise ValueError(f'restart "{restart}" of <solver>; valid: true, false')
        except ValueError as error:
            self._problems.append(Problem(where, str(error)))
            return None
        return Choice(name, **numbers, restart=restart == "true")

    def runs(self) -> str:
        """Returns the first program by which the system has FMUs of Windows run; empty if it names none."""
        for annotation in _annotations(self._structure):
            for element in annotation.element if annotation.type == ISOLATION else ():
                if text := str(element.get("runner", "")):
                    return (*_words(text), text)[0]
        return ""

    def process(self, part: Part) -> tuple[str, int, tuple[str, ...]]:
        """Returns the process that the system sets for an FMU, its number of restarts, and the program that runs it.

        The process and the program are empty if the system sets none.
        """
        annotation = self._nearest(part, ISOLATION)
        if annotation is None:
            return "", 0, ()
        example = f'<isolation xmlns="{_NAMESPACE}" process="instance"/>'
        children = list(annotation.element)
        if len(children) != 1 or children[0].tag != f"{{{_NAMESPACE}}}isolation":
            self._problems.append(Problem(annotation.where, f"annotation {ISOLATION} needs one element: {example}"))
            return "", 0, ()
        element, where = children[0], Where(annotation.where.path, line_of(children[0]))
        if unknown := sorted({*map(str, element.attrib)} - {"process", "restarts", "runner"}):
            text = f'<isolation> has no attribute "{unknown[0]}"; valid: "process", "restarts", "runner"'
            self._problems.append(Problem(where, text))
        command = self._runner(str(element.get("runner", "")), where)
        process, restarts = str(element.get("process", "")), str(element.get("restarts", "0"))
        if process not in PROCESSES and ("process" in element.attrib or "runner" not in element.attrib):
            text = f'process "{process}" of <isolation>; valid: {", ".join(PROCESSES)}'
            self._problems.append(Problem(where, text))
            return "", 0, ()
        if process == "here" and command:
            text = f'process "here" of <isolation>: {command[0]} needs a process of its own; valid: file, instance'
            self._problems.append(Problem(where, text))
        if re.fullmatch("[0-9]{1,6}", restarts) is None or (process == "here" and int(restarts)):
            own = f'; an FMU of process "{process}" is not started anew' if process == "here" else ""
            text = f'restarts "{restarts}" of <isolation>; valid: an integer from 0 to 999999{own}'
            self._problems.append(Problem(where, text))
            return process, 0, command
        return process, int(restarts), command

    def _runner(self, text: str, where: Where) -> tuple[str, ...]:
        """Returns the words of a command that runs FMUs of Windows, if this system may have it run here."""
        command = _words(text)
        if text and not command:
            self._problems.append(Problem(where, f'runner "{text}" of <isolation> is no command; try wine64'))
        elif command and text not in _RUNNERS and [*command] != runner():
            # A system is a document: it may not run programs with the rights of whoever opens it.
            fix = f"if you trust it, allow it by {RUNNER}={shlex.quote(text)} in the environment"
            valid = f"without that, a system may name {' or '.join(_RUNNERS)}"
            self._problems.append(Problem(where, f'runner "{text}" of <isolation> is a command; {fix} ({valid})'))
        return command

    def _nearest(self, part: Part, kind: str, fits: Callable[[Annotation], bool] = lambda _: True) -> Annotation | None:
        """Returns the nearest matching annotation of a type, on the part or on a surrounding system."""
        owner: Part | None = part
        while owner is not None:
            inner = owner.system.annotations if owner.system is not None else ()
            outer = owner.element.annotations if owner.element is not owner.system else ()
            top = self._structure.annotations if owner.parent is None else ()
            for annotation in (*inner, *outer, *top):
                if annotation.type == kind and fits(annotation):
                    return annotation
            owner = owner.parent
        return None

    def _stepping(self, annotation: Annotation) -> float | None:
        children = list(annotation.element)
        if len(children) != 1 or children[0].tag != f"{{{_NAMESPACE}}}stepping":
            text = f'annotation {STEPPING} needs one element: <stepping xmlns="{_NAMESPACE}" stepSize="0.01"/>'
            self._problems.append(Problem(annotation.where, text))
            return None
        stepping = children[0]
        where = Where(annotation.where.path, line_of(stepping))
        for attribute in map(str, stepping.attrib):
            if attribute != "stepSize":
                self._problems.append(Problem(where, f'<stepping> has no attribute "{attribute}"; valid: "stepSize"'))
        for child in stepping:
            text = f"<stepping> holds no <{etree.QName(child).localname}>"
            self._problems.append(Problem(where, text))
        try:
            step = float(stepping.get("stepSize", ""))
        except ValueError:
            step = math.nan
        if not 0.0 < step < math.inf:
            text = f'stepSize "{stepping.get("stepSize", "")}" of <stepping> must be a positive number of seconds'
            self._problems.append(Problem(where, text))
            return None
        return step


def _positive(name: str, text: str | None) -> float | None:
    """Returns a number of <solver>, or None if the attribute is absent.

    Raises:
        ValueError: the text is not a positive number.
    """
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise ValueError(f'{name} "{text}" of <solver> must be a positive number')
    return value


def _words(text: str) -> tuple[str, ...]:
    """Returns the words of a command; none if its quotes do not match."""
    try:
        return tuple(shlex.split(text))
    except ValueError:
        return ()


def _annotations(structure: SystemStructure) -> Iterator[Annotation]:
    """Yields the annotations of a system and of everything in it."""
    yield from structure.annotations
    waiting: list[object] = [structure.system]
    seen: set[int] = set()
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, System):
            yield from one.annotations
            waiting += one.elements
        elif isinstance(one, Component):
            yield from one.annotations
            waiting += [one.content]

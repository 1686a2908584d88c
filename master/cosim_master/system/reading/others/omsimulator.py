"""Reads annotations of OMSimulator in an .ssd (org.openmodelica): the step of its master, and its solver.

    <oms:SimulationInformation>
      <oms:FixedStepMaster description="oms-ma" stepSize="0.01" .../>          taken over: the step of its system
      <oms:VariableStepMaster description="oms-mav" maximumStepSize=... .../>  named: steps have one size here
      <oms:VariableStepSolver description="cvode" relativeTolerance=... .../>  taken over for FMUs for Model Exchange
      <oms:FixedStepSolver description="euler" stepSize=... .../>              the same

Since OMSimulator 3, a system names solvers, and each component refers to one of them:

    <oms:SimulationInformation name="solver" method="cvode" relativeTolerance="1e-6"/>    of a system
    <oms:SimulationInformation name="solver"/>                                            of a component

`cvode` and `euler` select the Model Exchange interface of an FMU that has both interfaces; `oms_ma` with a
`fixedStepSize` sets the step of its FMUs. Only local names are compared, since the namespaces differ between versions
of OMSimulator.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from lxml import etree

from cosim_master.diagnostics.limitations import OMS_IGNORED, OMS_MASTER
from cosim_master.files.xml import local_name
from cosim_master.system.structure import Annotation

__all__ = ["OMSIMULATOR", "Named", "Settings", "settings"]

OMSIMULATOR = "org.openmodelica"

_MASTERS = ("FixedStepMaster", "VariableStepMaster")
_SOLVERS = ("FixedStepSolver", "VariableStepSolver")


_NAMED = {"name", "method", "tolerance", "relativeTolerance", "fixedStepSize"}


@dataclass(frozen=True, slots=True)
class Named:
    """A named solver: `solver` is "cvode" or "euler", None for a master of co-simulation; `step` in s."""

    solver: str | None
    step: float | None
    tolerance: float | None


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings of one annotation.

    Attributes:
        named: the solvers of a system, by name.
        uses: the name of a component's solver.
        step: step of the master, s; None if it has no fixed step.
        solver: "cvode" or "euler", with its `solver_step` (s) or `tolerance` (relative); None if not specified.
        notes: the settings adopted, and those not adopted.
    """

    step: float | None
    solver: str | None
    solver_step: float | None
    tolerance: float | None
    notes: tuple[str, ...]
    named: Mapping[str, Named] = field(default_factory=dict)
    uses: str | None = None


def settings(annotation: Annotation) -> Settings:
    """Returns the settings that OMSimulator has written into an annotation."""
    found: dict[str, dict[str, str]] = {}
    named: dict[str, Named] = {}
    uses: str | None = None
    notes: list[str] = []
    ignored: list[str] = []
    for item in _elements(annotation.element):
        given = {str(name): str(text) for name, text in item.attrib.items()}
        if local_name(item) != "SimulationInformation" or "name" not in given:
            found[local_name(item)] = given
        elif "method" not in given:
            uses = given["name"]
        else:
            named[given["name"]], said = _named(given)
            notes.append(f"{annotation.where}: {said}")
            ignored += [f"{name} of {given['name']}" for name in given if name not in _NAMED and given[name] != "None"]
    fixed = found.get("FixedStepMaster", {})
    step = _positive(fixed.get("stepSize"))
    if step is not None:
        notes.append(f"{annotation.where}: the step of {step:g} s is taken over from OMSimulator's annotation")
    if (varying := found.get("VariableStepMaster")) is not None:
        notes.append(f"{annotation.where}: {OMS_MASTER.text(_shown(varying))}")
    solver, solver_step, tolerance = None, None, None
    for name in _SOLVERS:
        if name not in found:
            continue
        given = found[name]
        solver = "cvode" if given.get("description", "").lower() == "cvode" else "euler"
        solver_step = _positive(given.get("stepSize", given.get("initialStepSize"))) if solver == "euler" else None
        tolerance = _positive(given.get("relativeTolerance")) if solver == "cvode" else None
        more = f", step {solver_step:g} s" if solver_step is not None else ""
        more += f", relative tolerance {tolerance:g}" if tolerance is not None else ""
        notes.append(f"{annotation.where}: the solver {solver}{more} is taken over from OMSimulator's annotation")
    ignored += [name for name in found if name not in (*_MASTERS, *_SOLVERS)]
    ignored += [f"{name} of FixedStepMaster" for name in fixed if name not in ("description", "stepSize")]
    if ignored:
        notes.append(f"{annotation.where}: {OMS_IGNORED.text(', '.join(ignored))}")
    return Settings(step, solver, solver_step, tolerance, tuple(notes), named, uses)


def _named(given: Mapping[str, str]) -> tuple[Named, str]:
    """Returns a named solver, and the note on it."""
    name, method = given["name"], given["method"]
    solver = method if method in ("cvode", "euler") else None
    step = _positive(given.get("fixedStepSize")) if method in ("oms_ma", "euler") else None
    tolerance = _positive(given.get("relativeTolerance", given.get("tolerance"))) if method == "cvode" else None
    more = f", step {step:g} s" if step is not None else ""
    more += f", relative tolerance {tolerance:g}" if tolerance is not None else ""
    if solver is None and step is None:
        return Named(None, None, None), f'"{name}" ({method}) of OMSimulator\'s annotation says no step'
    return Named(solver, step, tolerance), f'"{name}" ({method}{more}) is taken over from OMSimulator\'s annotation'


def _elements(element: etree._Element) -> Iterator[etree._Element]:
    """Returns the elements that carry content: all inner elements except wrappers."""
    for item in element.iter():
        if item is element or not isinstance(item.tag, str):
            continue
        if local_name(item) not in ("Annotations", "SimulationInformation") or item.attrib:
            yield item


def _positive(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if 0.0 < value < math.inf else None


def _shown(attributes: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in attributes.items())

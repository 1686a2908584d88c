"""Reads annotations of OMSimulator in an .ssd (org.openmodelica): the step of its master, and its solver.

    <oms:SimulationInformation>
      <oms:FixedStepMaster description="oms-ma" stepSize="0.01" .../>          taken over: the step of its system
      <oms:VariableStepMaster description="oms-mav" maximumStepSize=... .../>  named: steps have one size here
      <oms:VariableStepSolver description="cvode" relativeTolerance=... .../>  taken over for FMUs for Model Exchange
      <oms:FixedStepSolver description="euler" stepSize=... .../>              the same

Names count, namespaces do not: they differ between its versions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lxml import etree

from cosim_master.diagnostics.limitations import OMS_IGNORED, OMS_MASTER
from cosim_master.files.xml import local_name
from cosim_master.system.structure import Annotation

__all__ = ["OMSIMULATOR", "Settings", "settings"]

OMSIMULATOR = "org.openmodelica"
_MASTERS = ("FixedStepMaster", "VariableStepMaster")
_SOLVERS = ("FixedStepSolver", "VariableStepSolver")


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings of one annotation.

    Attributes:
        step: of the master, s; None if it names none of one size.
        solver: "cvode" or "euler", with its `solver_step` (s) or `tolerance` (relative); None if it names none.
        notes: what is taken over, and what is not.
    """

    step: float | None
    solver: str | None
    solver_step: float | None
    tolerance: float | None
    notes: tuple[str, ...]


def settings(annotation: Annotation) -> Settings:
    """The settings that OMSimulator has written into an annotation."""
    found = {
        local_name(item): {str(name): str(text) for name, text in item.attrib.items()}
        for item in _elements(annotation.element)
    }
    fixed = found.get("FixedStepMaster", {})
    step = _positive(fixed.get("stepSize"))
    notes: list[str] = []
    ignored: list[str] = []
    if step is not None:
        notes.append(f"{annotation.where}: the step of {step:g} s is taken over from OMSimulator's annotation")
    if (varying := found.get("VariableStepMaster")) is not None:
        notes.append(f"{annotation.where}: {OMS_MASTER.text(_shown(varying))}")
    solver, solver_step, tolerance = None, None, None
    for name in _SOLVERS:
        if (given := found.get(name)) is None:
            continue
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
    return Settings(step, solver, solver_step, tolerance, tuple(notes))


def _elements(element: etree._Element) -> Iterator[etree._Element]:
    """What says something: all elements inside but the frames around them."""
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

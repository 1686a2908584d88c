"""Annotations of OMSimulator in an .ssd: what is taken over, and what is said of the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system

OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
MASTER = '<oms:FixedStepMaster description="oms-ma" stepSize="0.02" absoluteTolerance="0.0001"/>'
VARIABLE = '<oms:VariableStepMaster description="oms-mav" initialStepSize="1e-6" maximumStepSize="0.1"/>'


@pytest.fixture
def annotated(probes: Any) -> Any:
    """A system of probes (step 0.5 s) with an annotation of OMSimulator, and one of ours."""
    probes.fmu()

    def make(inner: str, *, component: str = "", ours: str = "") -> CheckedSystem:
        frame = f'<oms:Annotations xmlns:oms="{OMS}"><oms:SimulationInformation>{{}}</oms:SimulationInformation>'
        frame += "</oms:Annotations>"
        items = probes.workshop.annotation("org.openmodelica", frame.format(inner)) if inner else ""
        stepping = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{ours}"/>'
        own = probes.workshop.annotation("org.uav-cosim.stepping", stepping) if ours else ""
        path: Path = probes.ssd(probes.component("a", after=own) + probes.component("b"), after=items)
        return check(read_system(path))

    return make


def steps(checked: CheckedSystem) -> list[float | None]:
    return [one.step_size for one in checked.instances]


def test_the_step_of_its_master_is_taken_over(annotated: Any) -> None:
    checked = annotated(MASTER)
    assert steps(checked) == [0.02, 0.02]
    notes = "\n".join(checked.notes)
    assert "the step of 0.02 s is taken over from OMSimulator's annotation" in notes
    assert "settings of OMSimulator that are ignored: absoluteTolerance of FixedStepMaster" in notes


def test_an_annotation_of_ours_comes_first(annotated: Any) -> None:
    assert steps(annotated(MASTER, ours="0.1")) == [0.1, 0.02]


def test_variable_steps_are_named(annotated: Any) -> None:
    checked = annotated(VARIABLE)
    assert steps(checked) == [0.5, 0.5]
    text = "variable steps is not taken over (description oms-mav, initialStepSize 1e-6, maximumStepSize 0.1)"
    assert any(text in note for note in checked.notes)


@pytest.mark.parametrize("size", ["0", "-1", "soon", "INF"])
def test_a_step_that_is_none_is_not_taken_over(annotated: Any, size: str) -> None:
    checked = annotated(MASTER.replace("0.02", size))
    assert steps(checked) == [0.5, 0.5]
    assert not any("taken over from" in note for note in checked.notes)


def test_a_solver_is_taken_over(annotated: Any) -> None:
    """Of FMUs for co-simulation it is nothing but a note."""
    checked = annotated('<oms:VariableStepSolver description="cvode" relativeTolerance="1e-7"/>')
    assert any("the solver cvode, relative tolerance 1e-07 is taken over" in note for note in checked.notes)
    assert [one.solver for one in checked.instances] == [None, None]

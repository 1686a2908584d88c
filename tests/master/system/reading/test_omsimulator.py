"""Annotations of OMSimulator in an .ssd: what is taken over, and what is said of the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cosim_master.diagnostics.errors import Finding, SystemDescriptionError
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.time_grid import time_grid

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


def named(name: str, method: str = "", **more: object) -> str:
    """An annotation as OMSimulator 3 writes it: a named solver of a system, or which one is a component's."""
    about = "".join(f' {key}="{value}"' for key, value in (("method", method), *more.items()) if value)
    return f'<oms:Annotations xmlns:oms="{OMS}"><oms:SimulationInformation name="{name}"{about}/></oms:Annotations>'


@pytest.fixture
def ball(dynamics: Any, workshop: Any) -> Any:
    """A system of one ball: an FMU that falls by g = -9.81 from h = 1, and names no step."""

    def make(defined: str, used: str = "", kinds: str = "ME CS", tool: str = "", bindings: str = "") -> CheckedSystem:
        dynamics.fmu("BALL", 2, kinds, name="ball.fmu")
        own = workshop.annotation("org.openmodelica", named(used)) if used else ""
        inner = workshop.system(workshop.component("ball", "ball.fmu", after=own, bindings=bindings), name="inner")
        around = workshop.annotation("org.openmodelica", defined) if defined else ""
        path: Path = workshop.ssd("s.ssd", workshop.system(inner, after=around))
        path.write_text(path.read_text().replace(' name="test"', f' name="test" generationTool="{tool}"'))
        return check(read_system(path))

    return make


def test_a_component_that_names_a_solver_is_integrated_by_it(ball: Any) -> None:
    checked = ball(named("fine", "cvode", relativeTolerance="1e-7"), "fine")
    (instance,) = checked.instances
    assert instance.fmu.model_exchange is not None
    assert instance.solver == Choice("cvode", tolerance=1e-7)
    notes = "\n".join(checked.notes)
    assert '"fine" (cvode, relative tolerance 1e-07) is taken over from OMSimulator\'s annotation' in notes
    assert "ignored" not in notes


def test_euler_has_a_step(ball: Any) -> None:
    (instance,) = ball(named("coarse", "euler", fixedStepSize="0.25"), "coarse").instances
    assert instance.solver == Choice("euler", step=0.25)


@pytest.mark.parametrize(("method", "used"), [("oms_ma", "it"), ("cvode", "another"), ("cvode", "")])
def test_without_a_solver_of_its_own_it_is_co_simulated(ball: Any, method: str, used: str) -> None:
    (instance,) = ball(named("it", method), used).instances
    assert instance.fmu.model_exchange is None and instance.solver is None


def test_a_master_with_a_name_gives_the_step_of_its_components(ball: Any) -> None:
    assert steps(ball(named("it", "oms_ma", fixedStepSize="0.02"), "it")) == [0.02]


def test_an_fmu_that_has_no_model_exchange_cannot_have_its_solver(ball: Any) -> None:
    with pytest.raises(SystemDescriptionError, match="ModelExchange"):
        ball(named("it", "cvode"), "it", kinds="CS")


@pytest.mark.parametrize(
    ("defined", "tool"), [(named("it", "oms_ma"), ""), ("", "OMSimulator v3.0.0"), ("", "Another")]
)
def test_a_system_without_a_step_has_the_default_of_omsimulator(ball: Any, defined: str, tool: str) -> None:
    checked = ball(defined, tool=tool)
    assert steps(checked) == [0.001]
    assert [one.step_source for one in checked.instances] == ["default"]
    clock = time_grid(checked, until=0.01)
    assert (clock.base, clock.steps) == (1_000_000, 10)
    text = "inner.ball: neither system nor FMU names a step size: 0.001 s are taken, as in OMSimulator; --step gives"
    assert any(note.startswith(text) for note in clock.notes)
    assert not any("names a step size" in note for note in time_grid(checked, until=1.0, step=0.5).notes)


def test_types_with_a_name_as_omsimulator_writes_them(dynamics: Any, workshop: Any) -> None:
    """It writes the declared type of the FMU's variable; by the schema only an Enumeration has a name."""
    dynamics.fmu("BALL", 2, "CS", name="ball.fmu")
    path: Path = workshop.ssd("s.ssd", workshop.system(workshop.component("ball", "ball.fmu", "h:output:Real:m")))
    path.write_text(path.read_text().replace('<ssc:Real unit="m"/>', '<ssc:Real name="Position"/>'))
    assert 'name="Position"' in path.read_text()
    checked = check(read_system(path))
    (finding,) = [note for note in checked.notes if isinstance(note, Finding)]
    assert finding.endswith('name="Position" of <Real> is ignored: only an Enumeration has a name')
    path.write_text(path.read_text().replace('name="Position"', 'label="Position"'))
    with pytest.raises(SystemDescriptionError, match='<Real> has no attribute "label"'):
        check(read_system(path))


def mapped(workshop: Any, target: str, version: str = "") -> str:
    """A binding with a mapping, inline, as OMSimulator writes it."""
    space = 'xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"'
    entry = f'<ssm:MappingEntry source="p" target="{target}"/>'
    mapping = f"<ssd:ParameterMapping><ssm:ParameterMapping {space}{version}>{entry}</ssm:ParameterMapping>"
    text: str = workshop.bindings({"p": 3.0})
    return text.replace("</ssd:ParameterBinding>", f"{mapping}</ssd:ParameterMapping></ssd:ParameterBinding>")


def test_inline_mappings_without_a_version_have_that_of_the_file(ball: Any, workshop: Any) -> None:
    checked = ball("", tool="OMSimulator", bindings=mapped(workshop, "g"))
    assert checked.instances[0].start_values == {"g": 3.0}
    (finding,) = [note for note in checked.notes if isinstance(note, Finding)]
    assert "<ParameterMapping> has no version: read as 1.0, that of the file" in finding


def test_entries_of_a_mapping_with_an_empty_source_map_nothing(ball: Any, workshop: Any) -> None:
    """SSP 2.0, 7: source is any string, and no parameter is called ""; OMSimulator writes templates of such entries."""
    empty = '<ssm:MappingEntry source="" target="h"/><ssm:MappingEntry source="" target="v"/>'
    binding = mapped(workshop, "g", ' version="1.0"').replace("<ssm:MappingEntry", f"{empty}<ssm:MappingEntry", 1)
    checked = ball("", tool="OMSimulator", bindings=binding)
    assert checked.instances[0].start_values == {"g": 3.0}
    assert any('source="" names no parameter: 2 entries of the mapping map nothing' in note for note in checked.notes)
    with pytest.raises(SystemDescriptionError, match='"target" of <MappingEntry> is empty'):
        ball("", tool="OMSimulator", bindings=binding.replace('target="v"', 'target=""'))


def test_names_in_a_binding_of_a_component_may_begin_with_the_component(ball: Any, workshop: Any) -> None:
    """SSP 2.0, 5.2.3: they are relative to the component; OMSimulator writes them relative to the system around it."""
    checked = ball("", tool="OMSimulator", bindings=mapped(workshop, "ball.g", ' version="1.0"'))
    assert checked.instances[0].start_values == {"g": 3.0}
    (finding,) = [note for note in checked.notes if isinstance(note, Finding)]
    assert '"ball.g" in a binding of "ball" itself is read as "g"' in finding


def test_names_in_a_binding_of_a_component_that_match_nothing_stay_so(ball: Any, workshop: Any) -> None:
    checked = ball("", tool="OMSimulator", bindings=mapped(workshop, "ball.x", ' version="1.0"'))
    assert checked.instances[0].start_values == {}
    assert [one.name for one in checked.unmatched] == ["inner.ball.ball.x"]


def test_a_set_may_repeat_names_that_match_nothing(ball: Any, workshop: Any) -> None:
    """So do the files of the aircraft that OMSimulator is tested with."""
    twice = workshop.bindings({"length": 1.0, "g": 2.0}).replace("</ssv:Parameters>", "{}</ssv:Parameters>")
    again = '<ssv:Parameter name="{}"><ssv:Real value="5"/></ssv:Parameter>'
    checked = ball("", tool="OMSimulator", bindings=twice.format(again.format("length")))
    assert checked.instances[0].start_values == {"g": 2.0}
    with pytest.raises(SystemDescriptionError, match=r'parameter "g" is already in this set, at .*s\.ssd:\d+'):
        ball("", tool="OMSimulator", bindings=twice.format(again.format("g")))

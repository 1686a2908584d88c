"""The hybrid models of dynamic.c as FMU files of FMI 1, 2 and 3, for co-simulation and Model Exchange."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, attributes
from tests.master.fmus.probe import SHARED_LIBRARY

SOURCE = Path(__file__).with_name("dynamic.c")


@dataclass(frozen=True)
class V:
    """A variable: name, type, reference, causality, variability, start, and of which it is the derivative."""

    name: str
    type: str
    reference: int
    causality: str = "local"
    variability: str = "continuous"
    start: str | None = None
    derivative: str | None = None


def _state(name: str, reference: int, start: str) -> V:
    return V(name, "Real", reference, "output", start=start)


MODELS: Mapping[str, tuple[V, ...]] = {
    "DAHLQUIST": (
        _state("x", 0, "1"),
        V("der(x)", "Real", 1, derivative="x"),
        V("k", "Real", 2, "parameter", "fixed", "1"),
    ),
    "VANDERPOL": (
        _state("x", 0, "2"),
        _state("y", 1, "0"),
        V("der(x)", "Real", 2, derivative="x"),
        V("der(y)", "Real", 3, derivative="y"),
        V("mu", "Real", 4, "parameter", "fixed", "1"),
        V("asked", "Integer", 3, "output", "discrete"),
    ),
    "BALL": (
        _state("h", 0, "1"),
        _state("v", 1, "0"),
        V("der(h)", "Real", 2, derivative="h"),
        V("der(v)", "Real", 3, derivative="v"),
        V("g", "Real", 4, "parameter", "fixed", "-9.81"),
        V("e", "Real", 5, "parameter", "fixed", "0.7"),
        V("bounces", "Integer", 0, "output", "discrete"),
    ),
    "STAIR": (V("counter", "Integer", 0, "output", "discrete"),),
    "DRIVE": (
        _state("x", 0, "0"),
        V("der(x)", "Real", 1, derivative="x"),
        V("u", "Real", 2, "input", start="0"),
        V("gain", "Real", 3, "parameter", "tunable", "1"),
        V("y", "Real", 4, "output"),
        V("on", "Boolean", 0, "input", "discrete", "false"),
        V("m", "Integer", 0, "input", "discrete", "0"),
        V("latched", "Integer", 1, "output", "discrete"),
        V("passed", "Integer", 2, "output", "discrete"),
        V("s", "String", 0, "input", "discrete", "a"),
        V("t", "String", 1, "output", "discrete"),
    ),
}
_OFFSET = {"Real": 0, "Integer": 10, "Boolean": 20, "String": 30}
_TYPES3 = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "String": "String"}
_INDICATORS = {"BALL": 1}
_STATES = 'canGetAndSetFMUstate="true" canSerializeFMUstate="true"'
STATES3 = 'canGetAndSetFMUState="true" canSerializeFMUState="true"'


@cache
def library(model: str, fmi: int, folder: Path) -> bytes:
    number = list(MODELS).index(model) + 1
    file = folder / f"dynamic_{model}_{fmi}{SUFFIX[platform()]}"
    flags = [f"-DMODEL={number}", f"-DFMI={fmi}", str(SOURCE), "-o", str(file)]
    subprocess.run([*SHARED_LIBRARY, *flags], check=True)
    return file.read_bytes()


def _outer(v: V) -> dict[str, Any]:
    initial = None
    if v.start is not None and v.causality in ("output", "local"):
        initial = "exact"
    return {
        "name": v.name,
        "valueReference": v.reference,
        "causality": v.causality,
        "variability": v.variability,
        "initial": initial,
    }


def _description1(model: str, experiment: str) -> str:
    rows = ""
    for v in MODELS[model]:
        causality = {"local": "internal", "parameter": "internal"}.get(v.causality, v.causality)
        variability = {"fixed": "parameter", "tunable": "parameter"}.get(v.variability, v.variability)
        start = None if v.start is None or v.causality == "output" else v.start
        head = {"name": v.name, "valueReference": v.reference, "causality": causality, "variability": variability}
        rows += f"<ScalarVariable{attributes(head)}><{v.type}{attributes({'start': start})}/></ScalarVariable>\n"
    return (
        f'<fmiModelDescription fmiVersion="1.0" modelName="{model.title()}" modelIdentifier="Dynamic" guid="dynamic" '
        f'numberOfContinuousStates="0" numberOfEventIndicators="0">\n{experiment}\n<ModelVariables>\n{rows}'
        "</ModelVariables>\n<Implementation><CoSimulation_StandAlone><Capabilities "
        'canHandleVariableCommunicationStepSize="true" canHandleEvents="true"/></CoSimulation_StandAlone>'
        "</Implementation>\n</fmiModelDescription>\n"
    )


def _description2(model: str, experiment: str, interfaces: str) -> str:
    variables = MODELS[model]
    index = {v.name: i + 1 for i, v in enumerate(variables)}
    rows = ""
    for v in variables:
        inner = {"start": v.start, "derivative": None if v.derivative is None else index[v.derivative]}
        rows += f"<ScalarVariable{attributes(_outer(v))}><{v.type}{attributes(inner)}/></ScalarVariable>\n"

    def unknown(name: str) -> str:
        return f'<Unknown index="{index[name]}"/>'

    outputs = "".join(unknown(v.name) for v in variables if v.causality == "output")
    derived = "".join(unknown(v.name) for v in variables if v.derivative)
    initial = "".join(
        unknown(v.name) for v in variables if (v.causality == "output" and v.start is None) or v.derivative
    )
    structure = f"<Outputs>{outputs}</Outputs>"
    structure += f"<Derivatives>{derived}</Derivatives>" if derived else ""
    structure += f"<InitialUnknowns>{initial}</InitialUnknowns>" if initial else ""
    return (
        f'<fmiModelDescription fmiVersion="2.0" modelName="{model.title()}" guid="dynamic" '
        f'numberOfEventIndicators="{_INDICATORS.get(model, 0)}">\n{interfaces}\n{experiment}\n'
        f"<ModelVariables>\n{rows}</ModelVariables>\n<ModelStructure>{structure}</ModelStructure>\n</fmiModelDescription>\n"
    )


def _description3(model: str, experiment: str, interfaces: str) -> str:
    variables = MODELS[model]
    rows = '<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>\n'
    reference = {v.name: v.reference + _OFFSET[v.type] for v in variables}
    for v in variables:
        head = {**_outer(v), "valueReference": reference[v.name]}
        head["derivative"] = None if v.derivative is None else reference[v.derivative]
        if v.type == "String":
            start = "" if v.start is None else f'<Start value="{v.start}"/>'
            rows += f"<String{attributes(head)}>{start}</String>\n"
        else:
            rows += f"<{_TYPES3[v.type]}{attributes({**head, 'start': v.start})}/>\n"
    unknowns = "".join(f'<Output valueReference="{reference[v.name]}"/>' for v in variables if v.causality == "output")
    unknowns += "".join(
        f'<ContinuousStateDerivative valueReference="{reference[v.name]}"/>' for v in variables if v.derivative
    )
    unknowns += "".join(
        f'<InitialUnknown valueReference="{reference[v.name]}"/>'
        for v in variables
        if (v.causality == "output" and v.start is None) or v.derivative
    )
    if model == "BALL":
        unknowns += '<EventIndicator valueReference="0"/>'
    return (
        f'<fmiModelDescription fmiVersion="3.0" modelName="{model.title()}" instantiationToken="dynamic">\n'
        f"{interfaces}\n"
        f"{experiment}\n<ModelVariables>\n{rows}</ModelVariables>\n<ModelStructure>{unknowns}</ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


class Dynamics:
    """Writes FMUs of dynamic.c into a folder."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root = root
        self._folder = folder

    def fmu(
        self,
        model: str,
        fmi: int = 2,
        kinds: str = "ME",
        *,
        name: str | None = None,
        stop: float | None = 10.0,
        step: float | None = None,
        start: float | None = None,
        tolerance: float | None = None,
        flags: str = "",
        sources: bool = False,
        binary: bool = True,
        extra: Mapping[str, str] | None = None,
    ) -> Path:
        """An FMU; `kinds` are "ME", "CS" or "ME CS"; `extra` further members."""
        path = self.root / (name or f"{model.title()}{fmi}.fmu")
        times = {"startTime": start, "stopTime": stop, "tolerance": tolerance, "stepSize": step if fmi > 1 else None}
        experiment = f"<DefaultExperiment{attributes(times)}/>" if any(x is not None for x in times.values()) else ""
        jacobian = ""
        if model == "VANDERPOL":
            jacobian = {2: ' providesDirectionalDerivative="true"', 3: ' providesDirectionalDerivatives="true"'}.get(
                fmi, ""
            )
        states = _STATES if fmi == 2 else STATES3
        files = '<SourceFiles><File name="dynamic.c"/></SourceFiles>' if sources and fmi == 2 else ""
        variable_steps = 'canHandleVariableCommunicationStepSize="true"'
        made = {
            "ME": f'<ModelExchange modelIdentifier="Dynamic"{jacobian} {states} {flags}>{files}</ModelExchange>',
            "CS": f'<CoSimulation modelIdentifier="Dynamic" {variable_steps} {states} {flags}>{files}</CoSimulation>',
        }
        interfaces = "".join(made[kind] for kind in kinds.split())
        if fmi == 1:
            text = _description1(model, experiment)
        elif fmi == 2:
            text = _description2(model, experiment, interfaces)
        else:
            text = _description3(model, experiment, interfaces)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", f'<?xml version="1.0" encoding="UTF-8"?>\n{text}')
            if binary:
                member = f"binaries/{platform(fmi)}/Dynamic{SUFFIX[platform()]}"
                archive.writestr(member, library(model, fmi, self._folder))
            for member, content in (extra or {}).items():
                archive.writestr(member, content)
        return path

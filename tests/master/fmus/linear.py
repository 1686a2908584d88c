"""Linear FMUs (see linear.c), systems of them with a master, and their closed-form solutions."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, Workshop, variable
from tests.master.fmus.probe import compiled

ABLE = (
    'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true" canSerializeFMUstate="true" '
    'canInterpolateInputs="true"'
)
_PARAMETERS = ("x0", "v0", "w2", "gain", "rate")


class Linears:
    """Writes linear FMUs and systems of them into a workshop."""

    def __init__(self, workshop: Workshop, folder: Path) -> None:
        self.workshop = workshop
        self._folder = folder

    def fmu(self, name: str = "linear.fmu", *, flags: str = ABLE) -> Path:
        variables = [
            variable("u"),
            variable("y", "output"),
            *(variable(one, "parameter", start="0") for one in _PARAMETERS),
            variable("n", "output", kind="Integer"),
            variable("v", "output"),
        ]
        for place, reference in enumerate([0, 1, 2, 3, 4, 5, 6, 0, 7]):
            variables[place] = variables[place].replace("'@'", f'"{reference}"')
        path = self.workshop.root / name
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", self.workshop.description(variables, flags=flags))
            library = compiled(Path(__file__).with_name("linear.c"), self._folder)
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)
        return path

    def component(self, name: str, fmu: str = "linear.fmu", *, step: float | None = None, **values: float) -> str:
        inner = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{step}"/>'
        after = "" if step is None else self.workshop.annotation("org.uav-cosim.stepping", inner)
        given = {one: float(value) for one, value in values.items()}
        ports = "u:input y:output v:output n:output " + " ".join(f"{one}:parameter" for one in _PARAMETERS)
        return self.workshop.component(name, fmu, ports, self.workshop.bindings(given) if given else "", after)

    def ssd(self, parts: str, *wires: str, master: str = "", stop: float = 1.0, interval: float | None = None) -> Path:
        """A system; a wire is "a/y b/u", `master` its attributes and children as they follow "<master "."""
        connections = "".join(self.workshop.connection(*wire.split()) for wire in wires)
        notes = []
        if master:
            element = f'<master xmlns="https://uav-cosim.org/ns/1" {master}'
            notes.append(f'<ssc:Annotation type="org.uav-cosim.master">{element}</ssc:Annotation>')
        if interval is not None:
            element = f'<recording xmlns="https://uav-cosim.org/ns/1" interval="{interval!r}"/>'
            notes.append(f'<ssc:Annotation type="org.uav-cosim.recording">{element}</ssc:Annotation>')
        after = f"<ssd:Annotations>{''.join(notes)}</ssd:Annotations>" if notes else ""
        experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop!r}"/>'
        system = self.workshop.system(parts, connections, after=after)
        return Path(self.workshop.ssd("linear.ssd", system, experiment))


def signals(out: Path) -> dict[str, Any]:
    return {name: np.array(column) for name, column in pq.read_table(out / "signals.parquet").to_pydict().items()}


def exact(matrix: Any, start: Any, times: Any) -> Any:
    """Rows exp(A t) x0, by eigenvectors."""
    values, vectors = np.linalg.eig(np.array(matrix, dtype=float))
    weights = np.linalg.solve(vectors, np.array(start, dtype=complex))
    return np.real(np.exp(np.outer(times, values)) * weights @ vectors.T)


BALL = (
    '<?xml version="1.0" encoding="UTF-8"?>'
    '<fmiModelDescription fmiVersion="3.0" modelName="Ball" instantiationToken="ball">'
    '<CoSimulation modelIdentifier="Unit" hasEventMode="true" mightReturnEarlyFromDoStep="true" '
    'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true" canSerializeFMUState="true"/>'
    "<ModelVariables>"
    '<Float64 name="height" valueReference="0" causality="output" initial="calculated"/>'
    '<Float64 name="speed" valueReference="1" causality="output" initial="calculated"/>'
    '<Float64 name="last" valueReference="2" causality="output" variability="discrete" initial="calculated"/>'
    '<Int32 name="bounces" valueReference="3" causality="output" variability="discrete" initial="calculated"/>'
    '<Int32 name="announced" valueReference="4" causality="parameter" variability="fixed" start="1"/>'
    '<Float64 name="e" valueReference="5" causality="parameter" variability="fixed" start="0.7"/>'
    '<Float64 name="time" valueReference="6" causality="independent" variability="continuous"/>'
    "</ModelVariables><ModelStructure>"
    + "".join(
        f'<{tag} valueReference="{i}" dependencies=""/>' for tag in ("Output", "InitialUnknown") for i in range(4)
    )
    + "</ModelStructure></fmiModelDescription>"
)
BALL_PORTS = "height:output speed:output last:output bounces:output announced:parameter"


def ball(workshop: Workshop, folder: Path) -> Path:
    """The bouncing ball of ball.c."""
    path = workshop.root / "ball.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", BALL)
        library = compiled(Path(__file__).with_name("ball.c"), folder)
        archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", library)
    return path


def impacts(n: int, restitution: float = 0.7) -> list[float]:
    """Times at which the ball hits the ground, s."""
    g, times = 9.81, [(2.0 / 9.81) ** 0.5]
    speed = g * times[0]
    while len(times) < n:
        speed *= restitution
        times.append(times[-1] + 2.0 * speed / g)
    return times

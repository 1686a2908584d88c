"""FMUs with the habits of other tools (see foreign.c), and systems of them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, Workshop, variable
from tests.master.fmus.probe import compiled

PORTS = "u:input i:input b:input p:parameter silent:parameter y:output t:output h:output x:output n:output j:output"
VARIABLE = 'canHandleVariableCommunicationStepSize="true"'
_VARIABLES = (
    (0, variable("u")),
    (1, variable("p", "parameter", start="5", initial="exact")),
    (2, variable("y", "output")),
    (3, variable("t", "output")),
    (4, variable("h", "output")),
    (5, variable("x", "output")),
    (6, variable("silent", "parameter", start="1e9", initial="exact")),
    (0, variable("n", "output", kind="Integer")),
    (1, variable("i", kind="Integer")),
    (2, variable("j", "output", kind="Integer")),
    (0, variable("b", kind="Boolean")),
    (1, variable("on", "output", kind="Boolean")),
)


class Foreigners:
    """Writes foreign FMUs and systems of them into a workshop."""

    def __init__(self, workshop: Workshop, folder: Path) -> None:
        self.workshop = workshop
        self._folder = folder

    def fmu(
        self,
        name: str = "foreign.fmu",
        *,
        habit: str = "plain",
        tool: str = "",
        step: object = None,
        flags: str = VARIABLE,
        unit: str | None = None,
    ) -> Path:
        """A foreign FMU: `habit` is its GUID, `tool` its generationTool, `unit` that of p."""
        given = [text.replace("'@'", f'"{reference}"') for reference, text in _VARIABLES]
        if unit is not None:
            given[1] = given[1].replace("<Real", f'<Real unit="{unit}"')
        text = self.workshop.description(given, step=step, flags=flags)
        text = text.replace('guid="{0}"', f'guid="{habit}" generationTool="{tool}"')
        path = self.workshop.root / name
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", text)
            library = compiled(Path(__file__).with_name("foreign.c"), self._folder)
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)
        return path

    def component(
        self, name: str, fmu: str = "foreign.fmu", *, step: object = None, ports: str = "", **values: Any
    ) -> str:
        """A component; `step` is its stepSize, `ports` are more than those without a type."""
        inner = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{step}"/>'
        after = "" if step is None else self.workshop.annotation("org.uav-cosim.stepping", inner)
        bindings = self.workshop.bindings(values) if values else ""
        return self.workshop.component(name, fmu, f"{PORTS} on:output {ports}", bindings, after)

    def ssd(self, parts: str, *wires: str, stop: object = 1.0, annotations: str = "") -> Path:
        """A system; a wire is "a/y b/u", `annotations` are <ssc:Annotation>s of it."""
        connections = "".join(self.workshop.connection(*wire.split()) for wire in wires)
        after = f"<ssd:Annotations>{annotations}</ssd:Annotations>" if annotations else ""
        experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/>'
        return self.workshop.ssd("foreign.ssd", self.workshop.system(parts, connections, after=after), experiment)

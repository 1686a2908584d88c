"""The strict FMI 3 FMU (see strict3.c), systems of it, and what it has to complain about."""

from __future__ import annotations

import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any

from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, Workshop
from tests.master.fmus.probe import compiled

NUMBERS = ("Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean")
SHORT = {name: name.lower().replace("float", "f").replace("uint", "u").replace("int", "i") for name in NUMBERS}
SHORT["Boolean"] = "b"
ABLE = 'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true"'


def description(flags: str = ABLE, step: float = 0.5, token: str = "strict3", extra: str = "") -> str:
    """modelDescription.xml of the strict FMU; `extra` are more variables."""
    variables, structure = [], []

    def add(
        kind: str, name: str, reference: int, *, of: int, attributes: str = "", start: str = "0", inner: str = ""
    ) -> None:
        discrete = "" if kind.startswith("Float") else 'variability="discrete"'
        given = "" if kind in ("String", "Binary") else f'start="{start}"'
        children = inner if kind not in ("String", "Binary") else '<Start value=""/>'
        variables.append(
            f'<{kind} name="{name}_in" valueReference="{reference}" causality="input" '
            f"{discrete} {attributes} {given}>"
            f"{children}</{kind}>"
            f'<{kind} name="{name}_out" valueReference="{of}" causality="output" {discrete} {attributes}>'
            f"{inner}</{kind}>"
        )
        structure.append((of, reference))

    for i, kind in enumerate(NUMBERS, start=1):
        start = "false" if kind == "Boolean" else "0"
        add(kind, SHORT[kind], i, of=20 + i, start=start, inner='<Dimension start="2"/>')
    add("String", "s", 50, of=51)
    add("Binary", "d", 52, of=53, attributes='mimeType="application/x-test" maxSize="64"')
    add("Enumeration", "e", 54, of=55, attributes='declaredType="Level"', start="1")
    parameters = (
        '<Int32 name="mode" valueReference="40" causality="parameter" variability="fixed" start="0"/>'
        '<Float64 name="when" valueReference="41" causality="parameter" variability="fixed" start="0"/>'
        '<Float64 name="longest" valueReference="42" causality="parameter" variability="fixed" start="1"/>'
        '<Float64 name="time" valueReference="43" causality="independent" variability="continuous"/>'
        '<Int32 name="events" valueReference="44" causality="output" variability="discrete"/>'
    )
    structure.append((44, 0))
    known = {reference: f"{of}" if of else "" for reference, of in structure}
    unknowns = "".join(
        f'<{tag} valueReference="{reference}" dependencies="{of}"/>'
        for tag in ("Output", "InitialUnknown")
        for reference, of in known.items()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="3.0" modelName="Strict" instantiationToken="{token}">'
        f'<CoSimulation modelIdentifier="Unit" {flags}/>'
        '<TypeDefinitions><EnumerationType name="Level"><Item name="low" value="1"/><Item name="high" value="5"/>'
        f'</EnumerationType></TypeDefinitions><DefaultExperiment stepSize="{step}"/>'
        f"<ModelVariables>{''.join(variables)}{parameters}{extra}</ModelVariables>"
        f"<ModelStructure>{unknowns}</ModelStructure></fmiModelDescription>"
    )


@lru_cache(maxsize=1)
def _library(folder: Path) -> bytes:
    return compiled(Path(__file__).with_name("strict3.c"), folder)


class Stricts3:
    """Writes strict FMI 3 FMUs and systems of them into a workshop."""

    def __init__(self, workshop: Workshop, folder: Path, log: Path, calls: Path) -> None:
        self.workshop = workshop
        self.folder, self._log, self._calls = folder, log, calls

    def fmu(self, name: str = "strict3.fmu", *, resources: bool = False, **options: Any) -> Path:
        path = self.workshop.root / name
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", description(**options))
            library = _library(self.folder)
            archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", library)
            if resources:
                archive.writestr("resources/note.txt", "here")
        return path

    def component(self, name: str, fmu: str = "strict3.fmu", *, ports: str = "", **values: Any) -> str:
        """Values of mode, when, longest and inputs; `ports` as for `Workshop.connectors`."""
        made = self.workshop.bindings(values) if values else ""
        return self.workshop.component(name, fmu, ports, made)

    def ssd(self, components: str, *wires: str, stop: float = 2.0) -> Path:
        """A system; a wire is "a/y b/u"."""
        connections = "".join(self.workshop.connection(*wire.split()) for wire in wires)
        experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/>'
        return self.workshop.ssd("strict3.ssd", self.workshop.system(components, connections), experiment)

    @property
    def complaints(self) -> list[str]:
        """What was not allowed, since this was last read."""
        return _lines(self._log)

    @property
    def calls(self) -> list[str]:
        """Steps (with their size), events (with their time) and what else is written down, since this was last read."""
        return _lines(self._calls)


def _lines(path: Path) -> list[str]:
    if not path.exists():
        return []
    lines = path.read_text().splitlines()
    path.unlink()
    return lines

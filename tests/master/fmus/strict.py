"""The strict FMU (see strict.c), systems of it, and what it has to complain about."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, Workshop, variable
from tests.master.fmus.probe import compiled

PORTS = "u:input b:input s:input p:parameter y:output n:output c:output r:output"
ABLE = 'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"'
_REFERENCES = {"u": 0, "p": 1, "y": 2, "when": 3, "longest": 4, "mode": 0, "n": 1, "s": 0, "r": 1, "b": 0, "c": 1}


class Stricts:
    """Writes strict FMUs and systems of them into a workshop."""

    def __init__(self, workshop: Workshop, folder: Path, log: Path, calls: Path) -> None:
        self.workshop = workshop
        self._folder, self._log, self._calls = folder, log, calls

    def fmu(
        self,
        name: str = "strict.fmu",
        *,
        flags: str = ABLE,
        step: float = 0.5,
        guid: str = "strict",
        complete: bool = False,
    ) -> Path:
        """A strict FMU; with the GUID "fixed" its steps must all have one size. `complete`: for libcosim too."""
        variables = [
            variable("u"),
            variable("p", "parameter", start="1", variability="tunable", max="1000"),
            variable("y", "output"),
            variable("when", "parameter", start="0"),
            variable("longest", "parameter", start="1"),
            variable("mode", "parameter", kind="Integer"),
            variable("n", "output", kind="Integer"),
            variable("s", kind="String"),
            variable("r", "output", kind="String"),
            variable("b", kind="Boolean"),
            variable("c", "output", kind="Boolean"),
        ]
        for place, reference in enumerate(_REFERENCES.values()):
            variables[place] = variables[place].replace("'@'", f'"{reference}"')
        text = self.workshop.description(variables, step=step, flags=flags)
        path = self.workshop.root / name
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", text.replace('guid="{0}"', f'guid="{guid}"'))
            library = compiled(Path(__file__).with_name("strict_complete.c" if complete else "strict.c"), self._folder)
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)
        return path

    def component(self, name: str, fmu: str = "strict.fmu", *, step: float | None = None, **values: Any) -> str:
        """Values of p, when, longest, mode and inputs; `step` gives it a step size of its own."""
        inner = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{step}"/>'
        after = "" if step is None else self.workshop.annotation("org.uav-cosim.stepping", inner)
        bindings = self.workshop.bindings(values) if values else ""
        return self.workshop.component(name, fmu, PORTS, bindings, after)

    def ssd(self, components: str, *wires: str, stop: float = 2.0) -> Path:
        """A system; a wire is "a/y b/u"."""
        connections = "".join(self.workshop.connection(*wire.split()) for wire in wires)
        experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/>'
        return self.workshop.ssd("strict.ssd", self.workshop.system(components, connections), experiment)

    @property
    def complaints(self) -> list[str]:
        """What was not allowed, since this was last read."""
        return _lines(self._log)

    @property
    def calls(self) -> list[str]:
        """What was called, since this was last read; of steps also time and size."""
        return _lines(self._calls)

    @property
    def steps(self) -> list[str]:
        """The attempted steps, since calls were last read."""
        return [line.replace(": step", "") for line in self.calls if ": step " in line]


def _lines(path: Path) -> list[str]:
    if not path.exists():
        return []
    lines = path.read_text().splitlines()
    path.unlink()
    return lines

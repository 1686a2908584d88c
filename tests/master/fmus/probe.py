"""The probe as a binary and as FMU files, systems of probes, and small models of other makes."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

from pythonfmu import FmuBuilder

from cosim.build import HOST, build, load_models
from cosim.build.native.compiled import TARGETS
from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, Workshop, variable

LEVEL = (
    '<SimpleType name="Level"><Enumeration><Item name="low" value="1"/><Item name="high" value="5"/></Enumeration>'
    "</SimpleType>"
)
PORTS = "u:input n:input b:input s:input e:input p:parameter y:output m:output c:output r:output f:output"

SHARED_LIBRARY = [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[HOST].zig]
SHARED_LIBRARY += ["-std=gnu11", "-O1", "-shared", "-fPIC", "-s", "-rtlib=none"]
"""The compiler, for the target of FMUs and, as they are, without zig's runtime library, which takes seconds to make."""


@cache
def compiled(source: Path, folder: Path, *more: str) -> bytes:
    """The library made of a C file, with more flags of the compiler."""
    library = folder / f"{source.stem}{SUFFIX[platform()]}"
    flags = [f"-I{Path(__file__).parent}", str(source), "-o", str(library)]
    subprocess.run([*SHARED_LIBRARY, *flags, *more], check=True)
    return library.read_bytes()


def probe_library(folder: Path) -> bytes:
    """The probe, compiled once."""
    return compiled(Path(__file__).with_name("probe.c"), folder)


class Probes:
    """Writes probe FMUs and systems of them into a workshop."""

    def __init__(self, workshop: Workshop, folder: Path, log: Path) -> None:
        self.workshop = workshop
        self.root = workshop.root
        self._folder = folder
        self._log = log

    def fmu(
        self,
        name: str = "probe.fmu",
        guid: str = "probe",
        step: object = 0.5,
        flags: str = "",
        binary: bytes | None = None,
    ) -> Path:
        """A probe FMU. Its outputs depend on the inputs of their type, directly and while initializing."""
        variables = [
            variable("u", unit="m"),
            variable("n", kind="Integer"),
            variable("b", kind="Boolean"),
            variable("s", kind="String"),
            variable("e", kind="Enumeration", declaredType="Level"),
            variable("p", "parameter", unit="m", start="0.25"),
            variable("mode", "parameter", kind="Integer"),
            variable("when", "parameter", unit="s"),
            variable("y", "output", unit="m"),
            variable("m", "output", kind="Integer"),
            variable("c", "output", kind="Boolean"),
            variable("r", "output", kind="String"),
            variable("f", "output", kind="Enumeration", declaredType="Level"),
        ]
        depends = {9: "1", 10: "2", 11: "3", 12: "4", 13: "5"}
        initial = {9: "1 6", 10: "2", 11: "3", 12: "4", 13: "5"}
        variable_step = 'canHandleVariableCommunicationStepSize="true"'
        text = self.workshop.description(
            variables, outputs=depends, initial=initial, step=step, types=LEVEL, flags=flags or variable_step
        )
        path = self.root / name
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", text.replace('guid="{0}"', f'guid="{guid}"'))
            library = probe_library(self._folder) if binary is None else binary
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)
        return path

    def component(self, name: str, fmu: str = "probe.fmu", after: str = "", **values: Any) -> str:
        bindings = self.workshop.bindings(values) if values else ""
        return self.workshop.component(name, fmu, PORTS, bindings, after)

    def ssd(self, components: str, *wires: str, stop: float = 2.0, after: str = "", name: str = "s.ssd") -> Path:
        """A system; a wire is "a/y b/u"."""
        connections = "".join(self.workshop.connection(*wire.split()) for wire in wires)
        experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/>'
        return self.workshop.ssd(name, self.workshop.system(components, connections, after=after), experiment)

    def step(self, size: float) -> str:
        """The annotation that gives a component its step size."""
        inner = f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{size}"/>'
        return self.workshop.annotation("org.uav-cosim.stepping", inner)

    @property
    def calls(self) -> list[str]:
        """What has been called since this was last read."""
        if not self._log.exists():
            return []
        lines = self._log.read_text().splitlines()
        self._log.unlink()
        return lines


def model(folder: Path, file: str, source: str, *, interpreted: bool = False) -> Path:
    """The FMU of the one model in a file of that name and content."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / file
    path.write_text(source)
    (found,) = load_models(str(path))
    built = build(found, folder, interpreted=interpreted)
    assert built.compiled == (found.kernels is not None and not interpreted)
    return built.file


def slave(folder: Path, file: str, source: str) -> Path:
    """An FMU of a plain pythonfmu slave, made by pythonfmu alone."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / file
    path.write_text(source)
    before, loaded = list(sys.path), sys.modules.get(path.stem)
    try:
        return Path(FmuBuilder.build_FMU(path, dest=folder))
    finally:
        sys.path[:] = before
        sys.modules.pop(path.stem, None)
        if loaded is not None:
            sys.modules[path.stem] = loaded

"""Small systems for tests of the master: FMUs whose library is never loaded, and SSP files, written by hand."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest

from cosim.kernel import cache_folder
from cosim_master.fmi.description.read import platform
from tests.master.view.browser import chromium

NAMESPACES = (
    'xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
    'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" '
    'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"'
)
UNITS = {
    "K": 'K="1"',
    "degC": 'K="1" offset="273.15"',
    "degF": 'K="1" factor="0.5555555555555556" offset="255.3722222222222"',
    "m": 'm="1"',
    "km": 'm="1" factor="1000"',
    "cm": 'm="1" factor="0.01"',
    "s": 's="1"',
    "rad": 'rad="1"',
    "deg": 'rad="1" factor="0.017453292519943295"',
}
SUFFIX = {"linux64": ".so", "win64": ".dll", "darwin64": ".dylib"}


def attributes(values: Mapping[str, object]) -> str:
    return "".join(f" {name}={quoteattr(str(value))}" for name, value in values.items() if value is not None)


def variable(name: str, causality: str = "input", kind: str = "Real", **attrs: object) -> str:
    """A ScalarVariable with legal variability and start; `attrs` go to its type element or override."""
    outer: dict[str, object] = {"name": name, "causality": causality}
    fixed = causality in ("parameter", "calculatedParameter")
    outer["variability"] = attrs.pop("variability", "fixed" if fixed else None if kind == "Real" else "discrete")
    outer["initial"] = attrs.pop("initial", None)
    if causality in ("input", "parameter") and "start" not in attrs:
        attrs["start"] = {"Boolean": "false", "String": ""}.get(kind, "1" if kind == "Enumeration" else "0")
    return f"<ScalarVariable{attributes(outer)} valueReference='@'><{kind}{attributes(attrs)}/></ScalarVariable>"


class Workshop:
    """Writes FMUs and SSP files below `root`; every method returns the path or the text it made."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def description(
        self,
        variables: Sequence[str],
        *,
        outputs: Mapping[int, str | None] | None = None,
        initial: Mapping[int, str | None] | None = None,
        step: object = None,
        units: Mapping[str, str] = UNITS,
        flags: str = "",
        version: str = "2.0",
        interface: str = "CoSimulation",
        types: str = "",
        extra: str = "",
    ) -> str:
        numbered = "".join(text.replace("'@'", f'"{index}"') for index, text in enumerate(variables))
        if outputs is None:
            outputs = {i + 1: "" for i, text in enumerate(variables) if 'causality="output"' in text}
        if initial is None:
            unknown = ('causality="output"', 'causality="calculatedParameter"')
            initial = {i + 1: "" for i, text in enumerate(variables) if any(part in text for part in unknown)}

        def unknowns(listed: Mapping[int, str | None]) -> str:
            return "".join(f"<Unknown{attributes({'index': i, 'dependencies': d})}/>" for i, d in listed.items())

        structure = f"<Outputs>{unknowns(outputs)}</Outputs>" if outputs else ""
        structure += f"<InitialUnknowns>{unknowns(initial)}</InitialUnknowns>" if initial else ""
        based = {name: f"<BaseUnit {base}/>" if base else "" for name, base in units.items()}
        defined = "".join(f'<Unit name="{name}">{base}</Unit>' for name, base in based.items())
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<fmiModelDescription fmiVersion="{version}" modelName="Unit" guid="{{0}}">\n'
            f'<{interface} modelIdentifier="Unit" {flags}/>\n'
            + (f"<UnitDefinitions>{defined}</UnitDefinitions>" if defined else "")
            + (f"<TypeDefinitions>{types}</TypeDefinitions>" if types else "")
            + (f'<DefaultExperiment stepSize="{step}"/>' if step is not None else "")
            + extra
            + f"\n<ModelVariables>\n{numbered}\n</ModelVariables>\n"
            f"<ModelStructure>{structure}</ModelStructure>\n</fmiModelDescription>\n"
        )

    def pack(self, name: str, description: str | bytes | None, library: str | None = "Unit") -> Path:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(path, "w") as archive:
            if description is not None:
                archive.writestr("modelDescription.xml", description)
            if library is not None:
                archive.writestr(f"binaries/{platform()}/{library}{SUFFIX[platform()]}", b"")
            archive.writestr("resources/note.txt", name)
        return path

    def fmu(self, name: str, *variables: str, **options: object) -> Path:
        return self.pack(name, self.description(variables, **options))  # type: ignore[arg-type]

    @staticmethod
    def connectors(text: str) -> str:
        """From "u:input y:output:Real:m" (name, kind, type, unit or enumeration)."""
        made = ""
        for item in text.split():
            name, kind, *rest = item.split(":")
            inner = ""
            if rest:
                label = "name" if rest[0] == "Enumeration" else "unit"
                inner = f"<ssc:{rest[0]}{attributes({label: rest[1]} if len(rest) > 1 else {})}/>"
            made += f'<ssd:Connector name="{name}" kind="{kind}">{inner}</ssd:Connector>\n'
        return f"<ssd:Connectors>\n{made}</ssd:Connectors>\n" if made else ""

    def component(
        self, name: str, source: str, connectors: str = "", bindings: str = "", after: str = "", **attrs: object
    ) -> str:
        head = attributes({"name": name, "source": source, **attrs})
        return f"<ssd:Component{head}>\n{self.connectors(connectors)}{bindings}{after}</ssd:Component>\n"

    @staticmethod
    def connection(start: str, end: str, inner: str = "", **attrs: object) -> str:
        """From "element/connector", or "connector" for one of the system."""
        ends: dict[str, object] = {}
        for label, text in (("start", start), ("end", end)):
            element, _, connector = text.rpartition("/")
            ends |= {f"{label}Element": element or None, f"{label}Connector": connector}
        return f"<ssd:Connection{attributes({**ends, **attrs})}>{inner}</ssd:Connection>\n"

    @staticmethod
    def parameter_set(values: Mapping[str, object], kind: str | None = None, unit: str | None = None) -> str:
        made = ""
        for name, value in values.items():
            of = kind or {bool: "Boolean", int: "Integer", float: "Real", str: "String"}[type(value)]
            text = str(value).lower() if isinstance(value, bool) else value
            typed = f"<ssv:{of}{attributes({'value': text, 'unit': unit})}/>"
            made += f"<ssv:Parameter name={quoteattr(name)}>{typed}</ssv:Parameter>\n"
        head = f'<ssv:ParameterSet {NAMESPACES} version="1.0" name="set">'
        return f"{head}<ssv:Parameters>{made}</ssv:Parameters></ssv:ParameterSet>"

    def bindings(self, *sets: Mapping[str, object], prefix: str | None = None, **options: str) -> str:
        made = "".join(
            f"<ssd:ParameterBinding{attributes({'prefix': prefix})}><ssd:ParameterValues>"
            f"{self.parameter_set(values, **options)}</ssd:ParameterValues></ssd:ParameterBinding>\n"
            for values in sets
        )
        return f"<ssd:ParameterBindings>{made}</ssd:ParameterBindings>\n"

    def system(
        self,
        elements: str = "",
        connections: str = "",
        *,
        name: str = "root",
        connectors: str = "",
        bindings: str = "",
        after: str = "",
    ) -> str:
        return (
            f'<ssd:System name="{name}">\n{self.connectors(connectors)}{bindings}'
            + (f"<ssd:Elements>\n{elements}</ssd:Elements>\n" if elements else "")
            + (f"<ssd:Connections>\n{connections}</ssd:Connections>\n" if connections else "")
            + f"{after}</ssd:System>\n"
        )

    def ssd(self, path: str, system: str, after: str = "", version: str = "1.0") -> Path:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<ssd:SystemStructureDescription {NAMESPACES} version="{version}" name="test">\n{system}{after}'
            "</ssd:SystemStructureDescription>\n",
            encoding="utf-8",
        )
        return file

    @staticmethod
    def units(*names: str) -> str:
        made = "".join(f'<ssc:Unit name="{name}"><ssc:BaseUnit {UNITS[name]}/></ssc:Unit>' for name in names)
        return f"<ssd:Units>{made}</ssd:Units>\n"

    @staticmethod
    def annotation(kind: str, content: str) -> str:
        return f'<ssd:Annotations><ssc:Annotation type="{kind}">{content}</ssc:Annotation></ssd:Annotations>\n'

    def ssp(self, path: str, members: Mapping[str, Path | bytes]) -> Path:
        file = self.root / path
        with zipfile.ZipFile(file, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, content if isinstance(content, bytes) else content.read_bytes())
        return file


@pytest.fixture
def workshop(tmp_path: Path) -> Workshop:
    return Workshop(tmp_path)


@pytest.fixture(name="variable")
def _variable() -> object:
    return variable


@pytest.fixture
def probes(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Probe FMUs (see probe.c) in a workshop, with their calls written to a file."""
    from tests.master.fmus.probe import Probes

    log = workshop.root / "calls.txt"
    monkeypatch.setenv("PROBE_LOG", str(log))
    return Probes(workshop, tmp_path_factory.getbasetemp(), log)


@pytest.fixture
def stricts(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Strict FMUs (see strict.c) in a workshop; what they complain about and all calls are written to files."""
    from tests.master.fmus.strict import Stricts

    log, calls = workshop.root / "complaints.txt", workshop.root / "strict_calls.txt"
    monkeypatch.setenv("STRICT_LOG", str(log))
    monkeypatch.setenv("STRICT_CALLS", str(calls))
    return Stricts(workshop, tmp_path_factory.getbasetemp(), log, calls)


@pytest.fixture
def stricts3(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Strict FMI 3 FMUs (see strict3.c) in a workshop; what they complain about and calls are written to files."""
    from tests.master.fmus.strict3 import Stricts3

    log, calls = workshop.root / "complaints3.txt", workshop.root / "strict3_calls.txt"
    monkeypatch.setenv("STRICT3_LOG", str(log))
    monkeypatch.setenv("STRICT3_CALLS", str(calls))
    return Stricts3(workshop, tmp_path_factory.getbasetemp(), log, calls)


@pytest.fixture
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python FMUs are unpacked below pytest's folder instead of the user's cache.

    Compiled kernels stay where they are: a process that a test starts would take half a minute to compile them anew.
    """
    kernels, cache = cache_folder() / "kernels", tmp_path_factory.getbasetemp() / "cache"
    link = cache / kernels.relative_to(kernels.parents[1])
    if not link.exists():
        kernels.mkdir(parents=True, exist_ok=True)
        link.parent.mkdir(parents=True)
        link.symlink_to(kernels)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))


@pytest.fixture
def linears(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Linear FMUs (see linear.c) in a workshop."""
    from tests.master.fmus.linear import Linears

    return Linears(workshop, tmp_path_factory.getbasetemp())


@pytest.fixture
def foreigners(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """FMUs with the habits of other tools (see foreign.c) in a workshop."""
    from tests.master.fmus.foreign import Foreigners

    return Foreigners(workshop, tmp_path_factory.getbasetemp())


@pytest.fixture
def dynamics(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """FMUs of the hybrid models in dynamic.c."""
    from tests.master.fmus.dynamics import Dynamics

    return Dynamics(tmp_path, tmp_path_factory.getbasetemp())


@pytest.fixture(scope="session")
def one_browser() -> Iterator[Any]:
    """Chromium, one for all tests: playwright refuses a second one in the same thread."""
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def browser(one_browser: Any) -> Iterator[Any]:
    """Chromium; pages that the tests of a file leave open are closed, since each takes much of a processor."""
    yield one_browser
    for context in one_browser.contexts:
        context.close()

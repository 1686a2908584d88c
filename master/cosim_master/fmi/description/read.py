"""Reads and checks modelDescription.xml, and unpacks FMUs. It executes no code of the FMU.

FMPy parses the file. This module classifies each defect: it is fatal if the FMU could not be run, or not correctly, and
a note if the description breaks a rule that does not affect a run, as many exporters do. This is the only module that
imports FMPy. FMI 2.0 and 3.0 (`read_fmi3` handles the differences) are supported for Co-Simulation and Model Exchange,
FMI 1.0 for Co-Simulation.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import re
import shlex
import struct
import sys
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path, PurePosixPath
from platform import machine as machine_name
from typing import Any, cast

from fmpy.model_description import ModelDescription, ValidationError, read_model_description
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import (
    EXCHANGE1,
    EXCHANGE_CLOCKS,
    FMI_VERSION,
    NO_LIBRARY,
    SCHEDULED_EXECUTION,
)
from cosim_master.diagnostics.names import near
from cosim_master.files import archive
from cosim_master.files.xml import line_of, parse
from cosim_master.fmi.description.declarations import read_verdicts
from cosim_master.fmi.description.read_fmi3 import Reading3, dependencies3
from cosim_master.fmi.description.source_files import SourceFiles, configured, listed
from cosim_master.fmi.description.units import BASE_UNITS, BaseUnit, Unit
from cosim_master.fmi.description.variables import Capabilities, Clock, FmuDescription, ModelExchange, Start, Variable

__all__ = [
    "Capabilities",
    "Clock",
    "FmuDescription",
    "Start",
    "Variable",
    "describe",
    "extract",
    "is_of_aliases",
    "mentions",
    "platform",
    "runner",
    "wrong_root",
]

_MAX_DESCRIPTION_BYTES = 128 << 20
_LIBRARY_SUFFIX = {"linux": ".so", "win": ".dll", "darwin": ".dylib"}
SOURCES = "sources"
"""`FmuDescription.library` of an FMU that is compiled from its sources."""
_SHOWN_NOTES = 5
RUNNER = "UAV_COSIM_RUNNER"
"""The environment variable with the command that runs programs of Windows."""


def platform(fmi: int = 2) -> str:
    """Returns this machine's folder in `binaries/`: "linux64", ... (FMI 2) or "x86_64-linux", ... (FMI 3)."""
    if fmi == 3:
        machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(machine_name(), machine_name())
        return f"{machine}-{'windows' if sys.platform == 'win32' else sys.platform}"
    system = "win" if sys.platform == "win32" else "darwin" if sys.platform == "darwin" else "linux"
    return f"{system}{struct.calcsize('P') * 8}"


_EXPECTED = re.compile(
    r".* does not contain the expected set of variables\. Expected \{ ?(.*?) ?\} but was \{ ?(.*?) ?\}\."
)


def is_of_aliases(finding: str, root: etree._Element) -> bool:
    """Returns whether FMPy misses nothing but aliases in a list of FMI 3's ModelStructure.

    An alias is another name of a variable, which has one entry there by its value reference (FMI 3.0.2, 2.4.7.5).
    """
    if (found := _EXPECTED.fullmatch(finding)) is None:
        return False
    expected, actual = ({*text.split(", ")} - {""} for text in found.groups())
    aliases = {one.get("name") for one in root.iterfind("ModelVariables/*/Alias")}
    return actual <= expected and expected - actual <= aliases


def runner() -> list[str]:
    """Returns the command that runs programs of Windows, from the environment variable UAV_COSIM_RUNNER.

    Raises:
        SystemDescriptionError: its quotes do not match.
    """
    try:
        return [] if sys.platform == "win32" else shlex.split(os.environ.get(RUNNER, ""))
    except ValueError:
        text = f'"{os.environ[RUNNER]}" is no command, because its quotes do not match; try wine'
        raise SystemDescriptionError([Problem(Where(f"environment variable {RUNNER}"), text)]) from None


def describe(
    path: str | Path, sizes: Mapping[str, int] | None = None, implementation: str = "any", runs: str = ""
) -> FmuDescription:
    """Reads and checks the description of an FMU.

    Args:
        path: the .fmu file.
        sizes: values of structural parameters of FMI 3 other than the FMU's own, which change the sizes of arrays.
        implementation: "CoSimulation", "ModelExchange", or "any", which prefers co-simulation.
        runs: the program that runs binaries of Windows, if the system names one; else that of the environment does.

    Raises:
        SystemDescriptionError: the file is not a ZIP archive or has no readable modelDescription.xml, or the FMU has
            another FMI version, lacks this interface, or has no library for this platform; all problems are reported
            at once.
    """
    given, runs = Path(path), runs or next(iter(runner()), "")
    if not sizes and implementation == "any":
        with suppress(OSError, SystemDescriptionError):  # `_described` says what is wrong with the file
            found = _known(_Contents(_digest(given), given.absolute()), runs)
            if found.path == given:
                return found
            if found.source_files is None:  # whose notes say where they are
                return replace(found, path=given)
    return _described(given, sizes, implementation, runs)


@dataclass(frozen=True, slots=True)
class _Contents:
    """What a file contains, wherever it is: systems that are unpacked or copied have the same FMUs in other places."""

    digest: str
    path: Path = field(compare=False)


@lru_cache(maxsize=64)
def _known(file: _Contents, runs: str) -> FmuDescription:
    """Returns the description of a file with these contents; many runs in a process read it once."""
    return _described(file.path, None, "any", runs)


def _described(path: Path, sizes: Mapping[str, int] | None, implementation: str, runs: str) -> FmuDescription:
    shown = str(path)
    names = archive.member_names(path, shown)
    data = archive.read_member(Path(path), "modelDescription.xml", shown, limit=_MAX_DESCRIPTION_BYTES)
    if data is None:
        raise SystemDescriptionError([Problem(Where(shown), "is not an FMU: it has no modelDescription.xml")])
    reading = _Reading(f"{shown}/modelDescription.xml", data, sizes or {}, implementation)
    library = None if reading.identifier is None else _library(names, reading.identifier, Where(shown), reading, runs)
    if library == SOURCES:
        reading.source_files = _source_files(Path(path), shown, names, reading)
    if reading.problems:
        raise SystemDescriptionError(reading.problems)
    terminals = _terminals(Path(path), shown, reading) if reading.fmi == 3 else {}
    return reading.description(Path(path), cast(str, library), terminals)


def wrong_root(root: etree._Element) -> str | None:
    """Returns why an element cannot be the root of modelDescription.xml; None if it can."""
    if root.tag == "fmiModelDescription":
        return None
    return f"the root element is <{root.tag}>; it must be <fmiModelDescription>"


def mentions(path: Path, name: str) -> bool:
    """Returns whether an FMU may have a variable of this name: false if its description has no such attribute.

    Of an element of an array, such as "motor[1]": neither one of any element nor one of the array.

    `describe` takes seconds for 50,000 variables.

    Raises:
        SystemDescriptionError: the file is not a ZIP archive, or has a description that is too large.
    """
    try:
        file = _Contents(_digest(path), path)
    except OSError:  # `archive` says what is wrong with the file
        return _mentioned.__wrapped__(_Contents("", path), name)
    return _mentioned(file, name)


@lru_cache(maxsize=1024)
def _mentioned(file: _Contents, name: str) -> bool:
    """Returns `mentions` of a file with these contents, which are read once in a process."""
    data = archive.read_member(file.path, "modelDescription.xml", str(file.path), limit=_MAX_DESCRIPTION_BYTES)
    array, of_array, _ = name.partition("[")
    if data is None or not array.isidentifier():  # other names may be escaped
        return data is not None
    end = r"(\1|\[)" if of_array else r"\1"
    found = re.finditer(
        rf"""name\s*=\s*(["']){array}{end}""".encode(), data
    )  # in a tenth of the time, as it begins with a letter
    return any(data[one.start() - 1 : one.start()].isspace() for one in found)


def extract(description: FmuDescription, directory: Path) -> Path:
    """Unpacks an FMU into `directory`, which is created, and returns the path of its library.

    The path must be plain ASCII without "%", "#", "?", "+" and spaces: FMUs receive it as a URI, in which pythonfmu
    only decodes "%20".

    Raises:
        ValueError: the path of `directory` has other characters.
        SystemDescriptionError: the archive is refused, or has changed since it was described.
    """
    target = str(directory.absolute())
    if not target.isascii() or any(character in "%#?+ " for character in target):
        raise ValueError(f'FMUs must be unpacked into a path of plain ASCII without % # ? + and spaces, not "{target}"')
    if _digest(description.path) != description.digest:
        problem = Problem(
            Where(str(description.path)), "the file has changed since it was checked; start the run again"
        )
        raise SystemDescriptionError([problem])
    archive.unpack(description.path, directory, str(description.path))
    return directory.joinpath(*PurePosixPath(description.library).parts)


def _terminals(path: Path, shown: str, reading: _Reading) -> dict[str, tuple[str, ...]]:
    """Returns the names of terminals, those inside others as "outer.inner", and of their member variables."""
    member = "terminalsAndIcons/terminalsAndIcons.xml"
    data = archive.read_member(path, member, shown, limit=_MAX_DESCRIPTION_BYTES)
    found: dict[str, tuple[str, ...]] = {}

    def visit(element: etree._Element, prefix: str) -> None:
        for terminal in element.iterfind("Terminal"):
            name = prefix + terminal.get("name", "")
            found[name] = tuple(one.get("variableName", "") for one in terminal.iterfind("TerminalMemberVariable"))
            for unknown in sorted({*found[name]} - {*reading.variables, *reading.shapes}):
                reading.notes.append(f'its terminal "{name}" has the member "{unknown}", which is not a variable')
            visit(terminal, f"{name}.")

    if data is not None:
        for terminals in parse(data, f"{shown}/{member}").iterfind("Terminals"):
            visit(terminals, "")
    return found


def _source_files(path: Path, shown: str, names: Sequence[str], reading: _Reading) -> SourceFiles | None:
    """Returns the build description of an FMU without a library: its buildDescription.xml, else its SourceFiles."""
    member = "sources/buildDescription.xml"
    data = archive.read_member(path, member, shown, limit=_MAX_DESCRIPTION_BYTES)
    problems, notes, found = reading.problems, reading.notes, None
    if data is not None:
        root, place = parse(data, f"{shown}/{member}"), platform(3)
        found = configured(root, f"{shown}/{member}", cast(str, reading.identifier), place, names, problems, notes)
    if found is None and not problems:
        interface = reading.root.find(reading.interface)
        assert interface is not None
        found = listed(interface, reading.shown, names, problems, notes)
    return found


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _library(names: Sequence[str], identifier: str, where: Where, reading: _Reading, by: str) -> str | None:
    folder = platform(reading.fmi)
    suffix = next(suffix for system, suffix in _LIBRARY_SUFFIX.items() if platform().startswith(system))
    expected = f"binaries/{folder}/{identifier}{suffix}"
    if expected in names:
        return expected
    # Old exporters name the library after the .fmu file; a single library is unambiguous.
    pattern = f"binaries/{folder}/"
    others = [name for name in names if name.startswith(pattern) and name.endswith(suffix) and name.count("/") == 2]
    if len(others) == 1:
        reading.notes.append(f"its library is {others[0]}, by its modelIdentifier it should be {expected}")
        return others[0]
    if reading.fmi > 1 and any(name.startswith("sources/") for name in names):
        reading.notes.append("it has no binary for this platform: its sources are compiled")
        return SOURCES
    foreign = f"binaries/{'x86_64-windows' if reading.fmi == 3 else 'win64'}/{identifier}.dll"
    runs = reading.fmi > 1 and foreign in names
    if runs and by:
        reading.notes.append(f"it has no binary for this platform: that of Windows is run by {by}")
        return foreign
    available = sorted({name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1})
    offered = f"it has binaries for {', '.join(available)}" if available else "it has no binaries"
    fix = f"; with {RUNNER}=wine in the environment, Wine runs that of Windows" if runs else ""
    reading.problems.append(Problem(where, NO_LIBRARY.text(expected, offered + fix)))
    return None


class _Reading:
    """Reads one modelDescription.xml. Fatal defects are added to `problems`, all others to `notes`."""

    def __init__(self, shown: str, data: bytes, sizes: Mapping[str, int], implementation: str) -> None:
        self.shown = shown
        self.sizes = sizes
        self.implementation = implementation
        self.interface = "CoSimulation"
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self.identifier: str | None = None
        self.source_files: SourceFiles | None = None
        self.fmi = 2
        self.shapes: dict[str, tuple[int, ...]] = {}
        self._dependencies: dict[str, list[str | None]] = {}
        self.root = parse(data, shown)
        self._interface()
        if self.problems:
            raise SystemDescriptionError(self.problems)
        if self.fmi == 2:
            self._structure()
        if self.problems:
            raise SystemDescriptionError(self.problems)
        if self.fmi == 2:
            self._repair()
        self.model = self._parsed()
        self.units = {unit.name: self._unit(unit) for unit in self.model.unitDefinitions}
        self.variables: dict[str, Variable] = {}
        if self.fmi == 3:
            self._variables3()
        else:
            self._variables()
        self.step_size = self._step_size()
        self.start_time, self.stop_time = self._experiment("startTime"), self._experiment("stopTime")
        self.tolerance = self._experiment("tolerance")

    def _problem(self, element: etree._Element, message: str) -> None:
        self.problems.append(Problem(Where(self.shown, line_of(element)), message))

    def _interface(self) -> None:
        root = self.root
        version = root.get("fmiVersion", "")
        if (wrong := wrong_root(root)) is not None:
            self._problem(root, wrong)
        elif version not in ("1.0", "2.0") and not re.fullmatch(r"3[.]0([.][0-9]+)?", version):
            self._problem(root, FMI_VERSION.text(version))
        elif version == "1.0":
            self._interface1()
        elif (interface := self._chosen()) is not None:
            self.identifier = interface.get("modelIdentifier")
            if not self.identifier or "/" in self.identifier:
                self._problem(interface, f"<{interface.tag}> needs the attribute modelIdentifier, a C identifier")
        self.fmi = {"1": 1, "3": 3}.get(version[:1], 2)
        if not self.problems:
            token = "instantiationToken" if self.fmi == 3 else "guid"
            if root.get(token) is None:
                self._problem(root, f"<fmiModelDescription> needs the attribute {token}")
            elif not root.get(token):
                self.notes.append(f'its {token} is "": whether library and description belong together is not known')
            if root.find("ModelVariables") is None:
                self._problem(root, "<fmiModelDescription> needs <ModelVariables>")

    def _chosen(self) -> etree._Element | None:
        """Returns the element of the interface to be used: Co-Simulation before Model Exchange, unless chosen."""
        wanted = ("CoSimulation", "ModelExchange") if self.implementation == "any" else (self.implementation,)
        for name in wanted:
            if (interface := self.root.find(name)) is not None:
                self.interface = name
                return interface
        every = ("CoSimulation", "ModelExchange", "ScheduledExecution")
        has = [name for name in every if self.root.find(name) is not None]
        if has == ["ScheduledExecution"]:
            self._problem(self.root, SCHEDULED_EXECUTION.text())
        elif has:
            self._problem(self.root, f"has no <{self.implementation}>; it has {' and '.join(has)}")
        else:
            self._problem(self.root, f"has no interface; valid: {' and '.join(wanted)}")
        return None

    def _interface1(self) -> None:
        """Returns the single interface of an FMU of FMI 1.0; an FMU for co-simulation has an Implementation."""
        self.identifier = self.root.get("modelIdentifier")
        if self.root.find("Implementation") is None or self.implementation == "ModelExchange":
            self._problem(self.root, EXCHANGE1.text())
        elif not self.identifier or "/" in self.identifier:
            self._problem(self.root, "<fmiModelDescription> needs the attribute modelIdentifier, a C identifier")

    def _structure(self) -> None:
        """Reads the ModelStructure. Its indices count from 1; FMPy interprets 0 as the last variable.

        Dependencies without kinds are kept by section as texts, and removed from the element: FMPy makes a list of
        each, which took half of the time for 28,000 outputs of the same 97 inputs.
        """
        count = len(self.root.findall("ModelVariables/ScalarVariable"))

        @cache  # many have the same dependencies
        def read(text: str) -> tuple[list[str], str | None]:
            indices = text.split()
            wrong = (one for one in indices if not (one.isdecimal() and len(one) < 10 and 1 <= int(one) <= count))
            return indices, next(wrong, None)

        for unknown in self.root.iterfind("ModelStructure/*/Unknown"):
            index, dependencies = unknown.get("index", ""), unknown.get("dependencies", "")
            wrong = read(index)[1] if len(read(index)[0]) == 1 else index
            wrong = read(dependencies)[1] if wrong is None else wrong
            if wrong is not None:
                self._problem(unknown, f'<Unknown> refers to variable "{wrong}"; valid: 1 to {count}')
            elif unknown.get("dependencies") is not None and unknown.get("dependenciesKind") is not None:
                unknown.set("dependencies", " ".join(read(dependencies)[0]))
            kept = unknown.get("dependencies") if unknown.get("dependenciesKind") is None else None
            if kept is not None:
                del unknown.attrib["dependencies"]
            self._dependencies.setdefault(str(cast(etree._Element, unknown.getparent()).tag), []).append(kept)

    def _unit(self, unit: Any) -> Unit:
        base = unit.baseUnit
        if base is None:
            return Unit(unit.name)
        if not (math.isfinite(base.factor) and math.isfinite(base.offset) and base.factor != 0.0):
            text = f'unit "{unit.name}": factor must be finite and not 0, offset finite'
            self.problems.append(Problem(Where(self.shown), text))
            return Unit(unit.name)
        return Unit(unit.name, BaseUnit(tuple(getattr(base, name) for name in BASE_UNITS), base.factor, base.offset))

    def _step_size(self) -> float | None:
        experiment = self.model.defaultExperiment
        if experiment is None:
            return None
        step = cast("float | None", self._value(self.root, "stepSize", experiment.stepSize, "Real"))
        if step is not None and not 0.0 < step < math.inf:
            self.notes.append(f"its DefaultExperiment's stepSize of {step:g} s is not used: it must be positive")
            return None
        return step

    def _experiment(self, attribute: str) -> float | None:
        """Returns a finite number of the DefaultExperiment, or None if it has none."""
        experiment = self.model.defaultExperiment
        text = None if experiment is None else getattr(experiment, attribute)
        number = cast("float | None", self._value(self.root, attribute, text, "Real"))
        return number if number is not None and math.isfinite(number) else None

    def _repair(self) -> None:
        """Sets the variability of variables whose causality allows only one; FMPy rejects them.

        FMI's default is "continuous", which is invalid for parameters and for Integer, Boolean, String and Enumeration
        variables; pythonfmu nevertheless omits the attribute.
        """
        repaired = []
        for variable in self.root.iterfind("ModelVariables/ScalarVariable"):
            if variable.get("variability") is not None:
                continue
            causality = variable.get("causality", "local")
            if causality in ("parameter", "calculatedParameter"):
                variable.set("variability", "fixed")
            elif len(variable) and variable[0].tag != "Real":
                variable.set("variability", "discrete")
            else:
                continue
            repaired.append(variable.get("name", ""))
        if repaired:
            more = f" and {len(repaired) - 1} more" if len(repaired) > 1 else ""
            self.notes.append(
                f'variables without the variability they need, taken as fixed or discrete: "{repaired[0]}"{more}'
            )

    def _parsed(self) -> ModelDescription:
        """Returns FMPy's result: in strict mode if possible, otherwise lenient, with the strict findings as notes."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as memory:
            memory.writestr("modelDescription.xml", etree.tostring(self.root, encoding="utf-8", xml_declaration=True))
        findings: list[str] = []
        try:
            return read_model_description(packed, validate=True, validate_model_structure=True)
        except ValidationError as error:
            findings = [text for text in map(str, error.problems) if not is_of_aliases(text, self.root)]
        except Exception as error:
            # FMPy does not catch the exceptions of its parsing: KeyError, ValueError, plain Exception.
            findings = [f"{type(error).__name__}: {error}"]
        try:
            model = read_model_description(packed, validate=False)
        except Exception as error:
            findings.append(f"{type(error).__name__}: {error}")
            unique = list(dict.fromkeys(findings))
            raise SystemDescriptionError(
                Problem(Where(self.shown), f"cannot be read: {text}") for text in unique
            ) from error
        self.notes += findings[:_SHOWN_NOTES]
        if len(findings) > _SHOWN_NOTES:
            self.notes.append(f"and {len(findings) - _SHOWN_NOTES} more findings of this kind")
        return model

    def _variables(self) -> None:
        elements = self.root.findall("ModelVariables/ScalarVariable")
        capacities = self._packet_ports()
        if len(elements) != len(self.model.modelVariables):  # FMPy reads those of the first <ModelVariables>
            self._problem(self.root, "has more than one <ModelVariables>")
            return
        negated = []
        for read, element in zip(self.model.modelVariables, elements, strict=True):
            if read.name in self.variables:
                self._problem(element, f'variable "{read.name}" is declared twice')
                continue
            if element.get("alias") == "negatedAlias":  # its value would have to be negated in the exchange
                negated.append(read.name)
                continue
            variable = self._variable(read, element, capacities.pop(read.name, None))
            if variable is not None:
                self.variables[read.name] = variable
        if negated:
            self.notes.append(f'{len(negated)} negated aliases ("{negated[0]}", ...) are left out')
        for name in capacities:
            self._problem(self.root, f'PacketPort: there is no variable "{name}"; {near(name, self.variables)}')
        if (
            self.fmi == 2
            and self.model.initialUnknowns == []
            and any(
                variable.causality == "output" and variable.initial != "exact" for variable in self.variables.values()
            )
        ):
            self.notes.append("has no InitialUnknowns: what its outputs depend on while initializing is not known")

    def _variables3(self) -> None:
        listed = self.root.find("ModelVariables")
        elements = {e.get("name", ""): e for e in (listed if listed is not None else ()) if isinstance(e.tag, str)}
        for element in list(elements.values()):
            elements |= {alias.get("name", ""): element for alias in element.iterfind("Alias")}
        reading = Reading3(self.model, self.units, elements, lambda text: self._problem(self.root, text), self.sizes)
        self.variables, self.shapes = reading.variables, reading.shapes
        self.notes += reading.notes
        clocks = [v.name for v in self.variables.values() if v.clock is not None]
        if clocks and self.interface == "ModelExchange":
            self._problem(self.root, EXCHANGE_CLOCKS.text(clocks[0]))
        elif clocks and not self.model.coSimulation.hasEventMode:
            self._problem(self.root, f'has Clocks ("{clocks[0]}"), but no Event Mode: FMI 3.0.2, 2.3.1 requires it')

    def _variable(self, read: Any, element: etree._Element, capacity: int | None) -> Variable | None:
        declared, value = read.declaredType, element.find(read.type)
        if value is None:
            self._problem(element, f'variable "{read.name}" has no type element')
            return None
        unit_name = read.unit or (declared.unit if declared is not None else None)
        unit = self.units.get(unit_name, Unit(unit_name)) if unit_name else None
        relative = value.get("relativeQuantity")
        if relative in ("true", "1") or (relative is None and declared is not None and declared.relativeQuantity):
            unit = None if unit is None else unit.relative()
        limits = []
        for bound in ("min", "max"):
            text = getattr(read, bound) or (getattr(declared, bound) if declared is not None else None)
            limits.append(cast("float | None", self._value(element, bound, text, "Real")))
        items = None
        if read.type == "Enumeration" and declared is not None:
            numbered = [str(i + 1) if self.fmi == 1 else item.value for i, item in enumerate(declared.items)]
            pairs = zip(declared.items, numbered, strict=True)
            items = {item.name: self._item(element, declared, value) for item, value in pairs}
        if capacity is not None and read.type != "String":
            self._problem(element, f'PacketPort "{read.name}" is of type {read.type}; in FMI 2 it must be a String')
        return Variable(
            name=read.name,
            value_reference=read.valueReference,
            type=read.type,
            causality="local" if read.causality == "none" else read.causality,
            variability=read.variability,
            initial=self._initial(read),
            unit=unit,
            start=self._value(element, "start", read.start, read.type),
            minimum=limits[0],
            maximum=limits[1],
            items=items,
            packet_capacity=capacity,
            description=read.description or "",
        )

    def _initial(self, read: Any) -> str | None:
        if read.causality in ("input", "independent"):
            return None
        if self.fmi == 1:
            return "exact" if read.start is not None and read.variability != "constant" else "calculated"
        initial: str | None = read.initial
        return initial

    def _value(self, element: etree._Element, attribute: str, text: str | None, kind: str) -> Start | None:
        """Returns a start value or a limit, or None if it is absent."""
        if text is None or kind == "String":
            return text
        try:
            if kind == "Real":
                number = float(text)
                if math.isnan(number):
                    raise ValueError
                return number
            if kind == "Boolean":
                return {"true": True, "1": True, "false": False, "0": False}[text.strip()]
            return int(text)
        except (ValueError, KeyError):
            self._problem(element, f'{attribute} "{text}" of "{element.get("name", "the FMU")}" is not of type {kind}')
            return None

    def _item(self, element: etree._Element, declared: Any, value: str | None) -> int:
        try:
            return int(value or "")
        except ValueError:
            self._problem(element, f'an item of its type "{declared.name}" has the value "{value}", not an integer')
            return 0

    def _packet_ports(self) -> dict[str, int]:
        """Reads our vendor annotation. FMI's schema allows one child per Tool, so several ports share a parent."""
        capacities: dict[str, int] = {}
        for port in self.root.iterfind("VendorAnnotations/Tool[@name='uav-cosim']//PacketPort"):
            name, size = port.get("variable"), port.get("maxSize", "")
            if not name or not size.isascii() or not size.isdigit() or not 0 < int(size) < 2**31:
                self._problem(port, "PacketPort needs the attributes variable and maxSize (a positive number of bytes)")
            else:
                capacities[name] = int(size)
        return capacities

    def _named(self, unknowns: Sequence[Any], section: str) -> dict[str, tuple[str, ...] | None]:
        """Returns the dependencies of the unknowns of a section by name; None if they are not known."""
        names = [variable.name for variable in self.model.modelVariables]

        @cache
        def read(text: str) -> tuple[str, ...]:
            return tuple(names[int(one) - 1] for one in text.split())

        texts = self._dependencies.get(section) or [None] * len(unknowns)
        pairs = zip(unknowns, texts, strict=True)
        return {one.variable.name: _dependencies(one) if text is None else read(text) for one, text in pairs}

    def description(self, path: Path, library: str, terminals: Mapping[str, tuple[str, ...]]) -> FmuDescription:
        model = self.model
        outputs = self._named(model.outputs, "Outputs")
        initial = self._named(model.initialUnknowns, "InitialUnknowns")
        if self.fmi == 3:
            outputs, initial = (
                dependencies3(model.outputs, self.shapes),
                dependencies3(model.initialUnknowns, self.shapes),
            )
        of_interface = model.modelExchange if self.interface == "ModelExchange" else model.coSimulation
        flags = {name: getattr(of_interface, name, False) for name in Capabilities.__slots__}
        if self.interface == "ModelExchange":
            flags["canHandleVariableCommunicationStepSize"] = True
        if self.fmi == 1:
            outputs, flags = self._outputs1(), self._flags1()
        verdicts = read_verdicts(self.root, self.variables, self.notes)
        return FmuDescription(
            path=path.resolve(),
            digest=_digest(path),
            fmi_version=model.fmiVersion,
            model_name=model.modelName or "",
            model_identifier=cast(str, self.identifier),
            guid=model.guid,
            description=model.description or "",
            library=library,
            variables=self.variables,
            units=self.units,
            step_size=self.step_size,
            capabilities=Capabilities(**flags),
            outputs=outputs,
            initial_unknowns=initial,
            notes=tuple(self.notes),
            generation_tool=model.generationTool or "",
            shapes=self.shapes,
            terminals=terminals,
            start_time=self.start_time,
            stop_time=self.stop_time,
            tolerance=self.tolerance,
            model_exchange=self._model_exchange(),
            verdicts=verdicts,
            source_files=self.source_files,
        )

    def _model_exchange(self) -> ModelExchange | None:
        """Returns the states and their derivatives in the order of the model structure."""
        if self.interface != "ModelExchange":
            return None
        element = self.root.find("ModelExchange")
        assert element is not None
        derivatives = [unknown.variable for unknown in self.model.derivatives]
        states = [variable.derivative for variable in derivatives]
        scalars = all(s is not None and not s.dimensions for s in states)
        able = "providesDirectionalDerivatives" if self.fmi == 3 else "providesDirectionalDerivative"
        needed = element.get("needsCompletedIntegratorStep", "false") in ("true", "1")
        if self.fmi == 2:
            needed = element.get("completedIntegratorStepNotNeeded", "false") not in ("true", "1")
        return ModelExchange(
            states=tuple(s.valueReference for s in states) if scalars else (),
            derivatives=tuple(d.valueReference for d in derivatives),
            event_indicators=self.model.numberOfEventIndicators or 0,
            completed_step=needed,
            directional_derivatives=scalars and element.get(able) in ("true", "1"),
            saves_state=self.model.modelExchange.canGetAndSetFMUstate,
            serialises_state=self.model.modelExchange.canSerializeFMUstate,
        )

    def _outputs1(self) -> dict[str, tuple[str, ...] | None]:
        """Reads the direct dependencies of FMI 1.0, which the outputs list as names of inputs."""
        found: dict[str, tuple[str, ...] | None] = {}
        for element in self.root.iterfind("ModelVariables/ScalarVariable"):
            if element.get("causality") == "output":
                given = element.find("DirectDependency")
                names = None if given is None else tuple(one.text or "" for one in given.iterfind("Name"))
                found[element.get("name", "")] = names
        return found

    def _flags1(self) -> dict[str, Any]:
        flags: dict[str, Any] = dict.fromkeys(Capabilities.__slots__, False)
        flags["needsExecutionTool"] = self.root.find("Implementation/CoSimulation_Tool") is not None
        given = self.root.find("Implementation/*/Capabilities")
        for name in ("canHandleVariableCommunicationStepSize", "canBeInstantiatedOnlyOncePerProcess"):
            flags[name] = given is not None and given.get(name) in ("true", "1")
        flags["maxOutputDerivativeOrder"] = 0
        return flags


def _dependencies(unknown: Any) -> tuple[str, ...] | None:
    return None if unknown.dependencies is None else tuple(variable.name for variable in unknown.dependencies)

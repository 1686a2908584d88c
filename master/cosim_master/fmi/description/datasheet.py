"""The data sheet of an FMU, whether it runs here or not, with all its problems. It executes no code of the FMU."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from fmpy.validation import validate_fmu
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.files import archive
from cosim_master.files.xml import line_of, parse
from cosim_master.fmi.description.read import describe, is_of_aliases, wrong_root

__all__ = ["datasheet", "findings"]

_LIMIT = 128 << 20
_INTERFACES = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_MANIFEST = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-"
_LINE = re.compile(r"\(?line (\d+)(?:, column \d+)?\)?:? ?")
_TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
_SUFFIXES = (".so", ".dll", ".dylib")


def datasheet(path: Path) -> dict[str, Any]:
    """Returns interfaces, platforms, sources, layered standards, terminals, default experiment and variables of an FMU.

    Raises:
        SystemDescriptionError: the file is not an archive, or has no readable modelDescription.xml.
    """
    shown = str(path)
    names = archive.member_names(path, shown)
    root = _root(path, shown)
    causalities: dict[str, list[str]] = {}
    for variable in _variables(root):
        causalities.setdefault(variable.get("causality", "local"), []).append(variable.get("name", ""))
    experiment = root.find("DefaultExperiment")
    try:
        describe(path)
        refused: list[str] = []
    except SystemDescriptionError as error:
        refused = [problem.message for problem in error.problems]
    return {
        "model": root.get("modelName") or path.stem,
        "description": root.get("description") or "",
        "fmi_version": root.get("fmiVersion", ""),
        "guid": root.get("instantiationToken") or root.get("guid") or "",
        "generated": " ".join(filter(None, (root.get("generationTool"), root.get("generationDateAndTime")))),
        "interfaces": _interfaces(root),
        "platforms": sorted({name.split("/")[1] for name in names if _is_library(name)}),
        "sources": sum(name.startswith("sources/") for name in names),
        "layered_standards": list(_layered_standards(path, shown, names)),
        "terminals": _terminals(path, shown),
        "default_experiment": {} if experiment is None else {str(k): str(v) for k, v in experiment.attrib.items()},
        "variables_by_causality": causalities,
        "refused": refused,
    }


def _root(path: Path, shown: str) -> etree._Element:
    data = archive.read_member(path, "modelDescription.xml", shown, limit=_LIMIT)
    if data is None:
        raise SystemDescriptionError([Problem(Where(shown), "is not an FMU: it has no modelDescription.xml")])
    root = parse(data, f"{shown}/modelDescription.xml")
    if (wrong := wrong_root(root)) is not None:
        raise SystemDescriptionError([Problem(Where(f"{shown}/modelDescription.xml", line_of(root)), wrong)])
    return root


def _variables(root: etree._Element) -> list[etree._Element]:
    listed = root.find("ModelVariables")
    return [one for one in (listed if listed is not None else ()) if isinstance(one.tag, str)]


def _is_library(name: str) -> bool:
    return name.startswith("binaries/") and name.count("/") == 2 and name.endswith(_SUFFIXES)


def _interfaces(root: etree._Element) -> dict[str, list[str]]:
    """Returns the capabilities of each interface that are true, or numbers other than 0."""
    if root.get("fmiVersion") == "1.0":
        able = root.find("Implementation/*/Capabilities")
        if root.find("Implementation") is None:
            return {"ModelExchange": []}
        return {"CoSimulation": [] if able is None else _flags(able)}
    return {name: _flags(element) for name in _INTERFACES if (element := root.find(name)) is not None}


def _flags(element: etree._Element) -> list[str]:
    found = []
    for name, value in ((str(k), str(v)) for k, v in element.attrib.items()):
        if value in ("true", "1"):
            found.append(name)
        elif value.isdecimal() and value != "0":
            found.append(f"{name}={value}")
    return found


def _layered_standards(path: Path, shown: str, names: Sequence[str]) -> Iterator[dict[str, str]]:
    for name in sorted(names):
        if not (name.startswith("extra/") and name.endswith("/fmi-ls-manifest.xml")):
            continue
        data = archive.read_member(path, name, shown, limit=_LIMIT)
        root = parse(data or b"", f"{shown}/{name}")
        folder = PurePosixPath(name).parts[1]
        yield {
            "name": root.get(f"{_MANIFEST}name", folder),
            "version": root.get(f"{_MANIFEST}version", ""),
            "description": root.get(f"{_MANIFEST}description", ""),
        }


def _terminals(path: Path, shown: str) -> dict[str, list[str]]:
    """Returns the names of all terminals, those inside others as "outer.inner", and of their members."""
    data = archive.read_member(path, _TERMINALS, shown, limit=_LIMIT)
    found: dict[str, list[str]] = {}

    def visit(element: etree._Element, prefix: str) -> None:
        for terminal in element.iterfind("Terminal"):
            name = prefix + terminal.get("name", "")
            found[name] = [one.get("variableName", "") for one in terminal.iterfind("TerminalMemberVariable")]
            visit(terminal, f"{name}.")

    if data is not None:
        for terminals in parse(data, f"{shown}/{_TERMINALS}").iterfind("Terminals"):
            visit(terminals, "")
    return found


def findings(path: Path) -> list[Problem]:
    """Returns all problems of an FMU: those that `fmpy validate` finds, those that prevent a run here, and more.

    Raises:
        SystemDescriptionError: the file is not an archive, or has no readable modelDescription.xml.
    """
    shown = str(path)
    names = archive.member_names(path, shown)
    root = _root(path, shown)
    document = f"{shown}/modelDescription.xml"
    found: list[Problem] = []
    try:
        describe(path)
    except SystemDescriptionError as error:
        found += error.problems
    for text in (one for one in map(str, validate_fmu(shown)) if not is_of_aliases(one, root)):
        match = _LINE.search(text)
        line = int(match[1]) if match else None
        found.append(Problem(Where(document, line), _LINE.sub("", text, count=1).strip() if match else text))
    found += [Problem(Where(document, line), text) for line, text in _values(root)]
    found += [Problem(Where(shown), text) for text in _files(root, names)]
    known = {variable.get("name", "") for variable in _variables(root)}
    for terminal, members in _terminals(path, shown).items():
        for member in sorted({*members} - known):
            text = f'terminal "{terminal}" has the member "{member}", which is not a variable'
            found.append(Problem(Where(f"{shown}/{_TERMINALS}"), text))
    return list(dict.fromkeys(found))


def _values(root: etree._Element) -> Iterator[tuple[int | None, str]]:
    """Finds start values outside of their limits, and limits in reverse order."""
    for variable in _variables(root):
        inner = next((one for one in variable if one.tag in ("Real", "Integer", "Enumeration")), variable)
        numbers = {name: _number(inner.get(name)) for name in ("min", "max", "start")}
        low, high, start = (numbers[name] for name in ("min", "max", "start"))
        name = variable.get("name", "")
        if low is not None and high is not None and low > high:
            yield line_of(variable), f'min {low:g} of "{name}" is larger than max {high:g}'
        elif start is not None and ((low is not None and start < low) or (high is not None and start > high)):
            yield line_of(variable), f'start {start:g} of "{name}" is not between its min and max'


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _files(root: etree._Element, names: Sequence[str]) -> Iterator[str]:
    """Finds libraries and sources that the description names and the archive lacks."""
    elements = [element for name in _INTERFACES if (element := root.find(name)) is not None]
    if root.get("fmiVersion") == "1.0":
        elements = [root]
    folders = sorted({name.split("/")[1] for name in names if _is_library(name)})
    for element in elements:
        identifier = element.get("modelIdentifier", "")
        for folder in folders:
            expected = [f"binaries/{folder}/{identifier}{suffix}" for suffix in _SUFFIXES]
            if not {*expected} & {*names}:
                yield f"binaries/{folder} has no library with the modelIdentifier {identifier} of <{element.tag}>"
        for file in element.iterfind("SourceFiles/File"):
            if f"sources/{file.get('name')}" not in names:
                yield f"its sources/{file.get('name')}, which <{element.tag}> lists, is not there"
    if not folders and not any(name.startswith("sources/") for name in names):
        yield "it has neither binaries nor sources"

"""Reads INTO-CPS multi-models, the JSON files of the co-simulation engine Maestro, as systems.

    mm.json        fmus, connections and parameters; a full configuration also has algorithm and times of the run
    coe.json       configuration of a run (of the INTO-CPS application): `multimodel_path`, algorithm, times

Instances keep their names, "{key}.instance". Maestro's fixed-step Jacobi corresponds to ours, and with stabilisation to
our fixed-point iteration; var-step is a separate algorithm (docs/masters.md). Fault injection and model swaps are
refused. Keys that control Maestro's logs and displays are ignored, with a note; unknown keys are findings.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote, urlsplit

from cosim_master.diagnostics.errors import Finding, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import (
    ALGORITHM,
    FAULTS,
    LARGE_FILE,
    STABILISATION,
    SWAP,
    TRANSFER,
    VAR_STEP,
)
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.system.reading.others.json_values import finite, shown, speakable
from cosim_master.system.reading.others.var_step import MASTER, VarStep
from cosim_master.system.structure import (
    Annotation,
    Component,
    Connection,
    Connector,
    Kind,
    Parameter,
    ParameterBinding,
    System,
    SystemStructure,
    annotation,
)

__all__ = ["read_multimodel"]

STEPPING = "org.uav-cosim.stepping"
_FMU_TYPE = "application/x-fmu-sharedlibrary"
_LARGEST = 64 << 20
_END = re.compile(r"(\{[^{}]+\})\.([^.{}]+)\.(.+)", re.DOTALL)
_REFUSED = {
    "modelTransfers": TRANSFER,
    "modelSwaps": SWAP,
    "faultInjectConfigurationPath": FAULTS,
    "faultInjectInstances": FAULTS,
}
"""Contents that would change the results, and are not supported."""
_READ = {
    "fmus": (),
    "connections": (),
    "parameters": (),
    "algorithm": (),
    "startTime": (),
    "endTime": (),
    "multimodel_path": (),
    "stabalizationEnabled": (
        "stabilizationEnabled",
        "stabilisationEnabled",
        "stabilisation",
        "stabilization",
        "stabalization",
    ),
    "global_absolute_tolerance": ("absoluteTolerance",),
    "global_relative_tolerance": ("relativeTolerance",),
    "fixedPointIteration": ("fixedPointIterations",),
}
"""Keys that are read, in the spelling of Maestro or the INTO-CPS application, and their other spellings."""
_STRUCTURE = ("fmus", "connections", "parameters")
_WITHOUT_EFFECT = (
    "livestream livegraphcolumns livegraphvisiblerowcount liveloginterval logvariables logginon loggingon visible "
    "overrideloglevel enablealllogcategoriesperinstance simulationprogramdelay parallelsimulation reportprogress "
    "graphs postprocessingscript loglevels simulationloglevel multimodelcrc id name description author version"
)
"""Keys without influence on values, in lower case without "_" and "-"."""
_ITERATIONS = 5
"""Maestro's default number of iterations of a step with stabilisation."""
_TOLERANCE = 1e-8


def read_multimodel(path: str | Path) -> SystemStructure:
    """Reads a multi-model, or the configuration of a run of a multi-model.

    Returns:
        The structure; its errors are in `problems`, as for every system.

    Raises:
        SystemDescriptionError: the file, or the multi-model that it names, is not JSON or not a multi-model.
    """
    given = Path(path)
    file = _Json(given)
    reading = _Reading(given)
    if "fmus" in file.content:
        model = file
        reading.keys(file)
        how = _configuration_beside(file, reading.notes)
        if how is not None:
            reading.keys(how)
            how.content = {**file.content, **{k: v for k, v in how.content.items() if k not in _STRUCTURE}}
        reading.configuration(how or file)
    elif isinstance(file.content.get("multimodel_path"), str):
        model = _Json(_multimodel_of(file, reading.notes))
        reading.keys(file)
        reading.keys(model)
        reading.configuration(file)
    else:
        text = 'is not a multi-model: it needs "fmus", or "multimodel_path" in the configuration of a run'
        raise SystemDescriptionError([Problem(file.where(), text)])
    return reading.structure(model)


class _Json:
    """A JSON file whose root is an object, with the lines of its keys."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.repeated: list[str] = []
        self.spelled: dict[str, str] = {}
        try:
            if path.stat().st_size > _LARGEST:
                self._refuse(LARGE_FILE.text(_LARGEST >> 20))
            self.text = path.read_bytes().decode("utf-8-sig")
            content = json.loads(self.text, object_pairs_hook=self._object, parse_constant=self._refuse_constant)
        except OSError as error:
            self._refuse(f"cannot be read: {error.strerror}")
        except json.JSONDecodeError as error:
            raise SystemDescriptionError(
                [Problem(Where(str(path), error.lineno), f"is not JSON: {error.msg}")]
            ) from None
        except UnicodeDecodeError:
            self._refuse("is not JSON: it is not UTF-8")
        except (ValueError, RecursionError) as error:
            self._refuse(f"is not JSON that can be read: {error}")
        if not isinstance(content, dict):
            self._refuse("is not a multi-model: its root must be an object")
        self.content: Mapping[str, Any] = content

    def _refuse(self, text: str) -> NoReturn:
        raise SystemDescriptionError([Problem(Where(str(self.path)), text)])

    def _refuse_constant(self, text: str) -> NoReturn:
        raise ValueError(f"{text} is not a JSON number")

    def _object(self, pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            seen: set[str] = set()
            self.repeated += [key for key, _ in pairs if key in seen or seen.add(key)]  # type: ignore[func-returns-value]
        return found

    def where(self, text: str | None = None) -> Where:
        """Returns the first line of the file that contains a string, as it is written there."""
        if text is None:
            return Where(str(self.path))
        for written in (json.dumps(text), json.dumps(text, ensure_ascii=False)):
            if (at := self.text.find(written)) >= 0:
                return Where(str(self.path), self.text.count("\n", 0, at) + 1)
        return Where(str(self.path))


def _multimodel_of(configuration: _Json, notes: list[str]) -> Path:
    """Returns the multi-model that a run's configuration names, by a path relative to the project's folder.

    If this file does not exist, since the project was moved or renamed, the only multi-model in the folder of the
    configuration or in its parent folder is used, where the application stores it.
    """
    named = str(configuration.content["multimodel_path"])
    path = Path(named.replace("\\", "/"))
    folders = configuration.path.absolute().parents if speakable(named) else ()
    for folder in folders:
        if _is_file(folder / path):
            return folder / path
    for folder in folders[:2]:
        beside = sorted({*folder.glob("mm.json"), *folder.glob("*.mm.json")} - {configuration.path.absolute()})
        if len(beside) == 1:
            notes.append(
                f"{configuration.where('multimodel_path')}: there is no file {shown(named)}; {beside[0]} is taken"
            )
            return beside[0]
    text = f"multimodel_path: there is no file {shown(named)} in the folder of this file or one above it"
    raise SystemDescriptionError([Problem(configuration.where("multimodel_path"), text)])


def _configuration_beside(model: _Json, notes: list[str]) -> _Json | None:
    """Returns the only configuration of a run in the folder of a multi-model; None if several or none exist."""
    if "algorithm" in model.content and "endTime" in model.content:
        return None
    folder = model.path.parent
    found = [file for file in (folder / "coe.json", folder / "config-simulation.json") if file.is_file()]
    found = found[:1] or sorted(folder.glob("*/coe.json"))
    if len(found) != 1 or found[0] == model.path:
        return None
    notes.append(f"{model.path}: how to run it is taken from {found[0]}")
    return _Json(found[0])


class _Reading:
    def __init__(self, given: Path) -> None:
        self.given = given
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self._ports: dict[str, dict[str, tuple[Kind, Where]]] = {}
        self._values: dict[str, list[Parameter]] = {}
        self._step: tuple[float, Where] | None = None
        self._tolerance: tuple[float, Where] | None = None
        self._variable: VarStep | None = None
        self._start: float | None = None
        self._stop: float | None = None

    # ---- the run -----------------------------------------------------------------------------------------------------

    def keys(self, file: _Json) -> None:
        """Converts the keys that are read to one spelling, and adds notes for the others."""
        known = {_simplified(word): key for key, words in _READ.items() for word in (key, *words)}
        known |= {_simplified(key): key for key in _REFUSED}
        content: dict[str, Any] = {}
        harmless = []
        for key, value in file.content.items():
            simple = _simplified(key)
            if (name := known.get(simple)) is not None:
                if name in content:
                    self._problem(file, key, f"{shown(key)} is given a second time, in another spelling")
                content[name] = value
                if name != key:
                    file.spelled[name] = key
            elif simple in _WITHOUT_EFFECT.split():
                harmless.append(key)
            elif near_ones := difflib.get_close_matches(simple, known, n=1, cutoff=0.8):
                text = f'there is no key {shown(key)}; did you mean "{known[near_ones[0]]}"?'
                self._problem(file, key, text)
            else:
                text = f"{shown(key)} is not a key of a multi-model: it is ignored"
                self.notes.append(Finding(file.where(key), text, "unknown keys of a multi-model"))
        if harmless:
            keys = ", ".join(map(shown, harmless))
            self.notes.append(f"{file.path}: ignored, since it changes no values: {keys}")
        file.content = content

    def configuration(self, file: _Json) -> None:
        """Reads the algorithm, the times and the stabilisation."""
        content = file.content
        for key, refusal in _REFUSED.items():
            if content.get(key):
                self._problem(file, key, refusal.text(key))
        if "algorithm" in content:
            self._algorithm(file, content["algorithm"])
        self._start = self._number(file, content, "startTime")
        self._stop = self._number(file, content, "endTime")
        self._stabilisation(file, content)

    def _stabilisation(self, file: _Json, content: Mapping[str, Any]) -> None:
        """Reads the stabilisation: every step is iterated until its outputs no longer change (our fixed point)."""
        wanted = content.get("stabalizationEnabled", False)
        if not isinstance(wanted, bool):
            self._problem(file, "stabalizationEnabled", f"stabilisation: {shown(wanted)} is not true or false")
            return
        names = ("global_absolute_tolerance", "global_relative_tolerance")
        given = [value for name in names if (value := self._number(file, content, name)) is not None]
        tries = self._number(file, content, "fixedPointIteration")
        if tries is not None and (tries < 1 or tries != int(tries)):
            self._problem(file, "fixedPointIteration", "fixedPointIteration: must be a positive whole number")
        if not wanted:
            return
        if any(value < 0.0 for value in given) or (given and not any(given)):
            self._problem(file, names[0], "stabilisation: of the two tolerances one must be positive, none negative")
            return
        if self._variable is not None:
            self._problem(file, "stabalizationEnabled", VAR_STEP.text())
            return
        where = file.where(file.spelled.get("stabalizationEnabled", "stabalizationEnabled"))
        self._tolerance = (min(filter(None, given), default=_TOLERANCE), where)
        self.notes.append(STABILISATION.text(where, f"{self._tolerance[0]:g}", f"{tries or _ITERATIONS:g}"))

    def _algorithm(self, file: _Json, algorithm: Any) -> None:
        kind = algorithm.get("type") if isinstance(algorithm, dict) else None
        if kind == "var-step":
            self._variable = VarStep(algorithm, file.where, lambda key, text: self._problem(file, key, text))
            if self._variable.first:
                self._step = (self._variable.first, file.where("initsize"))
            self.notes += self._variable.notes
            return
        if kind != "fixed-step":
            self._problem(file, "algorithm", ALGORITHM.text(shown(kind)))
            return
        size = self._number(file, algorithm, "size")
        if size is None or size <= 0.0:
            self._problem(file, "algorithm", "algorithm: fixed-step needs a positive size, in s")
        else:
            self._step = (size, file.where("size"))

    def _number(self, file: _Json, content: Mapping[str, Any], key: str) -> float | None:
        value = content.get(key)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not finite(value):
            self._problem(file, key, f"{key}: {shown(value)} is not a finite number")
            return None
        return float(value)

    # ---- the system --------------------------------------------------------------------------------------------------

    def structure(self, model: _Json) -> SystemStructure:
        for key in dict.fromkeys(model.repeated):
            self._problem(model, key, f"{shown(key)} is given twice in one object")
        fmus = self._fmus(model)
        self._parameters(model, fmus)
        connections = self._connections(model, fmus)
        used = {name[: name.index("}") + 1] for name in (*self._ports, *self._values)}
        for key in fmus:
            if key not in used:
                self.notes.append(f"{model.where(key)}: {key} has no instance: nothing is connected to it or set in it")
        where = model.where()
        components = tuple(self._component(name, fmus, model) for name in dict.fromkeys([*self._ports, *self._values]))
        root = System(
            model.path.stem, (), (), components, connections, self._annotations(), model.path.absolute(), where
        )
        return SystemStructure(
            name=model.path.stem,
            version="1.0",
            path=self.given,
            document=model.path.absolute(),
            system=root,
            where=where,
            start_time=self._start,
            stop_time=self._stop,
            problems=tuple(self.problems),
            notes=tuple(self.notes),
        )

    def _object(self, file: _Json, key: str) -> Mapping[str, Any]:
        value = file.content.get(key, {})
        if isinstance(value, dict):
            return value
        self._problem(file, key, f"{key}: must be an object, not {shown(value)}")
        return {}

    def _fmus(self, model: _Json) -> dict[str, Path | None]:
        found: dict[str, Path | None] = {}
        for key, source in self._object(model, "fmus").items():
            if not re.fullmatch(r"\{[^{}]+\}", key) or not speakable(key):
                self._problem(model, key, f'{shown(key)}: the key of an FMU is written "{{name}}"')
            elif not isinstance(source, str) or not speakable(source) or "\0" in source:
                self._problem(model, key, f"{key}: {shown(source)} is not the path of an FMU")
            else:
                found[key] = self._located(model, key, source)
        return found

    def _located(self, model: _Json, key: str, source: str) -> Path | None:
        """Returns the file of an FMU: by its path, or else in a surrounding folder FMUs, as used by the application."""
        text = unquote(urlsplit(source).path) if source.lower().startswith("file:") else source.replace("\\", "/")
        named = Path(text)
        candidates = []
        for folder in model.path.absolute().parents if named.name else ():
            candidates += [folder / named, folder / "FMUs" / named, folder / "FMUs" / named.name]
        for candidate in candidates:
            if _is_file(candidate):
                return candidate
        self._problem(model, key, f'{key}: there is no file "{source}", also not in a folder FMUs of this one or above')
        return None

    def _end(self, model: _Json, text: Any, fmus: Mapping[str, Path | None]) -> tuple[str, str] | None:
        """Returns instance and variable of "{key}.instance.variable"; the name of the variable may contain dots."""
        match = _END.fullmatch(text) if isinstance(text, str) and speakable(text) else None
        if match is None:
            written = text if isinstance(text, str) else None
            self._problem(model, written, f'{shown(text)}: variables are written "{{key}}.instance.variable"')
            return None
        key, instance, variable = match.groups()
        if key not in fmus:
            if key not in self._object(model, "fmus"):
                self._problem(model, text, f"{shown(text)}: there is no FMU {key}; {near(key, fmus)}")
            return None
        return f"{key}.{instance}", variable

    def _parameters(self, model: _Json, fmus: Mapping[str, Path | None]) -> None:
        for text, value in self._object(model, "parameters").items():
            end = self._end(model, text, fmus)
            if end is None:
                continue
            where = model.where(text)
            parameter = _parameter(end[1], value, where)
            if parameter is None:
                self._problem(
                    model, text, f"{text}: {shown(value)} is not a value; valid: a number, true, false or a text"
                )
            else:
                self._values.setdefault(end[0], []).append(parameter)

    def _connections(self, model: _Json, fmus: Mapping[str, Path | None]) -> tuple[Connection, ...]:
        made = []
        for text, targets in self._object(model, "connections").items():
            source = self._end(model, text, fmus)
            if not isinstance(targets, list):
                self._problem(
                    model, text, f"{shown(text)}: must be connected to a list of inputs, not {shown(targets)}"
                )
                continue
            for target_text in targets:
                target = self._end(model, target_text, fmus)
                if source is None or target is None:
                    continue
                where = model.where(text)
                self._port(*source, "output", where)
                self._port(*target, "input", where)
                made.append(Connection(*source, *target, where))
        return tuple(made)

    def _port(self, instance: str, variable: str, kind: Kind, where: Where) -> None:
        ports = self._ports.setdefault(instance, {})
        if ports.setdefault(variable, (kind, where))[0] != kind:
            text = f"{instance}.{variable} is at the giving end of one connection and at the taking end of another"
            self.problems.append(Problem(where, text))

    def _component(self, name: str, fmus: Mapping[str, Path | None], model: _Json) -> Component:
        where = model.where(name[: name.index("}") + 1])
        ports = tuple(Connector(variable, kind, place) for variable, (kind, place) in self._ports.get(name, {}).items())
        values = tuple(self._values.get(name, ()))
        bindings = (ParameterBinding(values, "", where),) if values else ()
        source = fmus[name[: name.index("}") + 1]]
        return Component(name, _FMU_TYPE, source, "any", ports, bindings, (), where)

    def _annotations(self) -> tuple[Annotation, ...]:
        made = []
        if self._step is not None:
            made.append(annotation(STEPPING, "stepping", {"stepSize": repr(self._step[0])}, self._step[1]))
        if self._tolerance is not None:
            settings = {"algorithm": "fixed-point", "tolerance": repr(self._tolerance[0])}
            made.append(annotation(MASTER, "master", settings, self._tolerance[1]))
        if self._variable is not None:
            made.append(self._variable.annotation())
        return tuple(made)

    def _problem(self, file: _Json, text: str | None, message: str) -> None:
        self.problems.append(Problem(file.where(file.spelled.get(text or "", text)), message))


def _simplified(key: str) -> str:
    """Returns a key without the differences between spellings: lower case, without "_" and "-"."""
    return key.lower().replace("_", "").replace("-", "")


def _is_file(path: Path) -> bool:
    """Returns whether such a file exists; False for invalid names of files."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _parameter(name: str, value: Any, where: Where) -> Parameter | None:
    """Returns a JSON value as a parameter; an integral number is an Integer, which Reals also accept."""
    if isinstance(value, bool):
        return Parameter(name, "Boolean", value, where)
    if isinstance(value, int | float):
        if not finite(value):
            return None
        low, high = INTEGER_RANGES["Integer"]
        if value == int(value) and low <= value <= high:
            return Parameter(name, "Integer", int(value), where)
        return Parameter(name, "Real", float(value), where)
    if isinstance(value, str) and speakable(value):
        return Parameter(name, "String", value, where)
    return None

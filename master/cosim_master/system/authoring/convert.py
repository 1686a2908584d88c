"""Writes systems for other engines, and those of other tools as SSPs: a file, and FMUs in resources/.

    convert(system, folder)              SystemStructure.ssd with all data that a run of ours needs
    convert(system, folder, "libcosim")  OspSystemStructure.xml
    convert(system, folder, ENGINE)      SystemStructure.ssd as ENGINE reads it: flat, typed connectors, plain names

The system is written in its checked form: flattened, with start values in the units of their variables, and with the
total factor and offset of all connections, including units and transformations. Features that the format of the file or
the engine lacks are refused. To change an existing SSP while keeping its other contents, see `swap`.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import (
    CONVERTED_LINK,
    ENGINE_FMI,
    ENGINE_TABLE,
    ENGINE_TYPES,
    ENGINE_VALUE,
    FMPY_TRANSFORMATION,
    FMPY_ZERO,
)
from cosim_master.files.whole import writing
from cosim_master.fmi.description.read import Variable
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance, FlatConnection
from cosim_master.system.reading.others.osp import OSP_DOCUMENT
from cosim_master.system.reading.read import FMU_TYPE, ROOT_DOCUMENT, read_system
from cosim_master.system.structure import Value, annotation

__all__ = ["ENGINES", "Converted", "convert"]

ENGINES = ("omsimulator", "libcosim", "ecos", "fmpy")
PARAMETERS = "initialValues"
"""The name of the parameter sets, by which Ecos applies them."""
_NAMESPACES = {
    kind: f"http://ssp-standard.org/SSP1/SystemStructure{name}"
    for kind, name in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
}
_OSP = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
_DEFAULT: Any = {None: _OSP}  # lxml-stubs only know prefixes
_OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_KEPT = ("org.uav-cosim.master", "org.uav-cosim.network", "org.uav-cosim.recording")
_ESCAPED = re.compile(r"[^A-Za-z0-9._~-]")  # in URIs (RFC 3986, section 2.3)
_SSP1 = {"Float64": "Real", "Int32": "Integer"}


@dataclass(frozen=True, slots=True)
class Converted:
    """The files written by a conversion: the file of the system, and notes for its user."""

    file: Path
    notes: tuple[str, ...]


def convert(system: str | Path, folder: Path, engine: str | None = None) -> Converted:
    """Writes a system into a folder.

    Args:
        system: a multi-model (.json), an OspSystemStructure.xml or a project of MasterSim; with `engine` any system.
        folder: the folder to write, which must not exist.
        engine: one of ENGINES; None writes an SSP for ourselves.

    Raises:
        SystemDescriptionError: the system is invalid or has no equivalent in the format, or the folder exists.
        WriteFailed: the folder cannot be written.
    """
    with read_system(system) as structure:
        checked = check(structure)
        if engine is None and structure.document.suffix.lower() == ".ssd":
            raise _refused(structure.path, f"is an SSP already; for another engine: --for {'|'.join(ENGINES)}")
        if problems := [*_problems(checked, engine)]:
            raise SystemDescriptionError(problems)
        if folder.exists():
            raise _refused(folder, "exists already; give a folder that does not")
        writing = _Writing(checked, engine)
        with _new(folder):
            (folder / "resources").mkdir(parents=True)
            sources = _copied(checked, folder)
            document = writing.osp(sources) if engine == "libcosim" else writing.ssd(sources)
            file = folder / (OSP_DOCUMENT if engine == "libcosim" else ROOT_DOCUMENT)
            document.write(file, xml_declaration=True, encoding="UTF-8", pretty_print=True)
            if engine == "fmpy":
                writing.values().write(
                    folder / f"{PARAMETERS}.ssv", xml_declaration=True, encoding="UTF-8", pretty_print=True
                )
        return Converted(file, tuple(writing.notes))


@contextmanager
def _new(folder: Path) -> Iterator[None]:
    """Removes the folder again after an error."""
    with writing(folder):
        try:
            yield
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise


def _refused(path: Path, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(path)), text)])


def _problems(checked: CheckedSystem, engine: str | None) -> Iterable[Problem]:
    """Yields problems for connections and FMUs that the format or the engine does not support."""
    fmus = {one.name: one.fmu for one in checked.instances}
    for link in checked.links:
        name = ".".join(link.target)
        summed = link.term is not None and engine != "libcosim"
        text = fmus[link.target[0]].variables[link.target[1]].type in ("String", "Binary")
        if engine in ("fmpy", "omsimulator") and text:
            yield Problem(link.where, ENGINE_TYPES.text(name, "a text", "a text", engine))
        if link.mapping or link.recoded or summed or (link.initial_only and engine == "libcosim"):
            what = "a sum" if summed else "a parameter" if link.initial_only else "mapped on the way"
            yield Problem(link.where, CONVERTED_LINK.text(name, what))
        if engine == "fmpy" and (link.factor, link.offset) != (1.0, 0.0):
            yield Problem(link.where, FMPY_TRANSFORMATION.text(name))
        source, target = fmus[link.source[0]].variables[link.source[1]], fmus[link.target[0]].variables[link.target[1]]
        if (engine in ("libcosim", "ecos", "omsimulator") and source.type != target.type) or (
            engine in ("libcosim", "ecos") and target.type == "Enumeration"
        ):
            yield Problem(link.where, ENGINE_TYPES.text(name, target.type, source.type, engine))
        if engine == "fmpy" and target.items and 0 not in target.items.values():
            yield Problem(link.where, FMPY_ZERO.text(name))
    for one in checked.instances:
        if engine and one.fmu.table is not None and not (engine == "omsimulator" and _is_linear_csv(one)):
            yield Problem(one.where, ENGINE_TABLE.text(one.name, one.fmu.path.name, engine))
        if one.fmu.fmi_version.startswith("3") and engine in ("libcosim", "fmpy"):
            yield Problem(one.where, ENGINE_FMI.text(one.name, "3.0", engine))
        for name, value in one.start_values.items():
            if kind := _unset(one.fmu.variables[name], value, engine):
                yield Problem(one.where, ENGINE_VALUE.text(f"{one.name}.{name}", kind, engine))


def _unset(variable: Variable, value: Value, engine: str | None) -> str:
    """Returns a word for a start value that the engine cannot set; empty if it can, or if it is the FMU's own.

    libcosim and Ecos have no variables of type Enumeration. FMPy 0.3 sets no texts, and true for every Boolean that is
    written.
    """
    if engine in ("libcosim", "ecos"):
        return "an Enumeration" if variable.type == "Enumeration" else ""
    if engine != "fmpy" or value == variable.start:
        return ""
    if variable.type in ("String", "Binary"):
        return "a text"
    return "false" if variable.type == "Boolean" and not value else ""


def _is_linear_csv(instance: ComponentInstance) -> bool:
    """Returns whether OMSimulator interprets a CSV file in the same way: Reals are linear, other values are held."""
    return _table_type(instance) == "text/csv" and instance.fmu.path.suffix.lower() == ".csv"


def _table_type(instance: ComponentInstance) -> str:
    """Returns the type of a component that is a table."""
    fmu = instance.fmu
    columns = {} if fmu.table is None else fmu.table.columns
    held = any(column.held for name, column in columns.items() if fmu.variables[name].type == "Real")
    kind = "application/vnd.apache.parquet" if fmu.path.suffix.lower() == ".parquet" else "text/csv"
    return f"{kind}; interpolation=hold" if held else kind


def _copied(checked: CheckedSystem, folder: Path) -> dict[Path, str]:
    """Returns copies of the FMUs, as file -> path in the folder. Files of the same name get a number.

    Other engines take the source as a path, although it is a URI: names are such that both are the same.
    """
    copied: dict[Path, str] = {}
    taken: set[str] = set()
    for instance in checked.instances:
        source = instance.fmu.path
        if source in copied:
            continue
        stem, n = _ESCAPED.sub("_", source.stem), 1
        name = f"{stem}{source.suffix}"
        while name.lower() in taken:
            n += 1
            name = f"{stem}_{n}{source.suffix}"
        taken.add(name.lower())
        shutil.copyfile(source, folder / "resources" / name)
        copied[source] = f"resources/{name}"
    return copied


def _tag(kind: str, name: str) -> str:
    return f"{{{_NAMESPACES[kind]}}}{name}"


def _add(parent: etree._Element, kind: str, name: str, attributes: Mapping[str, str] | None = None) -> etree._Element:
    return etree.SubElement(parent, _tag(kind, name), dict(attributes or {}))


def _osp(parent: etree._Element, name: str, attributes: Mapping[str, str] | None = None) -> etree._Element:
    return etree.SubElement(parent, f"{{{_OSP}}}{name}", dict(attributes or {}))


class _Writing:
    """Writes a checked system to a file.

    Attributes:
        notes: differences from the original, and settings for the engine.
    """

    def __init__(self, checked: CheckedSystem, engine: str | None) -> None:
        self.checked, self.engine = checked, engine
        self.notes: list[str] = []
        self._fmus = {one.name: one.fmu for one in checked.instances}
        self._names = {one.name: one.name for one in checked.instances}
        if engine is not None:
            self._names = _plain_names(checked.instances, apart=engine == "fmpy")
        self._enumerations: dict[tuple[tuple[str, int], ...], str] = {}
        used = [v for one in checked.instances for v in self._variables(one)]
        new = any(v.fmi_type and _SSP1.get(v.fmi_type) is None and v.type in ("Real", "Integer") for v in used)
        self._version = "2.0" if new or any(v.causality in ("local", "structuralParameter") for v in used) else "1.0"
        renamed = [f"{old} is {new_}" for old, new_ in self._names.items() if old != new_]
        if renamed:
            self.notes.append(f"names that {engine} takes: {', '.join(renamed[:5])}{' ...' if renamed[5:] else ''}")
        if engine and any(v.packet_capacity for v in used):
            self.notes.append(f"packets are not exchanged: {engine} has no radio")
        steps = sorted({one.step_size for one in checked.instances if one.step_size is not None})
        if engine and steps:
            shown = ", ".join(f"{step:g}" for step in steps)
            alone = "; one for all is needed" if len(steps) > 1 else ""
            alone += f"; in Python: setFixedStepSize({steps[0]!r})" if engine == "omsimulator" else ""
            self.notes.append(f"the step is {shown} s{alone}")
        self._steps = steps
        if engine == "omsimulator" and (changed := [link for link in checked.links if self._linear(link) is not None]):
            ends = ", ".join(".".join(link.target) for link in changed[:3]) + (", ..." if changed[3:] else "")
            self.notes.append(
                f"{len(changed)} connections have a factor or an offset ({ends}), which OMSimulator applies since "
                "March 2026 (#1566); earlier versions pass the value unchanged"
            )
        if engine == "fmpy" and checked.links:
            self.notes.append("FMPy makes its first step with 0 at all connected inputs")
        if engine in ("ecos", "fmpy") and any(one.start_values for one in checked.instances):
            how = {
                "ecos": f'init(parameter_set="{PARAMETERS}")',
                "fmpy": f'simulate_ssp(..., parameter_set=read_ssv("{PARAMETERS}.ssv"))',
            }
            self.notes.append(f"start values are applied if {engine} is told to: {how[engine]}")

    def _variables(self, instance: ComponentInstance) -> list[Variable]:
        """Returns the variables of an instance that are connected or set, and all outputs."""
        ends = {end[1] for link in self.checked.links for end in (link.source, link.target) if end[0] == instance.name}
        ends |= {*instance.start_values}
        return [v for v in instance.fmu.variables.values() if v.name in ends or v.causality == "output"]

    def _connectors(self, instance: ComponentInstance) -> list[Variable]:
        """Returns the variables that are connectors.

        FMPy and OMSimulator have no connectors for texts, and FMPy fails for unconnected inputs.
        """
        found = self._variables(instance)
        if self.engine == "omsimulator":
            return [v for v in found if v.type not in ("String", "Binary", "Clock")]
        if self.engine != "fmpy":
            return found
        driven = {link.target for link in self.checked.links}
        return [
            v
            for v in found
            if v.type not in ("String", "Binary") and (v.causality != "input" or (instance.name, v.name) in driven)
        ]

    def _linear(self, link: FlatConnection) -> dict[str, str] | None:
        if (link.factor, link.offset) == (1.0, 0.0):
            return None
        return {"factor": repr(float(link.factor)), "offset": repr(float(link.offset))}

    # ---- SystemStructure.ssd -----------------------------------------------------------------------------------------

    def ssd(self, sources: Mapping[Path, str]) -> etree._ElementTree:
        structure = self.checked.structure
        title, name = structure.name or "system", structure.system.name or "system"
        if self.engine:
            title, name = _plain(title), _plain(name)
        head = {"version": self._version, "name": title}
        root = etree.Element(_tag("ssd", "SystemStructureDescription"), head, nsmap=_NAMESPACES)
        system = _add(root, "ssd", "System", {"name": name})
        elements = _add(system, "ssd", "Elements")
        for instance in self.checked.instances:
            self._component(elements, instance, sources[instance.fmu.path])
        if self.checked.links:
            connections = _add(system, "ssd", "Connections")
            for link in self.checked.links:
                self._connection(connections, link)
        self._annotations(system)
        if self._enumerations:
            enumerations = _add(root, "ssd", "Enumerations")
            for items, kind in self._enumerations.items():
                made = _add(enumerations, "ssc", "Enumeration", {"name": kind})
                for item, value in items:
                    _add(made, "ssc", "Item", {"name": item, "value": str(value)})
        times = {"startTime": self.checked.start_time, "stopTime": self.checked.stop_time}
        given = {key: repr(float(value)) for key, value in times.items() if value is not None}
        _add(root, "ssd", "DefaultExperiment", given)
        return etree.ElementTree(root)

    def _component(self, parent: etree._Element, instance: ComponentInstance, source: str) -> None:
        kind = FMU_TYPE if instance.fmu.table is None else _table_type(instance)
        head = {"name": self._names[instance.name], "type": kind, "source": source}
        made = _add(parent, "ssd", "Component", head)
        if variables := self._connectors(instance):
            connectors = _add(made, "ssd", "Connectors")
            for v in variables:
                kind = "constant" if v.variability == "constant" and self._version != "1.0" else v.causality
                self._type(_add(connectors, "ssd", "Connector", {"name": v.name, "kind": kind}), v)
        if instance.start_values:
            binding = _add(_add(made, "ssd", "ParameterBindings"), "ssd", "ParameterBinding")
            values = _add(_add(binding, "ssd", "ParameterValues"), "ssv", "ParameterSet", self._set_head())
            self._parameters(values, {name: (instance, name) for name in instance.start_values})
        own = self._stepping_of_their_own() and self.engine != "omsimulator"  # which refuses annotations of components
        if own and instance.step_size is not None:
            step = {"stepSize": repr(instance.step_size)}
            _add(made, "ssd", "Annotations").append(
                annotation("org.uav-cosim.stepping", "stepping", step, instance.where).element
            )

    def _set_head(self) -> dict[str, str]:
        return {"version": self._version, "name": PARAMETERS}

    def _stepping_of_their_own(self) -> bool:
        return len({one.step_size for one in self.checked.instances}) > 1

    def _type(self, connector: etree._Element, variable: Variable) -> None:
        """Returns the type of a connector, which is that of its FMU."""
        if variable.type == "Enumeration":
            _add(connector, "ssc", "Enumeration", {"name": self._enumeration(variable)})
        elif variable.type == "Binary":
            _add(connector, "ssc", "Binary", {"mime-type": variable.mime_type} if variable.mime_type else {})
        elif variable.type != "Clock":
            kind = variable.type if self._version == "1.0" else variable.fmi_type or variable.type
            _add(connector, "ssc", _SSP1.get(kind, kind))

    def _enumeration(self, variable: Variable) -> str:
        items = tuple((variable.items or {}).items())
        return self._enumerations.setdefault(items, f"Enumeration{len(self._enumerations) + 1}")

    def _parameters(self, parent: etree._Element, named: Mapping[str, tuple[ComponentInstance, str]]) -> None:
        parameters = _add(parent, "ssv", "Parameters")
        for name, (instance, variable_name) in named.items():
            variable, value = instance.fmu.variables[variable_name], instance.start_values[variable_name]
            typed = _add(parameters, "ssv", "Parameter", {"name": name})
            kind = variable.type if variable.type != "Clock" else "Real"
            if kind == "Integer" and self._version != "1.0":
                kind = _SSP1.get(variable.fmi_type, variable.fmi_type or "Integer")
            if kind == "Enumeration" and self.engine is not None:
                kind = "Integer"  # FMPy and OMSimulator read no items
            items = {number: item for item, number in (variable.items or {}).items()}
            text = items.get(int(value), str(value)) if kind == "Enumeration" else _text(kind, value)
            _add(typed, "ssv", kind, {"value": text})

    def _connection(self, parent: etree._Element, link: FlatConnection) -> None:
        ends = {
            "startElement": self._names[link.source[0]],
            "startConnector": link.source[1],
            "endElement": self._names[link.target[0]],
            "endConnector": link.target[1],
        }
        units = [self._fmus[end[0]].variables[end[1]].unit for end in (link.source, link.target)]
        if None not in units and units[0] != units[1]:
            ends["suppressUnitConversion"] = "true"  # included in factor and offset
        made = _add(parent, "ssd", "Connection", ends)
        if (linear := self._linear(link)) is not None:
            _add(made, "ssc", "LinearTransformation", linear)

    def _annotations(self, system: etree._Element) -> None:
        made = [one.annotation for one in self.checked.annotations if not one.owner and one.annotation.type in _KEPT]
        if self.engine is not None and made:
            self.notes.append(f"left out, since {self.engine} has nothing like it: {', '.join(a.type for a in made)}")
            made = []
        if self._steps and not self._stepping_of_their_own():
            step = {"stepSize": repr(self._steps[0])}
            made.append(annotation("org.uav-cosim.stepping", "stepping", step, self.checked.structure.where))
        elements = [one.element for one in made]
        if self.engine == "omsimulator" and self._steps:
            oms = etree.Element(_tag("ssc", "Annotation"), {"type": "org.openmodelica"})
            frame = etree.SubElement(oms, f"{{{_OMS}}}Annotations", nsmap={"oms": _OMS})
            master = {"description": "oms-ma", "stepSize": repr(self._steps[0])}
            information = etree.SubElement(frame, f"{{{_OMS}}}SimulationInformation")
            etree.SubElement(information, f"{{{_OMS}}}FixedStepMaster", master)
            elements.insert(0, oms)  # OMSimulator looks at the first annotation only
        if elements:
            _add(system, "ssd", "Annotations").extend(elements)

    def values(self) -> etree._ElementTree:
        """Returns all start values as a parameter set of the whole system."""
        root = etree.Element(_tag("ssv", "ParameterSet"), self._set_head(), nsmap=_NAMESPACES)
        named = {
            f"{self._names[one.name]}.{name}": (one, name)
            for one in self.checked.instances
            for name in one.start_values
            if one.fmu.variables[name].type not in ("String", "Binary") and one.start_values[name] is not False
        }
        self._parameters(root, named)
        return etree.ElementTree(root)

    # ---- OspSystemStructure.xml --------------------------------------------------------------------------------------

    def osp(self, sources: Mapping[Path, str]) -> etree._ElementTree:
        root = etree.Element(f"{{{_OSP}}}OspSystemStructure", {"version": "0.1"}, nsmap=_DEFAULT)
        times = {"StartTime": self.checked.start_time, "EndTime": self.checked.stop_time}
        times["BaseStepSize"] = self._steps[0] if self._steps else None
        for name, time in times.items():
            if time is not None:
                _osp(root, name).text = repr(float(time))
        _osp(root, "Algorithm").text = "fixedStep"
        simulators = _osp(root, "Simulators")
        for one in self.checked.instances:
            head = {"name": self._names[one.name], "source": sources[one.fmu.path]}
            made = _osp(simulators, "Simulator", head | ({"stepSize": repr(one.step_size)} if one.step_size else {}))
            values = _osp(made, "InitialValues") if one.start_values else made
            for name, value in one.start_values.items():
                kind = one.fmu.variables[name].type
                kind = "Integer" if kind == "Enumeration" else kind
                _osp(_osp(values, "InitialValue", {"variable": name}), kind, {"value": _text(kind, value)})
        functions, connections = _osp(root, "Functions"), _osp(root, "Connections")
        self._osp_connections(functions, connections)
        for empty in (functions, connections):
            if not len(empty):
                root.remove(empty)
        return etree.ElementTree(root)

    def _osp_connections(self, functions: etree._Element, connections: etree._Element) -> None:
        terms: dict[tuple[str, str], list[FlatConnection]] = {}
        linear: list[FlatConnection] = []
        for link in self.checked.links:
            if link.term is not None:
                terms.setdefault(link.target, []).append(link)
            elif self._linear(link) is not None:
                linear.append(link)
            else:
                made = _osp(connections, "VariableConnection")
                for end in (link.source, link.target):
                    self._osp_variable(made, end)
        for n, link in enumerate(linear, start=1):
            attributes = self._linear(link) or {}
            _osp(functions, "LinearTransformation", {"name": f"linear{n}", **attributes})
            self._osp_signals(connections, f"linear{n}", [("in", link.source), ("out", link.target)])
        for n, (target, links) in enumerate(terms.items(), start=1):
            _osp(functions, "Sum", {"name": f"sum{n}", "inputCount": str(len(links))})
            ends = [(f"in[{i}]", link.source) for i, link in enumerate(links)]
            self._osp_signals(connections, f"sum{n}", [*ends, ("out", target)])

    def _osp_signals(
        self, connections: etree._Element, function: str, ends: Iterable[tuple[str, tuple[str, str]]]
    ) -> None:
        for signal, end in ends:
            made = _osp(connections, "SignalConnection")
            self._osp_variable(made, end)
            _osp(made, "Signal", {"function": function, "name": signal})

    def _osp_variable(self, parent: etree._Element, end: tuple[str, str]) -> None:
        _osp(parent, "Variable", {"simulator": self._names[end[0]], "name": end[1]})


def _plain(name: str) -> str:
    """Returns a name of letters, digits and underscores."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "x"
    return plain if not plain[0].isdigit() else f"x{plain}"


def _plain_names(instances: Iterable[ComponentInstance], *, apart: bool) -> dict[str, str]:
    """Returns unique plain names of instances; with `apart`, no name begins with another one, as FMPy requires."""
    found: dict[str, str] = {}
    for one in instances:
        plain, n = _plain(one.name), 1
        while plain in found.values():
            n += 1
            plain = f"{_plain(one.name)}_{n}"
        found[one.name] = plain
    for name, plain in found.items():
        while apart and any(other != plain and other.startswith(plain) for other in found.values()):
            plain += "_"
        found[name] = plain
    return found


def _text(kind: str, value: Value) -> str:
    if isinstance(value, bool) or kind == "Boolean":
        return "true" if value else "false"
    return repr(float(value)) if kind in ("Real", "Float32", "Float64") else str(value)

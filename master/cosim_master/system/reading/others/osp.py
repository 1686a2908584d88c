"""Reads OspSystemStructure.xml of the Open Simulation Platform (libcosim) as a system.

    Simulator            an FMU: a component, with its step size and start values
    VariableConnection   a connection; the causality of the two variables determines its direction
    ...GroupConnection   connections between the variables of groups, which NAME_OspModelDescription.xml lists
    LinearTransformation, Sum, VectorSum
                         functions: an input is factor * output + offset, or the sum of several outputs, without delay

As in libcosim, units are not converted, and the simulators' steps are integral multiples of the base step. FMUs of
proxyfmu run in this process. The variable step of the algorithm "ecco" is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import OSP_ALGORITHM, OSP_BOND
from cosim_master.diagnostics.names import near
from cosim_master.files.xml import Form, Grammar, Reader, double, line_of, local_name, whole
from cosim_master.fmi.description.read import describe
from cosim_master.system.reading.ssp.references import File, is_file, parsed, read_source
from cosim_master.system.structure import (
    Component,
    Connection,
    Connector,
    LinearTransformation,
    Parameter,
    ParameterBinding,
    System,
    SystemStructure,
    Value,
    annotation,
)

__all__ = ["OSP_DOCUMENT", "read_osp"]

OSP_DOCUMENT = "OspSystemStructure.xml"
_FMU_TYPE = "application/x-fmu-sharedlibrary"
_OSP = "{http://opensimulationplatform.com/MSMI/OSPSystemStructure}"
_MODEL = "{http://opensimulationplatform.com/MSMI/OSPModelDescription}"
_BASE_STEP = 0.1
"""libcosim's default base step, s."""
_SIGNAL = re.compile(r"in\[([0-9]+)\]")


def _form(children: str = "", required: str = "", optional: str = "", repeated: bool = False) -> Form:
    tags = tuple(_OSP + name for name in children.split())
    many = frozenset(tags) if repeated else frozenset()
    return Form(tuple(required.split()), tuple(optional.split()), tags, many)


_ENDS = "simulator name"
GRAMMAR: Grammar = {
    _OSP + "OspSystemStructure": _form(
        "StartTime EndTime BaseStepSize Algorithm Simulators Functions Connections EccoConfiguration", "version"
    ),
    _OSP + "Simulators": _form("Simulator", repeated=True),
    _OSP + "Simulator": _form("InitialValues", "name source", "stepSize"),
    _OSP + "InitialValues": _form("InitialValue", repeated=True),
    _OSP + "InitialValue": _form("Real Integer Boolean String", "variable"),
    **{_OSP + kind: _form(required="value") for kind in ("Real", "Integer", "Boolean", "String")},
    _OSP + "Functions": _form("LinearTransformation Sum VectorSum", repeated=True),
    _OSP + "LinearTransformation": _form(required="name", optional="factor offset"),
    _OSP + "Sum": _form(required="name inputCount"),
    _OSP + "VectorSum": _form(required="name inputCount dimension"),
    **{
        _OSP + name: Form(optional=("powerBond",), children=(_OSP + ends,), repeated=frozenset([_OSP + ends]))
        for name, ends in (("VariableConnection", "Variable"), ("VariableGroupConnection", "VariableGroup"))
    },
    _OSP + "SignalConnection": Form(children=(_OSP + "Variable", _OSP + "Signal"), filled=True, unordered=True),
    _OSP + "SignalGroupConnection": Form(
        children=(_OSP + "SignalGroup", _OSP + "VariableGroup"), filled=True, unordered=True
    ),
    **{_OSP + name: _form(required=_ENDS, optional="causality") for name in ("Variable", "VariableGroup")},
    **{_OSP + name: _form(required="function name") for name in ("Signal", "SignalGroup")},
}
_CONNECTIONS = Form(
    children=tuple(
        _OSP + name
        for name in ("VariableConnection", "SignalConnection", "VariableGroupConnection", "SignalGroupConnection")
    ),
    unordered=True,
    repeated=frozenset(
        _OSP + name
        for name in ("VariableConnection", "SignalConnection", "VariableGroupConnection", "SignalGroupConnection")
    ),
)

_End = tuple[str, str]
"""Simulator and variable."""


@dataclass(slots=True)
class _Function:
    """A function: its number of inputs, the variables of each input, and their connections."""

    kind: str
    inputs: int
    dimension: int
    transformation: LinearTransformation | None
    where: Where
    sources: dict[int, Sequence[_End]] = field(default_factory=dict)
    targets: list[tuple[Sequence[_End], Where]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Group:
    """A variable group: its variables, and the groups inside it, in the order of the file."""

    variables: tuple[str, ...]
    groups: tuple[_Group, ...]

    def flat(self) -> list[str]:
        return [*self.variables, *(name for group in self.groups for name in group.flat())]


def read_osp(path: Path) -> SystemStructure:
    """Reads an OspSystemStructure.xml.

    Returns:
        The structure; its errors are in `problems`, as for every system.

    Raises:
        SystemDescriptionError: the file cannot be read, or has another format.
    """
    file = File(path.absolute(), str(path))
    root = parsed(file)
    if root.tag != _OSP + "OspSystemStructure":
        message = f"the root element is <{root.tag}>; it must be <{_OSP}OspSystemStructure>"
        raise SystemDescriptionError([Problem(Where(str(path), line_of(root)), message)])
    return _Reading(file, root).structure()


class _Reading:
    def __init__(self, file: File, root: etree._Element) -> None:
        self.file, self.root = file, root
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self._reader = Reader(file.shown, self.problems)
        self._ports: dict[str, dict[str, Connector]] = {}
        self._sources: dict[str, File | None] = {}
        self._described: dict[str, Mapping[str, _Group]] = {}
        self._connections: list[Connection] = []

    def structure(self) -> SystemStructure:
        reader, root = self._reader, self.root
        reader.children(root, GRAMMAR[_OSP + "OspSystemStructure"])
        start, stop = self._number("StartTime"), self._number("EndTime")
        base = self._number("BaseStepSize")
        algorithm = self._text("Algorithm") or "fixedStep"
        if algorithm != "fixedStep":
            reader.problem(self._child("Algorithm"), OSP_ALGORITHM.text(algorithm))
        if base is None:
            self.notes.append(f"{reader.where(root)}: no BaseStepSize: it is {_BASE_STEP} s, as in libcosim")
        base = _BASE_STEP if base is None else base
        if base <= 0.0:
            reader.problem(self._child("BaseStepSize"), "BaseStepSize must be positive")
            base = _BASE_STEP
        simulators = [self._simulator(one, base) for one in self._list("Simulators")]
        functions = self._functions()
        self._connect(functions)
        components = tuple(self._with_ports(component) for component in simulators)
        where = reader.where(root)
        name = self.file.path.parent.name or "system"
        system = System(name, (), (), components, tuple(self._connections), (), self.file.path, where)
        return SystemStructure(
            name=system.name,
            version="1.0",
            path=Path(self.file.shown),
            document=self.file.path,
            system=system,
            where=where,
            start_time=start,
            stop_time=stop,
            problems=tuple(self.problems),
            notes=tuple(self.notes),
        )

    # ---- elements ----------------------------------------------------------------------------------------------------

    def _child(self, name: str) -> etree._Element:
        found = self.root.find(_OSP + name)
        return self.root if found is None else found

    def _list(self, name: str) -> Sequence[etree._Element]:
        holder = self.root.find(_OSP + name)
        if holder is None:
            return ()
        form = _CONNECTIONS if name == "Connections" else GRAMMAR[_OSP + name]
        return self._reader.children(holder, form)

    def _text(self, name: str) -> str | None:
        found = self.root.find(_OSP + name)
        return None if found is None else (found.text or "").strip()

    def _number(self, name: str) -> float | None:
        text = self._text(name)
        number = None if text is None else double(text)
        if text is not None and (number is None or abs(number) > 1e12 or number != number):
            self._reader.problem(self._child(name), f'<{name}> is "{text[:60]}"; it must be a finite number in s')
            return None
        return number

    def _simulator(self, element: etree._Element, base: float) -> Component:
        reader, where = self._reader, self._reader.where(element)
        reader.children(element, GRAMMAR[_OSP + "Simulator"])
        name = reader.name(element)
        if name in self._sources:
            reader.problem(element, f'there is a second simulator "{name}"')
        trouble, source, note = read_source(self.file, element.get("source", ""))
        if trouble is not None:
            reader.problem(element, f'source "{element.get("source", "")}" {trouble}')
        if note:
            self.notes.append(f"{where}: {note}")
        self._sources[name] = source
        step = reader.real(element, "stepSize", base)
        factor = max(1, int(step / base + 1e-9)) if step > 0.0 else 1
        if step > 0.0 and abs(factor * base - step) > 1e-9 * step:
            text = (
                f'"{name}" steps by {factor * base:g} s, not by {step:g} s: a multiple of the base step, as in libcosim'
            )
            self.notes.append(f"{where}: {text}")
        values = tuple(self._values(element))
        bindings = (ParameterBinding(values, "", where),) if values else ()
        stepping = annotation("org.uav-cosim.stepping", "stepping", {"stepSize": repr(factor * base)}, where)
        path = None if source is None else source.path
        return Component(name, _FMU_TYPE, path, "any", (), bindings, (stepping,), where)

    def _values(self, simulator: etree._Element) -> list[Parameter]:
        reader, found = self._reader, []
        holder = simulator.find(_OSP + "InitialValues")
        for element in () if holder is None else reader.children(holder, GRAMMAR[_OSP + "InitialValues"]):
            held = reader.children(element, GRAMMAR[_OSP + "InitialValue"])
            name = reader.name(element, "variable")
            if len(held) != 1:
                reader.problem(element, f'"{name}" needs one value: <Real>, <Integer>, <Boolean> or <String>')
                continue
            reader.children(held[0], GRAMMAR[str(held[0].tag)])
            found.append(Parameter(name, local_name(held[0]), self._value(held[0]), reader.where(element)))
        return found

    def _value(self, element: etree._Element) -> Value:
        kind = local_name(element)
        if kind == "Real":
            return self._reader.real(element, "value")
        if kind == "Integer":
            return self._reader.integer(element, "value")
        return self._reader.boolean(element, "value") if kind == "Boolean" else self._reader.text(element, "value")

    def _functions(self) -> dict[str, _Function]:
        reader, found = self._reader, dict[str, _Function]()
        for element in self._list("Functions"):
            reader.children(element, GRAMMAR[str(element.tag)])
            name, kind, where = reader.name(element), local_name(element), reader.where(element)
            if name in found:
                reader.problem(element, f'there is a second function "{name}"')
            transformation = None
            if kind == "LinearTransformation":
                factor, offset = reader.real(element, "factor", 1.0), reader.real(element, "offset", 0.0)
                transformation = LinearTransformation(factor, offset, where)
            inputs = reader.integer(element, "inputCount", 1, low=1, high=1000)
            dimension = reader.integer(element, "dimension", 1, low=1, high=1000)
            found[name] = _Function(kind, inputs, dimension, transformation, where)
        return found

    # ---- connections -------------------------------------------------------------------------------------------------

    def _connect(self, functions: Mapping[str, _Function]) -> None:
        for element in self._list("Connections"):
            kind = local_name(element)
            held = self._reader.children(element, GRAMMAR[str(element.tag)])
            for child in held:
                self._reader.children(child, GRAMMAR[str(child.tag)])
            if element.get("powerBond") is not None:
                self.notes.append(f"{self._reader.where(element)}: {OSP_BOND.text(element.get('powerBond'))}")
            if len(held) != 2:
                self._reader.problem(element, f"<{kind}> connects {len(held)} ends; it must have two")
            elif kind == "VariableConnection":
                ends = [self._end(child) for child in held]
                if ends[0] is not None and ends[1] is not None:
                    self._joined(ends[0], ends[1], self._reader.where(element))
            elif kind == "VariableGroupConnection":
                self._join_groups(element, held)
            else:
                self._join_function(element, held, functions)
        for function in functions.values():
            self._apply(function)

    def _end(self, element: etree._Element) -> _End | None:
        simulator = element.get("simulator", "")
        if simulator not in self._sources:
            self._reader.problem(element, f'there is no simulator "{simulator}"; {near(simulator, self._sources)}')
            return None
        return simulator, element.get("name", "")

    def _joined(
        self,
        one: _End,
        other: _End,
        where: Where,
        transformation: LinearTransformation | None = None,
        summed: bool = False,
    ) -> None:
        for simulator, variable in (one, other):
            self._ports.setdefault(simulator, {})[variable] = Connector(variable, "unspecified", where)
        self._connections.append(Connection(*one, *other, where, True, transformation, summed=summed))

    def _members(self, element: etree._Element) -> tuple[str, _Group] | None:
        end = self._end(element)
        if end is None:
            return None
        simulator, name = end
        if simulator not in self._described:
            self._described[simulator] = self._groups(simulator, element)
        groups = self._described[simulator]
        if name not in groups:
            if groups or self._sources[simulator] is not None:
                text = f'"{simulator}" has no variable group "{name}"; {near(name, groups)}'
                self._reader.problem(element, text)
            return None
        return simulator, groups[name]

    def _groups(self, simulator: str, element: etree._Element) -> dict[str, _Group]:
        """Returns the variable groups of an FMU, from the file named after its model, next to the FMU or this file."""
        source = self._sources[simulator]
        if source is None:
            return {}
        try:
            models = [describe(source.path).model_name, source.path.stem]
        except SystemDescriptionError:  # reported by `check`
            models = [source.path.stem]
        names = [f"{model}_OspModelDescription.xml" for model in dict.fromkeys(models)]
        places = [folder / name for name in names for folder in (source.path.parent, self.file.path.parent)]
        found = next((place for place in places if is_file(place)), None)
        if found is None:
            listed = " or ".join(names)
            text = f'the groups of "{simulator}" are not described: no file {listed} beside the FMU or beside this file'
            self._reader.problem(element, text)
            return {}
        try:
            root = parsed(File(found, str(found)))
        except SystemDescriptionError as error:
            self.problems += error.problems
            return {}
        return {
            group.get("name", ""): _group(group)
            for holder in root.iterfind(_MODEL + "VariableGroups")
            for group in holder
        }

    def _join_groups(self, element: etree._Element, held: Sequence[etree._Element]) -> None:
        one, other = (self._members(child) for child in held)
        if one is None or other is None:
            return
        names = one[1].flat(), other[1].flat()
        if len(names[0]) != len(names[1]):
            text = f"groups of {len(names[0])} and {len(names[1])} variables cannot be connected"
            self._reader.problem(element, text)
            return
        for first, second in zip(*names, strict=True):
            self._joined((one[0], first), (other[0], second), self._reader.where(element))

    def _join_function(
        self, element: etree._Element, held: Sequence[etree._Element], functions: Mapping[str, _Function]
    ) -> None:
        signal = next((child for child in held if child.get("function") is not None), None)
        variable = next((child for child in held if child is not signal), None)
        if signal is None or variable is None:
            return
        name, port = signal.get("function", ""), signal.get("name", "")
        function = functions.get(name)
        if function is None:
            self._reader.problem(signal, f'there is no function "{name}"; {near(name, functions)}')
            return
        ends: list[_End] | None = None
        if local_name(variable) == "Variable":
            end = self._end(variable)
            ends = None if end is None else [end]
        elif (members := self._members(variable)) is not None:
            ends = [(members[0], one) for one in members[1].flat()]
        if ends is None:
            return
        if len(ends) != function.dimension:
            text = f'"{name}" takes {function.dimension} variables, here are {len(ends)}'
            self._reader.problem(element, text)
            return
        if port == "out":
            function.targets.append((ends, self._reader.where(element)))
            return
        match = _SIGNAL.fullmatch(port)
        number = 0 if port == "in" and function.kind == "LinearTransformation" else None
        if match is not None and function.kind != "LinearTransformation":
            number = whole(match[1], 0, function.inputs - 1)
        if number is None:
            last = "in" if function.kind == "LinearTransformation" else f"in[0] to in[{function.inputs - 1}]"
            self._reader.problem(signal, f'"{name}" has no signal "{port}"; valid: {last}, out')
        elif number in function.sources:
            self._reader.problem(signal, f'"{port}" of "{name}" is connected twice')
        else:
            function.sources[number] = ends

    def _apply(self, function: _Function) -> None:
        """Adds the connections that a function represents; its unconnected inputs are 0."""
        for targets, where in function.targets:
            for i, target in enumerate(targets):
                for _, sources in sorted(function.sources.items()):
                    summed = len(function.sources) > 1
                    self._joined(sources[i], target, where, function.transformation, summed)

    def _with_ports(self, component: Component) -> Component:
        ports = tuple(self._ports.get(component.name, {}).values())
        return replace(component, connectors=ports)


def _group(element: etree._Element) -> _Group:
    variables = tuple(child.get("ref", "") for child in element if child.tag == _MODEL + "Variable")
    return _Group(variables, tuple(_group(child) for child in element if child.tag != _MODEL + "Variable"))

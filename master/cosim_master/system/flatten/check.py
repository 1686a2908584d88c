"""Compares a described system with its FMUs and flattens it: the result has all data for a run, with names resolved.

`check` raises every problem of every file, FMU, connection and parameter at once. Its result is plain data; no FMU is
loaded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

from lxml import etree

from cosim_master.diagnostics.errors import Finding, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import ANNOTATION, LOCAL, ONLY_ONCE, SILENT_CLOCK, UNIT_GAP, WIDE_ITEM
from cosim_master.diagnostics.names import near
from cosim_master.files.xml import line_of
from cosim_master.fmi.description.read import FmuDescription, Variable, describe
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.fmi.slaves.solvers import NAMES as SOLVERS
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.system.flatten.components import Part, assemble, measure
from cosim_master.system.flatten.flat import (
    Alias,
    CheckedSystem,
    ComponentInstance,
    FlatConnection,
    OwnedAnnotation,
    natural,
)
from cosim_master.system.flatten.init_order import Stage, exchange_order
from cosim_master.system.flatten.parameters import Bindings
from cosim_master.system.flatten.sizes import check_sizes
from cosim_master.system.flatten.wiring import Wiring
from cosim_master.system.reading.omsimulator import DEFAULT_STEP, OMSIMULATOR, Named
from cosim_master.system.reading.omsimulator import settings as settings_of_omsimulator
from cosim_master.system.reading.overrides import apart, hidden
from cosim_master.system.reading.ssp.ssd import FMU_TYPE, TABLE_TYPES
from cosim_master.system.reading.tables import describe_table
from cosim_master.system.structure import Annotation, Component, SignalDictionaryReference, System, SystemStructure

__all__ = ["ANNOTATION_TYPES", "check"]

STEPPING = "org.uav-cosim.stepping"
SOLVER = "org.uav-cosim.solver"
ANNOTATION_TYPES = (
    STEPPING,
    SOLVER,
    "org.uav-cosim.network",
    "org.uav-cosim.recording",
    "org.uav-cosim.master",
    "org.uav-cosim.verdict",
)
_NAMESPACE = "https://uav-cosim.org/ns/1"


def check(structure: SystemStructure, overrides: Mapping[str, str] | None = None) -> CheckedSystem:
    """Compares a system with its FMUs and flattens it.

    Args:
        structure: the result of `read_system`.
        overrides: start values by hierarchical name ("drone1.autopilot.WPNAV_SPEED") or pattern
            ("drone*.vehicle.mass"), and settings of radio and recording ("network.loss"), as text. They override all
            values in the files; of two values for the same variable, the later one takes precedence.

    Raises:
        SystemDescriptionError: all problems of the structure, its FMUs, connections and parameters.
    """
    return _Check(structure, overrides or {}).checked()


def _uninitialized(fmu: FmuDescription, name: str) -> bool:
    """Returns whether an output belongs to a Clock and has no value before its first tick (FMI 3.0.2, 2.2.8)."""
    return bool(fmu.variables[name].clocks) and name not in fmu.initial_unknowns


def _interface(fmu: FmuDescription) -> str:
    return "CoSimulation" if fmu.model_exchange is None else "ModelExchange"


def _positive(name: str, text: str | None) -> float | None:
    """Returns a number of <solver>, or None if the attribute is absent.

    Raises:
        ValueError: the text is not a positive number.
    """
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise ValueError(f'{name} "{text}" of <solver> must be a positive number')
    return value


class _Check:
    def __init__(self, structure: SystemStructure, overrides: Mapping[str, str]) -> None:
        self.structure = structure
        self.overrides, self.settings = apart(overrides, structure)
        self.problems: list[Problem] = list(structure.problems)
        self.notes: list[str] = list(structure.notes)
        self._implementations: set[str] = set()

    def checked(self) -> CheckedSystem:
        if not measure(self.structure.system, self.problems):
            raise SystemDescriptionError(dict.fromkeys(self.problems))
        fmus = self._described()
        root = assemble(self.structure.system, fmus, self.problems, self.notes, self._sized(fmus))
        parts = [part for part in root.walk() if isinstance(part.element, Component) and part.system is None]
        self._unique(parts)
        wiring = Wiring(root, self.problems)
        links, aliases = self._links(parts, wiring), self._aliases(root, wiring)
        bindings = Bindings(wiring, self.problems, self.notes)
        bindings.apply(root)
        bindings.override(self.overrides, hidden(self.structure))
        bindings.take_constants()
        check_sizes(wiring, bindings.values, self.problems)
        annotations = self._annotations(root)
        instances = self._instances(parts, bindings)
        order = self._initial_order(links, {instance.name: instance.fmu for instance in instances})
        self._assumptions(wiring, bindings, fmus, instances)
        self._silent_clocks(instances, links)
        self._wide_items(instances, links)
        if self.problems:
            raise SystemDescriptionError(dict.fromkeys(self.problems))
        return CheckedSystem(
            structure=self.structure,
            instances=instances,
            links=links,
            start_time=self.structure.start_time or 0.0,
            stop_time=self.structure.stop_time,
            init_order=order,
            aliases=aliases,
            annotations=annotations,
            unmatched=tuple(bindings.unmatched),
            notes=tuple(dict.fromkeys(self.notes)),
            assignments={key: tuple(made) for key, made in bindings.history.items()},
            settings=self.settings,
        )

    def _initial_order(
        self, links: tuple[FlatConnection, ...], fmus: Mapping[str, FmuDescription]
    ) -> tuple[Stage, ...]:
        """Returns the stages of `CheckedSystem.init_order`.

        In initialization mode, only local variables that are unknowns of this mode may be read (FMI 2.0.5, 4.2.4).
        """
        readable = []
        for index, link in enumerate(links):
            instance, name = link.source
            fmu = fmus.get(instance)
            if fmu is not None and (fmu.variables[name].clock is not None or _uninitialized(fmu, name)):
                continue
            if fmu is not None and fmu.variables[name].causality == "local" and name not in fmu.initial_unknowns:
                self.notes.append(f"{link.where}: {LOCAL.text(instance, name)}")
            else:
                readable.append(index)
        stages = exchange_order(
            [(links[index].source, links[index].target) for index in readable],
            fmus,
            self.notes,
        )
        return tuple(Stage(tuple(readable[index] for index in stage.links), stage.loop) for stage in stages)

    def _described(self) -> dict[Path, FmuDescription | None]:
        """Returns the description of every FMU file. A file is read once, however many components use it."""
        found: dict[Path, FmuDescription | None] = {}
        tables: dict[Path, list[Component]] = {}
        seen: set[int] = set()

        def visit(system: System) -> None:
            if id(system) in seen:
                return
            seen.add(id(system))
            for element in system.elements:
                if isinstance(element, System):
                    visit(element)
                elif isinstance(element, SignalDictionaryReference):
                    continue
                elif element.content is not None:
                    visit(element.content)
                elif element.source is not None:
                    if element.type != FMU_TYPE:
                        tables.setdefault(element.source, []).append(element)
                        continue
                    self._implementations.add(element.implementation)
                    self._implementations |= {one.type for one in element.annotations if one.type == OMSIMULATOR}
                    if element.source not in found:
                        found[element.source] = self._describe(element, element.source)

        visit(self.structure.system)
        for path, components in tables.items():
            found[path] = self._table(path, components)
        return found

    def _describe(self, component: Component, path: Path) -> FmuDescription | None:
        try:
            return describe(path)
        except SystemDescriptionError as error:
            for problem in error.problems:
                text = f'{problem.message} (source of component "{component.name}" at {component.where})'
                self.problems.append(Problem(problem.where, text))
            return None

    def _table(self, path: Path, components: list[Component]) -> FmuDescription | None:
        if any(one.type.partition(";")[0].strip() not in TABLE_TYPES for one in components):
            return None
        try:
            return describe_table(path, components)
        except SystemDescriptionError as error:
            self.problems += error.problems
            return None

    def _sized(self, fmus: Mapping[Path, FmuDescription | None]) -> dict[str, FmuDescription]:
        """Returns descriptions of parts with arrays resized by the system, or with an interface selected by it.

        Structural parameters determine the sizes of arrays. Each element of an array is a port, so the ports depend on
        these sizes. The values of structural parameters are therefore collected in a first pass over all bindings.
        Other problems found in this pass are found again later.
        """
        structural = (v.causality == "structuralParameter" for f in fmus.values() if f for v in f.variables.values())
        if self._implementations <= {"any"} and not any(structural):
            return {}
        root = assemble(self.structure.system, fmus, [], [])
        bindings = Bindings(Wiring(root, []), [], [])
        bindings.apply(root)
        bindings.override(self.overrides)
        bindings.take_constants()
        sized: dict[str, FmuDescription] = {}
        known: dict[tuple[Path, tuple[tuple[str, int], ...], str], FmuDescription | None] = {}
        for part in root.walk():
            if part.fmu is None:
                continue
            given = bindings.values.get(part.name, {})
            variables = part.fmu.variables.values()
            integers = [v for v in variables if v.causality == "structuralParameter" and v.type == "Integer"]
            sizes = {v.name: int(given[v.name]) for v in integers if given.get(v.name, v.start) != v.start}
            wanted = getattr(part.element, "implementation", "any")
            if wanted == "any" and (solver := self._named_by_omsimulator(part)) is not None and solver.solver:
                wanted = "ModelExchange"
            if not sizes and wanted in ("any", _interface(part.fmu)):
                continue
            key = (part.fmu.path, tuple(sorted(sizes.items())), wanted)
            if key not in known:
                known[key] = self._described_with(part, part.fmu, sizes, wanted)
            if (fmu := known[key]) is not None:
                sized[part.name] = fmu
        return sized

    def _described_with(
        self, part: Part, fmu: FmuDescription, sizes: Mapping[str, int], implementation: str
    ) -> FmuDescription | None:
        try:
            return describe(fmu.path, sizes, implementation)
        except SystemDescriptionError as error:
            shown = ", ".join(f"{name} = {value}" for name, value in sizes.items())
            for problem in error.problems:
                text = f"{part.name}: {f'with {shown}, ' if shown else ''}{problem.message} (in {fmu.path.name})"
                self.problems.append(Problem(part.element.where, text))
            return None

    def _unique(self, parts: list[Part]) -> None:
        """Gives components unique names; the standard allows equal names (SSP 2.0, section 5.2.3)."""
        first: dict[str, Part] = {}
        for part in parts:
            name, number = part.name, 1
            while part.name in first:
                number += 1
                part.name = f"{name}#{number}"
            if number > 1:
                other, where = first[name].element.where, part.element.where
                text = f'two components have the hierarchical name "{name}", the other at {other}'
                self.notes.append(
                    f'{where}: {text}; what is set by this name goes to both, results call it "{part.name}"'
                )
            first[part.name] = part

    def _links(self, parts: list[Part], wiring: Wiring) -> tuple[FlatConnection, ...]:
        links: list[FlatConnection] = []
        for part in parts:
            written: dict[tuple[str, int, int | None], str] = {}
            for port in part.ports.values():
                if port not in wiring.incoming or port.variable is None:
                    continue
                connection = wiring.incoming[port][0]
                key = (port.variable.type, port.variable.value_reference, port.variable.element)
                if key in written:
                    text = f'"{port}" and "{written[key]}" are the same variable of the FMU, and both are written'
                    self.problems.append(Problem(connection.where, text))
                written[key] = str(port)
                route = wiring.route(port)
                if route.source is None or port.variable.causality == "structuralParameter":
                    continue
                source = (route.source.part.name, route.source.name)
                initial_only = port.variable.causality == "parameter"
                mapping = tuple(sorted((key, value) for key, value in route.mapping.items() if key != value))
                ends = (source, (part.name, port.name))
                recoded = ""
                if {route.source.type, port.type} == {"String", "Binary"}:
                    recoded = "to bytes" if port.type == "Binary" else "to text"
                term = 0 if port in wiring.further else None
                links.append(
                    FlatConnection(
                        *ends, route.factor, route.offset, initial_only, connection.where, mapping, recoded, term
                    )
                )
                for number, (other, origin) in enumerate(wiring.further.get(port, ()), start=1):
                    route = wiring.hop(wiring.route(origin), other, port)
                    if route.source is not None:
                        source = (route.source.part.name, route.source.name)
                        links.append(
                            FlatConnection(source, ends[1], route.factor, route.offset, False, other.where, term=number)
                        )
        return tuple(sorted(links, key=lambda link: (natural(link.target[0]), natural(link.target[1]))))

    def _aliases(self, root: Part, wiring: Wiring) -> tuple[Alias, ...]:
        aliases = []
        for part in root.walk():
            if part.system is None:
                continue
            for port in part.ports.values():
                route = wiring.route(port)
                if route.source is not None:
                    name = f"{part.name}.{port.name}" if part.name else port.name
                    source = (route.source.part.name, route.source.name)
                    mapping = tuple(sorted(route.mapping.items()))
                    aliases.append(Alias(name, source, route.factor, route.offset, route.unit, mapping))
        return tuple(sorted(aliases, key=lambda alias: natural(alias.name)))

    def _annotations(self, root: Part) -> tuple[OwnedAnnotation, ...]:
        owned = [OwnedAnnotation("", annotation) for annotation in self.structure.annotations]
        for part in root.walk():
            found = part.element.annotations
            if part.system is not None and part.system is not part.element:
                found = (*found, *part.system.annotations)
            owned += [OwnedAnnotation(part.name, annotation) for annotation in found]
        for annotation in {id(item.annotation): item.annotation for item in owned}.values():
            if annotation.type in ANNOTATION_TYPES:
                continue
            if annotation.type.startswith("org.uav-cosim"):
                hint = near(annotation.type, ANNOTATION_TYPES)
                self.problems.append(Problem(annotation.where, f'there is no annotation "{annotation.type}"; {hint}'))
            elif annotation.type == OMSIMULATOR:
                self.notes += settings_of_omsimulator(annotation).notes
            else:
                self.notes.append(f"{annotation.where}: {ANNOTATION.text(annotation.type)}")
        return tuple(owned)

    def _instances(self, parts: list[Part], bindings: Bindings) -> tuple[ComponentInstance, ...]:
        instances: list[ComponentInstance] = []
        only_once: dict[str, str] = {}
        for part in sorted(parts, key=lambda item: natural(item.name)):
            step = self._step_size(part)
            if part.fmu is None:
                continue
            if part.fmu.capabilities.canBeInstantiatedOnlyOncePerProcess:
                other = only_once.setdefault(part.fmu.digest, part.name)
                if other != part.name:
                    text = ONLY_ONCE.text(part.fmu.path.name, other, part.name)
                    self.problems.append(Problem(part.element.where, text))
            values = bindings.values.get(part.name, {})
            size, source = (step, "system") if step else (part.fmu.step_size, "FMU" if part.fmu.step_size else "")
            solver = self._solver(part)
            instance = ComponentInstance(part.name, part.fmu, values, size, part.element.where, step_source=source)
            if part.fmu.model_exchange is not None:
                instance = instance.integrated(solver or Choice())
            instances.append(instance)
        return tuple(instances)

    def _step_size(self, part: Part) -> float | None:
        """Returns the communication step that the system sets for an FMU: our annotation's, or else OMSimulator's."""
        annotation = self._nearest(part, STEPPING)
        if annotation is not None:
            return self._stepping(annotation)
        if (solver := self._named_by_omsimulator(part)) is not None and not solver.solver and solver.step is not None:
            return solver.step
        annotation = self._nearest(part, OMSIMULATOR, lambda one: settings_of_omsimulator(one).step is not None)
        if annotation is not None:
            return settings_of_omsimulator(annotation).step
        theirs = (
            self.structure.generation_tool.startswith("OMSimulator") or self._nearest(part, OMSIMULATOR) is not None
        )
        if theirs and part.fmu is not None and part.fmu.step_size is None:
            text = f"neither system nor FMU names a step size: {DEFAULT_STEP:g} s are taken, as in OMSimulator"
            self.notes.append(f"{part.element.where}: {part.name}: {text}")
            return DEFAULT_STEP
        return None

    def _named_by_omsimulator(self, part: Part) -> Named | None:
        """Returns the solver that OMSimulator's annotation of a component names, as defined in a surrounding system."""
        own = (one for one in part.element.annotations if one.type == OMSIMULATOR)
        names = [settings_of_omsimulator(one).uses for one in own]
        if not names or (name := names[0]) is None:
            return None
        annotation = self._nearest(part, OMSIMULATOR, lambda one: name in settings_of_omsimulator(one).named)
        return None if annotation is None else settings_of_omsimulator(annotation).named[name]

    def _solver(self, part: Part) -> Choice | None:
        """Returns the solver that the system sets for an FMU for Model Exchange."""
        annotation = self._nearest(part, SOLVER)
        if annotation is None:
            if (named := self._named_by_omsimulator(part)) is not None and named.solver is not None:
                return Choice(named.solver, step=named.step, tolerance=named.tolerance)
            annotation = self._nearest(part, OMSIMULATOR, lambda one: settings_of_omsimulator(one).solver is not None)
            found = None if annotation is None else settings_of_omsimulator(annotation)
            if found is None or found.solver is None:
                return None
            return Choice(found.solver, step=found.solver_step, tolerance=found.tolerance)
        children = list(annotation.element)
        if len(children) != 1 or children[0].tag != f"{{{_NAMESPACE}}}solver":
            text = f'annotation {SOLVER} needs one element: <solver xmlns="{_NAMESPACE}" name="cvode"/>'
            self.problems.append(Problem(annotation.where, text))
            return None
        element, where = children[0], Where(annotation.where.path, line_of(children[0]))
        try:
            if unknown := sorted({*map(str, element.attrib)} - {"name", "step", "tolerance", "restart"}):
                valid = '"name", "step", "tolerance", "restart"'
                raise ValueError(f'<solver> has no attribute "{unknown[0]}"; valid: {valid}')
            numbers = {name: _positive(name, element.get(name)) for name in ("step", "tolerance")}
            if (name := element.get("name", "cvode")) not in SOLVERS:
                raise ValueError(f'there is no solver "{name}"; valid: {", ".join(SOLVERS)}')
            if (restart := element.get("restart", "false")) not in ("true", "false"):
                raise ValueError(f'restart "{restart}" of <solver>; valid: true, false')
        except ValueError as error:
            self.problems.append(Problem(where, str(error)))
            return None
        return Choice(name, **numbers, restart=restart == "true")

    def _nearest(self, part: Part, kind: str, fits: Callable[[Annotation], bool] = lambda _: True) -> Annotation | None:
        """Returns the nearest matching annotation of a type, on the part or on a surrounding system."""
        owner: Part | None = part
        while owner is not None:
            inner = owner.system.annotations if owner.system is not None else ()
            outer = owner.element.annotations if owner.element is not owner.system else ()
            top = self.structure.annotations if owner.parent is None else ()
            for annotation in (*inner, *outer, *top):
                if annotation.type == kind and fits(annotation):
                    return annotation
            owner = owner.parent
        return None

    def _stepping(self, annotation: Annotation) -> float | None:
        children = list(annotation.element)
        if len(children) != 1 or children[0].tag != f"{{{_NAMESPACE}}}stepping":
            text = f'annotation {STEPPING} needs one element: <stepping xmlns="{_NAMESPACE}" stepSize="0.01"/>'
            self.problems.append(Problem(annotation.where, text))
            return None
        stepping = children[0]
        where = Where(annotation.where.path, line_of(stepping))
        for attribute in map(str, stepping.attrib):
            if attribute != "stepSize":
                self.problems.append(Problem(where, f'<stepping> has no attribute "{attribute}"; valid: "stepSize"'))
        for child in stepping:
            text = f"<stepping> holds no <{etree.QName(child).localname}>"
            self.problems.append(Problem(where, text))
        try:
            step = float(stepping.get("stepSize", ""))
        except ValueError:
            step = math.nan
        if not 0.0 < step < math.inf:
            text = f'stepSize "{stepping.get("stepSize", "")}" of <stepping> must be a positive number of seconds'
            self.problems.append(Problem(where, text))
            return None
        return step

    def _silent_clocks(self, instances: tuple[ComponentInstance, ...], links: tuple[FlatConnection, ...]) -> None:
        """Notes triggered Clocks that no other Clock drives, which never tick. Time-based Clocks tick by themselves."""
        driven = {link.target for link in links}
        for instance in instances:
            for v in instance.fmu.variables.values():
                triggered = v.clock is not None and v.clock.kind == "triggered" and v.causality == "input"
                if triggered and (instance.name, v.name) not in driven:
                    self.notes.append(SILENT_CLOCK.text(instance.name, v.name))

    def _wide_items(self, instances: tuple[ComponentInstance, ...], links: tuple[FlatConnection, ...]) -> None:
        """Reports enumerations with values that the master cannot represent, if a connection could carry one."""
        low, high = INTEGER_RANGES["Integer"]
        wide: dict[Path, list[tuple[Variable, str, int]]] = {}
        for one in instances:
            if one.fmu.path not in wide:
                items = [(v, *item) for v in one.fmu.variables.values() if v.items for item in v.items.items()]
                wide[one.fmu.path] = [found for found in items if not low <= found[2] <= high]
        if not any(wide.values()):
            return
        used = {end for link in links for end in (link.source, link.target)}
        for one in instances:
            for v, item, value in wide[one.fmu.path]:
                if v.causality == "output" or v.name in one.start_values or (one.name, v.name) in used:
                    self.problems.append(Problem(one.where, WIDE_ITEM.text(one.name, v.name, item, value)))

    def _assumptions(
        self,
        wiring: Wiring,
        bindings: Bindings,
        fmus: Mapping[Path, FmuDescription | None],
        instances: tuple[ComponentInstance, ...],
    ) -> None:
        if self.structure.start_time is None:
            self.notes.append("the system names no start time: it starts at 0 s")
        if not instances:
            self.notes.append("the system has no components")
        for fmu in fmus.values():
            if fmu is not None:
                self.notes += [note if isinstance(note, Finding) else f"{fmu.path.name}: {note}" for note in fmu.notes]
        for item in bindings.unmatched:
            text = f'parameter "{item.name}" matches nothing and is ignored; {item.hint}'
            self.notes.append(Finding(item.where, text, "parameters that match nothing"))
        self.notes += wiring.findings
        if wiring.unit_gaps:
            where = wiring.unit_gaps[0].where
            count = len(wiring.unit_gaps)
            self.notes.append(UNIT_GAP.text(count, where))
        if wiring.truths:
            where, count = wiring.truths[0].where, len(wiring.truths)
            self.notes.append(f"{count} connections join a Boolean to a number: true is 1, false 0; the first: {where}")

"""Compares a described system with its FMUs and flattens it: the result has all data for a run, with names resolved.

`check` raises every problem of every file, FMU, connection and parameter at once. Its result is plain data; no FMU is
loaded.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path

from cosim_master.diagnostics.errors import Finding, Problem, SystemDescriptionError
from cosim_master.diagnostics.limitations import ANNOTATION, LOCAL, WIDE_ITEM
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.read import FmuDescription, Variable, describe, runner
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.system.flatten.component_settings import ISOLATION, SOLVER, STEPPING, ComponentSettings
from cosim_master.system.flatten.descriptions import Descriptions
from cosim_master.system.flatten.flat import (
    DEFAULT_STEP,
    Alias,
    CheckedSystem,
    ComponentInstance,
    FlatConnection,
    OwnedAnnotation,
    natural,
)
from cosim_master.system.flatten.init_order import Stage, exchange_order
from cosim_master.system.flatten.parameters import OPTION, Bindings
from cosim_master.system.flatten.topology.components import Part, Port, assemble, measure
from cosim_master.system.flatten.topology.sizes import check_sizes
from cosim_master.system.flatten.topology.wiring import Wiring
from cosim_master.system.reading.others.omsimulator import OMSIMULATOR
from cosim_master.system.reading.others.omsimulator import settings as settings_of_omsimulator
from cosim_master.system.reading.overrides import apart, hidden
from cosim_master.system.structure import Component, SystemStructure

__all__ = ["ANNOTATION_TYPES", "check"]

ANNOTATION_TYPES = (
    STEPPING,
    SOLVER,
    ISOLATION,
    "org.uav-cosim.network",
    "org.uav-cosim.recording",
    "org.uav-cosim.master",
    "org.uav-cosim.verdict",
    "org.uav-cosim.monitors",
)


def check(structure: SystemStructure, overrides: Mapping[str, str] | None = None) -> CheckedSystem:
    """Compares a system with its FMUs and flattens it.

    Args:
        structure: the result of `read_system`.
        overrides: start values by hierarchical name ("drone1.autopilot.WPNAV_SPEED") or pattern
            ("drone*.vehicle.mass"), and settings of radio, recording and master ("network.loss"), as text. They
            override all values in the files; of two values for the same variable, the later one takes precedence.

    Raises:
        SystemDescriptionError: all problems of the structure, its FMUs, connections and parameters.
    """
    return _Check(structure, overrides or {}).checked()


def _uninitialized(fmu: FmuDescription, name: str) -> bool:
    """Returns whether an output belongs to a Clock and has no value before its first tick (FMI 3.0.2, 2.2.8)."""
    return bool(fmu.variables[name].clocks) and name not in fmu.initial_unknowns


class _Check:
    def __init__(self, structure: SystemStructure, overrides: Mapping[str, str]) -> None:
        self.structure = structure
        self.overrides, self.settings = apart(overrides, structure)
        self.problems: list[Problem] = list(structure.problems)
        self.notes: list[str] = list(structure.notes)
        self._set = ComponentSettings(structure, self.problems, self.notes)

    def checked(self) -> CheckedSystem:
        if not measure(self.structure.system, self.problems):
            raise SystemDescriptionError(dict.fromkeys(self.problems))
        descriptions = Descriptions(self.structure, self.overrides, self._set, self.problems)
        fmus = descriptions.described()
        root = assemble(self.structure.system, fmus, self.problems, self.notes, descriptions.sized(fmus))
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
        self._set_and_driven(bindings, links)
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

    def _set_and_driven(self, bindings: Bindings, links: tuple[FlatConnection, ...]) -> None:
        """Notes values of --set for inputs that are connected: they hold until the first exchange of values."""
        driven = {link.target for link in links}
        for key, made in bindings.history.items():
            if key in driven and made[-1].where == OPTION:
                given = f"{'.'.join(key)}={made[-1].text}"
                self.notes.append(f"--set {given} holds before the first step only: the input is connected")

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
        links: dict[str, list[FlatConnection]] = {}
        for part in parts:
            own = links[part.name] = list[FlatConnection]()
            written: dict[tuple[str, int, int | None], Port] = {}
            for port in part.ports.values():
                variable = port.form.variable
                if variable is None or port not in wiring.incoming:
                    continue
                connection = wiring.incoming[port][0]
                key = (variable.type, variable.value_reference, variable.element)
                if key in written:
                    text = f'"{port}" and "{written[key]}" are the same variable of the FMU, and both are written'
                    self.problems.append(Problem(connection.where, text))
                written[key] = port
                if variable.causality == "structuralParameter":
                    continue
                if (link := _flat(part, port, wiring)) is not None:
                    own.append(link)
                if port in wiring.further:
                    own += _terms(part, port, wiring)
        names = {link.target[1] for own in links.values() for link in own}
        rank = {name: i for i, name in enumerate(sorted(names, key=natural))}
        for own in links.values():
            own.sort(key=lambda link: rank[link.target[1]])
        return tuple(chain.from_iterable(links[name] for name in sorted(links, key=natural)))

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
                    way = route.way
                    mapping = tuple(sorted(way.mapping.items()))
                    aliases.append(Alias(name, source, way.factor, way.offset, way.unit, mapping))
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
        alone = self.structure.path.suffix.lower() == ".fmu"
        for part in sorted(parts, key=lambda item: natural(item.name)):
            step = self._set.step_size(part)
            if part.fmu is None:
                continue
            values = bindings.values.get(part.name, {})
            size, source = (step, "system") if step else (part.fmu.step_size, "FMU" if part.fmu.step_size else "")
            if not size and part.fmu.table is None and not alone:
                size, source = DEFAULT_STEP, "default"
            solver = self._set.solver(part)
            process, restarts, command = self._set.process(part)
            instance = ComponentInstance(
                part.name,
                self._run_by(part, part.fmu, command),
                values,
                size,
                part.element.where,
                step_source=source,
                process=process,
                restarts=restarts,
            )
            if part.fmu.model_exchange is not None:
                instance = instance.integrated(solver or Choice())
            instances.append(instance)
        return tuple(instances)

    def _run_by(self, part: Part, fmu: FmuDescription, command: tuple[str, ...]) -> FmuDescription:
        """Returns an FMU with the command that runs it, if its binary is of Windows and this is not."""
        if sys.platform == "win32" or not fmu.library.endswith(".dll"):
            return fmu
        if not command and not runner():  # the system names one for other instances only
            try:
                describe(fmu.path)
            except SystemDescriptionError as error:
                place = f'(source of component "{part.element.name}" at {part.element.where})'
                self.problems += [Problem(one.where, f"{one.message} {place}") for one in error.problems]
        return replace(fmu, runner=command)

    def _silent_clocks(self, instances: tuple[ComponentInstance, ...], links: tuple[FlatConnection, ...]) -> None:
        """Notes triggered Clocks that no other Clock drives, which never tick. Time-based Clocks tick by themselves."""
        driven = {link.target for link in links}
        triggered: dict[int, list[Variable]] = {}
        for instance in instances:
            fmu = instance.fmu
            if id(fmu) not in triggered:
                clocks = (v for v in fmu.variables.values() if v.clock is not None and v.causality == "input")
                triggered[id(fmu)] = [v for v in clocks if v.clock is not None and v.clock.kind == "triggered"]
            for v in triggered[id(fmu)]:
                if (instance.name, v.name) not in driven:
                    text = "nothing is connected to this Clock: it never ticks"
                    self.notes.append(f"{instance.name}.{v.name}: {text}")

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
            where, count = wiring.unit_gaps[0].where, len(wiring.unit_gaps)
            text = f"{count} connections join a unit to a port without one, unconverted; the first: {where}"
            self.notes.append(text)
        if wiring.truths:
            where, count = wiring.truths[0].where, len(wiring.truths)
            self.notes.append(f"{count} connections join a Boolean to a number: true is 1, false 0; the first: {where}")


def _flat(part: Part, port: Port, wiring: Wiring) -> FlatConnection | None:
    """Returns the link to a port of an FMU, the first one if its value is a sum; None if nothing drives the port."""
    connection, route, form = wiring.incoming[port][0], wiring.route(port), port.form
    if route.source is None:
        return None
    way, origin = route.way, route.source.form
    recoded = ""
    if origin.type != form.type and {origin.type, form.type} == {"String", "Binary"}:
        recoded = "to bytes" if form.type == "Binary" else "to text"
    return FlatConnection(
        (route.source.part.name, origin.name),
        (part.name, form.name),
        way.factor,
        way.offset,
        form.variable is not None and form.variable.causality == "parameter",
        connection.where,
        tuple(sorted((key, value) for key, value in way.mapping.items() if key != value)) if way.mapping else (),
        recoded,
        0 if port in wiring.further else None,
    )


def _terms(part: Part, port: Port, wiring: Wiring) -> Iterator[FlatConnection]:
    """Yields the further links to a port whose value is a sum."""
    if wiring.route(port).source is None:
        return
    for number, (connection, origin) in enumerate(wiring.further[port], start=1):
        route = wiring.hop(wiring.route(origin), connection, port)
        if route.source is not None:
            ends = (route.source.part.name, route.source.form.name), (part.name, port.form.name)
            way = route.way
            yield FlatConnection(*ends, way.factor, way.offset, False, connection.where, term=number)

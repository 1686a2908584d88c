"""The descriptions of the FMUs of a system, with the sizes of arrays and the interfaces that the system chooses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.fmi.description.read import FmuDescription, describe
from cosim_master.system.flatten.component_settings import ComponentSettings
from cosim_master.system.flatten.parameters import Bindings
from cosim_master.system.flatten.topology.components import Part, assemble
from cosim_master.system.flatten.topology.wiring import Wiring
from cosim_master.system.reading.others.omsimulator import OMSIMULATOR
from cosim_master.system.reading.ssp.ssd import FMU_TYPE, TABLE_TYPES
from cosim_master.system.reading.tables import describe_table
from cosim_master.system.structure import Component, SignalDictionaryReference, System, SystemStructure

__all__ = ["Descriptions"]


class Descriptions:
    """Reads the FMUs of one system; adds to its problems.

    Args:
        overrides: start values by hierarchical name or pattern, as text.
        settings: of the components, which name solvers.
    """

    def __init__(
        self,
        structure: SystemStructure,
        overrides: Mapping[str, str],
        settings: ComponentSettings,
        problems: list[Problem],
    ) -> None:
        self._structure, self._overrides, self._set, self._problems = structure, overrides, settings, problems
        self._implementations: set[str] = set()
        self._runs = ""

    def described(self) -> dict[Path, FmuDescription | None]:
        """Returns the description of every FMU file. A file is read once, however many components use it."""
        found: dict[Path, FmuDescription | None] = {}
        tables: dict[Path, list[Component]] = {}
        seen: set[int] = set()
        self._runs = self._set.runs()

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

        visit(self._structure.system)
        for path, components in tables.items():
            found[path] = self._table(path, components)
        return found

    def _describe(self, component: Component, path: Path) -> FmuDescription | None:
        try:
            return describe(path, runs=self._runs)
        except SystemDescriptionError as error:
            for problem in error.problems:
                text = f'{problem.message} (source of component "{component.name}" at {component.where})'
                self._problems.append(Problem(problem.where, text))
            return None

    def _table(self, path: Path, components: list[Component]) -> FmuDescription | None:
        if any(one.type.partition(";")[0].strip() not in TABLE_TYPES for one in components):
            return None
        try:
            return describe_table(path, components)
        except SystemDescriptionError as error:
            self._problems += error.problems
            return None

    def sized(self, fmus: Mapping[Path, FmuDescription | None]) -> dict[str, FmuDescription]:
        """Returns descriptions of parts with arrays resized by the system, or with an interface selected by it.

        Structural parameters determine the sizes of arrays. Each element of an array is a port, so the ports depend on
        these sizes. The values of structural parameters are therefore collected in a first pass over all bindings.
        Other problems found in this pass are found again later.
        """
        structural = (v.causality == "structuralParameter" for f in fmus.values() if f for v in f.variables.values())
        if self._implementations <= {"any"} and not any(structural):
            return {}
        root = assemble(self._structure.system, fmus, [], [])
        bindings = Bindings(Wiring(root, []), [], [])
        bindings.apply(root)
        bindings.override(self._overrides)
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
            if wanted == "any" and (solver := self._set.named_by_omsimulator(part)) is not None and solver.solver:
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
            return describe(fmu.path, sizes, implementation, self._runs)
        except SystemDescriptionError as error:
            shown = ", ".join(f"{name} = {value}" for name, value in sizes.items())
            for problem in error.problems:
                text = f"{part.name}: {f'with {shown}, ' if shown else ''}{problem.message} (in {fmu.path.name})"
                self._problems.append(Problem(part.element.where, text))
            return None


def _interface(fmu: FmuDescription) -> str:
    return "CoSimulation" if fmu.model_exchange is None else "ModelExchange"

"""A checked system as plain data: instances, links between their variables, start values, with all names resolved.

`check` creates it; no FMU is loaded.
"""

from __future__ import annotations

import re
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from cosim_master.diagnostics.errors import FmuError, Where
from cosim_master.fmi.description.read import FmuDescription, Start
from cosim_master.fmi.description.units import Unit
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.system.flatten.init_order import Stage
from cosim_master.system.flatten.parameters import Assignment, Unmatched
from cosim_master.system.structure import Annotation, SystemStructure, Value

__all__ = [
    "DEFAULT_STEP",
    "PROCESSES",
    "Alias",
    "CheckedSystem",
    "ComponentInstance",
    "FlatConnection",
    "OwnedAnnotation",
    "natural",
]


DEFAULT_STEP = 1e-3
"""Communication step of FMUs for which neither system nor FMU names one, s: that of OMSimulator."""
PROCESSES = ("here", "file", "instance")
"""The process of an instance: that of the run, one with the other instances of its FMU file, or its own."""


@dataclass(frozen=True, slots=True)
class ComponentInstance:
    """The description of an FMU instance of a system.

    Attributes:
        name: hierarchical name ("drone1.vehicle"), unique.
        start_values: the values set by the system, in the FMU's units and types (enumerations as integers).
        step_size: communication step in s: the system's, or the FMU's own, or None.
        solver: solver of an FMU for Model Exchange, None for all others.
        step_source: the origin of the step size: "system", "FMU", or "default" where neither of them names one; empty
            without a step size.
        restarts: how often the system lets this process be started anew after a crash.
        process: the process in which the system has it run, a key of `PROCESSES`; empty if it leaves that to the run.
    """

    name: str
    fmu: FmuDescription
    start_values: Mapping[str, Value]
    step_size: float | None
    where: Where
    solver: Choice | None = None
    step_source: str = ""
    process: str = ""
    restarts: int = 0

    def integrated(self, solver: Choice) -> ComponentInstance:
        """Returns the same instance with a solver; the FMU's state is complete only if the solver has no memory."""
        able, exchange = self.fmu.capabilities, self.fmu.model_exchange
        if exchange is not None:
            saves, serialises = exchange.saves_state, exchange.serialises_state
            back = solver.can_go_back
            able = replace(able, canGetAndSetFMUstate=back and saves, canSerializeFMUstate=back and serialises)
        return replace(self, fmu=replace(self.fmu, capabilities=able), solver=solver)

    def structural_values(self) -> dict[str, Start]:
        """Returns the system's values of structural parameters of FMI 3."""
        variables = self.fmu.variables
        return {n: x for n, x in self.start_values.items() if variables[n].causality == "structuralParameter"}

    def clock_intervals(self) -> dict[str, float]:
        """Returns the system's intervals of Clocks, s."""
        variables = self.fmu.variables
        return {name: float(value) for name, value in self.start_values.items() if variables[name].clock is not None}

    def effective_values(self) -> dict[str, Start]:
        """Returns start values of all parameters and inputs: the system's value if it sets one, or the FMU's."""
        return {**self.fmu.defaults, **self.given_values()}

    def effective_value(self, name: str) -> Start | None:
        """Returns one of the effective values; None without it."""
        return self.given_values().get(name, self.fmu.defaults.get(name))

    def given_values(self) -> Mapping[str, Value]:
        """Returns those of the effective values that the system sets."""
        apart = self.fmu.apart
        return {n: x for n, x in self.start_values.items() if n not in apart} if apart else self.start_values


@dataclass(frozen=True, slots=True)
class FlatConnection:
    """A link from one variable to another: value_target = factor * mapped(value_source) + offset.

    Factor and offset combine the unit conversions and linear transformations of all connections between them; they are
    1 and 0 except for Reals. Mapping transformations are in `mapping`: (source value, target value) of Integers,
    Enumerations or Booleans, sorted; other values are unchanged.

    `initial_only` links end at a parameter: they are exchanged only during initialization. `recoded` links carry
    packets between an FMU of FMI 2 and one of FMI 3: "to bytes" or "to text" (base64); bytes are hexadecimal text in
    Python.

    If several links have the same target, its value is their sum, in the order of `term`; other links have no `term`.
    """

    source: tuple[str, str]
    target: tuple[str, str]
    factor: float
    offset: float
    initial_only: bool
    where: Where
    mapping: tuple[tuple[int, int], ...] = ()
    recoded: str = ""
    term: int | None = None

    def converted(self, value: Any) -> Any:
        """Returns the target's value for a value of the source.

        Raises:
            FmuError: packets of FMI 2 are not base64 text.
        """
        if self.recoded:
            if self.recoded == "to text":
                return b64encode(bytes.fromhex(value)).decode()
            try:
                return b64decode(value, validate=True).hex()
            except ValueError:
                text = f"its packet output {self.source[1]} is not base64 text"
                raise FmuError(self.source[0], "fmi2GetString", text) from None
        for key, mapped in self.mapping:
            if value == key:
                value = mapped
                break
        return value if self.factor == 1.0 and self.offset == 0.0 else self.factor * value + self.offset


@dataclass(frozen=True, slots=True)
class Alias:
    """A system connector as a signal: value = factor * mapped(source) + offset, in `unit`; see `FlatConnection`."""

    name: str
    source: tuple[str, str]
    factor: float
    offset: float
    unit: Unit | None
    mapping: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class OwnedAnnotation:
    """An annotation with the hierarchical name of its system or component; empty for the root."""

    owner: str
    annotation: Annotation


@dataclass(frozen=True, slots=True)
class CheckedSystem:
    """A system without known problems.

    Attributes:
        structure: the checked structure; keep it open as long as files of an .ssp are needed.
        instances: sorted by name, drone2 before drone10.
        links: sorted by target.
        start_time, stop_time: s; stop_time is None if the system does not specify it.
        init_order: stages of links. In initialization mode, get all sources of a stage, set its targets (repeatedly in
            a loop), and continue with the next stage.
        aliases: connectors of systems that are driven, sorted by name.
        annotations: all annotations, outer before inner.
        unmatched: parameters of bindings without a match, which are ignored.
        notes: assumptions and ignored contents, for the user.
        assignments: start values given to each variable (instance, name), in order of increasing precedence.
        settings: attributes of our annotations that the run overrides, as text, by tag and name.
    """

    structure: SystemStructure
    instances: tuple[ComponentInstance, ...]
    links: tuple[FlatConnection, ...]
    start_time: float
    stop_time: float | None
    init_order: tuple[Stage, ...]
    aliases: tuple[Alias, ...]
    annotations: tuple[OwnedAnnotation, ...]
    unmatched: tuple[Unmatched, ...]
    notes: tuple[str, ...]
    assignments: Mapping[tuple[str, str], tuple[Assignment, ...]] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def natural(name: str) -> tuple[tuple[str | int, ...], str]:
    """Returns a sort key that puts drone2 before drone10."""
    parts = re.split(r"([0-9]+)", name)
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts)), name

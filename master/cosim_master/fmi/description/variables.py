"""The description of an FMU as plain data, common to FMI 2 and FMI 3; `read` creates it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TypeAlias

from cosim.verdict import Verdict
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.interpolation import Table
from cosim_master.fmi.description.source_files import SourceFiles
from cosim_master.fmi.description.units import Unit

__all__ = ["INTEGER_RANGES", "Capabilities", "Clock", "FmuDescription", "ModelExchange", "Start", "Variable"]

Start: TypeAlias = float | int | bool | str
INTEGER_RANGES: Mapping[str, tuple[int, int]] = {
    "Integer": (-(2**31), 2**31 - 1),
    **{f"Int{width}": (-(2 ** (width - 1)), 2 ** (width - 1) - 1) for width in (8, 16, 32, 64)},
    **{f"UInt{width}": (0, 2**width - 1) for width in (8, 16, 32, 64)},
}
"""Types of whole numbers (SSP 2.0, section 4.5.1) and their ranges; Int32 is Integer."""
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True, slots=True)
class Clock:
    """The ticks of a Clock of FMI 3 as its FMU describes them (FMI 3.0.2, section 2.2.8).

    Attributes:
        kind: its intervalVariability: "constant", "fixed", "tunable" (periodic), "changing", "countdown" (these five
            are time-based), or "triggered".
        interval: interval of a periodic Clock, s; None if only the FMU provides it.
        shift: time from the start of the run to the first tick of a periodic Clock, s.
        supports_fraction: the FMU also supports times as fractions.
    """

    kind: str
    interval: Fraction | None = None
    shift: Fraction = Fraction(0)
    supports_fraction: bool = False


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of an FMU, with FMI's defaults filled in.

    Attributes:
        type: "Real", "Integer", "Boolean", "String", "Enumeration" or (in FMI 3) "Binary", "Clock".
        causality, variability, initial: the standard's words; `initial` is None for inputs and time.
        unit: of a Real, with its definition; without offset if the variable is a relative quantity.
        items: of an Enumeration, item name -> value.
        packet_capacity: bytes of MAVLink packets it can carry per step (base64 text in a String of FMI 2, bytes in a
            Binary of FMI 3), None for others.
        fmi_type: of FMI 3, the type of its functions ("Float32", "UInt8", ...); an Enumeration's is "Int64".
        element: its place in an array of FMI 3, counted from 0 in row-major order; None for scalars. All elements have
            the array's value reference.
        mime_type: of a Binary.
        clock: of a Clock.
        clocks: the Clocks it belongs to: it may be set and got only while one of them ticks.
    """

    name: str
    value_reference: int
    type: str
    causality: str
    variability: str
    initial: str | None
    unit: Unit | None = None
    start: Start | None = None
    minimum: float | None = None
    maximum: float | None = None
    items: Mapping[str, int] | None = None
    packet_capacity: int | None = None
    description: str = ""
    fmi_type: str = ""
    element: int | None = None
    mime_type: str | None = None
    clock: Clock | None = None
    clocks: tuple[str, ...] = ()

    @property
    def wide(self) -> bool:
        """True for integers that may need more than 32 bits; they occupy two places among integers."""
        return self.type == "Integer" and self.fmi_type in ("UInt32", "Int64", "UInt64")

    @property
    def settable(self) -> bool:
        """True if a start value may be set before initialization (FMI 2.0.5, 2.2.7); of a Clock, its interval."""
        if self.clock is not None:
            return self.clock.kind in ("fixed", "tunable") and self.clock.interval is not None
        if self.variability == "constant":
            return False
        return self.causality == "input" or self.initial in ("exact", "approx")

    @property
    def settled(self) -> bool:
        """True if its value does not change after initialization (variability: FMI 2.0.5, 2.2.7; FMI 3.0.2, 2.4.7)."""
        return self.variability in ("constant", "fixed")

    @property
    def by_event(self) -> bool:
        """True if it is an input that changes in Event Mode only, where its FMU uses it, and at no Clock (2.4.7)."""
        return self.causality == "input" and self.variability == "discrete" and not self.clocks

    def parsed(self, text: str) -> Start:
        """Returns a value written as text; for an enumeration, this is the item's name or number.

        Raises:
            ValueError: the text is not a value of this variable; the error names the valid ones.
        """
        value: Start
        if self.type == "String":
            return text
        text = text.strip()
        if self.type == "Boolean":
            if text.lower() not in _BOOLEANS:
                raise ValueError("valid: true or false")
            return _BOOLEANS[text.lower()]
        if self.type == "Enumeration" and self.items:
            known = {**self.items, **{str(value): value for value in self.items.values()}}
            if text not in known:
                raise ValueError(f"its enumeration has no such item; {near(text, self.items)}")
            return known[text]
        real = self.type in ("Real", "Clock")
        try:
            value = float(text) if real else int(text)
        except ValueError:
            raise ValueError("valid: a number" if real else "valid: an integer") from None
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        if not real:
            smallest, largest = INTEGER_RANGES.get(self.fmi_type, INTEGER_RANGES["Integer"])
            low, high = max(low, smallest), min(high, largest)
        if not low <= value <= high:
            raise ValueError(f"valid: {low:g} to {high:g}")
        return value


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Capability flags of the CoSimulation element, in the standard's spelling (FMI 2.0.5, 4.3.1; FMI 3.0.2, 4.4)."""

    needsExecutionTool: bool = False
    canHandleVariableCommunicationStepSize: bool = False
    canInterpolateInputs: bool = False
    maxOutputDerivativeOrder: int = 0
    canRunAsynchronuously: bool = False
    canBeInstantiatedOnlyOncePerProcess: bool = False
    canNotUseMemoryManagementFunctions: bool = False
    canGetAndSetFMUstate: bool = False
    canSerializeFMUstate: bool = False
    providesDirectionalDerivative: bool = False
    hasEventMode: bool = False
    mightReturnEarlyFromDoStep: bool = False
    providesIntermediateUpdate: bool = False


@dataclass(frozen=True, slots=True)
class ModelExchange:
    """The properties of an FMU for Model Exchange that a solver needs.

    Attributes:
        states, derivatives: value references of the continuous states and of their derivatives, scalars only.
        event_indicators: number of event indicators.
        completed_step: fmi2CompletedIntegratorStep must be called after each step of the solver.
        directional_derivatives: the FMU provides them.
        saves_state, serialises_state: the FMU's own capabilities; whether an instance has them depends on its solver.
    """

    states: tuple[int, ...]
    derivatives: tuple[int, ...]
    event_indicators: int
    completed_step: bool
    directional_derivatives: bool
    saves_state: bool = False
    serialises_state: bool = False


_REMEDY = (
    ' while CVODE integrates it, which remembers its last steps (take --solver rk4, --solver euler, or restart="true" '
    "in its solver annotation)"
)


@dataclass(frozen=True, slots=True)
class FmuDescription:
    """The description of one FMU file, as far as co-simulation needs it.

    Attributes:
        path: the .fmu, absolute.
        digest: SHA-256 of the file, hexadecimal.
        library: member of the archive that is loaded on this platform.
        variables: by name, in the order of the file.
        units: its unit definitions, by name.
        step_size: stepSize of the DefaultExperiment in s.
        outputs: direct feed-through: output -> the inputs it depends on; None means on all of them.
        initial_unknowns: dependencies of each unknown in Initialization Mode; None means on all knowns. An unknown that
            is missing here belongs to an FMU that does not declare it (see `notes`).
        notes: violations of the standard that do not prevent a run.
        generation_tool: the tool that wrote it, as stated.
        shapes: arrays of FMI 3 and their sizes; their elements are variables, "position[1]", "matrix[2,3]".
        terminals: of FMI 3, with the names of their member variables.
        start_time, stop_time, tolerance: of the DefaultExperiment; None if not specified.
        model_exchange: of an FMU that our solvers integrate; None for co-simulation.
        verdicts: meanings of variables and arrays, by name; of FMUs with our annotation.
        source_files: of an FMU that is compiled from its sources; None for those with a library.
        runner: the command that runs its binary, which is of Windows, if the system names one.
        table: of a component that is a CSV or Parquet file, whose columns are described as outputs; None for FMUs.
        defaults: the FMU's own start values of parameters and inputs that can be set before initialization, by name.
        apart: names of structural parameters and Clocks, which are not set as other start values are.
    """

    path: Path
    digest: str
    fmi_version: str
    model_name: str
    model_identifier: str
    guid: str
    description: str
    library: str
    variables: Mapping[str, Variable]
    units: Mapping[str, Unit]
    step_size: float | None
    capabilities: Capabilities
    outputs: Mapping[str, tuple[str, ...] | None]
    initial_unknowns: Mapping[str, tuple[str, ...] | None]
    notes: tuple[str, ...] = ()
    generation_tool: str = ""
    shapes: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    terminals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    start_time: float | None = None
    stop_time: float | None = None
    tolerance: float | None = None
    model_exchange: ModelExchange | None = None
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    source_files: SourceFiles | None = None
    runner: tuple[str, ...] = ()
    table: Table | None = None
    defaults: Mapping[str, Start] = field(init=False, repr=False, compare=False)
    apart: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # Once for each file: a thousand drones have a quarter of a million parameters.
        variables = self.variables.values()
        apart = frozenset(v.name for v in variables if v.causality == "structuralParameter" or v.clock is not None)
        object.__setattr__(self, "apart", apart)
        own = (v for v in variables if v.causality in ("parameter", "input") and v.name not in apart)
        object.__setattr__(self, "defaults", {v.name: v.start for v in own if v.start is not None and v.settable})

    def no_input_derivatives(self, name: str) -> str:
        """Returns the reason why derivatives of inputs of the instance `name` cannot be set; empty if they can."""
        if self.fmi_version.startswith("3."):
            return "FMI 3 has no derivatives of inputs"
        return "" if self.capabilities.canInterpolateInputs else f"canInterpolateInputs of {name} is false"

    def remedy(self, flag: str) -> str:
        """Returns the end of a message about a missing capability: the alternative, if only the solver lacks it."""
        exchange = self.model_exchange
        if exchange is None or getattr(self.capabilities, flag):
            return ""
        able = {"canGetAndSetFMUstate": exchange.saves_state, "canSerializeFMUstate": exchange.serialises_state}
        return _REMEDY if able.get(flag, False) else ""

"""A single FMU as a system, for runs of `X.fmu` alone.

The system has one component, named after the model in the FMU, and no connections: all outputs are signals, and all
parameters and inputs can be set. Start and stop time are those of the FMU's DefaultExperiment.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cosim_master.diagnostics.errors import Where
from cosim_master.diagnostics.names import matching
from cosim_master.fmi.description.read import describe
from cosim_master.system.reading.overrides import SETTINGS
from cosim_master.system.structure import Component, System, SystemStructure

__all__ = ["as_model_exchange", "full_names", "full_patterns", "output_interval", "read_fmu"]

_FMU_TYPE = "application/x-fmu-sharedlibrary"


def read_fmu(path: Path) -> SystemStructure:
    """Returns the system of one FMU.

    Raises:
        SystemDescriptionError: the FMU is invalid; all problems are reported at once.
    """
    fmu = describe(path)
    where, file = Where(str(path)), path.absolute()
    name = fmu.model_name or path.stem
    component = Component(
        name=name,
        type=_FMU_TYPE,
        source=file,
        implementation="any",
        connectors=(),
        parameter_bindings=(),
        annotations=(),
        where=where,
    )
    system = System(
        name=name,
        connectors=(),
        parameter_bindings=(),
        elements=(component,),
        connections=(),
        annotations=(),
        document=file.resolve(),
        where=where,
    )
    return SystemStructure(
        name=name,
        version="1.0",
        path=path,
        document=file.resolve(),
        system=system,
        where=where,
        start_time=fmu.start_time or 0.0,
        stop_time=fmu.stop_time,
    )


_MOST_STEPS = 50_000


def output_interval(span: float) -> float:
    """Returns a step [s] for an FMU that proposes none: 1, 2 or 5 times a power of ten, at most a 500th of `span`.

    If no such step divides the span into 500 to 50 000 steps (as from 1e-5 to 1e8 s), the span is divided into 500 or
    slightly more equal steps.
    """
    ticks = round(span * 1e9)
    if ticks < 500:
        return 1e-9
    candidates = (factor * 10**power for power in range(18, -1, -1) for factor in (5, 2, 1))
    fitting = (tick for tick in candidates if 500 * tick <= ticks <= _MOST_STEPS * tick and ticks % tick == 0)
    equal = (ticks // number for number in range(500, _MOST_STEPS) if ticks % number == 0)
    return next(fitting, next(equal, 1)) / 1e9


def as_model_exchange(structure: SystemStructure) -> SystemStructure:
    """Returns the system of one FMU with the FMU's interface for Model Exchange, whatever other interfaces it has."""
    if structure.path.suffix.lower() != ".fmu":
        return structure
    elements = tuple(
        replace(one, implementation="ModelExchange") if isinstance(one, Component) else one
        for one in structure.system.elements
    )
    return replace(structure, system=replace(structure.system, elements=elements))


def full_names(structure: SystemStructure, values: Mapping[str, str]) -> dict[str, str]:
    """Returns values by hierarchical name; for a system of one FMU, the given names may be names of variables.

    Settings of radio, recording and master keep their names; a variable with such a name must be preceded by the name
    of the model.
    """
    if structure.path.suffix.lower() != ".fmu":
        return dict(values)
    head = f"{structure.name}."
    kept = (head, *(f"{tag}." for tag in SETTINGS))
    return {name if name.startswith(kept) else head + name: value for name, value in values.items()}


def full_patterns(structure: SystemStructure, patterns: Sequence[str], variables: Iterable[str]) -> list[str]:
    """Returns patterns of hierarchical names; for a system of one FMU, they may be those of its variables.

    Args:
        variables: of the FMU; a pattern that matches one of their hierarchical names is kept.
    """
    if structure.path.suffix.lower() != ".fmu" or not patterns:
        return list(patterns)
    names = [f"{structure.name}.{name}" for name in variables]
    return [one if matching(one, names) else f"{structure.name}.{one}" for one in patterns]

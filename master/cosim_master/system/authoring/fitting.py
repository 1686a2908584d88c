"""Finds FMUs that fit each other by their declared values (`cosim.verdict.Values`): the autopilot for a vehicle.

An output that declares its values fits an input that accepts all of them. Where a part is replaced by one that does not
fit the others, `companions` finds the FMUs that do. FMUs without declarations fit everything.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from cosim.verdict import Values
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.fmi.description.read import FmuDescription, Start, describe, mentions
from cosim_master.system import shipped
from cosim_master.system.structure import Connector, System

__all__ = ["OWN", "companions", "having", "lacking", "misfits", "model_fmu", "models", "own_start"]

OWN = Path("fmus")
"""The folder in which FMUs of models are searched before those of this project; `uav-cosim build` writes to it."""


def model_fmu(name: str, folder: Path | None = OWN) -> Path | None:
    """Returns the FMU of the model with this name; None if there is no such model.

    Args:
        folder: the folder in which FMUs of models are searched before those of this project.
    """
    if folder is not None and name.isidentifier() and (own := folder / f"{name}.fmu").is_file():
        return own
    return shipped.fmu(name)


def models(folder: Path | None = OWN) -> list[str]:
    """Returns the names of the models that have been built, sorted."""
    folders = [shipped.fmus()] if folder is None else [folder, shipped.fmus()]
    return sorted({one.stem for some in folders for one in some.glob("*.fmu") if one.stem.isidentifier()})


def misfits(system: System, fmus: Mapping[str, FmuDescription]) -> Iterator[tuple[str, str, tuple[int, ...], str]]:
    """Yields the inputs of a system's components that do not accept their sources' values.

    Each is the component, its input, the values that it should accept, and the component that they come from.

    Args:
        fmus: FMUs by name of component; others are not considered.
    """
    for one in system.connections:
        ends = ((one.start_element, one.start_connector), (one.end_element, one.end_connector))
        for (source, output), (target, name) in (ends, ends[::-1]):
            if source is None or target is None or source not in fmus or target not in fmus:
                continue
            offered, accepted = fmus[source].verdicts.get(output), fmus[target].verdicts.get(name)
            if not isinstance(offered, Values) or not isinstance(accepted, Values):
                continue
            if fmus[source].variables[output].causality == "output" and not set(offered.values) <= set(accepted.values):
                yield target, name, offered.values, source


def lacking(fmu: FmuDescription, connectors: Sequence[Connector]) -> list[str]:
    """Returns the names of connectors that an FMU has no variable for."""
    return [one.name for one in connectors if one.name not in fmu.variables and one.name not in fmu.shapes]


def having(connectors: Sequence[Connector], folders: Iterable[Path]) -> list[str]:
    """Returns the names of the FMUs in some folders that have variables of the same kind for all these connectors."""
    found: dict[str, None] = {}
    of_arrays = {one.name.partition("[")[0]: one.name for one in connectors}.values()
    for file in (file for folder in folders for file in sorted(folder.glob("*.fmu"))):
        if file.stem.isidentifier():  # of several builds, the FMI 2 one
            with suppress(SystemDescriptionError):  # its own problem
                if not all(mentions(file, name) for name in of_arrays):
                    continue
                fmu = describe(file)
                known = (fmu.variables.get(one.name) for one in connectors)
                if all(v is not None and v.causality == one.kind for v, one in zip(known, connectors, strict=True)):
                    found[file.stem] = None
    return [*found]


def companions(
    system: System, fmus: Mapping[str, FmuDescription], given: Iterable[str], folders: Iterable[Path]
) -> dict[str, FmuDescription]:
    """Returns FMUs that have to replace components, by name, so that all fit the given ones.

    A component without an FMU that fits it stays as it is.

    Args:
        fmus: FMUs by name of component, those of `given` included.
        given: components that are not replaced.
        folders: folders in which FMUs are searched, in this order; then the shipped models, which are built if needed.
    """
    found: dict[str, FmuDescription] = {}
    kept = set(given)
    for target, name, values, source in misfits(system, fmus):
        if target not in kept and source in kept and target not in found:
            one = _fitting(name, set(values), set(fmus[target].variables), folders)
            if one is not None:
                found[target] = one
    return found


def _fitting(name: str, values: set[int], like: set[str], folders: Iterable[Path]) -> FmuDescription | None:
    """Returns the FMU that accepts these values at its input, and of several the most like the present one.

    FMUs that need no execution tool come first: a tool may be absent.
    """
    best: tuple[tuple[bool, int], FmuDescription] | None = None
    seen: set[str] = set()
    for folder in folders:
        for file in sorted(folder.glob("*.fmu")):
            if file.name in seen or not file.stem.isidentifier():  # of several builds, the FMI 2 one
                continue
            seen.add(file.name)
            try:
                if not mentions(file, name):
                    continue
                fmu = describe(file)
            except SystemDescriptionError:  # not an FMU of ours: its own problem
                continue
            accepted = fmu.verdicts.get(name)
            if (
                isinstance(accepted, Values)
                and values <= set(accepted.values)
                and fmu.variables[name].causality == "input"
            ):
                rank = not fmu.capabilities.needsExecutionTool, len(like & set(fmu.variables))
                if best is None or rank > best[0]:
                    best = rank, fmu
    if best is not None:
        return best[1]
    unbuilt = shipped.accepting(name, values)
    return None if unbuilt is None else describe(unbuilt)


def own_start(name: str, value: object, old: FmuDescription, new: FmuDescription) -> Start | None:
    """Returns the start value that an FMU declares itself, if `value` hides it and was meant for the FMU before it.

    That is so if the two declare different values: what both declare alike, a system sets for any of them.
    """
    if name not in old.variables or name not in new.variables:
        return None
    own = new.variables[name].start
    return own if own is not None and own != old.variables[name].start and own != value else None

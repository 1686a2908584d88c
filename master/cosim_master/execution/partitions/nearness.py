"""Parts of units that are near each other: a swarm whose packets have a reach is cut by the places of its bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cosim.verdict import Role
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.system.flatten.flat import CheckedSystem

__all__ = ["cut_by_places", "places_of"]

_Place = tuple[float, ...]


def places_of(checked: CheckedSystem, of_instance: Sequence[int]) -> dict[int, _Place]:
    """Returns where the bodies of units are at the start, NED, m: the mean of a unit that has several.

    Units without a body that declares its start position (`Role.START_POSITION`) are left out.

    Args:
        of_instance: the unit of each instance.
    """
    found: dict[int, list[_Place]] = {}
    for one, unit in zip(checked.instances, of_instance, strict=True):
        for name, role in one.fmu.verdicts.items():
            if role is Role.START_POSITION:
                values = one.effective_values()
                place = tuple(float(values[element]) for element in elements_of(name, one.fmu.variables))
                found.setdefault(unit, []).append(place)
    return {unit: tuple(np.mean(places, axis=0).tolist()) for unit, places in found.items()}


def cut_by_places(weight: Mapping[int, int], places: Mapping[int, _Place], parts: int) -> dict[int, int]:
    """Returns the part of each unit: halves across the longest side, of halves, about equally heavy.

    Args:
        weight: instances of each unit; there are at least as many units as parts.
        places: of units; those without one are where the units are on average.
    """
    mean = tuple(np.mean([*places.values()], axis=0).tolist())
    at = {unit: np.array(places.get(unit, mean)) for unit in weight}
    found: dict[int, int] = {}
    _cut([*weight], weight, at, 0, parts, found)
    return found


def _cut(
    units: list[int],
    weight: Mapping[int, int],
    at: Mapping[int, np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
    first: int,
    parts: int,
    found: dict[int, int],
) -> None:
    if parts == 1:
        found |= dict.fromkeys(units, first)
        return
    axis = int(np.ptp([at[unit] for unit in units], axis=0).argmax())
    order = sorted(units, key=lambda unit: (at[unit][axis], unit))
    few = parts // 2
    wanted = sum(weight[unit] for unit in units) * few / parts
    n = int(np.searchsorted(np.cumsum([weight[unit] for unit in order]), wanted - 1e-9)) + 1
    n = min(max(n, few), len(order) - (parts - few))
    _cut(order[:n], weight, at, first, few, found)
    _cut(order[n:], weight, at, first + few, parts - few, found)

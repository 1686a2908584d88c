"""Actual and desired positions of the vehicles of a run, at instants dense enough for smooth animation.

All vehicles share the instants: every n-th row of the recording, at most 50 per second, and at most a million positions
for all vehicles together. The page interpolates linearly between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.verdict import Role, Rotors
from cosim_master.results.reading.roles import UNKNOWN, Part, Player
from cosim_master.view.block import Array, Block

__all__ = ["Motion", "Moving", "moving"]

_PLACES = 1_000_000
_RATE = 50.0


@dataclass(slots=True)
class Moving:
    """A vehicle and its columns.

    Attributes:
        part: its instances.
        rotors: forward, right, down [m] and direction of each rotor; None if they are not declared.
        columns: names of the columns of "position" (3), "attitude" (4), "speed" (one per rotor), "desired" (3) and
            "goal" (desired position and step of the agent), as far as they are recorded.
        values: the values of these columns, taken one after the other.
        stays: the agent does not move.
    """

    part: Part
    rotors: list[tuple[float, ...]] | None
    columns: dict[str, list[str]]
    values: dict[str, list[Array]] = field(default_factory=dict)
    stays: bool = False


def moving(parts: Sequence[Part], known: Mapping[str, Player], columns: Mapping[str, Any]) -> list[Moving]:
    """Returns the vehicles among the drones, with the names of their columns."""
    beside = _desired_beside(known)
    return [_moving(part, known, columns, beside) for part in parts if part.vehicle]


class Motion:
    """Collects the columns of the vehicles: `take` them one after the other, then read the `document`.

    Args:
        parts: the drones.
        known: the instances in the manifest.
        columns: names of all recorded columns.
        time: times of the rows, s.
    """

    def __init__(
        self, parts: Sequence[Part], known: Mapping[str, Player], columns: Mapping[str, Any], time: Array
    ) -> None:
        self._vehicles = moving(parts, known, columns)
        self.rows = _instants(time, len(self._vehicles))
        self._wanted: dict[str, list[tuple[Moving, str, int]]] = {}
        for vehicle in self._vehicles:
            for what, names in vehicle.columns.items():
                vehicle.values[what] = [np.empty(0)] * len(names)
                for k, name in enumerate(names):
                    self._wanted.setdefault(name, []).append((vehicle, what, k))
        self._steps: dict[bool, Array] = {}
        self._step_columns = _step_columns(parts, known, columns)

    @property
    def names(self) -> list[str]:
        return [vehicle.part.name for vehicle in self._vehicles]

    @property
    def parts(self) -> list[Part]:
        return [vehicle.part for vehicle in self._vehicles]

    def take(self, name: str, values: Array) -> None:
        """Keeps the displayed instants of a recorded column, if it belongs to a vehicle."""
        for vehicle, what, k in self._wanted.get(name, ()):
            vehicle.values[what][k] = values[self.rows].astype(np.float64)
        if name in self._step_columns:
            mobile = self._step_columns[name]
            so_far = self._steps.get(mobile)
            self._steps[mobile] = values.astype(np.int64) if so_far is None else np.maximum(so_far, values)

    def steps(self, time: Array) -> list[tuple[int, float]]:
        """Returns number and start of each step of the agents' algorithm; the first mobile agent begins them."""
        begun = self._steps.get(True, self._steps.get(False))
        if begun is None or not len(begun):
            return []
        numbers, first = np.unique(np.maximum.accumulate(begun), return_index=True)
        return [(int(n), float(time[i])) for n, i in zip(numbers, first, strict=True) if n > 0]

    def document(self, block: Block) -> list[dict[str, Any]]:
        """Returns the document of the vehicles for the page; the numbers are in the block."""
        return [_document(vehicle, block) for vehicle in self._vehicles]


def _instants(time: Array, vehicles: int) -> Array:
    """Returns the rows at which the vehicles are shown, including the last row."""
    n = len(time)
    if n == 0 or vehicles == 0:
        return np.empty(0, np.int64)
    span = float(time[-1] - time[0])
    most = min(max(2, _PLACES // vehicles), max(2, int(span * _RATE * 1.001) + 1))
    every = max(1, -(-(n - 1) // (most - 1)))
    return np.unique(np.append(np.arange(0, n, every), n - 1))


def _moving(part: Part, known: Mapping[str, Player], columns: Mapping[str, Any], beside: Mapping[str, str]) -> Moving:
    player = known.get(part.vehicle, UNKNOWN)
    wanted = {"position": [f"{part.vehicle}.{player.position}[{i}]" for i in (1, 2, 3)]}
    wanted["attitude"] = [f"{part.vehicle}.{player.attitude}[{i}]" for i in (1, 2, 3, 4)]
    rotors = None
    if player.rotors is not None:
        name, declared = player.rotors
        rotors = _hubs(declared, player.parameters)
        if rotors:
            wanted["speed"] = [
                column for i in range(len(rotors)) if (column := f"{part.vehicle}.{name}[{i + 1}]") in columns
            ]
    desired = beside.get(part.vehicle.rpartition(".")[0], "")
    wanted["desired"] = [f"{desired}[{i}]" for i in (1, 2, 3)]
    stays = False
    if part.agent:
        agent = known.get(part.agent, UNKNOWN)
        target, formation = agent.target
        stays = bool(agent.parameters.get(formation.stays, False))
        wanted["goal"] = [f"{part.agent}.{target}", f"{part.agent}.{formation.step}"]
    complete = {what: names for what, names in wanted.items() if names and all(name in columns for name in names)}
    return Moving(part, rotors, complete, stays=stays)


def _hubs(declared: Rotors, parameters: Mapping[str, Any]) -> list[tuple[float, ...]] | None:
    """Returns (forward, right, down, direction) of each rotor; None if the manifest lacks a finite number."""
    try:
        count = int(parameters[declared.count])
        hubs = [tuple(float(parameters[f"{name}[{i + 1}]"]) for name in declared.arrays) for i in range(count)]
    except (KeyError, TypeError, ValueError):
        return None
    return hubs if np.isfinite(hubs).all() else None


def _desired_beside(known: Mapping[str, Player]) -> dict[str, str]:
    """Returns the desired position of the vehicle of each system in which exactly one instance declares it."""
    found: dict[str, list[str]] = {}
    for name, player in known.items():
        if variable := player.named(Role.DESIRED_POSITION):
            found.setdefault(name.rpartition(".")[0], []).append(f"{name}.{variable}")
    return {place: names[0] for place, names in found.items() if len(names) == 1}


def _step_columns(parts: Sequence[Part], known: Mapping[str, Player], columns: Mapping[str, Any]) -> dict[str, bool]:
    """Returns the columns with the number of an agent's step, and whether the agent moves."""
    found = {}
    for part in parts:
        if part.agent:
            agent = known.get(part.agent, UNKNOWN)
            formation = agent.target[1]
            name = f"{part.agent}.{formation.step}"
            if name in columns:
                found[name] = not agent.parameters.get(formation.stays, False)
    return found


def _document(vehicle: Moving, block: Block) -> dict[str, Any]:
    told: dict[str, Any] = {"name": vehicle.part.name, "rotors": vehicle.rotors, "stays": vehicle.stays, "origin": {}}
    values = vehicle.values

    def place(what: str, columns: Sequence[Array]) -> None:
        origin = [float(np.round(np.nanmean(column))) if np.isfinite(column).any() else 0.0 for column in columns]
        told["origin"][what] = origin
        told[what] = block.add(np.concatenate([c - o for c, o in zip(columns, origin, strict=True)]), "f4")

    place("position", values["position"])
    if "desired" in values:
        place("desired", values["desired"])
    if "goal" in values:
        target, step = values["goal"]
        place("goal", [np.where(step > 0, target, np.nan)])
    if "attitude" in values:
        quaternion = np.stack(values["attitude"])
        length = np.linalg.norm(quaternion, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = np.where((length > 0) & np.isfinite(length), quaternion / length, [[1.0], [0.0], [0.0], [0.0]])
        told["attitude"] = block.add(np.round(unit * 32767), "i2")
    if "speed" in values:
        mean = np.abs(np.mean(values["speed"], axis=0))
        top = float(np.nanmax(mean, initial=0.0))
        told["speed"] = block.add(np.nan_to_num(np.round(mean / top * 255)) if top > 0 else mean * 0, "u1")
    return told

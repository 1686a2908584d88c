"""What a recording tells of drones: where they were and should have been, when steps began, what law they follow.

A drone is a component that outputs `position[1..3]` in m, NED (see `cosim.vehicle`), and the agent beside it in the
same system, a component that outputs `step` and `target` (m east of the origin); or either of them alone. Step #k
begins when the first mobile agent begins it; its set-points are reached, by and by, until step #k+1 begins.

Numbers only: `figures` draws them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export import open_signals

__all__ = ["Array", "Drone", "Flight", "read_flight"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

_LINE_AGENT = "LineAgent"
"""The model whose law is known here; other agents may have parameters of the same names and mean something else."""
_ROWS = 5000
"""Instants kept: far more than a figure has dots."""


@dataclass(frozen=True, slots=True)
class Drone:
    """What was recorded of one drone, at the instants of its `Flight`; what was not is None.

    Attributes:
        name: of the system that holds vehicle and agent, or of the component if it is alone.
        position: (n, 3) m, NED.
        target: (n,) desired position, m east of the origin; NaN before the agent's first step.
        law: parameters of the agent; empty without agent.
        on_line: whether its agent follows the law of `Flight.law`, as that of the model LineAgent does.
    """

    name: str
    position: Array | None
    target: Array | None
    law: Mapping[str, Any]
    on_line: bool = False

    @property
    def mobile(self) -> bool:
        """Whether it has an agent that is not told to stay."""
        return self.target is not None and not self.law.get("stubborn", False)


@dataclass(frozen=True)
class Flight:
    """What the figures are drawn from.

    Attributes:
        time: (n,) s, recorded instants, thinned out to a few thousand.
        drones: in natural order of their names, drone2 before drone10.
        steps: time in s at which each step begins, by its number; empty without agents.
    """

    time: Array
    drones: tuple[Drone, ...]
    steps: Mapping[int, float]

    def row(self, time: float) -> int:
        """Index of the last instant up to `time` [s]."""
        return max(0, int(np.searchsorted(self.time, time, side="right")) - 1)

    @cached_property
    def law(self) -> tuple[Mapping[str, float], float] | None:
        """Fixed point of the mobile drones [m east], and by what factor a step shrinks the error's 2-norm at least.

        x(k+1) = x(k) - diag(epsilon) L x(k), L the graph's Laplacian with the rows of stubborn drones zeroed; their
        desired positions at the end are the boundary values. None if an agent follows another law, a drone's
        neighbours or parameters are not recorded, or no stubborn drone fixes the solution.
        """
        if any(drone.target is not None and not drone.on_line for drone in self.drones):
            return None
        needed = {"sysid", "left_sysid", "right_sysid", "epsilon", "stubborn"}
        drones = [drone for drone in self.drones if drone.target is not None and needed <= drone.law.keys()]
        index = {int(drone.law["sysid"]): i for i, drone in enumerate(drones)}
        free = [i for i, drone in enumerate(drones) if drone.mobile]
        fixed = [i for i, drone in enumerate(drones) if not drone.mobile]
        laplacian = np.zeros((len(drones), len(drones)))
        for i in free:
            for side in ("left_sysid", "right_sysid"):
                neighbour = int(drones[i].law[side])
                if neighbour not in index and neighbour != 0:
                    return None
                if neighbour != 0:
                    laplacian[i, i] += 1.0
                    laplacian[i, index[neighbour]] -= 1.0
        ends = np.array([drone.target[-1] for drone in drones if drone.target is not None])
        grounded = laplacian[np.ix_(free, free)]
        if not free or np.linalg.matrix_rank(grounded) < len(free) or not np.isfinite(ends).all():
            return None
        point = np.linalg.solve(grounded, -laplacian[np.ix_(free, fixed)] @ ends[fixed])
        gain = np.diag([float(drones[i].law["epsilon"]) for i in free])
        rate = float(np.linalg.norm(np.eye(len(free)) - gain @ grounded, 2))
        return {drones[i].name: float(x) for i, x in zip(free, point, strict=True)}, rate


def read_flight(run: Path) -> Flight:
    """Find the drones in the signals of a run folder and read what the figures need.

    Raises:
        CosimError: the run is not complete, or there is nothing to draw.
    """
    with open_signals(run) as signals:
        instances, models = _instances(run / "manifest.json")
        numeric = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in signals.schema_arrow}
        parts = _parts(numeric)
        if not parts:
            raise CosimError(
                f"{run / 'signals.parquet'}: nothing to draw: no component has position[1..3] in m, "
                f"or step and target (m); recorded are {len(numeric) - 1} other signals "
                "(`uav-cosim run --record` chooses which)"
            )
        n = signals.metadata.num_rows
        if n == 0:
            raise CosimError(f"{run / 'signals.parquet'}: nothing to draw: the run recorded no instant")
        rows = np.unique(np.linspace(0, n - 1, min(n, _ROWS)).round().astype(np.int64))

        def column(name: str) -> Array:
            values: Array = signals.read(columns=[name]).column(0).to_numpy()
            return values

        time = column("time")
        drones, begun = [], {True: np.zeros(n, np.int64), False: np.zeros(n, np.int64)}
        for name, vehicle, agent in parts:
            position = target = None
            law: Mapping[str, Any] = {}
            if vehicle:
                position = np.stack([column(f"{vehicle}.position[{i}]")[rows] for i in (1, 2, 3)], axis=1)
            if agent:
                law = instances.get(agent, {}).get("parameters", {})
                step = column(f"{agent}.step")
                target = np.where(step > 0, column(f"{agent}.target"), np.nan)[rows]
            drone = Drone(name, position, target, law, on_line=models.get(agent) == _LINE_AGENT)
            if agent:
                np.maximum(begun[drone.mobile], step.astype(np.int64), out=begun[drone.mobile])
            drones.append(drone)
    begun_by = begun[True] if any(drone.mobile for drone in drones) else begun[False]
    numbers, first = np.unique(np.maximum.accumulate(begun_by), return_index=True)
    steps = {int(k): float(time[i]) for k, i in zip(numbers, first, strict=True) if k > 0}
    return Flight(time[rows], tuple(drones), steps)


def _instances(manifest: Path) -> tuple[Mapping[str, Any], Mapping[str, str]]:
    """What a manifest tells of each instance, and the name of its model."""
    try:
        told = json.loads(manifest.read_text(encoding="utf-8"))
        instances: Mapping[str, Any] = told["instances"]
        fmus = told.get("fmus", {})
        models = {name: fmus.get(one.get("fmu"), {}).get("model", "") for name, one in instances.items()}
    except (OSError, ValueError, KeyError) as error:
        raise CosimError(f"{manifest}: not the manifest of a complete run: {error!r}") from None
    return instances, models


def _parts(columns: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """(name of the drone, its vehicle, its agent) in natural order; "" for what is not there."""
    vehicles = _components(columns, {"position[1]": "m", "position[2]": "m", "position[3]": "m"})
    agents = _components(columns, {"step": None, "target": "m"})
    found = {}
    for place in {component.rpartition(".")[0] for component in vehicles | agents}:
        here = [sorted(c for c in group if c.rpartition(".")[0] == place) for group in (vehicles, agents)]
        if place and max(map(len, here)) == 1:
            found[place] = ("".join(here[0]), "".join(here[1]))
        else:
            found |= {vehicle: (vehicle, "") for vehicle in here[0]}
            for agent in here[1]:
                found[agent] = (found.get(agent, ("", ""))[0], agent)
    return [(name, *found[name]) for name in sorted(found, key=_natural)]


def _components(columns: Mapping[str, str], variables: Mapping[str, str | None]) -> set[str]:
    """Components that have all the variables, in the unit given."""
    sets = [
        {
            name.removesuffix(f".{variable}")
            for name, u in columns.items()
            if name.endswith(f".{variable}") and unit in (None, u)
        }
        for variable, unit in variables.items()
    ]
    return set.intersection(*sets)


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key in which drone2 comes before drone10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]

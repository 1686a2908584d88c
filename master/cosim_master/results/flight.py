"""The drones of a recording: actual and desired positions, begins of steps, and the law that they follow.

A drone is a component that outputs its position (m, NED), and the agent beside it in the same system, a component that
outputs the number of its step and its desired position (m east of the origin); or either of them alone. Which outputs
these are, and what law an agent follows, the FMUs declare (`cosim.verdict`), and the manifest of the run has it. An FMU
that declares nothing is known by the names of its outputs (`cosim.vehicle`), and its law is not known. Step #k begins
when the first mobile agent begins it; its set-points are reached, by and by, until step #k+1 begins.

Numbers only: `figures` draws them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim.vehicle import POSITION, STEP, TARGET
from cosim.verdict import Formation, Role, Verdict
from cosim_master.diagnostics.errors import CosimError
from cosim_master.fmi.description.declarations import verdicts_of_json
from cosim_master.results.export import open_signals
from cosim_master.system.formation import Member, formation_of, member, rate, settled

__all__ = ["Array", "Drone", "Flight", "read_flight"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

_ROWS = 5000
"""Instants kept: far more than a figure has dots."""


@dataclass(frozen=True, slots=True)
class Drone:
    """The recorded values of one drone, at the instants of its `Flight`; None for values that were not recorded.

    Attributes:
        name: of the system that holds vehicle and agent, or of the component if it is alone.
        position: (n, 3) m, NED.
        target: (n,) desired position, m east of the origin; NaN before the agent's first step.
        stays: whether its agent is told to stay where it is.
        member: its agent with its neighbours, if the law of the agent is known.
    """

    name: str
    position: Array | None
    target: Array | None
    stays: bool = False
    member: Member | None = None

    @property
    def mobile(self) -> bool:
        """True if the drone has an agent that may move."""
        return self.target is not None and not self.stays


@dataclass(frozen=True)
class Flight:
    """The data that figures are drawn from.

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

        The desired positions at the end of drones that stay are the boundary values. None if the law of an agent is not
        known, a drone's neighbours or parameters are not recorded, or no drone that stays fixes the solution.
        """
        agents = {drone.name: (drone.member, drone.target) for drone in self.drones if drone.target is not None}
        members = [one for one, _ in agents.values() if one is not None]
        if len(members) < len(agents):
            return None
        held = {one.id: float(target[-1]) for one, target in agents.values() if one is not None and one.stays}
        point = settled(members, held)
        if point is None:
            return None
        mobile = {name: one.id for name, (one, _) in agents.items() if one is not None and not one.stays}
        return {name: point[number] for name, number in mobile.items()}, rate(members)


@dataclass(frozen=True, slots=True)
class _Instance:
    """The instance in the manifest: parameter values, and the meanings that its FMU declares."""

    parameters: Mapping[str, Any]
    verdicts: Mapping[str, Verdict]

    @property
    def position(self) -> str:
        return next((name for name, one in self.verdicts.items() if one is Role.POSITION), POSITION)

    @property
    def target(self) -> tuple[str, Formation]:
        return formation_of(self.verdicts) or (TARGET, Formation(step=STEP))


_UNKNOWN = _Instance({}, {})


def read_flight(run: Path) -> Flight:
    """Finds the drones in the signals of a run folder and reads the data for figures.

    Raises:
        CosimError: the run is not complete, or there is nothing to draw.
    """
    with open_signals(run) as signals:
        instances = _instances(run / "manifest.json")
        numeric = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in signals.schema_arrow}
        parts = _parts(numeric, instances)
        if not parts:
            raise CosimError(
                f"{run / 'signals.parquet'}: nothing to draw: no component has {POSITION}[1..3] in m, "
                f"or {STEP} and {TARGET} (m); recorded are {len(numeric) - 1} other signals "
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
            drone = Drone(name, None, None)
            if vehicle:
                position = instances.get(vehicle, _UNKNOWN).position
                axes = [column(f"{vehicle}.{position}[{i}]")[rows] for i in (1, 2, 3)]
                drone = replace(drone, position=np.stack(axes, axis=1))
            if agent:
                of = instances.get(agent, _UNKNOWN)
                target, formation = of.target
                step = column(f"{agent}.{formation.step}")
                drone = replace(
                    drone,
                    target=np.where(step > 0, column(f"{agent}.{target}"), np.nan)[rows],
                    stays=bool(of.parameters.get(formation.stays, False)),
                    member=member(of.verdicts, of.parameters),
                )
                np.maximum(begun[drone.mobile], step.astype(np.int64), out=begun[drone.mobile])
            drones.append(drone)
    begun_by = begun[True] if any(drone.mobile for drone in drones) else begun[False]
    numbers, first = np.unique(np.maximum.accumulate(begun_by), return_index=True)
    steps = {int(k): float(time[i]) for k, i in zip(numbers, first, strict=True) if k > 0}
    return Flight(time[rows], tuple(drones), steps)


def _instances(manifest: Path) -> Mapping[str, _Instance]:
    """Returns the instances of a manifest."""
    try:
        told = json.loads(manifest.read_text(encoding="utf-8"))
        fmus = {path: verdicts_of_json(fmu.get("verdicts", {})) for path, fmu in told.get("fmus", {}).items()}
        return {
            name: _Instance(one.get("parameters", {}), fmus.get(one.get("fmu"), {}))
            for name, one in told["instances"].items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CosimError(f"{manifest}: not the manifest of a complete run: {error!r}") from None


def _parts(columns: Mapping[str, str], instances: Mapping[str, _Instance]) -> list[tuple[str, str, str]]:
    """Returns (drone's name, vehicle, agent) in natural order; "" for a missing part."""
    vehicles: set[str] = set()
    agents: set[str] = set()
    for name in {component for column in columns if (component := column.rpartition(".")[0])}:
        of = instances.get(name, _UNKNOWN)
        if all(columns.get(f"{name}.{of.position}[{i}]") == "m" for i in (1, 2, 3)):
            vehicles.add(name)
        target, formation = of.target
        if f"{name}.{formation.step}" in columns and columns.get(f"{name}.{target}") == "m":
            agents.add(name)
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


def _natural(name: str) -> list[tuple[int, str]]:
    """Returns a sort key in which drone2 comes before drone10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]

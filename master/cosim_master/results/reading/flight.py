"""The drones of a recording: actual and desired positions, starts of steps, and the law that they follow.

`roles` assigns outputs to drones. Step #k begins when the first mobile agent begins it; its set-points are reached
gradually, until step #k+1 begins.

This module only computes numbers; `figures` draws them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim.naming import POSITION, STEP, TARGET
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.reading.recorded_signals import Signals, open_signals
from cosim_master.results.reading.roles import UNKNOWN, Part, Player, parts, players, read_manifest
from cosim_master.results.storage.arrays import values_of
from cosim_master.system.formation import Member, member, rate, settled

__all__ = ["Array", "Drone", "Flight", "read_flight"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

_ROWS = 5000
"""Instants kept: far more than a figure can resolve."""
_AT_ONCE = 256
"""Columns read at once."""


@dataclass(frozen=True, slots=True)
class Drone:
    """The recorded values of one drone, at the instants of its `Flight`; None for values that were not recorded.

    Attributes:
        name: of the system that contains vehicle and agent, or of the component if it is alone.
        position: (n, 3) m, NED.
        target: (n,) desired position, m east of the origin; NaN before the agent's first step.
        stays: whether its agent is stationary.
        member: its agent with its neighbours, if the law of the agent is known.
        errors: final, largest and root mean square distance between actual and desired position east, m, of all
            recorded instants since the agent's first step.
    """

    name: str
    position: Array | None
    target: Array | None
    stays: bool = False
    member: Member | None = None
    errors: tuple[float, float, float] | None = None

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
        """Returns the index of the last instant up to `time` [s]."""
        return max(0, int(np.searchsorted(self.time, time, side="right")) - 1)

    @cached_property
    def law(self) -> tuple[Mapping[str, float], float] | None:
        """Returns the mobile drones' fixed point [m east], and the least factor by which a step shrinks the error.

        The boundary values are the final desired positions of stationary drones. Returns None if the law of an agent is
        not known, a drone's neighbours or parameters are not recorded, or no stationary drone determines the solution.
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


def read_flight(run: Path) -> Flight:
    """Finds the drones in the signals of a run folder and reads the data for figures.

    Raises:
        CosimError: the run is not complete, or has no data for figures.
    """
    with open_signals(run) as signals:
        instances = players(run, read_manifest(run))
        numeric = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in signals.schema_arrow}
        found = parts(numeric, instances)
        if not found:
            raise CosimError(
                f"{run / 'signals.parquet'}: nothing to draw: no component has {POSITION}[1..3] in m, "
                f"or {STEP} and {TARGET} (m); `uav-cosim plot {run} --signal '*'` draws any of the "
                f"{len(numeric) - 1} signals that are recorded (`uav-cosim run --record` chooses which)"
            )
        n = signals.read(columns=["time"]).num_rows
        if n == 0:
            raise CosimError(f"{run / 'signals.parquet'}: nothing to draw: the run recorded no instant")
        rows = np.unique(np.linspace(0, n - 1, min(n, _ROWS)).round().astype(np.int64))

        kept = _columns(signals, found, instances)
        time = values_of(signals.read(columns=["time"]).column(0))
        drones, begun = [], {True: np.zeros(n, np.int64), False: np.zeros(n, np.int64)}
        for one in found:
            vehicle, agent = one.vehicle, one.agent
            drone = Drone(one.name, None, None)
            if vehicle:
                position = instances.get(vehicle, UNKNOWN).position
                axes = [kept[f"{vehicle}.{position}[{i}]"][rows] for i in (1, 2, 3)]
                drone = replace(drone, position=np.stack(axes, axis=1))
            if agent:
                of = instances.get(agent, UNKNOWN)
                target, formation = of.target
                step = kept[f"{agent}.{formation.step}"]
                desired = np.where(step > 0, kept[f"{agent}.{target}"], np.nan)
                drone = replace(
                    drone,
                    target=desired[rows],
                    stays=bool(of.parameters.get(formation.stays, False)),
                    member=member(of.verdicts, of.parameters),
                    errors=_errors(kept[f"{vehicle}.{position}[2]"] - desired) if vehicle else None,
                )
                np.maximum(begun[drone.mobile], step.astype(np.int64), out=begun[drone.mobile])
            drones.append(drone)
    begun_by = begun[True] if any(drone.mobile for drone in drones) else begun[False]
    numbers, first = np.unique(np.maximum.accumulate(begun_by), return_index=True)
    steps = {int(k): float(time[i]) for k, i in zip(numbers, first, strict=True) if k > 0}
    return Flight(time[rows], tuple(drones), steps)


def _errors(apart: Array) -> tuple[float, float, float] | None:
    """Returns the last, the largest and the root mean square error; None if none is known."""
    known = np.abs(apart[np.isfinite(apart)])
    if not known.size:
        return None
    return float(known[-1]), float(known.max()), float(np.sqrt(np.mean(known * known)))


def _columns(signals: Signals, found: Sequence[Part], instances: Mapping[str, Player]) -> dict[str, Array]:
    """Returns the columns of all drones; reading them one by one takes longer, all at once more memory."""
    wanted: list[str] = []
    for one in found:
        if one.vehicle:
            position = instances.get(one.vehicle, UNKNOWN).position
            wanted += [f"{one.vehicle}.{position}[{i}]" for i in (1, 2, 3)]
        if one.agent:
            target, formation = instances.get(one.agent, UNKNOWN).target
            wanted += [f"{one.agent}.{formation.step}", f"{one.agent}.{target}"]
    kept: dict[str, Array] = {}
    for begin in range(0, len(wanted), _AT_ONCE):
        table = signals.read(columns=wanted[begin : begin + _AT_ONCE])
        kept |= {name: values_of(table.column(name)) for name in table.column_names}
    return kept

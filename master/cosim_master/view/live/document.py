"""The document with which a live page begins: vehicles, signals and plots, but no values.

It has the form of `view.replay`. Instead of arrays, each vehicle has the indices of its signals; a signal's index is
also its place in the frames of the feed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cosim_master.results.reading.roles import Part, Player, parts
from cosim_master.stepping.observation import Column
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid
from cosim_master.view.live.traffic import LiveTraffic
from cosim_master.view.motion import Moving, moving
from cosim_master.view.replay import vehicle_of, vehicles_by_name

__all__ = ["drones_of", "known_of", "live_document", "live_traffic", "shown"]

_SIGNALS = 4000
"""Signals sent besides those of the vehicles' motion: more would make frames too large to be sent smoothly."""
_PLOTTED = 10
_WORDS = 9


def known_of(checked: CheckedSystem) -> dict[str, Player]:
    """Returns the instances as a manifest has them: with the start values of their parameters."""
    return {one.name: Player(one.effective_values(), one.fmu.verdicts) for one in checked.instances}


def shown(columns: Sequence[Column], checked: CheckedSystem) -> list[Column]:
    """Returns the recorded signals that the page receives: first those of the motion of all vehicles."""
    small = [column for column in columns if not column.variable.wide]
    moved = {
        name
        for vehicle in moving(parts(_units(small), known_of(checked)), known_of(checked), _units(small))
        for names in vehicle.columns.values()
        for name in names
    }
    room = max(0, _SIGNALS - len(moved))
    others = [column.name for column in small if column.name not in moved][:room]
    chosen = moved | {*others}
    return [column for column in small if column.name in chosen]


def live_traffic(columns: Sequence[Column], checked: CheckedSystem, network: Network) -> LiveTraffic:
    """Returns the packets of a run that begins, for the page with these signals."""
    return LiveTraffic(network, drones_of(columns, checked))


def drones_of(columns: Sequence[Column], checked: CheckedSystem) -> list[Part]:
    """Returns the drones of the page with these signals, in its order."""
    known, units = known_of(checked), _units(columns)
    return [vehicle.part for vehicle in moving(parts(units, known), known, units)]


def live_document(
    columns: Sequence[Column],
    recorded: int,
    checked: CheckedSystem,
    network: Network,
    clock: TimeGrid,
    *,
    packets: bool = True,
) -> dict[str, Any]:
    """Returns the document of a run that begins.

    Args:
        columns: the signals that the page receives.
        recorded: number of signals that the run records.
        checked: the system; its structure must be open.
        network: nodes and radio.
        clock: start, end and base step.
        packets: whether the run records packets.
    """
    known, units = known_of(checked), _units(columns)
    vehicles = moving(parts(units, known), known, units)
    drones = [vehicle.part for vehicle in vehicles]
    index = {column.name: i for i, column in enumerate(columns)}
    signals = [_signal(column) for column in columns]
    of = vehicles_by_name(drones)
    words: list[list[int]] = [[] for _ in drones]
    for i, signal in enumerate(signals):
        vehicle = vehicle_of(signal["name"], of)
        if vehicle >= 0:
            signal["vehicle"] = vehicle
            if ("items" in signal or "boolean" in signal) and len(words[vehicle]) < _WORDS:
                words[vehicle].append(i)
    start = clock.time(0)
    return {
        "name": checked.structure.name,
        "start": start,
        "end": start,
        "live": {"stop": clock.time(clock.steps), "signals": len(columns)},
        "vehicles": [_vehicle(one, index, said) for one, said in zip(vehicles, words, strict=True)],
        "signals": signals,
        "steps": [],
        "plots": _first_plots(index, drones, known),
        "traffic": {
            **{name: [] for name in ("messages", "sources", "vehicleOf", "spoken", "links")},
            "longest": 0.0,
            "live": packets,
        },
        "network": {name: getattr(network, name) for name in ("topology", "latency", "jitter", "loss")}
        | {"range": network.range if math.isfinite(network.range) else None},
        "packets": dict.fromkeys(("sent", "delivered", "lost"), 0),
        "verdict": None,
        "outcome": ("starting", ""),
        "facts": _facts(checked, clock, len(columns), recorded),
    }


def _units(columns: Sequence[Column]) -> dict[str, str]:
    return {
        column.name: "" if column.variable.unit is None else column.variable.unit.name
        for column in columns
    }  # fmt: skip


def _signal(column: Column) -> dict[str, Any]:
    variable = column.variable
    told: dict[str, Any] = {"name": column.name, "unit": "" if variable.unit is None else variable.unit.name}
    if variable.description:
        told["description"] = variable.description
    if variable.items:
        told["items"] = list(variable.items.items())
    if column.kind == "Boolean":
        told["boolean"] = True
    if column.kind != "Real":
        told["discrete"] = True
    return told


def _vehicle(one: Moving, index: Mapping[str, int], words: Sequence[int]) -> dict[str, Any]:
    return {
        "name": one.part.name,
        "rotors": one.rotors,
        "stays": one.stays,
        "columns": {what: [index[name] for name in names] for what, names in one.columns.items()},
        "words": list(words),
    }


def _first_plots(index: Mapping[str, int], drones: Sequence[Part], known: Mapping[str, Player]) -> list[list[int]]:
    """Returns the first plots: positions of some vehicles to the east, to the north and down, or the first signals."""
    every = max(1, -(-len(drones) // _PLOTTED))
    some = [(part.vehicle, known[part.vehicle].position) for part in drones[::every]]
    plots = [[index[f"{vehicle}.{position}[{axis}]"] for vehicle, position in some] for axis in (2, 1, 3)]
    return [plot for plot in plots if plot] or [[i] for i in range(min(4, len(index)))]


def _facts(checked: CheckedSystem, clock: TimeGrid, sent: int, recorded: int) -> list[tuple[str, str]]:
    facts = [
        ("system", str(checked.structure.path)),
        ("ends at", f"{clock.time(clock.steps):.9g} s"),
        ("base step", f"{clock.seconds(1):.9g} s"),
        ("instances", str(len(checked.instances))),
        ("recorded", f"{recorded} signals"),
    ]
    if sent < recorded:
        facts.append(("signals here", f"{sent}; `uav-cosim view` shows all of them after the run"))
    return facts

"""The built-in metrics.

    settling_time            s       time from which on all drones stay near the fixed point of their law: within 5 % of
                                     the greatest distance at the start, or within settling_time(BAND) m
    error_to_law             m       greatest distance of a drone from the fixed point of its law at the end, east
    nearest_approach         m       smallest distance of two vehicles during the run
    packets_sent, _delivered, _lost  counts of the radio
    energy                   J       integral of the power of all batteries (one output in V, one in A)

A metric without a value is NaN: drones that have not settled, a run with one vehicle, a law without a fixed point.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from cosim_master.campaigns.metrics.measured import Array, Measured
from cosim_master.results.reading.roles import UNKNOWN, Part, Player, parts
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.formation import member, settled

__all__ = ["BUILT_IN", "needs", "players_of", "value"]

_BAND = 0.05
"""Share of the greatest distance at the start within which a drone has settled."""


def players_of(checked: CheckedSystem, changes: Mapping[str, Mapping[str, Any]] | None = None) -> dict[str, Player]:
    """Returns the instances of a system, with the values of their parameters and `changes` of these."""
    return {
        one.name: Player({**one.effective_values(), **(changes or {}).get(one.name, {})}, one.fmu.verdicts)
        for one in checked.instances
    }


def needs(
    name: str, players: Mapping[str, Player], units: Mapping[str, str], outputs: Collection[str] = ()
) -> tuple[list[str], str]:
    """Returns the signals that a built-in metric needs in a system, or the reason why the system lacks it.

    Args:
        units: of all outputs and local variables, by "component.variable"; empty for those without.
        outputs: the names of those that are outputs.
    """
    if name in ("settling_time", "error_to_law"):
        return _law_signals(players, units)
    if name == "energy":
        found = [one for pair in _batteries(units, outputs) for one in pair]
        text = "energy needs a component with one output in V and one in A, such as a battery"
        return found, "" if found else f"{text}; this system has none"
    return [], ""


def value(name: str, run: Measured, *given: float) -> float:
    """Returns the value of a built-in metric for a run."""
    return _VALUES[name](run, *given)


# ---- the law -------------------------------------------------------------------------------------------------------


def _law_signals(players: Mapping[str, Player], units: Mapping[str, str]) -> tuple[list[str], str]:
    found: list[str] = []
    for one in parts(units, players):
        if one.agent and one.vehicle:
            player = players.get(one.agent, UNKNOWN)
            target, formation = player.target
            if not formation.neighbours:
                return (
                    [],
                    f"{one.agent} declares no law with a fixed point (docs/verdict.md); use an expression instead",
                )
            position = players.get(one.vehicle, UNKNOWN).position
            found += [f"{one.agent}.{formation.step}", f"{one.agent}.{target}"]
            found += [f"{one.vehicle}.{position}[{i}]" for i in (1, 2, 3)]
    return found, "" if found else "this system has no agents on a line; use an expression instead"


def _errors(run: Measured) -> Array | None:
    """Returns the distances of the mobile drones from their fixed points, (n, drones) m; None without fixed point."""
    members, held, flown = [], {}, {}
    for one in parts(run.units, run.players):
        if not (one.agent and one.vehicle):
            continue
        player = run.players[one.agent]
        made = member(player.verdicts, player.parameters)
        if made is None:
            return None
        members.append(made)
        if made.stays:
            held[made.id] = float(run[f"{one.agent}.{player.target[0]}"][-1])
        else:
            flown[made.id] = run[f"{one.vehicle}.{_position(run, one)}[2]"]
    point = settled(members, held)
    if point is None or not flown:
        return None
    return np.abs(np.stack([track - point[number] for number, track in flown.items()], axis=1))


def _position(run: Measured, part: Part) -> str:
    return run.players.get(part.vehicle, UNKNOWN).position


def _settling_time(run: Measured, band: float = np.nan) -> float:
    errors = _errors(run) if len(run.time) else None
    if errors is None:
        return np.nan
    outside: Any = (errors > (band if np.isfinite(band) else _BAND * errors[0].max())).any(axis=1)
    if outside[-1]:
        return np.nan
    rows = np.flatnonzero(outside)
    return float(run.time[rows[-1] + 1] if len(rows) else run.time[0])


def _error_to_law(run: Measured) -> float:
    errors = _errors(run) if len(run.time) else None
    return np.nan if errors is None else float(errors[-1].max())


# ---- others --------------------------------------------------------------------------------------------------------


def _nearest(run: Measured) -> float:
    verdict = run.result.verdict
    return float((verdict.nearest if verdict is not None else {}).get("distance", np.nan))


def _packets(name: str) -> Callable[[Measured], float]:
    return lambda run: float(run.result.packets.get(name, 0))


def _batteries(units: Mapping[str, str], outputs: Collection[str]) -> list[tuple[str, str]]:
    """Returns the signals of the components with one output in V and one in A: the two of a battery.

    An autopilot that measures a battery has local variables in these units.
    """
    found: dict[str, dict[str, list[str]]] = {}
    for name in (one for one in units if one in outputs):
        found.setdefault(name.rpartition(".")[0], {}).setdefault(units[name], []).append(name)
    pairs = [(one.get("V", []), one.get("A", [])) for one in found.values()]
    return [(volts[0], amperes[0]) for volts, amperes in pairs if len(volts) == len(amperes) == 1]


def _energy(run: Measured) -> float:
    pairs = _batteries(run.units, run.outputs)
    if not pairs or not len(run.time):
        return np.nan
    return float(sum(np.trapezoid(run[volts] * run[amperes], run.time) for volts, amperes in pairs))


_VALUES: Mapping[str, Callable[..., float]] = {
    "settling_time": _settling_time,
    "error_to_law": _error_to_law,
    "nearest_approach": _nearest,
    "packets_sent": _packets("sent"),
    "packets_delivered": _packets("delivered"),
    "packets_lost": _packets("lost"),
    "energy": _energy,
}
BUILT_IN: Mapping[str, int] = {name: int(name == "settling_time") for name in _VALUES}
"""The built-in metrics, and the largest number of their arguments."""

"""Converts the memory of a watch to plain values for a checkpoint; a resumed run is judged like an uninterrupted one.

All values are stored by name, since a branch may change the bounds that apply and the signals that are recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cosim_master.verdict.findings import Finding
from cosim_master.verdict.watching.approach import Contact
from cosim_master.verdict.watching.spells import Spells
from cosim_master.verdict.watching.watch import Watch

__all__ = ["recall", "remember"]

_AGENT = ("failed", "reason", "began", "last")
_BODY = ("commanded", "by", "flew")
_SPELL = ("first", "longest", "total", "open", "worst", "worst_time", "since")


def remember(watch: Watch) -> dict[str, Any]:
    """Returns all findings of the watch so far; `recall` restores them in the watch of a resumed run."""
    watch.settle()
    bodies = [body.instance for body in watch.bodies]
    places = [] if watch.start is None else watch.start.tolist()
    approach = watch.approach
    return {
        "begin": watch.begin,
        "agents": {_of_agent(one): {name: getattr(one, name) for name in _AGENT} for one in watch.agents},
        "vehicles": {one.instance: {name: getattr(one, name) for name in _BODY} for one in watch.bodies},
        "starts": dict(zip(bodies, places, strict=False)),
        "away": _spells([pilot.instance for pilot in watch.pilots], watch.away),
        "down": _spells(bodies, watch.down),
        "outside": _spells([_of_bound(one) for one in watch.limited], watch.outside),
        "nearest": [approach.distance, [bodies[b] for b in approach.pair if b >= 0], approach.time],
        "contacts": [
            [bodies[a], bodies[b], one.since, one.distance, one.time] for (a, b), one in approach.contacts.items()
        ],
        "ids": {str(number): finding.as_json() for number, finding in watch.double.items()},
    }


def recall(watch: Watch, memory: Mapping[str, Any]) -> None:
    """Restores `memory` in a watch that has not observed any instant yet."""
    watch.recalled, watch.begin = True, memory["begin"]
    for agent in watch.agents:
        _set(agent, memory["agents"].get(_of_agent(agent), {}))
    for body in watch.bodies:
        _set(body, memory["vehicles"].get(body.instance, {}))
    bodies = {body.instance: b for b, body in enumerate(watch.bodies)}
    if bodies and bodies.keys() <= memory["starts"].keys():
        watch.start = np.array([memory["starts"][name] for name in bodies])
    _recall_spells([pilot.instance for pilot in watch.pilots], watch.away, memory["away"])
    _recall_spells([*bodies], watch.down, memory["down"])
    _recall_spells([_of_bound(one) for one in watch.limited], watch.outside, memory["outside"])
    distance, pair, time = memory["nearest"]
    if pair and bodies.keys() >= {*pair}:
        watch.approach.distance, watch.approach.time = distance, time
        watch.approach.pair = bodies[pair[0]], bodies[pair[1]]
    for one, other, since, near, when in memory["contacts"]:
        if bodies.keys() >= {one, other}:
            watch.approach.contacts[bodies[one], bodies[other]] = Contact(since, near, when)
    for number, finding in memory["ids"].items():
        watch.double[int(number)] = Finding(**{**finding, "who": tuple(finding["who"])})


def _of_agent(agent: Any) -> str:
    return f"{agent.instance.name}.{agent.variable}"


def _of_bound(bound: Any) -> str:
    return f"{bound.instance}.{bound.variable}"


def _set(one: Any, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        setattr(one, name, value)


def _spells(names: Sequence[str], spells: Spells) -> dict[str, Any]:
    columns = [getattr(spells, name).tolist() for name in _SPELL]
    return {"last": spells.last, "of": {name: list(row) for name, *row in zip(names, *columns, strict=True)}}


def _recall_spells(names: Sequence[str], spells: Spells, memory: Mapping[str, Any]) -> None:
    spells.last = memory["last"]
    for n, name in enumerate(names):
        for field, value in zip(_SPELL, memory["of"].get(name, ()), strict=False):
            getattr(spells, field)[n] = value

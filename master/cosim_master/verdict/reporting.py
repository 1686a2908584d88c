"""The findings of a watch, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from cosim_master.verdict.findings import Finding, Number
from cosim_master.verdict.watching.spells import Spells
from cosim_master.verdict.watching.watch import Watch

__all__ = ["findings", "nearest"]

_PATIENCE = 10.0
"""s for which a vehicle may remain at its place after a command."""
_AWAY = 3.0
"""s for which a vehicle may be farther than `Limits.deviation` from its desired position, or on the ground."""
_LATE = 1.0
"""s by which an agent may begin its work late."""


def findings(watch: Watch) -> list[Finding]:
    """Returns all findings of a run that has ended."""
    return [
        *_of_agents(watch),
        *_of_bodies(watch),
        *_of_ground(watch),
        *_of_contacts(watch),
        *_of_pilots(watch),
        *_of_limits(watch),
        *watch.double.values(),
    ]


def nearest(watch: Watch) -> Mapping[str, Any]:
    """The closest approach of two vehicles, as `Judgement.nearest`."""
    if not math.isfinite(watch.approach.distance):
        return {}
    who = [watch.bodies[b].instance for b in watch.approach.pair]
    return {"who": who, "distance": watch.approach.distance, "time": watch.approach.time}


def _of_agents(watch: Watch) -> Iterator[Finding]:
    for agent in watch.agents:
        name, state = agent.instance.name, agent.text_of(agent.last)
        if not math.isnan(agent.failed):
            why = agent.why()
            text = f"{name} has given up at {agent.failed:.1f} s{': ' if why else ''}{why}"
            numbers: dict[str, Number] = {"state": state, "reason": agent.reason}
            yield Finding("agent failed", "failure", (name,), text, agent.failed, numbers)
        elif watch.end > agent.by + _LATE and not agent.began <= max(agent.by + _LATE, watch.begin):
            wanted = f"it was to work from {agent.by:g} s on ({agent.condition.by})"
            if math.isnan(agent.began):
                text = f"{name} is still in state {state} at {watch.end:.1f} s; {wanted}"
            else:
                text = f"{name} has begun at {agent.began:.1f} s; {wanted}"
            yield Finding("agent late", "warning", (name,), text, agent.by, {"state": state, "by": agent.by})


def _of_bodies(watch: Watch) -> Iterator[Finding]:
    for body in watch.bodies:
        if not body.flew and watch.end - body.commanded >= _PATIENCE:
            text = f"{body.instance} has never left the ground, though {body.by} wanted it to"
            text += f" from {body.commanded:.1f} s on: is it armed, are its motors strong enough for its mass,"
            text += " and can it fly at all (a rover cannot)?"
            yield Finding("never flew", "failure", (body.instance,), text, body.commanded)


def _of_ground(watch: Watch) -> Iterator[Finding]:
    down = watch.down
    for b, body in enumerate(watch.bodies):
        if down.longest[b] < _AWAY:
            continue
        text = f"{body.instance} stands on the ground {_how_long(watch, down, b)}, though it had flown and"
        text += f" {body.by} wants it in the air: are its motors too weak?"
        numbers: dict[str, Number] = {"total": float(down.total[b])}
        yield Finding("came down", "failure", (body.instance,), text, float(down.first[b]), numbers)


def _of_contacts(watch: Watch) -> Iterator[Finding]:
    for (a, b), contact in sorted(watch.approach.contacts.items()):
        one, other = watch.bodies[a].instance, watch.bodies[b].instance
        text = f"{one} and {other} came within {contact.distance:.2f} m of each other at {contact.time:.1f} s"
        text += f"; nearer than {watch.limits.contact:g} m counts as contact"
        numbers = {"distance": contact.distance, "nearest at": contact.time, "contact": watch.limits.contact}
        yield Finding("contact", "failure", (one, other), text, contact.since, numbers)


def _of_pilots(watch: Watch) -> Iterator[Finding]:
    away = watch.away
    for p, pilot in enumerate(watch.pilots):
        if away.longest[p] < _AWAY:
            continue
        body = watch.bodies[pilot.body].instance
        numbers = {"distance": float(away.worst[p]), "farthest at": float(away.worst_time[p])}
        text = f"{body} was up to {away.worst[p]:.1f} m from where {pilot.instance} wanted it"
        text += f", more than {watch.limits.deviation:g} m {_how_long(watch, away, p)}"
        text += ": is the wind too strong, or are the motors too weak?"
        yield Finding("off course", "failure", (body,), text, float(away.first[p]), numbers)


def _of_limits(watch: Watch) -> Iterator[Finding]:
    outside = watch.outside
    for n, one in enumerate(watch.limited):
        if math.isnan(outside.first[n]):
            continue
        above = one.most + outside.worst[n]
        held = isinstance(one.bound.most, str)
        most = f"{one.bound.most} = {one.most:g}" if held else f"{one.most:g}"
        unit = f" {one.unit}" if one.unit else ""
        text = f"{one.instance}: {one.bound.text or f'{one.variable} is outside of its bounds'}"
        text += f" ({one.variable} outside of {one.least:g} to {most}{unit} {_how_long(watch, outside, n)})"
        numbers = {"total": float(outside.total[n]), "longest": float(outside.longest[n])}
        if one.least == -math.inf:
            numbers["greatest"] = float(above)
        yield Finding("out of bounds", "warning", (one.instance,), text, float(outside.first[n]), numbers)


def _how_long(watch: Watch, spells: Spells, n: int) -> str:
    since = f"from {spells.first[n]:.1f} s on"
    return (
        since
        if spells.open[n] and spells.total[n] >= watch.end - spells.first[n] - 1e-6
        else (f"for {spells.total[n]:.1f} s in all, first at {spells.first[n]:.1f} s")
    )

"""Checkpoints of a run in parts: they are those of a run in one process.

At an instant, each part gives part 0 everything that it alone knows: the states of its instances, their values, and the
packets in flight to its nodes. `together` puts them into the arrays of the whole system, which every part has, so that
a run can be resumed in one process, or in any other parts. A part that resumes restores all of them, and `confine`
drops the packets and counts of others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.kernel import table
from cosim_master.execution.partitions.cut import Cut
from cosim_master.execution.run.checkpoint import Saved, captured
from cosim_master.execution.run.state import RunState, changing
from cosim_master.network.radio.in_flight import Flying, flying, with_flying
from cosim_master.network.radio.tables import FREE_PLACE, FREE_PLACES, IN_FLIGHT, POSTED, TURN, USED_EVENTS, USED_LOG
from cosim_master.network.radio.tables import ROLES as RADIO_ROLES
from cosim_master.network.roles import STATE
from cosim_master.stepping.confining import outputs_of_part

__all__ = ["PartState", "confine", "part_state", "together"]

_SAME = ("order", "along", "media", "routes", "seen", "relayed")
"""Arrays of the radio that replaying the packets of all parts makes the same in all of them, or that are empty."""


@dataclass(frozen=True, slots=True)
class PartState:
    """What one part alone knows at an instant.

    Attributes:
        rows: the rows of arrays that belong to the part, by the names of `checkpoint.captured`.
        states: of its FMU instances, in their order.
        texts: Strings of its instances, by name.
        flying: packets in flight to its nodes.
        counters: of its radio.
    """

    rows: dict[str, np.ndarray[Any, Any]]
    states: list[bytes]
    texts: dict[str, str]
    flying: Flying
    counters: np.ndarray[Any, Any]


def part_state(state: RunState, cut: Cut, part: int) -> tuple[PartState, Saved]:
    """Returns the state of a part for part 0, and the arrays that it is from; rows and packets must be handed over.

    Raises:
        FmuError: an FMU fails to save its state.
    """
    saved, places = captured(state), _places(state, cut, part)
    own = [i for i, one in enumerate(cut.of_instance) if one == part]
    names = {state.slaves[i].name for i in own}
    found = PartState(
        {name: saved.arrays[name][at] for name, at in places.items()},
        [saved.states[i] for i in own],
        {name: text for name, text in saved.texts.items() if name.rpartition(".")[0] in names},
        flying(state.radio, _endpoints(state, cut, part)),
        saved.arrays["radio.counters"],
    )
    return found, saved


def together(state: RunState, cut: Cut, own: Saved, parts: Sequence[PartState]) -> Saved:
    """Returns the state of the whole system.

    Args:
        state: the run of part 0, which is not changed.
        own: its state.
        parts: what all parts know, part 0 first.
    """
    arrays, texts = {name: array.copy() for name, array in own.arrays.items()}, dict(own.texts)
    states: list[bytes] = [b""] * len(state.slaves)
    for part, one in enumerate(parts):
        for name, at in _places(state, cut, part).items():
            arrays[name][at] = one.rows[name]
        mine = (i for i, owner in enumerate(cut.of_instance) if owner == part)
        for i, content in zip(mine, one.states, strict=True):
            states[i] = content
        texts |= one.texts
    counters = np.sum([one.counters for one in parts], axis=0)
    counters[[USED_EVENTS, USED_LOG, TURN, POSTED]] = 0
    radio = state.radio._replace(endpoints=table(arrays["radio.endpoints"]), counters=counters)
    radio = with_flying(radio, Flying.joined([one.flying for one in parts]))
    for name, array in changing(radio, RADIO_ROLES, (STATE,)).items():
        if name not in _SAME:
            arrays[f"radio.{name}"] = np.array(array)
    return replace(own, arrays=arrays, states=states, texts=texts)


def confine(state: RunState, cut: Cut, part: int) -> None:
    """Drops the packets in flight to the nodes of other parts; the counts of the whole run remain in part 0."""
    state.radio = with_flying(state.radio, flying(state.radio, _endpoints(state, cut, part)))
    if part != 0:
        kept = np.isin(np.arange(state.radio.counters.size), (FREE_PLACE, FREE_PLACES, IN_FLIGHT))
        state.radio.counters[~kept] = 0


def _endpoints(state: RunState, cut: Cut, part: int) -> np.ndarray[Any, Any]:
    return np.flatnonzero(np.array(cut.of_node, dtype=np.int64)[state.radio.endpoints["node"]] == part)


def _places(state: RunState, cut: Cut, part: int) -> dict[str, np.ndarray[Any, Any]]:
    """Returns the rows of a part in each array, by the names of `checkpoint.captured`."""
    plan, layout = state.plan, state.layout
    owner = np.array(cut.of_instance, dtype=np.int64)
    here = owner == part
    reals, ints = outputs_of_part(layout, cut.elsewhere(part))
    inputs = [np.arange(first, last) for one in plan.feeds[here] for first, last in _ranges(one)]
    each = np.concatenate(inputs) if inputs else np.zeros(0, dtype=np.int64)
    n = plan.real_in.size
    ports = np.flatnonzero(here[plan.ports["instance"]])
    slopes = np.flatnonzero(here[plan.slopes["instance"]])
    found = {name: np.flatnonzero(here) for name in ("instances.h", "instances.length", "next_events", "pending")}
    found["real_in"], found["int_in"] = each[each < n], each[each >= n] - n
    found["real_out"], found["int_out"] = reals, ints
    found |= dict.fromkeys(("rx", "tx", "ports.filled", "ports.sent", "ports.given_size"), ports)
    found |= dict.fromkeys(("derivatives", "slopes.before", "slopes.at", "slopes.known"), slopes)
    found["delay_line"] = _delayed(state, here)
    found["radio.endpoints"] = _endpoints(state, cut, part)
    return found


def _ranges(feed: Any) -> list[tuple[int, int]]:
    return [(int(first), int(last)) for first, last in zip(feed["first_in"], feed["last_in"], strict=True)]


def _delayed(state: RunState, here: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Returns the places of the delayed values whose receivers are here."""
    number = {one.name: i for i, one in enumerate(state.layout.instances)}
    found = [
        np.arange(row["first"], row["first"] + max(int(row["length"]), 0))
        for row, one in zip(state.plan.delays, state.layout.delays, strict=True)
        if here[number[one.link.target[0]]]
    ]
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)

"""Groups of instances that make several base steps each on its own: see `kernels.windows`.

A group is a range of instances. No connection and no node of the radio joins two groups, so only packets by radio pass
between them, and none of these arrives within a window.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import PLAIN, table
from cosim_master.network.radio.tables import Radio
from cosim_master.stepping.kernels.tables import (
    BASE,
    EVENTFUL,
    GROUP,
    INBOX,
    JACOBI,
    ORDER,
    PER_NS,
    WINDOW,
    Plan,
)
from cosim_master.stepping.plan import runs_of

__all__ = ["grouped"]

LEAST = 256
"""Least number of instances for which groups pay: the memory of fewer stays in the cache of a core."""
LARGEST = 90
"""Most instances of a group: the memory of about so many fits a core's cache."""
LONGEST = 16
"""Most base steps of a window: the memory of a group comes from afar once in so many steps."""


def grouped(plan: Plan, radio: Radio, periods: Sequence[int], threads: int) -> tuple[Plan, Radio]:
    """Returns the plan with groups, or as it is if its instances must make each base step together.

    With groups, the radio finds positions in `Plan.past`, instead of among the real outputs, which are ahead.

    Args:
        periods: base steps per step, of each instance.
        threads: number of threads that step instances.
    """
    longest = _window(plan, radio)
    if plan.instances.size < LEAST or longest < 2 or not _may_go_ahead(plan):
        return plan, radio
    firsts = _cut(plan, radio, max(1, min(LARGEST, plan.instances.size // (4 * threads))))
    sizes = np.diff([*firsts, plan.instances.size])
    groups = _groups(plan, radio, firsts, periods) if sizes.max() <= 4 * LARGEST else None
    if groups is None:
        return plan, radio
    plan.counters[WINDOW] = longest
    members = np.arange(plan.instances.size)
    number = np.searchsorted(firsts, members, side="right")
    places = radio.nodes["place"].copy()
    nodes = radio.nodes.copy()
    nodes["place"] = np.where(places >= 0, np.arange(places.size).reshape(places.shape), -1)
    plan = plan._replace(
        groups=table(groups),
        members=np.lexsort((members, plan.instances["library"], number)),  # of one FMU together: see `Plan.free`
        input_runs=table(runs_of(plan.feeds, periods, firsts)),
        inboxes=table(np.zeros(plan.ports.size, dtype=INBOX)),
        positions=places,
        past=np.zeros((longest, places.size)),
    )
    return plan, radio._replace(nodes=nodes)


def _window(plan: Plan, radio: Radio) -> int:
    """Returns the base steps of a window: nothing that is sent in it arrives before its last one; at most `LONGEST`.

    The first packet is sent at the end of the first base step; the last one begins a base step before the window ends.
    """
    settings = radio.settings[0]
    if plan.ports.size == 0:
        return LONGEST
    if radio.gateways.size or radio.trip.size or radio.outbox.size or settings["medium"] or settings["own"]:
        return 0
    least = min([int(settings["latency"]), *radio.channels["latency"].tolist(), *radio.trace["delay"].tolist()])
    return min(LONGEST, int((least - 1) * plan.counters[PER_NS] // plan.counters[BASE]) + 2) if least > 0 else 0


def _may_go_ahead(plan: Plan) -> bool:
    """Returns whether nothing but packets by radio must pass between instances at each base step."""
    at_each_step = (plan.confined, plan.grids, plan.delays, plan.slopes, plan.int_to_real, plan.value_maps)
    if PLAIN or any(len(array) for array in at_each_step) or plan.instances["answers"].any():
        return False
    return bool(plan.counters[ORDER] == JACOBI and plan.counters[EVENTFUL] == 0)


def _cut(plan: Plan, radio: Radio, size: int) -> NDArray[np.int64]:
    """Returns the first instance of each group: of at least `size` instances, if more follow."""
    n = plan.instances.size
    pairs = np.concatenate([*_connected(plan), _aboard(plan, radio)])
    joined = np.zeros(n + 1, dtype=np.int64)  # connections and nodes that join instances before i and from i on
    np.add.at(joined, pairs.min(axis=1) + 1, 1)
    np.add.at(joined, pairs.max(axis=1) + 1, -1)
    free = np.flatnonzero(np.cumsum(joined[:n]) == 0)
    firsts = [0]
    for i in free:
        if i >= firsts[-1] + size and i + size // 2 <= n:
            firsts.append(int(i))
    return np.array(firsts, dtype=np.int64)


def _connected(plan: Plan) -> list[NDArray[np.int64]]:
    """Returns the instances at both ends of all connections, by kind."""
    found = []
    first_out, last_out, first_in, last_in = (
        plan.feeds[name] for name in ("first_out", "last_out", "first_in", "last_in")
    )
    for kind in range(3):
        offset = 0 if kind == 0 else int(last_out[-1, 0])  # outputs that are no reals are counted on
        counts = (last_in[:, kind] - first_in[:, kind]).astype(np.int64)
        reader = np.repeat(np.arange(len(counts)), counts)
        source = plan.sources[int(first_in[0, kind]) : int(last_in[-1, kind])].astype(np.int64) + offset
        own = (source >= int(first_out[0, kind])) & (source < int(last_out[-1, kind]))  # others are constants
        writer = np.searchsorted(last_out[:, kind].astype(np.int64), source[own], side="right")
        found.append(np.stack([reader[own], writer], axis=1))
    return found


def _aboard(plan: Plan, radio: Radio) -> NDArray[np.int64]:
    """Returns pairs of instances that share a node."""
    node = radio.endpoints["node"][: plan.ports.size]
    instance = plan.ports["instance"].astype(np.int64)
    same = np.flatnonzero(node[1:] == node[:-1])
    return np.stack([instance[same], instance[same + 1]], axis=1)


def _groups(plan: Plan, radio: Radio, firsts: NDArray[np.int64], periods: Sequence[int]) -> NDArray[Any] | None:
    """Returns the table of groups; None if there is one only, or if what belongs to a group is not consecutive."""
    n, feeds = plan.instances.size, plan.feeds
    lasts = np.append(firsts[1:], n)
    last_out = feeds["last_out"].astype(np.int64)
    last_out[:, 1:] -= last_out[-1, 0]  # as in `Plan.int_out`
    booleans = int((plan.int_recorded < last_out[-1, 1]).sum())  # they come after the integers
    recorded = (plan.real_recorded, plan.int_recorded[:booleans], plan.int_recorded[booleans:])
    owners = [np.searchsorted(last_out[:, kind], recorded[kind], side="right") for kind in range(3)]
    owners.append(plan.ports["instance"].astype(np.int64))
    of_group = [np.searchsorted(firsts, one, side="right") - 1 for one in owners]
    if len(firsts) < 2 or any((np.diff(one) < 0).any() for one in of_group):
        return None
    groups = np.zeros(len(firsts), dtype=GROUP)
    numbers = np.arange(len(firsts))
    begins = np.concatenate([runs_of(feeds, periods, firsts)["instance"].astype(np.int64), [n]])
    table: Any = groups
    table["first_instance"], table["last_instance"] = firsts, lasts
    table["first_member"], table["last_member"] = firsts, lasts
    table["first_run"], table["last_run"] = np.searchsorted(begins, firsts), np.searchsorted(begins, lasts)
    table["first_real"], table["last_real"] = feeds["first_out"][firsts, 0], feeds["last_out"][lasts - 1, 0]
    table["first_port"] = np.searchsorted(of_group[3], numbers)
    table["last_port"] = np.searchsorted(of_group[3], numbers, side="right")
    node = np.append(radio.endpoints["node"][: plan.ports.size], len(radio.nodes))
    begins = node[groups["first_port"]]  # of no ports: the node of the next group
    table["first_node"], table["last_node"] = begins, np.append(begins[1:], len(radio.nodes))
    for kind in range(3):
        after = booleans if kind == 2 else 0
        table["first_recorded"][:, kind] = after + np.searchsorted(of_group[kind], numbers)
        table["last_recorded"][:, kind] = after + np.searchsorted(of_group[kind], numbers, side="right")
    table["failed"] = -1
    return groups

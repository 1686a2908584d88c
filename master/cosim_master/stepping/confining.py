"""The plan of a part of a run: all places of the system, of which it steps and records its own instances only."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import table
from cosim_master.fmi.calls import KINDS
from cosim_master.stepping.kernels.tables import Plan
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.plan import runs_of

_Places = NDArray[np.int64]

__all__ = ["columns_of_part", "confined", "outputs_of_part"]


def outputs_of_part(layout: Layout, elsewhere: Collection[int]) -> tuple[_Places, _Places]:
    """Returns the places in `Plan.real_out` and in `Plan.int_out` of the outputs of a part's instances."""
    found: tuple[list[int], list[int]] = ([], [])
    integers = len(layout.ports["Integer"].outputs)
    for kind in KINDS:
        ports, first = layout.ports[kind], integers if kind == "Boolean" else 0
        places = found[0] if kind == "Real" else found[1]
        for i in range(len(layout.instances)):
            if i not in elsewhere:
                places += range(first + ports.first_out[i], first + ports.first_out[i + 1])
    return np.array(found[0], dtype=np.int64), np.array(found[1], dtype=np.int64)


def columns_of_part(layout: Layout, elsewhere: Collection[int]) -> tuple[_Places, _Places]:
    """Returns the columns of the recording that a part records, of reals and of integers (with Booleans)."""
    reals, integers = outputs_of_part(layout, elsewhere)
    kinds = [layout.ports[kind] for kind in KINDS]
    recorded = [*kinds[1].recorded, *(len(kinds[1].outputs) + i for i in kinds[2].recorded)]
    return (
        np.flatnonzero(np.isin(np.array(kinds[0].recorded, dtype=np.int64), reals)),
        np.flatnonzero(np.isin(np.array(recorded, dtype=np.int64), integers)),
    )


def confined(plan: Plan, layout: Layout, periods: Sequence[int], elsewhere: Collection[int]) -> Plan:
    """Returns the plan of a part, in which the instances `elsewhere` are neither fed nor stepped nor recorded."""
    away = np.isin(np.arange(len(layout.instances)), list(elsewhere))
    for field in ("first_set", "first_set_value", "last_set", "first_get", "last_get"):
        plan.instances[field][away] = 0
    plan.instances["endpoint"][away] = -1
    there = away[plan.ports["instance"]]
    plan.ports["has_rx"][there] = plan.ports["has_tx"][there] = 0
    reals, integers = columns_of_part(layout, elsewhere)
    rows = plan.ticks.size
    return plan._replace(
        input_runs=table(runs_of(plan.feeds, periods, here=~away)),
        confined=np.array([i for i in plan.confined if not away[i]], dtype=np.int64),
        real_recorded=plan.real_recorded[reals],
        int_recorded=plan.int_recorded[integers],
        real_block=np.zeros((rows, reals.size)),
        int_block=np.zeros((rows, integers.size), dtype=np.int32),
    )

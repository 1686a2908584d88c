"""Inputs are set for runs of instances: each input of each instance here once, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.stepping.kernels.tables import FEED
from cosim_master.stepping.plan import runs_of

INSTANCE = st.tuples(
    st.tuples(*[st.integers(0, 2)] * 3),  # inputs by kind
    st.sampled_from([1, 5]),  # period
    st.booleans(),  # plain
    st.booleans(),  # here
    st.booleans(),  # the first of a group
)


def table_of(counts: np.ndarray[Any, Any], plain: list[bool]) -> np.ndarray[Any, Any]:
    """The feeds of instances with these numbers of inputs, (instances, 3): all reals, all integers, all booleans."""
    feeds = np.zeros(len(counts), dtype=FEED)
    feeds["instance"], feeds["plain"] = np.arange(len(counts)), plain
    ends = np.cumsum(counts, axis=0)
    before = np.concatenate([[0], np.cumsum(ends[-1])[:-1]])
    feeds["last_in"], feeds["first_in"] = ends + before, ends - counts + before
    return feeds


def covered(feeds: np.ndarray[Any, Any]) -> list[int]:
    rows = [range(first, last) for row in feeds for first, last in zip(row["first_in"], row["last_in"], strict=True)]
    return sorted(i for row in rows for i in row)


@given(st.lists(INSTANCE, min_size=1, max_size=12))
def test_runs_have_the_inputs_of_the_instances_here(instances: list[Any]) -> None:
    counts, periods, plain, here, begins = (list(column) for column in zip(*instances, strict=True))
    feeds = table_of(np.array(counts), plain)
    firsts = [i for i, begin in enumerate(begins) if begin]
    runs = runs_of(feeds, periods, firsts, np.array(here))
    assert covered(runs) == covered(feeds[here])
    for run in runs:
        inside = [i for i in range(len(counts)) if here[i] and set(covered(feeds[i : i + 1])) & set(covered(run[None]))]
        assert inside[0] == run["instance"]
        assert {periods[i] for i in inside} == {periods[inside[0]]}
        assert {plain[i] for i in inside} == {bool(run["plain"])}
        assert not any(begins[i] for i in range(inside[0] + 1, inside[-1] + 1))


def test_instances_without_inputs_do_not_divide_a_run() -> None:
    """Two drones of an agent, of another period and without inputs, an autopilot and a vehicle: one run."""
    counts = np.array([[0, 0, 0], [16, 1, 1], [11, 0, 0]] * 2)
    (run,) = runs_of(table_of(counts, [True] * 6), [100, 1, 1] * 2)
    assert (run["instance"], run["first_in"].tolist(), run["last_in"].tolist()) == (1, [0, 54, 56], [54, 56, 58])
    assert not len(runs_of(table_of(np.zeros((3, 3), dtype=int), [True] * 3), [1] * 3))

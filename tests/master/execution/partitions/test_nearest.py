"""Who can be among the nearest: boxes against the positions of all nodes, drawn at random within them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_master.execution.partitions.nearest import Crowd, concerned, counts_nearest
from cosim_master.system.settings.network import Network


@pytest.mark.parametrize(
    ("values", "counted"),
    [
        ({"topology": "nearest"}, True),
        ({"topology": "nearest", "range": 10.0}, True),
        ({"topology": "nearest", "medium": "shared"}, False),
        ({"topology": "broadcast", "range": 10.0}, False),
    ],
)
def test_nearest_nodes_are_counted_without_a_medium(values: dict[str, Any], counted: bool) -> None:
    assert counts_nearest(Network(**values)) == counted


def hearers(network: Network, places: Any) -> list[set[int]]:
    """The nodes that hear each node: the definition."""
    found = []
    for n in range(len(places)):
        if network.axis is not None:
            order = [int(m) for m in np.argsort(places @ np.array(network.axis), kind="stable")]
            at = order.index(n)
            found.append({*order[max(0, at - network.neighbours) : at + network.neighbours + 1]} - {n})
        else:
            apart = np.linalg.norm(places - places[n], axis=1)
            apart[n] = math.inf
            nearest = min(network.neighbours, len(places) - 1)
            found.append({int(m) for m in np.argsort(apart, kind="stable")[:nearest]})
    return found


axes = st.sampled_from([None, (0.0, 1.0, 0.0), (1.0, -2.0, 0.5)])


@settings(max_examples=150)
@given(axis=axes, neighbours=st.integers(1, 4), parts=st.integers(2, 4), data=st.data())
def test_hidden_nodes_change_nothing_that_a_part_routes(axis: Any, neighbours: int, parts: int, data: Any) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    network = Network(topology="nearest", axis=axis, neighbours=neighbours)
    wide = data.draw(st.sampled_from([0.1, 2.0, 20.0]))
    crowds, places, of = [], [], []
    for part in range(parts):
        count = data.draw(st.integers(0, 4))
        low = rng.uniform(-60.0, 60.0, (count, 3)) * [1.0, 1.0, 0.2]
        boxes = np.stack([low, low + rng.uniform(0.0, wide, (count, 3))], axis=1)
        group = np.repeat(np.arange(count), rng.integers(1, 4, count))
        crowds.append(Crowd(boxes, group))
        places.append(boxes[group, 0] + rng.uniform(size=(len(group), 1)) * (boxes[group, 1] - boxes[group, 0]))
        of += [part] * len(group)
    at, owner = np.concatenate(places), np.array(of)
    truth = hearers(network, at)
    found = [concerned(network, crowds, part) for part in range(parts)]
    heard = np.concatenate([one.heard[crowd.group] for one, crowd in zip(found, crowds, strict=True)])
    seen = np.concatenate([one.seen[crowd.group] for one, crowd in zip(found, crowds, strict=True)])
    middles = np.concatenate([crowd.middles for crowd in crowds])
    for part in range(parts):
        known = np.where((seen[:, part] | (owner == part))[:, None], at, middles)
        assumed = hearers(network, known)
        for n in range(len(at)):
            own = {m for m in truth[n] if owner[m] == part}
            assert heard[n, part] or not own
            if owner[n] == part:
                assert assumed[n] == truth[n]
            elif heard[n, part]:
                assert {m for m in assumed[n] if owner[m] == part} == own


def test_a_line_in_stripes_concerns_its_neighbours() -> None:
    """Boxes of one node each, 10 m apart in three parts of four: with one neighbour, only the ends meet."""
    network = Network(topology="nearest", axis=(0.0, 1.0, 0.0), neighbours=1)
    crowds = []
    for part in range(3):
        low = np.array([[0.0, 10.0 * (4 * part + i), 0.0] for i in range(4)])
        crowds.append(Crowd(np.stack([low, low + 1.0], axis=1), np.arange(4)))
    middle = concerned(network, crowds, 1)
    assert middle.heard[:, 0].tolist() == middle.seen[:, 0].tolist() == [True, False, False, False]
    assert middle.heard[:, 2].tolist() == middle.seen[:, 2].tolist() == [False, False, False, True]


@pytest.mark.parametrize("axis", [None, (0.0, 1.0, 0.0)])
def test_nodes_that_may_be_anywhere_concern_all_parts(axis: Any) -> None:
    network = Network(topology="nearest", axis=axis, neighbours=1)
    anywhere = Crowd(np.array([[[-np.inf] * 3, [np.inf] * 3]]), np.zeros(2, dtype=np.int8))
    here = Crowd(np.array([[[0.0] * 3, [1.0] * 3], [[50.0] * 3, [51.0] * 3]]), np.arange(2))
    for part in (0, 1):
        found = concerned(network, [anywhere, here], part)
        assert found.heard.all()
        assert found.seen.all()

"""Who can hear whom: the reach of a radio against its closed form, and boxes against the distances of all nodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.execution.partitions.hearing import FAR, Promise, Promises, carries_positions, out_of_reach, reach_of
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.radio.disturbances import Jamming

JAMMED = (Jamming(0.0, 0.0, 10.0, 0.0, 1.0),)


def network(**values: Any) -> Network:
    return Network(**{"topology": "broadcast", **values})


@pytest.mark.parametrize(
    ("values", "reach", "carried"),
    [
        ({}, math.inf, False),
        ({"range": 40.0}, 40.0, True),
        ({"range": 40.0, "topology": "listed"}, 40.0, True),
        ({"range": 40.0, "topology": "nearest"}, math.inf, False),
        ({"range": 40.0, "medium": "own"}, math.inf, True),
        ({"range": 40.0, "jamming": JAMMED}, 40.0, True),
        ({"range": 40.0, "sensitivity": -60.0}, 40.0, True),
        ({"range": 2.0 * FAR}, math.inf, True),
        ({"jamming": JAMMED}, math.inf, True),
        ({"sensitivity": -60.0, "jamming": JAMMED}, math.inf, True),
        ({"sensitivity": -60.0, "exponent": 0.0}, math.inf, True),
        ({"sensitivity": -60.0, "exponent": 0.001}, math.inf, True),
    ],
)
def test_the_reach_of_a_radio(values: dict[str, Any], reach: float, carried: bool) -> None:
    assert reach_of(network(**values)) == reach
    assert carries_positions(network(**values)) == carried


@pytest.mark.parametrize("exponent", [2.0, 3.5])
def test_signals_reach_as_far_as_the_strongest_packet_is_heard(exponent: float) -> None:
    """Friis: each 10 n dB are a factor of ten; the luckiest of 2^53 random numbers adds to it."""
    plain = {"sensitivity": -80.0, "power": 20.0, "path_loss": 30.0, "exponent": exponent}
    assert reach_of(network(**plain)) == pytest.approx(10.0 ** (70.0 / (10.0 * exponent)), rel=1e-6)
    assert reach_of(network(**{**plain, "power": -60.0})) == pytest.approx(1.0)  # no loss within a metre
    lucky = 10.0 * math.log10(-math.log(2.0**-53)) + 4.0 * math.sqrt(-2.0 * math.log(2.0**-53))
    found = reach_of(network(**plain, shadowing=4.0, rayleigh=True))
    assert found == pytest.approx(10.0 ** ((70.0 + lucky) / (10.0 * exponent)), rel=1e-6)


places = st.lists(st.tuples(*[st.floats(-100.0, 100.0)] * 3), min_size=1, max_size=12).map(np.array)


@given(senders=places, nodes=places, reach=st.floats(0.1, 100.0))
def test_what_is_out_of_reach_of_boxes_hears_nothing(senders: Any, nodes: Any, reach: float) -> None:
    promises = Promises(reach, 4)
    beyond = out_of_reach(reach, senders, promises.make(np.array([0]), nodes[None]).boxes)
    distances = np.linalg.norm(senders[:, None] - nodes[None], axis=2).min(axis=1)
    assert (distances[beyond] > reach).all()
    if len(nodes) <= 8:  # a box for each, wider by a hundredth of the reach on all sides
        assert beyond[distances > reach * 1.02 + 1e-6].all()


def test_places_and_boxes_without_end() -> None:
    boxes = np.array([[[0.0] * 3, [1.0] * 3]])
    wrong = np.array([[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], [900.0, 0.0, 0.0]])
    assert out_of_reach(5.0, wrong, boxes).tolist() == [False, False, True]
    assert out_of_reach(5.0, wrong, boxes[:0]).tolist() == [False, False, True]  # a part without nodes
    promises = Promises(5.0, 4)
    everywhere = promises.make(np.array([0]), np.array([[[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]]))
    assert not out_of_reach(5.0, wrong, everywhere.boxes).any()


def test_steady_nodes_keep_their_promises_and_nodes_that_jump_break_them() -> None:
    rng = np.random.default_rng(1)
    start, speed = rng.uniform(-50.0, 50.0, (20, 3)), rng.uniform(-0.1, 0.1, (20, 3))
    promises, window = Promises(10.0, 4), 4
    for w in range(250):  # groups change meanwhile
        steps = np.arange(window * w, window * (w + 1) + 1)
        at = start + speed * steps[:, None, None]
        assert not promises.broken(at[1:])
        promises.make(steps, at)
    at[-1, 3, 1] += 5.0
    assert promises.broken(at[-1:])
    promises.make(steps, at)  # from where it is now, with the speed of the jump
    assert promises.broken(at[-1:])  # the promise before it holds for two windows
    promises.make(steps, at)
    assert not promises.broken(at[-1:])


def test_a_promise_holds_to_the_edge() -> None:
    one = Promise(np.array([[[0.0] * 3, [1.0] * 3]]), np.array([0]))
    assert one.kept(np.array([[[0.0, 1.0, 0.5]]]))
    assert not one.kept(np.array([[[0.0, 1.0 + 1e-9, 0.5]]]))
    assert not one.kept(np.array([[[0.0, np.nan, 0.5]]]))

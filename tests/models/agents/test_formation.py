"""Formations by displacement consensus: every shape, its rate, a leader; with loss, and when drones come and go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim_models.agents.formation import FormationFlight, Shape, formation, place_of
from tests.models.agents.point_masses import Array, PointMasses

GAIN = 0.1


def places(n: int, shape: Shape, **parameters: Any) -> Array:
    """Of all members, in plain Python."""
    m = FormationFlight.record()
    for name, value in {"form": shape, "members": n, **parameters}.items():
        m[name] = value
    return np.array([place_of(m, number) for number in range(n)])


def chain(n: int, reach: int = 1) -> Any:
    """Who hears whom: those at most `reach` numbers apart."""
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return (apart <= reach) & (apart > 0)


def masses(n: int, shape: Shape, graph: Any, **more: Any) -> PointMasses:
    starts = np.random.default_rng(5).uniform(-60.0, 60.0, (n, 2))
    given = {"gain": GAIN, "speed_limit": 1e5, **more}
    return PointMasses(FormationFlight, formation, starts, hears=graph, form=shape, members=n, **given)


def error(swarm: PointMasses, wanted: Array) -> float:
    """The largest distance of a drone from its place, wherever the formation is [m]."""
    away = swarm.plane - wanted
    return float(np.linalg.norm(away - away[swarm.alive].mean(axis=0), axis=1)[swarm.alive].max())


def test_places_of_the_shapes() -> None:
    assert places(3, Shape.line, spacing=4.0) == pytest.approx(np.array([[0, 0], [0, 4], [0, 8]]))
    assert places(4, Shape.ring, spacing=np.sqrt(2.0)) == pytest.approx(np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]))
    assert places(5, Shape.grid, spacing=2.0) == pytest.approx(np.array([[0, 0], [0, 2], [0, 4], [-2, 0], [-2, 2]]))
    s = np.sqrt(0.5)
    assert places(5, Shape.v, spacing=1.0) == pytest.approx(
        np.array([[0, 0], [-s, -s], [-s, s], [-2 * s, -2 * s], [-2 * s, 2 * s]])
    )
    turned = places(3, Shape.line, spacing=4.0, heading=0.5 * np.pi)  # ahead is east, right is south
    assert turned == pytest.approx(np.array([[0, 0], [-4, 0], [-8, 0]]), abs=1e-12)
    table = {"place_north": np.arange(32.0), "place_east": -np.arange(32.0)}
    assert places(2, Shape.table, **table) == pytest.approx(np.array([[0, 0], [1, -1]]))


@pytest.mark.parametrize(
    ("shape", "loss", "off", "rel"),
    [
        *((shape, 0.0, 1e-6, 0.03) for shape in (Shape.line, Shape.ring, Shape.grid, Shape.v)),
        (Shape.grid, 0.2, 1.0, 0.1),
    ],
)
def test_a_hundred_take_their_places_about_the_mean_of_their_starts(
    shape: Shape, loss: float, off: float, rel: float
) -> None:
    """The rate is that of the graph, whatever the shape; with loss, the mean moves a little."""
    wanted = places(100, shape)
    graph = chain(100, reach=8)
    slowest = np.linalg.eigvalsh(np.diag(graph.sum(axis=1)) - graph)[1]
    swarm = masses(100, shape, graph, gain=0.25, loss=loss)
    middle = (swarm.plane - wanted).mean(axis=0)
    swarm.run(60.0)
    first = error(swarm, wanted)
    swarm.run(20.0)
    assert np.log(error(swarm, wanted) / first) / 20.0 == pytest.approx(-0.25 * slowest, rel=rel)
    assert (swarm.plane - wanted).mean(axis=0) == pytest.approx(middle, abs=off)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_five_follow_a_leader_without_lagging_behind(loss: float) -> None:
    wanted = places(5, Shape.v)
    swarm = masses(
        5, Shape.v, chain(5, reach=2), loss=loss, lag=0.5, leader=1, leader_velocity=(2.0, 1.0), speed_limit=8.0
    )
    swarm.run(120.0)
    assert np.linalg.norm(swarm.plane - swarm.plane[0] - (wanted - wanted[0]), axis=1).max() < 0.2
    assert swarm.m.velocity[:, :2] == pytest.approx(np.tile((2.0, 1.0), (5, 1)), abs=0.02)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_those_that_are_left_close_up_to_their_places_and_a_late_one_joins(loss: float) -> None:
    wanted = places(6, Shape.ring)
    swarm = masses(6, Shape.ring, ~np.eye(6, dtype=bool), lag=0.5, loss=loss)
    swarm.alive[5] = False
    swarm.run(40.0)
    assert error(swarm, wanted) < 0.1
    swarm.alive[[0, 5]] = False, True  # 0 fails, 5 takes off
    swarm.run(60.0)
    assert error(swarm, wanted) < 0.1
    swarm.alive[0] = True
    swarm.run(60.0)
    assert error(swarm, wanted) < 0.1


def test_an_id_outside_of_the_formation_and_a_table_too_small_are_errors() -> None:
    for parameters, code in (({"sysid": 6}, 10), ({"form": Shape.table, "members": 33}, 11)):
        m = FormationFlight.record()
        for name, value in parameters.items():
            m[name] = value
        assert formation(m, 0.0, 0.2) == -code
        assert code in FormationFlight.errors

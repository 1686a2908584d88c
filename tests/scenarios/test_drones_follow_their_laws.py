"""Systems of the laws with drones of 6 degrees of freedom, each once, and once more over a radio that loses 20 %."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from lxml import etree
from numpy.typing import NDArray

from cosim_master import RunOptions, simulate
from tests.scenarios.flights import OF_FIVE, SYSTEMS, Flight, copy_of, fly

Array = NDArray[np.float64]
BEGIN = 20.0


@pytest.fixture(scope="module", params=["0", "0.2"], ids=["no loss", "20 % lost"])
def flown(request: pytest.FixtureRequest, fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Flies a system, once for each loss."""
    flights: dict[str, Flight] = {}

    def flight(system: str) -> Flight:
        if system not in flights:
            out = tmp_path_factory.mktemp(system) / "run"
            flights[system] = fly(SYSTEMS / system, out, overrides={"network.loss": request.param})
            assert json.loads((out / "manifest.json").read_text())["verdict"]["good"] is True
        return flights[system]

    return flight


def places(flight: Flight) -> Array:
    """Time, drone, north and east [m]."""
    drones = sum(name.endswith("vehicle.position[1]") for name in flight.signals)
    axes = [[flight[f"drone{i}.vehicle.position[{k}]"] for k in (1, 2)] for i in range(1, drones + 1)]
    return np.moveaxis(np.array(axes), 2, 0)


def separation(way: Array) -> Array:
    """The smallest distance of any two at every time [m]."""
    away = np.linalg.norm(way[:, :, None] - way[:, None], axis=3)
    away[:, np.arange(way.shape[1]), np.arange(way.shape[1])] = np.inf
    return np.asarray(away.min(axis=(1, 2)))


def test_five_fly_in_a_v(flown: Callable[[str], Flight]) -> None:
    way = places(flown("formation"))
    s = 12.0 * np.sqrt(0.5)
    wanted = np.array([[0, 0], [-s, -s], [-s, s], [-2 * s, -2 * s], [-2 * s, 2 * s]])
    assert way[-1] - way[-1, 0] == pytest.approx(wanted, abs=0.5)
    assert way[-1, 0] == pytest.approx((2.0 * 40.0, 0.0), abs=2.0)
    assert separation(way).min() > 8.0


def test_five_take_the_places_of_a_file(fmus: Path, tmp_path: Path) -> None:
    """Of the system's parameter file, over a radio that loses 20 %: an arrow behind its leader."""
    wanted = np.array([[0.0, 0.0], [-9.0, -9.0], [-9.0, 9.0], [-12.0, 0.0], [-24.0, 0.0]])
    folder = copy_of("formation", tmp_path, fmus)
    file = folder / "formation.ssv"
    table = "".join(
        f'<ssv:Parameter name="drone{i}.agent.place_{axis}[{n}]"><ssv:Real value="{place[k]}"/></ssv:Parameter>\n'
        for i in range(1, 6)
        for n, place in enumerate(wanted.tolist(), 1)
        for k, axis in enumerate(("north", "east"))
    )
    text = file.read_text(encoding="utf-8")
    assert text.count('value="v"') == 5
    file.write_text(
        text.replace('value="v"', 'value="table"').replace("</ssv:Parameters>", f"{table}</ssv:Parameters>")
    )
    way = places(fly(folder, tmp_path / "out", overrides={"network.loss": "0.2"}))
    assert way[-1] - way[-1, 0] == pytest.approx(wanted, abs=0.5)


def test_six_cover_a_field(flown: Callable[[str], Flight]) -> None:
    """The cost of all cells together decreases, and everybody ends in the middle of a third of a half."""
    flight = flown("coverage")
    cost = sum(flight[f"drone{i}.agent.cost"] for i in range(1, 7))
    during = flight["time"] > BEGIN + 1.0
    assert np.diff(cost[during]).max() < 0.002 * cost[during][0]
    sixth = 100.0**2 / 6.0
    best = 6.0 * sixth * (50.0**2 + (100.0 / 3.0) ** 2) / 12.0
    assert best * 0.999 < cost[-1] < 1.02 * best
    assert np.sort(places(flight)[-1, :, 1]) == pytest.approx([-100 / 3, -100 / 3, 0, 0, 100 / 3, 100 / 3], abs=1.0)


def test_five_flock_past_a_cylinder(flown: Callable[[str], Flight]) -> None:
    flight = flown("flocking")
    way = places(flight)
    assert separation(way).min() > 6.0
    assert (np.linalg.norm(way - (35.0, 14.0), axis=2) - 5.0).min() > 1.0
    velocity = (way[-1] - way[-101]) / 10.0
    assert velocity == pytest.approx(np.tile((1.5, 0.0), (5, 1)), abs=0.4)
    assert separation(way)[-1] == pytest.approx(10.0, abs=0.3)
    assert (way[-1, :, 0] > 40.0).all()


def test_three_follow_as_arducopter_does(flown: Callable[[str], Flight]) -> None:
    """10 m behind and 2.225 m more at 2 m/s: v^2 / 2 a + a / 2 P^2 with a = 1.25 m/s2, P = 1 /s."""
    way = places(flown("follower"))[-1]
    assert way[1:3] - way[0] == pytest.approx(np.array([[6.0, -12.2], [-6.0, -12.2]]), abs=0.35)
    assert way[3] - way[2] == pytest.approx((0.0, -12.2), abs=0.35)


def test_four_circle_a_fifth_at_equal_angles(flown: Callable[[str], Flight]) -> None:
    flight = flown("tracking")
    way = places(flight)
    n, e = (way[-1, :4] - way[-1, 4]).T
    assert np.hypot(n, e) == pytest.approx(np.full(4, 15.0), abs=1.0)
    angles = np.sort(np.arctan2(e, n))
    assert np.diff(angles) == pytest.approx(np.full(3, 0.5 * np.pi), abs=0.1)
    assert way[-1, 4] - way[-101, 4] == pytest.approx((8.0, 6.0), abs=0.5)  # at 1 m/s, for 10 s
    assert separation(way[:, :4]).min() > 4.0


def test_three_complete_the_sweep_after_the_fourth_has_landed(flown: Callable[[str], Flight]) -> None:
    """Every cell has had a drone within 0.3 of it to its middle, by the true positions."""
    flight = flown("sweep")
    cells = (places(flight)[flight["time"] > BEGIN] + 40.0) / 10.0
    index = np.floor(cells).astype(int)
    near = (np.abs(cells - index - 0.5) <= 0.35).all(axis=2) & (index >= 0).all(axis=2) & (index < 8).all(axis=2)
    visited = {tuple(cell) for cell in index[near]}
    assert len(visited) == 64
    assert [flight[f"drone{i}.agent.swept"][-1] for i in (1, 2, 3)] == [1.0, 1.0, 1.0]
    assert flight["drone4.vehicle.position[3]"][-1] == pytest.approx(0.0, abs=0.1)
    assert 0.2 < flight["drone4.agent.swept"][-1] < 1.0


def test_five_keep_their_distance_and_their_leader_stops_at_the_fence(flown: Callable[[str], Flight]) -> None:
    """They exchange their places on the way; without the guard two of them would come within 2.5 m of each other."""
    way = places(flown("guarded"))
    assert separation(way).min() > 5.5
    assert way[..., 0].max() < 45.5
    assert way[-1, 0] == pytest.approx((45.0, 0.0), abs=0.3)
    s = 12.0 * np.sqrt(0.5)
    assert way[-1, 1:, 1] == pytest.approx([-s, s, -2.0 * s, 2.0 * s], abs=0.5)


SCENARIOS = (
    "rendezvous", "formation", "coverage", "flocking", "flocking-points", "follower", "tracking", "sweep", "guarded",
    "windy",
)  # fmt: skip


def test_these_are_all_scenarios() -> None:
    """Those of the line have tests of their own: test_run_is_repeated and test_run_is_resumed."""
    assert {one.name for one in SYSTEMS.iterdir() if not one.name.startswith("line5")} == set(SCENARIOS)


def backwards(text: str) -> str:
    """The same system, its components in the opposite order."""
    root = etree.fromstring(text.encode())
    (elements,) = root.findall("{*}System/{*}Elements")
    assert len(elements) > 2
    elements[:] = [*reversed(elements)]
    return str(etree.tostring(root, encoding="unicode"))


@pytest.mark.parametrize("system", SCENARIOS)
def test_a_run_has_the_same_bits_with_two_threads_when_it_is_resumed_and_in_any_order(
    system: str, fmus: Path, tmp_path: Path
) -> None:
    agent = "vehicle" if system == "flocking-points" else "agent"
    given: dict[str, Any] = {"until": 16.0, "checkpoint_every": 14.0}
    if system == "windy":
        given["record"] = OF_FIVE
    lossy = {"network.loss": "0.2", f"drone*.{agent}.first_step_time": "12"}  # when all have taken off
    simulate(SYSTEMS / system, RunOptions(out=tmp_path / "whole", threads=1, overrides=lossy, **given))
    simulate(SYSTEMS / system, RunOptions(out=tmp_path / "threads", threads=2, overrides=lossy, **given))
    simulate(SYSTEMS / system, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'whole'}@14", **given))
    other = copy_of(system, tmp_path, fmus, backwards)
    simulate(other, RunOptions(out=tmp_path / "backwards", threads=2, overrides=lossy, **given))
    for name in ("signals.parquet", "packets.parquet"):
        expected = (tmp_path / "whole" / name).read_bytes()
        assert (tmp_path / "threads" / name).read_bytes() == expected
        assert (tmp_path / "rest" / name).read_bytes() == expected
        assert (tmp_path / "backwards" / name).read_bytes() == expected
    step = f"drone1.{agent}.step"
    assert pq.read_table(tmp_path / "whole" / "signals.parquet", columns=[step])[step][-1].as_py() > 1

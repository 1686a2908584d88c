"""Wind, wakes, ground and contacts act on flying drones; `Swarm.environment` connects them with all drones."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master import Swarm
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe
from cosim_master.stepping.observation import Progress
from cosim_master.system.authoring.swarm.surroundings import SharedPorts
from tests.scenarios.flights import Flight, fly

Places = list[tuple[float, float]]


@pytest.fixture(scope="module")
def flown(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Flight]:
    """Flies drones that stay at their places, in an environment."""
    numbers = itertools.count()

    def flown(places: Places, until: float = 15.0, altitudes: tuple[float, ...] = (), **values: Any) -> Flight:
        folder = tmp_path_factory.mktemp(f"surroundings{next(numbers)}")
        swarm = Swarm("some", network={"topology": "broadcast"}, stop_time=until)
        for place, altitude in itertools.zip_longest(places, altitudes, fillvalue=10.0):
            assert isinstance(place, tuple) and isinstance(altitude, float)
            swarm.add(position=place, stays=True, values={"agent.altitude": altitude})
        swarm.environment("Airspace", values=values)
        return fly(swarm.save(folder / "system"), folder / "out")

    return flown


def test_a_drone_below_another_loses_height(flown: Callable[..., Flight]) -> None:
    """Drone 2 climbs to 1 m below drone 1, whose wake pushes it down; drone 3, at the same height beside, stays."""
    places = [(0.0, 0.0), (0.0, 0.0), (0.0, 20.0)]
    blown = flown(places, altitudes=(6.0, 5.0, 5.0), downwash=True)
    late = blown["time"] > 12.0
    assert blown.up(3)[late] == pytest.approx(5.0, abs=0.1)
    assert blown.up(2)[late].max() < 4.5
    wind = blown["environment.wind[6]"][late]
    # between once and twice the induced velocity of the weight, at 0.4 to 3 m below: momentum theory
    induced = np.sqrt(1.545 * 9.80665 / (2.0 * 1.225 * 0.2027))
    assert induced < wind.max() <= 2.0 * induced
    assert not blown["environment.wind[9]"].any()


def test_near_the_ground_less_thrust_carries_the_drone(flown: Callable[..., Flight]) -> None:
    """Thrust at the same speed of the rotors is that of Cheeseman and Bennett, so they turn slower by its root."""
    free, near = (flown([(0.0, 0.0)], 16.0, (0.5,), ground_effect=on) for on in (False, True))
    late = near["time"] > 15.0
    speeds = [
        np.mean([flight[f"drone1.vehicle.rotor_speed[{i}]"][late] for i in (1, 2, 3, 4)]) for flight in (free, near)
    ]
    height = near.up(1)[late].mean()
    radius = np.sqrt(0.2027 / np.pi)
    ratio = 1.0 / (1.0 - (radius / (4.0 * height)) ** 2)
    assert ratio > 1.008
    assert (speeds[0] / speeds[1]) ** 2 == pytest.approx(ratio, rel=3e-4)


def test_drones_lean_into_turbulence_and_repeat_it_to_the_bit(fmus: Path, tmp_path: Path) -> None:
    """The same seed gives the same bytes with one thread and with two, and after an interruption; another does not."""

    def system(name: str, seed: int) -> Path:
        swarm = Swarm("some", network={"topology": "broadcast"}, stop_time=4.0)
        swarm.environment(
            "Airspace",
            values={"mean_wind": (3.0, 1.0, 0.0), "turbulence_wind": 6.0, "gust": (0.0, 2.0, 0.0), "seed": seed},
        )
        swarm.add(position=(0.0, 0.0), stays=True)
        swarm.add(position=(0.0, 3.0), stays=True, vehicle="PointMass")
        return swarm.save(tmp_path / name)

    def recorded(name: str) -> bytes:
        return (tmp_path / name / "signals.parquet").read_bytes()

    def interrupt(progress: Progress) -> None:
        if progress.time >= 2.0:
            raise KeyboardInterrupt

    one, record = system("one-system", 1), ("drone*", "environment.*[?]")  # of both drones
    first = fly(one, tmp_path / "first", threads=1, checkpoint_every=1.0, record=record)
    fly(one, tmp_path / "second", threads=2, checkpoint_every=1.0, record=record)
    simulate(
        one,
        RunOptions(out=tmp_path / "half", checkpoint_every=1.0, record=record),
        listener=Listener(progress=interrupt),
    )
    last = max(float(folder.name) for folder in (tmp_path / "half" / "checkpoints").iterdir())
    simulate(
        one,
        RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'half'}@{last:g}", checkpoint_every=1.0, record=record),
    )
    assert recorded("first") == recorded("second") == recorded("rest")
    other = fly(system("other-system", 2), tmp_path / "other", record=record)
    winds = [flight["environment.wind[1]"] for flight in (first, other)]
    assert not np.array_equal(*winds)
    assert winds[0][0] == 3.0 and 0.2 < np.std(winds[0]) < 4.0


def test_a_large_airspace_moves_drones_as_a_small_one(fmus: Path, tmp_path: Path) -> None:
    def flown(model: str) -> Flight:
        swarm = Swarm("some", network={"topology": "broadcast"}, stop_time=1.0)
        swarm.add(position=(0.0, 0.0), stays=True, vehicle="PointMass", values={"vehicle.drag_time": 2.0})
        swarm.add(position=(0.0, 0.5), stays=True)
        swarm.environment(model, values={"mean_wind": (3.0, 1.0, 0.0), "turbulence_wind": 6.0, "contact": True})
        return fly(swarm.save(tmp_path / f"{model}-system"), tmp_path / model, record=("drone*.vehicle.*",))

    small, large = flown("Airspace"), flown("LargeAirspace")
    assert small.signals.keys() == large.signals.keys()
    assert all(np.array_equal(small[name], large[name]) for name in small.signals)
    assert abs(small.east(2)[-1] - 0.5) > 0.01  # the contact has pushed it


def test_drones_collide_with_each_other_and_with_a_wall(flown: Callable[..., Flight]) -> None:
    """Two that begin at 0.6 m from each other are pushed to 0.7 m and more, a third out of a wall; then they fly."""
    wall = {"box_north": (20.0, *[0.0] * 7), "box_length": (4.0, *[1.0] * 7), "box_height": (9.0, *[1.0] * 7)}
    flight = flown([(0.0, 0.0), (0.0, 0.6), (17.8, 0.0)], 9.0, contact=True, boxes=1, **wall)
    gap = flight.east(2) - flight.east(1)
    assert gap[0] == 0.6 and 0.7 < gap[-1] < 1.0
    north = flight["drone3.vehicle.position[1]"]
    assert north[0] == 17.8 and 16.0 < north[-1] < 17.65
    assert flight["environment.force[7]"][-1] == 0.0
    assert flight.up(3)[-1] > 2.0


def test_what_cannot_be_an_environment_is_said(fmus: Path) -> None:
    swarm = Swarm("some", network={"topology": "broadcast"})
    swarm.add("rover", vehicle="Rover", position=(0.0, 0.0))
    with pytest.raises(SystemDescriptionError, match="environment: has no port in common with rover"):
        swarm.environment("Flocking")
    swarm.environment("Airspace", name="air")
    assert "Rover.fmu has no thrust_factor: Airspace.fmu does not act on it by these" in swarm.notes
    airspace, body = (describe(fmus / f"{name}.fmu") for name in ("Airspace", "Quadrotor"))
    shared = SharedPorts(airspace)
    assert [one[0][-1] for one in shared.of(body, 255)][:2] == ["position[768]", "velocity[768]"]
    too_many = "has 768 elements of position, for at most 256 drones; take an FMU with more elements"
    with pytest.raises(ValueError, match=too_many):
        list(shared.of(body, 256))

"""Every vehicle takes the place of drone 3 of `line5` by `swap` alone; the verdict says what one cannot do there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from cosim.build import models_of_package
from cosim_master import RunOptions, simulate
from cosim_master.system.authoring.swap import swap
from cosim_master.system.authoring.swarm.new import fleet_of, new_system
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.models.copter import PRESETS
from tests.scenarios.flights import SYSTEMS, Flight, fly


@dataclass(frozen=True)
class Place:
    """Where drone 3 is at the end, and how far the others and it may be from 25, 50 and 75 m.

    A rover rests where its target, two thirds of the way to the middle of its neighbours, is nearer than WP_RADIUS (2
    m): 3 m from that middle. The neighbours are half as far from their places as it is from its own: 3 and 6 m.

    `height`: of its flight. `findings`: kinds of what the verdict says.
    """

    tolerance: float
    own: float
    height: float = 10.0
    findings: frozenset[str] = frozenset()


GROUND = frozenset({"never flew"})
PLACES = {
    "Quadrotor": Place(1.0, 1.0),
    "LinearQuadrotor": Place(1.0, 1.0),
    "Hexarotor": Place(1.0, 1.0),
    "Octorotor": Place(1.0, 1.0),
    "Y6": Place(1.0, 1.0),
    "PointMass": Place(1.0, 1.0),
    "Rover": Place(3.1, 6.1, 0.0, GROUND),
    "Boat": Place(3.1, 6.1, 0.0, GROUND),
    "FixedWing": Place(30.0, 85.0),
    "Quadplane": Place(1.0, 1.0),
}


@pytest.fixture(scope="module")
def flights(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Flight]:
    """The flights by the FMU of drone 3."""
    folder = tmp_path_factory.mktemp("vehicles")
    found = {}
    for name in PLACES:
        swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / f"{name}.fmu", folder / name)
        record = ("drone*.vehicle.position*", "drone3.agent.failure", "drone3.agent.step")
        found[name] = fly(swapped, folder / f"{name}-out", record=record)
    return found


def test_these_are_all_vehicles() -> None:
    """A vehicle is a model that tells its airframe; no model of the package is left out."""
    models = models_of_package("cosim_models.vehicles")
    tell = {one.__name__ for one in models if any(v.name == "airframe" and v.role == "output" for v in one.variables)}
    assert tell == set(PLACES)
    assert {one.__name__ for one in models} - tell == {"PowerSystem"}


@pytest.mark.parametrize("name", PLACES)
def test_it_takes_the_place_of_a_quadrotor(name: str, flights: dict[str, Flight]) -> None:
    flight, place = flights[name], PLACES[name]
    assert flight["drone3.agent.failure"][-1] == 0
    assert flight["drone3.agent.step"][-1] == 19
    ends = [float(flight.east(drone)[-1]) for drone in (1, 2, 4, 5)]
    assert ends == pytest.approx([0.0, 25.0, 75.0, 100.0], abs=place.tolerance)
    assert abs(flight.east(3)[-1] - 50.0) < place.own
    assert flight.up(3)[-1] == pytest.approx(place.height, abs=0.3)
    for drone in (1, 2, 4, 5):
        assert flight.up(drone)[-1] == pytest.approx(10.0, abs=0.1)
    judged = {one.kind for one in flight.result.verdict.findings if "drone3" in " ".join(one.who)}
    assert judged >= place.findings
    if not place.findings and name != "FixedWing":
        assert not judged


def bound(name: str) -> dict[str, str]:
    """The parameters of a preset as texts, for drone 3."""
    root = etree.fromstring((PRESETS / f"{name}.ssv").read_bytes())
    return {f"drone3.vehicle.{one.get('name')}": one[0].get("value") for one in root[0]}


@pytest.mark.parametrize(
    ("vehicle", "name", "place"),
    [
        ("Quadrotor", "rotors_iris", PLACES["Quadrotor"]),
        ("Quadrotor", "ardupilot_gazebo_iris", PLACES["Quadrotor"]),
        ("Quadrotor", "ardupilot_sitl_quad", PLACES["Quadrotor"]),
        ("Hexarotor", "ardupilot_sitl_hexa", PLACES["Hexarotor"]),
        ("Y6", "ardupilot_sitl_y6", PLACES["Y6"]),
        ("Rover", "ardupilot_rover_skid", PLACES["Rover"]),
        ("Octorotor", "mrs_naki_octa", PLACES["Octorotor"]),
        ("Boat", "vrx_wamv", PLACES["Boat"]),
        ("PointMass", "px4_iris_point", PLACES["PointMass"]),
        ("PointMass", "crazyflie_point", PLACES["PointMass"]),
    ],
)
def test_its_presets_fly_too(vehicle: str, name: str, place: Place, fmus: Path, tmp_path: Path) -> None:
    swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / f"{vehicle}.fmu", tmp_path / "system")
    flight = fly(swapped, tmp_path / "out", overrides=bound(name))
    ends = [float(flight.east(drone)[-1]) for drone in (1, 2, 4, 5)]
    assert ends == pytest.approx([0.0, 25.0, 75.0, 100.0], abs=place.tolerance)
    assert abs(flight.east(3)[-1] - 50.0) < place.own
    assert flight.up(3)[-1] == pytest.approx(place.height, abs=0.3)
    judged = {one.kind for one in flight.result.verdict.findings if "drone3" in " ".join(one.who)}
    assert judged == place.findings


GAINS: dict[str, tuple[str, dict[str, float]]] = {
    "crazyflie": (
        "Quadrotor",
        {"RLL_P": 0.0225, "RLL_I": 0.0225, "RLL_D": 0.0006, "PIT_P": 0.0225, "PIT_I": 0.0225, "PIT_D": 0.0006}
        | {"YAW_P": 0.008, "YAW_I": 0.0008},
    ),
    "authors_line": (
        "LinearQuadrotor",
        {"RLL_P": 0.003, "RLL_I": 0.003, "RLL_D": 0.0, "PIT_P": 0.003, "PIT_I": 0.003, "PIT_D": 0.0}
        | {"YAW_P": 0.0005, "YAW_I": 0.00005},
    ),
    "authors_voronoi": (
        "LinearQuadrotor",
        {"RLL_P": 0.5, "RLL_I": 0.5, "RLL_D": 0.0, "PIT_P": 0.65, "PIT_I": 0.65, "PIT_D": 0.0}
        | {"YAW_P": 1.0, "YAW_I": 0.1},
    ),
}
"""The vehicle of a preset, and the gains of its table in docs/vehicles.md."""


@pytest.mark.parametrize("name", GAINS)
def test_presets_that_need_other_gains_fly_with_them(name: str, fmus: Path, tmp_path: Path) -> None:
    vehicle, gains = GAINS[name]
    overrides = bound(name) | {f"drone3.autopilot.ATC_RAT_{gain}": str(value) for gain, value in gains.items()}
    swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / f"{vehicle}.fmu", tmp_path / "system")
    flight = fly(swapped, tmp_path / "out", overrides=overrides)
    ends = [float(flight.east(drone)[-1]) for drone in (1, 2, 3, 4, 5)]
    assert ends == pytest.approx([0.0, 25.0, 50.0, 75.0, 100.0], abs=1.0)
    assert flight.up(3)[-1] == pytest.approx(10.0, abs=0.1)
    x, y = (flight[f"drone3.vehicle.attitude[{i}]"] for i in (2, 3))
    assert math.degrees(2.0 * math.asin(float(np.hypot(x, y).max()))) < 30.0
    late = flight["time"] > 60.0
    for axis in (1, 2, 3):
        assert np.abs(flight[f"drone3.vehicle.angular_velocity[{axis}]"][late]).max() < 1.0
    assert not [one for one in flight.result.verdict.findings if "drone3" in " ".join(one.who)]


def test_the_preset_of_a_slower_plane_flies_with_its_speeds(fmus: Path, tmp_path: Path) -> None:
    """ArduPilot's plane, with the speeds of its table in docs/vehicles.md, circles its place in the line."""
    speeds = {"AIRSPEED_CRUISE": 16, "AIRSPEED_MIN": 12, "AIRSPEED_MAX": 20}
    throttles = {"TRIM_THROTTLE": 70, "THR_MAX": 100, "TKOFF_THR_MAX": 100}
    overrides = bound("ardupilot_plane") | {f"drone3.autopilot.{k}": str(v) for k, v in (speeds | throttles).items()}
    swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / "FixedWing.fmu", tmp_path / "system")
    flight = fly(swapped, tmp_path / "out", overrides=overrides)
    late = flight["time"] > 60.0
    velocity = [flight[f"drone3.vehicle.velocity[{i}]"][late] for i in (1, 2, 3)]
    assert np.sqrt(sum(v * v for v in velocity)) == pytest.approx(16.0, abs=0.5)
    assert flight.up(3)[late] == pytest.approx(10.0, abs=0.5)
    target = flight["drone3.agent.target"][late]
    radius = np.hypot(flight.east(3)[late] - target, flight["drone3.vehicle.position[1]"][late])
    assert radius[-1] == pytest.approx(88.5, abs=10.0)  # around a place at rest, it slips 8.5 m out
    ends = [float(flight.east(drone)[-1]) for drone in (1, 2, 4, 5)]
    assert ends == pytest.approx([0.0, 25.0, 75.0, 100.0], abs=PLACES["FixedWing"].tolerance)


def test_the_preset_of_another_quadplane_flies_with_its_gains(fmus: Path, tmp_path: Path) -> None:
    """PX4's standard VTOL, with the parameters of its table in docs/vehicles.md."""
    gains = {"Q_A_RAT_RLL_P": 0.06, "Q_A_RAT_RLL_I": 0.03, "Q_A_RAT_YAW_P": 0.08, "Q_M_THST_HOVER": 0.274}
    motors = {"Q_M_THST_EXPO": 1, "Q_M_SPIN_MIN": 0, "Q_M_SPIN_MAX": 1, "AIRSPEED_CRUISE": 15, "TRIM_THROTTLE": 55}
    overrides = bound("px4_standard_vtol") | {f"drone3.autopilot.{k}": str(v) for k, v in (gains | motors).items()}
    swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / "Quadplane.fmu", tmp_path / "system")
    flight = fly(swapped, tmp_path / "out", overrides=overrides)
    ends = [float(flight.east(drone)[-1]) for drone in (1, 2, 3, 4, 5)]
    assert ends == pytest.approx([0.0, 25.0, 50.0, 75.0, 100.0], abs=1.0)
    assert flight.up(3)[-1] == pytest.approx(10.0, abs=0.1)
    assert not [one for one in flight.result.verdict.findings if "drone3" in " ".join(one.who)]


def test_a_mixed_fleet_of_six_classes_flies(fmus: Path, tmp_path: Path) -> None:
    """`new` gives every vehicle the autopilot that accepts it; each class comes to its place in the line."""
    vehicles = "2xQuadrotor,1xRover,1xPointMass,1xFixedWing,1xBoat,1xY6,1xQuadplane,1xQuadrotor"
    system = new_system(
        "line", 9, tmp_path / "mixed", fmus=fmus, fleet={"vehicle": fleet_of(vehicles)}, spacing=20.0, until=60.0
    )
    kinds = {path.name for path in system.glob("*.ssd")}
    assert len(kinds) == 8  # the root, and one for each kind of drone
    flight = fly(system, tmp_path / "out")
    assert [int(flight[f"drone{i}.agent.failure"][-1]) for i in range(1, 10)] == [0] * 9
    heights = [float(flight.up(i)[-1]) for i in range(1, 10)]
    assert heights == pytest.approx([10, 10, 0, 10, 10, 0, 10, 10, 10], abs=1.0)
    late = flight["time"] > 40.0  # the plane circles, and those beside it follow it to and fro
    for i, reach in enumerate((0.1, 1.0, 5.0, 5.0, 10.0, 10.0, 2.0, 1.0, 0.1), start=1):
        behind = flight.east(i)[late] - flight[f"drone{i}.agent.target"][late]
        assert float(behind.mean()) == pytest.approx(0.0, abs=reach)
    assert {one.who for one in flight.result.verdict.findings if one.kind == "never flew"} == {
        ("drone3.vehicle",),
        ("drone6.vehicle",),
    }


def test_a_mixed_fleet_has_the_same_bits_with_two_threads_and_when_it_is_resumed(fmus: Path, tmp_path: Path) -> None:
    """The checkpoint is within the take-offs."""
    vehicles = fleet_of("1xQuadplane,1xRover,1xPointMass,1xFixedWing,1xQuadrotor")
    system = new_system("line", 5, tmp_path / "mixed", fmus=fmus, fleet={"vehicle": vehicles}, spacing=20.0, until=9.0)
    fly(system, tmp_path / "whole", threads=1, checkpoint_every=6.0)
    fly(system, tmp_path / "threads", threads=2, checkpoint_every=6.0)
    simulate(system, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'whole'}@6", checkpoint_every=6.0))
    for name in ("signals.parquet", "packets.parquet"):
        expected = (tmp_path / "whole" / name).read_bytes()
        assert (tmp_path / "threads" / name).read_bytes() == expected
        assert (tmp_path / "rest" / name).read_bytes() == expected


def test_any_class_takes_the_place_of_any_other(fmus: Path, tmp_path: Path) -> None:
    """Each class after each other one: the system is initialised, and drone 3 has the autopilot that it needs."""
    pilots = {
        "Quadrotor": "Autopilot",
        "PointMass": "IdealAutopilot",
        "Rover": "RoverAutopilot",
        "FixedWing": "PlaneAutopilot",
        "Quadplane": "QuadplaneAutopilot",
    }
    for first in pilots:
        start = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / f"{first}.fmu", tmp_path / first)
        for second in pilots.keys() - {first}:
            folder = swap(start, "drone3.vehicle", fmus / f"{second}.fmu", tmp_path / f"{first}-{second}")
            with read_system(folder) as structure:
                found = {one.name: one.fmu.path.stem for one in check(structure).instances if "drone3" in one.name}
            assert found["drone3.vehicle"] == second and found["drone3.autopilot"] == pilots[second]
            assert fly(folder, tmp_path / f"{first}-{second}-out", until=0.1)["time"][-1] == 0.1


def test_swapping_back_finds_the_first_autopilot(fmus: Path, tmp_path: Path) -> None:
    told: list[str] = []
    rover = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / "Rover.fmu", tmp_path / "rover", told.append)
    back = swap(rover, "drone3.vehicle", fmus / "Quadrotor.fmu", tmp_path / "back", told.append)
    assert told == [
        "drone3.autopilot is now RoverAutopilot: Autopilot does not accept Rover",
        "drone3.autopilot is now Autopilot: RoverAutopilot does not accept Quadrotor",
    ]
    a, b = fly(back, tmp_path / "a", until=5.0), fly(SYSTEMS / "line5", tmp_path / "b", until=5.0)
    assert (a.folder / "signals.parquet").read_bytes() == (b.folder / "signals.parquet").read_bytes()

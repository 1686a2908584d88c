"""The system `windy`: an airspace around the five drones of the line, each with a battery."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

from cosim_master import Swarm
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe
from cosim_master.stepping.observation import Progress
from cosim_master.system.authoring.swarm.drone import wired_by_name
from cosim_master.system.authoring.swarm.new import new_system
from tests.scenarios.flights import OF_FIVE, SYSTEMS, Flight, copy_of, fly
from tests.scenarios.test_battery_ends_a_flight import with_power

DRONES = range(1, 6)
WINDY = SYSTEMS / "windy"
STARTS = ((0.0, 10.0), (10.0, 12.0), (10.8, 8.0), (50.0, 10.0), (100.0, 10.0))
"""East and altitude of each drone, m."""
FILES = ("signals.parquet", "packets.parquet", "packets.tlog")


@pytest.fixture(scope="module")
def flight(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return fly(WINDY, tmp_path_factory.mktemp("windy") / "out", record=OF_FIVE)


@pytest.fixture
def other(fmus: Path, tmp_path: Path) -> Callable[..., Flight]:
    """Flies it with other values."""
    return lambda until, **values: fly(
        WINDY,
        tmp_path / "other",
        until=until,
        record=OF_FIVE,
        overrides={key.replace("__", "."): str(x) for key, x in values.items()},
    )


def test_they_spread_evenly_although_the_wind_blows(flight: Flight) -> None:
    assert [float(flight.east(i)[-1]) for i in DRONES] == pytest.approx([0.0, 24.6, 49.2, 74.5, 100.0], abs=0.4)
    assert [float(flight.up(i)[-1]) for i in DRONES] == pytest.approx([10.0, 12.0, 8.0, 10.0, 10.0], abs=0.1)
    late = flight["time"] > 25.0
    for i in DRONES:
        assert flight[f"drone{i}.agent.failure"][-1] == 0
        north = flight[f"drone{i}.vehicle.position[1]"][late]
        assert 0.2 < np.abs(north).max() < 0.7  # the turbulence moves it, the autopilot brings it back
    assert not flight.result.verdict.findings


def test_the_wind_is_the_mean_turbulence_and_a_gust(flight: Flight, other: Callable[..., Flight]) -> None:
    """The front passes the origin at 40 s and goes 10 m/s to the north-east: before, all bits are those without it."""
    calm = other(50.0, **{"environment.gust[1]": 0.0, "environment.gust[2]": 0.0})
    rows = len(calm["time"])
    time = calm["time"]
    for drone in DRONES:
        for k, mean in ((1, 3.0), (2, 2.0), (3, 0.0)):
            name = f"environment.wind[{3 * drone - 3 + k}]"
            assert calm[name][0] == mean
            assert 0.2 < calm[name][time > 15.0].std() < 2.0
            assert float(calm[name].mean()) == pytest.approx(mean, abs=1.5)
            assert (flight[name][:rows][time < 40.0] == calm[name][time < 40.0]).all()
    for k, gust in ((1, 3.0), (2, 2.0), (3, 0.0)):  # at the origin, 4 s after the front, over 10 m beyond its 20 m
        row = int(np.argmax(time > 44.0))
        name = f"environment.wind[{k}]"
        assert flight[name][row] - calm[name][row] == pytest.approx(gust, abs=0.2)


def test_the_ground_carries_and_the_wake_of_the_upper_drone_blows(flight: Flight, other: Callable[..., Flight]) -> None:
    factor = flight["environment.thrust_factor[3]"]
    high = flight["time"] > 15.0
    assert 1.2 < factor.max() < 1.34 and factor[high].max() < 1.001
    still = other(22.0, environment__downwash="false")
    both = still["time"] > 12.0
    blown = flight["time"][: len(still["time"])] > 12.0
    below, above = (
        flight[f"environment.wind[{k}]"][: len(still["time"])][blown] - still[f"environment.wind[{k}]"][both]
        for k in (9, 6)
    )
    assert below.mean() > 0.1  # drone 3, 4 m below drone 2
    assert np.abs(above).max() < 0.1 * below.max()


def test_a_drone_that_flies_lower_is_stopped_by_the_building(flight: Flight, other: Callable[..., Flight]) -> None:
    """Its west wall is at 60 m east, and the sphere of the Iris has a radius of 0.35 m."""
    force = [f"environment.force[{k}]" for k in range(1, 16)]
    assert not any(flight[name].any() for name in force)
    assert flight.east(4)[-1] > 70.0
    low = other(70.0, drone4__agent__altitude=6.0)
    assert 59.4 < low.east(4).max() < 59.8
    assert low["environment.force[11]"].min() < -1.0
    assert low.up(4)[-1] == pytest.approx(6.0, abs=0.3)


def test_batteries_empty_by_the_power_of_hovering(flight: Flight) -> None:
    """5.1 Ah lose 167 W at about 12.2 V for about 80 s: 0.06 of them, more where the thrust is greater."""
    for i in DRONES:
        charge = flight[f"drone{i}.power.charge"]
        assert (np.diff(charge) <= 0.0).all()
        assert float(charge[-1]) == pytest.approx(0.9355, abs=0.002)
        assert float(flight[f"drone{i}.power.voltage"][-1]) == pytest.approx(12.03, abs=0.03)
    expected = 167.0 / 12.2 * 76.0 / 3600.0 / 5.1
    assert 1.0 - float(flight["drone1.power.charge"][-1]) == pytest.approx(expected, rel=0.15)


def test_an_empty_battery_ends_a_flight(other: Callable[..., Flight]) -> None:
    fallen = other(35.0, drone2__power__capacity=0.05)
    assert fallen["drone2.power.charge"][-1] == 0.0 and fallen.up(2)[-1] < 0.5 < fallen.up(2).max()
    assert fallen.up(1)[-1] == pytest.approx(10.0, abs=0.2)
    assert any("its battery is empty" in one.text for one in fallen.result.verdict.findings)


def test_the_same_bits_with_two_threads_and_after_an_interruption(fmus: Path, tmp_path: Path) -> None:
    def options(name: str, **more: Any) -> RunOptions:
        return RunOptions(out=tmp_path / name, checkpoint_every=3.0, record=OF_FIVE, **more)

    def interrupt(progress: Progress) -> None:
        if progress.time >= 6.0:
            raise KeyboardInterrupt

    simulate(WINDY, options("one", until=9.0, threads=1))
    simulate(WINDY, options("two", until=9.0, threads=2))
    simulate(WINDY, options("half", until=9.0), listener=Listener(progress=interrupt))
    last = max(float(folder.name) for folder in (tmp_path / "half" / "checkpoints").iterdir())
    simulate(WINDY, options("rest", origin=f"{tmp_path / 'half'}@{last:g}"))
    simulate(WINDY, options("seed", until=9.0, overrides={"environment.seed": "2"}))
    for name in FILES:
        whole = (tmp_path / "one" / name).read_bytes()
        assert (tmp_path / "two" / name).read_bytes() == whole
        assert (tmp_path / "rest" / name).read_bytes() == whole
    assert (tmp_path / "seed" / FILES[0]).read_bytes() != (tmp_path / "one" / FILES[0]).read_bytes()


def with_wind(text: str) -> str:
    """Connects a drone's autopilot with its vehicle by the wind that SIM_WIND_* ask for."""
    ways = {"Quadrotor": ("input", "output"), "Autopilot": ("output", "input")}
    for model, (wind, told) in ways.items():
        ports = "".join(
            f'<ssd:Connector name="added_wind[{i}]" kind="{wind}"><ssc:Real unit="m/s"/></ssd:Connector>'
            for i in (1, 2, 3)
        )
        ports += f'<ssd:Connector name="adds_wind" kind="{told}"><ssc:Boolean/></ssd:Connector>'
        first, found, rest = text.partition(f'source="../../../fmus/{model}.fmu">')
        text = first + found + rest.replace("<ssd:Connectors>", "<ssd:Connectors>" + ports, 1)
    wires = [("autopilot", f"added_wind[{i}]", "vehicle") for i in (1, 2, 3)] + [("vehicle", "adds_wind", "autopilot")]
    made = "".join(
        f'<ssd:Connection startElement="{source}" startConnector="{port}" endElement="{target}" endConnector="{port}"/>'
        for source, port, target in wires
    )
    return text.replace("</ssd:Connections>", made + "</ssd:Connections>", 1)


def test_swarm_writes_it(fmus: Path, tmp_path: Path) -> None:
    """The pattern is a drone of line5 with a battery; the files of the system are those that Swarm saves."""
    pattern = copy_of("line5", tmp_path, fmus)
    drone = pattern / "drone.ssd"
    drone.write_text(with_wind(with_power(drone.read_text(encoding="utf-8"))), encoding="utf-8")
    swarm = Swarm("windy", like=pattern, fmus=tmp_path / "fmus")
    for i, (east, altitude) in enumerate(STARTS):
        swarm.add(position=(0.0, east), stays=i in (0, 4), values={"agent.altitude": altitude})
    for i in range(1, 5):
        swarm.connect(f"drone{i}", f"drone{i + 1}")
    values = {"mean_wind": (3.0, 2.0, 0.0), "turbulence_wind": 6.0, "gust": (3.0, 2.0, 0.0), "gust_time": 40.0}
    values |= {"gust_hold": 5.0, "downwash": True, "ground_effect": True, "contact": True, "boxes": 1}
    boxes = {"box_east": 62.0, "box_length": 12.0, "box_width": 4.0, "box_height": 8.0}
    values |= {name: (value, *(0.0 if name == "box_east" else 1.0,) * 7) for name, value in boxes.items()}
    swarm.environment("Airspace", values=values)
    saved = swarm.save(pattern.parent / "again")
    names = {"SystemStructure.ssd": "SystemStructure.ssd", "drone.ssd": "drone.ssd", "windy.ssv": "drones.ssv"}
    for name, file in names.items():
        shipped, written = (
            etree.tostring(etree.parse(str(path)).getroot(), method="c14n", with_comments=False).decode()
            for path in (WINDY / name, saved / file)
        )
        written = re.sub(r'source="[^"]*/fmus/', 'source="../../../fmus/', written)
        assert written.replace('source="drones.ssv"', 'source="windy.ssv"') == shipped


def test_it_is_the_pattern_of_other_swarms(fmus: Path, tmp_path: Path) -> None:
    """From its first drone and its airspace, the same drones fly the same bits; and `new` gives any number of them."""
    swarm = Swarm("again", like="windy", stop_time=20.0)
    assert swarm.members == ("environment",)
    for i, (east, altitude) in enumerate(STARTS):
        swarm.add(position=(0.0, east), stays=i in (0, 4), values={"agent.altitude": altitude})
    for i in range(1, 5):
        swarm.connect(f"drone{i}", f"drone{i + 1}")
    again, first = (
        fly(folder, tmp_path / f"out{i}", until=20.0, record=OF_FIVE)
        for i, folder in enumerate((swarm.save(tmp_path / "again"), WINDY))
    )
    assert again.signals.keys() == first.signals.keys()
    for name, values in first.signals.items():
        assert np.array_equal(again[name], values), name
    nine = fly(
        new_system("windy", 9, tmp_path / "nine", layout="ring", fleet={"vehicle": ("Quadrotor", "Hexarotor")}),
        tmp_path / "out",
        until=25.0,
    )
    for i in range(1, 10):
        assert nine.up(i)[-1] == pytest.approx(10.0, abs=0.3)
        assert 0.2 < nine[f"environment.wind[{3 * i - 2}]"].std() < 2.0
        assert f"drone{i}.power.charge" in nine.signals


def test_an_airspace_that_misses_a_drone_is_no_pattern(fmus: Path, tmp_path: Path) -> None:
    folder = copy_of("windy", tmp_path, fmus)
    root = folder / "SystemStructure.ssd"
    text = root.read_text(encoding="utf-8")
    gone = re.sub(r'\s*<ssd:Connection [^>]*"drone5" endConnector="vehicle_wind\[1\]"/>', "", text)
    assert len(gone) < len(text)
    root.write_text(gone, encoding="utf-8")
    with pytest.raises(SystemDescriptionError, match=r"beside its drones \(environment\) that are not connected as"):
        Swarm(like=folder)


def test_wind_of_the_simulation_parameters_is_added_to_that_of_the_airspace(other: Callable[..., Flight]) -> None:
    """Drone 4 gets 5 m/s from the east beside what it felt without it, the others what they felt."""
    asked = other(until=6.0, drone4__autopilot__SIM_WIND_SPD=5.0, drone4__autopilot__SIM_WIND_DIR=90.0,
                  drone4__autopilot__SIM_WIND_T=1)  # fmt: skip
    added = np.stack([asked[f"drone4.autopilot.added_wind[{i}]"] for i in (1, 2, 3)])
    np.testing.assert_allclose(added[:, -1], (0.0, -5.0, 0.0), atol=0.02)
    assert asked["drone4.vehicle.adds_wind"].all()
    for drone in (1, 2, 3, 5):
        assert not asked[f"drone{drone}.autopilot.added_wind[2]"].any()


def test_wind_that_nothing_takes_is_not_recorded(tmp_path: Path, fmus: Path) -> None:
    still = fly(SYSTEMS / "line5", tmp_path / "line5", until=0.1)
    assert not [name for name in still.signals if "adds_wind" in name or "added_wind" in name]
    asked = fly(SYSTEMS / "line5", tmp_path / "asked", until=0.1, record=["*.added_wind*"])
    assert len(asked.signals) == 1 + 5 * 3  # time, and that of five autopilots


def test_parts_of_new_swarms_are_connected_by_the_wind_of_the_autopilot(fmus: Path) -> None:
    parts = {name: describe(fmus / f"{file}.fmu") for name, file in (("vehicle", "Y6"), ("autopilot", "Autopilot"))}
    made = {
        (one.start_element, one.start_connector, one.end_element)
        for one in wired_by_name(parts).system.connections
        if "wind" in one.end_connector
    }
    added = {("autopilot", f"added_wind[{i}]", "vehicle") for i in (1, 2, 3)}
    assert made == {*added, ("vehicle", "adds_wind", "autopilot")}

"""Drones in one FMU spread on a line and flock like drones in three; both kinds fly together; parts, threads, sizes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.execution.options import RunOptions
from cosim_master.system.authoring.swarm.new import new_system
from cosim_models.agents.kit import Task
from tests.master.parts import run_in_parts
from tests.scenarios.flights import SYSTEMS, Flight, copy_of, fly, plain_line

STARTS = (0.0, 10.0, 20.0, 50.0, 100.0)
EPSILON = 1.0 / 3.0


def recursion(steps: int) -> list[float]:
    """The places on the line after so many set-points of the law, of drones that come to where they are sent."""
    east = np.array(STARTS)
    for _ in range(steps):
        east[1:-1] += EPSILON * (east[:-2] + east[2:] - 2.0 * east[1:-1])
    return [float(one) for one in east]


def verdict(flight: Flight) -> dict[str, object]:
    manifest = json.loads((flight.folder / "manifest.json").read_text())
    return dict(manifest["verdict"])


def places(flight: Flight, drones: int = 5) -> np.ndarray:
    """Time, drone, north and east [m]."""
    axes = [[flight[f"drone{i}.vehicle.position[{k}]"] for k in (1, 2)] for i in range(1, drones + 1)]
    return np.moveaxis(np.array(axes), 2, 0)


@pytest.fixture(scope="module")
def line(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return fly(SYSTEMS / "line5-points", tmp_path_factory.mktemp("line5-points"))


def test_the_line_spreads_evenly(line: Flight) -> None:
    assert [line.east(i)[-1] for i in range(1, 6)] == pytest.approx([0.0, 25.0, 50.0, 75.0, 100.0], abs=0.6)
    steps = int(line["drone3.vehicle.step"][-1])
    assert [line.east(i)[-1] for i in range(1, 6)] == pytest.approx(recursion(steps - 1), abs=0.1)
    assert [line.up(i)[-1] for i in range(1, 6)] == pytest.approx([10.0] * 5, abs=0.01)
    assert verdict(line)["good"] is True


def test_its_targets_are_those_of_the_law(line: Flight) -> None:
    """The recursion with the drones' places when each step begins; a place that was heard is up to 0.27 s old."""
    first = [line[f"drone{i}.vehicle.target"][line.row_of_step(2, f"drone{i}.vehicle")] for i in range(1, 6)]
    assert first == pytest.approx([0.0, 10.0, 26.667, 56.667, 100.0], abs=0.01)  # by hand, from the starts
    for step in (3, 5, 9, 17):
        row = line.row_of_step(step, "drone3.vehicle")
        east = [line.east(i)[row - 1] for i in range(1, 6)]
        speed = max(abs(line[f"drone{i}.vehicle.velocity[2]"][row - 1]) for i in range(1, 6))
        for i in (2, 3, 4):
            wanted = east[i - 1] + EPSILON * (east[i - 2] + east[i] - 2.0 * east[i - 1])
            assert line[f"drone{i}.vehicle.target"][row] == pytest.approx(wanted, abs=0.02 + 0.2 * speed)


def test_it_is_where_the_line_of_three_fmus_is(line: Flight) -> None:
    """Quadrotors with ArduCopter's control, which lean first: behind by half a metre after a way of 6.7 m."""
    other = plain_line()
    for step in (2, 3, 9, 16):
        mine, its = line.end_of_step(step, "drone3.vehicle"), other.end_of_step(step)
        assert line["time"][mine] - other["time"][its] == pytest.approx(0.0, abs=0.02)
        mine_east, its_east = [line.east(i)[mine] for i in (2, 3, 4)], [other.east(i)[its] for i in (2, 3, 4)]
        assert mine_east == pytest.approx(its_east, abs=0.6 if step < 9 else 0.2)


def test_packets_are_those_of_autopilots(line: Flight) -> None:
    packets = pq.read_table(line.folder / "packets.parquet").to_pydict()
    assert set(packets["message"]) == {mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT}
    assert set(packets["component"]) == {mavlink.MAV_COMP_ID_AUTOPILOT1}
    sent = {(name, at) for name, at, what in zip(packets["source"], packets["sent"], packets["message"], strict=True)
            if what == mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT}  # fmt: skip
    assert len(sent) == 5 * 4 * 85


def test_both_kinds_fly_in_one_line(fmus: Path, tmp_path: Path) -> None:
    """Drone 3 is a quadrotor with its autopilot and agent: the others hear it, and it hears them."""
    system = copy_of("line5-points", tmp_path, fmus)
    text = (system / "SystemStructure.ssd").read_text(encoding="utf-8")
    mixed = text.replace('name="drone3" type="application/x-ssp-definition" source="drone.ssd"',
                         'name="drone3" type="application/x-ssp-definition" source="../line5/drone.ssd"')  # fmt: skip
    assert mixed != text
    (system / "SystemStructure.ssd").write_text(mixed, encoding="utf-8")
    values = system / "line5-points.ssv"
    own = ("sysid", "left_sysid", "right_sysid", "stubborn")
    text = values.read_text(encoding="utf-8")
    for name in own:
        text = text.replace(f'"drone3.vehicle.{name}"', f'"drone3.agent.{name}"')
    autopilot = '<ssv:Parameter name="drone3.autopilot.SYSID_THISMAV"><ssv:Integer value="3"/></ssv:Parameter>'
    values.write_text(text.replace("</ssv:Parameters>", autopilot + "</ssv:Parameters>"), encoding="utf-8")
    flight = fly(system, tmp_path / "out")
    steps = int(flight["drone3.agent.step"][-1])
    assert {int(flight[f"drone{i}.vehicle.step"][-1]) for i in (1, 2, 4, 5)} == {steps}
    assert [flight.east(i)[-1] for i in range(1, 6)] == pytest.approx(recursion(steps - 1), abs=0.2)
    assert verdict(flight)["good"] is True


def test_who_is_not_heard_is_named(fmus: Path, tmp_path: Path) -> None:
    flight = fly(SYSTEMS / "line5-points", tmp_path, overrides={"drone3.vehicle.left_sysid": "77"}, until=40.0)
    found = json.dumps(verdict(flight))
    assert verdict(flight)["good"] is False
    assert "drone3.vehicle" in found and "its left neighbour is not heard" in found


def test_the_flock_keeps_its_distance_and_passes_the_obstacle(fmus: Path, tmp_path: Path) -> None:
    flight = fly(SYSTEMS / "flocking-points", tmp_path)
    way, late = places(flight), flight["time"] > 60.0
    away = np.linalg.norm(way[:, :, None] - way[:, None], axis=3) + 1e3 * np.eye(5)
    assert away[late].min(axis=2) == pytest.approx(np.full((late.sum(), 5), 10.0), abs=1.5)
    assert away.min() > 6.0
    assert np.linalg.norm(way - (35.0, 14.0), axis=2).min() > 5.0  # the cylinder's radius
    north = way[..., 0].mean(axis=1)
    assert np.polyfit(flight["time"][late], north[late], 1)[0] == pytest.approx(1.5, abs=0.15)
    assert verdict(flight)["good"] is True


def test_a_larger_line_in_threads_and_parts_has_the_same_bits(fmus: Path, tmp_path: Path) -> None:
    """The law begins as soon as they hover; it has come to its second step."""
    system = new_system("line5-points", 24, tmp_path / "line24", layout="line")
    options: dict[str, Any] = {"until": 15.0, "record": ("*",)}
    options["overrides"] = {"drone*.vehicle.first_step_time": "10.5"}
    whole = fly(system, tmp_path / "a", threads=1, **options)
    assert verdict(whole)["good"] is True
    for i in range(1, 25):
        assert (whole[f"drone{i}.vehicle.state"][-1], whole[f"drone{i}.vehicle.step"][-1]) == (Task.flying, 2)
    fly(system, tmp_path / "b", threads=2, **options)
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "c", **options), 3)
    assert (result.outcome, errors) == ("done", [])
    for file in ("signals", "packets"):
        first, *others = (pq.read_table(tmp_path / out / f"{file}.parquet") for out in "abc")
        assert all(first.equals(other) for other in others), file

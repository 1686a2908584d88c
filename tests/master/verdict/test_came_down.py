"""A vehicle that has come down, from scripted outputs of a drone of line5: no FMU runs, no drone flies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from cosim.verdict import Condition
from cosim_master.stepping.layout import Layout, make_layout
from cosim_master.stepping.observation import Seen
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import Network, network_of
from cosim_master.system.settings.time_grid import TimeGrid, time_grid
from cosim_master.verdict.findings import Finding
from cosim_master.verdict.reporting import findings
from cosim_master.verdict.watching.limits import Limits
from cosim_master.verdict.watching.subjects import watched
from cosim_master.verdict.watching.watch import Watch
from tests.scenarios.flights import SYSTEMS

TAKEOFF, FORMATION, FAILED = 6, 8, 9  # of the agent's state
Prepared = tuple[CheckedSystem, Network, Layout, TimeGrid]


@pytest.fixture(scope="module")
def prepared(fmus: Path) -> Prepared:
    with read_system(SYSTEMS / "line5") as structure:
        checked = check(structure)
    network = network_of(checked)
    return checked, network, make_layout(checked, network, observed=watched(checked)), time_grid(checked, 60.0)


def judged(prepared: Prepared, rows: Sequence[Mapping[str, float]], settled: int = 0, idle: str = "") -> list[Finding]:
    """Findings of drone 3 coming down; a row of its outputs each 0.1 s.

    Names: north, up [m], ground, state, armed, desired (height of the autopilot's target, m). `settled`: the watch
    evaluates after every so many rows, as before checkpoints; 0: as it does by itself. `idle`: a second agent of
    drone 3, which commands nothing.
    """
    checked, network, layout, clock = prepared
    watch = Watch(checked, network, layout, clock, Limits())
    agents = {one.instance.name: one for one in watch.agents}
    if idle:
        agents[idle].body = agents["drone3.agent"].body
    reals = np.zeros(len(layout.ports["Real"].outputs))
    count = len(layout.ports["Integer"].outputs)
    integers = np.zeros(count + len(layout.ports["Boolean"].outputs), dtype=np.int32)

    def write(variable: str, value: float) -> None:
        for kind, places, first in (("Real", reals, 0), ("Integer", integers, 0), ("Boolean", integers, count)):
            index = layout.ports[kind].index.get((variable.rpartition(".")[0], variable.rpartition(".")[2]))
            if index is not None:
                places[first + index] = value
                return
        raise KeyError(variable)

    for k, row in enumerate(rows):
        write("drone3.vehicle.position[1]", row.get("north", 0.0))
        write("drone3.vehicle.position[3]", -row.get("up", 0.0))
        write("drone3.vehicle.on_ground", row.get("ground", 0.0))
        write("drone3.agent.state", row.get("state", FORMATION))
        write("drone3.autopilot.armed", row.get("armed", 1.0))
        write("drone3.autopilot.desired_position[3]", -row.get("desired", row.get("up", 0.0)))
        seen = Seen(0.1 * k, reals.copy(), integers.copy())
        watch.initialised(seen) if k == 0 else watch.stepped(seen)
        if settled and k % settled == settled - 1:
            watch.settle()
    watch.closed()
    return [one for one in findings(watch) if one.kind == "came down"]


def flight(down: int, **on_ground: float) -> list[dict[str, float]]:
    """1 s on the ground, 2 s at 10 m, `down` rows on the ground, 0.5 s at 10 m again."""
    start, up = {"ground": 1.0, "state": TAKEOFF}, {"up": 10.0, **{k: v for k, v in on_ground.items() if k == "state"}}
    return [start] * 10 + [up] * 20 + [{"ground": 1.0, "north": 4.0, **on_ground}] * down + [up] * 5


@pytest.mark.parametrize("idle", ["drone2.agent", "drone4.agent"])
def test_one_of_two_agents_that_commands_the_vehicle_is_enough(prepared: Prepared, idle: str) -> None:
    """Whichever of them the system names first."""
    (alone,) = judged(prepared, flight(60))
    assert judged(prepared, flight(60), idle=idle) == [alone]


def test_the_states_are_those_of_the_agent(prepared: Prepared) -> None:
    agent = next(one for one in prepared[0].instances if one.name == "drone3.agent")
    (condition,) = (one for one in agent.fmu.verdicts.values() if isinstance(one, Condition))
    assert {TAKEOFF, FORMATION} <= set(condition.commanding) and FAILED in condition.failed
    assert FAILED not in condition.commanding


@pytest.mark.parametrize("settled", [0, 1, 7, 33])
@pytest.mark.parametrize(("rows", "is_told"), [(30, False), (31, True), (60, True)])
def test_three_seconds_on_the_ground_are_told(prepared: Prepared, rows: int, is_told: bool, settled: int) -> None:
    """n rows are n - 1 intervals: 30 rows are 2.9 s, 31 are 3 s."""
    found = judged(prepared, flight(rows), settled)
    assert len(found) == is_told
    for one in found:
        assert (one.who, one.severity) == (("drone3.vehicle",), "failure")
        assert one.time == pytest.approx(3.0)
        assert one.numbers == {"total": pytest.approx(0.1 * (rows - 1))}
        assert one.text.endswith("though it had flown and drone3.agent wants it in the air: are its motors too weak?")


def test_two_short_landings_are_not_one_long(prepared: Prepared) -> None:
    assert judged(prepared, flight(20) + flight(20)[10:]) == []


def test_one_that_has_never_flown_has_not_come_down(prepared: Prepared) -> None:
    """On the ground all the time, even if it slides 4 m: it has never left it."""
    rolling = [{"ground": 1.0, "north": 0.1 * k} for k in range(80)]
    assert judged(prepared, rolling) == []


def test_one_that_nobody_wants_in_the_air_may_land(prepared: Prepared) -> None:
    """Its agent has given up, and its autopilot's target is less than 1 m above it, or it is disarmed."""
    for on_ground in ({"desired": 0.9}, {"desired": 10.0, "armed": 0.0}):
        assert judged(prepared, flight(60, state=FAILED, **on_ground)) == []


def test_the_autopilot_alone_may_want_it_in_the_air(prepared: Prepared) -> None:
    """Armed, with a target more than 1 m above it, though the agent has given up."""
    (one,) = judged(prepared, flight(60, state=FAILED, desired=1.2))
    assert one.time == pytest.approx(3.0)

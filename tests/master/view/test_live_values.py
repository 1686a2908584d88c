"""Values set from the live page: what can be set, and that the manifest has options that repeat the run."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.control import Control
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.changes import changes
from cosim_master.system.settings.time_grid import time_grid

pytest.importorskip("websockets", reason="the extra `live` is not installed")
from cosim_master.view.live.parameters import Parameters, unchangeable
from tests.master.view.test_live import LONG, Reader
from tests.master.view.watched import LINE5, Watched


@pytest.fixture(scope="module")
def line5(fmus: Path) -> Iterator[CheckedSystem]:
    with read_system(LINE5) as structure:
        yield check(structure, {"drone3.vehicle.wind[2]": "3"})


def test_those_that_at_can_change_are_found(line5: CheckedSystem) -> None:
    parameters = Parameters(line5, Control())
    found = parameters.find("DRONE3 wind north")
    assert found["of"] == 0 and found["refusal"] == ""
    found = parameters.find("drone3 VEHICLE.wind[2]")
    assert [one["name"] for one in found["list"]] == ["drone3.vehicle.wind[2]"]
    (one,) = found["list"]
    assert (one["type"], one["unit"], one["value"], one["start"]) == ("Real", "m/s", 3.0, 3.0)
    every = parameters.find("drone1")
    assert every["of"] > 200 and len(every["list"]) == 40  # not all: a thousand drones have as many each
    assert every["list"][0]["name"].rpartition(".")[2].islower()
    grid = time_grid(line5, until=1.0)
    for one in every["list"]:
        changes(line5, grid, [(0.0, one["name"], str(one["value"]).lower())])
    assert {one["name"] for one in parameters.find("vehicle.mass")["list"]} == set()  # fixed
    assert json.loads(json.dumps(every, allow_nan=False)) == every


def test_what_cannot_be_set_is_refused_with_a_reason(line5: CheckedSystem) -> None:
    control = Control()
    parameters = Parameters(line5, control)
    assert parameters.set("drone3.vehicle.mass", "2") == (
        "drone3.vehicle.mass=2: it is a fixed parameter; only tunable parameters and inputs can be changed during a run"
    )
    assert "there is no such variable" in parameters.set("drone9.vehicle.mass", "2")
    assert parameters.set("drone3.vehicle.wind[2]", "much") == "drone3.vehicle.wind[2]=much: valid: a number"
    assert "it is connected" in parameters.set("drone3.vehicle.motor[1]", "0.5")
    assert "carries packets" in parameters.set("drone3.autopilot.mavlink_rx", "x")
    assert "valid: -100 to" in parameters.set("drone3.autopilot.FENCE_ALT_MIN", "-101")
    assert control.take_changes() == []
    assert parameters.set("drone3.vehicle.wind[2]", "4.5") == ""
    (change,) = control.take_changes()
    assert (line5.instances[change.instance].name, change.variable.name) == ("drone3.vehicle", "wind[2]")
    assert change.value == 4.5 and control.take_changes() == []
    assert parameters.find("drone3.vehicle wind[2]")["list"][0]["value"] == 4.5
    closed = Parameters(line5, control, "not now")
    assert closed.set("drone3.vehicle.wind[2]", "4.5") == closed.find("wind")["refusal"] == "not now"
    assert control.take_changes() == []


@pytest.mark.parametrize(
    ("algorithm", "refused"), [("jacobi", False), ("gauss-seidel", False), ("richardson", True), ("var-step", True)]
)
def test_masters_that_choose_their_steps_take_no_values(algorithm: str, *, refused: bool) -> None:
    from cosim_master.system.settings.master import MasterSettings

    reason = unchangeable(MasterSettings(algorithm=algorithm))
    assert bool(reason) is refused and (algorithm in reason) is refused


def _set(reader: Reader, name: str, value: str) -> str:
    reader.ask({"do": "set", "name": name, "value": value})
    while True:
        news = reader.state()
        if "refusal" in news:
            refusal: str = news["refusal"]
            return refusal


def _at(reader: Reader, time: float) -> None:
    while reader.frame()[0] < time:
        reader.ask({"do": "drawn"})
    reader.ask({"do": "drawn"})


@pytest.mark.slow
def test_the_manifest_has_the_options_that_repeat_the_run(fmus: Path, tmp_path: Path) -> None:
    """The moments of the changes are those of the wall clock; the repeated run knows them from the beginning."""
    viewed, again, plain = (tmp_path / name for name in ("viewed", "again", "plain"))
    wanted = [
        ("drone3.vehicle.wind[1]", "7.25"), ("drone5.vehicle.wind[2]", "-3"), ("drone3.vehicle.wind[1]", "0.1"),
        ("drone2.autopilot.WPNAV_SPEED", "250.0"), ("drone*.vehicle.wind[3]", "0.7"),
    ]  # fmt: skip
    common: dict[str, Any] = {
        "until": 9.0,
        "overrides": {"network.loss": "0.1"},
        "at": [(3.0, "drone1.vehicle.wind[1]", "1")],
    }
    watched = Watched()
    watched.control.set_speed(4.0)
    told: list[Any] = []

    def read() -> None:
        assert watched.begun.wait(LONG)
        with Reader(watched.page) as reader:
            for n, (name, value) in enumerate(wanted):
                assert _set(reader, name, value) == ""
                if n == 0:
                    watched.control.resume()  # the first is set while the run stands at its start
                _at(reader, 1.1 * n + 0.3)
            assert _set(reader, "drone3.vehicle.mass", "2") != ""
            while len(told) == 0 or len(told[-1]["changes"]) < 9:
                if "changes" in (news := reader.state()):
                    told.append(news)
                reader.ask({"do": "drawn"})
        watched.control.set_speed(None)

    reading = threading.Thread(target=read)
    reading.start()
    assert watched.run(viewed, **common).outcome == "done"
    reading.join()
    watched.page.close()
    manifest = json.loads((viewed / "manifest.json").read_text())
    made = [(one["time"], one["variable"], str(one["value"])) for one in manifest["changes"]]
    assert [(name, value) for time, name, value in made if time != 3.0] == [
        ("drone3.vehicle.wind[1]", "7.25"), ("drone5.vehicle.wind[2]", "-3.0"), ("drone3.vehicle.wind[1]", "0.1"),
        ("drone2.autopilot.WPNAV_SPEED", "250.0"), *((f"drone{i}.vehicle.wind[3]", "0.7") for i in range(1, 6)),
    ]  # fmt: skip
    assert made[0][0] == 0.0 and made == sorted(made, key=lambda one: one[0])
    assert [(time, name, value) for time, name, value in told[-1]["changes"]] == [one for one in made if one[0] != 3.0]
    simulate(LINE5, RunOptions(out=again, **{**common, "at": made}))
    simulate(LINE5, RunOptions(out=plain, **common))
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (viewed / name).read_bytes() == (again / name).read_bytes(), name
    assert (viewed / "signals.parquet").read_bytes() != (plain / "signals.parquet").read_bytes()
    repeated, other = (json.loads((run / "manifest.json").read_text()) for run in (again, plain))
    assert manifest["fingerprint"] == repeated["fingerprint"] != other["fingerprint"]
    assert manifest["changes"] == repeated["changes"]

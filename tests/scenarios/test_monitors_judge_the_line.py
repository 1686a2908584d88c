"""Monitors of the system file on variants of the line: silent where it is good, and not where it is not."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from cosim_master.results.reading.read import signals
from cosim_master.verdict.monitors.ages import AgeRule
from cosim_master.verdict.monitors.rules import LimitRule
from tests.scenarios.flights import SYSTEMS, copy_of

LAW = """
<monitors xmlns="https://uav-cosim.org/ns/1" interval="0.1">
  <order start="25" least="1"/>
  <separation least="2"/>
  <convergence signals="drone2.agent.target drone3.agent.target drone4.agent.target" goal="25 50 75" amplitude="40"
               time="15" floor="0.3" start="25"/>
  <fence polygon="-5 -5  -5 105  5 105  5 -5" ceiling="11" floor="-0.1"/>
  <age from="drone2" to="drone3" most="1" start="20"/>
</monitors>
"""
FLIGHT = """
<monitors xmlns="https://uav-cosim.org/ns/1">
  <limit name="speed" signals="drone*.vehicle.velocity" quantity="magnitude" most="10"/>
  <limit name="tilt" signals="drone*.vehicle.attitude" quantity="tilt" most="0.6"/>
  <formula name="ringing" text="not (once[0,0.5] f + 9.81 > 3 and once[0,0.5] f + 9.81 &lt; -3)">
    <signal name="f" of="drone*.vehicle.specific_force[3]"/>
  </formula>
  <age from="drone2" to="drone3" most="0.4" start="4" severity="warning"/>
</monitors>
"""
GONE = '<age name="gone" from="drone2" to="drone3" most="0.7" start="8" end="true"/>'
ENDING = FLIGHT.replace("</monitors>", f"{GONE}</monitors>")
SELDOM = """
<monitors xmlns="https://uav-cosim.org/ns/1" interval="2">
  <separation least="60"/>
  <age from="drone2" to="drone3" most="0.6" start="4"/>
</monitors>
"""
CROSSING = '<monitors xmlns="https://uav-cosim.org/ns/1" interval="0.0075"><order start="20" end="true"/></monitors>'
START = {
    f"drone{n}.vehicle.position_start[2]": f"{east}" for n, east in zip(range(1, 6), (0, 1, 9, 10, 11), strict=True)
}


@pytest.fixture(scope="module")
def variants(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    found = {}
    for name, monitors in {
        "law": LAW,
        "flight": FLIGHT,
        "ending": ENDING,
        "seldom": SELDOM,
        "crossing": CROSSING,
    }.items():
        annotation = f'<ssc:Annotation type="org.uav-cosim.monitors">{monitors}</ssc:Annotation></ssd:Annotations>'
        folder = tmp_path_factory.mktemp(name)
        found[name] = copy_of("line5", folder, fmus, lambda text, a=annotation: text.replace("</ssd:Annotations>", a))
    return found


def kinds(result: RunResult) -> list[tuple[str, tuple[str, ...]]]:
    assert result.error is None and result.verdict is not None
    return [(one.kind, one.who) for one in result.verdict.findings if "violated" in one.kind]


@pytest.mark.slow
def test_the_good_line_violates_nothing(variants: dict[str, Path]) -> None:
    result = simulate(variants["law"])
    assert kinds(result) == []
    assert result.verdict is not None and [one["count"] for one in result.verdict.monitors] == [0] * 5


@pytest.mark.slow
@pytest.mark.parametrize(("epsilon", "until", "from_time"), [("0.6", 110.0, 75.0), ("0.7", 80.0, 60.0)])
def test_a_gain_above_the_bound_does_not_converge(
    variants: dict[str, Path], epsilon: str, until: float, from_time: float
) -> None:
    """The bound is 2 / (2 + sqrt 2) = 0.5858; beyond it, the mode (1, -sqrt 2, 1) grows by |1 - 3.414 eps| a step."""
    result = simulate(variants["law"], RunOptions(overrides={"drone*.agent.epsilon": epsilon}, until=until))
    found = kinds(result)
    assert {kind for kind, _ in found} == {"convergence violated"}
    assert ("convergence violated", ("drone3.agent.target",)) in found
    assert result.verdict is not None
    assert (
        min(one.time for one in result.verdict.findings if one.kind == "convergence violated" and one.time) > from_time
    )


@pytest.mark.slow
def test_a_gain_above_a_half_changes_the_order_and_the_run_ends_there(
    variants: dict[str, Path], tmp_path: Path
) -> None:
    """Drones 2 and 3 start at 1 and 9 m; one step sends them to 6.6 and 3.4 m at eps = 0.8, 4.5 and 5.5 at 0.5."""
    kept = simulate(variants["crossing"], RunOptions(overrides={**START, "drone*.agent.epsilon": "0.5"}, until=32.0))
    assert (kept.outcome, kinds(kept)) == ("done", [])
    run = RunOptions(overrides={**START, "drone*.agent.epsilon": "0.8"}, until=32.0, out=tmp_path / "out")
    crossed = simulate(variants["crossing"], run)
    assert crossed.outcome == "violated" and crossed.verdict is not None
    (finding,) = [one for one in crossed.verdict.findings if one.kind == "order violated"]
    assert finding.who == ("drone2.vehicle", "drone3.vehicle")
    assert finding.text.endswith("which ends the run")
    table = signals(tmp_path / "out")
    time, second, third = (
        table[name].to_numpy() for name in ("time", "drone2.vehicle.position[2]", "drone3.vehicle.position[2]")
    )
    assert time[-1] == finding.time and 25.0 < time[-1] < 32.0
    assert (second < third).tolist() == [True] * (len(time) - 1) + [False]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["simulated_s"]) == ("violated", finding.time)
    (violation,) = manifest["verdict"]["monitors"][0]["violations"]
    assert (violation["begin"], violation["end"]) == (finding.time, None)
    assert violation["cause"].startswith("drone3.vehicle was ")


@pytest.mark.slow
def test_the_gain_error_of_the_authors_is_flagged_as_ringing(variants: dict[str, Path]) -> None:
    """The vertical loop gain is 10.9 times too high, as with C_z = 0.0159 instead of 0.1731 (PSC_VELZ_P is 5)."""
    good = simulate(variants["flight"], RunOptions(until=12.0))
    assert kinds(good) == []
    wrong = simulate(variants["flight"], RunOptions(until=12.0, overrides={"drone*.autopilot.PSC_VELZ_P": "54.5"}))
    ringing = [(f"drone{n}.vehicle.specific_force[3]",) for n in range(1, 6)]
    assert [who for kind, who in kinds(wrong) if kind == "formula violated"] == ringing


@pytest.mark.slow
def test_signals_and_packets_have_the_same_bits_and_a_resumed_run_the_same_verdict(
    variants: dict[str, Path], tmp_path: Path
) -> None:
    """Packets are lost, so that ages are violated; the checkpoint is within a violation and a window of the formula."""
    loss: dict[str, Any] = {"overrides": {"network.loss": "0.5", "drone*.autopilot.PSC_VELZ_P": "54.5"}, "until": 9.0}
    plain = simulate(SYSTEMS / "line5", RunOptions(out=tmp_path / "plain", checkpoint_every=4.0, **loss))
    whole = simulate(variants["flight"], RunOptions(out=tmp_path / "whole", checkpoint_every=4.0, **loss))
    rest = simulate(variants["flight"], RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'whole'}@8"))
    unrecorded = simulate(variants["flight"], RunOptions(**loss))
    assert plain.verdict is not None and whole.verdict is not None and rest.verdict is not None
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
        assert (tmp_path / "rest" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    judged = [one.verdict.as_json() for one in (whole, rest, unrecorded) if one.verdict is not None]
    assert judged[0] == judged[1]
    links = [[one for one in some["findings"] if one["kind"] == "packets lost"] for some in judged]
    assert [len(some) for some in links] == [1, 1, 1]
    assert "most on" in links[1][0]["text"] and "most on" not in links[2][0]["text"]  # links are known from a recording
    for some, (note,) in zip(judged, links, strict=True):
        some["findings"].remove(note)
    assert judged[1] == judged[2]
    counts = {one["name"]: one["count"] for one in whole.verdict.monitors}
    assert counts["ringing"] >= 5 and counts["age"] >= 2 and counts["speed"] == 0
    assert not plain.verdict.monitors


@pytest.mark.slow
def test_a_monitor_that_ends_the_run_changes_neither_the_others_nor_how_often_they_are_evaluated(
    variants: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: Counter[str] = Counter()
    for rule in (AgeRule, LimitRule):

        def look(self: Any, samples: Any, of: Any = rule.look) -> None:
            looks[self.monitor.name] += 1
            of(self, samples)

        monkeypatch.setattr(rule, "look", look)
    loss = {"network.loss": "0.5", "drone*.autopilot.PSC_VELZ_P": "54.5"}
    ended = simulate(variants["ending"], RunOptions(overrides=loss, until=12.0))
    assert ended.outcome == "violated" and 8.0 < ended.simulated_s < 12.0
    points = round(ended.simulated_s / 0.0025)
    assert looks["gone"] == points + 1
    assert looks["speed"] == looks["age"] == math.ceil((points + 1) / 64)
    alone = simulate(variants["flight"], RunOptions(overrides=loss, until=ended.simulated_s))
    assert ended.verdict is not None and alone.verdict is not None
    *others, gone = ended.verdict.monitors
    assert others == [*alone.verdict.monitors]
    assert {one["name"]: one["count"] > 0 for one in others if one["name"] != "tilt"} == {
        "speed": False,
        "ringing": True,
        "age": True,
    }
    assert (gone["name"], gone["count"]) == ("gone", 1)


@pytest.mark.slow
def test_a_checkpoint_between_two_looks_changes_no_verdict(variants: dict[str, Path], tmp_path: Path) -> None:
    """Distances are those of straight ways from look to look; packets are heard between them."""
    options: dict[str, Any] = {"overrides": {"network.loss": "0.5"}, "until": 40.0, "record": ["*.position*"]}
    whole = simulate(variants["seldom"], RunOptions(out=tmp_path / "whole", checkpoint_every=7.0, **options))
    assert whole.verdict is not None
    distances, ages = whole.verdict.monitors
    assert distances["count"] >= 6 and ages["count"] >= 2
    for time in (28, 35):
        rest = simulate(
            variants["seldom"],
            RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'whole'}@{time}", record=["*.position*"]),
        )
        assert rest.verdict is not None and [*rest.verdict.monitors] == [distances, ages]

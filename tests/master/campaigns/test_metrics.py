"""Metrics: expressions against numpy, built-in ones against closed forms, and nothing but arithmetic."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.verdict import Formation, Neighbour, Role
from cosim_master.campaigns.dataset.folder import Folder
from cosim_master.campaigns.metrics import built_in
from cosim_master.campaigns.metrics.measured import Measured
from cosim_master.campaigns.metrics.metric import Metric, MetricError
from cosim_master.campaigns.running.place import look_at
from cosim_master.campaigns.running.task import perform
from cosim_master.campaigns.study.study import Study
from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.outcome.result import Outcome, RunResult
from cosim_master.results.reading.roles import Player
from cosim_master.verdict.findings import Judgement

TIME = np.linspace(0.0, 4.0, 41)
SIGNALS = {
    "drone1.vehicle.position[2]": np.sin(TIME),
    "drone2.vehicle.position[2]": 3.0 - TIME,
    "drone10.vehicle.position[2]": TIME**2,
    "one.x": np.full(41, -2.0),
}
RESULT = RunResult(
    Outcome.DONE,
    None,
    packets={"sent": 10, "delivered": 7, "lost": 3},
    verdict=Judgement(nearest={"who": ["a", "b"], "distance": 1.5, "time": 2.0}),
)


def run(**given: Any) -> Measured:
    return Measured(**{"time": TIME, "signals": SIGNALS, "units": {}, "result": RESULT, **given})


def value(text: str, measured: Measured | None = None) -> float:
    return Metric.parsed(text).value(measured or run())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("last(drone2.vehicle.position[2])", -1.0),
        ("first(drone2.vehicle.position[2]) - 1", 2.0),
        ("max(last(drone*.vehicle.position[2]))", 16.0),
        ("min(drone*.vehicle.position[2])", -1.0),
        ("max(drone?.vehicle.position[2])", 3.0),
        ("sum(last(*.position[2]))", np.sin(4.0) - 1.0 + 16.0),
        ("mean(drone1.vehicle.position[2])", np.sin(TIME).mean()),
        ("rms(drone10.vehicle.position[2] - drone2.vehicle.position[2])", np.sqrt(np.mean((TIME**2 + TIME - 3) ** 2))),
        ("std(drone2.vehicle.position[2])", TIME.std()),
        ("integral(drone2.vehicle.position[2])", 3.0 * 4.0 - 8.0),
        ("at(drone10.vehicle.position[2], 2)", 4.0),
        ("max(min(drone2.vehicle.position[2], one.x))", -2.0),
        ("max(hypot(one.x, 1.5))", 2.5),
        ("max(abs(one.x)) * 2 + 3 / (1 - 4)", 3.0),
        ("sqrt(16)", 4.0),
        ("--2", 2.0),
        ("2 - 3 - 4", -5.0),
        ("12 / 3 / 2", 2.0),
        ("1e3 * .5", 500.0),
        ("last(time)", 4.0),
        ("packets_lost / packets_sent", 0.3),
        ("nearest_approach", 1.5),
        ("named = packets_delivered", 7.0),
    ],
)
def test_an_expression_has_the_value_of_numpy(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "().__class__.__bases__",
        "[x for x in (1,)]",
        "lambda: 1",
        "open('/etc/passwd')",
        "1 if 2 else 3",
        "2 ** 9",
        "x := 3",
        "max(1;2)",
        "",
        "max(",
        "1 +",
        "max(1, 2, 3)",
        "at(one.x)",
        "sinus(one.x)",
        "settling_time(1, 2)",
        "settling_time(one.x)",
        "energy(3)",
    ],
)
def test_an_expression_that_is_no_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(SystemDescriptionError, match="--metric"):
        Metric.parsed(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("one.x", r"write last\(...\), max"),
        ("last(drone*.vehicle.position[2])", "has 3 values, one for each signal"),
        ("max(drone*.vehicle.position[2] - drone?.vehicle.position[2])", "3 and 2 signals"),
        ("at(one.x, one.x)", "the time must be a number"),
    ],
)
def test_what_is_not_one_number_is_said(text: str, says: str) -> None:
    with pytest.raises(MetricError, match=says):
        value(text)


def test_a_signal_that_does_not_exist_is_refused_before_any_run() -> None:
    units = dict.fromkeys(SIGNALS, "m")
    assert Metric.parsed("max(drone*.vehicle.position[2]) + packets_lost").signals({}, units) == [
        "drone*.vehicle.position[2]"
    ]
    with pytest.raises(SystemDescriptionError, match=r'no signal "drone3.vehicle.position\[2\]"; did you mean'):
        Metric.parsed("last(drone3.vehicle.position[2])").signals({}, units)
    with pytest.raises(SystemDescriptionError, match='no metric "eror_to_law"; did you mean "error_to_law"'):
        Metric.parsed("eror_to_law").signals({}, units)
    with pytest.raises(SystemDescriptionError, match="no agents on a line"):
        Metric.parsed("error_to_law").signals({}, units)
    with pytest.raises(SystemDescriptionError, match="one output in V and one in A"):
        Metric.parsed("energy").signals({}, units)


def test_a_python_function_measures(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("import numpy as np\n\n\ndef swing(run):\n    return np.ptp(run['one.x'] + run.time)\n\n\n"
                    "swing.signals = 'one.*'\n\n\ndef broken(run):\n    return run['none.y'][0]\n")  # fmt: skip
    metric = Metric.parsed(f"{file}:swing")
    assert metric.name == "swing"
    assert metric.signals({}, {"one.x": ""}) == ["one.*"]
    with pytest.raises(SystemDescriptionError, match=r'^--metric swing: there is no signal "one\.\*"; valid: "two\.x"'):
        metric.signals({}, {"two.x": ""})
    assert Metric.of_json(metric.as_json()).value(run()) == pytest.approx(4.0)
    with pytest.raises(MetricError, match=r"metric broken: KeyError: 'none\.y'"):
        value(f"{file}:broken")
    with pytest.raises(SystemDescriptionError, match='no function "swng"; did you mean "swing"'):
        Metric.parsed(f"{file}:swng")
    with pytest.raises(SystemDescriptionError, match="cannot be read"):
        Metric.parsed(f"{tmp_path / 'none.py'}:swing")
    file.write_text("raise RuntimeError('no')")
    with pytest.raises(SystemDescriptionError, match="cannot be executed: RuntimeError: no"):
        Metric.parsed(f"{file}:swing")


def line(*ends: float) -> Measured:
    """Three drones: 1 and 3 stay at 0 and 10 m; drone 2 approaches its place as its law says, or ends elsewhere."""
    gain = Formation(
        step="step", neighbours=(Neighbour("left", 0.3), Neighbour("right", 0.3)), stays="stays", begin="", period=""
    )
    agent = {"target": gain, "id": Role.SYSTEM_ID}
    known, signals, units = {}, {}, {}
    tracks = {1: np.zeros(41), 2: 5.0 - 4.0 * np.exp(-TIME), 3: np.full(41, 10.0)}
    if ends:
        tracks[2] = np.linspace(1.0, ends[0], 41)
    for number, track in tracks.items():
        ids = {"id": number, "left": number - 1 if number > 1 else 0, "right": number + 1 if number < 3 else 0}
        known[f"d{number}.agent"] = Player({**ids, "stays": number != 2}, agent)
        known[f"d{number}.vehicle"] = Player({}, {"position": Role.POSITION})
        for axis in (1, 2, 3):
            signals[f"d{number}.vehicle.position[{axis}]"] = track if axis == 2 else np.zeros(41)
        signals |= {f"d{number}.agent.target": track, f"d{number}.agent.step": np.ones(41)}
    units = {name: "" if name.endswith("step") else "m" for name in signals}
    return run(signals=signals, units=units, players=known)


def test_settling_and_error_to_law_have_their_closed_forms() -> None:
    """The law's fixed point is 5 m; exp(-t) is below 5 % from t = 3.0 s on, and below 0.1 m / 4 m from 3.7 s on."""
    measured = line()
    assert value("error_to_law", measured) == pytest.approx(4.0 * np.exp(-4.0), rel=1e-12)
    assert value("settling_time", measured) == pytest.approx(3.0)
    assert value("settling_time(0.1)", measured) == pytest.approx(3.7)
    assert value("settling_time(9)", measured) == 0.0
    assert np.isnan(value("settling_time", line(8.0)))
    assert value("error_to_law", line(8.0)) == pytest.approx(3.0)
    needed = Metric.parsed("error_to_law").signals(measured.players, measured.units)
    assert {*needed} == {*measured.signals}


def test_a_run_that_recorded_nothing_has_no_values() -> None:
    empty = run(time=np.zeros(0), signals={"one.x": np.zeros(0)}, result=RunResult(Outcome.FAILED, None))
    for text in ("max(one.x)", "last(one.x)", "integral(one.x)", "at(one.x, 1)", "nearest_approach", "settling_time"):
        assert np.isnan(value(text, empty)), text


def test_energy_is_the_integral_of_voltage_times_current() -> None:
    signals = {"a.power.voltage": 12.0 - TIME, "a.power.current": np.full(41, 2.0)}
    signals |= {"b.power.voltage": np.full(41, 10.0), "b.power.current": np.full(41, 0.5), "c.voltage": TIME}
    units = {name: "A" if name.endswith("current") else "V" for name in signals}
    of_autopilot = {"a.autopilot.voltage": 12.0 - TIME, "a.autopilot.current": np.full(41, 2.0)}
    all_units = {**units, "a.autopilot.voltage": "V", "a.autopilot.current": "A"}
    measured = run(signals={**signals, **of_autopilot}, units=all_units, outputs=frozenset(units))
    assert value("energy", measured) == pytest.approx(2.0 * (12.0 * 4.0 - 8.0) + 10.0 * 0.5 * 4.0)
    assert Metric.parsed("energy").signals({}, all_units, frozenset(units)) == [*signals][:4]


def test_energy_of_shipped_systems(fmus: Path, tmp_path: Path) -> None:
    """Autopilots measure a battery in local variables, also of systems without batteries."""
    by_hand = "hand=sum(integral(drone*.power.voltage * drone*.power.current))"
    study = Study(system="windy", metrics=tuple(map(Metric.parsed, ("energy", by_hand))), until=3.0)
    (planned,) = study.runs()
    row = perform(study, look_at(study, planned), planned).row
    assert row["outcome"] == "done", row["reason"]
    assert row["energy"] == row["hand"] > 1.0
    told = CliRunner().invoke(app, ["sweep", "line5", "--metric", "energy", "-o", str(tmp_path / "line5")])
    assert told.exit_code == 2
    assert "energy needs a component with one output in V and one in A, such as a battery; this system has none" in (
        told.stderr
    )


def test_a_metric_that_has_no_value_is_told(fmus: Path, tmp_path: Path) -> None:
    """The run has been made before, so no worker is needed."""
    own = tmp_path / "own.py"
    own.write_text("def x(run):\n    return run['drone1.vehicle.position[1]']\n")
    study = Study(system="line5", metrics=tuple(map(Metric.parsed, (f"{own}:x", "packets_lost"))), until=0.1)
    (planned,) = study.runs()
    place = look_at(study, planned)
    with Folder(tmp_path / "out", study, place.inputs) as folder:
        folder.add(dict(perform(study, place, planned).row))
    told = CliRunner().invoke(app, ["sweep", str(tmp_path / "out")])
    assert told.exit_code == 0
    assert "note: no run has a value of metric x; run 0: TypeError: only " in told.stderr
    assert "metric packets_lost" not in told.stderr


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a.y", '"a.y" is a signal over time; write last(...), max(...), mean(...), rms(...) or integral(...) of it'),
        ("last(*.y)", '"last(*.y)" has 2 values, one for each signal; write max(...), min(...) or sum(...) of them'),
        ("at(a.y, time)", "at(signal, time): the time must be a number, in s"),
        ("max(*.y - *.z)", "- has 2 and 3 signals; the numbers must be equal, or 1"),
    ],
)
def test_what_is_no_number_is_refused_before_any_run(text: str, reason: str) -> None:
    units = dict.fromkeys(("a.y", "b.y", "a.z", "b.z", "c.z"), "")
    with pytest.raises(SystemDescriptionError, match=re.escape(reason)):
        Metric.parsed(text).signals({}, units)
    assert Metric.parsed("max(*.y) / packets_sent").signals({}, units) == ["*.y"]


def test_a_function_names_its_signals(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text("def f(run):\n    return 1.0\n\n\nf.signals = 5\n")
    with pytest.raises(SystemDescriptionError, match="signals of f is 5; give names of signals, or patterns"):
        Metric.parsed(f"{tmp_path / 'own.py'}:f").signals({}, {"a.y": ""})


def test_every_built_in_metric_is_documented() -> None:
    text = (Path(__file__).parents[3] / "docs" / "campaigns.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in built_in.BUILT_IN)

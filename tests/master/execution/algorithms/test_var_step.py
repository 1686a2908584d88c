"""Steps of sizes that constraints decide: sequences of sizes by hand, runs of multi-models, and what is refused.

Maestro's own recordings are compared where INTO_CPS_MAESTRO names a clone of github.com/INTO-CPS-Association/maestro.
"""

from __future__ import annotations

import csv
import json
import math
import os
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.convert import convert
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.constraints import Constraint
from tests.master.fmus.step_sizes import steps_made
from tests.master.fmus.strict import ABLE

pytestmark = pytest.mark.usefixtures("own_cache")

MAESTRO = os.environ.get("INTO_CPS_MAESTRO", "")
PORT, TWO = (("a", "x"),), (("a", "x"), ("b", "x"))
FALL = [100, 120, 144, 172.8, 172.8, 86.4, 86.4, 43.2, 21.6, 21.6, 10.8, 10.8, 10.8, 12.96, 38.88, 116.64]
"""Steps, ms, of a signal that falls by 1 per second from 1, with order 1 and a tolerance of 0.01: see the test."""
MEET = [100, 120, 144, 144, 144, 144, 72, 36, 36, 18, 18, 9, 4.5, 4.5, 4.5, 5.4, 6.48, 19.44, 58.32]
"""The same of the difference of two, one of which rises from 0 to the other's 1."""


def ms(steps: list[int]) -> list[float]:
    return [step / 1e6 for step in steps]


# ---- sequences of step sizes ---------------------------------------------------------------------------------------


def test_a_zero_crossing_of_order_one() -> None:
    """x = 1 - t. The first forecast (no slope) is off by 1/9 of x, which fades by 0.7 a step: from 0.1 s on the steps
    to the crossing are 9/1.111, 6.5/1.0778, 4.42/1.0544, 2.68/1.0381 (constant), 1.68/1.0267 (tighten), 2.36/1.019,
    1.36/1.013 (tighten), 1.72/1.009, 2.44/1.006, 1.44/1.004 (tighten), 1.889/1.003; then x is 0.0096, within the
    tolerance (constant), then -0.0012, well within (relax), then it leaves (strongly relax)."""
    one = Constraint("z", "zerocrossing", PORT, order=1, abstol=0.01)
    assert ms(steps_made([one], lambda t: 1 - t, count=16)[0]) == FALL


def test_a_zero_crossing_of_two_ports() -> None:
    """t - 1: errors are those of the ports, the first one 1 (0.1 of 0.1), then 0.7, and so on. Steps to the crossing:
    9/2, 6.5/1.7, 4.42/1.49 (constant), 3.42/1.34, 2.42/1.24, 1.42/1.17 (tighten), 1.83/1.12 = 1.64 (tighten), 2.46,
    1.58 (tighten), 2.24, 1.30 (tighten), 1.63 (tighten), 2.30, then 0.006 and 0.0015 are left, then it leaves."""
    two = Constraint("z", "zerocrossing", TWO, order=1, abstol=0.01)
    assert ms(steps_made([two], lambda t: t, lambda t: 1.0, count=19)[0]) == MEET


def test_a_zero_crossing_of_order_two() -> None:
    """x = 1 - t^2 is its own parabola from the third point on: (1 - t)/h steps are left, divided by 1 + error, the
    error being 0.12/0.84 at 0.4 s, then 0.1, 0.07 and 0.049: tighten, 3/1.1, 2/1.07, and 1/1.049 hits it."""
    one = Constraint("z", "zerocrossing", PORT, order=2, abstol=0.01)
    made = ms(steps_made([one], lambda t: 1 - t * t, count=8)[0])
    assert made[:5] == [100, 300, 150, 150, 150]
    assert made[5] == pytest.approx(150 / 1.049, abs=1e-6)
    left = 150 - made[5]
    error = 0.049 * 0.7
    assert made[6] == pytest.approx(left / (1 + error), rel=1e-4)
    assert made[7] == pytest.approx(1.2 * made[6], abs=1e-6)  # well within the tolerance


def test_safety_makes_shorter_steps() -> None:
    one = Constraint("z", "zerocrossing", PORT, order=1, abstol=0.01, safety=1.0)
    # 9/2.111, 6.5/2.078, 4.42/2.054 (constant), 3.42/2.038 (tighten)
    assert ms(steps_made([one], lambda t: 1 - t, count=5)[0]) == [100, 120, 144, 144, 72]


def test_a_crossing_that_is_missed_is_tried_again_shorter() -> None:
    """From 1 to -9 at 0.15 s: 0.3 s is tried after 0.1, and 0.075, and 0.01875 counts; then three times as much."""
    one = Constraint("z", "zerocrossing", PORT, order=1, abstol=0.01)
    made, repeated = steps_made([one], lambda t: 1.0 if t < 0.15 else -9.0, shortest=0.01, count=4)
    assert (ms(made), ms(repeated)) == ([100, 18.75, 14.0625, 10.546875], [300, 75, 56.25, 42.1875])
    made, repeated = steps_made([one], lambda t: 1.0 if t < 0.15 else -9.0, shortest=0.01, count=3, returns=False)
    assert (ms(made), repeated) == ([100, 300, 150], [])  # it counts, and tightens the next one


def test_oscillations_that_grow_take_the_shortest_steps() -> None:
    """1, -2, 4 at 0, 0.1 and 0.15 s: the sign has changed twice."""
    one = Constraint("z", "zerocrossing", PORT, order=1, abstol=0.01)
    grows = {0: 1.0, 100: -2.0, 150: 4.0}
    made, _ = steps_made([one], lambda t: grows.get(round(1e3 * t), 8.0), returns=False, shortest=0.02, count=3)
    assert ms(made) == [100, 50, 20]


def test_a_bounded_difference() -> None:
    """x = t: the difference is the step: 0.1 (strongly relax), 0.3 (relax), 0.36 (relax), 0.432 (constant)."""
    one = Constraint("b", "boundeddifference", PORT, abstol=1.0, reltol=1e300)
    assert ms(steps_made([one], lambda t: t, count=6)[0]) == [100, 300, 360, 432, 432, 432]
    # a difference of 10 is too much: 0.01 of the step, where it cannot be repeated
    made = ms(steps_made([one], lambda t: 1e3 * t, first=0.01, count=2, returns=False)[0])
    assert made == [10, 0.1]
    # with safety 1 the bins are half as wide: 0.35 is risky; 0.175 is safe, 0.21 and 0.252 on target
    careful = Constraint("b", "boundeddifference", PORT, abstol=1.0, reltol=1e300, safety=1.0)
    assert ms(steps_made([careful], lambda t: t, first=0.35, count=4)[0]) == [350, 175, 210, 210]


def test_a_bounded_relative_difference() -> None:
    """x = exp(t): 1 - exp(-h) of the value: 0.095 of 0.5 (strongly relax), 0.259 (0.52: constant)."""
    one = Constraint("b", "boundeddifference", PORT, abstol=1e300, reltol=0.5)
    assert ms(steps_made([one], math.exp, count=4)[0]) == [100, 300, 300, 300]


def test_a_bounded_difference_of_two_ports() -> None:
    """They are t apart; 0.1 s: strongly relax, 0.4 s: relax, 0.76 s: tighten; 0.94 s: tighten; then too far."""
    one = Constraint("b", "boundeddifference", TWO, abstol=1.0, reltol=1e300)
    made, repeated = steps_made([one], lambda t: t, lambda t: 0.0, shortest=0.01, count=6)
    assert (ms(made), ms(repeated)) == ([100, 300, 360, 180, 22.5, 11.25], [90])


def test_a_violated_difference_is_tried_again_shorter() -> None:
    one = Constraint("b", "boundeddifference", PORT, abstol=1.0, reltol=1e300)
    made, repeated = steps_made([one], lambda t: 10.0 * t, first=1.0, count=2)
    assert (ms(made), ms(repeated)) == ([62.5, 31.25], [1000, 250])  # differences 10, 2.5; 0.625 is risky


def test_sampling_instants_are_hit() -> None:
    """At 0.2 s, 0.5 s, and so on. A bounded difference goes on behind them with the step that it had, where that is
    longer than 3 times 0.04 s (a difference of 0.1), but not than 1.2 times 0.14 s (one of 0.35)."""
    rate = Constraint("r", "samplingrate", first=200_000_000, interval=300_000_000)
    assert ms(steps_made([rate], count=5)[0]) == [100, 100, 300, 300, 300]
    bound = Constraint("b", "boundeddifference", PORT, abstol=1.0, reltol=1e300)
    assert ms(steps_made([rate, bound], lambda t: 2.5 * t, first=0.16, count=5)[0]) == [160, 40, 160, 140, 168]


def test_no_constraint_takes_the_longest_steps() -> None:
    assert ms(steps_made([], longest=0.5, count=3)[0]) == [100, 500, 500]
    assert ms(steps_made([], first=2.0, longest=0.5, count=3, room=[0.7])[0]) == [500, 200, 500]


def test_a_row_on_the_way_does_not_hide_a_crossing() -> None:
    """Steps that rows cut short count as that much less than a step to the crossing."""
    one = Constraint("z", "zerocrossing", PORT, order=1, abstol=0.01)
    made, repeated = steps_made([one], lambda t: 1 - t, room=[0.25 * n for n in range(1, 9)], count=24)
    instants = list(accumulate(made))
    assert repeated == [] and {250_000_000, 500_000_000, 750_000_000, 1_250_000_000} <= {*instants}
    assert min(abs(t - 1_000_000_000) for t in instants) < 10_000_000


# ---- runs ------------------------------------------------------------------------------------------------------------


def multimodel(place: Path, constraints: Any, *, stop: float = 1.2, **algorithm: Any) -> Path:
    """One FMU whose y is the time, and a parameter p of 1."""
    content = {
        "fmus": {"{A}": "strict.fmu"},
        "connections": {"{A}.one.r": ["{A}.two.s"]},
        "parameters": {"{A}.one.u": 1.0, "{A}.one.p": 1.0},
        "algorithm": {"type": "var-step", "size": [1e-6, 1], "initsize": 0.1, "constraints": constraints, **algorithm},
        "startTime": 0,
        "endTime": stop,
    }
    file = place / "mm.json"
    file.write_text(json.dumps(content, indent=1))
    return file


@pytest.fixture
def place(stricts: Any) -> Path:
    stricts.fmu(flags=f'{ABLE} canSerializeFMUstate="true"')
    root: Path = stricts.workshop.root
    return root


def times(out: Path) -> list[float]:
    found: list[float] = pq.read_table(out / "signals.parquet")["time"].to_pylist()
    return found


CROSSING = {"end": {"type": "zerocrossing", "ports": ["{A}.one.y", "{A}.one.p"], "order": 1, "abstol": 0.01}}


def test_a_multimodel_runs_and_so_does_what_it_is_converted_to(place: Path, stricts: Any, tmp_path: Path) -> None:
    """Rows at every step that counts, at the instants by hand, and at the end."""
    mm = multimodel(place, CROSSING)
    result = simulate(mm, RunOptions(out=tmp_path / "one"))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    wanted = [round(t, 9) for t in accumulate([0.0, *(step / 1e3 for step in MEET)])]
    assert times(tmp_path / "one") == pytest.approx([*wanted, 1.2], abs=1e-12)
    one = pq.read_table(tmp_path / "one" / "signals.parquet")
    np.testing.assert_allclose(one["{A}.one.y"], one["time"], rtol=1e-12)
    folder = convert(mm, tmp_path / "converted").file.parent
    assert simulate(folder, RunOptions(out=tmp_path / "two")).outcome == "done"
    assert one.equals(pq.read_table(tmp_path / "two" / "signals.parquet"))


def test_a_step_that_violates_a_constraint_is_repeated(place: Path, stricts: Any, tmp_path: Path) -> None:
    """y may change by 0.03: 0.1 and 0.025 s are tried; 0.025 of 0.03 is risky, half of it is good for ever."""
    mm = multimodel(place, {"b": {"type": "boundeddifference", "ports": ["{A}.one.y"], "abstol": 0.03, "reltol": 9}})
    result = simulate(mm, RunOptions(out=tmp_path / "out", until=0.1))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    assert times(tmp_path / "out") == [0.0, 0.025, 0.0375, 0.05, 0.0625, 0.075, 0.0875, 0.1]
    assert not [note for note in result.notes if "var-step" in note]


def test_where_an_fmu_cannot_go_back_the_step_counts_and_a_note_says_so(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu(flags='canHandleVariableCommunicationStepSize="true"')
    bound = {"b": {"type": "boundeddifference", "ports": ["{A}.one.y"], "abstol": 0.03, "reltol": 9}}
    result = simulate(multimodel(stricts.workshop.root, bound), RunOptions(out=tmp_path / "out", until=0.103))
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    assert times(tmp_path / "out") == [0.0, 0.1, 0.101, 0.103]  # 0.1 is too much: strongly tightened
    notes = json.loads((tmp_path / "out" / "manifest.json").read_text())["notes"]
    assert any("canGetAndSetFMUstate of {A}.one is false" in note for note in notes)
    assert (
        'var-step: 1 steps count although they violate constraint "b", the first from t = 0 s: FMUs cannot go back'
        in notes
    )


def test_the_shortest_step_counts_and_a_note_says_so(place: Path, tmp_path: Path) -> None:
    bound = {"b": {"type": "boundeddifference", "ports": ["{A}.one.y"], "abstol": 0.01, "reltol": 9}}
    result = simulate(multimodel(place, bound, size=[0.05, 1]), RunOptions(out=tmp_path / "out", until=0.15))
    assert times(tmp_path / "out") == [0.0, 0.05, 0.1, 0.15]
    assert any('3 steps count although they violate constraint "b"' in note for note in result.notes)
    assert any("0.05 s is the shortest step" in note for note in result.notes)


def test_rows_of_an_interval_and_changes_are_met(place: Path, tmp_path: Path) -> None:
    """Steps end at 0.25, 0.5, ...; p is 2 from 0.5 s on, so that y goes twice as fast."""
    folder = convert(multimodel(place, {}), tmp_path / "converted").file.parent
    out, given = tmp_path / "out", {"recording.interval": "0.25"}
    result = simulate(folder, RunOptions(out=out, overrides=given, at=[(0.5, "{A}.one.p", "2")], until=1.0))
    assert result.outcome == "done", result.error
    got = pq.read_table(out / "signals.parquet").to_pydict()
    assert (got["time"], got["{A}.one.y"]) == ([0.0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.25, 0.5, 1.0, 1.5])


def test_a_run_without_interval_goes_on_bit_for_bit(linears: Any, tmp_path: Path) -> None:
    """Checkpoints are at the ends of steps; the run that goes on from one makes the steps of the whole run."""
    linears.fmu()
    master = 'algorithm="var-step"><constraint type="zerocrossing"><port name="a.y"/></constraint></master>'
    system = linears.ssd(linears.component("a", x0=1.0, w2=9.0, step=0.01), master=master, stop=4.0)
    assert simulate(system, RunOptions(out=tmp_path / "whole", checkpoint_every=1.0)).outcome == "done"
    assert simulate(system, RunOptions(out=tmp_path / "plain")).outcome == "done"
    saved = sorted((tmp_path / "whole" / "checkpoints").iterdir())
    assert len(saved) >= 2
    origin = f"{tmp_path / 'whole'}@{saved[1].name}"
    assert simulate(system, RunOptions(out=tmp_path / "rest", origin=origin)).outcome == "done"
    whole, plain, rest = (pq.read_table(tmp_path / name / "signals.parquet") for name in ("whole", "plain", "rest"))
    assert whole.equals(plain) and whole.equals(rest)
    for n in range(3):  # cos 3t is zero at (n + 1/2) pi/3; a step ends within the tolerance of 0.001, slope 3
        assert min(abs(t - (n + 0.5) * math.pi / 3) for t in times(tmp_path / "plain")) < 0.001 / 3 * 1.01


def test_an_fmu_says_how_long_a_step_it_takes(linears: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    linears.fmu()
    master = 'algorithm="var-step" minimumStep="0.01"><constraint type="fmumaxstepsize"/></master>'
    system = linears.ssd(linears.component("a", x0=1.0, w2=1.0, step=0.1), master=master, stop=1.0)
    for limit, wanted in (("0.3", [0.0, 0.1, 0.4, 0.7, 1.0]), ("0.001", None), (None, [0.0, 0.1, 1.0])):
        monkeypatch.delenv("LINEAR_MAXIMUM", raising=False)
        if limit is not None:
            monkeypatch.setenv("LINEAR_MAXIMUM", limit)
        out = tmp_path / f"{limit}"
        assert simulate(system, RunOptions(out=out)).outcome == "done"
        assert times(out) == (wanted or [round(0.01 * n, 2) for n in range(101)])


def test_a_table_takes_steps_of_any_length(linears: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside an FMU that takes 0.3 s at most; y of a gain of 2 is twice the line t of the table."""
    monkeypatch.setenv("LINEAR_MAXIMUM", "0.3")
    linears.fmu()
    (linears.workshop.root / "in.csv").write_text("time,v\n0,0\n2,2\n")
    table = linears.workshop.component("t", "in.csv", "v:output", type="text/csv")
    one = linears.component("a", gain=2.0, rate=-1.0, step=0.1)
    master = 'algorithm="var-step"><constraint type="fmumaxstepsize"/></master>'
    out = tmp_path / "out"
    assert simulate(linears.ssd(table + one, "t/v a/u", master=master, stop=1.0), RunOptions(out=out)).outcome == "done"
    assert times(out) == [0.0, 0.1, 0.4, 0.7, 1.0]
    y = pq.read_table(out / "signals.parquet")["a.y"].to_pylist()
    assert y == pytest.approx([0.0, 0.0, 0.2, 0.8, 1.4], abs=1e-12)  # exchange is Jacobi's: of the step's beginning


def test_a_discarded_step_is_tried_shorter(linears: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LINEAR_LIMIT", "0.03")
    linears.fmu()
    for least, outcome in (("0.001", "done"), ("0.05", "failed")):
        system = linears.ssd(
            linears.component("a", x0=1.0, w2=1.0, step=0.1),
            master=f'algorithm="var-step" minimumStep="{least}"/>',
            stop=0.2,
        )
        result = simulate(system, RunOptions(out=tmp_path / least))
        assert result.outcome == outcome
    assert "0.05 s is the shortest step" in str(result.error)
    assert times(tmp_path / "0.001")[1] == 0.025


def discarding(stricts: Any, sizes: str, out: Path) -> RunResult:
    stricts.fmu(flags=ABLE)
    settings = f'<master xmlns="https://uav-cosim.org/ns/1" algorithm="var-step" {sizes}/>'
    after = stricts.workshop.annotation("org.uav-cosim.master", settings)
    part = stricts.component("a", mode=2, when=0.5, longest=0.1, u=1.0)
    system = stricts.workshop.ssd("strict.ssd", stricts.workshop.system(part, "", after=after))
    return simulate(system, RunOptions(out=out, until=0.85))


def test_a_step_is_tried_again_to_the_last_successful_time(stricts: Any, tmp_path: Path) -> None:
    """From 0.5 s on, the FMU discards steps longer than 0.1 s and names the time that it can reach; y' = 1.

    Every step begins with the full size, from the time reached: as Maestro does after a discarded step.
    """
    result = discarding(stricts, 'maximumStep="0.5"', tmp_path / "out")
    assert (result.outcome, stricts.complaints) == ("done", []), result.error
    assert times(tmp_path / "out") == [0.0, 0.5, 0.6, 0.7, 0.8, 0.85]
    assert stricts.steps[-8:] == [
        *("a 0 + 0.5", "a 0.5 + 0.35", "a 0.5 + 0.1", "a 0.6 + 0.25", "a 0.6 + 0.1"),
        *("a 0.7 + 0.15", "a 0.7 + 0.1", "a 0.8 + 0.05"),
    ]
    y = pq.read_table(tmp_path / "out" / "signals.parquet")["a.y"].to_pylist()
    assert y == pytest.approx([0.0, 0.5, 0.6, 0.7, 0.8, 0.85], abs=1e-12)


def test_no_discarded_step_is_tried_shorter_than_the_shortest(stricts: Any, tmp_path: Path) -> None:
    """0.1 s would do; 0.35 s / 4 is less than 0.2 s, which is tried instead."""
    result = discarding(stricts, 'minimumStep="0.2" maximumStep="0.5"', tmp_path / "out")
    assert result.outcome == "failed"
    text = "it could not step from 0.5 s to 0.7 s, only to 0.6 s; 0.2 s is the shortest step"
    assert text in str(result.error)
    assert times(tmp_path / "out") == [0.0, 0.5]


# ---- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "line", "message"),
    [
        ({"size": 0.1}, '"size"', "var-step needs size: [shortest, longest], two positive sizes in s"),
        ({"size": [-1, 1]}, '"size"', "two positive sizes in s"),
        ({"initsize": -0.1}, '"initsize"', "var-step needs initsize, the first step, a positive size in s"),
        ({"initsize": None}, '"initsize"', "var-step needs initsize"),
        ({"sizes": 1}, '"sizes"', 'algorithm: there is no key "sizes"; valid: type, size, initsize, constraints'),
        ({"constraints": []}, '"constraints"', "constraints: must be an object, not []"),
        ({"constraints": {"c": {"type": "x"}}}, '"c"', 'constraint "c": its type is "x"; valid: zerocrossing, '),
        ({"constraints": {"c": 1}}, '"c"', 'constraint "c": its type is null; valid: zerocrossing, '),
        (
            {"constraints": {"c": {"type": "zerocrossing", "ports": ["{A}.one.why"]}}},
            '"c"',
            'constraint "c": there is no variable "{A}.one.why"; ',
        ),
        ({"constraints": {"c": {"type": "zerocrossing", "ports": 3}}}, '"c"', "ports must be a list of variables"),
        ({"constraints": {"c": {"type": "zerocrossing"}}}, '"c"', "one port or two, here are 0"),
        (
            {"constraints": {"c": {"type": "zerocrossing", "ports": ["{A}.one.n"]}}},
            '"c"',
            'port "{A}.one.n" is a Integer; valid: Real',
        ),
        ({"constraints": {"c": {"type": "boundeddifference"}}}, '"c"', 'constraint "c": needs a port'),
        ({"constraints": {"c": {"type": "samplingrate"}}}, '"c"', 'constraint "c": needs a rate'),
        (
            {"constraints": {"c": {"type": "samplingrate", "rate": 1, "base": -12}}},
            '"c"',
            'base="-12" must be a whole number from -9 to 6',
        ),
        (
            {"constraints": {"c": {"type": "samplingrate", "rate": 1, "abstol": 1}}},
            '"abstol"',
            'there is no key "abstol"; valid: type, base, rate, startTime',
        ),
        (
            {"constraints": {"c": {"type": "zerocrossing", "ports": ["{A}.one.y"], "abstol": -1}}},
            '"c"',
            'abstol="-1" must be a number from 0 to',
        ),
        (
            {"constraints": {"c": {"type": "zerocrossing", "ports": ["{A}.one.y"], "order": 3}}},
            '"c"',
            'order="3" must be a whole number from 1 to 2',
        ),
        (
            {"constraints": {"c": {"type": "boundeddifference", "ports": ["{A}.one.y"], "skipDiscrete": 1}}},
            '"c"',
            "skipDiscrete: 1 is not true or false",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_line(place: Path, change: Any, line: str, message: str) -> None:
    file = multimodel(place, {}, **change) if "constraints" not in change else multimodel(place, change["constraints"])
    with pytest.raises(SystemDescriptionError) as caught:
        prepare(check(read_system(file)))
    problems = [p for p in caught.value.problems if message in p.message]
    assert problems, caught.value
    where = problems[0].where
    assert where.path == str(file) and where.line is not None
    assert line in file.read_text().splitlines()[where.line - 1]


def test_constraints_are_for_var_step_and_attributes_for_their_types(linears: Any) -> None:
    linears.fmu()
    inner = '<constraint type="zerocrossing" rate="1"><port name="a.y"/></constraint></master>'
    system = linears.ssd(linears.component("a", step=0.1), master='algorithm="jacobi">' + inner)
    with pytest.raises(SystemDescriptionError) as caught:
        prepare(check(read_system(system)))
    text = str(caught.value)
    assert '<constraint> is for algorithm="var-step", this is "jacobi"' in text
    assert 'constraint "zerocrossing": rate is for samplingrate, this is zerocrossing' in text


# ---- Maestro's recordings --------------------------------------------------------------------------------------------


@pytest.mark.skipif(not MAESTRO, reason="INTO_CPS_MAESTRO names no clone of Maestro")
@pytest.mark.parametrize("name", ["variable_step_WT", "slow_down_to_real_time", "legacy_rollback"])
def test_recordings_of_maestro(tmp_path: Path, name: str) -> None:
    """Its rows end where its next step would pass the end of the run; ours go on to it."""
    root = Path(MAESTRO) / "maestro"
    folder = root / "src" / "test" / "resources" / "jacobian_step_builder" / name
    env, values, how = (json.loads((folder / f"{one}.json").read_text()) for one in ("env", "config", "jacobianconfig"))
    content = {
        "fmus": {key: str(root / path) for key, path in env["fmus"].items()},
        "connections": env["connections"],
        "parameters": values["parameters"],
        "algorithm": how["stepAlgorithm"],
        "startTime": 0,
        "endTime": env["end_time"],
    }
    file = tmp_path / "mm.json"
    file.write_text(json.dumps(content))
    result = simulate(file, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    with (folder / "expectedoutputs.csv").open() as lines:
        head, *rows = csv.reader(lines)
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    for column, label in enumerate(head):
        wanted = [{"true": 1.0, "false": 0.0}.get(row[column]) for row in rows]
        wanted = [float(row[column]) if one is None else one for one, row in zip(wanted, rows, strict=True)]
        np.testing.assert_allclose(np.array(got[label][: len(rows)], dtype=float), wanted, rtol=0, atol=1e-6)

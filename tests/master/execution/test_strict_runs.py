"""Random systems of strict FMUs, driven in random order: whatever they do, they have nothing to complain about.

A machine builds a system, starts it, and advances by random numbers of steps with a change in between.
FMI 2 (strict.c): rates, wires, capabilities, faults; values are compared with a plain Python model of the same system.
FMI 3 (strict3.c, clocked.c): also early returns, events, Clocks and discards; Clocks have ticked as often as fractions
say. STRICT_EXAMPLES=1000 in the environment makes more systems.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from cosim_master.diagnostics.errors import RunFailed, RunTerminated
from cosim_master.execution.execution import Execution
from cosim_master.execution.run.opening import Setup
from cosim_master.stepping.layout import make_layout
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import TimeGrid, time_grid
from tests.master.fmus import strict, strict3
from tests.master.fmus.clocked import clocked

BASE = 0.25
FLAGS = {"able": strict.ABLE, "fixed": "", "variable": 'canHandleVariableCommunicationStepSize="true"'}
MODES = {"none": 0, "short": 1, "told": 2, "ends": 3, "pends": 4, "error": 5, "fatal": 6, "never": 7, "warns": 11}

STRICT3 = {
    "events": f'{strict3.ABLE} hasEventMode="true"',
    "able": strict3.ABLE,
    "fixed": 'hasEventMode="true"',
    "plain": "",
}
PERIODS = {"often": Fraction(1, 10), "thirds": Fraction(1, 3), "steps": Fraction(1, 2), "seldom": Fraction(7, 10)}
MODES3 = (0, 1, 2, 4, 8, 9, 10, 11, 12, 14, 15)
PORTS3 = "f64_in[1]:input f64_out[1]:output i32_in[1]:input events:output"
CLOCKED = "constant:input go:input fire:output u:input y:output v:input w:output all:output"
OUT = {"strict": ("f64_out[1]", "events"), "clocked": ("y", "w", "all")}
IN = {"strict": ("f64_in[1]", "i32_in[1]"), "clocked": ("u", "v")}
WHOLE = ("events", "all", "i32_in[1]")


class Machine(RuleBasedStateMachine):
    """A system in an execution, of which a subclass draws the system and knows the results."""

    stricts: Any

    def __init__(self) -> None:
        super().__init__()
        self.execution: Execution | None = None
        self.over = False

    def start(self, checked: CheckedSystem, clock: TimeGrid, changes: Sequence[Change]) -> None:
        network = network_of(checked, None)
        self.steps = clock.steps
        try:
            self.execution = Execution(checked, clock, make_layout(checked, network), network, Setup(changes=changes))
        except (RunFailed, RunTerminated) as error:
            self.over = True
            self.starts_wrong(error)

    def starts_wrong(self, error: RunFailed | RunTerminated) -> None:
        """Asserts that one of the instances was to fail at the start."""

    def ends(self, ended: RunTerminated) -> None:
        """Asserts that an instance was to end the run."""
        raise NotImplementedError

    def fails(self, failed: RunFailed) -> None:
        """Asserts that the instances that failed were to do so."""
        raise NotImplementedError

    def compare(self, execution: Execution) -> None:
        """Compares values with those that are known in advance."""
        raise NotImplementedError

    @precondition(lambda self: self.execution is not None and not self.over)
    @rule(n=st.integers(1, 5))
    def advance(self, n: int) -> None:
        execution = self.execution
        assert execution is not None
        before = execution.k
        try:
            execution.advance(before + n)
        except RunTerminated as ended:
            self.over = True
            self.ends(ended)
            return
        except RunFailed as failed:
            self.over = True
            self.fails(failed)
            return
        assert execution.k == min(before + n, self.steps)

    @rule()
    def wait(self) -> None:
        """Does nothing: a rule is needed when the run is over."""

    @precondition(lambda self: self.execution is not None and not self.over)
    @invariant()
    def values_are_known(self) -> None:
        assert self.execution is not None
        self.compare(self.execution)

    def teardown(self) -> None:
        try:
            if self.execution is not None:
                self.execution.__exit__(RunFailed, None, None)
        finally:
            assert self.stricts.complaints == []
            # All are freed, but for those of a corrupted FMU.
            left = [one for one in getattr(self.execution, "slaves", ()) if one.alive]
            assert all(one.library.corrupted for one in left)


class Machine2(Machine):
    """Systems of FMI 2 with values, texts and faults."""

    @initialize(data=st.data(), count=st.integers(1, 3))
    def system(self, data: st.DataObject, count: int) -> None:
        names = "abc"[:count]
        self.periods = {n: data.draw(st.sampled_from([1, 1, 2, 3]), label="period") for n in names}
        self.kinds = {n: data.draw(st.sampled_from(["able", "able", "able", "fixed", "variable"])) for n in names}
        self.modes = {n: data.draw(st.sampled_from(list(MODES)), label="mode") for n in names}
        self.when = {n: BASE * data.draw(st.integers(0, 8), label="when") for n in names}
        inputs = data.draw(st.dictionaries(st.sampled_from(names), st.sampled_from(names)))
        self.wires = {target: source for target, source in inputs.items() if target != source}
        texts = data.draw(st.booleans(), label="texts")
        parts = ""
        for n in names:
            values = {"u": 1.0, "when": self.when[n], "longest": BASE / 5, "mode": MODES[self.modes[n]]}
            parts += self.stricts.component(n, f"{self.kinds[n]}.fmu", step=BASE * self.periods[n], **values)
        links = [f"{source}/y {target}/u" for target, source in self.wires.items()]
        links += [f"{source}/r {target}/s" for target, source in self.wires.items() if texts]
        checked = check(read_system(self.stricts.ssd(parts, *links, stop=BASE * 12)))
        clock = time_grid(checked)
        self.change_at = data.draw(st.integers(0, clock.steps - 1), label="change")
        self.changed = self.change_at % clock.periods[0] == 0
        variable = checked.instances[0].fmu.variables["p"]
        self.start(checked, clock, (Change(self.change_at, 0, variable, 3.0),) if self.changed else ())

    def ends(self, ended: RunTerminated) -> None:
        assert self.modes[ended.instance] == "ends"

    def fails(self, failed: RunFailed) -> None:
        culprits = {failure.instance for failure in failed.failures}
        allowed = {"pends", "error", "fatal", "never", "short", "told", "ends"}
        assert all(self.modes[name] in allowed for name in culprits)
        if all(kind == "able" for kind in self.kinds.values()):  # then it takes more than a short step to fail
            assert any(self.modes[name] not in ("short", "told") for name in culprits)

    def compare(self, execution: Execution) -> None:
        """Where nothing is repeated and all have one rate, the exchange can be written down in three lines."""
        if set(self.modes.values()) - {"none", "warns"} or set(self.periods.values()) != {1}:
            return
        y = dict.fromkeys(self.modes, 0.0)
        for k in range(execution.k):
            u = {n: y[self.wires[n]] if n in self.wires else 1.0 for n in y}
            gain = {n: 3.0 if self.changed and n == min(y) and k >= self.change_at else 1.0 for n in y}
            y = {n: y[n] + BASE * gain[n] * u[n] for n in y}
        index = execution.layout.ports["Real"].index
        assert {n: execution.plan.real_out[index[n, "y"]] for n in y} == pytest.approx(y, rel=1e-12)


class Machine3(Machine):
    """Systems of FMI 3, with and without Clocks."""

    @initialize(data=st.data(), count=st.integers(1, 4))
    def system(self, data: st.DataObject, count: int) -> None:
        names = "abcd"[:count]
        kinds = {n: data.draw(st.sampled_from(["clocked", "clocked", "strict"]), label="kind") for n in names}
        self.periods: dict[str, Fraction] = {}
        self.modes: set[int] = set()
        self.fires: dict[str, str] = {}
        parts = "".join(self.clocked(data, n) if kinds[n] == "clocked" else self.strict(data, n) for n in names)
        wires = set()
        for target in names:
            source = data.draw(st.sampled_from(names), label="source")
            out = data.draw(st.sampled_from(OUT[kinds[source]]))
            into = data.draw(st.sampled_from(IN[kinds[target]]))
            # No loops: they would have to be solved at initialization, which is not what this is about.
            if source < target and (out in WHOLE or into not in WHOLE):
                wires.add(f"{source}/{out} {target}/{into}")
            driver = data.draw(st.sampled_from(names), label="driver")
            if kinds[driver] == kinds[target] == "clocked":
                wires.add(f"{driver}/fire {target}/go")
                self.fires[target] = driver
        checked = check(read_system(self.stricts.ssd(parts, *sorted(wires), stop=BASE * 12)))
        clock = time_grid(checked)
        variable = checked.instances[0].fmu.variables[IN[kinds["a"]][1]]
        at = data.draw(st.integers(0, clock.steps - 1), label="change")
        free = not any(wire.endswith(f" a/{variable.name}") for wire in wires) and at % clock.periods[0] == 0
        self.start(checked, clock, (Change(at, 0, variable, 3),) if free else ())

    def clocked(self, data: st.DataObject, name: str) -> str:
        when = BASE * data.draw(st.integers(0, 6), label="when")
        period = data.draw(st.sampled_from(list(PERIODS)), label="period")
        self.periods[name] = PERIODS[period]
        law = data.draw(st.integers(0, 4), label="rule")
        delay = data.draw(st.sampled_from([0.05, 0.1, 0.5]), label="delay")
        early = data.draw(st.integers(0, 1), label="early")
        values = {"rule": law, "when": when, "delay": delay, "early": early}
        component: str = self.stricts.component(name, f"{period}.fmu", ports=CLOCKED, **values)
        return component

    def strict(self, data: st.DataObject, name: str) -> str:
        when = BASE * data.draw(st.integers(0, 6), label="when")
        kind = data.draw(st.sampled_from(list(STRICT3)), label="flags")
        mode = data.draw(st.sampled_from(MODES3), label="mode")
        rate = data.draw(st.sampled_from([1, 1, 2, 3]), label="rate")
        self.modes.add(mode)
        values = {"mode": mode, "when": when, "longest": BASE / 5}
        component: str = self.stricts.component(name, f"{kind}{rate}.fmu", ports=PORTS3, **values)
        return component

    def starts_wrong(self, error: RunFailed | RunTerminated) -> None:
        assert self.modes & {1, 2, 14}, error

    def ends(self, ended: RunTerminated) -> None:
        assert self.modes & {4, 14}, ended

    def fails(self, failed: RunFailed) -> None:
        assert self.modes & {1, 2}, failed

    def compare(self, execution: Execution) -> None:
        now = Fraction(execution.time)
        if now % Fraction(2 * BASE):  # FMUs with Clocks step by that
            return
        index, values = execution.layout.ports["Integer"].index, execution.plan.int_out
        for n, period in self.periods.items():
            assert values[index[n, "ticks_constant"]] == now // period + 1
            fired = values[index[self.fires[n], "ticks_fire"]] if n in self.fires else 0
            assert values[index[n, "ticks_go"]] == fired


@pytest.fixture
def fmus2(stricts: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    for kind, flags in FLAGS.items():
        stricts.fmu(f"{kind}.fmu", flags=flags, step=BASE, guid="fixed" if kind == "fixed" else "strict")
    monkeypatch.delenv("STRICT_CALLS")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    return stricts


@pytest.fixture
def fmus3(stricts3: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    for kind, flags in STRICT3.items():
        for rate in (1, 2, 3):
            stricts3.fmu(f"{kind}{rate}.fmu", flags=flags, step=BASE * rate)
    for name, period in PERIODS.items():
        counters = f'resolution="{period.denominator}" intervalCounter="{period.numerator}" supportsFraction="true"'
        timing_ = f'intervalDecimal="{float(period)}" {counters}'
        options: dict[str, Any] = {"period": float(period), "step": 2 * BASE, "constant": timing_}
        clocked(stricts3, f"{name}.fmu", "constant", "countdown", "changing", "go", "fire", **options)
    monkeypatch.delenv("STRICT3_CALLS")
    return stricts3


@pytest.mark.slow
@pytest.mark.usefixtures("own_cache")
@pytest.mark.parametrize(("machine", "fmus"), [(Machine2, "fmus2"), (Machine3, "fmus3")], ids=["FMI 2", "FMI 3"])
def test_strict_fmus_have_nothing_to_complain_about(
    machine: type[Machine], fmus: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "stricts", request.getfixturevalue(fmus), raising=False)
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=int(os.environ.get("STRICT_EXAMPLES", "25")),
            stateful_step_count=6,
            deadline=None,
            database=None,
            derandomize=True,
            phases=[Phase.generate],
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
        ),
    )

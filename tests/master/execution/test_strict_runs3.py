"""Random systems of strict FMI 3 FMUs, driven in random order: early returns, events, Clocks and discards.

The machine builds a system of FMUs with and without Clocks (strict3.c, clocked.c), rates, wires of values and Clocks,
what goes wrong and when; starts it, advances by random numbers of steps with a change in between. No FMU has anything
to complain about, and Clocks have ticked as often as fractions say. STRICT_EXAMPLES=1000 makes more of them.
"""

from __future__ import annotations

import os
from fractions import Fraction
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
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid
from tests.master.clocked import clocked
from tests.master.strict3 import ABLE, Stricts3

BASE = 0.25
EVENTS = f'{ABLE} hasEventMode="true"'
STRICT = {"events": EVENTS, "able": ABLE, "fixed": 'hasEventMode="true"', "plain": ""}
PERIODS = {"often": Fraction(1, 10), "thirds": Fraction(1, 3), "steps": Fraction(1, 2), "seldom": Fraction(7, 10)}
MODES = (0, 1, 2, 4, 8, 9, 10, 11, 12, 14, 15)
PORTS = "f64_in[1]:input f64_out[1]:output i32_in[1]:input events:output"
CLOCKED = "constant:input go:input fire:output u:input y:output v:input w:output all:output"
OUT = {"strict": ("f64_out[1]", "events"), "clocked": ("y", "w", "all")}
IN = {"strict": ("f64_in[1]", "i32_in[1]"), "clocked": ("u", "v")}
WHOLE = ("events", "all", "i32_in[1]")


class Machine(RuleBasedStateMachine):
    stricts: Stricts3

    def __init__(self) -> None:
        super().__init__()
        self.execution: Execution | None = None
        self.over = False

    @initialize(data=st.data(), count=st.integers(1, 4))
    def system(self, data: st.DataObject, count: int) -> None:
        names = "abcd"[:count]
        kinds = {n: data.draw(st.sampled_from(["clocked", "clocked", "strict"]), label="kind") for n in names}
        self.periods: dict[str, Fraction] = {}
        self.modes: set[int] = set()
        parts, self.fires = "", {}
        for n in names:
            when = BASE * data.draw(st.integers(0, 6), label="when")
            if kinds[n] == "clocked":
                period = data.draw(st.sampled_from(list(PERIODS)), label="period")
                self.periods[n] = PERIODS[period]
                rule_ = data.draw(st.integers(0, 4), label="rule")
                delay = data.draw(st.sampled_from([0.05, 0.1, 0.5]), label="delay")
                early = data.draw(st.integers(0, 1), label="early")
                values = {"rule": rule_, "when": when, "delay": delay, "early": early}
                parts += self.stricts.component(n, f"{period}.fmu", ports=CLOCKED, **values)
            else:
                kind = data.draw(st.sampled_from(list(STRICT)), label="flags")
                mode = data.draw(st.sampled_from(MODES), label="mode")
                rate = data.draw(st.sampled_from([1, 1, 2, 3]), label="rate")
                self.modes.add(mode)
                values = {"mode": mode, "when": when, "longest": BASE / 5}
                parts += self.stricts.component(n, f"{kind}{rate}.fmu", ports=PORTS, **values)
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
        clock, network = time_grid(checked), network_of(checked, None)
        self.steps = clock.steps
        variable = checked.instances[0].fmu.variables[IN[kinds["a"]][1]]
        at = data.draw(st.integers(0, self.steps - 1), label="change")
        free = not any(wire.endswith(f" a/{variable.name}") for wire in wires) and at % clock.periods[0] == 0
        changes = (Change(at, 0, variable, 3),) if free else ()
        try:
            self.execution = Execution(checked, clock, make_layout(checked, network), network, Setup(changes=changes))
        except (RunFailed, RunTerminated):
            self.over = True
            assert self.modes & {1, 2, 14}

    @precondition(lambda self: self.execution is not None and not self.over)
    @rule(n=st.integers(1, 5))
    def advance(self, n: int) -> None:
        execution = self.execution
        assert execution is not None
        before = execution.k
        try:
            execution.advance(before + n)
        except RunTerminated:
            self.over = True
            assert self.modes & {4, 14}
            return
        except RunFailed as failed:
            self.over = True
            assert self.modes & {1, 2}, failed
            return
        assert execution.k == min(before + n, self.steps)

    @rule()
    def wait(self) -> None:
        """Something that can be done when all is over."""

    @precondition(lambda self: self.execution is not None and not self.over)
    @invariant()
    def clocks_have_ticked_as_often_as_they_should(self) -> None:
        execution = self.execution
        assert execution is not None
        now = Fraction(execution.time)
        if now % Fraction(2 * BASE):  # FMUs with Clocks step by that
            return
        index, values = execution.layout.ports["Integer"].index, execution.plan.int_out
        for n, period in self.periods.items():
            assert values[index[n, "ticks_constant"]] == now // period + 1
            fired = values[index[self.fires[n], "ticks_fire"]] if n in self.fires else 0
            assert values[index[n, "ticks_go"]] == fired

    def teardown(self) -> None:
        try:
            if self.execution is not None:
                self.execution.__exit__(RunFailed, None, None)
        finally:
            assert self.stricts.complaints == []
            assert all(not one.alive for one in getattr(self.execution, "slaves", ()))


@pytest.mark.slow
@pytest.mark.usefixtures("own_cache")
def test_strict_fmus_of_fmi_3_have_nothing_to_complain_about(stricts3: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind, flags in STRICT.items():
        for rate in (1, 2, 3):
            stricts3.fmu(f"{kind}{rate}.fmu", flags=flags, step=BASE * rate)
    for name, period in PERIODS.items():
        counters = f'resolution="{period.denominator}" intervalCounter="{period.numerator}" supportsFraction="true"'
        timing_ = f'intervalDecimal="{float(period)}" {counters}'
        options: dict[str, Any] = {"period": float(period), "step": 2 * BASE, "constant": timing_}
        clocked(stricts3, f"{name}.fmu", "constant", "countdown", "changing", "go", "fire", **options)
    monkeypatch.delenv("STRICT3_CALLS")
    monkeypatch.setattr(Machine, "stricts", stricts3, raising=False)
    run_state_machine_as_test(
        Machine,
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

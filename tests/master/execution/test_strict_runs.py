"""Random systems of strict FMUs, driven in random order: whatever they do, they have nothing to complain about.

The machine builds a system (rates, wires, capabilities, what goes wrong and when), starts it, advances by random
numbers of steps with a change in between, and compares what it gets with a plain Python model of the same system.
STRICT_EXAMPLES=1000 in the environment makes more of them.
"""

from __future__ import annotations

import os
import tempfile
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
from cosim_master.fmi.slaves.fmi2 import Instance2
from cosim_master.stepping.layout import make_layout
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid
from tests.master.strict import ABLE, Stricts

BASE = 0.25
FLAGS = {"able": ABLE, "fixed": "", "variable": 'canHandleVariableCommunicationStepSize="true"'}
MODES = {"none": 0, "short": 1, "told": 2, "ends": 3, "pends": 4, "error": 5, "fatal": 6, "never": 7, "warns": 11}


class Machine(RuleBasedStateMachine):
    stricts: Stricts

    def __init__(self) -> None:
        super().__init__()
        self.execution: Execution | None = None
        self.over = False

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
        path = self.stricts.ssd(parts, *links, stop=BASE * 12)
        checked = check(read_system(path))
        clock, network = time_grid(checked), network_of(checked, None)
        self.steps = clock.steps
        self.change_at = data.draw(st.integers(0, self.steps - 1), label="change")
        first = checked.instances[0]
        changes = ()
        if self.change_at % clock.periods[0] == 0:
            changes = (Change(self.change_at, 0, first.fmu.variables["p"], 3.0),)
        self.changed = bool(changes)
        try:
            self.execution = Execution(checked, clock, make_layout(checked, network), network, Setup(changes=changes))
        except (RunFailed, RunTerminated):
            self.over = True

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
            assert self.modes[ended.instance] == "ends"
            return
        except RunFailed as failed:
            self.over = True
            culprits = {failure.instance for failure in failed.failures}
            allowed = {"pends", "error", "fatal", "never", "short", "told", "ends"}
            assert all(self.modes[name] in allowed for name in culprits)
            if all(kind == "able" for kind in self.kinds.values()):  # then it takes more than a short step to fail
                assert any(self.modes[name] not in ("short", "told") for name in culprits)
            return
        assert execution.k == min(before + n, self.steps)

    @rule()
    def wait(self) -> None:
        """Something that can be done when all is over."""

    @precondition(lambda self: self.execution is not None and not self.over)
    @invariant()
    def values_are_those_of_a_plain_model(self) -> None:
        """Where nothing is repeated and all have one rate, the exchange can be written down in three lines."""
        execution = self.execution
        assert execution is not None
        if set(self.modes.values()) - {"none", "warns"} or set(self.periods.values()) != {1}:
            return
        y = dict.fromkeys(self.modes, 0.0)
        for k in range(execution.k):
            u = {n: y[self.wires[n]] if n in self.wires else 1.0 for n in y}
            gain = {n: 3.0 if self.changed and n == min(y) and k >= self.change_at else 1.0 for n in y}
            y = {n: y[n] + BASE * gain[n] * u[n] for n in y}
        index = execution.layout.ports["Real"].index
        assert {n: execution.plan.real_out[index[n, "y"]] for n in y} == pytest.approx(y, rel=1e-12)

    def teardown(self) -> None:
        try:
            if self.execution is not None:
                self.execution.__exit__(RunFailed, None, None)
        finally:
            assert self.stricts.complaints == []
            assert all(not alive(one) for one in getattr(self.execution, "slaves", ()))


def alive(one: Instance2) -> bool:
    """Whether it should have been freed: all are, but for those of a corrupted FMU."""
    return one.alive and not one.library.corrupted


@pytest.mark.slow
def test_strict_fmus_have_nothing_to_complain_about(stricts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind, flags in FLAGS.items():
        stricts.fmu(f"{kind}.fmu", flags=flags, step=BASE, guid="fixed" if kind == "fixed" else "strict")
    monkeypatch.delenv("STRICT_CALLS")
    monkeypatch.setattr(Machine, "stricts", stricts, raising=False)
    with tempfile.TemporaryDirectory() as folder:
        monkeypatch.setenv("TMPDIR", str(Path(folder)))
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

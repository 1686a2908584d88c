"""Selects the master algorithm of a system."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cosim_master.execution.algorithms.algorithm import Algorithm, verify_rollback
from cosim_master.execution.algorithms.fixed_step import FixedStep
from cosim_master.execution.algorithms.iteration import Iteration
from cosim_master.execution.algorithms.richardson import Richardson
from cosim_master.execution.algorithms.variable_step import VariableStep
from cosim_master.execution.preparation.stimuli import Agenda
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.driver import Steps
from cosim_master.execution.run.state import RunState
from cosim_master.system.settings.master import MasterSettings

__all__ = ["algorithm_for"]


def _iteration(state: RunState, master: MasterSettings) -> Steps:
    verify_rollback(state, [i for loop in master.loops for i in loop], master.algorithm)
    return Iteration(state.plan, state.layout, state.slaves, master)


_STEPS: Mapping[str, Callable[[RunState, MasterSettings], Steps]] = {
    "gauss-seidel": _iteration,
    "fixed-point": _iteration,
    "quasi-newton": _iteration,
}
"""The makers of steps that replace the compiled loop (`MasterSettings.in_python`)."""


def algorithm_for(
    master: MasterSettings,
    state: RunState,
    blocks: Blocks,
    agenda: Agenda,
    change: Callable[[int], bool],
    every: int,
) -> Algorithm:
    """Creates the algorithm of a run, after a test of the instances that must be able to go back to an earlier state.

    Raises:
        RunFailed: an instance failed the test.
    """
    if master.constrained:
        if not master.irreversible:
            verify_rollback(state, range(len(state.slaves)), master.algorithm)
        return VariableStep(state, blocks, master, agenda, change, every)
    if master.variable:
        verify_rollback(state, range(len(state.slaves)), master.algorithm)
        return Richardson(state, blocks, master, agenda, change, every)
    steps = _STEPS[master.algorithm](state, master) if master.in_python else None
    return FixedStep(state, blocks, agenda, change, steps)

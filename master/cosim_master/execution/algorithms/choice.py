"""The algorithm that a system asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cosim_master.execution.algorithms.algorithm import Algorithm, verify_rollback
from cosim_master.execution.algorithms.fixed_step import FixedStep
from cosim_master.execution.algorithms.iteration import Iteration
from cosim_master.execution.algorithms.richardson import Richardson
from cosim_master.execution.algorithms.variable_step import VariableStep
from cosim_master.execution.run.driver import Steps
from cosim_master.execution.run.state import RunState
from cosim_master.execution.run.writing import Writing
from cosim_master.execution.stimuli import Agenda
from cosim_master.system.settings.master import Coupling

__all__ = ["algorithm_for"]


def _iteration(state: RunState, coupling: Coupling) -> Steps:
    verify_rollback(state, [i for loop in coupling.loops for i in loop], coupling.algorithm)
    return Iteration(state.plan, state.places, state.living, coupling)


_STEPS: Mapping[str, Callable[[RunState, Coupling], Steps]] = {
    "fixed-point": _iteration,
    "quasi-newton": _iteration,
}
"""What makes the steps in place of the compiled loop (`Coupling.in_python`)."""


def algorithm_for(
    coupling: Coupling,
    state: RunState,
    writing: Writing,
    agenda: Agenda,
    change: Callable[[int], bool],
    every: int,
) -> Algorithm:
    """Makes the algorithm of a run, once the instances that it takes back have proved that they allow it.

    Raises:
        RunFailed: one does not.
    """
    if coupling.constrained:
        if not coupling.irreversible:
            verify_rollback(state, range(len(state.living)), coupling.algorithm)
        return VariableStep(state, writing, coupling, agenda, change, every)
    if coupling.variable:
        verify_rollback(state, range(len(state.living)), coupling.algorithm)
        return Richardson(state, writing, coupling, agenda, change, every)
    steps = _STEPS[coupling.algorithm](state, coupling) if coupling.in_python else None
    return FixedStep(state, writing, agenda, change, steps)

"""Iterates the instances that depend on each other within a step, by repeating it: three algorithms.

    iteration = Iteration(plan, layout, slaves, master)
    iteration.step(t)      one macro step of all instances; failures are in the plan, as the compiled loop leaves them
    iteration.close()      frees the copies of states

Groups of instances step in the order of their dependencies. A group that depends on itself is stepped together, with
values x for the outputs that its members exchange at the end of the step. The step yields outputs F(x). While x and
F(x) differ, all members go back and step again with other values:

    fixed point     x + relaxation * (F(x) - x)
    quasi-Newton    F(x) + W c, where c minimizes |V c + F(x) - x|; the columns of V and W are the differences of
                    F(x) - x and F(x) to those of earlier iterations in this step

(IQN-ILS: Degroote, Bathe, Vierendeels, Performance of a new partitioned procedure versus a monolithic procedure in
fluid-structure interaction, Computers and Structures 87, 2009.)

Gauss-Seidel with iterations repeats the step of a group as well, but its members step one after the other, each with
the newest outputs of the others; after the last try, the run goes on, settled or not.

Integers and booleans are iterated until they do not change. No data are carried over from one step to the next, so a
resumed or repeated run yields the same results.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import NotConverged
from cosim_master.fmi.calls import KINDS
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.kernels.instances import step_each, step_together
from cosim_master.stepping.kernels.tables import FAILURES, Plan
from cosim_master.stepping.layout import Layout
from cosim_master.system.settings.master import MasterSettings

__all__ = ["Iteration"]


@dataclass(frozen=True, slots=True)
class _Loop:
    """Instances that depend on each other, and the places of the outputs that they exchange."""

    members: NDArray[np.int64]
    reals: NDArray[np.int64]
    wholes: NDArray[np.int64]
    names: tuple[str, ...]
    """Names of the reals, then of the integers and booleans."""


class Iteration:
    """The steps of one run. Call `close` before the instances are freed."""

    def __init__(self, plan: Plan, layout: Layout, slaves: Sequence[Slave], master: MasterSettings) -> None:
        self._plan, self._master, self._slaves = plan, master, slaves
        self._states = {i: ctypes.c_void_p() for group in master.loops for i in group}
        self._parts: list[NDArray[np.int64] | _Loop] = []
        alone: list[int] = []
        inside = set(master.loops)
        for group in master.groups:
            if group not in inside:
                alone += group
                continue
            if alone:
                self._parts.append(np.array(alone, dtype=np.int64))
            alone = []
            self._parts.append(_loop(group, layout, master))
        if alone:
            self._parts.append(np.array(alone, dtype=np.int64))
        self.evaluations = 0
        """The number of steps of loops so far."""
        self._unsettled: dict[str, tuple[int, float]] = {}
        """For loops of Gauss-Seidel, by members: the number of steps without convergence, and the time of the first."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the steps of Gauss-Seidel that count without convergence."""
        return tuple(
            f"gauss-seidel: {count} steps of {names} count although their outputs still change after "
            f"{self._master.iterations} tries, the first from t = {time:.9g} s"
            for names, (count, time) in self._unsettled.items()
        )

    def step(self, time: float) -> None:
        """Exchanges and steps all instances, beginning at `time` [s].

        Raises:
            NotConverged: a loop does not converge; its members have been stepped.
            FmuError: an FMU fails to save or restore its state.
        """
        for part in self._parts:
            if not isinstance(part, _Loop):
                step_each(self._plan, part)
            elif self._plan.counters[FAILURES] > 0:
                step_together(self._plan, part.members)  # after a failure, the others still finish their step
            elif self._master.algorithm == "gauss-seidel":
                self._sweep(part, time)
            else:
                self._iterate(part, time)

    def _save(self, loop: _Loop, time: float) -> None:
        for i in loop.members:
            self._slaves[i].time = time
            self._slaves[i].save_state(self._states[int(i)])

    def _sweep(self, loop: _Loop, time: float) -> None:
        """Steps the members one after the other; repeats it until their outputs do not change from try to try."""
        plan, master = self._plan, self._master
        self._save(loop, time)
        for n in range(master.iterations):
            before, discrete = plan.real_out[loop.reals].copy(), plan.int_out[loop.wholes].copy()
            for i in loop.members if n > 0 else ():
                self._slaves[i].restore_state(self._states[int(i)])
            step_each(plan, loop.members)
            self.evaluations += 1
            if plan.counters[FAILURES] > 0:
                return
            reals = plan.real_out[loop.reals]
            close = np.abs(reals - before) <= master.tolerance * np.maximum(1.0, np.abs(reals))
            if bool(close.all()) and np.array_equal(plan.int_out[loop.wholes], discrete):
                return
        names = ", ".join(self._slaves[i].name for i in loop.members)
        count, first = self._unsettled.get(names, (0, time))
        self._unsettled[names] = (count + 1, first)

    def _iterate(self, loop: _Loop, time: float) -> None:
        plan, master = self._plan, self._master
        self._save(loop, time)
        guess = plan.real_out[loop.reals].copy()
        discrete = plan.int_out[loop.wholes].copy()
        tries: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        for n in range(master.iterations):
            if n > 0:
                for i in loop.members:
                    self._slaves[i].restore_state(self._states[int(i)])
                plan.real_out[loop.reals] = guess
                plan.int_out[loop.wholes] = discrete
            step_together(plan, loop.members)
            self.evaluations += 1
            if plan.counters[FAILURES] > 0:
                return
            reals, wholes = plan.real_out[loop.reals].copy(), plan.int_out[loop.wholes].copy()
            residual = reals - guess
            same = np.array_equal(wholes, discrete)
            if same and bool((np.abs(residual) <= master.tolerance * np.maximum(1.0, np.abs(reals))).all()):
                return
            tries.append((reals, residual))
            last, before = guess, discrete
            guess = self._next(guess, tries)
            if not same:
                tries.clear()  # with other integers, F is a different function
            discrete = wholes
        names = loop.names
        values = [*reals, *wholes]
        residuals = [*(reals - last), *(wholes - before)]
        rows = [(name, float(v), float(r)) for name, v, r in zip(names, values, residuals, strict=True) if r != 0.0]
        raise NotConverged(master.algorithm, time, master.iterations, rows)

    def _next(
        self, guess: NDArray[np.float64], tries: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]
    ) -> NDArray[np.float64]:
        """Returns the next guess, given these outputs and residuals; the last ones belong to `guess`."""
        reals, residual = tries[-1]
        if self._master.algorithm == "fixed-point" or len(tries) == 1:
            return guess + self._master.relaxation * residual
        scale = 1.0 / np.maximum(1.0, np.abs(reals))
        v = np.array([(other - residual) * scale for _, other in reversed(tries[:-1])]).T
        w = np.array([other - reals for other, _ in reversed(tries[:-1])]).T
        with np.errstate(all="ignore"):
            if not (np.isfinite(v).all() and np.isfinite(w).all()):
                return guess + self._master.relaxation * residual
            c: Any = np.linalg.lstsq(v, -residual * scale, rcond=None)[0]
        return np.asarray(reals + w @ c, dtype=np.float64)

    def close(self) -> None:
        """Frees the copies of states."""
        for i, state in self._states.items():
            self._slaves[i].free_state(state)


def _loop(group: Sequence[int], layout: Layout, master: MasterSettings) -> _Loop:
    names = {layout.instances[i].name for i in group}
    sources = sorted(
        {
            link.source
            for link in layout.links
            if link.source[0] in names and link.target[0] in names and link.target not in master.delays
        }
    )
    found: dict[str, list[tuple[int, str]]] = {kind: [] for kind in KINDS}
    for source in sources:
        kind = next(kind for kind in KINDS if source in layout.ports[kind].index)
        index = layout.ports[kind].index[source]
        wide = layout.ports[kind].outputs[index][1].wide
        found[kind] += [(index + half, ".".join(source)) for half in range(1 + wide)]
    integers = len(layout.ports["Integer"].outputs)
    wholes = [*found["Integer"], *((i + integers, name) for i, name in found["Boolean"])]
    return _Loop(
        np.array(group, dtype=np.int64),
        np.array([i for i, _ in found["Real"]], dtype=np.int64),
        np.array([i for i, _ in wholes], dtype=np.int64),
        tuple(name for _, name in [*found["Real"], *wholes]),
    )

"""Solves a loop of connections during initialization: finds values that do not change when propagated once more.

The first method is propagation: each output's value is passed to its inputs repeatedly. It converges for damped loops,
and for loops that only seem to be loops. If it does not converge, Newton's method is applied to the real values, with a
Jacobian from finite differences and with steps that are halved until they improve the result. Integers, booleans and
strings are only propagated.

This module does not depend on FMUs: propagation is a function argument.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import LoopError

__all__ = ["TOLERANCE", "settle"]

TOLERANCE = 1e-10
"""A real has converged if it changes by at most this, relative to 1 or to its initial magnitude."""
_ROUNDS, _NEWTON_STEPS, _HALVINGS = 30, 40, 12
_LARGEST_JACOBIAN = 400
_DIFFERENCE = 1e-6

_Values: TypeAlias = list[Any]


def settle(go_round: Callable[[_Values], _Values], first: Sequence[Any], names: Sequence[str]) -> int:
    """Finds values that `go_round` returns unchanged. Its last call is made with these values.

    Args:
        go_round: passes the values of all outputs of a loop to its inputs, and returns the new outputs.
        first: the initial values.
        names: the names of the outputs, for the error.

    Returns:
        The number of propagations.

    Raises:
        LoopError: such values do not exist, or were not found.
    """
    return _Loop(go_round, list(first), names).settle()


class _Loop:
    def __init__(self, go_round: Callable[[_Values], _Values], first: _Values, names: Sequence[str]) -> None:
        self._go_round = go_round
        self._names = names
        self._first = first
        self._reals = [i for i, value in enumerate(first) if isinstance(value, float)]
        self._scale = np.ones(len(self._reals))
        self.rounds = 0

    def settle(self) -> int:
        values, new = self._first, self._next(self._first)
        # Relative to the initial values: far away, every value equals the next one up to rounding.
        for x in (self._vector(values), self._vector(new)):
            self._scale = np.maximum(self._scale, np.nan_to_num(np.abs(x), nan=1.0, posinf=1.0))
        best = values, new
        limit = _ROUNDS + len(values)
        while not self._same(values, new) and self.rounds < limit:
            values, new = new, self._next(new)
            if self._size(values, new) < self._size(*best):
                best = values, new
        if not self._same(values, new) and 0 < len(self._reals) <= _LARGEST_JACOBIAN:
            values, new = self._newton(*best)
        if not self._same(values, new):
            raise LoopError(self._names, values, new, self.rounds)
        return self.rounds

    def _next(self, values: _Values) -> _Values:
        self.rounds += 1
        return self._go_round(values)

    def _newton(self, values: _Values, new: _Values) -> tuple[_Values, _Values]:
        """Applies Newton's method to the reals; other values are held until they converge, then propagated once."""
        for _ in range(_NEWTON_STEPS):
            if self._same(values, new):
                break
            if self._size(values, new) <= TOLERANCE:
                values = self._moved(new, self._vector(values))
                new = self._next(values)
                continue
            x, f = self._vector(values), self._change(values, new)
            if not np.isfinite(f).all():
                break
            step = np.linalg.lstsq(self._jacobian(values, new), -f, rcond=None)[0]
            trial, after = values, new
            for halving in range(_HALVINGS):
                trial = self._moved(values, x + step * 0.5**halving)
                after = self._next(trial)
                if self._size(trial, after) < self._size(values, new):
                    break
            values, new = trial, after
        return values, new

    def _jacobian(self, values: _Values, new: _Values) -> NDArray[np.float64]:
        """Returns the Jacobian of the change, by finite differences."""
        columns = []
        x, f = self._vector(values), self._change(values, new)
        for place in range(x.size):
            moved = x.copy()
            moved[place] += _DIFFERENCE * max(1.0, abs(moved[place]))
            trial = self._moved(values, moved)
            columns.append((self._change(trial, self._next(trial)) - f) / (moved[place] - x[place]))
        return np.array(columns).T

    def _vector(self, values: _Values) -> NDArray[np.float64]:
        return np.array([values[i] for i in self._reals])

    def _moved(self, values: _Values, x: NDArray[np.float64]) -> _Values:
        """Returns `values` with other reals."""
        moved = [*values]
        for i, value in zip(self._reals, x, strict=True):
            moved[i] = float(value)
        return moved

    def _change(self, values: _Values, new: _Values) -> NDArray[np.float64]:
        with np.errstate(all="ignore"):
            return self._vector(new) - self._vector(values)

    def _size(self, values: _Values, new: _Values) -> float:
        """Returns the largest change of a real; infinite if one is not a number."""
        change = np.abs(self._change(values, new)) / self._scale
        return float(np.nan_to_num(change, nan=np.inf).max(initial=0.0))

    def _same(self, values: _Values, new: _Values) -> bool:
        others = (i for i in range(len(values)) if i not in self._reals)
        return self._size(values, new) <= TOLERANCE and all(values[i] == new[i] for i in others)

"""The signals of a run in memory, and the observer that collects them while the run goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from cosim_master.execution.outcome.result import RunResult
from cosim_master.results.reading.roles import Player
from cosim_master.stepping.observation import Column, Rows, Seen, View

__all__ = ["Array", "Collector", "Measured"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True)
class Measured:
    """A run that has ended, as metrics see it.

    Attributes:
        time: (n,) s, the recorded instants.
        signals: (n,) values of each recorded signal, by "component.variable".
        units: of the signals; empty for those without.
        result: the outcome of the run, with its packets and its verdict.
        players: the instances, with their parameters and the roles that their FMUs declare.
        outputs: the names of the signals that are outputs; others are local variables.
    """

    time: Array
    signals: Mapping[str, Array]
    units: Mapping[str, str]
    result: RunResult
    players: Mapping[str, Player] = field(default_factory=dict)
    outputs: frozenset[str] = frozenset()

    def __getitem__(self, name: str) -> Array:
        """Returns the values of a signal, (n,)."""
        return self.signals[name]


class Collector:
    """A `RowObserver` that keeps all rows of a run.

    Args:
        view: the run.
        earlier: the rows before it, if it goes on from a checkpoint.
    """

    every = 0

    def __init__(self, view: View, earlier: Collector | None = None) -> None:
        reals = sorted((one for one in view.columns if one.kind == "Real"), key=lambda one: one.place)
        others = sorted((one for one in view.columns if one.kind != "Real"), key=lambda one: one.place)
        self._places = {one.name: n for n, one in enumerate(reals)} | _places(others)
        self._reals = {one.name for one in reals}
        self._wide = {one.name: one for one in others if one.variable.wide}
        self.units = {one.name: one.variable.unit.name if one.variable.unit else "" for one in view.columns}
        self.outputs = frozenset(one.name for one in view.columns if one.variable.causality == "output")
        self.names = view.names
        self._chunks: list[Rows] = [] if earlier is None else [*earlier._chunks]

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...

    def rows(self, rows: Rows, *, complete: bool) -> None:
        """Keeps a complete chunk; the rows of others are in the next one, too."""
        if complete:
            self._chunks.append(Rows(rows.time.copy(), rows.reals.copy(), rows.integers.copy()))

    def until(self, time: float) -> Rows:
        """Returns the rows up to a time [s]."""
        n = int(np.searchsorted(self.time, time, side="right"))
        reals, integers = self._joined("reals"), self._joined("integers")
        return Rows(self.time[:n], reals[:n], integers[:n])

    def begin(self, rows: Rows) -> None:
        """Puts rows before all others."""
        self._chunks.insert(0, rows)

    @property
    def time(self) -> Array:
        """(n,) s."""
        found: Array = self._joined("time")
        return found

    def signals(self) -> dict[str, Array]:
        """Returns the values of each signal, (n,), as floating-point numbers."""
        reals, integers = self._joined("reals"), self._joined("integers")
        found: dict[str, Array] = {}
        for name in self.names:
            place = self._places[name]
            if name in self._reals:
                found[name] = reals[:, place]
            elif name in self._wide:
                halves = np.ascontiguousarray(integers[:, place : place + 2])
                of = np.uint64 if self._wide[name].variable.fmi_type == "UInt64" else np.int64
                found[name] = halves.view(of)[:, 0].astype(np.float64)
            else:
                found[name] = integers[:, place].astype(np.float64)
        return found

    def _joined(self, name: str) -> Any:
        parts = [getattr(chunk, name) for chunk in self._chunks]
        return np.concatenate(parts) if parts else np.zeros((0,) if name == "time" else (0, 0))


def _places(columns: Sequence[Column]) -> dict[str, int]:
    """Returns the place of each column in the rows; a wide one takes two."""
    found, place = {}, 0
    for one in columns:
        found[one.name] = place
        place += 1 + one.variable.wide
    return found

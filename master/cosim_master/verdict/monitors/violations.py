"""The violations of one monitor: begin, end, worst value and its time, by subject."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

import numpy as np

__all__ = ["MOST", "Subject", "Violation", "Violations"]

Array: TypeAlias = np.ndarray[Any, Any]

MOST = 1000
"""Violations of one monitor that are kept one by one; of further ones, only number and duration per subject."""


@dataclass(slots=True)
class Violation:
    """One violation.

    Attributes:
        subject: number of the subject.
        begin, end: the first violated instant, and the first one that is not violated again [s]; `end` is None if the
            violation lasts until the run or the monitor ends.
        worst, worst_time: the measured value at its worst, and when [s].
        excess: the measure by which it was worst; infinite if the value is not a number.
    """

    subject: int
    begin: float
    end: float | None
    worst: float
    worst_time: float
    excess: float


@dataclass(slots=True)
class Subject:
    """All violations of one subject: number, first and worst one, total duration of those that have ended [s]."""

    count: int
    first: float
    total: float
    worst: float
    worst_time: float
    excess: float


class Violations:
    """The violations of one monitor.

    Attributes:
        kept: the first `MOST` violations, in the order in which they were found.
        subjects: by number of subject.
    """

    def __init__(self) -> None:
        self.kept: list[Violation] = []
        self.subjects: dict[int, Subject] = {}
        self._open: dict[int, Violation] = {}

    @property
    def count(self) -> int:
        return sum(one.count for one in self.subjects.values())

    def look(self, times: Array, numbers: Sequence[int], outside: Array, excess: Array, values: Array) -> None:
        """Adds instants.

        Args:
            times: (n,) s, rising.
            numbers: (m,) the subjects observed.
            outside: (n, m) whether each subject is in violation.
            excess: (n, m) extent of the violation, larger is worse.
            values: (n, m) the measured values.
        """
        if not len(times):
            return
        hit = np.flatnonzero(outside.any(axis=0)).tolist()
        if not hit and not self._open:
            return
        seen = {numbers[j] for j in hit}
        for number in [one for one in self._open if one not in seen and one in numbers]:
            self.end(number, float(times[0]))
        for j in hit:
            self._follow(numbers[j], times, outside[:, j], excess[:, j], values[:, j])

    def _follow(self, number: int, times: Array, outside: Array, excess: Array, values: Array) -> None:
        turns = np.flatnonzero(np.diff(outside)) + 1
        for begin, end in zip([0, *turns], [*turns, len(times)], strict=True):
            if not outside[begin]:
                if number in self._open:
                    self.end(number, float(times[begin]))
                continue
            row = begin + int(excess[begin:end].argmax())
            self.extend(number, float(times[begin]), float(excess[row]), float(values[row]), float(times[row]))

    def extend(self, number: int, begin: float, excess: float, worst: float, worst_time: float) -> None:
        """Begins a violation, or adds a value to the open violation of a subject."""
        known = self.subjects.get(number)
        one = self._open.get(number)
        if one is None:
            one = self._open[number] = Violation(number, begin, None, worst, worst_time, excess)
            if len(self.kept) < MOST:
                self.kept.append(one)
            if known is None:
                known = self.subjects[number] = Subject(0, begin, 0.0, worst, worst_time, excess)
            known.count += 1
        elif excess > one.excess:
            one.worst, one.worst_time, one.excess = worst, worst_time, excess
        assert known is not None
        if excess > known.excess:
            known.worst, known.worst_time, known.excess = worst, worst_time, excess

    def end(self, number: int, time: float) -> None:
        """Ends the open violation of a subject."""
        one = self._open.pop(number)
        one.end = time
        self.subjects[number].total += time - one.begin

    def close(self, time: float, numbers: Sequence[int]) -> None:
        """Ends the open violations of some subjects, because the monitor ends."""
        for number in [one for one in self._open if one in numbers]:
            self.end(number, time)

    @property
    def open(self) -> list[int]:
        """The subjects that are in violation at the last instant."""
        return list(self._open)

    def lasting(self, number: int, end: float) -> float:
        """Returns the total duration for a subject until `end` [s]."""
        one = self._open.get(number)
        return self.subjects[number].total + (0.0 if one is None else end - one.begin)

    # ---- checkpoints ---------------------------------------------------------------------------------------------

    def memory(self) -> dict[str, Any]:
        """Returns plain values for a checkpoint."""
        kept = {id(one): n for n, one in enumerate(self.kept)}
        return {
            "kept": [_plain(asdict(one)) for one in self.kept],
            "subjects": [[number, _plain(asdict(one))] for number, one in self.subjects.items()],
            "open": [[kept.get(id(one), -1), _plain(asdict(one))] for one in self._open.values()],
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Restores `memory`."""
        self.kept = [Violation(**_numbers(one)) for one in memory["kept"]]
        self.subjects = {number: Subject(**_numbers(one)) for number, one in memory["subjects"]}
        for place, values in memory["open"]:
            one = self.kept[place] if place >= 0 else Violation(**_numbers(values))
            self._open[one.subject] = one


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns values for JSON, which has neither infinity nor NaN."""
    return {
        name: repr(value) if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


def _numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: float(value) if isinstance(value, str) else value for name, value in values.items()}

"""The exceptions of this project, in one tree.

    CosimError
    ├── SystemDescriptionError   the description of a system or an FMU is wrong; nothing has been loaded yet
    ├── FmuError                 an FMU refused or failed a call while it was alive
    ├── RunFailed                FMUs failed in one macro step: an FmuError for each
    ├── RunTerminated            an FMU wants the simulation to end
    ├── RecordingFailed          results cannot be written any more: the disk is full, for example
    ├── WriteFailed              a file or folder that was asked for cannot be written
    ├── LoopError                outputs depend on each other at the start, and no values fit
    ├── NotConverged             outputs depend on each other within a step, and do not settle
    └── StepTooSmall             the tolerance cannot be met by steps of the minimum size

The outcome of a run is a value, not an error. Misuse of an API raises `ValueError` or `TypeError`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from cosim_master.diagnostics.limitations import INITIAL_LOOP

__all__ = [
    "CosimError",
    "Finding",
    "FmuError",
    "LoopError",
    "NotConverged",
    "Problem",
    "RecordingFailed",
    "RunFailed",
    "RunTerminated",
    "StepTooSmall",
    "SystemDescriptionError",
    "Where",
    "WriteFailed",
    "counted",
    "within_bounds",
]


@dataclass(frozen=True, slots=True)
class Where:
    """A place in a description: a file as the user would name it, and its line if it is known."""

    path: str
    line: int | None = None

    def __str__(self) -> str:
        return self.path if self.line is None else f"{self.path}:{self.line}"


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a description: its place, its text, and the valid alternatives."""

    where: Where
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


class Finding(str):
    """A note on a defect that does not prevent a run but should be corrected; `--strict` makes it an error.

    A file that breaks a rule of its standard, but can still be read, produces one. So may other tolerated defects.

    Attributes:
        problem: the note as a problem.
        kind: equal for findings of the same rule, so that a long list of them can be shortened.
    """

    problem: Problem
    kind: str

    def __new__(cls, where: Where, message: str, kind: str = "") -> Finding:
        made = super().__new__(cls, f"{where}: {message}")
        made.problem = Problem(where, message)
        made.kind = kind or message
        return made


def counted(n: int, noun: str) -> str:
    """Returns the number with the noun in its form for it: 1 failure, 2 failures."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def within_bounds(notes: Iterable[str], most: int = 3) -> Iterator[str]:
    """Returns the notes to show: the first few findings of each kind, and the number of further ones."""
    counts: dict[str, int] = {}
    for note in notes:
        if isinstance(note, Finding):
            counts[note.kind] = counts.get(note.kind, 0) + 1
            if counts[note.kind] > most:
                continue
        yield note
    for kind, n in counts.items():
        if n > most:
            yield f"and {n - most} more notes of this kind: {kind}"


class CosimError(Exception):
    """Base class of all exceptions that this package raises deliberately."""


class SystemDescriptionError(CosimError):
    """A description is wrong.

    Attributes:
        problems: every problem that was found, in the order of the files; never empty.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        if not self.problems:
            raise ValueError("a SystemDescriptionError needs at least one problem")
        super().__init__("\n".join(str(problem) for problem in self.problems))


class RecordingFailed(CosimError):
    """A file of the recording cannot be written. The values recorded before remain readable."""

    def __init__(self, file: str, reason: str) -> None:
        super().__init__(f"{file}: cannot be written: {reason}; what was recorded until then stays readable")


class WriteFailed(CosimError):
    """A file or folder that was asked for cannot be written; what was there before is unchanged."""

    def __init__(self, file: str, reason: str, what: str = "") -> None:
        super().__init__(f"{file}: {f'{what} ' if what else ''}cannot be written: {reason}")


def printable(text: str) -> str:
    """Returns a text of an FMU with control characters escaped, such as those that command a terminal."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


class FmuError(CosimError):
    """An FMU failed.

    Attributes:
        instance: hierarchical name of the instance, as in the system structure.
        function: the FMI function that was called.
        status: the status in the standard's words ("fmi2Error"), or the error in the answer.
        time: simulation time of the call in s, None before initialization.
        log: the last lines that the FMU logged, control characters escaped; in the message, consecutive equal lines
            are shown once.
    """

    def __init__(
        self, instance: str, function: str, status: str, time: float | None = None, log: Iterable[str] = ()
    ) -> None:
        self.instance = instance
        self.function = function
        self.status = status = printable(status)
        self.time = time
        self.log = tuple(printable(line.rstrip("\r\n")) for line in log)
        at = "" if time is None else f" at t = {time:.9g} s"
        said = [line for line in self.log if not line.startswith(_WRAPPER)] or self.log
        lines = [f"{instance}: {function} failed{at}: {status}", *(f"    {line}" for line in _together(said))]
        super().__init__("\n".join(lines))


class RunFailed(CosimError):
    """One or more instances failed in the same macro step.

    Attributes:
        failures: an FmuError for each failed instance.
    """

    def __init__(self, failures: Sequence[FmuError]) -> None:
        self.failures = tuple(failures)
        super().__init__("\n".join(str(failure) for failure in failures))


class RunTerminated(CosimError):
    """An FMU requested the end of the simulation; this is not a failure.

    Attributes:
        instance: hierarchical name of the instance.
        time: end of the time that the instance can simulate, s.
    """

    def __init__(self, instance: str, time: float, *, said: str = "fmi2Terminated", hint: str = "") -> None:
        self.instance, self.time = instance, time
        more = f" {hint}" if hint else ""
        super().__init__(f"{instance}: it requested the end of the run at t = {time:.9g} s ({said}){more}")


class NotConverged(CosimError):
    """Outputs depend on each other within a step and do not converge.

    Attributes:
        residuals: name of each output -> the remaining change of its value.
        time: start of the step, s.
    """

    def __init__(self, algorithm: str, time: float, iterations: int, rows: Sequence[tuple[str, float, float]]) -> None:
        self.time = time
        self.residuals = {name: residual for name, _, residual in rows}
        worst = sorted(rows, key=lambda row: -abs(row[2]))
        lines = [f"    {name} = {value:.9g}, residual {residual:.3g}" for name, value, residual in worst[:_SHOWN]]
        more = f"\n    and {len(rows) - _SHOWN} more" if len(rows) > _SHOWN else ""
        head = f"{algorithm}: in the step from t = {time:.9g} s these outputs depend on each other, and do not settle"
        super().__init__("\n".join([f"{head} in {iterations} iterations:", *lines]) + more)


class StepTooSmall(CosimError):
    """The tolerance cannot be met by steps of the minimum size.

    Attributes:
        time: start of the step, s.
        errors: name of each output whose error exceeds the tolerance -> its error.
    """

    def __init__(self, time: float, h: float, errors: Sequence[tuple[str, float]], tolerance: float) -> None:
        self.time, self.errors = time, dict(errors)
        worst = ", ".join(f"{name} by {error:.3g}" for name, error in errors[:5]) or "an FMU has discarded it"
        more = f" and {len(errors) - 5} more" if len(errors) > 5 else ""
        super().__init__(
            f"richardson: a step from t = {time:.9g} s of the minimum, {h:.9g} s, is off by more than {tolerance:g} "
            f"per second: {worst}{more}"
        )


class LoopError(CosimError):
    """The values in a loop of connections do not converge.

    Attributes:
        residuals: name of each output in the loop -> the remaining change of its value.
        rounds: number of exchanges of values.
    """

    def __init__(self, names: Sequence[str], values: Sequence[Any], new: Sequence[Any], rounds: int) -> None:
        self.residuals = {
            name: after - before if isinstance(before, float) else float(after != before)
            for name, before, after in zip(names, values, new, strict=True)
        }
        self.rounds = rounds
        lines = [
            f"    {name} = {_shown(value)}, residual {self.residuals[name]:.3g}"
            for name, value in zip(names, values, strict=True)
        ]
        more = f"\n    and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else ""
        head = INITIAL_LOOP.text(rounds)
        super().__init__("\n".join([head, *lines[:_SHOWN]]) + more)


_SHOWN = 20
"""Outputs of a loop that an error shows."""


def _shown(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else repr(value)


_WRAPPER = ("Fatal py exception encountered: ", "unknown error")
"""Prefix of the lines with which pythonfmu's wrapper reports an exception; the FMU itself has logged its cause."""


def _together(log: Iterable[str]) -> Iterator[str]:
    """Returns the lines without repetitions; a repeated line appears once, with the number of its repetitions."""
    for line, same in groupby(log):
        n = len([*same])
        yield line if n == 1 else f"{line} ({n} times)"

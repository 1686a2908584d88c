"""What can go wrong, as exceptions a caller can act on.

    CosimError
    ├── SystemDescriptionError   the description of a system or an FMU is wrong; nothing has been loaded yet
    └── FmuError                 an FMU refused or failed a call while it was alive

How a run ended is a value, not an error; misuse of an API is a `ValueError` or `TypeError`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

__all__ = ["CosimError", "Finding", "FmuError", "Problem", "SystemDescriptionError", "Where", "within_bounds"]


@dataclass(frozen=True, slots=True)
class Where:
    """A place in a description: a file as the user would name it, and a line of it where one is known."""

    path: str
    line: int | None = None

    def __str__(self) -> str:
        return self.path if self.line is None else f"{self.path}:{self.line}"


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong with a description: where, what, and what would be valid."""

    where: Where
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


class Finding(str):
    """A note on something that does not stop a run but should be mended; `--strict` makes it an error.

    A file that breaks a rule of its standard and is read all the same gives one; so may whatever else is tolerated.

    Attributes:
        problem: the note as a problem.
        kind: equal for findings of the same rule, so that a long list of them can be shown in short.
    """

    problem: Problem
    kind: str

    def __new__(cls, where: Where, message: str, kind: str = "") -> Finding:
        made = super().__new__(cls, f"{where}: {message}")
        made.problem = Problem(where, message)
        made.kind = kind or message
        return made


def within_bounds(notes: Iterable[str], most: int = 3) -> Iterator[str]:
    """Notes to show: of findings of one kind the first ones, and how many more there are."""
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
    """Whatever this package raises on purpose."""


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


class FmuError(CosimError):
    """An FMU failed.

    Attributes:
        instance: hierarchical name of the instance, as in the system structure.
        function: the FMI function that was called.
        status: what it answered, in the standard's words ("fmi2Error"), or what was wrong with the answer.
        time: simulation time of the call in s, None before initialization.
        log: the last lines the FMU logged; in the message equal ones that follow each other are one.
    """

    def __init__(
        self, instance: str, function: str, status: str, time: float | None = None, log: Iterable[str] = ()
    ) -> None:
        self.instance = instance
        self.function = function
        self.status = status
        self.time = time
        self.log = tuple(log)
        at = "" if time is None else f" at t = {time:.9g} s"
        said = [line for line in self.log if not line.startswith(_WRAPPER)] or self.log
        lines = [f"{instance}: {function} failed{at}: {status}", *(f"    {line}" for line in _together(said))]
        super().__init__("\n".join(lines))


_WRAPPER = ("Fatal py exception encountered: ", "unknown error")
"""Lines with which pythonfmu's wrapper reports that Python raised begin so; the FMU itself has said what and why."""


def _together(log: Iterable[str]) -> Iterator[str]:
    """Lines, those that are repeated once and with their number."""
    for line, same in groupby(log):
        n = len([*same])
        yield line if n == 1 else f"{line} ({n} times)"

"""The FMI function that a killed run has called last: in the process of the run, of an FMU that could have ended it.

    RUN/unfinished/called   a page of the run's memory, which the run goes on writing, then JSON that explains it

The operating system keeps what a process has written into such a page, however the process ends. `faults.last_call` of
`execution` writes the file; this module knows its form.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cosim_master.results.storage.journal import FOLDER

__all__ = ["NAME", "TEXT", "TEXT_BYTES", "LastCall", "explained", "last_call", "text_of"]

NAME = "called"
TEXT, TEXT_BYTES = 2048, 1024
"""The place in the page of a call that Python makes (`text_of`), and its size."""
_WORDS = ("running", "k", "start", "base", "per_ns")
_LARGEST = 1 << 28


@dataclass(frozen=True, slots=True)
class LastCall:
    """A function of FMI that was called.

    Attributes:
        time: the simulation time that all instances had reached then, s.
    """

    instance: str
    function: str
    time: float

    def __str__(self) -> str:
        return f"{self.function} of {self.instance} at t = {self.time:.9g} s"


def explained(size: int, words: Mapping[str, int], functions: Mapping[int, tuple[str, str]]) -> bytes:
    """Returns the part of the file after the page.

    Args:
        size: of the page, bytes.
        words: the places of `running`, `k`, `start`, `base` and `per_ns` in the page, in units of 8 bytes: see
            `Plan.shared` and `Plan.counters`.
        functions: instance and function by the values of `running`.
    """
    return json.dumps(
        {"page": size, "words": dict(words), "functions": {str(a): b for a, b in functions.items()}}
    ).encode()


def text_of(instance: str, function: str, k: int) -> bytes:
    """Returns TEXT_BYTES bytes that say which function Python calls at base step `k`."""
    text = json.dumps([instance[:100], function, k]).encode()
    return text[:TEXT_BYTES].ljust(TEXT_BYTES, b"\0")


def last_call(run: Path) -> LastCall | None:
    """Returns the last call of a run that was killed; None if it is not known, or its process had no FMU of others."""
    try:
        file = run / FOLDER / NAME
        if file.stat().st_size > _LARGEST:
            return None
        content = file.read_bytes()
        begin = content.rindex(b'{"page": ')
        document = json.loads(content[begin:])
        if document["page"] != begin:
            return None
        words = memoryview(content[: begin // 8 * 8]).cast("q")
        running, k, start, base, per_ns = (words[document["words"][name]] for name in _WORDS)
        if running:
            instance, function = document["functions"][str(running)]
        else:
            instance, function, at = json.loads(content[TEXT : TEXT + TEXT_BYTES].rstrip(b"\0"))
            if at != k:  # the loop has made steps since
                return None
        return LastCall(str(instance), str(function), (start + max(k, 0) * base) / (1e9 * per_ns))
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, AttributeError, RecursionError):
        return None

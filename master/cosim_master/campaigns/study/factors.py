"""Factors: the values that a study varies.

    NAME=0,0.1,0.2        these values; texts that are no numbers are possible, too ("network.topology=line,nearest")
    NAME=0.1:0.6:11       11 values from 0.1 to 0.6
    NAME=0.1:0.6          every value between them, for designs that sample
    NAME@30=0,5           values that are set at 30 s; until then, the runs that differ in them alone are one run

NAME is that of `--set`: a hierarchical name, a pattern ("drone*.agent.epsilon", all with the same value), or a setting
of radio, recording or master ("network.loss").
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim_master.campaigns.refusal import refusal, several
from cosim_master.execution.options import number, text_of

__all__ = ["Factor"]

_MOST = 1_000_000
"""Values of one factor."""


@dataclass(frozen=True, slots=True)
class Factor:
    """A factor.

    Attributes:
        name: hierarchical name, pattern or setting, as of `--set`.
        values: its values, as texts; empty if it varies continuously. Numbers, and an array of them, are taken, too.
        low, high: the least and the greatest value of a factor that varies continuously.
        time: simulated time at which it is set, s; None: it holds from the start.
    """

    name: str
    values: tuple[str, ...] = ()
    low: float = math.nan
    high: float = math.nan
    time: float | None = None

    def __post_init__(self) -> None:
        about = f"factor {self.name}"
        for name in ("low", "high", "time"):
            object.__setattr__(self, name, number(f"{about}: {name}", getattr(self, name)))
        values = several(f"{about}: values", self.values, "values=(0.0, 0.1)")
        object.__setattr__(self, "values", tuple(map(text_of, values)))
        where = f"factor {self.label}"
        if not self.name:
            raise refusal(where, "has no name; write NAME=VALUES")
        seen: set[float | str] = set()
        for value in self.values:
            same = float(value) if _is_number(value) else value
            if same in seen:
                raise refusal(where, f"has the value {value} twice; give each value once")
            seen.add(same)
        if not self.values and not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise refusal(where, f"varies from {self.low:g} to {self.high:g}; give a smaller and a greater number")
        if self.time is not None and not 0.0 < self.time < math.inf:
            raise refusal(where, f"is set at {self.time:g} s; give a positive time in s, or none")

    @classmethod
    def parsed(cls, text: str) -> Factor:
        """Returns the factor of a text, as described in the docstring of this module.

        Raises:
            SystemDescriptionError: the text is no factor.
        """
        name, equals, given = text.partition("=")
        given = given.strip()
        if not equals or not given:
            raise refusal(f"--vary {text}", "write NAME=VALUE,VALUE,... or NAME=FROM:TO:NUMBER")
        name, time = _timed(name.strip())
        if ":" in given and "," not in given:
            ends = given.split(":")
            try:
                low, high = float(ends[0]), float(ends[1])
                count = int(ends[2]) if len(ends) > 2 else 0
            except (ValueError, IndexError):
                raise refusal(f"--vary {text}", "write FROM:TO:NUMBER, or FROM:TO for a design that samples") from None
            if len(ends) > 3 or (len(ends) == 3 and not 2 <= count <= _MOST):
                raise refusal(f"--vary {text}", f"the number of values is 2 to {_MOST}")
            if count == 0:
                return cls(name, low=low, high=high, time=time)
            if not (math.isfinite(low) and math.isfinite(high)):
                raise refusal(f"--vary {text}", "give finite numbers")
            return cls(name, tuple(f"{value:.12g}" for value in np.linspace(low, high, count)), time=time)
        return cls(name, tuple(value.strip() for value in given.split(",")), time=time)

    @property
    def label(self) -> str:
        """The name of its column: its own name, with the time at which it is set."""
        return self.name if self.time is None else f"{self.name}@{self.time:.9g}"

    @property
    def continuous(self) -> bool:
        return not self.values

    @property
    def numeric(self) -> bool:
        """True if all its values are numbers."""
        return self.continuous or all(_is_number(value) for value in self.values)

    def at(self, share: float) -> str:
        """Returns its value at a share of its range: 0 is the first value, and everything below 1 up to the last."""
        if self.continuous:
            return f"{self.low + share * (self.high - self.low):.12g}"
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    def as_json(self) -> dict[str, Any]:
        ends = {"low": self.low, "high": self.high} if self.continuous else {"values": list(self.values)}
        return {"name": self.name, **ends, **({} if self.time is None else {"time": self.time})}

    @classmethod
    def of_json(cls, told: Mapping[str, Any]) -> Factor:
        """Returns the factor of its JSON object."""
        values = tuple(map(str, told.get("values", ())))
        low, high = float(told.get("low", math.nan)), float(told.get("high", math.nan))
        time = told.get("time")
        return cls(str(told["name"]), values, low, high, None if time is None else float(time))


def _timed(name: str) -> tuple[str, float | None]:
    before, at, after = name.rpartition("@")
    return (before.strip(), float(after)) if at and _is_number(after) else (name, None)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False

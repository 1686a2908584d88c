"""One metric of a study: an expression over signals and built-in metrics, or a Python function.

    last(drone1.vehicle.position[2])             its name is the text
    gap=min(drone2.agent.target - drone1.agent.target)
    packets_lost / packets_sent
    mine.py:overshoot                            a function that takes a `Measured` and returns a number

The text of a Python file belongs to the study: it reaches workers on other machines, and a changed file is another
study. It is the code of the study's author, and runs with the rights of the workers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from cosim_master.campaigns.metrics import built_in
from cosim_master.campaigns.metrics.expression import TIME, Expression, ExpressionError, parse, unknown
from cosim_master.campaigns.metrics.measured import Measured
from cosim_master.campaigns.refusal import refusal
from cosim_master.diagnostics.names import matching, near, near_pattern
from cosim_master.results.reading.roles import Player

__all__ = ["Metric", "MetricError", "finite"]

_NAMED = re.compile(r"\s*([A-Za-z_]\w*)\s*=(?!=)(.*)", re.DOTALL)
_FUNCTION = re.compile(r"\s*(\S.*\.py):([A-Za-z_]\w*)\s*")


class MetricError(Exception):
    """A metric that has no value for a run: the text tells why."""


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric.

    Attributes:
        name: of its column.
        text: its expression, or the name of its function.
        source: the text of the Python file; empty for an expression.
    """

    name: str
    text: str
    source: str = ""

    def __post_init__(self) -> None:
        if self.source:
            self._function()
        else:
            self._expression()

    @classmethod
    def parsed(cls, text: str) -> Metric:
        """Returns the metric of a text, as described in the docstring of this module.

        Raises:
            SystemDescriptionError: it cannot be read.
        """
        named = _NAMED.fullmatch(text)
        name, told = (named[1], named[2].strip()) if named else ("", text.strip())
        function = _FUNCTION.fullmatch(told)
        if function is None:
            return cls(name or " ".join(told.split()), " ".join(told.split()))
        try:
            source = Path(function[1]).read_text(encoding="utf-8")
        except (OSError, ValueError) as error:
            raise refusal(f"--metric {text}", f"{function[1]} cannot be read: {error}; give a Python file") from None
        return cls(name or function[2], function[2], source)

    def signals(
        self, players: Mapping[str, Player], units: Mapping[str, str], outputs: Collection[str] = ()
    ) -> list[str]:
        """Returns the names and patterns of the signals that it needs in a system.

        Args:
            units: of all outputs and local variables, by "component.variable"; empty for those without.
            outputs: the names of those that are outputs.

        Raises:
            SystemDescriptionError: the system has no such signals.
        """
        if self.source:
            told = getattr(self._function(), "signals", ("*",))
            if not isinstance(told, str | Iterable):
                raise self._refused(f"signals of {self.text} is {told!r}; give names of signals, or patterns")
            patterns = [told] if isinstance(told, str) else [*map(str, told)]
            for pattern in patterns:
                if not matching(pattern, units):
                    raise self._refused(f'there is no signal "{pattern}"; {near_pattern(pattern, units)}')
            return patterns
        expression = self._expression()
        if text := unknown(expression, [*units], built_in.BUILT_IN):
            raise self._refused(text)
        try:
            expression.rehearse(units)
        except ExpressionError as error:
            raise self._refused(str(error)) from None
        found = [name for name in expression.signals if name != TIME]
        for name, _ in expression.metrics:
            needed, lacking = built_in.needs(name, players, units, outputs)
            if lacking:
                raise self._refused(lacking)
            found += needed
        return found

    @property
    def timed(self) -> bool:
        """True if it may need the recorded instants even if it needs no signal."""
        return bool(self.source) or TIME in self._expression().signals

    def value(self, run: Measured) -> float:
        """Returns its value for a run; NaN if it is not defined for it.

        Raises:
            MetricError: the expression is not one number, or the function fails.
        """
        if not self.source:
            try:
                return self._expression().value(run, lambda name, *given: built_in.value(name, run, *given))
            except ExpressionError as error:
                raise MetricError(f"metric {self.name}: {error}") from None
        try:
            return float(self._function()(run))
        except Exception as error:
            raise MetricError(f"metric {self.name}: {type(error).__name__}: {error}") from None

    def as_json(self) -> dict[str, str]:
        return {"name": self.name, "text": self.text, **({"source": self.source} if self.source else {})}

    @classmethod
    def of_json(cls, told: Mapping[str, Any]) -> Metric:
        """Returns the metric of its JSON object."""
        return cls(str(told["name"]), str(told["text"]), str(told.get("source", "")))

    def _expression(self) -> Expression:
        try:
            return _parsed(self.text)
        except ExpressionError as error:
            raise self._refused(str(error)) from None

    def _function(self) -> Callable[[Measured], float]:
        try:
            found = _executed(self.source)
        except Exception as error:
            raise self._refused(f"the file cannot be executed: {type(error).__name__}: {error}") from None
        function = found.get(self.text)
        if not callable(function):
            names = [name for name, one in found.items() if callable(one) and not name.startswith("_")]
            raise self._refused(f'the file has no function "{self.text}"; {near(self.text, names)}')
        return function  # type: ignore[no-any-return]

    def _refused(self, text: str) -> Exception:
        return refusal(f"--metric {self.name}", text)


def finite(number: float) -> float | None:
    """Returns a number for a table: None instead of NaN and infinities, which no comparison orders."""
    return number if math.isfinite(number) else None


@lru_cache(maxsize=256)
def _parsed(text: str) -> Expression:
    return parse(text, built_in.BUILT_IN)


@lru_cache(maxsize=64)
def _executed(source: str) -> dict[str, Any]:
    """Returns the names that a Python file defines; it is executed once in each process."""
    names: dict[str, Any] = {"__name__": "metrics of a campaign"}
    exec(compile(source, "metrics of a campaign", "exec"), names)
    return names

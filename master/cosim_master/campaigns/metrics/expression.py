"""Expressions over the signals of a run: from text to a number. They are arithmetic: nothing else can be reached.

    sum       = product {("+" | "-") product}
    product   = factor {("*" | "/") factor}
    factor    = "-" factor | number | built-in metric | signal | function "(" sum {"," sum} ")" | "(" sum ")"

A signal is a name or a pattern, as of `--record`: `*` belongs to a name if it touches its letters, digits, dots or
brackets ("drone*.vehicle.position[2]"), and multiplies between spaces. A pattern is all signals that match it. `time`
is the simulated time, s.

`first`, `last`, `integral` and `at(x, time)` give a number for each signal; `min`, `max`, `mean`, `rms` and `std` give
one for all instants of all signals, and with two arguments, `min` and `max` compare them instant by instant. `sum` adds
the signals of each instant, or numbers. `abs`, `sqrt` and `hypot` work on each value. The whole must be one number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from cosim_master.campaigns.metrics.measured import Array, Measured
from cosim_master.diagnostics.names import is_pattern, matching, near, near_pattern

__all__ = ["TIME", "Expression", "ExpressionError", "parse", "unknown"]

TIME = "time"
"""The signal that every run has: simulated time, s."""
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>(?:[A-Za-z_]|\*(?=\.[A-Za-z_]))[\w.#]*(?:\[[^\]\s]*\][\w.#]*|[*?](?=[\w.\[*?])[\w.#]*|[*?](?![\w\s(]))*)"
    r"|(?P<sign>[-+*/(),])|(?P<wrong>\S))"
)
Arguments: TypeAlias = tuple["Node", ...]


class ExpressionError(ValueError):
    """An expression that cannot be read or has no value: the text tells why."""


@dataclass(frozen=True, slots=True)
class Node:
    """A number (`value`), a signal or built-in metric (`name`), or an operation (`name`) on others."""

    name: str
    value: float = 0.0
    of: Arguments = ()
    called: bool = False


@dataclass(frozen=True, slots=True)
class Expression:
    """An expression: its text, its tree, the names that are signals, and the calls of built-in metrics."""

    text: str
    root: Node
    signals: tuple[str, ...]
    metrics: tuple[tuple[str, tuple[float, ...]], ...]

    def value(self, run: Measured, built_in: Callable[..., float]) -> float:
        """Returns the value for a run; `built_in` returns that of a built-in metric.

        Raises:
            ExpressionError: a signal was not recorded, or the value is not one number.
        """
        return self._number(run.time, run.signals, built_in)

    def rehearse(self, signals: Iterable[str]) -> None:
        """Raises ExpressionError if the value would not be one number for a run that records these signals."""
        self._number(np.array([0.0, 1.0]), dict.fromkeys(signals, np.zeros(2)), lambda *_: 0.0)

    def _number(self, time: Array, signals: Mapping[str, Array], built_in: Callable[..., float]) -> float:
        with np.errstate(all="ignore"):
            found = _value(self.root, time, signals, built_in)
        if found.shape != (1, 1):
            raise ExpressionError(_not_one(self.text, found))
        return float(found[0, 0])


def _not_one(text: str, found: Array) -> str:
    if found.shape[0] > 1:
        return f'"{text}" is a signal over time; write last(...), max(...), mean(...), rms(...) or integral(...) of it'
    return f'"{text}" has {found.shape[1]} values, one for each signal; write max(...), min(...) or sum(...) of them'


def parse(text: str, built_in: Mapping[str, int]) -> Expression:
    """Returns the expression of a text.

    Args:
        built_in: the built-in metrics, and the largest number of their arguments.

    Raises:
        ExpressionError: it cannot be read.
    """
    reader = _Reader(text, built_in)
    return Expression(" ".join(text.split()), reader.whole(), tuple(reader.signals), tuple(reader.metrics))


class _Reader:
    """Reads one expression by recursive descent."""

    def __init__(self, text: str, built_in: Mapping[str, int]) -> None:
        self._text, self._built_in = text, built_in
        self._tokens = list(self._split())
        self._next = 0
        self.signals: dict[str, None] = {}
        self.metrics: dict[tuple[str, tuple[float, ...]], None] = {}

    def _split(self) -> Iterator[tuple[str, str, int]]:
        for found in _TOKEN.finditer(self._text):
            kind = found.lastgroup or ""
            if kind == "wrong":
                raise ExpressionError(f'"{found[kind]}" at character {found.start(kind) + 1} has no meaning here')
            yield kind, found[kind], found.start(kind)
        yield "end", "", len(self._text)

    def _wrong(self, expected: str) -> ExpressionError:
        _, text, at = self._tokens[self._next]
        found = f'"{text}" at character {at + 1}' if text else "the end of the expression"
        return ExpressionError(f"{found}: {expected}")

    def _take(self, *texts: str) -> str:
        kind, text, _ = self._tokens[self._next]
        if kind == "sign" and text in texts:
            self._next += 1
            return text
        return ""

    def _need(self, text: str) -> None:
        if not self._take(text):
            raise self._wrong(f'"{text}" must be here')

    def whole(self) -> Node:
        node = self._sum()
        if self._tokens[self._next][0] != "end":
            raise self._wrong("the expression must end here, or go on with an operator")
        return node

    def _sum(self) -> Node:
        node = self._product()
        while operator := self._take("+", "-"):
            node = Node(operator, of=(node, self._product()), called=True)
        return node

    def _product(self) -> Node:
        node = self._factor()
        while operator := self._take("*", "/"):
            node = Node(operator, of=(node, self._factor()), called=True)
        return node

    def _factor(self) -> Node:
        if self._take("-"):
            return Node("negative", of=(self._factor(),), called=True)
        if self._take("("):
            node = self._sum()
            self._need(")")
            return node
        kind, text, _ = self._tokens[self._next]
        if kind not in ("number", "name"):
            raise self._wrong("a number, a signal or a function must be here")
        self._next += 1
        if kind == "number":
            return Node("", float(text))
        given = self._arguments() if self._take("(") else None
        if text in self._built_in:
            return self._metric(text, given or ())
        if given is not None:
            return self._function(text, given)
        self.signals[text] = None
        return Node(text)

    def _arguments(self) -> Arguments:
        found = [self._sum()]
        while self._take(","):
            found.append(self._sum())
        self._need(")")
        return tuple(found)

    def _metric(self, name: str, given: Arguments) -> Node:
        if len(given) > self._built_in[name] or any(one.name for one in given):
            most = self._built_in[name]
            raise ExpressionError(f"{name} takes {f'at most {most} number' if most else 'no argument'}")
        self.metrics[name, tuple(one.value for one in given)] = None
        return Node(name, of=given)

    def _function(self, name: str, given: Arguments) -> Node:
        if name not in _FUNCTIONS:
            raise ExpressionError(f'"{name}": there is no such function; {near(name, [*_FUNCTIONS, *self._built_in])}')
        if len(given) not in _FUNCTIONS[name]:
            text = " or ".join(map(str, _FUNCTIONS[name]))
            raise ExpressionError(
                f"{name} takes {text} argument{'s' if text != '1' else ''}, and is given {len(given)}"
            )
        return Node(name, of=given, called=True)


_FUNCTIONS: Mapping[str, tuple[int, ...]] = {
    **dict.fromkeys(("first", "last", "integral", "mean", "rms", "std", "sum", "abs", "sqrt"), (1,)),
    **dict.fromkeys(("min", "max"), (1, 2)),
    **dict.fromkeys(("at", "hypot"), (2,)),
}


def _value(node: Node, time: Array, signals: Mapping[str, Array], built_in: Callable[..., float]) -> Array:
    """Returns the value of a node: (instants or 1, signals or numbers)."""
    if not node.called:
        if not node.name:
            return np.array([[node.value]])
        if node.name == TIME:
            return time[:, None]
        if node.of or node.name not in signals:
            names = matching(node.name, signals) if not node.of else []
            if not names:
                return np.array([[built_in(node.name, *(one.value for one in node.of))]])
            return np.stack([signals[name] for name in names], axis=1)
        return signals[node.name][:, None]
    given = [_value(one, time, signals, built_in) for one in node.of]
    if len(given) == 2 and node.name not in ("at",):
        _fit(node.name, *given)
        return np.asarray(_TWO[node.name](*given), dtype=np.float64)
    if node.name == "at":
        return _at(time, *given)
    if node.name == "integral":
        return _integral(time, given[0])
    return np.asarray(_ONE[node.name](given[0]), dtype=np.float64)


def _fit(name: str, one: Array, other: Array) -> None:
    counts = {one.shape[1], other.shape[1]} - {1}
    if len(counts) > 1:
        raise ExpressionError(
            f"{name} has {one.shape[1]} and {other.shape[1]} signals; the numbers must be equal, or 1"
        )


def _at(time: Array, values: Array, when: Array) -> Array:
    if when.shape != (1, 1):
        raise ExpressionError("at(signal, time): the time must be a number, in s")
    moment = float(when[0, 0])
    if values.shape[0] == 1 or not len(time) or not time[0] <= moment <= time[-1]:
        return np.full((1, values.shape[1]), np.nan)
    row = int(np.searchsorted(time, moment, side="right")) - 1
    return values[row : row + 1]


def _integral(time: Array, values: Array) -> Array:
    if not len(time):
        return np.full((1, values.shape[1]), np.nan)
    whole = np.broadcast_to(values, (len(time), values.shape[1]))
    return np.asarray(np.trapezoid(whole, time, axis=0))[None, :]


def _reduced(function: Callable[[Any], Any]) -> Callable[[Array], Array]:
    return lambda x: np.array([[function(x)]]) if x.size else np.array([[np.nan]])


_ONE: Mapping[str, Callable[[Array], Array]] = {
    "negative": lambda x: -x,
    "abs": np.abs,
    "sqrt": np.sqrt,
    "first": lambda x: x[:1] if len(x) else np.full((1, x.shape[1]), np.nan),
    "last": lambda x: x[-1:] if len(x) else np.full((1, x.shape[1]), np.nan),
    "sum": lambda x: x.sum(axis=1, keepdims=True),
    "min": _reduced(np.min),
    "max": _reduced(np.max),
    "mean": _reduced(np.mean),
    "std": _reduced(np.std),
    "rms": _reduced(lambda x: np.sqrt(np.mean(x * x))),
}
_TWO: Mapping[str, Callable[[Array, Array], Array]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "hypot": np.hypot,
    "min": np.minimum,
    "max": np.maximum,
}


def unknown(expression: Expression, signals: Sequence[str], built_in: Iterable[str]) -> str:
    """Returns what an expression names that is no signal, with what may have been meant; empty if there is nothing."""
    for name in expression.signals:
        if name != TIME and not matching(name, signals):
            if "." not in name and not is_pattern(name):
                return f'there is no metric "{name}"; {near(name, [*built_in, TIME])}'
            return f'there is no signal "{name}"; {near_pattern(name, signals)}'
    return ""

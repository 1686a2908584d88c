"""Formulas of signal temporal logic (STL): from text to a tree.

    formula     = implied [("->" | "<->") formula]
    implied     = either [("until" | "since") interval either]
    either      = both {"or" both}
    both        = negated {"and" negated}
    negated     = ("not" | temporal) negated | compared
    temporal    = ("always" | "eventually" | "historically" | "once") [interval]
    interval    = "[" number "," number "]"                            s
    compared    = sum [("<" | "<=" | ">" | ">=" | "==" | "!=") sum]
    sum         = product {("+" | "-") product}
    product     = factor {("*" | "/") factor}
    factor      = "-" factor | number | "true" | "false" | signal | function "(" sum {"," sum} ")" | "(" formula ")"

Intervals are in s, relative to the current instant; both ends belong to them. `always`, `eventually` and `until` look
at the future, so their intervals must be bounded. Without an interval, `historically`, `once` and `since` look at
everything since the start of the run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from cosim_master.diagnostics.names import near

__all__ = ["FUNCTIONS", "TIME", "Binary", "Formula", "FormulaError", "Node", "Value", "Window", "parse"]

TIME = "time"
"""The signal that every formula has: simulated time, s."""
FUNCTIONS = {"abs": 1, "sqrt": 1, "min": 2, "max": 2, "hypot": 2}
"""Functions, and their numbers of arguments."""
_FUTURE, _PAST = ("always", "eventually"), ("historically", "once")
_KEYWORDS = (*_FUTURE, *_PAST, "until", "since", "and", "or", "not", "true", "false")
_TOKEN = re.compile(r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)"
                    r"|(?P<sign><->|->|<=|>=|==|!=|[-+*/<>()\[\],])|(?P<wrong>\S))")  # fmt: skip
_COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")


class FormulaError(ValueError):
    """A formula that cannot be read: the text tells where and why."""


@dataclass(frozen=True, slots=True)
class Value:
    """A number, a truth value or a signal."""

    value: float | bool | str


@dataclass(frozen=True, slots=True)
class Binary:
    """An operation on one or two operands: arithmetic, a function, a comparison or a logical operation."""

    operator: str
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Window:
    """A temporal operation over the interval from `begin` to `end` [s] after, or before, each instant."""

    operator: Literal["always", "eventually", "until", "historically", "once", "since"]
    begin: float
    end: float
    operands: tuple[Node, ...]


Node = Value | Binary | Window


@dataclass(frozen=True, slots=True)
class Formula:
    """A formula: its text, its conjuncts with their texts, and the names of its signals."""

    text: str
    conjuncts: tuple[tuple[str, Node], ...]
    signals: tuple[str, ...]

    @property
    def horizon(self) -> float:
        """The time after an instant for which the formula must be known to be judged there, s."""
        return max(_horizon(node) for _, node in self.conjuncts)


def _horizon(node: Node) -> float:
    if isinstance(node, Value):
        return 0.0
    own = node.end if isinstance(node, Window) and node.operator in (*_FUTURE, "until") else 0.0
    return own + max(map(_horizon, node.operands))


def parse(text: str) -> Formula:
    """Returns the formula of a text.

    Raises:
        FormulaError: it cannot be read.
    """
    reader = _Reader(text)
    conjuncts = reader.conjuncts()
    return Formula(" ".join(text.split()), tuple(conjuncts), tuple(reader.signals))


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    at: int
    end: int


class _Reader:
    """Reads one formula by recursive descent."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = list(self._split())
        self._next = 0
        self.signals: dict[str, None] = {}

    def _split(self) -> Iterator[_Token]:
        for found in _TOKEN.finditer(self._text):
            kind = found.lastgroup or ""
            if kind == "wrong":
                raise FormulaError(f'"{found[kind]}" at character {found.start(kind) + 1} has no meaning in a formula')
            yield _Token(kind, found[kind], found.start(kind), found.end(kind))
        yield _Token("end", "", len(self._text), len(self._text))

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _wrong(self, expected: str, token: _Token | None = None) -> FormulaError:
        token = token or self._token
        found = f'"{token.text}" at character {token.at + 1}' if token.text else "the end of the formula"
        return FormulaError(f"{found}: {expected}")

    def _take(self, *texts: str) -> str:
        """Returns the next token, and goes on, if it is one of these texts; otherwise returns an empty text."""
        if self._token.kind != "number" and self._token.text in texts:
            self._next += 1
            return self._tokens[self._next - 1].text
        return ""

    def _need(self, text: str) -> None:
        if not self._take(text):
            raise self._wrong(f'"{text}" must be here')

    # ---- truth values --------------------------------------------------------------------------------------------

    def conjuncts(self) -> list[tuple[str, Node]]:
        """Returns the parts of the formula that must all hold, with their texts."""
        whole = self._formula()
        if self._token.kind != "end":
            raise self._wrong("the formula must end here, or go on with an operator")
        self._truth(whole, self._tokens[0])
        if not (isinstance(whole, Binary) and whole.operator == "and"):
            return [(" ".join(self._text.split()), whole)]
        # Parts of the outermost `and`: read them again one by one to know their texts.
        parts, self._next = [], 0
        while True:
            begin = self._token.at
            node = self._negated()
            parts.append((" ".join(self._text[begin : self._tokens[self._next - 1].end].split()), node))
            if not self._take("and"):
                break
        return parts

    def _truth(self, node: Node, token: _Token) -> Node:
        if not _is_truth(node):
            raise self._wrong("a truth value must be here, such as a comparison, and this is a number", token)
        return node

    def _formula(self) -> Node:
        start = self._token
        first = self._implied()
        operator = self._take("->", "<->")
        if not operator:
            return first
        then = self._token
        return Binary(operator, (self._truth(first, start), self._truth(self._formula(), then)))

    def _implied(self) -> Node:
        start = self._token
        first = self._either()
        operator = self._take("until", "since")
        if not operator:
            return first
        begin, end = self._interval(operator, bounded=operator == "until")
        then = self._token
        operands = self._truth(first, start), self._truth(self._either(), then)
        return Window("until" if operator == "until" else "since", begin, end, operands)

    def _either(self) -> Node:
        start = self._token
        node = self._both()
        while self._take("or"):
            then = self._token
            node = Binary("or", (self._truth(node, start), self._truth(self._both(), then)))
        return node

    def _both(self) -> Node:
        start = self._token
        node = self._negated()
        while self._take("and"):
            then = self._token
            node = Binary("and", (self._truth(node, start), self._truth(self._negated(), then)))
        return node

    def _negated(self) -> Node:
        operator = self._take("not", *_FUTURE, *_PAST)
        if not operator:
            return self._compared()
        if operator == "not":
            then = self._token
            return Binary("not", (self._truth(self._negated(), then),))
        begin, end = self._interval(operator, bounded=operator in _FUTURE)
        then = self._token
        return Window(operator, begin, end, (self._truth(self._negated(), then),))  # type: ignore[arg-type]

    def _interval(self, operator: str, *, bounded: bool) -> tuple[float, float]:
        start = self._token
        if not self._take("["):
            if bounded:
                raise self._wrong(f"{operator} looks at the future: it needs an interval, such as {operator}[0,5]")
            return 0.0, math.inf
        begin = self._number()
        self._need(",")
        end = self._number()
        self._need("]")
        if begin > end:
            raise self._wrong(f"the interval from {begin:g} to {end:g} s ends before it begins", start)
        return begin, end

    def _number(self) -> float:
        if self._token.kind != "number":
            raise self._wrong("a time in s must be here, 0 or more")
        self._next += 1
        return float(self._tokens[self._next - 1].text)

    def _compared(self) -> Node:
        start = self._token
        first = self._sum()
        operator = self._take(*_COMPARISONS)
        if not operator:
            return first
        then = self._token
        node = Binary(operator, (self._amount(first, start), self._amount(self._sum(), then)))
        if self._token.text in _COMPARISONS:
            raise self._wrong("two comparisons must be connected by and")
        return node

    # ---- numbers -------------------------------------------------------------------------------------------------

    def _amount(self, node: Node, token: _Token) -> Node:
        if _is_truth(node):
            raise self._wrong("a number must be here, and this is a truth value", token)
        return node

    def _sum(self) -> Node:
        return self._row(self._product, "+", "-")

    def _product(self) -> Node:
        return self._row(self._factor, "*", "/")

    def _row(self, part: Callable[[], Node], *operators: str) -> Node:
        start = self._token
        node = part()
        while operator := self._take(*operators):
            then = self._token
            node = Binary(operator, (self._amount(node, start), self._amount(part(), then)))
        return node

    def _factor(self) -> Node:
        token = self._token
        if self._take("-"):
            then = self._token
            return Binary("negative", (self._amount(self._factor(), then),))
        if self._take("("):
            node = self._formula()
            self._need(")")
            return node
        self._next += 1
        if token.kind == "number":
            return Value(float(token.text))
        if token.text in ("true", "false"):
            return Value(token.text == "true")
        if token.kind != "name" or token.text in _KEYWORDS:
            self._next -= 1
            raise self._wrong("a signal, a number or a formula must be here")
        if self._take("("):
            return self._function(token)
        self.signals[token.text] = None
        return Value(token.text)

    def _function(self, token: _Token) -> Node:
        if token.text not in FUNCTIONS:
            raise self._wrong(f"there is no such function; {near(token.text, FUNCTIONS)}", token)
        operands: list[Node] = []
        while not operands or self._take(","):
            then = self._token
            operands.append(self._amount(self._sum(), then))
        self._need(")")
        if len(operands) != FUNCTIONS[token.text]:
            raise self._wrong(f"needs {FUNCTIONS[token.text]} arguments and has {len(operands)}", token)
        return Binary(token.text, tuple(operands))


def _is_truth(node: Node) -> bool:
    if isinstance(node, Value):
        return isinstance(node.value, bool)
    return isinstance(node, Window) or node.operator in (*_COMPARISONS, "and", "or", "not", "->", "<->")

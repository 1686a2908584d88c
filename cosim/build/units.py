"""Decomposition of FMI unit names ("m", "kg.m2", "N/(m/s)2") into SI base units.

Used only to write modelDescription.xml; the master reads the definitions in FMUs.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

__all__ = ["BASE", "BaseUnit", "base_unit"]

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True, slots=True)
class BaseUnit:
    """value in base units = factor * value + offset; `exponents` in the order of `BASE`."""

    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0


def _unit(factor: float = 1.0, offset: float = 0.0, **exponents: int) -> BaseUnit:
    return BaseUnit(tuple(exponents.get(name, 0) for name in BASE), factor, offset)


_SYMBOLS = {
    **{name: _unit(**{name: 1}) for name in BASE},
    "1": _unit(),
    "g": _unit(1e-3, kg=1),
    "cm": _unit(1e-2, m=1),
    "mm": _unit(1e-3, m=1),
    "km": _unit(1e3, m=1),
    "ms": _unit(1e-3, s=1),
    "us": _unit(1e-6, s=1),
    "min": _unit(60.0, s=1),
    "h": _unit(3600.0, s=1),
    "deg": _unit(math.pi / 180.0, rad=1),
    "cdeg": _unit(math.pi / 18000.0, rad=1),
    "Hz": _unit(s=-1),
    "N": _unit(kg=1, m=1, s=-2),
    "Pa": _unit(kg=1, m=-1, s=-2),
    "J": _unit(kg=1, m=2, s=-2),
    "W": _unit(kg=1, m=2, s=-3),
    "V": _unit(kg=1, m=2, s=-3, A=-1),
    "mV": _unit(1e-3, kg=1, m=2, s=-3, A=-1),
    "Ah": _unit(3600.0, s=1, A=1),
    "mAh": _unit(3.6, s=1, A=1),
    "T": _unit(kg=1, s=-2, A=-1),
    "degC": _unit(offset=273.15, K=1),
    "%": _unit(0.01),
}
_TOKEN = re.compile(r"[A-Za-z%]+|-?\d{1,2}|[./()*]")


def base_unit(unit: str) -> BaseUnit:
    """Returns the SI base unit of `unit`: symbols with integer powers, ``.`` or ``*``, ``/`` and parentheses.

    ``a/b.c`` is read from the left, so c is in the numerator.

    Raises:
        ValueError: a symbol is unknown, or the text is not a unit; the message lists the known symbols.
    """
    if unit in _SYMBOLS:
        return _SYMBOLS[unit]
    tokens: list[str] = []
    position = 0
    while position < len(unit):
        match = _TOKEN.match(unit, position)
        if match is None:
            raise ValueError(f"unit {unit!r}: unexpected {unit[position:]!r}")
        tokens.append(match.group())
        position = match.end()
    try:
        exponents, factor, rest = _product(tokens, unit)
    except ArithmeticError:
        factor, rest = 0.0, []
    if rest:
        raise ValueError(f"unit {unit!r}: unexpected {''.join(rest)!r}")
    if not 0.0 < factor < math.inf:
        raise ValueError(f"unit {unit!r}: its powers are too large")
    return BaseUnit(exponents, factor)


def _product(tokens: list[str], unit: str) -> tuple[tuple[int, ...], float, list[str]]:
    exponents, factor, tokens = _power(tokens, unit)
    while tokens and tokens[0] in "./*":
        sign = -1 if tokens[0] == "/" else 1
        part, part_factor, tokens = _power(tokens[1:], unit)
        exponents = tuple(a + sign * b for a, b in zip(exponents, part, strict=True))
        factor *= part_factor**sign
    return exponents, factor, tokens


def _power(tokens: list[str], unit: str) -> tuple[tuple[int, ...], float, list[str]]:
    if not tokens:
        raise ValueError(f"unit {unit!r}: it ends where a symbol should follow")
    if tokens[0] == "(":
        exponents, factor, tokens = _product(tokens[1:], unit)
        if not tokens:
            raise ValueError(f"unit {unit!r}: a parenthesis is not closed")
        if tokens[0] != ")":
            raise ValueError(f"unit {unit!r}: unexpected {''.join(tokens)!r}")
    else:
        symbol = _SYMBOLS.get(tokens[0])
        if symbol is None or symbol.offset:
            raise ValueError(f"unit {unit!r}: {tokens[0]!r} is not one of {', '.join(sorted(_SYMBOLS))}")
        exponents, factor = symbol.exponents, symbol.factor
    tokens = tokens[1:]
    if tokens and tokens[0].lstrip("-").isdigit():
        power = int(tokens[0])
        exponents, factor, tokens = tuple(power * e for e in exponents), factor**power, tokens[1:]
    return exponents, factor, tokens

"""Units as FMI and SSP define them, and the conversion between two of them.

A definition gives the exponents of the SI base units (and rad), a factor and an offset: `value_in_base_units = factor *
value + offset` (FMI 2.0.5, section 2.2.2; SSP 1.0, section 4). The name of a unit is not interpreted: two units without
definitions are equal only if their names are equal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

__all__ = ["BASE_UNITS", "BaseUnit", "UndefinedUnit", "Unit", "UnitError", "conversion"]

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


class UnitError(ValueError):
    """Two units cannot be converted into each other; the message gives the reason."""


class UndefinedUnit(UnitError):
    """Two units have different names, and at least one of them has no definition for a conversion."""


@dataclass(frozen=True, slots=True)
class BaseUnit:
    """A unit in terms of the SI: exponents in the order of `BASE_UNITS`, factor and offset."""

    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0

    def __str__(self) -> str:
        parts = [
            name if power == 1 else f"{name}^{power}"
            for name, power in zip(BASE_UNITS, self.exponents, strict=True)
            if power
        ]
        return " ".join(parts) or "1"


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit's name, with its definition if the file that uses it gives one."""

    name: str
    base: BaseUnit | None = None

    def relative(self) -> Unit:
        """Returns the unit for a difference of two values (FMI's relativeQuantity): the same unit without offset."""
        return self if self.base is None else replace(self, base=replace(self.base, offset=0.0))


def conversion(source: Unit, target: Unit) -> tuple[float, float]:
    """Returns the factor and the offset that convert a value in `source` to a value in `target`.

    Returns:
        (factor, offset) with value_target = factor * value_source + offset; exactly (1.0, 0.0) for equal units.

    Raises:
        UndefinedUnit: one of the units has no definition for a conversion.
        UnitError: the units measure different quantities.
    """
    if source.base is None or target.base is None:
        if source.name == target.name:
            return 1.0, 0.0
        undefined = " and ".join(f'"{unit.name}"' for unit in (source, target) if unit.base is None)
        verb = "have" if source.base is None and target.base is None else "has"
        raise UndefinedUnit(
            f'unit "{source.name}" cannot be converted to "{target.name}": {undefined} {verb} no definition '
            "(a Unit with a BaseUnit) in the file that uses it"
        )
    if source.base.exponents != target.base.exponents:
        raise UnitError(
            f'unit "{source.name}" ({source.base}) cannot be converted to "{target.name}" ({target.base}): '
            "they measure different things"
        )
    if source.base == target.base:
        return 1.0, 0.0
    factor = source.base.factor / target.base.factor
    offset = (source.base.offset - target.base.offset) / target.base.factor
    if not (math.isfinite(factor) and math.isfinite(offset) and factor != 0.0):
        raise UnitError(f'unit "{source.name}" cannot be converted to "{target.name}": the definitions overflow')
    return factor, offset

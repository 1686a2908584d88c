"""Unit conversion against the definitions of the temperature scales and by its own algebra."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.fmi.description.units import BaseUnit, Unit, UnitError, conversion

K, M, ONE = (0, 0, 0, 0, 1, 0, 0, 0), (0, 1, 0, 0, 0, 0, 0, 0), (0,) * 8
KELVIN, CELSIUS = Unit("K", BaseUnit(K)), Unit("degC", BaseUnit(K, 1.0, 273.15))
FAHRENHEIT = Unit("degF", BaseUnit(K, 5.0 / 9.0, 273.15 - 32.0 * 5.0 / 9.0))


# Fixed points and crossings of the scales, in the order K, degC, degF.
@pytest.mark.parametrize(
    "reading",
    [(0.0, -273.15, -459.67), (273.15, 0.0, 32.0), (373.15, 100.0, 212.0), (233.15, -40.0, -40.0)],
    ids=["absolute zero", "ice", "steam", "where C meets F"],
)
@pytest.mark.parametrize("source", range(3))
@pytest.mark.parametrize("target", range(3))
def test_temperatures(reading: tuple[float, ...], source: int, target: int) -> None:
    scales = (KELVIN, CELSIUS, FAHRENHEIT)
    factor, offset = conversion(scales[source], scales[target])
    assert factor * reading[source] + offset == pytest.approx(reading[target], abs=1e-9)


def test_equal_definitions_convert_exactly() -> None:
    assert conversion(Unit("m.s-1", BaseUnit(M, 0.1)), Unit("m/s", BaseUnit(M, 0.1))) == (1.0, 0.0)
    assert conversion(Unit("furlong"), Unit("furlong")) == (1.0, 0.0)
    assert conversion(Unit("m", BaseUnit(M)), Unit("m")) == (1.0, 0.0)


def test_a_relative_quantity_has_no_offset() -> None:
    factor, offset = conversion(CELSIUS.relative(), FAHRENHEIT.relative())
    assert (factor, offset) == (pytest.approx(1.8), 0.0)
    assert Unit("furlong").relative() == Unit("furlong")


def test_different_things_do_not_convert() -> None:
    with pytest.raises(UnitError, match=r'"m" \(m\) cannot be converted to "K" \(K\).*different things'):
        conversion(Unit("m", BaseUnit(M)), KELVIN)
    with pytest.raises(UnitError, match=r'\(1\) cannot be converted to "N" \(kg m s\^-2\)'):
        conversion(Unit("1", BaseUnit(ONE)), Unit("N", BaseUnit((1, 1, -2, 0, 0, 0, 0, 0))))


def test_an_undefined_unit_is_not_guessed() -> None:
    with pytest.raises(UnitError, match='"deg" has no definition'):
        conversion(Unit("deg"), Unit("rad", BaseUnit((0, 0, 0, 0, 0, 0, 0, 1))))
    with pytest.raises(UnitError, match=r'"m/s" and "m\.s-1" have no definition'):
        conversion(Unit("m/s"), Unit("m.s-1"))


def test_a_conversion_that_overflows_is_refused() -> None:
    with pytest.raises(UnitError, match="overflow"):
        conversion(Unit("a", BaseUnit(M, 1e308)), Unit("b", BaseUnit(M, 1e-308)))


magnitudes = st.floats(1e-6, 1e6)
units = st.builds(lambda f, o: Unit(f"u{f}/{o}", BaseUnit(M, f, o)), magnitudes, st.floats(-1e6, 1e6))


@given(units, units, units, st.floats(-1e6, 1e6))
def test_conversions_compose_and_invert(a: Unit, b: Unit, c: Unit, value: float) -> None:
    def through(x: float, *path: Unit) -> float:
        for source, target in pairwise(path):
            factor, offset = conversion(source, target)
            x = factor * x + offset
        return x

    def base(x: float, unit: Unit) -> float:
        assert unit.base is not None
        return unit.base.factor * x + unit.base.offset

    scale = max(1.0, abs(base(value, a)))
    spread = max(scale, *(abs(unit.base.offset) for unit in (a, b, c) if unit.base is not None))
    assert base(through(value, a, b, c), c) == pytest.approx(base(value, a), abs=1e-9 * spread)
    assert base(through(value, a, b, a), a) == pytest.approx(base(value, a), abs=1e-9 * spread)

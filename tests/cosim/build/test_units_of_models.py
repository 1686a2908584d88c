"""Units as modelDescription.xml breaks them down, against pint."""

from __future__ import annotations

import math
import re

import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.build import models_of_package
from cosim.build.units import _SYMBOLS, BASE, base_unit

PINT = pint.UnitRegistry()
OUR_WORD = {
    "deg": "degree",
    "cdeg": "centidegree",
    "Ah": "ampere*hour",
    "mAh": "milliampere*hour",
    "1": "1",
    "%": "percent",
}
# FMI counts radians as a base unit, pint as a pure number: they are compared by what pint says of these words.
ANGLES = {"rad", "deg", "cdeg"}


def pint_base(text: str) -> tuple[dict[str, int], float]:
    """SI base units and factor of an FMI unit, by pint; radians are left out."""
    text = re.sub(r"[A-Za-z%]+", lambda m: f"({OUR_WORD.get(m.group(), m.group())})", text)
    text = re.sub(r"\)(-?\d+)", r")**(\1)", text).replace(".", "*")
    quantity = PINT.Quantity(1.0, PINT.parse_units("dimensionless")) * PINT.parse_expression(text)
    base = quantity.to_base_units()
    names = {
        "kilogram": "kg",
        "meter": "m",
        "second": "s",
        "ampere": "A",
        "kelvin": "K",
        "mole": "mol",
        "candela": "cd",
    }
    exponents = {names[unit]: int(power) for unit, power in base._units.items() if unit != "radian"}
    return {name: power for name, power in exponents.items() if power}, float(base.magnitude)


def exponents(text: str, leave_out: str = "rad") -> dict[str, int]:
    return {n: e for n, e in zip(BASE, base_unit(text).exponents, strict=True) if e and n != leave_out}


@pytest.mark.parametrize("symbol", sorted(set(_SYMBOLS) - {"degC"}))
def test_every_symbol_is_pints(symbol: str) -> None:
    expected, factor = pint_base(symbol)
    assert exponents(symbol) == expected
    assert base_unit(symbol).factor == pytest.approx(factor, rel=1e-15)
    assert base_unit(symbol).offset == 0.0
    assert exponents(symbol, "")["rad"] == 1 if symbol in ANGLES else "rad" not in exponents(symbol, "")


def test_celsius() -> None:
    unit = base_unit("degC")
    kelvin = PINT.Quantity(20.0, "degC").to("K").magnitude
    assert (exponents("degC"), unit.factor * 20.0 + unit.offset) == ({"K": 1}, pytest.approx(kelvin))


@pytest.mark.parametrize(
    ("unit", "expected", "factor"),
    [
        ("m/s", {"m": 1, "s": -1}, 1.0),
        ("m/s2", {"m": 1, "s": -2}, 1.0),
        ("kg.m2", {"kg": 1, "m": 2}, 1.0),
        ("kg*m2", {"kg": 1, "m": 2}, 1.0),
        ("N.m/(rad/s)2", {"kg": 1, "m": 2, "rad": -2}, 1.0),
        ("N/(m/s)2", {"kg": 1, "m": -1}, 1.0),
        ("(m/s)-1", {"m": -1, "s": 1}, 1.0),
        ("1/s", {"s": -1}, 1.0),
        ("m.s-1", {"m": 1, "s": -1}, 1.0),
        ("km/h", {"m": 1, "s": -1}, 1000.0 / 3600.0),
        ("mAh", {"s": 1, "A": 1}, 3.6),
        ("deg/s", {"rad": 1, "s": -1}, math.pi / 180.0),
        ("kg/(m.s2)", {"kg": 1, "m": -1, "s": -2}, 1.0),
    ],
)
def test_by_hand(unit: str, expected: dict[str, int], factor: float) -> None:
    assert exponents(unit, "") == expected
    assert base_unit(unit).factor == pytest.approx(factor, rel=1e-15)


POWER = st.tuples(st.sampled_from(sorted(set(_SYMBOLS) - {"degC", "%", "1"})), st.integers(-3, 3)).map(
    lambda pair: pair[0] if pair[1] in (0, 1) else f"{pair[0]}{pair[1]}"
)
PRODUCT = st.lists(POWER, min_size=1, max_size=3).map(".".join)
UNIT = st.one_of(
    PRODUCT,
    st.tuples(PRODUCT, POWER).map("/".join),
    st.tuples(PRODUCT, PRODUCT, st.integers(-2, 2).filter(bool)).map(lambda x: f"{x[0]}/({x[1]}){x[2]}"),
)


@settings(deadline=None, derandomize=True, max_examples=200)
@given(UNIT)
def test_any_unit_is_pints(text: str) -> None:
    expected, factor = pint_base(text)
    assert exponents(text) == expected
    assert base_unit(text).factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "message"),
    [
        ("furlong", r"unit 'furlong': 'furlong' is not one of %, 1, A, Ah,"),
        ("m/lightyear", r"unit 'm/lightyear': 'lightyear' is not one of"),
        ("degC/s", r"unit 'degC/s': 'degC' is not one of"),
        ("m/(s", r"unit 'm/\(s': a parenthesis is not closed"),
        ("m)s", r"unit 'm\)s': unexpected '\)s'"),
        ("m/", r"unit 'm/': .*ends"),
        ("/s", r"unit '/s': '/' is not one of"),
        ("m//s", r"unit 'm//s': '/' is not one of"),
        ("m^2", r"unit 'm\^2': unexpected '\^2'"),
        ("m-", r"unit 'm-': unexpected '-'"),
        ("m2-3", r"unit 'm2-3': unexpected '-3'"),
        ("ms-99.ms-99", r"powers are too large"),
        ("(ms99)2", r"powers are too large"),
        ("m100", r"unit 'm100': unexpected '0'"),
        ("m s", r"unit 'm s': unexpected ' s'"),
        ("()", r"unit '\(\)': '\)' is not one of"),
        ("", r"unit '': it ends"),
    ],
)
def test_no_unit(unit: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        base_unit(unit)


@settings(deadline=None, derandomize=True, max_examples=300)
@given(st.text(alphabet="ms/().*-23 1^%d", max_size=8))
def test_any_text_is_a_unit_or_a_value_error(text: str) -> None:
    try:
        unit = base_unit(text)
    except ValueError as error:
        assert repr(text) in str(error)
    else:
        assert unit.factor > 0.0


def test_every_unit_of_every_model() -> None:
    seen = {v.unit for model in models_of_package("cosim_models") for v in model.variables if v.unit}
    assert len(seen) > 10
    for unit in seen:
        if unit != "degC":
            expected, factor = pint_base(unit)
            assert exponents(unit) == expected, unit
            assert base_unit(unit).factor == pytest.approx(factor, rel=1e-15), unit

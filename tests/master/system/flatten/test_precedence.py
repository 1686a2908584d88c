"""Who wins among parameter bindings, against a few lines that say the rule of SSP 2.0, section 5.2.3, again."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system

LEVELS = ("", "outer", "outer.inner", "outer.inner.unit")
"""From the root to the component; a binding at one of them names what is below it."""


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_higher_levels_then_later_bindings(workshop: Any, variable: Any, data: st.DataObject) -> None:
    workshop.fmu("unit.fmu", variable("p", "parameter"), variable("q", "parameter"))
    written = st.lists(st.dictionaries(st.sampled_from(["p", "q"]), st.integers(-99, 99).map(float)), max_size=3)
    bindings = [data.draw(written) for _ in LEVELS]
    prefixed = data.draw(st.booleans())

    def bound(level: int) -> str:
        if not bindings[level]:
            return ""
        below = ["outer", "inner", "unit"][level:]
        path = "".join(f"{name}." for name in below)
        if prefixed:
            return str(workshop.bindings(*bindings[level], prefix=path))
        return str(workshop.bindings(*({path + name: value for name, value in one.items()} for one in bindings[level])))

    nested = data.draw(st.booleans())
    made = workshop.component("unit", "unit.fmu", "", bound(3))
    made = workshop.system(made, name="inner", bindings=bound(2))
    if nested:
        workshop.ssd("outer.ssd", workshop.system(made, name="anything"))
        made = workshop.component("outer", "outer.ssd", "", bound(1), type="application/x-ssp-definition")
    else:
        made = workshop.system(made, name="outer", bindings=bound(1))
    checked = check(read_system(workshop.ssd("s.ssd", workshop.system(made, bindings=bound(0)))))

    expected: dict[str, float] = {}
    for level in reversed(bindings):
        for one in level:
            expected.update(one)
    (instance,) = checked.instances
    assert dict(instance.start_values) == expected
    for name, value in expected.items():
        given_values = [made.value for made in checked.assignments["outer.inner.unit", name]]
        in_order = [one[name] for level in reversed(bindings) for one in level if name in one]
        assert given_values == in_order and given_values[-1] == value


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mappings_one_after_the_other(workshop: Any, variable: Any, data: st.DataObject) -> None:
    """A value that goes through systems is looked up in one table after the other."""
    workshop.fmu("unit.fmu", variable("n", kind="Integer"), variable("m", "output", kind="Integer"))
    values = st.integers(-3, 3)
    tables = data.draw(st.lists(st.dictionaries(values, values, min_size=1), min_size=1, max_size=4))
    inside, name = workshop.component("unit", "unit.fmu", "n:input"), "unit"
    port = "n"
    texts = [
        "".join(f'<ssc:MapEntry source="{key}" target="{value}"/>' for key, value in table.items()) for table in tables
    ]
    for i, text in enumerate(reversed(texts[1:])):
        wire = workshop.connection(
            "in", f"{name}/{port}", f"<ssc:IntegerMappingTransformation>{text}</ssc:IntegerMappingTransformation>"
        )
        inside, name, port = workshop.system(inside, wire, name=f"s{i}", connectors="in:input:Integer"), f"s{i}", "in"
    first = f"<ssc:IntegerMappingTransformation>{texts[0]}</ssc:IntegerMappingTransformation>"
    source = workshop.component("source", "unit.fmu", "m:output")
    path = workshop.ssd(
        "s.ssd", workshop.system(inside + source, workshop.connection("source/m", f"{name}/{port}", first))
    )
    (link,) = check(read_system(path)).links
    for value in range(-4, 5):
        expected = value
        for table in tables:
            expected = table.get(expected, expected)
        assert link.converted(value) == expected

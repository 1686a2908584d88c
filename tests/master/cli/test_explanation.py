"""Who set a value, who was overridden, what drives a variable: literally as the user reads it."""

from __future__ import annotations

from typing import Any

import pytest

from cosim_master.cli.views.explanation import explain
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system

LEVEL = (
    '<SimpleType name="Level"><Enumeration><Item name="low" value="1"/><Item name="high" value="5"/></Enumeration>'
    "</SimpleType>"
)


@pytest.fixture
def explained(workshop: Any, variable: Any) -> Any:
    """Explains a variable of two FMUs, "in.a" inside a system and "b" beside it."""
    workshop.fmu(
        "unit.fmu",
        variable("u", unit="m"),
        variable("n", kind="Integer"),
        variable("p", "parameter", unit="m", start="0.25"),
        variable("e", kind="Enumeration", declaredType="Level"),
        variable("y", "output", unit="m"),
        variable("m", "output", kind="Integer"),
        types=LEVEL,
        step="0.5",
    )
    inner = workshop.component("a", "unit.fmu", "u:input n:input y:output", workshop.bindings({"p": 1.0, "q": 3.0}))
    inner = workshop.system(inner, workshop.connection("deep", "a/u"), name="in", connectors="deep:input")
    other = workshop.component("b", "unit.fmu", "y:output m:output e:input")
    wire = workshop.connection("b/y", "in/deep", '<ssc:LinearTransformation factor="2" offset="1"/>')
    sets = workshop.bindings({"in.a.p": 2.0, "b.n": 7}, {"b.e": "high"}).replace(
        '<ssv:String value="high"/>', '<ssv:Enumeration value="high"/>'
    )
    path = workshop.ssd("s.ssd", workshop.system(inner + other, wire, bindings=sets))

    def run(name: str, overrides: dict[str, str] | None = None) -> list[str]:
        lines = explain(check(read_system(path), overrides), name)
        return [line.replace(f"{workshop.root}/", "") for line in lines]

    return run


def test_who_wins_and_who_is_overridden(explained: Any) -> None:
    assert explained("in.a.p", {"in.a.p": "4"}) == [
        "in.a.p: parameter of unit.fmu, Real, m",
        "  start value 4.0 m, set by --set in.a.p=4.0",
        "  overridden: 2.0 m, set by s.ssd:4: in.a.p = 2.0, bound to the root system",
        '  overridden: 1.0 m, set by s.ssd:22: p = 1.0, bound to "in.a"',
        "  overridden: 0.25 m, of the FMU",
        '  ignored nearby: s.ssd:23: in.a.q; valid: "e", "n", "p", "u"',
    ]


def test_what_drives_an_input(explained: Any) -> None:
    lines = explained("in.a.u")
    assert lines[1] == "  start value 0.0 m, of the FMU: not set elsewhere"
    assert lines[2].startswith("  driven from the start on by b.y, at s.ssd:")
    assert lines[3] == "    value = 2 * source + 1"


def test_the_items_of_an_enumeration(explained: Any) -> None:
    assert "  start value high (5), set by" in explained("b.e")[1]


def test_what_the_fmu_computes(explained: Any) -> None:
    assert explained("b.y") == ["b.y: output of unit.fmu, Real, m", "  no start value: the FMU computes it"]


def test_the_connector_of_a_system(explained: Any) -> None:
    assert explained("in.deep") == [
        "in.deep: connector of a system, m",
        "  driven by b.y",
        "    value = 2 * source + 1",
    ]


def test_a_pattern_is_the_explanation_of_all_that_match_in_their_order(explained: Any) -> None:
    assert explained("*.y") == explained("b.y") + explained("in.a.y")
    assert explained("in.*e?p") == explained("in.deep")
    assert explained("b.?") == [line for one in "unpeym" for line in explained(f"b.{one}")]


def test_a_pattern_that_matches_nothing(explained: Any) -> None:
    with pytest.raises(SystemDescriptionError, match=r'"b\.\*x" matches no variable; '):
        explained("b.*x")


def test_a_name_that_is_none(explained: Any) -> None:
    with pytest.raises(SystemDescriptionError, match=r'there is no variable "b\.x"; did you mean "b\.u"'):
        explained("b.x")
    with pytest.raises(SystemDescriptionError, match=r'did you mean "b\.n"'):
        explained("bn")

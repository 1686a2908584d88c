"""Flattening and checking: what a run gets, and every way a system can disagree with its FMUs or with itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from cosim_master.diagnostics.errors import Finding, SystemDescriptionError
from cosim_master.execution.preparation.isolating import isolation_for
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem, natural
from cosim_master.system.flatten.init_order import exchange_order
from cosim_master.system.reading.read import read_system

SSD_TYPE = "application/x-ssp-definition"
TYPES = (
    '<SimpleType name="Mode"><Enumeration><Item name="off" value="0"/><Item name="on" value="5"/></Enumeration>'
    '</SimpleType><SimpleType name="More"><Enumeration><Item name="off" value="0"/><Item name="on" value="5"/>'
    '<Item name="auto" value="6"/></Enumeration></SimpleType><SimpleType name="Other"><Enumeration>'
    '<Item name="off" value="5"/><Item name="on" value="0"/></Enumeration></SimpleType>'
)


@pytest.fixture(autouse=True)
def unit_fmu(workshop: Any, variable: Any) -> None:
    """unit.fmu: one variable of each kind and type."""
    workshop.fmu(
        "unit.fmu",
        variable("u", unit="m"),
        variable("v", unit="K"),
        variable("w"),
        variable("n", kind="Integer"),
        variable("b", kind="Boolean"),
        variable("s", kind="String"),
        variable("e", kind="Enumeration", declaredType="Mode", start="0"),
        variable("more", kind="Enumeration", declaredType="More", start="0"),
        variable("other", kind="Enumeration", declaredType="Other", start="0"),
        variable("p", "parameter", unit="m", start="1", min="0", max="10"),
        variable("i", "parameter", kind="Integer", min="0", max="10"),
        variable("label", "parameter", kind="String"),
        variable("c", "calculatedParameter"),
        variable("y", "output", unit="m"),
        variable("t", "output", unit="degC"),
        variable("yn", "output", kind="Integer"),
        variable("yb", "output", kind="Boolean"),
        variable("ys", "output", kind="String"),
        variable("ye", "output", kind="Enumeration", declaredType="Mode"),
        variable("a.b[1]", "parameter"),
        variable("x0", "local", initial="approx", start="4"),
        types=TYPES,
        step="0.01",
    )


ALL = "u:input v:input w:input n:input b:input s:input e:input more:input other:input p:parameter i:parameter "
ALL += "c:calculatedParameter y:output t:output yn:output yb:output ys:output ye:output"


@pytest.fixture
def two(workshop: Any) -> Any:
    """Checks a system of two unit.fmu, "one" and "two", with the given connections and bindings."""

    def run(connections: str = "", overrides: dict[str, str] | None = None, units: str = "", **options: str) -> Any:
        components = workshop.component("one", "unit.fmu", ALL) + workshop.component("two", "unit.fmu", ALL)
        path = workshop.ssd("two.ssd", workshop.system(components, connections, **options), units)
        return check(read_system(path), overrides)

    return run


def problems_of(run: Any, *arguments: Any, **options: Any) -> list[str]:
    with pytest.raises(SystemDescriptionError) as caught:
        run(*arguments, **options)
    return [str(problem) for problem in caught.value.problems]


def only(found: Sequence[str]) -> str:
    (one,) = found
    return one


def values_of(checked: CheckedSystem, name: str) -> dict[str, Any]:
    return dict(next(instance.start_values for instance in checked.instances if instance.name == name))


class TestConnections:
    def test_direction_follows_from_kind_and_not_from_start_and_end(self, two: Any, workshop: Any) -> None:
        checked = two(workshop.connection("one/u", "two/y") + workshop.connection("one/y", "two/u"))
        assert [(link.source, link.target) for link in checked.links] == [
            (("two", "y"), ("one", "u")),
            (("one", "y"), ("two", "u")),
        ]

    def test_units_then_the_linear_transformation(self, two: Any, workshop: Any) -> None:
        inner = '<ssc:LinearTransformation factor="2" offset="1"/>'
        (link,) = two(workshop.connection("one/t", "two/v", inner)).links
        assert link.factor * 10.0 + link.offset == pytest.approx(2.0 * (10.0 + 273.15) + 1.0)

    def test_without_unit_conversion(self, two: Any, workshop: Any) -> None:
        inner = '<ssc:LinearTransformation offset="1"/>'
        connection = workshop.connection("one/t", "two/v", inner, suppressUnitConversion="true")
        (link,) = two(connection).links
        assert (link.factor, link.offset) == (1.0, 1.0)
        (link,) = two(workshop.connection("one/y", "two/v", suppressUnitConversion="true")).links
        assert (link.factor, link.offset) == (1.0, 0.0)

    @pytest.mark.parametrize(
        ("source", "target"),
        [("yn", "w"), ("yb", "w"), ("yb", "n"), ("yn", "e"), ("ye", "n"), ("ye", "e"), ("ye", "more")],
    )
    def test_types_that_go_together(self, two: Any, workshop: Any, source: str, target: str) -> None:
        (link,) = two(workshop.connection(f"one/{source}", f"two/{target}")).links
        assert (link.factor, link.offset) == (1.0, 0.0)

    @pytest.mark.parametrize(
        ("source", "target", "types"),
        [
            ("b", "y", "Real and two.b is Boolean"),
            ("e", "yb", "Boolean and two.e is Enumeration"),
            ("n", "y", "Real and two.n is Integer"),
            ("s", "ye", "Enumeration and two.s is String"),
            ("b", "yn", "Integer and two.b is Boolean"),
        ],
    )
    def test_types_that_do_not(self, two: Any, workshop: Any, source: str, target: str, types: str) -> None:
        text = only(problems_of(two, workshop.connection(f"two/{source}", f"one/{target}")))
        assert f"one.{target} is {types}; types must be equal" in text

    def test_enumerations_of_other_items(self, two: Any, workshop: Any) -> None:
        text = only(problems_of(two, workshop.connection("one/ye", "two/other")))
        assert "two.other has the enumeration items off = 5, on = 0; what drives it has off = 0, on = 5" in text

    def test_units_that_measure_different_things(self, two: Any, workshop: Any) -> None:
        text = only(problems_of(two, workshop.connection("one/y", "two/v")))
        assert re.search(r'two\.ssd:\d+: one\.y to two\.v: unit "m" \(m\) cannot be converted to "K" \(K\)', text)

    def test_a_unit_to_a_port_without_one_is_noted(self, two: Any, workshop: Any) -> None:
        notes = two(workshop.connection("one/y", "two/w")).notes
        assert any(note.startswith("1 connections join a unit to a port without one") for note in notes)

    def test_a_linear_transformation_of_an_integer(self, two: Any, workshop: Any) -> None:
        inner = '<ssc:LinearTransformation factor="2"/>'
        assert "needs a Real, but two.n is Integer" in only(
            problems_of(two, workshop.connection("one/yn", "two/n", inner))
        )
        (link,) = two(workshop.connection("one/yn", "two/w", inner)).links
        assert link.factor == 2.0

    @pytest.mark.parametrize(
        ("start", "end"), [("one/y", "two/y"), ("one/u", "two/u"), ("one/y", "two/p"), ("one/c", "two/c")]
    )
    def test_kinds_that_cannot_be_connected(self, two: Any, workshop: Any, start: str, end: str) -> None:
        text = only(problems_of(two, workshop.connection(start, end)))
        assert "cannot be connected; valid: element calculatedParameter -> element input" in text

    def test_calculated_parameters_go_to_parameters_and_inputs(self, two: Any, workshop: Any) -> None:
        links = two(workshop.connection("one/c", "two/p") + workshop.connection("one/c", "two/w")).links
        assert [(link.target[1], link.initial_only) for link in links] == [("p", True), ("w", False)]

    def test_two_writers(self, two: Any, workshop: Any) -> None:
        text = only(problems_of(two, workshop.connection("one/y", "two/u") + workshop.connection("two/u", "two/y")))
        first, second = re.findall(r"two\.ssd:(\d+)", text)
        assert "input two.u has two writers; the other is at" in text and int(first) == int(second) + 1

    def test_two_names_of_one_variable(self, workshop: Any, variable: Any) -> None:
        alias = variable("alias").replace("'@'", '"0"')
        workshop.fmu("alias.fmu", variable("u"), alias, variable("y", "output"))
        component = workshop.component("one", "alias.fmu", "u:input alias:input y:output")
        connections = workshop.connection("one/y", "one/u") + workshop.connection("one/y", "one/alias")
        path = workshop.ssd("a.ssd", workshop.system(component, connections))
        text = only(problems_of(lambda: check(read_system(path))))
        assert '"one.alias" and "one.u" are the same variable of the FMU' in text

    def test_unknown_elements_and_connectors(self, two: Any, workshop: Any) -> None:
        wrong = workshop.connection("ons/y", "two/u") + workshop.connection("one/yy", "two/u")
        wrong += workshop.connection("one/label", "two/u") + workshop.connection("nowhere", "two/u")
        found = problems_of(two, wrong)
        assert 'there is no element "ons" in the system; did you mean "one"?' in found[0]
        assert '"one" has no connector "yy"; did you mean' in found[1]
        assert '"one" has no connector "label"; its FMU has the parameter, so declare it in <Connectors>' in found[2]
        assert 'the system has no connector "nowhere"; there is none' in found[3]


class TestConnectors:
    def one(self, workshop: Any, connectors: str, after: str = "") -> CheckedSystem:
        component = workshop.component("one", "unit.fmu", connectors)
        return check(read_system(workshop.ssd("one.ssd", workshop.system(component), after)))

    @pytest.mark.parametrize(
        ("connector", "message"),
        [
            ("z:input", 'unit.fmu has no variable "z"; valid: "b", "e"'),
            ("uu:input", 'unit.fmu has no variable "uu"; did you mean "u"?'),
            ("u:output", 'connector "u" is output, but unit.fmu has it as input'),
            ("p:input", 'connector "p" is input, but unit.fmu has it as parameter'),
            ("u:input:Integer", 'connector "u" is Integer, but unit.fmu has it as Real'),
            ("s:input:Binary", 'connector "s" is Binary, but unit.fmu has it as String'),
            ("u:input:Real:km", 'connector "u" has the unit "km" and "m" in unit.fmu; write the same unit'),
            ("u:input:Real:s", 'connector "u" has the unit "s" and "m" in unit.fmu (unit "s" (s) cannot'),
            ("e:input:Enumeration:Flipped", 'enumeration "Flipped" of connector "e" has other items than unit.fmu'),
        ],
    )
    def test_that_disagree_with_the_fmu(self, workshop: Any, connector: str, message: str) -> None:
        enumeration = (
            '<ssd:Enumerations><ssc:Enumeration name="Flipped"><ssc:Item name="off" value="5"/></ssc:Enumeration>'
            "</ssd:Enumerations>\n"
        )
        after = enumeration + workshop.units("km", "s")
        assert message in only(problems_of(lambda: self.one(workshop, connector, after)))

    def test_that_agree(self, workshop: Any) -> None:
        assert self.one(workshop, "u:input:Real:m e:input n:input:Integer p:parameter").instances[0].name == "one"

    def test_an_enumeration_with_fewer_items_agrees(self, workshop: Any) -> None:
        """A system that was written for an older version of an FMU."""
        enumeration = (
            '<ssd:Enumerations><ssc:Enumeration name="Fewer"><ssc:Item name="on" value="5"/></ssc:Enumeration>'
            "</ssd:Enumerations>\n"
        )
        one = self.one(workshop, "e:input:Enumeration:Fewer", enumeration)
        assert one.instances[0].name == "one"
        assert not any("Fewer" in note for note in one.notes)

    def test_an_undefined_enumeration_is_noted(self, workshop: Any) -> None:
        notes = self.one(workshop, "e:input:Enumeration:Mode").notes
        assert any('enumeration "Mode" is not defined in the file' in note for note in notes)


class TestHierarchy:
    def test_through_system_connectors_both_ways(self, workshop: Any) -> None:
        component = workshop.component("unit", "unit.fmu", "u:input y:output")
        doubled = '<ssc:LinearTransformation factor="2"/>'
        inner = workshop.connection("go", "unit/u", doubled) + workshop.connection("is", "unit/y")
        systems = "".join(
            workshop.system(component, inner, name=name, connectors="go:input is:output") for name in ("a", "b")
        )
        across = workshop.connection("a/is", "b/go") + workshop.connection("out", "b/is")
        path = workshop.ssd(
            "h.ssd", workshop.system(systems, across, connectors="out:output:Real:cm"), workshop.units("cm")
        )
        checked = check(read_system(path))
        (link,) = checked.links
        assert (link.source, link.target) == (("a.unit", "y"), ("b.unit", "u"))
        assert (link.factor, link.offset) == (2.0, 0.0)
        aliases = {alias.name: (alias.source, alias.factor) for alias in checked.aliases}
        assert aliases == {
            "a.is": (("a.unit", "y"), 1.0),
            "b.go": (("a.unit", "y"), 1.0),
            "b.is": (("b.unit", "y"), 1.0),
            "out": (("b.unit", "y"), 100.0),
        }

    def test_the_unit_of_a_system_connector_counts(self, workshop: Any) -> None:
        component = workshop.component("unit", "unit.fmu", "v:input t:output")
        shifted = '<ssc:LinearTransformation offset="1"/>'
        inner = workshop.connection("unit/t", "hot", shifted)
        systems = workshop.system(component, inner, name="a", connectors="hot:output:Real:degF")
        across = workshop.connection("a/hot", "b/v")
        system = workshop.system(systems + workshop.component("b", "unit.fmu", "v:input"), across)
        (link,) = check(read_system(workshop.ssd("h.ssd", system, workshop.units("degF")))).links
        fahrenheit = 100.0 * 1.8 + 32.0 + 1.0
        assert link.factor * 100.0 + link.offset == pytest.approx((fahrenheit - 32.0) / 1.8 + 273.15)

    @pytest.mark.parametrize("unit", ["", "mile"])
    def test_a_unit_without_definition_on_the_way_is_not_converted(self, workshop: Any, unit: str) -> None:
        """Behind it, the unit is still that of the FMU, which has a definition: only one connection is named."""
        component = workshop.component("unit", "unit.fmu", "u:input y:output")
        inner = workshop.connection("unit/y", "far")
        system = workshop.system(component, inner, name="a", connectors="far:output:Real:km").replace("km", unit)
        system += workshop.component("b", "unit.fmu", "u:input")
        checked = check(
            read_system(workshop.ssd("h.ssd", workshop.system(system, workshop.connection("a/far", "b/u"))))
        )
        (link,) = checked.links
        assert (link.factor, link.offset) == (1.0, 0.0)
        (finding,) = [str(note) for note in checked.notes if isinstance(note, Finding)]
        assert f'unit.y to a.far: not converted: unit "m" cannot be converted to "{unit}": "{unit}" has no' in finding

    def test_one_ssd_five_times(self, workshop: Any) -> None:
        component = workshop.component("vehicle", "unit.fmu", "u:input y:output")
        inner = workshop.connection("go", "vehicle/u") + workshop.connection("vehicle/y", "is")
        workshop.ssd("drone.ssd", workshop.system(component, inner, connectors="go:input is:output"))
        drones = "".join(
            workshop.component(f"drone{i}", "drone.ssd", "go:input is:output", type=SSD_TYPE) for i in (10, 2, 1)
        )
        ring = "".join(workshop.connection(f"drone{a}/is", f"drone{b}/go") for a, b in ((1, 2), (2, 10), (10, 1)))
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(drones, ring))))
        assert [instance.name for instance in checked.instances] == [
            "drone1.vehicle",
            "drone2.vehicle",
            "drone10.vehicle",
        ]
        assert [link.target[0] for link in checked.links] == ["drone1.vehicle", "drone2.vehicle", "drone10.vehicle"]
        assert checked.instances[0].fmu is checked.instances[2].fmu

    @pytest.mark.parametrize(
        ("connector", "message"),
        [
            ("gone:input", '"drone" has no connector "gone" inside; did you mean "go"?'),
            ("go:output", 'connector "go" is output here and input inside, at'),
            ("go:input:Integer", 'connector "go" is Integer here and Real inside, at'),
            ("go:input:Real:s", 'connector "go" has the unit "s" and "m" inside, at'),
        ],
    )
    def test_a_component_that_misstates_its_system(self, workshop: Any, connector: str, message: str) -> None:
        component = workshop.component("vehicle", "unit.fmu", "u:input")
        inner = workshop.connection("go", "vehicle/u")
        workshop.ssd("drone.ssd", workshop.system(component, inner, connectors="go:input:Real:m"), workshop.units("m"))
        outer = workshop.component("drone", "drone.ssd", connector, type=SSD_TYPE)
        path = workshop.ssd("s.ssd", workshop.system(outer), workshop.units("s"))
        assert message in only(problems_of(lambda: check(read_system(path))))

    def test_a_loop_of_nothing_but_connections(self, workshop: Any) -> None:
        through = workshop.connection("in", "out")
        systems = "".join(workshop.system("", through, name=name, connectors="in:input out:output") for name in "ab")
        ring = workshop.connection("a/out", "b/in") + workshop.connection("b/out", "a/in")
        path = workshop.ssd("s.ssd", workshop.system(systems, ring))
        found = problems_of(lambda: check(read_system(path)))
        assert "connections form a loop without any component in it: " in found[0]

    def test_a_long_chain_of_systems(self, workshop: Any) -> None:
        count = 1500
        through = workshop.connection("in", "out", '<ssc:LinearTransformation offset="1"/>')
        parts = [workshop.system("", through, name=f"s{i}", connectors="in:input out:output") for i in range(count)]
        parts.append(workshop.component("unit", "unit.fmu", "u:input y:output"))
        ring = workshop.connection("unit/y", "s0/in") + workshop.connection("unit/u", f"s{count - 1}/out")
        ring += "".join(workshop.connection(f"s{i}/out", f"s{i + 1}/in") for i in range(count - 1))
        (link,) = check(read_system(workshop.ssd("s.ssd", workshop.system("".join(parts), ring)))).links
        assert link.offset == count

    def test_two_components_of_one_hierarchical_name(self, workshop: Any) -> None:
        inner = workshop.system(workshop.component("b.c", "unit.fmu"), name="a")
        other = workshop.system(workshop.component("c", "unit.fmu"), name="a.b")
        path = workshop.ssd("s.ssd", workshop.system(inner + other))
        checked = check(read_system(path))
        assert [instance.name for instance in checked.instances] == ["a.b.c", "a.b.c#2"]
        assert any('two components have the hierarchical name "a.b.c"' in note for note in checked.notes)

    def test_a_component_whose_system_is_broken(self, workshop: Any) -> None:
        (workshop.root / "drone.ssd").write_text("<oops")
        components = workshop.component("a", "drone.ssd", "y:output", type=SSD_TYPE)
        components += workshop.component("b", "unit.fmu", "u:input")
        wires = workshop.connection("a/y", "b/u")
        path = workshop.ssd("s.ssd", workshop.system(components, wires, bindings=workshop.bindings({"a.x.y": 1.0})))
        assert "drone.ssd:1: not well-formed XML" in only(problems_of(lambda: check(read_system(path), {"a.z": "1"})))

    def test_what_is_behind_a_broken_file_is_not_complained_about(self, workshop: Any) -> None:
        (workshop.root / "bad.fmu").write_text("no")
        components = workshop.component("bad", "bad.fmu", "u:input") + workshop.component("gone", "gone.fmu")
        bindings = workshop.bindings({"bad.x": 1.0, "gone.y": 1.0})
        wires = workshop.connection("bad/u", "one/y") + workshop.connection("gone/z", "one/u")
        components += workshop.component("one", "unit.fmu", "u:input y:output")
        path = workshop.ssd("s.ssd", workshop.system(components, wires, bindings=bindings))
        found = problems_of(lambda: check(read_system(path)))
        assert len(found) == 2
        assert 'source "gone.fmu" does not exist' in found[0]
        assert "bad.fmu: not a readable ZIP archive" in found[1] and 'source of component "bad" at' in found[1]


class TestParameters:
    def test_types(self, two: Any, workshop: Any) -> None:
        values = {"one.p": 2.0, "one.i": 3, "one.label": "x", "one.b": True, "one.w": 4, "one.a.b[1]": 5.0, "one.e": 5}
        checked = two(bindings=workshop.bindings(values))
        assert values_of(checked, "one") == {"p": 2.0, "i": 3, "label": "x", "b": True, "w": 4.0, "a.b[1]": 5.0, "e": 5}
        assert isinstance(values_of(checked, "one")["w"], float)
        assert values_of(checked, "two") == {}

    def test_effective_values_fill_up_from_the_fmu(self, two: Any, workshop: Any) -> None:
        checked = two(bindings=workshop.bindings({"one.p": 2.0}))
        effective = checked.instances[0].effective_values()
        assert (effective["p"], effective["i"], effective["u"]) == (2.0, 0, 0.0)
        assert "y" not in effective and "x0" not in effective

    def test_enumerations_by_item_name(self, two: Any, workshop: Any) -> None:
        checked = two(bindings=workshop.bindings({"one.e": "on", "one.more": "auto"}, kind="Enumeration"))
        assert values_of(checked, "one") == {"e": 5, "more": 6}

    def test_units(self, two: Any, workshop: Any) -> None:
        values = workshop.bindings({"one.u": 2.0}, unit="km")
        values = values.replace("</ssv:Parameters>", "</ssv:Parameters><ssv:Units><ssc:Unit name='km'>"
                                "<ssc:BaseUnit m='1' factor='1000'/></ssc:Unit></ssv:Units>")  # fmt: skip
        assert values_of(two(bindings=values), "one") == {"u": 2000.0}
        assert values_of(two(bindings=workshop.bindings({"one.u": 2.0}, unit="m")), "one") == {"u": 2.0}

    def test_the_unit_of_a_connector_where_the_fmu_has_none(self, workshop: Any, variable: Any) -> None:
        """A value is converted to it, as a connection's is; the FMU's own unit, if there is one, goes before."""
        workshop.fmu("plain.fmu", variable("u"), variable("p", "parameter"))
        values = workshop.bindings({"u": 3.0, "p": 3.0}, unit="km")
        values = values.replace("</ssv:Parameters>", "</ssv:Parameters><ssv:Units><ssc:Unit name='km'>"
                                "<ssc:BaseUnit m='1' factor='1000'/></ssc:Unit></ssv:Units>")  # fmt: skip
        component = workshop.component("one", "plain.fmu", "u:input:Real:m p:parameter", values)
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(component), workshop.units("m"))))
        assert values_of(checked, "one") == {"u": 3000.0, "p": 3.0}

    def test_later_wins_and_higher_wins(self, workshop: Any) -> None:
        own = workshop.bindings({"p": 1.0, "u": 1.0, "w": 1.0, "v": 1.0}, {"u": 2.0})
        component = workshop.component("unit", "unit.fmu", bindings=own)
        middle = workshop.system(component, name="mid", bindings=workshop.bindings({"unit.w": 3.0, "unit.v": 3.0}))
        top = workshop.bindings({"mid.unit.v": 4.0})
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(middle, bindings=top))))
        assert values_of(checked, "mid.unit") == {"p": 1.0, "u": 2.0, "w": 3.0, "v": 4.0}

    def test_a_component_wins_over_the_system_in_its_file(self, workshop: Any) -> None:
        inner = workshop.component("unit", "unit.fmu")
        own = workshop.bindings({"unit.p": 1.0, "unit.u": 1.0})
        workshop.ssd("drone.ssd", workshop.system(inner, bindings=own))
        drones = workshop.component("a", "drone.ssd", bindings=workshop.bindings({"unit.p": 2.0}), type=SSD_TYPE)
        drones += workshop.component("b", "drone.ssd", bindings=workshop.bindings({"unit.p": 3.0}), type=SSD_TYPE)
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(drones))))
        assert values_of(checked, "a.unit") == {"p": 2.0, "u": 1.0}
        assert values_of(checked, "b.unit") == {"p": 3.0, "u": 1.0}

    def test_prefix(self, two: Any, workshop: Any) -> None:
        assert values_of(two(bindings=workshop.bindings({"p": 2.0}, prefix="two.")), "two") == {"p": 2.0}

    def test_one_name_for_two_variables(self, workshop: Any, variable: Any) -> None:
        workshop.fmu("punned.fmu", variable("c.d", "parameter"), variable("d", "parameter"))
        system = workshop.system(workshop.component("c", "punned.fmu"), name="b")
        components = system + workshop.component("b.c", "punned.fmu") + workshop.component("b_", "punned.fmu")
        with_same = components.replace('name="b_"', 'name="a"')
        path = workshop.ssd("s.ssd", workshop.system(with_same, bindings=workshop.bindings({"b.c.c.d": 1.0})))
        checked = check(read_system(path))
        assert [values_of(checked, name) for name in ("b.c", "b.c#2")] == [{"c.d": 1.0}, {"c.d": 1.0}]
        punned = workshop.system(workshop.component("x", "punned.fmu"), name="b") + workshop.component(
            "b.x.c", "punned.fmu"
        )
        path = workshop.ssd("s.ssd", workshop.system(punned, bindings=workshop.bindings({"b.x.c.d": 1.0})))
        checked = check(read_system(path))
        assert values_of(checked, "b.x") == {"c.d": 1.0} and values_of(checked, "b.x.c") == {"d": 1.0}

    def test_the_connector_of_a_system(self, workshop: Any) -> None:
        component = workshop.component("unit", "unit.fmu", "u:input p:parameter")
        doubled = '<ssc:LinearTransformation factor="2"/>'
        inner = workshop.connection("go", "unit/u", doubled) + workshop.connection("size", "unit/p")
        inside = workshop.system(component, inner, name="a", connectors="go:input:Real:km size:parameter")
        top = workshop.bindings({"a.go": 3.0, "a.size": 4})
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(inside, bindings=top), workshop.units("km"))))
        assert values_of(checked, "a.unit") == {"u": 6000.0, "p": 4.0}
        assert values_of(check(checked.structure, {"a.go": "1"}), "a.unit") == {"u": 2000.0, "p": 4.0}

    def test_the_connector_of_a_system_two_levels_up(self, workshop: Any) -> None:
        component = workshop.component("unit", "unit.fmu", "v:input n:input")
        inner = workshop.connection("hot", "unit/v") + workshop.connection("count", "unit/n")
        middle = workshop.system(component, inner, name="mid", connectors="hot:input count:input:Integer")
        outer = workshop.connection("hot", "mid/hot", '<ssc:LinearTransformation offset="1"/>')
        outer += workshop.connection("count", "mid/count")
        top = workshop.system(middle, outer, name="top", connectors="hot:input:Real:K count:input:Integer")

        def run(unit: str) -> CheckedSystem:
            sets = workshop.bindings({"top.hot": 20.0}, {"top.count": 4.0}, unit=unit)
            units = workshop.units("degC", "s").replace("ssd:Units", "ssv:Units")
            sets = sets.replace("</ssv:Parameters>", "</ssv:Parameters>" + units)
            sets = sets.replace(f'<ssv:Real value="4.0" unit="{unit}"/>', '<ssv:Integer value="4"/>')
            return check(read_system(workshop.ssd("s.ssd", workshop.system(top, bindings=sets), workshop.units("K"))))

        assert values_of(run("degC"), "top.mid.unit") == {"v": pytest.approx(20.0 + 273.15 + 1.0), "n": 4}
        assert '"top.hot" cannot be set: unit "s" (s) cannot be converted to "K"' in only(problems_of(lambda: run("s")))

    def test_the_connector_of_a_system_that_leads_nowhere(self, workshop: Any) -> None:
        path = workshop.ssd(
            "s.ssd", workshop.system("", connectors="go:input", bindings=workshop.bindings({"go": 1.0}))
        )
        assert any(
            '"go" sets nothing: root.go is not connected inside' in note for note in check(read_system(path)).notes
        )

    def test_the_output_of_a_system(self, workshop: Any) -> None:
        path = workshop.ssd("s.ssd", workshop.system("", connectors="o:output", bindings=workshop.bindings({"o": 1.0})))
        assert any('"o" sets nothing: nothing drives root.o' in note for note in check(read_system(path)).notes)

    @pytest.mark.parametrize(
        ("name", "value", "kind", "message"),
        [
            ("one.i", 1.5, "Real", '"one.i" is given as Real, but its variable is Integer'),
            ("one.p", "1", "String", '"one.p" is given as String, but its variable is Real'),
            ("one.b", 1, "Integer", '"one.b" is given as Integer, but its variable is Boolean'),
            ("one.p", -0.5, "Real", '"one.p" is set to -0.5, which is outside of its range; valid: 0 to 10'),
            ("one.i", 11, "Integer", '"one.i" is set to 11, which is outside of its range; valid: 0 to 10'),
            ("one.p", "NaN", "Real", '"one.p" is set to NaN'),
            (
                "one.e",
                "in",
                "Enumeration",
                '"one.e" is set to "in", which its enumeration does not have; valid: "off", "on"',
            ),
            ("one.e", 1, "Integer", "which its enumeration does not have; valid: off = 0, on = 5"),
            ("one.y", 1.0, "Real", '"one.y" cannot be set: it is a continuous output (initial="calculated")'),
            ("one.c", 1.0, "Real", '"one.c" cannot be set: it is a fixed calculatedParameter (initial="calculated")'),
        ],
    )
    def test_values_that_cannot_be_set(
        self, two: Any, workshop: Any, name: str, value: Any, kind: str, message: str
    ) -> None:
        assert message in only(problems_of(two, bindings=workshop.bindings({name: value}, kind=kind)))

    def test_units_that_do_not_convert(self, two: Any, workshop: Any) -> None:
        checked = two(bindings=workshop.bindings({"one.u": 1.5}, unit="ell"))
        assert values_of(checked, "one")["u"] == 1.5
        (finding,) = [note for note in checked.notes if isinstance(note, Finding)]
        assert '"one.u" is not converted: unit "ell" cannot be converted to "m"' in finding

    def test_what_matches_nothing_is_noted(self, two: Any, workshop: Any) -> None:
        checked = two(bindings=workshop.bindings({"one.pp": 1.0, "three.p": 1.0}))
        assert [item.name for item in checked.unmatched] == ["one.pp", "three.p"]
        assert any('"one.pp" matches nothing and is ignored; did you mean "one.p"?' in note for note in checked.notes)
        assert any('"three.p" matches nothing and is ignored; ' in note for note in checked.notes)
        assert [note.kind for note in checked.notes if isinstance(note, Finding)] == [
            "parameters that match nothing"
        ] * 2

    def test_a_parameter_without_a_connector_can_be_set(self, two: Any, workshop: Any) -> None:
        assert values_of(two(bindings=workshop.bindings({"one.x0": 1.0})), "one") == {"x0": 1.0}


class TestOverrides:
    def test_they_win(self, two: Any, workshop: Any) -> None:
        values = {"one.p": "2.5", "one.i": "7", "one.b": "TRUE", "one.label": " as is ", "one.e": "on", "one.more": "6"}
        checked = two(overrides=values, bindings=workshop.bindings({"one.p": 1.0, "one.i": 1}))
        assert values_of(checked, "one") == {"p": 2.5, "i": 7, "b": True, "label": " as is ", "e": 5, "more": 6}

    @pytest.mark.parametrize(
        ("name", "text", "message"),
        [
            ("one.pp", "1", '--set: there is no variable "one.pp"; did you mean "one.p"'),
            ("oen.p", "1", '--set: there is no variable "oen.p"; '),
            ("one.p", "fast", '--set: one.p: "fast" is not of its type; valid: a number'),
            ("one.i", "1.5", '--set: one.i: "1.5" is not of its type; valid: an integer'),
            ("one.b", "yes", '--set: one.b: "yes" is not of its type; valid: true or false'),
            ("one.e", "half", '--set: one.e: "half" is not of its type; valid: one of off, on'),
            ("one.p", "11", '--set: "one.p" is set to 11, which is outside of its range'),
            ("one.i", "99999999999", '--set: "one.i" is set to 99999999999, which does not fit into 32 bits'),
        ],
    )
    def test_that_are_wrong(self, two: Any, name: str, text: str, message: str) -> None:
        assert message in only(problems_of(two, overrides={name: text}))


class TestExperimentAndAnnotations:
    def test_start_and_stop(self, workshop: Any) -> None:
        path = workshop.ssd("s.ssd", workshop.system(), '<ssd:DefaultExperiment startTime="1" stopTime="2"/>')
        checked = check(read_system(path))
        assert (checked.start_time, checked.stop_time) == (1.0, 2.0)
        assert checked.notes == ("the system has no components",)
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system())))
        assert (checked.start_time, checked.stop_time) == (0.0, None)
        assert checked.notes == ("the system names no start time: it starts at 0 s", "the system has no components")

    @staticmethod
    def stepping(workshop: Any, size: object) -> str:
        made: str = workshop.annotation(
            "org.uav-cosim.stepping", f'<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="{size}"/>'
        )
        return made

    def test_the_nearest_step_size_wins(self, workshop: Any, variable: Any) -> None:
        workshop.fmu("silent.fmu", variable("u"))
        own = workshop.component("own", "unit.fmu", after=self.stepping(workshop, "0.001"))
        plain, silent = workshop.component("plain", "unit.fmu"), workshop.component("silent", "silent.fmu")
        inner = workshop.system(own + plain, name="inner", after=self.stepping(workshop, "0.002"))
        workshop.ssd("drone.ssd", workshop.system(own + plain))
        drone = workshop.component("drone", "drone.ssd", after=self.stepping(workshop, 4), type=SSD_TYPE)
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(inner + drone + plain + silent))))
        assert {instance.name: instance.step_size for instance in checked.instances} == {
            "drone.own": 0.001,
            "drone.plain": 4.0,
            "inner.own": 0.001,
            "inner.plain": 0.002,
            "plain": 0.01,
            "silent": 0.001,  # nobody names one
        }

    def test_a_step_size_for_everything(self, workshop: Any) -> None:
        system = workshop.system(workshop.component("a", "unit.fmu"))
        checked = check(read_system(workshop.ssd("s.ssd", system, self.stepping(workshop, 0.5))))
        assert checked.instances[0].step_size == 0.5

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("", "needs one element: <stepping"),
            ('<stepping stepSize="1"/>', "needs one element: <stepping"),
            ('<x:stepping xmlns:x="https://uav-cosim.org/ns/1"/>', 'stepSize "" of <stepping> must be a positive'),
            ('<x:stepping xmlns:x="https://uav-cosim.org/ns/1" stepSize="0"/>', 'stepSize "0" of <stepping> must be'),
            ('<x:stepping xmlns:x="https://uav-cosim.org/ns/1" stepSize="inf"/>', 'stepSize "inf" of <stepping> must'),
            ('<x:stepping xmlns:x="https://uav-cosim.org/ns/1" stepSize="1" rate="2"/>', 'has no attribute "rate"'),
            ('<x:stepping xmlns:x="https://uav-cosim.org/ns/1" stepSize="1"><x:y/></x:stepping>', "holds no <y>"),
        ],
    )
    def test_a_step_size_that_is_wrong(self, workshop: Any, content: str, message: str) -> None:
        annotation = workshop.annotation("org.uav-cosim.stepping", content)
        path = workshop.ssd("s.ssd", workshop.system(workshop.component("a", "unit.fmu", after=annotation)))
        assert message in only(problems_of(lambda: check(read_system(path))))

    def test_annotations_are_kept_with_their_owners(self, workshop: Any) -> None:
        network = workshop.annotation("org.uav-cosim.network", "<x/>")
        component = workshop.component("a", "unit.fmu", after=workshop.annotation("org.example", ""))
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(component, after=network), network)))
        assert [(item.owner, item.annotation.type) for item in checked.annotations] == [
            ("", "org.uav-cosim.network"),
            ("", "org.uav-cosim.network"),
            ("a", "org.example"),
        ]
        assert any('annotation "org.example" is ignored' in note for note in checked.notes)

    def test_a_misspelt_annotation_of_ours(self, workshop: Any) -> None:
        path = workshop.ssd("s.ssd", workshop.system(after=workshop.annotation("org.uav-cosim.netwrok", "")))
        text = only(problems_of(lambda: check(read_system(path))))
        assert 'there is no annotation "org.uav-cosim.netwrok"; did you mean "org.uav-cosim.network"?' in text


class TestFmus:
    def test_once_per_process(self, workshop: Any, variable: Any) -> None:
        workshop.fmu("single.fmu", variable("u"), flags='canBeInstantiatedOnlyOncePerProcess="true"')
        one = workshop.component("a", "single.fmu")
        assert check(read_system(workshop.ssd("s.ssd", workshop.system(one)))).instances
        path = workshop.ssd("s.ssd", workshop.system(one + workshop.component("b", "single.fmu")))
        checked = check(read_system(path))
        assert isolation_for(Isolation("foreign"), checked).scope == "foreign"
        text = only(problems_of(lambda: isolation_for(Isolation("none"), checked)))
        assert "single.fmu can be instantiated only once per process, but is used by a and b, and is not isol" in text

    def test_a_bad_fmu_is_described_once(self, workshop: Any) -> None:
        (workshop.root / "bad.fmu").write_text("no")
        components = "".join(workshop.component(f"c{i}", "bad.fmu") for i in range(5))
        path = workshop.ssd("s.ssd", workshop.system(components))
        assert len(problems_of(lambda: check(read_system(path)))) == 1

    def test_notes_of_an_fmu(self, workshop: Any, variable: Any) -> None:
        workshop.fmu("rough.fmu", variable("y", "output"), initial={})
        path = workshop.ssd("s.ssd", workshop.system(workshop.component("a", "rough.fmu")))
        assert any(note.startswith("rough.fmu: has no InitialUnknowns") for note in check(read_system(path)).notes)

    def test_the_order_of_components_changes_nothing(self, workshop: Any) -> None:
        names = ["b", "a10", "a9", "c"]

        def run(order: Sequence[str]) -> CheckedSystem:
            components = "".join(workshop.component(name, "unit.fmu", "u:input y:output") for name in order)
            wires = [workshop.connection(f"{a}/y", f"{b}/u") for a, b in zip(names, [*names[1:], "b"], strict=True)]
            return check(read_system(workshop.ssd("s.ssd", workshop.system(components, "".join(wires)))))  # fmt: skip

        first, second = run(names), run(names[::-1])
        assert [i.name for i in first.instances] == [i.name for i in second.instances] == ["a9", "a10", "b", "c"]
        assert [(link.source, link.target) for link in first.links] == [(k.source, k.target) for k in second.links]


class TestInitialization:
    def feedthrough(self, workshop: Any, variable: Any, **options: Any) -> None:
        made = (variable("u"), variable("y", "output"), variable("z", "output"))
        workshop.fmu("through.fmu", *made, outputs={2: "1", 3: ""}, initial={2: "1", 3: ""}, **options)

    def ring(self, workshop: Any, outputs: Sequence[str], fmu: str = "through.fmu") -> Path:
        names = [f"c{i}" for i in range(len(outputs))]
        components = "".join(workshop.component(name, fmu, "u:input y:output z:output") for name in names)
        ends = zip(names, outputs, [*names[1:], names[0]], strict=True)
        path: Path = workshop.ssd(
            "ring.ssd",
            workshop.system(components, "".join(workshop.connection(f"{a}/{o}", f"{b}/u") for a, o, b in ends)),
        )
        return path

    def test_stages_follow_the_feed_through(self, workshop: Any, variable: Any) -> None:
        self.feedthrough(workshop, variable)
        checked = check(read_system(self.ring(workshop, ["z", "y", "y"])))
        stages = [[checked.links[index].source for index in stage.links] for stage in checked.init_order]
        assert stages == [[("c0", "z")], [("c1", "y")], [("c2", "y")]]

    def test_a_loop_is_a_stage_of_its_own(self, workshop: Any, variable: Any) -> None:
        self.feedthrough(workshop, variable)
        checked = check(read_system(self.ring(workshop, ["y", "y", "y"])))
        (stage,) = checked.init_order
        assert (sorted(stage.links), stage.loop) == ([0, 1, 2], True)
        assert not [note for note in checked.notes if "does not say" in note]

    def test_what_leads_into_a_loop_comes_before_it_and_what_leaves_it_behind(
        self, workshop: Any, variable: Any
    ) -> None:
        made = (variable("u"), variable("v"), variable("y", "output"))
        workshop.fmu("sum.fmu", *made, outputs={3: "1 2"}, initial={3: "1 2"})
        parts = "".join(workshop.component(name, "sum.fmu", "u:input v:input y:output") for name in "abcde")
        wires = ("a/y b/u", "b/y c/u", "c/y b/v", "c/y d/u", "d/y e/u")
        connections = "".join(workshop.connection(*wire.split()) for wire in wires)
        checked = check(read_system(workshop.ssd("s.ssd", workshop.system(parts, connections))))
        found = [
            ([(checked.links[i].source[0], checked.links[i].target[0]) for i in stage.links], stage.loop)
            for stage in checked.init_order
        ]
        expected = [
            ([("a", "b")], False),
            ([("c", "b"), ("b", "c")], True),
            ([("c", "d")], False),
            ([("d", "e")], False),
        ]
        assert found == expected

    def test_a_loop_through_an_fmu_that_does_not_say(self, workshop: Any, variable: Any) -> None:
        made = (variable("u"), variable("y", "output"), variable("z", "output"))
        workshop.fmu("silent.fmu", *made, initial={})
        checked = check(read_system(self.ring(workshop, ["y", "y"], "silent.fmu")))
        assert [(len(stage.links), stage.loop) for stage in checked.init_order] == [(2, True)]
        assert any(note.startswith("c0, c1: the FMU does not say") for note in checked.notes)

    def test_an_exact_output_depends_on_nothing(self, workshop: Any, variable: Any) -> None:
        made = (variable("u"), variable("y", "output", initial="exact", start="1"), variable("z", "output"))
        workshop.fmu("exact.fmu", *made, initial={3: "1"})
        checked = check(read_system(self.ring(workshop, ["y", "z"], "exact.fmu")))
        stages = [[checked.links[index].source for index in stage.links] for stage in checked.init_order]
        assert stages == [[("c0", "y")], [("c1", "z")]]

    def test_one_that_says_all_inputs(self, workshop: Any, variable: Any) -> None:
        made = (variable("u"), variable("y", "output"), variable("z", "output"))
        workshop.fmu("all.fmu", *made, initial={2: None, 3: ""})
        checked = check(read_system(self.ring(workshop, ["y", "y"], "all.fmu")))
        assert [stage.loop for stage in checked.init_order] == [True]
        assert not [note for note in checked.notes if "does not say" in note]

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(data=st.data())
    def test_against_brute_force(self, workshop: Any, variable: Any, data: st.DataObject) -> None:
        """Random dependencies and links: a value is never used before it is final; loops are exactly those that are."""
        inputs, count = 3, data.draw(st.integers(1, 5))
        masks = data.draw(st.lists(st.integers(0, 7), min_size=3, max_size=3))
        needs = {f"y{o}": [i for i in range(inputs) if mask >> i & 1] for o, mask in enumerate(masks)}
        made = [variable(f"u{i}") for i in range(inputs)] + [variable(f"y{o}", "output") for o in range(3)]
        listed = {4 + o: " ".join(str(i + 1) for i in needs[f"y{o}"]) for o in range(3)}
        fmu = describe(workshop.fmu("random.fmu", *made, outputs=listed, initial=listed))
        ends = st.tuples(st.integers(0, count - 1), st.integers(0, 2))
        wires = data.draw(st.dictionaries(ends, ends, max_size=9))  # target input -> source output
        links = [((f"c{s}", f"y{o}"), (f"c{t}", f"u{i}")) for (t, i), (s, o) in wires.items()]
        stages = exchange_order(links, {f"c{n}": fmu for n in range(count)}, [])

        def reaches(start: int, goal: int, seen: set[int]) -> bool:
            """Whether the value of link `start` is used to compute that of `goal`."""
            instance, name = links[start][1]
            after = [
                n for n, (source, _) in enumerate(links) if source[0] == instance and int(name[1:]) in needs[source[1]]
            ]
            return any(n == goal or (n not in seen and not seen.add(n) and reaches(n, goal, seen)) for n in after)  # type: ignore[func-returns-value]

        assert sorted(n for stage in stages for n in stage.links) == list(range(len(links)))
        stage_of = {n: k for k, stage in enumerate(stages) for n in stage.links}
        for a in range(len(links)):
            # links of one source lead around a loop together
            cyclic = any(
                reaches(a, b, set()) and reaches(b, a, set()) and stage_of[a] == stage_of[b] for b in range(len(links))
            )
            assert stages[stage_of[a]].loop == cyclic
            for b in range(len(links)):
                if reaches(a, b, set()):
                    together = reaches(b, a, set())
                    assert stage_of[a] == stage_of[b] if together else stage_of[a] < stage_of[b]
        assert all(stage.links for stage in stages)


class TestFlatteningAgainstANaiveOne:
    @settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(data=st.data())
    def test_random_trees(self, workshop: Any, variable: Any, data: st.DataObject) -> None:
        """Wires laid by hand through a random tree of systems, each step with its own transformation."""
        parents = [None, *(data.draw(st.integers(0, i - 1)) for i in range(1, data.draw(st.integers(2, 7))))]
        homes = data.draw(st.lists(st.integers(0, len(parents) - 1), min_size=2, max_size=5))
        numbers = st.integers(-4, 4).map(float)

        def path(system: int | None) -> list[int]:
            return [] if system is None else [*path(parents[system]), system]

        connectors: list[list[str]] = [[] for _ in parents]
        connections: list[list[str]] = [[] for _ in parents]

        def join(where: int, source: str, target: str) -> tuple[float, float]:
            factor, offset = data.draw(numbers), data.draw(numbers)
            ends = [source, target]
            if data.draw(st.booleans()):
                ends.reverse()
            inner = f'<ssc:LinearTransformation factor="{factor}" offset="{offset}"/>'
            connections[where].append(workshop.connection(*ends, inner))
            return factor, offset

        expected = {}
        for target, home in enumerate(homes):
            source = data.draw(st.integers(0, len(homes) - 1))
            up, down = path(homes[source]), path(home)
            shared = sum(1 for a, b in zip(up, down, strict=False) if a == b)
            value, at = 1.0, f"leaf{source}/y"
            for system in reversed(up[shared:]):
                connectors[system].append(f"out{target}:output")
                factor, offset = join(system, at, f"out{target}")
                value, at = factor * value + offset, f"s{system}/out{target}"
            for above, system in zip(down[shared - 1 :], down[shared:], strict=False):
                connectors[system].append(f"in{target}:input")
                factor, offset = join(above, at, f"s{system}/in{target}")
                value, at = factor * value + offset, f"in{target}"
            factor, offset = join(home, at, f"leaf{target}/u")
            names = [".".join([*(f"s{s}" for s in path(homes[leaf])[1:]), f"leaf{leaf}"]) for leaf in (source, target)]
            expected[names[1]] = (names[0], factor * value + offset)

        def written(system: int) -> str:
            inside = [written(child) for child in range(len(parents)) if parents[child] == system]
            inside += [
                workshop.component(f"leaf{leaf}", "plain.fmu", "u:input y:output")
                for leaf, home in enumerate(homes)
                if home == system
            ]
            made: str = workshop.system(
                "".join(inside),
                "".join(connections[system]),
                name=f"s{system}",
                connectors=" ".join(connectors[system]),
            )
            return made

        workshop.fmu("plain.fmu", variable("u"), variable("y", "output"))
        checked = check(read_system(workshop.ssd("tree.ssd", written(0))))
        found = {link.target[0]: (link.source[0], link.factor + link.offset) for link in checked.links}
        assert found == expected


WORDS = st.sampled_from(
    [
        "one",
        "two",
        "sub",
        "u",
        "y",
        "t",
        "in",
        "out",
        "p",
        "n",
        "e",
        "ye",
        "input",
        "output",
        "parameter",
        "m",
        "K",
        "s",
        "1",
    ]
)


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mixed_up_systems_give_our_error_or_a_system(workshop: Any, data: st.DataObject) -> None:
    """Attributes exchanged at random: names, kinds, units and ends still legal as XML, but no longer a system."""
    unit = workshop.component(
        "one", "unit.fmu", "u:input:Real:m y:output t:output n:input p:parameter e:input ye:output"
    )
    inner = workshop.connection("in", "one/u") + workshop.connection("one/y", "out", "<ssc:LinearTransformation/>")
    sub = workshop.system(unit, inner, name="sub", connectors="in:input:Real:m out:output")
    wires = workshop.connection("sub/out", "two/u") + workshop.connection("sub/in", "two/y")
    wires += workshop.connection("out", "two/t") + workshop.connection("two/ye", "two/e")
    sets = workshop.bindings({"sub.in": 1.0, "two.p": 2.0, "sub.one.n": 3}, unit=None)
    top = workshop.system(sub + unit.replace('"one"', '"two"'), wires, bindings=sets, connectors="out:output")
    path = workshop.ssd("mixed.ssd", top, workshop.units("m", "K", "s"))
    root = etree.fromstring(path.read_bytes())
    elements = [element for element in root.iter("*") if element.attrib]
    for _ in range(data.draw(st.integers(1, 6))):
        element = elements[data.draw(st.integers(0, len(elements) - 1))]
        name = data.draw(st.sampled_from(sorted(map(str, element.attrib))))
        if name not in ("source", "version"):
            element.set(name, data.draw(WORDS))
    path.write_bytes(etree.tostring(root))
    try:
        checked = check(read_system(path), {"two.p": "1"} if data.draw(st.booleans()) else None)
    except SystemDescriptionError as error:
        assert error.problems
        return
    names = {instance.name: instance.fmu.variables for instance in checked.instances}
    assert sorted(n for stage in checked.init_order for n in stage.links) == list(range(len(checked.links)))
    for link in checked.links:
        assert names[link.source[0]][link.source[1]].causality in ("output", "calculatedParameter")
        assert names[link.target[0]][link.target[1]].causality in ("input", "parameter")
    assert len({link.target for link in checked.links}) == len(checked.links)


def test_natural_order() -> None:
    names = ["drone10", "drone2", "drone1.b", "drone1.a10", "drone1.a9", "drone", "drone01"]
    assert sorted(names, key=natural) == [
        "drone",
        "drone01",
        "drone1.a9",
        "drone1.a10",
        "drone1.b",
        "drone2",
        "drone10",
    ]

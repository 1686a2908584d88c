"""What is read from an FMU's description, what is fatal, and what is only a note. Oracle: FMPy and pythonfmu."""

from __future__ import annotations

import hashlib
import re
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.files import archive
from cosim_master.fmi.description.read import FmuDescription, describe, extract, mentions, platform

ENUMERATION = (
    '<SimpleType name="Mode"><Enumeration><Item name="off" value="0"/><Item name="on" value="5"/></Enumeration>'
    '</SimpleType><SimpleType name="Height"><Real unit="m" min="-1" max="9"/></SimpleType>'
    '<SimpleType name="Difference"><Real unit="degC" relativeQuantity="true"/></SimpleType>'
)


def packet_port(variable: str, size: int) -> str:
    """What replaces <ModelVariables> to put a packet port before it."""
    port = f'<PacketPort variable="{variable}" maxSize="{size}"/>'
    return f'<VendorAnnotations><Tool name="uav-cosim">{port}</Tool></VendorAnnotations><ModelVariables>'


@pytest.fixture
def complete(workshop: Any, variable: Any) -> FmuDescription:
    path = workshop.fmu(
        "complete.fmu",
        variable("u", start="1.5", unit="degC", min="-3", max="1e3"),
        variable("n", kind="Integer", start="-7", min="-8", max="8"),
        variable("on", kind="Boolean", start="true"),
        variable("text", kind="String", start="a&b"),
        variable("mode", kind="Enumeration", start="5", declaredType="Mode"),
        variable("p", "parameter", start="2"),
        variable("q", "parameter", start="2", variability="tunable"),
        variable("c", "calculatedParameter"),
        variable("y", "output", unit="furlong"),
        variable("height", "output", declaredType="Height"),
        variable("x0", "local", initial="exact", start="4"),
        variable("k", "local", variability="constant", start="4"),
        variable("rise", declaredType="Difference"),
        variable("rx", kind="String"),
        types=ENUMERATION,
        units={"furlong": "", "degC": 'K="1" offset="273.15"', "m": 'm="1"'},
        outputs={9: "1 6", 10: None},
        initial={8: "6", 9: None, 10: ""},
        step="0.0025",
        flags='canGetAndSetFMUstate="true" canHandleVariableCommunicationStepSize="1" maxOutputDerivativeOrder="2"',
        extra='<VendorAnnotations><Tool name="other"><PacketPort/></Tool><Tool name="uav-cosim">'
        '<PacketPort variable="rx" maxSize="2048"/></Tool></VendorAnnotations>',
    )
    return describe(path)


class TestWhatIsRead:
    def test_the_head(self, complete: FmuDescription) -> None:
        assert (complete.fmi_version, complete.model_name, complete.model_identifier) == ("2.0", "Unit", "Unit")
        assert complete.guid == "{0}"
        assert complete.step_size == 0.0025
        assert complete.digest == hashlib.sha256(complete.path.read_bytes()).hexdigest()
        assert complete.library.startswith(f"binaries/{platform()}/Unit.")
        assert complete.notes == ()

    def test_capabilities(self, complete: FmuDescription) -> None:
        flags = complete.capabilities
        assert flags.canGetAndSetFMUstate and flags.canHandleVariableCommunicationStepSize
        assert not flags.canSerializeFMUstate and not flags.canBeInstantiatedOnlyOncePerProcess
        assert flags.maxOutputDerivativeOrder == 2

    def test_types_and_values(self, complete: FmuDescription) -> None:
        variables = complete.variables
        assert [(v.type, v.start) for v in list(variables.values())[:5]] == [
            ("Real", 1.5),
            ("Integer", -7),
            ("Boolean", True),
            ("String", "a&b"),
            ("Enumeration", 5),
        ]
        assert (variables["u"].minimum, variables["u"].maximum) == (-3.0, 1000.0)
        assert (variables["n"].minimum, variables["n"].maximum) == (-8, 8)
        assert variables["mode"].items == {"off": 0, "on": 5}
        assert (variables["height"].minimum, variables["height"].maximum) == (-1.0, 9.0)

    def test_units(self, complete: FmuDescription) -> None:
        u, rise, y, height = (complete.variables[name].unit for name in ("u", "rise", "y", "height"))
        assert u is not None and u.base is not None and u.base.offset == 273.15
        assert rise is not None and rise.base is not None and rise.base.offset == 0.0
        assert y is not None and (y.name, y.base) == ("furlong", None)
        assert height is not None and height.name == "m"

    def test_what_may_be_set(self, complete: FmuDescription) -> None:
        settable = {name for name, item in complete.variables.items() if item.settable}
        assert settable == {"u", "n", "on", "text", "mode", "p", "q", "x0", "rise", "rx"}

    def test_dependencies(self, complete: FmuDescription) -> None:
        assert complete.outputs == {"y": ("u", "p"), "height": None}
        assert complete.initial_unknowns == {"c": ("p",), "y": None, "height": ()}

    def test_packet_ports(self, complete: FmuDescription) -> None:
        assert {n: v.packet_capacity for n, v in complete.variables.items() if v.packet_capacity} == {"rx": 2048}

    def test_several_packet_ports_in_one_element_as_the_schema_wants_it(self, workshop: Any, variable: Any) -> None:
        ports = "".join(f'<PacketPort variable="{name}" maxSize="{size}"/>' for name, size in (("rx", 8), ("tx", 9)))
        extra = (
            f'<VendorAnnotations><Tool name="uav-cosim"><PacketPorts>{ports}</PacketPorts></Tool></VendorAnnotations>'
        )
        read = describe(
            workshop.fmu("a.fmu", variable("rx", kind="String"), variable("tx", "output", "String"), extra=extra)
        )
        assert [item.packet_capacity for item in read.variables.values()] == [8, 9]
        assert read.notes == ()

    def test_as_fmpy_reads_it(self, complete: FmuDescription) -> None:
        theirs = fmpy.read_model_description(str(complete.path))
        for read in theirs.modelVariables:
            ours = complete.variables[read.name]
            assert (ours.value_reference, ours.type, ours.causality) == (read.valueReference, read.type, read.causality)
            assert ours.variability == read.variability
            assert ours.initial == (None if read.causality == "input" else read.initial)


class TestFatal:
    def problems(self, path: Path) -> str:
        with pytest.raises(SystemDescriptionError) as caught:
            describe(path)
        return str(caught.value)

    def test_no_file(self, tmp_path: Path) -> None:
        assert self.problems(tmp_path / "gone.fmu") == f"{tmp_path}/gone.fmu: no such file"

    def test_not_a_zip(self, tmp_path: Path) -> None:
        (tmp_path / "a.fmu").write_text("text")
        assert "a.fmu: not a readable ZIP archive" in self.problems(tmp_path / "a.fmu")

    def test_no_description(self, workshop: Any) -> None:
        assert "is not an FMU: it has no modelDescription.xml" in self.problems(workshop.pack("a.fmu", None))

    def test_malformed_description(self, workshop: Any) -> None:
        text = self.problems(workshop.pack("a.fmu", "<a>\n</b>"))
        assert "a.fmu/modelDescription.xml:2: not well-formed XML" in text

    def test_another_root(self, workshop: Any) -> None:
        assert "it must be <fmiModelDescription>" in self.problems(workshop.pack("a.fmu", "<a/>"))

    @pytest.mark.parametrize(
        ("version", "message"),
        [
            ("1.0", "is an FMU of FMI 1.0 for Model Exchange; of FMI 1.0 only co-simulation is supported"),
            ("1.5", 'FMI "1.5" is not supported; valid: fmiVersion="1.0", "2.0" and "3.0"'),
            ("3.1", 'FMI "3.1" is not supported; valid: fmiVersion="1.0", "2.0" and "3.0"'),
            ("3.0-beta.3", 'FMI "3.0-beta.3" is not supported; valid: fmiVersion="1.0", "2.0" and "3.0"'),
            ("3.0", "needs the attribute instantiationToken"),
            ("3.0.2", "needs the attribute instantiationToken"),
            ("", 'FMI "" is not supported'),
        ],
    )
    def test_other_versions(self, workshop: Any, variable: Any, version: str, message: str) -> None:
        assert message in self.problems(workshop.fmu("a.fmu", variable("u"), version=version))

    def test_no_interface(self, workshop: Any, variable: Any) -> None:
        text = self.problems(workshop.fmu("a.fmu", variable("u"), interface="Annotations"))
        assert "has no interface; valid: CoSimulation and ModelExchange" in text

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ('guid="{0}"', "", "needs the attribute guid"),
            ('modelIdentifier="Unit"', "", "needs the attribute modelIdentifier"),
            ('modelIdentifier="Unit"', 'modelIdentifier="../Unit"', "needs the attribute modelIdentifier, a C ident"),
            ("ModelVariables", "Variables", "needs <ModelVariables>"),
            ('name="v"', 'name="u"', 'variable "u" is declared twice'),
            ('start="0"', 'start="zero"', 'start "zero" of "u" is not of type Real'),
            ('start="0"', 'start="NaN"', 'start "NaN" of "u" is not of type Real'),
            ('start="0"', 'start="0" min="low"', 'min "low" of "u" is not of type Real'),
            ('valueReference="0"', 'valueReference="x"', "cannot be read: ValueError"),
            ('stepSize="1"', 'stepSize="one"', 'stepSize "one" of "the FMU" is not of type Real'),
            ('<Unknown index="3" dependencies=""/>', '<Unknown index="0"/>', '<Unknown> refers to variable "0"; valid'),
            ('index="3" dependencies=""', 'index="3" dependencies="1 4"', 'refers to variable "4"; valid: 1 to 3'),
            ('index="3" dependencies=""', 'dependencies="1"', 'refers to variable ""'),
            ('<BaseUnit m="1"/>', '<BaseUnit m="1" factor="0"/>', 'unit "m": factor must be finite and not 0'),
            ("<ModelVariables>", packet_port("w", 9), 'PacketPort: there is no variable "w"'),
            ("<ModelVariables>", packet_port("u", 9), 'PacketPort "u" is of type Real; in FMI 2 it must be a String'),
            ("<ModelVariables>", packet_port("u", 0), "PacketPort needs the attributes variable and maxSize"),
            ("<ModelVariables>", "<!DOCTYPE x>", "not well-formed"),
        ],
    )  # fmt: skip
    def test_what_cannot_be_run(self, workshop: Any, variable: Any, old: str, new: str, message: str) -> None:
        text = workshop.description([variable("u"), variable("v"), variable("y", "output")], step="1")
        assert old in text
        assert message in self.problems(workshop.pack("a.fmu", text.replace(old, new)))

    @pytest.mark.parametrize("kinds", ["", ' dependenciesKind="dependent fixed"'])
    def test_dependencies_with_kinds_and_without(self, workshop: Any, variable: Any, kinds: str) -> None:
        """FMPy reads the former ones; spaces around are allowed."""
        text = workshop.description([variable("u"), variable("v"), variable("y", "output"), variable("z", "output")])
        assert text.count('<Unknown index="3" dependencies=""/>') == 2  # among outputs and among initial unknowns
        text = text.replace(
            '<Unknown index="3" dependencies=""/>', f'<Unknown index="3" dependencies=" 2  1 "{kinds}/>'
        )
        read = describe(workshop.pack("a.fmu", text))
        assert read.outputs == {"y": ("v", "u"), "z": ()}
        assert read.initial_unknowns == {"y": ("v", "u"), "z": ()}
        assert not read.notes

    def test_an_item_that_is_no_integer(self, workshop: Any, variable: Any) -> None:
        mode = variable("mode", kind="Enumeration", declaredType="Mode")
        text = workshop.description([mode], types=ENUMERATION.replace('value="5"', 'value="five"'))
        assert 'an item of its type "Mode" has the value "five"' in self.problems(workshop.pack("a.fmu", text))

    def test_no_library_for_this_platform(self, workshop: Any, variable: Any) -> None:
        path = workshop.pack("a.fmu", workshop.description([variable("u")]), library=None)
        assert f"has no library for this platform (binaries/{platform()}/Unit." in self.problems(path)
        assert "it has no binaries" in self.problems(path)
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("binaries/vax64/Unit.so", b"")
        assert "it has binaries for vax64" in self.problems(path)

    def test_all_problems_at_once(self, workshop: Any, variable: Any) -> None:
        path = workshop.fmu("a.fmu", variable("u", start="x"), variable("v", kind="Integer", start="1.5"))
        assert len(self.problems(path).splitlines()) == 2

    @settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(data=st.data())
    def test_nothing_but_our_error_is_raised(self, workshop: Any, variable: Any, data: st.DataObject) -> None:
        kinds = ("Real", "Integer", "Boolean", "Enumeration")
        made = [variable(kind, kind=kind, declaredType="Mode" if kind == "Enumeration" else None) for kind in kinds]
        text = bytearray(workshop.description([*made, variable("y", "output")], types=ENUMERATION).encode())
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(0, len(text)))
            text[at : at + data.draw(st.integers(0, 10))] = data.draw(st.binary(max_size=4))
        try:
            describe(workshop.pack("a.fmu", bytes(text)))
        except SystemDescriptionError as error:
            assert error.problems


class TestNotes:
    def test_an_empty_guid(self, workshop: Any, variable: Any) -> None:
        path = workshop.pack("a.fmu", workshop.description([variable("u")]).replace('guid="{0}"', 'guid=""'))
        fmu = describe(path)
        assert fmu.guid == ""
        assert 'its guid is "": whether library and description belong together is not known' in fmu.notes

    def test_a_library_of_another_name(self, workshop: Any, variable: Any) -> None:
        read = describe(workshop.pack("a.fmu", workshop.description([variable("u")]), library="Other"))
        assert Path(read.library).stem == "Other"
        assert any("by its modelIdentifier it should be" in note for note in read.notes)

    def test_no_initial_unknowns(self, workshop: Any, variable: Any) -> None:
        read = describe(workshop.fmu("a.fmu", variable("y", "output"), initial={}))
        assert any("has no InitialUnknowns" in note for note in read.notes)

    def test_a_missing_start_value(self, workshop: Any, variable: Any) -> None:
        read = describe(workshop.fmu("a.fmu", variable("u", start=None)))
        assert any('Variable "u"' in note and "no start value" in note for note in read.notes)

    def test_a_step_size_of_zero(self, workshop: Any, variable: Any) -> None:
        read = describe(workshop.fmu("a.fmu", variable("u"), step="0"))
        assert read.step_size is None
        assert any("stepSize of 0 s is not used" in note for note in read.notes)

    def test_variability_that_was_left_out(self, workshop: Any, variable: Any) -> None:
        parameter = variable("p", "parameter", kind="String", variability=None)
        read = describe(workshop.fmu("a.fmu", parameter, variable("n", kind="Integer", variability=None)))
        assert (read.variables["p"].variability, read.variables["n"].variability) == ("fixed", "discrete")
        assert read.notes == (
            'variables without the variability they need, taken as fixed or discrete: "p" and 1 more',
        )

    def test_many_findings_are_counted(self, workshop: Any, variable: Any) -> None:
        read = describe(workshop.fmu("a.fmu", *(variable(f"u{i}", start=None) for i in range(9))))
        assert read.notes[-1] == "and 4 more findings of this kind"

    def test_an_fmu_that_pythonfmu_built(self, tmp_path: Path) -> None:
        from pythonfmu.builder import FmuBuilder

        (tmp_path / "plain.py").write_text(
            "from pythonfmu import Fmi2Slave, Fmi2Causality, Real, Integer, String\n\n"
            "class Plain(Fmi2Slave):\n"
            "    def __init__(self, **kwargs):\n"
            "        super().__init__(**kwargs)\n"
            "        self.u, self.y, self.n, self.s = 0.0, 0.0, 0, ''\n"
            "        self.register_variable(Real('u', causality=Fmi2Causality.input))\n"
            "        self.register_variable(Real('y', causality=Fmi2Causality.output))\n"
            "        self.register_variable(Integer('n', causality=Fmi2Causality.parameter))\n"
            "        self.register_variable(String('s', causality=Fmi2Causality.output))\n\n"
            "    def do_step(self, t, h):\n"
            "        return True\n"
        )
        read = describe(FmuBuilder.build_FMU(str(tmp_path / "plain.py"), dest=str(tmp_path)))
        assert set(read.variables) >= {"u", "y", "n", "s"}
        assert read.outputs["y"] is None and "y" not in read.initial_unknowns
        assert read.capabilities.needsExecutionTool
        assert any("InitialUnknowns" in note for note in read.notes)


class TestCopies:
    def test_a_copy_is_not_read_again(
        self, complete: FmuDescription, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        copy = tmp_path / "copies" / "copy.fmu"
        copy.parent.mkdir()
        shutil.copyfile(complete.path, copy)
        read_anew = describe(copy, implementation="CoSimulation")
        monkeypatch.setattr("cosim_master.fmi.description.read._described", None)
        assert describe(copy) == read_anew == replace(complete, path=copy)
        assert mentions(copy, "height")
        monkeypatch.setattr(archive, "read_member", None)
        assert mentions(complete.path, "height")

    def test_what_has_changed_is_read_again(self, complete: FmuDescription) -> None:
        assert not mentions(complete.path, "depth")
        with zipfile.ZipFile(complete.path) as packed:
            text = packed.read("modelDescription.xml")
        with zipfile.ZipFile(complete.path, "w") as packed:
            packed.writestr(complete.library, b"")
            packed.writestr("modelDescription.xml", text.replace(b'"height"', b'"depth"'))
        assert mentions(complete.path, "depth")
        assert "depth" in describe(complete.path).variables


class TestExtract:
    def test_it_unpacks_and_finds_the_library(self, complete: FmuDescription, tmp_path: Path) -> None:
        library = extract(complete, tmp_path / "unpacked")
        assert library == tmp_path / "unpacked" / complete.library and library.is_file()
        assert (tmp_path / "unpacked/resources/note.txt").read_text() == "complete.fmu"

    @pytest.mark.parametrize("name", ["a b", "a%20b", "ä", "a#b", "a?b", "a+b"])
    def test_paths_that_an_fmu_would_misread(self, complete: FmuDescription, tmp_path: Path, name: str) -> None:
        with pytest.raises(ValueError, match=re.escape(name)):
            extract(complete, tmp_path / name)

    def test_a_file_that_has_changed(self, complete: FmuDescription, tmp_path: Path) -> None:
        with zipfile.ZipFile(complete.path, "a") as archive:
            archive.writestr("more", b"")
        with pytest.raises(SystemDescriptionError, match="the file has changed since it was checked"):
            extract(complete, tmp_path / "unpacked")

"""The tables of limitations are what is generated, every entry of them is true, and every one is used by the code."""

from __future__ import annotations

import ast
import json
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cosim_master
from cosim_master.diagnostics import limitations
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.diagnostics.limitations import LIMITATIONS, Limitation, table
from cosim_master.execution.options import RunOptions
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.execution.simulate import simulate
from cosim_master.files import archive
from cosim_master.fmi.description import read_fmi3 as fmu3
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.network.gateways.gateways import gateways_of
from cosim_master.system.authoring.convert import convert
from cosim_master.system.authoring.save import save
from cosim_master.system.authoring.swap import swap
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.others import into_cps as multimodel
from cosim_master.system.reading.others.into_cps import read_multimodel
from cosim_master.system.reading.read import SSD_TYPE, read_system
from cosim_master.system.reading.ssp import references
from cosim_master.system.settings.network import network_of
from cosim_master.system.structure import MAX_DEPTH, Component
from tests.master.fmus import clocked as clocks
from tests.master.fmus import strict as strict2
from tests.master.fmus import strict3
from tests.master.fmus.clocked import clocked
from tests.master.fmus.probe import slave
from tests.master.fmus.strict3 import ABLE

ROOT = Path(__file__).parents[3]
NAMES = {one: name for name, one in vars(limitations).items() if isinstance(one, Limitation)}
Said = tuple[str, list[str]]
"""An outcome of `Limitation`, and what was said."""
Provoked = Mapping[str, Callable[[], Said | Path]]
"""For each limitation, by its name in the module: does it, or writes a system that has it."""
pytestmark = pytest.mark.usefixtures("own_cache")


def pattern(one: Limitation) -> str:
    """The words of a limitation with anything in their gaps."""
    return ".*".join(re.escape(part) for part in one.words.split("{}"))


def said(given: Said | Path) -> Said:
    """What reading and checking a system says."""
    if isinstance(given, tuple):
        return given
    try:
        with read_system(given) as structure:
            checked = check(structure)
            return "note", [*checked.notes, *network_of(checked).notes]
    except SystemDescriptionError as error:
        return "error", [str(problem) for problem in error.problems]


def ran(path: Path, **options: Any) -> Said:
    """What a run says: an error before it begins, a failure, or else its notes."""
    try:
        result = simulate(path, RunOptions(**options))
    except SystemDescriptionError as error:
        return "error", [str(problem) for problem in error.problems]
    if result.outcome == "failed":
        return "failure", str(result.error).splitlines()
    assert result.outcome == "done", result.error
    return "note", list(result.notes)


def unnoticed(given: Said) -> Said:
    """A run that goes well, in which nothing is said of it."""
    outcome, lines = given
    assert outcome == "note"
    return "silent", lines


@pytest.fixture
def of_ssp(workshop: Any, variable: Any, monkeypatch: pytest.MonkeyPatch) -> Provoked:
    workshop.fmu(
        "unit.fmu",
        variable("u", unit="m"),
        variable("w"),
        variable("n", kind="Integer"),
        variable("y", "output", unit="m"),
        variable("m", "output", kind="Integer", initial="exact", start="0"),
        variable("x", "local"),
        step="0.5",
    )
    unit, component, system, wire = "unit.fmu", workshop.component, workshop.system, workshop.connection

    def ssd(elements: str = "", wires: str = "", **options: Any) -> Path:
        made: Path = workshop.ssd("s.ssd", system(elements, wires, **options), version="2.0")
        return made

    def nested(depth: int) -> str:
        made: str = system(name="s0")
        for i in range(1, depth):
            made = system(made, name=f"s{i}")
        return made

    def referred(depth: int) -> str:
        """As deep, but each system is a component with the one before as its source."""
        made: str = system(name="s0").replace("<ssd:System ", '<ssd:System id="s0" ')
        for i in range(1, depth):
            one = system(component("c", f"#s{i - 1}", type=SSD_TYPE), name=f"s{i}")
            made += one.replace("<ssd:System ", f'<ssd:System id="s{i}" ')
        return made

    def deep() -> Said:
        """Written out or referred to, 60 are possible and 61 are not; the root system is one of them."""
        for make in (nested, referred):
            assert said(ssd(make(MAX_DEPTH - 1)))[0] == "note"
            last = said(ssd(make(MAX_DEPTH)))
            assert last[0] == "error"
        return last

    def multiplied() -> Path:
        made = system(name="s0").replace("<ssd:System ", '<ssd:System id="s0" ')
        for i in range(1, 8):
            parts = "".join(component(f"c{k}", f"#s{i - 1}", type=SSD_TYPE) for k in range(10))
            made += system(parts, name=f"s{i}").replace("<ssd:System ", f'<ssd:System id="s{i}" ')
        return ssd(made)

    def array(dimension: str) -> Path:
        text = ssd(system(name="s", connectors="in:input")).read_text()
        text = text.replace('name="in" kind="input"></', f'name="in" kind="input">{dimension}</')
        (workshop.root / "s.ssd").write_text(text)
        made: Path = workshop.root / "s.ssd"
        return made

    def swollen() -> Path:
        monkeypatch.setattr(archive, "MAX_BYTES", 1000)
        made: Path = workshop.ssp("s.ssp", {"SystemStructure.ssd": ssd(), "fill": bytes(2000)})
        return made

    def packed(change: Callable[[zipfile.ZipInfo], None], method: int = zipfile.ZIP_STORED) -> Path:
        """An archive with an entry that is changed."""
        path: Path = workshop.root / "s.ssp"
        entry = zipfile.ZipInfo("x")
        entry.compress_type = method
        change(entry)
        with zipfile.ZipFile(path, "w") as made:
            made.writestr("SystemStructure.ssd", ssd().read_bytes())
            made.writestr(entry, b"x")
        return path

    def encrypted() -> Path:
        path = packed(lambda _: None)
        data = bytearray(path.read_bytes())
        data[data.rindex(b"PK\x01\x02") + 8] |= 1
        path.write_bytes(data)
        return path

    def limited(module: Any, name: str, path: Path, most: int) -> Path:
        monkeypatch.setattr(module, name, most)
        return path

    def changed_inside() -> Said:
        workshop.ssd("part.ssd", system(component("x", unit), name="inside"))
        with read_system(ssd(component("part", "part.ssd", type=SSD_TYPE))) as structure:
            (part,) = structure.system.elements
            assert isinstance(part, Component) and part.content is not None
            emptied = replace(part, content=replace(part.content, elements=()))
            with pytest.raises(SystemDescriptionError) as caught:
                save(structure, replace(structure.system, elements=(emptied,)))
        return "error", [str(caught.value)]

    def in_utf_16() -> Said:
        path = ssd(component("a", unit))
        path.write_bytes(path.read_text().replace("UTF-8", "UTF-16").encode("utf-16"))
        check(read_system(path))
        with pytest.raises(SystemDescriptionError) as caught:
            swap(path, "a", workshop.root / unit)
        return "error", [str(caught.value)]

    def signals(bindings: str = "", kind: str = "Real") -> str:
        inner = '<ssb:SignalDictionary xmlns:ssb="http://ssp-standard.org/SSP1/SystemStructureSignalDictionary" '
        entry = f'<ssb:DictionaryEntry name="t"><ssc:{kind}/></ssb:DictionaryEntry>'
        inner += f'version="2.0">{entry}</ssb:SignalDictionary>'
        reference = '<ssd:SignalDictionaryReference name="tap" dictionary="bus">' + workshop.connectors("t:output")
        elements = f"<ssd:Elements>{reference}</ssd:SignalDictionaryReference></ssd:Elements>"
        dictionaries = f'<ssd:SignalDictionary name="bus">{inner}</ssd:SignalDictionary>'
        made = f"{elements}<ssd:SignalDictionaries>{dictionaries}</ssd:SignalDictionaries>"
        return f'<ssd:System name="root">{bindings}{made}</ssd:System>'

    mapping = (
        '<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="2"/></ssc:IntegerMappingTransformation>'
    )
    meta = '<ssc:MetaData kind="general" type="text/plain" source="a.txt"/>'
    return {
        "MODELICA": lambda: ssd(component("a", unit, type="text/x-modelica; path=A")),
        "IMPLEMENTATION": lambda: ssd(component("a", unit, implementation="ScheduledExecution")),
        "ABSOLUTE_URI": lambda: ssd(component("a", "file:///unit.fmu")),
        "OTHER_SSD": lambda: ssd(component("a", "other.ssd#id", type=SSD_TYPE)),
        "CLOCK": lambda: workshop.ssd("s.ssd", signals(kind="Clock"), version="2.0"),
        "OPEN_SIZE": lambda: array("<ssc:Dimension/>"),
        "SIZE_CONNECTOR": lambda: ssd(
            system(name="s", connectors="n:parameter:Integer in:input:Real").replace(
                "<ssc:Real/></ssd:Connector>", '<ssc:Real/><ssc:Dimension sizeConnector="n"/></ssd:Connector>'
            )
            + system(name="t", connectors="out:output:Real").replace(
                "<ssc:Real/></ssd:Connector>", '<ssc:Real/><ssc:Dimension size="2"/></ssd:Connector>'
            ),
            wire("t/out", "s/in"),
        ),
        "DIRECTION": lambda: ssd(
            system(name="s", connectors="i:unspecified") + system(name="t", connectors="o:unspecified"),
            wire("s/i", "t/o"),
        ),
        "NARROWING": lambda: ssd(component("a", unit, "n:input y:output"), wire("a/y", "a/n")),
        "MAPPED_BACK": lambda: ssd(
            system(component("a", unit, "m:output"), wire("a/m", "o", mapping), name="s", connectors="o:output"),
            bindings=workshop.bindings({"s.o": 2}),
        ),
        "DEEP": deep,
        "LARGE": multiplied,
        "LONG_ARRAY": lambda: array('<ssc:Dimension size="300"/><ssc:Dimension size="300"/>'),
        "ARCHIVE": swollen,
        "ENTRIES": lambda: limited(archive, "MAX_ENTRIES", packed(lambda _: None), 1),
        "ENCRYPTED": encrypted,
        "COMPRESSION": lambda: packed(lambda _: None, zipfile.ZIP_BZIP2),
        "LINK": lambda: packed(lambda entry: setattr(entry, "external_attr", 0o120777 << 16)),
        "LARGE_DOCUMENT": lambda: limited(references, "_MAX_DOCUMENT_BYTES", ssd(), 10),
        "ENCODING": in_utf_16,
        "INNER_FILE": changed_inside,
        "META_DATA": lambda: ssd(component("a", unit, after=meta)),
        "ANNOTATION": lambda: ssd(component("a", unit, after=workshop.annotation("com.example", "<x/>"))),
        "OMS_MASTER": lambda: ssd(
            component("a", unit, after=workshop.annotation("org.openmodelica", '<VariableStepMaster description="x"/>'))
        ),
        "OMS_IGNORED": lambda: ssd(
            component(
                "a", unit, after=workshop.annotation("org.openmodelica", '<SimulationInformation resultFile="x"/>')
            )
        ),
        "NO_SOURCE": lambda: workshop.ssd("s.ssd", system('<ssd:Component name="a"/>'), version="2.0"),
        "SIGNAL_START": lambda: workshop.ssd("s.ssd", signals(workshop.bindings({"tap.t": 1.0}))),
        "LOCAL": lambda: ssd(
            component("a", unit, "u:input x:local"), wire("a/x", "a/u", suppressUnitConversion="true")
        ),
        "UNIT_GAP": lambda: ssd(component("a", unit, "w:input y:output"), wire("a/y", "a/w")),
        "GEOMETRY": lambda: unnoticed(
            said(ssd(component("a", unit, after='<ssd:ElementGeometry x1="0" y1="0" x2="1" y2="1"/>')))
        ),
    }


@pytest.fixture
def of_fmi(
    workshop: Any, variable: Any, stricts: Any, probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Provoked:
    def alone(fmu: Path) -> Path:
        made: Path = workshop.ssd("alone.ssd", workshop.system(workshop.component("a", fmu.name)))
        return made

    def described(old: str = "", new: str = "") -> Path:
        text = workshop.description([variable("y", "output")], step=0.5).replace(old, new)
        return alone(workshop.pack("one.fmu", text))

    def strict(flags: str = "", **values: Any) -> Said:
        stricts.fmu(flags=flags)
        outcome = ran(stricts.ssd(stricts.component("a", **values)))
        assert stricts.complaints == []
        return outcome

    def large() -> Path:
        made = described()
        monkeypatch.setattr("cosim_master.fmi.description.read._MAX_DESCRIPTION_BYTES", 100)
        return made

    def twice() -> Said:
        probes.fmu(flags='canBeInstantiatedOnlyOncePerProcess="true"')
        return ran(probes.ssd(probes.component("a") + probes.component("b")), isolation=Isolation("none"))

    def python() -> Said:
        source = "from pythonfmu import Fmi2Slave\n\n\nclass One(Fmi2Slave):\n    author = '{}'\n"
        source += "\n    def do_step(self, t, h):\n        return True\n"
        parts = ""
        for name in "ab":
            built = slave(tmp_path / name, "one_slave.py", source.format(name))
            (workshop.root / f"{name}.fmu").write_bytes(built.read_bytes())
            parts += workshop.component(name, f"{name}.fmu")
        return ran(workshop.ssd("python.ssd", workshop.system(parts)), until=1.0, step=0.5)

    def without_binary() -> Path:
        text = workshop.description([variable("y", "output")], step=0.5)
        return alone(workshop.pack("one.fmu", text, library=None))

    def with_library() -> Path:
        file = without_binary().parent / "one.fmu"
        library = '<Library name="own"/>'
        configuration = f'<BuildConfiguration modelIdentifier="{{}}">{library}</BuildConfiguration>'
        with zipfile.ZipFile(file) as one:
            text = one.read("modelDescription.xml").decode()
        identifier = re.search('modelIdentifier="([^"]*)"', text)
        assert identifier is not None
        with zipfile.ZipFile(file, "a") as one:
            one.writestr(
                "sources/buildDescription.xml",
                f'<fmiBuildDescription fmiVersion="3.0">{configuration.format(identifier[1])}</fmiBuildDescription>',
            )
        return alone(file)

    return {
        "FMI_VERSION": lambda: described('fmiVersion="2.0"', 'fmiVersion="1.5"'),
        "EXCHANGE1": lambda: described('fmiVersion="2.0"', 'fmiVersion="1.0"'),
        "NO_LIBRARY": without_binary,
        "SOURCE_LIBRARY": with_library,
        "LARGE_DESCRIPTION": large,
        "ONLY_ONCE": twice,
        "PYTHON_SOURCES": python,
        "DISCARDED": lambda: strict(mode=2, when=1.0, longest=0.1),
        "TOLERANCE": lambda: unnoticed(strict('providesDirectionalDerivative="true" maxOutputDerivativeOrder="2"')),
        "PENDING": lambda: strict('canRunAsynchronuously="true"', mode=4, when=1.0),
    }


@pytest.fixture
def of_fmi3(stricts3: Any, monkeypatch: pytest.MonkeyPatch) -> Provoked:
    def alone(extra: str = "", flags: str = ABLE, **values: Any) -> Path:
        stricts3.fmu(extra=extra, flags=flags)
        made: Path = stricts3.ssd(stricts3.component("a", **values))
        return made

    def packed(text: str) -> Path:
        workshop = stricts3.workshop
        workshop.pack("three.fmu", text)
        made: Path = workshop.ssd("alone.ssd", workshop.system(workshop.component("a", "three.fmu")))
        return made

    def scheduled() -> Path:
        text = strict3.description().replace("<CoSimulation", "<ScheduledExecution")
        return packed(text)

    def exchanged_clock() -> Path:
        text = clocks.description("fixed").replace("<CoSimulation", "<ModelExchange")
        return packed(text)

    def wide() -> Path:
        made, file = alone(), stricts3.workshop.root / "strict3.fmu"
        with zipfile.ZipFile(file) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        members["modelDescription.xml"] = members["modelDescription.xml"].replace(
            b'"high" value="5"', b'"high" value="5000000000"'
        )
        with zipfile.ZipFile(file, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        return made

    def long() -> Path:
        made = alone('<Float64 name="own" valueReference="90" causality="local"/>')  # no FMU that was read before
        monkeypatch.setattr(fmu3, "_MAX_ELEMENTS", 1)
        return made

    def pair(step: float = 0.5, to: str = "go") -> Path:
        """The Clock of one makes that of another tick."""
        clocked(stricts3, "a.fmu", "constant", "fire")
        clocked(stricts3, "b.fmu", "constant", "go", step=step)
        parts = stricts3.component("a", "a.fmu", ports="fire:output")
        parts += stricts3.component("b", "b.fmu", ports=f"{to}:input")
        made: Path = stricts3.ssd(parts, f"a/fire b/{to}")
        return made

    def missed() -> Said:
        clocked(stricts3, "a.fmu", "constant", period=0.3, flags='hasEventMode="true"')
        return ran(stricts3.ssd(stricts3.component("a", "a.fmu")))

    def silent() -> Path:
        clocked(stricts3, "b.fmu", "go")
        made: Path = stricts3.ssd(stricts3.component("b", "b.fmu"))
        return made

    def changed(name: str) -> Said:
        clocked(stricts3, "c.fmu", "constant", "fixed")
        stricts3.fmu(extra=sized)
        return ran(stricts3.ssd(stricts3.component("a", "c.fmu") + stricts3.component("b")), at=[(1.0, name, "3")])

    sized = '<UInt64 name="n" valueReference="90" causality="structuralParameter" variability="tunable" start="2"/>'
    binary = 'causality="input" mimeType="application/x-mavlink"'
    packets = f'<Binary name="rx" valueReference="91" {binary}/>'
    asking = '<Float64 name="v" valueReference="92" causality="input" start="0" intermediateUpdate="true"/>'
    clock = '<Clock name="tick" valueReference="90" causality="input" intervalVariability="triggered"/>'
    clocked_packets = f'{clock}<Binary name="rx" valueReference="91" {binary} maxSize="2048" clocks="90"/>'
    return {
        "CLOCK_END": lambda: pair(to="constant"),
        "SILENT_CLOCK": silent,
        "SCHEDULED_EXECUTION": scheduled,
        "EXCHANGE_CLOCKS": exchanged_clock,
        "TIED_STEPS": lambda: ran(pair(step=0.25)),
        "MISSED_TICK": missed,
        "CLOCKED_CHANGE": lambda: changed("a.u"),
        "STRUCTURAL_CHANGE": lambda: changed("b.n"),
        "CLOCKED_PACKETS": lambda: alone(clocked_packets, flags=f'hasEventMode="true" {ABLE}'),
        "LARGE_VARIABLE": long,
        "WIDE_ITEM": wide,
        "WIDE_INTEGER": lambda: ran(alone(mode=7, when=0.5)),
        "UNSETTLED": lambda: ran(alone(flags=f'hasEventMode="true" {ABLE}', mode=13, when=0.5)),
        "NO_MAX_SIZE": lambda: alone(packets),
        "INTERMEDIATE_UPDATE": lambda: alone(asking, flags=f'providesIntermediateUpdate="true" {ABLE}'),
    }


@pytest.fixture
def of_mavlink(workshop: Any, variable: Any, tmp_path: Path) -> Provoked:
    def radio(*names: str, size: int = 2048, annotation: str = "", instance: str = "a") -> Path:
        ports = "".join(
            f'<PacketPort variable="{name}" mimeType="application/x-mavlink;version=2" maxSize="{size}"/>'
            for name in names
        )
        tool = (
            f'<VendorAnnotations><Tool name="uav-cosim"><PacketPorts>{ports}</PacketPorts></Tool></VendorAnnotations>'
        )
        workshop.fmu("radio.fmu", *(variable(name, kind="String") for name in names), step="0.5", extra=tool)
        inner = f'<network xmlns="https://uav-cosim.org/ns/1" {annotation}/>'
        after = workshop.annotation("org.uav-cosim.network", inner)
        made: Path = workshop.ssd("s.ssd", workshop.system(workshop.component(instance, "radio.fmu"), after=after))
        return made

    def dialect() -> Path:
        (tmp_path / "own.xml").write_text(
            '<mavlink><messages><message id="0" name="OURS"><field type="uint8_t" name="x"/></message>'
            "</messages></mavlink>"
        )
        return radio("rx", annotation='dialect="own.xml"')

    def asked(**options: Any) -> Said:
        with read_system(radio("rx")) as structure, pytest.raises(SystemDescriptionError) as caught:
            gateways_of(network_of(check(structure)), **options)
        return "error", [str(problem) for problem in caught.value.problems]

    return {
        "SEVERAL_PORTS": lambda: radio("rx", "rx2"),
        "SMALL_PORT": lambda: radio("rx", size=100),
        "DIALECT": dialect,
        "ADDRESS": lambda: asked(gcs=["serial:/dev/ttyUSB0"]),
        "NO_AUTOPILOT": lambda: asked(ports="tcp:5760+10"),
        "SIGNATURE": lambda: ("silent", signed_packets_are_taken()),
    }


def signed_packets_are_taken() -> list[str]:
    """A packet with a signature that nobody could have checked counts as any other."""
    import numpy as np
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    from cosim.packets import SIGNED, find

    station = mavlink.MAVLink(None, srcSystem=255)
    station.signing.secret_key, station.signing.sign_outgoing = b"k" * 32, True
    packet = bytearray(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station))
    packet[-1] ^= 1
    buffer = np.frombuffer(bytes(packet), np.uint8)
    assert tuple(int(x) for x in find(buffer, 0, buffer.size)) == (0, buffer.size, SIGNED)
    return []


@pytest.fixture
def of_multimodels(stricts: Any, monkeypatch: pytest.MonkeyPatch) -> Provoked:
    stricts.fmu()

    def model(**changes: Any) -> Path:
        content = {
            "fmus": {"{A}": "strict.fmu"},
            "parameters": {"{A}.one.p": 2},
            "algorithm": {"type": "fixed-step", "size": 0.5},
            "endTime": 1.0,
        }
        path: Path = stricts.workshop.root / "mm.json"
        path.write_text(json.dumps({**content, **changes}))
        return path

    def every(*keys: str) -> Said:
        """One word for several keys: each of them has it."""
        lines = []
        for key in keys:
            outcome, found = said(model(**{key: {"a": "b"}}))
            assert outcome == "error" and len(found) == 1
            lines += found
        assert len({line.partition(" ")[2] for line in lines}) == len(keys)
        return "error", lines

    def large() -> Said:
        monkeypatch.setattr(multimodel, "_LARGEST", 10)
        with pytest.raises(SystemDescriptionError) as caught:
            read_multimodel(model())
        return "error", [str(caught.value)]

    return {
        "ALGORITHM": lambda: model(algorithm={"type": "ecco"}),
        "VAR_STEP": lambda: model(
            algorithm={"type": "var-step", "size": [0.1, 1], "initsize": 0.1}, stabilisation=True
        ),
        "STABILISATION": lambda: model(stabilisation=True),
        "TRANSFER": lambda: every("modelTransfers"),
        "SWAP": lambda: every("modelSwaps"),
        "FAULTS": lambda: every("faultInjectConfigurationPath", "faultInjectInstances"),
        "LARGE_FILE": large,
        "OTHER_KEYS": lambda: model(livestream={"{A}.one": ["y"]}),
    }


@pytest.fixture
def of_osp(stricts: Any) -> Provoked:
    def structure(algorithm: str = "fixedStep", bond: str = "") -> Path:
        stricts.fmu()
        ends = '<Variable simulator="a" name="y"/><Variable simulator="b" name="u"/>'
        path: Path = stricts.workshop.root / "OspSystemStructure.xml"
        path.write_text(
            '<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">'
            f"<BaseStepSize>0.5</BaseStepSize><Algorithm>{algorithm}</Algorithm><Simulators>"
            '<Simulator name="a" source="strict.fmu"/><Simulator name="b" source="strict.fmu"/></Simulators>'
            f"<Connections><VariableConnection {bond}>{ends}</VariableConnection></Connections></OspSystemStructure>"
        )
        return path

    return {"OSP_ALGORITHM": lambda: structure("ecco"), "OSP_BOND": lambda: structure(bond='powerBond="p"')}


@pytest.fixture
def of_conversion(stricts: Any, stricts3: Any, variable: Any, tmp_path: Path) -> Provoked:
    def converted(engine: str, *wires: str, inner: str = "", fmi3: bool = False) -> Said:
        maker = stricts3 if fmi3 else stricts
        maker.fmu()
        parts = "".join(maker.component(name) for name in "ab")
        wired = "".join(maker.workshop.connection(*wire.split(), inner) for wire in wires)
        path = maker.workshop.ssd("c.ssd", maker.workshop.system(parts, wired))
        with pytest.raises(SystemDescriptionError) as caught:
            convert(path, tmp_path / "converted", engine)
        return "error", [str(problem) for problem in caught.value.problems]

    def valued(wire: str, bindings: str = "") -> Said:
        work = stricts.workshop
        types = '<SimpleType name="Level"><Enumeration><Item name="low" value="1"/></Enumeration></SimpleType>'
        level = {"kind": "Enumeration", "declaredType": "Level"}
        work.fmu("e.fmu", variable("e", start="1", **level), variable("ye", "output", **level), types=types)
        parts = work.component("a", "e.fmu", "e:input ye:output", bindings) + work.component("b", "e.fmu", "e:input")
        path = work.ssd("e.ssd", work.system(parts, work.connection(*wire.split()) if wire else ""))
        with pytest.raises(SystemDescriptionError) as caught:
            convert(path, tmp_path / "converted", "fmpy" if wire else "ecos")
        return "error", [str(problem) for problem in caught.value.problems]

    def with_file() -> Said:
        (tmp_path / "in.csv").write_text("time,v\n0,1\n")
        parts = stricts.workshop.component("t", "in.csv", "v:output:Real", type="text/csv")
        path = stricts.workshop.ssd("t.ssd", stricts.workshop.system(parts))
        with pytest.raises(SystemDescriptionError) as caught:
            convert(path, tmp_path / "converted", "ecos")
        return "error", [str(problem) for problem in caught.value.problems]

    table = '<ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/>'
    table += "</ssc:BooleanMappingTransformation>"
    return {
        "CONVERTED_LINK": lambda: converted("ecos", "a/c b/b", inner=table),
        "FMPY_TRANSFORMATION": lambda: converted("fmpy", "a/y b/u", inner='<ssc:LinearTransformation factor="2"/>'),
        "ENGINE_TYPES": lambda: converted("libcosim", "a/n b/u"),
        "ENGINE_FMI": lambda: converted("libcosim", fmi3=True),
        "ENGINE_TABLE": with_file,
        "ENGINE_VALUE": lambda: valued("", stricts.workshop.bindings({"e": "low"}, kind="Enumeration")),
        "FMPY_ZERO": lambda: valued("a/ye b/e"),
    }


@pytest.fixture
def of_masters(stricts: Any, stricts3: Any, probes: Any, tmp_path: Path) -> Provoked:
    def strict(stop: float = 2.0, step: float | None = None, flags: str = "", **options: Any) -> Said:
        stricts.fmu(flags=flags)
        return ran(stricts.ssd(stricts.component("a", step=step), stop=stop), **options)

    def coupled(
        master: str,
        inner: str = "",
        flags: str = "",
        *,
        events: bool = False,
        state: bool = True,
        step: float | None = None,
    ) -> Said:
        """Two FMUs that depend on each other, under a master; `step` is that of the first. `state`: can be saved."""
        maker, ends = (stricts3, ("f64_out[1]", "f64_in[1]")) if events else (stricts, ("y", "u"))
        able = ABLE if state else flags
        maker.fmu(flags=f'hasEventMode="true" {able}' if events else flags)
        options = {"ports": f"{ends[0]}:output {ends[1]}:input"} if events else {}
        first = {} if step is None else {"step": step}
        parts = maker.component("a", **first, **options) + maker.component("b", **options)
        wires = "".join(maker.workshop.connection(f"{a}/{ends[0]}", f"{b}/{ends[1]}") for a, b in ("ab", "ba"))
        inside = f'<master xmlns="https://uav-cosim.org/ns/1" {master}>{inner}</master>'
        after = maker.workshop.annotation("org.uav-cosim.master", inside)
        experiment = '<ssd:DefaultExperiment startTime="0" stopTime="2"/>'
        return ran(maker.workshop.ssd("m.ssd", maker.workshop.system(parts, wires, after=after), experiment))

    flags = 'canHandleVariableCommunicationStepSize="true"'
    crossing = '<constraint type="zerocrossing"><port name="a.y"/></constraint>'

    def growing() -> Said:
        """y = u + p and u = 2 y has a solution; that of u = y has none."""
        probes.fmu()
        return ran(probes.ssd(probes.component("a", p=1.0), "a/y a/u"))

    def by_step() -> Said:
        """What is said of it before a run, in which the strict FMU would fail."""
        stricts3.fmu(flags=f'hasEventMode="true" {ABLE}')
        ports = "i32_in[1]:input i32_out[1]:output"
        parts = stricts3.component("a", ports=ports) + stricts3.component("b", ports=ports)
        wire = stricts3.workshop.connection("a/i32_out[1]", "b/i32_in[1]")
        inside = '<master xmlns="https://uav-cosim.org/ns/1" algorithm="gauss-seidel"/>'
        after = stricts3.workshop.annotation("org.uav-cosim.master", inside)
        path = stricts3.workshop.ssd("m.ssd", stricts3.workshop.system(parts, wire, after=after))
        with read_system(path) as structure:
            return "note", list(prepare(check(structure)).notes)

    def not_a_number() -> Said:
        probes.fmu()
        return ran(probes.ssd(probes.component("a", mode=5, when=1.0)))

    def every(interval: float) -> Said:
        stricts.fmu()
        inner = f'<recording xmlns="https://uav-cosim.org/ns/1" interval="{interval}"/>'
        after = stricts.workshop.annotation("org.uav-cosim.recording", inner)
        experiment = '<ssd:DefaultExperiment startTime="0" stopTime="2"/>'
        return ran(
            stricts.workshop.ssd("r.ssd", stricts.workshop.system(stricts.component("a"), after=after), experiment)
        )

    return {
        "FINE_STEPS": lambda: strict(step=1.2345678912345678e-10),
        "WHOLE_TIMES": lambda: strict(stop=1.00000000001),
        "BASE_STEP": lambda: strict(stop=1.75),
        "OVERRUN": lambda: overrun(stricts),
        "RECORDING_INTERVAL": lambda: every(0.7),
        "CHANGE": lambda: strict(at=[(0.75, "a.p", "2")]),
        "NOT_A_NUMBER": not_a_number,
        "INITIAL_LOOP": growing,
        "EXTRAPOLATION": lambda: coupled('algorithm="jacobi" extrapolation="1"'),
        "LOOP_STATE": lambda: coupled('algorithm="fixed-point"'),
        "LOOP_EVENTS": lambda: coupled('algorithm="quasi-newton"', events=True),
        "INPUTS_BY_STEP": by_step,
        "STEP_CONTROL": lambda: coupled('algorithm="richardson"'),
        "STEP_COUNTS": lambda: coupled('algorithm="var-step"', crossing, flags=flags),
        "STEP_EVENTS": lambda: coupled('algorithm="var-step"', flags=flags, events=True, state=False),
        "STEP_DELAY": lambda: coupled(
            'algorithm="richardson"', '<connection to="b.u" delay="0.5"/>', flags=strict2.ABLE
        ),
        "STEP_FRACTION": lambda: coupled('algorithm="richardson"', flags=strict2.ABLE, step=1 / 3),
        "FINE_GRID": lambda: coupled(
            'algorithm="jacobi"', '<connection to="b.u" delay="0.5"/>', flags=strict2.ABLE, step=0.333333333
        ),
        "CHECKPOINT": lambda: strict(out=tmp_path / "out", checkpoint_every=1.0),
    }


def overrun(stricts: Any) -> Said:
    """Steps of 1 s beside steps of 0.5 s, to 1.5 s."""
    stricts.fmu(flags="")
    parts = stricts.component("a") + stricts.component("b", step=1.0)
    return ran(stricts.ssd(parts, stop=1.5))


@pytest.fixture
def of_mastersim(stricts: Any) -> Provoked:
    def project(lines: str) -> Path:
        stricts.fmu()
        path: Path = stricts.workshop.root / "p.msim"
        path.write_text(f"tEnd 1 s\nhStart 0.5 s\n{lines}\nsimulator 0 0 a #000000 strict.fmu\n")
        return path

    return {
        "MASTERSIM_STEPS": lambda: project("adjustStepSize yes\nmaxIterations 3"),
        "MASTERSIM_ITERATION": lambda: project("maxIterations 3\nMasterMode NEWTON"),
        "MASTERSIM_IGNORED": lambda: project("relTol 1e-3"),
    }


FIXTURES = {
    "SSP 2.0": "of_ssp",
    "FMI": "of_fmi",
    "FMI 3.0.2": "of_fmi3",
    "MAVLink": "of_mavlink",
    "Multi-models": "of_multimodels",
    "OspSystemStructure": "of_osp",
    "MasterSim": "of_mastersim",
    "Conversion": "of_conversion",
    "Runs": "of_masters",
}
MOVED = dict.fromkeys(
    ("IMPLEMENTATION", "DEEP", "LARGE", "LONG_ARRAY", "ARCHIVE", "ENTRIES", "LARGE_DOCUMENT"), "of_ssp"
)
MOVED |= dict.fromkeys(("SCHEDULED_EXECUTION", "CLOCKED_CHANGE", "STRUCTURAL_CHANGE", "CLOCKED_PACKETS"), "of_fmi3")
MOVED |= dict.fromkeys(("NO_MAX_SIZE", "LARGE_VARIABLE", "UNSETTLED"), "of_fmi3")
MOVED |= {"LARGE_DESCRIPTION": "of_fmi", "LARGE_FILE": "of_multimodels"}
"""The fixtures of those that stand under the heading of another."""
RULES = {
    "UNIT_GAP": ("of_ssp", "note", "1 connections join a unit to a port without one, unconverted; the first: .*s.ssd:"),
    "CLOCK_END": (
        "of_fmi3",
        "error",
        "is a constant Clock, which ticks by itself: it can drive a triggered input Clock",
    ),
    "SILENT_CLOCK": ("of_fmi3", "note", "b.go: nothing is connected to this Clock: it never ticks"),
    "NO_AUTOPILOT": ("of_mavlink", "error", "no autopilot has packet ports: .*; those that have are: a"),
    "OTHER_KEYS": ("of_multimodels", "note", 'mm.json: ignored, since it changes no values: "livestream"'),
}
"""Messages that follow from the rules of a standard or of our own files; they are not limitations."""


def test_the_document_is_what_is_generated() -> None:
    text = (ROOT / "docs/limitations.md").read_text(encoding="utf-8")
    assert text == table(), "run: python -m cosim_master.diagnostics.limitations > docs/limitations.md"


@pytest.mark.parametrize("one", LIMITATIONS, ids=NAMES.get)
def test_it_is_true(one: Limitation, request: pytest.FixtureRequest) -> None:
    provoked = request.getfixturevalue(MOVED.get(NAMES[one], FIXTURES.get(one.heading, "")))
    outcome, lines = said(provoked[NAMES[one]]())
    assert outcome == one.outcome, lines
    if one.words:
        assert any(re.search(pattern(one), line) for line in lines), lines


@pytest.mark.parametrize("name", RULES)
def test_a_rule_is_said(name: str, request: pytest.FixtureRequest) -> None:
    fixture, expected, words = RULES[name]
    outcome, lines = said(request.getfixturevalue(fixture)[name]())
    assert outcome == expected
    assert any(re.search(words, line) for line in lines), lines


def test_equal_features_share_a_row() -> None:
    rows = [line for line in table().splitlines() if line.startswith("| ") and not line.startswith("| feature")]
    assert len(rows) == len({(one.heading, one.feature) for one in LIMITATIONS}) < 60


def test_the_code_uses_every_one() -> None:
    used: set[str] = set()
    some = re.compile(rf"\b({'|'.join(NAMES.values())})\b")
    for file in Path(cosim_master.__file__).parent.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        if file.name != "limitations.py" and some.search(text):
            tree = ast.parse(text)
            used |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert {name for one, name in NAMES.items() if one.words} <= used

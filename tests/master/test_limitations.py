"""The table of limitations is what is generated, every entry of it is true, and every one is used by the code."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest

import cosim_master
from cosim_master import archive, limitations
from cosim_master.check import check
from cosim_master.errors import SystemDescriptionError
from cosim_master.limitations import LIMITATIONS, Limitation, table
from cosim_master.ssp import SSD_TYPE, read_system

ROOT = Path(__file__).parents[2]
NAMES = {one: name for name, one in vars(limitations).items() if isinstance(one, Limitation)}


def pattern(one: Limitation) -> str:
    """The words of a limitation with anything in their gaps."""
    return ".*".join(re.escape(part) for part in one.words.split("{}"))


def said(path: Path) -> tuple[str, list[str]]:
    """ "error" or "note", and what was said."""
    try:
        with read_system(path) as structure:
            return "note", list(check(structure).notes)
    except SystemDescriptionError as error:
        return "error", [str(problem) for problem in error.problems]


@pytest.fixture
def provoked(workshop: Any, variable: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A system for each limitation, by its name in the module."""
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
        made = system(name="s0")
        for i in range(1, depth):
            made = system(made, name=f"s{i}")
        return made

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
        "IMPLEMENTATION": lambda: ssd(component("a", unit, implementation="ModelExchange")),
        "ABSOLUTE_URI": lambda: ssd(component("a", "file:///unit.fmu")),
        "OTHER_SSD": lambda: ssd(component("a", "other.ssd#id", type=SSD_TYPE)),
        "CLOCK": lambda: workshop.ssd("s.ssd", signals(kind="Clock"), version="2.0"),
        "OPEN_SIZE": lambda: array("<ssc:Dimension/>"),
        "DIRECTION": lambda: ssd(
            system(name="s", connectors="i:unspecified") + system(name="t", connectors="o:unspecified"),
            wire("s/i", "t/o"),
        ),
        "NARROWING": lambda: ssd(component("a", unit, "n:input y:output"), wire("a/y", "a/n")),
        "MAPPED_BACK": lambda: ssd(
            system(component("a", unit, "m:output"), wire("a/m", "o", mapping), name="s", connectors="o:output"),
            bindings=workshop.bindings({"s.o": 2}),
        ),
        "DEEP": lambda: ssd(nested(65)),
        "LARGE": multiplied,
        "LONG_ARRAY": lambda: array('<ssc:Dimension size="300"/><ssc:Dimension size="300"/>'),
        "ARCHIVE": swollen,
        "META_DATA": lambda: ssd(component("a", unit, after=meta)),
        "ANNOTATION": lambda: ssd(component("a", unit, after=workshop.annotation("com.example", "<x/>"))),
        "NO_SOURCE": lambda: workshop.ssd("s.ssd", system('<ssd:Component name="a"/>'), version="2.0"),
        "SIGNAL_START": lambda: workshop.ssd("s.ssd", signals(workshop.bindings({"tap.t": 1.0}))),
        "LOCAL": lambda: ssd(
            component("a", unit, "u:input x:local"), wire("a/x", "a/u", suppressUnitConversion="true")
        ),
        "UNIT_GAP": lambda: ssd(component("a", unit, "w:input y:output"), wire("a/y", "a/w")),
        "GEOMETRY": lambda: ssd(component("a", unit, after='<ssd:ElementGeometry x1="0" y1="0" x2="1" y2="1"/>')),
    }


def test_the_document_is_what_is_generated() -> None:
    text = (ROOT / "docs/limitations.md").read_text(encoding="utf-8")
    assert text == table(), "run: python -m cosim_master.limitations > docs/limitations.md"


@pytest.mark.parametrize("one", LIMITATIONS, ids=NAMES.get)
def test_it_is_true(one: Limitation, provoked: Any) -> None:
    outcome, lines = said(provoked[NAMES[one]]())
    if one.outcome == "silent":
        assert outcome == "note" and not any("eometry" in line for line in lines)
    else:
        assert outcome == one.outcome
        assert any(re.search(pattern(one), line) for line in lines), lines


def test_the_code_uses_every_one() -> None:
    used: set[str] = set()
    for file in Path(cosim_master.__file__).parent.glob("*.py"):
        if file.name != "limitations.py":
            tree = ast.parse(file.read_text(encoding="utf-8"))
            used |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert {name for one, name in NAMES.items() if one.words} <= used

"""The FMU with Clocks (see clocked.c), as Stricts3 writes its FMUs."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX
from tests.master.fmus.probe import compiled
from tests.master.fmus.strict3 import ABLE, Stricts3

KINDS = {
    "constant": "constant",
    "fixed": "fixed",
    "asked": "fixed",
    "tunable": "tunable",
    "retuned": "tunable",
    "changing": "changing",
    "countdown": "countdown",
    "go": "triggered",
    "fire": "triggered",
}
NUMBER = {name: i for i, name in enumerate(KINDS)}


def description(
    *clocks: str,
    period: float = 0.5,
    shift: float = 0.0,
    step: float = 0.5,
    flags: str = f'{ABLE} hasEventMode="true"',
    relay: bool = False,
    **attributes: str,
) -> str:
    """modelDescription.xml of an FMU with some of the Clocks.

    Args:
        clocks: which.
        relay: bytes_out belongs to countdown; for its rule 5.
        attributes: of each Clock that needs others than `period` and `shift` make it.
    """
    mask = sum(1 << NUMBER[clock] for clock in clocks)
    timing = f'intervalDecimal="{period}" shiftDecimal="{shift}"'
    made, unknowns = [], []
    for clock in clocks:
        given = attributes.get(clock, timing if clock in ("constant", "fixed", "tunable") else "")
        side = "output" if clock == "fire" else "input"
        reference = 1 + NUMBER[clock]
        made.append(
            f'<Clock name="{clock}" valueReference="{reference}" causality="{side}" '
            f'intervalVariability="{KINDS[clock]}" {given}/>'
            f'<Int32 name="ticks_{clock}" valueReference="{100 + reference}" causality="output" '
            f'variability="discrete" clocks="{reference}"/>'
        )
        unknowns.append(100 + reference)
    if "fire" in clocks:
        unknowns.append(1 + NUMBER["fire"])
    belongs = " ".join(str(1 + NUMBER[clock]) for clock in ("constant", "go", "fire") if clock in clocks)
    of = f'clocks="{belongs}"' if belongs else ""
    of_out = f'clocks="{1 + NUMBER["countdown"]}"' if relay else of
    made.append(
        f'<Float64 name="u" valueReference="20" causality="input" variability="discrete" start="0" {of}/>'
        f'<Float64 name="y" valueReference="21" causality="output" variability="discrete" {of}/>'
        '<Float64 name="v" valueReference="22" causality="input" start="0"/>'
        '<Float64 name="w" valueReference="23" causality="output"/>'
        '<Int32 name="all" valueReference="24" causality="output" variability="discrete"/>'
        f'<String name="text_in" valueReference="25" causality="input" {of}><Start value=""/></String>'
        f'<String name="text_out" valueReference="26" causality="output" {of}/>'
        f'<Binary name="bytes_in" valueReference="27" causality="input" maxSize="64" {of}><Start value=""/></Binary>'
        f'<Binary name="bytes_out" valueReference="28" causality="output" maxSize="64" {of_out}/>'
        f'<Float64 name="period" valueReference="40" causality="parameter" variability="tunable" start="{period}"/>'
        f'<Float64 name="shift" valueReference="41" causality="parameter" variability="fixed" start="{shift}"/>'
        '<Float64 name="delay" valueReference="42" causality="parameter" variability="fixed" start="0.25"/>'
        '<Float64 name="when" valueReference="43" causality="parameter" variability="fixed" start="0"/>'
        f'<Int32 name="uses" valueReference="44" causality="parameter" variability="fixed" start="{mask}"/>'
        '<Int32 name="rule" valueReference="45" causality="parameter" variability="fixed" start="0"/>'
        '<Int32 name="early" valueReference="46" causality="parameter" variability="fixed" start="0"/>'
        '<Float64 name="time" valueReference="47" causality="independent" variability="continuous"/>'
    )
    outputs = [*unknowns, 21, 23, 24, 26, 28]
    structure = "".join(f'<Output valueReference="{r}"/>' for r in sorted(outputs))
    structure += '<InitialUnknown valueReference="23" dependencies="22"/>'
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="3.0" modelName="Clocked" instantiationToken="clocked">'
        f'<CoSimulation modelIdentifier="Unit" {flags}/><DefaultExperiment stepSize="{step}"/>'
        f"<ModelVariables>{''.join(made)}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>"
    )


def clocked(stricts3: Stricts3, name: str, *clocks: str, **options: Any) -> Path:
    """An FMU with some of the Clocks; the arguments are those of `description`."""
    path = stricts3.workshop.root / name
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description(*clocks, **options))
        library = compiled(Path(__file__).with_name("clocked.c"), stricts3.folder)
        archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", library)
    return path

"""The tables of `info`: what they say of an FMU, a system and a run, whole and unchanged."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

from cosim_master.cli.views.inspection import fmu_tables, system_tables
from cosim_master.cli.views.overview import overview
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.master.fmus.probe import LEVEL


def shown(tables: Any) -> list[str]:
    """The lines that a wide terminal shows."""
    console = Console(width=200, highlight=False, file=io.StringIO())
    for table in tables:
        console.print(table, markup=False) if isinstance(table, str) else console.print(table)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]


def words(tables: Any) -> list[list[str]]:
    return [line.split() for line in shown(tables)]


def test_no_name_is_cut_in_80_columns(fmus: Path) -> None:
    console = Console(width=80, highlight=False, file=io.StringIO())
    tables = [table for table in fmu_tables(fmus / "Quadrotor.fmu") if isinstance(table, Table)]
    for table in tables:
        console.print(table)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert not [line for line in lines if "\u2026" in line or len(line) > 80]
    names = {line.split()[0] for line in lines if line[:1].strip()}
    assert {"angular_velocity[1]", "angular_velocity[3]", "rotor_direction[8]", "position_start[2]"} <= names


def test_a_name_longer_than_the_screen_is_wrapped(workshop: Any, variable: Any) -> None:
    name = "part." * 30 + "y"
    console = Console(width=80, highlight=False, file=io.StringIO())
    for table in fmu_tables(workshop.fmu("u.fmu", variable(name, "output"))):
        console.print(table)
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "\u2026" not in shown
    assert name in "".join(line.split(" ")[0] for line in shown.splitlines())


def test_an_fmu(workshop: Any, variable: Any) -> None:
    packets = '<PacketPort variable="rx" mimeType="application/x-mavlink;version=2" maxSize="512"/>'
    path = workshop.fmu(
        "u.fmu",
        variable("motor[1]", start="0.125"),
        variable("level", kind="Enumeration", declaredType="Level", start="5"),
        variable("rx", kind="String"),
        variable("mass", "parameter", unit="m", start="1.5"),
        variable("y", "output").replace("<ScalarVariable", '<ScalarVariable description="height [m, NED] [/b]"'),
        types=LEVEL,
        step="0.01",
        flags='canGetAndSetFMUstate="true"',
        extra=f'<VendorAnnotations><Tool name="uav-cosim">{packets}</Tool></VendorAnnotations>',
    )
    lines = words(fmu_tables(path))
    assert lines[:3] == [
        ["Unit"],
        ["FMI", "2.0,", "GUID", "{0},", "step", "size", "0.01", "s"],
        ["CoSimulation:", "canGetAndSetFMUstate"],
    ]
    assert (
        sum("canGetAndSetFMUstate" in line for line in lines) == 1
        and [
            "default",
            "experiment:",
            "stepSize",
            "0.01",
        ]
        in lines
    )
    table = lines.index(["variable", "causality", "type", "unit", "start", "description"])
    assert lines[table + 1 : table + 6] == [
        ["motor[1]", "input", "Real", "0.125"],
        ["level", "input", "Enumeration", "high"],
        ["rx", "input", "packets", "(512", "bytes)"],
        ["mass", "parameter", "Real", "m", "1.5"],
        ["y", "output", "Real", "height", "[m,", "NED]", "[/b]"],  # brackets are no markup
    ]


def test_a_system(probes: Any) -> None:
    probes.fmu()
    system = probes.ssd(probes.component("a", p=1.5, mode=2) + probes.component("b"), "a/y b/u", "a/m b/n")
    assert words(system_tables(str(system))) == [
        ["test:", "SSP", "1.0,", "2", "instances"],
        ["instance", "FMU", "step", "[s]", "set", "by", "the", "system"],
        ["a", "probe.fmu", "0.5", "p=1.5", "mode=2"],
        ["b", "probe.fmu", "0.5"],
        ["from", "to", "connections"],
        ["a", "b", "2"],
    ]


@pytest.mark.parametrize(
    "damage",
    [
        lambda out: (out / "signals.parquet").unlink(),
        lambda out: (out / "signals.parquet").write_bytes(b"PAR1PAR1"),
        lambda out: (out / "manifest.json").write_text("{"),
        lambda out: (out / "manifest.json").write_text("{}"),
        lambda out: (out / "manifest.json").write_text("[]"),
    ],
    ids=["no signals", "broken signals", "broken manifest", "empty manifest", "another manifest"],
)
def test_results_that_are_not_complete(probes: Any, tmp_path: Path, damage: Any) -> None:
    probes.fmu()
    out = tmp_path / "out"
    simulate(probes.ssd(probes.component("a")), RunOptions(out=out))
    assert json.loads((out / "manifest.json").read_text())["outcome"] == "done"
    damage(out)
    with pytest.raises(SystemDescriptionError, match=r"out: is not the complete result of a run: "):
        overview(out)


def test_tables_are_tables(probes: Any) -> None:
    assert sum(isinstance(table, Table) for table in fmu_tables(probes.fmu())) == 1


def test_terminals_of_an_fmi_3_fmu(stricts3: Any) -> None:
    path = stricts3.fmu()
    with zipfile.ZipFile(path, "a") as archive:
        members = "".join(f'<TerminalMemberVariable variableName="{n}" variableKind="signal"/>' for n in ("s_in", "i8"))
        inner = f'<Terminal name="inner" matchingRule="none">{members}</Terminal>'
        member = '<TerminalMemberVariable variableName="i8_in" variableKind="signal"/>'
        outer = f'<Terminal name="plug" matchingRule="plug">{member}{inner}</Terminal>'
        root = f'<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>{outer}</Terminals></fmiTerminalsAndIcons>'
        archive.writestr("terminalsAndIcons/terminalsAndIcons.xml", root)
    lines = words(fmu_tables(path))
    assert ["plug", "i8_in"] in lines
    assert ["plug.inner", "s_in", "i8"] in lines
    assert [*["note:", "its", "terminal"], '"plug.inner"'] in [line[:4] for line in lines]

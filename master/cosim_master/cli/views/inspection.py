"""The contents of FMUs and systems, and the time profile of a run, as JSON documents and as tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from cosim_master.diagnostics.errors import counted
from cosim_master.fmi.description.datasheet import datasheet
from cosim_master.fmi.description.read import describe
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system

if TYPE_CHECKING:  # it imports the compiler of kernels, which takes half a second
    from cosim_master.stepping.profiling import Profile

__all__ = ["fmu_document", "fmu_tables", "profile_tables", "system_document", "system_tables"]


_FEW = 30
"""Number of variables of an FMU that fit on a screen."""
_NAME = 40
"""Characters of a name that leave room for the other columns of 80."""


def _table(*columns: str) -> Table:
    """Returns a table that cuts no cell; what is in its first column stays in one line, unless it is very long."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for n, column in enumerate(columns):
        table.add_column(Text(column), overflow="fold", no_wrap=n == 0)
    return table


def _row(table: Table, *cells: str) -> None:
    """Adds a row of plain text; brackets in names and descriptions are not interpreted as markup."""
    if len(cells[0]) > _NAME:
        table.columns[0].no_wrap = False
    table.add_row(*(Text(cell) for cell in cells))


def _number(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def fmu_document(path: Path) -> dict[str, Any]:
    """Returns the identity, the capabilities and the variables of an FMU, as docs/command-line.md describes.

    An FMU that cannot be run here is described by `datasheet`, with the reason for its refusal.
    """
    sheet = datasheet(path)
    if sheet["refused"]:
        return {"kind": "fmu", "step_size": None, "capabilities": [], "variables": [], "notes": [], **sheet}
    fmu = describe(path)
    return {
        **sheet,
        "kind": "fmu",
        "model": fmu.model_name,
        "description": fmu.description,
        "fmi_version": fmu.fmi_version,
        "guid": fmu.guid,
        "step_size": fmu.step_size,
        "capabilities": [n for n in fmu.capabilities.__slots__ if getattr(fmu.capabilities, n) is True],
        "variables": [
            {
                "name": v.name,
                "causality": v.causality,
                "type": f"packets ({v.packet_capacity} bytes)" if v.packet_capacity else v.type,
                "unit": v.unit.name if v.unit else None,
                "start": next((n for n, i in (v.items or {}).items() if i == v.start), _plain(v.start)),
                "description": v.description,
            }
            for v in fmu.variables.values()
        ],
        "terminals": {name: list(members) for name, members in fmu.terminals.items()},
        "notes": list(fmu.notes),
    }


def fmu_tables(path: Path, *, every: bool = True) -> Iterator[Table | str]:
    """Returns the data sheet of an FMU as tables; without `every`, long lists of variables become counts."""
    fmu = fmu_document(path)
    yield f"{fmu['model']}: {fmu['description']}" if fmu["description"] else fmu["model"]
    yield f"FMI {fmu['fmi_version']}, GUID {fmu['guid']}, {_step(fmu['step_size'])}"
    yield from _sheet(fmu)
    if not fmu["variables"] or not (every or len(fmu["variables"]) <= _FEW):
        yield _by_causality(fmu["variables_by_causality"])
        return
    columns = ("name", "causality", "type", "unit", "start", "description")
    table = _table("variable", *columns[1:])
    for v in fmu["variables"]:
        _row(table, *(_number(v[column]) for column in columns))
    yield table
    if fmu["terminals"]:
        table = _table("terminal", "variables")
        for name, members in fmu["terminals"].items():
            _row(table, name, " ".join(members))
        yield table
    for note in fmu["notes"]:
        yield f"note: {note}"


def _step(size: float | None) -> str:
    return "no step size" if size is None else f"step size {_number(size)} s"


def _sheet(fmu: Mapping[str, Any]) -> Iterator[str]:
    """Returns lines about the purpose of an FMU, the platforms it supports, and the files it contains."""
    for name, flags in fmu["interfaces"].items():
        yield f"{name}: {', '.join(flags) or 'no capabilities'}"
    sources = f"; {fmu['sources']} files of sources" if fmu["sources"] else ""
    yield f"platforms: {', '.join(fmu['platforms']) or 'none'}{sources}"
    if experiment := fmu["default_experiment"]:
        yield f"default experiment: {', '.join(f'{name} {value}' for name, value in experiment.items())}"
    for standard in fmu["layered_standards"]:
        yield " ".join(filter(None, ("layered standard:", *standard.values())))
    if fmu["terminals"]:
        yield f"terminals: {', '.join(fmu['terminals'])}"
    if fmu["generated"]:
        yield f"made by {fmu['generated']}"
    for text in fmu["refused"]:
        yield f"cannot be run here: {text}"


def _by_causality(variables: Mapping[str, Sequence[str]]) -> Table:
    table = _table("causality", "variables", "such as")
    for causality, names in variables.items():
        shown = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
        _row(table, causality, str(len(names)), shown)
    return table


def system_document(path: str, variant: str | None = None) -> dict[str, Any]:
    """Returns the instances and connections of a system, as docs/command-line.md describes."""
    with read_system(path, variant) as structure:
        checked = check(structure)
        wires = Counter((link.source[0], link.target[0]) for link in checked.links)
        return {
            "kind": "system",
            "name": structure.name,
            "version": structure.version,
            "instances": [
                {
                    "name": instance.name,
                    "fmu": str(instance.fmu.path),
                    "step_size": instance.step_size,
                    "start_values": {name: _plain(value) for name, value in instance.start_values.items()},
                }
                for instance in checked.instances
            ],
            "connections": [{"from": a, "to": b, "count": n} for (a, b), n in wires.items()],
            "notes": list(checked.notes),
        }


def system_tables(path: str, variant: str | None = None) -> Iterator[Table | str]:
    """Returns the overview of a system as tables."""
    system = system_document(path, variant)
    yield f"{system['name']}: SSP {system['version']}, {counted(len(system['instances']), 'instance')}"
    table = _table("instance", "FMU", "step [s]", "set by the system")
    for one in system["instances"]:
        starts = " ".join(f"{name}={_number(value)}" for name, value in one["start_values"].items())
        _row(table, one["name"], Path(one["fmu"]).name, _number(one["step_size"]), starts)
    yield table
    table = _table("from", "to", "connections")
    for wire in system["connections"]:
        _row(table, wire["from"], wire["to"], str(wire["count"]))
    yield table
    for note in system["notes"]:
        yield f"note: {note}"


def _plain(value: Any) -> Any:
    """Returns a value for JSON; numbers that are not finite are written as in XML Schema."""
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"
    return list(map(_plain, value)) if isinstance(value, tuple | list) else value


def profile_tables(profile: Profile) -> Iterator[Table | str]:
    """Returns the time profile of a run as tables."""
    whole = sum(one.total for one in profile.fmus) or 1.0
    table = _table("FMU", "instances", "steps", "set [s]", "doStep [s]", "get [s]", "us per step", "share")
    for one in profile.fmus:
        spent = (f"{seconds:.4f}" for seconds in (one.set, one.do_step, one.get))
        each = f"{1e6 * one.total / one.steps:.2f}" if one.steps else ""
        _row(table, one.fmu, str(one.instances), str(one.steps), *spent, each, f"{100 * one.total / whole:.1f} %")
    yield table
    table = _table("phase", "time [s]")
    for name, seconds in profile.phases.items():
        _row(table, name, f"{seconds:.4f}")
    _row(table, "of stepping: in FMUs, over all threads", f"{sum(one.total for one in profile.fmus):.4f}")
    yield table

"""What FMUs, systems and runs consist of, as tables for people."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from rich.table import Table
from rich.text import Text

from cosim_master.check import check
from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmu import describe
from cosim_master.profiling import Profile
from cosim_master.ssp import read_system

__all__ = ["fmu_tables", "profile_tables", "run_tables", "system_tables"]


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(Text(column))
    return table


def _row(table: Table, *cells: str) -> None:
    """A row of plain texts: names and descriptions may hold brackets, which are no markup."""
    table.add_row(*(Text(cell) for cell in cells))


def _number(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def fmu_tables(path: Path) -> Iterator[Table | str]:
    """Identity, capabilities and variables of an FMU."""
    fmu = describe(path)
    yield f"{fmu.model_name}: {fmu.description}" if fmu.description else fmu.model_name
    yield f"FMI {fmu.fmi_version}, GUID {fmu.guid}, step size {_number(fmu.step_size) or 'not given'} s"
    capable = [name for name in fmu.capabilities.__slots__ if getattr(fmu.capabilities, name) is True]
    yield f"capabilities: {', '.join(capable) or 'none'}"
    table = _table("variable", "causality", "type", "unit", "start", "description")
    for v in fmu.variables.values():
        kind = f"packets ({v.packet_capacity} bytes)" if v.packet_capacity else v.type
        start = next((n for n, i in (v.items or {}).items() if i == v.start), v.start)
        _row(table, v.name, v.causality, kind, v.unit.name if v.unit else "", _number(start), v.description)
    yield table
    if fmu.terminals:
        table = _table("terminal", "variables")
        for name, members in fmu.terminals.items():
            _row(table, name, " ".join(members))
        yield table
    for note in fmu.notes:
        yield f"note: {note}"


def system_tables(path: str, variant: str | None = None) -> Iterator[Table | str]:
    """Instances and connections of a system."""
    with read_system(path, variant) as structure:
        checked = check(structure)
        yield f"{structure.name}: SSP {structure.version}, {len(checked.instances)} instances"
        table = _table("instance", "FMU", "step [s]", "set by the system")
        for instance in checked.instances:
            starts = " ".join(f"{name}={_number(value)}" for name, value in instance.start_values.items())
            _row(table, instance.name, instance.fmu.path.name, _number(instance.step_size), starts)
        yield table
        wires: dict[tuple[str, str], int] = {}
        for link in checked.links:
            ends = (link.source[0], link.target[0])
            wires[ends] = wires.get(ends, 0) + 1
        table = _table("from", "to", "connections")
        for (source, target), n in wires.items():
            _row(table, source, target, str(n))
        yield table
        for note in checked.notes:
            yield f"note: {note}"


def profile_tables(profile: Profile) -> Iterator[Table | str]:
    """Where the time of a run went."""
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


def run_tables(folder: Path) -> Iterator[Table | str]:
    """How a run went and what it recorded."""
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        schema = pq.read_schema(folder / "signals.parquet")
        rows = pq.read_metadata(folder / "signals.parquet").num_rows
        yield (
            f"{manifest['system']['name']}: {manifest['outcome']}, {manifest['simulated_s']:g} s simulated in "
            f"{manifest['wall_s']:.2f} s ({manifest['real_time_factor']:.1f} times real time), seed {manifest['seed']}"
        )
        table = _table("packets", "")
        for name, count in manifest["packets"].items():
            _row(table, name, str(count))
        yield table
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SystemDescriptionError(
            [Problem(Where(str(folder)), f"is not the complete result of a run: {error}")]
        ) from None
    table = _table("signal", "type", "unit")
    for one in schema:
        _row(table, one.name, str(one.type), (one.metadata or {}).get(b"unit", b"").decode())
    yield f"{rows} rows of"
    yield table

"""The verb `compare`."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim_master.cli.terminal.console import errors, notes, print_json, print_tables, usage
from cosim_master.cli.terminal.options import Json
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.table import Table

    from cosim_master.results.reading.comparison import Comparison

_ROWS = 15
"""Rows of a table."""
Side = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or a CSV file as FMPy writes it.")]


@verb("compare out/line5 out/line5-2", "compare out/line5 reference.csv --rtol 1e-6 --signals '*.position*'")
def compare(
    first: Side,
    second: Side,
    atol: Annotated[
        float, typer.Option(metavar="A", help="Absolute tolerance, in each signal's own unit.", min=0.0)
    ] = 0.0,
    rtol: Annotated[float, typer.Option(metavar="R", help="Relative tolerance.", min=0.0)] = 0.0,
    signals: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATTERN", help="Signals to compare, e.g. '*.position*'; may be repeated.", show_default="all"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare two runs signal by signal; exit code 0: equal, 1: different, 2: they cannot be compared."""
    from cosim_master.results.reading.comparison import compare as compared

    if not math.isfinite(atol + rtol):
        raise usage("compare: --atol and --rtol are finite numbers")
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"comparing {first} and {second}")
        found = compared(first, second, atol=atol, rtol=rtol, signals=signals or ())
    if as_json:
        print_json(_document(found))
    else:
        notes(found.notes)
        print_tables(_tables(found, (first, second)))
    if not found.equal:
        raise typer.Exit(1)


def _tables(found: Comparison, runs: tuple[Path, Path]) -> Iterator[Table | str]:
    differing = [signal for signal in found.signals if not signal.equal]
    if differing:
        table = _table("signal", "largest difference", "of its size", "at s", "first at s", "differing")
        for one in differing[:_ROWS]:
            share = "" if math.isnan(one.relative) else f"{one.relative:.3g}"
            apart = "text" if math.isnan(one.absolute) else f"{one.absolute:.6g}"
            apart = f"{apart} [{' / '.join(one.units)}]" if one.units else apart
            times = ("" if time is None else f"{time:g}" for time in (one.time, one.first))
            _row(table, one.name, apart, share, *times, f"{one.differing} of {found.common}")
        yield table
        if len(differing) > _ROWS:
            yield f"and {len(differing) - _ROWS} more signals that differ"
    for run, names in zip(runs, found.only, strict=True):
        if names:
            yield f"only in {run}: {_some(names)}"
    if found.packets:
        table = _table("packets", *map(str, runs))
        for name, counts in found.packets.items():
            _row(table, name, *map(str, counts))
        yield table
    if found.causes:
        table = _table("made with", *map(str, runs))
        for name, values in list(found.causes.items())[:_ROWS]:
            _row(table, name, *(_short(value) for value in values))
        yield table
        if len(found.causes) > _ROWS:
            yield f"and {len(found.causes) - _ROWS} more of the manifests"
    if found.times != (found.common, found.common):
        spans = (f"{n} from {a:g} to {b:g} s" for n, (a, b) in zip(found.times, found.spans, strict=True))
        yield f"compared at the {found.common} times that both have, of {' and '.join(spans)}"
    equal = len(found.signals) - len(differing)
    word = "equal" if found.equal else "different"
    yield f"{word}: {equal} of {len(found.signals)} common signals agree{_but(found)}"


def _but(found: Comparison) -> str:
    """Returns why runs whose common signals agree are different; empty if they are equal, or a signal differs."""
    if found.equal or not all(signal.equal for signal in found.signals):
        return ""
    reasons = {
        "signals that only one of them has": any(found.only),
        "packets": bool(found.packets),
        "times": not found.same_span,
    }
    return f"; the runs differ in {' and '.join(reason for reason, applies in reasons.items() if applies)}"


def _some(names: tuple[str, ...]) -> str:
    shown = ", ".join(names[:5])
    return f"{shown} and {len(names) - 5} more" if len(names) > 5 else shown


def _short(value: Any) -> str:
    text = "-" if value is None else str(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _table(*columns: str) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(Text(column), overflow="fold")
    return table


def _row(table: Table, *cells: str) -> None:
    from rich.text import Text

    table.add_row(*(Text(cell) for cell in cells))


def _document(found: Comparison) -> dict[str, Any]:
    """Returns the JSON document: all signals that differ, and the number of signals compared."""
    return {
        "equal": found.equal,
        "compared": len(found.signals),
        "signals": [_finite(asdict(signal)) for signal in found.signals if not signal.equal],
        "only": [list(names) for names in found.only],
        "times": {"common": found.common, "each": list(found.times), "spans": [list(span) for span in found.spans]},
        "packets": {name: list(counts) for name, counts in found.packets.items()},
        "manifest": {name: list(values) for name, values in found.causes.items()},
        "notes": list(found.notes),
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Returns a value for JSON. JSON has neither infinity nor NaN; they are written as text, as in XML Schema."""
    for name, value in values.items():
        if isinstance(value, float) and not math.isfinite(value):
            values[name] = "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"
    return values

"""The command itself, its two consoles, and what its verbs share: options, errors, notes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from cosim_master.errors import CosimError, SystemDescriptionError

if TYPE_CHECKING:
    from rich.table import Table

    from cosim_master.simulation import Prepared


app = typer.Typer(
    name="uav-cosim",
    help="Co-simulation of cooperating UAVs: FMUs, SSP systems, MAVLink packets over a simulated radio.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)


System = Annotated[
    str, typer.Argument(help="An .ssd, .ssp, multi-model (.json), or folder with a SystemStructure.ssd.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="COMPONENT.PARAMETER=VALUE", help="Override a start value; may be repeated."),
]
Until = Annotated[float | None, typer.Option(help="Stop time in s; default: the system's DefaultExperiment.")]
Variant = Annotated[
    str | None, typer.Option(help="Which .ssd of an archive or folder: its name. Default: SystemStructure.ssd.")
]
Step = Annotated[float | None, typer.Option(help="Step size in s where neither system nor FMU names one.")]


@contextmanager
def errors() -> Iterator[None]:
    """Our own errors become a message and an exit code; everything else is a bug and keeps its traceback."""
    try:
        yield
    except SystemDescriptionError as error:
        for problem in error.problems:
            err.print(f"error: {problem}", markup=False)
        raise typer.Exit(2) from None
    except CosimError as error:
        err.print(f"error: {error}", markup=False)
        raise typer.Exit(1) from None


def usage(message: str) -> typer.Exit:
    err.print(f"error: {message}", markup=False)
    return typer.Exit(2)


def note(text: str) -> None:
    err.print(f"note: {text}", markup=False)


def print_notes(ready: Prepared) -> None:
    for text in ready.notes:
        note(text)


def print_tables(tables: Iterator[Table | str]) -> None:
    if not out.is_terminal:
        out.width = 10_000  # a file or a pipe has no width: one line per row
    for table in tables:
        out.print(table, markup=False) if isinstance(table, str) else out.print(table)


def overrides(settings: list[str] | None) -> dict[str, str]:
    found = {}
    for setting in settings or []:
        name, equals, value = setting.partition("=")
        if not equals or not name.strip():
            raise usage(f"--set {setting}: write COMPONENT.PARAMETER=VALUE")
        found[name.strip()] = value.strip()
    return found


def changes(settings: list[str] | None) -> list[tuple[float, str, str]]:
    found = []
    for setting in settings or []:
        time, _, rest = setting.strip().partition(" ")
        name, equals, value = rest.partition("=")
        try:
            if not equals or not name.strip():
                raise ValueError
            found.append((float(time), name.strip(), value.strip()))
        except ValueError:
            raise usage(f"--at {setting}: write --at TIME COMPONENT.PARAMETER=VALUE") from None
    return found

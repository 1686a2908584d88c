"""Options that several verbs share, and the parsing of their values."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from cosim_master.cli.terminal.console import usage

__all__ = [
    "Json",
    "PartitionFile",
    "Partitions",
    "Settings",
    "Step",
    "Strict",
    "System",
    "Until",
    "Variant",
    "changes",
    "overrides",
    "positive",
]


def positive(option: str, meaning: str) -> Callable[[float | None], float | None]:
    """Returns the callback of an option whose number must be positive and finite.

    Args:
        option: its name.
        meaning: the expected value, as in "give a step size in s".
    """

    def check(value: float | None) -> float | None:
        if value is not None and not 0.0 < value < math.inf:
            raise usage(f"{option} {value:g}: give {meaning}, a positive number")
        return value

    return check


System = Annotated[
    str,
    typer.Argument(
        metavar="SYSTEM",
        help="The name of a shipped system (line5), an .ssd, .ssp, .fmu, multi-model (.json), OspSystemStructure.xml "
        "or .msim, or a folder with a SystemStructure.ssd.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="COMPONENT.PARAMETER=VALUE",
        help="Override a start value, by name or pattern ('drone*.vehicle.mass=2'), or a setting of radio, "
        "recording or master (network.loss=0.2); may be repeated.",
    ),
]
Until = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        help="Stop time in s.",
        show_default="the system's DefaultExperiment",
        callback=positive("--until", "a stop time in s"),
    ),
]
Variant = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Which .ssd of an archive or folder: its name.", show_default="SystemStructure.ssd"
    ),
]
Step = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        help="Step size in s of all FMUs.",
        show_default="that of the system, else what each FMU proposes",
        callback=positive("--step", "a step size in s"),
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict",
        help="What breaks a rule of a standard is an error; findings about the swarm make the exit code 1.",
        show_default=False,
    ),
]
Partitions = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="Parts that run in processes of their own, on this machine or several.",
        show_default="one process",
    ),
]
PartitionFile = Annotated[
    Path | None,
    typer.Option(
        "--partition-file",
        metavar="FILE.json",
        help="The part and the machine of each unit.",
        show_default="as few radio links between parts as possible",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead.", show_default=False)]


def overrides(settings: list[str] | None) -> dict[str, str]:
    """Returns start values by name or pattern, from texts COMPONENT.PARAMETER=VALUE; later texts take precedence."""
    found: dict[str, str] = {}
    for setting in settings or []:
        name, equals, value = setting.partition("=")
        if not equals or not name.strip():
            raise usage(f"--set {setting}: write COMPONENT.PARAMETER=VALUE")
        found.pop(name.strip(), None)  # so that it also overrides the patterns in between
        found[name.strip()] = value.strip()
    return found


def changes(settings: list[str] | None) -> list[tuple[float, str, str]]:
    """Returns tuples (time in s, hierarchical name, value), parsed from texts TIME COMPONENT.PARAMETER=VALUE."""
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

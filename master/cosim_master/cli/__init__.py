"""The command `uav-cosim`. Its verbs alone print; heavy modules are imported by the verbs that need them.

Exit codes: 0 done, 1 a run failed, 2 a bad description or bad usage.
"""

from __future__ import annotations

import logging
import sys
from typing import Annotated

import typer

from cosim_master.cli import build, results, run, systems  # noqa: F401 (their verbs)
from cosim_master.cli.console import app, err, out

__all__ = ["app", "err", "main", "out"]


@app.callback()
def options(
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Show what FMUs log.")] = False,
) -> None:
    """Co-simulation of cooperating UAVs: FMUs, SSP systems, MAVLink packets over a simulated radio."""
    logging.basicConfig(level=logging.DEBUG if verbose else logging.WARNING, stream=sys.stderr, format="%(message)s")
    for noisy in ("numba", "matplotlib", "fmpy", "pythonfmu"):
        logging.getLogger(noisy).setLevel(logging.WARNING)


def main() -> None:
    """Entry point of the command."""
    app(_joined(sys.argv[1:]))


def _joined(arguments: list[str]) -> list[str]:
    """The two words after --at as one: Typer has no options that may be repeated and take two."""
    joined: list[str] = []
    for argument in arguments:
        if len(joined) > 1 and joined[-2] == "--at" and " " not in joined[-1]:
            joined[-1] += f" {argument}"
        else:
            joined.append(argument)
    return joined

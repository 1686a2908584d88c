"""The command `uav-cosim`. Its verbs alone print; heavy modules are imported by the verbs that need them.

    console   standard output and standard error: data, words, notes, errors
    verbs     the command itself, and the decorator that makes a function a verb
    options   options that several verbs have
    progress  what a verb is doing, while it takes long
    build, run, systems, editing, pack, results, compare   the verbs

Exit codes: 0 done, 1 a run failed, 2 a bad description or bad usage, 130 interrupted by Ctrl-C.
"""

from __future__ import annotations

import sys

from cosim_master.cli import build, compare, editing, pack, results, run, systems  # noqa: F401 (their verbs)
from cosim_master.cli.console import err, out
from cosim_master.cli.verbs import app

__all__ = ["app", "err", "main", "out"]


def main() -> None:
    """Entry point of the command."""
    app(_joined(sys.argv[1:]))


def _joined(arguments: list[str]) -> list[str]:
    """The two words after --at as one, and a word after --reference: Typer has no options like these."""
    joined: list[str] = []
    for i, argument in enumerate(arguments):
        if argument == "--reference" and not (i + 1 < len(arguments) and arguments[i + 1].lower().endswith(".csv")):
            joined.append(f"--reference={systems.BROUGHT_ALONG}")
            continue
        if len(joined) > 1 and joined[-2] == "--at" and " " not in joined[-1]:
            joined[-1] += f" {argument}"
        else:
            joined.append(argument)
    return joined

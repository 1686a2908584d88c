"""The command `uav-cosim`. Only its verbs print; each imports the heavy modules that it needs.

    verbs/      one module for each group of verbs
    views/      tables and texts that they print
    terminal/   console (standard output and standard error), options that several verbs have, progress,
                registry (the command itself, and the decorator that makes a function a verb)
    reference   docs/command-line.md, written from the command

Exit codes: 0 done, 1 a run failed, 2 a bad description or bad usage, 130 interrupted by Ctrl-C.
"""

from __future__ import annotations

import atexit
import gc
import sys

from cosim_master.cli.terminal.console import err, out
from cosim_master.cli.terminal.registry import app
from cosim_master.cli.verbs import build, compare, editing, pack, results, run, serve, sweep, systems  # noqa: F401

__all__ = ["app", "err", "main", "out"]


def main() -> None:
    """Runs the command.

    What it imports stays until its end. Python's own limits have it looked through for garbage again and again, and
    once more at the end, which takes a fifth of the processor time of a short run.
    """
    gc.set_threshold(50_000, 20, 50)
    atexit.register(gc.freeze)
    app(_joined(sys.argv[1:]))


def _joined(arguments: list[str]) -> list[str]:
    """Joins the two words after --at, and replaces the word after --reference; Typer does not support such options."""
    joined: list[str] = []
    for i, argument in enumerate(arguments):
        if argument == "--reference" and not (i + 1 < len(arguments) and arguments[i + 1].lower().endswith(".csv")):
            joined.append(f"--reference={systems.BROUGHT_ALONG}")
            continue
        # A value is left out where an option follows; the verb then says what is missing.
        if len(joined) > 1 and joined[-2] == "--at" and " " not in joined[-1] and not argument.startswith("-"):
            joined[-1] += f" {argument}"
        else:
            joined.append(argument)
    return joined

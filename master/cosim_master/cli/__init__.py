"""The command `uav-cosim`. Only its verbs print; each imports the heavy modules that it needs.

    verbs/      one module for each group of verbs
    views/      tables and texts that they print
    terminal/   console (standard output and standard error), options that several verbs have, progress,
                Ctrl-C before a verb begins, registry (the command itself, and the decorator that makes a function
                a verb)
    reference   docs/command-line.md, written from the command

Exit codes: 0 done, 1 a run failed, 2 a bad description or bad usage, 130 interrupted by Ctrl-C.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress
from io import TextIOWrapper
from itertools import pairwise
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim_master.cli.terminal.console import err as err
    from cosim_master.cli.terminal.console import out as out
    from cosim_master.cli.terminal.registry import app as app

__all__ = ["app", "err", "main", "out"]


def main() -> None:
    """Runs the command.

    What it imports stays until its end. Python's own limits have it looked through for garbage again and again, and
    once more at the end, which takes a fifth of the processor time of a short run.

    numpy's BLAS computes in one thread unless OPENBLAS_NUM_THREADS says otherwise: sums in several have bits that
    depend on their number, which matters to FMUs with numpy, and they wait by computing.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is imported
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names that its encoding lacks are printed as Python escapes them
            with suppress(OSError):  # a terminal opened for reading, too
                stream.reconfigure(errors="backslashreplace")
    gc.set_threshold(200_000, 20, 50)
    atexit.register(gc.freeze)
    from cosim_master.cli.terminal.ctrl_c import ends_process

    ends_process()
    app = __getattr__("app")
    _refuse_no_name(sys.argv[1:])
    if "UAV_COSIM_EXIT_CODE" in os.environ:  # of a part of a run
        from cosim_master.cli.terminal.launching import exit_code_told

        with exit_code_told():
            _run(app)
    else:
        _run(app)


def __getattr__(name: str) -> Any:
    """Returns the command or one of its consoles, which `main` imports only when Ctrl-C is in its hands."""
    if name == "app":
        from cosim_master.cli.terminal.registry import app
        from cosim_master.cli.verbs import build, compare, editing, pack, results, run, serve, sweep, systems  # noqa: F401

        return app
    if name in ("err", "out"):
        from cosim_master.cli.terminal import console

        return getattr(console, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _run(app: Any) -> None:
    from cosim_master.cli.terminal.console import OutputFailed, report_error

    try:
        app(_joined(sys.argv[1:]))
    except OutputFailed as error:  # of --help or --version; verbs have ended by themselves
        report_error(str(error))
        sys.exit(1)
    except SystemExit as end:
        if end.code == 130:  # it was asked to end; timeout(1) asks twice, the second time while Python ends
            for name in {"SIGINT", "SIGTERM", "SIGHUP"} & {*signal.Signals.__members__}:
                signal.signal(signal.Signals[name], signal.SIG_IGN)
        raise


def _refuse_no_name(arguments: list[str]) -> None:
    """Ends the command if its output has an empty name, which Typer would take for the current folder."""
    from cosim_master.cli.terminal.console import report_error

    for option, value in pairwise([*arguments, None]):
        if option == "--out=" or (option in ("-o", "--out") and value == ""):
            report_error('-o "": the name is empty, as that of a shell variable that is not set; try . for this folder')
            sys.exit(2)


def _joined(arguments: list[str]) -> list[str]:
    """Joins the two words after --at, and replaces the word after --reference; Typer does not support such options."""
    from cosim_master.cli.verbs.systems import BROUGHT_ALONG

    joined: list[str] = []
    for i, argument in enumerate(arguments):
        if argument == "--reference" and not (i + 1 < len(arguments) and arguments[i + 1].lower().endswith(".csv")):
            joined.append(f"--reference={BROUGHT_ALONG}")
            continue
        # A value is left out where an option follows; the verb then says what is missing.
        if len(joined) > 1 and joined[-2] == "--at" and " " not in joined[-1] and not argument.startswith("-"):
            joined[-1] += f" {argument}"
        else:
            joined.append(argument)
    return joined

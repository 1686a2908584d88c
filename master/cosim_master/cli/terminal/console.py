"""The two consoles of the command and the four kinds of output of its verbs: data, words, notes, errors.

    data    the requested data: standard output, always; with --json one JSON document
    words   the results of a verb in words: standard output; -q leaves them out
    notes   assumptions and other remarks: standard error, dim; -q leaves them out
    errors  standard error, always; with --json also `{"errors": [...]}` on standard output

Colours follow NO_COLOR (none, whatever else is set) and FORCE_COLOR (also into a pipe).
"""

from __future__ import annotations

import json
import logging
import os
import re
import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.text import Text

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, within_bounds

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "OutputFailed",
    "announce",
    "begin_verb",
    "command",
    "end_verb",
    "err",
    "errors",
    "is_live",
    "is_quiet",
    "note",
    "notes",
    "out",
    "print_json",
    "print_tables",
    "report_error",
    "say",
    "set_verbosity",
    "usage",
    "written",
]


def _console(*, stderr: bool) -> Console:
    # NO_COLOR alone would keep Rich's bold and dim styles, so all styles are turned off.
    system = None if os.environ.get("NO_COLOR") else "auto"
    return Console(stderr=stderr, highlight=False, soft_wrap=True, color_system=system)  # type: ignore[arg-type]


out = _console(stderr=False)
err = _console(stderr=True)


@dataclass(slots=True)
class _Verbosity:
    quiet: bool = False
    verbose: bool = False


@dataclass(slots=True)
class _Spoken:
    """The output of the current verb so far: its errors, and whether its JSON document has been printed."""

    errors: list[dict[str, Any]] = field(default_factory=list)
    document: bool = False


class OutputFailed(Exception):
    """Standard output cannot be written: it is a file on a full disk, for example. A pipe without a reader is not."""


_verbosity = _Verbosity()
_spoken = _Spoken()


class _Log(logging.Handler):
    """Writes log records to standard error through the console, so that they do not overwrite a progress bar there."""

    def emit(self, record: logging.LogRecord) -> None:
        err.print(self.format(record), markup=False)


def set_verbosity(*, quiet: bool | None = None, verbose: bool | None = None) -> None:
    """Sets the verbosity of -q and -v; None leaves it unchanged. With `verbose`, messages logged by FMUs are shown."""
    if quiet is not None:
        _verbosity.quiet = quiet
    if verbose is not None:
        _verbosity.verbose = verbose
        handlers = [handler for handler in logging.getLogger().handlers if isinstance(handler, _Log)]
        if not handlers:
            logging.getLogger().addHandler(_Log())
        logging.getLogger().setLevel(logging.DEBUG if verbose else logging.WARNING)
        for noisy in ("numba", "matplotlib", "fmpy", "pythonfmu"):
            logging.getLogger(noisy).setLevel(logging.WARNING)


def is_quiet() -> bool:
    """Returns whether only data and errors are printed."""
    return _verbosity.quiet


def is_live() -> bool:
    """Returns whether standard error is a terminal on which a line can be redrawn."""
    return err.file.isatty() and err.is_terminal and not err.is_dumb_terminal


@contextmanager
def written() -> Iterator[None]:
    """Raises OutputFailed if standard output cannot be written."""
    try:
        yield
    except BrokenPipeError:  # the reader has had enough, as `head` has
        raise
    except OSError as error:
        with suppress(OSError):  # what is left in buffers goes nowhere: Python would fail with it at its end
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, out.file.fileno())
            os.close(nowhere)
        raise OutputFailed(f"standard output: cannot be written: {error.strerror or error}") from None


def say(text: str) -> None:
    """Prints the result of a verb, unless -q is set."""
    if not _verbosity.quiet:
        with written():
            out.print(text, markup=False)


def command(*words: object) -> str:
    """Returns a call of this command as it can be copied into a shell: names with blanks are in quotes."""
    return shlex.join(("uav-cosim", *map(str, words)))


def note(text: str) -> None:
    """Prints an assumption or another note, unless -q is set."""
    if not _verbosity.quiet:
        err.print(Text.assemble(("note:", "bold dim"), (f" {text}", "dim")))


def announce(text: str) -> None:
    """Prints a line that the user needs, on standard error, also if -q is set."""
    err.print(Text(text), soft_wrap=True)


def notes(texts: Iterable[str]) -> None:
    """Prints several notes. Of findings of the same kind, only the first few are printed."""
    for text in within_bounds(texts):
        note(text)


def print_json(document: Any) -> None:
    """Prints the JSON document of a verb."""
    _spoken.document = True
    is_unicode = str(getattr(out.file, "encoding", None) or "utf-8").lower().replace("-", "") == "utf8"
    text = json.dumps(document, indent=1, ensure_ascii=not is_unicode, allow_nan=False)
    with written():
        out.print(text, markup=False)


def print_tables(tables: Iterable[Table | str]) -> None:
    """Prints tables and lines; tables are not truncated if standard output is not a terminal."""
    if not out.is_terminal:
        out.width = 10_000  # a file or a pipe has no width, so each row is one line
    for table in tables:
        with written():
            out.print(table, markup=False) if isinstance(table, str) else out.print(table)


def report_error(text: str) -> None:
    """Prints an error, or several, which begin with their places in sources of Python."""
    for one in _separate(text):
        _spoken.errors.append(_in_json(one))
        err.print(Text.assemble(("error:", "bold red"), f" {one}"))


_PLACE = re.compile(r"(?:(\w+: ))?((?:[A-Za-z]:)?[^:\s][^:\n]*\.py):(\d+): (.+)", re.DOTALL)
"""A place in a source of Python at the beginning of an error, maybe behind a name: "Gauge: gauge.py:14: ..."."""


def _separate(text: str) -> list[str]:
    """Returns the errors in a text: each begins with a place; lines without one belong to the error before."""
    found: list[str] = []
    for line in text.split("\n"):
        if not found or _PLACE.fullmatch(line):
            found.append(line)
        else:
            found[-1] += f"\n{line}"
    return found


def _in_json(text: str) -> dict[str, Any]:
    if (placed := _PLACE.fullmatch(text)) is None:
        return {"file": None, "line": None, "message": text}
    name, file, line, message = placed.groups()
    return {"file": file, "line": int(line), "message": f"{name or ''}{message}"}


def usage(message: str) -> typer.Exit:
    """Prints a message about invalid usage and returns the exit of the verb."""
    report_error(message)
    return typer.Exit(2)


@contextmanager
def errors(*, as_json: bool = False) -> Iterator[None]:
    """Turns the project's own errors into messages and an exit code; other exceptions are bugs, with a traceback.

    Args:
        as_json: also print the errors as a JSON document.
    """
    try:
        yield
    except SystemDescriptionError as error:
        for problem in error.problems:
            report_error(str(problem))
        if as_json:
            print_json({"errors": [_error(problem) for problem in error.problems]})
        raise typer.Exit(2) from None
    except CosimError as error:
        report_error(str(error))
        if as_json:
            print_json({"errors": [{"file": None, "line": None, "message": str(error)}]})
        raise typer.Exit(1) from None
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in _EXTRAS:
            raise
        raise usage(f"{package} is not installed; try pip install 'uav-cosim[{_EXTRAS[package]}]'") from None


_EXTRAS = {
    "av": "film",
    "cyclonedds": "ros2",
    **dict.fromkeys(("foxglove", "gpxpy", "rosbags", "scipy"), "export"),
    **dict.fromkeys(("matplotlib", "PIL"), "plot"),
    "pymavlink": "build",
    **dict.fromkeys(("rerun", "rerun_cli"), "rerun"),
    **dict.fromkeys(("SALib", "cryptography", "dask", "distributed", "optuna"), "sweep"),
    "websockets": "live",
}
"""Packages that an extra of this project installs."""


def begin_verb() -> None:
    """Clears the record of the previous verb of this process."""
    _spoken.errors.clear()
    _spoken.document = False


def end_verb() -> None:
    """Prints the errors of a verb as its JSON document, if it ended without printing one."""
    if _spoken.errors and not _spoken.document:
        print_json({"errors": list(_spoken.errors)})


def _error(problem: Problem) -> dict[str, Any]:
    return {"file": problem.where.path, "line": problem.where.line, "message": problem.message}

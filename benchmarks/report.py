"""What all benchmarks share: on what they ran, a table on the terminal, the same numbers as JSON."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

__all__ = ["machine", "section", "show", "write"]


def machine(*packages: str) -> dict[str, Any]:
    """Processor, cores, load and the versions of Python and of `packages` (None: not installed)."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    for name in ("uav-cosim", "numba", *packages):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    return {"processor": _processor(), "cores": os.cpu_count(), "load": os.getloadavg()[0], "versions": versions}


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def show(title: str, host: dict[str, Any], columns: Sequence[str], rows: Sequence[Sequence[str]], note: str) -> None:
    """Print one table; the first column is text, the others are numbers."""
    console = Console(width=None if Console().is_terminal else 140, highlight=False)
    versions = ", ".join(f"{name} {number}" for name, number in host["versions"].items() if number)
    console.print(f"[bold]{title}[/bold]")
    console.print(f"{host['processor']}, {host['cores']} cores, load {host['load']:.1f}; {versions}")
    table = Table(*columns[:1])
    for name in columns[1:]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    console.print(note)


def section(file: Path, name: str, script: str, lines: Sequence[str]) -> None:
    """Replaces the section of a document that a benchmark writes, or adds it."""
    begin, end = f"<!-- {name}: written by benchmarks/{script}.py -->", f"<!-- end of {name} -->"
    text = file.read_text(encoding="utf-8")
    if begin not in text:
        text += f"\n{begin}\n{end}\n"
    head, rest = text.split(begin)[0], text.split(end, 1)[1]
    file.write_text(head + "\n".join([begin, *lines, end]) + rest, encoding="utf-8")


def write(file: Path | None, host: dict[str, Any], results: dict[str, Any]) -> None:
    """Machine and results into `file`, where one was asked for."""
    if file is not None:
        file.write_text(json.dumps({"machine": host, **results}, indent=1) + "\n", encoding="utf-8")

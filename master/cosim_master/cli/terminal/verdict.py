"""Reports the verdict on a swarm for `run` and `check`: a table on standard error, and part of a line.

Failures and warnings are also shown with -q: a quiet run that failed must not look like one that succeeded.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from cosim_master.cli.terminal.console import err, is_quiet

if TYPE_CHECKING:
    from cosim_master.verdict.findings import Judgement

__all__ = ["show_findings", "summary"]

_SHOWN = 5
_STYLES = {"failure": "bold red", "warning": "yellow", "note": "dim"}


def show_findings(verdict: Judgement | None) -> None:
    """Prints the first few findings of each kind. With -q, notes are left out."""
    if verdict is None:
        return
    findings = [one for one in verdict.findings if one.severity != "note" or not is_quiet()]
    if not findings:
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("finding", "time [s]", "about", ""):
        table.add_column(Text(column), justify="right" if column == "time [s]" else "left", no_wrap=column != "")
    shown: Counter[tuple[str, str]] = Counter()
    for finding in findings:
        key = (finding.kind, finding.severity)
        shown[key] += 1
        if shown[key] <= _SHOWN:
            time = "" if finding.time is None else f"{finding.time:.1f}"
            how_bad = Text(finding.severity, style=_STYLES[finding.severity])
            table.add_row(how_bad, time, Text(finding.kind), Text(finding.text))
    for (kind, severity), count in shown.items():
        if count > _SHOWN:
            more = f"and {count - _SHOWN} more; manifest.json has all"
            table.add_row(Text(severity, style=_STYLES[severity]), "", Text(kind), Text(more))
    width = err.width
    if not err.is_terminal:
        err.width = 10_000  # a file or a pipe has no width, so each row is one line
    err.print(table, soft_wrap=False)
    err.width = width


def summary(verdict: Judgement | None) -> str:
    """Returns text such as ", 2 findings (1 agent failed, 1 never flew)", which is empty if there are no findings."""
    findings = [] if verdict is None else [one for one in verdict.findings if one.severity != "note"]
    if not findings:
        return ""
    kinds = ", ".join(f"{n} {kind}" for kind, n in Counter(one.kind for one in findings).items())
    return f", {len(findings)} finding{'s' if len(findings) > 1 else ''} ({kinds})"

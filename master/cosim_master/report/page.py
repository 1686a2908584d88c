"""The HTML document of a report: one self-contained file without scripts, which does not request any other resource."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path

from cosim_master.diagnostics.errors import counted
from cosim_master.report import contents
from cosim_master.report.contents import Run, Table
from cosim_master.report.markup import escaped, image, table, write_document
from cosim_master.report.structure import draw_structure
from cosim_master.results.figures.draw import drawn
from cosim_master.results.storage.run_folder import stamp

__all__ = ["write_report"]


def write_report(runs: Sequence[Path], file: Path | None = None) -> Path:
    """Writes a report on a run, or one that compares several.

    Args:
        runs: folders of the runs.
        file: the file to write; its folder is created if necessary. None: report.html in the folder of the first run.

    Returns:
        The file written.

    Raises:
        CosimError: a folder has no complete run, or the file cannot be written.
    """
    file = file or runs[0] / "report.html"
    read = [contents.read_run(folder) for folder in runs]
    title = "Report: " + ", ".join(dict.fromkeys(run.name for run in read))
    return write_document(file, title, stamp(runs[0]), _body(read))


def _body(runs: Sequence[Run]) -> Iterator[str]:
    if len(runs) == 1:
        yield from _report(runs[0], "h1")
        return
    yield f"<h1>{len(runs)} runs compared</h1>"
    for one in contents.differences(runs):
        yield from table(one)
    for number, run in enumerate(runs, 1):
        yield from _report(run, "h1", number)


def _report(run: Run, heading: str, number: int = 1) -> Iterator[str]:
    text, kind = _outcome(run)
    yield f'<{heading}>{escaped(run.name)} <span class="badge {kind}">{escaped(text)}</span></{heading}>'
    path = str((run.manifest.get("system") or {}).get("path", ""))
    yield f'<p class="where">{escaped(str(run.folder))}, a run of {escaped(path)}</p>'
    yield from table(Table("Summary", (), contents.summary(run)))
    found = contents.findings(run)
    yield from table(found) if found.rows else ["<h2>Findings</h2>", "<p>The verdict has no findings.</p>"]
    yield "<h2>System</h2>"
    yield image(draw_structure(run.manifest).encode("utf-8", "replace"), "svg+xml", "FMUs and radio")
    yield "<h2>Figures</h2>"
    yield from _figures(run)
    tables = (contents.agents(run), contents.links(run), contents.parameters(run), *contents.timing(run))
    for optional in (*tables, contents.origins(run)):
        if optional is not None:
            yield from table(optional)
    if notes := run.manifest.get("notes"):
        yield "<h2>Notes</h2><ul>" + "".join(f"<li>{escaped(str(note))}</li>" for note in notes[:50]) + "</ul>"
    yield f'<h2 id="repeat{number}">Repeat this run</h2>'
    yield f"<pre>{escaped(contents.repetition(run))}</pre>"
    if programs := contents.programs(run):
        text = f"Packets that real programs sent through {', '.join(programs)} are not repeated."
        yield f"<p>{escaped(text)}</p>"


def _outcome(run: Run) -> tuple[str, str]:
    """Returns the outcome in words, and its class in the style sheet."""
    verdict = run.manifest.get("verdict") or {}
    outcome = str(run.manifest.get("outcome", ""))
    if outcome != "done" or verdict.get("failures"):
        return outcome if outcome != "done" else f"done, {counted(verdict['failures'], 'failure')}", "failure"
    if verdict.get("warnings"):
        return f"done, {counted(verdict['warnings'], 'warning')}", "warning"
    return "done", "good"


def _figures(run: Run) -> Iterator[str]:
    if run.flight is None:
        yield "<p>The run recorded no positions of vehicles.</p>"
        return
    yield '<div class="figures">'
    for name, figure in drawn(run.folder):
        written = BytesIO()
        figure.savefig(written, format="svg", metadata={"Date": None})
        yield image(written.getvalue(), "svg+xml", name)
    yield "</div>"

"""The HTML document of a report: one self-contained file without scripts, which does not request any other resource.

All text of a run (names, messages, paths) is escaped. Figures are images in the document: markup in their texts has no
effect. A Content-Security-Policy allows only the style sheet, by its digest, and these images.
"""

from __future__ import annotations

import hashlib
import html
from base64 import b64encode
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path

from cosim_master.diagnostics.errors import CosimError
from cosim_master.report import contents
from cosim_master.report.contents import Run, Table
from cosim_master.report.structure import draw_structure
from cosim_master.results.figures.draw import drawn
from cosim_master.results.storage.run_folder import stamp

__all__ = ["write_report"]

_STYLE = """
:root{color-scheme:light dark}
body{font:15px/1.45 system-ui,sans-serif;max-width:76rem;margin:0 auto;padding:1rem 2rem 4rem}
body{color:#1b1b1b;background:#fff}
h1{font-size:1.7rem;margin:.6rem 0}h2{font-size:1.25rem;margin:2.2rem 0 .6rem;border-bottom:1px solid #ccc}
h3{font-size:1rem;margin:1.4rem 0 .4rem}
table{border-collapse:collapse;margin:.4rem 0}th,td{text-align:left;padding:.18rem .9rem .18rem 0;vertical-align:top}
th{border-bottom:1px solid #999;font-weight:600}td{border-bottom:1px solid #eee;overflow-wrap:anywhere}
.badge{display:inline-block;padding:.1rem .7rem;border-radius:1rem;color:#fff;font-size:1rem}
.good{background:#00704d}.warning{background:#8a5a00}.failure{background:#a8281e}
.note,.where{color:#666}pre{background:#f3f3f3;padding:.7rem;white-space:pre-wrap;overflow-wrap:anywhere}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(30rem,1fr));gap:1rem}
figure{margin:0;background:#fff}figcaption{color:#666;font-size:.85rem}img{max-width:100%;height:auto;background:#fff}
nav a{margin-right:1rem}
@media (prefers-color-scheme:dark){body{color:#ddd;background:#161616}td{border-color:#333}pre{background:#222}
.note,.where,figcaption{color:#999}a{color:#8ab4f8}}
@media print{body{max-width:none}figure,table{break-inside:avoid}}
"""
_DOCUMENT = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'sha256-{digest}'; img-src data:; \
base-uri 'none'; form-action 'none'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<meta name="source" content="{source}">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}
</body>
</html>
"""


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
    text = _DOCUMENT.format(
        digest=b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode(),
        source=_escaped(stamp(runs[0])),
        title=_escaped(title),
        style=_STYLE,
        body="\n".join(_body(read)),
    )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise CosimError(f"{file}: the report cannot be written: {error.strerror or error}") from error
    return file


def _escaped(text: str) -> str:
    """Returns text for markup; characters that are not printable become spaces."""
    return html.escape("".join(c if c.isprintable() or c == "\n" else " " for c in text))


def _body(runs: Sequence[Run]) -> Iterator[str]:
    if len(runs) == 1:
        yield from _report(runs[0], "h1")
        return
    yield f"<h1>{len(runs)} runs compared</h1>"
    for table in contents.differences(runs):
        yield from _table(table)
    for number, run in enumerate(runs, 1):
        yield from _report(run, "h1", number)


def _report(run: Run, heading: str, number: int = 1) -> Iterator[str]:
    text, kind = _outcome(run)
    yield f'<{heading}>{_escaped(run.name)} <span class="badge {kind}">{_escaped(text)}</span></{heading}>'
    path = str((run.manifest.get("system") or {}).get("path", ""))
    yield f'<p class="where">{_escaped(str(run.folder))}, a run of {_escaped(path)}</p>'
    yield from _table(Table("Summary", (), contents.summary(run)))
    found = contents.findings(run)
    yield from _table(found) if found.rows else ["<h2>Findings</h2>", "<p>The verdict has no findings.</p>"]
    yield "<h2>System</h2>"
    yield _image(draw_structure(run.manifest).encode("utf-8", "replace"), "svg+xml", "FMUs and radio")
    yield "<h2>Figures</h2>"
    yield from _figures(run)
    tables = (contents.agents(run), contents.links(run), contents.parameters(run), *contents.timing(run))
    for optional in (*tables, contents.origins(run)):
        if optional is not None:
            yield from _table(optional)
    if notes := run.manifest.get("notes"):
        yield "<h2>Notes</h2><ul>" + "".join(f"<li>{_escaped(str(note))}</li>" for note in notes[:50]) + "</ul>"
    yield f'<h2 id="repeat{number}">Repeat this run</h2>'
    yield f"<pre>{_escaped(contents.repetition(run))}</pre>"


def _outcome(run: Run) -> tuple[str, str]:
    """Returns the outcome in words, and its class in the style sheet."""
    verdict = run.manifest.get("verdict") or {}
    outcome = str(run.manifest.get("outcome", ""))
    if outcome != "done" or verdict.get("failures"):
        return outcome if outcome != "done" else f"done, {contents.counted(verdict['failures'], 'failure')}", "failure"
    if verdict.get("warnings"):
        return f"done, {contents.counted(verdict['warnings'], 'warning')}", "warning"
    return "done", "good"


def _figures(run: Run) -> Iterator[str]:
    if run.flight is None:
        yield "<p>The run recorded no positions of vehicles.</p>"
        return
    yield '<div class="figures">'
    for name, figure in drawn(run.folder):
        written = BytesIO()
        figure.savefig(written, format="svg", metadata={"Date": None})
        yield _image(written.getvalue(), "svg+xml", name)
    yield "</div>"


def _image(data: bytes, kind: str, caption: str) -> str:
    source = f"data:image/{kind};base64,{b64encode(data).decode()}"
    return (
        f'<figure><img alt="{_escaped(caption)}" src="{source}"><figcaption>{_escaped(caption)}</figcaption></figure>'
    )


def _table(table: Table) -> Iterator[str]:
    yield f"<h2>{_escaped(table.title)}</h2>"
    if table.rows:
        yield "<table>"
        if table.head:
            yield "<tr>" + "".join(f"<th>{_escaped(cell)}</th>" for cell in table.head) + "</tr>"
        for row in table.rows:
            yield "<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in row) + "</tr>"
        yield "</table>"
    if table.note:
        yield f'<p class="note">{_escaped(table.note)}</p>'

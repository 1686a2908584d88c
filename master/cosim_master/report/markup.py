"""The parts of an HTML report: the document, tables and images, without scripts and without requests to the network.

All text is escaped. Figures are images in the document: markup in their texts has no effect. A Content-Security-Policy
allows only the style sheet, by its digest, and these images.
"""

from __future__ import annotations

import hashlib
import html
from base64 import b64encode
from collections.abc import Iterable, Iterator
from pathlib import Path

from cosim_master.files.whole import write_whole, writing
from cosim_master.report.contents import Table

__all__ = ["escaped", "image", "table", "write_document"]

_NAME = 40
"""Letters that a name has at most."""
_STYLE = """
:root{color-scheme:light dark}
body{font:15px/1.45 system-ui,sans-serif;max-width:76rem;margin:0 auto;padding:1rem 2rem 4rem}
body{color:#1b1b1b;background:#fff}
h1{font-size:1.7rem;margin:.6rem 0}h2{font-size:1.25rem;margin:2.2rem 0 .6rem;border-bottom:1px solid #ccc}
h3{font-size:1rem;margin:1.4rem 0 .4rem}
table{border-collapse:collapse;margin:.4rem 0}th,td{text-align:left;padding:.18rem .9rem .18rem 0;vertical-align:top}
th{border-bottom:1px solid #999;font-weight:600}td{border-bottom:1px solid #eee;overflow-wrap:anywhere}
td.name{white-space:nowrap}
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


def write_document(file: Path, title: str, source: str, body: Iterable[str]) -> Path:
    """Writes a document; the folder of the file is created if necessary.

    Args:
        source: told in the document's head: the data that it shows.
        body: lines of markup.

    Raises:
        WriteFailed: the file cannot be written.
    """
    text = _DOCUMENT.format(
        digest=b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode(),
        source=escaped(source),
        title=escaped(title),
        style=_STYLE,
        body="\n".join(body),
    )
    with writing(file, "the report"):
        write_whole(file, text.encode("utf-8", errors="replace"))
    return file


def escaped(text: str) -> str:
    """Returns text for markup; characters that are not printable become spaces."""
    return html.escape("".join(c if c.isprintable() or c == "\n" else " " for c in text))


def image(data: bytes, kind: str, caption: str) -> str:
    """Returns the markup of an image with its caption."""
    source = f"data:image/{kind};base64,{b64encode(data).decode()}"
    return f'<figure><img alt="{escaped(caption)}" src="{source}"><figcaption>{escaped(caption)}</figcaption></figure>'


def _cell(text: str) -> str:
    """Returns the markup of a cell; a name is not broken beside a long text, other words are if they must."""
    kind = ' class="name"' if len(text) <= _NAME and not any(map(str.isspace, text)) else ""
    return f"<td{kind}>{escaped(text)}</td>"


def table(told: Table) -> Iterator[str]:
    """Yields the markup of a table."""
    yield f"<h2>{escaped(told.title)}</h2>"
    if told.rows:
        yield "<table>"
        if told.head:
            yield "<tr>" + "".join(f"<th>{escaped(cell)}</th>" for cell in told.head) + "</tr>"
        for row in told.rows:
            yield "<tr>" + "".join(map(_cell, row)) + "</tr>"
        yield "</table>"
    if told.note:
        yield f'<p class="note">{escaped(told.note)}</p>'

"""The HTML document that shows a run: one self-contained file, which does not request any other resource.

Its Content-Security-Policy allows only the embedded script and style sheet, by their digests, and no network
connection, except to the run that a live page shows. The recording is base64 of compressed bytes, so no part of it can
be interpreted as markup.
"""

from __future__ import annotations

import hashlib
import html
import json
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cosim_master.files.whole import write_whole, writing
from cosim_master.results.storage.run_folder import stamp
from cosim_master.view.block import compressed
from cosim_master.view.bundle import read_bundle
from cosim_master.view.replay import replay

__all__ = ["page_text", "write_page"]

_DOCUMENT = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{rules}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<meta name="source" content="{source}">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body>
{body}
<script type="text/plain" id="run">{run}</script>
<script type="text/plain" id="data">{data}</script>
<script>{script}</script>
</body>
</html>
"""
_RULES = (
    "default-src 'none'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; img-src data:; "
    "base-uri 'none'; form-action 'none'{connect}"
)


def write_page(run: Path, file: Path | None = None) -> Path:
    """Writes the page that shows a run.

    Args:
        run: folder of the run.
        file: the file to write; its folder is created if necessary. None: view.html in the folder of the run.

    Returns:
        The file written.

    Raises:
        CosimError: the run is not complete or recorded nothing.
        WriteFailed: the file cannot be written.
    """
    file = file or run / "view.html"
    document, block = replay(run)
    text = page_text(document, block.text(), source=stamp(run))
    with writing(file, "the page"):
        write_whole(file, text.encode())
    return file


def page_text(document: Mapping[str, Any], data: str, *, source: str = "", connect: str = "") -> str:
    """Returns the HTML document.

    Args:
        document: the run, as `replay` or `live_document` returns it.
        data: the text of the block with its arrays.
        source: identifies the run.
        connect: the only address to which the page may connect.
    """
    bundle = read_bundle()
    rules = _RULES.format(
        script=_digest(bundle.script),
        style=_digest(bundle.style),
        connect=f"; connect-src {connect}" if connect else "",
    )
    return _DOCUMENT.format(
        rules=rules,
        source=html.escape(source),
        title=html.escape("".join(c if c.isprintable() else " " for c in f"{document['name']} - uav-cosim")),
        style=bundle.style,
        body=bundle.body,
        run=compressed(
            json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8", "replace")
        ),
        data=data,
        script=bundle.script,
    )


def _digest(text: str) -> str:
    return b64encode(hashlib.sha256(text.encode()).digest()).decode()

"""The bundle of the page: output of `npm ci` and `node build.mjs ../bundle` in page/, as files of this package.

The bundle is part of the repository, so users and developers can do without Node. It contains the digest
of the sources that it was built from; `digest_of_sources` computes the same digest as page/build.mjs.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

__all__ = ["Bundle", "digest_of_sources", "read_bundle"]


@dataclass(frozen=True, slots=True)
class Bundle:
    """The parts of the page that are the same for every run."""

    script: str
    style: str
    body: str
    digest: str


def read_bundle() -> Bundle:
    """Returns the bundle that is installed."""
    folder = files(__package__) / "bundle"
    script, style, body, digest = (
        (folder / name).read_text(encoding="utf-8") for name in ("viewer.js", "viewer.css", "shell.html", "digest.txt")
    )
    return Bundle(script, style, body, digest.strip())


def digest_of_sources(page: Path) -> str:
    """Returns the SHA-256 of the sources of the bundle: build script, packages with their lock file, source files."""
    digest = hashlib.sha256()
    sources = sorted(f"src/{file.name}" for file in (page / "src").iterdir())
    for name in ("build.mjs", "package.json", "package-lock.json", *sources):
        digest.update(f"{name}\n".encode())
        digest.update((page / name).read_bytes())
    return digest.hexdigest()

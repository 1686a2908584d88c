"""The documentation as a site: every link leads somewhere, and the reference has all that the code declares."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import cosim_master
from cosim_models.vehicles.rover import Rover

ROOT = Path(__file__).parents[1]


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = ["-q", "-W", "--keep-going", "-b", "html", "-c", "docs/site", "-d", str(tmp_path / "cache")]
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *command, str(ROOT), str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (built.returncode, built.stderr) == (0, "")
    ports = (tmp_path / "site/docs/site/ports.html").read_text()
    section = ports.partition('<section id="rover">')[2].partition("<section id=")[0]
    declared = {one.name for one in Rover.variables if one.role in ("parameter", "input", "output")}
    assert set(re.findall(r'<td><p><code[^>]*><span class="pre">(\w+)', section)) == declared
    errors = (tmp_path / "site/docs/site/errors.html").read_text()
    assert "RecordingFailed" in errors and "results cannot be written any more" in errors
    names = (tmp_path / "site/docs/site/python.html").read_text()
    assert set(re.findall(r'id="cosim_master\.(\w+)"', names)) == set(cosim_master.__all__)
    pages = [page.read_text() for page in (tmp_path / "site").rglob("*.html")]
    assert not [page for page in pages if re.search(r'<(script|link|img)[^>]* (src|href)="(https?:)?//', page)]

"""Lines of a shell as forks: the words, files, ends and texts are those of `bash -e`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.master.forks import Forks

LINES = """\
uav-cosim new line --drones 3 -o 'a # b'   # a comment, and it's one
ls 'a # b'
uav-cosim check nowhere
uav-cosim --version
"""


def test_lines_mean_what_they_mean_to_bash(forks: Forks, fmus: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "200"}
    mine, its = tmp_path / "mine", tmp_path / "its"
    mine.mkdir()
    its.mkdir()
    found = forks.shell(LINES, mine, environment)
    wanted = subprocess.run(
        ["bash", "-e", "-c", LINES], cwd=its, env=environment, capture_output=True, text=True, check=False
    )
    assert (found.returncode, found.stdout, found.stderr) == (wanted.returncode, wanted.stdout, wanted.stderr)
    assert found.returncode == 2 and "SystemStructure.ssd" in found.stdout and "nowhere" in found.stderr
    assert (mine / "a # b" / "SystemStructure.ssd").is_file()

"""The commands of the README and of the guides, run exactly as they are printed, in an empty folder.

A block that begins with ```sh is run line by line in one folder; ```python FILE writes that file and runs it. Blocks
marked ```sh clone are the two commands of a clone (`make demo`, `make test`), of which this test is a part. The README
runs from the clone, and from an installed wheel with FMUs, as `make wheel` makes it; the guides run from the clone,
without the commands that the README prints too. The first command of a document is a process as in a terminal; those
behind it are forks of a process that has imported the same packages (tests/master/forks.py), with the words that a
shell would give them.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from cosim.build import HOST
from cosim_master.system.shipped import digest_of_models
from tests.master.forks import Forks, forking

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(\w+)(?: ([^\n]+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
DOCUMENTS = ("README.md", "docs/ground-stations.md", "docs/systems.md")
DIFFERENT = {"uav-cosim compare out/line5 out/line5-2": 1}
"""Commands whose exit code is not 0."""


@dataclass(frozen=True, slots=True)
class Block:
    kind: str
    name: str
    text: str


def blocks(document: str) -> Iterator[Block]:
    for kind, name, text in BLOCK.findall((ROOT / document).read_text(encoding="utf-8")):
        yield Block(kind, name, text)


def commands(text: str) -> list[str]:
    """The commands of a block, without the comments behind them."""
    return [re.sub(r"\s+# .*$", "", line).strip() for line in text.splitlines() if line.strip()]


def commands_of(document: str) -> list[str]:
    return [command for block in blocks(document) if block.kind == "sh" for command in commands(block.text)]


def test_documents_have_commands() -> None:
    found = commands_of("README.md")
    assert found[:3] == ["make demo", "make test", "uav-cosim run line5"]
    assert len(found) >= 20


@pytest.mark.slow
@pytest.mark.usefixtures("fmus")
@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_command_runs_as_printed(document: str, tmp_path: Path, forks: Forks) -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    printed_before = () if document == "README.md" else commands_of("README.md")
    run_all(document, tmp_path, {**os.environ, "PATH": path}, forks, printed_before)


@pytest.mark.slow
def test_every_command_of_the_readme_runs_from_an_installed_wheel(installed: Path, fmus: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    shutil.copytree(installed, site, ignore=shutil.ignore_patterns("__pycache__"))  # others may just be importing it
    staged = site / "cosim_master" / "shipped" / "fmus"
    shutil.copytree(fmus, staged, ignore=shutil.ignore_patterns("*.fmi3.fmu"))
    (staged / "built-from").write_text(f"{HOST} {digest_of_models()}", encoding="utf-8")
    command = tmp_path / "bin" / "uav-cosim"
    command.parent.mkdir()
    command.write_text(f"#!{sys.executable}\nfrom cosim_master.cli import main\nmain()\n", encoding="utf-8")
    command.chmod(0o755)
    path = f"{command.parent}:{os.environ['PATH']}"
    folder = tmp_path / "empty"
    folder.mkdir()
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(site)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    with forking(environment) as forks:
        run_all("README.md", folder, environment, forks)


def run_all(
    document: str, folder: Path, environment: dict[str, str], forks: Forks, without: Collection[str] = ()
) -> None:
    environment["BROWSER"] = "true"  # a command that opens nothing
    first = True
    for block in blocks(document):
        if block.kind == "python":
            (folder / block.name).write_text(block.text, encoding="utf-8")
            ended(run([sys.executable, block.name], folder, environment))
        if block.kind != "sh" or block.name == "clone":
            continue
        for command in commands(block.text):
            if command in without:
                continue
            if first:
                done = run(["bash", "-c", command], folder, environment)
            else:
                done = forks.shell(command, folder, environment)
            ended(done, DIFFERENT.get(command, 0))
            first = False


def run(command: list[str], folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def ended(done: subprocess.CompletedProcess[str], code: int = 0) -> None:
    assert done.returncode == code, f"{done.args}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr

"""An FMU that crashes a process of a run in parts: the error names it, and the recording is complete."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cosim_master.results.reading.read import signals
from tests.master.conftest import Workshop
from tests.master.fmi.test_isolation import Faulties, _folder
from tests.master.parts import assigned
from tests.scenarios.test_parts_on_mpi import LIMIT, pytestmark, running

__all__ = ["pytestmark"]


@pytest.mark.alone
@pytest.mark.parametrize(("part", "fault"), [(0, "exit3"), (1, "segv")])
def test_the_instance_is_named(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, fault: str, part: int) -> None:
    system = Faulties(Workshop(tmp_path), _folder(tmp_path_factory)).system(f"{fault} fmi2DoStep 3")
    system.write_text(re.sub("<ssd:Connections>.*</ssd:Connections>", "", system.read_text(), flags=re.S))
    file = assigned(tmp_path / "parts.json", ["bad", "good"], [part, 1 - part])
    options = ("--isolate", "none", "--partition-file", str(file))
    with running(tmp_path / "out", *options, parts=2, system=str(system)) as parts:
        _, error = parts.process.communicate(timeout=LIMIT)
    cause = {"segv": "crashed (SIGSEGV) and takes", "exit3": "has called exit(3), which ends"}[fault]
    assert parts.process.returncode == 1, error
    assert f"error: bad: fmi2DoStep failed at t = 1 s: bad.fmu {cause} the process" in " ".join(error.split())
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["outcome"] == "failed"
    assert f"bad: fmi2DoStep failed at t = 1 s: bad.fmu {cause}" in json.dumps(manifest["error"])
    times = signals(tmp_path / "out")["time"].to_pylist()
    assert times == [0.0, 0.5, 1.0][: len(times)] != []

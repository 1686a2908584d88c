"""What an FMU in the process of a run was doing when the process ended without a chance to say so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cosim_master import RunOptions, simulate
from cosim_master.cli import app
from cosim_master.execution.run.faults import last_call as keeping
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.results.reading.read import signals
from cosim_master.results.storage import last_call as kept
from cosim_master.results.storage.journal import FOLDER
from tests.master.execution.run.test_crashes import Run, pytestmark, run

__all__ = ["pytestmark", "run"]

CALLS = {
    ("_exit", "fmi2DoStep 3"): (0, "bad1", 1.0),
    ("kill", "fmi2DoStep 3"): (-9, "bad1", 1.0),
    ("kill", "fmi2SetReal 4"): (-9, None, None),
    ("_exit", "fmi2GetReal 4"): (0, None, None),
    ("_exit", "fmi2SerializeFMUstate 1"): (0, "bad1", 1.0),
}
"""The exit code, the instance and the time of a fault; None is the one that the FMU itself names."""


@pytest.mark.parametrize(("fault", "function"), CALLS)
def test_the_function_that_ended_the_process_is_named(run: Run, tmp_path: Path, fault: str, function: str) -> None:
    code, instance, time = CALLS[fault, function]
    done = run(f"{fault} {function}", "--checkpoint-every", "1")
    assert done.returncode == code
    instance = instance or (tmp_path / "name").read_text()
    found = kept.last_call(tmp_path / "out")
    assert found is not None
    assert (found.instance, found.function) == (instance, function.split()[0])
    assert time is None or found.time == time
    told = f"the last call of an FMU in it was {found.function} of {instance} at t = {found.time:g} s"
    about = CliRunner().invoke(app, ["info", str(tmp_path / "out")])
    assert told in " ".join(about.output.split())
    repaired = CliRunner().invoke(app, ["repair", str(tmp_path / "out")])
    assert repaired.exit_code == 0
    assert told in " ".join(repaired.output.split())
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["outcome"] == "killed"
    assert manifest["error"].endswith(told)
    assert not (tmp_path / "out" / FOLDER).exists()
    assert signals(tmp_path / "out")["time"].to_pylist()[:1] in ([], [0.0])


@pytest.mark.parametrize("isolate", ["none", "foreign"])
def test_the_page_exists_during_the_run_only(
    run: Run, tmp_path: Path, isolate: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Calls of isolated FMUs are not kept: they cannot have ended the process of the run."""
    assert run("none none 0", "--until", "0.5").returncode == 0  # writes the system
    system = next(tmp_path.rglob("system.ssd"))
    seen: list[bool] = []

    class Looking:
        every = 1

        def __init__(self, _: Any) -> None: ...
        def initialised(self, seen: Any) -> None: ...
        def closed(self) -> None: ...
        def stepped(self, _: Any) -> None:
            seen.append((tmp_path / "here" / FOLDER / kept.NAME).exists())

    options = RunOptions(out=tmp_path / "here", isolation=Isolation(isolate))
    assert simulate(system, options, observers=[Looking]).outcome == "done"
    assert set(seen) == {isolate == "none"}
    monkeypatch.setattr(keeping, "_OVERWRITING", ())
    seen.clear()
    assert simulate(system, options, observers=[Looking]).outcome == "done"
    assert set(seen) == {False}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 4096,
        b'{"page": 0, "words": {}, "functions": {}}',
        b"\0" * 4096 + b'{"page": 4096, "words": {"running": 9999}, "functions": {}}',
        b"\1" * 4096 + kept.explained(4096, dict.fromkeys(("running", "k", "start", "base", "per_ns"), 0), {}),
        b"\0" * 4096 + kept.explained(4096, dict.fromkeys(("running", "k", "start", "base", "per_ns"), 600), {}),
        b"\0" * 4096 + b'{"page": 4096, "words": ' + b"[" * 100000,
    ],
)
def test_a_damaged_page_says_nothing(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / kept.NAME).write_bytes(content)
    assert kept.last_call(tmp_path) is None


def test_a_page_of_which_python_made_the_last_call(tmp_path: Path) -> None:
    """A call counts for the base step at which it was made."""
    words = {"running": 5, "k": 0, "start": 1, "base": 2, "per_ns": 3}
    (tmp_path / FOLDER).mkdir()
    file = tmp_path / FOLDER / kept.NAME
    for k, found in ((4, kept.LastCall("hull", "fmi3Terminate", 4.5)), (3, None)):
        page = bytearray(4096)
        page[: 8 * 6] = b"".join(n.to_bytes(8, "little") for n in (4, 500_000_000, 1_000_000_000, 1, 0, 0))
        page[kept.TEXT : kept.TEXT + kept.TEXT_BYTES] = kept.text_of("hull", "fmi3Terminate", k)
        file.write_bytes(page + kept.explained(4096, words, {7: ("winch", "fmi2DoStep")}))
        assert kept.last_call(tmp_path) == found
    page[40:48] = (7).to_bytes(8, "little")
    file.write_bytes(page + kept.explained(4096, words, {7: ("winch", "fmi2DoStep")}))
    assert kept.last_call(tmp_path) == kept.LastCall("winch", "fmi2DoStep", 4.5)

"""A run repeats what a person did to an earlier one: packets at the same instants, values set, the same bits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.preparation.replay import as_text, entering
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.results.reading.read import packets
from cosim_master.results.storage.run_folder import RunFolder
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import View
from cosim_master.system.settings.changes import Change, Changeable
from cosim_master.system.settings.time_grid import TimeGrid
from tests.master.view.watched import LINE5

REQUEST_MESSAGE, AUTOPILOT_VERSION, UNTIL = 512, 148, 2.0
RECORDED = ("signals.parquet", "packets.parquet", "packets.tlog", "packets/drone3.tlog")


def asking(sequence: int) -> bytes:
    """A question to drone 3, as pymavlink writes it."""
    mavlink = ardupilotmega.MAVLink(None, 255, 190)
    mavlink.seq = sequence
    message = ardupilotmega.MAVLink_command_long_message(3, 1, REQUEST_MESSAGE, 0, AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0)
    packet: bytes = message.pack(mavlink)
    return packet


class Person:
    """Asks drone 3 twice at one time, once more later, and changes its wind, as the live page does."""

    every = 80

    def __init__(self) -> None:
        self.mailbox, self.control, self.changes = Mailbox(), Control(10.0), dict[float, Change]()
        self.asked = {0.6: 2, 1.4: 1}

    def __call__(self, _: View) -> Person:
        return self

    def prepared(self, ready: Prepared) -> None:
        ((instance, variable),) = Changeable(ready.checked).matching("drone3.vehicle.wind[2]")
        self.changes = {0.8: Change(0, instance, variable, 3.0000000001)}

    def initialised(self, seen: Any) -> None: ...
    def closed(self) -> None: ...

    def stepped(self, seen: Any) -> None:
        for at in [at for at in self.asked if at <= seen.time]:
            for sequence in range(self.asked.pop(at)):
                self.mailbox.post(asking(sequence))
        for at in [at for at in self.changes if at <= seen.time]:
            self.control.change(self.changes.pop(at))


@pytest.fixture(scope="module")
def done(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run to which a person has done something."""
    person, out = Person(), tmp_path_factory.mktemp("replay") / "done"
    result = simulate(
        LINE5,
        RunOptions(out=out, until=UNTIL),
        observers=[person],
        mailbox=person.mailbox,
        control=person.control,
        listener=Listener(prepared=person.prepared),
    )
    assert result.outcome == "done" and not person.asked and not person.changes
    return out


def test_the_same_actions_record_the_same_bits(done: Path, tmp_path: Path) -> None:
    plain, again, third = (tmp_path / name for name in ("plain", "again", "third"))
    simulate(LINE5, RunOptions(out=plain, until=UNTIL))
    assert simulate(LINE5, RunOptions(out=again, until=UNTIL, replay=done)).outcome == "done"
    assert simulate(LINE5, RunOptions(out=third, until=UNTIL, replay=again, pace=20.0)).outcome == "done"
    first, second, other = (json.loads((run / "manifest.json").read_text()) for run in (done, again, plain))
    asked = [row for row in packets(again).to_pylist() if row["source"] == "@page"]
    assert [row["sent"] for row in asked] == [one["time"] for one in first["posted"]]
    assert [one["packet"] for one in first["posted"]] == [asking(i).hex() for i in (0, 1, 0)]
    assert any(row["message"] == AUTOPILOT_VERSION for row in packets(again).to_pylist())
    for name in RECORDED:
        assert (again / name).read_bytes() == (done / name).read_bytes() == (third / name).read_bytes(), name
        assert name == RECORDED[0] or (plain / name).read_bytes() != (done / name).read_bytes(), name
    for key in ("fingerprint", "posted", "changes", "packets", "gateways"):
        assert first[key] == second[key], key
    assert "posted" not in other and first["changes"][0]["value"] == 3.0000000001
    differing = {name for name, digest in first["fingerprint"].items() if digest != other["fingerprint"][name]}
    assert differing == {"real programs", "changes"}


def test_a_replay_never_replaces_the_run_that_it_repeats(done: Path) -> None:
    with pytest.raises(SystemDescriptionError, match="holds the results of a run with packets from outside"):
        simulate(LINE5, RunOptions(out=RunFolder(done), until=UNTIL, replay=done))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"until": 1.0}, r"--replay: a packet was sent at [\d.]+ s, which is no communication point of this run; "),
        ({"until": UNTIL, "checkpoint_every": 1.0}, "--replay: a run with checkpoints takes no packets"),
    ],
)
def test_runs_that_cannot_repeat_it(done: Path, tmp_path: Path, options: dict[str, Any], text: str) -> None:
    manifest = json.loads((done / "manifest.json").read_text())
    (tmp_path / "done").mkdir()
    (tmp_path / "done" / "manifest.json").write_text(json.dumps({**manifest, "changes": []}))
    with pytest.raises(SystemDescriptionError, match=text):
        simulate(LINE5, RunOptions(out=tmp_path / "out", replay=tmp_path / "done", **options))


@pytest.mark.parametrize(
    ("manifest", "text"),
    [
        (None, "manifest.json cannot be read: No such file or directory"),
        ("{}", "its manifest cannot be used: 'outcome'"),
        ('{"outcome": "running"}', "its manifest cannot be used: the run is running"),
        ('{"outcome": "done", "changes": [], "posted": [{"time": 1, "packet": "xy"}]}', "its manifest cannot be used"),
        ('{"outcome": "done", "changes": [3]}', "its manifest cannot be used"),
    ],
)
def test_a_folder_that_cannot_be_repeated(fmus: Path, tmp_path: Path, manifest: str | None, text: str) -> None:
    if manifest is not None:
        (tmp_path / "manifest.json").write_text(manifest)
    with pytest.raises(SystemDescriptionError, match=text):
        simulate(LINE5, RunOptions(until=1.0, replay=tmp_path))


def test_packets_enter_at_communication_points_of_the_run() -> None:
    clock = TimeGrid(start=1_000_000_000, base=2_500_000, steps=400, periods=(1,))
    assert entering([(2.0, b"c"), (1.0, b"a"), (1.0025, b"b")], clock) == ((0, b"a"), (1, b"b"), (400, b"c"))
    for time in (0.9, 1.001, 2.0025):
        with pytest.raises(SystemDescriptionError, match=r"the multiples of 0\.0025 s from 1 to 2 s"):
            entering([(time, b"a")], clock)


def test_values_are_written_as_they_are_read() -> None:
    assert [as_text(value) for value in (True, False, 3, 0.1, "INF")] == ["true", "false", "3", "0.1", "INF"]

"""A swarm in several parts records the bits that it records in one process, whatever drone is in which part."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.stepping.control import Control
from cosim_master.system.authoring.swarm.new import new_system
from cosim_master.system.settings.changes import Change
from tests.master.parts import assigned, run_in_parts
from tests.scenarios.flights import SYSTEMS, Flight, copy_of, fly

DRONES = [f"drone{i}" for i in range(1, 6)]


def replaced(**attributes: str) -> Callable[[str], str]:
    """Sets attributes of the network of a system's document."""

    def change(text: str) -> str:
        for name, value in attributes.items():
            text = re.sub(rf'(<network[^>]*?) {name}="[^"]*"', r"\1", text)
            text, n = re.subn(r"<network ", f'<network {name}="{value}" ', text)
            assert n == 1
        return text

    return change


LOSSY = replaced(loss="0.2", jitter="0.013", range="40", duplicates="0.3", burstStart="0.05", burstEnd="0.5")


def files(folder: Path) -> dict[str, bytes]:
    """Everything that a run records, except what its manifest tells of the machine."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name != "manifest.json"
    }


def same(one: Path, other: Path) -> None:
    wanted, found = files(one), files(other)
    assert list(found) == list(wanted)
    differ = [name for name in wanted if found[name] != wanted[name]]
    if "packets.parquet" in differ:  # its row groups may begin elsewhere
        assert pq.read_table(one / "packets.parquet").equals(pq.read_table(other / "packets.parquet"))
        differ.remove("packets.parquet")
    assert differ == []
    mine, its = (json.loads((folder / "manifest.json").read_text()) for folder in (one, other))
    for name in ("outcome", "simulated_s", "packets", "verdict", "links", "fingerprint", "instances", "notes"):
        assert its[name] == mine[name], name


@pytest.fixture(scope="module")
def lossy(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Flight]:
    workshop = tmp_path_factory.mktemp("lossy")
    system = copy_of("line5", workshop, fmus, LOSSY)
    flight = fly(system, workshop / "out", until=2.5)  # messages of all kinds are sent, and motors are armed
    assert flight.result.packets["lost: channel"] > 20 and flight.result.packets["duplicates"] > 20
    return system, flight


@pytest.fixture(scope="module", params=["line5", "line5-ends"])
def shipped(fmus: Path, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Flight:
    flight = fly(SYSTEMS / request.param, tmp_path_factory.mktemp("shipped") / request.param, until=6.25)
    assert all(flight.up(drone)[-1] > 0.05 for drone in range(1, 6))  # all have taken off
    return flight


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_shipped_lines_in_parts(shipped: Flight, tmp_path: Path, parts: int) -> None:
    whole, options = shipped, RunOptions(out=tmp_path / "parts", until=6.25)
    result, errors = run_in_parts(SYSTEMS / whole.folder.name, options, parts)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")
    told = json.loads((tmp_path / "parts" / "manifest.json").read_text())["parts"]
    assert [one["part"] for one in told] == list(range(parts))
    assert sum(one["instances"] for one in told) == 15
    assert sorted(unit for one in told for unit in one["units"]) == DRONES


@settings(max_examples=5)
@given(parts=st.lists(st.integers(0, 3), min_size=5, max_size=5).map(lambda p: [sorted({*p}).index(one) for one in p]))
def test_any_assignment_of_a_lossy_line(
    lossy: tuple[Path, Flight], tmp_path_factory: pytest.TempPathFactory, parts: list[int]
) -> None:
    system, whole = lossy
    folder = tmp_path_factory.mktemp("parts")
    file = assigned(folder / "parts.json", DRONES, parts)
    options = RunOptions(out=folder / "out", until=2.5, assignment=file)
    result, errors = run_in_parts(system, options, max(parts) + 1)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, folder / "out")


@pytest.mark.parametrize(
    "change",
    [
        replaced(medium="own", rate="2000", queue="0.5"),
        replaced(medium="shared", rate="20000"),
        replaced(sensitivity="-62", exponent="3", shadowing="4", rayleigh="true", bitErrors="0.0005"),
        lambda text: replaced(latency="0.0075")(text),  # three steps: half windows of one
        lambda text: replaced(latency="0.0025")(text),  # one step: nothing is hidden
        lambda text: replaced(topology="broadcast")(re.sub(r' (axis|neighbours)="[^"]*"', "", text)),
    ],
    ids=["own medium", "shared medium", "signals", "three steps", "one step", "broadcast"],
)
def test_other_radios(fmus: Path, tmp_path: Path, change: Callable[[str], str]) -> None:
    system = copy_of("line5", tmp_path, fmus, change)
    whole = fly(system, tmp_path / "whole", until=1.5)
    assert whole.result.packets["delivered"] > 20
    file = assigned(tmp_path / "parts.json", DRONES, [0, 1, 2, 0, 1])
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", until=1.5, assignment=file), 3)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")


def test_a_trace_with_losses(fmus: Path, tmp_path: Path) -> None:
    """A row of losses has no delay, so it does not limit the window."""
    trace = tmp_path / "trace.csv"
    rows = ("0,drone1,drone2,1,0.021", "1,drone1,drone2,0,", "0,drone2,drone1,0.5,0.0175", "0,drone3,drone4,0,")
    trace.write_text("\n".join(["time,from,to,delivered,delay", *rows]) + "\n")
    options = {"until": 2.5, "overrides": {"network.trace": str(trace)}}
    whole = fly(SYSTEMS / "line5", tmp_path / "whole", **options)
    assert whole.result.packets["lost: trace"] > 20
    file = assigned(tmp_path / "parts.json", DRONES, [0, 1, 0, 1, 1])
    chosen = RunOptions(out=tmp_path / "parts", assignment=file, **options)  # type: ignore[arg-type]
    result, errors = run_in_parts(SYSTEMS / "line5", chosen, 2)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")


@pytest.mark.slow
def test_a_grid_of_a_hundred(fmus: Path, tmp_path: Path) -> None:
    system = new_system("flocking", 100, tmp_path / "grid", fmus=fmus, spacing=8.0, until=0.75)
    options = {"until": 0.75, "overrides": {"network.range": "20"}, "record": ("*.vehicle.position*",)}
    whole = fly(system, tmp_path / "whole", **options)
    assert whole.result.packets["delivered"] > 1000
    for parts in (2, 4):
        result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", **options), parts)  # type: ignore[arg-type]
        assert (result.outcome, errors) == ("done", [])
        same(whole.folder, tmp_path / "parts")


def test_listed_links_send_packets_only_where_they_are_heard(fmus: Path, tmp_path: Path) -> None:
    system = new_system("line", 12, tmp_path / "line", fmus=fmus, until=5.0)
    whole = fly(system, tmp_path / "whole")
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts"), 3)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")


def test_a_run_goes_on_in_other_parts_or_in_one_process(lossy: tuple[Path, Flight], tmp_path: Path) -> None:
    """Packets are in flight at 2.125 s: they, their counts and all values go to other parts, to one process, back."""
    system, whole = lossy
    table = pq.read_table(whole.folder / "packets.parquet")
    sent, arrived = (table[name].to_numpy() for name in ("sent", "arrival"))
    assert ((sent <= 2.125) & (arrived > 2.125)).sum() > 5

    def flown(name: str, parts: list[int] | None, origin: str | None = None, every: float | None = None) -> Path:
        file = None if parts is None else assigned(tmp_path / f"{name}.json", DRONES, parts)
        options = RunOptions(
            out=tmp_path / name, until=2.5, assignment=file, origin=origin, checkpoint_every=every, seed=None
        )
        if parts is None:
            result = simulate(system, options)
        else:
            result, errors = run_in_parts(system, options, max(parts) + 1)
            assert errors == []
        assert result.outcome == "done"
        return tmp_path / name

    flown("of one", None, every=1.0625)
    flown("of three", [0, 1, 2, 0, 1], every=1.0625)
    assert sorted(one.name for one in (tmp_path / "of three" / "checkpoints").iterdir()) == ["1.0625", "2.125"]
    for name, origin, parts in (
        ("one to two", "of one@2.125", [1, 1, 0, 0, 1]),
        ("three to one", "of three@2.125", None),
        ("three to four", "of three@2.125", [3, 0, 2, 1, 0]),
    ):
        found = flown(name, parts, str(tmp_path / origin))
        for file in ("signals.parquet", "packets.parquet"):
            assert pq.read_table(found / file).equals(pq.read_table(whole.folder / file)), name
        for file in sorted(whole.folder.glob("*.tlog")):
            assert (found / file.name).read_bytes() == file.read_bytes()
        mine, its = (json.loads((folder / "manifest.json").read_text()) for folder in (whole.folder, found))
        assert its["packets"] == mine["packets"]
        assert its["verdict"] == mine["verdict"]


def in_log(log: Path, skipped: int) -> list[bytes]:
    """The packets of MAVLink 2 in a .tlog, sorted, without so many bytes of their times."""
    content, at, found = log.read_bytes(), 0, []
    while at < len(content):
        begin, at = at, at + 8 + 12 + content[at + 9]
        assert content[begin + 8] == 0xFD
        found.append(content[begin + skipped : at])
    return sorted(found)


# ---- users ----------------------------------------------------------------------------------------------------------


def test_gateways_that_only_listen_hear_all_parts(fmus: Path, tmp_path: Path) -> None:
    """A ground station and a port per drone, in part 0: the same packets reach them as in one process."""
    system = copy_of("line5", tmp_path, fmus, LOSSY)
    options = RunOptions(out=tmp_path / "whole", until=4.0, gcs=["udpin:0"], ports="tcp:0")
    whole = simulate(system, options)
    file = assigned(tmp_path / "parts.json", DRONES, [0, 1, 2, 1, 0])
    result, errors = run_in_parts(system, replace(options, out=tmp_path / "parts", assignment=file), 3)
    assert (whole.outcome, result.outcome, errors) == ("done", "done", [])
    logs = [tmp_path / "whole" / "packets.tlog", *(tmp_path / "whole" / "packets").glob("@*.tlog")]
    assert len(logs) == 7
    for log in logs:  # those of gateways have times of the wall clock; in the other one, packets of one time may swap
        its = tmp_path / "parts" / log.relative_to(tmp_path / "whole")
        skipped = 8 if log.name.startswith("@") else 0
        assert in_log(its, skipped) == in_log(log, skipped) != []
        log.unlink()
        its.unlink()
    same(tmp_path / "whole", tmp_path / "parts")
    crossed = [{name: n for name, n in one.items() if name != "address"} for one in whole.gateways.values()]
    assert [{name: n for name, n in one.items() if name != "address"} for one in result.gateways.values()] == crossed
    assert sum(one["not taken"] for one in crossed) > 100


def test_a_packet_from_the_mailbox_is_answered_in_another_part(fmus: Path, tmp_path: Path) -> None:
    mailbox, answers = Mailbox(), list[bytes]()
    mailbox.answered = answers.extend
    speaker = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
    for drone in (2, 5):
        asked = mavlink.MAVLink_command_long_message(
            drone, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0
        )
        mailbox.post(asked.pack(speaker))
    file = assigned(tmp_path / "parts.json", DRONES, [0, 0, 0, 1, 1])
    options = RunOptions(out=tmp_path / "out", until=2.0, assignment=file)
    result, errors = run_in_parts(SYSTEMS / "line5", options, 2, mailbox=mailbox)
    assert (result.outcome, errors) == ("done", [])
    found = [mavlink.MAVLink(None).parse_buffer(packet)[0] for packet in answers]
    results = {one.get_srcSystem(): one.result for one in found if one.get_type() == "COMMAND_ACK"}
    assert results == {2: mavlink.MAV_RESULT_ACCEPTED, 5: mavlink.MAV_RESULT_ACCEPTED}
    assert result.gateways["@page"]["received"] == 2
    # The manifest names the instants at which all parts had the packets: a run in one process repeats them.
    posted = json.loads((tmp_path / "out" / "manifest.json").read_text())["posted"]
    rows = [one for one in pq.read_table(tmp_path / "out" / "packets.parquet").to_pylist() if one["source"] == "@page"]
    assert [one["sent"] for one in rows] == [one["time"] for one in posted] == [0.02, 0.02]
    again = RunOptions(out=tmp_path / "again", until=2.0, replay=tmp_path / "out")
    assert simulate(SYSTEMS / "line5", again).outcome == "done"
    assert (tmp_path / "again" / "signals.parquet").read_bytes() == (tmp_path / "out" / "signals.parquet").read_bytes()
    with pytest.raises(SystemDescriptionError, match="--replay: packets enter the parts of a run at the ends of win"):
        run_in_parts(SYSTEMS / "line5", replace(again, out=None), 2)


def test_values_that_users_set_reach_their_part(fmus: Path, tmp_path: Path) -> None:
    """The same values, set by --at in one process at the times that the run in parts names, give the same bits."""
    control, wanted = Control(), {"drone1.vehicle.wind[1]": 4.0, "drone5.vehicle.wind[2]": -3.0}

    def prepared(ready: Prepared) -> None:
        names = [one.name for one in ready.checked.instances]
        for name, value in wanted.items():
            vehicle, variable = name.rsplit(".", 1)
            found = ready.checked.instances[names.index(vehicle)].fmu.variables[variable]
            control.change(Change(0, names.index(vehicle), found, value))

    file = assigned(tmp_path / "parts.json", DRONES, [0, 0, 0, 1, 1])
    options = RunOptions(out=tmp_path / "parts", until=5.0, assignment=file)
    listener = Listener(prepared=prepared)
    result, errors = run_in_parts(SYSTEMS / "line5", options, 2, control=control, listener=listener)
    assert (result.outcome, errors) == ("done", [])
    assert [time for time, _ in control.made] == [0.02, 0.02]
    at = [(time, name, str(value)) for (time, _), (name, value) in zip(control.made, wanted.items(), strict=True)]
    whole = fly(SYSTEMS / "line5", tmp_path / "whole", until=5.0, at=at)
    moved = whole["drone1.vehicle.position[1]"][-1], whole["drone5.vehicle.position[2]"][-1] - 100.0
    assert moved[0] > 1e-4 and moved[1] < -1e-4
    same(tmp_path / "whole", tmp_path / "parts")

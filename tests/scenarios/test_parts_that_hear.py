"""Parts whose radio has a reach get only the packets that they can hear, and record the bits of one process."""

from __future__ import annotations

import os
import pickle
import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.entry import signature_of
from cosim_master.execution.options import RunOptions
from cosim_master.execution.partitions import exchange, hearing
from cosim_master.execution.partitions.exchange import Given
from cosim_master.execution.partitions.part import Message
from cosim_master.execution.partitions.transport import LocalTransport
from cosim_master.execution.run import driver
from cosim_master.stepping.warming import kernels_of_runs
from cosim_master.system.authoring.swarm.new import fleet_of, new_system
from tests.master.parts import assigned, run_in_parts
from tests.scenarios.flights import Flight, fly
from tests.scenarios.test_run_in_parts import replaced, same

POINTS = {"vehicle": "PointMass", "autopilot": "IdealAutopilot"}
DRONES = [f"drone{i}" for i in range(1, 10)]
"""A square of three by three, 8 m apart."""
UNTIL = 1.5
MOVING = "".join(
    f'<ssv:Parameter name="drone{i}.vehicle.{name}"><ssv:Real value="{value}"/></ssv:Parameter>'
    for i in range(1, 10)
    for name, value in {
        "position_start[3]": -20.0,
        "drag_time": 0.3,
        "wind[1]": 0.25 * (i % 3),
        "wind[2]": 3.0 - 3.0 * ((i - 1) // 3),
    }.items()
)
"""They fall from the beginning, each row in another wind: its neighbours become others."""


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter[str]]:
    """Counts the messages between parts: packets that go by radio, and those that were missing and sent again."""
    found, send = Counter[str](), LocalTransport.send

    def counted(self: LocalTransport, to: int, message: bytes) -> None:
        content = pickle.loads(message) if message[:1] == b"\x80" else None
        if isinstance(content, Given):
            found["again"] += len(content.packets)
        elif isinstance(content, Message) and content.given is not None:
            found["packets"] += int((content.given.packets["number"] >= 0).sum())
            found["values"] += content.given.reals.shape[1]
            found["positions"] += content.given.at[..., 0].size
            found["frames"] += len(content.given.steps)
            found["broken"] += content.given.broken
        send(self, to, message)

    monkeypatch.setattr(LocalTransport, "send", counted)
    yield found


def swarm(folder: Path, fmus: Path, **attributes: str) -> Path:
    fleet = {part: fleet_of(model) for part, model in POINTS.items()}
    system = new_system("flocking", 9, folder / "swarm", fmus=fmus, spacing=8.0, until=UNTIL, fleet=fleet)
    change(system, replaced(**attributes))
    values = system / "drones.ssv"
    values.write_text(values.read_text().replace("</ssv:Parameters>", f"{MOVING}</ssv:Parameters>"))
    return system


def change(system: Path, how: Callable[[str], str]) -> None:
    file = system / "SystemStructure.ssd"
    file.write_text(how(file.read_text(encoding="utf-8")), encoding="utf-8")


def with_inner(elements: str) -> Callable[[str], str]:
    """Returns a change of a system's text: elements in its `network`, which has none."""
    return lambda text: re.sub(r"(<network [^>]*)/>", rf"\1>{elements}</network>", text)


LOSSY = {"loss": "0.3", "jitter": "0.013", "duplicates": "0.3", "burstStart": "0.05", "burstEnd": "0.5"}


@pytest.fixture(scope="module")
def lossy(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Flight]:
    workshop = tmp_path_factory.mktemp("reach")
    system = swarm(workshop, fmus, range="11", **LOSSY)
    flight = fly(system, workshop / "out", until=UNTIL)
    counts = flight.result.packets
    assert min(counts["lost: range"], counts["lost: channel"], counts["duplicates"], counts["delivered"]) > 50
    return system, flight


def in_parts(system: Path, folder: Path, parts: list[int], **options: Any) -> Path:
    file = assigned(folder / "parts.json", DRONES, parts)
    chosen = RunOptions(**{"out": folder / "parts", "until": UNTIL, "assignment": file, **options})
    result, errors = run_in_parts(system, chosen, max(parts) + 1)
    assert (result.outcome, errors) == ("done", [])
    return folder / "parts"


@settings(max_examples=6)
@given(parts=st.lists(st.integers(0, 3), min_size=9, max_size=9).map(lambda p: [sorted({*p}).index(one) for one in p]))
def test_any_assignment_of_a_swarm_with_a_range(
    lossy: tuple[Path, Flight], tmp_path_factory: pytest.TempPathFactory, parts: list[int]
) -> None:
    system, whole = lossy
    same(whole.folder, in_parts(system, tmp_path_factory.mktemp("parts"), parts))


def test_a_part_gets_what_it_can_hear_and_no_positions_of_all(
    lossy: tuple[Path, Flight], tmp_path: Path, sent: Counter[str]
) -> None:
    """Rows 0 and 2 of the square are 16 m apart: with 11 m, no packet goes from one to the other."""
    system, whole = lossy
    same(whole.folder, in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2]))
    assert sent["values"] == sent["again"] == 0
    broadcasts = whole.result.packets["sent"] / 8
    assert 0.6 * 2 * broadcasts < sent["packets"] < 0.75 * 2 * broadcasts  # two thirds, and all until boxes are known


def test_promises_that_are_broken_cost_messages_only(
    lossy: tuple[Path, Flight], tmp_path: Path, sent: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nodes that promise to stay where they are, and move: packets that were kept from them come later."""
    monkeypatch.setattr(hearing, "_FASTER", 0.0)
    monkeypatch.setattr(hearing, "_FROM_REST", 0.0)
    system, whole = lossy
    same(whole.folder, in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2]))
    assert sent["broken"] > 50
    assert sent["again"] > 20


@pytest.mark.parametrize(
    "attributes",
    [
        {"sensitivity": "-52", "exponent": "3", "shadowing": "1", "rayleigh": "true", "bitErrors": "0.0005"},
        {"range": "12", "medium": "own", "rate": "2000", "queue": "0.5"},
        {"range": "12", "latency": "0.0125"},
    ],
    ids=["signals", "own medium", "one step"],
)
def test_other_radios_with_a_reach(fmus: Path, tmp_path: Path, attributes: dict[str, str]) -> None:
    system = swarm(tmp_path, fmus, **attributes)
    whole = fly(system, tmp_path / "whole", until=UNTIL)
    same(whole.folder, in_parts(system, tmp_path, [0, 0, 1, 0, 1, 1, 2, 2, 2]))


def test_outages_and_partitions_of_nodes_that_are_out_of_reach(fmus: Path, tmp_path: Path) -> None:
    """Their losses have other reasons than the range; they are recorded by the sender's part."""
    system = swarm(tmp_path, fmus, range="11", jitter="0.02")
    change(
        system,
        with_inner(
            '<outage node="drone9" start="0.3" stop="0.9"/><partition nodes="drone1 drone8" start="0.6" stop="1.2"/>'
        ),
    )
    whole = fly(system, tmp_path / "whole", until=UNTIL)
    assert min(whole.result.packets["lost: outage"], whole.result.packets["lost: partition"]) > 5
    same(whole.folder, in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2]))


def test_it_goes_on_from_a_checkpoint(lossy: tuple[Path, Flight], tmp_path: Path) -> None:
    system, whole = lossy
    first = in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2], checkpoint_every=0.5)
    in_parts(system, tmp_path, [1, 0, 0, 1, 0, 1, 0, 0, 1], origin=f"{first}@0.5", out=tmp_path / "again")
    for file in ("signals.parquet", "packets.parquet"):
        assert pq.read_table(tmp_path / "again" / file).equals(pq.read_table(whole.folder / file))


# ---- the nearest nodes ----

NEAREST = {
    "in space": {"topology": "nearest", "neighbours": "2"},
    "one, with signals": {"topology": "nearest", "neighbours": "1", "sensitivity": "-40", "rayleigh": "true"},
    "on an axis": {"topology": "nearest", "neighbours": "1", "axis": "0.1 1 0"},
    "within a range": {"topology": "nearest", "neighbours": "2", "axis": "0.1 1 0", "range": "15"},
    "in space, within a range, jammed": {"topology": "nearest", "neighbours": "3", "range": "15"},
}
JAMMING = '<jamming north="8" east="0" radius="6" start="0.5"/>'
"""An area around the middle of a side of the square."""


@pytest.fixture(scope="module", params=list(NEAREST))
def nearest(fmus: Path, tmp_path_factory: pytest.TempPathFactory, request: Any) -> tuple[Path, Flight]:
    workshop = tmp_path_factory.mktemp("nearest")
    system = swarm(workshop, fmus, **NEAREST[request.param], **LOSSY)
    happens = ["lost: channel", "delivered"]
    if "jammed" in request.param:
        change(system, with_inner(JAMMING))
        happens.append("lost: jammed")
    flight = fly(system, workshop / "out", until=UNTIL)
    assert min(flight.result.packets[outcome] for outcome in happens) > 20, flight.result.packets
    return system, flight


@settings(max_examples=4)
@given(parts=st.lists(st.integers(0, 3), min_size=9, max_size=9).map(lambda p: [sorted({*p}).index(one) for one in p]))
def test_any_assignment_of_a_swarm_of_nearest_nodes(
    nearest: tuple[Path, Flight], tmp_path_factory: pytest.TempPathFactory, parts: list[int]
) -> None:
    system, whole = nearest
    same(whole.folder, in_parts(system, tmp_path_factory.mktemp("parts"), parts))


@pytest.mark.parametrize("topology", [{"neighbours": "2"}, {"neighbours": "1", "axis": "0 1 0"}], ids=["space", "axis"])
def test_parts_of_a_line_get_packets_and_positions_of_nodes_that_may_be_nearest(
    fmus: Path, tmp_path: Path, sent: Counter[str], topology: dict[str, str]
) -> None:
    """Of twelve drones in four parts, those at both sides of the three borders matter elsewhere."""
    fleet = {part: fleet_of(model) for part, model in POINTS.items()}
    system = new_system("line", 12, tmp_path / "swarm", fmus=fmus, spacing=8.0, until=UNTIL, fleet=fleet)
    plain = r'\1 topology="nearest" latency="0.02"/>'
    change(system, lambda text: re.sub(r"(<network xmlns=\S+) .*</network>", plain, text, flags=re.DOTALL))
    change(system, replaced(**topology))
    whole = fly(system, tmp_path / "whole", until=UNTIL)
    file = assigned(tmp_path / "parts.json", [f"drone{i}" for i in range(1, 13)], [n // 3 for n in range(12)])
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", until=UNTIL, assignment=file), 4)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")
    assert sent["values"] == 0
    assert 0 < sent["positions"] < 0.6 * 3 * sent["frames"]  # of three drones to three parts
    assert 0 < sent["packets"] < 0.6 * 3 * whole.result.packets["sent"]


SOME = pytest.mark.parametrize("nearest", ["in space", "within a range"], indirect=True)


@SOME
def test_broken_promises_of_nearest_nodes_cost_messages_only(
    nearest: tuple[Path, Flight], tmp_path: Path, sent: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hearing, "_FASTER", 0.0)
    monkeypatch.setattr(hearing, "_FROM_REST", 0.0)
    system, whole = nearest
    same(whole.folder, in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2]))
    assert sent["broken"] > 50


@SOME
def test_nearest_nodes_go_on_from_a_checkpoint(nearest: tuple[Path, Flight], tmp_path: Path) -> None:
    system, whole = nearest
    first = in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2], checkpoint_every=0.5)
    in_parts(system, tmp_path, [1, 0, 0, 1, 0, 1, 0, 0, 1], origin=f"{first}@0.5", out=tmp_path / "again")
    for file in ("signals.parquet", "packets.parquet"):
        assert pq.read_table(tmp_path / "again" / file).equals(pq.read_table(whole.folder / file))


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_kernels_of_parts_are_those_that_a_wheel_has(
    lossy: tuple[Path, Flight], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: dict[str, set[str]] = {}

    def watched(module: ModuleType, name: str) -> None:
        kernel = getattr(module, name)

        def call(*arguments: Any) -> Any:
            called.setdefault(name, set()).add(signature_of(arguments))
            return kernel(*arguments)

        monkeypatch.setattr(module, name, call)

    watched(exchange, "replay")
    for name in ("run", "outbox_needed"):
        watched(driver, name)
    system, _ = lossy
    in_parts(system, tmp_path, [0, 0, 0, 1, 1, 1, 2, 2, 2], until=0.5)
    assert called == {name: {signature_of(kernels_of_runs()[name][1])} for name in called}
    assert {"replay", "run"} <= set(called)

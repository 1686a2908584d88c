"""A swarm in several parts records the bits that it records in one process, whatever drone is in which part."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.swarm.new import new_system
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


LOSSY = replaced(loss="0.2", jitter="0.013", range="40", duplicates="0.1", burstStart="0.05", burstEnd="0.5")


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
    flight = fly(system, workshop / "out", until=16.0)
    assert flight.result.packets["lost: channel"] > 20 and flight.result.packets["duplicates"] > 20
    return system, flight


@pytest.mark.parametrize("parts", [1, 2, 4])
@pytest.mark.parametrize("name", ["line5", "line5-ends"])
def test_shipped_lines_in_parts(fmus: Path, tmp_path: Path, name: str, parts: int) -> None:
    whole = fly(SYSTEMS / name, tmp_path / "whole", until=16.0)
    result, errors = run_in_parts(SYSTEMS / name, RunOptions(out=tmp_path / "parts", until=16.0), parts)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")
    told = json.loads((tmp_path / "parts" / "manifest.json").read_text())["parts"]
    assert [one["part"] for one in told] == list(range(parts))
    assert sum(one["instances"] for one in told) == 15
    assert sorted(unit for one in told for unit in one["units"]) == DRONES


@settings(max_examples=8)
@given(parts=st.lists(st.integers(0, 3), min_size=5, max_size=5).map(lambda p: [sorted({*p}).index(one) for one in p]))
def test_any_assignment_of_a_lossy_line(
    lossy: tuple[Path, Flight], tmp_path_factory: pytest.TempPathFactory, parts: list[int]
) -> None:
    system, whole = lossy
    folder = tmp_path_factory.mktemp("parts")
    file = assigned(folder / "parts.json", DRONES, parts)
    options = RunOptions(out=folder / "out", until=16.0, assignment=file)
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
    whole = fly(system, tmp_path / "whole", until=12.0)
    file = assigned(tmp_path / "parts.json", DRONES, [0, 1, 2, 0, 1])
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", until=12.0, assignment=file), 3)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")


@pytest.mark.slow
def test_a_grid_of_two_hundred(fmus: Path, tmp_path: Path) -> None:
    system = new_system("flocking", 200, tmp_path / "grid", fmus=fmus, spacing=8.0, until=4.0)
    options = {"until": 4.0, "overrides": {"network.range": "20"}, "record": ("*.vehicle.position*",)}
    whole = fly(system, tmp_path / "whole", **options)
    for parts in (2, 4):
        result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", **options), parts)  # type: ignore[arg-type]
        assert (result.outcome, errors) == ("done", [])
        same(whole.folder, tmp_path / "parts")


def test_listed_links_send_packets_only_where_they_are_heard(fmus: Path, tmp_path: Path) -> None:
    system = new_system("line", 12, tmp_path / "line", fmus=fmus, until=14.0)
    whole = fly(system, tmp_path / "whole")
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts"), 3)
    assert (result.outcome, errors) == ("done", [])
    same(whole.folder, tmp_path / "parts")


def test_a_run_goes_on_in_other_parts_or_in_one_process(lossy: tuple[Path, Flight], tmp_path: Path) -> None:
    """Packets are in flight at 8 s: they, their counts and all values go to other parts, to one process, and back."""
    system, whole = lossy

    def flown(name: str, parts: list[int] | None, origin: str | None = None, every: float | None = None) -> Path:
        file = None if parts is None else assigned(tmp_path / f"{name}.json", DRONES, parts)
        options = RunOptions(
            out=tmp_path / name, until=16.0, assignment=file, origin=origin, checkpoint_every=every, seed=None
        )
        if parts is None:
            result = simulate(system, options)
        else:
            result, errors = run_in_parts(system, options, max(parts) + 1)
            assert errors == []
        assert result.outcome == "done"
        return tmp_path / name

    flown("of one", None, every=4.0)
    flown("of three", [0, 1, 2, 0, 1], every=4.0)
    assert sorted(one.name for one in (tmp_path / "of three" / "checkpoints").iterdir()) == ["12", "4", "8"]
    for name, origin, parts in (
        ("one to two", "of one@8", [1, 1, 0, 0, 1]),
        ("three to one", "of three@8", None),
        ("three to four", "of three@8", [3, 0, 2, 1, 0]),
    ):
        found = flown(name, parts, str(tmp_path / origin))
        for file in ("signals.parquet", "packets.parquet"):
            assert pq.read_table(found / file).equals(pq.read_table(whole.folder / file)), name
        for file in sorted(whole.folder.glob("*.tlog")):
            assert (found / file.name).read_bytes() == file.read_bytes()
        mine, its = (json.loads((folder / "manifest.json").read_text()) for folder in (whole.folder, found))
        assert its["packets"] == mine["packets"]
        assert its["verdict"] == mine["verdict"]

"""Same system, same seed: same bits, whatever the order of components, the number of threads or the build."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.flights import Flight, copy_of, fly, plain_line

LOSSY = 'loss="0.3" jitter="0.1" latency="0.05"'


def lossy(text: str) -> str:
    changed, n = re.subn(r'latency="[^"]*"', LOSSY, text)
    assert n == 1
    return changed


def files(flight: Flight) -> dict[str, bytes]:
    names = ["signals.parquet", "packets.parquet", "packets.tlog", *(f"packets/drone{i}.tlog" for i in range(1, 6))]
    return {name: (flight.folder / name).read_bytes() for name in names}


@pytest.fixture(scope="module")
def reference(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    workshop = tmp_path_factory.mktemp("lossy")
    return fly(copy_of("line5", workshop, fmus, lossy), workshop / "out", until=40.0)


def test_twice_is_the_same(reference: Flight, fmus: Path, tmp_path: Path) -> None:
    again = fly(copy_of("line5", tmp_path, fmus, lossy), tmp_path / "out", until=40.0)
    assert files(again) == files(reference)


def test_another_seed_is_another_run(reference: Flight, fmus: Path, tmp_path: Path) -> None:
    other = fly(copy_of("line5", tmp_path, fmus, lossy), tmp_path / "out", until=40.0, seed=2)
    assert other.result.packets["lost"] != reference.result.packets["lost"]
    assert files(other)["signals.parquet"] != files(reference)["signals.parquet"]


def test_the_order_of_components_does_not_matter(reference: Flight, fmus: Path, tmp_path: Path) -> None:
    def shuffled(text: str) -> str:
        drones = re.findall(r"^ *<ssd:Component .*\n", text, flags=re.MULTILINE)
        assert len(drones) == 5
        return lossy(text.replace("".join(drones), "".join(drones[i] for i in (3, 0, 4, 2, 1))))

    other = fly(copy_of("line5", tmp_path, fmus, shuffled), tmp_path / "out", until=40.0)
    assert files(other) == files(reference)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_do_not_matter(reference: Flight, fmus: Path, tmp_path: Path, threads: int) -> None:
    other = fly(copy_of("line5", tmp_path, fmus, lossy), tmp_path / "out", until=40.0, threads=threads)
    assert files(other) == files(reference)


def test_half_the_communication_step_moves_the_snapshots_by_less_than_a_centimetre(fmus: Path, tmp_path: Path) -> None:
    annotation = (
        '<ssc:Annotation type="org.uav-cosim.stepping">'
        '<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="0.00125"/></ssc:Annotation>'
    )

    folder = copy_of("line5", tmp_path, fmus, lambda text: text)
    drone = folder / "drone.ssd"
    text = drone.read_text(encoding="utf-8")
    marked, n = re.subn(
        r'(<ssd:Component name="(?:vehicle|autopilot)".*?</ssd:Connectors>)',
        rf"\1<ssd:Annotations>{annotation}</ssd:Annotations>",
        text,
        flags=re.DOTALL,
    )
    assert n == 2
    drone.write_text(marked, encoding="utf-8")
    half, full = fly(folder, tmp_path / "half", record=("*.position*",)), plain_line()
    for step in (1, 9, 17):
        row = full.end_of_step(step)
        assert half["time"][row] == full["time"][row]
        for drone_number in range(1, 6):
            moved = half.east(drone_number)[row] - full.east(drone_number)[row]
            assert np.abs(moved) < 0.01

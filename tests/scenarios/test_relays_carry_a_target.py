"""Four drones track a target that only one of them hears: relays carry its position to the others.

The radio is a line, drone1 - drone2 - drone3 - drone4 - drone5, and drone5 is the target.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pymavlink import mavutil

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.scenarios.flights import copy_of

pytestmark = pytest.mark.usefixtures("fmus")
LINKS = "".join(f'<link between="drone{i} drone{i + 1}"/>' for i in range(1, 5))


@pytest.fixture(scope="module")
def system(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    def line(text: str) -> str:
        attributes = 'topology="listed" latency="0.02" loss="0.1" seed="1"'
        new = f'<network xmlns="https://uav-cosim.org/ns/1" {attributes}>{LINKS}</network>'
        return re.sub(r"<network [^>]*/>", new, text)

    return copy_of("tracking", tmp_path_factory.mktemp("relays"), fmus, line)


def way(folder: Path) -> np.ndarray[Any, Any]:
    """Shape (rows, drones, 2): north and east, m."""
    table = pq.read_table(folder / "signals.parquet")
    columns = [[table[f"drone{n}.vehicle.position[{i}]"].to_numpy() for i in (1, 2)] for n in range(1, 6)]
    return np.moveaxis(np.array(columns), 2, 0)


@pytest.fixture(scope="module")
def flown(system: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    out = tmp_path_factory.mktemp("flights")

    def fly(relays: str) -> Path:
        folder = out / (relays.replace("*", "all") or "none")
        if not folder.exists():
            overrides = {"network.relays": relays} if relays else {}
            simulate(system, RunOptions(out=folder, overrides=overrides, record=["*.position*"]))
        return folder

    return fly


def test_all_reach_the_target_by_relays_and_one_without(flown: Callable[[str], Path]) -> None:
    for relays, at_target in (("", [False, False, False, True]), ("drone*", [True] * 4)):
        last = way(flown(relays))[-1]
        assert (np.linalg.norm(last[:4] - last[4], axis=1) < 25.0).tolist() == at_target


def test_every_node_hears_each_packet_once_and_unchanged(flown: Callable[[str], Path]) -> None:
    """By pymavlink: the same bytes as sent, in the order of their sequence numbers, each at most once."""
    folder = flown("drone*") / "packets"

    def packets(node: str, system: int) -> list[bytes]:
        log = mavutil.mavlink_connection(str(folder / f"{node}.tlog"))
        found = []
        while (message := log.recv_match()) is not None:
            if message.get_type() == "GLOBAL_POSITION_INT" and message.get_srcSystem() == system:
                found.append(bytes(message.get_msgbuf()))
        log.close()
        return found

    by_target = packets("drone5", 5)
    heard = packets("drone1", 5)
    shares = len(heard) / len(by_target)
    assert 0.9**4 - 0.08 < shares < 0.9**4 + 0.08  # four hops with a loss of 10 % each
    remaining = iter(by_target)
    assert all(one in remaining for one in heard)  # a subsequence: in order, none twice


def test_the_same_bits_with_two_threads_and_when_it_is_resumed(system: Path, tmp_path: Path) -> None:
    given: dict[str, Any] = {"until": 26.0, "checkpoint_every": 24.0}
    effects = {"network.relays": "*", "network.jitter": "0.03", "network.duplicates": "0.05"}
    simulate(system, RunOptions(out=tmp_path / "whole", threads=1, overrides=effects, **given))
    simulate(system, RunOptions(out=tmp_path / "threads", threads=2, overrides=effects, **given))
    simulate(system, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'whole'}@24", **given))
    assert pq.read_table(tmp_path / "whole" / "packets.parquet").num_rows > 1000
    for name in ("signals.parquet", "packets.parquet"):
        expected = (tmp_path / "whole" / name).read_bytes()
        assert (tmp_path / "threads" / name).read_bytes() == expected
        assert (tmp_path / "rest" / name).read_bytes() == expected


def test_the_age_of_a_relayed_packet_counts_from_its_origin(fmus: Path, tmp_path: Path) -> None:
    """A packet every 0.2 s at least, 20 ms for a hop: its greatest age is 0.22 s after one hop, 0.28 s after four."""
    ages = "".join(
        f'<age name="{name}" from="drone5" to="drone{to}" most="{most}" start="20" severity="warning"/>'
        for name, to, most in (
            ("one", 4, 0.2225),
            ("less than one", 4, 0.2175),
            ("four", 1, 0.2825),
            ("less than four", 1, 0.2775),
        )
    )
    monitors = f'<monitors xmlns="https://uav-cosim.org/ns/1">{ages}</monitors>'
    note = f'<ssc:Annotation type="org.uav-cosim.monitors">{monitors}</ssc:Annotation>'

    def line(text: str) -> str:
        new = f'<network xmlns="https://uav-cosim.org/ns/1" topology="listed" latency="0.02">{LINKS}</network>'
        return re.sub(r"<network [^>]*/>", new, text).replace("</ssd:Annotations>", f"{note}</ssd:Annotations>", 1)

    system = copy_of("tracking", tmp_path, fmus, line)
    result = simulate(
        system, RunOptions(out=tmp_path / "out", until=24.0, overrides={"network.relays": "*"}, record=["*.position*"])
    )
    assert result.outcome == "done"
    found = json.loads((tmp_path / "out/manifest.json").read_text())["verdict"]["monitors"]
    counts = {one["name"]: one["count"] for one in found}
    assert counts["one"] == counts["four"] == 0
    assert counts["less than one"] > 5 and counts["less than four"] > 5
    worst = {one["name"]: max(of["worst"] for of in one["violations"]) for one in found if one["violations"]}
    assert worst == {"less than one": pytest.approx(0.22), "less than four": pytest.approx(0.28)}


def test_an_age_that_relays_do_not_reach_is_refused(fmus: Path, tmp_path: Path) -> None:
    """Three relays lead from drone5 to drone1; without them, or with two, drone1 cannot hear it."""
    note = (
        '<ssc:Annotation type="org.uav-cosim.monitors"><monitors xmlns="https://uav-cosim.org/ns/1">'
        '<age from="drone5" to="drone1" most="1"/></monitors></ssc:Annotation></ssd:Annotations>'
    )

    def line(text: str) -> str:
        new = f'<network xmlns="https://uav-cosim.org/ns/1" topology="listed">{LINKS}</network>'
        return re.sub(r"<network [^>]*/>", new, text).replace("</ssd:Annotations>", note, 1)

    system = copy_of("tracking", tmp_path, fmus, line)
    for overrides, text in (
        ({}, "drone1 cannot hear drone5: the network has no <link> between them\n"),
        ({"network.relays": "*", "network.hops": "2"}, "the network has no <link> between them, nor relays"),
    ):
        with pytest.raises(SystemDescriptionError, match=text):
            simulate(system, RunOptions(out=tmp_path / "out", until=1.0, overrides=overrides))
    options = RunOptions(out=tmp_path / "out", until=1.0, overrides={"network.relays": "*", "network.hops": "3"})
    assert simulate(system, options).outcome == "done"


@pytest.mark.parametrize("medium", [{"medium": "csma", "rate": "57600", "backoff": "0.02"}, {"medium": "own"}])
def test_the_same_bits_with_a_medium(system: Path, tmp_path: Path, medium: dict[str, str]) -> None:
    given: dict[str, Any] = {"until": 8.0, "checkpoint_every": 7.0}
    effects = {f"network.{name}": text for name, text in medium.items()} | {"network.relays": "*"}
    effects |= {"network.rate": "57600"}
    simulate(system, RunOptions(out=tmp_path / "whole", threads=1, overrides=effects, **given))
    simulate(system, RunOptions(out=tmp_path / "rest", origin=f"{tmp_path / 'whole'}@7", **given))
    assert (tmp_path / "rest/packets.parquet").read_bytes() == (tmp_path / "whole/packets.parquet").read_bytes()

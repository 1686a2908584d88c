"""The packets of a recording for its page, against the recording itself, where rows of a packet are apart."""

from __future__ import annotations

import base64
import re
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pymavlink import mavutil

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.view.block import Block
from cosim_master.view.traffic import traffic
from tests.scenarios.flights import SYSTEMS

TICK = 1e-6


def read(block: Block, place: Any) -> np.ndarray[Any, Any]:
    """An array of a block, as the page reads it: the first bytes of all numbers, then the second ones."""
    offset, kind, n = place
    size = np.dtype(f"<{kind}").itemsize
    data = np.frombuffer(zlib.decompress(base64.b64decode(block.text())), np.uint8, n * size, offset)
    return np.ascontiguousarray(data.reshape(size, n).T).view(f"<{kind}")[:, 0]


class Log:
    """The log of a page: times in s, names of senders and messages, and counts of nodes."""

    def __init__(self, run: Path) -> None:
        block = Block()
        told = traffic(run, [], block, 0.0, TICK)
        log = told["log"]
        self.time = np.cumsum(read(block, log["time"]).astype(np.int64)) * TICK
        self.source = [told["sources"][i] for i in read(block, log["source"])]
        self.message = [told["messages"][i] for i in read(block, log["message"])]
        self.heard, self.lost = read(block, log["heard"]).tolist(), read(block, log["lost"]).tolist()
        self.texts = log["texts"]
        assert log["of"] == len(self.texts)


def recorded(run: Path) -> list[tuple[float, str, int, int]]:
    """Each packet of packets.parquet: when and by whom it was sent, and how many nodes heard and lost it."""
    found: dict[tuple[Any, ...], Counter[str]] = {}
    for row in pq.read_table(run / "packets.parquet").to_pylist():
        key = tuple(row[name] for name in ("sent", "source", "system", "component", "sequence", "message"))
        found.setdefault(key, Counter())[row["outcome"].partition(":")[0]] += 1
    return sorted((key[0], key[1], one["radio"], one["lost"]) for key, one in found.items())


MEDIA = {
    "csma": {"medium": "csma", "rate": "57600", "backoff": "0.05", "sensing": "0.0005"},
    "aloha": {"medium": "aloha", "slot": "0.01", "window": "4"},
    "none": {"latency": "0.02", "loss": "0.2"},
}


@pytest.mark.parametrize("medium", MEDIA)
def test_every_packet_is_in_the_log_once(fmus: Path, tmp_path: Path, medium: str) -> None:
    overrides = {f"network.{name}": value for name, value in MEDIA[medium].items()}
    result = simulate(SYSTEMS / "line5", RunOptions(out=tmp_path / "run", until=4.0, overrides=overrides))
    assert result.packets["lost"] > 30
    log, packets = Log(tmp_path / "run"), recorded(tmp_path / "run")
    assert len(packets) > 200
    assert (np.diff(log.time) >= 0.0).all() and log.time[-1] <= 4.0
    found = sorted(zip(np.round(log.time, 6).tolist(), log.source, log.heard, log.lost, strict=True))
    assert found == [(pytest.approx(sent, abs=2e-6), *others) for sent, *others in packets]
    assert all(log.texts)


def test_packets_sent_on_have_their_contents(fmus: Path, tmp_path: Path) -> None:
    overrides = {"network.relays": "*", "network.jitter": "0.02"}
    system = SYSTEMS / "flocking-points"
    assert simulate(system, RunOptions(out=tmp_path / "run", until=3.0, overrides=overrides)).packets["relayed"] > 100
    log = Log(tmp_path / "run")
    assert len(log.time) == len(recorded(tmp_path / "run"))
    said: dict[str, set[float]] = {}
    connection = mavutil.mavlink_connection(str(tmp_path / "run" / "packets.tlog"), dialect="ardupilotmega")
    while (message := connection.recv_match(type="GLOBAL_POSITION_INT")) is not None:
        said.setdefault(f"lat {message.lat}, lon {message.lon}", set()).add(message._timestamp)
    connection.close()
    relayed = 0
    for source, name, text in zip(log.source, log.message, log.texts, strict=True):
        if source.endswith(".relay") and name == "GLOBAL_POSITION_INT":
            found = re.search(r"lat -?\d+, lon -?\d+", text)
            assert found is not None and found[0] in said
            relayed += 1
        assert not (name == "HEARTBEAT" and text.startswith("type 0"))
    assert relayed > 50


def test_what_is_not_logged_has_no_contents(fmus: Path, tmp_path: Path) -> None:
    simulate(SYSTEMS / "flocking-points", RunOptions(out=tmp_path / "run", until=1.0))
    (tmp_path / "run" / "packets.tlog").write_bytes(b"")
    assert {*Log(tmp_path / "run").texts} == {""}


def test_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="u4: -3 is negative"):
        Block().add(np.array([5, -3]), "u4")

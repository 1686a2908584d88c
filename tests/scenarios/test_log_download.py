"""A ground station downloads the log of a vehicle while the run goes on; pymavlink reads it."""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.DFReader import DFReader_binary

from tests.scenarios.swarm import running

pytestmark = [pytest.mark.slow, pytest.mark.alone]


def received(link: Any, kind: str, seconds: float = 120.0) -> Any:
    message = link.recv_match(type=kind, blocking=True, timeout=seconds)
    assert message is not None, kind
    return message


def downloaded(link: Any, size: int) -> bytes:
    """Asks until nothing is missing."""
    pieces: dict[int, bytes] = {}
    end = time.monotonic() + 120.0
    while (missing := next((at for at in range(0, size, 90) if at not in pieces), None)) is not None:
        assert time.monotonic() < end
        link.mav.log_request_data_send(3, 1, 1, missing, size - missing)
        while (message := link.recv_match(type="LOG_DATA", blocking=True, timeout=2.0)) is not None:
            pieces[message.ofs] = bytes(message.data[: message.count])
            if message.ofs + message.count == size:
                break
    return b"".join(pieces[at] for at in range(0, size, 90))


def test_a_log_is_downloaded_during_the_run(tmp_path: Path, fmus: Path) -> None:
    options = ("--ports", "tcp:0", "--dataflash", "--set", "recording.interval=0.1", "--until", "9000")
    with running(tmp_path / "out", *options, pace=2.0) as swarm:
        link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{swarm.port('@drone3')}", source_system=255)
        received(link, "HEARTBEAT")
        end = time.monotonic() + 120.0
        for armed in (1, 0):  # there is a log from the first arming on, for a vehicle that is not armed
            while bool(received(link, "HEARTBEAT").base_mode & 128) != bool(armed):
                assert time.monotonic() < end
                link.mav.command_long_send(3, 1, 400, 0, armed, 0, 0, 0, 0, 0, 0)
        size, first = 0, 0
        for _ in range(60):  # until the journal has rows, and has been written once more: it may begin with one
            link.mav.log_request_list_send(3, 1, 0, 0xFFFF)
            entry = received(link, "LOG_ENTRY")
            if entry.num_logs == 1:
                size, first = entry.size, first or entry.size
                if size > first:
                    break
            time.sleep(0.5)
        assert size > first > 0
        assert (entry.id, entry.last_log_num) == (1, 1)
        content = downloaded(link, size)
        link.close()
        swarm.stop()
    assert len(content) == size
    (tmp_path / "got.bin").write_bytes(content)
    whole = (tmp_path / "out" / "dataflash" / "drone3.bin").read_bytes()
    assert len(whole) >= len(content)
    reader = DFReader_binary(str(tmp_path / "got.bin"))
    times = []
    while (message := reader.recv_match(type="ATT")) is not None:
        times.append(message.TimeUS)
    reader.close()
    assert len(times) > 1
    assert all(b - a == 100_000 for a, b in pairwise(times))

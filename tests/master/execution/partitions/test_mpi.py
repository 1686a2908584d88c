"""How parts on MPI wait for messages, without MPI and by a clock of the test."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cosim_master.execution.partitions import mpi
from cosim_master.execution.partitions.mpi import MpiTransport
from cosim_master.execution.partitions.transport import PartLost

PROBE = 1e-6
"""Seconds that a question for messages takes."""


class Network:
    """Stands in for mpi4py, its communicator and the clock; a message of part 1 is there from a time on, s."""

    Exception = OSError
    Status = SimpleNamespace
    BYTE = None

    def __init__(self, arrives: float) -> None:
        self.now, self.naps, self.looks, self._arrives = 0.0, list[tuple[float, float]](), list[float](), arrives

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.naps.append((self.now, seconds))
        self.now += seconds

    def Improbe(self, source: int, tag: int, status: Any) -> Any:
        self.now += PROBE
        if tag != 0 or self.now < self._arrives:
            return None
        status.Get_count = lambda _: 2
        return SimpleNamespace(Recv=lambda to: to[0].__setitem__(slice(None), b"dx"))


@pytest.fixture
def waiting(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> tuple[MpiTransport, Network]:
    """Part 2 of a run, which may wait for 5 s."""
    pytest.importorskip("mpi4py")
    network, transport = Network(request.param), MpiTransport.__new__(MpiTransport)
    transport.__dict__.update(_mpi=network, _comm=network, part=2, parts=3, seconds=5.0, _gone=set(), _sending=[])
    transport.__dict__["_look"] = lambda: network.looks.append(network.now)
    transport.__dict__["_agreed"] = lambda error: error
    monkeypatch.setattr(mpi, "time", network)
    return transport, network


@pytest.mark.parametrize("waiting", [100e-6, 0.01, 2.0], indirect=True)
def test_a_message_is_noticed_a_twentieth_of_its_time_later_at_most(waiting: tuple[MpiTransport, Network]) -> None:
    transport, network = waiting
    arrives = network._arrives
    assert transport.receive(1) == b"x"
    assert network.now - arrives <= min(max(20e-6, 0.05 * arrives), 1e-3) + 2 * PROBE
    assert all(nap <= max(20e-6, 0.05 * began) for began, nap in network.naps)


@pytest.mark.parametrize("waiting", [2.0], indirect=True)
def test_who_waits_long_hardly_computes(waiting: tuple[MpiTransport, Network]) -> None:
    transport, network = waiting
    transport.receive(1)
    assert len(network.naps) < 2300  # of 2 s; 100,000 if none were longer than the first
    gaps = [
        later - earlier for earlier, later in zip([0.0, *network.looks], [*network.looks, network.now], strict=True)
    ]
    assert max(gaps) < 0.005  # for parts that have died


@pytest.mark.parametrize("waiting", [100.0], indirect=True)
def test_a_part_that_sends_nothing_is_lost(waiting: tuple[MpiTransport, Network]) -> None:
    transport, network = waiting
    with pytest.raises(PartLost, match="no message for 5 s"):
        transport.receive(1)
    assert 5.0 < network.now < 5.01

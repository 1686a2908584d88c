"""Packets of ground stations at the cable of a relay: through the swarm and back, by hand-counted hops of 10 ms."""

from __future__ import annotations

import numpy as np
import pytest

from cosim_master.network.radio.build import grown
from cosim_master.network.radio.router import admit
from cosim_master.network.radio.topology import copies
from cosim_master.system.settings.network import Gateway
from tests.master.network.test_radio import SECOND, packet
from tests.master.network.test_relays import LINE, Relays

STATION, OTHER = 255, 254  # systems of ground stations


class Cables(Relays):
    """A line of five with gateways @NODE at the cables of nodes."""

    def __init__(self, *wired: str, relays: range | tuple[int, ...] = range(5), hops: int = 8) -> None:
        gateways = tuple(Gateway(f"@{node}", node) for node in wired)
        super().__init__(5, LINE, relays, hops=hops, gateways=gateways)
        self.gateways = [one.name for one in gateways]
        self.names += self.gateways

    def enter(self, t: int, gateway: str, sent: bytes) -> bytes:
        """Lets a packet enter by a gateway and travel for a second; returns it."""
        self.radio = grown(self.radio, 8 * copies(self.radio))
        buf = np.frombuffer(sent, np.uint8)
        admit(self.radio, self.reals, t, self.gateways.index(gateway), buf, len(sent))
        self.serve(t + SECOND)
        return sent

    def left(self, gateway: str, sent: bytes) -> list[int]:
        """When a packet left by a gateway, in ms since the start of its second."""
        return [arrival % SECOND // 1_000_000 for arrival, data, _ in self.queue(gateway) if data == sent]


def introduced(*wired: str, **given: object) -> Cables:
    """All nodes have said who they are: system n + 1 is node n."""
    air = Cables(*wired, **given)  # type: ignore[arg-type]
    for n in range(5):
        air.say(n * SECOND, n)
    return air


def test_a_station_at_a_cable_reaches_a_system_four_hops_away_and_gets_its_answer() -> None:
    air = introduced("n0")
    before = air.counts()
    command = air.enter(10 * SECOND, "@n0", packet(STATION, to=5))
    assert air.heard(command) == {4: [40]}  # by the routes that n0 to n3 have learned
    assert air.counts()["relayed"] - before["relayed"] == 4
    last = air.events[-1]
    assert (last["origin"], last["born"]) == (air.names.index("@n0"), 10 * SECOND)
    answer = air.say(20 * SECOND, 4, to=STATION)
    assert air.left("@n0", answer) == [40]
    assert air.heard(answer) == {}
    assert air.counts()["repeated"] == before["repeated"]


def test_what_is_for_all_reaches_each_node_and_each_station_once() -> None:
    air = introduced("n0", "n3")
    hello = air.enter(10 * SECOND, "@n0", packet(STATION))
    assert air.heard(hello) == {0: [0], 1: [10], 2: [20], 3: [30], 4: [40]}
    assert (air.left("@n0", hello), air.left("@n3", hello)) == ([], [30])
    beat = air.say(20 * SECOND, 4, sequence=1)
    assert (air.left("@n3", beat), air.left("@n0", beat)) == ([10], [40])
    between = air.enter(30 * SECOND, "@n3", packet(OTHER, to=STATION))
    assert air.left("@n0", between) == [30]
    assert air.heard(between) == {}


def test_packets_for_others_do_not_leave_by_a_cable_and_those_aboard_are_not_sent_on() -> None:
    air = introduced("n2")
    air.enter(9 * SECOND, "@n2", packet(STATION))
    passing = air.say(10 * SECOND, 0, to=5)
    assert air.heard(passing) == {4: [40]} and air.left("@n2", passing) == []
    before = air.counts()["sent"]
    own = air.enter(20 * SECOND, "@n2", packet(STATION, to=3))  # system 3 is n2 itself
    assert air.heard(own) == {2: [0]}
    assert air.counts()["sent"] == before


def test_a_node_that_does_not_relay_keeps_its_cable_to_itself() -> None:
    air = introduced("n0", relays=(1, 2, 3, 4))
    assert air.heard(air.enter(10 * SECOND, "@n0", packet(STATION))) == {0: [0]}
    assert air.left("@n0", air.say(20 * SECOND, 4)) == []


@pytest.mark.parametrize("hops", [1, 2, 3, 8])
def test_the_relay_at_the_cable_counts_as_one(hops: int) -> None:
    air = introduced("n0", hops=hops)
    before = air.counts()["relayed"]
    assert {*air.heard(air.enter(10 * SECOND, "@n0", packet(STATION)))} == {*range(min(hops, 4) + 1)}
    assert air.counts()["relayed"] - before == min(hops, 4)


def test_a_station_on_the_air_is_not_relayed() -> None:
    """It reaches every node by its own link: once each."""
    air = Relays(5, LINE, range(5), gateways=(Gateway("@gcs"),))
    air.radio = grown(air.radio, 8 * copies(air.radio))
    hello = packet(STATION)
    admit(air.radio, air.reals, 0, 0, np.frombuffer(hello, np.uint8), len(hello))
    air.serve(SECOND)
    assert air.heard(hello) == {n: [0] for n in range(5)}
    assert air.counts()["relayed"] == 0

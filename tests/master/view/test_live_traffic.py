"""The packets of a run for its live page: counts are exact, and the rest stays within its limits."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from cosim_master.network.radio.tables import BY_RADIO, LOST_CHANNEL, LOST_RANGE, ON_BOARD
from cosim_master.results.reading.roles import Part
from cosim_master.stepping.observation import Packets
from cosim_master.system.settings.network import Gateway, Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_master.view.live.traffic import LiveTraffic
from tests.master.view.events import events_of

LATENCY = 20_000_000


class Radio:
    """Broadcasts of made-up nodes, each with an agent, as the loop writes them; `sent` has every copy."""

    def __init__(self, nodes: int, *, gateway: bool = False, **settings: Any) -> None:
        names = [f"drone{i}" for i in range(nodes)]
        made = tuple(Node(name, (Endpoint(f"{name}.agent", None, None),)) for name in names)
        network = Network(nodes=made, gateways=(Gateway("@gcs"),) if gateway else (), **settings)
        self.traffic = LiveTraffic(network, [Part(name, f"{name}.vehicle", f"{name}.agent") for name in names])
        self.events: list[tuple[int, ...]] = []
        self.log = b""
        self.sent: list[tuple[int, int, int, int]] = []
        self._mavlink = ardupilotmega.MAVLink(None, 1, 1)

    def send(self, time: int, source: int, message: Any, fates: dict[int, int]) -> None:
        """Sends a packet at `time` [ns] to nodes with an outcome each."""
        packet = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        for target, outcome in fates.items():
            arrival = time + LATENCY if outcome in (BY_RADIO, ON_BOARD) else -1
            kind = message.get_msgId()
            self.events.append((time, arrival, source, target, kind, 1, 1, message.get_seq(), len(packet), outcome))
            self.sent.append((time, source, target, outcome))
        self.log += struct.pack("<qii", time, 2 * source + 1, len(packet)) + packet
        for target in fates:
            self.log += struct.pack("<qii", time + LATENCY, 2 * target, len(packet)) + packet

    def hand_over(self, *, complete: bool = False) -> None:
        packets = Packets(events_of(self.events), np.frombuffer(self.log, np.uint8))
        self.traffic.packets(packets, complete=complete)
        if complete:
            self.events, self.log = [], b""

    def flights(self, after: int = 0) -> np.ndarray[Any, Any]:
        numbers = np.frombuffer(self.traffic.flights(after, self.traffic.newest[0]), "<f8")
        assert not len(numbers) or np.isnan(numbers[0])
        return numbers[1:].reshape(-1, 5)


def beat() -> Any:
    return ardupilotmega.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)


def text(words: bytes) -> Any:
    return ardupilotmega.MAVLink_statustext_message(4, words)


def test_every_packet_is_counted_once_however_chunks_are_cut() -> None:
    radio = Radio(4, gateway=True)
    rng = np.random.default_rng(5)
    for k in range(300):
        source = int(rng.integers(4))
        fates = {t: int(rng.choice([BY_RADIO, BY_RADIO, LOST_CHANNEL, LOST_RANGE])) for t in range(5) if t != source}
        radio.send(k * 10_000_000, source, beat(), {source: ON_BOARD, **fates})
        if k % 7 == 0:
            radio.hand_over(complete=k % 21 == 0)
    radio.hand_over(complete=True)
    on_air = [one for one in radio.sent if one[3] != ON_BOARD]
    told = radio.traffic.links()
    names = ["drone0", "drone1", "drone2", "drone3", "@gcs"]
    assert {(one["from"], one["to"]): one["sent"] for one in told["links"]} == Counter(
        (names[source], names[target]) for _, source, target, _ in on_air
    )
    causes: Counter[tuple[str, str, str]] = Counter()
    for one in told["links"]:
        causes.update({(one["from"], one["to"], cause): n for cause, n in one["causes"].items()})
        assert one["lost"] == sum(one["causes"].values())
        assert one["delay"] == pytest.approx(0.02, abs=1e-12)
        assert one["rate"] == pytest.approx(one["sent"] / 2.99)
        assert one["vehicle"] == names.index(one["from"])
    said = {LOST_CHANNEL: "lost: channel", LOST_RANGE: "lost: range"}
    assert causes == Counter((names[s], names[t], said[o]) for _, s, t, o in on_air if o in said)
    shares = [one["lost"] / one["sent"] for one in told["links"]]
    assert shares == sorted(shares, reverse=True)
    assert (told["sends"], told["of"]) == (300, 16) and radio.traffic.sends == 300


@pytest.mark.parametrize("settings", [{"medium": "csma"}, {"medium": "aloha"}, {"relays": ("drone1",)}])
def test_a_packet_that_nodes_hear_at_different_times_is_one(settings: dict[str, Any]) -> None:
    """Its rows are in several reports, behind those of packets that were sent later."""
    radio = Radio(3, **settings)
    radio.traffic.watched = True
    radio.send(10, 0, text(b"waits"), {1: BY_RADIO})
    ((_, *first),) = radio.events
    radio.events = []
    radio.send(20, 1, beat(), {1: ON_BOARD})
    radio.hand_over(complete=True)
    assert radio.traffic.sends == 1
    radio.events = [(10, *first)]
    radio.hand_over(complete=True)
    assert radio.traffic.sends == 2
    first[2] = 2  # the second node that hears it
    radio.events = [(10, *first)]
    radio.hand_over(complete=True)
    assert radio.traffic.sends == 2
    names = [one[3] for one in radio.traffic.messages(0, radio.traffic.newest[1])]
    assert names == ["HEARTBEAT", "STATUSTEXT"]
    assert sum(one["sent"] for one in radio.traffic.links()["links"]) == 2


def test_flights_and_messages_are_kept_while_a_page_is_open() -> None:
    radio = Radio(3)
    radio.send(1_000_000_000, 0, text(b"before"), {1: BY_RADIO})
    radio.hand_over()
    assert radio.traffic.newest == (0, 0) and radio.traffic.sends == 1
    radio.traffic.watched = True
    radio.send(2_000_000_000, 1, text(b"hello <b>"), {0: BY_RADIO, 2: LOST_RANGE})
    radio.send(2_000_000_000, 2, beat(), {0: BY_RADIO, 1: BY_RADIO, 2: ON_BOARD})
    radio.hand_over()
    assert radio.flights().tolist() == [
        [2.0, 0.02, 1, 0, 0], [2.0, 0.0, 1, 2, 1], [2.0, 0.02, 2, 0, 0], [2.0, 0.02, 2, 1, 0],
    ]  # fmt: skip
    messages = radio.traffic.messages(0, radio.traffic.newest[1])
    assert messages[0] == [2.0, "drone1.agent", 1, "STATUSTEXT", 1, 1, "hello <b>", True]
    assert messages[1][:6] == [2.0, "drone2.agent", 2, "HEARTBEAT", 2, 0] and messages[1][7] is False
    assert "autopilot 3" in messages[1][6]
    seen = radio.traffic.newest
    radio.hand_over()  # the same chunk, nothing new
    assert radio.traffic.newest == seen
    assert radio.traffic.flights(seen[0], seen[0]) == b"" and radio.traffic.messages(*seen[1:], seen[1]) == []


def test_a_flood_stays_within_the_limits() -> None:
    """1,000 drones that all hear each other: a report has 20,000 copies, and a page that draws slowly misses 100."""
    radio = Radio(1000)
    radio.traffic.watched = True
    for k in range(100):
        for i in range(20):
            time = (20 * k + i) * 1_000_000
            message = text(b"one of many") if (k, i) == (99, 3) else beat()
            radio.send(time, i, message, dict.fromkeys(range(1, 1000, 50), BY_RADIO if i % 2 else LOST_RANGE))
        radio.traffic.wall += 0.05
        radio.hand_over(complete=True)
    flights = radio.flights()
    assert len(flights) == 250 and np.all(np.diff(flights[:, 0]) >= 0)
    assert {*flights[:, 4]} == {0.0, 1.0} and flights[-1, 0] > 1.95  # both fates, up to now
    messages = radio.traffic.messages(0, radio.traffic.newest[1])
    assert len(messages) == 500 and [one[3] for one in messages[-6:]].count("STATUSTEXT") == 1
    assert 20 + 99 * 5 - 1 <= radio.traffic.newest[1] <= 20 + 99 * 5  # 100 per second, and 20 at the beginning
    told = radio.traffic.links()
    assert [one["to"] for one in told["links"]] == ["all"] * 20  # by sender: there could be a million links
    assert sum(one["sent"] for one in told["links"]) == 40_000 == len(radio.sent)
    assert sum(one["lost"] for one in told["links"]) == 20_000


def test_texts_do_not_wait_for_others() -> None:
    radio = Radio(3)
    radio.traffic.watched = True
    for kind in (beat, lambda: text(b"now")):
        for _ in range(30):
            radio.send(0, 0, kind(), {1: BY_RADIO})
        radio.hand_over(complete=True)
    messages = radio.traffic.messages(0, radio.traffic.newest[1])
    assert [one[3] for one in messages] == ["HEARTBEAT"] * 20 + ["STATUSTEXT"] * 20


def test_no_more_links_are_told_than_the_page_shows() -> None:
    radio = Radio(30)
    for source in range(30):
        radio.send(source, source, beat(), {t: LOST_RANGE if t == source + 1 else BY_RADIO for t in range(30)})
    radio.hand_over()
    told = radio.traffic.links()
    assert told["of"] == 900 and len(told["links"]) == 300
    assert [one["lost"] for one in told["links"]] == [1] * 29 + [0] * 271

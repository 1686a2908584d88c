"""A click that sends a drone: the packet, its way into the network, the answer, and the reasons for a refusal."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega

from cosim.verdict import Role
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.network.gateways.packing import mavlink2
from cosim_master.network.radio.tables import BY_RADIO
from cosim_master.results.reading.read import packets, signals
from cosim_master.results.reading.roles import Part, Player
from cosim_master.stepping.observation import Packets, View
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_master.view.live.sending import Sending, reposition
from cosim_master.view.live.traffic import LiveTraffic
from tests.master.view.events import events_of
from tests.master.view.watched import LINE5

LATITUDE, LONGITUDE, ALTITUDE = math.radians(-35.363262), math.radians(149.165237), 584.0
ORIGIN = {
    "drone1.agent": Player(
        {"la": LATITUDE, "lo": LONGITUDE}, {"la": Role.ORIGIN_LATITUDE, "lo": Role.ORIGIN_LONGITUDE}
    ),
    "drone1.autopilot": Player({"al": ALTITUDE}, {"al": Role.ORIGIN_ALTITUDE}),
}  # fmt: skip


@pytest.mark.parametrize("altitude", [594.25, 0.0])
def test_the_packet_is_what_pymavlink_reads(altitude: float) -> None:
    packet = mavlink2(7, 255, 190, 75, reposition(42, -353632620, 1491652370, altitude))
    (message,) = ardupilotmega.MAVLink(None).parse_buffer(packet)
    assert message.get_type() == "COMMAND_INT" and message.get_seq() == 7
    assert (message.get_srcSystem(), message.get_srcComponent()) == (255, 190)
    assert (message.target_system, message.target_component) == (42, 1)
    assert (message.command, message.frame) == (ardupilotmega.MAV_CMD_DO_REPOSITION, 5)
    assert (message.param1, message.param2, message.param3) == (-1.0, 1.0, 0.0) and math.isnan(message.param4)
    assert (message.x, message.y, message.z) == (-353632620, 1491652370, altitude)


def ready(
    mailbox: Mailbox, *, known: Any = ORIGIN, systems: tuple[int, ...] = (1, 2), name: str = "autopilot"
) -> Sending:
    """Two drones whose autopilots have sent packets with these system ids; 0: none."""
    port: Any = object()
    nodes = tuple(Node(f"drone{i}", (Endpoint(f"drone{i}.{name}", port, port),)) for i in (1, 2))
    network = Network(nodes=nodes)
    traffic = LiveTraffic(network, [Part(f"drone{i}", f"drone{i}.vehicle", "") for i in (1, 2)])
    events = [(0, 0, i, 1 - i, 0, system, 1, 0, 20, BY_RADIO) for i, system in enumerate(systems) if system]
    traffic.packets(Packets(events_of(events), np.zeros(0, np.uint8)), complete=True)
    mailbox.refusal = ""
    return Sending(network, known, traffic, mailbox)


def test_places_are_those_of_the_page() -> None:
    mailbox = Mailbox()
    sending = ready(mailbox)
    sending.send("drone2", 100.0, -50.0, -12.5)
    assert sending.said == (1, "drone2: sent to 100.0 m north, -50.0 m east, 12.5 m high")
    (packet,) = mailbox.receive()
    assert mailbox.receive() == []
    (message,) = ardupilotmega.MAVLink(None).parse_buffer(packet)
    assert message.target_system == 2 and message.z == pytest.approx(ALTITUDE + 12.5)
    # 1e-7 degrees are 1.1 cm; the sphere of ArduPilot has 6378100 m
    assert (message.x * 1e-7 - math.degrees(LATITUDE)) * math.pi / 180 * 6378100 == pytest.approx(100.0, abs=0.1)
    east = (message.y * 1e-7 - math.degrees(LONGITUDE)) * math.pi / 180 * 6378100 * math.cos(LATITUDE)
    assert east == pytest.approx(-50.0, abs=0.1)


@pytest.mark.parametrize(
    ("how", "drone", "reason"),
    [
        (lambda box: ready(box, systems=(1, 0)), "drone2", "its autopilot has not sent anything yet"),
        (lambda box: ready(box, name="talker"), "drone2", "it has no autopilot with packet ports"),
        (lambda box: ready(box), "drone9", "it has no autopilot with packet ports"),
        (lambda box: ready(box, systems=(3, 3)), "drone2", "its system id, 3, is also that of drone1.autopilot"),
        (lambda box: ready(box, known={}), "drone2", "no FMU of the run declares the local origin"),
        (lambda box: Sending(Network(), {}, None, ready(box) and box), "drone2", "this run records no packets"),
        (lambda box: Sending(Network(), {}, None, box), "drone2", "the run has not begun"),
    ],
)
def test_the_reason_why_a_drone_cannot_be_sent(how: Callable[[Mailbox], Sending], drone: str, reason: str) -> None:
    mailbox = Mailbox()
    sending = how(mailbox)
    sending.send(drone, 1.0, 2.0, -3.0)
    assert sending.said[1].startswith(f"{drone} cannot be sent there: {reason}")
    assert mailbox.receive() == []


@pytest.mark.parametrize("north", [math.inf, math.nan, 1e7])
def test_places_that_are_none(north: float) -> None:
    mailbox = Mailbox()
    sending = ready(mailbox)
    sending.send("drone1", north, 0.0, 0.0)
    assert sending.said[1] == "drone1 cannot be sent there: it is too far away" and mailbox.receive() == []


def test_answers_are_told() -> None:
    mailbox = Mailbox()
    sending = ready(mailbox)
    mavlink = ardupilotmega.MAVLink(None, 2, 1)
    for command, result in ((192, 0), (192, 2), (400, 0)):
        answer = ardupilotmega.MAVLink_command_ack_message(command, result, target_system=255, target_component=190)
        mailbox.send([answer.pack(mavlink)])
        assert sending.said[1] == ("drone2: accepted" if result == 0 and command == 192 else "drone2: denied")
    assert sending.said[0] == 2


class Clicking:
    """An observer that sends drone 3 somewhere at a time, by the page's mailbox."""

    every = 400

    def __init__(self, mailbox: Mailbox, at: float | None) -> None:
        self.mailbox, self._at, self.refusal = mailbox, at, ""

    def __call__(self, _: View) -> Clicking:
        return self

    def initialised(self, seen: Any) -> None: ...
    def closed(self) -> None: ...

    def stepped(self, seen: Any) -> None:
        self.refusal = self.mailbox.refusal
        if self._at is not None and seen.time >= self._at:
            self._at = None
            self.mailbox.post(mavlink2(1, 255, 190, 75, reposition(3, -353632620 + 900, 1491654582, 594.0)))


def flown(out: Path, at: float | None, **options: Any) -> Clicking:
    clicking = Clicking(Mailbox(), at)
    simulate(LINE5, RunOptions(out=out, until=26.0, **options), observers=[clicking], mailbox=clicking.mailbox)
    return clicking


@pytest.mark.slow
def test_a_drone_flies_there_and_only_then_is_anything_different(fmus: Path, tmp_path: Path) -> None:
    plain, silent, sent = (tmp_path / name for name in ("plain", "silent", "sent"))
    simulate(LINE5, RunOptions(out=plain, until=26.0))
    assert flown(silent, None).refusal == ""
    flown(sent, 14.0, pace=8.0)
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (silent / name).read_bytes() == (plain / name).read_bytes(), name
    assert sorted(file.name for file in silent.rglob("*")) == sorted(file.name for file in plain.rglob("*"))
    manifests = [json.loads((run / "manifest.json").read_text()) for run in (plain, silent, sent)]
    assert manifests[0]["fingerprint"] == manifests[1]["fingerprint"] and manifests[1]["gateways"] == {}
    changed = {
        name for name, digest in manifests[2]["fingerprint"].items() if digest != manifests[0]["fingerprint"][name]
    }
    assert changed == {"real programs"}  # so that no run overwrites it
    (posted,) = manifests[2]["posted"]
    assert bytes.fromhex(posted["packet"]) == mavlink2(
        1, 255, 190, 75, reposition(3, -353632620 + 900, 1491654582, 594.0)
    )
    assert manifests[2]["gateways"]["@page"]["received"] == 1
    of_page = [row for row in packets(sent).to_pylist() if "@page" in (row["source"], row["target"])]
    assert [(row["source"], row["target"], row["message"]) for row in of_page] == [
        ("@page", "drone3", 75), ("drone3.autopilot", "@page", 77),
    ]  # fmt: skip
    assert 14.0 <= of_page[0]["sent"] < 20.0 and of_page[1]["sent"] == pytest.approx(of_page[0]["sent"] + 0.0025)
    log = mavutil.mavlink_connection(str(sent / "packets.tlog"), dialect="ardupilotmega")
    while (message := log.recv_match(type="COMMAND_INT")).get_srcSystem() != 255:
        pass
    assert message.x == -353632620 + 900
    log.close()
    table, before = signals(sent), signals(plain)
    time = table["time"].to_numpy()
    until = time < of_page[0]["sent"]
    for name in table.column_names:
        np.testing.assert_array_equal(table[name].to_numpy()[until], before[name].to_numpy()[until], err_msg=name)
    north, down = (table[f"drone3.vehicle.position[{axis}]"].to_numpy() for axis in (1, 3))
    there = (np.abs(north - 10.0) < 0.1) & (np.abs(down + 10.0) < 0.2)  # 900e-7 degrees are 10.02 m
    assert there.sum() * (time[1] - time[0]) > 0.5  # until the agent sends it back to its line


@pytest.mark.slow
def test_runs_with_checkpoints_take_no_packets(fmus: Path, tmp_path: Path) -> None:
    mailbox = Mailbox()
    seen = Clicking(mailbox, None)
    simulate(LINE5, RunOptions(out=tmp_path, until=2.0, checkpoint_every=1.0), observers=[seen], mailbox=mailbox)
    assert seen.refusal.startswith("a run with checkpoints takes no packets")
    again = Clicking(Mailbox(), None)
    simulate(LINE5, RunOptions(origin=f"{tmp_path}@1"), observers=[again], mailbox=again.mailbox)
    assert again.refusal.startswith("a run with checkpoints takes no packets")


def test_packets_of_several_threads_are_all_taken() -> None:
    mailbox = Mailbox()
    threads = [threading.Thread(target=lambda: [mailbox.post(b"x") for _ in range(500)]) for _ in range(4)]
    for one in threads:
        one.start()
    taken = 0
    while any(one.is_alive() for one in threads):
        taken += len(mailbox.receive())
    assert taken + len(mailbox.receive()) == 2000
    mailbox.close()
    assert mailbox.refusal == "the run has ended"

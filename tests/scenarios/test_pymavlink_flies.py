"""pymavlink against a running swarm, over loopback: at the serial port of a vehicle, and as a ground station."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.recording.packet_log import EPOCH
from tests.scenarios.flights import SYSTEMS, copy_of, fly
from tests.scenarios.swarm import START_UP, Swarm, running

pytestmark = pytest.mark.slow

ARM, TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
MODE, STREAMS = mavlink.MAV_CMD_DO_SET_MODE, 4
ACCEPTED, GUIDED, ARMED = (mavlink.MAV_RESULT_ACCEPTED, mavlink.COPTER_MODE_GUIDED, mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
PACE = 4.0
KEY = bytes(range(32))


class Client:
    """A pymavlink connection to one vehicle: ask, and wait for what it says."""

    def __init__(self, address: str, vehicle: int) -> None:
        self.link: Any = mavutil.mavlink_connection(address, source_system=255)
        self.vehicle = vehicle
        self.wait("HEARTBEAT", lambda m: m.autopilot == 3, START_UP)
        self.link.mav.request_data_stream_send(vehicle, 1, 0, STREAMS, 1)

    def wait(self, kind: str, condition: Callable[[Any], Any] = lambda _: True, seconds: float = 120.0) -> Any:
        end = time.monotonic() + seconds
        seen = None
        while time.monotonic() < end:
            message = self.link.recv_match(type=kind, blocking=True, timeout=1)
            if message is not None and message.get_srcSystem() == self.vehicle:
                seen = message
                if condition(message):
                    return message
        raise AssertionError(f"no such {kind}; the last: {seen}")

    def command(self, command: int, p1: float = 0.0, p2: float = 0.0, p7: float = 0.0) -> int:
        self.link.mav.command_long_send(self.vehicle, 1, command, 0, p1, p2, 0, 0, 0, 0, p7)
        return int(self.wait("COMMAND_ACK", lambda m: m.command == command).result)

    def take_off(self, height: float) -> None:
        """Until it can be armed, to GUIDED, armed, and up."""
        self.wait("EKF_STATUS_REPORT", lambda m: m.flags & 512)
        assert self.command(MODE, 1, GUIDED) == ACCEPTED
        self.wait("HEARTBEAT", lambda m: m.custom_mode == GUIDED)
        assert self.command(ARM, 1) == ACCEPTED
        self.wait("HEARTBEAT", lambda m: m.base_mode & ARMED)
        assert self.command(TAKEOFF, p7=height) == ACCEPTED
        self.wait("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 950 * height)

    def go_to(self, north: float, east: float, height: float) -> None:
        """To a place relative to the present one; until it is there."""
        here = self.wait("GLOBAL_POSITION_INT")
        degree = 1e7 * 180.0 / math.pi / 6378100.0
        lat = here.lat + round(north * degree)
        lon = here.lon + round(east * degree / math.cos(math.radians(here.lat * 1e-7)))
        self.link.mav.set_position_target_global_int_send(
            0, self.vehicle, 1, 6, 0x0DF8, lat, lon, height, 0, 0, 0, 0, 0, 0, 0, 0
        )
        near = 0.5 * degree
        self.wait("GLOBAL_POSITION_INT", lambda m: abs(m.lat - lat) < near and abs(m.lon - lon) < 1.2 * near)


def test_a_client_flies_a_vehicle_at_its_port(tmp_path: Path, fmus: Path) -> None:
    with running(tmp_path / "out", "--ports", "tcp:0", pace=PACE) as swarm:
        client = Client(f"tcp:127.0.0.1:{swarm.port('@drone3')}", 3)
        client.take_off(10.0)
        client.go_to(12.0, -5.0, 10.0)
        client.link.close()
        manifest = swarm.stop()
    counts = manifest["gateways"]["@drone3"]
    assert counts["connections"] == 1
    assert counts["received"] >= 5
    assert "malformed" not in counts
    assert manifest["gateways"]["@drone1"]["not taken"] > 0  # nobody has been there
    assert _crossed(tmp_path / "out" / "packets" / "@drone3.tlog") == (counts["received"], {3, 255})


def test_a_client_at_a_relays_port_commands_the_farthest_drone(tmp_path: Path, fmus: Path) -> None:
    """A radio in which drones hear their neighbours only: at drone 1, by four hops, drone 5 is heard and obeys."""
    links = "".join(f'<link between="drone{i} drone{i + 1}"/>' for i in range(1, 5))

    def line(text: str) -> str:
        new = f'<network xmlns="https://uav-cosim.org/ns/1" topology="listed" relays="*">{links}</network>'
        return re.sub(r"<network [^>]*/>", new, text)

    system = copy_of("line5-script", tmp_path, fmus, line)
    with running(tmp_path / "out", "--ports", "tcp:0", pace=PACE, system=str(system)) as swarm:
        client = Client(f"tcp:127.0.0.1:{swarm.port('@drone1')}", 5)
        client.wait("EKF_STATUS_REPORT", lambda m: m.flags & 512)
        assert client.command(MODE, 1, GUIDED) == ACCEPTED
        client.wait("HEARTBEAT", lambda m: m.custom_mode == GUIDED)
        client.link.close()
        manifest = swarm.stop()
    assert manifest["packets"]["relayed"] > 8
    assert manifest["gateways"]["@drone1"]["received"] >= 2


def test_a_port_with_a_key_obeys_who_signs(tmp_path: Path, fmus: Path) -> None:
    (tmp_path / "key").write_text(KEY.hex())
    with running(tmp_path / "out", "--ports", f"tcp:0,sign={tmp_path / 'key'}", pace=PACE) as swarm:
        address = f"tcp:127.0.0.1:{swarm.port('@drone1')}"
        stranger: Any = mavutil.mavlink_connection(address, source_system=255)
        assert stranger.wait_heartbeat(timeout=60) is not None  # it can listen
        stranger.mav.command_long_send(1, 1, MODE, 0, 1, GUIDED, 0, 0, 0, 0, 0)
        assert stranger.recv_match(type="COMMAND_ACK", blocking=True, timeout=2) is None
        stranger.close()
        friend: Any = mavutil.mavlink_connection(address, source_system=255)
        friend.setup_signing(KEY)
        assert friend.wait_heartbeat(timeout=60).get_signed()
        friend.mav.command_long_send(1, 1, MODE, 0, 1, GUIDED, 0, 0, 0, 0, 0)
        assert friend.recv_match(type="COMMAND_ACK", blocking=True, timeout=60).result == ACCEPTED
        friend.close()
        counts = swarm.stop()["gateways"]["@drone1"]
    assert (counts["received"], counts["unsigned"], counts["connections"]) == (1, 1, 2)


def test_a_ground_station_flies_two_vehicles_by_radio(tmp_path: Path, fmus: Path) -> None:
    with running(tmp_path / "out", "--gcs", "udpin:0,latency=0.05", pace=PACE) as swarm:
        port = swarm.port("@gcs")
        hello = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255)
        for vehicle in (2, 5):
            client = Client.__new__(Client)
            client.link, client.vehicle = hello, vehicle
            _greet(swarm, client)
            client.take_off(5.0)
        heard = {hello.recv_match(type="HEARTBEAT", blocking=True, timeout=60).get_srcSystem() for _ in range(30)}
        assert heard == {1, 2, 3, 4, 5}
        hello.close()
        manifest = swarm.stop()
    assert manifest["gateways"]["@gcs"]["connections"] == 1
    assert _crossed(tmp_path / "out" / "packets" / "@gcs.tlog")[1] == {1, 2, 3, 4, 5, 255}


def _greet(swarm: Swarm, client: Client) -> None:
    """A ground station that listens is heard once it speaks: say so until the vehicle answers."""
    for _ in range(int(START_UP)):
        client.link.mav.heartbeat_send(6, 8, 0, 0, 0)
        try:
            client.wait("HEARTBEAT", seconds=2.0)
            break
        except AssertionError:
            assert swarm.process.poll() is None, swarm.lines
    client.link.mav.request_data_stream_send(client.vehicle, 1, 0, STREAMS, 1)


def _crossed(tlog: Path) -> tuple[int, set[int]]:
    """How many packets of the client are in a log, and which systems have spoken."""
    log = mavutil.mavlink_connection(str(tlog))
    senders = []
    times = [EPOCH * 1e-6]
    while (message := log.recv_match()) is not None:
        senders.append(message.get_srcSystem())
        times.append(message._timestamp)
    log.close()
    assert times == sorted(times)
    return senders.count(255), set(senders)


def test_what_one_client_asks_for_no_one_else_hears(tmp_path: Path, fmus: Path) -> None:
    """A client at the port of drone 2 asks for all streams at 50 Hz, a ground station by radio for nothing."""
    with running(tmp_path / "out", "--ports", "tcp:0", "--gcs", "udpin:0", system="line5", pace=PACE) as swarm:
        client = Client(f"tcp:127.0.0.1:{swarm.port('@drone2')}", 2)
        client.link.mav.request_data_stream_send(2, 1, 0, 50, 1)
        for _ in range(100):
            client.wait("ATTITUDE")
        client.link.close()
        swarm.stop()
    packets = tmp_path / "out" / "packets"
    assert _count(packets / "@drone2.tlog", "ATTITUDE") >= 100
    others = ["@gcs", "@drone1", "drone1", "drone2", "drone3"]
    assert {name: _count(packets / f"{name}.tlog", "ATTITUDE") for name in others} == dict.fromkeys(others, 0)
    assert _count(packets / "@gcs.tlog", "HEARTBEAT") > 0
    assert _count(packets / "drone2.tlog", "GLOBAL_POSITION_INT") > 0  # what the agent has asked for goes on


def _count(tlog: Path, kind: str) -> int:
    """How many messages of a kind are in a log."""
    log = mavutil.mavlink_connection(str(tlog))
    found = 0
    while log.recv_match(type=kind) is not None:
        found += 1
    log.close()
    return found


def test_a_gateway_that_only_listens_changes_nothing(tmp_path: Path, fmus: Path) -> None:
    alone = fly(SYSTEMS / "line5", tmp_path / "alone", until=30.0)
    heard: list[str] = []
    result = simulate(
        SYSTEMS / "line5",
        RunOptions(out=tmp_path / "heard", until=30.0, gcs=["udpin:0"], ports="tcp:0"),
        listener=Listener(gateway=heard.append),
    )
    assert result.outcome == "done"
    assert len(heard) == 6
    assert all("listens on 127.0.0.1:" in line for line in heard)
    assert _same_bytes(tmp_path / "alone" / "signals.parquet", tmp_path / "heard" / "signals.parquet")
    radio = ("lost: channel", "lost: range", "malformed", "deferred")
    assert {n: alone.result.packets[n] for n in radio} == {n: result.packets[n] for n in radio}
    for drone in range(1, 6):
        one = f"packets/drone{drone}.tlog"
        assert (tmp_path / "alone" / one).read_bytes() == (tmp_path / "heard" / one).read_bytes()


def _same_bytes(a: Path, b: Path) -> bool:
    import pyarrow.parquet as pq

    return bool(pq.read_table(a).equals(pq.read_table(b)))


@pytest.mark.parametrize("options", [("--ports", "tcp:0", "--gcs", "udpin:0", "--gcs", "tcp:0"), ()])
def test_nothing_listens_beyond_loopback(options: tuple[str, ...], tmp_path: Path, fmus: Path) -> None:
    expected = 7 if options else 0
    with running(tmp_path / "out", *options) as swarm:
        end = time.monotonic() + START_UP
        while not (tmp_path / "out" / "unfinished" / "signals.arrows").exists():
            assert time.monotonic() < end, "the run does not begin"
            time.sleep(0.1)
        while sum("listens on" in line for line in swarm.lines) < expected and time.monotonic() < end:
            time.sleep(0.1)
        bound = _sockets(swarm.process.pid)
    assert len(bound) == expected
    assert {host for host, _ in bound} <= {"127.0.0.1"}


def _sockets(pid: int) -> list[tuple[str, int]]:
    """Addresses that a process listens on (TCP) or is bound to (UDP), as Linux lists them."""
    inodes = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            name = str(descriptor.readlink())
        except OSError:
            continue
        if name.startswith("socket:["):
            inodes.add(name[8:-1])
    found = []
    for kind in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/{pid}/net/{kind}").read_text().splitlines()[1:]:
            _, local, remote, _, *rest = line.split()
            if rest[5] in inodes and remote.endswith(":0000"):
                host, _, port = local.rpartition(":")
                found.append((".".join(str(b) for b in reversed(bytes.fromhex(host))), int(port, 16)))
    return found

"""The server for Foxglove, by a client of its own that speaks the protocol of its WebSocket."""

from __future__ import annotations

import base64
import json
import socket
import struct
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import View

pytest.importorskip("foxglove", reason="the extra `export` is not installed")
websockets = pytest.importorskip("websockets", reason="the extra `live` is not installed")
from websockets.sync.client import connect  # noqa: E402

from cosim_master.view.programs.foxglove_server import FoxgloveFeed  # noqa: E402

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"
LONG = 120.0
"""s; every wait is for an event."""
START = 1_735_689_600 * 10**9
"""2025-01-01T00:00:00Z, ns"""
MESSAGE, TIME = 1, 2
"""Operations of binary messages of the server."""


def options(out: Path) -> RunOptions:
    """Four seconds, recorded at every base step."""
    return RunOptions(out=out, until=4.0, overrides={"recording.interval": "0.0025"})


class Client:
    """A client: what it has received is in `messages`, by topic, as (time in ns, message)."""

    def __init__(self, port: int) -> None:
        self._opened = connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], proxy=None, max_size=None)
        self.socket = self._opened.__enter__()
        self.told: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        self.times: list[int] = []
        self._decode: dict[int, tuple[str, Any]] = {}

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.__exit__(None, None, None)

    def read(self) -> None:
        """Takes one message of the server."""
        received = self.socket.recv(LONG)
        if isinstance(received, str):
            document = json.loads(received)
            self.told[document["op"]] = document
            if document["op"] == "advertise":
                self.channels |= {one["topic"]: one for one in document["channels"]}
        elif received[0] == MESSAGE:
            subscription, stamp = struct.unpack_from("<IQ", received, 1)
            topic, decode = self._decode[subscription]
            self.messages[topic].append((stamp, decode(received[13:])))
        elif received[0] == TIME:
            self.times.append(*struct.unpack_from("<Q", received, 1))

    def subscribe(self, *topics: str) -> None:
        subscriptions = []
        for topic in topics:
            while topic not in self.channels:
                self.read()
            channel, number = self.channels[topic], len(self._decode) + 1
            self._decode[number] = topic, json.loads if channel["encoding"] == "json" else _protobuf(channel)
            subscriptions.append({"id": number, "channelId": channel["id"]})
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def rest(self) -> None:
        """Takes all that comes until the server closes the connection."""
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            while True:
                self.read()


def _protobuf(channel: dict[str, Any]) -> Any:
    """A decoder made from the schema that the server sends."""
    assert channel["encoding"] == channel["schemaEncoding"] == "protobuf"
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    waiting = list(files.file)
    while waiting:
        ready = [one for one in waiting if all(_known(pool, name) for name in one.dependency)]
        assert ready
        for one in ready:
            pool.Add(one)
            waiting.remove(one)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"])).FromString


def _known(pool: Any, name: str) -> bool:
    try:
        pool.FindFileByName(name)
    except KeyError:
        return False
    return True


class Served:
    """A run that stands still until its client has subscribed."""

    def __init__(self) -> None:
        self.control = Control(2.0)
        self.control.pause()
        self.begun = threading.Event()

    def run(self, out: Path) -> Any:
        try:
            return simulate(
                LINE5,
                options(out),
                observers=[self._observer],
                listener=Listener(prepared=self._prepared),
                control=self.control,
            )
        finally:
            self.feed.close()

    def _observer(self, view: View) -> FoxgloveFeed:
        self.feed = FoxgloveFeed(view)
        return self.feed

    def _prepared(self, ready: Prepared) -> None:
        self.feed.serve(ready.checked, 0)
        self.begun.set()


TOPICS = ("/tf", "/drone2/pose", "/drone2/fix", "/scene", "/signals/drone2.vehicle", "/signals/drone3.agent")


@pytest.fixture(scope="module")
def seen(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Client]]:
    """A run, recorded at every base step, and what a client has received of it."""
    out = tmp_path_factory.mktemp("served") / "run"
    served, clients = Served(), []

    def read() -> None:
        try:
            assert served.begun.wait(LONG)
            with Client(served.feed.port) as client:
                clients.append(client)
                client.subscribe(*TOPICS)
                served.control.resume()
                client.rest()
        finally:
            served.control.resume()

    reading = threading.Thread(target=read)
    reading.start()
    try:
        result = served.run(out)
    finally:
        served.control.resume()
        reading.join()
    assert result.outcome == "done"
    yield out, clients[0]


def test_values_are_those_of_the_recording(seen: tuple[Path, Client]) -> None:
    out, client = seen
    table = pq.read_table(out / "signals.parquet")
    row = {START + round(1e9 * t): i for i, t in enumerate(table["time"].to_pylist())}

    def recorded(name: str, size: int) -> np.ndarray:
        return np.stack([table[f"{name}[{i + 1}]"].to_numpy() for i in range(size)], axis=1)

    position, attitude = recorded("drone2.vehicle.position", 3), recorded("drone2.vehicle.attitude", 4)
    assert len({stamp for stamp, _ in client.messages["/drone2/pose"]}) > 3
    for stamp, pose in client.messages["/drone2/pose"]:
        north, east, down = position[row[stamp]]
        place = pose.pose.position
        assert (place.x, place.y, place.z) == (east, north, -down) and pose.frame_id == "map"
        assert pose.timestamp.seconds * 10**9 + pose.timestamp.nanos == stamp
    for stamp, transforms in client.messages["/tf"]:
        (one,) = [one for one in transforms.transforms if one.child_frame_id == "drone2"]
        assert one.translation.z == -position[row[stamp], 2]
        w, x, y, z = attitude[row[stamp]]
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))  # from north, clockwise
        q = one.rotation
        turned = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))  # from east, the other way
        assert np.cos(turned + yaw - np.pi / 2) == pytest.approx(1.0, abs=1e-9)
    for stamp, fix in client.messages["/drone2/fix"]:
        assert fix.altitude == pytest.approx(584.0 - position[row[stamp], 2], abs=1e-9)
        assert fix.latitude == pytest.approx(-35.363262, abs=1e-4)
    for topic, columns in (
        ("/signals/drone2.vehicle", {"position": 3, "on_ground": 0}),
        ("/signals/drone3.agent", {"state": 0, "target": 0}),
    ):
        for stamp, values in client.messages[topic]:
            for name, size in columns.items():
                of = f"{topic.rpartition('/')[2]}.{name}"
                expected = [table[f"{of}[{i + 1}]"][row[stamp]].as_py() for i in range(size)]
                assert values[name] == (expected if size else table[of][row[stamp]].as_py()), (of, stamp)
    assert client.times == sorted(client.times) and set(client.times) <= set(row)


def test_it_says_who_it_is_and_what_it_has(seen: tuple[Path, Client]) -> None:
    _, client = seen
    assert client.socket.subprotocol == "foxglove.sdk.v1"
    assert client.told["serverInfo"]["name"] == "line5" and client.told["serverInfo"]["capabilities"] == ["time"]
    schemas = {topic: channel["schemaName"] for topic, channel in client.channels.items()}
    assert schemas["/tf"] == "foxglove.FrameTransforms" and schemas["/scene"] == "foxglove.SceneUpdate"
    drones = [f"drone{i}" for i in range(1, 6)]
    assert {f"/{drone}/{of}" for drone in drones for of in ("pose", "fix")} < {*schemas}
    assert {f"/signals/{drone}.{of}" for drone in drones for of in ("agent", "autopilot", "vehicle")} < {*schemas}
    ((_, scene),) = client.messages["/scene"]
    assert [entity.id for entity in scene.entities] == drones
    described = json.loads(client.channels["/signals/drone2.vehicle"]["schema"])["properties"]
    assert described["position"]["type"] == "array" and described["position"]["description"].endswith("[m]")
    assert described["on_ground"]["type"] == "boolean"


def test_a_run_records_the_same_with_and_without_it(seen: tuple[Path, Client], tmp_path: Path) -> None:
    out, _ = seen
    simulate(LINE5, options(tmp_path / "plain"))
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (out / name).read_bytes() == (tmp_path / "plain" / name).read_bytes(), name


def closed(port: int) -> None:
    """Until nobody listens; the server's threads end on their own."""
    end = time.monotonic() + LONG
    while time.monotonic() < end:
        try:
            socket.create_connection(("127.0.0.1", port), LONG).close()
        except OSError:
            return
        time.sleep(0.05)
    raise AssertionError(f"port {port} stays open")


def test_the_verb_serves_on_loopback(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ports: list[int] = []
    serve = FoxgloveFeed.serve

    def served(self: FoxgloveFeed, checked: Any, port: int) -> None:
        serve(self, checked, port)
        with Client(self.port) as client:
            client.read()
            assert client.told["serverInfo"]["name"] == "line5"
        with pytest.raises(OSError), socket.create_connection(("127.0.0.2", self.port), LONG):
            pass
        ports.append(self.port)

    monkeypatch.setattr(FoxgloveFeed, "serve", served)
    command = ["run", str(LINE5), "--until", "0.1", "-q", "--pace", "1000", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, [*command, "--foxglove", "0"])
    assert done.exit_code == 0, done.stderr
    assert f"Foxglove: ws://127.0.0.1:{ports[0]}\n" in done.stderr
    closed(ports[0])
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = CliRunner().invoke(app, [*command, "--foxglove", str(port), "--force"])
    assert done.exit_code == 1
    assert f"error: --foxglove {port}: the port of 127.0.0.1 cannot be opened: " in " ".join(done.stderr.split())


def test_it_says_when_its_server_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    done = CliRunner().invoke(app, ["run", str(LINE5), "--foxglove", "0"])
    assert done.exit_code == 2
    assert "foxglove is not installed; try pip install 'uav-cosim[export]'" in " ".join(done.stderr.split())

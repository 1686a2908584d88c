"""What ROS 2 hears of a run: a second process with types of its own listens, and rosbags reads the bytes."""

from __future__ import annotations

import base64
import math
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.results.export.contents.packet_log import packets_of
from cosim_master.results.reading.read import packets
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import Progress, View
from tests.master.results.export.conftest import rotation

pytest.importorskip("cyclonedds", reason="the extra `ros2` is not installed")

from cosim_master.view.programs.ros.feed import RosFeed
from cosim_master.view.programs.ros.mavlink import packet_of
from cosim_master.view.programs.ros.ros1 import MAVLINK_MESSAGE
from cosim_master.view.programs.ros.ros2 import Ros2

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"
START = 1_735_689_600 * 10**9
DOMAIN = 91
KINDS = {
    "tf": "tf2_msgs/msg/TFMessage",
    "drone2/pose": "geometry_msgs/msg/PoseStamped",
    "drone2/odom": "nav_msgs/msg/Odometry",
    "drone2/fix": "sensor_msgs/msg/NavSatFix",
    "clock": "rosgraph_msgs/msg/Clock",
    "drone2/mavlink_source": "mavros_msgs/msg/Mavlink",
}

Heard = Mapping[str, list[bytes]]


def options(out: Path) -> RunOptions:
    """Six seconds, recorded at every base step, with wind."""
    overrides = {"recording.interval": "0.0025", "drone*.vehicle.wind[2]": "4"}
    return RunOptions(out=out, until=6.0, overrides=overrides)


@pytest.fixture(scope="module")
def heard(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Heard]:
    """A run at real time, and the bytes of the messages that the listener has received, by topic."""
    out = tmp_path_factory.mktemp("published") / "run"
    feeds: list[RosFeed] = []

    def observer(view: View) -> RosFeed:
        feeds.append(RosFeed(view, Ros2(DOMAIN)))
        return feeds[0]

    def prepared(ready: Prepared) -> None:
        feeds[0].serve(ready.checked, ready.network, Mailbox(), packets=True)

    command = [sys.executable, str(Path(__file__).with_name("ros2_listener.py")), str(DOMAIN)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listener:
        assert listener.stdout is not None and listener.stdout.readline() == "ready\n"
        result = simulate(
            LINE5, options(out), observers=[observer], listener=Listener(prepared=prepared), control=Control(1.0)
        )
        feeds[0].close()
        lines = listener.stdout.read().splitlines()
    assert result.outcome == "done" and listener.returncode == 0
    found: dict[str, list[bytes]] = defaultdict(list)
    for line in lines:
        topic, _, text = line.partition(" ")
        found[topic].append(base64.b64decode(text))
    return out, found


@pytest.fixture(scope="module")
def table(heard: tuple[Path, Heard]) -> pa.Table:
    return pq.read_table(heard[0] / "signals.parquet")


def test_values_are_those_of_the_recording_and_bytes_those_of_rosbags(
    heard: tuple[Path, Heard], table: pa.Table
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(MAVLINK_MESSAGE, "mavros_msgs/msg/Mavlink"))
    row = {START + round(1e9 * t): i for i, t in enumerate(table["time"].to_pylist())}
    messages: dict[str, list[tuple[int, Any]]] = {}
    for topic, kind in KINDS.items():
        assert len(heard[1][topic]) > 3, topic
        messages[topic] = []
        for data in heard[1][topic]:
            message = store.deserialize_cdr(data, kind)
            assert bytes(store.serialize_cdr(message, kind)) == data
            first = message.transforms[0] if topic == "tf" else message
            stamp = message.clock if topic == "clock" else first.header.stamp
            messages[topic].append((row[stamp.sec * 10**9 + stamp.nanosec], message))
    assert len(messages["clock"]) >= len(messages["drone2/pose"])

    def recorded(name: str, size: int) -> np.ndarray:
        return np.stack([table[f"drone2.vehicle.{name}[{i + 1}]"].to_numpy() for i in range(size)], axis=1)

    position, attitude = recorded("position", 3), recorded("attitude", 4)
    velocity, turning = recorded("velocity", 3), recorded("angular_velocity", 3)
    for k, message in messages["drone2/pose"]:
        p, q = message.pose.position, message.pose.orientation
        assert (p.y, p.x, -p.z) == tuple(position[k]) and message.header.frame_id == "map"
        expected = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ rotation(attitude[k]) @ np.diag([1, -1, -1])
        np.testing.assert_allclose(rotation(np.array([q.w, q.x, q.y, q.z])), expected, atol=1e-12)
    for k, message in messages["drone2/odom"]:
        forward, right, down = rotation(attitude[k]).T @ velocity[k]
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        np.testing.assert_allclose((linear.x, linear.y, linear.z), (forward, -right, -down), atol=1e-12)
        assert (angular.x, -angular.y, -angular.z) == tuple(turning[k]) and message.child_frame_id == "drone2"
    for k, message in messages["drone2/fix"]:
        assert message.altitude == pytest.approx(584.0 - position[k, 2], abs=1e-9)
    for k, message in messages["tf"]:
        assert [one.child_frame_id for one in message.transforms] == [f"drone{i}" for i in range(1, 6)]
        assert message.transforms[1].transform.translation.x == position[k, 1]


def test_packets_are_those_that_the_drone_sends(heard: tuple[Path, Heard]) -> None:
    """From the first one that the reader hears to the last one, as the run's own log has them."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(MAVLINK_MESSAGE, "mavros_msgs/msg/Mavlink"))
    found = []
    for data in heard[1]["drone2/mavlink_source"]:
        message = store.deserialize_cdr(data, "mavros_msgs/msg/Mavlink")
        stamp = message.header.stamp
        found.append(((stamp.sec * 10**9 + stamp.nanosec) // 1000, packet_of(message)))
    sent = [(p.stamp, p.data) for p in packets_of((heard[0] / "packets.tlog").read_bytes()) if p.address[0] == 2]
    assert len(found) > 20 and found == sent[sent.index(found[0]) :][: len(found)]


def test_a_run_records_the_same_with_and_without_it(heard: tuple[Path, Heard], tmp_path: Path) -> None:
    simulate(LINE5, options(tmp_path / "plain"))
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (heard[0] / name).read_bytes() == (tmp_path / "plain" / name).read_bytes(), name


@pytest.mark.slow
def test_a_program_flies_a_drone(fmus: Path, tmp_path: Path) -> None:
    program = Path(__file__).with_name("ros2_pilot.py")
    number = DOMAIN + 3
    command = [sys.executable, str(program), str(number)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as pilot:
        assert pilot.stdout is not None and pilot.stdout.readline() == "ready\n"
        feeds: list[RosFeed] = []
        mailbox, told = Mailbox(), []
        stop = threading.Event()

        def observer(view: View) -> RosFeed:
            feeds.append(RosFeed(view, Ros2(number), told.append))
            return feeds[0]

        def prepared(ready: Prepared) -> None:
            feeds[0].serve(ready.checked, ready.network, mailbox, packets=True)

        def progress(_: Progress) -> None:
            if pilot.poll() is not None:
                stop.set()

        result = simulate(
            LINE5.parent / "line5-script",
            RunOptions(out=tmp_path / "run", until=600.0),
            observers=[observer, lambda _: Ending(stop)],
            listener=Listener(prepared=prepared, progress=progress),
            control=Control(4.0),
            mailbox=mailbox,
        )
        feeds[0].close()
        east, north, up, heading, to_east, to_north, to_up = map(float, pilot.stdout.read().split())
    assert result.outcome == "violated" and pilot.returncode == 0 and told == []  # `Ending` ends the run
    assert math.dist((east, north, up), (42.0, -20.0, 14.0)) < 0.15
    assert abs(math.remainder(heading - 0.5, 2.0 * math.pi)) < 0.05
    assert -12.5 < to_east < -8.0 and abs(to_north) < 0.5 and abs(to_up) < 0.5
    rows = packets(tmp_path / "run", ["source", "target", "message", "outcome"]).to_pylist()
    sent = [one for one in rows if one["source"] == "@page" and one["target"] == "drone2"]
    assert {76, 84} <= {one["message"] for one in sent} and {one["outcome"] for one in sent} == {"radio"}


class Ending:
    """An observer that ends the run."""

    every = 40
    periods, prompt = (40,), False

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop

    @property
    def over(self) -> bool:
        return self._stop.is_set()

    def initialised(self, seen: object) -> None: ...
    def stepped(self, seen: object) -> None: ...
    def packets(self, packets: object, *, complete: bool) -> None: ...
    def closed(self) -> None: ...


def test_the_verb(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["run", str(LINE5), "--until", "0.1", "-q", "--pace", "1000", "--ros2", str(DOMAIN + 1)]
    done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "a")])
    assert done.exit_code == 0 and done.stderr == f"ROS 2: domain {DOMAIN + 1}, publishes 22 topics, hears 15\n"
    done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "b"), "--record", "*.motor*"])
    assert done.exit_code == 1
    assert "ROS: line5 records no positions of vehicles, so nothing can be published" in " ".join(done.stderr.split())
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><General><Nothing/></General></Domain></CycloneDDS>")
    done = CliRunner().invoke(app, [*command[:-1], str(DOMAIN + 2), "-o", str(tmp_path / "c")])
    assert done.exit_code == 1 and f"error: --ros2 {DOMAIN + 2}: DDS cannot open this domain: " in done.stderr


def test_it_says_when_dds_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    modules = sys.modules
    for name in [name for name in modules if name.partition(".")[0] == "cyclonedds" or "ros2" in name]:
        if name != __name__:
            monkeypatch.delitem(modules, name)
    monkeypatch.setitem(modules, "cyclonedds", None)
    done = CliRunner().invoke(app, ["run", str(LINE5), "--ros2", "0"])
    assert done.exit_code == 2
    assert "cyclonedds is not installed; try pip install 'uav-cosim[ros2]'" in " ".join(done.stderr.split())

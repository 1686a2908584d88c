"""What ROS 2 hears of a run: a second process with types of its own listens, and rosbags reads the bytes."""

from __future__ import annotations

import base64
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import View
from tests.master.results.export.conftest import rotation

pytest.importorskip("cyclonedds", reason="the extra `ros2` is not installed")

from cosim_master.view.programs.ros2_publisher import Ros2Feed

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"
START = 1_735_689_600 * 10**9
DOMAIN = 91
KINDS = {
    "tf": "tf2_msgs/msg/TFMessage",
    "drone2/pose": "geometry_msgs/msg/PoseStamped",
    "drone2/odom": "nav_msgs/msg/Odometry",
    "drone2/fix": "sensor_msgs/msg/NavSatFix",
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
    feeds: list[Ros2Feed] = []

    def observer(view: View) -> Ros2Feed:
        feeds.append(Ros2Feed(view))
        return feeds[0]

    def prepared(ready: Prepared) -> None:
        feeds[0].serve(ready.checked, DOMAIN)

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
    row = {START + round(1e9 * t): i for i, t in enumerate(table["time"].to_pylist())}
    messages: dict[str, list[tuple[int, Any]]] = {}
    for topic, kind in KINDS.items():
        assert len(heard[1][topic]) > 3, topic
        messages[topic] = []
        for data in heard[1][topic]:
            message = store.deserialize_cdr(data, kind)
            assert bytes(store.serialize_cdr(message, kind)) == data
            header = message.transforms[0].header if topic == "tf" else message.header
            messages[topic].append((row[header.stamp.sec * 10**9 + header.stamp.nanosec], message))

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


def test_a_run_records_the_same_with_and_without_it(heard: tuple[Path, Heard], tmp_path: Path) -> None:
    simulate(LINE5, options(tmp_path / "plain"))
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (heard[0] / name).read_bytes() == (tmp_path / "plain" / name).read_bytes(), name


def test_the_verb(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["run", str(LINE5), "--until", "0.1", "-q", "--pace", "1000", "--ros2", str(DOMAIN + 1)]
    done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "a")])
    assert done.exit_code == 0 and done.stderr == f"ROS 2: domain {DOMAIN + 1}, 16 topics\n"
    done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "b"), "--record", "*.motor*"])
    assert done.exit_code == 1
    assert "--ros2: line5 records no positions of vehicles, so nothing can be published" in " ".join(
        done.stderr.split()
    )
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

"""What ROS 1 hears of a run, and what the run hears: the real roscore, rostopic and rospy of Debian 12."""

from __future__ import annotations

import base64
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.results.export.contents.packet_log import packets_of
from cosim_master.results.reading.read import signals
from cosim_master.view.programs.ros.mavlink import packet_of
from cosim_master.view.programs.ros.ros1 import Ros1, _store
from tests.master.view.ros1 import PYTHON, environment, lacking, roscore

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"
MD5 = "41093e1fd0f3eea1da2aa33a177e5ba6"
START = 1_735_689_600
TARGET = """header: {frame_id: map}
pose: {position: {x: 7.0, y: 60.0, z: 15.0}, orientation: {w: 1.0}}
"""


@pytest.fixture(autouse=True, scope="module")
def ros_1() -> None:
    """Asked for by those who run these tests, and not by all who collect them: ROS takes half a second to import."""
    if reason := lacking():
        pytest.skip(f"ROS 1: {reason}")


@pytest.fixture(scope="module")
def master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    with roscore(tmp_path_factory.mktemp("ros")) as port:
        yield port


def test_the_packets_have_the_type_of_mavros() -> None:
    """The MD5 sum of mavros_msgs/Mavlink, as MATLAB's ROS Toolbox has it."""
    assert _store().generate_msgdef("mavros_msgs/msg/Mavlink")[1] == MD5


HEARER = """
import base64, rospy
rospy.init_node("hearer")
for _ in range(20):
    one = rospy.wait_for_message("/drone2/mavlink_source", rospy.AnyMsg)
    print(one._connection_header["md5sum"], base64.b64encode(one._buff).decode(), flush=True)
"""


@pytest.mark.slow
def test_real_programs_hear_a_run_and_steer_it(fmus: Path, master: int, tmp_path: Path) -> None:
    """rostopic prints poses of the recording, rospy packets of the log; a pose reaches the drone as a packet."""
    out, uri = tmp_path / "run", f"http://127.0.0.1:{master}"
    program = [str(Path(sys.executable).with_name("uav-cosim")), "run", str(LINE5), "--until", "1000", "-o", str(out)]
    topic = ["rostopic", "pub", "-r", "5", "/drone2/setpoint_position/local", "geometry_msgs/PoseStamped"]
    commands = [
        ["rostopic", "echo", "-p", "-n", "20", "/drone2/pose"],
        ["rostopic", "echo", "-n", "1", "/tf"],
        [PYTHON, "-s", "-c", HEARER],
        [*topic, TARGET],
    ]
    with ExitStack() as running, (tmp_path / "errors").open("w") as errors:
        others = [running.enter_context(started(command, master)) for command in commands]
        run = running.enter_context(subprocess.Popen([*program, "--ros1", uri], stderr=errors))
        running.callback(stop, [run, *others])
        wait_for(tmp_path / "errors", b"publishes 22 topics, hears 15")
        printed = [one.communicate(timeout=300)[0] for one in others[:3]]
        wait_for(out / "packets.tlog", b"\xff\xbf\x54\x00\x00")  # system 255, component 191, message 84
        run.send_signal(signal.SIGINT)
        assert run.wait(300) == 130
    check_poses(printed[0], out)
    assert printed[1].count("child_frame_id") == 5 and 'frame_id: "map"' in printed[1]
    check_packets(printed[2], out)
    check_setpoints(out)


def started(command: Sequence[str], port: int) -> subprocess.Popen[str]:
    return subprocess.Popen([*command], env=environment(port), stdout=subprocess.PIPE, text=True)


def stop(processes: Sequence[subprocess.Popen[Any]]) -> None:
    for one in processes:
        one.kill()
        one.communicate()


def wait_for(file: Path, bytes: bytes) -> None:
    for _ in range(3000):
        if file.is_file() and bytes in file.read_bytes():
            return
        time.sleep(0.1)
    raise AssertionError(f"{file} does not have it")


def check_poses(printed: str, out: Path) -> None:
    """rostopic prints a float with all its digits."""
    table = signals(out, ["time", *(f"drone2.vehicle.position[{i}]" for i in (1, 2, 3))])
    north, east, down = (table[1 + i].to_pylist() for i in range(3))
    at = {round(t * 1e9): i for i, t in enumerate(table["time"].to_pylist())}
    head, *rows = printed.splitlines()
    names = head.split(",")
    compared = 0
    for row in rows:
        found = dict(zip(names, row.split(","), strict=True))
        k = at.get(int(found["field.header.stamp"]) - START * 10**9)
        if k is not None:  # the recording has a row each 12.5 ms, the run reports its progress in between, too
            place = [float(found[f"field.pose.position.{axis}"]) for axis in "xyz"]
            assert place == [east[k], north[k], -down[k]]
            compared += 1
    assert len(rows) == 20 and compared


def check_packets(printed: str, out: Path) -> None:
    log = {one.data for one in packets_of((out / "packets.tlog").read_bytes()) if one.address[0] == 2}
    lines = printed.splitlines()
    for line in lines:
        md5, _, data = line.partition(" ")
        message = _store().deserialize_ros1(base64.b64decode(data), "mavros_msgs/msg/Mavlink")
        assert md5 == MD5 and packet_of(message) in log and message.header.frame_id == "drone2"
    assert len(lines) == 20


def check_setpoints(out: Path) -> None:
    found = [one for one in packets_of((out / "packets.tlog").read_bytes()) if one.address == (255, 191)]
    for one in found:
        assert one.message == 84
        values = struct.unpack("<I11fHBBB", one.payload.ljust(53, b"\0"))
        assert values[1:4] == (60.0, 7.0, -15.0) and values[13:] == (2, 1, 1)


def test_without_a_master_or_rospy(
    fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    command = ["run", str(LINE5), "--until", "0.1", "-q", "--ros1", "http://127.0.0.1:9", "-o", str(tmp_path / "a")]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1
    assert "--ros1 http://127.0.0.1:9: no master of ROS 1 answers at this address" in " ".join(done.stderr.split())
    monkeypatch.setenv("UAV_COSIM_ROS1_PYTHON", "/bin/false")
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1 and "/bin/false cannot run ROS 1; install python3-rospy" in " ".join(done.stderr.split())
    monkeypatch.setenv("UAV_COSIM_ROS1_PYTHON", sys.executable)
    capfd.readouterr()
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1 and f"{sys.executable} cannot run ROS 1; install" in " ".join(done.stderr.split())
    assert capfd.readouterr().err == "", "a traceback of the program"
    monkeypatch.setenv("UAV_COSIM_ROS1_PYTHON", "/nowhere/python3")
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1 and "/nowhere/python3 does not exist" in " ".join(done.stderr.split())


def test_the_program_ends_with_the_run(master: int) -> None:
    ros = Ros1(f"http://127.0.0.1:{master}")
    ros.open({"clock": "rosgraph_msgs/msg/Clock"}, {})
    process = ros._process
    assert process is not None and process.poll() is None and ros.read() == []
    ros.close()
    assert process.returncode == 0
    ros.close()

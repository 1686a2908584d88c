"""Programs of ROS 1: Debian's packages, or those that UAV_COSIM_ROS1_PYTHON and PATH name."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PYTHON = os.environ.get("UAV_COSIM_ROS1_PYTHON", "/usr/bin/python3")


def lacking() -> str:
    """The reason why the programs cannot run; empty if they can."""
    if missing := [name for name in ("roscore", "rostopic", "rosbag") if shutil.which(name) is None]:
        return f"{', '.join(missing)}: not installed (Debian 12: ros-core, python3-rostopic, python3-rosbag)"
    if shutil.which(PYTHON) is None:
        return f"there is no {PYTHON}"
    code = "import rospy, geometry_msgs.msg, nav_msgs.msg, sensor_msgs.msg, tf2_msgs.msg, rosbag"
    done = subprocess.run([PYTHON, "-s", "-c", code], env=environment(0), capture_output=True, text=True, check=False)
    return done.stderr.strip().rpartition("\n")[2]


def environment(port: int) -> dict[str, str]:
    """Variables for programs of ROS, which are not those of this project's Python."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    path = ":".join(one for one in kept["PATH"].split(":") if "venv" not in one)
    return {**kept, "PATH": path, "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}


@contextmanager
def roscore(home: Path) -> Iterator[int]:
    """Runs a master, and yields its port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    variables = {**environment(port), "ROS_HOME": str(home)}
    process = subprocess.Popen(
        ["roscore", "-p", str(port)], env=variables, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(600):
            if subprocess.run(["rostopic", "list"], env=variables, capture_output=True, check=False).returncode == 0:
                break
            assert process.poll() is None
            time.sleep(0.2)
        yield port
    finally:
        process.terminate()
        process.wait(60)

"""Topics of ROS 1, by a program that ROS's own Python runs (`ros1_bridge.py`), since `rospy` belongs to that Python.

Messages are serialized here, by rosbags, and pass the program's standard input and output. Pipes never make the run
wait: messages that do not fit are lost.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import struct
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.contents.bag import ros1_store
from cosim_master.view.programs.ros.mavlink import KIND

__all__ = ["MAVLINK_MESSAGE", "Ros1"]

MAVLINK_MESSAGE = """uint8 FRAMING_OK = 1
uint8 FRAMING_BAD_CRC = 2
uint8 FRAMING_BAD_SIGNATURE = 3
uint8 MAVLINK_V10 = 254
uint8 MAVLINK_V20 = 253
std_msgs/Header header
uint8 framing_status
uint8 magic
uint8 len
uint8 incompat_flags
uint8 compat_flags
uint8 seq
uint8 sysid
uint8 compid
uint32 msgid
uint16 checksum
uint64[] payload64
uint8[] signature
"""
"""The definition of mavros_msgs/Mavlink, which rosbags does not have; its MD5 sum in ROS 1 is 41093e1f..."""
_PYTHON = "UAV_COSIM_ROS1_PYTHON"
_SYSTEM_PYTHON = "/usr/bin/python3"
_PROGRAM = Path(__file__).with_name("ros1_bridge.py")
_WAITING = 1 << 23
"""Bytes that may wait for the program."""
_START, _END = 60.0, 10.0
"""Wall-clock times in which the program starts and ends, s."""
_FRAME = struct.Struct("<II")
_SAID = 0xFFFFFFFF


class Ros1:
    """The topics of a master.

    Args:
        master: its address (ROS_MASTER_URI).

    Attributes:
        types: classes of messages, by names of ROS 2.
    """

    def __init__(self, master: str) -> None:
        self._master, self._store = master, _store()
        self.types: Mapping[str, Any] = self._store.types
        self._process: subprocess.Popen[bytes] | None = None
        self._published: dict[str, tuple[int, str]] = {}
        self._heard: list[tuple[str, str]] = []
        self._out, self._in = bytearray(), bytearray()
        self._early: list[tuple[int, bytes]] = []

    def open(self, published: Mapping[str, str], heard: Mapping[str, str]) -> None:
        """Starts the program and waits until it has registered all topics.

        Raises:
            CosimError: there is no Python with rospy, or the master cannot be reached.
        """
        python = os.environ.get(_PYTHON, _SYSTEM_PYTHON)
        if shutil.which(python) is None:
            raise CosimError(f"--ros1: {python} does not exist; {_PYTHON} names the Python that has rospy")
        environment = {"ROS_IP": "127.0.0.1", **os.environ, "ROS_MASTER_URI": self._master}
        environment.pop("PYTHONPATH", None)
        self._process = subprocess.Popen(
            [python, "-s", str(_PROGRAM)], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._published = {name: (i, kind) for i, (name, kind) in enumerate(published.items())}
        self._heard = list(heard.items())
        told = [[self._described(kinds) for kinds in of.items()] for of in (published, heard)]
        assert self._process.stdin is not None and self._process.stdout is not None
        for pipe in (self._process.stdin, self._process.stdout):
            os.set_blocking(pipe.fileno(), False)
        text = json.dumps(told).encode()
        self._out += _FRAME.pack(_SAID, len(text)) + text
        self._wait_until_ready(python)

    def _described(self, topic: tuple[str, str]) -> list[str]:
        name, kind = topic
        text, _ = self._store.generate_msgdef(kind, ros_version=1)
        return [f"/{name}", kind.replace("/msg/", "/"), text]

    def _wait_until_ready(self, python: str) -> None:
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        while True:
            self._flush()
            writers = [process.stdin] if self._out else []
            ready = select.select([process.stdout], writers, [], _START)
            frames = self._frames()
            self._early += [one for one in frames if one[0] != _SAID]
            if said := [data.decode() for number, data in frames if number == _SAID]:
                if said[0]:
                    raise CosimError(f"--ros1 {self._master}: {said[0]}")
                return
            if process.poll() is not None or not any(ready[:2]):
                raise CosimError(
                    f"--ros1: {python} cannot run ROS 1; install python3-rospy (Debian 12 has it), or let {_PYTHON} "
                    "name the Python that has it"
                )

    def write(self, topic: str, message: Any) -> None:
        """Publishes a message; it is lost if the program does not keep up."""
        number, kind = self._published[topic]
        if len(self._out) < _WAITING:
            data = self._store.serialize_ros1(message, kind)
            self._out += _FRAME.pack(number, len(data)) + bytes(data)
        self._flush()

    def read(self) -> list[tuple[str, Any]]:
        """Returns the messages received since the last call, with their topics."""
        early, self._early = self._early, []
        found = []
        for number, data in [*early, *self._frames()]:
            name, kind = self._heard[number]
            found.append((name, self._store.deserialize_ros1(data, kind)))
        return found

    def close(self) -> None:
        """Ends the program."""
        process, self._process = self._process, None
        if process is None:
            return
        with process:
            assert process.stdin is not None
            try:
                process.stdin.close()  # of which the program ends
                process.wait(_END)
            except (OSError, subprocess.TimeoutExpired):
                process.kill()

    def _flush(self) -> None:
        process = self._process
        if process is None or process.stdin is None or not self._out:
            return
        try:
            sent = os.write(process.stdin.fileno(), self._out[:_PIPE])
        except BlockingIOError:
            return
        except BrokenPipeError:
            sent = len(self._out)
        del self._out[:sent]

    def _frames(self) -> list[tuple[int, bytes]]:
        """Returns the complete frames that the program has written: their numbers and contents."""
        process = self._process
        if process is None or process.stdout is None:
            return []
        try:
            while data := os.read(process.stdout.fileno(), _PIPE):
                self._in += data
        except BlockingIOError:
            pass
        found = []
        while len(self._in) >= _FRAME.size:
            number, length = _FRAME.unpack_from(self._in)
            end = _FRAME.size + length
            if len(self._in) < end:
                break
            found.append((number, bytes(self._in[_FRAME.size : end])))
            del self._in[:end]
        return found


_PIPE = 1 << 16


@cache
def _store() -> Any:
    from rosbags.typesys import get_types_from_msg

    store = ros1_store()
    store.register(get_types_from_msg(MAVLINK_MESSAGE, KIND))
    return store

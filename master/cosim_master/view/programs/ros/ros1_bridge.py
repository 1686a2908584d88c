"""Passes serialized messages between pipes and ROS 1. ROS's own Python runs this program; it imports no other module
of this project.

Frames of standard input and output: number and length (uint32, little-endian), contents. The first frame (number
2^32 - 1) is JSON: the topics to publish and the topics to hear, each a list of name, type and definition. It is
answered by a frame with the same number and an error message, which is empty if all topics are registered. Then the
number is that of a topic. The program ends with its input.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import threading
from typing import Any, BinaryIO

FRAME = struct.Struct("<II")
SAID = 0xFFFFFFFF


def main() -> None:
    source, sink = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # ROS prints
    lock = threading.Lock()

    def send(number: int, data: bytes) -> None:
        with lock:
            sink.write(FRAME.pack(number, len(data)) + data)
            sink.flush()

    first = read(source)
    if first is None:
        return
    published, heard = json.loads(first[1])
    try:
        import rosgraph  # type: ignore[import-not-found]
        import rospy  # type: ignore[import-not-found]
    except ImportError:  # the command says what to install
        sys.exit(1)

    if not rosgraph.is_master_online():
        send(SAID, b"no master of ROS 1 answers at this address; roscore starts one")
        return
    rospy.init_node("uav_cosim", anonymous=True, disable_signals=True)
    kinds: dict[str, Any] = {}
    publishers = []
    for topic, name, definition in published:
        kind = kinds.setdefault(name, raw(name, definition))
        publishers.append((kind, rospy.Publisher(topic, kind, queue_size=100)))
    for number, (topic, name, definition) in enumerate(heard):
        kind = kinds.setdefault(name, raw(name, definition))
        rospy.Subscriber(topic, kind, lambda message, number=number: send(number, message.data))
    send(SAID, b"")
    while True:
        frame = read(source)
        if frame is None:
            break
        kind, publisher = publishers[frame[0]]
        message = kind()
        message.data = frame[1]
        publisher.publish(message)
    rospy.signal_shutdown("the run has ended")


def raw(name: str, definition: str) -> Any:
    """Returns a class of messages that keep their bytes."""
    from genpy.dynamic import generate_dynamic  # type: ignore[import-not-found]

    kind: Any = generate_dynamic(name, definition)[name]

    class Raw(kind):  # type: ignore[misc]
        __slots__ = ["data"]
        _has_header = False  # rospy would number it

        def serialize(self, buff: BinaryIO) -> None:
            buff.write(self.data)

        def deserialize(self, data: bytes) -> Any:
            self.data = bytes(data)
            return self

    return Raw


def read(source: BinaryIO) -> tuple[int, bytes] | None:
    """Returns number and contents of the next frame; None at the end."""
    head = source.read(FRAME.size)
    if len(head) < FRAME.size:
        return None
    number, length = FRAME.unpack(head)
    data = source.read(length)
    return (number, data) if len(data) == length else None


if __name__ == "__main__":
    main()

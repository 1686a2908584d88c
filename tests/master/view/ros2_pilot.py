"""A DDS program that flies drone 2: python ros2_pilot.py DOMAIN. Its types are those of `ros2_listener`.

It arms the drone and lets it take off by packets on /drone2/mavlink_sink, sends it to a place by a pose, and then lets
it fly to the west by a velocity. It prints "ready" when it listens, and at the end the place [m, ENU] at which the
drone arrived, its heading there [rad, from east to the left], and its way by the velocity [m].
"""

import math
import struct
import sys
import time
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from ros2_listener import HEADER, LOOPBACK, MAVLINK, POSE, POSED, QUATERNION, TIME, TWIST, TWISTED, VECTOR

POINT = POSE.__annotations__["position"]
PLACE = (42.0, -20.0, 14.0)


def packet(message: Any) -> Any:
    """The message of ROS for a MAVLink message, as mavros_msgs/mavlink_convert.h makes it."""
    data = message.pack(mavlink.MAVLink(None, 255, 190))
    magic, length, incompat, compat, seq, system, component = data[:7]
    payload = data[10 : 10 + length]
    words = struct.unpack(f"<{-(-length // 8)}Q", payload + bytes(-length % 8))
    number, checksum = int.from_bytes(data[7:10], "little"), int.from_bytes(data[-2:], "little")
    header = HEADER(stamp=TIME(0, 0), frame_id="")
    ids = (incompat, compat, seq, system, component, number)
    return MAVLINK(header, 1, magic, length, *ids, checksum, list(words), [])


def command(number: int, *values: float) -> Any:
    parameters = (*values, *[0.0] * (7 - len(values)))
    return packet(mavlink.MAVLink_command_long_message(2, 1, number, 0, *parameters))


class Pilot:
    def __init__(self, number: int) -> None:
        self.domain = Domain(number, LOOPBACK)
        participant = DomainParticipant(number)
        qos = Qos(Policy.Reliability.Reliable(10**9), Policy.History.KeepLast(10))

        def topic(name: str, kind: Any) -> Any:
            return Topic(participant, f"rt/drone2/{name}", kind, qos=qos)

        self.poses = DataReader(participant, topic("pose", POSED), qos=qos)
        self.packets = DataReader(participant, topic("mavlink_source", MAVLINK), qos=qos)
        self.sink = DataWriter(participant, topic("mavlink_sink", MAVLINK), qos=qos)
        self.place = DataWriter(participant, topic("setpoint_position/local", POSED), qos=qos)
        self.speed = DataWriter(participant, topic("setpoint_velocity/cmd_vel", TWISTED), qos=qos)
        self.at = (math.nan, math.nan, math.nan)
        self.now, self.heading, self.mode, self.armed = 0.0, 0.0, -1, False
        self.first = math.inf
        self.away = math.inf

    def look(self) -> None:
        time.sleep(0.02)
        for message in self.poses.take(100):
            p, q = message.pose.position, message.pose.orientation
            self.at, self.heading = (p.x, p.y, p.z), 2.0 * math.atan2(q.z, q.w)
            self.now = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            self.first = min(self.first, self.now)
        for message in self.packets.take(100):
            if message.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                payload = b"".join(word.to_bytes(8, "little") for word in message.payload64)
                self.mode, self.armed = int.from_bytes(payload[:4], "little"), bool(payload[6] & 128)

    def until(self, done: Any, act: Any) -> None:
        """Looks until `done`, and acts every half second of the run's time from its first step on."""
        acted = -1.0
        while not done():
            self.look()
            if self.now > self.first and not 0.0 <= self.now - acted < 0.5:
                acted = self.now
                act()

    def rests(self, place: tuple[float, float, float]) -> bool:
        """Returns whether the drone has been within 0.1 m of a place for two seconds."""
        if not math.dist(self.at, place) < 0.1:
            self.away = self.now
        return self.now > self.away + 2.0

    def send_to(self, place: tuple[float, float, float]) -> None:
        orientation = QUATERNION(0.0, 0.0, math.sin(0.25), math.cos(0.25))
        self.place.write(POSED(HEADER(TIME(0, 0), "map"), POSE(POINT(*place), orientation)))

    def fly(self) -> None:
        still = VECTOR(0.0, 0.0, 0.0)
        self.until(lambda: self.mode == 4, lambda: self.sink.write(command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)))
        arm = command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self.until(lambda: self.armed, lambda: self.sink.write(arm))
        rise = command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
        self.until(lambda: self.at[2] > 1.0, lambda: self.sink.write(rise))
        self.until(lambda: self.at[2] > 9.5, lambda: None)
        self.until(lambda: self.rests(PLACE), lambda: self.send_to(PLACE))
        began, arrived, heading = self.now, self.at, self.heading
        west = TWISTED(HEADER(TIME(0, 0), "map"), TWIST(VECTOR(-2.0, 0.0, 0.0), still))
        self.until(lambda: self.now > began + 6.0, lambda: self.speed.write(west))
        print(*arrived, heading, *(after - before for before, after in zip(arrived, self.at, strict=True)), flush=True)


if __name__ == "__main__":
    pilot = Pilot(int(sys.argv[1]))
    print("ready", flush=True)
    pilot.fly()

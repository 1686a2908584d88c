"""Poses, velocities and MAVLink packets from ROS, which enter the network as those of a ground station.

/NAME/setpoint_position/local     geometry_msgs/PoseStamped     place and heading, in the frame "map" (ENU)
/NAME/setpoint_velocity/cmd_vel   geometry_msgs/TwistStamped    velocity over ground, ENU, and turning rate
/NAME/mavlink_sink                mavros_msgs/Mavlink           any packet, as it is

Names and meaning are those of MAVROS. Poses and velocities become SET_POSITION_TARGET_LOCAL_NED, which the autopilot
obeys in GUIDED mode. They pass the mailbox of a gateway, so that the recording contains them.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from cosim import messages
from cosim_master.view.live.ground_station import GroundStation, near
from cosim_master.view.programs.ros.mavlink import KIND, packet_of

__all__ = ["Setpoints"]

_POSE, _TWIST = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped"
_LOCAL_NED = 1
_NO_VELOCITY, _NO_POSITION, _NO_ACCELERATION = 0b111 << 3, 0b111, 0b111 << 6
_NO_YAW, _NO_YAW_RATE = 1 << 10, 1 << 11
_FRAMES = ("map", "")


class Setpoints:
    """Takes messages from ROS.

    Args:
        drones: names of the drones in topics, and in the page.
        station: sends the packets.
        tell: called with the reason why a message was not used, once for each topic and reason.

    Attributes:
        kinds: the topics that are heard, without "/" at the beginning, and their types.
    """

    def __init__(self, drones: Mapping[str, str], station: GroundStation, tell: Callable[[str], None]) -> None:
        self._station, self._tell = station, tell
        self._told: set[tuple[str, str]] = set()
        self.kinds: dict[str, str] = {}
        self._use: dict[str, Callable[[Any], None]] = {}
        for topic, drone in drones.items():
            self._hear(f"{topic}/setpoint_position/local", _POSE, partial(self._pose, drone))
            self._hear(f"{topic}/setpoint_velocity/cmd_vel", _TWIST, partial(self._twist, drone))
            self._hear(f"{topic}/mavlink_sink", KIND, lambda m: station.post(packet_of(m)))

    def _hear(self, topic: str, kind: str, use: Callable[[Any], None]) -> None:
        self.kinds[topic], self._use[topic] = kind, use

    def take(self, topic: str, message: Any) -> None:
        """Sends the packet of a message, or says why this is not possible."""
        try:
            self._use[topic](message)
        except ValueError as error:
            if (topic, str(error)) not in self._told:
                self._told.add((topic, str(error)))
                self._tell(f"/{topic}: nothing is sent: {error}")

    def _pose(self, drone: str, message: Any) -> None:
        p, q = message.pose.position, message.pose.orientation
        mask, yaw = _NO_VELOCITY | _NO_ACCELERATION | _NO_YAW_RATE | _NO_YAW, 0.0
        if abs(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1.0) < 1e-3:
            to_left = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
            mask, yaw = mask & ~_NO_YAW, math.remainder(math.pi / 2 - to_left, 2.0 * math.pi)
        self._send(drone, message, mask, (p.y, p.x, -p.z), (0.0, 0.0, 0.0), yaw, 0.0)

    def _twist(self, drone: str, message: Any) -> None:
        v, rate = message.twist.linear, -message.twist.angular.z
        mask = _NO_POSITION | _NO_ACCELERATION | _NO_YAW
        self._send(drone, message, mask, (0.0, 0.0, 0.0), (v.y, v.x, -v.z), 0.0, rate)

    def _send(
        self,
        drone: str,
        message: Any,
        mask: int,
        position: tuple[float, float, float],
        velocity: tuple[float, float, float],
        yaw: float,
        yaw_rate: float,
    ) -> None:
        if message.header.frame_id not in _FRAMES:
            raise ValueError(f'its frame is "{message.header.frame_id}"; give values in "map"')
        if not near((*position, *velocity, yaw, yaw_rate)):
            raise ValueError("its values must be finite, and less than 1,000 km or 1,000 km/s")

        def payload(system: int) -> bytes:
            return struct.pack(
                "<I11fHBBB", 0, *position, *velocity, 0.0, 0.0, 0.0, yaw, yaw_rate, mask,
                system, messages.MAV_COMP_ID_AUTOPILOT1, _LOCAL_NED,
            )  # fmt: skip

        self._station.send(drone, messages.SET_POSITION_TARGET_LOCAL_NED, payload)

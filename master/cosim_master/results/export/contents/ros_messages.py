"""The messages of ROS about vehicles, in a bag (`rosbag`) and while a run goes on (`view.programs`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cosim_master.results.export.contents.tracks import Array, Track, Tracks, enu, frd_to_flu, geodetic, orientation

__all__ = ["Messages", "Vehicle", "ros_vehicle"]

_MAP = "map"
_PATH = 1000
_LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]])


@dataclass(slots=True)
class Vehicle:
    """A vehicle in the frames of ROS; x, y, z, w of its orientation."""

    name: str
    position: Array
    rotation: Array
    linear: Array | None
    angular: Array | None
    fixes: Array | None


class Messages:
    """Creates messages.

    Args:
        types: the classes of messages, by name of ROS ("geometry_msgs/msg/Pose").
    """

    def __init__(self, types: Mapping[str, Any]) -> None:
        self._of = types
        header = types["std_msgs/msg/Header"]
        numbered = "seq" in header.__dataclass_fields__  # ROS 1
        self._header = partial(header, seq=0) if numbered else header

    def time(self, stamp: int) -> Any:
        return self._of["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)

    def header(self, stamp: int, frame: str) -> Any:
        return self._header(stamp=self.time(stamp), frame_id=frame)

    def pose(self, vehicle: Vehicle, k: int) -> Any:
        return self._of["geometry_msgs/msg/Pose"](
            position=self._named("geometry_msgs/msg/Point", "xyz", vehicle.position[k]),
            orientation=self._named("geometry_msgs/msg/Quaternion", "xyzw", vehicle.rotation[k]),
        )

    def pose_stamped(self, vehicle: Vehicle, k: int, stamp: int) -> Any:
        return self._of["geometry_msgs/msg/PoseStamped"](header=self.header(stamp, _MAP), pose=self.pose(vehicle, k))

    def odometry(self, vehicle: Vehicle, k: int, stamp: int) -> Any:
        assert vehicle.linear is not None and vehicle.angular is not None
        of, exact = self._of, np.zeros(36)
        twist = of["geometry_msgs/msg/Twist"](
            linear=self._named("geometry_msgs/msg/Vector3", "xyz", vehicle.linear[k]),
            angular=self._named("geometry_msgs/msg/Vector3", "xyz", vehicle.angular[k]),
        )
        return of["nav_msgs/msg/Odometry"](
            header=self.header(stamp, _MAP),
            child_frame_id=vehicle.name,
            pose=of["geometry_msgs/msg/PoseWithCovariance"](pose=self.pose(vehicle, k), covariance=exact),
            twist=of["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=exact),
        )

    def fix(self, vehicle: Vehicle, k: int, stamp: int) -> Any:
        assert vehicle.fixes is not None
        status = self._of["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        latitude, longitude, altitude = vehicle.fixes[k].tolist()
        return self._of["sensor_msgs/msg/NavSatFix"](
            header=self.header(stamp, vehicle.name),
            status=status,
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=0,  # COVARIANCE_TYPE_UNKNOWN
        )

    def path(self, vehicle: Vehicle, stamps: list[int]) -> Any:
        rows = np.unique(np.linspace(0, len(stamps) - 1, min(len(stamps), _PATH)).round().astype(int))
        poses = [self.pose_stamped(vehicle, int(k), stamps[k]) for k in rows]
        return self._of["nav_msgs/msg/Path"](header=self.header(stamps[0], _MAP), poses=poses)

    def transforms(self, vehicles: Sequence[Vehicle], k: int, stamp: int) -> Any:
        of, header = self._of, self.header(stamp, _MAP)
        return of["tf2_msgs/msg/TFMessage"](
            transforms=[
                of["geometry_msgs/msg/TransformStamped"](
                    header=header,
                    child_frame_id=one.name,
                    transform=of["geometry_msgs/msg/Transform"](
                        translation=self._named("geometry_msgs/msg/Vector3", "xyz", one.position[k]),
                        rotation=self._named("geometry_msgs/msg/Quaternion", "xyzw", one.rotation[k]),
                    ),
                )
                for one in vehicles
            ]
        )

    def _named(self, kind: str, names: str, values: Array) -> Any:
        return self._of[kind](**dict(zip(names, values.tolist(), strict=True)))


def ros_vehicle(track: Track, name: str, tracks: Tracks) -> Vehicle:
    """Returns a vehicle of `tracks` with its name in topics."""
    known = np.repeat(_LEVEL, len(tracks.time), axis=0) if track.attitude is None else track.attitude
    rotation = orientation(known)
    moving = track.velocity is not None and track.attitude is not None
    return Vehicle(
        name,
        enu(track.position),
        rotation,
        _in_body(rotation, enu(track.velocity)) if moving and track.velocity is not None else None,
        None if track.body_rates is None else frd_to_flu(track.body_rates),
        None if tracks.origin is None else geodetic(track.position, tracks.origin),
    )


def _in_body(rotation: Array, vectors: Array) -> Array:
    """Returns vectors in the body's frame, by the quaternions x, y, z, w that rotate this frame into theirs."""
    axis, w = -rotation[:, :3], rotation[:, 3:]
    twice = 2.0 * np.cross(axis, vectors)
    turned: Array = vectors + w * twice + np.cross(axis, twice)
    return turned

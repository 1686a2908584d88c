"""Exports the motion of all vehicles as a ROS 2 bag (MCAP storage), in the frames of REP 103 and REP 105.

/NAME/pose   geometry_msgs/PoseStamped    in the frame "map": ENU from the local origin
/NAME/odom   nav_msgs/Odometry            with the velocities in the frame NAME (FLU)
/NAME/fix    sensor_msgs/NavSatFix        if the local origin is known
/NAME/path   nav_msgs/Path                once, at the start: the whole path, at most 1000 poses
/tf          tf2_msgs/TFMessage           all vehicles at each instant
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.results.export.options import Options
from cosim_master.results.export.tracks import (
    Array,
    Track,
    Tracks,
    enu,
    frd_to_flu,
    geodetic,
    names_for_topics,
    orientation,
    read_tracks,
)

__all__ = ["export"]

_MAP = "map"
_PATH = 1000
_LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]])


@dataclass(slots=True)
class _Vehicle:
    """A vehicle in the frames of ROS; x, y, z, w of its orientation."""

    name: str
    position: Array
    rotation: Array
    linear: Array | None
    angular: Array | None
    fixes: Array | None


class _Messages:
    """Creates messages of the type store."""

    def __init__(self, types: Any) -> None:
        self._of = types

    def header(self, stamp: int, frame: str) -> Any:
        time = self._of["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self._of["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    def pose(self, vehicle: _Vehicle, k: int) -> Any:
        return self._of["geometry_msgs/msg/Pose"](
            position=self._named("geometry_msgs/msg/Point", "xyz", vehicle.position[k]),
            orientation=self._named("geometry_msgs/msg/Quaternion", "xyzw", vehicle.rotation[k]),
        )

    def pose_stamped(self, vehicle: _Vehicle, k: int, stamp: int) -> Any:
        return self._of["geometry_msgs/msg/PoseStamped"](header=self.header(stamp, _MAP), pose=self.pose(vehicle, k))

    def odometry(self, vehicle: _Vehicle, k: int, stamp: int) -> Any:
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

    def fix(self, vehicle: _Vehicle, k: int, stamp: int) -> Any:
        assert vehicle.fixes is not None
        kind = self._of["sensor_msgs/msg/NavSatFix"]
        status = self._of["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        latitude, longitude, altitude = vehicle.fixes[k].tolist()
        return kind(
            header=self.header(stamp, vehicle.name),
            status=status,
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=kind.COVARIANCE_TYPE_UNKNOWN,
        )

    def path(self, vehicle: _Vehicle, stamps: list[int]) -> Any:
        rows = np.unique(np.linspace(0, len(stamps) - 1, min(len(stamps), _PATH)).round().astype(int))
        poses = [self.pose_stamped(vehicle, int(k), stamps[k]) for k in rows]
        return self._of["nav_msgs/msg/Path"](header=self.header(stamps[0], _MAP), poses=poses)

    def transforms(self, vehicles: list[_Vehicle], k: int, stamp: int) -> Any:
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


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the bag, a folder; returns notes."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    tracks = read_tracks(run, options)
    vehicles = [
        _vehicle(one, name, tracks)
        for one, name in zip(tracks.vehicles, names_for_topics(tracks.vehicles), strict=True)
    ]
    store = get_typestore(Stores.ROS2_JAZZY)
    make, stamps = _Messages(store.types), tracks.stamps
    if file.is_dir():
        file.rmdir()  # empty; the writer creates it
    with Writer(file, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as bag:

        def channel(topic: str, kind: str, message: Callable[[int], Any]) -> tuple[Any, str, Callable[[int], Any]]:
            return bag.add_connection(topic, kind, typestore=store), kind, message

        channels = [channel("/tf", "tf2_msgs/msg/TFMessage", lambda k: make.transforms(vehicles, k, stamps[k]))]
        for one in vehicles:
            connection = bag.add_connection(f"/{one.name}/path", "nav_msgs/msg/Path", typestore=store)
            bag.write(connection, stamps[0], store.serialize_cdr(make.path(one, stamps), "nav_msgs/msg/Path"))
            pose = lambda k, one=one: make.pose_stamped(one, k, stamps[k])  # noqa: E731
            channels.append(channel(f"/{one.name}/pose", "geometry_msgs/msg/PoseStamped", pose))
            if one.linear is not None and one.angular is not None:
                odometry = lambda k, one=one: make.odometry(one, k, stamps[k])  # noqa: E731
                channels.append(channel(f"/{one.name}/odom", "nav_msgs/msg/Odometry", odometry))
            if one.fixes is not None:
                fix = lambda k, one=one: make.fix(one, k, stamps[k])  # noqa: E731
                channels.append(channel(f"/{one.name}/fix", "sensor_msgs/msg/NavSatFix", fix))
        for k, stamp in enumerate(stamps):
            for connection, kind, message in channels:
                bag.write(connection, stamp, store.serialize_cdr(message(k), kind))
    return _notes(tracks)


def _vehicle(track: Track, name: str, tracks: Tracks) -> _Vehicle:
    known = np.repeat(_LEVEL, len(tracks.time), axis=0) if track.attitude is None else track.attitude
    rotation = orientation(known)
    moving = track.velocity is not None and track.attitude is not None
    return _Vehicle(
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


def _notes(tracks: Tracks) -> list[str]:
    notes = []
    if tracks.origin is None:
        notes.append("no NavSatFix: no FMU declares the local origin; --origin LATITUDE,LONGITUDE,ALTITUDE gives one")
    if level := [one.name for one in tracks.vehicles if one.attitude is None]:
        notes.append(f"no attitude was recorded, so orientations are level, nose north: {', '.join(level[:3])}")
    if still := [one.name for one in tracks.vehicles if one.velocity is None or one.body_rates is None]:
        notes.append(f"no odometry, velocities were not recorded: {', '.join(still[:3])}{', ...' * (len(still) > 3)}")
    return notes

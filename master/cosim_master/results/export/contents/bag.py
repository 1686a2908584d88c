"""The contents of bags of ROS 1 and ROS 2: the motion of all vehicles, in the frames of REP 103 and REP 105.

/NAME/pose   geometry_msgs/PoseStamped    in the frame "map": ENU from the local origin
/NAME/odom   nav_msgs/Odometry            with the velocities in the frame NAME (FLU)
/NAME/fix    sensor_msgs/NavSatFix        if the local origin is known
/NAME/path   nav_msgs/Path                once, at the start: the whole path, at most 1000 poses
/tf          tf2_msgs/TFMessage           all vehicles at each instant
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cosim_master.results.export.contents.ros_messages import Messages, ros_vehicle
from cosim_master.results.export.contents.tracks import Tracks, names_for_topics

__all__ = ["bag_notes", "fill_bag", "ros1_store"]

_TF = "geometry_msgs/TransformStamped[] transforms\n"
"""The definition of tf2_msgs/TFMessage, which rosbags does not have for ROS 1."""


def ros1_store() -> Any:
    """Returns rosbags' types of ROS 1, with that of /tf."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_TF, "tf2_msgs/msg/TFMessage"))
    return store


def fill_bag(tracks: Tracks, bag: Any, store: Any, serialize: Callable[[Any, str], Any]) -> None:
    """Writes all messages, in the order of time.

    Args:
        tracks: the motion of all vehicles.
        bag: the open writer of rosbags.
        store: the types of messages.
        serialize: returns the bytes of a message of a type.
    """
    names = names_for_topics([one.name for one in tracks.vehicles])
    vehicles = [ros_vehicle(one, name, tracks) for one, name in zip(tracks.vehicles, names, strict=True)]
    make, stamps = Messages(store.types), tracks.stamps

    def channel(topic: str, kind: str, message: Callable[[int], Any]) -> tuple[Any, str, Callable[[int], Any]]:
        return bag.add_connection(topic, kind, typestore=store), kind, message

    channels = [channel("/tf", "tf2_msgs/msg/TFMessage", lambda k: make.transforms(vehicles, k, stamps[k]))]
    for one in vehicles:
        connection = bag.add_connection(f"/{one.name}/path", "nav_msgs/msg/Path", typestore=store)
        bag.write(connection, stamps[0], serialize(make.path(one, stamps), "nav_msgs/msg/Path"))
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
            bag.write(connection, stamp, serialize(message(k), kind))


def bag_notes(tracks: Tracks) -> list[str]:
    """Returns notes on topics that the bag does not have."""
    notes = []
    if tracks.origin is None:
        notes.append("no NavSatFix: no FMU declares the local origin; --origin LATITUDE,LONGITUDE,ALTITUDE gives one")
    if level := [one.name for one in tracks.vehicles if one.attitude is None]:
        notes.append(f"no attitude was recorded, so orientations are level, nose north: {', '.join(level[:3])}")
    if still := [one.name for one in tracks.vehicles if one.velocity is None or one.body_rates is None]:
        notes.append(f"no odometry, velocities were not recorded: {', '.join(still[:3])}{', ...' * (len(still) > 3)}")
    return notes

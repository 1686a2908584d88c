"""Publishes the vehicles of a run to ROS 2 while it goes on, without ROS: `uav-cosim run --ros2`.

/NAME/pose   geometry_msgs/PoseStamped    in the frame "map": ENU from the local origin
/NAME/odom   nav_msgs/Odometry            if velocities are recorded; these are in the frame NAME (FLU)
/NAME/fix    sensor_msgs/NavSatFix        if the local origin is known
/tf          tf2_msgs/TFMessage           all vehicles

Topics of ROS 2 are topics of DDS whose names begin with "rt/"; Cyclone DDS writes them. Values are copied when the run
reports its progress, twenty to fifty times a second of wall-clock time. DDS uses loopback only, without multicast,
unless the variable CYCLONEDDS_URI configures it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cosim.verdict import Role
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.contents.ros_messages import Messages, ros_vehicle
from cosim_master.results.export.contents.tracks import Track, Tracks, declared_origin, names_for_topics
from cosim_master.results.reading.roles import UNKNOWN, parts
from cosim_master.stepping.observation import Column, Progress, Seen, View
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.view.live.document import known_of
from cosim_master.view.programs.ros2_types import TYPES

__all__ = ["Ros2Feed"]

_LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>100</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery>"
    "</Domain></CycloneDDS>"
)
_QOS = Qos(Policy.Reliability.Reliable(duration(milliseconds=10)), Policy.History.KeepLast(10))
"""ROS's usual quality of service; a reader that is slow loses messages, and the run waits 10 ms for it at most."""


class Ros2Feed:
    """A `ProgressObserver` that publishes the newest values.

    Args:
        view: the run.
    """

    every = 0

    def __init__(self, view: View) -> None:
        self._columns = {column.name: column for column in view.columns}
        self._seen: Seen | None = None
        self._publisher: _Publisher | None = None

    def serve(self, checked: CheckedSystem, number: int) -> None:
        """Opens the domain.

        Args:
            checked: the system; its structure must be open.
            number: of the domain (ROS_DOMAIN_ID).

        Raises:
            CosimError: no positions of vehicles are recorded, DDS cannot open the domain, or instances declare
                different local origins.
        """
        motion = _Motion(checked, self._columns)
        try:
            self._publisher = _Publisher(motion, number)
        except DDSException as error:
            raise CosimError(f"--ros2 {number}: DDS cannot open this domain: {error}") from error

    @property
    def topics(self) -> list[str]:
        """The names of the topics in ROS."""
        return [] if self._publisher is None else self._publisher.topics

    def close(self) -> None:
        """Closes the domain, if it is open."""
        self._publisher = None

    def initialised(self, seen: Seen) -> None:
        self._seen = seen  # its arrays are those of the loop: they have the values of each later moment, too
        self._send(seen.time)

    def stepped(self, seen: Seen) -> None: ...

    def progressed(self, progress: Progress) -> None:
        self._send(progress.time)

    def closed(self) -> None:
        self._seen = None

    def _send(self, time: float) -> None:
        if self._publisher is not None and self._seen is not None:
            self._publisher.publish(time, self._seen)


class _Motion:
    """The motion of all vehicles at an instant.

    Args:
        checked: the system.
        columns: the recorded signals.

    Attributes:
        names: of the vehicles, in topics.
        with_odometry: whether attitude and velocities are recorded, by vehicle.
        origin: the local origin; None if it is not known.

    Raises:
        CosimError: no positions of vehicles are recorded.
    """

    def __init__(self, checked: CheckedSystem, columns: Mapping[str, Column]) -> None:
        known = known_of(checked)
        units = {name: "" if one.variable.unit is None else one.variable.unit.name for name, one in columns.items()}
        found = [one for one in parts(units, known) if one.vehicle]
        if not found:
            raise CosimError(
                f"--ros2: {checked.structure.name} records no positions of vehicles, so nothing can be published; "
                "--record '*.position*' adds them"
            )
        self.origin = declared_origin(known, checked.structure.name)
        self.names = names_for_topics([one.name for one in found])
        self._places = []
        for one in found:
            player = known.get(one.vehicle, UNKNOWN)
            named = [
                (player.position, 3), (player.attitude, 4), (player.named(Role.VELOCITY), 3),
                (player.named(Role.ANGULAR_VELOCITY), 3),
            ]  # fmt: skip
            self._places.append([_places(columns, f"{one.vehicle}.{name}", size) for name, size in named])

        self.with_odometry = [None not in places for places in self._places]

    def at(self, time: float, seen: Seen) -> Tracks:
        """Returns the present values, as tracks with one instant."""
        tracks = []
        for name, places in zip(self.names, self._places, strict=True):
            position, *others = [None if of is None else seen.reals[of][np.newaxis].copy() for of in places]
            assert position is not None
            tracks.append(Track(name, "", position, *others))
        return Tracks(np.array([time]), tuple(tracks), self.origin)


def _places(columns: Mapping[str, Column], name: str, size: int) -> list[int] | None:
    wanted = [f"{name}[{i + 1}]" for i in range(size)]
    if not all(one in columns and columns[one].kind == "Real" for one in wanted):
        return None
    return [columns[one].place for one in wanted]


class _Publisher:
    """The writers of all topics.

    Attributes:
        topics: their names in ROS.
    """

    def __init__(self, motion: _Motion, domain: int) -> None:
        self._motion, self._make = motion, Messages(TYPES)
        # without a configuration of one's own, Cyclone DDS reads CYCLONEDDS_URI
        self._domain = None if os.environ.get("CYCLONEDDS_URI") else Domain(domain, _LOOPBACK)
        participant = DomainParticipant(domain)
        kinds = {"tf": "tf2_msgs/msg/TFMessage"}
        for name, has_odometry in zip(motion.names, motion.with_odometry, strict=True):
            kinds[f"{name}/pose"] = "geometry_msgs/msg/PoseStamped"
            if has_odometry:
                kinds[f"{name}/odom"] = "nav_msgs/msg/Odometry"
            if motion.origin is not None:
                kinds[f"{name}/fix"] = "sensor_msgs/msg/NavSatFix"
        self._writers = {
            name: DataWriter(participant, Topic(participant, f"rt/{name}", TYPES[kind], qos=_QOS), qos=_QOS)
            for name, kind in kinds.items()
        }
        self.topics = [f"/{name}" for name in kinds]

    def publish(self, time: float, seen: Seen) -> None:
        """Publishes the present values."""
        tracks = self._motion.at(time, seen)
        (stamp,), make, writers = tracks.stamps, self._make, self._writers
        vehicles = [ros_vehicle(track, track.name, tracks) for track in tracks.vehicles]
        for one in vehicles:
            _write(writers[f"{one.name}/pose"], make.pose_stamped(one, 0, stamp))
            if one.linear is not None and one.angular is not None:
                _write(writers[f"{one.name}/odom"], make.odometry(one, 0, stamp))
            if one.fixes is not None:
                _write(writers[f"{one.name}/fix"], make.fix(one, 0, stamp))
        _write(writers["tf"], make.transforms(vehicles, 0, stamp))


def _write(writer: DataWriter[object], message: object) -> None:
    """Writes a message; it is lost if readers do not keep up."""
    try:
        writer.write(message)
    except DDSException as error:
        if error.code != DDSException.DDS_RETCODE_TIMEOUT:
            raise

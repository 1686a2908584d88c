"""Publishes the vehicles of a run to ROS while it goes on, and takes set-points from there.

/NAME/pose             geometry_msgs/PoseStamped    in the frame "map": ENU from the local origin
/NAME/odom             nav_msgs/Odometry            if velocities are recorded; these are in the frame NAME (FLU)
/NAME/fix              sensor_msgs/NavSatFix        if the local origin is known
/NAME/mavlink_source   mavros_msgs/Mavlink          every packet that the drone sends, if packets are recorded
/tf                    tf2_msgs/TFMessage           all vehicles
/clock                 rosgraph_msgs/Clock          the clock of the run

`setpoints` has the topics that are heard. Values are copied, and messages read, when the run reports its progress,
twenty to fifty times a second of wall-clock time.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from cosim.verdict import Role
from cosim_master.diagnostics.errors import CosimError
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.results.export.contents.ros_messages import Messages, ros_vehicle
from cosim_master.results.export.contents.tracks import Track, Tracks, declared_origin, names_for_topics
from cosim_master.results.reading.roles import UNKNOWN, parts
from cosim_master.results.recording.packet_log import EPOCH
from cosim_master.stepping.observation import Column, Packets, Progress, Seen, View
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network
from cosim_master.view.live.document import known_of, live_traffic
from cosim_master.view.live.ground_station import GroundStation
from cosim_master.view.live.traffic import LiveTraffic
from cosim_master.view.programs.ros.mavlink import KIND, fields_of
from cosim_master.view.programs.ros.setpoints import Setpoints

__all__ = ["RosFeed", "Transport"]

_ONBOARD_COMPUTER = 191
"""Component id of the packets made from set-points."""


class Transport(Protocol):
    """The topics of one version of ROS."""

    types: Mapping[str, Any]
    """Classes of messages, by names of ROS 2 ("geometry_msgs/msg/Pose")."""

    def open(self, published: Mapping[str, str], heard: Mapping[str, str]) -> None:
        """Opens topics; both arguments map names to types. Raises CosimError."""

    def write(self, topic: str, message: Any) -> None:
        """Publishes a message."""

    def read(self) -> list[tuple[str, Any]]:
        """Returns the messages received since the last call, with their topics."""

    def close(self) -> None:
        """Closes all topics."""


class RosFeed:
    """A `ProgressObserver` and `PacketObserver` that publishes the newest values and all packets.

    Args:
        view: the run.
        transport: the topics.
        tell: called with notes on messages that could not be used.

    Attributes:
        topics: names of the topics, published and heard.
    """

    every = 0

    def __init__(self, view: View, transport: Transport, tell: Callable[[str], None] = lambda _: None) -> None:
        self._columns = {column.name: column for column in view.columns}
        self._transport, self._tell = transport, tell
        self._seen: Seen | None = None
        self._publisher: _Publisher | None = None
        self._setpoints: Setpoints | None = None
        self._traffic: LiveTraffic | None = None
        self._taken = 0
        self.topics: tuple[list[str], list[str]] = ([], [])

    def serve(self, checked: CheckedSystem, network: Network, mailbox: Mailbox, *, packets: bool) -> None:
        """Opens the topics.

        Args:
            checked: the system; its structure must be open.
            network: nodes of the run.
            mailbox: takes the packets made from set-points.
            packets: whether the run records packets.

        Raises:
            CosimError: no positions of vehicles are recorded, the topics cannot be opened, or instances declare
                different local origins.
        """
        motion = _Motion(checked, self._columns)
        nodes: dict[int, str] = {}
        if packets:
            traffic = self._traffic = live_traffic(tuple(self._columns.values()), checked, network)
            at = {node.name: i for i, node in enumerate(network.nodes)}
            of = {topic: traffic.node_of(drone) for topic, drone in motion.drones.items()}
            nodes = {at[node]: topic for topic, node in of.items() if node}
        station = GroundStation(network, self._traffic, mailbox, _ONBOARD_COMPUTER)
        self._setpoints = Setpoints(motion.drones, station, self._tell)
        kinds = _kinds(motion, nodes.values())
        self._transport.open(kinds, self._setpoints.kinds)
        self._publisher = _Publisher(motion, nodes, self._transport)
        self.topics = ([f"/{name}" for name in kinds], [f"/{name}" for name in self._setpoints.kinds])

    def close(self) -> None:
        """Closes the topics, if they are open."""
        self._publisher = None
        self._transport.close()

    def initialised(self, seen: Seen) -> None:
        self._seen = seen  # its arrays are those of the loop: they have the values of each later moment, too
        self._exchange(seen.time)

    def stepped(self, seen: Seen) -> None: ...

    def packets(self, packets: Packets, *, complete: bool) -> None:
        if self._publisher is None or self._traffic is None:
            return
        self._traffic.packets(packets, complete=complete)
        self._publisher.packets(packets.log[self._taken :].tobytes())
        self._taken = 0 if complete else packets.log.size

    def progressed(self, progress: Progress) -> None:
        self._exchange(progress.time)

    def closed(self) -> None:
        self._seen = None

    def _exchange(self, time: float) -> None:
        if self._publisher is None or self._seen is None or self._setpoints is None:
            return
        self._publisher.publish(time, self._seen)
        for topic, message in self._transport.read():
            self._setpoints.take(topic, message)


def _kinds(motion: _Motion, speaking: Any) -> dict[str, str]:
    """Returns the topics that are published, and their types; `speaking`: the drones whose packets are known."""
    kinds = {"clock": "rosgraph_msgs/msg/Clock", "tf": "tf2_msgs/msg/TFMessage"}
    for name, has_odometry in zip(motion.drones, motion.with_odometry, strict=True):
        kinds[f"{name}/pose"] = "geometry_msgs/msg/PoseStamped"
        if has_odometry:
            kinds[f"{name}/odom"] = "nav_msgs/msg/Odometry"
        if motion.origin is not None:
            kinds[f"{name}/fix"] = "sensor_msgs/msg/NavSatFix"
    return kinds | {f"{name}/mavlink_source": KIND for name in speaking}


class _Motion:
    """The motion of all vehicles at an instant.

    Args:
        checked: the system.
        columns: the recorded signals.

    Attributes:
        drones: names of the vehicles in topics, and as the system names them.
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
                f"ROS: {checked.structure.name} records no positions of vehicles, so nothing can be published; "
                "--record '*.position*' adds them"
            )
        self.origin = declared_origin(known, checked.structure.name)
        names = [one.name for one in found]
        self.drones = dict(zip(names_for_topics(names), names, strict=True))
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
        for name, places in zip(self.drones, self._places, strict=True):
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
    """Publishes values and packets.

    Args:
        motion: the vehicles.
        nodes: their names in topics, by number of their node.
        transport: the open topics.
    """

    def __init__(self, motion: _Motion, nodes: Mapping[int, str], transport: Transport) -> None:
        self._motion, self._nodes, self._transport = motion, nodes, transport
        self._make = Messages(transport.types)
        self._time, self._mavlink = (transport.types[kind] for kind in ("rosgraph_msgs/msg/Clock", KIND))

    def publish(self, time: float, seen: Seen) -> None:
        """Publishes the present values."""
        tracks = self._motion.at(time, seen)
        (stamp,), make, write = tracks.stamps, self._make, self._transport.write
        vehicles = [ros_vehicle(track, track.name, tracks) for track in tracks.vehicles]
        for one in vehicles:
            write(f"{one.name}/pose", make.pose_stamped(one, 0, stamp))
            if one.linear is not None and one.angular is not None:
                write(f"{one.name}/odom", make.odometry(one, 0, stamp))
            if one.fixes is not None:
                write(f"{one.name}/fix", make.fix(one, 0, stamp))
        write("tf", make.transforms(vehicles, 0, stamp))
        write("clock", self._time(clock=make.time(stamp)))

    def packets(self, log: bytes) -> None:
        """Publishes the packets that drones have sent, from the log of the run (`Packets.log`)."""
        at = 0
        while at < len(log):
            ticks, entry, length = struct.unpack_from("<qii", log, at)
            at += 16 + length
            topic = self._nodes.get(entry >> 1)
            if entry & 1 and topic is not None and length >= (12 if log[at - length] == 0xFD else 8):
                header = self._make.header(EPOCH * 1000 + ticks, topic)
                message = self._mavlink(header=header, **fields_of(log[at - length : at]))
                self._transport.write(f"{topic}/mavlink_source", message)

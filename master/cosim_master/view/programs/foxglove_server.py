"""Serves a run to Foxglove while it goes on: `uav-cosim run --foxglove`.

    feed = FoxgloveFeed(view)               the observer of the run
    feed.serve(checked, port)               when the run has been checked; feed.port is the port
    ...                                     the run
    feed.close()

The topics are those of `foxglove_topics`, without those of packets. The server is that of foxglove-sdk
(subprotocol foxglove.sdk.v1), in threads of its own, on loopback. Clients only read. Values are copied when the run
reports its progress, twenty to fifty times a second of wall-clock time, and only for topics that a client has
subscribed; a slow client loses the oldest messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import foxglove
import numpy as np
import pyarrow as pa
from foxglove import channels
from foxglove.websocket import ServerListener

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.contents.foxglove_topics import PoseTopics, json_message, scene, signal_channel
from cosim_master.results.export.contents.tracks import declared_origin, enu, geodetic, orientation
from cosim_master.results.export.contents.variables import Recorded, recorded_variables
from cosim_master.results.reading.roles import parts
from cosim_master.results.recording.packet_log import EPOCH
from cosim_master.stepping.observation import Column, Progress, Seen, View, value_of
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.view.live.document import known_of
from cosim_master.view.motion import Moving, moving

__all__ = ["FoxgloveFeed"]

_HOST = "127.0.0.1"


class FoxgloveFeed:
    """A `ProgressObserver` that publishes the newest values.

    Args:
        view: the run.
    """

    every = 0

    def __init__(self, view: View) -> None:
        self._columns = {column.name: column for column in view.columns}
        self._seen: Seen | None = None
        self._context: Any = None  # the server does not keep it
        self._server: Any = None
        self._topics: list[_Motion | _Signals] = []

    def serve(self, checked: CheckedSystem, number: int) -> None:
        """Opens the server.

        Args:
            checked: the system; its structure must be open.
            number: of the port; 0 for any free port.

        Raises:
            CosimError: the port cannot be opened, or instances declare different local origins.
        """
        context = self._context = foxglove.Context()
        schema = pa.schema([_field(column) for column in self._columns.values()])
        vehicles = _vehicles(checked, self._columns)
        motion = _Motion(context, checked, vehicles, self._columns)
        self._topics = [motion] if vehicles else []
        self._topics += [
            _Signals(context, instance, variables, self._columns)
            for instance, variables in recorded_variables(schema).items()
        ]
        try:
            self._server = foxglove.start_server(
                name=checked.structure.name,
                host=_HOST,
                port=number,
                capabilities=[foxglove.Capability.Time],
                server_listener=motion,
                context=context,
            )
        except (RuntimeError, OSError) as error:
            raise CosimError(f"--foxglove {number}: the port of {_HOST} cannot be opened: {error}") from error

    @property
    def port(self) -> int:
        """The port of the server."""
        return int(self._server.port)

    def close(self) -> None:
        """Closes the server, if it is open."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def initialised(self, seen: Seen) -> None:
        self._seen = seen  # its arrays are those of the loop: they have the values of each later moment, too
        self._publish(seen.time)

    def stepped(self, seen: Seen) -> None: ...

    def progressed(self, progress: Progress) -> None:
        self._publish(progress.time)

    def closed(self) -> None:
        self._seen = None

    def _publish(self, time: float) -> None:
        if self._server is None or self._seen is None:
            return
        stamp = EPOCH * 1000 + round(time * 1e9)
        self._server.broadcast_time(stamp)
        for topic in self._topics:
            topic.publish(stamp, self._seen)


class _Motion(ServerListener):
    """The topics of all vehicles, and the listener of the server: who subscribes to the scene receives it."""

    def __init__(
        self, context: Any, checked: CheckedSystem, vehicles: Sequence[Moving], columns: Mapping[str, Column]
    ) -> None:
        self._names = [vehicle.part.name for vehicle in vehicles]
        self._origin = declared_origin(known_of(checked), checked.structure.name)
        self._poses = PoseTopics(context, self._names, on_earth=self._origin is not None)
        self._scene = channels.SceneUpdateChannel("/scene", context=context)
        self._scene_is_due = False
        level = [None] * 4  # of a vehicle whose attitude is not recorded
        self._places = [[columns[name].place for name in one.columns["position"]] for one in vehicles]
        self._turns = [
            [columns[name].place for name in one.columns["attitude"]] if "attitude" in one.columns else level
            for one in vehicles
        ]

    def publish(self, stamp: int, seen: Seen) -> None:
        if self._scene_is_due:
            self._scene_is_due = False
            self._scene.log(scene(stamp, self._names, {}), log_time=stamp)
        if not self._poses.has_readers:
            return
        position = seen.reals[np.array(self._places)]
        attitude = [
            [1.0, 0.0, 0.0, 0.0] if places[0] is None else seen.reals[places].tolist() for places in self._turns
        ]
        fixes = [] if self._origin is None else geodetic(position, self._origin).tolist()
        self._poses.log(stamp, enu(position).tolist(), orientation(np.array(attitude)).tolist(), fixes)

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
        if channel.topic == "/scene":
            self._scene_is_due = True


class _Signals:
    """The topic of one instance."""

    def __init__(
        self, context: Any, instance: str, variables: Mapping[str, Recorded], columns: Mapping[str, Column]
    ) -> None:
        self._channel = signal_channel(context, instance, variables)
        self._variables = [
            (name, one.is_array, [columns[column] for column in one.columns]) for name, one in variables.items()
        ]

    def publish(self, stamp: int, seen: Seen) -> None:
        if not self._channel.has_sinks():
            return
        values: dict[str, Any] = {}
        for name, is_array, columns in self._variables:
            elements = [value_of(column, seen) for column in columns]
            values[name] = elements if is_array else elements[0]
        self._channel.log(json_message(values), log_time=stamp)


def _vehicles(checked: CheckedSystem, columns: Mapping[str, Column]) -> list[Moving]:
    units = {name: "" if one.variable.unit is None else one.variable.unit.name for name, one in columns.items()}
    known = known_of(checked)
    return moving(parts(units, known), known, units)


def _field(column: Column) -> pa.Field:
    kind = {"Real": pa.float64(), "Boolean": pa.bool_()}.get(column.kind, pa.int64())
    unit = "" if column.variable.unit is None else column.variable.unit.name
    metadata = {"unit": unit, "description": column.variable.description or ""}
    return pa.field(column.name, kind, metadata=metadata)

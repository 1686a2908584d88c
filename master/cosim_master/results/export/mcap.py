"""Exports a run as MCAP with the schemas of Foxglove, which Foxglove, Lichtblick and Rerun open.

/tf                foxglove.FrameTransforms  all vehicles, from "map" (ENU) to the vehicle's name (FLU)
/NAME/pose         foxglove.PoseInFrame
/NAME/fix          foxglove.LocationFix      if the local origin is known
/signals/INSTANCE  JSON                      all recorded signals of an instance, arrays as lists, for plots
/log               foxglove.Log              STATUSTEXT of all nodes, and the findings of the verdict
/scene             foxglove.SceneUpdate      once: a body, its name and its path for each vehicle
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.results.export.options import Options
from cosim_master.results.export.spoken import spoken
from cosim_master.results.export.tracks import Array, Track, Tracks, enu, geodetic, orientation, read_tracks
from cosim_master.results.export.variables import Recorded, recorded_variables
from cosim_master.results.reading.recorded_signals import open_signals

__all__ = ["export"]

_MAP = "map"
_PATH = 2000
_SIZE = 0.4  # m, of the body in the scene


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the file; returns notes."""
    import foxglove
    from foxglove import channels

    tracks = read_tracks(run, options)
    context = foxglove.Context()
    with foxglove.open_mcap(file, allow_overwrite=True, context=context):
        _write_scene(channels.SceneUpdateChannel("/scene", context=context), tracks)
        _write_poses(channels, context, tracks)
        _write_log(channels.LogChannel("/log", context=context), run)
        _write_signals(foxglove, context, run, tracks.stamps)
    if tracks.origin is None:
        return ["no LocationFix: no FMU declares the local origin; --origin LATITUDE,LONGITUDE,ALTITUDE gives one"]
    return []


def _timestamp(stamp: int) -> Any:
    from foxglove.messages import Timestamp

    return Timestamp(stamp // 10**9, stamp % 10**9)


def _rotations(track: Track) -> Array:
    n = len(track.position)
    return orientation(np.repeat([[1.0, 0.0, 0.0, 0.0]], n, axis=0) if track.attitude is None else track.attitude)


def _write_poses(channels: Any, context: Any, tracks: Tracks) -> None:
    from foxglove.messages import FrameTransform, FrameTransforms, LocationFix, Pose, PoseInFrame, Quaternion, Vector3

    transforms = channels.FrameTransformsChannel("/tf", context=context)
    vehicles = []
    for track in tracks.vehicles:
        topic = f"/{track.name}"
        pose = channels.PoseInFrameChannel(f"{topic}/pose", context=context)
        fix = fixes = None
        if tracks.origin is not None:
            fix = channels.LocationFixChannel(f"{topic}/fix", context=context)
            fixes = geodetic(track.position, tracks.origin).tolist()
        vehicles.append((track.name, enu(track.position).tolist(), _rotations(track).tolist(), pose, fix, fixes))
    for k, stamp in enumerate(tracks.stamps):
        time, frames = _timestamp(stamp), []
        for name, positions, rotations, pose, fix, fixes in vehicles:
            x, y, z = positions[k]
            qx, qy, qz, qw = rotations[k]
            place, turn = Vector3(x=x, y=y, z=z), Quaternion(x=qx, y=qy, z=qz, w=qw)
            frames.append(
                FrameTransform(
                    timestamp=time, parent_frame_id=_MAP, child_frame_id=name, translation=place, rotation=turn
                )
            )
            here = PoseInFrame(timestamp=time, frame_id=_MAP, pose=Pose(position=place, orientation=turn))
            pose.log(here, log_time=stamp)
            if fix is not None and fixes is not None:
                latitude, longitude, altitude = fixes[k]
                found = LocationFix(
                    timestamp=time, frame_id=name, latitude=latitude, longitude=longitude, altitude=altitude
                )
                fix.log(found, log_time=stamp)
        transforms.log(FrameTransforms(transforms=frames), log_time=stamp)


def _write_scene(channel: Any, tracks: Tracks) -> None:
    from foxglove.messages import (
        Color,
        CubePrimitive,
        LinePrimitive,
        LinePrimitiveLineType,
        Point3,
        Pose,
        Quaternion,
        SceneEntity,
        SceneUpdate,
        TextPrimitive,
        Vector3,
    )

    upright = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    stamp = tracks.stamps[0]
    time, entities = _timestamp(stamp), []
    rows = np.unique(np.linspace(0, len(tracks.time) - 1, min(len(tracks.time), _PATH)).round().astype(int))
    for track in tracks.vehicles:
        body = CubePrimitive(
            pose=Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=upright),
            size=Vector3(x=_SIZE, y=_SIZE, z=_SIZE / 4),
            color=Color(r=0.1, g=0.4, b=0.8, a=1.0),
        )
        name = TextPrimitive(
            pose=Pose(position=Vector3(x=0.0, y=0.0, z=_SIZE), orientation=upright),
            text=track.name,
            billboard=True,
            font_size=12.0,
            scale_invariant=True,
            color=Color(r=0.1, g=0.1, b=0.1, a=1.0),
        )
        path = LinePrimitive(
            type=LinePrimitiveLineType.LineStrip,
            pose=Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=upright),
            thickness=1.0,
            scale_invariant=True,
            points=[Point3(x=x, y=y, z=z) for x, y, z in enu(track.position)[rows].tolist()],
            color=Color(r=0.5, g=0.5, b=0.5, a=0.6),
        )
        entities.append(
            SceneEntity(
                timestamp=time, frame_id=track.name, id=track.name, frame_locked=True, cubes=[body], texts=[name]
            )
        )
        entities.append(SceneEntity(timestamp=time, frame_id=_MAP, id=f"{track.name} path", lines=[path]))
    channel.log(SceneUpdate(entities=entities), log_time=stamp)


def _write_log(channel: Any, run: Path) -> None:
    from foxglove.messages import Log, LogLevel

    levels = [LogLevel.Fatal] * 3 + [LogLevel.Error, LogLevel.Warning, LogLevel.Info, LogLevel.Info, LogLevel.Debug]
    for one in spoken(run):
        entry = Log(timestamp=_timestamp(one.stamp), level=levels[min(one.severity, 7)], name=one.who, message=one.text)
        channel.log(entry, log_time=one.stamp)


def _write_signals(foxglove: Any, context: Any, run: Path, stamps: list[int]) -> None:
    """Writes the signals as JSON: one channel for each instance, with a schema that gives units and descriptions."""
    with open_signals(run) as signals:
        for instance, variables in recorded_variables(signals.schema_arrow).items():
            table = signals.read(columns=[name for one in variables.values() for name in one.columns])
            properties = {name: _kind(one) for name, one in variables.items()}
            schema = {"type": "object", "title": instance, "properties": properties}
            channel = foxglove.Channel(f"/signals/{instance}", schema=schema, message_encoding="json", context=context)
            columns = [_values(table, one) for one in variables.values()]
            for stamp, row in zip(stamps, zip(*columns, strict=True), strict=True):
                text = json.dumps(dict(zip(variables, row, strict=True)), ensure_ascii=False)
                channel.log(text.encode("utf-8", "replace"), log_time=stamp)


def _kind(one: Recorded) -> dict[str, Any]:
    kind = "string" if pa.types.is_string(one.type) else "boolean" if pa.types.is_boolean(one.type) else "number"
    about = one.description + (f" [{one.unit}]" if one.unit else "")
    if one.is_array:
        return {"type": "array", "items": {"type": kind}, "description": about}
    return {"type": kind, "description": about}


def _values(table: pa.Table, one: Recorded) -> list[Any]:
    columns = [[_json(value) for value in table.column(name).to_pylist()] for name in one.columns]
    return [list(row) for row in zip(*columns, strict=True)] if one.is_array else columns[0]


def _json(value: Any) -> Any:
    """Returns a value of JSON, which has neither NaN nor infinity: null."""
    return None if isinstance(value, float) and not np.isfinite(value) else value

"""Exports a run as MCAP with the schemas of Foxglove, which Foxglove, Lichtblick and Rerun open.

The topics are those of `contents.foxglove_topics`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.results.export.contents.foxglove_topics import (
    PoseTopics,
    json_message,
    scene,
    signal_channel,
    timestamp,
)
from cosim_master.results.export.contents.spoken import spoken
from cosim_master.results.export.contents.tracks import Array, Track, Tracks, enu, geodetic, orientation, read_tracks
from cosim_master.results.export.contents.variables import Recorded, recorded_variables
from cosim_master.results.export.options import Options
from cosim_master.results.reading.recorded_signals import open_signals

__all__ = ["export"]

_PATH = 2000


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the file; returns notes."""
    import foxglove
    from foxglove import channels

    tracks = read_tracks(run, options)
    context = foxglove.Context()
    with _told(), foxglove.open_mcap(file, allow_overwrite=True, context=context):
        rows = np.unique(np.linspace(0, len(tracks.time) - 1, min(len(tracks.time), _PATH)).round().astype(int))
        paths = {track.name: enu(track.position)[rows].tolist() for track in tracks.vehicles}
        first = tracks.stamps[0]
        channels.SceneUpdateChannel("/scene", context=context).log(scene(first, [*paths], paths), log_time=first)
        _write_poses(context, tracks)
        _write_log(channels.LogChannel("/log", context=context), run)
        _write_signals(context, run, tracks.stamps)
    if tracks.origin is None:
        return ["no LocationFix: no FMU declares the local origin; --origin LATITUDE,LONGITUDE,ALTITUDE gives one"]
    return []


@contextmanager
def _told() -> Iterator[None]:
    """Turns Foxglove's errors into those of files, which they are: it converts and writes numbers that are known."""
    try:
        yield
    except RuntimeError as error:
        raise OSError(str(error)) from error


def _rotations(track: Track) -> Array:
    n = len(track.position)
    return orientation(np.repeat([[1.0, 0.0, 0.0, 0.0]], n, axis=0) if track.attitude is None else track.attitude)


def _write_poses(context: Any, tracks: Tracks) -> None:
    names = [track.name for track in tracks.vehicles]
    topics = PoseTopics(context, names, on_earth=tracks.origin is not None)
    places = [enu(track.position).tolist() for track in tracks.vehicles]
    turns = [_rotations(track).tolist() for track in tracks.vehicles]
    fixes = [] if tracks.origin is None else [geodetic(one.position, tracks.origin).tolist() for one in tracks.vehicles]
    for k, stamp in enumerate(tracks.stamps):
        topics.log(stamp, [of[k] for of in places], [of[k] for of in turns], [of[k] for of in fixes])


def _write_log(channel: Any, run: Path) -> None:
    from foxglove.messages import Log, LogLevel

    levels = [LogLevel.Fatal] * 3 + [LogLevel.Error, LogLevel.Warning, LogLevel.Info, LogLevel.Info, LogLevel.Debug]
    for one in spoken(run):
        entry = Log(timestamp=timestamp(one.stamp), level=levels[min(one.severity, 7)], name=one.who, message=one.text)
        channel.log(entry, log_time=one.stamp)


def _write_signals(context: Any, run: Path, stamps: list[int]) -> None:
    with open_signals(run) as signals:
        for instance, variables in recorded_variables(signals.schema_arrow).items():
            table = signals.read(columns=[name for one in variables.values() for name in one.columns])
            channel = signal_channel(context, instance, variables)
            columns = [_values(table, one) for one in variables.values()]
            for stamp, row in zip(stamps, zip(*columns, strict=True), strict=True):
                channel.log(json_message(dict(zip(variables, row, strict=True))), log_time=stamp)


def _values(table: pa.Table, one: Recorded) -> list[Any]:
    columns = [table.column(name).to_pylist() for name in one.columns]
    return [list(row) for row in zip(*columns, strict=True)] if one.is_array else columns[0]

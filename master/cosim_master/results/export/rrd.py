"""Exports a run as .rrd, which the Rerun viewer opens with a view of the scene, plots and messages.

world/NAME                  Transform3D   pose of the vehicle in ENU
world/NAME/body             Boxes3D       and its name
paths/NAME                  LineStrips3D  the whole path
earth/NAME                  GeoPoints     latitude and longitude, if the local origin is known
signals/INSTANCE/VARIABLE   Scalars       a number or an array; text: StateChange
log                         TextLog       STATUSTEXT of all nodes, and the findings of the verdict

Whole columns are written at once: logging instant by instant takes a hundred times as long. The only index, `time`,
counts ns since the start of the run's clock. Rerun keeps poses as 32-bit numbers, and all other numbers as 64-bit ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.results.export.contents.spoken import spoken
from cosim_master.results.export.contents.tracks import Tracks, enu, geodetic, orientation, read_tracks
from cosim_master.results.export.contents.variables import Recorded, recorded_variables
from cosim_master.results.export.options import Options
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.recording.packet_log import EPOCH
from cosim_master.results.storage.arrays import values_of

__all__ = ["export"]

_PATH = 2000
_SIZE = 0.4  # m, of the body
_PLOTTED = 10
_LEVELS = ("CRITICAL", "CRITICAL", "CRITICAL", "ERROR", "WARN", "INFO", "INFO", "DEBUG")  # by MAV_SEVERITY


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the file; returns notes.

    Raises:
        CosimError: no positions of vehicles were recorded.
        OSError: the file cannot be written.
        ModuleNotFoundError: rerun is not installed.
    """
    import rerun

    tracks = read_tracks(run, options)
    time = np.rint(tracks.time * 1e9).astype(np.int64)
    with _strict(), rerun.RecordingStream("uav-cosim", send_properties=False) as recording:
        stream = rerun.binary_stream(recording)
        recording.send_blueprint(_blueprint(tracks), make_active=False)
        recording.send_recording_name(run.resolve().name)
        _send_motion(recording, tracks, time)
        _send_signals(recording, run, time)
        _send_log(recording, run)
        content = stream.read() or b""  # all at once: each reading ends with an index of its own
        recording.disconnect()
    # Not by Rerun's own file: where there is no room, it waits for ever, or says nothing.
    file.write_bytes(content)
    if tracks.origin is None:
        return ["no GeoPoints: no FMU declares the local origin; --origin LATITUDE,LONGITUDE,ALTITUDE gives one"]
    return []


@contextmanager
def _strict() -> Iterator[None]:
    """Makes Rerun raise exceptions; otherwise, it prints a warning and leaves out what it cannot write."""
    import rerun

    before = rerun.strict_mode()
    rerun.set_strict_mode(True)
    try:
        yield
    finally:
        rerun.set_strict_mode(before)


def _index(time: Any) -> list[Any]:
    import rerun

    return [rerun.TimeColumn("time", duration=np.asarray(time, dtype="timedelta64[ns]"))]


def _path(*parts: str) -> str:
    """Returns an entity's path; names of instances contain characters that are special in paths."""
    import rerun

    return str(rerun.new_entity_path([*parts]))


def _send_motion(recording: Any, tracks: Tracks, time: Any) -> None:
    import rerun

    recording.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    index, n = _index(time), len(time)
    some = np.unique(np.linspace(0, n - 1, min(n, _PATH)).round().astype(int))
    for track in tracks.vehicles:
        with np.errstate(over="ignore"):
            places = enu(track.position).astype(np.float32)  # infinite beyond 3e38 m
        attitude = np.repeat([[1.0, 0.0, 0.0, 0.0]], n, axis=0) if track.attitude is None else track.attitude
        pose = rerun.Transform3D.columns(translation=places, quaternion=orientation(attitude))
        recording.send_columns(_path("world", track.name), index, pose)
        half = [_SIZE / 2, _SIZE / 2, _SIZE / 8]
        body = rerun.Boxes3D(half_sizes=[half], labels=[track.name], colors=[0x1A66CCFF], fill_mode="solid")
        recording.log(_path("world", track.name, "body"), body, static=True)
        path = rerun.LineStrips3D([places[some]], colors=[0x80808099])
        recording.log(_path("paths", track.name), path, static=True)
        if tracks.origin is not None:
            on_earth = rerun.GeoPoints.columns(positions=geodetic(track.position, tracks.origin)[:, :2])
            recording.send_columns(_path("earth", track.name), index, on_earth)


def _send_signals(recording: Any, run: Path, time: Any) -> None:
    index = _index(time)
    with open_signals(run) as signals:
        for instance, variables in recorded_variables(signals.schema_arrow).items():
            table = signals.read(columns=[name for one in variables.values() for name in one.columns])
            for name, one in variables.items():
                place = _path("signals", *instance.split("."), name)
                if pa.types.is_string(one.type):
                    _send_texts(recording, place, one, table, time)
                else:
                    _send_numbers(recording, place, one, table, index)


def _send_numbers(recording: Any, place: str, one: Recorded, table: pa.Table, index: Any) -> None:
    import rerun

    values = np.stack([values_of(table.column(name)).astype(np.float64) for name in one.columns], axis=1)
    scalars = rerun.Scalars.columns(scalars=values.reshape(-1))
    recording.send_columns(place, index, scalars.partition([values.shape[1]] * len(values)))
    unit = f" ({one.unit})" if one.unit else ""
    recording.log(place, rerun.SeriesLines(names=[f"{name}{unit}" for name in one.columns]), static=True)


def _send_texts(recording: Any, place: str, one: Recorded, table: pa.Table, time: Any) -> None:
    """Sends the instants at which a text changes; elements of arrays are entities of their own."""
    import rerun

    for k, name in enumerate(one.columns):
        texts = [text or "" for text in table.column(name).to_pylist()]
        new = [i for i, text in enumerate(texts) if i == 0 or text != texts[i - 1]]
        states = rerun.StateChange.columns(state=[texts[i] for i in new])
        recording.send_columns(f"{place}/{k + 1}" if one.is_array else place, _index(time[new]), states)


def _send_log(recording: Any, run: Path) -> None:
    import rerun

    said = spoken(run)
    if said:
        texts = [f"{one.who}: {one.text}" if one.who else one.text for one in said]
        levels = [_LEVELS[min(one.severity, 7)] for one in said]
        time = np.array([one.stamp for one in said], dtype=np.int64) - EPOCH * 1000
        recording.send_columns("log", _index(time), rerun.TextLog.columns(text=texts, level=levels))


def _blueprint(tracks: Tracks) -> Any:
    """Returns the layout: the scene, the positions of some vehicles, and the messages."""
    from rerun import blueprint

    every = max(1, -(-len(tracks.vehicles) // _PLOTTED))
    plotted = [_path("signals", *track.signal.split(".")) for track in tracks.vehicles[::every]]
    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Spatial3DView(origin="/", contents=["/world/**", "/paths/**"], name="scene"),
            blueprint.Vertical(
                blueprint.TimeSeriesView(origin="/", contents=plotted, name="positions: north, east, down"),
                blueprint.TextLogView(origin="/log", name="messages"),
            ),
            column_shares=[3, 2],
        ),
        blueprint.TimePanel(timeline="time", state="collapsed"),
        collapse_panels=True,
    )

"""Exports the motion of all vehicles as a ROS 2 bag (MCAP storage); `contents.bag` has its topics."""

from __future__ import annotations

from pathlib import Path

from cosim_master.results.export.contents.bag import bag_notes, fill_bag
from cosim_master.results.export.contents.tracks import read_tracks
from cosim_master.results.export.options import Options

__all__ = ["export"]


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the bag, a folder; returns notes."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    tracks = read_tracks(run, options)
    store = get_typestore(Stores.ROS2_JAZZY)
    if file.is_dir():
        file.rmdir()  # empty; the writer creates it
    with Writer(file, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as bag:
        fill_bag(tracks, bag, store, store.serialize_cdr)
    return bag_notes(tracks)

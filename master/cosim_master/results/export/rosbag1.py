"""Exports the motion of all vehicles as a ROS 1 bag (a .bag file); `contents.bag` has its topics."""

from __future__ import annotations

from pathlib import Path

from cosim_master.results.export.contents.bag import bag_notes, fill_bag, ros1_store
from cosim_master.results.export.contents.tracks import read_tracks
from cosim_master.results.export.options import Options

__all__ = ["export"]


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the bag; returns notes."""
    from rosbags.rosbag1 import Writer, WriterError

    tracks, store = read_tracks(run, options), ros1_store()
    try:
        with Writer(file) as bag:
            fill_bag(tracks, bag, store, store.serialize_ros1)
    except WriterError as error:  # a device, for example, which exists already
        raise OSError(str(error)) from error
    return bag_notes(tracks)

"""Exports tracks as GPX 1.1: one track for each vehicle, with elevations above mean sea level."""

from __future__ import annotations

from pathlib import Path

from cosim_master.results.export.contents.tracks import geodetic, read_tracks
from cosim_master.results.export.options import Options

__all__ = ["RATE", "export"]

RATE = 10.0
"""Points per second of a track; viewers interpolate linearly."""


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the tracks; returns notes."""
    from gpxpy.gpx import GPX, GPXTrack, GPXTrackPoint, GPXTrackSegment

    everything = read_tracks(run, options, on_earth=True)
    tracks = everything.thinned(RATE)
    assert tracks.origin is not None
    dates = tracks.dates
    document = GPX()
    document.name, document.creator, document.time = run.name, "uav-cosim", dates[0]
    for vehicle in tracks.vehicles:
        places = geodetic(vehicle.position, tracks.origin)
        points = [
            GPXTrackPoint(float(lat), float(lon), elevation=float(alt), time=date)
            for (lat, lon, alt), date in zip(places, dates, strict=True)
        ]
        track = GPXTrack(name=vehicle.name)
        track.segments.append(GPXTrackSegment(points))
        document.tracks.append(track)
    file.write_text(document.to_xml("1.1"), encoding="utf-8")
    if len(tracks.time) < len(everything.time):
        return [
            f"{len(tracks.time)} of {len(everything.time)} recorded instants are written, at most {RATE:g} per second"
        ]
    return []

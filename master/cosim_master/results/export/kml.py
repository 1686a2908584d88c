"""Exports tracks as KML: one gx:Track for each vehicle, with altitudes above mean sea level and headings.

The file is written with lxml: fastkml takes a millisecond for each point, and the ids of simplekml are not valid.
"""

from __future__ import annotations

import colorsys
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from cosim.frames import euler_from_quaternion
from cosim_master.results.export.contents.tracks import Array, Track, geodetic, read_tracks
from cosim_master.results.export.options import Options

__all__ = ["RATE", "export"]

RATE = 10.0
"""Points per second of a track; viewers interpolate linearly."""
_KML, _GX = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the tracks; returns notes."""
    everything = read_tracks(run, options, on_earth=True)
    tracks = everything.thinned(RATE)
    assert tracks.origin is not None
    times = [f"{date:%Y-%m-%dT%H:%M:%S.%f}Z" for date in tracks.dates]
    nsmap: Any = {None: _KML[1:-1], "gx": _GX[1:-1]}
    root = etree.Element(f"{_KML}kml", nsmap=nsmap)
    document = etree.SubElement(root, f"{_KML}Document")
    _add(document, f"{_KML}name", run.name)
    for n, vehicle in enumerate(tracks.vehicles):
        colour = colorsys.hsv_to_rgb(n / len(tracks.vehicles), 0.9, 1.0)
        _place(document, vehicle, times, geodetic(vehicle.position, tracks.origin), colour)
    with file.open("wb") as sink:  # lxml's own errors of files have no reason
        etree.ElementTree(root).write(sink, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    if len(tracks.time) < len(everything.time):
        kept = f"{len(tracks.time)} of {len(everything.time)} recorded instants"
        return [f"{kept} are written, at most {RATE:g} per second"]
    return []


def _add(parent: etree._Element, tag: str, text: str) -> None:
    etree.SubElement(parent, tag).text = text


def _place(
    document: etree._Element, vehicle: Track, times: list[str], places: Array, colour: tuple[float, float, float]
) -> None:
    place = etree.SubElement(document, f"{_KML}Placemark")
    _add(place, f"{_KML}name", vehicle.name)
    line = etree.SubElement(etree.SubElement(place, f"{_KML}Style"), f"{_KML}LineStyle")
    red, green, blue = (int(255 * part) for part in colour)
    _add(line, f"{_KML}color", f"ff{blue:02x}{green:02x}{red:02x}")
    _add(line, f"{_KML}width", "3")
    track = etree.SubElement(place, f"{_GX}Track")
    _add(track, f"{_KML}altitudeMode", "absolute")
    for time in times:
        _add(track, f"{_KML}when", time)
    for latitude, longitude, altitude in places.tolist():
        _add(track, f"{_GX}coord", f"{longitude!r} {latitude!r} {altitude!r}")
    if vehicle.attitude is None:
        return
    for q in vehicle.attitude.tolist():
        roll, pitch, yaw = np.degrees(euler_from_quaternion(tuple(q))).tolist()
        _add(track, f"{_GX}angles", f"{yaw % 360.0!r} {pitch!r} {roll!r}")

"""Heights of the terrain from SRTM files (.hgt), as values of the parameters `terrain*` of a model.

A file holds a square degree: rows of equally many 16-bit integers, most significant byte first, in metres, from north
to south and in each from west to east; the edges belong to the neighbours, too. Its name is that of its south-western
corner.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.frames import geodetic_from_local
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where

__all__ = ["terrain_values"]

_Tiles: TypeAlias = dict[str, NDArray[np.int16]]
_NAME = re.compile(r"([NS])(\d\d)([EW])(\d\d\d)", re.IGNORECASE)
_VOID = -32768


def terrain_values(
    source: str | Path, latitude: float, longitude: float, spacing: float, points: int = 16
) -> dict[str, Any]:
    """Returns values of `terrain_spacing`, `terrain_origin` and `terrain` from SRTM files.

        values = terrain_values("srtm", math.radians(47.37), math.radians(8.54), 90.0)
        swarm.add(position=(0.0, 0.0), values={f"autopilot.{name}": one for name, one in values.items()})

    The grid lies about the local origin, relative to whose height its heights are. Between the points of the file,
    heights are interpolated linearly in latitude and longitude.

    Args:
        source: a file such as N47E008.hgt, or a folder with such files.
        latitude, longitude: the local origin [rad].
        spacing: distance between points of the grid [m].
        points: points of the grid in each direction, as many as the model has.

    Raises:
        SystemDescriptionError: a file is missing, is not one of this format, or has no height at a place.
        ValueError: spacing or points are not positive, or points are fewer than 2.
    """
    if not spacing > 0.0 or points < 2:
        raise ValueError(f"spacing {spacing:g} and points {points}: valid are a positive distance and 2 points or more")
    tiles: _Tiles = {}
    path = Path(source)
    first = -0.5 * spacing * (points - 1)
    here = _height(tiles, path, latitude, longitude)
    heights = []
    for i in range(points):
        for j in range(points):
            lat, lon, _ = geodetic_from_local(first + i * spacing, first + j * spacing, 0.0, latitude, longitude, 0.0)
            heights.append(_height(tiles, path, lat, lon) - here)
    return {"terrain_spacing": spacing, "terrain_origin": (first, first), "terrain": tuple(heights)}


def _name(south: int, west: int) -> str:
    return f"{'S' if south < 0 else 'N'}{abs(south):02d}{'W' if west < 0 else 'E'}{abs(west):03d}"


def _refused(path: Path, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(path)), text)])


def _tile(tiles: _Tiles, source: Path, name: str) -> NDArray[np.int16]:
    """Returns the heights of a square degree, north to south, west to east."""
    if name in tiles:
        return tiles[name]
    file = source
    if source.is_dir():
        found = [one for one in sorted(source.iterdir()) if one.name.lower() == f"{name}.hgt".lower()]
        if not found:
            raise _refused(source, f"there is no {name}.hgt, in which places of the grid lie; add this file")
        file = found[0]
    elif not source.is_file():
        raise _refused(source, "no such file or folder; give an SRTM file such as N47E008.hgt, or a folder of them")
    corner = _NAME.fullmatch(file.stem)
    if corner is None or file.suffix.lower() != ".hgt":
        raise _refused(
            file, "its name is not that of an SRTM file; name it by its south-western corner, as N47E008.hgt"
        )
    if file.stem.upper() != name:
        text = f"places of the grid lie in {name}.hgt; give the folder that has both, or a smaller spacing"
        raise _refused(file, text)
    data = file.read_bytes()
    side = math.isqrt(len(data) // 2)
    if side < 2 or 2 * side * side != len(data):
        raise _refused(file, f"{len(data)} bytes are not a square of 16-bit integers; valid are 1201 or 3601 in a row")
    tiles[name] = np.frombuffer(data, dtype=">i2").astype(np.int16).reshape(side, side)
    return tiles[name]


def _height(tiles: _Tiles, source: Path, latitude: float, longitude: float) -> float:
    """Returns the height above the sea [m] at a place [rad]."""
    south, west = math.floor(math.degrees(latitude)), math.floor(math.degrees(longitude))
    name = _name(south, west)
    tile = _tile(tiles, source, name)
    last = tile.shape[0] - 1
    x, y = (math.degrees(latitude) - south) * last, (math.degrees(longitude) - west) * last
    i, j = min(int(x), last - 1), min(int(y), last - 1)
    corners = tile[last - i - 1 : last - i + 1, j : j + 2][::-1].astype(float)  # from south to north
    if (corners == _VOID).any():
        place = f"{math.degrees(latitude):.5f}, {math.degrees(longitude):.5f}"
        raise _refused(source, f"{name} has no height at {place}; take a file whose voids are filled")
    (a, b), (c, d) = corners
    x, y = x - i, y - j
    return float((1.0 - x) * ((1.0 - y) * a + y * b) + x * ((1.0 - y) * c + y * d))

"""Heights from SRTM files: interpolated as scipy does it, and every file that cannot be read."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from cosim.frames import geodetic_from_local
from cosim_master import SystemDescriptionError, terrain_values

SIDE = 61
LATITUDE, LONGITUDE = 47.4, 8.5


def tile(folder: Path, name: str, heights: NDArray[np.int16]) -> Path:
    """Writes rows from south to north."""
    file = folder / f"{name}.hgt"
    file.write_bytes(heights[::-1].astype(">i2").tobytes())
    return file


def rough(seed: int = 1) -> NDArray[np.int16]:
    return np.random.default_rng(seed).integers(-50, 3000, (SIDE, SIDE)).astype(np.int16)


def values(source: Path, latitude: float = LATITUDE, longitude: float = LONGITUDE, spacing: float = 400.0,
           points: int = 16) -> NDArray[np.float64]:  # fmt: skip
    found = terrain_values(source, math.radians(latitude), math.radians(longitude), spacing, points)
    assert found["terrain_spacing"] == spacing
    assert found["terrain_origin"] == (-0.5 * spacing * (points - 1),) * 2
    return np.array(found["terrain"]).reshape(points, points)


def test_heights_are_interpolated_as_by_scipy(tmp_path: Path) -> None:
    heights = rough()
    found = values(tile(tmp_path, "N47E008", heights))
    axis = np.linspace(0.0, 1.0, SIDE)
    oracle = RegularGridInterpolator((47.0 + axis, 8.0 + axis), heights.astype(float))
    first = -0.5 * 400.0 * 15
    for i in range(16):
        for j in range(16):
            lat, lon, _ = geodetic_from_local(
                first + 400.0 * i, first + 400.0 * j, 0.0, math.radians(LATITUDE), math.radians(LONGITUDE), 0.0
            )
            place = (math.degrees(lat), math.degrees(lon))
            assert found[i, j] == pytest.approx(float(oracle(place) - oracle((LATITUDE, LONGITUDE))), abs=1e-6)


def test_a_slope_is_a_plane_across_the_edge_of_two_files(tmp_path: Path) -> None:
    """1200 m more for each degree to the north and 600 to the east, in files of different resolution."""
    for name, west, side in (("S01W001", 0, 61), ("S01E000", 1, 121)):
        axis = np.arange(side) / (side - 1)
        plane = 1200.0 * axis[:, None] + 600.0 * (west + axis[None, :])
        tile(tmp_path, name, np.round(plane).astype(np.int16))
    found = values(tmp_path, latitude=-0.5, longitude=0.0, spacing=500.0, points=8)
    degree = math.degrees(1.0 / 6378100.0)
    way = 500.0 * (np.arange(8) - 3.5)
    expected = 1200.0 * degree * way[:, None] + 600.0 * degree * way[None, :]
    np.testing.assert_allclose(found, expected, atol=0.6)  # of whole metres


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("N47E008.hgt", b"12345", "5 bytes are not a square of 16-bit integers"),
        ("N47E008.hgt", b"", "0 bytes are not a square"),
        ("alps.hgt", bytes(8), "its name is not that of an SRTM file; name it by its south-western corner"),
        ("N47E008.tif", bytes(8), "its name is not that of an SRTM file"),
        ("N46E008.hgt", bytes(8), "places of the grid lie in N47E008.hgt; give the folder that has both"),
        ("N47E008.hgt", b"\x80\x00" * 4, "N47E008 has no height at 47.40000, 8.50000; take a file whose voids"),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, name: str, content: bytes, text: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SystemDescriptionError, match=text):
        values(tmp_path / name)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError, match=r"no such file or folder; give an SRTM file"):
        values(tmp_path / "N47E008.hgt")
    tile(tmp_path, "n47e008", rough())
    with pytest.raises(SystemDescriptionError, match=r"there is no N47E007\.hgt, in which places of the grid lie"):
        values(tmp_path, longitude=8.0)
    with pytest.raises(ValueError, match="valid are a positive distance and 2 points or more"):
        values(tmp_path, points=1)

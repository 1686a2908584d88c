"""The film: its boxes read by the rules of ISO/IEC 14496-12, its pictures decoded, and played by a browser."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export import mp4
from cosim_master.results.export.formats import export_run, format_of
from cosim_master.results.export.options import Options
from cosim_master.results.figures.style import COLOURS
from tests.master.view.browser import LONG
from tests.master.view.recordings import flying, write_run

av = pytest.importorskip("av", reason="the extra `film` is not installed")

CONTAINERS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Type and contents of all boxes, also of those in boxes."""
    at = 0
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + size]
        yield kind, body
        if kind in CONTAINERS:
            yield from boxes(body)
        at += size


def told(file: Path) -> tuple[int, float, tuple[float, float], bytes]:
    """Number of pictures, duration [s], width and height, and codec, as the boxes say."""
    found = dict(boxes(file.read_bytes()))
    scale, duration = struct.unpack_from(">II", found[b"mdhd"], 12)
    entries = struct.iter_unpack(">II", found[b"stts"][8:])
    counts = [(count, delta) for count, delta in entries]
    assert sum(count * delta for count, delta in counts) == duration
    width, height = struct.unpack_from(">II", found[b"tkhd"], 76)
    return sum(count for count, _ in counts), duration / scale, (width / 65536, height / 65536), found[b"stsd"][12:16]


def test_one_picture_for_each_recorded_instant(exported: Mapping[str, Path]) -> None:
    count, duration, (width, height), codec = told(exported["mp4"])
    assert (count, duration, codec) == (161, pytest.approx(161 / 25), b"avc1")
    assert width == 600 and height % 2 == 0
    kinds = [kind for kind, _ in boxes(exported["mp4"].read_bytes())]
    assert kinds.index(b"moov") < kinds.index(b"mdat")  # it begins before it is loaded


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two vehicles that fly north for 10 s, recorded 200 times a second."""
    return write_run(tmp_path_factory.mktemp("runs") / "run", flying(["one", "two"], np.arange(0.0, 10.001, 0.005)))


@pytest.fixture(scope="module")
def film(run: Path) -> Path:
    """A film that may have 50 pictures."""
    file = run.parent / "x.mp4"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mp4, "MOST", 50)
        (note,) = export_run(run, format_of(file), file, Options())
    assert note == "50 pictures, 5 times real time"
    return file


def test_a_film_lasts_a_minute_at_most() -> None:
    assert mp4.MOST / mp4.RATE == 60.0


def test_the_drones_are_where_they_were(film: Path) -> None:
    assert told(film)[:2] == (50, 2.0)
    colour = np.array(to_rgb(COLOURS[1])) * 255
    rows, columns, count = [], [], 0
    with av.open(str(film)) as opened:
        for picture in opened.decode(video=0):
            count += 1
            if count % 5 != 1:
                continue
            near = np.abs(picture.to_ndarray(format="rgb24").astype(int) - colour).sum(axis=2) < 60
            row, column = np.argwhere(near).mean(axis=0)
            rows.append(row)
            columns.append(column)
    assert count == 50
    np.testing.assert_allclose(rows, np.linspace(rows[0], rows[-1], 10), atol=1.0)  # 2 m/s to the north
    np.testing.assert_allclose(columns, columns[0], atol=1.0)
    assert rows[0] - rows[-1] > 200


def test_a_browser_plays_it(film: Path, browser: Any) -> None:
    page = browser.new_page()
    page.goto(film.as_uri(), timeout=LONG)
    page.wait_for_function("document.querySelector('video').readyState >= 2", timeout=LONG)
    video = "document.querySelector('video')"
    width, height, duration = page.evaluate(f"[{video}.videoWidth, {video}.videoHeight, {video}.duration]")
    assert (width, height, duration) == (*told(film)[2], 2.0)


def test_a_run_without_positions(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", {"time": ([0.0, 1.0], "s"), "a.x": ([0.0, 1.0], "m")})
    with pytest.raises(CosimError, match="nothing to draw: no component has position"):
        export_run(run, format_of(Path("x.mp4")), tmp_path / "x.mp4", Options())
    assert not (tmp_path / "x.mp4").exists()


def test_short_runs_are_shown_at_real_time(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", flying(["one"], np.arange(101) * 0.01))
    for name in ("x.mp4", "x.gif"):
        export_run(run, format_of(Path(name)), tmp_path / name, Options())
    assert told(tmp_path / "x.mp4")[:2] == (26, 26 / 25)
    with Image.open(tmp_path / "x.gif") as animation:
        assert animation.n_frames == 11


def test_one_instant(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", flying(["one"], np.array([0.0])))
    export_run(run, format_of(Path("x.mp4")), tmp_path / "x.mp4", Options())
    assert told(tmp_path / "x.mp4")[:2] == (1, pytest.approx(1 / 25))

"""Exports the motion of all drones, seen from above, as a film: H.264 in MP4, which browsers and slides play.

The pictures are those of `gif`, but more of them, in all colours. PyAV writes them; it contains FFmpeg's libraries.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np

from cosim_master.results.export.contents.animation import Animation
from cosim_master.results.export.options import Options

__all__ = ["MOST", "RATE", "export"]

RATE = 25
"""Pictures per second."""
MOST = 1500
"""Most pictures of a film: one minute."""
_QUALITY = {"crf": "20", "preset": "medium"}


def export(run: Path, file: Path, options: Options) -> list[str]:  # noqa: ARG001
    """Writes the film; returns a note about its speed.

    Raises:
        CosimError: no positions were recorded.
        OSError: the file cannot be written.
        ModuleNotFoundError: PyAV is not installed.
    """
    import av

    animation = Animation(run, RATE, MOST)
    with av.open(str(file), "w", format="mp4", options={"movflags": "+faststart"}) as film:
        stream = film.add_stream("libx264", rate=RATE, options=_QUALITY)
        stream.pix_fmt = "yuv420p"  # the only one that all players know; it needs even sizes
        stream.codec_context.time_base = Fraction(1, RATE)
        for number, picture in enumerate(animation.pictures()):
            height, width = (size + size % 2 for size in picture.shape[:2])
            if number == 0:
                stream.width, stream.height = width, height
            rows, columns = (0, height - picture.shape[0]), (0, width - picture.shape[1])
            even = np.pad(picture, (rows, columns, (0, 0)), mode="edge")
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            frame.pts = number
            film.mux(stream.encode(frame))
        film.mux(stream.encode())
    return [f"{animation.count} pictures, {animation.speed:.3g} times real time"]

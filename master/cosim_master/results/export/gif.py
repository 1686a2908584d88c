"""Exports the motion of all drones, seen from above, as an animated GIF."""

from __future__ import annotations

from pathlib import Path

from cosim_master.results.export.contents.animation import Animation
from cosim_master.results.export.options import Options

__all__ = ["FRAMES", "RATE", "export"]

FRAMES = 120
"""Most pictures of an animation."""
RATE = 10.0
"""Pictures per second."""


def export(run: Path, file: Path, options: Options) -> list[str]:  # noqa: ARG001
    """Writes the animation; returns a note about its speed.

    Raises:
        CosimError: no positions were recorded.
    """
    from PIL import Image

    animation = Animation(run, RATE, FRAMES)
    first, *others = [
        Image.fromarray(picture).quantize(64, dither=Image.Dither.NONE) for picture in animation.pictures()
    ]
    first.save(file, format="GIF", save_all=True, append_images=others, duration=round(1000.0 / RATE), loop=0)
    return [f"{animation.count} pictures, {animation.speed:.3g} times real time"]

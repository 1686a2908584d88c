"""Exports the motion of all drones, seen from above, as an animated GIF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.options import Options
from cosim_master.results.figures.style import COLOURS, NAMED, STYLE, plain
from cosim_master.results.reading.flight import read_flight

__all__ = ["FRAMES", "RATE", "export"]

FRAMES = 120
"""Most pictures of an animation."""
RATE = 10.0
"""Pictures per second."""
_WIDTH, _DPI = 6.0, 100


def export(run: Path, file: Path, options: Options) -> list[str]:  # noqa: ARG001
    """Writes the animation; returns a note about its speed.

    Raises:
        CosimError: no positions were recorded.
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    flight = read_flight(run)
    flown = [(plain(drone.name), drone.position) for drone in flight.drones if drone.position is not None]
    if not flown:
        raise CosimError(f"{run}: nothing to show: no positions of vehicles were recorded")
    places = np.stack([position[:, [1, 0]] for _, position in flown], axis=1)
    times = np.linspace(flight.time[0], flight.time[-1], min(FRAMES, len(flight.time)))
    rows = [flight.row(float(time)) for time in times]
    pictures: list[Any] = []
    with style.context(["default", STYLE]):
        size = np.ptp(places, axis=(0, 1))
        tall = float(np.clip(size[1] / max(size[0], 1e-9), 0.25, 1.0))
        figure = Figure((_WIDTH, 1.0 + 5.0 * tall), dpi=_DPI, layout="constrained")
        axes = figure.subplots()
        for k in range(len(flown) if len(flown) <= NAMED else 0):
            axes.plot(places[:, k, 0], places[:, k, 1], color="0.8", linewidth=0.8)
        numbers = np.arange(len(flown))
        looks: dict[str, Any] = {"c": [COLOURS[k % len(COLOURS)] for k in numbers]}
        if len(flown) > NAMED:
            looks = {"c": numbers, "cmap": "cividis"}
        points = axes.scatter(
            places[0, :, 0], places[0, :, 1], s=max(3.0, min(36.0, 400.0 / len(flown))), zorder=3, **looks
        )
        low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        room = 0.06 * float(size.max()) + 1.0
        axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
        axes.set(xlabel="east (m)", ylabel="north (m)")
        title = axes.set_title("t = 0 s", fontsize=8.0)
        canvas: Any = FigureCanvasAgg(figure)
        canvas.draw()  # sets the layout
        figure.set_layout_engine("none")
        points.set_animated(True)
        title.set_animated(True)
        canvas.draw()
        still = canvas.copy_from_bbox(figure.bbox)  # all but the drones and the time
        for row in rows:
            canvas.restore_region(still)
            points.set_offsets(places[row])
            title.set_text(f"t = {flight.time[row]:.1f} s")
            axes.draw_artist(points)
            axes.draw_artist(title)
            image = Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3])
            pictures.append(image.quantize(64, dither=Image.Dither.NONE))
    pictures[0].save(
        file, format="GIF", save_all=True, append_images=pictures[1:], duration=round(1000.0 / RATE), loop=0
    )
    factor = float(times[-1] - times[0]) / (len(rows) / RATE)
    return [f"{len(rows)} pictures, {factor:.3g} times real time"]

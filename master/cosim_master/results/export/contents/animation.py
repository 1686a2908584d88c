"""The pictures of an animation: all drones, seen from above, at equal intervals of the run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.figures.style import COLOURS, NAMED, STYLE, plain
from cosim_master.results.reading.flight import read_flight

__all__ = ["Animation"]

Picture: TypeAlias = "np.ndarray[Any, np.dtype[np.uint8]]"

_WIDTH, _DPI = 6.0, 100


class Animation:
    """The pictures of a run.

    Args:
        run: folder of the run.
        rate: pictures per second.
        most: largest number of pictures; there is at most one for each recorded instant, and `rate` for each second.

    Attributes:
        count: number of pictures.
        speed: simulated time per time of the animation.

    Raises:
        CosimError: no positions were recorded.
    """

    def __init__(self, run: Path, rate: float, most: int) -> None:
        self._flight = read_flight(run)
        flown = [
            (plain(drone.name), drone.position) for drone in self._flight.drones if drone.position is not None
        ]  # fmt: skip
        if not flown:
            raise CosimError(f"{run}: nothing to show: no positions of vehicles were recorded")
        self._places = np.stack([position[:, [1, 0]] for _, position in flown], axis=1)
        time = self._flight.time
        in_time = int((time[-1] - time[0]) * rate + 1e-9) + 1  # more would be slower than the run
        times = np.linspace(time[0], time[-1], min(most, len(time), in_time))
        self._rows = [self._flight.row(float(one)) for one in times]
        self.count = len(times)
        self.speed = float(times[-1] - times[0]) / (self.count / rate)

    def pictures(self) -> Iterator[Picture]:
        """Returns the pictures (height, width, RGB), which have the same size."""
        from matplotlib import style
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        with style.context(["default", STYLE]):
            size = np.ptp(self._places, axis=(0, 1))
            tall = float(np.clip(size[1] / max(size[0], 1e-9), 0.25, 1.0))
            figure = Figure((_WIDTH, 1.0 + 5.0 * tall), dpi=_DPI, layout="constrained")
            points, title = self._drawn(figure.subplots())
            canvas: Any = FigureCanvasAgg(figure)
            canvas.draw()  # sets the layout
            figure.set_layout_engine("none")
            points.set_animated(True)
            title.set_animated(True)
            canvas.draw()
            still = canvas.copy_from_bbox(figure.bbox)  # all but the drones and the time
            for row in self._rows:
                canvas.restore_region(still)
                points.set_offsets(self._places[row])
                title.set_text(f"t = {self._flight.time[row]:.1f} s")
                title.axes.draw_artist(points)
                title.axes.draw_artist(title)
                yield np.asarray(canvas.buffer_rgba())[:, :, :3]

    def _drawn(self, axes: Any) -> tuple[Any, Any]:
        """Returns drones and title of the axes."""
        places = self._places
        n = places.shape[1]
        for k in range(n if n <= NAMED else 0):
            axes.plot(places[:, k, 0], places[:, k, 1], color="0.8", linewidth=0.8)
        numbers = np.arange(n)
        looks: dict[str, Any] = {"c": [COLOURS[k % len(COLOURS)] for k in numbers]}
        if n > NAMED:
            looks = {"c": numbers, "cmap": "cividis"}
        points = axes.scatter(places[0, :, 0], places[0, :, 1], s=max(3.0, min(36.0, 400.0 / n)), zorder=3, **looks)
        low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        room = 0.06 * float(np.ptp(places, axis=(0, 1)).max()) + 1.0
        axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
        axes.set(xlabel="east (m)", ylabel="north (m)")
        return points, axes.set_title("t = 0 s", fontsize=8.0)

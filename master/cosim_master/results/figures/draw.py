"""Draws the figures of a run, for papers.

    positions   desired and actual position of every drone over time, the steps of the algorithm marked
    snapshots   where all drones are in space when three of the steps begin
    map         paths of all drones, seen from above
    errors      distance of every mobile drone to the law's fixed point, even spacing, and the law's bound
    altitude    heights over time, and the smallest distance between any two drones
    links       packets and losses from each node to each other
    latency     a histogram of the delays of packets
    signals     the signals that the user names

Violations of monitors are marked in all figures over time.

Without agents, a run has no steps: positions then have three axes, and snapshots are taken at start, middle and end.
Each figure contains the digest of its data; a new run in the same folder removes the figure. The same run gives the
same bytes: fonts and style are Matplotlib's defaults, whatever its configuration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim_master.files.whole import replacing, writing
from cosim_master.results.figures.motion import (
    draw_altitude,
    draw_errors,
    draw_map,
    draw_positions,
    draw_snapshots,
)
from cosim_master.results.figures.radio import draw_latency, draw_links
from cosim_master.results.figures.signals import draw_signals, read_panels
from cosim_master.results.figures.style import STYLE, plain
from cosim_master.results.figures.violations import mark_violations, marks_of
from cosim_master.results.reading.flight import read_flight
from cosim_master.results.reading.links import read_links
from cosim_master.results.reading.read import has_packets
from cosim_master.results.reading.roles import read_manifest
from cosim_master.results.storage.run_folder import stamp

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FORMATS", "USUAL", "drawn", "figures"]

FORMATS = ("png", "svg", "pdf")
USUAL = ("png", "svg")


def figures(
    run: Path, folder: Path | None = None, *, signals: Sequence[str] = (), formats: Sequence[str] = USUAL
) -> list[Path]:
    """Draws all figures that the recording of a run allows, or signals.

    Args:
        run: folder of the run.
        folder: the folder to write to, created if necessary. None: the folder of the run.
        signals: patterns of signals to draw instead, a panel for each.
        formats: some of `FORMATS`.

    Returns:
        The files written.

    Raises:
        CosimError: the run is not complete, or there is nothing to draw.
        WriteFailed: a file cannot be written.
    """
    folder = folder or run
    files: list[Path] = []
    drawn_of = ""
    with writing(folder, "figures"):
        for name, figure in drawn(run, signals):
            if not files:
                drawn_of = stamp(run)
                folder.mkdir(parents=True, exist_ok=True)
            for suffix in dict.fromkeys(formats):
                files.append(folder / f"{name}.{suffix}")
                with replacing(files[-1]) as part:
                    figure.savefig(part, metadata=_metadata(suffix, drawn_of))
    return files


def drawn(run: Path, signals: Sequence[str] = ()) -> Iterator[tuple[str, Figure]]:
    """Returns names and figures one after the other, each within the style of all figures.

    Raises:
        CosimError: the run is not complete, or there is nothing to draw.
    """
    from matplotlib import style

    drawers: dict[str, Callable[[], Figure | None]] = {}
    if signals:
        panels = [
            replace(one, pattern=plain(one.pattern), names=tuple(map(plain, one.names)), unit=plain(one.unit))
            for one in read_panels(run, signals)
        ]
        drawers["signals"] = lambda: draw_signals(panels)
    else:
        flight = read_flight(run)
        flight = replace(flight, drones=tuple(replace(one, name=plain(one.name)) for one in flight.drones))
        reach = read_manifest(run).get("network", {}).get("range")
        drawers = {
            "positions": lambda: draw_positions(flight),
            "snapshots": lambda: draw_snapshots(flight),
            "map": lambda: draw_map(flight, reach if isinstance(reach, (int, float)) else None),
            "errors": lambda: draw_errors(flight),
            "altitude": lambda: draw_altitude(flight),
        }
        if has_packets(run):
            links = read_links(run)
            links = replace(links, nodes=tuple(map(plain, links.nodes)))
            drawers |= {"links": lambda: draw_links(links), "latency": lambda: draw_latency(links)}
    manifest = read_manifest(run) if (run / "manifest.json").is_file() else {}  # signals of a killed run can be drawn
    monitors = tuple(replace(one, name=plain(one.name)) for one in marks_of(manifest))
    for name, draw in drawers.items():
        with style.context(["default", STYLE]):
            figure = draw()
            if figure is not None:
                mark_violations(figure, monitors)
                if (layout := figure.get_layout_engine()) is not None:
                    layout.execute(figure)
                    figure.set_layout_engine("none")  # otherwise every file would compute the same layout again
                yield name, figure


def _metadata(suffix: str, drawn_of: str) -> dict[str, Any]:
    if suffix == "pdf":
        return {"Keywords": drawn_of, "CreationDate": None}
    return {"Source": drawn_of} | ({"Date": None} if suffix == "svg" else {})

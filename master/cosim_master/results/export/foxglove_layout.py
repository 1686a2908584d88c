"""Exports a layout of Foxglove for the topics of a run: the scene, plots of all vehicles, their map, the messages.

It fits the file of `--mcap` and the server of `run --foxglove`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cosim_master.results.export.contents.foxglove_topics import MAP
from cosim_master.results.export.contents.tracks import Tracks, read_tracks
from cosim_master.results.export.options import Options

__all__ = ["export"]

_PLOTTED = 10
"""Most vehicles in a plot."""
_AXES = {"east (m)": "x", "north (m)": "y", "up (m)": "z"}


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes the file; returns no notes."""
    from foxglove import layouts

    tracks = read_tracks(run, options)
    plots = [layouts.SplitItem(content=_plot(tracks, label, field)) for label, field in _AXES.items()]
    words = layouts.LogPanel(config=layouts.LogConfig(topic_to_render="/log", min_log_level=1))
    places: list[Any] = [layouts.SplitItem(proportion=3, content=_scene())]
    if tracks.origin is not None:
        fixes = {f"/{track.name}/fix": layouts.MapTopicSettings(history_mode="all") for track in tracks.vehicles}
        follow = next(iter(fixes))
        config = layouts.MapConfig(follow_topic=follow, topic_config=fixes, layer="map", zoom_level=18)
        places.append(layouts.SplitItem(proportion=1, content=layouts.MapPanel(config=config)))
    columns = [
        layouts.SplitItem(proportion=3, content=layouts.SplitContainer(direction="column", items=places)),
        layouts.SplitItem(
            proportion=2,
            content=layouts.SplitContainer(
                direction="column", items=[*plots, layouts.SplitItem(proportion=0.7, content=words)]
            ),
        ),
    ]
    layout = layouts.Layout(content=layouts.SplitContainer(direction="row", items=columns))
    file.write_text(json.dumps(json.loads(layout.to_json()), indent=1) + "\n", encoding="utf-8")
    return []


def _scene() -> Any:
    from foxglove import layouts

    return layouts.ThreeDeePanel(
        config=layouts.ThreeDeeConfig(
            follow_tf=MAP,
            fixed_frame=MAP,
            topics={"/scene": layouts.BaseRendererSceneUpdateTopicSettings(visible=True)},
            layers={"grid": layouts.BaseRendererGridLayerSettings(visible=True, frame_id=MAP, size=200, divisions=20)},
        )
    )


def _plot(tracks: Tracks, label: str, field: str) -> Any:
    from foxglove import layouts

    some = tracks.vehicles[:: max(1, -(-len(tracks.vehicles) // _PLOTTED))]
    series = [
        layouts.PlotSeries(value=f"{_quoted(f'/{one.name}/pose')}.pose.position.{field}", label=one.name)
        for one in some
    ]
    return layouts.PlotPanel(
        config=layouts.PlotConfig(paths=series, y_axis_label=label, show_legend=True, is_synced=True)
    )


def _quoted(topic: str) -> str:
    """Returns a topic in a message path; it is quoted if it contains other characters than names of Python and /."""
    return topic if topic.replace("/", "_").isidentifier() else json.dumps(topic)

"""Figures: what their artists hold against literal expectations, on recordings in the recorder's format."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.image import imread

from cosim_master.diagnostics.errors import CosimError, WriteFailed
from cosim_master.results.figures.draw import drawn, figures
from cosim_master.results.figures.motion import draw_altitude, draw_errors, draw_map, draw_positions, draw_snapshots
from cosim_master.results.reading.flight import read_flight
from cosim_master.results.storage.run_folder import is_figure
from tests.master.full_disk import room_of

FIRST, PERIOD, LAG = 25.0, 3.1875, 0.6


LINE = {
    "sysid": {"is": "SystemId"},
    "target": {
        "is": "Formation",
        "step": "step",
        "stays": "stubborn",
        "neighbours": [{"id": "left_sysid", "gain": "epsilon"}, {"id": "right_sysid", "gain": "epsilon"}],
    },
}
"""What the agent of the line declares, as manifests have it."""


def write_run(run: Path, columns: Mapping[str, tuple[Any, str]], instances: Mapping[str, Any] | None = None) -> Path:
    """A run folder: columns as (values, unit), in the recorder's types and metadata."""
    fields, arrays = [], []
    for name, (values, unit) in columns.items():
        array = pa.array(values)
        array = array.cast(pa.int32()) if pa.types.is_integer(array.type) else array
        fields.append(pa.field(name, array.type, metadata={"unit": unit, "description": ""}))
        arrays.append(array)
    run.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), run / "signals.parquet", compression="zstd")
    manifest = {"outcome": "done", "instances": instances or {}, "fmus": {"LineAgent.fmu": {"verdicts": LINE}}}
    (run / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return run


def consensus_run(
    run: Path,
    starts: Sequence[float] = (0, 10, 20, 50, 100),
    *,
    last_step: int = 18,
    epsilon: float = 1 / 3,
    system: str = "",
    parameters: bool = True,
    lag: float = LAG,
) -> Path:
    """Drones on a line under the ideal law, the ends stubborn, positions following with a first-order lag."""
    dt = 0.0125
    time = np.arange(round((FIRST + PERIOD * last_step) / dt) + 1) * dt
    step = np.maximum(0, np.floor((time - FIRST) / PERIOD + 1e-9).astype(np.int64) + 1)
    x = np.array(starts, float)
    points = [x, x]  # step 0 and #1
    for _ in range(last_step):
        x = np.concatenate([x[:1], x[1:-1] + epsilon * (x[:-2] - 2 * x[1:-1] + x[2:]), x[-1:]])
        points.append(x)
    targets = np.array(points)[step]
    decay = np.exp(-dt / lag)
    east = targets.copy()
    for k in range(1, len(time)):
        east[k] = targets[k - 1] + (east[k - 1] - targets[k - 1]) * decay
    height = 10.0 * np.clip((time - 5.0) / 10.0, 0.0, 1.0)
    columns: dict[str, tuple[Any, str]] = {"time": (time, "s")}
    instances = {}
    n = len(starts)
    for i in range(n):
        name = f"{system}drone{i + 1}"
        columns[f"{name}.vehicle.position[1]"] = (np.zeros_like(time), "m")
        columns[f"{name}.vehicle.position[2]"] = (east[:, i], "m")
        columns[f"{name}.vehicle.position[3]"] = (-height, "m")
        columns[f"{name}.autopilot.armed"] = (time > 4.0, "")
        columns[f"{name}.agent.state"] = (np.where(step > 0, 8, 1), "")
        columns[f"{name}.agent.step"] = (step, "")
        columns[f"{name}.agent.target"] = (np.where(time > 4.0, targets[:, i], 0.0), "m")
        law = {"sysid": i + 1, "left_sysid": i, "right_sysid": (i + 2) % (n + 1), "epsilon": epsilon}
        law["stubborn"] = i in (0, n - 1)
        instances[f"{name}.agent"] = {"fmu": "LineAgent.fmu", "step": dt, "parameters": law}
    return write_run(run, columns, instances if parameters else {})


def data(axes: Any, label: str) -> tuple[np.ndarray, ...]:
    """The data of the one line of that label; three arrays in 3D."""
    lines = [line for line in axes.get_lines() if line.get_label() == label]
    assert len(lines) == 1, [line.get_label() for line in axes.get_lines()]
    line = lines[0]
    parts = line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data()
    return tuple(np.asarray(part, float) for part in parts)


def at(axes: Any, label: str, time: float) -> float:
    """Ordinate of a line just before a time: within the thinning and one step of the agent."""
    times, values = data(axes, label)
    return float(values[np.searchsorted(times, time - 0.02) - 1])


# Positions of drones 2, 3, 4 for epsilon = 1/3 from 10, 20, 50 m, by hand: the mean of oneself and both neighbours.
LAW = {1: (10, 20, 50), 2: (10, 80 / 3, 170 / 3), 3: (110 / 9, 280 / 9, 550 / 9)}
AT_9 = (21.3839, 44.8729, 71.3839)  # uav reference table: 21.4, 44.9, 71.4; largest error 5.13 m


def end_of_step(k: int) -> float:
    return FIRST + k * PERIOD


def test_positions_show_desired_and_actual_of_every_drone(tmp_path: Path) -> None:
    figure = draw_positions(read_flight(consensus_run(tmp_path)))
    (axes,) = figure.axes
    assert len(axes.get_lines()) == 10
    for k, expected in LAW.items():
        for i, value in enumerate(expected, start=2):
            assert at(axes, f"drone{i} desired", end_of_step(k)) == pytest.approx(value, abs=1e-9)
    for i, value in enumerate(AT_9, start=2):
        assert at(axes, f"drone{i} desired", end_of_step(9)) == pytest.approx(value, abs=0.02)
    # In step 2 drone 4 goes from 50 to 56.667 m with the lag: what remains after 1 s.
    times, actual = data(axes, "drone4 actual")
    inside = (times > FIRST + PERIOD + 0.05) & (times < FIRST + 2 * PERIOD - 0.05)
    expected_actual = 170 / 3 - 20 / 3 * np.exp(-(times[inside] - FIRST - PERIOD - 0.0125) / LAG)
    np.testing.assert_allclose(actual[inside], expected_actual, atol=0.15)
    for name, value in (("drone1", 0.0), ("drone5", 100.0)):
        np.testing.assert_array_equal(data(axes, f"{name} actual")[1], value)


def test_desired_positions_begin_with_the_first_step(tmp_path: Path) -> None:
    (axes,) = draw_positions(read_flight(consensus_run(tmp_path))).axes
    times, desired = data(axes, "drone3 desired")
    np.testing.assert_array_equal(np.isnan(desired), times < FIRST)


def test_desired_is_solid_actual_dashed_and_a_drone_has_one_colour_everywhere(tmp_path: Path) -> None:
    flight = read_flight(consensus_run(tmp_path))
    (axes,) = draw_positions(flight).axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    colours = []
    for i in range(1, 6):
        desired, actual = lines[f"drone{i} desired"], lines[f"drone{i} actual"]
        assert (desired.get_linestyle(), actual.get_linestyle()) == ("-", "--")
        assert desired.get_color() == actual.get_color()
        colours.append(actual.get_color())
    assert len(set(colours)) == 5
    errors, altitude, snapshots = draw_errors(flight), draw_altitude(flight), draw_snapshots(flight)
    assert errors and altitude and snapshots
    for other in (errors.axes[0], altitude.axes[0], *snapshots.axes):
        for line in other.get_lines():
            if str(line.get_label()) in ("drone2", "drone3", "drone4"):
                assert line.get_color() == colours[int(str(line.get_label())[-1]) - 1]


def test_steps_are_marked_on_the_upper_axis_when_they_begin(tmp_path: Path) -> None:
    flight = read_flight(consensus_run(tmp_path, last_step=17))
    assert list(flight.steps) == list(range(1, 19))
    assert list(flight.steps.values()) == pytest.approx([FIRST + k * PERIOD for k in range(18)], abs=0.0126)
    (axes,) = draw_positions(flight).axes
    (top,) = axes.child_axes
    assert [text.get_text() for text in top.get_xticklabels()] == [str(k) for k in range(1, 19)]
    assert list(top.get_xticks()) == list(flight.steps.values())
    assert top.get_xlabel() == "step"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time (s)", "position east (m)")


def test_of_many_steps_every_other_is_numbered(tmp_path: Path) -> None:
    (axes,) = draw_positions(read_flight(consensus_run(tmp_path, last_step=29))).axes
    labels = [text.get_text() for text in axes.child_axes[0].get_xticklabels()]
    assert labels == [str(k) for k in range(1, 31, 2)]


def test_names_stand_at_the_ends_of_their_lines(tmp_path: Path) -> None:
    figure = draw_positions(read_flight(consensus_run(tmp_path, (0, 10, 20, 50, 100), last_step=40)))
    places = {text.get_text(): text.xy[1] for text in figure.axes[0].texts}
    assert places == pytest.approx({f"drone{i}": 25 * (i - 1) for i in range(1, 6)}, abs=0.1)


def test_names_of_lines_that_end_together_are_moved_apart(tmp_path: Path) -> None:
    figure = draw_positions(read_flight(consensus_run(tmp_path, (0, 0.1, 0.2, 0.3, 100), last_step=1)))
    heights = sorted(text.xy[1] for text in figure.axes[0].texts)
    assert len(heights) == 5
    assert min(np.diff(heights)) > 3.0  # m of 110, on an axis that holds about twenty lines of text


@pytest.mark.parametrize(("last_step", "shown"), [(18, (1, 9, 17)), (6, (1, 4, 7)), (1, (1, 1, 2))])
def test_snapshots_are_taken_when_their_step_ends(tmp_path: Path, last_step: int, shown: tuple[int, ...]) -> None:
    figure = draw_snapshots(read_flight(consensus_run(tmp_path, last_step=last_step)))
    assert figure is not None
    times = [FIRST + PERIOD * min(k, last_step) for k in shown]
    titles = [axes.get_title() for axes in figure.axes]
    for title, k, time in zip(titles, shown, times, strict=True):
        assert title.startswith(f"step #{k}, t = ")
        assert float(title.split()[-2]) == pytest.approx(time, abs=0.07)


def test_snapshots_hold_positions_east_north_and_up(tmp_path: Path) -> None:
    figure = draw_snapshots(read_flight(consensus_run(tmp_path)))
    assert figure is not None
    # The law's rows k = 8 and k = 16, less what the lag leaves (0.5 % of a step).
    reached = {0: (0, 10, 20, 50, 100), 1: (0, *AT_9, 100), 2: (0, 24.363, 49.098, 74.363, 100)}
    for panel, expected in reached.items():
        axes = figure.axes[panel]
        assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == ("east (m)", "north (m)", "height (m)")
        for i, east in enumerate(expected, start=1):
            point = [float(part[0]) for part in data(axes, f"drone{i}")]
            assert point == pytest.approx([east, 0.0, 10.0], abs=0.05)
    ring = [float(data(figure.axes[1], f"drone{i} desired")[0][0]) for i in (2, 3, 4)]
    assert ring == pytest.approx(AT_9, abs=0.02)


def test_drones_at_one_place_share_a_label(tmp_path: Path) -> None:
    figure = draw_snapshots(read_flight(consensus_run(tmp_path, (0, 0, 0, 100, 100))))
    assert figure is not None
    labels = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert labels == [["1, 2, 3", "4, 5"], ["1", "2", "3", "4", "5"], ["1", "2", "3", "4", "5"]]


def test_a_shared_label_stands_above_the_highest(tmp_path: Path) -> None:
    columns: dict[str, tuple[Any, str]] = {"time": (np.zeros(1), "s")}
    for name, north, height in (("v1", 0.0, 10.0), ("v2", 0.5, 12.0), ("v3", 0.0, 11.0), ("v4", 40.0, 2.0)):
        for i, value in enumerate((north, 0.0, -height), start=1):
            columns[f"{name}.position[{i}]"] = (np.array([value]), "m")
    figure = draw_snapshots(read_flight(write_run(tmp_path, columns)))
    assert figure is not None
    for axes in figure.axes:
        found = {text.get_text(): text.get_position_3d() for text in axes.texts}
        assert list(found) == ["1, 2, 3", "4"]
        assert found["1, 2, 3"][:2] == (0.0, 0.5)
        assert 12.0 < found["1, 2, 3"][2] < 13.5


def test_many_drones_have_quantiles_and_colours_instead_of_names(tmp_path: Path) -> None:
    flight = read_flight(consensus_run(tmp_path, [3.0 * i + (i % 3) for i in range(25)], last_step=2))
    errors, snapshots, positions, seen = (
        draw_errors(flight),
        draw_snapshots(flight),
        draw_positions(flight),
        draw_map(flight),
    )
    assert errors and snapshots and seen
    point, _ = flight.law or ({}, 0.0)
    places = {drone.name: drone.position for drone in flight.drones if drone.position is not None}
    begin = flight.row(FIRST)
    known = np.array([np.abs(places[name][begin:, 1] - value) for name, value in point.items()])
    assert known.shape[0] == 23
    times, median = data(errors.axes[0], "median")
    expected = np.interp(times, flight.time[begin:], np.median(known, axis=0))
    np.testing.assert_allclose(median, expected, rtol=1e-12)
    labels = ["least to greatest", "5 to 95 %", "25 to 75 %", "median"]
    assert [text.get_text() for text in errors.legends[0].get_texts()][:4] == labels
    for figure in (positions, snapshots, seen):
        assert figure.axes[-1].get_ylabel() == "number of the drone"  # the colour bar
        assert not [text for axes in figure.axes for text in axes.texts]
    (lines,) = positions.axes[0].collections
    np.testing.assert_array_equal(
        lines.get_segments()[7][:, 1], np.interp(lines.get_segments()[7][:, 0], flight.time, places["drone8"][:, 1])
    )
    change = flight.drones[7].position
    assert change is not None and positions.axes[1].get_ylabel() == "change since step 1 (m)"
    (points,) = snapshots.axes[0].collections
    row = flight.row(end_of_step(1) - 0.02)
    np.testing.assert_allclose(points.get_offsets()[7], (places["drone8"][row, 1], 10.0), atol=1e-3)


def test_a_long_line_is_compared_with_its_places_and_folded(tmp_path: Path) -> None:
    """151 drones: two pieces of a map; snapshots show distances to even spacing by number."""
    flight = read_flight(consensus_run(tmp_path, [10.0 * i + 3.0 * (i % 3) for i in range(151)], last_step=2))
    point, _ = flight.law or ({}, 0.0)
    places = [drone.position for drone in flight.drones if drone.position is not None]
    snapshots, seen = draw_snapshots(flight), draw_map(flight, 40.0)
    assert snapshots and seen and len(places) == 151

    change = np.stack([position[:, 1] - position[flight.row(FIRST), 1] for position in places], axis=1)
    apart = change - np.median(change, axis=1, keepdims=True)
    extremes = {f"drone{1 + int(np.argmax(apart.max(axis=0)))}", f"drone{1 + int(np.argmin(apart.min(axis=0)))}"}
    assert {text.get_text() for text in draw_positions(flight).axes[1].texts} == extremes

    assert [axes.get_ylabel() for axes in snapshots.axes] == ["east of even spacing (m)", "", "", "height (m)", "", ""]
    row = flight.row(end_of_step(1) - 0.02)
    offsets = snapshots.axes[0].collections[0].get_offsets()
    np.testing.assert_allclose(offsets[7], (8, places[7][row, 1] - point["drone8"]), rtol=1e-12)
    np.testing.assert_allclose(snapshots.axes[3].collections[0].get_offsets()[7], (8, 10.0), atol=1e-3)

    pieces = seen.axes[:2]
    ends = np.array([position[-1, 1] for position in places])
    moved = ends - [position[0, 1] for position in places]
    shown: set[int] = set()
    for axes in pieces:
        (points,) = axes.collections
        low, high = axes.get_xlim()
        inside = np.flatnonzero((ends > low) & (ends < high))
        offsets = np.asarray(points.get_offsets())
        found = [int(np.argmin(np.abs(ends - x))) for x, _ in offsets if low < x < high]
        assert found == list(inside)  # none is missing in its piece
        np.testing.assert_allclose(
            np.asarray(points.get_array())[(offsets[:, 0] > low) & (offsets[:, 0] < high)], moved[inside]
        )
        shown |= set(found)
    assert shown == set(range(151))
    assert seen.axes[-1].get_ylabel() == "moved east (m)"
    said = pieces[1].get_xlabel()
    seen.canvas.draw()  # the scale that the label states is that of the picture
    (x0, y0), (x1, y1) = (pieces[0].transData.transform(at) for at in ((0.0, 0.0), (1.0, 1.0)))
    stated = float(said.removeprefix("east (m), in 2 pieces; the scale of north is ").removesuffix(" times as large"))
    assert stated == pytest.approx((y1 - y0) / (x1 - x0), rel=0.06)
    middle = ends[
        np.argmin(np.abs(ends - 0.5 * (min(p[:, 1].min() for p in places) + max(p[:, 1].max() for p in places))))
    ]
    edges = [float(line.get_xdata()[0]) for line in pieces[0].lines if line.get_linestyle() == ":"]
    assert edges == pytest.approx([middle - 40.0, middle + 40.0])


def test_a_swarm_that_moves_little_is_shown_by_its_movements(tmp_path: Path) -> None:
    """The two drones that leave the others have names; a swarm that moves far keeps its places."""
    time = np.linspace(0, 10, 50)
    columns: dict[str, tuple[Any, str]] = {"time": (time, "s")}
    for i in range(30):
        columns[f"rover{i + 1}.position[1]"] = (10.0 * (i // 6) + (3.0 if i == 16 else 0.0) * time / 10, "m")
        columns[f"rover{i + 1}.position[2]"] = (10.0 * (i % 6) - (2.0 if i == 3 else 0.0) * time / 10, "m")
        columns[f"rover{i + 1}.position[3]"] = (np.full(50, -1.5), "m")
    figure = draw_positions(read_flight(write_run(tmp_path / "little", columns)))
    north, east, height, way = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == [
        *("moved north (m)", "moved east (m)", "height (m)", "from the start (m)"),
    ]
    named = [[text.get_text() for text in axes.texts] for axes in (north, east, height, way)]
    assert named == [["rover17"], ["rover4"], [], ["rover17"]]
    assert data(north, "rover17")[1][-1] == pytest.approx(3.0) and data(east, "rover4")[1][-1] == pytest.approx(-2.0)
    assert data(north, "median")[1][-1] == 0.0

    for i in range(30):
        columns[f"rover{i + 1}.position[1]"] = (columns[f"rover{i + 1}.position[1]"][0] + 5.0 * time, "m")
    figure = draw_positions(read_flight(write_run(tmp_path / "far", columns)))
    assert [axes.get_ylabel() for axes in figure.axes[:2]] == ["north (m)", "east (m)"]


def test_a_map_shows_paths_ends_and_the_range_of_the_radio(tmp_path: Path) -> None:
    columns = {"time": (np.linspace(0, 10, 50), "s"), **rover_columns("rover"), **rover_columns("team.truck")}
    figure = draw_map(read_flight(write_run(tmp_path, columns)), reach=25.0)
    assert figure is not None
    axes = figure.axes[0]
    east, north = data(axes, "rover")
    assert (east[0], north[0], east[-1], north[-1]) == (0.0, 0.0, -10.0, 20.0)
    assert axes.get_aspect() == 1.0 and [patch.get_radius() for patch in axes.patches] == [25.0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["start", "end", "radio range of rover, 25 m"]
    boxes = [text.get_window_extent() for text in axes.texts]
    assert [text.get_text() for text in axes.texts] == ["rover", "team"] and not boxes[0].overlaps(boxes[1])
    ends = [line.get_color() for line in axes.lines if len(line.get_xdata()) == 1][1::2]
    assert [text.get_color() for text in axes.texts] == ends, "a name has the colour of its path"


def test_pdf_is_written_and_recognised_as_a_figure(tmp_path: Path) -> None:
    run = consensus_run(tmp_path, last_step=2)
    (file,) = figures(run, signals=["drone3.*[2]"], formats=("pdf",))
    assert file.read_bytes().startswith(b"%PDF-") and is_figure(file)
    (tmp_path / "mine.pdf").write_bytes(b"%PDF-1.4 mine")
    assert not is_figure(tmp_path / "mine.pdf")


@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="pdftoppm is not installed")
def test_another_program_shows_the_pdf_as_the_png(tmp_path: Path) -> None:
    run = consensus_run(tmp_path, last_step=2)
    signals, shown = {"same": ["drone3.*[2]"], "other": ["drone2.*[2]"]}, {}
    for name, patterns in signals.items():
        pdf, png = sorted(figures(run, tmp_path / name, signals=patterns, formats=("pdf", "png")))
        subprocess.run(["pdftoppm", "-r", "200", "-png", "-singlefile", pdf, pdf.with_name("seen")], check=True)
        shown[name] = [imread(file)[:, :, :3] for file in (png, pdf.with_name("seen.png"))]
    png, seen = shown["same"]
    high, wide = (min(one) for one in zip(png.shape[:2], seen.shape[:2], strict=True))
    assert wide >= 1400 and max(np.abs(np.subtract(png.shape, seen.shape))) <= 1  # 7 inches
    near, far = (np.abs(one[:high, :wide] - png[:high, :wide]).mean() for one in (seen, shown["other"][1]))
    assert near < 0.01 and near < 0.5 * far


def test_errors_are_distances_to_even_spacing_below_the_bound(tmp_path: Path) -> None:
    figure = draw_errors(read_flight(consensus_run(tmp_path, lag=0.05)))
    assert figure is not None
    (axes,) = figure.axes
    assert axes.get_yscale() == "log"
    for k, largest in {1: 30, 2: 23.3333, 3: 18.8889, 9: 5.1271, 17: 0.902}.items():
        assert at(axes, "drone3", end_of_step(k)) == pytest.approx(largest, abs=2e-3)
    assert at(axes, "drone2", end_of_step(1)) == pytest.approx(15)
    assert at(axes, "drone4", end_of_step(1)) == pytest.approx(25)
    (label,) = [str(line.get_label()) for line in axes.get_lines() if str(line.get_label()).startswith("bound")]
    times, bound = data(axes, label)
    # lambda_1 = 1 - 2/3 + 2/3 cos 45 degrees; sqrt(15^2 + 30^2 + 25^2) m at the start.
    assert bound[1:] == pytest.approx(np.sqrt(1750) * (1 / 3 + np.sqrt(2) / 3) ** np.arange(18), rel=1e-9)
    assert bound[0] == bound[1]
    assert "41.8 m" in label and "0.8047" in label
    for name in ("drone2", "drone3", "drone4"):
        own_times, error = data(axes, name)
        assert (error <= np.interp(own_times, times, bound) * 1.02).all()
    assert {str(line.get_label()) for line in axes.get_lines()} == {"drone2", "drone3", "drone4", label}


@pytest.mark.parametrize(("epsilon", "rate"), [(0.1, 0.9414), (0.25, 0.8536), (0.5, 0.7071), (0.55, 0.8778)])
def test_the_rate_is_that_of_the_law(tmp_path: Path, epsilon: float, rate: float) -> None:
    law = read_flight(consensus_run(tmp_path, epsilon=epsilon, last_step=2)).law
    assert law is not None
    assert law[1] == pytest.approx(rate, abs=5e-5)
    assert law[0] == pytest.approx({"drone2": 25.0, "drone3": 50.0, "drone4": 75.0})


def test_no_bound_is_drawn_where_the_law_does_not_converge(tmp_path: Path) -> None:
    figure = draw_errors(read_flight(consensus_run(tmp_path, epsilon=0.6, last_step=4)))
    assert figure is not None
    assert [line.get_label() for line in figure.axes[0].get_lines()] == ["drone2", "drone3", "drone4"]


def test_a_third_stubborn_drone_divides_the_line(tmp_path: Path) -> None:
    run = consensus_run(tmp_path, last_step=2)
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["instances"]["drone4.agent"]["parameters"]["stubborn"] = True
    (run / "manifest.json").write_text(json.dumps(manifest))
    law = read_flight(run).law
    assert law is not None
    end = 550 / 9  # where drone 4 was sent last
    assert law[0] == pytest.approx({"drone2": end / 3, "drone3": 2 * end / 3})


@pytest.mark.parametrize(
    ("agent", "change"),
    [
        ("drone2.agent", {"left_sysid": 99}),
        ("drone2.agent", {"epsilon": None}),
        ("all", {"stubborn": False}),
        ("all", {"stubborn": True}),
    ],
)
def test_no_errors_where_the_parameters_fix_no_point(tmp_path: Path, agent: str, change: Mapping[str, Any]) -> None:
    run = consensus_run(tmp_path, last_step=2)
    manifest = json.loads((run / "manifest.json").read_text())
    for name, instance in manifest["instances"].items():
        if agent in ("all", name):
            instance["parameters"].update(change)
            instance["parameters"] = {k: v for k, v in instance["parameters"].items() if v is not None}
    (run / "manifest.json").write_text(json.dumps(manifest))
    assert draw_errors(read_flight(run)) is None


def test_no_errors_of_agents_with_another_law(tmp_path: Path) -> None:
    """An agent of one's own may have the parameters of LineAgent, and a law that its bound says nothing about."""
    run = consensus_run(tmp_path, last_step=2)
    assert draw_errors(read_flight(run)) is not None
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["fmus"]["RingAgent.fmu"] = {"verdicts": LINE | {"target": LINE["target"] | {"neighbours": []}}}
    manifest["instances"]["drone3.agent"]["fmu"] = "RingAgent.fmu"
    (run / "manifest.json").write_text(json.dumps(manifest))
    flight = read_flight(run)
    assert draw_errors(flight) is None
    assert len(draw_positions(flight).axes[0].get_lines()) == 10
    assert [name for name, _ in drawn(run)] == ["positions", "snapshots", "map", "altitude"]


def test_an_agent_with_other_names_draws_the_same_figure(tmp_path: Path) -> None:
    """Figures know an agent and a vehicle by what their FMUs declare, whatever the variables are called."""
    names = {"sysid": "number", "left_sysid": "west", "right_sysid": "east", "epsilon": "pull", "stubborn": "rests"}
    run = consensus_run(tmp_path / "ours", last_step=6)
    table = pq.read_table(run / "signals.parquet")
    renamed = {".agent.step": ".pilot.turn", ".agent.target": ".pilot.way", ".vehicle.position": ".body.place"}
    columns = table.column_names
    for old, new in renamed.items():
        columns = [name.replace(old, new) for name in columns]
    text = (run / "manifest.json").read_text().replace(".agent", ".pilot")
    for old, new in {**names, "step": "turn", "target": "way"}.items():
        text = text.replace(f'"{old}"', f'"{new}"')
    manifest = json.loads(text.replace('"turn": "turn"', '"step": "turn"'))
    manifest["fmus"]["Body.fmu"] = {"verdicts": {"place": {"is": "Position"}}}
    manifest["instances"] |= {f"drone{i}.body": {"fmu": "Body.fmu", "parameters": {}} for i in range(1, 6)}
    other = tmp_path / "other"
    other.mkdir()
    pq.write_table(table.rename_columns(columns), other / "signals.parquet")
    (other / "manifest.json").write_text(json.dumps(manifest))
    ours, theirs = read_flight(run), read_flight(other)
    assert ours.law == theirs.law and ours.law is not None
    first, second = draw_errors(ours), draw_errors(theirs)
    assert first is not None and second is not None
    for a, b in zip(first.axes[0].get_lines(), second.axes[0].get_lines(), strict=True):
        assert a.get_label() == b.get_label()
        np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())


def test_an_fmu_that_declares_nothing_is_known_by_convention_and_its_law_is_not(tmp_path: Path) -> None:
    run = consensus_run(tmp_path, last_step=2)
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["fmus"]["LineAgent.fmu"] = {"model": "LineAgent"}
    (run / "manifest.json").write_text(json.dumps(manifest))
    flight = read_flight(run)
    assert len(draw_positions(flight).axes[0].get_lines()) == 10
    assert flight.law is None and draw_errors(flight) is None


def test_altitude_and_smallest_distance(tmp_path: Path) -> None:
    figure = draw_altitude(read_flight(consensus_run(tmp_path, (0, 10, 13, 50, 100))))
    assert figure is not None
    above, below = figure.axes
    times, height = data(above, "drone5")
    np.testing.assert_allclose(height, np.clip(times - 5, 0, 10), atol=1e-9)
    (line,) = below.get_lines()
    time, distance = (np.asarray(part, float) for part in line.get_data())
    assert distance[time < FIRST] == pytest.approx(3.0)
    assert distance[-1] == pytest.approx(24.4, abs=0.2)
    assert (above.get_ylabel(), below.get_ylabel()) == ("height (m)", "smallest distance (m)")


def test_the_smallest_distance_is_that_of_all_pairs(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    n, columns = 40, {"time": (np.arange(60) / 10, "s")}
    walks = np.cumsum(rng.normal(size=(n, 60, 3)), axis=1) * rng.uniform(0.1, 3.0, 3)
    for i in range(n):
        columns |= {f"v{i}.position[{j + 1}]": (walks[i, :, j], "m") for j in range(3)}
    figure = draw_altitude(read_flight(write_run(tmp_path, columns)))
    assert figure is not None
    (line,) = figure.axes[1].get_lines()
    pairs = [np.linalg.norm(walks[i] - walks[j], axis=1) for i in range(n) for j in range(i)]
    np.testing.assert_allclose(np.asarray(line.get_ydata(), float), np.min(pairs, axis=0), rtol=1e-12)


def test_two_drones_in_a_nested_system_and_ten_in_natural_order(tmp_path: Path) -> None:
    nested = read_flight(consensus_run(tmp_path / "a", (0, 5, 20), system="east.", last_step=1))
    assert [drone.name for drone in nested.drones] == ["east.drone1", "east.drone2", "east.drone3"]
    many = read_flight(consensus_run(tmp_path / "b", [10.0 * i for i in range(12)], last_step=2))
    assert [drone.name for drone in many.drones] == [f"drone{i}" for i in range(1, 13)]
    (axes,) = draw_positions(many).axes
    assert len({tuple(line.get_color()) for line in axes.get_lines()}) == 12


def rover_columns(name: str, n: int = 50) -> dict[str, tuple[Any, str]]:
    t = np.linspace(0, 10, n)
    places = {"position[1]": 2 * t, "position[2]": -t, "position[3]": np.full(n, -1.5)}
    return {f"{name}.{variable}": (values, "m") for variable, values in places.items()}


def test_vehicles_without_agents_have_three_axes_and_no_steps(tmp_path: Path) -> None:
    columns = {"time": (np.linspace(0, 10, 50), "s"), **rover_columns("rover"), **rover_columns("team.truck")}
    flight = read_flight(write_run(tmp_path, columns))
    assert [drone.name for drone in flight.drones] == ["rover", "team"]
    figure = draw_positions(flight)
    assert [axes.get_ylabel() for axes in figure.axes] == ["north (m)", "east (m)", "height (m)"]
    assert [float(data(axes, "rover actual")[1][-1]) for axes in figure.axes] == [20.0, -10.0, 1.5]
    snapshots = draw_snapshots(flight)
    assert snapshots is not None
    assert [axes.get_title() for axes in snapshots.axes] == ["t = 0.0 s", "t = 5.0 s", "t = 10.0 s"]
    assert [float(data(snapshots.axes[2], "rover")[i][0]) for i in range(3)] == [-10.0, 20.0, 1.5]
    for axes in snapshots.axes:
        assert axes.get_xlim() == pytest.approx((-10.0, 0.0))
        assert axes.get_ylim() == pytest.approx((0.0, 20.0))
        assert axes.get_zlim() == pytest.approx((0.0, 3.0))  # from the ground up, 3 m for 20 m north
    assert draw_errors(flight) is None
    assert [name for name, _ in drawn(tmp_path)] == ["positions", "snapshots", "map", "altitude"]


def test_several_vehicles_of_one_system_keep_their_own_names(tmp_path: Path) -> None:
    columns = {"time": (np.linspace(0, 10, 50), "s"), **rover_columns("team.a"), **rover_columns("team.b")}
    assert [drone.name for drone in read_flight(write_run(tmp_path, columns)).drones] == ["team.a", "team.b"]


def test_agents_without_recorded_vehicles_show_what_was_desired(tmp_path: Path) -> None:
    full = pq.read_table(consensus_run(tmp_path, last_step=3) / "signals.parquet")
    kept = [name for name in full.column_names if "vehicle" not in name]
    pq.write_table(full.select(kept), tmp_path / "signals.parquet")
    flight = read_flight(tmp_path)
    (axes,) = draw_positions(flight).axes
    assert [line.get_label() for line in axes.get_lines()] == [f"drone{i} desired" for i in range(1, 6)]
    assert draw_snapshots(flight) is None and draw_altitude(flight) is None and draw_errors(flight) is None


def test_a_run_that_ended_before_the_first_step(tmp_path: Path) -> None:
    full = pq.read_table(consensus_run(tmp_path, last_step=1) / "signals.parquet")
    pq.write_table(full.slice(0, 400), tmp_path / "signals.parquet")
    flight = read_flight(tmp_path)
    assert dict(flight.steps) == {}
    assert draw_errors(flight) is None
    files = figures(tmp_path, formats=["svg"])
    assert [file.stem for file in files] == ["positions", "snapshots", "map", "altitude"]


def test_one_instant_of_one_vehicle_can_be_drawn(tmp_path: Path) -> None:
    columns = {"time": (np.zeros(1), "s"), **rover_columns("rover", 1)}
    run = write_run(tmp_path, columns)
    assert [file.parent for file in figures(run)] == [run] * 8


def test_thinning_keeps_the_instants_of_steps_exact(tmp_path: Path) -> None:
    n = 100_001
    time = np.arange(n) * 0.001
    step = (time >= 33.333).astype(np.int64)
    columns = {"time": (time, "s"), "a.agent.step": (step, ""), "a.agent.target": (np.zeros(n), "m")}
    flight = read_flight(write_run(tmp_path, columns))
    assert len(flight.time) == 5000 and flight.time[-1] == 100.0
    assert dict(flight.steps) == {1: 33.333}


def test_the_first_mobile_agent_begins_the_step(tmp_path: Path) -> None:
    time = np.arange(10) * 1.0
    steps = {"one": [0, 1, 2, 3, 4, 5, 6, 7, 8, 9], "two": [0, 0, 1, 1, 2, 2, 2, 2, 2, 2], "late": [0] * 6 + [2] * 4}
    columns: dict[str, tuple[Any, str]] = {"time": (time, "s")}
    for name, values in steps.items():
        columns[f"{name}.agent.step"] = (np.array(values), "")
        columns[f"{name}.agent.target"] = (np.zeros(10), "m")
    instances = {"one.agent": {"fmu": "LineAgent.fmu", "parameters": {"stubborn": True}}}
    flight = read_flight(write_run(tmp_path, columns, instances))
    assert dict(flight.steps) == {1: 2.0, 2: 4.0}


def test_same_run_same_bytes_whatever_the_configuration(tmp_path: Path) -> None:
    run = consensus_run(tmp_path / "run", (0, 10, 50), last_step=1)
    first = figures(run, tmp_path / "new" / "a")
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red", "font.family": "serif"}):
        second = figures(run, tmp_path / "b")
    assert [file.name for file in first] == [
        f"{name}{suffix}"
        for name in ("positions", "snapshots", "map", "errors", "altitude")
        for suffix in (".png", ".svg")
    ]
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes(), a.name
        assert a.read_bytes().startswith(b"\x89PNG" if a.suffix == ".png" else b"<?xml")


def test_drawing_leaves_pyplot_alone_and_reading_leaves_matplotlib_and_pandas_alone(tmp_path: Path) -> None:
    run = consensus_run(tmp_path, (0, 10, 50), last_step=1)
    code = (
        "import sys, pathlib; from cosim_master.results.figures.draw import figures, read_flight; "
        "from cosim_master.results.reading.comparison import compare; "
        "run = pathlib.Path(sys.argv[1]); "
        "read_flight(run); assert 'matplotlib' not in sys.modules; "
        "figures(run); assert 'matplotlib.pyplot' not in sys.modules; "
        "compare(run, run); assert 'pandas' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code, str(run)], check=True)


def test_nothing_to_draw(tmp_path: Path) -> None:
    t = np.zeros(3)
    run = write_run(tmp_path, {"time": (t, "s"), "tank.level": (t, "m"), "tank.position[1]": (t, "m")})
    with pytest.raises(
        CosimError, match=r"no component has position\[1\.\.3\] in m, or step and target .* --signal '\*'` .* 2 sig"
    ):
        figures(run)


def test_positions_in_another_unit_are_not_taken_for_metres(tmp_path: Path) -> None:
    columns = {name: (values, "km") for name, (values, _) in rover_columns("rover").items()}
    with pytest.raises(CosimError, match="nothing to draw"):
        figures(write_run(tmp_path, {"time": (np.linspace(0, 10, 50), "s"), **columns}))


def test_a_run_without_rows(tmp_path: Path) -> None:
    columns = {"time": (np.zeros(0), "s"), **rover_columns("rover", 0)}
    with pytest.raises(CosimError, match="the run recorded no instant"):
        figures(write_run(tmp_path, columns))


@pytest.mark.parametrize("manifest", [None, "{", "{}"])
def test_a_run_without_its_manifest(tmp_path: Path, manifest: str | None) -> None:
    run = write_run(tmp_path, {"time": (np.zeros(2), "s"), **rover_columns("rover", 2)})
    (run / "manifest.json").unlink()
    if manifest is not None:
        (run / "manifest.json").write_text(manifest)
    with pytest.raises(
        CosimError, match=r"manifest\.json: not the manifest of a complete run|it has no manifest\.json"
    ):
        figures(run)


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(CosimError, match="not the folder of a run"):
        figures(tmp_path)


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", {"time": (np.zeros(2), "s"), **rover_columns("rover", 2)})
    with pytest.raises(CosimError, match="figures cannot be written"):
        figures(run, run / "manifest.json")


def test_without_room_the_figures_before_stay(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", {"time": (np.zeros(2), "s"), **rover_columns("rover", 2)})
    before = {file: file.read_bytes() for file in figures(run, tmp_path / "figures", formats=("svg",))}
    with room_of(100), pytest.raises(WriteFailed, match="figures cannot be written: File too large"):
        figures(run, tmp_path / "figures", formats=("svg",))
    assert before == {file: file.read_bytes() for file in (tmp_path / "figures").iterdir()} != {}


def test_violations_of_monitors_are_marked_in_figures_over_time(tmp_path: Path) -> None:
    run = consensus_run(tmp_path / "run")
    manifest = json.loads((run / "manifest.json").read_text())
    violation = {"who": ["drone3.vehicle"], "worst": 1.0, "worst at": 31.0, "cause": "too fast"}
    manifest["verdict"] = {
        "monitors": [
            {"name": "order", "count": 0, "violations": []},
            {"name": "my_limit", "count": 1, "violations": [{**violation, "begin": 30.0, "end": 32.5}]},
            {
                "name": "fence",
                "count": 2,
                "violations": [{**violation, "begin": 40.0, "end": 41.0}, {**violation, "begin": 50.0, "end": None}],
            },
        ]
    }
    (run / "manifest.json").write_text(json.dumps(manifest))
    shown = {}
    for name, figure in drawn(run):
        legends = [[text.get_text() for text in one.get_texts()] for one in figure.legends]
        spans = [[(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches] for axes in figure.axes]
        shown[name] = (["order kept", "my_limit violated", "fence violated 2 times"] in legends, spans)
    for name in ("positions", "altitude", "errors"):
        in_legend, spans = shown[name]
        assert in_legend, name
        for one in spans:
            assert one[:2] == [(30.0, 32.5), (40.0, 41.0)]
            assert one[2][0] == 50.0 and one[2][1] > 70.0
    assert not shown["snapshots"][0] and not shown["map"][0]

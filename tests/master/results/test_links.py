"""Links, their figures, and figures of any signal: literal expectations on recordings written by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.figures.draw import figures
from cosim_master.results.figures.radio import draw_latency, draw_links
from cosim_master.results.figures.signals import draw_signals, read_panels
from cosim_master.results.reading.links import Links, read_links, statistics
from tests.master.view.recordings import flying, write_packets, write_run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two packets from a (one to b and c, one lost to c), one from c to a, one on board."""
    write_run(tmp_path, flying(("a", "b", "c"), np.arange(0, 5.0, 0.5)))
    one, two, three, four = (ardupilotmega.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3) for _ in range(4))
    write_packets(
        tmp_path,
        [
            (1.0, 1.1, "a.agent", "b", one, "radio"),
            (1.0, 1.2, "a.agent", "c", one, "radio"),
            (2.0, 2.3, "a.agent", "b", two, "radio"),
            (2.0, -1.0, "a.agent", "c", two, "lost: range"),
            (3.0, 3.05, "c.agent", "a", three, "radio"),
            (4.0, 4.0, "b.agent", "b", four, "on board"),
        ],
    )
    return tmp_path


def test_links_count_packets_and_losses(run: Path) -> None:
    links = read_links(run)
    assert links.nodes == ("a", "b", "c")
    found = [
        (links.nodes[s], links.nodes[t], int(n), int(lost))
        for s, t, n, lost in zip(links.source, links.target, links.sent, links.lost, strict=True)
    ]
    assert found == [("a", "b", 2, 0), ("a", "c", 2, 1), ("c", "a", 1, 0)]
    assert links.mean.tolist() == pytest.approx([0.2, 0.2, 0.05])
    assert sorted(links.delays.tolist()) == pytest.approx([0.05, 0.1, 0.2, 0.3])


def test_losses_have_causes_and_the_worst_links_come_first(run: Path) -> None:
    links = read_links(run)
    assert {cause: counts.tolist() for cause, counts in links.causes.items()} == {"range": [0, 1, 0]}
    found = statistics(run)
    delays = [one.pop("delay") for one in found["worst"]]
    assert delays == pytest.approx([0.2, 0.2, 0.05])
    assert found == {
        "count": 3,
        "worst": [
            {"from": "a", "to": "c", "sent": 2, "delivered": 1, "lost": 1, "causes": {"range": 1}},
            {"from": "a", "to": "b", "sent": 2, "delivered": 2, "lost": 0, "causes": {}},
            {"from": "c", "to": "a", "sent": 1, "delivered": 1, "lost": 0, "causes": {}},
        ],
    }


def test_of_very_many_links_the_worst_are_listed(tmp_path: Path) -> None:
    """Node i sends one packet to each of 40 others; every packet to n7 is lost, by one of two causes."""
    write_run(tmp_path, flying(("n0", "n1"), np.arange(0, 5.0, 0.5)))
    heartbeat = ardupilotmega.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)
    ways = [(i, j) for i in range(41) for j in range(41) if i != j]
    fates = ("lost: range", "lost: channel")
    rows = [(i, -1.0, f"n{i}.x", "n7", heartbeat, fates[i % 2]) for i, j in ways if j == 7]
    rows += [(i, i + 0.5, f"n{i}.x", f"n{j}", heartbeat, "radio") for i, j in ways if j != 7]
    write_packets(tmp_path, rows)
    found = statistics(tmp_path)
    assert (found["count"], len(found["worst"])) == (41 * 40, 100)
    assert [one["from"] for one in found["worst"][:40]] == [f"n{i}" for i in range(41) if i != 7]
    assert {one["to"] for one in found["worst"][:40]} == {"n7"}
    assert [one["causes"] for one in found["worst"][:2]] == [{"range": 1}, {"channel": 1}]
    assert found["worst"][0]["delay"] is None and found["worst"][40]["delay"] == 0.5
    assert not any(one["lost"] for one in found["worst"][40:])


def test_the_matrix_has_a_cell_for_each_link(run: Path) -> None:
    figure = draw_links(read_links(run))
    assert figure is not None
    packets, lost = (np.ma.filled(axes.images[0].get_array(), np.nan) for axes in figure.axes[:2])
    np.testing.assert_array_equal(packets, [[np.nan, 2, 2], [np.nan] * 3, [1, np.nan, np.nan]])
    np.testing.assert_array_equal(lost, [[np.nan, 0, 50], [np.nan] * 3, [0, np.nan, np.nan]])
    assert [text.get_text() for text in figure.axes[1].texts] == ["0", "50", "0"]


def ring(n: int, apart: int) -> Links:
    """Each node but the last ones sends two packets to the node `apart` numbers after it, which hears one."""
    source = np.arange(n - apart)
    ones = np.ones(n - apart, np.int64)
    return Links(tuple(f"n{i}" for i in range(n)), source, source + apart, 2 * ones, ones, 0.1 * ones, np.array([0.1]))


def test_the_matrix_of_very_many_nodes_joins_neighbours() -> None:
    figure = draw_links(ring(1000, 13))
    assert figure is not None
    packets = figure.axes[0].images[0].get_array()
    assert packets.shape == (250, 250) and packets[0, 3] == 6 and packets[0, 4] == 2  # 0-13, 1-14, 2-15 | 3-16
    assert float(np.nanmax(figure.axes[1].images[0].get_array())) == 50.0
    assert [axes.get_xlabel() for axes in figure.axes[:2]] == ["receiver"] * 2


def test_links_of_very_many_nodes_to_their_neighbours_are_a_band() -> None:
    figure = draw_links(ring(1000, 2))
    assert figure is not None
    packets, lost = (np.ma.filled(axes.images[0].get_array(), np.nan) for axes in figure.axes[:2])
    assert packets.shape == (250, 5)
    np.testing.assert_array_equal(packets[:, 4], [8.0] * 249 + [4.0])  # 998 and 999 send nothing
    assert np.isnan(packets[:, :4]).all() and (lost[:, 4] == 50.0).all()
    assert figure.axes[0].images[0].get_extent() == [-2.5, 2.5, 1000.5, 0.5]
    assert figure.axes[0].get_xlabel() == "receiver - sender"


def test_latency_is_a_histogram_of_what_arrived(run: Path) -> None:
    figure = draw_latency(read_links(run))
    assert figure is not None
    bars = [patch.get_height() for patch in figure.axes[0].patches]
    assert sum(bars) == 4 and figure.axes[0].get_ylabel() == "packets, of 4"
    assert figure.legends[0].get_texts()[0].get_text() == "mean: 162.5 ms"
    (arrived,) = figure.axes[1].get_lines()
    assert list(arrived.get_ydata()) == [25.0, 50.0, 75.0, 100.0]
    assert list(arrived.get_xdata()) == sorted(1e3 * read_links(run).delays)


def test_equal_delays_are_one_bar_beside_zero() -> None:
    ones = np.ones(1, np.int64)
    links = Links(("a", "b"), 0 * ones, ones, 1234 * ones, 0 * ones, 0.02 * ones, np.full(1234, 0.02))
    figure = draw_latency(links)
    assert figure is not None
    (axes,) = figure.axes
    (bar,) = axes.patches
    assert bar.get_height() == 1234 and bar.get_x() + 0.5 * bar.get_width() == pytest.approx(20.0)
    assert axes.get_xlim()[0] == 0.0 and axes.texts[0].get_text() == "all 1,234 packets: 20 ms"


def test_without_packets_there_is_no_figure_of_the_radio(tmp_path: Path) -> None:
    run = write_run(tmp_path, flying(("a", "b"), np.arange(0, 5.0, 0.5)))
    assert [file.name for file in figures(run, formats=("svg",))] == [
        "positions.svg",
        "snapshots.svg",
        "map.svg",
        "altitude.svg",
    ]
    write_packets(run, [(1.0, 1.0, "a.x", "a", ardupilotmega.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3), "on board")])
    assert draw_links(read_links(run)) is None and draw_latency(read_links(run)) is None


def test_signals_by_pattern(run: Path) -> None:
    figure = draw_signals(read_panels(run, ["*.vehicle.position[3]", "b.vehicle.position[1]"]))
    first, second = figure.axes
    assert [line.get_label() for line in first.get_lines()] == ["a", "b", "c"]
    assert first.get_ylabel() == "m" and first.get_title(loc="left") == "*.vehicle.position[3]"
    np.testing.assert_array_equal(np.asarray(second.get_lines()[0].get_ydata()), 2.0 * np.arange(0, 5.0, 0.5))
    assert [file.name for file in figures(run, signals=["b.*[1]"], formats=("pdf",))] == ["signals.pdf"]


def test_words_of_an_enumeration_are_on_the_axis(tmp_path: Path) -> None:
    columns = {"time": (np.arange(4.0), "s"), "a.state": (np.array([1, 1, 2, 2]), ""), "a.text": (["x"] * 4, "")}
    run = write_run(tmp_path, columns, items={"a.state": {"waiting": 1, "flying": 2, "failed": 9}})
    (axes,) = draw_signals(read_panels(run, ["a.state"])).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["waiting", "flying"]
    with pytest.raises(CosimError, match=r"--signal a\.text: a\.text is text, which has no curve"):
        read_panels(run, ["a.text"])
    with pytest.raises(CosimError, match=r'--signal a\.stat: .* has no such signal; did you mean "a\.state"\?'):
        read_panels(run, ["a.stat"])


@pytest.mark.parametrize(("n", "lines", "bar"), [(60, 0, "number of the signal"), (300, 1, "")])
def test_many_signals(tmp_path: Path, n: int, lines: int, bar: str) -> None:
    time = np.linspace(0, 1, 11)
    columns = {"time": (time, "s"), **{f"d{i}.x": (i * time, "m") for i in range(n)}}
    figure = draw_signals(read_panels(write_run(tmp_path, columns), ["d*.x"]))
    assert len(figure.axes[0].get_lines()) == lines
    assert (figure.axes[-1].get_ylabel() == bar) == bool(bar)
    if lines:
        np.testing.assert_allclose(np.asarray(figure.axes[0].get_lines()[0].get_ydata()), 0.5 * (n - 1) * time)

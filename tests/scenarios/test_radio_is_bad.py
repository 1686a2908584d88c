"""Loss, latency and a drone that nobody hears."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.flights import copy_of, fly, plain_line


def with_radio(text: str, attributes: str, inside: str = "") -> str:
    changed, n = re.subn(
        r"<network ([^>]*?)\s*latency=\"[^\"]*\" seed=\"1\"/>",
        rf"<network \1 {attributes} seed='1'>{inside}</network>",
        text,
    )
    assert n == 1
    return changed


def test_a_fifth_lost_and_a_fifth_of_a_second_late_hardly_matter(fmus: Path, tmp_path: Path) -> None:
    bad = copy_of("line5", tmp_path, fmus, lambda text: with_radio(text, 'loss="0.2" latency="0.2"'))
    flight, plain = fly(bad, tmp_path / "bad"), plain_line()
    row = plain.end_of_step(17)
    assert flight.end_of_step(17) == row
    for drone in (2, 3, 4):
        assert flight.east(drone)[row] == pytest.approx(plain.east(drone)[row], abs=0.3)
    packets = flight.result.packets
    assert packets["lost"] / packets["sent"] == pytest.approx(0.2, abs=0.02)


def test_a_drone_cut_off_becomes_a_fixed_node_for_its_neighbours(fmus: Path, tmp_path: Path) -> None:
    """Cut off for ever in step #10, drone 3 stays where it was going; its neighbours spread between it and the ends.

    They hear of it last on its way there, half a metre before; left alone they would come to 25 and 75 m.
    """
    cut_at = 56.0
    outage = f'<outage node="drone3" start="{cut_at:g}"/>'
    cut = copy_of("line5", tmp_path, fmus, lambda text: with_radio(text, 'latency="0.02"', outage))
    flight = fly(cut, tmp_path / "cut", until=125.0)
    row = int((flight["time"] <= cut_at).sum()) - 1
    alone = flight["drone3.agent.target"][row]
    assert 45.0 < alone < 47.0
    assert flight.east(3)[-1] == pytest.approx(alone, abs=0.2)
    assert flight.east(2)[-1] == pytest.approx((0.0 + alone) / 2, abs=0.5)
    assert flight.east(4)[-1] == pytest.approx((alone + 100.0) / 2, abs=0.5)
    assert flight.result.packets["lost: outage"] > 0
    assert flight["drone3.agent.left_age"][-1] == pytest.approx(125.0 - cut_at, abs=0.5)


def test_one_that_is_heard_late_and_one_that_falls_silent_and_returns_are_taken_in(fmus: Path, tmp_path: Path) -> None:
    """Over a radio that loses a fifth; meanwhile, the others spread between those that they hear."""
    outages = '<outage node="drone3" start="0" stop="45"/><outage node="drone2" start="60" stop="75"/>'
    bad = copy_of("line5", tmp_path, fmus, lambda text: with_radio(text, 'loss="0.2" latency="0.02"', outages))
    flight = fly(bad, tmp_path / "bad", until=125.0)
    before = int(np.searchsorted(flight["time"], 45.0)) - 1
    assert flight.east(3)[before] == pytest.approx(20.0, abs=0.3)  # it has heard nobody
    assert flight["drone3.agent.left_age"][before] == -1.0
    silent = int(np.searchsorted(flight["time"], 75.0)) - 1
    assert flight["drone3.agent.left_age"][silent] > 14.0
    assert [flight.east(drone)[-1] for drone in range(1, 6)] == pytest.approx([0, 25, 50, 75, 100], abs=0.7)

"""Where a line settles and how fast, from terms that agents declare: against closed forms and the law itself."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.verdict import Formation, Neighbour, Role
from cosim_master.system.formation import Member, member, rate, settled

DECLARED = {
    "way": Formation("turn", "rests", (Neighbour("west", "g"), Neighbour("east", 0.5))),
    "own": Role.SYSTEM_ID,
}


def line(n: int, gain: float, *stays: int) -> list[Member]:
    """Agents 1 to n from west to east; the ends have one neighbour."""
    pairs = {i: tuple((j, gain) for j in (i - 1, i + 1) if 1 <= j <= n) for i in range(1, n + 1)}
    return [Member(i, pairs[i], i in stays) for i in pairs]


@pytest.mark.parametrize("gaps", [2, 3, 5, 9])
@pytest.mark.parametrize("gain", [0.1, 1 / 3, 0.5, 0.6])
def test_the_rate_of_a_section_is_that_of_its_eigenvalues(gaps: int, gain: float) -> None:
    """The eigenvalues are 1 - 2 gain (1 - cos(pi j / gaps)), j = 1 to gaps - 1."""
    expected = max(abs(1 - 2 * gain * (1 - np.cos(np.pi * j / gaps))) for j in range(1, gaps))
    assert rate(line(gaps + 1, gain, 1, gaps + 1)) == pytest.approx(expected, abs=1e-12)


def test_the_slowest_section_counts() -> None:
    both = rate(line(8, 1 / 3, 1, 3, 8))
    assert both == pytest.approx(1 - 2 / 3 * (1 - np.cos(np.pi / 5)), abs=1e-12)
    assert both == pytest.approx(rate(line(6, 1 / 3, 1, 6)), abs=1e-12)


def test_a_line_settles_evenly_between_those_that_stay() -> None:
    found = settled(line(6, 0.25, 1, 4, 6), {1: 0.0, 4: 30.0, 6: 50.0})
    assert found == pytest.approx({2: 10.0, 3: 20.0, 5: 40.0})


def test_gains_may_differ() -> None:
    """Three times the pull from the west: three times nearer to it."""
    members = [Member(1, (), True), Member(2, ((1, 0.3), (3, 0.1)), False), Member(3, (), True)]
    assert settled(members, {1: 0.0, 3: 40.0}) == pytest.approx({2: 10.0})
    assert rate(members) == pytest.approx(0.6)


@pytest.mark.parametrize(
    "members",
    [
        line(3, 0.3),  # nobody stays
        line(3, 0.3, 1, 2, 3),  # nobody moves
        [Member(1, (), True), Member(2, ((1, 0.3), (9, 0.3)), False)],  # no agent has the id 9
        [Member(1, (), True), Member(2, ((1, 0.3),), False), Member(2, ((1, 0.3),), False)],  # twice one id
        line(3, 0.0, 1, 3),  # nobody moves by a law without gain
    ],
)
def test_lines_that_settle_nowhere(members: list[Member]) -> None:
    assert settled(members, {i: 10.0 * i for i in range(1, 10)}) is None


def test_no_point_without_the_positions_of_those_that_stay() -> None:
    assert settled(line(3, 0.3, 1, 3), {1: 0.0}) is None
    assert settled(line(3, 0.3, 1, 3), {1: 0.0, 3: np.nan}) is None


def test_an_agent_is_known_by_what_its_fmu_declares() -> None:
    values = {"own": 7, "rests": False, "west": 6, "east": 0, "g": 0.25}
    assert member(DECLARED, values) == Member(7, ((6, 0.25),), False)
    assert member(DECLARED, values | {"east": 8, "rests": True}) == Member(7, ((6, 0.25), (8, 0.5)), True)
    for missing in values:
        assert member(DECLARED, {name: value for name, value in values.items() if name != missing}) is None
    assert member({"way": DECLARED["way"]}, values) is None
    assert member({"way": Formation("turn", "rests"), "own": Role.SYSTEM_ID}, values) is None

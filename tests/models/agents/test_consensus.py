"""The consensus law against a table, its eigenvalues and its order theorem."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_models.agents.parts.consensus import consensus_step, consensus_terms

TABLE = {
    0.50: "30 20 15 10 7.5 5 3.75 2.5 1.875 1.25 .938 .625 .469 .312 .234 .156 .117 .078",
    0.40: "30 22 17.2 13.04 10.03 7.66 5.87 4.50 3.44 2.64 2.02 1.55 1.18 .906 .694 .531 .407 .311",
    1 / 3: "30 23.33 18.89 15.19 12.22 9.84 7.91 6.37 5.13 4.12 3.32 2.67 2.15 1.73 1.39 1.12 .902 .726",
    0.30: "30 24 19.8 16.32 13.45 11.09 9.14 7.53 6.21 5.12 4.22 3.48 2.87 2.36 1.95 1.61 1.32 1.09",
    0.25: "30 25 21.25 18.13 15.47 13.20 11.27 9.62 8.21 7.01 5.98 5.11 4.36 3.72 3.18 2.71 2.31 1.97",
}
"""Largest distance to 25/50/75 m from the start 10/20/50 m, for k = 0 to 17, rounded to the digits given."""
START = (0.0, 10.0, 20.0, 50.0, 100.0)
EVEN = np.array([25.0, 50.0, 75.0])


def synchronous(x: list[float], epsilon: float) -> list[float]:
    """One step of the line with stubborn ends: all read, then all write."""
    inner = [consensus_step(x[i], x[i - 1], x[i + 1], epsilon) for i in range(1, len(x) - 1)]
    return [x[0], *inner, x[-1]]


def run(epsilon: float, steps: int, start: tuple[float, ...] = START) -> list[list[float]]:
    history = [list(start)]
    for _ in range(steps):
        history.append(synchronous(history[-1], epsilon))
    return history


@pytest.mark.parametrize("epsilon", TABLE)
def test_the_table_to_its_digits(epsilon: float) -> None:
    errors = [float(np.abs(np.array(x[1:-1]) - EVEN).max()) for x in run(epsilon, 17)]
    for error, printed in zip(errors, TABLE[epsilon].split(), strict=True):
        digits = len(printed.partition(".")[2])
        # Half a unit of the last digit, and what decides .3125 between .312 and .313.
        assert abs(error - float(printed)) <= 0.5 * 10.0**-digits + 1e-12


@pytest.mark.parametrize("epsilon", [*TABLE, 0.1, 0.2, 0.45, 0.55])
def test_every_step_against_the_closed_form(epsilon: float) -> None:
    matrix = np.diag([1.0 - 2.0 * epsilon] * 3) + np.diag([epsilon] * 2, 1) + np.diag([epsilon] * 2, -1)
    values, vectors = np.linalg.eigh(matrix)
    expected = 1.0 - 2.0 * epsilon + 2.0 * epsilon * np.cos(np.pi * np.array([3, 2, 1]) / 4.0)
    assert np.allclose(values, np.sort(expected), atol=1e-12)
    error = np.array(START[1:-1]) - EVEN
    for k, x in enumerate(run(epsilon, 40)):
        closed = EVEN + vectors @ (values**k * (vectors.T @ error))
        assert np.allclose(x[1:-1], closed, atol=1e-9)


@pytest.mark.parametrize(
    ("epsilon", "rate"),
    [(0.10, 0.9414), (0.20, 0.8828), (0.25, 0.8536), (0.30, 0.8243), (1 / 3, 0.8047), (0.40, 0.7657), (0.45, 0.7364)],
)
def test_convergence_rate(epsilon: float, rate: float) -> None:
    history = run(epsilon, 80)
    ratio = (history[80][2] - 50.0) / (history[79][2] - 50.0)
    assert ratio == pytest.approx(rate, abs=5e-5)
    assert rate == pytest.approx(1.0 - (2.0 - np.sqrt(2.0)) * epsilon, abs=5e-5)


@pytest.mark.parametrize(("epsilon", "steps"), [(0.25, 22), (0.30, 18), (1 / 3, 16), (0.40, 13), (0.50, 10)])
def test_first_step_within_a_metre(epsilon: float, steps: int) -> None:
    errors = [float(np.abs(np.array(x[1:-1]) - EVEN).max()) for x in run(epsilon, 30)]
    assert next(k for k, error in enumerate(errors) if error < 1.0) == steps


@pytest.mark.parametrize(("epsilon", "converges"), [(0.58, True), (0.59, False)])
def test_the_stability_limit(epsilon: float, converges: bool) -> None:
    """2 / (2 + sqrt 2) = 0.5858."""
    last = run(epsilon, 4000, (0.0, 10.0, 60.0, 50.0, 100.0))[-1]
    assert (float(np.abs(np.array(last[1:-1]) - EVEN).max()) < 1e-6) == converges


def test_the_second_drone_does_not_move_in_the_first_step() -> None:
    for epsilon in TABLE:
        assert run(epsilon, 1)[1][1] == pytest.approx(10.0, abs=1e-12)


sorted_lines = st.lists(st.floats(0.0, 100.0), min_size=3, max_size=9).map(sorted)


@given(start=sorted_lines, epsilon=st.floats(0.0, 0.5))
@settings(max_examples=300, deadline=None)
def test_order_is_kept_up_to_one_half(start: list[float], epsilon: float) -> None:
    x = start
    for _ in range(30):
        x = synchronous(x, epsilon)
        assert all(b - a >= -1e-9 for a, b in pairwise(x))


@given(epsilon=st.floats(0.500001, 1.0), at=st.floats(0.0, 90.0), gap=st.floats(0.01, 10.0))
@settings(max_examples=200, deadline=None)
def test_order_is_broken_above_one_half(epsilon: float, at: float, gap: float) -> None:
    """The start x[i-1] = x[i] < x[i+1] = x[i+2]: the gap becomes (1 - 2 epsilon) times itself."""
    x = synchronous([at, at, at + gap, at + gap], epsilon)
    assert x[2] - x[1] == pytest.approx((1.0 - 2.0 * epsilon) * gap, abs=1e-9)
    assert x[2] < x[1]


@given(start=sorted_lines, epsilon=st.floats(0.01, 0.5))
@settings(max_examples=100, deadline=None)
def test_values_stay_between_the_ends(start: list[float], epsilon: float) -> None:
    for x in run(epsilon, 30, tuple(start)):
        assert start[0] - 1e-9 <= min(x) and max(x) <= start[-1] + 1e-9


def over_a_radio(start: np.ndarray, epsilon: float, loss: float, alive: list[np.ndarray]) -> np.ndarray:
    """All steps of a line that holds what it heard last; `alive`: who moves and is heard in each step."""
    random, x = np.random.default_rng(4), start.copy()
    left, right = np.roll(x, 1), np.roll(x, -1)
    history = [x.copy()]
    for here in alive:
        heard_left = here & np.roll(here, 1) & (random.random(len(x)) >= loss)
        heard_right = here & np.roll(here, -1) & (random.random(len(x)) >= loss)
        left[heard_left] = np.roll(x, 1)[heard_left]
        right[heard_right] = np.roll(x, -1)[heard_right]
        for i in np.flatnonzero(here[1:-1]) + 1:
            x[i] = consensus_step(x[i], left[i], right[i], epsilon)
        left[:], right[:] = np.where(here, left, np.roll(x, 1)), np.where(here, right, np.roll(x, -1))
        history.append(x.copy())
    return np.array(history)


@pytest.mark.parametrize(("loss", "rel"), [(0.0, 1e-6), (0.2, 0.01)])
def test_a_hundred_spread_at_the_rate_of_the_slowest_mode(loss: float, rel: float) -> None:
    """Its error is sin(pi i / 99); a step multiplies it by 1 - 2 eps (1 - cos(pi / 99)).

    Positions that are p / (1 - p) steps old on average, for a loss of p, slow this down by 1 + 2 eps p / (1 - p).
    """
    n, epsilon = 100, 1.0 / 3.0
    mode = np.sin(np.pi * np.arange(n) / (n - 1.0))
    even = 10.0 * np.arange(n)
    path = over_a_radio(even + 30.0 * mode, epsilon, loss, [np.ones(n, dtype=bool)] * 600)
    sizes = np.linalg.norm(path - even, axis=1)
    rate = 2.0 * epsilon * (1.0 - np.cos(np.pi / (n - 1.0)))
    assert -np.log(sizes[-1] / sizes[100]) / 500.0 == pytest.approx(
        -np.log(1.0 - rate) / (1.0 + 2.0 * epsilon * loss / (1.0 - loss)), rel=rel
    )
    assert (np.diff(path, axis=1) > 0.0).all()  # their order
    assert path.min() >= 0.0 and path.max() <= 990.0


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_those_that_fail_or_leave_are_fixed_until_they_return_and_a_late_one_is_taken_in(loss: float) -> None:
    everybody = np.ones(9, dtype=bool)
    late, failed = everybody.copy(), everybody.copy()
    late[6], failed[[2, 4]] = False, False
    start = np.array([0.0, 3.0, 5.0, 30.0, 36.0, 38.0, 60.0, 70.0, 80.0])
    path = over_a_radio(start, 1.0 / 3.0, loss, [late] * 200 + [failed] * 200 + [everybody] * 300)
    assert path[200, [0, 6, 8]] == pytest.approx([0.0, 60.0, 80.0])
    assert path[200] == pytest.approx(np.interp(np.arange(9), [0, 6, 8], [0.0, 60.0, 80.0]), abs=0.05)
    held = path[200, [0, 2, 4, 8]]
    assert path[400] == pytest.approx(np.interp(np.arange(9), [0, 2, 4, 8], held), abs=0.05)
    assert path[700] == pytest.approx(10.0 * np.arange(9), abs=0.05)


def test_an_agent_without_a_neighbour_ignores_that_side() -> None:
    assert consensus_step(10.0, 10.0, 16.0, 0.25) == 11.5


@given(*[st.floats(-1e3, 1e3)] * 3, st.floats(0.0, 1.0))
def test_the_terms_that_agents_declare_are_the_law(own: float, left: float, right: float, epsilon: float) -> None:
    known = {"west": left, "east": right, "gain": epsilon}
    terms = consensus_terms("west", "east", "gain")
    declared = own + sum(known[str(term.gain)] * (known[term.id] - own) for term in terms)
    assert declared == pytest.approx(consensus_step(own, left, right, epsilon), rel=1e-12, abs=1e-9)

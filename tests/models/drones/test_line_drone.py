"""The law of the drone of a line: its targets are those of the consensus law, by the positions that it heard."""

from __future__ import annotations

from typing import Any

import pytest

from cosim_models.agents.kit import POSITION
from cosim_models.drones.line_drone import LineDrone, consensus


def drone(step: int = 2, east: float = 20.0, **parameters: Any) -> Any:
    """Returns the record of a drone between 4 and 9, which are 10 and 45 m east and were heard at 9.5 and 9.9 s."""
    m = LineDrone.record()
    for name, value in {"left_sysid": 4, "right_sysid": 9, "stale_time": 1.0, "epsilon": 0.25, **parameters}.items():
        m[name] = value
    m.step, m.target = step, 17.0
    m.position[:] = -1.0, east, -10.0
    m.home[:] = -3.0, 15.0, 0.0
    m.heard_id[1:3] = 9, 4
    m.heard_at[1:3] = 9.9, 9.5
    m.heard_position[1:3, 1] = 45.0, 10.0
    return m


def test_a_mobile_drone_moves_towards_its_neighbours() -> None:
    m = drone()
    assert consensus(m, 10.0, 3.0) == POSITION
    assert m.target == pytest.approx(20.0 + 0.25 * ((10.0 - 20.0) + (45.0 - 20.0)))
    assert (m.left_age, m.right_age) == pytest.approx((0.5, 0.1))
    assert m.setpoint_position[0] == -3.0  # the line on which it took off
    assert m.setpoint_position[1] == m.target


def test_the_first_step_is_the_start() -> None:
    m = drone(step=1)
    consensus(m, 10.0, 3.0)
    assert m.target == 20.0


@pytest.mark.parametrize(
    ("parameters", "t"),
    [
        ({"stubborn": True}, 10.0),
        ({"left_sysid": 3}, 10.0),  # never heard
        ({"right_sysid": 3}, 10.0),
        ({}, 11.0),  # both are stale
    ],
)
def test_it_stays(parameters: dict[str, Any], t: float) -> None:
    m = drone(**parameters)
    assert consensus(m, t, 3.0) == POSITION
    assert m.target == 17.0


def test_a_stale_neighbour_keeps_its_last_position() -> None:
    m = drone()
    consensus(m, 10.7, 3.0)
    assert m.left_age > 1.0 > m.right_age
    assert m.target == pytest.approx(23.75)


def test_a_neighbour_that_does_not_exist_has_no_term() -> None:
    m = drone(left_sysid=0)
    consensus(m, 10.0, 3.0)
    assert m.target == pytest.approx(20.0 + 0.25 * (45.0 - 20.0))
    assert m.left_age == -1.0


def test_ages_of_the_unknown() -> None:
    m = drone(left_sysid=3)
    consensus(m, 10.0, 3.0)
    assert m.left_age == -1.0

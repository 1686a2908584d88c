"""Following: ArduPilot's square root controller, the lag that follows from it, offsets, a leader that is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim_models.agents.follower import Follower, OffsetType, follow
from cosim_models.agents.parts.guard import sqrt_controller
from tests.models.agents.point_masses import PointMasses

P, BRAKING = 1.0, 1.25


class Convoy(PointMasses):
    """A leader that flies straight on, and those that follow it."""

    def __init__(self, starts: Any, velocity: tuple[float, float], **more: Any) -> None:
        super().__init__(Follower, follow, np.array(starts), speed_limit=10.0, **more)
        self.leader_velocity = velocity

    def turn(self) -> None:
        self.m.velocity[0, :2] = self.leader_velocity
        super().turn()
        h = float(self.m.period[0])
        self.m.position[0, :2] = self.led = self.led + h * np.array(self.leader_velocity)
        self.m.velocity[0, :2] = self.leader_velocity

    def run(self, seconds: float) -> Any:
        self.led = self.plane[0]
        return super().run(seconds)


@pytest.mark.parametrize(
    ("error", "speed"), [(0.0, 0.0), (1.0, 1.0), (1.25, 1.25), (2.225, 2.0), (10.0, np.sqrt(2.5 * 9.375))]
)
def test_the_square_root_controller(error: float, speed: float) -> None:
    assert sqrt_controller(error, P, BRAKING) == pytest.approx(speed)


@pytest.mark.parametrize(("speed", "lag"), [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (2.0, 2.225), (3.0, 4.225)])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_it_lags_as_far_as_it_can_brake(speed: float, lag: float, loss: float) -> None:
    """v / P below a / P, beyond v^2 / 2 a + a / 2 P^2; the way there is exponential with FOLL_POS_P."""
    convoy = Convoy([[0.0, 0.0], [-20.0, 5.0]], (0.6 * speed, 0.8 * speed), loss=loss, FOLL_OFS_X=-10.0)
    convoy.run(100.0)
    place = convoy.plane[0] + (-10.0, 0.0)
    behind = -(convoy.plane[1] - place) @ (0.6, 0.8)
    assert behind == pytest.approx(lag, abs=0.02)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_far_from_its_place_it_approaches_with_foll_pos_p(loss: float) -> None:
    convoy = Convoy([[0.0, 0.0], [-60.0, 0.0]], (0.0, 0.0), loss=loss, FOLL_OFS_X=-10.0)
    errors = -10.0 - convoy.run(20.0)[:, 1, 0]
    begins = int(np.argmax(errors < 49.5))  # with loss, the first packet may not arrive
    assert begins < 3
    assert errors[begins:] == pytest.approx(50.0 * (1.0 - 0.2 * 0.1) ** np.arange(1, 101 - begins))


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_offsets_turn_with_the_course(loss: float) -> None:
    """Course east: 10 m behind is west, 5 m to the right is south."""
    given = {"FOLL_OFS_TYPE": OffsetType.relative, "FOLL_OFS_X": -10.0, "FOLL_OFS_Y": 5.0, "FOLL_OFS_Z": -3.0}
    convoy = Convoy([[0.0, 0.0], [-20.0, -20.0]], (0.0, 1.0), lag=0.5, loss=loss, **given)
    convoy.run(100.0)
    assert convoy.plane[1] - convoy.plane[0] == pytest.approx((-5.0, -10.0 - 1.0), abs=0.1)
    assert convoy.m.position[1, 2] - convoy.m.position[0, 2] == pytest.approx(-3.0, abs=0.05)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_without_an_offset_it_keeps_that_of_the_beginning(loss: float) -> None:
    convoy = Convoy([[0.0, 0.0], [-7.0, 4.0], [3.0, -9.0]], (1.0, 0.0), lag=0.5, loss=loss)
    convoy.run(60.0)
    assert convoy.plane[1] - convoy.plane[0] == pytest.approx((-8.0, 4.0), abs=0.1)
    assert convoy.plane[2] - convoy.plane[0] == pytest.approx((2.0, -9.0), abs=0.1)


def test_a_leader_that_is_lost_is_waited_for_over_a_bad_radio() -> None:
    convoy = Convoy([[0.0, 0.0], [-10.0, 0.0]], (1.0, 0.0), lag=0.5, loss=0.2, FOLL_OFS_X=-10.0)
    convoy.run(20.0)
    assert convoy.plane[1, 0] - convoy.plane[0, 0] == pytest.approx(-11.0, abs=0.2)
    convoy.connect(np.zeros((2, 2), dtype=bool))
    convoy.run(3.0)
    assert convoy.m.place_error[1] == -1.0
    stands = convoy.plane[1]
    convoy.run(10.0)
    assert convoy.plane[1] == pytest.approx(stands, abs=0.01)
    convoy.connect(~np.eye(2, dtype=bool))
    convoy.run(60.0)
    assert convoy.plane[1, 0] - convoy.plane[0, 0] == pytest.approx(-11.0, abs=0.3)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_hundred_follow_while_some_join_fail_leave_and_return(loss: float) -> None:
    """Each has the lag of the closed form behind its own place; those that have failed stay where they are."""
    starts = np.vstack(([[0.0, 0.0]], np.random.default_rng(7).uniform(-40.0, 40.0, (100, 2))))
    hears = np.zeros((101, 101), dtype=bool)
    hears[1:, 0] = True  # each has its leader as the only neighbour, as neighbour_ids says
    ahead = np.array([*np.zeros(1), *np.linspace(-5.0, -60.0, 100)])
    convoy = Convoy(starts, (0.5, 0.0), loss=loss, hears=hears, FOLL_OFS_X=ahead, FOLL_OFS_Y=3.0)

    def behind() -> Any:
        place = convoy.plane[:1] + np.stack((ahead, np.full(101, 3.0)), axis=1)
        return (place - convoy.plane)[1:]

    convoy.alive[[1, 2]] = False  # they join later
    convoy.run(40.0)
    convoy.alive[[1, 2, 3, 4]] = True, True, False, False  # 3 fails, 4 leaves
    where = convoy.plane[[3, 4]]
    convoy.run(80.0)
    followed = np.ones(100, dtype=bool)
    followed[[2, 3]] = False
    assert behind()[followed] == pytest.approx(np.tile((0.5, 0.0), (98, 1)), abs=0.05)
    assert convoy.plane[[3, 4]] == pytest.approx(where)
    convoy.alive[3] = True  # returns
    convoy.run(100.0)
    followed[2] = True
    assert behind()[followed] == pytest.approx(np.tile((0.5, 0.0), (99, 1)), abs=0.05)


def test_one_too_far_away_is_not_followed() -> None:
    convoy = Convoy([[0.0, 0.0], [-101.0, 0.0]], (0.0, 0.0), FOLL_OFS_X=-10.0)
    convoy.run(1.0)
    assert convoy.plane[1] == pytest.approx((-101.0, 0.0))

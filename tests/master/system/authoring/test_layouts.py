"""Where drones start: closed forms of each layout, and files of poses."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.system.authoring.swarm.layouts import LAYOUTS, Pose, laid_out, poses_of_file


def plane(poses: tuple[Pose, ...]) -> list[tuple[float, float]]:
    assert all(pose.down == 0.0 and pose.name == "" for pose in poses)
    return [(pose.north, pose.east) for pose in poses]


def test_a_line_runs_east_and_a_grid_is_filled_row_by_row() -> None:
    assert plane(laid_out("line", 3, 10.0)) == [(0.0, 0.0), (0.0, 10.0), (0.0, 20.0)]
    assert plane(laid_out("grid", 5, 2.0)) == [(0.0, 0.0), (0.0, 2.0), (0.0, 4.0), (2.0, 0.0), (2.0, 2.0)]


@pytest.mark.parametrize("drones", [2, 3, 7, 100])
def test_a_ring_is_a_regular_polygon_around_the_origin(drones: int) -> None:
    points = plane(laid_out("ring", drones, 10.0))
    sides = [math.dist(a, b) for a, b in itertools.pairwise([*points, points[0]])]
    assert sides == pytest.approx([10.0] * drones)
    assert [math.hypot(*point) for point in points] == pytest.approx([5.0 / math.sin(math.pi / drones)] * drones)
    assert points[0][0] > 0.0 and points[0][1] == 0.0


def test_geese_fly_north_in_a_right_angle() -> None:
    leader, west, east, *further = plane(laid_out("v", 7, 10.0))
    step = 10.0 / math.sqrt(2.0)
    assert leader == (0.0, 0.0)
    assert east == pytest.approx((-step, step)) and west == pytest.approx((-step, -step))
    assert further[2] == pytest.approx((-3 * step, -3 * step)) and further[3] == pytest.approx((-3 * step, 3 * step))


@pytest.mark.parametrize("drones", [1, 2, 60])
def test_random_places_lie_in_their_square_apart_and_follow_from_the_seed(drones: int) -> None:
    points = plane(laid_out("random", drones, 5.0, seed=3))
    assert len(points) == drones
    assert min((math.dist(a, b) for a, b in itertools.combinations(points, 2)), default=5.0) >= 5.0
    assert max(abs(x) for point in points for x in point) <= 5.0 * math.sqrt(drones)
    assert points == plane(laid_out("random", drones, 5.0, seed=3)) != plane(laid_out("random", drones, 5.0, seed=4))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_one_drone_alone(layout: str) -> None:
    assert len(laid_out(layout, 1, 10.0)) == 1


def test_poses_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text("north, east\n1.5, -2\n3, 4e1\n", encoding="utf-8")
    assert poses_of_file(file) == (Pose(1.5, -2.0), Pose(3.0, 40.0))
    file.write_text("\ufeffname,down,east,north\nscout,-3,2,1\n", encoding="utf-8")
    assert poses_of_file(file) == (Pose(1.0, 2.0, -3.0, "scout"),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("north,east,north\n0,0,5\n", 'poses.csv:1: column "north" is there twice'),
        ("", "poses.csv:1: its columns are none; they must be north and east (m), and may be down, name"),
        ("x,y\n1,2\n", "poses.csv:1: its columns are x, y; they must be"),
        ("north,east\n", "poses.csv: has no rows: give one for each drone"),
        ("north,east\n1,2\n1\n", "poses.csv:3: has not 2 values, one for each of north, east"),
        ("north,east\n1,2,3\n", "poses.csv:2: has not 2 values"),
        ("north,east,name\n1,2,a\n3,4,\n5,6,\n7,8, a\n", 'poses.csv:5: name="a" is that of line 2, too; give each'),
        ("north,east\n1,1_0\n", 'poses.csv:2: east="1_0" must be a number in m'),
        ("north,east\n1,two\n", 'poses.csv:2: east="two" must be a number in m'),
        ("north,east\nINF,2\n", 'poses.csv:2: north="INF" must be a number in m'),
    ],
)
def test_files_that_are_wrong(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SystemDescriptionError) as caught:
        poses_of_file(file)
    assert message in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError, match=r"nowhere\.csv: cannot be read: No such file"):
        poses_of_file(tmp_path / "nowhere.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SystemDescriptionError, match="cannot be read: it is not text in UTF-8"):
        poses_of_file(tmp_path / "binary.csv")

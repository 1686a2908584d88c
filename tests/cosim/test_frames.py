"""cosim.frames against closed forms, numpy, pymavlink's mavextra and rotmat, and published distances."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pymavlink import mavextra
from pymavlink.rotmat import Matrix3

from cosim import frames
from cosim.frames import EARTH_RADIUS_ARDUPILOT, EARTH_RADIUS_MEAN

RUN = settings(deadline=None, derandomize=True)
COMPONENT = st.floats(-1.0, 1.0)
ANGLE = st.floats(-math.pi, math.pi)
PITCH = st.floats(-1.57, 1.57)
VECTOR = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
LAT = st.floats(math.radians(-80), math.radians(80))
LON = st.floats(-math.pi, math.pi, exclude_max=True)
QUATERNION = (
    st.tuples(*[COMPONENT] * 4)
    .filter(lambda q: math.hypot(*q) > 1e-3)
    .map(lambda q: tuple(component / math.hypot(*q) for component in q))
)


def matrix(q: Any) -> np.ndarray:
    """Rotation matrix of a unit quaternion, by Rodrigues' formula from its axis and angle."""
    axis = np.array(q[1:])
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        return np.eye(3)
    u = axis / length
    angle = 2.0 * math.atan2(length, q[0])
    cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def mavlink_matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    m = Matrix3()
    m.from_euler(roll, pitch, yaw)
    return np.array([[row.x, row.y, row.z] for row in (m.a, m.b, m.c)])


# -- rotation -------------------------------------------------------------------------------------------------------


@RUN
@given(QUATERNION, VECTOR)
def test_rotation_is_the_matrix(q: Any, v: Any) -> None:
    np.testing.assert_allclose(frames.rotate(q, v), matrix(q) @ v, atol=1e-10)
    np.testing.assert_allclose(frames.rotate_inverse(q, v), matrix(q).T @ v, atol=1e-10)
    np.testing.assert_allclose(frames.rotate_inverse(q, frames.rotate(q, v)), v, atol=1e-10)


@RUN
@given(QUATERNION, QUATERNION)
def test_product_is_composition(p: Any, q: Any) -> None:
    np.testing.assert_allclose(matrix(frames.multiply(p, q)), matrix(p) @ matrix(q), atol=1e-9)
    np.testing.assert_allclose(frames.multiply(q, frames.conjugate(q)), (1, 0, 0, 0), atol=1e-12)


def test_product_of_the_units() -> None:
    one, i, j, k = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    minus = tuple(-c for c in one)
    assert frames.multiply(i, i) == frames.multiply(j, j) == frames.multiply(k, k) == minus
    assert (frames.multiply(i, j), frames.multiply(j, k), frames.multiply(k, i)) == (k, i, j)
    assert frames.multiply(one, k) == k


def test_axes_of_a_turned_body() -> None:
    east = frames.quaternion_from_euler(0.0, 0.0, math.pi / 2)
    np.testing.assert_allclose(frames.rotate(east, (1.0, 0.0, 0.0)), (0, 1, 0), atol=1e-15)  # forward is east
    np.testing.assert_allclose(frames.rotate(east, (0.0, 1.0, 0.0)), (-1, 0, 0), atol=1e-15)  # right is south
    nose_up = frames.quaternion_from_euler(0.0, math.radians(30), 0.0)
    np.testing.assert_allclose(frames.rotate(nose_up, (1.0, 0.0, 0.0)), (math.sqrt(0.75), 0, -0.5), atol=1e-15)
    right_down = frames.quaternion_from_euler(math.radians(30), 0.0, 0.0)
    np.testing.assert_allclose(frames.rotate(right_down, (0.0, 1.0, 0.0)), (0, math.sqrt(0.75), 0.5), atol=1e-15)


@RUN
@given(st.tuples(*[st.floats(-1e3, 1e3)] * 4))
def test_normalize(q: Any) -> None:
    assume(math.hypot(*q) > 1e-100)
    unit = np.array(frames.normalize(q))
    assert abs(np.linalg.norm(unit) - 1.0) < 1e-15 * 4
    np.testing.assert_allclose(unit * np.linalg.norm(q), q, rtol=1e-14, atol=1e-300)


def test_normalize_without_length() -> None:
    assert all(math.isnan(c) for c in frames.normalize((0.0, 0.0, 0.0, 0.0)))


@RUN
@given(QUATERNION, st.tuples(*[st.floats(-10.0, 10.0)] * 3))
def test_derivative_is_that_of_the_exact_rotation(q: Any, w: Any) -> None:
    def after(t: float) -> np.ndarray:
        rate = math.hypot(*w)
        turned = (math.cos(0.5 * rate * t), *(0.5 * t * np.sinc(0.5 * rate * t / math.pi) * c for c in w))
        return np.array(frames.multiply(q, turned))

    h = 1e-4
    np.testing.assert_allclose(frames.derivative(q, w), (after(h) - after(-h)) / (2 * h), atol=2e-6)
    np.testing.assert_allclose(np.dot(frames.derivative(q, w), q), 0.0, atol=1e-14)  # the length stays


@RUN
@given(ANGLE, PITCH, ANGLE)
def test_euler_angles_are_pymavlinks(roll: float, pitch: float, yaw: float) -> None:
    q = frames.quaternion_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(matrix(q), mavlink_matrix(roll, pitch, yaw), atol=1e-12)
    m = Matrix3()
    m.from_euler(roll, pitch, yaw)
    theirs = np.array(m.to_euler())
    ours = np.array(frames.euler_from_quaternion(q))
    np.testing.assert_allclose(np.exp(1j * ours), np.exp(1j * theirs), atol=1e-7)


@RUN
@given(ANGLE, PITCH, ANGLE)
def test_euler_round_trip(roll: float, pitch: float, yaw: float) -> None:
    q = frames.quaternion_from_euler(roll, pitch, yaw)
    back = np.array(frames.euler_from_quaternion(q))
    assert (*frames.roll_pitch_from_quaternion(q), frames.yaw_from_quaternion(q)) == tuple(back)
    tolerance = 4e-15 / math.cos(pitch) ** 2 + 1e-14
    np.testing.assert_allclose(np.exp(1j * back), np.exp(1j * np.array([roll, pitch, yaw])), atol=tolerance)


@RUN
@given(QUATERNION)
def test_any_attitude_survives_euler_angles(q: Any) -> None:
    roll, pitch, yaw = frames.euler_from_quaternion(q)
    assert -math.pi <= roll <= math.pi and -math.pi / 2 <= pitch <= math.pi / 2 and -math.pi <= yaw <= math.pi
    np.testing.assert_allclose(matrix(frames.quaternion_from_euler(roll, pitch, yaw)), matrix(q), atol=3e-6)


@RUN
@given(ANGLE, ANGLE, st.sampled_from([-1.0, 1.0]))
def test_vertical_attitudes_have_no_roll(roll: float, yaw: float, sign: float) -> None:
    q = frames.quaternion_from_euler(roll, sign * math.pi / 2, yaw)
    angles = frames.euler_from_quaternion(q)
    assert angles[:2] == (0.0, sign * math.pi / 2)
    np.testing.assert_allclose(matrix(frames.quaternion_from_euler(*angles)), matrix(q), atol=1e-7)


@RUN
@given(st.floats(-1e6, 1e6))
def test_wrap_pi(angle: float) -> None:
    wrapped = frames.wrap_pi(angle)
    assert -math.pi <= wrapped < math.pi
    np.testing.assert_allclose((math.cos(wrapped), math.sin(wrapped)), (math.cos(angle), math.sin(angle)), atol=1e-9)
    if -math.pi <= angle < math.pi:
        assert wrapped == angle


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(math.pi, -math.pi), (-math.pi, -math.pi), (3 * math.pi / 2, -math.pi / 2), (-3 * math.pi / 2, math.pi / 2)],
)
def test_wrap_pi_at_the_ends(angle: float, expected: float) -> None:
    assert frames.wrap_pi(angle) == pytest.approx(expected, abs=1e-15)
    assert -math.pi <= frames.wrap_pi(math.nextafter(-math.pi, -4.0)) < math.pi


# -- positions ------------------------------------------------------------------------------------------------------


@given(VECTOR)
@RUN
def test_ned_and_enu(v: Any) -> None:
    to_enu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    assert np.linalg.det(to_enu) == pytest.approx(1.0)
    assert frames.enu_from_ned(v) == tuple(to_enu @ v)
    assert frames.ned_from_enu(v) == tuple(to_enu.T @ v)
    assert frames.ned_from_enu(frames.enu_from_ned(v)) == v


@RUN
@given(st.integers(-1800000000, 1800000000))
def test_deg_e7_round_trip(n: int) -> None:
    assert frames.radians_from_deg_e7(n) == pytest.approx(math.radians(n * 1e-7), abs=1e-15)
    assert frames.deg_e7(frames.radians_from_deg_e7(n)) == n


def test_deg_e7_rounds_to_nearest() -> None:
    assert frames.deg_e7(math.radians(-35.36326214)) == -353632621
    assert frames.deg_e7(math.radians(-35.36326216)) == -353632622
    assert frames.deg_e7(math.radians(149.16523745)) in (1491652374, 1491652375)
    assert frames.deg_e7(math.pi) == 1800000000


def location_distance_ne(lat1: int, lon1: int, lat2: int, lon2: int) -> tuple[float, float]:
    """ArduPilot's arithmetic on degE7 integers, with its published factor."""
    difference = (lon2 - lon1 + 1800000000) % 3600000000 - 1800000000
    scale = max(math.cos(math.radians((lat1 + lat2) / 2 * 1e-7)), 0.01)
    return (lat2 - lat1) * 0.011131884502145034, difference * 0.011131884502145034 * scale


DEG_E7 = st.tuples(st.integers(-899999999, 899999999), st.integers(-1800000000, 1799999999))


@RUN
@given(DEG_E7, DEG_E7, st.floats(-100, 9000), st.floats(-100, 9000))
def test_local_position_is_ardupilots(origin: Any, place: Any, alt: float, alt0: float) -> None:
    def radians(pair: Any) -> list[float]:
        return [math.radians(n * 1e-7) for n in pair]

    assume(abs(abs(origin[1] - place[1]) - 1800000000) > 2)  # exactly opposite: east or west, who knows
    north, east, down = frames.local_from_geodetic(*radians(place), alt, *radians(origin), alt0)
    expected = location_distance_ne(*origin, *place)
    np.testing.assert_allclose((north, east), expected, rtol=1e-9, atol=1e-5)
    assert down == alt0 - alt


@RUN
@given(LAT, LON, st.floats(-100, 9000), st.tuples(*[st.floats(-50e3, 50e3)] * 3))
def test_local_round_trip(lat0: float, lon0: float, alt0: float, position: Any) -> None:
    lat, lon, alt = frames.geodetic_from_local(*position, lat0, lon0, alt0)
    assert -math.pi <= lon < math.pi
    back = frames.local_from_geodetic(lat, lon, alt, lat0, lon0, alt0)
    np.testing.assert_allclose(back, position, atol=1e-7)


def test_local_frame_across_the_antimeridian_and_at_the_pole() -> None:
    lat0, lon0 = 0.0, math.radians(179.9999)
    _, lon, _ = frames.geodetic_from_local(0.0, 100.0, 0.0, lat0, lon0, 0.0)
    assert lon < 0.0
    _, east, _ = frames.local_from_geodetic(0.0, lon, 0.0, lat0, lon0, 0.0)
    assert east == pytest.approx(100.0, abs=1e-6)
    _, east, _ = frames.local_from_geodetic(math.pi / 2, 0.1, 0.0, math.pi / 2, 0.0, 0.0)
    assert east == pytest.approx(0.1 * EARTH_RADIUS_ARDUPILOT * 0.01)  # ArduPilot's smallest scale


def test_ardupilots_scaling_factor_is_its_radius() -> None:
    assert math.radians(1e-7) * EARTH_RADIUS_ARDUPILOT == pytest.approx(0.011131884502145034, rel=1e-15)


@RUN
@given(LAT, LON, st.floats(-500, 500), st.floats(-500, 500))
def test_local_frame_agrees_with_the_sphere_nearby(lat0: float, lon0: float, north: float, east: float) -> None:
    lat, lon, _ = frames.geodetic_from_local(north, east, 0.0, lat0, lon0, 0.0)
    distance = frames.haversine(lat0, lon0, lat, lon, EARTH_RADIUS_ARDUPILOT)
    assert distance == pytest.approx(math.hypot(north, east), abs=1e-4)


def test_haversine_of_ardupilots_metres() -> None:
    """The trap: 100 m in ArduPilot's frame are 99.889 m by haversine with the mean radius."""
    for lat0 in (0.0, math.radians(-35.363262), math.radians(47.4)):
        for north, east in ((100.0, 0.0), (0.0, 100.0), (60.0, 80.0)):
            lat, lon, _ = frames.geodetic_from_local(north, east, 0.0, lat0, 2.6, 0.0)
            assert frames.haversine(lat0, 2.6, lat, lon, EARTH_RADIUS_MEAN) == pytest.approx(99.889, abs=5e-4)
            assert frames.haversine(lat0, 2.6, lat, lon, EARTH_RADIUS_ARDUPILOT) == pytest.approx(100.0, abs=2e-5)


@RUN
@given(LAT, LON, LAT, LON)
def test_haversine_is_pymavlinks(lat1: float, lon1: float, lat2: float, lon2: float) -> None:
    theirs = mavextra.distance_lat_lon(*(math.degrees(angle) for angle in (lat1, lon1, lat2, lon2)))
    ours = frames.haversine(lat1, lon1, lat2, lon2, EARTH_RADIUS_MEAN)
    # mavextra's asin form loses half the digits for opposite places; ours does not.
    assert ours == pytest.approx(theirs, rel=1e-9, abs=0.2)
    one, two = (
        np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        for lat, lon in ((lat1, lon1), (lat2, lon2))
    )
    angle = math.atan2(float(np.linalg.norm(np.cross(one, two))), float(one @ two))
    assert ours == pytest.approx(EARTH_RADIUS_MEAN * angle, rel=1e-9, abs=1e-8 * EARTH_RADIUS_MEAN)


BNA, LAX = (36.12, -86.67), (33.94, -118.40)
LANDS_END = (50 + 3 / 60 + 59 / 3600, -(5 + 42 / 60 + 53 / 3600))
JOHN_O_GROATS = (58 + 38 / 60 + 38 / 3600, -(3 + 4 / 60 + 12 / 3600))


@pytest.mark.parametrize(
    ("place1", "place2", "radius", "distance", "precision"),
    [
        (BNA, LAX, 6372800.0, 2887259.95, 0.006),  # the example of Rosetta Code
        (LANDS_END, JOHN_O_GROATS, 6371000.0, 968.9e3, 50.0),  # the example of movable-type.co.uk
        ((0.0, 0.0), (0.0, 1.0), 6371000.0, 111194.93, 0.006),
        ((90.0, 0.0), (-90.0, 77.0), 6371000.0, math.pi * 6371000.0, 1e-6),
        ((12.0, 34.0), (12.0, 34.0), 6371000.0, 0.0, 0.0),
    ],
)
def test_published_distances(place1: Any, place2: Any, radius: float, distance: float, precision: float) -> None:
    angles = [math.radians(degrees) for degrees in (*place1, *place2)]
    assert abs(frames.haversine(*angles, radius) - distance) <= precision


@RUN
@given(LAT, LON, st.floats(-1e6, 1e6), st.sampled_from([EARTH_RADIUS_MEAN, EARTH_RADIUS_ARDUPILOT]))
def test_longitude_at_is_the_inverse_of_haversine(lat: float, lon0: float, distance: float, radius: float) -> None:
    lon = frames.longitude_at(lat, lon0, distance, radius)
    assert -math.pi <= lon < math.pi
    assert frames.haversine(lat, lon0, lat, lon, radius) == pytest.approx(abs(distance), abs=1e-6)
    if abs(distance) > 1.0:
        assert math.copysign(1.0, frames.wrap_pi(lon - lon0)) == math.copysign(1.0, distance)


def test_longitude_at_a_distance_that_the_parallel_does_not_reach() -> None:
    lat = math.radians(89.0)
    assert abs(frames.wrap_pi(frames.longitude_at(lat, 0.3, 1e6, EARTH_RADIUS_MEAN) - 0.3)) == pytest.approx(math.pi)


# -- the three ways to run ------------------------------------------------------------------------------------------


def results() -> dict[str, list[Any]]:
    """What every kernel gives for many random arguments, given as tuples and as arrays."""
    random = np.random.default_rng(5)
    found: dict[str, list[Any]] = {}

    def keep(function: Callable[..., Any], *arguments: Any) -> None:
        found.setdefault(function.__name__, []).append(function(*arguments))

    for _ in range(200):
        p, q = random.normal(size=(2, 4))
        unit = np.array(frames.normalize(q))
        v = random.normal(size=3) * 10.0
        roll, pitch, yaw = random.uniform(-1.5, 1.5, 3).tolist()
        lat, lon, lat0, lon0 = (random.uniform(-1, 1, 4) * [1.4, math.pi, 1.4, math.pi]).tolist()
        d = float(random.uniform(-1e5, 1e5))
        for convert in (lambda a: a, lambda a: tuple(a.tolist())):
            keep(frames.multiply, convert(p), convert(q))
            keep(frames.conjugate, convert(q))
            keep(frames.normalize, convert(q))
            keep(frames.derivative, convert(q), convert(v))
            keep(frames.rotate, convert(unit), convert(v))
            keep(frames.rotate_inverse, convert(unit), convert(v))
            keep(frames.euler_from_quaternion, convert(unit))
            keep(frames.roll_pitch_from_quaternion, convert(unit))
            keep(frames.yaw_from_quaternion, convert(unit))
            keep(frames.enu_from_ned, convert(v))
            keep(frames.ned_from_enu, convert(v))
        keep(frames.quaternion_from_euler, roll, pitch, yaw)
        keep(frames.wrap_pi, d)
        keep(frames.deg_e7, lon)
        keep(frames.radians_from_deg_e7, int(lon * 5e8))
        keep(frames.local_from_geodetic, lat, lon, d, lat0, lon0, 1.0)
        keep(frames.geodetic_from_local, d, -d, d, lat0, lon0, 1.0)
        keep(frames.haversine, lat, lon, lat0, lon0, EARTH_RADIUS_MEAN)
        keep(frames.longitude_at, lat, lon, d, EARTH_RADIUS_MEAN)
    return found


def digest() -> str:
    """A digest of every bit of results()."""
    values = [[np.float64(x).tobytes() for r in rows for x in np.atleast_1d(r)] for rows in results().values()]
    return hashlib.sha256(repr(values).encode()).hexdigest()


def test_every_kernel_is_compiled() -> None:
    numba = pytest.importorskip("numba")
    if numba.config.DISABLE_JIT:
        pytest.skip("NUMBA_DISABLE_JIT is set")
    called = results()
    kernels = [name for name in frames.__all__ if name.islower()]
    assert sorted(called) == sorted(kernels)
    for name in kernels:
        assert getattr(frames, name).nopython_signatures, name

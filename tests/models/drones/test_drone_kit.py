"""A drone in one FMU: what it sends, read by pymavlink, and its motion, compared with closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model, Parameter, kernel
from cosim_models.agents.kit import ACCELERATION, NOTHING_NEW, POSITION, VELOCITY, Task, Trouble
from cosim_models.drones.kit import ERRORS, drone_kernels, drone_variables
from tests.models.shipped_kernels import part

LATITUDE, LONGITUDE, ALTITUDE = -35.363262, 149.165237, 584.0
METRES_PER_DEGREE = 0.011131884502145034e7
"""ArduPilot's LOCATION_SCALING_FACTOR."""
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


@kernel
def law(m: Any, t: float, h: float) -> int:
    """Returns what the parameter says; all set-points are `way`, the position relative to where it is."""
    for i in range(3):
        m.setpoint_position[i] = m.position[i] + m.way[i]
        m.setpoint_velocity[i] = m.way[i]
        m.setpoint_acceleration[i] = m.way[i]
    return m.returns if m.step == 1 else m.later


class Drone4(Model):
    """A drone with a table for four."""

    step_size = 0.0125
    variables = (
        *drone_variables(4),
        Parameter("way", shape=3, start=0.0),
        Parameter("returns", type=int, start=POSITION),
        Parameter("later", type=int, start=NOTHING_NEW),
    )
    kernels = drone_kernels(law)
    errors = ERRORS


START, ADVANCE = Drone4.kernels


class Drone:
    """A drone's record on its own clock."""

    def __init__(self, step: float = 0.0125, **parameters: Any) -> None:
        self.m, self.step, self.k = Drone4.record(), step, 0
        for name, value in {"position_start": (3.0, -7.0, 0.0), "sysid": 5, **parameters}.items():
            self.m[name] = value
        assert START(self.m) == 0
        self.parser = mavlink.MAVLink(None)
        memory = self.m.base.view(np.ndarray)
        self._bare = memory.view(np.dtype((np.void, memory.dtype)))[0]  # numba asks a record for its type by its names
        names = ("position", "velocity", "mavlink_rx", "mavlink_tx")
        self.position, self.velocity, self._rx, self._tx = (part(self.m, name) for name in names)
        self._given, self._sent = (part(self.m, f"mavlink_{way}_len") for way in ("rx", "tx"))

    @property
    def t(self) -> float:
        return self.k * self.step

    @property
    def up(self) -> float:
        return float(-self.position[2])

    def __call__(self, *packets: bytes, code: int = 0) -> list[Any]:
        """Makes one step with these packets; returns what it sends."""
        data = b"".join(packets)
        self._rx[: len(data)] = np.frombuffer(data, dtype=np.uint8)
        self._given[0] = len(data)
        assert ADVANCE(self._bare, self.t, self.step) == code
        self.k += 1
        used = self._sent[0]
        return self.parser.parse_buffer(self._tx[:used].tobytes()) or [] if used else []

    def until(self, stop: float, done: Callable[[], bool] = lambda: False) -> list[Any]:
        """Steps to a time, or until something is done; returns all messages."""
        sent = []
        while self.t < stop - 1e-9 and not done():
            sent += self()
        return sent


def flying(step: float, **parameters: Any) -> Drone:
    """Returns a drone at its altitude, whose law was just called for the first time."""
    drone = Drone(step, first_step_time=25.0, **parameters)
    drone.until(25.0)
    assert drone.m.state == Task.ready and drone.up == pytest.approx(10.0, abs=1e-4)
    drone()
    assert drone.m.state == Task.flying and drone.m.step == 1
    return drone


def test_it_arms_takes_off_and_says_so() -> None:
    drone = Drone()
    states = {}
    state, sent = part(drone.m, "state"), []
    for _ in range(round(12.0 / 0.0125)):
        states.setdefault(int(state[0]), drone.t)
        sent += drone()
    assert [*states] == [Task.waiting, Task.arming, Task.takeoff, Task.ready]
    assert states[Task.arming] == pytest.approx(2.0 + 0.0125)  # the estimate is ready; the next step begins so
    assert states[Task.takeoff] == pytest.approx(4.0 + 0.0125)  # ArduCopter's delay
    assert drone.up == pytest.approx(10.0, abs=0.05)

    beats = [m for m in sent if m.get_type() == "HEARTBEAT"]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in beats} == {(5, mavlink.MAV_COMP_ID_AUTOPILOT1)}
    assert {(m.type, m.autopilot, m.custom_mode) for m in beats} == {
        (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.COPTER_MODE_GUIDED)
    }
    activity = [(bool(m.base_mode & ARMED), m.system_status) for m in beats]
    standby, active = mavlink.MAV_STATE_STANDBY, mavlink.MAV_STATE_ACTIVE
    assert list(dict.fromkeys(activity)) == [(False, standby), (True, standby), (True, active)]
    assert 12 <= len(beats) <= 12 + 3  # one a second, and the changes


def test_it_climbs_within_the_limits_of_the_guidance() -> None:
    drone, speeds = Drone(), []
    state = part(drone.m, "state")
    while state[0] < Task.ready:
        drone()
        speeds.append(-float(drone.velocity[2]))
    assert max(speeds) == pytest.approx(2.5, abs=0.01)  # WPNAV_SPEED_UP
    assert np.diff(speeds).max() == pytest.approx(1.0 * 0.0125, rel=1e-6)  # WPNAV_ACCEL_Z


def test_its_positions_are_those_that_pymavlink_reads() -> None:
    drone = flying(0.0125, way=(30.0, -40.0, -2.0), position_rate=4.0)
    before = drone.t
    sent = [(drone.t, m, drone.m.copy()) for _ in range(240) for m in drone() if m.get_type() == "GLOBAL_POSITION_INT"]
    assert len(sent) == 4 * 3
    assert np.diff([t for t, _, _ in sent]) == pytest.approx(0.25)
    assert sent[0][0] - before <= 0.25 + 0.0125
    for t, message, m in sent:
        at = m.position - m.velocity * 0.0125  # the step has moved it since, up to its acceleration
        latitude = LATITUDE + at[0] / METRES_PER_DEGREE
        scale = math.cos(math.radians(0.5 * (latitude + LATITUDE)))
        assert message.time_boot_ms == pytest.approx(1e3 * (t - 0.0125), abs=0.51)
        assert message.lat * 1e-7 == pytest.approx(latitude, abs=1e-7)
        assert message.lon * 1e-7 == pytest.approx(LONGITUDE + at[1] / (METRES_PER_DEGREE * scale), abs=1e-7)
        assert message.alt == pytest.approx(1e3 * (ALTITUDE - at[2]), abs=2.0)
        assert message.relative_alt == pytest.approx(-1e3 * at[2], abs=2.0)
        speed = (message.vx, message.vy, message.vz)
        assert speed == pytest.approx(tuple(1e2 * m.velocity), abs=1.0 + 1e2 * 2.6 * 0.0125)


def test_a_position_is_answered_as_by_a_system_of_second_order() -> None:
    """x'' = 2 (1 (1 - x) - x'): x(t) = 1 - exp(-t) (cos t + sin t)."""
    h = 0.001
    drone = flying(h, way=(0.6, -0.8, 0.0))
    began = drone.t - h
    times, ways = np.empty(4000), np.empty((4000, 2))
    for i, way in enumerate(ways):
        drone()
        times[i] = drone.t - began
        way[:] = drone.position[:2]
    x = 1.0 - np.exp(-times) * (np.cos(times) + np.sin(times))
    assert np.abs(ways - (3.0, -7.0) - np.outer(x, (0.6, -0.8))).max() <= 1e-3
    assert drone.up == pytest.approx(10.0, abs=1e-4)


def test_a_velocity_is_approached_like_a_system_of_first_order() -> None:
    """With steps of h, the rest of the way to a velocity v is v (1 - 2 h)^n."""
    h = 0.0125
    drone = flying(h, way=(0.6, 0.8, 0.0), returns=VELOCITY)
    for n in range(2, 100):
        drone()
        left = (1.0 - 2.0 * h) ** n
        assert drone.velocity[0] == pytest.approx(0.6 * (1.0 - left), rel=1e-9)
        assert drone.velocity[1] == pytest.approx(0.8 * (1.0 - left), rel=1e-9)


@pytest.mark.parametrize(("asked", "gets"), [(0.5, 0.5), (4.0, 2.5)])
def test_an_acceleration_is_kept_up_to_the_limit(asked: float, gets: float) -> None:
    h = 0.0125
    drone = flying(h, way=(0.0, asked, 0.0), returns=ACCELERATION)
    for n in range(2, 100):
        drone()
        assert drone.velocity[1] == pytest.approx(n * h * gets, rel=1e-9)
        assert drone.position[1] + 7.0 == pytest.approx(0.5 * gets * (n * h) ** 2, rel=1e-9)


def test_set_points_hold_until_the_law_gives_new_ones() -> None:
    """The law sets positions 5 m ahead of where it is each time, but says once only that they hold."""
    drone = flying(0.0125, way=(5.0, 0.0, 0.0))
    drone.until(45.0)
    assert drone.m.step == 100
    assert drone.m.position[0] == pytest.approx(8.0, abs=1e-3)
    again = flying(0.0125, way=(5.0, 0.0, 0.0), later=POSITION)
    again.until(45.0)
    assert again.m.position[0] > 30.0


def test_it_lands_where_it_is_and_disarms() -> None:
    drone = flying(0.0125, way=(0.0, 2.0, 0.0), returns=VELOCITY, land_time=30.0)
    drone.until(30.0)
    sent = drone.until(80.0, lambda: drone.m.state == Task.landed)
    east = float(drone.m.position[1])
    sent += drone.until(drone.t + 2.0)
    assert drone.m.on_ground and not drone.m.armed
    assert drone.m.position == pytest.approx((3.0, east, 0.0), abs=1e-6)
    assert drone.m.velocity == pytest.approx((0.0, 0.0, 0.0))
    # from 10 m at LAND_SPEED, 0.5 m/s
    assert drone.m.state_since - 30.0 == pytest.approx(10.0 / 0.5, abs=1.0)
    beats = [m for m in sent if m.get_type() == "HEARTBEAT"]
    assert {m.custom_mode for m in beats} == {mavlink.COPTER_MODE_LAND}
    assert not beats[-1].base_mode & ARMED


def test_a_drone_that_cannot_climb_gives_up() -> None:
    drone = Drone(WPNAV_SPEED_UP=0.0, timeout=10.0)
    drone.until(20.0)
    assert drone.m.state == Task.failed and drone.m.failure == Trouble.not_at_altitude
    assert drone.m.state_since == pytest.approx(4.0 + 10.0, abs=0.0126)


def test_a_drone_that_does_not_come_down_in_time_gives_up_and_hovers() -> None:
    drone = flying(0.0125, land_time=30.0, timeout=10.0)
    drone.until(60.0)
    assert drone.m.state == Task.failed and drone.m.failure == Trouble.not_landed
    assert drone.m.state_since == pytest.approx(40.0, abs=0.0126)
    assert drone.m.armed and 3.0 < drone.up < 7.0
    assert drone.m.velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_steps_that_are_too_long_are_an_error() -> None:
    """PSC_VELZ_P is 5 /s: velocities oscillate from steps of 0.4 s on."""
    Drone(0.39, period=0.4)()
    Drone(0.4, period=0.4)(code=9)


def test_start_values_of_what_does_not_exist_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^perod: no parameter of the agent kit or its guard$"):
        drone_variables(perod=1.0)


@pytest.mark.parametrize("long", [True, False])
def test_commands_to_it_are_declined_and_others_ignored(long: bool) -> None:
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def command(system: int, component: int) -> bytes:
        arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
        if long:
            message = mavlink.MAVLink_command_long_message(system, component, arm, 0, 1, 0, 0, 0, 0, 0, 0)
        else:
            message = mavlink.MAVLink_command_int_message(system, component, 0, arm, 0, 0, 1, 0, 0, 0, 0, 0, 0)
        return bytes(message.pack(station))

    drone = Drone()
    drone()
    for component in (0, 1):
        (answer,) = drone(command(5, component))
        assert answer.get_type() == "COMMAND_ACK"
        assert (answer.command, answer.result) == (
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
            mavlink.MAV_RESULT_UNSUPPORTED,
        )
        assert (answer.target_system, answer.target_component) == (255, 190)
    assert drone(command(6, 1)) == []
    assert drone(command(5, 191)) == []
    assert not drone.m.armed


def test_neighbours_are_those_of_the_agent_kit() -> None:
    """Positions of autopilots in the air are entered, its own and those of other components are not."""
    drone = flying(0.0125)

    def position(system: int, component: int, north: float, up: float) -> bytes:
        link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        latitude = round(1e7 * (LATITUDE + north / METRES_PER_DEGREE))
        of = (0, latitude, round(1e7 * LONGITUDE), round(1e3 * (ALTITUDE + up)), round(1e3 * up), 100, -50, 0, 0)
        return bytes(mavlink.MAVLink_global_position_int_message(*of).pack(link))

    packets = (
        position(9, 1, 20.0, 9.0),
        position(5, 1, 50.0, 9.0),
        position(8, 191, 5.0, 9.0),
        position(7, 1, 4.0, 0.2),
    )
    drone(*packets)
    drone.until(drone.t + 0.2)
    assert drone.m.neighbours == 1 and drone.m.near_id[0] == 9
    age = float(drone.m.near_age[0])
    assert 0.0 < age <= 0.2
    assert drone.m.near_position[0] == pytest.approx((20.0 + age, -0.5 * age, -9.0), abs=0.02)


@pytest.mark.parametrize(
    ("code", "parameters"),
    [
        (1, {"sysid": 0}),
        (1, {"sysid": 256}),
        (2, {"period": 0.0}),
        (2, {"position_rate": 0.0}),
        (2, {"altitude": 0.0}),
        (2, {"timeout": 0.0}),
        (3, {"position_start": (0.0, 0.0, 1.0)}),
        (5, {"fence_corners": 2}),
        (6, {"guard_separation": 5.0, "period": 3.0}),
        (7, {"PSC_POSXY_P": 0.0}),
        (7, {"WPNAV_ACCEL_Z": 0.0}),
    ],
)
def test_parameters_that_are_refused(code: int, parameters: dict[str, Any]) -> None:
    m = Drone4.record()
    for name, value in parameters.items():
        m[name] = value
    assert START(m) == code
    assert code in ERRORS


@pytest.mark.parametrize(("returns", "code"), [(8, 4), (-7, 7)])
def test_results_of_a_law_that_are_errors(returns: int, code: int) -> None:
    drone = Drone(first_step_time=15.0, returns=returns)
    drone.until(15.0)
    drone(code=code)


def test_a_period_below_the_step_is_an_error() -> None:
    Drone(step=0.05, period=0.05)()
    Drone(step=0.05, period=0.04)(code=99)
    assert ERRORS[99].startswith("period is less than the step")


def test_a_set_point_that_is_no_number_is_an_error() -> None:
    drone = Drone(first_step_time=15.0, returns=ACCELERATION, way=(math.nan, 0.0, 0.0))
    drone.until(15.0)
    drone(code=8)


def test_it_stands_where_it_starts_also_on_a_roof() -> None:
    drone = Drone(position_start=(0.0, 0.0, -4.0), estimate_ready_time=5.0)
    drone.until(5.0)
    assert drone.m.position == pytest.approx((0.0, 0.0, -4.0)) and drone.m.on_ground
    drone.until(20.0)
    assert drone.up == pytest.approx(14.0, abs=0.01)  # 10 m above home

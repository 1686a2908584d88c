"""The wind of SIM_WIND_*: from the parameters of a ground station to the air about the vehicle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import Copter, preset


class BlownCopter(Copter):
    """A copter whose autopilot and vehicle are connected by `added_wind` and `adds_wind`."""

    def _connect(self) -> None:
        super()._connect()
        self.v["added_wind"][:] = self.m["added_wind"]
        self.m["adds_wind"] = self.v["adds_wind"]


def put(copter: Copter, **values: float) -> None:
    """PARAM_SET of each, in one step."""
    for name, value in values.items():
        copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32))
    copter.tick()


def hovering(height: float = 20.0, **vehicle: float) -> Copter:
    copter = BlownCopter(vehicle=vehicle).in_the_air(height, height + 5.0)
    copter.heard.clear()
    return copter


def texts(copter: Copter) -> list[str]:
    return [m.text for m in copter.messages("STATUSTEXT")]


def test_wind_follows_speed_direction_and_root_of_the_height() -> None:
    """A low-pass with the corner 1/SIM_WIND_TC in Hz; at 20 m, the root of a third of the speed at 60 m."""
    copter = hovering(20.0)
    put(copter, SIM_WIND_DIR=90.0)
    copter.run(8.0)
    put(copter, SIM_WIND_SPD=6.0)
    copter.run(0.2)
    for seconds in (0.5, 1.0, 4.0):
        begin = copter.time
        before = -float(copter.m["added_wind"][1]) / math.sqrt(-copter.v["position"][2] / 60.0)
        copter.run(seconds)
        left = math.exp(-(copter.time - begin) * 2.0 * math.pi / 5.0)
        root = math.sqrt(-copter.v["position"][2] / 60.0)
        assert -copter.m["added_wind"][1] == pytest.approx(root * (6.0 - (6.0 - before) * left), rel=0.01)
        assert copter.m["added_wind"][0] == pytest.approx(0.0, abs=0.01)
    assert copter.m["added_wind"][2] == 0.0
    np.testing.assert_allclose(copter.v["added_wind"], copter.m["added_wind"], atol=1e-4)  # of the step before


@pytest.mark.parametrize(
    ("profile", "speed"), [(0, 8.0 * math.sqrt(20.0 / 40.0)), (1, 8.0), (2, 8.0 + (20.0 - 40.0) * 0.25)]
)
def test_profiles_over_the_height(profile: int, speed: float) -> None:
    copter = hovering(20.0)
    put(copter, SIM_WIND_T=profile, SIM_WIND_T_ALT=40.0, SIM_WIND_T_COEF=0.25, SIM_WIND_TC=0.0, SIM_WIND_SPD=8.0)
    copter.run(10.0)
    assert copter.m["added_wind"][0] == pytest.approx(speed, rel=0.02)


def test_rising_wind_blows_up() -> None:
    copter = hovering(20.0)
    put(copter, SIM_WIND_T=1, SIM_WIND_TC=0.0, SIM_WIND_DIR_Z=30.0, SIM_WIND_SPD=4.0)
    copter.run(3.0)
    expected = (4.0 * math.cos(math.radians(30.0)), 0.0, -2.0)
    np.testing.assert_allclose(copter.m["added_wind"], expected, atol=1e-3)


def test_it_leans_against_the_wind_as_the_real_one_did() -> None:
    """ArduCopter's own physics at 20 m, 8 m/s from the east: 0.50 m west after 3 s at 11.5 degrees; 10.5 in the end.

    While the wind turned from south to east, it was 0.17 m north after 1.5 s, leaning by 3.1 degrees.
    """
    copter = BlownCopter(vehicle=preset("ardupilot_sitl_quad"), direct=True).in_the_air(20.0, 22.0)
    place = copter.v["position"].copy()
    put(copter, SIM_WIND_SPD=8.0, SIM_WIND_DIR=90.0)
    copter.run(1.5)
    assert copter.v["position"][0] - place[0] == pytest.approx(0.17, abs=0.06)
    assert math.degrees(2.0 * copter.v["attitude"][2]) == pytest.approx(3.0, abs=0.4)
    copter.run(1.5)
    assert copter.v["position"][1] - place[1] == pytest.approx(-0.50, abs=0.06)
    assert math.degrees(2.0 * copter.v["attitude"][1]) == pytest.approx(11.5, abs=0.3)
    copter.run(9.0)
    assert np.abs(copter.v["position"] - place).max() < 0.05
    assert math.degrees(2.0 * copter.v["attitude"][1]) == pytest.approx(10.5, abs=0.2)


def test_turbulence_has_its_deviation_and_ends_on_the_ground() -> None:
    """Down, the standard deviation is SIM_WIND_TURB, and correlated by ArduPilot's filter: 0.98 at 1200 Hz."""
    copter = hovering(20.0)
    put(copter, SIM_WIND_TURB=2.0)
    seen = []
    for _ in range(24000):
        copter.tick()
        seen.append(copter.m["added_wind"].copy())
    air = np.array(seen)[400:]
    assert air[:, 2].std() == pytest.approx(2.0, rel=0.12)
    down = air[:, 2] - air[:, 2].mean()
    assert (down[1:] * down[:-1]).mean() / down.var() == pytest.approx(0.98**3, abs=0.01)
    across = np.hypot(air[:, 0], air[:, 1])
    assert np.sqrt((across**2).mean()) == pytest.approx(2.0 / math.sqrt(3.0), rel=0.12)
    assert abs((air[1:, 0] * air[:-1, 0]).mean()) < 0.05 * air[:, 0].var()  # each step has its own direction
    ground = BlownCopter()
    ground.run(1.0)
    put(ground, SIM_WIND_TURB=2.0)
    ground.run(1.0)
    np.testing.assert_array_equal(ground.m["added_wind"], 0.0)


def test_two_systems_feel_different_turbulence_and_each_repeats() -> None:
    def felt(system: int) -> list[float]:
        copter = BlownCopter(system=system, vehicle={"position_start[3]": -5.0}, autopilot={"SIM_WIND_TURB": 3.0})
        copter.tick()
        copter.m["on_ground"] = False
        copter.run(0.2)
        return [float(x) for x in copter.m["wind_turbulence"]]

    assert felt(1) == felt(1)
    assert felt(1) != felt(2)


def test_wind_that_ceased_leaves_no_trace() -> None:
    copter = hovering(5.0)
    put(copter, SIM_WIND_SPD=3.0, SIM_WIND_DIR=0.0)
    copter.run(3.0)
    assert copter.m["sim_on"]
    put(copter, SIM_WIND_SPD=0.0)
    copter.run(9.0)
    assert not copter.m["sim_on"]
    np.testing.assert_array_equal(copter.m["added_wind"], 0.0)


def test_wind_that_does_not_reach_the_vehicle_is_refused_with_a_text() -> None:
    copter = Copter()
    copter.run(1.0)
    copter.heard.clear()
    put(copter, SIM_WIND_SPD=5.0)
    copter.run(0.2)
    assert [(v.param_id, v.param_value) for v in copter.messages("PARAM_VALUE")] == [("SIM_WIND_SPD", 0.0)]
    assert texts(copter) == ["Param write denied (SIM_WIND_SPD)", "SIM_WIND: added_wind is not connected"]
    assert copter.m["SIM_WIND_SPD"] == 0.0


def test_wind_set_at_the_start_that_does_not_reach_the_vehicle_is_told_once() -> None:
    copter = Copter(autopilot={"SIM_WIND_SPD": 5.0})
    copter.run(3.0)
    assert texts(copter).count("SIM_WIND: added_wind is not connected") == 1
    assert not copter.m["sim_on"]
    np.testing.assert_array_equal(copter.m["added_wind"], 0.0)

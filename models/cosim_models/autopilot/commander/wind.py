"""The wind of ArduPilot's simulator: SIM_WIND_* become the output `added_wind`, which the vehicle adds to its own wind.

The autopilot does not use it. It changes with the time constant SIM_WIND_TC and with the height above the local origin
(SIM_WIND_T). In the air, turbulence is added: a number that is filtered and has the standard deviation SIM_WIND_TURB,
into a direction that is drawn in each step, and one down. The filter has the time constant of ArduPilot's; as its
simulator draws a direction 1,200 times a second, ours is weaker by the root of the ratio of the steps, so that slow
motions get as much of it. Kernels over the autopilot's record `m`.

Source: ArduPilot, SITL_State (wind) and SITL::Aircraft::update_wind.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim.random_numbers import normal_pair
from cosim_models.autopilot.link.statustext import NO_NUMBER, WARNING, WIND_UNCONNECTED, say

__all__ = ["blow", "start_wind", "watch_wind", "wind_is_on"]

_FRAMES = 1200.0  # Hz, of ArduPilot's simulator
_KEPT = 0.98  # of the turbulence in one of its frames
_SCALE = 10.0 * (1.0 - _KEPT) / math.sqrt(1.0 - _KEPT * _KEPT)  # standard deviation over SIM_WIND_TURB
_LEAST_TIME = 0.1  # s
_CALM = 1e-3  # m/s, at which wind that is no longer asked for ends
_SAME = 1e-2  # deg
_SQRT, _LINEAR = 0, 2  # SIM_WIND_T
_KEY = 0x57494E44  # of the random numbers


@kernel
def _turn(angle: float) -> float:
    """Returns an angle [deg] between -180 and 180."""
    return angle - 360.0 * math.floor((angle + 180.0) / 360.0)


@kernel
def _is_asked(m: Any) -> bool:
    return bool(m.SIM_WIND_SPD != 0.0 or m.SIM_WIND_TURB != 0.0)


@kernel
def wind_is_on(m: Any) -> bool:
    """Returns whether wind is asked for, has not ceased, or does not blow from where it will."""
    if not m.adds_wind:
        return False
    turns = abs(_turn(m.SIM_WIND_DIR - m.wind_from)) > _SAME or abs(m.SIM_WIND_DIR_Z - m.wind_rise) > _SAME
    return bool(_is_asked(m) or m.wind_speed != 0.0 or m.wind_turbulence[0] != 0.0 or turns)


@kernel
def start_wind(m: Any) -> None:
    """Begins with the direction of the parameters, calm."""
    m.wind_from, m.wind_rise = m.SIM_WIND_DIR, m.SIM_WIND_DIR_Z


@kernel
def watch_wind(m: Any) -> None:
    """Tells once that wind is asked for which does not reach the vehicle."""
    if not m.wind_told and not m.adds_wind and _is_asked(m):
        m.wind_told = True
        say(m, WARNING, WIND_UNCONNECTED, NO_NUMBER)


@kernel
def _change(m: Any, h: float) -> None:
    """Lets speed and direction follow the parameters."""
    share = h / (h + max(m.SIM_WIND_TC, _LEAST_TIME) / (2.0 * math.pi))
    m.wind_speed += share * (m.SIM_WIND_SPD - m.wind_speed)
    m.wind_from = _turn(m.wind_from + share * _turn(m.SIM_WIND_DIR - m.wind_from))
    m.wind_rise += share * (m.SIM_WIND_DIR_Z - m.wind_rise)
    if m.SIM_WIND_SPD == 0.0 and m.wind_speed < _CALM:
        m.wind_speed = 0.0


@kernel
def _at_height(m: Any) -> float:
    """Returns the speed of the wind [m/s] at the height of the vehicle."""
    height = -m.position[2]
    speed = float(m.wind_speed)
    if m.SIM_WIND_T == _SQRT and height < m.SIM_WIND_T_ALT:
        speed *= math.sqrt(max(height / m.SIM_WIND_T_ALT, 0.0))
    elif m.SIM_WIND_T == _LINEAR:
        speed += (height - m.SIM_WIND_T_ALT) * m.SIM_WIND_T_COEF
    return max(speed, 0.0)


@kernel
def _swirl(m: Any, h: float) -> None:
    """Adds the turbulence."""
    kept = _KEPT ** (_FRAMES * h)
    scale = _SCALE * m.SIM_WIND_TURB * math.sqrt(1.0 - kept * kept)
    a, b = normal_pair(_KEY, m.SYSID_THISMAV, m.wind_draws, 0)
    m.wind_turbulence[0] = kept * m.wind_turbulence[0] + scale * a
    m.wind_turbulence[1] = kept * m.wind_turbulence[1] + scale * b
    c, d = normal_pair(_KEY, m.SYSID_THISMAV, m.wind_draws, 1)
    m.wind_draws += 1
    way = math.sqrt(c * c + d * d)
    across = m.wind_turbulence[0] / (way * math.sqrt(max(1.0, _FRAMES * h)))
    m.added_wind[0] -= across * c
    m.added_wind[1] -= across * d
    m.added_wind[2] -= m.wind_turbulence[1]


@kernel
def blow(m: Any, h: float) -> None:
    """Sets the output `added_wind`."""
    if not wind_is_on(m):
        m.added_wind[0] = m.added_wind[1] = m.added_wind[2] = 0.0
        return
    _change(m, h)
    speed = _at_height(m)
    a, rise = math.radians(m.wind_from), math.radians(m.wind_rise)
    m.added_wind[0] = -speed * math.cos(a) * math.cos(rise)
    m.added_wind[1] = -speed * math.sin(a) * math.cos(rise)
    m.added_wind[2] = -speed * math.sin(rise)
    if m.SIM_WIND_TURB == 0.0:
        m.wind_turbulence[0] = m.wind_turbulence[1] = 0.0
    elif not m.on_ground:
        _swirl(m, h)

"""A pilot at the sticks of a `Copter`: overrides of the remote control."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, Copter

IGNORE, RELEASE = 65535, 65534


def override(copter: Copter, *pulses: int, more: tuple[int, ...] = ()) -> None:
    """RC_CHANNELS_OVERRIDE; channels that are not given are ignored."""
    first = [*pulses, *[IGNORE] * (8 - len(pulses))]
    copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *first, *more))


def hold(copter: Copter, duration: float, *pulses: int) -> np.ndarray[Any, Any]:
    """Fly on with the sticks held: the override is sent anew each half second."""
    parts = []
    for _ in range(round(duration / 0.5)):
        override(copter, *pulses)
        parts.append(copter.run(0.5))
    return np.concatenate(parts)


def texts(copter: Copter) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in copter.messages("STATUSTEXT")]


def lean(copter: Copter) -> tuple[float, float]:
    """Roll and pitch [deg]."""
    w, x, y, z = copter.v["attitude"]
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return math.degrees(roll), math.degrees(math.asin(2 * (w * y - z * x)))


def flown(mode: int, height: float = 5.0, **autopilot: Any) -> Copter:
    """In `mode` at 5 m or another `height`, sticks centred by an override."""
    copter = Copter(autopilot=autopilot).in_the_air(height, 8.0 + 0.4 * height)
    override(copter, 1500, 1500, 1500, 1500)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode) == [("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    return copter

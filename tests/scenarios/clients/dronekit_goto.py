"""A DroneKit program: take off to 10 m, go somewhere with simple_goto at 3 m/s, land. Prints where it has been.

Usage: dronekit_goto.py ADDRESS
"""

from __future__ import annotations

import collections
import collections.abc
import json
import sys
import time
from collections.abc import Callable

collections.MutableMapping = collections.abc.MutableMapping  # type: ignore[attr-defined] # DroneKit 2.9.2 uses it

from dronekit import LocationGlobalRelative, VehicleMode, connect  # noqa: E402


def wait(what: str, condition: Callable[[], object]) -> None:
    end = time.monotonic() + 40
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.02)


vehicle = connect(sys.argv[1], wait_ready=True, rate=4)
parameters = len(vehicle.parameters)
wait("armable", lambda: vehicle.is_armable)
vehicle.mode = VehicleMode("GUIDED")
wait("GUIDED", lambda: vehicle.mode.name == "GUIDED")
vehicle.armed = True
wait("armed", lambda: vehicle.armed)
vehicle.simple_takeoff(10)
wait("up", lambda: vehicle.location.global_relative_frame.alt > 9.5)
goal = LocationGlobalRelative(vehicle.location.global_frame.lat + 1.2e-4, vehicle.location.global_frame.lon, 8)
vehicle.simple_goto(goal, groundspeed=3)
wait("there", lambda: abs(vehicle.location.global_frame.lat - goal.lat) < 5e-6)
wait("lower", lambda: abs(vehicle.location.global_relative_frame.alt - 8) < 0.3)
place = vehicle.location.global_relative_frame
vehicle.mode = VehicleMode("LAND")
wait("landed", lambda: not vehicle.armed)
print(json.dumps({"parameters": parameters, "alt": place.alt, "off": place.lat - goal.lat}), flush=True)
vehicle.close()

"""The experiment's coordination script with DroneKit: five drones on a line, the three in the middle spread evenly.

    uav-cosim run master/systems/line5-script --pace 1 --ports tcp:5760+10
    python examples/dronekit_line.py tcp:127.0.0.1:5760 tcp:127.0.0.1:5770 tcp:127.0.0.1:5780 ...

Each vehicle takes off to 10 m in GUIDED. Then, at every step, each but the first and the last flies to

    x + (1/3) ((left - x) + (right - x))

where x, left and right are the measured longitudes of itself and its neighbours. Steps follow the first vehicle's
clock, not this computer's, so that a simulation of any pace flies the same. `pip install dronekit future`.
"""

from __future__ import annotations

import argparse
import collections
import collections.abc
import json
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

collections.MutableMapping = collections.abc.MutableMapping  # type: ignore[attr-defined] # DroneKit 2.9.2 uses it

from dronekit import Vehicle, VehicleMode, connect  # noqa: E402

EPSILON = 1.0 / 3.0
RADIUS = 6378100.0
"""Of ArduPilot's Earth, m."""


def wait(what: str, condition: Callable[[], Any], seconds: float = 60.0) -> None:
    """Until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(what)
        time.sleep(0.02)


def take_off(address: str, height: float) -> Vehicle:
    """Connect to a vehicle and bring it to `height` metres in GUIDED."""
    vehicle = connect(address, wait_ready=True, rate=4)
    wait(f"{address} is armable", lambda: vehicle.is_armable)
    vehicle.mode = VehicleMode("GUIDED")
    wait(f"{address} is in GUIDED", lambda: vehicle.mode.name == "GUIDED")
    vehicle.armed = True
    wait(f"{address} is armed", lambda: vehicle.armed)
    vehicle.simple_takeoff(height)
    wait(f"{address} is up", lambda: (vehicle.location.global_relative_frame.alt or 0.0) > 0.95 * height)
    return vehicle


def go_to(vehicle: Vehicle, latitude: float, longitude: float, height: float) -> None:
    """Send a vehicle to a place in degrees. simple_goto sends float32 degrees: a grid of 1.4 m at this longitude."""
    place = (round(latitude * 1e7), round(longitude * 1e7), height)
    frame, only_position = 6, 0x0DF8  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT; velocity, acceleration and yaw are ignored
    zeros = [0.0] * 8
    vehicle.send_mavlink(
        vehicle.message_factory.set_position_target_global_int_encode(0, 0, 0, frame, only_position, *place, *zeros)
    )


class Clock:
    """The time since boot that a vehicle says, in s; asked for at 20 Hz."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.now = -math.inf
        vehicle.add_message_listener("GLOBAL_POSITION_INT", self._hear)
        position, interval_us = 33, 50_000
        vehicle.send_mavlink(
            vehicle.message_factory.command_long_encode(0, 0, 511, 0, position, interval_us, 0, 0, 0, 0, 0)
        )
        wait("the first vehicle says its time", lambda: self.now > 0)

    def _hear(self, _vehicle: Vehicle, _name: str, message: Any) -> None:
        self.now = message.time_boot_ms / 1e3


def main() -> None:
    """Fly the line and print where the drones are after each step, in m east of the first, as one line of JSON each."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("address", nargs="+", help="of each vehicle, from west to east")
    arguments.add_argument("--height", type=float, default=10.0, help="of the flight, m")
    arguments.add_argument("--period", type=float, default=3.1875, help="of the steps, s of the first vehicle's time")
    arguments.add_argument("--steps", type=int, default=18)
    options = arguments.parse_args()
    with ThreadPoolExecutor(len(options.address)) as together:
        vehicles = list(together.map(lambda address: take_off(address, options.height), options.address))
    degree = RADIUS * math.radians(1.0) * math.cos(math.radians(vehicles[0].location.global_frame.lat))
    west = vehicles[0].location.global_frame.lon
    latitudes = [vehicle.location.global_frame.lat for vehicle in vehicles]
    clock = Clock(vehicles[0])
    for step in range(options.steps + 1):
        east = [vehicle.location.global_frame.lon for vehicle in vehicles]
        print(json.dumps({"step": step, "east": [round((x - west) * degree, 3) for x in east]}), flush=True)
        if step == options.steps:
            break
        for i in range(1, len(vehicles) - 1):
            x = east[i] + EPSILON * ((east[i - 1] - east[i]) + (east[i + 1] - east[i]))
            go_to(vehicles[i], latitudes[i], x, options.height)
        due = clock.now + options.period  # of a computer that is late, the step is longer
        wait(f"step {step} ends", lambda: clock.now >= due)  # noqa: B023  called at once
    for vehicle in vehicles:
        vehicle.close()


if __name__ == "__main__":
    main()

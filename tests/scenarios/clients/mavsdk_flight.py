"""A MAVSDK program (mavsdk 4): connect, wait until armable, arm, take off, go somewhere, fly a mission, land.

It prints what it has seen.

Usage: mavsdk_flight.py URL
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from collections.abc import Awaitable, Callable
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission_raw import MissionItem

NAV_WAYPOINT = 16  # MAV_CMD; this program stands alone, without pymavlink


async def until(what: str, ask: Callable[[], Awaitable[Any]], condition: Callable[[Any], bool]) -> Any:
    seen = None
    for _ in range(600):
        seen = await ask()
        if condition(seen):
            return seen
        await asyncio.sleep(0.05)
    raise TimeoutError(f"{what}: {seen}")


async def fly(url: str) -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    await mavsdk.add_any_connection(url)
    system = await mavsdk.first_autopilot(20.0)
    assert system is not None, "no autopilot"
    action, telemetry = ActionAsync(system), TelemetryAsync(system)
    for ask in (telemetry.set_rate_position, telemetry.set_rate_health, telemetry.set_rate_raw_gps):
        try:
            await ask(10.0)
        except Exception as refusal:
            print(json.dumps({"refused": ask.__name__, "by": str(refusal)}))
    health = await until("health", telemetry.health, lambda h: bool(h.is_armable and h.is_global_position_ok))
    assert health.is_home_position_ok
    assert health.is_gyrometer_calibration_ok
    start = await until("position", telemetry.position, lambda p: math.isfinite(p.latitude_deg))
    await action.set_takeoff_altitude(10.0)
    await action.arm()
    await until("armed", telemetry.armed, bool)
    await action.takeoff()
    await until("up", telemetry.position, lambda p: p.relative_altitude_m > 9.5)
    assert await telemetry.in_air()
    north = start.latitude_deg + 8.0 / 111319.5
    await action.goto_location(north, start.longitude_deg, start.absolute_altitude_m + 12.0, math.nan)

    def there(p: Any) -> bool:
        return abs(p.latitude_deg - north) < 0.3 / 111319.5 and abs(p.relative_altitude_m - 12.0) < 0.3

    arrived = await until("there", telemetry.position, there)
    mission = MissionRawAsync(system)
    await mission.upload_mission(_items(start, north))
    await mission.start_mission()
    await until("on its way", telemetry.position, lambda p: abs(p.relative_altitude_m - 15.0) < 0.5)
    await until("back in the south", telemetry.position, lambda p: abs(p.latitude_deg - start.latitude_deg) < 5e-6)
    seen = await mission.download_mission()
    assert [item.command for item in seen] == [16, 16, 16], seen
    await action.land()
    await until("disarmed", telemetry.armed, lambda armed: not armed)
    print(json.dumps({"system": await system.get_system_id(), "height": arrived.relative_altitude_m}), flush=True)


def _items(start: Any, north: float) -> list[MissionItem]:
    """Home, which ArduPilot keeps as item 0, up to 15 m, and back to the south."""
    places = ((0, start.latitude_deg, start.absolute_altitude_m), (3, north, 15.0), (3, start.latitude_deg, 15.0))
    return [
        MissionItem(
            seq=i,
            frame=frame,
            command=NAV_WAYPOINT,
            current=int(i == 0),
            autocontinue=1,
            x=round(latitude * 1e7),
            y=round(start.longitude_deg * 1e7),
            z=height,
        )
        for i, (frame, latitude, height) in enumerate(places)
    ]


asyncio.run(fly(sys.argv[1]))

"""Calls the functions of MAVSDK's client plug-ins, and writes a line of JSON for each: its name and outcome.

It waits until the vehicle can be armed, asks on the ground, in the air, and after landing. An outcome is the result's
name ("SUCCESS", "COMMAND_DENIED"), "value" for a value that is known, "arrives" or "never" for a subscription, or "no
end" for a call that has not ended within LIMIT seconds. Servers are no clients; of cameras and gimbals, which are not
on board, some calls stand for all.

Usage: clients_mavsdk.py URL FILE
"""

from __future__ import annotations

import asyncio
import importlib
import json
import math
import os
import sys
import tempfile
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from pathlib import Path
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk

LIMIT = 20.0
"""Seconds that a call may take."""
PATIENCE = 60.0
"""Seconds that the vehicle may take to be ready, to climb or to land."""
LAT, LON, HERE = -35.363262, 149.165237, 584.0
NEAR = -35.3632
PLUGINS = (
    *("action", "calibration", "camera", "component_metadata", "events", "failure", "follow_me", "ftp", "geofence"),
    *("gimbal", "gripper", "info", "log_files", "log_streaming", "manual_control", "mavlink_direct", "mission"),
    *("mission_raw", "mocap", "offboard", "param", "rtk", "server_utility", "shell", "telemetry", "transponder"),
    *("tune", "winch"),
)


def tell(call: str, outcome: str) -> None:
    """Writes an outcome to the file that the command line names."""
    with Path(sys.argv[2]).open("a") as file:
        file.write(json.dumps({"call": call, "outcome": outcome}) + "\n")


def described(value: Any) -> str:
    """The outcome of a call that has returned a value."""
    if value is None:
        return "SUCCESS"
    if isinstance(value, Enum):
        return str(value.name)
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, float):
        return "value" if math.isfinite(value) else "nan"
    if isinstance(value, list):
        return f"{len(value)} entries"
    numbers = [number for number in getattr(value, "__dict__", {}).values() if isinstance(number, float)]
    return "nan" if numbers and not any(map(math.isfinite, numbers)) else "value"


async def outcome(call: Awaitable[Any], limit: float = LIMIT) -> str:
    """Waits for a call; its outcome."""
    try:
        return described(await asyncio.wait_for(call, limit))
    except TimeoutError:
        return "no end"
    except Exception as error:
        result = getattr(error, "result", None)
        return str(result.name) if isinstance(result, Enum) else type(error).__name__


async def first(stream: Any, limit: float = 6.0) -> str:
    """Waits for the first value of a subscription."""
    try:
        await asyncio.wait_for(anext(stream), limit)
    except (TimeoutError, StopAsyncIteration):
        return "never"
    except Exception as error:
        result = getattr(error, "result", None)
        return str(result.name) if isinstance(result, Enum) else type(error).__name__
    return "arrives"


async def last(stream: Any) -> None:
    """Reads a stream to its end."""
    async for _ in stream:
        pass


class Session:
    """The plug-ins of one system, as attributes, and the outcomes so far."""

    def __init__(self, system: Any) -> None:
        self.types = {name: importlib.import_module(f"mavsdk.plugins.{name}.{name}") for name in PLUGINS}
        for name in PLUGINS:
            module = importlib.import_module(f"mavsdk.asyncio.plugins.{name}")
            words = "".join(word.capitalize() for word in name.split("_"))
            setattr(self, name, getattr(module, f"{words}Async")(system))

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    async def say(self, name: str, call: Awaitable[Any], note: str = "") -> None:
        """Makes a call and prints its outcome."""
        tell(f"{name}{' ' if note else ''}{note}", await outcome(call))

    async def ask(self, path: str, *values: Any, note: str = "") -> None:
        """Makes a call of PLUGIN.FUNCTION with these arguments."""
        plugin, _, function = path.partition(".")
        await self.say(path, getattr(getattr(self, plugin), function)(*values), note)

    def of(self, plugin: str, name: str, **values: Any) -> Any:
        """Makes an object of a plug-in's type."""
        return getattr(self.types[plugin], name)(**values)

    async def until(self, what: str, ask: Callable[[], Awaitable[Any]], holds: Callable[[Any], bool]) -> None:
        """Waits for a state; prints whether it came."""
        end = asyncio.get_running_loop().time() + PATIENCE
        while not (came := holds(await ask())) and asyncio.get_running_loop().time() < end:
            await asyncio.sleep(0.1)
        tell(f"({what})", "reached" if came else "not reached")


# ---- on the ground -------------------------------------------------------------------------------------------------


async def telemetry(s: Session) -> None:
    """All rates, then all subscriptions side by side, then all getters that are no subscriptions."""
    names = [name for name in dir(s.telemetry) if not name.startswith("_")]
    for name in names:
        if name.startswith("set_rate_"):
            await s.ask(f"telemetry.{name}", 5.0)
    await s.ask("telemetry.get_gps_global_origin")
    streams = [name for name in names if name.startswith("subscribe_")]
    found = await asyncio.gather(*(first(getattr(s.telemetry, name)()) for name in streams))
    for name, came in zip(streams, found, strict=True):
        if name != "subscribe_status_text":
            tell(f"telemetry.{name}", came)
    for name in names:
        if f"subscribe_{name}" in names and name != "status_text":
            await s.ask(f"telemetry.{name}")


async def facts(s: Session) -> None:
    """What the vehicle is, and its parameters."""
    for name in ("get_identification", "get_product", "get_version", "get_speed_factor"):
        await s.ask(f"info.{name}")
    tell("info.subscribe_flight_information", await first(s.info.subscribe_flight_information()))
    await s.ask("param.get_param_float", "WPNAV_SPEED")
    await s.ask("param.get_param_int", "FENCE_ACTION")
    await s.ask("param.get_param_int", "WPNAV_SPEED", note="(a float)")
    await s.ask("param.get_param_float", "NO_SUCH")
    await s.ask("param.set_param_float", "WPNAV_SPEED", 900.0)
    await s.ask("param.set_param_int", "RTL_ALT", 1200)
    await s.ask("param.set_param_int", "NO_SUCH", 1)
    await s.ask("param.get_param_custom", "WPNAV_SPEED")
    await s.ask("param.set_param_custom", "WPNAV_SPEED", "fast")
    await s.say("param.get_all_params", all_parameters(s))
    await s.ask("param.select_component", 1, s.types["param"].ProtocolVersion.V1)


async def all_parameters(s: Session) -> bool:
    """Whether all parameters came, among them one of each type."""
    found = await s.param.get_all_params()
    names = {one.name for one in [*found.int_params, *found.float_params]}
    return {"WPNAV_SPEED", "FENCE_ACTION"} <= names


async def files(s: Session) -> None:
    """Files, logs, shell and metadata."""
    with tempfile.TemporaryDirectory() as folder:
        local = Path(folder) / "note.txt"
        local.write_text("words")
        await s.ask("ftp.set_target_compid", 1)
        await s.ask("ftp.list_directory", "@PARAM")
        await s.ask("ftp.list_directory", "/nowhere")
        await s.say("ftp.download", last(s.ftp.download("@PARAM/param.pck", folder, False)), "@PARAM/param.pck")
        await s.say("ftp.download", last(s.ftp.download("@PARAM/param.pck", folder, True)), "by a burst")
        await s.say("ftp.download", last(s.ftp.download("/nowhere/file", folder, False)), "of none")
        await s.ask("log_files.get_entries")
        await s.ask("log_files.erase_all_log_files")
        await s.ask("log_files.cancel_download_log_file")
    await s.ask("shell.send", "help", s.types["shell"].Device.SHELL)
    await s.ask("server_utility.send_status_text", s.types["server_utility"].StatusTextType.INFO, "hello")
    await s.ask("component_metadata.request_autopilot_component")
    await s.ask("component_metadata.request_component", 1)
    await s.ask("component_metadata.get_metadata", 1, s.types["component_metadata"].MetadataType.PARAMETER)
    await s.ask("log_streaming.start_log_streaming")
    await s.ask("log_streaming.stop_log_streaming")
    await s.ask("events.get_health_and_arming_checks_report")


async def devices(s: Session) -> None:
    """Devices that are not on board, and positions and messages from outside."""
    failure, tune = s.types["failure"], s.types["tune"]
    await s.ask("failure.inject", failure.FailureUnit.SENSOR_GPS, failure.FailureType.OFF, 0)
    element = tune.SongElement
    await s.ask(
        "tune.play_tune", s.of("tune", "TuneDescription", song_elements=[element.NOTE_A, element.NOTE_B], tempo=200)
    )
    await s.ask("camera.camera_list")
    await s.ask("camera.take_photo", 100)
    await s.ask("gimbal.gimbal_list")
    await s.ask(
        "gimbal.set_angles",
        0,
        0.0,
        -45.0,
        0.0,
        s.types["gimbal"].GimbalMode.YAW_FOLLOW,
        s.types["gimbal"].SendMode.ONCE,
    )
    await s.ask("gimbal.take_control", 0, s.types["gimbal"].ControlMode.PRIMARY)
    await s.ask("gimbal.set_roi_location", 0, LAT, LON, HERE)
    for name in ("grab", "release"):
        await s.ask(f"gripper.{name}", 1)
    for name in ("relax", "lock", "deliver", "hold", "retract", "load_line", "abandon_line", "load_payload"):
        await s.ask(f"winch.{name}", 1)
    await s.ask("winch.rate_control", 1, 0.5)
    await s.ask("winch.relative_length_control", 1, 1.0, 0.5)
    await s.ask("transponder.set_rate_transponder", 1.0)
    await s.ask("rtk.send_rtcm_data", s.of("rtk", "RtcmData", data_base64="AAAA"))
    point = s.of("mocap", "PositionBody", x_m=0.0, y_m=0.0, z_m=0.0)
    angle = s.of("mocap", "AngleBody", roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0)
    spread = s.of("mocap", "Covariance", covariance_matrix=[math.nan])
    values = {
        "time_usec": 0,
        "position_body": point,
        "angle_body": angle,
        "pose_covariance": spread,
        "reset_counter": 0,
    }
    await s.ask("mocap.set_vision_position_estimate", s.of("mocap", "VisionPositionEstimate", **values))
    fields = {"type": 6, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
    await s.ask("mavlink_direct.send_message", message(s, "HEARTBEAT", fields))


def message(s: Session, name: str, fields: dict[str, Any]) -> Any:
    """A message of the plug-in for any message."""
    numbers = {"system_id": 245, "component_id": 190, "target_system_id": 1, "target_component_id": 1}
    return s.of("mavlink_direct", "MavlinkMessage", message_name=name, fields_json=json.dumps(fields), **numbers)


async def calibrations(s: Session) -> None:
    for name in ("gyro", "accelerometer", "magnetometer", "level_horizon", "gimbal_accelerometer"):
        await s.say(f"calibration.calibrate_{name}", last(getattr(s.calibration, f"calibrate_{name}")()))
        await s.ask("calibration.cancel", note=f"({name})")


async def plans(s: Session) -> None:
    """Fences, missions and rally points."""
    kinds = s.types["geofence"].FenceType
    corners = [(1e-3, -1e-3), (1e-3, 1e-3), (-1e-3, 1e-3), (-1e-3, -1e-3)]
    points = [s.of("geofence", "Point", latitude_deg=LAT + n, longitude_deg=LON + e) for n, e in corners]
    area = s.of("geofence", "Polygon", points=points, fence_type=kinds.INCLUSION)
    circle = s.of("geofence", "Circle", point=points[0], radius=10.0, fence_type=kinds.EXCLUSION)
    await s.ask("geofence.upload_geofence", s.of("geofence", "GeofenceData", polygons=[area], circles=[circle]))
    await s.ask("geofence.download_geofence")
    await s.ask("mission_raw.download_geofence")
    await s.ask("geofence.clear_geofence")
    await s.ask("mission.upload_mission", plan(s), note="(before another)")
    await s.ask("mission.clear_mission")
    await s.ask("mission.download_mission", note="(of none)")
    await s.ask("mission.start_mission", note="(of none)")
    await s.say("mission.upload_mission_with_progress", last(s.mission.upload_mission_with_progress(plan(s))))
    await s.ask("mission.upload_mission", plan(s))
    await s.ask("mission.download_mission")
    await s.say("mission.download_mission_with_progress", last(s.mission.download_mission_with_progress()))
    for name in ("cancel_mission_upload", "cancel_mission_download", "is_mission_finished", "mission_progress"):
        await s.ask(f"mission.{name}")
    await s.ask("mission.set_return_to_launch_after_mission", True)
    await s.ask("mission.get_return_to_launch_after_mission")
    await s.ask("mission.set_current_mission_item", 1)
    await s.ask("mission_raw.upload_rally_points", [raw(s, 0, 5100, 3, NEAR, 20.0, kind=2)])
    await s.ask("mission_raw.download_rallypoints")
    items = [
        raw(s, 0, 16, 0, LAT, HERE),
        raw(s, 1, 22, 3, 0.0, 8.0),
        raw(s, 2, 16, 3, NEAR, 12.0),
        raw(s, 3, 20, 3, 0.0, 0.0),
    ]
    await s.ask("mission_raw.upload_mission", items)
    await s.ask("mission_raw.download_mission")
    for name in ("cancel_mission_upload", "cancel_mission_download", "is_mission_finished", "mission_progress"):
        await s.ask(f"mission_raw.{name}")
    await s.ask("mission_raw.set_current_mission_item", 2)
    await s.ask("mission_raw.clear_mission")
    await s.ask("mission_raw.download_mission", note="(cleared)")
    await s.ask("mission_raw.upload_mission", items, note="(again)")


def plan(s: Session) -> Any:
    """A mission of two places, with a speed and a wait."""
    item = s.types["mission"].MissionItem
    none, nan = (item.CameraAction.NONE, item.VehicleAction.NONE), math.nan
    places = [(NEAR, 10.0, 5.0), (LAT, 12.0, nan)]
    made = [
        item(lat, LON, up, speed, False, nan, nan, none[0], 1.0, nan, nan, nan, nan, none[1])
        for lat, up, speed in places
    ]
    return s.of("mission", "MissionPlan", mission_items=made)


def raw(s: Session, seq: int, command: int, frame: int, lat: float, z: float, kind: int = 0) -> Any:
    lon = LON if lat else 0.0
    return s.of(
        "mission_raw",
        "MissionItem",
        seq=seq,
        frame=frame,
        command=command,
        current=int(seq == 0),
        autocontinue=1,
        param1=0.0,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        x=round(lat * 1e7),
        y=round(lon * 1e7),
        z=z,
        mission_type=kind,
    )


# ---- flights -------------------------------------------------------------------------------------------------------


async def actions(s: Session) -> None:
    """Actions on the ground that do not fly."""
    await s.ask("action.set_takeoff_altitude", 8.0)
    await s.ask("action.get_takeoff_altitude")
    await s.ask("action.set_return_to_launch_altitude", 15.0)
    await s.ask("action.get_return_to_launch_altitude")
    await s.ask("action.set_actuator", 1, 0.5)
    await s.ask("action.set_relay", 0, s.types["action"].RelayCommand.ON)
    await s.ask("action.set_home", True, 0.0, 0.0, 0.0)
    await s.ask("action.set_gps_global_origin", LAT, LON, HERE)
    await s.ask("action.set_current_speed", 3.0, note="(on the ground)")
    await s.ask("action.takeoff", note="(disarmed)")
    await s.ask("action.disarm", note="(disarmed)")
    await s.ask("manual_control.start_position_control", note="(without sticks)")


async def guided(s: Session) -> None:
    """Sets GUIDED: the mode after a landing does not permit arming, and no other function sets this mode."""
    fields = {"target_system": 1, "target_component": 1, "command": 176, "confirmation": 0, "param1": 1, "param2": 4}
    fields |= {f"param{i}": 0 for i in range(3, 8)}
    await s.mavlink_direct.send_message(message(s, "COMMAND_LONG", fields))
    await asyncio.sleep(0.5)


async def height(s: Session) -> float:
    return float((await s.telemetry.position()).relative_altitude_m)


async def up(s: Session, note: str) -> None:
    """Arms and takes off."""
    await guided(s)
    await s.ask("action.arm", note=note)
    await s.ask("action.takeoff", note=note)
    await s.until(f"up {note}", lambda: height(s), lambda h: h > 7.5)


async def down(s: Session, note: str) -> None:
    """Lands."""
    await s.ask("action.land", note=note)
    await s.until(f"disarmed {note}", s.telemetry.armed, lambda armed: not armed)


async def flight(s: Session) -> None:
    """Actions in the air."""
    await up(s, "(first flight)")
    await s.ask("action.disarm", note="(in the air)")
    await s.ask("action.arm", note="(in the air)")
    await s.ask("action.set_current_speed", 3.0)
    await s.ask("action.goto_location", NEAR, LON, HERE + 10.0, math.nan)
    await s.until("there", s.telemetry.position, lambda p: abs(p.latitude_deg - NEAR) < 1e-5)
    behaviour = s.types["action"].OrbitYawBehavior.HOLD_INITIAL_HEADING
    await s.ask("action.do_orbit", 10.0, 2.0, behaviour, LAT, LON, HERE + 10.0)
    await s.ask("action.goto_location_fixedwing", NEAR, LON, HERE + 10.0, 20.0)
    await s.ask("action.transition_to_fixedwing")
    await s.ask("action.transition_to_multicopter")
    await s.ask("action.set_actuator", 1, -0.5, note="(in the air)")
    await s.ask("action.hold")
    await s.ask("telemetry.flight_mode", note="(after hold)")
    await s.say("calibration.calibrate_gyro", last(s.calibration.calibrate_gyro()), "(in the air)")
    await s.ask("log_files.get_entries", note="(in the air)")
    await offboard(s)
    await follow(s)
    await s.ask("action.return_to_launch")
    await s.ask("telemetry.flight_mode", note="(after RTL)")
    await s.until("disarmed after RTL", s.telemetry.armed, lambda armed: not armed)


async def offboard(s: Session) -> None:
    """Every kind of set-point."""
    await s.ask("offboard.start", note="(without a set-point)")
    place = s.of("offboard", "PositionNedYaw", north_m=0.0, east_m=5.0, down_m=-10.0, yaw_deg=0.0)
    speed = s.of("offboard", "VelocityNedYaw", north_m_s=0.5, east_m_s=0.0, down_m_s=0.0, yaw_deg=0.0)
    change = s.of("offboard", "AccelerationNed", north_m_s2=0.1, east_m_s2=0.0, down_m_s2=0.0)
    await s.ask("offboard.set_position_ned", place)
    await s.ask("offboard.start")
    await s.ask("offboard.is_active")
    await s.ask("telemetry.flight_mode", note="(offboard)")
    await s.until("at the set-point", s.telemetry.position_velocity_ned, lambda p: abs(p.position.east_m - 5.0) < 0.5)
    kind = s.types["offboard"].PositionGlobalYaw.AltitudeType.REL_HOME
    there = {"lat_deg": LAT, "lon_deg": LON, "alt_m": 10.0, "yaw_deg": 0.0, "altitude_type": kind}
    for function, values in (
        ("set_position_global", [s.of("offboard", "PositionGlobalYaw", **there)]),
        ("set_velocity_ned", [speed]),
        (
            "set_velocity_body",
            [
                s.of(
                    "offboard", "VelocityBodyYawspeed", forward_m_s=0.5, right_m_s=0.0, down_m_s=0.0, yawspeed_deg_s=5.0
                )
            ],
        ),
        ("set_position_velocity_ned", [place, speed]),
        ("set_position_velocity_acceleration_ned", [place, speed, change]),
        ("set_acceleration_ned", [change]),
        ("set_attitude", [s.of("offboard", "Attitude", roll_deg=0.0, pitch_deg=2.0, yaw_deg=0.0, thrust_value=0.5)]),
        (
            "set_attitude_rate",
            [s.of("offboard", "AttitudeRate", roll_deg_s=0.0, pitch_deg_s=0.0, yaw_deg_s=5.0, thrust_value=0.5)],
        ),
        ("set_velocity_ned", [speed]),
    ):
        await s.ask(f"offboard.{function}", *values)
        await asyncio.sleep(0.5)
    await s.ask("offboard.stop")
    await s.ask("offboard.is_active", note="(stopped)")


async def follow(s: Session) -> None:
    """Following, and sticks."""
    await s.ask("follow_me.get_config")
    await s.ask("follow_me.start")
    await s.ask("follow_me.is_active")
    await s.ask("follow_me.stop")
    for _ in range(10):
        await s.manual_control.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
        await asyncio.sleep(0.05)
    await s.ask("manual_control.set_manual_control_input", 0.0, 0.0, 0.5, 0.0)
    await s.ask("manual_control.start_position_control")
    await s.ask("telemetry.flight_mode", note="(position control)")
    await s.ask("manual_control.start_altitude_control")
    await s.ask("telemetry.flight_mode", note="(altitude control)")


async def missions(s: Session) -> None:
    """A mission flown, paused, and gone on."""
    await guided(s)
    await s.ask("action.arm", note="(mission)")
    await s.ask("mission_raw.start_mission")
    await s.until("up in the mission", lambda: height(s), lambda h: h > 7.5)
    await s.ask("mission_raw.pause_mission")
    await s.ask("telemetry.flight_mode", note="(paused)")
    await s.ask("mission_raw.start_mission", note="(again)")
    await s.ask("telemetry.flight_mode", note="(mission)")
    await s.until("disarmed after the mission", s.telemetry.armed, lambda armed: not armed)
    await s.ask("mission_raw.is_mission_finished", note="(after it)")


async def logs(s: Session) -> None:
    """The log of the flights so far."""
    try:
        entries = await s.log_files.get_entries()
    except Exception as error:
        tell("log_files.get_entries (after flights)", type(error).__name__)
        return
    tell("log_files.get_entries (after flights)", "some" if entries else "none")
    with tempfile.TemporaryDirectory() as folder:
        stream = s.log_files.download_log_file(entries[-1], f"{folder}/log.bin")
        tell("log_files.download_log_file", await outcome(last(stream), 240.0))


async def ends(s: Session) -> None:
    """Forced arming, kill and termination on the ground, reboot."""
    await up(s, "(last flight)")
    await down(s, "(last flight)")
    await s.ask("action.hold", note="(on the ground)")
    await s.ask("action.arm", note="(in BRAKE)")
    await s.ask("action.arm_force")
    await s.ask("action.kill")
    await s.until("disarmed after kill", s.telemetry.armed, lambda armed: not armed)
    await guided(s)
    await s.ask("action.arm", note="(after kill)")
    await s.ask("action.terminate")
    await s.until("disarmed after terminate", s.telemetry.armed, lambda armed: not armed)
    await s.ask("action.shutdown")
    await s.ask("action.reboot")


async def main(url: str) -> None:
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(64))
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    await mavsdk.add_any_connection(url)
    system = await mavsdk.first_autopilot(60.0)
    s = Session(system)
    for rate in ("position", "health", "home", "raw_gps", "in_air", "landed_state"):
        await outcome(getattr(s.telemetry, f"set_rate_{rate}")(5.0))
    await s.until("ready", s.telemetry.health, lambda h: bool(h.is_armable and h.is_home_position_ok))
    for part in (facts, telemetry, plans, devices, files, calibrations, actions, flight, missions, logs, ends):
        try:
            await part(s)
        except Exception as error:
            tell(f"({part.__name__})", f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
    sys.stdout.flush()
    os._exit(0)  # calls that never end have threads of their own

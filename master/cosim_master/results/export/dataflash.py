"""Exports DataFlash logs (.bin) as ArduCopter writes them, one for each autopilot that recorded its inner values.

Log viewers (MAVExplorer, UAV Log Viewer, Mission Planner) open them. The times are those of the run, and every recorded
instant is written, GPS at most five times and BAT ten times a second. Values are the autopilot's: the motion that it
senses, not the true one. Messages whose signals were not recorded are left out.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa

from cosim.frames import euler_from_quaternion
from cosim.messages import PARAM_VALUE, PARAM_VALUE_PARAM_ID, PARAM_VALUE_PARAM_INDEX, PARAM_VALUE_PARAM_VALUE
from cosim.verdict import Role
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.contents.dataflash_log import Log, texts
from cosim_master.results.export.contents.packet_log import Packet, packets_of
from cosim_master.results.export.contents.spoken import spoken
from cosim_master.results.export.contents.tracks import declared_origin, geodetic
from cosim_master.results.export.options import Options, Origin
from cosim_master.results.reading.recorded_signals import Signals, open_signals
from cosim_master.results.reading.roles import Player, players, read_manifest
from cosim_master.results.recording.packet_log import EPOCH, file_name

__all__ = ["export"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

_GRAVITY = 9.80665
_LEAP = 18  # s by which GPS time is ahead of UTC
_GPS_BEGIN, _WEEK = 315_964_800, 604_800  # s since 1970, s
_ARMED, _DISARMED, _LANDED, _FLIES = 10, 11, 18, 28  # EV
_RADIO, _BATTERY, _STATION, _FENCE, _GPS, _ESTIMATE = 5, 6, 8, 9, 11, 17  # ERR, subsystems
_GLITCH = 2  # code
_CHANGED = 65535  # index of a PARAM_VALUE that tells of a change
_NAMES = {
    "q": 4, "position_neu": 3, "velocity_neu": 3, "acceleration_neu": 3, "gyro": 3, "attitude_target": 4,
    "rate_wanted": 3, "torque": 3, "desired_position": 3, "desired_velocity": 3, "desired_acceleration_neu": 3,
    "target_velocity_neu": 3, "target_acceleration_neu": 3, "throttle_in": 0, "throttle_command": 0,
    "throttle_out": 0, "throttle_hover": 0, "home_neu": 3, "motor": 8, "motor_count": 0, "battery_voltage": 0,
    "battery_current": 0, "battery_used": 0, "battery_energy": 0, "battery_alarm": 0, "fence_breach": 0,
    "radio_lost": 0, "station_lost": 0, "ekf_failed": 0, "glitching": 0, "armed": 0, "mode": 0, "on_ground": 0,
}  # fmt: skip
"""Signals of an autopilot, with the numbers of their elements; 0: a scalar."""
_FROM_ESTIMATOR = {"position": 3, "velocity": 3, "attitude": 4, "gyro_offset_frd": 3}
_NED = (1.0, 1.0, -1.0)


@dataclass(frozen=True, slots=True)
class _Recording:
    """The recorded signals of an instance, by name; (n,) or (n, elements)."""

    time: Array
    values: Mapping[str, Array]
    player: Player

    def has(self, *names: str) -> bool:
        return all(name in self.values for name in names)

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def number(self, parameter: str) -> float:
        """Returns a parameter; 0 if the instance has none of this name."""
        value = self.player.parameters.get(parameter, 0.0)
        return float(value) if isinstance(value, (int, float)) else 0.0


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes NODE.bin for each autopilot to the folder `file`; returns notes.

    Raises:
        CosimError: no autopilot recorded its inner values.
    """
    manifest = read_manifest(run)
    known = players(run, manifest)
    origin = options.origin or declared_origin(known, str(run))
    written, notes = 0, []
    with open_signals(run) as signals:
        names = set(signals.schema_arrow.names)
        for name, player in known.items():
            if not player.named(Role.ARMED) or not player.named(Role.SYSTEM_ID):
                continue
            if f"{name}.q[1]" not in names:
                notes.append(f"{name}: no log: the run did not record its inner values ({name}.q)")
                continue
            autopilot = _read(signals, names, name, player, _NAMES)
            if len(autopilot.time) == 0:
                continue
            log = Log()
            _add_words(log, run, name, autopilot)
            _add_control(log, autopilot)
            _add_state(log, autopilot)
            _add_sensed(log, autopilot, origin)
            _add_estimate(log, signals, names, name, known, origin)
            file.mkdir(parents=True, exist_ok=True)
            with (file / f"{file_name(name.rpartition('.')[0] or name)}.bin").open("wb") as to:
                to.writelines(log.write())
            written += 1
    if not written:
        raise CosimError(
            f"{run}: no autopilot recorded its inner values; run with --dataflash, or --record '*' for all signals"
        )
    if origin is None:
        notes.append("no POS, GPS and ORGN: no FMU declares the local origin; --origin gives one")
    return notes


def _read(signals: Signals, names: set[str], instance: str, player: Player, wanted: Mapping[str, int]) -> _Recording:
    values: dict[str, Array] = {}
    for name, size in wanted.items():
        columns = [f"{instance}.{name}[{i + 1}]" for i in range(size)] or [f"{instance}.{name}"]
        if all(one in names for one in columns):
            table = signals.read(columns=columns)
            arrays = [_floats(table.column(one)) for one in columns]
            values[name] = np.stack(arrays, axis=1) if size else arrays[0]
    time = _floats(signals.read(columns=["time"]).column(0))
    if "q" in values:  # before the first step it is not a rotation
        begun = np.einsum("ij,ij->i", values["q"], values["q"]) > 0.5
        time, values = time[begun], {name: array[begun] for name, array in values.items()}
    return _Recording(time, values, player)


def _floats(column: pa.ChunkedArray) -> Array:
    values: Array = column.to_numpy().astype(np.float64)
    return values


def _angles(q: Array) -> Array:
    """Returns roll, pitch and yaw [degrees], the last 0 to 360, of quaternions (n, 4)."""
    angles = np.degrees([euler_from_quaternion((w, x, y, z)) for w, x, y, z in q.tolist()]).reshape(-1, 3)
    angles[:, 2] %= 360.0
    return angles


# ---- words ----------------------------------------------------------------------------------------------------------


def _add_words(log: Log, run: Path, name: str, autopilot: _Recording) -> None:
    """Adds MSG (the kind of vehicle first, then STATUSTEXT) and PARM (start values, then changes)."""
    place = name.rpartition(".")[0] or name
    said: dict[tuple[float, str], None] = {(0.0, f"ArduCopter, simulated by uav-cosim ({name})"): None}
    for one in spoken(run):
        if one.who == place:
            said[(one.stamp - EPOCH * 1000) * 1e-9, one.text] = None  # once for all links
    log.add("MSG", np.array([t for t, _ in said]), texts([text for _, text in said], 64))
    given = [(0.0, key, float(value)) for key, value in autopilot.player.parameters.items() if _is_ardupilots(key)]
    system = autopilot.player.parameters.get(autopilot.player.named(Role.SYSTEM_ID))
    given += [*dict.fromkeys(_changes(run, system))]
    if given:
        times, keys, values = zip(*given, strict=True)
        log.add("PARM", np.array(times), texts(keys, 16), np.array(values), math.nan)


def _is_ardupilots(name: str) -> bool:
    return name.upper() == name and "[" not in name


def _changes(run: Path, system: object) -> Iterator[tuple[float, str, float]]:
    """Returns time, name and value of the parameters that the autopilot told to have changed."""
    log = run / "packets.tlog"
    if not log.is_file():
        return
    for packet in packets_of(log.read_bytes()):
        if packet.message == PARAM_VALUE and packet.address[0] == system:
            found = _parameter(packet)
            if found is not None:
                yield (packet.stamp - EPOCH) * 1e-6, *found


def _parameter(packet: Packet) -> tuple[str, float] | None:
    payload = packet.payload.ljust(PARAM_VALUE_PARAM_ID + 17, b"\0")
    (index,) = struct.unpack_from("<H", payload, PARAM_VALUE_PARAM_INDEX)
    if index != _CHANGED:
        return None
    (value,) = struct.unpack_from("<f", payload, PARAM_VALUE_PARAM_VALUE)
    name = payload[PARAM_VALUE_PARAM_ID : PARAM_VALUE_PARAM_ID + 16].split(b"\0")[0]
    return name.decode("ascii", "replace"), value


# ---- control --------------------------------------------------------------------------------------------------------


def _add_control(log: Log, one: _Recording) -> None:
    """Adds ATT, RATE, PSCN, PSCE, PSCD and CTUN."""
    t = one.time
    if one.has("attitude_target"):
        demanded, attitude = _angles(one["attitude_target"]), _angles(one["q"])
        log.add("ATT", t, *(of[:, i] for i in range(3) for of in (demanded, attitude)), 3)
    if one.has("rate_wanted", "gyro", "torque", "target_acceleration_neu", "acceleration_neu", "throttle_out"):
        wanted, rates, torque = np.degrees(one["rate_wanted"]), np.degrees(one["gyro"]), one["torque"]
        axes = [column for i in range(3) for column in (wanted[:, i], rates[:, i], torque[:, i])]
        up = [100.0 * one[name][:, 2] for name in ("target_acceleration_neu", "acceleration_neu")]
        log.add("RATE", t, *axes, *up, one["throttle_out"])
    path = ("desired_position", "desired_velocity")
    followed = ("position_neu", "target_velocity_neu", "velocity_neu", "desired_acceleration_neu")
    if one.has(*path, *followed, "target_acceleration_neu", "acceleration_neu"):
        for i, axis in enumerate("NED"):
            place, target_v, v, desired_a, target_a, a = (
                one[name][:, i] * _NED[i] for name in (*followed, "target_acceleration_neu", "acceleration_neu")
            )
            wanted_p, wanted_v = (one[name][:, i] for name in path)
            log.add(f"PSC{axis}", t, wanted_p, place, wanted_v, target_v, v, desired_a, target_a, a)
    throttle = ("throttle_in", "throttle_command", "throttle_out", "throttle_hover")
    if one.has(*throttle, *path, "position_neu", "velocity_neu", "home_neu"):
        given, boosted, out, hover = (one[name] for name in throttle)
        home = one["home_neu"][:, 2]
        wanted, height = -one["desired_position"][:, 2] - home, one["position_neu"][:, 2] - home
        climb, rate = -one["desired_velocity"][:, 2], one["velocity_neu"][:, 2]
        none = math.nan  # no rangefinder
        log.add(
            "CTUN", t, given, boosted - given, out, hover, wanted, height, height, none, none, 0.0, 100.0 * climb,
            100.0 * rate,
        )  # fmt: skip


# ---- state ----------------------------------------------------------------------------------------------------------


def _begins(values: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Returns where a value differs from the one before."""
    return np.concatenate([[False], np.diff(values) != 0.0])


def _add_state(log: Log, one: _Recording) -> None:
    """Adds MODE, EV, ERR, RCOU and BAT."""
    t = one.time
    if one.has("mode"):
        rows = _begins(one["mode"])
        rows[0] = True
        log.add("MODE", t[rows], one["mode"][rows], one["mode"][rows], 0)
    for name, on, off in (("armed", _ARMED, _DISARMED), ("on_ground", _LANDED, _FLIES)):
        if one.has(name):
            rows = _begins(one[name])
            log.add("EV", t[rows], np.where(one[name][rows] > 0.0, on, off))
    for name, system in (
        ("radio_lost", _RADIO),
        ("battery_alarm", _BATTERY),
        ("station_lost", _STATION),
        ("fence_breach", _FENCE),
        ("glitching", _GPS),
        ("ekf_failed", _ESTIMATE),
    ):
        if one.has(name):
            rows = _begins(one[name])
            code = _GLITCH * one[name] if system == _GPS else one[name]
            log.add("ERR", t[rows], system, code[rows])
    if one.has("motor", "motor_count"):
        pulses = [1000.0 + 1000.0 * one["motor"][:, i] for i in range(8)]
        channels = [np.where(i < one["motor_count"], pulses[i], 0.0) if i < 8 else 0.0 for i in range(14)]
        log.add("RCOU", t, *channels)
    if one.has("battery_voltage", "battery_current", "battery_used", "battery_energy"):
        _add_battery(log, one)


def _add_battery(log: Log, one: _Recording) -> None:
    rows = _at_most(one.time, 10.0)
    volts, current, used, energy = (one[f"battery_{name}"][rows] for name in ("voltage", "current", "used", "energy"))
    resistance = one.number("battery_resistance") if one.number("SIM_BATT_CAP_AH") > 0.0 else 0.0
    capacity = one.number("BATT_CAPACITY")
    left = np.clip(np.floor(100.0 * (1.0 - used / capacity)), 0.0, 100.0) if capacity > 0.0 else 255
    log.add(
        "BAT", one.time[rows], 0, volts, volts + resistance * current, current, used, energy / 3600.0, 0.0, resistance,
        left,
    )  # fmt: skip


def _at_most(time: Array, rate: float) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Returns the first recorded row in each period of a rate [Hz]."""
    return np.unique(np.floor(time * rate + 1e-6), return_index=True)[1]


# ---- what is sensed -------------------------------------------------------------------------------------------------


def _add_sensed(log: Log, one: _Recording, origin: Origin | None) -> None:
    """Adds IMU, ORGN, POS and GPS."""
    t = one.time
    if one.has("gyro", "acceleration_neu"):
        gyro, force = one["gyro"], _specific_force(one["q"], one["acceleration_neu"] * _NED)
        every = t[1] - t[0] if len(t) > 1 else 0.0
        rate = round(1.0 / every) if every > 0.0 else 0
        columns = [*gyro.T, *force.T]
        log.add("IMU", t, 0, *columns, 0, 0, math.nan, 1, 1, rate, rate)
    if origin is None or not one.has("position_neu", "velocity_neu", "home_neu"):
        return
    place = np.array([[math.degrees(origin.latitude), math.degrees(origin.longitude), origin.altitude]])
    home = geodetic(one["home_neu"][-1:] * _NED, origin)
    for kind, at in enumerate((place, home)):
        log.add("ORGN", t[:1], kind, *at.T)
    up = one["position_neu"][:, 2]
    on_earth = geodetic(one["position_neu"] * _NED, origin)
    log.add("POS", t, *on_earth.T, up - one["home_neu"][:, 2], up)
    rows = _at_most(t, 5.0)
    north, east, rising = one["velocity_neu"][rows].T
    seconds = EPOCH // 1_000_000 - _GPS_BEGIN + _LEAP
    week, into = divmod(seconds + t[rows], _WEEK)
    log.add(
        "GPS", t[rows], 0, 6, np.floor(into * 1000.0 + 1e-6), week, 10, 1.21, *on_earth[rows].T,
        np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360.0, -rising, 0.0, 1,
    )  # fmt: skip


def _specific_force(q: Array, acceleration: Array) -> Array:
    """Returns the specific force (n, 3) [m/s2], FRD, of accelerations (n, 3), NED, at attitudes (n, 4)."""
    w, x, y, z = q.T
    n, e, d = (acceleration - (0.0, 0.0, _GRAVITY)).T
    return np.stack(
        [
            (1 - 2 * (y * y + z * z)) * n + 2 * (x * y + w * z) * e + 2 * (x * z - w * y) * d,
            2 * (x * y - w * z) * n + (1 - 2 * (x * x + z * z)) * e + 2 * (y * z + w * x) * d,
            2 * (x * z + w * y) * n + 2 * (y * z - w * x) * e + (1 - 2 * (x * x + y * y)) * d,
        ],
        axis=1,
    )


def _add_estimate(
    log: Log, signals: Signals, names: set[str], name: str, known: Mapping[str, Player], origin: Origin | None
) -> None:
    """Adds XKF1 of an estimator in the same system: an instance with the outputs of a vehicle that is none."""
    place = name.rpartition(".")[0]
    for other, player in known.items():
        if other.rpartition(".")[0] != place or player.named(Role.POSITION):
            continue
        one = _read(signals, names, other, player, _FROM_ESTIMATOR)
        if one.has(*_FROM_ESTIMATOR):
            angles, v, p = _angles(one["attitude"]), one["velocity"], one["position"]
            bias = np.degrees(one["gyro_offset_frd"])
            height = 0.0 if origin is None else origin.altitude
            log.add("XKF1", one.time, 0, *angles.T, *v.T, v[:, 2], *p.T, *bias.T, height)

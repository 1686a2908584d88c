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
from cosim_master.results.export.contents.tuning_events import tuning_events
from cosim_master.results.export.options import Options, Origin
from cosim_master.results.reading.recorded_signals import Signals, open_signals
from cosim_master.results.reading.roles import Player, players, read_manifest
from cosim_master.results.recording.packet_log import EPOCH, file_name
from cosim_master.results.storage.arrays import values_of

__all__ = ["export", "log_of"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

_GRAVITY = 9.80665
_LEAP = 18  # s by which GPS time is ahead of UTC
_GPS_BEGIN, _WEEK = 315_964_800, 604_800  # s since 1970, s
_ARMED, _DISARMED, _LANDED, _FLIES = 10, 11, 18, 28  # EV
_GPS, _GLITCH = 11, 2  # ERR, subsystem and code
_CHANGED = 65535  # index of a PARAM_VALUE that tells of a change
_SIZES = {
    "ATT": 4, "ATT.Des": 4, "RATE": 3, "RATE.Des": 3, "RATE.Out": 3, "RATE.AOut": 0, "PSC.DP": 3, "PSC.P": 3,
    "PSC.DV": 3, "PSC.TV": 3, "PSC.V": 3, "PSC.DA": 3, "PSC.TA": 3, "PSC.A": 3, "CTUN.ThI": 0, "CTUN.ABst": 0,
    "CTUN.ThH": 0, "ORGN.1": 3, "MODE": 0, "EV.10": 0, "EV.18": 0, "ERR.5": 0, "ERR.6": 0, "ERR.8": 0, "ERR.9": 0,
    "ERR.11": 0, "ERR.17": 0, "ATUN": 10, "ATDE": 3,
    "RCOU": 8, "RCOU.n": 0, "BAT.Volt": 0, "BAT.Curr": 0, "BAT.CurrTot": 0, "BAT.EnrgTot": 0,
}  # fmt: skip
"""Numbers of elements of the variables that an autopilot declares (`cosim.verdict.Logged`); 0: a scalar.

ATT and ATT.Des: quaternions w, x, y, z that rotate FRD into NED. RATE: rad/s and, .Out, shares of the greatest torque,
FRD. PSC, and ORGN.1 (home): north, east and up from the local origin, but .DP and .DV: NED; .D: on the shaped path;
.T: demanded; SI units. RATE.AOut, CTUN.ThI, CTUN.ABst (with the boost for the lean angle), CTUN.ThH: throttle, 0 to 1.
EV.10 and EV.18: whether it is armed, and on the ground. ERR.n: code of the subsystem n; ERR.11: whether GPS glitches.
ATUN: number of twitches of a tune so far, and of the last one axis, kind, target, least and greatest (angle or rate),
P, D and angle P, acceleration, with rad; ATDE: whether there is one, its angle and rate. RCOU: (pwm - 1000) / 1000, of
the first RCOU.n. BAT: V, A, mAh and J; parameters BAT.Res (V/A), BAT.cell (Ah, 0: never empty) and BAT.full (mAh).
"""
_USED = ("BAT.Volt", "BAT.Curr", "BAT.CurrTot", "BAT.EnrgTot")
_FROM_ESTIMATOR = {"XKF1.P": 3, "XKF1.V": 3, "XKF1": 4, "XKF1.G": 3}
"""Position, velocity (NED), attitude and bias of the gyro (FRD, rad/s) of an estimator."""
_NED = (1.0, 1.0, -1.0)


_FROM_FEEDFORWARD = 3
"""Number of the kind of twitches that ArduCopter has for helicopters alone; later kinds count from it on."""


@dataclass(frozen=True, slots=True)
class _Recording:
    """The recorded signals of an instance, by their places in a log; (n,) or (n, elements)."""

    time: Array
    values: Mapping[str, Array]
    player: Player

    def has(self, *names: str) -> bool:
        return all(name in self.values for name in names)

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def number(self, place: str) -> float:
        """Returns the parameter that belongs to a place; 0 if the instance has none."""
        value = self.player.parameters.get(self.player.logged.get(place, ""), 0.0)
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
            if not player.logged:
                notes.append(f"{name}: no log: its FMU does not declare which of its variables a log shows")
                continue
            autopilot = _read(signals, names, name, player, _SIZES)
            if not autopilot.has("ATT"):
                notes.append(f"{name}: no log: the run did not record its inner values, as --dataflash does")
                continue
            if len(autopilot.time) == 0:
                continue
            log = _log(run, signals, name, autopilot, known, origin)
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


def log_of(run: Path, system: int) -> tuple[bytes, int]:
    """Returns the log so far of the autopilot with a system id, in a run that may go on, and its time [s since 1970].

    Raises:
        CosimError: there is no such autopilot, or its inner values are not recorded.
    """
    known = players(run, read_manifest(run))
    with open_signals(run) as signals:
        names = set(signals.schema_arrow.names)
        for name, player in known.items():
            if player.logged and player.parameters.get(player.named(Role.SYSTEM_ID)) == system:
                autopilot = _read(signals, names, name, player, _SIZES)
                if autopilot.has("ATT") and len(autopilot.time):
                    log = _log(run, signals, name, autopilot, known, declared_origin(known, str(run)))
                    return b"".join(log.write()), EPOCH // 1_000_000
    raise CosimError(f"{run}: no autopilot with system id {system} records its inner values")


def _log(
    run: Path, signals: Signals, name: str, autopilot: _Recording, known: Mapping[str, Player], origin: Origin | None
) -> Log:
    """Returns the log of one autopilot."""
    log = Log()
    _add_words(log, run, name, autopilot)
    _add_control(log, autopilot)
    _add_state(log, autopilot)
    _add_tune(log, autopilot)
    _add_sensed(log, autopilot, origin)
    _add_estimate(log, signals, set(signals.schema_arrow.names), name, known, origin)
    return log


def _read(signals: Signals, names: set[str], instance: str, player: Player, wanted: Mapping[str, int]) -> _Recording:
    values: dict[str, Array] = {}
    for place, size in wanted.items():
        variable = f"{instance}.{player.logged.get(place, '')}"
        columns = [f"{variable}[{i + 1}]" for i in range(size)] or [variable]
        if all(one in names for one in columns):
            table = signals.read(columns=columns)
            arrays = [_floats(table.column(one)) for one in columns]
            values[place] = np.stack(arrays, axis=1) if size else arrays[0]
    time = _floats(signals.read(columns=["time"]).column(0))
    if "ATT" in values:  # before the first step it is not a rotation
        begun = np.einsum("ij,ij->i", values["ATT"], values["ATT"]) > 0.5
        time, values = time[begun], {name: array[begun] for name, array in values.items()}
    return _Recording(time, values, player)


def _floats(column: pa.ChunkedArray) -> Array:
    values: Array = values_of(column).astype(np.float64)
    return values


def _angles(q: Array) -> Array:
    """Returns roll, pitch and yaw [degrees], the last 0 to 360, of quaternions (n, 4)."""
    angles = np.degrees([euler_from_quaternion((w, x, y, z)) for w, x, y, z in q.tolist()]).reshape(-1, 3)
    angles[:, 2] %= 360.0
    return angles


# ---- words ----------------------------------------------------------------------------------------------------------


def _add_words(log: Log, run: Path, name: str, autopilot: _Recording) -> None:
    """Adds MSG (the kind of vehicle first, then STATUSTEXT), EV of AUTOTUNE, and PARM (start values, then changes)."""
    place = name.rpartition(".")[0] or name
    said: dict[tuple[float, str], None] = {(0.0, f"ArduCopter, simulated by uav-cosim ({name})"): None}
    for one in spoken(run):
        if one.who == place:
            said[(one.stamp - EPOCH * 1000) * 1e-9, one.text] = None  # once for all links
    log.add("MSG", np.array([t for t, _ in said]), texts([text for _, text in said], 64))
    tuned = [*tuning_events(said)]
    if tuned:
        log.add("EV", np.array([t for t, _ in tuned]), np.array([event for _, event in tuned]))
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
    if one.has("ATT.Des"):
        demanded, attitude = _angles(one["ATT.Des"]), _angles(one["ATT"])
        log.add("ATT", t, *(of[:, i] for i in range(3) for of in (demanded, attitude)), 3)
    if one.has("RATE.Des", "RATE", "RATE.Out", "PSC.TA", "PSC.A", "RATE.AOut"):
        wanted, rates, torque = np.degrees(one["RATE.Des"]), np.degrees(one["RATE"]), one["RATE.Out"]
        axes = [column for i in range(3) for column in (wanted[:, i], rates[:, i], torque[:, i])]
        up = [100.0 * one[name][:, 2] for name in ("PSC.TA", "PSC.A")]
        log.add("RATE", t, *axes, *up, one["RATE.AOut"])
    path = ("PSC.DP", "PSC.DV")
    followed = ("PSC.P", "PSC.TV", "PSC.V", "PSC.DA")
    if one.has(*path, *followed, "PSC.TA", "PSC.A"):
        for i, axis in enumerate("NED"):
            place, target_v, v, desired_a, target_a, a = (
                one[name][:, i] * _NED[i] for name in (*followed, "PSC.TA", "PSC.A")
            )
            wanted_p, wanted_v = (one[name][:, i] for name in path)
            log.add(f"PSC{axis}", t, wanted_p, place, wanted_v, target_v, v, desired_a, target_a, a)
    throttle = ("CTUN.ThI", "CTUN.ABst", "RATE.AOut", "CTUN.ThH")
    if one.has(*throttle, *path, "PSC.P", "PSC.V", "ORGN.1"):
        given, boosted, out, hover = (one[name] for name in throttle)
        home = one["ORGN.1"][:, 2]
        wanted, height = -one["PSC.DP"][:, 2] - home, one["PSC.P"][:, 2] - home
        climb, rate = -one["PSC.DV"][:, 2], one["PSC.V"][:, 2]
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
    if one.has("MODE"):
        rows = _begins(one["MODE"])
        rows[0] = True
        log.add("MODE", t[rows], one["MODE"][rows], one["MODE"][rows], 0)
    for place, on, off in (("EV.10", _ARMED, _DISARMED), ("EV.18", _LANDED, _FLIES)):
        if one.has(place):
            rows = _begins(one[place])
            log.add("EV", t[rows], np.where(one[place][rows] > 0.0, on, off))
    for place in _SIZES:
        message, _, system = place.partition(".")
        if message == "ERR" and one.has(place):
            rows = _begins(one[place])
            code = one[place] * (_GLITCH if int(system) == _GPS else 1)
            log.add("ERR", t[rows], int(system), code[rows])
    if one.has("RCOU", "RCOU.n"):
        pulses = [1000.0 + 1000.0 * one["RCOU"][:, i] for i in range(8)]
        channels = [np.where(i < one["RCOU.n"], pulses[i], 0.0) if i < 8 else 0.0 for i in range(14)]
        log.add("RCOU", t, *channels)
    if one.has(*_USED):
        _add_battery(log, one)


def _add_battery(log: Log, one: _Recording) -> None:
    rows = _at_most(one.time, 10.0)
    volts, current, used, energy = (one[place][rows] for place in _USED)
    ohms = one.number("BAT.Res") if one.number("BAT.cell") > 0.0 else 0.0
    capacity = one.number("BAT.full")
    left = np.clip(np.floor(100.0 * (1.0 - used / capacity)), 0.0, 100.0) if capacity > 0.0 else 255
    log.add(
        "BAT", one.time[rows], 0, volts, volts + ohms * current, current, used, energy / 3600.0, 0.0, ohms,
        left,
    )  # fmt: skip


def _add_tune(log: Log, one: _Recording) -> None:
    """Adds ATUN and ATDE of AUTOTUNE."""
    if not one.has("ATUN", "ATDE"):
        return
    rows = _begins(one["ATUN"][:, 0])
    if rows.any():
        _, axis, kind, *measured, p, d, angle, acceleration = one["ATUN"][rows].T
        step = kind + (kind >= _FROM_FEEDFORWARD)
        log.add(
            "ATUN", one.time[rows], axis, step, *np.degrees(measured), p, d, angle, 100.0 * np.degrees(acceleration)
        )
    rows = one["ATDE"][:, 0] > 0.0
    if rows.any():
        log.add("ATDE", one.time[rows], *np.degrees(one["ATDE"][rows, 1:]).T)


def _at_most(time: Array, rate: float) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Returns the first recorded row in each period of a rate [Hz]."""
    return np.unique(np.floor(time * rate + 1e-6), return_index=True)[1]


# ---- what is sensed -------------------------------------------------------------------------------------------------


def _add_sensed(log: Log, one: _Recording, origin: Origin | None) -> None:
    """Adds IMU, ORGN, POS and GPS."""
    t = one.time
    if one.has("RATE", "PSC.A"):
        gyro, force = one["RATE"], _specific_force(one["ATT"], one["PSC.A"] * _NED)
        every = t[1] - t[0] if len(t) > 1 else 0.0
        rate = round(1.0 / every) if every > 0.0 else 0
        columns = [*gyro.T, *force.T]
        log.add("IMU", t, 0, *columns, 0, 0, math.nan, 1, 1, rate, rate)
    if origin is None or not one.has("PSC.P", "PSC.V", "ORGN.1"):
        return
    place = np.array([[math.degrees(origin.latitude), math.degrees(origin.longitude), origin.altitude]])
    home = geodetic(one["ORGN.1"][-1:] * _NED, origin)
    for kind, at in enumerate((place, home)):
        log.add("ORGN", t[:1], kind, *at.T)
    up = one["PSC.P"][:, 2]
    on_earth = geodetic(one["PSC.P"] * _NED, origin)
    log.add("POS", t, *on_earth.T, up - one["ORGN.1"][:, 2], up)
    rows = _at_most(t, 5.0)
    north, east, rising = one["PSC.V"][rows].T
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
    """Adds XKF1 of an estimator in the same system."""
    place = name.rpartition(".")[0]
    for other, player in known.items():
        if other.rpartition(".")[0] != place:
            continue
        one = _read(signals, names, other, player, _FROM_ESTIMATOR)
        if one.has(*_FROM_ESTIMATOR):
            angles, v, p = _angles(one["XKF1"]), one["XKF1.V"], one["XKF1.P"]
            bias = np.degrees(one["XKF1.G"])
            height = 0.0 if origin is None else origin.altitude
            log.add("XKF1", one.time, 0, *angles.T, *v.T, v[:, 2], *p.T, *bias.T, height)

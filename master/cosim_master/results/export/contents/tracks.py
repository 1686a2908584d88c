"""The motion of all vehicles of a recording, for formats of poses: in local frames, and on Earth.

Recordings have NED and FRD. ROS and Foxglove use ENU and FLU (REP 103): `enu` and `orientation` convert.
Geodetic positions are those of the project's autopilot (`cosim.frames.geodetic_from_local`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim.frames import geodetic_from_local
from cosim.naming import POSITION
from cosim.verdict import Role
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.options import Options, Origin
from cosim_master.results.reading.recorded_signals import Signals, open_signals
from cosim_master.results.reading.roles import UNKNOWN, Player, parts, players, read_manifest
from cosim_master.results.recording.packet_log import EPOCH
from cosim_master.results.storage.arrays import values_of

__all__ = ["Track", "Tracks", "declared_origin", "enu", "frd_to_flu", "geodetic", "orientation", "read_tracks"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

_HALF = np.sqrt(0.5)
_ORIGIN = (Role.ORIGIN_LATITUDE, Role.ORIGIN_LONGITUDE, Role.ORIGIN_ALTITUDE)


@dataclass(frozen=True, slots=True)
class Track:
    """The motion of one vehicle; None for values that were not recorded.

    Attributes:
        name: of the drone.
        signal: the position in the recording, "component.variable", without the index of its elements.
        position: (n, 3) m, NED from the local origin.
        attitude: (n, 4) unit quaternion w, x, y, z that rotates FRD into NED.
        velocity: (n, 3) m/s over ground, NED.
        body_rates: (n, 3) rad/s, FRD.
    """

    name: str
    signal: str
    position: Array
    attitude: Array | None = None
    velocity: Array | None = None
    body_rates: Array | None = None


@dataclass(frozen=True, slots=True)
class Tracks:
    """The motion of all vehicles.

    Attributes:
        time: (n,) s, the recorded instants.
        vehicles: in natural order of their names.
        origin: the local origin; None if it is not known.
    """

    time: Array
    vehicles: tuple[Track, ...]
    origin: Origin | None

    @property
    def stamps(self) -> list[int]:
        """The recorded instants in ns since 1970, on the clock of the run's .tlog files."""
        return [int(t) for t in EPOCH * 1000 + np.rint(self.time * 1e9).astype(np.int64)]

    @property
    def dates(self) -> list[datetime]:
        """The recorded instants as dates, to 1 us."""
        start = datetime.fromtimestamp(EPOCH // 1_000_000, UTC)
        return [start + timedelta(microseconds=float(t)) for t in np.rint(self.time * 1e6)]

    def thinned(self, rate: float) -> Tracks:
        """Returns every n-th recorded instant, at most `rate` per second, and the last one."""
        n = len(self.time)
        span = float(self.time[-1] - self.time[0])
        every = max(1, int(np.ceil((n - 1) / (span * rate) - 1e-9))) if span > 0.0 else 1
        rows = np.unique(np.append(np.arange(0, n, every), n - 1))
        kept = tuple(
            Track(
                one.name,
                one.signal,
                *(
                    None if of is None else of[rows]
                    for of in (one.position, one.attitude, one.velocity, one.body_rates)
                ),  # type: ignore[arg-type]
            )
            for one in self.vehicles
        )
        return Tracks(self.time[rows], kept, self.origin)


def read_tracks(run: Path, options: Options, *, on_earth: bool = False) -> Tracks:
    """Returns the motion of all vehicles of a run.

    Args:
        run: folder of the run.
        options: the local origin, if it is not the declared one.
        on_earth: an unknown origin is an error.

    Raises:
        CosimError: no vehicle's position was recorded, or the origin is ambiguous or missing.
    """
    manifest = read_manifest(run)
    known = players(run, manifest)
    with open_signals(run) as signals:
        units = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in signals.schema_arrow}
        found = [one for one in parts(units, known) if one.vehicle]
        time = values_of(signals.read(columns=["time"]).column(0))
        if not found or not len(time):
            what = "no instant" if found else f"no component with {POSITION}[1..3] in m"
            raise CosimError(f"{run / 'signals.parquet'}: nothing to export: the run recorded {what}")
        vehicles = tuple(
            _track(one.name, one.vehicle, known.get(one.vehicle, UNKNOWN), units, signals) for one in found
        )
    origin = options.origin or declared_origin(known, str(run))
    if on_earth and origin is None:
        roles = ", ".join(role.value for role in _ORIGIN[:2])
        raise CosimError(
            f"{run}: no geodetic positions: no FMU of the run declares the local origin ({roles}; docs/verdict.md); "
            "try --origin LATITUDE,LONGITUDE,ALTITUDE"
        )
    return Tracks(time, vehicles, origin)


def _track(name: str, vehicle: str, player: Player, units: Mapping[str, str], signals: Signals) -> Track:
    def columns(variable: str, size: int) -> Array | None:
        wanted = [f"{vehicle}.{variable}[{i + 1}]" for i in range(size)]
        if not variable or not all(column in units for column in wanted):
            return None
        table = signals.read(columns=wanted)
        return np.stack([values_of(table.column(column)).astype(np.float64) for column in wanted], axis=1)

    position = columns(player.position, 3)
    assert position is not None
    return Track(
        name,
        f"{vehicle}.{player.position}",
        position,
        columns(player.attitude, 4),
        columns(player.named(Role.VELOCITY), 3),
        columns(player.named(Role.ANGULAR_VELOCITY), 3),
    )


def declared_origin(known: Mapping[str, Player], run: str) -> Origin | None:
    """Returns the origin that instances declare; the altitude is 0 where none declares it.

    Args:
        known: the instances.
        run: the run, for messages.

    Raises:
        CosimError: two instances declare different origins.
    """
    places: dict[tuple[float, float], str] = {}
    altitudes: dict[float, str] = {}
    for name, player in known.items():
        names = [player.named(role) for role in _ORIGIN]
        values = [player.parameters.get(variable) if variable else None for variable in names]
        if isinstance(values[0], (int, float)) and isinstance(values[1], (int, float)):
            places.setdefault((float(values[0]), float(values[1])), name)
            if isinstance(values[2], (int, float)):
                altitudes.setdefault(float(values[2]), name)
    for differing in (places, altitudes):
        if len(differing) > 1:
            one, other = list(differing.values())[:2]
            raise CosimError(
                f"{run}: {one} and {other} declare different local origins; "
                "--origin LATITUDE,LONGITUDE,ALTITUDE chooses one"
            )
    if not places:
        return None
    return Origin(*next(iter(places)), next(iter(altitudes), 0.0))


def geodetic(position: Array, origin: Origin) -> Array:
    """Returns latitude and longitude [degrees] and altitude above mean sea level [m] of positions (n, 3), NED."""
    place = (origin.latitude, origin.longitude, origin.altitude)
    found = np.array([geodetic_from_local(n, e, d, *place) for n, e, d in position.tolist()]).reshape(-1, 3)
    return np.concatenate([np.degrees(found[:, :2]), found[:, 2:]], axis=1)


def enu(vectors: Array) -> Array:
    """Returns vectors (n, 3) in ENU instead of NED."""
    turned: Array = vectors[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
    return turned


def frd_to_flu(vectors: Array) -> Array:
    """Returns vectors (n, 3) in FLU instead of FRD."""
    turned: Array = vectors * (1.0, -1.0, -1.0)
    return turned


def orientation(attitude: Array) -> Array:
    """Returns unit quaternions (n, 4) x, y, z, w that rotate FLU into ENU, from w, x, y, z that rotate FRD into NED.

    q' = r q s, with r = (0, 1, 1, 0) / sqrt(2), which exchanges NED and ENU, and s = (0, 1, 0, 0): FRD and FLU.
    """
    w, x, y, z = attitude.T
    # q s = (-x, w, z, -y)
    a, b, c, d = -x, w, z, -y
    # r (a, b, c, d) = ((-b - c), (a + d), (a - d), (c - b)) / sqrt(2)
    turned: Array = _HALF * np.stack([a + d, a - d, c - b, -b - c], axis=1)
    return turned


def names_for_topics(names: Sequence[str]) -> list[str]:
    """Returns the names of vehicles as ROS allows them in topics: letters, digits and _, all different."""
    found: list[str] = []
    for given in names:
        name = "/".join(
            part if part[:1].isalpha() else f"v{part}"
            for part in "".join(c if c.isascii() and (c.isalnum() or c in "._") else "_" for c in given).split(".")
        )
        unique, n = name, 2
        while unique in found:
            unique, n = f"{name}_{n}", n + 1
        found.append(unique)
    return found

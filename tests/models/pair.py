"""A vehicle and a small autopilot stepped together without a master, with a ground station made of pymavlink."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model
from cosim.kernel import PLAIN
from tests.models.copter import FEW, Decoder, set_values
from tests.models.shipped_kernels import Loop, joined, kernels, part

MOTION = ("position", "velocity", "attitude", "angular_velocity", "specific_force")
ACCEPTED, DENIED, UNSUPPORTED, FAILED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
    mavlink.MAV_RESULT_FAILED,
)
LATITUDE, LONGITUDE, ALTITUDE = -35.363262, 149.165237, 584.0
"""The local origin, degrees and m."""
METRES_PER_DEGREE = 111318.845


def degrees_of(north: float, east: float) -> tuple[int, int]:
    """Latitude and longitude in degE7 of a place near the origin, by ArduPilot's flat Earth."""
    longitude = LONGITUDE + east / METRES_PER_DEGREE / math.cos(math.radians(LATITUDE))
    return round(1e7 * (LATITUDE + north / METRES_PER_DEGREE)), round(1e7 * longitude)


class Pair:
    """A flight, a drive or a voyage in the making. The vehicle may take several steps in one of the autopilot."""

    def __init__(
        self,
        vehicle: type[Model],
        autopilot: type[Model],
        values: dict[str, Any] | None = None,
        pilot: dict[str, Any] | None = None,
        wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.v, self.m = vehicle.record(), autopilot.record()
        set_values(self.v, values or {})
        set_values(self.m, pilot or {})
        self.v["wind"] = wind
        self.h, self.inner = autopilot.step_size, vehicle.step_size
        self._models = autopilot, vehicle
        start, self._move = kernels(vehicle)
        assert start(self.v) == 0
        begin, self._steer = kernels(autopilot)
        self._pairs = joined(self.m, self.v, MOTION)
        self._motors, self._commands = part(self.m, "motor"), part(self.v, "motor")
        self._before = self._motors.copy()
        self._given, self._got = part(self.m, "mavlink_rx_len"), part(self.m, "mavlink_tx_len")
        self._connect()
        self.m["airframe"] = self.v["airframe"]
        assert begin(self.m) == 0
        self.step = 0
        self.waiting = b""
        self.heard: list[Any] = []
        self._decode = Decoder()
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def _connect(self) -> None:
        for to, of in self._pairs:
            to[:] = of

    @property
    def time(self) -> float:
        return self.step * self.h

    @property
    def place(self) -> list[float]:
        return [float(x) for x in self.v["position"]]

    def one_step(self) -> None:
        self._connect()
        self._given[0] = len(self.waiting)
        if self.waiting:
            self.m["mavlink_rx"][: len(self.waiting)] = np.frombuffer(self.waiting, dtype=np.uint8)
            self.waiting = b""
        self._before[:] = self._motors
        time = self.time
        assert self._steer(self.m, time, self.h) == 0
        self._commands[:] = self._before
        for k in range(round(self.h / self.inner)):
            assert self._move(self.v, time + k * self.inner, self.inner) == 0
        self.step += 1
        if used := self._got[0]:
            self.heard += self._decode(self.m["mavlink_tx"][:used].tobytes())

    def go_on_from(self, other: Pair) -> None:
        """Takes the state of another pair of the same models."""
        for record, former in ((self.v, other.v), (self.m, other.m)):
            for name in record.dtype.names:
                record[name] = former[name]
        self.step = other.step

    def hold(self, duration: float, channels: Sequence[int], every: float) -> None:
        """Overrides the first channels [us] again and again, `every` s; those with 0 are left alone."""
        end = self.time + duration
        while self.time < end - 1e-9:
            self.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels, *[0] * (8 - len(channels))))
            self.until(min(self.time + every, end))

    def until(self, time: float) -> None:
        while self.time < time - 1e-9:
            count = self._steps_to(time)
            if PLAIN or self.waiting or count < FEW:
                self.one_step()
                continue
            loop = Loop(*self._models, self.m, self.v, self._pairs, ("mavlink",))
            made, packets = loop.fly(self.step, count)
            for _, _, data in packets:
                self.heard += self._decode(data)
            self.step += made

    def _steps_to(self, time: float) -> int:
        count = int((time - self.time) / self.h)
        while (self.step + count) * self.h < time - 1e-9:
            count += 1
        while (self.step + count - 1) * self.h >= time - 1e-9:
            count -= 1
        return count

    def send(self, *messages: Any) -> None:
        for message in messages:
            self.waiting += message.pack(self.station)

    def ask(self, command: int, *p: float) -> int:
        """Sends a command; returns the result."""
        parameters = (*p, *(0.0,) * (7 - len(p)))
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *parameters))
        return self._answer(command)

    def reposition(self, north: float, east: float, height: float, flags: float = 0.0) -> int:
        lat, lon = degrees_of(north, east)
        command = mavlink.MAV_CMD_DO_REPOSITION
        self.send(mavlink.MAVLink_command_int_message(1, 1, 6, command, 0, 0, -1, flags, 0, 0, lat, lon, height))
        return self._answer(command)

    def _answer(self, command: int) -> int:
        before = len(self.heard)
        self.one_step()
        (answer,) = [m for m in self.heard[before:] if m.get_type() == "COMMAND_ACK" and m.command == command]
        assert (answer.target_system, answer.target_component) == (255, 190)
        return int(answer.result)

    def last(self, kind: str) -> Any:
        return next(m for m in reversed(self.heard) if m.get_type() == kind)

    def go(self, north: float, east: float, height: float) -> None:
        """Sends a position by SET_POSITION_TARGET_LOCAL_NED."""
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0xDF8, north, east, -height, 0, 0, 0, 0, 0, 0, 0, 0
            )
        )

    def move(self, vn: float, ve: float, vd: float) -> None:
        """Sends a velocity by SET_POSITION_TARGET_LOCAL_NED."""
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDC7, 0, 0, 0, vn, ve, vd, 0, 0, 0, 0, 0)
        )

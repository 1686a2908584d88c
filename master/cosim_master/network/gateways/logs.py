"""Answers a ground station's requests for the log of an autopilot: LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_ERASE, _END.

The master writes the logs, so it answers in the autopilot's place, as ArduPilot does: for a vehicle that is not armed,
but has been; one log, number 1, from the beginning of the run to the latest list; up to 40 pieces of 90 bytes at once.
Requests while armed go on to the autopilot, which refuses them. After LOG_ERASE, there is no log until the vehicle has
been armed again. The answers do not use the simulated radio, and nothing of this is in the recording: requests do not
enter the network.

Source: the MAVLink guide, "Log"; ArduPilot, AP_Logger_MAVLinkLogTransfer.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from cosim.messages import (
    HEARTBEAT,
    HEARTBEAT_BASE_MODE,
    LOG_DATA,
    LOG_ENTRY,
    LOG_ERASE,
    LOG_REQUEST_DATA,
    LOG_REQUEST_END,
    LOG_REQUEST_LIST,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_MODE_FLAG_SAFETY_ARMED,
)
from cosim_master.diagnostics.errors import CosimError
from cosim_master.network.gateways.packing import mavlink2, opened

__all__ = ["LogRequests", "WriteLog"]

WriteLog = Callable[[int], tuple[bytes, int]]
"""Returns the log of the autopilot with a system id, and its time [s since 1970]; a CosimError: it has none."""
_PIECE, _AT_ONCE = 90, 40
# Payloads on the wire; a request's addressee are two bytes at the given place.
_ENTRY, _DATA, _ASKED = struct.Struct("<IIHHH"), struct.Struct("<IHB90s"), struct.Struct("<IIH")
_ADDRESSEE = {LOG_REQUEST_LIST: 4, LOG_REQUEST_DATA: 10, LOG_ERASE: 0, LOG_REQUEST_END: 0}


@dataclass(slots=True)
class _Vehicle:
    """What is known of an autopilot, and its transfer."""

    armed: bool = True
    logging: bool = False  # armed since the start, or since the last LOG_ERASE
    listing: Future[tuple[bytes, int]] | None = None
    log: bytes = b""
    at: int = 0
    left: int = -1  # bytes; negative: nothing is asked for
    sequence: int = 0

    def send(self, system: int, message: int, payload: bytes) -> bytes:
        """Returns a packet of this autopilot."""
        self.sequence = (self.sequence + 1) % 256
        return mavlink2(self.sequence, system, MAV_COMP_ID_AUTOPILOT1, message, payload)


class LogRequests:
    """The requests that come through one gateway.

    Args:
        write: writes a log.
        thread: in which it is called.
    """

    def __init__(self, write: WriteLog, thread: ThreadPoolExecutor) -> None:
        self._write, self._thread = write, thread
        self._vehicles: dict[int, _Vehicle] = {}

    def hear(self, packets: Sequence[bytes]) -> None:
        """Takes note of packets from vehicles: whether they are armed."""
        for packet in map(opened, packets):
            if packet.message == HEARTBEAT and packet.component == MAV_COMP_ID_AUTOPILOT1:
                vehicle = self._vehicles.setdefault(packet.system, _Vehicle())
                vehicle.armed = bool(packet.payload[HEARTBEAT_BASE_MODE] & MAV_MODE_FLAG_SAFETY_ARMED)
                vehicle.logging = vehicle.logging or vehicle.armed

    def take(self, packets: Sequence[bytes]) -> list[bytes]:
        """Takes the requests that are answered here out of a station's packets; returns the others."""
        return [packet for packet in packets if not self._took(packet)]

    def _took(self, packet: bytes) -> bool:
        asked = opened(packet)
        if asked.message not in _ADDRESSEE:
            return False
        system, component = asked.payload[_ADDRESSEE[asked.message] :][:2]
        vehicle = self._vehicles.get(system)
        if vehicle is None or vehicle.armed or component not in (0, MAV_COMP_ID_AUTOPILOT1):
            return False
        if asked.message == LOG_REQUEST_LIST:
            if vehicle.listing is None:
                vehicle.listing = self._thread.submit(self._write, system)
        elif asked.message == LOG_REQUEST_DATA:
            offset, count, number = _ASKED.unpack_from(asked.payload)
            vehicle.at = min(offset, len(vehicle.log))
            vehicle.left = min(count, len(vehicle.log) - vehicle.at) if number == 1 and vehicle.log else -1
        else:
            vehicle.left = -1
            if asked.message == LOG_ERASE:
                vehicle.logging, vehicle.log = False, b""
        return True

    def answers(self) -> list[bytes]:
        """Returns the packets that are due."""
        due = []
        for system, vehicle in self._vehicles.items():
            if vehicle.listing is not None and vehicle.listing.done():
                due.append(vehicle.send(system, LOG_ENTRY, _listed(vehicle, vehicle.listing)))
                vehicle.listing = None
            for _ in range(_AT_ONCE):
                if vehicle.left < 0 or vehicle.armed:
                    break
                due.append(vehicle.send(system, LOG_DATA, _piece(vehicle)))
        return due


def _listed(vehicle: _Vehicle, listing: Future[tuple[bytes, int]]) -> bytes:
    """Keeps the log that has been written; returns its LOG_ENTRY, of number 0 if there is none."""
    try:
        log, when = listing.result()
    except CosimError:
        log, when = b"", 0
    if not log or not vehicle.logging:
        return _ENTRY.pack(0, 0, 0, 0, 0)
    vehicle.log = log
    return _ENTRY.pack(when, len(log), 1, 1, 1)


def _piece(vehicle: _Vehicle) -> bytes:
    """Returns the next LOG_DATA; the last one has fewer than 90 bytes or completes the request."""
    count = min(_PIECE, vehicle.left)
    payload = _DATA.pack(vehicle.at, 1, count, vehicle.log[vehicle.at : vehicle.at + count])
    vehicle.at += count
    vehicle.left = vehicle.left - count if count == _PIECE and vehicle.left > count else -1
    return payload

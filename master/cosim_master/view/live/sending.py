"""Sends a drone of a run to a place, as a ground station does: DO_REPOSITION in a COMMAND_INT, through a gateway.

The command asks for GUIDED mode, and the drone answers with a COMMAND_ACK. A controller of its own, such as a law in an
agent, may send it elsewhere afterwards.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

from cosim import messages
from cosim.dialect import CRC_EXTRA, MESSAGE_IDS
from cosim.frames import geodetic_from_local
from cosim.verdict import Role
from cosim_master.network.gateways.gateways import autopilots_of
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.results.reading.roles import Player
from cosim_master.system.settings.network import Network
from cosim_master.view.live.traffic import LiveTraffic
from cosim_master.view.traffic import packet_at

__all__ = ["Sending", "command_int"]

_SYSTEM, _COMPONENT = 255, messages.MAV_COMP_ID_MISSIONPLANNER
"""Those of a ground station."""
_ORIGIN = (Role.ORIGIN_LATITUDE, Role.ORIGIN_LONGITUDE, Role.ORIGIN_ALTITUDE)
_RESULTS = {
    getattr(messages, name): name.removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for name in dir(messages)
    if name.startswith("MAV_RESULT_")
}


class Sending:
    """The drones that can be sent somewhere, and the last answer.

    Args:
        network: nodes of the run.
        known: the instances and their roles.
        traffic: the packets of the run, from which the system ids are known; None: they are not recorded.
        mailbox: takes the packets.

    Attributes:
        said: number and text of the last message for the page.
    """

    def __init__(
        self, network: Network, known: Mapping[str, Player], traffic: LiveTraffic | None, mailbox: Mailbox
    ) -> None:
        self._network, self._known, self._traffic, self._mailbox = network, known, traffic, mailbox
        self._sent = 0
        self.said: tuple[int, str] = (0, "")
        mailbox.answered = self._answered

    def send(self, drone: str, north: float, east: float, down: float) -> None:
        """Sends a drone to a place, m NED from the local origin; `said` has the reason if that is not possible."""
        try:
            packet = self._packet(drone, north, east, down)
        except ValueError as error:
            self._say(f"{drone} cannot be sent there: {error}")
            return
        self._mailbox.post(packet)
        self._say(f"{drone}: sent to {north:.1f} m north, {east:.1f} m east, {-down:.1f} m high")

    def _say(self, text: str) -> None:
        self.said = (self.said[0] + 1, text)

    def _packet(self, drone: str, north: float, east: float, down: float) -> bytes:
        """Returns the command. Raises ValueError with the reason if it cannot be sent."""
        if self._mailbox.refusal:
            raise ValueError(self._mailbox.refusal)
        if not all(math.isfinite(x) and abs(x) < 1e6 for x in (north, east, down)):
            raise ValueError("it is too far away")
        system = self._system_of(drone)
        latitude, longitude, altitude = geodetic_from_local(north, east, down, *self._origin(drone))
        x, y = (round(math.degrees(angle) * 1e7) for angle in (latitude, longitude))
        self._sent += 1
        return command_int(self._sent % 256, system, x, y, altitude)

    def _system_of(self, drone: str) -> int:
        if self._traffic is None:
            raise ValueError("this run records no packets, from which its system id would be known")
        node = next((node for node in self._network.nodes if node.name == self._traffic.node_of(drone)), None)
        autopilots = [] if node is None else autopilots_of(node)
        if not autopilots:
            raise ValueError("it has no autopilot with packet ports")
        systems = self._traffic.systems()
        system = systems.get(autopilots[0].name, 0)
        if not system:
            raise ValueError("its autopilot has not sent anything yet")
        same = [e.name for n in self._network.nodes if n is not node for e in autopilots_of(n)]
        if shared := [name for name in same if systems.get(name) == system]:
            raise ValueError(f"its system id, {system}, is also that of {shared[0]}")
        return system

    def _origin(self, drone: str) -> tuple[float, float, float]:
        """Returns latitude and longitude [rad] and altitude [m] of the local origin, as the drone's FMUs declare it."""
        assert self._traffic is not None
        inside = f"{self._traffic.node_of(drone)}."
        found: dict[Role, float] = {}
        for _, player in sorted(self._known.items(), key=lambda one: not one[0].startswith(inside)):
            for role in _ORIGIN:
                value = player.parameters.get(player.named(role))
                if isinstance(value, (int, float)):
                    found.setdefault(role, float(value))
        if not {*_ORIGIN[:2]} <= found.keys():
            raise ValueError("no FMU of the run declares the local origin (OriginLatitude, OriginLongitude)")
        return found[_ORIGIN[0]], found[_ORIGIN[1]], found.get(_ORIGIN[2], 0.0)

    def _answered(self, packets: Sequence[bytes]) -> None:
        """Takes the packets for the ground station, in the thread of the run."""
        for packet in packets:
            (system, _, _, message), payload, _ = packet_at(packet, 0)
            if message == messages.COMMAND_ACK and self._traffic is not None:
                command, result = struct.unpack("<HB", payload[:3].ljust(3, b"\0"))
                if command == messages.MAV_CMD_DO_REPOSITION:
                    names = [name for name, one in self._traffic.systems().items() if one == system]
                    drone = names[0].rpartition(".")[0] or names[0] if names else f"system {system}"
                    self._say(f"{drone}: {_RESULTS.get(result, f'result {result}')}")


def command_int(sequence: int, system: int, x: int, y: int, altitude: float) -> bytes:
    """Returns the packet (MAVLink 2) that sends an autopilot to a place.

    Args:
        sequence: number of the packet.
        system: system id of the autopilot.
        x, y: latitude and longitude, 1e-7 degrees.
        altitude: above mean sea level, m.
    """
    flags = float(messages.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
    payload = struct.pack(
        "<4fiifHBBBBB", -1.0, flags, 0.0, math.nan, x, y, altitude, messages.MAV_CMD_DO_REPOSITION,
        system, messages.MAV_COMP_ID_AUTOPILOT1, messages.MAV_FRAME_GLOBAL_INT, 0, 0,
    ).rstrip(b"\0")  # fmt: skip
    number = messages.COMMAND_INT
    head = struct.pack("<7B", len(payload), 0, 0, sequence, _SYSTEM, _COMPONENT, number & 0xFF)
    body = head + (number >> 8).to_bytes(2, "little") + payload
    extra = int(CRC_EXTRA[number == MESSAGE_IDS][0])
    return b"\xfd" + body + _crc(body + bytes([extra])).to_bytes(2, "little")


def _crc(data: bytes) -> int:
    """Returns MAVLink's checksum, CRC-16/MCRF4XX."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x8408 if crc & 1 else crc >> 1
    return crc

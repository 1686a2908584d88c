"""Sends a drone of a run to a place, as a ground station does: DO_REPOSITION in a COMMAND_INT, through a gateway.

The command asks for GUIDED mode, and the drone answers with a COMMAND_ACK. A controller of its own, such as a law in an
agent, may send it elsewhere afterwards.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

from cosim import messages
from cosim.frames import geodetic_from_local
from cosim.verdict import Role
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.results.reading.roles import Player
from cosim_master.system.settings.network import Network
from cosim_master.view.live.ground_station import GroundStation, near
from cosim_master.view.live.traffic import LiveTraffic
from cosim_master.view.traffic import packet_at

__all__ = ["Sending", "reposition"]

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
        self._known, self._traffic = known, traffic
        self._station = GroundStation(network, traffic, mailbox, messages.MAV_COMP_ID_MISSIONPLANNER)
        self.said: tuple[int, str] = (0, "")
        mailbox.answered = self._answered

    def send(self, drone: str, north: float, east: float, down: float) -> None:
        """Sends a drone to a place, m NED from the local origin; `said` has the reason if that is not possible."""
        try:
            self._command(drone, north, east, down)
        except ValueError as error:
            self._say(f"{drone} cannot be sent there: {error}")
            return
        self._say(f"{drone}: sent to {north:.1f} m north, {east:.1f} m east, {-down:.1f} m high")

    def _say(self, text: str) -> None:
        self.said = (self.said[0] + 1, text)

    def _command(self, drone: str, north: float, east: float, down: float) -> None:
        """Sends the command. Raises ValueError with the reason if it cannot be sent."""

        def payload(system: int) -> bytes:
            if not near((north, east, down)):
                raise ValueError("it is too far away")
            latitude, longitude, altitude = geodetic_from_local(north, east, down, *self._origin(drone))
            x, y = (round(math.degrees(angle) * 1e7) for angle in (latitude, longitude))
            return reposition(system, x, y, altitude)

        self._station.send(drone, messages.COMMAND_INT, payload)

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


def reposition(system: int, x: int, y: int, altitude: float) -> bytes:
    """Returns the payload of the COMMAND_INT that sends an autopilot to a place.

    Args:
        system: system id of the autopilot.
        x, y: latitude and longitude, 1e-7 degrees.
        altitude: above mean sea level, m.
    """
    flags = float(messages.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
    return struct.pack(
        "<4fiifHBBBBB", -1.0, flags, 0.0, math.nan, x, y, altitude, messages.MAV_CMD_DO_REPOSITION,
        system, messages.MAV_COMP_ID_AUTOPILOT1, messages.MAV_FRAME_GLOBAL_INT, 0, 0,
    )  # fmt: skip

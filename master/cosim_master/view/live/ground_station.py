"""Packets for drones from a ground station within the process of the run, through the mailbox of its gateway."""

from __future__ import annotations

import math
from collections.abc import Callable

from cosim_master.network.gateways.gateways import autopilots_of
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.network.gateways.packing import mavlink2
from cosim_master.system.settings.network import Network
from cosim_master.view.live.traffic import LiveTraffic

__all__ = ["GroundStation", "near"]

_SYSTEM = 255
"""That of a ground station."""


class GroundStation:
    """Sends packets to drones.

    Args:
        network: nodes of the run.
        traffic: the packets of the run, from which the system ids are known; None: they are not recorded.
        mailbox: takes the packets.
        component: component id of the sender.
    """

    def __init__(self, network: Network, traffic: LiveTraffic | None, mailbox: Mailbox, component: int) -> None:
        self._network, self._traffic, self._mailbox = network, traffic, mailbox
        self._component, self._sent = component, 0

    def send(self, drone: str, number: int, payload: Callable[[int], bytes]) -> None:
        """Sends a message to the autopilot of a drone.

        Args:
            drone: name of the drone in the page.
            number: of the message.
            payload: returns the payload for the system id of the autopilot.

        Raises:
            ValueError: with the reason why it cannot be sent.
        """
        packet = payload(self._system_of(drone))
        self._sent += 1
        self.post(mavlink2(self._sent % 256, _SYSTEM, self._component, number, packet))

    def post(self, packet: bytes) -> None:
        """Sends a packet as it is. Raises ValueError if the run takes none."""
        if self._mailbox.refusal:
            raise ValueError(self._mailbox.refusal)
        self._mailbox.post(packet)

    def _system_of(self, drone: str) -> int:
        if self._mailbox.refusal:
            raise ValueError(self._mailbox.refusal)
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


def near(values: tuple[float, ...]) -> bool:
    """Returns whether all values [m, m/s] are finite and less than 1,000 km from 0."""
    return all(math.isfinite(x) and abs(x) < 1e6 for x in values)

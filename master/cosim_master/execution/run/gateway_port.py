"""The entrance and exit for packets of gateways in a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.packets import MAX_PACKET
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.state import RunState
from cosim_master.network.radio.build import GATEWAY_BYTES, grown
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import admit
from cosim_master.network.radio.tables import FREE_PLACES, IN_FLIGHT
from cosim_master.network.radio.topology import copies

__all__ = ["GatewayPort"]

_AT_ONCE = 64
"""Packets that are admitted together."""


class GatewayPort:
    """The `Air` that gateways exchange packets with."""

    def __init__(self, state: RunState, blocks: Blocks) -> None:
        self._state, self._blocks = state, blocks
        self._crossing = np.zeros(GATEWAY_BYTES, dtype=np.uint8)

    def compile(self) -> None:
        """Compiles the kernels now; later, a real program would have to wait."""
        radio, now = self._state.radio, self._state.now
        admit(radio, self._state.plan.real_out, now, 0, np.frombuffer(b"-", dtype=np.uint8), 0)
        e = int(radio.gateways[0]["endpoint"])
        deliver(radio, now, e, self._crossing)

    def admit(self, gateway: int, packets: Sequence[bytes]) -> None:
        """Admits packets from a gateway at the current time. They are complete and have no CRC errors."""
        state = self._state
        for first in range(0, len(packets), _AT_ONCE):
            some = packets[first : first + _AT_ONCE]
            block = np.frombuffer(b"".join(some), dtype=np.uint8)
            each = copies(state.radio) if state.radio.trip.size else 0
            need = len(some) * (state.radio.endpoints.size + 1 + each)
            if need > state.radio.counters[FREE_PLACES]:
                state.radio = grown(state.radio, need)
            self._blocks.make_room(need, 2 * block.size + 64 * len(some))
            admit(state.radio, state.plan.real_out, state.now, gateway, block, block.size)

    def take(self, gateway: int) -> bytes:
        """Returns the packets that have arrived at a gateway by now."""
        state = self._state
        e = int(state.radio.gateways[gateway]["endpoint"])
        taken = []
        while self._arrived(e):
            self._blocks.make_room(0, int(state.radio.counters[IN_FLIGHT]) * (MAX_PACKET + 16))
            taken.append(self._crossing[: deliver(state.radio, state.now, e, self._crossing)].tobytes())
        return b"".join(taken)

    def _arrived(self, e: int) -> bool:
        """Returns whether a packet has reached an endpoint by now, as the kernel `queues.arrived` does for others.

        It is asked for each gateway in each exchange; the call of a kernel takes ten times as long.
        """
        radio = self._state.radio
        first = radio.endpoints["first"][e]
        return bool(first >= 0 and radio.places["arrival"][first] <= self._state.now)

    def waiting(self, gateway: int) -> int:
        """Returns the number of packets from a gateway that have not been read yet, counted once per reader."""
        return int(self._state.radio.gateways[gateway]["waiting"])

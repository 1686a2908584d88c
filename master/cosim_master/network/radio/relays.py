"""Relays: nodes that send packets on, as MAVLink routers do, so that they reach nodes out of earshot.

A router does not change packets; it learns on which link, that is, from which neighbour, a system was last heard. It
sends a packet with a target to the neighbour from which it last heard the target, and any other packet, or one whose
target it has not heard yet, to all neighbours; never back to the node from which the packet came, and not at all if the
target is on board. Each node takes only the first copy of a packet that reaches it, so that loops end, and a packet
passes at most `hops` relays.

If there are relays, packets by radio are in flight to the *air*, an endpoint behind those of all nodes, until they
reach a node. There they are taken in the order of their arrival, passed on to the endpoints of the node, and sent on.
The cable of a gateway is another link of the relay at its end, whose router treats it as it treats a neighbour: packets
from the cable are sent on, and those for systems behind the gateway, or for all, leave by it.

A relay sends by an endpoint of its own, with its own random numbers and, with a medium, its own time on the air. The
rest of the journey of a packet in flight is in `Radio.relayed`, in the row of its place; `Radio.trip` is the journey of
the packet that is being sent. All of these arrays are empty if no node relays.
"""

from __future__ import annotations

from cosim.kernel import kernel
from cosim_master.network.radio.tables import USED_EVENTS, Radio

__all__ = [
    "begin_trip",
    "begin_trip_at",
    "continue_trip",
    "first_time",
    "is_relay",
    "learn",
    "next_hop",
    "resume_trip",
    "save_trip",
    "trace_back",
]

_KEPT = 62
"""Packets of a sender before the latest one that a node remembers; older ones count as repeated."""


@kernel
def is_relay(r: Radio, n: int) -> bool:
    return bool(r.nodes[n].relay >= 0)


@kernel
def begin_trip(r: Radio, e: int, t: int) -> None:
    """Begins the journey of the next packet that endpoint `e` sends by radio, at t [ns]."""
    r.trip[0].origin = e
    r.trip[0].born = t
    r.trip[0].number = r.endpoints[e].number
    r.trip[0].via = -1
    r.trip[0].hops = 0
    first_time(r, r.endpoints[e].node, e, r.endpoints[e].number)


@kernel
def begin_trip_at(r: Radio, e: int, n: int, t: int) -> None:
    """Begins the journey of the next packet of a gateway, by its endpoint `e`, at the relay `n` that it is wired to."""
    number = r.endpoints[e].number
    r.endpoints[e].number = number + 1
    r.trip[0].origin = e
    r.trip[0].born = t
    r.trip[0].number = number
    r.trip[0].via = -1
    r.trip[0].hops = 1
    first_time(r, n, e, number)


@kernel
def continue_trip(r: Radio, place: int) -> None:
    """Continues the journey of the packet in flight in `place`, which a relay sends on."""
    r.trip[0].origin = r.relayed[place].origin
    r.trip[0].born = r.relayed[place].born
    r.trip[0].number = r.relayed[place].number
    r.trip[0].via = r.endpoints[r.places[place].sender].node
    r.trip[0].hops = r.relayed[place].hops + 1


@kernel
def save_trip(r: Radio, place: int, n: int) -> None:
    """Notes the present journey for the packet in flight in `place`, which goes to node `n`; -1: to the medium."""
    r.relayed[place].origin = r.trip[0].origin
    r.relayed[place].born = r.trip[0].born
    r.relayed[place].number = r.trip[0].number
    r.relayed[place].via = r.trip[0].via
    r.relayed[place].hops = r.trip[0].hops
    r.relayed[place].node = n


@kernel
def resume_trip(r: Radio, place: int) -> None:
    """Resumes the journey that was noted for the packet in `place`, which has left the medium."""
    r.trip[0].origin = r.relayed[place].origin
    r.trip[0].born = r.relayed[place].born
    r.trip[0].number = r.relayed[place].number
    r.trip[0].via = r.relayed[place].via
    r.trip[0].hops = r.relayed[place].hops


@kernel
def trace_back(r: Radio) -> None:
    """Notes in the latest event who sent its packet first, and when."""
    if r.settings[0].keep != 0:
        row = r.events[r.counters[USED_EVENTS] - 1]
        row["origin"] = r.trip[0].origin
        row["born"] = r.trip[0].born


@kernel
def first_time(r: Radio, n: int, origin: int, number: int) -> bool:
    """Returns whether node `n` has not yet met a packet, which endpoint `origin` sent as its `number`th; notes it."""
    row = n * (r.seen.shape[0] // r.along.size) + origin
    ahead = number - (r.seen[row, 0] - 1)
    if ahead > 0:
        r.seen[row, 1] = 1 if ahead > _KEPT else (r.seen[row, 1] << ahead) & ((1 << (_KEPT + 1)) - 1) | 1
        r.seen[row, 0] = number + 1
        return True
    if -ahead > _KEPT or (r.seen[row, 1] >> -ahead) & 1 != 0:
        return False
    r.seen[row, 1] |= 1 << -ahead
    return True


@kernel
def learn(r: Radio, n: int, system: int, neighbour: int) -> None:
    """Notes that node `n` heard a system from a neighbour."""
    r.routes[n, system] = neighbour + 1


@kernel
def next_hop(r: Radio, n: int, system: int) -> int:
    """Returns the neighbour from which node `n` last heard a system; -1 if it has not heard it or does not relay."""
    return int(r.routes[n, system]) - 1 if system != 0 and r.nodes[n].relay >= 0 else -1

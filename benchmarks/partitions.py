"""A discrete-event model of runs in parts on many hosts: efficiency and speed by number of hosts.

The model has the protocol of `execution/partitions`: each host steps a window, sends its messages, and needs those
of the window before from its peers before it may begin the next window (hidden), or those of the same window (waited
for). Costs: stepping a drone for a base step, packing and sending a message, replaying a packet, the network's one-way
time and rate; the time of each window varies by `--noise`, and one in a hundred takes five times that longer.

    line   a host has two neighbours, and only packets of the drones at its ends cross
    all    every node may hear every other: packets and positions of everybody go to everybody
    near   a broadcast with a range: a host receives what its nodes can hear, the packets of all drones of
           `--neighbours` hosts with the positions of their senders, and boxes from everybody

Part 0 also receives the recorded rows of all others, `--recorded` bytes per drone and simulated second.

    python benchmarks/partitions.py [--drones 10000 100000] [--hosts 1 4 16 64] [--step-us 0.9] [--network-us 100]
                                    [--docs docs/scale.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from report import machine, section, show, write

STEPS_PER_SECOND = 400
POSITION = 24
PACKET = 64 + 64
BOXES = 8 * 48
"""Bytes of a position, of a packet with its head, and of the boxes in which the nodes of a host are."""


@dataclass(frozen=True)
class Costs:
    """Measured costs; times in s.

    Attributes:
        step: of one drone's FMUs in one base step, on all cores of a host.
        message: packing, sending, receiving and unpacking a message.
        packet: ordering and replaying a packet that somebody here may hear.
        window: Python between two windows, without messages.
        latency, rate: of the network: one-way time, bytes/s.
        noise: standard deviation of a window's time, relative.
        packets: that a drone sends by radio per simulated second.
        recorded: bytes per drone and simulated second.
    """

    step: float
    message: float
    packet: float
    window: float
    latency: float
    rate: float
    noise: float
    packets: float
    recorded: float


def peers_of(topology: str, hosts: int, neighbours: int) -> list[list[int]]:
    """The hosts from which each host receives packets."""
    if topology == "all":
        return [[q for q in range(hosts) if q != p] for p in range(hosts)]
    reach = 1 if topology == "line" else max(1, neighbours // 2)
    return [[q for q in range(p - reach, p + reach + 1) if q != p and 0 <= q < hosts] for p in range(hosts)]


def bytes_of(topology: str, own: float, crossing: float, window: int) -> float:
    """Bytes of a message at the end of a window.

    Args:
        own: drones of a host.
        crossing: packets.
        window: base steps.
    """
    if topology == "near":
        return crossing * (PACKET + POSITION) + BOXES
    return crossing * PACKET + (own * POSITION * window if topology == "all" else 0.0)


def speed(
    drones: int, hosts: int, topology: str, costs: Costs, *, window: int, hidden: bool, neighbours: int, windows: int
) -> float:
    """Simulated seconds per wall-clock second.

    Args:
        window: base steps between two exchanges.
        windows: the number of windows that are simulated.
    """
    rng = np.random.default_rng(1)
    own = drones / hosts
    seconds = window / STEPS_PER_SECOND
    peers = peers_of(topology, hosts, neighbours)
    sent = own * costs.packets * seconds
    crossing = min(2.0, own) * costs.packets * seconds if topology == "line" else sent
    size = bytes_of(topology, own, crossing, window)
    rows = own * costs.recorded * seconds
    ready = np.zeros(hosts)  # when each host may begin the next window
    arrived = np.zeros((2, hosts))  # when the messages of a window are on the wire to their receivers
    heard = np.array([len(one) for one in peers])
    for w in range(windows):
        noise = 1.0 + costs.noise * rng.standard_normal(hosts).clip(-3, 3)
        noise *= np.where(rng.random(hosts) < 0.01, 1.0 + 5.0 * costs.noise, 1.0)
        stepping = own * costs.step * window * noise + costs.window
        # each host replays its own packets and those that it hears; a message goes to every host, most of them empty
        replay = (sent + heard * crossing) * costs.packet + 2 * (hosts - 1) * costs.message
        end = ready + stepping
        out = heard * size / costs.rate
        arrived[w % 2] = end + out + costs.latency
        needed = arrived[(w - 1) % 2 if hidden else w % 2] if w or not hidden else end
        received = np.array([max((needed[q] for q in range(hosts) if q != p), default=0.0) for p in range(hosts)])
        ready = np.maximum(end, received) + replay
        if hosts > 1:  # part 0 takes the rows of all
            ready[0] += (hosts - 1) * (rows / costs.rate + rows * 0.5e-9)
    return float(windows * seconds / ready.max())


def document(file: Path, costs: Costs, rows: Sequence[dict[str, Any]]) -> None:
    """Replaces the section of the forecast in a document: efficiency and speed by drones, topology and hosts."""
    hosts = sorted({one["hosts"] for one in rows})
    lines = [
        "## Parts of a run on many hosts: a forecast",
        "",
        "`python benchmarks/partitions.py`, a discrete-event model of the protocol. Costs, measured on two cores:",
        f"{1e6 * costs.step:g} us for a drone and base step, {1e6 * costs.message:g} us to pack, send and unpack",
        f"a message, {1e6 * costs.packet:g} us for a packet, {1e6 * costs.window:g} us of Python between windows. The",
        f"network is assumed: {1e6 * costs.latency:g} us one way, {8e-9 * costs.rate:g} Gbit/s. Efficiency: speed",
        "divided by the number of hosts and the speed of one; then times real time. `near` is a broadcast",
        "with a range: a host receives only from the six that it can hear.",
        "",
        "| drones | topology | " + " | ".join(f"{n} host{'s' if n > 1 else ''}" for n in hosts) + " |",
        "|---" * (2 + len(hosts)) + "|",
    ]
    for drones, topology in dict.fromkeys((one["drones"], one["topology"]) for one in rows):
        own = {one["hosts"]: one for one in rows if (one["drones"], one["topology"]) == (drones, topology)}
        cells = (f"{100 * own[n]['efficiency']:.0f} %, {own[n]['real_time_factor']:.3g} x" for n in hosts)
        lines.append(f"| {drones:,} | {topology} | " + " | ".join(cells) + " |")
    section(file, "forecast", "partitions", lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drones", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--hosts", type=int, nargs="+", default=[1, 4, 16, 64])
    parser.add_argument("--window", type=int, default=4, help="base steps of 2.5 ms; 4 is half of 20 ms")
    parser.add_argument("--step-us", type=float, default=0.9, help="a drone and base step, on all cores of a host")
    parser.add_argument("--message-us", type=float, default=25.0)
    parser.add_argument("--packet-us", type=float, default=0.6)
    parser.add_argument("--window-us", type=float, default=300.0)
    parser.add_argument("--network-us", type=float, default=100.0, help="one way")
    parser.add_argument("--gbit", type=float, default=10.0)
    parser.add_argument("--noise", type=float, default=0.1)
    parser.add_argument("--packets", type=float, default=6.0, help="per drone and simulated second")
    parser.add_argument("--recorded", type=float, default=240.0, help="bytes per drone and simulated second")
    parser.add_argument("--neighbours", type=int, default=6, help="hosts that a host hears, with near")
    parser.add_argument("--windows", type=int, default=400)
    parser.add_argument("--docs", type=Path, help="the document whose section is replaced")
    parser.add_argument("--json", type=Path, metavar="FILE")
    o = parser.parse_args(arguments)
    costs = Costs(
        o.step_us * 1e-6,
        o.message_us * 1e-6,
        o.packet_us * 1e-6,
        o.window_us * 1e-6,
        o.network_us * 1e-6,
        o.gbit * 1e9 / 8,
        o.noise,
        o.packets,
        o.recorded,
    )
    rows = []
    for drones in o.drones:
        alone = 1.0 / (drones * costs.step * STEPS_PER_SECOND)
        for topology in ("line", "near", "all"):
            for hosts in o.hosts:
                given = {"window": o.window, "neighbours": o.neighbours, "windows": o.windows}
                fast = speed(drones, hosts, topology, costs, hidden=True, **given)
                waited = speed(drones, hosts, topology, costs, hidden=False, **given)
                rows.append(
                    {
                        "drones": drones,
                        "topology": topology,
                        "hosts": hosts,
                        "real_time_factor": fast,
                        "efficiency": fast / alone / hosts,
                        "waited_for": waited / alone / hosts,
                    }
                )
    cells = [
        [
            str(one["drones"]),
            str(one["topology"]),
            str(one["hosts"]),
            f"{one['real_time_factor']:.2f}",
            f"{100 * float(one['efficiency']):.0f} %",
            f"{100 * float(one['waited_for']):.0f} %",
        ]
        for one in rows
    ]
    host = machine("numpy")
    columns = ["drones", "topology", "hosts", "x real time", "efficiency", "if waited for"]
    note = "a model, not a measurement; efficiency: against one host that steps all drones at the same cost per drone"
    show("Runs in parts on many hosts, modelled", host, columns, cells, note)
    if o.docs is not None:
        document(o.docs, costs, rows)
    write(o.json, host, {"benchmark": "partitions", "costs": asdict(costs), "rows": rows})


if __name__ == "__main__":
    main()

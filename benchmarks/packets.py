"""MAVLink packets: time to encode, find, decode and route one, in our kernels and with pymavlink.

GLOBAL_POSITION_INT, 10 drones on a line as `uav-cosim new` writes them. Our kernels run in compiled loops, as they do
in models and in the master; pymavlink is called as its users call it. Both read each other's bytes first. Turns
alternate; figures are medians.

    encode   values -> packet in a buffer
    find     the next packet in a buffer of a hundred, checksum verified
    decode   find, and values out of it
    route    from a drone's autopilot to its agent and to autopilot and agent of each neighbour, delivery included;
             beside it, with pymavlink, a few lines of Python: parse, look at the address, append to queues

    python benchmarks/packets.py [--json FILE]
"""

from __future__ import annotations

import argparse
import collections
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from report import machine, show, write
from timed.packets import BATCH, decode_all, encode_all, find_all, route_all

from cosim_master.network.radio.build import grown, make_radio
from cosim_master.network.radio.tables import DELIVERED, Radio
from cosim_master.stepping.layout import make_layout
from cosim_master.system.authoring.swarm.new import new_system
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import Network, network_of

ROOT = Path(__file__).resolve().parents[1]
DRONES = 10
FIELDS = (12345, 473566100, 85496900, 488000, 12500, 150, -220, 10, 9000)


class Router:
    """What routing is with pymavlink: parse, then append the bytes to the queues of those who should hear them."""

    def __init__(self, network: Network) -> None:
        self._hears = [sorted(j for j in (i - 1, i + 1) if 0 <= j < DRONES) for i in range(DRONES)]
        self._ends = [len(node.endpoints) for node in network.nodes]
        self._queues: list[list[collections.deque[bytes]]] = [
            [collections.deque() for _ in range(n)] for n in self._ends
        ]
        self._parser = mavlink.MAVLink(None)

    def route(self, packets: Sequence[bytes]) -> int:
        for i, data in enumerate(packets):
            for message in self._parser.parse_buffer(data) or ():
                to = getattr(message, "target_system", 0)
                assert to == 0  # a position is for everybody
                self._queues[i][1].append(data)
                for j in self._hears[i]:
                    for queue in self._queues[j]:
                        queue.append(data)
        received = 0
        for queues in self._queues:
            for queue in queues:
                while queue:
                    received += len(queue.popleft())
        return received


def _radio(fmus: Path) -> tuple[Network, Radio, NDArray[np.float64]]:
    with tempfile.TemporaryDirectory(prefix="uav-cosim-packets-") as folder:
        system = new_system("line", DRONES, Path(folder) / "line", fmus=fmus)
        with read_system(system) as structure:
            checked = check(structure)
            network = network_of(checked)
            layout = make_layout(checked, network)
    radio = grown(make_radio(network, layout.ports["Real"].index, keep=False), 16 * DRONES)
    radio.settings["latency"] = radio.settings["jitter"] = 0
    radio.settings["loss"], radio.settings["range"] = 0.0, np.inf
    return network, radio, np.zeros(len(layout.ports["Real"].outputs))


def contest(fmus: Path, rounds: int, scale: float) -> list[dict[str, Any]]:
    """Rows of operation and us per packet, ours and pymavlink's."""
    buffer, payload = np.zeros(64 * BATCH, np.uint8), np.zeros(255, np.uint8)
    n = encode_all(buffer, payload, 1)
    block = buffer[:n].tobytes()
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    parsed = mavlink.MAVLink(None).parse_buffer(block)
    if len(parsed) != BATCH or parsed[0].to_dict()["lat"] != FIELDS[1] or find_all(buffer, n, 1) != BATCH:
        raise RuntimeError("ours and pymavlink do not read the same packets")
    if bytes(link.global_position_int_encode(*FIELDS).pack(link)) != block[: n // BATCH]:
        raise RuntimeError("ours and pymavlink do not write the same packet")
    network, radio, reals = _radio(fmus)
    router = Router(network)
    ends = [endpoint.instance for node in network.nodes for endpoint in node.endpoints]
    senders = np.array([i for i, name in enumerate(ends) if name.endswith("autopilot")], dtype=np.int64)
    texts = []
    for i in range(DRONES):
        own = mavlink.MAVLink(None, srcSystem=i + 1, srcComponent=1)
        texts.append(bytes(own.global_position_int_encode(*FIELDS).pack(own)))
    packets = np.array([list(text) for text in texts], dtype=np.uint8)
    sink = np.zeros(1 << 14, np.uint8)
    if (ours := route_all(radio, reals, packets, len(texts[0]), senders, sink, 1)) != router.route(texts):
        raise RuntimeError(f"ours and the router in Python do not deliver the same ({ours} bytes)")
    assert radio.counters[DELIVERED] > 0
    many, few = max(1, round(500 * scale)), max(1, round(5 * scale))

    def encode_with_pymavlink() -> None:
        for _ in range(few * BATCH):
            link.global_position_int_encode(*FIELDS).pack(link)

    def parse_with_pymavlink() -> None:
        for _ in range(few):
            mavlink.MAVLink(None).parse_buffer(block)

    def route_in_python() -> None:
        for _ in range(few * BATCH // DRONES):
            router.route(texts)

    repeat = many * BATCH // DRONES
    contests: list[tuple[str, Callable[[], Any], Callable[[], None]]] = [
        ("encode", lambda: encode_all(buffer, payload, many), encode_with_pymavlink),
        ("find", lambda: find_all(buffer, n, many), parse_with_pymavlink),
        ("decode", lambda: decode_all(buffer, n, payload, many), parse_with_pymavlink),
        ("route", lambda: route_all(radio, reals, packets, len(texts[0]), senders, sink, repeat), route_in_python),
    ]
    rows = []
    for name, ours_run, theirs_run in contests:
        ours_run()
        times: tuple[list[float], list[float]] = ([], [])
        for _ in range(rounds):
            for side, run, count in ((0, ours_run, many * BATCH), (1, theirs_run, few * BATCH)):
                began = time.perf_counter()
                run()
                times[side].append(1e6 * (time.perf_counter() - began) / count)
        mine, theirs = map(statistics.median, times)
        rows.append({"operation": name, "uav-cosim_us": mine, "pymavlink_us": theirs, "ratio": theirs / mine})
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15, help="turns of each")
    parser.add_argument("--scale", type=float, default=1.0, help="times the packets of a turn")
    parser.add_argument("--fmus", type=Path, default=ROOT / "fmus", help="folder that `uav-cosim build` has filled")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    host = machine("pymavlink")
    rows = contest(options.fmus.resolve(), options.rounds, options.scale)
    cells = [
        [row["operation"], f"{row['uav-cosim_us']:.3f}", f"{row['pymavlink_us']:.1f}", f"{row['ratio']:.0f} x"]
        for row in rows
    ]
    note = "pymavlink has no search apart from decoding: find and decode are beside the same."
    show(
        "MAVLink packets, GLOBAL_POSITION_INT, one thread",
        host,
        ["us per packet", "uav-cosim", "pymavlink", "ratio"],
        cells,
        note,
    )
    write(options.json, host, {"benchmark": "packets", "rows": rows})


if __name__ == "__main__":
    main()

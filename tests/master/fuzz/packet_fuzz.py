"""Mutated packets through router and gateways: `python -m tests.master.fuzz.packet_fuzz --packets 1000000 --seed 1`.

pymavlink builds packets of every message it knows; they are flipped, cut, lengthened, renamed, signed with garbage, and
sent in blocks through the radio and through a gateway's parser. pymavlink, reading the same block, says which of them
are good. Whatever goes wrong raises AssertionError with the block.
"""

from __future__ import annotations

import argparse
import random
import struct
from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.network.gateways.gateways import Parser
from cosim_master.network.gateways.signing import Signing
from cosim_master.network.radio.build import grown, make_radio
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import admit, send
from cosim_master.network.radio.tables import IN_FLIGHT, MALFORMED, USED_EVENTS, USED_LOG, Radio
from cosim_master.system.settings.network import Gateway, Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from tests.master.fmus.scripted import variable

RX = variable("mavlink_rx", "input", "String", 8, capacity=65536)
TX = variable("mavlink_tx", "output", "String", 9, capacity=65536)
MESSAGES = sorted(mavlink.mavlink_map)
LINK, A, B = 0, 0, 1


class Maker:
    """Random packets of every message, and mutations of them."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.links = [mavlink.MAVLink(None, srcSystem=s, srcComponent=c) for s, c in ((1, 1), (7, 191), (255, 190))]
        self.mutations = Counter[str]()

    def packet(self) -> bytes:
        chance = self.chance
        kind = mavlink.mavlink_map[chance.choice(MESSAGES)]
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        values = [self._value(t, lengths[n]) for n, t in zip(kind.fieldnames, kind.fieldtypes, strict=True)]
        link = chance.choice(self.links)
        link.seq = chance.randrange(256)
        old = kind.id < 256 and chance.random() < 0.2
        return bytes(kind(*values).pack(link, old))

    def _value(self, kind: str, n: int) -> Any:
        if kind == "char":
            return bytes(self.chance.choices(range(1, 256), k=self.chance.randint(0, max(n, 1))))[: max(n, 1)] or b"x"
        one = self._number(kind)
        return [one] * n if n else one

    def _number(self, kind: str) -> Any:
        if kind in ("float", "double"):
            return self.chance.choice((0.0, 1.5, -1e9, float("inf")))
        bits = int(kind.removesuffix("_mavlink_version").strip("uint_"))
        low = 0 if kind.startswith("u") else -(2 ** (bits - 1))
        return self.chance.choice((0, 1, low, low + 2**bits - 1, self.chance.randrange(low, low + 2**bits)))

    def mutated(self) -> bytes:
        """A packet, mostly no longer what it was."""
        packet = bytearray(self.packet())
        how = self.chance.choice(
            ("none", "flip", "flips", "cut", "crc", "length", "unknown", "signed", "flags", "junk")
        )
        self.mutations[how] += 1
        if how == "flip":
            packet[self.chance.randrange(len(packet))] ^= 1 << self.chance.randrange(8)
        elif how == "flips":
            for _ in range(self.chance.randint(2, 20)):
                packet[self.chance.randrange(len(packet))] ^= 1 << self.chance.randrange(8)
        elif how == "cut":
            del packet[self.chance.randrange(len(packet)) :]
        elif how == "crc":
            packet[-1 - self.chance.randrange(2)] ^= self.chance.randint(1, 255)
        elif how == "length":
            packet[1] = self.chance.randrange(256)
        elif how == "unknown" and packet[0] == 0xFD:
            packet[7:10] = self.chance.randrange(60_000, 2**24).to_bytes(3, "little")
        elif how == "signed" and packet[0] == 0xFD:
            extra = mavlink.mavlink_map[int.from_bytes(packet[7:10], "little")].crc_extra
            packet[2] |= 1
            crc = mavlink.x25crc(packet[1:-2])
            crc.accumulate(bytes([extra]))
            packet[-2:] = crc.crc.to_bytes(2, "little")
            packet += self.chance.randbytes(13)
        elif how == "flags" and packet[0] == 0xFD:
            packet[2] = self.chance.randrange(2, 256)
        elif how == "junk":
            packet += self.chance.randbytes(self.chance.randint(1, 30))
        return bytes(packet)


def good(block: bytes) -> list[bytes]:
    """The packets in a block that pymavlink takes, those of messages it does not know included."""
    reader = mavlink.MAVLink(None)
    reader.robust_parsing = True
    return [bytes(m.get_msgbuf()) for m in reader.parse_buffer(block) or [] if m.get_type() != "BAD_DATA"]


class Fuzz:
    """Router and gateway, and the blocks that go through them."""

    def __init__(self, seed: int) -> None:
        self.maker = Maker(seed)
        nodes = (Node("a", (Endpoint("a", RX, TX),)), Node("b", (Endpoint("b", RX, TX),)))
        places: Any = SimpleNamespace(ports={"Real": SimpleNamespace(index={})})
        network = Network(nodes=nodes, gateways=(Gateway("@a", "a"),))
        self.radio: Radio = grown(make_radio(network, places.ports["Real"].index, keep=True), 4096)
        self.signing = Signing(bytes(32))
        self._buffer = np.zeros(1 << 20, np.uint8)
        self.packets = self.taken = 0

    def block(self) -> None:
        """One block of packets, each way."""
        chance = self.maker.chance
        pieces = [self.maker.mutated() for _ in range(chance.randint(1, 12))]
        block = b"".join(pieces)
        self.packets += len(pieces)
        expected = good(block)
        self.taken += len(expected)
        self._routed(block, expected)
        self._parsed(block, expected)

    def _routed(self, block: bytes, expected: list[bytes]) -> None:
        r = self.radio
        r.counters[[USED_EVENTS, USED_LOG]] = 0
        before = int(r.counters[MALFORMED])
        heard = int(r.endpoints[A]["heard"])
        send(r, np.zeros(0), 0, A, np.frombuffer(block, np.uint8).copy(), len(block))
        events = r.events[: r.counters[USED_EVENTS]]
        bad = events["outcome"] == MALFORMED
        assert sent(r) == expected, block.hex()
        assert int(events["length"][bad].sum()) == len(block) - sum(map(len, expected)), block.hex()
        assert int(r.counters[MALFORMED]) - before == int(bad.sum())
        assert int(r.endpoints[A]["heard"]) == (_system(expected[-1]) if expected else heard), block.hex()
        arrived = deliver(r, 0, B, self._buffer)
        assert all(packet in expected for packet in good(self._buffer[:arrived].tobytes())), block.hex()
        deliver(r, 0, int(r.gateways[0]["endpoint"]), self._buffer)
        deliver(r, 0, A, self._buffer)
        assert r.counters[IN_FLIGHT] == 0

    def _parsed(self, block: bytes, expected: list[bytes]) -> None:
        assert Parser(stream=False).feed(block) == expected, block.hex()
        parser, rest, found = Parser(stream=True), block, []
        while rest:
            n = self.maker.chance.randint(1, len(rest))
            found += parser.feed(rest[:n])
            rest = rest[n:]
        assert found == expected, block.hex()
        refused = [self.signing.refusal(packet) for packet in found]
        assert all(refused), block.hex()  # nobody has the key
        if found:
            self.radio.counters[[USED_EVENTS, USED_LOG]] = 0
            joined = b"".join(found)
            admit(self.radio, np.zeros(0), 0, LINK, np.frombuffer(joined, np.uint8), len(joined))
            got = self._buffer[: deliver(self.radio, 0, A, self._buffer)].tobytes()
            assert all(packet in found for packet in good(got)), block.hex()
            assert int(self.radio.gateways[0]["waiting"]) == 0


def _system(packet: bytes) -> int:
    return packet[3] if packet[0] == 0xFE else packet[5]


def sent(radio: Radio) -> list[bytes]:
    """The packets in the radio's log that were sent: each good one, once."""
    log = radio.log[: radio.counters[USED_LOG]].tobytes()
    packets = []
    p = 0
    while p < len(log):
        entry, length = struct.unpack_from("<ii", log, p + 8)
        if entry & 1:
            packets.append(log[p + 16 : p + 16 + length])
        p += 16 + length
    return packets


def main() -> None:
    """Fuzz until so many packets have gone through."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--packets", type=int, default=100_000)
    arguments.add_argument("--seed", type=int, default=1)
    options = arguments.parse_args()
    fuzz = Fuzz(options.seed)
    while fuzz.packets < options.packets:
        fuzz.block()
    print(f"{fuzz.packets} packets, {fuzz.taken} good; {dict(fuzz.maker.mutations)}")


if __name__ == "__main__":
    main()

"""Mutated MAVLink packets through autopilot and agent: nothing crashes, and what has a bad CRC changes nothing.

Packets of every kind they act on are built by pymavlink, with random fields, then mutated: flipped bits, wrong CRC,
wrong lengths, cut off, unknown ids, random signatures, random bytes. They are delivered in batches, one a step. Every
batch in which pymavlink finds no packet is also compared: the record after the step is the record after the same step
without packets, byte for byte. What is said must be whole packets with the right CRC, motor commands stay within 0
to 1.

    python -m benchmarks.fuzz [--packets 1000000] [--seed 1]
"""

from __future__ import annotations

import argparse
import struct
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.agents.line_agent import LineAgent
from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.mavlink.parameters import PARAMETER_NAMES

BATCH = 20
MESSAGES = (
    *(0, 11, 20, 21, 23, 33, 39, 40, 41, 43, 44, 45, 47, 51, 66, 69, 70, 73, 75, 76, 77, 84, 86, 110, 111, 253),
)
COMMANDS = (20, 21, 22, 115, 176, 178, 192, 207, 224, 300, 400, 410, 510, 511, 512, 520)
TRIES = 12
KINDS = ("whole", "bit", "crc", "length", "cut", "id", "signature", "noise")


class Fuzz:
    """Packets and their mutations, drawn from a generator of their own."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.stations = [mavlink.MAVLink(None, srcSystem=s, srcComponent=190) for s in (255, 2, 3, 250)]

    def _value(self, kind: str, length: int) -> Any:
        rng = self.rng
        if kind == "char":
            return str(rng.choice(PARAMETER_NAMES)).encode()[:length]
        if kind in ("float", "double"):
            usual = (0.0, 1.0, 4.0, 10.0, 100.0, -1.0, float("nan"), float("inf"), 1e30, float(rng.normal() * 1e3))
            return usual[int(rng.integers(len(usual)))]
        size = {"8": 8, "16": 16, "32": 32, "64": 64}[kind.strip("uint_")]
        if rng.random() < 0.6:
            return int(rng.integers(0, 7))
        low, high = (-(2 ** (size - 1)), 2 ** (size - 1) - 1) if kind[0] == "i" else (0, 2**size - 1)
        return int(rng.integers(low, high, dtype=np.int64 if kind[0] == "i" else np.uint64, endpoint=True))

    def whole(self) -> bytes:
        """A packet of random fields in MAVLink 1 or 2."""
        rng = self.rng
        for _ in range(TRIES):
            one = mavlink.mavlink_map[int(rng.choice(MESSAGES))]
            values = {}
            for name, kind, count in zip(one.fieldnames, one.fieldtypes, one.array_lengths, strict=False):
                if name in ("target_system", "target_component"):
                    values[name] = int(rng.integers(0, 2))
                elif name == "command":
                    values[name] = int(rng.choice(COMMANDS))
                elif count and kind != "char":
                    values[name] = [self._value(kind, 1) for _ in range(count)]
                else:
                    values[name] = self._value(kind, count)
            station = self.stations[int(rng.integers(len(self.stations)))]
            try:
                return bytes(one(**values).pack(station, force_mavlink1=bool(rng.random() < 0.2)))
            except (struct.error, TypeError, ValueError, UnicodeDecodeError):
                continue  # a value that pymavlink cannot pack
        return bytes(mavlink.MAVLink_param_request_list_message(0, 0).pack(self.stations[0]))

    def mutated(self, packet: bytes, kind: str) -> bytes:
        """The packet with one kind of damage."""
        rng = self.rng
        data = bytearray(packet)
        head = 10 if data[0] == 0xFD else 6
        if kind == "bit":
            for _ in range(int(rng.integers(1, 4))):
                data[int(rng.integers(head, len(data)))] ^= 1 << int(rng.integers(8))
        elif kind == "crc":
            data[-1 - int(rng.integers(2))] ^= int(rng.integers(1, 256))
        elif kind == "length":
            data[1] = int(rng.integers(256))
        elif kind == "cut":
            data = data[: int(rng.integers(1, len(data)))]
        elif kind == "id":
            data[7 if head == 10 else 5] = int(rng.integers(256))
        elif kind == "signature" and head == 10:
            data[2] |= 1
            data += bytes(rng.integers(0, 256, 13, dtype=np.uint8))
        elif kind == "noise":
            data = bytearray(rng.integers(0, 256, int(rng.integers(1, 60)), dtype=np.uint8))
        return bytes(data)


def good(data: bytes) -> int:
    """How many packets pymavlink finds."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    return sum(m.get_type() != "BAD_DATA" for m in parser.parse_buffer(data) or [])


def deliver(model: Any, m: Any, data: bytes, t: float, advance: Any = None) -> int:
    """One step with `data` received; the code of the kernel, `advance` or by default the model's own."""
    m["mavlink_rx"][: len(data)] = np.frombuffer(data, dtype=np.uint8)
    m["mavlink_rx_len"] = len(data)
    return int((advance or model.kernels[1])(m, t, model.step_size))


def twin(memory: bytearray, model: Any) -> tuple[bytearray, Any]:
    """A copy of a record's memory, also of what lies between its fields, and the record over it."""
    copy = bytearray(memory)
    return copy, np.frombuffer(copy, dtype=model.record().dtype).view(np.recarray)[0]


def without_input(memory: bytearray, m: Any) -> bytes:
    """The record but for what was received."""
    fields = m.dtype.fields
    data = bytearray(memory)
    for name, size in (("mavlink_rx", m["mavlink_rx"].nbytes), ("mavlink_rx_len", 4)):
        at = fields[name][1]
        data[at : at + size] = bytes(size)
    return bytes(data)


def just_in_time(model: Any) -> Any:
    """Returns the model's own kernels, which are compiled when they are called."""
    return model.kernels


def run(
    packets: int,
    seed: int,
    models: Sequence[Any] = (Autopilot, LineAgent),
    kernels: Callable[[Any], Any] = just_in_time,
) -> dict[str, int]:
    """Deliver that many packets; counts of packets, good ones, batches compared and packets said.

    Args:
        kernels: gives the kernels of a model, start and advance.

    Raises:
        AssertionError: something that must not happen has, with the seed and the batch.
    """
    fuzz = Fuzz(seed)
    pool = [fuzz.whole() for _ in range(min(packets, 5000))]
    counts = {"packets": 0, "good": 0, "compared": 0, "said": 0}
    instances = []
    for model in models:
        memory, m = twin(bytearray(model.record().tobytes()), model)
        start, advance = kernels(model)
        assert start(m) == 0
        instances.append((model, memory, m, advance))
    step = 0
    while counts["packets"] < packets:
        only_bad = fuzz.rng.random() < 0.5
        kinds = fuzz.rng.choice(KINDS[1:3] if only_bad else KINDS, BATCH)
        chosen = fuzz.rng.integers(0, len(pool), BATCH)
        data = b"".join(fuzz.mutated(pool[i], str(k)) for i, k in zip(chosen, kinds, strict=True))[:2048]
        found = good(data)
        counts["packets"] += BATCH
        counts["good"] += found
        step += 1
        for model, memory, m, advance in instances:
            where = f"{model.__name__}, seed {seed}, batch {step}"
            t = 3.0 + step * model.step_size
            if found == 0:
                copied, other = twin(memory, model)
                assert deliver(model, other, b"", t, advance) == 0, where
            assert deliver(model, m, data, t, advance) == 0, where
            if found == 0:
                same = without_input(memory, m) == without_input(copied, other)
                assert same, f"{where}: packets with a bad CRC changed something"
                counts["compared"] += 1
            said = m["mavlink_tx"][: int(m["mavlink_tx_len"])].tobytes()
            counts["said"] += len(mavlink.MAVLink(None).parse_buffer(said) or [])
            if "motor" in m.dtype.names:
                assert ((m["motor"] >= 0.0) & (m["motor"] <= 1.0)).all(), where
    return counts


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--packets", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    began = time.perf_counter()
    counts = run(options.packets, options.seed)
    print(", ".join(f"{name} {count}" for name, count in counts.items()), f"in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()

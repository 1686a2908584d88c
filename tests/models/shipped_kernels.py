"""The kernels of a model as its FMU has them: the object code that the build keeps, called from Python.

A flight of the autopilot in a test needs no second compilation of its hundreds of functions, and flies the machine
code that is shipped.
"""

from __future__ import annotations

import atexit
import ctypes
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.build.native.compiled import HOST, TARGETS, kernel_code
from cosim.build.sources import sources_of
from cosim.kernel import PLAIN
from cosim.model import Model

PROGRAM = Path(__file__).with_name("flight.c")


@cache
def _library(model: type[Model]) -> ctypes.CDLL:
    """Returns flight.c with the kernels of a model."""
    temporary = TemporaryDirectory(prefix="uav-cosim-kernels-")
    atexit.register(temporary.cleanup)
    folder = Path(temporary.name)
    ((_, code),) = kernel_code(model, sources_of(model), [HOST], checked=False)
    (folder / "model.o").write_bytes(code)
    library = folder / f"kernels{TARGETS[HOST].suffix}"
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[HOST].zig]
    options = ["-O2", "-ffp-contract=off", "-shared", "-fPIC", "-s", "-rtlib=none"]
    subprocess.run([*zig, *options, PROGRAM, "model.o", "-lm", "-o", library], cwd=folder, check=True)
    functions = ctypes.CDLL(str(library))
    functions.advance.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double)
    functions.fly.argtypes = (ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p)
    functions.fly.restype = ctypes.c_int64
    return functions


@cache
def kernels(model: type[Model]) -> tuple[Callable[[Any], int], Callable[[Any, float, float], int]]:
    """Returns `start(m)` and `advance(m, t, h)`; -1: the kernel raised. Plain Python where kernels are."""
    if PLAIN:
        assert model.kernels is not None
        return model.kernels
    functions = _library(model)
    c_advance, size = functions.advance, model.record().nbytes
    known: Any = None
    at = 0

    def start(m: Any) -> int:
        return int(functions.start(ctypes.c_void_p(address(m, size))))

    def advance(m: Any, t: float, h: float) -> int:
        nonlocal known, at
        if m is not known:  # finding the address takes as long as a step
            known, at = m, address(m, size)
        return c_advance(at, t, h)  # type: ignore[no-any-return]

    return start, advance


def address(memory: Any, size: int | None = None) -> int:
    """Returns where the memory of a record or an array is."""
    assert size is None or memory.nbytes == size, "the record of another model"
    return int(np.frombuffer(memory, np.uint8).ctypes.data)  # `m.__array_interface__` lists all fields each time


class _Span(ctypes.Structure):
    _fields_ = (("to", ctypes.c_void_p), ("of", ctypes.c_void_p), ("size", ctypes.c_int64))


class _Line(ctypes.Structure):
    _fields_ = (("given", ctypes.c_void_p), ("got", ctypes.c_void_p), ("text", ctypes.c_void_p))


class _Flight(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("pilot", "vehicle", "pilots", "vehicles")),
        *((name, ctypes.c_double) for name in ("h", "inner")),
        ("direct", ctypes.c_int64),
        ("motors", _Span),
        *((name, ctypes.c_int64) for name in ("spans", "lines")),
        *((name, ctypes.c_void_p) for name in ("span", "line", "position", "velocity", "attitude", "errors")),
        *((name, ctypes.c_int64) for name in ("rows_of_errors", "row", "advances")),
        ("columns", ctypes.c_void_p * 3),
        *((name, ctypes.c_void_p) for name in ("table", "log")),
        *((name, ctypes.c_int64) for name in ("room", "used")),
    )


_ROOM = 1 << 20
_log = np.zeros(_ROOM + (1 << 18), np.uint8)  # room for the packets of one more step


@dataclass
class Loop:
    """Steps of an autopilot and a vehicle, made by flight.c.

    Attributes:
        pilot, vehicle: the models; `m`, `v`: their records.
        pairs: memory of the one that takes that of the other before each step.
        lines: names of the autopilot's links.
        direct: whether the motors obey in the step in which they are commanded.
        errors: of position, velocity, roll, pitch and yaw as the autopilot knows them: rows of nine. The next one is
            `row`; `advances` says whether each step takes another one.
    """

    pilot: type[Model]
    vehicle: type[Model]
    m: Any
    v: Any
    pairs: Sequence[tuple[NDArray[Any], NDArray[Any]]]
    lines: Sequence[str]
    direct: bool = False
    errors: NDArray[np.float64] | None = None
    row: int = 0
    advances: bool = False

    def fly(
        self, step: int, count: int, table: NDArray[np.float64] | None = None
    ) -> tuple[int, list[tuple[int, int, bytes]]]:
        """Makes up to `count` steps from `step` on: how many, and each step, line and bytes of packets.

        Args:
            table: rows of time, position, velocity and desired position.
        """
        m, v = self.m, self.v
        spans = (_Span * len(self.pairs))(*((address(to), address(of), to.nbytes) for to, of in self.pairs))
        ways = [[address(part(m, f"{line}_{way}")) for way in ("rx_len", "tx_len", "tx")] for line in self.lines]
        lines = (_Line * len(ways))(*(_Line(*way) for way in ways))
        flight, failed = _Flight(), ctypes.c_int(0)
        flight.pilots, flight.vehicles = address(m), address(v)
        for name, model in (("pilot", self.pilot), ("vehicle", self.vehicle)):
            setattr(flight, name, ctypes.cast(_library(model).advance, ctypes.c_void_p).value)
        flight.h, flight.inner, flight.direct = self.pilot.step_size, self.vehicle.step_size, int(self.direct)
        flight.motors = _Span(address(v["motor"]), address(m["motor"]), m["motor"].nbytes)
        flight.spans, flight.span = len(spans), ctypes.addressof(spans)
        flight.lines, flight.line = len(lines), ctypes.addressof(lines)
        flight.position, flight.velocity, flight.attitude = (
            address(m[name]) for name in ("position", "velocity", "attitude")
        )
        if self.errors is not None:
            assert self.errors.flags.c_contiguous and self.errors.shape[1] == 9
            flight.errors, flight.rows_of_errors = address(self.errors), len(self.errors)
            flight.row, flight.advances = self.row, int(self.advances)
        if table is not None:
            assert table.flags.c_contiguous and table.shape == (count, 10)
            columns = (v["position"], v["velocity"], m["desired_position"])
            flight.table, flight.columns = address(table), (ctypes.c_void_p * 3)(*map(address, columns))
        flight.log, flight.room = address(_log), _ROOM
        made = _library(self.pilot).fly(ctypes.addressof(flight), step, count, ctypes.addressof(failed))
        assert failed.value == 0, f"a kernel returned {failed.value} in step {step + made}"
        self.row = flight.row
        return made, list(_packets(flight.used))


def _packets(used: int) -> Iterator[tuple[int, int, bytes]]:
    at = 0
    while at < used:
        step, line, length = (int(x) for x in _log[at : at + 24].view(np.int64))
        yield step, line, _log[at + 24 : at + 24 + length].tobytes()
        at += 24 + (length + 7) // 8 * 8


def part(record: Any, name: str) -> NDArray[Any]:
    """Returns the memory of a field: for a number, an array of one, which is read eight times as fast as the field."""
    found: NDArray[Any] = record.base.view(np.ndarray)[name]
    return found if found.ndim == 1 else found[0]


def joined(to: Any, of: Any, names: Iterable[str]) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Returns pairs of memory of two records that fields of these names take, of neighbouring fields together."""
    fields = (to.dtype.fields, of.dtype.fields)
    sizes = {name: [kind[name][0].itemsize for kind in fields] for name in names}
    assert all(a == b for a, b in sizes.values())
    spans: list[list[int]] = []
    for at, other, size in sorted((fields[0][name][1], fields[1][name][1], sizes[name][0]) for name in sizes):
        if spans and [at, other] == [spans[-1][0] + spans[-1][2], spans[-1][1] + spans[-1][2]]:
            spans[-1][2] += size
        else:
            spans.append([at, other, size])
    here, there = (one.base.view(np.ndarray).view(np.uint8) for one in (to, of))
    return [(here[at : at + size], there[other : other + size]) for at, other, size in spans]

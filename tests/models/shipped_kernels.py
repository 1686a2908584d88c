"""The kernels of a model as its FMU has them: the object code that the build keeps, called from Python.

A flight of the autopilot in a test needs no second compilation of its hundreds of functions, and flies the machine
code that is shipped.
"""

from __future__ import annotations

import atexit
import ctypes
import subprocess
import sys
from collections.abc import Callable, Iterable
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

SHIM = """
int model_start(int *code, void **exception, void *record);
int model_advance(int *code, void **exception, void *record, double t, double h);

int start(void *record)
{
    int code = 0;
    void *exception = 0;
    return model_start(&code, &exception, record) ? -1 : code;
}

int advance(void *record, double t, double h)
{
    int code = 0;
    void *exception = 0;
    return model_advance(&code, &exception, record, t, h) ? -1 : code;
}
"""


@cache
def kernels(model: type[Model]) -> tuple[Callable[[Any], int], Callable[[Any, float, float], int]]:
    """Returns `start(m)` and `advance(m, t, h)`; -1: the kernel raised. Plain Python where kernels are."""
    if PLAIN:
        assert model.kernels is not None
        return model.kernels
    temporary = TemporaryDirectory(prefix="uav-cosim-kernels-")
    atexit.register(temporary.cleanup)
    folder = Path(temporary.name)
    ((_, code),) = kernel_code(model, sources_of(model), [HOST], checked=False)
    (folder / "model.o").write_bytes(code)
    (folder / "shim.c").write_text(SHIM, encoding="utf-8")
    library = folder / f"kernels{TARGETS[HOST].suffix}"
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        TARGETS[HOST].zig,
        "-O2",
        "-shared",
        "-fPIC",
        "-s",
        "-rtlib=none",
    ]
    subprocess.run([*command, "shim.c", "model.o", "-lm", "-o", library], cwd=folder, check=True)
    functions = ctypes.CDLL(str(library))
    functions.advance.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double)
    c_advance, size = functions.advance, model.record().nbytes
    known: Any = None
    at = 0

    def address(m: Any) -> int:
        assert m.nbytes == size, "the record of another model"
        return int(np.frombuffer(m, np.uint8).ctypes.data)  # `m.__array_interface__` lists all fields each time

    def start(m: Any) -> int:
        return int(functions.start(ctypes.c_void_p(address(m))))

    def advance(m: Any, t: float, h: float) -> int:
        nonlocal known, at
        if m is not known:  # finding the address takes as long as a step
            known, at = m, address(m)
        return c_advance(at, t, h)  # type: ignore[no-any-return]

    return start, advance


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

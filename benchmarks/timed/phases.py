"""The stepping loop with a stopwatch, for `benchmarks/swarm.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.tables import Radio
from cosim_master.stepping.kernels import macro_step as stepping
from cosim_master.stepping.kernels import tables
from cosim_master.stepping.kernels.instances import running

__all__ = ["timed_steps"]

_clock_gettime: Any = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.uintp))
_MONOTONIC = 1


@kernel
def _lap(stamp: NDArray[np.int64]) -> int:
    """Nanoseconds since the last lap."""
    _clock_gettime(np.int32(_MONOTONIC), np.uintp(stamp.ctypes.data))
    now = stamp[0] * 1_000_000_000 + stamp[1]
    elapsed = now - stamp[2]
    stamp[2] = now
    return int(elapsed)


@kernel
def timed_steps(
    p: tables.Plan,
    r: Radio,
    k_stop: int,
    grouped: NDArray[np.int64],
    ends: NDArray[np.int64],
    spent: NDArray[np.int64],
) -> int:
    """`macro_step.run` on one thread without recording, its phases timed and instances FMU by FMU.

    `spent` in ns: exchange, packets, then each FMU; its last three are the stopwatch.
    """
    counters = p.counters
    stamp = spent[-3:]
    at = running(p)
    while counters[tables.K] < k_stop:
        k = counters[tables.K]
        _lap(stamp)
        stepping._deliver_all(p, r, k)
        spent[1] += _lap(stamp)
        stepping.exchange(
            p.instances,
            p.input_runs,
            p.sources,
            p.wires,
            p.int_to_real,
            p.value_maps,
            p.real_out,
            p.int_out,
            p.real_in,
            p.int_in,
            k,
        )
        spent[0] += _lap(stamp)
        first = 0
        for n in range(ends.size):
            failed = stepping.step_some(
                p.instances, p.calls, p.ports, p.encoded[0], p.rx, p.tx, counters, k, grouped[first : ends[n]], at
            )
            if failed > 0:
                return tables.FAILED
            first = ends[n]
            spent[2 + n] += _lap(stamp)
        reason = stepping._send_all(p, r, k)
        if reason != tables.DONE:
            return int(reason)
        spent[1] += _lap(stamp)
        counters[tables.K] = k + 1
    return tables.DONE

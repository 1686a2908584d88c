"""Transfers values from outputs to inputs. Values move only here."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim_master.stepping.kernels.tables import BASE, COPY, FINER, PER_NS, SIGN, START, Plan

__all__ = ["delay", "exchange", "extrapolate", "feed", "point_in_time", "inlined"]

inlined = functools.partial(kernel, inline=True)


@inlined
def point_in_time(counters: NDArray[np.int64], k: int) -> int:
    """Returns the communication point t_k, rounded to ns."""
    ticks, per_ns = counters[START] + k * counters[BASE], counters[PER_NS]
    return int(ticks if per_ns == 1 else (ticks + per_ns // 2) // per_ns)


@inlined
def exchange(
    instances: NDArray[Any],
    feeds: NDArray[Any],
    sources: NDArray[np.uint32],
    wires: NDArray[Any],
    int_to_real: NDArray[np.int64],
    value_maps: NDArray[np.int64],
    real_out: NDArray[np.float64],
    int_out: NDArray[np.int32],
    real_in: NDArray[np.float64],
    int_in: NDArray[np.int32],
    k: int,
) -> None:
    """Sets the inputs of the due instances of `feeds` from the connected outputs: all data flows here."""
    reals = np.uintp(real_in.size)
    for j in range(value_maps.shape[0]):
        source, place, key = value_maps[j, 0], value_maps[j, 1], value_maps[j, 2]
        if source < 0:
            low, high = np.int64(int_out[-1 - source]) & 0xFFFFFFFF, np.int64(int_out[-source])
            if high * 4294967296 + low == key:
                wide = value_maps[j, 3]
                low = wide & 0xFFFFFFFF
                int_out[place] = low - 4294967296 if low > 2147483647 else low
                int_out[place + 1] = wide >> 32
            continue
        value = int_out[source]
        if key == COPY:
            int_out[place] = value
        elif key == SIGN:
            int_out[place] = -1 if value < 0 else 0
        elif key == value:
            int_out[place] = value_maps[j, 3]
    for j in range(int_to_real.shape[0]):
        source = int_to_real[j, 0]
        if source < 0:
            real_out[int_to_real[j, 1]] = np.int64(int_out[-1 - source]) & 0xFFFFFFFF
        else:
            real_out[int_to_real[j, 1]] = int_out[source]
    for i in range(feeds.size):
        feed = feeds[i]
        period = instances[np.uintp(feed.instance)].period
        if period > 1 and k % period != 0:
            continue
        if feed.plain != 0:
            for j in range(np.uintp(feed.first_in[0]), np.uintp(feed.last_in[0])):
                real_in[j] = real_out[sources[j]]
        else:
            for j in range(np.uintp(feed.first_in[0]), np.uintp(feed.last_in[0])):
                real_in[j] = wires[j].factor * real_out[sources[j]] + wires[j].offset
        for kind in range(1, 3):
            for j in range(np.uintp(feed.first_in[kind]), np.uintp(feed.last_in[kind])):
                int_in[j - reals] = int_out[sources[j]]


@entry
def feed(p: Plan, k: int, feeds: NDArray[Any]) -> None:
    """Exchanges as `exchange` does, for some instances; the part common to all is also done if none are given."""
    exchange(
        p.instances,
        feeds,
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


@kernel
def delay(p: Plan, k: int) -> None:
    """Stores the current outputs in delayed connections, and takes earlier ones out of them."""
    if k % p.counters[FINER] != 0:
        return
    feed(p, k, p.feeds[:0])
    step = k // p.counters[FINER]
    for j in range(p.delays.size):
        d = p.delays[j]
        value = 0.0
        if d.source < 0:  # of another part of the run, whose values are put into the line between two windows
            value = p.delay_line[d.first + step % d.length]
        elif d.whole == 0:
            value = d.factor * p.real_out[d.source] + d.offset
        else:
            value = float(p.int_out[d.source])
        if d.length > 0 and d.source >= 0:
            at = d.first + step % d.length
            new, value = value, p.delay_line[at]
            p.delay_line[at] = new
        elif d.length < 0:
            value += p.real_out[d.place]
        if d.whole == 0:
            p.real_out[d.place] = value
        else:
            p.int_out[d.place] = np.int32(value)


@kernel
def extrapolate(p: Plan, k: int, first: int, last: int) -> None:
    """Computes the derivatives of the extrapolated inputs of the instances first to last - 1, if they begin a step."""
    t = p.counters[START] + k * p.counters[BASE]
    for j in range(p.slopes.size):
        s = p.slopes[j]
        if s.instance < first or s.instance >= last or k % p.instances[s.instance].period != 0:
            continue
        value = p.real_in[s.input]
        p.derivatives[j] = (
            (value - s.before) / ((t - s.at) / (1e9 * p.counters[PER_NS])) if s.known != 0 and t > s.at else 0.0
        )
        s.before = value
        s.at = t
        s.known = 1

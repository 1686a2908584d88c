"""The FMU of the comparison of engines: it has a port of every kind, and one number that says what came in."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from cosim import Input, Model, Output, Parameter, kernel

__all__ = ["Switchboard"]


class Level(IntEnum):
    low = 1
    high = 5


@kernel
def start(m: Any) -> int:
    m.value = m.k
    m.far = m.k
    m.warm = m.k
    m.count = 3
    m.on = True
    m.off = False
    m.y = m.gain * m.u + m.length + m.temperature + m.n + m.flag + 100.0 * (m.level - 1)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001 (the interface of kernels)
    m.y = m.gain * m.u + m.length + m.temperature + m.n + m.flag + 100.0 * (m.level - 1)
    return 0


class Switchboard(Model):
    """y = gain u + length + temperature + n + flag + 100 (level - 1); everything else is constant."""

    step_size = 0.1
    variables = (
        Input("u", unit="1", description="goes into y with the gain"),
        Input("length", unit="m", description="goes into y"),
        Input("temperature", unit="K", description="goes into y"),
        Input("n", type=int, description="goes into y"),
        Input("flag", type=bool, description="goes into y"),
        Parameter("k", unit="1", start=3.0, description="value, far and warm"),
        Parameter("gain", unit="1", start=2.0, description="of u"),
        Parameter("level", type=Level, start=Level.low, description="goes into y"),
        Output("value", unit="1", description="k"),
        Output("far", unit="km", description="k"),
        Output("warm", unit="degC", description="k"),
        Output("count", type=int, description="3"),
        Output("on", type=bool, description="true"),
        Output("off", type=bool, description="false"),
        Output("y", unit="1", description="what came in"),
    )
    kernels = (start, advance)

"""The small FMU of the overhead benchmark: it computes next to nothing, so that what is left is the master."""

from __future__ import annotations

from typing import Any

from cosim import Input, Model, Output, Parameter, kernel

__all__ = ["Relay"]


@kernel
def start(m: Any) -> int:
    for i in range(6):
        m.y[i] = m.first * (i + 1)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001 (the interface of kernels)
    for i in range(4):
        m.y[i] += h * m.gain * (m.u[i] - m.y[i])
    m.y[4] = m.y[0] + m.y[1]
    m.y[5] = m.y[2] - m.y[3]
    return 0


class Relay(Model):
    """Four first-order lags, their sum and their difference."""

    step_size = 0.0025
    variables = (
        Input("u", shape=4, unit="1", start=0.0, description="what the lags follow"),
        Parameter("gain", unit="1/s", start=10.0, minimum=0.0, description="one over their time constant"),
        Parameter("first", unit="1", start=1.0, description="where they start: once, twice, three times that"),
        Output("y", shape=6, unit="1", description="the lags, y1 + y2, y3 - y4"),
    )
    kernels = (start, advance)

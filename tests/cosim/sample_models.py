"""Models for the tests of cosim.model and cosim.build: every kind of variable, every way to fail.

`Plant` is simple enough to be calculated by hand: x' = gain u, stepped by Euler.
"""

from __future__ import annotations

from enum import IntEnum
from math import frexp
from typing import Any, ClassVar

import numpy as np

from cosim import Input, Memory, Model, Output, PacketInput, PacketOutput, Parameter, State, kernel


class Gear(IntEnum):
    park = 1
    slow = 2
    fast = 3


class Fault(IntEnum):
    none = 0
    code_in_start = 1
    code_in_advance = 2
    unknown_code_in_advance = 3
    raise_in_start = 4
    raise_in_advance = 5


FAULT_CODE_IN_START = int(Fault.code_in_start)
FAULT_CODE = int(Fault.code_in_advance)
FAULT_UNKNOWN_CODE = int(Fault.unknown_code_in_advance)
FAULT_RAISE_IN_START = int(Fault.raise_in_start)
FAULT_RAISE = int(Fault.raise_in_advance)


@kernel
def publish(m: Any) -> None:
    m.y = m.x + m.gain * m.u
    m.z[0] = m.w[0] + m.w[1]
    m.z[1] = m.w[2]
    m.total = m.count * m.limit
    m.ready = m.enable
    m.engaged = m.gear


@kernel
def start(m: Any) -> int:
    if m.fault == FAULT_CODE_IN_START:
        return 7
    if m.fault == FAULT_RAISE_IN_START:
        raise ValueError("the kernel does not start")
    m.steps += 1  # 1 after every start: states are reset before
    m.history[1, 2] += 0.5
    publish(m)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:
    m.x += h * m.gain * m.u + m.trim
    m.steps += 1
    if m.fault == FAULT_CODE:
        return 7
    if m.fault == FAULT_UNKNOWN_CODE:
        return 99
    if m.fault == FAULT_RAISE:
        raise ValueError("the kernel does not advance")
    m.history[1, 2] += t
    publish(m)
    for i in range(m.rx_len):  # reversed, with the number of steps behind
        m.tx[i] = m.rx[m.rx_len - 1 - i]
    m.tx[m.rx_len] = np.int64(m.steps) & 255
    m.tx_len = m.rx_len + 1
    return 0


class Plant(Model):
    """An integrator with every kind of variable.

    What follows the first line is not for modelDescription.xml.
    """

    step_size = 0.125
    variables = (
        Output("y", unit="m", depends=("u",), description='position & "feed-through" < 5'),
        Input("u", unit="m", start=0.5),
        Input("w", shape=3, start=(1.0, 2.0, 3.0)),
        Input("count", type=int, start=2),
        Input("enable", type=bool, start=True),
        Input("gear", type=Gear, start=Gear.slow),
        PacketInput("rx", capacity=10),
        State("x", unit="m", start=10.0),
        State("steps", type=int),
        Memory("history", shape=(2, 3)),
        Parameter("gain", unit="1/s", start=2.0, minimum=0.0, maximum=10.0),
        Parameter("trim", unit="m", start=0.0, tunable=True),
        Parameter("limit", type=int, start=100, minimum=1, maximum=1000),
        Parameter("fault", type=Fault, start=Fault.none, tunable=True),
        Parameter("names", type=bool, shape=2, start=(True, False)),
        Output("z", shape=2, depends=("w",)),
        Output("total", type=int, depends=("count",)),
        Output("ready", type=bool, depends=("enable",)),
        Output("engaged", type=Gear, start=Gear.park, depends=("gear",)),
        PacketOutput("tx", capacity=13),
    )
    kernels = (start, advance)
    errors: ClassVar[dict[int, str]] = {7: 'the plant is "broken" by 100 % of \\ faults'}


@kernel
def boast(m: Any, t: float, h: float) -> int:
    m.tx_len = int(m.u)
    return 0


@kernel
def be_quiet(m: Any) -> int:
    return 0


class Boastful(Model):
    """Reports as many bytes as it is told, even more than it has."""

    step_size = 0.5
    variables = (Input("u"), PacketOutput("tx", capacity=4))
    kernels = (be_quiet, boast)


class Text(Model):
    """A model without kernels: strings, and a step of its own."""

    step_size = 0.5
    variables = (
        Input("greeting", type=str, start="hello"),
        Parameter("mark", type=str, start="!"),
        Input("u", start=1.0),
        Output("answer", type=str, start="nothing yet"),
        Output("y"),
    )

    def initialize(self) -> None:
        self.strings["answer"] += self.strings["mark"]
        self.m.y = -self.m.u

    def do_step(self, current_time: float, step_size: float) -> bool:
        if self.strings["greeting"] == "fail":
            raise RuntimeError("told to fail")
        self.strings["answer"] = f"{self.strings['greeting']} at {current_time + step_size}{self.strings['mark']}"
        self.m.y += self.m.u
        return True


class OnlyStrings(Model):
    """A model whose record is empty."""

    step_size = 0.5
    variables = (Output("answer", type=str, start="42"),)

    def do_step(self, current_time: float, step_size: float) -> bool:
        return True


@kernel
def allocate(m: Any, t: float, h: float) -> int:
    m.y = np.full(3, t).sum()
    return 0


@kernel
def borrow(m: Any, t: float, h: float) -> int:
    m.y = frexp(t)[0]
    return 0


@kernel
def deep(x: float) -> float:
    return x.nothing  # type: ignore[attr-defined]


@kernel
def attribute(m: Any, t: float, h: float) -> int:
    m.y = deep(t)
    return 0


@kernel
def forgetful(m: Any, t: float, h: float) -> None:
    m.y = t


@kernel
def misspelt(m: Any, t: float, h: float) -> int:
    m.yy = t
    return 0


def plain(m: Any, t: float, h: float) -> int:
    m.y = t + h
    return 0


@kernel
def nothing(m: Any) -> int:
    return 0


class Allocates(Model):
    """Makes an array."""

    step_size = 0.1
    variables = (Output("y"),)
    kernels = (nothing, allocate)


class Borrows(Model):
    """Compiles, but needs a function of numba's own library."""

    step_size = 0.1
    variables = (Output("y"),)
    kernels = (nothing, borrow)


class Attribute(Model):
    """Uses what no number has."""

    step_size = 0.1
    variables = (Output("y"),)
    kernels = (nothing, attribute)


class Forgetful(Model):
    """Returns nothing."""

    step_size = 0.1
    variables = (Output("y"),)
    kernels = (nothing, forgetful)  # type: ignore[assignment]


class Misspelt(Model):
    """Writes to a variable that is not declared."""

    step_size = 0.1
    variables = (Output("y"),)
    kernels = (nothing, misspelt)


class Plain(Model):
    """A function that is no kernel."""

    step_size = 0.1
    variables = (Output("y"),)
    kernels = (nothing, plain)

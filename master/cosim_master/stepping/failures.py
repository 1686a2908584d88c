"""The errors that end a run early; they are made from the statuses of instances and name these instances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim_master.diagnostics.errors import FmuError, RunFailed
from cosim_master.diagnostics.limitations import DISCARDED, PENDING, WIDE_INTEGER
from cosim_master.diagnostics.limitations import NOT_A_NUMBER as NAN
from cosim_master.fmi.calls import FUNCTIONS, KINDS
from cosim_master.fmi.description.read import Start, Variable
from cosim_master.fmi.slaves.fmi2 import STATUS
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.kernels.fmi3_types import OUT_OF_RANGE
from cosim_master.stepping.kernels.tables import (
    BASE,
    DO_STEP,
    EARLY,
    ENDED,
    FAILURES,
    NOT_A_NUMBER,
    NOT_BASE64,
    NOT_CALLED,
    PER_NS,
    START,
    TOO_LONG,
    K,
    Plan,
)
from cosim_master.stepping.layout import Layout

__all__ = ["DISCARD", "discard_failure", "raise_failures"]

DISCARD = (DO_STEP, STATUS.index("fmi2Discard"))
"""Function and status in a row's `failed`, of a step that was discarded."""

_FAILED = (STATUS.index("fmi2Error"), STATUS.index("fmi2Fatal"))
_MOST_INPUTS = 8
"""Largest number of inputs named in the message of a failure."""


def reached(plan: Plan) -> float:
    """Returns the simulation time of the current communication point, s."""
    counters = plan.counters
    return float(counters[START] + max(counters[K], 0) * counters[BASE]) / (1e9 * float(counters[PER_NS]))


def raise_failures(plan: Plan, layout: Layout, instances: Sequence[Slave]) -> None:
    """Raises RunFailed if instances have failed in this macro step, with the messages of each instance."""
    if plan.counters[FAILURES] == 0:
        return
    time, failed = reached(plan), plan.instances["failed"]
    failures: dict[int, FmuError] = {}
    for i in np.flatnonzero(failed[:, 0]):
        if failed[i, 1] == NOT_CALLED or tuple(failed[i][:2]) == DISCARD:
            continue
        function, status, detail = (int(x) for x in failed[i])
        slave = instances[int(i)]
        slave.time = time
        text, code = "", status
        if status == NOT_A_NUMBER:
            name = layout.ports["Real"].outputs[detail][1].name
            text, code = NAN.text(name) + _given(plan, layout, int(i), slave), 0
        elif status in (TOO_LONG, NOT_BASE64):
            wrong = "is longer than its declared capacity" if status == TOO_LONG else "is not base64 text"
            text, code = f"its packet output {wrong}", 0
        elif status == STATUS.index("fmi2Discard") and function in (1, 2, 3):
            shown = _inputs(plan, layout, int(i), KINDS[function - 1])
            some = ", ".join(shown[:5]) + (" ..." if len(shown) > 5 else "")
            text = f"fmi2Discard: it rejected one of these values: {some}"
        elif status == OUT_OF_RANGE:
            text, code = WIDE_INTEGER.text(), 0
        elif status == EARLY:
            text, code = "it has not simulated all of the step, though early return is not allowed", 0
        elif status == ENDED:
            text, code = "it requested the end of the run (terminateSimulation)", 0
        elif status == STATUS.index("fmi2Pending"):
            text = PENDING.text()
            slave.cancel_step()
        elif function == DO_STEP and status in _FAILED:
            given = _given(plan, layout, int(i), slave)
            text = given and slave.status_word(status) + given
        failures[int(i)] = slave.failure(slave.function_name(FUNCTIONS[function]), code, text)
    others = list(failures.values())
    for i in np.flatnonzero(failed[:, 0]):
        if tuple(failed[i][:2]) == DISCARD:
            failures[int(i)] = _beside(plan, instances, int(i), others)
    raise RunFailed([failures[i] for i in sorted(failures)])


def discard_failure(plan: Plan, slave: Slave, i: int, last: float | None, reason: str) -> FmuError:
    """Returns the error of instance `i`, which has discarded its step; `last` is the time that it reached, s."""
    time, h = reached(plan), float(plan.instances["h"][i])
    got = "" if last is None else f", only to {last:.9g} s"
    text = DISCARDED.text(slave.fmi, f"{time:.9g}", f"{time + h:.9g}", got, reason)
    return slave.failure(slave.function_name("fmi2DoStep"), DISCARD[1], text)


def _beside(plan: Plan, instances: Sequence[Slave], i: int, others: Sequence[FmuError]) -> FmuError:
    """Returns the error of an instance that discarded a step in which others failed, so that the step is not repeated.

    After an error, FMI only allows an instance to be freed or reset. A repetition would fail again, and shorter steps
    would hide the failure.
    """
    slave, names = instances[i], ", ".join(error.instance for error in others[:3])
    slave.time = reached(plan)
    last = None if slave.library.corrupted else slave.last_successful_time()
    return discard_failure(plan, slave, i, last, f"it is not repeated, since {names} failed in the same step")


def _given(plan: Plan, layout: Layout, i: int, slave: Slave) -> str:
    """Returns the inputs of an instance as set for its last step: ``; its inputs: u = 0.5, w = 2``.

    Unconnected inputs, which are not read from the FMU, follow those that are connected.
    """
    shown = [one for kind in KINDS for one in _inputs(plan, layout, i, kind)]
    if plan.counters[K] < 0 and shown:  # during initialization, the loop sets no inputs
        return ""
    shown += _unconnected(layout, i, slave)
    more = f" and {len(shown) - _MOST_INPUTS} more" if len(shown) > _MOST_INPUTS else ""
    return f"; its inputs: {', '.join(shown[:_MOST_INPUTS])}{more}" if shown else ""


def _inputs(plan: Plan, layout: Layout, i: int, kind: str) -> list[str]:
    """Returns the inputs of one kind of an instance, as last set: ``u = 0.5``."""
    ports, values = layout.ports[kind], plan.real_in if kind == "Real" else plan.int_in
    begin = len(layout.ports["Integer"].inputs) if kind == "Boolean" else 0
    first, last = ports.first_in[i], ports.first_in[i + 1]
    given = values[begin + first : begin + last]
    named = zip(_variables(layout, i, kind), given, strict=True)
    return [f"{variable.name} = {value:.9g}" for variable, value in named]


def _unconnected(layout: Layout, i: int, slave: Slave) -> list[str]:
    """Returns the unconnected inputs of an instance that have a value: ``s = -1``."""
    connected = {variable.name for kind in KINDS for variable in _variables(layout, i, kind)}
    connected |= {name.partition("[")[0] for name in connected}  # an array of FMI 3 has its elements there
    values = {**layout.instances[i].effective_values(), **slave.changed}
    names = [
        v.name for v in slave.fmu.variables.values() if v.causality == "input" and v.type in KINDS and not v.clocks
    ]
    return [f"{name} = {_shown(values[name])}" for name in names if name in values and name not in connected]


def _variables(layout: Layout, i: int, kind: str) -> Sequence[Variable]:
    ports = layout.ports[kind]
    return ports.inputs[ports.first_in[i] : ports.first_in[i + 1]]


def _shown(value: Start) -> str:
    """Returns numbers as those of connected inputs are written, also of arrays."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.9g}" if isinstance(value, int | float) else str(value)

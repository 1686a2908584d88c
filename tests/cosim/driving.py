"""Drives any model of cosim_models step by step with the same inputs, on its record or as an FMU.

Run as a script it writes the bytes of the record after every step to a file:
``python driving.py MODULE MODEL STEPS FILE``, interpreted where NUMBA_DISABLE_JIT=1.
"""

from __future__ import annotations

import base64
import importlib
import math
import sys
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.model import FlatVariable, Model, flat_variables


def packets(step: int) -> bytes:
    """What arrives in a step: autopilot and ground station take turns; most steps bring nothing."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1 if step % 20 < 10 else 190)
    link.seq = step % 256
    turn = step % 10
    made: list[Any] = []
    if turn == 0:
        made = [mavlink.MAVLink_heartbeat_message(2, 3, 81 | (128 if step > 30 else 0), 4, 4, 3)]
    elif turn == 2:
        made = [mavlink.MAVLink_command_long_message(1, 1, (176, 400, 22)[step // 10 % 3], 0, 1, 4, 0, 0, 0, 0, 10)]
    elif turn == 4:
        lat, lon = -353632620, 1491652370 + 30 * step
        made = [
            mavlink.MAVLink_global_position_int_message(step * 12, lat, lon, 584000, 10 * step, 1, 2, 3, 9000),
            mavlink.MAVLink_command_ack_message((511, 176, 400, 22)[step // 10 % 4], 0),
        ]
    elif turn == 6:
        made = [mavlink.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.1, 0.1)]
    return b"".join(bytes(message.pack(link)) for message in made)


def value(one: FlatVariable, reference: int, step: int) -> Any:
    """The input `one` at a step: its start value, reals swaying a little about it."""
    if one.variable.kind == "Packets":
        return packets(step)[: one.variable.capacity]
    if one.variable.kind != "Real":
        return one.start
    return float(one.start) + 0.05 * (1.0 + math.sin(0.3 * step + reference))


def inputs(model: type[Model]) -> list[tuple[int, FlatVariable]]:
    roles = ("input", "packet input")
    return [(i, one) for i, one in enumerate(flat_variables(model.variables)) if one.variable.role in roles]


def set_input(m: Any, one: FlatVariable, new: Any) -> None:
    name = one.variable.name
    if one.variable.kind == "Packets":
        m[name][: len(new)] = np.frombuffer(new, np.uint8)
        m[f"{name}_len"] = len(new)
    elif one.index is None:
        m[name] = new
    else:
        m[name][one.index] = new


def drive_record(model: type[Model], steps: int, kernels: Any = None) -> np.ndarray[Any, Any]:
    """The bytes of the record after start and after every step: shape (steps + 1, record size).

    `kernels`: start and advance, by default the model's own, which are compiled just in time.
    """
    start, advance = kernels or model.kernels
    m = model.record()
    rows = []
    assert start(m) == 0
    rows.append(np.frombuffer(m.tobytes(), np.uint8))
    for step in range(steps):
        for reference, one in inputs(model):
            set_input(m, one, value(one, reference, step))
        assert advance(m, step * model.step_size, model.step_size) == 0
        rows.append(np.frombuffer(m.tobytes(), np.uint8))
    return np.array(rows)


KINDS = {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer", "Boolean": "Boolean", "Packets": "String"}


def set_inputs(model: type[Model], fmu: Any, step: int) -> None:
    """Set all inputs of an instance (FMPy's FMU2Slave) for a step."""
    for reference, one in inputs(model):
        new = value(one, reference, step)
        if isinstance(new, bytes):
            new = base64.b64encode(new).decode()
        getattr(fmu, f"set{KINDS[one.variable.kind]}")([reference], [new])


def read(model: type[Model], fmu: Any) -> list[Any]:
    """All values of an instance, in the order of the value references."""
    flat = flat_variables(model.variables)
    return [getattr(fmu, f"get{KINDS[one.variable.kind]}")([i])[0] for i, one in enumerate(flat)]


def read_record(model: type[Model], row: np.ndarray[Any, Any]) -> list[Any]:
    """The same values from a row of `drive_record`."""
    m = row.copy().view(model.record().dtype)[0]
    values: list[Any] = []
    for one in flat_variables(model.variables):
        found = m[one.variable.name]
        if one.variable.kind == "Packets":
            values.append(base64.b64encode(found[: m[f"{one.variable.name}_len"]].tobytes()))
        else:
            values.append((found if one.index is None else found[one.index]).item())
    return values


if __name__ == "__main__":
    module, name, count, file = sys.argv[1:]
    np.save(file, drive_record(getattr(importlib.import_module(module), name), int(count)))

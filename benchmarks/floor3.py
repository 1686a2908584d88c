"""The plan of a system of FMI 3.0 FMUs in the format that floor3.c reads: its calls, one by one."""

from __future__ import annotations

import ctypes
from typing import Any

from cosim_master.execution.execution import Execution
from cosim_master.fmi.calls import FUNCTIONS, PACKED, TYPED

__all__ = ["calls_of"]


def calls_of(execution: Execution) -> list[str]:
    """Of each instance: its places among inputs, and its calls with all arguments."""
    plan = execution.plan
    lines = [str(plan.calls.size)]
    for row, feed in zip(plan.instances, plan.feeds, strict=True):
        ranges = [int(feed[side][kind]) for kind in (0, 1) for side in ("first_in", "last_in")]
        ranges[3] = int(feed["last_in"][2])  # booleans are integers to the floor
        lines.append(" ".join(map(str, ranges)))
        first, middle, last = (int(row[name]) for name in ("first_set_value", "last_set", "last_get"))
        for some in (plan.calls[first:middle], plan.calls[middle:last]):
            lines.append(str(len(some)))
            lines += [_line(plan, call) for call in some]
    return lines


def _line(plan: Any, call: Any) -> str:
    """ "Set Float64 PLACE N N_VALUES REFERENCE ..." """
    name = FUNCTIONS[int(call["number"])]
    verb, fmi_type, n = name[4:7], name[7:], int(call["n"])
    if int(call["width"]) == PACKED:
        typed = {"plain": int(call["values"]), "n_values": n >> 16}
        n &= 0xFFFF
    else:
        typed = dict(zip(TYPED.names or (), (ctypes.c_uint64 * 5).from_address(int(call["values"])), strict=True))
    reals, integers = (plan.real_in, plan.int_in) if verb == "Set" else (plan.real_out, plan.int_out)
    array = reals if fmi_type == "Float64" else integers
    place = (typed["plain"] - array.ctypes.data) // array.itemsize
    references = (ctypes.c_uint32 * n).from_address(int(call["references"]))
    return f"{verb} {fmi_type} {place} {n} {typed['n_values']} {' '.join(map(str, references))}"

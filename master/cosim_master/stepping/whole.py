"""Steps of instances in one call: inputs, step and outputs together, where an FMU has the functions for that.

FMUs of this project have two functions besides those of FMI (see fmi2.c in `cosim.build.native`). A master tells
`uav_cosim_note_step` once which variables it sets and gets in each step; `uav_cosim_make_step` then does the work of up
to nine calls of FMI, with packets as bytes instead of base64 text. Where it cannot, such as for an input outside its
limits, the loop makes these calls, which say why.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim_master.fmi.calls import FUNCTIONS, CallMemory, Row
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.kernels.tables import WHOLE

__all__ = ["enter_whole_steps", "memory_of_whole_steps"]

_GROUPS = [
    FUNCTIONS.index(f"fmi2{name}")
    for name in (
        *("SetReal", "SetInteger", "SetBoolean", "SetString"),
        *("GetReal", "GetInteger", "GetBoolean", "GetString"),
    )
]
"""The functions that a step in one call replaces, by their numbers, in the order of fmi2.c."""
_HEAD, _MOVE = 4 * len(_GROUPS), 24
"""Bytes of what uav_cosim_note_step writes: at its begin, and at most for each variable."""


def memory_of_whole_steps(instances: int, values: int) -> int:
    """Returns the bytes that `enter_whole_steps` takes at most: of instances that set and get so many values."""
    return instances * (WHOLE.itemsize + _HEAD + _MOVE) + _MOVE * values


def enter_whole_steps(
    instances: NDArray[np.void],
    ports: NDArray[np.void],
    calls: Sequence[Row],
    slaves: Sequence[Slave],
    free: Sequence[int],
    memory: CallMemory,
) -> None:
    """Enters into `instances` how the instances `free` make a step in one call.

    Args:
        instances: the INSTANCE table, with the numbers of its calls.
        ports: the PORTS table; those of these instances become `raw`.
        calls: all calls, as rows.
        memory: receives the arguments.
    """
    functions: dict[int, tuple[int, int]] = {}
    noted: dict[tuple[object, ...], int] = {}
    first_set, last_set, first_get, last_get = (
        instances[name].tolist() for name in ("first_set", "last_set", "first_get", "last_get")
    )
    endpoint, further = instances["endpoint"].tolist(), ports["further"].tolist()
    found: list[tuple[int, int, int, list[int]]] = []
    owners: list[int] = []
    for i in free:
        library = slaves[i].library
        if (known := functions.get(id(library))) is None:
            known = library.address_if("uav_cosim_note_step"), library.address_if("uav_cosim_make_step")
            functions[id(library)] = known
        note, step = known
        if not step or (endpoint[i] >= 0 and further[endpoint[i]] > 0):
            continue
        own = (*calls[first_set[i] : last_set[i]], *calls[first_get[i] : last_get[i]])
        key = (note, *[(row[5], row[2], row[4]) for row in own])  # function, references and their number
        if (moves := noted.get(key)) is None:
            moves = noted[key] = _noted(note, own, memory)
        if moves:
            values = {row[5]: row[3] for row in own}
            found.append((step, slaves[i].handle, moves, [values.get(number, 0) for number in _GROUPS]))
            owners.append(i)
    if found:
        rows = np.array(found, dtype=WHOLE)
        address = memory.take(rows.nbytes)
        ctypes.memmove(address, rows.ctypes.data, rows.nbytes)
        instances["whole"][owners] = address + WHOLE.itemsize * np.arange(rows.size, dtype=np.uint64)
        ports["raw"] = np.isin(ports["instance"], owners)


def _noted(note: int, calls: Sequence[Row], memory: CallMemory) -> int:
    """Returns the address of what an FMU has noted on the variables of calls; 0 if one call cannot replace them."""
    rows = {row[5]: row for row in calls}
    if not rows.keys() <= {*_GROUPS} or len(rows) != len(calls):
        return 0
    numbers = [rows[number][4] if number in rows else 0 for number in _GROUPS]
    own = [rows[number] for number in _GROUPS if number in rows]
    every = [one for row in own for one in (ctypes.c_uint32 * row[4]).from_address(row[2])]
    moves = memory.take(_HEAD + _MOVE * len(every))
    pointer = ctypes.c_void_p
    whole = ctypes.CFUNCTYPE(ctypes.c_int, pointer, pointer, pointer)(note)
    refused = whole((ctypes.c_uint32 * len(numbers))(*numbers), (ctypes.c_uint32 * len(every))(*every), moves)
    return 0 if refused else moves

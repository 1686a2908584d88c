"""Tests of whether FMUs can return to an earlier state, made before a master relies on it.

The sequence is: save, step, step; restore, step, step. The outputs must be the same, bit for bit. Many FMUs declare
this capability, but do not save data that are not variables.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.slaves.fmi2 import set_kind
from cosim_master.fmi.slaves.slave import Slave

__all__ = ["self_test"]


def self_test(slaves: Sequence[Slave], time: float, sizes: Sequence[Sequence[float]], why: str) -> list[FmuError]:
    """Tests whether instances reach the same state again, and restores them.

    Args:
        slaves: the instances, initialized, at `time` [s].
        sizes: the step sizes to try with each instance, s.
        why: the feature that requires it, for the errors.

    Returns:
        The problem of each instance that failed the test.
    """
    failures = []
    for one, steps in zip(slaves, sizes, strict=True):
        get, put = one.state_functions
        if not one.library.has(get, put):
            failures.append(FmuError(one.name, get, f"the binary does not have it, and {why} needs it", time))
            continue
        state = ctypes.c_void_p()
        final, one.final = one.final, False
        try:
            one.time = time
            one.save_state(state)
            first = _stepped(one, time, steps)
            one.time = time
            one.restore_state(state)
            again = _stepped(one, time, steps)
            one.restore_state(state)
            one.time = time
        except FmuError as error:
            failures.append(error)
            continue
        finally:
            one.free_state(state)
            one.final = final
        if changed := [name for name in first if not _same(first[name], again[name])]:
            name = changed[0]
            text = (
                f"its state cannot be trusted, and {why} needs it: saved, stepped, restored and stepped again, "
                f"{name} is {again[name]!r} instead of {first[name]!r}"
            )
            failures.append(FmuError(one.name, put, text, time))
    return failures


def _stepped(one: Slave, time: float, steps: Sequence[float]) -> dict[str, Any]:
    """Returns all outputs after these steps."""
    t = time
    for h in steps:
        one.time = t
        try:
            if not one.try_step(t, h):
                break
        except FmuError as error:
            if not error.status.endswith("Discard"):
                raise
            break  # shorter steps may succeed, and will be tried in the run
        t += h
    outputs = [v for v in one.fmu.variables.values() if v.causality == "output" and v.clock is None and not v.clocks]
    kinds: dict[str, list[Variable]] = {}
    for v in outputs:
        kinds.setdefault(set_kind(v), []).append(v)
    return {v.name: x for group in kinds.values() for v, x in zip(group, one.get(group), strict=True)}


def _same(a: Any, b: Any) -> bool:
    return bool(a == b or (a != a and b != b))

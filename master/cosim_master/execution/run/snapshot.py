"""A copy in memory of all data that the future of a run depends on."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import FmuError, RunFailed
from cosim_master.execution.run.state import RunState, changing
from cosim_master.network.radio.tables import ROLES as RADIO_ROLES
from cosim_master.network.radio.tables import Radio
from cosim_master.network.roles import PASSING, STATE
from cosim_master.stepping.kernels.tables import FAULTS, ROLES

__all__ = ["Snapshot"]


class Snapshot:
    """FMU states, the arrays that change, Strings and events.

    Rows and packets are not part of it, only their numbers: a copy is of use until `Blocks.emptied` changes. `close`
    frees the FMU states; call it before the instances are freed.
    """

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._fmu_states = [ctypes.c_void_p() for _ in state.slaves]
        self._arrays: dict[str, np.ndarray[Any, Any]] = {}
        self._radio: Radio | None = None
        self._texts: dict[tuple[int, str], str] = {}
        self._events: Any = None

    def save(self) -> None:
        """Copies the state, and replaces an earlier copy.

        Raises:
            RunFailed: an FMU fails to save its state.
        """
        state = self._state
        try:
            for one, fmu_state in zip(state.slaves, self._fmu_states, strict=True):
                one.time = state.time
                one.save_state(fmu_state)
        except FmuError as error:
            raise RunFailed([error]) from None
        self._arrays = {name: view.copy() for name, view in changing(state.plan, ROLES, (STATE, PASSING)).items()}
        self._radio = _copy(state.radio)
        self._texts, self._events = dict(state.texts.outputs), state.event_mode.events.saved()

    def restore(self) -> None:
        """Goes back to the copy.

        Raises:
            RunFailed: an FMU fails to restore its state.
        """
        assert self._radio is not None
        state = self._state
        try:
            for one, fmu_state in zip(state.slaves, self._fmu_states, strict=True):
                one.time = state.time
                one.restore_state(fmu_state)
        except FmuError as error:
            raise RunFailed([error]) from None
        for name, view in changing(state.plan, ROLES, (STATE, PASSING)).items():
            view[...] = self._arrays[name]
        state.plan.shared[FAULTS] = 0
        state.radio = _restored(state.radio, self._radio)
        state.texts.outputs |= self._texts
        state.event_mode.events.restore(self._events)

    def close(self) -> None:
        """Frees the FMU states."""
        for one, fmu_state in zip(self._state.slaves, self._fmu_states, strict=True):
            one.free_state(fmu_state)


def _copy(radio: Radio) -> Radio:
    """Returns the radio with copies of the arrays that change (whole tables: they are small)."""
    return radio._replace(**{name: getattr(radio, name).copy() for name in _changing(radio)})


def _restored(radio: Radio, saved: Radio) -> Radio:
    """Returns a radio like the saved one: `radio` itself unless it has grown, as kernels know its tables already."""
    names = _changing(saved)
    for name, now, then in zip(Radio._fields, radio, saved, strict=True):
        if now.shape != then.shape if name in names else now is not then:
            return _copy(saved)
    for name in names:
        getattr(radio, name)[...] = getattr(saved, name)
    return radio


def _changing(radio: Radio) -> set[str]:
    return {name.partition(".")[0] for name in changing(radio, RADIO_ROLES, (STATE, PASSING))}

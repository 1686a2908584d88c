"""Access to the values of a model without kernels, by offsets that are kept for each list of value references.

A master passes the same lists in every step. Looking up each variable and checking it took half the processor time of a
step of `ArduPilotSITL`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cosim import Model as Base
else:
    Base = object

__all__ = ["QuickAccess"]

Offsets = dict[tuple[int, ...], NDArray[np.intp]]


class QuickAccess(Base):
    """Base class beside `Model`, and before it: the same values, errors and effects as those of `Model`."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        memory = self._bytes
        self._integers = memory[: memory.size - memory.size % 4].view(np.int32)
        self._booleans = memory.view(np.bool_)
        self._rows: Any = memory.view(self.m.dtype)
        self._outputs: dict[str, Offsets] = {"Real": {}, "Integer": {}, "Boolean": {}}
        self._inputs: Offsets = {}
        self._packets: dict[int, NDArray[np.int32]] = {
            vr: self._rows[f"{variable.name}_len"]
            for vr, (variable, _) in enumerate(self._places)
            if variable.kind == "Packets"
        }

    def one(self, name: str) -> Any:
        """Returns the memory of a scalar variable as an array with one element."""
        return self._rows[name]

    def _found(self, vrs: list[int], kind: str, size: int, *others: str) -> NDArray[np.intp]:
        """Returns the places of variables in an array of elements of `size` bytes."""
        known, key = self._outputs[kind], tuple(vrs)
        found = known.get(key)
        if found is None:
            offsets = [self._place(vr, kind, *others)[1] // size for vr in vrs]
            found = known[key] = np.array(offsets, np.intp)
        return found

    def get_real(self, vrs: list[int]) -> list[float]:
        self._before_get()
        values: list[float] = self._reals[self._found(vrs, "Real", 8)].tolist()
        return values

    def get_integer(self, vrs: list[int]) -> list[int]:
        self._before_get()
        values: list[int] = self._integers[self._found(vrs, "Integer", 4, "Enumeration")].tolist()
        return values

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        self._before_get()
        values: list[bool] = self._booleans[self._found(vrs, "Boolean", 1)].tolist()
        return values

    def get_string(self, vrs: list[int]) -> list[str]:
        self._before_get()
        if len(vrs) == 1 and (length := self._packets.get(vrs[0])) is not None and not length[0]:
            return [""]
        return super().get_string(vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        places = self._inputs.get(key := tuple(vrs))
        total = sum(values)
        if places is None or total != total or len(values) != len(vrs) or self._initialising:  # NaN, which is refused
            super().set_real(vrs, values)
            if not self._initialising and all(_is_free(self._places[vr][0]) for vr in vrs):
                self._inputs[key] = np.array([self._places[vr][1] // 8 for vr in vrs], np.intp)
            return
        self._reals[places] = values

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        places = self._inputs.get(key := tuple(vrs))
        if places is None or self._integers[places].tolist() != values or self._initialising:
            super().set_integer(vrs, values)
            if not self._initialising:
                self._inputs[key] = np.array([self._places[vr][1] // 4 for vr in vrs], np.intp)

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        if (
            values == [""]
            and len(vrs) == 1
            and not self._initialising
            and self._places[vrs[0]][0].role == "packet input"
        ):
            self._packets[vrs[0]][0] = 0
            return
        super().set_string(vrs, values)


def _is_free(variable: Any) -> bool:
    """Returns whether any number may be set during a run."""
    return bool(variable.role == "input" and variable.limits() == (-np.inf, np.inf))

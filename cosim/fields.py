"""Kernels that access a record's fields by byte offset.

A kernel names a record's fields in its source. Lookup tables of fields (parameters that a ground station names) need
their byte offsets instead, which `cosim.model.record_layout` provides.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.deferred import InModule
from cosim.kernel import PLAIN, kernel

__all__ = ["get_real", "get_whole", "set_real", "set_whole"]


def _plain_get_real(record: Any, offset: int) -> float:
    return float(record.getfield(np.float64, int(offset)))


def _plain_set_real(record: Any, offset: int, value: float) -> None:
    record.setfield(value, np.float64, int(offset))


def _plain_get_whole(record: Any, offset: int) -> int:
    return int(record.getfield(np.int32, int(offset)))


def _plain_set_whole(record: Any, offset: int, value: int) -> None:
    record.setfield(value, np.int32, int(offset))


def _module() -> Any:
    from cosim import fields_compiled

    return fields_compiled


def _compiled(name: str) -> Any:
    return InModule(_module, name)


_get_real: Callable[[Any, int], float] = _plain_get_real if PLAIN else _compiled("get_real")
_set_real: Callable[[Any, int, float], None] = _plain_set_real if PLAIN else _compiled("set_real")
_get_whole: Callable[[Any, int], int] = _plain_get_whole if PLAIN else _compiled("get_whole")
_set_whole: Callable[[Any, int, int], None] = _plain_set_whole if PLAIN else _compiled("set_whole")


@kernel
def get_real(record: Any, offset: int) -> float:
    """Returns the float64 at byte `offset` of a record; the offset is not checked."""
    return _get_real(record, offset)


@kernel
def set_real(record: Any, offset: int, value: float) -> None:
    """Writes the float64 at byte `offset` of a record; the offset is not checked."""
    _set_real(record, offset, value)


@kernel
def get_whole(record: Any, offset: int) -> int:
    """Returns the int32 at byte `offset` of a record; the offset is not checked."""
    return _get_whole(record, offset)


@kernel
def set_whole(record: Any, offset: int, value: int) -> None:
    """Writes the int32 at byte `offset` of a record; the offset is not checked."""
    _set_whole(record, offset, value)

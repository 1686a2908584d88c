"""The memory of an autopilot's record as a reboot leaves it.

Parameters and inputs are no memory. What is stored on board (missions, fences, rally points) is kept; everything else
is zero, as at the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim import Variable
from cosim.fields import set_whole
from cosim.kernel import kernel
from cosim.model import record_layout

__all__ = ["forgetting"]

_WORD = 4  # bytes


def _words(variables: Sequence[Variable], kept: Sequence[str]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Returns begin and end [bytes] of each part of the record that is forgotten."""
    layout, head = record_layout(tuple(variables))
    fields = layout.fields
    assert fields is not None
    stored = sorted((fields[name][1], fields[name][1] + fields[name][0].itemsize) for name in kept)
    parts, begin = [], head
    for first, end in (*stored, (layout.itemsize, layout.itemsize)):
        assert begin % _WORD == first % _WORD == end % _WORD == 0
        parts.append((begin, first))
        begin = end
    return np.array(parts, dtype=np.int64)


def forgetting(variables: Sequence[Variable], kept: Sequence[str]) -> Callable[[Any], None]:
    """Returns a kernel of a record with these variables that clears all its memory but the fields `kept`."""
    parts = _words(variables, kept)

    @kernel
    def forget(m: Any) -> None:
        for i in range(parts.shape[0]):
            for offset in range(parts[i, 0], parts[i, 1], _WORD):
                set_whole(m, offset, 0)

    return forget

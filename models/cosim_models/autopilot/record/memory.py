"""The memory of the autopilot's record as a reboot leaves it.

Stored on board, and therefore kept: missions, fences and rally points, as on a real one. Parameters and inputs are no
memory. Everything else is zero, as at the start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.fields import set_whole
from cosim.kernel import kernel
from cosim.model import record_layout
from cosim_models.autopilot.record.variables import VARIABLES

__all__ = ["forget"]

_KEPT = ("mission", "mission_count", "fence", "fence_count", "rally", "rally_count")
_WORD = 4  # bytes


def _words() -> np.ndarray[Any, np.dtype[np.int64]]:
    """Returns begin and end [bytes] of each part of the record that is forgotten."""
    layout, head = record_layout(VARIABLES)
    fields = layout.fields
    assert fields is not None
    kept = sorted((fields[name][1], fields[name][1] + fields[name][0].itemsize) for name in _KEPT)
    parts, begin = [], head
    for first, end in (*kept, (layout.itemsize, layout.itemsize)):
        assert begin % _WORD == first % _WORD == end % _WORD == 0
        parts.append((begin, first))
        begin = end
    return np.array(parts, dtype=np.int64)


_PARTS = _words()


@kernel
def forget(m: Any) -> None:
    """Clears all memory but that which is stored on board."""
    for i in range(_PARTS.shape[0]):
        for offset in range(_PARTS[i, 0], _PARTS[i, 1], _WORD):
            set_whole(m, offset, 0)

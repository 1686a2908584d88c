"""Events of packets as the radio tells them, by the columns that a page needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim_master.network.radio.tables import EVENT

COLUMNS = (
    "sent",
    "arrival",
    "source",
    "target",
    "message",
    "system",
    "component",
    "sequence",
    "length",
    "outcome",
)


def events_of(rows: Sequence[tuple[int, ...]]) -> np.ndarray[Any, Any]:
    """Returns events with these columns; each packet is at its first endpoint."""
    events = np.zeros(len(rows), dtype=EVENT)
    for name, column in zip(COLUMNS, zip(*rows, strict=True), strict=False):
        events[name] = column
    events["origin"], events["born"] = events["source"], events["sent"]
    return events

"""Contact with the ground station and the radio: when they were heard last, for fail-safes.

Kernels over a record with `CONTACT_MEMORY` and the parameter SYSID_MYGCS.
"""

from __future__ import annotations

from typing import Any

from cosim import Memory
from cosim.kernel import kernel

__all__ = ["CONTACT_MEMORY", "note_station", "station_is_lost"]

CONTACT_MEMORY = (
    Memory("station_known", dtype="?", rare=True),
    Memory("station_heard", rare=True),  # s
    Memory("radio_heard", rare=True),  # s
)


@kernel
def note_station(m: Any, sender: int, t: float) -> None:
    """Notes a sign of life of the ground station."""
    if sender == m.SYSID_MYGCS:
        m.station_known = True
        m.station_heard = t


@kernel
def station_is_lost(m: Any, patience: float, t: float) -> bool:
    """Returns whether a ground station was there, and has been silent for `patience` [s]."""
    return bool(m.station_known and t - m.station_heard >= patience)

"""Contact with the ground station and the radio: when they were heard last, for fail-safes.

Kernels over a record with `CONTACT_MEMORY` and the parameter SYSID_MYGCS.
"""

from __future__ import annotations

from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import RADIO_STATUS_REMRSSI
from cosim.packets import get_u8

__all__ = ["CONTACT_MEMORY", "is_unreported", "note_report", "note_station", "station_is_lost"]

CONTACT_MEMORY = (
    Memory("station_known", dtype="?", rare=True),
    Memory("station_heard", rare=True),  # s
    Memory("station_reported", rare=True),  # s: when the radio told last that the station hears it; 0: never
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


@kernel
def note_report(m: Any, t: float) -> None:
    """Handles RADIO_STATUS: with a strength of the signal at the other end, the ground station's radio hears it."""
    if get_u8(m.received, RADIO_STATUS_REMRSSI) != 0:
        m.station_reported = t


@kernel
def is_unreported(m: Any, patience: float, t: float) -> bool:
    """Returns whether the radio told that the ground station hears it, and has not done so for `patience` [s]."""
    return bool(m.station_reported > 0.0 and t - m.station_reported > patience)

"""Events of AUTOTUNE in a DataFlash log, by the texts that come with them.

Source: ArduPilot, AP_Logger (LogEvent), AC_AutoTune and AC_AutoTune_Multi (where events and texts are).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

__all__ = ["tuning_events"]

_INITIALISED, _OFF, _RESTART, _SUCCESS, _FAILED, _REACHED_LIMIT, _PILOT_TESTING, _SAVED = range(30, 38)
_BEGINS, _DISARMS = "AutoTune: Started", "Disarming motors"
_EVENTS = {
    "AutoTune: Stopped": (_OFF,),
    "AutoTune: Success": (_SUCCESS,),
    "AutoTune: Failed to level": (_FAILED,),
    "AutoTune: Twitch Size Determination Failed": (_REACHED_LIMIT, _FAILED),
    "AutoTune: Rate D Gain Determination Failed": (_FAILED,),
    "AutoTune: Rate P Gain Determination Failed": (_FAILED,),
    "AutoTune: Angle P Gain Determination Failed": (_FAILED,),
    "AutoTune: Min Rate D limit reached": (_REACHED_LIMIT,),
    "AutoTune: Pilot Testing": (_PILOT_TESTING,),
    "AutoTune: Saved gains": (_SAVED,),
}
"""Numbers of events by the beginnings of texts."""


def tuning_events(said: Iterable[tuple[float, str]]) -> Iterator[tuple[float, int]]:
    """Returns time and number of each event of a tune.

    A tune that is left is begun again (AUTOTUNE_RESTART), unless it has succeeded, failed, or the vehicle has disarmed.

    Args:
        said: time and words of the STATUSTEXTs of an autopilot, in the order of their times.
    """
    begun = False
    for time, text in said:
        if text == _BEGINS:
            yield time, _RESTART if begun else _INITIALISED
            begun = True
        for words, events in _EVENTS.items():
            if text.startswith(words):
                yield from ((time, event) for event in events)
                begun = begun and not {_SUCCESS, _FAILED} & set(events)
        begun = begun and text != _DISARMS

"""Events of AUTOTUNE by its texts, in the order in which ArduCopter writes them."""

from __future__ import annotations

import pytest

from cosim_master.results.export.contents.tuning_events import tuning_events

BEGUN, STOPPED, SUCCESS = "AutoTune: Started", "AutoTune: Stopped", "AutoTune: Success"


@pytest.mark.parametrize(
    ("said", "events"),
    [
        ([BEGUN, "AutoTune: Roll Rate D Up 25%", SUCCESS, STOPPED], [30, 33, 31]),
        ([BEGUN, STOPPED, BEGUN, STOPPED], [30, 31, 32, 31]),
        ([BEGUN, SUCCESS, STOPPED, "AutoTune: Pilot Testing gains for Roll Pitch "], [30, 33, 31, 36]),
        ([BEGUN, STOPPED, "Disarming motors", BEGUN], [30, 31, 30]),
        ([BEGUN, "AutoTune: Twitch Size Determination Failed", STOPPED, BEGUN], [30, 35, 34, 31, 30]),
        ([BEGUN, "AutoTune: Failed to level, please tune manually", BEGUN], [30, 34, 30]),
        (["AutoTune: Min Rate D limit reached", "AutoTune: Saved gains for Roll "], [35, 37]),
        (["Arming motors", "AutoTune: pilot overrides active", "AutoTune: must be complete to test gains"], []),
    ],
)
def test_events_by_texts(said: list[str], events: list[int]) -> None:
    assert [event for _, event in tuning_events(enumerate(said))] == events
    assert [time for time, _ in tuning_events([(2.5, BEGUN)])] == [2.5]
